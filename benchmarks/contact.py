"""Bouncing balls and a stick–slip belt at equal error, beside Exudyn and MuJoCo.

    python benchmarks/contact.py --peers peers/bin/python
    python benchmarks/contact.py --peers peers/bin/python --repeats 5 --readme

Both models have exact solutions (``contact_models.py``). Each method is tightened
until its largest error in position is below the goal; the settings on either side of it
are timed again, all methods in turn in one run, and the time at the goal is read off
between them. The peers run in a process of their own that waits between its turns.
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from machine import describe, into_readme, machine, one_thread

one_thread()

import casadi as ca  # noqa: E402
import numpy as np  # noqa: E402  (after the threads are set)
from contact_models import MODELS, Balls, Belt, G  # noqa: E402
from simulation import at_goal  # noqa: E402

import mbdcasadi as mbd  # noqa: E402

TOLERANCES = [10.0**-k for k in range(3, 12)]
#: Velocities over which friction falls from rest to sliding, m/s: the model error of the smoothed belt.
STRIBECK = [10.0 ** (-k / 2) for k in range(2, 9)]
#: Velocity tolerance as a share of that: with a fifth the peak of friction at rest is missed by a twelfth.
SHARE = 0.01
#: Steps of the peers between two outputs.
STEPS = [2.0**k for k in range(0, 12)]
#: Errors at the tightest setting, in goals, from which no time is extrapolated.
FAR = 5.0
#: Seconds of a run from which no tighter setting is tried.
PATIENCE = 4.0
RESULTS = Path(__file__).parent / "results"


@dataclass(frozen=True)
class Run:
    """Seconds of a run, of its set-up, and its error (m)."""

    seconds: float
    set_up: float
    error: float


@dataclass(frozen=True)
class Method:
    """A way to simulate a model: ``run(setting)``, with settings from loose to tight."""

    name: str
    settings: list[float]
    run: Callable[[float], Run]


# --- mbdcasadi ------------------------------------------------------------------------------------------
def balls(model: Balls) -> tuple[mbd.Mechanism, list[Any], Any]:
    """Free discs above a floor; what is compared is the height of their lowest points."""
    law, floor = mbd.HuntCrossley(model.stiffness, exponent=1.0), mbd.HalfPlane(mbd.ground.at(0, 0))
    bodies, contacts = [], []
    for k, height in enumerate(model.heights):
        pose = (float(k), height + model.radius, 0.0)
        body = mbd.Body(f"ball {k}", mass=model.mass, inertia=0.4 * model.mass * model.radius**2, pose=pose)
        bodies.append(body)
        contacts.append(mbd.Contact(f"floor {k}", mbd.Circle(body.at(0, 0), model.radius), floor, law))
    compared = ca.vertcat(*[body.y - model.radius for body in bodies])
    return mbd.Mechanism(bodies, forces=[mbd.Gravity(), *contacts]), [], compared


def belt(model: Belt, law: Any) -> tuple[mbd.Mechanism, list[Any], Any]:
    """A block on a driven belt; what is compared is its place."""
    band = mbd.Body("belt", mass=5, inertia=1)
    block = mbd.Body("block", mass=model.mass, inertia=0.01)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), band.at(0, 0))
    seat = mbd.Translational("seat", band.at(0, 0), block.at(0, 0))
    spring = mbd.TSDA("spring", mbd.ground.at(-3, 0), block.at(0, 0), stiffness=model.stiffness, free_length=3.0)
    mechanism = mbd.Mechanism(
        [band, block],
        [rail, seat],
        drivers=[mbd.Driver("run", rail.displacement, model.speed * mbd.t)],
        forces=[mbd.Gravity((0, -G)), spring, mbd.JointFriction("rub", seat, law)],
    )
    return mechanism, [block.x == 0, block.vx == model.speed], block.x


def simulated(model: Balls | Belt, build: Callable[[], tuple], **settings: Any) -> Run:
    """One whole call of ``simulate``, the making of integrators included."""
    began = time.perf_counter()
    mechanism, start, compared = build()
    mbd.equations(mechanism)
    made = time.perf_counter()
    motion = mbd.simulate(mechanism, model.times, initial=start, **settings)
    seconds = time.perf_counter() - made
    found = np.asarray(motion[compared]).reshape(model.times.size, -1)
    return Run(seconds, made - began, float(np.max(np.abs(found - model.exact()))))


def own_methods(name: str) -> list[Method]:
    """Methods of mbdcasadi for a model, its default first."""
    model: Any = MODELS[name]

    def by_tolerance(method: str, build: Callable[[], tuple]) -> Callable[[float], Run]:
        return lambda setting: simulated(model, build, method=method, reltol=setting, abstol=setting)

    if name == "balls":
        return [
            Method(f"mbdcasadi, {word}", TOLERANCES, by_tolerance(method, lambda: balls(model)))
            for method, word in (("idas", "default (idas)"), ("erk", "erk"), ("rosenbrock", "rosenbrock"))
        ]
    dry = mbd.DryFriction(model.sliding, model.static)
    found = [
        Method(f"mbdcasadi, DryFriction, {method}", TOLERANCES, by_tolerance(method, lambda: belt(model, dry)))
        for method in ("idas", "rosenbrock")
    ]
    for method in ("idas", "rosenbrock"):

        def smoothed(speed: float, method: str = method) -> Run:
            law = mbd.Stribeck(model.sliding, model.static, speed, SHARE * speed)
            return simulated(model, lambda: belt(model, law), method=method, reltol=1e-6, abstol=1e-6)

        found.append(Method(f"mbdcasadi, Stribeck, {method}", STRIBECK, smoothed))
    return found


# --- peers ------------------------------------------------------------------------------------------------
class Peers:
    """The process of the peers.

    Parameters
    ----------
    python : str or None
        Their interpreter; without it there are none.
    """

    def __init__(self, python: str | None):
        self.names: dict[str, list[str]] = {}
        self.versions: dict[str, str] = {}
        if python is None:
            return
        script = Path(__file__).with_name("contact_peers.py")
        self._process = subprocess.Popen(
            [python, str(script)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        first = self._line()
        self.names, self.versions = first["methods"], first["versions"]

    def _line(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            if line.startswith(">"):
                return json.loads(line[1:])
        raise SystemExit("the process of the peers ended")

    def methods(self, model: str) -> list[Method]:
        """Theirs for a model."""

        def method(name: str) -> Method:
            def run(setting: float) -> Run:
                return self.ask({"model": model, "method": name, "setting": setting})

            return Method(name, STEPS, run)

        return [method(name) for name in self.names.get(model, [])]

    def ask(self, request: dict[str, Any]) -> Run:
        """One run there."""
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(request) + "\n")
        self._process.stdin.flush()
        found = self._line()
        if "failed" in found:
            return Run(0.0, 0.0, math.inf)
        return Run(found["seconds"], found["set_up"], found["error"])


# --- time at the goal ----------------------------------------------------------------------------------------
def attempt(method: Method, setting: float) -> Run:
    """One run; an error of infinity where the method stops."""
    began = time.perf_counter()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", mbd.MechanismWarning)  # loose settings do not resolve the contact
            run = method.run(setting)
    except mbd.MechanismError:
        return Run(time.perf_counter() - began, 0.0, math.inf)
    return run if math.isfinite(run.error) else Run(run.seconds, run.set_up, math.inf)


def bracket(method: Method, goal: float) -> list[float]:
    """Settings on either side of the goal; the last one alone where none is loose enough, none where it fails."""
    tried: list[float] = []
    for setting in method.settings:
        run = attempt(method, setting)
        if math.isfinite(run.error):
            tried.append(setting)
        if run.error <= goal or run.seconds > PATIENCE:
            break
    return tried[-2:]


def compare(name: str, peers: Peers, repeats: int) -> list[dict[str, Any]]:
    """Rows of a model's table: all methods in turn, the least of the repeats."""
    model = MODELS[name]
    methods = [*own_methods(name), *peers.methods(name)]
    settings = {method.name: bracket(method, model.goal) for method in methods}
    runs: dict[str, dict[float, list[Run]]] = {m.name: {s: [] for s in settings[m.name]} for m in methods}
    for _ in range(repeats):
        for method in methods:
            for setting in settings[method.name]:
                runs[method.name][setting].append(attempt(method, setting))
    rows = []
    for method in methods:
        found = runs[method.name]
        seconds = [min(run.seconds for run in repeated) for repeated in found.values()]
        errors = [max(run.error for run in repeated) for repeated in found.values()]
        set_up = min((run.set_up for repeated in found.values() for run in repeated), default=math.nan)
        at, how = at_goal(seconds, errors, model.goal)
        rows.append({"method": method.name, "settings": list(found), "seconds": seconds, "errors": errors})
        rows[-1] |= {"at_goal": at, "how": how, "set_up": set_up}
    return rows


