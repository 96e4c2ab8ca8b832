"""Mesh refinement: one loop that solves again on other meshes until the errors of a solution meet a demand."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from ...errors import OptimizationError, warn
from ...numerics.console import interruptible
from ..measures.cost_error import CostErrors, FalseCost, cost_size
from ..measures.input_error import UnresolvedInputs
from ..measures.known_courses import KnownCourses
from ..measures.limit_error import FarPassedLimits, PassedLimits
from ..measures.local_error import COARSE_ERROR, Coarseness, LocalErrors, ReplayErrors, StateCoarseness
from ..measures.measure import Measure, split
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
from ..solve.solvers.ipopt import TOLERANCE
from ..transcription.mesh import Mesh, interval_count
from .budgets import BUDGETS

#: What is measured on a solution with small local errors, if a tolerance is asked for.
MEASURES: tuple[type[Measure], ...] = (
    UnresolvedSwitches, PassedLimits, UnresolvedInputs, KnownCourses, CostErrors, TimeJumps,
)  # fmt: skip
#: What is measured without a tolerance: errors by which a mesh is too coarse for the motion that was found.
COARSE_MEASURES: tuple[type[Measure], ...] = (Coarseness, StateCoarseness, ReplayErrors, FalseCost, FarPassedLimits)
#: Largest number of passes, of intervals of a mesh, and of intervals of one that is halved.
PASSES, INTERVALS, HALVED_INTERVALS = 12, 2000, 200
#: Passes in which mesh points move to switches, or are put at kinks; after these the intervals are split.
MOVES = 5
#: Share of a step of mesh points to kinks that did not get shorter from which on this is tried again.
PLACED_AGAIN = 0.01
#: Multiple of a loss, which is estimated, by which the cost may be wrong.
UNCERTAIN = 100.0
#: Multiple of the work of the first solve, in iterations times intervals, after which a solution with small local
#: errors is not improved, unless the last pass did so, and one that is no motion is given up.
WORK = 20
#: Number of iterations that a first solve counts at least: one of a few is no measure of what a solution is worth.
USUAL_ITERATIONS = 25
#: Local error, in rad or sizes of the mechanism, velocities times the duration, from which a solution is not a motion.
LOST_ERROR = 3.0


@dataclass(frozen=True)
class Demand:
    """What the errors of a solution are to meet.

    Attributes
    ----------
    motion : tuple of type
        Measures of what makes the solution another motion: intervals are split for these first.
    further : tuple of type
        Measures of a solution that meets those: mesh points are placed, or intervals split, for them.
    tolerance : float
        Tolerance of all measures.
    is_listed : bool
        True if the passes are listed in the statistics; they are added up there otherwise.
    """

    motion: tuple[type[Measure], ...]
    further: tuple[type[Measure], ...]
    tolerance: float
    is_listed: bool


#: Demand without a tolerance.
NOT_COARSE = Demand(COARSE_MEASURES, (), COARSE_ERROR, is_listed=False)


def is_lost(solution: Solution) -> bool:
    """Return True if the mesh is so coarse that a solution is not a motion at all."""
    return Coarseness(solution).largest > LOST_ERROR


def is_coarse(solution: Solution) -> bool:
    """Return True if the mesh is too coarse for the motion, and one twice as fine is allowed."""
    return Coarseness(solution).largest > COARSE_ERROR and _can_halve(solution)


def refine_if_coarse(solver: ProblemSolver, solution: Solution) -> tuple[Solution, bool]:
    """Solve again on finer meshes as long as a mesh is too coarse for the motion, or passes limits by far.

    Returns
    -------
    Solution, bool
        The one of the solutions whose errors falsify the cost least, and whether they do so at most by a little.
    """
    refinement = Refinement(solver, solution, NOT_COARSE)
    unmet = refinement.run()
    return (refinement.kept, refinement.false <= 1.0) if unmet else (refinement.solution, True)


def refine(solver: ProblemSolver, solution: Solution, tolerance: float) -> Solution:
    """Solve on other meshes until states, inputs, limits and switches meet a tolerance.

    Of the solutions with small local errors the best one is kept.

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
    raised, factor = solver.with_raised_cost(solution)
    refinement = Refinement(raised, solution, Demand((LocalErrors,), MEASURES, tolerance, is_listed=True), factor)
    reason = refinement.run()
    refined = refinement.solution if not reason else _given_up(refinement, reason)
    jump = jump_on_the_way(refined)
    if jump:
        warn(
            f"the cost may be off by more than the tolerance {tolerance:g}: {jump}, and the solver does not see what a "
            "shift of that time changes; divide the motion into phases= there, each with what holds on its side"
        )
    return refined


