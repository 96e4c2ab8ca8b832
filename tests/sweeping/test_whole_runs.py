"""Sweeps by DOP853: the cases in C, against single runs and closed forms."""

import os
import pickle
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import numpy as np
import pytest
from keyboard import interrupted
from linkages import four_bar

import mbdcasadi as mbd
from mbdcasadi.integrators.native import build


def fall():
    """A stone under a gravity that varies, pushed by an input and by a pulse in time."""
    g, u = mbd.Parameter("g", 9.81), mbd.Input("u", value=0.0)
    stone = mbd.Body("stone", mass=2.0, inertia=1.0)
    push = mbd.Force("push", stone.at(0, 0), (u, 0))
    forces = [mbd.Gravity((0, -g)), push]
    return g, u, stone, mbd.Mechanism(bodies=[stone], forces=forces, parameters=[g], inputs=[u])


def test_closed_form():
    g, u, stone, mechanism = fall()
    gravities, pushes = np.linspace(1, 10, 7), np.linspace(-2, 2, 7)
    swept = mbd.sweep(
        mechanism,
        [0, 0.5, 1.0],
        {g: gravities, u: pushes},
        {"y": stone.y, "a": stone.ax, "pose": stone.q},
        method="dop853",
    )
    assert not swept.failures
    np.testing.assert_allclose(swept["y"], -0.5 * gravities[:, None] * np.array([0, 0.5, 1.0]) ** 2, atol=1e-9)
    np.testing.assert_allclose(swept["a"], np.repeat(pushes[:, None] / 2, 3, axis=1), atol=1e-12)
    np.testing.assert_allclose(swept["pose"][:, -1, 0], pushes / 4, atol=1e-9)


@pytest.mark.parametrize(
    "chosen",
    [pytest.param("dop853", marks=pytest.mark.skipif(build.compiler() is None, reason="no C compiler")), "erk", "idas"],
)
def test_auto_takes_dop853_for_what_is_smooth_and_not_stiff(chosen):
    """A stone of 2 kg under 8 N on a spring, in closed form; also by a force that might jump, and on a stiff damper."""
    g, u, stone, mechanism = fall()
    stiffness, damping = (0.0, 1e6) if chosen == "idas" else (8.0, 0.0)
    hold = mbd.Force("hold", stone.at(0, 0), (-stiffness * stone.x - damping * stone.vx, 0))
    mechanism = mechanism.replace(forces=[*mechanism.forces, hold])
    inputs = {u: mbd.if_else(mbd.t < 5, 8.0, 0.0)} if chosen == "erk" else {u: 8.0}
    times, accelerations = np.linspace(0, 1, 5), [1.0, 2.0]
    swept = mbd.sweep(
        mechanism, times, {g: accelerations}, {"x": stone.x, "y": stone.y}, inputs=inputs, method="auto", reltol=1e-9
    )
    assert any("dop853 ran in C" in note for note in swept.notes) == (chosen == "dop853")
    np.testing.assert_allclose(swept["y"], -np.outer(accelerations, times**2 / 2), atol=1e-8)
    if chosen == "idas":
        x, accuracy = 8.0 / damping * (times - 2.0 / damping * (times > 0)), 1e-11
    else:
        x, accuracy = 1.0 - np.cos(2.0 * times), 1e-8
    np.testing.assert_allclose(swept["x"], np.tile(x, (2, 1)), atol=accuracy)


def test_auto_without_a_compiler_takes_a_compiled_integrator(monkeypatch):
    g, _, stone, mechanism = fall()
    monkeypatch.setenv("CC", "no-such-compiler")
    swept = mbd.sweep(mechanism, [0, 1], {g: [1.0, 2.0]}, {"y": stone.y}, method="auto")
    assert swept.notes == [] and swept["y"][:, -1] == pytest.approx([-0.5, -1.0], abs=1e-8)


def test_the_code_that_ran_is_named():
    """Here and in other threads; CasADi's methods need no remark."""
    g, _, stone, mechanism = fall()

    def notes(**given):
        return mbd.sweep(mechanism, [0, 1], {g: [1.0, 2.0]}, {"y": stone.y}, **given).notes

    (note,) = notes(method="dop853")
    assert note.startswith("dop853 ran in C")
    with ThreadPoolExecutor(1) as executor:
        assert notes(method="dop853", executor=executor) == [note]
    assert notes(method="idas") == []
    swept = mbd.sweep(mechanism, [0, 1], {g: [1.0, 2.0]}, {"y": stone.y}, method="dop853")
    assert repr(swept).endswith(f"note: {note}")


def test_samples_and_time():
    """Samples with a kink, and an expression in time with a short pulse."""
    g, u, stone, mechanism = fall()
    times = np.linspace(0, 2, 9)
    for given, momentum in (
        (np.where(times < 1, times, 1.0), 1.5),
        (mbd.if_else(mbd.fabs(mbd.t - 1.1) < 0.01, 50.0, 0.0), 1.0),
    ):
        if isinstance(given, np.ndarray):
            swept = mbd.sweep(mechanism, times, {g: [1.0, 2.0]}, {"v": stone.vx}, inputs={u: given}, method="dop853")
            np.testing.assert_allclose(swept["v"][:, -1] * 2.0, momentum, rtol=1e-7)
        else:
            with pytest.raises(mbd.SimulationError, match=r'dop853.*smooth.*method="erk"'):
                mbd.sweep(mechanism, times, {g: [1.0, 2.0]}, {"v": stone.vx}, inputs={u: given}, method="dop853")


