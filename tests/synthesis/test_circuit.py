"""Places of poses on a circuit, of four-bars with given angles of the crank."""

from __future__ import annotations

import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.synthesis.linkage import Linkage, Shared


@pytest.fixture(scope="module")
def through():
    """Linkages of a crank of 0.4, a coupler of 1.1, a rocker of 0.9 and a base of 1 m, at angles of the crank."""
    lengths = [mbd.Parameter(name, value) for name, value in (("a", 0.4), ("b", 1.1), ("c", 0.9))]
    a, b, c = lengths
    crank, coupler, rocker = (mbd.Body(name, mass=1, inertia=1) for name in ("crank", "coupler", "rocker"))
    joints = [
        mbd.Revolute("A", mbd.ground.at(0, 0), crank.at(0, 0)),
        mbd.Revolute("B", crank.at(a, 0), coupler.at(0, 0)),
        mbd.Revolute("C", coupler.at(b, 0), rocker.at(c, 0)),
        mbd.Revolute("D", mbd.ground.at(1, 0), rocker.at(0, 0)),
    ]
    shared = Shared(mbd.Mechanism([crank, coupler, rocker], joints=joints, parameters=lengths), tuple(lengths))
    values = np.array([0.4, 1.1, 0.9])

    def pose(angle):
        joint = 0.4 * np.exp(1j * angle)
        base = 1 - joint
        along = (1.1**2 - 0.9**2 + abs(base) ** 2) / (2 * abs(base))
        other = joint + base / abs(base) * (along + 1j * np.sqrt(1.1**2 - along**2))
        return [angle, np.angle(other - joint), np.angle(other - 1)]

    return lambda angles: Linkage(shared, values, np.array([pose(x) for x in angles]), {}, 0.0, 1)


@pytest.mark.parametrize(
    "angles, in_order",
    [
        ([0, 1, 2], True),
        ([0, -1, -2], True),
        ([0, 2, 1, 3], False),
        ([0, 1, 1, 2], True),
        ([0, 1, 1 + 1e-12, 2], True),
        ([0, 1, 1 - 1e-12, 2], True),
        ([0, 1, 2, 2 * np.pi], True),
    ],
)
def test_poses_that_differ_by_rounding_are_one_place(through, angles, in_order):
    assert through(angles).in_order is in_order


def test_the_transmission_angle_is_that_between_points_of_the_curve(through):
    least = min(np.arccos((1.1**2 + 0.9**2 - (1 + s * 0.4) ** 2) / (2 * 1.1 * 0.9)) for s in (1, -1))
    assert through([0, 1]).transmission_angle == pytest.approx(min(least, np.pi - least), abs=1e-9)
