"""Errors of the cost by the mesh, against optima that are known and finer meshes."""

import warnings

import numpy as np
import pytest
from motions import crank_rocker, half_turn, rest_to_rest

import mbdcasadi as mbd
from mbdcasadi.optimal_control.measures.cost_error import FalseCost
from mbdcasadi.optimal_control.measures.local_error import COARSE_ERROR
from mbdcasadi.optimal_control.measures.measure import split

#: Least time from rest to a place 10 m away and 5 m below, under gravity (a cycloid), s.
CYCLOID = 1.8012955


def sledge(angle, intervals):
    """A steered blade that slides to a place in least time, and what is said about it."""
    turn = mbd.Input("turn", lower=-20, upper=20)
    body = mbd.Body("sledge", 1.0, 1.0, pose=(0, 0, angle))
    forces = [mbd.Gravity(), mbd.Torque("steer", body, turn)]
    mechanism = mbd.Mechanism([body], [mbd.KnifeEdge("blade", body.at(0, 0))], forces=forces, inputs=[turn])
    rest = [body.x == 0, body.y == 0, body.vx == 0, body.vy == 0]
    problem = mbd.OptimalControlProblem(
        mechanism,
        (0.5, 5),
        rest,
        [body.x == 10, body.y == -5],
        terminal_cost=mbd.t,
        path=[mbd.bounded(-2, body.phi, 1)],
    )
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        return mbd.optimize(problem, intervals=intervals), [str(w.message) for w in caught]


def test_a_least_time_below_the_true_one_is_told():
    """The brachistochrone by the cycloid: on six intervals the time is too short, and by how much is said."""
    coarse, said = sledge(-0.7, 6)
    missing = CYCLOID - coarse.duration
    assert 1e-4 * CYCLOID < missing < coarse.cost_error < 4 * missing
    assert any("too coarse for the cost" in text and f"{coarse.cost_error:.2g}" in text for text in said), said


def test_a_mesh_that_is_fine_enough_is_not():
    """The same on twenty intervals: too short by a hundred-thousandth at most, and nothing is said."""
    fine, said = sledge(-0.7, 20)
    assert fine.duration == pytest.approx(CYCLOID, rel=2e-5) and not said
    assert CYCLOID - fine.duration <= fine.cost_error < 1e-4 * CYCLOID


def test_the_cost_of_a_linkage():
    """A crank-rocker on ten intervals against eighty: the difference is foreseen."""
    problem = half_turn(crank_rocker())
    with pytest.warns(mbd.MechanismWarning, match="too coarse for the cost"):
        coarse = mbd.optimize(problem, intervals=10)
    true = mbd.optimize(problem, intervals=80).cost
    assert coarse.cost_error == pytest.approx(abs(coarse.cost - true), rel=0.2) and coarse.cost < true


def test_polynomials_are_without_error():
    """The force of a block is linear in time: nothing is off."""
    solution = mbd.optimize(rest_to_rest()[0], intervals=4)
    assert solution.cost_error < 1e-12 * solution.cost and np.isfinite(solution.mesh_error)


@pytest.mark.slow
def test_without_a_number_of_intervals_the_mesh_is_refined_for_the_cost():
    """A crank from rest to rest: on a coarse mesh its cost is off by a ten-thousandth, by default it is not."""
    problem = half_turn(crank_rocker())
    with pytest.warns(mbd.MechanismWarning, match="too coarse for the cost"):
        coarse = mbd.optimize(problem, intervals=8)
    assert coarse.cost_error > 1e-4 * coarse.cost
    guessed = mbd.optimize(problem, guess=coarse.trajectory)
    assert guessed.cost_error < 1e-4 * guessed.cost
    measure = FalseCost(coarse)
    assert measure.largest > COARSE_ERROR and FalseCost(guessed).largest == 0
    finer = split(coarse.phases[0], [measure])
    assert finer.count > 8
