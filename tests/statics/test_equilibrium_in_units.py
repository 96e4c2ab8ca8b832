"""Equilibria and their paths do not depend on the units: from micrometres to a thousand kilometres."""

import numpy as np
import pytest

import mbdcasadi as mbd

#: Length, m, and force, N.
SIZES = [(1.0, 1.0), (1e-6, 1e-12), (1e-3, 1e-6), (1e6, 1e9)]


def shallow_arch(length, force):
    """An arm that a spring pushes against a load until it snaps through."""
    load = mbd.Parameter("load", 0.0)
    arm = mbd.Body("arm", mass=1.0, inertia=0.1 * length**2, pose=(0.5 * length, 0.15 * length, 0.2))
    foot = mbd.Revolute("foot", mbd.ground.at(0, 0), arm.at(-0.5 * length, 0))
    spring = mbd.TSDA(
        "spring", arm.at(0.5 * length, 0), mbd.ground.at(1.2 * length, 0), 50 * force / length, 0.6 * length
    )
    push = mbd.Force("push", arm.at(0.5 * length, 0), (0, -load))
    return arm, load, mbd.Mechanism([arm], joints=[foot], forces=[spring, push], parameters=[load])


@pytest.mark.parametrize("length, force", SIZES)
def test_snap_through(length, force):
    """The load by the angle, in closed form, has its extremes at the limit points; the path ends at its last value."""
    arm, load, mechanism = shallow_arch(length, force)
    path = mbd.equilibrium_path(mechanism, load, 0, 8 * force, steps=20)
    assert path.values[-1] == pytest.approx(8 * force, rel=1e-12)

    # moment about the foot of the spring of length s: 50 (0.6 - s) 1.2 sin phi / s = load cos phi
    def moment_over_lever(phi):
        s = np.sqrt(1 + 1.2**2 - 2.4 * np.cos(phi))
        return 50 * (0.6 - s) * 1.2 * np.sin(phi) / s / np.cos(phi)

    assert path[load] / force == pytest.approx(moment_over_lever(path[arm.phi]), abs=1e-8)
    limits = [critical.value / force for critical in path.critical if critical.kind == "limit"]
    angles = np.linspace(-0.9, 0.9, 200_001)
    loads = moment_over_lever(angles)
    inner = loads[1:-1]
    extremes = inner[(inner - loads[:-2]) * (loads[2:] - inner) < 0]
    for limit in limits:
        assert np.min(np.abs(extremes - limit)) < 1e-7


@pytest.mark.parametrize("length, force", SIZES)
def test_a_load_that_balances(length, force):
    """The torque that holds an arm up, as an input without a value or limits."""
    mass = force / 9.81
    arm = mbd.Body("arm", mass=mass, inertia=mass * length**2 / 12, pose=(0.5 * length, 0, 0))
    foot = mbd.Revolute("foot", mbd.ground.at(0, 0), arm.at(-0.5 * length, 0))
    torque = mbd.Input("torque")
    mechanism = mbd.Mechanism(
        [arm], joints=[foot], forces=[mbd.Gravity(), mbd.Torque("motor", arm, torque)], inputs=[torque]
    )
    state = mbd.equilibrium(mechanism, [arm.phi == 0.3], unknowns=[torque])
    assert state[torque] == pytest.approx(0.5 * force * length * np.cos(0.3), rel=1e-9)


@pytest.mark.parametrize(
    "length, mass, time", [(1e-5, 1e-9, 1e-3), (1e-6, 1e-12, 1e-4), (1e-5, 1e-9, 1.0), (1e5, 1e12, 1.0)]
)
def test_a_loop_of_any_size_rests_in_the_same_pose(length, mass, time):
    """A four-bar that hangs on a spring: angles, stability and reactions of a linkage of one metre, in its units."""

    def resting(length, mass, time):
        force = mass * length / time**2

        def link(name, size, pose):
            place = pose[0] * length, pose[1] * length, pose[2]
            return mbd.Body(name, mass=size * mass, inertia=size**3 / 12 * mass * length**2, pose=place)

        crank, coupler = link("crank", 0.2, (0, 0.1, np.pi / 2)), link("coupler", 0.5, (0.24, 0.25, 0.2))
        rocker = link("rocker", 0.4, (0.45, 0.15, 1.7))
        pins = [
            mbd.Revolute("A", mbd.ground.at(0, 0), crank.at(-0.1 * length, 0)),
            mbd.Revolute("B", crank.at(0.1 * length, 0), coupler.at(-0.25 * length, 0)),
            mbd.Revolute("C", coupler.at(0.25 * length, 0), rocker.at(0.2 * length, 0)),
            mbd.Revolute("D", mbd.ground.at(0.45 * length, 0), rocker.at(-0.2 * length, 0)),
        ]
        spring = mbd.TSDA(
            "spring",
            mbd.ground.at(0.2 * length, 0.6 * length),
            coupler.at(0, 0.05 * length),
            stiffness=40 * force / length,
            free_length=0.3 * length,
        )
        loads = [mbd.Gravity((0, -9.81 * length / time**2)), spring]
        rest = mbd.equilibrium(mbd.Mechanism([crank, coupler, rocker], joints=pins, forces=loads))
        assert rest.stable
        angles = [rest[body.phi] for body in (crank, coupler, rocker)]
        return np.array([*angles, *(rest[pins[1].reaction_on(coupler).force] / force)])

    assert resting(length, mass, time) == pytest.approx(resting(1.0, 1.0, 1.0), rel=1e-7)
