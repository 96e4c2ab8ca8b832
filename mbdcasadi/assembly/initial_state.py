"""The start of an analysis: a state that was given, or one assembled from conditions."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..arguments.inputs import Signals
from ..equations.numeric import NumericEquations
from ..errors import SimulationError
from ..model.mechanism import Mechanism
from ..results.state import State
from .state import assemble_at, complete_state

#: A start given as a State may miss the constraints by this much (m, rad, and their rates).
CONSISTENT = 1e-6


def carried_by(initial: Any, mechanism: Mechanism) -> dict[str, dict]:
    """Parameters and inputs that a state brings along, where the mechanism has them."""
    if not isinstance(initial, State):
        return {"parameters": {}, "inputs": {}}
    theirs = initial.mechanism
    found = {}
    for name, symbols, values, own in (
        ("parameters", theirs.parameters, initial.parameters, mechanism.parameters),
        ("inputs", theirs.inputs, initial.inputs, mechanism.inputs),
    ):
        found[name] = {s: float(x) for s, x in zip(symbols, values, strict=True) if any(s is o for o in own)}
    return found


def start_state(numeric: NumericEquations, initial: Any, time: float, signals: Signals) -> State:
    """Consistent state at a time; a state that breaks the constraints is refused."""
    if not isinstance(initial, State):
        return assemble_at(numeric, initial, time, signals)
    eom = numeric.eom
    q, v = np.atleast_1d(initial[eom.q]), np.atleast_1d(initial[eom.v])
    z = np.atleast_1d(initial[eom.z]) if eom.z.numel() else np.zeros(0)
    phi, _ = numeric.position(time, q)
    jacobian, nu = numeric.velocity(time, q)
    rows = np.r_[np.abs(phi), np.abs(jacobian @ v - nu)]
    names = [eom.row_names[k] for k in eom.position_rows] + list(eom.row_names)
    if rows.size and np.max(rows) > CONSISTENT:
        worst = int(np.argmax(rows))
        level = "position" if worst < phi.size else "velocity"
        raise SimulationError(
            f"the state given as initial= breaks the constraint {names[worst]} at {level} level by {rows[worst]:.3g} "
            f"at t = {time:.6g} s; use assemble to make it consistent"
        )
    return complete_state(numeric, signals, time, q, v, z)
