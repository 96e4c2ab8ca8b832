"""Overview of an optimal motion."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from ...errors import MechanismError
from ...model.joints.lower_pairs import PointOnLine, Revolute, Translational
from ...model.rates import time_derivative
from ...results.columns import columns, read_lines
from ..axes import dress, legend, over_time, readable, stacked
from ..drawing.style import SERIES_LIGHT, series_colour
from .plot import reaction_sizes

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ...optimal_control.solution import Solution

#: Times at which curves between mesh points are drawn.
TIMES = 600
#: Largest distance of a limit from the curve of an input at which it is shown, in parts of the range of the curve.
NEAR_RANGES = 1.0
#: Letters of the name of a limit: a longer one would leave no room for the curves.
LABEL = 34


def plot_solution(solution: Solution, expressions: Mapping[str, Any] | None = None) -> Figure:
    """Plot a solution of optimal control: inputs with their limits, states, reactions, active limits and the mesh.

    Parameters
    ----------
    solution : Solution
        Result of :func:`optimize`.
    expressions : dict of str to expression, optional
        Quantities to draw, by label, as in :func:`plot`; by default the natural
        coordinates of joints on the ground and their rates, or the coordinates of
        the bodies if there are no such joints.

    Returns
    -------
    matplotlib.figure.Figure
        Dots are the points at which the equations hold; dashed lines are limits of
        inputs; bars say when which limit holds the motion back.
    """
    if not hasattr(solution, "active_limits"):
        raise MechanismError(f"plot_solution: takes the result of optimize, got {solution!r}")
    states = _usual_states(solution) if expressions is None else _named(expressions)
    inputs, active, loads = (
        list(solution.inputs),
        solution.active_limits,
        reaction_sizes(solution.trajectory)[0],
    )
    heights = [1.5] * (len(inputs) + len(states)) + [1.5] * bool(loads) + [0.15 + 0.22 * len(active)] * bool(active)
    heights.append(0.25)
    figure, stack = stacked(8.4, 1.1 + sum(heights), len(heights), heights)
    rest = iter(stack)
    # the polynomials of inputs may jump from one interval to the next, and are drawn interval by interval
    fine = solution.trajectory.at(np.linspace(0.0, solution.duration, TIMES))
    for symbol in inputs:
        _input(next(rest), solution, fine, symbol)
    for label, lines in states.items():
        _lines(next(rest), solution, fine, lines, label)
    if loads:
        _lines(next(rest), solution, fine, loads, "reaction, N")
    if active:
        limits = [limit for part in solution.phases for limit in part.program.limit_owners.items()]
        units = {limit.label: getattr(symbol, "unit", None) for limit, (symbol, _) in limits}
        _active(next(rest), active, units)
    _mesh(next(rest), solution)
    for axes in stack:
        axes.set_xlim(0.0, solution.duration)
        axes.tick_params(labelbottom=axes is stack[-1])
    over_time(figure, stack)
    name = solution.problem.mechanism.name or "optimal motion"
    title = f"{name}: cost {solution.cost:.6g}, {solution.duration:.4g} s"
    readable(figure.suptitle(title, fontsize="medium"), name=True)
    return figure


def _named(expressions: Mapping[str, Any]) -> dict[str, dict[str, ca.SX]]:
    """Lines by name, by label of the axes."""
    return {
        label: dict(zip(names, ca.vertsplit(column), strict=True))
        for label, (names, column) in read_lines(expressions).items()
    }


def _usual_states(solution: Solution) -> dict[str, dict[str, ca.SX]]:
    """Natural coordinates and their rates: lines by name, by label of the axes."""
    mechanism = solution.problem.mechanism
    grounded = [joint for joint in mechanism.joints if any(body.is_ground for body in joint.bodies)]
    angles = {joint.name: joint.angle for joint in grounded if isinstance(joint, Revolute)}
    places = {joint.name: joint.displacement for joint in grounded if isinstance(joint, Translational | PointOnLine)}
    if not angles and not places:
        angles = {body.name: body.phi for body in mechanism.bodies}
        places = {body.name: body.position for body in mechanism.bodies}
    panels = {}
    for natural, label, unit in ((angles, "angle", "rad"), (places, "place", "m")):
        if natural:
            panels[f"{label}, {unit}"] = natural
            panels[f"its rate, {unit}/s"] = {name: time_derivative(e) for name, e in natural.items()}
    return panels


def _input(axes: Axes, solution: Solution, fine: Any, symbol: Any) -> None:
    motion = solution.trajectory
    axes.plot(fine.t, fine[symbol], color=SERIES_LIGHT[0], linewidth=1.5)
    axes.plot(motion.t, motion[symbol], ".", color=SERIES_LIGHT[0], markersize=3)
    low, high = axes.get_ylim()
    for limit in _limits(solution, symbol):
        values = np.broadcast_to(fine[limit], fine.t.shape)
        axes.plot(fine.t, values, color=SERIES_LIGHT[1], linewidth=1.1, linestyle=(0, (5, 3)))
        # a limit that is far away would leave no room for the curve
        if values.max() < high + NEAR_RANGES * (high - low) and values.min() > low - NEAR_RANGES * (high - low):
            low, high = min(low, values.min()), max(high, values.max())
    margin = 0.04 * (high - low)
    axes.set_ylim(low - margin, high + margin)
    dress(axes, symbol.quantity, name=True)


def _limits(solution: Solution, symbol: Any) -> list[ca.SX]:
    """Limits of an input as expressions: of those that are linear in it, and hold no other input."""
    limits = []
    others = [u for u in solution.inputs if u is not symbol]
    for condition in (limit for phase in solution.phases for limit in phase.limits):
        slope = ca.jacobian(condition.expression, symbol)
        if not slope.nnz() or ca.depends_on(slope, symbol):
            continue
        limit = ca.simplify(ca.substitute(symbol - condition.expression / slope, symbol, 0))
        if not others or not ca.depends_on(condition.expression, ca.vertcat(*others)):
            limits.append(ca.SX(limit))
    return limits


def _lines(axes: Axes, solution: Solution, fine: Any, expressions: Mapping[str, ca.SX], label: str) -> None:
    between, at = columns(fine, dict(expressions)), columns(solution.trajectory, dict(expressions))
    drawn = {}
    for k, (name, values) in enumerate(between.items()):
        colour = series_colour(k)
        (drawn[name],) = axes.plot(fine.t, values, color=colour, linewidth=1.5)
        axes.plot(solution.trajectory.t, at[name], ".", color=colour, markersize=3)
    dress(axes, label)
    legend(axes, drawn)


def _active(axes: Axes, active: Any, units: dict[str, str | None]) -> None:
    """A bar for each span of each limit, beside its label and, if it is known, its unit."""
    for row, limit in enumerate(active):
        for start, end in limit.spans:
            if end > start:
                axes.barh(row, end - start, left=start, height=0.55, color=SERIES_LIGHT[1])
            else:
                axes.plot(start, row, "d", color=SERIES_LIGHT[1], markersize=5)
        label = " ".join([limit.label, units.get(limit.label) or ""]).strip()
        axes.text(1.01, row, _short(label), transform=axes.get_yaxis_transform(), va="center", fontsize="small",
                  parse_math=False)  # fmt: skip
    dress(axes, "")
    axes.set_ylim(len(active) - 0.4, -0.6)
    _say(axes, "active limits")


def _short(label: str) -> str:
    return label if len(label) <= LABEL else label[: LABEL - 1] + "…"


def _mesh(axes: Axes, solution: Solution) -> None:
    axes.vlines(solution.mesh, 0, 1, color="#5b6770", linewidth=0.9)
    dress(axes, "")
    axes.set_ylim(0, 1)
    axes.grid(False)
    _say(axes, "mesh")


def _say(axes: Axes, what: str) -> None:
    """A label that is read without turning the head, in axes too low for one on its side."""
    axes.set_yticks([])
    axes.set_ylabel(what, rotation=0, ha="right", va="center")
