"""Places that a mechanism of one degree of freedom does not reach in the time, whatever its limited inputs do.

Let s be the length along the curve of its poses in the metric of the masses, so that its kinetic energy is s'²/2. Its
loads along the curve, with the inputs in the middle of their ranges and at rest, are a function of s, and have a
potential V(s). What inputs and speeds add to them is no more than a drive d in the sense of the motion, and no more
than a brake b against it. For the speed w that belongs to the whole energy follows

    w² = s'² + 2 (V - V_min),    -b ≤ w' ≤ d.

So w is no larger than it may have grown from the start, nor than may be lost until the end if the speed there is
stated, and the place farthest from the start that was passed so far moves on by no more than sqrt(w² - 2 (V - V_min)),
whatever detours a motion makes to gather speed. The curve is followed on both sides of the start until that takes
longer than there is time; places on the way are out of reach if the time to them and the time to come to rest there are
too long. Path limits only add to that.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from math import inf, isfinite, log, sqrt

import casadi as ca
import numpy as np

from ...equations.numeric import NumericEquations
from ...equations.switching.switches import BENDING, JUMPING
from ...model.conditions import Condition
from ...numerics.graph import operations
from ...numerics.solution_curve import points_along
from ...results.state import State
from ..program.problem_setup import ProblemSetup
from ..statement.phase import on_positions, on_states
from .reach import Stated, places

#: Number of poses on either side of the start to begin with, which is doubled, and the largest one.
FIRST_POSES, MOST_POSES = 50, 400
#: Factor on what a motion may reach: for what lies between poses.
MARGIN = 1.05
#: Speeds at which losses are looked at, as shares of the largest one.
SPEEDS = np.array([0.003, 0.01, 0.03, 0.1, 0.2, 0.4, 0.6, 0.8, 1.0])
#: Power of speeds, as a share of that of the inputs, from which loads that depend on them drive.
DRIVING = 1e-9
#: Rounds of Newton's method, and relative change at which they end.
ROUNDS, ROUNDING = 50, 1e-10


def out_of_time(setup: ProblemSetup) -> str:
    """Name of a place that is not reached in the time; empty if there is none, as far as is known.

    It is known for a mechanism of one degree of freedom whose whole first state is given, and whose loads are smooth
    functions of pose, speeds and limited inputs.
    """
    line = _Line.of(setup)
    if line is None or not line.is_followed():
        return ""
    return next((stated.name for stated in places(setup) if line.is_out_of_reach(stated)), "")


class _Line:
    """The curve of poses of a mechanism of one degree of freedom, and the bounds of what moves it.

    `middle` and `half` are the middles and half the widths of the ranges of the inputs on which the loads depend.
    """

    def __init__(self, setup: ProblemSetup, middle: np.ndarray, half: np.ndarray):
        self._setup, self._numeric, self._half = setup, setup.setups[0].numeric, half
        self._time, self._start = setup.problem.phases[0].span[1], setup.start
        eom = self._numeric.eom
        symbols = [eom.q, eom.v, eom.u]
        loads = ca.substitute(ca.vertcat(ca.vec(eom.Q), ca.vec(ca.jacobian(eom.Q, eom.u))), eom.p, self._numeric.p)
        self._loads, self._middle = ca.Function("loads", symbols, [ca.densify(loads)]), middle
        self._depends_on_speed = bool(ca.depends_on(eom.Q, eom.v))

    @classmethod
    def of(cls, setup: ProblemSetup) -> _Line | None:
        """The curve of a problem; None if nothing is known of it."""
        first = setup.setups[0]
        eom, numeric = first.phase.equations, first.numeric
        if len(setup.setups) > 1 or first.ends.initial is not None or eom.is_large:
            return None
        unknown = ca.vertcat(eom.t, eom.z, eom.lam, ca.SX(0, 1), *setup.problem.free_parameters)
        gains = ca.jacobian(eom.Q, eom.u)
        is_simple = (
            not ca.depends_on(ca.vertcat(eom.Phi, ca.vec(eom.Phi_q), eom.nu, eom.Q, eom.mass_diagonal), unknown)
            and not ca.depends_on(gains, ca.vertcat(eom.u, eom.v))
            and len(eom.position_rows) == eom.lam.numel()
            and not np.any(numeric.velocity(0.0, setup.start.q)[1])
            and not any(operations(eom.Q, (*BENDING, *JUMPING)))
        )
        ranges = _ranges(setup, gains) if is_simple else None
        return None if ranges is None else cls(setup, *ranges)

    def is_followed(self) -> bool:
        """Follow the curve as far as any motion comes in the time; False if it ends before, or is too long."""
        self.sides = short = [_Side(self._numeric, self._start, sense) for sense in (1, -1)]
        while short:
            if not all([side.go_on() for side in short]) or not self._is_known(self.sides):
                return False
            short = [side for side in self.sides if side.times[-1] < MARGIN * self._time]
        return True

    def _is_known(self, sides: Sequence[_Side]) -> bool:
        """Find the bounds along the curve, and the least times to its poses; False if speeds drive the mechanism."""
        loads, drives = zip(*(self._along(side, 0.0) for side in sides), strict=True)
        potentials = [side.potential(along) for side, along in zip(sides, loads, strict=True)]
        least = min(np.min(potential) for potential in potentials)
        for side, potential in zip(sides, potentials, strict=True):
            side.barrier = 2 * (potential - least)
        self._drive = self._brake = float(max(np.max(np.abs(gains) @ self._half) for gains in drives))
        mass_along = sides[0].tangents[0] * self._numeric.mass
        first = float(np.sqrt((mass_along @ self._start.v) ** 2 + sides[0].barrier[0]))
        if self._depends_on_speed:
            speeds = (first + self._drive * self._time) * np.r_[-SPEEDS, SPEEDS]
            pairs = list(zip(sides, loads, strict=True))
            added = [np.sign(v) * (self._along(side, v)[0] - at_rest) for v in speeds for side, at_rest in pairs]
            if max(map(np.max, added)) > DRIVING * self._drive:
                return False
            self._brake -= float(min(map(np.min, added)))
        for side in sides:
            side.times = least_times(side.lengths, side.barrier, first, self._drive)
        return True

    def _along(self, side: _Side, speed: float) -> tuple[np.ndarray, np.ndarray]:
        """Loads along a side at a speed with the inputs in the middle (k,), and what the inputs add (k, n_u)."""
        count, n = side.poses.shape
        middle = np.tile(self._middle[:, None], (1, count))
        values = self._loads(side.poses.T, speed * side.tangents.T, middle).full().reshape(-1, n, count)
        along = np.einsum("unk,kn->ku", values, side.tangents)
        return along[:, 0], along[:, 1:]

    # --- places -----------------------------------------------------------------------------------
    def is_out_of_reach(self, stated: Stated) -> bool:
        """True if conditions of a place are not met wherever a motion may be then."""
        eom, time = self._numeric.eom, stated.times[2]
        unknown = ca.vertcat(eom.t, ca.SX(0, 1), *self._setup.problem.free_parameters)
        rows = [c for _, c in stated.conditions if c.equality and not ca.depends_on(c.expression, unknown)]
        chosen = [c for c in rows if on_positions(c.expression)]
        if not chosen or stated.following:
            return False
        function = ca.Function("values", [eom.q], [ca.densify(ca.vertcat(*map(self._at, chosen)))])
        values = [function(side.poses.T).full() for side in self.sides]
        # from one pose to the next a condition changes by no more than its largest change from pose to pose
        changes = np.max(np.abs(np.hstack([np.diff(x) for x in values])), axis=1)
        for side, at in zip(self.sides, values, strict=True):
            speeds, near = self._speeds(side, rows), np.all(np.abs(at) <= changes[:, None], axis=0)
            if any(self._time_to(side, k, speeds[k]) <= MARGIN * time for k in np.flatnonzero(near).tolist()):
                return False
        return True

    def _at(self, condition: Condition) -> ca.SX:
        """Expression of a condition at the values of the parameters."""
        return ca.substitute(condition.expression, self._numeric.eom.p, self._numeric.p)

    def _speeds(self, side: _Side, rows: Sequence[Condition]) -> np.ndarray:
        """Speeds along a side that conditions demand (k,), infinite if they do not."""
        eom, speeds = self._numeric.eom, np.full(side.lengths.size, np.inf)
        for condition in on_states([c for c in rows if c.depends_on("velocity")]):
            expression = self._at(condition)
            slopes = ca.jacobian(expression, eom.v)
            if not ca.depends_on(slopes, eom.v):
                function = ca.Function("speed", [eom.q, eom.v], [ca.densify(expression), ca.densify(slopes.T)])
                missing, by_speed = (x.full() for x in function(side.poses.T, 0 * side.poses.T))
                by_speed = np.sum(by_speed.T * side.tangents, axis=1)
                with np.errstate(divide="ignore", invalid="ignore"):
                    speeds = np.fmin(speeds, np.abs(missing[0] / by_speed))
        return speeds

    def _time_to(self, side: _Side, k: int, speed: float) -> float:
        """Time that a motion takes at least to a pose of a side, with a speed there if that is finite."""
        there = side.times[: k + 1]
        if not np.isfinite(speed):
            return float(there[-1])
        back, last = side.lengths[k] - side.lengths[k::-1], np.sqrt(speed**2 + side.barrier[k])
        return float(np.max(there + least_times(back, side.barrier[k::-1], last, self._brake)[::-1]))


class _Side:
    """Poses of the curve from the start on in one sense, as far as it has been followed."""

    #: their number (k), lengths of the curve from the start, twice the potential energy above its least value, a speed
    #: squared, and the least times in which a motion comes there, s
    poses: np.ndarray
    tangents: np.ndarray
    lengths: np.ndarray
    barrier: np.ndarray
    times: np.ndarray

    def __init__(self, numeric: NumericEquations, start: State, sense: int):
        self._mass, self._points = numeric.mass, list[tuple[np.ndarray, np.ndarray]]()
        sizes = numeric.scale.coordinates
        self._rest, self._sense = points_along(lambda q: numeric.position(0.0, q), start.q, sizes, sense), sense

    def go_on(self) -> bool:
        """Follow the curve further; False if it ends, or is too long, or nothing that moves has a mass."""
        wanted = max(FIRST_POSES, 2 * len(self._points))
        self._points += itertools.islice(self._rest, wanted - len(self._points))
        if not wanted == len(self._points) <= MOST_POSES:
            return False
        self.poses, directions = (np.array(part) for part in zip(*self._points, strict=True))
        speeds = np.sqrt(np.sum(self._mass * directions**2, axis=1))
        if not np.all(speeds > 0):
            return False
        #: directions in the same sense on both sides, of unit length in the metric of the masses
        self.tangents = directions / speeds[:, None]
        steps = np.sqrt(np.sum(self._mass * np.diff(self.poses, axis=0) ** 2, axis=1))
        self.lengths = np.r_[0.0, np.cumsum(steps)]
        return True

    def potential(self, loads: np.ndarray) -> np.ndarray:
        """Potential of loads along the curve (k,), zero at the start."""
        work = np.diff(self.lengths) * (loads[1:] + loads[:-1]) / 2
        return -self._sense * np.r_[0.0, np.cumsum(work)]


def least_times(lengths: np.ndarray, barrier: np.ndarray, first: float, rate: float) -> np.ndarray:
    """Return the least times to places on a line, s: speeds squared are ``w² - barrier``, and w grows at a rate.

    Parameters
    ----------
    lengths, barrier : numpy.ndarray
        Distances from the first place, rising, and twice the potential energies there, by mass (k,).
    first, rate : float
        The value of w at the beginning, and its rate.
    """
    times, t, w = [0.0], 0.0, float(first)
    for step, low in zip(np.diff(lengths).tolist(), np.minimum(barrier[1:], barrier[:-1]).tolist(), strict=True):
        if not isfinite(t) or (w * w <= low and rate == 0):
            t = inf
        elif rate == 0:
            t += step / sqrt(w * w - low)
        else:
            after = _risen(max(w, sqrt(low)), low, rate, step)
            t, w = t + (after - w) / rate, after
        times.append(t)
    return np.array(times)


def _risen(w: float, low: float, rate: float, step: float) -> float:
    """Value to which w has grown after a step at speeds ``sqrt(w² - low)``, by Newton's method from above."""

    def distance(w: float) -> float:
        root = sqrt(max(w * w - low, 0.0))
        return (w * root - (low * log(w + root) if low > 0 else 0.0)) / (2 * rate)

    end, now = distance(w) + step, w + sqrt(2 * step * rate)
    for _ in range(ROUNDS):
        change = (distance(now) - end) * rate / sqrt(now * now - low)
        now -= change
        if abs(change) <= ROUNDING * now:
            break
    return now


