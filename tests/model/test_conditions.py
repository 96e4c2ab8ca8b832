"""Relations of CasADi taken apart into conditions."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.model.conditions import read_conditions

a, b = mbd.Body("a", 1, 1), mbd.Body("b", 1, 1)
k = mbd.Parameter("k", 2.0)
SYMBOLS = ca.vertcat(a.q, b.q, k)
AT = np.array([1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0])


def one(relation):
    """The only condition of a relation."""
    (condition,) = read_conditions([relation])
    return condition


def value(condition) -> float:
    """Value of its expression at a.x = 1 … b.phi = 6, k = 7."""
    return float(ca.Function("f", [SYMBOLS], [condition.expression])(AT))


@pytest.mark.parametrize(
    ("relation", "equality", "difference", "label"),
    [
        (a.phi == 0.5, True, 2.5, "a.phi == 0.5"),
        (0.5 == a.phi, True, 2.5, "a.phi == 0.5"),
        (np.float64(0.5) == a.phi, True, 2.5, "a.phi == 0.5"),
        (a.phi == 0, True, 3.0, "a.phi == 0"),
        (a.x == b.x, True, -3.0, "a.x == b.x"),
        (a.x - b.x == 0, True, -3.0, "a.x - b.x == 0"),
        (a.x == k, True, -6.0, "a.x == k"),  # though Python asks the subclass Parameter first
        (a.x <= 4, False, -3.0, "a.x <= 4"),
        (a.x < 4, False, -3.0, "a.x <= 4"),
        (a.x >= 4, False, 3.0, "4 <= a.x"),
        (a.x > 4, False, 3.0, "4 <= a.x"),
        (4 >= a.x, False, -3.0, "a.x <= 4"),
        (np.float64(4) <= a.x, False, 3.0, "4 <= a.x"),
        (a.x**2 <= -1, False, 2.0, None),
    ],
)
def test_scalar_relations(relation, equality, difference, label):
    """Left less right; a strict comparison counts as the other one; the label reads as written."""
    condition = one(relation)
    assert condition.equality is equality
    assert value(condition) == difference
    if label:
        assert condition.label == repr(condition) == label


def test_bounded_is_two_conditions():
    """``lower <= expression`` and ``expression <= upper``; limits may be parameters."""
    low, high = read_conditions([mbd.bounded(-5, a.x, 3)])
    assert not low.equality and not high.equality
    assert (value(low), value(high)) == (-6, -2)
    low, high = read_conditions([mbd.bounded(-k, a.x, k)])
    assert (value(low), value(high)) == (-8, -6)


def test_bounded_with_a_limit_that_always_holds():
    """A square is never negative: what is left is the upper limit."""
    conditions = read_conditions([mbd.bounded(0, a.x**2, 4)])
    assert [value(c) for c in conditions if c.depends_on("position")][-1] == -3
    assert all(not c.equality for c in conditions)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: mbd.bounded(2, a.x, 1), "above"),
        (lambda: mbd.bounded(0, 3, 4), "number 3"),
        (lambda: mbd.bounded(0, a.position, 4), "scalar"),
        (lambda: mbd.bounded(float("nan"), a.x, 4), "lower"),
    ],
)
def test_wrong_bounds_are_refused(make, words):
    """Limits the wrong way round, numbers, vectors."""
    with pytest.raises(mbd.MechanismError, match=words):
        make()


@pytest.mark.parametrize("target", [(1.5, 2.5), [1.5, 2.5], np.array([1.5, 2.5]), ca.DM([1.5, 2.5])])
def test_vector_relations_are_rows(target):
    """One condition a component, whatever the right side is made of."""
    conditions = read_conditions([a.position == target])
    assert [value(c) for c in conditions] == [-0.5, -0.5]
    assert [c.label for c in conditions] == ["a.x == 1.5", "a.y == 2.5"]


def test_relations_of_two_vectors():
    """Component by component."""
    assert [value(c) for c in read_conditions([a.position == b.position, a.q <= b.q])] == [-3] * 5
    assert [value(c) for c in read_conditions([a.position == mbd.vertcat(b.x, 2)])] == [-3, 0]


def test_one_relation_needs_no_list():
    """A relation, a bounded one, none."""
    assert len(read_conditions(a.phi == 0.3)) == 1
    assert len(read_conditions(a.position == (1, 2))) == 2
    assert len(read_conditions(mbd.bounded(0, a.x, 1))) == 2
    assert read_conditions(()) == ()
    assert len(read_conditions(relation for relation in (a.x == 1, a.y == 2))) == 2


def test_conditions_know_what_they_depend_on():
    """By kind of symbol."""
    condition = one(a.vx + k == 3)
    assert condition.depends_on("velocity") and condition.depends_on("parameter")
    assert not condition.depends_on("position", "input", "state")


@pytest.mark.parametrize(
    ("relation", "words"),
    [
        (lambda: a.phi, "not a relation.*a.phi == value"),
        (lambda: a.phi + 1, "not a relation"),
        (lambda: a.phi != 0.3, "!="),
        (lambda: True, "not a relation"),
        (lambda: 3.0, "not a relation"),
        (lambda: "a.phi == 3", "not a relation"),
        (lambda: a.x == a.x, "holds always"),
        (lambda: a.x**2 >= 0, "holds always"),
        (lambda: ca.SX(1) == 2, "can never hold"),
        (lambda: ca.logic_and(a.x <= 1, a.y <= 1), "not a relation"),
        (lambda: ca.MX.sym("x") == 1, "not a relation"),
        (lambda: a.position == (b.x, 2), "not a relation.*mbd.vertcat"),
        (lambda: a.x == float("nan"), "finite|nan"),
        (lambda: a.x == float("inf"), "finite|inf"),
    ],
)
def test_what_is_no_condition_is_refused(relation, words):
    """The message says which entry it is, and what to write."""
    with pytest.raises(mbd.ConditionError, match=words) as error:
        read_conditions([a.y == 1, relation()])
    assert "condition 2" in str(error.value)


@pytest.mark.parametrize("conditions", [{a.phi: 0.3}, "a.phi == 0.3", 3.0, None])
def test_conditions_are_a_list(conditions):
    """A mapping, a text or a number is refused."""
    with pytest.raises(mbd.ConditionError, match="list of relations"):
        read_conditions(conditions)


LENGTHS = {
    "norm": mbd.norm(a.position - b.position) == 0,
    "distance": mbd.distance(a, b) == 0,
    "no more than nothing": mbd.distance(a, b) <= 0,
    "on the right": 0 == mbd.distance(a, b),
    "CasADi's norm": ca.norm_2(a.position - b.position) == 0,
    "sum of squares": (a.x - b.x) ** 2 + (a.y - b.y) ** 2 == 0,
    "square of a length": mbd.norm(a.position - b.position) ** 2 == 0,
}


@pytest.mark.parametrize("relation", LENGTHS.values(), ids=LENGTHS)
def test_a_length_that_is_to_be_zero_is_a_condition_for_each_component(relation):
    """Its gradient is zero there or does not exist; that of each component is a unit vector."""
    conditions = read_conditions([relation])
    assert sorted(abs(value(c)) for c in conditions) == [3.0, 3.0]
    assert all(c.equality and c.component for c in conditions)
    assert len({c.label for c in conditions}) == 2
    for condition, symbol in zip(conditions, (0, 1), strict=True):
        slopes = ca.Function("s", [SYMBOLS], [ca.jacobian(condition.expression, SYMBOLS)])(np.zeros(7)).full().ravel()
        assert np.abs(slopes[[symbol, 3 + symbol]]).tolist() == [1.0, 1.0] and np.abs(slopes).sum() == 2.0


def test_other_conditions_on_lengths_stay_as_they_are():
    """A length that is not zero, a limit that may hold, a sum of squares and more."""
    for relation in (
        mbd.distance(a, b) == 1,
        mbd.distance(a, b) <= 0.1,
        mbd.distance(a, b) == k,
        (a.x - b.x) ** 2 + a.y == 0,
        (a.x - b.x) ** 2 - (a.y - b.y) ** 2 == 0,
        0 <= mbd.distance(a, b),
    ):
        condition = one(relation)
        assert not condition.component and condition.equality == ("==" in condition.label)


def test_one_component_keeps_the_label():
    """A magnitude or a square that is to be zero is the quantity that is; components that are zero are left out."""
    assert one(a.x**2 == 0).label == "a.x**2 == 0" and value(one(a.x**2 == 0)) == 1.0
    assert value(one(ca.fabs(a.y) <= 0)) == 2.0
    assert value(one(mbd.norm([a.x, 0]) == 0)) == 1.0
    with pytest.raises(mbd.ConditionError, match=r"can never hold, since one component is never zero"):
        read_conditions([mbd.norm([a.x, 1]) == 0])


def test_a_value_with_its_unit():
    """Where the unit of the expression is known."""
    assert one(a.x == 1).with_unit(0.12345) == "0.123 m"
    assert one(k == 1).with_unit(0.5) == "0.5"
