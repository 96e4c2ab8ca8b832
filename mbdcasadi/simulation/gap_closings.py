"""Contacts and stops that close between two steps of an integrator, which leaves no trace in them.

They are found on the path between the outputs: from the gaps, their rates and a
bound of these, by halving intervals until a gap is seen to close or cannot.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..equations.numeric import NumericEquations
from ..model.mechanism import Mechanism
from ..model.rates import time_derivative
from .path import Path, hermite_states

#: Depth, m, below which outlines that just touch count as apart: rounding and the tolerances of positions.
SHALLOW = 1e-9
#: Factor on rates for what they may grow by within an interval.
SAFETY = 1.5
#: Halvings in which whatever could close by the bound of its rate is looked at; and most halvings.
COARSE, MOST = 4, 40
#: Times after a closing at which it is looked at how the force grows, in times in which outlines would pass through
#: each other: powers of a half.
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
    time, spell : float
        When it closes, and for how long if nothing stops it, s.
    depth : float
        Depth that is reached on the path, m.
    """

    owner: int
    time: float
    spell: float
    depth: float


def has_gap(element: Any) -> bool:
    """True if an element is a contact, a stop or a rope."""
    return hasattr(element, "gap") and bool(getattr(element, "smoothings", ()))


def has_gaps(mechanism: Mechanism) -> bool:
    """True if a mechanism has contacts or stops, which an integrator may jump over."""
    return any(has_gap(element) for element in mechanism.elements)


