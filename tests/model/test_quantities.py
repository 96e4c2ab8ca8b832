"""Limits of quantities: at the parameter values of a call as in the constructor."""

from __future__ import annotations

import re

import numpy as np
import pytest

import mbdcasadi as mbd

k = mbd.Parameter("k", 1.0)


def model(body=None, joints=None):
    """A body with some joint, and the parameter k."""
    body = body or mbd.Body("body", 1, 1, pose=(1, 0.3, 0))
    return mbd.Mechanism(bodies=[body], joints=joints(body) if joints else [], parameters=[k])


CASES = {
    "mass": (model(mbd.Body("body", 3 - k, 1)), 4.0, ["body 'body'", "mass", "at least 0", "-1.0", "'k' = 4"]),
    "inertia": (model(mbd.Body("body", 1, k)), -2.0, ["body 'body'", "inertia", "-2.0", "'k' = -2"]),
    "not finite": (model(mbd.Body("body", 1, 1 / k)), 0.0, ["body 'body'", "inertia", "finite", "'k' = 0"]),
    "length of a link": (
        model(joints=lambda b: [mbd.Distance("link", mbd.ground.at(0, 0), b.at(0, 0), k)]),
        0.0,
        ["joint 'link'", "distance", "above 0", "'k' = 0"],
    ),
    "distance from a point": (
        model(joints=lambda b: [mbd.AbsoluteDistance("rope", b.at(0, 0), (0, 0), 2 * k)]),
        -0.5,
        ["constraint 'rope'", "distance", "-1.0", "'k' = -0.5"],
    ),
    "radius": (
        model(joints=lambda b: [mbd.RackAndPinion("mesh", mbd.ground.at(0, 0), b.at(0, 0), k)]),
        -1.0,
        ["joint 'mesh'", "radius", "-1.0"],
    ),
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize(
    "analysis",
    [
        lambda m, p: mbd.assemble(m, parameters=p),
        lambda m, p: mbd.simulate(m, duration=0.1, parameters=p),
        lambda m, p: mbd.check(m, parameters=p),
    ],
    ids=["assemble", "simulate", "check"],
)
def test_values_out_of_limits_are_refused(case, analysis):
    """The message names the element, the quantity, its value, and the parameter with its value."""
    mechanism, value, words = CASES[case]
    with pytest.raises(mbd.ModelError) as error:
        analysis(mechanism, {k: value})
    missing = [word for word in words if word not in str(error.value)]
    assert not missing, f"{error.value!s} does not say {missing}"
    mbd.assemble(mechanism)  # the parameter's own value is good


def test_own_values_are_checked_where_only_an_expression_tells():
    """A constructor sees no number in an expression; an analysis does."""
    mechanism = model(mbd.Body("body", k - 3, 1))
    with pytest.raises(mbd.ModelError, match=re.escape("body 'body': mass must be at least 0, got -2.0")):
        mbd.assemble(mechanism)


def test_a_length_that_changes_in_time_is_left_alone():
    """It has no one value; the link grows."""
    mechanism = model(joints=lambda b: [mbd.Distance("ram", mbd.ground.at(0, 0), b.at(0, 0), k + mbd.t)])
    state = mbd.assemble(mechanism, t=1.0)
    assert np.hypot(*state.q[:2]) == pytest.approx(2.0, abs=1e-12)


def test_elements_keep_their_limits():
    """Of expressions only; a number is checked once, in the constructor."""
    assert mbd.Body("body", 1, 1).limits == ()
    assert [x.name for x in mbd.Body("body", k, 1 + k).limits] == ["mass", "inertia"]


@pytest.mark.parametrize("element", [mbd.TSDA, mbd.RSDA])
def test_negative_coefficients_of_springs_are_reported(element):
    """A wrong sign is more likely than a device that adds energy; a free length may be negative, as in a balancer."""
    ends = mbd.ground.at(0, 0), mbd.Body("body", 1, 1).at(0, 0)
    for name, effect in {"stiffness": "drives the bodies away", "damping": "adds energy"}.items():
        with pytest.warns(mbd.MechanismWarning, match=rf"spring 's': {name} = -2 is negative and {effect}"):
            element("s", *ends, **{name: -2.0})
    free = "free_length" if element is mbd.TSDA else "free_angle"
    element("s", *ends, stiffness=k, damping=0.5, **{free: -0.1})


@pytest.mark.parametrize("value", [True, np.True_])
def test_a_truth_value_is_no_number(value):
    """Python would take True as one."""
    with pytest.raises(mbd.ModelError, match="body 'body': mass must be a number, got"):
        mbd.Body("body", mass=value, inertia=1)
