"""Functions written as C: against CasADi's own interpreter, bit by bit."""

import ctypes

import casadi as ca
import numpy as np
import pytest

from mbdcasadi.integrators.native import build
from mbdcasadi.numerics.c_code import PIECE, SHORT, UnsupportedOperation, simplified, tape_of
from mbdcasadi.numerics.operations import OPERATIONS

compiled_only = pytest.mark.skipif(build.compiler() is None, reason="no C compiler")


def in_c(function, *arguments):
    """First result of a function that is written as C and compiled."""
    tape = tape_of(function)
    using = build.compiler()
    source = "#include <math.h>\n" + tape.as_c
    library = build.build(build.key_of("test", source, using.identity), source, "-O1", using)
    code = getattr(library, function.name())
    code.argtypes = [ctypes.c_void_p] * 4 + [ctypes.c_int]
    given = [np.ascontiguousarray(a, float) for a in arguments]
    result, work = np.full(function.nnz_out(0), np.nan), np.zeros(tape.work_in_c + 1)
    arg = (ctypes.c_void_p * len(given))(*[a.ctypes.data for a in given])
    res = (ctypes.c_void_p * function.n_out())(result.ctypes.data)
    assert code(arg, res, None, work.ctypes.data, 0) == 0
    return result


@pytest.fixture(autouse=True)
def _own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("MBDCASADI_CACHE", str(tmp_path))


@pytest.mark.slow
@compiled_only
def test_every_operation():
    """Each operation at ordinary values, at zero, at both signs, and of what is not a number."""
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    expressions = [
        *(f(x) for f in (ca.exp, ca.sin, ca.cos, ca.tan, ca.asin, ca.acos, ca.atan, ca.floor, ca.ceil, ca.fabs)),
        *(f(x) for f in (ca.sign, ca.erf, ca.sinh, ca.cosh, ca.tanh, ca.asinh, ca.atanh, ca.expm1, ca.sqrt, ca.log)),
        *(f(x) for f in (ca.log1p, ca.acosh)),
        *(f(x, y) for f in (ca.fmin, ca.fmax, ca.fmod, ca.atan2, ca.hypot, ca.copysign, ca.remainder, ca.power)),
        x + y,
        x - y,
        x * y,
        x / y,
        1 / x,
        -x,
        x * x,
        x + x,
        x**3,
        x**2.5,
        x**-1.5,
        x < y,
        x <= y,
        x == y,
        x != y,
        ca.logic_not(x),
        ca.logic_and(x, y),
        ca.logic_or(x, y),
        ca.if_else(x < y, ca.sin(x), y),
    ]
    f = ca.Function("f", [x, y], [ca.densify(ca.vertcat(*expressions))])
    written = {row[0] for row in tape_of(f).instructions.tolist()}
    assert len(written) > 0.8 * sum(1 for known in OPERATIONS.values() if known.c)
    points = [(0.3, 0.7), (-0.4, 0.2), (0.0, 1.0), (0.5, -0.5), (2.5, -1.5), (-0.0, 0.0), (1.0, 1.0)]
    for point in [*points, (np.nan, 1.0), (1.0, np.nan), (np.inf, -np.inf)]:
        np.testing.assert_array_equal(in_c(f, *point), f(*point).full().ravel())


@pytest.mark.slow
@compiled_only
@pytest.mark.parametrize("count", [SHORT // 4, 12 * PIECE])
def test_functions_in_pieces(count):
    """Values that are used in later pieces keep their places as long as they are needed, in every order."""
    x = ca.SX.sym("x", 7)
    values = [x[k] for k in range(7)]
    rng = np.random.default_rng(3)
    for _ in range(count):
        a, b = (values[k] for k in rng.integers(max(0, len(values) - 3 * PIECE), len(values), 2))
        values.append(ca.sin(a) + 0.5 * b if rng.random() < 0.5 else 0.7 * a * ca.cos(b))
    f = ca.Function("f", [x], [ca.vertcat(*[values[k] for k in rng.integers(0, len(values), 200)])])
    assert (tape_of(f).size <= SHORT) == (count < PIECE * 2)
    point = rng.normal(size=7)
    np.testing.assert_array_equal(in_c(f, point), f(point).full().ravel())


def test_what_others_wait_for_comes_first():
    """The longest chain of operations comes before shorter ones, what only the last result needs at the end."""
    x, y = ca.SX.sym("x"), ca.SX.sym("y")
    chain = x
    for _ in range(5):
        chain = 1 / (chain + 2)
    f = ca.Function("f", [x, y], [3 * y, y * y + 1, chain, x - y])
    lines = tape_of(f).as_c.splitlines()

    def place(part):
        return next(k for k, line in enumerate(lines) if part in line)

    assert place("res[2]") < place("3.0 *") < place("res[0]")
    assert place("res[2]") < place("+ 1.0") < place("res[1]") < place("if (!res[3])") < place(" - ")


def test_simplified_keeps_values_and_names():
    x = ca.SX.sym("x")
    f = ca.Function("f", [x], [ca.sin(x) * ca.cos(x), ca.sin(x) + ca.cos(x)], ["angle"], ["a", "b"])
    g = simplified(f)
    assert (g.name(), g.name_in(), g.name_out()) == (f.name(), f.name_in(), f.name_out())
    assert g.n_instructions() < f.n_instructions()
    assert [float(part) for part in g(0.3)] == [float(part) for part in f(0.3)]


def test_calls_of_other_functions_are_refused():
    x = ca.MX.sym("x")
    with pytest.raises(UnsupportedOperation, match="caller.*MXFunction"):
        tape_of(ca.Function("caller", [x], [ca.sin(x)]))
