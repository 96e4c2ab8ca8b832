"""Positions of a synthesis: which pose is the drawn one, and sizes far from the drawing."""

from __future__ import annotations

import numpy as np
import pytest

import mbdcasadi as mbd

DRAWN = {"crank": 0.5, "coupler": 1.0, "rocker": 0.9, "base": 1.1, "point": (0.1, 0.3)}


@pytest.mark.parametrize("exact", [True, False])
def test_a_known_linkage_takes_its_first_position_at_any_pose(exact):
    """The place of the point on the coupler of a known four-bar, by two positions or by three as nearly as can be."""
    known = mbd.library.four_bar(**DRAWN)
    x, y = mbd.Parameter("x", 0.0), mbd.Parameter("y", 0.1)
    mechanism = known.mechanism.replace(parameters=[*known.mechanism.parameters, x, y])
    times = [0.1, 0.4] if exact else [0.1, 0.4, 0.6]
    places = mbd.kinematics(known.driven(crank=0.9 + 2 * np.pi * mbd.t), times)[known.point.position]
    point = known.coupler.at(x, y)
    positions = [[point.position == place] for place in places]
    found = mbd.synthesize(mechanism, [x, y], positions, exact=exact, seconds=4)
    assert min(np.hypot(one[x] - 0.1, one[y] - 0.3) for one in found) < 1e-9


@pytest.mark.parametrize("size", [200, 1e5])
def test_positions_may_be_far_larger_than_the_drawing(size):
    model = mbd.library.four_bar(**DRAWN, free=True)
    positions = [
        [model.point.position == (0.65 * size, 0.8 * size)],
        [model.point.position == (0.5 * size, 0.9 * size)],
    ]
    found = mbd.synthesize(model.mechanism, list(model.unknowns.values()), positions, seconds=2)
    assert found.search.free == 7 and found[0].residual < 1e-8 * size
