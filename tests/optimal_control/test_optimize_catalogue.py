"""Gears, cams, racks and motors in optimal control: solved, verified by IDAS, and against closed forms."""

import numpy as np
import pytest

import mbdcasadi as mbd


def test_rack_moved_with_least_torque():
    """From rest to rest: τ is linear in time, cost 12 (d m_eff R)² / T³ with m_eff = m + J / R²."""
    rack, pinion = mbd.Body("rack", 2.0, 0.01), mbd.Body("pinion", 1, 0.01, pose=(0, 0.06, 0))
    tau = mbd.Input("tau")
    joints = [
        mbd.Translational("guide", mbd.ground.at(0, 0), rack.at(0, 0)),
        mbd.Revolute("hub", mbd.ground.at(0, 0.06), pinion.at(0, 0)),
        mbd.RackAndPinion("mesh", rack.at(0, 0), pinion.at(0, 0), 0.06),
    ]
    mechanism = mbd.Mechanism([rack, pinion], joints, forces=[mbd.Torque("motor", pinion, tau)], inputs=[tau])
    problem = mbd.OptimalControlProblem(
        mechanism,
        duration=1.0,
        initial=[rack.x == 0, rack.vx == 0],
        final=[rack.x == 0.3, rack.vx == 0],
        running_cost=tau**2,
    )
    solution = mbd.optimize(problem, intervals=8)
    reduced = (2 + 0.01 / 0.06**2) * 0.06
    assert solution.cost == pytest.approx(12 * (0.3 * reduced) ** 2, rel=1e-8)
    assert solution.verify().final_error < 1e-8
    motion = solution.trajectory
    np.testing.assert_allclose(motion[joints[2].tooth_force], 2.0 * motion[rack.ax], atol=1e-7)


def test_planetary_train_turns_its_arm():
    """Ring held, torque on the sun: 12 (φ_s J_s)² / T³ with the train's inertia reduced to the sun by Willis."""
    rs, rp = 0.04, 0.02
    train = mbd.library.planetary_gear(rs, rp)
    hold = mbd.RelativeAngle("hold", mbd.ground.at(0, 0), train.ring.at(0, 0), 0.0)
    mechanism = train.mechanism
    torque = mechanism.force("sun torque")
    mechanism = mechanism.replace(joints=[*mechanism.joints, hold], forces=[torque], inputs=[train.tau_sun])
    problem = mbd.OptimalControlProblem(
        mechanism,
        duration=1.0,
        initial=[train.arm.phi == 0, train.arm.omega == 0],
        final=[train.arm.phi == np.pi, train.arm.omega == 0],
        running_cost=train.tau_sun**2,
    )
    solution = mbd.optimize(problem, intervals=8)
    ratio = rs / (rs + (rs + 2 * rp))  # arm to sun
    planet = train.planet_bodies[0]
    spin = ratio - rs / rp * (1 - ratio)  # planet to sun
    reduced = train.sun.inertia + ratio**2 * (train.arm.inertia + planet.mass * (rs + rp) ** 2)
    reduced += spin**2 * planet.inertia
    assert solution.cost == pytest.approx(12 * (np.pi / ratio * reduced) ** 2, rel=1e-6)
    assert solution.verify().final_error < 1e-6


def cam_motion(intervals=40, duration=0.5, **kind):
    """A turn of a cam with a flywheel with least torque, from rest to rest."""
    program = mbd.MotionProgram(mbd.rise(np.pi, 0.01, "3-4-5"), mbd.fall(np.pi, "3-4-5"))
    kind = {"stiffness": 2000, "preload": 100} | kind
    model = mbd.library.cam_follower(program, 0.04, masses=(40.0, 0.5), **kind)
    problem = mbd.OptimalControlProblem(
        model.mechanism,
        duration=duration,
        initial=[model.cam.phi == 0, model.cam.omega == 0],
        final=[model.cam.phi == 2 * np.pi, model.cam.omega == 0],
        running_cost=model.tau**2,
    )
    return model, mbd.optimize(problem, intervals=intervals)


