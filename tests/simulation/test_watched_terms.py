"""Watched quantities of contacts, derived once for those of one kind."""

import casadi as ca
import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.simulation.contact.watched_terms import WatchedTerms


@pytest.fixture(scope="module")
def watched():
    """Two blocks, a disc and a stop; their equations and terms, and a state in which all of them touch."""
    law, rough = mbd.HuntCrossley(1e4, damping=0.5), mbd.Coulomb(0.3, 1e-2)
    a = mbd.Body("a", mass=1, inertia=0.1, pose=(0, 0.09, 0.05))
    b = mbd.Body("b", mass=2, inertia=0.2, pose=(0.05, 0.27, 0))
    disc = mbd.Body("disc", mass=1, inertia=0.1, pose=(0.3, 0.09, 0))
    corners = [(-0.1, -0.1), (0.1, -0.1), (0.1, 0.1), (-0.1, 0.1)]
    blocks = [mbd.PolygonEdges(body.at(0, 0), corners) for body in (a, b)]
    floor = mbd.HalfPlane(mbd.ground.at(0, 0))
    forces = [
        mbd.Contact("floor_a", blocks[0], floor, law, rough),
        mbd.Contact("floor_b", blocks[1], floor, law, rough),
        mbd.Contact("pair", *blocks, law, rough),
        mbd.Contact("disc", mbd.Circle(disc.at(0, 0), 0.1), floor, law, rough),
        mbd.EndStop("stop", 0.25 - disc.x, law),
    ]
    eom = mbd.equations(mbd.Mechanism([a, b, disc], forces=forces))
    velocity = np.random.default_rng(1).normal(size=9)
    return eom, WatchedTerms(eom), eom.estimate[0], velocity


def smoothings_of(terms):
    """Smoothed quantities of the elements themselves."""
    return [s for element in terms.elements for s in element.smoothings]


def test_rates_are_those_of_the_elements(watched):
    eom, terms, q, v = watched
    smoothings = smoothings_of(terms)
    slopes = [mbd.time_derivative(s.expression, eom.mechanism) for s in smoothings]
    scales = [ca.fabs(mbd.time_derivative(ca.SX(s.scale), eom.mechanism)) for s in smoothings]
    closed = [ca.if_else(e.gap < 0, 1, 0) for e in terms.owners]
    excess = [
        ca.if_else(c.expression < 0, ca.fabs(mbd.time_derivative(c.reported, eom.mechanism)), 0) for c in terms.validity
    ]
    state = (0.0, q, v, np.arange(9.0), [], [], [], [])
    own, found = (
        ca.Function("f", list(eom.symbols), [ca.densify(e)])(*state).full()
        for e in (ca.vertcat(*slopes, *scales, *closed, *excess), terms.rates)
    )
    assert np.count_nonzero(own) > 10
    np.testing.assert_allclose(found, own, rtol=1e-12, atol=1e-12)


def test_gaps_gradients_and_bounds(watched):
    """Gaps and gradients are those of the elements, one by one and together; no rate exceeds its bound."""
    eom, terms, q, v = watched
    table = terms.table(np.zeros(1), np.r_[q, v][None, :], np.zeros(0))
    gaps, rates, bounds = terms.gaps(table)
    own = ca.vertcat(*[e.gap for e in terms.owners])
    function = ca.Function("own", [eom.q], [own, ca.densify(ca.jacobian(own, eom.q))])
    values, gradients = (part.full() for part in function(q))
    np.testing.assert_allclose(gaps[0], values.ravel(), atol=1e-15)
    np.testing.assert_allclose(rates[0], gradients @ v, atol=1e-12)
    assert np.all(np.abs(rates) <= bounds + 1e-12)
    for k in range(len(terms.owners)):
        np.testing.assert_allclose(terms.gradient(k, table)[0], gradients[k], atol=1e-12)
        alone = terms.gaps(table, np.array([k]))
        assert [float(part[0]) for part in alone] == [gaps[0, k], rates[0, k], bounds[0, k]]


def test_courses_are_those_of_the_elements(watched):
    eom, terms, q, v = watched
    table = terms.table(np.zeros(1), np.r_[q, v][None, :], np.zeros(0))
    found = terms.courses(table, terms.gaps(table)[0])[0]
    smoothings = smoothings_of(terms)
    own = ca.vertcat(*[s.expression for s in smoothings], *[s.scale for s in smoothings])
    np.testing.assert_allclose(found, ca.Function("own", [eom.q, eom.v], [own])(q, v).full().ravel(), atol=1e-12)
