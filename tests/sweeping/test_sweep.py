"""Sweeps against single simulations; executors, failures, files."""

from __future__ import annotations

import copy
import os
import pickle
import signal
import subprocess
import sys
import threading
import warnings
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from disk import full_disk
from linkages import G, four_bar, pendulum

import mbdcasadi as mbd
from mbdcasadi.sweeping import jobs, plan
from mbdcasadi.sweeping import sweep as module

TIMES = np.linspace(0, 1, 21)


def swing():
    """Rod of variable length, released at a variable angle, with a torque."""
    length, angle, tau = mbd.Parameter("length", 1.0, lower=0.1), mbd.Parameter("angle", 0.0), mbd.Input("tau")
    rod = mbd.Body("rod", mass=1.0, inertia=length**3 / 12, pose=(0.5, 0, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), rod.at(-length / 2, 0))
    model = mbd.Mechanism(
        bodies=[rod],
        joints=[pin],
        forces=[mbd.Gravity(), mbd.Torque("motor", rod, tau)],
        inputs=[tau],
        parameters=[length, angle],
    )
    outputs = {"angle": rod.phi, "force": pin.reaction_on(rod).force}
    return rod, pin, model, (length, angle, tau), outputs


def cases_of(symbols, count=12):
    generator = np.random.default_rng(2)
    length, angle, tau = symbols
    return {
        length: generator.uniform(0.4, 2.0, count),
        angle: generator.uniform(-3, 3, count),
        tau: generator.uniform(-2, 2, count),
    }


@pytest.mark.slow
@pytest.mark.parametrize("method", ["idas", "erk", "auto"])
def test_every_case_is_what_simulate_finds(method):
    rod, _, model, symbols, outputs = swing()
    released = [rod.phi == symbols[1], rod.omega == 0]
    swept = mbd.sweep(
        model, TIMES, cases_of(symbols), outputs, released, method=method, reltol=1e-10, abstol=1e-10, batch=5
    )
    assert swept["force"].shape == (12, 21, 2) and not swept.failures and np.all(swept.done)
    for k in range(12):
        motion = mbd.simulate(model, TIMES, initial=released, method="erk", reltol=1e-11, abstol=1e-11, **swept.case(k))
        assert swept["angle"][k] == pytest.approx(motion[rod.phi], abs=1e-7)
        assert swept[outputs["force"]][k] == pytest.approx(motion[outputs["force"]], abs=1e-5)


@pytest.mark.slow
def test_threads_and_processes_find_the_same():
    rod, _, model, symbols, outputs = swing()
    given = (model, TIMES, cases_of(symbols), outputs, [rod.phi == symbols[1], rod.omega == 0])
    alone = mbd.sweep(*given)
    for pool in (ThreadPoolExecutor(2), ProcessPoolExecutor(2)):
        with pool as executor:
            together = mbd.sweep(*given, executor=executor, batch=3)
        assert np.array_equal(together["force"], alone["force"])


@pytest.mark.slow
def test_a_dask_cluster_is_one_argument():
    distributed = pytest.importorskip("distributed")
    rod, _, model, symbols, outputs = swing()
    given = (model, TIMES, cases_of(symbols), outputs, [rod.phi == symbols[1], rod.omega == 0])
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        with distributed.Client(cluster) as client:
            swept = mbd.sweep(*given, executor=client.get_executor(), batch=2)
            assert len(client.scheduler_info()["workers"]) == 2
    assert np.array_equal(swept["angle"], mbd.sweep(*given)["angle"])


@pytest.mark.slow
def test_four_bar_keeps_its_branch_over_far_starts():
    angle = mbd.Parameter("angle", 0.8)
    f = four_bar(0.8, forces=[mbd.Gravity()])
    linkage = f.mechanism.replace(parameters=[angle])
    turn = np.linspace(-6, 6, 25)
    # the coupler joint stays on the same side of the line from B to D
    b, c, d = f.crank.at(0.1, 0).position, f.rocker.at(0.2, 0).position, mbd.vertcat(0.55, 0)
    side = (d - b)[0] * (c - b)[1] - (d - b)[1] * (c - b)[0]
    swept = mbd.sweep(linkage, [0, 0.01], {angle: turn}, {"side": side, "crank": f.crank.phi}, [f.crank.phi == angle])
    assert swept["crank"][:, 0] == pytest.approx(turn, abs=1e-9)
    assert np.all(swept["side"][:, 0] > 0)


