"""The examples run from outside, draw their pictures, and find what they say."""

import os
import runpy
import shutil
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

import mbdcasadi as mbd

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
NAMES = sorted(path.stem for path in EXAMPLES.glob("*.py"))
#: Examples that are only run; the others have a test of their own name, which says what they find.
PLAIN = (
    "buckling", "first_mechanism", "four_bar_output", "identify_friction", "modes", "slider_crank", "tolerances",
    "walking_leg",
)  # fmt: skip
LINES, BYTES = 100, 20_000


def is_picture(path):
    """Whether a file is a PNG with something in it."""
    content = path.read_bytes()
    return content[:4] == b"\x89PNG" and len(content) > BYTES


@pytest.fixture
def found(request, tmp_path, monkeypatch):
    """Names of the example that a test is called after, run with warnings as errors and drawn."""
    name = request.function.__name__.removeprefix("test_")
    script = copied(name, tmp_path)
    monkeypatch.chdir(tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("error", mbd.MechanismWarning)
        names = runpy.run_path(str(script))
    (picture,) = (tmp_path / "output").glob("*.png")
    assert is_picture(picture)
    return names


def copied(name, folder):
    """An example in a folder of its own, with the models and the folder that it writes to."""
    (folder / "output").mkdir()
    shutil.copytree(EXAMPLES / "models", folder / "models")
    return Path(shutil.copy(EXAMPLES / f"{name}.py", folder))


def largest_error(*solutions):
    """Largest difference at the end after simulating with the inputs found, m or rad."""
    return max(solution.verify().final_error for solution in solutions)


def fine(solution, expression):
    """Values of an expression at many times, between mesh points too."""
    return solution.trajectory.at(np.linspace(0, solution.duration, 2001))[expression]


@pytest.mark.parametrize("name", NAMES)
def test_is_short_and_checked(name):
    text = (EXAMPLES / f"{name}.py").read_text(encoding="utf-8")
    assert text.startswith('"""') and len(text.splitlines()) < LINES
    assert "?" in text.split("\n\n")[0]  # the docstring begins with the question
    assert name in PLAIN or f"test_{name}" in globals()


@pytest.mark.slow
@pytest.mark.parametrize("name", PLAIN)
def test_runs_from_outside(name, tmp_path):
    """Exit status 0, nothing on standard error, some output, and a picture."""
    command, environment = [sys.executable, copied(name, tmp_path)], os.environ | {"PYTHONPATH": str(EXAMPLES.parent)}
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False, env=environment)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout and is_picture(tmp_path / "output" / f"{name}.png")
    assert {path.name for path in tmp_path.iterdir()} == {
        f"{name}.py",
        "models",
        "output",
    }  # nothing is written elsewhere
    for page in (tmp_path / "output").glob("*.html"):
        assert BYTES < page.stat().st_size < 10 * BYTES and page.stem == name


@pytest.mark.slow
def test_four_bar_torque(found):
    effort, gentle, fastest = found["effort"], found["gentle"], found["fastest"]
    assert largest_error(effort, gentle, fastest) < 1e-4
    assert effort.cost == pytest.approx(0.2774, rel=1e-3) and gentle.cost > effort.cost
    assert fine(gentle, found["load"]).max() < 1.01 * found["limit"] < fine(effort, found["load"]).max()
    assert fastest.duration < 0.2 and np.mean(np.abs(fine(fastest, found["tau"])) > 0.99 * found["torque"]) > 0.9


@pytest.mark.slow
def test_cart_pole(found):
    solutions = found["found"].values()
    costs = [solution.cost for solution in solutions]
    assert costs == pytest.approx([58.80767, 57.94478], abs=1e-4)
    assert all(solution.mesh_error <= 1e-8 for solution in solutions) and largest_error(*solutions) < 1e-5


