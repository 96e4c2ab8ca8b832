"""Accelerations and multipliers with masses and inertias over fifteen orders of magnitude, against exact fractions."""

from fractions import Fraction

import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.equations.numeric import NumericEquations


def exactly(matrix, right):
    """Solution of a linear system in rational numbers: of the numbers in it, without any rounding."""
    n = len(right)
    rows = [[Fraction(float(x)) for x in row] + [Fraction(float(y))] for row, y in zip(matrix, right, strict=True)]
    for i in range(n):
        pivot = max(range(i, n), key=lambda k: abs(rows[k][i]))
        rows[i], rows[pivot] = rows[pivot], rows[i]
        rows[i] = [x / rows[i][i] for x in rows[i]]
        for k in range(n):
            if k != i and rows[k][i]:
                rows[k] = [x - rows[k][i] * y for x, y in zip(rows[k], rows[i], strict=True)]
    return np.array([float(row[n]) for row in rows])


def linkage(generator, links, *, closed, without_inertia):
    """Random links pinned to each other, some of them without inertia, and perhaps the last one to the ground."""
    bodies, joints, before, end, at = [], [], mbd.ground, np.zeros(2), 0.0
    for k in range(links):
        length, angle = 10 ** generator.uniform(-0.5, 0.5), generator.uniform(-np.pi, np.pi)
        mass = 10 ** generator.uniform(-9, 6)
        inertia = 0.0 if k in without_inertia else mass * length**2 * 10 ** generator.uniform(-15, -1)
        along = length * np.array([np.cos(angle), np.sin(angle)])
        body = mbd.Body(f"link {k}", mass=mass, inertia=inertia, pose=(*(end + along / 2), angle))
        joints.append(mbd.Revolute(f"pin {k}", before.at(at, 0), body.at(-length / 2, 0)))
        bodies.append(body)
        before, end, at = body, end + along, length / 2
    if closed:
        joints.append(mbd.Revolute("last pin", mbd.ground.at(*end), before.at(at, 0)))
    return mbd.Mechanism(bodies=bodies, joints=joints, forces=[mbd.Gravity()])


def moving(mechanism, generator):
    """Equations, numbers, and a random state of motion on the constraints."""
    eom = mbd.equations(mechanism)
    numeric = NumericEquations(eom, np.zeros(0))
    q = eom.estimate[0]
    jacobian = numeric.jacobian(0.0, q)
    free = np.linalg.svd(jacobian)[2][np.linalg.matrix_rank(jacobian) :].T
    return eom, numeric, q, free @ generator.normal(size=free.shape[1])


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("closed", [False, True])
def test_accelerations_and_multipliers_to_rounding(seed, closed):
    generator = np.random.default_rng(seed)
    without = [1, 3] if seed % 3 == 0 else []
    eom, numeric, q, v = moving(linkage(generator, 4, closed=closed, without_inertia=without), generator)
    none = np.zeros(0)
    jacobian, gamma = numeric.acceleration(0.0, q, v, none, none)
    n, m = q.size, gamma.size
    force = eom.value(eom.Q, (0, q, v, np.zeros(n), none, np.zeros(m), none, none)).ravel()
    system = np.block([[np.diag(numeric.mass), jacobian.T], [jacobian, np.zeros((m, m))]])
    exact = exactly(system, np.r_[force, gamma])
    for redundant, accuracy in ((False, 1e-10), (True, 1e-8)):
        a, lam = (x.full().ravel() for x in numeric.forward_dynamics(redundant=redundant)(0, q, v, none, none, none))
        # each multiplier to its own size, though they differ by fifteen orders
        np.testing.assert_allclose(lam, exact[n:], rtol=accuracy)
        np.testing.assert_allclose(a, exact[:n], rtol=accuracy, atol=1e-3 * accuracy * np.abs(exact[:n]).max())