def test_a_case_that_fails_is_kept_with_its_message():
    rod, _, model, (length, angle, _), outputs = swing()
    cases = {length: [1.0, -0.5, 1.0, 1.0], angle: [0.1, 0.1, 0.2, 0.3]}
    swept = mbd.sweep(model, TIMES, cases, outputs, [rod.phi == angle])
    assert list(swept.failures) == [1] and "body 'rod': inertia must be at least 0" in swept.failures[1]
    assert np.all(np.isnan(swept["angle"][1])) and np.all(np.isfinite(swept["angle"][[0, 2, 3]]))
    assert "1 failed" in repr(swept)


@pytest.mark.slow
def test_an_integrator_that_stops_spoils_no_other_case():
    """A force that grows without bound in finite time for some of the cases."""
    push = mbd.Parameter("push", 1.0)
    cart = mbd.Body("cart", mass=1.0, inertia=1.0)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0))
    blow = mbd.Force("blow", cart.at(0, 0), (push * mbd.exp(cart.x), 0))
    model = mbd.Mechanism(bodies=[cart], joints=[rail], forces=[blow], parameters=[push])
    for method in ("idas", "erk"):
        swept = mbd.sweep(model, TIMES, {push: [0.1, 50.0, 0.2]}, [cart.x], method=method)
        assert list(swept.failures) == [1] and "the integrator stopped" in swept.failures[1]
        # e^x = sec²(sqrt(p / 2) t) for a start from rest at zero
        exact = -2 * np.log(np.cos(np.sqrt(0.1 / 2) * TIMES))
        assert swept[cart.x][0] == pytest.approx(exact, abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["idas", "erk"])
def test_a_long_motion_keeps_its_energy(method):
    """Twenty seconds of an index-1 form drift; brought back onto the constraints now and then, the energy stays."""
    rate = mbd.Parameter("rate", 8.0)
    f = four_bar(0.8)
    turning = f.mechanism.replace(forces=[mbd.Gravity()], parameters=[rate])
    eom = mbd.equations(turning)
    start = [f.crank.phi == 0.8, f.crank.omega == rate]
    times = np.linspace(0, 20, 81)
    swept = mbd.sweep(turning, times, {rate: [8.0, 9.0]}, {"energy": eom.kinetic + eom.potential}, start, method=method)
    assert np.ptp(swept["energy"], axis=1) == pytest.approx(0, abs=2e-5 * np.max(np.abs(swept["energy"])))


@pytest.mark.slow
def test_starts_that_cannot_be_reached_are_told():
    f = four_bar(0.8)
    angle = mbd.Parameter("angle", 1.5)
    linkage = f.mechanism.replace(parameters=[angle])
    there = mbd.assemble(linkage)[f.rocker.phi]
    held = [f.rocker.phi == angle]
    swept = mbd.sweep(linkage, [0, 0.1], {angle: [there + 5, there, there + 0.1]}, [f.crank.phi], held)
    assert list(swept.failures) == [0] and "rocker.phi" in swept.failures[0]
    with pytest.raises(mbd.AssemblyError, match=r"rocker\.phi"):
        mbd.sweep(linkage, [0, 0.1], {angle: [there + 5, there + 6]}, [f.crank.phi], held)


