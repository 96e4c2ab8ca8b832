"""Places that a mechanism of one degree of freedom does not reach in the time, by the work of its inputs."""

import numpy as np
import pytest
from motions import crank_rocker, pendulum, rest_to_rest, swing_up

import mbdcasadi as mbd
from mbdcasadi.numerics.symbolic import LOCK
from mbdcasadi.optimal_control.program.problem_setup import ProblemSetup
from mbdcasadi.optimal_control.program.setup import Settings
from mbdcasadi.optimal_control.search.in_time import least_times, out_of_time


def late(problem):
    """Name of a place that is out of reach."""
    with LOCK:
        return out_of_time(ProblemSetup(problem, Settings.read("gauss-legendre", 3, "polynomial", None, False)))


def test_least_times():
    """At a constant rate s = w0 t + b t²/2; without one a body that is thrown up rises for (v - sqrt(v² - 2 g h))/g."""
    lengths = np.linspace(0, 2, 400)
    np.testing.assert_allclose(least_times(lengths, 0 * lengths, 0.0, 3.0), np.sqrt(2 * lengths / 3), rtol=1e-9)
    falls = least_times(lengths, 0 * lengths, 1.0, 3.0)
    np.testing.assert_allclose(falls + 1.5 * falls**2, lengths, rtol=1e-9, atol=1e-12)
    rises = least_times(lengths, 2 * 9.81 * lengths, 7.0, 0.0)
    exact = (7 - np.sqrt(49 - 2 * 9.81 * lengths)) / 9.81
    assert np.all(rises <= exact) and rises[-1] == pytest.approx(exact[-1], rel=5e-3)
    assert np.all(np.isinf(least_times(lengths, 2 * 9.81 * lengths, 5.0, 0.0)[lengths > 25 / 19.62 + 0.01]))


@pytest.mark.parametrize(("share", "expected"), [(0.85, "the end"), (1.001, "")])
@pytest.mark.parametrize("by_path", [False, True])
def test_a_block_from_rest_to_rest(share, expected, by_path):
    """1 kg over 1 m in 1 s takes 4 N, as limits of the input or on the path."""
    force = 4 * share
    problem, u, _ = rest_to_rest(**({} if by_path else {"lower": -force, "upper": force}))
    assert late(problem.replace(path=[mbd.bounded(-force, u, force)] if by_path else [])) == expected


def test_unknown_loads():
    """Nothing is said of inputs without limits, of a rate of the load with time, and of an unstable damper."""
    problem, _, block = rest_to_rest(lower=-0.4, upper=0.4)
    assert late(problem) == "the end" and late(rest_to_rest(upper=0.4)[0]) == ""
    for load in (0.1 * mbd.t, 0.1 * block.vx):
        more = problem.mechanism.replace(
            forces=[*problem.mechanism.forces, mbd.GeneralizedForce("load", [(block.x, load)])]
        )
        assert late(problem.replace(mechanism=more)) == ""


def test_a_swing_helps():
    """A pendulum that swings back: 8 N m lift 1 kg at 1 m, which weighs more, to the top in 2 s, but not in 0.8 s.

    With all the torque in the sense of the motion the energy at the top takes sqrt(4 g)/8 = 0.78 s alone.
    """
    problem, *_ = swing_up(8.0, 2.0)
    assert mbd.optimize(problem, intervals=20).cost > 0 and late(problem) == ""
    assert late(swing_up(8.0, 0.8)[0]) == "the end"


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(8))
def test_what_a_simulation_reaches_is_within_reach(seed):
    """A crank and a damped pendulum under full torque, with switches at random: never out of reach, sooner it is."""
    random = np.random.default_rng(seed)
    limit, duration, switches = random.uniform(2, 20), random.uniform(0.3, 1.5), np.sort(random.uniform(0, 1, 3))
    if seed % 2:
        limit, duration = limit / 12, duration / 4
        f = crank_rocker(limit=limit)
        body, tau, mechanism = f.crank, f.mechanism.inputs[0], f.mechanism
    else:
        body, tau, mechanism = pendulum(limit=limit, inertia=0.1)
        damper = mbd.RSDA("damper", mbd.ground.at(0, 0), body.at(0, 0), 3.0, damping=random.uniform(0, 1))
        mechanism = mechanism.replace(forces=[*mechanism.forces, damper])
    times = np.linspace(0, duration, 400)
    torque = limit * (-1.0) ** np.searchsorted(switches[: seed % 4] * duration, times)
    start = [body.phi == float(mbd.assemble(mechanism)[body.phi]), body.omega == 0]
    motion = mbd.simulate(mechanism, times, initial=start, inputs={tau: torque})
    reached = [body.phi == float(motion.final[body.phi]), body.omega == float(motion.final[body.omega])]
    problem = mbd.OptimalControlProblem(mechanism, duration, initial=start, final=reached, running_cost=tau**2)
    assert late(problem) == ""
    if not seed % 4:  # without a switch
        assert late(problem.replace(duration=0.4 * duration)) == "the end"
