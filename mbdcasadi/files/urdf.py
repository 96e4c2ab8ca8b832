"""Planar mechanisms from the robot descriptions of ROS (``.urdf``)."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from ..model.mechanism import Mechanism
from ..model.quantities import triple
from .drake import CONNECTIONS, connect_points
from .markup import XmlElement, read_xml, unread
from .planar import PlanarBuilder
from .robot_tree import (
    FRICTION,
    Connection,
    actuate,
    add_solids,
    follow,
    grow,
    inertia_of,
    moving_parts,
)
from .robots import Link, Mass, Robot, rotation_of_rpy
from .sdf_frames import WORLD, Frame, Frames, add_joint_frame, connection, flatten
from .urdf_format import KNOWN_PARTS, TABLE


def read_urdf(path: str | Path, *, gravity: Sequence[float] = (0.0, 0.0, -9.81), contacts: bool = True) -> Mechanism:
    """Read a robot whose motion is planar.

    The outermost link is the ground, also a link ``world`` that the file does not describe; links that are fixed to
    others become one body with them. All hinges must be parallel, and slides lie across them. A ``planar`` joint
    ``base`` is the slides ``base/x`` and ``base/y`` and the hinge ``base/theta``, along the x and y axes of its
    frame, after the shortest turn that brings the z axis to the axis of the joint, and about that; of a ``floating``
    joint those of the three axes of its frame that lie in the plane of the hinges (without any: of gravity and the x
    axis), and the turn about the third. The
    plane is seen so that gravity points down and the axes of the world to the right; the pose of the file,
    with all joints at zero, has ``phi = 0`` for all bodies. The coordinate of each joint has the sense and the zero of
    the file: ``mechanism.joint(name).angle`` of a hinge, ``.displacement`` of a slide. A joint of a ``transmission``,
    or with a ``command_interface`` of ``ros2_control``, gets an :class:`Input` of its name, the effort along its
    coordinate, within the ``effort`` of its limit; ``mimic`` becomes a constraint. Joints of SDF under ``gazebo``
    close loops (:func:`read_sdf`). Of Drake's dialect ``drake:joint``, ``drake:rotor_inertia`` with
    ``drake:gear_ratio``, dampers of planar joints, ``drake:capsule``, ``drake:mu_dynamic``, filters of collisions,
    ``drake:linear_spring_damper``, ``drake:distance_constraint`` and ``drake:ball_constraint`` are read.

    Collisions (spheres, capsules, cylinders and boxes that lie along the plane or across it) that may touch are a
    :class:`Contact` ``one on other``, by the names of their links; links that a joint holds together do not touch, nor
    do those that are fixed to them. The limits of a joint are :class:`EndStop` elements, ``joint lower stop`` and
    ``joint upper stop``, its dry friction is a :class:`LoadIndependentFriction` ``joint friction``. Their laws are
    those of :func:`read_mjcf`. Of two coefficients of friction (``mu1`` of Gazebo, ``lateral_friction`` of Bullet; 1
    if none is given) the smaller one holds. Limits of speeds belong to drives and change no motion; give them in
    ``path=`` of :func:`optimize`.

    Parameters
    ----------
    path : str or Path
        The file.
    gravity : sequence of float, default (0, 0, -9.81)
        In the frame of the outermost link, m/s².
    contacts : bool, default True
        False leaves out contacts, limits and dry friction of joints, with a warning: equations without jumps.

    Returns
    -------
    Mechanism
        Bodies by the names of the links, joints by theirs. Loops, which the format itself does
        not know, are also closed with ``mechanism.replace(joints=[*mechanism.joints, mbd.Revolute(…)])``.

    Raises
    ------
    FileError
        For an element that is not planar or not known, with its line.
    ModelError
        For a gravity that is not three numbers.

    Warns
    -----
    MechanismWarning
        For what is left out: motions out of the plane, contacts of solids whose outline in the plane is not known,
        elements and attributes that are not known.
    """
    root = read_xml(path, "robot")
    robot = Robot(root, root.get("name", Path(path).stem), triple(gravity, "read_urdf", "gravity", "(gx, gy, gz)"))
    robot.friction_of_two = min
    _read_others(robot, root)
    links = _links(root)
    joints = list(root.all("joint", "drake:joint"))
    _place(root, links, joints)
    connections = [_connection(robot, joint, links[_reference(joint, "child")]) for joint in joints]
    grow(robot, links, connections + _loops(robot, root, links))
    for link in robot.links:
        link.masses = [] if link.parent is None else _masses(link.source)
        collisions = link.source.all("collision") if link.source is not root else ()
        given = _friction(root, link)
        add_solids(robot, link, collisions, _origin, lambda solid, given=given: _own_friction(solid, given))  # type: ignore[misc]
    for element in root.all(*CONNECTIONS):
        connect_points(robot, element, partial(robot.link, source=element))
    robot.apart |= _filtered(root)
    if not contacts:
        robot.leave_out_contacts()
    _read_laws(robot, root, [joint for joint in joints if joint.get("type") != "fixed"])
    return PlanarBuilder(robot).mechanism()


def _read_others(robot: Robot, root: XmlElement) -> None:
    """Refuse elements that may hold a part of the robot, and take note of others that are not read."""
    for element in root.children:
        if element.tag.startswith("xacro:"):
            raise element.refuse("is a macro; expand the file with xacro first")
        if element.tag not in KNOWN_PARTS:
            raise element.refuse("is not known; leave it out, if the motion does not depend on it")
    robot.left_out += unread(root, TABLE)


def _links(root: XmlElement) -> dict[str, Link]:
    """Links by their names, without places, and the ground if only joints name it."""
    links: dict[str, Link] = {}
    for element in root.all("link"):
        name = element.get("name")
        if name in links:
            raise element.refuse("has the name of another link")
        links[name] = Link(element, name, None, np.eye(3), np.zeros(3))
    if any(_reference(joint, "parent") == WORLD for joint in root.all("joint", "drake:joint")):
        links.setdefault(WORLD, Link(root, WORLD, None, np.eye(3), np.zeros(3)))
    return links


def _place(root: XmlElement, links: dict[str, Link], joints: Sequence[XmlElement]) -> None:
    """Give links their places in the pose of the file, and put the outermost one at the head."""
    moved: dict[str, XmlElement] = {}
    below: dict[str, list[XmlElement]] = {}
    for joint in joints:
        parent, child = (_reference(joint, end) for end in ("parent", "child"))
        for name in (parent, child):
            if name not in links:
                raise joint.refuse(f"names the link '{name}', which does not exist")
        if child in moved:
            raise joint.refuse(f"moves the link '{child}', which another joint moves already")
        moved[child] = joint
        below.setdefault(parent, []).append(joint)
    tops = [name for name in links if name not in moved]
    if len(tops) != 1:
        raise root.refuse(f"has {len(tops)} outermost links ({', '.join(tops[:3])}); there must be one")
    waiting, placed = deque(tops), list[str]()
    while waiting:
        placed.append(waiting.popleft())
        above = links[placed[-1]]
        for joint in below.get(above.name, []):
            rotation, position = _origin(joint)
            link = links[_reference(joint, "child")]
            link.rotation, link.position = above.rotation @ rotation, above.position + above.rotation @ position
            waiting.append(link.name)
    lost = [link for name, link in links.items() if name not in placed]
    if lost:
        raise lost[0].source.refuse("belongs to a ring of joints without an outermost link")
    ground = links.pop(tops[0])
    others = dict(links)
    links.clear()
    links |= {ground.name: ground} | others


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


def _masses(link: XmlElement) -> list[Mass]:
    """Mass of a link; one without an inertia is that of a point."""
    inertial = link.one("inertial")
    mass = None if inertial is None else inertial.one("mass")
    if inertial is None or mass is None:
        return []
    inertia = inertial.one("inertia")
    rotation, center = _origin(inertial)
    tensor = np.zeros((3, 3)) if inertia is None else inertia_of(inertia, "0")
    return [Mass(mass.number("value", least=0.0), center, rotation @ tensor @ rotation.T)]


def _connection(robot: Robot, joint: XmlElement, link: Link) -> Connection:
    """A joint; its frame is that of the link that it moves."""
    element = joint.one("axis")
    axis = np.array([1.0, 0.0, 0.0]) if element is None else element.numbers("xyz", None, (3,))
    name = joint.get("name")
    parts = moving_parts(robot, joint, name, joint.get("type"), axis, np.zeros(3), joint)
    return Connection(joint, name, _reference(joint, "parent"), link.name, parts)


def _loops(robot: Robot, root: XmlElement, links: dict[str, Link]) -> list[Connection]:
    """Joints of SDF that Gazebo adds to the robot, which close loops."""
    frames = Frames()
    for name, link in links.items():
        frames.add(name, Frame(link.source, "", link.rotation, link.position, name))
    ground, *_ = links
    found = []
    for joint in (joint for gazebo in root.all("gazebo") for joint in gazebo.all("joint")):
        flatten(joint)
        here = add_joint_frame(frames, joint, "")
        loop = connection(robot, frames, joint, "", here, joint.get("name"))
        found.append(replace(loop, a=loop.a or ground, b=loop.b or ground))
    return found


# --- friction and what does not touch -----------------------------------------------------------
def _friction(root: XmlElement, link: Link) -> float:
    """Coefficient of friction of a link, for Gazebo or for Bullet."""
    for gazebo in root.all("gazebo"):
        if gazebo.get("reference", "") == link.name:
            flatten(gazebo)
            for name in ("mu1", "mu"):
                if gazebo.has(name):
                    return gazebo.number(name, least=0.0)
    contact = link.source.one("contact") if link.source is not root else None
    lateral = None if contact is None else contact.one("lateral_friction")
    return FRICTION if lateral is None else lateral.number("value", least=0.0)


def _own_friction(solid: XmlElement, given: float) -> float:
    """Coefficient of friction of a solid, for Drake, or that of its link."""
    properties = solid.one("drake:proximity_properties")
    sliding = None if properties is None else properties.one("drake:mu_dynamic")
    return given if sliding is None else sliding.number("value", least=0.0)


def _filtered(root: XmlElement) -> set[frozenset[str]]:
    """Pairs of links that Drake's filters keep from touching."""
    groups = {group.get("name"): group for group in root.all("drake:collision_filter_group")}
    members = {name: [e.get("link") for e in group.all("drake:member")] for name, group in groups.items()}
    return {
        frozenset((one, other))
        for name, group in groups.items()
        for ignored in group.all("drake:ignored_collision_filter_group")
        for one in members[name]
        for other in members.get(ignored.get("name"), [])
    }


