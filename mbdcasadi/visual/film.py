"""The frames of an animation: times, poses, traces and curves over them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..errors import MechanismError
from ..model.symbols import number
from ..results.columns import read_lines
from ..results.trajectory import Trajectory
from .drawing.compose import Options, compose
from .drawing.draw import room, subject
from .drawing.labels import settled
from .drawing.sample import Sample
from .drawing.scene import Scene

#: Seconds that a motion takes on the screen where no speed is given: it is slowed or quickened into these bounds.
SHORTEST, LONGEST = 3.0, 20.0
#: Usual width of a film, points: names find their places on it.
PAPER = 400.0
#: Frames of one animation, at most.
MOST_FRAMES = 20_000


@dataclass(frozen=True, eq=False)
class Film:
    """A motion as frames at equal distances in time.

    Attributes
    ----------
    sample : Sample
        Its values at the times of the frames.
    scene : Scene
        What is shown.
    poses : numpy.ndarray
        (n, frames, 4) of the scene.
    scale : dict of str to float
        Of arrows, see :func:`compose.compose`.
    ways : numpy.ndarray
        Traced points (n, k, 2), m.
    box : numpy.ndarray
        Corners ``[[x, y], [x, y]]`` of all that is shown, m.
    curves : dict of str to dict of str to numpy.ndarray
        By label: lines (n,) by name.
    speed : float
        Seconds of the motion to one on the screen.
    fps : float
        Frames to a second on the screen.
    title : str
    """

    sample: Sample
    scene: Scene
    poses: np.ndarray
    scale: dict[str, float]
    ways: np.ndarray
    box: np.ndarray
    curves: dict[str, dict[str, np.ndarray]]
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
        return int(max(2, np.ceil(2 - np.log10(self.t[-1] - self.t[0]))))


def film(
    motion: Any, options: Options, plots: Mapping[str, Any] | None, fps: float, speed: float | None, title: str | None
) -> Film:
    """Take the frames of a motion; see :func:`animate` for the arguments."""
    motion = subject(motion)
    if not isinstance(motion, Trajectory) or len(motion) < 2 or motion.t[-1] <= motion.t[0]:
        raise MechanismError("animate: takes a motion over some time, as simulate and kinematics return it")
    duration = float(motion.t[-1] - motion.t[0])
    fps = _positive(fps, "fps")
    speed = usual_speed(duration) if speed is None else _positive(speed, "speed")
    count = max(2, round(duration / speed * fps) + 1)
    if count > MOST_FRAMES:
        raise MechanismError(
            f"animate: {duration:g} s at speed {speed:g} and fps {fps:g} are {count} frames, more than {MOST_FRAMES}; "
            "raise speed= or lower fps="
        )
    sample = Sample(motion, np.linspace(motion.t[0], motion.t[-1], count))
    scene, scale = compose(sample, options)
    ways = sample[ca.vertcat(ca.SX(0, 1), *options.trace)].reshape(count, -1, 2)
    name = motion.mechanism.name if title is None else str(title)
    poses = scene.poses(sample)
    box = room(scene, poses, ways.reshape(-1, 2))
    scene = settled(scene, poses, box, PAPER / float(box[1, 0] - box[0, 0]))
    return Film(sample, scene, poses, scale, ways, box, _curves(sample, plots), speed, fps, name)


def _positive(value: Any, name: str) -> float:
    found = number(value, "animate", name)
    if found <= 0:
        raise MechanismError(f"animate: {name} must be positive, got {found:g}")
    return found


def usual_speed(duration: float) -> float:
    """Speed at which a motion can be watched: 1, or a round number where it is very short or long."""
    if SHORTEST <= duration <= LONGEST:
        return 1.0
    wanted = duration / (SHORTEST if duration < SHORTEST else LONGEST)
    if 0.6 <= wanted <= 1.0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(power * min((1, 2, 5, 10), key=lambda f: abs(np.log(f * power / wanted))))


def _curves(sample: Sample, plots: Mapping[str, Any] | None) -> dict[str, dict[str, np.ndarray]]:
    found: dict[str, dict[str, np.ndarray]] = {}
    for label, (names, column) in read_lines(plots or {}).items():
        found[label] = dict(zip(names, sample[column].T, strict=True))
    return found
