"""Random least-time problems whose inputs switch, to a tolerance: cost against a reference, meshes, time, warnings.

Cranes with a limited speed, with unlike force limits and with a limited swing; two blocks with a spring between them; a
sprung block; arms with unlike torque limits; a crank with a flywheel and limited power; a motor with a limited current;
the swing-up of a pendulum. The references are of their own: equations of motion by hand, in minimal coordinates, on a
mesh of thousands of equal intervals with Runge-Kutta steps and inputs that may jump between them, begun at the solution
without tolerance. Two meshes tell what is left of the error, which goes with the square of an interval: 1e-6 of the
time or so.

``python least_times.py [COUNT [SEED [TOLERANCE]]]`` prints a table; seconds are those of the processor.
"""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

import mbdcasadi as mbd

GRAVITY = 9.81
#: Intervals of the meshes of a reference, each begun at the solution on the one before.
MESHES = (250, 1000)
OPTIONS = {
    "print_time": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.tol": 1e-9,
    "ipopt.max_iter": 300,
    "ipopt.mu_init": 1e-3,
}


@dataclass
class Case:
    """A problem, and the same by hand: states, inputs and rates as symbols, with the quantities that the states are."""

    problem: mbd.OptimalControlProblem
    #: expressions of the mechanism that the states are
    quantities: ca.SX
    x: ca.SX
    u: ca.SX
    rates: ca.SX
    start: Sequence[float]
    goal: Sequence[float]
    #: largest absolute values of the states
    most: Sequence[float] | None = None
    #: expressions of states and inputs that are at most zero
    limits: list[ca.SX] = field(default_factory=list)
    #: whether the inputs of a reference are linear on its intervals, and not constant
    is_linear: bool = False

    @property
    def bounds(self) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds of the states."""
        most = np.full(self.x.numel(), np.inf) if self.most is None else np.array(self.most)
        return -most, most


def fastest(
    mechanism: mbd.Mechanism, longest: float, start: list, goal: list, **more: object
) -> mbd.OptimalControlProblem:
    """The problem of least time between two states."""
    times = (longest / 100, longest)
    return mbd.OptimalControlProblem(mechanism, times, initial=start, final=goal, terminal_cost=mbd.t, **more)


def _crane(random: np.random.Generator, share: tuple[float, float], **limit: float) -> Case:
    """A cart with a load on a rigid rope, hanging at rest at both ends; force limits as shares of the weight."""
    mass, load, rope = random.uniform(1, 4), random.uniform(0.5, 2), random.uniform(0.5, 1.5)
    distance = random.uniform(1, 3)
    low, high = -share[0] * (mass + load), share[1] * (mass + load)
    force = mbd.Input("F", lower=low, upper=high)
    cart = mbd.Body("cart", mass=mass, inertia=0.1)
    bob = mbd.Body("load", mass=load, inertia=1e-3, pose=(0, -rope, -np.pi / 2))
    joints = [
        mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0)),
        mbd.Revolute("hook", cart.at(0, 0), bob.at(-rope, 0)),
    ]
    drive = mbd.GeneralizedForce("drive", [(cart.x, force)])
    mechanism = mbd.Mechanism([cart, bob], joints, forces=[mbd.Gravity(), drive], inputs=[force])
    rest = [cart.vx == 0, bob.omega == 0, bob.phi == -np.pi / 2]
    path = []
    if "speed" in limit:
        path.append(mbd.bounded(-limit["speed"], cart.vx, limit["speed"]))
    if "swing" in limit:
        path.append(mbd.bounded(-limit["swing"], bob.phi + np.pi / 2, limit["swing"]))
    problem = fastest(mechanism, 15.0, [cart.x == 0, *rest], [cart.x == distance, *rest], path=path)
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u")
    inertia = ca.blockcat(
        [[mass + load, load * rope * ca.cos(x[1])], [load * rope * ca.cos(x[1]), load * rope**2 + 1e-3]]
    )
    loads = ca.vertcat(u + load * rope * x[3] ** 2 * ca.sin(x[1]), -load * GRAVITY * rope * ca.sin(x[1]))
    rates = ca.vertcat(x[2:], ca.solve(inertia, loads))
    quantities = ca.vertcat(cart.x, bob.phi + np.pi / 2, cart.vx, bob.omega)
    most = [np.inf, limit.get("swing", np.inf), limit.get("speed", np.inf), np.inf]
    return Case(problem, quantities, x, u, rates, [0, 0, 0, 0], [distance, 0, 0, 0], most)


def crane_speed(random: np.random.Generator) -> Case:
    """A crane with a limited speed."""
    share = random.uniform(1, 3)
    return _crane(random, (share, share), speed=random.uniform(0.6, 1.2))


def crane_unlike(random: np.random.Generator) -> Case:
    """A crane that brakes otherwise than it speeds up."""
    return _crane(random, (random.uniform(1, 3), random.uniform(1, 3)))


def crane_swing(random: np.random.Generator) -> Case:
    """A crane whose load swings by a limited angle."""
    share = random.uniform(1, 3)
    return _crane(random, (share, share), swing=random.uniform(0.08, 0.2))


def elastic(random: np.random.Generator) -> Case:
    """Two blocks with a spring between them, of which one is pushed."""
    m, stiffness, distance = random.uniform(0.5, 2, 2), random.uniform(10, 60), random.uniform(0.5, 2)
    limits = random.uniform(1, 4, 2)
    force = mbd.Input("F", lower=-limits[0], upper=limits[1])
    blocks = [mbd.Body(f"block {k}", mass=m[k], inertia=0.1, pose=(5.0 * k, 0, 0)) for k in (0, 1)]
    joints = [mbd.Translational(f"rail {k}", mbd.ground.at(0, 0), b.at(0, 0)) for k, b in enumerate(blocks)]
    ends = [b.at(0, 0) for b in blocks]
    forces = [
        mbd.TSDA("spring", *ends, stiffness=stiffness, free_length=5.0),
        mbd.GeneralizedForce("push", [(blocks[0].x, force)]),
    ]
    mechanism = mbd.Mechanism(blocks, joints, forces=forces, inputs=[force])
    rest = [b.vx == 0 for b in blocks]
    start = [blocks[0].x == 0, blocks[1].x == 5, *rest]
    problem = fastest(mechanism, 15.0, start, [blocks[0].x == distance, blocks[1].x == 5 + distance, *rest])
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u")
    pull = stiffness * (x[1] - x[0])
    rates = ca.vertcat(x[2:], (u + pull) / m[0], -pull / m[1])
    quantities = ca.vertcat(blocks[0].x, blocks[1].x - 5, blocks[0].vx, blocks[1].vx)
    return Case(problem, quantities, x, u, rates, [0, 0, 0, 0], [distance, distance, 0, 0])


def sprung(random: np.random.Generator) -> Case:
    """A block on a spring comes to rest from afar, by pushes that are weaker than the spring."""
    mass, stiffness, away = random.uniform(0.5, 2), random.uniform(5, 20), random.uniform(0.5, 1.0)
    limits = stiffness * away * random.uniform(0.15, 0.5, 2)
    force = mbd.Input("F", lower=-limits[0], upper=limits[1])
    block = mbd.Body("block", mass=mass, inertia=0.1)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), block.at(0, 0))
    pull = mbd.GeneralizedForce("pull", [(block.x, force - stiffness * block.x)])
    mechanism = mbd.Mechanism([block], [rail], forces=[pull], inputs=[force])
    problem = fastest(mechanism, 15.0, [block.x == away, block.vx == 0], [block.x == 0, block.vx == 0])
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    rates = ca.vertcat(x[1], (u - stiffness * x[0]) / mass)
    return Case(problem, ca.vertcat(block.x, block.vx), x, u, rates, [away, 0], [0, 0])


def arm(random: np.random.Generator) -> Case:
    """A two-link arm in a horizontal plane, with unlike torque limits."""
    length, mass = random.uniform(0.4, 0.8, 2), random.uniform(1, 3, 2)
    first, last = random.uniform([-0.5, 0.2], [0.5, 1.2]), random.uniform([0.8, 0.5], [1.6, 2.5])
    limits = random.uniform(2, 8, (2, 2)) * np.array([[2.0], [1.0]])
    torques = [mbd.Input(f"tau {k}", lower=-limits[k, 0], upper=limits[k, 1]) for k in (0, 1)]
    knee = length[0] * np.array([np.cos(first[0]), np.sin(first[0])])
    middle = knee + length[1] / 2 * np.array([np.cos(first[1]), np.sin(first[1])])
    links = [
        mbd.Body("upper", mass=mass[0], inertia=mass[0] * length[0] ** 2 / 12, pose=(*(knee / 2), first[0])),
        mbd.Body("fore", mass=mass[1], inertia=mass[1] * length[1] ** 2 / 12, pose=(*middle, first[1])),
    ]
    joints = [
        mbd.Revolute("shoulder", mbd.ground.at(0, 0), links[0].at(-length[0] / 2, 0)),
        mbd.Revolute("elbow", links[0].at(length[0] / 2, 0), links[1].at(-length[1] / 2, 0)),
    ]
    motors = [mbd.Torque("motor 0", links[0], torques[0]), mbd.Torque("motor 1", links[1], torques[1], links[0])]
    mechanism = mbd.Mechanism(links, joints, forces=motors, inputs=torques)
    rest = [link.omega == 0 for link in links]
    start, goal = ([link.phi == value for link, value in zip(links, values, strict=True)] for values in (first, last))
    problem = fastest(mechanism, 10.0, [*start, *rest], [*goal, *rest])
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u", 2)
    coupling = mass[1] * length[0] * length[1] / 2
    own = mass[0] * length[0] ** 2 / 3 + mass[1] * length[0] ** 2, mass[1] * length[1] ** 2 / 3
    cross, turn = coupling * ca.cos(x[0] - x[1]), coupling * ca.sin(x[0] - x[1])
    inertia = ca.blockcat([[own[0], cross], [cross, own[1]]])
    loads = ca.vertcat(u[0] - u[1] - turn * x[3] ** 2, u[1] + turn * x[2] ** 2)
    rates = ca.vertcat(x[2:], ca.solve(inertia, loads))
    quantities = ca.vertcat(*[link.phi for link in links], *[link.omega for link in links])
    return Case(problem, quantities, x, u, rates, [*first, 0, 0], [*last, 0, 0])


def crank(random: np.random.Generator) -> Case:
    """A crank with a flywheel drives a ram by a massless rod through most of a turn, with limited torque and power."""
    radius, mass, inertia = random.uniform(0.05, 0.15), random.uniform(2, 8), random.uniform(0.01, 0.05)
    rod, angle = radius * random.uniform(2.5, 4), random.uniform(3, 5.5)
    peak = random.uniform(1, 4)
    power = peak * random.uniform(3, 6)
    torque = mbd.Input("tau", lower=-peak, upper=peak)
    wheel = mbd.Body("wheel", mass=1.0, inertia=inertia)
    ram = mbd.Body("ram", mass=mass, inertia=0.1, pose=(radius + rod, 0, 0))
    joints = [
        mbd.Revolute("shaft", mbd.ground.at(0, 0), wheel.at(0, 0)),
        mbd.Translational("guide", mbd.ground.at(0, 0), ram.at(0, 0)),
        mbd.Distance("rod", wheel.at(radius, 0), ram.at(0, 0), rod),
    ]
    motor = mbd.Torque("motor", wheel, torque)
    mechanism = mbd.Mechanism([wheel, ram], joints, forces=[motor], inputs=[torque])
    start, goal = [wheel.phi == 0, wheel.omega == 0], [wheel.phi == angle, wheel.omega == 0]
    path = [torque * wheel.omega <= power]
    problem = fastest(mechanism, 10.0, start, goal, path=path)
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    place = radius * ca.cos(x[0]) + ca.sqrt(rod**2 - (radius * ca.sin(x[0])) ** 2)
    moment = inertia + mass * ca.jacobian(place, x[0]) ** 2
    rates = ca.vertcat(x[1], (u - ca.jacobian(moment, x[0]) * x[1] ** 2 / 2) / moment)
    limits = [(u * x[1] - power) / power]
    quantities = ca.vertcat(wheel.phi, wheel.omega)
    return Case(problem, quantities, x, u, rates, [0, 0], [angle, 0], limits=limits, is_linear=True)


def motor(random: np.random.Generator) -> Case:
    """A motor turns a wheel from rest to rest, with limited voltage and current."""
    inertia, angle, volts = random.uniform(0.005, 0.02), random.uniform(3, 12), random.uniform(12, 36)
    constant, resistance, inductance = random.uniform(0.1, 0.3), random.uniform(0.5, 2), random.uniform(0.005, 0.03)
    most = random.uniform(0.4, 0.8) * volts / resistance
    voltage = mbd.Input("V", lower=-volts, upper=volts)
    wheel = mbd.Body("wheel", mass=1.0, inertia=inertia)
    shaft = mbd.Revolute("shaft", mbd.ground.at(0, 0), wheel.at(0, 0))
    drive = mbd.DCMotor("motor", wheel, voltage, constant=constant, resistance=resistance, inductance=inductance)
    mechanism = mbd.Mechanism([wheel], [shaft], forces=[drive], inputs=[voltage])
    still = [wheel.omega == 0, drive.current == 0]
    path = [mbd.bounded(-most, drive.current, most)]
    problem = fastest(mechanism, 5.0, [wheel.phi == 0, *still], [wheel.phi == angle, *still], path=path)
    x, u = ca.SX.sym("x", 3), ca.SX.sym("u")
    rates = ca.vertcat(x[1], constant * x[2] / inertia, (u - resistance * x[2] - constant * x[1]) / inductance)
    quantities = ca.vertcat(wheel.phi, wheel.omega, drive.current)
    return Case(problem, quantities, x, u, rates, [0, 0, 0], [angle, 0, 0], [np.inf, np.inf, most])


def swing_up(random: np.random.Generator) -> Case:
    """A pendulum is swung up by a torque that is less than its weight's."""
    mass, length = random.uniform(0.5, 2), random.uniform(0.3, 1)
    weight = mass * GRAVITY * length
    limits = weight * random.uniform(0.35, 0.8, 2)
    torque = mbd.Input("tau", lower=-limits[0], upper=limits[1])
    bob = mbd.Body("bob", mass=mass, inertia=0.01, pose=(0, -length, 0))
    pivot = mbd.Revolute("pivot", mbd.ground.at(0, 0), bob.at(0, length))
    motor = mbd.Torque("motor", bob, torque)
    mechanism = mbd.Mechanism([bob], [pivot], forces=[mbd.Gravity(), motor], inputs=[torque])
    problem = fastest(mechanism, 10.0, [bob.phi == 0, bob.omega == 0], [bob.phi == np.pi, bob.omega == 0])
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    rates = ca.vertcat(x[1], (u - weight * ca.sin(x[0])) / (mass * length**2 + 0.01))
    return Case(problem, ca.vertcat(bob.phi, bob.omega), x, u, rates, [0, 0], [np.pi, 0])


