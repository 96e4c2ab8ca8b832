"""The search for all linkages: random starts in batches, distinct solutions, and how often each was found."""

from __future__ import annotations

import itertools
import os
import time as clock
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import ModelError
from ..model.quantities import is_list
from ..model.symbols import Parameter, number
from .descent import MET, Range, descend, nearness, posed, searched
from .exchanges import exchanges
from .positions import Positions
from .residuals import Residuals
from .solving import SOLVED, Solution, Solving

#: Poses of all starts of a batch: as many as fit a processor's cache.
POSES = 8000
#: Starts of the first batch; each following one has twice as many.
FEWEST = 16
#: Times that each linkage was found from which the list counts as complete.
COMPLETE = 20
#: Linkages of a sample, if positions leave dimensions free, and of a list that is not exact.
MOST = 500
#: Share of the time after which the nearest linkages are followed to the least sum of squares.
SEARCHING = 0.8
#: Distance of two linkages that are the same, relative to their size, in what Newton's method makes of them, and in the
#: end of a descent.
SAME, SAME_END = 1e-6, 1e-4
#: Times that poses of a linkage that a map has brought are looked for.
TRIES = 5
#: Starts by which it is seen whether a position is in reach.
PROBED = 100

#: ``{parameter: value} -> further solutions``, each as such a mapping.
SymmetryMap = Callable[[dict[Parameter, float]], Sequence[Mapping[Parameter, float]]]


@dataclass(eq=False)
class Found:
    """A solution, and the number of starts that led to it."""

    solution: Solution
    count: int


