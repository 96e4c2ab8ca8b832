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
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from ..errors import SimulationError
from ..numerics.console import Interruption, quiet
from ..numerics.evaluation import Evaluator, by_buffers
from ..numerics.lookup import with_tables
from ..numerics.tolerances import MET
from .base import Integrator
from .failures import flag_of, last_line
from .native.stretch import ExplicitSystem

#: Steps that an integrator may take between two outputs, at first and at most.
FEW_STEPS, MAX_STEPS = 5_000, 200_000
TOO_MANY_STEPS = "IDA_TOO_MUCH_WORK"
#: Steps that it may take in a part of what failed: before a lock-up steps become ever shorter, and no number is enough.
PART_STEPS = 500
#: Smallest part, as a share of the time between two outputs: the time of a failure is known to this.
SMALLEST_PART = 2.0**-16
#: Size of integrals, as a fraction of the tolerance, below which no integrator adapts its steps to them.
QUADRATURE_SIZE = 1e-9
#: Compiled functions, one for each pattern of outputs, that an integrator keeps.
KEPT = 24
#: Distance from consistent unknowns at which the search of IDAS for them begins, relative and absolute. Its tolerance
#: is relative to where it begins: from zeros it takes rounding for a failure, and so it does from the unknowns
#: themselves, whose error no step reduces. Under friction that is close to holding it failed from 1e-6, not from 1e-5
#: to 1e-1.
PERTURBATION, LEAST_PERTURBATION = 1e-3, 1e-6


def near(z: np.ndarray) -> np.ndarray:
    """Return unknowns near consistent ones, from which an integrator finds these."""
    return z + LEAST_PERTURBATION + PERTURBATION * np.abs(z)


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

    def with_tables(self) -> Dae:
        """Return the system with tables in the place of splines."""
        if not isinstance(self.x, ca.SX):
            return self
        clock, results = self.clock, ca.cse([ca.densify(part) for part in (self.ode, self.alg, self.quad)])
        symbols = [clock.tau, clock.start, clock.length, self.x, self.z, self.p, self.u]
        function = ca.Function("system", symbols, results)
        looked_up = with_tables(function)
        if looked_up is function:
            ode, alg, quad = results
            return replace(self, ode=ode, alg=alg, quad=quad)
        clock = Clock(ca.MX)
        x, z, p, u = (ca.MX.sym("symbols", part.numel()) for part in symbols[3:])
        ode, alg, quad = looked_up(clock.tau, clock.start, clock.length, x, z, p, u)
        return Dae(clock, x=x, z=z, p=p, u=u, ode=ode, alg=alg, quad=quad, part=self.part)


@dataclass(frozen=True)
class Forms:
    """The equations of a run in the forms that methods take, which are made when they are asked for.

    Attributes
    ----------
    equations : Equations
        The equations.
    input : casadi.Function
        ``(t, q, v, z, p, levels, channel) -> u``.
    integrands : casadi.SX
        What is integrated along the motion, in the symbols of the equations.
    forward : callable
        Return the function ``(t, q, v, z, u, p) -> (a, lam)``.
    explicit : callable
        Return the explicit system with its slopes, of bodies that no joint holds.
    """

    equations: Any
    input: ca.Function
    integrands: ca.SX
    forward: Callable[[], ca.Function]
    explicit: Callable[[], ExplicitSystem]


class IntegrationFailure(Exception):
    """An integrator stopped.

    Attributes
    ----------
    flag : str
        The integrator's message.
    x, z, integrals : numpy.ndarray
        States, algebraic unknowns and integrals at the outputs that were reached, by row.
    last, last_x : float and numpy.ndarray, or None
        Time and state that were reached last.
    """

    def __init__(
        self,
        flag: str,
        x: np.ndarray,
        z: np.ndarray,
        last: float | None = None,
        last_x: np.ndarray | None = None,
        integrals: np.ndarray | None = None,
    ):
        super().__init__(flag)
        self.flag = flag
        self.x, self.z, self.integrals = x, z, np.zeros((0, 0)) if integrals is None else integrals
        self.last, self.last_x = last, last_x


