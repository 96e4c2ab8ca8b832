"""The command line from outside: exit status, what is printed where, and which files are left."""

import csv
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.__main__ import main
from mbdcasadi.numerics import progress

ROOT = Path(__file__).resolve().parents[2]
MODELS = ROOT / "examples" / "models"
FREE = (MODELS / "slider_crank.adm", MODELS / "slider_crank.acf")
DRIVEN = (MODELS / "slider_crank_driven.adm", MODELS / "slider_crank_driven.acf")
ENVIRONMENT = os.environ | {"PYTHONPATH": str(ROOT)}


def outside(*arguments, **more):
    """Run in a process of its own."""
    command = [sys.executable, "-m", "mbdcasadi", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, env=ENVIRONMENT, check=False, **more)


def written(path, change):
    """A model that differs from the example."""
    content = json.loads(FREE[0].read_text())
    change(content)
    path.write_text(json.dumps(content))
    return path


def analysis(path, **fields):
    """An analysis file."""
    path.write_text(json.dumps({"simulation": "Dynamics", "tend": 0.2, "outputSteps": 20} | fields))
    return path


@pytest.mark.slow
def test_a_run_from_outside(tmp_path):
    """Summary on standard output, nothing on standard error, and the files that were asked for."""
    out = {kind: tmp_path / f"out.{kind}" for kind in ("csv", "png", "html", "npz")}
    files = ("--csv", out["csv"], "--plot", out["png"], "--animate", out["html"], "--save", out["npz"])
    done = outside("run", *FREE, *files)
    assert (done.returncode, done.stderr) == (0, "")
    for word in (
        "slider crank",
        "degrees of freedom  1",
        "dynamics",
        "401",
        "wall time",
        "|Phi|",
        "energy",
        "crank pin",
    ):
        assert word in done.stdout, word
    assert out["png"].read_bytes()[:4] == b"\x89PNG"
    assert "<title>slider crank</title>" in out["html"].read_text(encoding="utf-8")
    assert set(tmp_path.iterdir()) == set(out.values())
    model = mbd.read_adm(FREE[0])
    motion = mbd.read_trajectory(out["npz"], model)
    with open(out["csv"], newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 401
    assert [float(row["slider.x"]) for row in rows] == motion[model.body("slider").x].tolist()


def test_a_kinematic_run_gives_reactions_and_efforts(tmp_path, capsys):
    """The course's kinematics, with the torque that it takes."""
    assert main(["run", *map(str, DRIVEN), "--csv", str(tmp_path / "out.csv")]) == 0
    printed = capsys.readouterr()
    assert printed.err == "" and "kinematics" in printed.out and "crank drive" in printed.out and "N m" in printed.out
    with open(tmp_path / "out.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert {"crank drive.effort", "crank pin.fx", "guide y.fy", "rod.alpha"} <= set(rows[0])
    # over a whole turn the motor's work is that of the load, which returns to where it was: none
    effort = np.array([float(row["crank drive.effort"]) for row in rows])
    assert abs(np.mean(effort[:-1])) < 1e-6 * np.max(np.abs(effort))


def test_quiet(capsys):
    """Not a word."""
    assert main(["run", *map(str, DRIVEN), "--quiet"]) == 0
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize("extra", [("--method", "erk"), ("--tolerance", "1e-5")])
def test_settings_of_the_integrator(tmp_path, capsys, extra):
    """They reach it; what it is, the summary says."""
    assert main(["run", str(FREE[0]), str(analysis(tmp_path / "a.acf")), *extra]) == 0
    assert ("erk" in capsys.readouterr().out) == ("erk" in extra)


def test_check(capsys):
    """The report as a table."""
    assert main(["check", str(FREE[0])]) == 0
    assert "degrees of freedom" in capsys.readouterr().out


def test_warnings_become_notes(tmp_path, capsys):
    """On standard output, in the summary."""
    model = written(tmp_path / "m.adm", lambda m: m["bodies"][0].update(qdO=[0, 0, 0]))
    assert main(["run", str(model), str(analysis(tmp_path / "a.acf"))]) == 0
    printed = capsys.readouterr()
    assert printed.err == "" and "'qdO' is not used" in printed.out


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "says"),
    [
        (lambda m: m["constraints"][2].update(body2=9), ["crank pin", "body2 = 9", "1, 2, 3"]),
        (lambda m: m["forces"][0].update(fun="__import__('os')"), ["motor", "fun", "__import__"]),
        (lambda m: m["bodies"][1].update(mass=-3), ["rod", "mass", "-3"]),
        (lambda m: m["constraints"][1].update(fun="5"), ["assemble", "main bearing y"]),
    ],
)
def test_a_wrong_model(tmp_path, change, says):
    """Status 2, one sentence on standard error with the place and the reason, and no file."""
    model = written(tmp_path / "m.adm", change)
    done = outside("run", model, FREE[1], "--csv", tmp_path / "out.csv", "--plot", tmp_path / "out.png")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.count("\n") == 1 and "Traceback" not in done.stderr
    assert all(word in done.stderr for word in says), done.stderr
    assert list(tmp_path.iterdir()) == [model]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["check", "absent.adm"], "absent.adm"),
        (["run", str(FREE[0]), "absent.acf"], "absent.acf"),
        (["run", str(FREE[0]), str(DRIVEN[1])], "degree"),
        (["run", *map(str, FREE), "--csv", "absent/out.csv"], "does not exist"),
        (["run", *map(str, FREE), "--csv", "."], "folder"),
        (["run", *map(str, FREE), "--plot", "out.xyz"], ".png"),
        (["run", *map(str, FREE), "--animate", "out.xyz"], "must end in .html, .gif or .mp4"),
        (["run", *map(str, FREE), "--csv", "out", "--save", "out"], "same file"),
        (["run", *map(str, FREE), "--method", "magic"], "magic"),
        (["run", *map(str, FREE), "--tolerance", "-1"], "-1"),
        (["run", *map(str, DRIVEN), "--method", "erk"], "--method is for dynamics"),
    ],
)
def test_a_wrong_call(tmp_path, monkeypatch, capsys, arguments, says):
    """One sentence, before anything is written."""
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    printed = capsys.readouterr()
    assert printed.out == "" and printed.err.count("\n") == 1 and says in printed.err
    assert list(tmp_path.iterdir()) == []


