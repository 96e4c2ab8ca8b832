"""Mesh refinement: intervals are split and merged until their local errors suit the tolerance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from ...errors import warn
from ...numerics.console import interruptible
from ...numerics.real import stretches
from ..checks.failure import OptimizationError
from ..guess.guess import Guess
from ..nlp.held_limits import passed_limits, shares_by_interval
from ..nlp.problem_solver import ProblemSolver
from ..nlp.statistics import Attempt
from ..phase_solution import PhaseSolution
from ..solution import Solution
from .input_error import input_order, unresolved_inputs
from .local_error import COARSE_ERROR, coarseness, state_coarseness
from .mesh import Mesh
from .singularity import close_to_singular
from .switches import unresolved_switches

#: Largest number of passes, of pieces into which an interval is split, and of intervals of a mesh.
PASSES, PIECES, INTERVALS = 12, 6, 2000
#: Passes in which mesh points around switches move; after these their intervals are split.
MOVES = 3
#: Largest number of passes for a mesh that is too coarse, if no tolerance is asked for, and of intervals of a mesh that
#: is halved for it.
COARSE_PASSES, HALVED_INTERVALS = 4, 200
#: Local error, in rad or sizes of the mechanism, velocities times the duration, from which a solution is no motion, and
#: largest number of meshes, each twice as fine, on which it is then solved again from its guess.
LOST_ERROR, FRESH_PASSES = 3.0, 2
#: Tolerance of the solver, by which it relaxes limits and may miss the least cost, both scaled.
SOLVER_TOLERANCE = 1e-8
#: Share of the tolerance below which the error of two merged intervals must be foreseen.
MERGING_SHARE = 0.05


def refine(solver: ProblemSolver, solution: Solution, tolerance: float) -> Solution:
    """Solve on other meshes until states, inputs, limits and switches meet a tolerance.

    An interval with error e is split into ``ceil((2 e / tolerance)^(1 / (r + 1)))``
    pieces, r the order of the scheme; neighbours whose common interval is
    foreseen to stay far below the tolerance are merged. Then the mesh points around switches move, see
    :mod:`switches`, and intervals in which the motion passes limits, or inputs have larger errors than the tolerance,
    are split, see :mod:`input_error`. Each pass starts from the last solution.

    Raises
    ------
    OptimizationError
        If a pass fails, with the last solution in ``.reached``, or if no mesh was found that meets the tolerance,
        with the last solution in ``.partial``.

    Warns
    -----
    MechanismWarning
        If local errors meet the tolerance, but inputs, limits or switches do not.
    """
    return _Refinement(solver, solution, tolerance).run()


class _Refinement:
    """Passes of a refinement: the last solution and its errors."""

    def __init__(self, solver: ProblemSolver, solution: Solution, tolerance: float):
        self.solver, self.solution, self.tolerance = solver, solution, tolerance
        self.passes: list[Attempt] = []
        #: largest local error of each of them
        self.history: list[float] = []
        self.merging, self.moves = True, MOVES
        #: True if the last pass had more mesh points for switches, or more that move
        self.resolves = False
        #: largest errors of the inputs times their stretches, before the last pass that split intervals for these
        self.unresolved = np.inf
        #: the last solution with small local errors, and what it does not meet
        self.reached: tuple[Solution, str] | None = None
        solver.limit_tolerance = tolerance

    def run(self) -> Solution:
        """Return the solution that meets the tolerance."""
        reason = f"{PASSES} passes are made"
        for _ in range(PASSES):
            self._measure()
            if self.error <= self.tolerance and not self._missed():
                return self.solution
            meshes = self._meshes()
            if meshes is None:
                reason = "the errors do not fall any further"
                break
            if _count(meshes) > INTERVALS:
                reason = f"the next mesh would have {_count(meshes)} intervals"
                break
            if not self._solve(meshes):
                reason = "the solver fails on the next mesh"
                break
        return self._given_up(reason)

    def _measure(self) -> None:
        """Errors of the intervals of the last solution, and its entry in the table of passes."""
        solution = self.solution
        self.errors = _errors(solution)
        self.error = float(np.max(np.concatenate(self.errors)))
        self.history.append(self.error)
        self.passes.append(solution.as_attempt("refinement", error=self.error))
        solution.statistics = replace(solution.statistics, passes=list(self.passes))

    def _missed(self) -> str:
        """Demands that a solution with small local errors does not meet, in words; nothing if it meets all."""
        solution, tolerance = self.solution, self.tolerance
        self.switches = unresolved_switches(solution, tolerance)
        self.shares = [shares_by_interval(part) for part in solution.phases]
        missed = [f"the limits that change at t = {switch.time:.6g} s" for of in self.switches for switch in of][:1]
        if self.resolves and self._is_settled():
            missed = []  # what was done about them did not change the cost
        passed = passed_limits(solution, self.solver.limit_tolerance)[:1]
        missed += [f"the limit {x.label}, which is passed by {x.amount:.3g} at t = {x.time:.6g} s" for x in passed]
        self.input_errors = [unresolved_inputs(part, tolerance) for part in solution.phases]
        worst = max(zip(solution.phases, self.input_errors, strict=True), key=lambda of: np.max(of[1], initial=0.0))
        if np.any(worst[1]):
            k = int(np.argmax(worst[1]))
            missed.append(
                f"the inputs, which are off by about {worst[1][k]:.2g} of their sizes at t = "
                f"{worst[0].mesh_times[k]:.6g} s"
            )
        self.reached = solution, " and ".join(missed)
        return self.reached[1]

    def _meshes(self) -> list[Mesh] | None:
        """Meshes of the next pass; None if there is none that is better."""
        meshes, order = self.solution.meshes, self.solution.phases[0].program.scheme.order
        if self.error > self.tolerance:
            before = self.history[:-1][-2:]
            if len(before) == 2 and self.error > max(before) / 2 and not self.merging:
                return None
            self.merging = self.merging and self.error <= min(before, default=np.inf) / 2
            adapt = partial(adapted, tolerance=self.tolerance, order=order, merging=self.merging)
            return [adapt(mesh, errors) for mesh, errors in zip(meshes, self.errors, strict=True)]
        if self.moves and any(self.switches):
            pairs = zip(meshes, self.switches, strict=True)
            moving = [mesh.with_moving(k for switch in own for k in switch.points) for mesh, own in pairs]
            grows = any(new.moving != mesh.moving for new, mesh in zip(moving, meshes, strict=True))
            if grows or not self._is_settled():
                self.moves -= 1
                return moving
        return self._split() if self._inputs_improve() else None

    def _split(self) -> list[Mesh]:
        """Meshes with intervals split at switches, and where limits are passed or inputs are off."""
        split, order = [], self.solution.phases[0].program.scheme.order
        for part, own, shares, errors in zip(
            self.solution.phases, self.switches, self.shares, self.input_errors, strict=True
        ):
            pieces = np.maximum(
                _pieces(shares, self.solver.limit_tolerance, order), _pieces(errors, self.tolerance, input_order(part))
            )
            pieces[[k for switch in own for k in switch.intervals]] = PIECES
            split.append(part.mesh.refined(pieces, np.zeros(part.mesh.count, bool)))
        return split

    def _inputs_improve(self) -> bool:
        """Return True if errors of inputs, if there are any, fell since the last pass for them, or spread less far."""
        areas = [
            float(np.max(errors[run]) * np.sum(np.diff(part.mesh_times)[run]))
            for part, errors in zip(self.solution.phases, self.input_errors, strict=True)
            for run in stretches(errors > 0)
        ]
        before, self.unresolved = self.unresolved, max(areas, default=np.inf)
        return not areas or self.unresolved <= 0.8 * before

    def _is_settled(self) -> bool:
        """Return True if the cost did not change in the last pass, beyond the tolerance and that of the solver."""
        if len(self.passes) < 2:
            return False
        now, before = self.passes[-1].cost, self.passes[-2].cost
        return abs(now - before) <= self.tolerance * abs(now) + SOLVER_TOLERANCE * self.solution.program.cost_scale

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
            self.solution = solver.solve(meshes, guess, warm=True)
            return True
        except OptimizationError:
            if near and self.moves:  # mesh points that do not move well move no more
                self.moves = 0
                return self._solve(self._meshes() or meshes)
        try:  # a guess that is near on one mesh may be far on another
            self.solution = solver.solve(meshes, guess)
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
        raise OptimizationError(
            f"the mesh was refined to {_count(self.solution.meshes)} intervals and the local error is still "
            f"{self.error:.2g}, above the tolerance {self.tolerance:g}: {reason}; the last solution is in .partial",
            partial=self.solution,
        )


def refine_or_repeat(solver: ProblemSolver, solution: Solution, guess: Guess) -> tuple[Solution, bool]:
    """Refine a coarse mesh, or solve again from the guess on a finer one if the solution is no motion at all.

    A solution that owes its cost to the errors of a coarse mesh is a poor guess for a finer one.

    Returns
    -------
    Solution, bool
        The last solution, and whether its mesh is fine enough.
    """
    for _ in range(FRESH_PASSES):
        if not is_lost(solution):
            break
        finer = solver.solve_further(solution, [mesh.split(2) for mesh in solution.meshes], guess)
        if finer is None:
            break
        solution = finer
    return refine_if_coarse(solver, solution)


def is_lost(solution: Solution) -> bool:
    """Return True if the mesh is so coarse that a solution is no motion at all."""
    return max(float(np.max(coarseness(part), initial=0.0)) for part in solution.phases) > LOST_ERROR


def refine_if_coarse(solver: ProblemSolver, solution: Solution) -> tuple[Solution, bool]:
    """Solve again with intervals split that are too coarse for the motion, or in which it passes a limit.

    A few times at most. If the largest error does not fall, since a fast motion moved on to the next coarse interval,
    all intervals are halved; unless free parameters lead to a singular pose there, which no mesh resolves.

    Returns
    -------
    Solution, bool
        The last solution, and whether its mesh is fine enough.
    """
    error, stalled = _largest_coarseness(solution), False
    for _ in range(COARSE_PASSES):
        if stalled and _tends_to_lock(solution):
            break
        if stalled and _count(solution.meshes) <= HALVED_INTERVALS:
            meshes = [mesh.split(2) for mesh in solution.meshes]
        else:
            meshes = [_split_where_coarse(solution, part) for part in solution.phases]
        if _count(meshes) == _count(solution.meshes):
            break
        finer = solver.solve_further(solution, meshes)
        if finer is None:
            break
        solution, before, error = finer, error, _largest_coarseness(finer)
        stalled = not error < max(COARSE_ERROR, before / 2)  # infinite if an interval cannot be integrated
    return solution, error <= COARSE_ERROR


def _tends_to_lock(solution: Solution) -> bool:
    """True if dimensions are free and the linkage is close to a singular pose where the mesh is coarsest."""
    parts = [part for part in solution.phases if part.mesh.count] if solution.problem.free_parameters else []
    return any(close_to_singular(part, int(np.argmax(coarseness(part)))) for part in parts)


def _split_where_coarse(solution: Solution, part: PhaseSolution) -> Mesh:
    """Mesh of a phase with intervals split that are too coarse, or in which a limit is passed."""
    if not part.mesh.count:
        return part.mesh
    # foreseen to be well below, and one power less than the order: the steps of projection are no smooth error
    errors = np.maximum(coarseness(part), state_coarseness(part))
    pieces = np.ceil((4 * errors / COARSE_ERROR) ** (1 / part.program.scheme.order))
    pieces[errors <= COARSE_ERROR] = 1
    passed = [limit.time for limit in passed_limits(solution) if limit.phase == part.program.number]
    places = np.clip(np.searchsorted(part.mesh_times, passed) - 1, 0, part.mesh.count - 1)
    pieces[places] = np.maximum(pieces[places], 2)
    pieces = np.clip(np.nan_to_num(pieces, nan=PIECES), 1, PIECES).astype(int)
    return part.mesh.refined(pieces, np.zeros(part.mesh.count, bool))


def _largest_coarseness(solution: Solution) -> float:
    """Largest error of an interval of all phases, in rad or sizes of the mechanism, velocities times the duration."""
    errors = [np.r_[coarseness(part), state_coarseness(part)] for part in solution.phases]
    return float(np.max(np.concatenate(errors), initial=0.0))


def _pieces(errors: np.ndarray, tolerance: float, order: int) -> np.ndarray:
    """Number of pieces into which intervals are split whose errors go with a power of their lengths (N,)."""
    pieces = np.clip(np.ceil((2 * errors / tolerance) ** (1 / order)), 1, PIECES).astype(int)
    pieces[errors <= tolerance] = 1
    return pieces


def _count(meshes: Sequence[Mesh]) -> int:
    """Number of intervals of all phases."""
    return sum(mesh.count for mesh in meshes)


def _errors(solution: Solution) -> list[np.ndarray]:
    """Local errors of the intervals by phase; Ctrl-C in compiled code comes as what it is."""
    with interruptible() as interruption:
        try:
            return [part.scaled_errors for part in solution.phases]
        except RuntimeError:
            if not interruption.requested:
                raise
    raise KeyboardInterrupt


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
    pieces = _pieces(errors, tolerance, order + 1)
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
