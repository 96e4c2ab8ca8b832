"""Files that are damaged, incomplete, or of another mechanism are refused or reported, with the file and the reason."""

import subprocess
import sys
import warnings

import numpy as np
import pytest
from machines import MACHINES

import mbdcasadi as mbd

TIMES = np.linspace(0, 1, 11)


def rod(mass=1.0, length=1.0, stiffness=20.0, damping=0.3, gravity=9.81, free_length=0.5, joint=mbd.Revolute):
    """A rod on a hinge with a spring and a damper; an input, a parameter and a state that the files hold too."""
    torque, gain, lag = mbd.Input("torque"), mbd.Parameter("gain", 2.0), mbd.StateVariable("lag")
    arm = mbd.Body("arm", mass=mass, inertia=0.1, pose=(0.5, 0, 0))
    spring = mbd.TSDA(
        "spring", mbd.ground.at(0, 1), arm.at(0.5, 0), stiffness=stiffness, free_length=free_length, damping=damping
    )
    hinge = joint("hinge", mbd.ground.at(0, 0), arm.at(-length / 2, 0))
    return mbd.Mechanism(
        [arm], [hinge], forces=[mbd.Gravity((0, -gravity)), spring, mbd.Torque("motor", arm, gain * torque)],
        inputs=[torque], parameters=[gain], states={lag: arm.omega - lag},
    )  # fmt: skip


@pytest.fixture(scope="module")
def content(tmp_path_factory):
    """Entries of the file of a motion with a reset."""
    model = rod()
    (arm,) = model.bodies
    stop = mbd.Event("stop", arm.phi - 0.1, direction=1, reset={arm.omega: 0.5 * arm.omega})
    motion = mbd.simulate(model, TIMES, events=[stop])
    assert motion.events
    path = tmp_path_factory.mktemp("motion") / "run.npz"
    motion.save(path)
    return dict(np.load(path, allow_pickle=False))


def refusal(path, content):
    """Text of the error with which a file of these entries is refused."""
    np.savez(path, **content)
    with pytest.raises(mbd.FileError) as said:
        mbd.read_trajectory(path, rod())
    assert str(path) in str(said.value)
    return str(said.value)


ARRAYS = [
    f"{prefix}{name}" for prefix in ("", "event ", "event after ") for name in ("q", "v", "a", "z", "lam", "inputs")
]
NAMES = [f"{kind} names" for kind in ("coordinate", "row", "state", "input", "parameter", "event")]


@pytest.mark.slow
@pytest.mark.parametrize("name", [*ARRAYS, *NAMES, "t", "parameters", "event t"])
def test_an_entry_that_is_missing_is_named(content, tmp_path, name):
    said = refusal(tmp_path / "run.npz", {k: v for k, v in content.items() if k != name})
    assert f"the entry '{name}' is missing" in said


@pytest.mark.parametrize("name", ["statistics", "missing multipliers", "fingerprint"])
def test_entries_that_a_motion_can_do_without(content, tmp_path, name):
    np.savez(tmp_path / "run.npz", **{k: v for k, v in content.items() if k != name})
    assert np.array_equal(mbd.read_trajectory(tmp_path / "run.npz", rod()).q, content["q"])


@pytest.mark.slow
@pytest.mark.parametrize("name", [*ARRAYS, "t", "parameters", "event t"])
def test_arrays_that_are_damaged_are_named(content, tmp_path, name):
    """Cut, of another shape, of texts, with an infinite or an unknown value."""
    path, values = tmp_path / "run.npz", content[name]
    for wrong in (values[..., None], values.astype(str), values[:-1]):
        said = refusal(path, content | {name: wrong})
        # one that is too short may make another one seem too long
        assert "the entry '" in said if wrong.shape == values[:-1].shape else f"the entry '{name}'" in said
    for value in (np.nan, np.inf):
        wrong = values.astype(float)
        wrong.flat[0] = value
        if value is np.inf or wrong.ndim == 1 or wrong.shape[1] > 1:  # a row that is NaN throughout is not known
            assert f"the entry '{name}' is {value}" in refusal(path, content | {name: wrong})


def test_times_that_run_backwards(content, tmp_path):
    assert "'t' decreases" in refusal(tmp_path / "run.npz", content | {"t": content["t"][::-1]})


@pytest.mark.parametrize("name", ["coordinate names", "event names"])
def test_names_that_are_none(content, tmp_path, name):
    for wrong in (np.arange(3), np.array("arm.x"), content[name][:0] if name == "event names" else np.zeros((2, 2))):
        assert f"'{name}'" in refusal(tmp_path / "run.npz", content | {name: wrong})


def test_statistics_that_cannot_be_read(content, tmp_path):
    assert "'statistics' cannot be read" in refusal(tmp_path / "run.npz", content | {"statistics": "{"})
    # of a later version
    np.savez(tmp_path / "run.npz", **content | {"statistics": '{"method": "idas", "unheard of": 1}'})
    assert mbd.read_trajectory(tmp_path / "run.npz", rod()).statistics.method == "idas"


