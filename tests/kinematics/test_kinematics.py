"""Kinematics of driven mechanisms: accuracy, branches, lock-ups, refusals."""

from __future__ import annotations

import os
import warnings

import numpy as np
import pytest
from keyboard import interrupted
from linkages import four_bar, four_bar_points, slider_crank, slider_crank_motion

import mbdcasadi as mbd

t = mbd.t


def driven_slider_crank(law, theta=0.3, r=0.15, l=0.45):  # noqa: E741
    """Slider-crank with its crank driven."""
    return slider_crank(theta, r, l, drivers=lambda f: [mbd.Driver("drive", f.A.angle, law)])


def driven_four_bar(law, theta=0.5, lengths=(0.2, 0.5, 0.4, 0.55), **more):
    """Four-bar with its crank driven."""
    return four_bar(theta, lengths, drivers=lambda f: [mbd.Driver("drive", f.A.angle, law)], **more)


def rocker_and_coupler(theta, lengths=(0.2, 0.5, 0.4, 0.55)):
    """Positions of joint C (n, 2) of the four-bar, by the triangle."""
    return np.array([four_bar_points(angle, *lengths)[2] for angle in theta])


# --- accuracy ----------------------------------------------------------------------------------------
def test_slider_crank_in_closed_form():
    """Position, speed, acceleration at any course of the crank, and consistent with each other."""
    t = np.linspace(0, 2, 301)
    f = driven_slider_crank(0.3 + 4 * mbd.t + 0.5 * mbd.sin(7 * mbd.t))
    run = mbd.kinematics(f.mechanism, t)
    theta, rate = 0.3 + 4 * t + 0.5 * np.sin(7 * t), 4 + 3.5 * np.cos(7 * t)
    x, v, a = slider_crank_motion(theta, rate, -24.5 * np.sin(7 * t), 0.15, 0.45)
    np.testing.assert_allclose(run[f.slider.x], x, atol=1e-13)
    np.testing.assert_allclose(run[f.slider.vx], v, atol=1e-12)
    np.testing.assert_allclose(run[f.slider.ax], a, atol=1e-10)
    np.testing.assert_allclose(run[f.A.angle], theta, atol=1e-12)
    assert run.drift.position < 1e-13 and run.drift.velocity < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("points_per_turn", [200, 40, 15])
def test_many_turns_on_one_branch(points_per_turn):
    """Fifty turns: the slider stays on its side, angles are not wound back."""
    turns = 50
    t = np.linspace(0, turns, points_per_turn * turns + 1)
    f = driven_slider_crank(0.3 + 2 * np.pi * mbd.t)
    run = mbd.kinematics(f.mechanism, t)
    x = slider_crank_motion(0.3 + 2 * np.pi * t, 0, 0, 0.15, 0.45)[0]
    np.testing.assert_allclose(run[f.slider.x], x, atol=1e-12)
    np.testing.assert_allclose(run[f.crank.phi][-1], 0.3 + 2 * np.pi * turns, rtol=1e-13)
    np.testing.assert_allclose(run[f.rod.phi], np.arcsin(-0.15 / 0.45 * np.sin(0.3 + 2 * np.pi * t)), atol=1e-12)


@pytest.mark.parametrize("count", [2, 3, 5, 8])
@pytest.mark.parametrize("turns", [1.3, 3.7, 10])
def test_coarse_grids(count, turns):
    """A few points over several turns: steps are divided, so that the pose is the one of a fine grid."""
    t = np.linspace(0, turns, count)
    f = driven_slider_crank(0.3 + 2 * np.pi * mbd.t)
    run = mbd.kinematics(f.mechanism, t)
    theta = 0.3 + 2 * np.pi * t
    np.testing.assert_allclose(run[f.slider.x], slider_crank_motion(theta, 0, 0, 0.15, 0.45)[0], atol=1e-12)
    np.testing.assert_allclose(run[f.A.angle], theta, atol=1e-11)


