"""What is kept with an object: made once, by whatever number of threads, within bounds, and never copied."""

import copy
import gc
import pickle
import threading
import time
import weakref

import casadi as ca
import numpy as np
import pytest
from threads import together

import mbdcasadi as mbd
from mbdcasadi.model.cache import RECENT, Cache, ExpressionKey


def pendulum(**more):
    arm = mbd.Body("arm", mass=1.0, inertia=0.1, pose=(0.5, 0, 0))
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), arm.at(-0.5, 0))
    return arm, mbd.Mechanism(bodies=[arm], joints=[hinge], forces=[mbd.Gravity()], **more)


def test_a_value_is_made_once_by_eight_threads():
    cache, made = Cache(), []

    def make():
        made.append(threading.get_ident())
        time.sleep(0.05)
        return object()

    values = together([lambda: cache.get_or_create("key", make)] * 8)
    assert len(made) == 1
    assert len(set(map(id, values))) == 1


def test_a_value_may_be_made_of_another_one():
    cache = Cache()
    assert cache.get_or_create("sum", lambda: cache.get_or_create("part", lambda: 2) + 1) == 3
    assert dict(cache) == {"part": 2, "sum": 3}


def test_a_failure_is_not_kept():
    cache = Cache()
    with pytest.raises(ZeroDivisionError):
        cache.get_or_create("key", lambda: 1 / 0)
    assert cache.get_or_create("key", lambda: 7) == 7


def test_bounded_values_go_the_least_recent_first_and_the_others_stay():
    cache = Cache(recent=3)
    cache.get_or_create("kept", lambda: "for good")
    for key in (1, 2, 3):
        cache.get_or_create(key, lambda key=key: -key, bounded=True)
    cache.get_or_create(1, lambda: pytest.fail("it is there"), bounded=True)
    cache.get_or_create(4, lambda: -4, bounded=True)
    assert set(cache) == {"kept", 1, 3, 4}
    assert cache[4] == -4 and cache["kept"] == "for good"


def test_threads_derive_one_set_of_equations():
    _, model = pendulum()
    found = together([lambda: mbd.equations(model)] * 8)
    assert len(set(map(id, found))) == 1


@pytest.mark.slow
def test_threads_evaluate_expressions_of_one_motion():
    """Against the same expressions evaluated one after the other."""
    arm, model = pendulum()
    motion = mbd.simulate(model, np.linspace(0, 1, 21))
    expressions = [mbd.sin(k * arm.phi) + arm.omega**2 for k in range(2 * RECENT)]
    wanted = [np.sin(k * motion[arm.phi]) + motion[arm.omega] ** 2 for k in range(2 * RECENT)]
    found = together([lambda k=k: [motion[e] for e in expressions[k::4]] for k in range(4)])
    for k in range(4):
        assert np.allclose(found[k], wanted[k::4], rtol=1e-13, atol=0)


@pytest.mark.slow
def test_bounded_values_of_sizes_go_until_the_rest_is_small_enough():
    """The most recent one stays however large it is."""
    cache = Cache(recent=10, size=len)
    for text in ("a", "bb", "cccc", "ddddd"):
        cache.get_or_create(text, lambda text=text: text, bounded=True)
    assert list(cache) == ["cccc", "ddddd"]
    cache.get_or_create("large", lambda: 20 * "e", bounded=True)
    assert list(cache) == ["large"]


def test_a_thousand_expressions_leave_no_more_than_the_most_recent_ones():
    arm, model = pendulum()
    state = mbd.assemble(model)
    before = len(model.cache)
    for k in range(1000):
        assert state[k * arm.x + arm.y] == pytest.approx(0.5 * k, abs=1e-9)
    assert len(model.cache) <= before + RECENT


def test_the_same_expression_is_compiled_once():
    arm, model = pendulum()
    eom, expression = mbd.equations(model), ca.sin(arm.phi)
    assert eom.function(expression) is eom.function(ca.SX(expression))


@pytest.mark.slow
def test_expressions_that_are_gone_are_not_taken_for_new_ones():
    """A node's address is used again after the node is gone; the value must be that of the new expression."""
    arm, model = pendulum()
    state = mbd.assemble(model, [arm.phi == 0.3])
    for k in range(3 * RECENT):
        assert state[arm.phi + k] == pytest.approx(0.3 + k, abs=1e-9)


def test_key_of_an_expression():
    x = ca.SX.sym("x")
    e = ca.vertcat(x, 0, 2 * x)
    assert ExpressionKey(e) == ExpressionKey(ca.SX(e)) and hash(ExpressionKey(e)) == hash(ExpressionKey(ca.SX(e)))
    assert ExpressionKey(e) != ExpressionKey(e.T)
    assert ExpressionKey(e) != ExpressionKey(ca.sparsify(e))
    assert ExpressionKey(e) != ExpressionKey(ca.vertcat(x, 0, x))


def test_copies_are_empty_and_can_be_pickled():
    cache = Cache(recent=5)
    cache.get_or_create("key", threading.Lock)
    for twin in (copy.copy(cache), copy.deepcopy(cache), pickle.loads(pickle.dumps(cache))):
        assert len(twin) == 0 and len(cache) == 1
        assert twin.get_or_create("key", lambda: 1) == 1


def test_a_mechanism_goes_with_what_was_compiled_for_it():
    arm, model = pendulum()
    mbd.simulate(model, duration=0.1)[arm.phi]
    gone = weakref.ref(model)
    del model
    gc.collect()
    assert gone() is None


@pytest.mark.parametrize("thing", ["mechanism", "body", "marker", "joint", "parameter"])
def test_pickling_a_model_says_what_to_do(thing):
    k = mbd.Parameter("k", 1.0)
    arm, model = pendulum(parameters=[k])
    things = {"mechanism": model, "body": arm, "marker": arm.at(0, 0), "joint": model.joint("hinge"), "parameter": k}
    with pytest.raises(mbd.ModelError, match=r"cannot be pickled.*calling the same function there.*save"):
        pickle.dumps(things[thing])


def test_laws_in_numbers_can_be_pickled():
    program = pickle.loads(pickle.dumps(mbd.MotionProgram(mbd.rise(1, 2.0), mbd.fall(1))))
    assert program(1.0) == 2.0
