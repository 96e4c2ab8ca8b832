"""Time, inputs, parameters, states and coordinates, and the chain rule."""

from __future__ import annotations

import copy
import inspect
import pydoc

import casadi as ca
import numpy as np
import pytest

import mbdcasadi as mbd

KINDS = [
    lambda name, **more: mbd.Input(name, **more),
    lambda name, **more: mbd.Parameter(name, more.pop("value", 1.0), **more),
    lambda name, **more: mbd.StateVariable(name, **more),
]
by_kind = pytest.mark.parametrize("make", KINDS, ids=["Input", "Parameter", "StateVariable"])


@by_kind
def test_symbols_are_expressions_with_a_label_and_limits(make):
    """They are ``casadi.SX``; ``.name()`` stays CasADi's own."""
    symbol = make("s", lower=-2, upper=3)
    assert isinstance(symbol, ca.SX)
    assert symbol.label == "s" and symbol.name() == "s"
    assert (symbol.lower, symbol.upper) == (-2.0, 3.0)
    assert repr(symbol).endswith("('s')")
    assert float(ca.Function("f", [symbol], [2 * symbol**2 + 1])(3)) == 19


@by_kind
def test_limits_are_infinite_unless_given(make):
    """No bound by default; an infinite bound can be written."""
    assert (make("s").lower, make("s").upper) == (-np.inf, np.inf)
    assert make("s", lower=-np.inf, upper=4).upper == 4.0


@by_kind
@pytest.mark.parametrize(
    ("limits", "words"),
    [
        ({"lower": 2, "upper": 1}, ["'s'", "lower", "2", "upper", "1"]),
        ({"value": -6, "lower": 6}, ["'s'", "value", "-6", "6", "lower=, upper="]),
        ({"lower": float("nan")}, ["'s'", "lower"]),
        ({"upper": "high"}, ["'s'", "upper", "high"]),
    ],
)
def test_wrong_limits_are_refused(make, limits, words):
    """The message names the symbol and the limit."""
    with pytest.raises(mbd.ModelError) as error:
        make("s", **limits)
    assert all(word in str(error.value) for word in words), error.value


@by_kind
def test_copies_are_the_same_symbol(make):
    """A copy would be a stranger to the model."""
    symbol = make("s")
    assert copy.copy(symbol) is symbol
    assert copy.deepcopy(symbol) is symbol
    assert copy.deepcopy({"key": [symbol]})["key"][0] is symbol


@by_kind
@pytest.mark.parametrize("name", ["label", "value", "lower", "upper"])
def test_symbols_do_not_change(make, name):
    """What was computed from a value would go on with the old one."""
    symbol = make("s", value=1.0, lower=0.0, upper=2.0)
    with pytest.raises(AttributeError, match=f"'s'.*instead of setting {name}.*parameters="):
        setattr(symbol, name, 0.5)
    assert (symbol.label, symbol.value, symbol.lower, symbol.upper) == ("s", 1.0, 0.0, 2.0)


@by_kind
def test_symbols_are_keys(make):
    """Two symbols of one name are two keys."""
    first, second = make("s"), make("s")
    values = {first: 1, second: 2}
    assert values[first] == 1 and values[second] == 2


@by_kind
@pytest.mark.parametrize("label", ["", None, 7])
def test_a_symbol_needs_a_name(make, label):
    """A text that is not empty."""
    with pytest.raises(mbd.ModelError, match="name"):
        make(label)


def test_values():
    """The default of an input and a state is zero; a parameter has one within its limits."""
    assert mbd.Input("u").value == 0.0
    assert mbd.Input("u", value=2).value == 2.0
    assert mbd.StateVariable("z").value == 0.0
    assert mbd.Parameter("k", 3).value == 3.0
    with pytest.raises(mbd.ModelError, match=r"'k'.*value = 3"):
        mbd.Parameter("k", 3, upper=2)
    nan = float("nan")
    for make in (lambda: mbd.Input("s", nan), lambda: mbd.Parameter("s", nan), lambda: mbd.StateVariable("s", nan)):
        with pytest.raises(mbd.ModelError, match=r"'s'.*finite"):
            make()


def test_a_coordinate_has_rates():
    """Extra coordinates differentiate like those of bodies."""
    s = mbd.Coordinate("s", 0.4)
    assert s.value == 0.4
    assert ca.is_equal(mbd.time_derivative(s), s.velocity)
    assert ca.is_equal(mbd.time_derivative(mbd.time_derivative(s)), s.acceleration)


# --- the chain rule ---------------------------------------------------------------------------
@pytest.fixture
def arm():
    """A body to differentiate."""
    return mbd.Body("arm", mass=1, inertia=1)


def same(left, right, *symbols) -> bool:
    """Whether two expressions agree at random numbers."""
    function = ca.Function("f", [ca.veccat(*symbols)], [left, right])
    a, b = function(np.random.default_rng(0).normal(size=sum(s.numel() for s in symbols)))
    return bool(np.allclose(a.full(), b.full(), rtol=1e-13, atol=1e-13))


def test_rate_through_positions_velocities_and_time(arm):
    """``d/dt (sin(phi) x t + omega) = cos(phi) omega x t + sin(phi) vx t + sin(phi) x + alpha``."""
    t, phi, x = mbd.t, arm.phi, arm.x
    rate = mbd.time_derivative(mbd.sin(phi) * x * t + arm.omega)
    by_hand = mbd.cos(phi) * arm.omega * x * t + mbd.sin(phi) * arm.vx * t + mbd.sin(phi) * x + arm.alpha
    assert same(rate, by_hand, t, arm.q, arm.v, arm.a)


