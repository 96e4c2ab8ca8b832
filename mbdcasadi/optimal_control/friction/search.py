"""Solution of a problem with exact friction and contact: with these as forces first, then in phases."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, NoReturn

import numpy as np

from ...arguments.values import pairs_of
from ...errors import ConditionError, MechanismError, ModelError, OptimizationError
from ...model.conditions import Condition
from ...numerics.tolerances import MET
from ...results.state import State
from ..measures.cost_error import FalseCost
from ..measures.limit_error import PassedLimits
from ..measures.measure import split
from ..measures.switches import UnresolvedSwitches
from ..problem import OptimalControlProblem
from ..program.problem_setup import ProblemSetup
from ..program.setup import PhaseSetup, Settings
from ..search.budgets import BUDGETS
from ..search.first_mesh import INTERVALS, first_meshes, is_automatic
from ..search.given_guess import read_guess
from ..search.refine import refine, refine_if_coarse
from ..search.search import Search, Several
from ..solution import Solution, same_cost
from ..solve.best_so_far import BestSoFar
from ..solve.problem_solver import ProblemSolver
from ..statement.condition_rank import ranks_of
from ..statement.phase import on_states
from ..statement.sites import Relaxation, gap_of
from ..transcription.mesh import Mesh
from .pattern import Piece, joined, order_of, pattern_of, with_rests, without_flights
from .phases import PhasedFriction, PhaseMaker
from .switched_solution import SwitchedSolution

#: Intervals of a motion with friction as a force, whose ends are the switches.
PIECES = 20
#: Longest of these intervals, in lengths of equal ones: long ones save cost by their errors alone.
LONGEST = 1.5
#: Shares of typical products of speed and missing friction that sticking may have, one after the other, and the first
#: one with which modes that are read off are solved.
SHARES, READ_OFF = (1.0, 1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7), 1e-4
#: The same with contacts: open and closed are told apart early, and the motion stiffens soon.
TOUCH_SHARES, TOUCH_READ_OFF = (1.0, 1e-1, 1e-2, 1e-3, 1e-4), 1e-1
#: Share of the cost that limits which become active within an interval may change, and passes in which mesh points move
#: there, or intervals are split in which laws are passed: another motion follows in a simulation.
SWITCH_TOLERANCE, MOVES = 1e-6, 6
#: Phases up to this share of the duration are left out unless the motion costs as large a share more without them than
#: with friction as a force.
BRIEF = 1e-2
#: Options of IPOPT for these: their solutions tell the modes alone; and of all but the first, of which the last iterate
#: does, too.
ROUGH = {"ipopt.tol": 1e-5, "ipopt.constr_viol_tol": 1e-6}
CONTINUED = {"ipopt.max_iter": 300}


@dataclass(frozen=True)
class InPhases:
    """A solution in the phases of an order of modes."""

    solution: Solution
    solver: ProblemSolver
    phased: PhasedFriction


@dataclass
class FrictionSearch:
    """The search for a motion with exact friction and contact; arguments are those of :class:`Search`."""

    problem: OptimalControlProblem
    intervals: Any
    settings: Settings
    best: BestSoFar
    executor: Any
    strategies: Sequence[Any]

    def solve(self, parameters: Any, guess: Any, starts: Several, tolerance: float | None) -> SwitchedSolution:
        """Solve with friction as a force, read off the modes, and solve in phases of each order that is found.

        Raises
        ------
        OptimizationError
            If the motion with friction as a force is not found, or that in phases of the modes read off from it.
        """
        self._refuse_intervals()
        relaxation = self._relaxation
        orders, last = _Orders(self, parameters), tuple[Any, ...]()
        try:
            for motion, share in self._motions(parameters, guess, starts):
                if share and orders.found and orders.least_cost <= motion.cost:
                    break
                pieces = pattern_of(motion, relaxation, forces=share > 0)
                lasting = joined(pieces, BRIEF * motion.duration)
                if share <= (TOUCH_READ_OFF if relaxation.touches else READ_OFF):
                    maker = PhaseMaker(self.problem, relaxation, motion)
                    self._solve_orders(orders, maker, pieces, lasting)
                    if share and last == order_of(lasting) and orders.found:
                        break
                last = order_of(lasting)
        except OptimizationError:  # after a guess whose order was solved
            if not orders.found:
                raise
        return self._refined(orders.found or orders.refuse(), tolerance)

    def _solve_orders(self, orders: _Orders, maker: PhaseMaker, pieces: list[Piece], lasting: list[Piece]) -> None:
        """Solve orders that are read off a motion, the simplest first, until one costs little more; and with rests."""
        motion, relaxation = maker.motion, self._relaxation
        for some in (without_flights(lasting, relaxation), lasting, pieces):
            orders.solve(maker, some)
            if orders.found and orders.least_cost <= motion.cost + BRIEF * abs(motion.cost):
                break
        orders.solve(maker, with_rests(lasting, motion, relaxation))

    @property
    def _relaxation(self) -> Relaxation:
        assert self.problem.relaxed is not None
        return self.problem.relaxed[1]

    def _refuse_intervals(self) -> None:
        given = self.intervals
        if not is_automatic(given) and (isinstance(given, bool) or not isinstance(given, int | np.integer)):
            raise ModelError(
                "optimize: with DryFriction or RigidContact intervals is the number of those of the whole motion, got "
                f"{given!r}"
            )

    # --- friction as a force ------------------------------------------------------------------------
    def _motions(self, parameters: Any, guess: Any, starts: Several) -> Iterator[tuple[Solution, float]]:
        """Motions given as guesses, with a share of 0, then those with friction as a force that sticks ever better."""
        assert self.problem.relaxed is not None
        problem, relaxation = self.problem.relaxed
        settings, best = replace(self.settings, options=ROUGH | self.settings.options), BestSoFar()
        given = dict(pairs_of(parameters, "parameters="))
        count = max(PIECES, problem.phases[0].fewest_intervals)
        if relaxation.touches:
            self._refuse_strike_at_start(ProblemSetup(problem, settings, given))
        first, *shares = TOUCH_SHARES if relaxation.touches else SHARES
        for one in starts if isinstance(starts, list) else [] if guess is None else [guess]:
            solver = ProblemSolver(problem, settings, {**given, relaxation.share: first})
            yield solver.unsolved(first_meshes(solver.setups, INTERVALS), read_guess(solver, one)), 0.0
        search = Search(problem, count, None, settings, best, self.executor, self.strategies)
        motion = search.solve({**given, relaxation.share: first}, guess, starts, None)
        meshes = [
            replace(mesh, longest=LONGEST / mesh.count).with_moving(range(1, mesh.count)) for mesh in motion.meshes
        ]
        continued = replace(settings, options=CONTINUED | settings.options)
        for share in shares:
            solver = ProblemSolver(problem, continued, {**given, relaxation.share: share}, None, best)
            try:
                motion = solver.solve(meshes, solver.motion_of(motion), warm=True, limit_tolerance=np.inf)
            except OptimizationError as error:
                if not isinstance(error.partial, Solution):
                    raise
                motion = error.partial
            meshes = list(motion.meshes)
            yield motion, share

    def _refuse_strike_at_start(self, setup: ProblemSetup) -> None:
        """Refuse a start at which a contact is closed and closes with a speed, if conditions decide both.

        Raises
        ------
        ConditionError
            Naming the place, its speed, and what to give.
        """
        part, initial = setup.setups[0], setup.initial
        ranks = ranks_of(setup.problem, part.phase, part.numeric, timed=False)
        for site in (site for site in self._relaxation.sites if site.place is not None):
            rows = gap_of(site), site.element.normal_speeds[site.place]
            (gap, speed), (length, typical) = (float(setup.start[row]) for row in rows), part.sizes.of_changes(rows)
            if abs(gap) > MET * length or speed > -MET * typical:
                continue
            conditions = [Condition(row, True, site.name) for row in rows]
            if isinstance(initial, State) or all(ranks.fixed(conditions, on_states(initial))):
                raise ConditionError(
                    f"initial: {site.name} is closed and closes at {-speed:.3g} m/s, which is an impact; give the "
                    "state after it, as simulate(…).events[0].after, or a start before it, with a gap"
                )

    # --- in phases ------------------------------------------------------------------------------------
    def in_phases(self, maker: PhaseMaker, pieces: list[Piece], parameters: Any) -> InPhases:
        """Return the solution in phases of an order; raises as :meth:`solve` does."""
        phased = maker.phased(pieces)
        solver = ProblemSolver(phased.problem, self.settings, parameters, None, self.best)
        solution = solver.solve(self._meshes(solver.setups, phased), phased.guess, limit=BUDGETS.order)
        phased.refuse_missed(solution)
        return InPhases(solution, solver, phased)

    def _refined(self, found: Sequence[InPhases], tolerance: float | None) -> SwitchedSolution:
        """The cheapest solution on a mesh that is refined; its starts are the orders that were solved.

        Of those that cost the same it is the one with the fewest phases.
        """
        least = min(one.solution.cost for one in found)
        alike = [one for one in found if one.solution.cost <= least or same_cost(one.solution.cost, least)]
        cheapest = min(alike, key=lambda one: len(one.phased.pieces))
        solution, solver, phased = cheapest.solution, cheapest.solver, cheapest.phased
        costs = [one.solution.cost for one in found]
        starts = [
            one.solution.as_attempt(one.phased.order, found=sum(same_cost(one.solution.cost, cost) for cost in costs))
            for one in found
        ]
        if is_automatic(self.intervals):
            solution, _ = refine_if_coarse(solver, solution)
            solution = with_switches(solver, solution)
        if tolerance is not None:
            solution = refine(solver, solution, tolerance)
        solution.statistics = replace(solution.statistics, starts=starts if len(starts) > 1 else [])
        return SwitchedSolution(solution, self.problem, phased, self._relaxation.sites)

    def _meshes(self, setups: Sequence[PhaseSetup], phased: PhasedFriction) -> list[Mesh]:
        """Meshes of the phases, with so many intervals together as are asked for, and two in each at least."""
        total = INTERVALS if is_automatic(self.intervals) else self.intervals
        whole = sum(piece.duration for piece in phased.pieces)
        counts = [max(2, round(total * piece.duration / whole)) for piece in phased.pieces]
        return first_meshes(setups, counts)


class _Orders:
    """Orders of modes that are solved, each once."""

    def __init__(self, search: FrictionSearch, parameters: Any):
        self._search, self._parameters = search, parameters
        self._found: dict[tuple[Any, ...], InPhases | MechanismError] = {}

    def solve(self, maker: PhaseMaker, pieces: list[Piece]) -> Solution | None:
        """Return the solution of an order; also solved is what is left of it without its brief phases.

        None if it has none.
        """
        pieces = maker.possible(pieces)
        order = order_of(pieces)
        if order not in self._found:
            try:
                if len(pieces) > PIECES // 2:
                    raise OptimizationError(
                        f"friction and contact switch more than {PIECES // 2} times in the motion that was found with "
                        "their laws as forces; take a shorter duration, or guess= with a motion that switches less",
                        partial=maker.motion,
                    )
                self._found[order] = self._search.in_phases(maker, pieces, self._parameters)
            except (OptimizationError, ConditionError) as error:
                self._found[order] = error
        found = self._found[order]
        if isinstance(found, MechanismError):
            return None
        fewer = joined(pieces, BRIEF * found.solution.duration, found.solution.durations)
        if fewer and len(fewer) < len(pieces):
            self.solve(maker, fewer)
        return found.solution

    @property
    def found(self) -> list[InPhases]:
        """Solutions that were found."""
        return [one for one in self._found.values() if isinstance(one, InPhases)]

    @property
    def least_cost(self) -> float:
        """Least cost of a solution that was found."""
        return min(one.solution.cost for one in self.found)

    def refuse(self) -> NoReturn:
        """Raise the last failure."""
        raise [one for one in self._found.values() if isinstance(one, MechanismError)][-1]


def with_switches(solver: ProblemSolver, solution: Solution) -> Solution:
    """Return the solution with mesh points at switches, and with shorter intervals where it passes laws or limits.

    Mesh points move to the times at which limits of inputs begin or cease to be active; else intervals are split. A
    motion whose cost is wrong by errors of its mesh ends this.
    """
    for _ in range(MOVES):
        switches, passed = UnresolvedSwitches(solution, SWITCH_TOLERANCE), PassedLimits(solution, MET)
        meshes = [switches.placed(part, part.mesh) for part in solution.phases]
        if not switches.moves or all(map(Mesh.is_same, meshes, solution.meshes)):
            meshes = [split(part, [passed]) for part in solution.phases]
        if all(map(Mesh.is_same, meshes, solution.meshes)):
            break
        further = solver.solve_further(solution, meshes)
        if further is None or FalseCost(further).largest > 0:
            break
        solution = further
    return solution