@pytest.mark.parametrize("count", [2, 5, 11, 101])
def test_coarse_grids_of_a_four_bar(count):
    """The coupler's joint stays on its side of the diagonal."""
    t = np.linspace(0, 5, count)
    f = driven_four_bar(0.5 + 6 * mbd.t)
    run = mbd.kinematics(f.mechanism, t)
    np.testing.assert_allclose(run[f.coupler.at(0.25, 0).position], rocker_and_coupler(0.5 + 6 * t), atol=1e-12)


@pytest.mark.parametrize("ratio", [1.02, 1.001])
def test_nearly_change_point(ratio):
    """A slider-crank whose rod is hardly longer than its crank passes close by the singular pose, on its branch."""
    t = np.linspace(0, 3, 301)
    f = driven_slider_crank(0.3 + 2 * np.pi * mbd.t, r=0.2, l=0.2 * ratio)
    run = mbd.kinematics(f.mechanism, t)
    x, v, _ = slider_crank_motion(0.3 + 2 * np.pi * t, 2 * np.pi, 0, 0.2, 0.2 * ratio)
    np.testing.assert_allclose(run[f.slider.x], x, atol=1e-10)
    np.testing.assert_allclose(run[f.slider.vx], v, atol=1e-7)
    assert np.all(run[f.slider.x] > 0)


def test_slider_drives_the_crank():
    """The driven end may be any: slider prescribed, crank angle by the cosine rule."""
    t = np.linspace(0, 1, 51)
    f = slider_crank(1.0, drivers=lambda f: [mbd.Driver("drive", f.slider.x, 0.5 - 0.1 * mbd.cos(3 * mbd.t))])
    run = mbd.kinematics(f.mechanism, t)
    x = 0.5 - 0.1 * np.cos(3 * t)
    theta = np.arccos((x**2 + 0.15**2 - 0.45**2) / (2 * x * 0.15))
    np.testing.assert_allclose(run[f.A.angle], theta, atol=1e-12)


def test_two_drivers():
    """An arm of two joints, both driven, against forward kinematics."""
    upper = mbd.Body("upper", mass=1, inertia=1, pose=(0.4, 0, 0))
    lower = mbd.Body("lower", mass=1, inertia=1, pose=(1.1, 0, 0))
    shoulder = mbd.Revolute("shoulder", mbd.ground.at(0, 0), upper.at(-0.4, 0))
    elbow = mbd.Revolute("elbow", upper.at(0.4, 0), lower.at(-0.3, 0))
    drivers = [mbd.Driver("one", shoulder.angle, mbd.sin(mbd.t)), mbd.Driver("two", elbow.angle, mbd.t**2)]
    arm = mbd.Mechanism(bodies=[upper, lower], joints=[shoulder, elbow], drivers=drivers)
    t = np.linspace(0, 4, 41)
    run = mbd.kinematics(arm, t)
    first, second = np.sin(t), np.sin(t) + t**2
    tip = 0.8 * np.c_[np.cos(first), np.sin(first)] + 0.6 * np.c_[np.cos(second), np.sin(second)]
    np.testing.assert_allclose(run[lower.at(0.3, 0).position], tip, atol=1e-12)
    np.testing.assert_allclose(run[lower.alpha], -np.sin(t) + 2, atol=1e-10)


