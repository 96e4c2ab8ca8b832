"""Inverse dynamics: efforts and reactions by drivers and of motions from elsewhere."""

from __future__ import annotations

import numpy as np
import pytest
from linkages import G, four_bar, pendulum, slider_crank
from scipy.integrate import cumulative_simpson

import mbdcasadi as mbd

TIMES = np.linspace(0, 1, 101)
TIGHT = {"reltol": 1e-10, "abstol": 1e-10}


def driven_slider_crank(**more):
    """Slider-crank under gravity with a driven crank."""
    law = 0.4 + 9 * mbd.t + 0.3 * mbd.sin(5 * mbd.t)
    return slider_crank(0.4, forces=[mbd.Gravity()], drivers=lambda f: [mbd.Driver("drive", f.A.angle, law)], **more)


def motor_four_bar(**more):
    """Four-bar with a motor on its crank, and one on its rocker."""
    crank_torque, rocker_torque = mbd.Input("crank torque"), mbd.Input("rocker torque")
    f = four_bar(
        0.5,
        forces=lambda f: [
            mbd.Gravity(),
            mbd.Torque("motor", f.crank, crank_torque),
            mbd.Torque("brake", f.rocker, rocker_torque),
        ],
        inputs=[crank_torque, rocker_torque],
        **more,
    )
    f.crank_torque, f.rocker_torque = crank_torque, rocker_torque
    return f


def power(run, bodies, *, gravity=True):
    """Rate of the kinetic energy, and of the potential energy of the weight."""
    kinetic = sum(b.mass * (b.vx * b.ax + b.vy * b.ay) + b.inertia * b.omega * b.alpha for b in bodies)
    return run[kinetic + (G * sum(b.mass * b.vy for b in bodies) if gravity else 0)]


# --- by drivers --------------------------------------------------------------------------------------------
def test_torque_by_power_balance():
    """Torque times speed is the rate of the energy, at every time."""
    f = driven_slider_crank()
    run = mbd.inverse_dynamics(f.mechanism, TIMES)
    wanted = power(run, f.mechanism.bodies)
    np.testing.assert_allclose(run[f.drivers[0].effort * f.crank.omega], wanted, atol=1e-10 * np.abs(wanted).max())


def test_work_by_energy():
    """The work of the driver is the change of the energy."""
    f = driven_slider_crank()
    run = mbd.inverse_dynamics(f.mechanism, np.linspace(0, 1, 2001))
    work = cumulative_simpson(run[f.drivers[0].effort * f.crank.omega], x=run.t, initial=0)
    np.testing.assert_allclose(run.energy.total - run.energy.total[0], work, atol=1e-7 * np.abs(work).max())


def test_reactions_by_newton():
    """The forces on each body sum to m a, and the moments about its centre of mass to J' alpha."""
    f = driven_slider_crank()
    run = mbd.inverse_dynamics(f.mechanism, TIMES)
    pins = {f.A: (f.crank,), f.B: (f.crank, f.rod), f.C: (f.rod, f.slider), f.guide: (f.slider,)}
    markers = {
        (f.A, f.crank): f.crank.at(-0.05, 0), (f.B, f.crank): f.crank.at(0.1, 0),
        (f.B, f.rod): f.rod.at(-0.2, 0), (f.C, f.rod): f.rod.at(0.25, 0),
        (f.C, f.slider): f.slider.at(0, 0), (f.guide, f.slider): f.slider.at(0, 0),
    }  # fmt: skip
    for body in f.mechanism.bodies:
        force = np.tile([0, -G * body.mass], (TIMES.size, 1))
        moment = run[f.drivers[0].effort] if body is f.crank else np.zeros(TIMES.size)
        for joint, ends in pins.items():
            if body in ends:
                reaction = joint.reaction_on(body)
                arm, push = run[markers[joint, body].position - body.position], run[reaction.force]
                force = force + push
                moment = moment + run[reaction.torque] + arm[:, 0] * push[:, 1] - arm[:, 1] * push[:, 0]
        np.testing.assert_allclose(force, body.mass * run[body.a[:2]], atol=1e-9)
        np.testing.assert_allclose(moment, body.inertia * run[body.alpha], atol=1e-9)


