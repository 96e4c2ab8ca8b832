"""Trajectories as tables, data sets and files."""

import csv
import sys

import casadi as ca
import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.numerics.writing import whole_file
from mbdcasadi.results.columns import columns
from mbdcasadi.results.trajectory import EventOccurrence, Trajectory

TIMES = np.linspace(0, 1, 11)
LENGTH, MASS, G = 1.0, 2.0, 9.81


@pytest.fixture(scope="module")
def arm():
    """A uniform rod."""
    return mbd.Body("arm", mass=MASS, inertia=MASS * LENGTH**2 / 12, pose=(0.5, 0, 0))


@pytest.fixture(scope="module")
def pendulum(arm):
    """A rod on a hinge, with an input that does nothing yet."""
    torque = mbd.Input("torque")
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), arm.at(-0.5, 0))
    forces = [mbd.Gravity(), mbd.Torque("motor", arm, torque)]
    return mbd.Mechanism(bodies=[arm], joints=[hinge], forces=forces, inputs=[torque], name="pendulum")


@pytest.fixture(scope="module")
def motion(pendulum):
    """It falls from the horizontal."""
    return mbd.simulate(pendulum, TIMES)


@pytest.fixture(scope="module")
def driven(arm, pendulum):
    """It turns at 2 rad/s; by hand, the motor lifts the weight."""
    return mbd.inverse_dynamics(pendulum.replace(drivers=[mbd.Driver("drive", arm.phi, 2 * mbd.t)]), TIMES)


def table(path):
    """A CSV file by column."""
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


# --- tables -------------------------------------------------------------------------------
def test_frames_hold_what_is_asked_for(motion, arm):
    """Scalars as named; vectors of two by axis, others by number, matrices by row and column."""
    turn = ca.vertcat(ca.horzcat(ca.cos(arm.phi), -ca.sin(arm.phi)), ca.horzcat(ca.sin(arm.phi), ca.cos(arm.phi)))
    frame = motion.to_pandas({"angle": arm.phi, "tip": arm.at(0.5, 0).position, "q": arm.q, "A": turn, "one": 1})
    expected = ["angle", "tip.x", "tip.y", "q[0]", "q[1]", "q[2]", "A[0,0]", "A[0,1]", "A[1,0]", "A[1,1]", "one"]
    assert list(frame.columns) == expected
    assert frame.index.name == "t" and frame.index.to_numpy() == pytest.approx(TIMES)
    phi = motion[arm.phi]
    assert frame["tip.y"].to_numpy() == pytest.approx(np.sin(phi), abs=1e-9)
    assert frame["A[0,1]"].to_numpy() == pytest.approx(-np.sin(phi))
    assert np.all(frame["one"] == 1)


def test_csv_of_a_driven_mechanism(driven, tmp_path):
    """All columns; reactions act on the body, for a joint on the ground too; the effort is the motor's."""
    path = tmp_path / "motion.csv"
    driven.to_csv(path)
    found = table(path)
    levels = ["x", "y", "phi", "vx", "vy", "omega", "ax", "ay", "alpha"]
    names = ["hinge.fx", "hinge.fy", "hinge.torque", "drive.effort", "torque"]
    assert list(found) == ["t", *(f"arm.{level}" for level in levels), *names]
    phi = 2 * TIMES
    assert found["t"] == pytest.approx(TIMES) and found["arm.phi"] == pytest.approx(phi)
    assert found["arm.ax"] == pytest.approx(-2 * np.cos(phi), abs=1e-9)  # 0.5 omega² towards the hinge
    assert found["hinge.fx"] == pytest.approx(-MASS * 2 * np.cos(phi), abs=1e-9)
    assert found["hinge.fy"] == pytest.approx(MASS * (G - 2 * np.sin(phi)), abs=1e-9)
    assert found["drive.effort"] == pytest.approx(MASS * G * 0.5 * np.cos(phi), abs=1e-9)
    assert found["hinge.torque"] == pytest.approx(0 * TIMES, abs=1e-9)
    assert list(driven.to_pandas().columns) == list(found)[1:]


