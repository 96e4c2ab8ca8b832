"""Local errors of the intervals of a solution, by integrating each again from its own mesh point."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from ...equations.numeric import NumericEquations
from ...equations.recovery import Recovery
from ...errors import MechanismWarning
from ...numerics.collocation import gauss

if TYPE_CHECKING:
    from ..solution import Solution

#: Local error of an interval, in rad or sizes of the mechanism, velocities times the duration, from which the mesh
#: counts as coarse. At 0.02 the swing-up of a cart-pole ends 0.1 off when its force is replayed, at 0.001 0.007 off.
COARSE = 0.01
#: Sum of the errors of a first-order state, as a share of its range, that counts; those of a lag fade on the way.
ADDED_UP = 0.05
#: Error inside the intervals below which the mesh counts as fine without an integration.
FINE = COARSE / 3
#: Tolerance of the integration against which an interval is measured.
TOLERANCE = 1e-11


def tell_coarse_mesh(solution: Solution) -> None:
    """Warn where an interval, integrated again from its own mesh point, ends far from the next one."""
    sizes = np.r_[solution.program.scales.q, solution.program.scales.q / solution.duration]
    states = solution.problem.mechanism.states
    if not states and np.max(inner_errors(solution) / sizes) <= FINE:  # nan is not
        return
    try:
        errors = np.max(solution.end_errors[:, : sizes.size] / sizes, axis=1)
    except RuntimeError:  # the integrator did not get to the end of an interval
        errors = np.full(solution.shares.count, np.inf)
    else:
        _tell_states(solution)
    worst = int(np.argmax(errors))
    if errors[worst] <= COARSE:
        return
    others = int(np.sum(errors > COARSE)) - 1
    begin, end = solution.mesh[worst : worst + 2]
    more = f"; so do {others} others" if others else ""
    warnings.warn(
        f"the mesh of {solution.shares.count} intervals is too coarse for the motion that was found: the interval from "
        f"t = {begin:.6g} to {end:.6g} s, integrated again from its own start, ends elsewhere (by {errors[worst]:.2g} "
        f"in radians or sizes of the mechanism, velocities times the duration{more}); take more intervals=, or "
        "tolerance= for a mesh that is refined",
        MechanismWarning,
        stacklevel=3,
    )


def _tell_states(solution: Solution) -> None:
    """Warn where the errors of a first-order state, added up as those of a meter do, count beside its range."""
    sums = np.sum(state_errors(solution), axis=0)
    for state, share in zip(solution.problem.mechanism.states, sums, strict=True):
        if share > ADDED_UP:
            warnings.warn(
                f"the mesh of {solution.shares.count} intervals is too coarse for the state '{state.label}': the "
                f"intervals, integrated again, end off by {share:.2g} of its range in all; take more intervals=, or "
                "tolerance= for a mesh that is refined",
                MechanismWarning,
                stacklevel=4,
            )


def state_errors(solution: Solution) -> np.ndarray:
    """Differences of the first-order states at the ends of the intervals, as shares of their ranges (N, k)."""
    return solution.end_errors[:, 2 * solution.problem.equations.q.numel() :] / solution.state_ranges


def inner_errors(solution: Solution) -> np.ndarray:
    """Largest errors inside the intervals to first order (N, 2 n), where accelerations differ from those of the forces.

    With the difference r at a share s of an interval of length h: ``h ∫ r ds`` in
    the velocities and ``h² ∫∫ r ds ds`` in the coordinates. At the ends of the
    intervals these may vanish by the choice of the stages, whatever the errors
    there; inside they do not, and are larger than what is left at the ends.
    """
    rule, motion, numeric = gauss(solution.program.scheme.stages.size + 2), solution.polynomials, solution.numeric
    count, size = solution.shares.count, rule.degree
    intervals = np.repeat(np.arange(count), size)
    t, q, v, a, z, _, u, _ = (x.T for x in motion.at(intervals, np.tile(rule.points, count)))
    forced = numeric.forward_dynamics(redundant=solution.redundant)(t, q, v, z, u, numeric.p)[0].full()
    differences = (forced - a).T.reshape(count, size, -1)
    _, once, twice = rule.basis(np.r_[rule.points, 1.0])
    h = np.diff(solution.mesh)[:, None]
    found = [np.max(np.abs(np.einsum("js,ijn->isn", w, differences)), axis=1) for w in (twice, once)]
    return np.hstack([h**2 * found[0], h * found[1]])


def end_errors(solution: Solution) -> np.ndarray:
    """Differences of q, v and z at the ends of all intervals, by integration and as the mesh has them (N, 2 n + k)."""
    numeric = solution.numeric
    eom = numeric.eom
    n = eom.q.numel()
    pieces = [piece.coefficients for piece in solution.inputs.values()]
    coefficients = np.stack(pieces, axis=2) if pieces else np.zeros((solution.shares.count, 1, 0))  # (N, d, n_u)
    degree, inputs = coefficients.shape[1:]
    count = solution.shares.count
    parameters = np.vstack(
        [
            solution.mesh[:-1],
            np.diff(solution.mesh),
            np.tile(numeric.p[:, None], (1, count)),
            coefficients.transpose(2, 1, 0).reshape(degree * inputs, count),
        ]
    )
    starts = solution.nodes[:-1, : 2 * n + eom.z.numel()]
    redundant = solution.redundant
    key = ("interval", degree, redundant, numeric.light_key)
    integrator = eom.mechanism.cache.get_or_create(key, lambda: _integrator(numeric, degree, redundant=redundant))
    reached = integrator.map(count)(x0=starts.T, p=parameters)["xf"].full().T
    recovery = Recovery(numeric, redundant=redundant)
    times = solution.mesh[1:]
    q = recovery.positions(times, reached[:, :n])
    v = recovery.velocities(times, q, reached[:, n : 2 * n])
    return np.abs(np.hstack([q, v, reached[:, 2 * n :]]) - solution.nodes[1:])


def _integrator(numeric: NumericEquations, degree: int, *, redundant: bool) -> ca.Function:
    """``(x0, (start, length, p, coefficients of the inputs)) -> xf`` over one interval."""
    eom = numeric.eom
    share, start, length = ca.SX.sym("s"), ca.SX.sym("t0"), ca.SX.sym("h")
    c = ca.SX.sym("c", degree * eom.u.numel())
    since = length * share
    u = ca.vertcat(
        ca.SX(0, 1),
        *[sum((c[k * degree + j] * since**j for j in range(degree)), ca.SX(0)) for k in range(eom.u.numel())],
    )
    t = start + since
    a, lam = numeric.forward_dynamics(redundant=redundant)(t, eom.q, eom.v, eom.z, u, eom.p)
    rate = ca.Function("rate", [*eom.symbols], [eom.z_rate])(t, eom.q, eom.v, a, eom.z, lam, u, eom.p)
    system = {
        "t": share,
        "x": ca.vertcat(eom.q, eom.v, eom.z),
        "p": ca.vertcat(start, length, eom.p, c),
        "ode": length * ca.vertcat(eom.v, a, rate),
    }
    options = {"reltol": TOLERANCE, "abstol": TOLERANCE, "max_num_steps": 100_000}
    return ca.integrator("interval", "erk", system, 0.0, 1.0, options)


def local_errors(solution: Solution) -> np.ndarray:
    """Largest difference in displacements (m) and angles (rad) by interval (N, 2)."""
    n = solution.problem.equations.q.numel()
    errors = solution.end_errors[:, :n]
    angles = solution.program.scales.angles
    return np.column_stack([np.max(errors[:, ~angles], axis=1), np.max(errors[:, angles], axis=1)])


def scaled_errors(solution: Solution) -> np.ndarray:
    """Largest difference by interval: coordinates, velocities times the duration, states by their ranges (N,)."""
    n = solution.problem.equations.q.numel()
    found = np.max(solution.end_errors[:, : 2 * n] * np.repeat([1.0, solution.duration], n), axis=1)
    if not solution.problem.mechanism.states:
        return found
    return np.maximum(found, np.max(state_errors(solution), axis=1))
