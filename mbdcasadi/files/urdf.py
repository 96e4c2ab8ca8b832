"""Planar mechanisms from the robot descriptions of ROS (``.urdf``)."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..model.joints.constraints import Constraint
from ..model.mechanism import Mechanism
from ..model.quantities import triple
from ..model.symbols import Input
from .markup import XmlElement, read_xml
from .planar import PARALLEL, PlanarBuilder
from .robots import (
    Law,
    Link,
    Mass,
    Robot,
    SpatialJoint,
    actuator_law,
    rotation_of_rpy,
    rotation_to_z,
    symmetric,
    unit_vector,
)
from .urdf_format import KNOWN_PARTS, left_out

#: Kinds of joints of the format, and the kinds that represent them.
_KINDS = {"revolute": "hinge", "continuous": "hinge", "prismatic": "slide"}
#: Name of the ground, which Drake takes for granted.
_GROUND = "world"


def read_urdf(path: str | Path, *, gravity: Sequence[float] = (0.0, 0.0, -9.81)) -> Mechanism:
    """Read a robot whose motion is planar.

    The outermost link is the ground, also a link ``world`` that the file does not describe; links that are fixed to
    others become one body with them. All hinges must be parallel, and slides lie across them. A ``planar`` joint
    ``base`` is the slides ``base/x`` and ``base/y`` and the hinge ``base/theta``, along the x and y axes of its
    frame, after the shortest turn that brings the z axis to the axis of the joint, and about that; of a ``floating``
    joint those of the three axes of its frame that lie in the plane of the hinges, and the turn about the third. The
    plane is seen so that gravity points down and the axes of the world to the right; the pose of the file,
    with all joints at zero, has ``phi = 0`` for all bodies. The coordinate of each joint has the sense and the zero of
    the file: ``mechanism.joint(name).angle`` of a hinge, ``.displacement`` of a slide. An actuated joint of a
    ``transmission`` gets an :class:`Input` of its name, with the effort as its limit, and
    ``mimic`` becomes a constraint.

    Parameters
    ----------
    path : str or Path
        The file.
    gravity : sequence of float, default (0, 0, -9.81)
        In the frame of the outermost link, m/s².

    Returns
    -------
    Mechanism
        Bodies by the names of the links, joints by theirs. Loops, which the format does
        not know, are closed with ``mechanism.replace(joints=[*mechanism.joints, mbd.Revolute(…)])``.

    Raises
    ------
    FileError
        For an element that is not planar or not known, with its line.
    ModelError
        For a gravity that is not three numbers.

    Warns
    -----
    MechanismWarning
        For what is left out: limits and dry friction of joints, motions out of the plane, elements and attributes
        that are not known.
    """
    root = read_xml(path, "robot")
    direction = triple(gravity, "read_urdf", "gravity", "(gx, gy, gz)")
    robot = Robot(root, root.get("name", Path(path).stem), direction)
    _read_others(robot, root)
    links = {}
    for element in root.all("link"):
        name = element.get("name")
        if name in links:
            raise element.refuse("has the name of another link")
        links[name] = element
    joints = list(root.all("joint"))
    children = {_reference(joint, "child"): joint for joint in joints}
    for joint in joints:
        for end in ("parent", "child"):
            if end == "parent" and _reference(joint, end) == _GROUND:
                links.setdefault(_GROUND, root)
            if _reference(joint, end) not in links:
                raise joint.refuse(f"names the link '{_reference(joint, end)}', which does not exist")
        if children[_reference(joint, "child")] is not joint:
            raise joint.refuse(f"moves the link '{_reference(joint, 'child')}', which another joint moves already")
    tops = [name for name in links if name not in children]
    if len(tops) != 1:
        raise root.refuse(f"has {len(tops)} outermost links ({', '.join(tops[:3])}); there must be one")
    world = Link(links[tops[0]], tops[0], None, np.eye(3), np.zeros(3))
    robot.links.append(world)
    _add_children(robot, world, links, joints)
    _lay_into_plane(robot)
    if len(robot.links) < len(links):
        lost = next(element for name, element in links.items() if name not in {link.name for link in robot.links})
        raise lost.refuse("belongs to a ring of joints without an outermost link")
    _read_mimics(robot, joints)
    _read_transmissions(robot, root, joints)
    return PlanarBuilder(robot).mechanism()


def _read_others(robot: Robot, root: XmlElement) -> None:
    """Refuse elements that may hold a part of the robot, and take note of others that are not read."""
    for element in root.children:
        if element.tag.startswith("xacro:"):
            raise element.refuse("is a macro; expand the file with xacro first")
        if element.tag not in KNOWN_PARTS:
            raise element.refuse("is not known")
    if any(any(link.all("collision")) for link in root.all("link")):
        robot.left_out.append("the contacts of collision elements (Contact has them)")
    robot.left_out += left_out(root)
    for control in root.all("ros2_control"):
        driven = [joint.get("name", "") for joint in control.all("joint") if any(joint.all("command_interface"))]
        if driven:
            robot.left_out.append(
                f"the inputs of ros2_control for {', '.join(driven)} (a transmission gives a joint an input)"
            )


def _reference(joint: XmlElement, end: str) -> str:
    element = joint.one(end)
    if element is None:
        raise joint.refuse(f"has no {end}")
    return element.get("link")


def _origin(element: XmlElement) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and position of an ``origin``."""
    origin = element.one("origin")
    if origin is None:
        return np.eye(3), np.zeros(3)
    return rotation_of_rpy(origin.numbers("rpy", "0 0 0", (3,))), origin.numbers("xyz", "0 0 0", (3,))


