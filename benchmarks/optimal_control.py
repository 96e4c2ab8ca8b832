"""Optimal control: the cart-pole beside other packages, a four-bar by size of mesh, inverse dynamics; prints Markdown.

    python benchmarks/optimal_control.py --peers path/to/other/environment/bin/python
    python benchmarks/optimal_control.py four_bar inverse_dynamics --repeats 5
    python benchmarks/optimal_control.py --readme         # and put the tables into README.md

Every package solves the swing-up on meshes from coarse to fine, each in a
process of its own, the packages in turn, and all of it several times; medians
count. They are compared at equal error: the time on the coarsest mesh from
which on the error stays below the goal. Packages that are not installed where
``--peers`` points are left out, and said so.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from typing import Any

from machine import describe, into_readme, machine, one_thread

one_thread()

import numpy as np  # noqa: E402  (after the threads are set)
from models import four_bar as four_bar_model  # noqa: E402
from scaling import POINTS, inverse_dynamics  # noqa: E402
from swing_up import ITERATIONS, METHODS, TOLERANCE, Solve, Stopwatch, ipopt_watched  # noqa: E402

import mbdcasadi as mbd  # noqa: E402

RESULTS = Path(__file__).parent / "results"
PARTS = ("swing_up", "four_bar", "inverse_dynamics")

# --- the swing-up ------------------------------------------------------------------------------------
#: The two good optima, N²s: Pontryagin's conditions as a boundary-value problem in (x, theta), by SciPy's solve_bvp
#: at a tolerance of 1e-9; no limit is active in either.
OPTIMA = (57.9447803, 58.8076675)
#: Goals of the cost error (relative) and of the miss (m, rad and per s) at which the packages are compared.
COST_GOAL, MISS_GOAL = 1e-4, 1e-3
COST_GOALS = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)
#: Meshes from coarse to fine: intervals, or segments for yapss.
MESHES: dict[str, tuple[int, ...]] = {
    "mbdcasadi, degree 3 (default)": (8, 10, 12, 15, 20, 25, 30, 40, 50),
    "mbdcasadi, degree 2": (10, 15, 20, 25, 30, 40, 50, 80, 100),
    "yapss, 10 points": (2, 3, 4, 5, 6, 8, 10, 12),
    "yapss, 5 points": (5, 8, 10, 12, 15, 20, 25, 30),
    "yapss, Radau, 5 points": (5, 8, 10, 12, 15, 20, 25, 30),
    "rockit, shooting, constant force": (25, 50, 100, 200, 400),
    "rockit, shooting, linear force": (15, 25, 40, 50, 60, 80, 100, 150),
    "rockit, collocation, linear force": (15, 25, 30, 40, 50, 80, 100),
    "opty, midpoint": (200, 400, 450, 800, 1600),
    "opty, midpoint, NumPy": (100, 200, 400, 450, 800, 1600),
    "opty, backward Euler": (1600, 6400),
}
#: A mesh that takes longer than this, s, is solved again only if it is where a goal is reached.
PATIENCE = 5.0


class Worker:
    """A process that solves the swing-up in one way, kept between requests."""

    ENDED = "the process ended"

    def __init__(self, python: str):
        self._process = subprocess.Popen(
            [python, "-W", "ignore", str(Path(__file__).with_name("swing_up.py"))],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )

    def ask(self, **request: Any) -> dict[str, Any]:
        """Send a request and wait for its answer."""
        assert self._process.stdin and self._process.stdout
        try:
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()
            line = self._process.stdout.readline()
        except BrokenPipeError:
            line = ""
        return json.loads(line) if line else {"failure": self.ENDED}

    def close(self) -> None:
        """End the process."""
        assert self._process.stdin
        self._process.stdin.close()
        self._process.wait()


@dataclass
class Mesh:
    """Result of a method on one mesh: medians of the repeats, or the reason for its failure.

    Attributes
    ----------
    method : str
        Its name.
    size : int
        Intervals or segments.
    runs : int
        Repeats.
    found : Solve or None
        Medians.
    failure : str
        What it said.
    """

    method: str
    size: int
    runs: int
    found: Solve | None
    failure: str = ""

    @property
    def whole(self) -> float:
        """Build and solve, s."""
        return self.found.build + self.found.solve if self.found else math.inf

    @property
    def optimum(self) -> float:
        """The optimum that is nearest, N²s."""
        cost = self.found.cost if self.found else math.nan
        return min(OPTIMA, key=lambda known: abs(known - cost))

    @property
    def cost_error(self) -> float:
        """Relative error of the cost to the optimum that is nearest."""
        return abs(self.found.cost / self.optimum - 1) if self.found else math.inf

    @property
    def miss(self) -> float:
        """Miss of the final state by the force that was found."""
        return self.found.miss if self.found else math.inf


def at_goal(meshes: Iterable[Mesh], error: Callable[[Mesh], float], goal: float) -> Mesh | None:
    """The coarsest mesh from which on the error stays below the goal; None where the finest does not reach it."""
    chosen = None
    for mesh in meshes:
        if error(mesh) > goal:
            chosen = None
        elif chosen is None:
            chosen = mesh
    return chosen


def compare(peers: str, repeats: int, report: Callable[[str], None]) -> dict[str, list[Mesh]]:
    """Solve the swing-up by every method on every mesh, in turn, ``repeats`` times."""
    workers = {name: Worker(sys.executable if name.startswith("mbdcasadi") else peers) for name in METHODS}
    try:
        for name in list(workers):  # imports and what a first call compiles do not count
            answer = workers[name].ask(method=name, size=MESHES[name][1])
            if answer.get("failure", "").startswith(("ModuleNotFoundError", Worker.ENDED)):
                report(f"{name}: left out ({answer['failure']})")
                workers.pop(name).close()
        runs: dict[tuple[str, int], list[dict[str, Any]]] = {
            (name, size): [] for name in workers for size in MESHES[name]
        }
        for k in range(repeats):
            wanted = _goals(_meshes(runs)) if k else set(runs)
            for (name, size), done in runs.items():
                slow = bool(done) and "build" in done[0] and done[0]["build"] + done[0]["solve"] > PATIENCE
                if not slow or (name, size) in wanted:
                    done.append(workers[name].ask(method=name, size=size))
        return _meshes(runs)
    finally:
        for worker in workers.values():
            worker.close()


def in_fresh_processes(compared: dict[str, list[Mesh]], peers: str, repeats: int) -> dict[str, dict[str, float]]:
    """Imports, build and solve of the fastest method of each package, each run in a process of its own, in turn; s."""
    chosen = [at_goal(meshes, lambda mesh: mesh.cost_error, COST_GOAL) for meshes in compared.values()]
    fastest: dict[str, Mesh] = {}
    for mesh in filter(None, chosen):
        package = mesh.method.split(",")[0]
        if package not in fastest or mesh.whole < fastest[package].whole:
            fastest[package] = mesh
    runs: dict[str, list[dict[str, float]]] = {mesh.method: [] for mesh in fastest.values()}
    for _ in range(repeats):
        for mesh in fastest.values():
            worker = Worker(sys.executable if mesh.method.startswith("mbdcasadi") else peers)
            answer = worker.ask(method=mesh.method, size=mesh.size, imports=True)
            worker.close()
            if "failure" not in answer:
                runs[mesh.method].append(answer)
    return {
        name: {key: median(run[key] for run in done) for key in ("imports", "build", "solve")}
        for name, done in runs.items()
        if done
    }


def fresh_table(found: dict[str, dict[str, float]]) -> str:
    """Markdown table of the runs in fresh processes."""
    lines = [
        "| method | import, ms | build, ms | solve, ms | build and solve, ms | ratio | all, ms | ratio |",
        "|---|" + "---:|" * 7,
    ]
    base = next(iter(found.values()))
    for name, run in found.items():
        two, all_ = (sum(run[key] for key in keys) for keys in (("build", "solve"), ("imports", "build", "solve")))
        cells = [_short(1e3 * run[key]) for key in ("imports", "build", "solve")]
        cells += [_short(1e3 * two), _short(two / (base["build"] + base["solve"]))]
        cells += [_short(1e3 * all_), _short(all_ / sum(base.values()))]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _goals(compared: dict[str, list[Mesh]]) -> set[tuple[str, int]]:
    """The meshes at which packages are compared."""
    found = [at_goal(meshes, lambda m: m.cost_error, COST_GOAL) for meshes in compared.values()]
    found += [at_goal(meshes, lambda m: m.miss, MISS_GOAL) for meshes in compared.values()]
    return {(mesh.method, mesh.size) for mesh in found if mesh}


def _meshes(runs: dict[tuple[str, int], list[dict[str, Any]]]) -> dict[str, list[Mesh]]:
    compared: dict[str, list[Mesh]] = {}
    for (name, size), done in runs.items():
        failures = [answer["failure"] for answer in done if "failure" in answer]
        found = None
        if not failures:
            found = Solve(**{key: median(answer[key] for answer in done) for key in done[0]})
        compared.setdefault(name, []).append(Mesh(name, size, len(done), found, failures[0] if failures else ""))
    return compared


# --- tables of the swing-up ----------------------------------------------------------------------------
def goal_table(compared: dict[str, list[Mesh]], error: Callable[[Mesh], float], goal: float) -> str:
    """Markdown table of the methods at the goal."""
    chosen = {name: at_goal(meshes, error, goal) for name, meshes in compared.items()}
    base = next(iter(chosen.values()))
    lines = [
        "| method | mesh | unknowns | iterations | build, ms | solve, ms | together, ms | ratio | cost, N²s "
        "| optimum | cost error | miss |",
        "|---|" + "---:|" * 11,
    ]
    for name, mesh in chosen.items():
        if mesh is None or mesh.found is None:
            lines.append(f"| {name} |" + " – |" * 11)
            continue
        found = mesh.found
        cells = [
            f"{mesh.size}",
            f"{found.variables:.0f}",
            f"{found.iterations:.0f}",
            *(_short(1e3 * seconds) for seconds in (found.build, found.solve, mesh.whole)),
            _short(mesh.whole / base.whole) if base else "–",
            f"{found.cost:.5f}",
            f"{mesh.optimum:.3f}",
            f"{mesh.cost_error:.1e}",
            f"{mesh.miss:.1e}",
        ]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def precision_table(compared: dict[str, list[Mesh]]) -> str:
    """Markdown table: milliseconds from the statement to the solution, by goal of the cost error."""
    lines = [
        "| method | " + " | ".join(f"{goal:.0e}" for goal in COST_GOALS) + " |",
        "|---|" + "---:|" * len(COST_GOALS),
    ]
    for name, meshes in compared.items():
        found = [at_goal(meshes, lambda m: m.cost_error, goal) for goal in COST_GOALS]
        cells = [f"{_short(1e3 * mesh.whole)} ({mesh.size})" if mesh else "–" for mesh in found]
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def mesh_table(compared: dict[str, list[Mesh]]) -> str:
    """Markdown table of everything."""
    lines = [
        "| method | mesh | iterations | build, ms | solve, ms | cost, N²s | cost error | miss |",
        "|---|" + "---:|" * 7,
    ]
    for name, meshes in compared.items():
        for mesh in meshes:
            found = mesh.found
            if found is None:
                lines.append(f"| {name} | {mesh.size} | {mesh.failure} |" + " – |" * 5)
                continue
            lines.append(
                f"| {name} | {mesh.size} | {found.iterations:.0f} | {_short(1e3 * found.build)} "
                f"| {_short(1e3 * found.solve)} | {found.cost:.6f} | {mesh.cost_error:.1e} | {mesh.miss:.1e} |"
            )
    return "\n".join(lines)


def _short(value: float) -> str:
    return f"{value:.0f}" if value >= 100 else f"{value:.3g}"


# --- the four-bar --------------------------------------------------------------------------------------
#: Crank angle at the start and at the end, rad; duration, s; limit of the torque, N m.
CRANK, TURNED, TIME, TORQUE = 0.5, 0.5 + math.pi, 0.6, 20.0
INTERVALS = (25, 40, 50, 100, 200, 400)
#: Cost of the optimum, N²m²s: Pontryagin's conditions in the one coordinate that the linkage has, by solve_bvp.
FOUR_BAR_OPTIMUM = 0.277377924
#: What is timed.
TIMES = ("build", "solve", "again")


@dataclass
class FourBar:
    """Half a turn of a four-bar from rest to rest on one mesh, medians.

    Attributes
    ----------
    intervals, iterations, variables : int
        Mesh, iterations of IPOPT, unknowns.
    build, solve : float
        Bodies to solver and solver to solution; inside IPOPT, s.
    again : float
        The whole of a second call on the same problem, which finds everything built, s.
    cost : float
        Integral of the squared torque, N²m²s.
    """

    intervals: int
    iterations: int
    variables: int
    build: float
    solve: float
    again: float
    cost: float


def solve_four_bar(intervals: int) -> FourBar:
    """State the problem and solve it, twice."""
    watch = Stopwatch()
    with ipopt_watched(watch):
        torque = mbd.Input("torque", lower=-TORQUE, upper=TORQUE)
        mechanism = four_bar_model().mechanism(motors={0: torque})
        crank = mechanism.bodies[0]
        problem = mbd.OptimalControlProblem(
            mechanism,
            duration=TIME,
            initial=[crank.phi == CRANK, crank.omega == 0],
            final=[crank.phi == TURNED, crank.omega == 0],
            running_cost=torque**2,
        )
        solution = mbd.optimize(problem, intervals=intervals)
        build, solve, _ = watch.stop()
    watch = Stopwatch()
    mbd.optimize(problem, intervals=intervals)
    again = sum(watch.stop()[:2])
    found = solution.statistics
    return FourBar(intervals, found.iterations, found.variables, build, solve, again, float(solution.cost))


def time_four_bar(sizes: Iterable[int], repeats: int) -> list[FourBar]:
    """Medians, the meshes in turn."""
    runs: dict[int, list[FourBar]] = {size: [] for size in sizes}
    solve_four_bar(min(runs))
    for _ in range(repeats):
        for size, done in runs.items():
            done.append(solve_four_bar(size))
    return [
        FourBar(**(asdict(done[0]) | {field: median(getattr(run, field) for run in done) for field in TIMES}))
        for done in runs.values()
    ]


def four_bar_table(found: list[FourBar]) -> str:
    """Markdown table by size of the mesh."""
    lines = [
        "| intervals | unknowns | iterations | build, ms | solve, ms | together, ms | again, ms | cost error |",
        "|---:|" + "---:|" * 7,
    ]
    for run in found:
        times = (run.build, run.solve, run.build + run.solve, run.again)
        lines.append(
            f"| {run.intervals} | {run.variables} | {run.iterations} | "
            + " | ".join(_short(1e3 * seconds) for seconds in times)
            + f" | {abs(run.cost / FOUR_BAR_OPTIMUM - 1):.1e} |"
        )
    if len(found) > 1:
        sizes = np.log([run.intervals for run in found])
        columns = ([run.build for run in found], [run.solve for run in found], [run.build + run.solve for run in found])
        fitted = [f"{np.polyfit(sizes, np.log(column), 1)[0]:.2f}" for column in columns]
        lines.append("| exponent | | | " + " | ".join(fitted) + " | | |")
    return "\n".join(lines)


# --- the command line ------------------------------------------------------------------------------------
def _plain(value: Any) -> Any:
    """JSON has no infinity; times to four digits."""
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, list):
        return [_plain(entry) for entry in value]
    if isinstance(value, float):
        return float(f"{value:.9g}") if math.isfinite(value) else None
    return value


def swing_up_part(chosen: argparse.Namespace, report: Callable[[str], None]) -> dict[str, Any]:
    """Compare, print and return what the JSON file holds."""
    asked = Worker(chosen.peers)
    versions = asked.ask(versions=["yapss", "rockit-meco", "opty", "cyipopt", "sympy", "casadi", "numpy"])
    asked.close()
    report("Peers: " + ", ".join(f"{name} {number}" for name, number in versions.items()))
    compared = compare(chosen.peers, chosen.repeats, report)
    print(mesh_table(compared) + "\n", flush=True)
    fresh = in_fresh_processes(compared, chosen.peers, 2 * chosen.repeats)
    report(f"**Cart-pole swing-up** at a cost error of {COST_GOAL:g}, as a script runs it, in a process of its own:")
    report(fresh_table(fresh))
    report("In a process that has solved it before:")
    report(goal_table(compared, lambda mesh: mesh.cost_error, COST_GOAL))
    report(f"The same at a miss of {MISS_GOAL:g}:")
    report(goal_table(compared, lambda mesh: mesh.miss, MISS_GOAL))
    report("Build and solve, ms, by cost error (mesh):")
    report(precision_table(compared))
    return {
        "optima": OPTIMA,
        "tolerance": TOLERANCE,
        "iterations": ITERATIONS,
        "peers": versions,
        "fresh": fresh,
        "meshes": {name: [asdict(mesh) for mesh in meshes] for name, meshes in compared.items()},
    }


def main(arguments: list[str] | None = None) -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", default=list(PARTS), help=f"of {', '.join(PARTS)}")
    parser.add_argument("--repeats", type=int, default=5, help="runs of each measure, of which the median counts")
    parser.add_argument("--peers", default=sys.executable, help="Python of the environment with yapss, rockit, opty")
    parser.add_argument("--intervals", type=int, nargs="+", default=list(INTERVALS), help="meshes of the four-bar")
    parser.add_argument("--readme", action="store_true", help="put the tables into README.md")
    parser.add_argument("--output", type=Path, default=RESULTS / "optimal_control.json", help="JSON file")
    chosen = parser.parse_args(arguments)
    unknown = [part for part in chosen.parts if part not in PARTS]
    if unknown:
        parser.error(f"unknown part {', '.join(unknown)}; known are {', '.join(PARTS)}")
    said: list[str] = []

    def report(text: str) -> None:
        said.append(text)
        print(text + "\n", flush=True)

    report(f"{describe()}; medians of {chosen.repeats} repeats.")
    results: dict[str, Any] = {}
    if "swing_up" in chosen.parts:
        results["swing_up"] = swing_up_part(chosen, report)
    if "four_bar" in chosen.parts:
        report("**Four-bar**, half a turn from rest to rest:")
        found = time_four_bar(chosen.intervals, chosen.repeats)
        report(four_bar_table(found))
        results["four_bar"] = [asdict(run) for run in found]
    if "inverse_dynamics" in chosen.parts:
        first, least = inverse_dynamics(chosen.repeats)
        report(
            f"**Inverse dynamics** of the four-bar, {POINTS} points: {first:.2f} s the first time, "
            f"{least:.2f} s the least of {chosen.repeats} after it."
        )
        results["inverse_dynamics"] = {"points": POINTS, "first": first, "least": least}
    if chosen.readme:
        into_readme("optimal control", "\n\n".join(said))
    chosen.output.parent.mkdir(parents=True, exist_ok=True)
    content = {"machine": machine(), "repeats": chosen.repeats, **results}
    chosen.output.write_text(json.dumps(_plain(content), indent=1) + "\n")


if __name__ == "__main__":
    main()
