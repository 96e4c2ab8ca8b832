"""A mechanism whose exact friction and rigid contacts are forces to be found, or in a mode, for optimal control."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from ...errors import ModelError
from ...model.conditions import Condition
from ...model.element import Element
from ...model.forces.active_rows import ActiveRows
from ...model.forces.contact.outlines import Circle, HalfPlane, HollowCircle, Point
from ...model.forces.contact.rigid import RigidContact
from ...model.forces.friction.joint_friction import FrictionInJoint, SlidingFriction
from ...model.forces.friction.modes import switching
from ...model.mechanism import Mechanism
from ...model.sites import Site
from ...model.sites import sites_of as sites_of_element
from ...model.symbols import Input, Parameter

#: Sign of the sliding speed in a mode.
SENSE = {"forth": 1.0, "back": -1.0}
#: Outlines whose distance from each other is smooth.
ROUND = (Circle, Point, HalfPlane, HollowCircle)


def sites_of(mechanism: Mechanism) -> tuple[Site, ...]:
    """Return exact frictions in joints, and places of rigid contacts.

    Raises
    ------
    ModelError
        For what sticks and slides elsewhere, for coefficients of rest and of sliding that differ, outlines whose gap is
        not smooth, and friction in a contact with restitution.
    """
    sites = list[Site]()
    for element in switching(mechanism):
        if isinstance(element, RigidContact):
            _check_contact(element)
        elif not isinstance(element, FrictionInJoint):
            raise ModelError(
                f"{element.description}: optimal control takes exact dry friction in joints and rigid contacts alone; "
                f"{element.instead} here"
            )
        sites += sites_of_element(element)
    for law, description in {(site.law, site.description) for site in sites if site.law is not None}:
        if not ca.is_equal(ca.SX(law.coefficient), ca.SX(law.static_coefficient), 3):
            raise ModelError(
                f"{description}: optimal control takes one coefficient of dry friction, and not a static one besides; "
                "leave static_coefficient out"
            )
    return tuple(sites)


def _check_contact(contact: RigidContact) -> None:
    plane = isinstance(contact.a, HalfPlane) or isinstance(contact.b, HalfPlane)
    if not plane and not (isinstance(contact.a, ROUND) and isinstance(contact.b, ROUND)):
        raise ModelError(
            f"{contact.description}: the gap between {contact.a.description} and {contact.b.description} is not "
            "smooth, which optimal control does not take; take points, circles, or anything on a HalfPlane, or a "
            "Contact with a stiffness"
        )
    if not ca.SX(contact.restitution).is_zero():
        raise ModelError(
            f"{contact.description}: optimal control takes rigid contacts without restitution; set restitution=0, or "
            "state the bounces by phases="
        )


@dataclass(frozen=True)
class Replaced:
    """A mechanism with something in place of its exact friction and rigid contacts, and what that says.

    Attributes
    ----------
    mechanism : Mechanism
        With the replaced elements, and an input for each force that is to be found.
    normal, friction : dict
        Normal force, and force along the sliding speed, of each site, N: what stands for its multipliers.
    rows : dict
        Rows that hold a site, by site and "normal" or "friction": the element, and their numbers in it.
    """

    mechanism: Mechanism
    normal: dict[Site, ca.SX]
    friction: dict[Site, ca.SX]
    rows: dict[tuple[Site, str], tuple[Any, int]]

    @property
    def multipliers(self) -> tuple[ca.SX, ca.SX]:
        """Multipliers of the whole mechanism, and what stands for them (k,)."""
        whole, values = [ca.SX(0, 1)], [ca.SX(0, 1)]
        for kind, forces in (("normal", self.normal), ("friction", self.friction)):
            for site, force in forces.items():
                whole.append(site.element.multipliers[site.row(kind)])
                values.append(-force)
        return ca.vertcat(*whole), ca.vertcat(*values)

    def of(self, expression: Any) -> ca.SX:
        """Return an expression of the whole mechanism in symbols of this one."""
        return ca.substitute(ca.SX(expression), *self.multipliers)

    def conditions(self, given: Sequence[Any]) -> tuple[Any, ...]:
        """Return conditions in symbols of this mechanism; those that are soft stay as they are."""
        return tuple(self._condition(c) if isinstance(c, Condition) else c for c in given)

    def _condition(self, c: Condition) -> Condition:
        opposite = None if c.opposite is None else self._condition(c.opposite)
        return replace(c, expression=self.of(c.expression), opposite=opposite)

    def limit(self, site: Site) -> ca.SX:
        """Return the largest friction of a site, N."""
        return self.of(site.law.coefficient * site.load)

    def cone(self, site: Site) -> list[Condition]:
        """Return the limits of the friction of a site, ``-μ N <= F <= μ N``."""
        force, limit = self.friction[site], self.limit(site)
        return [Condition(sign * force - limit, False, f"friction of {site.name} at its limit") for sign in (1, -1)]


def replaced(
    mechanism: Mechanism,
    modes: Mapping[Site, str],
    free: Collection[tuple[Site, str]] = (),
    more: Sequence[Any] = (),
) -> Replaced:
    """Return a mechanism whose sites are each in a mode, or "free": with forces that are inputs.

    What would be held by a row, but is `free`, by site and "normal" or "friction", has an input instead: other rows
    hold it. Further parameters are listed in the mechanism, too.
    """
    normal, friction = dict[Site, ca.SX](), dict[Site, ca.SX]()
    held, inputs = list[tuple[Site, str]](), list[Input]()

    def of_row(site: Site, kind: str, own: ca.SX) -> ca.SX:
        if modes[site] != "free" and (site, kind) not in free:
            held.append((site, kind))
            return own
        inputs.append(Input(f"{site.name}.{kind}", lower=0.0 if kind == "normal" else -np.inf))
        return ca.SX(inputs[-1])

    for site, mode in modes.items():
        load = site.load
        if site.place is not None:
            normal[site] = load = ca.SX(0) if mode == "open" else of_row(site, "normal", site.normal_force)
            friction[site] = ca.SX(0)
        if mode in SENSE:
            friction[site] = -SENSE[mode] * site.law.coefficient * load
        elif mode in ("sticks", "free") and site.law is not None:
            friction[site] = of_row(site, "friction", site.friction)
    elements: dict[Any, Element] = {}
    for element in dict.fromkeys(site.element for site in modes):
        own = [site for site in modes if site.element is element]
        if isinstance(element, RigidContact):
            elements[element] = _contact(element, own, held, normal, friction)
        else:
            (site,) = own
            sticks = (site, "friction") in held
            elements[element] = element.in_mode("sticks") if sticks else SlidingFriction(element, friction[site])
    joints, parts = ([elements.get(f, f) for f in listed] for listed in (mechanism.joints, mechanism.forces))
    holding = [f for f in parts if f.rows.numel()]
    variant = mechanism.replace(
        joints=[*joints, *holding],
        forces=[f for f in parts if f not in holding],
        inputs=[*mechanism.inputs, *inputs],
        parameters=[*mechanism.parameters, *more],
    )
    rows = {(site, kind): (elements[site.element], n) for site, kind, n in _numbers(held)}
    return Replaced(variant, normal, friction, rows)


def _numbers(held: Sequence[tuple[Site, str]]) -> list[tuple[Site, str, int]]:
    """Rows that are held, with their numbers in their elements: normal ones before those of friction."""
    ordered = [one for kind in ("normal", "friction") for one in held if one[1] == kind]
    return [(*one, [other for other in ordered if other[0].element is one[0].element].index(one)) for one in held]


def _contact(
    contact: RigidContact,
    sites: Sequence[Site],
    held: Collection[tuple[Site, str]],
    normal: Mapping[Site, ca.SX],
    friction: Mapping[Site, ca.SX],
) -> ActiveRows:
    """A rigid contact with some of its rows, and forces in place of the others."""
    closed = [site for site in sites if (site, "normal") in held]
    sticking = [site for site in sites if (site, "friction") in held]
    work = list[tuple[ca.SX, ca.SX]]()
    for site, place in zip(sites, contact.places, strict=True):
        forces = [
            ca.SX(0) if (site, kind) in held else force[site]
            for kind, force in (("normal", normal), ("friction", friction))
        ]
        if not all(force.is_zero() for force in forces):
            work += place.work_of(place.force(*forces))
    return ActiveRows(
        contact,
        rows=ca.vertcat(
            ca.SX(0, 1), *[p.held for p, site in zip(contact.places, sites, strict=True) if site in closed]
        ),
        velocity_rows=ca.vertcat(ca.SX(0, 1), *[site.sliding_speed for site in sticking]),
        chosen=[*(site.row("normal") for site in closed), *(site.row("friction") for site in sticking)],
        virtual_work=work,
    )


@dataclass(frozen=True)
class Relaxation:
    """Exact friction and contact as forces within their limits, which meet their laws up to shares of typical products.

    ``-μ N <= F <= μ N``, ``0 <= N``, ``0 <= g``, and with the sliding speed s and a share σ that goes to zero
    ``s (μ N + F) <= σ P``, ``-s (μ N - F) <= σ P``, ``g N <= σ W`` and, with the speed v at which a gap grows,
    ``v N <= σ P`` between any two points of an interval: impacts throw nothing.
    """

    replaced: Replaced
    sites: tuple[Site, ...]
    share: Parameter
    conditions: tuple[Condition, ...]

    @property
    def touches(self) -> bool:
        """True if there are contacts."""
        return any(site.place is not None for site in self.sites)


def relaxation(mechanism: Mechanism) -> Relaxation:
    """Return a mechanism with free forces in place of each exact friction and contact, and the conditions on them.

    A :class:`ModelError` is raised for what :func:`sites_of` refuses.
    """
    sites = sites_of(mechanism)
    share = Parameter("share of products that may be missed", 1.0)
    whole = replaced(mechanism, dict.fromkeys(sites, "free"), more=[share])
    conditions: list[Condition] = []

    def across(first: ca.SX, second: ca.SX, label: str) -> Condition:
        return Condition(first * second, False, label, across=(first, second, share))

    for site in sites:
        if site.place is not None:
            gap = gap_of(site)
            conditions.append(Condition(-gap, False, f"{site.name} is not passed", across=()))
            conditions.append(across(gap, whole.normal[site], f"{site.name} is open or closed"))
            parting = site.element.normal_speeds[site.place]
            conditions.append(across(parting, whole.normal[site], f"{site.name} does not throw"))
        if site.law is not None:
            conditions += [replace(c, across=()) for c in whole.cone(site)]
            speed, limit, force = site.sliding_speed, whole.limit(site), whole.friction[site]
            for name, sign in SENSE.items():
                label = f"{site.name} slides {name} or holds"
                conditions.append(across(sign * speed, limit + sign * force, label))
    return Relaxation(whole, sites, share, tuple(conditions))


def gap_of(site: Site) -> ca.SX:
    """Return the distance of the surfaces at a place of contact, m."""
    gap: ca.SX = site.element.gaps[site.place]
    return gap
