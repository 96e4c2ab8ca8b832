"""The same problem in other units has the same answer."""

from functools import cache

import numpy as np
import pytest
from motions import crank_rocker, guided_block, half_turn, pendulum

import mbdcasadi as mbd

#: Metres and kilograms in so many of the new units: mm and g, mm and kg, km and t, inches and pounds.
UNITS = [(1e3, 1e3), (1e3, 1.0), (1e-3, 1e-3), (39.37, 2.2046)]


@cache
def in_units(length, mass, changes=lambda f, length, mass: {}, **settings):
    """Solution, cost and torque in SI, positions of the rocker in m."""
    f = crank_rocker(length, mass)
    problem = half_turn(f, **changes(f, length, mass))
    solution = mbd.optimize(problem, **({"intervals": 30} | settings))
    shares = np.linspace(0, 1, 61)
    motion = solution.trajectory.at(solution.duration * shares)
    torque = motion[f.tau] / (mass * length**2)
    return solution, torque, motion[mbd.vertcat(f.rocker.x, f.rocker.y)] / length, motion[f.crank.phi]


def agree(reference, other):
    """Torque and motion to 1e-6 of their size."""
    for mine, theirs in zip(reference[1:], other[1:], strict=True):
        assert np.max(np.abs(mine - theirs)) <= 1e-6 * np.max(np.abs(mine))
    assert other[0].duration == pytest.approx(reference[0].duration, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("settings", [dict(), dict(transcription="hermite-simpson"), dict(control="linear")])
def test_least_effort(settings):
    """Cost, torque and motion."""
    reference = in_units(1.0, 1.0, **settings)
    for length, mass in UNITS:
        other = in_units(length, mass, **settings)
        agree(reference, other)
        assert other[0].cost / (mass * length**2) ** 2 == pytest.approx(reference[0].cost, rel=1e-6)


@pytest.mark.slow
def test_the_solver_sees_the_same_numbers():
    """Scaled by lengths, masses and the time of the model, the program is the same: so is the number of iterations."""
    counts = [in_units(length, mass)[0].statistics.iterations for length, mass in [(1.0, 1.0), *UNITS]]
    assert len(set(counts)) == 1, counts


def fast(f, length, mass):
    """Least time with 6 N m."""
    limit = 6 * mass * length**2
    return dict(duration=(0.05, 2.0), running_cost=0, terminal_cost=mbd.t, path=[mbd.bounded(-limit, f.tau, limit)])


@pytest.mark.slow
def test_least_time():
    """The duration to 1e-6."""
    reference = in_units(1.0, 1.0, fast, intervals=40)
    for length, mass in UNITS:
        other = in_units(length, mass, fast, intervals=40)
        assert other[0].duration == pytest.approx(reference[0].duration, rel=1e-6)


def gentle(f, length, mass):
    """A bearing force in units of the model."""
    return dict(path=[mbd.norm(f.o4.reaction_on(f.rocker).force) <= 11.3 * mass * length])


def smooth(f, length, mass):
    """The rate of the torque."""
    return dict(running_cost=f.tau.rate**2)


def tuned(f, length, mass):
    """A spring between crank and rocker, found with the motion."""
    stiffness = mbd.Parameter("k", 20.0 * mass, lower=0.0)
    spring = mbd.TSDA("spring", f.crank.at(0, 0), f.rocker.at(0, 0), stiffness=stiffness, free_length=0.25 * length)
    mechanism = f.mechanism.replace(forces=[*f.mechanism.forces, spring], parameters=[stiffness])
    return dict(mechanism=mechanism, free_parameters=[stiffness])


@pytest.mark.slow
@pytest.mark.parametrize("changes", [gentle, smooth, tuned])
def test_other_problems(changes):
    """Limits on reactions, rates of inputs, free parameters."""
    reference = in_units(1.0, 1.0, changes)
    other = in_units(1e3, 1e3, changes)
    agree(reference, other)
    for mine, theirs in zip(reference[0].parameters.values(), other[0].parameters.values(), strict=True):
        assert theirs == pytest.approx(1e3 * mine, rel=1e-5)


@pytest.mark.slow
def test_limits_and_costates_in_other_units():
    """Labels hold the numbers of the units; costates scale as cost over limit."""
    reference, other = in_units(1.0, 1.0, gentle)[0], in_units(1e3, 1e3, gentle)[0]
    active = reference.active_limits, other.active_limits
    assert [len(a) for a in active] == [1, 1]
    assert active[1][0].costate == pytest.approx(active[0][0].costate * 1e18 / 1e6, rel=1e-4)


def test_what_ties_the_end_to_the_start_has_the_size_of_its_symbols():
    """A periodic swing of a pendulum of 1 m, in metres and in millimetres."""
    found = []
    for length in (1.0, 1e3):
        bob, tau, mechanism = pendulum(length, gravity=9.81 * length)
        problem = mbd.OptimalControlProblem(
            mechanism,
            duration=2.5,
            initial=[bob.phi == 0.3],
            boundary=[mbd.at_end(e) == mbd.at_start(e) for e in (bob.x, bob.vx, tau)],
            running_cost=tau**2,
        )
        solution = mbd.optimize(problem, intervals=15)
        found.append((solution.statistics.iterations, solution.cost / length**4))
    assert found[1] == pytest.approx(found[0], rel=1e-8)


@pytest.mark.parametrize("middle", [0.2, 0.5, 0.8])
def test_the_size_of_a_cost_in_a_window_of_time(middle):
    """Most of the time a small cost on the input is all there is; the solver sees the cost as a number near one."""
    push = mbd.Input("u")
    block, mechanism = guided_block(1.0, push)
    window = (mbd.tanh((mbd.t - middle + 0.15) / 0.02) - mbd.tanh((mbd.t - middle - 0.15) / 0.02)) / 2
    problem = mbd.OptimalControlProblem(
        mechanism,
        duration=1.0,
        initial=[block.x == 0, block.vx == 0],
        final=[block.x == 1, block.vx == 0],
        running_cost=window * (block.x - 0.5) ** 2 + 1e-9 * push**2,
    )
    solution = mbd.optimize(problem, intervals=40)
    assert 1e-3 < solution.program.cost_scale < 1
    assert solution.statistics.iterations < 20


#: Length, mass and time of machines: of millimetres and grams, of micrometres, of kilometres and hours.
SMALL_AND_LARGE = [(1e-3, 1e-3, 1.0), (1e-6, 1e-12, 1e-4), (1e3, 1e6, 1e4)]


def moved_block(length, mass, time, **statement):
    """A block that moves for two seconds by a force of up to 3 N, and what a cost needs."""
    force = mass * length / time**2
    push = mbd.Input("push", lower=-3 * force, upper=3 * force)
    block, mechanism = guided_block(mass, push, inertia=0.01 * mass * length**2)
    problem = mbd.OptimalControlProblem(
        mechanism, duration=2 * time, initial=[block.x == 0, block.vx == 0], **statement_of(statement, block, push)
    )
    return mbd.optimize(problem, intervals=20)


def statement_of(statement, block, push):
    """Arguments that are functions of block and push, called."""
    return {name: value(block, push) for name, value in statement.items()}


@pytest.mark.parametrize("length, mass, time", SMALL_AND_LARGE)
def test_the_magnitude_of_a_force_in_a_cost_is_as_large_as_the_force(length, mass, time):
    """Least impulse: 3 N for s, -3 N for s; s (2 - s) 3 = 1. The mesh leaves 0.3 per cent."""
    solution = moved_block(
        length,
        mass,
        time,
        final=lambda block, push: [block.x == length, block.vx == 0],
        running_cost=lambda block, push: mbd.absolute(push),
    )
    wanted = 6 * (1 - np.sqrt(1 - 1 / 3))
    assert solution.cost / (mass * length / time) == pytest.approx(wanted, rel=3e-3)


@pytest.mark.parametrize("length, mass, time", SMALL_AND_LARGE)
def test_a_distance_in_the_terminal_cost_is_as_large_as_the_way(length, mass, time):
    """Effort 12 x²/T³ and 2 |x - 1|: x = 2/3."""
    effort = length / ((mass * length / time**2) ** 2 * time)
    solution = moved_block(
        length,
        mass,
        time,
        final=lambda block, push: [block.vx == 0],
        running_cost=lambda block, push: effort * push**2,
        terminal_cost=lambda block, push: 2 * mbd.absolute(block.x - length),
    )
    assert solution.cost / length == pytest.approx(4 / 3, rel=1e-6)
    assert solution.trajectory.q[-1, 0] / length == pytest.approx(2 / 3, rel=1e-5)


@pytest.mark.parametrize("length, mass, time", SMALL_AND_LARGE)
def test_a_peak_without_a_value_is_as_large_as_what_it_limits(length, mass, time):
    """Least peak of the force for 1 m in 2 s: 1 N, half forwards, half backwards."""
    peak = mbd.Parameter("peak", 0.0)
    solution = moved_block(
        length,
        mass,
        time,
        final=lambda block, push: [block.x == length, block.vx == 0],
        terminal_cost=lambda block, push: peak,
        path=lambda block, push: [push <= peak, -push <= peak],
        free_parameters=lambda block, push: [peak],
    )
    assert solution.cost / (mass * length / time**2) == pytest.approx(1.0, rel=1e-6)
