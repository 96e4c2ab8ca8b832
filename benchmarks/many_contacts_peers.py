"""MuJoCo and Exudyn on the models of ``many_contacts_models.py``: ``MODEL DURATION PACKAGE STEP FILE``.

Both get bodies in a plane, and contacts as near to the laws of the models as they have them: MuJoCo a linear spring and
damper of the same depth under the weight of a body, Exudyn linear springs at spheres.
"""

from __future__ import annotations

import json
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from machine import one_thread

one_thread()

import exudyn_parts  # noqa: E402  (after the threads are set)
import numpy as np  # noqa: E402
from many_contacts_models import Dominoes, Funnel, G  # noqa: E402

MODELS: dict[str, Any] = {"dominoes": Dominoes(), "funnel": Funnel()}
#: Depth of a contact at which the linear springs of the peers are as stiff as Hunt and Crossley's law, m.
DEPTH = 1e-4
#: Contact of MuJoCo: rate of a damped oscillator, 1/s, and its damping ratio.
RATE, RATIO = 1000.0, 0.5


def mujoco_run(model: Dominoes | Funnel, step: float) -> tuple[float, list[Any]]:
    """Time of the processor and the motion of MuJoCo."""
    import mujoco

    nstep = round(model.duration / model.outputs / step)
    parts, places, speeds = mujoco_parts(model)
    machine = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{step!r}" integrator="implicitfast" gravity="0 0 {-G}" cone="elliptic"/>'
        f'<default><geom condim="3" solref="{1 / RATE} {RATIO}"/></default>'
        f"<worldbody>{''.join(parts)}</worldbody></mujoco>"
    )
    data = mujoco.MjData(machine)
    data.qvel[:] = speeds
    found = [data.qpos.copy()]
    began = time.process_time()
    for _ in range(model.outputs):
        mujoco.mj_step(machine, data, nstep)
        found.append(data.qpos.copy())
    seconds = time.process_time() - began
    moved = np.array(found).reshape(len(found), model.count, 3).transpose(1, 2, 0)
    moved[:, :2] += np.array(places)[:, :, None]
    return seconds, moved.tolist()


def mujoco_parts(model: Dominoes | Funnel) -> tuple[list[str], list[tuple[float, float]], list[float]]:
    """Grounds and bodies in MuJoCo's XML, places of the bodies, m, and their velocities, one after the other."""
    own = (
        '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/><joint type="hinge" axis="0 -1 0"/>'
        f'<inertial pos="0 0 0" mass="{model.mass}" diaginertia="{model.inertia} {model.inertia} {model.inertia}"/>'
    )
    plane = '<geom type="plane" size="50 50 1"'
    if isinstance(model, Dominoes):
        grounds = [f'{plane} friction="{model.floor_friction}"/>']
        starts = [model.start(k) for k in range(model.count)]
        # a pair has the larger one of two coefficients, and the floor's is the larger one
        shape = f'type="box" size="{model.width / 2} 0.02 {model.height / 2}"'
    else:
        grounds = [
            f'{plane} pos="{side * model.radius} 0 0" euler="0 {-np.degrees(side * model.half_angle)} 0" '
            f'friction="{model.friction}"/>'
            for side in (-1, 1)
        ]
        starts = [((x, y, 0.0), (0.0, 0.0, 0.0)) for x, y in model.places]
        shape = f'type="sphere" size="{model.radius}"'
    bodies = [
        f'<body pos="{x} 0 {y}">{own}<geom {shape} friction="{model.friction}"/></body>' for (x, y, _), _ in starts
    ]
    return grounds + bodies, [pose[:2] for pose, _ in starts], [speed for _, speeds in starts for speed in speeds]


def exudyn_run(model: Dominoes | Funnel, step: float) -> tuple[float, list[Any]]:
    """Time of the processor and the motion of Exudyn: spheres on triangles by its general contact."""
    import exudyn as exu
    from exudyn import itemInterface as item

    if isinstance(model, Dominoes):
        raise NotImplementedError("Exudyn's general contact is of spheres and triangles: there is none of two blocks")
    system = exu.SystemContainer().AddSystem()
    contact = system.AddGeneralContact()
    stiffness = 1.5 * model.stiffness * DEPTH**0.5
    contact.SetFrictionPairings(model.friction * np.eye(1))
    contact.frictionProportionalZone = model.velocity_tolerance
    sensors = []
    for x, y in model.places:
        node = system.AddNode(item.NodeRigidBody2D(referenceCoordinates=[x, y, 0], initialVelocities=[0, 0, 0]))
        system.AddObject(item.ObjectRigidBody2D(nodeNumber=node, physicsMass=model.mass, physicsInertia=model.inertia))
        marker = system.AddMarker(item.MarkerNodeRigid(nodeNumber=node))
        system.AddLoad(item.LoadForceVector(markerNumber=marker, loadVector=[0, -model.mass * G, 0]))
        contact.AddSphereWithMarker(
            marker, radius=model.radius, contactStiffness=stiffness, contactDamping=1.0, frictionMaterialIndex=0
        )
        sensors.append(exudyn_parts.sensor(system, node))
    _add_walls(system, contact, model, stiffness)
    contact.SetSearchTreeCellSize(numberOfCells=[16, 16, 1])
    system.Assemble()
    settings = exudyn_parts.settings(model.duration, round(model.duration / step), model.duration / model.outputs)
    settings.timeIntegration.explicitIntegration.dynamicSolverType = exu.DynamicSolverType.ExplicitMidpoint
    began = time.process_time()
    kind = exu.DynamicSolverType.ExplicitMidpoint
    if not system.SolveDynamic(settings, solverType=kind, showHints=False, showCausingItems=False):
        raise RuntimeError("Exudyn stopped")
    seconds = time.process_time() - began
    moved = np.array([system.GetSensorStoredData(sensor)[:, 1:].T for sensor in sensors])
    moved[:, :2] += model.places[:, :, None]
    return seconds, moved.tolist()


def _add_walls(system: Any, contact: Any, model: Funnel, stiffness: float) -> None:
    """Add the walls of the funnel to Exudyn's general contact, two triangles each."""
    from exudyn import itemInterface as item

    ground = system.AddObject(item.ObjectGround())
    frame = system.AddMarker(item.MarkerBodyRigid(bodyNumber=ground, localPosition=[0, 0, 0]))
    for side in (-1, 1):
        along = np.array([np.cos(side * model.half_angle), np.sin(side * model.half_angle), 0.0])
        first = np.array([side * model.radius, 0.0, 0.0]) - 5 * along
        points = [first - [0, 0, 5], first + 10 * along - [0, 0, 5], first + 10 * along + [0, 0, 5], [*first[:2], 5]]
        corners = [list(point) for point in points]
        contact.AddTrianglesRigidBodyBased(
            rigidBodyMarkerIndex=frame,
            contactStiffness=stiffness,
            contactDamping=1.0,
            frictionMaterialIndex=0,
            pointList=corners,
            triangleList=[[0, 2, 1], [0, 3, 2]],
        )


def main() -> None:
    """Run one method once."""
    name, duration, package, step, file = sys.argv[1:]
    model = MODELS[name]
    outputs = round(float(duration) / model.duration * model.outputs)
    model = replace(model, duration=float(duration), outputs=outputs)
    run = {"MuJoCo": mujoco_run, "Exudyn": exudyn_run}[package]
    seconds, motion = run(model, float(step))
    Path(file).write_text(json.dumps({"seconds": seconds, "motion": motion}))


if __name__ == "__main__":
    main()