def _ranges(setup: ProblemSetup, gains: ca.SX) -> tuple[np.ndarray, np.ndarray] | None:
    """Middles and half widths of the ranges of the inputs, zero for those of no effect; None if one is not limited."""
    mechanism, eom = setup.problem.phases[0].mechanism, setup.setups[0].phase.equations
    middle, half = np.zeros((2, len(mechanism.inputs)))
    for k, symbol in enumerate(mechanism.inputs):
        if not gains[:, k].nnz():
            continue
        limits = [(symbol.lower, symbol.upper), *_path_limits(setup, eom.u[k])]
        lower, upper = max(low for low, _ in limits), min(high for _, high in limits)
        if not np.isfinite(upper - lower) or upper < lower:
            return None
        middle[k], half[k] = (lower + upper) / 2, (upper - lower) / 2
    return middle, half


def _path_limits(setup: ProblemSetup, symbol: ca.SX) -> Iterator[tuple[float, float]]:
    """Limits of an input by conditions on the path that contain it alone, and linearly."""
    for condition in setup.problem.phases[0].path:
        slope = ca.jacobian(condition.expression, symbol)
        alone = [s.element_hash() for s in condition.symbols] == [symbol.element_hash()]
        if alone and not condition.equality and slope.is_constant() and float(slope) != 0:
            bound = -float(ca.substitute(condition.expression, symbol, 0)) / float(slope)
            yield (-np.inf, bound) if float(slope) > 0 else (bound, np.inf)
