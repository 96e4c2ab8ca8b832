"""From links and the joints between them, as URDF and SDF list them, to the tree of a robot.

The two formats share the words for the laws of a joint (``limit``, ``dynamics``, ``mimic``) and for solids; here they
are read from elements whose values are attributes.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ..model.joints.constraints import Constraint
from ..model.symbols import Input
from .markup import XmlElement
from .planar import Plane
from .robots import (
    Law,
    Link,
    Loop,
    Robot,
    RobotPart,
    Solid,
    SpatialJoint,
    actuator_law,
    rotation_around,
    rotation_to_z,
    symmetric,
    unit_vector,
)

#: Kinds of joints of the formats, and the kinds that represent them.
_KINDS = {"revolute": "hinge", "continuous": "hinge", "prismatic": "slide"}
#: Limits from which on SDF has none.
_UNLIMITED = 1e16
#: Friction of solids that give none.
FRICTION = 1.0


@dataclass(eq=False)
class Connection(RobotPart):
    """Joints by which a link b moves relative to a link a, named by their keys; none if it is fixed."""

    a: str
    b: str
    #: axes and points in the frame of b
    joints: list[SpatialJoint]


def grow(robot: Robot, links: Mapping[str, Link], connections: Iterable[Connection]) -> None:
    """Add links to a robot, parents first; the first one is the ground.

    Connections between links that the tree holds already close loops. Links that nothing connects with the ground
    float, the first one that no joint moves.
    """
    connections = list(connections)
    at: dict[str, list[Connection]] = {}
    for connection in connections:
        for end in (connection.a, connection.b):
            at.setdefault(end, []).append(connection)
    ground, *others = links
    moved = {connection.b for connection in connections}
    reached: set[str] = set()
    used: set[Connection] = set()
    for start in (ground, *sorted(others, key=moved.__contains__)):
        if start in reached:
            continue
        link = links[start]
        if start != ground:
            axes = {
                f"{link.name}/{letter}": link.rotation.T @ axis for letter, axis in zip("xyz", np.eye(3), strict=True)
            }
            link.joints = [SpatialJoint(link.source, name, "slide", axis, np.zeros(3)) for name, axis in axes.items()]
            link.parent = links[ground]
        reached.add(start)
        waiting = deque([start])
        while waiting:
            key = waiting.popleft()
            robot.links.append(links[key])
            for connection in at.get(key, []):
                other = connection.b if connection.a == key else connection.a
                if other not in reached:
                    links[other].parent = links[key]
                    links[other].joints = connection.joints if connection.b == other else _turned(connection, links)
                    reached.add(other)
                    used.add(connection)
                    waiting.append(other)
    for connection in connections:
        if connection not in used:
            a, b = links[connection.a], links[connection.b]
            robot.loops.append(Loop(connection.source, connection.name, a, b, b.position, True, connection.joints))
    _keep_apart(robot, links, connections)
    _lay_into_plane(robot)


def _keep_apart(robot: Robot, links: Mapping[str, Link], connections: Iterable[Connection]) -> None:
    """Note that links which a joint holds together do not touch, nor do those that are fixed to them.

    Links that are fixed to a ground without solids have nothing to do with each other.
    """
    ground = next(iter(links))
    is_hub = any(links[ground].source.all("collision"))
    place = {key: k for k, key in enumerate(links)}
    fixed = [c for c in connections if not c.joints and (is_hub or ground not in (c.a, c.b))]
    pairs = ([place[c.a] for c in fixed], [place[c.b] for c in fixed])
    graph = coo_matrix((np.ones(len(fixed)), pairs), shape=(len(links), len(links)))
    label = dict(zip(links, connected_components(graph, directed=False)[1], strict=True))
    members: dict[int, list[str]] = {}
    for key, link in links.items():
        members.setdefault(label[key], []).append(link.name)
    for c in connections:
        if 0 < len(c.joints) < 3:  # three leave the plane free
            robot.apart |= {frozenset((a, b)) for a in members[label[c.a]] for b in members[label[c.b]]}


def _turned(connection: Connection, links: Mapping[str, Link]) -> list[SpatialJoint]:
    """Joints by which a moves relative to b, with the same coordinates."""
    a, b = links[connection.a], links[connection.b]
    if len(connection.joints) > 1:
        raise connection.source.refuse("leads from the outside to the ground; give its parent and child the other way")
    turn = a.rotation.T @ b.rotation
    shift = a.rotation.T @ (b.position - a.position)
    return [replace(each, axis=-turn @ each.axis, point=shift + turn @ each.point) for each in connection.joints]


def _lay_into_plane(robot: Robot) -> None:
    """Make joints by which links float planar: two slides of the three, and a hinge about the other axis.

    The other axis is that of the three along which the normal of the plane nearly points, turned to it.
    """
    floating = [link for link in robot.links if [joint.kind for joint in link.joints] == 3 * ["slide"]]
    held = [(joint.kind, link.rotation @ joint.axis) for link, joint in robot.joints if link not in floating]
    hinges, slides = ([axis for kind, axis in held if kind == each] for each in ("hinge", "slide"))
    normal = Plane.normal_of(hinges, slides, robot) if floating else np.zeros(3)
    for link in floating:
        source, name = link.joints[0].source, link.joints[0].name.rpartition("/")[0]
        frame = np.column_stack([joint.axis for joint in link.joints])
        along = frame.T @ link.rotation.T @ normal
        k = int(np.argmax(np.abs(along)))
        turned = _turn_between(frame[:, k], np.sign(along[k]) * link.rotation.T @ normal) @ frame
        kept = [replace(joint, axis=turned[:, i]) for i, joint in enumerate(link.joints) if i != k]
        link.joints = [*kept, SpatialJoint(source, f"{name}/theta", "hinge", turned[:, k], np.zeros(3))]
        robot.left_out.append(f"the motion of {source.tag} '{name}' out of the plane")


def _turn_between(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Shortest rotation between two directions (3, 3)."""
    across = np.cross(start, end)
    size = float(np.linalg.norm(across))
    return rotation_around(across / size, float(np.arctan2(size, start @ end))) if size > 0 else np.eye(3)