def test_large_mechanism():
    """Ten four-bars in a row, one drives the next; each rocker against the triangle."""
    bodies, joints, t = [], [], np.linspace(0, 1, 101)
    lengths = (0.2, 0.5, 0.4, 0.55)
    stages = 10
    for k in range(stages):
        f = four_bar(0.5)
        shift = np.array([0.0, 2.0 * k])
        copies = [
            mbd.Body(f"{b.name} {k}", mass=1, inertia=1, pose=(*(b.pose_estimate[:2] + shift), b.pose_estimate[2]))
            for b in (f.crank, f.coupler, f.rocker)
        ]
        crank, coupler, rocker = copies
        bodies += copies
        joints += [
            mbd.Revolute(f"A{k}", mbd.ground.at(*shift), crank.at(-0.1, 0)),
            mbd.Revolute(f"B{k}", crank.at(0.1, 0), coupler.at(-0.25, 0)),
            mbd.Revolute(f"C{k}", coupler.at(0.25, 0), rocker.at(0.2, 0)),
            mbd.Revolute(f"D{k}", mbd.ground.at(0.55, shift[1]), rocker.at(-0.2, 0)),
        ]
        if k:
            joints.append(mbd.RelativeAngle(f"shaft {k}", bodies[0].at(0, 0), crank.at(0, 0), 0))
    drive = mbd.Driver("drive", joints[0].angle, 0.5 + 6 * mbd.t)
    run = mbd.kinematics(mbd.Mechanism(bodies=bodies, joints=joints, drivers=[drive]), t)
    wanted = rocker_and_coupler(0.5 + 6 * t, lengths)
    for k in range(stages):
        found = run[bodies[3 * k + 1].at(0.25, 0).position] - [0, 2.0 * k]
        np.testing.assert_allclose(found, wanted, atol=1e-11)


def test_redundant_rows():
    """Three parallel cranks, driven: one row too many is no obstacle."""
    cranks = [mbd.Body(f"crank {k}", mass=1, inertia=1, pose=(k + 0.3, 0.4, 0.9)) for k in range(3)]
    coupler = mbd.Body("coupler", mass=1, inertia=1, pose=(1.6, 0.8, 0.05))
    joints = [mbd.Revolute(f"foot {k}", mbd.ground.at(k, 0), b.at(-0.5, 0)) for k, b in enumerate(cranks)]
    joints += [mbd.Revolute(f"head {k}", b.at(0.5, 0), coupler.at(k - 1, 0)) for k, b in enumerate(cranks)]
    drive = mbd.Driver("drive", joints[0].angle, 0.9 + 0.4 * mbd.sin(3 * mbd.t))
    mechanism = mbd.Mechanism(bodies=[*cranks, coupler], joints=joints, drivers=[drive])
    t = np.linspace(0, 2, 81)
    run = mbd.kinematics(mechanism, t)
    angle = 0.9 + 0.4 * np.sin(3 * t)
    np.testing.assert_allclose(run[coupler.position], np.c_[1 + np.cos(angle), np.sin(angle)], atol=1e-10)
    np.testing.assert_allclose(run[coupler.phi], 0, atol=1e-10)
    np.testing.assert_allclose(run[cranks[2].omega], 1.2 * np.cos(3 * t), atol=1e-9)
    np.testing.assert_allclose(run[cranks[1].alpha], -3.6 * np.sin(3 * t), atol=1e-8)


def test_repeats_itself():
    """The same call gives the same numbers; a new object of the same model, too."""
    t = np.linspace(0, 1, 51)
    f, g = driven_four_bar(0.5 + 6 * mbd.t), driven_four_bar(0.5 + 6 * mbd.t)
    first, second, third = (
        mbd.kinematics(f.mechanism, t),
        mbd.kinematics(f.mechanism, t),
        mbd.kinematics(g.mechanism, t),
    )
    for name in ("q", "v", "a"):
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
        np.testing.assert_array_equal(getattr(first, name), getattr(third, name))


# --- times, parameters -----------------------------------------------------------------------------------
def test_one_time():
    """A single instant is enough, also one that is not zero."""
    f = driven_slider_crank(0.3 + 2 * mbd.t)
    run = mbd.kinematics(f.mechanism, [0.0])
    assert run.t.shape == (1,) and run[f.slider.x].shape == (1,)
    np.testing.assert_allclose(run[f.slider.vx], slider_crank_motion(0.3, 2.0, 0, 0.15, 0.45)[1], atol=1e-13)
    later = mbd.kinematics(f.mechanism, [0.2])
    np.testing.assert_allclose(later[f.A.angle], 0.7, atol=1e-12)


