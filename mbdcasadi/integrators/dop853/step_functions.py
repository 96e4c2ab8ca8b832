"""A step of the method as CasADi functions, on arrays that hand on the results of one to the next."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

import casadi as ca
import numpy as np

from ...numerics.c_code import simplified
from ...numerics.evaluation import Evaluator
from ..native.stretch import ExplicitSystem, Stretch
from .coefficients import STAGES, coefficients
from .constants import OUTLIERS, QUIET, SLIGHT

#: Components from which a sum is faster than a product with a matrix, into which derivatives are copied.
LONG = 40


class StepFunctions:
    """Parts of a step as functions of ``(t, h, y, k, …)`` with ``y = (q, v, z, integrals)``; made once for a system."""

    def __init__(self, system: ExplicitSystem):
        self.system = system
        parts = (system.input, system.dynamics, system.quadrature)
        self._input, self._dynamics, self._quadrature = (simplified(f) for f in parts)
        self._motion = _without_multipliers(self._dynamics)
        self.projection = simplified(system.projection)
        self.n, self.n_x, self.n_y = system.coordinates, system.size, system.size + system.integrals
        self._p = ca.MX.sym("p", system.dynamics.numel_in(5))
        self._levels = ca.MX.sym("levels", system.input.numel_in(5))
        self._channel = ca.MX.sym("channel", system.channel)
        self._held = [self._p, self._levels, self._channel]
        self.rate, self.complete = self._make_rate(), self._make_complete()
        self.attempt, self.arrive, self.dense = self._make_attempt(), self._make_arrive(), self._make_dense()
        self.projection_rows, self.complete_rows = Evaluator(self.projection), Evaluator(self.complete)

    def _state(self, t: ca.MX, x: ca.MX) -> list[ca.MX]:
        """``t, q, v, z, u, p`` at a state."""
        q, v, z = ca.vertsplit(x, [0, self.n, 2 * self.n, self.n_x])
        return [t, q, v, z, self._input(t, q, v, z, *self._held), self._p]

    def _rate(self, t: ca.MX, y: ca.MX) -> tuple[ca.MX, ca.MX]:
        """``dy/dt``, and the regularity."""
        known = t, q, v, z, u, p = self._state(t, y[: self.n_x])
        if not self.system.integrals:
            a, z_rate, hint = self._motion(*known)
            return ca.vertcat(v, a, z_rate), hint
        a, z_rate, lam, hint = self._dynamics(*known)
        return ca.vertcat(v, a, z_rate, self._quadrature(t, q, v, a, z, lam, u, p)), hint

    def _make_rate(self) -> ca.Function:
        t, y = ca.MX.sym("t"), ca.MX.sym("y", self.n_y)
        return ca.Function("rate", [t, y, *self._held], list(self._rate(t, y)))

    def _make_complete(self) -> ca.Function:
        t, x = ca.MX.sym("t"), ca.MX.sym("x", self.n_x)
        known = self._state(t, x)
        a, _, lam, _ = self._dynamics(*known)
        return ca.Function("complete", [t, x, self._channel, self._p, self._levels], [a, lam, known[4]])

    def _combined(self, row: np.ndarray, k: list[ca.MX]) -> ca.MX:
        """Sum of derivatives with the coefficients of a row."""
        used = [j for j in range(len(k)) if row[j]]
        if self.n_y >= LONG:
            return sum((float(row[j]) * k[j] for j in used[1:]), float(row[used[0]]) * k[used[0]])
        return ca.horzcat(*[k[j] for j in used]) @ ca.DM([float(row[j]) for j in used])

    def _make_attempt(self) -> ca.Function:
        """``(t, h, y, k0, reltol, abstol, …) -> (end, derivatives, last stage, scale, error, regularity)``."""
        c, n_x = coefficients(), self.n_x
        t, h, y, k0, reltol, abstol = (ca.MX.sym(*g) for g in _symbols("t h y k0 reltol abstol", self.n_y))
        k, hints, stage = [k0], [], y
        for s in range(1, STAGES):
            stage = y + h * self._combined(c.A[s], k)
            rate, hint = self._rate(t + float(c.C[s]) * h, stage)
            k.append(rate)
            hints.append(hint)
        end = y + h * self._combined(c.B, k)
        scale = abstol + ca.fmax(ca.fabs(y[:n_x]), ca.fabs(end[:n_x])) * reltol
        fifth, third = (
            ca.sumsqr(self._combined(row, k)[:n_x] / scale) / max(n_x, 1) for row in (c.E5[:STAGES], c.E3[:STAGES])
        )
        still = ca.logic_and(fifth == 0, third == 0)
        error = ca.if_else(still, 0.0, ca.fabs(h) * fifth / ca.sqrt(fifth + 0.01 * third + still))
        if self.system.switches:
            early = self._error_of_early_stages(h, k, scale)
            error = ca.fmax(error, ca.if_else(early > 1.0, early, 0.0))
        arguments = [t, h, y, k0, reltol, abstol, *self._held]
        return ca.Function(
            "attempt", arguments, [end, ca.horzcat(*k), stage, scale, error, ca.mmin(ca.vertcat(*hints))]
        )

    def _error_of_early_stages(self, h: ca.MX, k: list[ca.MX], scale: ca.MX) -> ca.MX:
        """Error of stages 2 to 5, which no estimate contains, as ``error_of_outliers`` in ``steps.c``."""
        changes = [h * self._norm((rate - k[0])[: self.n_x] / scale) for rate in k[1:]]
        return ca.mmax(ca.vertcat(*changes[:4])) / (1.0 + OUTLIERS * ca.mmax(ca.vertcat(*changes[4:])))

    def _make_arrive(self) -> ca.Function:
        """``(t, end, last stage, its rate, scale, …) -> (end, |Phi|, size, correction, rate, regularity, |λ|, sum)``.

        The end is brought onto the constraints by one step; the correction is in tolerances. The sum is that of the
        rate, finite exactly if all of it is: overflow does not occur in a motion.
        """
        n, n_x = self.n, self.n_x
        t, end, stage, early = (ca.MX.sym(*g) for g in _symbols("t end stage early", self.n_y))
        scale, weights = ca.MX.sym("scale", n_x), ca.MX.sym("weights", n)
        y, left, size, correction = end, ca.MX(0), ca.MX(1), ca.MX(0)
        if self.system.multipliers:
            q, v, left = self.projection(t, end[:n], end[n : 2 * n], self._p, weights)
            y = ca.vertcat(q, v, end[2 * n :])
            size = 1.0 + ca.norm_inf(q)
            moved = ca.fabs(y[:n_x] - end[:n_x])
            moved = ca.if_else(moved > SLIGHT * (1.0 + ca.fabs(y[:n_x])), moved, 0.0)
            correction = self._norm(moved / scale)
        rate, hint = self._rate(t, y)
        change, distance = (self._norm(d[:n_x] / scale) for d in (rate - early, y - stage))
        eigenvalue = ca.if_else(distance > QUIET, change / (distance + (distance == 0)), 0.0)
        arguments = [t, end, stage, early, scale, weights, *self._held]
        results = [y, left, size, correction, rate, hint, eigenvalue, ca.sum1(rate[:n_x])]
        return ca.Function("arrive", arguments, results)

    def _norm(self, x: ca.MX) -> ca.MX:
        """Root of the mean square."""
        return ca.sqrt(ca.sumsqr(x) / max(self.n_x, 1))

    def _make_dense(self) -> ca.Function:
        """``(t, h, y, derivatives with that at the end, …) ->`` derivatives of the stages for dense output."""
        c = coefficients()
        t, h, y = (ca.MX.sym(*g) for g in _symbols("t h y", self.n_y))
        known = ca.MX.sym("k", self.n_y, STAGES + 1)
        k = ca.horzsplit(known)
        for s in range(STAGES + 1, len(c.C)):
            k.append(self._rate(t + float(c.C[s]) * h, y + h * self._combined(c.A[s], k))[0])
        return ca.Function("dense", [t, h, y, known, *self._held], [ca.horzcat(*k[STAGES + 1 :])])


def _without_multipliers(dynamics: ca.Function) -> ca.Function:
    """``(t, q, v, z, u, p) -> (a, rate of z, regularity)``."""
    arguments = dynamics.sx_in()
    a, z_rate, _, hint = dynamics(*arguments)
    return ca.Function("motion", arguments, [a, z_rate, hint])


def _symbols(names: str, size: int) -> list[tuple[str, int]]:
    """Names with sizes: states and derivatives have a row by component, all else is a number."""
    return [(name, size if name in ("y", "k0", "end", "stage", "early") else 1) for name in names.split()]


class BufferedFunction:
    """A CasADi function on arrays that others may share, which spares the conversion of arguments.

    Parameters
    ----------
    function : casadi.Function
        The function.
    arguments, results : sequence of numpy.ndarray, optional
        Places of all arguments and results; new ones if left out.
    """

    def __init__(
        self,
        function: ca.Function,
        arguments: Sequence[np.ndarray] | None = None,
        results: Sequence[np.ndarray] | None = None,
    ):
        evaluate: Callable[[], None]
        self._buffer, evaluate = function.buffer()
        self.evaluate, self._kept = evaluate, function
        self.arguments = list(arguments or (np.zeros(function.nnz_in(k)) for k in range(function.n_in())))
        self.results = list(results or (np.zeros(function.nnz_out(k)) for k in range(function.n_out())))
        for k, argument in enumerate(self.arguments):
            if argument.size:
                self._buffer.set_arg(k, argument.data)
        for k, result in enumerate(self.results):
            if result.size:
                self._buffer.set_res(k, result.data)

    def __call__(self, *values: Any) -> list[np.ndarray]:
        for argument, value in zip(self.arguments, values, strict=True):
            argument[:] = value
        self.evaluate()
        return self.results


class Steps:
    """The functions of a step, on arrays that hand on the results of one to the next.

    Attributes
    ----------
    t, h, arrival : numpy.ndarray
        Start, length and end of the step (1,), s.
    y, end : numpy.ndarray
        Its start and its end, not projected, (n_y,).
    next : numpy.ndarray
        Its end on the constraints (n_y,).
    k : numpy.ndarray
        Derivatives of the stages and at the end (STAGES + 1, n_y).
    known : numpy.ndarray
        Start, end on the constraints, and all derivatives, with those for dense output (3 + STAGES + 3, n_y).
    k0, stage, scale : numpy.ndarray
        Derivative at the start, last stage, sizes by which errors are measured.
    error, stage_hint : numpy.ndarray
        Error in tolerances and least regularity of the stages (1,).
    left, size, correction, hint, eigenvalue, rate_sum : numpy.ndarray
        Constraint residual after one projection, size of the coordinates, correction in tolerances, regularity at
        the end, ``|lambda|``, and the sum of the derivative at the end (1,).
    """

    def __init__(self, functions: StepFunctions):
        self.functions = f = functions
        n_y = f.n_y
        self.t, self.h, self.arrival, self.reltol, self.abstol = (np.zeros(1) for _ in range(5))
        self.k0, self.end, self.stage = (np.zeros(n_y) for _ in range(3))
        self.known = np.zeros((2 + len(coefficients().C), n_y))
        self.y, self.next, self.k = self.known[0], self.known[1], self.known[2 : 3 + STAGES]
        self.scale, self.weights = np.zeros(f.n_x), np.zeros(f.n)
        self.error, self.stage_hint, self.left, self.size, self.correction = (np.zeros(1) for _ in range(5))
        self.hint, self.eigenvalue, self.rate_sum = (np.zeros(1) for _ in range(3))
        self.held = [np.zeros(f.attempt.nnz_in(k)) for k in range(6, 9)]
        stages, at_end = self.k[:STAGES].reshape(-1), (self.hint, self.eigenvalue, self.rate_sum)
        self.attempt = BufferedFunction(
            f.attempt,
            [self.t, self.h, self.y, self.k0, self.reltol, self.abstol, *self.held],
            [self.end, stages, self.stage, self.scale, self.error, self.stage_hint],
        )
        self.arrive = BufferedFunction(
            f.arrive,
            [self.arrival, self.end, self.stage, self.k[STAGES - 1], self.scale, self.weights, *self.held],
            [self.next, self.left, self.size, self.correction, self.k[STAGES], *at_end],
        )
        self.dense = BufferedFunction(
            f.dense,
            [self.t, self.h, self.y, self.k.reshape(-1), *self.held],
            [self.known[3 + STAGES :].reshape(-1)],
        )
        self.rate, self.complete, self.projection = (
            BufferedFunction(f.rate),
            BufferedFunction(f.complete),
            BufferedFunction(f.projection),
        )

    def begin(self, s: Stretch) -> None:
        """Take tolerances, parameters and input levels of a stretch."""
        self.reltol[0], self.abstol[0], self.weights[:] = s.reltol, s.abstol, s.weights
        self.held[0][:], self.held[1][:] = s.p, s.levels
        self.hold(s.channels[0])

    def hold(self, channel: np.ndarray) -> None:
        """Take the channels of an interval."""
        self.held[2][:] = channel

    def inside(self, parts: np.ndarray) -> np.ndarray:
        """Dense output at parts of the step (k, n_y), once the function `dense` was evaluated."""
        weights = parts[:, None] ** POWERS @ dense_weights()
        weights[:, 2:] *= self.h
        states: np.ndarray = weights @ self.known
        return states


#: Powers of the part of a step in dense output.
POWERS = np.arange(8.0)


@cache
def dense_weights() -> np.ndarray:
    """Weights (8, 2 + stages), by power of the part of a step, of its start, its end and its derivatives by length."""
    c, part, rest = coefficients(), np.polynomial.Polynomial([0, 1]), np.polynomial.Polynomial([1, -1])
    terms = [part, part * rest]
    while len(terms) < 7:
        terms.append(terms[-1] * (part if len(terms) % 2 == 0 else rest))
    of_term = np.zeros((8, 7))
    for k, term in enumerate(terms):
        of_term[: term.coef.size, k] = term.coef
    of_end = of_term[:, 0] - of_term[:, 1] + 2.0 * of_term[:, 2]
    weights = np.column_stack([-of_end, of_end, of_term[:, 3:] @ c.D])
    weights[0, 0] += 1.0
    weights[:, 2] += of_term[:, 1] - of_term[:, 2]
    weights[:, 2 + STAGES] -= of_term[:, 2]
    return weights