def test_usage(capsys):
    """argparse's own messages and status."""
    for arguments in ([], ["run"], ["dance"]):
        with pytest.raises(SystemExit) as caught:
            main(arguments)
        assert caught.value.code == 2
    assert "usage: mbdcasadi" in capsys.readouterr().err


def test_outputs_are_all_or_none(tmp_path, monkeypatch, capsys):
    """Where the plot fails, the table that was ready is not left behind."""

    def broken(_motion):
        raise OSError(28, "No space left on device", "out.png")

    monkeypatch.setattr("mbdcasadi.visual.plots.plot.overview", broken)
    arguments = ["run", *map(str, DRIVEN), "--csv", str(tmp_path / "o.csv"), "--plot", str(tmp_path / "o.png")]
    assert main(arguments) == 2
    said = f"mbdcasadi: {tmp_path / 'o.png'}: the file cannot be written: No space left on device\n"
    assert capsys.readouterr().err == said
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_a_run_that_stops_part_way(tmp_path):
    """The time that was reached, why, and that the table was not written."""
    model = written(
        tmp_path / "m.adm",
        lambda m: m["constraints"].append(
            {"name": "reach", "id": 7, "type": "AbsoluteX", "body1": 3, "sP1": [0, 0], "fun": "0.663103 + t/10"}
        ),
    )
    times = analysis(tmp_path / "a.acf", simulation="Kinematics", tend=1.0, outputSteps=100)
    done = outside("run", model, times, "--csv", tmp_path / "out.csv")
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and "Traceback" not in done.stderr
    # the slider cannot go beyond 0.2 + 0.5, which it would reach at t = 0.369
    assert "t = 0.3" in done.stderr and "reach" in done.stderr and "out.csv was not written" in done.stderr
    assert not (tmp_path / "out.csv").exists()


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="signals as on POSIX")
@pytest.mark.parametrize("kind", ["dynamics", "inverse dynamics"])
def test_interruption_keeps_what_was_computed(tmp_path, capsys, kind, monkeypatch):
    """Ctrl-C in the middle of a run that takes long: status 130, one sentence, and files up to there."""
    model = FREE[0] if kind == "dynamics" else DRIVEN[0]
    times = analysis(tmp_path / "a.acf", simulation=kind, tend=50.0, outputSteps=10_000)
    table, data = tmp_path / "out.csv", tmp_path / "out.npz"
    updates = []

    def update(_bar, _amount):
        updates.append(_amount)
        if len(updates) == 5:
            os.kill(os.getpid(), signal.SIGINT)

    monkeypatch.setattr(progress._NoBar, "update", update)
    status = main(["run", str(model), str(times), "--csv", str(table), "--save", str(data)])
    printed = capsys.readouterr()
    assert (status, printed.out) == (130, "")
    assert printed.err.count("\n") == 1 and "stopped by the user" in printed.err and ".partial" not in printed.err
    motion = mbd.read_trajectory(data, mbd.read_adm(model))
    assert 2 < len(motion) < 10_001
    with open(table, newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["t"]) for row in rows] == motion.t.tolist()
    for path in (table, data):
        assert f"{path} holds the motion up to t = {motion.t[-1]:.6g} s" in printed.err