def table(name: str, rows: list[dict[str, Any]]) -> str:
    """Markdown."""
    model, first = MODELS[name], rows[0]["at_goal"]
    lines = [
        f"**{model.title}**, {model.duration:g} s, {model.outputs} outputs; goal {model.goal:.0e} m",
        "",
        "| method | ms per simulated second | ratio | set-up, ms | setting | error there, m |",
        "|---|---:|---:|---:|---:|---:|",
    ]
    marks = {"between": "", "better": "≤ ", "extrapolated": "≈ "}
    for row in rows:
        if row["how"] == "not reached" or (row["how"] == "extrapolated" and row["errors"][-1] > FAR * model.goal):
            lines.append(f"| {row['method']} | – | – | – | – | – |")
            continue
        shown = f"{marks[row['how']]}{1e3 * row['at_goal'] / model.duration:.3g}"
        last = f"{row['settings'][-1]:.3g} | {row['errors'][-1]:.1e}"
        ratio = f"{row['at_goal'] / first:.3g}"
        lines.append(f"| {row['method']} | {shown} | {ratio} | {1e3 * row['set_up']:.3g} | {last} |")
    return "\n".join(lines)


def main(arguments: list[str] | None = None) -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", nargs="*", help=f"of {', '.join(MODELS)}; all without")
    parser.add_argument("--peers", help="Python interpreter that has exudyn and mujoco")
    parser.add_argument("--repeats", type=int, default=3, help="runs of each setting, of which the least counts")
    parser.add_argument("--readme", action="store_true", help="put the tables into README.md")
    parser.add_argument("--output", type=Path, default=RESULTS / "contact.json", help="JSON file")
    chosen = parser.parse_args(arguments)
    names = chosen.models or list(MODELS)
    if unknown := set(names) - set(MODELS):
        parser.error(f"no model {', '.join(sorted(unknown))}")
    peers = Peers(chosen.peers)
    versions = ", ".join(f"{package} {number}" for package, number in peers.versions.items())
    said = [f"{describe()}; the least of {chosen.repeats} repeats.", f"Peers: {versions or 'none'}"]
    results: dict[str, Any] = {"machine": machine(), "peers": peers.versions, "repeats": chosen.repeats}
    for name in names:
        rows = compare(name, peers, chosen.repeats)
        results[name] = {"model": asdict(MODELS[name]), "rows": rows}
        said.append(table(name, rows))
        print(said[-1], flush=True)
    if chosen.readme:
        into_readme("contact", "\n\n".join(said))
    chosen.output.parent.mkdir(parents=True, exist_ok=True)
    chosen.output.write_text(json.dumps(results, indent=1, default=float) + "\n")


if __name__ == "__main__":
    sys.exit(main())
