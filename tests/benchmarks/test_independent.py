"""Mechanisms with values computed by other means: closed forms, one-coordinate equations, hand calculations.

The models, the values and how they were obtained are in ``independent.json``.
"""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from linkages import four_bar, n_four_bar, pendulum, slider_crank
from scipy.optimize import brentq

import mbdcasadi as mbd

CASES = json.loads((Path(__file__).parent / "independent.json").read_text())


def reference(name):
    """Values of a case as arrays."""
    return {key: np.asarray(value) for key, value in CASES[name]["reference"].items()}


def grid_with(times, step):
    """A grid from 0 that holds the times, with no step longer than asked; and where the times are in it."""
    marks = np.unique(np.r_[0.0, times])
    pieces = [np.linspace(a, b, int(np.ceil((b - a) / step)), endpoint=False) for a, b in pairwise(marks)]
    grid = np.concatenate([*pieces, marks[-1:]])
    return grid, [int(np.argmin(np.abs(grid - x))) for x in times]


def close(found, wanted, atol):
    """Compare; a message for each quantity."""
    np.testing.assert_allclose(found, wanted, rtol=0, atol=atol)


def close_angle(found, wanted, atol):
    """Compare angles but for whole turns."""
    difference = np.asarray(found) - wanted
    close(np.arctan2(np.sin(difference), np.cos(difference)), np.zeros_like(wanted), atol)


def close_to_max(found, wanted, rtol):
    """Compare relative to the largest value of the quantity."""
    close(found, wanted, rtol * np.max(np.abs(wanted)))


# --- pendulums -------------------------------------------------------------------------------------------
def test_compound_pendulum():
    """Released from 170 degrees: motion, pin force and period in elliptic functions."""
    r = reference("compound pendulum")
    start = np.radians(170) - np.pi / 2
    p = pendulum(start, mass=2.0)
    settings = {"initial": [p.rod.phi == start, p.rod.omega == 0], "reltol": 1e-11, "abstol": 1e-11}
    motion = mbd.simulate(p.mechanism, np.r_[0, r["t"]], **settings)
    close(motion[p.rod.phi][1:] + np.pi / 2, r["theta"], 1e-6)
    close(motion[p.rod.omega][1:], r["omega"], 1e-6)
    close(motion[p.pin.reaction_on(p.rod).force][1:], r["pin_force_on_rod"], 1e-4)
    back = mbd.Event("turns back", p.rod.omega, direction=1, terminal=True)
    half = mbd.simulate(p.mechanism, np.linspace(0, 3, 301), events=[back], **settings)
    assert 2 * half.t[-1] == pytest.approx(float(r["period"]), rel=1e-8)


def test_double_pendulum():
    """Large motion over 2 s: angles, rates, both pins."""
    r = reference("double pendulum")
    lean = np.pi / 3
    b1 = mbd.Body("b1", mass=1.5, inertia=1.5 * 0.8**2 / 12, pose=(0.4, 0, 0))
    b2 = mbd.Body("b2", mass=1.0, inertia=0.5**2 / 12, pose=(0.8 + 0.25 * np.cos(lean), 0.25 * np.sin(lean), lean))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), b1.at(-0.4, 0))
    elbow = mbd.Revolute("elbow", b1.at(0.4, 0), b2.at(-0.25, 0))
    mechanism = mbd.Mechanism(bodies=[b1, b2], joints=[pin, elbow], forces=[mbd.Gravity()])
    motion = mbd.simulate(mechanism, np.r_[0, r["t"]], reltol=1e-10, abstol=1e-10)
    close(np.c_[motion[b1.phi], motion[b2.phi]][1:], r["phi"], 1e-5)
    close(np.c_[motion[b1.omega], motion[b2.omega]][1:], r["omega"], 1e-4)
    close(motion[pin.reaction_on(b1).force][1:], r["ground_pin_on_b1"], 1e-3)
    close(motion[elbow.reaction_on(b2).force][1:], r["elbow_on_b2"], 1e-3)