@dataclass(frozen=True)
class InitialValueProblem:
    """A state at one time, and the later times at which the motion from it is wanted.

    Attributes
    ----------
    x, z : numpy.ndarray
        State and consistent algebraic unknowns at `start`.
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
        return replace(self, x=x, z=z, start=start, times=self.times[part], u=u, stops=self.stops[part])


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

    #: states that are integrated, if they are not all
    part: PartOfState | None = None
    #: True if its functions have derivatives forward alone
    only_forward: ClassVar[bool] = False
    #: True if the states that it returns are on the constraints
    on_constraints: ClassVar[bool] = False

    def __init__(self, dae: Dae, integrator: Integrator):
        self.part, self.integrator = dae.part, integrator
        dae = dae.with_tables()
        clock, length = type(dae.x).sym("clock"), dae.clock.length
        self._system = {
            "t": dae.clock.tau,
            "x": ca.vertcat(dae.x, clock),
            "p": ca.vertcat(dae.clock.start, length, dae.p),
            "ode": ca.vertcat(length * dae.ode, 1),
        }
        if dae.z.numel():
            self._system |= {"z": dae.z, "alg": dae.alg}
        stop = [type(dae.x).sym("stop")] if integrator.stops_by_input else []
        self._u = ca.vertcat(dae.u, *stop)
        if self._u.numel():
            self._system["u"] = self._u
        self._quad_scale = QUADRATURE_SIZE * integrator.abstol if integrator.quadratures_in_error_test else 1.0
        if dae.quad.numel():
            self._system["quad"] = self._quad_scale * length * dae.quad
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
            if not ca.has_integrator(self.integrator.plugin):
                raise SimulationError(
                    f"method '{self.integrator.name}' names plugin '{self.integrator.plugin}', which is no integrator "
                    "of CasADi; a method in code of its own derives from SteppingMethod"
                ) from None
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
    def advance(
        self, problem: InitialValueProblem, interruption: Interruption | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Integrate from a state to each of some times; what fails is repeated in parts, halved where they fail.

        Parameters
        ----------
        problem : InitialValueProblem
            State, times and parameters.
        interruption : Interruption, optional
            Notices Ctrl-C, which inside an integrator comes back as a failure like others: nothing is repeated then.

        Returns
        -------
        x, z : numpy.ndarray
            (k, n_x), (k, n_z).

        Raises
        ------
        IntegrationFailure
            With what was reached, to :data:`SMALLEST_PART` of an output interval.
        """
        outcome = self._attempt(problem, FEW_STEPS)
        if not isinstance(outcome, str):
            return outcome
        way = _Way(problem, interruption)
        flag = self._in_halves(way, problem.times.size, float(problem.times[-1]), outcome)
        self.integrals = way.integrals
        if flag:
            raise IntegrationFailure(flag, way.states, way.algebraic, way.time, way.x, way.integrals)
        return way.states, way.algebraic

    def advance_as_whole(self, problem: InitialValueProblem, steps: int) -> tuple[np.ndarray, np.ndarray]:
        """Integrate as :meth:`advance` does, with that many steps between two outputs and no repetition in parts."""
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
        x = problem.x if self.part is None else problem.x[self.part.places]
        arguments: dict[str, Any] = {"x0": np.append(x, 0.0), "p": np.concatenate([[start, length], problem.p])}
        arguments |= {"z0": near(problem.z)} if problem.z.size else {}
        arguments |= {"u": inputs["u"]} if inputs["u"] is not None else {}
        try:
            with quiet():
                (states, algebraic, integrals), stats = by_buffers(function, arguments, ("xf", "zf", "qf"))
        except RuntimeError as error:
            return flag_of(error)
        self.steps = int(stats.get("nsteps", stats.get("n_steps", 0)))
        self.all_steps += self.steps
        on_time = np.abs(states[:, -1] - fractions) <= MET
        if not np.all(on_time) or not np.all(np.isfinite(states)):
            return "the step size became too small, or a value was not finite"
        self.integrals = integrals / self._quad_scale
        found = states[:, :-1] if self._whole is None else self._whole.rows(states[:, :-1], problem.p)[0]
        return found, algebraic

    def _in_halves(self, way: _Way, last: int, end: float, flag: str) -> str:
        """Go on over a part that failed, each half in halves if it fails; return the message of what ends it, or "".

        Inside an output interval only a part that took too many steps is passed; others lead to where they fail.
        """
        first, times, middle = way.count, way.problem.times, (last, (way.time + end) / 2)
        if way.interruption is not None and way.interruption.requested:
            return flag
        if last - first > 1:
            count = first + (last - first) // 2
            middle = count, float(times[count - 1])
        elif end - way.time <= SMALLEST_PART * (times[first] - way.begun) or way.steps > MAX_STEPS:
            return flag
        # a start of its own at any place would carry a method through chattering, step by step
        through = last - first > 1 or flag == TOO_MANY_STEPS
        for half in (middle, (last, end)):
            outcome = self._attempt(way.part(*half), PART_STEPS) if through or half is middle else flag
            if isinstance(outcome, str):
                flag = self._in_halves(way, *half, outcome)
                if flag:
                    return flag
            else:
                way.add(*half, *outcome, self.integrals, self.steps)
        return ""


class _Way:
    """What was reached of a piece that is integrated in parts.

    Attributes
    ----------
    time, x, z
        Where it is, and state and algebraic unknowns there.
    count : int
        Outputs that were reached.
    begun : float
        Time of the last of them, or of the start, s.
    steps : int
        Steps since then.
    states, algebraic, integrals : numpy.ndarray
        At these outputs, by row; the integrals are those since the start.
    """

    def __init__(self, problem: InitialValueProblem, interruption: Interruption | None):
        self.problem, self.interruption, self.count, self.steps = problem, interruption, 0, 0
        self.x, self.z, self.time, self.begun = problem.x, problem.z, problem.start, problem.start
        self.states, self.algebraic = np.zeros((0, problem.x.size)), np.zeros((0, problem.z.size))
        self._integrals: list[np.ndarray] = []
        self._integral: Any = 0.0

    @property
    def integrals(self) -> np.ndarray:
        return np.vstack(self._integrals) if self._integrals else np.zeros((0, 0))

    def part(self, last: int, end: float) -> InitialValueProblem:
        """The problem from here to a time, not after the last of some outputs."""
        part = self.problem.after(self.x, self.z, self.time, slice(self.count, last))
        return replace(part, times=np.append(part.times[:-1], end))

    def add(self, last: int, end: float, x: np.ndarray, z: np.ndarray, integrals: np.ndarray, steps: int) -> None:
        """Take the results of a part."""
        integrals = self._integral + integrals
        self.time, self.x, self.z, self._integral = end, x[-1], z[-1], integrals[-1]
        times = self.problem.times[self.count : last]
        reached = int(np.count_nonzero(times <= end))
        self.steps += steps
        if reached:
            self.states = np.vstack([self.states, x[:reached]])
            self.algebraic = np.vstack([self.algebraic, z[:reached]])
            self._integrals.append(integrals[:reached])
            self.count, self.begun, self.steps = self.count + reached, float(times[reached - 1]), 0
