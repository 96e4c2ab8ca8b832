"""Assembly: the consistent state nearest to the estimate that meets conditions."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from ..equations import equations
from ..equations.numeric import NumericEquations
from ..errors import ConditionError, MechanismError, SingularityError
from ..model.conditions import Condition, read_conditions
from ..model.mechanism import Mechanism
from ..model.symbols import describe, number, symbols_of
from ..numerics.least_squares import solve
from ..results.state import State
from .inputs import Signals, read_signals
from .mappings import parameter_vector
from .pose import PoseProblem
from .velocity import VelocityProblem


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
    if any(getattr(element, "modes", ()) for element in getattr(mechanism, "elements", ())):
        from .stick_slip.start import assembled  # which assembles the mechanism without its friction

        return assembled(mechanism, conditions, t, inputs, parameters)
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
