"""The motion of a phase in a solution: the polynomials of the transcription, brought onto the constraints."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from ...arguments.piecewise_polynomial import PiecewisePolynomial
from ...equations.numeric import NumericEquations
from ...equations.recovery import Recovery
from ...model.symbols import Parameter
from ...numerics.lazy import cached_property
from ...numerics.symbolic import symbolic
from ...results.steps import Direct
from ...results.trajectory import Statistics, Trajectory
from ..statement.phase import Phase
from .base import Transcription
from .controls import InputBasis


class OptimalMotion(Trajectory):
    """A trajectory that follows the polynomials of a transcription between the mesh points.

    It evaluates what a trajectory does, and rates of inputs (``tau.rate``) and free parameters that the mechanism does
    not have besides, which have the values `extra`.
    """

    def __init__(
        self,
        phase: Phase,
        polynomials: Polynomials,
        extra: dict[Parameter, float],
        t: np.ndarray,
        arrays: tuple[np.ndarray, ...],
        p: np.ndarray,
        **more: Any,
    ):
        q, v, a, z, lam, u = arrays
        super().__init__(phase.mechanism, t, q, v, a, z, lam, u, p, **more)
        self._phase, self._polynomials, self._extra = phase, polynomials, extra

    @symbolic
    def _compiled(self, expression: ca.SX) -> tuple[ca.Function, tuple[np.ndarray, ...]]:
        if self._extra:
            symbols, values = ca.vertcat(*self._extra), ca.DM(list(self._extra.values()))
            expression = ca.substitute(expression, symbols, values)
        rates = self._phase.input_rates
        if not rates.numel() or not ca.depends_on(ca.vec(expression), rates):
            return super()._compiled(expression)
        eom = self.equations
        eom.function(ca.substitute(expression, rates, ca.SX.zeros(rates.numel())))  # refuses unknown symbols
        arguments = super()._compiled(ca.SX(0))[1]
        function = ca.Function("expression", [*eom.symbols, rates], [ca.densify(expression)])
        return function, (*arguments, self._polynomials.input_rates(self.t))

    def _at(self, t: np.ndarray, *arrays: np.ndarray) -> OptimalMotion:
        more: dict[str, Any] = {"interpolation": self.interpolation}
        return OptimalMotion(self._phase, self._polynomials, self._extra, t, arrays, self.parameters, **more)


class Polynomials:
    """The polynomials of a transcription on a mesh with points at times (N + 1,), s.

    Unknowns of the mesh points (N + 1, …) and of the intervals (N, …) are in physical units.
    """

    def __init__(
        self,
        scheme: Transcription,
        times: np.ndarray,
        points: np.ndarray,
        intervals: np.ndarray,
        numeric: NumericEquations,
    ):
        self.scheme, self.times, self.points, self.intervals, self.numeric = scheme, times, points, intervals, numeric

    def unknowns(self, k: np.ndarray, tau: np.ndarray) -> tuple[np.ndarray, ...]:
        """Arguments of :attr:`Transcription.motion` at points of intervals."""
        lengths = np.diff(self.times)[k, None]
        ends = self.points[k], self.intervals[k], self.points[k + 1]
        return *ends, self.times[k, None], lengths, tau[:, None], self.numeric.p

    def at(self, k: np.ndarray, tau: np.ndarray) -> list[np.ndarray]:
        """``t, q, v, a, z, lam, u, u̇`` at points of intervals, each (k, size)."""
        return self.scheme.motion.rows(*self.unknowns(k, tau))

    @cached_property
    def at_mesh_points(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """``q, v, z`` at the mesh points, each (N + 1, size)."""
        parts = self.scheme.split_point(self.points.T)
        w, rate, z = (parts[name].T for name in ("q", "v", "z"))
        q, v = self.scheme.eom.states(self.times, w, rate, z, self.numeric.p)
        return q, v, z

    def _located(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Intervals in which times lie, and the points in these."""
        slack = 1e-12 * max(1.0, abs(self.times[-1]))
        k = np.clip(np.searchsorted(self.times, times + slack, side="right") - 1, 0, self.times.size - 2)
        return k, np.clip((times - self.times[k]) / np.diff(self.times)[k], 0, 1)

    def at_times(self, times: np.ndarray) -> list[np.ndarray]:
        """``t, q, v, a, z, lam, u, u̇`` at times, each (k, size)."""
        return self.at(*self._located(times))

    def states(self, times: np.ndarray) -> tuple[np.ndarray, ...]:
        """Coordinates, velocities, first-order states and inputs at times."""
        _, q, v, _, z, _, u, _ = self.at_times(times)
        return q, v, z, u

    def input_rates(self, times: np.ndarray) -> np.ndarray:
        """Rates of the inputs at times (k, n_u)."""
        return self.at_times(times)[7]

    def state_rates(self, *at: np.ndarray) -> np.ndarray:
        """Rates of the first-order states (k, size) at ``t, q, v, a, z, lam, u``, each by row."""
        eom = self.numeric.eom
        if not eom.z.numel():
            return np.zeros((len(at[0]), 0))
        rates: np.ndarray = eom.function(eom.z_rate)(*(x.T for x in at), self.numeric.p).full().T
        return rates

    @cached_property
    def inputs(self) -> dict[Any, PiecewisePolynomial]:
        """The inputs as ``simulate(inputs=…)`` takes them."""
        scheme, courses = self.scheme, self.free_inputs
        if scheme.known:
            given = self._courses(scheme.known, self.intervals[:, scheme.interval_size :], scheme.known_basis)
            courses = courses | given
        return {u: courses[u] for u in scheme.eom.mechanism.inputs}

    @cached_property
    def free_inputs(self) -> dict[Any, PiecewisePolynomial]:
        """Inputs that were found."""
        places, part = self.scheme.free_inputs, self.scheme.interval_slice("u")
        ends = self.scheme.split_point(self.points.T)["u"].T if self.scheme.inputs.joined else None
        return self._courses(places, self.intervals[:, part], self.scheme.inputs, ends) if places else {}

    def _courses(
        self, places: Sequence[int], inner: np.ndarray, basis: InputBasis, ends: np.ndarray | None = None
    ) -> dict[Any, PiecewisePolynomial]:
        """Courses of inputs from values in the intervals (N, k n), and at the mesh points if those count (N + 1, n)."""
        values = inner.reshape(len(inner), len(basis.inner), len(places))
        if ends is not None:
            values = np.concatenate([ends[:-1, None], values, ends[1:, None]], axis=1)
        by_power = np.einsum("kj,ikn->ijn", basis.coefficients, values)
        lengths, symbols = np.diff(self.times)[:, None] ** np.arange(basis.taus.size), self.scheme.eom.mechanism.inputs
        return {symbols[p]: PiecewisePolynomial(self.times, by_power[:, :, k] / lengths) for k, p in enumerate(places)}

    def trajectory(self, phase: Phase, extra: dict[Parameter, float], statistics: Statistics) -> OptimalMotion:
        """The motion at mesh points and stages, on the constraints to rounding."""
        stages, count = self.scheme.stages, len(self.intervals)
        taus = np.r_[0.0, stages[(stages > 0) & (stages < 1)]]
        k = np.repeat(np.arange(count), taus.size)
        t, q, v, _, z, _, u, _ = self.at(np.r_[k, count - 1], np.r_[np.tile(taus, count), 1.0])
        t = t.ravel()
        t[:: taus.size] = self.times
        q[-1], v[-1], z[-1] = (values[-1] for values in self.at_mesh_points)
        recovery = Recovery(self.numeric, redundant=self.scheme.redundant)
        complete = recovery.complete if self.scheme.eom.rows else recovery.loaded
        more: dict[str, Any] = {
            "statistics": statistics,
            "interpolation": Direct(lambda times: complete(times, *self.states(times)), t),
        }
        return OptimalMotion(phase, self, extra, t, complete(t, q, v, z, u), self.numeric.p, **more)
