"""Poses that can be assembled, but to which no continuous motion leads from the start.

The poses of a closed loop of one degree of freedom are curves, and a motion stays on the one on which it begins: the
others are other assembly configurations, which are also called branches. The curve of the start is followed as a whole,
with angles that count turns, and it is seen whether the conditions of a place are met anywhere on it, and whether path
limits cut it off before. Loops that are singular on the way, where curves meet, those whose curve does not close, or
only after very many turns, and those of more degrees of freedom are left to the solver.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ..equations.numeric import NumericEquations
from ..equations.tree import tree_coordinates
from ..model.conditions import Condition
from ..numerics.evaluation import Evaluator
from ..numerics.lazy import cached_property
from ..numerics.least_squares import largest
from ..numerics.newton import solve
from ..numerics.solution_curve import STEP, closed_curve
from ..numerics.tolerances import MET

#: Miss of a condition, in typical sizes, from which it counts as not met, and of one that is not an equality.
MISSED, LIMIT_MISSED = 1e-3, STEP
#: Distance, in steps of the curve, within which a root of the conditions belongs to a point.
NEAR = 3.0
#: Periods for which the curve is looked at on both sides of the start for what cuts it off.
PERIODS = 3


@dataclass(frozen=True)
class Separated:
    """A place to which no continuous motion leads.

    Attributes
    ----------
    kind : {"branch", "turn", "blocked", "missed"}
        The pose is that of another assembly configuration; one that is reached, but not with as many turns; one behind
        poses that break a path limit; or none was found.
    misses : dict of int to float
        Amounts by which conditions are missed in the pose that comes nearest, by their place in the list.
    limits : tuple of Condition
        Path limits that block the way.
    """

    kind: str
    misses: dict[int, float]
    limits: tuple[Condition, ...] = ()


class Branches:
    """Closed loops of one degree of freedom, and the curves of their poses through a start."""

    def __init__(self, numeric: NumericEquations, start: np.ndarray, unknown: ca.SX):
        self._eom = numeric.eom
        self._make = lambda: list(loops_of_one_freedom(numeric, start, unknown))

    @cached_property
    def _loops(self) -> list[tuple[Loop, list[int]]]:
        return self._make()

    def separated(
        self, rows: Sequence[Condition], limits: Sequence[Condition], pose: np.ndarray | None
    ) -> Separated | None:
        """What separates the start from a place; None if nothing was found.

        Parameters
        ----------
        rows : sequence of Condition
            What holds there, in coordinates of the mechanism.
        limits : sequence of Condition
            Inequalities that hold all the way.
        pose : numpy.ndarray or None
            A pose that meets the conditions, if one is known.
        """
        for loop, coordinates in self._loops:
            conditions = [(k, e, rows[k].equality) for k, e in self._of(coordinates, rows)]
            held = [(limits[k], e) for k, e in self._of(coordinates, limits)]
            found = loop.separated(conditions, held, None if pose is None else pose[coordinates])
            if found is not None:
                return found
        return None

    def _of(self, coordinates: list[int], conditions: Sequence[Condition]) -> list[tuple[int, ca.SX]]:
        """Conditions that depend on the pose of a loop alone, by their places, in the coordinates of the loop."""
        eom, tree = self._eom, tree_coordinates(self._eom)
        inside = [ca.substitute(c.expression, eom.q, tree.q) for c in conditions]
        symbols, known = eom.q[coordinates], {s.element_hash() for s in ca.vertsplit(eom.q[coordinates])}
        within = [{s.element_hash() for s in ca.symvar(e)} <= known and ca.depends_on(e, symbols) for e in inside]
        return [(k, e) for k, (e, holds) in enumerate(zip(inside, within, strict=True)) if holds]


class Loop:
    """A closed loop of one degree of freedom, and the curve of its poses through the start."""

    def __init__(self, rows: ca.SX, symbols: ca.SX, start: np.ndarray, sizes: np.ndarray, turning: np.ndarray):
        self.rows, self.symbols, self.sizes, self._turning = rows, symbols, sizes, turning
        results = [ca.densify(rows), ca.densify(ca.jacobian(rows, symbols))]
        function = Evaluator(ca.Function("loop", [symbols], results))
        #: the curve; None if it is singular somewhere, or does not close
        self.curve = closed_curve(lambda x: _pair(function(x)), start, sizes, turning)

    def separated(
        self,
        conditions: Sequence[tuple[int, ca.SX, bool]],
        limits: Sequence[tuple[Condition, ca.SX]],
        assembled: np.ndarray | None,
    ) -> Separated | None:
        """What separates the start from a place; None if nothing does.

        `conditions` are their places in a list, expressions in the coordinates of the loop, and whether they are
        equalities; `limits` hold all the way, and `assembled` is a pose that meets the conditions, if one is known.
        """
        if self.curve is None or not conditions:
            return None
        place = _Conditions(self, conditions)
        misses = place.least_misses(self.curve.points, self.curve.period)
        if misses is not None:
            limited = any(k in misses for k, _, equality in conditions if not equality)
            return Separated("missed" if limited else self._kind(assembled), misses)
        part = self._within(limits)
        if part is None:
            return None
        points, blocking = part
        stays = np.zeros(points.shape[1])
        misses = place.least_misses(points, stays) and place.least_misses(points[1:-1], stays)
        return Separated("blocked", misses, blocking) if misses else None

    def _kind(self, pose: np.ndarray | None) -> str:
        """Kind of a pose to which the curve does not lead."""
        assert self.curve is not None
        if pose is None:
            return "missed"
        apart = pose - self.curve.points
        apart = np.where(self._turning, apart - 2 * np.pi * np.round(apart / (2 * np.pi)), apart) / self.sizes
        return "turn" if np.min(np.linalg.norm(apart, axis=1)) <= STEP else "branch"

    def _within(self, limits: Sequence[tuple[Condition, ca.SX]]) -> tuple[np.ndarray, tuple[Condition, ...]] | None:
        """Points of the curve to which limits let a motion go, and those that stop it; None if none stops it."""
        if not limits or self.curve is None:
            return None
        count, period = len(self.curve.points), self.curve.period
        turns = range(-PERIODS, PERIODS + 1)
        points = np.vstack([self.curve.points + k * period for k in turns])
        place = _Conditions(self, [(k, expression, False) for k, (_, expression) in enumerate(limits)])
        broken = place.misses(points) > LIMIT_MISSED
        stops, start = np.flatnonzero(broken.any(axis=1)), PERIODS * count
        before, after = stops[stops < start], stops[stops > start]
        if broken[start].any() or not before.size or not after.size:
            return None
        ends = int(before[-1]), int(after[0])
        blocking = tuple(limits[k][0] for k in np.flatnonzero(broken[list(ends)].any(axis=0)).tolist())
        return points[ends[0] : ends[1] + 1], blocking


class _Conditions:
    """Conditions on the pose of a loop."""

    def __init__(self, loop: Loop, conditions: Sequence[tuple[int, ca.SX, bool]]):
        self._loop = loop
        self._places = [k for k, *_ in conditions]
        self._equality = np.array([equality for *_, equality in conditions])
        values, x = ca.vertcat(*[expression for _, expression, _ in conditions]), loop.symbols
        results = [ca.densify(values), ca.densify(ca.jacobian(values, x))]
        self._function = Evaluator(ca.Function("conditions", [x], results))
        rows = ca.vertcat(loop.rows, *[e for _, e, equality in conditions if equality])
        self._joined = Evaluator(ca.Function("joined", [x], [ca.densify(rows), ca.densify(ca.jacobian(rows, x))]))
        evaluated = [self._function(x) for x in loop.curve.points] if loop.curve else []
        slopes = np.array([np.abs(slope) @ loop.sizes for _, slope in evaluated])
        sizes = np.max(slopes, axis=0, initial=0.0)
        self._sizes = np.where(sizes > 0, sizes, 1.0)

    def _values(self, points: np.ndarray) -> np.ndarray:
        return np.array([self._function(x)[0].ravel() for x in points]) / self._sizes

    def misses(self, points: np.ndarray) -> np.ndarray:
        """Amounts by which conditions are missed at points, in typical sizes (p, k)."""
        return self._missed(self._values(points))

    def _missed(self, values: np.ndarray) -> np.ndarray:
        return np.where(self._equality, np.abs(values), np.maximum(values, 0.0))

    def least_misses(self, points: np.ndarray, period: np.ndarray) -> dict[int, float] | None:
        """Least amounts by which conditions are missed on a curve, by place; None if they may be met there."""
        values = self._values(points)
        change = self._values(points + period) - values
        drift = change[0]
        if np.max(np.abs(change - drift)) > MET * (1 + np.max(np.abs(values))):
            return None  # turns change a condition otherwise than by an angle
        drift = np.where(np.abs(drift) > MET, drift, 0.0)
        lead = int(np.argmax(np.abs(drift) * self._equality))
        unbounded = ~self._equality & (drift != 0)  # met after turns enough
        best: tuple[float, np.ndarray] | None = None
        for periods in _periods(values[:, lead], drift[lead]) if self._equality[lead] else [np.zeros(len(points))]:
            missed = self._missed(values + periods[:, None] * drift)
            missed[:, unbounded] = 0.0
            size = np.linalg.norm(missed, axis=1)
            for k in _local_minima(size).tolist():
                if self._is_met_near(points[k] + periods[k] * period, unbounded):
                    return None
            least = int(np.argmin(size))
            if best is None or size[least] < best[0]:
                best = float(size[least]), missed[least]
        assert best is not None
        amounts = best[1] * self._sizes
        return {place: float(a) for place, a in zip(self._places, amounts, strict=True) if a > 0}

    def _is_met_near(self, x: np.ndarray, unbounded: np.ndarray) -> bool:
        """True if conditions may be met on the curve near to a point of it."""
        sizes = self._loop.sizes
        if np.any(self._equality):
            outcome = solve(lambda y: _pair(self._joined(y)), x, sizes**-2, sizes=sizes, step_limit=STEP * sizes)
            if largest((outcome.x - x) / sizes) <= NEAR * STEP:
                x = outcome.x
        missed = self._missed(self._values(x[None, :]))[0]
        closed = largest(self._joined(x)[0].ravel()[: self._loop.rows.numel()]) <= MISSED
        limits = ~self._equality & ~unbounded
        slack = MISSED if np.any(self._equality) else LIMIT_MISSED
        return bool(closed and not np.any(missed[self._equality] > MISSED) and not np.any(missed[limits] > slack))


def _pair(results: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    return results[0].ravel(), results[1]


def _periods(values: np.ndarray, drift: float) -> list[np.ndarray]:
    """Numbers of periods after which a condition is nearest to zero at the points of a curve, from both sides (p,)."""
    if drift == 0:
        return [np.zeros(values.size)]
    needed = -values / drift
    return [np.floor(needed), np.ceil(needed)]


def _local_minima(values: np.ndarray) -> np.ndarray:
    """Places of values that are not larger than their neighbours, and of the ends."""
    padded = np.r_[np.inf, values, np.inf]
    return np.flatnonzero((values <= padded[:-2]) & (values <= padded[2:]))


def loops_of_one_freedom(numeric: NumericEquations, q: np.ndarray, unknown: ca.SX) -> Iterator[tuple[Loop, list[int]]]:
    """Yield closed loops that have one degree of freedom whatever else moves, and their coordinates by index.

    Rows that depend on the time or on what is `unknown`, such as free parameters, belong to none.
    """
    eom, tree = numeric.eom, tree_coordinates(numeric.eom)
    left = [place for place, k in enumerate(eom.position_rows) if int(k) in set(tree.left)]
    independent = np.array(tree.independent, dtype=int)
    rows = ca.vertcat(ca.SX(0, 1), *[ca.substitute(eom.Phi[place], eom.q, tree.q) for place in left])
    varying = [bool(ca.depends_on(row, ca.vertcat(eom.t, unknown))) for row in ca.vertsplit(rows)] if left else []
    rows = ca.substitute(rows, eom.p, ca.DM(numeric.p))
    slopes = ca.Function("slopes", [eom.q], [ca.densify(ca.jacobian(rows, eom.q[tree.independent]))])
    random, sizes = np.random.default_rng(0), numeric.scale.coordinates
    # coordinates that cancel have a slope of zero in every pose
    poses = [q + random.uniform(-1, 1, q.size) * sizes for _ in range(3)]
    depends = np.max([np.abs(slopes(pose).full()) for pose in poses], axis=0) > 1e-12 if left else np.zeros((0, 0))
    for chosen in _components(depends):
        columns = np.flatnonzero(depends[chosen].any(axis=0))
        if any(varying[k] for k in chosen) or len(columns) < 2:
            continue
        coordinates = independent[columns]
        others = [k for k in independent.tolist() if k not in set(coordinates.tolist())]
        fixed = ca.substitute(rows[chosen], eom.q[others], ca.DM(q[others])) if others else rows[chosen]
        symbols = eom.q[coordinates.tolist()]
        yield Loop(fixed, symbols, q[coordinates], sizes[coordinates], eom.angles[coordinates]), coordinates.tolist()


def _components(depends: np.ndarray) -> Iterator[list[int]]:
    """Rows of a table of dependences that have columns in common, directly or by others."""
    waiting = set(range(len(depends)))
    while waiting:
        component = {waiting.pop()}
        while True:
            columns = depends[sorted(component)].any(axis=0)
            more = {k for k in waiting if depends[k][columns].any()}
            if not more:
                break
            component |= more
            waiting -= more
        yield sorted(component)
