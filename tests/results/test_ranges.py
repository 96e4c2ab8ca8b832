"""Quantities that vary along a motion, and leave their ranges."""

import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.results.ranges import Ranges

load, push = mbd.Input("load"), mbd.Input("push", lower=-5, upper=5)
block = mbd.Body("block", mass=1.0, inertia=1.0)
rail = mbd.Translational("rail", mbd.ground.at(0, 0), block.at(0, 0))
brake = mbd.LoadIndependentFriction("brake", rail, mbd.Coulomb(0.3, 0.3), load=load)
model = mbd.Mechanism(
    [block], [rail], forces=[brake, mbd.Force("push", block.at(0, 0), (push, 0))], inputs=[load, push]
)


def test_the_first_value_out_of_range_is_found():
    motion = mbd.simulate(model, np.linspace(0, 1, 5), initial=[block.x == 0, block.vx == 1], inputs={load: 1.0})
    ranges = Ranges(motion.equations, motion.parameters, model)
    block_of = motion.t, motion.q, motion.v, motion.a, motion.z, motion.lam
    for loads, found in (
        ([1, 0, -1e-9, 2, 3], None),
        ([1, 0, 2, -0.5, -1], (3, "friction 'brake': load must be at least 0, got -0.5")),
        ([1, np.nan, 2, -0.5, -1], (1, "friction 'brake': load must be finite, got nan")),
    ):
        assert ranges.first_broken((*block_of, np.c_[np.array(loads, float), np.zeros(5)])) == found


def test_an_optimum_that_a_negative_load_drives_is_told():
    """A brake whose force is negative is a motor."""
    problem = mbd.OptimalControlProblem(
        model, duration=1.0, initial=[block.x == 0, block.vx == 0], final=[block.x == 0.5], running_cost=push**2
    )
    with pytest.warns(mbd.MechanismWarning, match=r"'brake': load must be at least 0, got -1.0\d* at t = 0 s"):
        driven = mbd.optimize(problem, intervals=4, inputs={load: -1.0})
    free = mbd.optimize(problem, intervals=4, inputs={load: 0.0})  # no warning, which would be an error
    assert free.cost == pytest.approx(0.75, rel=1e-6)  # 3 x² by a force that falls linearly to zero
    assert driven.cost < 0.5
