"""Measures of a mesh: the pieces that errors ask for, and what they miss."""

from __future__ import annotations

import numpy as np
import pytest
from motions import crank_rocker, half_turn, rest_to_rest

import mbdcasadi as mbd
from mbdcasadi.optimal_control.measures.local_error import LocalErrors
from mbdcasadi.optimal_control.measures.measure import PIECES, pieces_of
from mbdcasadi.optimal_control.search.refine import COARSE_MEASURES, MEASURES


def test_pieces_go_with_the_power_of_the_length():
    """Half the tolerance is foreseen: 16 times the tolerance at order 5 needs ``32^(1/5) = 2`` pieces."""
    errors = np.array([0.0, 1e-6, 15.9e-6, 16.1e-6, np.inf, np.nan])
    assert pieces_of(errors, 1e-6, 5).tolist() == [1, 1, 2, 3, PIECES, PIECES]
    assert pieces_of(errors[2:4], 1e-6, 1).tolist() == [PIECES, PIECES]


@pytest.fixture(scope="module")
def solution():
    """A least effort, which polynomials of the transcription follow exactly."""
    return mbd.optimize(rest_to_rest()[0], intervals=6)


def test_a_solution_that_meets_all_has_nothing_to_say(solution):
    """No measure splits an interval, or moves a mesh point."""
    (part,) = solution.phases
    for measure in [make(solution, 1e-3) for make in (LocalErrors, *MEASURES, *COARSE_MEASURES)]:
        assert not measure.sentences() and measure.largest <= measure.tolerance, type(measure)
        assert np.array_equal(measure.pieces(part), np.ones(6)) and not measure.spread
        assert measure.placed(part, part.mesh) is part.mesh and not measure.moves


def test_the_local_error_is_named():
    """A coarse mesh misses a tight tolerance."""
    measure = LocalErrors(mbd.optimize(half_turn(crank_rocker()), intervals=12), 1e-12)
    assert measure.sentences() == [f"the local error is still {measure.largest:.2g}"] and measure.largest > 1e-12
