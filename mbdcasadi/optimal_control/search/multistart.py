"""Guesses to start from: the usual one, those of the user, and others at random; the best solution is kept."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from copy import copy
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ...assembly.pose import PoseProblem
from ...errors import MechanismError, ModelError, OptimizationError
from ...model.symbols import Input
from ...numerics.console import without_warnings
from ...numerics.least_squares import largest
from ...numerics.newton import solve
from ...numerics.symbolic import numeric_work, symbolic
from ...results.state import State
from ...results.trajectory import Trajectory
from ...simulation.simulate import simulate
from ..motion.guess import Guess, guess_at_rest, guess_from_motion, kinematic_guess
from ..poses.kinematic_guess import STEPS, KinematicPath, has_free_path
from ..program.limit_sides import LimitSides
from ..program.setup import PhaseSetup
from ..program.statistics import Attempt
from ..solution import SAME_COST, Solution, same_cost
from ..solve.problem_solver import ProblemSolver
from ..solve.solvers.base import Elsewhere
from ..statement.phase import on_positions, with_parameters
from ..transcription.mesh import Mesh
from .coarse_first import solve_coarse_first
from .coarse_mesh import is_lost
from .detours import random_detour, swings, swings_suffice
from .given_guess import read_guess
from .whole_guess import guess_of, start_of, through_poses

#: Reports of the solves from a guess, and the solution or the error in which they ended.
Outcome = tuple[list[Attempt], Solution | OptimizationError]
#: Motions that are simulated under random inputs, half waves of these, and their largest values as shares of the peak.
RANDOM_MOTIONS, RANDOM_WAVES, RANDOM_SHARES = 20, 3, (0.3, 1.0)
#: Random poses from which other ends are assembled, difference from which a pose is another one, rad or sizes of the
#: mechanism, and number of those that are tried.
END_STARTS, ANOTHER, OTHER_ENDS = 16, 0.2, 2
#: Load, as a share of its typical size, above which a mechanism without inputs does not stay at rest.
MOVED = 1e-9
#: Largest number of iterations from a detour, as a multiple of those from the usual guesses: those that take more
#: seldom end at lower costs. And number of solutions of the same lowest cost after which no further one is sought.
DETOURED, AGREEING = 2.0, 3
#: Multiple of the lowest cost so far above which a solve from a detour is given up: of some 500 of 93 chains that were
#: above it after 20 iterations one ended at a cost that was lower by more than half a per cent.
HOPELESS = 4.0


def guesses(solver: ProblemSolver, starts: Any, guess: Any) -> list[Guess]:
    """Return the guesses of a search: the usual ones and others at random, or those that are given."""
    if starts is None:
        return _usual_guesses(solver) if guess is None else [read_guess(solver, guess)]
    if isinstance(starts, int) and not isinstance(starts, bool):
        if starts < 1:
            raise ModelError(f"optimize: starts must be at least 1, got {starts}")
        random = np.random.default_rng(0)
        first = (_usual_guesses(solver) if guess is None else [read_guess(solver, guess)])[:starts]
        return [*first, *[random_detour(solver, random) for _ in range(starts - len(first))]]
    try:
        several = list(starts)
    except TypeError:
        raise ModelError(f"optimize: starts= takes a number or a list of guesses, got {starts!r}") from None
    if not several:
        raise ModelError("optimize: starts= is an empty list")
    return [_usual_guess(solver) if one is None else read_guess(solver, one) for one in several]


def _usual_guesses(solver: ProblemSolver) -> list[Guess]:
    """The usual guess; for a chain in angles, which is solved twice in less time than in all coordinates, two.

    Of 28 made-up chains of two to four links with a motor in every joint, on meshes that hold, the first of the two led
    to the lower cost in 8, the second one in 5.
    """
    usual = _usual_guess(solver)
    is_chain = solver.setups[0].scheme.eom.is_chain
    return [usual, at_rest(solver)] if is_chain and not _stays_at_rest(solver) else [usual]


def _stays_at_rest(solver: ProblemSolver) -> bool:
    """True if a chain with a motor in every joint stays where it is without them, as an arm without gravity does.

    Poses at rest then meet the equations of motion without any input, and the solver leaves them in tiny steps: of 21
    made-up arms of two to five links 11 were not solved from there in 300 iterations, and one at a lower cost.
    """
    setup = solver.setups[0]
    eom, (start, path) = setup.scheme.eom, start_of(solver, setup)
    if eom.u.numel() < eom.q.numel():
        return False
    still = np.zeros_like(path.poses)
    missing = setup.loads.missing(path.times, path.poses, still, still, np.tile(start.z, (path.times.size, 1)))
    return largest(missing) <= MOVED


def at_rest(solver: ProblemSolver) -> Guess:
    """Return the poses of the kinematic motion without speeds."""
    parts = [through_poses(solver, setup, guess_at_rest) for setup in solver.setups]
    return guess_of(solver, parts, "kinematic, at rest")


def _usual_guess(solver: ProblemSolver) -> Guess:
    """The motion through the conditions, or the free motion if there are none and it begins with a speed."""
    setup, phases = solver.setups[0], solver.problem.phases
    if len(phases) == 1 and has_free_path(solver.problem, phases[0]) and np.any(solver.start.v):
        motion = _free_motion(solver)
        if motion is not None:
            return guess_of(solver, [guess_from_motion(motion, setup.path.segment_times)], "free motion")
    return guess_of(solver, [through_poses(solver, setup) for setup in solver.setups], "kinematic")


def _free_motion(solver: ProblemSolver) -> Trajectory | None:
    """The motion from the start with the inputs' own values; None if it cannot be simulated."""
    return _simulated(solver, {})


