"""Values of the inputs during an analysis: numbers, samples, expressions, or a sampled controller."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import casadi as ca
import numpy as np

from ..equations import Equations
from ..errors import ExpressionError, ModelError, SimulationError
from ..model.cache import ExpressionKey
from ..model.geometry.splines import expression_of
from ..model.immutable import Immutable
from ..model.symbols import describe, number, place_of, role_of, symbols_of
from ..numerics.evaluation import Evaluator
from ..numerics.lazy import cached_property
from ..numerics.real import distinct, real_array
from ..numerics.tolerances import NEGLIGIBLE
from .piecewise_polynomial import PiecewisePolynomial, PolynomialFeedback
from .values import pairs_of, position_in

T = TypeVar("T")


class SampledController(Immutable):
    """A controller in plain Python that is called at the start of each period; its values are held in between.

    Parameters
    ----------
    function : callable
        ``function(time, state) -> {input: value}``; `state` is a ``State``.
        Inputs that are left out have the value of the start.
    period : float
        Sampling period, s.
    """

    def __init__(self, function: Callable[[float, Any], Any], period: float):
        if not callable(function):
            raise ModelError(f"SampledController: function must be callable, got {function!r}")
        self.function = function
        self.period = number(period, "SampledController", "period")
        if self.period <= 0:
            raise ModelError(f"SampledController: period must be positive, got {self.period}")

    @property
    def status(self) -> int | None:
        """Status of the last answer, 0 if it is what was asked for; None of a controller without any."""
        return None

    def meaning(self, status: int) -> str:
        """What a status says."""
        raise NotImplementedError


@dataclass(frozen=True, eq=False)
class Signals:
    """The inputs of an analysis as expressions.

    Attributes
    ----------
    parametrised : casadi.SX
        The inputs (n_u,) in ``t, q, v, z, p``, the channel, and the symbols of `levels` in place of the numbers
        that were given, so that compiled functions serve other numbers too.
    levels : casadi.SX
        Symbols of the inputs that are numbers.
    level_values : numpy.ndarray
        Their values.
    level_places : dict of int to int
        Position among the levels by input.
    channel : casadi.SX
        Symbols of what changes by interval: value and slope of each sampled input
        and the time from which they count; coefficients of polynomials.
    samples : dict of int to numpy.ndarray
        Samples (n_t,) by input.
    grid : numpy.ndarray
        Times of the samples.
    polynomials : dict of int to PiecewisePolynomial
        Piecewise polynomials by input.
    controller : SampledController or None
        Called between intervals; then every input is a level.
    structure : tuple
        Hashable: two with the same structure have the same `parametrised` expressions.
    """

    parametrised: ca.SX
    levels: ca.SX
    level_values: np.ndarray
    level_places: dict[int, int]
    channel: ca.SX
    samples: dict[int, np.ndarray]
    grid: np.ndarray
    polynomials: dict[int, PiecewisePolynomial]
    controller: SampledController | None
    structure: tuple[Any, ...]

    @cached_property
    def expressions(self) -> ca.SX:
        """The inputs (n_u,) in ``t, q, v, z, p`` and the channel, with the numbers that were given."""
        return ca.substitute(self.parametrised, self.levels, ca.SX(ca.DM(self.level_values)))

    @property
    def is_sampled(self) -> bool:
        """True if an input changes by intervals."""
        return bool(self.samples or self.polynomials)

    @property
    def breaks(self) -> np.ndarray:
        """Times at which inputs that are given by intervals change: samples and ends of polynomials."""
        parts = [p.breaks for p in self.polynomials.values()]
        if not self.samples and not parts:
            return np.zeros(0)
        return distinct(np.concatenate([self.grid if self.samples else np.zeros(0), *parts]))

    def at_values(self, grid: np.ndarray, levels: np.ndarray, channel: np.ndarray) -> Signals:
        """Return the inputs with other numbers, and with samples from the values of the channel over a grid."""
        samples = {}
        for row, k in enumerate(self.samples):
            values, slopes = channel[2 * row], channel[2 * row + 1]
            samples[k] = np.append(values, values[-1] + slopes[-1] * (grid[-1] - grid[-2]))
        return replace(self, level_values=levels, samples=samples, grid=grid if samples else self.grid)

    def channel_from(self, begins: np.ndarray) -> np.ndarray | None:
        """Values of the channel that hold from some times on (rows, k); None if nothing changes by interval."""
        if not self.is_sampled:
            return None
        begins = np.atleast_1d(np.asarray(begins, float))
        rows: list[np.ndarray] = []
        if self.samples:
            # a time that counts as that of a sample belongs to the interval that begins there
            slack = NEGLIGIBLE * (self.grid[-1] - self.grid[0])
            steps = np.append(np.diff(self.grid), np.inf)[: max(self.grid.size - 1, 1)]
            k = np.clip(np.searchsorted(self.grid, begins + slack, side="right") - 1, 0, steps.size - 1)
            for values in self.samples.values():
                slopes = np.diff(values, append=values[-1:])[: steps.size] / steps
                rows += [values[k], slopes[k]]
            rows.append(self.grid[k])
        for polynomial in self.polynomials.values():
            k = polynomial.interval(begins)
            rows += [*polynomial.coefficients[k].T, polynomial.breaks[k]]
        return np.vstack(rows)

    def columns_from(self, begins: np.ndarray) -> np.ndarray:
        """Values of the channel that hold from some times on, by row (k, n_channel)."""
        channel = self.channel_from(begins)
        return np.zeros((np.size(begins), 0)) if channel is None else channel.T

    def channel_over(self, grid: np.ndarray) -> np.ndarray:
        """Values of the channel in the intervals of a grid (rows, k)."""
        return self.columns_from(grid[:-1]).T

    @property
    def given_by_expressions(self) -> list[int]:
        """Positions of the inputs that are expressions, neither numbers nor samples."""
        return [k for k, kind in enumerate(self.structure) if isinstance(kind, tuple) and kind[0] == "expression"]

    def with_expressions(self, u: ca.SX) -> ca.SX:
        """Symbols of the inputs, with the expressions of those that are given by them."""
        inputs = ca.SX(u)
        for k in self.given_by_expressions:
            inputs[k] = self.expressions[k]
        return inputs

    def function(self, eom: Equations) -> ca.Function:
        """``(t, q, v, z, p, levels, channel) -> u``; made once for each structure of the inputs."""

        def make() -> ca.Function:
            arguments = [eom.t, eom.q, eom.v, eom.z, eom.p, self.levels, self.channel]
            return ca.Function("input", arguments, [ca.densify(self.parametrised)])

        return self.kept(eom, ("input",), make)

    def kept(self, eom: Equations, key: tuple[Any, ...], make: Callable[[], T], *, bounded: bool = False) -> T:
        """Return the object of a mechanism, a key and inputs of this structure; made once, as a cache has it."""

        def made() -> tuple[T, ca.SX]:
            # the expression is kept beside it: a hash in the structure is unique only while the node lives
            return make(), self.parametrised

        return eom.mechanism.cache.get_or_create((*key, self.structure), made, bounded=bounded)[0]

    def at_time(self, t: float) -> ca.SX:
        """Expressions of the inputs (n_u,) in ``q, v, z, p`` and t, with what holds by intervals taken at a time."""
        channel = self.channel_from(np.array([t]))
        return self.expressions if channel is None else ca.substitute(self.expressions, self.channel, ca.SX(channel))

    def values(
        self,
        t: Any,
        q: np.ndarray,
        v: np.ndarray,
        z: np.ndarray,
        p: np.ndarray,
        eom: Equations,
        *,
        levels: np.ndarray | None = None,
        channel: np.ndarray | None = None,
    ) -> np.ndarray:
        """Values of all inputs at states, each by row (k, n_u).

        Parameters
        ----------
        levels : numpy.ndarray, optional
            Values of the levels; those that were given if left out.
        channel : numpy.ndarray, optional
            Values in the interval of each state (rows, k); by default those from its time on.
        """
        if not self.structure:
            return np.zeros((np.size(t), 0))
        times = np.atleast_1d(np.asarray(t, float))
        evaluator = self.kept(eom, ("inputs",), lambda: Evaluator(self.function(eom)))
        level_values = self.level_values if levels is None else levels
        rows = self.columns_from(times) if channel is None else channel.T
        return evaluator.rows(times[:, None], q, v, z, p, level_values, rows)[0]


@dataclass
class _Reader:
    """Signals that are being read, input by input."""

    eom: Equations
    times: np.ndarray | None
    expressions: list[ca.SX] = field(default_factory=list)
    levels: list[ca.SX] = field(default_factory=list)
    level_values: list[float] = field(default_factory=list)
    places: dict[int, int] = field(default_factory=dict)
    sampled: list[ca.SX] = field(default_factory=list)
    samples: dict[int, np.ndarray] = field(default_factory=dict)
    coefficients: list[ca.SX] = field(default_factory=list)
    polynomials: dict[int, PiecewisePolynomial] = field(default_factory=dict)
    structure: list[Any] = field(default_factory=list)

    def symbol(self, *key: Any) -> ca.SX:
        """A symbol that is the same whenever the mechanism is asked for it."""
        name = " ".join(str(part) for part in key)
        return self.eom.mechanism.cache.get_or_create(("input symbol", *key), lambda: ca.SX.sym(name))

    def read(self, k: int, value: Any) -> None:
        """Read the value of an input."""
        description = f"input '{self.eom.mechanism.inputs[k].label}'"
        value = expression_of(self.eom.t, value)
        if isinstance(value, PiecewisePolynomial):
            self._polynomial(k, value)
        elif isinstance(value, ca.SX) and not (value.is_scalar() and value.is_constant()):
            _check_feedback(self.eom, value, description)
            self.expressions.append(value)
            self.structure.append(("expression", value.element_hash()))
        elif isinstance(value, ca.SX) or (np.ndim(value) == 0 and not callable(value)):
            self._level(k, number(value, description, "value"))
        else:
            self._sampled(k, _check_samples(value, self.times, description))

    def _level(self, k: int, value: float) -> None:
        self.places[k] = len(self.levels)
        self.levels.append(self.symbol("level", k))
        self.level_values.append(value)
        self.expressions.append(self.levels[-1])
        self.structure.append("number")

    def _sampled(self, k: int, values: np.ndarray) -> None:
        level, slope = self.symbol("sample", k), self.symbol("slope", k)
        self.sampled += [level, slope]
        self.samples[k] = values
        self.expressions.append(level + slope * (self.eom.t - self.symbol("interval start")))
        self.structure.append("samples")

    def _polynomial(self, k: int, value: PiecewisePolynomial) -> None:
        coefficients = [self.symbol("coefficient", k, power) for power in range(value.terms)]
        begin = self.symbol("polynomial start", k)
        self.coefficients += [*coefficients, begin]
        self.polynomials[k] = value
        factors = value.factors if isinstance(value, PolynomialFeedback) else ca.SX(1)
        for factor in ca.vertsplit(factors):
            _check_feedback(self.eom, factor, f"input '{self.eom.mechanism.inputs[k].label}'")
        powers = [(self.eom.t - begin) ** power for power in range(value.terms // factors.numel())]
        terms = zip(coefficients, (f * x for f in ca.vertsplit(factors) for x in powers), strict=True)
        self.expressions.append(sum((c * x for c, x in terms), ca.SX(0)))
        self.structure.append(("polynomial", value.terms, ExpressionKey(factors)))

    def signals(self, controller: SampledController | None) -> Signals:
        """The signals of all inputs."""
        none = ca.SX(0, 1)
        sampled = [*self.sampled, self.symbol("interval start")] if self.sampled else []
        return Signals(
            ca.vertcat(none, *self.expressions),
            ca.vertcat(none, *self.levels),
            np.array(self.level_values),
            self.places,
            ca.vertcat(none, *sampled, *self.coefficients),
            self.samples,
            np.zeros(0) if self.times is None else self.times,
            self.polynomials,
            controller,
            tuple(self.structure),
        )


def read_signals(
    eom: Equations,
    inputs: Any,
    times: np.ndarray | None = None,
    *,
    carried: Mapping[Any, float] | None = None,
    fixed: Mapping[Any, float] | None = None,
) -> Signals:
    """Read ``inputs=``.

    Parameters
    ----------
    inputs : mapping, list of pairs, Solution, or SampledController
        Numbers, arrays of samples on the output grid, expressions, solutions of
        optimal control; or one solution or controller for all.
    times : numpy.ndarray, optional
        The output grid; without it samples are refused.
    carried : mapping of Input to float, optional
        Values that a start brings along, for inputs that are not given others.
    fixed : mapping of Input to float, optional
        Values that the analysis itself sets, over all others.
    """
    mechanism = eom.mechanism
    if not mechanism.inputs and inputs is None:
        return mechanism.cache.get_or_create("no inputs", lambda: _Reader(eom, None).signals(None))
    values: list[Any] = [u.value for u in mechanism.inputs]
    for key, value in (carried or {}).items():
        values[position_in(mechanism.inputs, key, "initial=")] = value
    reader = _Reader(eom, times)
    controller = inputs if isinstance(inputs, SampledController) else None
    if isinstance(getattr(inputs, "inputs", None), Mapping):  # a solution stands for all its inputs that act
        known = mechanism.inputs
        inputs = {u: x for u, x in inputs.inputs.items() if getattr(u, "acts", True) or place_of(u, known) is not None}
    for key, value in () if controller else pairs_of(inputs, "inputs="):
        k = position_in(mechanism.inputs, key, "inputs=")
        values[k] = of_solution(value, mechanism.inputs[k])
    for key, value in (fixed or {}).items():
        values[position_in(mechanism.inputs, key, "inputs=")] = value
    for k, value in enumerate(values):
        reader.read(k, value)
    return reader.signals(controller)


def read_answer(controller: SampledController, state: Any, levels: np.ndarray) -> np.ndarray:
    """Call a controller at a state: values of all inputs (n_u,).

    Parameters
    ----------
    levels : numpy.ndarray
        Values of the inputs that the answer leaves out.
    """
    inputs, values = state.mechanism.inputs, np.array(levels, float)
    answer = controller.function(state.t, state)
    if answer is None:
        raise SimulationError(
            f"the controller returned None at t = {state.t:.6g} s; it must return {{input: value}}", time=state.t
        )
    for key, value in pairs_of(answer, "the controller's answer"):
        k = position_in(inputs, key, "the controller's answer")
        try:
            values[k] = float(value)
        except (TypeError, ValueError):
            values[k] = np.nan
        if not np.isfinite(values[k]):
            raise SimulationError(
                f"the controller gives {value!r} for input '{inputs[k].label}' at t = {state.t:.6g} s; a finite number "
                "is needed",
                time=state.t,
            )
    return values


def of_solution(value: Any, symbol: Any) -> Any:
    """Return the course of an input in a solution of optimal control; any other value as it is."""
    courses = getattr(value, "inputs", None)
    if not isinstance(courses, Mapping):
        return value
    if symbol not in courses:
        raise ModelError(f"inputs= holds a solution without the input '{symbol.label}'")
    return courses[symbol]


def _check_feedback(eom: Equations, expression: ca.SX, what: str) -> None:
    if expression.numel() != 1:
        raise ModelError(f"{what}: the expression must be a scalar, got shape {expression.shape}")
    allowed = {s.element_hash() for group in (eom.t, eom.q, eom.v, eom.z, eom.p) for s in ca.vertsplit(group)}
    for symbol in symbols_of(expression):
        if symbol.element_hash() not in allowed:
            role = role_of(symbol)
            kind = role.kind if role else ""
            reason = (
                "feedback may use time, positions, velocities, states and parameters"
                if kind in ("acceleration", "multiplier", "input")
                else "which the mechanism does not have"
            )
            raise ExpressionError(f"{what}: the expression contains {describe(symbol)}; {reason}")


def _check_samples(value: Any, times: np.ndarray | None, what: str) -> np.ndarray:
    if callable(value):
        raise ModelError(
            f"{what}: a Python function cannot be differentiated; use an expression or a SampledController"
        )
    try:
        samples = real_array(value).ravel()
    except (TypeError, ValueError):
        raise ModelError(f"{what}: takes a number, samples or an expression, got {value!r}") from None
    if times is None:
        raise ModelError(f"{what}: samples need a time grid; give a number or an expression here")
    if samples.size != times.size:
        raise ModelError(
            f"{what}: {samples.size} samples are given for {times.size} times; samples at other times are "
            "mbd.spline(mbd.t, times, samples)"
        )
    if not np.all(np.isfinite(samples)):
        raise ModelError(f"{what}: sample {int(np.flatnonzero(~np.isfinite(samples))[0])} is not finite")
    return samples
