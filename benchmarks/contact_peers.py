"""Exudyn and MuJoCo on the models of ``contact_models.py``, in a process that answers one line with one line.

    echo '{"model": "balls", "method": "Exudyn, RK44", "setting": 64}' | python benchmarks/contact_peers.py

The first line that it writes lists the methods that can be had, with their settings.
"""

from __future__ import annotations

import json
import sys
import time
import warnings
from collections.abc import Callable, Container
from typing import Any

from machine import one_thread, versions

one_thread()

import exudyn_parts  # noqa: E402  (after the threads are set)
import numpy as np  # noqa: E402
from contact_models import MODELS, Balls, Belt, G  # noqa: E402

#: Steps of an integrator between two outputs.
STEPS = [2.0**k for k in range(0, 12)]
#: Bristles and decay of the belt in Exudyn, for each step: the shorter, the nearer to the exact law.
DECAY, BRISTLES = 0.1, 0.2


def exudyn_method(solver: str) -> Callable[[Any, float], tuple[float, float, np.ndarray]]:
    """Balls or a block as masses in one coordinate with Exudyn's own stops and friction."""

    def run(model: Balls | Belt, setting: float) -> tuple[float, float, np.ndarray]:
        import exudyn as exu

        began = time.perf_counter()
        steps = model.outputs * round(setting)
        system, sensors = _exudyn_system(model, model.duration / steps)
        settings = exudyn_parts.settings(model.duration, steps, model.duration / model.outputs)
        kind = getattr(exu.DynamicSolverType, solver)
        made = time.perf_counter()
        if not system.SolveDynamic(settings, solverType=kind, showHints=False, showCausingItems=False):
            raise RuntimeError("Exudyn stopped")
        seconds = time.perf_counter() - made
        moved = np.hstack([system.GetSensorStoredData(sensor)[:, 1:2] for sensor in sensors])
        found = moved + np.array(model.heights if isinstance(model, Balls) else (0.0,))
        return seconds, made - began, found

    return run


def _exudyn_system(model: Balls | Belt, step: float) -> tuple[Any, list[Any]]:
    import exudyn as exu
    from exudyn import itemInterface as item

    system = exu.SystemContainer().AddSystem()
    ground = system.AddNode(item.NodePointGround())
    fixed = partner = system.AddMarker(item.MarkerNodeCoordinate(nodeNumber=ground, coordinate=0))
    sensors = []
    if isinstance(model, Balls):
        places, speed, law = model.heights, 0.0, {"useLimitStops": True, "limitStopsStiffness": model.stiffness}
    else:
        places, speed, law = (0.0,), model.speed, _bristles(model, step)
        # so heavy that nothing slows it down
        belt = system.AddNode(
            item.Node1D(referenceCoordinates=[0.0], initialCoordinates=[0.0], initialVelocities=[speed])
        )
        system.AddObject(item.ObjectMass1D(physicsMass=1e12, nodeNumber=belt))
        partner = system.AddMarker(item.MarkerNodeCoordinate(nodeNumber=belt, coordinate=0))
    for place in places:
        node = system.AddNode(
            item.Node1D(referenceCoordinates=[place], initialCoordinates=[0.0], initialVelocities=[speed])
        )
        system.AddObject(item.ObjectMass1D(physicsMass=model.mass, nodeNumber=node))
        mine = system.AddMarker(item.MarkerNodeCoordinate(nodeNumber=node, coordinate=0))
        data = system.AddNode(item.NodeGenericData(numberOfDataCoordinates=3, initialCoordinates=[0.0, 0.0, 0.0]))
        own = dict(law)
        if isinstance(model, Balls):
            own |= {"limitStopsLower": -place, "limitStopsUpper": 1e6}
            system.AddLoad(item.LoadCoordinate(markerNumber=mine, load=-model.mass * G))
        else:
            system.AddObject(
                item.ObjectConnectorCoordinateSpringDamper(markerNumbers=[fixed, mine], stiffness=model.stiffness)
            )
        system.AddObject(
            item.ObjectConnectorCoordinateSpringDamperExt(markerNumbers=[partner, mine], nodeNumber=data, **own)
        )
        sensors.append(exudyn_parts.sensor(system, node))
    system.Assemble()
    return system, sensors


