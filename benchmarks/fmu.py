"""The four-bar as a functional mock-up unit run by FMPy, compared with ``simulate`` of the same mechanism.

    python benchmarks/fmu.py
    python benchmarks/fmu.py --readme

The four-bar of the library runs for ten seconds with 1001 outputs of an angle, a speed, a pin force
and an energy. All ways are timed in turn in one run, at the same tolerances; compiling, deriving
equations and unpacking are not counted. The error is the largest one of the outputs, relative to their
size if that is above one, against DOP853 at 1e-12.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

from machine import describe, into_readme, machine, one_thread

one_thread()

import fmpy  # noqa: E402  (after the threads are set)
import numpy as np  # noqa: E402
from fmpy.simulation import instantiate_fmu  # noqa: E402

import mbdcasadi as mbd  # noqa: E402

TIMES = np.linspace(0, 10, 1001)
TOLERANCE = 1e-8
RESULTS = Path(__file__).parent / "results"


def model() -> tuple[mbd.Mechanism, list[Any], dict[str, Any]]:
    """The mechanism, its start and its outputs."""
    linkage = mbd.library.four_bar().mechanism
    crank, rocker = linkage.bodies[0], linkage.bodies[2]
    bearing = mbd.RSDA("bearing", mbd.ground.at(0, 0), crank.at(0, 0), damping=0.05)
    machine = linkage.replace(forces=[*linkage.forces, bearing])
    foot, pin = linkage.joints[0], linkage.joints[2]
    outputs = {
        "angle": foot.angle,
        "speed": crank.omega,
        "pin force": mbd.norm(pin.reaction_on(rocker).force),
        "energy": 0.5 * mbd.dot(rocker.velocity, rocker.velocity),
    }
    return machine, [crank.phi == 1.0, crank.omega == 10.0], outputs


def ways(folder: Path) -> dict[str, Callable[[], np.ndarray]]:
    """Runs that are timed, by name: each returns the outputs (k, 4)."""
    mechanism, initial, outputs = model()
    path = mbd.export_fmu(mechanism, folder / "unit.fmu", outputs=outputs, initial=initial, kind="both", version=2)
    fmpy.extract(str(path), str(folder / "unit"))
    description = fmpy.read_model_description(str(folder / "unit"))
    units = {
        kind: instantiate_fmu(str(folder / "unit"), description, kind) for kind in ("CoSimulation", "ModelExchange")
    }
    references = [v.valueReference for v in description.modelVariables if v.causality == "output"]

    def in_package(method: str, tolerance: float = TOLERANCE) -> np.ndarray:
        motion = mbd.simulate(mechanism, TIMES, initial=initial, method=method, reltol=tolerance, abstol=tolerance)
        return np.column_stack([motion[e] for e in outputs.values()])

    def by_fmpy(kind: str) -> np.ndarray:
        units[kind].reset()
        found = fmpy.simulate_fmu(
            str(folder / "unit"),
            model_description=description,
            fmu_instance=units[kind],
            fmi_type=kind,
            stop_time=float(TIMES[-1]),
            output_interval=float(TIMES[1]),
            relative_tolerance=TOLERANCE,
            output=list(outputs),
        )
        return np.column_stack([np.interp(TIMES, found["time"], found[name]) for name in outputs])

    def by_hand() -> np.ndarray:
        unit = units["CoSimulation"]
        unit.reset()
        unit.setupExperiment(tolerance=TOLERANCE, startTime=0.0)
        unit.enterInitializationMode()
        unit.exitInitializationMode()
        rows = [unit.getReal(references)]
        for begin, end in pairwise(TIMES):
            unit.doStep(begin, end - begin)
            rows.append(unit.getReal(references))
        return np.array(rows)

    return {
        'simulate, `method="dop853"`': lambda: in_package("dop853"),
        'simulate, `method="idas"`': lambda: in_package("idas"),
        "unit, co-simulation, calls from Python": by_hand,
        "unit, co-simulation, `fmpy.simulate_fmu`": lambda: by_fmpy("CoSimulation"),
        "unit, model exchange, `fmpy.simulate_fmu` (CVODE)": lambda: by_fmpy("ModelExchange"),
        "reference": lambda: in_package("dop853", 1e-12),
    }


def main() -> None:
    """Time all ways in turn, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--repeats", type=int, default=11)
    parser.add_argument("--readme", action="store_true", help="put the table into README.md")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        run = ways(Path(folder))
        reference = run.pop("reference")()
        size = np.maximum(1, np.max(np.abs(reference), axis=0))
        errors = {name: float(np.max(np.abs(way() - reference) / size)) for name, way in run.items()}
        seconds: dict[str, list[float]] = {name: [] for name in run}
        for _ in range(options.repeats):
            for name, way in run.items():
                began = time.perf_counter()
                way()
                seconds[name].append(time.perf_counter() - began)
    least = {name: min(times) for name, times in seconds.items()}
    own = min(value for name, value in least.items() if name.startswith("simulate"))
    lines = ["| way | ms | of the fastest of the package | error |", "|---|---|---|---|"]
    lines += [f"| {name} | {1e3 * least[name]:.1f} | {least[name] / own:.2f} | {errors[name]:.1e} |" for name in run]
    text = "\n".join([*lines, "", describe()])
    print(text)
    content = {"machine": machine(), "seconds": least, "errors": errors}
    (RESULTS / "fmu.json").write_text(json.dumps(content, indent=1) + "\n")
    if options.readme:
        into_readme("fmu", text)


if __name__ == "__main__":
    main()