class SynthesisSearch:
    """Random starts until all is found or the time is over.

    Parameters
    ----------
    positions : Positions
        The problem.
    exact : bool
        False if relations hold as nearly as can be.
    symmetries : sequence of callable
        Maps that bring further solutions.
    seed : int
        Of the random starts.
    """

    def __init__(self, positions: Positions, *, exact: bool, symmetries: Sequence[SymmetryMap], seed: int):
        self.positions, self.exact, self._symmetries, self._seed = positions, exact, symmetries, seed
        self.residuals = Residuals(positions)
        self.solving = Solving(positions, self.residuals, exact=exact)
        self.exchanges = exchanges(positions)
        unknowns = positions.unknowns
        self.range = Range(
            positions.drawn_values,
            np.array([x.lower for x in unknowns]),
            np.array([x.upper for x in unknowns]),
            positions.sizes,
            positions.start,
            positions.turning,
            positions.length,
        )
        self.found = list[Found]()
        self._images = np.zeros((0, len(unknowns)))
        self.starts = 0

    # --- what can be said at once ----------------------------------------------------------------
    def check(self) -> None:
        """Raise an error for conditions that contradict each other, too many of them, and positions out of reach."""
        solving, missed = self.solving, self._misses_of([])
        if missed:
            raise ModelError(f"synthesize: the conditions contradict each other or the limits of unknowns: {missed}")
        if self.exact and solving.equations > solving.columns:
            poses = solving.columns - self.residuals.n
            raise ModelError(
                f"synthesize: positions and conditions= make {solving.equations - poses} conditions on "
                f"{self.residuals.n} unknowns, {solving.equations - solving.columns} too many; leave out some, add "
                "parameters to unknowns=, or say exact=False"
            )
        for k in range(self.residuals.count * self.exact):
            if missed := self._misses_of([k]):
                raise ModelError(
                    f"synthesize: position {k + 1 + self.positions.drawn} is out of reach, whatever the others: "
                    f"{missed}; change it, the limits of unknowns or conditions="
                )

    def _misses_of(self, chosen: list[int]) -> str:
        """Relations that are missed if some positions alone are asked for; empty if they are met."""
        part = self.residuals.only(chosen)
        y, p = self.range.starts(PROBED, len(chosen), np.random.default_rng(0))
        with np.errstate(all="ignore"):
            y, p, value = descend(part, y, p)
        value = np.where(np.isfinite(value), value, np.inf)
        best = int(np.argmin(value))
        if value[best] < MET:
            return ""
        rows = part.rows(y[best], p[best]).all
        kinds = [self.positions.fixed_rows, self.positions.limit_rows, *(self.positions.rows[k] for k in chosen)]
        return named_misses([row for kind in kinds for row in kind], rows)

    # --- the search ------------------------------------------------------------------------------
    def run(self, seconds: float, executor: Executor | None) -> None:
        """Search until the list is complete or the time is over."""
        end = clock.monotonic() + (seconds if self.exact else SEARCHING * seconds)
        coarse = None if self.exact else self._coarse()
        size = max(FEWEST, POSES // max(1, (coarse or self.residuals).count))
        sizes = (min(size, FEWEST * 2**k) for k in itertools.count())
        tasks = ((self.residuals, self.range, n, (self._seed, k), coarse, end) for k, n in enumerate(sizes))
        ends = _here(tasks) if executor is None else _elsewhere(executor, tasks)
        near: list[tuple[float, np.ndarray, np.ndarray]] = []
        for y, p, value, count in ends:
            self.starts += count
            missed = nearness(self.residuals, p, value)
            for k in range(len(p)):
                if value[k] < MET and (clock.monotonic() < end or not self.found):
                    self._take(y[k], p[k])
                elif value[k] >= MET:
                    near.append((float(missed[k]), y[k], p[k]))
            near = sorted(near, key=lambda one: one[0])[:MOST]
            if clock.monotonic() > end or self._is_complete():
                break
        ends.close()
        end += (1 - SEARCHING) * seconds
        for _, y, p in near:
            if self.found and (clock.monotonic() > end or self._is_complete()):
                break
            self._take(y, p)

    def _coarse(self) -> Residuals:
        """The residuals of some of the positions, evenly among them: of as many as there are unknowns."""
        most = self.residuals.n
        if self.residuals.count <= most:
            return self.residuals
        return self.residuals.only(np.linspace(0, self.residuals.count - 1, most).round().astype(int).tolist())

    def _is_complete(self) -> bool:
        if self.solving.free and self.exact:
            return len(self.found) >= MOST
        if not self.exact:
            return any(x.solution.residual < SOLVED for x in self.found)  # nothing is nearer
        alone = [x.count for x in self.found if not x.solution.family]
        if len(alone) < len(self.found) < MOST:  # a family has no end
            return False
        return bool(self.found) and min(alone, default=COMPLETE) >= COMPLETE

    def _take(self, y: np.ndarray, p: np.ndarray) -> None:
        """Enter the end of a descent: a linkage that is known, or a new one and what maps make of it."""
        if (known := self._known(p, SAME_END)) is not None:
            known.count += 1
            return
        solution = self.solving.newton(y, p) if self.exact else self.solving.nearest(y, p)
        if solution is None or not self._within(solution.p) or (solution.family and len(self.found) >= MOST):
            return
        if (known := self._known(solution.p, SAME)) is not None:
            known.count += 1
            return
        waiting = [(solution, 1)]
        while waiting:
            one, count = waiting.pop()
            if self._known(one.p, SAME) is None:
                self._add(one, count)
                waiting += [(image, 0) for image in self._mapped(one)]

    def _add(self, solution: Solution, count: int) -> None:
        self.found.append(Found(solution, count))
        self._images = np.vstack([self._images, *(solution.p[order] for order in self.exchanges)])

    def _known(self, p: np.ndarray, tolerance: float) -> Found | None:
        """A linkage that is the same but for an exchange of equal chains."""
        if not self.found:
            return None
        apart = np.max(np.abs(self._images - p) / self.positions.sizes, axis=1)
        nearest = int(np.argmin(apart))
        near = apart[nearest] < tolerance * max(1.0, float(np.max(np.abs(p) / self.positions.sizes)))
        return self.found[nearest // len(self.exchanges)] if near else None

    def _within(self, p: np.ndarray) -> bool:
        slack = SAME * self.positions.sizes
        return bool(np.all((p >= self.range.lower - slack) & (p <= self.range.upper + slack)))

    def _mapped(self, solution: Solution) -> Iterator[Solution]:
        """Further solutions by the maps."""
        unknowns = self.positions.unknowns
        values = dict(zip(unknowns, solution.p.tolist(), strict=True))
        random = np.random.default_rng(self._seed)
        for symmetry in self._symmetries:
            for image in _images(symmetry, values):
                given = {**values, **image}
                p = np.array([number(given[x], f"symmetries=: '{x.label}'", "value") for x in unknowns])
                tries = (
                    self.solving.newton(posed(self.residuals, self.range, p[None], random)[0], p) for _ in range(TRIES)
                )
                mapped = next((one for one in tries if one is not None), None)
                if mapped is not None and self._within(mapped.p):
                    yield mapped


def _images(symmetry: SymmetryMap, values: dict[Parameter, float]) -> tuple[Mapping[Parameter, float], ...]:
    """What a map makes of a linkage."""
    try:
        images = symmetry(dict(values))
    except Exception as error:
        given = ", ".join(f"{x.label} = {value:.6g}" for x, value in values.items())
        raise ModelError(
            f"synthesize: a function in symmetries= fails with {type(error).__name__}: {error}; for {given}"
        ) from error
    if not is_list(images) or not all(isinstance(image, Mapping) for image in images):
        raise ModelError(f"synthesize: symmetries= takes functions that return a list of dictionaries, got {images!r}")
    for image in images:
        for key in image:
            if not isinstance(key, Parameter) or key not in values:
                raise ModelError(f"synthesize: symmetries=: a function returned {key!r}, which is not in unknowns=")
    return tuple(images)


def named_misses(rows: Sequence[Any], values: np.ndarray, most: int = 3) -> str:
    """The rows that are missed most, with the amounts."""
    order = np.argsort(-np.abs(values))[:most].tolist()
    worst = max(abs(float(values[k])) for k in order)
    shown = [k for k in order if abs(float(values[k])) > SAME * worst]
    return ", ".join(f"{rows[k].name} missed by {abs(float(values[k])) * rows[k].size:.3g}" for k in shown)


def _here(tasks: Iterator[tuple[Any, ...]]) -> Generator[tuple[np.ndarray, np.ndarray, np.ndarray, int]]:
    """Ends of the descents of batches, one after the other, and the number of starts of each."""
    for task in tasks:
        yield *searched(*task), task[2]


def _elsewhere(
    executor: Executor, tasks: Iterator[tuple[Any, ...]]
) -> Generator[tuple[np.ndarray, np.ndarray, np.ndarray, int]]:
    """The same in an executor, as they come: one batch more than it has workers."""
    waiting: dict[Future[Any], int] = {}
    workers = getattr(executor, "_max_workers", None) or os.cpu_count() or 1
    try:
        for task in tasks:
            try:
                waiting[executor.submit(searched, *task)] = task[2]
            except RuntimeError as error:
                raise ModelError(f"synthesize: executor= takes no more work: {error}") from None
            if len(waiting) > workers:
                for future in wait(waiting, return_when=FIRST_COMPLETED).done:
                    yield *future.result(), waiting.pop(future)
    finally:
        for future in waiting:
            future.cancel()