@pytest.mark.slow
def test_cam_is_turned_with_least_torque():
    """A flat face and a roller with profiles for the same program: the same optimum; replayed; never lifted off."""
    costs = []
    for kind in ({}, {"roller_radius": 0.01}):
        model, solution = cam_motion(**kind)
        assert solution.verify().final_error < 1e-5
        motion = solution.trajectory
        lift = motion[model.follower.y] - motion[model.follower.y][0]
        program = mbd.MotionProgram(mbd.rise(np.pi, 0.01, "3-4-5"), mbd.fall(np.pi, "3-4-5"))
        np.testing.assert_allclose(lift, program(motion[model.cam.phi]), atol=1e-5)
        assert np.min(motion[model.contact.normal_force]) > 100  # the spring holds it down
        costs.append(solution.cost)
    assert costs[0] == pytest.approx(costs[1], rel=1e-7)


def test_a_follower_that_would_be_pulled_is_told():
    """With a soft spring the cam would have to hold the follower back: the optimum says so."""
    with pytest.warns(mbd.MechanismWarning, match="contact"):
        cam_motion(duration=0.1, stiffness=1.0, preload=1.0, intervals=20)


def test_motor_with_current_lifts_with_least_energy():
    """Voltage as input, current as state, the energy as a state that is the cost: the meter and the integral agree."""
    arm = mbd.Body("arm", mass=0.5, inertia=0.02, pose=(0, 0, 0))
    volts = mbd.Input("V", lower=-30, upper=30)
    motor = mbd.DCMotor("motor", arm, volts, constant=0.3, resistance=1.2, inductance=0.05)
    meter = mbd.EnergyMeter("heat", motor.heat)
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), arm.at(0, 0))
    mechanism = mbd.Mechanism([arm], [pin], forces=[motor, meter], inputs=[volts])
    problem = mbd.OptimalControlProblem(
        mechanism,
        duration=1.0,
        initial=[arm.phi == 0, arm.omega == 0, motor.current == 0, meter.energy == 0],
        final=[arm.phi == 2, arm.omega == 0],
        terminal_cost=meter.energy,
        running_cost=0,
    )
    solution = mbd.optimize(problem, intervals=30)
    assert solution.verify().final_error < 1e-4
    assert solution.trajectory[meter.energy][-1] == pytest.approx(solution.cost, rel=1e-6)
    # voltage enough for any current: the current is linear in time, and the heat R (J/K)² 12 d² / T³
    assert solution.cost == pytest.approx(1.2 * (0.02 / 0.3) ** 2 * 12 * 4, rel=0.015)  # it cannot jump at the start
    current = solution.trajectory.at(np.linspace(0.2, 1.0, 200))[motor.current]
    assert np.max(np.abs(np.diff(current, 2))) < 1e-3  # nothing moves unseen between the stages


@pytest.mark.skipif(not hasattr(mbd, "linearize"), reason="linearize is not there yet")
def test_motor_with_current_is_linearised():
    """Its poles are the eigenvalues of [[-R/L, -K/L], [K/J, 0]], beside the free angle's zero."""
    wheel = mbd.Body("wheel", mass=1, inertia=0.02)
    motor = mbd.DCMotor("motor", wheel, 0.0, constant=0.3, resistance=1.2, inductance=0.05)
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), wheel.at(0, 0))
    mechanism = mbd.Mechanism([wheel], [pin], forces=[motor])
    model = mbd.linearize(mechanism, mbd.assemble(mechanism))
    found = np.sort_complex(np.linalg.eigvals(np.asarray(model.A)))
    poles = np.linalg.eigvals([[-1.2 / 0.05, -0.3 / 0.05], [0.3 / 0.02, 0]])
    np.testing.assert_allclose(found, np.sort_complex(np.r_[poles, 0]), atol=1e-8)
