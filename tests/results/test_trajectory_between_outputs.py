"""The motion between outputs, however far apart, against closed forms and runs with outputs there; its extrema."""

import numpy as np
import pytest

import mbdcasadi as mbd

G = 9.81
METHODS = ["idas", "dop853", "erk", "rosenbrock", "auto"]


def close(motion, fine, expressions, rel):
    """Assert that a motion between its outputs is another one with outputs there."""
    for expression in expressions:
        exact = fine[expression]
        np.testing.assert_allclose(motion.at(fine.t)[expression], exact, rtol=0, atol=rel * np.max(np.abs(exact)))


def falling(*forces, **parts):
    ball = mbd.Body("ball", mass=0.6, inertia=2.4e-3, pose=(0, 1.1, 0))
    return ball, mbd.Mechanism([ball], forces=[mbd.Gravity(), *[force(ball) for force in forces]], **parts)


@pytest.mark.parametrize("method", METHODS)
def test_a_spinning_linkage_with_four_outputs(method):
    model = mbd.library.four_bar()
    arguments = {"initial": [model.crank.phi == 0.3, model.crank.omega == 8.0], "method": method}
    fine = mbd.simulate(model.mechanism, np.linspace(0, 1.5, 601), reltol=1e-11, abstol=1e-11, **arguments)
    motion = mbd.simulate(model.mechanism, np.linspace(0, 1.5, 4), **arguments)
    load = mbd.norm(model.mechanism.joints[1].reaction_on(model.crank).force)
    close(motion, fine, [model.rocker.phi, model.crank.omega, load], 1e-5)
    assert motion.maximum(load).value == pytest.approx(fine.maximum(load).value, rel=1e-5)
    assert motion.at(fine.t).drift.position < 1e-12


def test_knots_follow_each_other_without_jumps():
    """A crank that comes to turn twenty times a second, with outputs a turn apart: knots lie where it needs them.

    Where speeds jumped from one knot to the next, more and more would lie next to each other.
    """
    model = mbd.library.slider_crank()
    arguments = {"inputs": {model.tau: 4.0 - 0.05 * model.crank.omega}}
    motion = mbd.simulate(model.mechanism, np.linspace(0, 1.5, 31), **arguments)
    fine = mbd.simulate(model.mechanism, np.linspace(0, 1.5, 301), reltol=1e-11, abstol=1e-11, **arguments)
    assert np.max(np.abs(motion[model.crank.omega])) > 100 and np.min(np.diff(motion.knots)) > 1e-5
    close(motion, fine, [model.crank.phi, model.crank.omega], 1e-5)


@pytest.mark.parametrize("method", ["idas", "dop853"])
def test_bounces_by_an_event_between_outputs(method):
    """Each rebound keeps 0.8 of the speed: parabolas, with jumps of the speed between the outputs."""
    ball, mechanism = falling()
    lands = mbd.Event("lands", ball.y, direction=-1, reset={ball.vy: -0.8 * ball.vy})
    motion = mbd.simulate(mechanism, [0.0, 1.5], events=[lands], method=method)
    first = np.sqrt(2 * 1.1 / G)
    speed, t = 0.8 * G * first, np.linspace(0.5, 1.1, 50)
    np.testing.assert_allclose(motion.at(t)[ball.y], speed * (t - first) - G / 2 * (t - first) ** 2, atol=1e-7)
    fastest, slowest = motion.maximum(ball.vy), motion.minimum(ball.vy)
    assert (fastest.value, slowest.value) == pytest.approx((speed, -G * first), rel=1e-7)
    assert fastest.t > slowest.t == pytest.approx(first, rel=1e-8)
    assert fastest.state[ball.vy] == fastest.value


@pytest.mark.parametrize("method", ["idas", "dop853", "rosenbrock", "bdf"])
def test_a_stiff_contact_between_outputs(method):
    law = mbd.HuntCrossley(2e5, exponent=1)
    _, mechanism = falling(
        lambda ball: mbd.Contact("floor", mbd.Circle(ball.at(0, 0), 0.1), mbd.HalfPlane(mbd.ground.at(0, 0)), law)
    )
    floor = mechanism.forces[1]
    motion = mbd.simulate(mechanism, np.linspace(0, 1, 6), method=method)
    weight = 0.6 * G
    by_hand = weight + np.sqrt(weight**2 + 2 * weight * 2e5)  # m g (h + d) = k d²/2
    assert motion.maximum(floor.normal_force).value == pytest.approx(by_hand, rel=1e-4)
    assert motion.minimum(floor.normal_force).value == 0