# --- slider-cranks ---------------------------------------------------------------------------------------
def test_slider_crank_kinematics():
    """At 100 rad/s: slider and rod, their rates and accelerations."""
    r = reference("slider-crank kinematics")
    start = np.radians(20)
    f = slider_crank(start, 0.05, 0.18, drivers=lambda f: [mbd.Driver("drive", f.A.angle, start + 100 * mbd.t)])
    grid, pick = grid_with(r["t"], 0.001)
    run = mbd.kinematics(f.mechanism, grid)
    for name, expression, tolerance in (
        ("x", f.slider.x, 1e-10), ("xdot", f.slider.vx, 1e-8), ("xddot", f.slider.ax, 1e-5),
        ("beta", f.rod.phi, 1e-10), ("betadot", f.rod.omega, 1e-8), ("betaddot", f.rod.alpha, 1e-5),
    ):  # fmt: skip
        close(run[expression][pick], r[name], tolerance)


def test_slider_crank_inverse_dynamics():
    """Torque and every joint force against free-body diagrams."""
    r = reference("slider-crank inverse dynamics")
    start = np.radians(20)
    f = slider_crank(
        start, 0.05, 0.18, crank=(1.2, 8e-4, 0.01), rod=(0.6, 2.5e-3, 0.06), slider=0.8, forces=[mbd.Gravity()],
        drivers=lambda f: [mbd.Driver("drive", f.A.angle, start + 100 * mbd.t)],
    )  # fmt: skip
    grid, pick = grid_with(r["t"], 0.001)
    run = mbd.inverse_dynamics(f.mechanism, grid)
    guide = f.guide.reaction_on(f.slider)
    close_to_max(run[f.drivers[0].effort][pick], r["torque"], 1e-8)
    close_to_max(run[f.A.reaction_on(f.crank).force][pick], r["A_on_crank"], 1e-8)
    close_to_max(run[f.B.reaction_on(f.rod).force][pick], r["B_on_rod"], 1e-8)
    close_to_max(run[f.C.reaction_on(f.slider).force][pick], r["C_on_slider"], 1e-8)
    close_to_max(run[guide.force][pick, 1], r["guide_side_force_on_slider"], 1e-8)
    close(run[guide.torque], np.zeros(grid.size), 1e-8 * np.abs(r["torque"]).max())


def test_slider_crank_under_torque():
    """Speeds up from rest for 2 s and some eleven turns."""
    r = reference("slider-crank under torque")
    start = np.radians(30)
    f = slider_crank(start, forces=lambda f: [mbd.Gravity(), mbd.Torque("motor", f.crank, 2.0)])
    motion = mbd.simulate(
        f.mechanism, np.r_[0, r["t"]], initial=[f.A.angle == start, f.crank.omega == 0], reltol=1e-11, abstol=1e-11
    )
    close(motion[f.A.angle][1:], r["theta"], 1e-6)
    close(motion[f.crank.omega][1:], r["theta_dot"], 1e-4)
    close(motion[f.slider.x][1:], r["x"], 1e-7)
    close(motion[f.slider.vx][1:], r["xdot"], 1e-4)
    close_to_max(motion[f.A.reaction_on(f.crank).force][1:], r["A_on_crank"], 1e-5)
    close_to_max(motion[f.guide.reaction_on(f.slider).force][1:, 1], r["side_force"], 1e-5)