# --- joints and their laws --------------------------------------------------------------------
def moving_parts(
    robot: Robot, source: XmlElement, name: str, kind: str, axis: np.ndarray, point: np.ndarray, laws: XmlElement
) -> list[SpatialJoint]:
    """Hinges and slides of a joint of a kind; `laws` is the element with its limit and dynamics."""
    if kind == "fixed":
        return []
    axis = axis if kind == "floating" else unit_vector(source, "axis", axis)
    parts = {name: (_KINDS.get(kind, ""), axis)}
    if kind == "planar":
        x, y, z = rotation_to_z(axis).T
        parts = {f"{name}/x": ("slide", x), f"{name}/y": ("slide", y), f"{name}/theta": ("hinge", z)}
    elif kind == "floating":
        parts = {f"{name}/{letter}": ("slide", row) for letter, row in zip("xyz", np.eye(3), strict=True)}
    elif kind not in _KINDS:
        raise source.refuse(
            f"is of the type '{kind}'; planar are revolute, continuous and prismatic joints, fixed ones, and those of "
            "the types 'planar' and 'floating' whose plane is that of the others"
        )
    dynamics, limit = (laws.one(tag) or XmlElement(laws.file, tag, laws.line, {}) for tag in ("dynamics", "limit"))
    damping = dynamics.numbers("damping", "0", tuple({1, len(parts)}))
    if np.any(damping < 0):
        raise dynamics.refuse(f"has damping = '{dynamics.get('damping')}', which must not be negative")
    rest = dynamics.number("spring_reference", "0")
    return [
        SpatialJoint(
            source, part, shape, along, point,
            damping=float(damp), stiffness=dynamics.number("spring_stiffness", "0", least=0.0), rest=rest,
            limits=_limits(robot, name, limit) if kind in ("revolute", "prismatic") else None,
            dry_friction=dynamics.number("friction", "0", least=0.0),
        )
        for (part, (shape, along)), damp in zip(parts.items(), np.broadcast_to(damping, len(parts)), strict=True)
    ]  # fmt: skip


def _bound(element: XmlElement, name: str, default: float) -> float:
    """A limit, which may be infinite."""
    if not element.has(name) or element.get(name).strip().lower() in ("inf", "+inf", "-inf"):
        return float(element.get(name, str(default)))
    value = element.number(name)
    return value if abs(value) < _UNLIMITED else float(np.copysign(np.inf, value))


