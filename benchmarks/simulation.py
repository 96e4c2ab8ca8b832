"""Time of a simulation at equal error, mbdcasadi and its peers side by side; prints Markdown, writes JSON.

    python benchmarks/simulation.py                       # the default models
    python benchmarks/simulation.py four_bar chain40 --repeats 5
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
import time
from dataclasses import asdict, dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from machine import describe, into_readme, machine, one_thread

one_thread()

from models import MODELS, Model  # noqa: E402  (after the threads are set)
from peers import Method, Problem, Run, all_methods, integrators_watched  # noqa: E402

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
def bracket(problem: Problem, method: Method) -> dict[float, list[Run]]:
    """Return the runs at the two settings on either side of the goal; fewer where the loosest will do or none runs."""
    tried: dict[float, list[Run]] = {}
    for setting in method.settings:
        run = attempt(problem, method, setting)
        if not math.isfinite(run.error):
            if run.seconds > PATIENCE:
                break
            continue
        tried[setting] = [run]
        if run.error <= problem.model.goal or run.seconds > PATIENCE:
            break
    return dict(list(tried.items())[-2:])


def attempt(problem: Problem, method: Method, setting: float) -> Run:
    """One run; an error of infinity where the method stops."""
    began = time.perf_counter()
    try:
        return method.run(problem, setting)
    except (mbd.MechanismError, RuntimeError, ValueError):
        return Run(time.perf_counter() - began, 0.0, math.inf)


# --- timing ------------------------------------------------------------------------------------------
def compare(problem: Problem, methods: list[Method], repeats: int) -> list[Timing]:
    """Time every method at the goal, the methods in turn."""
    suited = [method for method in methods if method.suits(problem)]
    runs = {method.name: bracket(problem, method) for method in suited}
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
        marks = [time.perf_counter()]

        def mark(marks: list[float] = marks) -> None:
            marks.append(time.perf_counter())

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


def main(arguments: list[str] | None = None) -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", nargs="*", default=list(DEFAULT), help=f"of {', '.join(MODELS)}")
    parser.add_argument("--repeats", type=int, default=3, help="runs of each measure, of which the least counts")
    parser.add_argument("--no-jit", action="store_true", help="leave out what takes the C compiler")
    parser.add_argument("--readme", action="store_true", help="put the tables into README.md")
    parser.add_argument("--output", type=Path, default=RESULTS / "simulation.json", help="JSON file")
    chosen = parser.parse_args(arguments)
    unknown = [name for name in chosen.models if name not in MODELS]
    if unknown:
        parser.error(f"unknown model {', '.join(unknown)}; known are {', '.join(MODELS)}")
    said: list[str] = []

    def report(text: str) -> None:
        said.append(text)
        print(text + "\n", flush=True)

    report(f"{describe()}; the least of {chosen.repeats} repeats.")
    builds: dict[str, Build] = {}
    compared: dict[str, list[Timing]] = {}
    durations: dict[str, float] = {}
    results: dict[str, Any] = {}
    for name in chosen.models:
        model = MODELS[name]()
        builds[model.name] = build(model, chosen.repeats)
        problem = Problem(model)
        timings = compare(problem, all_methods(jit=not chosen.no_jit), chosen.repeats)
        compared[model.name], durations[model.name] = timings, model.duration
        report(comparison_table(problem, timings))
        results[name] = {
            "goal": model.goal,
            "duration": model.duration,
            "reference_error": problem.reference_error,
            "build": asdict(builds[model.name]),
            "timings": [asdict(timing) for timing in timings],
        }
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
