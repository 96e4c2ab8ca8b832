"""Time of a simulation at equal error, mbdcasadi and its peers side by side; prints Markdown, writes JSON.

    python benchmarks/simulation.py                       # the default models
    python benchmarks/simulation.py four_bar chain40 --repeats 5
    python benchmarks/simulation.py --own --processor     # methods of the package and SciPy's, on a busy machine
    python benchmarks/simulation.py four_bar chain100 --first     # first runs, in processes of their own
    python benchmarks/simulation.py --readme              # and put the tables into README.md

For each model and method the tolerance (or step size) is tightened until the
largest position error falls below the goal of the model. The two settings on
either side of the goal are then timed again, all methods in turn, and the time
at the goal is read off between them (logarithmically). Of the repeats the
least time counts.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import subprocess
import sys
import tempfile
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from machine import describe, into_readme, machine, one_thread

one_thread()

from models import MODELS, Model  # noqa: E402  (after the threads are set)
from peers import Method, Problem, Run, all_methods, clock, integrators_watched, take_processor_time  # noqa: E402

import mbdcasadi as mbd  # noqa: E402

DEFAULT = ("four_bar", "double_pendulum", "squeezer", "chain10", "chain40", "chain100")
RESULTS = Path(__file__).parent / "results"
#: A method is not tightened further once a run takes this long, s; its time at the goal is then extrapolated.
PATIENCE = 1.5


@dataclass
class Timing:
    """Time of a method at the goal of a model.

    Attributes
    ----------
    method : str
        Its name.
    settings : list of float
        The settings on either side of the goal.
    seconds, errors : list of float
        Least time (s) and largest position error (m) at these.
    at_goal : float
        Time at the goal, s.
    set_up : float
        Longest time to set up, s: that of the first run, where later ones find it done.
    how : {"between", "better", "extrapolated", "not reached"}
        Whether the goal lies between the settings, below the loosest one, beyond the tightest one tried.
    """

    method: str
    settings: list[float]
    seconds: list[float]
    errors: list[float]
    at_goal: float
    set_up: float
    how: str


# --- finding the settings --------------------------------------------------------------------------
def bracket(problem: Problem, method: Method, patience: float = PATIENCE) -> dict[float, list[Run]]:
    """Return the runs at the two settings on either side of the goal; fewer where the loosest will do or none runs."""
    tried: dict[float, list[Run]] = {}
    for setting in method.settings:
        run = attempt(problem, method, setting)
        if not math.isfinite(run.error):
            if run.seconds > patience:
                break
            continue
        tried[setting] = [run]
        if run.error <= problem.model.goal or run.seconds > patience:
            break
    return dict(list(tried.items())[-2:])


def attempt(problem: Problem, method: Method, setting: float) -> Run:
    """One run; an error of infinity where the method stops."""
    began = clock()
    try:
        return method.run(problem, setting)
    except (mbd.MechanismError, RuntimeError, ValueError):
        return Run(clock() - began, 0.0, math.inf)


# --- timing ------------------------------------------------------------------------------------------
def compare(problem: Problem, methods: list[Method], repeats: int, patience: float = PATIENCE) -> list[Timing]:
    """Time every method at the goal, the methods in turn."""
    suited = [method for method in methods if method.suits(problem)]
    runs = {method.name: bracket(problem, method, patience) for method in suited}
    for _ in range(repeats):
        for method in suited:
            for setting, found in runs[method.name].items():
                found.append(attempt(problem, method, setting))
    return [_timing(name, found, problem.model.goal) for name, found in runs.items()]


def _timing(name: str, runs: dict[float, list[Run]], goal: float) -> Timing:
    seconds = [min(run.seconds for run in repeated) for repeated in runs.values()]
    errors = [max(run.error for run in repeated) for repeated in runs.values()]
    set_up = max((run.set_up for repeated in runs.values() for run in repeated), default=0.0)
    reached, how = at_goal(seconds, errors, goal)
    return Timing(name, list(runs), seconds, errors, reached, set_up, how)


def at_goal(seconds: list[float], errors: list[float], goal: float) -> tuple[float, str]:
    """Time at the goal, read off between the settings on either side of it, and how."""
    if not seconds:
        return math.inf, "not reached"
    if len(seconds) == 1:
        return seconds[0], "better" if errors[0] <= goal else "not reached"
    (t0, t1), (e0, e1) = seconds, errors
    if e1 <= goal < e0:
        share = math.log(e0 / goal) / math.log(e0 / e1)
        return t0 * (t1 / t0) ** share, "between"
    if e0 <= goal:
        return t0, "better"
    if e1 > 0.7 * e0 or t1 <= t0:  # it does not converge any further
        return math.inf, "not reached"
    slope = math.log(t1 / t0) / math.log(e0 / e1)
    return t1 * (e1 / goal) ** slope, "extrapolated"


@dataclass
class Build:
    """Time from a model to what is compiled, s: mechanism, equations, assembly, the integrator, the first run."""

    mechanism: float
    equations: float
    assembly: float
    integrator: float
    first_run: float


def build(model: Model, repeats: int) -> Build:
    """Least times of building a model again; the first run is that of two outputs over a thousandth of the span."""
    best: list[float] = []
    for _ in range(repeats):
        marks = [clock()]

        def mark(marks: list[float] = marks) -> None:
            marks.append(clock())

        mechanism = model.mechanism()
        mark()
        mbd.equations(mechanism)
        mark()
        state = mbd.assemble(mechanism, model.start(mechanism))
        mark()
        with integrators_watched() as ledger:
            mbd.simulate(mechanism, [0.0, 1e-3 * model.duration], initial=state, reltol=1e-6, abstol=1e-6)
        mark()
        steps = [after - before for before, after in pairwise(marks)]
        found = [*steps[:3], ledger.making, steps[3] - ledger.making]
        best = [min(a, b) for a, b in zip(best, found, strict=True)] if best else found
    return Build(*best)


# --- first runs ----------------------------------------------------------------------------------------
#: A script as a user has it: import, model, first run, and what later ones take.
_SCRIPT = """
import sys, time
began = [time.perf_counter(), time.process_time()]
sys.path.insert(0, sys.argv[1])
import mbdcasadi as mbd
marks = [time.perf_counter(), time.process_time()]
from models import MODELS
name, method, jit, runs = sys.argv[2], sys.argv[3], sys.argv[4] == "jit", int(sys.argv[5])
model = MODELS[name]()
took = []
mechanism = model.mechanism()
for k in range(runs + 1):
    at = [time.perf_counter(), time.process_time()] if k else marks
    times = model.times[model.times <= 1.0]
    mbd.simulate(mechanism, times, initial=model.start(mechanism), method=method, jit=jit)
    took.append([time.perf_counter() - at[0], time.process_time() - at[1]])
    if k and time.perf_counter() - began[0] > 10.0:
        break
