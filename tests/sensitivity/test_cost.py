"""Running costs that are there in a short range of the motion alone, against their integrals in closed form."""

from __future__ import annotations

import numpy as np
import pytest

import mbdcasadi as mbd

#: A parabola of unit height over half a width, its powers and what they do; their integrals over the half width.
BUMPS = {
    "parabola": (lambda base: mbd.fmax(0, base), 4 / 3),
    "square": (lambda base: mbd.positive_power(base, 2), 16 / 15),
    "rectangle": (lambda base: mbd.if_else(base > 0, 1, 0), 2.0),
}


@pytest.mark.slow
@pytest.mark.parametrize("method", ["idas", "erk"])
@pytest.mark.parametrize("count", [3, 101])
@pytest.mark.parametrize("half", [0.05, 0.005, 3e-4])
@pytest.mark.parametrize("bump", BUMPS)
def test_a_body_in_uniform_motion_passes_a_running_cost(bump, half, count, method):
    """The steps of free motion are as long as the run; beyond the bump the parabola goes to minus infinity."""
    shape, integral = BUMPS[bump]
    weight = mbd.Parameter("weight", 1.0)
    body = mbd.Body("puck", mass=1.0, inertia=1.0)
    mechanism = mbd.Mechanism([body], parameters=[weight])
    cost = mbd.cost_function(
        mechanism, np.linspace(0, 1.5, count), [weight], method=method, initial=[body.x == 0, body.vx == 1],
        running_cost=weight * shape(1 - ((body.x - 0.309) / half) ** 2) / half,
    )  # fmt: skip
    assert cost([1.0]) == pytest.approx(integral, rel=1e-4)
    assert cost([3.0]) == pytest.approx(3 * integral, rel=1e-4)
