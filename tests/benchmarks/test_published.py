"""Benchmarks with published data: the IVP test set, IFToMM's library, papers and a textbook's machines."""

from __future__ import annotations

import numpy as np
import pytest
from linkages import G, n_four_bar, pose_on
from scipy.integrate import quad
from scipy.optimize import fsolve

import mbdcasadi as mbd

# --- Andrews' squeezer (Schiehlen 1990; Hairer and Wanner II, ch. VII; IVP Test Set "andrews") ----------------
MASSES = (0.04325, 0.00365, 0.02373, 0.00706, 0.0705, 0.00706, 0.05498)
INERTIAS = (2.194e-6, 4.41e-7, 5.255e-6, 5.667e-7, 1.169e-5, 5.667e-7, 1.912e-5)
#: beta, Theta, gamma, Phi, delta, Omega, epsilon at the start
ANGLES = (-0.0617138900142764496, 0, 0.455279819163070380, 0.222668390165885885, 0.487364979543842550,
          -0.222668390165885885, 1.23054744454982120)  # fmt: skip
#: the seven angles and rates at t = 0.03 s
FINAL_ANGLES = (15.81077119629904, -15.75637105984298, 0.04082224013073101, -0.5347301163226948, 0.5244099658805303,
                0.5347301163226948, 1.048080741042263)  # fmt: skip
FINAL_RATES = (1139.920302151208, -1424.379294994111, 11.03291221937134, 19.29337464421385, 0.5735699284790808,
               -19.29337464421385, 0.3231791658026955)  # fmt: skip
#: on the way, from a program of absolute coordinates with DOP853 at 1e-12
ANGLES_ON_THE_WAY = (
    (2.160113131531413, -1.8833642311069576, 0.15851675800117082, -0.32864107517474256, 0.5251547747977119,
     0.3286410751747544, 1.068427204632441),
    (8.18490588966149, -7.890505363730246, 0.20953691338462618, -0.2383255965959134, 0.5225369171560006,
     0.23832559659592856, 1.0862751085998432),
)  # fmt: skip


class Squeezer:
    """Seven bodies, ten pins, a spring and a constant torque; no gravity."""

    def __init__(self):
        beta, theta, gamma, phi, delta, omega, epsilon = ANGLES
        turns = np.array([beta, theta + beta, gamma, phi + delta, delta, omega + epsilon, epsilon])
        self.bodies = [
            mbd.Body(f"K{n + 1}", mass=m, inertia=j, pose=(*place, turn))
            for n, (m, j, place, turn) in enumerate(zip(MASSES, INERTIAS, self._places(turns), turns, strict=True))
        ]
        k1, k2, k3, k4, k5, k6, k7 = self.bodies
        ground = mbd.ground
        self.bearing = mbd.Revolute("O", k1.at(-0.00092, 0), ground.at(0, 0))
        joints = [
            self.bearing,
            mbd.Revolute("K1K2", k2.at(0.0115, 0), k1.at(0.00608, 0)),
            mbd.Revolute("B", k3.at(-0.01043, 0.01874), ground.at(-0.03635, 0.03273)),
            mbd.Revolute("P23", k3.at(-0.01043, -0.01626), k2.at(-0.0165, 0)),
            mbd.Revolute("A5", k5.at(-0.02308, -0.00916), ground.at(-0.06934, -0.00227)),
            mbd.Revolute("K4K5", k4.at(0, 0.00579), k5.at(0.01692, -0.00916)),
            mbd.Revolute("P24", k4.at(0, -0.01421), k2.at(-0.0165, 0)),
            mbd.Revolute("A7", k7.at(0.00449, 0.01228), ground.at(-0.06934, -0.00227)),
            mbd.Revolute("K6K7", k6.at(-0.00579, 0), k7.at(0.00449, -0.02772)),
            mbd.Revolute("P26", k6.at(0.01421, 0), k2.at(-0.0165, 0)),
        ]
        spring = mbd.TSDA(
            "spring", k3.at(0.00957, 0.00074), ground.at(0.014, 0.072), stiffness=4530.0, free_length=0.07785
        )
        self.mechanism = mbd.Mechanism(
            bodies=self.bodies, joints=joints, forces=[spring, mbd.Torque("motor", k1, 0.033)]
        )
        self.start = [k1.phi == beta, k1.omega == 0]

    @staticmethod
    def _places(turns):
        """Centres of mass for the angles of the bodies: from pin to pin, starting at the ground."""

        def turned(k, x, y):
            c, s = np.cos(turns[k]), np.sin(turns[k])
            return np.array([c * x - s * y, s * x + c * y])

        first = -turned(0, -0.00092, 0)
        second = first + turned(0, 0.00608, 0) - turned(1, 0.0115, 0)
        knot = second + turned(1, -0.0165, 0)
        third = np.array([-0.03635, 0.03273]) - turned(2, -0.01043, 0.01874)
        fifth = np.array([-0.06934, -0.00227]) - turned(4, -0.02308, -0.00916)
        seventh = np.array([-0.06934, -0.00227]) - turned(6, 0.00449, 0.01228)
        return first, second, third, knot - turned(3, 0, -0.01421), fifth, knot - turned(5, 0.01421, 0), seventh

    def seven(self, motion, quantity):
        """The textbook's seven relative angles, or their rates (n_t, 7)."""
        f = [motion[getattr(body, quantity)] for body in self.bodies]
        return np.column_stack([f[0], f[1] - f[0], f[2], f[3] - f[4], f[4], f[5] - f[6], f[6]])