def _bristles(model: Belt, step: float) -> dict[str, float]:
    """Exudyn's friction with bristles that a step resolves."""
    weight = model.mass * G
    return {
        "dynamicFrictionForce": model.sliding * weight,
        "staticFrictionOffsetForce": (model.static - model.sliding) * weight,
        "exponentialDecayStatic": DECAY * step,
        "stickingStiffness": BRISTLES * model.mass / step**2,
        "stickingDamping": model.mass * BRISTLES / step,
    }


def mujoco_method(integrator: str) -> Callable[[Any, float], tuple[float, float, np.ndarray]]:
    """Spheres on a plane with a contact of given stiffness for each unit of mass, and no damping."""

    def run(model: Balls, setting: float) -> tuple[float, float, np.ndarray]:
        import mujoco

        began = time.perf_counter()
        nstep = round(setting)
        step = model.duration / model.outputs / nstep
        bodies = "".join(
            f'<body pos="{k} 0 {h + model.radius}"><joint type="slide" axis="0 0 1"/>'
            f'<geom type="sphere" size="{model.radius}" mass="{model.mass}"/></body>'
            for k, h in enumerate(model.heights)
        )
        # a contact of one direction: with solimp near one the acceleration in contact is -k δ alone
        stiffness = model.stiffness / model.mass
        shape = f'solref="{-stiffness} 0" solimp="0.9999 0.9999 0.001 0.5 2"'
        machine = mujoco.MjModel.from_xml_string(
            f'<mujoco><option timestep="{step!r}" integrator="{integrator}" gravity="0 0 {-G}" cone="elliptic" '
            f'tolerance="1e-12" iterations="100"/><default><geom condim="1" {shape}/></default>'
            f'<worldbody><geom type="plane" size="50 50 1"/>{bodies}</worldbody></mujoco>'
        )
        data = mujoco.MjData(machine)
        heights = np.array(model.heights)
        found = [heights.copy()]
        made = time.perf_counter()
        for _ in range(model.outputs):
            mujoco.mj_step(machine, data, nstep)
            found.append(data.qpos + heights)
        return time.perf_counter() - made, made - began, np.array(found)

    return run


def methods(packages: Container[str]) -> dict[str, dict[str, Callable[..., Any]]]:
    """Methods by model and name, of the packages that are installed."""
    found: dict[str, dict[str, Callable[..., Any]]] = {"balls": {}, "belt": {}}
    if "exudyn" in packages:
        for model in found:
            found[model]["Exudyn, trapezoidal (index 2)"] = exudyn_method("TrapezoidalIndex2")
            found[model]["Exudyn, RK44"] = exudyn_method("RK44")
    if "mujoco" in packages:
        found["balls"]["MuJoCo, RK4"] = mujoco_method("RK4")
        found["balls"]["MuJoCo, implicitfast"] = mujoco_method("implicitfast")
    return found


def answer(request: dict[str, Any], known: dict[str, dict[str, Callable[..., Any]]]) -> dict[str, Any]:
    """Run one method once."""
    model = MODELS[request["model"]]
    exact = model.exact(weight_in_contact=False) if request["method"].startswith("MuJoCo") else model.exact()
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            seconds, set_up, found = known[request["model"]][request["method"]](model, request["setting"])
    except (RuntimeError, ValueError) as error:
        return {"failed": str(error).splitlines()[0] if str(error) else "stopped"}
    error = float(np.max(np.abs(found - exact))) if found.shape == exact.shape else float("inf")
    return {"seconds": seconds, "set_up": set_up, "error": error}


def main() -> None:
    """Answer lines from standard input."""
    packages = versions("exudyn", "mujoco", "numpy")
    known = methods(packages)
    reply(sys.stdout, {"methods": {model: list(names) for model, names in known.items()}, "versions": packages})
    for line in sys.stdin:
        reply(sys.stdout, answer(json.loads(line), known))


def reply(stream: Any, content: dict[str, Any]) -> None:
    """One line that begins with a mark: packages print lines of their own."""
    stream.write("\n>" + json.dumps(content) + "\n")
    stream.flush()


if __name__ == "__main__":
    main()