# --- four-bars --------------------------------------------------------------------------------------------
def test_crank_rocker():
    """Angles, rates, accelerations and a coupler point against the loop closure."""
    r = reference("crank-rocker kinematics")
    f = four_bar(0.5, drivers=lambda f: [mbd.Driver("drive", f.A.angle, 0.5 + 6 * mbd.t)])
    grid, pick = grid_with(r["t"], 0.01)
    run = mbd.kinematics(f.mechanism, grid)
    point = f.coupler.at(0.0, 0.15)
    close_angle(run[f.coupler.phi][pick], r["theta3"], 1e-10)
    close_angle(run[f.rocker.phi][pick], r["theta4"], 1e-10)
    close(run[f.coupler.omega][pick], r["w3"], 1e-9)
    close(run[f.rocker.omega][pick], r["w4"], 1e-9)
    close(run[f.coupler.alpha][pick], r["a3"], 1e-7)
    close(run[f.rocker.alpha][pick], r["a4"], 1e-7)
    close(run[point.position][pick], r["P"], 1e-10)
    close(run[point.velocity][pick], r["vP"], 1e-9)
    close(run[point.acceleration][pick], r["aP"], 1e-7)


def test_falling_four_bar():
    """Under gravity and a torque; the forces of two pins."""
    r = reference("falling four-bar")
    f = four_bar(
        0.5, centres=[(0.1, 0.0), (0.25, 0.05), (0.2, 0.0)],
        forces=lambda f: [mbd.Gravity(), mbd.Torque("motor", f.crank, 1.5)],
    )  # fmt: skip
    motion = mbd.simulate(
        f.mechanism, np.r_[0, r["t"]], initial=[f.A.angle == 0.5, f.crank.omega == 2], reltol=1e-11, abstol=1e-11
    )
    close(motion[f.A.angle][1:], r["theta2"], 1e-6)
    close(motion[f.crank.omega][1:], r["w2"], 1e-4)
    close_angle(motion[f.rocker.phi][1:], r["theta4"], 1e-6)
    close_to_max(motion[f.A.reaction_on(f.crank).force][1:], r["A_on_crank"], 1e-5)
    close_to_max(motion[f.C.reaction_on(f.coupler).force][1:], r["C_on_coupler"], 1e-5)


@pytest.mark.slow
def test_two_loops():
    """IFToMM A02 with two loops: angle, position, time of one turn, energy."""
    r = reference("two loops")
    f = n_four_bar(2)
    settings = {"initial": [f.first.phi == np.pi / 2, f.first.omega == -1], "reltol": 1e-10, "abstol": 1e-10}
    motion = mbd.simulate(f.mechanism, np.linspace(0, 10, 1001), **settings)
    pick = np.round(100 * r["t"]).astype(int)
    close(motion[f.first.phi][pick], r["angle"], 1e-3)
    close(motion[f.first.at(0.5, 0).position][pick], r["B0"], 1e-3)
    turn = mbd.Event("turned", f.first.phi + 1.5 * np.pi, direction=-1, terminal=True)
    once = mbd.simulate(f.mechanism, np.linspace(0, 3, 301), events=[turn], **settings)
    close(once.t[-1], r["T_rev"], 1e-4)
    energy = motion.energy.total
    close(energy[0], r["E0"], 1e-3)
    close(energy, np.full(energy.size, energy[0]), 1e-3)


def test_toggle():
    """A four-bar driven into its toggle: the time and the angle, and nothing behind them."""
    r = reference("toggle")
    f = four_bar(
        0.2, (0.4, 0.5, 0.45, 1.0), (1, 1, 1), (0.01, 0.02, 0.02),
        drivers=lambda f: [mbd.Driver("crank drive", f.A.angle, 0.2 + 0.5 * mbd.t)],
    )  # fmt: skip
    with pytest.raises(mbd.SingularityError, match=r"singular.*crank drive") as caught:
        mbd.kinematics(f.mechanism, np.linspace(0, 5, 201))
    partial = caught.value.partial
    assert caught.value.time == pytest.approx(float(r["t_lock"]), abs=1e-6)
    assert 0.2 + 0.5 * caught.value.time == pytest.approx(float(r["theta_lock"]), abs=1e-6)
    assert partial.t[-1] <= caught.value.time and partial.t[-1] > caught.value.time - 5 / 200
    assert partial.drift.position < 1e-12


