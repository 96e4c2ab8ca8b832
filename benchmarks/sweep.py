"""Ten thousand runs of a four-bar: sweeps in C by threads and by processes, compared with loops over peers.

    python benchmarks/sweep.py
    python benchmarks/sweep.py --runs 2000 --readme
    python benchmarks/sweep.py --derivatives

The four-bar of ``models.py`` starts at different speeds of its crank and runs
for a second; kept is the angle of the crank at 51 times. Slow methods run a
part of the cases, spread over all of them. The error is the largest one of
that angle (rad) over a few cases against Runge–Kutta at 1e-12.

With ``--derivatives`` the analyses that differentiate a motion instead: a cost
with its gradient, sensitivities and an identification, by three parameters.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from machine import describe, into_readme, machine, one_thread

one_thread()

import exudyn_parts  # noqa: E402  (after the threads are set)
import numpy as np  # noqa: E402
from models import Model, chain, four_bar  # noqa: E402
from peers import Buffered  # noqa: E402

import mbdcasadi as mbd  # noqa: E402

TIMES = np.linspace(0, 1, 51)
#: Speeds of the crank at the start, rad/s.
SLOWEST, FASTEST = 2.0, 8.0
#: Cases that are compared with the reference.
CHECKED = 8
#: Values of a cost before those that are timed: what pays to compile is compiled by then.
WARM = 150
#: Steps of Exudyn between two outputs.
EXUDYN_STEPS = 40
RESULTS = Path(__file__).parent / "results"


@dataclass
class Row:
    """One method: how many runs it made, seconds and seconds of processors for all, error (rad)."""

    name: str
    runs: int
    seconds: float
    processor: float
    error: float

    @property
    def each(self) -> float:
        """Milliseconds a run."""
        return 1e3 * self.seconds / self.runs


def processor_seconds() -> float:
    """Processor time of this process and of those that it waited for: it hardly depends on other work."""
    used = os.times()
    return used.user + used.system + used.children_user + used.children_system


def linkage() -> SimpleNamespace:
    """The four-bar with the speed of its crank as a parameter."""
    speed = mbd.Parameter("speed", SLOWEST)
    model = four_bar()
    mechanism = model.mechanism().replace(parameters=[speed])
    crank = mechanism.bodies[0]
    return SimpleNamespace(
        model=model,
        mechanism=mechanism,
        crank=crank,
        speed=speed,
        start=[crank.phi == model.bodies[0].pose[2], crank.omega == speed],
    )


def by_sweep(four: SimpleNamespace, speeds: np.ndarray, workers: int, **settings: Any) -> np.ndarray:
    """Our own sweep, alone or with processes; all of it counts: compiling, starts, processes."""
    given = {"cases": {four.speed: speeds}, "outputs": {"phi": four.crank.phi}, "initial": four.start} | settings
    if workers == 1:
        return mbd.sweep(four.mechanism, TIMES, **given)["phi"]
    with ProcessPoolExecutor(workers) as executor:
        return mbd.sweep(four.mechanism, TIMES, executor=executor, **given)["phi"]


def by_simulate(four: SimpleNamespace, speeds: np.ndarray, method: str) -> np.ndarray:
    """A loop over simulate."""
    found = []
    for speed in speeds:
        motion = mbd.simulate(four.mechanism, TIMES, initial=four.start, parameters={four.speed: speed}, method=method)
        found.append(motion[four.crank.phi])
    return np.array(found)


def by_scipy(four: SimpleNamespace, speeds: np.ndarray) -> np.ndarray:
    """A loop over SciPy's DOP853 on the same compiled equations; the starts by assemble."""
    from scipy.integrate import solve_ivp

    forward = Buffered(mbd.equations(four.mechanism).forward_dynamics)
    n, found = four.mechanism.bodies.__len__() * 3, []
    for speed in speeds:
        state = mbd.assemble(four.mechanism, four.start, parameters={four.speed: speed})
        empty, p = np.zeros(0), np.array([speed])

        def rate(t: float, x: np.ndarray, p: np.ndarray = p, empty: np.ndarray = empty) -> np.ndarray:
            return np.r_[x[n:], forward(t, x[:n], x[n:], empty, empty, p)[0]]

        run = solve_ivp(rate, (0, 1), np.r_[state.q, state.v], method="DOP853", t_eval=TIMES, rtol=1e-8, atol=1e-8)
        found.append(run.y[2])
    return np.array(found)


def exudyn_case(values: dict[str, Any]) -> list[float]:
    """One case of Exudyn's parameter variation."""
    import exudyn as exu

    data = values["functionData"]
    state = data["states"][int(values["case"])]
    system, _ = exudyn_parts.planar_system(data["model"], state)
    sensor = exudyn_parts.sensor(system, 0)
    system.Assemble()
    settings = exudyn_parts.settings(TIMES[-1], EXUDYN_STEPS * (TIMES.size - 1), TIMES[1])
    settings.timeIntegration.newton.useModifiedNewton = True
    system.SolveDynamic(settings, solverType=exu.DynamicSolverType.TrapezoidalIndex2, showHints=False)
    return (system.GetSensorStoredData(sensor)[:, 3] + state.q[2]).tolist()


