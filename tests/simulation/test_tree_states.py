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
    ("form", "links", "spring", "states"),
    [(Explicit(), 3, False, 6), (Explicit(), 3, True, 6), (KKT(), 12, False, 24), (KKT(), 12, True, 72)],
)
def test_states_that_are_integrated(form, links, spring, states):
    """Angles and their rates; all coordinates if many bodies' forces depend on their places."""
    mechanism = chain(links, spring=spring)
    numeric = NumericEquations(mbd.equations(mechanism), np.zeros(0))
    signals = read_signals(numeric.eom, None)
    dae = form.dae(numeric, signals, in_tree=True)
    assert dae.x.numel() == states
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
