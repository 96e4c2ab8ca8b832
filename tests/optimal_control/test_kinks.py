"""Equations with kinks: ropes, stops and springs that push on one side alone."""

import time
from dataclasses import replace
from functools import cache

import casadi as ca
import numpy as np
import pytest
from keyboard import interrupted_in
from scipy.linalg import expm
from scipy.optimize import minimize

import mbdcasadi as mbd
from mbdcasadi.optimal_control.program.sparse_program import MappedBlock, SparseProgram
from mbdcasadi.optimal_control.solve.rounded_program import _borders, _rounded, reaches_kinks
from mbdcasadi.optimal_control.solve.solvers.ipopt import Ipopt

STIFFNESS, BUFFER, MASS = 50.0, 0.5, 1.0

KINKS = {
    "fabs": lambda x, y: ca.fabs(x - y),
    "fmax": lambda x, y: ca.fmax(x, 2 * y),
    "fmin": lambda x, y: 3 * ca.fmin(x, y) * y,
    "sum": lambda x, y: ca.fabs(ca.fmax(x, y) - 0.3) + ca.fmin(x, 0),
    "if_else": lambda x, y: mbd.if_else(x > y, 4 * (x - y), 0),
    "two sides": lambda x, y: mbd.if_else(mbd.if_else(x > 0, x, -x) > 0.5, mbd.fabs(x) - 0.5, 0),
    "positive_power": lambda x, y: mbd.positive_power(x - y, 1.5),
    "root": lambda x, y: mbd.positive_power(x, 0.5) * y,
    "both": lambda x, y: mbd.if_else(ca.logic_and(x > 0, y > 0), x * y, 0),
    "either": lambda x, y: mbd.if_else(ca.logic_or(x > 0, y > 0), ca.fmax(x, 0) * ca.fmax(y, 0), 0),
}


@pytest.mark.parametrize("name", KINKS)
def test_rounded_kinks_tend_to_sharp_ones(name):
    """With their derivatives finite, and values off by less than a multiple of the width, at and beside the kink."""
    x, none, width = ca.SX.sym("x", 2), ca.SX(0, 1), ca.SX.sym("w")
    sharp = KINKS[name](x[0], x[1])
    piece = MappedBlock(x, none, none, ca.SX(sharp), ca.SX(0), np.zeros((2, 1), int))
    smooth = _rounded(piece, width, np.ones(_borders(piece).numel())).rows
    values = ca.Function("values", [x, width], [sharp, smooth, ca.gradient(smooth, x), ca.hessian(smooth, x)[0]])
    random = np.random.default_rng(0)
    places = [
        *random.uniform(-1, 1, (20, 2)),
        (0.0, 0.0),
        (0.3, 0.3),
        (0.3, 0.15),
        (0.0, 0.5),
        (0.5, 0.0),
        (-1e-5, 0.2),
    ]
    for of_width in (1e-2, 1e-4, 1e-6):
        found = [[part.full() for part in values(place, of_width)] for place in places]
        assert all(np.isfinite(part).all() for one in found for part in one)
        share = 0.5 if name == "root" else 1.0
        assert max(float(abs(one[0] - one[1]).max()) for one in found) < 12 * of_width**share


@pytest.mark.parametrize(
    ("values", "reached"), [((2, 3, 4), False), ((-2, -3, -4), False), ((2, 3, -4), True), ((2, 1e-3, 4), True)]
)
def test_kinks_far_away_are_not_rounded(values, reached):
    """A load that is never taken off has no kink on the way; one that comes near zero, or changes its sign, has."""
    x, none = ca.SX.sym("x"), ca.SX(0, 1)
    piece = MappedBlock(x, none, none, ca.fabs(x), ca.SX(0), np.arange(3)[None, :])
    assert reaches_kinks(SparseProgram(3, [piece], none), np.array(values, float), np.zeros(0)) is reached


