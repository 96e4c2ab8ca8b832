"""What one is told about a body or an element that one points at."""

from __future__ import annotations

from functools import singledispatch
from typing import Any

import casadi as ca

from ...model.bodies import Body
from ...model.drivers import Driver
from ...model.forces.applied import Force, Torque
from ...model.forces.contact.contact import Contact
from ...model.forces.motors import DCMotor
from ...model.forces.springs import RSDA, TSDA
from ...model.forces.stops import Rope
from ...results.columns import effort_unit, reaction_body


@singledispatch
def readings(thing: Any, multipliers: bool) -> dict[str, ca.SX]:
    """Scalars by label, the unit after a comma; of a joint its reaction, where multipliers are known."""
    if not multipliers or not hasattr(thing, "reaction_on"):
        return {}
    body = reaction_body(thing)
    if body is None:
        return {}
    reaction = thing.reaction_on(body)
    return {
        f"force on {body.name}, x, N": reaction.force[0],
        f"force on {body.name}, y, N": reaction.force[1],
        f"couple on {body.name}, N m": ca.SX(reaction.torque),
    }


@readings.register
def _body(thing: Body, multipliers: bool) -> dict[str, ca.SX]:
    return {
        "x, m": thing.x, "y, m": thing.y, "phi, rad": thing.phi,
        "vx, m/s": thing.vx, "vy, m/s": thing.vy, "omega, rad/s": thing.omega,
    }  # fmt: skip


@readings.register
def _driver(thing: Driver, multipliers: bool) -> dict[str, ca.SX]:
    if not multipliers or thing.multipliers.numel() != 1:
        return {}
    return {f"effort, {effort_unit(thing)}": thing.effort}


@readings.register
def _force(thing: Force, multipliers: bool) -> dict[str, ca.SX]:
    return {"force, x, N": thing.force[0], "force, y, N": thing.force[1]}


@readings.register(Torque)
@readings.register(DCMotor)
def _torque(thing: Any, multipliers: bool) -> dict[str, ca.SX]:
    return {"torque, N m": ca.SX(thing.torque)}


@readings.register
def _spring(thing: TSDA, multipliers: bool) -> dict[str, ca.SX]:
    return {"length, m": thing.length, "tension, N": ca.SX(thing.force)}


@readings.register
def _rope(thing: Rope, multipliers: bool) -> dict[str, ca.SX]:
    return {"slack, m": thing.gap, "tension, N": thing.tension}


@readings.register
def _torsion_spring(thing: RSDA, multipliers: bool) -> dict[str, ca.SX]:
    return {"angle, rad": thing.angle, "couple, N m": ca.SX(thing.torque)}


@readings.register
def _contact(thing: Contact, multipliers: bool) -> dict[str, ca.SX]:
    return {"gap, m": thing.gap, "normal force, N": thing.normal_force, "friction, N": thing.friction_force}
