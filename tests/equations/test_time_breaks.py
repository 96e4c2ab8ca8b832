"""Instants at which expressions switch in time, against those by which the expressions were made."""

import casadi as ca
import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.equations.switching.time_breaks import TimeFunctions, merge_breaks

t, k = ca.SX.sym("t"), ca.SX.sym("k", 2)
q = ca.SX.sym("q", 3)


def breaks_of(expression, start=0.0, end=10.0, values=(3.0, 4.0)):
    return TimeFunctions(ca.SX(expression), t, k).breaks(np.array(values), start, end)


CASES = {
    "comparison": (ca.if_else(t < 5, 0, 1), [5], [0]),
    "comparison with a parameter": (ca.if_else(2 * t <= k[0], q[0], q[1]), [1.5], [0]),
    "step": (mbd.step(t, 5, 0, 5.1, 1) * q[0], [5, 5.1], [3, 3]),
    "step between parameters": (mbd.step(t, k[0], 0, k[1], 1), [3, 4], [3, 3]),
    "absolute value": (ca.fabs(t - 2), [2], [1]),
    "sign of a sine": (ca.sign(ca.sin(2 * t)), np.pi / 2 * np.arange(1, 7), [0] * 6),
    "rectified sine": (ca.fabs(ca.sin(np.pi * t / 2)), [2, 4, 6, 8], [1] * 4),
    "largest of two": (ca.fmax(t, 4), [4], [1]),
    "smallest of two": (ca.fmin(t**2, 9), [3], [1]),
    "floor": (ca.floor(t / k[0]), [3, 6, 9], [0, 0, 0]),
    "falling ceil": (ca.ceil(3 - t), [1, 2, 3, 4, 5, 6, 7, 8, 9], [0] * 9),
    "floor of a square": (ca.floor(t**2 / 20), np.sqrt([20, 40, 60, 80]), [0] * 4),
    "saw": (ca.fmod(t, 2), [2, 4, 6, 8], [0] * 4),
    "remainder": (ca.remainder(t, 4), [2, 6], [0, 0]),
    "pulse width": (
        ca.if_else(ca.fmod(t, 0.6 * k[0]) < 0.5, 1, 0),
        [0.5, 1.8, 2.3, 3.6, 4.1, 5.4, 5.9, 7.2, 7.7, 9, 9.5],
        [0] * 11,
    ),
    "pulse width by a remainder": (
        ca.if_else(ca.fabs(ca.remainder(t, 1.5 * k[0])) < 0.25, 1, 0),
        [0.25, 2.25, 4.25, 4.5, 4.75, 6.75, 8.75, 9, 9.25],
        [0, 3, 0, 3, 0, 3, 0, 3, 0],
    ),
    "tangent": (ca.tan(t), np.pi * (np.arange(3) + 0.5), [0] * 3),
    "pole": (1 / (3.5 - t), [3.5], [0]),
    "triangle": (ca.acos(ca.cos(t)), np.pi * np.arange(1, 4), [1] * 3),
    "root of a square": (ca.sqrt((t - 5) ** 2), [5], [1]),
    "third power of an absolute value": (ca.fabs(t - 6) ** 3, [6], [3]),
    "square with a sign": (ca.fabs(t - 6) * (t - 6), [6], [2]),
    "nested": (
        ca.if_else(ca.sin(ca.fabs(t - 3)) > 0.5, 0, 1),
        [3 - 5 * np.pi / 6, 3 - np.pi / 6, 3, 3 + np.pi / 6, 3 + 5 * np.pi / 6, 3 + 13 * np.pi / 6],
        [0, 0, 3, 0, 0, 0],
    ),
    "pulse shorter than the samples": (
        ca.if_else(ca.fabs(t - 7.0001) < 1e-6, 1, 0),
        [7.000099, 7.0001, 7.000101],
        [0, 3, 0],
    ),
    "pole of a quotient": (q[0] / (3.5 - t), [3.5], [0]),
    "smooth": (ca.sin(3 * t) * q[0] + ca.exp(-t), [], []),
    "switched by a coordinate": (ca.if_else(q[0] < t, 1, 0), [], []),
    "no time": (ca.fabs(q[0]) * k[0], [], []),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_instants_and_orders(name):
    expression, times, order = CASES[name]
    found = breaks_of(expression)
    np.testing.assert_allclose(found.times, times, rtol=1e-12)
    assert found.order.tolist() == list(order)


@pytest.mark.parametrize("kind, order", [("cubic", 3), ("monotone", 2), ("linear", 1)])
def test_knots_of_a_periodic_spline(kind, order):
    xs = np.array([0.0, 0.3, 0.9, 1.4, 2.0])
    found = breaks_of(mbd.spline(t, xs, [0, 1, -1, 0.5, 0], kind=kind, outside="periodic"))
    wanted = np.sort(np.concatenate([xs[:-1] + 2 * turn for turn in range(5)]))[1:]
    np.testing.assert_allclose(found.times, wanted, rtol=1e-12)
    assert set(found.order.tolist()) == {order}


def test_joints_of_a_motion_program():
    program = mbd.MotionProgram(mbd.rise(1, 0.02), mbd.dwell(0.5), mbd.fall(1.5, "harmonic"))
    found = breaks_of(program(t))
    np.testing.assert_allclose(found.times, [1, 1.5, 3, 4, 4.5, 6, 7, 7.5, 9], rtol=1e-12)
    # the acceleration of the harmonic law jumps at its ends, that of the cycloid does not
    assert found.order.tolist() == [3, 2, 2, 3, 2, 2, 3, 2, 2]


def test_random_sums_of_switches():
    generator = np.random.default_rng(3)
    for _ in range(40):
        start = generator.choice([0.0, -3.0, 1e3, 1.7e9])
        times = np.sort(start + generator.uniform(0.1, 9.9, generator.integers(1, 6)))
        order = generator.integers(0, 3, times.size)
        pieces = {0: lambda x: x > 0, 1: ca.fabs, 2: lambda x: ca.fabs(x) * x}
        sizes = 10.0 ** generator.uniform(-2, 2, times.size)
        expression = sum(
            size * pieces[int(o)](generator.uniform(0.5, 2) * (t - float(at)))
            for size, o, at in zip(sizes, order, times, strict=True)
        )
        found = breaks_of(expression, start, start + 10)
        assert found.times.size == times.size
        np.testing.assert_allclose(found.times, times, rtol=1e-14)
        if start < 1e9:  # beside 1.7e9 s a microsecond is rounding, and so are small kinks
            assert found.order.tolist() == order.tolist()


def test_fast_switching_is_not_lost_between_samples():
    found = breaks_of(ca.sign(ca.sin(2000 * t)))
    np.testing.assert_allclose(found.times, np.arange(1, 6367) * np.pi / 2000, rtol=1e-12)


def test_sides_lie_on_both_sides_of_a_comparison():
    at = 5.1234567
    value = ca.Function("f", [t], [ca.if_else(3 * t < 3 * at, 0, 1)])
    found = breaks_of(value(t))
    before, after = found.times - found.width, found.times + found.width
    assert float(value(before)) == 0 and float(value(after)) == 1
    assert after - before < 1e-12


def test_an_instant_at_zero_is_one():
    found = breaks_of(ca.fabs(3 * (t - 0.1) + 0.3) + ca.fabs(t), -10, 10)
    assert found.times.size == 1 and abs(found.times[0]) < 1e-15


def test_beyond_the_data_of_a_spline():
    found = breaks_of(mbd.spline(t, [0, 1, 2, 3], [0, 1, 0, 1]))
    assert found.order[-1] == 0 and found.times[-1] == pytest.approx(3, abs=1e-8)


@pytest.mark.parametrize(
    "pulse",
    [
        ca.exp(-(((t - 5) / 0.01) ** 2)),
        ca.tanh((t - 5) / 0.01),
        1 / (1 + ((t - 5) / 0.01) ** 2),
        1 / (1 + ca.exp(-(t - 5) / 0.01)),
        ca.atan((t - 5) / 0.01),
        1 / ca.cosh((t - 5) / 0.01),
    ],
)
def test_short_smooth_transients(pulse):
    found = breaks_of(q[0] * pulse)
    assert found.times.size == 0
    near = found.transients[np.abs(found.transients[:, 0] - 5) < 1e-6]
    assert near.size and 0.005 < near[0, 1] < 0.02
    assert breaks_of(pulse, 4.99, 5.01).transients.size == 0  # not short beside so short a run


def test_only_values_that_occur_are_looked_at_again():
    functions = TimeFunctions(ca.fabs(t - k[0]), t, k)
    first = functions.breaks(np.array([3.0, 1.0]), 0, 10)
    assert functions.breaks(np.array([3.0, 2.0]), 0, 10) is first
    assert functions.breaks(np.array([4.0, 2.0]), 0, 10).times.tolist() == [4.0]


def test_merged_instants_keep_the_lowest_order():
    parts = [breaks_of(ca.fabs(t - 5)), breaks_of(ca.if_else(t < 5, 0, 1)), breaks_of(ca.fabs(t - 6))]
    merged = merge_breaks(parts)
    assert merged.times.tolist() == [5.0, 6.0] and merged.order.tolist() == [0, 1]
    assert merge_breaks([]).times.size == 0
