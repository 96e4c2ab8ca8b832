"""Integration of differential-algebraic equations over pieces of an output grid.

CasADi's integrators return all outputs or none. Running them piece by piece
gives progress, cancelling and the part of a run that was finished; a piece that
fails is repeated output by output to keep the outputs that can be reached.

Every piece is integrated over ``0 <= tau <= 1`` with ``t = start + length tau``,
so that one compiled function serves pieces of any length, and outputs however
close to each other are outputs.
"""

from __future__ import annotations

from collections import OrderedDict
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from ..errors import SimulationError
from ..numerics.console import quiet
from ..numerics.evaluation import Evaluator, by_buffers
from .base import Integrator
from .failures import flag_of, last_line

#: Steps that an integrator may take between two outputs, at first and at most.
FEW_STEPS, MAX_STEPS = 5_000, 200_000
#: Bisections by which the time of a failure is narrowed down.
BISECTIONS = 16
#: Size of integrals, as a fraction of the tolerance, below which no integrator adapts its steps to them.
QUADRATURE_SIZE = 1e-9
#: Compiled functions, one for each pattern of outputs, that an integrator keeps.
KEPT = 24
#: Difference of the clock from the time of an output, in lengths of the piece, from which the integrator has stopped.
CLOCK_TOLERANCE = 1e-6


class Clock:
    """Time over a piece of a run as an expression.

    Attributes
    ----------
    tau, start, length : casadi.SX or casadi.MX
        Fraction of the piece that has passed, and its start and length, s.
    t : casadi.SX or casadi.MX
        ``start + length tau``.
    """

    def __init__(self, kind: Any = ca.SX):
        self.tau, self.start, self.length = kind.sym("tau"), kind.sym("start"), kind.sym("length")
        self.t = self.start + self.length * self.tau


@dataclass(frozen=True)
class PartOfState:
    """States that are integrated, of a larger state that they give.

    Attributes
    ----------
    places, unknowns : list of int
        Of the integrated states among all, and of the algebraic unknowns among all accelerations and multipliers.
    whole : casadi.Function
        ``(x, p) ->`` all states.
    """

    places: list[int]
    unknowns: list[int]
    whole: ca.Function


@dataclass(frozen=True)
class Dae:
    """A semi-explicit index-1 system over a piece.

    Attributes
    ----------
    clock : Clock
        Its time.
    x, z, p, u : casadi.SX or casadi.MX
        States, algebraic unknowns, parameters, values that change from one output interval to the next.
    ode, alg : casadi.SX or casadi.MX
        Rates by time, and residuals.
    quad : casadi.SX or casadi.MX
        Rates of integrals that take no part in the error test.
    part : PartOfState, optional
        The states `x` among those that an :class:`InitialValueProblem` begins with, if they are not all.
    """

    clock: Clock
    x: Any
    z: Any
    p: Any
    u: Any
    ode: Any
    alg: Any
    quad: Any = field(default_factory=lambda: ca.SX(0, 1))
    part: PartOfState | None = None


class IntegrationFailure(Exception):
    """An integrator stopped; carries what it had reached and the integrator's message.

    Attributes
    ----------
    is_overcome : bool
        True if the repetition in parts reached all outputs.
    """

    is_overcome = False

    def __init__(
        self, flag: str, x: np.ndarray, z: np.ndarray, last: float | None = None, last_x: np.ndarray | None = None
    ):
        super().__init__(flag)
        self.flag = flag
        self.x, self.z = x, z
        self.last, self.last_x = last, last_x


@dataclass(frozen=True)
class InitialValueProblem:
    """A state at one time, and the later times at which the motion from it is wanted.

    Attributes
    ----------
    x, z : numpy.ndarray
        State and estimate of the algebraic unknowns at `start`.
    start : float
        Time of the state, s.
    times : numpy.ndarray
        Outputs (k,), later than `start`.
    p : numpy.ndarray
        Parameters.
    u : numpy.ndarray, optional
        Values of inputs by interval (n_u, k).
    stops : numpy.ndarray of bool
        Outputs that no step may cross (k,); none by default.
    max_step : float, optional
        Longest step, s.
    """

    x: np.ndarray
    z: np.ndarray
    start: float
    times: np.ndarray
    p: np.ndarray
    u: np.ndarray | None = None
    stops: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))
    max_step: float | None = None

    def __post_init__(self) -> None:
        if not self.stops.size:
            object.__setattr__(self, "stops", np.zeros(self.times.size, bool))

    @property
    def channel(self) -> np.ndarray:
        """Values of inputs by interval (n_u, k), without rows if there are none."""
        return np.zeros((0, self.times.size)) if self.u is None else self.u

    def after(self, x: np.ndarray, z: np.ndarray, start: float, part: slice) -> InitialValueProblem:
        """The problem from a later state over some of its intervals."""
        u = None if self.u is None else self.u[:, part]
        return InitialValueProblem(x, z, start, self.times[part], self.p, u, self.stops[part], self.max_step)


