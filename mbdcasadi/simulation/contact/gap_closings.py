"""Contacts and stops that close between two steps of an integrator, which leaves no trace in them.

They are found on the path between the outputs: from the gaps, their rates and a
bound of these, by halving intervals until a gap is seen to close or cannot.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...numerics.roots import TO_ROUNDING, narrowed_roots
from ..path import Path, hermite_states
from ..stepper import Stepper
from .watched_terms import SHALLOW, WatchedTerms

#: Factor on rates for what they may grow by within an interval.
SAFETY = 1.5
#: Bisections in which every gap that could close by the bound of its rate is kept, at least, and bisections at most.
COARSE, MOST = 4, 40
#: Turn of a body, rad, over which gaps count as convex functions of time.
TURN = 0.4
#: Times after a closing at which the force is evaluated, relative to the time in which the outlines would pass through
#: each other: powers of one half.
GROWTH = 0.5 ** np.arange(24)[::-1]
#: Stops in the time that a force takes to stop the outlines, and such times that have stops.
PARTS, TIMES = 4, 6


@dataclass(frozen=True)
class Closing:
    """A gap that closes on a path, though no step found it closed.

    Attributes
    ----------
    owner : int
        Whose gap.
    time, duration : float
        When it closes, and for how long if nothing stops it, s.
    depth : float
        Depth that is reached on the path, m.
    """

    owner: int
    time: float
    duration: float
    depth: float


class GapClosings:
    """Watches the gaps of a mechanism along the paths of a run."""

    def __init__(self, stepper: Stepper, terms: WatchedTerms):
        self._stepper, self._terms, self.owners = stepper, terms, terms.owners

    def _table(self, path: Path, times: np.ndarray) -> np.ndarray:
        """Values on a path that the terms take (size, k)."""
        numeric = self._stepper.numeric
        return self._terms.table(times, hermite_states(path, times, numeric.eom.q.numel()), numeric.p)

    def _of(self, owner: int, path: Path, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """A gap and its rate on a path, each (k,)."""
        gaps, rates, _ = self._terms.gaps(self._table(path, times), np.full(times.size, owner))
        return gaps, rates

    def unseen(self, path: Path, known: tuple[np.ndarray, np.ndarray, np.ndarray], closed: np.ndarray) -> list[Closing]:
        """Gaps that close on a path in intervals in which no step found them closed; the first of each gap.

        Parameters
        ----------
        known : tuple of numpy.ndarray
            Gaps, their rates and bounds of these at the times of the path, each (k + 1, n).
        closed : numpy.ndarray
            For how long the steps found each gap closed, by interval (k, n), s.
        """
        if not self.owners or path.times.size < 2:
            return []
        gaps, rates, bounds = known
        length = np.diff(path.times)[:, None]
        reachable = gaps[:-1] + gaps[1:] < SAFETY * np.maximum(bounds[:-1], bounds[1:]) * length
        # what is closed where an interval begins was seen before
        rows, owners = np.nonzero(reachable & (closed == 0) & (gaps[:-1] > -SHALLOW))
        brackets = _Brackets(
            owners, path.times[rows], path.times[rows + 1], gaps[rows, owners], gaps[rows + 1, owners],
            rates[rows, owners], rates[rows + 1, owners], bounds[rows, owners], bounds[rows + 1, owners],
        )  # fmt: skip
        spans: dict[int, tuple[float, float]] = {}
        coarse = self._coarse(path) if rows.size else 0
        for level in range(MOST):
            # at the end of an interval, which is the middle of one before, or a time of the path
            for k in np.flatnonzero(brackets.gap_end < -SHALLOW):
                owner = int(brackets.owner[k])
                if brackets.end[k] < spans.get(owner, (np.inf,))[0]:
                    spans[owner] = (float(brackets.end[k]), float(brackets.start[k]))
            brackets = brackets.chosen(brackets.may_close(in_long=level < coarse))
            # of a gap that was seen to close only what is before that matters
            brackets = brackets.chosen(
                np.array(
                    [s < spans.get(int(o), (np.inf,))[0] for o, s in zip(brackets.owner, brackets.start, strict=True)],
                    bool,
                )
            )
            if not brackets.owner.size:
                break
            middle = (brackets.start + brackets.end) / 2
            values = self._terms.gaps(self._table(path, middle), brackets.owner)
            brackets = brackets.halved(middle, *values)
        return [self._located(path, owner, *inside) for owner, inside in spans.items()]

    def _coarse(self, path: Path) -> int:
        """Bisections until no body turns so far within an interval that gaps could close and open again."""
        eom = self._stepper.numeric.eom
        n = eom.q.numel()
        turning = np.max(np.abs(path.x[:, n : 2 * n][:, eom.angles]), axis=1, initial=0.0)
        turn = float(np.max(np.diff(path.times) * np.maximum(turning[:-1], turning[1:])))
        return max(COARSE, int(np.ceil(np.log2(max(turn / TURN, 1.0)))))

    def stops(self, path: Path, closing: Closing) -> np.ndarray:
        """Times after a closing that no step may cross, so that the force that arises is followed (k,)."""
        # deeper and deeper on the path, until the force would stop the outlines in the time that has passed
        since = closing.duration * GROWTH
        slopes = self._terms.gradient(closing.owner, self._table(path, closing.time + since))
        a = self._stepper.outputs.accelerations(path, closing.time + since)
        pull = np.abs(np.einsum("kn,kn->k", slopes, a))
        speed = abs(self._of(closing.owner, path, np.array([closing.time]))[1][0])
        stopped = pull * since > speed
        stopping = since[max(int(np.argmax(stopped)) - 1, 0)] if np.any(stopped) else since[-1]
        step = float(stopping) / PARTS
        return closing.time + step * np.arange(1, PARTS * TIMES + 1)

    def _located(self, path: Path, owner: int, inside: float, before: float) -> Closing:
        """Closing of a gap from a time at which it is closed, and one before."""
        bracket = np.array([before]), np.array([inside])

        def gap(times: np.ndarray) -> np.ndarray:
            return self._of(owner, path, times.ravel())[0].reshape(times.shape)

        middle = float(narrowed_roots(gap, *bracket, np.ones(1), TO_ROUNDING)[0])
        inside = float(np.nextafter(middle, np.inf))
        opened = float(np.nextafter(middle, -np.inf))
        # up to where the path is seen open again, which may have many times inside
        later = path.times[np.searchsorted(path.times, inside, side="right").clip(max=path.times.size - 1) :]
        apart = self._of(owner, path, later)[0] >= 0
        ahead = np.linspace(inside, later[int(np.argmax(apart)) if np.any(apart) else -1], 257)[1:]
        gaps = self._of(owner, path, ahead)[0]
        shut = int(np.argmax(gaps >= 0)) if np.any(gaps >= 0) else gaps.size - 1
        duration = float(ahead[shut] - opened)
        depth = float(-np.min(gaps[: shut + 1], initial=0.0))
        # a little before: what ends in the contact by rounding has seen its force
        speed = abs(self._of(owner, path, np.array([opened]))[1][0])
        margin = min(2 * SHALLOW / speed, (opened - before) / 2) if speed else 0.0
        return Closing(owner, opened - margin, duration + margin, depth)


@dataclass(frozen=True)
class _Brackets:
    """Intervals of time in which gaps may close: owner, ends, and gaps, rates and bounds there."""

    owner: np.ndarray
    start: np.ndarray
    end: np.ndarray
    gap_start: np.ndarray
    gap_end: np.ndarray
    rate_start: np.ndarray
    rate_end: np.ndarray
    bound_start: np.ndarray
    bound_end: np.ndarray

    def chosen(self, which: np.ndarray) -> _Brackets:
        """Some of them."""
        return _Brackets(*(getattr(self, name)[which] for name in self.__dataclass_fields__))

    def may_close(self, *, in_long: bool) -> np.ndarray:
        """True for each gap that may be closed somewhere inside, by its rates.

        In a short interval the gap between convex outlines is a convex function of time: it stays above
        the tangents at both ends. In a long one, whose motion may turn back, its rate is bounded.
        """
        length = self.end - self.start
        if in_long:
            bound = SAFETY * np.maximum(self.bound_start, self.bound_end)
            return self.gap_start + self.gap_end < bound * length
        down, up = SAFETY * np.maximum(-self.rate_start, 0), SAFETY * np.maximum(self.rate_end, 0)
        with np.errstate(divide="ignore", invalid="ignore"):
            lowest = (self.gap_start * up + self.gap_end * down - down * up * length) / (down + up)
        lowest = np.where((down > 0) & (up > 0), lowest, np.minimum(self.gap_start, self.gap_end))
        return (lowest < -SHALLOW) & (length * np.maximum(self.bound_start, self.bound_end) > SHALLOW)

    def halved(self, middle: np.ndarray, gap: np.ndarray, rate: np.ndarray, bound: np.ndarray) -> _Brackets:
        """Both halves of each, with the values in the middle."""
        first = (self.owner, self.start, middle, self.gap_start, gap, self.rate_start, rate, self.bound_start, bound)
        second = (self.owner, middle, self.end, gap, self.gap_end, rate, self.rate_end, bound, self.bound_end)
        return _Brackets(*(np.concatenate(pair) for pair in zip(first, second, strict=True)))
