"""Motions through several mechanisms return from their files."""

import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.results.archives import write_arrays

ARRAYS = ("t", "q", "v", "a", "z", "lam", "inputs")


def same(one, other):
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    assert [part.mechanism for part in one.phases] == [part.mechanism for part in other.phases]
    assert [(e.name, e.t) for e in one.events] == [(e.name, e.t) for e in other.events]
    assert one.statistics == other.statistics
    for part, again in zip(one.phases, other.phases, strict=True):
        assert part.statistics == again.statistics
        assert [(e.name, e.t) for e in part.events] == [(e.name, e.t) for e in again.events]


def catch(stiffness=50.0):
    """A block falls past a gate, which is an event of its phase, onto a spring seat that moves along, and is let go."""
    block = mbd.Body("block", mass=1.0, inertia=0.1, pose=(0, 1.0, 0))
    seat = mbd.Body("seat", mass=0.5, inertia=0.1, pose=(0, 0.0, 0))
    rail = mbd.Translational("rail", mbd.ground.at(0, 0, np.pi / 2), seat.at(0, 0, np.pi / 2))
    guide = mbd.Translational("guide", mbd.ground.at(0, 0, np.pi / 2), block.at(0, 0, np.pi / 2))
    hold = mbd.AbsoluteY("hold", seat.at(0, 0), 0.0)
    grip = mbd.Weld("grip", seat.at(0, 0), block.at(0, 0))
    place, push, heat = mbd.Parameter("place", 0.0), mbd.Input("push"), mbd.StateVariable("heat")
    spring = mbd.Force("spring", seat.at(0, 0), (0, -stiffness * (seat.y - place) + push))
    falling = mbd.Mechanism(bodies=[block, seat], joints=[rail, guide, hold], forces=[mbd.Gravity()])
    caught = mbd.Mechanism(
        bodies=[block, seat],
        joints=[rail, grip],
        forces=[mbd.Gravity(), spring],
        parameters=[place],
        inputs=[push],
        states={heat: seat.vy**2},
    )
    alone = mbd.Mechanism(bodies=[block], joints=[guide], forces=[mbd.Gravity()])
    events = [
        mbd.Event("gate", block.y - 0.5, direction=-1, during=falling),
        mbd.Event(
            "catch", block.y - seat.y, direction=-1, during=falling, becomes=caught, reset={place: block.vy / 10}
        ),
        mbd.Event("let go", block.y, direction=1, during=caught, becomes=alone),
    ]
    return block, seat, grip, place, heat, push, (falling, caught, alone), events


@pytest.fixture(scope="module")
def found():
    parts = catch()
    push, (falling, *_), events = parts[5:]
    times = np.linspace(0, 1.6, 81)
    motion = mbd.simulate(falling, times, inputs={push: 2.0}, events=events)
    assert [event.name for event in motion.events] == ["gate", "catch", "let go"]
    return *parts, motion


def test_a_motion_returns(found, tmp_path):
    block, seat, grip, place, heat, push, mechanisms, _events, motion = found
    motion.save(tmp_path / "run.npz")
    again = mbd.read_trajectory(tmp_path / "run.npz", mechanisms[::-1])  # in any order
    same(motion, again)
    catching, before = again.events[1], motion.events[1]
    impulse = grip.impulse_on(block).force
    np.testing.assert_array_equal(catching.after[impulse], before.after[impulse])
    assert np.hypot(*catching.after[impulse]) > 0.1
    assert catching.after[place] == before.after[place] != 0.0 and catching.state[place] == 0.0
    for expression in (place, block.y, seat.y, heat, push, grip.reaction_on(block).force):
        np.testing.assert_array_equal(again[expression], motion[expression])
    np.testing.assert_array_equal(again.energy.total, motion.energy.total)
    assert again.drift == motion.drift
    times = np.linspace(0, 1.6, 47)
    np.testing.assert_allclose(again.at(times)[block.y], motion.at(times)[block.y], atol=1e-10)
    again.save(tmp_path / "again.npz")
    same(motion, mbd.read_trajectory(tmp_path / "again.npz", mechanisms))


def test_joints_of_the_instant_keep_their_impulse(tmp_path):
    ball = mbd.Body("ball", mass=0.4, inertia=1e-3, pose=(0, 1.0, 0))
    floor = mbd.AbsoluteY("floor", ball.at(0, 0), 0.0)
    free = mbd.Mechanism(bodies=[ball], forces=[mbd.Gravity()])
    bounce = mbd.Event("bounce", ball.y, direction=-1, becomes=free, during=free, restitution={floor: 0.5})
    motion = mbd.simulate(free, np.linspace(0, 1.0, 11), events=[bounce])
    motion.save(tmp_path / "run.npz")
    again = mbd.read_trajectory(tmp_path / "run.npz", free)
    same(motion, again)
    for one, other in zip(motion.events, again.events, strict=True):
        np.testing.assert_array_equal(
            one.after[floor.impulse_on(ball).force], other.after[floor.impulse_on(ball).force]
        )


