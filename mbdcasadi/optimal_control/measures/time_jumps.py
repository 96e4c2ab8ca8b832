"""Times at which costs, limits or forces jump, or bend, since they depend on time: mesh points are put there.

A running cost whose weight changes within an interval is integrated with the wrong weight for a part of it, and an
optimum owes its cost to that. The times follow from the expressions and the parameters, and are no unknowns: the mesh
points do not move, or are pinned to their times if others around them do.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from ...equations.switching.explicit_time import explicit_time
from ...numerics.scattered import scattered
from ...numerics.symbolic import symbolic
from ...numerics.tolerances import NEGLIGIBLE
from ..motion.phase_solution import PhaseSolution
from ..motion.solved_motion import SolvedMotion
from ..program.phase_program import SHORTEST_SWITCH
from ..transcription.mesh import Mesh
from .measure import Measure

#: Largest number of these times in a phase; of more, as the knots of a table, those with jumps alone count.
MOST_TIMES = 100
#: Share of the typical duration between two mesh points around a jump, if the scheme has points at the ends of
#: intervals, or inputs are continuous there.
AROUND = 2e-6
#: Multiple of the shortest interval beside a mesh point that moves up to which one of these is left out.
NEAREST = 1.5
#: Share of an interval of the mesh before below which a mesh point is too near to one of these.
TOO_NEAR = 0.3


@symbolic
def jump_times(part: PhaseSolution) -> np.ndarray:
    """Return the times inside a phase at which accelerations, costs or limits jump or bend in time (k,), s."""
    phase, program = part.phase, part.program
    eom = phase.equations
    integrands = [phase.running_cost, *[x.expression for x in program.integrals]]
    expressions = ca.vertcat(*integrands, *[c.expression for c in phase.path])
    symbols = ca.vertcat(ca.SX(0, 1), *program.extra_parameters, phase.input_rates)
    if symbols.numel() and ca.depends_on(expressions, symbols):
        values = np.r_[part.extra, 1 + scattered(phase.input_rates.numel()) / 2]
        expressions = ca.substitute(expressions, symbols, ca.DM(values))
    timed = explicit_time(eom, integrands=expressions)
    if not timed.depends:
        return np.zeros(0)
    breaks, restarts = timed.breaks(part.numeric.p, float(part.mesh_times[0]), float(part.mesh_times[-1]))
    if np.sum(restarts) > MOST_TIMES:
        restarts &= breaks.order == 0
    times: np.ndarray = breaks.times[restarts]
    return times if times.size <= MOST_TIMES else np.zeros(0)


class TimeJumps(Measure):
    """Infinite errors of intervals inside which costs, limits or forces jump or bend in time."""

    falsifies_cost = True

    def of(self, part: PhaseSolution) -> np.ndarray:
        """Infinite in intervals with such a time, zero in others (N,)."""
        errors = np.zeros(part.mesh.count)
        times = _mesh_points(part, timed=part.program.time_count > 0)
        missing = times[_distances(part, times) > NEGLIGIBLE * part.duration]
        errors[np.clip(np.searchsorted(part.mesh_times, missing) - 1, 0, part.mesh.count - 1)] = np.inf
        return errors

    def order(self, part: PhaseSolution) -> int:
        """One: the place of a jump."""
        return 1

    def sentences(self) -> list[str]:
        """The first interval of these."""
        found = [(part, int(np.argmax(e))) for part, e in zip(self.solution.phases, self.errors, strict=True) if any(e)]
        return [
            f"a jump of a cost, limit or force in time between t = {part.mesh_times[k]:.6g} and "
            f"{part.mesh_times[k + 1]:.6g} s"
            for part, k in found
        ]

    def placed(self, part: PhaseSolution, mesh: Mesh) -> Mesh:
        """The mesh of a phase with points at these times, pinned if others move."""
        timed = bool(mesh.free or part.program.time_count)
        times = _mesh_points(part, timed=timed)
        if not times.size:
            return mesh
        near = np.argmin(np.abs(part.mesh_times - times[:, None]), axis=1)
        there = np.interp(times, part.mesh_times, part.mesh.positions)
        known = np.abs(part.mesh_times[near] - times) <= NEGLIGIBLE * part.duration
        positions = np.where(known, part.mesh.positions[near], there)
        moving = mesh.positions[list(mesh.free)]
        if timed:
            return mesh.through_points(np.zeros(0), TOO_NEAR, moving, positions)
        return mesh.through_points(positions, TOO_NEAR, moving)


def meshes_at_jumps(solution: SolvedMotion, tolerance: float) -> list[Mesh] | None:
    """Return meshes with points at the times of jumps; None if those of the solution have them all."""
    jumps, parts = TimeJumps(solution, tolerance), solution.phases
    if not jumps.largest:
        return None
    meshes = [jumps.placed(part, part.mesh) if part.mesh.count else part.mesh for part in parts]
    return None if all(map(Mesh.is_same, meshes, solution.meshes)) else meshes


def points_at_jumps(part: PhaseSolution) -> list[int]:
    """Mesh points of a phase at times of jumps."""
    times = _mesh_points(part, timed=part.program.time_count > 0)
    near = np.argmin(np.abs(part.mesh_times - times[:, None]), axis=1)
    return sorted(set(near[_distances(part, times) <= NEGLIGIBLE * part.duration].tolist()))


def _distances(part: PhaseSolution, times: np.ndarray) -> np.ndarray:
    """Distances of times from the next mesh point, s."""
    distances: np.ndarray = np.min(np.abs(part.mesh_times - times[:, None]), axis=1)
    return distances


def _mesh_points(part: PhaseSolution, *, timed: bool) -> np.ndarray:
    """Times at which mesh points are to be: those of the jumps, or two around each of them, s.

    If times are free, mesh points that keep theirs are not too near to each other, nor to start, waypoints and end.
    """
    times, scheme = jump_times(part), part.program.scheme
    at_ends = scheme.inputs.joined or bool(np.any((scheme.stages <= 0) | (scheme.stages >= 1)))
    if not times.size or scheme.inputs.name == "constant":
        return np.zeros(0)
    if at_ends:
        apart = AROUND * max(part.duration, part.program.scales.time)
        times = (times[:, None] + apart / 2 * np.array([-1, 1])).ravel()
    times = times[(times > part.mesh_times[0]) & (times < part.mesh_times[-1])]
    if not timed:
        return times
    nearest = NEAREST * SHORTEST_SWITCH * part.program.scales.time
    kept: list[float] = []
    for time in np.sort(times).tolist():
        if np.min(np.abs([*part.segment_times, *kept[-1:]] - np.array(time))) >= nearest:
            kept.append(time)
    return np.array(kept)
