"""Methods of one's own, as the documentation shows them, against closed forms and other methods."""

from __future__ import annotations

import re

import casadi as ca
import numpy as np
import pytest
from documentation_blocks import DOCS

import mbdcasadi as mbd

G = 9.81


def _from_the_page() -> dict:
    """The classes of the page, by name."""
    text = (DOCS / "extending.md").read_text(encoding="utf-8")
    names: dict = {"mbd": mbd, "np": np, "ca": ca}
    exec("from scipy import integrate", names)
    for code in re.findall(r"^class \w+\(mbd\.SteppingMethod\):\n(?:(?:    .*)?\n)+", text, re.MULTILINE):
        exec(code, names)
    return names


PAGE = _from_the_page()
METHODS = [PAGE["Radau"](1e-9, 1e-9), PAGE["GeneralisedAlpha"](1e-7, 1e-7)]
#: Error of a motion by each, in the unit of what is compared.
ERRORS = [1e-6, 3e-4]
BOTH = pytest.mark.parametrize(("method", "error"), list(zip(METHODS, ERRORS, strict=True)), ids=["radau", "alpha"])


def pendulum(**more):
    arm = mbd.Body("arm", mass=1, inertia=1 / 12, pose=(0.5, 0, 0))
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), arm.at(-0.5, 0))
    return arm, hinge, mbd.Mechanism(bodies=[arm], joints=[hinge], forces=[mbd.Gravity()], **more)


def ball(restitution=0.8):
    body = mbd.Body("ball", mass=0.5, inertia=1e-3, pose=(0, 1, 0))
    floor = mbd.Event("floor", body.y, direction=-1, reset={body.vy: -restitution * body.vy})
    return body, floor, mbd.Mechanism([body], forces=[mbd.Gravity()])


@BOTH
def test_pendulum(method, error):
    """Coordinates against tight steps, energy, and the reaction at the lowest point by hand: 5/2 m g."""
    arm, hinge, mechanism = pendulum()
    times = np.linspace(0, 1.5, 16)
    motion, exact = (
        mbd.simulate(mechanism, times, method=method),
        mbd.simulate(mechanism, times, method=mbd.IDAS(1e-12, 1e-12)),
    )
    np.testing.assert_allclose(motion[arm.phi], exact[arm.phi], atol=error)
    assert np.ptp(motion.energy.total) < 10 * error
    assert motion.statistics.method == method.name and motion.statistics.steps > 50
    lowest = mbd.Event("lowest", arm.phi + np.pi / 2, direction=-1, terminal=True)
    end = mbd.simulate(mechanism, times, method=method, events=[lowest]).final
    assert end[hinge.reaction_on(arm).force][1] == pytest.approx(2.5 * G, abs=1e3 * error)


@BOTH
@pytest.mark.slow
def test_four_bar(method, error):
    """A closed chain: positions against tight steps, and no drift."""
    model = mbd.library.four_bar()
    mechanism = model.mechanism
    times = np.linspace(0, 0.5, 6)
    motion, exact = (mbd.simulate(mechanism, times, method=m) for m in (method, mbd.IDAS(1e-11, 1e-11)))
    for body in mechanism.bodies:
        np.testing.assert_allclose(motion[body.phi], exact[body.phi], atol=5 * error)
    assert motion.drift.position < 1e-9


@BOTH
def test_bouncing_ball(method, error):
    """Impacts by an event with a reset: their times by hand."""
    body, floor, mechanism = ball()
    motion = mbd.simulate(mechanism, duration=1.5, events=[floor], method=method)
    fall = np.sqrt(2 / G)
    expected = [fall, fall + 2 * 0.8 * fall, fall + 2 * (0.8 + 0.64) * fall]
    np.testing.assert_allclose([event.t for event in motion.events], [t for t in expected if t < 1.5], atol=error)
    assert motion[body.y].min() > -1e-9
    assert motion.at(fall + 0.8 * fall)[body.y][0] == pytest.approx(0.64, abs=10 * error)


@BOTH
def test_stick_and_slip(method, error):
    """A block that a drawn spring pulls: it breaks loose at the force by hand, slips and sticks again, as by IDAS."""
    block = mbd.Body("block", mass=1.0, inertia=0.01)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    rub = mbd.JointFriction("rub", guide, mbd.DryFriction(0.2, 0.3))
    pull = mbd.Force("pull", block.at(0, 0), (100 * (0.1 * mbd.t - block.x), 0))
    mechanism = mbd.Mechanism([block], joints=[guide], forces=[mbd.Gravity(), rub, pull])
    motion, exact = (mbd.simulate(mechanism, duration=1.0, method=m) for m in (method, mbd.IDAS(1e-11, 1e-11)))
    assert [event.name for event in motion.events] == [event.name for event in exact.events]
    np.testing.assert_allclose([e.t for e in motion.events], [e.t for e in exact.events], atol=30 * error)
    assert motion.events[0].t == pytest.approx(0.3 * G / 10, abs=1e-6)
    np.testing.assert_allclose(motion[block.x], exact[block.x], atol=error)


def test_order_of_the_generalised_alpha_method():
    """Halving the step divides the error by four."""
    arm, _, mechanism = pendulum()
    exact = mbd.simulate(mechanism, duration=1.0, method=mbd.IDAS(1e-12, 1e-12)).final[arm.phi]
    errors = []
    for step in (1 / 80, 1 / 160, 1 / 320):  # that divide the pieces of the run
        method = PAGE["GeneralisedAlpha"](1.0, 1e-6, max_step=step)
        errors.append(abs(mbd.simulate(mechanism, duration=1.0, method=method).final[arm.phi] - exact))
    np.testing.assert_allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 2.0, atol=0.3)


