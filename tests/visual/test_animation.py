"""Animations: what is written, how large, what time passes, and what is refused."""

import base64
import json
import re
import shutil
import subprocess
import zlib
from functools import reduce
from pathlib import Path

import numpy as np
import pytest
from machines import MACHINES

import mbdcasadi as mbd
from mbdcasadi.visual.film import usual_speed
from mbdcasadi.visual.page.packing import Packer


@pytest.fixture(scope="module")
def crank():
    """A slider-crank and one turn of it."""
    model = mbd.library.slider_crank()
    return model, mbd.inverse_dynamics(model.driven(crank=0.3 + 2 * np.pi * mbd.t / 3), np.linspace(0, 3, 91))


def data_of(text):
    """The data in a page."""
    return json.loads(re.search(r"const DATA = (.*);\n", text).group(1))


def inflated(text):
    """Bytes of a text of the page."""
    return np.frombuffer(zlib.decompress(base64.b64decode(text)), np.uint8)


def weights_at(time, knots):
    """Lagrange weights of knots at a time."""
    apart = knots[:, None] - knots[None, :] + np.eye(len(knots))
    factors = np.where(np.eye(len(knots), dtype=bool), 1.0, (time - knots[None, :]) / apart)
    return np.prod(factors, axis=1)


def knots_of(data, index):
    """Times of the knots of a column that moves, and its values there, decoded here."""
    group, place = (
        data["columns"][index]["g"],
        [c.get("g") for c in data["columns"][:index]].count(data["columns"][index]["g"]),
    )
    clock = inflated(data["clock"]).view("<f8")
    masks = np.unpackbits(inflated(data["masks"]).reshape(len(data["groups"]), -1), axis=1, bitorder="little")
    t = clock[masks[group, : clock.size].astype(bool)]
    words = inflated(data["words"]).reshape(4, -1).T.copy().view("<u4").ravel().astype(float)
    start = sum(g["n"] * g["k"] for g in data["groups"][:group]) + place * t.size
    steps = words[start : start + t.size]
    steps = np.where(steps % 2, -(steps + 1) / 2, steps / 2)
    whole, first = np.zeros(t.size), 0
    for k in range(t.size):
        if k and t[k] - t[k - 1] <= data["resolution"]:
            first = k
        guess = whole[k - 1] if k else 0.0
        for points in range(min(k - first, 6), 1, -1):
            # the same operations in the same order as the page: sums are whole numbers to the last bit
            places, weights = t[k - points : k] - t[k], []
            for j in range(points):
                others = np.delete(np.arange(points), j)
                weights.append(reduce(lambda w, o, j=j, p=places: w * (p[o] / (p[o] - p[j])), others, 1.0))
            if sum(map(abs, weights)) <= 64:
                guess = np.floor(sum(w * x for w, x in zip(weights, whole[k - points : k], strict=True)) + 0.5)
                break
        whole[k] = guess + steps[k]
    return t, data["columns"][index]["q"] * (whole + data["columns"][index].get("o", 0.0))


def values_of(data, index, times):
    """A column of a page at times, on the polynomial through six knots about each."""
    if "c" in data["columns"][index]:
        return np.full(len(times), data["columns"][index]["c"])
    t, values = knots_of(data, index)
    found = []
    for time in times:
        left = min(np.searchsorted(t, time, side="right") - 1, t.size - 2)
        jumps = np.flatnonzero(np.diff(t) <= data["resolution"])
        low, high = max([0, *(jumps[jumps < left] + 1)]), min([t.size - 1, *jumps[jumps >= left]])
        start = max(low, min(left - 2, high - 5))
        some = slice(start, min(start + 6, high + 1))
        found.append(weights_at(time, t[some]) @ values[some])
    return np.array(found)