def _simulated(solver: ProblemSolver, inputs: dict[Input, np.ndarray]) -> Trajectory | None:
    """The motion of the first phase from the start with samples of inputs; None if it cannot be simulated."""
    setup = solver.setups[0]
    mechanism = setup.phase.mechanism
    p = dict(zip(mechanism.parameters, setup.numeric.p, strict=True))
    try:
        with without_warnings():
            return simulate(mechanism, _sample_times(setup), initial=solver.start, parameters=p, inputs=inputs)
    except MechanismError:  # a guess through poses does as well
        return None


def _sample_times(setup: PhaseSetup) -> np.ndarray:
    """Times at which inputs of a simulated guess are sampled, s."""
    return np.linspace(0, setup.path.segment_times[-1], STEPS + 1)


def random_motions(
    solver: ProblemSolver, meshes: Sequence[Mesh], peaks: np.ndarray, random: np.random.Generator
) -> list[Guess]:
    """Simulated motions under random inputs within their peaks (n_u,), those first that violate the demands least.

    They are motions that the mechanism can make, of kinds that a path through poses does not have: it swings back
    before it goes on, or passes a singular pose. None for several phases, and without inputs.
    """
    setup = solver.setups[0]
    if len(solver.problem.phases) > 1 or not peaks.size:
        return []
    found = []
    for _ in range(RANDOM_MOTIONS):
        motion = _simulated(solver, _random_inputs(setup, peaks, random))
        if motion is not None:
            guess = guess_of(
                solver, [guess_from_motion(motion, setup.path.segment_times)], "simulated with random inputs"
            )
            found.append((solver.violation(meshes, guess), guess))
    return [guess for violation, guess in sorted(found, key=lambda pair: pair[0]) if np.isfinite(violation)]


def _random_inputs(setup: PhaseSetup, peaks: np.ndarray, random: np.random.Generator) -> dict[Input, np.ndarray]:
    """Samples of each input: a few half waves, of random amplitudes and phases."""
    times, signals = _sample_times(setup), {}
    for symbol, peak in zip(setup.phase.mechanism.inputs, peaks.tolist(), strict=True):
        amplitudes, shifts = random.uniform(-1, 1, RANDOM_WAVES), random.uniform(0, 2 * np.pi, RANDOM_WAVES)
        angles = np.outer(times / times[-1], np.pi * np.arange(1, RANDOM_WAVES + 1)) + shifts
        waves = np.sin(angles) @ amplitudes
        share = random.uniform(*RANDOM_SHARES)
        signals[symbol] = np.clip(share * peak * waves / np.max(np.abs(waves)), symbol.lower, symbol.upper)
    return signals


def other_ends(solver: ProblemSolver) -> list[Guess]:
    """Motions that end in another pose than the usual one: with the other elbow, or on another branch of a loop.

    The coordinates lead there evenly, past a singular pose if one is on the way. None for several phases, with
    waypoints, or if the end is given as a state.
    """
    setup, phase = solver.setups[0], solver.problem.phases[0]
    if len(solver.problem.phases) > 1 or phase.waypoints or isinstance(phase.final, State):
        return []
    conditions = [c for c in (*phase.final, *phase.path) if c.equality and on_positions(c.expression)]
    extra = dict(zip(solver.problem.free_parameters, solver.free_values.tolist(), strict=True))
    conditions = with_parameters(conditions, solver.problem.extra_parameters(phase), extra)
    (start, path), numeric, random = start_of(solver, setup), setup.numeric, np.random.default_rng(0)
    sizes, place = numeric.scale.coordinates, PoseProblem(numeric, conditions, float(path.times[-1]), start.z)
    ends = [path.poses[-1]]
    for _ in range(END_STARTS):
        try:
            with without_warnings():
                q = place.solve(
                    ends[0] + np.where(numeric.eom.angles, np.pi, sizes) * random.uniform(-1, 1, sizes.size)
                )
        except MechanismError:
            continue
        if all(largest((q - other) / sizes) > ANOTHER for other in ends):
            ends.append(q)
    ends[1:] = sorted(ends[1:], key=lambda q: float(np.sum(numeric.weights * (q - start.q) ** 2)))
    parts = [kinematic_guess(setup.loads, start, _straight(setup, path, q)) for q in ends[1 : OTHER_ENDS + 1]]
    return [guess_of(solver, [part], "kinematic, to another pose at the end") for part in parts]


