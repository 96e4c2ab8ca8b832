"""The run without a compiler: a whole step is one CasADi function, and what decides between steps is Python.

It takes the same decisions as ``engine.c``, in the same order; its results differ by rounding.
"""

from __future__ import annotations

import math
import threading
import time as clock
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

from ...model.cache import Cache
from ...numerics.c_code import simplified
from ...numerics.evaluation import Evaluator
from .coefficients import EXPONENT, STAGES, coefficients
from .stretch import (
    ACCURACY,
    DRIFT,
    FORGOTTEN,
    LEAST,
    LOOSE,
    MOST,
    MOST_SAMPLES,
    NEAR_STEPS,
    PROJECTIONS,
    SAFETY,
    SAMPLES,
    SLIGHT,
    STABILITY,
    TOUCHES,
    ExplicitSystem,
    Progress,
    Reached,
    Status,
    Stretch,
    Watched,
)


class StepwiseRun:
    """Runs of one system by CasADi functions; one thread at a time.

    Parameters
    ----------
    system : ExplicitSystem
        The equations.
    watched : Watched or None
        Events.
    cache : Cache
        Of the mechanism: the functions serve later runs of the same system.
    """

    def __init__(self, system: ExplicitSystem, watched: Watched | None, cache: Cache):
        self.system, self.watched = system, watched
        functions = (system.input, system.dynamics, system.quadrature, system.projection)
        self._steps = _Steps(cache.get_or_create(("stepwise", *functions), partial(_StepFunctions, system)))
        self._event = None if watched is None else _Call(simplified(watched.function))
        self._halt = threading.Event()

    @property
    def is_current(self) -> bool:
        """True if it runs the best code that there is."""
        return True

    def halt(self) -> None:
        """End the call that runs in another thread at the end of its step, and any later one."""
        self._halt.set()

    def advance(self, s: Stretch, progress: Progress) -> Reached:
        """Integrate over a stretch; `progress` goes on."""
        return _StretchRun(self._steps, self.system, self.watched, self._event, self._halt, s, progress).run()

    def complete(
        self, times: np.ndarray, x: np.ndarray, channels: np.ndarray, p: np.ndarray, levels: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Accelerations (k, n), multipliers (k, m) and inputs (k, n_u) at states by row."""
        s, count = self.system, times.size
        if not count:
            return np.zeros((0, s.coordinates)), np.zeros((0, s.multipliers)), np.zeros((0, s.inputs))
        a, lam, u = self._steps.functions.complete_rows.rows(times[:, None], x, channels, p, levels)
        return a, lam, u


class _StepFunctions:
    """Parts of a step as functions of ``(t, h, y, k, …)`` with ``y = (q, v, z, integrals)``; made once for a system."""

    def __init__(self, system: ExplicitSystem):
        self.system = system
        parts = (system.input, system.dynamics, system.quadrature)
        self._input, self._dynamics, self._quadrature = (simplified(f) for f in parts)
        self.projection = simplified(system.projection)
        self.n, self.n_x, self.n_y = system.coordinates, system.size, system.size + system.integrals
        self._p = ca.MX.sym("p", system.dynamics.numel_in(5))
        self._levels = ca.MX.sym("levels", system.input.numel_in(5))
        self._channel = ca.MX.sym("channel", system.channel)
        self._held = [self._p, self._levels, self._channel]
        self.rate, self.complete = self._make_rate(), self._make_complete()
        self.attempt, self.arrive, self.dense = self._make_attempt(), self._make_arrive(), self._make_dense()
        self.projection_rows, self.complete_rows = Evaluator(self.projection), Evaluator(self.complete)

    def _forces(self, t: ca.MX, x: ca.MX) -> tuple[ca.MX, ...]:
        """``u, a, rate of z, lam, regularity`` at a state."""
        q, v, z = ca.vertsplit(x, [0, self.n, 2 * self.n, self.n_x])
        u = self._input(t, q, v, z, *self._held)
        return u, *self._dynamics(t, q, v, z, u, self._p)

    def _rate(self, t: ca.MX, y: ca.MX) -> tuple[ca.MX, ca.MX]:
        """``dy/dt``, and the regularity."""
        x = y[: self.n_x]
        q, v, z = ca.vertsplit(x, [0, self.n, 2 * self.n, self.n_x])
        u, a, z_rate, lam, hint = self._forces(t, x)
        integrands = self._quadrature(t, q, v, a, z, lam, u, self._p)
        return ca.vertcat(v, a, z_rate, integrands), hint

    def _make_rate(self) -> ca.Function:
        t, y = ca.MX.sym("t"), ca.MX.sym("y", self.n_y)
        return ca.Function("rate", [t, y, *self._held], list(self._rate(t, y)))

    def _make_complete(self) -> ca.Function:
        t, x = ca.MX.sym("t"), ca.MX.sym("x", self.n_x)
        u, a, _, lam, _ = self._forces(t, x)
        return ca.Function("complete", [t, x, self._channel, self._p, self._levels], [a, lam, u])

    def _combined(self, row: np.ndarray, k: list[ca.MX]) -> ca.MX:
        """Sum of derivatives with the coefficients of a row."""
        used = [j for j in range(len(k)) if row[j]]
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
        given = [t, h, y, k0, reltol, abstol, *self._held]
        return ca.Function("attempt", given, [end, ca.horzcat(*k), stage, scale, error, ca.mmin(ca.vertcat(*hints))])

    def _make_arrive(self) -> ca.Function:
        """``(t, h, end, last stage, its rate, scale, …) -> (end, |Phi|, size, correction, rate, regularity, h λ)``.

        The end is brought onto the constraints by one step; the correction is in tolerances.
        """
        n, n_x = self.n, self.n_x
        t, h, end, stage, early = (ca.MX.sym(*g) for g in _symbols("t h end stage early", self.n_y))
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
        stability = ca.if_else(distance > 0, h * change / (distance + (distance == 0)), 0.0)
        given = [t, h, end, stage, early, scale, weights, *self._held]
        return ca.Function("arrive", given, [y, left, size, correction, rate, hint, stability])

    def _norm(self, x: ca.MX) -> ca.MX:
        """Root of the mean square."""
        return ca.sqrt(ca.sumsqr(x) / max(self.n_x, 1))

    def _make_dense(self) -> ca.Function:
        """``(t, h, y, end, derivatives with that at the end, …) -> (n_y, 7)``: coefficients of the dense output."""
        c = coefficients()
        t, h, y, end = (ca.MX.sym(*g) for g in _symbols("t h y end", self.n_y))
        known = ca.MX.sym("k", self.n_y, STAGES + 1)
        k = ca.horzsplit(known)
        for s in range(STAGES + 1, len(c.C)):
            k.append(self._rate(t + float(c.C[s]) * h, y + h * self._combined(c.A[s], k))[0])
        change, begin, last = end - y, h * k[0], h * k[STAGES]
        columns = [change, begin - change, 2.0 * change - (last + begin)]
        columns += [h * self._combined(row, k) for row in c.D]
        return ca.Function("dense", [t, h, y, end, known, *self._held], [ca.horzcat(*columns)])


def _symbols(names: str, size: int) -> list[tuple[str, int]]:
    """Names with sizes: states and derivatives have a row by component, all else is a number."""
    return [(name, size if name in ("y", "k0", "end", "stage", "early") else 1) for name in names.split()]


class _Call:
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


class _Steps:
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
    k0, stage, scale : numpy.ndarray
        Derivative at the start, last stage, sizes by which errors are measured.
    error, stage_hint : numpy.ndarray
        Error in tolerances and least regularity of the stages (1,).
    left, size, correction, hint, stability : numpy.ndarray
        Constraint residual after one projection, size of the coordinates, correction in tolerances, regularity at
        the end, and ``h |lambda|`` (1,).
    coefficients : numpy.ndarray
        Of the dense output (7, n_y).
    """

    def __init__(self, functions: _StepFunctions):
        self.functions = f = functions
        n_y = f.n_y
        self.t, self.h, self.arrival, self.reltol, self.abstol = (np.zeros(1) for _ in range(5))
        self.y, self.k0, self.end, self.next, self.stage = (np.zeros(n_y) for _ in range(5))
        self.k, self.scale, self.weights = np.zeros((STAGES + 1, n_y)), np.zeros(f.n_x), np.zeros(f.n)
        self.error, self.stage_hint, self.left, self.size, self.correction = (np.zeros(1) for _ in range(5))
        self.hint, self.stability, self.coefficients = np.zeros(1), np.zeros(1), np.zeros((7, n_y))
        self.held = [np.zeros(f.attempt.nnz_in(k)) for k in range(6, 9)]
        stages = self.k[:STAGES].reshape(-1)
        self.attempt = _Call(
            f.attempt,
            [self.t, self.h, self.y, self.k0, self.reltol, self.abstol, *self.held],
            [self.end, stages, self.stage, self.scale, self.error, self.stage_hint],
        )
        self.arrive = _Call(
            f.arrive,
            [self.arrival, self.h, self.end, self.stage, self.k[STAGES - 1], self.scale, self.weights, *self.held],
            [self.next, self.left, self.size, self.correction, self.k[STAGES], self.hint, self.stability],
        )
        self.dense = _Call(
            f.dense,
            [self.t, self.h, self.y, self.next, self.k.reshape(-1), *self.held],
            [self.coefficients.reshape(-1)],
        )
        self.rate, self.complete, self.projection = _Call(f.rate), _Call(f.complete), _Call(f.projection)

    def begin(self, s: Stretch) -> None:
        """Take tolerances, parameters and input levels of a stretch."""
        self.reltol[0], self.abstol[0], self.weights[:] = s.reltol, s.abstol, s.weights
        self.held[0][:], self.held[1][:] = s.p, s.levels
        self.hold(s.channels[0])

    def hold(self, channel: np.ndarray) -> None:
        """Take the channels of an interval."""
        self.held[2][:] = channel


class _StretchRun:
    """One stretch, step by step."""

    def __init__(
        self,
        steps: _Steps,
        system: ExplicitSystem,
        watched: Watched | None,
        event: _Call | None,
        halt: threading.Event,
        s: Stretch,
        progress: Progress,
    ):
        self._f, self._system, self._watched, self._event = steps, system, watched, event
        self._halt, self.s, self.progress = halt, s, progress
        self.n, self.n_x = system.coordinates, system.size
        self.n_y = self.n_x + system.integrals
        self.status, self.steps, self.rejected, self.evaluations = Status.DONE, 0, 0, 0
        self.least_regularity, self._hint = np.inf, np.inf
        self.reached = 0
        self._record_of: list[_Recorded] = []
        self._stop_times = s.times.tolist()
        steps.begin(s)

    # --- equations ---------------------------------------------------------------------------
    def _rate(self, t: float, y: np.ndarray) -> np.ndarray:
        rate, hint = self._f.rate(t, y, *self._f.held)
        self._note_regularity(float(hint[0]))
        self.evaluations += 1
        return rate

    def _note_regularity(self, hint: float) -> None:
        if hint < self._hint:
            self._hint = hint

    def _projected(self, t: float, x: np.ndarray, most: int, before: float) -> np.ndarray | None:
        """A state on the constraints; None if it cannot be brought there.

        Parameters
        ----------
        most : int
            Iterations at most.
        before : float
            Largest constraint residual so far.
        """
        n, s, left, size = self.n, self.s, before, 1.0
        x = x.copy()
        for _ in range(most):
            q, v, rest = self._f.projection(t, x[:n], x[n : 2 * n], s.p, s.weights)
            left = float(rest[0])
            if not np.isfinite(left):
                return None
            x[:n], x[n : 2 * n] = q, v
            size = 1.0 + float(np.max(np.abs(q), initial=0.0))
            if left <= ACCURACY * size:
                return x
            if left >= before / 2:
                break
            before = left
        return x if left <= LOOSE * size else None

    # --- one step ----------------------------------------------------------------------------
    def _norm(self, x: np.ndarray, scale: np.ndarray) -> float:
        return float(np.sqrt(np.sum((x[: self.n_x] / scale) ** 2) / max(self.n_x, 1)))

    def _first_step(self, t: float, y: np.ndarray, k0: np.ndarray, limit: float) -> float:
        s = self.s
        scale = s.abstol + np.abs(y[: self.n_x]) * s.reltol
        d0, d1 = self._norm(y, scale), self._norm(k0, scale)
        h0 = min(1e-6 if d0 < 1e-5 or d1 < 1e-5 else 0.01 * d0 / d1, limit)
        d2 = self._norm(self._rate(t + h0, y + h0 * k0) - k0, scale) / h0
        if not np.isfinite(d2):
            return min(1e-6, limit)
        h1 = max(1e-6, h0 * 1e-3) if d1 <= 1e-15 and d2 <= 1e-15 else (0.01 / max(d1, d2)) ** (1.0 / EXPONENT)
        return min(100.0 * h0, h1, limit)

    def _attempt(self, t: float, h: float) -> float:
        """The stages of a step; its error relative to the tolerances."""
        f = self._f
        f.t[0], f.h[0] = t, h
        f.attempt.evaluate()
        self._note_regularity(float(f.stage_hint[0]))
        self.evaluations += STAGES - 1
        return float(f.error[0])

    def _arrive(self, t: float) -> bool:
        """Bring the end of a step onto the constraints, and find the rate there; False if it must be repeated."""
        f = self._f
        f.arrival[0] = t
        f.arrive.evaluate()
        left, size, correction = float(f.left[0]), float(f.size[0]), float(f.correction[0])
        self._note_regularity(float(f.hint[0]))
        self.evaluations += 1
        if not math.isfinite(left):
            return False
        if left > ACCURACY * size:
            x = self._projected(t, f.next[: self.n_x], PROJECTIONS - 1, left)
            if x is None:
                return False
            moved = np.abs(x - f.end[: self.n_x])
            moved[moved <= SLIGHT * (1.0 + np.abs(x))] = 0.0
            correction = self._norm(moved, f.scale)
            f.next[: self.n_x] = x
            f.k[STAGES] = self._rate(t, f.next)
        # a sum is finite exactly if its terms are, except for overflow, which does not occur in a motion
        return correction <= DRIFT and math.isfinite(f.k[STAGES, : self.n_x].sum())

    def _prepare_dense(self) -> None:
        self._f.dense.evaluate()
        self.evaluations += 3

    def _dense_output(self, part: float) -> np.ndarray:
        return _interpolated(self._f.y, self._f.coefficients, part)

    # --- events --------------------------------------------------------------------------------
    def _values(self, t: float, y: np.ndarray) -> np.ndarray:
        assert self._event is not None and self._watched is not None
        n, s, system = self.n, self.s, self._system
        if self._watched.needs_dynamics:
            a, lam, u = self._f.complete(t, y[: self.n_x], self._f.held[2], s.p, s.levels)
        else:
            a, lam, u = np.zeros(n), np.zeros(system.multipliers), np.zeros(system.inputs)
        found = self._event(t, y[:n], y[n : 2 * n], a, y[2 * n : self.n_x], lam, u, s.p)
        return found[0].copy()

    def _watch_from(self, t: float) -> None:
        s = self.s
        values = self._values(t, self._f.y)
        self._seen: list[tuple[float, np.ndarray]] = [(t, values)]
        self._sign = np.sign(np.where(s.side != 0.0, s.side, values - s.offset))

    def _look(self, t: float, values: np.ndarray) -> int:
        """Look at new values of the events: 1 where one may take place between the last two, 3 where it decides."""
        s, watched = self.s, self._watched
        assert watched is not None
        moved = values - s.offset
        known = ~np.isnan(moved)
        now = np.where((s.band > 0.0) & (np.abs(moved) <= s.band), self._sign, np.sign(moved))
        crossed = (now != self._sign) & (self._sign != 0.0)
        candidate = crossed & ((watched.direction == 0) | ((watched.direction > 0) == (self._sign < 0.0)))
        if len(self._seen) > 1:
            (t0, f0), (t1, f1) = self._seen
            candidate |= _may_touch(t0, f0 - s.offset, t1, f1 - s.offset, t, moved)
        candidate &= known
        self._sign = np.where(known & (now != 0), now, self._sign)
        self._seen = [*self._seen[-1:], (t, values)]
        if not np.any(candidate):
            return 0
        return 3 if np.any(candidate & watched.decides) else 1

    def _found_in_step(self, t: float, h: float, arrival: float, samples: int) -> int:
        """Look at the events in a step."""
        found = 0
        for k in range(1, samples + 2):
            part = k / (samples + 1)
            time, state = (t + part * h, self._dense_output(part)) if k <= samples else (arrival, self._f.next)
            found |= self._look(time, self._values(time, state))
        return found

    # --- what is returned ------------------------------------------------------------------------
    def _record(self, t: float, y: np.ndarray, index: int) -> None:
        """Keep the end of a step."""
        self._record_of.append(_Recorded(np.array([t]), np.array([index]), y.copy()))

    def _record_step(self, t: float, h: float, end: float, samples: int) -> None:
        """Keep outputs inside a step, in order of time, to be evaluated with those of all steps."""
        times, first = self._stop_times, self.reached
        while self.reached < len(times) and times[self.reached] < end:
            self.reached += 1
        inside, index = self.s.times[first : self.reached], np.arange(first, self.reached)
        if samples:
            between = t + h * np.arange(1, samples + 1) / (samples + 1)
            between = between[(between > t) & (between < end) & ~np.isin(between, inside)]
            inside, index = np.r_[inside, between], np.r_[index, np.full(between.size, -1)]
            order = np.argsort(inside, kind="stable")
            inside, index = inside[order], index[order]
        f = self._f
        self._record_of.append(_Recorded(inside, index, f.y.copy(), f.coefficients.copy(), (inside - t) / h))

    def _rows(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Times, places among the times of the stretch, states, and which are inside steps, not on the constraints."""
        kept = self._record_of
        if not kept:
            return np.zeros(0), np.zeros(0, np.int64), np.zeros((0, self.n_y)), np.zeros(0, bool)
        counts = [part.times.size for part in kept]
        owner, inner = np.repeat(np.arange(len(kept)), counts), [part.coefficients is not None for part in kept]
        rows = np.array([part.y for part in kept])[owner]
        inside = np.array(inner)[owner]
        if np.any(inside):
            place = (np.cumsum(inner) - 1)[owner[inside]]
            coefficients = np.array([part.coefficients for part in kept if part.coefficients is not None])[place]
            parts = np.concatenate([part.parts for part in kept if part.parts is not None])[:, None]
            rows[inside] = _interpolated(rows[inside], coefficients.transpose(1, 0, 2), parts)
        times, index = (np.concatenate([getattr(part, name) for part in kept]) for name in ("times", "index"))
        return times, index.astype(np.int64), rows, inside

    def _brought_onto_constraints(self, times: np.ndarray, rows: np.ndarray, inside: np.ndarray) -> int:
        """Project the outputs inside steps, in place; the number of rows up to the first that cannot be."""
        n, s, most = self.n, self.s, len(rows)
        waiting = np.flatnonzero(inside) if self._system.multipliers else np.zeros(0, int)
        before = np.full(most, np.inf)
        for _ in range(PROJECTIONS):
            if not waiting.size:
                break
            given = times[waiting, None], rows[waiting, :n], rows[waiting, n : 2 * n]
            q, v, left = self._f.functions.projection_rows.rows(*given, s.p, s.weights)
            rest = np.where(np.isfinite(left[:, 0]), left[:, 0], np.inf)
            finite = np.isfinite(rest)
            rows[waiting[finite], :n], rows[waiting[finite], n : 2 * n] = q[finite], v[finite]
            size = 1.0 + np.max(np.abs(rows[waiting, :n]), axis=1, initial=0.0)
            done = rest <= ACCURACY * size
            stuck = ~done & (rest >= before[waiting] / 2)
            failed = ~finite | (stuck & (rest > LOOSE * size))
            most = min([most, *waiting[failed].tolist()])
            before[waiting] = rest
            waiting = waiting[~(done | stuck | failed)]
        return min([most, *waiting[before[waiting] > LOOSE].tolist()])

    def _returned(self) -> Reached:
        times, index, rows, inside = self._rows()
        count = self._brought_onto_constraints(times, rows, inside)
        return Reached(
            times[:count],
            rows[:count, : self.n_x].copy(),
            rows[:count, self.n_x :].copy(),
            index[:count],
            self.status if count == len(rows) else Status.APART,
            self.steps,
            self.rejected,
            self.evaluations,
            self.least_regularity,
        )

    # --- the stretch -------------------------------------------------------------------------------
    def run(self) -> Reached:
        """Integrate over the stretch, or up to where something must be decided."""
        s, progress, count = self.s, self.progress, self.s.times.size
        began, t = clock.perf_counter(), s.start
        f, times = self._f, self._stop_times
        f.y[: self.n_x], f.y[self.n_x :] = s.x, 0.0
        f.k0[:] = self._rate(t, f.y)
        if not np.all(np.isfinite(f.k0[: self.n_x])):
            self.status = Status.NOT_FINITE
            return self._returned()
        if self._event is not None:
            self._watch_from(t)
        step, stop, self._near_steps = progress.step, 0, 0
        while self.reached < count:
            while stop < count - 1 and (stop < self.reached or not s.stops[stop]):
                stop += 1
            end = times[stop]
            if step <= 0.0:
                step = self._first_step(t, f.y, f.k0, min(end - t, s.max_step))
            taken = self._step(t, end, min(step, s.max_step))
            if taken is None:
                break
            h, arrival, step = taken
            self._look_back(t, h, arrival)
            late = s.seconds > 0.0 and clock.perf_counter() - began > s.seconds
            if self.status == Status.DONE and self._halt.is_set():
                self.status = Status.HALTED
            if self.status == Status.DONE and (late or 0 < s.most_steps <= self.steps):
                self.status = Status.PAUSED
            due = self.reached < count and times[self.reached] == arrival
            if due:
                self._record(arrival, f.next, self.reached)
                self.reached += 1
            elif s.every_step or self.status != Status.DONE:
                self._record(arrival, f.next, -1)
            t, f.y[:] = arrival, f.next
            if self.status != Status.DONE:
                break
            if due and self.reached < count and s.stops[self.reached - 1]:
                f.hold(s.channels[self.reached])
                f.k0[:] = self._rate(t, f.y)
            else:
                f.k0[:] = f.k[STAGES]
        if self.status.is_failure and t > s.start and not (self._record_of and self._record_of[-1].times[-1] >= t):
            self._record(t, f.y, -1)
        if self.status in (Status.PAUSED, Status.HALTED, Status.STIFF) and self.reached == count:
            self.status = Status.DONE
        progress.step = step
        return self._returned()

    def _step(self, t: float, end: float, step: float) -> tuple[float, float, float] | None:
        """Take a step: its length, its end and the length of the next one; None if it goes no further."""
        clipped = repeated = False
        h, arrival = step, t + step
        if t + 1.01 * h >= end:
            h, arrival, clipped = end - t, end, True
        elif t + 2.0 * h > end:
            h, clipped = (end - t) / 2.0, True
            arrival = t + h
        while True:
            self._hint = np.inf
            error = self._attempt(t, h)
            if error < 1.0 and self._arrive(arrival):
                break
            self.rejected += 1
            repeated, clipped = True, False
            too_large = math.isfinite(error) and error >= 1.0
            h *= max(LEAST, SAFETY * error ** (-1.0 / EXPONENT)) if too_large else LEAST
            arrival = t + h
            if not h > 10.0 * abs(math.nextafter(t, math.inf) - t):
                failed = Status.APART if error < 1.0 else Status.TOO_SMALL
                self.status = failed if math.isfinite(error) else Status.NOT_FINITE
                return None
        self.steps += 1
        factor = min(MOST, SAFETY * error ** (-1.0 / EXPONENT)) if error > 0.0 else MOST
        following = h * (min(factor, 1.0) if repeated else factor)
        return h, arrival, max(following, step) if clipped else following

    def _look_back(self, t: float, h: float, arrival: float) -> None:
        """Stiffness, events and singular poses of a step, and the outputs inside it."""
        s = self.s
        self._note_stiffness()
        samples = found = 0
        if self._event is not None or s.keep_samples:
            samples = SAMPLES
            if h > s.spacing * (samples + 1):
                samples = int(min(np.ceil(h / s.spacing), MOST_SAMPLES))
        inside = self._stop_times[self.reached] < arrival
        if inside or samples:
            self._prepare_dense()
        if self._event is not None:
            found = self._found_in_step(t, h, arrival, samples)
        if self._system.multipliers and s.fall > 0.0:
            found |= self._note_fall()
        kept = (samples or (SAMPLES if found else 0)) if found or s.keep_samples else 0
        if kept and not inside and not samples:
            self._prepare_dense()
        if found & 2:
            self.status = Status.EVENT
        if inside or kept:
            self._record_step(t, h, arrival, kept)

    def _note_stiffness(self) -> None:
        s, progress = self.s, self.progress
        if not s.stiff_after:
            return
        if self._f.stability[0] > STABILITY:
            progress.not_stiff = 0
            progress.stiff += 1
            if progress.stiff >= s.stiff_after:
                self.status = Status.STIFF
        else:
            progress.not_stiff += 1
            if progress.not_stiff == FORGOTTEN:
                progress.stiff = 0

    def _note_fall(self) -> int:
        """Take note of the regularity of a step: 1 if it is near to a singular pose."""
        progress, hint = self.progress, self._hint
        self.least_regularity = min(self.least_regularity, hint)
        if math.isfinite(hint):
            progress.regularity = max(progress.regularity, hint)
        near = hint < self.s.fall * progress.regularity
        self._near_steps += near
        if (self._near_steps and not near) or self._near_steps >= NEAR_STEPS:
            self.status = Status.SINGULAR
        return int(near)


@dataclass(frozen=True, eq=False)
class _Recorded:
    """The end of a step, or outputs inside it that are still to be evaluated.

    Attributes
    ----------
    times, index : numpy.ndarray
        Times and their places among those of the stretch, or -1 (k,).
    y : numpy.ndarray
        The end; or the start, from which the dense output counts (n_y,).
    coefficients, parts : numpy.ndarray or None
        Of the dense output (7, n_y), and at which parts of the step (k,).
    """

    times: np.ndarray
    index: np.ndarray
    y: np.ndarray
    coefficients: np.ndarray | None = None
    parts: np.ndarray | None = None


def _interpolated(y: np.ndarray, f: np.ndarray, part: Any) -> np.ndarray:
    """Dense output at a part of a step, from its start and its coefficients (7, …)."""
    r = 1.0 - part
    inner = f[3] + part * (f[4] + r * (f[5] + part * f[6]))
    return y + part * (f[0] + r * (f[1] + part * (f[2] + r * inner)))


def _may_touch(t0: float, f0: np.ndarray, t1: float, f1: np.ndarray, t2: float, f2: np.ndarray) -> np.ndarray:
    """Return True, by event, if parabolas through three values of one sign come near to zero between them, by event."""
    h0, h1 = t1 - t0, t2 - t1
    with np.errstate(invalid="ignore", divide="ignore"):
        same = (f0 != 0.0) & (np.sign(f0) == np.sign(f1)) & (np.sign(f1) == np.sign(f2))
        bend = ((f2 - f1) / h1 - (f1 - f0) / h0) / (h1 + h0)
        found = np.zeros(f0.shape, bool)
        for g0, g1, length in ((f0, f1, h0), (f1, f2, h1)):
            rise = (g1 - g0) / length - bend * length
            place = -rise / (2.0 * bend)
            extreme = g0 + rise * place / 2.0
            near = extreme * np.sign(g0) < TOUCHES * (np.abs(g1 - g0) + np.abs(bend) * length**2)
            found |= (place > 0.0) & (place < length) & near
    return found & same