def _given_up(refinement: Refinement, reason: str) -> Solution:
    """The best solution with small local errors, with a warning of what it does not meet."""
    kept, tolerance = refinement.kept, refinement.demand.tolerance
    if refinement.false <= 1.0:
        kept.statistics = replace(kept.statistics, passes=list(refinement.passes))
        warn(f"the local errors meet the tolerance {tolerance:g}, but not {refinement.unmet}: {reason}")
        return kept
    last = refinement.solution
    if refinement.failure is not None:
        refinement.failure.reached = last
        raise refinement.failure
    (unmet,) = refinement.motion[0].sentences()
    raise OptimizationError(
        f"the mesh was refined to {interval_count(last.meshes)} intervals and {unmet}, above the "
        f"tolerance {tolerance:g}: {reason}; the last solution is in .partial",
        partial=last,
    )


class Refinement:
    """Passes from mesh to mesh: errors are measured, mesh points placed or intervals split, the program solved again.

    An interval with error e is split into ``ceil((2 e / tolerance)^(1 / r))`` pieces, r the power of its length with
    which the error goes. If the errors do not fall, since a fast motion moved on to the next coarse interval, or the
    program is not solved on the finer mesh, all intervals are halved. Once the solution is the motion, mesh points move
    to switches, see :mod:`switches`, others are put at kinks, see :mod:`kinks`, and at last intervals are split in
    which limits are passed, or inputs have larger errors. Each pass starts from the last solution.

    Parameters
    ----------
    solver : ProblemSolver
    solution : Solution
        That on the first mesh.
    demand : Demand
    raised : float
        Factor by which the cost counts for more in the solver than its typical size has it.

    Attributes
    ----------
    solution, kept : Solution
        The last one and the best one.
    false : float
        Errors of the best one that falsify its cost, in tolerances, at least 1.
    unmet : str
        What the best one does not meet beside these, in words.
    failure : OptimizationError or None
        How the solver failed on the last mesh, if it did.
    passes : list of Attempt
    """

    def __init__(self, solver: ProblemSolver, solution: Solution, demand: Demand, raised: float = 1.0):
        self.solver, self.solution, self.demand, self.raised = solver, solution, demand, raised
        self.passes: list[Attempt] = []
        self.kept, self.false, self.unmet = solution, np.inf, ""
        self.failure: OptimizationError | None = None
        #: largest error of the motion, in tolerances
        self.error = np.inf
        #: that of the pass before with errors times their stretches, and the number of passes since both fell
        self.before: tuple[float, float] | None = None
        self.stalls = 0
        #: share of the cost that the best solution may lack, and that by which it may be wrong
        self.least = self.doubt = np.inf
        #: True if the last solution is far better than those before
        self.gains = True
        #: share of its size by which a path limit may be passed between the points at which it is enforced
        self.limit_tolerance = LIMIT_TOLERANCE
        #: passes left in which mesh points are placed
        self.moves = MOVES
        #: steps of mesh points when measures last placed them, and steps below which they do so again: as long as no
        #: interval is split, and for good, once they did so in vain
        self.steps: dict[type[Measure], float] = {}
        self.shorter: dict[type[Measure], float] = {}
        self.shortest: dict[type[Measure], float] = {}
        #: True if the last pass had more mesh points for switches, or more that move
        self.resolves = False
        #: largest errors times their stretches of further measures, before the last pass that split intervals for these
        self.spread = np.inf

    def run(self) -> str:
        """Make passes until the demand is met, and return why they ended before; an empty text if they did not."""
        for number in range(PASSES + 1):
            self._measure()
            if self.error <= 1.0 and not self._unmet():
                return ""
            reason = self._pass() if number < PASSES else f"{PASSES} passes are made"
            if reason:
                break
        return reason

    # --- errors -----------------------------------------------------------------------------------
    def _measure(self) -> None:
        """Measure the last solution, and keep it if it is the best one."""
        solution, demand = self.solution, self.demand
        self.motion = _measured(solution, demand.motion, demand.tolerance)
        self.error = max(measure.largest for measure in self.motion) / demand.tolerance
        self.stalls = 0 if self._falls() else self.stalls + 1
        self.measures = _measured(solution, demand.further, demand.tolerance) if self.error <= 1.0 else []
        attempt = solution.as_attempt("refinement", error=self.motion[0].largest)
        self.passes.append(attempt)
        if demand.is_listed:
            solution.statistics = replace(solution.statistics, passes=list(self.passes))
        if self.error > 1.0:
            self._keep("")

    def _falls(self) -> bool:
        """Return True if the largest error of the motion, or that of all stretches, fell by half in the last pass."""
        before, spread = self.before, max(measure.spread for measure in self.motion)
        self.before = self.error, spread
        return before is None or self.error < max(1.0, before[0] / 2) or 0 < spread < before[1] / 2

    def _unmet(self) -> str:
        """Demands that a solution with small local errors does not meet, in words; nothing if it meets all."""
        in_vain = [type(m) for m in self.measures if m.step > self.shorter.get(type(m), np.inf)]
        self.shortest |= {kind: self.steps[kind] * PLACED_AGAIN for kind in in_vain}
        # what mesh points that move did not resolve counts no more once the cost does not change
        done = self.resolves and self._is_settled()
        unmet = [m.sentences()[:1] for m in self.measures if not (done and m.moves)]
        words = " and ".join(text for one in unmet for text in one)
        self._keep(words)
        return words

    def _keep(self, unmet: str) -> None:
        """Keep the last solution if it is the best one."""
        falsifying = [m for m in self.motion if m.falsifies_cost]
        false = max(1.0, *(m.largest / m.tolerance for m in falsifying))
        loss = min(sum(measure.loss for measure in [*self.motion, *self.measures]), 1.0)
        better = false < self.false or (false == self.false and self._is_better(loss))
        self.gains = better and (false < self.false or loss < self.least / 4)
        if better:
            self.kept, self.false, self.unmet, self.least = self.solution, false, unmet, loss
            self.doubt = max((m.largest for m in self.measures if m.falsifies_cost and m.sentences()), default=0.0)

    def _is_better(self, loss: float) -> bool:
        """Return True if the last solution is better than the best one so far.

        By what is lost, unless the costs differ by far more than that, as those of two optima do, or all may be lost.
        What inputs and switches lose is not missing in the cost of a motion: one that costs more is then no better.
        """
        one, other = self.solution, self.kept
        gain, size = other.cost - one.cost, min(cost_size(one), cost_size(other))
        if abs(gain) > UNCERTAIN * (loss if gain > 0 else self.doubt) * size + self.demand.tolerance * size:
            return gain > 0
        return gain >= 0 if loss >= 1 else loss <= self.least

    def _is_settled(self) -> bool:
        """Return True if the cost did not change in the last pass, beyond the tolerance and that of the solver."""
        if len(self.passes) < 2:
            return False
        now, before = self.passes[-1].cost, self.passes[-2].cost
        size = self.solution.program.cost_scale / self.raised
        return abs(now - before) <= self.demand.tolerance * abs(now) + TOLERANCE * size

    # --- the next mesh ----------------------------------------------------------------------------
    def _pass(self) -> str:
        """Solve on the next mesh, and return why there is none that is solved; an empty text if there is one."""
        near = self.error <= 1.0
        meshes = self._meshes()
        if meshes is None or (not near and all(map(Mesh.is_same, meshes, self.solution.meshes))):
            return "the errors do not fall any further"
        if (is_lost(self.solution) or (near and not self.gains)) and self._work() > WORK:
            return f"the passes took {self._work():.0f} times the work of the first solve"
        if interval_count(meshes) > INTERVALS:
            return f"the next mesh would have {interval_count(meshes)} intervals"
        if self._solve(meshes):
            return ""
        others = self._other_meshes(meshes)
        return "" if others is not None and self._solve(others) else "the solver fails on the next mesh"

    def _work(self) -> float:
        """Work of all passes but the first one, as a multiple of that."""
        return sum(max(one.iterations, 1) * one.intervals for one in self.passes[1:]) / self._unit

    @property
    def _unit(self) -> int:
        """Work of the first solve, in iterations times intervals."""
        first = self.passes[0]
        return max(first.iterations, USUAL_ITERATIONS) * first.intervals

    def _meshes(self) -> list[Mesh] | None:
        """Meshes of the next pass; None if there is none that is better."""
        at_jumps = meshes_at_jumps(self.solution, self.demand.tolerance) if self.demand.further else None
        if at_jumps is not None:
            self._forget()
            return at_jumps
        return self._split_for_motion() if self.error > 1.0 else self._moved() or self._split()

    def _other_meshes(self, meshes: list[Mesh]) -> list[Mesh] | None:
        """Meshes in place of those on which the solver failed; None if there are no others.

        Mesh points that do not move well move no more. In place of split intervals all are halved, and vice versa.
        """
        others: list[Mesh] | None
        if self.error > 1.0:
            halved = _can_halve(self.solution) and not self.stalls
            others = [mesh.split(2) if halved else split(part, self.motion) for part, mesh in self._parts]
        else:
            moved, self.moves = self.moves > 0, 0
            others = self._meshes() if moved else None
            if others is None or all(map(Mesh.is_same, others, meshes)):
                others = [mesh.without_free() for mesh in meshes]
        return None if others is None or all(map(Mesh.is_same, others, meshes)) else others

    @property
    def _parts(self) -> Iterable[tuple[PhaseSolution, Mesh]]:
        """Phases of the last solution with their meshes."""
        return zip(self.solution.phases, self.solution.meshes, strict=True)

    def _split_for_motion(self) -> list[Mesh] | None:
        """Meshes with intervals split by the errors of the motion, or halved; None if these do not fall any further.

        At a kink, as of smoothed friction, an error stays as it is until the stretch is short enough. An error may move
        on to the next interval, too, which was just below the tolerance or is coarse for a fast motion: all are halved.
        """
        if self.stalls and not self._tends_to_lock() and _can_halve(self.solution):
            return [mesh.split(2) for mesh in self.solution.meshes]
        return None if self.stalls > 1 else [split(part, self.motion) for part in self.solution.phases]

    def _tends_to_lock(self) -> bool:
        """True if dimensions are free and the linkage is close to a singular pose where the mesh is coarsest.

        No mesh resolves that.
        """
        if not self.solution.problem.free_parameters:
            return False
        part, worst = max(self.motion, key=lambda measure: measure.largest).worst
        return bool(close_to_singular(part, worst))

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
        self._forget()
        # while a switch lies within an interval, further points at which a limit holds there are mostly of no use
        needed = any(measure.needs_limits for measure in self.measures)
        self.limit_tolerance = self.demand.tolerance if needed else LIMIT_TOLERANCE
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

    def _split(self) -> list[Mesh] | None:
        """Meshes with intervals split as further measures need it; None if that did not help in the last pass."""
        self.limit_tolerance = self.demand.tolerance
        self.shorter = {}
        before, spread = self.spread, max(measure.spread for measure in self.measures)
        self.spread = spread or np.inf
        self._forget()
        stays = spread > 0.8 * before
        finer = [split(part, self.measures) for part in self.solution.phases]
        keeps = self.solution.settings.control == "constant" and all(map(Mesh.is_same, finer, self.solution.meshes))
        return None if stays or keeps else finer

    def _forget(self) -> None:
        """Forget the errors of the motion on other meshes, of which nothing follows for the next ones."""
        self.before, self.stalls = None, 0

    # --- one solve --------------------------------------------------------------------------------
    def _solve(self, meshes: list[Mesh]) -> bool:
        """Solve on other meshes from the last solution, and return True if that leads to a motion."""
        solution, solver = self.solution, self.solver
        solver.best.new_stage()
        structures = [mesh.structure for mesh in solution.meshes]
        self.resolves = self.error <= 1.0 and structures != [mesh.structure for mesh in meshes]
        guess, slack = solution.as_guess(solver.problem), self.limit_tolerance
        left = int((WORK - self._work()) * self._unit / interval_count(meshes)) if is_lost(solution) else BUDGETS.finer
        try:
            found = solver.solve(meshes, guess, warm=True, limit=min(left, BUDGETS.finer), limit_tolerance=slack)
        except OptimizationError as failure:
            self.failure = failure
            return False
        self.failure = None
        if is_lost(found) and not is_lost(solution):
            return False
        if not self.demand.is_listed:
            found.statistics = found.statistics.after(solution.statistics)
        self.solution = found
        return True


def _can_halve(solution: Solution) -> bool:
    """True if all intervals of a mesh may be halved."""
    return interval_count(solution.meshes) <= HALVED_INTERVALS


def _measured(solution: Solution, kinds: tuple[type[Measure], ...], tolerance: float) -> list[Measure]:
    """Measures of a solution; Ctrl-C in compiled code comes as what it is."""
    with interruptible() as interruption:
        try:
            return [measure(solution, tolerance) for measure in kinds]
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