# --- files -----------------------------------------------------------------------------------
def test_an_interrupted_sweep_goes_on_from_its_file(tmp_path, monkeypatch):
    rod, _, model, symbols, outputs = swing()
    given = (model, TIMES, cases_of(symbols), outputs, [rod.phi == symbols[1], rod.omega == 0])
    path, calls, real = tmp_path / "sweep.bin", [], module.run_batch

    def counted(*arguments):
        calls.append(len(arguments[1]))
        if len(calls) == 3:
            raise KeyboardInterrupt
        return real(*arguments)

    monkeypatch.setattr(module, "run_batch", counted)
    with pytest.raises(mbd.Interrupted, match="after 4 of 12 cases") as stopped:
        mbd.sweep(*given, batch=2, file=path)
    assert np.sum(stopped.value.partial.done) == 4
    # what was written half is taken away
    with open(path, "ab") as file:
        file.write(b"\x93NUMPY half a block")
    calls.clear()
    calls += [0, 0, 0]
    swept = mbd.sweep(*given, batch=2, file=path)
    assert sum(calls) == 8
    monkeypatch.undo()
    assert np.array_equal(swept["force"], mbd.sweep(*given)["force"])
    # all is there: nothing is run again
    monkeypatch.setattr(module, "run_batch", None)
    assert np.array_equal(mbd.sweep(*given, file=path)["angle"], swept["angle"])


@pytest.mark.slow
def test_ctrl_c_inside_compiled_code_ends_the_sweep(monkeypatch):
    rod, _, model, symbols, outputs = swing()
    real, calls = module.run_batch, []

    def watched(*arguments):
        calls.append(0)
        if len(calls) == 2:
            threading.Timer(0.02, os.kill, (os.getpid(), signal.SIGINT)).start()
        return real(*arguments)

    monkeypatch.setattr(module, "run_batch", watched)
    cases = cases_of(symbols, 4000)
    with pytest.raises(mbd.Interrupted, match="of 4000 cases") as stopped:
        mbd.sweep(model, TIMES, cases, outputs, [rod.phi == symbols[1]], batch=100)
    partial = stopped.value.partial
    assert 100 <= np.sum(partial.done) < 4000 and not partial.failures


def test_a_file_of_another_sweep_is_refused(tmp_path):
    p = pendulum()
    g = mbd.Parameter("g", G)
    model = p.mechanism.replace(forces=[mbd.Gravity((0, -g))], parameters=[g])
    path = tmp_path / "sweep.bin"
    mbd.sweep(model, TIMES, {g: [1.0, 2.0]}, [p.rod.phi], file=path)
    for change in ({"times": TIMES[:-1]}, {"cases": {g: [1.0, 2.0 + 1e-9]}}, {"outputs": [p.rod.x]}):
        arguments = {"times": TIMES, "cases": {g: [1.0, 2.0]}, "outputs": [p.rod.phi]} | change
        with pytest.raises(mbd.FileError, match="belongs to another sweep"):
            mbd.sweep(model, file=path, **arguments)
    path.write_text("no sweep")
    with pytest.raises(mbd.FileError, match="is not a sweep file"):
        mbd.sweep(model, TIMES, {g: [1.0, 2.0]}, [p.rod.phi], file=path)


@pytest.mark.slow
def test_the_file_is_continued_by_another_process(tmp_path):
    """The mark of a sweep is the same in every process."""
    script = tmp_path / "run.py"
    script.write_text(
        "import numpy as np, sys, mbdcasadi as mbd\n"
        "g = mbd.Parameter('g', 9.81)\n"
        "rod = mbd.Body('rod', mass=1, inertia=1/12, pose=(0.5, 0, 0))\n"
        "pin = mbd.Revolute('pin', mbd.ground.at(0, 0), rod.at(-0.5, 0))\n"
        "model = mbd.Mechanism(bodies=[rod], joints=[pin], forces=[mbd.Gravity((0, -g))], parameters=[g])\n"
        "swept = mbd.sweep(model, [0, 1], {g: np.linspace(1, 9, 5)}, {'phi': rod.phi}, file='s.bin')\n"
        "print(swept['phi'][:, -1].tolist())\n"
    )
    root = Path(__file__).parents[2]
    runs = [
        subprocess.run(
            [sys.executable, str(script)], cwd=tmp_path, env={"PYTHONPATH": str(root)}, capture_output=True, text=True
        )
        for _ in range(2)
    ]
    assert runs[0].returncode == runs[1].returncode == 0, runs[1].stderr
    assert runs[0].stdout == runs[1].stdout


