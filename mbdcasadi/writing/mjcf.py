"""Mechanisms as model files of MuJoCo (MJCF)."""

from __future__ import annotations

import re
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import casadi as ca
import numpy as np

from ..errors import ModelError, warn
from ..model.bodies import Body, Marker, ground
from ..model.expressions import norm
from ..model.forces.contact.contact import Contact
from ..model.forces.contact.outlines import Outline
from ..model.forces.field import Gravity
from ..model.forces.friction.joint_friction import JointFriction, LoadIndependentFriction
from ..model.forces.friction.laws import Coulomb, DryFriction
from ..model.forces.laws import HuntCrossley
from ..model.forces.stops import EndStop
from ..model.joints.lower_pairs import Distance, Revolute, Weld
from ..model.mechanism import Mechanism
from ..model.symbols import t
from ..numerics.tolerances import NEGLIGIBLE
from ..numerics.writing import whole_file
from ..simulation.assemble import assemble
from .joint_tree import JointTree, TreeJoint
from .linear_laws import LinearLaw, Samples
from .mjcf_geoms import geom_of

_WHAT = "write_mjcf"


def write_mjcf(mechanism: Mechanism, path: str | Path) -> None:
    """Write a mechanism as a model file of MuJoCo.

    The plane is that of x and z, with gravity as the mechanism has it; the pose of the file is that of
    :func:`assemble`, at the values that parameters have. Joints of a tree, which takes slides and welds before pins,
    are hinges and slides with the coordinates of the mechanism, a body without joints has the slides ``body x``, ``body
    y`` and the hinge ``body angle``, a :class:`PointOnLine` a hinge ``name turn`` besides. What is left of the joints
    are equalities: ``connect`` for pins, ``weld``, lengths that stay as a tendon between two sites, and ``joint`` or
    ``tendon`` for whatever is linear in coordinates, such as gears.

    Forces by their laws: what is linear in a coordinate and its rate is the stiffness and damping of a joint or of a
    tendon, what is linear in one input an actuator of its name; a rotor that is geared to one joint alone is its
    armature. Two :class:`EndStop` on a coordinate, or one on a length, are a range, :class:`LoadIndependentFriction` is
    ``frictionloss``, a :class:`Contact` a pair of geoms without masses.

    Parameters
    ----------
    mechanism : Mechanism
        It.
    path : str or Path
        The file.

    Raises
    ------
    ModelError
        For an element without a counterpart in the format, by name, with what to do.

    Warns
    -----
    MechanismWarning
        For what is left out: laws of contacts, stops and friction, which MuJoCo and :func:`read_mjcf` replace by
        theirs, constraints that other joints hold already, inputs that act nowhere, and their limits on one side only.

    See Also
    --------
    read_mjcf : reads it again; bodies that are welded to others are one with them then.

    Examples
    --------
    ::

        mbd.write_mjcf(mechanism, "machine.xml")
        again = mbd.read_mjcf("machine.xml")
    """
    root = _Writer(mechanism).document()
    ET.indent(root)
    with whole_file(Path(path)) as part:
        part.write_bytes(ET.tostring(root, encoding="utf-8") + b"\n")


def _refusal(element: Any, why: str, remedy: str) -> ModelError:
    return ModelError(f"{_WHAT}: {element.description} {why}; {remedy}")


_LEAVE = "leave it out with mechanism.replace, and apply its force by a program in MuJoCo"


def _text(*numbers: Any) -> str:
    return " ".join(repr(float(x) + 0.0) for x in numbers)


def _in_space(vector: Any) -> str:
    """A vector of the plane, as text."""
    return _text(vector[0], 0.0, vector[1])


def _name_of_tendon(element: Any) -> str:
    """Name of the tendon along which an element acts, as read_mjcf names springs and stops."""
    return str(re.sub(r"^tendon (.*) (spring and damper|(lower|upper) (stop|spring))$", r"\1", element.name))


def _way(element: Any) -> ca.SX:
    """Length from marker to marker of an element, m."""
    return sum((norm(b.position - a.position) for a, b in pairwise(element.markers)), ca.SX(0))


def _turn(angle: Any) -> str:
    """A turn in the plane, counter-clockwise, as a quaternion."""
    return _text(np.cos(angle / 2), 0, -np.sin(angle / 2), 0)