def test_the_page_holds_the_motion(crank):
    """Readings, plots and traces against the trajectory between its outputs, to the digits that are shown."""
    model, motion = crank
    page = mbd.animate(motion, trace=[model.pin.a], plots={"v, m/s": model.slider.velocity})
    data = data_of(page.html)
    times = np.sort(np.random.default_rng(1).uniform(data["t0"], data["t1"], 50))
    fine = motion.at(times)
    assert data["count"] == 91 and data["speed"] == 1.0 and data["precision"] == 6
    item = next(item for item in data["items"] if item["name"] == "rod")
    for reading, expression in zip(item["readings"][:3], (model.rod.x, model.rod.y, model.rod.phi), strict=True):
        exact = fine[expression]
        np.testing.assert_allclose(values_of(data, reading["column"], times), exact, atol=0.1 * 10.0 ** -reading["d"])
        assert np.ptp(exact) / 65535 > 0.1 * 10.0 ** -reading["d"]
    (traced,) = data["traces"]
    base, *place = data["frames"][traced]["a"]  # a point of the crank
    x, y, phi = (values_of(data, c, times) for c in data["frames"][base]["c"][:3])
    c, s = np.cos(phi), np.sin(phi)
    trace = np.column_stack([x + c * place[0] - s * place[1], y + s * place[0] + c * place[1]])
    np.testing.assert_allclose(trace, fine[model.pin.a.position], atol=1e-5)
    (plot,) = data["plots"]
    for line, exact in zip(plot["lines"], fine[model.slider.velocity].T, strict=True):
        np.testing.assert_allclose(values_of(data, line["column"], times), exact, atol=0.1 * 10.0 ** -line["d"])
    assert [line["name"] for line in plot["lines"]] == ["x", "y"] and plot["label"] == "v, m/s"


@pytest.mark.slow
def test_a_page_needs_nothing_from_outside_and_is_small(crank, tmp_path):
    """Ten seconds with forces, traces and plots, in one file without an address."""
    model, _ = crank
    motion = mbd.simulate(model.mechanism, np.linspace(0, 10, 501), initial=[model.crank.omega == 10])
    page = mbd.animate(motion, tmp_path / "motion.html", trace=[model.pin.a], plots={"x": model.slider.x})
    text = (tmp_path / "motion.html").read_text(encoding="utf-8")
    assert text == page.html and "<html" in text and "http" not in text and "src=" not in text
    assert len(text) < 140_000


@pytest.mark.slow
@pytest.mark.parametrize("name", MACHINES)
def test_tooltips_of_every_element_follow_the_motion(name):
    """Between the outputs of a simulation, decoded from the page."""
    motion = mbd.simulate(MACHINES[name]().mechanism, np.linspace(0, 0.3, 16))
    animation = mbd.animate(motion)
    data, times = data_of(animation.html), np.random.default_rng(2).uniform(0, 0.3, 11)
    exact = motion.at(times)
    for item, shown in zip(animation.film.scene.items, data["items"], strict=True):
        assert [reading["label"] for reading in shown["readings"]] == list(item.tooltip)
        for reading, expression in zip(shown["readings"], item.tooltip.values(), strict=True):
            follows = values_of(data, reading["column"], times)
            np.testing.assert_allclose(follows, exact[expression], atol=0.2 * 10.0 ** -reading["d"], err_msg=item.name)


def test_what_a_motion_does_not_know_is_left_out():
    """Kinematics knows neither currents nor the couples that follow from them."""
    wheel = mbd.Body("wheel", 1, 0.1)
    bearing = mbd.Revolute("bearing", mbd.ground.at(0, 0), wheel.at(0, 0))
    motor = mbd.DCMotor("motor", wheel, 6.0, 0.4, 1.5, inductance=0.01)
    turn = mbd.Driver("turn", bearing.angle, mbd.t)
    driven = mbd.Mechanism([wheel], [bearing], [turn], forces=[motor])
    data = data_of(mbd.animate(mbd.kinematics(driven, np.linspace(0, 1, 11))).html)
    labels = {item["kind"]: [reading["label"] for reading in item["readings"]] for item in data["items"]}
    assert labels["DCMotor"] == [] and "phi, rad" in labels["body"]