def test_numbers_in_csv_are_exact(motion, arm, tmp_path):
    """Every digit survives."""
    path = tmp_path / "motion.csv"
    motion.to_csv(path, {"phi": arm.phi})
    assert np.array_equal(table(path)["phi"], motion[arm.phi])


@pytest.mark.parametrize("turned", [False, True])
def test_reactions_act_on_the_second_body(turned):
    """On body b where it moves, else on the other one."""
    body = mbd.Body("block", mass=1, inertia=1)
    pair = (mbd.ground.at(0, 0), body.at(0, 0))
    weld = mbd.Weld("weld", *(reversed(pair) if turned else pair))
    found = columns(mbd.simulate(mbd.Mechanism(bodies=[body], joints=[weld], forces=[mbd.Gravity()]), TIMES))
    assert found["weld.fy"] == pytest.approx(np.full(11, G))


def test_a_constraint_without_markers_has_a_reaction(arm):
    """On the body that its expression moves."""
    model = mbd.Mechanism(bodies=[arm], joints=[mbd.Constraint("track", arm.y)], forces=[mbd.Gravity()])
    assert columns(mbd.simulate(model, TIMES))["track.fy"] == pytest.approx(np.full(11, MASS * G))


def test_kinematics_gives_no_reactions(pendulum, arm, tmp_path):
    """What was not computed has no column."""
    run = mbd.kinematics(pendulum.replace(drivers=[mbd.Driver("drive", arm.phi, 2 * mbd.t)]), TIMES)
    run.to_csv(tmp_path / "k.csv")
    assert not [name for name in table(tmp_path / "k.csv") if name.startswith(("hinge", "drive"))]


def test_data_sets(motion, pendulum, arm):
    """Named dimensions; without expressions everything that the trajectory holds."""
    data = motion.to_xarray()
    assert data["q"].sel(coordinate="arm.phi").to_numpy() == pytest.approx(motion[arm.phi])
    assert list(data["lam"].coords["row"].to_numpy()) == list(mbd.equations(pendulum).row_names)
    assert data["inputs"].dims == ("t", "input")
    data = motion.to_xarray({"phi": arm.phi, "tip": arm.at(0.5, 0).position, "q": arm.q})
    assert data["phi"].dims == ("t",) and data["tip"].dims == ("t", "axis") and data["q"].dims == ("t", "q_0")
    assert data["tip"].sel(axis="y").to_numpy() == pytest.approx(np.sin(motion[arm.phi]), abs=1e-9)


@pytest.mark.parametrize(
    ("expressions", "says"),
    [
        ([1, 2], "name: expression"),
        ({1: 2}, "text, got 1"),
        ({"x": "y"}, "'x' must be an expression"),
        ({"a.x": 1.0, "a": np.zeros(2)}, "two columns would be called 'a.x'"),
    ],
)
def test_wrong_expressions_are_named(motion, expressions, says):
    """What is wrong, and where."""
    with pytest.raises(mbd.MechanismError, match=says):
        motion.to_pandas(expressions)


def test_the_time_has_its_column_already(motion, arm, tmp_path):
    """In a file there is one t."""
    with pytest.raises(mbd.MechanismError, match="'t' is the time"):
        motion.to_csv(tmp_path / "a.csv", {"t": arm.phi})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("method", "package"), [("to_pandas", "pandas"), ("to_xarray", "xarray")])
def test_a_package_that_is_missing(motion, monkeypatch, method, package):
    """The message says what to install."""
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(mbd.MechanismError, match=rf'{package}; install it by pip install "mbdcasadi\[data\]"'):
        getattr(motion, method)({"one": 1})