def test_squeezer_initial_accelerations():
    """beta'' and Theta'' at the start, to all digits of the test set."""
    s = Squeezer()
    state = mbd.assemble(s.mechanism, s.start)
    assert state[s.bodies[0].alpha] == pytest.approx(14222.4439199541, rel=1e-9)
    assert state[s.bodies[1].alpha - s.bodies[0].alpha] == pytest.approx(-10666.8329399656, rel=1e-9)


def test_squeezer_starts_where_it_should():
    """Assembly does not move the pose that the test set gives."""
    s = Squeezer()
    state = mbd.assemble(s.mechanism, s.start)
    estimate = np.concatenate([b.pose_estimate for b in s.bodies])
    np.testing.assert_allclose(state.q, estimate, atol=1e-14)


@pytest.mark.parametrize("method", ["idas", "erk"])
def test_squeezer_end(method):
    """The published end state to 1e-6 rad, though the motion magnifies errors a thousandfold; the pin's load."""
    s = Squeezer()
    motion = mbd.simulate(
        s.mechanism, [0, 0.01, 0.02, 0.03], initial=s.start, reltol=1e-11, abstol=1e-11, method=method
    )
    np.testing.assert_allclose(s.seven(motion, "phi")[-1], FINAL_ANGLES, atol=1e-6)
    np.testing.assert_allclose(s.seven(motion, "omega")[-1], FINAL_RATES, rtol=1e-5)
    np.testing.assert_allclose(s.seven(motion, "phi")[1:-1], ANGLES_ON_THE_WAY, atol=1e-6)
    load = motion[s.bearing.reaction_on(s.bodies[0]).force][-1]
    np.testing.assert_allclose(load, [332.6285, 22.6731], atol=2e-3)
    assert motion.drift.position <= 1e-14 and motion.drift.velocity <= 1e-11


def test_squeezer_at_usual_tolerance():
    """At 1e-8 the end state is still good to 1e-4 rad."""
    s = Squeezer()
    motion = mbd.simulate(s.mechanism, [0, 0.03], initial=s.start)
    np.testing.assert_allclose(s.seven(motion, "phi")[-1], FINAL_ANGLES, atol=1e-4)


# --- IFToMM A01: simple pendulum ---------------------------------------------------------------------------------
#: a point of 1 kg on 1 m, released from the left: t, x, y
A01 = ((1, 0.986291751, -0.165010853), (2, -0.793566195, -0.608483930), (5, -0.942305435, -0.334754338),
       (10, -0.275087463, -0.961419205))  # fmt: skip


