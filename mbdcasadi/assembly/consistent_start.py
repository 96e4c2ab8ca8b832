"""The consistent start of an analysis, from a state or from conditions.

Three problems, one after the other: first-order states, pose, velocity, each
nearest to its estimate among all that meet the constraints and the conditions
(states that a driver follows may follow the pose); then accelerations and multipliers from the equations of motion.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from ..arguments.inputs import Signals
from ..arguments.values import pairs_with
from ..equations import Equations
from ..equations.numeric import NumericEquations
from ..errors import ConditionError, MechanismError, SimulationError, SingularityError
from ..model.conditions import Condition, read_conditions
from ..model.mechanism import Mechanism
from ..model.symbols import describe
from ..numerics.least_squares import largest
from ..numerics.newton import solve
from ..numerics.rank import dependent_rows, unit_rows
from ..results.state import State
from .followed_states import led_start
from .pose import PoseProblem
from .velocity import VelocityProblem

#: A start given as a State may miss the constraints by this much (m, rad, and their rates) in a mechanism with levers
#: of 0.1 m to 1 km; in smaller and larger ones by this share of ten, and of a thousandth, of the characteristic length.
CONSISTENCY_TOLERANCE = 1e-6


def consistent_start(
    numeric: NumericEquations, initial: Any, time: float, signals: Signals, near: np.ndarray | None = None
) -> State:
    """Find the consistent state at which an analysis starts.

    Parameters
    ----------
    initial : sequence of relations, or State
        Conditions that the start meets; or the start itself, which must meet the constraints.
    time : float
        s.
    near : numpy.ndarray, optional
        Estimate of the pose (n,), in place of that of the bodies.

    Raises
    ------
    SimulationError
        If a state given as start breaks the constraints: which, and by how much.
    AssemblyError, ConditionError
        If no pose or velocity meets the constraints and the conditions.
    """
    eom = numeric.eom
    if isinstance(initial, State):
        if initial.mechanism is eom.mechanism:
            q, v, z = initial.q, initial.v, initial.z
        else:  # another one on the same bodies
            q, v = np.atleast_1d(initial[eom.q]), np.atleast_1d(initial[eom.v])
            z = np.atleast_1d(initial[eom.z]) if eom.z.numel() else np.zeros(0)
        refuse_inconsistent(numeric, initial, time, q, v, z)
        return complete_state(numeric, signals, time, q, v, z)
    at_position, at_velocity, at_states = levels_of(numeric, read_conditions(initial))
    q0, v0, z0 = eom.estimate
    z = _first_order_states(numeric, at_states, time, z0)
    q0 = q0 if near is None else near
    if eom.follows_states and (at_position or at_velocity):
        q, v, z = led_start(numeric, (at_position, at_velocity, at_states), time, (q0, v0), z)
    else:
        q = PoseProblem(numeric, at_position, time, z).solve(q0)
        v = VelocityProblem(numeric, at_velocity, time, q, z).solve(v0)
    return complete_state(numeric, signals, time, q, v, z)


def refuse_inconsistent(
    numeric: NumericEquations, state: State, time: float, q: np.ndarray, v: np.ndarray, z: np.ndarray
) -> None:
    """Raise for a pose, velocity and states, given as a state, that break the constraints."""
    numeric.of_state("consistent", (time, q, v, z), lambda: _refuse_inconsistent(numeric, state, time, q, v, z))


def _refuse_inconsistent(
    numeric: NumericEquations, state: State, time: float, q: np.ndarray, v: np.ndarray, z: np.ndarray
) -> None:
    eom = numeric.eom
    phi, _ = numeric.position(time, q, z)
    jacobian, nu = numeric.velocity(time, q, z)
    rows = np.abs(np.concatenate([phi, jacobian @ v - nu]))
    angular = np.concatenate([eom.position_angular_rows, eom.angular_rows])
    excess = rows / position_limits(numeric, angular)
    if largest(excess) > 1:
        worst = int(np.argmax(excess >= (1 - 1e-9) * largest(excess)))  # of equal ones the first
        names = [*eom.position_names, *eom.row_names]
        level = "position" if worst < phi.size else "velocity"
        raise SimulationError(
            f"the state given as initial= breaks the constraint {names[worst]} at {level} level by {rows[worst]:.3g} "
            f"at t = {time:.6g} s; {_remedy(state, eom, closed=bool(np.all(excess[: phi.size] <= 1)))}"
        )


def _remedy(state: State, eom: Equations, *, closed: bool) -> str:
    """Remedy for an inconsistent state, in words: an impact if bodies part at joints that are new to them."""
    if not closed or state.mechanism is eom.mechanism:
        return "use assemble to make it consistent"
    return (
        "the positions hold and the velocities do not: if joints close here, as when bodies latch, the state after the "
        "plastic impact is impact(mechanism, state), or Event(…, becomes=mechanism) leads there; assemble would not "
        "keep the momentum"
    )


def position_limits(numeric: NumericEquations, angular: np.ndarray | None = None) -> np.ndarray:
    """Return misses up to which rows count as met, m or rad; by default those of the position rows.

    Parameters
    ----------
    angular : numpy.ndarray of bool, optional
        True for those of the other rows that are angles.
    """
    length = numeric.scale.length
    rows = numeric.eom.position_angular_rows if angular is None else angular
    return CONSISTENCY_TOLERANCE * np.where(rows, 1.0, max(min(1.0, 10 * length), 1e-3 * length))


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


def carried_by(initial: Any, mechanism: Mechanism) -> dict[str, dict]:
    """Parameters and inputs that a state brings along, as far as the mechanism has them."""
    if not isinstance(initial, State):
        return {"parameters": {}, "inputs": {}}
    theirs = initial.mechanism
    if theirs is mechanism and not (theirs.parameters or theirs.inputs):
        return {"parameters": {}, "inputs": {}}
    carried = {}
    for name, symbols, values, symbols_here in (
        ("parameters", theirs.parameters, initial.parameters, mechanism.parameters),
        ("inputs", theirs.inputs, initial.inputs, mechanism.inputs),
    ):
        carried[name] = dict(pairs_with(symbols_here, zip(symbols, values.tolist(), strict=True)))
    return carried


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


def independent_rows(constraints: np.ndarray, conditions: np.ndarray, columns: np.ndarray) -> list[int]:
    """Places of the rows that count, of constraints and conditions one after the other, in order.

    Of rows that imply each other conditions count first: a row of the mechanism may as well be the one left out.

    Parameters
    ----------
    constraints, conditions : numpy.ndarray
        Slopes (k, n), (j, n).
    columns : numpy.ndarray
        Scale of the unknowns (n,).
    """
    first = len(constraints)
    slopes = unit_rows(np.vstack([conditions, constraints]) * columns)
    order = [*range(first, first + len(conditions)), *range(first)]
    implied = {order[k] for k in dependent_rows(slopes)}
    return [k for k in range(len(order)) if k not in implied]
