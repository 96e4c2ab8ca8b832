"""Robots in space, as their files describe them: links, joints, loops, and laws of forces and couplings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import combinations
from typing import Any, TypeVar

import casadi as ca
import numpy as np

from ..model.bodies import Marker
from ..model.element import Element
from ..model.expressions import fmax, fmin
from ..model.forces.applied import GeneralizedForce
from ..model.forces.stops import EndStop
from ..model.symbols import Input, Scalar
from .markup import XmlElement


@dataclass(eq=False)
class RobotPart:
    """A part of a robot, and the element of the file that describes it."""

    source: XmlElement
    name: str


@dataclass(eq=False)
class Mass:
    """A mass in the frame of its link: kg, centre (3,), inertia about it (3, 3)."""

    mass: float
    center: np.ndarray
    inertia: np.ndarray


def symmetric(xx: float, yy: float, zz: float, xy: float, xz: float, yz: float) -> np.ndarray:
    """Tensor of inertia (3, 3) from its entries."""
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


@dataclass(eq=False)
class SpatialJoint(RobotPart):
    """A hinge or slide with which a link moves relative to its parent."""

    #: "hinge" or "slide"
    kind: str
    #: in the frame of the link (3,)
    axis: np.ndarray
    point: np.ndarray
    #: its coordinate in the pose of the file
    reference: float = 0.0
    damping: float = 0.0
    stiffness: float = 0.0
    #: coordinate at which the spring is free
    rest: float = 0.0
    #: inertia of its rotor: kg m², or kg of a slide
    armature: float = 0.0
    #: limits of its coordinate
    limits: tuple[float, float] | None = None
    #: dry friction, N m, or N of a slide
    dry_friction: float = 0.0


@dataclass(eq=False)
class Link(RobotPart):
    """A body in space, in the pose of the file."""

    #: None for the world
    parent: Link | None
    #: pose of its frame in the world (3, 3), (3,)
    rotation: np.ndarray
    position: np.ndarray
    masses: list[Mass] = field(default_factory=list)
    #: joints by which it moves, the first one next to the parent; none if it is fixed
    joints: list[SpatialJoint] = field(default_factory=list)
    #: share of its weight that something else carries
    carried: float = 0.0


@dataclass(eq=False)
class Solid(RobotPart):
    """A solid of a link that others may touch."""

    link: Link
    #: name of the body of the file
    body: str
    #: "plane", "sphere", "capsule", "cylinder", "box"; others have no outline
    kind: str
    #: half widths, m, as MuJoCo gives them
    size: np.ndarray
    #: pose in the frame of the link (3, 3), (3,)
    rotation: np.ndarray
    center: np.ndarray
    #: coefficient of friction
    friction: float
    #: that of the greater priority holds, else the greater one
    priority: int = 0
    #: bits of what it is, and of what it meets
    kinds: int = 1
    partners: int = 1

    @property
    def place(self) -> np.ndarray:
        """Its centre in the world (3,), m."""
        return self.link.position + self.link.rotation @ self.center

    def meets(self, other: Solid) -> bool:
        """Return True if the bits of the two allow a contact."""
        return bool(self.kinds & other.partners or other.kinds & self.partners)


@dataclass(eq=False)
class Strand:
    """Straight piece of a tendon between two points, each of a link, given in the world in the pose of the file."""

    start: tuple[Link, np.ndarray]
    end: tuple[Link, np.ndarray]
    #: share of its length in that of the tendon
    share: float = 1.0
    #: what it wraps if it meets it, and a point outside of that on the side on which it does (None: the nearer side)
    around: Solid | None = None
    side: tuple[Link, np.ndarray] | None = None


@dataclass(eq=False)
class Tendon(RobotPart):
    """A coordinate that is a sum of those of joints, or a length of strands between points."""

    #: names of joints, and their factors
    parts: list[tuple[str, float]]
    strands: list[Strand]
    damping: float
    stiffness: float
    #: values between which the spring is free; None for that with all joints where their springs are free
    rest: tuple[float, float] | None
    limits: tuple[float, float] | None = None

    @property
    def key(self) -> str:
        """Name among the coordinates, beside joints of the same name."""
        return f"tendon {self.name}"


@dataclass(eq=False)
class Loop(RobotPart):
    """A point (or a pose, if `fixed`) that two links share, given in the world in the pose of the file.

    Instead of a point, joints by which b moves relative to a, as links have them.
    """

    a: Link
    b: Link
    point: np.ndarray
    fixed: bool = False
    joints: list[SpatialJoint] = field(default_factory=list)
    #: the point of b, if that is elsewhere in the pose of the file
    end: np.ndarray | None = None


_SomePart = TypeVar("_SomePart", bound=RobotPart)
#: Actuators and couplings: elements that depend on the coordinates of joints.
Law = Callable[[Sequence["Coordinate"]], Element | None]


@dataclass(frozen=True)
class Coordinate:
    """The coordinate of a joint or tendon and its rate, rad or m, and its value in the pose of the file."""

    value: ca.SX
    rate: ca.SX
    reference: float
    #: points between which a tendon runs
    markers: tuple[Marker, ...] = ()


class CoordinateForce(GeneralizedForce):
    """Force along the coordinate of a joint or tendon: ``δW = force · δvalue``.

    Parameters
    ----------
    name : str
        Its name.
    along : Coordinate
        The coordinate.
    force : float or expression
        N, or N m.
    """

    def __init__(self, name: str, along: Coordinate, force: Scalar):
        super().__init__(name, [(along.value, force)])
        self.markers = along.markers


class CoordinateStop(EndStop):
    """Stop on the coordinate of a joint or tendon.

    Parameters
    ----------
    name : str
        Its name.
    along : Coordinate
        The coordinate.
    gap : casadi.SX
        Distance from the stop, in units of the coordinate.
    law : callable
        That of :class:`EndStop`.
    """

    def __init__(self, name: str, along: Coordinate, gap: Scalar, law: Callable[[ca.SX, ca.SX], Any]):
        super().__init__(name, gap, law)
        self.markers = along.markers


def actuator_law(
    name: str,
    drive: Input,
    gear: float = 1.0,
    gains: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0),
    limits: tuple[float, float] = (-np.inf, np.inf),
) -> Law:
    """Force ``gear f`` along a coordinate, ``f = k u + k_x gear x + k_v gear v + k_0`` within its limits."""

    def law(coordinates: Sequence[Coordinate]) -> CoordinateForce:
        along = coordinates[0]
        force = gains[0] * drive + gear * (gains[1] * along.value + gains[2] * along.rate) + gains[3]
        force = force if limits[0] == -np.inf else fmax(force, limits[0])
        force = force if limits[1] == np.inf else fmin(force, limits[1])
        return CoordinateForce(name, along, gear * force)

    return law


@dataclass(eq=False)
class Robot(RobotPart):
    """Robot that a file describes, in space; its source is the outermost element."""

    #: m/s² (3,)
    gravity: np.ndarray
    #: parents first; the world is the first one
    links: list[Link] = field(default_factory=list)
    loops: list[Loop] = field(default_factory=list)
    tendons: list[Tendon] = field(default_factory=list)
    #: names of joints or keys of tendons, and what makes an element of their coordinates
    forces: list[tuple[tuple[str, ...], Law]] = field(default_factory=list)
    constraints: list[tuple[tuple[str, ...], Law]] = field(default_factory=list)
    inputs: list[Input] = field(default_factory=list)
    #: solids whose contacts are elements, and pairs that touch in any case with their friction (None: by the solids)
    solids: list[Solid] = field(default_factory=list)
    pairs: list[tuple[Solid, Solid, float | None]] = field(default_factory=list)
    #: names of bodies that do not touch each other
    apart: set[frozenset[str]] = field(default_factory=set)
    #: True if a body touches the one that carries it
    neighbours_touch: bool = False
    #: the coefficient of friction of two solids of the same priority, from theirs
    friction_of_two: Callable[[float, float], float] = max
    #: contents of the file that no element represents
    left_out: list[str] = field(default_factory=list)

    @property
    def joints(self) -> list[tuple[Link, SpatialJoint]]:
        """Joints, those that close loops among them, with the links that they move."""
        carried = [(link, joint) for link in self.links for joint in link.joints]
        return carried + [(loop.b, joint) for loop in self.loops for joint in loop.joints]

    def at_rest(self) -> dict[Link, tuple[np.ndarray, np.ndarray]]:
        """Return rotations (3, 3) and places (3,) of the links with all joints where their springs are free."""
        poses = {self.links[0]: (self.links[0].rotation, self.links[0].position)}
        for link in self.links[1:]:
            above = link.parent
            assert above is not None
            turn = poses[above][0] @ above.rotation.T
            rotation, place = turn @ link.rotation, poses[above][1] + turn @ (link.position - above.position)
            for joint in link.joints:
                axis, amount = rotation @ joint.axis, joint.rest - joint.reference
                if joint.kind == "slide":
                    place = place + amount * axis
                    continue
                turn, anchor = rotation_around(axis, amount), place + rotation @ joint.point
                rotation, place = turn @ rotation, anchor + turn @ (place - anchor)
            poses[link] = rotation, place
        return poses

    def inertia(self) -> np.ndarray:
        """Return the inertia in the coordinates of the joints (n, n), in the pose of the file, without loops."""
        joints = [joint for link in self.links for joint in link.joints]
        matrix = np.diag([joint.armature for joint in joints])
        for link in self.links:
            carriers, above = [], link
            while above.parent is not None:
                carriers += [(above, joint) for joint in above.joints]
                above = above.parent
            places = [joints.index(joint) for _, joint in carriers]
            axes = np.array([by.rotation @ joint.axis for by, joint in carriers]).reshape(-1, 3)
            turns = axes * np.array([[joint.kind == "hinge"] for _, joint in carriers]).reshape(-1, 1)
            for part in link.masses if carriers else ():
                center = link.position + link.rotation @ part.center
                arms = center - np.array([by.position + by.rotation @ joint.point for by, joint in carriers])
                moves = np.cross(turns, arms) + axes - turns
                tensor = link.rotation @ part.inertia @ link.rotation.T
                matrix[np.ix_(places, places)] += part.mass * moves @ moves.T + turns @ tensor @ turns.T
        return matrix

    def joint(self, name: str, source: XmlElement) -> SpatialJoint:
        """Return a joint by its name, or raise for the element that names it."""
        return _named([joint for _, joint in self.joints], "joint", name, source)

    def friction(self, a: Solid, b: Solid) -> float:
        """Coefficient of friction of two solids."""
        if a.priority != b.priority:
            return max(a, b, key=lambda solid: solid.priority).friction
        return self.friction_of_two(a.friction, b.friction)

    def leave_out_contacts(self) -> None:
        """Leave out contacts, and the limits and dry friction of joints, and name them."""
        for _, joint in self.joints:
            if joint.limits:
                self.left_out.append(f"the range of joint '{joint.name}' (EndStop holds it)")
            if joint.dry_friction:
                self.left_out.append(f"the dry friction of joint '{joint.name}' (LoadIndependentFriction has it)")
            joint.limits, joint.dry_friction = None, 0.0
        if any(a.meets(b) for a, b in combinations(self.solids, 2)):
            self.left_out.append(f"the contacts of {self.solids[0].source.tag}s (Contact has them)")
        self.left_out += [f"the contact pair of '{a.name}' and '{b.name}'" for a, b, _ in self.pairs]
        self.solids, self.pairs = [], []

    def link(self, name: str, source: XmlElement) -> Link:
        """Return a link by its name, or raise for the element that names it."""
        return _named(self.links, "body", name, source)

    def tendon(self, name: str, source: XmlElement) -> Tendon:
        """Return a tendon by its name, or raise for the element that names it."""
        return _named(self.tendons, "tendon", name, source)

    def solid(self, name: str, source: XmlElement) -> Solid:
        """Return a solid by its name, or raise for the element that names it."""
        return _named(self.solids, "geom", name, source)


def _named(parts: Sequence[_SomePart], kind: str, name: str, source: XmlElement) -> _SomePart:
    for part in parts:
        if part.name == name:
            return part
    raise source.refuse(f"names the {kind} '{name}', which does not exist")


def unit_vector(source: XmlElement, name: str, values: np.ndarray) -> np.ndarray:
    """Values scaled to length one; an error for an element that gives zeros."""
    length = float(np.linalg.norm(values))
    if length == 0:
        raise source.refuse(f"has a zero vector as {name}")
    direction: np.ndarray = values / length
    return direction


def rotation_of_rpy(angles: np.ndarray) -> np.ndarray:
    """Rotation by roll, pitch and yaw about fixed axes (3, 3)."""
    return rotation_about(2, angles[2]) @ rotation_about(1, angles[1]) @ rotation_about(0, angles[0])


def rotation_about(axis: int, angle: float) -> np.ndarray:
    """Rotation about an axis of the frame (3, 3)."""
    c, s = np.cos(angle), np.sin(angle)
    first, second = (axis + 1) % 3, (axis + 2) % 3
    rotation = np.eye(3)
    rotation[first, first] = rotation[second, second] = c
    rotation[second, first], rotation[first, second] = s, -s
    return rotation


def rotation_around(axis: np.ndarray, angle: float) -> np.ndarray:
    """Rotation about a unit vector (3, 3), by Rodrigues' formula."""
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    rotation: np.ndarray = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    return rotation


def rotation_to_z(z: np.ndarray) -> np.ndarray:
    """Rotation that brings the z axis into a direction (3, 3), on the shortest way."""
    axis = np.cross([0.0, 0.0, 1.0], z)
    size = float(np.linalg.norm(axis))
    if size < 1e-12:
        return np.eye(3) if z[2] > 0 else np.diag([1.0, -1.0, -1.0])
    return rotation_around(axis / size, float(np.arctan2(size, z[2])))