# --- springs and dampers --------------------------------------------------------------------------------------
def test_spring_damper_actuator():
    """A slider on a spring–damper with a constant actuator, in closed form."""
    r = reference("spring damper actuator")
    block = mbd.Body("block", mass=2.0, inertia=0.01, pose=(0.7, 0, 0))
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    spring = mbd.TSDA(
        "spring", mbd.ground.at(0, 0), block.at(0, 0), stiffness=200, free_length=0.5, damping=4, actuator=15
    )
    mechanism = mbd.Mechanism(bodies=[block], joints=[guide], forces=[spring])
    start = [block.x == 0.7, block.vx == -0.3]
    motion = mbd.simulate(mechanism, np.r_[0, r["t"]], initial=start, reltol=1e-11, abstol=1e-11)
    close(motion[block.x][1:], r["x"], 1e-7)
    close(motion[block.vx][1:], r["xdot"], 1e-6)
    close(motion[spring.force][1:], r["tension"], 1e-4)


def test_elastic_pendulum():
    """A free body on a spring that holds it off its centre, with an actuator in time."""
    r = reference("elastic pendulum")
    bob = mbd.Body("bob", mass=1.2, inertia=0.01, pose=(0.5, -0.6, 0.3))
    spring = mbd.TSDA(
        "spring", mbd.ground.at(0, 0), bob.at(0, 0.1), stiffness=80, free_length=0.6, damping=1.5,
        actuator=2 * mbd.sin(3 * mbd.t),
    )  # fmt: skip
    mechanism = mbd.Mechanism(bodies=[bob], forces=[mbd.Gravity(), spring])
    motion = mbd.simulate(mechanism, np.r_[0, r["t"]], reltol=1e-10, abstol=1e-10)
    close(motion[bob.q][1:], r["q"], 1e-5)


def test_driven_base():
    """A block on a spring whose other end is driven: motion, and the force that the driver takes."""
    r = reference("driven base")
    carriage = mbd.Body("carriage", mass=5.0, inertia=0.01, velocity=(0.14, 0, 0))
    block = mbd.Body("block", mass=1.0, inertia=0.01, pose=(0.4, 0, 0))
    rails = [mbd.Translational(f"rail {b.name}", mbd.ground.at(0, 0), b.at(0, 0)) for b in (carriage, block)]
    spring = mbd.TSDA("spring", carriage.at(0, 0), block.at(0, 0), stiffness=100, free_length=0.4)
    shaker = mbd.Driver("shaker", carriage.x, 0.02 * mbd.sin(7 * mbd.t))
    mechanism = mbd.Mechanism(bodies=[carriage, block], joints=rails, drivers=[shaker], forces=[spring])
    start = [block.x == 0.4, block.vx == 0]
    motion = mbd.simulate(mechanism, np.r_[0, r["t"]], initial=start, reltol=1e-11, abstol=1e-11)
    close(motion[block.x][1:], r["x"], 1e-7)
    close(motion[shaker.effort][1:], r["driver_force"], 1e-4)
    close(motion.initial[carriage.vx], 0.14, 1e-14)


# --- machine elements -------------------------------------------------------------------------------------------
def quick_return(theta, law=None):
    """Crank with a die block that slides in an oscillating arm."""
    tip = 0.1 * np.array([np.cos(theta), np.sin(theta)])
    psi = np.arctan2(tip[1] + 0.25, tip[0])
    crank = mbd.Body("crank", mass=1.0, inertia=0.01, pose=(0, 0, theta))
    block = mbd.Body("die block", mass=1.0, inertia=0.01, pose=(*tip, psi))
    arm = mbd.Body("arm", mass=1.0, inertia=0.01, pose=(0, -0.25, psi))
    main = mbd.Revolute("main", mbd.ground.at(0, 0), crank.at(0, 0))
    slide = mbd.Translational("slide", arm.at(0, 0), block.at(0, 0))
    die_pin = mbd.Revolute("die pin", crank.at(0.1, 0), block.at(0, 0))
    pivot = mbd.Revolute("arm pivot", mbd.ground.at(0, -0.25), arm.at(0, 0))
    drivers = [] if law is None else [mbd.Driver("drive", main.angle, law)]
    mechanism = mbd.Mechanism(bodies=[crank, block, arm], joints=[main, slide, die_pin, pivot], drivers=drivers)
    return crank, arm, main, slide, mechanism


