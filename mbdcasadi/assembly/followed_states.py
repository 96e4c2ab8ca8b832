"""Starts of servos: the states that drivers follow, if conditions decide the motion that they prescribe."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from ..equations import equations
from ..equations.numeric import NumericEquations
from ..errors import ConditionError
from ..model.conditions import Condition, stacked
from ..numerics.evaluation import Evaluator
from ..numerics.least_squares import largest
from ..numerics.newton import solve
from ..numerics.rank import dependent_rows, unit_rows
from ..numerics.tolerances import ON_CONSTRAINTS, PROJECTIONS
from ..results.state import State
from .pose import PoseProblem
from .velocity import VelocityProblem


def led_start(
    numeric: NumericEquations,
    conditions: tuple[Sequence[Condition], Sequence[Condition], Sequence[Condition]],
    time: float,
    estimate: tuple[np.ndarray, np.ndarray],
    z: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return pose, velocity and states near to given ones at which drivers prescribe what conditions ask for.

    The pose follows the states, unless conditions on positions, together with the joints, decide what a driver
    prescribes: then its states follow the pose. The same holds for velocities.

    Parameters
    ----------
    conditions : tuple of sequences of Condition
        On positions, on velocities and on states alone; the last ones hold at `z`.
    time : float
        s.
    estimate : (numpy.ndarray, numpy.ndarray)
        Of pose and velocities, each (n,).
    z : numpy.ndarray
        States (k,).

    Raises
    ------
    AssemblyError, ConditionError
        If no pose, velocity or states meet the constraints and the conditions.
    """
    eom = numeric.eom
    at_position, at_velocity, at_states = conditions
    servos = eom.following_rows
    q = PoseProblem(_without(numeric, servos), at_position, time, z).solve(estimate[0])
    slopes = ca.jacobian(stacked([c for c in at_position if c.equality]), eom.q)
    led = _led(numeric, servos, time, q, _value(numeric, slopes, time, q, estimate[1], z))
    if 0 < len(led) < len(servos):
        q = PoseProblem(_without(numeric, led), at_position, time, z).solve(q)
    positions = dict(zip(eom.position_rows.tolist(), ca.vertsplit(eom.Phi), strict=True))
    z = _solved(numeric, [positions[row] for row in led], at_states, time, q, estimate[1], z)
    if not led:
        q = PoseProblem(numeric, at_position, time, z).solve(estimate[0])
    slopes = ca.jacobian(stacked([c for c in at_velocity if c.equality]), eom.v)
    led_too = _led(numeric, servos, time, q, _value(numeric, slopes, time, q, estimate[1], z))
    v = VelocityProblem(_without(numeric, led_too), at_velocity, time, q, z).solve(estimate[1])
    rates = eom.Phi_q @ eom.v - eom.nu
    rows = [positions[row] for row in servos] + [rates[row] for row in led_too]
    return q, v, _solved(numeric, rows, at_states, time, q, v, z)


def led_levels(
    numeric: NumericEquations, conditions: tuple[Sequence[Condition], ...], state: State
) -> tuple[bool | None, ...]:
    """Return for positions and velocities whether conditions at a start decide what all servos do; None for some."""
    eom, levels = numeric.eom, list[bool | None]()
    if not eom.follows_states:
        return False, False
    for level, symbols in zip(conditions, (eom.q, eom.v), strict=False):
        slopes = ca.jacobian(stacked([c for c in level if c.equality]), symbols)
        values = _value(numeric, slopes, state.t, state.q, state.v, state.z)
        led = _led(numeric, eom.following_rows, state.t, state.q, values)
        levels.append(None if 0 < len(led) < len(eom.following_rows) else bool(led))
    return tuple(levels)


def without_servos(numeric: NumericEquations) -> NumericEquations:
    """Return the equations without the drivers that follow states: of poses to which these may lead."""
    return _without(numeric, numeric.eom.following_rows)


