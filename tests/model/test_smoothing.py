"""Smoothing splines against their frequency response, and by stated noise."""

from __future__ import annotations

import numpy as np
import pytest

import mbdcasadi as mbd

TIMES = np.linspace(0, 4, 401)


@pytest.mark.parametrize("ratio", [0.3, 1.0, 1.6])
def test_frequency_response(ratio):
    """A sine passes by ``1 / (1 + (ν / cutoff)^6)``, without delay."""
    cutoff = 5.0
    sine, cosine = (f(2 * np.pi * ratio * cutoff * TIMES) for f in (np.sin, np.cos))
    inner = (TIMES > 1) & (TIMES < 3)
    curve = mbd.smoothing_spline(TIMES, sine, cutoff=cutoff)(TIMES)
    shares = np.linalg.lstsq(np.c_[sine, cosine][inner], curve[inner], rcond=None)[0]
    np.testing.assert_allclose(shares, [1 / (1 + ratio**6), 0], atol=1e-5)


def test_a_parabola_passes_also_between_uneven_samples():
    times = np.cumsum(np.random.default_rng(3).uniform(0.5, 1.5, 60)) / 60
    curve = mbd.smoothing_spline(times, 1 + 2 * times - 3 * times**2, cutoff=0.05)
    np.testing.assert_allclose(curve(times), 1 + 2 * times - 3 * times**2, atol=1e-7)
    np.testing.assert_allclose(curve.derivative(2)(times), -6, atol=1e-4)
    assert np.isnan(curve(times[-1] + 1))


def test_stated_noise_is_what_is_missed():
    noise = 0.01 * np.random.default_rng(1).standard_normal(TIMES.size)
    samples = np.sin(3 * TIMES) + noise
    curve = mbd.smoothing_spline(TIMES, samples, noise=0.01)
    assert np.sqrt(np.mean((curve(TIMES) - samples) ** 2)) == pytest.approx(0.01, rel=1e-9)
    inner = (TIMES > 0.2) & (TIMES < 3.8)
    acceleration = curve.derivative(2)(TIMES)[inner]
    assert np.sqrt(np.mean((acceleration + 9 * np.sin(3 * TIMES[inner])) ** 2)) < 0.5
    still = mbd.smoothing_spline(TIMES, noise, noise=0.02)
    np.testing.assert_allclose(still.derivative(2)(TIMES), still.derivative(2)(1.0), atol=1e-9)


def test_it_is_a_value_of_a_driver():
    curve = mbd.smoothing_spline(TIMES, np.sin(TIMES), cutoff=20)
    disc = mbd.Body("disc", mass=1, inertia=1)
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), disc.at(0, 0))
    model = mbd.Mechanism([disc], [hinge], drivers=[mbd.Driver("turn", hinge.angle, curve)])
    times = np.linspace(0.5, 3, 6)
    np.testing.assert_allclose(mbd.kinematics(model, times)[disc.alpha], curve.derivative(2)(times), atol=1e-9)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({}, "either cutoff=, in Hz, or noise="),
        ({"cutoff": 5, "noise": 1}, "either cutoff=, in Hz, or noise="),
        ({"cutoff": 60}, "beyond half the rate of the samples, 50 Hz"),
        ({"cutoff": -1}, "cutoff"),
        ({"noise": 1e-9}, "no curve with a cut-off below half their rate"),
        ({"cutoff": 5, "times": TIMES[:3]}, "must have the same length"),
        ({"cutoff": 5, "times": TIMES[:3], "values": [1, 2, 3]}, "at least 6 are needed"),
        ({"cutoff": 5, "values": np.full(401, np.nan)}, "must be finite"),
    ],
)
def test_refusals(options, words):
    rough = np.random.default_rng(1).standard_normal(TIMES.size)
    with pytest.raises(mbd.ModelError, match=words):
        mbd.smoothing_spline(**({"times": TIMES, "values": rough} | options))
