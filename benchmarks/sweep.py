"""Ten thousand runs of a four-bar: sweeps in C by threads and by processes, compared with loops over peers.

    python benchmarks/sweep.py
    python benchmarks/sweep.py --runs 2000 --readme

The four-bar of ``models.py`` starts at different speeds of its crank and runs
for a second; kept is the angle of the crank at 51 times. Slow methods run a
part of the cases, spread over all of them. The error is the largest one of
that angle (rad) over a few cases against Runge–Kutta at 1e-12.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from machine import describe, into_readme, machine, one_thread

one_thread()

import exudyn_parts  # noqa: E402  (after the threads are set)
import numpy as np  # noqa: E402
from models import four_bar  # noqa: E402
from peers import Buffered  # noqa: E402

import mbdcasadi as mbd  # noqa: E402

TIMES = np.linspace(0, 1, 51)
#: Speeds of the crank at the start, rad/s.
SLOWEST, FASTEST = 2.0, 8.0
#: Cases that are compared with the reference.
CHECKED = 8
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


def main() -> None:
    """Measure, print, and keep the numbers."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=10_000)
    parser.add_argument("--readme", action="store_true", help="put the table into README.md")
    options = parser.parse_args()
    rows = measure(options.runs)
    text = f"{describe()}\n\n{table(rows)}"
    print(text)
    RESULTS.mkdir(exist_ok=True)
    content = machine() | {"rows": [asdict(row) for row in rows]}
    (RESULTS / "sweep.json").write_text(json.dumps(content, indent=1) + "\n")
    if options.readme:
        into_readme("sweep", text)


if __name__ == "__main__":
    main()