FAMILIES: dict[str, Callable[[np.random.Generator], Case]] = {
    "crane, speed": crane_speed,
    "crane, unlike forces": crane_unlike,
    "crane, swing": crane_swing,
    "elastic": elastic,
    "sprung block": sprung,
    "arm": arm,
    "crank, power": crank,
    "motor, current": motor,
    "swing-up": swing_up,
}


# --- references -----------------------------------------------------------------------------------
def reference(case: Case, solution: mbd.Solution) -> float:
    """Least time by meshes of equal intervals, of which the first one begins at a solution."""
    duration, inputs = solution.duration, ca.vertcat(*solution.problem.mechanism.inputs)
    times = np.linspace(0, duration, 4001)
    motion = solution.trajectory.at(times)
    states, efforts = (motion[values].reshape(times.size, -1).T for values in (case.quantities, inputs))
    found = []
    for count in MESHES:
        at = np.linspace(0, duration, count + 1)
        guess = [np.array([np.interp(at, times, row) for row in rows]) for rows in (states, efforts)]
        duration, states, efforts = on_mesh(case, count, *guess, duration)
        times = np.linspace(0, duration, count + 1)
        found.append(duration)
    coarse, fine = found
    return fine - (coarse - fine) / ((MESHES[1] / MESHES[0]) ** 2 - 1)


