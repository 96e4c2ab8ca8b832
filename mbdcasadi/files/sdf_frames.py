"""Frames and joints of SDF, in models inside each other; URDF gives such joints under ``gazebo``.

A name is made full by the models around it, ``model::link``; the world has the name ``""``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .markup import XmlElement
from .robot_tree import Connection, moving_parts
from .robots import Robot, rotation_around, rotation_of_rpy, unit_vector

#: Name of the ground in joints and poses.
WORLD = "world"
#: Name of the frame of a model inside it.
_MODEL = "__model__"


def flatten(root: XmlElement) -> None:
    """Make attributes of elements that only hold text; those with attributes of their own, or of one kind, stay too."""
    waiting = [root]
    while waiting:
        element = waiting.pop()
        tags = [child.tag for child in element.children]
        kept = []
        for child in element.children:
            text = "" if child.children else child.text.strip()
            child.attributes = {name: value for name, value in child.attributes.items() if value}
            if text:
                element.attributes.setdefault(child.tag, text)
            if not text or child.attributes or tags.count(child.tag) > 1:
                kept.append(child)
        element.children = kept
        waiting += kept


def is_true(element: XmlElement, name: str, default: str = "false") -> bool:
    """Return a value that is true or false."""
    return element.get(name, default).strip().lower() in ("true", "1")


def pose_of(element: XmlElement) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and position of the ``pose`` of an element in the frame that it is relative to."""
    pose = _inner(element, "pose")
    if pose is None:
        return np.eye(3), np.zeros(3)
    if pose.word("rotation_format", "euler_rpy", "quat_xyzw") == "euler_rpy":
        values = pose.numbers("pose", None, (6,))
        turns = np.radians(values[3:]) if pose.word("degrees", "false", "true") == "true" else values[3:]
        return rotation_of_rpy(turns), values[:3]
    values = pose.numbers("pose", None, (7,))
    x, y, z, w = unit_vector(pose, "quaternion", values[3:])
    vector, size = np.array([x, y, z]), float(np.linalg.norm([x, y, z]))
    turn = rotation_around(vector / size, 2 * float(np.arctan2(size, w))) if size > 0 else np.eye(3)
    return turn, values[:3]


def _inner(element: XmlElement, tag: str) -> XmlElement | None:
    """A value of an element with its own attributes, by its tag."""
    child = element.one(tag)
    if child is not None and child.text.strip():
        return child.with_defaults({tag: child.text.strip()})
    return element if child is None and element.has(tag) else None


def reference_of(element: XmlElement, tag: str, attribute: str) -> str:
    """Name in an attribute of a value of an element; empty without one."""
    inner = element.one(tag)
    return "" if inner is None else inner.get(attribute, "")


@dataclass(eq=False)
class Frame:
    """A frame that has a name: of a model, a link, a joint or itself."""

    source: XmlElement
    #: full name of the frame in which its pose is given
    base: str
    rotation: np.ndarray
    position: np.ndarray
    #: full name of the frame with which it moves; its own, if it is a link
    moves_with: str
    #: full name of the frame inside a model that has the pose, instead of that of the model
    placed: str = ""


