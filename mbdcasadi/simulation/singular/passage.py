"""Passing a pose in which a linkage could fold: a bifurcation, where constraint rows become dependent for an instant.

In such a pose the accelerations follow from the equations of motion only as a
limit, and near it whatever constraint error there is, is divided by a singular
value that passes through zero: an integrator that goes on may leave on another
branch. The motion itself is smooth. So it is integrated up to a distance from the
pose, continued across by a polynomial through what came before, and brought onto
the constraints on the far side, where they are regular again. There the
accelerations of the polynomial must be those of the equations of motion.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ...integrators.compiled import IntegrationFailure
from ...numerics.least_squares import largest
from ...numerics.tolerances import MET, NEGLIGIBLE
from ..outputs import Outputs
from ..path import Path, StatesAt, hermite_poses
from .regularity import ENTRY, Regularity, finer_times

#: States of a regular path at which its pivot is evaluated.
SOME = 16
#: Paths of which such poses are kept before their pivots are found.
MOST_REGULAR = 32
#: Poses about the lowest pivot at which it is evaluated again.
CLOSE = 64
#: Distances from the pose, relative to that of the entry, between which the polynomial is tried: far away it errs by
#: its length, near by what the singular value divides. Measured on parallelograms in rows of one to five, the energy
#: was off by 1e-6, 1e-8, 1e-8, 1e-7 J of 2 J at distances of 1, 0.5, 0.25, 0.12.
DISTANCES = (0.25, 0.5, 0.125, 1.0, 0.0625)
#: Points on the way across at which the equations of motion are compared with the polynomial: with the accelerations
#: if the pivot is at least this part of that of the entry, with the power of all forces everywhere.
CHECKS, REGULAR = 96, 2e-3
#: Duration of a passage, relative to the usual one, from which the polynomial goes through more of the motion.
LONGER = 1.5
#: Fall of the pivot after a passage, relative to its largest value since, from which a motion turns back to the pose.
RETURN = 0.5
#: Length of the motion through which the polynomial is laid, in lengths of the passage, and points on it. Each point
#: gives coordinates and velocities.
HISTORY, POINTS = 4.0, 6
#: Pieces of a motion that are remembered for it.
PARTS = 40
#: Longest passage, in times that the motion takes from where the pivot is four times as large to the entry.
LONGEST = 12.0
#: Times among them that are looked at together for the far side; the lowest pivot is among the first ones.
ARRIVALS = 16
#: Difference of the polynomial's accelerations from those of the equations of motion on the far side, relative to
#: their size, up to which the passage is accepted.
PASSAGE_ACCELERATION_TOLERANCE = 1e-3
#: The same of its accelerations and of the power of all forces on the way across.
CHECKED = 5e-3


@dataclass(frozen=True)
class Passage:
    """A motion continued across a singular pose.

    Attributes
    ----------
    start, end : float
        Times before and after it, s.
    x : numpy.ndarray
        State at the end, on the constraints.
    states : callable
        ``times -> (k, n_x)``: states in between, as the polynomial has them.
    error : float
        Estimated error of the velocities at the end, relative to them.
    """

    start: float
    end: float
    x: np.ndarray
    states: Callable[[np.ndarray], np.ndarray]
    error: float

    def approach(self, path: Path, times: np.ndarray) -> Path:
        """Return the path to its start: of the integrator as far as it is sure, beyond that of the polynomial.

        Parameters
        ----------
        times : numpy.ndarray
            After the first one of the path (k,), s.
        """
        known = np.isin(times, path.times) & (times <= path.times[-1])
        states, integrals = np.empty((times.size, path.x.shape[1])), np.zeros((times.size, path.integrals.shape[1]))
        places = np.searchsorted(path.times, times[known])
        states[known], integrals[known] = path.x[places], path.integrals[places - 1]
        states[~known] = self.states(times[~known])
        return Path(np.r_[path.times[0], times], np.vstack([path.x[:1], states]), integrals)


class SingularPassage:
    """Watches the poses of a run, and continues it across singular ones."""

    def __init__(self, regularity: Regularity, outputs: Outputs):
        self._regularity, self._outputs = regularity, outputs
        self._numeric = regularity.numeric
        # largest pivots of the run, and since the last passage
        self._largest = self._recent = 0.0
        # times and poses far from singular ones, whose pivots count from when a path is looked at
        self._regular: list[tuple[np.ndarray, np.ndarray]] = []

    # --- noticing ------------------------------------------------------------------------------
    def entry(self, path: Path) -> float | None:
        """Time at which a path comes near to a singular pose, or back to one; None if it does not."""
        if not self._regularity.is_needed or path.times.size < 2:
            return None
        times, entries, self._largest, self._recent = self._entries(path)
        if not entries.size:
            return None
        # between two times of a coarse path the pose may be almost reached
        k, n = int(entries[0]), self._numeric.eom.q.numel()
        closer = np.linspace(times[max(k - 1, 0)], times[k], CLOSE)
        values = self._regularity.at(closer, hermite_poses(path, closer, n))
        near = np.flatnonzero((values < ENTRY * self._largest) & (closer > times[0]))
        return float(closer[near[0]] if near.size else times[k])

    def note_regular(self, path: Path) -> None:
        """Take note of some poses of a path on which none is near to a singular one."""
        if self._regularity.is_needed:
            count = min(SOME, path.times.size)
            rows = np.arange(count) * (path.times.size - 1) // max(count - 1, 1)
            self._regular.append((path.times[rows], path.x[rows, : self._numeric.eom.sizes[0]]))
            if len(self._regular) == MOST_REGULAR:
                self._take_regular()

    def _take_regular(self) -> None:
        """Find the pivots of the poses that were noted."""
        if self._regular:
            times, q = (np.concatenate(parts) for parts in zip(*self._regular, strict=True))
            most = float(self._regularity.at(times, q).max())
            self._largest, self._recent = max(self._largest, most), max(self._recent, most)
            self._regular.clear()

    def comes_near(self, path: Path) -> bool:
        """True if a path that is not followed any further comes near to a singular pose, or back to one."""
        return self._regularity.is_needed and path.times.size > 1 and bool(self._entries(path)[1].size)

    def _entries(self, path: Path) -> tuple[np.ndarray, np.ndarray, float, float]:
        """Times of a path, places at which it is near to a singular pose, and the largest pivots at its end."""
        self._take_regular()
        times, values = self._regularity.along(path, largest=self._largest)
        running = np.maximum(np.maximum.accumulate(values), self._largest)
        recent = np.maximum(np.maximum.accumulate(values), self._recent)
        # a path that begins near to a pose leaves it, until its pivot falls again
        entries = np.flatnonzero((values < ENTRY * running) & (values < RETURN * recent))
        return times, entries, float(running[-1]), float(recent[-1])

    def left_behind(self) -> None:
        """Note that a pose was passed: what counts from here on is whether the motion turns back to it."""
        self._take_regular()
        self._recent = 0.0

    def smallest(self, path: Path) -> float:
        """Smallest pivot along a path, relative to the one of the entry."""
        self._take_regular()
        n, times, values = self._numeric.eom.q.numel(), finer_times(path, self._numeric.eom), np.zeros(0)
        for _ in range(2):  # first everywhere, then about the lowest
            values = self._regularity.at(times, hermite_poses(path, times, n))
            k = int(np.argmin(values))
            around = times[max(k - 1, 0)], times[min(k + 1, times.size - 1)]
            times = np.linspace(*around, CLOSE)
        return float(np.min(values)) / (ENTRY * self._largest)

    # --- passing ----------------------------------------------------------------------------------
    def across(self, time: float, begin: float, states_at: StatesAt, limit: float) -> Passage | None:
        """Continue a motion from near a singular pose to the far side; None if no polynomial meets the equations.

        Parameters
        ----------
        time : float
            Entry, s.
        begin : float
            Time since which the motion is smooth, s.
        states_at : callable
            ``times -> states`` of the motion, from some time before the entry to shortly after it.
        limit : float
            Time up to which the equations are smooth: the end of the run, or where they change with time, s.
        """
        half = self._distance(time, begin, states_at)
        best: Passage | None = None
        if half is None:
            return None
        for distance in DISTANCES:
            try:
                passage = self._from(time, half, distance, begin, states_at, limit)
            except IntegrationFailure:  # too near to the pose
                continue
            if passage is not None and (best is None or passage.error < best.error):
                best = passage
            if best is not None and best.error <= NEGLIGIBLE:
                break
        return best

    def _distance(self, time: float, begin: float, states_at: StatesAt) -> float | None:
        """Time from an entry to the singular pose, by the fall of the pivot's root, and its minimum ahead."""
        earlier = max(begin, time - 1e-3 * (time - begin))
        if earlier >= time:
            return None
        times = np.array([earlier, time])
        n = self._numeric.eom.q.numel()
        before, now = np.sqrt(np.maximum(self._regularity.at(times, states_at(times)[:, :n]), 0.0))
        rate = (before - now) / (time - earlier)
        if not rate > 0:
            return None
        guess = float(now / rate)
        # a motion that gathers speed, or loses it, is there sooner or later
        course = _Course(self._outputs, time, min(HISTORY * 2 * guess, time - begin), states_at)
        ahead = time + guess * np.linspace(0, 2, 257)[1:]
        poses = course.states(ahead)[:, :n]
        return float(ahead[int(np.argmin(self._regularity.at(ahead, poses)))] - time)

    def _from(
        self, time: float, half: float, distance: float, begin: float, states_at: StatesAt, limit: float
    ) -> Passage | None:
        """The passage by a polynomial between two distances from the pose; None if it does not arrive there."""
        start, reach = time + (1 - distance) * half, distance * half
        arrival = None
        span = HISTORY * 2 * reach
        for _ in range(2):  # a motion that turns back on the way takes longer, and a polynomial through more of it
            course = _Course(self._outputs, start, min(span, start - begin), states_at)
            arrival = self._arrival(course, start, reach, distance, limit)
            if arrival is None or HISTORY * (arrival[0] - start) <= LONGER * span or span >= start - begin:
                break
            span = HISTORY * (arrival[0] - start)
        if arrival is None:
            return None
        end, x, ahead = arrival
        error = self._error(end, end - start, x, ahead, course)
        if error is None or not self._meets_equations(start, end, course):
            return None
        return Passage(start, end, x, course.states, error)

    def _arrival(
        self, course: _Course, start: float, reach: float, distance: float, limit: float
    ) -> tuple[float, np.ndarray, np.ndarray] | None:
        """Time at which a polynomial is far enough behind the pose, the state there, and the polynomial's own."""
        n = self._numeric.eom.q.numel()
        times = start + reach * np.arange(1.0, LONGEST, 0.125)
        times = times[times <= limit]
        if not times.size:
            return None
        pivots = np.zeros(0)
        while pivots.size < times.size:  # most motions are behind it early among these times
            part = times[pivots.size : pivots.size + ARRIVALS]
            states = course.states(part)
            poses = self._outputs.recovery.positions(part, states[:, :n], states[:, 2 * n :])
            pivots = np.append(pivots, self._regularity.at(part, poses))
            lowest = int(np.argmin(pivots[:ARRIVALS]))
            behind = np.flatnonzero(pivots[lowest:] >= distance**2 * ENTRY * self._largest)
            if behind.size:
                k = lowest + int(behind[0])
                ahead = course.states(times[k : k + 1])
                return float(times[k]), self._outputs.projected(times[k : k + 1], ahead)[0], ahead[0]
        return None

    def _meets_equations(self, start: float, end: float, course: _Course) -> bool:
        """True if the polynomial meets the equations of motion on its way: nothing else begins there.

        In the singular pose accelerations do not follow from the equations of motion; but along a motion without
        prescribed velocities the reactions do no work, so that ``v^T (M a - Q) = 0`` in any pose.
        """
        numeric, eom = self._numeric, self._numeric.eom
        times = start + (end - start) * (np.arange(CHECKS) + 0.5) / CHECKS
        x, size = course.states(times), numeric.scale.coordinates
        predicted = course.accelerations(times)
        t, q, v, a, z, lam, u = self._outputs.block(times, x)
        regular = self._regularity.at(times, q) > REGULAR * ENTRY * self._largest
        speed = largest(v / size)
        residual = np.abs((a - predicted) / size)[regular]
        if not residual.max(initial=0.0) <= CHECKED * (largest((a / size)[regular]) + speed**2):
            return False
        if eom.Q_depends_on_lam or largest(numeric.velocity(float(times[0]), q[0], z[0])[1]):
            return bool(np.mean(regular) > 0.5)
        zero = np.zeros_like(lam.T)
        forces = eom.function(eom.Q)(t[None, :], q.T, v.T, predicted.T, z.T, zero, u.T, numeric.p).full().T
        terms = np.abs(v) * (np.abs(numeric.mass * predicted) + np.abs(forces) + numeric.mass * size * speed**2)
        power = np.abs(np.sum(v * (numeric.mass * predicted - forces), axis=1))
        return bool(np.all(power <= CHECKED * np.max(np.sum(terms, axis=1))))

    def _error(self, time: float, length: float, x: np.ndarray, ahead: np.ndarray, course: _Course) -> float | None:
        """Error of the velocities at the end, relative to them; None if the equations are not met there.

        The accelerations of the polynomial are compared with those of the equations of motion.
        """
        n, size = self._numeric.eom.q.numel(), self._numeric.scale.coordinates
        if largest((x[:n] - ahead[:n]) / size) > MET:
            return None
        a = self._outputs.block(np.array([time]), x[None, :])[3][0]
        speed = largest(x[n : 2 * n] / size)
        residual = largest((a - course.accelerations(np.array([time]))[0]) / size)
        if not np.isfinite(residual) or residual > PASSAGE_ACCELERATION_TOLERANCE * (largest(a / size) + speed**2):
            return None
        return residual * length / speed if speed else None