@pytest.mark.slow
def test_quick_return():
    """Arm and die block in closed form, and the ratio of the strokes."""
    r = reference("quick return")
    _, arm, _, slide, mechanism = quick_return(0.3, 0.3 + 5 * mbd.t)
    grid, pick = grid_with(r["t"], 0.01)
    run = mbd.kinematics(mechanism, grid)
    close(run[arm.phi][pick], r["psi"], 1e-10)
    close(run[arm.omega][pick], r["psidot"], 1e-8)
    close(run[arm.alpha][pick], r["psiddot"], 1e-7)
    close(run[slide.displacement][pick], r["s"], 1e-10)
    close(run[slide.speed][pick], r["sdot"], 1e-8)

    def arm_rate(theta):
        crank, arm, main, _, free = quick_return(theta)
        return mbd.assemble(free, [main.angle == theta, crank.omega == 1.0])[arm.omega]

    right, left = brentq(arm_rate, -1.4, 0.5, xtol=1e-6), brentq(arm_rate, 2.6, 4.5, xtol=1e-6)
    close((left - right) / (2 * np.pi - left + right), r["time_ratio"], 1e-5)


def test_scotch_yoke():
    """Inverse dynamics in closed form: slot force and crank torque."""
    r = reference("scotch yoke")
    crank = mbd.Body("crank", mass=1.0, inertia=0.02, pose=(0, 0, 1.0))
    yoke = mbd.Body("yoke", mass=2.5, inertia=0.01, pose=(0.12 * np.cos(1.0), 0, 0))
    main = mbd.Revolute("main", mbd.ground.at(0, 0), crank.at(0, 0))
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), yoke.at(0, 0))
    slot = mbd.PointOnLine("slot", yoke.at(0, 0, angle=np.pi / 2), crank.at(0.12, 0))
    drive = mbd.Driver("drive", main.angle, 1 + 8 * mbd.t)
    mechanism = mbd.Mechanism(bodies=[crank, yoke], joints=[main, guide, slot], drivers=[drive])
    grid, pick = grid_with(r["t"], 0.01)
    run = mbd.inverse_dynamics(mechanism, grid)
    close_to_max(run[yoke.x][pick], r["x"], 1e-8)
    close_to_max(run[yoke.vx][pick], r["xdot"], 1e-8)
    close_to_max(run[yoke.ax][pick], r["xddot"], 1e-8)
    close_to_max(run[slot.reaction_on(yoke).force][pick, 0], r["slot_force"], 1e-8)
    close_to_max(run[drive.effort][pick], r["torque"], 1e-8)


def test_rack_and_pinion():
    """A pinion drives a rack against a spring: the rack and the force at the teeth."""
    r = reference("rack and pinion")
    rack = mbd.Body("rack", mass=2.0, inertia=0.01)
    pinion = mbd.Body("pinion", mass=1.0, inertia=0.01, pose=(0, 0.06, 0))
    mesh = mbd.RackAndPinion("mesh", rack.at(0, 0), pinion.at(0, 0), radius=0.06)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), rack.at(0, 0))
    hub = mbd.Revolute("hub", mbd.ground.at(0, 0.06), pinion.at(0, 0))
    spring = mbd.TSDA("spring", mbd.ground.at(-10, 0), rack.at(0, 0), stiffness=50, free_length=10)
    motor = mbd.Torque("motor", pinion, 0.5)
    mechanism = mbd.Mechanism(bodies=[rack, pinion], joints=[guide, hub, mesh], forces=[spring, motor])
    start = [rack.x == 0, rack.vx == 0]
    motion = mbd.simulate(mechanism, np.r_[0, r["t"]], initial=start, reltol=1e-11, abstol=1e-11)
    close(motion[rack.x][1:], r["x"], 1e-7)
    close(motion[mesh.reaction_on(rack).force][1:, 0], r["tooth_force"], 1e-4)
    close(motion[mesh.tooth_force][1:], r["tooth_force"], 1e-4)


