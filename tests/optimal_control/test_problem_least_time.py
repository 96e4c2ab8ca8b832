"""Least time: closed forms and phase planes."""

import numpy as np
import pytest
from motions import pendulum, rest_to_rest

import mbdcasadi as mbd


@pytest.mark.slow
@pytest.mark.parametrize("transcription", ["gauss-legendre", "hermite-simpson"])
@pytest.mark.parametrize("control", ["polynomial", "linear", "constant"])
def test_a_block_there_and_back(transcription, control):
    """T = 2 sqrt(m d / F); the peak speed is sqrt(d F / m)."""
    problem, force, block = rest_to_rest(4.0, 1.0, mass=2.0, lower=-5, upper=5)
    fast = problem.replace(duration=(0.5, 10.0), running_cost=0, terminal_cost=mbd.t)
    solution = mbd.optimize(fast, intervals=20, transcription=transcription, control=control)
    # inputs that are joined cannot jump: the least time without a jump, and without passing the limit, is a little more
    joined = control == "linear" or (control, transcription) == ("polynomial", "hermite-simpson")
    assert solution.duration == pytest.approx(2 * np.sqrt(8 / 5), rel=2e-3 if joined else 1e-6)
    assert solution.duration >= 2 * np.sqrt(8 / 5) * (1 - 1e-8)
    fine = np.linspace(0, solution.duration, 2001)
    assert np.max(np.abs(solution.trajectory.at(fine)[force])) <= 5 + 1e-7
    assert np.max(solution.trajectory[block.vx]) == pytest.approx(
        np.sqrt(10), rel=1e-3 if control == "constant" else 0.06
    )


def test_unequal_limits():
    """Faster to start than to stop: T = sqrt(2 m d (1/F + 1/B)), not on the mesh points."""
    problem, _u, _block = rest_to_rest(4.0, 1.0, mass=2.0, lower=-2, upper=5)
    fast = problem.replace(duration=(0.5, 10.0), running_cost=0, terminal_cost=mbd.t)
    exact = np.sqrt(2 * 2 * 4 * (1 / 5 + 1 / 2))
    errors = [mbd.optimize(fast, intervals=n, control="constant").duration - exact for n in (25, 100)]
    assert 0 <= errors[1] < 2e-4 * exact and errors[1] < errors[0]


def test_a_speed_limit():
    """With |v| <= V: T = d / V + V m / F."""
    problem, _u, block = rest_to_rest(4.0, 1.0, mass=2.0, lower=-5, upper=5)
    fast = problem.replace(duration=(0.5, 10.0), running_cost=0, terminal_cost=mbd.t, path=[block.vx <= 2])
    solution = mbd.optimize(fast, intervals=50)
    assert solution.duration == pytest.approx(4 / 2 + 2 * 2 / 5, rel=1e-3)


def phase_plane(start, end, limit, weight):
    """Least time of phi'' = u - weight sin phi, |u| <= limit, rest to rest with one switch.

    omega²/2 - weight cos phi gains u dphi; the switch is where both arcs meet,
    and the time is the integral of dphi / omega, with the root at rest taken out.
    """
    from scipy.integrate import quad

    switch = (limit * (start + end) + weight * (np.cos(start) - np.cos(end))) / (2 * limit)

    def speed(phi):
        if phi < switch:
            return np.sqrt(2 * (limit * (phi - start) + weight * (np.cos(phi) - np.cos(start))))
        return np.sqrt(2 * (limit * (end - phi) + weight * (np.cos(phi) - np.cos(end))))

    first, last = np.sqrt(switch - start), np.sqrt(end - switch)
    rise = quad(lambda s: 2 * s / speed(start + s**2), 0, first, epsabs=1e-12)[0]
    return rise + quad(lambda s: 2 * s / speed(end - s**2), 0, last, epsabs=1e-12)[0], rise, speed(switch)


