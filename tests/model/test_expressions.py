"""Functions for expressions: values and derivatives against SciPy and closed formulas."""

import casadi as ca
import numpy as np
import pytest
from scipy.interpolate import CubicSpline, PchipInterpolator

from mbdcasadi.errors import ModelError
from mbdcasadi.model import expressions
from mbdcasadi.model.bodies import Body, ground
from mbdcasadi.model.expressions import distance, dot, if_else, norm, positive_power, spline, step


def derivatives(expression, x):
    """Function x -> value, gradient, Hessian."""
    hessian, gradient = ca.hessian(expression, x)
    return ca.Function("derivatives", [x], [expression, gradient, hessian])


def curve(expression_of, points):
    """Value, first and second derivative of a function of one variable, as rows."""
    x = ca.SX.sym("x")
    value = expression_of(x)
    first = ca.jacobian(value, x)
    function = ca.Function("curve", [x], [ca.vertcat(value, first, ca.jacobian(first, x))])
    return function(np.reshape(points, (1, -1))).full()


# Elementary functions


@pytest.mark.parametrize("name", "sin cos tan asin acos atan sinh cosh tanh exp log sqrt fabs sign".split())
def test_elementary_functions_take_numbers_and_symbols(name):
    function = getattr(expressions, name)
    reference = {"asin": "arcsin", "acos": "arccos", "atan": "arctan", "fabs": "abs"}.get(name, name)
    assert function(0.3) == pytest.approx(getattr(np, reference)(0.3), rel=1e-15)
    x = ca.SX.sym("x")
    assert float(ca.Function("f", [x], [function(x)])(0.3)) == pytest.approx(function(0.3), rel=1e-15)


def test_functions_of_two_numbers():
    assert expressions.atan2(1.0, -1.0) == pytest.approx(3 * np.pi / 4)
    assert (expressions.fmax(1.0, 2.0), expressions.fmin(1.0, 2.0)) == (2.0, 1.0)
    assert float(expressions.sumsqr(expressions.vertcat(3, 4))) == 25


def test_if_else_on_numbers_and_symbols():
    assert if_else(2 > 1, 3, 4) == 3.0
    assert isinstance(if_else(False, 3, 4), float)
    found = curve(lambda x: if_else(x > 0, x**2, 0), [-1.0, 2.0])
    np.testing.assert_array_equal(found, [[0, 4], [0, 4], [0, 2]])


def test_if_else_does_not_let_the_other_branch_through():
    values = curve(lambda x: if_else(x > 0, ca.sqrt(x), 7), [-1.0, 4.0])
    np.testing.assert_allclose(values, [[7, 2], [0, 0.25], [0, -1 / 32]])


def test_everything_in_all_is_there():
    assert all(callable(getattr(expressions, name)) for name in expressions.__all__)


# Powers, norms, distances


@pytest.mark.parametrize("exponent", [1, 1.5, 2, 2.2, 3])
def test_positive_power(exponent):
    d = np.array([-2.0, -1e-9, 0.0, 1e-4, 0.5, 2.0])
    found = curve(lambda x: positive_power(x, exponent), d)
    on, safe, n = d > 0, np.where(d > 0, d, 1.0), exponent
    expected = [on * safe**n, on * n * safe ** (n - 1), on * n * (n - 1) * safe ** (n - 2)]
    np.testing.assert_allclose(found, expected, rtol=1e-13)
    assert positive_power(4.0, 1.5) == 8.0 and positive_power(-4.0, 1.5) == 0.0


def test_positive_power_takes_an_exponent_that_is_a_symbol():
    n, x = ca.SX.sym("n"), ca.SX.sym("x")
    function = derivatives(positive_power(x, n), ca.vertcat(x, n))
    for point in ([-1, 1.5], [0, 1.5]):
        assert all(np.all(part.full() == 0) for part in function(point))
    assert float(function([4, 1.5])[0]) == pytest.approx(8)


def test_positive_power_refuses_an_exponent_that_is_not_positive():
    with pytest.raises(ModelError, match=r"exponent must be above 0, got -1\.0"):
        positive_power(ca.SX.sym("x"), -1)