def point_pendulum():
    """A point mass, without any inertia of rotation, on a massless rod."""
    bob = mbd.Body("bob", mass=1.0, inertia=0.0, pose=(-1.0, 0.0, np.pi))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), bob.at(-1, 0))
    return bob, pin, mbd.Mechanism(bodies=[bob], joints=[pin], forces=[mbd.Gravity()])


def test_simple_pendulum_positions():
    """Table of positions over 10 s, all digits."""
    bob, _, mechanism = point_pendulum()
    motion = mbd.simulate(mechanism, [0, *(row[0] for row in A01)], reltol=1e-11, abstol=1e-11)
    np.testing.assert_allclose(motion[bob.position][1:], [row[1:] for row in A01], atol=2e-8)
    assert np.abs(motion.energy.total).max() < 1e-8


def test_simple_pendulum_within_the_benchmark():
    """At default tolerances the energy error is far below the benchmark's 5e-5 J, and the period is right."""
    bob, _, mechanism = point_pendulum()
    again = mbd.Event("back", bob.vy, direction=-1)
    motion = mbd.simulate(mechanism, np.linspace(0, 10, 501), events=[again])
    assert np.abs(motion.energy.total).max() < 1e-6
    quarter = quad(lambda x: 1 / np.sqrt(1 - 0.5 * np.sin(x) ** 2), 0, np.pi / 2)[0]
    period = 4 * np.sqrt(1 / G) * quarter
    assert period == pytest.approx(2.367841947576, abs=1e-11)
    tops = [event.t for event in motion.events]
    assert np.diff(tops) == pytest.approx(period / 2, abs=1e-6)


def test_simple_pendulum_tension():
    """At the bottom the rod bears three times the weight."""
    bob, pin, mechanism = point_pendulum()
    bottom = mbd.Event("bottom", bob.x, direction=1, terminal=True)
    motion = mbd.simulate(mechanism, np.linspace(0, 2, 101), events=[bottom], reltol=1e-10, abstol=1e-10)
    np.testing.assert_allclose(motion.final[pin.reaction_on(bob).force], [0, 3 * G], atol=1e-7)
    np.testing.assert_allclose(motion.final[pin.reaction_on(mbd.ground).force], [0, -3 * G], atol=1e-7)


# --- IFToMM A02: N-four-bar, singular whenever it is flat -----------------------------------------------------------
#: loops, t, position of B0
A02 = {
    1: ((1, -0.260712675, -0.965416439),),
    2: ((1, -0.195020302, -0.980799206), (5, -0.811310461, -0.584615545), (10, 0.328458112, 0.944518538)),
    40: ((1, -0.115356881, -0.993324111), (10, 0.180512227, 0.983572741), (20, 0.410901154, 0.911679901)),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("loops", "reltol", "tolerance"),
    [
        (1, 1e-10, 1e-5),
        (2, 1e-8, 1e-3),
        (2, 1e-10, 1e-4),
        (40, 1e-8, 1e-3),
    ],
)
def test_n_four_bar(loops, reltol, tolerance):
    """The parallelogram branch through all flat poses, well inside the benchmark's high precision (1e-3)."""
    f = n_four_bar(loops)
    wanted = np.array(A02[loops])
    end = int(wanted[-1, 0])
    start = [f.first.phi == np.pi / 2, f.first.omega == -1]
    # with 81 bodies the eliminated form has a full Jacobian, which the implicit integrators would have to factorise
    method = "erk" if loops > 10 else "idas"
    settings = {"initial": start, "reltol": reltol, "abstol": reltol, "method": method}
    motion = mbd.simulate(f.mechanism, np.linspace(0, end, 50 * end + 1), **settings)
    found = motion[f.first.at(0.5, 0).position][(50 * wanted[:, 0]).astype(int)]
    np.testing.assert_allclose(found, wanted[:, 1:], atol=tolerance)
    energy = motion.energy.total
    assert np.abs(energy - energy[0]).max() < tolerance * max(1, loops / 4)
    sides = motion[f.cranks[-1].phi] - motion[f.first.phi]
    assert np.abs(sides).max() < 1e-8
    assert motion.drift.position < 1e-10


