"""Forces of many contacts of one kind in C: the same ones, evaluated for those that are near."""

from itertools import pairwise

import casadi as ca
import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.integrators.native import build
from mbdcasadi.simulation.contact.compiled_elements import compiled_elements
from mbdcasadi.simulation.contact.watched_terms import WatchedTerms

needs_compiler = pytest.mark.skipif(build.compiler() is None, reason="there is no C compiler")
TIMES = np.linspace(0, 0.08, 9)


def heap(count=14, joined=0):
    """Discs of two sizes in a heap on a floor; some hundred pairs. Of the first ones some are joined to the next."""
    rng, law = np.random.default_rng(7), mbd.HuntCrossley(2e4, damping=0.4)
    radii = np.where(np.arange(count) % 2, 0.05, 0.06)
    bodies = [
        mbd.Body(
            f"b{k}", mass=0.2, inertia=3e-4, pose=(0.115 * (k % 5) + 0.005 * rng.normal(), 0.055 + 0.12 * (k // 5), 0)
        )
        for k in range(count)
    ]
    discs = [mbd.Circle(body.at(0, 0), float(r)) for body, r in zip(bodies, radii, strict=True)]
    floor, rough = mbd.HalfPlane(mbd.ground.at(0, 0)), mbd.Coulomb(0.3, 1e-2)
    forces = [mbd.Gravity(), *[mbd.Contact(f"floor{k}", disc, floor, law, rough) for k, disc in enumerate(discs)]]
    forces += [mbd.Contact(f"c{j}_{k}", discs[j], discs[k], law, rough) for k in range(count) for j in range(k)]
    joints = []
    for k, (body, following) in enumerate(pairwise(bodies[: joined + 1])):
        half = (following.pose_estimate[:2] - body.pose_estimate[:2]) / 2
        joints.append(mbd.Revolute(f"pin{k}", body.at(*half), following.at(*-half)))
    return mbd.Mechanism(bodies, joints=joints, forces=forces)


@pytest.mark.slow
@needs_compiler
def test_compiled_forces_and_their_slopes_are_those_of_the_equations():
    mechanism = heap()
    eom = mbd.equations(mechanism)
    terms = WatchedTerms(eom)
    elements, remark = compiled_elements(terms)
    assert elements is not None and "compiled" in remark
    rng, n = np.random.default_rng(0), eom.q.numel()
    q, v, a = eom.estimate[0] + 0.01 * rng.normal(size=n), rng.normal(size=n), rng.normal(size=n)
    column = np.zeros(terms.values.size)
    column[1 : 1 + 3 * n], column[-1] = np.r_[q, v, a], 1.0
    forces = elements.forces(column).full().ravel() + elements.rest(0, q, v, [], [], [], []).full().ravel()
    own = ca.Function("Q", [eom.q, eom.v], [eom.Q, ca.jacobian(eom.Q, ca.vertcat(eom.q, eom.v))])
    expected, slopes = (part.full() for part in own(q, v))
    np.testing.assert_allclose(forces, expected.ravel(), atol=1e-10 * np.max(np.abs(expected)))
    found = elements.forces.jacobian()(column, forces).full()[:, 1 : 1 + 2 * n]
    np.testing.assert_allclose(found, slopes, atol=1e-10 * np.max(np.abs(slopes)))
    rates = ca.Function("rates", list(eom.symbols), [terms.rates])(0, q, v, a, [], [], [], []).full().ravel()
    assert np.count_nonzero(rates) > 20
    np.testing.assert_allclose(elements.rates(column).full().ravel(), rates, atol=1e-9 * np.max(np.abs(rates)))


@needs_compiler
@pytest.mark.slow
def test_runs_with_and_without_a_compiler_are_the_same(monkeypatch):
    """IDAS and DOP853 give one motion, whether contacts are compiled or not; the note says which."""
    motion = mbd.simulate(heap(), TIMES)
    explicit = mbd.simulate(heap(), TIMES, method=mbd.DOP853(1e-11, 1e-11))
    monkeypatch.setattr(build, "compiler", lambda: None)
    interpreted = mbd.simulate(heap(), TIMES)
    assert any("no C compiler" in note for note in interpreted.statistics.notes)
    assert any("compiled" in note for note in motion.statistics.notes)
    np.testing.assert_allclose(motion.q, interpreted.q, atol=1e-6)
    np.testing.assert_allclose(explicit.q, interpreted.q, atol=1e-6)


@needs_compiler
@pytest.mark.slow
def test_rosenbrock_takes_compiled_contacts():
    """Its steps take slopes of what is watched too."""
    motions = [mbd.simulate(heap(8), TIMES[:4], method=method) for method in ("idas", "rosenbrock")]
    assert all(any("compiled" in note for note in motion.statistics.notes) for motion in motions)
    np.testing.assert_allclose(motions[1].q, motions[0].q, atol=1e-6)


@needs_compiler
@pytest.mark.slow
def test_many_contacts_of_many_bodies_with_joints():
    """Accelerations and reactions are unknowns of IDAS beside compiled contacts; Runge–Kutta gives the same motion."""
    motion = mbd.simulate(heap(joined=4), TIMES)
    assert motion.statistics.formulation == "KKT"
    assert any("compiled" in note for note in motion.statistics.notes)
    explicit = mbd.simulate(heap(joined=4), TIMES, method="erk")
    assert explicit.statistics.formulation == "explicit"
    np.testing.assert_allclose(motion.q, explicit.q, atol=1e-6)


def test_without_joints_the_form_is_explicit_and_few_contacts_are_not_compiled():
    """A body on the ground by contact alone is an ordinary differential equation, and nothing is compiled for it."""
    ball = mbd.Body("ball", mass=1, inertia=0.1, pose=(0, 0.2, 0))
    floor = mbd.Contact(
        "floor", mbd.Circle(ball.at(0, 0), 0.1), mbd.HalfPlane(mbd.ground.at(0, 0)), mbd.HuntCrossley(1e4, damping=0.2)
    )
    motion = mbd.simulate(mbd.Mechanism([ball], forces=[mbd.Gravity(), floor]), TIMES)
    assert motion.statistics.formulation == "explicit" and not motion.statistics.notes
    many = [mbd.Body(f"b{k}", mass=1, inertia=1, pose=(k, 0, 0)) for k in range(20)]
    assert mbd.simulate(mbd.Mechanism(many, forces=[mbd.Gravity()]), TIMES).statistics.formulation == "explicit"