# --- cases and results -----------------------------------------------------------------------
@pytest.mark.slow
def test_xarray_knows_the_cases():
    pytest.importorskip("xarray")
    rod, _, model, (length, angle, _), outputs = swing()
    grid = mbd.full_factorial({length: [0.5, 1.0], angle: [0.0, 0.1, 0.2]})
    table = mbd.sweep(model, TIMES, grid, outputs, [rod.phi == angle]).to_xarray()
    assert table["angle"].dims == ("case", "t") and table["force"].dims == ("case", "t", "axis")
    assert table["angle.value"].values.tolist() == [0.0, 0.1, 0.2] * 2
    assert table["length"].values.tolist() == [0.5] * 3 + [1.0] * 3
    assert float(table["angle"].sel(case=4, t=0)) == pytest.approx(0.1)


@pytest.mark.slow
def test_latin_hypercube_fills_the_box():
    a, b = mbd.Parameter("a", 1.0), mbd.Input("b")
    cases = mbd.latin_hypercube({a: (2, 4), b: (-1, 1)}, 50, seed=1)
    for key, low, high in ((a, 2, 4), (b, -1, 1)):
        # one point in each of fifty strips
        assert np.array_equal(np.sort(np.floor((cases[key] - low) / (high - low) * 50)), np.arange(50))
    again = mbd.latin_hypercube({a: (2, 4), b: (-1, 1)}, 50, seed=1)
    assert np.array_equal(again[a], cases[a])


def test_bad_cases():
    rod, _, model, (length, angle, tau), outputs = swing()

    def refused(text, cases, **more):
        with pytest.raises(mbd.ModelError, match=text):
            mbd.sweep(model, TIMES, cases, outputs, [rod.phi == angle], **more)

    refused("cases= is empty", {})
    refused("'length' has 2, 'angle' has 3", {length: [1, 2], angle: [1, 2, 3]})
    refused("list of finite numbers", {length: [1, np.nan]})
    refused("cases= takes one {parameter: values}, with all", [{length: 1, angle: 2}, {length: 2, angle: 3}])
    refused("Parameter or Input", {rod.phi: [1, 2]})
    refused("'k', which is not in the mechanism", {mbd.Parameter("k", 1.0): [1, 2]})
    refused("leave one out", {tau: [1, 2]}, inputs={tau: mbd.t})
    refused("batch must be", {length: [1, 2]}, batch=0)
    with pytest.raises(mbd.ModelError, match="lower of 'length' must be below upper"):
        mbd.latin_hypercube({length: (2, 1)}, 5)
    with pytest.raises(mbd.ModelError, match="number of cases"):
        mbd.latin_hypercube({length: (1, 2)}, 0)
    swept = mbd.sweep(model, TIMES, {length: [1, 2]}, outputs)
    with pytest.raises(mbd.ModelError, match="not among the outputs: angle, force"):
        swept["phi"]
    with pytest.raises(mbd.ModelError, match="none of index 2"):
        swept.case(2)


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ({"executor": 3}, "executor= takes a concurrent.futures executor"),
        ({"reltol": "a"}, "reltol must be a number"),
        ({"abstol": -1.0}, "abstol must be positive"),
        ({"file": "/no such folder/sweep"}, "cannot be written"),
        ({"file": "/"}, "cannot be written"),
        ({"single": True}, "single numbers only"),
    ],
)
def test_arguments_that_are_wrong_in_kind(given, text):
    g = mbd.Parameter("g", G)
    p = pendulum()
    model = p.mechanism.replace(forces=[mbd.Gravity((0, -g))], parameters=[g])
    values = 9.0 if given.get("single") else [9.0, 10.0]
    more = {key: value for key, value in given.items() if key != "single"}
    with pytest.raises(mbd.MechanismError, match=text):
        mbd.sweep(model, TIMES, {g: values}, [p.rod.phi], **more)


