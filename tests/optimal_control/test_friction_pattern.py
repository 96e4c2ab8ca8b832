"""Pieces of a motion in which friction sticks or slides one way."""

import numpy as np

from mbdcasadi.optimal_control.friction.pattern import Piece, joined
from mbdcasadi.optimal_control.transcription.mesh import Mesh

STICKS, FORTH, BACK = ("sticks",), ("forth",), ("back",)


def spans(pieces):
    """Begin, end and modes of pieces."""
    return [(piece.begin, piece.end, piece.senses) for piece in pieces]


def test_neighbours_of_one_mode_are_one_piece():
    """What is shorter than the least duration becomes part of the piece before it."""
    pieces = [Piece(0, 1, STICKS), Piece(1, 2, FORTH), Piece(2, 2.01, BACK), Piece(2.01, 3, FORTH), Piece(3, 4, STICKS)]
    assert spans(joined(pieces, 0.1)) == [(0, 1, STICKS), (1, 3, FORTH), (3, 4, STICKS)]
    assert len(joined(pieces, 0.001)) == 5


def test_first_piece_may_be_too_short():
    """It becomes part of the one after it."""
    assert spans(joined([Piece(0, 0.01, BACK), Piece(0.01, 1, FORTH)], 0.1)) == [(0, 1, FORTH)]


def test_waypoints_end_pieces():
    """A piece ends at a waypoint though the mode stays, and a short one before it leaves its end to the one before."""
    pieces = [
        Piece(0, 1, STICKS, waypoint=0),
        Piece(1, 2, STICKS),
        Piece(2, 2.01, FORTH, waypoint=1),
        Piece(2.01, 3, BACK),
    ]
    found = joined(pieces, 0.1)
    assert spans(found) == [(0, 1, STICKS), (1, 2.01, STICKS), (2.01, 3, BACK)]
    assert [piece.waypoint for piece in found] == [0, 1, None]


def test_short_piece_after_a_waypoint():
    """It becomes part of the one after it."""
    pieces = [Piece(0, 1, FORTH, waypoint=0), Piece(1, 1.01, BACK), Piece(1.01, 2, STICKS)]
    assert spans(joined(pieces, 0.1)) == [(0, 1, FORTH), (1, 2, STICKS)]


def test_longest_interval_is_kept():
    """A mesh whose points have moved has the same limit of its intervals; meshes with other limits share no program."""
    mesh = Mesh.equal(4, np.array([0.0, 2.0])).with_moving([1, 2, 3])
    limited = Mesh(mesh.segments, mesh.moving, longest=0.5)
    moved = limited.moved(np.array([0.0, 0.3, 1.0, 1.4, 2.0]))
    assert moved.longest == 0.5
    np.testing.assert_allclose(moved.times(np.array([0.0, 2.0])), [0.0, 0.3, 1.0, 1.4, 2.0])
    assert limited.structure != mesh.structure