@pytest.mark.parametrize(("drift", "accuracy"), [(1e-12, 1e-5), (1e-10, 2e-3), (1e-8, 2e-1)])
def test_dependent_rows_that_drift_apart_are_not_pursued(drift, accuracy):
    """Off the constraints three parallel cranks contradict each other: over epsilon that is all that it may matter."""
    generator = np.random.default_rng(0)
    cranks = [mbd.Body(f"crank {k}", mass=1.0, inertia=1 / 12, pose=(k + 0.3, 0.4, np.arctan2(4, 3))) for k in range(3)]
    beam = mbd.Body("beam", mass=2.0, inertia=0.5, pose=(1.6, 0.8, 0))
    joints = [mbd.Revolute(f"foot {k}", mbd.ground.at(k, 0), crank.at(-0.5, 0)) for k, crank in enumerate(cranks)]
    joints += [mbd.Revolute(f"head {k}", crank.at(0.5, 0), beam.at(k - 1, 0)) for k, crank in enumerate(cranks)]
    state = mbd.assemble(mbd.Mechanism([*cranks, beam], joints, forces=[mbd.Gravity()]))
    numeric, none = NumericEquations(mbd.equations(state.mechanism), np.zeros(0)), np.zeros(0)
    for _ in range(5):
        q, v = (part + drift * generator.normal(size=part.size) for part in (state.q, state.v))
        a, lam = (x.full().ravel() for x in numeric.forward_dynamics(redundant=True)(0, q, v, none, none, none))
        assert a == pytest.approx(state.a, abs=1e2 * drift)
        assert lam == pytest.approx(state.lam, abs=accuracy * np.abs(state.lam).max())


def test_ordinary_bodies_take_the_direct_form():
    generator = np.random.default_rng(0)
    rod = [mbd.Body(f"rod {k}", mass=m, inertia=m / 12, pose=(k + 0.5, 0, 0)) for k, m in enumerate((1, 5, 0.2))]
    ends = [mbd.ground.at(0, 0), *[body.at(0.5, 0) for body in rod[:-1]]]
    joints = [mbd.Revolute(f"pin {k}", a, b.at(-0.5, 0)) for k, (a, b) in enumerate(zip(ends, rod, strict=True))]
    _, numeric, _, _ = moving(mbd.Mechanism(bodies=rod, joints=joints), generator)
    assert numeric.augmentation is None


def test_light_bodies_that_nothing_holds_are_no_matter():
    """A speck of dust beside a ship: neither hampers the other."""
    dust = mbd.Body("dust", mass=1e-12, inertia=1e-27, pose=(0, 1, 0))
    ship = mbd.Body("ship", mass=1e7, inertia=1e9, pose=(100, 0, 0))
    keel = mbd.Translational("keel", mbd.ground.at(0, 0), ship.at(0, 0))
    model = mbd.Mechanism(bodies=[dust, ship], joints=[keel], forces=[mbd.Gravity()])
    state = mbd.assemble(model)
    np.testing.assert_allclose(state[mbd.vertcat(dust.ay, ship.ay)], [-9.81, 0], atol=1e-12)
    assert state[keel.reaction_on(ship).force][1] == pytest.approx(9.81e7, rel=1e-12)


@pytest.mark.parametrize("lightest", [1.0, 1e-6])
@pytest.mark.parametrize("redundant", [False, True])
def test_forces_on_bodies_without_mass(lightest, redundant):
    """A cart drawn by a handle through a rod, neither of which has mass, accelerates by the force over its mass."""
    u = mbd.Input("u")
    handle = mbd.Body("handle", mass=0.0, inertia=0.0, pose=(1, 0.3, 0))
    rod = mbd.Body("rod", mass=0.0, inertia=0.0, pose=(0.5, 0.15, np.arcsin(0.3)))
    cart, weight = mbd.Body("cart", mass=2.0, inertia=0.0), mbd.Body("weight", mass=2.0 * lightest, inertia=0.0)
    joints = [
        mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0)),
        mbd.Translational("second rail", mbd.ground.at(0, 0), weight.at(0, 0)),
        mbd.Revolute("cart pin", cart.at(0, 0), rod.at(-0.5, 0)),
        mbd.Revolute("handle pin", rod.at(0.5, 0), handle.at(0, 0)),
        mbd.Translational("handle rail", mbd.ground.at(0, 0.3), handle.at(0, 0)),
    ]
    pull = mbd.Force("pull", handle.at(0, 0), (u, 0))
    bodies = [handle, rod, cart, weight]
    numeric = NumericEquations(
        mbd.equations(mbd.Mechanism(bodies=bodies, joints=joints, forces=[pull], inputs=[u])), np.zeros(0)
    )
    weighed = [cart.x == 0.1, weight.x == 0.7]
    q, none = mbd.assemble(numeric.eom.mechanism, weighed).q, np.zeros(0)
    a, lam = numeric.accelerations(0.0, q, np.zeros(12), none, np.array([9.0]), redundant=redundant)
    assert a.reshape(4, 3)[:3, 0] == pytest.approx([4.5] * 3, rel=1e-8) and np.abs(a[2::3]).max() < 1e-7
    balance = numeric.mass * a + numeric.jacobian(0.0, q).T @ lam - np.eye(12)[0] * 9.0
    assert np.abs(balance).max() < 1e-12
