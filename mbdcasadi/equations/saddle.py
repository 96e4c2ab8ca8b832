"""The linear system of constrained dynamics, factorised once as expressions.

    [ W   J^T ] [ x   ]   [ f ]
    [ J    0  ] [ lam ] = [ g ]

With masses for W it gives accelerations and multipliers; with any other metric and ``f = 0`` the least change that
takes a residual of the rows away. With a regular W the multipliers follow from ``S lam = J W⁻¹ f - g``,
``S = J W⁻¹ J^T``, by a sparse symbolic LDL factorisation. If bodies are light or have no mass, ``W`` is replaced by
``W + J^T A J`` and ``f`` by ``f + J^T A g``, with effective masses A of the rows (see :mod:`.augmentation`): the
solution stays the same, since ``J x = g``, and the matrix is regular exactly if the joints hold all coordinates without
mass. Redundant rows make ``S`` singular; ``S + epsilon D`` with a diagonal D of its size, and refinement by conjugate
residuals, gives the multipliers of least norm ``lam^T D lam``.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from ..numerics.lazy import cached_property
from ..numerics.tolerances import DEPENDENT

#: Regularisation of S, relative to the mean of its diagonal. Chains of parallelograms that pass their flat, singular
#: pose keep their branch from 1e-10 to 1e-6 with the damping of :func:`.dynamics.stabilised`, and without it do not;
#: IDAS errs least at 1e-7, with which the peak of the accelerations is wide enough for it.
REGULARISATION = 1e-7
#: Rows for each of which large mechanisms take a step more, as they have more of the smallest eigenvalues.
ROWS_A_STEP = 100


@dataclass(frozen=True)
class Refinement:
    """How a system with rows that may depend on each other is solved, by the factors of ``S + epsilon D``.

    Attributes
    ----------
    steps : int
        Steps after the first solve; without any, motions that the rows resist little change by a part of what they
        should.
    weakest : float
        Eigenvalue of S, relative to its diagonal, below which rows count as dependent: what is left there is theirs.
        The smallest one of a cantilever falls with the fourth power of the number of its links: 4e-8 with sixty, 1e-9
        with 150.
    """

    steps: int
    weakest: float = 1e-9


#: One solve.
SHIFTED = Refinement(0)
#: Inside an integrator, whose poses drift from the constraints, and are singular at times: on two dozen chains of
#: parallelograms through some twenty singular poses each, the largest error fell from 3e-3 rad with one step to 1e-4
#: rad with three, all of them plain.
ON_THE_WAY = Refinement(3)
#: Steps onto the constraints beyond what a shift lets pass at once.
ONTO_ROWS = Refinement(4)
#: Multipliers that are reported: of these the least-norm solution is wanted to rounding.
REPORTED = Refinement(4, weakest=DEPENDENT)


class Saddle:
    """The system of some rows in a metric.

    Parameters
    ----------
    metric : casadi.SX
        W: its diagonal (n,), or the matrix (n, n).
    jacobian : casadi.SX
        Rows J (m, n).
    angular : numpy.ndarray
        True for rows in rad (m,).
    refinement : Refinement, optional
        How rows that may depend on each other are solved; None if they are independent.
    augmentation : numpy.ndarray, optional
        Effective masses A of the rows (m,), if W is nearly singular.
    slope : casadi.SX, optional
        Derivative of the load by the multipliers (n, m), which is then subtracted from ``J^T``: a step of Newton's
        method for forces that depend on reactions.
    norm : casadi.SX, optional
        Diagonal D (m,); without it ``1 / A``, or the means of the diagonal of S, of rows in m and in rad apart.
    is_shared : bool
        True to evaluate common subexpressions of ``W⁻¹ J^T`` and S once, as what follows repeats little; it pays for
        factors that serve several functions.
    """

    def __init__(
        self,
        metric: ca.SX,
        jacobian: ca.SX,
        angular: np.ndarray,
        refinement: Refinement | None = None,
        *,
        augmentation: np.ndarray | None = None,
        slope: ca.SX | None = None,
        norm: ca.SX | None = None,
        is_shared: bool = False,
    ):
        self.jacobian, self._angular, self._refinement = jacobian, angular, refinement
        self._is_symmetric, self._is_shared = slope is None, is_shared
        self._columns = jacobian.T if slope is None else jacobian.T - slope
        self._weighted, self._given_norm, self._is_matrix = None, norm, not metric.is_column()
        if augmentation is not None:
            self._weighted = jacobian.T @ ca.diag(ca.DM(augmentation))
            metric = ca.diag(metric) + self._weighted @ jacobian
            # the eigenvalues of A^½ S A^½ lie between 0 and 1
            self._given_norm = ca.SX(ca.DM(1 / augmentation)) if norm is None else norm
        self._inverse = ca.diag(1 / metric) if metric.is_column() else None
        self._metric_factors = None if metric.is_column() else ca.ldl(metric)

    def over(self, loads: ca.SX) -> ca.SX:
        """``W⁻¹`` times loads (n, k)."""
        if self._metric_factors is None:
            return self._inverse @ loads
        return ca.ldl_solve(ca.densify(loads), *self._metric_factors)

    @cached_property
    def _reduced(self) -> list[ca.SX]:
        columns = ca.sparsify(self.over(self._columns)) if self._is_matrix else self.over(self._columns)
        reduced = [columns, self.jacobian @ columns]
        return list(ca.cse(reduced)) if self._is_shared else reduced

    @property
    def columns(self) -> ca.SX:
        """``W⁻¹ J^T`` (n, m)."""
        return self._reduced[0]

    @property
    def schur(self) -> ca.SX:
        """``S = J W⁻¹ J^T`` (m, m); the determinant of the system is ``det W det(-S)``."""
        return self._reduced[1]

    @cached_property
    def _factors(self) -> tuple[ca.SX, ca.SX, list[int]]:
        return ca.ldl(self.schur)

    @cached_property
    def _norm(self) -> ca.SX:
        """Diagonal D of the norm in which multipliers of dependent rows are the least (m,)."""
        return row_sizes(ca.diag(self.schur), self._angular) if self._given_norm is None else self._given_norm

    @cached_property
    def _shifted_factors(self) -> tuple[ca.SX, ca.SX, list[int]]:
        return ca.ldl(self.schur + ca.diag(REGULARISATION * self._norm))

    # --- solutions --------------------------------------------------------------------------------
    def solve(self, load: ca.SX, gamma: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Return ``(x, lam)`` of right sides f (n, k) and g (m, k)."""
        if not self.jacobian.size1():
            return self.over(load), ca.SX(0, load.size2())
        load = load if self._weighted is None else load + self._weighted @ gamma
        free = self.over(load)
        lam = self.multipliers(self.jacobian @ free - gamma)
        # the columns of a matrix have few entries, and masses divide in fewer operations than they multiply
        return free - self.columns @ lam if self._is_matrix else self.over(load - self._columns @ lam), lam

    def project(self, residual: ca.SX) -> ca.SX:
        """Least change of the coordinates (n, k), in the metric, that adds a residual (m, k) to the rows."""
        return self.columns @ self.multipliers(residual)

    def multipliers(self, right: ca.SX) -> ca.SX:
        """``S⁻¹`` times a right side (m, k); of least norm if rows depend on each other."""
        if not self._is_symmetric:
            return ca.solve(self.schur, right)
        right = ca.densify(right)
        if self._refinement is None:
            return ca.ldl_solve(right, *self._factors)
        return self._refined(right, self._refinement) if self._refinement.steps else self._shifted(right)

    def pivot(self) -> ca.SX:
        """Smallest pivot of S, relative to its diagonal: it falls towards zero near a singular pose."""
        pivots, _, order = self._factors
        return ca.mmin(ca.densify(pivots) / ca.densify(ca.diag(self.schur))[list(order)])

    def _shifted(self, right: ca.SX) -> ca.SX:
        return ca.ldl_solve(right, *self._shifted_factors)

    def _refined(self, right: ca.SX, refinement: Refinement) -> ca.SX:
        """Multipliers by the shifted factors and refinement by conjugate residuals.

        A step of plain refinement leaves ``epsilon / (mu + epsilon)`` of what belongs to an eigenvalue mu, and the
        smallest of long chains are below epsilon. Conjugate residuals, with the factors as preconditioner, find each of
        these in about one step more. Unlike conjugate gradients they do not pursue what dependent rows contradict each
        other by, as drift, and they end where nothing else is left. The last step is a plain one: it brings what is
        small to its own accuracy. Where the right side is zero, or dependent rows alone are left, all steps are plain,
        and so linear in the right side: derivatives are those of plain refinement.

        References
        ----------
        Saad, "Iterative methods for sparse linear systems", 2nd ed., 2003, section 6.8.
        """
        matrix, solve = self.schur, self._shifted
        solution, rest, left = ca.SX.zeros(*right.shape), right, solve(right)
        direction = along = last = strong = where = None
        for _ in range(refinement.steps - 1 + matrix.size1() // ROWS_A_STEP):
            moved = matrix @ left
            size = ca.sum1(left * moved)
            is_strong = size > refinement.weakest * (self._norm.T @ left**2)
            if strong is None:
                strong, direction, along = is_strong, left, moved
            else:
                rest = rest - ca.if_else(where, 0, moved)
                strong = ca.logic_and(strong, is_strong)
                share = _for_each_column(_quotient(size, last, strong), left)
                direction, along = left + share * direction, moved + share * along
            # from where it is not, all further steps are plain, by what is left over: rounding is not added again
            where = _for_each_column(strong, left)
            answer = solve(ca.if_else(where, along, rest))
            length = _for_each_column(_quotient(size, ca.sum1(along * answer), strong), left)
            solution, rest = solution + ca.if_else(where, length * direction, answer), rest - length * along
            left, last = ca.if_else(where, left - length * answer, answer), size
        return solution + solve(right - matrix @ solution)


def row_sizes(diagonal: ca.SX, angular: np.ndarray) -> ca.SX:
    """Means of the diagonal of S, of the rows in m and in rad apart (m,)."""
    found = ca.SX(diagonal.numel(), 1)
    for unit in (angular, ~angular):
        rows = np.flatnonzero(unit).tolist()
        if rows:
            found[rows] = ca.sum1(diagonal[rows]) / len(rows)
    return found


def _quotient(one: ca.SX, other: ca.SX, defined: ca.SX) -> ca.SX:
    """Quotient where it is defined, else zero, with derivatives that are finite there."""
    return ca.if_else(defined, one, 0) / ca.if_else(defined, other, 1)


def _for_each_column(values: ca.SX, columns: ca.SX) -> ca.SX:
    """One value for each column, in all of its rows."""
    return ca.repmat(values, columns.size1(), 1)