def on_mesh(
    case: Case, count: int, states: np.ndarray, efforts: np.ndarray, duration: float
) -> tuple[float, np.ndarray, np.ndarray]:
    """Least time on a mesh of equal intervals; duration, states and inputs at mesh points from those of a guess."""
    n, m = states.shape[0], efforts.shape[0]
    unknowns = [ca.MX.sym("x", n, count + 1), *(ca.MX.sym("u", m, count) for _ in range(1 + case.is_linear))]
    time = ca.MX.sym("t")
    x, first, last = unknowns[0], unknowns[1], unknowns[-1]
    ends, *sides = step_of(case).map(count)(x[:, :-1], first, last, time / count)
    equations, limits = ca.vec(x[:, 1:] - ends), ca.veccat(*sides)
    program = {"x": ca.veccat(*unknowns, time), "f": time, "g": ca.vertcat(equations, limits)}
    solver = ca.nlpsol("fine", "ipopt", program, OPTIONS)

    lower, upper = (np.tile(np.array(side, float)[:, None], count + 1) for side in case.bounds)
    for k, state in ((0, case.start), (-1, case.goal)):
        lower[:, k] = upper[:, k] = state
    symbols, courses = case.problem.mechanism.inputs, len(unknowns) - 1
    least, most = ([getattr(s, side) for s in symbols] * (courses * count) for side in ("lower", "upper"))
    guess = [states, *[efforts[:, :-1], efforts[:, 1:]][:courses]]
    answer = solver(
        x0=np.r_[np.concatenate([part.ravel(order="F") for part in guess]), duration],
        lbx=np.r_[lower.ravel(order="F"), least, 1e-3],
        ubx=np.r_[upper.ravel(order="F"), most, 100.0],
        lbg=np.r_[np.zeros(equations.numel()), np.full(limits.numel(), -np.inf)],
        ubg=0.0,
    )
    if not solver.stats()["success"]:
        raise RuntimeError(f"no reference on {count} intervals: {solver.stats()['return_status']}")
    found = answer["x"].full().ravel()
    states, inputs = found[: states.size].reshape(n, -1, order="F"), found[states.size :][: m * count]
    inputs = inputs.reshape(m, -1, order="F")
    return float(found[-1]), states, np.hstack([inputs, inputs[:, -1:]])