def test_a_parameter_in_the_law_and_in_the_linkage():
    """Values given in the call hold in drivers and in points of bodies alike."""
    speed, arm = mbd.Parameter("speed", 2.0), mbd.Parameter("arm", 0.15)
    crank = mbd.Body("crank", mass=1, inertia=1, pose=(0, 0, 0.3))
    rod = mbd.Body("rod", mass=1, inertia=1, pose=(0.35, 0.02, -0.1))
    slider = mbd.Body("slider", mass=1, inertia=1, pose=(0.59, 0, 0))
    main = mbd.Revolute("main", mbd.ground.at(0, 0), crank.at(0, 0))
    joints = [
        main,
        mbd.Revolute("pin", crank.at(arm, 0), rod.at(-0.2, 0)),
        mbd.Revolute("wrist", rod.at(0.25, 0), slider.at(0, 0)),
        mbd.Translational("guide", mbd.ground.at(0, 0), slider.at(0, 0)),
    ]
    drive = mbd.Driver("drive", main.angle, 0.3 + speed * mbd.t)
    mechanism = mbd.Mechanism(bodies=[crank, rod, slider], joints=joints, drivers=[drive], parameters=[speed, arm])
    t = np.linspace(0, 2, 41)
    run = mbd.kinematics(mechanism, t, parameters={speed: 5.0, arm: 0.1})
    x, v, _ = slider_crank_motion(0.3 + 5 * t, 5.0, 0, 0.1, 0.45)
    np.testing.assert_allclose(run[slider.x], x, atol=1e-12)
    np.testing.assert_allclose(run[slider.vx], v, atol=1e-11)


def test_between_the_times():
    """.at() is as exact as the times themselves."""
    f = driven_slider_crank(0.3 + 5 * mbd.t)
    fine = np.linspace(0, 1, 77)
    run = mbd.kinematics(f.mechanism, np.linspace(0, 1, 21)).at(fine)
    x, v, a = slider_crank_motion(0.3 + 5 * fine, 5.0, 0, 0.15, 0.45)
    np.testing.assert_allclose(run[f.slider.x], x, atol=1e-12)
    np.testing.assert_allclose(run[f.slider.vx], v, atol=1e-11)
    np.testing.assert_allclose(run[f.slider.ax], a, atol=1e-10)


# --- lock-ups and bifurcations ------------------------------------------------------------------------------
@pytest.mark.parametrize("times", [np.linspace(0, 5, 201), np.linspace(0, 5, 2001), np.array([0, 2.0, 2.5, 5])])
def test_lock_up_is_located(times):
    """Coupler and rocker in line: the time to 1e-6 on any grid, the rows, and what was computed before."""
    lengths = (0.4, 0.5, 0.45, 1.0)
    f = driven_four_bar(0.2 + 0.5 * mbd.t, 0.2, lengths)
    lock = np.arccos((0.4**2 + 1 - 0.95**2) / 0.8)
    with pytest.raises(mbd.SingularityError, match="lock-up.*rows that take part are.*drive[,;]") as caught:
        mbd.kinematics(f.mechanism, times)
    error = caught.value
    assert error.time == pytest.approx((lock - 0.2) / 0.5, abs=1e-6)
    np.testing.assert_array_equal(error.partial.t, times[times < error.time + 1e-9])
    theta = 0.2 + 0.5 * error.partial.t
    np.testing.assert_allclose(
        error.partial[f.coupler.at(0.25, 0).position], rocker_and_coupler(theta, lengths), atol=1e-10
    )


def test_lock_up_names_the_driver_of_a_short_crank():
    """The row of the driver weighs little beside those of the joints, and it is what locks."""
    f = driven_four_bar(1.5 + 6 * mbd.t, 1.5, (0.2, 0.5, 0.4, 0.75))
    with pytest.raises(mbd.SingularityError, match="lock-up.*rows that take part are.*drive[,;]"):
        mbd.kinematics(f.mechanism, np.linspace(0, 1, 101))