def test_driver_at_a_joint_between_moving_bodies():
    """A motor in the elbow of a double pendulum: its effort is the moment of all that hangs behind it."""
    upper = mbd.Body("upper", mass=2.0, inertia=0.3, pose=(0.4, 0, 0))
    lower = mbd.Body("lower", mass=1.0, inertia=0.1, pose=(1.1, 0, 0))
    shoulder = mbd.Revolute("shoulder", mbd.ground.at(0, 0), upper.at(-0.4, 0))
    elbow = mbd.Revolute("elbow", upper.at(0.4, 0), lower.at(-0.3, 0))
    drivers = [mbd.Driver("one", shoulder.angle, mbd.sin(3 * mbd.t)), mbd.Driver("two", elbow.angle, mbd.t**2)]
    arm = mbd.Mechanism(bodies=[upper, lower], joints=[shoulder, elbow], drivers=drivers, forces=[mbd.Gravity()])
    run = mbd.inverse_dynamics(arm, TIMES)
    lever = run[lower.position - lower.at(-0.3, 0).position]
    load = run[lower.a[:2]] + [0, G]
    moment = 0.1 * run[lower.alpha] + lever[:, 0] * load[:, 1] - lever[:, 1] * load[:, 0]
    np.testing.assert_allclose(run[drivers[1].effort], moment, atol=1e-10)
    whole = power(run, [upper, lower])
    given = run[drivers[0].effort * shoulder.angular_velocity + drivers[1].effort * elbow.angular_velocity]
    np.testing.assert_allclose(given, whole, atol=1e-9)


def test_redundant_reactions_are_the_least_ones():
    """Three cranks on one coupler: multipliers of least norm, a note, and the effort, which is unique."""
    cranks = [mbd.Body(f"crank {k}", mass=1, inertia=1 / 12, pose=(k + 0.3, 0.4, 0.9)) for k in range(3)]
    coupler = mbd.Body("coupler", mass=2, inertia=1, pose=(1.6, 0.8, 0.0))
    joints = [mbd.Revolute(f"foot {k}", mbd.ground.at(k, 0), b.at(-0.5, 0)) for k, b in enumerate(cranks)]
    joints += [mbd.Revolute(f"head {k}", b.at(0.5, 0), coupler.at(k - 1, 0)) for k, b in enumerate(cranks)]
    drive = mbd.Driver("drive", joints[0].angle, 0.9 + 0.4 * mbd.sin(3 * mbd.t))
    mechanism = mbd.Mechanism(bodies=[*cranks, coupler], joints=joints, drivers=[drive], forces=[mbd.Gravity()])
    run = mbd.inverse_dynamics(mechanism, TIMES)
    angle, rate, turn = 0.9 + 0.4 * np.sin(3 * TIMES), 1.2 * np.cos(3 * TIMES), -3.6 * np.sin(3 * TIMES)
    torque = 3 * turn + 3.5 * G * np.cos(angle)  # 3 · 1/3 + 2 · 1² = 3 kg m²
    np.testing.assert_allclose(run[drive.effort], torque, atol=1e-9)
    np.testing.assert_allclose(run[joints[0].angular_velocity], rate, atol=1e-9)
    eom = mbd.equations(mechanism)
    for k in range(0, TIMES.size, 10):
        state = run.state(k)
        jacobian = state[eom.Phi_q]
        load = state[eom.Q] - np.diag(state[eom.M]) * state.a
        least = np.linalg.pinv(jacobian.T, rcond=1e-10) @ load
        np.testing.assert_allclose(run.lam[k], least, atol=1e-8)
    assert any("redundant" in note for note in run.statistics.notes)
    regular = mbd.inverse_dynamics(driven_slider_crank().mechanism, TIMES)
    assert regular.statistics.notes == []


