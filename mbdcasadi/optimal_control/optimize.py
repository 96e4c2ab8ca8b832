"""Solve an optimal-control problem: transcribe, guess, hand to IPOPT, read the solution."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from ..arguments.values import pairs_of
from ..errors import ModelError
from ..model.symbols import number
from ..numerics.console import keyboard_interrupts
from ..numerics.symbolic import LOCK
from ..results.trajectory import Trajectory
from ..results.validity import report_validity, validity_conditions
from .checks.branch import refuse_branch_jump
from .checks.closings import warn_of_closings
from .checks.failure import OptimizationError
from .guess.multistart import best_of, guesses
from .guess.parameter_continuation import by_continuation, read_continuation
from .nlp.held_limits import warn_of_passed_limits
from .nlp.setup import PhaseSetup, Settings, is_open_chain
from .nlp.solver import BestSoFar, Solver
from .problem import OptimalControlProblem
from .refinement.local_error import warn_of_coarse_mesh
from .refinement.mesh import Mesh
from .refinement.refine import refine, refine_if_coarse
from .solution import Shifted, Solution
from .transcription import Transcription

#: Intervals of a mesh whose number is not given.
INTERVALS = 40


def optimize(
    problem: OptimalControlProblem,
    *,
    intervals: int | str = "auto",
    degree: int = 3,
    tolerance: float | None = None,
    guess: Solution | Shifted | Trajectory | None = None,
    starts: Any = None,
    initial: Any = None,
    parameters: Any = None,
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
    intervals : int or "auto"
        Number of intervals of the mesh of each phase, of equal length between waypoints. With "auto", the default,
        there are 40, and those that are too coarse for the motion that was found, or pass limits, are split.
    degree : int, default 3
        Number of stages of an interval of ``"gauss-legendre"``; order ``2 degree`` at the mesh points.
    tolerance : float, optional
        Refine the mesh until the local error of every interval is below it.
    guess : Solution or Trajectory, optional
        Initial guess, on any mesh: another solution, a simulation, or an
        inverse dynamics of the same bodies with a driver in place of the input.
        Default is a kinematic motion, by continuation through the conditions.
    starts : int or sequence, optional
        Number of different starts, or a list of guesses; the best solution is
        returned, and ``statistics.starts`` has all.
    initial : sequence of relations or State, optional
        Start in place of the problem's own; what was compiled is used again.
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
        If the solver does not succeed: its status in words,
        ``.largest_violations`` with labels, the last iterate in ``.partial``. Also if no mesh was found that meets
        the `tolerance`, or if the mesh is so coarse that a linkage jumps to another branch within an interval; then
        ``.partial`` is the solution on the last one.
    Interrupted
        After Ctrl-C: ``.partial`` is the best solution so far, or the last iterate if there is none yet.

    Warns
    -----
    MechanismWarning
        If a contact of the solution would have to pull, or an element leaves its range of validity; of several phases,
        if what closes at the end of one has passed through its place before, or a foothold pulls; if a path limit
        is passed by more than a hundredth of it between the points at which it is held; if the mesh is too coarse for
        the motion that was found (not checked if ``guess=`` is a solution).
    """
    if not isinstance(problem, OptimalControlProblem):
        raise ModelError(f"optimize takes an OptimalControlProblem, got {problem!r}")
    best = BestSoFar()
    try:
        with LOCK, keyboard_interrupts("optimize"):
            search = _Search(problem, intervals, initial, (transcription, degree, control, options, progress), best)
            accuracy = None if tolerance is None else _tolerance(tolerance)
            if continuation is None:
                solution = search.solve(parameters, guess, starts, accuracy)
            else:
                steps = read_continuation(problem, continuation, parameters)

                def solve(values: dict[Any, float], near: Any, *, first: bool, last: bool) -> Solution:
                    pairs = [*pairs_of(parameters, "parameters="), *values.items()]
                    return search.solve(pairs, near, starts if first else None, accuracy if last else None)

                solution = by_continuation(steps, solve, guess)
            if accuracy is None and not isinstance(guess, Solution | Shifted):
                refuse_branch_jump(solution)
                warn_of_coarse_mesh(solution)
            warn_of_passed_limits(solution)
            warn_of_closings(solution)
            for part in solution.phases:
                if validity_conditions(part.phase.mechanism):
                    report_validity(part.trajectory)
    except KeyboardInterrupt:
        raise best.interrupted() from None
    return solution


@dataclass(frozen=True)
class _Search:
    """Solves of one problem with the same settings, at any parameter values."""

    problem: OptimalControlProblem
    intervals: Any
    initial: Any
    settings: tuple[Any, ...]
    best: BestSoFar

    @property
    def _is_automatic(self) -> bool:
        return isinstance(self.intervals, str) and self.intervals == "auto"

    def _mesh(self, setup: PhaseSetup) -> Mesh:
        """Mesh of a phase to begin with."""
        if setup.phase.is_instant:
            return Mesh.instant()
        waypoints = len(setup.phase.waypoints)
        counts = max(INTERVALS, 2 * (waypoints + 1)) if self._is_automatic else _count(self.intervals, waypoints)
        return Mesh.equal(counts, setup.path.segment_times)

    def solve(self, parameters: Any, guess: Any, starts: Any, tolerance: float | None) -> Solution:
        """Solve from one or several guesses, and refine the mesh if a tolerance is given."""
        settings = Settings.read(*self.settings)
        near = guess.solution if isinstance(guess, Shifted) else guess
        if isinstance(near, Solution) and starts is None:
            settings = replace(settings, angles=near.settings.angles)
        elif near is None and not isinstance(starts, Iterable) and is_open_chain(self.problem):
            settings = replace(settings, angles=True)

        automatic = self._is_automatic and near is None and tolerance is None

        def solve(settings: Settings) -> tuple[Solver, Solution]:
            solver = Solver(self.problem, settings, parameters, self.initial, self.best)
            meshes = list(map(self._mesh, solver.setups))
            warm = isinstance(near, Solution) and starts is None
            settle = partial(refine_if_coarse, solver) if automatic else None
            return solver, best_of(solver, meshes, guesses(solver, starts, guess), warm=warm, settle=settle)

        try:
            solver, solution = solve(settings)
        except OptimizationError as error:
            if not settings.angles or near is not None:
                raise
            try:  # in all coordinates another way may be found
                solver, solution = solve(replace(settings, angles=False))
            except OptimizationError:
                raise error from None
        return solution if tolerance is None else refine(solver, solution, tolerance)


def _count(intervals: Any, waypoints: int) -> int:
    least = 2 * (waypoints + 1)
    if isinstance(intervals, bool) or not isinstance(intervals, int | np.integer) or intervals < least:
        between = f" with {waypoints} waypoints" if waypoints else ""
        raise ModelError(f"optimize: intervals must be a whole number of at least {least}{between}, got {intervals!r}")
    return int(intervals)


def _tolerance(value: Any) -> float:
    tolerance = number(value, "optimize", "tolerance")
    if tolerance <= 0:
        raise ModelError(f"optimize: tolerance must be positive, got {value!r}")
    return tolerance