print(marks[0] - began[0], marks[1] - began[1], *took[0], *map(min, zip(*took[1:])))
"""


@dataclass
class First:
    """Seconds of the import, of the first run with its model, and of a later one; on the clock and of processors."""

    name: str
    imports: tuple[float, float]
    first: tuple[float, float]
    later: tuple[float, float]


def first_runs(names: list[str], repeats: int, later: int) -> list[First]:
    """Times of scripts in processes of their own, one simulated second at the default tolerance; least ones."""
    ways = [("idas", "idas", ""), ("dop853, interpreted", "dop853", ""), ("dop853, compiled anew", "dop853", "jit")]
    found = []
    for name in names:
        for way, method, jit in ways:
            runs = []
            for _ in range(repeats):
                with tempfile.TemporaryDirectory() as folder:
                    mbd.simulate(_pendulum(), duration=0.1, method="dop853")  # the engine is built once on a machine
                    cache = {"MBDCASADI_CACHE": _with_engine(Path(folder))} if jit else {}
                    command = [sys.executable, "-c", _SCRIPT, str(Path(__file__).parent), name, method, jit, str(later)]
                    done = subprocess.run(command, env=os.environ | cache, capture_output=True, text=True, check=True)
                runs.append([float(x) for x in done.stdout.split()])
            best = [min(column) for column in zip(*runs, strict=True)]
            pairs = [(best[k], best[k + 1]) for k in (0, 2, 4)]
            found.append(First(f"{name}, {way}", *pairs))
    return found


def _pendulum() -> mbd.Mechanism:
    rod = mbd.Body("rod", mass=1, inertia=1)
    return mbd.Mechanism(bodies=[rod], joints=[mbd.Revolute("pin", mbd.ground.at(0, 0), rod.at(-0.5, 0))])


def _with_engine(folder: Path) -> str:
    """A folder of compiled code that holds the engine alone."""
    from shutil import copy

    from mbdcasadi.integrators.native.build import cache_folder

    for library in cache_folder().glob("engine-*"):
        copy(library, folder)
    return str(folder)


def first_table(rows: list[First]) -> str:
    """Markdown table of the first runs, milliseconds on the clock and of processors."""
    lines = ["| | import, ms | first run with its model, ms | later runs, ms |", "|---|---:|---:|---:|"]
    for row in rows:
        cells = [f"{_short(1e3 * a)} ({_short(1e3 * b)})" for a, b in (row.imports, row.first, row.later)]
        lines.append(f"| {row.name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


# --- the tables ----------------------------------------------------------------------------------------
def summary_table(compared: dict[str, list[Timing]], durations: dict[str, float]) -> str:
    """Markdown table of all models: the default in milliseconds, the other methods as ratios to it."""
    lines = ["| | " + " | ".join(compared) + " |", "|---|" + "---:|" * len(compared)]
    names = list(dict.fromkeys(timing.method for timings in compared.values() for timing in timings))
    for k, name in enumerate(names):
        cells = []
        for model, timings in compared.items():
            found = next((timing.at_goal for timing in timings if timing.method == name), math.inf)
            value = 1e3 * found / durations[model] if k == 0 else found / timings[0].at_goal
            cells.append(_short(value) if math.isfinite(value) else "–")
        label = f"**{name}**, ms per simulated second" if k == 0 else f"{name}, ratio"
        lines.append(f"| {label} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def scipy_table(compared: dict[str, list[Timing]]) -> str:
    """Markdown table of our methods at equal error, as ratios to SciPy's DOP853, which computes states alone."""
    lines = ["| | " + " | ".join(compared) + " |", "|---|" + "---:|" * len(compared)]
    own = [t.method for timings in compared.values() for t in timings if t.method.startswith("mbdcasadi")]
    for name in dict.fromkeys(own):
        cells = []
        for timings in compared.values():
            at_goal = {timing.method: timing.at_goal for timing in timings}
            ratio = at_goal.get(name, math.inf) / at_goal.get("SciPy DOP853", math.inf)
            cells.append(_short(ratio) if math.isfinite(ratio) else "–")
        lines.append(f"| {name.removeprefix('mbdcasadi, ')} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def comparison_table(problem: Problem, timings: list[Timing]) -> str:
    """Markdown table of one model."""
    model = problem.model
    base = timings[0].at_goal
    lines = [
        f"**{model.name}**: {len(model.bodies)} bodies, {len(model.pins)} pins, {model.duration:g} s, "
        f"{model.outputs} outputs; goal {model.goal:.0e} m",
        "",
        "| method | ms per simulated second | ratio | set-up, ms |",
        "|---|---:|---:|---:|",
    ]
    for timing in timings:
        cells = ("–", "–", "–") if timing.how == "not reached" else _cells(timing, model.duration, base)
        lines.append(f"| {timing.method} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _cells(timing: Timing, duration: float, base: float) -> tuple[str, str, str]:
    sign = {"between": "", "better": "≤ ", "extrapolated": "≈ "}[timing.how]
    return (
        f"{sign}{_short(1e3 * timing.at_goal / duration)}",
        _short(timing.at_goal / base) if math.isfinite(base) else "–",
        _short(1e3 * timing.set_up),
    )


def _short(value: float) -> str:
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


def build_table(builds: dict[str, Build]) -> str:
    """Markdown table of the build times."""
    lines = [
        "| model | mechanism | equations | assembly | integrator | first run | together, ms |",
        "|---|---:|---:|---:|---:|---:|---:|",
    ]
    for name, found in builds.items():
        parts = list(asdict(found).values())
        lines.append(f"| {name} | " + " | ".join(_short(1e3 * x) for x in [*parts, sum(parts)]) + " |")
    return "\n".join(lines)


def _finite(value: Any) -> Any:
    """JSON has no infinity."""
    if isinstance(value, dict):
        return {key: _finite(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_finite(entry) for entry in value]
    if isinstance(value, float):
        return float(f"{value:.4g}") if math.isfinite(value) else None
    return value


def read_arguments(arguments: list[str] | None) -> argparse.Namespace:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", nargs="*", default=list(DEFAULT), help=f"of {', '.join(MODELS)}")
    parser.add_argument("--repeats", type=int, default=3, help="runs of each measure, of which the least counts")
    parser.add_argument("--no-jit", action="store_true", help="leave out what takes the C compiler")
    parser.add_argument("--own", action="store_true", help="methods of the package compared with SciPy's DOP853 alone")
    parser.add_argument("--processor", action="store_true", help="seconds of processors, on a machine that does more")
    parser.add_argument("--only", nargs="+", default=[], help="methods whose names contain one of these words")
    parser.add_argument("--patience", type=float, default=PATIENCE, help="longest run that is tightened further, s")
    parser.add_argument("--first", action="store_true", help="first runs in processes of their own, and nothing else")
    parser.add_argument("--readme", action="store_true", help="put the tables into README.md")
    parser.add_argument("--output", type=Path, default=RESULTS / "simulation.json", help="JSON file")
    chosen = parser.parse_args(arguments)
    unknown = [name for name in chosen.models if name not in MODELS]
    if unknown:
        parser.error(f"unknown model {', '.join(unknown)}; known are {', '.join(MODELS)}")
    return chosen


def main(arguments: list[str] | None = None) -> None:
    """Run from the command line."""
    chosen = read_arguments(arguments)
    if chosen.processor:
        take_processor_time()
    if chosen.first:
        print(f"{describe()}\n\n{first_table(first_runs(chosen.models, chosen.repeats, 100))}")
        return
    said: list[str] = []

    def report(text: str) -> None:
        said.append(text)
        print(text + "\n", flush=True)

    seconds = "seconds of processors" if chosen.processor else "seconds on the clock"
    report(f"{describe()}; the least of {chosen.repeats} repeats, {seconds}.")
    builds: dict[str, Build] = {}
    compared: dict[str, list[Timing]] = {}
    durations: dict[str, float] = {}
    results: dict[str, Any] = {}
    for name in chosen.models:
        model = MODELS[name]()
        builds[model.name] = build(model, chosen.repeats)
        problem = Problem(model)
        methods = all_methods(jit=not chosen.no_jit)
        if chosen.own:
            methods = [m for m in methods if m.name.startswith("mbdcasadi") or m.name == "SciPy DOP853"]
        if chosen.only:
            methods = [m for m in methods if any(word in m.name for word in chosen.only)]
        timings = compare(problem, methods, chosen.repeats, chosen.patience)
        compared[model.name], durations[model.name] = timings, model.duration
        report(comparison_table(problem, timings))
        results[name] = {
            "goal": model.goal,
            "duration": model.duration,
            "reference_error": problem.reference_error,
            "build": asdict(builds[model.name]),
            "timings": [asdict(timing) for timing in timings],
        }
    report(scipy_table(compared))
    report(summary_table(compared, durations))
    report(build_table(builds))
    if chosen.readme:
        # the summary first
        into_readme("simulation", "\n\n".join([said[0], said[-2], *said[1:-2], "Build times, ms:", said[-1]]))
    chosen.output.parent.mkdir(parents=True, exist_ok=True)
    content = {"machine": machine(), "repeats": chosen.repeats, "models": results}
    chosen.output.write_text(json.dumps(_finite(content), indent=1) + "\n")


if __name__ == "__main__":
    main()