def by_exudyn(four: SimpleNamespace, speeds: np.ndarray, workers: int) -> np.ndarray:
    """Exudyn's own ParameterVariation, which has processes too; the starts by assemble."""
    from exudyn.processing import ParameterVariation

    states = [mbd.assemble(four.mechanism, four.start, parameters={four.speed: s}) for s in speeds]
    states = [SimpleNamespace(q=s.q, v=s.v) for s in states]
    _, values = ParameterVariation(
        exudyn_case,
        {"case": list(range(len(speeds)))},
        parameterFunctionData={"model": four.model, "states": states},
        useMultiProcessing=workers > 1,
        numberOfThreads=workers,
        showProgress=False,
    )
    return np.array(values)


def measure(runs: int) -> list[Row]:
    """All methods, one after the other."""
    four = linkage()
    speeds = np.linspace(SLOWEST, FASTEST, runs)
    checked = np.unique(np.linspace(0, runs - 1, CHECKED).astype(int))
    exact = by_sweep(four, speeds[checked], 1, method="erk", reltol=1e-12, abstol=1e-12)
    rows = []

    def timed(name: str, count: int, method: Callable[[np.ndarray], np.ndarray]) -> None:
        part = np.unique(np.r_[np.linspace(0, runs - 1, count).astype(int), checked])
        began, used = time.perf_counter(), processor_seconds()
        found = method(speeds[part])
        seconds, used = time.perf_counter() - began, processor_seconds() - used
        error = float(np.max(np.abs(found[np.searchsorted(part, checked)] - exact)))
        rows.append(Row(name, part.size, seconds, used, error))
        print(f"{name}: {rows[-1].each:.3g} ms a run, error {error:.1e}", flush=True)

    by_sweep(linkage(), speeds[checked], 1, method="dop853")  # the engine is built once on a machine
    for tolerance in (1e-7, 3e-8, 1e-8):
        given = {"method": "dop853", "reltol": tolerance, "abstol": tolerance}
        name = f"sweep, dop853 at {tolerance:.0e}, threads"
        timed(name, runs, lambda s, given=given: by_sweep(linkage(), s, 1, **given))
    for method in ("erk", "idas"):
        for workers in (1, 2):
            where = "serial" if workers == 1 else "two processes"
            timed(f"sweep, {method}, {where}", runs, lambda s, m=method, w=workers: by_sweep(linkage(), s, w, method=m))
    timed("loop over simulate, erk", runs // 100, lambda s: by_simulate(linkage(), s, "erk"))
    timed("loop over simulate, idas", runs // 100, lambda s: by_simulate(linkage(), s, "idas"))
    timed("loop over SciPy DOP853", runs // 50, lambda s: by_scipy(linkage(), s))
    if find_spec("exudyn") is None:
        print("Exudyn is not installed, and left out")
        return rows
    for workers in (1, 2):
        where = "serial" if workers == 1 else "two processes"
        timed(f"Exudyn ParameterVariation, {where}", runs // 100, lambda s, w=workers: by_exudyn(linkage(), s, w))
    return rows


def table(rows: list[Row]) -> str:
    """The rows in Markdown, with ratios to the sweep with IDAS in this process."""
    base = next(r for r in rows if r.name == "sweep, idas, serial")
    lines = ["| | runs | ms a run | ms of processors | ratio of these | error, rad |", "|---|---:|---:|---:|---:|---:|"]
    for r in rows:
        each = 1e3 * r.processor / r.runs
        ratio = r.processor / r.runs / (base.processor / base.runs)
        lines.append(f"| {r.name} | {r.runs} | {r.each:.3g} | {each:.3g} | {ratio:.3g} | {r.error:.0e} |")
    return "\n".join(lines)


# --- derivatives --------------------------------------------------------------------------------
@dataclass
class Derivatives:
    """Analyses that differentiate a motion of a model by one method; least times of the processor, ms.

    Attributes
    ----------
    first : float
        A cost function and its first value with gradient, of a new mechanism.
    value, gradient : float
        Later values, and values with gradients, at other values of the parameters each.
    sensitivities : float
        Sensitivities at all outputs, repeated.
    identify : float
        Identification of a new mechanism.
    error : float
        Error of the gradient, relative to its largest entry.
    """

    model: str
    method: str
    first: float
    value: float
    gradient: float
    sensitivities: float
    identify: float
    error: float = 0.0


def damped(model: Model, times: np.ndarray) -> SimpleNamespace:
    """A model with gravity, dampers and a spring that are parameters, and its motion with an error as data."""
    gravity, damping, stiffness = mbd.Parameter("g", 9.81), mbd.Parameter("c", 0.01), mbd.Parameter("k", 0.02)
    plain = model.mechanism()
    bodies = plain.bodies
    forces = [mbd.Torque(f"damper of {body.name}", body, -damping * body.omega) for body in bodies]
    forces += [mbd.Gravity((0, -gravity)), mbd.Torque("spring", bodies[2], -stiffness * bodies[2].phi)]
    mechanism = plain.replace(forces=forces, parameters=[gravity, damping, stiffness])
    start, angle = model.start(mechanism), bodies[-1].phi
    seen = mbd.simulate(mechanism, times, initial=start)[angle] + 1e-3 * np.sin(37 * times)
    return SimpleNamespace(
        mechanism=mechanism, wrt=[gravity, damping, stiffness], start=start, angle=angle, seen=seen, times=times
    )


def cost_of(m: SimpleNamespace, method: str, **settings: Any) -> Any:
    """Mean square of the angle, and its value at the end."""
    cost = {"running_cost": m.angle**2, "terminal_cost": m.angle, "initial": m.start}
    return mbd.cost_function(m.mechanism, m.times, m.wrt, **cost, method=method, **settings)


def differentiated(model: Model, times: np.ndarray, methods: tuple[str, ...]) -> list[Derivatives]:
    """All analyses of a model, the methods in turn."""
    random = np.random.default_rng(0)
    exact = cost_of(damped(model, times), "erk", reltol=1e-12, abstol=1e-12)
    reference = exact.gradient(exact.start)

    def least(call: Callable[[], Any], repeats: int) -> float:
        spent = []
        for _ in range(repeats):
            used = time.process_time()  # with a finer resolution, but without the compiler
            call()
            spent.append(time.process_time() - used)
        return 1e3 * min(spent)

    rows, costs = [], {}
    for method in methods:
        m = damped(model, times)
        used = processor_seconds()
        J = costs[method] = cost_of(m, method)
        gradient = J.gradient(J.start)
        first = 1e3 * (processor_seconds() - used)
        row = Derivatives(model.name, method, first, np.inf, np.inf, np.inf, np.inf)
        row.error = float(np.max(np.abs(gradient - reference)) / np.max(np.abs(reference)))
        given = {"initial": m.start, "method": method}
        again = lambda m=m, given=given: mbd.sensitivities(m.mechanism, m.times, [m.angle], m.wrt, **given)  # noqa: E731
        again()
        row.sensitivities = least(again, 5)
        new, wrong = damped(model, times), [9.0, 0.01, 0.026]
        given = {"initial": new.start, "method": method, "parameters": dict(zip(new.wrt, wrong, strict=True))}
        used = processor_seconds()
        mbd.identify(new.mechanism, times, {new.angle: new.seen}, new.wrt, **given)
        row.identify = 1e3 * (processor_seconds() - used)
        rows.append(row)
    for turn in range(WARM + 20):
        for row in rows:
            J = costs[row.method]
            d = J.start * (1 + 1e-4 * random.random(J.start.size))
            spent = [least(partial(call, d * factor), 1) for call, factor in ((J, 1.0), (J.value_and_gradient, 1.0001))]
            if turn >= WARM:
                row.value, row.gradient = min(row.value, spent[0]), min(row.gradient, spent[1])
    return rows


def derivatives() -> list[Derivatives]:
    """All analyses of the four-bar over two seconds and of a chain over one."""
    methods = ("idas", "erk", "dop853")
    rows = differentiated(four_bar(), np.linspace(0, 2, 101), methods)
    return rows + differentiated(chain(10), np.linspace(0, 1, 51), methods)


def table_of_derivatives(rows: list[Derivatives]) -> str:
    """The rows in Markdown."""
    lines = [
        "| | | first, ms | value, ms | with gradient, ms | sensitivities, ms | identify, ms | error of the gradient |",
        "|---|---|---:|---:|---:|---:|---:|---:|",
    ]
    for r in rows:
        times = (r.first, r.value, r.gradient, r.sensitivities, r.identify)
        numbers = " | ".join(f"{time:.3g}" for time in times)
        lines.append(f"| {r.model} | {r.method} | {numbers} | {r.error:.0e} |")
    return "\n".join(lines)


def main() -> None:
    """Measure, print, and keep the numbers."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=10_000)
    parser.add_argument("--readme", action="store_true", help="put the table into README.md")
    parser.add_argument("--derivatives", action="store_true", help="measure derivatives instead of sweeps")
    options = parser.parse_args()
    section = "derivatives" if options.derivatives else "sweep"
    rows: list[Any] = derivatives() if options.derivatives else measure(options.runs)
    text = f"{describe()}\n\n{table_of_derivatives(rows) if options.derivatives else table(rows)}"
    print(text)
    RESULTS.mkdir(exist_ok=True)
    content = machine() | {"rows": [asdict(row) for row in rows]}
    (RESULTS / f"{section}.json").write_text(json.dumps(content, indent=1) + "\n")
    if options.readme:
        into_readme(section, text)


if __name__ == "__main__":
    main()