# --- Bayo and Avello 1994: the slider-crank of two equal rods, singular upright -------------------------------------
#: t, x of the slider on the regular branch
UPRIGHT = ((0.5, -0.367349163), (1.0, -1.951288388), (2.0, 0.554605256), (5.0, 1.445320499))


def equal_slider_crank():
    """Two rods of 1 m and 1 kg at 45 degrees; the slider has no mass."""
    half = np.pi / 4
    first = mbd.Body("first", mass=1.0, inertia=1 / 12, pose=(0.5 * np.cos(half), 0.5 * np.sin(half), half))
    second = mbd.Body("second", mass=1.0, inertia=1 / 12, pose=(1.5 * np.cos(half), 0.5 * np.sin(half), -half))
    slider = mbd.Body("slider", mass=0.0, inertia=0.0, pose=(2 * np.cos(half), 0, 0))
    joints = [
        mbd.Revolute("base", mbd.ground.at(0, 0), first.at(-0.5, 0)),
        mbd.Revolute("elbow", first.at(0.5, 0), second.at(-0.5, 0)),
        mbd.Revolute("wrist", second.at(0.5, 0), slider.at(0, 0)),
        mbd.Translational("guide", mbd.ground.at(0, 0), slider.at(0, 0)),
    ]
    mechanism = mbd.Mechanism(bodies=[first, second, slider], joints=joints, forces=[mbd.Gravity()])
    return first, second, slider, mechanism


@pytest.mark.slow
def test_singular_slider_crank():
    """Through the upright pose, where crank and slider could also part; the branch stays the regular one."""
    first, second, slider, mechanism = equal_slider_crank()
    motion = mbd.simulate(
        mechanism, np.linspace(0, 5, 501), initial=[first.phi == np.pi / 4, slider.vx == -4], reltol=1e-10, abstol=1e-10
    )
    wanted = np.array(UPRIGHT)
    np.testing.assert_allclose(motion[slider.x][(100 * wanted[:, 0]).astype(int)], wanted[:, 1], atol=1e-4)
    np.testing.assert_allclose(motion[slider.x], 2 * np.cos(motion[first.phi]), atol=1e-9)
    np.testing.assert_allclose(motion[second.phi], -motion[first.phi], atol=1e-9)
    energy = motion.energy.total
    assert np.abs(energy - energy[0]).max() < 1e-4 * motion.energy.kinetic.max()


@pytest.mark.slow
@pytest.mark.parametrize("method", ["idas", "erk", "rosenbrock"])
@pytest.mark.parametrize("count", [51, 501])
def test_singular_slider_crank_at_default_tolerances(method, count):
    """By every method, with fine and coarse outputs: the branch is the regular one in all six upright poses."""
    first, second, _, mechanism = equal_slider_crank()
    slider = mechanism.bodies[2]
    start = [first.phi == np.pi / 4, slider.vx == -4]
    motion = mbd.simulate(mechanism, np.linspace(0, 5, count), initial=start, method=method)
    np.testing.assert_allclose(motion[second.phi], -motion[first.phi], atol=1e-9)
    energy = motion.energy.total
    assert np.abs(energy - energy[0]).max() < 1e-5 * motion.energy.kinetic.max()
    assert "passes 6 singular poses" in motion.statistics.notes[0]


