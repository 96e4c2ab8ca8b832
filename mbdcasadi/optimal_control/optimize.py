"""Solve an optimal-control problem: transcribe, guess, hand to IPOPT, read the answer."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..arguments.values import pairs_of
from ..errors import ModelError
from ..model.quantities import yes_or_no
from ..model.symbols import number
from ..results.trajectory import Trajectory
from ..results.validity import report_validity, validity_conditions
from .guess.multistart import best_of, guesses
from .nlp.solver import Solver
from .parameter_continuation import by_continuation, read_continuation
from .preparation import TRANSCRIPTIONS, Settings
from .problem import OptimalControlProblem
from .refinement.local_error import tell_coarse_mesh
from .refinement.mesh import Mesh
from .refinement.refine import refine
from .solution import Shifted, Solution
from .transcription.base import Transcription


def optimize(
    problem: OptimalControlProblem,
    *,
    intervals: int = 40,
    degree: int = 3,
    tolerance: float | None = None,
    guess: Solution | Shifted | Trajectory | None = None,
    starts: Any = None,
    initial: Any = None,
    parameters: Any = None,
    continuation: Any = None,
    transcription: str | type[Transcription] = "gauss-legendre",
    control: str = "polynomial",
    progress: bool = False,
    options: dict[str, Any] | None = None,
) -> Solution:
    """Find the motion of least cost by direct collocation.

    Parameters
    ----------
    problem : OptimalControlProblem
        What to solve.
    intervals : int, default 40
        Intervals of the mesh, of equal length between waypoints.
    degree : int, default 3
        Stages of an interval of ``"gauss-legendre"``; order ``2 degree`` at the mesh points.
    tolerance : float, optional
        Refine the mesh until the local error of every interval is below it.
    guess : Solution or Trajectory, optional
        Where to start, on any mesh: another solution, a simulation, or an
        inverse dynamics of the same bodies with a driver in place of the input.
        Without it a kinematic motion, by continuation through the conditions.
    starts : int or sequence, optional
        So many different starts, or a list of guesses; the best solution is
        returned, and ``statistics.starts`` has all.
    initial : sequence of relations or State, optional
        Instead of the problem's own; what was compiled is used again.
    parameters : mapping, optional
        Parameter to number.
    continuation : mapping, optional
        Parameter to a sequence of values: the problem is solved for each in turn, from the last solution, and that of
        the last values is returned: ``{v_t: [0.1, 1e-2, 1e-3]}`` sharpens smoothed friction, ``{k: [1e3, 1e5]}``
        hardens a contact. Several parameters change together. Where the solver fails at a value, one between is
        tried first; ``statistics.steps`` has all, and only the last mesh is refined to `tolerance`.
    transcription : {"gauss-legendre", "hermite-simpson"} or subclass of Transcription
        A scheme of the package by name, or one of the user's own; see
        :class:`~mbdcasadi.optimal_control.transcription.gauss_legendre.GaussLegendre` and
        :class:`~mbdcasadi.optimal_control.transcription.hermite_simpson.HermiteSimpson`.
    control : {"polynomial", "linear", "constant"}
        How inputs vary on the intervals. Polynomials are those that the stages determine, of one degree less where an
        input drives a first-order state. Their limits hold at the stages and at both ends; ``solution.limit_excess``
        says how far they are passed between.
    progress : bool, default False
        Show iteration, cost and largest violation.
    options : dict, optional
        Passed on to CasADi, as ``{"ipopt.max_iter": 500}``.

    Returns
    -------
    Solution
        The optimum.

    Raises
    ------
    OptimizationError
        Where the solver does not succeed: its status in words,
        ``.largest_violations`` with labels, the last iterate in ``.partial``. Also where no mesh was found that meets
        the `tolerance`; then ``.partial`` is the solution on the last one.
    Interrupted
        After Ctrl-C, with the last iterate in ``.partial``.

    Warns
    -----
    MechanismWarning
        Where a contact of the solution would have to pull, or an element leaves what it is made for; where the mesh is
        too coarse for the motion that was found (not looked at where ``guess=`` is a solution).
    """
    if not isinstance(problem, OptimalControlProblem):
        raise ModelError(f"optimize takes an OptimalControlProblem, got {problem!r}")
    if initial is not None:
        problem = problem.started_from(initial)
    if continuation is not None:
        steps = read_continuation(problem, continuation, parameters)
        common: dict[str, Any] = {"intervals": intervals, "degree": degree, "transcription": transcription}
        common |= {"control": control, "progress": progress, "options": options}

        def solve(values: dict[Any, float], near: Any, *, first: bool, last: bool) -> Solution:
            pairs = [*pairs_of(parameters, "parameters="), *values.items()]
            own: dict[str, Any] = {"starts": starts if first else None, "tolerance": tolerance if last else None}
            return optimize(problem, guess=near, parameters=pairs, **common, **own)

        return by_continuation(steps, solve, guess)
    accuracy = None if tolerance is None else _tolerance(tolerance)
    settings = _settings(transcription, degree, control, options, progress)
    solver = Solver(problem, settings, parameters)
    mesh = Mesh.equal(_count(intervals, len(problem.waypoints)), solver.prepared.marks)
    candidates = guesses(solver, starts, guess)
    solution = best_of(solver, mesh, candidates, warm=isinstance(guess, Solution | Shifted) and starts is None)
    if accuracy is not None:
        solution = refine(solver, solution, accuracy)
    elif not isinstance(guess, Solution | Shifted):
        tell_coarse_mesh(solution)
    if validity_conditions(problem.mechanism):
        report_validity(solution.trajectory)
    return solution


def _settings(transcription: Any, degree: Any, control: Any, options: Any, progress: Any) -> Settings:
    own = isinstance(transcription, type) and issubclass(transcription, Transcription)
    if not own and not (isinstance(transcription, str) and transcription in TRANSCRIPTIONS):
        raise ModelError(
            f"optimize: transcription must be one of {', '.join(TRANSCRIPTIONS)} or a subclass of Transcription, "
            f"got {transcription!r}"
        )
    if isinstance(degree, bool) or degree not in (1, 2, 3, 4, 5):
        raise ModelError(f"optimize: degree must be 1 to 5, got {degree!r}")
    shown = yes_or_no(progress, "optimize", "progress")
    given = {} if options is None else options
    if not isinstance(given, dict) or not all(isinstance(name, str) for name in given):
        raise ModelError(f"optimize: options takes a dict such as {{'ipopt.max_iter': 500}}, got {options!r}")
    return Settings(transcription, int(degree), control, dict(given), shown)


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