def test_rate_keeps_the_shape(arm):
    """Columns and matrices."""
    marker = arm.at(1, 2)
    assert mbd.time_derivative(marker.position).shape == (2, 1)
    assert mbd.time_derivative(marker.axes).shape == (2, 2)
    assert mbd.time_derivative(marker.axes.T).shape == (2, 2)
    assert same(mbd.time_derivative(marker.axes.T), mbd.time_derivative(marker.axes).T, arm.q, arm.v)


def test_constants_and_parameters_do_not_change(arm):
    """Rate zero for numbers; parameters are factors."""
    k = mbd.Parameter("k", 2.0)
    assert mbd.time_derivative(3.0).is_zero()
    assert mbd.time_derivative(k).is_zero()
    assert same(mbd.time_derivative(k**2 * arm.x), k**2 * arm.vx, k, arm.q, arm.v)


def test_rate_of_kinetic_energy_is_power(arm):
    """``d/dt (m v·v / 2) = m v·a``."""
    assert same(mbd.time_derivative(0.5 * mbd.sumsqr(arm.v)), mbd.dot(arm.v, arm.a), arm.v, arm.a)


def test_states_take_their_rate_from_the_mechanism(arm):
    """``ż`` is what the mechanism says, at any depth."""
    u, current = mbd.Input("u"), mbd.StateVariable("current")
    motor = mbd.Torque("motor", arm, 3 * current)
    machine = mbd.Mechanism(bodies=[arm], forces=[motor], inputs=[u], states={current: u - 2 * current - arm.omega})
    rate = mbd.time_derivative(current * arm.phi, machine)
    assert same(rate, (u - 2 * current - arm.omega) * arm.phi + current * arm.omega, u, current, arm.q, arm.v)


def test_rates_that_are_not_known_are_refused(arm):
    """Accelerations, multipliers, rates of inputs and strangers; the message names the symbol."""
    pin, u = mbd.Revolute("pin", mbd.ground.at(0, 0), arm.at(0, 0)), mbd.Input("u")
    unknown = {
        "input rate 'u.rate'": u.rate,
        "arm.alpha": arm.alpha * arm.x,
        "pin.multipliers": pin.reaction_on(arm).force,
        "symbol 'stranger'": ca.SX.sym("stranger"),
    }
    for words, expression in unknown.items():
        with pytest.raises(mbd.ExpressionError, match="rate of") as error:
            mbd.time_derivative(expression)
        assert words in str(error.value)


def test_the_rate_of_an_input_is_a_symbol_of_its_own(arm):
    """Optimal control knows it; anything else that contains it is refused."""
    u = mbd.Input("u")
    rate = mbd.time_derivative(u * arm.x)
    assert same(rate, u.rate * arm.x + u * arm.vx, u, u.rate, arm.q, arm.v)
    machine = mbd.Mechanism(bodies=[arm], forces=[mbd.Torque("motor", arm, u)], inputs=[u])
    with pytest.raises(mbd.ExpressionError, match=r"input rate 'u\.rate'.*optimal control"):
        mbd.assemble(machine)[u.rate]
    base = mbd.TSDA("spring", mbd.ground.at(0, u), arm.at(0, 0), stiffness=1.0, damping=1.0)
    with pytest.raises(
        mbd.ExpressionError, match=r"spring.*input rate 'u\.rate'.*a StateVariable whose rate is an input"
    ):
        mbd.Mechanism(bodies=[arm], forces=[base], inputs=[u])


def test_a_state_without_its_mechanism_is_refused_with_a_hint():
    """The remedy is the second argument."""
    z = mbd.StateVariable("z")
    with pytest.raises(mbd.ExpressionError, match=r"state 'z'.*second argument"):
        mbd.time_derivative(z**2)


def test_symbols_stay_known_when_only_an_expression_is_kept():
    """The rate of a coordinate is known for as long as something of its body is in use."""
    marker = mbd.Body("gone", 1, 1).at(1, 0)
    assert mbd.time_derivative(marker.x).numel() == 1


def test_value_of_a_state_variable_by_its_former_name():
    """For one version, with a warning."""
    assert mbd.StateVariable("z", 0.3).value == mbd.StateVariable("z", value=0.3).value == 0.3
    with pytest.warns(DeprecationWarning, match="state variable 'z': initial= is called value= now"):
        state = mbd.StateVariable("z", initial=0.3)
    with pytest.warns(DeprecationWarning, match="state variable 'z': initial is called value now"):
        assert state.initial == 0.3


@pytest.mark.parametrize("kind", [mbd.Input, mbd.Parameter, mbd.StateVariable, mbd.Coordinate])
def test_help_begins_with_the_symbol_s_own_text(kind):
    """Class and constructor, which would else have the text of CasADi's matrices."""
    assert "casadi" not in inspect.getdoc(kind).split("\n\n")[0].lower()
    assert inspect.getdoc(kind.__init__) == "Make the symbol; see the class for its arguments."
    text = pydoc.plain(pydoc.render_doc(kind))
    assert text.index(inspect.getdoc(kind).splitlines()[0]) < 300


@pytest.mark.parametrize("span", [5, (1,), (0, 1, 2), ("low", 1)])
def test_span_of_a_coordinate_has_two_ends(span):
    with pytest.raises(mbd.ModelError, match="coordinate 's': span"):
        mbd.Coordinate("s", 0.4, span)
