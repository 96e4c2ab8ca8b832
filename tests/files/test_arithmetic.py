"""Arithmetic in t, against Python's own on numbers, and what is refused."""

import math
from random import Random

import casadi as ca
import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.files.arithmetic import FUNCTIONS, LONGEST, parse_arithmetic

TIME = 0.37


def value(text, time=TIME):
    """Value of the text at a time."""
    return float(ca.Function("f", [mbd.t], [parse_arithmetic(text, "test")])(time))


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("0", 0.0),
        ("-9.81 * 2", -19.62),
        (" 1e-3\t", 1e-3),
        (".5 + 2.", 2.5),
        ("sin(10*t)", math.sin(10 * TIME)),
        ("pi/2 + 2*pi*t", math.pi / 2 + 2 * math.pi * TIME),
        ("t^2", TIME**2),
        ("-t^2", -(TIME**2)),
        ("(-t)^2", TIME**2),
        ("2^-t", 2**-TIME),
        ("2*t^3/4", 2 * TIME**3 / 4),
        ("t**2 - t ** 3", TIME**2 - TIME**3),
        ("(2^3)^2", 64.0),
        ("2^(3^2)", 512.0),
        ("2^(-(3^2))", 2.0**-9),
        ("8/2/2", 2.0),
        ("5 - 3 - 1", 1.0),
        ("+-+t", -TIME),
        ("t.*2 + t.^2 + 3./t", 2 * TIME + TIME**2 + 3 / TIME),  # Matlab's operations by element
        ("2.*t", 2 * TIME),
        ("1 +\n  t", 1 + TIME),
    ],
)
def test_arithmetic_means_what_it_says(text, expected):
    """Precedence is that of mathematics: powers before signs, and from left to right."""
    assert value(text) == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize("name", sorted(FUNCTIONS))
def test_functions_are_those_of_the_math_module(name):
    """Each function at a point within its domain."""
    reference = abs if name == "abs" else getattr(math, name)
    assert value(f"{name}(t)") == pytest.approx(reference(TIME), rel=1e-14)


def random_tree(random, depth):
    """Random arithmetic of t, written out."""
    if depth == 0 or random.random() < 0.2:
        return "t" if random.random() < 0.4 else repr(random.uniform(0.1, 10))
    inner = random_tree(random, depth - 1)
    kind = random.choice(["binary", "binary", "-", "sin", "square"])
    if kind == "binary":
        return f"({inner} {random.choice('+-*')} {random_tree(random, depth - 1)})"
    return {"-": f"-{inner}", "sin": f"sin({inner})", "square": f"({inner})^2"}[kind]


def test_any_tree_agrees_with_python():
    """Random arithmetic, against Python's evaluation of the same text."""
    random = Random(1)
    for text in (random_tree(random, 4) for _ in range(200)):
        reference = eval(text.replace("^", "**"), {"sin": np.sin, "t": np.float64(TIME)})
        assert value(text) == pytest.approx(float(reference), rel=1e-12, abs=1e-12), text


def test_constants_do_not_depend_on_time():
    """What cancels or is multiplied by zero is constant, so that no driver is made of it."""
    assert parse_arithmetic("0*t + 3", "test").is_constant()
    assert not parse_arithmetic("t", "test").is_constant()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "empty"),
        ("   ", "empty"),
        ("NONE", "'NONE' is not known at character 1"),
        ("2*x", "'x' is not known at character 3"),
        ("t^2 + foo(t)", "'foo' is not known at character 7"),
        ("2t", "cannot be read at character 1"),
        ("sin(t", "cannot be read at character 4"),
        ("2 ^^ 3", "cannot be read"),
        ("2^3^2", "parentheses at character 3"),
        ("2^-3^2", "parentheses"),
        ("2**t**2", "parentheses"),
        ("sin(t, 2)", "sin takes one argument"),
        ("sin()", "sin takes one argument"),
        ("sin", "'sin' is not known"),
        ("1/0", "value is inf"),
        ("log(0)", "value is -inf"),
        ("sqrt(-1)", "value is nan"),
        ("9^(9^(9^9))", "value is inf"),
        ("1e999", "too large"),
        ("__import__('os')", "has no meaning"),
        ("__import__", "not known"),
        ("t.real", "not arithmetic"),
        ("t.__class__", "not arithmetic"),
        ("True", "not arithmetic"),
        ("2j", "not arithmetic"),
        ("t//2", "not arithmetic"),
        ("t if t else 1", "not arithmetic"),
        ("t and 1", "not arithmetic"),
        ("(t, 1)", "not arithmetic"),
        ("sin(*t)", "not arithmetic"),
        ("π*t", "'π' has no meaning at character 1"),
        ("t # comment", "has no meaning"),
        ("-" * 5000 + "t", "nested too deeply"),
        ("t" * (LONGEST + 1), "characters"),
    ],
)
def test_anything_else_is_refused(text, says):
    """The message says whose text it is, the text, and the place in it."""
    with pytest.raises(mbd.FileError) as caught:
        parse_arithmetic(text, "driver 'd': fun")
    assert says in str(caught.value) and "driver 'd': fun = " in str(caught.value)
    assert "\n" not in str(caught.value)