def _straight(setup: PhaseSetup, path: KinematicPath, end: np.ndarray) -> KinematicPath:
    """Poses whose coordinates lead evenly from the first one of a path to an end, as nearly as the joints let them."""
    numeric, times = setup.numeric, path.times
    shares = (times - times[0]) / (times[-1] - times[0])
    poses = []
    for time, share in zip(times.tolist(), shares.tolist(), strict=True):
        q = path.poses[0] + share * (end - path.poses[0])
        outcome = solve(partial(numeric.position, time), q, numeric.weights, iterations=30)
        poses.append(outcome.x if outcome.converged else q)
    return replace(path, poses=np.array(poses))


def best_of(
    solver: ProblemSolver,
    meshes: list[Mesh],
    candidates: list[Guess],
    *,
    warm: bool,
    executor: Executor | None = None,
    settle: Callable[[Solution], tuple[Solution, bool]] | None = None,
    limit: int | None = None,
    further: int | None = None,
) -> Solution:
    """Solve from every guess and return the best solution; all are reported in its statistics.

    A guess that is another solution is tried with the settings of a warm start first, and if these fail at once without
    them. `warm` if the guesses are solutions of nearly the same problem. `settle` returns a solution on a finer mesh,
    and whether this holds: the cost on a coarse mesh may be false, and the best is chosen by what it is on a mesh that
    holds. Each solve takes at most `limit` iterations. With `further` the guesses are solved from the
    last to the first, and once one has succeeded the others take at most so many; those of :func:`swings` follow. If
    none succeeds, the error of the last candidate is raised.
    """
    solver.best.new_stage()
    tries = partial(_tried, meshes=meshes, warm=warm)
    if executor is not None:
        outcomes = _side_by_side(partial(tries, limit=limit), solver, candidates, executor)
    elif further is not None:
        enough = partial(swings_suffice, solver)
        outcomes = _from_last_to_first(partial(tries, solver), candidates, limit, further, enough)
    else:
        outcomes = [tries(solver, guess, limit=limit) for guess in candidates]
    failures = [result for _, result in outcomes if isinstance(result, OptimizationError)]
    if further is not None:
        outcomes += _from_swings(tries, solver, outcomes, _least(limit, further))
    if not any(map(_is_solved, outcomes)):
        raise failures[-1]
    best = _settled(outcomes, settle)
    solution, reports = _solutions(outcomes)[0] if best is None else best[0], _reports(outcomes)
    if len(reports) > 1:
        solution.statistics = replace(solution.statistics, starts=reports)
    return solution


def _tried(
    solver: ProblemSolver,
    guess: Guess,
    meshes: list[Mesh],
    warm: bool,
    limit: int | None,
    cold: Callable[..., Solution] = solve_coarse_first,
) -> Outcome:
    """Reports of the solves from a guess, and what the last one ended with; `cold` is the way without a warm start."""
    reports = []
    for is_warm in (True, False) if warm else (False,):
        result: Solution | OptimizationError
        try:
            way = partial(solver.solve, warm=True) if is_warm else partial(cold, solver)
            result = end = way(meshes, guess, limit=limit)
        except OptimizationError as error:
            result, end = error, error.partial
        report = end.as_attempt(f"{guess.description}, warm" if is_warm else guess.description)
        reports.append(report if result is end else replace(report, cost=float("nan")))
        if isinstance(result, Solution):
            break
    return reports, result


def _from_last_to_first(
    tries: Callable[..., Outcome],
    candidates: list[Guess],
    limit: int | None,
    further: int,
    enough: Callable[[Sequence[Attempt]], bool],
) -> list[Outcome]:
    """Outcomes of the guesses in their order; once one has succeeded, solves take at most `further` iterations.

    The others are left out if `enough` is True of the reports of those before.
    """
    outcomes: list[Outcome] = []
    for guess in reversed(candidates):
        if any(map(_is_solved, outcomes)):
            if enough(_reports(outcomes)):
                break
            limit = _least(limit, further)
        outcomes.append(tries(guess, limit=limit))
    return outcomes[::-1]


