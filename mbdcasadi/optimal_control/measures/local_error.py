"""Local errors of the intervals of a solution, by integrating each again from its own mesh point."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ...errors import warn
from ...numerics.tolerances import INTEGRATION
from ..motion.growth import REPLAY_ERROR, UNSTABLE_GROWTH
from ..motion.phase_solution import PhaseSolution
from ..motion.solved_motion import SolvedMotion
from .measure import Measure
from .singularity import close_to_singular

#: Local error of an interval, in rad or sizes of the mechanism, velocities times the duration, from which the mesh
#: counts as coarse. At 0.02 the swing-up of a cart-pole ends 0.1 off when its force is replayed, at 0.001 0.007 off.
COARSE_ERROR = 0.01
#: Sum of the errors of a first-order state, as a share of its range, from which the mesh counts as coarse; those of
#: a lag fade on the way.
COARSE_STATE_ERROR = 0.05
#: Error inside the intervals below which the mesh counts as fine without an integration.
FINE_ERROR = COARSE_ERROR / 3
#: Largest number of intervals to which the mesh is refined without `tolerance` so that a simulation follows.
REPLAY_INTERVALS = 120
#: Share that errors at the ends of intervals have of those inside at most (measured on 21 solutions: up to 0.047), and
#: order of a scheme from which they are so much smaller.
END_SHARE, SHARED_ORDER = 0.05, 6
#: Growth of errors from which rounding and the errors of the solver alone lead a simulation away.
FOLLOWED_GROWTH = 1e7


class LocalErrors(Measure):
    """Largest differences at the ends of the intervals: q (m, rad), v by the duration, states by their ranges."""

    falsifies_cost = True

    def of(self, part: PhaseSolution) -> np.ndarray:
        """Errors of the intervals of a phase (N,)."""
        return part.scaled_errors

    def order(self, part: PhaseSolution) -> int:
        """One more than that of the scheme."""
        return part.program.scheme.order + 1

    @property
    def spread(self) -> float:
        """Errors above the tolerance times their stretches, s."""
        return self.over_stretches

    def sentences(self) -> list[str]:
        """The largest of all."""
        return [f"the local error is still {self.largest:.2g}"] if not self.largest <= self.tolerance else []


class Coarseness(Measure):
    """Errors by which a mesh is no approximation of the motion, see :func:`coarseness`."""

    #: foreseen to be well below
    margin = 4.0
    #: whether the cost is wrong as long as these errors are large
    falsifies_cost: ClassVar[bool] = True

    def __init__(self, solution: SolvedMotion, tolerance: float = COARSE_ERROR):
        super().__init__(solution, tolerance)

    def of(self, part: PhaseSolution) -> np.ndarray:
        """Errors of the intervals of a phase (N,)."""
        return coarseness(part)

    def order(self, part: PhaseSolution) -> int:
        """That of the scheme, one less than of a smooth error, which the steps of projection are not."""
        return part.program.scheme.order

    def sentences(self) -> list[str]:
        """The coarsest interval of each phase, and a remedy."""
        pairs = zip(self.solution.phases, self.errors, strict=True)
        return [coarse_mesh(part, errors) for part, errors in pairs if np.max(errors, initial=0.0) > COARSE_ERROR]


class StateCoarseness(Coarseness):
    """Errors of first-order states by which a mesh is no approximation of these.

    An even share of the sum that is allowed counts as much as :data:`COARSE_ERROR`; zero if no sum is above it.
    """

    def of(self, part: PhaseSolution) -> np.ndarray:
        """Errors of the intervals of a phase (N,)."""
        if not part.phase.mechanism.states:
            return np.zeros(part.mesh.count)
        try:
            errors = part.state_errors
        except RuntimeError:  # the integrator did not get to the end of an interval
            return np.full(part.mesh.count, np.inf)
        coarse = errors[:, ~(np.sum(errors, axis=0) <= COARSE_STATE_ERROR)]
        share = np.max(coarse, axis=1, initial=0.0) * part.mesh.count / COARSE_STATE_ERROR
        return COARSE_ERROR * share

    def sentences(self) -> list[str]:
        """States whose errors, added up as those of a meter do, count beside their ranges, and a remedy."""
        pairs = zip(self.solution.phases, self.errors, strict=True)
        return [
            f"the mesh of {part.mesh.count} intervals is too coarse for the state '{state.label}': the intervals, "
            f"integrated again, end off by {error:.2g} of its range in all; take more intervals=, or tolerance= for a "
            "mesh that is refined"
            for part, errors in pairs
            if np.any(errors) and np.all(np.isfinite(errors))
            for state, error in zip(part.phase.mechanism.states, np.sum(part.state_errors, axis=0), strict=True)
            if error > COARSE_STATE_ERROR
        ]


class ReplayErrors(Coarseness):
    """Errors by which a motion is missed that is simulated from its start with its own inputs.

    Local errors, carried on by the motion, which may be unstable. An even share of the sum that is allowed counts as
    much as :data:`COARSE_ERROR`; zero if no sum is above it, or if the mesh would have to be very fine.
    """

    margin = 2.0
    falsifies_cost = False

    def of(self, part: PhaseSolution) -> np.ndarray:
        """Errors of the intervals of a phase (N,)."""
        if not replay_error(part) > REPLAY_ERROR:
            return np.zeros(part.mesh.count)
        try:
            carried = _at_end(part, part.end_errors)
        except RuntimeError:  # the integrator did not get to the end of an interval, which is coarse for that reason
            return np.zeros(part.mesh.count)
        errors = COARSE_ERROR * part.mesh.count / REPLAY_ERROR * carried
        foreseen = np.maximum(self.margin * errors / COARSE_ERROR, 1.0) ** (1 / self.order(part))
        return errors if np.sum(np.ceil(foreseen)) <= REPLAY_INTERVALS else np.zeros(part.mesh.count)

    def order(self, part: PhaseSolution) -> int:
        """One more than that of the scheme: the errors are smooth."""
        return part.program.scheme.order + 1

    def sentences(self) -> list[str]:
        """Phases that are not followed by a simulation with their inputs, and remedies."""
        several = len(self.solution.phases) > 1
        return [
            _not_followed(part, error, f" of phase '{part.phase.name}'" if several else "")
            for part in self.solution.phases
            if part.mesh.count and (error := replay_error(part)) > REPLAY_ERROR
        ]


def _not_followed(part: PhaseSolution, error: float, of_phase: str) -> str:
    """Miss of a simulation with the inputs of a phase, its cause and a remedy, in words."""
    growth, tolerance = part.largest_growth, f"take tolerance= (local errors are up to {part.mesh_error:.1g})"
    unstable = growth > UNSTABLE_GROWTH
    remedy = "only feedback keeps it on its way" if growth > FOLLOWED_GROWTH else tolerance
    remedy += ", or feedback that keeps it on its way" if unstable and growth <= FOLLOWED_GROWTH else ""
    return (
        f"{'the motion is unstable: ' if unstable else ''}a simulation with the inputs that were found misses the "
        f"motion{of_phase}{_by(error, growth)}, since errors grow by a factor of {growth:.2g} on the way; {remedy}"
    )


def _by(error: float, growth: float) -> str:
    """A miss in words, as the least one if the errors of the simulation itself are carried far.

    Beyond the size of the mechanism a sum to first order is no amount.
    """
    more = " or more" if growth > FOLLOWED_GROWTH else ""
    return f" by about {error:.1g} in radians or sizes of the mechanism{more}" if error < 1 else " altogether"


def replay_error(part: PhaseSolution) -> float:
    """Largest miss of a coordinate, to first order, in a simulation with the inputs of the motion; rad or sizes.

    Zero if it is certainly small, and that of an integration alone if intervals cannot be integrated again.
    """
    least = INTEGRATION * part.largest_growth
    share = END_SHARE if part.program.scheme.order >= SHARED_ORDER else 1.0
    if max(share * np.sum(_at_end(part, part.inner_errors)), least) <= REPLAY_ERROR:
        return 0.0
    try:
        carried = part.growth.carried(part.end_differences)
    except RuntimeError:  # the integrator did not get to the end of an interval
        return least
    scales = part.program.scales.q
    return max(least, float(np.max(np.abs(carried[:, : scales.size]) / scales, initial=0.0)))


def _at_end(part: PhaseSolution, errors: np.ndarray) -> np.ndarray:
    """What errors of the intervals (N, 2 n or more) have become at the end, at most (N,)."""
    places = part.growth.places
    scaled = errors[:, places] / part.state_sizes[places]
    carried = np.einsum("ijk,ik->ij", np.abs(part.growth_to_end), scaled)
    largest_ones: np.ndarray = np.max(carried, axis=1, initial=0.0)
    return largest_ones


def warn_of_coarse_mesh(solution: SolvedMotion) -> None:
    """Warn if an interval, integrated again from its own mesh point, ends far from the next one."""
    for measure in (StateCoarseness(solution), Coarseness(solution)):
        for sentence in measure.sentences():
            warn(sentence)


def warn_of_growth(solution: SolvedMotion) -> None:
    """Warn if a motion on a mesh that is fine enough is not followed by a simulation with its own inputs."""
    for sentence in ReplayErrors(solution).sentences() if Coarseness(solution).largest <= COARSE_ERROR else ():
        warn(sentence)


def coarseness(part: PhaseSolution) -> np.ndarray:
    """Errors of the intervals in rad or sizes of the mechanism, velocities times the duration (N,).

    Zero if they are certainly small, infinite if an interval cannot be integrated again.
    """
    sizes = part.state_sizes
    steps = part.projection_steps / sizes
    fine = max(np.max(part.inner_errors / sizes), np.max(steps)) <= FINE_ERROR  # nan is not
    if fine and not part.phase.mechanism.states:
        return np.zeros(part.mesh.count)
    try:
        errors: np.ndarray = np.max(part.end_errors[:, : sizes.size] / sizes, axis=1)
    except RuntimeError:  # the integrator did not get to the end of an interval
        return np.full(part.mesh.count, np.inf)
    return errors


def coarse_mesh(part: PhaseSolution, errors: np.ndarray) -> str:
    """Return in words where the mesh is coarse, from the errors of its intervals (N,), and a remedy."""
    worst = int(np.argmax(errors))
    others = int(np.sum(errors > COARSE_ERROR)) - 1
    begin, end = part.mesh_times[worst : worst + 2]
    more = f"; so do {others} others" if others else ""
    return (
        f"the mesh of {part.mesh.count} intervals is too coarse for the motion that was found: the interval from "
        f"t = {begin:.6g} to {end:.6g} s, integrated again from its own start, ends elsewhere (by {errors[worst]:.2g} "
        f"in radians or sizes of the mechanism, velocities times the duration{more}); take more intervals=, or "
        f"tolerance= for a mesh that is refined{close_to_singular(part, worst)}"
    )
