"""Whether a place is reached: poses against closed forms, branches against the other assembly, limits on the way."""

import numpy as np
import pytest
from motions import LENGTHS, crank_rocker

import mbdcasadi as mbd
from mbdcasadi import library


def arm(length=0.5, parameters=()):
    """Two links in the plane, stretched along x, and their last point."""
    first, second = mbd.Body("first", 1, 0.1, pose=(0.25, 0, 0)), mbd.Body("second", 1, 0.1, pose=(0.75, 0, 0.1))
    shoulder = mbd.Revolute("shoulder", mbd.ground.at(0, 0), first.at(-length / 2, 0))
    elbow = mbd.Revolute("elbow", first.at(length / 2, 0), second.at(-length / 2, 0))
    mechanism = mbd.Mechanism([first, second], joints=[shoulder, elbow], parameters=list(parameters))
    return mechanism, first, second, second.at(length / 2, 0)


def test_a_point_within_reach():
    """The pose that is found meets the conditions, with its joints closed."""
    mechanism, first, second, tip = arm()
    found = mbd.reachable(mechanism, [tip.x == 0.3, tip.y == 0.5, second.phi - first.phi <= 0])
    assert found.is_reachable and found.verdict == "reached" and not found.missed
    assert found.state[tip.x] == pytest.approx(0.3) and found.state[tip.y] == pytest.approx(0.5)
    assert found.state[second.phi - first.phi] < 0 and np.max(np.abs(found.state.v)) < 1e-12
    assert mbd.reachable(mechanism, []).is_reachable


def test_a_point_out_of_reach():
    """The arm of 1 m stretches towards a target 1.3 m away: the rest is missed, and its joints hold it back."""
    mechanism, *_, tip = arm()
    found = mbd.reachable(mechanism, [tip.x == 1.2, tip.y == 0.5])
    assert found.is_reachable is False and found.verdict == "out of reach" and found.state is None
    assert [one.amount for one in found.missed] == pytest.approx([1.2 * 0.3 / 1.3, 0.5 * 0.3 / 1.3], rel=1e-3)
    assert found.missed[0].unit == "m" and found.joints == ("shoulder", "elbow")
    assert "out of reach" in repr(found) and "by 0.277 m" in found.text and "held back by 'shoulder'" in found.text


@pytest.mark.parametrize("longest", [0.6, 0.7])
def test_free_parameters_take_part(longest):
    """Two links of free length reach 1.3 m if each may be longer than 0.65 m; else their limit is named."""
    length = mbd.Parameter("l", 0.5, lower=0.3, upper=longest)
    mechanism, *_, tip = arm(length, [length])
    place = [tip.x == 1.2, tip.y == 0.5]
    found = mbd.reachable(mechanism, place, free_parameters=[length])
    if longest > 0.65:
        assert found.parameters[length] >= 0.65 - 1e-9
        assert found.state[tip.x] == pytest.approx(1.2, abs=2e-3)
        assert mbd.reachable(mechanism, place, parameters={length: 0.66}).is_reachable
    else:
        assert not found.is_reachable and found.limits == ("l <= 0.6",)


def test_a_free_time_takes_part():
    """A drive moves the base at 1 m/s: its arm of 1 m reaches 3 m from 2 s on."""
    base, link = mbd.Body("base", 1, 0.1), mbd.Body("link", 1, 0.1, pose=(0.5, 0, 0))
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), base.at(0, 0))
    hinge = mbd.Revolute("hinge", base.at(0, 0), link.at(-0.5, 0))
    drive = mbd.Driver("drive", base.x, mbd.t)
    mechanism, place = mbd.Mechanism([base, link], [rail, hinge], drivers=[drive]), [link.at(0.5, 0).x == 3]
    found = mbd.reachable(mechanism, place, t=(0.5, 2.5))
    assert found.is_reachable and 2 - 1e-3 < found.state.t <= 2.5
    assert found.state[base.vx] == pytest.approx(1.0), "the drivers' velocities are those of the state"
    late = mbd.reachable(mechanism, place, t=(0.5, 1.5))
    assert late.missed[0].amount == pytest.approx(0.5, rel=1e-4) and "drive" in late.joints


def test_what_a_rocker_reaches():
    """Its range of angles by the law of cosines; its mirror image is another assembly, and it makes no whole turns."""
    f = crank_rocker()
    a, b, c, d = LENGTHS
    low, high = (np.pi - np.arccos((c**2 + d**2 - (b + side * a) ** 2) / (2 * c * d)) for side in (1, -1))
    for angle, verdict in (
        (low + 0.01, "reached"), (high - 0.01, "reached"), (high + 0.1, "out of reach"), (-1.6, "branch"),
        (1.6 + 6 * np.pi, "turn"),
    ):  # fmt: skip
        found = mbd.reachable(f.mechanism, [f.rocker.phi == angle])
        assert found.verdict == verdict and found.is_reachable == (verdict == "reached"), (angle, found)
    beyond = mbd.reachable(f.mechanism, [f.rocker.phi == high + 0.1])
    assert beyond.missed[0].amount == pytest.approx(0.1, rel=1e-3)
    other = mbd.reachable(f.mechanism, [f.rocker.phi == -1.6])
    assert other.state[f.rocker.phi] == pytest.approx(-1.6), "its pose is known"
    assert mbd.reachable(f.mechanism, [f.rocker.phi == -1.6], initial=other.state).is_reachable


def test_limits_on_the_way():
    """The crank passes the pose in which the rocker is farthest: with less for the rocker it turns back before."""
    f = library.four_bar()
    farthest = float(np.max(mbd.kinematics(f.driven(crank=mbd.t), np.linspace(1, 7, 400))[f.rocker.phi]))

    def to(goal, most):
        return mbd.reachable(
            f.mechanism, [f.crank.phi == goal], path=[f.rocker.phi <= most], initial=[f.crank.phi == 1]
        )

    assert to(6.2, farthest + 0.01).is_reachable
    found = to(6.2, farthest - 0.3)
    assert found.verdict == "blocked" and found.limits == (f"rocker.phi <= {farthest - 0.3:.6g}",)


def test_what_is_no_place():
    """Velocities, strangers, times the wrong way round, and a start that cannot be assembled."""
    mechanism, first, _, tip = arm()
    stranger, length = mbd.Body("stranger", 1, 1), mbd.Parameter("l", 1.0)
    for conditions, words in (
        ([first.omega == 1], "reachable: first.omega == 1 contains velocity 'first.omega'; it takes conditions on"),
        ([stranger.x == 1], "contains position 'stranger.x', which the mechanism does not have"),
        ([tip.x == length], "contains parameter 'l', which the mechanism does not have"),
    ):
        with pytest.raises(mbd.ExpressionError, match=words):
            mbd.reachable(mechanism, conditions)
    assert mbd.reachable(mechanism, [tip.x == length], free_parameters=[length]).is_reachable
    for wrong in ((1, 0), (0, 1, 2), "1", np.nan):
        with pytest.raises(mbd.ModelError, match="reachable: .*t"):
            mbd.reachable(mechanism, [tip.x == 0.5], t=wrong)
    with pytest.raises(mbd.MechanismError):
        mbd.reachable(mechanism, [tip.x == 0.5], initial=[tip.x == 3])