def step_of(case: Case) -> ca.Function:
    """One step: ``(x, u at its start, u at its end, h) -> (x at its end, limits at its start, limits at its end)``."""
    x, h = case.x, ca.SX.sym("h")
    first, last = ca.SX.sym("a", case.u.numel()), ca.SX.sym("b", case.u.numel())
    rates = ca.Function("rates", [case.x, case.u], [case.rates])
    limits = ca.Function("limits", [case.x, case.u], [ca.vertcat(ca.SX(0, 1), *case.limits)])
    middle = (first + last) / 2
    k1 = rates(x, first)
    k2 = rates(x + h / 2 * k1, middle)
    k3 = rates(x + h / 2 * k2, middle)
    k4 = rates(x + h * k3, last)
    end = x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return ca.Function("step", [x, first, last, h], [end, limits(x, first), limits(end, last)])


# --- the table ------------------------------------------------------------------------------------
def solved(problem: mbd.OptimalControlProblem, **options: float) -> tuple[mbd.Solution, float, list[str]]:
    """A solution, seconds of the processor, and warnings."""
    began = time.process_time()
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        try:
            solution = mbd.optimize(problem, **options)
            said = [str(w.message) for w in told]
        except mbd.OptimizationError as error:
            solution, said = error.partial, [f"FAILED: {error}"]
    return solution, time.process_time() - began, said


def main(count: int = 1, seed: int = 20261123, tolerance: float = 1e-5) -> None:
    """Solve all and print the table."""
    given = f"tolerance={tolerance:g}"
    print(f"| problem | least time, s | without | error | s | {given} | error | s | meshes | intervals | told |")
    print("|---|---|---|---|---|---|---|---|---|---|---|")
    for number, (name, make) in enumerate(FAMILIES.items()):
        for k in range(count):
            case = make(np.random.default_rng([seed, number, k]))
            plain, seconds, _ = solved(case.problem)
            best = reference(case, plain)
            fine, more, said = solved(case.problem, tolerance=tolerance)
            costs = [f"{s.cost:.7g} | {s.cost / best - 1:+.1e} | {t:.1f}" for s, t in ((plain, seconds), (fine, more))]
            size = f"{len(fine.statistics.passes)} | {fine.mesh.size - 1}"
            print(f"| {name} {k} | {best:.7g} | {' | '.join(costs)} | {size} | {'; '.join(said)} |", flush=True)


if __name__ == "__main__":
    main(*(kind(x) for kind, x in zip((int, int, float), sys.argv[1:], strict=False)))
