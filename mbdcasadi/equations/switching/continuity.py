"""Switches over which an expression is continuous nevertheless: the knots of splines, the touch of a contact.

Where a switch passes its border the expression must have the same value on
both sides. That is looked at in points of the border, found on random lines
and by Newton's method: a difference that is analytic and not zero everywhere is
not zero in a random point.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ...numerics.tolerances import ACCURACY, NEGLIGIBLE
from .switches import Switch, sides_of

#: Random lines, points of each, points of a border that are looked at, and starts of Newton's method towards one.
LINES, POINTS, HITS, STARTS = 24, 33, 8, 24
#: Steps of Newton's method towards a border, and of the search for it in a bracket.
NEWTON_STEPS, BRACKET_STEPS = 12, 100
#: Jump that is rounding, relative to the jump a little way off the border: over a continuous border the difference
#: grows from nothing.
GROWN = 1e-4
#: Distance from the border at which that jump is taken, relative to the first bracket.
OFFSET = 1e-7
#: Points of a border without which nothing is concluded.
FEWEST_HITS = 4


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Values about which it is seen if expressions are continuous.

    Attributes
    ----------
    symbols : casadi.SX
        Quantities that vary (k,).
    centre, size : numpy.ndarray
        Typical values, and sizes of their changes (k,).
    known : casadi.SX
        Symbols whose values are known.
    values : numpy.ndarray
        Their values.
    """

    symbols: ca.SX
    centre: np.ndarray
    size: np.ndarray
    known: ca.SX
    values: np.ndarray


def continuous_switches(held: Sequence[ca.SX], switches: Sequence[Switch], around: Surroundings) -> set[int]:
    """Find the switches over which expressions are continuous.

    Parameters
    ----------
    held : sequence of casadi.SX
        Expressions with all their switches held.
    switches : sequence of Switch
        These switches.
    around : Surroundings
        Values about which they are looked at.

    Returns
    -------
    set of int
        Nodes of the switches that were seen to be continuous. Of others it is not known.
    """
    if not switches:
        return set()
    sides = {switch.side.element_hash(): switch.node for switch in switches}
    continuous = _Trial(held, switches, around).continuous()
    while True:
        # a switch jumps where its quantity passes the border, and where that jumps, as in fmod(t, T) < s
        jumping = [switch.quantity for switch in switches if switch.node not in continuous]
        inside = {sides.get(symbol.element_hash()) for symbol in ca.symvar(ca.veccat(ca.SX(0, 1), *jumping))}
        if not inside & continuous:
            return continuous
        confirmed = continuous & _Trial([*held, *jumping], switches, around).continuous()
        if confirmed == continuous:
            return confirmed
        continuous = confirmed


def switches_without_value(held: Sequence[ca.SX], switches: Sequence[Switch], around: Surroundings) -> set[int]:
    """Nodes of the switches beyond whose border the held expressions have no value, as a root has none."""
    return _Trial(held, switches, around).without_value() if switches else set()


