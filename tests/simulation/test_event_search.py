"""Events between outputs, and their states from one piece of motion to the next."""

from __future__ import annotations

import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.assembly.setup import Setup
from mbdcasadi.simulation.changes.events import EventState, EventWatch, Standing

ball = mbd.Body("ball", mass=1, inertia=1)
free = mbd.Mechanism([ball], forces=[mbd.Gravity()])


def spin(seed):
    """A body that spins, an event that is passed twice about each peak, times of outputs, and the exact instants."""
    random = np.random.default_rng(seed)
    omega, above, start = random.uniform(2, 30), 10 ** random.uniform(-8, -1), random.uniform(-3, 0)
    body = mbd.Body("body", mass=1, inertia=0.1, pose=(0, 0, start), velocity=(0, 0, omega))
    level = mbd.Event("level", mbd.sin(body.phi) - (1 - above))
    middles, half = np.pi / 2 + 2 * np.pi * np.arange(-1, 6), np.arccos(1 - above)
    exact = (np.sort(np.r_[middles - half, middles + half]) - start) / omega
    return mbd.Mechanism([body]), level, np.linspace(0, 1, random.integers(2, 40)), exact[(exact > 0) & (exact < 1)]


@pytest.mark.slow
@pytest.mark.parametrize("method", ["idas", "dop853", "erk"])
def test_no_narrow_excursion_is_missed(method):
    """Of a hundred excursions beyond zero, of heights from 1e-8 to 0.1, between outputs that may be far apart."""
    count = 0
    for seed in range(25):
        mechanism, level, times, exact = spin(seed)
        motion = mbd.simulate(mechanism, times, events=[level], method=method)
        np.testing.assert_allclose([event.t for event in motion.events], exact, atol=1e-6)
        count += exact.size
    assert count > 100


def standing(expression, at=(), reset=True):
    """Where an event stands at a start, and its state."""
    event = mbd.Event("event", expression, direction=-1, reset={ball.vy: -ball.vy} if reset else None)
    setup = Setup(free, "simulate", times=[0, 1], initial=[ball.y == 0, *at])
    watch = EventWatch(setup.eom, [event], 1e-10)
    watch.start_at(setup.start)
    return watch.states[0]


def test_where_an_event_stands_at_a_start():
    """Off its zero, moving off it on the side to which it goes, or at rest there."""
    assert standing(ball.y - 1).standing is Standing.ARMED
    rises, falls = (standing(ball.y, [ball.vy == speed]) for speed in (2.0, -2.0))
    assert rises.standing is falls.standing is Standing.LEAVING and rises.side > 0 > falls.side
    assert standing(ball.x, [ball.vx == 0]).standing is Standing.RESTING
    # without velocity the acceleration tells the side of what has no reset
    thrown = standing(ball.y, [ball.vy == 0], reset=False)
    assert thrown.standing is Standing.LEAVING and thrown.side < 0
    assert standing(ball.y, [ball.vy == 0]).standing is Standing.RESTING


def test_states_are_passed_on_from_piece_to_piece():
    """What leaves its zero is armed at the end of a piece; what is at its zero stays there within its rounding."""
    state = EventState(Standing.LEAVING, zero=1e-12, side=1e-9)
    state.pass_on(0.3)
    assert (state.standing, state.zero, state.side) == (Standing.ARMED, 0.0, 0.3)
    state = EventState(Standing.AT_ZERO, zero=1e-12, side=-1e-12, band=1e-12)
    state.pass_on(-1.5e-12)
    assert state.standing is Standing.AT_ZERO and state.side == -1.5e-12
    state.pass_on(-1e-9)
    assert (state.standing, state.zero, state.side) == (Standing.ARMED, 0.0, -1e-9)
    state.become(Standing.RESTING, 2.0)
    state.pass_on(-5.0)
    assert (state.standing, state.zero) == (Standing.RESTING, 2.0)
    state = EventState(side=1.0)
    state.pass_on(float("nan"))
    assert state.side == 0.0