class CompiledIntegrator:
    """An integrator of one system, compiled once for each pattern of outputs.

    Parameters
    ----------
    dae : Dae
        The system.
    integrator : Integrator
        Method and tolerances.

    Attributes
    ----------
    starts : int
        Number of starts.
    steps, all_steps : int
        Steps of the last call and of all, if the method counts them.
    integrals : numpy.ndarray
        Integrals at the outputs of the last call (k, n), since its start.

    Notes
    -----
    The Runge–Kutta and Rosenbrock methods of CasADi return zeros after a
    failure and no flag; a clock ``dτ/dτ = 1`` among the states reports it.
    """

    def __init__(self, dae: Dae, integrator: Integrator):
        self.dae, self.integrator = dae, integrator
        clock = type(dae.x).sym("clock")
        length = dae.clock.length
        ode, alg, quad = dae.ode, dae.alg, dae.quad
        if isinstance(dae.x, ca.SX):
            ode, alg, quad = ca.cse([ode, alg, quad])
        self._system = {
            "t": dae.clock.tau,
            "x": ca.vertcat(dae.x, clock),
            "p": ca.vertcat(dae.clock.start, length, dae.p),
            "ode": ca.vertcat(length * ode, 1),
        }
        if dae.z.numel():
            self._system |= {"z": dae.z, "alg": alg}
        stop = [type(dae.x).sym("stop")] if integrator.stops_by_input else []
        self._u = ca.vertcat(dae.u, *stop)
        if self._u.numel():
            self._system["u"] = self._u
        self._quad_scale = QUADRATURE_SIZE * integrator.abstol if integrator.quadratures_in_error_test else 1.0
        if dae.quad.numel():
            self._system["quad"] = self._quad_scale * length * quad
        self._options = integrator.plugin_options(algebraic=bool(dae.z.numel()))
        self._functions: OrderedDict[tuple[Any, ...], ca.Function] = OrderedDict()
        self._whole = None if dae.part is None else Evaluator(dae.part.whole)
        self.restart_counting()

    def restart_counting(self) -> None:
        """Count from zero, for another run."""
        self.starts = self.steps = self.all_steps = 0
        self.integrals = np.zeros((0, 0))

    # --- compiled functions --------------------------------------------------------------
    def function(
        self,
        fractions: np.ndarray,
        *,
        groups: tuple[int, ...] | None = None,
        steps: int = MAX_STEPS,
        least_steps: int = 0,
    ) -> ca.Function:
        """Return the compiled integrator ``(x0, z0, p, u, …) -> (xf, zf, qf, …)``.

        The last state is the clock, and the parameters begin with start and
        length of the piece. The last row of `u` of a method that stops by input
        changes where it is to stop.

        Parameters
        ----------
        fractions : numpy.ndarray
            Outputs as fractions of the piece, the last one 1.
        groups : tuple of int, optional
            Output intervals between two stops, of a method that does not stop by input.
        steps : int
            Steps that may be taken between two outputs.
        least_steps : int
            The step is at most the length of the piece divided by this; 0 for no limit.
        """
        fractions = np.round(fractions, 13)
        key = (fractions.tobytes(), groups, steps, least_steps)
        if key in self._functions:
            self._functions.move_to_end(key)
            return self._functions[key]
        options: dict[str, Any] = {"max_num_steps": steps} | self._options
        if least_steps:
            options["max_step_size"] = 1.0 / least_steps
        if groups is not None:
            options["control_group_size"] = list(groups)
        try:
            made = ca.integrator("motion", self.integrator.plugin, self._system, 0.0, fractions, options)
        except RuntimeError as error:
            raise SimulationError(f"method '{self.integrator.name}' refuses the options: {last_line(error)}") from None
        self._functions[key] = made
        while len(self._functions) > KEPT:
            self._functions.popitem(last=False)
        return made

    def inputs(self, u: np.ndarray | None, stops: np.ndarray, count: int) -> dict[str, Any]:
        """Arguments ``u`` and ``groups`` that make the integrator stop at some of its outputs.

        Parameters
        ----------
        u : numpy.ndarray or None
            Values by output interval (n_u, count).
        stops : numpy.ndarray of bool
            Outputs at which it must stop (count,).
        """
        if u is None and not self.integrator.stops_by_input and not stops[:-1].any():
            return {"u": None, "groups": None}
        values = np.zeros((0, count)) if u is None else u
        if self.integrator.stops_by_input:
            parity = np.cumsum(np.append(False, stops[:-1])) % 2
            return {"u": np.vstack([values, parity]), "groups": None}
        if values.shape[0]:  # each interval has values of its own, and the method stops at its end
            return {"u": values, "groups": None}
        ends = np.flatnonzero(np.r_[stops[:-1], True]) + 1
        return {"u": None, "groups": tuple(np.diff(ends, prepend=0).tolist()) if ends.size > 1 else None}

    def least_steps(self, length: float, max_step: float | None) -> int:
        """Least number of steps over a piece, by the longest step that is allowed; 0 for no limit."""
        return int(np.ceil(length / self.integrator.longest_step(max_step) * (1 - 1e-9)))

    # --- integrating -----------------------------------------------------------------------
    def advance(self, problem: InitialValueProblem, steps: int = MAX_STEPS) -> tuple[np.ndarray, np.ndarray]:
        """Integrate from a state to each of some times.

        Parameters
        ----------
        problem : InitialValueProblem
            State, times and parameters.
        steps : int
            Steps that may be taken between two outputs.

        Returns
        -------
        x, z : numpy.ndarray
            (k, n_x), (k, n_z).

        Raises
        ------
        IntegrationFailure
            With nothing reached; :meth:`rescue` finds the outputs that can be reached.
        """
        outcome = self._attempt(problem, steps)
        if isinstance(outcome, str):
            raise IntegrationFailure(outcome, np.zeros((0, problem.x.size)), np.zeros((0, problem.z.size)))
        return outcome

    def _attempt(self, problem: InitialValueProblem, steps: int) -> tuple[np.ndarray, np.ndarray] | str:
        """Outputs at all times, or the integrator's message of its failure."""
        start, times = problem.start, problem.times
        length = float(times[-1] - start)
        fractions = np.append((times[:-1] - start) / length, 1.0)
        self.starts += 1
        inputs = self.inputs(problem.u, problem.stops, times.size)
        least_steps = self.least_steps(length, problem.max_step)
        function = self.function(fractions, groups=inputs["groups"], steps=steps, least_steps=least_steps)
        x = problem.x if self.dae.part is None else problem.x[self.dae.part.places]
        arguments: dict[str, Any] = {"x0": np.append(x, 0.0), "p": np.concatenate([[start, length], problem.p])}
        arguments |= {"z0": problem.z} if problem.z.size else {}
        arguments |= {"u": inputs["u"]} if inputs["u"] is not None else {}
        try:
            with quiet():
                (states, algebraic, integrals), stats = by_buffers(function, arguments, ("xf", "zf", "qf"))
        except RuntimeError as error:
            return flag_of(error)
        self.steps = int(stats.get("nsteps", stats.get("n_steps", 0)))
        self.all_steps += self.steps
        on_time = np.abs(states[:, -1] - fractions) <= CLOCK_TOLERANCE
        if not np.all(on_time) or not np.all(np.isfinite(states)):
            return "the step size became too small, or a value was not finite"
        self.integrals = integrals / self._quad_scale
        found = states[:, :-1] if self._whole is None else self._whole.rows(states[:, :-1], problem.p)[0]
        return found, algebraic

    def reach(self, problem: InitialValueProblem, flag: str) -> IntegrationFailure:
        """Repeat a piece that failed in parts of it, halved where they fail: the failure with the outputs reached.

        The integrals are those of all parts.
        """
        x, z, start, times = problem.x, problem.z, problem.start, problem.times
        states, algebraic = np.zeros((0, x.size)), np.zeros((0, z.size))
        integrals: list[np.ndarray] = []
        first, count = 0, max(times.size // 2, 1)
        while first < times.size:
            part = slice(first, first + count)
            outcome = self._attempt(problem.after(x, z, start, part), FEW_STEPS)
            if isinstance(outcome, str):
                flag = outcome
                if count == 1:
                    break
                count //= 2
                continue
            states, algebraic = np.vstack([states, outcome[0]]), np.vstack([algebraic, outcome[1]])
            integrals.append(self.integrals + (integrals[-1][-1] if integrals else 0.0))
            x, z, start = states[-1], algebraic[-1], float(times[part][-1])
            first += times[part].size
        failure = IntegrationFailure(flag, states, algebraic)
        failure.is_overcome = first == times.size
        self.integrals = np.vstack(integrals) if integrals else np.zeros((0, 0))
        return failure

    def rescue(self, problem: InitialValueProblem, flag: str) -> IntegrationFailure:
        """Repeat a piece that failed: the failure with the outputs reached, and the last state before it."""
        failure = self.reach(problem, flag)
        if failure.is_overcome:
            return failure
        k = min(len(failure.x), problem.times.size - 1)
        last = problem.x, problem.z, problem.start
        if len(failure.x):
            last = failure.x[-1], failure.z[-1], float(problem.times[len(failure.x) - 1])
        time, x = self._approach(problem.after(*last, slice(k, k + 1)))
        return IntegrationFailure(failure.flag, failure.x, failure.z, time, x)

    def _approach(self, problem: InitialValueProblem) -> tuple[float, np.ndarray]:
        """Last time in a single interval that can be reached before a failure, by bisection, and the state there."""
        x, z, low, high = problem.x, problem.z, problem.start, float(problem.times[0])
        for _ in range(BISECTIONS):
            middle = (low + high) / 2
            if not low < middle < high:
                break
            outcome = self._attempt(
                InitialValueProblem(x, z, low, np.array([middle]), problem.p, problem.u), FEW_STEPS // 5
            )
            if isinstance(outcome, str):
                high = middle
            else:
                low, x, z = middle, outcome[0][0], outcome[1][0]
        return low, x