def test_a_sweep_is_pickled_by_names():
    g, push = mbd.Parameter("g", G), mbd.Input("push")
    p = pendulum()
    forces = [mbd.Gravity((0, -g)), mbd.Torque("push", p.rod, push)]
    model = p.mechanism.replace(forces=forces, parameters=[g], inputs=[push])
    swept = mbd.sweep(model, TIMES, {g: [9.0, 10.0], push: [0.0, 1.0]}, [p.rod.phi, p.rod.position])
    back = pickle.loads(pickle.dumps(swept))
    assert back.names == swept.names and back.names[0] == "rod.phi"
    for name in swept.names:
        assert np.array_equal(back[name], swept[name])
    assert np.array_equal(back["rod.phi"], swept[p.rod.phi]) and np.array_equal(back.cases["g"], [9.0, 10.0])
    assert repr(back) == repr(swept) and back.failures == swept.failures and len(back) == 2
    assert back.case(1, model) == swept.case(1) == {"parameters": {g: 10.0}, "inputs": {push: 1.0}}
    assert back.to_xarray().identical(swept.to_xarray())
    with pytest.raises(mbd.ModelError, match="give the mechanism"):
        back.case(1)
    with pytest.raises(mbd.ModelError, match="0 parameters named 'g'"):
        back.case(1, p.mechanism)
    with pytest.raises(mbd.ModelError, match="not among the outputs"):
        back[p.rod.phi]
    twin = copy.deepcopy(swept)
    twin.cases[g][0] = 0.0
    assert swept.cases[g][0] == 9.0 and np.array_equal(twin[p.rod.phi], swept[p.rod.phi])


@pytest.mark.parametrize(
    ("make", "text"),
    [
        (lambda g: mbd.full_factorial({g: ["a"]}), "must be numbers"),
        (lambda g: mbd.full_factorial({g: [np.nan]}), "finite numbers"),
        (lambda g: mbd.full_factorial({g: []}), "one value at least"),
        (lambda g: mbd.full_factorial({"g": [1]}), "got the key 'g'"),
        (lambda g: mbd.full_factorial([(g, [1]), (g, [2])]), "'g' twice"),
        (lambda g: mbd.latin_hypercube({3: (0, 1)}, 3), "got the key 3"),
        (lambda g: mbd.latin_hypercube({g: (0, 1)}, True), "number of cases"),
        (lambda g: mbd.latin_hypercube({g: (0, 1)}, 3, seed="a"), "seed must be"),
        (lambda g: mbd.latin_hypercube([(g, (0, 1)), (g, (0, 2))], 3), "'g' twice"),
    ],
)
def test_helpers_refuse_what_is_no_list_of_cases(make, text):
    with pytest.raises(mbd.ModelError, match=text):
        make(mbd.Parameter("g", G))


# --- times that depend on the case --------------------------------------------------------------
def pushed(force, *parameters):
    """A sled of 1 kg on a level rail under a force along it."""
    sled = mbd.Body("sled", mass=1.0, inertia=1.0)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), sled.at(0, 0))
    push = mbd.Force("push", sled.at(0, 0), (force, 0))
    return sled, mbd.Mechanism(bodies=[sled], joints=[rail], forces=[push], parameters=parameters)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["idas", "erk"])
@pytest.mark.parametrize("shape", ["jump", "ramps"])
def test_a_hundred_cases_of_the_time_of_a_pulse(method, shape):
    """A pulse of 0.1 s between outputs one second apart: each case is stopped at its own times."""
    begin, width = mbd.Parameter("begin", 5.0), 0.1
    if shape == "jump":
        force, impulse = mbd.if_else(mbd.t < begin, 0, mbd.if_else(mbd.t < begin + width, 10, 0)), 1.0
    else:
        rise = mbd.step(mbd.t, begin, 0, begin + width / 4, 10)
        force, impulse = rise - mbd.step(mbd.t, begin + 3 * width / 4, 0, begin + width, 10), 0.75
    sled, model = pushed(force, begin)
    times, cases = np.linspace(0, 10, 11), {begin: np.linspace(0.45, 9.35, 100)}
    swept = mbd.sweep(model, times, cases, {"v": sled.vx}, method=method)
    assert not swept.failures
    over = times > cases[begin][:, None] + width
    before = times < cases[begin][:, None]
    assert swept["v"][over] == pytest.approx(impulse, abs=1e-6) and np.all(np.abs(swept["v"][before]) < 1e-12)


