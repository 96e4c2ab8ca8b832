"""Results that evaluate expressions are no sequences: Python would ask for result[0], result[1], … without an end."""

from __future__ import annotations

import numpy as np
import pytest

import mbdcasadi as mbd


def _results():
    lever = mbd.Body("lever", mass=1.0, inertia=0.1, pose=(0.5, 0, 0))
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), lever.at(-0.5, 0))
    torque = mbd.Input("torque")
    model = mbd.Mechanism(
        [lever], joints=[hinge], forces=[mbd.Gravity(), mbd.Torque("motor", lever, torque)], inputs=[torque]
    )
    state = mbd.assemble(model)
    return [state, mbd.simulate(model, [0, 0.1]), mbd.equilibrium_path(model, torque, 0.0, 1.0, steps=2)], lever


@pytest.mark.parametrize("of", range(3), ids=["state", "trajectory", "path"])
def test_a_result_is_not_iterated(of):
    """Its own error, or Python's for what cannot be iterated; an expression is evaluated as before."""
    results, lever = _results()
    result = results[of]
    with pytest.raises(TypeError, match="not iterable"):
        list(result)
    assert np.all(np.isfinite(result[lever.phi]))
    with pytest.raises(mbd.MechanismError, match="casadi.SX"):
        results[0][result]


@pytest.mark.parametrize("of", range(3), ids=["state", "trajectory", "path"])
def test_several_expressions_are_a_column(of):
    """A list of them is one vector; a part of the model is no expression, and one of its quantities is named."""
    results, lever = _results()
    result = results[of]
    both = result[[lever.x, lever.position]]
    assert both.shape == (*np.shape(result[lever.x]), 3)
    np.testing.assert_array_equal(both, np.stack([result[e] for e in (lever.x, lever.x, lever.y)], axis=-1))
    with pytest.raises(mbd.ExpressionError, match=r"got Marker\('lever'.*such as \.position"):
        result[lever.at(0.5, 0)]
    with pytest.raises(mbd.ExpressionError, match="got 'lever.x'$"):
        result[[lever.x, "lever.x"]]
