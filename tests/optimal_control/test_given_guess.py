"""Guesses that a user gives by expressions: coordinates, points, inputs, states and free parameters over time."""

import numpy as np
import pytest
from motions import crank_rocker, guided_block, half_turn, rest_to_rest
from scipy.interpolate import CubicSpline

import mbdcasadi as mbd

TIMES = np.linspace(0, 1, 21)
#: Times between the ends, whose values the conditions decide.
INNER = TIMES[1:-1]


def first(problem, guess, **settings):
    """The guess itself, on the mesh of the solver."""
    with pytest.raises(mbd.OptimizationError) as caught:
        mbd.optimize(problem, **({"intervals": 20} | settings), guess=guess, options={"ipopt.max_iter": 0})
    return caught.value.partial


def arm():
    """Two links that hang from a bar, with a motor in the elbow, from bar to bar with the hand."""
    a = mbd.Body("first", 1.0, 1 / 48, pose=(-0.15, -0.2, np.arctan2(-0.4, -0.3)))
    b = mbd.Body("second", 1.0, 1 / 48, pose=(-0.45, -0.2, np.arctan2(0.4, -0.3)))
    hold, elbow = (
        mbd.Revolute("hold", mbd.ground.at(0, 0), a.at(-0.25, 0)),
        mbd.Revolute("elbow", a.at(0.25, 0), b.at(-0.25, 0)),
    )
    u = mbd.Input("u", lower=-20, upper=20)
    forces = [mbd.Gravity(), mbd.Torque("motor", b, u, opposite=a)]
    mechanism = mbd.Mechanism([a, b], joints=[hold, elbow], forces=forces, inputs=[u])
    hand, rest = b.at(0.25, 0), [a.omega == 0, b.omega == 0]
    problem = mbd.OptimalControlProblem(
        mechanism,
        duration=(0.3, 3),
        initial=[a.phi == np.arctan2(-0.4, -0.3), b.phi == np.arctan2(0.4, -0.3), *rest],
        final=[hand.x == 0.6, hand.y == 0, *rest],
        running_cost=u**2,
    )
    return problem, a, b, hand, u


@pytest.mark.slow
def test_a_swing_below_the_bar_is_cheaper():
    """From bar to bar the usual guess leads to a cost above 6; the hand below the bar, given by three points, below 3.

    Also with an input that is given, and from durations that are.
    """
    problem, *_, hand, u = arm()
    below = {hand.x: [-0.6, 0, 0.6], hand.y: [0, -0.9, 0]}
    found = mbd.optimize(problem, guess=below)
    assert found.cost < 0.5 * mbd.optimize(problem, search=mbd.STRATEGIES[:1]).cost and found.cost < 3
    slower = problem.replace(duration=mbd.between(0.3, 3, guess=1.6))
    assert mbd.optimize(slower, guess=below | {u: 0.0}).cost < found.cost


def test_a_point_is_where_it_is_given():
    """Both of its coordinates decide the arm, on the branch of the start; one leaves the rest as it would be."""
    problem, _, b, hand, u = arm()
    fixed = problem.replace(duration=1.0)
    path = {hand.x: -0.6 + 1.2 * mbd.t, hand.y: -0.8 * mbd.sin(np.pi * mbd.t)}
    motion = first(fixed, path).trajectory
    at = motion.at(INNER)
    assert np.allclose(at[hand.x], -0.6 + 1.2 * INNER, atol=1e-3)
    assert np.allclose(at[hand.y], -0.8 * np.sin(np.pi * INNER), atol=1e-3)
    assert np.all(np.diff(at[b.phi]) > -0.3), "it does not jump to the other elbow"
    alone = first(fixed, {hand.y: -0.8 * mbd.sin(np.pi * mbd.t)}).trajectory.at(INNER)
    assert np.allclose(alone[hand.y], -0.8 * np.sin(np.pi * INNER), atol=1e-3)
    usual = first(fixed, {u: 0.0}).trajectory.at(INNER)
    assert np.allclose(usual[hand.y], first(fixed, None).trajectory.at(INNER)[hand.y], atol=1e-6)


def test_what_is_out_of_reach_is_met_as_nearly_as_can_be():
    """A hand beyond the length of the arm leaves the joints closed."""
    problem, a, b, hand, _ = arm()
    motion = first(problem.replace(duration=1.0), {hand.x: [-0.6, 2.0], hand.y: [0.0, 0.0]}).trajectory.at(TIMES)
    assert np.allclose(motion[b.at(-0.25, 0).x], motion[a.at(0.25, 0).x], atol=1e-6)
    assert motion[hand.x][-1] > 0.9


