"""Quantities of a motion that no condition and no cost decides."""

import warnings

import numpy as np
import pytest
from motions import crank_rocker, half_turn, rest_to_rest

import mbdcasadi as mbd

G = 9.81


def said(problem, intervals=5, **more):
    """What is said about quantities that nothing decides."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", mbd.MechanismWarning)
        mbd.optimize(problem, intervals=intervals, **more)
    return [str(w.message) for w in caught if "decided by no" in str(w.message)]


@pytest.mark.parametrize(
    ("start", "end", "names"),
    [
        ((0, 0), (1, 0), ""),
        ((0, None), (None, None), "block.vx at the start"),
        ((None, 0), (None, 1), "block.x at the start"),
        ((0, None), (1, None), ""),  # one speed leads there without a force
        ((None, None), (None, None), "block.x at the start, block.vx at the start"),
        ((None, None), (1, 0), ""),  # rests there
        ((None, None), (1, None), "block.x at the start, block.vx at the start"),  # on a line of both
    ],
)
def test_the_start_of_a_block(start, end, names):
    """The least force on a free block is none: by hand, what of its start is left."""
    problem, _u, block = rest_to_rest()
    ends = [[s == x for s, x in zip((block.x, block.vx), at, strict=True) if x is not None] for at in (start, end)]
    found = said(problem.replace(initial=ends[0], final=ends[1]))
    assert len(found) == bool(names) and all(f"({names})" in text for text in found)


def test_what_a_cost_decides_weakly_is_decided():
    """A small cost of the speed, far below that of the force."""
    problem, u, block = rest_to_rest()
    assert not said(problem.replace(initial=[block.x == 0], final=[], running_cost=u**2 + 1e-3 * block.vx**2))


def test_limits_that_are_far_away_decide_nothing():
    """Neither of the force nor of the speed."""
    problem, _u, block = rest_to_rest(lower=-5, upper=5)
    for path in ([mbd.bounded(-2, block.vx, 2)], [block.x <= 7]):
        (text,) = said(problem.replace(initial=[block.x == 0], final=[], path=path), intervals=20)
        assert "(block.vx at the start)" in text


def test_a_duration():
    """Without a force a block may take any time to get there, and the speed follows from it."""
    problem, _u, block = rest_to_rest(duration=(0.5, 2.0))
    (text,) = said(problem.replace(initial=[block.x == 0], final=[block.x == 1]))
    assert text.startswith("1 quantity of the motion is decided by no") and "the duration" in text


@pytest.mark.slow
def test_a_crank_that_starts_with_any_speed():
    """The least effort decides the speed."""
    f = crank_rocker()
    assert not said(half_turn(f, initial=[f.o2.angle == 0.5]), intervals=20)


@pytest.mark.slow
@pytest.mark.parametrize("decided", [True, False])
def test_a_pose_that_nothing_decides(decided):
    """A rimless wheel without cost: where in its step the motion begins is for a condition to say."""
    half, slope = np.pi / 8, 0.08
    wheel = mbd.Body("wheel", mass=2.0, inertia=0.1, pose=(-np.sin(half), np.cos(half), 0.0), velocity=(1, 0, -1))
    feet = [wheel.at(np.sin(half * (2 * k + 1)), -np.cos(half * (2 * k + 1))) for k in range(2)]
    pins = [mbd.Revolute(f"spoke {k}", mbd.ground.at(2 * np.sin(half) * k, 0), feet[k]) for k in range(2)]
    downhill = mbd.Gravity((G * np.sin(slope), -G * np.cos(slope)))
    on = [mbd.Mechanism(bodies=[wheel], joints=[pin], forces=[downhill]) for pin in pins]
    roll = mbd.Phase("roll", on[0], (0.3, 3), initial=[wheel.phi == 0] if decided else [wheel.omega <= -0.5])
    problem = mbd.OptimalControlProblem(
        phases=[roll, mbd.Phase("lands", on[1], 0)],
        boundary=[mbd.at_end(wheel.omega) == mbd.at_start(wheel.omega)],
    )
    rough = mbd.simulate(on[0], np.linspace(0, 1, 51), initial=[wheel.phi == 0, wheel.omega == -1.1])
    found = said(problem, intervals=12, guess=rough)
    assert [
        s.startswith("1 quantity of the motion through the phases 'roll', 'lands' is decided by no") for s in found
    ] == ([] if decided else [True])