@pytest.mark.slow
@pytest.mark.parametrize("count", [3, 60])
def test_times_of_their_own(count):
    """Short pulses at a time that varies: each case has stops of its own, and all their momentum is there."""
    late, stone = mbd.Parameter("late", 0.5), mbd.Body("stone", mass=2.0, inertia=1.0)
    pulse = mbd.Force("pulse", stone.at(0, 0), (mbd.exp(-(((mbd.t - late) / 0.01) ** 2)), 0))
    mechanism = mbd.Mechanism(bodies=[stone], forces=[pulse], parameters=[late])
    instants, times = np.linspace(0.2, 0.8, count), [0, 0.1, 0.9, 1.0]
    swept = mbd.sweep(mechanism, times, {late: instants}, {"v": stone.vx, "x": stone.x}, method="dop853")
    assert not swept.failures
    speed = 0.01 * np.sqrt(np.pi) / 2.0
    np.testing.assert_allclose(swept["v"], np.tile([0, 0, speed, speed], (count, 1)), atol=1e-9)
    np.testing.assert_allclose(swept["x"][:, -1], speed * (1.0 - instants), atol=1e-9)


def test_single_runs():
    """Every case is the run that simulate makes, with reactions."""
    u = mbd.Input("u", value=0.0)
    f = four_bar(0.5, forces=lambda f: [mbd.Gravity(), mbd.Torque("motor", f.crank, u)], inputs=[u])
    torques = np.linspace(0.1, 0.5, 5)
    times = np.linspace(0, 0.5, 11)
    pin = f.mechanism.joints[0].reaction_on(f.crank).force
    outputs = {"angle": f.rocker.phi, "pin": pin}
    swept = mbd.sweep(f.mechanism, times, {u: torques}, outputs, method="dop853")
    for k, torque in enumerate(torques):
        motion = mbd.simulate(f.mechanism, times, inputs={u: torque}, method="dop853")
        np.testing.assert_allclose(swept["angle"][k], motion[f.rocker.phi], atol=1e-8)
        np.testing.assert_allclose(swept["pin"][k], motion[pin], atol=1e-4)


def test_executors():
    """Threads and processes give what this process gives."""
    g, _u, stone, mechanism = fall()
    arguments = mechanism, np.linspace(0, 1, 5), {g: np.linspace(1, 9, 12)}, {"y": stone.y}
    here = mbd.sweep(*arguments, method="dop853")
    for kind in (ThreadPoolExecutor, ProcessPoolExecutor):
        with kind(2) as executor:
            there = mbd.sweep(*arguments, method="dop853", executor=executor, batch=3)
        np.testing.assert_array_equal(there["y"], here["y"])


def test_a_case_that_fails_is_kept_as_such():
    """A force that is not a number after a while."""
    g, u, stone, mechanism = fall()
    swept = mbd.sweep(
        mechanism, [0, 1.0], {g: [1.0, 3.0]}, {"y": stone.y}, inputs={u: mbd.sqrt(1.0 + stone.y)}, method="dop853"
    )
    assert list(swept.failures) == [1]
    assert "at t = 0.8" in swept.failures[1] and "simulate with the values of this case" in swept.failures[1]
    np.testing.assert_allclose(swept["y"][0, -1], -0.5, atol=1e-9)
    assert np.all(np.isnan(swept["y"][1]))


def test_redundant_rows_are_refused_by_name():
    g = mbd.Parameter("g", 9.81)
    body = mbd.Body("body", mass=1.0, inertia=1.0)
    rails = [mbd.Translational(name, mbd.ground.at(0, 0), body.at(0, 0)) for name in ("first", "second")]
    mechanism = mbd.Mechanism(bodies=[body], joints=rails, forces=[mbd.Gravity((g, 0))], parameters=[g])
    with pytest.raises(mbd.SimulationError, match=r"dop853.*first.*second"):
        mbd.sweep(mechanism, [0, 1], {g: [1.0, 2.0]}, [body.x], method="dop853")


@pytest.mark.slow
def test_a_parcel_travels():
    """What goes to a worker is pickled without what was compiled."""
    from mbdcasadi.sensitivity.compiled_run import MotionSetup
    from mbdcasadi.sweeping.starts import StartPath
    from mbdcasadi.sweeping.whole_runs import WholeParcel, times_of

    _g, _u, stone, mechanism = fall()
    setup = MotionSetup(mechanism, "sweep", [0, 1.0], method="dop853")
    parcel = WholeParcel(setup, StartPath(setup), [stone.y], 1)
    case = (
        np.zeros((1, 6)),
        np.array([[2.0]]),
        np.zeros((1, 1)),
        tuple(x[None] for x in times_of(setup, setup.p).arguments),
    )
    found = pickle.loads(pickle.dumps(parcel)).results(*case)
    assert found.reasons == [""] and not found.folds.any()
    np.testing.assert_allclose(found.values[0], [0, -1.0], atol=1e-9)


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_interruption():
    """Ctrl-C ends the cases that run, and leaves what was finished."""
    g, _, stone, mechanism = fall()
    method = mbd.DOP853(max_step=1e-4)
    cases = {g: np.linspace(1, 2, 5000)}
    caught = interrupted(lambda: mbd.sweep(mechanism, [0, 90.0], cases, {"y": stone.y}, method=method))
    assert caught.partial is not None and not np.all(caught.partial.done)