def test_norm_and_its_derivatives_at_zero_and_elsewhere():
    v = ca.SX.sym("v", 2)
    function = derivatives(norm(v), v)
    value, gradient, hessian = (part.full() for part in function([3, 4]))
    assert value == 5
    np.testing.assert_allclose(gradient.ravel(), [0.6, 0.8], rtol=1e-15)
    np.testing.assert_allclose(hessian, (np.eye(2) - np.outer([0.6, 0.8], [0.6, 0.8])) / 5, rtol=1e-12)
    value, gradient, hessian = (part.full() for part in function([0, 0]))
    assert value == 0 and np.all(gradient == 0) and np.all(np.isfinite(hessian))


def test_norm_is_exact_for_small_vectors():
    assert norm([3e-100, 4e-100]) == pytest.approx(5e-100, rel=1e-12)
    assert norm([0, 0]) == 0.0
    assert norm(ca.SX(2, 1)).is_zero()


def test_vectors_may_be_lists_arrays_rows_markers_and_bodies():
    x = ca.SX.sym("x")
    assert dot([1, 2], (3, 4)) == 11.0
    assert dot(np.array([1.0, 2.0]), ca.DM([[3, 4]])) == 11.0
    assert norm(np.array([3.0, 4.0])) == 5.0
    assert float(ca.Function("f", [x], [dot([x, 1], np.array([2, x], dtype=object))])(5)) == 15
    arm = Body("arm", mass=1, inertia=1)
    length = distance(ground.at(0, 0), arm.at(1, 0))
    function = ca.Function("f", [arm.q], [length, distance(arm, [0, 0]), norm(arm)])
    assert [float(value) for value in function([3, 4, np.pi])] == pytest.approx([np.sqrt(20), 5, 5])


def test_distance_where_the_points_coincide():
    arm = Body("arm", mass=1, inertia=1)
    function = derivatives(distance(arm.at(1, 0), ground.at(1, 0)), arm.q)
    assert all(np.all(np.isfinite(part.full())) for part in function([0, 0, 0]))
    assert float(function([0, 0, 0])[0]) == 0
    assert distance((1, 1), (4, 5)) == 5.0


def test_vectors_that_do_not_fit_are_refused():
    with pytest.raises(ModelError, match=r"dot: .* same size, got 2 and 3"):
        dot([1, 2], [1, 2, 3])
    with pytest.raises(ModelError, match=r"distance: takes a vector, a marker or a body, got 'pin'"):
        distance("pin", [1, 2])
    with pytest.raises(ModelError, match=r"norm: .*casadi\.MX"):
        norm(ca.MX.sym("v", 2))


# Step


def test_step_is_smooth_and_constant_outside():
    points = np.array([-5.0, 1.0, 1.5, 2.0, 3.0, 9.0])
    s = np.clip((points - 1) / 2, 0, 1)
    expected = [
        4 - 6 * (10 * s**3 - 15 * s**4 + 6 * s**5),
        -6 * 30 * s**2 * (1 - s) ** 2 / 2,
        -6 * 60 * s * (1 - s) * (1 - 2 * s) / 4,
    ]
    np.testing.assert_allclose(curve(lambda x: step(x, 1, 4, 3, -2), points), expected, atol=1e-13)


def test_step_of_numbers_and_of_parameters():
    assert step(0.5, 0, 0, 1, 10) == 5.0
    assert (step(-1, 0, 2, 1, 10), step(7, 0, 2, 1, 10)) == (2.0, 10.0)
    end, x = ca.SX.sym("end"), ca.SX.sym("x")
    function = ca.Function("f", [x, end], [step(x, 0, 0, end, 10)])
    assert [float(function(x, 4)) for x in (-1, 2, 4, 5)] == [0, 5, 10, 10]


@pytest.mark.parametrize("end", [1, 0.5, np.nan])
def test_step_refuses_an_end_before_its_start(end):
    with pytest.raises(ModelError, match=r"step: x1 must be above x0, got x0 = 1\.0 and x1 = "):
        step(ca.SX.sym("x"), 1, 0, end, 1)


# Splines

