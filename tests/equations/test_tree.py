"""Coordinates of a tree of joints in terms of those that its rows do not give, beside the constraints themselves."""

import casadi as ca
import numpy as np
import pytest
from random_mechanisms import random_mechanism

import mbdcasadi as mbd
from mbdcasadi.equations.explicit import tree_rows
from mbdcasadi.equations.tree import tree_coordinates


def chain(links, *, held=True):
    """Links in a row, the first one pinned to the ground or free."""
    bodies = [mbd.Body(f"link{k}", mass=1.0, inertia=0.1, pose=(k + 0.5, 0, 0)) for k in range(links)]
    pins = [mbd.Revolute("pin 0", mbd.ground.at(0, 0), bodies[0].at(-0.5, 0))] if held else []
    pins += [mbd.Revolute(f"pin {k + 1}", bodies[k].at(0.5, 0), bodies[k + 1].at(-0.5, 0)) for k in range(links - 1)]
    return mbd.Mechanism(bodies=bodies, joints=pins, forces=[mbd.Gravity()])


def missed(eom, tree, q, v, p):
    """Position rows, and their rates, at the coordinates of a tree."""
    rows = [int(k) for k in eom.position_rows]
    values = ca.Function("rows", [eom.q, eom.v, eom.t, eom.p], [eom.Phi, eom.Phi_q[rows, :] @ eom.v])
    whole = ca.Function("tree", [eom.q, eom.v, eom.p], [tree.q, tree.v])
    return [x.full().ravel() for x in values(*whole(q, v, p), 0.0, p)]


@pytest.mark.parametrize("seed", range(8))
def test_the_rows_that_give_coordinates_hold(seed):
    """Whatever the independent coordinates are, and wherever the others were."""
    mechanism = random_mechanism(seed)
    eom, rng = mbd.equations(mechanism), np.random.default_rng(seed)
    tree, places = tree_coordinates(eom), [place for place, _ in tree_rows(eom).values()]
    q, v = rng.uniform(-1, 1, (2, eom.q.numel()))
    q[tree.dependent], v[tree.dependent] = np.nan, np.nan
    phi, rate = missed(eom, tree, q, v, np.full(eom.p.numel(), 0.3))
    assert np.max(np.abs(phi[places]), initial=0.0) < 1e-12
    assert np.max(np.abs(rate[places]), initial=0.0) < 1e-12


@pytest.mark.parametrize(("held", "independent"), [(True, 30), (False, 32)])
def test_a_chain_is_left_with_its_angles(held, independent):
    """However many links there are; a free chain keeps the place of one of them."""
    eom = mbd.equations(chain(30, held=held))
    tree = tree_coordinates(eom)
    assert len(tree.independent) == independent
    for part in missed(eom, tree, *np.random.default_rng(0).uniform(-1, 1, (2, 90)), np.zeros(0)):
        assert np.max(np.abs(part)) < 1e-12


def test_rows_that_depend_on_time_or_jump_give_no_coordinate():
    """They are looked at by the projection of outputs, which finds jumps."""
    body = mbd.Body("body", mass=1.0, inertia=0.1)
    driven = mbd.Mechanism(bodies=[body], drivers=[mbd.Driver("shift", body.position[0], mbd.sin(mbd.t))])
    assert not tree_coordinates(mbd.equations(driven)).dependent
    jumping = mbd.Mechanism(
        bodies=[body], joints=[mbd.Constraint("spiral", body.position[0] - ca.atan2(body.position[1], 1 + body.phi))]
    )
    assert not tree_coordinates(mbd.equations(jumping)).dependent


def test_a_welded_body_keeps_its_coordinates():
    """Something must be left to advance."""
    body = mbd.Body("body", mass=1.0, inertia=0.1)
    welded = mbd.Mechanism(bodies=[body], joints=[mbd.Weld("weld", mbd.ground.at(1, 2), body.at(0, 0))])
    assert not tree_coordinates(mbd.equations(welded)).dependent
    motion = mbd.simulate(welded, duration=0.1)
    np.testing.assert_allclose(motion.q[-1], [1, 2, 0], atol=1e-12)


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 4, 5, 6, 7, 8, 11])
def test_accelerations_by_the_inertia_of_the_tree(seed):
    """Those of the equations of motion of all bodies and rows, solved densely, also with loops that are not closed."""
    mechanism = random_mechanism(seed)
    eom, rng = mbd.equations(mechanism), np.random.default_rng(seed)
    tree, p = tree_coordinates(eom), eom.parameter_values
    free, z, u = rng.uniform(-1, 1, (2, eom.q.numel())), rng.normal(size=eom.z.numel()), rng.normal(size=eom.u.numel())
    known = [eom.t, eom.q, eom.v, eom.z, eom.u, eom.p]
    whole = ca.Function("whole", known, [tree.q, tree.v, tree.accelerations(eom.t, eom.z, eom.u, eom.p)])
    q, v, a = (x.full().ravel() for x in whole(0.3, *free, z, u, p))
    parts = ca.Function("parts", known, [eom.mass_diagonal, eom.Phi_q, eom.Q, eom.gamma])
    mass, jacobian, force, gamma = (x.full() for x in parts(0.3, q, v, z, u, p))
    rows = len(jacobian)
    system = np.block([[np.diag(mass.ravel()), jacobian.T], [jacobian, np.zeros((rows, rows))]])
    exact = np.linalg.solve(system, np.vstack([force, gamma])).ravel()[: q.size]
    np.testing.assert_allclose(a, exact, atol=1e-8 * (1 + np.max(np.abs(exact))))


def test_long_chains_are_no_light_trees():
    """The inertia of a tree couples all angles of a chain, of a tree of short branches few of them."""
    assert tree_coordinates(mbd.equations(chain(3))).is_light
    assert not tree_coordinates(mbd.equations(chain(8))).is_light