# --- models that must be refused ---------------------------------------------------------------------------------
TIMES = np.linspace(0, 1, 11)


def rod(name="rod", pose=(0.5, 0.0, 0.0), **more):
    """A rod of 1 m and 1 kg."""
    return mbd.Body(name, **({"mass": 1.0, "inertia": 1 / 12, "pose": pose} | more))


def test_refuses_an_unassemblable_linkage():
    """The pins that stay open are named; the gaps sum to the 0.8 m that are missing."""
    crank, coupler, rocker = bars = [
        rod(name, pose=(x, 0.1, 0.1), inertia=length**2 / 12)
        for name, x, length in (("crank", 0.15, 0.3), ("coupler", 0.6, 0.5), ("rocker", 1.8, 0.4))
    ]
    joints = [
        mbd.Revolute("pin A", mbd.ground.at(0, 0), crank.at(-0.15, 0)),
        mbd.Revolute("pin B", crank.at(0.15, 0), coupler.at(-0.25, 0)),
        mbd.Revolute("pin C", coupler.at(0.25, 0), rocker.at(0.2, 0)),
        mbd.Revolute("pin D", mbd.ground.at(2, 0), rocker.at(-0.2, 0)),
    ]
    with pytest.raises(mbd.AssemblyError, match="(?s)assemble.*pin [ABCD]") as caught:
        mbd.assemble(mbd.Mechanism(bodies=bars, joints=joints))
    residuals = caught.value.residuals
    assert set(residuals) <= {"pin A", "pin B", "pin C", "pin D"}
    assert sum(abs(value) for value in residuals.values()) == pytest.approx(0.8, rel=0.3)


def test_refuses_a_massless_free_body():
    """Named, before anything is integrated."""
    ghost = mbd.Body("ghost", mass=0.0, inertia=0.0)
    with pytest.raises(mbd.MechanismError, match="'ghost'.*mass"):
        mbd.simulate(mbd.Mechanism(bodies=[ghost], forces=[mbd.Gravity()]), TIMES)


def test_refuses_an_inconsistent_velocity():
    """A demand that the pin cannot meet is refused, and named."""
    p = pendulum()
    start = [p.rod.phi == 0, p.rod.vx == 1.0, p.rod.vy == 0.0, p.rod.omega == 0.0]
    with pytest.raises(mbd.ConditionError, match=r"rod\.vx"):
        mbd.simulate(p.mechanism, TIMES, initial=start)


def test_refuses_two_bodies_of_one_name():
    """Said with the name."""
    with pytest.raises(mbd.ModelError, match="'rod'.*twice"):
        mbd.Mechanism(bodies=[rod(), rod()])


def test_refuses_a_stiffness_that_is_no_number():
    """The spring, the quantity and the value."""
    body = rod()
    with pytest.raises(mbd.ModelError, match="'coil'.*stiffness.*nan"):
        mbd.TSDA("coil", mbd.ground.at(0, 1), body.at(0, 0), stiffness=float("nan"), free_length=0.5)


def test_refuses_an_unknown_body():
    """The joint and the body that is not in the mechanism."""
    known, unknown = rod(), rod("rodd", pose=(1.5, 0, 0))
    elbow = mbd.Revolute("elbow", known.at(0.5, 0), unknown.at(-0.5, 0))
    with pytest.raises(mbd.ModelError, match="'elbow'.*'rodd'"):
        mbd.Mechanism(bodies=[known], joints=[elbow])


def test_refuses_times_that_run_backwards():
    """Both times are named."""
    with pytest.raises(mbd.SimulationError, match=r"1\.0.*0\.5"):
        mbd.simulate(pendulum().mechanism, np.array([1.0, 0.5]))
