"""Steps of a motion between its outputs: polynomials that meet the equations of motion.

Outputs lie at times of the user, whatever happens between them. When somebody asks there, the polynomials through
the outputs are held against the equations of motion; where they miss these, the motion is integrated again from the
output before, with as many knots as the polynomials between them need.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np

from ..errors import MechanismError
from .interpolation import cubic_step, quintic_step
from .state import Arrays

#: Error of the polynomials of a step, in tolerances of the run: its outputs are off by more than that.
WITHIN = 10.0
#: Points of a step at which its rates are held against the equations, and the slope of ``s² (1 - s)²`` at the first.
LOOKS, BENDS = np.array([0.2, 0.5, 0.8]), 0.192
#: Error of what is integrated by the defect of its rate and the length of the step: of ``s² (1 - s)² (1 - 2 s)``.
BY_RATE = 0.28
#: Integral of ``s² (1 - s)²``.
AREA = 1 / 30
#: Parts into which a step is divided at once, at most, and over those that its error asks for: powers of two, as an
#: integrator of CasADi is made for each pattern of outputs. Steps below this share of the motion are not divided.
MOST_PARTS, MARGIN, SHORTEST = 16, 1.2, 1e-9
#: Steps that are integrated again together, at most: each start of a method costs, and a motion that goes on for long
#: parts from the stored one by the error of the run (measured: from 20 on nothing is gained).
TOGETHER = 20
#: Outputs whose steps are kept together, and so integrated again together, at most.
BLOCK = 256
#: Difference from a stored state, in tolerances of the run, from which a motion that is integrated again has parted
#: from the one that was stored: it starts anew from there.
PARTED = 1000.0
#: Length of a step, in that of the motion, below which it may hold a jump of forces that no method passes.
JUMP = 1e-6
#: What keeps a division by no tolerance of nothing from failing.
TINY = 1e-300
#: Roundings of a time by which equations are evaluated beside their jump, as runs do.
BESIDE = 8


class States(NamedTuple):
    """Coordinates, velocities and first-order states by row."""

    q: np.ndarray
    v: np.ndarray
    z: np.ndarray

    def at(self, rows: np.ndarray | slice) -> States:
        """Some of them."""
        return States(*(x[rows] for x in self))


class Places(NamedTuple):
    """Instants of a motion (k,).

    Attributes
    ----------
    span : numpy.ndarray of int
        Number of the span in which the equations hold.
    t : numpy.ndarray
        Times, s.
    since : numpy.ndarray
        Times from which on inputs that are given by intervals hold, s.
    """

    span: np.ndarray
    t: np.ndarray
    since: np.ndarray


class Stretch(NamedTuple):
    """A part of a span that is to be integrated again, from a state at its start to later times (k,)."""

    span: int
    start: float
    state: States
    times: np.ndarray


class Spans(NamedTuple):
    """Knots of a motion, span after span; nothing but the motion takes place within a span.

    Attributes
    ----------
    number : numpy.ndarray of int
        Span of each knot (k,).
    t : numpy.ndarray
        Times (k,), s; the end of a span is the start of the next one.
    states : States
        By row.
    """

    number: np.ndarray
    t: np.ndarray
    states: States


class Interpolation(ABC):
    """The motion between the outputs of a trajectory."""

    @abstractmethod
    def at(self, times: np.ndarray) -> Arrays:
        """Return ``q, v, a, z, lam, u`` at times within the span of the motion, by row; at a jump those before it."""

    @abstractmethod
    def knots(self, start: float, end: float) -> np.ndarray:
        """Return times from one to another between which everything is smooth, s; both sides of each jump."""

    def by_mode(self) -> list[Any]:
        """Return the parts in one mode of exact friction and contacts each, see :class:`RunAgain`; none if unknown."""
        return []


class Continuation(ABC):
    """The equations by which a motion goes on between its outputs, and what integrates them again.

    Attributes
    ----------
    reltol, abstol : float
        Tolerances of the motion.
    size : numpy.ndarray
        Sizes (n,) by which errors of coordinates compare with each other.
    breaks : numpy.ndarray
        Times inside spans at which the equations or inputs change, s.
    """

    reltol: float
    abstol: float
    size: np.ndarray
    breaks: np.ndarray

    @abstractmethod
    def spans(self) -> Spans:
        """Return the knots that are known: the outputs, and the ends of spans."""

    @abstractmethod
    def rates(self, places: Places, states: States) -> tuple[np.ndarray, np.ndarray]:
        """Return accelerations (k, n) and rates of first-order states (k, n_z) at states."""

    @abstractmethod
    def on_constraints(self, places: Places, states: States) -> States:
        """Return states on the constraints near to others."""

    @abstractmethod
    def complete(self, places: Places, states: States) -> Arrays:
        """Return ``q, v, a, z, lam, u`` on the constraints at states near to them."""

    def by_mode(self) -> list[Any]:
        """Return the parts in one mode of exact friction and contacts each; none if there are none."""
        return []

    @abstractmethod
    def again(self, stretches: Sequence[Stretch]) -> list[States]:
        """Return the states of stretches at their times, or at those before the motion could not be followed."""


class _Knots(NamedTuple):
    """Knots (k,) of a stretch that are joined to known states: where it starts, and what follows.

    Those that are known are `stored`, and `joined` are the changes of rates by which the others are joined to these.
    """

    span: int
    start: float
    first: States
    times: np.ndarray
    states: States
    stored: np.ndarray
    joined: np.ndarray


@dataclass
class _Steps:
    """Steps that follow each other, each by row: its start and end, states and their rates there.

    Coordinates follow polynomials of degree five through q, v and a; the vectors ``w = (v, z)`` polynomials of degree
    four through w and its rate, with a bend by which their rates meet the equations inside: coordinates that are off by
    the tolerance of the run do not make velocities rough.
    """

    span: np.ndarray
    t0: np.ndarray
    t1: np.ndarray
    q0: np.ndarray
    w0: np.ndarray
    rate0: np.ndarray
    q1: np.ndarray
    w1: np.ndarray
    rate1: np.ndarray
    bend: np.ndarray
    #: True between states that were stored
    stored: np.ndarray
    #: changes of rates by which steps were joined to stored states
    joined: np.ndarray
    #: True if the polynomials are known to meet the equations
    good: np.ndarray

    def replaced(self, places: np.ndarray, others: _Steps) -> _Steps:
        """These steps with others in the place of some."""
        kept = np.ones(self.t0.size, bool)
        kept[places] = False
        order = np.argsort(np.r_[self.t0[kept], others.t0], kind="stable")
        return _Steps(
            *(np.concatenate([getattr(self, f.name)[kept], getattr(others, f.name)])[order] for f in fields(_Steps))
        )

    def states(self, k: np.ndarray, t: np.ndarray) -> tuple[States, np.ndarray]:
        """States at times in steps, and the rates of velocities and first-order states."""
        h = (self.t1 - self.t0)[k, None]
        s = np.clip((t[:, None] - self.t0[k, None]) / h, 0, 1)
        n = self.q0.shape[1]
        (v0, a0), (v1, a1) = ((w[k, :n], r[k, :n]) for w, r in ((self.w0, self.rate0), (self.w1, self.rate1)))
        q, _ = quintic_step(s, h, self.q0[k], v0, a0, self.q1[k], v1, a1)
        w, rate = cubic_step(s, h, self.w0[k], self.rate0[k], self.w1[k], self.rate1[k])
        w, rate = w + self.bend[k] * (s * (1 - s)) ** 2, rate + self.bend[k] * 2 * s * (1 - s) * (1 - 2 * s) / h
        return States(q, w[:, :n], w[:, n:]), rate

    def start(self, k: int) -> States:
        """State at the start of a step."""
        n = self.q0.shape[1]
        return States(self.q0[k], self.w0[k, :n], self.w0[k, n:])

    def ends(self, k: np.ndarray) -> States:
        """States at the ends of steps."""
        n = self.q1.shape[1]
        return States(self.q1[k], self.w1[k, :n], self.w1[k, n:])

    def holding(self, times: np.ndarray) -> np.ndarray:
        """Numbers of the steps in which times lie, of two those that end there."""
        return np.clip(np.searchsorted(self.t1, times, side="left"), 0, self.t1.size - 1)


class Refined(Interpolation):
    """Steps through the outputs of a motion, divided where somebody asks and polynomials miss the equations.

    Parameters
    ----------
    motion : Continuation
        The equations between the outputs.
    t : numpy.ndarray
        Times of the outputs, s.
    arrays : tuple of numpy.ndarray
        ``q, v, a, z, lam, u`` there.
    """

    def __init__(self, motion: Continuation, t: np.ndarray, arrays: Arrays):
        self._motion, self._t, self._arrays = motion, t, arrays
        length, latest = (float(np.ptp(t)), float(np.max(np.abs(t)))) if t.size else (0.0, 0.0)
        self._shortest = max(SHORTEST * length, 4 * BESIDE * float(np.spacing(latest)))
        self._spans: Spans | None = None
        self._blocks: dict[int, _Steps] = {}

    def by_mode(self) -> list[Any]:
        return self._motion.by_mode()

    # --- the motion at times ---------------------------------------------------------------------
    def at(self, times: np.ndarray) -> Arrays:
        stored = np.clip(np.searchsorted(self._t, times), 0, self._t.size - 1)
        is_stored = self._t[stored] == times
        results = [x[stored] for x in self._arrays]
        if not is_stored.all():
            for result, values in zip(results, self._between(times[~is_stored]), strict=True):
                result[~is_stored] = values
        q, v, a, z, lam, u = results
        return q, v, a, z, lam, u

    def _between(self, times: np.ndarray) -> Arrays:
        if self._t.size == 1 or not self._known.t.size:
            return self._at_only_state(times)
        owner = self._block_of(times)
        spans, moments, since = np.zeros(times.size, int), times.copy(), times.copy()
        shapes = [x.shape[1] for x in (self._known.states)]
        states = States(*(np.zeros((times.size, n)) for n in shapes))
        for number in np.unique(owner):
            rows = np.flatnonzero(owner == number)
            steps = self._refined(int(number), times[rows])
            k = steps.holding(times[rows])
            for whole, part in zip(states, steps.states(k, times[rows])[0], strict=True):
                whole[rows] = part
            for whole, part in zip((spans, moments, since), self._places(steps, k, times[rows]), strict=True):
                whole[rows] = part
        return self._motion.complete(Places(spans, moments, since), states)

    def _at_only_state(self, times: np.ndarray) -> Arrays:
        q, v, a, z, lam, u = (np.repeat(x[:1], times.size, axis=0) for x in self._arrays)
        return q, v, a, z, lam, u

    def knots(self, start: float, end: float) -> np.ndarray:
        if self._t.size == 1 or not self._known.t.size:
            return np.unique([start, end])
        first, last = self._block_of(np.array([start, end]))
        found = [np.array([start, end])]
        for number in range(int(first), int(last) + 1):
            bounds = self._known.t[number * BLOCK], self._known.t[min((number + 1) * BLOCK, self._known.t.size - 1)]
            steps = self._refined(number, None, max(start, bounds[0]), min(end, bounds[1]))
            jumps = np.flatnonzero(np.diff(steps.span, prepend=self._known.number[number * BLOCK]))
            found += [steps.t0, steps.t1, np.nextafter(steps.t0[jumps], np.inf)]
        times = np.unique(np.concatenate(found))
        return times[(times >= start) & (times <= end)]

    # --- steps ------------------------------------------------------------------------------------
    @property
    def _known(self) -> Spans:
        if self._spans is None:
            self._spans = self._motion.spans()
        return self._spans

    def _block_of(self, times: np.ndarray) -> np.ndarray:
        """Number of the block of steps in which times lie."""
        places = np.clip(np.searchsorted(self._known.t, times, side="left") - 1, 0, self._known.t.size - 2)
        owner: np.ndarray = places // BLOCK
        return owner

    def _block(self, number: int) -> _Steps:
        """Steps through stored states."""
        if number not in self._blocks:
            known = self._known
            ends = np.arange(number * BLOCK, min((number + 1) * BLOCK, known.t.size - 1))
            ends = ends[(known.number[ends] == known.number[ends + 1]) & (known.t[ends + 1] > known.t[ends])]
            self._blocks[number] = self._through(
                known.number[ends], known.t[ends], known.t[ends + 1], known.states.at(ends), known.states.at(ends + 1)
            )
        return self._blocks[number]

    def _through(
        self,
        span: np.ndarray,
        t0: np.ndarray,
        t1: np.ndarray,
        first: States,
        last: States,
        joined: np.ndarray | None = None,
    ) -> _Steps:
        """Steps between states, with the rates that these have in the step."""
        rates = [
            np.hstack(self._motion.rates(Places(span, *self._moments(span, t0, t1, t)), states))
            for t, states in ((t0, first), (t1, last))
        ]
        w0, w1 = (np.hstack([states.v, states.z]) for states in (first, last))
        stored, good = np.full(span.size, joined is None), np.zeros(span.size, bool)
        joined = np.zeros_like(w0) if joined is None else joined
        ends = first.q, w0, rates[0], last.q, w1, rates[1]
        return _Steps(span, t0, t1, *ends, np.zeros_like(w0), stored, joined, good)

    def _moments(
        self, span: np.ndarray, t0: np.ndarray, t1: np.ndarray, t: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Times as the equations take them, off the jumps at the ends of spans, and since when inputs hold there."""
        known, breaks = self._known, self._motion.breaks
        first = np.searchsorted(known.number, span, side="left")
        last = np.searchsorted(known.number, span, side="right")
        begin, end = known.t[first], known.t[last - 1]
        off = np.minimum(BESIDE * np.spacing(np.maximum(np.abs(begin), np.abs(end))), (end - begin) / 4)
        inside = np.clip(t, np.where(first > 0, begin + off, begin), np.where(last < known.t.size, end - off, end))
        since = t0.copy()
        if breaks.size:
            k = np.searchsorted(breaks, t - self._shortest / 4, side="left") - 1
            since = np.where(k >= 0, np.maximum(breaks[np.maximum(k, 0)], t0), t0)
        return inside, since

    def _places(self, steps: _Steps, k: np.ndarray, times: np.ndarray) -> Places:
        """Instants in steps."""
        return Places(steps.span[k], *self._moments(steps.span[k], steps.t0[k], steps.t1[k], times))

    def _refined(self, number: int, times: np.ndarray | None, start: float = -np.inf, end: float = np.inf) -> _Steps:
        """The steps of a block, good ones at times or, without these, between two times."""
        steps = self._block(number)
        while True:
            asked = ~steps.good
            if times is not None:
                asked = np.zeros(steps.t0.size, bool)
                asked[steps.holding(times)] = True
                asked &= ~steps.good
            else:
                asked &= (steps.t1 > start) & (steps.t0 < end)
            open_ = np.flatnonzero(asked)
            if not open_.size:
                self._blocks[number] = steps
                return steps
            error = self._errors(steps, open_)
            steps.good[open_[error <= 1]] = True
            bad = error > 1
            if bad.any():
                steps = self._divided(steps, open_[bad], error[bad])

    def _errors(self, steps: _Steps, which: np.ndarray) -> np.ndarray:
        """Bend some steps as their rates ask for; error of their polynomials, in that which is tolerated.

        The shortest ones have none.
        """
        h, n, size = (steps.t1 - steps.t0)[which, None], steps.q0.shape[1], self._motion.size
        k = np.repeat(which, LOOKS.size)
        t = steps.t0[k] + np.tile(LOOKS, which.size) * (steps.t1 - steps.t0)[k]
        steps.bend[which] = 0.0
        states, rate = steps.states(k, t)
        exact = np.hstack(self._motion.rates(self._places(steps, k, t), states))
        early, middle, late = np.moveaxis((exact - rate).reshape(which.size, LOOKS.size, -1), 1, 0)
        steps.bend[which] = h * (early - late) / (2 * BENDS)
        defect = np.maximum(np.abs(middle), np.abs(early + late) / 2)
        missed = BY_RATE * h * np.maximum(defect - steps.joined[which], 0)
        # where a motion went between stored states, by its velocities; near each other states are off by the tolerance
        v0, v1, a0, a1 = (x[which, :n] for x in (steps.w0, steps.w1, steps.rate0, steps.rate1))
        travel = h * ((v0 + v1) / 2 + h * (a0 - a1) / 12 + AREA * steps.bend[which, :n])
        off = np.where(steps.stored[which, None], np.abs(steps.q1[which] - steps.q0[which] - travel), 0.0)
        worst = np.zeros(which.size)
        for error, first, last, sizes in (
            (off, steps.q0, steps.q1, size),
            (missed[:, :n], steps.w0[:, :n], steps.w1[:, :n], size),
        ):  # constraints pass errors on from one coordinate to the others
            allowed = self._tolerance(np.maximum(np.abs(first[which]), np.abs(last[which]))) / sizes
            worst = np.maximum(worst, np.max(error / sizes, axis=1, initial=0.0) / np.max(allowed, axis=1, initial=0.0))
        z = np.maximum(np.abs(steps.w0[which, n:]), np.abs(steps.w1[which, n:]))
        worst = np.maximum(worst, np.max(missed[:, n:] / self._tolerance(z), axis=1, initial=0.0)) / WITHIN
        worst = np.nan_to_num(worst, nan=np.inf)
        worst = np.where(self._has_break(steps, which), np.maximum(worst, 2.0), worst)
        worst[h[:, 0] <= self._shortest] = 0.0
        return worst

    def _tolerance(self, values: np.ndarray) -> np.ndarray:
        """Tolerance of the run at values."""
        return self._motion.reltol * np.abs(values) + self._motion.abstol

    def _has_break(self, steps: _Steps, which: np.ndarray) -> np.ndarray:
        """True for steps inside which equations or inputs change."""
        breaks, off = self._motion.breaks, self._shortest / 2
        low, high = (np.searchsorted(breaks, x) for x in (steps.t0[which] + off, steps.t1[which] - off))
        return high > low

    def _divided(self, steps: _Steps, bad: np.ndarray, error: np.ndarray) -> _Steps:
        """Steps with some of them divided: the motion in them is integrated again."""
        parts = np.clip(2.0 ** np.ceil(np.log2(MARGIN * np.minimum(error, 1e12) ** 0.2)), 2, MOST_PARTS).astype(int)
        ends = np.flatnonzero((np.diff(bad) > 1) | (np.diff(steps.span[bad]) != 0)) + 1
        groups = np.split(np.arange(bad.size), ends)
        groups = [g[i : i + TOGETHER] for g in groups for i in range(0, g.size, TOGETHER)]
        stretches = []
        for group in groups:
            first, span = int(bad[group[0]]), int(steps.span[bad[group[0]]])
            inner = [self._division(steps, int(bad[j]), int(parts[group].max())) for j in group]
            times = np.concatenate([np.r_[some, steps.t1[bad[j]]] for some, j in zip(inner, group, strict=True)])
            stretches.append(Stretch(span, float(steps.t0[first]), steps.start(first), times))
        replaced, others = [], []
        for group, stretch, states in zip(groups, stretches, self._motion.again(stretches), strict=True):
            if not len(states.q):
                self._leave(steps, int(bad[group[0]]))
                continue
            count, divided = self._joined(steps, bad[group], stretch, states)
            replaced.append(bad[group][:count])
            others.append(divided)
        if not others:
            return steps
        return steps.replaced(np.concatenate(replaced), self._between_knots(others))

    def _between_knots(self, stretches: list[_Knots]) -> _Steps:
        """Steps between knots of stretches, once these are on the constraints, which weights leave by second order."""
        spans = np.concatenate([np.full(one.times.size, one.span) for one in stretches])
        starts = np.concatenate([np.r_[one.start, one.times[:-1]] for one in stretches])
        times, joined, stored = (
            np.concatenate([getattr(one, name) for one in stretches]) for name in ("times", "joined", "stored")
        )
        last = States(*(np.concatenate(parts) for parts in zip(*(one.states for one in stretches), strict=True)))
        inner = np.flatnonzero(~stored)
        if inner.size:
            places = Places(spans, *self._moments(spans, starts, times, times))
            projected = self._motion.on_constraints(Places(*(x[inner] for x in places)), last.at(inner))
            for whole, part in zip(last, projected, strict=True):
                whole[inner] = part
        begin = np.cumsum([0, *(one.times.size for one in stretches[:-1])])
        first = States(*(np.roll(whole, 1, axis=0) for whole in last))
        for whole, parts in zip(first, zip(*(one.first for one in stretches), strict=True), strict=True):
            whole[begin] = parts
        return self._through(spans, starts, times, first, last, joined)

    def _leave(self, steps: _Steps, k: int) -> None:
        """Leave a very short step as it is, from whose start the motion cannot be integrated: forces jump in it.

        Raises
        ------
        MechanismError
            For a longer one.
        """
        if steps.t1[k] - steps.t0[k] > JUMP * np.ptp(self._t):
            raise MechanismError(
                f"the motion between t = {steps.t0[k]:.9g} and {steps.t1[k]:.9g} s cannot be integrated again; "
                "simulate with outputs there"
            )
        steps.good[k] = True

    def _division(self, steps: _Steps, k: int, parts: int) -> np.ndarray:
        """Times at which a step is divided: evenly, and where equations or inputs change."""
        start, end, breaks = steps.t0[k], steps.t1[k], self._motion.breaks
        times = start + (end - start) * np.arange(1, parts) / parts
        inside = breaks[(breaks > start + self._shortest / 2) & (breaks < end - self._shortest / 2)]
        if inside.size:
            near = np.abs(times[:, None] - inside[None, :]).min(axis=1) <= self._shortest
            times = np.union1d(times[~near], inside)
        return times

    def _joined(self, steps: _Steps, bad: np.ndarray, stretch: Stretch, states: States) -> tuple[int, _Knots]:
        """Return how many of some steps are divided by a stretch, and the knots in their place.

        These are joined to the stored states; from where they have parted too far from these on, nothing is divided.
        """
        ends, reached, times = np.searchsorted(stretch.times, steps.t1[bad]), len(states.q), stretch.times
        if reached < times.size and not (ends < reached).any():
            # it stopped inside the first step, of which the rest is one step
            bad, ends, times = bad[:1], np.array([reached]), np.r_[times[:reached], steps.t1[bad[:1]]]
            states = States(*(np.vstack([x, y]) for x, y in zip(states, steps.ends(bad), strict=True)))
        bad, ends = bad[ends < len(states.q)], ends[ends < len(states.q)]
        stored = steps.ends(bad)
        off = States(*(known - found[ends] for known, found in zip(stored, states, strict=True)))
        apart = np.zeros(bad.size)
        for values, missed, sizes in zip(stored, off, (self._motion.size, self._motion.size, 1.0), strict=True):
            allowed = np.max(self._tolerance(values) / sizes, axis=1, initial=0.0)
            apart = np.maximum(apart, np.max(np.abs(missed) / sizes, axis=1, initial=0.0) / (allowed + TINY))
        parted = np.flatnonzero(apart > PARTED)
        count = bad.size if not parted.size else max(int(parted[0]), 1)
        used = int(ends[count - 1]) + 1
        times = times[:used]
        step = np.searchsorted(ends[:count], np.arange(used))  # the stored one of each knot
        share = (times - steps.t0[bad[step]]) / (steps.t1 - steps.t0)[bad[step]]
        weight = (share**2 * (3 - 2 * share))[:, None]
        joined = []
        for found, missed in zip(states, off, strict=True):
            before = np.vstack([np.zeros((1, missed.shape[1])), missed])
            joined.append(found[:used] + before[step] + weight * (missed - before[:-1])[step])
        last = States(*joined)
        for whole, known in zip(last, stored, strict=True):
            whole[ends[:count]] = known[:count]
        is_stored = np.zeros(used, bool)
        is_stored[ends[:count]] = True
        length = (steps.t1 - steps.t0)[bad, None]
        change = np.abs(np.diff(np.hstack([off.v, off.z]), axis=0, prepend=0.0))
        changed = (2 * change / length + steps.joined[bad])[step]
        return count, _Knots(stretch.span, stretch.start, stretch.state, times, last, is_stored, changed)


class Direct(Interpolation):
    """A motion that is known at any time.

    Parameters
    ----------
    function : callable
        ``times -> (q, v, a, z, lam, u)`` by row.
    along : numpy.ndarray or motion
        Times between which everything is smooth, s, or a motion that has them as its ``knots``.
    """

    def __init__(self, function: Callable[[np.ndarray], Arrays], along: Any):
        self._function, self._along = function, along

    def at(self, times: np.ndarray) -> Arrays:
        return self._function(times)

    def knots(self, start: float, end: float) -> np.ndarray:
        times = np.asarray(getattr(self._along, "knots", self._along))
        return np.union1d([start, end], times[(times > start) & (times < end)])
