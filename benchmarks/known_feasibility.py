"""Problems that are known to have a solution, and problems that are known to have none.

The former come from simulations: what a motion under random inputs passes through and needs, widened by one per cent,
are the limits of a problem from its first to its last state. The latter ask for what no motion does, by a simple
argument each. ``python known_feasibility.py [COUNT [SEED]]`` prints how each ends, with its iterations and seconds.
"""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from random_families import FAMILIES, Problem, bar, end, instance

import mbdcasadi as mbd

#: Widening of the limits of a simulated motion, and its number of points.
MARGIN, POINTS = 1.01, 801
#: Joint whose reaction is limited, by family.
LOADED = {"crank-rocker": "B", "slider-crank": "guide", "five-bar": "C", "Watt six-bar": "D"}


def simulated(family: str, seed: int, k: int) -> Problem:
    """A problem whose limits hold a simulated motion, of a mechanism of a random family."""
    free = instance(FAMILIES[family], seed, k, None)
    mechanism, random = free.mechanism, np.random.default_rng([seed, k, 1])
    duration = free.duration[1]
    peaks = np.max(np.abs(mbd.optimize(free).trajectory.inputs), axis=0)
    signals = {}
    for u, peak in zip(mechanism.inputs, peaks.tolist(), strict=True):
        waves = zip(random.uniform(-1, 1, 3).tolist(), random.uniform(0, 2 * np.pi, 3).tolist(), strict=True)
        signals[u] = sum(
            0.5 * peak * a * mbd.sin((j + 1) * np.pi * mbd.t / duration + b) for j, (a, b) in enumerate(waves)
        )
    motion = mbd.simulate(mechanism, np.linspace(0, duration, POINTS), initial=free.initial, inputs=signals)
    return held_by(free, motion, LOADED.get(family))