@pytest.mark.slow
def test_compass_walker(found):
    """Step, period and the landing against shooting; the gait is stable."""
    solution, check = found["solution"], found["check"]
    assert solution.duration == pytest.approx(0.7343463911587, abs=1e-8)
    assert solution.parameters[found["step"]] == pytest.approx(0.535445415430, abs=1e-8)
    assert check.time_error < 1e-8 and check.final_error < 1e-7 and found["stability"].is_stable


@pytest.mark.slow
def test_sorting_plate(found):
    """Both parts fly from where the plate falls faster than they do; how far they get is a matter of friction."""
    motion, slope, rate = found["motion"], found["SLOPE"], found["RATE"]
    fall, lift = 9.81 * np.cos(slope), found["STROKE"] * np.sin(found["THROW"] - slope)
    off = np.arcsin(fall / (lift * rate**2)) / rate
    phase, flight = rate * off, np.linspace(1e-3, 0.08, 100_000)
    above = (
        lift * (np.sin(phase) + rate * flight * np.cos(phase) - np.sin(phase + rate * flight)) - fall * flight**2 / 2
    )
    lands = off + flight[np.argmax(above < 0)]
    ways = []
    for part, contact in zip(found["parts"], found["contacts"], strict=True):
        first = {
            name: next(e.t for e in motion.events if e.name == f"{contact.name}.0 {name}")
            for name in ("opens", "touches")
        }
        assert first["opens"] == pytest.approx(off, abs=1e-8) and first["touches"] == pytest.approx(lands, abs=2e-6)
        along = found["ALONG"] @ motion[part.position - found["plate"].position].T
        ways.append(along[-1] - along[0])
    assert ways[0] > 0.03 and ways[1] < -0.02


@pytest.mark.slow
def test_rimless_wheel(found):
    """All runs come to the speed by hand, and the multiplier is the square of the share that an impact leaves."""
    assert found["stability"].multipliers[0] == pytest.approx(found["share"] ** 2, abs=1e-7)
    for run in found["runs"].values():
        assert -run.events[-1].after[found["wheel"].omega] == pytest.approx(found["steady"], abs=0.02)
    drop = 2 * found["LEG"] * np.sin(found["HALF"]) * np.sin(found["SLOPE"])
    assert found["loss"] == pytest.approx(found["MASS"] * found["G"] * drop, abs=1e-7)


@pytest.mark.slow
def test_five_link_biped(found):
    """Cost and impulse of collocation in absolute angles, and a landing that IDAS finds."""
    assert found["solution"].cost == pytest.approx(469.50197507, abs=1e-3)
    impulse = found["event"].after[found["lands"].impulse_on(found["other_tibia"]).force]
    np.testing.assert_allclose(impulse, [-13.58603, 26.54152], atol=1e-3)
    assert found["check"].time_error < 1e-4 and found["after"] < found["before"]


@pytest.mark.slow
def test_hopper(found):
    """The cost of collocation in minimal coordinates, which is given its phases, and a foot that is pressed down."""
    assert found["solution"].cost == pytest.approx(3696.471396, abs=5e-3)
    assert found["fine"][found["sole"].normal_force].min() > -1e-6 and found["check"].time_error < 1e-5
    strike = found["strike"]
    assert strike.name == "sole touches"
    impulse = -found["FOOT"] * strike.state[found["foot"].vy]
    assert strike.after[found["sole"].impulse] == pytest.approx(impulse, abs=1e-6)


@pytest.mark.slow
def test_trebuchet(found):
    """The range by SciPy in three angles; along its derivative the ball goes farther, by what the derivative says."""
    first, better = (shot.final[found["ball"].x] for shot in found["shots"])
    assert first == pytest.approx(328.458509, abs=1e-4) and found["found"][0][2] == pytest.approx(first, abs=1e-4)
    assert better > first + 15
    assert [event.name for event in found["shots"][0].events] == ["lifts off", "release", "lands"]


