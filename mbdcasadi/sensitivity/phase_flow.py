"""The motion in one mechanism between two changes, with its variations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..arguments.values import pairs_of, pairs_with
from ..assembly.setup import Setup
from ..errors import ModelError, SimulationError
from ..integrators import Integrator
from ..integrators.failures import reason_of
from ..model.mechanism import Mechanism
from ..model.symbols import place_of
from ..numerics.lazy import cached_property
from ..results.state import State
from ..results.trajectory import Trajectory
from .derivatives import Compiled, lengths_of
from .differentiable_motion import DifferentiableMotion
from .switched_motion import SmoothPhase, smooth_phases

#: Length of the stretch in which a motion that ends just after a change is evaluated, as a share of the whole.
MOMENT = 1e-6


@dataclass(frozen=True)
class Directions:
    """Variations of the start, of parameters and of inputs, in k directions.

    Attributes
    ----------
    start : numpy.ndarray
        Of ``(q, v, z)`` (n_x, k).
    parameters : dict of Parameter to numpy.ndarray
        Rows (k,) of the parameters that vary.
    inputs : dict of Input to numpy.ndarray
        Rows (k,) of inputs that are numbers.
    """

    start: np.ndarray
    parameters: dict[Any, np.ndarray]
    inputs: dict[Any, np.ndarray]

    @property
    def count(self) -> int:
        """Number of directions."""
        return int(self.start.shape[1])


@dataclass(frozen=True, eq=False)
class VariedMotion:
    """A motion that was simulated, and what of it varies.

    Attributes
    ----------
    motion : Trajectory
        The motion, which knows the order and the instants of its changes.
    times : numpy.ndarray
        Output times, s.
    outputs : sequence of casadi.SX
        Expressions in any of the mechanisms.
    directions : Directions
        Directions of variation.
    integrator : Integrator
        Method and tolerances.
    inputs : mapping, optional
        Inputs of all mechanisms: numbers and expressions.
    """

    motion: Trajectory
    times: np.ndarray
    outputs: Sequence[ca.SX]
    directions: Directions
    integrator: Integrator
    inputs: Any = None

    @cached_property
    def phases(self) -> list[SmoothPhase]:
        """Its phases with smooth equations."""
        return smooth_phases(self.motion)

    def grid(self, number: int) -> np.ndarray:
        """Output times within a phase, with its ends; of one that ends just after a change a moment is taken."""
        part = self.phases[number].motion
        first, last = float(part.t[0]), float(part.t[-1])
        apart = 1e-9 * max(last - first, float(np.spacing(abs(last))))
        inside = self.times[(self.times > first + apart) & (self.times < last - apart)]
        span = float(self.motion.t[-1] - self.motion.t[0]) or 1.0
        return np.unique(np.r_[first, inside, last if last > first else first + MOMENT * span])


@dataclass(frozen=True, eq=False)
class VariedState:
    """A state at one instant, and its variations in k directions.

    Attributes
    ----------
    time : float
        s.
    x : numpy.ndarray
        ``(q, v, z)`` (n_x,).
    dt, dx, dp : numpy.ndarray
        Variations of the instant (k,), of the state (n_x, k), and of the parameters of its mechanism (n_p, k).
    """

    time: float
    x: np.ndarray
    dt: np.ndarray
    dx: np.ndarray
    dp: np.ndarray


class PhaseFlow:
    """The motion in one mechanism between two changes, and expressions at single instants of it.

    Parameters
    ----------
    varied : VariedMotion
        The whole motion.
    number : int
        Number of the phase.
    ending : casadi.SX, optional
        Expression of the event that ends it.

    Attributes
    ----------
    grid : numpy.ndarray
        Output times from its start to its end, s.
    x0 : numpy.ndarray
        Start ``(q, v, z)``.
    p : numpy.ndarray
        Values of the parameters of the mechanism.
    rows : numpy.ndarray
        True for outputs that the mechanism has (n_y,).
    """

    def __init__(self, varied: VariedMotion, number: int, ending: ca.SX | None = None):
        phase = varied.phases[number]
        part = phase.motion
        self.part, self.mechanism, self.eom = part, part.mechanism, part.equations
        self.grid, whole, directions = varied.grid(number), varied.motion.mechanism, varied.directions
        known_inputs = pairs_with(self.mechanism.inputs, pairs_of(varied.inputs, "inputs="))
        first = part.initial
        start = State(self.mechanism, *first.arguments)  # in the symbols of its own mechanism
        setup = Setup(self.mechanism, "sensitivities", times=self.grid, initial=start, inputs=known_inputs)
        if setup.signals.is_sampled:
            raise ModelError(
                "sensitivities: through changes of the mechanism inputs= takes numbers and expressions, no samples"
            )
        self._directions, self._ending, self._follows = directions, ending, number > 0
        places = [k for k, x in enumerate(self.mechanism.parameters) if x in directions.parameters]
        self.motion = DifferentiableMotion(setup, varied.integrator, varied=places, ending=ending)
        self.p = setup.p
        self.x0 = np.r_[first.q, first.v, first.z]
        outputs = varied.outputs
        shown = self._with_absent_parameters([phase.shown(e, whole) for e in outputs], whole, phase.parameters)
        known = [self.eom.contains(e) for e in shown]
        self._shown = [e for e, has in zip(shown, known, strict=True) if has]
        self.rows = np.repeat(np.array(known, bool), [e.numel() for e in outputs])
        self._dlevels = np.zeros((self.motion.values.levels.size, directions.count))
        for k, place in setup.signals.level_places.items():
            self._dlevels[place] = directions.inputs.get(self.mechanism.inputs[k], 0.0)

    def _with_absent_parameters(
        self, expressions: Sequence[ca.SX], whole: Mechanism, values: np.ndarray
    ) -> list[ca.SX]:
        """Expressions with the values of parameters that only other mechanisms have."""
        absent = [k for k, x in enumerate(whole.parameters) if place_of(x, self.mechanism.parameters) is None]
        symbols = ca.vertcat(ca.SX(0, 1), *[whole.parameters[k] for k in absent])
        varied = [whole.parameters[k] for k in absent if whole.parameters[k] in self._directions.parameters]
        by_varied = ca.jacobian(ca.vertcat(ca.SX(0, 1), *map(ca.vec, expressions)), ca.vertcat(ca.SX(0, 1), *varied))
        if by_varied.nnz():
            name = next(x.label for x in varied if ca.depends_on(ca.vertcat(*map(ca.vec, expressions)), x))
            raise ModelError(
                f"sensitivities: an output contains parameter '{name}', by which it is differentiated, and which not "
                "all mechanisms of the motion have; list it in parameters= of each"
            )
        return (
            [ca.substitute(e, symbols, ca.SX(ca.DM(values[absent]))) for e in expressions] if absent else [*expressions]
        )

    def dp(self, given: dict[Any, np.ndarray]) -> np.ndarray:
        """Variations of the parameters of the mechanism (n_p, k)."""
        rows = np.zeros((self.p.size, self._directions.count))
        for k, symbol in enumerate(self.mechanism.parameters):
            rows[k] = given.get(symbol, 0.0)
        return rows

    def run(self, dx0: np.ndarray, dp: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Outputs (n_t, n_y) with variations (n_t, n_y, k), and the last state with its own."""
        motion, values, k = self.motion, self.motion.values, dx0.shape[1]
        course = motion.course(self.x0, values)
        states_of = Compiled(motion.motion(course))
        known = [self.x0, *values, *course.arguments]
        results = self._integrated(states_of, *known)
        states = results[0].full()
        if not motion.reached(states):
            raise SimulationError("sensitivities: the integrator stopped within a phase", time=float(self.part.t[0]))
        lengths = lengths_of(np.vstack([dp, self._dlevels]), np.r_[self.p, values.levels])
        seeds = [part * lengths for part in (dx0, dp, self._dlevels)]
        moved = self._integrated(states_of.changes, known, results, *seeds)
        outputs, given = Compiled(motion.outputs(self._shown)), [results[0], *values]
        y = outputs(*given)
        dy = outputs.changes(given, [y], moved[0], *seeds[1:])
        n_t, n_y = states.shape[1], int(np.sum(self.rows))
        shown, slopes = np.full((n_t, self.rows.size), np.nan), np.full((n_t, self.rows.size, k), np.nan)
        shown[:, self.rows] = y.full().T
        slopes[:, self.rows] = dy.full().reshape(n_y, k, n_t).transpose(2, 0, 1) / lengths
        last, dlast = results[1].full().ravel(), moved[1].full() / lengths
        if motion.held.system.size:  # at a border the switches of themselves are on either side
            none = np.zeros(k)
            if self._follows:
                here = VariedState(float(self.grid[0]), self.x0, none, dx0, dp)
                shown[0], slopes[0] = self.outputs_at(here, starts=True)
            if self._ending is not None:
                shown[-1], slopes[-1] = self.outputs_at(VariedState(float(self.grid[-1]), last, none, dlast, dp))
        return shown, slopes, last, dlast

    def _integrated(self, function: Callable[..., Any], *arguments: Any) -> Any:
        try:
            return function(*arguments)
        except RuntimeError as error:
            raise SimulationError(
                f"the derivatives of the motion from t = {self.part.t[0]:.6g} s on stopped: {reason_of(error)}; take "
                "larger reltol= and abstol=, or another method=",
                time=float(self.part.t[0]),
            ) from None

    # --- at its ends ---------------------------------------------------------------------------
    def at(self, expression: ca.SX, here: VariedState, *, starts: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """An expression at the state at the end or the start, and its variations (n, k)."""
        function, known = self._function(ca.vec(expression)), self._at(here.time, here.x, starts)
        value = function(*known)
        sides = np.zeros((known[2].size - self.p.size, here.dt.size))
        change = function.changes(known, [value], here.dt[None, :], here.dx, np.vstack([here.dp, sides]), self._dlevels)
        return value.full().ravel(), change.full()

    def outputs_at(self, here: VariedState, *, starts: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """All outputs at the state at the end or the start (n_y,), and their variations (n_y, k)."""
        values, slopes = np.full(self.rows.size, np.nan), np.full((self.rows.size, here.dt.size), np.nan)
        if self._shown:
            stacked = ca.vertcat(*[ca.vec(e) for e in self._shown])
            values[self.rows], slopes[self.rows] = self.at(stacked, here, starts=starts)
        return values, slopes

    def rates(self, time: float, x: np.ndarray, *, starts: bool = False) -> np.ndarray:
        """Rates of ``(q, v, z)`` at the end or the start."""
        eom = self.motion.held.system.numeric.eom
        function = self._function(ca.vertcat(eom.v, eom.a, eom.z_rate))
        return np.asarray(function(*self._at(time, x, starts)).full().ravel())

    def rate_of(self, expression: ca.SX, time: float, x: np.ndarray) -> float:
        """Rate of an expression along the motion at its end."""
        function, known = self._function(expression), self._at(time, x, starts=False)
        rates = self.rates(time, x)[:, None]
        return float(function.changes(known, [function(*known)], np.ones((1, 1)), rates))

    def _function(self, expression: ca.SX) -> Compiled:
        """An expression at one output, under the switches that are held."""
        return Compiled(self.motion.at_one_output(expression, held=True))

    def _at(self, time: float, x: np.ndarray, starts: bool) -> list[Any]:
        """Arguments of a function at one output, with the sides of the switches there; there are no samples."""
        course = self.motion.course(self.x0, self.motion.values)
        sides = course.sides if starts or not course.cuts else course.cuts[-1].sides
        return [time, x, np.r_[self.p, sides], self.motion.values.levels, np.zeros((0, 1))]
