"""Planar mechanisms from the model files of MuJoCo (MJCF)."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import casadi as ca
import numpy as np

from ..model.joints.constraints import Constraint
from ..model.mechanism import Mechanism
from ..model.symbols import Input
from .markup import XmlElement, read_xml
from .mjcf_attributes import SHARED_BY_ACTUATORS, refuse_unread, turned_off
from .planar import PlanarBuilder
from .robots import (
    Coordinate,
    Law,
    Link,
    Loop,
    Mass,
    Robot,
    SpatialJoint,
    actuator_law,
    rotation_about,
    rotation_around,
    symmetric,
    unit_vector,
)

#: Density of geoms that give neither it nor a mass, kg/m³.
DENSITY = 1000.0
#: Actuators that are read; defaults of one kind are those of the others too.
ACTUATORS = ("motor", "position", "velocity", "general")
#: Geoms that have no mass.
_MASSLESS = ("plane", "hfield")
#: Elements for visualisation, sensors or the solver, which change no equation of motion.
_IGNORED = ("asset", "visual", "statistic", "size", "sensor", "keyframe", "custom", "extension")


def read_mjcf(path: str | Path) -> Mechanism:
    """Read a model whose motion is planar.

    All hinges must be parallel, and slides lie in the plane across them; bodies without joints become
    one with their parents. The plane is seen so that gravity points down and the axes of the world to
    the right; the pose of the file has ``phi = 0`` for all bodies. ``connect`` and ``weld`` under ``equality``
    close loops, ``joint`` couples coordinates; actuators (``motor``, ``position``,
    ``velocity``, ``general`` with a force that is linear) become inputs of their names. The
    ``armature`` of a joint is a rotor, a body beside the others that turns with the coordinate.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    Mechanism
        Bodies and joints by their names; the springs and dampers of joints as forces.

    Raises
    ------
    FileError
        For an element that is not planar or not known, with its line.

    Warns
    -----
    MechanismWarning
        For contacts of geoms, and for limits and dry friction of joints, which are left out.

    References
    ----------
    MuJoCo documentation, *XML reference*.
    """
    root = read_xml(path, "mujoco")
    return PlanarBuilder(_Reader(root, Path(path).stem).robot()).mechanism()


#: Attributes by tag that a class of defaults gives.
Defaults = dict[str, dict[str, str]]


def _extended(above: Defaults, element: XmlElement) -> Defaults:
    """A class of defaults with the entries of one element ``default``."""
    values = {tag: dict(attributes) for tag, attributes in above.items()}
    for child in element.children:
        if child.tag != "default":
            values.setdefault(child.tag, {}).update(child.attributes)
        if child.tag in ACTUATORS:
            shared = {name: text for name, text in child.attributes.items() if name in SHARED_BY_ACTUATORS}
            for tag in ACTUATORS:
                values.setdefault(tag, {}).update(shared)
    return values


class _Reader:
    """One file."""

    def __init__(self, root: XmlElement, stem: str):
        self.root = root
        self.degrees, self.sequence, self.from_geoms, self.has_auto_limits = True, "xyz", "auto", True
        self.total_mass = -1.0
        self.off: set[str] = set()
        self.has_fluid = False
        self.classes: dict[str, Defaults] = {"main": {}}
        gravity = np.array([0.0, 0.0, -9.81])
        for element in root.children:
            if element.tag == "compiler":
                self._read_compiler(element)
            elif element.tag == "option":
                gravity = self._read_option(element)
            elif element.tag == "default":
                self._read_defaults(element, self.classes["main"], "main")
            elif element.tag == "contact":
                continue
            elif element.tag in ("include", "tendon", "deformable", "flex"):
                raise element.refuse("is not read; write the model into one file of bodies, joints and actuators")
            elif element.tag not in ("worldbody", "equality", "actuator", *_IGNORED):
                raise element.refuse("is not known")
        self._robot = Robot(root, root.get("model", stem), gravity)
        if self.has_fluid:
            self._robot.left_out.append("the forces of a fluid (density, viscosity and wind of option)")
        self._sites: dict[str, tuple[Link, np.ndarray, np.ndarray]] = {}
        self._has_contacts = False
        self._count = 0

    def _read_option(self, element: XmlElement) -> np.ndarray:
        """Take note of what an option turns off, and return the gravity."""
        refuse_unread(element)
        self.off = turned_off(element)
        self.has_fluid = element.number("density", "0") > 0 or element.number("viscosity", "0") > 0
        gravity = element.numbers("gravity", "0 0 -9.81", (3,))
        return np.zeros(3) if "gravity" in self.off else gravity

    def _read_compiler(self, element: XmlElement) -> None:
        self.degrees = element.get("angle", "degree") == "degree"
        self.sequence = element.get("eulerseq", "xyz")
        if len(self.sequence) != 3 or not set(self.sequence.lower()) <= set("xyz"):
            raise element.refuse(f"has eulerseq = '{self.sequence}', which must be three of x, y, z, X, Y, Z")
        self.from_geoms = element.get("inertiafromgeom", "auto")
        self.has_auto_limits = element.get("autolimits", "true") == "true"
        self.total_mass = element.number("settotalmass", "-1")
        for attribute in ("boundmass", "boundinertia", "inertiagrouprange"):
            if element.has(attribute):
                raise element.refuse(f"has {attribute}, which is not read; give the bodies the masses it leads to")
        refuse_unread(element)
        if element.get("coordinate", "local") != "local":
            raise element.refuse("has coordinate = 'global', which MuJoCo no longer supports; give local ones")

    def _read_defaults(self, element: XmlElement, above: Defaults, name: str) -> None:
        defaults = _extended(above, element)
        self.classes[name] = defaults
        for child in element.all("default"):
            self._read_defaults(child, defaults, child.get("class"))

    def _filled(self, element: XmlElement, childclass: str, tag: str | None = None) -> XmlElement:
        """An element with the defaults of its class."""
        name = element.get("class", childclass)
        if name not in self.classes:
            raise element.refuse(f"is of the class '{name}', which does not exist")
        return element.with_defaults(self.classes[name].get(tag or element.tag, {}))

    def _angle(self, value: float) -> float:
        return float(np.radians(value)) if self.degrees else value

    # --- the tree ------------------------------------------------------------------------
    def robot(self) -> Robot:
        """Return the bodies and joints of the file."""
        robot = self._robot
        world = Link(self.root, "world", None, np.eye(3), np.zeros(3))
        robot.links.append(world)
        for body in self.root.all("worldbody"):
            self._read_children(body, world, "main")
        self._scale_masses([mass for link in robot.links for mass in link.masses])
        for equality in self.root.all("equality"):
            for element in equality.children:
                self._read_equality(element)
        for actuators in self.root.all("actuator"):
            for element in actuators.children:
                self._read_actuator(element)
        if self._has_contacts:
            robot.left_out.append("the contacts of geoms (Contact has them)")
        return robot

    def _scale_masses(self, masses: Sequence[Mass]) -> None:
        """Scale all masses to the total that the compiler is to set."""
        total = sum(mass.mass for mass in masses)
        if self.total_mass > 0 and total > 0:
            for mass in masses:
                mass.mass *= self.total_mass / total
                mass.inertia = mass.inertia * (self.total_mass / total)

    def _read_children(self, element: XmlElement, link: Link, childclass: str) -> None:
        geoms: list[XmlElement] = []
        inertial: XmlElement | None = None
        for child in element.children:
            if child.tag == "body":
                self._read_body(child, link, child.get("childclass", childclass))
            elif child.tag in ("joint", "freejoint"):
                if link.parent is None:
                    raise child.refuse("is outside any body")
                link.joints.append(self._joint(self._filled(child, childclass, "joint"), link))
            elif child.tag == "geom":
                geoms.append(self._filled(child, childclass))
            elif child.tag == "inertial":
                refuse_unread(child)
                inertial = child
            elif child.tag == "site":
                site = self._filled(child, childclass)
                if site.has("name"):
                    point = link.position + link.rotation @ site.numbers("pos", "0 0 0", (3,))
                    self._sites[site.get("name")] = link, point, link.rotation @ self._rotation(site)
            elif child.tag not in ("light", "camera"):
                raise child.refuse("is not supported here")
        self._read_masses(link, inertial, geoms)

    def _read_body(self, element: XmlElement, parent: Link, childclass: str) -> None:
        self._count += 1
        refuse_unread(element)
        name = element.get("name", f"body {self._count}")
        position = parent.position + parent.rotation @ element.numbers("pos", "0 0 0", (3,))
        link = Link(element, name, parent, parent.rotation @ self._rotation(element), position)
        self._robot.links.append(link)
        self._read_children(element, link, childclass)

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
            return _to_z(unit_vector(element, "zaxis", element.numbers("zaxis", None, (3,))))
        return np.eye(3)

    def _joint(self, element: XmlElement, link: Link) -> SpatialJoint:
        kind = "free" if element.tag == "freejoint" else element.get("type", "hinge")
        if kind not in ("hinge", "slide"):
            raise element.refuse(f"is of the type '{kind}', which moves in space; planar are hinge and slide")
        refuse_unread(element, "joint")
        name = element.get("name", f"{link.name} joint{f' {len(link.joints) + 1}' if link.joints else ''}")
        axis = unit_vector(element, "axis", element.numbers("axis", "0 0 1", (3,)))
        robot = self._robot
        turns = self._angle if kind == "hinge" else float
        limited = element.get("limited", "auto")
        if limited == "true" or (limited == "auto" and self.has_auto_limits and element.has("range")):
            robot.left_out.append(f"the range of joint '{name}' (EndStop holds it)")
        if element.number("frictionloss", "0", least=0.0) > 0:
            robot.left_out.append(f"the dry friction of joint '{name}' (LoadIndependentFriction has it)")
        if element.has("actuatorfrcrange"):
            robot.left_out.append(f"the range of the forces of actuators on joint '{name}'")
        damping, stiffness = element.number("damping", "0", least=0.0), element.number("stiffness", "0", least=0.0)
        return SpatialJoint(
            element,
            name,
            kind,
            axis,
            element.numbers("pos", "0 0 0", (3,)),
            turns(element.number("ref", "0")),
            0.0 if "damper" in self.off else damping,
            0.0 if "spring" in self.off else stiffness,
            turns(element.number("springref", "0")),
            element.number("armature", "0", least=0.0),
        )

    # --- masses ---------------------------------------------------------------------------
    def _read_masses(self, link: Link, inertial: XmlElement | None, geoms: Sequence[XmlElement]) -> None:
        solid = [geom for geom in geoms if geom.get("type", "sphere") not in _MASSLESS]
        self._has_contacts |= any(
            geom.get("contype", "1") != "0" or geom.get("conaffinity", "1") != "0" for geom in geoms
        )
        if link.parent is None:
            return
        if inertial is not None and self.from_geoms != "true":
            link.masses.append(self._inertial(inertial))
        elif self.from_geoms != "false":
            link.masses += [mass for mass in map(self._geom, solid) if mass is not None]

    def _inertial(self, element: XmlElement) -> Mass:
        if element.has("fullinertia"):
            tensor = symmetric(*element.numbers("fullinertia", None, (6,)))
        else:
            tensor = np.diag(element.numbers("diaginertia", None, (3,)))
        rotation = self._rotation(element)
        center = element.numbers("pos", None, (3,))
        return Mass(element.number("mass", least=0.0), center, rotation @ tensor @ rotation.T)

    def _geom(self, element: XmlElement) -> Mass | None:
        """Mass of a geom, homogeneous."""
        refuse_unread(element)
        kind = element.get("type", "sphere")
        if element.has("mass") and element.number("mass", least=0.0) == 0:
            return None
        center, rotation = element.numbers("pos", "0 0 0", (3,)), self._rotation(element)
        size = np.zeros(0) if not element.has("size") else element.numbers("size")
        if element.has("fromto"):
            ends = element.numbers("fromto", None, (6,))
            center, span = (ends[:3] + ends[3:]) / 2, ends[3:] - ends[:3]
            rotation = _to_z(unit_vector(element, "fromto", span))
            half = float(np.linalg.norm(span)) / 2
            size = np.r_[size[:2], half] if kind in ("box", "ellipsoid") and size.size > 1 else np.r_[size[:1], half]
            if kind in ("box", "ellipsoid") and size.size == 2:
                size = np.r_[size[0], size]
        volume, moments = self._solid(element, kind, size)
        mass = element.number("mass") if element.has("mass") else element.number("density", str(DENSITY)) * volume
        return Mass(mass, center, rotation @ np.diag(mass * moments) @ rotation.T) if mass > 0 else None

    @staticmethod
    def _solid(element: XmlElement, kind: str, size: np.ndarray) -> tuple[float, np.ndarray]:
        """Volume of a solid, and its moments of inertia by its mass in its own axes."""
        needed = {"sphere": 1, "capsule": 2, "cylinder": 2, "box": 3, "ellipsoid": 3}
        if kind not in needed:
            raise element.refuse(f"is of the type '{kind}', whose mass is not computed; give the body an inertial")
        if size.size < needed[kind] or np.any(size[: needed[kind]] <= 0):
            raise element.refuse(f"needs {needed[kind]} positive numbers in size, as a {kind}")
        if kind == "sphere":
            r = size[0]
            return 4 / 3 * np.pi * r**3, np.full(3, 0.4 * r**2)
        if kind == "box":
            squares = size[:3] ** 2
            return 8 * float(np.prod(size[:3])), (np.sum(squares) - squares) / 3
        if kind == "ellipsoid":
            squares = size[:3] ** 2
            return 4 / 3 * np.pi * float(np.prod(size[:3])), (np.sum(squares) - squares) / 5
        r, h = size[0], 2 * size[1]
        tube = np.pi * r**2 * h
        tube_moments = np.array([r**2 / 4 + h**2 / 12, r**2 / 4 + h**2 / 12, r**2 / 2])
        if kind == "cylinder":
            return tube, tube_moments
        caps = 4 / 3 * np.pi * r**3
        across = 0.4 * r**2 + h**2 / 4 + 3 / 8 * r * h
        moments = (tube * tube_moments + caps * np.array([across, across, 0.4 * r**2])) / (tube + caps)
        return tube + caps, moments

    # --- equalities and actuators -----------------------------------------------------------
    def _read_equality(self, element: XmlElement) -> None:
        element = self._filled(element, "main", "equality")
        robot = self._robot
        if element.get("active", "true") == "false":
            return
        self._count += 1
        name = element.get("name", f"{element.tag} {self._count}")
        if element.tag == "joint":
            self._read_coupling(element, name)
            return
        if element.tag not in ("connect", "weld"):
            raise element.refuse("is not supported; connect, weld and joint are")
        refuse_unread(element)
        if element.has("site1"):
            (a, point, turn), (b, there, other) = (self._site(element, key) for key in ("site1", "site2"))
            if np.linalg.norm(there - point) > 1e-3 or (element.tag == "weld" and np.max(np.abs(turn - other)) > 1e-3):
                raise element.refuse("connects sites that are apart in the pose of the file")
        else:
            a = robot.link(element.get("body1"), element)
            b = robot.link(element.get("body2", "world"), element)
            anchor = element.numbers("anchor", None if element.tag == "connect" else "0 0 0", (3,))
            point = a.position + a.rotation @ anchor
        robot.loops.append(Loop(element, name, a, b, point, element.tag == "weld"))

    def _site(self, element: XmlElement, key: str) -> tuple[Link, np.ndarray, np.ndarray]:
        name = element.get(key)
        if name not in self._sites:
            raise element.refuse(f"names the site '{name}', which does not exist")
        return self._sites[name]

    def _read_coupling(self, element: XmlElement, name: str) -> None:
        robot = self._robot
        refuse_unread(element, "coupling")
        names = [element.get(key) for key in ("joint1", "joint2") if key == "joint1" or element.has(key)]
        references = [robot.joint(joint, element).reference for joint in names]
        polynomial = [float(x) for x in element.numbers("polycoef", "0 1 0 0 0")]
        robot.constraints.append((tuple(names), _coupling(name, references, polynomial)))

    def _read_actuator(self, element: XmlElement) -> None:
        if element.tag not in ACTUATORS:
            raise element.refuse("is not supported; motor, position, velocity and general are")
        element = self._filled(element, "main")
        robot = self._robot
        if not element.has("joint"):
            raise element.refuse("does not act on a joint, as motors do here")
        refuse_unread(element)
        joint = element.get("joint")
        robot.joint(joint, element)
        name = element.get("name", f"{joint} {element.tag}")
        limited = element.get("ctrllimited", "auto")
        limits = [-np.inf, np.inf]
        if limited == "true" or (limited == "auto" and self.has_auto_limits and element.has("ctrlrange")):
            limits = [float(x) for x in element.numbers("ctrlrange", None, (2,))]
        if element.has("forcerange"):
            robot.left_out.append(f"the range of the force of actuator '{name}'")
        drive = Input(name, lower=limits[0], upper=limits[1])
        gear = float(element.numbers("gear", "1")[0])
        robot.inputs.append(drive)
        taken = any(name == other.name for link in robot.links for other in link.joints)
        force_name = f"{name} {element.tag}" if taken else name
        robot.forces.append(((joint,), actuator_law(force_name, drive, gear, self._gains(element))))

    @staticmethod
    def _gains(element: XmlElement) -> tuple[float, float, float, float]:
        """Factors of the input, of the coordinate and of its rate in the force of an actuator, and its constant."""
        if element.tag == "motor":
            return 1.0, 0.0, 0.0, 0.0
        if element.tag == "position":
            return element.number("kp", "1"), -element.number("kp", "1"), -element.number("kv", "0"), 0.0
        if element.tag == "velocity":
            return element.number("kv", "1"), 0.0, -element.number("kv", "1"), 0.0
        for attribute, known in (("dyntype", ("none",)), ("gaintype", ("fixed",)), ("biastype", ("none", "affine"))):
            if element.get(attribute, known[0]) not in known:
                raise element.refuse(f"has the {attribute} '{element.get(attribute)}'; it must be {' or '.join(known)}")
        gain = float(element.numbers("gainprm", "1")[0])
        bias = np.zeros(3)
        if element.get("biastype", "none") == "affine":
            values = element.numbers("biasprm", "0")[:3]
            bias[: values.size] = values
        return gain, float(bias[1]), float(bias[2]), float(bias[0])


def _coupling(name: str, references: Sequence[float], polynomial: Sequence[float]) -> Law:
    """``y - y0 = a0 + a1 (x - x0) + …``."""

    def law(coordinates: Sequence[Coordinate]) -> Constraint:
        first, *others = (c.value - r for c, r in zip(coordinates, references, strict=True))
        x = others[0] if others else ca.SX(0)
        return Constraint(name, first - sum(a * x**k if k else a for k, a in enumerate(polynomial)))

    return law


def _to_z(z: np.ndarray) -> np.ndarray:
    """Rotation that brings the z axis into a direction (3, 3)."""
    axis = np.cross([0.0, 0.0, 1.0], z)
    size = float(np.linalg.norm(axis))
    if size < 1e-12:
        return np.eye(3) if z[2] > 0 else np.diag([1.0, -1.0, -1.0])
    return rotation_around(axis / size, float(np.arctan2(size, z[2])))
