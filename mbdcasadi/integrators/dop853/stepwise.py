"""The run without a compiler: a whole step is one CasADi function, and what decides between steps is Python.

It takes the same decisions as ``steps.c``, in the same order; its results differ by rounding.
"""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass
from functools import partial

import numpy as np

from ...model.cache import Cache
from ...numerics.c_code import simplified
from ...numerics.roots import may_touch
from ..native.stretch import (
    ACCURACY,
    LEAST,
    LOOSE,
    MOST,
    MOST_SAMPLES,
    PROJECTIONS,
    SAMPLES,
    ExplicitSystem,
    Progress,
    Reached,
    Status,
    Stretch,
    Watched,
)
from .coefficients import EXPONENT, STAGES
from .constants import (
    BEFORE,
    DOUBT,
    DRIFT,
    FADING,
    FORGOTTEN,
    MOST_GAIN,
    NEAR_STEPS,
    NEARLY,
    OUTLIERS,
    SAFETY,
    SAME_SIDE,
    SEARCHES,
    SLIGHT,
    STABILITY,
    STABLE,
)
from .recording import Recording
from .step_functions import BufferedFunction, StepFunctions, Steps


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
        functions = (system.input, system.dynamics, system.quadrature, system.projection, system.switching)
        self.step_functions = Steps(cache.get_or_create(("stepwise", *functions), partial(StepFunctions, system)))
        self.switching = BufferedFunction(simplified(system.switching)) if system.switches else None
        self.event = None if watched is None else BufferedFunction(simplified(watched.function))
        self.halted = threading.Event()

    @property
    def is_current(self) -> bool:
        """True if it runs the best code that there is."""
        return True

    def halt(self) -> None:
        """End the call that runs in another thread at the end of its step, and any later one."""
        self.halted.set()

    def advance(self, s: Stretch, progress: Progress) -> Reached:
        """Integrate over a stretch; `progress` goes on."""
        return _StretchRun(self, s, progress).run()

    def complete(
        self, times: np.ndarray, x: np.ndarray, channels: np.ndarray, p: np.ndarray, levels: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Accelerations (k, n), multipliers (k, m) and inputs (k, n_u) at states by row."""
        s, count = self.system, times.size
        if not count:
            return np.zeros((0, s.coordinates)), np.zeros((0, s.multipliers)), np.zeros((0, s.inputs))
        a, lam, u = self.step_functions.functions.complete_rows.rows(times[:, None], x, channels, p, levels)
        return a, lam, u


@dataclass
class _Bracket:
    """The first zero of what switches in a step.

    Attributes
    ----------
    start, before, beyond : numpy.ndarray
        Quantities that switch, at the start and at the ends of steps of both lengths.
    low, high : float
        Lengths of a step that ends before the zero, and of one that passes it; or 0, s.
    left : float
        From the end of the step to the zero, if that is near; else 0, s.
    error : float
        Error of the last trial, relative to the tolerances.
    trials : int
        Trials to come near to the zero.
    """

    start: np.ndarray
    before: np.ndarray
    beyond: np.ndarray
    low: float = 0.0
    high: float = 0.0
    left: float = 0.0
    error: float = 0.0
    trials: int = 0


class _StretchRun:
    """One stretch, step by step."""

    def __init__(self, owner: StepwiseRun, s: Stretch, progress: Progress):
        steps, system = owner.step_functions, owner.system
        self._f, self._system, self._watched, self._event = steps, system, owner.watched, owner.event
        self._switching = owner.switching
        self._halt, self.s, self.progress = owner.halted, s, progress
        self.n, self.n_x = system.coordinates, system.size
        self.n_y = self.n_x + system.integrals
        self._across, self._passed = progress.across, progress.passed
        self.status, self.steps, self.rejected, self.evaluations = Status.DONE, 0, 0, 0
        self.least_regularity, self._hint = np.inf, np.inf
        self.recording = Recording(steps, system, s)
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
            f.rate_sum[0] = f.k[STAGES, : self.n_x].sum()
        return correction <= DRIFT and math.isfinite(float(f.rate_sum[0]))

    def _prepare_dense(self) -> None:
        self._f.dense.evaluate()
        self.evaluations += 3

    def _look_inside(self, h: float, arrival: float) -> float:
        """Prepare the dense output of a step if it is needed; the error that stages show which no estimate contains."""
        s = self.s
        self._inside = self.recording.times[self.recording.reached] < arrival
        self._samples = 0
        if self._event is not None or s.keep_samples:
            self._samples = SAMPLES
            if h > s.spacing * (SAMPLES + 1):
                self._samples = int(min(np.ceil(h / s.spacing), MOST_SAMPLES))
        if not (self._inside or self._samples):
            return 0.0
        self._prepare_dense()
        if self._switching is None:
            return 0.0
        k = self._f.known[2:]
        changes = [h * self._norm(rate[: self.n_x] - k[0, : self.n_x], self._f.scale) for rate in k[1:]]
        return max(changes[:4] + changes[STAGES:]) / (1.0 + OUTLIERS * max(changes[4:STAGES]))

    # --- switches ------------------------------------------------------------------------------
    def _switches(self, t: float, y: np.ndarray) -> np.ndarray:
        """Quantities at whose zeros the equations switch."""
        if self._switching is None:
            return np.zeros(0)
        n = self.n
        values: np.ndarray = self._switching(t, y[:n], y[n : 2 * n], y[2 * n : self.n_x], self.s.p)[0].copy()
        return values

    def _first_zero(self, before: np.ndarray, after: np.ndarray) -> float:
        """Part of the way between two ends at which the first quantity is zero that changes its sign; else infinite."""
        least = SAME_SIDE * max(1.0, float(np.max(np.abs(self._f.y[: self.n_x]))))
        passed = (np.minimum(np.abs(before), np.abs(after)) > least) & ((before > 0) != (after > 0))
        before, after = before[passed], after[passed]
        return float(np.min(before / (before - after), initial=np.inf))

    def _length_to_switch(self, t: float, h: float, at: _Bracket) -> float:
        """Length with which a step that passes a zero, or ends far before it, is tried again; 0 if it may stay."""
        if not math.isfinite(at.error):
            return 0.0
        self._now = now = self._switches(t + h, self._f.end)
        passes = self._first_zero(at.start, now) <= 1.0
        if passes or t - self._passed < h:
            at.error *= DOUBT
        if self._across and at.error < 1.0 if passes else at.high == 0.0:
            return 0.0
        if not passes and at.error >= 1.0:  # not the switch limits the step
            at.before, at.low, at.high = at.start, 0.0, 0.0
            return 0.0
        at.trials += 1
        if at.trials > SEARCHES:
            return 0.0
        if passes:
            at.beyond, at.high = now, h
        else:
            at.before, at.low = now, h
        between = at.high - at.low
        left = self._first_zero(at.before, at.beyond) * between
        if not passes and (left <= NEARLY * h or left > between):  # near to the zero, or there by rounding
            at.left = 2.0 * min(left, NEARLY * h)
            return 0.0
        if left > between:  # a step of this length ends at the zero, up to rounding
            return at.low
        return at.low + (left * (1.0 - BEFORE) if at.trials % 3 else between / 2.0)

    # --- events --------------------------------------------------------------------------------
    def _values(self, t: float, y: np.ndarray) -> np.ndarray:
        assert self._event is not None and self._watched is not None
        n, s, system = self.n, self.s, self._system
        if self._watched.needs_dynamics:
            a, lam, u = self._f.complete(t, y[: self.n_x], self._f.held[2], s.p, s.levels)
        else:
            a, lam, u = np.zeros(n), np.zeros(system.multipliers), np.zeros(system.inputs)
        values = self._event(t, y[:n], y[n : 2 * n], a, y[2 * n : self.n_x], lam, u, s.p)
        return values[0].copy()

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
            candidate |= may_touch(t0, f0 - s.offset, t1, f1 - s.offset, t, moved)
        candidate &= known
        self._sign = np.where(known & (now != 0), now, self._sign)
        self._seen = [*self._seen[-1:], (t, values)]
        if not np.any(candidate):
            return 0
        return 3 if np.any(candidate & watched.decides) else 1

    def _found_in_step(self, t: float, h: float, arrival: float, samples: int) -> int:
        """Look at the events in a step."""
        events, parts = 0, np.arange(1, samples + 1) / (samples + 1)
        times, states = [*(t + parts * h).tolist(), arrival], [*self._f.inside(parts), self._f.next]
        for time, state in zip(times, states, strict=True):
            events |= self._look(time, self._values(time, state))
        return events

    def _returned(self) -> Reached:
        times, index, rows, complete = self.recording.states()
        return Reached(
            times,
            rows[:, : self.n_x].copy(),
            rows[:, self.n_x :].copy(),
            index,
            self.status if complete else Status.APART,
            self.steps,
            self.rejected,
            self.evaluations,
            self.least_regularity,
        )

    # --- the stretch -------------------------------------------------------------------------------
    def run(self) -> Reached:
        """Integrate over the stretch, or up to where something must be decided."""
        s, progress, record = self.s, self.progress, self.recording
        t = s.start
        f, times, count = self._f, record.times, s.times.size
        if not self._begin(t):
            return self._returned()
        step, stop = progress.step, 0
        while record.reached < count:
            while stop < count - 1 and (stop < record.reached or not s.stops[stop]):
                stop += 1
            end = times[stop]
            if step <= 0.0:
                step, progress.last_step = self._first_step(t, f.y, f.k0, min(end - t, s.max_step)), 0.0
            taken = self._step(t, end, min(step, s.max_step))
            if taken is None:
                break
            h, arrival, step = taken
            self._look_back(t, h, arrival)
            if self.status == Status.DONE:
                self._look_for_pause()
            due = record.arrive(arrival, f.next, keep=s.every_step or self.status != Status.DONE)
            t, f.y[:] = arrival, f.next
            if self.status != Status.DONE:
                break
            if due and record.reached < count and s.stops[record.reached - 1]:
                f.hold(s.channels[record.reached])
                f.k0[:] = self._rate(t, f.y)
            else:
                f.k0[:] = f.k[STAGES]
        if self.status.is_failure and t > record.last_time:
            record.add(t, f.y, -1)
        if self.status in (Status.PAUSED, Status.HALTED, Status.STIFF) and record.is_complete:
            self.status = Status.DONE
        progress.step, progress.across, progress.passed = step, self._across, self._passed
        return self._returned()

    def _begin(self, t: float) -> bool:
        """Evaluate all at the start; False if it has no rate."""
        f = self._f
        f.y[: self.n_x], f.y[self.n_x :] = self.s.x, 0.0
        f.k0[:] = self._rate(t, f.y)
        if not np.all(np.isfinite(f.k0[: self.n_x])):
            self.status = Status.NOT_FINITE
            return False
        if self._event is not None:
            self._watch_from(t)
        self._now, self._near_steps = self._switches(t, f.y), 0
        return True

    def _look_for_pause(self) -> None:
        """Take note of a reason to come back between two steps."""
        s = self.s
        if self._halt.is_set():
            self.status = Status.HALTED
        elif 0 < s.most_steps <= self.steps:
            self.status = Status.PAUSED

    def _step(self, t: float, end: float, step: float) -> tuple[float, float, float] | None:
        """Take a step: its length, its end and the length of the next one; None if it goes no further."""
        repeated, at = False, None if self._switching is None else _Bracket(self._now, self._now, self._now)
        h, arrival, clipped = _clipped(t, end, step)
        while True:
            self._hint = np.inf
            error, length = self._attempt(t, h), 0.0
            if at is not None:
                at.error = error
                length, error = self._length_to_switch(t, h, at), at.error
            if length == 0.0 and error < 1.0 and self._arrive(arrival):
                outlying = self._look_inside(h, arrival)
                if not outlying > 1.0:
                    break
                assert at is not None
                error, at.before, at.low, at.high, at.left = outlying, at.start, 0.0, 0.0, 0.0
            self.rejected += 1
            clipped = False
            if length > 0.0:
                h, arrival = length, t + length
                continue
            repeated = True
            too_large = math.isfinite(error) and error >= 1.0
            h *= max(LEAST, SAFETY * error ** (-1.0 / EXPONENT)) if too_large else LEAST
            arrival = t + h
            if not h > 10.0 * abs(math.nextafter(t, math.inf) - t):
                failed = Status.APART if error < 1.0 else Status.TOO_SMALL
                self.status = failed if math.isfinite(error) else Status.NOT_FINITE
                return None
        self.steps += 1
        factor = self._growth(h, error)
        following = h * (min(factor, 1.0) if repeated else factor)
        following = max(following, step) if clipped else following
        self.progress.eigenvalue = known = max(float(self._f.eigenvalue[0]), FADING * self.progress.eigenvalue)
        following = min(following, STABLE / known) if known > 0.0 else following
        left = 0.0 if at is None else at.left
        if left > 0.0:
            following = left
        elif self._across:  # beyond the switch the motion is another one
            self._passed, following = t, 0.0
        self._across = left > 0.0
        return h, arrival, following

    def _growth(self, h: float, error: float) -> float:
        """Factor from a step to the next one, by its error and the change of that since the last one (Gustafsson)."""
        progress, gain = self.progress, error ** (-1.0 / EXPONENT) if error > 0.0 else math.inf
        factor = min(MOST, SAFETY * gain)
        if progress.last_step > 0.0:
            factor = min(factor, max(LEAST, SAFETY * gain * gain / progress.last_gain * h / progress.last_step))
        progress.last_step, progress.last_gain = h, min(gain, MOST_GAIN)
        return factor

    def _look_back(self, t: float, h: float, arrival: float) -> None:
        """Stiffness, events and singular poses of a step, and the outputs inside it."""
        s, inside, samples, events = self.s, self._inside, self._samples, 0
        self._note_stiffness(h)
        if self._event is not None:
            events = self._found_in_step(t, h, arrival, samples)
        if self._system.multipliers and s.fall > 0.0:
            events |= self._note_fall()
        kept = (samples or (SAMPLES if events else 0)) if events or s.keep_samples else 0
        if kept and not inside and not samples:
            self._prepare_dense()
        if events & 2:
            self.status = Status.EVENT
        if inside or kept:
            self.recording.add_inside(t, h, arrival, kept)

    def _note_stiffness(self, h: float) -> None:
        s, progress = self.s, self.progress
        if not s.stiff_after:
            return
        if h * progress.eigenvalue > STABILITY:
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


def _clipped(t: float, end: float, step: float) -> tuple[float, float, bool]:
    """Length and end of a step that does not go beyond a time, nor leave a tiny one to it; True if it was cut."""
    if t + 1.01 * step >= end:
        return end - t, end, True
    if t + 2.0 * step > end:
        return (end - t) / 2.0, t + (end - t) / 2.0, True
    return step, t + step, False
