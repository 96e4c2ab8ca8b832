"""Poses that meet conditions, or come nearest to them.

What the linkage cannot reach, no motion reaches. Free parameters and a free time are among the unknowns, so that
whatever is feasible passes; what is missed by little, or not from several starts, is left undecided. Poses that can be
assembled, but to which no continuous motion leads, are the matter of :mod:`branches`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from ..assembly.pose import PoseProblem
from ..equations.numeric import FARTHEST, NumericEquations
from ..errors import MechanismError
from ..model.conditions import Condition
from ..numerics.console import without_warnings
from ..numerics.evaluation import Evaluator
from ..numerics.least_squares import largest
from ..numerics.nearest import nearest_finder
from ..numerics.newton import solve

#: Random poses from which the nearest one to a place is looked for.
STARTS = 24
#: Number of starts that must lead to the same least miss, and the share of it up to which misses are the same.
AGREEING, SAME_MISS = 5, 0.01
#: Miss, in typical sizes, from which a place counts as out of reach.
OUT_OF_REACH = 1e-3
#: Weight of a gap of the linkage beside a miss, and of the distance from the start.
CLOSED, NEARNESS = 1e6, 1e-8
#: Share of the largest load from which a joint counts as one that holds the linkage back, and of the largest miss from
#: which a condition is reported.
HOLDING, SHOWN = 0.05, 1e-3
#: Relative distance from a limit of a free parameter at which this is at it.
AT_LIMIT = 1e-5


@dataclass(frozen=True, eq=False)
class Free:
    """A number that is free within limits besides the pose: a parameter, or the time."""

    symbol: ca.SX
    label: str
    #: value to begin with
    value: float
    lower: float
    upper: float
    #: typical size
    size: float


@dataclass(frozen=True)
class MissedCondition:
    """A condition that is not met.

    Attributes
    ----------
    label : str
        The condition as it was written.
    amount : float
        Amount by which it is missed, in the unit.
    unit : str
        Unit; empty if it is not known.
    share : float
        Amount relative to the typical size.
    """

    label: str
    amount: float
    unit: str
    share: float

    def __str__(self) -> str:
        return f"{self.label} by {self.amount:.3g} {self.unit}".rstrip()


@dataclass(frozen=True)
class NearestPose:
    """The pose that comes nearest to conditions that none meets, of those found from so many starts."""

    missed: tuple[MissedCondition, ...]
    #: joints that keep the linkage from going on, and limits of what is free
    joints: tuple[str, ...]
    limits: tuple[str, ...]
    starts: int
    time: float


class Reach:
    """Conditions on the pose of a mechanism; the unknowns are the pose, free parameters, and the time.

    Parameters
    ----------
    numeric : NumericEquations
        Equations of the mechanism.
    closing : casadi.SX
        Its position constraints in coordinates, time and free symbols.
    rows : sequence of Condition
        Conditions in these.
    free : sequence of Free
        Free parameters, and the time as the last one.
    z : numpy.ndarray
        First-order states.
    """

    def __init__(
        self,
        numeric: NumericEquations,
        closing: ca.SX,
        rows: Sequence[Condition],
        free: Sequence[Free],
        z: np.ndarray,
    ):
        self.numeric, self.rows, self.free, self._z = numeric, list(rows), list(free), z
        eom = numeric.eom
        #: names of the elements whose position rows close the linkage
        self._elements = [eom.row_elements[k].name for k in eom.position_rows]
        self._unknowns = ca.vertcat(eom.q, *[f.symbol for f in free])
        self._expressions = ca.vertcat(closing, *[c.expression for c in rows])
        slopes = ca.jacobian(self._expressions, self._unknowns)
        results = [ca.densify(self._expressions), ca.densify(slopes)]
        self._function = Evaluator(ca.Function("rows", [self._unknowns], results))
        self._equality = np.r_[np.ones(len(self._elements), bool), [c.equality for c in rows]].astype(bool)
        self._sizes = np.r_[numeric.scale.coordinates, [f.size for f in free]]
        #: a point that meets the conditions, pose and values of what is free, if one was found
        self.found: np.ndarray | None = None

    @property
    def pose(self) -> np.ndarray | None:
        """A pose that meets the conditions, if one was found."""
        return None if self.found is None else self.found[: self._others.start]

    @property
    def _closure(self) -> slice:
        return slice(0, len(self._elements))

    @property
    def _others(self) -> slice:
        """Places of what is free besides the pose."""
        return slice(self.numeric.eom.q.numel(), self._unknowns.numel())

    def nearest(self, poses: Sequence[np.ndarray]) -> NearestPose | None:
        """The nearest pose if none meets the conditions, from some poses and from random ones; None if one may.

        One that does is kept in :attr:`found`.
        """
        given = [np.r_[q, self._values] for q in poses]
        if not self.rows:
            self.found = given[0]
            return None
        sizes = self._row_sizes(given)
        self.found = next((x for x in given if self._is_met(x, sizes)), None)
        if self.found is None:
            self.found = self._by_assembly(given[-1])
        if self.found is not None:
            return None
        random = np.random.default_rng(0)
        starts = [*given, *[self._random_start(poses, random) for _ in range(STARTS)]]
        sizes = self._row_sizes(starts)
        nearest, found = self._finder(sizes), list[np.ndarray]()
        for k, start in enumerate(starts):
            # conditions at first, as far as they can be met: an angle that is many turns away, for instance
            moved = self._turned(self._by_newton(start, sizes), sizes)
            if not self._is_met(moved, sizes):
                found.append(nearest(moved if k % 2 else start))
                moved = found[-1]
            if self._is_met(moved, sizes):
                self.found = moved
                return None
        misses = np.array([self._price(x, sizes) for x in found])
        least = float(np.min(misses))
        if not least < np.inf or np.sum(misses <= (1 + SAME_MISS) * least) < AGREEING:
            return None
        return self._nearest_pose(found[int(np.argmin(misses))], sizes, len(found))

    # --- poses to begin with --------------------------------------------------------------------
    @property
    def _values(self) -> np.ndarray:
        """Values to begin with of what is free."""
        return np.array([np.clip(f.value, f.lower, f.upper) for f in self.free])

    def _random_start(self, poses: Sequence[np.ndarray], random: np.random.Generator) -> np.ndarray:
        """A random pose, in which the linkage is closed if it can be, with random values of what is free."""
        numeric, near, (*parameters, time) = self.numeric, poses[int(random.integers(len(poses)))], self.free
        reach = np.where(numeric.eom.angles, np.pi, FARTHEST * numeric.scale.coordinates)
        q = near + reach * random.uniform(-1, 1, near.size)
        t = float(random.uniform(time.lower, time.upper))
        rows = PoseProblem(numeric, [], t, self._z).rows_with([])
        closed = solve(rows, q, numeric.weights, step_limit=numeric.step_limit).x
        steps = random.uniform(-1, 1, len(parameters))
        values = [
            np.clip(f.value + 0.5 * f.size * step, f.lower, f.upper) for f, step in zip(parameters, steps, strict=True)
        ]
        return np.r_[closed if largest(closed) < np.inf else q, values, t]

    def _by_assembly(self, x: np.ndarray) -> np.ndarray | None:
        """The point whose pose is assembled from another one, at the values that what is free has to begin with."""
        *parameters, _ = self.free
        symbols = ca.vertcat(ca.SX(0, 1), *[f.symbol for f in parameters])
        values = x[self._others]
        known = [replace(c, expression=ca.substitute(c.expression, symbols, ca.DM(values[:-1]))) for c in self.rows]
        try:
            with without_warnings():
                q = PoseProblem(self.numeric, known, float(values[-1]), self._z).solve(x[: self._others.start])
        except MechanismError:
            return None
        return np.r_[q, values]

    def _by_newton(self, x: np.ndarray, sizes: np.ndarray) -> np.ndarray:
        """Point at which equalities are met, or missed by least in the sum of squares, from another one."""
        chosen = np.flatnonzero(self._equality)

        def rows(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            values, slopes = self._function(x)
            return (values.ravel() / sizes)[chosen], (slopes / sizes[:, None])[chosen]

        moved = solve(rows, x, self._sizes**-2, step_limit=self._sizes).x
        return moved if largest(moved) < np.inf else x

    def _turned(self, x: np.ndarray, sizes: np.ndarray) -> np.ndarray:
        """The point with bodies turned by whole turns as long as less is missed: limits may be met so alone."""
        price = self._price(x, sizes)
        for k in np.flatnonzero(self.numeric.eom.angles).tolist():
            for turn in (2 * np.pi, -2 * np.pi):
                while (less := self._price(turned := x + turn * np.eye(x.size)[k], sizes)) < (1 - SAME_MISS) * price:
                    x, price = turned, less
        return x

    # --- the nearest pose -----------------------------------------------------------------------
    def _row_sizes(self, points: Sequence[np.ndarray]) -> np.ndarray:
        """Typical changes of the rows (k,): the largest ones at some points."""
        changes = [np.abs(self._function(x)[1]) @ self._sizes for x in points]
        size = np.max(np.where(np.isfinite(changes), changes, 0.0), axis=0)
        return np.where(size > 0, size, 1.0)

    def _misses(self, x: np.ndarray, sizes: np.ndarray) -> np.ndarray:
        """Amounts by which rows are missed, in their typical sizes (k,)."""
        values = self._function(x)[0].ravel() / sizes
        return np.where(self._equality, np.abs(values), np.maximum(values, 0.0))

    def _is_met(self, x: np.ndarray, sizes: np.ndarray) -> bool:
        """True if what is missed at a point is so little that the solver may meet it, or is not known."""
        beyond = max(max(f.lower - v, v - f.upper) for v, f in zip(x[self._others], self.free, strict=True))
        return beyond <= OUT_OF_REACH and not largest(self._misses(x, sizes)) > OUT_OF_REACH

    def _price(self, x: np.ndarray, sizes: np.ndarray) -> float:
        """Square root of the sum of the squares of what is missed, with that of gaps of the linkage."""
        misses = self._misses(x, sizes)
        misses[self._closure] *= np.sqrt(CLOSED)
        return float(np.linalg.norm(misses))

    def _finder(self, sizes: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """Function from a point to the one near to it at which least is missed, within the limits of what is free."""
        missed = ca.SX.sym("missed", sizes.size)
        rows = self._expressions / ca.DM(sizes) - missed
        equal, unequal = (
            ca.vertcat(ca.SX(0, 1), *[rows[k] for k in np.flatnonzero(which).tolist()])
            for which in (self._equality, ~self._equality)
        )
        bounds = [
            sign * (f.symbol - bound)
            for f in self.free
            for sign, bound in ((-1, f.lower), (1, f.upper))
            if np.isfinite(bound)
        ]
        prices = np.ones(sizes.size)
        prices[self._closure] = CLOSED
        find = nearest_finder(
            ca.vertcat(self._unknowns, missed), [equal], [unequal, *bounds], np.r_[NEARNESS / self._sizes**2, prices]
        )
        return lambda x: find(np.r_[x, np.zeros(sizes.size)])[: x.size]

    # --- what is reported -----------------------------------------------------------------------
    def _nearest_pose(self, x: np.ndarray, sizes: np.ndarray, starts: int) -> NearestPose:
        misses, count = self._misses(x, sizes), len(self._elements)
        shown = [k for k in np.argsort(-misses).tolist() if k >= count and misses[k] > SHOWN * np.max(misses[count:])]
        missed = tuple(self._missed(self.rows[k - count], misses[k] * sizes[k], sizes[k]) for k in shown)
        return NearestPose(missed, *self._held_by(x, sizes), starts, float(x[-1]))

    def missed(self, amounts: Mapping[int, float], q: np.ndarray) -> tuple[MissedCondition, ...]:
        """Conditions that are missed by amounts, by their places, the largest first; with sizes as in a pose."""
        sizes = self._row_sizes([np.r_[q, self._values]])[len(self._elements) :]
        shown = sorted(amounts, key=lambda k: -amounts[k] / sizes[k])
        return tuple(self._missed(self.rows[k], amounts[k], sizes[k]) for k in shown)

    def _missed(self, condition: Condition, amount: float, size: float) -> MissedCondition:
        return MissedCondition(condition.label, float(amount), condition.unit, float(amount / size))

    def _held_by(self, x: np.ndarray, sizes: np.ndarray) -> tuple[tuple[str, ...], tuple[str, ...]]:
        """Joints that carry a load if what is missed pulls like springs, and limits of what is free that do."""
        values, slopes = self._function(x)
        slopes = slopes * self._sizes / sizes[:, None]
        pulls = np.where(self._equality, values.ravel() / sizes, self._misses(x, sizes))
        count, n = len(self._elements), self.numeric.eom.q.numel()
        pull = pulls[count:] @ slopes[count:]
        loads = np.linalg.lstsq(slopes[:count, :n].T, -pull[:n], rcond=None)[0]
        rest = pull + loads @ slopes[:count]
        largest_load = np.max(np.abs(loads), initial=0.0)
        joints = [self._elements[k] for k in np.flatnonzero(np.abs(loads) > HOLDING * largest_load).tolist()]
        limits = []
        for p, value, push in zip(self.free[:-1], x[n:-1].tolist(), rest[n:-1].tolist(), strict=True):
            for bound, sign, relation in ((p.lower, 1, ">="), (p.upper, -1, "<=")):
                near = abs(value - bound) <= AT_LIMIT * max(1.0, abs(bound))
                if near and sign * push > HOLDING * largest(pulls):
                    limits.append(f"{p.label} {relation} {bound:g}")
        return tuple(dict.fromkeys(joints)), tuple(limits)
