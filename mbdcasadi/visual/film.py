"""The frames of an animation: times, poses over them, and the course of traces and plots."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from ..errors import MechanismError
from ..model.symbols import positive
from ..numerics.lazy import cached_property
from ..results.columns import read_lines
from ..results.trajectory import Trajectory
from .course import Course
from .drawing.compose import Options, compose
from .drawing.draw import room, subject
from .drawing.labels import with_placed_names
from .drawing.sample import Sample
from .drawing.scene import Scene

#: Seconds that a motion takes on the screen if no speed is given: it is slowed or quickened into these bounds.
SHORTEST, LONGEST = 3.0, 20.0
#: Usual width of a film, points: names find their places on it.
PAPER = 400.0
#: Frames of one animation, at most.
MOST_FRAMES = 20_000


#: Tolerance of traces and curves as they are drawn, relative to their extent.
DRAWN = 2e-4


@dataclass(frozen=True, eq=False)
class Film:
    """A motion as frames at equal distances in time.

    Attributes
    ----------
    motion : Trajectory
        Motion that is shown.
    sample : Sample
        Its values at the times of the frames.
    scene : Scene
        Frames and marks.
    poses : numpy.ndarray
        (n, frames, 4) of the scene.
    scale : dict of str to float
        Of arrows, see :func:`compose.compose`.
    box : numpy.ndarray
        Corners ``[[x, y], [x, y]]`` of all that is shown, m.
    options : Options
        What is drawn, with the points that are traced; names are shown, in a page from the start, if it says so.
    plots : dict of str to (names, expressions)
        By label: names of lines, and their column.
    fine : numpy.ndarray
        Times (m,) of traces and plots, at which their lines are smooth and show every peak, s.
    lines : list of numpy.ndarray
        At these times: traces (m, 2k), and each plot (m, number of lines).
    speed : float
        Seconds of the motion to one on the screen.
    fps : float
        Frames to a second on the screen.
    title : str
    """

    motion: Trajectory
    sample: Sample
    scene: Scene
    poses: np.ndarray
    scale: dict[str, float]
    box: np.ndarray
    options: Options
    plots: dict[str, tuple[list[str], ca.SX]]
    fine: np.ndarray
    lines: list[np.ndarray]
    speed: float
    fps: float
    title: str

    @property
    def t(self) -> np.ndarray:
        """Times of the frames (n,), s."""
        return self.sample.t

    @property
    def digits(self) -> int:
        """Decimals with which a time is written."""
        duration = float(self.t[-1] - self.t[0])
        return int(max(2, np.ceil(2 - np.log10(duration)))) if duration > 0 else 2

    @cached_property
    def curves(self) -> dict[str, dict[str, np.ndarray]]:
        """Lines by name, by label, over the times of :attr:`fine`."""
        return {
            label: dict(zip(names, values.T, strict=True))
            for (label, (names, _)), values in zip(self.plots.items(), self.lines[1:], strict=True)
        }

    @cached_property
    def paths(self) -> np.ndarray:
        """Traced points (n, k, 2) over the times of :attr:`fine`, m."""
        return self.lines[0].reshape(self.fine.size, -1, 2)


def film(
    motion: Any, options: Options, plots: Mapping[str, Any] | None, fps: float, speed: float | None, title: str | None
) -> Film:
    """Take the frames of a motion; see :func:`animate` for the arguments."""
    motion = subject(motion)
    if not isinstance(motion, Trajectory) or len(motion) < 2 or motion.t[-1] <= motion.t[0]:
        raise MechanismError("animate: takes a motion over some time, as simulate and kinematics return it")
    duration = float(motion.t[-1] - motion.t[0])
    fps = positive(fps, "animate", "fps")
    speed = usual_speed(duration) if speed is None else positive(speed, "animate", "speed")
    count = max(2, round(duration / speed * fps) + 1)
    if count > MOST_FRAMES:
        raise MechanismError(
            f"animate: {duration:g} s at speed {speed:g} and fps {fps:g} are {count} frames, more than {MOST_FRAMES}; "
            "raise speed= or lower fps="
        )
    sample = Sample(motion, np.linspace(motion.t[0], motion.t[-1], count))
    scene, scale = compose(sample, replace(options, names=True, velocities=True))  # a page switches them on and off
    name = motion.mechanism.name if title is None else str(title)
    poses = scene.poses(sample)
    quantities = read_lines({} if plots is None else plots)
    course = Course(motion, [options.paths, *[column for _, column in quantities.values()]])
    for label, values in zip(quantities, course.values[1:], strict=True):
        if not np.isfinite(values).all():
            raise MechanismError(f"animate: '{label}' is not finite over the whole motion")
    fine, lines = course.lines([np.maximum(DRAWN * np.ptp(values, axis=0), 1e-12) for values in course.values])
    box = room(scene.without("velocities"), poses, lines[0].reshape(-1, 2))
    scene = with_names(scene, poses, box)
    return Film(
        motion, sample, scene, poses, scale, box, options, quantities, fine, lines, speed, fps, name,
    )  # fmt: skip


def with_names(scene: Scene, poses: np.ndarray, box: np.ndarray) -> Scene:
    """Return a scene with its names in their places on a film, of which a box with the corners `box`, m, is seen."""
    return with_placed_names(scene, poses, box, PAPER / float(box[1, 0] - box[0, 0]))


def usual_speed(duration: float) -> float:
    """Speed at which a motion can be watched: 1, or a round number if it is very short or long."""
    if SHORTEST <= duration <= LONGEST:
        return 1.0
    wanted = duration / (SHORTEST if duration < SHORTEST else LONGEST)
    if 0.6 <= wanted <= 1.0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(power * min((1, 2, 5, 10), key=lambda f: abs(np.log(f * power / wanted))))
