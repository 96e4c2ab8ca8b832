"""Integrators are lent to one borrower at a time, and kept in a bounded number."""

import threading

import numpy as np
from linkages import pendulum
from threads import together

import mbdcasadi as mbd
from mbdcasadi.numerics.lending import ALIKE, KEPT, Lending


def test_nobody_gets_what_another_has():
    lending, taken, twice = Lending(), set(), []
    lock = threading.Lock()

    def work():
        for _ in range(300):
            thing = lending.borrow("key", object)
            with lock:
                twice.extend([thing] * (thing in taken))
                taken.add(thing)
            with lock:
                taken.remove(thing)
            lending.give_back("key", thing)

    together([work] * 8)
    assert not twice


def test_the_number_is_bounded():
    lending = Lending()
    for key in range(3 * KEPT):
        for _ in range(3 * ALIKE):
            lending.give_back(key, object())
    made = []
    for key in range(3 * KEPT):
        for _ in range(3 * ALIKE):
            lending.borrow(key, lambda: made.append(1))
    assert len(made) == 3 * KEPT * 3 * ALIKE - KEPT * ALIKE


def test_as_many_are_kept_as_were_lent_at_once():
    lending = Lending(alike=float("inf"))
    first, second = (lending.borrow("key", object) for _ in range(2))
    assert first is not second and lending.idle == 0
    for borrowed in (first, second):
        lending.give_back("key", borrowed)
    assert lending.idle == 2
    assert lending.borrow("key", object) in (first, second) and lending.idle == 1


def test_a_second_run_compiles_nothing(monkeypatch):
    """The integrator of a mechanism serves later runs with other starts, parameters and numbers as inputs."""
    import casadi as ca

    g = mbd.Parameter("g", 9.81)
    u = mbd.Input("u", value=0.0)
    rod = mbd.Body("rod", mass=1.0, inertia=1 / 12, pose=(0.5, 0, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), rod.at(-0.5, 0))
    forces = [mbd.Gravity((0, -g)), mbd.Torque("motor", rod, u)]
    mechanism = mbd.Mechanism(bodies=[rod], joints=[pin], forces=forces, inputs=[u], parameters=[g])
    times = np.linspace(0, 1, 41)
    first = mbd.simulate(mechanism, times, inputs={u: 0.0}, abstol=1e-8)
    made, original = [], ca.integrator
    monkeypatch.setattr(ca, "integrator", lambda *a: made.append(a) or original(*a))
    again = mbd.simulate(mechanism, times, inputs={u: 0.0}, abstol=1e-8)
    np.testing.assert_array_equal(again.q, first.q)
    assert again.statistics.restarts == first.statistics.restarts
    assert not made
    changed = {"inputs": {u: 1.5}, "parameters": {g: 1.62}, "initial": [rod.omega == 1.0]}
    other = mbd.simulate(mechanism, times, **changed, abstol=1e-8)
    made.clear()  # a motion may be run again with other tolerances of its own
    np.testing.assert_array_equal(mbd.simulate(mechanism, times, **changed, abstol=1e-8).q, other.q)
    assert not made
    fresh = mbd.simulate(mechanism, times, **changed, method=mbd.IDAS(1e-11, 1e-11))
    assert made
    np.testing.assert_allclose(other.q, fresh.q, atol=1e-6)


def test_expressions_as_inputs_are_told_apart():
    """Two expressions of the same kind, made and forgotten in turn, are not taken for each other."""
    u = mbd.Input("u", value=0.0)
    rod = mbd.Body("rod", mass=1.0, inertia=0.1)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), rod.at(0, 0))
    push = mbd.Force("push", rod.at(0, 0), (u, 0))
    mechanism = mbd.Mechanism(bodies=[rod], joints=[rail], forces=[push], inputs=[u])
    for k in range(12):
        for method in ("idas", "dop853"):
            motion = mbd.simulate(mechanism, [0, 0.5, 1.0], inputs={u: (k + 1.0) * mbd.cos(mbd.t)}, method=method)
            assert abs(motion.final[rod.vx] - (k + 1.0) * np.sin(1.0)) < 1e-5 * (k + 1)


def test_threads_share_a_mechanism():
    """Eight runs by IDAS at once are those of one thread."""
    f = pendulum(angle=0.2)
    times = np.linspace(0, 1, 31)

    def run(k):
        return mbd.simulate(f.mechanism, times, initial=[f.rod.omega == k]).q

    expected = [run(k) for k in range(8)]
    found = together([lambda k=k: run(k) for k in range(8)])
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one, other)