def against_buffer(limit):
    """A block that is pushed from rest to rest, against a spring behind half of the way."""
    force = mbd.Input("force", lower=-limit, upper=limit)
    block = mbd.Body("block", mass=MASS, inertia=1)
    push = mbd.Force("push", block.at(0, 0), (force, 0))
    buffer = mbd.Force("buffer", block.at(0, 0), (-STIFFNESS * mbd.fmax(block.x - BUFFER, 0), 0))
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    model = mbd.Mechanism([block], [guide], forces=[push, buffer], inputs=[force])
    ends = {"initial": [block.x == 0, block.vx == 0], "final": [block.x == 1, block.vx == 0]}
    return mbd.OptimalControlProblem(model, 1.0, **ends, running_cost=force**2)


@cache
def least_effort():
    """The same by the least effort of two linear systems, least over the instant and the speed between them."""
    b = np.array([0.0, 1.0 / MASS])

    def effort(rates, start, end, duration):
        # both exponentials of Van Loan's block matrix, whose product is the integral of expm(A s) b bᵀ expm(Aᵀ s)
        blocks = expm(duration * np.block([[-rates, np.outer(b, b)], [np.zeros((2, 2)), rates.T]]))
        gramian = blocks[2:, 2:].T @ blocks[:2, 2:]
        missing = end - expm(rates * duration) @ start
        return float(missing @ np.linalg.solve(gramian, missing))

    def both(z):
        instant, speed = z
        free = effort(np.array([[0, 1.0], [0, 0]]), np.zeros(2), np.array([BUFFER, speed]), instant)
        sprung = np.array([[0, 1.0], [-STIFFNESS / MASS, 0]])
        return free + effort(sprung, np.array([0.0, speed]), np.array([1 - BUFFER, 0.0]), 1 - instant)

    return float(minimize(both, [0.7, 3.0], method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-10}).fun)


@pytest.mark.slow
@pytest.mark.parametrize("limit", [np.inf, 20.0])
def test_a_mesh_point_at_the_kink(limit):
    """On 40 intervals the optimum has a stage at which the spring is just touched: no smooth solver ends there."""
    solution = mbd.optimize(against_buffer(limit), intervals=40)
    assert solution.cost == pytest.approx(least_effort(), rel=1e-3)
    rounding = solution.statistics.rounding
    assert 0 <= rounding <= 1e-3 and ("rounded" in repr(solution)) is (rounding > 0)
    assert solution.verify().final_error < 2e-4


def test_kinks_that_no_mesh_point_meets_stay_sharp():
    """A mesh on which the solver ends by itself."""
    solution = mbd.optimize(against_buffer(np.inf), intervals=41)
    assert solution.cost == pytest.approx(least_effort(), rel=1e-4)
    assert solution.statistics.rounding == 0 and "rounded" not in repr(solution)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 5])
def test_a_pendulum_on_an_elastic_rope(seed):
    """A rope that gets taut on the way, by default settings."""
    random = np.random.default_rng(seed)
    rod = mbd.Body("rod", mass=1, inertia=0.1, pose=(0, -0.5, -np.pi / 2))
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), rod.at(-0.5, 0))
    torque = mbd.Input("torque")
    length, stiffness = random.uniform(1.0, 1.4), 10 ** random.uniform(1, 3)
    rope = mbd.Rope("rope", mbd.ground.at(-1, -1), rod.at(0.5, 0), length, stiffness)
    drive = mbd.Torque("drive", rod, torque)
    model = mbd.Mechanism([rod], [hinge], forces=[mbd.Gravity(), rope, drive], inputs=[torque])
    duration, turn = random.uniform(0.6, 2), random.uniform(0.5, 1.5)
    ends = {"initial": [hinge.angle == -np.pi / 2], "final": [hinge.angle == turn - np.pi / 2]}
    ends = {name: [*places, rod.omega == 0] for name, places in ends.items()}
    solution = mbd.optimize(mbd.OptimalControlProblem(model, duration, **ends, running_cost=torque**2))
    assert solution.mesh_error < 1e-2
    # each interval by itself: a taut rope makes errors of the first intervals grow
    assert solution.trajectory.final[hinge.angle] == pytest.approx(turn - np.pi / 2, abs=1e-8)