def test_jumps_of_cases_in_threads_and_in_one_go():
    begin, size = mbd.Parameter("begin", 0.5), mbd.Parameter("size", 1.0)
    sled, model = pushed(mbd.if_else(mbd.t < begin, 1.0, -size), begin, size)
    cases = mbd.full_factorial({begin: [0.1, 0.25, 0.5, 0.77], size: [0.0, 2.0]})
    with warnings.catch_warnings():  # what is told of derivatives does not concern a sweep
        warnings.simplefilter("error")
        alone = mbd.sweep(model, TIMES, cases, {"x": sled.x}, method="erk")
    with ThreadPoolExecutor(2) as executor:
        together = mbd.sweep(model, TIMES, cases, {"x": sled.x}, method="erk", executor=executor)
    assert np.array_equal(alone["x"], together["x"])
    for k in range(8):
        late = np.maximum(TIMES - cases[begin][k], 0)
        assert alone["x"][k] == pytest.approx(TIMES**2 / 2 - (1 + cases[size][k]) * late**2 / 2, abs=1e-9)


def test_a_driver_that_jumps_fails_its_case_alone():
    """A prescribed position jumps by the parameter: without a jump the case runs."""
    jump = mbd.Parameter("jump", 0.0)
    sled = mbd.Body("sled", mass=1.0, inertia=1.0)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), sled.at(0, 0))
    drive = mbd.Driver("hoist", sled.x, mbd.t + mbd.if_else(mbd.t > 0.5, jump, 0))
    model = mbd.Mechanism(bodies=[sled], joints=[rail], drivers=[drive], parameters=[jump])
    swept = mbd.sweep(model, TIMES, {jump: [0.0, 0.3]}, {"x": sled.x})
    assert list(swept.failures) == [1] and "hoist" in swept.failures[1] and "0.5" in swept.failures[1]
    assert swept["x"][0] == pytest.approx(TIMES, abs=1e-9)


# --- starts that fail ------------------------------------------------------------------------------
def couplers(lengths):
    """A four-bar whose coupler has a variable length, cases of it, and which of these cannot close."""
    length = mbd.Parameter("length", 0.5)
    a = mbd.Body("a", mass=1, inertia=0.02, pose=(0.1, 0, 0))
    b = mbd.Body("b", mass=1, inertia=0.02, pose=(0.3, 0.2, 0.7))
    c = mbd.Body("c", mass=1, inertia=0.02, pose=(0.5, 0.2, 1.6))
    joints = [
        mbd.Revolute("A", mbd.ground.at(0, 0), a.at(-0.1, 0)),
        mbd.Revolute("B", a.at(0.1, 0), b.at(-length / 2, 0)),
        mbd.Revolute("C", b.at(length / 2, 0), c.at(0.2, 0)),
        mbd.Revolute("D", mbd.ground.at(0.5, 0), c.at(-0.2, 0)),
    ]
    model = mbd.Mechanism(bodies=[a, b, c], joints=joints, forces=[mbd.Gravity()], parameters=[length])
    reach = np.hypot(0.2 * np.cos(0.3) - 0.5, 0.2 * np.sin(0.3))
    lengths = np.asarray(lengths)
    apart = np.flatnonzero((np.abs(lengths - 0.4) >= reach) | (reach >= lengths + 0.4))
    return model, {length: lengths}, {"phi": c.phi}, [a.phi == 0.3, a.omega == 2], apart.tolist()


LENGTHS = [0.5, 1.1, 0.3, 0.9, 0.6, 0.05, 0.45]


