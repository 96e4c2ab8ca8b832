"""Plots over time, as Matplotlib figures that belong to the caller."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from ...errors import MechanismError
from ...model.expressions import norm
from ...results.columns import (
    columns,
    effort_unit,
    has_multipliers,
    joints_of,
    reaction_of,
    read_lines,
)
from ...results.trajectory import Trajectory
from ..axes import dress, legend, over_time, readable, stacked
from ..drawing.draw import draw, motion_of
from ..drawing.style import SERIES_LIGHT, series_colour

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_STYLES = ("-", "--", ":")


def plot(motion: Any, expressions: Mapping[str, Any]) -> Figure:
    """Plot expressions over time, one above the other.

    Parameters
    ----------
    motion : Trajectory or Solution
        The motion.
    expressions : dict of str to expression, or of str to dict of str to expression
        The label of each axis, with the unit in it, and what is drawn there:
        a scalar, a vector with a line for each component, or scalars by the names of their lines.

    Returns
    -------
    matplotlib.figure.Figure
        One pair of axes for each expression; ``figure.savefig(path)`` writes it.

    Raises
    ------
    MechanismError
        If there is nothing to draw.

    Examples
    --------
    >>> figure = plot(motion, {"crank, rad": crank.phi, "pin force, N": force})  # doctest: +SKIP
    >>> figure = plot(motion, {"angle, rad": {"crank": crank.phi, "rod": rod.phi}})  # doctest: +SKIP
    """
    quantities = read_lines(expressions)
    if not quantities:
        raise MechanismError("plot: there is nothing to draw; give {label: expression}")
    run = motion_of(motion, "plot")
    drawn = run.fine
    figure, stack = stacked(7.2, 0.8 + 2.0 * len(quantities), len(quantities))
    for axes, (label, (names, column)) in zip(stack, quantities.items(), strict=True):
        values = drawn[column].reshape(len(drawn), -1)
        lines_over(axes, drawn.t, dict(zip(names, values.T, strict=True)), label)
    _mark_events(stack, run)
    return over_time(figure, stack)


def overview(motion: Trajectory) -> Figure:
    """Plot an overview of a motion.

    The mechanism as it starts; beside it the coordinates of all bodies, and on the right the
    sizes of the joint reactions, the efforts of drivers, the inputs, and the energy.

    Parameters
    ----------
    motion : Trajectory
        The motion.

    Returns
    -------
    matplotlib.figure.Figure
    """
    from matplotlib.figure import Figure

    if not len(motion):
        raise MechanismError("overview: the trajectory holds no times")
    drawn = motion.fine
    left, right = _coordinates(drawn), _loads(drawn)
    rows = len(left) * len(right)
    figure = Figure(figsize=(15.0, 7.6), layout="constrained")
    grid = figure.add_gridspec(rows, 3)
    for side, panels in enumerate((left, right), start=1):
        height = rows // len(panels)
        stack: list[Axes] = []
        for k, (label, lines) in enumerate(panels.items()):
            share = stack[0] if stack else None
            stack.append(figure.add_subplot(grid[k * height : (k + 1) * height, side], sharex=share))
            lines_over(stack[-1], drawn.t, lines, label, names=True)
            stack[-1].tick_params(labelbottom=k == len(panels) - 1)
        _mark_events(stack, motion)
        over_time(figure, stack)
    draw(motion, figure.add_subplot(grid[:, 0]), names=True)
    readable(figure.suptitle(motion.mechanism.name or "motion", fontweight="bold"), name=True)
    return figure


Panels = dict[str, dict[str, np.ndarray]]


def _coordinates(motion: Trajectory) -> Panels:
    bodies = motion.mechanism.bodies
    return {
        label: columns(motion, {body.name: getattr(body, level) for body in bodies})
        for label, level in (("x, m", "x"), ("y, m", "y"), ("phi, rad", "phi"))
    }


def _loads(motion: Trajectory) -> Panels:
    mechanism = motion.mechanism
    panels: Panels = {}
    if has_multipliers(motion):
        panels["reaction, N"] = reaction_sizes(motion)[1]
        for unit in ("N", "N m"):
            drivers = [driver for driver in mechanism.drivers if effort_unit(driver) == unit]
            label = f"{drivers[0].name}, {unit}" if len(drivers) == 1 else f"driver effort, {unit}"
            panels[label] = columns(motion, {driver.name: -driver.multipliers for driver in drivers})
    for measure in dict.fromkeys(u.unit for u in mechanism.inputs):
        inputs = [u for u in mechanism.inputs if u.unit == measure]
        label = inputs[0].quantity if len(inputs) == 1 else "input" + (f", {measure}" if measure else "")
        panels[label] = panels.get(label, {}) | columns(motion, {u.label: u for u in inputs})
    energy = motion.energy
    panels["energy, J"] = {"kinetic": energy.kinetic, "potential": energy.potential, "total": energy.total}
    return {label: lines for label, lines in panels.items() if lines}


def reaction_sizes(motion: Trajectory) -> tuple[dict[str, ca.SX], dict[str, np.ndarray]]:
    """Sizes of joint reactions as expressions, and over time, by joint; without those that never push."""
    forces = {j.name: norm(reaction_of(j).force) for j in joints_of(motion.mechanism)}
    # what never pushes, such as the angle of a slider that is held, would only fill the legend
    sizes = {name: size for name, size in columns(motion, forces).items() if np.any(size > 1e-9)}
    return {name: forces[name] for name in sizes}, sizes


def lines_over(
    axes: Axes, t: np.ndarray, lines: Mapping[str, np.ndarray], label: str, *, names: bool = False, width: float = 1.5
) -> None:
    """Draw named lines over time into axes; if `names`, label and legend hold names of the model."""
    marker, drawn = "o" if t.size == 1 else "", {}
    for k, (name, values) in enumerate(lines.items()):
        colour, style = series_colour(k), _STYLES[(k // len(SERIES_LIGHT)) % len(_STYLES)]
        (drawn[name],) = axes.plot(t, values, color=colour, linestyle=style, linewidth=width, marker=marker)
    dress(axes, label, names)
    legend(axes, drawn, names)
    if t.size > 1:
        axes.set_xlim(t[0], t[-1])


def _mark_events(stack: Sequence[Axes], motion: Trajectory) -> None:
    for event in motion.events:
        for axes in stack:
            axes.axvline(event.t, color="#8a929a", linewidth=0.8, linestyle=(0, (4, 3)), zorder=0)
        stack[0].annotate(
            event.name, (event.t, 1.0), xycoords=("data", "axes fraction"), xytext=(2, 2), textcoords="offset points",
            fontsize="x-small", color="#5b6770", parse_math=False,
        )  # fmt: skip