@pytest.mark.slow
def test_throwing_arm(found):
    """Below the cost of collocation in two angles from the usual guess; more time is cheaper; both hit the mark."""
    quick, slow = found["solutions"].values()
    assert quick.cost == pytest.approx(7.81795711, abs=1e-3) and slow.cost < quick.cost < 11.37798126
    for solution in (quick, slow):
        assert solution.trajectory.final[found["ball"].x] == pytest.approx(found["MARK"][0], abs=1e-6)
        assert solution.verify().final_error < 1e-3


@pytest.mark.slow
def test_gripper(found):
    """The least time by hand; a lighter blow takes more time and is not exceeded; momentum is shared."""
    solutions = found["solutions"]
    assert solutions[None].duration == pytest.approx(found["exact"], abs=3e-4)
    times = [solution.duration for solution in solutions.values()]
    assert times == sorted(times)
    for limit, solution in solutions.items():
        before, after = (solution.phases[k].trajectory.state(-1 + k)[found["arm"].omega] for k in (0, 1))
        assert after == pytest.approx(found["first"] / found["second"] * before, abs=1e-6)
        blow = solution.trajectory.events[0].after[found["blow"]]
        assert limit is None or blow == pytest.approx(limit, abs=1e-6)


@pytest.mark.slow
def test_geneva_drive(found):
    """The wheel turns by the formula, in quarters, and no velocity jumps."""
    assert found["error"] < 1e-10
    for event in found["motion"].events:
        assert abs(event.after[found["wheel"].omega] - event.state[found["wheel"].omega]) < 1e-9
    left = [event.after[found["wheel"].phi] for event in found["motion"].events if event.name == "pin leaves"]
    np.testing.assert_allclose(np.diff(left), -np.pi / 2, atol=1e-9)


@pytest.mark.slow
def test_five_bar_robot(found):
    free, around, quick = found["solutions"].values()
    assert largest_error(free, around, quick) < 1e-6
    gap = mbd.distance(found["tool"].position, found["POST"])
    for solution in (around, quick):
        assert fine(solution, gap).min() > found["RADIUS"] - 1e-4
        assert fine(solution, found["load"]).max() < 1.01 * found["BEARING"]
    assert fine(free, gap).min() < found["RADIUS"] and free.cost < around.cost and quick.duration < around.duration


@pytest.mark.slow
def test_slider_crank_balance(found):
    solutions, crank, tau = found["found"].values(), found["crank"], found["tau"]
    peaks = [solution.parameters[found["peak"]] for solution in solutions]
    assert peaks == sorted(peaks, reverse=True) and peaks[-1] < 0.2 * peaks[0]
    assert peaks[-1] > found["mean"]  # no motor is weaker than the work that the pump takes
    assert largest_error(*solutions) < 1e-4
    for solution, peak in zip(solutions, peaks, strict=True):
        assert np.abs(fine(solution, tau)).max() < 1.02 * peak
        speed = fine(solution, crank.omega)
        assert speed[-1] == pytest.approx(speed[0], abs=1e-6)


@pytest.mark.slow
def test_least_time(found):
    for name, solution in found["found"].items():
        assert solution.duration == pytest.approx(found["exact"][name][0][-1], abs=2e-6)
    for name, solution in found["equal"].items():
        exact = found["exact"][name.split(",")[0]][0][-1]
        # a switch inside an interval costs time, since inputs keep their limits there, too
        assert 0 < solution.duration - exact < 2e-4
        excess = [x for label, x in solution.limit_excess.items() if label.startswith("motor torque")]
        assert len(excess) == 2 and max(excess) < 1e-6
    assert largest_error(*found["found"].values(), *found["equal"].values()) < 1e-5


