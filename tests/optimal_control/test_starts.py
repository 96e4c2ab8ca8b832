"""Motions to begin with: durations over their range, and other ends."""

import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.numerics.symbolic import LOCK
from mbdcasadi.optimal_control.program.setup import Settings
from mbdcasadi.optimal_control.search.starts import Starts
from mbdcasadi.optimal_control.solve.problem_solver import ProblemSolver
from mbdcasadi.optimal_control.transcription.mesh import Mesh


def arm(duration=(0.5, 8.0)):
    """Two links of half a metre with motors, from rest to a place of the hand in a free time."""
    links = [mbd.Body(f"link {k}", mass=1.0, inertia=1 / 48, pose=((k + 0.5) * 0.5, 0, 0)) for k in range(2)]
    shoulder = mbd.Revolute("shoulder", mbd.ground.at(0, 0), links[0].at(-0.25, 0))
    elbow = mbd.Revolute("elbow", links[0].at(0.25, 0), links[1].at(-0.25, 0))
    torques = [mbd.Input("t1"), mbd.Input("t2")]
    motors = [mbd.Torque("m1", links[0], torques[0]), mbd.Torque("m2", links[1], torques[1], links[0])]
    mechanism = mbd.Mechanism(links, [shoulder, elbow], forces=motors, inputs=torques)
    hand, rest = links[1].at(0.25, 0), [link.omega == 0 for link in links]
    start = [links[0].phi == 0.3, links[1].phi == 0.8, *rest]
    problem = mbd.OptimalControlProblem(
        mechanism, duration, start, [hand.x == 0.2, hand.y == 0.6, *rest], running_cost=sum(t**2 for t in torques)
    )
    with LOCK:
        solver = ProblemSolver(problem, Settings.read("gauss-legendre", 3, "polynomial", None, False))
        return Starts(solver), solver, hand


def test_durations_cover_their_range_by_powers():
    """The geometric mean comes first, then the quarters of the range, then its eighths."""
    starts, *_ = arm()
    found = [starts.durations(k)[0] for k in range(8)]
    assert found[:4] == pytest.approx([2.0, 2.0, 1.0, 4.0])
    assert sorted(found)[0] == pytest.approx(0.5 * 16 ** (1 / 8)) and sorted(found)[-1] == pytest.approx(
        0.5 * 16 ** (7 / 8)
    )
    assert starts.scaled_durations([7.0], 1.25) == [8.0] and arm(duration=2.0)[0].durations(5) == [2.0]


def test_other_ends_are_the_other_elbow_and_whole_turns():
    """All of them hold the hand at its place, and the joints; none is the usual end."""
    starts, solver, _ = arm()
    with LOCK:
        ends = starts.other_ends
        usual = solver.setups[0].path.poses[-1]
    numeric = solver.setups[0].numeric
    turns = {tuple(np.round((q - usual)[[2, 5]] / (2 * np.pi), 6)) for q in ends}
    assert {(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)} <= turns
    assert any(not float(x).is_integer() for turn in turns for x in turn)  # the other elbow
    for q in ends:
        assert np.max(np.abs(numeric.position(0.0, q, np.zeros(0))[0])) < 1e-8
        place = q[3:5] + 0.25 * np.array([np.cos(q[5]), np.sin(q[5])])
        np.testing.assert_allclose(place, [0.2, 0.6], atol=1e-6)


def test_starts_at_random_are_of_several_kinds_and_the_same_each_time():
    """Detours, natural and free motions, and motions under random inputs, in different times."""
    starts, _solver, _ = arm()
    with LOCK:
        meshes = [Mesh.equal(10, np.array([0, 1.0]))]
        first, again = (list(starts.at_random(meshes, 8)) for _ in range(2))
        free = starts.free_motions(meshes)
    kinds = {guess.description.split(" of ")[0] for guess in first}
    assert {"kinematic with a detour", "natural", "natural with waves"} <= kinds and len(kinds) == 5
    assert {guess.description for guess in free} == {"free motion"}
    assert len({round(float(guess.segment_times[0][-1]), 6) for guess in first}) > 3
    times = np.linspace(0, 1, 5)
    for one, other in zip(first, again, strict=True):
        np.testing.assert_array_equal(one.phases[0].sample(times)["q"], other.phases[0].sample(times)["q"])
