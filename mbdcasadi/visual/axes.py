"""Matplotlib axes of drawings and plots: spines, labels and legends."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from textwrap import wrap
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.text import Text


#: Mean width of a letter of a label, points, the part of the height of axes that it may fill, and the shortest line.
LETTER, FILLED, SHORTEST = 6.0, 0.9, 12
#: A space at which no line is broken.
_JOINT = "\N{NO-BREAK SPACE}"


def stacked(
    width: float, height: float, count: int, ratios: Sequence[float] | None = None
) -> tuple[Figure, list[Axes]]:
    """Return a figure with axes one above the other, which share the horizontal axis."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    return figure, list(figure.subplots(count, 1, sharex=True, squeeze=False, height_ratios=ratios)[:, 0])


def over_time(figure: Figure, stack: Sequence[Axes]) -> Figure:
    """Label the time axis below axes one above the other, and align their labels."""
    stack[-1].set_xlabel("t, s")
    figure.align_ylabels(stack)
    return figure


def two_spines(axes: Axes) -> None:
    """Leave axes their left and lower spine, in a light colour."""
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color("#8a929a")
    axes.tick_params(color="#8a929a", labelsize="small")


def dress(axes: Axes, label: str, name: bool = False) -> None:
    """Give axes their label, a grid, and room about constant lines.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        With its lines drawn.
    label : str
        Quantity and unit.
    name : bool, default False
        True if the label holds a name of the model, see :func:`readable`.
    """
    axes.set_ylabel(_wrapped(axes, label))
    readable(axes.yaxis.label, name)
    axes.grid(True, color="#d8dce0", linewidth=0.6)
    axes.set_axisbelow(True)
    two_spines(axes)
    # rounding errors of a quantity that rests would else fill the whole height
    low, high = axes.get_ylim()
    size = max(abs(low), abs(high))
    if high - low < 1e-9 * max(size, 1e-3) and axes.get_yscale() == "linear":
        margin = 0.1 * size if size > 1e-9 else 1.0
        axes.set_ylim(low - margin, high + margin)


def _wrapped(axes: Axes, label: str) -> str:
    """Return a label on as many lines as its axes are too low for; a formula stays on one."""
    place = axes.get_subplotspec()
    if place is None or label.count("$") > 1:
        return label
    grid, rows = place.get_gridspec(), place.rowspan
    ratios = np.asarray(grid.get_height_ratios(), float)
    share = ratios[rows.start : rows.stop].sum() / ratios.sum()
    height = 72 * share * float(axes.figure.get_size_inches()[1])  # type: ignore[union-attr]
    letters = max(int(FILLED * height / LETTER), SHORTEST)
    if len(label) <= letters:
        return label
    # the unit stays with the last word of the quantity
    quantity, comma, unit = label.rpartition(", ")
    joined = quantity + comma.replace(" ", _JOINT) + unit.replace(" ", _JOINT) if len(unit) < SHORTEST else label
    return "\n".join(wrap(joined, letters, break_long_words=False)).replace(_JOINT, " ")


def legend(axes: Axes, lines: Mapping[str, Any], names: bool = False) -> None:
    """Put a legend beside axes: artists by their names.

    A single one needs none.
    """
    if len(lines) < 2:
        return
    # Matplotlib would leave out a name that begins with an underscore
    box = axes.legend(
        list(lines.values()), [" "] * len(lines), loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize="small",
        handlelength=1.4, frameon=False,
    )  # fmt: skip
    for text, name in zip(box.get_texts(), lines, strict=True):
        text.set_text(name)
        readable(text, names)


def readable(text: Text, name: bool = False) -> None:
    """Show a text as it is written if it is a name of the model, or no formula that Matplotlib can read.

    Parameters
    ----------
    text : matplotlib.text.Text
        Between two dollar signs it may hold a formula.
    name : bool, default False
        True if it is a name, in which a dollar sign is a dollar sign.
    """
    text.set_parse_math(not name and _is_formula(text.get_text()))


@lru_cache(maxsize=256)
def _is_formula(text: str) -> bool:
    if text.count("$") < 2:
        return True
    from matplotlib.mathtext import MathTextParser

    try:
        MathTextParser("path").parse(text)
    except ValueError:
        return False
    return True
