"""Values of the inputs during an analysis: numbers, samples, expressions, or a sampled controller."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from ..equations import Equations
from ..errors import ExpressionError, ModelError
from ..model.immutable import Immutable
from ..model.symbols import describe, number, role_of, symbols_of
from .piecewise_polynomial import PiecewisePolynomial
from .values import pairs_of, position_in


class SampledController(Immutable):
    """A controller in plain Python that is asked at the start of each period; its values are held in between.

    Parameters
    ----------
    function : callable
        ``function(time, state) -> {input: value}``; `state` is a ``State``.
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


@dataclass
class Signals:
    """Inputs as expressions in ``t, q, v, z, p`` and two symbols a sampled input: its value and slope.

    Attributes
    ----------
    expressions : casadi.SX
        (k,), one for each input of the mechanism.
    channel : casadi.SX
        ``[value, slope]`` of each sampled input and the time from which they count.
    samples : dict of int to numpy.ndarray
        Samples (n_t,) by input.
    controller : SampledController or None
        Asked between intervals.
    controlled : list of int
        Inputs that it sets.
    pieces : dict of int to PiecewisePolynomial
        Piecewise polynomials by input.
    """

    expressions: ca.SX
    channel: ca.SX
    samples: dict[int, np.ndarray]
    controller: SampledController | None
    controlled: list[int]
    pieces: dict[int, PiecewisePolynomial] = field(default_factory=dict)

    @property
    def is_sampled(self) -> bool:
        """Whether an input changes by intervals."""
        return bool(self.channel.numel())

    @property
    def breaks(self) -> np.ndarray:
        """Times at which a piecewise polynomial changes its piece."""
        return np.unique(np.concatenate([np.zeros(0), *[p.breaks for p in self.pieces.values()]]))

    def piece_values(self, begins: np.ndarray) -> np.ndarray:
        """Coefficients and starts of the pieces that hold from times on (rows, k)."""
        rows = []
        for piece in self.pieces.values():
            k = piece.interval(begins)
            rows += [piece.coefficients[k].T, piece.breaks[k][None, :]]
        return np.vstack([np.zeros((0, begins.size)), *rows])

    def channel_values(self, times: np.ndarray, held: np.ndarray) -> np.ndarray:
        """Values of the channel by interval (channel, n_t - 1)."""
        rows = []
        for values in self.samples.values():
            slope = np.diff(values) / np.diff(times)
            rows += [values[:-1], slope]
        rows += [np.full(times.size - 1, held[k]) for k in range(len(self.controlled))]
        return np.vstack([*rows, times[:-1]])


def read_signals(eom: Equations, inputs: Any, times: np.ndarray | None = None) -> Signals:
    """Turn ``inputs=`` into signals.

    Parameters
    ----------
    eom : Equations
        Equations of the mechanism.
    inputs : mapping, list of pairs, Solution, or SampledController
        Numbers, arrays of samples on the output grid, expressions, solutions of
        optimal control; or one solution or controller for all.
    times : numpy.ndarray, optional
        The output grid; without it samples are refused.
    """
    mechanism = eom.mechanism
    values: list[ca.SX] = [ca.SX(u.value) for u in mechanism.inputs]
    channel: list[ca.SX] = []
    samples: dict[int, np.ndarray] = {}
    pieces: dict[int, PiecewisePolynomial] = {}
    piece_channel: list[ca.SX] = []
    start = ca.SX.sym("interval start")
    if isinstance(inputs, SampledController):
        held = [ca.SX.sym(f"{u.label} held") for u in mechanism.inputs]
        return Signals(ca.vertcat(ca.SX(0, 1), *held), ca.vertcat(*held, start), {}, inputs, list(range(len(held))))
    if isinstance(getattr(inputs, "inputs", None), Mapping):  # a solution stands for all its inputs
        inputs = inputs.inputs
    for key, value in pairs_of(inputs, "inputs="):
        k = position_in(mechanism.inputs, key, "inputs=")
        what = f"input '{mechanism.inputs[k].label}'"
        value = _of_solution(value, mechanism.inputs[k])
        if isinstance(value, PiecewisePolynomial):
            coefficients = [ca.SX.sym(f"{what} {power}") for power in range(value.terms)]
            begin = ca.SX.sym(f"{what} start")
            values[k] = sum((c * (eom.t - begin) ** power for power, c in enumerate(coefficients)), ca.SX(0))
            piece_channel += [*coefficients, begin]
            pieces[k] = value
        elif isinstance(value, ca.SX):
            _check_feedback(eom, value, what)
            values[k] = value
        elif np.ndim(value) == 0 and not callable(value):
            values[k] = ca.SX(number(value, what, "value"))
        else:
            samples[k] = _check_samples(value, times, what)
            level, slope = ca.SX.sym(f"{what} value"), ca.SX.sym(f"{what} slope")
            channel += [level, slope]
            values[k] = level + slope * (eom.t - start)
    if channel or piece_channel:
        channel = [*channel, start, *piece_channel]
    return Signals(ca.vertcat(ca.SX(0, 1), *values), ca.vertcat(ca.SX(0, 1), *channel), samples, None, [], pieces)


def _of_solution(value: Any, symbol: Any) -> Any:
    """The course of an input in a solution of optimal control; any other value as it is."""
    found = getattr(value, "inputs", None)
    if not isinstance(found, Mapping):
        return value
    if not any(key is symbol for key in found):
        raise ModelError(f"inputs= holds a solution without the input '{symbol.label}'")
    return found[symbol]


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
            raise ExpressionError(f"{what}: the expression holds {describe(symbol)}; {reason}")


def _check_samples(value: Any, times: np.ndarray | None, what: str) -> np.ndarray:
    if callable(value):
        raise ModelError(
            f"{what}: a Python function cannot be differentiated; use an expression or a SampledController"
        )
    try:
        samples = np.asarray(value, float).ravel()
    except (TypeError, ValueError):
        raise ModelError(f"{what}: takes a number, samples or an expression, got {value!r}") from None
    if times is None:
        raise ModelError(f"{what}: samples need a time grid; give a number or an expression here")
    if samples.size != times.size:
        raise ModelError(f"{what}: {samples.size} samples are given for {times.size} times")
    if not np.all(np.isfinite(samples)):
        raise ModelError(f"{what}: sample {int(np.flatnonzero(~np.isfinite(samples))[0])} is not finite")
    return samples