def _add_children(robot: Robot, parent: Link, links: dict[str, XmlElement], joints: Sequence[XmlElement]) -> None:
    below: dict[str, list[XmlElement]] = {}
    for joint in joints:
        below.setdefault(_reference(joint, "parent"), []).append(joint)
    waiting = deque([parent])
    while waiting:
        above = waiting.popleft()
        for joint in below.get(above.name, []):
            rotation, position = _origin(joint)
            name = _reference(joint, "child")
            link = Link(
                links[name], name, above, above.rotation @ rotation, above.position + above.rotation @ position,
                _masses(links[name]), _joints(joint, robot),
            )  # fmt: skip
            robot.links.append(link)
            waiting.append(link)


def _masses(link: XmlElement) -> list[Mass]:
    inertial = link.one("inertial")
    if inertial is None:
        return []
    mass, inertia = inertial.one("mass"), inertial.one("inertia")
    if mass is None or inertia is None:
        raise inertial.refuse(f"of link '{link.get('name')}' must give mass and inertia")
    rotation, center = _origin(inertial)
    tensor = symmetric(*(inertia.number(f"i{axes}", "0") for axes in ("xx", "yy", "zz", "xy", "xz", "yz")))
    return [Mass(mass.number("value", least=0.0), center, rotation @ tensor @ rotation.T)]


def _joints(joint: XmlElement, robot: Robot) -> list[SpatialJoint]:
    kind = joint.get("type")
    name = joint.get("name")
    if kind == "fixed":
        return []
    if kind not in (*_KINDS, "planar", "floating"):
        raise joint.refuse(
            f"is of the type '{kind}'; planar are revolute, continuous and prismatic joints, fixed ones, and those of "
            "the types 'planar' and 'floating' whose plane is that of the others"
        )
    axis_element = joint.one("axis")
    axis = np.array([1.0, 0.0, 0.0]) if axis_element is None else axis_element.numbers("xyz", None, (3,))
    dynamics, limit = joint.one("dynamics"), joint.one("limit")
    damping = 0.0 if dynamics is None else dynamics.number("damping", "0", least=0.0)
    if dynamics is not None and dynamics.number("friction", "0") != 0:
        robot.left_out.append(f"the dry friction of joint '{name}' (JointFriction and LoadIndependentFriction have it)")
    if limit is not None and kind != "continuous" and (limit.has("lower") or limit.has("upper")):
        robot.left_out.append(f"the limits of joint '{name}' (EndStop holds them)")
    axis = unit_vector(joint, "axis", axis)
    parts = {name: (_KINDS.get(kind, ""), axis)}
    if kind == "planar":
        x, y, z = rotation_to_z(axis).T
        parts = {f"{name}/x": ("slide", x), f"{name}/y": ("slide", y), f"{name}/theta": ("hinge", z)}
    elif kind == "floating":
        parts = {f"{name}/{letter}": ("slide", row) for letter, row in zip("xyz", np.eye(3), strict=True)}
    return [
        SpatialJoint(joint, part, shape, along, np.zeros(3), damping=damping) for part, (shape, along) in parts.items()
    ]


def _lay_into_plane(robot: Robot) -> None:
    """Make joints by which links float planar: two slides of the three, and a hinge about the other axis.

    The axis is that of the frame along which the hinges of the robot point.
    """
    hinges = [link.rotation @ joint.axis for link in robot.links for joint in link.joints if joint.kind == "hinge"]
    for link in robot.links:
        if len(link.joints) != 3 or any(joint.kind != "slide" for joint in link.joints):
            continue
        source, name = link.joints[0].source, link.joints[0].source.get("name")
        across = np.abs(link.rotation.T @ hinges[0]) if hinges else np.zeros(3)
        if np.max(across) < np.cos(PARALLEL):
            raise source.refuse("floats, and no hinge of the robot points along an axis of its frame: it has no plane")
        axis = np.eye(3)[np.argmax(across)]
        kept = [joint for joint in link.joints if abs(joint.axis @ axis) < 0.5]
        link.joints = [*kept, SpatialJoint(source, f"{name}/theta", "hinge", axis, np.zeros(3))]
        robot.left_out.append(f"the motion of joint '{name}' out of the plane")


def _read_mimics(robot: Robot, joints: Sequence[XmlElement]) -> None:
    for joint in joints:
        mimic = joint.one("mimic")
        if mimic is None:
            continue
        other, name = mimic.get("joint"), joint.get("name")
        robot.joint(name, mimic)
        robot.joint(other, mimic)
        ratio, offset = mimic.number("multiplier", "1"), mimic.number("offset", "0")
        robot.constraints.append(((name, other), _mimic(f"{name} mimic", ratio, offset)))


def _mimic(name: str, ratio: float, offset: float) -> Law:
    return lambda both: Constraint(name, both[0].value - ratio * both[1].value - offset)


def _read_transmissions(robot: Robot, root: XmlElement, joints: Sequence[XmlElement]) -> None:
    by_name = {joint.get("name"): joint for joint in joints}
    for transmission in root.all("transmission"):
        for element in transmission.all("joint"):
            name = element.get("name")
            robot.joint(name, element)
            limit = by_name[name].one("limit")
            effort = np.inf if limit is None or not limit.has("effort") else limit.number("effort", least=0.0)
            effort = effort if effort > 0 else np.inf
            drive = Input(name, lower=-effort, upper=effort)
            robot.inputs.append(drive)
            robot.forces.append(((name,), actuator_law(f"{name} actuator", drive)))