# --- machines of the course ME451 (University of Wisconsin), references by DOP853 in one coordinate -------------------
def test_course_slider_crank():
    """sliderCrankDYN: crank 4 m, rod 6 m, released horizontally."""
    crank = mbd.Body("crank", mass=2.0, inertia=0.3, pose=(2, 0, 0))
    rod = mbd.Body("rod", mass=3.0, inertia=0.2, pose=(7, 0, 0))
    slider = mbd.Body("slider", mass=5.0, inertia=0.1, pose=(10, 0, 0))
    main = mbd.Revolute("main", mbd.ground.at(0, 0), crank.at(-2, 0))
    joints = [
        main,
        mbd.Revolute("pin", crank.at(2, 0), rod.at(-3, 0)),
        mbd.Revolute("wrist", rod.at(3, 0), slider.at(0, 0)),
        mbd.Translational("guide", mbd.ground.at(0, 0), slider.at(0, 0)),
    ]
    mechanism = mbd.Mechanism(bodies=[crank, rod, slider], joints=joints, forces=[mbd.Gravity()])
    motion = mbd.simulate(mechanism, [0, 0.5, 1, 2, 4], reltol=1e-11, abstol=1e-11)
    start = motion.initial
    assert start[crank.alpha] == pytest.approx(-4.8114441417, abs=1e-9)
    assert start[crank.alpha] == pytest.approx(-98.1 / (4 * 2 + 0.3 + 3 * 2**2 + 0.2 * (2 / 3) ** 2), rel=1e-12)
    assert start[rod.alpha] == pytest.approx(3.2076294278, abs=1e-9)
    np.testing.assert_allclose(start[main.reaction_on(crank).force], [0, 0.547970], atol=1e-6)
    np.testing.assert_allclose(
        motion[crank.phi][1:], [-0.418682976, -0.920698678, -2.105408224, -1.413188772], atol=2e-8
    )
    np.testing.assert_allclose(motion[slider.x][1:], [9.429911995, 7.506478353, 2.876598656, 5.143813090], atol=1e-7)


def test_course_web_cutter():
    """projectFinalDYN, Haug's web cutter: motor torque, ground pin and knife of one turn."""

    def open_loop(angles):
        knife_end = np.array([0.04, 0]) + 0.28 * np.array([np.cos(angles[0]), np.sin(angles[0])])
        return knife_end + 0.4 * np.array([np.cos(angles[1]), np.sin(angles[1])]) - [0.26, -0.04]

    knife_angle = fsolve(open_loop, [1.3, -1.0])[0]
    knife_end = np.array([0.04, 0]) + 0.28 * np.array([np.cos(knife_angle), np.sin(knife_angle)])
    crank = mbd.Body("crank", mass=0.1, inertia=1.5e-5, pose=(0.02, 0, 0))
    knife = mbd.Body("knife", mass=1.0, inertia=0.03, pose=(*knife_end, knife_angle))
    rocker = mbd.Body("rocker", mass=2.0, inertia=0.04, pose=pose_on(knife_end, (0.26, -0.04), (-0.14, -0.07)))
    main = mbd.Revolute("main", mbd.ground.at(0, 0), crank.at(-0.02, 0))
    joints = [
        main,
        mbd.Revolute("crank pin", crank.at(0.02, 0), knife.at(-0.28, 0)),
        mbd.Revolute("knife pin", knife.at(0, 0), rocker.at(-0.14, -0.07)),
        mbd.Revolute("rocker pin", mbd.ground.at(0.26, -0.04), rocker.at(0.26, -0.07)),
    ]
    motor = mbd.Driver("motor", main.angle, 2 * np.pi * mbd.t)
    mechanism = mbd.Mechanism(bodies=[crank, knife, rocker], joints=joints, drivers=[motor])
    run = mbd.inverse_dynamics(mechanism, np.linspace(0, 1, 101))
    quarters = run[motor.effort][::25]
    np.testing.assert_allclose(quarters, [0.06813908, 0.05187791, -0.01588240, -0.04910471, 0.06813908], atol=6e-9)
    np.testing.assert_allclose(run[main.reaction_on(crank).force][0], [-0.970254, 1.703477], atol=6e-7)
    np.testing.assert_allclose(run[knife.q][25], [0.068890147, 0.311392977, 1.322207678], atol=6e-10)
