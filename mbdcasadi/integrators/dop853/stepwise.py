"""The run without a compiler: a whole step is one CasADi function, and what decides between steps is Python.

It takes the same decisions as ``engine.c``, in the same order; its results differ by rounding.
"""

from __future__ import annotations

import time as clock
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

from ...model.cache import Cache
from ...numerics.c_code import simplified
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

    @property
    def is_current(self) -> bool:
        """True if it runs the best code that there is."""
        return True

    def advance(self, s: Stretch, progress: Progress) -> Reached:
        """Integrate over a stretch; `progress` goes on."""
        return _StretchRun(self._steps, self.system, self.watched, self._event, s, progress).run()

    def complete(
        self, times: np.ndarray, x: np.ndarray, channels: np.ndarray, p: np.ndarray, levels: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Accelerations (k, n), multipliers (k, m) and inputs (k, n_u) at states by row."""
        s, count = self.system, times.size
        if not count:
            return np.zeros((0, s.coordinates)), np.zeros((0, s.multipliers)), np.zeros((0, s.inputs))
        found = self._steps.functions.complete(times[None, :], x.T, channels.T, p, levels)
        a, lam, u = (np.broadcast_to(part.full().T, (count, part.size1())) for part in found)
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
    """A CasADi function on arrays of its own: a call costs about a microsecond."""

    def __init__(self, function: ca.Function):
        self._buffer, self._evaluate = function.buffer()
        self._kept = function
        self.arguments = [np.zeros(function.nnz_in(k)) for k in range(function.n_in())]
        self.results = [np.zeros(function.nnz_out(k)) for k in range(function.n_out())]
        for k, argument in enumerate(self.arguments):
            if argument.size:
                self._buffer.set_arg(k, argument.data)
        for k, result in enumerate(self.results):
            if result.size:
                self._buffer.set_res(k, result.data)

    def __call__(self, *values: Any) -> list[np.ndarray]:
        for argument, value in zip(self.arguments, values, strict=True):
            argument[:] = value
        self._evaluate()
        return self.results


class _Steps:
    """The functions of a step with arrays of their own."""

    def __init__(self, functions: _StepFunctions):
        self.functions = functions
        self.rate, self.attempt = _Call(functions.rate), _Call(functions.attempt)
        self.dense, self.projection = _Call(functions.dense), _Call(functions.projection)
        self.arrive, self.complete = _Call(functions.arrive), _Call(functions.complete)


class _StretchRun:
    """One stretch, step by step."""

    def __init__(
        self,
        steps: _Steps,
        system: ExplicitSystem,
        watched: Watched | None,
        event: _Call | None,
        s: Stretch,
        progress: Progress,
    ):
        self._f, self._system, self._watched, self._event = steps, system, watched, event
        self.s, self.progress = s, progress
        self.n, self.n_x = system.coordinates, system.size
        self.n_y = self.n_x + system.integrals
        self.status, self.steps, self.rejected, self.evaluations = Status.DONE, 0, 0, 0
        self.least_regularity, self._hint = np.inf, np.inf
        self._channel, self.reached = s.channels[0], 0
        self._times: list[float] = []
        self._rows: list[np.ndarray] = []
        self._index: list[int] = []
        self._inside: list[bool] = []

    # --- equations ---------------------------------------------------------------------------
    @property
    def _held(self) -> tuple[np.ndarray, ...]:
        return self.s.p, self.s.levels, self._channel

    def _rate(self, t: float, y: np.ndarray) -> np.ndarray:
        rate, hint = self._f.rate(t, y, *self._held)
        self._note_regularity(float(hint[0]))
        self.evaluations += 1
        return rate.copy()

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
        found = self._f.attempt(t, h, self._y, self._k0, self.s.reltol, self.s.abstol, *self._held)
        self._next, self._k, self._stage, self._scale = found[0].copy(), found[1], found[2], found[3]
        self._note_regularity(float(found[5][0]))
        self.evaluations += STAGES - 1
        return float(found[4][0])

    def _arrive(self, t: float, h: float) -> bool:
        """Bring the end of a step onto the constraints, and find the rate there; False if it must be repeated."""
        given, early = self._next, self._k[(STAGES - 1) * self.n_y :]
        found = self._f.arrive(t, h, given, self._stage, early, self._scale, self.s.weights, *self._held)
        left, size, correction = (float(part[0]) for part in found[1:4])
        self._next, self._k12 = found[0].copy(), found[4].copy()
        self._stability = float(found[6][0])
        self._note_regularity(float(found[5][0]))
        self.evaluations += 1
        if not np.isfinite(left):
            return False
        if left > ACCURACY * size:
            x = self._projected(t, self._next[: self.n_x], PROJECTIONS - 1, left)
            if x is None:
                return False
            moved = np.abs(x - given[: self.n_x])
            moved[moved <= SLIGHT * (1.0 + np.abs(x))] = 0.0
            correction = self._norm(moved, self._scale)
            self._next[: self.n_x] = x
            self._k12 = self._rate(t, self._next)
        return bool(correction <= DRIFT and np.all(np.isfinite(self._k12[: self.n_x])))

    def _prepare_dense(self, t: float, h: float) -> None:
        known = np.concatenate([self._k, self._k12])
        found = self._f.dense(t, h, self._y, self._next, known, *self._held)[0]
        self._dense = found.reshape(7, self.n_y).copy()
        self.evaluations += 3

    def _dense_output(self, part: float) -> np.ndarray:
        f, r = self._dense, 1.0 - part
        inner = f[3] + part * (f[4] + r * (f[5] + part * f[6]))
        return self._y + part * (f[0] + r * (f[1] + part * (f[2] + r * inner)))

    # --- events --------------------------------------------------------------------------------
    def _values(self, t: float, y: np.ndarray) -> np.ndarray:
        assert self._event is not None and self._watched is not None
        n, s, system = self.n, self.s, self._system
        if self._watched.needs_dynamics:
            a, lam, u = self._f.complete(t, y[: self.n_x], self._channel, s.p, s.levels)
        else:
            a, lam, u = np.zeros(n), np.zeros(system.multipliers), np.zeros(system.inputs)
        found = self._event(t, y[:n], y[n : 2 * n], a, y[2 * n : self.n_x], lam, u, s.p)
        return found[0].copy()

    def _watch_from(self, t: float) -> None:
        s = self.s
        values = self._values(t, self._y)
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
            time, state = (t + part * h, self._dense_output(part)) if k <= samples else (arrival, self._next)
            found |= self._look(time, self._values(time, state))
        return found

    # --- what is returned ------------------------------------------------------------------------
    def _record(self, t: float, y: np.ndarray, index: int, *, inside: bool = False) -> None:
        self._times.append(t)
        self._rows.append(y.copy())
        self._index.append(index)
        self._inside.append(inside)

    def _record_step(self, t: float, h: float, end: float, samples: int) -> None:
        """Outputs inside a step, in order of time, not yet on the constraints."""
        s, sample, last = self.s, 1, t
        while True:
            due = float(s.times[self.reached]) if self.reached < s.times.size else np.inf
            between = t + h * sample / (samples + 1) if sample <= samples else np.inf
            if min(due, between) >= end:
                return
            wanted = due <= between
            time = due if wanted else between
            if wanted or last < time < due:
                self._record(time, self._dense_output((time - t) / h), self.reached if wanted else -1, inside=True)
                last = time
            if wanted:
                self.reached += 1
            if between <= time:
                sample += 1

    def _brought_onto_constraints(self, times: np.ndarray, rows: np.ndarray) -> int:
        """Project the outputs inside steps, in place; the number of rows up to the first that cannot be."""
        n, s, most = self.n, self.s, len(rows)
        waiting = np.flatnonzero(self._inside) if self._system.multipliers else np.zeros(0, int)
        before = np.full(most, np.inf)
        for _ in range(PROJECTIONS):
            if not waiting.size:
                break
            given = times[waiting][None, :], rows[waiting, :n].T, rows[waiting, n : 2 * n].T
            found = self._f.functions.projection(*given, s.p, s.weights)
            q, v, left = (part.full().T for part in found)
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
        rows = np.array(self._rows) if self._rows else np.zeros((0, self.n_y))
        times, index = np.array(self._times), np.array(self._index, dtype=np.int64)
        count = self._brought_onto_constraints(times, rows)
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
        self._y = np.r_[s.x, np.zeros(self._system.integrals)]
        self._k0 = self._rate(t, self._y)
        if not np.all(np.isfinite(self._k0[: self.n_x])):
            self.status = Status.NOT_FINITE
            return self._returned()
        if self._event is not None:
            self._watch_from(t)
        step, stop, self._near_steps = progress.step, 0, 0
        while self.reached < count:
            while stop < count - 1 and (stop < self.reached or not s.stops[stop]):
                stop += 1
            end = float(s.times[stop])
            if step <= 0.0:
                step = self._first_step(t, self._y, self._k0, min(end - t, s.max_step))
            taken = self._step(t, end, min(step, s.max_step))
            if taken is None:
                break
            h, arrival, step = taken
            self._look_back(t, h, arrival)
            late = s.seconds > 0.0 and clock.perf_counter() - began > s.seconds
            if self.status == Status.DONE and (late or 0 < s.most_steps <= self.steps):
                self.status = Status.PAUSED
            due = self.reached < count and s.times[self.reached] == arrival
            if due:
                self._record(arrival, self._next, self.reached)
                self.reached += 1
            elif s.every_step or self.status != Status.DONE:
                self._record(arrival, self._next, -1)
            t, self._y = arrival, self._next
            if self.status != Status.DONE:
                break
            if due and self.reached < count and s.stops[self.reached - 1]:
                self._channel = s.channels[self.reached]
                self._k0 = self._rate(t, self._y)
            else:
                self._k0 = self._k12
        if self.status.is_failure and t > s.start and not (self._times and self._times[-1] >= t):
            self._record(t, self._y, -1)
        if self.status in (Status.PAUSED, Status.STIFF) and self.reached == count:
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
            if error < 1.0 and self._arrive(arrival, h):
                break
            self.rejected += 1
            repeated, clipped = True, False
            too_large = np.isfinite(error) and error >= 1.0
            h *= max(LEAST, SAFETY * error ** (-1.0 / EXPONENT)) if too_large else LEAST
            arrival = t + h
            if not h > 10.0 * abs(np.nextafter(t, np.inf) - t):
                failed = Status.APART if error < 1.0 else Status.TOO_SMALL
                self.status = failed if np.isfinite(error) else Status.NOT_FINITE
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
        inside = bool(s.times[self.reached] < arrival)
        if inside or samples:
            self._prepare_dense(t, h)
        if self._event is not None:
            found = self._found_in_step(t, h, arrival, samples)
        if self._system.multipliers and s.fall > 0.0:
            found |= self._note_fall()
        kept = (samples or (SAMPLES if found else 0)) if found or s.keep_samples else 0
        if kept and not inside and not samples:
            self._prepare_dense(t, h)
        if found & 2:
            self.status = Status.EVENT
        if inside or kept:
            self._record_step(t, h, arrival, kept)

    def _note_stiffness(self) -> None:
        s, progress = self.s, self.progress
        if not s.stiff_after:
            return
        if self._stability > STABILITY:
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
        if np.isfinite(hint):
            progress.regularity = max(progress.regularity, hint)
        near = hint < self.s.fall * progress.regularity
        self._near_steps += near
        if (self._near_steps and not near) or self._near_steps >= NEAR_STEPS:
            self.status = Status.SINGULAR
        return int(near)


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
