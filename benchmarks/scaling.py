"""How the cost grows with the size of the model; inverse dynamics of many points; the time of the import.

    python benchmarks/scaling.py
    python benchmarks/scaling.py --links 10 40 100 --repeats 5

Open chains of equal links are built and simulated for a short while; the cost
of one step of the integrator and the time to build are fitted by a power of
the number of links. Of the repeats the least time counts.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from dataclasses import asdict, dataclass
from pathlib import Path

from machine import describe, into_readme, machine, one_thread

one_thread()

import numpy as np  # noqa: E402  (after the threads are set)
from models import chain, four_bar  # noqa: E402
from peers import Ledger, integrators_watched  # noqa: E402

import mbdcasadi as mbd  # noqa: E402

LINKS = (10, 40, 100, 200, 500)
#: The exponent is fitted from this many links on: below it calls cost more than what is computed.
FITTED_FROM = 40
#: Simulated time, s, and tolerance of the chains.
SPAN, TOLERANCE = 0.05, 1e-6
POINTS = 100_000
RESULTS = Path(__file__).parent / "results"


@dataclass
class Size:
    """Least times of one chain, s.

    Attributes
    ----------
    links : int
        Number of links.
    build : float
        Mechanism, equations of motion.
    assembly : float
        Consistent start, with the check of its rank.
    making : dict of str to float
        Making the integrator, by method.
    step : dict of str to float
        One step inside the integrator, by method.
    outputs : dict of str to float
        All that simulate does beside, by method: projection, accelerations, multipliers of 21 outputs in 20 chunks.
    """

    links: int
    build: float
    assembly: float
    making: dict[str, float]
    step: dict[str, float]
    outputs: dict[str, float]


def measure(links: int, repeats: int, methods: tuple[str, ...] = ("idas", "erk")) -> Size:
    """Time a chain."""
    build, assembly = np.inf, np.inf
    making, step, outputs = ({method: np.inf for method in methods} for _ in range(3))
    model = chain(links, duration=SPAN)
    times = np.linspace(0, SPAN, 21)
    for _ in range(repeats):
        began = time.perf_counter()
        mechanism = model.mechanism()
        mbd.equations(mechanism)
        build = min(build, time.perf_counter() - began)
        began = time.perf_counter()
        state = mbd.assemble(mechanism)
        assembly = min(assembly, time.perf_counter() - began)
        for method in methods:
            ledger, whole = _simulated(mechanism, state, times, method)
            making[method] = min(making[method], ledger.making)
            step[method] = min(step[method], ledger.running / ledger.steps)
            outputs[method] = min(outputs[method], whole - ledger.running - ledger.making)
    return Size(links, build, assembly, making, step, outputs)


def _simulated(mechanism: mbd.Mechanism, state: mbd.State, times: np.ndarray, method: str) -> tuple[Ledger, float]:
    began = time.perf_counter()
    with integrators_watched() as ledger:
        mbd.simulate(mechanism, times, initial=state, method=method, reltol=TOLERANCE, abstol=TOLERANCE)
    return ledger, time.perf_counter() - began


def exponent(sizes: list[Size], values: list[float]) -> float:
    """Exponent of the power of the number of links that fits best."""
    links = np.array([size.links for size in sizes])
    kept = links >= FITTED_FROM if np.sum(links >= FITTED_FROM) > 1 else links > 0
    return float(np.polyfit(np.log(links[kept]), np.log(np.array(values)[kept]), 1)[0])


def scaling_table(sizes: list[Size]) -> str:
    """Markdown table of the chains, with exponents."""
    columns: list[tuple[str, float, list[float]]] = [
        ("build, ms", 1e3, [size.build for size in sizes]),
        ("assembly, ms", 1e3, [size.assembly for size in sizes]),
    ]
    for method in sizes[0].step:
        columns += [
            (f"{method}: making, ms", 1e3, [size.making[method] for size in sizes]),
            (f"{method}: one step, µs", 1e6, [size.step[method] for size in sizes]),
            (f"{method}: outputs, ms", 1e3, [size.outputs[method] for size in sizes]),
        ]
    lines = ["| links | " + " | ".join(title for title, _, _ in columns) + " |", "|---:|" + "---:|" * len(columns)]
    for k, size in enumerate(sizes):
        lines.append(
            f"| {size.links} | " + " | ".join(f"{scale * values[k]:.3g}" for _, scale, values in columns) + " |"
        )
    if len(sizes) > 1:
        fitted = [f"{exponent(sizes, values):.2f}" for _, _, values in columns]
        lines.append("| exponent | " + " | ".join(fitted) + " |")
    return "\n".join(lines)


# --- inverse dynamics --------------------------------------------------------------------------------
def inverse_dynamics(repeats: int, points: int = POINTS) -> tuple[float, float]:
    """Seconds of the inverse dynamics of a driven four-bar, the first call and the least of those after it."""
    mechanism = four_bar().mechanism(
        drivers=lambda bodies: [mbd.Driver("speed", bodies[0].phi, 0.5 + 2 * np.pi * mbd.t)]
    )
    times = np.linspace(0, 10, points)
    seconds = []
    for _ in range(repeats + 1):
        began = time.perf_counter()
        mbd.inverse_dynamics(mechanism, times)
        seconds.append(time.perf_counter() - began)
    return seconds[0], min(seconds[1:])


# --- import --------------------------------------------------------------------------------------------
def import_times(repeats: int) -> dict[str, float]:
    """Least seconds that a fresh interpreter takes to import packages."""
    code = "import time; began = time.perf_counter(); import {}; print(time.perf_counter() - began)"
    best = {"numpy": np.inf, "casadi": np.inf, "mbdcasadi": np.inf}
    for _ in range(repeats):
        for name in best:
            done = subprocess.run([sys.executable, "-c", code.format(name)], capture_output=True, text=True, check=True)
            best[name] = min(best[name], float(done.stdout))
    return best


def main(arguments: list[str] | None = None) -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--links", type=int, nargs="+", default=list(LINKS), help="numbers of links")
    parser.add_argument("--repeats", type=int, default=3, help="runs of each measure, of which the least counts")
    parser.add_argument("--readme", action="store_true", help="put the table into README.md")
    parser.add_argument("--output", type=Path, default=RESULTS / "scaling.json", help="JSON file")
    chosen = parser.parse_args(arguments)
    said = [f"{describe()}; the least of {chosen.repeats} repeats."]
    sizes = [measure(links, chosen.repeats) for links in chosen.links]
    said.append(scaling_table(sizes))
    first, again = inverse_dynamics(chosen.repeats)
    said.append(f"Inverse dynamics of the four-bar, {POINTS} points: {again:.2f} s ({first:.2f} s the first time).")
    imports = import_times(max(chosen.repeats, 3))
    said.append("Import: " + ", ".join(f"{name} {seconds:.2f} s" for name, seconds in imports.items()) + ".")
    print("\n\n".join(said))
    if chosen.readme:
        into_readme("scaling", "\n\n".join(said))
    content = {
        "machine": machine(),
        "repeats": chosen.repeats,
        "sizes": [asdict(size) for size in sizes],
        "inverse_dynamics": {"points": POINTS, "first": first, "seconds": again},
        "import": imports,
    }
    chosen.output.parent.mkdir(parents=True, exist_ok=True)
    chosen.output.write_text(json.dumps(content, indent=1, default=float) + "\n")


if __name__ == "__main__":
    main()
