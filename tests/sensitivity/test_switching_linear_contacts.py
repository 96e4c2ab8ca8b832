"""Derivatives through linear contacts, by stiffnesses that are large numbers, against flights and contacts by hand."""

from __future__ import annotations

import numpy as np
import pytest
from linkages import G

import mbdcasadi as mbd

MASS, RADIUS, END = 0.5, 0.1, 2.0


def bounced_height(stiffness):
    """Height of a ball dropped from 1 m onto an elastic floor, flight by flight and contact by contact."""
    omega, t, y, v = np.sqrt(stiffness / MASS), 0.0, 1.0, 0.0
    while True:
        flight = (v + np.sqrt(v**2 + 2 * G * (y - RADIUS))) / G
        if t + flight >= END:
            return y + v * (END - t) - G * (END - t) ** 2 / 2
        t, v = t + flight, v - G * flight
        sag, swing = G / omega**2, v / omega
        turn = 2 * np.arctan2(-swing, -sag)  # of -sag + sag cos + swing sin, from zero to zero
        t, y, v = t + turn / omega, RADIUS, omega * (swing * np.cos(turn) - sag * np.sin(turn))


def dropped(stiffness):
    k = mbd.Parameter("k", stiffness)
    ball = mbd.Body("ball", mass=MASS, inertia=1e-3, pose=(0, 1, 0))
    outlines = mbd.Circle(ball.at(0, 0), RADIUS), mbd.HalfPlane(mbd.ground.at(0, 0))
    floor = mbd.Contact("floor", *outlines, mbd.HuntCrossley(k, exponent=1))
    drop = mbd.Mechanism(bodies=[ball], forces=[mbd.Gravity(), floor], parameters=[k])
    return ball, k, drop, [ball.y == 1, ball.vy == 0]


@pytest.mark.slow
@pytest.mark.parametrize("stiffness", [1e4, 1e6])
def test_derivative_by_the_stiffness_of_a_linear_contact(stiffness):
    # a derivative by newtons per metre is far below the absolute tolerance, and no less accurate for it
    ball, k, drop, start = dropped(stiffness)
    h = 1e-5 * stiffness
    heights = [bounced_height(stiffness + s * h) for s in (1, -1)]
    exact = (heights[0] - heights[1]) / (2 * h)
    times = np.linspace(0, END, 5)
    found = mbd.sensitivities(drop, times, {"y": ball.y}, [k], start)
    assert found["y", k][-1] == pytest.approx(exact, rel=1e-3)
    cost = mbd.cost_function(drop, times, [k], terminal_cost=ball.y, initial=start)
    assert cost.gradient([stiffness])[0] == pytest.approx(exact, rel=1e-3)


@pytest.mark.slow
def test_fit_of_the_stiffness_of_a_linear_contact():
    ball, k, drop, start = dropped(1e5)
    times = np.linspace(0, END, 21)
    seen = mbd.simulate(drop, times, initial=start, parameters={k: 1.3e5})[ball.y]
    fit = mbd.identify(drop, times, data=[(ball.y, seen)], unknowns=[k], initial=start)
    assert fit[k] == pytest.approx(1.3e5, rel=1e-4)
