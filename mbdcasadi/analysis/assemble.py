"""Assembly: the consistent state nearest to the estimate that meets conditions."""

from __future__ import annotations

import warnings
from typing import Any

import casadi as ca
import numpy as np

from ..equations import equations
from ..equations.numeric import NumericEquations
from ..errors import AssemblyError, ConditionError, MechanismError, MechanismWarning, SingularityError
from ..model.conditions import Condition, read_conditions
from ..model.mechanism import Mechanism
from ..model.symbols import describe, number, symbols_of
from ..numerics.least_squares import largest, nearest, solve
from ..results.state import State
from .inputs import Signals, read_signals
from .mappings import parameter_vector
from .pose import PoseProblem


def assemble(
    mechanism: Mechanism, conditions: Any = (), t: float = 0.0, inputs: Any = None, parameters: Any = None
) -> State:
    """Find the consistent state that meets conditions, nearest to the estimate.

    Position, then velocity, each nearest to the bodies' estimates in the mass
    metric (unit weight where there is no mass) among all that meet the
    constraints and the conditions; then accelerations and multipliers from the
    equations of motion. From the nearest consistent pose the conditions are
    approached by continuation, so that the branch of the linkage is kept.

    Parameters
    ----------
    mechanism : Mechanism
        The model.
    conditions : sequence of relations
        In positions, or linear in velocities; ``<=`` holds where it must.
    t : float, default 0
        Time, s.
    inputs : mapping of Input to number or expression, optional
        Values other than the inputs' own.
    parameters : mapping of Parameter to number, optional
        Values other than the parameters' own.

    Returns
    -------
    State
        ``|Phi|`` and ``|Phi_q v - nu|`` vanish to rounding.

    Raises
    ------
    AssemblyError
        Where the parts cannot be put together; ``.residuals`` says by how much, by element.
    ConditionError
        For a condition that cannot be met, or contradicts the constraints or another one.

    References
    ----------
    Haug 1989, section 4.3 (assembly) and 7.3 (initial conditions).

    Examples
    --------
    >>> import numpy as np, mbdcasadi as mbd
    >>> arm = mbd.Body("arm", mass=1, inertia=1, pose=(0.4, 0.1, 0))
    >>> hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), arm.at(-0.5, 0))
    >>> pendulum = mbd.Mechanism(bodies=[arm], joints=[hinge])
    >>> state = mbd.assemble(pendulum, [arm.phi == np.pi / 2, arm.omega == 3])
    >>> float(np.round(state[arm.vx], 9))
    -1.5
    """
    eom = equations(mechanism)
    p = parameter_vector(eom, parameters)
    signals = read_signals(eom, inputs)
    return assemble_at(NumericEquations(eom, p), conditions, number(t, "assemble", "t"), signals)


def assemble_at(numeric: NumericEquations, conditions: Any, t: float, signals: Signals) -> State:
    """Assemble with parameters and inputs already read."""
    eom = numeric.eom
    rows = read_conditions(conditions)
    at_position, at_velocity, at_states = _levels(numeric, rows)
    q0, v0, z0 = eom.estimate
    z = _first_order_states(numeric, at_states, t, z0)
    problem = PoseProblem(numeric, at_position, t, z)
    q = problem.solve(q0)
    v = _velocity(numeric, at_velocity, t, q, z, v0)
    return complete_state(numeric, signals, t, q, v, z)


def complete_state(numeric: NumericEquations, signals: Signals, t: float, q: Any, v: Any, z: Any) -> State:
    """State with accelerations and multipliers from the equations of motion."""
    eom = numeric.eom
    channel = np.zeros(signals.channel.numel())
    value = ca.Function("u", [eom.t, eom.q, eom.v, eom.z, eom.p, signals.channel], [ca.densify(signals.expressions)])
    u = value(t, q, v, z, numeric.p, channel).full().ravel()
    obstacle: MechanismError | None = None
    try:
        redundant = numeric.has_redundant_rows(t, q)
        a, lam = numeric.accelerations(t, q, v, z, u, redundant=redundant)
    except SingularityError as error:
        obstacle = error
        a, lam = np.full(eom.q.numel(), np.nan), np.full(eom.lam.numel(), np.nan)
    return State(eom.mechanism, t, q, v, a, z, lam, u, numeric.p, obstacle)


