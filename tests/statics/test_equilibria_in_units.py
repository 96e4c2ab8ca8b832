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
