"""Assembly of mechanisms with exact friction: the state together with what sticks and what slides in it."""

from __future__ import annotations

from typing import Any

from ...assembly.initial_state import start_state
from ...assembly.setup import Setup
from ...errors import SingularityError
from ...model.mechanism import Mechanism
from ...results.state import State
from .friction_modes import FrictionModes


def assemble_with_friction(mechanism: Mechanism, conditions: Any, t: float, inputs: Any, parameters: Any) -> State:
    """As :func:`~mbdcasadi.assemble`; accelerations and reactions belong to the friction that the laws allow there."""
    setup = Setup(mechanism, "assemble", t=t, initial=conditions, inputs=inputs, parameters=parameters)
    modes = FrictionModes(setup)
    state = start_state(modes.numeric(modes.free), conditions, t, setup.signals)
    found = modes.holding(state, {})
    if found is not None:
        return modes.whole(*found)
    names = ", ".join(friction.description for friction in modes.frictions)
    obstacle = SingularityError(
        f"neither sticking nor sliding of {names} meets the laws of friction at t = {t:.6g} s: it jams", time=t
    )
    lam, a = modes.multipliers(modes.free, state)[0], state.a
    return State(mechanism, t, state.q, state.v, a, state.z, lam, state.inputs, state.parameters, obstacle)
