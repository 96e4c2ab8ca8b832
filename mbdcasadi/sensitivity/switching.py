"""Instants at which a motion passes from one side of a switch to another.

Between two such instants the equations are smooth. They are found by integration with all switches held, at the
border of the first one that is left; then its side is changed, and the integration starts again.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import casadi as ca
import numpy as np

from ..arguments.values import RunValues
from ..equations.impact_law import jump
from ..equations.switching.switches import margin_rates_of, margins_of, sides_of
from ..errors import SimulationError, warn
from ..integrators.compiled import InitialValueProblem, IntegrationFailure
from ..numerics.console import interruptible
from ..numerics.roots import bracketed_root
from ..numerics.tolerances import AT_REST, MET, NEGLIGIBLE, ZERO_VALUE
from ..results.interpolation import cubic
from ..simulation.changes.impacts import instant_of
from ..simulation.path import StatesAt, states_from_start
from .cuts import Cut, Cuts
from .held_system import HeldMotion

#: Rate at which a quantity passes its border, relative to its largest one, below which it touches rather than passes.
GRAZING = 1e-4
#: States of a motion that are looked at, at least.
FEWEST_POINTS = 16
#: Switches in one motion, at most.
MOST_SWITCHES = 500
#: Points within an interval in which a quantity may pass its border, the first ones near to its start.
CLOSER = np.r_[2.0 ** -np.arange(12, 3, -2), np.linspace(0, 1, 11)[1:]]
#: Distance from the border, relative to the larger one at the ends of an interval, to which a cubic must come for a
#: closer look.
NEAR_BORDER = 0.1
#: Length of the stretch that is integrated after a switch, in lengths of the one before it.
AHEAD = 4.0
#: Distance of a quantity in time from its border that is rounding.
NEAR_IN_TIME = 1e-9
#: Share of a motion before its end in which a switch may pass its border at the event that ends it: by the errors of
#: two integrations.
AT_END = 1e-4


class BorderPassage:
    """A motion that is followed from cut to cut.

    Parameters
    ----------
    held : HeldMotion
        Equations with their switches held, and their integrator.
    x : numpy.ndarray or None
        The start (n_x,); None if all switches are switches in time, and nothing need be integrated.
    values : RunValues
        Values of the parameters and inputs.
    limits : Cuts
        Times that no step may cross, at which the equations jump, and the longest step.
    watch_step : float
        Time between states that are looked at, s.
    in_time : numpy.ndarray
        Sides just after the start of the switches in time; of others it does not matter (switches,).

    Attributes
    ----------
    first_sides : numpy.ndarray
        Sides at the start.
    cuts : list of Cut
        Cuts that are known up to now.
    """

    def __init__(
        self,
        held: HeldMotion,
        grid: np.ndarray,
        x: np.ndarray | None,
        values: RunValues,
        *,
        limits: Cuts,
        watch_step: float,
        in_time: np.ndarray,
    ):
        system = self._system = held.system
        self._held, self._grid, self._max_step = held, grid, limits.max_step
        self._stops = np.union1d(limits.stops, limits.jumps)
        self._p, self._levels, self._channel = values
        self._follows = x is not None
        self._watched = np.flatnonzero(np.logical_not(system.in_time)) if self._follows else np.zeros(0, int)
        span, self._instant = float(grid[-1] - grid[0]), instant_of(grid)
        self._watch_step, self._stretch = min(watch_step, span / FEWEST_POINTS), span
        self._grazed: set[int] = set()
        self._time, self._x = float(grid[0]), np.zeros(0) if x is None else x
        self.cuts: list[Cut] = []
        self.sides = np.where(system.in_time, in_time, 0.0)
        if self._watched.size:
            self.sides = self._settled(self.sides, everything=True)
            self._leave_borders(at_start=True)
        self.first_sides = self.sides.copy()

    # --- from cut to cut ------------------------------------------------------------------
    def advance(self, target: float) -> None:
        """Go on to a time, from cut to cut."""
        while self._follows and self._time < target:
            end = self._time + self._stretch
            self._advance_once(end if end < target - self._watch_step else target)
        self._time = target

    def change(self, flipped: Sequence[int], sides: np.ndarray, *, impulse: bool) -> None:
        """Change the sides of switches in time at the present time.

        Parameters
        ----------
        flipped : sequence of int
            Switches that change.
        sides : numpy.ndarray
            Sides of all switches in time afterwards.
        impulse : bool
            True if a prescribed velocity jumps.
        """
        slopes = self._system.slopes_in_time(self._time, np.r_[self._p, self.sides]).full()
        distances = np.abs(self._margins_in_time(self.sides))
        # others flip with a switch inside them whose value jumps, as in fmod(t, T) < s
        at_border = distances <= NEAR_IN_TIME + self._instant * np.abs(slopes[:, 0])
        left = [k for k in flipped if at_border[k]] or list(flipped)
        following = [k for k in flipped if k not in left]
        while left:
            group = [k for k in left if _same_derivative(slopes[k], slopes[k, 0], slopes[left[0]], slopes[left[0], 0])]
            left = [k for k in left if k not in group]
            after = self.sides.copy()
            after[group] = sides[group]
            for k in tuple(following):  # in the order of their nesting
                if not left or self._margins_in_time(after)[k] < 0:
                    after[k] = sides[k]
                    group.append(k)
                    following.remove(k)
            self._cut(group, self._settled(after) if self._follows else after, impulse=impulse)
        if self._follows:
            self._leave_borders()

    def at_borders(self) -> list[int]:
        """Watched switches that stand at their borders at the present time, and move."""
        if not self._watched.size:
            return []
        w, rates, _ = self._switching(self.sides)
        near = np.abs(margins_of(w, self.sides, self._system.whole)) <= self._near(rates)
        moving = np.abs(rates) > AT_REST * (1 + self._speed)
        at_borders = [int(k) for k in self._watched if near[k] and moving[k] and not self._system.bends[k]]
        return [k for k in at_borders if not self._is_at_end(k, self._time, self._x)]

    def _is_at_end(self, k: int, time: float, x: np.ndarray) -> bool:
        """True if a switch passes its border where the event is that ends the motion, whatever the parameters are."""
        system, grid = self._system, self._grid
        if system.ending is None or grid[-1] - time > AT_END * (grid[-1] - grid[0]):
            return False
        here = np.array([time]), x[None, :], self.sides
        slopes, (rate, ending) = (
            self._call(system.slopes, *here, columns=True)[0],
            self._call(system.ending, *here, columns=True),
        )
        own_rate = float(self._call(system.switching, *here)[1][k, 0])
        return _same_derivative(slopes[k], own_rate, ending[0], float(rate[0, 0]))

    # --- one stretch ---------------------------------------------------------------------------
    def _advance_once(self, end: float) -> None:
        """Go on to a time, or to the first switch before it."""
        start = self._time
        count = 2 ** int(np.ceil(np.log2(max((end - start) / self._watch_step, FEWEST_POINTS / 4))))
        times = start + (end - start) * np.r_[np.arange(1, count) / count, 1.0]
        times[-1] = end
        stops = self._stops[(self._stops > start + self._instant) & (self._stops < end - self._instant)]
        times = np.union1d(times, stops)
        try:
            x = self._integrated(start, self._x, times, np.isin(times, stops))
        except SimulationError:
            # beyond a border the equations of its inner side may have no solution
            if end - start <= 2 * self._watch_step:
                raise
            self._stretch = (end - start) / AHEAD
            return
        crossing = self._first_crossing(np.r_[start, times], np.vstack([self._x, x])) if self._watched.size else None
        if crossing is not None and self._is_at_end(crossing[0], crossing[1], crossing[2]):
            self._watched = self._watched[self._watched != crossing[0]]  # what is behind the event is not used
            return
        if crossing is None:
            self._time, self._x = end, self._projected(end, x[-1])
            self._stretch *= 2
            return
        k, self._time, x_there, fastest = crossing
        self._x = self._projected(self._time, x_there)
        self._stretch = max(AHEAD * (self._time - start), 8 * self._watch_step)
        self._pass(k, fastest)

    def _first_crossing(self, times: np.ndarray, x: np.ndarray) -> tuple[int, float, np.ndarray, float] | None:
        """First switch whose border is passed between states, its time, the state there, and its largest rate."""
        whole, watched = self._system.whole, self._watched
        w, rates, _ = self._call(self._system.switching, times, x, self.sides)
        rests = self._rests(w, rates, self.sides[:, None]) & ~self._system.bends[:, None]
        for k in np.flatnonzero(np.any(rests[:, 1:] & rests[:, :-1], axis=1) & np.isin(range(whole.size), watched)):
            raise self._resting(int(k), float(times[int(np.argmax(rests[k]))]))
        margins = margins_of(w, self.sides, whole)[watched]
        slopes = margin_rates_of(w, rates, self.sides, whole)[watched]
        # what stands at its border at the start goes inside from there
        margins[:, 0] = np.maximum(margins[:, 0], 0.0)
        rounding = self._rounding(x[:-1])  # of its start: beyond the border the held equations may grow without bound
        left, visits = margins[:, 1:] < -rounding, _may_visit(margins, slopes, np.diff(times))
        for k in np.flatnonzero(np.any(left | visits, axis=0)):
            candidates = np.flatnonzero(left[:, k] | visits[:, k])
            crossing = self._crossing_in(times[k], x[k], times[k + 1], candidates, float(rounding[k]))
            if crossing is not None:
                switch = int(watched[crossing[0]])
                return switch, crossing[1], crossing[2], float(np.max(np.abs(rates[switch])))
        return None

    def _crossing_in(
        self, start: float, x: np.ndarray, end: float, candidates: np.ndarray, rounding: float
    ) -> tuple[int, float, np.ndarray] | None:
        """First of the watched switches that leave their sides within an interval, its time and the state there."""
        times = np.r_[start, start + (end - start) * CLOSER]
        states = np.vstack([x, self._integrated(start, x, times[1:], np.zeros(CLOSER.size, bool))])
        margins = self._margins(times, states)
        margins[:, 0] = np.maximum(margins[:, 0], 0.0)
        states_at, best = self._states_from(start, x), None
        for i in candidates:
            beyond = np.flatnonzero(margins[i] < -rounding)
            if not beyond.size:
                continue
            low, high = times[beyond[0] - 1], times[beyond[0]]
            at_low, at_high = margins[i, beyond[0] - 1], margins[i, beyond[0]]
            course = partial(lambda i, at: self._margins(at, states_at(at))[i], i)
            time = low if at_low == 0 else bracketed_root(course, low, high, float(at_low), float(at_high))
            if best is None or time < best[1]:
                best = int(i), time
        return None if best is None else (*best, states_at(np.array([best[1]]))[0])

    # --- at a border ----------------------------------------------------------------------------
    def _pass(self, k: int, fastest: float) -> None:
        """Change the side of a switch at its border, and of those that depend on it."""
        w, rates, _ = self._switching(self.sides)
        rate = float(rates[k])
        if self._system.bends[k]:
            self._flip(k, rate)
            self._leave_borders(passed=k)
            return
        if w[k] == 0 and rate == 0:
            raise self._resting(k, self._time)
        if abs(rate) <= NEGLIGIBLE * fastest:
            raise SimulationError(
                f"{self._name(k)} jumps at t = {self._time:.6g} s, where the motion only touches the border of the "
                "jump: that instant has no derivative",
                time=self._time,
            )
        if abs(rate) <= GRAZING * fastest and k not in self._grazed and self._jumps([k]):
            self._grazed.add(k)
            warn(
                f"{self._name(k)} jumps at t = {self._time:.6g} s, where the motion nearly only touches the border of "
                "the jump: derivatives beyond are large, and hold for small changes alone"
            )
        self._flip(k, rate)
        self._leave_borders(passed=k)

    def _jumps(self, switches: Sequence[int]) -> bool:
        """True if some of the switches jump at the present state."""
        shares = self._call(self._system.shares, np.array([self._time]), self._x[None, :], self.sides)[0][:, 0]
        return bool(np.any(np.abs(shares[list(switches)]) > NEGLIGIBLE))

    def _rests(self, w: np.ndarray, rates: np.ndarray, sides: np.ndarray) -> np.ndarray:
        """True for switches on the side of positive quantities whose own is zero, and stays so."""
        whole = self._system.whole.reshape(-1, *[1] * (w.ndim - 1))
        rests: np.ndarray = (w == 0) & (rates == 0) & (sides > 0) & ~whole
        return rests

    def _resting(self, k: int, time: float) -> SimulationError:
        return SimulationError(
            f"{self._name(k)} jumps near t = {time:.6g} s, where what decides about the jump is zero over a stretch of "
            "the motion: that instant has no derivative; compare a quantity that passes zero, as x > 0.1 in place of "
            "fmax(x - 0.1, 0) * k > 0",
            time=time,
        )

    def _flip(self, k: int, rate: float, *, at_start: bool = False) -> None:
        """Change the side of a switch that stands at its border, with its copies."""
        system = self._system
        w, rates, _ = self._switching(self.sides)
        leaves = np.abs(margins_of(w, self.sides, system.whole)) <= self._near(rates)
        leaves &= margin_rates_of(w, rates, self.sides, system.whole) < 0
        slopes = self._call(system.slopes, np.array([self._time]), self._x[None, :], self.sides, columns=True)[0]
        copies = [
            int(j)
            for j in self._watched
            if j != k and leaves[j] and rate != 0 and _same_derivative(slopes[j], rates[j], slopes[k], rate)
        ]
        after = self.sides.copy()
        for j in (k, *copies):
            after[j] = after[j] + np.sign(rates[j]) if system.whole[j] else 1 - after[j]
        after = self._settled(after)
        self._refuse_to_stay(k, rate, after)
        if at_start:
            self.sides = after
        else:
            moved = np.flatnonzero(after != self.sides).tolist()
            self._cut([k, *[j for j in moved if j != k]], after)

    def _refuse_to_stay(self, k: int, rate: float, after: np.ndarray) -> None:
        """Raise if both sides drive the motion back to the border: it would stay there."""
        beyond = 0.0 if self._system.bends[k] else self._switching(after)[1][k]
        if beyond * rate < 0 and abs(beyond) > NEGLIGIBLE * abs(rate):
            raise SimulationError(
                f"{self._name(k)} jumps at t = {self._time:.6g} s and holds the motion at the border of the jump, as "
                "the sign of a velocity does if a body comes to rest: such a motion cannot be differentiated; take a "
                "smooth law (mbd.Coulomb, mbd.tanh, mbd.step)",
                time=self._time,
            )

    def _settled(self, sides: np.ndarray, *, everything: bool = False) -> np.ndarray:
        """Sides after some of them changed, on which others may depend; what stands at its border stays."""
        system, sides = self._system, sides.copy()
        for _ in range(system.size + 1):
            w, rates, _ = self._switching(sides)
            beyond = margins_of(w, sides, system.whole) < (0 if everything else -self._near(rates))
            change = [k for k in self._watched if beyond[k] or self._rests(w, rates, sides)[k]]
            if not change:
                break
            sides[change] = sides_of(w, system.whole)[change]
        return sides

    def _leave_borders(self, *, at_start: bool = False, passed: int | None = None) -> None:
        """Change the sides of switches that stand at their borders and are about to leave."""
        for _ in range(2 * self._watched.size):
            w, rates, _ = self._switching(self.sides)
            margins = margins_of(w, self.sides, self._system.whole)
            outwards = margin_rates_of(w, rates, self.sides, self._system.whole) < 0
            near = np.abs(margins) <= self._near(rates)
            moving = np.abs(rates) > AT_REST * (1 + self._speed)
            if at_start:
                outwards = np.where(moving, outwards, self._leaves_from_rest(near & ~moving))
                moving = near
            leaving = [int(k) for k in self._watched if near[k] and moving[k] and outwards[k] and k != passed]
            if not leaving:
                return
            last = leaving[0]
            self._flip(leaving[0], float(rates[leaving[0]]), at_start=at_start)
        if self._system.bends[last]:
            return
        raise SimulationError(
            f"{self._name(last)} jumps back and forth at t = {self._time:.6g} s, where the motion stands at the "
            "border of the jump; take a smooth law (mbd.tanh, mbd.step)",
            time=self._time,
        )

    def _leaves_from_rest(self, at_rest: np.ndarray) -> np.ndarray:
        """Switches that stand still at their borders and are beyond them a little later."""
        if not np.any(at_rest[self._watched]):
            return np.zeros(at_rest.size, bool)
        soon = self._time + 1e-2 * self._watch_step
        x = self._integrated(self._time, self._x, np.array([soon]), np.zeros(1, bool))
        w = self._call(self._system.quantities, np.array([soon]), x, self.sides)[0]
        margins = margins_of(w, self.sides, self._system.whole)[:, 0]
        leaves: np.ndarray = at_rest & (margins < -self._rounding(self._x))
        return leaves

    def _cut(self, switches: Sequence[int], sides: np.ndarray, *, impulse: bool = False) -> None:
        """Change sides at the present time; the derivative of the instant is that of the first switch."""
        k = switches[0]
        border = float(max(self.sides[k], sides[k])) if self._system.whole[k] else 0.0
        switches = [j for j in switches if not self._system.bends[j]]
        if self._follows:
            impulse = self._strike(sides)
            switches = switches if self._jumps(switches) else ()  # without a jump the instant does not matter
        self._append(tuple(switches), border, sides, impulse)

    def _strike(self, sides: np.ndarray) -> bool:
        """Let velocities jump as the constraints ask for; return True if they did."""
        numeric = self._system.numeric
        if not numeric.eom.lam.numel():
            return False
        n = numeric.eom.q.numel()
        q, v, others = self._x[:n], self._x[n : 2 * n], self._x[2 * n :]
        z = others[: numeric.eom.z.numel()]
        jacobian, nu = (part.full() for part in numeric.velocity_function(self._time, q, z, np.r_[self._p, sides]))
        residual = np.max(np.abs(jacobian @ v - nu.ravel()), initial=0.0)
        if residual <= NEGLIGIBLE * (1 + self._speed):
            return False
        self._x = np.r_[q, jump(numeric, jacobian, nu.ravel(), v, z).v, others]
        return True

    def _append(self, switches: tuple[int, ...], border: float, sides: np.ndarray, impulse: bool = False) -> None:
        grid, time = self._grid, self._time
        place = int(np.clip(np.searchsorted(grid, time - self._instant), 1, grid.size - 1))
        at_output = bool(abs(grid[place] - time) <= self._instant)
        time = float(grid[place]) if at_output else time
        joined = bool(self.cuts) and abs(time - self.cuts[-1].time) <= self._instant
        time = self.cuts[-1].time if joined else time
        self.cuts.append(Cut(time, place - 1, at_output, joined, switches, border, tuple(sides.tolist()), impulse))
        self.sides = sides.copy()
        if switches and sum(bool(cut.switches) for cut in self.cuts) > MOST_SWITCHES:
            raise SimulationError(
                f"{self._name(switches[0])} jumps again at t = {time:.6g} s, after {MOST_SWITCHES} jumps, more "
                "than derivatives are carried through; take a smooth law (mbd.tanh, mbd.step)",
                time=time,
            )

    # --- values -----------------------------------------------------------------------------------
    def _name(self, k: int) -> str:
        return self._system.switches[k].description

    @property
    def _speed(self) -> float:
        n = self._system.numeric.eom.q.numel()
        return float(np.max(np.abs(self._x[n : 2 * n]), initial=0.0))

    def _rounding(self, x: np.ndarray) -> np.ndarray:
        """Values of quantities that are rounding, by the size of states (…, n_x) without their integrals."""
        eom = self._system.numeric.eom
        size = np.max(np.abs(x[..., : 2 * eom.q.numel() + eom.z.numel()]), axis=-1, initial=0.0)
        return np.asarray(ZERO_VALUE * (1 + size))

    def _near(self, rates: np.ndarray) -> np.ndarray:
        """Distances from the borders that are rounding."""
        return np.maximum(self._instant * np.abs(rates), self._rounding(self._x))

    def _margins_in_time(self, sides: np.ndarray) -> np.ndarray:
        """Distances of the quantities in time from the borders of sides at the present time (switches,)."""
        values = self._system.quantities_in_time(self._time, np.r_[self._p, sides]).full().ravel()
        return margins_of(values, sides, self._system.whole)

    def _columns(self, times: np.ndarray) -> np.ndarray:
        """Values of the channel in the intervals that end at times (rows, k)."""
        place = np.clip(np.searchsorted(self._grid, times, side="left") - 1, 0, self._grid.size - 2)
        return self._channel[:, place]

    def _switching(self, sides: np.ndarray) -> list[np.ndarray]:
        """Quantities, their rates, and rates of the state, at the present state."""
        values = self._call(self._system.switching, np.array([self._time]), self._x[None, :], sides)
        return [part[:, 0] for part in values]

    def _margins(self, times: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Distances of the watched quantities from their borders (watched, k)."""
        w = self._call(self._system.quantities, times, x, self.sides)[0]
        margins: np.ndarray = margins_of(w, self.sides, self._system.whole)[self._watched]
        return margins

    def _call(
        self, function: ca.Function, times: np.ndarray, x: np.ndarray, sides: np.ndarray, *, columns: bool = False
    ) -> list[np.ndarray]:
        """Results of a function at states; with `columns` as they are, of one state."""
        values = function(times[None, :], x.T, np.r_[self._p, sides], self._levels, self._columns(times))
        parts = [part.full() for part in (values if isinstance(values, tuple) else (values,))]
        return parts if columns else [np.array(np.broadcast_to(part, (part.shape[0], times.size))) for part in parts]

    def _integrated(self, start: float, x: np.ndarray, times: np.ndarray, stops: np.ndarray) -> np.ndarray:
        """States at times after another, under the present sides (k, n_x)."""
        columns = self._columns(times) if self._channel.shape[0] else None
        p = np.r_[self._p, self.sides, self._levels, self._held.decay]
        with interruptible() as interruption:
            try:
                z = self._held.unknowns
                problem = InitialValueProblem(x, z, start, times, p, columns, stops, self._max_step)
                return self._held.compiled.advance(problem, interruption)[0]
            except IntegrationFailure as failure:
                if interruption.requested:
                    raise KeyboardInterrupt from None
                raise SimulationError(
                    f"the integrator stopped between t = {start:.6g} s and {times[-1]:.6g} s: {failure.flag}",
                    time=start,
                ) from None

    def _states_from(self, start: float, x: np.ndarray) -> StatesAt:
        """Return the function from later times to the states there."""
        return states_from_start(start, x, lambda times: self._integrated(start, x, times, np.zeros(times.size, bool)))

    def _projected(self, time: float, x: np.ndarray) -> np.ndarray:
        return self._system.projected(time, x, np.r_[self._p, self.sides])


def _may_visit(margins: np.ndarray, slopes: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """True for margins that may be negative for a while between two knots, by cubic interpolation (rows, k)."""
    begin, end, down, up = margins[:, :-1], margins[:, 1:], slopes[:, :-1], slopes[:, 1:]
    dips = (begin >= 0) & (end >= 0) & (down < 0) & (up > 0)
    visits = np.zeros(dips.shape, bool)
    for i, k in np.argwhere(dips):
        inside = lengths[k] * np.linspace(0, 1, 11)[1:-1]
        ends, rates = margins[i, k : k + 2, None], slopes[i, k : k + 2, None]
        values, _ = cubic(np.array([0.0, lengths[k]]), ends, rates, inside)
        visits[i, k] = np.min(values) < NEAR_BORDER * np.max(ends)
    return visits


def _same_derivative(one: np.ndarray, one_rate: float, other: np.ndarray, other_rate: float) -> bool:
    """True if two instants have the same derivative: ``slope / rate`` of the quantities that pass their borders."""
    if one_rate == 0 or other_rate == 0:
        return False
    a, b = one / one_rate, other / other_rate
    return bool(np.max(np.abs(a - b)) <= MET * np.max(np.abs(b)))