def test_resets_keep_their_impulses(tmp_path):
    """Of a motion in one mechanism, too: a rod on a pin is struck at its end."""
    rod = mbd.Body("rod", mass=1.0, inertia=1 / 12, pose=(0.5, 0, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), rod.at(-0.5, 0))
    model = mbd.Mechanism(bodies=[rod], joints=[pin])
    blow = mbd.Event("blow", rod.y - 0.2, direction=1, reset={rod.omega: 2 * rod.omega})
    motion = mbd.simulate(model, np.linspace(0, 1, 11), initial=[rod.phi == 0, rod.omega == 1], events=[blow])
    motion.save(tmp_path / "run.npz")
    again = mbd.read_trajectory(tmp_path / "run.npz", model)
    impulse = pin.impulse_on(rod).force
    np.testing.assert_array_equal(again.events[0].after[impulse], motion.events[0].after[impulse])
    assert np.hypot(*again.events[0].after[impulse]) > 0.1


def test_solutions_of_several_phases_return_as_trajectories(tmp_path):
    body = mbd.Body("body", mass=1.0, inertia=0.1)
    f = mbd.Input("f", lower=-5, upper=5)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), body.at(0, 0))
    driven = mbd.Mechanism(bodies=[body], joints=[rail], forces=[mbd.Force("push", body.at(0, 0), (f, 0))], inputs=[f])
    stop = mbd.Weld("stop", mbd.ground.at(1.0, 0), body.at(0, 0))
    stopped = mbd.Mechanism(bodies=[body], joints=[stop])
    problem = mbd.OptimalControlProblem(
        phases=[
            mbd.Phase("go", driven, 1.0, initial=[body.x == 0, body.vx == 0], running_cost=f**2),
            mbd.Phase("stop", stopped, 0),
        ]
    )
    motion = mbd.optimize(problem, intervals=5).trajectory
    motion.save(tmp_path / "run.npz")
    again = mbd.read_trajectory(tmp_path / "run.npz", [driven, stopped])
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(motion, name), getattr(again, name))
    impulse = stop.impulse_on(body).force
    np.testing.assert_array_equal(again.events[0].after[impulse], motion.events[0].after[impulse])


def test_mechanisms_with_the_same_names_are_found_by_what_they_do(tmp_path):
    body = mbd.Body("body", mass=1.0, inertia=0.1)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), body.at(0, 0))
    forces = [[mbd.Force("wind", body.at(0, 0), (f, 0))] for f in (1.0, -1.0)]
    east, west = (mbd.Mechanism(bodies=[body], joints=[rail], forces=f) for f in forces)
    turns = mbd.Event("turns", mbd.t - 0.5 + 0 * body.x, direction=1, during=east, becomes=west)
    motion = mbd.simulate(east, np.linspace(0, 1, 11), events=[turns])
    motion.save(tmp_path / "run.npz")
    for order in ([east, west], [west, east]):
        assert [p.mechanism for p in mbd.read_trajectory(tmp_path / "run.npz", order).phases] == [east, west]
    other = mbd.Mechanism(bodies=[body], joints=[rail], forces=[mbd.Force("wind", body.at(0, 0), (-3.0, 0))])
    with pytest.warns(mbd.MechanismWarning, match=r"differ from them: mechanism 2 in the force at 'body\.x'"):
        mbd.read_trajectory(tmp_path / "run.npz", [east, other])


def test_files_of_other_mechanisms_are_refused(found, tmp_path):
    *_, (falling, caught, _alone), _events, motion = found
    motion.save(tmp_path / "run.npz")
    with pytest.raises(mbd.FileError, match="goes through 3 mechanisms: give them in a list"):
        mbd.read_trajectory(tmp_path / "run.npz", falling)
    with pytest.raises(mbd.FileError, match=r"mechanism 3 of the motion"):
        mbd.read_trajectory(tmp_path / "run.npz", [falling, caught])
    motion.phases[0].save(tmp_path / "one.npz")
    with pytest.raises(mbd.FileError, match="goes through one mechanism, and 2 are given"):
        mbd.read_trajectory(tmp_path / "one.npz", [falling, caught])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("entry", "value"),
    [
        ("t", np.array([1.0, 0.0])),
        ("phase mechanisms", np.array([0, 1, 7])),
        ("phase lengths", np.array([1, 1, 1])),
        ("phase statistics", "[]"),
        ("missing multipliers", "{}"),
        ("event places", np.full((3, 5), 9)),
        ("mechanism 1 event impulses", "[1]"),
        ("mechanism 1 q", np.zeros((2, 6))),
        ("parameters", np.zeros((3, 4))),
        ("mechanism 0 fingerprint", np.array([["1.0"]])),
    ],
)
def test_damaged_entries_are_named(found, tmp_path, entry, value):
    *_, mechanisms, _events, motion = found
    motion.save(tmp_path / "run.npz")
    with np.load(tmp_path / "run.npz") as file:
        content = {name: file[name] for name in file.files}
    assert entry in content
    write_arrays(tmp_path / "run.npz", content | {entry: value})
    with pytest.raises(mbd.FileError, match=entry.split(" event ")[-1]):
        mbd.read_trajectory(tmp_path / "run.npz", mechanisms)
    del content[entry]
    if "impulses" in entry:
        return  # files of older versions have none
    write_arrays(tmp_path / "run.npz", content)
    with pytest.raises(mbd.FileError, match="missing"):
        mbd.read_trajectory(tmp_path / "run.npz", mechanisms)
