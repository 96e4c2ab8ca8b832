"""Planar mechanisms from the model files of MuJoCo (MJCF)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import casadi as ca
import numpy as np

from ..model.joints.constraints import Constraint
from ..model.mechanism import Mechanism
from .markup import XmlElement, read_xml
from .mjcf_actuators import FREE, Actuator, as_general, gains_of
from .mjcf_format import ACTUATORS, OTHER_ACTUATORS, refuse_unread, turned_off
from .mjcf_solids import NEEDED, size_along, solid
from .planar import PlanarBuilder
from .robots import (
    Coordinate,
    Law,
    Link,
    Loop,
    Mass,
    Robot,
    Solid,
    SpatialJoint,
    Strand,
    Tendon,
    actuator_law,
    rotation_about,
    rotation_around,
    rotation_to_z,
    symmetric,
    unit_vector,
)

#: Density of geoms that give neither it nor a mass, kg/m³.
DENSITY = 1000.0
#: Compliance of equalities, unless a file gives another one; they are as good as rigid.
_STIFF = {"solref": np.array([0.02, 1]), "solimp": np.array([0.9, 0.95, 0.001, 0.5, 2])}
#: Geoms that have no mass.
_MASSLESS = ("plane", "hfield")
#: Numbers of geoms that decide what they touch, by default.
_BITS = {"priority": "0", "contype": "1", "conaffinity": "1"}


def read_mjcf(path: str | Path, *, contacts: bool = True) -> Mechanism:
    """Read a model whose motion is planar.

    All hinges must be parallel, and slides lie in the plane across them; bodies without joints become
    one with their parents. The plane is seen so that gravity points down and the axes of the world to
    the right; the pose of the file has ``phi = 0`` for all bodies. The coordinate of each joint has the sense and the
    zero of the file: ``mechanism.joint(name).angle`` of a hinge, ``.displacement`` of a slide, also of those by which
    a body is free in the plane. ``connect`` and ``weld`` under ``equality``
    close loops, and hold exactly; ``joint`` and ``tendon`` couple coordinates and tendons; actuators (``motor``,
    ``position``, ``velocity``, ``general`` with a force that is linear) become inputs of their names. Tendons are sums
    of coordinates (``fixed``) or lengths from site to site (``spatial``), also across the plane, by ``pulley`` and
    around cylinders across the plane and spheres in it, outside of them; the force of a tendon is ``tendon name spring
    and damper``. ``springdamper`` tunes a spring, and ``dampratio`` a servo, by
    the inertia of the coordinate, as MuJoCo does. The ``armature`` of a
    joint is a rotor, a body beside the others that turns with the coordinate. ``include`` is read;
    :func:`read_keyframes` has the keyframes; sensors and what is only seen change no motion and are not read.

    Geoms that MuJoCo lets touch are a :class:`Contact` ``one on other``: planes, spheres, capsules, cylinders and
    boxes that lie along the plane or across it. A ``range`` of a joint is two of :class:`EndStop`, ``joint lower
    stop`` and ``joint upper stop``, that of a tendon ``tendon name lower stop``, …; ``frictionloss`` is a
    :class:`LoadIndependentFriction` ``joint friction``. The ranges of the forces of an actuator limit its input, or, of
    a servo, the force itself. Softness (``solref``, ``solimp``)
    has no length in a file; the laws are these instead, with the weight W of all bodies and the size h, which is half
    of the least width of the smaller geom, the radius of gyration of what the joint carries, or the greatest length of
    the tendon (of a sum of coordinates, the softest of the stops that its joints would have):

    - Contacts and stops are :class:`HuntCrossley` with the exponent 1, ``k = W/δ`` and ``χ = 2/√(g δ)``,
      ``δ = 0.01 h`` (of a hinge ``k h²`` and ``χ h``): they yield by 1 % of the size under the weight of all bodies,
      and do not bounce.
    - Friction is :class:`Coulomb` with the velocity tolerance ``0.01 √(g h)``.

    Parameters
    ----------
    path : str or Path
        The file.
    contacts : bool, default True
        False leaves out contacts, limits and dry friction of joints, with a warning: equations without jumps.

    Returns
    -------
    Mechanism
        Bodies and joints by their names; the springs and dampers of joints as forces.

    Raises
    ------
    FileError
        For an element or attribute that is not planar or not read, with its line.

    Warns
    -----
    MechanismWarning
        For what is left out: contacts of other geoms, margins, rolling friction, the softness of equalities, fluids.

    References
    ----------
    MuJoCo documentation, *XML reference*.
    """
    return PlanarBuilder(robot_of(path, contacts=contacts)).mechanism()


def robot_of(path: str | Path, *, contacts: bool) -> Robot:
    """Read the robot of a file, in space; its joints and inputs are in the order of MuJoCo."""
    root = read_xml(path, "mujoco")
    _include(root, Path(path).parent)
    return _Reader(root, Path(path).stem, contacts).robot()


def _include(root: XmlElement, folder: Path) -> None:
    """Put the contents of other files in the places of the elements that include them."""
    waiting, seen = [(root, folder)], set[Path]()
    while waiting:
        element, beside = waiting.pop()
        left = [(child, beside) for child in reversed(element.children)]
        kept = []
        while left:
            child, beside = left.pop()
            if child.tag != "include":
                kept.append((child, beside))
                continue
            name = child.get("file")
            path = folder / name if (folder / name).exists() else beside / name
            if path.resolve() in seen:
                raise child.refuse(f"includes '{name}', which is included already")
            seen.add(path.resolve())
            left += [(part, path.parent) for part in reversed(read_xml(path, None).children)]
        element.children = [child for child, _ in kept]
        waiting += kept


#: Attributes by tag that a class of defaults gives; those of all actuators under "general".
Defaults = dict[str, dict[str, str]]


def _extended(above: Defaults, element: XmlElement) -> Defaults:
    """A class of defaults with the entries of one element ``default``."""
    refuse_unread(element)
    values = {tag: dict(attributes) for tag, attributes in above.items()}
    for child in element.children:
        if child.tag in (*ACTUATORS, *OTHER_ACTUATORS):
            values["general"] = as_general(child, values.get("general", {}))
        elif child.tag != "default":
            values.setdefault(child.tag, {}).update(child.attributes)
    return values


def _joined(root: XmlElement, tag: str) -> XmlElement:
    """All elements of a kind as one: an attribute of a later one replaces that of an earlier one."""
    together = XmlElement(root.file, tag, root.line, {})
    for element in root.all(tag):
        refuse_unread(element)
        together.line = element.line
        together.attributes |= element.attributes
        together.children += element.children
    return together


def _friction(element: XmlElement) -> float:
    """Coefficient of the friction of a geom or a pair along a surface."""
    return 0.0 if element.get("condim", "3") == "1" else float(element.numbers("friction", "1 0.005 0.0001")[0])


class _Reader:
    """One file."""

    def __init__(self, root: XmlElement, stem: str, contacts: bool):
        refuse_unread(root)
        self.root, self.contacts = root, contacts
        self._read_compiler(_joined(root, "compiler"))
        option = _joined(root, "option")
        self.off = turned_off(option.all("flag"))
        gravity = option.numbers("gravity", "0 0 -9.81", (3,))
        self._robot = Robot(root, root.get("model", stem), np.zeros(3) if "gravity" in self.off else gravity)
        if option.number("density", "0") > 0 or option.number("viscosity", "0") > 0:
            self._robot.left_out.append("the forces of a fluid (density, viscosity and wind of option)")
        self.classes: dict[str, Defaults] = {"main": {}}
        for element in root.all("default"):
            waiting = [("main", self.classes["main"], element)]
            while waiting:
                name, above, element = waiting.pop()
                defaults = self.classes[name] = _extended(above, element)
                waiting += [(child.get("class"), defaults, child) for child in element.all("default")]
        self._sites: dict[str, tuple[XmlElement, Link]] = {}
        self._joint_ranges: dict[str, tuple[float, float]] = {}
        self._actuators: list[Actuator] = []
        self._count = 0

    def _read_compiler(self, element: XmlElement) -> None:
        self.degrees = element.word("angle", "degree", "radian") == "degree"
        self.sequence = element.get("eulerseq", "xyz")
        if len(self.sequence) != 3 or not set(self.sequence.lower()) <= set("xyz"):
            raise element.refuse(f"has eulerseq = '{self.sequence}', which must be three of x, y, z, X, Y, Z")
        self.from_geoms = element.word("inertiafromgeom", "auto", "true", "false")
        self.has_auto_limits = element.word("autolimits", "true", "false") == "true"
        self.total_mass = element.number("settotalmass", "-1")
        if element.get("coordinate", "local") != "local":
            raise element.refuse("has coordinate = 'global', which MuJoCo no longer supports; give local ones")

    def _defaults(self, element: XmlElement, childclass: str, tag: str | None = None) -> dict[str, str]:
        """Attributes that the class of an element gives to those of a kind."""
        name = element.get("class", childclass)
        if name not in self.classes:
            raise element.refuse(f"is of the class '{name}', which does not exist")
        return self.classes[name].get(tag or element.tag, {})

    def _filled(self, element: XmlElement, childclass: str, tag: str | None = None) -> XmlElement:
        """An element with the defaults of its class."""
        return element.with_defaults(self._defaults(element, childclass, tag))

    def _angle(self, value: float) -> float:
        return float(np.radians(value)) if self.degrees else value

    def _is_limited(self, element: XmlElement, switch: str, limits: str) -> bool:
        """True if limits of an element are in force."""
        limited = element.word(switch, "auto", "true", "false")
        return limited == "true" or (limited == "auto" and self.has_auto_limits and element.has(limits))

    # --- the tree ------------------------------------------------------------------------
    def robot(self) -> Robot:
        """Return the bodies and joints of the file."""
        robot = self._robot
        world = Link(self.root, "world", None, np.eye(3), np.zeros(3))
        robot.links.append(world)
        waiting = [(element, world, "main") for element in reversed(list(self.root.all("worldbody")))]
        while waiting:
            element, link, childclass = waiting.pop()
            if element.tag == "body":
                link = self._link(element, link)
                if element.word("mocap", "false", "true") == "true":
                    robot.left_out.append(f"the motion of body '{link.name}' by a program (mocap)")
            waiting += reversed(self._read_children(element, link, childclass))
        self._scale_masses([mass for link in robot.links for mass in link.masses])
        self._tune_springs()
        for tendons in self.root.all("tendon"):
            refuse_unread(tendons)
            for element in tendons.children:
                self._read_tendon(self._filled(element, "main", "tendon"))
        for equality in self.root.all("equality"):
            for element in equality.children:
                self._read_equality(element)
        for actuators in self.root.all("actuator"):
            for element in actuators.children:
                self._read_actuator(element)
        self._limit_forces()
        self._read_contacts()
        return robot

    def _read_contacts(self) -> None:
        """Pairs of geoms that touch in any case, and bodies that do not."""
        robot = self._robot
        pairs = [pair for contact in self.root.all("contact") for pair in contact.all("pair")]
        for contact in self.root.all("contact"):
            refuse_unread(contact)
            robot.apart |= {frozenset((e.get("body1"), e.get("body2"))) for e in contact.all("exclude")}
        robot.neighbours_touch = "filterparent" in self.off
        if "contact" in self.off:
            robot.solids.clear()
        else:
            robot.pairs += [self._pair(self._filled(pair, "main")) for pair in pairs]
        if not self.contacts:
            robot.leave_out_contacts()

    def _pair(self, element: XmlElement) -> tuple[Solid, Solid, float | None]:
        """Two geoms that touch whatever they are, with their friction."""
        a, b = (self._robot.solid(element.get(key), element) for key in ("geom1", "geom2"))
        given = element.has("friction") or element.has("condim")
        return a, b, _friction(element) if given else None

    def _scale_masses(self, masses: Sequence[Mass]) -> None:
        """Scale all masses to the total that the compiler is to set."""
        total = sum(mass.mass for mass in masses)
        if self.total_mass > 0 and total > 0:
            for mass in masses:
                mass.mass *= self.total_mass / total
                mass.inertia = mass.inertia * (self.total_mass / total)

    def _tune_springs(self) -> None:
        """Springs and dampers by a time constant T and a damping ratio ζ: ``k = m/(T ζ)²``, ``c = 2 m/T``.

        ``1/m`` is the acceleration of the joint by a unit force on it alone, in the pose of the file.
        """
        joints = [joint for _, joint in self._robot.joints]
        given = [joint.source.numbers("springdamper", "0 0", (2,)) for joint in joints]
        if not any(np.all(pair > 0) for pair in given):
            return
        yields = np.diag(np.linalg.inv(self._robot.inertia()))
        for joint, (time, ratio), each in zip(joints, given, yields, strict=True):
            if time > 0 and ratio > 0:
                joint.stiffness = 0.0 if "spring" in self.off else float(1 / (each * (time * ratio) ** 2))
                joint.damping = 0.0 if "damper" in self.off else float(2 / (each * time))

    def _read_children(self, element: XmlElement, link: Link, childclass: str) -> list[tuple[XmlElement, Link, str]]:
        """Read what a body holds, in frames too; return the bodies in it with their parents and classes, in order."""
        bodies: list[tuple[XmlElement, Link, str]] = []
        masses: list[tuple[XmlElement, Link]] = []
        refuse_unread(element)
        waiting = [(child, link, childclass) for child in reversed(element.children)]
        while waiting:
            child, frame, childclass = waiting.pop()
            if child.tag == "body":
                bodies.append((child, frame, child.get("childclass", childclass)))
            elif child.tag == "frame":
                refuse_unread(child)
                inner, classes = self._link(child, frame), child.get("childclass", childclass)
                waiting += [(part, inner, classes) for part in reversed(child.children)]
            elif child.tag in ("joint", "freejoint"):
                if link.parent is None:
                    raise child.refuse("is outside any body")
                link.joints.append(self._joint(self._filled(child, childclass, "joint"), link, frame))
            elif child.tag == "geom":
                masses.append((self._filled(child, childclass), frame))
            elif child.tag == "inertial":
                masses.append((child, frame))
            elif child.tag == "site" and child.has("name"):
                self._sites[child.get("name")] = self._filled(child, childclass), frame
        self._read_masses(link, masses)
        return bodies

    def _link(self, element: XmlElement, parent: Link) -> Link:
        """Add a body or a frame, which is fixed."""
        self._count += 1
        name = element.get("name", f"body {self._count}") if element.tag == "body" else f"frame {self._count}"
        position = parent.position + parent.rotation @ element.numbers("pos", "0 0 0", (3,))
        carried = element.number("gravcomp", "0") if element.tag == "body" else parent.carried
        link = Link(element, name, parent, parent.rotation @ self._rotation(element), position, carried=carried)
        self._robot.links.append(link)
        return link

    def _rotation(self, element: XmlElement) -> np.ndarray:
        """Rotation of a frame that gives it in one of the ways of the format."""
        if element.has("quat"):
            w, *vector = unit_vector(element, "quat", element.numbers("quat", None, (4,)))
            size = float(np.linalg.norm(vector))
            return rotation_around(np.array(vector) / size, 2 * np.arctan2(size, w)) if size > 0 else np.eye(3)
        if element.has("axisangle"):
            *axis, angle = element.numbers("axisangle", None, (4,))
            return rotation_around(unit_vector(element, "axisangle", np.array(axis)), self._angle(angle))
        if element.has("euler"):
            rotation = np.eye(3)
            for letter, angle in zip(self.sequence, element.numbers("euler", None, (3,)), strict=True):
                turn = rotation_about("xyz".index(letter.lower()), self._angle(angle))
                rotation = rotation @ turn if letter.islower() else turn @ rotation
            return rotation
        if element.has("xyaxes"):
            values = element.numbers("xyaxes", None, (6,))
            x = unit_vector(element, "xyaxes", values[:3])
            y = unit_vector(element, "xyaxes", values[3:] - (values[3:] @ x) * x)
            return np.column_stack([x, y, np.cross(x, y)])
        if element.has("zaxis"):
            return rotation_to_z(unit_vector(element, "zaxis", element.numbers("zaxis", None, (3,))))
        return np.eye(3)

    def _joint(self, element: XmlElement, link: Link, frame: Link) -> SpatialJoint:
        kind = "free" if element.tag == "freejoint" else element.word("type", "hinge", "slide", "ball", "free")
        if kind not in ("hinge", "slide"):
            raise element.refuse(f"is of the type '{kind}', which moves in space; planar are hinge and slide")
        refuse_unread(element)
        name = element.get("name", f"{link.name} joint{f' {len(link.joints) + 1}' if link.joints else ''}")
        axis = unit_vector(element, "axis", element.numbers("axis", "0 0 1", (3,)))
        place = frame.position + frame.rotation @ element.numbers("pos", "0 0 0", (3,))
        robot = self._robot
        turns = self._angle if kind == "hinge" else float
        limits = None
        if "limit" not in self.off and self._is_limited(element, "limited", "range"):
            limits = self._range(element, "range", turns)
            if self.contacts and element.number("margin", "0") != 0:
                robot.left_out.append(f"the margin of the range of joint '{name}'")
        friction = 0.0 if "frictionloss" in self.off else element.number("frictionloss", "0", least=0.0)
        if self._is_limited(element, "actuatorfrclimited", "actuatorfrcrange"):
            self._joint_ranges[name] = self._range(element, "actuatorfrcrange")
        damping, stiffness = element.number("damping", "0", least=0.0), element.number("stiffness", "0", least=0.0)
        return SpatialJoint(
            element,
            name,
            kind,
            link.rotation.T @ frame.rotation @ axis,
            link.rotation.T @ (place - link.position),
            turns(element.number("ref", "0")),
            0.0 if "damper" in self.off else damping,
            0.0 if "spring" in self.off else stiffness,
            turns(element.number("springref", "0")),
            element.number("armature", "0", least=0.0),
            limits,
            friction,
        )

    @staticmethod
    def _range(element: XmlElement, name: str, turns: Callable[[float], float] = float) -> tuple[float, float]:
        """Two limits, the lower one first."""
        lower, upper = (turns(float(x)) for x in element.numbers(name, None, (2,)))
        if lower >= upper:
            raise element.refuse(f"has {name} = '{element.get(name)}', of which the first must be below the second")
        return lower, upper

    # --- masses ---------------------------------------------------------------------------
    def _read_masses(self, link: Link, parts: Sequence[tuple[XmlElement, Link]]) -> None:
        """Masses of a body: of its inertial, or of the geoms in it and its frames."""
        inertials = [element for element, _ in parts if element.tag == "inertial"]
        geoms = [(element, frame) for element, frame in parts if element.tag == "geom"]
        for element, _ in parts:
            refuse_unread(element)
        if len(inertials) > 1:
            raise inertials[1].refuse("is the second one; at most one is allowed")
        named = [(geom.get("name", f"{link.name} geom {k}"), geom, frame) for k, (geom, frame) in enumerate(geoms, 1)]
        self._robot.solids += [self._solid(name, geom, frame, link) for name, geom, frame in named]
        if link.parent is None:
            return
        if inertials and self.from_geoms != "true":
            link.masses.append(self._inertial(inertials[0]))
        elif self.from_geoms != "false":
            for geom, frame in geoms:
                mass = self._geom(geom) if geom.get("type", "sphere") not in _MASSLESS else None
                frame.masses += [] if mass is None else [mass]

    def _inertial(self, element: XmlElement) -> Mass:
        if element.has("fullinertia"):
            tensor = symmetric(*element.numbers("fullinertia", None, (6,)))
        else:
            tensor = np.diag(element.numbers("diaginertia", None, (3,)))
        rotation = self._rotation(element)
        center = element.numbers("pos", None, (3,))
        return Mass(element.number("mass", least=0.0), center, rotation @ tensor @ rotation.T)

    def _solid(self, name: str, element: XmlElement, frame: Link, link: Link) -> Solid:
        """A geom that others may touch."""
        kind, center, rotation, size = self._shape(element)
        for lost in ("margin", "gap"):
            if self.contacts and element.number(lost, "0") != 0:
                self._robot.left_out.append(f"the {lost} of geom '{name}'")
        if self.contacts and element.get("condim", "3") == "6":
            self._robot.left_out.append(f"the rolling friction of geom '{name}'")
        if kind in NEEDED and (size.size < NEEDED[kind] or np.any(size[: NEEDED[kind]] <= 0)):
            raise element.refuse(f"needs {NEEDED[kind]} positive numbers in size, as a {kind}")
        numbers = {key: int(element.number(key, default)) for key, default in _BITS.items()}
        return Solid(element, name, frame, link.name, kind, size, rotation, center, _friction(element),
                     numbers["priority"], numbers["contype"], numbers["conaffinity"])  # fmt: skip

    def _shape(self, element: XmlElement) -> tuple[str, np.ndarray, np.ndarray, np.ndarray]:
        """Kind of a geom, its centre (3,) and rotation (3, 3) in its frame, and its size."""
        kind = element.get("type", "sphere")
        center, rotation = element.numbers("pos", "0 0 0", (3,)), self._rotation(element)
        size = np.zeros(0) if not element.has("size") else element.numbers("size")
        if element.has("fromto"):
            ends = element.numbers("fromto", None, (6,))
            center, span = (ends[:3] + ends[3:]) / 2, ends[3:] - ends[:3]
            rotation = rotation_to_z(unit_vector(element, "fromto", span))
            size = size_along(kind, size, float(np.linalg.norm(span)) / 2)
        return kind, center, rotation, size

    def _geom(self, element: XmlElement) -> Mass | None:
        """Mass of a geom, homogeneous."""
        if element.has("mass") and element.number("mass", least=0.0) == 0:
            return None
        kind, center, rotation, size = self._shape(element)
        volume, moments = solid(element, kind, size)
        mass = element.number("mass") if element.has("mass") else element.number("density", str(DENSITY)) * volume
        return Mass(mass, center, rotation @ np.diag(mass * moments) @ rotation.T) if mass > 0 else None

    # --- equalities and actuators -----------------------------------------------------------
    def _read_equality(self, element: XmlElement) -> None:
        element = self._filled(element, "main", "equality")
        robot = self._robot
        if element.word("active", "true", "false") == "false" or "equality" in self.off:
            return
        self._count += 1
        name = self._name(element, f"{element.tag} {self._count}")
        if element.tag not in ("connect", "weld", "joint", "tendon"):
            raise element.refuse("is not supported; connect, weld, joint and tendon are")
        is_coupling = element.tag in ("joint", "tendon")
        refuse_unread(element, f"equality {element.tag}" if is_coupling else None)
        given = {name: element.numbers(name) for name in _STIFF if element.has(name)}
        soft = [name for name, own in given.items() if np.any(own != _STIFF[name][: own.size])]
        if soft:
            robot.left_out.append(f"the softness ({', '.join(soft)}) of {element.tag} '{name}', which holds exactly")
        if is_coupling:
            self._read_coupling(element, name)
            return
        end = None
        if element.has("site1"):
            (a, point, turn), (b, end, other) = (self._site(element, key) for key in ("site1", "site2"))
            is_apart = np.linalg.norm(end - point) > 1e-3 or np.max(np.abs(turn - other)) > 1e-3
            if element.tag == "weld" and is_apart:
                raise element.refuse("connects sites that are apart in the pose of the file")
        else:
            a = robot.link(element.get("body1"), element)
            b = robot.link(element.get("body2", "world"), element)
            anchor = element.numbers("anchor", None if element.tag == "connect" else "0 0 0", (3,))
            frame = a if element.tag == "connect" else b
            point = frame.position + frame.rotation @ anchor
        # a weld without a couple holds a point
        is_rigid = element.tag == "weld" and element.number("torquescale", "1") != 0
        robot.loops.append(Loop(element, name, a, b, point, is_rigid, end=end))

    def _site(self, element: XmlElement, key: str) -> tuple[Link, np.ndarray, np.ndarray]:
        """Link, place and rotation of a site that an element names."""
        name = element.get(key)
        if name not in self._sites:
            raise element.refuse(f"names the site '{name}', which does not exist")
        site, link = self._sites[name]
        refuse_unread(site)
        point = link.position + link.rotation @ site.numbers("pos", "0 0 0", (3,))
        return link, point, link.rotation @ self._rotation(site)

    def _read_tendon(self, element: XmlElement) -> None:
        """A sum of coordinates, or a length from site to site, which springs, actuators and couplings may use."""
        refuse_unread(element)
        robot, name = self._robot, element.get("name", f"{len(self._robot.tendons) + 1}")
        limits = None
        if "limit" not in self.off and self._is_limited(element, "limited", "range"):
            limits = self._range(element, "range")
            if element.tag == "spatial" and limits[1] <= 0:
                raise element.refuse(f"has range = '{element.get('range')}', which leaves it no length")
            if not self.contacts:
                robot.left_out.append(f"the range of tendon '{name}' (EndStop holds it)")
        if "frictionloss" not in self.off and element.number("frictionloss", "0", least=0.0) > 0:
            robot.left_out.append(f"the dry friction of tendon '{name}'")
        rest = element.numbers("springlength", "-1", (1, 2))
        if rest[0] > rest[-1]:
            raise element.refuse(f"has springlength = '{element.get('springlength')}', of which the first is greater")
        tendon = Tendon(
            element,
            name,
            self._parts(element) if element.tag == "fixed" else [],
            self._strands(element) if element.tag == "spatial" else [],
            0.0 if "damper" in self.off else element.number("damping", "0", least=0.0),
            0.0 if "spring" in self.off else element.number("stiffness", "0", least=0.0),
            None if rest[0] == -1 else (float(rest[0]), float(rest[-1])),
            limits if self.contacts else None,
        )
        robot.tendons.append(tendon)
        if self._is_limited(element, "actuatorfrclimited", "actuatorfrcrange"):
            self._joint_ranges[tendon.key] = self._range(element, "actuatorfrcrange")

    def _parts(self, element: XmlElement) -> list[tuple[str, float]]:
        """Joints of a fixed tendon, and their factors."""
        parts = []
        for child in element.children:
            refuse_unread(child, "fixed joint")
            parts.append((self._robot.joint(child.get("joint"), child).name, child.number("coef")))
        return parts

    def _strands(self, element: XmlElement) -> list[Strand]:
        """Strands of a spatial tendon, from site to site."""
        strands: list[Strand] = []
        start: tuple[Link, np.ndarray] | None = None
        share, around, side = 1.0, None, None
        for child in element.children:
            refuse_unread(child, f"spatial {child.tag}")
            if child.tag == "geom":
                if start is None or around is not None:
                    raise child.refuse("needs a site before it and one after it")
                around = self._robot.solid(child.get("geom"), child)
                side = self._site(child, "sidesite")[:2] if child.has("sidesite") else None
            elif child.tag == "site":
                end = self._site(child, "site")[:2]
                if start is not None:
                    strands.append(Strand(start, end, share, around, side))
                start, around, side = end, None, None
            else:
                divisor = child.number("divisor", "1")
                if divisor <= 0 or around is not None:
                    raise child.refuse("must be beside sites, with a divisor above zero")
                start, share = None, 1 / divisor
        if around is not None or not strands:
            raise element.refuse("must run from site to site")
        return strands

    def _read_coupling(self, element: XmlElement, name: str) -> None:
        robot = self._robot
        keys = [f"{element.tag}{k}" for k in (1, 2) if k == 1 or element.has(f"{element.tag}{k}")]
        if element.tag == "joint":
            joints = [robot.joint(element.get(key), element) for key in keys]
            names = [joint.name for joint in joints]
        else:
            names = [robot.tendon(element.get(key), element).key for key in keys]
        polynomial = [float(x) for x in element.numbers("polycoef", "0 1 0 0 0")]
        robot.constraints.append((tuple(names), _coupling(name, polynomial)))

    def _read_actuator(self, element: XmlElement) -> None:
        if element.tag not in ACTUATORS:
            raise element.refuse("is not supported; motor, position, velocity and general are")
        refuse_unread(element)
        element = XmlElement(
            element.file, element.tag, element.line, as_general(element, self._defaults(element, "main", "general"))
        )
        robot = self._robot
        if not element.has("joint") and not element.has("tendon"):
            raise element.refuse("does not act on a joint or a tendon, as motors do here")
        refuse_unread(element, "general")
        if element.has("joint"):
            joint = robot.joint(element.get("joint"), element).name
        else:
            joint = robot.tendon(element.get("tendon"), element).key
        usual = f"{joint} {element.tag}"
        alike = sum(actuator.name.startswith(usual) for actuator in self._actuators)
        name = element.get("name", f"{usual} {alike + 1}" if alike else usual)
        limits = FREE
        if "clampctrl" not in self.off and self._is_limited(element, "ctrllimited", "ctrlrange"):
            limits = self._range(element, "ctrlrange")
        is_limited = self._is_limited(element, "forcelimited", "forcerange")
        force = self._range(element, "forcerange") if is_limited else FREE
        gear = float(element.numbers("gear", "1")[0])
        gains = gains_of(element, lambda: self._inertia_along(element, joint, gear))
        self._actuators.append(Actuator(element, name, joint, gear, gains, limits, force))

    def _inertia_along(self, actuator: XmlElement, key: str, gear: float) -> float:
        """Inertia of the coordinate of an actuator, ``1/(J M⁻¹ Jᵀ)`` in the pose of the file."""
        robot = self._robot
        parts = next((tendon.parts for tendon in robot.tendons if tendon.key == key), [(key, 1.0)])
        if not parts or gear == 0:
            raise actuator.refuse("has a damping ratio along a path, which is not read; give the damping itself, as kv")
        slopes = gear * np.array([dict(parts).get(joint.name, 0.0) for _, joint in robot.joints])
        return float(1 / (slopes @ np.linalg.solve(robot.inertia(), slopes)))

    def _limit_forces(self) -> None:
        """Make inputs and forces of the actuators, within the ranges of theirs and of their joints."""
        robot = self._robot
        for actuator in self._actuators:
            shared = sum(other.joint == actuator.joint for other in self._actuators) > 1
            if actuator.joint in self._joint_ranges and not shared and actuator.gear != 0:
                whole = [limit / actuator.gear for limit in self._joint_ranges[actuator.joint]]
                actuator.within(min(whole), max(whole))
            drive, force = actuator.drive()
            robot.inputs.append(drive)
            law = actuator_law(self._name(actuator.source, actuator.name), drive, actuator.gear, actuator.gains, force)
            robot.forces.append(((actuator.joint,), law))
        for name in self._joint_ranges:
            if sum(actuator.joint == name for actuator in self._actuators) > 1:
                robot.left_out.append(f"the range of the sum of the forces of actuators on joint '{name}'")

    def _name(self, element: XmlElement, default: str) -> str:
        """Name of an equality or actuator; its kind is added if a joint has the name too."""
        name = element.get("name", default)
        taken = any(name == joint.name for link in self._robot.links for joint in link.joints)
        return f"{name} {element.tag}" if taken else name


def _coupling(name: str, polynomial: Sequence[float]) -> Law:
    """``y - y0 = a0 + a1 (x - x0) + …``."""

    def law(coordinates: Sequence[Coordinate]) -> Constraint:
        first, *others = (along.value - along.reference for along in coordinates)
        x = others[0] if others else ca.SX(0)
        return Constraint(name, first - sum(a * x**k if k else a for k, a in enumerate(polynomial)))

    return law
