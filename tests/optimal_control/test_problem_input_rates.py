"""Rates of inputs in costs, limits and conditions."""

import numpy as np
import pytest
from motions import rest_to_rest

import mbdcasadi as mbd


def smooth(distance=1.0, duration=1.0, **changes):
    """A block carried over with forces that begin and end at zero."""

    def made(block, u):
        return dict(
            initial=[block.x == 0, block.vx == 0, u == 0],
            final=[block.x == distance, block.vx == 0, u == 0],
            running_cost=u.rate**2,
        )

    return rest_to_rest(distance, duration, with_block=made, **changes)


@pytest.mark.parametrize("transcription", ["gauss-legendre", "hermite-simpson"])
def test_minimum_jerk(transcription):
    """Least integral of the jerk squared, from rest without acceleration: 720 d² / T⁵, x a quintic."""
    problem, u, block = smooth(3.0, 2.0)
    exact = 720 * 9 / 2**5
    errors = [mbd.optimize(problem, intervals=n, transcription=transcription).cost - exact for n in (10, 20)]
    assert 0 < errors[1] < 1e-5 * exact
    assert np.log2(errors[0] / errors[1]) == pytest.approx(4, abs=0.2)
    solution = mbd.optimize(problem, intervals=20, transcription=transcription)
    s = np.linspace(0, 1, 81)
    motion = solution.trajectory.at(2 * s)
    assert np.allclose(motion[block.x], 3 * (10 * s**3 - 15 * s**4 + 6 * s**5), atol=3e-5)
    jerk = 3 / 8 * (60 - 360 * s + 360 * s**2)
    assert np.allclose(motion[u.rate], jerk, atol=0.02 * np.max(jerk))
    assert solution.verify().final_error < 1e-8


def test_higher_degrees_follow_the_cubic_force_exactly():
    """With four stages the force is cubic on an interval, as the minimum jerk is."""
    problem, *_ = smooth(3.0, 2.0)
    assert mbd.optimize(problem, intervals=4, degree=4).cost == pytest.approx(720 * 9 / 2**5, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("transcription", ["gauss-legendre", "hermite-simpson"])
def test_least_time_with_a_limited_rate(transcription):
    """The rate is at its limits for a quarter, a half and a quarter of T = (32 d / J)^(1/3)."""
    problem, u, _block = smooth(2.0, 1.0)
    fast = problem.replace(duration=(0.2, 10.0), running_cost=0, terminal_cost=mbd.t, path=[mbd.bounded(-3, u.rate, 3)])
    solution = mbd.optimize(fast, intervals=20, control="linear", transcription=transcription)
    duration = (32 * 2.0 / 3) ** (1 / 3)
    assert solution.duration == pytest.approx(duration, rel=1e-7)
    middles = (solution.mesh[1:] + solution.mesh[:-1]) / 2
    rates = solution.trajectory.at(middles)[u.rate]
    turns = np.where((middles < duration / 4) | (middles > 3 * duration / 4), 3.0, -3.0)
    assert np.allclose(rates, turns, atol=1e-4)
    assert np.max(solution.trajectory[u]) == pytest.approx(3 * duration / 4, rel=1e-5)
    polynomial = mbd.optimize(fast, intervals=40, transcription=transcription)
    assert polynomial.duration == pytest.approx(duration, rel=1e-3)


def test_the_rate_is_the_derivative_of_the_force():
    """By finite differences, between the mesh points too; the force is continuous across them."""
    problem, u, _block = smooth(1.0, 1.0, path=[])
    solution = mbd.optimize(problem, intervals=7)
    times = np.linspace(0.01, 0.99, 37)
    step = 1e-6
    after, before = (solution.trajectory.at(times + s)[u] for s in (step, -step))
    inside = np.min(np.abs(times[:, None] - solution.mesh), axis=1) > 1e-3
    rates = solution.trajectory.at(times)[u.rate]
    assert np.allclose(rates[inside], ((after - before) / (2 * step))[inside], rtol=1e-5, atol=1e-4)
    edges = solution.mesh[1:-1]
    left, right = solution.trajectory.at(edges - 1e-10)[u], solution.trajectory.at(edges + 1e-10)[u]
    assert np.allclose(left, right, atol=1e-6)


def test_rates_between_both_ends():
    """A force that begins and ends alike, at the same rate: periodic up to the input."""

    def made(block, u):
        same = [mbd.at_end(e) == mbd.at_start(e) for e in (block.vx, u, u.rate)]
        path = [mbd.time_derivative(block.x) >= 0.2]
        return dict(initial=[block.x == 0], final=[block.x == 1], boundary=same, running_cost=u**2, path=path)

    problem, u, _ = rest_to_rest(with_block=made)
    solution = mbd.optimize(problem, intervals=8)
    ends = solution.trajectory.at([0.0, 1.0])
    assert np.ptp(ends[u]) < 1e-8 and np.ptp(ends[u.rate]) < 1e-6


def test_constant_inputs_have_no_rate():
    """Refused with the way out."""
    problem, *_ = smooth()
    with pytest.raises(mbd.ModelError, match="constant.*linear"):
        mbd.optimize(problem, intervals=4, control="constant")
