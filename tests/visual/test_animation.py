"""Animations: what is written, how large, what time passes, and what is refused."""

import base64
import json
import re
import shutil
import subprocess
import zlib

import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.visual.film import usual_speed
from mbdcasadi.visual.page.page import Columns
from mbdcasadi.visual.video import finer


@pytest.fixture(scope="module")
def crank():
    """A slider-crank and one turn of it."""
    model = mbd.library.slider_crank()
    return model, mbd.inverse_dynamics(model.driven(crank=0.3 + 2 * np.pi * mbd.t / 3), np.linspace(0, 3, 91))


def data_of(text):
    """The data in a page."""
    return json.loads(re.search(r"const DATA = (.*);\n", text).group(1))


def values_of(data, index):
    """A column of a page over its frames, decoded here."""
    low, high = np.frombuffer(zlib.decompress(base64.b64decode(data["words"])), np.uint8).reshape(2, -1).astype(int)
    steps = (low + 256 * high).reshape(-1, data["count"])
    words = (np.cumsum(steps, axis=1) % 65536).ravel().astype(float)
    column = data["columns"][index]
    if "c" in column:
        return np.full(data["count"], column["c"])
    taken = words[column["at"] : column["at"] + data["count"]]
    if "low" in column:
        taken = 65536 * taken + words[column["low"] : column["low"] + data["count"]]
    return column["o"] + column["s"] * taken


def test_the_page_holds_the_motion(crank):
    """Readings, plots and traces against the trajectory, to what 16 bits can hold."""
    model, motion = crank
    page = mbd.animate(motion, trace=[model.pin.a], plots={"v, m/s": model.slider.velocity})
    data = data_of(page.html)
    times = np.linspace(data["t0"], data["t1"], data["count"])
    fine = motion.at(times)
    assert data["count"] == 91 and data["speed"] == 1.0
    item = next(item for item in data["items"] if item["name"] == "rod")
    for reading, expression in zip(item["readings"][:3], (model.rod.x, model.rod.y, model.rod.phi), strict=True):
        exact = fine[expression]
        np.testing.assert_allclose(values_of(data, reading["column"]), exact, atol=np.ptp(exact) / 65535)
    trace = np.column_stack([values_of(data, c) for c in data["traces"][0]])
    np.testing.assert_allclose(trace, fine[model.pin.a.position], atol=2e-6)
    (plot,) = data["plots"]
    assert [line["name"] for line in plot["lines"]] == ["x", "y"] and plot["label"] == "v, m/s"


def test_a_page_needs_nothing_from_outside_and_is_small(crank, tmp_path):
    """Ten seconds with forces, traces and plots, in one file without an address."""
    model, _ = crank
    motion = mbd.simulate(model.mechanism, np.linspace(0, 10, 501), initial=[model.crank.omega == 10])
    page = mbd.animate(motion, tmp_path / "motion.html", trace=[model.pin.a], plots={"x": model.slider.x})
    text = (tmp_path / "motion.html").read_text(encoding="utf-8")
    assert text == page.html and "<html" in text and "http" not in text and "src=" not in text
    assert len(text) < 120_000


def test_a_long_chain_is_small_too():
    """A hundred links that whirl for ten seconds: parts that are alike are kept once, and columns are packed."""
    chain = mbd.library.pendulum_chain(100).mechanism
    motion = mbd.simulate(chain, np.linspace(0, 10, 301), initial=[body.phi == 0 for body in chain.bodies])
    assert len(mbd.animate(motion).html) < 900_000


def test_angles_of_many_turns_keep_their_places():
    """10 000 rad in ten seconds: columns of poses get more bits where 16 are too coarse."""
    rotor = mbd.Body("rotor", 1, 1)
    bearing = mbd.Revolute("bearing", mbd.ground.at(0, 0), rotor.at(0, 0))
    drive = mbd.Driver("drive", bearing.angle, 1000 * mbd.t)
    motion = mbd.kinematics(mbd.Mechanism([rotor], [bearing], [drive]), np.linspace(0, 10, 301))
    data = data_of(mbd.animate(motion).html)
    angle = next(values_of(data, f[2]) for f in data["frames"] if np.ptp(values_of(data, f[2])) > 1)
    np.testing.assert_allclose(angle, 1000 * np.linspace(0, 10, data["count"]), atol=1e-4)


def test_columns_are_kept_once():
    """Equal columns share their place, constants take none, and what is not finite is refused."""
    store, t = Columns(), np.linspace(0, 1, 50)
    assert store.add(t, "t") == store.add(t.copy(), "again") and store.add(0 * t + 3, "three") == 1
    assert store.columns[1] == {"c": 3.0}
    assert len(zlib.decompress(base64.b64decode(store.words))) == 100
    with pytest.raises(mbd.MechanismError, match="load is not finite"):
        store.add(np.full(50, np.inf), "load")


def test_traces_are_smooth_between_frames():
    """A circle in steps of half a radian, to 0.3 % of its radius; chords miss it by 3 %."""
    turn = np.arange(0, 8, 0.5)
    way = finer(np.column_stack([np.cos(turn), np.sin(turn)]))
    assert len(way) == 5 * 15 + 1
    np.testing.assert_allclose(np.hypot(*way.T), 1, atol=3e-3)
    np.testing.assert_allclose(way[::5], np.column_stack([np.cos(turn), np.sin(turn)]), atol=1e-15)
    np.testing.assert_allclose(finer(np.array([[0.0, 0.0], [1.0, 2.0]]))[1], [0.2, 0.4])