@dataclass(frozen=True, eq=False)
class _Term:
    """A force along a coordinate: factors of joints (n,), or a length from marker to marker."""

    element: Any
    name: str
    along: np.ndarray | tuple[Marker, ...]
    law: LinearLaw


class _Writer:
    """One file."""

    def __init__(self, mechanism: Mechanism):
        self.mechanism, self.state = mechanism, assemble(mechanism)
        if mechanism.states or mechanism.coordinates:
            element = next((each for each in mechanism.elements if each.rates or each.coordinates), None)
            owner = f"{element.description} has" if element is not None else "the mechanism has"
            raise ModelError(f"{_WHAT}: {owner} states or coordinates besides those of bodies; leave them out")
        self.tree = JointTree(mechanism, self.state, _WHAT)
        self.samples = Samples(self.tree)
        self.root = ET.Element("mujoco", model=mechanism.name or "mechanism")
        ET.SubElement(self.root, "compiler", angle="radian")
        self.option = ET.SubElement(self.root, "option")
        self.bodies: dict[Body, ET.Element] = {ground: ET.SubElement(self.root, "worldbody")}
        self.joints: dict[TreeJoint, ET.Element] = {}
        self.sections = {name: ET.Element(name) for name in ("tendon", "equality", "contact", "actuator")}
        #: limits of the lower (1) and upper (-1) end, by the joint or tendon, and the stiffness of linear springs
        self.stops: dict[tuple[ET.Element, float | None], dict[int, float]] = {}
        #: tendons by what they run along
        self.tendons: dict[tuple[Any, ...], ET.Element] = {}
        #: sums of stiffness, of stiffness times rest, and of damping by joint
        self.springs = {joint: np.zeros(3) for joint in self.tree.joints}
        self.terms: list[_Term] = []
        #: names of geoms by their bodies and attributes
        self.geoms: dict[tuple[Any, ...], str] = {}
        self.left_out: list[str] = []

    def document(self) -> ET.Element:
        """Return the outermost element."""
        self._write_bodies()
        gravity = np.zeros(2)
        for force in self.mechanism.forces:
            if isinstance(force, Gravity):
                gravity += self.state[force.acceleration]
            elif isinstance(force, EndStop):
                self._stop(force)
            elif isinstance(force, LoadIndependentFriction):
                self._rub(force)
            elif isinstance(force, Contact):
                self._touch(force)
            elif isinstance(force, JointFriction):
                raise _refusal(force, "depends on the reaction of its joint", "take a LoadIndependentFriction")
            else:
                self._force(force)
        self.option.set("gravity", _in_space(gravity))
        for element in (*self.mechanism.joints, *self.mechanism.drivers):
            if element not in self.tree.elements and (element.rows.numel() or element.velocity_rows.numel()):
                self._constraint(element)
        for body in self.mechanism.bodies:
            if body in self.bodies and min(float(self.state[ca.SX(x)]) for x in (body.mass, body.inertia)) <= 0:
                raise _refusal(body, "has no mass or no inertia, which MuJoCo does not take", "give it some")
        self._write_actuators()
        self._write_springs()
        self._write_ranges()
        self.root.extend(section for section in self.sections.values() if len(section))
        if self.left_out:
            warn(f"{_WHAT}: left out {'; '.join(dict.fromkeys(self.left_out))}")
        return self.root

    # --- the tree -----------------------------------------------------------------------------
    def _write_bodies(self) -> None:
        for body in self.tree.bodies:
            if body.name == "world":
                raise _refusal(body, "has the name of the ground in MuJoCo", "give it another one")
            above = self.tree.carrier[body]
            place = self.state[above.axes.T @ (body.position - above.position)]
            element = self.bodies[body] = ET.SubElement(
                self.bodies[above], "body", name=body.name, pos=_in_space(place),
                quat=_turn(self.state[body.phi - above.phi]),
            )  # fmt: skip
            for joint in self.tree.joints_of(body):
                is_hinge = joint.kind == "hinge"
                axis = _text(0, -joint.direction[0], 0) if is_hinge else _in_space(joint.direction)
                self.joints[joint] = ET.SubElement(
                    element, "joint", name=joint.name, type=joint.kind, pos=_in_space(joint.place), axis=axis,
                    ref=_text(joint.reference),
                )  # fmt: skip
            mass, inertia = (float(self.state[ca.SX(x)]) for x in (body.mass, body.inertia))
            ET.SubElement(element, "inertial", pos="0 0 0", mass=_text(mass), diaginertia=_text(*[inertia] * 3))

    def _site(self, marker: Marker, name: str) -> str:
        ET.SubElement(self.bodies[marker.body], "site", name=name, pos=_in_space(self.tree.local(marker)))
        return name

    def _tendon(self, name: str, along: np.ndarray | tuple[Marker, ...]) -> ET.Element:
        """The tendon along factors of joints, or from marker to marker; a new one if there is none."""
        section, is_path = self.sections["tendon"], isinstance(along, tuple)
        places = [(marker.body, *self.tree.local(marker)) for marker in along] if isinstance(along, tuple) else along
        if (key := tuple(places)) in self.tendons:
            return self.tendons[key]
        while any(other.get("name") == name for other in section):
            name += " tendon"
        tendon = self.tendons[key] = ET.SubElement(section, "spatial" if is_path else "fixed", name=name)
        if isinstance(along, tuple):
            for place, marker in enumerate(along, start=1):
                ET.SubElement(tendon, "site", site=self._site(marker, f"{name} {place}"))
            return tendon
        for joint, factor in zip(self.tree.joints, along, strict=True):
            if factor:
                ET.SubElement(tendon, "joint", joint=joint.name, coef=_text(factor))
        return tendon

    def _single(self, along: np.ndarray | tuple[Marker, ...]) -> tuple[TreeJoint, float] | None:
        """The joint and its factor, if a coordinate is a multiple of that of one joint."""
        if isinstance(along, tuple) or np.count_nonzero(along) != 1:
            return None
        place = int(np.flatnonzero(along)[0])
        return self.tree.joints[place], float(along[place])

    # --- forces -------------------------------------------------------------------------------
    def _force(self, element: Any) -> None:
        if element.multipliers.numel() or element.velocity_rows.numel():
            raise _refusal(element, "switches constraints, which MuJoCo does not", _LEAVE)
        for displacement, force in element.virtual_work:
            for e, f in zip(ca.vertsplit(ca.vec(displacement)), ca.vertsplit(ca.vec(ca.SX(force))), strict=True):
                self._component(element, e, f)

    def _component(self, element: Any, e: ca.SX, f: ca.SX) -> None:
        """Add a force along an expression."""
        along: Any = self.samples.factors(e)
        if along is None and len(element.markers) > 1:
            values = self.samples.of(e, _way(element))
            is_length = values is not None and np.allclose(values[0], values[1], rtol=NEGLIGIBLE, atol=0)
            along = element.markers if is_length else None
        if isinstance(along, np.ndarray) and not np.any(along):
            return
        law = None if along is None else self.samples.law(f, e if isinstance(along, tuple) else along)
        if law is None:
            raise _refusal(
                element, "is not linear in the coordinates of joints, distances of points, their rates and inputs",
                _LEAVE,
            )  # fmt: skip
        count = sum(term.element is element for term in self.terms)
        name = _name_of_tendon(element)
        self.terms.append(_Term(element, f"{name} {count + 1}" if count else name, along, law))

    def _write_actuators(self) -> None:
        for place, drive in enumerate(self.mechanism.inputs):
            uses = [term for term in self.terms if term.law.gains[place]]
            if not uses:
                self.left_out.append(f"the input '{drive.label}', which acts nowhere")
                continue
            attributes = {"name": drive.label}
            if np.isfinite([drive.lower, drive.upper]).all():
                attributes["ctrlrange"] = _text(drive.lower, drive.upper)
            elif np.isfinite([drive.lower, drive.upper]).any():
                self.left_out.append(f"the limit of the input '{drive.label}' on one side")
            term = uses[0]
            along, gain = term.along, float(term.law.gains[place])
            if len(uses) > 1:
                sums = [use.law.gains[place] * use.along for use in uses if isinstance(use.along, np.ndarray)]
                if len(sums) < len(uses):
                    raise _refusal(
                        term.element, f"shares the input '{drive.label}' with another, and one acts along a distance",
                        "give each an input of its own",
                    )  # fmt: skip
                along, gain = np.sum(sums, axis=0), 1.0
            carries = len(uses) == 1 and np.count_nonzero(term.law.gains) == 1
            self._actuator(attributes, along, gain, term.law if carries else None)
            if carries:
                self.terms.remove(term)

    def _actuator(self, attributes: dict[str, str], along: Any, gain: float, law: LinearLaw | None) -> None:
        """Add an actuator, with a law that it carries besides."""
        single, gear = self._single(along), 1.0
        if single is None:
            attributes["tendon"] = self._tendon(attributes["name"], along).get("name", "")
        else:
            attributes["joint"], gear = single[0].name, single[1]
        if law is None or not (law.constant or law.stiffness or law.damping):
            ET.SubElement(self.sections["actuator"], "motor", attributes, gear=_text(gain * gear))
            return
        ET.SubElement(
            self.sections["actuator"], "general", attributes, gear=_text(gear), gainprm=_text(gain),
            biastype="affine", biasprm=_text(law.constant, -law.stiffness, -law.damping),
        )  # fmt: skip

    def _write_springs(self) -> None:
        for term in self.terms:
            law, single = term.law, self._single(term.along)
            if min(law.stiffness, law.damping) < 0:
                raise _refusal(term.element, "has a negative stiffness or damping", "make it an Input of a controller")
            if law.constant and not law.stiffness:
                raise _refusal(term.element, "holds a constant force", "make that an Input with this value")
            if single is not None:
                joint, factor = single
                self.springs[joint] += law.stiffness * factor**2, law.constant * factor, law.damping * factor**2
            elif law.stiffness or law.damping:
                self._spring(term, law)
        for joint, (stiffness, pull, damping) in self.springs.items():
            if damping:
                self.joints[joint].set("damping", _text(damping))
            if stiffness:
                self.joints[joint].set("stiffness", _text(stiffness))
                self.joints[joint].set("springref", _text(pull / stiffness))

    def _spring(self, term: _Term, law: LinearLaw) -> None:
        """Add a tendon with a spring and a damper; its free length is not negative."""
        rest = law.constant / law.stiffness if law.stiffness else 0.0
        along = term.along
        if rest < 0:
            if isinstance(along, tuple):
                raise _refusal(term.element, "has a negative free length", "give it one above zero")
            along, rest = -along, -rest
        tendon = self._tendon(term.name, along)
        if tendon.get("damping"):  # of another spring
            self.tendons.clear()
            tendon = self._tendon(term.name, along)
        tendon.set("damping", _text(law.damping))
        if law.stiffness:
            tendon.set("stiffness", _text(law.stiffness))
            tendon.set("springlength", _text(rest))

    # --- limits and friction ------------------------------------------------------------------
    def _stop(self, stop: EndStop) -> None:
        factors = self.samples.factors(stop.gap) if stop.gap.is_scalar() else None
        single = None if factors is None else self._single(factors)
        if single is not None:
            limited, reference, factor = self.joints[single[0]], single[0].reference, single[1]
        elif factors is not None:
            factor = -1.0 if tuple(-factors) in self.tendons else 1.0
            name = _name_of_tendon(stop)
            limited = self._tendon(name, factor * factors)
            reference = float(factor * factors @ [joint.reference for joint in self.tree.joints])
        else:
            way = _way(stop)
            factor = next((sign for sign in (1.0, -1.0) if self._is_constant(stop.gap - sign * way, way)), 0.0)
            if not factor or len(stop.markers) < 2:
                raise _refusal(stop, "is no stop on the coordinate of a joint of the tree, or on a length", _LEAVE)
            limited, reference = self._tendon(_name_of_tendon(stop), stop.markers), float(self.state[way])
        stiffness = None if limited.tag == "joint" else self._stiffness(stop)
        ends = self.stops.setdefault((limited, stiffness), {})
        if int(np.sign(factor)) in ends:
            raise _refusal(stop, f"is a second stop of '{limited.get('name')}' on this side", _LEAVE)
        ends[int(np.sign(factor))] = reference - float(self.state[stop.gap]) / factor
        if stiffness is None:
            self._replaced()

    def _stiffness(self, stop: EndStop) -> float | None:
        """Stiffness of a stop that is a linear spring, which tendons have with play; None of another law."""
        law: Any = stop.law
        if not isinstance(law, HuntCrossley) or self._constant(ca.SX(law.exponent)) != 1:
            return None
        return self._constant(ca.SX(law.stiffness)) if self._constant(ca.SX(law.damping)) == 0 else None

    def _write_ranges(self) -> None:
        for (limited, stiffness), ends in self.stops.items():
            if limited.tag == "spatial":
                ends.setdefault(1, 0.0)
            what = f"{_WHAT}: {limited.tag} '{limited.get('name')}'"
            if len(ends) < 2:
                raise ModelError(
                    f"{what} has a stop on one side, and a range of MuJoCo has two ends; add an EndStop on the other "
                    "side, as far as it may be"
                )
            if ends[1] > ends[-1]:
                raise ModelError(
                    f"{what} has stops that overlap, the lower one at {ends[1]:g} and the upper one at {ends[-1]:g}, "
                    "and a range of MuJoCo goes upwards; move them apart"
                )
            if stiffness is None:
                limited.set("range", _text(ends[1], ends[-1]))
                continue
            if limited.get("stiffness"):
                raise ModelError(f"{what} has several springs, of which one has play; make one of them a joint's")
            limited.set("stiffness", _text(stiffness))
            limited.set("springlength", _text(ends[1], ends[-1]))

    def _rub(self, friction: LoadIndependentFriction) -> None:
        joint = next((x for x in self.tree.joints if x.name == friction.joint.name), None)
        lever = 1.0 if friction.radius is None else friction.radius
        bound = self._constant(self._coefficient(friction, friction.law) * friction.load * lever)
        if joint is None or bound is None:
            raise _refusal(friction, "is no constant dry friction of a joint of the tree", _LEAVE)
        known = float(self.joints[joint].get("frictionloss", "0"))
        self.joints[joint].set("frictionloss", _text(known + bound))
        self._replaced()

    def _coefficient(self, element: Any, law: Any) -> ca.SX:
        if not isinstance(law, Coulomb | DryFriction):
            raise _refusal(element, f"has the law {type(law).__name__}", "take Coulomb, which MuJoCo has for friction")
        return ca.SX(law.coefficient)

    def _constant(self, expression: ca.SX) -> float | None:
        """Value of an expression that does not vary; None if it does."""
        values = self.samples.of(expression)
        return float(values[0, 0]) if values is not None and self._is_constant(expression, expression) else None

    def _is_constant(self, expression: ca.SX, scale: ca.SX) -> bool:
        """Return True if an expression does not vary, compared with another one."""
        values = self.samples.of(expression, scale)
        return values is not None and bool(np.ptp(values[0]) <= NEGLIGIBLE * np.max(np.abs(values[1])))

    def _replaced(self) -> None:
        self.left_out.append(
            "the laws of contacts, stops and friction, in place of which MuJoCo and read_mjcf have theirs"
        )

    def _touch(self, contact: Contact) -> None:
        """Add a pair of geoms."""
        names = contact.name.split(" on ")  # as read_mjcf names contacts
        names = names if len(names) == 2 else [f"{contact.name} a", f"{contact.name} b"]
        geoms = [self._geom(contact, *each) for each in zip((contact.a, contact.b), names, strict=True)]
        pair = {"geom1": geoms[0], "geom2": geoms[1], "condim": "1"}
        if contact.friction is not None:
            bound = self._constant(self._coefficient(contact, contact.friction))
            if bound is None:
                raise _refusal(contact, "has a coefficient of friction that varies", "give it a constant one")
            pair |= {"condim": "3", "friction": _text(bound, bound)}
        ET.SubElement(self.sections["contact"], "pair", pair)
        self._replaced()

    def _geom(self, contact: Contact, outline: Outline, name: str) -> str:
        """Add the geom of an outline, without a mass, unless it is there; return its name."""
        shape = geom_of(outline, self.state)
        if shape is None:
            raise _refusal(
                contact, f"has a {type(outline).__name__} that is no geom of MuJoCo",
                "take circles, rectangles about their markers, thick segments and half-planes on the ground, or leave "
                "it out",
            )  # fmt: skip
        kind, size, turn = shape
        turn += float(self.state[outline.marker.local_angle])
        attributes = {"type": kind, "size": _text(*size), "pos": _in_space(self.tree.local(outline.marker))}
        if kind in ("plane", "capsule"):
            attributes["zaxis"] = _in_space((np.cos(turn), np.sin(turn)))
        elif kind == "box":
            attributes["quat"] = _turn(turn)
        key = outline.marker.body, *attributes.items()
        if key not in self.geoms:
            taken = name in self.geoms.values()
            self.geoms[key] = f"{contact.name} {name}" if taken else name
            ET.SubElement(self.bodies[outline.marker.body], "geom", {"name": self.geoms[key]} | attributes, mass="0",
                          contype="0", conaffinity="0")  # fmt: skip
        return self.geoms[key]

    # --- constraints --------------------------------------------------------------------------
    def _constraint(self, element: Any) -> None:
        """Add an equality, or the armature of a joint; none for what the tree holds already."""
        rows = self.samples.of(element.rows) if element.rows.numel() and not element.velocity_rows.numel() else None
        if rows is not None and np.max(np.abs(rows)) < NEGLIGIBLE:
            self.left_out.append(f"{element.description}, which the other joints hold already")
            return
        if isinstance(element, Revolute | Weld):
            names = ["world" if each.body.is_ground else each.body.name for each in (element.a, element.b)]
            attributes = {"name": element.name, "body1": names[0], "body2": names[1]}
            if isinstance(element, Revolute):
                attributes["anchor"] = _in_space(self.tree.local(element.a))
            ET.SubElement(self.sections["equality"], "connect" if "anchor" in attributes else "weld", attributes)
            return
        if isinstance(element, Distance) and self.samples.of(element.distance) is not None:
            self._hold(element.name, (element.a, element.b))
            return
        if ca.depends_on(element.rows, t):
            raise _refusal(element, "prescribes a motion in time", "take a force with an Input in its place")
        if element.velocity_rows.numel():
            raise _refusal(element, "holds velocities alone, which MuJoCo does not", "leave it out")
        rows = ca.vertsplit(element.rows)
        for row, name in zip(rows, element.row_labels or range(1, len(rows) + 1), strict=True):
            factors = self.samples.factors(row)
            if factors is None:
                raise _refusal(
                    element, "is neither a pin, a weld or a constant length, nor linear in coordinates of joints",
                    "take it out, or put a body between that slides on one and turns on the other",
                )  # fmt: skip
            if len(rows) == 1 and self._is_armature(row, factors):
                return
            self._couple(element.name if len(rows) == 1 else f"{element.name} {name}", factors)

    def _couple(self, name: str, factors: np.ndarray) -> None:
        """Hold a sum of coordinates at its value in the pose of the file."""
        places = np.flatnonzero(factors)
        joints = [self.tree.joints[k] for k in places]
        if len(joints) > 2:
            self._hold(name, factors)
        elif joints:
            ratio = -factors[places[-1]] / factors[places[0]] if len(joints) == 2 else 0.0
            coupled = {"joint2": joints[1].name} if len(joints) == 2 else {}
            ET.SubElement(
                self.sections["equality"], "joint", {"name": name, "joint1": joints[0].name} | coupled,
                polycoef=_text(0, ratio, 0, 0, 0),
            )  # fmt: skip

    def _hold(self, name: str, along: np.ndarray | tuple[Marker, ...]) -> None:
        tendon = self._tendon(name, along).get("name", "")
        ET.SubElement(self.sections["equality"], "tendon", name=name, tendon1=tendon, polycoef="0 0 0 0 0")

    def _is_armature(self, row: ca.SX, factors: np.ndarray) -> bool:
        """Put the inertia of a rotor, which turns by a multiple of one coordinate, in the place of its body.

        A rotor is a body on a pin, without mass, or with its centre of mass on a pin to the ground, on which nothing
        else acts.
        """
        for place, rotor in enumerate(self.tree.joints):
            if factors[place] and self._may_be_rotor(rotor):
                rest = self.samples.factors(row - factors[place] * rotor.direction[0] * rotor.body.phi)
                single = None if rest is None else self._single(rest)
                if single is not None:
                    joint, ratio = single[0], single[1] / factors[place]
                    inertia = float(self.state[ca.SX(rotor.body.inertia)]) * ratio**2
                    known = float(self.joints[joint].get("armature", "0"))
                    self.joints[joint].set("armature", _text(known + inertia))
                    self.bodies[self.tree.carrier[rotor.body]].remove(self.bodies.pop(rotor.body))
                    return True
        return False

    def _may_be_rotor(self, joint: TreeJoint) -> bool:
        body, elements = joint.body, (*self.mechanism.joints, *self.mechanism.drivers, *self.mechanism.forces)
        acting = [each for each in elements if body in each.bodies and each not in self.tree.elements]
        is_light = float(self.state[ca.SX(body.mass)]) == 0
        return (
            joint.kind == "hinge"
            and len(self.tree.joints_of(body)) == len(acting) == 1
            and body not in self.tree.carrier.values()
            and (is_light or (self.tree.carrier[body].is_ground and not np.any(joint.place)))
        )
