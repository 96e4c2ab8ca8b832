"""Poses in which a linkage could fold are passed along the smooth branch, by every method and in every form."""

import numpy as np
import pytest
from test_simulate import n_four_bar

import mbdcasadi as mbd

METHODS = ["idas", "erk", "rosenbrock", "dop853"]


def row(count, speed, end, outputs, **settings):
    """A row of parallelograms (IFToMM's N-four-bar) and its motion from the upright pose."""
    f = n_four_bar(count)
    start = [f.first.phi == np.pi / 2, f.first.omega == speed]
    return f, mbd.simulate(f.mechanism, np.linspace(0, end, outputs), initial=start, **settings)


def check_parallel(f, motion, tolerance=2e-5):
    """All cranks turn alike, and the energy is kept."""
    for crank in f.cranks:
        np.testing.assert_allclose(motion[crank.phi], motion[f.first.phi], atol=1e-8)
        np.testing.assert_allclose(motion[crank.omega], motion[f.first.omega], atol=1e-6)
    energy = motion.energy.total
    assert np.max(np.abs(energy - energy[0])) < tolerance * np.max(motion.energy.kinetic)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("speed", [1.0, -1.0])
@pytest.mark.parametrize("count", [1, 5])
def test_flat_rows(count, speed, method):
    """Five loops are integrated in the KKT form by IDAS, one in the explicit form."""
    f, motion = row(count, speed, 3, 61, method=method)
    check_parallel(f, motion)
    assert any("singular pose" in note for note in motion.statistics.notes)


@pytest.mark.parametrize("tolerance", [1e-6, 1e-8, 1e-10])
@pytest.mark.parametrize("outputs", [2, 7, 201])
def test_tolerances_and_outputs(tolerance, outputs):
    """Coarse and tight, with outputs in the pose itself or none near to it."""
    f, motion = row(3, 1.0, 2.5, outputs, reltol=tolerance, abstol=tolerance)
    check_parallel(f, motion, max(2e-5, 1e3 * tolerance))


@pytest.mark.parametrize("method", [method for method in METHODS if method != "dop853"])  # it refuses redundant rows
@pytest.mark.parametrize("cranks", [3, 4])
def test_redundant_cranks(cranks, method):
    """A coupler on more cranks than it needs: flat, and redundant everywhere else."""
    places = np.linspace(0, 2, cranks)
    bars = [mbd.Body(f"bar {k}", mass=1, inertia=1 / 12, pose=(x, 0.5, np.pi / 2)) for k, x in enumerate(places)]
    coupler = mbd.Body("coupler", mass=2, inertia=0.5, pose=(1, 1, 0))
    joints = []
    for k, (bar, x) in enumerate(zip(bars, places, strict=True)):
        joints.append(mbd.Revolute(f"foot {k}", mbd.ground.at(x, 0), bar.at(-0.5, 0)))
        joints.append(mbd.Revolute(f"head {k}", bar.at(0.5, 0), coupler.at(x - 1, 0)))
    mechanism = mbd.Mechanism(bodies=[*bars, coupler], joints=joints, forces=[mbd.Gravity()])
    start = [bars[0].phi == np.pi / 2, bars[0].omega == -1]
    motion = mbd.simulate(mechanism, np.linspace(0, 3, 61), initial=start, method=method)
    # one coordinate: (cranks/3 + 2) phi'' = -(cranks/2 + 2) g cos(phi)
    weight, inertia = (cranks / 2 + 2) * 9.81, cranks / 3 + 2
    rate, angle = motion[bars[0].omega], motion[bars[0].phi]
    energy = 0.5 * inertia * rate**2 + weight * np.sin(angle)
    np.testing.assert_allclose(energy, energy[0], rtol=1e-5)
    np.testing.assert_allclose(motion[coupler.phi], 0, atol=1e-9)
    np.testing.assert_allclose(motion[bars[-1].phi], angle, atol=1e-9)


def test_reactions_near_the_pose():
    """Reactions stay those of the limit: they do not blow up at outputs near to the pose."""
    f, motion = row(1, -1.0, 3, 3001)
    force = motion[f.mechanism.joints[0].reaction_on(f.first).force]
    steps = np.abs(np.diff(force, axis=0)).max(axis=1)
    assert np.max(np.abs(force)) < 200
    assert np.max(steps) < 1.0


def test_an_event_in_the_pose():
    """An event that takes place at the flat pose itself is found there."""
    f = n_four_bar(2)
    flat = mbd.Event("flat", mbd.sin(f.first.phi), direction=0)
    start = [f.first.phi == np.pi / 2, f.first.omega == -1]
    motion = mbd.simulate(f.mechanism, np.linspace(0, 3, 31), initial=start, events=[flat])
    assert len(motion.events) >= 3
    for event in motion.events:
        assert abs(np.sin(event.state[f.first.phi])) < 1e-9


def test_a_neutral_linkage():
    """Longest and shortest link as long as the other two together: flat once a turn, with unequal links."""
    # 2 + 5 = 3 + 4: crank 2, coupler 5, rocker 4, base 3 (the crank turns past the pose in which all lie on a line)
    crank = mbd.Body("crank", mass=1, inertia=1 / 3, pose=(0, 1.0, np.pi / 2))
    coupler = mbd.Body("coupler", mass=1, inertia=25 / 12, pose=(2, 3.0, 0.4))
    rocker = mbd.Body("rocker", mass=1, inertia=16 / 12, pose=(3.5, 2.0, 1.3))
    joints = [
        mbd.Revolute("O", mbd.ground.at(0, 0), crank.at(-1, 0)),
        mbd.Revolute("A", crank.at(1, 0), coupler.at(-2.5, 0)),
        mbd.Revolute("B", coupler.at(2.5, 0), rocker.at(2, 0)),
        mbd.Revolute("C", mbd.ground.at(3, 0), rocker.at(-2, 0)),
    ]
    mechanism = mbd.Mechanism(bodies=[crank, coupler, rocker], joints=joints)
    motion = mbd.simulate(mechanism, np.linspace(0, 8, 1601), initial=[crank.phi == np.pi / 2, crank.omega == 4])
    energy = motion.energy.kinetic
    assert np.max(np.abs(energy - energy[0])) < 1e-5 * energy[0]
    for body in (crank, coupler, rocker):  # no velocity jumps from one output to the next
        assert np.max(np.abs(np.diff(motion[body.omega]))) < 0.5
    assert np.ptp(motion[crank.phi]) > 2 * np.pi