@pytest.mark.parametrize(
    "course",
    [
        0.3 * TIMES,
        (0.5 * TIMES, 0.3 * TIMES),
        CubicSpline(TIMES, 0.3 * TIMES),
        0.3 * mbd.t,
        lambda times: 0.3 * times,
    ],
    ids=["array", "pair", "spline", "expression", "function"],
)
def test_forms_of_a_course(course):
    """An array over the duration, times and values, stretched to a duration that is fixed, a spline, an expression."""
    problem, u, block = rest_to_rest()
    motion = first(problem, {block.x: course, u: 7.0}).trajectory.at(INNER)
    assert np.allclose(motion[block.x], 0.3 * INNER, atol=1e-8)
    assert np.allclose(motion[block.vx], 0.3, atol=1e-6) and np.allclose(motion[u], 7.0)


def test_inputs_that_are_not_given_follow_from_the_motion():
    """By inverse dynamics of the poses; of a loop its multipliers, too, beside inputs that are given."""
    problem, u, block = rest_to_rest(mass=2.0)
    motion = first(problem, {block.x: mbd.t**2}).trajectory.at(TIMES[2:-2])
    assert np.allclose(motion[u], 4.0, rtol=1e-6)
    f = crank_rocker()
    turn = {f.o2.angle: 0.5 + np.pi * np.linspace(0, 1, 25)}
    free, held = (first(half_turn(f), guess).trajectory.at([0.3]) for guess in (turn, turn | {f.tau: 1.5}))
    assert held[f.tau] == pytest.approx([1.5]) and abs(free[f.tau][0] - 1.5) > 0.1
    assert held[f.o4.angle] == pytest.approx(free[f.o4.angle], abs=1e-9)


def test_states_and_free_parameters():
    """First-order states with their rates, and parameters by numbers."""
    u, z, reach = mbd.Input("u"), mbd.StateVariable("z"), mbd.Parameter("reach", 1.0, lower=0.1, upper=9)
    block, mechanism = guided_block(1.0, u, states={z: u - z})
    problem = mbd.OptimalControlProblem(
        mechanism, 1.0, initial=[block.x == 0], final=[block.x == reach], running_cost=u**2, free_parameters=[reach]
    )
    partial = first(problem, {z: [1.0, 3.0], reach: 4.5})
    assert partial.parameters[reach] == pytest.approx(4.5)
    assert np.allclose(partial.trajectory.at(TIMES)[z], 1 + 2 * TIMES, atol=1e-6)


def test_times_decide_the_first_duration():
    """Within its limits; else the guess of the problem does, or its usual duration."""
    problem, _, block = rest_to_rest()
    free = problem.replace(duration=(0.5, 8.0), terminal_cost=mbd.t)

    def duration(stated, course):
        return first(stated, {block.x: course}).duration

    assert duration(free, [0, 1]) == pytest.approx(2.0)
    assert duration(free, ([0, 3], [0, 1])) == pytest.approx(3.0)
    assert duration(free, ([0, 30], [0, 1])) == pytest.approx(8.0, rel=0.02), "the solver keeps off limits"
    guessed = free.replace(duration=mbd.between(0.5, 8.0, guess=0.7))
    assert duration(guessed, [0, 1]) == pytest.approx(0.7)
    assert duration(guessed, ([0, 3], [0, 1])) == pytest.approx(3.0), "times of the motion itself count more"


def push_and_coast():
    """A block that is pushed in one phase and slides in the next."""
    problem, u, block = rest_to_rest()
    sliding = problem.mechanism.replace(forces=[], inputs=[])
    phases = [
        mbd.Phase("push", problem.mechanism, (0.1, 4), initial=[block.x == 0, block.vx == 0], running_cost=u**2),
        mbd.Phase("slide", sliding, (0.1, 4), final=[block.x == 1]),
    ]
    return mbd.OptimalControlProblem(phases=phases, boundary=[mbd.at_end(mbd.t) <= 3]), phases, u, block


def test_guesses_of_phases():
    """By the phase or its name; without one they are over the whole motion, in the phases that have the expression."""
    problem, (push, slide), u, block = push_and_coast()
    whole = first(problem, {block.x: ([0, 1, 3], [0, 0.2, 1]), u: 0.5})
    assert whole.duration == pytest.approx(3) and whole.durations[0] == pytest.approx(1.5)
    assert whole.trajectory.at([1.0])[block.x] == pytest.approx([0.2], abs=1e-3)
    assert whole.phases[0].trajectory.at([0.7])[u] == pytest.approx([0.5])
    for key in (push, "push"):
        each = first(problem, {key: {block.x: ([0, 1], [0, 0.5])}, slide: {block.x: ([0, 0.5], [0.5, 1])}})
        assert each.durations == pytest.approx((1.0, 0.5))
        assert each.trajectory.at([0.5, 1.25])[block.x] == pytest.approx([0.25, 0.75], abs=1e-6)
    for wrong in ({"fly": {block.x: [0, 1]}}, {mbd.Phase("fly", push.mechanism, 1): {block.x: [0, 1]}}):
        with pytest.raises(mbd.ModelError, match="'fly'; the phases that last are 'push', 'slide'"):
            mbd.optimize(problem, guess=wrong)
    with pytest.raises(mbd.ExpressionError, match="input 'u', which the mechanism of phase 'slide' does not have"):
        mbd.optimize(problem, guess={"slide": {u: 1.0}})


