"""The arguments that analyses share mean the same in each of them, and what is wrong is refused in the same words."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pytest

import mbdcasadi as mbd

#: Output times, with a start that is not zero.
TIMES = np.linspace(0.5, 1.0, 6)
#: Values of the model itself: motor and brake (N m), stiffness (N m/rad), inertia added to the rod (kg m²).
OWN = {"motor": 0.5, "brake": -0.25, "stiffness": 30.0, "added": 0.1}


def _model() -> SimpleNamespace:
    """A rod on a hinge with a spring, a motor and a brake; and the same rod driven, for what prescribes the motion."""
    motor, brake = mbd.Input("motor", OWN["motor"]), mbd.Input("brake", OWN["brake"])
    stiffness = mbd.Parameter("stiffness", OWN["stiffness"], lower=1.0, upper=100.0)
    added = mbd.Parameter("added", OWN["added"])
    rod = mbd.Body("rod", mass=2, inertia=0.2 + added, pose=(0.5, 0, 0))
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), rod.at(-0.5, 0))
    spring = mbd.RSDA("spring", mbd.ground.at(0, 0), rod.at(-0.5, 0), stiffness=stiffness)
    forces = [spring, mbd.Torque("motor", rod, motor), mbd.Torque("brake", rod, brake)]
    held = {"bodies": [rod], "joints": [hinge], "forces": forces}
    listed = {"inputs": [motor, brake], "parameters": [stiffness, added]}
    free = mbd.Mechanism(**held, **listed)
    driven = mbd.Mechanism(**held, drivers=[mbd.Driver("drive", hinge.angle, 0.2 * mbd.t)], **listed)
    return SimpleNamespace(
        free=free, driven=driven, rod=rod, hinge=hinge, motor=motor, brake=brake, stiffness=stiffness, added=added,
        shown=(motor, brake, stiffness, added),
    )  # fmt: skip


M = _model()


@dataclass(frozen=True)
class Analysis:
    """An analysis: which arguments it takes, and the values of inputs and parameters that it used, by times."""

    takes: frozenset[str]
    used: Callable[..., tuple[np.ndarray, np.ndarray]]


def _of_trajectory(motion: Any) -> tuple[np.ndarray, np.ndarray]:
    return motion.t, np.column_stack([np.broadcast_to(motion[x], motion.t.shape) for x in (*M.shown, M.rod.phi)])


def _of_state(state: Any) -> tuple[np.ndarray, np.ndarray]:
    return np.array([state.t]), np.array([[state[x] for x in (*M.shown, M.rod.phi)]])


def _timed(more: dict[str, Any]) -> Any:
    return more.pop("times", None if "duration" in more else TIMES)


def _simulate(**more: Any) -> Any:
    return _of_trajectory(mbd.simulate(M.free, _timed(more), **more))


def _sensitivities(**more: Any) -> Any:
    outputs = [*M.shown, M.rod.phi]
    found = mbd.sensitivities(M.free, _timed(more), outputs, [M.added], **more)
    return found.t, np.column_stack([found[x] for x in outputs])


def _cost_function(**more: Any) -> Any:
    """Costs know the end alone: what they are given is at the last time, and NaN before."""
    grid = np.asarray(_timed(more), float) if "times" not in more else more.pop("times")
    row = []
    for x in (*M.shown, M.rod.phi):
        cost = mbd.cost_function(M.free, grid, [M.added], terminal_cost=x, **more)
        row.append(cost(cost.start))
    times = np.asarray(grid, float)
    return times, np.vstack([np.full((times.size - 1, len(row)), np.nan), row])


def _sweep(**more: Any) -> Any:
    names = {f"{k}": x for k, x in enumerate((*M.shown, M.rod.phi))}
    value = _value_of(M.added, more)
    found = mbd.sweep(M.free, _timed(more), {M.added: [value]}, names, **more)
    assert not found.failures, found.failures
    return found.t, np.column_stack([found[name][0] for name in names])


def _value_of(parameter: Any, more: dict[str, Any]) -> float:
    """The value that other analyses would use, for the one that must vary a parameter."""
    state = more.get("initial")
    own = state[parameter] if isinstance(state, mbd.State) else parameter.value
    given = more.get("parameters") or {}
    pairs = given.items() if isinstance(given, dict) else given
    try:
        return float(next((value for key, value in pairs if key is parameter), own))
    except (TypeError, ValueError):
        return own


def _identify(**more: Any) -> Any:
    times = _timed(more)
    count = np.size(np.asarray(times, float))
    data = {x: np.zeros(count) for x in (*M.shown, M.rod.phi)}
    with pytest.raises(mbd.IdentificationError) as stopped:
        mbd.identify(M.free, times, data=data, unknowns=[M.added], iterations=0, segments=1, **more)
    fit = stopped.value.partial
    return fit.experiments[0].times, fit.model[0].T


def _assemble(**more: Any) -> Any:
    return _of_state(mbd.assemble(M.free, more.pop("initial", ()), **more))


def _equilibrium(**more: Any) -> Any:
    return _of_state(mbd.equilibrium(M.free, more.pop("initial", ()), **more))


def _equilibrium_path(**more: Any) -> Any:
    """Along a parameter that is not looked at: what the path holds at its last state."""
    path = mbd.equilibrium_path(M.free, M.added, 0.1, 0.2, more.pop("initial", ()), steps=2, **more)
    t, values = _of_state(path.states[-1])
    values[0, 3] = _value_of(M.added, more | {"initial": ()})
    return t, values


def _linearize(**more: Any) -> Any:
    state = more.pop("initial", None)
    state = mbd.assemble(M.free) if state is None else state
    return _of_state(mbd.linearize(M.free, state, **more).state)


def _kinematics(**more: Any) -> Any:
    return _of_trajectory(mbd.kinematics(M.driven, _timed(more), **more))


def _inverse_dynamics(**more: Any) -> Any:
    return _of_trajectory(mbd.inverse_dynamics(M.driven, _timed(more), **more))


def _check(**more: Any) -> Any:
    mbd.check(M.free, more.pop("initial", None), **more)
    return np.zeros(0), np.zeros((0, 5))


RUN = frozenset({"times", "initial", "state", "inputs", "parameters", "method"})
INSTANT = frozenset({"initial", "inputs", "parameters", "t"})
ANALYSES = {
    "simulate": Analysis(RUN | {"duration"}, _simulate),
    "sensitivities": Analysis(RUN, _sensitivities),
    "cost_function": Analysis(RUN, _cost_function),
    "sweep": Analysis(RUN, _sweep),
    "identify": Analysis(RUN, _identify),
    "assemble": Analysis(INSTANT, _assemble),
    "equilibrium": Analysis(INSTANT | {"state"}, _equilibrium),
    "equilibrium_path": Analysis(INSTANT | {"state"}, _equilibrium_path),
    "linearize": Analysis(frozenset({"state", "inputs", "parameters"}), _linearize),
    "kinematics": Analysis(frozenset({"times", "duration", "parameters"}), _kinematics),
    "inverse_dynamics": Analysis(frozenset({"times", "duration", "inputs", "parameters"}), _inverse_dynamics),
    "check": Analysis(frozenset({"state", "parameters"}), _check),
}
#: Analyses over a grid, of which samples can be taken.
TIMED = [name for name, analysis in ANALYSES.items() if "times" in analysis.takes]


def taking(*arguments: str) -> list[str]:
    """Analyses that take all of some arguments; "state" is a state as start."""
    return [name for name, analysis in ANALYSES.items() if set(arguments) <= analysis.takes]


def _carrying(**values: float) -> mbd.State:
    """A consistent state that brings along values of its own."""
    p, u = {M.stiffness: values["stiffness"]}, {M.motor: values["motor"]}
    return mbd.assemble(M.free, [M.rod.phi == 0.2], t=0.5, inputs=u, parameters=p)


def _expected(**values: float) -> np.ndarray:
    return np.array([(OWN | values)[name] for name in OWN])


# --- the same in every form ----------------------------------------------------------------------
FORMS = {
    "nothing": ({}, {}),
    "parameters, a mapping": ({"parameters": {M.stiffness: 40.0}}, {"stiffness": 40.0}),
    "parameters, pairs": ({"parameters": [(M.stiffness, 40.0)]}, {"stiffness": 40.0}),
    "parameters, a numpy number": ({"parameters": {M.stiffness: np.float32(40)}}, {"stiffness": 40.0}),
    "inputs, a mapping": ({"inputs": {M.brake: 0.75}}, {"brake": 0.75}),
    "inputs, pairs": ({"inputs": [(M.brake, 0.75)]}, {"brake": 0.75}),
    "inputs, a constant expression": ({"inputs": {M.brake: ca.SX(0.75)}}, {"brake": 0.75}),
    "inputs, an expression": ({"inputs": {M.brake: 0.025 * M.stiffness}}, {"brake": 0.75}),
    "inputs, of time": ({"inputs": {M.brake: 0.75 + 0 * mbd.t}}, {"brake": 0.75}),
    "inputs, by parameters": (
        {"inputs": {M.brake: 0.025 * M.stiffness}, "parameters": {M.stiffness: 40.0}},
        {"brake": 1.0, "stiffness": 40.0},
    ),
}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("name", ANALYSES)
def test_a_form_means_the_same(name, form):
    """Inputs and parameters that an analysis used are those that were given, in each form, and its own otherwise."""
    arguments, expected = FORMS[form]
    if name == "kinematics" and "inputs" in arguments:
        assert "inputs" not in ANALYSES[name].takes
        return
    if not set(arguments) <= ANALYSES[name].takes:
        assert name == "check"
        return
    _, values = ANALYSES[name].used(**dict(arguments))
    for row in values:
        if not np.isnan(row[0]):
            np.testing.assert_allclose(row[:4], _expected(**expected), atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("name", taking("state", "inputs", "parameters"))
def test_a_state_brings_its_inputs_and_parameters_along(name):
    """Over the model's own values; what the call gives goes before."""
    state = _carrying(stiffness=50.0, motor=2.0)
    used = ANALYSES[name].used
    _, values = used(initial=state)
    np.testing.assert_allclose(values[-1][:4], _expected(stiffness=50.0, motor=2.0), atol=1e-9)
    _, values = used(initial=state, inputs=[(M.motor, 3.0)], parameters={M.stiffness: 60.0})
    np.testing.assert_allclose(values[-1][:4], _expected(stiffness=60.0, motor=3.0), atol=1e-9)
    _, values = used(initial=state, inputs={M.brake: 0.75})
    np.testing.assert_allclose(values[-1][:4], _expected(stiffness=50.0, motor=2.0, brake=0.75), atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("name", taking("times", "initial"))
def test_starts_in_every_form(name):
    """A list, a tuple, one relation and a state give one motion; it is that of a spring with a constant torque."""
    relation, still = M.hinge.angle == 0.3, M.rod.omega == 0.0
    state = mbd.assemble(M.free, [relation, still], t=0.5)
    inertia = 0.2 + OWN["added"] + 2 * 0.5**2
    rest, omega = (OWN["motor"] + OWN["brake"]) / OWN["stiffness"], np.sqrt(OWN["stiffness"] / inertia)
    end = rest + (0.3 - rest) * np.cos(omega * 0.5)
    for start in (
        [relation, still],
        (relation, still),
        relation,
        state,
        mbd.simulate(M.free, TIMES, initial=state).initial,
    ):
        _, values = ANALYSES[name].used(initial=start)
        assert values[-1][4] == pytest.approx(end, abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("name", TIMED)
def test_times_in_every_form(name):
    """A list, a tuple and an array are one grid."""
    grids = [ANALYSES[name].used(times=form)[0] for form in (list(TIMES), tuple(TIMES), TIMES)]
    for grid in grids:
        np.testing.assert_array_equal(grid, TIMES)


@pytest.mark.parametrize("name", taking("duration"))
def test_a_duration_is_an_even_grid(name):
    """201 times from zero."""
    np.testing.assert_allclose(ANALYSES[name].used(duration=2)[0], np.linspace(0, 2, 201))


@pytest.mark.slow
@pytest.mark.parametrize("name", taking("times", "inputs"))
def test_samples_are_linear_in_between(name):
    """Samples on the grid are the values there; the motion between them is that of the straight line."""
    samples = 0.5 + TIMES
    _, values = ANALYSES[name].used(inputs={M.brake: samples})
    _, reference = ANALYSES[name].used(inputs={M.brake: 0.5 + mbd.t})
    shown = ~np.isnan(values[:, 1])
    np.testing.assert_allclose(values[shown, 1], samples[shown], atol=1e-9)
    np.testing.assert_allclose(values[-1], reference[-1], atol=1e-6)


@pytest.mark.parametrize("name", taking("method"))
@pytest.mark.parametrize(
    "form",
    [
        {"method": "erk", "reltol": 1e-10, "abstol": 1e-10},
        {"method": mbd.RungeKutta(1e-10, 1e-10)},
        {"method": mbd.IDAS(1e-10, 1e-10)},
        {"method": "auto"},
    ],
    ids=["name", "object", "other object", "auto"],
)
def test_methods_in_every_form(name, form):
    """By name with tolerances, as an object, and chosen by the motion: one motion."""
    _, values = ANALYSES[name].used(initial=[M.hinge.angle == 0.3], **form)
    _, reference = ANALYSES["simulate"].used(initial=[M.hinge.angle == 0.3])
    assert values[-1][4] == pytest.approx(reference[-1][4], abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("name", [n for n in taking("inputs") if n != "kinematics"])
def test_a_solution_is_taken_at_its_times(name, found=[]):  # noqa: B006  (solved once)
    """The input of an optimal control solution: at one instant its value then, and over a grid its course.

    What differentiates or compiles a motion asks for samples of it instead.
    """
    if not found:
        rest = [M.rod.phi == 0, M.rod.omega == 0]
        rest, turned = [M.rod.phi == 0, M.rod.omega == 0], [M.rod.phi == 0.2, M.rod.omega == 0]
        problem = mbd.OptimalControlProblem(M.free, 1.0, rest, turned, running_cost=M.motor**2 + M.brake**2)
        found.append(mbd.optimize(problem, intervals=4, progress=False))
    course = found[0].inputs[M.motor]
    if name in ("sensitivities", "cost_function", "sweep", "identify"):
        with pytest.raises(mbd.ModelError, match="give samples of them"):
            ANALYSES[name].used(inputs={M.motor: found[0]})
        return
    t, values = ANALYSES[name].used(inputs={M.motor: found[0]})
    np.testing.assert_allclose(values[:, 0], course(t), atol=1e-8)


# --- the same refusals --------------------------------------------------------------------------
FOREIGN, STRANGER = mbd.Input("foreign", 0.0), mbd.Parameter("stranger", 1.0)
BAD = {
    "foreign parameter": ("parameters", {STRANGER: 1.0}, "parameters= holds 'stranger'.*not in the mechanism"),
    "no mapping of parameters": ("parameters", 3, "parameters= takes one {symbol: value} or a list of pairs, got 3"),
    "a list of mappings": ("parameters", [{M.stiffness: 1.0, M.added: 2.0}], "parameters= takes one {symbol: value}"),
    "a parameter that is NaN": ("parameters", {M.stiffness: np.nan}, "parameter 'stiffness': value must be"),
    "a parameter in words": ("parameters", {M.stiffness: "soft"}, "parameter 'stiffness': value must be.*'soft'"),
    "an array for a parameter": ("parameters", {M.stiffness: [1, 2]}, "parameter 'stiffness': value must be"),
    "a parameter twice": ("parameters", [(M.added, 1.0), (M.added, 2.0)], "parameters= contains 'added' twice"),
    "a vector of parameters": (
        "parameters", [(ca.vertcat(M.stiffness, M.added), [1.0, 2.0])],
        "parameters= takes single symbols, got SX\\(\\[stiffness, .*give each of its entries a value",
    ),
    "an input among parameters": ("parameters", {M.brake: 1.0}, "parameters= holds 'brake'.*not in the mechanism"),
    "foreign input": ("inputs", {FOREIGN: 1.0}, "inputs= holds 'foreign'.*not in the mechanism"),
    "no mapping of inputs": ("inputs", 3, "inputs= takes one {symbol: value} or a list of pairs, got 3"),
    "an input that is NaN": ("inputs", {M.brake: np.nan}, "input 'brake': value must be"),
    "an input in words": ("inputs", {M.brake: "much"}, "input 'brake'.*'much'"),
    "an input twice": ("inputs", [(M.brake, 1.0), (M.brake, 2.0)], "inputs= contains 'brake' twice"),
    "a function for an input": ("inputs", {M.brake: lambda t: t}, "a Python function cannot be differentiated"),
    "an expression in accelerations": ("inputs", {M.brake: M.rod.alpha}, "feedback may use time, positions"),
    "a vector for an input": ("inputs", {M.brake: ca.vertcat(mbd.t, mbd.t)}, "the expression must be a scalar"),
    "a foreign symbol in feedback": ("inputs", {M.brake: ca.SX.sym("x")}, "input 'brake': the expression contains"),
    "no conditions": ("initial", 3, "initial|conditions|relation"),
    "a truth value": ("initial", [True], "relation|condition"),
    "a start in accelerations": ("initial", [M.rod.alpha == 1], "a start is fixed by positions, velocities"),
    "a start in foreign symbols": ("initial", [ca.SX.sym("x") == 1], "the mechanism does not have|condition"),
    "contradictory": ("initial", [M.rod.x == 3], "rod.x"),
    "one time": ("times", [0.5], "at least 2 values"),
    "a number of seconds": ("times", 0.5, "times must be a list, got the number 0.5"),
    "falling times": ("times", [0, 2, 1], "times must increase, but times\\[1\\] = 2"),
    "times that are not finite": ("times", [0, np.inf], "times must be finite"),
    "times in words": ("times", "soon", "times must be numbers, got 'soon'"),
    "no times": ("times", None, "give the output times|give either times or duration="),
    "an unknown method": ("method", "rk9", "method must be one of idas.*got 'rk9'"),
    "a method that is none": ("method", 7, "method must be one of idas.*got 7"),
    "a class that is no method": ("method", mbd.Body, "method must be one of idas"),
}  # fmt: skip


def _refusal(name: str, arguments: dict[str, Any]) -> tuple[type, str]:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mbd.MechanismWarning)
        with pytest.raises(mbd.MechanismError) as refused:
            ANALYSES[name].used(**arguments)
    text = re.sub(rf"^{name}: ", "", str(refused.value))
    return type(refused.value), text


def _compare_refusals(names: list[str], arguments: dict[str, Any], pattern: str) -> None:
    refusals = {name: _refusal(name, dict(arguments)) for name in names}
    for name, (_, text) in refusals.items():
        assert re.search(pattern, text), (name, text)
    kinds = {name: kind for name, (kind, _) in refusals.items()}
    assert len(set(kinds.values())) == 1, kinds
    texts = {name: re.sub(r"at t = \S+ s|; for a run .* write .*", "", text) for name, (_, text) in refusals.items()}
    assert len(set(texts.values())) == 1, texts


@pytest.mark.parametrize("case", BAD)
def test_refusals_are_the_same(case):
    """One class of error and one sentence, whatever the analysis."""
    argument, value, pattern = BAD[case]
    names = taking(argument)
    if case == "one time":  # one pose is an answer of what follows no motion
        names = [name for name in names if name not in ("kinematics", "inverse_dynamics")]
    if argument == "times" and isinstance(value, str):  # data come with their times
        names = [name for name in names if name != "identify"]
    if case == "no times":  # some take a duration in place of times
        names = [name for name in names if "duration" not in ANALYSES[name].takes and name != "identify"]
    assert names
    _compare_refusals(names, {argument: value}, pattern)


@pytest.mark.parametrize("value", [0, -1e-6, np.nan, "tight"])
@pytest.mark.parametrize("tolerance", ["reltol", "abstol"])
def test_tolerances_are_refused_alike(tolerance, value):
    """Zero, negative, NaN and words."""
    _compare_refusals(taking("method"), {"method": "idas", tolerance: value}, f"IDAS: {tolerance} must be")


def test_settings_beside_an_object_are_refused_alike():
    """An integrator carries its own."""
    _compare_refusals(taking("method"), {"method": mbd.IDAS(), "reltol": 1e-6}, "reltol= stands beside method=")


def test_samples_need_a_grid():
    """At one instant there is none; over a grid they must be as many as the times."""
    instants = [name for name in taking("inputs") if name not in TIMED]
    _compare_refusals(instants, {"inputs": {M.brake: [1.0, 2.0]}}, "samples need a time grid")
    timed = taking("inputs", "times")
    _compare_refusals(timed, {"inputs": {M.brake: [1.0, 2.0]}}, "2 samples are given for 6 times")
    _compare_refusals(timed, {"inputs": {M.brake: [*TIMES[1:], np.nan]}}, "sample 5 is not finite")


def test_controllers_are_called_by_simulate_alone():
    """Everything else says so."""
    controller = mbd.SampledController(lambda t, state: {M.brake: 0.75}, period=0.1)
    names = [name for name in taking("inputs") if name != "simulate"]
    _compare_refusals(names, {"inputs": controller}, "only simulate calls a SampledController")
    _, values = _simulate(inputs=controller)
    np.testing.assert_allclose(values[:-1, 1], 0.75)


@pytest.mark.parametrize("name", taking("parameters"))
def test_limits_of_parameters_are_reported_alike(name):
    """A value beyond them is used, with a warning that names the line of the call."""
    if name == "sweep":
        with pytest.warns(mbd.MechanismWarning, match="'stiffness' is beyond its limits 1 … 100 in 1 of 1 cases"):
            ANALYSES[name].used(parameters={M.stiffness: 200.0})
        return
    with pytest.warns(mbd.MechanismWarning, match=f"{name}: parameter 'stiffness' = 200 is beyond 1 … 100") as caught:
        ANALYSES[name].used(parameters={M.stiffness: 200.0})
    assert {w.filename for w in caught} == {__file__}


@pytest.mark.parametrize("name", [n for n in taking("state") if not n.startswith("equilibrium")])
def test_a_state_that_breaks_the_constraints(name):
    """Its worst constraint, at its level; a search for an equilibrium may start from any pose."""
    good = mbd.assemble(M.free, t=0.5)
    q = good.q + np.array([0.1, 0, 0])
    bad = mbd.State(M.free, 0.5, q, good.v, good.a, good.z, good.lam, good.inputs, good.parameters)
    kind, text = _refusal(name, {"initial": bad})
    assert kind is mbd.SimulationError and "breaks the constraint hinge.x at position level by 0.1" in text


@pytest.mark.parametrize("value", [np.nan, "soon", None])
def test_the_instant_is_a_number(value):
    """Of what takes one."""
    names = taking("t")
    refusals = {name: _refusal(name, {"t": value}) for name in names}
    assert all(text.startswith("t must be") for _, text in refusals.values()), refusals
    assert len(set(refusals.values())) == 1, refusals


@pytest.mark.parametrize("name", ANALYSES)
def test_the_mechanism_is_one(name, monkeypatch):
    """Anything else is refused by its value."""
    for which in ("free", "driven"):
        monkeypatch.setattr(M, which, "no mechanism")
    if name == "linearize":
        with pytest.raises(mbd.ModelError, match="takes a State"):
            mbd.linearize("no mechanism", 3)
        return
    kind, text = _refusal(name, {})
    assert kind is mbd.ModelError and "expected a Mechanism, got 'no mechanism'" in text