@pytest.mark.slow
def test_periodic_linkage(found):
    crank, tau, solutions = found["crank"], found["tau"], found["found"]
    ripple = {name: np.ptp(fine(solution, tau)) for name, solution in solutions.items()}
    assert ripple["10 %, no counterweight"] > 5 * ripple["10 %"] and ripple["2 %"] > ripple["10 %"]
    assert ripple["torque constant"] < 1e-2
    for solution in solutions.values():
        speed, torque = fine(solution, crank.omega), fine(solution, tau)
        assert speed[-1] == pytest.approx(speed[0], abs=1e-6) and torque[-1] == pytest.approx(torque[0], abs=1.0)
        assert np.mean(speed[:-1]) * found["TURN"] == pytest.approx(2 * np.pi, abs=1e-5)
    # at constant torque the motion is nearly indifferent: intervals miss a small part of what the end is off
    replays = [solution.verify() for solution in solutions.values()]
    assert max(replay.final_error for replay in replays) < 1e-2
    assert max(np.max(replay.defects) for replay in replays) < 1e-5


@pytest.mark.slow
def test_cart_pole_control(found):
    motion = found["motion"]
    assert motion.statistics.control_statuses == [0] * 80
    assert np.abs(found["degrees"]).max() < 20 and abs(found["degrees"][-1]) < 3
    assert np.abs(motion[found["cart"].x]).max() < 1.01 * found["TRACK"]
    assert found["controller"].timing.feedback.size == 80


@pytest.mark.slow
def test_planetary_train(found):
    """The ratio is Willis'; torques balance the load; the relation holds while the ring slips back."""
    assert found["ratio"] == pytest.approx(0.04 / 0.12, rel=1e-12)
    run, drive, brake = found["run"], found["drive"], found["brake"]
    np.testing.assert_allclose(run[drive.effort] + run[brake.effort], found["LOAD"], rtol=1e-10)
    motion, train = found["motion"], found["train"]
    assert np.max(np.abs(motion[found["willis"]])) < 1e-12
    assert motion[train.ring.omega][-1] < -10


@pytest.mark.slow
def test_straight_line(found):
    """All places are met exactly; in between the path is off by less than a thousandth of its length."""
    best, path = found["best"], found["line"](found["best"])
    assert best.residual < 1e-9 and found["length"] == pytest.approx(0.8 * np.cos(np.pi / 10), abs=0.01)
    assert np.max(np.abs(path[:, 1] - found["HEIGHT"])) < 1e-3 * found["length"]


@pytest.mark.slow
def test_wiper(found):
    """The blade is where it was after the dwell, sweeps what it should, and hardly moves in between."""
    motion, model, best = found["motion"], found["model"], found["best"]
    course = np.interp(np.radians([20, 189.9]), motion[model.crank.phi], found["blade"])
    assert best.residual < 1e-9 and course == pytest.approx([0, -90], abs=0.01)
    assert found["dwell"] < 1 and 90 <= np.ptp(found["blade"]) < 95


@pytest.mark.slow
def test_cam(found):
    """The contact force at the limit is zero somewhere and nowhere negative; just above it the follower lifts off."""
    contact, limit = found["contact"], found["limit"]
    touching = found["turned_at"](limit)[contact.normal_force]
    assert np.min(touching) == pytest.approx(0, abs=0.02)
    flight = found["flight"]
    assert [event.name for event in flight.events] == ["lift-off at contact"]
    assert flight.final[contact.normal_force] == pytest.approx(0, abs=1e-3)


@pytest.mark.slow
def test_excavator(found):
    """The work of the cylinders is that of the weights and the load; all ends at rest."""
    run, load = found["run"], found["load"]
    power = sum(-run[x.force] * run[mbd.time_derivative(x.length)] for x in found["excavator"].drivers)
    power = power + run[mbd.dot(load.force, mbd.time_derivative(load.at.position))]
    work = np.sum((power[1:] + power[:-1]) / 2 * np.diff(run.t))
    assert work == pytest.approx(run.energy.total[-1] - run.energy.total[0], rel=1e-4)
    assert abs(power[-1]) < 1e-3