def test_stick_and_slip_between_outputs():
    """A block slides to rest, and is torn away by a rising pull."""
    block = mbd.Body("block", mass=1.0, inertia=0.1)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    rub = mbd.JointFriction("rub", guide, mbd.DryFriction(0.3))
    pull = mbd.Force("pull", block.at(0, 0), (2.0 * mbd.t, 0))
    mechanism = mbd.Mechanism([block], joints=[guide], forces=[mbd.Gravity(), rub, pull])
    motion = mbd.simulate(mechanism, [0.0, 2.0], initial=[guide.displacement == 0, guide.speed == 1.0])
    stop, torn = (event.t for event in motion.events)
    friction = 0.3 * G
    assert stop == pytest.approx((friction - np.sqrt(friction**2 - 4)) / 2) and torn == pytest.approx(friction / 2)
    t = np.linspace(0, 2, 100)
    moving = np.where(t < stop, 1 - friction * t + t**2, np.where(t < torn, 0, (t - torn) ** 2))
    np.testing.assert_allclose(motion.at(t)[guide.speed], moving, atol=1e-7)
    assert motion.maximum(mbd.fabs(rub.force)).value == pytest.approx(friction, rel=1e-7)


def test_a_controller_holds_its_answers_between_outputs():
    """The answers are those that were given: the controller is not asked again."""
    force = mbd.Input("force")
    ball, mechanism = falling(lambda ball: mbd.Force("push", ball.at(0, 0), (force, 0)), inputs=[force])
    asked = []

    def answer(t, _state):
        asked.append(t)
        return {force: float(len(asked) % 3)}

    motion = mbd.simulate(mechanism, [0.0, 1.0], inputs=mbd.SampledController(answer, 0.1))
    times, count = np.linspace(0.01, 0.99, 50), len(asked)
    expected = (np.floor(times / 0.1 + 1e-9) + 1) % 3
    np.testing.assert_allclose(motion.at(times)[ball.ax] * 0.6, expected, atol=1e-9)
    speed = np.array([np.sum(((np.arange(k) + 1) % 3) * 0.1) for k in (3, 7, 9)]) / 0.6
    np.testing.assert_allclose(motion.at([0.3, 0.7, 0.9])[ball.vx], speed, rtol=1e-8)
    assert len(asked) == count


def test_pulses_in_time_and_samples_between_outputs():
    ball, mechanism = falling(lambda ball: mbd.Force("pulse", ball.at(0, 0), (mbd.if_else(mbd.t > 0.4, 1, 0), 0)))
    motion = mbd.simulate(mechanism, [0.0, 1.0])
    t = np.linspace(0, 1, 41)
    np.testing.assert_allclose(motion.at(t)[ball.vx], np.maximum(t - 0.4, 0) / 0.6, atol=1e-8)
    assert motion.maximum(ball.ax).value == pytest.approx(1 / 0.6) and motion.minimum(ball.ax).value == 0


def test_changes_of_the_mechanism_between_outputs():
    """A mass on a rod is let go at its lowest point: it flies a parabola."""
    mass = mbd.Body("mass", mass=1.0, inertia=0.1, pose=(1.0, 0, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), mass.at(-1.0, 0))
    free = mbd.Mechanism([mass], forces=[mbd.Gravity()])
    held = mbd.Mechanism([mass], joints=[pin], forces=[mbd.Gravity()])
    lets_go = mbd.Event("lets go", mass.phi + np.pi / 2, direction=-1, becomes=free)
    motion = mbd.simulate(held, [0.0, 1.5], events=[lets_go])
    change, speed = motion.events[0].t, np.sqrt(2 * G / 1.1)
    t = np.linspace(change, 1.5, 20)
    np.testing.assert_allclose(motion.at(t)[mass.x], -speed * (t - change), atol=1e-7)
    pull = motion.maximum(mbd.norm(pin.reaction_on(mass).force))
    assert pull.value == pytest.approx(G + speed**2, rel=1e-7) and pull.t == pytest.approx(change)