class Frames:
    """Frames by their full names."""

    def __init__(self) -> None:
        self._table: dict[str, Frame] = {}

    def add(self, name: str, frame: Frame) -> None:
        """Add a frame; one whose name is there already is refused."""
        if name in self._table:
            raise frame.source.refuse(f"has the name of another frame, '{name}'")
        self._table[name] = frame

    def joint(self, name: str, scope: str) -> str:
        """Full name of the frame of a joint that is named inside a model, other than that of a link."""
        name = self.full(name, scope)
        is_link = name in self._table and self._table[name].moves_with == name
        return f"{name} (joint)" if is_link else name

    @staticmethod
    def full(name: str, scope: str) -> str:
        """Full name of a frame that is named inside a model."""
        if name in (WORLD, _MODEL):
            return scope if name == _MODEL else ""
        name = name.removesuffix(f"::{_MODEL}")
        return f"{scope}::{name}" if scope else name

    def _frame(self, name: str, source: XmlElement) -> Frame:
        if name not in self._table:
            raise source.refuse(f"names '{name}', which does not exist")
        return self._table[name]

    def pose(self, name: str, source: XmlElement, within: str = "") -> tuple[np.ndarray, np.ndarray]:
        """Rotation and position of a frame in the world, or in a frame around it."""
        rotation, position = np.eye(3), np.zeros(3)
        passed = set[str]()
        while name != within and name:
            frame = self._frame(name, source)
            if name in passed:
                raise frame.source.refuse("has a pose relative to itself, by other frames")
            passed.add(name)
            turn, place = frame.rotation, frame.position
            if frame.placed:
                inner, shift = self.pose(frame.placed, frame.source, name)
                turn = turn @ inner.T
                place = place - turn @ shift
            rotation, position = turn @ rotation, place + turn @ position
            name = frame.base
        return rotation, position

    def link(self, name: str, source: XmlElement) -> str:
        """Full name of the link with which a frame moves, empty for the world."""
        passed = set[str]()
        while name:
            frame = self._frame(name, source)
            if frame.moves_with == name:
                break
            if name in passed:
                raise frame.source.refuse("is attached to itself, by other frames")
            passed.add(name)
            name = frame.moves_with
        return name


def add_joint_frame(frames: Frames, joint: XmlElement, scope: str) -> str:
    """Add the frame of a joint, which is that of its child unless it says otherwise, and return its full name.

    A joint may have the name of a link; its frame then has none in the file.
    """
    prefix = "drake:" if joint.tag.startswith("drake:") else ""
    child = Frames.full(joint.get(f"{prefix}child").strip(), scope)
    relative = reference_of(joint, "pose", "relative_to")
    base = Frames.full(relative, scope) if relative else child
    name = frames.joint(joint.get("name"), scope)
    frames.add(name, Frame(joint, base, *pose_of(joint), child))
    return name


def connection(
    robot: Robot, frames: Frames, joint: XmlElement, scope: str, here: str, name: str, is_along_model: bool = False
) -> Connection:
    """Return what a joint connects, between full names of links; `here` is that of its frame.

    Axes are given in the frame of the joint, or in one that is named, or in that of the model, if the file is old
    (`is_along_model`) or says so.
    """
    drake = joint.tag.startswith("drake:")
    ends = [Frames.full(joint.get(f"drake:{end}" if drake else end).strip(), scope) for end in ("parent", "child")]
    parent, child = (frames.link(end, joint) for end in ends)
    kind = joint.get("type")
    turn, place = frames.pose(child, joint)
    rotation, position = frames.pose(here, joint)
    laws = joint.one("axis") or XmlElement(joint.file, "axis", joint.line, {})
    axis, point = np.array([0.0, 0.0, 1.0]), turn.T @ (position - place)
    if kind in ("revolute", "prismatic") and _is_locked(laws.one("limit")):
        kind = "fixed"
    if kind not in ("fixed", "planar", "floating"):
        given = reference_of(laws, "xyz", "expressed_in")
        along_model = is_along_model or is_true(laws, "use_parent_model_frame")
        frame = Frames.full(given, scope) if given else scope if along_model else here
        axis = frames.pose(frame, joint)[0] @ laws.numbers("xyz", "0 0 1", (3,))
    elif kind == "planar":
        damping = {"damping": joint.get("drake:damping", "0")}
        laws = XmlElement(joint.file, "axis", joint.line, {}, [XmlElement(joint.file, "dynamics", joint.line, damping)])
        axis = rotation @ axis
    if parent == child:
        raise joint.refuse("connects a link with itself")
    return Connection(joint, name, parent, child, moving_parts(robot, joint, name, kind, turn.T @ axis, point, laws))


def _is_locked(limit: XmlElement | None) -> bool:
    """Return True if both limits of a joint are zero, as files have it that know no fixed joints."""
    return limit is not None and all(limit.has(end) and limit.get(end) in ("0", "0.0") for end in ("lower", "upper"))
