"""Program of least violation: limits and conditions yield, and the amounts by which they yield are a cost."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from .collocation_program import Bounds, CollocationProgram
from .limit_sides import LimitSides, Slacks
from .sparse_program import derivatives_for_ipopt


class ElasticProgram:
    """A program in which one slack for each limit, and each condition, adds to what its rows allow.

    The sum of the slacks is least, but for half the square of the distance from the guess, with a weight `nearness`,
    and the cost of the program itself, with a weight `cost_weight`; equations of motion, constraints and continuity
    hold, and with `limits_alone` equalities that the user stated. With a weight of the cost that is small enough the
    slacks are an exact penalty. A sum that ends above zero is a least violation near its start, since the program is
    not convex.
    """

    def __init__(
        self,
        program: CollocationProgram,
        bounds: Bounds,
        nearness: float,
        cost_weight: float = 0.0,
        *,
        limits_alone: bool = False,
    ):
        self.program, self._bounds, self._nearness, self._cost_weight = program, bounds, nearness, cost_weight
        sides = LimitSides(program, at_places=True, conditions=not limits_alone)
        self.names = list(sides.sides)
        n, m, count = program.size, sides.row_count, len(self.names)
        places = [sides.places(name, sign) for sign in (1, -1) for name in self.names]
        bounded = np.unique(np.concatenate([*places, []])).astype(int)
        #: variables whose bounds yield: they become rows
        self._yielding = bounded[bounded >= m] - m
        pattern = np.zeros((m + self._yielding.size, 2 * count))
        for k, own in enumerate(places):
            rows = [place if place < m else m + int(np.searchsorted(self._yielding, place - m)) for place in own]
            pattern[rows, k] = 1.0 if k < count else -1.0
        single = [side.place for of in sides.sides.values() for side in of if side.equality and not side.repeated]
        #: rows of which both sides yield: the lower ones become rows of their own, since a slack that both share would
        #: narrow one side as it widens the other; not those of an equality at one place
        both = np.flatnonzero((pattern[:, :count] > 0).any(axis=1) & (pattern[:, count:] < 0).any(axis=1))
        self._both = np.setdiff1d(both, single)
        below = np.hstack([np.zeros((self._both.size, count)), pattern[self._both, count:]])
        pattern[self._both, count:] = 0.0
        self._slacks = ca.sparsify(ca.DM(np.vstack([pattern, below])))
        self._n, self._m, self._count = n, m, 2 * count

    @property
    def size(self) -> int:
        """Number of variables, slacks included."""
        return self._n + self._count

    @property
    def rows(self) -> int:
        """Number of rows."""
        return self._m + int(self._yielding.size) + int(self._both.size)

    def solver(self, options: dict[str, Any]) -> ca.Function:
        """IPOPT with all derivatives given; parameters are those of the program and the guess."""
        nlp, n, yielding = self.program.nlp, self._n, self._yielding.tolist()
        y, p = ca.MX.sym("y", self.size), ca.MX.sym("p", nlp.data_size + n)
        x, slacks, data, near = y[:n], y[n:], p[: nlp.data_size], p[nlp.data_size :]
        lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", self.rows)
        derivatives, weight = nlp.derivatives, self._cost_weight
        rows, jacobian = derivatives["jac_g"](x, data)
        cost = ca.sum1(slacks) + 0.5 * self._nearness * ca.dot(x - near, x - near)
        slopes_of_cost = self._nearness * (x - near)
        if weight:
            own, own_slopes = derivatives["grad_f"](x, data)
            cost, slopes_of_cost = cost + weight * own, slopes_of_cost + weight * own_slopes
        gradient = ca.vertcat(slopes_of_cost, ca.MX.ones(self._count))
        stacked, both = self._m + len(yielding), self._both.tolist()
        repeated = ca.vertcat(ca.DM.eye(stacked), ca.DM.eye(stacked)[both, :])
        rows = ca.mtimes(repeated, ca.vertcat(rows, x[yielding])) - ca.mtimes(self._slacks, slacks)
        picked = ca.DM.eye(n)[yielding, :]
        slopes = ca.horzcat(ca.mtimes(repeated, ca.vertcat(jacobian, picked)), -self._slacks)
        hessian = derivatives["hess_lag"](x, data, lam_f * weight, ca.mtimes(repeated.T, lam_g)[: self._m])
        hessian += lam_f * self._nearness * ca.DM.eye(n)
        hessian = ca.diagcat(hessian, ca.MX(self._count, self._count))
        functions = derivatives_for_ipopt((y, p, lam_f, lam_g), (cost, gradient), (rows, slopes), hessian)
        return ca.nlpsol("violation", "ipopt", {"x": y, "p": p, "f": cost, "g": rows}, functions | options)

    @property
    def limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Bounds of the variables of the program that do not yield."""
        lower, upper = self._bounds.lower.copy(), self._bounds.upper.copy()
        lower[self._yielding], upper[self._yielding] = -np.inf, np.inf
        return lower, upper

    def arguments(self, x0: np.ndarray, data: np.ndarray, rows: np.ndarray) -> dict[str, np.ndarray]:
        """Arguments of the solver: the guess with slacks that satisfy all rows, and the bounds."""
        bounds = self._bounds
        lower, upper = self.limits
        low = np.r_[bounds.rows_lower, bounds.lower[self._yielding]]
        high = np.r_[bounds.rows_upper, bounds.upper[self._yielding]]
        values = np.r_[rows, x0[self._yielding]]
        low, high = np.r_[low, low[self._both]], np.r_[high, np.full(self._both.size, np.inf)]
        low[self._both], values = -np.inf, np.r_[values, values[self._both]]
        passed = np.abs(self._slacks.full()) * np.maximum(np.maximum(values - high, low - values), 0.0)[:, None]
        slacks = np.max(passed, axis=0, initial=0.0)
        return {
            "x0": np.r_[x0, slacks],
            "p": np.r_[data, x0],
            "lbx": np.r_[lower, np.zeros(self._count)],
            "ubx": np.r_[upper, np.full(self._count, np.inf)],
            "lbg": low,
            "ubg": high,
        }

    def split(self, y: np.ndarray) -> tuple[np.ndarray, Slacks]:
        """Variables of the program, and slacks by name, scaled."""
        half = self._count // 2
        slacks = y[self._n :]
        return y[: self._n], dict(zip(self.names, np.maximum(slacks[:half], slacks[half:]).tolist(), strict=True))