# --- whole files ------------------------------------------------------------------------------
def test_a_failure_leaves_what_was_there(tmp_path):
    """Neither half a file nor the temporary one."""
    path = tmp_path / "a.txt"
    path.write_text("before")
    with pytest.raises(ZeroDivisionError), whole_file(path) as temporary:
        temporary.write_text("half")
        raise ZeroDivisionError
    assert path.read_text() == "before" and list(tmp_path.iterdir()) == [path]
    with whole_file(path) as temporary:
        temporary.write_text("after")
    assert path.read_text() == "after" and list(tmp_path.iterdir()) == [path]


def test_links_stay_links(tmp_path):
    """The file behind a link is replaced, not the link."""
    (tmp_path / "real.txt").write_text("before")
    (tmp_path / "link.txt").symlink_to(tmp_path / "real.txt")
    with whole_file(tmp_path / "link.txt") as temporary:
        temporary.write_text("after")
    assert (tmp_path / "link.txt").is_symlink() and (tmp_path / "real.txt").read_text() == "after"


def test_a_foreign_expression_leaves_no_file(motion, tmp_path):
    """The mechanism has no such body."""
    with pytest.raises(mbd.MechanismError, match="stranger"):
        motion.to_csv(tmp_path / "a.csv", {"x": mbd.Body("stranger", 1, 1).x})
    assert list(tmp_path.iterdir()) == []


# --- save and read ------------------------------------------------------------------------------
def test_a_trajectory_returns_from_its_file(motion, pendulum, arm, tmp_path):
    """Arrays to the last bit, statistics, and interpolation; the file is called as the user says."""
    path = tmp_path / "run.data"
    motion.save(path)
    assert [p.name for p in tmp_path.iterdir()] == ["run.data"]
    again = mbd.read_trajectory(path, pendulum)
    for name in ("t", "q", "v", "a", "z", "lam", "inputs", "parameters"):
        assert np.array_equal(getattr(again, name), getattr(motion, name)), name
    assert again.statistics == motion.statistics
    between = np.array([0.05, 0.123, 0.97])
    assert again.at(between)[arm.phi] == pytest.approx(motion.at(between)[arm.phi], abs=1e-14)
    assert again.at(between).drift.position < 1e-12
    # the file needs no pickle, which could run code
    with np.load(path, allow_pickle=False) as file:
        assert all(file[name].dtype != object for name in file.files)


def test_kinematics_returns_without_multipliers(pendulum, arm, tmp_path):
    """Reactions are refused as before."""
    model = pendulum.replace(drivers=[mbd.Driver("drive", arm.phi, mbd.t**2)])
    mbd.kinematics(model, TIMES).save(tmp_path / "k.npz")
    again = mbd.read_trajectory(tmp_path / "k.npz", model)
    assert again.at([0.55])[arm.phi] == pytest.approx(0.55**2, abs=1e-12)
    with pytest.raises(mbd.MechanismError, match="inverse_dynamics"):
        again[model.joint("hinge").reaction_on(arm).force]


def test_events_and_states_return(tmp_path):
    """Name, time and state of each event; first-order states and parameters."""
    body, lag, gain = mbd.Body("cart", 1, 1), mbd.StateVariable("lag", 0.2), mbd.Parameter("gain", 3.0)
    model = mbd.Mechanism(bodies=[body], states={lag: gain * (body.x - lag)}, parameters=[gain])
    run = mbd.simulate(model, TIMES, initial=[body.vx == 1], parameters={gain: 5.0})
    marked = Trajectory(
        model, run.t, run.q, run.v, run.a, run.z, run.lam, run.inputs, run.parameters,
        events=[EventOccurrence("half way", 0.5, run.state(5)), EventOccurrence("end", 1.0, run.final)],
        interpolation=run.interpolation,
    )  # fmt: skip
    marked.save(tmp_path / "run.npz")
    again = mbd.read_trajectory(tmp_path / "run.npz", model)
    assert [(event.name, event.t) for event in again.events] == [("half way", 0.5), ("end", 1.0)]
    assert again.events[0].state[body.x] == pytest.approx(0.5) and again.events[1].state.parameters == [5.0]
    assert again[lag] == pytest.approx(run[lag]) and again.at([0.55]).z == pytest.approx(run.at([0.55]).z)