def test_shaking_force_and_moment():
    """What the frame feels: Σ m (g - a), and its moment about a point with Σ -J' alpha."""
    f = driven_slider_crank()
    run = mbd.inverse_dynamics(f.mechanism, TIMES)
    point = np.array([0.2, -0.1])
    shaking = mbd.shaking_force(f.mechanism, point)
    bodies = f.mechanism.bodies
    loads = [b.mass * (np.array([0, -G]) - run[b.a[:2]]) for b in bodies]
    np.testing.assert_allclose(run[shaking.force], sum(loads), atol=1e-9)
    arms = [run[b.position] - point for b in bodies]
    moment = sum(r[:, 0] * load[:, 1] - r[:, 1] * load[:, 0] for r, load in zip(arms, loads, strict=True))
    moment = moment - sum(b.inertia * run[b.alpha] for b in bodies)
    np.testing.assert_allclose(run[shaking.moment], moment, atol=1e-9)
    pins = run[f.A.reaction_on(mbd.ground).force] + run[f.guide.reaction_on(mbd.ground).force]
    np.testing.assert_allclose(run[shaking.force], pins, atol=1e-9)


def test_inputs_are_loads():
    """An input beside the drivers: as number, samples or expression it changes the effort by its own torque."""
    load = mbd.Input("load", value=1.0)
    f = four_bar(
        0.5, forces=lambda f: [mbd.Gravity(), mbd.Torque("load", f.crank, -load)], inputs=[load],
        drivers=lambda f: [mbd.Driver("drive", f.A.angle, 0.5 + 6 * mbd.t)],
    )  # fmt: skip
    drive = f.drivers[0]
    free = mbd.inverse_dynamics(f.mechanism, TIMES, inputs={load: 0})[drive.effort]
    for given, wanted in (
        (None, 1.0),
        ({load: 3.0}, 3.0),
        ({load: np.sin(TIMES)}, np.sin(TIMES)),
        ({load: 2 * mbd.sin(f.crank.phi) + 0.1 * f.crank.omega}, 2 * np.sin(0.5 + 6 * TIMES) + 0.6),
    ):
        run = mbd.inverse_dynamics(f.mechanism, TIMES, inputs=given)
        np.testing.assert_allclose(run[drive.effort] - free, wanted, atol=1e-10)
        np.testing.assert_allclose(run[load], wanted, atol=1e-12)


def test_friction_that_depends_on_the_reaction():
    """A torque that grows with the pin's load: the effort meets it, and the balance holds with it."""
    rod = mbd.Body("rod", mass=1.5, inertia=0.08, pose=(0.4, 0, 0))
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), rod.at(-0.4, 0))
    torque = -0.3 * 0.02 * mbd.norm(hinge.reaction_on(rod).force) * mbd.tanh(rod.omega / 0.1)
    friction = mbd.GeneralizedForce("bush", [(rod.phi, torque)])
    drive = mbd.Driver("drive", hinge.angle, mbd.sin(4 * mbd.t))
    mechanism = mbd.Mechanism(bodies=[rod], joints=[hinge], drivers=[drive], forces=[mbd.Gravity(), friction])
    run = mbd.inverse_dynamics(mechanism, TIMES)
    angle, rate, turn = np.sin(4 * TIMES), 4 * np.cos(4 * TIMES), -16 * np.sin(4 * TIMES)
    ax, ay = (
        0.4 * (-turn * np.sin(angle) - rate**2 * np.cos(angle)),
        0.4 * (turn * np.cos(angle) - rate**2 * np.sin(angle)),
    )
    load = 1.5 * np.hypot(ax, ay + G)
    twist = -0.3 * 0.02 * load * np.tanh(rate / 0.1)
    wanted = (0.08 + 1.5 * 0.16) * turn + 1.5 * G * 0.4 * np.cos(angle) - twist
    np.testing.assert_allclose(run[drive.effort], wanted, atol=1e-9)


def test_parameters():
    """Twice the gravity of a pendulum at rest is twice the torque that holds it."""
    g = mbd.Parameter("g", G)
    rod = mbd.Body("rod", mass=2.0, inertia=1.0, pose=(0.5, 0, 0))
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), rod.at(-0.5, 0))
    hold = mbd.Driver("hold", hinge.angle, 0.3)
    mechanism = mbd.Mechanism(
        bodies=[rod], joints=[hinge], drivers=[hold], forces=[mbd.Gravity((0, -g))], parameters=[g]
    )
    for value in (G, 2 * G):
        run = mbd.inverse_dynamics(mechanism, [0, 1], parameters={g: value})
        np.testing.assert_allclose(run[hold.effort], value * np.cos(0.3), rtol=1e-13)