class _Trial:
    """Points on the borders of the switches of some expressions."""

    def __init__(self, held: Sequence[ca.SX], switches: Sequence[Switch], around: Surroundings):
        column = ca.densify(ca.veccat(*held))
        quantities = ca.densify(ca.vertcat(*[s.natural for s in switches]))
        sides = ca.vertcat(*[s.side for s in switches])
        used = np.flatnonzero(ca.which_depends(ca.vertcat(column, quantities), around.symbols)).tolist()
        free, known = around.symbols[used], around.known
        self._switches, self._values = switches, around.values
        self._whole = np.array([s.whole for s in switches])
        self._centre, self._size = around.centre[used][:, None], around.size[used][:, None]
        self._quantities = ca.Function("quantities", [free, known], [quantities])
        self._slopes = ca.Function("slopes", [free, known], [ca.densify(ca.jacobian(quantities, free))])
        self._held = ca.Function("held", [free, known, sides], [column])
        self._random = np.random.default_rng(0)

    def continuous(self) -> set[int]:
        """Return the nodes of switches that are continuous."""
        low, _, offset, before, after, owner = self._borders()
        crossed = before[owner, np.arange(owner.size)] != after[owner, np.arange(owner.size)]
        agrees = self._agree(low, offset, before, after, owner)
        nodes = set()
        for k, switch in enumerate(self._switches):
            places = np.flatnonzero(owner == k)
            if np.sum(crossed[places]) >= FEWEST_HITS and np.all(agrees[places]):
                place = low[:, places], offset[:, places], before[:, places], after[:, places]
                if self._holds_beyond_others(k, *place):
                    nodes.add(switch.node)
        return nodes

    def without_value(self) -> set[int]:
        """Return the nodes of switches beyond whose borders there is no value."""
        low, high, _, before, after, owner = self._borders()
        lost = np.zeros(owner.size, bool)
        for points, own, beyond in ((low, before, after), (high, after, before)):
            values, others = (self._held(points, self._values, sides).full() for sides in (own, beyond))
            lost |= np.any(np.isfinite(values) & ~np.isfinite(others), axis=0)
        return {self._switches[k].node for k in owner[lost]}

    def _borders(self) -> tuple[np.ndarray, ...]:
        """Points on both sides of borders, ways across them, sides of all switches there, and whose border it is."""
        first, last = self._brackets()
        owner = np.repeat(np.arange(len(self._switches)), [part.shape[1] for part in first])
        low, high = self._narrowed(np.hstack(first), np.hstack(last), owner)
        before, after = (sides_of(self._at(points), self._whole) for points in (low, high))
        return low, high, OFFSET * (np.hstack(last) - np.hstack(first)), before, after, owner

    # --- points on the borders -------------------------------------------------------------
    def _points(self, count: int) -> np.ndarray:
        """Random points at all distances from the typical one (k, count)."""
        shape = (self._size.size, count)
        reach = 10 ** self._random.uniform(-1.5, 1.5, shape)
        return self._centre + self._size * reach * self._random.standard_normal(shape)

    def _at(self, points: np.ndarray) -> np.ndarray:
        """Quantities of all switches at points."""
        return self._quantities(points, self._values).full()

    def _slopes_at(self, points: np.ndarray) -> np.ndarray:
        """Gradients of all quantities at points (switches, points, k)."""
        size, count = points.shape
        return self._slopes(points, self._values).full().reshape(-1, count, size)

    def _brackets(self) -> tuple[list[np.ndarray], list[np.ndarray]]:
        """Pairs of points with the border of a switch between them, by switch."""
        share = np.linspace(0, 1, POINTS)
        begin, end = self._points(LINES), self._points(LINES)
        lines = begin[:, :, None] + (end - begin)[:, :, None] * share
        values = self._at(lines.reshape(len(begin), -1)).reshape(-1, LINES, POINTS)
        known = np.isfinite(values)
        with np.errstate(invalid="ignore"):
            sides = sides_of(values, self._whole)
        passed = (sides[:, :, 1:] != sides[:, :, :-1]) & known[:, :, 1:] & known[:, :, :-1]
        low, high = [], []
        for k in range(len(self._switches)):
            chosen = self._random.permutation(np.argwhere(passed[k]))[:HITS]
            if len(chosen) >= FEWEST_HITS:
                low.append(lines[:, chosen[:, 0], chosen[:, 1]])
                high.append(lines[:, chosen[:, 0], chosen[:, 1] + 1])
            else:
                before, after = self._across(k)
                low.append(before)
                high.append(after)
        for k in range(len(self._switches)):
            if low[k].shape[1] < FEWEST_HITS:
                low[k], high[k] = self._borrowed(k, np.hstack(low), np.hstack(high))
        return low, high

    def _borrowed(self, k: int, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Pairs of points for other switches that lie on both sides of a border too.

        A quantity that is zero on a whole side, as a penetration, has no gradient there that leads to its border.
        """
        before, after = (sides_of(self._at(points)[k : k + 1], self._whole[k : k + 1])[0] for points in (low, high))
        chosen = np.flatnonzero(before != after)[:HITS]
        return low[:, chosen], high[:, chosen]

    def _across(self, k: int) -> tuple[np.ndarray, np.ndarray]:
        """Pairs of points on both sides of a border that random lines do not meet, by Newton's method."""
        points = self._points(STARTS)
        border = np.round(self._at(points)[k]) if self._whole[k] else np.zeros(STARTS)
        with np.errstate(all="ignore"):
            for _ in range(NEWTON_STEPS):
                away, slope = self._at(points)[k] - border, self._slopes_at(points)[k].T * self._size
                step = self._size * slope * away / np.sum(slope**2, axis=0)
                points = points - np.where(np.isfinite(step), step, 0.0)
            slope = self._slopes_at(points)[k].T * self._size
            out = 1e-3 * self._size * slope / np.sqrt(np.sum(slope**2, axis=0))
            out = np.where(np.isfinite(out), out, 0.0)
            low, high = points - out, points + out
            chosen = np.flatnonzero((self._at(low)[k] < border) & (self._at(high)[k] > border))[:HITS]
        return low[:, chosen], high[:, chosen]

    def _narrowed(self, first: np.ndarray, last: np.ndarray, owner: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Brackets of the borders of some switches, made as narrow as rounding by regula falsi and halving in turn.

        Both ends are needed, one on each side of a border, beside which a quantity may be zero everywhere: the searches
        of :mod:`~mbdcasadi.numerics.roots` return one point, and take the sign at both ends for granted.
        """
        begin, along = first, last - first

        def value_at(share: np.ndarray, chosen: np.ndarray) -> np.ndarray:
            points = begin[:, chosen] + along[:, chosen] * share
            return self._at(points)[owner[chosen], np.arange(chosen.size)]

        everywhere = np.arange(owner.size)
        low, high = np.zeros(owner.size), np.ones(owner.size)
        at_low, at_high = value_at(low, everywhere), value_at(high, everywhere)
        border = np.where(self._whole[owner], np.floor(np.fmax(at_low, at_high)), 0.0)
        at_low, at_high = at_low - border, at_high - border
        open_ = everywhere
        for step in range(BRACKET_STEPS):
            open_ = open_[high[open_] - low[open_] > ACCURACY]
            if not open_.size:
                break
            a, b, fa, fb = low[open_], high[open_], at_low[open_], at_high[open_]
            with np.errstate(invalid="ignore", divide="ignore"):
                middle = (a * fb - b * fa) / (fb - fa)
            # a little beyond the root, so that both ends come near to it
            middle += np.where(np.abs(fa) < np.abs(fb), 1.0, -1.0) * ACCURACY / 2
            # beside a side on which the quantity is zero everywhere, as a penetration, there is no slope to follow
            falsi = (middle > a) & (middle < b) & (step % 3 < 2) & (fa != 0) & (fb != 0)
            middle = np.where(falsi, middle, (a + b) / 2)
            value = value_at(middle, open_) - border[open_]
            # a whole number belongs to the side above it
            same = np.where(self._whole[owner[open_]], (value >= 0) == (fa >= 0), (value > 0) == (fa > 0))
            low[open_], high[open_] = np.where(same, middle, a), np.where(same, b, middle)
            at_low[open_], at_high[open_] = np.where(same, value, fa), np.where(same, fb, value)
        return begin + along * low, begin + along * high

    # --- both sides ---------------------------------------------------------------------------
    def _holds_beyond_others(
        self, k: int, points: np.ndarray, offset: np.ndarray, before: np.ndarray, after: np.ndarray
    ) -> bool:
        """True if other switches change nothing on their sides that were not seen in points of the border."""
        seen = np.any(before != before[:, :1], axis=1) | np.any(after != before, axis=1)
        seen[k] = True
        unseen = np.flatnonzero(~seen)
        if unseen.size:  # a copy of this one cannot be on its other side
            slopes = self._slopes_at(points)
            with np.errstate(invalid="ignore", divide="ignore"):
                slopes /= np.linalg.norm(slopes, axis=2, keepdims=True)
            cosines = np.abs(np.einsum("jck,ck->jc", slopes[unseen], slopes[k]))
            unseen = unseen[~np.all(cosines > 1 - NEGLIGIBLE, axis=1)]
        owner = np.full(points.shape[1], k)
        for other in unseen:
            moved = before.copy(), after.copy()
            for sides in moved:
                sides[other] = sides[other] + 1 if self._whole[other] else 1 - sides[other]
            if not np.all(self._agree(points, offset, *moved, owner)):
                return False
        return True

    def _agree(
        self, points: np.ndarray, offset: np.ndarray, before: np.ndarray, after: np.ndarray, owner: np.ndarray
    ) -> np.ndarray:
        """True if the values for both sides are the same in points of borders, by rounding (points,)."""
        if not owner.size:
            return np.zeros(0, bool)
        one, two = (self._held(points, self._values, sides).full() for sides in (before, after))
        grown, sizes = np.zeros(one.shape), NEGLIGIBLE * np.where(np.isfinite(one), np.abs(one), 0.0)
        with np.errstate(invalid="ignore"):
            for near in (points - offset, points + offset):
                away = [self._held(near, self._values, sides).full() for sides in (before, after)]
                grown = np.fmax(grown, np.abs(away[1] - away[0]))
            for end, sides in ((points - offset / OFFSET, before), (points + offset / OFFSET, after)):
                value = np.abs(self._held(end, self._values, sides).full())
                sizes = np.fmax(sizes, ACCURACY * np.where(np.isfinite(value), value, 0.0))
            firsts = np.flatnonzero(np.diff(owner, prepend=-1))
            rounding = np.maximum.reduceat(sizes, firsts, axis=1)[:, np.searchsorted(owner[firsts], owner)]
            same = np.abs(two - one) <= rounding + GROWN * grown
            agree: np.ndarray = np.all(same | ~np.isfinite(one) | ~np.isfinite(two), axis=0)
            return agree