def held_by(free: Problem, motion: mbd.Trajectory, loaded: str | None) -> Problem:
    """A problem from the first to the last state of a motion, with limits that it just meets."""
    mechanism, step = free.mechanism, motion.t[1] - motion.t[0]
    path = []
    for u in mechanism.inputs:
        values = motion[u]
        peak, rate = (MARGIN * float(np.max(np.abs(x))) for x in (values, np.gradient(values, step)))
        path += [mbd.bounded(-peak, u, peak), mbd.bounded(-rate, u.rate, rate)]
    if loaded is not None:
        joint = next(j for j in mechanism.joints if j.name == loaded)
        load = mbd.norm(joint.reaction_on(mechanism.bodies[-1] if loaded == "guide" else joint.bodies[0]).force)
        path.append(load <= MARGIN * float(np.max(motion[load])))
    tip = mechanism.bodies[-1]
    track = np.column_stack([motion[tip.x], motion[tip.y]])
    size = float(np.max(np.ptp(track, axis=0)))
    middle = track[len(track) // 2] + 0.2 * size * np.array([0.6, 0.8])
    clear = float(np.min(np.sum((track - middle) ** 2, axis=1))) / MARGIN**2
    path.append((tip.x - middle[0]) ** 2 + (tip.y - middle[1]) ** 2 >= clear)
    for body in mechanism.bodies[:2]:
        fastest = MARGIN * float(np.max(np.abs(motion[body.omega])))
        if fastest > 1e-9:
            path.append(mbd.bounded(-fastest, body.omega, fastest))
    final = [c.expression == float(motion[c.expression][-1]) for c in free.initial]
    return free.replace(path=path, final=final)


def released(seed: int, k: int) -> Problem:
    """A cart takes a locked pendulum along and lets it go, in two phases, as it was simulated."""
    random = np.random.default_rng([seed, k, 2])
    length, lean = random.uniform(0.3, 0.8), random.uniform(-2.2, -1.0)
    cart = mbd.Body("cart", mass=random.uniform(0.5, 2), inertia=0.1, pose=(0, 0, 0))
    rod = bar("rod", random.uniform(0.5, 2), np.zeros(2), length * np.array([np.cos(lean), np.sin(lean)]))
    force = mbd.Input("F")
    joints = [
        mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0)),
        mbd.Revolute("hinge", cart.at(0, 0), end(rod, length, -1)),
    ]
    drive = mbd.GeneralizedForce("drive", [(cart.x, force)])
    loose = mbd.Mechanism([cart, rod], joints, forces=[mbd.Gravity(), drive], inputs=[force])
    locked = loose.replace(joints=[joints[0], mbd.Weld("lock", cart.at(0, 0, angle=lean), end(rod, length, -1))])
    times = random.uniform(0.4, 0.8, 2)
    push = 4 * mbd.sin(np.pi * mbd.t / times[0] + random.uniform(0, 2))
    first = mbd.simulate(
        locked, np.linspace(0, times[0], POINTS), initial=[cart.x == 0, cart.vx == 0], inputs={force: push}
    )
    q, v = first.final.q, first.final.v
    met = [cart.x == q[0], cart.vx == v[0], rod.phi == q[5], rod.omega == v[5]]
    later = 4 * mbd.sin(3 * mbd.t + random.uniform(0, 2))
    second = mbd.simulate(loose, np.linspace(0, times[1], POINTS), initial=met, inputs={force: later})
    peaks = [MARGIN * float(np.max(np.abs(motion[force]))) for motion in (first, second)]
    farthest = MARGIN * float(max(np.max(motion[cart.x]) for motion in (first, second)))
    swing = MARGIN * float(np.max(np.abs(second[rod.omega])))
    stop = [cart.x <= farthest] if farthest > 0 else []
    ends = [x == float(second[x][-1]) for x in (cart.x, cart.vx, rod.phi, rod.omega)]
    take = mbd.Phase(
        "take", locked, float(times[0]), initial=[cart.x == 0, cart.vx == 0],
        path=[mbd.bounded(-peaks[0], force, peaks[0]), *stop], running_cost=force**2,
    )  # fmt: skip
    swings = mbd.Phase(
        "swing", loose, float(times[1]), final=ends,
        path=[mbd.bounded(-peaks[1], force, peaks[1]), mbd.bounded(-swing, rod.omega, swing), *stop],
        running_cost=force**2,
    )  # fmt: skip
    return Problem(phases=[take, swings])


# --- what has no solution -----------------------------------------------------------------------
def carriage(limit: float, demands: Callable[[mbd.Body, mbd.Input], dict] = lambda block, force: {}) -> Problem:
    """A mass of 2 kg that goes 1 m along a rail in 1 s, from rest to rest; the force that it needs is 8 N."""
    block = mbd.Body("block", mass=2.0, inertia=0.1, pose=(0, 0, 0))
    force = mbd.Input("F", lower=-limit, upper=limit)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), block.at(0, 0))
    drive = mbd.GeneralizedForce("drive", [(block.x, force)])
    mechanism = mbd.Mechanism([block], [rail], forces=[drive], inputs=[force])
    return Problem(
        mechanism,
        duration=1.0,
        initial=[block.x == 0, block.vx == 0],
        final=[block.x == 1, block.vx == 0],
        running_cost=force**2,
        **demands(block, force),
    )


def back(block: mbd.Body, _force: mbd.Input) -> dict:
    """Waypoints in the wrong order."""
    return {"waypoints": [mbd.Waypoint(0.45, [block.x == 0.8]), mbd.Waypoint(0.55, [block.x == 0.2])]}