def test_one_time_and_between_times():
    """A single instant; and .at() is as exact as the times themselves."""
    f = driven_slider_crank()
    coarse, fine = mbd.inverse_dynamics(f.mechanism, np.linspace(0, 1, 41)), np.linspace(0.003, 0.997, 57)
    wanted = mbd.inverse_dynamics(f.mechanism, np.r_[0, fine])
    between = coarse.at(fine)
    scale = np.abs(wanted.lam).max()
    np.testing.assert_allclose(between.q, wanted.q[1:], atol=1e-12)
    np.testing.assert_allclose(between.lam, wanted.lam[1:], atol=1e-10 * scale)
    once = mbd.inverse_dynamics(f.mechanism, [fine[5]])
    np.testing.assert_allclose(once.lam[0], wanted.lam[6], atol=1e-10 * scale)


@pytest.mark.slow
def test_agrees_with_simulation():
    """A simulation under samples of the effort gives the motion back, with the square of the samples' distance."""
    f = motor_four_bar()
    drive = mbd.Driver("drive", f.A.angle, 0.5 + 6 * mbd.t)
    start = [f.A.angle == 0.5, f.crank.omega == 6]
    errors = []
    for count in (251, 501):
        times = np.linspace(0, 0.5, count)
        known = mbd.inverse_dynamics(f.mechanism.replace(drivers=[drive]), times)
        again = mbd.simulate(f.mechanism, times, initial=start, inputs={f.crank_torque: known[drive.effort]}, **TIGHT)
        errors.append(np.abs(again[f.A.angle] - 0.5 - 6 * times).max())
    assert errors[1] < 2e-4
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.05)
    pin = f.A.reaction_on(f.crank).force
    np.testing.assert_allclose(again[pin], known[pin], atol=1e-3 * np.abs(known[pin]).max())


# --- a motion from elsewhere ----------------------------------------------------------------------------------
def test_of_a_simulation():
    """The torque of a simulation is found in its motion."""
    f = motor_four_bar()
    law = 1.5 * mbd.sin(4 * mbd.t) - 0.2 * f.crank.omega
    motion = mbd.simulate(f.mechanism, TIMES, initial=[f.A.angle == 0.5], inputs={f.crank_torque: law})
    found = mbd.inverse_dynamics(f.mechanism, motion=motion, efforts=[f.crank_torque])
    np.testing.assert_allclose(found[f.crank_torque], motion[law], atol=1e-8)
    np.testing.assert_allclose(found.lam, motion.lam, atol=1e-7)
    np.testing.assert_array_equal(found.t, motion.t)
    elsewhere = mbd.inverse_dynamics(f.mechanism, np.linspace(0.1, 0.9, 9), motion=motion, efforts=[f.crank_torque])
    np.testing.assert_allclose(elsewhere[f.crank_torque], elsewhere[law], atol=1e-6)


def test_output_driven_torque_at_the_input():
    """The rocker's course is prescribed, the crank's torque is found: by the power balance."""
    f = motor_four_bar()
    start = float(f.rocker.pose_estimate[2])
    law = start + 0.3 * mbd.sin(2 * mbd.t)
    run = mbd.inverse_dynamics(f.mechanism, TIMES, motion={f.D.angle: law}, efforts=[f.crank_torque])
    np.testing.assert_allclose(run[f.rocker.phi], start + 0.3 * np.sin(2 * TIMES), atol=1e-11)
    wanted = power(run, f.mechanism.bodies)
    assert np.abs(wanted).max() > 0.1
    np.testing.assert_allclose(run[f.crank_torque * f.crank.omega], wanted, atol=1e-9)
    np.testing.assert_allclose(run[f.rocker_torque], 0)
    same = mbd.inverse_dynamics(
        f.mechanism, TIMES, motion={f.D.angle: lambda t: start + 0.3 * mbd.sin(2 * t)}, efforts=[f.crank_torque]
    )
    np.testing.assert_array_equal(same.inputs, run.inputs)


