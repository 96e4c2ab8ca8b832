"""What elements ask to be watched along a motion: told with time and size, left out where it is not known."""

import warnings

import casadi as ca
import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.model.elements import Element
from mbdcasadi.model.monitors import Monitor
from mbdcasadi.model.symbols import values_of


class Fence(Element):
    """A user's own element that only watches a body."""

    word = "fence"

    def __init__(self, name, body):
        super().__init__(name)
        self.monitors = (Monitor(1.0 - body.x, f"{self.what}: the body has passed it"),)


def runner(speed=1.0):
    """A body that flies along x, and a fence at 1 m."""
    body = mbd.Body("body", mass=1, inertia=1, velocity=(speed, 0, 0))
    return body, mbd.Mechanism([body], forces=[Fence("fence", body)])


def test_told_with_time_and_worst_value():
    """As a warning and as a note of the statistics."""
    _, mechanism = runner()
    with pytest.warns(
        mbd.MechanismWarning, match=r"fence 'fence': the body has passed it \(first at t = 1\.1 s"
    ) as said:
        run = mbd.simulate(mechanism, np.linspace(0, 2, 21))
    assert "at worst -1)" in str(said[0].message)
    assert said[0].filename == __file__
    assert any("has passed it" in note for note in run.statistics.notes)


def test_nothing_is_told_where_it_holds():
    """Up to the limit itself."""
    _, mechanism = runner()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = mbd.simulate(mechanism, np.linspace(0, 1, 11))
    assert run.statistics.notes == []


def test_kinematics_leaves_out_what_depends_on_forces():
    """A wheel pulled off its track: kinematics cannot know, inverse dynamics does."""
    disc = mbd.Body("disc", mass=1, inertia=1, pose=(0, 0.5, 0))
    roll = mbd.Rolling("contact", mbd.ground.at(0, 0), disc.at(0, 0), 0.5)
    crane = mbd.Force("crane", disc.at(0, 0), (0, 5.0))
    mechanism = mbd.Mechanism([disc], [roll], [mbd.Driver("d", disc.x, mbd.t)], forces=[crane])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        mbd.kinematics(mechanism, [0, 1])
    with pytest.warns(mbd.MechanismWarning, match=r"normal force is negative.*first at t = 0 s, at worst -5\)"):
        mbd.inverse_dynamics(mechanism, [0, 1])


def test_value_behind_an_expression_of_parameters():
    """Parameters count with their own values; anything else is refused."""
    k = mbd.Parameter("k", 3.0)
    np.testing.assert_allclose(values_of(ca.vertcat(k**2, 1)), [[9], [1]])
    assert values_of(2.5) == 2.5
    with pytest.raises(mbd.ExpressionError, match="a number is needed here, and time 't' has none"):
        values_of(k * mbd.t)
