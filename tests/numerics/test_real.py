"""Arrays of real numbers, and complex ones in every argument that takes samples."""

import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.numerics.real import distinct, real_array

K = mbd.Parameter("k", 1.0)
PUSH = mbd.Input("push")
BLOCK = mbd.Body("block", mass=1, inertia=1)
SLIDE = mbd.Translational("slide", mbd.ground.at(0, 0), BLOCK.at(0, 0))
FORCES = [mbd.Force("push", BLOCK.at(0, 0), (K * PUSH, 0))]
MODEL = mbd.Mechanism([BLOCK], [SLIDE], forces=FORCES, inputs=[PUSH], parameters=[K])
TIMES = np.linspace(0, 1, 7)
COMPLEX = TIMES + 1j


def test_real_numbers_are_floats():
    for values in ([1, 2], (1.0, 2.0), np.array([1, 2]), [np.float32(1), True + 1]):
        found = real_array(values)
        assert found.dtype == float and np.array_equal(found, [1, 2])
    assert real_array(3).shape == ()


@pytest.mark.parametrize("values", [COMPLEX, list(COMPLEX), np.array([1 + 0j]), 1j, [COMPLEX, COMPLEX]])
def test_complex_numbers_are_refused(values):
    with pytest.raises(TypeError):
        real_array(values)


@pytest.mark.parametrize(
    "call",
    [
        lambda: mbd.inverse_dynamics(MODEL, TIMES, motion={BLOCK.x: COMPLEX}, efforts=[PUSH]),
        lambda: mbd.simulate(MODEL, TIMES, inputs={PUSH: COMPLEX}),
        lambda: mbd.simulate(MODEL, COMPLEX),
        lambda: mbd.simulate(MODEL, TIMES).at(COMPLEX),
        lambda: mbd.simulate(MODEL, TIMES).at("soon"),
        lambda: mbd.sweep(MODEL, TIMES, {K: COMPLEX}, [BLOCK.x]),
        lambda: mbd.identify(MODEL, TIMES, {BLOCK.x: COMPLEX}, [K]),
        lambda: mbd.identify(MODEL, TIMES, {BLOCK.x: TIMES}, [K], weights={BLOCK.x: COMPLEX}),
        lambda: mbd.spline(mbd.t, TIMES, COMPLEX),
        lambda: mbd.cost_function(MODEL, TIMES, [K], terminal_cost=BLOCK.x)(COMPLEX[:1]),
    ],
)
def test_every_argument_refuses_them(call):
    with pytest.raises(mbd.MechanismError, match="number"):
        call()


@pytest.mark.parametrize("values", [[], [3.0], [2.0, 1.0, 2.0, 2.0], [0.0, -0.0, 1.0], np.linspace(1, 0, 7)])
def test_distinct(values):
    np.testing.assert_array_equal(distinct(np.array(values)), np.unique(values))