def impossible() -> Iterator[tuple[str, Callable[[], Problem]]]:
    """Problems without a solution, each with what contradicts."""
    yield "7.6 N for 8 N", partial(carriage, 7.6)
    yield "4 N for 8 N", partial(carriage, 4)
    free = partial(carriage, 100)
    yield "mean speed of 1 m/s above its limit of 0.95", partial(free, lambda block, _: {"path": [block.vx <= 0.95]})
    yield (
        "effort below the least one of 48",
        partial(free, lambda _, force: {"boundary": [mbd.integral(force**2) <= 0.95 * 48]}),
    )
    yield "back by 0.6 m in 0.1 s with 20 N", partial(carriage, 20, back)
    yield "an end beyond a path limit", partial(free, lambda block, _: {"path": [block.x <= 0.9]})
    yield (
        "a rate of 22 N/s for 24 N/s",
        partial(free, lambda _, force: {"path": [mbd.bounded(-22, force.rate, 22)]}),
    )
    yield "a point out of reach at a waypoint", partial(arms, 50, waypoint=(1.3, 0.4))
    yield "a point out of reach at the end", partial(arms, 50, goal=(1.1, 0.2))
    yield "half the torque to hold a load", partial(arms, 3.0, window=0.2)
    yield "a bearing that carries half the weight", partial(arms, 50, bearing=0.5)
    yield "a wall across the way", partial(arms, 50, wall=True)


def arms(limit: float, *, waypoint=None, goal=None, window=None, bearing=None, wall=False) -> Problem:
    """Two links of 0.5 m in the plane that holds gravity, the first level at rest."""
    upper, fore = (
        bar("upper", 2.0, np.zeros(2), np.array([0.5, 0])),
        bar("fore", 2.0, np.array([0.5, 0]), np.array([1.0, 0])),
    )
    torques = [mbd.Input(f"tau {k}", lower=-limit, upper=limit) for k in (1, 2)]
    shoulder = mbd.Revolute("shoulder", mbd.ground.at(0, 0), end(upper, 0.5, -1))
    elbow = mbd.Revolute("elbow", end(upper, 0.5, 1), end(fore, 0.5, -1))
    forces = [
        mbd.Gravity(),
        mbd.Torque("shoulder motor", upper, torques[0]),
        mbd.Torque("elbow motor", fore, torques[1], upper),
    ]
    mechanism = mbd.Mechanism([upper, fore], [shoulder, elbow], forces=forces, inputs=torques)
    hand = end(fore, 0.5, 1)
    rest = [upper.omega == 0, fore.omega == 0]
    path = []
    if window is not None:
        path = [mbd.bounded(-window, body.phi, window) for body in (upper, fore)]
    if bearing is not None:
        path = [mbd.norm(shoulder.reaction_on(upper).force) <= bearing * 2.0 * 9.81]
    if wall:
        path = [hand.x**2 >= 0.09]
    final = (
        [hand.x == goal[0], hand.y == goal[1]]
        if goal
        else [upper.phi == (np.pi if wall else 0.1), fore.phi == (np.pi if wall else 0.1)]
    )
    return Problem(
        mechanism,
        duration=2.0,
        initial=[upper.phi == 0, fore.phi == 0, *rest],
        final=[*final, *rest],
        path=path,
        waypoints=[mbd.Waypoint(1.0, [hand.x == waypoint[0], hand.y == waypoint[1]])] if waypoint else [],
        running_cost=torques[0] ** 2 + torques[1] ** 2,
    )


def report(name: str, make: Callable[[], Problem]) -> None:
    """Print how a problem ends."""
    began = time.process_time()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            solution = mbd.optimize(make())
            s = solution.statistics
            said = f"solved, cost {solution.cost:.6g}, {s.iterations} iterations, {len(s.stages)} stages"
        except mbd.MechanismError as error:
            said = f"{type(error).__name__}: {error}"
    warned = "".join(f" ({str(w.message)[:60]})" for w in caught)
    print(f"{name}: {said[:400]}{warned}, {time.process_time() - began:.1f} s", flush=True)


def main(count: int = 3, seed: int = 20261122) -> None:
    """Solve all."""
    for k in range(count):
        for family in FAMILIES:
            report(f"{family} {k}", partial(simulated, family, seed, k))
        report(f"released pendulum {k}", partial(released, seed, k))
    for name, make in impossible():
        report(name, make)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:3]))
