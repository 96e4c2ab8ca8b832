"""Tiles of the gallery: short films of what the examples find, without axes and names."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

import mbdcasadi as mbd
from mbdcasadi.visual.drawing.canvas import Canvas
from mbdcasadi.visual.drawing.compose import Options
from mbdcasadi.visual.drawing.draw import room
from mbdcasadi.visual.film import film

#: Size of a tile, inches, its dots per inch, its frames, their time on the screen, s, and its colours.
SIZE, DPI, FRAMES, SECONDS, COLOURS = (3.2, 2.4), 90, 30, 3.0, 48


def save_tile(found: Iterable[Any], path: Path) -> None:
    """Write the film of the last motion of most phases among the names of an example, or draw its mechanism."""
    found = list(found)
    motions = [x.trajectory if isinstance(x, mbd.Solution) else x for x in found]
    motions = [x for x in motions if isinstance(x, mbd.Trajectory) and len(x) > 1 and x.t[-1] > x.t[0]]
    if not motions:
        models = [x for x in found if isinstance(x, mbd.Mechanism | mbd.library.Model)]
        motions = [_standing(models[0])]
    motion = max(reversed(motions), key=lambda motion: len(motion.phases))
    duration = float(motion.t[-1] - motion.t[0])
    taken = film(motion, Options(), None, FRAMES / SECONDS, duration / SECONDS, "")
    scene = replace(taken.scene.without("velocities").without("loads"), labels=[])
    figure = Figure(figsize=SIZE, dpi=DPI)
    canvas, axes = FigureCanvasAgg(figure), figure.add_axes((0, 0, 1, 1))
    axes.set_axis_off()
    (low, bottom), (high, top) = room(scene, taken.poses, np.zeros((0, 2)))
    scale = max((high - low) / SIZE[0], (top - bottom) / SIZE[1])
    for limits, ends, size in ((axes.set_xlim, (low, high), SIZE[0]), (axes.set_ylim, (bottom, top), SIZE[1])):
        limits(sum(ends) / 2 - scale * size / 2, sum(ends) / 2 + scale * size / 2)
    drawn, frames = Canvas(axes, scene), []
    for pose, time in zip(taken.poses, taken.t, strict=True):
        drawn.show(pose, time)
        canvas.draw()
        frames.append(_picture(np.asarray(canvas.buffer_rgba())))
    palette = frames[0].quantize(COLOURS, dither=0)
    frames = [frame.quantize(palette=palette, dither=0) for frame in frames]
    still = all(np.array_equal(np.asarray(frames[0]), np.asarray(frame)) for frame in frames)
    rest = [] if still else frames[1:]
    frames[0].save(
        path, save_all=True, append_images=rest, duration=round(1e3 * SECONDS / FRAMES), loop=0, optimize=True
    )


def _standing(model: Any) -> mbd.Trajectory:
    """A mechanism that does not move, as a motion of two times."""
    state = mbd.assemble(getattr(model, "mechanism", model))
    twice = [np.stack([x, x]) for x in (state.q, 0 * state.v, 0 * state.a, state.z, state.lam, state.inputs)]
    return mbd.Trajectory(state.mechanism, np.array([0.0, 1.0]), *twice, state.parameters)


def _picture(pixels: np.ndarray) -> Any:
    from PIL import Image

    return Image.fromarray(pixels[:, :, :3].copy(), "RGB")
