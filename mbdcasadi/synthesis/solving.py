"""From the end of a descent to a solution: Newton's method, or the least sum of squares, and what is free there."""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from ..numerics.lazy import cached_property
from ..numerics.least_squares import largest
from ..numerics.rank import analyse_rank
from ..numerics.symbolic import LOCK
from ..numerics.tolerances import DEPENDENT, RANK
from .descent import MET
from .eliminated import Eliminated, Rows
from .positions import Positions
from .residuals import Residuals

#: Iterations of Newton's method, and residual over its size from which there is a solution.
NEWTON, SOLVED = 12, 1e-10
#: Shares of a step of which the first one that comes nearer is taken.
SHARES = (1.0, 0.5, 0.25, 0.125)
#: Sum of squares, divided by sizes, below which the nearest linkage may meet all positions.
MAY_BE_EXACT = 1e-8
#: Singular value of scaled rows, relative to the largest one, from which a solution is a single point: at others
#: Newton's method ends at the root of rounding.
ISOLATED = 1e-8
#: Step along what is free at a singular solution, by which a family is told from a point, in sizes of the unknowns.
FAMILY_STEP = 1e-3
#: Random points at which the rank of all rows is found.
POINTS = 3
#: Accuracy of the least sum of squares, and its iterations.
ACCURACY, ITERATIONS = 1e-12, 200


@dataclass(frozen=True, eq=False)
class Solution:
    """Poses (positions, k), unknowns (n,), and the rows (m,) in their own units."""

    y: np.ndarray
    p: np.ndarray
    rows: np.ndarray
    #: Dimension of the family of linkages to which it belongs, more than positions leave free in general
    family: int = 0

    @property
    def residual(self) -> float:
        """Largest amount by which a row is missed."""
        return largest(self.rows)


