"""Warnings about what closes: passes on the way, and footholds that pull."""

import warnings

import numpy as np
import pytest

import mbdcasadi as mbd

G = 9.81


def block():
    body = mbd.Body("body", mass=1.0, inertia=0.1)
    f = mbd.Input("f")
    rail = mbd.Translational("rail", mbd.ground.at(0, 0, np.pi / 2), body.at(0, 0, np.pi / 2))
    push = mbd.Force("push", body.at(0, 0), (0, f))
    air = mbd.Mechanism(bodies=[body], joints=[rail], forces=[mbd.Gravity(), push], inputs=[f])
    stands = mbd.AbsoluteY("stands", body.at(0, 0), 0.0)
    return body, f, air, air.replace(joints=[rail, stands])


def warned(problem, **more):
    with warnings.catch_warnings(record=True) as found:
        warnings.simplefilter("always", mbd.MechanismWarning)
        solution = mbd.optimize(problem, intervals=12, **more)
    return solution, [str(w.message) for w in found if "mesh" not in str(w.message)]


@pytest.mark.parametrize(("middle", "passes"), [(-0.2, True), (0.2, False)])
def test_a_foot_that_passes_through_the_ground(middle, passes):
    body, f, air, stance = block()
    way = [mbd.Waypoint(0.4, [body.y == middle]), mbd.Waypoint(0.8, [body.y == 0.1])]
    swing = mbd.Phase("swing", air, 1.0, initial=[body.y == 0, body.vy == 0], running_cost=f**2, waypoints=way)
    problem = mbd.OptimalControlProblem(phases=[swing, mbd.Phase("landed", stance, 0)])
    solution, said = warned(problem)
    assert (solution.phases[0].trajectory[body.y].min() < -0.1) == passes
    assert ["'stands' closes at its end, but was beyond zero before" in s for s in said] == [True] * passes


def test_what_begins_behind_its_place_has_not_passed_it():
    """A latch at x = 1, to which a carriage comes from the left, overshoots and comes back."""
    body, f = mbd.Body("body", mass=1.0, inertia=0.1), mbd.Input("f")
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), body.at(0, 0))
    free = mbd.Mechanism(bodies=[body], joints=[rail], forces=[mbd.Force("p", body.at(0, 0), (f, 0))], inputs=[f])
    latched = free.replace(joints=[rail, mbd.AbsoluteX("latch", body.at(0, 0), 1.0)])
    come = mbd.Phase(
        "come", free, 1.0, initial=[body.x == 0, body.vx == 0], running_cost=f**2,
        waypoints=[mbd.Waypoint(0.6, [body.x == 1.3])],
    )  # fmt: skip
    solution, said = warned(mbd.OptimalControlProblem(phases=[come, mbd.Phase("latched", latched, 0)]))
    assert solution.phases[0].trajectory[body.x].max() > 1.29 and not said


@pytest.mark.slow
@pytest.mark.parametrize(("lift", "pulls"), [(2 * G, True), (0.5 * G, False)])
def test_a_foothold_that_pulls(lift, pulls):
    """A block falls onto a foothold, stands there while it is lifted, and leaves it."""
    body, f, air, stance = block()
    phases = [
        mbd.Phase("fall", air, (0.2, 2), initial=[body.y == 1, body.vy == 0], path=[f == 0]),
        mbd.Phase("stance", stance, 0.3, path=[f == lift]),
        mbd.Phase("rise", air, 0.3, running_cost=f**2, final=[body.y == 0.5]),
    ]
    _, said = warned(mbd.OptimalControlProblem(phases=phases))
    assert [
        "phase 'stance': constraint 'stands', which closes from one side, has to pull" in s and "9.81" in s
        for s in said
    ] == [True] * pulls


def test_a_latch_that_stays_may_pull():
    body, f, air, stance = block()
    phases = [
        mbd.Phase("fall", air, (0.2, 2), initial=[body.y == 1, body.vy == 0], path=[f == 0]),
        mbd.Phase("held", stance, 0.3, path=[f == 2 * G]),
    ]
    assert not warned(mbd.OptimalControlProblem(phases=phases))[1]