def led_states(numeric: NumericEquations, t: np.ndarray, q: np.ndarray, v: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Return first-order states by row, near to given ones, at which drivers prescribe motions.

    Parameters
    ----------
    t : numpy.ndarray
        Times (k,), s.
    q, v, z : numpy.ndarray
        Coordinates and velocities (k, n), and states (k, n_z), by row.
    """
    eom = numeric.eom
    servos = eom.following_rows
    if not servos:
        return z

    def make() -> Evaluator:
        places = np.searchsorted(eom.position_rows, servos).tolist()
        values = ca.vertcat(eom.Phi[places], (eom.Phi_q @ eom.v - eom.nu)[servos])
        results = [ca.densify(values), ca.densify(ca.jacobian(values, eom.z))]
        return Evaluator(ca.Function("led", [eom.t, eom.q, eom.v, eom.z, eom.p], results))

    function = eom.shared.get_or_create("led states", make)
    for _ in range(PROJECTIONS):
        left, slopes = function.rows(t[:, None], q, v, z, numeric.p)
        if largest(left) <= ON_CONSTRAINTS:
            break
        inverse = np.linalg.pinv(slopes.reshape(t.size, z.shape[1], -1).swapaxes(1, 2))
        z = z - (inverse @ left[:, :, None])[:, :, 0]
    return z


def _without(numeric: NumericEquations, rows: Sequence[int]) -> NumericEquations:
    """The equations without the drivers of some rows."""
    eom = numeric.eom
    if not rows:
        return numeric
    left_out = {eom.row_elements[row] for row in rows}
    drivers = [driver for driver in eom.mechanism.drivers if driver not in left_out]
    free = eom.mechanism.cache.get_or_create(
        ("without drivers", *rows), lambda: eom.mechanism.replace(drivers=drivers), bounded=True
    )
    return NumericEquations(equations(free), numeric.p)


def _value(
    numeric: NumericEquations, expression: ca.SX, t: float, q: np.ndarray, v: np.ndarray, z: np.ndarray
) -> np.ndarray:
    eom = numeric.eom
    none = np.zeros(eom.q.numel()), np.zeros(eom.lam.numel()), np.zeros(eom.u.numel())
    return eom.value(expression, (t, q, v, none[0], z, none[1], none[2], numeric.p))


def _led(numeric: NumericEquations, servos: list[int], t: float, q: np.ndarray, slopes: np.ndarray) -> list[int]:
    """Rows of drivers that follow states which other rows and conditions with these slopes decide."""
    jacobian = numeric.jacobian(t, q)
    others = [row for row in range(len(jacobian)) if row not in servos]
    rows = np.vstack([jacobian[others], slopes, jacobian[servos]]) * numeric.column_scale
    first = len(rows) - len(servos)
    return [servos[k - first] for k in dependent_rows(unit_rows(rows)) if k >= first]


def _solved(
    numeric: NumericEquations,
    rows: Sequence[ca.SX],
    at_states: Sequence[Condition],
    time: float,
    q: np.ndarray,
    v: np.ndarray,
    z: np.ndarray,
) -> np.ndarray:
    """Nearest states at which rows and conditions hold."""
    if not rows:
        return z
    eom = numeric.eom
    values = ca.vertcat(*rows, stacked(at_states))
    known = [eom.z, eom.t, eom.q, eom.v, eom.p]
    function = ca.Function("states", known, [ca.densify(values), ca.densify(ca.jacobian(values, eom.z))])

    def residual(z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        left, slopes = function(z, time, q, v, numeric.p)
        return left.full().ravel(), slopes.full()

    outcome = solve(residual, z, np.ones(z.size))
    if not outcome.converged:
        drivers = dict.fromkeys(d.description for d in eom.mechanism.drivers if ca.depends_on(d.rows, eom.z))
        raise ConditionError(
            f"no states that {', '.join(drivers)} follow{'s' if len(drivers) == 1 else ''} agree with the start at "
            f"t = {time:.6g} s: give conditions on the motion or on the states, not on both"
        )
    return outcome.x