def test_an_interruption_before_the_first_output(tmp_path, monkeypatch, capsys):
    """Nothing was computed: no file, and no word of one that holds something."""

    def stopped(*_, **__):
        raise mbd.Interrupted("simulate: stopped by the user", partial=None)

    monkeypatch.setattr(mbd, "simulate", stopped)
    assert main(["run", *map(str, FREE), "--csv", str(tmp_path / "out.csv")]) == 130
    assert capsys.readouterr().err == "mbdcasadi: simulate: stopped by the user\n"
    assert list(tmp_path.iterdir()) == []


def test_what_a_short_motion_does_not_give_is_named(tmp_path, monkeypatch, capsys):
    """One output is no film, but a table."""
    motion = mbd.simulate(mbd.read_adm(FREE[0]), duration=0.1).at([0.05])

    def stopped(*_, **__):
        raise mbd.Interrupted("simulate: stopped by the user", partial=motion)

    monkeypatch.setattr(mbd, "simulate", stopped)
    table, film = tmp_path / "out.csv", tmp_path / "out.gif"
    assert main(["run", *map(str, FREE), "--csv", str(table), "--animate", str(film)]) == 130
    said = capsys.readouterr().err
    assert f"{table} holds" in said and f"{film} was not written (animate: takes a motion over some time" in said
    assert list(tmp_path.iterdir()) == [table]


@pytest.mark.parametrize("name", ["me.adm", "me.acf"])
def test_an_input_is_not_overwritten(tmp_path, monkeypatch, capsys, name):
    """By its name, another spelling of it, a link, or a hard link; the run does not begin."""
    for source in FREE:
        (tmp_path / f"me{source.suffix}").write_bytes(source.read_bytes())
    (tmp_path / "soft.csv").symlink_to(tmp_path / name)
    os.link(tmp_path / name, tmp_path / "hard.csv")
    (tmp_path / "folder").mkdir()
    monkeypatch.chdir(tmp_path)
    before = (tmp_path / name).read_bytes()
    for kind in ("csv", "save"):
        for target in (name, f"folder/../{name}", "soft.csv", "hard.csv"):
            assert main(["run", "me.adm", "me.acf", f"--{kind}", target]) == 2
            assert f"--{kind} {target}: this is the same file as the input" in capsys.readouterr().err
            assert (tmp_path / name).read_bytes() == before
