"""Groups of what is joined."""

from __future__ import annotations

import numpy as np


def groups_of(joined: np.ndarray) -> list[list[int]]:
    """Return the numbers that are joined, also by way of others, as one list each.

    Parameters
    ----------
    joined : numpy.ndarray of bool
        True where one number is joined to another (k, k), in either order.
    """
    reached = joined | joined.T | np.eye(len(joined), dtype=bool)
    for _ in range(len(joined).bit_length()):
        reached = reached @ reached
    return [np.flatnonzero(row).tolist() for k, row in enumerate(reached) if np.argmax(row) == k]