def test_lock_up_of_a_slider():
    """A slider that is driven beyond its dead point: there the crank could not follow."""
    f = slider_crank(1.0, drivers=lambda f: [mbd.Driver("push", f.slider.x, 0.5 + 0.1 * mbd.t)])
    f = slider_crank(
        np.arccos((0.5**2 + 0.15**2 - 0.45**2) / (2 * 0.5 * 0.15)),
        drivers=lambda f: [mbd.Driver("push", f.slider.x, 0.5 + 0.1 * mbd.t)],
    )
    with pytest.raises(mbd.SingularityError, match="push") as caught:
        mbd.kinematics(f.mechanism, np.linspace(0, 2, 41))
    assert caught.value.time == pytest.approx(1.0, abs=1e-6)


def test_singular_at_the_start():
    """A start in the dead point has no velocity: said at once."""
    f = slider_crank(0.0, drivers=lambda f: [mbd.Driver("push", f.slider.x, 0.6 - 0.1 * mbd.t)])
    with pytest.raises(mbd.MechanismError, match="singular"):
        mbd.kinematics(f.mechanism, np.linspace(0, 1, 11))


def test_bifurcation_on_the_grid():
    """A parallelogram that is exactly flat at one of the times: a bifurcation, with the rows that take part."""
    f = driven_four_bar(1.0 - mbd.t, 1.0, (1.0, 2.0, 1.0, 2.0), left=True)
    with pytest.raises(mbd.SingularityError, match="bifurcation") as caught:
        mbd.kinematics(f.mechanism, np.linspace(0, 2, 201))
    assert caught.value.time == pytest.approx(1.0, abs=1e-4)
    assert caught.value.partial.t[-1] <= 1.0


def test_bifurcation_between_the_times():
    """Passed between two times: continued smoothly as a parallelogram, and said to be so."""
    f = driven_four_bar(1.0 - mbd.t, 1.0, (1.0, 2.0, 1.0, 2.0), left=True)
    times = np.linspace(0, 2, 38)
    with pytest.warns(mbd.MechanismWarning, match="singular pose"):
        run = mbd.kinematics(f.mechanism, times)
    np.testing.assert_allclose(run[f.rocker.phi], 1 - times, atol=1e-9)
    np.testing.assert_allclose(run[f.coupler.phi], 0, atol=1e-9)


def test_no_warning_without_a_cause():
    """A crank-rocker turns without a word."""
    f = driven_four_bar(0.5 + 6 * mbd.t)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        mbd.kinematics(f.mechanism, np.linspace(0, 10, 1001))


# --- refusals --------------------------------------------------------------------------------------------
def test_refuses_what_is_not_driven():
    """By how many degrees of freedom."""
    with pytest.raises(mbd.MechanismError, match="1 degree of freedom"):
        mbd.kinematics(four_bar(0.5).mechanism, [0, 1])
    free = mbd.Body("free", mass=1, inertia=1)
    with pytest.raises(mbd.MechanismError, match="3 degrees of freedom"):
        mbd.kinematics(mbd.Mechanism(bodies=[free]), [0, 1])


def test_contradictory_drivers():
    """Two drivers of one crank at different angles: both are named."""
    f = four_bar(0.5, drivers=lambda f: [mbd.Driver("one", f.A.angle, 0.5), mbd.Driver("two", f.A.angle, 0.6)])
    with pytest.raises(mbd.AssemblyError, match="(?s)one.*two|two.*one"):
        mbd.kinematics(f.mechanism, [0, 1])


def test_drivers_that_contradict_each_other_later():
    """They agree at the start and part from there on: an error, not a compromise."""
    f = four_bar(
        0.5,
        drivers=lambda f: [mbd.Driver("one", f.A.angle, 0.5 + mbd.t), mbd.Driver("two", f.A.angle, 0.5 + mbd.t**2)],
    )
    with pytest.raises(mbd.MechanismError, match="one|two"):
        mbd.kinematics(f.mechanism, np.linspace(0, 1, 11))


