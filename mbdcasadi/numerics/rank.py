"""Rank of a constraint Jacobian, dependent rows, null spaces."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from .scattered import scattered
from .tolerances import RANK

#: Smallest singular value, relative to the largest one, from which rows are independent without a closer look.
INDEPENDENT = 1e-4
#: Component in the left null space from which a row takes part in a dependency.
TAKES_PART = 1e-6
#: Steps of inverse iteration by which that is estimated for a large matrix.
INVERSE_ITERATIONS = 5


@dataclass(frozen=True)
class RankAnalysis:
    """Rank of a matrix and what its rows have in common.

    Attributes
    ----------
    rank : int
        Number of independent rows.
    singular_values : numpy.ndarray
        Of the matrix with its columns scaled, largest first.
    null_rows : numpy.ndarray
        Orthonormal combinations of rows that vanish (k, m).
    null_columns : numpy.ndarray
        Orthonormal basis of the null space, scaled columns (n, n - rank).
    """

    rank: int
    singular_values: np.ndarray
    null_rows: np.ndarray
    null_columns: np.ndarray

    def rank_at(self, tolerance: float) -> int:
        """Number of singular values above a share of the largest one."""
        return int(np.sum(self.singular_values > tolerance * np.max(self.singular_values, initial=0.0)))


def analyse_rank(matrix: np.ndarray, tolerance: float = RANK) -> RankAnalysis:
    """Find the rank of a matrix and its left and right null spaces by singular values.

    Parameters
    ----------
    matrix : numpy.ndarray
        (m, n), scaled so that its entries compare.
    tolerance : float
        Relative size below which a singular value counts as zero.
    """
    m, n = matrix.shape
    if m == 0 or n == 0:
        return RankAnalysis(0, np.zeros(0), np.eye(m), np.eye(n))
    left, values, right = np.linalg.svd(matrix)
    rank = int(np.sum(values > tolerance * max(values[0], np.finfo(float).tiny)))
    return RankAnalysis(rank, values, left[:, rank:].T, right[rank:].T)


def surely_independent(matrix: np.ndarray) -> bool:
    """Return True if rows are independent by far; False if that takes a closer look.

    A bound that costs less than the singular values: the smallest one of A is at least
    ``||(A A^T)⁻¹||_F^(-1/2)``.

    Parameters
    ----------
    matrix : numpy.ndarray
        (m, n), with rows of length one.
    """
    m, n = matrix.shape
    return m <= n and inverse_of_independent(matrix @ matrix.T) is not None


def inverse_of_independent(square: np.ndarray) -> np.ndarray | None:
    """Return the inverse of ``A A^T``, if the rows of A are independent by far; else None."""
    try:
        inverse = np.linalg.inv(square)
    except np.linalg.LinAlgError:
        return None
    # the square of the largest singular value is at most a sum of absolute values
    with np.errstate(over="ignore"):  # an infinite condition is that of dependent rows
        condition = np.max(np.sum(np.abs(square), axis=1), initial=0.0) * np.linalg.norm(inverse)
    return inverse if condition < 1 / INDEPENDENT**2 else None


def surely_independent_sparse(matrix: ca.DM) -> bool:
    """True if the rows of a large sparse matrix are independent, by an estimate with a wide margin."""
    m, n = matrix.shape
    if m > n:
        return False
    square = matrix @ matrix.T
    pivots, lower, order = ca.ldl(square)
    if not np.all(pivots.full() > 0):  # neither if one is not finite
        return False
    vector, size = ca.DM(scattered(m)), np.inf
    for _ in range(INVERSE_ITERATIONS):
        vector = ca.ldl_solve(vector / ca.norm_2(vector), pivots, lower, order)
        size = float(ca.norm_2(vector))
    return bool(float(ca.norm_inf(ca.sum2(ca.fabs(square)))) * size < 1 / INDEPENDENT**2)


def sparse_rank(matrix: ca.DM, tolerance: float = RANK) -> int:
    """Rank of a large sparse matrix with scaled rows, by sparse QR of its transpose.

    A row that depends on others leaves a diagonal entry of R that vanishes; the
    singular values of a large matrix would cost a hundred times as much.
    """
    if matrix.size1() > matrix.size2():
        return sparse_rank(matrix.T, tolerance)
    _, triangle, *_ = ca.qr_sparse(matrix.T)
    diagonal = np.abs(ca.diag(triangle).full().ravel())
    return int(np.sum(diagonal > tolerance * np.max(diagonal, initial=0.0)))


def row_lengths(matrix: np.ndarray) -> np.ndarray:
    """Lengths of rows (m,); one for those that vanish."""
    size = np.linalg.norm(matrix, axis=1)
    return np.where(size > 1e-12, size, 1.0)


def unit_rows(matrix: np.ndarray) -> np.ndarray:
    """Rows divided by their lengths; those that vanish stay as they are."""
    return matrix / row_lengths(matrix)[:, None]


def dependent_rows(matrix: np.ndarray, tolerance: float = RANK) -> list[int]:
    """Rows that depend on rows before them, in order (Gram–Schmidt with re-orthogonalisation)."""
    basis = np.zeros((0, matrix.shape[1]))
    scale = max((np.linalg.norm(row) for row in matrix), default=0.0)
    dependent = []
    for k, row in enumerate(matrix):
        rest = row - basis.T @ (basis @ row)
        rest -= basis.T @ (basis @ rest)
        size = np.linalg.norm(rest)
        if size <= 10 * tolerance * scale:
            dependent.append(k)
        else:
            basis = np.vstack([basis, rest / size])
    return dependent


def rows_taking_part(null_rows: np.ndarray) -> list[int]:
    """Rows that take part in a dependency: those with a component in the left null space."""
    if null_rows.shape[0] == 0:
        return []
    weight = np.linalg.norm(null_rows, axis=0)
    return [int(k) for k in np.flatnonzero(weight > TAKES_PART)]
