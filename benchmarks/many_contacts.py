"""Many contacts: eight dominoes and thirty discs in a funnel, compared with MuJoCo and Exudyn.

    python benchmarks/many_contacts.py --peers peers/bin/python --before OLD/CHECKOUT

There is no exact solution, and the packages have different laws of contact. Each method is therefore
compared with itself: the error is the largest difference from the same method at a tenth of its
tolerance or step. Impacts magnify errors, so that only the first part of a motion is compared.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

from machine import describe, into_readme, machine, one_thread

one_thread()

import numpy as np  # noqa: E402  (after the threads are set)
from many_contacts_models import Dominoes, Funnel  # noqa: E402

HERE = Path(__file__).parent
MODELS: dict[str, Any] = {"dominoes": Dominoes(), "funnel": Funnel()}


def mechanism(model: Dominoes | Funnel) -> tuple[Any, list[Any]]:
    """Model of this package, and its bodies."""
    import mbdcasadi as mbd

    law = mbd.HuntCrossley(model.stiffness, damping=model.damping)
    forces: list[Any] = [mbd.Gravity()]
    bodies = []
    if isinstance(model, Dominoes):
        for k in range(model.count):
            pose, velocity = model.start(k)
            bodies.append(mbd.Body(f"d{k}", mass=model.mass, inertia=model.inertia, pose=pose, velocity=velocity))
        blocks = [mbd.PolygonEdges(body.at(0, 0), model.corners) for body in bodies]
        floor = mbd.HalfPlane(mbd.ground.at(0, 0))
        rough = mbd.Coulomb(model.floor_friction, model.velocity_tolerance)
        forces += [mbd.Contact(f"floor{k}", block, floor, law, rough) for k, block in enumerate(blocks)]
        smooth = mbd.Coulomb(model.friction, model.velocity_tolerance)
        pairs = pairwise(blocks)
        forces += [mbd.Contact(f"pair{k}", a, b, law, smooth) for k, (a, b) in enumerate(pairs)]
        return mbd.Mechanism(bodies, forces=forces), bodies
    friction = mbd.Coulomb(model.friction, model.velocity_tolerance)
    for k, (x, y) in enumerate(model.places):
        bodies.append(mbd.Body(f"b{k}", mass=model.mass, inertia=model.inertia, pose=(float(x), float(y), 0.0)))
    discs = [mbd.Circle(body.at(0, 0), model.radius) for body in bodies]
    walls = [mbd.HalfPlane(mbd.ground.at(s * model.radius, 0, s * model.half_angle)) for s in (-1, 1)]
    for k, disc in enumerate(discs):
        forces += [mbd.Contact(f"wall{j}_{k}", disc, wall, law, friction) for j, wall in enumerate(walls)]
        forces += [mbd.Contact(f"pair{j}_{k}", discs[j], disc, law, friction) for j in range(k)]
    return mbd.Mechanism(bodies, forces=forces), bodies


def run_here(model: Dominoes | Funnel, method: str, tolerance: float) -> dict[str, Any]:
    """Time of the processor of one run in this process, without compiling that is kept, and the motion."""
    import mbdcasadi as mbd

    began = time.process_time()
    system, bodies = mechanism(model)
    made = time.process_time()
    times = np.linspace(0, model.duration, model.outputs + 1)
    motion = mbd.simulate(system, times, method=method, reltol=tolerance, abstol=tolerance)
    return {
        "model": made - began,
        "seconds": time.process_time() - made,
        "motion": np.array([[motion[b.x], motion[b.y], motion[b.phi]] for b in bodies]).tolist(),
        "notes": list(motion.statistics.notes),
    }


def in_own_process(python: str, path: str, script: Path, *arguments: str) -> dict[str, Any]:
    """Answer of a script, which gets the file to write to as its last argument."""
    with tempfile.TemporaryDirectory() as folder:
        answer = Path(folder) / "answer.json"
        environment = dict(os.environ) | ({"PYTHONPATH": path} if path else {})
        command = [python, str(script), *arguments, str(answer)]
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
        if done.returncode or not answer.exists():
            lines = (done.stderr or done.stdout).strip().splitlines()
            return {"failed": lines[-1] if lines else "no answer"}
        return dict(json.loads(answer.read_text()))


def error_of(model: Dominoes | Funnel, coarse: Any, fine: Any) -> float:
    """Largest difference as long as both last: of angles for the dominoes, of places for the discs."""
    which = slice(2, 3) if isinstance(model, Dominoes) else slice(2)
    a, b = (np.array(motion)[:, which] for motion in (coarse, fine))
    last = min(a.shape[2], b.shape[2])
    return float(np.max(np.abs(a[..., :last] - b[..., :last])))


def row(model: Dominoes | Funnel, label: str, run: Any, coarse: float) -> dict[str, Any]:
    """A method at one setting, with its difference from a finer one, of which the first part is enough."""
    print(f"{model.title}: {label}", file=sys.stderr, flush=True)
    one, other = run(coarse, model.duration), run(coarse / 10, min(model.compared, model.duration))
    for found in (one, other):
        if "failed" in found:
            return {"method": label, "setting": coarse, "failed": found["failed"]}
    result = {"method": label, "setting": coarse, "seconds": one["seconds"], "notes": one.get("notes", [])}
    return result | {"error": error_of(model, one["motion"], other["motion"])}


def rows(name: str, model: Dominoes | Funnel, peers: str, before: str) -> list[dict[str, Any]]:
    """All methods on one model."""
    own = HERE / "many_contacts.py"
    found = []

    def run(setting: float, duration: float, method: str, path: str = "") -> dict[str, Any]:
        return in_own_process(sys.executable, path, own, "--run", name, repr(duration), method, repr(setting))

    for method in ("bdf", "idas"):
        own_run = partial(run, method=method)
        found.append(row(model, f"mbdcasadi, {method}", own_run, 1e-5))
        found.append(row(model, f"mbdcasadi, {method}, default tolerance", own_run, 1e-8))
    if before:
        old_run = partial(run, method="idas", path=before)
        found.append(row(model, "mbdcasadi before, idas, default tolerance", old_run, 1e-8))
    for peer, step in (("MuJoCo", 1e-4), ("Exudyn", 2e-5)):
        if not peers:
            found.append({"method": peer, "setting": step, "failed": "no interpreter was given by --peers"})
            continue

        def theirs(setting: float, duration: float, peer: str = peer) -> dict[str, Any]:
            return in_own_process(peers, "", HERE / "many_contacts_peers.py", name, repr(duration), peer, repr(setting))

        found.append(row(model, peer, theirs, step))
    return found


def lasting(model: Any, duration: str) -> Any:
    """A model whose motion lasts as long as is asked for, with outputs as far from each other."""
    if not duration:
        return model
    outputs = round(float(duration) / model.duration * model.outputs)
    return replace(model, duration=float(duration), outputs=outputs)


def table(model: Dominoes | Funnel, content: list[dict[str, Any]]) -> str:
    """Markdown."""
    unit = f"{'rad' if isinstance(model, Dominoes) else 'm'}, up to {model.compared:g} s"
    lines = [f"**{model.title}**: {model.duration:g} s", ""]
    lines += [f"| method | tolerance or step | s of processor | difference from ten times finer, {unit} |"]
    lines += ["|---|---:|---:|---:|"]
    for r in content:
        if "failed" in r:
            lines.append(f"| {r['method']} | {r['setting']:g} | – | {r['failed']} |")
        else:
            lines.append(f"| {r['method']} | {r['setting']:g} | {r['seconds']:.3g} | {r['error']:.1e} |")
    return "\n".join(lines)


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("models", nargs="*", help=f"of {', '.join(MODELS)}; all if left out")
    parser.add_argument("--peers", default="", help="an interpreter with mujoco and exudyn")
    parser.add_argument("--before", default="", help="folder of an older version of this package")
    parser.add_argument("--duration", default="", help="of the motions, s, in place of the models' own")
    parser.add_argument("--readme", action="store_true", help="put the tables into README.md")
    parser.add_argument(
        "--run", nargs=5, metavar=("MODEL", "DURATION", "METHOD", "TOLERANCE", "FILE"), help=argparse.SUPPRESS
    )
    given = parser.parse_args()
    if given.run:
        name, duration, method, tolerance, file = given.run
        Path(file).write_text(json.dumps(run_here(lasting(MODELS[name], duration), method, float(tolerance))))
        return
    models = {name: lasting(MODELS[name], given.duration) for name in given.models or MODELS}
    results = HERE / "results" / "many_contacts.json"
    known = json.loads(results.read_text()) if results.exists() else {}
    found = {name: known[name] for name in MODELS if name in known and name not in models}
    found |= {name: rows(name, model, given.peers, given.before) for name, model in models.items()}
    text = "\n\n".join(
        [describe(), *(table(models.get(name, MODELS[name]), content) for name, content in found.items())]
    )
    print(text)
    results.write_text(json.dumps({"machine": machine(), **found}, indent=1))
    if given.readme:
        into_readme("many contacts", text)


if __name__ == "__main__":
    main()