def _from_swings(
    tries: Callable[..., Outcome], solver: ProblemSolver, before: Sequence[Outcome], limit: int
) -> list[Outcome]:
    """Outcomes of the guesses of :func:`swings` after others, until the solutions of the lowest cost are several.

    Each solve takes at most `limit` iterations, and few compared to those before if one of these has succeeded. Limits
    close in from the solution without: of 96 solves of 12 chains under limits that their free optima pass, 50 succeed
    so, and 10 with the limits from the beginning, which follows if none does and a motion is known.
    """
    known, outcomes = _reports(before) if any(map(_is_solved, before)) else [], list(before)
    if known:
        limit = min(limit, int(DETOURED * max(report.iterations for report in known)))
    ends = (end if isinstance(end, Solution) else end.partial for _, end in before)
    ways: list[Callable[..., Solution]] = [_closing_in] if any(LimitSides(end.program).sides for end in ends) else []
    # if a motion is known and none closes in, as that of a least time, which has no end without limits
    ways += [solve_coarse_first] if known or not ways else []
    for way in ways:
        for guess in swings(solver, known):
            if _agreeing(outcomes) >= AGREEING:
                break
            best = _solutions(outcomes)[:1]
            rival = _rival(solver, best[0].cost) if best else solver
            outcomes.append(tries(rival, guess, limit=limit, cold=way))
        if any(map(_is_solved, outcomes[len(before) :])):
            break
    return outcomes[len(before) :]


def _closing_in(solver: ProblemSolver, meshes: Sequence[Mesh], guess: Guess, *, limit: int | None) -> Solution:
    """Solve from a guess without limits, and from there with them; raises as :meth:`ProblemSolver.solve` does."""
    return solver.close_in(solve_coarse_first(solver.unlimited(), meshes, guess, limit=limit), limit)


def _rival(solver: ProblemSolver, cost: float) -> ProblemSolver:
    """The same solver, which gives up if its cost stays far above that of a solution; costs may be below zero."""
    rival = copy(solver)
    rival.ceiling = HOPELESS * cost if cost > 0 else np.inf
    return rival


def _is_solved(outcome: Outcome) -> bool:
    return isinstance(outcome[1], Solution)


def _reports(outcomes: Sequence[Outcome]) -> list[Attempt]:
    return [report for reports, _ in outcomes for report in reports]


def _agreeing(outcomes: Sequence[Outcome]) -> int:
    """Number of the solutions that have the lowest cost."""
    costs = [solution.cost for solution in _solutions(outcomes)]
    return sum(same_cost(cost, costs[0]) for cost in costs)


def _least(limit: int | None, further: int) -> int:
    return further if limit is None else min(limit, further)


def _side_by_side(
    tries: Callable[[ProblemSolver, Guess], Outcome], solver: ProblemSolver, candidates: list[Guess], executor: Executor
) -> list[Outcome]:
    """Outcomes of all guesses; the runs of the solver take place on an executor, what leads to them in threads here."""
    elsewhere = Elsewhere(executor)

    def outcome(guess: Guess) -> Outcome:
        try:
            return symbolic(tries)(solver.on(elsewhere), guess)
        except KeyboardInterrupt:  # it may reach a worker first
            elsewhere.give_up()
            raise

    with numeric_work(), ThreadPoolExecutor(len(candidates)) as threads:
        try:
            return list(threads.map(outcome, candidates))
        except KeyboardInterrupt:
            elsewhere.give_up()
            raise


def _settled(
    outcomes: Sequence[Outcome], settle: Callable[[Solution], tuple[Solution, bool]] | None
) -> tuple[Solution, bool] | None:
    """The best solution of all guesses, in the order of their costs, and if its mesh holds.

    Solutions are on meshes that hold, or on the finest that were tried. None if all are no motions, whose costs mean
    nothing. Of two of the same cost one is settled.
    """
    best, before = None, np.nan
    for solution in _solutions(outcomes):
        if best is not None and best[1] and solution.cost >= best[0].cost * (1 - SAME_COST):
            break
        if same_cost(solution.cost, before):
            continue
        before = solution.cost
        if settle is None:
            best = _better(best, (solution, True))
        elif not is_lost(solution):
            best = _better(best, settle(solution))
    return best


def _solutions(outcomes: Sequence[Outcome]) -> list[Solution]:
    """The solutions, the cheapest one first."""
    return sorted((end for _, end in outcomes if isinstance(end, Solution)), key=lambda one: one.cost)


def _better(one: tuple[Solution, bool] | None, other: tuple[Solution, bool]) -> tuple[Solution, bool]:
    """The solution whose mesh holds, or of two alike the one of lower cost; the first one if there is no difference."""
    return other if one is None or (not other[1], other[0].cost) < (not one[1], one[0].cost) else one