class Euler(mbd.SteppingMethod):
    """Explicit Euler, of fixed steps: the shortest method, with cubic polynomials inside."""

    name = "euler"

    def steps(self, system, t, y, end):
        for left in range(max(1, int(np.ceil((end - t) / min(system.max_step, 1.0)))), 0, -1):
            h = (end - t) / left
            yield mbd.IntegratorStep(t, t + h, y, y + h * system.rates(t, y))
            t, y = t + h, y + h * system.rates(t, y)


def test_inputs_parameters_and_states():
    """Values that change at outputs, parameters and first-order states reach the method; it is exact for x' = u."""
    state, u, k = mbd.StateVariable("x"), mbd.Input("u"), mbd.Parameter("k", 2.0)
    body = mbd.Body("body", mass=1, inertia=1)
    mechanism = mbd.Mechanism([body], inputs=[u], parameters=[k], states={state: k * u})
    times = np.linspace(0, 1, 6)
    samples = np.array([0.0, 1, 1, -1, 0, 0])
    motion = mbd.simulate(mechanism, times, inputs={u: samples}, method=PAGE["Radau"])
    exact = mbd.simulate(mechanism, times, inputs={u: samples})
    np.testing.assert_allclose(motion[state], exact[state], atol=1e-8)


def test_classes_and_own_settings():
    """A class takes the tolerances of the run, and objects with equal tolerances keep settings of their own."""
    arm, _, mechanism = pendulum()
    coarse, fine = (
        mbd.simulate(mechanism, duration=0.5, method=Euler(max_step=h)).final[arm.phi] for h in (1e-2, 1e-3)
    )
    assert coarse != fine

    class Counting(Euler):
        name = "counting"

        def __init__(self, count, **more):
            self.count = count
            super().__init__(**more)

        def steps(self, system, t, y, end):
            system.max_step = (end - t) / self.count
            return super().steps(system, t, y, end)

    few, many = (mbd.simulate(mechanism, duration=0.5, method=Counting(n)).statistics.steps for n in (1, 7))
    assert many == 7 * few
    by_class = mbd.simulate(mechanism, duration=0.1, method=PAGE["Radau"], reltol=1e-4, abstol=1e-4)
    assert by_class.statistics.steps < mbd.simulate(mechanism, duration=0.1, method=PAGE["Radau"]).statistics.steps


def _steps_of(*parts):
    """A method whose steps are given as shares of the way."""

    class Given(mbd.SteppingMethod):
        name = "given"

        def steps(self, system, t, y, end):
            for first, last in parts:
                yield mbd.IntegratorStep(t + first * (end - t), t + last * (end - t), y, y)

    return Given


@pytest.mark.parametrize(
    ("method", "message"),
    [
        (_steps_of((0, 0.5)), "the steps end at t = .*before"),
        (_steps_of((0, 0.4), (0.5, 1)), "does not lead on from t ="),
        (_steps_of((0, 0.5), (0.5, 1.2)), "does not lead on from t ="),
        (_steps_of((0, 0)), "does not lead on from t ="),
        (_steps_of((0, 1))(max_step=1e-3), "longer than max_step, 0.001 s"),
    ],
)
def test_wrong_steps_are_named(method, message):
    """Steps that leave a gap, go too far or are too long stop the run."""
    _, _, mechanism = pendulum()
    with pytest.raises(mbd.SimulationError, match=message):
        mbd.simulate(mechanism, duration=1.0, method=method)


def test_what_stops_a_method_is_the_cause():
    """The text of its error, the time, and what was computed before."""

    class Stops(Euler):
        name = "stops"

        def steps(self, system, t, y, end):
            for step in super().steps(system, t, y, end):
                if step.t1 > 0.5:
                    raise mbd.SimulationError("no way beyond half a second")
                yield step

    _, _, mechanism = pendulum()
    with pytest.raises(mbd.SimulationError, match=r"stopped at t = 0\.5 s: no way beyond half a second") as caught:
        mbd.simulate(mechanism, duration=1.0, method=Stops(max_step=1e-3))
    assert 0.4 < caught.value.partial.t[-1] <= 0.5
    with pytest.raises(NotImplementedError, match="Empty has no method steps"):
        mbd.simulate(mechanism, duration=1.0, method=type("Empty", (mbd.SteppingMethod,), {"name": "empty"}))


def test_refused_where_a_function_of_casadi_is_needed():
    """Sensitivities and sweeps name the way out; forces by reactions and options are refused too."""
    gravity = mbd.Parameter("g", G)
    body = mbd.Body("body", mass=1, inertia=1)
    mechanism = mbd.Mechanism([body], forces=[mbd.Gravity((0, -gravity))], parameters=[gravity])
    with pytest.raises(mbd.SimulationError, match='"radau" runs in code of its own.*derivatives.*method="idas"'):
        mbd.sensitivities(mechanism, [0, 1], [body.y], [gravity], method=METHODS[0])
    with pytest.raises(mbd.SimulationError, match='"radau" runs in code of its own.*sweeps.*method="idas"'):
        mbd.sweep(mechanism, np.linspace(0, 1, 5), cases={gravity: [1.0, 2.0]}, outputs=[body.y], method=METHODS[0])
    with pytest.raises(mbd.SimulationError, match="takes no options"):
        PAGE["Radau"](options={"order": 3})


def test_a_plugin_that_casadi_does_not_have_is_named():
    """With the class to derive from instead."""
    kind = type("Unknown", (mbd.Integrator,), {"name": "unknown", "plugin": "radau", "solves_algebraic": False})
    with pytest.raises(mbd.SimulationError, match="names plugin 'radau', which is no integrator.*SteppingMethod"):
        mbd.simulate(pendulum()[2], duration=1.0, method=kind)