@pytest.mark.slow
@pytest.mark.parametrize("form", ["CubicSpline", "make_interp_spline", "UnivariateSpline", "PPoly", "array", "list"])
def test_a_motion_given_as_data(form):
    """A pendulum along ``0.4 sin 3t``: ``tau = J phi'' + m g l/2 cos phi``; splines of SciPy and samples."""
    from scipy import interpolate

    rod = mbd.Body("rod", mass=2.0, inertia=2 / 12, pose=(0.5, 0, 0))
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), rod.at(-0.5, 0))
    tau = mbd.Input("tau")
    forces = [mbd.Gravity(), mbd.Torque("motor", rod, tau)]
    model = mbd.Mechanism([rod], [hinge], forces=forces, inputs=[tau])
    times = np.linspace(0, 1, 101)
    samples = 0.4 * np.sin(3 * times)
    course = {
        "CubicSpline": lambda: interpolate.CubicSpline(times, samples),
        "make_interp_spline": lambda: interpolate.make_interp_spline(times, samples, k=5),
        "UnivariateSpline": lambda: interpolate.UnivariateSpline(times, samples, k=5, s=0),
        "PPoly": lambda: interpolate.PPoly.from_spline(interpolate.splrep(times, samples, k=5, s=0)),
        "array": lambda: samples,
        "list": lambda: samples.tolist(),
    }[form]()
    run = mbd.inverse_dynamics(model, times, motion={hinge.angle: course}, efforts=[tau])
    wanted = -9 * samples * (2 / 12 + 2 * 0.25) + 2 * 9.81 * 0.5 * np.cos(samples)
    np.testing.assert_allclose(run[hinge.angle], samples, atol=1e-10)
    np.testing.assert_allclose(run[tau], wanted, atol=2e-2 if form == "CubicSpline" else 1e-4)
    if form not in ("array", "list"):
        driven = mbd.inverse_dynamics(model.replace(drivers=[mbd.Driver("d", hinge.angle, course)]), times)
        np.testing.assert_allclose(driven[rod.phi], samples, atol=1e-10)


def test_refuses_data_that_are_no_motion():
    from scipy.interpolate import CubicSpline

    f = motor_four_bar()
    times = np.linspace(0, 1, 11)

    def run(value, at=times):
        return mbd.inverse_dynamics(f.mechanism, at, motion={f.D.angle: value}, efforts=[f.crank_torque])

    with pytest.raises(mbd.MechanismError, match="one sample for each of the 11 times is needed, got 5"):
        run(np.zeros(5))
    with pytest.raises(mbd.MechanismError, match="at least 6 are needed, got 3"):
        run([1.0, 1.1, 1.2], times[:3])
    with pytest.raises(mbd.MechanismError, match=r"must be finite, got ys\[2\]"):
        run([1.0, 1.1, np.nan, *[1.0] * 8])
    with pytest.raises(mbd.MechanismError, match="one value at each point is needed"):
        run(CubicSpline(times, np.ones((11, 2))))


def test_other_inputs_are_known():
    """Other inputs are given: a brake at the rocker takes its power."""
    f = motor_four_bar()
    start = float(f.rocker.pose_estimate[2])
    run = mbd.inverse_dynamics(
        f.mechanism, TIMES, motion={f.D.angle: start + 0.3 * mbd.sin(2 * mbd.t)}, efforts=[f.crank_torque],
        inputs={f.rocker_torque: -0.5 * f.rocker.omega},
    )  # fmt: skip
    given = run[f.crank_torque * f.crank.omega + f.rocker_torque * f.rocker.omega]
    np.testing.assert_allclose(given, power(run, f.mechanism.bodies), atol=1e-9)
    np.testing.assert_allclose(run[f.rocker_torque], -0.5 * run[f.rocker.omega], atol=1e-12)
    with pytest.raises(mbd.MechanismError, match="crank torque.*in inputs= and in efforts="):
        mbd.inverse_dynamics(
            f.mechanism, TIMES, motion={f.D.angle: start}, efforts=[f.crank_torque], inputs={f.crank_torque: 1.0}
        )