def test_gif(crank, tmp_path):
    """As many frames as asked for, that repeat, in the time that they should take; small."""
    from PIL import Image

    model, motion = crank
    mbd.animate(motion, tmp_path / "motion.gif", trace=[model.pin.a], plots={"x, m": model.slider.x}, fps=10)
    with Image.open(tmp_path / "motion.gif") as film:
        assert film.n_frames == 31 and film.info["loop"] == 0 and film.info["duration"] == 100
        first = np.asarray(film.convert("RGB"))
        film.seek(15)
        middle = np.asarray(film.convert("RGB"))
    assert np.mean(np.any(first != middle, axis=2)) > 0.01
    assert tuple(first[2, 2]) == (255, 255, 255) == tuple(middle[2, 2])  # nothing shines through
    assert (tmp_path / "motion.gif").stat().st_size < 300_000


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="ffmpeg is not on the path")
def test_mp4(crank, tmp_path):
    """A film of the right length."""
    mbd.animate(crank[1], tmp_path / "motion.mp4", fps=10)
    assert (tmp_path / "motion.mp4").read_bytes()[4:8] == b"ftyp"
    told = subprocess.run(["ffmpeg", "-i", tmp_path / "motion.mp4"], capture_output=True, text=True, check=False).stderr
    assert "00:00:03.10" in told and "h264" in told


def test_mp4_without_ffmpeg(crank, tmp_path, monkeypatch):
    """Told before anything is computed, with what to do."""
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with pytest.raises(mbd.MechanismError, match="needs the program ffmpeg.*install it, or write"):
        mbd.animate("not even a motion", tmp_path / "motion.mp4")
    assert not list(tmp_path.iterdir())


def test_time_on_the_screen(crank):
    """Short motions are slowed and long ones quickened, by round numbers; frames follow speed and fps."""
    assert [usual_speed(x) for x in (5.0, 20.0, 3.0)] == [1.0, 1.0, 1.0]
    for duration in (1e-4, 0.013, 0.5, 1.0, 2.0, 30.0, 300.0, 86400.0):
        speed = usual_speed(duration)
        assert 1.5 <= duration / speed <= 40
        assert f"{speed:.0e}"[0] in "125"
    film = mbd.animate(crank[1], fps=20, speed=0.5).film
    assert len(film.t) == 121 and film.t[-1] == 3.0


def test_motions_that_cannot_be_interpolated_and_those_without_reactions(crank):
    """A mode's motion is made of arrays; kinematics knows no reactions."""
    _, motion = crank
    kinematic = mbd.kinematics(motion.mechanism, np.linspace(0, 3, 31))
    data = data_of(mbd.animate(kinematic).html)
    assert next(i for i in data["items"] if i["name"] == "crank pin")["readings"] == []
    pendulum = mbd.library.pendulum_chain(2)
    rest = mbd.equilibrium(pendulum.mechanism)
    swing = mbd.linearize(pendulum.mechanism, rest, wrt=[]).modes()[0].motion(0.1)
    assert not swing.interpolates and len(mbd.animate(swing).html) > 10_000


def test_a_solution_is_shown_by_its_motion():
    """What optimize returns goes in as it is."""
    model = mbd.library.pendulum_chain(1)
    arm = model.mechanism.bodies[0]
    tau = mbd.Input("tau")
    driven = model.mechanism.replace(
        forces=[*model.mechanism.forces, mbd.Torque("own motor", arm, tau)], inputs=[*model.mechanism.inputs, tau]
    )
    start = mbd.assemble(driven)
    problem = mbd.OptimalControlProblem(
        driven, duration=1.0,
        initial=[arm.phi == start[arm.phi], arm.omega == 0], final=[arm.phi == start[arm.phi] + 1],
        running_cost=tau**2,
    )  # fmt: skip
    solution = mbd.optimize(problem, intervals=8)
    assert "Animation of" in repr(mbd.animate(solution))
    assert mbd.draw(solution, poses=3).figure is not None
    labels = [axes.get_ylabel() for axes in mbd.plot_solution(solution).axes]
    assert labels[0] == driven.inputs[0].label and labels[-1] == "mesh" and "reaction, N" in labels


def test_wrong_input_is_named(crank, tmp_path):
    """And leaves no file."""
    model, motion = crank
    for error, arguments, options in (
        ("must end in .html, .gif or .mp4", (motion, tmp_path / "motion.avi"), {}),
        ("must end in .html, .gif or .mp4", (motion, tmp_path / "motion"), {}),
        ("takes a motion over some time", (mbd.assemble(model.mechanism),), {}),
        ("takes a motion over some time", (motion.at([1.0]),), {}),
        ("fps must be positive", (motion,), {"fps": 0}),
        ("speed must be positive", (motion,), {"speed": -1}),
        ("frames, more than", (motion,), {"fps": 30, "speed": 1e-6}),
        ("True or False", (motion,), {"forces": "yes"}),
        ("reactions are not known", (mbd.kinematics(motion.mechanism, [0, 1.0]),), {"forces": True}),
        ("name: expression", (motion,), {"plots": [model.slider.x]}),
        ("two components", (motion,), {"trace": [model.slider.x]}),
        ("folder .* does not exist", (motion, tmp_path / "nowhere" / "motion.html"), {}),
    ):
        with pytest.raises(mbd.MechanismError, match=error):
            mbd.animate(*arguments, **options)
    assert not list(tmp_path.iterdir())
