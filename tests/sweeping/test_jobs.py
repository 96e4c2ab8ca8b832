"""Cases of sweeps whose varying quantities leave their ranges."""

from __future__ import annotations

import numpy as np
import pytest

import mbdcasadi as mbd


@pytest.mark.parametrize("method", ["idas", "dop853"])
def test_a_case_whose_quantity_leaves_its_range_fails_as_in_simulate(method):
    """Damping that wears off until it would drive: case by case, with the time."""
    wear = mbd.Parameter("wear", 1.0)
    block = mbd.Body("block", mass=1.0, inertia=1.0)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), block.at(0, 0))
    oil = mbd.JointFriction("oil", rail, mbd.Viscous(1 - wear * mbd.t))
    model = mbd.Mechanism([block], [rail], forces=[oil], parameters=[wear])
    times, start = np.linspace(0, 1, 6), [block.vx == 1]
    swept = mbd.sweep(model, times, {wear: [0.5, 1.5]}, {"x": block.x, "v": block.vx}, start, method=method)
    assert swept["v"][0, -1] == pytest.approx(np.exp(-0.75), rel=1e-6)
    assert np.all(np.isnan(swept["x"][1]))
    ((case, message),) = swept.failures.items()
    assert case == 1 and message.startswith("Viscous: coefficient must be at least 0, got -0.2")
    assert message.endswith("at t = 0.8 s")
    with pytest.raises(mbd.MechanismError, match="Viscous: coefficient must be at least 0"):
        mbd.simulate(model, times, initial=start, parameters={wear: 1.5}, method=method)
