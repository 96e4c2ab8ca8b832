"""Errors of the cost: those of its integral, what it may be wrong by if a state comes late, and those of the mesh.

The integral over an interval is a sum over few points. Where the cost jumps or bends with the motion, or in time, it
differs from that along the same polynomials, which a finer rule gives, and an optimum makes use of that. It makes use
of the local errors of the motion, too: by the costates, which say what a step of the state at a mesh point costs.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from ...errors import warn
from ...numerics.symbolic import symbolic
from ..motion.phase_solution import PhaseSolution
from ..motion.solved_motion import SolvedMotion
from ..transcription.rows import RowKind
from .local_error import COARSE_ERROR, Coarseness
from .measure import Measure

#: Points of each half of an interval by which the integral is found again.
POINTS = 5
#: Share of its typical size below which a cost is zero.
NO_COST = 1e-6
#: Share of the cost from which its error by the mesh is told: that of the last of four digits.
TOLD_SHARE = 1e-4


def cost_size(solution: SolvedMotion) -> float:
    """Absolute value of the cost, without cancellation in its running part, or a small share of its typical size."""
    return max(solution.cost_size, NO_COST * solution.program.cost_scale)


@symbolic
def integral_errors(part: PhaseSolution) -> np.ndarray:
    """Return the errors of the integral of the running cost in the intervals (N,)."""
    running, count = part.phase.running_cost, part.mesh.count
    if running.is_zero() or not count:
        return np.zeros(count)
    own, weights = part.program.quadrature(running)
    points, fine = np.polynomial.legendre.leggauss(POINTS)
    halves = (1 + points) / 4
    taus, finer = np.r_[own, halves, halves + 0.5], np.r_[fine, fine] / 4
    k, tau = np.repeat(np.arange(count), taus.size), np.tile(taus, count)
    (values,) = part.by_polynomials([running], k, tau)
    values = np.broadcast_to(values, (1, k.size)).reshape(count, taus.size)
    errors: np.ndarray = np.abs(values[:, : own.size] @ weights - values[:, own.size :] @ finer)
    # an end that comes up to a jump in time may belong there, or before it
    errors[part.stopped] = np.max(np.abs(values[part.stopped]), axis=1)
    return errors * np.diff(part.mesh_times)


@symbolic
def cost_slopes(part: PhaseSolution) -> np.ndarray:
    """Largest absolute slopes of the running cost by the states at both ends of each interval (N, k)."""
    eom, count = part.phase.equations, part.mesh.count
    states = ca.vertcat(eom.q, eom.v, eom.z)
    slopes = ca.jacobian(part.phase.running_cost, states)
    if not slopes.nnz():
        return np.zeros((count, states.numel()))
    k, tau = np.repeat(np.arange(count), 2), np.tile([0.0, 1.0], count)
    (values,) = part.by_polynomials([slopes.T], k, tau)
    largest: np.ndarray = np.max(np.abs(values.T.reshape(count, 2, -1)), axis=1)
    return np.nan_to_num(largest, nan=0.0, posinf=0.0)


class CostErrors(Measure):
    """Errors of the integral of the running cost in the intervals, if their sum is above the tolerance.

    An even share of the sum that is allowed, the tolerance as a share of the whole cost, counts as much as that.
    """

    falsifies_cost = True

    def of(self, part: PhaseSolution) -> np.ndarray:
        """Errors of the intervals of a phase (N,)."""
        share = integral_errors(part) / cost_size(self.solution)
        wrong = len(self.solution.phases) * np.sum(share) > self.tolerance
        return share * part.mesh.count if wrong else np.zeros(share.size)

    def order(self, part: PhaseSolution) -> int:
        """One, since the cost jumps or bends."""
        return 1

    def pieces(self, part: PhaseSolution) -> np.ndarray:
        """Number of pieces of each interval (N,); inputs that are constant on intervals keep their mesh."""
        keeps = part.stopped | (part.program.scheme.inputs.name == "constant")
        return np.where(keeps, 1, super().pieces(part))

    @property
    def loss(self) -> float:
        """Sum of the errors."""
        pairs = zip(self.solution.phases, self.errors, strict=True)
        return float(sum(np.sum(errors) / max(part.mesh.count, 1) for part, errors in pairs))

    @property
    def spread(self) -> float:
        """Loss times the duration."""
        return self.loss * self.solution.duration

    def sentences(self) -> list[str]:
        """The largest error, with its time."""
        if not self.largest:
            return []
        part, k = self.worst
        return [
            f"the integral of the running cost, which is off by about {self.loss:.2g} of it, at t = "
            f"{part.mesh_times[k]:.6g} s most"
        ]


@symbolic
def errors_of_mesh(solution: SolvedMotion, part: PhaseSolution) -> np.ndarray:
    """Return the amounts by which the local errors of a phase may falsify the cost, to first order, by interval (N,).

    The costates of the states at the mesh points times the local errors, which are gaps that the rows of continuity do
    not see. Zero for a scheme that does not carry states from mesh point to mesh point by these rows, as
    Hermite-Simpson, and infinite if an interval cannot be integrated again.
    """
    by_interval = np.zeros(part.mesh.count)
    if not part.mesh.count or not part.program.scheme.integrates_accelerations:
        return by_interval
    multipliers = -solution.answer.lam_g * solution.program.cost_scale
    eom = part.program.scheme.eom
    n, chosen = part.phase.equations.q.numel(), list(eom.independent)
    coordinates = dict(zip(eom.coordinate_names, chosen, strict=True))
    columns = {(RowKind.CONTINUITY, name): k for name, k in coordinates.items()}
    columns |= {(RowKind.VELOCITY_CONTINUITY, name): n + k for name, k in coordinates.items()}
    columns |= {(RowKind.CONTINUITY, z.label): 2 * n + k for k, z in enumerate(part.phase.mechanism.states)}
    try:
        gaps = part.end_differences
    except RuntimeError:  # the integrator did not get to the end of an interval
        return np.full(part.mesh.count, np.inf)
    for row, multiplier in zip(solution.program.rows, multipliers.tolist(), strict=True):
        column = columns.get((row.kind, row.name.owner))
        if row.repeated and row.phase == part.program.number and column is not None:
            by_interval[row.interval] += multiplier / row.size * gaps[row.interval, column]
    return np.abs(by_interval)


def error_of_mesh(solution: SolvedMotion) -> float:
    """Return the amount by which the local errors of the motion may falsify the cost: the sum over its intervals."""
    return float(sum(np.sum(errors_of_mesh(solution, part)) for part in solution.phases))


class FalseCost(Coarseness):
    """Errors by which local errors falsify the cost, if their sum is told.

    An even share of the sum that is allowed counts as much as :data:`COARSE_ERROR`.
    """

    margin = 2.0
    falsifies_cost = False

    def of(self, part: PhaseSolution) -> np.ndarray:
        """Errors of the intervals of a phase (N,)."""
        errors = errors_of_mesh(self.solution, part)
        share = np.sum(errors) / (TOLD_SHARE * cost_size(self.solution))
        if not 1.0 < len(self.solution.phases) * share < np.inf:
            return np.zeros(errors.size)
        scaled: np.ndarray = COARSE_ERROR * share * errors.size * errors / np.sum(errors)
        return scaled

    def order(self, part: PhaseSolution) -> int:
        """One more than that of the scheme, as local errors have it."""
        return part.program.scheme.order + 1


def warn_of_false_cost(solution: SolvedMotion) -> None:
    """Warn if the local errors of a motion on a mesh that is fine enough for it falsify the cost."""
    amount, size = error_of_mesh(solution), cost_size(solution)
    if TOLD_SHARE * size < amount < np.inf and Coarseness(solution).largest <= COARSE_ERROR:
        warn(
            f"the mesh of {sum(part.mesh.count for part in solution.phases)} intervals is too coarse for the cost: "
            f"{solution.cost:.6g} may be off by {amount:.2g}, since the solver makes use of local errors of the motion "
            f"(up to {solution.mesh_error:.1g}), and a least time may be below the true one; take more intervals=, or "
            "tolerance=, a smaller one, for a mesh that is refined"
        )
