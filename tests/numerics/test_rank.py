"""Ranks of constraint Jacobians: quick answers agree with singular values, or say that they do not know."""

import casadi as ca
import numpy as np
import pytest

from mbdcasadi.numerics.rank import analyse_rank, sparse_rank, surely_independent, surely_independent_sparse


def with_smallest(value, m=12, n=20):
    """A matrix with rows of length one whose smallest singular value is about a share of the largest."""
    rng = np.random.default_rng(7)
    matrix = rng.standard_normal((m, n))
    matrix[-1] = matrix[0] + value * rng.standard_normal(n)
    return matrix / np.linalg.norm(matrix, axis=1, keepdims=True)


def sparse(matrix):
    rows, columns = np.nonzero(matrix)
    return ca.DM.triplet(rows.tolist(), columns.tolist(), ca.DM(matrix[rows, columns]), *matrix.shape)


@pytest.mark.parametrize("check", [surely_independent, lambda matrix: surely_independent_sparse(sparse(matrix))])
class TestSurelyIndependent:
    def test_well_conditioned(self, check):
        assert check(with_smallest(1.0)) and check(np.eye(3, 5))

    @pytest.mark.parametrize("value", [0.0, 1e-13, 1e-9, 1e-6])
    def test_dependent_or_nearly_so(self, check, value):
        """Below 1e-6 the decision is left to singular values."""
        assert not check(with_smallest(value))

    def test_never_against_singular_values(self, check):
        """If it says yes, the smallest singular value is above 1e-6 of the largest."""
        said = [value for value in 10.0 ** np.arange(-9.0, 1) if check(with_smallest(value))]
        for value in said:
            singular = analyse_rank(with_smallest(value)).singular_values
            assert singular[-1] > 1e-6 * singular[0]
        assert 1.0 in said

    def test_more_rows_than_columns_and_no_numbers(self, check):
        assert not check(with_smallest(1.0).T)
        assert not check(np.full((2, 3), np.nan))


def test_no_rows():
    assert surely_independent(np.zeros((0, 4)))


@pytest.mark.parametrize("value, rank", [(1.0, 12), (0.0, 11)])
def test_sparse_rank(value, rank):
    assert sparse_rank(sparse(with_smallest(value))) == analyse_rank(with_smallest(value)).rank == rank
