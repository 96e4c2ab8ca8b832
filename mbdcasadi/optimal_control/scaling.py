"""Typical sizes of a mechanism and its motion, so that a solver sees numbers near one."""

from __future__ import annotations

import numpy as np

from ..equations.numeric import NumericEquations
from .interval import Scales


def scales_of(numeric: NumericEquations, duration: float) -> Scales:
    """Sizes from lengths, masses and the duration.

    Lengths are typical distances of joint points from centres of mass; angles
    count as one radian; rates follow with the duration, loads with the masses.

    Parameters
    ----------
    numeric : NumericEquations
        Equations at given parameters.
    duration : float
        Time of the motion, s.
    """
    eom = numeric.eom
    bodies = len(eom.mechanism.bodies)
    q0 = eom.estimate[0]
    length = _length(numeric, q0)
    q = np.full(q0.size, length)
    q[2 : 3 * bodies : 3] = 1.0
    mass = float(np.max(numeric.mass[[k for k in range(3 * bodies) if k % 3 < 2]], initial=0.0)) or 1.0
    force = max(mass * length / duration**2, _load_at_rest(numeric, q0))
    load = np.where(q == 1.0, force * length, force)
    load[3 * bodies :] = force
    jacobian = numeric.velocity(0.0, q0)[0]
    rows = np.maximum(np.max(np.abs(jacobian) * q, axis=1, initial=0.0), 1e-9) if eom.lam.numel() else np.zeros(0)
    lam = force * length / rows
    u = np.array([_input_scale(x, force, length) for x in eom.mechanism.inputs])
    z = np.array([_finite_span(x.lower, x.upper) or 1.0 for x in eom.mechanism.states])
    return Scales(duration, q, q / duration, q / duration**2, load, lam, rows, z, u)


def _length(numeric: NumericEquations, q0: np.ndarray) -> float:
    """Typical length: levers of the joints, distances of the bodies."""
    bodies = len(numeric.eom.mechanism.bodies)
    jacobian = np.abs(numeric.velocity(0.0, q0)[0])
    levers = jacobian[:, 2 : 3 * bodies : 3]
    lever = float(np.max(levers[levers != 1.0], initial=0.0))
    spread = float(np.max(np.abs(q0[[k for k in range(3 * bodies) if k % 3 < 2]]), initial=0.0))
    return max(lever, spread) or 1.0


def _load_at_rest(numeric: NumericEquations, q0: np.ndarray) -> float:
    """Largest applied force on a body at the estimated pose, at rest and with the inputs' own values, N."""
    eom = numeric.eom
    n, m = eom.q.numel(), eom.lam.numel()
    zero = np.zeros(n)
    loads = eom.function(eom.Q)(0.0, q0, zero, zero, eom.estimate[2], np.zeros(m), eom.input_values, numeric.p).full()
    translations = [k for k in range(3 * len(eom.mechanism.bodies)) if k % 3 < 2]
    found = np.abs(loads.ravel()[translations])
    return float(np.max(found[np.isfinite(found)], initial=0.0))


def _finite_span(lower: float, upper: float) -> float:
    values = [abs(x) for x in (lower, upper) if np.isfinite(x)]
    return max(values, default=0.0)


def _input_scale(symbol: object, force: float, length: float) -> float:
    """Size of an input: its limits, or between a force and a torque."""
    limit = _finite_span(symbol.lower, symbol.upper)  # type: ignore[attr-defined]
    return limit or max(force, force * length)