@pytest.mark.slow
def test_what_changes_without_end_is_reported(crank):
    """Ten thousand periods: the page is rough between the outputs, and says so at the line that asks for it."""
    with pytest.warns(mbd.MechanismWarning, match="the motion changes so often that the page cannot hold it") as said:
        page = mbd.animate(crank[1], plots={"x": mbd.sin(2e4 * mbd.t)}).html
    assert len(page) < 2_000_000 and said[0].filename == __file__


@pytest.mark.slow
def test_a_long_chain_is_small_too():
    """A hundred links that whirl: parts that are alike are kept once, and columns are packed."""
    chain = mbd.library.pendulum_chain(100).mechanism
    motion = mbd.simulate(chain, np.linspace(0, 0.6, 301), initial=[body.phi == 0 for body in chain.bodies])
    assert len(mbd.animate(motion).html) < 900_000


def test_angles_of_many_turns_keep_their_places():
    """10 000 rad in ten seconds: columns of poses get more bits where 16 are too coarse."""
    rotor = mbd.Body("rotor", 1, 1)
    bearing = mbd.Revolute("bearing", mbd.ground.at(0, 0), rotor.at(0, 0))
    drive = mbd.Driver("drive", bearing.angle, 1000 * mbd.t)
    motion = mbd.kinematics(mbd.Mechanism([rotor], [bearing], [drive]), np.linspace(0, 10, 301))
    data, times = data_of(mbd.animate(motion).html), np.linspace(0, 10, 777)
    angles = [values_of(data, f["c"][2], times) for f in data["frames"] if "a" not in f and "v" not in f]
    (angle,) = (x for x in angles if np.ptp(x) > 1)
    np.testing.assert_allclose(angle, 1000 * times, atol=1e-4)


@pytest.mark.parametrize(
    "with_node", [False, pytest.param(True, marks=pytest.mark.skipif(not shutil.which("node"), reason="needs node"))]
)
def test_places_far_from_the_origin(with_node, tmp_path):
    """A pendulum of half a metre at coordinates of a land survey, read here and by the code of the page."""
    far = np.array([4.5e5, 5.4e6])
    rod = mbd.Body("rod", mass=1.0, inertia=0.02, pose=(far[0] + 0.25, far[1], 0.0))
    pin = mbd.Revolute("pin", mbd.ground.at(*far), rod.at(-0.25, 0))
    pendulum = mbd.Mechanism(bodies=[rod], joints=[pin], forces=[mbd.Gravity()])
    motion = mbd.simulate(pendulum, np.linspace(0, 2, 101), initial=[pin.angle == 0, rod.omega == 0])
    text = mbd.animate(motion).html
    data, times = data_of(text), np.linspace(0, 2, 33)
    moving = [frame["c"] for frame in data["frames"] if "a" not in frame and "v" not in frame]
    columns = next(c for c in moving if "g" in data["columns"][c[0]])
    if with_node:
        template = Path(mbd.__file__).parent / "visual" / "page" / "template" / "data.js"
        asked = f"console.log(JSON.stringify({columns[:2]}.map(c => {times.tolist()}.map(t => valueAt(c, t)))))"
        script = tmp_path / "page.mjs"
        script.write_text(f"const DATA = {json.dumps(data)};\n{template.read_text('utf-8')}\n{asked}", "utf-8")
        run = subprocess.run(["node", str(script)], capture_output=True, text=True, check=True)
        found = np.array(json.loads(run.stdout))
    else:
        found = np.array([values_of(data, c, times) for c in columns[:2]])
    np.testing.assert_allclose(found.T, motion.at(times)[rod.position], rtol=0, atol=1e-4)