def _levels(
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
        for symbol in symbols_of(row.expression):
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


def _velocity(
    numeric: NumericEquations, rows: list[Condition], t: float, q: np.ndarray, z: np.ndarray, v0: np.ndarray
) -> np.ndarray:
    """Velocity nearest to the estimate that meets ``Phi_q v = nu`` and the conditions."""
    eom = numeric.eom
    jacobian, nu = numeric.velocity(t, q)
    v = _least_change(jacobian, nu, v0, numeric.weights)
    left_over = jacobian @ v - nu if nu.size else nu
    if largest(left_over) > 1e-8 * (1 + largest(nu) + largest(v)):
        names = [eom.row_names[k] for k in np.argsort(-np.abs(left_over))[:4]]
        raise AssemblyError(
            f"cannot assemble velocities at t = {t:.6g} s: the pose is singular and no velocity meets the rows "
            f"{', '.join(names)}",
            residuals=by_element(eom.row_elements, left_over),
            time=t,
        )
    active = [row for row in rows if row.equality]
    for _ in range(len(rows) + 1):
        if not active and all(row.equality for row in rows):
            return v
        values = ca.vertcat(ca.SX(0, 1), *[row.expression for row in active])
        conditions = ca.Function(
            "c", [eom.v, eom.q, eom.z, eom.t, eom.p], [ca.densify(values), ca.jacobian(values, eom.v)]
        )

        def residual(trial: np.ndarray, conditions: ca.Function = conditions) -> tuple[np.ndarray, np.ndarray]:
            c, c_v = conditions(trial, q, z, t, numeric.p)
            return np.r_[jacobian @ trial - nu, c.full().ravel()], np.vstack([jacobian, c_v.full()])

        outcome = solve(residual, v, numeric.weights)
        if not outcome.converged:
            _refuse_velocities(numeric, active, outcome.residual[nu.size :])
        v = nearest(residual, outcome.x, v0, numeric.weights)
        inequalities = [row for row in rows if not row.equality and row not in active]
        broken = [row for row in inequalities if _value(numeric, row, t, q, v, z) > 1e-10]
        if not broken:
            return v
        active += broken
    return v


def _value(numeric: NumericEquations, row: Condition, t: float, q: Any, v: Any, z: Any) -> float:
    eom = numeric.eom
    function = ca.Function("c", [eom.t, eom.q, eom.v, eom.z, eom.p], [row.expression])
    return float(function(t, q, v, z, numeric.p))


def _refuse_velocities(numeric: NumericEquations, rows: list[Condition], left_over: np.ndarray) -> None:
    open_rows = [row.label for row, value in zip(rows, left_over, strict=True) if abs(value) > 1e-9]
    raise ConditionError(
        f"the velocity conditions cannot all be met: {'; '.join(open_rows) or '; '.join(r.label for r in rows)} "
        "contradicts the joints and drivers, or another condition; state as many as there are degrees of freedom"
    )


def _least_change(jacobian: np.ndarray, right: np.ndarray, start: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Vector nearest to a start in the metric of the weights among the least-squares solutions of ``J x = right``."""
    missing = right - jacobian @ start
    if largest(missing) <= 1e-15 * (1 + largest(start)):
        return start.copy()
    root = np.sqrt(weights)
    step, *_ = np.linalg.lstsq(jacobian / root, missing, rcond=1e-11)
    return start + step / root


def by_element(elements: Any, values: np.ndarray) -> dict[str, float]:
    """Largest absolute value by element, largest first."""
    found: dict[str, float] = {}
    for element, value in zip(elements, values, strict=True):
        found[element.name] = max(found.get(element.name, 0.0), abs(float(value)))
    return dict(sorted(found.items(), key=lambda item: -item[1]))


def warn(message: str) -> None:
    """Tell the user something that does not stop the analysis."""
    warnings.warn(message, MechanismWarning, stacklevel=3)
