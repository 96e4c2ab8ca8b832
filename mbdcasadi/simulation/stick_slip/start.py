"""Assembly of mechanisms with exact friction: the state together with what sticks and what slides in it."""

from __future__ import annotations

from typing import Any

from ...assembly.state import assemble_mechanism
from ...errors import SingularityError
from ...model.mechanism import Mechanism
from ...results.state import State
from .friction_modes import ModesOfFriction


def assemble_with_friction(mechanism: Mechanism, conditions: Any, t: float, inputs: Any, parameters: Any) -> State:
    """As :func:`~mbdcasadi.assemble`; accelerations and reactions belong to the friction that the laws allow there."""
    modes = ModesOfFriction(mechanism, parameters, lambda _: inputs)
    state = assemble_mechanism(modes.variant(modes.free), conditions, t, inputs, parameters)
    found = modes.decided(state, {})
    if found is not None:
        return modes.whole(*found)
    names = ", ".join(friction.description for friction in modes.frictions)
    obstacle = SingularityError(
        f"neither sticking nor sliding of {names} meets the laws of friction at t = {t:.6g} s: it jams", time=t
    )
    lam, a = modes.multipliers(modes.free, state)[0], state.a
    return State(mechanism, t, state.q, state.v, a, state.z, lam, state.inputs, state.parameters, obstacle)
