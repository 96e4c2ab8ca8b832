"""Modes of small motion, drawn over the mechanism."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import MechanismError
from ...model.quantities import whole
from ..drawing.canvas import Canvas
from ..drawing.compose import Options, compose
from ..drawing.draw import frame_axes, room
from ..drawing.sample import Sample
from ..drawing.scene import diagonal_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Largest motion of a part, in parts of the picture's diagonal, and the largest turn, rad.
REACH, TURN = 0.09, 0.35


def plot_modes(model: Any, count: int | None = None) -> Figure:
    """Draw the shapes of modes: the mechanism at rest, and at both ends of its motion.

    Parameters
    ----------
    model : LinearModel or sequence of Mode
        Result of :func:`linearize`, or some of its modes.
    count : int, optional
        Number of modes to draw, the slowest first; by default at most six.

    Returns
    -------
    matplotlib.figure.Figure
        Axes for each mode, headed by its frequency and damping ratio. The size of the motion is chosen to be seen.
    """
    from matplotlib.figure import Figure

    modes = list(model.modes() if hasattr(model, "modes") else model if isinstance(model, Sequence) else ())
    if hasattr(model, "modes") and not modes:
        raise MechanismError("plot_modes: the model has no modes, since joints and drivers hold every motion")
    if not modes or not all(hasattr(mode, "shape") and hasattr(mode, "at") for mode in modes):
        raise MechanismError(f"plot_modes: takes the result of linearize, or some of its modes, got {model!r}")
    shown = modes[: min(len(modes), 6) if count is None else whole(count, "plot_modes", "count", 1)]
    across = min(len(shown), 3)
    down = -(-len(shown) // across)
    figure = Figure(figsize=(3.9 * across + 0.4, 3.6 * down), layout="constrained")
    grid = figure.subplots(down, across, squeeze=False).ravel()
    for axes, mode in zip(grid, shown, strict=False):
        _draw(axes, mode)
    for axes in grid[len(shown) :]:
        axes.set_visible(False)
    return figure


def _draw(axes: Any, mode: Any) -> None:
    amplitude = _amplitude(mode)
    motion = mode.motion(amplitude, frames=9)
    sample = Sample(motion)
    scene, _ = compose(sample, Options())
    poses = scene.poses(sample)
    # the motion begins at one end, and is at the other one half a period later
    rest = scene.poses(Sample(mode.model.state))
    for pose, strength in ((poses[4], 0.25), (poses[0], 1.0)):
        Canvas(axes, replace(scene, labels=[]), strength, still=strength == 1.0).show(pose)
    # as dashed outlines
    marks = [replace(mark, style="tie") for mark in scene.marks if mark.style in ("body", "pin")]
    outline = replace(scene, marks=marks, labels=[])
    Canvas(axes, outline, 0.55, still=False).show(rest[0])
    frame_axes(axes, room(scene, np.vstack([poses, rest]), np.zeros((0, 2))), fresh=False)
    damped = f", damping ratio {mode.damping_ratio:.3g}" if abs(mode.damping_ratio) > 1e-9 else ""
    axes.set_title(f"{mode.frequency:.4g} Hz{damped}", fontsize="medium")


def _amplitude(mode: Any) -> float:
    """Amplitude at which the largest motion of a body is well seen."""
    state = mode.model.state
    scene, _ = compose(Sample(state), Options())
    box = room(scene, scene.poses(Sample(state)), np.zeros((0, 2)))
    diagonal = diagonal_of(box)
    bodies = state.mechanism.bodies
    shape = np.abs(mode.shape[: 3 * len(bodies)]).reshape(-1, 3)
    moved, turned = float(np.max(shape[:, :2])), float(np.max(shape[:, 2]))
    wanted = [REACH * diagonal / moved] * (moved > 1e-9) + [TURN / turned] * (turned > 1e-9)
    return min(wanted, default=0.1)