@pytest.mark.parametrize(
    "course, words",
    [
        ([[0, 1], [2, 3]], r"shape \(2, 2\); give at least two values over the duration"),
        ([1.0], r"shape \(1,\)"),
        ([0, np.nan], "value nan as sample 1"),
        (([0, 1, 2], [0, 1]), r"shape \(2,\); give 3 values, as there are times"),
        (([1, 0], [0, 1]), "times must increase"),
        (([-1, 0], [0, 1]), "times count from the start of the motion"),
        ("up", "takes a number, an array over the duration, a pair"),
        (None, "got None|shape|nan"),
        (mbd.Input("stranger"), "contains input 'stranger'; it takes expressions in t alone"),
        (mbd.t * mbd.Parameter("rate", 1.0), "contains symbol 'rate'; it takes expressions in t alone"),
        (mbd.log(mbd.t - 0.5), "is nan at t = 0"),
        (lambda times: [1, 2, 3], "no function from times"),
    ],
)
def test_courses_that_are_none(course, words):
    """Each is refused by the expression and what is wrong."""
    problem, _, block = rest_to_rest()
    with pytest.raises(mbd.MechanismError, match=f"guess of block.x.*({words})"):
        mbd.optimize(problem, guess={block.x: course})


def test_expressions_that_are_none():
    """Strange symbols, velocities, relations, vectors, numbers, and parameters that are not free."""
    problem, u, block = rest_to_rest()
    other, k = mbd.Body("other", 1, 1), mbd.Parameter("k", 1.0)
    cases = [
        ({other.x: 1.0}, "guess= holds other.x, with position 'other.x', which the mechanism does not have"),
        ({block.vx: 1.0}, "block.vx; it takes expressions in positions, inputs and first-order states alone"),
        ({2 * u: 1.0}, "positions, inputs and first-order states alone"),
        ({block.x == 1: 1.0}, "an expression for each number"),
        ([(block.at(0, 0).position, [0, 1])], "an expression for each number"),
        ({3: 1.0}, "an expression for each number"),
        ({k: 1.0}, "holds the parameter 'k', which is not free"),
        (5.0, "takes a Solution, a Trajectory or {expression: values over time}"),
    ]
    for guess, words in cases:
        with pytest.raises(mbd.MechanismError) as caught:
            mbd.optimize(problem, guess=guess)
        assert words in str(caught.value), caught.value


def test_the_same_model_built_anew():
    """Bodies are matched by their names; what does not fit is said."""
    before = mbd.optimize(half_turn(crank_rocker()), intervals=12)
    problem = half_turn(crank_rocker())
    for motion in (before, before.trajectory):
        again = mbd.optimize(problem, intervals=12, guess=motion)
        assert again.cost == pytest.approx(before.cost, rel=1e-6) and again.statistics.iterations <= 12
    stranger = mbd.optimize(rest_to_rest()[0], intervals=4)
    with pytest.raises(
        mbd.ModelError, match=r"no coordinate crank.x: it is of the bodies 'block', the phase 'motion' has"
    ):
        mbd.optimize(problem, intervals=4, guess=stranger)


def test_poses_have_the_guessed_parameters():
    """A pendulum of free length: the given angle, and a bob at the length that is given."""
    length = mbd.Parameter("length", 1.0, lower=0.2, upper=3)
    tau, bob = mbd.Input("tau"), mbd.Body("bob", 1.0, 0.0, pose=(0, -1, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), bob.at(0, length))
    mechanism = mbd.Mechanism(
        [bob], joints=[pin], forces=[mbd.Torque("motor", bob, tau)], inputs=[tau], parameters=[length]
    )
    problem = mbd.OptimalControlProblem(mechanism, 1.0, running_cost=tau**2, free_parameters=[length])
    motion = first(problem, {bob.phi: [0.0, 1.0], length: 2.0}).trajectory.at(INNER)
    assert np.allclose(np.hypot(motion[bob.x], motion[bob.y]), 2.0, atol=1e-6)
    assert np.allclose(motion[bob.phi], INNER, atol=1e-6)
