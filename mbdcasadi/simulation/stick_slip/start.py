"""Start of mechanisms with exact friction: the state together with what sticks and what slides in it."""

from __future__ import annotations

from ...assembly.assemble import decide_friction_by
from ...assembly.consistent_start import consistent_start
from ...assembly.setup import Setup
from ...errors import SingularityError
from ...results.state import State
from .friction_modes import FrictionModes


def start_with_friction(setup: Setup) -> State:
    """Find the consistent start; accelerations and reactions belong to the friction that the laws allow there."""
    modes = FrictionModes(setup)
    time = float(setup.grid[0])
    state = consistent_start(modes.numeric(modes.free), setup.initial, time, setup.signals)
    found = modes.holding(state, {})
    if found is not None:
        return modes.whole(*found)
    names = ", ".join(friction.description for friction in modes.frictions)
    obstacle = SingularityError(
        f"neither sticking nor sliding of {names} meets the laws of friction at t = {time:.6g} s: it jams", time=time
    )
    lam, a = modes.multipliers(modes.free, state)[0], state.a
    return State(setup.mechanism, time, state.q, state.v, a, state.z, lam, state.inputs, state.parameters, obstacle)


decide_friction_by(start_with_friction)
