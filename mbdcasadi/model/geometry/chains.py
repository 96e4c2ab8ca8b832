"""Closed outlines from lines and curves that meet at their ends."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


class Branching(Exception):
    """Error for more than two pieces that meet, with the point."""

    def __init__(self, point: np.ndarray):
        super().__init__(f"more than two lines meet at ({point[0]:.6g}, {point[1]:.6g})")
        self.point = point


def strung(pieces: Sequence[np.ndarray]) -> np.ndarray:
    """Return consecutive pieces (k, 2) as one, each turned so that it begins near the end of the one before."""
    chain = pieces[0]
    if len(pieces) > 1 and _gap(chain[0], pieces[1]) < _gap(chain[-1], pieces[1]):
        chain = chain[::-1]
    parts = [chain]
    for piece in pieces[1:]:
        end = parts[-1][-1]
        turned = np.linalg.norm(piece[-1] - end) < np.linalg.norm(piece[0] - end)
        parts.append((piece[::-1] if turned else piece)[1:])
    return np.vstack(parts)


def _gap(point: np.ndarray, piece: np.ndarray) -> float:
    return float(min(np.linalg.norm(point - piece[0]), np.linalg.norm(point - piece[-1])))


def closed_chains(pieces: Sequence[np.ndarray], joined: float) -> list[np.ndarray]:
    """Return the closed outlines of pieces (k, 2); those that lead nowhere are left out.

    Parameters
    ----------
    pieces : sequence of numpy.ndarray
        Lines and curves by their points.
    joined : float
        Distance up to which two ends are one point.

    Raises
    ------
    Branching
        If more than two of the pieces of outlines meet in a point.
    """
    loops = [piece[:-1] for piece in pieces if _is_closed(piece, joined)]
    open_ones = [piece for piece in pieces if not _is_closed(piece, joined)]
    left = _without_loose_ends({k: ends for k, ends in enumerate(_nodes(open_ones, joined)) if ends[0] != ends[1]})
    degrees = _degrees(left)
    branching = next((k for k, ends in left.items() if np.any(degrees[ends] > 2)), None)
    if branching is not None:
        raise Branching(open_ones[branching][0 if degrees[left[branching][0]] > 2 else -1])
    while left:
        loops.append(strung([open_ones[k] for k in _taken_chain(left)])[:-1])
    return [loop for loop in loops if len(loop) > 2]


def _degrees(ends: dict[int, np.ndarray]) -> np.ndarray:
    """Number of pieces that meet in each point (n,)."""
    return np.bincount(np.ravel(list(ends.values())).astype(int))


def _without_loose_ends(ends: dict[int, np.ndarray]) -> dict[int, np.ndarray]:
    """Pieces, by their points, of which each end is one of another piece."""
    while True:
        degrees = _degrees(ends)
        kept = {k: (a, b) for k, (a, b) in ends.items() if degrees[a] > 1 and degrees[b] > 1}
        if len(kept) == len(ends):
            return ends
        ends = {k: ends[k] for k in kept}


def _taken_chain(left: dict[int, np.ndarray]) -> list[int]:
    """Take pieces that follow each other and close out of those that are left; return their numbers."""
    first, (begin, node) = next(iter(left.items()))
    chain = [first]
    del left[first]
    while node != begin:
        following = next(k for k, ends in left.items() if node in ends)
        node = int(np.sum(left.pop(following)) - node)
        chain.append(following)
    return chain


def _is_closed(piece: np.ndarray, joined: float) -> bool:
    return len(piece) > 3 and bool(np.linalg.norm(piece[0] - piece[-1]) <= joined)


def _nodes(pieces: Sequence[np.ndarray], joined: float) -> np.ndarray:
    """Numbers of the points in which pieces begin and end (k, 2)."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    if not pieces:
        return np.zeros((0, 2), int)
    ends = np.vstack([piece[[0, -1]] for piece in pieces])
    a, b = cKDTree(ends).query_pairs(joined, output_type="ndarray").T
    pairs = coo_array((np.ones(a.size), (a, b)), shape=(len(ends), len(ends)))
    numbers: np.ndarray = connected_components(pairs, directed=False)[1]
    return numbers.reshape(-1, 2)