@pytest.mark.parametrize("quantity", ["lam", "effort", "reaction"])
def test_knows_no_forces(quantity):
    """Reactions are refused with the analysis that has them, in trajectories and in states."""
    f = driven_four_bar(0.5 + 6 * mbd.t)
    run = mbd.kinematics(f.mechanism, [0, 0.1])
    expression = {
        "lam": mbd.equations(f.mechanism).lam,
        "effort": f.drivers[0].effort,
        "reaction": f.A.reaction_on(f.crank).force,
    }[quantity]
    for source in (run, run.final, run.at([0.05])):
        with pytest.raises(mbd.MechanismError, match="inverse_dynamics"):
            source[expression]


@pytest.mark.parametrize(
    ("times", "words"), [([1, 0.5], r"1\.0.*0\.5"), ([], "at least 1"), ([0, np.nan], r"times\[1\]"), ("now", "times")]
)
def test_refuses_times(times, words):
    """Backwards, none, not finite, no numbers."""
    with pytest.raises(mbd.MechanismError, match=words):
        mbd.kinematics(driven_four_bar(0.5 + mbd.t).mechanism, times)


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_ctrl_c_keeps_what_was_computed():
    """SIGINT in a long run."""
    f = driven_four_bar(0.5 + 6 * mbd.t)
    mbd.kinematics(f.mechanism, np.linspace(0, 1, 1001))
    times = np.linspace(0, 1000, 1_000_001)
    caught = interrupted(lambda: mbd.kinematics(f.mechanism, times), enough=lambda e: len(e.partial or ()) > 100)
    partial = caught.partial
    np.testing.assert_allclose(partial[f.A.angle], 0.5 + 6 * partial.t, rtol=1e-12, atol=1e-12)


# --- drivers that jump -------------------------------------------------------------------------
def driven_sled(value, **more):
    sled = mbd.Body("sled", mass=1, inertia=1)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), sled.at(0, 0))
    drive = mbd.Driver("hoist", rail.displacement, value)
    return sled, mbd.Mechanism(bodies=[sled], joints=[rail], drivers=[drive], **more)


@pytest.mark.parametrize("analysis", [mbd.kinematics, mbd.inverse_dynamics])
def test_driver_whose_position_jumps_is_refused_with_the_time(analysis):
    at = mbd.Parameter("at", 0.2)
    sled, model = driven_sled(t + mbd.if_else(t < at, 0, 1), parameters=[at])
    with pytest.raises(mbd.MechanismError, match=r"'hoist' jumps by 1 m at t = 0.55 s.*mbd.step") as refused:
        analysis(model, np.linspace(0, 1, 11), parameters={at: 0.55})
    assert refused.value.time == pytest.approx(0.55, abs=1e-12)
    part = refused.value.partial
    np.testing.assert_allclose(part.t, np.linspace(0, 0.5, 6), atol=1e-15)
    np.testing.assert_allclose(part[sled.x], part.t, atol=1e-12)


def test_jumps_at_the_ends_of_the_motion_count_if_the_end_is_on_the_other_side():
    for value, start, end in ((mbd.if_else(t <= 0, 0, 1), 0, 1), (mbd.if_else(t < 1, 0, 1), 0, 1)):
        with pytest.raises(mbd.MechanismError, match="'hoist' jumps"):
            mbd.kinematics(driven_sled(value)[1], np.linspace(start, end, 5))
    for value in (mbd.if_else(t < 0, 0, 1), mbd.if_else(t <= 1, 0, 1)):
        sled, model = driven_sled(value)
        assert len(set(mbd.kinematics(model, np.linspace(0, 1, 5))[sled.x])) == 1


def test_jumps_that_cancel_in_a_row_are_no_jump():
    sled, model = driven_sled(t)
    rows = sled.x - t - mbd.if_else(t < 0.5, 0, 1) + mbd.if_else(t < 0.5, 0, 1)
    model = model.replace(drivers=[], joints=[*model.joints, mbd.Constraint("way", rows)])
    np.testing.assert_allclose(mbd.kinematics(model, [0, 0.4, 1])[sled.x], [0, 0.4, 1], atol=1e-12)


