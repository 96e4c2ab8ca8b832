"""What runs in C, and what takes its place without a compiler and for operations that are not written as C."""

import casadi as ca
import numpy as np
import pytest
from linkages import pendulum

import mbdcasadi as mbd
from mbdcasadi.integrators.native import build

compiled_only = pytest.mark.skipif(build.compiler() is None, reason="no C compiler")

TIMES = np.linspace(0, 1, 6)
_X = ca.MX.sym("x")
#: A table, which stays a call in the equations.
TABLE = ca.Function(
    "table",
    [_X],
    [ca.interpolant("samples", "bspline", [np.linspace(-4, 4, 17)], np.sin(np.linspace(-4, 4, 17)))(_X)],
    {"never_inline": True},
)


def heavy_pendulum():
    """A pendulum, and the gravity that is its parameter."""
    gravity = mbd.Parameter("gravity", 9.81)
    p = pendulum(forces=lambda rod: [mbd.Force("weight", rod.at(0, 0), (0, -gravity))], parameters=[gravity])
    return p.mechanism, p.rod, gravity


def sled_by_a_table():
    """A mass that a table pulls back, from 1 m on."""
    stiffness, sled = mbd.Parameter("stiffness", 4.0), mbd.Body("sled", mass=1, inertia=1)
    pull = mbd.Force("pull", sled.at(0, 0), (-stiffness * TABLE(sled.x), 0))
    return mbd.Mechanism([sled], forces=[pull], parameters=[stiffness]), sled, stiffness


def analyses(method):
    """Calls of every analysis that takes an integrator, each with the angle at the end."""
    mechanism, rod, gravity = heavy_pendulum()
    samples = {rod.phi: mbd.simulate(mechanism, TIMES)[rod.phi]}
    return {
        "simulate": lambda: mbd.simulate(mechanism, TIMES, method=method)[rod.phi][-1],
        "sweep": lambda: mbd.sweep(mechanism, TIMES, {gravity: [9.81]}, {"phi": rod.phi}, method=method)["phi"][0, -1],
        "sensitivities": lambda: mbd.sensitivities(mechanism, TIMES, [rod.phi], [gravity], method=method)[rod.phi][-1],
        "cost_function": lambda: mbd.cost_function(mechanism, TIMES, [gravity], terminal_cost=rod.phi, method=method)(
            [9.81]
        ),
        "identify": lambda: mbd.identify(mechanism, TIMES, samples, [gravity], method=method).trajectory[rod.phi][-1],
    }, samples[rod.phi][-1]


@pytest.mark.parametrize("analysis", ["simulate", "sweep", "sensitivities", "cost_function", "identify"])
def test_without_a_compiler_dop853_is_refused_and_auto_takes_another(analysis, monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler")
    with pytest.raises(
        mbd.SimulationError,
        match=r"\"dop853\" runs in C alone.*'no-such-compiler'.*install gcc.*\$CC.*method=\"erk\" or \"idas\"",
    ):
        analyses("dop853")[0][analysis]()
    calls, expected = analyses("auto")
    assert calls[analysis]() == pytest.approx(expected, abs=1e-6)


def test_a_compiler_that_fails_is_as_good_as_none(monkeypatch, tmp_path):
    monkeypatch.setenv("MBDCASADI_CACHE", str(tmp_path))
    monkeypatch.setenv("CC", "false")
    if build.compiler() is None:
        pytest.skip("no command false")
    with pytest.raises(mbd.SimulationError, match=r'"dop853" runs in C alone, and the compiler false failed.*"idas"'):
        analyses("dop853")[0]["simulate"]()
    calls, expected = analyses("auto")
    assert calls["simulate"]() == pytest.approx(expected, abs=1e-6)


@compiled_only
def test_calls_in_equations_are_refused_and_auto_takes_another_method():
    model, sled, stiffness = sled_by_a_table()
    given = {"initial": [sled.x == 1]}
    runs = {
        "simulate": lambda method: mbd.simulate(model, TIMES, method=method, **given)[sled.x],
        "sweep": lambda method: mbd.sweep(model, TIMES, {stiffness: [4.0]}, [sled.x], method=method, **given)[sled.x][
            0
        ],
        "sensitivities": lambda method: mbd.sensitivities(model, TIMES, [sled.x], [stiffness], method=method, **given)[
            sled.x
        ],
    }
    expected = runs["simulate"]("idas")
    for run in runs.values():
        with pytest.raises(mbd.SimulationError, match=r'"dop853".*\'call\' is not written as C.*"erk" or "idas"'):
            run("dop853")
        np.testing.assert_allclose(run("auto"), expected, atol=1e-6)


@compiled_only
def test_calls_in_events_and_outputs_are_refused_and_auto_takes_another_method():
    mechanism, rod, gravity = heavy_pendulum()
    event = mbd.Event("crossing", TABLE(rod.phi) + 0.5)
    runs = {
        "simulate": lambda method: mbd.simulate(mechanism, TIMES, events=[event], method=method).events[0].t,
        "sweep": lambda method: mbd.sweep(mechanism, TIMES, {gravity: [9.81]}, [TABLE(rod.phi)], method=method),
    }
    for run in runs.values():
        with pytest.raises(mbd.SimulationError, match=r'"dop853".*\'call\' is not written as C'):
            run("dop853")
    assert runs["simulate"]("auto") == pytest.approx(runs["simulate"]("idas"), abs=1e-6)
    assert runs["sweep"]("auto").notes == [] and not runs["sweep"]("auto").failures
