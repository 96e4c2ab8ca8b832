"""Start of a motion: the first state, as far as conditions or a given state decide it."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from ...arguments.inputs import Signals
from ...assembly.consistent_start import complete_state, consistent_start
from ...equations.numeric import NumericEquations
from ...errors import AssemblyError, ConditionError
from ...model.conditions import Condition
from ...numerics.least_squares import largest
from ...numerics.tolerances import MET
from ...results.state import State
from ..problem import OptimalControlProblem
from ..statement.phase import Phase, contains_any, on_states, with_parameters, with_rates
from .consistency import refuse_beyond_limits
from .free_poses import FreePoses
from .linear_conditions import state_by_linear_conditions


def first_state(
    problem: OptimalControlProblem,
    phase: Phase,
    numeric: NumericEquations,
    initial: State | Sequence[Condition],
    signals: Signals,
    poses: FreePoses | None = None,
) -> State:
    """Return the state at the start, as far as the initial conditions decide it.

    The equations are at the values of the free parameters in `poses`, if these were found together with the first pose.
    A :class:`ConditionError` is raised if no state meets the conditions.
    """
    if isinstance(initial, State):
        return initial
    extra = problem.extra_parameters(phase)
    conditions = on_states(initial)
    if poses is None:
        conditions = [c for c in conditions if not contains_any(c.expression, extra)]
    else:
        conditions = with_parameters(conditions, extra, poses.values)
    prescribed = with_rates(problem.differentiated_path_constraints(phase))
    z = phase.equations.estimate[2]
    state = state_by_linear_conditions(numeric, [*conditions, *prescribed], 0.0, z)
    if state is not None:
        return complete_state(numeric, signals, 0.0, *state, z)
    try:
        near = None if poses is None else poses.poses[0]
        return consistent_start(numeric, [*conditions, *prescribed], 0.0, signals, near)
    except (AssemblyError, ConditionError) as error:
        more = " together with the path conditions that prescribe the motion" if prescribed else ""
        raise ConditionError(f"the initial conditions cannot be met{more}: {error}") from None


def check_start(problem: OptimalControlProblem, phase: Phase, numeric: NumericEquations, start: State) -> None:
    """Refuse a state given as the start that is off the prescribed motion or beyond limits, or of another linkage."""
    eom = phase.equations
    name, missed = numeric.largest_miss(0.0, start.q, start.v, start.z)
    if abs(missed) > MET * (1 + largest(start.q) + largest(start.v)):
        raise ConditionError(
            f"the initial state does not meet {name}: it is off by {missed:.3g}; "
            "assemble it with the parameters of this problem, and for its start at t = 0"
        )
    rows = ca.vertcat(eom.Phi, eom.Phi_q @ eom.v - eom.nu) if problem.free_parameters else ca.SX(0, 1)
    for parameter in problem.free_parameters:
        slopes = ca.jacobian(rows, parameter)
        if ca.depends_on(rows, parameter) and np.any(np.abs(start[slopes]) > MET):
            raise ConditionError(
                f"the initial state meets the constraints at one value of the free parameter '{parameter.label}' "
                "alone; state conditions in its place"
            )
    for condition in with_rates(problem.differentiated_path_constraints(phase)):
        amount = float(start[condition.expression])
        if abs(amount) > MET:
            raise ConditionError(f"the initial state does not meet {condition.label}: it is off by {amount:.3g}")
    refuse_beyond_limits(problem, phase, numeric, "initial", start)