def test_effort_elsewhere():
    """The same motion by the crank's torque or by the rocker's: equal power."""
    f = motor_four_bar()
    motion = {f.A.angle: 0.5 + 0.4 * mbd.sin(3 * mbd.t)}
    crank = mbd.inverse_dynamics(f.mechanism, TIMES, motion=motion, efforts=[f.crank_torque])
    rocker = mbd.inverse_dynamics(f.mechanism, TIMES, motion=motion, efforts=[f.rocker_torque])
    first, second = crank[f.crank_torque * f.crank.omega], rocker[f.rocker_torque * f.rocker.omega]
    np.testing.assert_allclose(first, second, atol=1e-9 * np.abs(first).max())


def test_efforts_between_times():
    """.at() solves again for the efforts."""
    f = motor_four_bar()
    motion = {f.A.angle: 0.5 + 0.4 * mbd.sin(3 * mbd.t)}
    fine = np.linspace(0.01, 0.99, 23)
    run = mbd.inverse_dynamics(f.mechanism, TIMES, motion=motion, efforts=[f.crank_torque])
    wanted = mbd.inverse_dynamics(f.mechanism, np.r_[0, fine], motion=motion, efforts=[f.crank_torque])
    np.testing.assert_allclose(run.at(fine)[f.crank_torque], wanted[f.crank_torque][1:], atol=1e-9)


def test_efforts_with_redundant_rows():
    """Two guides in line: the effort is found nevertheless, and the note says what is not unique."""
    push = mbd.Input("push")
    block = mbd.Body("block", mass=2.0, inertia=0.1)
    guides = [mbd.Translational(f"guide {k}", mbd.ground.at(k, 0), block.at(k, 0)) for k in range(2)]
    mechanism = mbd.Mechanism(
        bodies=[block],
        joints=guides,
        forces=[mbd.Gravity(), mbd.Force("push", block.at(0, 0), (push, 0))],
        inputs=[push],
    )
    run = mbd.inverse_dynamics(mechanism, TIMES, motion={block.x: mbd.sin(3 * mbd.t)}, efforts=[push])
    np.testing.assert_allclose(run[push], -18 * np.sin(3 * TIMES), atol=1e-10)
    total = sum(run[g.reaction_on(block).force] for g in guides)
    np.testing.assert_allclose(total, np.tile([0, 2 * G], (TIMES.size, 1)), atol=1e-10)
    assert any("redundant" in note for note in run.statistics.notes)


# --- refusals ---------------------------------------------------------------------------------------------------
def test_refuses_a_motion_that_breaks_the_constraints():
    """From a linkage of other lengths: the row, the size and the time of the worst violation."""
    other, f = four_bar(0.5, lengths=(0.2, 0.5, 0.4, 0.56)), motor_four_bar()
    bodies = f.mechanism.bodies
    joints = [f.A, f.B, f.C, mbd.Revolute("D elsewhere", mbd.ground.at(0.56, 0), f.rocker.at(-0.2, 0))]
    wrong = mbd.simulate(mbd.Mechanism(bodies=bodies, joints=joints, forces=[mbd.Gravity()]), TIMES)
    with pytest.raises(mbd.MechanismError, match=r"D\.x.*position.*0\.01 .*t = ") as caught:
        mbd.inverse_dynamics(f.mechanism, motion=wrong, efforts=[f.crank_torque])
    assert caught.value.time is not None and other is not f


