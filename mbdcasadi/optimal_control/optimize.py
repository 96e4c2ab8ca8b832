"""Solution of an optimal-control problem, from its statement to warnings about what was found.

In the order in which they are passed:

1. :mod:`problem`, of phases (:mod:`phase`): the statement, checked by :mod:`poses.consistency`.
2. :mod:`search.search`: the :mod:`search.strategies` have their turns; :mod:`search.reach` looks before them whether
   the linkage reaches waypoints and ends.
3. :mod:`program.problem_setup`: parameters, first state, poses on the way, and what the programs of a phase share.
4. :mod:`search.starts`: motions to begin with.
5. :mod:`program.collocation_program`, by a scheme of :mod:`transcription`: the nonlinear program on a mesh.
6. :mod:`solve.problem_solver`: one solve, by :mod:`solve.solvers.ipopt`; :mod:`solve.failure` says why one failed.
7. :mod:`search.refine`: other meshes, until each :mod:`measures.measure` meets a tolerance, by default a coarse one.
8. :mod:`solution`: the motion, its limits and costates, and :mod:`motion.verification`.

A mechanism with exact friction goes through :mod:`friction.search`, which does this with friction as a force, and again
in phases of sticking and sliding.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from typing import Any

import numpy as np

from ..errors import ModelError
from ..model.symbols import number
from ..numerics.console import keyboard_interrupts
from ..numerics.symbolic import LOCK
from ..results.state import Conditions
from ..results.trajectory import Trajectory
from ..results.validity import report_validity, validity_conditions
from .friction.search import FrictionSearch
from .measures.closings import warn_of_closings
from .measures.cost_error import warn_of_false_cost
from .measures.local_error import warn_of_coarse_mesh, warn_of_growth
from .measures.singularity import warn_of_folding_poses
from .motion.limit_excess import warn_of_passed_limits
from .problem import OptimalControlProblem
from .program.setup import Settings
from .search.parameter_continuation import read_continuation
from .search.saddle import warn_of_saddle
from .search.search import Search, Several
from .search.strategies import STRATEGIES, read_strategies
from .search.strategy import Strategy
from .search.undecided import warn_of_undecided
from .solution import Shifted, Solution
from .solve.best_so_far import BestSoFar
from .statement.known_inputs import read_known_inputs
from .transcription import Transcription


def optimize(
    problem: OptimalControlProblem,
    *,
    intervals: int | str | Sequence[int] | Mapping[Any, int] = "auto",
    degree: int = 3,
    tolerance: float | None = None,
    guess: Solution | Shifted | Trajectory | Mapping[Any, Any] | None = None,
    starts: Any = None,
    executor: Executor | None = None,
    search: Sequence[Strategy] = STRATEGIES,
    initial: Conditions | None = None,
    inputs: Any = None,
    parameters: Mapping[Any, Any] | None = None,
    continuation: Any = None,
    transcription: str | type[Transcription] | Transcription = "gauss-legendre",
    control: str = "polynomial",
    progress: bool = False,
    options: dict[str, Any] | None = None,
) -> Solution:
    """Find the motion of least cost by direct collocation.

    Several threads may solve one problem at the same time; expressions must be made before.

    Parameters
    ----------
    problem : OptimalControlProblem
        Problem to solve.
    intervals : int, sequence, mapping or "auto"
        Number of intervals of the mesh of each phase, of equal length between waypoints: one for all phases, one for
        each that lasts in their order, or ``{phase: number}`` by phase or its name. With "auto", the default,
        there are 40, or those of a solution that is the guess, and the intervals that are too coarse for the motion
        that was found or for its cost, or pass limits, are split. A mesh of 160 or more is solved from the solution on
        one of 40.
    degree : int, default 3
        Number of stages of an interval of ``"gauss-legendre"``; order ``2 degree`` at the mesh points.
    tolerance : float, optional
        Refine the mesh until the local error of every interval is below it, path limits are passed by less than this
        share of their sizes, and the estimated errors of polynomial inputs are below this share of their largest
        values. Stretches around switches and kinks, in which inputs may be off by more, are shorter than its root, or
        at kinks than a hundredth, as a share of the duration, and still shorter if velocities, first-order states or
        the running cost change by much there, so that their effect on the cost is as small. Times at which costs,
        limits or forces jump become mesh points, and the integral of the running cost is right to this share; what
        jumps with the states or at a time that is a free parameter is reported.
    guess : Solution, Trajectory or mapping, optional
        Initial guess, on any mesh: another solution, a simulation, or an inverse dynamics of the same bodies, by name,
        with a driver in place of the input. Or ``{expression: values}`` of what is known of the motion: expressions in
        positions, such as coordinates and ``hand.x``, inputs, first-order states; each a number, an array over the
        duration, a pair (times, values), a spline or a function of the time since the start, or an expression in t.
        Poses meet them as nearly as the joints let them, and are else those of the default; velocities and the loads
        that are not given follow. Times decide the first duration. Free parameters have a number. ``{phase:
        {expression: values}}``, by phase or its name, is over a phase, else values are over the whole motion.
        Default is a kinematic motion, by continuation through the conditions.
    starts : int or sequence, optional
        Number of starts of different kinds, durations and ends, or a list in place of `guess`; the best is returned,
        and ``statistics.starts`` has all, with the number of those of the same cost.
    executor : concurrent.futures.Executor, optional
        Threads or processes on which the solver runs from several starts at a time, without `progress`.
    search : sequence of Strategy, optional
        Strategies of the search, which have their turns in this order; by default :data:`STRATEGIES`, of which some may
        be left out, and to which strategies of one's own may be added, see :class:`Strategy`. What was tried is in
        ``statistics.starts`` and ``statistics.stages``.
    initial : sequence of relations or State, optional
        Start in place of the problem's own; what was compiled is used again.
    inputs : mapping, optional
        Inputs whose courses are known: measured signals, loads, references. Each is a number, an array over the
        duration, a pair of times, s, and values, a curve, or an expression in ``mbd.t``; samples are joined by straight
        lines, as in :func:`simulate`. The motion sees a polynomial through the values at the stages of each interval,
        which is exact if intervals end at samples; with a `tolerance` it follows the course to this share of its
        largest value. Durations and times of waypoints are fixed then, unless it is a number. Other courses of the same
        inputs compile nothing anew.
    parameters : mapping, optional
        Parameter to number.
    continuation : mapping, optional
        Parameter to a sequence of values: the problem is solved for each in turn, from the last solution, and that of
        the last values is returned: ``{v_t: [0.1, 1e-2, 1e-3]}`` sharpens smoothed friction, ``{k: [1e3, 1e5]}``
        hardens a contact. Several parameters change together. If the solver fails at a value, one in between is
        tried first; ``statistics.steps`` has all, and only the last mesh is refined to `tolerance`.
    transcription : {"gauss-legendre", "hermite-simpson"}, subclass of Transcription, or object of one
        Scheme of the package by name, or one of your own, see :class:`Transcription`. An object has its own degree:
        ``GaussLegendre(degree=2)``.
    control : {"polynomial", "linear", "constant"}
        Course of the inputs on the intervals. Polynomials are those that the stages determine, of one degree less if
        an input drives a first-order state. Limits of inputs hold everywhere on the intervals.
    progress : bool, default False
        Show iteration, cost and largest violation.
    options : dict, optional
        Options of CasADi, as ``{"ipopt.max_iter": 500}``.

    Returns
    -------
    Solution
        The optimum.

    Raises
    ------
    OptimizationError
        If a waypoint or the end is out of reach, before anything is solved; if the solver does not succeed: its status
        in words, ``.largest_violations`` with labels, the last iterate in ``.partial``. Also if no mesh was found that
        meets the `tolerance`, or if the mesh is so coarse that a linkage jumps to another branch within an interval, or
        an interval ends far off the motion, and finer ones do not help; then ``.partial`` is the solution on the last
        one.
    Interrupted
        After Ctrl-C: ``.partial`` is the best solution so far, or the last iterate if there is none yet.

    Warns
    -----
    MechanismWarning
        If a contact of the solution would have to pull, an element leaves its range of validity, or the motion comes
        close to a pose in which a linkage could fold; of several phases, if a joint that closes at the end of one has
        passed through its place before, or a foothold pulls; if a path limit is passed by more than a hundredth of it
        between the points at which it is held, or as much of the integral of a :func:`positive_part` or
        :func:`absolute` is missing in the cost; if the mesh is too coarse for the motion that was found, or for its
        cost (:attr:`Solution.cost_error` is above a ten-thousandth of it), or the motion is so unstable that a
        simulation with its inputs does not follow it (not checked if ``guess=`` is a solution of the same problem); if
        the solution is a saddle, near which the cost falls, and no lower one was found from there; if no condition and
        no cost decides a quantity of the start, a free time or a free parameter; if inputs, limits or switches do not
        meet the `tolerance`, though the local errors do.
    """
    if not isinstance(problem, OptimalControlProblem):
        raise ModelError(f"optimize takes an OptimalControlProblem, got {problem!r}")
    if executor is not None:
        _check_executor(executor, starts)
    best = BestSoFar()
    try:
        with LOCK, keyboard_interrupts("optimize"):
            accuracy, several = _tolerance(tolerance), _starts(starts, guess)
            settings = Settings.read(transcription, degree, control, options, progress)
            settings = replace(settings, known=read_known_inputs(problem, inputs))
            run = Search(problem, intervals, initial, settings, best, executor, read_strategies(search))
            solution: Solution
            if problem.relaxed is not None:
                solution = _with_exact_friction(run, continuation).solve(parameters, guess, several, accuracy)
            elif continuation is None:
                solution = run.solve(parameters, guess, several, accuracy)
            else:
                steps = read_continuation(problem, continuation, parameters)
                solution = run.solve_in_turn(steps, parameters, guess, several, accuracy)
            if accuracy is None and not run.is_known(guess):
                warn_of_coarse_mesh(solution)
            if not run.is_known(guess):
                warn_of_false_cost(solution)
                warn_of_growth(solution)
                warn_of_folding_poses(solution)
                warn_of_saddle(solution)
                if problem.relaxed is None:  # a rest that costs nothing may be at any time
                    warn_of_undecided(solution)
            warn_of_passed_limits(solution)
            warn_of_closings(solution)
            _warn_of_validity(solution)
    except KeyboardInterrupt:
        raise best.interrupted() from None
    return solution


def _starts(starts: Any, guess: Any) -> Several:
    """The number of starts, or the list of guesses."""
    if starts is None or (isinstance(starts, int | np.integer) and not isinstance(starts, bool)):
        if starts is not None and starts < 1:
            raise ModelError(f"optimize: starts must be at least 1, got {starts}")
        return None if starts is None else int(starts)
    try:
        several = list(starts)
    except TypeError:
        raise ModelError(f"optimize: starts= takes a number or a list of guesses, got {starts!r}") from None
    if not several:
        raise ModelError("optimize: starts= is an empty list")
    if guess is not None:
        raise ModelError("optimize: starts= is a list of guesses; put that of guess= into it, and leave guess= out")
    return several


def _with_exact_friction(run: Search, continuation: Any) -> FrictionSearch:
    """The search for a motion that sticks and slides, with the arguments of another one."""
    if continuation is not None or any(run.settings.known.phases):
        name = "inputs=" if continuation is None else "continuation="
        raise ModelError(
            f"optimize: {name} is not available with DryFriction and RigidContact; take Coulomb and Contact for it"
        )
    problem = run.problem if run.initial is None else run.problem.replace(initial=run.initial)
    return FrictionSearch(problem, run.intervals, run.settings, run.best, run.executor, run.strategies)


def _check_executor(executor: Any, starts: Any) -> None:
    if isinstance(executor, type) or not hasattr(executor, "submit"):
        raise ModelError(f"optimize: executor= takes a concurrent.futures executor, got {executor!r}")
    if starts is None:
        raise ModelError("optimize: executor= solves from several starts at a time; give starts=, too")


def _warn_of_validity(solution: Solution) -> None:
    """Warn of elements that leave their range of validity."""
    for part in solution.phases:
        if validity_conditions(part.phase.mechanism) or part.phase.mechanism.varying_limits:
            report_validity(part.trajectory)


def _tolerance(value: Any) -> float | None:
    if value is None:
        return None
    tolerance = number(value, "optimize", "tolerance")
    if tolerance <= 0:
        raise ModelError(f"optimize: tolerance must be positive, got {value!r}")
    return tolerance
