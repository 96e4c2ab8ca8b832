"""Planar mechanisms from the models of Gazebo (``.sdf``)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from itertools import combinations
from pathlib import Path

import numpy as np

from ..model.mechanism import Mechanism
from ..model.quantities import triple
from .drake import connect_points
from .markup import XmlElement
from .planar import PlanarBuilder
from .robot_tree import FRICTION, Connection, actuate, add_solids, follow, grow, has_effort, inertia_of
from .robots import Link, Mass, Robot
from .sdf_frames import Frames, connection, is_true, pose_of, reference_of
from .sdf_models import Models, Scope, read_file

#: Gravity of the format, m/s².
_GRAVITY = "0 0 -9.8"


def read_sdf(path: str | Path, *, gravity: Sequence[float] | None = None, contacts: bool = True) -> Mechanism:
    """Read models whose motion is planar.

    All hinges must be parallel, and slides lie across them. Joints of the types revolute, continuous, prismatic and
    fixed are read, and Drake's ``planar`` ones; joints may close loops, and so may Drake's connections of points (see
    :func:`read_urdf`). One whose limits are both zero is fixed. A model that is not static and that no joint connects
    with the world moves freely in the plane of the hinges (without any: of gravity and the x axis): if its first link
    is ``base``, with the slides ``base/x`` and ``base/z`` along axes of the world, and the hinge ``base/theta``. Models
    may hold models, and ``include`` them from files by their paths; ``model://name`` and ``package://name`` are folders
    beside the file, or beside a folder that holds it. The plane is seen so that gravity points down and the axes of the
    world to the right; the pose of the file has ``phi = 0`` for all bodies. The coordinate of each joint has the sense
    and the zero of the file: ``mechanism.joint(name).angle`` of a hinge, ``.displacement`` of a slide.

    Collisions, limits, dry friction and springs of joints are the elements of :func:`read_urdf`, by the same laws
    (instead of the softness and restitution of the file); links of one model touch if it says ``self_collide``. A
    joint with an ``effort`` that is not zero gets an :class:`Input` of its name within it (a negative one: any), and
    ``mimic`` becomes a constraint.

    Parameters
    ----------
    path : str or Path
        The file.
    gravity : sequence of float, optional
        In the frame of the world, m/s²; that of the file if not given, which is (0, 0, -9.8) if it gives none.
    contacts : bool, default True
        False leaves out contacts, limits and dry friction of joints, with a warning: equations without jumps.

    Returns
    -------
    Mechanism
        Bodies by the names of the links, joints by theirs; names that several models use with that of the model,
        ``model::link``.

    Raises
    ------
    FileError
        For an element that is not planar or not read, with its line.
    ModelError
        For a gravity that is not three numbers.

    Warns
    -----
    MechanismWarning
        For what is left out: motions out of the plane, contacts of solids whose outline in the plane is not known,
        plugins, elements and attributes that are not known.

    References
    ----------
    SDFormat specification, *Pose frame semantics*.
    """
    path = Path(path)
    root = read_file(path)
    holder = root.one("world") or root
    direction = holder.numbers("gravity", _GRAVITY, (3,))
    if gravity is not None:
        direction = triple(gravity, "read_sdf", "gravity", "(gx, gy, gz)")
    named = next(root.all("world", "model"), root)
    robot, models = Robot(root, named.get("name", path.stem), direction), Models(root, path)
    robot.friction_of_two = min
    robot.left_out += models.left_out
    links = _links(root, models)
    grow(robot, links, _connections(robot, models))
    _read_solids(robot, models, links)
    for element, scope in models.points:
        connect_points(robot, element, partial(_link_of, models, links, element, scope))
    if not contacts:
        robot.leave_out_contacts()
    _read_laws(robot, models)
    return PlanarBuilder(robot).mechanism()


def _links(root: XmlElement, models: Models) -> dict[str, Link]:
    """Links by their full names, the world at the head."""
    names = _short(models.links)
    links = {"": Link(root, "world", None, np.eye(3), np.zeros(3))}
    for key, (element, _) in models.links.items():
        carried = 0.0 if is_true(element, "gravity", "true") else 1.0
        pose = models.frames.pose(key, element)
        links[key] = Link(element, names[key], None, *pose, _masses(element), carried=carried)
    return links


def _link_of(models: Models, links: dict[str, Link], element: XmlElement, scope: Scope, name: str) -> Link:
    """Link of a name in a model."""
    return links[models.frames.link(Frames.full(name, scope.name), element)]


def _read_solids(robot: Robot, models: Models, links: dict[str, Link]) -> None:
    """Read the solids of links; those of one model touch if it says so."""
    for key, (element, scope) in models.links.items():
        place = partial(_place, models.frames, links[key], scope)
        add_solids(robot, links[key], element.all("collision"), place, _friction, _bits)
    for (a, (one, first)), (b, (other, second)) in combinations(models.links.items(), 2):
        both = _collides(one, first) and _collides(other, second)
        if a.split("::")[0] == b.split("::")[0] and not both:
            robot.apart.add(frozenset((links[a].name, links[b].name)))


def _place(frames: Frames, link: Link, scope: Scope, collision: XmlElement) -> tuple[np.ndarray, np.ndarray]:
    """Rotation and position of a solid in its link."""
    rotation, position = pose_of(collision)
    base = reference_of(collision, "pose", "relative_to")
    if not base:
        return rotation, position
    turn, place = frames.pose(Frames.full(base, scope.name), collision)
    return link.rotation.T @ turn @ rotation, link.rotation.T @ (place + turn @ position - link.position)


def _connections(robot: Robot, models: Models) -> list[Connection]:
    """Joints between links; links of static models are fixed to the world."""
    static = [key for key, (_, scope) in models.links.items() if scope.is_static]
    found = [Connection(models.links[key][0], key, "", key, []) for key in static]
    names = _short(models.joints)
    for key, (joint, scope) in models.joints.items():
        each = connection(robot, models.frames, joint, scope.name, key, names[key], scope.has_axes)
        for end in (each.a, each.b):
            if end and end not in models.links:
                raise joint.refuse(f"names '{end}', which is no link and holds none")
        if not {each.a, each.b} <= {"", *static}:
            found.append(each)
    return found


def _read_laws(robot: Robot, models: Models) -> None:
    """Read what drives joints, and joints that follow others."""
    there = {joint.name for _, joint in robot.joints}
    names = _short(models.joints)
    for key, (joint, scope) in models.joints.items():
        axis = joint.one("axis") or joint
        if names[key] not in there:
            continue
        mimic = axis.one("mimic") or joint.one("drake:mimic")
        if mimic is not None:
            other = models.frames.joint(mimic.get("joint"), scope.name)
            follow(robot, names[key], names.get(other, other), mimic)
        if has_effort(axis.one("limit")):
            actuate(robot, names[key], axis.one("limit"))


def _short(parts: dict[str, tuple[XmlElement, Scope]]) -> dict[str, str]:
    """Names without those of models, as far as they tell parts apart."""
    last = [element.get("name") for element, _ in parts.values()]
    return {key: name if last.count(name) == 1 else key for key, name in zip(parts, last, strict=True)}


def _collides(link: XmlElement, scope: Scope) -> bool:
    return is_true(link, "self_collide", str(scope.collides))


def _masses(link: XmlElement) -> list[Mass]:
    """Mass of a link; what is not given is one, as the format says."""
    inertial = link.one("inertial") or XmlElement(link.file, "inertial", link.line, {})
    if is_true(inertial, "auto"):
        raise inertial.refuse("is to be computed from the collisions (auto); give mass and inertia")
    rotation, center = pose_of(inertial)
    inertia = inertial.one("inertia") or inertial
    return [Mass(inertial.number("mass", "1", least=0.0), center, rotation @ inertia_of(inertia, "1") @ rotation.T)]


def _inside(element: XmlElement, *tags: str) -> XmlElement | None:
    """First element on a path."""
    found: XmlElement | None = element
    for tag in tags:
        found = None if found is None else next(found.all(tag), None)
    return found


def _friction(collision: XmlElement) -> float:
    """Coefficient of friction of a solid, of Drake or of Gazebo."""
    for path, name in (
        (("drake:proximity_properties",), "drake:mu_dynamic"),
        (("surface", "friction", "ode"), "mu"),
    ):
        properties = _inside(collision, *path)
        if properties is not None and properties.has(name):
            return properties.number(name, least=0.0)
    return FRICTION


def _bits(collision: XmlElement) -> int:
    """What a solid is and meets, by default all."""
    contact = _inside(collision, "surface", "contact")
    text = "65535" if contact is None else contact.get("collide_bitmask", "65535")
    try:
        return int(text, 0)
    except ValueError:
        raise collision.refuse(f"has collide_bitmask = '{text}', which is not a whole number") from None