@pytest.mark.slow
@pytest.mark.parametrize("pool", [None, ThreadPoolExecutor, ProcessPoolExecutor])
def test_linkages_that_do_not_close_spoil_no_other_case(pool):
    model, cases, outputs, start, apart = couplers(LENGTHS)
    assert apart == [1, 3, 5]
    executor = pool and pool(2)
    swept = mbd.sweep(model, [0, 0.02], cases, outputs, start, executor=executor, batch=4)
    assert sorted(swept.failures) == apart and all("cannot assemble" in text for text in swept.failures.values())
    tip = np.c_[0.5 + 0.4 * np.cos(swept["phi"][:, 0]), 0.4 * np.sin(swept["phi"][:, 0])]
    span = np.hypot(*(tip - [0.2 * np.cos(0.3), 0.2 * np.sin(0.3)]).T)
    good = [0, 2, 4, 6]
    assert span[good] == pytest.approx(np.array(LENGTHS)[good], abs=1e-8)
    if executor:
        executor.shutdown()


@pytest.mark.slow
def test_a_complete_file_assembles_nothing(tmp_path, monkeypatch):
    model, cases, outputs, start, _ = couplers(LENGTHS)
    given = (model, [0, 0.02], cases, outputs, start)
    first = mbd.sweep(*given, file=tmp_path / "sweep.bin")
    monkeypatch.setattr(plan, "MotionSetup", None)
    monkeypatch.setattr(jobs, "assembled_start", None)
    again = mbd.sweep(*given, file=tmp_path / "sweep.bin")
    assert np.array_equal(again["phi"], first["phi"], equal_nan=True) and again.failures == first.failures


@pytest.mark.slow
def test_ctrl_c_while_starts_are_assembled_keeps_what_was_run(monkeypatch):
    model, cases, outputs, start, _ = couplers(LENGTHS)
    real, calls = jobs.assembled_start, []

    def stopped(*arguments):
        calls.append(0)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return real(*arguments)

    monkeypatch.setattr(jobs, "assembled_start", stopped)
    with pytest.raises(mbd.Interrupted, match="of 7 cases") as caught:
        mbd.sweep(model, [0, 0.02], cases, outputs, start, batch=1)
    assert np.sum(caught.value.partial.done) == 3 and list(caught.value.partial.failures) == [1]


def test_a_start_on_another_branch_is_reported_with_its_case():
    """The angle of the rocker asks for the other side of the linkage, past a pose where it is stretched."""
    f = four_bar(0.8)
    angle = mbd.Parameter("angle", 0.0)
    linkage = f.mechanism.replace(parameters=[angle])
    there = mbd.assemble(linkage)
    # the same crank with the coupler's joint mirrored on the line from B to D
    b, d = there[f.crank.at(0.1, 0).position], np.array([0.55, 0])
    c = there[f.rocker.at(0.2, 0).position]
    across = (d - b) / np.linalg.norm(d - b)
    mirrored = b + 2 * across * (across @ (c - b)) - (c - b)
    tilt = np.arctan2(*(mirrored - b)[::-1])
    cases = {angle: [there[f.coupler.phi], tilt]}
    with pytest.warns(mbd.MechanismWarning) as caught:
        swept = mbd.sweep(linkage, [0, 0.01], cases, {"x": f.crank.phi}, [f.coupler.phi == angle])
    texts = [str(w.message) for w in caught if issubclass(w.category, mbd.MechanismWarning)]
    assert not swept.failures and any("case 1" in text and "another branch" in text for text in texts), texts


# --- a disk that is full ------------------------------------------------------------------------------
def test_a_full_disk_keeps_what_was_run(tmp_path):
    pytest.importorskip("resource")
    g = mbd.Parameter("g", G)
    p = pendulum()
    model = p.mechanism.replace(forces=[mbd.Gravity((0, -g))], parameters=[g])
    given = (model, TIMES, {g: np.linspace(1, 9, 40)}, [p.rod.phi])
    path = tmp_path / "sweep.bin"
    with full_disk(4000), pytest.raises(mbd.FileError, match=r"sweep\.bin: the file cannot be written") as caught:
        mbd.sweep(*given, file=path, batch=5)
    partial = caught.value.partial
    assert 5 <= np.sum(partial.done) < 40
    swept = mbd.sweep(*given, file=path, batch=5)  # there is room again: what was written is whole
    done = partial.done
    assert np.all(swept.done) and np.array_equal(swept[p.rod.phi][done], partial[p.rod.phi][done])