@pytest.mark.slow
def test_bytes_that_were_changed_or_cut(content, tmp_path):
    """Anywhere in the file: refused with its name, or of no consequence for what is read."""
    path = tmp_path / "run.npz"
    np.savez(path, **content)
    whole, random, refused = path.read_bytes(), np.random.default_rng(1), 0
    model = rod()
    for k in range(300):
        damaged = bytearray(whole)
        place = int(random.integers(len(whole)))
        if k % 3:
            damaged[place] ^= int(random.integers(1, 256))
        else:
            del damaged[place:]
        path.write_bytes(damaged)
        try:
            motion = mbd.read_trajectory(path, model)
        except mbd.FileError as error:
            assert str(path) in str(error)
            refused += 1
        else:
            assert np.array_equal(motion.q, content["q"]) and np.array_equal(motion.lam, content["lam"])
    assert refused > 200


@pytest.mark.parametrize("path", [3, None, b"run.npz"])
def test_paths_that_are_none(path):
    with pytest.raises(mbd.FileError, match=r"is a text or a pathlib\.Path"):
        mbd.read_trajectory(path, rod())


def test_what_is_no_mechanism(content, tmp_path):
    np.savez(tmp_path / "run.npz", **content)
    with pytest.raises(mbd.MechanismError, match="takes a mechanism after the path, got 'rod'"):
        mbd.read_trajectory(tmp_path / "run.npz", "rod")


# --- of another mechanism -----------------------------------------------------------------------
@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"mass": 5.0}, r"the mass or inertia at 'arm\.x' \(1 there, 5 here\)"),
        ({"length": 1.1}, r"the constraint 'hinge\.x'"),
        ({"stiffness": 21.0}, "the force at 'arm"),
        ({"free_length": 0.6}, "the force at 'arm"),
        ({"damping": 0.4}, "the force at 'arm"),
        ({"gravity": 1.62}, r"the force at 'arm\.y'"),
    ],
)
def test_a_mechanism_of_the_same_names_is_told_by_its_numbers(content, tmp_path, change, says):
    """As a warning that names the first difference; the motion is read."""
    path = tmp_path / "run.npz"
    np.savez(path, **content)
    with pytest.warns(mbd.MechanismWarning, match=rf"run\.npz.*{says}") as caught:
        motion = mbd.read_trajectory(path, rod(**change))
    assert np.array_equal(motion.q, content["q"]) and caught[0].filename == __file__


def test_a_mechanism_of_another_structure(tmp_path):
    """A hinge at the same names of rows, but about another point; a rail of the same name has other rows."""

    def sled(joint):
        body = mbd.Body("sled", 1, 1)
        return mbd.Mechanism([body], [joint("hold", body)])

    path = tmp_path / "run.npz"
    mbd.simulate(sled(lambda name, body: mbd.AbsoluteX(name, body.at(0, 0))), TIMES).save(path)
    with pytest.warns(mbd.MechanismWarning, match="rate of the constraint 'hold'|constraint 'hold'"):
        mbd.read_trajectory(path, sled(lambda name, body: mbd.AbsoluteX(name, body.at(0, 0.1))))
    with pytest.raises(mbd.FileError, match="row number 1"):
        mbd.read_trajectory(path, sled(lambda name, body: mbd.Translational(name, mbd.ground.at(0, 0), body.at(0, 0))))


@pytest.mark.slow
@pytest.mark.parametrize("name", MACHINES)
def test_an_equal_mechanism_built_again_is_not_reported(tmp_path, name):
    """Every kind of element: the file of one model is read with another one of the same numbers."""
    path = tmp_path / "run.npz"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mbd.MechanismWarning)
        motion = mbd.simulate(MACHINES[name]().mechanism, np.linspace(0, 0.02, 5))
    motion.save(path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        again = mbd.read_trajectory(path, MACHINES[name]().mechanism)
    assert np.array_equal(again.q, motion.q)


@pytest.mark.slow
def test_an_equal_mechanism_in_another_process_is_not_reported(tmp_path):
    """Nothing in the fingerprint depends on where objects lie in memory, nor on the order of a hash."""
    path = tmp_path / "run.npz"
    run = "m.simulate(m.library.four_bar().mechanism, np.linspace(0, 0.1, 5)).save(sys.argv[1])"
    code = f"import sys, numpy as np, mbdcasadi as m; {run}"
    subprocess.run([sys.executable, "-c", code, path], check=True)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(mbd.read_trajectory(path, mbd.library.four_bar().mechanism)) == 5


def test_a_kinematic_motion_returns_without_its_forces(tmp_path):
    """What is not known stays unknown: multipliers, and states that follow from forces."""
    model = mbd.library.four_bar()
    path, mechanism = tmp_path / "run.npz", model.driven(crank=2 * mbd.t)
    motion = mbd.kinematics(mechanism, TIMES)
    motion.save(path)
    again = mbd.read_trajectory(path, mechanism)
    assert np.isnan(again.lam).all() and np.array_equal(again.a, motion.a)
    with pytest.raises(mbd.MechanismError, match="inverse_dynamics"):
        again[mechanism.joints[0].reaction_on(mechanism.bodies[0]).force]