def test_a_file_of_another_mechanism(motion, pendulum, arm, tmp_path):
    """The first difference is named."""
    path = tmp_path / "run.npz"
    motion.save(path)
    other = mbd.Body("rod", 1, 1)
    with pytest.raises(mbd.FileError, match=r"run\.npz.*coordinate number 1 is 'arm\.x'.*'rod\.x'"):
        mbd.read_trajectory(path, mbd.Mechanism(bodies=[other]))
    with pytest.raises(mbd.FileError, match=r"row number 1 is 'hinge\.x'.* none"):
        mbd.read_trajectory(path, pendulum.replace(joints=[]))
    with pytest.raises(mbd.FileError, match=r"parameter number 1 is none.*'k'"):
        mbd.read_trajectory(path, pendulum.replace(parameters=[mbd.Parameter("k", 1)]))


@pytest.mark.parametrize("content", [b"", b"no trajectory", b"PK\x03\x04 broken"])
def test_files_that_are_none(pendulum, tmp_path, content):
    """Told apart from those that are missing."""
    path = tmp_path / "run.npz"
    with pytest.raises(mbd.FileError, match="cannot be read"):
        mbd.read_trajectory(path, pendulum)
    path.write_bytes(content)
    with pytest.raises(mbd.FileError, match=r"run\.npz: the file is not a trajectory file"):
        mbd.read_trajectory(path, pendulum)
    np.savez(path, t=np.zeros(3))
    with pytest.raises(mbd.FileError, match="not a trajectory file of this version"):
        mbd.read_trajectory(path, pendulum)
    with open(path, "wb") as file:
        np.savez(file, t=np.array([{}], dtype=object))
    with pytest.raises(mbd.FileError, match="not a trajectory"):
        mbd.read_trajectory(path, pendulum)


@pytest.mark.parametrize("entry", ["v", "a", "lam"])
def test_entries_that_are_unknown_throughout_are_refused(motion, pendulum, tmp_path, entry):
    path = tmp_path / "run.npz"
    motion.save(path)
    content = dict(np.load(path))
    content[entry] = np.full_like(content[entry], np.nan)
    np.savez(path, **content)
    with pytest.raises(mbd.FileError, match=rf"run\.npz: the entry '{entry}' is not a number at any time"):
        mbd.read_trajectory(path, pendulum)


@pytest.mark.parametrize("statistics", ["1.0", "[1, 2]", '"text"', "null"])
def test_statistics_that_are_no_names_and_values_are_refused(motion, pendulum, tmp_path, statistics):
    path = tmp_path / "run.npz"
    motion.save(path)
    np.savez(path, **(dict(np.load(path)) | {"statistics": np.array(statistics)}))
    with pytest.raises(mbd.FileError, match=r"run\.npz: the entry 'statistics' holds"):
        mbd.read_trajectory(path, pendulum)


def test_energy_of_the_fall(motion, arm):
    """The summary's numbers: a rod that falls keeps its energy."""
    from mbdcasadi.results.summary import summary

    text = summary(motion, {"analysis": "dynamics"})
    for word in ("pendulum", "1 body, 1 joint, 2 forces", "dynamics", "11, t = 0 … 1 s", "largest |Phi|", "hinge"):
        assert word in text
    omega = motion[arm.omega]
    assert omega**2 == pytest.approx(-3 * G / LENGTH * np.sin(motion[arm.phi]), abs=1e-5)
    lowest = motion.maximum(-mbd.sin(arm.phi)).t
    assert f"{2.5 * arm.mass * G:.4g} N at t = {lowest:.4g} s" in text