def test_dc_motor(found):
    """The energy budget closes to what the coil holds; the optimum takes less heat and replays."""
    run, motor = found["run"], found["motor"]
    coil = 0.5 * found["WINDING"]["inductance"] * run[motor.current][-1] ** 2
    assert found["taken"] - found["lost"] - found["lifted"] == pytest.approx(coil, rel=0.02)
    assert found["solution"].cost < 0.6 * found["until"]
    assert found["solution"].verify().final_error < 1e-3


@pytest.mark.slow
def test_parking(found):
    """It arrives at the side, and the blade never slipped."""
    solution, sledge = found["solution"], found["sledge"]
    final = solution.trajectory.final
    assert final[sledge.y] == pytest.approx(0.4, abs=1e-7)
    assert solution.verify().final_error < 1e-5
    assert np.max(np.abs(found["run"][found["across"]])) < 1e-12


@pytest.mark.slow
def test_stick_slip(found):
    """Slides as long as is best by hand, or all the time if that is not allowed; simulate finds the same switches."""
    for duration, solution in found["solutions"].items():
        cost, slides = found["by_hand"](duration)
        assert solution.cost == pytest.approx(cost, rel=1e-7)
        times = [0.0, *(switch.t for switch in solution.switches), duration]
        assert max(np.diff(times)) == pytest.approx(slides, abs=1e-4)
        assert solution.verify().time_error < 1e-6


@pytest.mark.slow
def test_shuffleboard(found):
    """The puck is let go before the line with the energy that friction takes on the way left, and stops on the mark."""
    solution, fine_, puck = found["solution"], found["fine"], found["puck"]
    replay = solution.verify().trajectory
    assert replay[puck.x][-1] == pytest.approx(found["MARK"], abs=1e-8)
    apart = fine_[found["tip"].normal_force] == 0
    gone = np.flatnonzero(~apart)[-1] + 1
    assert fine_[puck.x][gone] - found["RADIUS"] <= found["LINE"] and apart[-1] and not apart[200]
    left = found["MARK"] - fine_[puck.x][gone]
    assert fine_[puck.vx][gone] ** 2 / 2 == pytest.approx(found["MU"] * 9.81 * left, rel=1e-6)
    assert fine_[found["cue"].x].max() <= found["LINE"] - found["RADIUS"] + 1e-4


@pytest.mark.slow
def test_measured_kick(found):
    """Power of the torques is the rate of the energy; samples as they are give many times the torques."""
    exact, smooth, rough, leg = (found[name] for name in ("exact", "found", "rough", "leg"))
    thigh, shank = leg.bodies
    hip, knee = found["torques"]
    power = hip * thigh.omega + knee * (shank.omega - thigh.omega)
    inertia = sum(b.mass * (b.vx * b.ax + b.vy * (b.ay + 9.81)) + b.inertia * b.omega * b.alpha for b in (thigh, shank))
    np.testing.assert_allclose(smooth[power], smooth[inertia], atol=1e-9)
    for torque in (hip, knee):
        size = np.sqrt(np.mean(exact[torque] ** 2))
        missed = [np.sqrt(np.mean((run[torque] - exact[torque])[10:-10] ** 2)) / size for run in (smooth, rough)]
        assert missed[0] < 0.15 and missed[1] > 3


@pytest.mark.slow
def test_elevator(found):
    """Ways, tensions and the least brake by hand."""
    assert found["least"] == pytest.approx(300 * 9.81 * 0.3, rel=1e-9)
    pull, inertia = 300 * 9.81, 1500 + 50.0
    for couple, run in zip((1500.0, 2000.0, 3000.0), found["runs"].values(), strict=True):
        speed, slowing = 0.4 * pull / inertia, (couple / 0.3 - pull) / inertia
        (stop,) = run.events
        assert stop.t == pytest.approx(0.4 + speed / slowing, abs=1e-9)
        assert -1 - run.final[found["car"].y] == pytest.approx(speed * 0.2 + speed**2 / 2 / slowing, abs=1e-9)
        while_slips = [900 * (9.81 + slowing), 600 * (9.81 - slowing)]
        np.testing.assert_allclose(run.at([0.45])[found["rope"].tensions][0], while_slips, rtol=1e-9)
        np.testing.assert_allclose(run.final[found["rope"].tensions], [900 * 9.81, 600 * 9.81], rtol=1e-9)


