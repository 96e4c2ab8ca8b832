"""Groups of what is joined."""

from __future__ import annotations

import numpy as np

from mbdcasadi.numerics.groups import groups_of


def test_groups():
    """Also by way of others, in either order; what is not joined is alone."""
    joined = np.zeros((6, 6), bool)
    joined[0, 3] = joined[5, 3] = joined[1, 4] = True
    assert groups_of(joined) == [[0, 3, 5], [1, 4], [2]]
    assert groups_of(np.zeros((0, 0), bool)) == []
