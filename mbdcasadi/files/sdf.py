"""Planar mechanisms from the models of Gazebo (``.sdf``)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from pathlib import Path

import numpy as np

from ..model.mechanism import Mechanism
from ..model.quantities import triple
from .drake import CONNECTIONS, connect_points
from .markup import XmlElement, read_xml, unread
from .planar import PlanarBuilder
from .robot_tree import FRICTION, Connection, actuate, add_solids, follow, grow, has_effort, inertia_of
from .robots import Link, Mass, Robot
from .sdf_format import BESIDES, TABLE
from .sdf_frames import Frame, Frames, add_joint_frame, connection, flatten, pose_of, reference_of

#: Gravity of the format, m/s².
_GRAVITY = "0 0 -9.8"
#: Version before which axes are given in the frame of the model.
_AXES_OF_JOINTS = 1.5


def read_sdf(path: str | Path, *, gravity: Sequence[float] | None = None, contacts: bool = True) -> Mechanism:
    """Read models whose motion is planar.

    All hinges must be parallel, and slides lie across them. Joints of the types revolute, continuous, prismatic and
    fixed are read, and Drake's ``planar`` ones; joints may close loops, and so may Drake's connections of points (see
    :func:`read_urdf`). One whose limits are both zero is fixed. A model that is not static and that no joint
    connects with the world moves freely in the plane of the hinges: if its first link is ``base``, with the slides
    ``base/x`` and ``base/z`` along axes of the world, and the hinge ``base/theta``. Models may hold models, and
    ``include`` them from files by their paths; ``model://name`` and ``package://name`` are folders beside the file,
    or beside a folder that holds it. The plane is seen so that gravity points down and the axes of the world to the
    right; the pose of the file has ``phi = 0`` for all bodies. The coordinate of each joint has the sense and the zero
    of the file: ``mechanism.joint(name).angle`` of a hinge, ``.displacement`` of a slide.

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
    root = _read(path)
    world = root.one("world")
    holder = world or root
    direction = holder.numbers("gravity", _GRAVITY, (3,))
    if gravity is not None:
        direction = triple(gravity, "read_sdf", "gravity", "(gx, gy, gz)")
    model = next(holder.all("model"), holder)
    robot = Robot(root, (world or model).get("name", path.stem), direction)
    robot.friction_of_two = min
    _Reader(robot).read(holder, path.parent, contacts)
    return PlanarBuilder(robot).mechanism()


def _read(path: Path) -> XmlElement:
    root = read_xml(path, "sdf")
    flatten(root)
    return root


def _is(element: XmlElement, name: str, default: str = "false") -> bool:
    """A value that is true or false."""
    return element.get(name, default).strip().lower() in ("true", "1")


def _version(root: XmlElement) -> float:
    return root.number("version", "1.7") if root.get("version", "").count(".") < 2 else _AXES_OF_JOINTS


@dataclass(eq=False)
class _Scope:
    """A model, or the world, with its full name."""

    element: XmlElement
    name: str
    #: folder of its file
    folder: Path
    #: True if axes are given in its frame
    has_axes: bool
    is_static: bool
    collides: bool


