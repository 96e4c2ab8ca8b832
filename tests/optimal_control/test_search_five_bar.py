"""A parallel robot with two motors, from point to point, with the defaults."""

from types import SimpleNamespace

import numpy as np
import pytest

import mbdcasadi as mbd

BASE, UPPER, FORE = 0.25, 0.25, 0.4


def elbows(tip):
    """Elbows of both arms for a position of the tip, bent outwards."""
    found = []
    for side in (-1, 1):
        foot = np.array([side * BASE / 2, 0.0])
        reach = np.asarray(tip) - foot
        rho = np.linalg.norm(reach)
        along = (UPPER**2 - FORE**2 + rho**2) / (2 * rho)
        across = np.sqrt(UPPER**2 - along**2)
        e = reach / rho
        found.append(foot + along * e - side * across * np.array([-e[1], e[0]]))
    return found


def five_bar(tip=(0.0, 0.45), redundant=False):
    """Two arms whose ends meet in the tip; motors at both feet."""
    f = SimpleNamespace(torques=[mbd.Input("t1", lower=-8, upper=8), mbd.Input("t2", lower=-8, upper=8)])
    f.uppers, f.fores, joints = [], [], []
    for k, (side, elbow) in enumerate(zip((-1, 1), elbows(tip), strict=True)):
        foot = np.array([side * BASE / 2, 0.0])
        for name, length, first, last, mass, group in (
            ("upper", UPPER, foot, elbow, 0.8, f.uppers),
            ("fore", FORE, elbow, np.asarray(tip), 0.5, f.fores),
        ):
            angle = np.arctan2(*(last - first)[::-1])
            pose = (*((first + last) / 2), angle)
            group.append(mbd.Body(f"{name} {k + 1}", mass=mass, inertia=mass * length**2 / 12, pose=pose))
        joints += [
            mbd.Revolute(f"foot {k + 1}", mbd.ground.at(*foot), f.uppers[k].at(-UPPER / 2, 0)),
            mbd.Revolute(f"elbow {k + 1}", f.uppers[k].at(UPPER / 2, 0), f.fores[k].at(-FORE / 2, 0)),
        ]
    f.tip = f.fores[0].at(FORE / 2, 0)
    joints.append(mbd.Revolute("tip", f.tip, f.fores[1].at(FORE / 2, 0)))
    if redundant:
        joints.append(mbd.Revolute("second foot", mbd.ground.at(-BASE / 2, 0), f.uppers[0].at(-UPPER / 2, 0)))
    motors = [mbd.Torque(f"motor {k + 1}", f.uppers[k], f.torques[k]) for k in (0, 1)]
    f.mechanism = mbd.Mechanism(
        bodies=[*f.uppers, *f.fores], joints=joints, forces=[mbd.Gravity(), *motors], inputs=f.torques
    )
    return f


def carry(f, start=(-0.12, 0.42), end=(0.15, 0.5), **changes):
    """The tip from rest to rest."""

    def at(point):
        return [f.tip.x == point[0], f.tip.y == point[1], f.tip.vx == 0, f.tip.vy == 0]

    arguments = dict(duration=0.5, initial=at(start), final=at(end), running_cost=f.torques[0] ** 2 + f.torques[1] ** 2)
    return mbd.OptimalControlProblem(f.mechanism, **(arguments | changes))


@pytest.mark.slow
@pytest.mark.parametrize("transcription", ["gauss-legendre", "hermite-simpson"])
@pytest.mark.parametrize("redundant", [False, True])
def test_point_to_point_with_the_defaults(redundant, transcription):
    """Few iterations, loops closed, ends met, IDAS agrees."""
    f = five_bar(redundant=redundant)
    solution = mbd.optimize(carry(f), transcription=transcription)
    assert solution.statistics.iterations <= 15
    assert solution.redundant == redundant
    ends = solution.trajectory.at([0.0, 0.5])[mbd.vertcat(f.tip.x, f.tip.y)]
    assert np.allclose(ends, [[-0.12, 0.42], [0.15, 0.5]], atol=1e-9)
    n = solution.trajectory.q.shape[1]
    assert (
        max(
            np.max(np.abs(solution.phases[0].numeric.position(0.0, q[:n], np.zeros(0))[0]))
            for q in solution.phases[0].mesh_states
        )
        <= 1e-11
    )
    assert solution.verify().final_error < (1e-6 if transcription == "gauss-legendre" else 1e-3)


@pytest.mark.slow
def test_the_order_on_two_degrees_of_freedom():
    """Published for this scheme on a five-bar: error after re-simulation of order 2 d."""
    problem = carry(five_bar())
    fine = mbd.optimize(problem, intervals=60, degree=4)
    for degree, counts in ((1, (20, 40)), (2, (10, 20)), (3, (6, 12))):
        errors = [abs(mbd.optimize(problem, intervals=n, degree=degree, guess=fine).cost - fine.cost) for n in counts]
        assert np.log2(errors[0] / errors[1]) >= 2 * degree - 0.3, (degree, errors)


@pytest.mark.slow
def test_an_obstacle_and_a_bearing_limit():
    """Round a post, with the load of a foot bearing below its free peak."""
    f = five_bar()
    problem = carry(f)
    free = mbd.optimize(problem)
    post = (f.tip.x - 0.02) ** 2 + (f.tip.y - 0.45) ** 2 >= 0.04**2
    load = mbd.norm(f.mechanism.joint("foot 1").reaction_on(f.uppers[0]).force)
    limit = 0.9 * np.max(free.trajectory[load])
    solution = mbd.optimize(problem.replace(path=[post, load <= limit]), guess=free)
    motion = solution.trajectory
    gap = np.sqrt(motion[(f.tip.x - 0.02) ** 2 + (f.tip.y - 0.45) ** 2])
    assert np.min(gap) > 0.0399
    assert np.max(motion[load]) < 1.01 * limit
    assert solution.cost > free.cost
    assert solution.verify().final_error < 1e-3


@pytest.mark.slow
def test_a_point_on_a_line():
    """The tip held on a line, one equality of the path: the other coordinate is optimised."""
    f = five_bar()
    slope = (0.5 - 0.42) / 0.27
    on_line = f.tip.y == 0.42 + slope * (f.tip.x + 0.12)
    problem = carry(
        f,
        initial=[f.tip.x == -0.12, f.tip.vx == 0],
        final=[f.tip.x == 0.15, f.tip.vx == 0],
        path=[on_line],
    )
    solution = mbd.optimize(problem)
    times = np.linspace(0, 0.5, 101)
    off = solution.trajectory.at(times)[f.tip.y - 0.42 - slope * (f.tip.x + 0.12)]
    assert np.max(np.abs(off)) < 1e-7
    assert solution.cost >= mbd.optimize(carry(f)).cost
    assert solution.verify().final_error < 1e-5
