"""The optimum: its motion, its inputs, and its verification by simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ..arguments.values import pairs_of, parameter_vector
from ..equations.numeric import NumericEquations
from ..errors import ConditionError, MechanismError, ModelError
from ..model.symbols import number
from ..numerics.lazy import cached_property
from ..numerics.symbolic import symbolic
from ..numerics.tolerances import MET
from ..results.notebook import html_table
from ..results.state import State
from ..results.trajectory import Trajectory
from ..simulation.simulate import simulate
from .measures.cost_error import error_of_mesh
from .motion.feedback import LinearFeedback, linear_feedback
from .motion.guess import Guess, Iterate, PhaseGuess
from .motion.limit_excess import limit_excess
from .motion.limits import ActiveLimit, SoftLimitUse, active_limits, costates, soft_limits
from .motion.return_map import ReturnMap, Stability
from .motion.solved_motion import SolvedMotion
from .motion.storage import restored, save
from .motion.verification import Replay, Verification
from .problem import OptimalControlProblem
from .transcription.mesh import interval_count

#: Relative difference of costs below which solutions are the same.
SAME_COST = 1e-6


def same_cost(one: float, other: float) -> bool:
    """Return True if two costs differ no more than by the tolerance of the solver."""
    return abs(one - other) <= SAME_COST * abs(other)


class Solution(SolvedMotion):
    """A motion found by optimal control.

    Parameters
    ----------
    problem : OptimalControlProblem
        Problem that it solves.
    program : CollocationProgram
        Program that was solved.
    settings : Settings
        Transcription and control.
    initial : State or tuple of Condition
        Conditions at the start.
    p : sequence of numpy.ndarray
        Parameters of the mechanism that were given, by phase.
    meshes : sequence of Mesh
        Meshes by phase.
    segment_times : sequence of numpy.ndarray
        Times of start, waypoints and end by phase if none of them is free, s.
    x : numpy.ndarray
        Variables of the program, in physical units.
    cost : float
        Value that was minimised.
    statistics : SolveStatistics
        Course of the solve: iterations, times, meshes.
    answer : Answer
        Multipliers and rows of the program.

    Attributes
    ----------
    phases : tuple of PhaseSolution
        Mesh and motion by phase.
    durations : tuple of float
        Durations of the phases, s.
    mesh, mesh_times : numpy.ndarray
        Mesh points of all phases (N + 1,), s.
    duration : float
        s.
    waypoint_times : numpy.ndarray
        Times of the waypoints, s.
    parameters : dict of Parameter to float
        Values of the free parameters.
    switches : tuple of Switch
        With ``DryFriction`` or ``RigidContact``: when it stops, breaks away, touches or opens, with ``.t``, s,
        ``.name``, and the modes ``.before`` and ``.after``.
    """

    switches: tuple[Any, ...] = ()

    def state(self, index: int) -> State:
        """State at a point of :attr:`mesh`, by index; at a change from phase to phase the one just before."""
        counts = [part.mesh.count for part in self.phases]
        ends, points = np.cumsum(counts), self.mesh.size
        if isinstance(index, bool) or not isinstance(index, int | np.integer) or not -points <= index < points:
            raise MechanismError(f"the solution has {points} mesh points, and none of index {index!r}")
        k = int(np.searchsorted(ends, index % points))
        part, place = self.phases[k], index % points - int(ends[k] - counts[k])
        return part.trajectory.state(place * part.points_per_interval)

    def shifted(self, time: float) -> Shifted:
        """The motion from a later time on, as a guess: what follows its end stays as it ends.

        For model-predictive control, where the next plan starts a sample later.

        Parameters
        ----------
        time : float
            Time by which it begins later, s.
        """
        self._refuse_phases("shifted", "solve again with guess=solution")
        return Shifted(self, number(time, "shifted", "time"))

    def _refuse_phases(self, name: str, remedy: str) -> None:
        if len(self.phases) > 1:
            raise ModelError(f"Solution.{name}: a motion of several phases has none; {remedy}")

    # --- verification ---------------------------------------------------------------------
    @symbolic
    def verify(self, reltol: float = 1e-10, abstol: float = 1e-10) -> Verification:
        """Simulate by IDAS from the first state with the input polynomials of the solution.

        Through several phases: joints that close do so when the simulation finds their rows at zero, in the planned
        direction of approach and nearest to the planned time, and what follows is moved by the difference; what only
        opens does so after the planned duration.
        """
        return Replay(self, reltol, abstol).run()

    @symbolic
    def simulate(self, *, initial: Any = None, parameters: Any = None, **settings: Any) -> Trajectory:
        """Simulate the mechanism with the inputs of the solution, from other starts or with other parameters."""
        self._refuse_phases("simulate", "verify() simulates it, and simulate(events=…) goes on through changes")
        taken = {"times", "duration", "inputs"} & set(settings)
        if taken:
            raise ModelError(f"Solution.simulate: {', '.join(sorted(taken))} are those of the solution")
        part = self.phases[0]
        eom, mechanism = part.phase.equations, part.phase.mechanism
        values = dict(zip(mechanism.parameters, part.numeric.p, strict=True)) | dict(
            pairs_of(parameters, "parameters=")
        )
        if initial is None:
            initial = self.trajectory.initial
            numeric = NumericEquations(eom, parameter_vector(eom, values))
            name, missed = numeric.largest_miss(0.0, initial.q, initial.v, initial.z)
            if abs(missed) > MET:
                raise ConditionError(
                    f"simulate: with these parameters the first state of the solution does not meet {name}, by "
                    f"{missed:.3g}; give initial= as conditions, such as those of the problem"
                )
        return simulate(mechanism, self.mesh, initial=initial, inputs=self.inputs, parameters=values, **settings)

    @symbolic
    def feedback(self, weights: Any = None, final: Any = None, *, state: Sequence[Any] | None = None) -> LinearFeedback:
        """Return the linear feedback that keeps a motion near the optimum: ``u = u*(t) - K(t) (x - x*(t))``.

        The states x are independent positions, their rates and first-order states. With the motion linearised along
        the optimum, ``dx/dt = A x + B u``, the gains are those of least cost of small changes, by the Riccati equation

            ``-dS/dt = S A + A^T S + Q - (S B + N) R^-1 (B^T S + N^T)``,  ``K = R^-1 (B^T S + N^T)``.

        Limits take no part in it. After the end of the optimum the law is that of its end.

        Parameters
        ----------
        weights : mapping of expression to float, or list of pairs, optional
            Weights of the squares of changes, integrated over time: ``{cart.x: 10, force: 0.1}``; each free input needs
            one. By default the curvature of the running cost of the problem.
        final : mapping of expression to float, or list of pairs, optional
            Weights of the squares of changes at the end. By default the curvature of the terminal cost; none with
            `weights`.
        state : sequence of expressions, optional
            Positions that describe the motion, as many as there are degrees of freedom; by default coordinates of the
            bodies.

        Returns
        -------
        LinearFeedback
            For ``simulate(mechanism, times, initial=…, inputs=feedback)``; ``.gains(times)``.

        Raises
        ------
        ModelError
            For several phases, and a cost that does not grow with the square of each input.

        References
        ----------
        Bryson and Ho, *Applied Optimal Control*, 1975, section 6.

        Examples
        --------
        >>> feedback = solution.feedback({cart.x: 10, bob.phi: 50, force: 0.1})  # doctest: +SKIP
        >>> motion = mbd.simulate(system, times, initial=state, inputs=feedback)  # doctest: +SKIP
        """
        self._refuse_phases("feedback", "linearise each phase by a problem of its own")
        return linear_feedback(self, self.phases[0], weights, final, state)

    @symbolic
    def stability(self) -> Stability:
        """Return the Floquet multipliers of a periodic motion, across its impacts.

        The start is disturbed as constraints and initial conditions allow; inputs stay as they are. What closes, and
        final conditions that are equalities, decide when phases end, and free parameters where they do; the boundary
        conditions give the start of the next period. Where durations are free, time begins anew with it. To the order
        of the transcription the result is that of the motion itself: refine the mesh.

        Returns
        -------
        Stability
            ``.multipliers``, ``.matrix`` (monodromy), ``.is_stable``.

        Raises
        ------
        ModelError
            If the boundary conditions do not decide the next start, or hold more than it.

        Warns
        -----
        MechanismWarning
            If mechanisms depend on time, and durations are free.

        References
        ----------
        Goswami, Espiau, Keramane, "Limit cycles and their stability in a passive bipedal gait", ICRA 1996.
        """
        return ReturnMap(self).stability()

    # --- accuracy -------------------------------------------------------------------------
    @cached_property
    def cost_error(self) -> float:
        """Amount by which the local errors of the motion may falsify the cost, to first order, in its unit.

        The sum over the mesh points of the costates of the states there times the local errors. Zero for
        ``"hermite-simpson"``, of which it is not known; infinite if an interval cannot be integrated again.
        """
        return error_of_mesh(self)

    # --- limits ---------------------------------------------------------------------------
    @cached_property
    @symbolic
    def costates(self) -> dict[str, np.ndarray | float]:
        """Sensitivities of the cost to limits and conditions, by label, of several phases by label and phase.

        Path limits and limits of inputs: by interval (N,), the decrease of the
        cost for one unit by which the limit is loosened, per second.
        Equalities at places: the change of the cost for one unit added to the
        right-hand side; inequalities there: its decrease for one unit by which they are loosened.
        """
        return costates(self)

    @cached_property
    @symbolic
    def active_limits(self) -> list[ActiveLimit]:
        """Limits that are active, and when; the costliest first."""
        return active_limits(self, self.costates)

    @cached_property
    @symbolic
    def soft_limits(self) -> list[SoftLimitUse]:
        """Where and by how much soft limits are passed, and what this costs; the costliest first."""
        return soft_limits(self)

    @cached_property
    @symbolic
    def limit_excess(self) -> dict[str, float]:
        """Amounts by which limits are passed between the points at which they are held, by label, in their own unit."""
        return limit_excess(self)

    # --- files ----------------------------------------------------------------------------
    def save(self, path: str | Path) -> None:
        """Write the solution to a ``.npz`` file; ``read_solution(path, problem)`` reads it."""
        save(self, path)

    def __repr__(self) -> str:
        s = self.statistics
        text = (
            f"Solution: cost {self.cost:.8g}, duration {self.duration:.6g} s, "
            f"{interval_count(self.meshes)} intervals, "
            f"{s.iterations} iterations, {s.seconds:.3g} s ({s.status})"
        )
        text += f", kinks rounded by {s.rounding:g} of their size" if s.rounding else ""
        text += f"; {s.agreement}" if s.agreement else ""
        return text + "".join(f"\n  {symbol.label} = {value:.6g}" for symbol, value in self.parameters.items())

    def _repr_html_(self) -> str:
        """Cost, duration, free parameters and effort as a table, for notebooks."""
        s = self.statistics
        rows = [("cost", f"{self.cost:.8g}"), ("duration", f"{self.duration:.6g} s")]
        rows += [(symbol.label, f"{value:.6g}") for symbol, value in self.parameters.items()]
        rows.append(("mesh intervals", str(interval_count(self.meshes))))
        rows += [("starts", s.agreement)] if s.agreement else []
        rows.append(("solver", f"{s.iterations} iterations, {s.seconds:.3g} s ({s.status})"))
        return html_table("Solution", rows)


@dataclass(frozen=True)
class Shifted:
    """A solution from a later time on, as a guess; made by :meth:`Solution.shifted`."""

    solution: Solution
    time: float

    def as_guess(self, problem: OptimalControlProblem) -> Guess:
        """The later part of the motion as a guess for the same problem, with multipliers of the later intervals."""
        solution, guess = self.solution, self.solution.as_guess(problem)
        phases = tuple(self._later(phase) for phase in guess.phases)
        moved = replace(guess, phases=phases, iterate=None, description=f"solution, {self.time:g} s later")
        program, answer, times = solution.program, solution.answer, solution.phases[0].mesh_times
        after = (times[1:] + times[:-1]) / 2 + self.time  # middles of the intervals
        later = np.clip(np.searchsorted(times, after) - 1, 0, times.size - 2)
        variables, rows = program.later_places(later, after > times[-1])
        within = after < times[-1]
        if np.allclose(times[later[within]], times[:-1][within] + self.time):
            x = (solution.variables / program.scale)[variables]
        else:
            x = moved.variables(program, solution.meshes)
        iterate = Iterate(program, solution.meshes, x, answer.lam_x[variables], answer.lam_g[rows])
        return replace(moved, iterate=iterate)

    def _later(self, phase: PhaseGuess) -> PhaseGuess:
        last = float(phase.segment_times[-1])

        def sample(wanted: np.ndarray) -> dict[str, np.ndarray]:
            return phase.sample(np.clip(wanted + self.time, 0.0, last))

        return replace(phase, sample=sample)


@symbolic
def read_solution(path: str | Path, problem: OptimalControlProblem) -> Solution:
    """Read what ``Solution.save`` wrote.

    Parameters
    ----------
    path : str or Path
        The file.
    problem : OptimalControlProblem
        Problem that it solves: the rows of its program must be the same.

    Returns
    -------
    Solution
        As complete as the one that was saved.

    Raises
    ------
    FileError
        For what is not such a file, and for a solution of another problem.
    """
    return Solution(*restored(path, problem))