class Solving:
    """Newton's method on all rows, in poses and unknowns.

    Parameters
    ----------
    positions : Positions
        The rows.
    residuals : Residuals
        Their compiled functions.
    exact : bool
        False if relations hold as nearly as can be.
    """

    def __init__(self, positions: Positions, residuals: Residuals, *, exact: bool):
        self.positions, self.residuals, self.exact = positions, residuals, exact
        rows = [*positions.fixed_rows, *positions.limit_rows, *(r for each in positions.rows for r in each)]
        self.names, self.row_sizes = [row.name for row in rows], np.array([row.size for row in rows])
        fixed, limits = len(positions.fixed_rows), len(positions.limit_rows)
        self._is_limit = np.zeros(len(rows), bool)
        self._is_limit[fixed : fixed + limits] = True
        self._pose_sizes, self._sizes = np.where(positions.turning, 1.0, positions.length), positions.sizes
        self.columns = residuals.count * residuals.k + residuals.n
        #: linkages whose sum of squares had not settled when iterations ended
        self.unsettled = 0
        self.rank, self.equations = self._generic_ranks()

    @property
    def free(self) -> int:
        """Number of dimensions that the positions leave free."""
        return self.columns - self.rank

    def _scaled(self, y: np.ndarray, p: np.ndarray) -> Rows:
        """Rows with slopes by poses and unknowns divided by their sizes."""
        rows = self.residuals.rows(y, p)
        to_pose, to_unknown = rows.to_pose * self._pose_sizes, rows.to_unknown * self._sizes
        return replace(rows, fixed_slopes=rows.fixed_slopes * self._sizes, to_pose=to_pose, to_unknown=to_unknown)

    def _eliminated(self, rows: Rows, tolerance: float) -> Eliminated:
        """Rows of length one without limits, poses eliminated."""
        return Eliminated(rows.of_length_one().times(~self._is_limit), tolerance)

    def _generic_ranks(self) -> tuple[int, int]:
        """Rank of the rows at random dimensions and poses, alike if positions are, and number of those that count.

        A row that follows from others has a slope and a value that follow from theirs.
        """
        random, ranks = np.random.default_rng(0), [(0, 0)]
        for _ in range(POINTS):
            y = random.uniform(-np.pi, np.pi, size=(self.residuals.count, self.residuals.k))
            y = np.array([*y, self.positions.start])[self.positions.twins] if len(y) else y
            p = self.positions.drawn_values + self.positions.sizes * random.normal(size=self.residuals.n)
            rows = self._scaled(y, p)
            if rows.are_finite:
                given = self._eliminated(rows, RANK)
                both = np.column_stack([given.slopes, given.values])
                rank, independent = (given.rank_of_poses + analyse_rank(x).rank for x in (given.slopes, both))
                ranks.append((rank, independent))
        rank, independent = max(ranks)
        return rank, independent if independent <= self.columns else int(np.sum(~self._is_limit))

    def _onto(self, y: np.ndarray, p: np.ndarray, chosen: np.ndarray) -> tuple[np.ndarray, np.ndarray, Rows] | None:
        """Least steps to where chosen rows vanish: poses, unknowns, and rows there; None if they do not."""
        rows = self._scaled(y, p)
        for _ in range(NEWTON):
            if not rows.are_finite:
                return None
            dy, dp = Eliminated(rows.times(chosen), DEPENDENT).step()
            for share in SHARES:
                moved, to = y + share * self._pose_sizes * dy, p + share * self._sizes * dp
                there = self._scaled(moved, to)
                if nearer := largest(there.all[chosen]) < largest(rows.all[chosen]):
                    y, p, rows = moved, to, there
                    break
            if not nearer:
                break
        return (y, p, rows) if largest(rows.all[chosen]) < SOLVED else None

    def newton(self, y: np.ndarray, p: np.ndarray) -> Solution | None:
        """The solution near to an estimate; None if there is none, or it is no linkage of its own."""
        found = self._onto(y, p, np.ones(self._is_limit.size, bool))
        if found is None or self.residuals.degenerate(found[1][None])[0]:
            return None
        y, p, rows = found
        solution = Solution(y, p, rows.all * self.row_sizes)
        if not self.exact:
            return solution
        given = self._eliminated(rows, ISOLATED)
        analysis = analyse_rank(given.slopes, ISOLATED)
        if given.rank_of_poses + analysis.rank >= self.rank:
            return solution
        family = self._family(y, p, [(given.along(dp), dp) for dp in analysis.null_columns.T]) - self.free
        return replace(solution, family=family) if family > 0 else None

    def _family(self, y: np.ndarray, p: np.ndarray, directions: list[tuple[np.ndarray, np.ndarray]]) -> int:
        """Number of the directions in which other linkages lie beside one; at a point where roots meet, none do."""
        count, all_rows = 0, np.ones(self._is_limit.size, bool)
        for dy, dp in directions:
            there = self._onto(y + FAMILY_STEP * self._pose_sizes * dy, p + FAMILY_STEP * self._sizes * dp, all_rows)
            if there is not None:
                count += largest((there[1] - p) / self._sizes) > FAMILY_STEP / 2 * largest(dp)
        return count

    def nearest(self, y: np.ndarray, p: np.ndarray) -> Solution | None:
        """The closed linkage near to an estimate that misses relations by the least sum of squares.

        It misses no more than the estimate with its joints closed and its conditions met.
        """
        if np.sum(self.residuals.rows(y, p).all ** 2) < MET and (solved := self.newton(y, p)) is not None:
            return solved
        closed = self._onto(y, p, self._held)
        if closed is None:
            return None
        y, p = closed[:2]
        with np.errstate(all="ignore"):
            program, lower = self._least_squares
            x = program(x0=np.concatenate([y.ravel(), p]) / self._columns, lbg=lower, ubg=0.0)["x"].full().ravel()
        self.unsettled += program.stats()["return_status"] == "Maximum_Iterations_Exceeded"
        x *= self._columns
        best = self._onto(x[: y.size].reshape(y.shape), x[y.size :], self._held)
        if best is None or np.sum(best[2].all ** 2) > np.sum(closed[2].all ** 2):
            best = closed
        y, p, rows = best[0], best[1], best[2].all
        if np.sum(rows**2) < MAY_BE_EXACT and (solved := self.newton(y, p)) is not None:
            return solved
        return None if self.residuals.degenerate(p[None])[0] else Solution(y, p, rows * self.row_sizes)

    @property
    def _columns(self) -> np.ndarray:
        """Sizes of all poses and the unknowns."""
        return np.concatenate([np.tile(self._pose_sizes, self.residuals.count), self._sizes])

    @property
    def _held(self) -> np.ndarray:
        """Rows that hold, however near relations are met: conditions, limits and those that close the linkage."""
        positions = self.positions
        closing = len(positions.closing_rows)
        held = [np.arange(len(positions.fixed_rows)) < positions.held, np.ones(len(positions.limit_rows), bool)]
        return np.concatenate([*held, *(np.arange(len(each)) < closing for each in positions.rows)])

    @cached_property
    def _least_squares(self) -> tuple[ca.Function, np.ndarray]:
        """Program of the least sum of squares of relations in unknowns divided by their sizes, and its lower limits."""
        with LOCK:
            positions, closing = self.positions, len(self.positions.closing_rows)
            poses = [ca.SX.sym("y", self.residuals.k) for _ in positions.residuals]
            columns = [ca.substitute(c, positions.y, y) for c, y in zip(positions.residuals, poses, strict=True)]
            missed = [positions.fixed[positions.held :], *(column[closing:] for column in columns)]
            held = [positions.fixed[: positions.held], *(column[:closing] for column in columns), positions.limits]
            x, whole = ca.SX.sym("x", self.columns), ca.vertcat(*poses, positions.p)
            results = [ca.sumsqr(ca.vertcat(*missed)) / 2, ca.vertcat(*held)]
            cost, rows = ca.substitute(results, [whole], [x * ca.DM(self._columns)])
            ipopt = {"print_level": 0, "sb": "yes", "tol": ACCURACY, "max_iter": ITERATIONS}
            options = {"print_time": False, "error_on_fail": False, "ipopt": ipopt}
            program = ca.nlpsol("nearest", "ipopt", {"x": x, "f": cost, "g": rows}, options)
        lower = np.zeros(rows.numel())
        lower[rows.numel() - positions.limits.numel() :] = -np.inf
        return program, lower
