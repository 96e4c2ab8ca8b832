"""Integrators that advance the coordinates that a tree of joints leaves, beside the same equations in all of them."""

import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.arguments.inputs import read_signals
from mbdcasadi.equations.numeric import NumericEquations
from mbdcasadi.simulation.formulations import KKT, Explicit


def chain(links, *, spring=False):
    """Links in a row, released from rest, whose last one may hang on a spring."""
    bodies = [mbd.Body(f"link{k}", mass=0.1, inertia=1e-4, pose=(0.1 * k + 0.05, 0, 0)) for k in range(links)]
    pins = [mbd.Revolute("pin 0", mbd.ground.at(0, 0), bodies[0].at(-0.05, 0))]
    pins += [mbd.Revolute(f"pin {k}", bodies[k - 1].at(0.05, 0), bodies[k].at(-0.05, 0)) for k in range(1, links)]
    forces = [mbd.Gravity()]
    if spring:
        held = mbd.ground.at(0.1 * links, 0.5)
        forces.append(mbd.TSDA("spring", held, bodies[-1].at(0, 0), stiffness=5.0, free_length=0.3))
    return mbd.Mechanism(bodies=bodies, joints=pins, forces=forces)


@pytest.mark.parametrize(
    ("form", "links", "spring", "states", "unknowns"),
    [
        (Explicit(), 3, False, 6, 0),
        (Explicit(), 3, True, 6, 0),
        (KKT(), 12, False, 24, 12 + 24),
        (KKT(), 12, True, 72, 36 + 24),
    ],
)
def test_states_that_are_integrated(form, links, spring, states, unknowns):
    """Angles and their rates, with accelerations of angles and multipliers.

    All coordinates if many bodies' forces depend on their places.
    """
    mechanism = chain(links, spring=spring)
    numeric = NumericEquations(mbd.equations(mechanism), np.zeros(0))
    signals = read_signals(numeric.eom, None)
    dae = form.dae(numeric, signals, in_tree=True)
    assert dae.x.numel() == states
    assert dae.z.numel() == dae.alg.numel() == unknowns
    assert form.dae(numeric, signals).x.numel() == 6 * links


@pytest.mark.parametrize(("links", "spring"), [(3, True), (12, False), (12, True)])
def test_motions_agree_with_those_of_another_method(links, spring):
    """All coordinates and velocities, those that joints give as well."""
    mechanism, times = chain(links, spring=spring), np.linspace(0, 0.3, 7)
    found = mbd.simulate(mechanism, times, reltol=1e-9, abstol=1e-9)
    exact = mbd.simulate(mechanism, times, method="dop853", reltol=1e-11, abstol=1e-11)
    np.testing.assert_allclose(found.q, exact.q, atol=1e-6)
    np.testing.assert_allclose(found.v, exact.v, atol=1e-4)
    assert found.drift.position < 1e-12


@pytest.mark.slow
def test_loads_of_pins_that_brake():
    """Friction by reactions, beside the same with a spring too weak to matter that keeps all coordinates."""
    mechanism = chain(12)
    law = mbd.Coulomb(0.2, 1e-2)
    friction = [mbd.JointFriction(f"friction {pin.name}", pin, law, radius=0.01) for pin in mechanism.joints]
    tip = mechanism.bodies[-1].at(0, 0)
    weak = mbd.TSDA("weak", mbd.ground.at(1.2, 0.5), tip, stiffness=1e-10, free_length=0.3)
    runs = [
        mbd.simulate(mechanism.replace(forces=[mbd.Gravity(), *friction, *more]), np.linspace(0, 0.3, 7))
        for more in ([], [weak])
    ]
    np.testing.assert_allclose(runs[0].q, runs[1].q, atol=1e-6)
    free = mbd.simulate(mechanism, np.linspace(0, 0.3, 7))
    assert np.max(np.abs(free.q - runs[0].q)) > 1e-3


def test_a_body_that_carries_many_keeps_its_acceleration():
    """Twelve pendulums on a wheel: the place of the wheel is not written in terms of all reactions on it."""
    wheel = mbd.Body("wheel", mass=1.0, inertia=0.1)
    rods = [mbd.Body(f"rod{k}", mass=0.1, inertia=1e-4) for k in range(12)]
    pins = [mbd.Revolute("axle", mbd.ground.at(0, 0), wheel.at(0, 0))]
    pins += [mbd.Revolute(f"pin {k}", wheel.at(0.1 * k, 0.1), rod.at(-0.05, 0)) for k, rod in enumerate(rods)]
    numeric = NumericEquations(mbd.equations(mbd.Mechanism([wheel, *rods], pins, forces=[mbd.Gravity()])), np.zeros(0))
    dae = KKT().dae(numeric, read_signals(numeric.eom, None), in_tree=True)
    assert dae.z.numel() == 3 + 12 + 26


def test_light_bodies_keep_their_accelerations():
    """Beside a body without mass no acceleration is divided by a mass."""
    mechanism = chain(12)
    light = mbd.Body("light", mass=0.0, inertia=0.0, pose=(1.25, 0, 0))
    weld = mbd.Weld("weld", mechanism.bodies[-1].at(0.05, 0), light.at(-0.05, 0))
    mechanism = mechanism.replace(bodies=[*mechanism.bodies, light], joints=[*mechanism.joints, weld])
    numeric = NumericEquations(mbd.equations(mechanism), np.zeros(0))
    dae = KKT().dae(numeric, read_signals(numeric.eom, None), in_tree=True)
    assert dae.z.numel() == 39 + 27


def test_a_run_that_stops_keeps_all_coordinates():
    """The partial motion has the places of the bodies, and meets the joints."""
    mechanism = chain(3)
    link = mechanism.bodies[2]
    root = mbd.Force("force", link.at(0, 0), (mbd.sqrt(0.05 - mbd.t), 0))  # of a negative number from then on
    with pytest.raises(mbd.SimulationError) as caught:
        mbd.simulate(mechanism.replace(forces=[*mechanism.forces, root]), np.linspace(0, 0.1, 21))
    partial = caught.value.partial
    assert 0.04 < partial.t[-1] < 0.055
    assert partial.q.shape[1] == 9
    assert partial.drift.position < 1e-12
