"""Exchanges of equal chains."""

from __future__ import annotations

import mbdcasadi as mbd
from mbdcasadi.synthesis.exchanges import exchanges
from mbdcasadi.synthesis.positions import Positions


def count(masses=1.0, forces=None):
    model = mbd.library.four_bar(0.5, 1.0, 0.9, 1.1, free=True, point=(0.1, 0.3), masses=masses)
    mechanism, positions = model.mechanism, [[model.point.x == 0.1], [model.point.x == 0.2]]
    if forces is not None:
        mechanism = mechanism.replace(forces=[*mechanism.forces, forces(model)])
    return len(exchanges(Positions(mechanism, list(model.unknowns.values()), positions, [], exact=True)))


def test_equal_chains_have_equal_masses_and_loads():
    """The torque of a crank is no load: it is what it must be."""
    assert count() == 2
    assert count(masses=(1, 1, 9)) == 1
    assert count(forces=lambda m: mbd.Force("weight", m.point, (0, -9.81))) == 2
    assert count(forces=lambda m: mbd.Force("weight", m.crank.at(0, 0), (0, -9.81))) == 1
