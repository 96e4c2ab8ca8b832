"""Ctrl-C in analyses: mbd.Interrupted, with what was computed where there is something."""

from __future__ import annotations

import signal
import sys

import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.equations.numeric import NumericEquations
from mbdcasadi.numerics.console import keyboard_interrupts
from mbdcasadi.statics.path import Follower

K = mbd.Parameter("k", 30.0)
EFFORT = mbd.Input("effort")
BAR = mbd.Body("bar", mass=1, inertia=0.1, pose=(0.5, 0, 0))
PIN = mbd.Revolute("pin", mbd.ground.at(0, 0), BAR.at(-0.5, 0))
SPRING = mbd.RSDA("spring", mbd.ground.at(0, 0), BAR.at(-0.5, 0), stiffness=K)
FORCES = [mbd.Gravity(), SPRING, mbd.Torque("effort", BAR, EFFORT)]
ROD = mbd.Mechanism([BAR], [PIN], forces=FORCES, parameters=[K], inputs=[EFFORT])
DRIVEN = ROD.replace(drivers=[mbd.Driver("turn", BAR.phi, mbd.t)])
TIMES = np.linspace(0, 0.1, 3)

ANALYSES = {
    "simulate": lambda: mbd.simulate(ROD, TIMES),
    "assemble": lambda: mbd.assemble(ROD),
    "equilibrium": lambda: mbd.equilibrium(ROD),
    "equilibrium_path": lambda: mbd.equilibrium_path(ROD, K, 30, 40),
    "kinematics": lambda: mbd.kinematics(DRIVEN, TIMES),
    "inverse_dynamics": lambda: mbd.inverse_dynamics(ROD, TIMES, motion={BAR.phi: mbd.t}, efforts=[EFFORT]),
    "sensitivities": lambda: mbd.sensitivities(ROD, TIMES, [BAR.phi], [K]),
    "cost_function": lambda: mbd.cost_function(ROD, TIMES, [K], terminal_cost=BAR.phi),
    "sweep": lambda: mbd.sweep(ROD, TIMES, {K: [30, 40]}, {"angle": BAR.phi}),
    "identify": lambda: mbd.identify(ROD, TIMES, {BAR.phi: TIMES}, [K]),
}


@pytest.mark.parametrize("analysis", ANALYSES)
def test_every_analysis_raises_interrupted(analysis, monkeypatch):
    own = NumericEquations.__init__

    def interrupted(self, *arguments, **more):
        signal.raise_signal(signal.SIGINT)
        own(self, *arguments, **more)

    monkeypatch.setattr(NumericEquations, "__init__", interrupted)
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(mbd.Interrupted, match=f"{analysis}.*stopped by the user") as caught:
        ANALYSES[analysis]()
    assert caught.value.partial is None or analysis == "sweep"
    assert signal.getsignal(signal.SIGINT) is before


HANGING = ROD.replace(drivers=[])
FROM_STATES = {
    "check": lambda state: mbd.check(HANGING, state),
    "impact": lambda state: mbd.impact(HANGING, state),
    "linearize": lambda state: mbd.linearize(HANGING, state),
}


@pytest.mark.parametrize("analysis", FROM_STATES)
def test_ctrl_c_inside_casadi_raises_interrupted(analysis):
    state = mbd.assemble(HANGING)

    def at_first_call_of_casadi(frame, event, argument):
        if event == "call" and frame.f_code.co_filename.endswith("casadi.py"):
            sys.setprofile(None)
            signal.raise_signal(signal.SIGINT)

    sys.setprofile(at_first_call_of_casadi)
    try:
        with pytest.raises(mbd.Interrupted, match=f"{analysis}: stopped by the user"):
            FROM_STATES[analysis](state)
    finally:
        sys.setprofile(None)


def test_an_optimisation_raises_interrupted(monkeypatch):
    demands = {"initial": [BAR.phi == 0, BAR.omega == 0], "running_cost": EFFORT**2}
    problem = mbd.OptimalControlProblem(ROD, duration=1, **demands)
    own = NumericEquations.__init__

    def nothing(self, *arguments, **more):
        try:  # inside CasADi's conversions Ctrl-C comes back as an error of another kind
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            raise NotImplementedError("wrong number or type of arguments") from None
        own(self, *arguments, **more)

    monkeypatch.setattr(NumericEquations, "__init__", nothing)
    with pytest.raises(mbd.Interrupted, match="stopped by the user"):
        mbd.optimize(problem, intervals=10)


def test_values_of_a_cost_function():
    J = ANALYSES["cost_function"]()
    own = J._run.setup.mechanism

    class Stopping:
        def check_values(self, values):
            signal.raise_signal(signal.SIGINT)
            own.check_values(values)

    J._run.setup.mechanism = Stopping()
    for call in (J, J.gradient, J.value_and_gradient):
        with pytest.raises(mbd.Interrupted, match="cost_function: stopped by the user"):
            call(J.start)


def test_a_path_of_equilibria_keeps_what_it_followed(monkeypatch):
    own, calls = Follower.advance, []

    def advance(self, point, step):
        calls.append(step)
        if len(calls) == 4:
            signal.raise_signal(signal.SIGINT)
        return own(self, point, step)

    monkeypatch.setattr(Follower, "advance", advance)
    with pytest.raises(mbd.Interrupted, match="partial holds") as caught:
        mbd.equilibrium_path(ROD, K, 30, 40)
    path = caught.value.partial
    assert isinstance(path, mbd.EquilibriumPath) and len(path) == 4
    assert np.all(np.diff(path.values) > 0) and path.values[-1] < 40


def test_an_error_of_compiled_code_on_ctrl_c_is_an_interruption():
    def nothing():
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            return None

    with pytest.raises(mbd.Interrupted, match="test: stopped by the user") as caught, keyboard_interrupts("test"):
        nothing().ravel()
    assert caught.value.partial is None
    with pytest.raises(mbd.Interrupted), keyboard_interrupts("test", lambda: 3):
        nothing()
    with pytest.raises(AttributeError), keyboard_interrupts("test"):
        None.ravel()