def test_corner_of_a_driver_is_reported():
    sled, model = driven_sled(mbd.fabs(t - 0.5))
    with pytest.warns(mbd.MechanismWarning, match="velocity of driver 'hoist' jumps by 2 m/s at t = 0.5 s"):
        motion = mbd.kinematics(model, np.linspace(0, 1, 11))
    np.testing.assert_allclose(motion[sled.x], np.abs(motion.t - 0.5), atol=1e-12)


def test_smooth_drivers_are_quiet(recwarn):
    program = mbd.MotionProgram(mbd.rise(0.4, 0.1, "harmonic"), mbd.dwell(0.2), mbd.fall(0.4))
    for value in (mbd.step(t, 0.2, 0, 0.3, 1), program(t), mbd.spline(t, np.linspace(0, 1, 9), np.sin(np.arange(9)))):
        mbd.kinematics(driven_sled(value)[1], np.linspace(0, 1, 21))
    assert not recwarn.list


#: Angles whose rates jump, as expressions and in numbers: to and fro, in teeth, faster, slower, from rest.
CORNERS = {
    "to and fro": (2 * mbd.fabs(mbd.t - 1), lambda t: 2 * abs(t - 1)),
    "teeth": (3 * mbd.fabs(mbd.fmod(mbd.t, 0.7) - 0.35), lambda t: 3 * abs(t % 0.7 - 0.35)),
    "slower": (mbd.if_else(mbd.t < 1, 2 * mbd.t, 2.5 - mbd.t / 2), lambda t: np.where(t < 1, 2 * t, 2.5 - t / 2)),
    "from rest": (3 * mbd.fmax(0, mbd.t - 1), lambda t: 3 * np.maximum(t - 1, 0)),
    "table": (
        mbd.spline(mbd.t, [0, 0.4, 1.0, 1.3, 2.1], [0, 0.5, -0.3, 0.9, 0.1], kind="linear"),
        lambda t: np.interp(t, [0, 0.4, 1.0, 1.3, 2.1], [0, 0.5, -0.3, 0.9, 0.1]),
    ),
}


@pytest.mark.filterwarnings("ignore:.*prescribed velocity.*jumps")
@pytest.mark.parametrize("name", CORNERS)
@pytest.mark.parametrize("count", [3, 7, 20, 42, 83, 200])
def test_corners_of_a_driven_angle_are_passed_wherever_outputs_lie(name, count):
    """A pendulum that is driven in teeth and steps is in no singular pose, with outputs at corners or beside them."""
    wanted, values = CORNERS[name]
    arm = mbd.Body("arm", mass=1, inertia=0.1, pose=(0.5, 0, 0))
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), arm.at(-0.5, 0))
    times = np.linspace(0, 2.05, count)
    motion = mbd.kinematics(mbd.Mechanism([arm], [hinge], drivers=[mbd.Driver("angle", arm.phi, wanted)]), times)
    assert motion[arm.phi] == pytest.approx(values(times), abs=1e-9)
    assert motion[arm.x] == pytest.approx(0.5 * np.cos(values(times)), abs=1e-9)


def test_between_outputs_of_a_motor_whose_current_is_not_known():
    """A driver turns it: the current follows from nothing, and the pose is known at any instant."""
    wheel = mbd.Body("wheel", 1, 0.1)
    bearing = mbd.Revolute("bearing", mbd.ground.at(0, 0), wheel.at(0, 0))
    motor = mbd.DCMotor("motor", wheel, 6.0, 0.4, 1.5, inductance=0.01)
    turn = mbd.Driver("turn", bearing.angle, mbd.sin(mbd.t))
    motion = mbd.kinematics(mbd.Mechanism([wheel], [bearing], [turn], forces=[motor]), np.linspace(0, 1, 11))
    assert motion.at([0.55])[wheel.phi][0] == pytest.approx(np.sin(0.55), abs=1e-9)
