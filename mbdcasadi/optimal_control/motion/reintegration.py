"""Errors of the intervals of a motion: inside them, and at their ends if each is integrated again from its start."""

from __future__ import annotations

from functools import partial

import casadi as ca
import numpy as np

from ...equations.numeric import NumericEquations
from ...equations.recovery import Recovery
from ...integrators.failures import reason_of
from ...numerics.collocation import gauss
from ...numerics.console import call
from ...numerics.tolerances import INTEGRATION
from ..transcription.motion import Polynomials


def end_differences(motion: Polynomials) -> np.ndarray:
    """Return differences of q, v and z at the ends of all intervals, by integration and by the mesh (N, 2 n + k).

    Raises :class:`RuntimeError` if the end of an interval is not reached, see :func:`not_integrated`.
    """
    numeric, n = motion.numeric, motion.numeric.eom.q.numel()
    integrator, states, parameters = _integration(motion)
    again = integrator.map(len(motion.intervals))
    reached = call(partial(again, x0=states[:-1].T, p=parameters))["xf"].full().T
    recovery = Recovery(numeric, redundant=motion.scheme.redundant)
    times = motion.times[1:]
    q = recovery.positions(times, reached[:, :n], reached[:, 2 * n :])
    v = recovery.velocities(times, q, reached[:, n : 2 * n], reached[:, 2 * n :])
    return np.hstack([q, v, reached[:, 2 * n :]]) - states[1:]


def not_integrated(motion: Polynomials) -> tuple[int, str] | None:
    """Return the first interval that cannot be integrated again from its start, and why; None if there is none."""
    integrator, states, parameters = _integration(motion)
    for k in range(len(motion.intervals)):
        try:
            call(partial(integrator, x0=states[k], p=parameters[:, k]))
        except RuntimeError as error:
            return k, reason_of(error)
    return None


def _integration(motion: Polynomials) -> tuple[ca.Function, np.ndarray, np.ndarray]:
    """Integrator of an interval, states at the mesh points (N + 1, 2 n + k), and parameters by interval (…, N)."""
    numeric, count, redundant = motion.numeric, len(motion.intervals), motion.scheme.redundant
    terms = max((piece.terms for piece in motion.inputs.values()), default=1)
    pieces = [np.pad(p.coefficients, ((0, 0), (0, terms - p.terms))) for p in motion.inputs.values()]
    coefficients = np.stack(pieces, axis=2) if pieces else np.zeros((count, 1, 0))  # (N, d, n_u)
    degree, inputs = coefficients.shape[1:]
    parameters = np.vstack(
        [
            motion.times[:-1],
            np.diff(motion.times),
            np.tile(numeric.p[:, None], (1, count)),
            coefficients.transpose(2, 1, 0).reshape(degree * inputs, count),
        ]
    )
    key = ("interval", degree, redundant, numeric.light_key)
    integrator = numeric.eom.shared.get_or_create(key, lambda: _integrator(numeric, degree, redundant=redundant))
    return integrator, np.hstack(motion.at_mesh_points), parameters


def inner_errors(motion: Polynomials) -> np.ndarray:
    """Return the largest errors inside all intervals to first order, by accelerations that forces do not give (N, 2 n).

    With the difference r at a point s of an interval of length h: ``h ∫ r ds`` in
    the velocities and ``h² ∫∫ r ds ds`` in the coordinates. At the ends of the
    intervals these may vanish by the choice of the stages, whatever the errors
    there; inside they do not, and are larger than those that remain at the ends.
    """
    scheme, numeric, count = motion.scheme, motion.numeric, len(motion.intervals)
    rule = gauss(scheme.stages.size + 2)
    size = rule.degree
    intervals = np.repeat(np.arange(count), size)
    t, q, v, a, z, _, u, _ = motion.at(intervals, np.tile(rule.points, count))
    forced, _ = numeric.accelerations_of_rows(t, q, v, z, u, redundant=scheme.redundant)
    differences = (forced - a).reshape(count, size, -1)
    _, once, twice = rule.basis(np.r_[rule.points, 1.0])
    h = np.diff(motion.times)[:, None]
    errors = [np.max(np.abs(np.einsum("js,ijn->isn", w, differences)), axis=1) for w in (twice, once)]
    return np.hstack([h**2 * errors[0], h * errors[1]])


def _integrator(numeric: NumericEquations, degree: int, *, redundant: bool) -> ca.Function:
    """``(x0, (start, length, p, coefficients of the inputs)) -> xf`` over one interval."""
    eom = numeric.eom
    tau, start, length = ca.SX.sym("s"), ca.SX.sym("t0"), ca.SX.sym("h")
    c = ca.SX.sym("c", degree * eom.u.numel())
    since = length * tau
    u = ca.vertcat(
        ca.SX(0, 1),
        *[sum((c[k * degree + j] * since**j for j in range(degree)), ca.SX(0)) for k in range(eom.u.numel())],
    )
    t = start + since
    a, lam = numeric.forward_dynamics(redundant=redundant)(t, eom.q, eom.v, eom.z, u, eom.p)
    rate = ca.Function("rate", [*eom.symbols], [eom.z_rate])(t, eom.q, eom.v, a, eom.z, lam, u, eom.p)
    system = {
        "t": tau,
        "x": ca.vertcat(eom.q, eom.v, eom.z),
        "p": ca.vertcat(start, length, eom.p, c),
        "ode": length * ca.vertcat(eom.v, a, rate),
    }
    options = {"reltol": INTEGRATION, "abstol": INTEGRATION, "max_num_steps": 100_000}
    return ca.integrator("interval", "erk", system, 0.0, 1.0, options)
