"""A mechanism whose exact dry friction is a force to be found, or in a mode: what optimal control makes of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca

from ...errors import ModelError
from ...model.conditions import Condition
from ...model.element import Element
from ...model.forces.friction.joint_friction import FrictionInJoint, SlidingFriction
from ...model.forces.friction.modes import switching
from ...model.mechanism import Mechanism
from ...model.symbols import Input, Parameter

#: Sign of the sliding speed in a mode.
SENSE = {"forth": 1.0, "back": -1.0, "sticks": 0.0}


@dataclass(frozen=True)
class Replaced:
    """A mechanism with something in place of its exact friction, and what that says.

    Attributes
    ----------
    mechanism : Mechanism
        With the replaced elements, and an input for each friction whose force is to be found.
    forces : dict
        Force of each friction against its sliding speed, N: what stands for its multiplier.
    inputs : dict
        Inputs by friction.
    """

    mechanism: Mechanism
    forces: dict[FrictionInJoint, ca.SX]
    inputs: dict[FrictionInJoint, Input]

    def of(self, expression: ca.SX) -> ca.SX:
        """Return an expression of the whole mechanism in symbols of this one."""
        symbols = ca.vertcat(*[f.multipliers for f in self.forces])
        return ca.substitute(expression, symbols, ca.vertcat(*self.forces.values()))

    def conditions(self, given: Sequence[Any]) -> tuple[Any, ...]:
        """Return conditions in symbols of this mechanism; those that are soft stay as they are."""
        return tuple(self._condition(c) if isinstance(c, Condition) else c for c in given)

    def _condition(self, c: Condition) -> Condition:
        opposite = None if c.opposite is None else self._condition(c.opposite)
        return replace(c, expression=self.of(c.expression), opposite=opposite)

    def cone(self, friction: FrictionInJoint) -> list[Condition]:
        """Return the limits of the force of a friction, ``-μ N <= F <= μ N``."""
        limit, force = friction.sticking_limit, self.forces[friction]
        return [Condition(sign * force - limit, False, f"friction of {friction.name} at its limit") for sign in (1, -1)]


def replaced(mechanism: Mechanism, modes: Mapping[FrictionInJoint, str | None], more: Sequence[Any] = ()) -> Replaced:
    """Return a mechanism whose frictions each stick, slide "forth" or "back", or have a force that is free (None).

    Further parameters are listed in it, too.
    """
    elements: dict[Any, Element] = {}
    forces: dict[FrictionInJoint, ca.SX] = {}
    inputs: dict[FrictionInJoint, Input] = {}
    for friction, mode in modes.items():
        if mode is None:
            inputs[friction] = Input(f"{friction.name}.force")
            forces[friction] = -inputs[friction]
            elements[friction] = SlidingFriction(friction, ca.SX(inputs[friction]))
        else:
            elements[friction] = friction.in_mode(mode)
            forces[friction] = (
                elements[friction].multipliers if mode == "sticks" else SENSE[mode] * friction.sticking_limit
            )
    variant = mechanism.replace(
        forces=[elements.get(f, f) for f in mechanism.forces],
        inputs=[*mechanism.inputs, *inputs.values()],
        parameters=[*mechanism.parameters, *more],
    )
    return Replaced(variant, forces, inputs)


@dataclass(frozen=True)
class Relaxation:
    """Exact friction as a force within its limits, which does work of an amount that a share of typical ones bounds.

    ``-μ N <= F <= μ N``, and with the sliding speed s and a share σ that goes to zero
    ``s (μ N + F) <= σ P``, ``-s (μ N - F) <= σ P`` between any two points of an interval.
    """

    replaced: Replaced
    share: Parameter
    conditions: tuple[Condition, ...]


def relaxation(mechanism: Mechanism) -> Relaxation:
    """Return a mechanism with a free force in place of each exact friction, and the conditions on it.

    Raises
    ------
    ModelError
        If the coefficients of rest and of sliding differ, or it is not friction in a joint.
    """
    frictions = switching(mechanism)
    for friction in frictions:
        if not isinstance(friction, FrictionInJoint):
            raise ModelError(
                f"{friction.description}: optimal control takes exact dry friction in joints alone; "
                f"{friction.instead} here"
            )
        law: Any = friction.law
        if not ca.is_equal(ca.SX(law.coefficient), ca.SX(law.static_coefficient), 3):
            raise ModelError(
                f"{friction.description}: optimal control takes one coefficient of dry friction, and not a static one "
                "besides; leave static_coefficient out"
            )
    share = Parameter("share of sticking that may be missed", 1.0)
    whole = replaced(mechanism, dict.fromkeys(frictions), [share])
    conditions: list[Condition] = []
    for friction in frictions:
        conditions += [replace(c, across=()) for c in whole.cone(friction)]
        speed, limit, force = friction.sliding_speed, friction.sticking_limit, whole.inputs[friction]
        for sign, name in ((1, "forth"), (-1, "back")):
            moves, rest = sign * speed, limit + sign * force
            label = f"{friction.name} slides {name} or holds"
            conditions.append(Condition(moves * rest, False, label, across=(moves, rest, ca.SX(share))))
    return Relaxation(whole, share, tuple(conditions))