@pytest.mark.slow
@pytest.mark.parametrize(("end", "limit"), [(1.0, 15.0), (2.5, 25.0), (np.pi, 12.0)])
def test_a_pendulum_in_the_phase_plane(end, limit):
    """Switching time and peak speed by quadrature of the energy."""
    duration, switch, peak = phase_plane(0.0, end, limit, 9.81)
    bob, tau, mechanism = pendulum(limit=limit)
    problem = mbd.OptimalControlProblem(
        mechanism,
        duration=(0.1, 5.0),
        initial=[bob.phi == 0, bob.omega == 0],
        final=[bob.phi == end, bob.omega == 0],
        terminal_cost=mbd.t,
    )
    solution = mbd.optimize(problem, intervals=60)
    assert solution.duration == pytest.approx(duration, rel=1e-3)
    assert solution.duration > duration * (1 - 1e-7)
    assert np.max(solution.trajectory[bob.omega]) == pytest.approx(peak, rel=0.02)
    times = np.linspace(0, duration, 1001)[1:-1]
    before = solution.trajectory.at(times)[tau] > 0
    assert np.count_nonzero(np.diff(before)) == 1
    assert times[np.argmin(before)] == pytest.approx(switch, abs=0.03 * duration)


def test_two_blocks_in_the_phase_plane():
    """A block that draws a second one by a massless rod up a slope of gravity: m is the sum, the weight that of one."""
    u = mbd.Input("u", lower=-40, upper=40)
    cart = mbd.Body("cart", mass=2.0, inertia=0.1)
    lift = mbd.Body("lift", mass=1.0, inertia=0.1, pose=(1, 0, np.pi / 2))
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0))
    shaft = mbd.Translational("shaft", mbd.ground.at(1, 0, np.pi / 2), lift.at(0, 0))
    rope = mbd.Constraint("rope", lift.y - cart.x)
    mechanism = mbd.Mechanism(
        bodies=[cart, lift],
        joints=[rail, shaft, rope],
        forces=[mbd.Gravity(), mbd.Force("push", cart.at(0, 0), (u, 0))],
        inputs=[u],
    )
    problem = mbd.OptimalControlProblem(
        mechanism,
        duration=(0.1, 5.0),
        initial=[cart.x == 0, cart.vx == 0],
        final=[cart.x == 1.5, cart.vx == 0],
        terminal_cost=mbd.t,
    )
    up, down = (40 - 9.81) / 3, (40 + 9.81) / 3
    solution = mbd.optimize(problem, intervals=60)
    assert solution.duration == pytest.approx(np.sqrt(2 * 1.5 * (1 / up + 1 / down)), rel=1e-3)
    tension = rope.multipliers[0]
    motion = solution.trajectory.at(np.array([0.1, 0.9]) * solution.duration)
    assert np.abs(motion[tension]) == pytest.approx([9.81 + up, abs(9.81 - down)], rel=1e-3)


def test_least_energy_of_a_pendulum_by_pontryagin():
    """Swing-up with the least integral of the torque squared: the boundary-value problem of the costates."""
    from scipy.integrate import solve_bvp

    bob, tau, mechanism = pendulum()
    problem = mbd.OptimalControlProblem(
        mechanism,
        duration=1.5,
        initial=[bob.phi == 0, bob.omega == 0],
        final=[bob.phi == np.pi, bob.omega == 0],
        running_cost=tau**2,
    )
    solution = mbd.optimize(problem, intervals=30)
    times = np.linspace(0, 1.5, 101)
    motion = solution.trajectory.at(times)
    torque = motion[tau]
    start = np.vstack([motion[bob.phi], motion[bob.omega], -2 * np.gradient(-torque, times), -2 * torque])

    def rates(t, y):
        u = -y[3] / 2
        return np.vstack([y[1], u - 9.81 * np.sin(y[0]), 9.81 * np.cos(y[0]) * y[3], -y[2]])

    bvp = solve_bvp(
        rates, lambda a, b: np.array([a[0], a[1], b[0] - np.pi, b[1]]), times, start, tol=1e-9, max_nodes=100_000
    )
    assert bvp.success
    fine = np.linspace(0, 1.5, 20001)
    exact = np.trapezoid((bvp.sol(fine)[3] / 2) ** 2, fine)
    assert solution.cost == pytest.approx(exact, rel=1e-6)
    assert np.allclose(torque, -bvp.sol(times)[3] / 2, atol=1e-3 * np.max(np.abs(torque)))