@pytest.mark.slow
def test_crane_servo(found):
    """Limits hold, the load hangs still at the end, and no servo is faster without a load."""
    solution, values = found["fastest"], {z: fine(found["fastest"], found[z]) for z in ("speed", "acceleration")}
    assert largest_error(solution) < 1e-7
    assert np.max(np.abs(values["speed"])) < 1.5 * 1.001 and np.max(np.abs(values["acceleration"])) < 1.0001
    assert 5 / 1.5 + 1.5 / 1 + 1 / 6 < solution.duration < 5.1  # the first is the trolley alone, by hand
    final = solution.verify().trajectory.final
    assert final[found["load"].x] == pytest.approx(5, abs=1e-7) and abs(final[found["load"].vx]) < 1e-7


@pytest.mark.slow
def test_hoist(found):
    """Euler's formula on each of four pulleys, at the least and the greatest couple and while the load rises."""
    holds, rope, e = found["holds"], found["rope"], found["e"]
    assert holds.greatest == pytest.approx(2000 * 9.81 * 0.25 / found["rising"], rel=1e-9)
    assert holds.least == pytest.approx(2000 * 9.81 * 0.25 / found["sinking"], rel=1e-9)
    for state, ratio in ((holds.at_greatest, 1 / e), (holds.at_least, e), (found["run"].final, 1 / e)):
        np.testing.assert_allclose(state[rope.tensions][1:] / state[rope.tensions][:-1], ratio, rtol=1e-9)
    assert found["run"].final[found["load"].y] - 0.6 == pytest.approx(2 * found["a"], rel=1e-7)


@pytest.mark.slow
def test_garage_door(found):
    """Couple of the closed door and work of the opener, without a spring at the end."""
    assert found["couple"][0] == pytest.approx(3 * 30 * 9.81 * 0.06, rel=1e-9) == found["first"]
    assert found["work"] == pytest.approx(found["by_hand"], rel=1e-3)
    assert np.all(found["run"][found["cable"].tensions] > 0)


@pytest.mark.slow
def test_motorcycle(found):
    """Acceleration, loads of tyre and spring by hand; the arm rises with a sprocket that is high up."""
    end = found["end"]
    assert end[found["frame"].ax] == pytest.approx(found["a"], rel=1e-6)
    assert found["tyre"] == pytest.approx(found["load"], rel=1e-6)
    assert found["couple"] == pytest.approx(found["hold"], rel=1e-6)
    np.testing.assert_allclose(end[found["chain"].tensions], [found["pull"], 0], rtol=1e-6)
    assert found["squat"][-1] < 0


@pytest.mark.slow
def test_robot_walker(found):
    """Fall, weight and the moment at a knee."""
    end = found["end"]
    assert found["run"].events[0].t == pytest.approx(np.sqrt(2 * 0.1 / 9.81), abs=1e-8)
    assert end[found["floor"]] == pytest.approx(found["weight"], rel=1e-3)
    assert end[found["servo"].forces] == pytest.approx(found["couple"], rel=1e-3)
    assert 5 < found["couple"] < 15


def test_what_examples_write_is_not_in_the_repository():
    """The folder is there, and git ignores what is in it."""
    done = subprocess.run(
        ["git", "check-ignore", "examples/output/cam.png"], cwd=EXAMPLES.parent, capture_output=True, check=False
    )
    assert (EXAMPLES / "output" / ".gitignore").exists()
    assert done.returncode in (0, 128)  # ignored, or this is no repository
