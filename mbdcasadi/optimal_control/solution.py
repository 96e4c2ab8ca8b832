"""The optimum: its motion, its inputs, and the proof by simulation."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ..arguments.piecewise_polynomial import PiecewisePolynomial
from ..arguments.values import pairs_of, parameter_vector
from ..equations.numeric import NumericEquations
from ..errors import ConditionError, MechanismError, ModelError
from ..model.symbols import Parameter, number
from ..results.state import State
from ..results.trajectory import Statistics, Trajectory
from ..simulation.simulate import simulate
from .guess.guess import Guess, Iterate, guess_from_motion
from .motion import OptimalMotion, Polynomials
from .nlp.limits import ActiveLimit, active_limits, costates, limit_excess
from .nlp.motion_program import MotionProgram
from .problem import OptimalControlProblem
from .refinement.local_error import end_errors, scaled_errors
from .refinement.mesh import Mesh
from .refinement.verification import Replay, replay
from .solve_statistics import Answer, SolveStatistics

#: Miss of a constraint from which the first state of a solution is none of a mechanism with other parameters.
BREAKS = 1e-6


@dataclass(frozen=True)
class Shifted:
    """A solution from a later time on, to start from; made by :meth:`Solution.shifted`."""

    solution: Solution
    time: float

    def as_guess(self, problem: OptimalControlProblem) -> Guess:
        """The later part of the motion as a guess for the same problem."""
        solution, guess = self.solution, self.solution.as_guess(problem)
        last = float(guess.marks[-1])

        def sample(wanted: np.ndarray) -> dict[str, np.ndarray]:
            return guess.sample(np.clip(wanted + self.time, 0.0, last))

        moved = replace(guess, sample=sample, iterate=None, word=f"solution, {self.time:g} s later")
        x = moved.variables(solution.program, solution.shares)
        iterate = Iterate(solution.program, solution.shares, x, solution.answer.lam_x, solution.answer.lam_g)
        return replace(moved, iterate=iterate)


class Solution:
    """A motion found by optimal control.

    Parameters
    ----------
    problem : OptimalControlProblem
        What it was made for.
    program : MotionProgram
        The program that was solved.
    settings : dict
        Transcription, degree and control by which it was made.
    given : NumericEquations
        Equations at the parameters that were given.
    shares : Mesh
        The mesh.
    x : numpy.ndarray
        Variables of the program, in physical units.
    marks : numpy.ndarray
        Times of start, waypoints and end where none of them was sought, s.
    cost : float
        Value that was minimised.
    statistics : SolveStatistics
        How it was found.
    answer : Answer
        Multipliers and rows of the program.

    Attributes
    ----------
    mesh : numpy.ndarray
        Mesh points (N + 1,), s.
    duration : float
        s.
    waypoint_times : numpy.ndarray
        When the waypoints are passed, s.
    parameters : dict of Parameter to float
        Values of the free parameters.
    """

    def __init__(
        self,
        problem: OptimalControlProblem,
        program: MotionProgram,
        settings: dict[str, Any],
        given: NumericEquations,
        shares: Mesh,
        x: np.ndarray,
        marks: np.ndarray,
        cost: float,
        statistics: SolveStatistics,
        answer: Answer,
    ):
        self.problem, self.program, self.settings = problem, program, settings
        self.cost = cost
        self.statistics = statistics
        self.answer = answer
        self.shares = shares
        #: variables of the program, in physical units
        self.variables = x
        self.marks = x[program.mark_index] if program.mark_count else np.asarray(marks, float)
        self.duration = float(self.marks[-1])
        self.waypoint_times = self.marks[1:-1]
        self.mesh = shares.times(self.marks)
        values = x[program.parameter_index]
        self.parameters: dict[Parameter, float] = dict(zip(problem.free_parameters, values.tolist(), strict=True))
        self.numeric = NumericEquations(problem.equations, self._mechanism_parameters(given.p))

    def _mechanism_parameters(self, given: np.ndarray) -> np.ndarray:
        """Parameters of the mechanism with the free ones put in."""
        p = given.copy()
        for k, symbol in enumerate(self.problem.mechanism.parameters):
            if symbol in self.parameters:
                p[k] = self.parameters[symbol]
        return p

    # --- the motion ----------------------------------------------------------------------------
    @cached_property
    def nodes(self) -> np.ndarray:
        """Coordinates, velocities and first-order states at the mesh points (N + 1, k)."""
        return np.hstack(self.polynomials.at_nodes)

    @cached_property
    def polynomials(self) -> Polynomials:
        """The polynomials of the scheme, with numbers."""
        scheme = self.program.scheme
        count = self.shares.count
        nodes = np.array([self.variables[self.program.node_index(k)[: scheme.node_size]] for k in range(count + 1)])
        blocks = np.array([self.variables[self.program.block_index(i)] for i in range(count)])
        return Polynomials(scheme, self.mesh, nodes, blocks, self.numeric)

    @cached_property
    def inputs(self) -> dict[Any, PiecewisePolynomial]:
        """The inputs as piecewise polynomials, as ``simulate(inputs=…)`` takes them."""
        return self.polynomials.inputs

    @property
    def redundant(self) -> bool:
        """Whether constraint rows were left out because others imply them."""
        scheme = self.program.scheme
        return len(scheme.rows) < scheme.eom.lam.numel()

    @cached_property
    def trajectory(self) -> OptimalMotion:
        """The motion at mesh points and stages; ``.at(times)`` between them by the polynomials of the scheme."""
        scheme = self.program.scheme
        form = f"order {scheme.order}, {self.shares.count} intervals"
        own = np.array([self.parameters[p] for p in self.problem.own_parameters])
        statistics = Statistics(scheme.name, form, self.statistics.seconds)
        return self.polynomials.trajectory(self.problem, own, statistics, redundant=self.redundant)

    @property
    def points_per_interval(self) -> int:
        """Points of :attr:`trajectory` in each interval."""
        return (len(self.trajectory) - 1) // self.shares.count

    def state(self, index: int) -> State:
        """State at a mesh point, by index."""
        points = self.shares.count + 1
        if isinstance(index, bool) or not isinstance(index, int | np.integer) or not -points <= index < points:
            raise MechanismError(f"the solution has {points} mesh points, and none of index {index!r}")
        return self.trajectory.state((index % points) * self.points_per_interval)

    def as_guess(self, problem: OptimalControlProblem) -> Guess:
        """The motion as a guess for the same or a similar problem."""
        marks = self.marks
        if len(marks) != len(problem.waypoints) + 2:
            marks = np.linspace(0, self.duration, len(problem.waypoints) + 2)
        spans = [(0.0, 0.0), *[w.time for w in problem.waypoints], problem.duration]
        marks = np.array([np.clip(t, low, high) for t, (low, high) in zip(marks, spans, strict=True)])
        guess = guess_from_motion(problem, self.trajectory, marks)
        free = [self.parameters.get(p, p.value) for p in problem.free_parameters]
        iterate = Iterate(
            self.program, self.shares, self.variables / self.program.scale, self.answer.lam_x, self.answer.lam_g
        )
        return Guess(guess.sample, marks, np.array(free), "solution", iterate)

    def shifted(self, time: float) -> Shifted:
        """The motion from a later time on, as a guess: what follows its end stays as it ends.

        For model-predictive control, where the next plan starts a sample later.

        Parameters
        ----------
        time : float
            By how much later it begins, s.
        """
        return Shifted(self, number(time, "shifted", "time"))

    # --- proof ---------------------------------------------------------------------------------
    def verify(self, reltol: float = 1e-10, abstol: float = 1e-10) -> Replay:
        """Simulate by IDAS from the first state with the solution's own input polynomials."""
        return replay(self, reltol, abstol)

    def simulate(self, *, initial: Any = None, parameters: Any = None, **settings: Any) -> Trajectory:
        """Simulate the mechanism with the inputs that were found, from other starts or with other parameters."""
        taken = {"times", "duration", "inputs"} & set(settings)
        if taken:
            raise ModelError(f"Solution.simulate: {', '.join(sorted(taken))} are those of the solution")
        own = dict(zip(self.problem.mechanism.parameters, self.numeric.p, strict=True))
        changed = own | dict(pairs_of(parameters, "parameters="))
        if initial is None:
            initial = self.trajectory.initial
            eom = self.problem.equations
            name, missed = NumericEquations(eom, parameter_vector(eom, changed)).largest_miss(0.0, initial.q, initial.v)
            if abs(missed) > BREAKS:
                raise ConditionError(
                    f"simulate: with these parameters the first state of the solution does not meet {name}, by "
                    f"{missed:.3g}; give initial= as conditions, such as those of the problem"
                )
        return simulate(
            self.problem.mechanism, self.mesh, initial=initial, inputs=self.inputs, parameters=changed, **settings
        )

    @cached_property
    def end_errors(self) -> np.ndarray:
        """By how much each interval, integrated again, misses the next mesh point in q, v and z (N, 2 n + k)."""
        return end_errors(self)

    @property
    def state_ranges(self) -> np.ndarray:
        """By how much each first-order state changes over the motion, its typical size where it does not (k,)."""
        ranges = np.ptp(self.nodes[:, 2 * self.problem.equations.q.numel() :], axis=0)
        found: np.ndarray = np.where(ranges > 0, ranges, self.program.scales.z)
        return found

    @cached_property
    def mesh_error(self) -> float:
        """Largest local error of an interval: q (m, rad), v by the duration, first-order states by their ranges."""
        return float(np.max(scaled_errors(self)))

    # --- limits --------------------------------------------------------------------------------
    @cached_property
    def costates(self) -> dict[str, np.ndarray | float]:
        """What each limit and condition costs, by label.

        Path limits and limits of inputs: by interval (N,), the decrease of the
        cost for one unit by which the limit is loosened, per second.
        Equalities at places: the change of the cost for one unit added to the
        right-hand side; inequalities there: its decrease for one unit by which they are loosened.
        """
        return costates(self)

    @cached_property
    def active_limits(self) -> list[ActiveLimit]:
        """Limits that hold the motion back, and when; the costliest first."""
        return active_limits(self)

    @cached_property
    def limit_excess(self) -> dict[str, float]:
        """By how much each limit is passed between the points at which it is held, by label, in its own unit."""
        return limit_excess(self)

    # --- files ------------------------------------------------------------------------------------
    def save(self, path: str | Path) -> None:
        """Write the solution to a ``.npz`` file; ``read_solution(path, problem)`` reads it."""
        from .storage import save

        save(self, path)

    def __repr__(self) -> str:
        s = self.statistics
        text = (
            f"Solution: cost {self.cost:.8g}, duration {self.duration:.6g} s, {self.shares.count} intervals, "
            f"{s.iterations} iterations, {s.seconds:.3g} s ({s.status})"
        )
        return text + "".join(f"\n  {symbol.label} = {value:.6g}" for symbol, value in self.parameters.items())