def test_columns_are_kept_once(crank):
    """Equal columns share their place, constants take none, and what is not finite is refused."""
    model, motion = crank
    data = data_of(mbd.animate(motion).html)
    crank_ = next(item for item in data["items"] if item["name"] == "crank")
    x, y = (next(r["column"] for r in crank_["readings"] if r["label"] == label) for label in ("x, m", "y, m"))
    assert x != y and any(frame["c"][:2] == [x, y] for frame in data["frames"])
    constants = [column["c"] for column in data["columns"] if "c" in column]
    assert len(constants) == len(set(constants)) and 0.0 in constants
    whole = Packer(np.linspace(0, 1, 50), 1e-9)
    assert whole.constant(3.0) == whole.constant(3.0) == 0 and whole.columns == [{"c": 3.0}]
    with pytest.raises(mbd.MechanismError, match="'load' is not finite|not finite at t"):
        mbd.animate(motion, plots={"load": 1 / (model.crank.phi - motion[model.crank.phi][0])}).html  # noqa: B018


def test_traces_are_smooth_between_frames():
    """A circle in steps of half a radian, to 0.3 % of its radius; chords miss it by 3 %."""
    rotor = mbd.Body("rotor", 1, 1)
    bearing = mbd.Revolute("bearing", mbd.ground.at(0, 0), rotor.at(0, 0))
    drive = mbd.Driver("drive", bearing.angle, 15 * mbd.t)
    motion = mbd.kinematics(mbd.Mechanism([rotor], [bearing], [drive]), np.linspace(0, 3, 91))
    film = mbd.animate(motion, trace=[rotor.at(1, 0)], fps=30).film
    corners = film.paths[:, 0]
    np.testing.assert_allclose(np.hypot(*corners.T), 1, atol=4e-4)
    middles = (corners[1:] + corners[:-1]) / 2
    np.testing.assert_allclose(np.hypot(*middles.T), 1, atol=3e-3)


def test_films_show_every_peak_and_what_is_true_at_their_frames():
    """A ball that hits the floor between two frames: the curve in the film rises to the largest output."""
    ball = mbd.Body("ball", 1, 1e-3, pose=(0, 0.5, 0))
    floor = mbd.Contact(
        "floor", mbd.Circle(ball.at(0, 0), 0.05), mbd.HalfPlane(mbd.ground.at(0, 0)), mbd.HuntCrossley(1e5, damping=0.2)
    )
    motion = mbd.simulate(mbd.Mechanism([ball], forces=[mbd.Gravity(), floor]), np.linspace(0, 3, 601))
    film = mbd.animate(motion, plots={"force, N": floor.normal_force}, fps=10).film
    (curve,) = film.curves["force, N"].values()
    assert curve.max() >= motion[floor.normal_force].max() > 300
    (frame,) = (k for k, f in enumerate(film.scene.frames) if f.vector is None and k)
    np.testing.assert_allclose(film.poses[:, frame, 1], motion.at(film.t)[ball.y], atol=1e-12)


@pytest.mark.slow
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


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="ffmpeg is not on the path")
def test_mp4(crank, tmp_path):
    """A film of the right length."""
    mbd.animate(crank[1], tmp_path / "motion.mp4", fps=10)
    assert (tmp_path / "motion.mp4").read_bytes()[4:8] == b"ftyp"
    output = subprocess.run(
        ["ffmpeg", "-i", tmp_path / "motion.mp4"], capture_output=True, text=True, check=False
    ).stderr
    assert "00:00:03.10" in output and "h264" in output


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


@pytest.mark.slow
def test_motions_of_modes_and_those_without_reactions(crank):
    """A mode's motion has polynomials of its own; kinematics knows no reactions."""
    _, motion = crank
    kinematic = mbd.kinematics(motion.mechanism, np.linspace(0, 3, 31))
    data = data_of(mbd.animate(kinematic).html)
    assert next(i for i in data["items"] if i["name"] == "crank pin")["readings"] == []
    pendulum = mbd.library.pendulum_chain(2)
    rest = mbd.equilibrium(pendulum.mechanism)
    swing = mbd.linearize(pendulum.mechanism, rest, wrt=[]).modes()[0].motion(0.1)
    assert swing.interpolates and len(mbd.animate(swing).html) > 10_000


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
    assert labels[0] == driven.inputs[0].quantity and labels[-1] == "mesh" and "reaction, N" in labels


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