@pytest.mark.parametrize("size", [300, 700, 1000])
def test_a_disk_without_room_for_the_first_bytes(tmp_path, size):
    """In the middle of the header, of the first block, or of an array that is shorter than a buffer."""
    pytest.importorskip("resource")
    p, path = pendulum(), tmp_path / "sweep.bin"
    g = mbd.Parameter("g", G)
    given = (p.mechanism.replace(forces=[mbd.Gravity((0, -g))], parameters=[g]), TIMES, {g: [1, 9]}, [p.rod.phi])
    with full_disk(size), pytest.raises(mbd.FileError, match=r"sweep\.bin: the file cannot be written"):
        mbd.sweep(*given, file=path)
    assert not path.exists() or path.stat().st_size < size
    assert np.all(mbd.sweep(*given, file=path).done)


def test_limits_of_parameters_are_reported_once_for_all_cases():
    length = mbd.Parameter("length", 1.0, lower=0.5, upper=2.0)
    rod = mbd.Body("rod", mass=1.0, inertia=1 / 12, pose=(0.5, 0, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), rod.at(-length / 2, 0))
    model = mbd.Mechanism(bodies=[rod], joints=[pin], forces=[mbd.Gravity()], parameters=[length])
    with pytest.warns(
        mbd.MechanismWarning, match=r"'length' is beyond its limits 0\.5 … 2 in 2 of 3 cases \(0, 2\)"
    ) as w:
        mbd.sweep(model, [0, 0.1], {length: [0.4, 1.0, 2.5]}, [rod.phi])
    assert len([x for x in w if "limits" in str(x.message)]) == 1


def test_events_are_refused_with_the_analyses_that_take_them():
    g = mbd.Parameter("g", G)
    p = pendulum()
    model = p.mechanism.replace(forces=[mbd.Gravity((0, -g))], parameters=[g])
    end = mbd.Event("end", p.rod.phi, terminal=True)
    calls = {
        "sweep": lambda: mbd.sweep(model, TIMES, {g: [9.0, 10.0]}, {"phi": p.rod.phi}, events=[end]),
        "cost_function": lambda: mbd.cost_function(model, TIMES, [g], terminal_cost=p.rod.phi, events=[end]),
        "identify": lambda: mbd.identify(model, TIMES, {p.rod.phi: 0 * TIMES}, [g], events=[end]),
    }
    for analysis, call in calls.items():
        with pytest.raises(mbd.ModelError, match=f"{analysis}: events= is not taken here.*simulate"):
            call()
    assert mbd.sweep(model, TIMES, {g: [9.0]}, {"phi": p.rod.phi}, events=[])["phi"].shape == (1, TIMES.size)


def test_masses_of_cases_that_differ_much():
    """One scaling serves all cases: a factor of a million is within it, and more is reported."""
    mass = mbd.Parameter("mass", 1.0, lower=0.0)
    rod = mbd.Body("rod", mass=mass, inertia=mass / 12, pose=(0.5, 0, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), rod.at(-0.5, 0))
    model = mbd.Mechanism(bodies=[rod], joints=[pin], forces=[mbd.Gravity()], parameters=[mass])
    alike = mbd.sweep(model, [0, 0.5], {mass: [1.0, 1e-6]}, {"angle": rod.phi})
    assert alike["angle"][:, -1] == pytest.approx(np.full(2, alike["angle"][0, -1]), abs=1e-6)
    with pytest.warns(mbd.MechanismWarning, match=r"differ by a factor of 1e\+12"):
        mbd.sweep(model, [0, 0.5], {mass: [1.0, 1e-12]}, {"angle": rod.phi})
