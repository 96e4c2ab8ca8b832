"""Changes at one instant: resets, controllers and changes of the mechanism, each from a state to the next."""

import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.assembly.setup import Setup
from mbdcasadi.simulation.changes.events import Standing
from mbdcasadi.simulation.changes.modes import SingleMode
from mbdcasadi.simulation.changes.transitions import Transitions

ball = mbd.Body("ball", mass=1, inertia=1, pose=(0, 0, 0), velocity=(1, -2, 0))
push = mbd.Input("push", 3.0)
forces = [mbd.Gravity(), mbd.Force("push", ball.at(0, 0), (push, 0))]
free = mbd.Mechanism(bodies=[ball], forces=forces, inputs=[push])
bounce = mbd.Event("bounce", ball.y, direction=-1, reset=[(ball.vy, -0.5 * ball.vy)])


def transitions(events=(), **arguments):
    """Transitions of the ball, and its state just above the floor."""
    setup = Setup(free, "simulate", times=[0, 1], takes_controller=True, **arguments)
    changes = Transitions(SingleMode(setup), events, 1e-10)
    changes.begin()
    return changes, changes.decided(setup.start)


def test_a_reset_turns_the_velocity_back():
    changes, state = transitions([bounce])
    after, occurrences = changes.by_resets(state, [bounce])
    np.testing.assert_allclose(after.v, [1, 1, 0], atol=1e-12)
    assert [e.name for e in occurrences] == ["bounce"]
    np.testing.assert_allclose(occurrences[0].state.v, [1, -2, 0], atol=1e-12)


def test_what_stands_still_at_its_zero_rests():
    changes, state = transitions([bounce], initial=[ball.vy == 0])
    after, occurrences = changes.by_resets(state, [bounce])
    known = changes.states[bounce]
    assert after is state and not occurrences
    assert known.standing is Standing.RESTING and known.zero == pytest.approx(0.0)


def test_a_controller_decides_the_accelerations():
    controller = mbd.SampledController(lambda time, state: {push: 10 * state[ball.vx]}, 0.1)
    changes, state = transitions(inputs=controller)
    assert state[ball.ax] == pytest.approx(3.0)
    assert changes.by_controller(state)[0][ball.ax] == pytest.approx(10.0)


def test_without_a_controller_nothing_changes():
    changes, state = transitions()
    assert changes.by_controller(state) == (state, [])


def test_the_mechanism_changes_at_the_first_state():
    floor = mbd.Revolute("floor", mbd.ground.at(0, 0), ball.at(0, 0))
    held = mbd.Mechanism(bodies=[ball], joints=[floor], forces=forces, inputs=[push])
    latch = mbd.Event("latch", ball.y, direction=-1, becomes=held)
    changes, state = transitions([latch])
    assert changes.to_another_mechanism(state, []) == [latch]
    assert changes.to_another_mechanism(state, [latch]) == []
