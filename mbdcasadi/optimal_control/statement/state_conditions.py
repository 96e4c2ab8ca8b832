"""A state, or a pose, as conditions at a place of the motion."""

from __future__ import annotations

import casadi as ca
import numpy as np

from ...equations import Equations, equations
from ...equations.numeric import NumericEquations
from ...model.conditions import Condition
from ...model.forces.friction.modes import without_exact_friction
from ...numerics.rank import dependent_rows, unit_rows
from ...results.state import State

#: Rest of a unit row below which a coordinate depends on the joints and on those chosen before it.
STEERING_TOLERANCE = 1e-3
#: Share of its typical change within which an implied condition must stay while the solver runs.
WINDOW = 0.05


def state_conditions(eom: Equations, state: State) -> list[Condition]:
    """Return the conditions that a state sets, by coordinate, velocity and first-order state."""
    symbols, values = ca.vertsplit(ca.vertcat(eom.q, eom.v, eom.z)), np.r_[state.q, state.v, state.z]
    return [
        Condition(symbol - float(value), True, f"{symbol.name()} == {value:.6g}")
        for symbol, value in zip(symbols, values, strict=True)
    ]


def independent_state_conditions(state: State) -> tuple[Condition, ...]:
    """Return the conditions of a state on independent coordinates, with limits about the others.

    The joints imply the other coordinates, but only on one branch: the limits keep the solver on it.
    """
    eom = equations(without_exact_friction(state.mechanism))
    numeric, n = NumericEquations(eom, state.parameters), eom.q.numel()
    every, jacobian = state_conditions(eom, state), numeric.jacobian(state.t, state.q)
    fixed = independent_coordinates(numeric, jacobian[eom.position_rows])
    moving = independent_coordinates(numeric, jacobian)  # fewer if a wheel rolls
    windows = [w for k in sorted({*range(n)} - {*fixed}) for w in window(every[k], WINDOW * numeric.typical_step[k])]
    return (*(every[k] for k in fixed), *(every[n + k] for k in moving), *every[2 * n :], *windows)


def window(condition: Condition, width: float) -> list[Condition]:
    """Return limits about a condition that others imply on one branch."""
    label = f"{condition.label} (on the same branch)"
    return [Condition(sign * condition.expression - width, False, label, implied=True) for sign in (1, -1)]


def pose_conditions(numeric: NumericEquations, t: float, target: np.ndarray) -> list[Condition]:
    """Return independent coordinates of a pose and their values; of mechanisms of hundreds of bodies all."""
    eom = numeric.eom
    symbols = ca.vertsplit(eom.q)
    few = not eom.is_large
    chosen = independent_coordinates(numeric, numeric.jacobian(t, target)) if few else _angles_first(numeric)
    return [Condition(symbols[k] - float(target[k]), True, symbols[k].name()) for k in chosen]


def independent_coordinates(numeric: NumericEquations, jacobian: np.ndarray) -> list[int]:
    """Return coordinates that decide a pose besides the rows of a Jacobian."""
    order, joints = _angles_first(numeric), unit_rows(jacobian * numeric.column_scale)
    dependent = set(dependent_rows(np.vstack([joints, np.eye(len(order))[order]]), STEERING_TOLERANCE))
    return [coordinate for k, coordinate in enumerate(order) if k + len(joints) not in dependent]


def _angles_first(numeric: NumericEquations) -> list[int]:
    """All coordinates; the angles, which know the number of turns, first."""
    return np.argsort(~numeric.eom.angles, kind="stable").tolist()
