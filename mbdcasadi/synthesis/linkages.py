"""The list of linkages that a synthesis finds."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np

from ..errors import ModelError
from ..model.quantities import function_of, one_of, whole, yes_or_no
from ..results.archives import write_arrays
from ..results.notebook import html_table
from .linkage import Linkage

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Kind of the files.
FORMAT = "mbdcasadi linkages 1"
#: What lists are chosen by.
CHECKS = ("one_branch", "in_order", "crank_turns")
#: Rows of the table in a notebook, and pictures in a figure, at most.
SHOWN, PICTURES = 20, 24
#: Width of a picture among others, inches.
WIDTH = 2.4


@dataclass(frozen=True)
class Search:
    """How a list of linkages was found.

    Attributes
    ----------
    exact : bool
        True if all relations hold; False if they hold as nearly as can be.
    positions : int
        Number of positions.
    free : int
        Dimensions that these leave free: the list then is a sample.
    starts : int
        Random starts.
    seconds : float
        Wall-clock time, s.
    unsettled : int
        Linkages whose sum of squares had not settled when the iterations for it ended: others nearby may be nearer.
    """

    exact: bool
    positions: int
    free: int
    starts: int
    seconds: float
    unsettled: int = 0


class Linkages(Sequence[Linkage]):
    """Linkages through given positions: a sequence, made by :func:`synthesize`.

    Attributes
    ----------
    search : Search
        How they were found: starts, time, and how many dimensions the positions leave free.
    """

    def __init__(self, linkages: Sequence[Linkage], search: Search):
        self._linkages, self.search = tuple(linkages), search

    def __len__(self) -> int:
        return len(self._linkages)

    @overload
    def __getitem__(self, index: int) -> Linkage: ...
    @overload
    def __getitem__(self, index: slice) -> Linkages: ...
    def __getitem__(self, index: int | slice) -> Linkage | Linkages:
        if isinstance(index, slice):
            return Linkages(self._linkages[index], self.search)
        return self._linkages[index]

    def __iter__(self) -> Iterator[Linkage]:
        return iter(self._linkages)

    def where(self, condition: Callable[[Linkage], Any] | None = None, **checks: Any) -> Linkages:
        """Return the linkages that pass a condition and checks.

        Parameters
        ----------
        condition : callable, optional
            ``linkage -> bool``.
        **checks
            ``one_branch``, ``in_order`` or ``crank_turns`` of :class:`Linkage` with the value that they have: True,
            False or, of what is not decided, None.
        """
        if condition is not None:
            function_of(condition, "where", "condition", "linkage")
        for name, value in checks.items():
            one_of(name, CHECKS, "where", "a check")
            if value is not None:
                yes_or_no(value, "where", name)
        kept = [x for x in self._linkages if condition is None or condition(x)]
        for name, value in checks.items():
            kept = [x for x in kept if getattr(x, name) is (None if value is None else bool(value))]
        return Linkages(kept, self.search)

    def sorted(self, key: Callable[[Linkage], Any]) -> Linkages:
        """Return the linkages in the order of a key, the smallest first, those for which it is None last."""
        function_of(key, "sorted", "key", "linkage")
        keys = [key(linkage) for linkage in self._linkages]
        known = [k for k, value in enumerate(keys) if value is not None]
        order = [*sorted(known, key=lambda k: keys[k]), *(k for k, value in enumerate(keys) if value is None)]
        return Linkages([self._linkages[k] for k in order], self.search)

    @property
    def missing(self) -> float | None:
        """Estimate of the number of linkages that were not found.

        None if they or families among them are a sample, or approximate, or some were brought by a map alone.

        By those that were found once, n1, and twice, n2: at least ``n1 (n1 - 1) / (2 (n2 + 1))``, if all are as likely.

        References
        ----------
        Chao, "Nonparametric estimation of the number of classes in a population", Scandinavian Journal of Statistics
        11 (1984) 265.
        """
        if self.search.free or not self.search.exact or any(not x.found or x.family for x in self._linkages):
            return None
        once, twice = (sum(x.found == count for x in self._linkages) for count in (1, 2))
        return once * (once - 1) / (2 * (twice + 1))

    def draw(self, columns: int = 4, **options: Any) -> Figure:
        """Draw the linkages side by side, the first ones of many.

        Parameters
        ----------
        columns : int, default 4
            Pictures in a row.
        **options
            Of :meth:`Linkage.draw`.
        """
        from matplotlib.figure import Figure

        columns, shown = whole(columns, "draw", "columns", 1), self._linkages[:PICTURES]
        if not shown:
            raise ModelError("draw: the list has no linkage")
        rows = -(-len(shown) // columns)
        figure = Figure(figsize=(WIDTH * columns, WIDTH * rows), layout="constrained")
        places = np.ravel(figure.subplots(rows, columns, squeeze=False))
        for k, place in enumerate(places):
            if k < len(shown):
                place.set_title(str(k), fontsize="small")
            else:
                place.set_axis_off()
        layout = figure.get_layout_engine()
        assert layout is not None
        layout.execute(figure)
        figure.set_layout_engine("none")  # each picture would lay out all others
        for linkage, place in zip(shown, places, strict=False):
            linkage.draw(place, **options)
        figure.set_layout_engine(layout)
        return figure

    def save(self, path: str | Path) -> None:
        """Write dimensions and poses to one NumPy file, without pickle; :func:`read_linkages` reads it."""
        labels = [p.label for p in self[0].parameters] if len(self) else []
        content = {
            "format": FORMAT,
            "unknowns": np.array(labels, dtype=str),
            "values": np.array([list(x.parameters.values()) for x in self], float).reshape(len(self), len(labels)),
            "poses": np.array([x.independent_poses for x in self], float),
            "residuals": np.array([x.residual for x in self], float),
            "found": np.array([x.found for x in self], int),
            "family": np.array([x.family for x in self], int),
            "misses": json.dumps([x.misses for x in self]),
            "search": json.dumps(asdict(self.search)),
        }
        write_arrays(path, content)

    def __repr__(self) -> str:
        search, count = self.search, len(self)
        text = f"{count} linkage{'s' * (count != 1)} "
        text += f"{'through' if search.exact else 'nearest to'} {search.positions} positions"
        if search.free:
            text += f", a sample: {search.free} dimension{' stays' if search.free == 1 else 's stay'} free"
        elif search.exact and count:
            found = [x.found for x in self._linkages]
            text += f", each found {min(found)} to {max(found)} times"
            missing = self.missing or 0.0
            text += f"; by these numbers about {missing:.0f} are missing" if missing >= 0.5 else ""
            families = sum(x.family > 0 for x in self._linkages)
            text += f"; {families} of them are a sample of families" if families else ""
        if search.unsettled:
            text += f"; of {search.unsettled} that were looked at the sum of squares had not settled"
        return f"{text} ({search.starts} starts, {search.seconds:.3g} s)"

    def _repr_html_(self) -> str:
        shown = self._linkages[:SHOWN]
        labels = [p.label for p in shown[0].parameters] if shown else []
        rows = [
            [str(k), *(f"{v:.5g}" for v in x.parameters.values()), f"{x.residual:.1e}", str(x.found)]
            for k, x in enumerate(shown)
        ]
        more = [f"and {len(self) - SHOWN} more"] if len(self) > SHOWN else []
        return html_table(repr(self), rows, ["", *labels, "residual", "found"], more)
