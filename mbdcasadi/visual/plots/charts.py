"""Phase plots, energies with the loss by integration, and paths of equilibria."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import MechanismError
from ...results.columns import read_expressions, read_lines
from ..axes import dress, legend, over_time, readable, stacked
from ..drawing.draw import motion_of
from ..drawing.style import series_colour
from .plot import lines_over

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from ...statics.path import EquilibriumPath

#: Violations of constraints below this are drawn at it: a logarithm has no place for zero.
LEAST_VIOLATION = 1e-18


def plot_phase(motions: Any, expressions: Mapping[str, Any]) -> Figure:
    """Plot one expression over another one, as a coordinate and its rate.

    Parameters
    ----------
    motions : Trajectory or Solution, or dict of str to them
        One motion, or several with their names.
    expressions : dict of str to expression
        Two scalars with their labels: across, and up.

    Returns
    -------
    matplotlib.figure.Figure
        With a dot at the start of each motion.

    Raises
    ------
    MechanismError
        For other than two scalars.

    Examples
    --------
    >>> figure = plot_phase(motion, {"phi, rad": arm.phi, "omega, rad/s": arm.omega})  # doctest: +SKIP
    """
    from matplotlib.figure import Figure

    pair = read_expressions(expressions)
    if len(pair) != 2 or any(e.numel() != 1 for e in pair.values()):
        raise MechanismError("plot_phase: takes two scalars {label: expression}, first horizontal, then vertical")
    named = motions if isinstance(motions, Mapping) else {"": motions}
    figure = Figure(figsize=(7.2, 4.8), layout="constrained")
    axes, drawn = figure.subplots(), {}
    for k, (name, motion) in enumerate(named.items()):
        colour = series_colour(k)
        run = motion_of(motion, "plot_phase").fine
        across, up = (run[e] for e in pair.values())
        (drawn[name],) = axes.plot(across, up, color=colour, linewidth=1.5)
        axes.plot(across[0], up[0], "o", color=colour, markersize=5)
    label_across, label_up = pair
    dress(axes, label_up)
    legend(axes, drawn)
    readable(axes.set_xlabel(label_across))
    return figure


def plot_energy(motion: Any) -> Figure:
    """Plot energies, the change of their sum, and how well the constraints are met.

    Parameters
    ----------
    motion : Trajectory or Solution
        The motion.

    Returns
    -------
    matplotlib.figure.Figure
        Kinetic, potential and total energy; total less its first value; and, if there
        are constraints, the largest ``|Phi|`` and ``|Phi_q v - nu|`` by time.
    """
    run = motion_of(motion, "plot_energy")
    drawn = run.fine
    energy = drawn.energy
    change = energy.total - energy.total[0]
    position, velocity = run.violations
    drift = {"|Phi|, m or rad": position} if run.equations.Phi.numel() else {}
    drift |= {"its rate, m/s or rad/s": velocity} if run.equations.lam.numel() else {}
    count = 3 if drift else 2
    figure, stack = stacked(7.2, 1.0 + 2.0 * count, count)
    sizes = {"kinetic": energy.kinetic, "potential": energy.potential, "total": energy.total}
    lines_over(stack[0], drawn.t, sizes, "energy, J")
    lines_over(stack[1], drawn.t, {"": change}, "change of total, J")
    if drift:
        held = {name: np.maximum(values, LEAST_VIOLATION) for name, values in drift.items()}
        stack[2].set_yscale("log")
        lines_over(stack[2], run.t, held, "violation of constraints")
    return over_time(figure, stack)


def plot_path(path: EquilibriumPath, expressions: Mapping[str, Any]) -> Figure:
    """Plot a path of equilibria: expressions over the parameter that was changed.

    Parameters
    ----------
    path : EquilibriumPath
        Result of :func:`equilibrium_path`.
    expressions : dict of str to expression
        Expressions, by label; a vector with a line for each component, or scalars by the names of their lines.

    Returns
    -------
    matplotlib.figure.Figure
        Stable states in full lines, unstable ones dashed; critical states are marked and named.
    """
    quantities = read_lines(expressions)
    if not quantities:
        raise MechanismError("plot_path: there is nothing to draw; give {label: expression}")
    if not hasattr(path, "least_stiffness"):
        raise MechanismError(f"plot_path: takes the result of equilibrium_path, got {path!r}")
    figure, stack = stacked(6.4, 0.8 + 2.8 * len(quantities), len(quantities))
    for axes, (label, (names, column)) in zip(stack, quantities.items(), strict=True):
        values = path[column].reshape(len(path), -1)
        drawn = {
            name: _branches(axes, path, line, series_colour(k))
            for k, (name, line) in enumerate(zip(names, values.T, strict=True))
        }
        for critical in path.critical:
            at = np.atleast_1d(critical.state[column])
            axes.plot(np.full(at.shape, critical.value), at, "o", color="#20272e", markersize=5, zorder=4)
            axes.annotate(f"{critical.kind} at {critical.value:.4g}", (critical.value, at[0]), (6, 6),
                          textcoords="offset points", fontsize="small", color="#5b6770")  # fmt: skip
        dress(axes, label)
        legend(axes, drawn)
    readable(stack[-1].set_xlabel(path.parameter.label), name=True)
    return figure


def _branches(axes: Axes, path: EquilibriumPath, values: np.ndarray, colour: str) -> Any:
    """Draw pieces of one stability, each up to the first point of the next one; return the line of the first."""
    edges, lines = np.flatnonzero(np.diff(path.stable.astype(int))) + 1, []
    for piece in np.split(np.arange(len(path)), edges):
        reach = np.append(piece, piece[-1] + 1) if piece[-1] + 1 < len(path) else piece
        style = "-" if path.stable[piece[0]] else (0, (4, 3))
        lines += axes.plot(path.values[reach], values[reach], color=colour, linewidth=1.6, linestyle=style)
    return lines[0]