# --- actuators and couplings --------------------------------------------------------------------
def _read_laws(robot: Robot, root: XmlElement, joints: Sequence[XmlElement]) -> None:
    """Read what drives joints, and joints that follow others; fixed ones have no coordinate."""
    limits = {joint.get("name"): joint.one("limit") for joint in joints}
    for joint in joints:
        mimic = joint.one("mimic")
        if mimic is not None:
            follow(robot, joint.get("name"), mimic.get("joint"), mimic)
    fixed = {joint.get("name") for joint in root.all("joint", "drake:joint")} - set(limits)
    for transmission in root.all("transmission"):
        for element in transmission.all("joint"):
            name = element.get("name")
            if name not in fixed:
                robot.joint(name, element).armature += sum(map(_rotor, transmission.all("actuator")))
                actuate(robot, name, limits[name])
    for control in root.all("ros2_control"):
        for element in control.all("joint"):
            name = element.get("name")
            if name not in fixed and any(element.all("command_interface")):
                robot.joint(name, element)
                actuate(robot, name, limits[name])


def _rotor(actuator: XmlElement) -> float:
    """Inertia of the rotor of an actuator along the coordinate of the joint, as Drake gives it."""
    inertia, ratio = (actuator.one(f"drake:{name}") for name in ("rotor_inertia", "gear_ratio"))
    geared = 1.0 if ratio is None else ratio.number("value")
    return 0.0 if inertia is None else inertia.number("value", least=0.0) * geared**2