def test_refuses_rates_that_break_the_constraints():
    """Positions right, velocities of another motion: the level is named."""
    f = motor_four_bar()
    right = mbd.simulate(f.mechanism, TIMES, initial=[f.A.angle == 0.5, f.crank.omega == 2])
    for level, changed in (("velocity", {"v": 1.01 * right.v}), ("acceleration", {"a": 1.01 * right.a})):
        arrays = {"q": right.q, "v": right.v, "a": right.a} | changed
        wrong = mbd.Trajectory(
            f.mechanism,
            right.t,
            arrays["q"],
            arrays["v"],
            arrays["a"],
            right.z,
            right.lam,
            right.inputs,
            right.parameters,
        )
        if level == "velocity":  # homogeneous rows: a scaled velocity is consistent, but not with its accelerations
            with pytest.raises(mbd.MechanismError, match="acceleration"):
                mbd.inverse_dynamics(f.mechanism, motion=wrong, efforts=[f.crank_torque])
            arrays["v"] = right.v + 0.01
            wrong = mbd.Trajectory(
                f.mechanism, right.t, right.q, arrays["v"], right.a, right.z, right.lam, right.inputs, right.parameters
            )
        with pytest.raises(mbd.MechanismError, match=level):
            mbd.inverse_dynamics(f.mechanism, motion=wrong, efforts=[f.crank_torque])


def test_too_few_efforts():
    """By how many."""
    f = motor_four_bar()
    motion = {f.A.angle: 0.5 + 0.4 * mbd.sin(3 * mbd.t)}
    with pytest.raises(mbd.MechanismError, match="over-determined by 1"):
        mbd.inverse_dynamics(f.mechanism, TIMES, motion=motion)
    free = mbd.Body("free", mass=1, inertia=1)
    u = mbd.Input("u")
    mechanism = mbd.Mechanism(bodies=[free], forces=[mbd.Force("push", free.at(0, 0), (u, 0))], inputs=[u])
    motion = {free.x: mbd.t, free.y: mbd.t**2, free.phi: 0}
    with pytest.raises(mbd.MechanismError, match=r"over-determined by 2.*'u'"):
        mbd.inverse_dynamics(mechanism, TIMES, motion=list(motion.items()), efforts=[u])


def test_dead_point():
    """A force on the slider cannot accelerate the crank in the dead point; the torque at the crank can."""
    push, torque = mbd.Input("push"), mbd.Input("torque")
    f = slider_crank(
        0.4,
        forces=lambda f: [mbd.Force("push", f.slider.at(0, 0), (push, 0)), mbd.Torque("motor", f.crank, torque)],
        inputs=[push, torque],
    )
    times = np.linspace(0, 1, 11)
    law = 0.4 - 0.8 * mbd.t + 0.3 * mbd.sin(2 * np.pi * mbd.t)  # zero at t = 0.5
    by_torque = mbd.inverse_dynamics(f.mechanism, times, motion={f.A.angle: law}, efforts=[torque])
    assert np.all(np.isfinite(by_torque.inputs))
    with pytest.raises(mbd.SingularityError, match=r"push.*t = 0\.5 s.*dead point") as caught:
        mbd.inverse_dynamics(f.mechanism, times, motion={f.A.angle: law}, efforts=[push])
    assert caught.value.time == pytest.approx(0.5)


def test_efforts_that_do_nothing():
    """An input that works against the joints alone can make no motion at any time."""
    side = mbd.Input("side")
    block = mbd.Body("block", mass=1, inertia=1)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    mechanism = mbd.Mechanism(
        bodies=[block], joints=[guide], forces=[mbd.Force("side", block.at(0, 0), (0, side))], inputs=[side]
    )
    with pytest.raises(mbd.MechanismError, match="side"):
        mbd.inverse_dynamics(mechanism, TIMES, motion={block.x: mbd.sin(mbd.t)}, efforts=[side])


