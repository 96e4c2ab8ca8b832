"""A drawing as data, independent of what draws it: frames that move, and marks that are fixed in them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import casadi as ca
import numpy as np

#: Layers from the lowest to the highest; bodies keep the order of the mechanism.
GROUND, GUIDE, BODY, SUPPORT, TRACE, SLOT, SPRING, PIN, ARROW = range(9)


@dataclass(frozen=True, eq=False)
class Mark:
    """Lines or areas of one style in a frame.

    Attributes
    ----------
    frame : int
        Frame in which it is fixed.
    loops : tuple of numpy.ndarray
        Points (k, 2) in m, or (k, 4) where they stretch with the frame (see :mod:`lines`); of
        several that are closed, those that run clockwise are holes.
    closed : bool
        True if the loops close.
    style : str
        Key of :data:`style.STYLES`.
    layer : int
        Layer; higher ones cover lower ones.
    body : int or None
        Number of the body whose colour it has; None for the ground.
    item : int or None
        Number of the item it belongs to.
    group : str
        "" for a mark that is always there, or the name of a group that can be left out ("loads").
    step : tuple of float or None
        From the beginning to the end of a piece of a line without an end (2,), m: pages repeat it as far as they show.
    """

    frame: int
    loops: tuple[np.ndarray, ...]
    closed: bool
    style: str
    layer: int
    body: int | None = None
    item: int | None = None
    group: str = ""
    step: tuple[float, ...] | None = None


@dataclass(frozen=True)
class Label:
    """A name at a point of a frame.

    Attributes
    ----------
    frame, point : int, tuple of float
        The point, m.
    text : str
        The name, of one line or more.
    body : bool
        True if a body is named.
    items : tuple of int
        Numbers of what is named.
    others : tuple of tuple of float
        Other points of the part, at which a line to the name may begin, m; placement makes one of them the point.
    shift : tuple of float
        Middle of the text from the point, points of the paper.
    leader : tuple of float or None
        End of a line that leads from the point to the text, points of the paper; None if the text is next to its point.
    """

    frame: int
    point: tuple[float, float]
    text: str
    body: bool = True
    items: tuple[int, ...] = ()
    others: tuple[tuple[float, float], ...] = ()
    shift: tuple[float, float] = (0.0, 0.0)
    leader: tuple[float, float] | None = None


@dataclass(eq=False)
class Item:
    """A body or an element that can be pointed at.

    Attributes
    ----------
    name, kind : str
        Its name, and its class ("Revolute").
    tooltip : dict of str to casadi.SX
        Labels with units, and scalars.
    appearances : tuple of float or None
        Times at which it appears and disappears in turn, s; None if it stays.
    """

    name: str
    kind: str
    tooltip: dict[str, ca.SX] = field(default_factory=dict)
    appearances: tuple[float, ...] | None = None

    def is_there(self, time: float) -> bool:
        """Return True if it is part of the mechanism at a time; at a change it is what follows."""
        return self.appearances is None or sum(t <= time for t in self.appearances) % 2 == 1


@dataclass(frozen=True, eq=False)
class MovingFrame:
    """Axes that marks are fixed in, as expressions.

    Attributes
    ----------
    position : casadi.SX
        (2,), m.
    angle, length : casadi.SX or float
        rad, m; of a frame along a vector they follow from it.
    vector : casadi.SX or None
        (2,): along the x axis of the frame.
    scale : float
        Length of the frame for the size 1 of the vector; 0 for a frame of the length 1 m.
    anchor : tuple or None
        Number of another frame in which the position is fixed, and the place there, m.
    unit : str
        Unit of an arrow to scale, "N", "N m" or "m/s"; "" for a frame that is no arrow.
    """

    position: ca.SX
    angle: Any = 0.0
    length: Any = 1.0
    vector: ca.SX | None = None
    scale: float = 0.0
    anchor: tuple[int, float, float] | None = None
    unit: str = ""

    @property
    def pose(self) -> ca.SX:
        """Columns ``x, y, angle, length`` (4,)."""
        if self.vector is None:
            return ca.vertcat(self.position, self.angle, self.length)
        length = self.scale * ca.norm_2(self.vector) if self.scale else 1
        return ca.vertcat(self.position, ca.atan2(self.vector[1], self.vector[0]), length)


@dataclass(eq=False)
class Scene:
    """Frames, marks in them, names and items.

    Attributes
    ----------
    unit : float
        The length that symbols are made of, m.
    frames : list of MovingFrame
        The first is the ground.
    marks : list of Mark
    labels : list of Label
    items : list of Item
    traces : list of int
        Frames at the points whose path is drawn.
    """

    unit: float
    frames: list[MovingFrame] = field(default_factory=lambda: [MovingFrame(ca.SX([0, 0]))])
    marks: list[Mark] = field(default_factory=list)
    labels: list[Label] = field(default_factory=list)
    items: list[Item] = field(default_factory=list)
    traces: list[int] = field(default_factory=list)

    def add(self, frame: MovingFrame) -> int:
        """Add a frame and return its number."""
        self.frames.append(frame)
        return len(self.frames) - 1

    def without(self, group: str) -> Scene:
        """Return the scene without the marks of a group."""
        return replace(self, marks=[mark for mark in self.marks if mark.group != group])

    @property
    def arrow_units(self) -> set[str]:
        """Units of the arrows to scale that are always shown: those of forces and of torques."""
        return {unit for mark in self.marks if not mark.group and (unit := self.frames[mark.frame].unit)}

    def poses(self, sample: Any) -> np.ndarray:
        """Poses (n_t, frames, 4) over the times of a sample: x, y (m), angle (rad), length (m)."""
        return sample[ca.vertcat(*[frame.pose for frame in self.frames])].reshape(-1, len(self.frames), 4)


def placed(points: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Points of a mark in the global frame (…, k, 2), for the poses (…, 4) of its frame."""
    x, y, angle, length = (pose[..., k, None] for k in range(4))
    if points.shape[1] == 4:
        u, v = points[:, 0] + points[:, 1] * length, points[:, 2] + points[:, 3] * np.abs(length)
    else:
        u, v = points[:, 0], points[:, 1]
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([x + c * u - s * v, y + s * u + c * v], axis=-1)


def diagonal_of(box: np.ndarray) -> float:
    """Length of the diagonal of a box with the corners ``[[x, y], [x, y]]``."""
    return float(np.hypot(*(box[1] - box[0])))


def box_of(marks: Sequence[Mark], poses: np.ndarray) -> np.ndarray:
    """Corners ``[[x_low, y_low], [x_high, y_high]]`` of marks over poses (n_t, frames, 4)."""
    some = poses[:: max(1, len(poses) // 60)]
    every = [placed(points, some[:, mark.frame]).reshape(-1, 2) for mark in marks for points in mark.loops]
    lows, highs = ([f(points, axis=0) for points in every if len(points)] for f in (np.min, np.max))
    return np.array([np.min(lows, axis=0), np.max(highs, axis=0)])
