"""Assembly: pose, velocity, accelerations and multipliers at given parameters and inputs."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from ..arguments.inputs import Signals, read_signals
from ..arguments.values import parameter_vector
from ..equations import equations
from ..equations.numeric import NumericEquations
from ..errors import ConditionError, MechanismError, SingularityError
from ..model.conditions import Condition, read_conditions
from ..model.mechanism import Mechanism
from ..model.symbols import describe, number
from ..numerics.newton import solve
from ..results.state import State
from .pose import PoseProblem
from .velocity import VelocityProblem


def assemble_mechanism(mechanism: Mechanism, conditions: Any, t: float, inputs: Any, parameters: Any) -> State:
    """Assemble a mechanism without exact friction; see :func:`~mbdcasadi.assemble`."""
    eom = equations(mechanism)
    p = parameter_vector(eom, parameters)
    signals = read_signals(eom, inputs)
    return assemble_at(NumericEquations(eom, p), conditions, number(t, "assemble", "t"), signals)


def assemble_at(numeric: NumericEquations, conditions: Any, t: float, signals: Signals) -> State:
    """Assemble with parameters and inputs already read."""
    eom = numeric.eom
    rows = read_conditions(conditions)
    at_position, at_velocity, at_states = levels_of(numeric, rows)
    q0, v0, z0 = eom.estimate
    z = _first_order_states(numeric, at_states, t, z0)
    problem = PoseProblem(numeric, at_position, t, z)
    q = problem.solve(q0)
    v = VelocityProblem(numeric, at_velocity, t, q, z).solve(v0)
    return complete_state(numeric, signals, t, q, v, z)


def complete_state(
    numeric: NumericEquations, signals: Signals, t: float, q: Any, v: Any, z: Any, *, levels: np.ndarray | None = None
) -> State:
    """State with accelerations and multipliers from the equations of motion.

    Parameters
    ----------
    levels : numpy.ndarray, optional
        Values of the inputs that are numbers, if they are not those of `signals`.
    """
    eom = numeric.eom
    u = signals.values(t, q, v, z, numeric.p, eom, levels=levels)[0]
    obstacle: MechanismError | None = None
    try:
        redundant = numeric.has_redundant_rows(t, q)
        a, lam = numeric.accelerations(t, q, v, z, u, redundant=redundant)
    except SingularityError as error:
        obstacle = error
        a, lam = np.full(eom.q.numel(), np.nan), np.full(eom.lam.numel(), np.nan)
    return State(eom.mechanism, t, q, v, a, z, lam, u, numeric.p, obstacle)


def levels_of(
    numeric: NumericEquations, rows: tuple[Condition, ...]
) -> tuple[list[Condition], list[Condition], list[Condition]]:
    """Conditions on positions, on velocities, and on first-order states alone."""
    eom = numeric.eom
    known = {s.element_hash() for g in (eom.t, eom.q, eom.v, eom.z, eom.p) for s in ca.vertsplit(g)}
    levels: tuple[list[Condition], list[Condition], list[Condition]] = ([], [], [])
    for row in rows:
        if row.depends_on("acceleration", "multiplier", "input"):
            raise ConditionError(
                f"condition {row.label}: a start is fixed by positions, velocities and states; "
                "accelerations, reactions and inputs follow from them"
            )
        for symbol in row.symbols:
            if symbol.element_hash() not in known:
                raise ConditionError(
                    f"condition {row.label} holds {describe(symbol)}, which the mechanism does not have"
                )
        if row.depends_on("velocity"):
            levels[1].append(row)
        elif row.depends_on("position"):
            levels[0].append(row)
        elif row.depends_on("state"):
            levels[2].append(row)
        else:
            raise ConditionError(f"condition {row.label} holds no coordinate, velocity or state of the mechanism")
    return levels


def _first_order_states(numeric: NumericEquations, rows: list[Condition], t: float, z0: np.ndarray) -> np.ndarray:
    if not rows:
        return z0
    eom = numeric.eom
    if any(not row.equality for row in rows):
        raise ConditionError("conditions on first-order states at a start must be equalities")
    values = ca.vertcat(*[row.expression for row in rows])
    function = ca.Function("z", [eom.z, eom.t, eom.p], [ca.densify(values), ca.jacobian(values, eom.z)])

    def residual(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        r, jacobian = function(z, t, numeric.p)
        return r.full().ravel(), jacobian.full()

    outcome = solve(residual, z0, np.ones(z0.size))
    if not outcome.converged:
        raise ConditionError(f"the conditions {', '.join(r.label for r in rows)} cannot be met together")
    return outcome.x