def test_efforts_against_friction_by_reactions():
    """A block pushed up a slope by a horizontal force: ``F cos α - m g sin α - μ N = m a, N = m g cos α + F sin α``."""
    slope, mu, mass = 0.3, 0.5, 2.0
    block = mbd.Body("block", mass=mass, inertia=0.1, pose=(0, 0, slope))
    guide = mbd.Translational("guide", mbd.ground.at(0, 0, slope), block.at(0, 0, 0))
    F = mbd.Input("F")
    forces = [
        mbd.Gravity(),
        mbd.JointFriction("rub", guide, mbd.Coulomb(mu, 1e-5)),
        mbd.Force("push", block.at(0, 0), (F, 0)),
    ]
    model = mbd.Mechanism([block], [guide], forces=forces, inputs=[F])
    course = mbd.t + 0.5 * mbd.t**2
    run = mbd.inverse_dynamics(model, np.linspace(0, 1, 5), motion={guide.displacement: course}, efforts=[F])
    c, s = np.cos(slope), np.sin(slope)
    wanted = mass * (1 + 9.81 * s + mu * 9.81 * c) / (c - mu * s)
    np.testing.assert_allclose(run[F], wanted, rtol=1e-6)
    normal = np.linalg.norm(run[guide.reaction_on(block).force], axis=1)
    np.testing.assert_allclose(normal, mass * 9.81 * c + wanted * s, rtol=1e-6)
    again = mbd.simulate(
        model, np.linspace(0, 1, 5), initial=[guide.displacement == 0, block.vx == c], inputs={F: wanted}
    )
    np.testing.assert_allclose(again[guide.displacement], run[guide.displacement], atol=1e-4)


def test_refuses_what_is_not_linear():
    """A torque in the square of an input."""
    u = mbd.Input("u")
    p = pendulum(forces=lambda rod: [mbd.Torque("motor", rod, u**2)], inputs=[u])
    with pytest.raises(mbd.MechanismError, match="linear"):
        mbd.inverse_dynamics(p.mechanism, TIMES, motion={p.rod.phi: mbd.sin(mbd.t)}, efforts=[u])


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"times": TIMES, "efforts": ["crank torque"]}, "efforts"),
        ({"times": TIMES, "motion": {}, "efforts": []}, "prescribes nothing"),
        ({"efforts": []}, "times"),
        ({"times": TIMES}, "1 degree of freedom"),
    ],
)
def test_refuses_arguments(arguments, words):
    """Efforts without a motion, a motion of nothing, no times, no drivers."""
    f = motor_four_bar()
    with pytest.raises(mbd.MechanismError, match=words):
        mbd.inverse_dynamics(f.mechanism, **arguments)


def test_refuses_a_foreign_effort():
    """An input that is not in the mechanism is named."""
    f = motor_four_bar()
    with pytest.raises(mbd.MechanismError, match="'other'"):
        mbd.inverse_dynamics(f.mechanism, TIMES, motion={f.A.angle: 0.5}, efforts=[mbd.Input("other")])


def test_lock_up():
    """As in kinematics: the time and the rows, with what was computed before and its forces."""
    f = four_bar(
        0.2, (0.4, 0.5, 0.45, 1.0), (1, 1, 1), (0.01, 0.02, 0.02), forces=[mbd.Gravity()],
        drivers=lambda f: [mbd.Driver("drive", f.A.angle, 0.2 + 0.5 * mbd.t)],
    )  # fmt: skip
    with pytest.raises(mbd.SingularityError, match="lock-up") as caught:
        mbd.inverse_dynamics(f.mechanism, np.linspace(0, 5, 201))
    assert caught.value.time == pytest.approx(2.0861742245, abs=1e-6)
    assert caught.value.partial[f.crank.phi].size > 80


def test_states_and_drivers_go_together():
    """A first-order state is not determined by a prescribed motion: reported, or integrated."""
    current = mbd.StateVariable("current", value=0.0)
    rod = mbd.Body("rod", mass=1, inertia=1, pose=(0.5, 0, 0))
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), rod.at(-0.5, 0))
    drive = mbd.Driver("drive", hinge.angle, mbd.t)
    mechanism = mbd.Mechanism(
        bodies=[rod], joints=[hinge], drivers=[drive], forces=[mbd.Torque("motor", rod, current)],
        states={current: 1 - current},
    )  # fmt: skip
    times = np.linspace(0, 3, 61)
    try:
        run = mbd.inverse_dynamics(mechanism, times)
    except mbd.MechanismError as error:
        assert "current" in str(error)
        return
    exact = 1 - np.exp(-times)
    noted = any("current" in note for note in run.statistics.notes)
    assert noted or np.allclose(run[current], exact, atol=1e-6), "the state stays at its initial value without a word"