class GapClosings:
    """Watches the gaps of a mechanism along the paths of a run.

    Parameters
    ----------
    numeric : NumericEquations
        Equations at the parameters of the run.
    owners : sequence of Element
        Contacts and stops, with gaps in coordinates, parameters and time.
    """

    def __init__(self, numeric: NumericEquations, owners: Sequence[Any]):
        self._numeric, self.owners = numeric, list(owners)
        cache = numeric.eom.mechanism.cache
        self.gaps, self._slopes, self._function = cache.get_or_create(("gaps", *owners), self._functions)

    def _functions(self) -> tuple[ca.SX, ca.Function, ca.Function]:
        """Gaps, and functions for their slopes and for them with their rates and bounds of these."""
        eom = self._numeric.eom
        gaps = ca.vertcat(ca.SX(0, 1), *[e.gap for e in self.owners])
        rates = time_derivative(gaps, eom.mechanism) if gaps.numel() else gaps
        bounds = self._bounds(gaps) if gaps.numel() else gaps
        known = [eom.t, eom.q, eom.v, eom.z, eom.p]
        slopes = ca.Function("slopes", [eom.t, eom.q, eom.p], [ca.densify(ca.jacobian(gaps, eom.q))])
        return gaps, slopes, ca.Function("gaps", known, [ca.densify(ca.vertcat(gaps, rates, bounds))])

    def _bounds(self, gaps: ca.SX) -> ca.SX:
        """Bounds of the rates whatever direction the velocities have: the normals may turn between two outputs."""
        eom, slopes = self._numeric.eom, ca.jacobian(gaps, self._numeric.eom.q)
        bound = ca.fabs(ca.jacobian(gaps, eom.t))
        for k in range(len(eom.mechanism.bodies)):
            place, speed = slopes[:, 3 * k : 3 * k + 2], eom.v[3 * k : 3 * k + 2]
            bound += ca.sqrt(ca.sum2(place**2)) * ca.sqrt(ca.sumsqr(speed))
            bound += ca.fabs(slopes[:, 3 * k + 2] * eom.v[3 * k + 2])
        for k in range(3 * len(eom.mechanism.bodies), eom.q.numel()):
            bound += ca.fabs(slopes[:, k] * eom.v[k])
        return bound

    def _at(self, path: Path, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Gaps, their rates and bounds of these on a path, each (k, n)."""
        n = self._numeric.eom.q.numel()
        x = hermite_states(path, times, n)
        q, v, z = x[:, :n], x[:, n : 2 * n], x[:, 2 * n :]
        values = self._function(times[None, :], q.T, v.T, z.T, self._numeric.p).full().T
        gaps, rates, bounds = np.split(values, 3, axis=1)
        return gaps, rates, bounds

    def unseen(self, path: Path, closed: np.ndarray) -> list[Closing]:
        """Gaps that close on a path in intervals in which no step found them closed; the first of each gap.

        Parameters
        ----------
        closed : numpy.ndarray
            For how long the steps found each gap closed, by interval (k, n), s.
        """
        if not self.owners or path.times.size < 2:
            return []
        gaps, rates, bounds = self._at(path, path.times)
        length = np.diff(path.times)[:, None]
        reachable = gaps[:-1] + gaps[1:] < SAFETY * np.maximum(bounds[:-1], bounds[1:]) * length
        # what is closed where an interval begins was seen before
        rows, owners = np.nonzero(reachable & (closed == 0) & (gaps[:-1] > -SHALLOW))
        brackets = _Brackets(
            owners, path.times[rows], path.times[rows + 1], gaps[rows, owners], gaps[rows + 1, owners],
            rates[rows, owners], rates[rows + 1, owners], bounds[rows, owners], bounds[rows + 1, owners],
        )  # fmt: skip
        spans: dict[int, tuple[float, float]] = {}
        for level in range(MOST):
            brackets = brackets.chosen(brackets.may_close(level))
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
            values = [part[np.arange(middle.size), brackets.owner] for part in self._at(path, middle)]
            for k in np.flatnonzero(values[0] < -SHALLOW):
                owner = int(brackets.owner[k])
                if middle[k] < spans.get(owner, (np.inf,))[0]:
                    spans[owner] = (float(middle[k]), float(brackets.start[k]))
            brackets = brackets.halved(middle, *values)
        return [self._located(path, owner, *inside) for owner, inside in spans.items()]

    def stops(
        self, path: Path, closing: Closing, accelerations: Callable[[Path, np.ndarray], np.ndarray]
    ) -> np.ndarray:
        """Times after a closing over which no step may go, so that the force that arises is followed (k,).

        Parameters
        ----------
        accelerations : callable
            ``(path, times) -> a`` by row, from the equations of motion.
        """
        # deeper and deeper on the path, until the force would stop the outlines in the time that has passed
        since = closing.spell * GROWTH
        pull = np.abs(np.einsum("kn,kn->k", self._slopes_at(path, closing), accelerations(path, closing.time + since)))
        speed = abs(self._at(path, np.array([closing.time]))[1][0, closing.owner])
        stopped = pull * since > speed
        stopping = since[max(int(np.argmax(stopped)) - 1, 0)] if np.any(stopped) else since[-1]
        step = float(stopping) / PARTS
        return closing.time + step * np.arange(1, PARTS * TIMES + 1)

    def _slopes_at(self, path: Path, closing: Closing) -> np.ndarray:
        """Gradients of a gap by the coordinates at the times after its closing (k, n)."""
        times = closing.time + closing.spell * GROWTH
        n = self._numeric.eom.q.numel()
        q = hermite_states(path, times, n)[:, :n]
        slopes = self._slopes(times[None, :], q.T, self._numeric.p).full()
        return slopes.reshape(len(self.owners), times.size, n)[closing.owner]

    def _located(self, path: Path, owner: int, inside: float, before: float) -> Closing:
        """Closing of a gap from a time at which it is closed, and one before."""
        opened = before
        for _ in range(60):
            middle = (opened + inside) / 2
            if not opened < middle < inside:
                break
            if self._at(path, np.array([middle]))[0][0, owner] > 0:
                opened = middle
            else:
                inside = middle
        end = path.times[np.searchsorted(path.times, inside, side="right").clip(max=path.times.size - 1)]
        ahead = np.linspace(inside, end, 257)[1:]
        gaps = self._at(path, ahead)[0][:, owner]
        shut = int(np.argmax(gaps >= 0)) if np.any(gaps >= 0) else gaps.size - 1
        spell = float(ahead[shut] - opened)
        depth = float(-np.min(gaps[: shut + 1], initial=0.0))
        # a little before: what ends in the contact by rounding has seen its force
        speed = abs(self._at(path, np.array([opened]))[1][0, owner])
        margin = min(2 * SHALLOW / speed, (opened - before) / 2) if speed else 0.0
        return Closing(owner, opened - margin, spell + margin, depth)


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

    def may_close(self, level: int) -> np.ndarray:
        """True for each gap that may be closed somewhere inside, by its rates.

        In a short interval the gap between convex outlines is a convex function of time: it stays above
        the tangents at both ends. In a long one, whose motion may turn back, its rate is bounded.
        """
        length = self.end - self.start
        if level < COARSE:
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
