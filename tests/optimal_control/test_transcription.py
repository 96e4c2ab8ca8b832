"""Both transcriptions and all kinds of control on a closed loop: order, energy, replay."""

import numpy as np
import pytest
from motions import crank_rocker, half_turn

import mbdcasadi as mbd


@pytest.fixture(scope="module")
def fine():
    """The half turn of the four-bar, nearly exact."""
    f = crank_rocker()
    problem = half_turn(f)
    return problem, f, mbd.optimize(problem, intervals=60, degree=5)


def torque_of(fine):
    """The optimal torque as one polynomial in time, nearly."""
    _, f, exact = fine
    times = np.linspace(0, 0.6, 101)
    powers = np.polynomial.Polynomial.fit(times, exact.trajectory.at(times)[f.tau], 6).convert().coef
    return sum(float(c) * mbd.t**k for k, c in enumerate(powers))


def prescribed_input(problem, f, torque):
    """The same mechanism under a torque given in time: what is left is the error of the states."""
    return problem.replace(
        final=[], initial=[f.o2.angle == 0.5, f.crank.omega == 0], path=[f.tau == torque], running_cost=0
    )


@pytest.fixture(scope="module")
def simulated(fine):
    """The four-bar under a given torque, by simulation."""
    problem, f, _ = fine
    return mbd.simulate(
        problem.mechanism,
        np.linspace(0, 0.6, 61),
        initial=[f.o2.angle == 0.5, f.crank.omega == 0],
        inputs={f.tau: torque_of(fine)},
        method="erk",
        reltol=1e-13,
        abstol=1e-13,
    )


def end_error(solution, simulated):
    """Largest difference of the last state."""
    last = solution.state(-1)
    return np.max(np.abs(np.r_[last.q - simulated.q[-1], last.v - simulated.v[-1]]))


@pytest.mark.slow
@pytest.mark.parametrize(("degree", "counts"), [(1, (80, 160)), (2, (20, 40)), (3, (48, 96))])
def test_order_of_the_states(fine, simulated, degree, counts):
    """Under a given torque the end state converges with order 2 d."""
    problem, f, _ = fine
    given = prescribed_input(problem, f, torque_of(fine))
    errors = [end_error(mbd.optimize(given, intervals=n, degree=degree, guess=simulated), simulated) for n in counts]
    assert np.log2(errors[0] / errors[1]) >= 2 * degree - 0.3, errors


@pytest.mark.slow
def test_order_of_hermite_and_simpson(fine, simulated):
    """Order four."""
    problem, f, _ = fine
    given = prescribed_input(problem, f, torque_of(fine))
    errors = [
        end_error(mbd.optimize(given, intervals=n, transcription="hermite-simpson", guess=simulated), simulated)
        for n in (40, 80)
    ]
    assert 3.7 <= np.log2(errors[0] / errors[1]) <= 4.6, errors


@pytest.mark.slow
@pytest.mark.parametrize(
    ("settings", "counts", "least"),
    [
        (dict(degree=1), (20, 40), 1.7),
        (dict(degree=2), (10, 20), 3.7),
        (dict(degree=3), (10, 20), 5.7),
        (dict(transcription="hermite-simpson"), (40, 80), 3.7),
    ],
)
def test_order_of_the_cost(fine, settings, counts, least):
    """The cost of the optimum converges with the order of the scheme."""
    problem, _, exact = fine
    errors = [abs(mbd.optimize(problem, intervals=n, guess=exact, **settings).cost - exact.cost) for n in counts]
    assert np.log2(errors[0] / errors[1]) >= least, errors


@pytest.mark.slow
@pytest.mark.parametrize("control", ["linear", "constant"])
@pytest.mark.parametrize("transcription", ["gauss-legendre", "hermite-simpson"])
def test_coarser_inputs_cost_more(fine, control, transcription):
    """Piecewise linear and constant inputs are feasible inputs: the optimum is approached from above."""
    problem, _, exact = fine
    costs = [
        mbd.optimize(problem, intervals=n, control=control, transcription=transcription, guess=exact).cost
        for n in (20, 40)
    ]
    assert costs[0] > costs[1] > exact.cost
    power = 2 if control == "constant" else 4
    assert np.log2((costs[0] - exact.cost) / (costs[1] - exact.cost)) > power - 0.6


@pytest.mark.slow
@pytest.mark.parametrize("control", ["polynomial", "linear", "constant"])
@pytest.mark.parametrize("transcription", ["gauss-legendre", "hermite-simpson"])
def test_every_kind_replays(fine, control, transcription):
    """IDAS with the solution's own inputs comes to the same end; the loops are closed at mesh points."""
    problem, _f, _exact = fine
    solution = mbd.optimize(problem, intervals=40, control=control, transcription=transcription)
    assert solution.statistics.iterations <= 12
    limit = 1e-5 if transcription == "gauss-legendre" else 1e-3
    replay = solution.verify()
    assert replay.final_error < limit and replay.largest_deviation < limit and replay.drift < 1e-11
    closure = np.array([solution.state(k)[problem.equations.Phi] for k in range(41)])
    assert np.max(np.abs(closure)) <= 1e-11


def test_constant_inputs_are_constant(fine):
    """And linear ones linear, continuous across the mesh points."""
    problem, f, exact = fine
    for control in ("constant", "linear"):
        solution = mbd.optimize(problem, intervals=10, control=control, guess=exact)
        shares = np.array([0.1, 0.5, 0.9])
        times = solution.mesh[:-1, None] + np.diff(solution.mesh)[:, None] * shares
        values = solution.trajectory.at(times.ravel())[f.tau].reshape(times.shape)
        assert np.allclose(values[:, 0] - 2 * values[:, 1] + values[:, 2], 0, atol=1e-9)
        if control == "constant":
            assert np.allclose(values[:, 0], values[:, 2], atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("degree", [1, 2, 3, 4, 5])
def test_loops_are_closed_at_the_mesh_points(fine, degree):
    """|Phi| at the nodes as the solver left them is at rounding."""
    problem, _, exact = fine
    solution = mbd.optimize(problem, intervals=12, degree=degree, guess=exact)
    n = problem.equations.q.numel()
    for k in range(13):
        q = solution.phases[0].mesh_states[k, :n]
        assert np.max(np.abs(solution.phases[0].numeric.position(0.0, q, np.zeros(0))[0])) <= 1e-11