def _limits(robot: Robot, name: str, limit: XmlElement) -> tuple[float, float] | None:
    """Limits of a coordinate; a side that is not given is free."""
    lower, upper = _bound(limit, "lower", -np.inf), _bound(limit, "upper", np.inf)
    if lower < upper:
        return None if np.isinf(lower) and np.isinf(upper) else (lower, upper)
    robot.left_out.append(
        f"the limits of joint '{name}', of which the lower one ({lower:g}) is not below the upper one"
    )
    return None


def has_effort(limit: XmlElement | None) -> bool:
    """Return True if the limit of a joint gives an effort that is not zero, a negative one for any."""
    return limit is not None and limit.has("effort") and _bound(limit, "effort", 0.0) != 0


def actuate(robot: Robot, name: str, limit: XmlElement | None) -> None:
    """Add an input of the name of a joint, the effort along its coordinate; effort zero and negative ones: any."""
    if any(drive.label == name for drive in robot.inputs):
        return
    effort = np.inf if limit is None else _bound(limit, "effort", np.inf)
    effort = effort if effort > 0 else np.inf
    drive = Input(name, lower=-effort, upper=effort)
    robot.inputs.append(drive)
    robot.forces.append(((name,), actuator_law(f"{name} actuator", drive)))


def follow(robot: Robot, name: str, other: str, mimic: XmlElement) -> None:
    """Let a joint follow another one."""
    for joint in (name, other):
        robot.joint(joint, mimic)
    ratio, offset = mimic.number("multiplier", "1"), mimic.number("offset", "0")
    law = _mimic(f"{name} mimic", ratio, offset - ratio * mimic.number("reference", "0"))
    robot.constraints.append(((name, other), law))


def _mimic(name: str, ratio: float, offset: float) -> Law:
    return lambda both: Constraint(name, both[0].value - ratio * both[1].value - ca.SX(offset))


# --- masses and solids ------------------------------------------------------------------------
def inertia_of(element: XmlElement, default: str) -> np.ndarray:
    """Tensor of inertia of an element, with what its diagonal is by default."""
    diagonal = [element.number(f"i{axes}", default) for axes in ("xx", "yy", "zz")]
    return symmetric(*diagonal, *(element.number(f"i{axes}", "0") for axes in ("xy", "xz", "yz")))


def add_solids(
    robot: Robot,
    link: Link,
    elements: Iterable[XmlElement],
    place: Callable[[XmlElement], tuple[np.ndarray, np.ndarray]],
    friction: Callable[[XmlElement], float],
    bits: Callable[[XmlElement], int] = lambda _: 1,
) -> None:
    """Add the solids of a link, with their places in it and their friction.

    A solid that is the only one of its link has its name, others their own names after it, or numbers.
    """
    elements = list(elements)
    for number, element in enumerate(elements, 1):
        kind, size, turn = _shape(element)
        name = f"{link.name} {element.get('name', str(number))}" if len(elements) > 1 else link.name
        rotation, center = place(element)
        robot.solids.append(
            Solid(element, name, link, link.name, kind, size, rotation @ turn, center, friction(element),
                  kinds=bits(element), partners=bits(element))
        )  # fmt: skip


def _shape(collision: XmlElement) -> tuple[str, np.ndarray, np.ndarray]:
    """Kind of the solid of an element, its half widths and its rotation."""
    geometry = collision.one("geometry")
    shape = next(geometry.all(), None) if geometry is not None else None
    if shape is None:
        return "nothing", np.zeros(0), np.eye(3)
    kind = shape.tag.removeprefix("drake:")
    size, turn = np.zeros(0), np.eye(3)
    if kind == "box":
        size = shape.numbers("size", None, (3,)) / 2
    elif kind == "sphere":
        size = shape.numbers("radius", None, (1,))
    elif kind in ("cylinder", "capsule"):
        size = np.array([shape.number("radius"), shape.number("length") / 2])
    elif kind == "plane":
        normal = shape.numbers("normal", "0 0 1", (3,))
        turn = rotation_to_z(normal / np.linalg.norm(normal))
    if np.any(size < 0):
        raise shape.refuse("has a negative size")
    return (kind if np.all(size > 0) else f"{kind} of no size"), size, turn