class _Course:
    """Polynomial through coordinates and velocities of a motion at some times before another."""

    def __init__(self, outputs: Outputs, start: float, span: float, states_at: StatesAt):
        from scipy.interpolate import KroghInterpolator

        nodes = -(1 + np.cos(np.pi * np.arange(POINTS) / (POINTS - 1))) / 2
        q, v, z = outputs.split(states_at(start + span * nodes))
        values = np.empty((2 * POINTS, q.shape[1]))
        values[0::2], values[1::2] = q, span * v
        self._start, self._span = start, span
        self._positions = KroghInterpolator(np.repeat(nodes, 2), values)
        self._slow = KroghInterpolator(nodes, z) if z.shape[1] else None

    def states(self, times: np.ndarray) -> np.ndarray:
        """Coordinates, velocities and first-order states by row."""
        tau = (times - self._start) / self._span
        z = np.zeros((times.size, 0)) if self._slow is None else self._slow(tau)
        return np.hstack([self._positions(tau), self._positions.derivative(tau, 1) / self._span, z])

    def accelerations(self, times: np.ndarray) -> np.ndarray:
        """Accelerations at times by row (k, n)."""
        a: np.ndarray = self._positions.derivative((times - self._start) / self._span, 2) / self._span**2
        return a


class Trail:
    """States of a motion since it last began smoothly."""

    def __init__(self) -> None:
        self._parts: list[tuple[np.ndarray, np.ndarray]] = []

    def begin(self, time: float, x: np.ndarray) -> None:
        """Forget what was before: the motion restarts."""
        self._parts = [(np.array([time]), x[None, :])]

    def add(self, times: np.ndarray, x: np.ndarray) -> None:
        """Append states by row."""
        self._parts = [*self._parts[-PARTS:], (times, x)]

    def with_path(self, path: Path, time: float) -> Trail:
        """Return the trail with a path up to a time appended."""
        trail, before = Trail(), path.times <= time
        trail._parts = [*self._parts, (path.times[before], path.x[before])]
        return trail

    @property
    def start(self) -> float:
        """First time, s."""
        return float(self._parts[0][0][0])

    def before(self, time: float) -> tuple[float, np.ndarray]:
        """Return the last time and state that are not after another time."""
        for times, x in reversed(self._parts):
            k = int(np.searchsorted(times, time, side="right")) - 1
            if k >= 0:
                return float(times[k]), x[k]
        times, x = self._parts[0]
        return float(times[0]), x[0]


def notes_on_passages(times: Sequence[float]) -> list[str]:
    """Sentence on the singular poses that a motion has passed at some times; none without any."""
    if not times:
        return []
    poses = "1 singular pose" if len(times) == 1 else f"{len(times)} singular poses"
    return [
        f"passes {poses}, the first at t = {times[0]:.6g} s, in which the mechanism could fold; the motion is "
        "continued smoothly"
    ]