XS = np.array([-1.0, -0.4, 0.1, 0.9, 1.3, 2.5, 3.0, 3.2])
YS = np.array([0.3, 1.2, 0.7, 0.75, -0.4, -0.4, 2.0, 1.1])
CLOSED = np.append(YS[:-1], YS[0])
INSIDE = np.sort(np.concatenate([XS, (XS[:-1] + XS[1:]) / 2, np.random.default_rng(1).uniform(-1, 3.2, 40)]))


def scipy_curve(reference, points):
    return np.array([reference(points, order) for order in range(3)])


REFERENCES = {"cubic": CubicSpline, "monotone": PchipInterpolator}


@pytest.mark.parametrize("outside", ["error", "constant", "linear"])
@pytest.mark.parametrize("kind", ["cubic", "monotone"])
def test_spline_and_its_derivatives_are_those_of_scipy(kind, outside):
    found = curve(lambda x: spline(x, XS, YS, kind, outside), INSIDE)
    np.testing.assert_allclose(found, scipy_curve(REFERENCES[kind](XS, YS), INSIDE), rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize(("kind", "points"), [("cubic", 4), ("cubic", 5), ("monotone", 2), ("monotone", 3)])
def test_splines_through_few_points(kind, points):
    xs, ys = XS[:points], YS[:points]
    x = np.linspace(xs[0], xs[-1], 17)
    found = curve(lambda s: spline(s, xs, ys, kind), x)
    np.testing.assert_allclose(found, scipy_curve(REFERENCES[kind](xs, ys), x), rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("seed", range(5))
def test_monotone_spline_of_random_data_is_that_of_scipy(seed):
    random = np.random.default_rng(seed)
    xs = np.cumsum(random.uniform(0.1, 2, 12))
    ys = random.integers(-3, 4, 12).astype(float)
    x = np.linspace(xs[0], xs[-1], 50)
    found = curve(lambda s: spline(s, xs, ys, "monotone"), x)
    np.testing.assert_allclose(found, scipy_curve(PchipInterpolator(xs, ys), x), rtol=1e-10, atol=1e-10)


@pytest.mark.parametrize("seed", range(3))
def test_cubic_spline_by_what_defines_it(seed):
    """A cubic polynomial is met everywhere; of other data two derivatives go on, and the third next to the ends."""
    random = np.random.default_rng(seed)
    xs = np.cumsum(random.uniform(0.1, 2, 9))
    polynomial = np.polynomial.Polynomial(random.normal(size=4), domain=[xs[0], xs[-1]])
    x = np.linspace(xs[0], xs[-1], 50)
    found = curve(lambda s: spline(s, xs, polynomial(xs)), x)
    np.testing.assert_allclose(found, [polynomial.deriv(k)(x) if k else polynomial(x) for k in range(3)], atol=1e-9)
    symbol = ca.SX.sym("x")
    value = spline(symbol, xs, random.normal(size=9))
    parts = [value]
    for _ in range(3):
        parts.append(ca.jacobian(parts[-1], symbol))
    function = ca.Function("f", [symbol], [ca.vertcat(*parts)])
    before, after = (function((xs[1:-1] + side * 1e-9)[None, :]).full() for side in (-1, 1))
    size = np.abs(after).max(axis=1)[:, None]
    np.testing.assert_allclose(after[:3] / size[:3], before[:3] / size[:3], atol=1e-6)
    np.testing.assert_allclose(after[3, [0, -1]] / size[3], before[3, [0, -1]] / size[3], atol=1e-6)
    assert np.all(np.abs(after[3] - before[3])[1:-1] > 1e-3)


def test_monotone_spline_by_the_formula_of_fritsch_and_butland():
    """Slopes: the weighted harmonic mean of the rises beside a point, zero at an extremum of the data."""
    found = curve(lambda s: spline(s, XS, YS, "monotone"), XS[1:-1])[1]
    h, rise = np.diff(XS), np.diff(YS) / np.diff(XS)
    for k, slope in enumerate(found):
        before, after = 2 * h[k + 1] + h[k], h[k + 1] + 2 * h[k]
        if rise[k] * rise[k + 1] <= 0:
            assert slope == 0
        else:
            assert slope == pytest.approx((before + after) / (before / rise[k] + after / rise[k + 1]), rel=1e-12)


def test_linear_spline():
    found = curve(lambda x: spline(x, XS, YS, "linear"), INSIDE)
    np.testing.assert_allclose(found[0], np.interp(INSIDE, XS, YS), rtol=1e-13, atol=1e-14)
    slopes = np.diff(YS) / np.diff(XS)
    piece = np.clip(np.searchsorted(XS, INSIDE, side="right") - 1, 0, len(XS) - 2)
    np.testing.assert_allclose(found[1], slopes[piece], rtol=1e-12)
    assert np.all(found[2] == 0)


@pytest.mark.parametrize("outside", ["error", "constant", "linear", "periodic"])
@pytest.mark.parametrize("kind", ["cubic", "monotone", "linear"])
def test_spline_meets_its_points_exactly(kind, outside):
    assert np.array_equal(curve(lambda x: spline(x, XS, CLOSED, kind, outside), XS)[0], CLOSED)


def test_spline_of_many_points_is_that_of_scipy():
    xs = np.linspace(0, 1, 400) ** 1.5
    ys = np.sin(30 * xs)
    x = np.linspace(0, 1, 777)
    reference = scipy_curve(CubicSpline(xs, ys), x)
    found = curve(lambda s: spline(s, xs, ys), x)
    for order in range(3):
        np.testing.assert_allclose(found[order], reference[order], atol=1e-10 * 30**order)


def test_periodic_cubic_is_that_of_scipy_over_several_periods():
    x = np.concatenate([INSIDE[:-1], np.linspace(-9, 12, 101)])
    reference = CubicSpline(XS, CLOSED, bc_type="periodic")
    found = curve(lambda s: spline(s, XS, CLOSED, outside="periodic"), x)
    np.testing.assert_allclose(found, scipy_curve(reference, x), rtol=1e-10, atol=1e-10)


def test_periodic_monotone_is_that_of_scipy_on_repeated_data():
    period = XS[-1] - XS[0]
    xs = np.concatenate([XS[:-1] - period, XS, XS[1:] + period])
    ys = np.concatenate([CLOSED[:-1], CLOSED, CLOSED[1:]])
    reference = PchipInterpolator(xs, ys)
    x = np.linspace(-1.3, 3.4, 90)
    found = curve(lambda s: spline(s, XS, CLOSED, "monotone", "periodic"), x)
    np.testing.assert_allclose(found, scipy_curve(reference, x), rtol=1e-10, atol=1e-10)


def test_periodic_data_may_close_up_to_rounding():
    angle = np.linspace(0, 2 * np.pi, 73)
    found = curve(lambda x: spline(x, angle, np.sin(angle), outside="periodic"), [0.1, 6.4, -40.0])
    np.testing.assert_allclose(found[:2], [np.sin([0.1, 6.4, -40]), np.cos([0.1, 6.4, -40])], atol=1e-5)


@pytest.mark.parametrize("kind", ["cubic", "monotone", "linear"])
def test_outside_constant_and_linear(kind):
    beyond = np.array([-3.0, -1.0 - 1e-12, 3.2 + 1e-12, 10.0])
    left, right = curve(lambda x: spline(x, XS, YS, kind), [XS[0], XS[-1]])[1]
    end, slope = YS[[0, 0, -1, -1]], np.array([left, left, right, right])
    way = beyond - XS[[0, 0, -1, -1]]
    found = curve(lambda x: spline(x, XS, YS, kind, "constant"), beyond)
    np.testing.assert_array_equal(found, [end, 0 * end, 0 * end])
    found = curve(lambda x: spline(x, XS, YS, kind, "linear"), beyond)
    np.testing.assert_allclose(found, [end + slope * way, slope, 0 * slope], rtol=1e-11)


@pytest.mark.parametrize("kind", ["cubic", "monotone"])
def test_outside_error_is_nan_and_leaves_the_inside_alone(kind):
    x = ca.SX.sym("x", 2)
    # Reverse mode, with a factor that the derivative passes through.
    function = derivatives(x[1] * spline(x[0], XS, YS, kind), x)
    for point in (XS[0], 0.3, XS[-1], XS[-1] * (1 + 1e-12)):
        assert all(np.all(np.isfinite(part.full())) for part in function([point, 2.0]))
    for point in (XS[0] - 0.01, XS[-1] + 0.01, np.nan):
        value, gradient, hessian = function([point, 2.0])
        assert np.isnan(float(value)) and np.isnan(float(gradient[0])) and np.isnan(float(hessian[0, 0]))


def test_a_linear_spline_tells_too_that_it_is_outside():
    assert np.isnan(curve(lambda x: spline(x, XS, YS, "linear"), [-1.1, 3.3])[:2]).all()


def test_spline_of_numbers_and_of_arrays():
    assert spline(0.5, [0, 1], [0, 3], kind="linear") == 1.5
    found = spline(np.array([[0.0, 0.5], [0.75, 1.0]]), [0, 1], [0, 4], kind="linear")
    np.testing.assert_array_equal(found, [[0, 2], [3, 4]])
    assert spline([], [0, 1], [0, 4], kind="linear").shape == (0,)
    with pytest.raises(ModelError, match=r"x = 1\.5 is outside the data, 0\.0 … 1\.0; give outside="):
        spline([0.5, 1.5], [0, 1], [0, 3], kind="linear")


def test_spline_of_a_vector_of_symbols():
    x = ca.SX.sym("x", 2, 2)
    expression = spline(x, XS, YS)
    assert expression.shape == (2, 2)
    points = np.array([[0.0, 0.5], [1.0, 2.0]])
    found = ca.Function("f", [x], [expression])(points).full()
    np.testing.assert_allclose(found, CubicSpline(XS, YS)(points), rtol=1e-12)


def test_spline_grows_with_its_points_only():
    x = ca.SX.sym("x")
    value = spline(x, np.arange(300.0), np.cos(np.arange(300.0)))
    function = ca.Function("f", [x], [value, ca.jacobian(value, x)])
    # No derivative passes through the choice of the piece: both outputs share the coefficients.
    assert function.n_instructions() < 20 * 300


@pytest.mark.parametrize(
    ("xs", "ys", "more", "message"),
    [
        ([0, 1, 1, 2], [0, 1, 2, 3], {}, r"xs must increase strictly, got xs\[1\] = 1\.0 and xs\[2\] = 1\.0"),
        ([0, 1, 2, 3], [0, 1, 2], {}, r"same length, got 4 and 3"),
        ([0, 1, 2, np.inf], [0, 1, 2, 3], {}, r"xs must be finite, got xs\[3\] = inf"),
        ([0, 1, 2, 3], [0, np.nan, 2, 3], {}, r"ys must be finite, got ys\[1\] = nan"),
        ([0, 1, 2], [0, 1, 2], {}, r"kind 'cubic' takes at least 4 points, got 3"),
        ([0], [0], {"kind": "linear"}, r"kind 'linear' takes at least 2 points, got 1"),
        ([0, 1], [0, 1], {"kind": "akima"}, r"kind must be one of cubic, monotone, linear, got 'akima'"),
        ([0, 1], [0, 1], {"outside": "clamp"}, r"one of error, constant, linear, periodic, got 'clamp'"),
        ([0, 1, 2, 3], [0, 1, 2, 3], {"outside": "periodic"}, r"got ys\[0\] = 0\.0 and ys\[-1\] = 3\.0"),
        ([0, 1, 2, 3], ["a", 1, 2, 3], {}, r"ys must be a sequence of numbers"),
        ([[0, 1], [2, 3]], [0, 1], {}, r"xs must be a sequence of numbers, got shape \(2, 2\)"),
        ([0, 1, 2, 3], [ca.SX.sym("y"), 1, 2, 3], {}, r"ys must be a sequence of numbers"),
    ],
)
def test_spline_refuses_bad_data(xs, ys, more, message):
    with pytest.raises(ModelError, match=message):
        spline(ca.SX.sym("x"), xs, ys, **more)
