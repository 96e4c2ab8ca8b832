"""Solution of a problem with exact friction: with friction as a force first, then in phases of sticking and sliding."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...arguments.values import pairs_of
from ...errors import ModelError, OptimizationError
from ..measures.switches import UnresolvedSwitches
from ..problem import OptimalControlProblem
from ..program.setup import PhaseSetup, Settings
from ..search.first_mesh import INTERVALS, first_meshes, is_automatic
from ..search.refine import refine, refine_if_coarse
from ..search.search import Search, Several
from ..solution import Solution, same_cost
from ..solve.best_so_far import BestSoFar
from ..solve.problem_solver import ProblemSolver
from ..statement.dry_friction import Relaxation
from ..transcription.mesh import Mesh
from .pattern import Piece, joined, pattern_of
from .phases import PhasedFriction, PhaseMaker
from .switched_solution import SwitchedSolution

#: Intervals of a motion with friction as a force, whose ends are the switches.
PIECES = 20
#: Longest of these intervals, in lengths of equal ones: long ones save cost by their errors alone.
LONGEST = 1.5
#: Shares of typical products of speed and missing friction that sticking may have, one after the other, and the number
#: of the first one with which the modes are read off.
SHARES, READ_OFF = (1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7), 4
#: Share of the cost that limits which become active within an interval may change, and passes in which mesh points move
#: there.
SWITCH_TOLERANCE, MOVES = 1e-6, 3
#: Phases up to this share of the duration are left out if the motion costs no more without them.
BRIEF = 1e-2
#: Options of IPOPT for these: their solutions tell the modes alone.
ROUGH = {"ipopt.tol": 1e-5, "ipopt.constr_viol_tol": 1e-6, "ipopt.max_iter": 300}


@dataclass
class FrictionSearch:
    """The search for a motion with exact friction; arguments are those of :class:`Search`."""

    problem: OptimalControlProblem
    intervals: Any
    settings: Settings
    best: BestSoFar
    executor: Any
    strategies: Sequence[Any]

    def solve(self, parameters: Any, guess: Any, starts: Several, tolerance: float | None) -> SwitchedSolution:
        """Solve with friction as a force, read off the modes, and solve in phases.

        Raises
        ------
        OptimizationError
            If the motion with friction as a force is not found, or that in phases of the modes read off from it.
        """
        self._refuse_intervals()
        failure: OptimizationError | None = None
        tried: list[tuple[Any, ...]] = []
        assert self.problem.relaxed is not None
        _, relaxation = self.problem.relaxed
        for motion in self._with_forces(parameters, guess, starts):
            pieces = pattern_of(motion, relaxation)
            key = tuple((piece.senses, piece.waypoint) for piece in pieces)
            if key in tried:
                continue
            tried.append(key)
            try:
                return self._in_phases(motion, relaxation, pieces, parameters, tolerance)
            except OptimizationError as error:
                failure = error
        assert failure is not None
        raise failure

    def _refuse_intervals(self) -> None:
        given = self.intervals
        if not is_automatic(given) and (isinstance(given, bool) or not isinstance(given, int | np.integer)):
            raise ModelError(
                f"optimize: with DryFriction intervals is the number of those of the whole motion, got {given!r}"
            )

    # --- friction as a force ------------------------------------------------------------------------
    def _with_forces(self, parameters: Any, guess: Any, starts: Several) -> Iterator[Solution]:
        """Motions with friction as a force, which sticks ever better."""
        assert self.problem.relaxed is not None
        problem, relaxation = self.problem.relaxed
        settings, best = replace(self.settings, options=ROUGH | self.settings.options), BestSoFar()
        given = dict(pairs_of(parameters, "parameters="))
        count = max(PIECES, problem.phases[0].fewest_intervals)
        search = Search(problem, count, None, settings, best, self.executor, self.strategies)
        motion = search.solve({**given, relaxation.share: SHARES[0]}, guess, starts, None)
        meshes = [
            replace(mesh, longest=LONGEST / mesh.count).with_moving(range(1, mesh.count)) for mesh in motion.meshes
        ]
        for number, share in enumerate(SHARES[1:], start=1):
            solver = ProblemSolver(problem, settings, {**given, relaxation.share: share}, None, best)
            try:
                motion = solver.solve(meshes, solver.motion_of(motion), warm=True, limit_tolerance=np.inf)
            except OptimizationError as error:
                if not isinstance(error.partial, Solution):
                    raise
                motion = error.partial
            meshes = list(motion.meshes)
            if number >= READ_OFF:
                yield motion

    # --- in phases ------------------------------------------------------------------------------------
    def _in_phases(
        self, motion: Solution, relaxation: Relaxation, pieces: list[Piece], parameters: Any, tolerance: float | None
    ) -> SwitchedSolution:
        """The solution in phases of a pattern, on a mesh that is refined."""
        maker = PhaseMaker(self.problem, relaxation, motion)
        found, solver, phased = self._cheapest(maker, pieces, parameters)
        if is_automatic(self.intervals):
            found, _ = refine_if_coarse(solver, found)
            found = found if tolerance is not None else _with_switches(solver, found)
        if tolerance is not None:
            found = refine(solver, found, tolerance)
        return SwitchedSolution(found, self.problem, phased.pieces, phased.replaced)

    def _cheapest(
        self, maker: PhaseMaker, pieces: list[Piece], parameters: Any
    ) -> tuple[Solution, ProblemSolver, PhasedFriction]:
        """The solution in phases of a pattern, or without the brief ones if it costs no more."""
        phased = maker.phased(pieces)
        solver = ProblemSolver(phased.problem, self.settings, parameters, None, self.best)
        self.best.new_stage()
        found = solver.solve(self._meshes(solver.setups, phased), phased.guess)
        lasting = [
            replace(piece, end=piece.begin + (piece.duration if duration > BRIEF * found.duration else 0.0))
            for piece, duration in zip(pieces, found.durations, strict=True)
        ]
        fewer = joined(lasting, 0.0) if len(pieces) > 1 else pieces
        if len(fewer) < len(pieces):
            try:
                other = self._cheapest(maker, fewer, parameters)
            except OptimizationError:
                return found, solver, phased
            if other[0].cost <= found.cost or same_cost(other[0].cost, found.cost):
                return other
        return found, solver, phased

    def _meshes(self, setups: Sequence[PhaseSetup], phased: PhasedFriction) -> list[Mesh]:
        """Meshes of the phases, with so many intervals together as are asked for, and two in each at least."""
        total = INTERVALS if is_automatic(self.intervals) else self.intervals
        whole = sum(piece.duration for piece in phased.pieces)
        counts = [max(2, round(total * piece.duration / whole)) for piece in phased.pieces]
        return first_meshes(setups, counts)


def _with_switches(solver: ProblemSolver, solution: Solution) -> Solution:
    """The solution with mesh points at the times at which limits of inputs begin or cease to be active."""
    for _ in range(MOVES):
        measure = UnresolvedSwitches(solution, SWITCH_TOLERANCE)
        meshes = [measure.placed(part, part.mesh) for part in solution.phases]
        if not measure.moves or all(map(Mesh.is_same, meshes, solution.meshes)):
            break
        further = solver.solve_further(solution, meshes)
        if further is None:
            break
        solution = further
    return solution
