"""A four-bar of free dimensions whose coupler point passes given points, solved on many meshes.

A plain problem of kinematics as optimal control: the crank turns once, the lengths of the links, the place of the
coupler point and the times at which it passes the points are free, and the cost is the effort of the motor plus a
term for the lengths. As usual in synthesis, the transmission angle between coupler and rocker has a least value.
``python path_synthesis.py [POINTS [ANGLE]]`` prints cost, iterations and stages for 26 meshes and for a tolerance.

Without the limit (0 degrees) there is no optimum with three points: with the gap d + c - a - b that separates the
linkage from a change point, m, the least cost falls without end, 0.01231 at 0.04, 0.01141 at 5e-3, 0.01095 at 2e-4.
"""

from __future__ import annotations

import sys
import time
import warnings

import numpy as np

import mbdcasadi as mbd

#: Points, m, that lie on the path of a four-bar with other dimensions than the estimate.
POINTS = ((0.0963, 0.2645), (0.0156, 0.2897), (-0.0655, 0.2189), (-0.0870, 0.1382), (0.0014, 0.1615))


def problem(count: int, angle: float = 0.0) -> mbd.OptimalControlProblem:
    """The coupler point passes some of the points, in their order, at free times; least transmission angle, degrees."""
    names = {"a": (0.1, 0.06, 0.14), "b": (0.28, 0.2, 0.45), "c": (0.24, 0.15, 0.45), "d": (0.3, 0.15, 0.45)}
    a, b, c, d = (mbd.Parameter(name, *values) for name, values in names.items())
    along, across = mbd.Parameter("along", 0.0, -0.3, 0.3), mbd.Parameter("across", 0.1, -0.3, 0.3)
    tau = mbd.Input("tau")
    crank = mbd.Body("crank", mass=0.3, inertia=3e-4, pose=(0.05, 0.0, 0.0))
    coupler = mbd.Body("coupler", mass=0.8, inertia=5e-3, pose=(0.2, 0.12, 0.7))
    rocker = mbd.Body("rocker", mass=0.7, inertia=4e-3, pose=(0.3, 0.12, 1.6))
    o2 = mbd.Revolute("O2", mbd.ground.at(0, 0), crank.at(-a / 2, 0))
    joints = [
        o2,
        mbd.Revolute("A", crank.at(a / 2, 0), coupler.at(-b / 2, 0)),
        mbd.Revolute("B", coupler.at(b / 2, 0), rocker.at(c / 2, 0)),
        mbd.Revolute("O4", mbd.ground.at(d, 0), rocker.at(-c / 2, 0)),
    ]
    free = [a, b, c, d, along, across]
    linkage = mbd.Mechanism(
        [crank, coupler, rocker],
        joints,
        forces=[mbd.Torque("motor", crank, tau)],
        inputs=[tau],
        parameters=free,
    )
    tracer = coupler.at(along, across)
    chosen = POINTS if count == len(POINTS) else POINTS[:: 2 if count == 3 else 1][:count]
    span = np.linspace(0, 1, count + 2)
    waypoints = [
        mbd.Waypoint((max(0.02, t - 0.5 / count), min(0.98, t + 0.5 / count)), [tracer.x == x, tracer.y == y])
        for t, (x, y) in zip(span[1:-1].tolist(), chosen, strict=True)
    ]
    return mbd.OptimalControlProblem(
        linkage,
        duration=1.0,
        initial=[o2.angle == 0, crank.omega == 2 * np.pi],
        final=[o2.angle == 2 * np.pi, crank.omega == 2 * np.pi],
        waypoints=waypoints,
        path=[mbd.sin(rocker.phi - coupler.phi) >= float(np.sin(np.radians(angle)))] if angle else [],
        running_cost=tau**2,
        terminal_cost=0.1 * (a**2 + b**2 + c**2 + d**2),
        free_parameters=free,
    )


def main(count: int = 3, angle: int = 20) -> None:
    """Solve on 26 meshes, and with a tolerance, and print what was found."""
    for settings in (*({"intervals": n} for n in range(20, 46)), {"tolerance": 1e-4}):
        began = time.process_time()
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                found = mbd.optimize(problem(count, angle), **settings)
                stages = "; ".join(f"{stage.description} {stage.status}" for stage in found.statistics.stages)
                size = found.mesh.size - 1
                said = f"{found.cost:.6g}, {found.statistics.iterations} iterations, {size} intervals, "
                said += f"error {found.mesh_error:.1e} {stages}"
            except mbd.OptimizationError as error:
                said = str(error)[:200]
        coarse = " (coarse)" if any("coarse" in str(w.message) for w in caught) else ""
        print(f"{settings}: {said}{coarse}, {time.process_time() - began:.1f} s", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:3]))