@pytest.mark.parametrize("kind", ["run", "phases"])
def test_files_hold_the_motion_between_outputs(tmp_path, kind):
    ball, mechanism = falling(lambda ball: mbd.Force("drag", ball.at(0, 0), (-ball.vx * mbd.norm(ball.v[:2]), 0)))
    other = mbd.Mechanism([ball], forces=[mbd.Gravity()])
    lands = {"reset": {ball.vy: -0.8 * ball.vy}} if kind == "run" else {"becomes": other}
    event = mbd.Event("lands", ball.y, direction=-1, **lands)
    motion = mbd.simulate(mechanism, [0.0, 0.7], initial=[ball.vx == 3], events=[event])
    motion.save(tmp_path / "run.npz")
    again = mbd.read_trajectory(tmp_path / "run.npz", mechanism if kind == "run" else [mechanism, other])
    close(again, motion.at(np.linspace(0, 0.7, 200)), [ball.x, ball.vy, ball.ax, ball.omega + 1], 1e-7)
    assert again.maximum(ball.vy).value == pytest.approx(motion.maximum(ball.vy).value, rel=1e-7)


def test_driven_motions_are_solved_where_they_are_asked_for():
    """A crank that turns three times between two outputs."""
    model = mbd.library.slider_crank()
    driven = model.mechanism.replace(drivers=[mbd.Driver("drive", model.crank.phi, 0.4 + 20 * mbd.t)])
    fine, coarse = np.linspace(0, 2, 401), np.linspace(0, 2, 3)
    for analysis in (mbd.kinematics, mbd.inverse_dynamics):
        exact, motion = analysis(driven, fine), analysis(driven, coarse)
        close(motion, exact, [model.slider.x, model.slider.vx, model.slider.ax], 1e-9)
    effort = driven.drivers[0].effort
    close(motion, exact, [effort], 1e-9)
    assert motion.maximum(effort).value == pytest.approx(exact.maximum(effort).value, rel=1e-8)


def test_many_equal_peaks_and_what_is_no_scalar():
    body = mbd.Body("body", mass=1.0, inertia=1.0)
    spring = mbd.Force("spring", body.at(0, 0), (-4 * np.pi**2 * body.x, 0))
    motion = mbd.simulate(mbd.Mechanism([body], forces=[spring]), duration=10.0, initial=[body.x == 1])
    assert motion.maximum(body.vx).value == pytest.approx(2 * np.pi, rel=1e-6)
    assert motion.minimum(mbd.fabs(body.x)).value == pytest.approx(0, abs=1e-8)
    assert motion.maximum(7.0).value == 7 and motion.maximum(mbd.t).t == 10
    with pytest.raises(mbd.MechanismError, match=r"takes a scalar, got an expression of shape \(2, 1\)"):
        motion.maximum(body.position)
    with pytest.raises(mbd.ExpressionError):
        motion.minimum(mbd.Body("other", 1, 1).x)


def test_many_modes_of_friction_between_outputs():
    """A block on a spring comes to rest after several swings, each of them integrated again in its own mode."""
    block = mbd.Body("block", mass=1.0, inertia=0.1)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    rub = mbd.JointFriction("rub", guide, mbd.DryFriction(0.3))
    spring = mbd.Force("spring", block.at(0, 0), (-100 * block.x, 0))
    mechanism = mbd.Mechanism([block], joints=[guide], forces=[mbd.Gravity(), rub, spring])
    motion = mbd.simulate(mechanism, [0.0, 2.0], initial=[guide.displacement == 0.2, guide.speed == 0])
    t = np.linspace(0, np.pi / 5, 60)
    loss, swing = 0.3 * G / 100, np.minimum(np.floor(t / (np.pi / 10) + 1e-9), 1)
    exact = (0.2 - (2 * swing + 1) * loss) * np.cos(10 * t) + (-1) ** swing * loss
    np.testing.assert_allclose(motion.at(t)[block.x], exact, atol=1e-7)
    assert motion.maximum(mbd.fabs(rub.force)).value == pytest.approx(0.3 * G, rel=1e-7)