class _Reader:
    """Worlds and models with what they hold."""

    def __init__(self, robot: Robot):
        self.robot, self.frames = robot, Frames()
        self.links: dict[str, tuple[XmlElement, _Scope]] = {}
        self.joints: dict[str, tuple[XmlElement, _Scope]] = {}
        #: what Drake puts between points
        self.points: list[tuple[XmlElement, _Scope]] = []

    def read(self, holder: XmlElement, folder: Path, contacts: bool) -> None:
        """Read all of a file."""
        robot, root = self.robot, self.robot.source
        robot.left_out += unread(root, TABLE)
        old = _version(root) < _AXES_OF_JOINTS
        waiting = [_Scope(holder, "", folder, old, False, True)]
        while waiting:
            waiting += self._read_scope(waiting.pop(0))
        names = _short(self.links)
        links = {"": Link(root, "world", None, np.eye(3), np.zeros(3))}
        for key, (element, _) in self.links.items():
            links[key] = Link(element, names[key], None, *self.frames.pose(key, element), _masses(element))
            links[key].carried = 0.0 if _is(element, "gravity", "true") else 1.0
        grow(robot, links, self._connections())
        for key, (element, scope) in self.links.items():
            place = partial(self._place, links[key], scope)
            add_solids(robot, links[key], element.all("collision"), place, _friction, _bits)
        for (a, (one, first)), (b, (other, second)) in combinations(self.links.items(), 2):
            both = _collides(one, first) and _collides(other, second)
            if a.split("::")[0] == b.split("::")[0] and not both:
                robot.apart.add(frozenset((names[a], names[b])))
        for element, scope in self.points:
            connect_points(robot, element, partial(self._link_of, links, element, scope))
        if not contacts:
            robot.leave_out_contacts()
        self._read_laws()

    def _link_of(self, links: dict[str, Link], element: XmlElement, scope: _Scope, name: str) -> Link:
        """Link of a name in a model."""
        return links[self.frames.link(Frames.full(name, scope.name), element)]

    def _place(self, link: Link, scope: _Scope, collision: XmlElement) -> tuple[np.ndarray, np.ndarray]:
        """Rotation and position of a solid in its link."""
        rotation, position = pose_of(collision)
        base = reference_of(collision, "pose", "relative_to")
        if not base:
            return rotation, position
        turn, place = self.frames.pose(Frames.full(base, scope.name), collision)
        return link.rotation.T @ turn @ rotation, link.rotation.T @ (place + turn @ position - link.position)

    def _read_scope(self, scope: _Scope) -> list[_Scope]:
        """Read what a model or the world holds; return the models in it."""
        inner = []
        known = {*TABLE[scope.element.tag][1], *BESIDES}
        for child in sorted(scope.element.children, key=lambda child: child.tag in ("joint", "drake:joint")):
            if child.tag in BESIDES:
                continue
            if child.tag == "include":
                inner.append(self._included(child, scope))
            elif child.tag == "model":
                inner.append(self._model(child, scope, scope.folder, scope.has_axes))
            elif child.tag == "link":
                key = self._add_frame(child, scope, "", "")
                self.links[key] = child, scope
                if _is(child, "kinematic"):
                    self.robot.left_out.append(f"the motion of link '{key}' by a program (kinematic)")
            elif child.tag == "frame":
                self._add_frame(child, scope, child.get("attached_to", ""), scope.name)
            elif child.tag in ("joint", "drake:joint"):
                self.joints[add_joint_frame(self.frames, child, scope.name)] = child, scope
            elif child.tag in CONNECTIONS:
                self.points.append((child, scope))
            elif child.tag.startswith("drake:") or (":" not in child.tag and child.tag not in known):
                raise child.refuse("is not read; leave it out, if the motion does not depend on it")
        return inner

    def _add_frame(self, element: XmlElement, scope: _Scope, attached: str, free: str) -> str:
        """Add the frame of a link or a frame, with what it moves with (itself, if neither is given)."""
        key = Frames.full(element.get("name"), scope.name)
        base = reference_of(element, "pose", "relative_to") or attached
        moves_with = Frames.full(attached, scope.name) if attached else free if element.tag == "frame" else key
        self.frames.add(
            key, Frame(element, Frames.full(base, scope.name) if base else scope.name, *pose_of(element), moves_with)
        )
        return key

    def _model(self, element: XmlElement, scope: _Scope, folder: Path, has_axes: bool) -> _Scope:
        """Add the frame of a model, which moves with its canonical link, or its first one."""
        name = Frames.full(element.get("name"), scope.name)
        first = next((child.get("name") for tag in ("link", "model") for child in element.all(tag)), "")
        main = element.get("canonical_link", first)
        placed = element.get("placement_frame", "")
        base = reference_of(element, "pose", "relative_to")
        frame = Frame(
            element,
            Frames.full(base, scope.name) if base else scope.name,
            *pose_of(element),
            Frames.full(main, name) if main else "",
            Frames.full(placed, name) if placed else "",
        )
        self.frames.add(name, frame)
        is_static = scope.is_static or _is(element, "static")
        collides = _is(element, "self_collide", str(scope.collides and scope.name != ""))
        return _Scope(element, name, folder, has_axes, is_static, collides)

    def _included(self, include: XmlElement, scope: _Scope) -> _Scope:
        """Read the model of another file, with the name and the place that it is given."""
        if _is(include, "merge"):
            raise include.refuse("is to be merged, which is not read; leave 'merge' out, and name what is in it")
        path = _found(include, scope.folder)
        root = _read(path)
        models = list(root.all("model"))
        if len(models) != 1:
            raise include.refuse(f"includes {path.name}, which must hold one model and holds {len(models)}")
        self.robot.left_out += [f"{each} in {path.name}" for each in unread(root, TABLE)]
        model = models[0]
        own = {key: include.attributes[key] for key in ("name", "static", "placement_frame") if include.has(key)}
        if include.has("pose"):
            own["pose"] = include.get("pose")
            model.children = [child for child in model.children if child.tag != "pose"] + list(include.all("pose"))
        model.attributes |= own
        return self._model(model, scope, path.parent, _version(root) < _AXES_OF_JOINTS)

    def _connections(self) -> list[Connection]:
        """Joints between links; links of static models are fixed to the world."""
        static = {key for key, (_, scope) in self.links.items() if scope.is_static}
        found = [Connection(self.links[key][0], key, "", key, []) for key in self.links if key in static]
        names = _short(self.joints)
        for key, (joint, scope) in self.joints.items():
            along = scope.has_axes or any(_is(axis, "use_parent_model_frame") for axis in joint.all("axis"))
            each = connection(self.robot, self.frames, joint, scope.name, key, names[key], along)
            for end in (each.a, each.b):
                if end and end not in self.links:
                    raise joint.refuse(f"names '{end}', which is no link and holds none")
            if not {each.a, each.b} <= {"", *static}:
                found.append(each)
        return found

    def _read_laws(self) -> None:
        """Read what drives joints, and joints that follow others."""
        there = {joint.name for _, joint in self.robot.joints}
        names = _short(self.joints)
        for key, (joint, scope) in self.joints.items():
            axis = joint.one("axis") or joint
            if names[key] not in there:
                continue
            mimic = axis.one("mimic") or joint.one("drake:mimic")
            if mimic is not None:
                other = Frames.full(mimic.get("joint"), scope.name)
                other = f"{other} (joint)" if self.frames.has_link(other) else other
                follow(self.robot, names[key], names.get(other, other), mimic)
            if has_effort(axis.one("limit")):
                actuate(self.robot, names[key], axis.one("limit"))


