"""Random four-bars with an input that rotates: half a turn of it from rest to rest, by the automatic guess."""

import numpy as np
import pytest

import mbdcasadi as mbd


def random_four_bar(seed):
    """A crank-rocker or a drag-link of Grashof's kind at a random pose, with gravity or without."""
    random = np.random.default_rng(seed)
    while True:
        lengths = np.sort(random.uniform(0.05, 0.5, 4))
        if lengths[0] + lengths[3] < 0.97 * (lengths[1] + lengths[2]):
            break
    drag_link = random.integers(2)
    shortest, others = lengths[0], random.permutation(lengths[1:])
    crank, coupler, rocker, base = shortest, *others
    if drag_link:
        base, crank, coupler, rocker = shortest, *others
    masses, start = random.uniform(0.2, 3, 3), random.uniform(0, 2 * np.pi)
    duration, gravity = random.uniform(0.3, 1.5), random.random() < 0.5
    a = crank * np.array([np.cos(start), np.sin(start)])
    o4 = np.array([base, 0.0])
    reach = o4 - a
    rho = np.linalg.norm(reach)
    along = (coupler**2 - rocker**2 + rho**2) / (2 * rho)
    across = np.sqrt(max(coupler**2 - along**2, 0.0)) * (1 if random.random() < 0.5 else -1)
    b = a + along * reach / rho + across * np.array([-reach[1], reach[0]]) / rho

    def bar(name, mass, length, first, last):
        angle = np.arctan2(*(last - first)[::-1])
        return mbd.Body(name, mass=mass, inertia=mass * length**2 / 12, pose=(*((first + last) / 2), angle))

    links = [
        bar("crank", masses[0], crank, np.zeros(2), a),
        bar("coupler", masses[1], coupler, a, b),
        bar("rocker", masses[2], rocker, o4, b),
    ]
    joints = [
        mbd.Revolute("O2", mbd.ground.at(0, 0), links[0].at(-crank / 2, 0)),
        mbd.Revolute("A", links[0].at(crank / 2, 0), links[1].at(-coupler / 2, 0)),
        mbd.Revolute("B", links[1].at(coupler / 2, 0), links[2].at(rocker / 2, 0)),
        mbd.Revolute("O4", mbd.ground.at(base, 0), links[2].at(-rocker / 2, 0)),
    ]
    tau = mbd.Input("tau")
    forces = [mbd.Torque("motor", links[0], tau), *([mbd.Gravity()] if gravity else [])]
    mechanism = mbd.Mechanism(bodies=links, joints=joints, forces=forces, inputs=[tau])
    first = float(np.arctan2(a[1], a[0]))
    return mbd.OptimalControlProblem(
        mechanism,
        duration=duration,
        initial=[links[0].phi == first, links[0].omega == 0],
        final=[links[0].phi == first + np.pi, links[0].omega == 0],
        running_cost=tau**2,
    )


@pytest.mark.slow
def test_a_hundred():
    """At least 98 solve, the median takes 12 iterations at most, and the others say why."""
    iterations, errors = [], []
    for seed in range(100):
        try:
            solution = mbd.optimize(random_four_bar(seed), intervals=30)
        except mbd.OptimizationError as error:
            errors.append(error)
            continue
        iterations.append(solution.statistics.iterations)
        assert solution.trajectory.drift.position <= 1e-11, seed
    assert len(iterations) >= 98, [str(e) for e in errors]
    assert np.median(iterations) <= 12, sorted(iterations)
    for error in errors:
        assert error.largest_violations or "iterations" in str(error)


@pytest.mark.slow
@pytest.mark.parametrize("seed", [pytest.param(k, marks=[pytest.mark.nightly] * (k >= 8)) for k in range(20)])
def test_they_replay(seed):
    """IDAS finds the same motion, as far as the mesh is fine enough: the local error says so."""
    solution = mbd.optimize(random_four_bar(seed), intervals=30, tolerance=1e-7)
    assert solution.mesh_error <= 1e-7
    assert solution.verify().final_error < 1e-3
