"""Mesh refinement: intervals are split and merged until their local errors suit the tolerance."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np

from ...errors import OptimizationError, warn
from ...numerics.console import interruptible
from ..measures.cost_error import CostErrors, cost_size
from ..measures.input_error import UnresolvedInputs
from ..measures.known_courses import KnownCourses
from ..measures.limit_error import PassedLimits
from ..measures.local_error import LocalErrors
from ..measures.measure import Measure, pieces_of, split
from ..measures.singularity import close_to_singular
from ..measures.switches import UnresolvedSwitches
from ..measures.time_jumps import TimeJumps, meshes_at_jumps
from ..motion.limit_excess import LIMIT_TOLERANCE
from ..motion.phase_solution import PhaseSolution
from ..motion.reintegration import not_integrated
from ..program.statistics import Attempt
from ..solution import Solution
from ..solve.expressions import jump_on_the_way
from ..solve.problem_solver import ProblemSolver
from ..transcription.mesh import Mesh, interval_count
from .coarse_mesh import HALVED_INTERVALS

#: What is measured on a solution with small local errors.
MEASURES: tuple[type[Measure], ...] = (
    UnresolvedSwitches, PassedLimits, UnresolvedInputs, KnownCourses, CostErrors, TimeJumps,
)  # fmt: skip
#: Largest number of passes, and of intervals of a mesh.
PASSES, INTERVALS = 12, 2000
#: Passes in which mesh points move to switches, or are put at kinks; after these the intervals are split.
MOVES = 5
#: Share of a step of mesh points to kinks that did not get shorter from which on this is tried again.
PLACED_AGAIN = 0.01
#: Multiple of a loss, which is estimated, by which the cost may be wrong.
UNCERTAIN = 100.0
#: Least and largest number of iterations that are left to a pass from a solution with small local errors.
ITERATIONS = (100, 300)
#: Multiple of the work of the first solve, in iterations times intervals, after which such a solution is not improved,
#: unless the last pass did so.
WORK = 20
#: Number of iterations that a first solve counts at least: one of a few is no measure of what a solution is worth.
USUAL_ITERATIONS = 25
#: Number of passes with small local errors after which these end if none of them is better than the one before, once
#: half of that work is done.
PATIENCE = 3
#: Multiple of the tolerance, as a share of the duration, below which errors times their stretches may rise for once.
SMALL_SPREAD = 10
#: Tolerance of the solver, by which it relaxes limits and may miss the least cost, both scaled.
SOLVER_TOLERANCE = 1e-8
#: Share of the tolerance below which the error of two merged intervals must be foreseen.
MERGING_SHARE = 0.05


def refine(solver: ProblemSolver, solution: Solution, tolerance: float) -> Solution:
    """Solve on other meshes until states, inputs, limits and switches meet a tolerance.

    An interval with error e is split into ``ceil((2 e / tolerance)^(1 / (r + 1)))``
    pieces, r the order of the scheme; neighbours whose common interval is
    foreseen to stay far below the tolerance are merged. Then mesh points move to the switches, see
    :mod:`switches`, others are put at kinks, see :mod:`kinks`, and intervals in which the motion passes limits, or
    inputs have larger errors than the tolerance, are split, see :mod:`input_error`. Each pass starts from the last
    solution. Of those with small local errors the best one is kept, and passes end that do not improve it.

    Raises
    ------
    OptimizationError
        If a pass fails, with the last solution in ``.reached``, or if no mesh was found that meets the tolerance,
        with the last solution in ``.partial``.

    Warns
    -----
    MechanismWarning
        If local errors meet the tolerance, but inputs, limits, switches or the integral of the running cost do not, or
        if costs, limits or forces jump with the states or free parameters, which derivatives do not show.
    """
    refined = _Refinement(solver, solution, tolerance).run()
    jump = jump_on_the_way(refined)
    if jump:
        warn(
            f"the cost may be off by more than the tolerance {tolerance:g}: {jump}, and the solver does not see what a "
            "shift of that time changes; divide the motion into phases= there, each with what holds on its side"
        )
    return refined


class _Refinement:
    """Passes of a refinement: the last solution and its errors."""

    def __init__(self, solver: ProblemSolver, solution: Solution, tolerance: float):
        self.solution, self.tolerance = solution, tolerance
        #: the solver, and the factor by which the cost counts for more in it, if that is far smaller than is typical
        self.solver, self.raised = solver.with_raised_cost(solution)
        #: share of its size by which a path limit may be passed between the points at which it is enforced
        self.limit_tolerance = LIMIT_TOLERANCE
        self.passes: list[Attempt] = []
        #: largest local error of each of them, and errors times their stretches
        self.history: list[tuple[float, float]] = []
        self.merging, self.moves = True, MOVES
        #: steps of mesh points when measures last placed them, and steps below which they do so again: as long as no
        #: interval is split, and for good, once they did so in vain
        self.steps: dict[type[Measure], float] = {}
        self.shorter: dict[type[Measure], float] = {}
        self.shortest: dict[type[Measure], float] = {}
        #: True if the last pass had more mesh points for switches, or more that move
        self.resolves = False
        #: largest errors times their stretches, before the last pass that split intervals for these
        self.spread = np.inf
        #: the best solution with small local errors, what it does not meet, and what is lost by that
        self.reached: tuple[Solution, str] | None = None
        self.least = np.inf
        #: share of its cost that it may not have, since it passes limits, or its integral is off
        self.doubt = np.inf
        #: number of solutions since then that are not better
        self.in_vain = 0
        #: True if the last one is far better than those before
        self.gains = True

    def run(self) -> Solution:
        """Return the solution that meets the tolerance."""
        reason = f"{PASSES} passes are made"
        for _ in range(PASSES):
            self._measure()
            if self.error <= self.tolerance and not self._missed():
                return self.solution
            is_vain = self.in_vain >= PATIENCE and self._work() > WORK / 2
            meshes = None if is_vain else self._meshes()
            if meshes is None:
                reason = "the errors do not fall any further"
                break
            if self.error <= self.tolerance and not self.gains and self._work() > WORK:
                reason = f"the passes took {self._work():.0f} times the work of the first solve"
                break
            if interval_count(meshes) > INTERVALS:
                reason = f"the next mesh would have {interval_count(meshes)} intervals"
                break
            if not self._solve(meshes):
                reason = "the solver fails on the next mesh"
                break
        return self._given_up(reason)

    def _work(self) -> float:
        """Work of all passes but the first one, as a multiple of that."""
        others = sum(max(one.iterations, 1) * one.intervals for one in self.passes[1:])
        return others / self._first_work

    @property
    def _first_work(self) -> int:
        """Work of the first pass, or of a usual one on its mesh."""
        first = self.passes[0]
        return max(first.iterations, USUAL_ITERATIONS) * first.intervals

    def _iterations(self, meshes: list[Mesh]) -> int:
        """Largest number of iterations of a pass on meshes, within the work that is left."""
        left = (WORK - self._work()) * self._first_work
        return int(np.clip(left / interval_count(meshes), *ITERATIONS))

    def _measure(self) -> None:
        """Errors of the intervals of the last solution, and its entry in the table of passes."""
        solution = self.solution
        self.local = _local_errors(solution, self.tolerance)
        self.error = self.local.largest
        self.history.append((self.error, self.local.spread))
        self.passes.append(solution.as_attempt("refinement", error=self.error))
        solution.statistics = replace(solution.statistics, passes=list(self.passes))

    def _missed(self) -> str:
        """Demands that a solution with small local errors does not meet, in words; nothing if it meets all."""
        self.measures = [measure(self.solution, self.tolerance) for measure in MEASURES]
        in_vain = [type(m) for m in self.measures if m.step > self.shorter.get(type(m), np.inf)]
        self.shortest |= {kind: self.steps[kind] * PLACED_AGAIN for kind in in_vain}
        # what mesh points that move did not resolve counts no more once the cost does not change
        done = self.resolves and self._is_settled()
        missed = [m.sentences()[:1] for m in self.measures if not (done and m.moves)]
        words = " and ".join(text for one in missed for text in one)
        loss = min(sum(measure.loss for measure in self.measures), 1.0)
        better = self._is_better(loss)
        self.gains = better and loss < self.least / 4
        self.in_vain = 0 if better and (loss < self.least or loss >= 1) else self.in_vain + 1
        if better:
            self.reached, self.least = (self.solution, words), loss
            doubts = (m.largest for m in self.measures if m.falsifies_cost and m.sentences())
            self.doubt = max(doubts, default=0.0)
        return words

    def _is_better(self, loss: float) -> bool:
        """Return True if the last solution is better than the best one so far.

        By what is lost, unless the costs differ by far more than that, as those of two optima do, or all may be lost.
        What inputs and switches lose is not missing in the cost of a motion: one that costs more is then no better.
        """
        if self.reached is None:
            return True
        one, other = self.solution, self.reached[0]
        gain, size = other.cost - one.cost, min(cost_size(one), cost_size(other))
        if abs(gain) > UNCERTAIN * (loss if gain > 0 else self.doubt) * size + self.tolerance * size:
            return gain > 0
        return gain >= 0 if loss >= 1 else loss <= self.least

    def _meshes(self) -> list[Mesh] | None:
        """Meshes of the next pass; None if there is none that is better."""
        at_jumps = meshes_at_jumps(self.solution, self.tolerance)
        if at_jumps is not None:
            self._begin_anew()
            return at_jumps
        return self._adapted() if self.error > self.tolerance else self._moved() or self._split()

    def _adapted(self) -> list[Mesh] | None:
        """Meshes with intervals split and merged by their local errors; None if these do not fall any further.

        At a kink, as of smoothed friction, an error stays as it is until the stretch is short enough. An error may move
        on to the next interval, too, which was just below the tolerance or is coarse for a fast motion: all are halved.
        """
        *earlier, now = self.history[-3:]
        falls = any(last <= max(before) / 2 for last, *before in zip(now, *earlier, strict=True)) if earlier else True
        if len(earlier) == 2 and not falls and not self.merging:
            if interval_count(self.solution.meshes) > HALVED_INTERVALS:
                return None
            self._begin_anew()
            return [mesh.split(2) for mesh in self.solution.meshes]
        self.merging = self.merging and self.error <= min((error for error, _ in earlier), default=np.inf) / 2
        order = self.solution.phases[0].program.scheme.order
        adapt = partial(adapted, tolerance=self.tolerance, order=order, merging=self.merging)
        return [adapt(mesh, errors) for mesh, errors in zip(self.solution.meshes, self.local.errors, strict=True)]

    def _moved(self) -> list[Mesh] | None:
        """Meshes with points that move; None if none do, or moving these does not change the cost any more."""
        moved = [self._placed(part) for part in self.solution.phases]
        if not self.moves or all(a is b for a, b in zip(moved, self.solution.meshes, strict=True)):
            return None
        if self._is_settled() and all(map(Mesh.is_same, moved, self.solution.meshes)):
            return None
        self.moves -= 1
        steps = {type(measure): measure.step for measure in self._placing if measure.step}
        self.steps |= steps
        self.shorter |= {kind: step / 2 for kind, step in steps.items()}
        self.spread = np.inf
        self._begin_anew()
        # while a switch lies within an interval, further points at which a limit holds there are mostly of no use
        needed = any(measure.needs_limits for measure in self.measures)
        self.limit_tolerance = self.tolerance if needed else LIMIT_TOLERANCE
        return moved

    def _placed(self, part: PhaseSolution) -> Mesh:
        """The mesh of a phase with the points that measures place."""
        mesh = part.mesh
        for measure in self._placing if mesh.count else ():
            mesh = measure.placed(part, mesh)
        return mesh

    @property
    def _placing(self) -> list[Measure]:
        """Measures that place mesh points: not those whose steps do not get shorter, as at a peak that is no kink."""
        limits = self.shortest | self.shorter
        return [m for m in self.measures if not m.step > limits.get(type(m), np.inf)]

    def _begin_anew(self) -> None:
        """Forget the local errors of other meshes, of which nothing follows for the next ones."""
        self.history, self.merging = [], False

    def _split(self) -> list[Mesh] | None:
        """Meshes with intervals split as the measures need it; None if that did not help in the last pass."""
        self.limit_tolerance = self.tolerance
        self.shorter = {}
        before, spread = self.spread, max(measure.spread for measure in self.measures)
        if np.isinf(before):  # mesh points that moved in vain say nothing about finer meshes
            self.in_vain = 0
        self.spread = spread or np.inf
        self._begin_anew()
        stays = spread > max(0.8 * before, SMALL_SPREAD * self.tolerance * self.solution.duration)
        finer = [split(part, self.measures) for part in self.solution.phases]
        keeps = self.solution.settings.control == "constant" and all(map(Mesh.is_same, finer, self.solution.meshes))
        return None if stays or keeps else finer

    def _is_settled(self) -> bool:
        """Return True if the cost did not change in the last pass, beyond the tolerance and that of the solver."""
        if len(self.passes) < 2:
            return False
        now, before = self.passes[-1].cost, self.passes[-2].cost
        size = self.solution.program.cost_scale / self.raised
        return abs(now - before) <= self.tolerance * abs(now) + SOLVER_TOLERANCE * size

    def _solve(self, meshes: list[Mesh]) -> bool:
        """Solve on other meshes from the last solution, and return True if that succeeds.

        Raises
        ------
        OptimizationError
            If it does not, and no solution has small local errors yet.
        """
        solver, guess, near = self.solver, self.solution.as_guess(self.solver.problem), self.error <= self.tolerance
        solver.best.new_stage()
        structures = [mesh.structure for mesh in self.solution.meshes]
        self.resolves = near and structures != [mesh.structure for mesh in meshes]
        try:
            limit = self._iterations(meshes) if near else None
            self.solution = solver.solve(meshes, guess, warm=True, limit=limit, limit_tolerance=self.limit_tolerance)
            return True
        except OptimizationError:
            if near:  # mesh points that do not move well move no more
                moved, self.moves = self.moves > 0, 0
                again = self._meshes() if moved else None
                if again is None or all(map(Mesh.is_same, again, meshes)):
                    again = [mesh.without_free() for mesh in meshes]
                return not all(map(Mesh.is_same, again, meshes)) and self._solve(again)
        try:  # a guess that is near on one mesh may be far on another
            self.solution = solver.solve(meshes, guess, limit_tolerance=self.limit_tolerance)
            return True
        except OptimizationError as failure:
            if self.reached is not None:
                return False
            failure.reached = self.solution
            raise

    def _given_up(self, reason: str) -> Solution:
        """The last solution with small local errors, with a warning of what it does not meet."""
        if self.reached is not None:
            solution, missed = self.reached
            solution.statistics = replace(solution.statistics, passes=list(self.passes))
            warn(f"the local errors meet the tolerance {self.tolerance:g}, but not {missed}: {reason}")
            return solution
        (missed,) = self.local.sentences()
        raise OptimizationError(
            f"the mesh was refined to {interval_count(self.solution.meshes)} intervals and {missed}, above the "
            f"tolerance {self.tolerance:g}: {reason}; the last solution is in .partial",
            partial=self.solution,
        )


def _local_errors(solution: Solution, tolerance: float) -> LocalErrors:
    """Local errors of the intervals; Ctrl-C in compiled code comes as what it is."""
    with interruptible() as interruption:
        try:
            return LocalErrors(solution, tolerance)
        except RuntimeError:
            if interruption.requested:
                raise KeyboardInterrupt from None
            _refuse_not_integrated(solution)
            raise


def _refuse_not_integrated(solution: Solution) -> None:
    """Raise an :class:`OptimizationError` for an interval that cannot be integrated again: its times, and why."""
    for part in solution.phases:
        found = not_integrated(part.polynomials) if part.mesh.count else None
        if found is not None:
            interval, reason = found
            begin, end = part.mesh_times[interval : interval + 2]
            raise OptimizationError(
                f"the tolerance cannot be checked: from t = {begin:.6g} to {end:.6g} s the motion, integrated again "
                f"from its own mesh point, stops ({reason}){close_to_singular(part, interval)}; without tolerance= "
                "the mesh is not refined; the solution is in .partial",
                partial=solution,
                time=float(begin),
            ) from None


def adapted(mesh: Mesh, errors: np.ndarray, tolerance: float, order: int, *, merging: bool = True) -> Mesh:
    """Return the mesh with intervals split or merged by their local errors.

    Parameters
    ----------
    mesh : Mesh
        Present mesh.
    errors : numpy.ndarray
        Local errors (N,).
    tolerance : float
        Value that they should stay below.
    order : int
        Order of the scheme: local errors go with the power ``order + 1`` of the length.
    merging : bool
        True if intervals may be merged: not after a pass that did not bring the error down.
    """
    pieces = pieces_of(errors, tolerance, order + 1)
    merge = np.zeros(errors.size, bool)
    k = 0
    while merging and k + 1 < errors.size:
        together = (mesh.length[k] + mesh.length[k + 1]) / np.minimum(mesh.length[k], mesh.length[k + 1])
        foreseen = max(errors[k], errors[k + 1]) * together ** (order + 1)
        if mesh.piece[k] == mesh.piece[k + 1] and foreseen <= MERGING_SHARE * tolerance:
            merge[k] = True
            k += 1
        k += 1
    return mesh.refined(pieces, merge)