def _short(parts: dict[str, tuple[XmlElement, _Scope]]) -> dict[str, str]:
    """Names without those of models, as far as they tell parts apart."""
    last = [element.get("name") for element, _ in parts.values()]
    return {key: name if last.count(name) == 1 else key for key, name in zip(parts, last, strict=True)}


def _found(include: XmlElement, folder: Path) -> Path:
    """File that an element includes; of a folder, the newest model in it."""
    uri = include.get("uri").strip()
    kind, _, name = uri.rpartition("://")
    if kind not in ("", "file", "model", "package"):
        raise include.refuse(f"names '{uri}'; load the model, and give its path")
    for place in (folder, *folder.resolve().parents) if kind in ("model", "package") else (folder,):
        path = place / name
        if path.is_dir():
            path = max(path.glob("*.sdf"), default=path / "model.sdf")
        if path.is_file():
            return path
    raise include.refuse(f"names '{uri}', which is not there; give its path from {folder}")


def _collides(link: XmlElement, scope: _Scope) -> bool:
    return _is(link, "self_collide", str(scope.collides))


def _masses(link: XmlElement) -> list[Mass]:
    """Mass of a link; what is not given is one, as the format says."""
    inertial = link.one("inertial") or XmlElement(link.file, "inertial", link.line, {})
    if _is(inertial, "auto"):
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
