"""Causes for which an integrator stopped, in the words of the model."""

from __future__ import annotations

import numpy as np

from ...equations.numeric import NumericEquations
from ...errors import NOT_FINITE, SimulationError
from ...integrators.failures import in_words
from ...kinematics.singular import describe_singularity
from ...results.ranges import Ranges
from ...results.validity import broken_at_pose
from ..outputs import Outputs
from ..tolerances import narrowest_friction

#: Smallest singular value, relative to the largest, from which a pose counts as near a singular one.
NEAR_SINGULAR = 0.02
#: Velocity (m/s) or deflection (m) over which friction is smoothed, from which it may be what stops an integrator.
NARROW_FRICTION = 1e-6


def cause_of_failure(
    outputs: Outputs, ranges: Ranges, t: float, x: np.ndarray, flag: str, ahead: float, method: str = ""
) -> str:
    """Likely cause of a failure after the state that was reached last.

    Parameters
    ----------
    outputs : Outputs
        What makes the outputs of the run.
    ranges : Ranges
        Looks for quantities that leave their ranges just ahead.
    t : float
        Time of the last state.
    x : numpy.ndarray
        The last state ``(q, v, z)``.
    flag : str
        The integrator's own word.
    ahead : float
        Time to look beyond it, s.
    method : str, optional
        Name of the integrator, which is not advised again.
    """
    numeric = outputs.numeric
    eom, n = numeric.eom, numeric.eom.q.numel()
    (q, v, z), said = np.split(x, [n, 2 * n]), in_words(flag)
    remarks = "".join(f"; {sentence}" for sentence in broken_at_pose(numeric, t, q))
    a, lam, z_rates = _unknowns(outputs, t, q, v, z)
    rates = np.nan_to_num(np.concatenate([v, a, z_rates]), posinf=0.0, neginf=0.0)
    for time, (pose, speed, z_there) in ((t, (q, v, z)), (t + ahead, np.split(x + ahead * rates, [n, 2 * n]))):
        u = outputs.inputs_at(time, pose, speed, z_there)
        own = [f"input '{i.label}'" for i, value in zip(eom.mechanism.inputs, u, strict=True) if not np.isfinite(value)]
        broken = own or [
            *numeric.rows_not_finite(time, pose, speed, z_there, u),
            *numeric.not_finite(time, pose, speed, z_there, u),
        ]
        here = [np.atleast_2d(part) for part in (pose, speed, a, z_there, lam, u)]
        left = ranges.first_broken((np.array([time]), *here))
        if left is not None:
            return f"{left[1]} at t = {time:.6g} s as it goes on there ({said}); end the run before, or let it stop"
        if broken:
            return f"{', '.join(broken)} is not finite there: {NOT_FINITE} ({said}){remarks}"
    bent = numeric.not_finite(t, q, v, z, outputs.inputs_at(t, q, v, z), slopes=True)
    if bent:
        return (
            f"{', '.join(bent)} has no finite slope there, as a root or a power at zero, and this method needs one; "
            f"method='dop853' does not ({said}){remarks}"
        )
    values = numeric.rank(t, q).singular_values
    if values.size and values[-1] < NEAR_SINGULAR * values[0]:
        return f"the pose is singular or nearly so, {describe_singularity(numeric, t, q, z).text} ({said})"
    missing = numeric.motion_without_mass(t, q, NEAR_SINGULAR**2)
    if missing:
        return (
            f"near this pose {', '.join(missing)} move with hardly any mass, and no joint holds that motion: its "
            f"accelerations grow without bound; give the bodies mass or inertia ({said}){remarks}"
        )
    if flag.startswith("the constraints"):
        return said + remarks
    narrow = narrowest_friction(numeric)
    if narrow is not None and narrow[0] < NARROW_FRICTION:
        remarks += f"; or {narrow[1].description} is too steep: {narrow[2]} is very narrow, widen it"
    fastest = int(np.argmax(np.abs(v)))
    advice = "events at the jumps" if method == "rosenbrock" else "method='rosenbrock', or events at the jumps,"
    return (
        f"{said}; a force may jump there, grow without bound or have no slope, as a root at zero (fastest coordinate: "
        f"{eom.coordinate_names[fastest]} at {v[fastest]:.3g} per second); {advice} may help{remarks}"
    )


def _unknowns(outputs: Outputs, t: float, q: np.ndarray, v: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, ...]:
    """Accelerations, multipliers and rates of first-order states."""
    numeric, u = outputs.numeric, outputs.inputs_at(t, q, v, z)
    state = [np.atleast_2d(part) for part in (t, q, v, z, u)]
    a, lam = (rows[0] for rows in numeric.accelerations_of_rows(*state, redundant=True))
    return a, lam, numeric.eom.function(numeric.eom.z_rate)(t, q, v, a, z, lam, u, numeric.p).full().ravel()


def singular_stop(numeric: NumericEquations, entry: float, time: float, x: np.ndarray) -> SimulationError:
    """Error of a run at a singular pose that the motion cannot be continued across, from a state just before it."""
    n = numeric.eom.q.numel()
    pose = describe_singularity(numeric, time, x[:n], x[2 * n :])
    return SimulationError(
        f"the simulation stopped at t = {entry:.6g} s, before a singular pose, {pose.text}; the motion could not "
        "be continued across it; what was computed is in .partial",
        time=entry,
    )


def singular_event(numeric: NumericEquations, name: str, time: float, x: np.ndarray) -> SimulationError:
    """Error of a run at an event after which the velocities do not follow from the constraints."""
    n = numeric.eom.q.numel()
    pose = describe_singularity(numeric, time, x[:n], x[2 * n :])
    return SimulationError(
        f"the simulation stopped at t = {time:.6g} s: event '{name}' takes place in a singular pose, or too near to "
        f"one, {pose.text}; the velocities after it are not determined there; what was computed is in .partial",
        time=time,
    )