def test_limits_of_the_user_are_kept():
    """A number of iterations that the user sets is that of the only solve."""
    with pytest.raises(mbd.OptimizationError, match="max_iter") as caught:
        mbd.optimize(against_buffer(np.inf), intervals=40, options={"ipopt.max_iter": 70})
    assert caught.value.partial.statistics.iterations == 70


def test_kinks_that_no_variable_moves():
    """Jumps at an instant, or of a parameter, stay as they are."""
    x, t, p = (ca.SX.sym(name) for name in "xtp")
    rows = mbd.if_else(t > 0.5, x, 0) * ca.fabs(p)
    piece = MappedBlock(x, t, p, rows + ca.fabs(x), ca.SX(0), np.zeros((1, 1), int))
    assert [str(node) for _, node in piece.kinks] == ["fabs(x)"]
    assert replace(piece, rows=ca.fmax(x, -x)).kinks
    width = ca.SX.sym("w")
    rounded = _rounded(piece, width, np.ones(1)).rows
    values = ca.Function("values", [x, t, p, width], [rounded - rows])
    assert [float(values(0.2, at, -3, 0.1)) for at in (0.4, 0.5, 0.6)] == pytest.approx([np.hypot(0.2, 0.1)] * 3)
    assert not replace(piece, rows=rows).kinks


def test_the_time_of_all_solves_is_counted_once():
    """The statistics have no more seconds than the call took."""
    began = time.perf_counter()
    statistics = mbd.optimize(against_buffer(np.inf), intervals=40).statistics
    assert statistics.rounding > 0
    assert statistics.build_seconds < statistics.seconds < time.perf_counter() - began


@pytest.mark.parametrize(
    ("number", "rounding", "kept"),
    [(1, 0.1, "the last iterate"), (5, 0.003, "the best solution"), (10, 1e-5, "the best solution")],
)
def test_ctrl_c_keeps_the_solution_with_the_narrowest_kinks(monkeypatch, number, rounding, kept):
    """In the first solve with rounded kinks, in a later one, and in the last solve, with sharp kinks."""
    caught = interrupted_in(
        monkeypatch, number, lambda: mbd.optimize(against_buffer(np.inf), intervals=40), Ipopt, "run"
    )
    assert kept in str(caught)
    assert caught.partial.statistics.rounding == rounding


@pytest.mark.slow
def test_a_slack_rope_has_no_slope_at_first():
    """A cart tows a sled by an elastic rope, which is slack in the guess: no demand comes nearer by any small step.

    The cost of Gauss collocation by hand, on 80 and 200 intervals with kinks rounded to less than 0.1 mm, is 1.4987.
    """
    stiffness, drag, far, duration = 153.33413320350314, 1.1798631431652276, 0.7006000486814428, 2.479056858748842
    push = mbd.Input("push")
    sled = mbd.Body("sled", mass=1.9243627257751041, inertia=0.1)
    cart = mbd.Body("cart", mass=0.8461153960471686, inertia=0.1, pose=(1, 0, 0))
    bodies = [sled, cart]
    rails = [mbd.Translational(f"rail of {b.name}", mbd.ground.at(0, 0), b.at(0, 0)) for b in bodies]
    rope = mbd.TSDA("rope", sled.at(0, 0), cart.at(0, 0), law=lambda length, _: stiffness * mbd.fmax(length - 1, 0))
    forces = [rope, mbd.Force("push", cart.at(0, 0), (push, 0)), mbd.Force("drag", sled.at(0, 0), (-drag * sled.vx, 0))]
    problem = mbd.OptimalControlProblem(
        mbd.Mechanism(bodies, rails, forces=forces, inputs=[push]),
        duration=duration,
        initial=[sled.x == 0, cart.x == 1, sled.vx == 0, cart.vx == 0],
        final=[sled.x == far, cart.vx == 0],
        running_cost=push**2,
    )
    assert mbd.optimize(problem).cost == pytest.approx(1.4987, rel=0.05)
