"""Every writer leaves a whole file or what was there before, and names the file that it could not write."""

import os
import shutil

import numpy as np
import pytest
from disk import full_disk
from threads import together

import mbdcasadi as mbd
from mbdcasadi.__main__ import main
from mbdcasadi.numerics.writing import appended_file, whole_file

pytestmark = pytest.mark.skipif(os.name != "posix", reason="limits of files as on POSIX")


@pytest.fixture(scope="module")
def crank():
    """A slider-crank and its motion."""
    model = mbd.library.slider_crank()
    return model, mbd.inverse_dynamics(model.driven(crank=0.3 + 2 * mbd.t), np.linspace(0, 0.5, 51))


@pytest.fixture(scope="module")
def solution():
    """A rod that is turned with least effort."""
    tau = mbd.Input("tau")
    arm = mbd.Body("arm", mass=1, inertia=1 / 12, pose=(0.5, 0, 0))
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), arm.at(-0.5, 0))
    model = mbd.Mechanism([arm], [hinge], forces=[mbd.Torque("motor", arm, tau)], inputs=[tau])
    problem = mbd.OptimalControlProblem(
        model, 1.0, initial=[arm.phi == 0, arm.omega == 0], final=[arm.phi == 1, arm.omega == 0], running_cost=tau**2
    )
    return mbd.optimize(problem, intervals=8)


WRITERS = {
    "motion.csv": lambda motion, path: motion.to_csv(path),
    "motion.npz": lambda motion, path: motion.save(path),
    "motion.html": lambda motion, path: mbd.animate(motion, path),
    "motion.gif": lambda motion, path: mbd.animate(motion, path, fps=4),
    "motion.mp4": lambda motion, path: mbd.animate(motion, path, fps=4),
    "motion.c": lambda motion, path: motion.equations.generate_c(path),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", WRITERS)
def test_a_full_disk_leaves_what_was_there(crank, tmp_path, name):
    """Nothing for a new file, the old content for an old one; FileError with the name and the reason."""
    if name.endswith("mp4") and shutil.which("ffmpeg") is None:
        pytest.skip("ffmpeg is not on the path")
    path = tmp_path / name
    for before in (None, "as it was"):
        if before is not None:
            path.write_text(before)
        with full_disk(), pytest.raises(mbd.FileError, match=rf"{name}: the file cannot be written: \w+"):
            WRITERS[name](crank[1], path)
        assert [p.name for p in tmp_path.iterdir()] == ([] if before is None else [name])
    assert path.read_text() == "as it was"
    WRITERS[name](crank[1], path)
    assert path.stat().st_size > 2048
    assert {p.name for p in tmp_path.iterdir()} == {name} | ({"motion.h"} if name == "motion.c" else set())


def test_a_solution_on_a_full_disk(solution, tmp_path):
    with full_disk(), pytest.raises(mbd.FileError, match=r"best\.npz: the file cannot be written"):
        solution.save(tmp_path / "best.npz")
    assert list(tmp_path.iterdir()) == []


def test_the_command_line_on_a_full_disk(tmp_path, capsys):
    """Status 2, one sentence, and none of the files."""
    models = os.path.join(os.path.dirname(mbd.__file__), os.pardir, "examples", "models", "slider_crank_driven.")
    targets = [argument for kind in ("csv", "save") for argument in (f"--{kind}", str(tmp_path / f"out.{kind}"))]
    with full_disk():
        assert main(["run", models + "adm", models + "acf", *targets]) == 2
    said = capsys.readouterr().err
    assert "out.csv: the file cannot be written" in said and said.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_a_header_and_its_source_are_both_or_none(tmp_path):
    """A source that is too large leaves no header, which alone would fit."""
    eom = mbd.equations(mbd.library.slider_crank().mechanism)
    with full_disk(8192), pytest.raises(mbd.FileError, match=r"crank\.c: the file cannot be written"):
        eom.generate_c(tmp_path / "crank.c")
    assert list(tmp_path.iterdir()) == []


def test_an_appended_block_is_there_whole_or_not_at_all(tmp_path):
    path = tmp_path / "blocks"
    path.write_bytes(b"first")
    with full_disk(), pytest.raises(mbd.FileError, match="blocks: the file cannot be written"):
        with appended_file(path) as file:
            file.write(b"x" * 2000)
            file.write(b"x" * 2000)
            file.write(b"x" * 2000)
    assert path.read_bytes() == b"first"
    with pytest.raises(ZeroDivisionError), appended_file(path) as file:
        file.write(b"half")
        raise ZeroDivisionError
    assert path.read_bytes() == b"first"
    with appended_file(path) as file:
        file.write(b" second")
    assert path.read_bytes() == b"first second"


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="there is no /dev/full")
def test_a_device_is_written_directly(crank):
    crank[1].to_csv("/dev/null")
    with pytest.raises(mbd.FileError, match="/dev/full: the file cannot be written: No space left"):
        crank[1].to_csv("/dev/full")
    assert os.path.exists("/dev/null") and os.path.exists("/dev/full")


def test_rights_stay_as_they_were(tmp_path):
    """Of a file that is replaced; a file that may not be written is not replaced."""
    path = tmp_path / "a.txt"
    path.write_text("before")
    path.chmod(0o640)
    with whole_file(path) as part:
        part.write_text("after")
    assert path.read_text() == "after" and path.stat().st_mode & 0o777 == 0o640
    if os.geteuid() != 0:  # the superuser may write anything
        path.chmod(0o440)
        with pytest.raises(mbd.FileError, match="permission denied"), whole_file(path):
            pass


@pytest.mark.parametrize(
    ("path", "reason"), [("nowhere/a.csv", "folder .* does not exist"), ("", "this is a folder"), (3, "is a text")]
)
def test_a_wrong_path_is_named_before_the_work(crank, tmp_path, path, reason):
    """In an animation before a frame is drawn."""
    target = tmp_path / path if isinstance(path, str) else path
    with pytest.raises(mbd.FileError, match=reason), whole_file(target):
        raise AssertionError("not reached")


def test_threads_write_the_same_file(tmp_path):
    """Each version is whole."""
    path = tmp_path / "a.txt"

    def write(letter):
        for _ in range(50):
            with whole_file(path) as part:
                part.write_text(letter * 10_000)

    together([lambda letter=letter: write(letter) for letter in "abcd"])
    assert path.read_text() in {letter * 10_000 for letter in "abcd"} and list(tmp_path.iterdir()) == [path]
