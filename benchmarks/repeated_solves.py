"""Problems solved again and again, beside hand-written CasADi programs: estimation over a moving horizon, control.

    python benchmarks/repeated_solves.py
    python benchmarks/repeated_solves.py crane --solves 60 --readme

The programs by hand have the same transcription, options and warm starts; equations are in two coordinates or one,
derived on paper. Both are solved in turn, sample by sample; seconds of the processor, medians.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from typing import Any

from machine import describe, into_readme, machine, one_thread

one_thread()

import casadi as ca  # noqa: E402  (after the threads are set)
import numpy as np  # noqa: E402

import mbdcasadi as mbd  # noqa: E402
from mbdcasadi.optimal_control.solve.solvers.ipopt import DEFAULTS, WARM_START  # noqa: E402

RESULTS = Path(__file__).parent / "results"
GRAVITY = 9.81
#: Solves that are not counted: the first ones build the programs and their solvers.
BUILDING = 3


@dataclass
class Solve:
    """One solve: seconds of the processor, iterations, and what was asked for."""

    seconds: float
    iterations: int
    value: float


# --- collocation by hand --------------------------------------------------------------------------------
class ByHand:
    """Gauss-Legendre collocation with three stages, for ``q'' = f(q, v, u, p)`` and an input constant by interval.

    Variables are ``q, v`` of each mesh point with ``a, u`` of the interval after it, then the parameters.
    """

    def __init__(self, count: int, step: float, n: int, n_u: int, n_p: int):
        self.count, self.step, self.n, self.n_u = count, step, n, n_u
        self.stages = np.array(ca.collocation_points(3, "legendre"))
        lagrange = [np.poly1d(np.poly(np.delete(self.stages, j))) for j in range(3)]
        lagrange = [p / p(tau) for p, tau in zip(lagrange, self.stages, strict=True)]
        self.once, self.twice = ([p.integ(k) for p in lagrange] for k in (1, 2))
        self.weights = np.array([p(1.0) for p in self.once])
        self.stride = 5 * n + n_u
        self.x = ca.SX.sym("x", count * self.stride + 2 * n + n_p)
        self.p = self.x[self.x.numel() - n_p :]
        self.rows: list[ca.SX] = []
        self.limits: list[ca.SX] = []

    def point(self, k: int) -> tuple[ca.SX, ca.SX]:
        """Coordinates and velocities of a mesh point."""
        first = k * self.stride
        return self.x[first : first + self.n], self.x[first + self.n : first + 2 * self.n]

    def inner(self, k: int) -> tuple[ca.SX, ca.SX]:
        """Accelerations at the stages (n, 3) and inputs of an interval."""
        first = k * self.stride + 2 * self.n
        a = ca.reshape(self.x[first : first + 3 * self.n], self.n, 3)
        return a, self.x[first + 3 * self.n : first + 3 * self.n + self.n_u]

    def at(self, k: int, tau: float) -> tuple[ca.SX, ca.SX]:
        """Coordinates and velocities inside an interval."""
        (q, v), (a, _), h = self.point(k), self.inner(k), self.step
        once, twice = (ca.DM([p(tau) for p in polynomials]) for polynomials in (self.once, self.twice))
        return q + h * tau * v + h**2 * a @ twice, v + h * a @ once

    def solver(self, residual: Callable, cost: ca.SX, data: ca.SX, limit: Callable | None = None) -> None:
        """Make the solvers, for a warm start and for one with multipliers."""
        rows = []
        for k in range(self.count):
            (a, u), end = self.inner(k), self.at(k, 1.0)
            for j, tau in enumerate(self.stages.tolist()):
                rows.append(residual(*self.at(k, tau), a[:, j], u, self.p))
            rows += [x - y for x, y in zip(self.point(k + 1), end, strict=True)]
        equalities = ca.vertcat(*rows)
        #: rows of each interval, equalities and limits
        self.blocks = [equalities.numel() // self.count]
        places = [] if limit is None else [(k, t) for k in range(self.count) for t in [*self.stages.tolist(), 1.0]]
        limits = ca.vertcat(ca.SX(0, 1), *[limit(*self.at(k, t)) for k, t in places])
        self.blocks.append(limits.numel() // self.count)
        self.row_lower = np.r_[np.zeros(equalities.numel()), np.full(limits.numel(), -np.inf)]
        nlp = {"x": self.x, "p": data, "f": cost, "g": ca.vertcat(equalities, limits)}
        options = {"print_time": False, "show_eval_warnings": False, "error_on_fail": False}
        self.solvers = {
            how: ca.nlpsol("by_hand", "ipopt", nlp, options | DEFAULTS | WARM_START[how]) for how in ("cold", "hot")
        }

    def solve(self, x: np.ndarray, lower: np.ndarray, upper: np.ndarray, data: np.ndarray, last: dict | None) -> dict:
        """Solve from variables, and from the multipliers of the last solution if there is one."""
        arguments = {"lbx": lower, "ubx": upper, "lbg": self.row_lower, "ubg": 0.0, "p": data}
        arguments["x0"] = np.clip(x, lower, upper)
        if last is not None:
            arguments |= {"lam_x0": last["lam_x"], "lam_g0": last["lam_g"]}
        solver = self.solvers["cold" if last is None else "hot"]
        answer = {name: value.full().ravel() for name, value in solver(**arguments).items()}
        stats = solver.stats()
        assert stats["success"], stats["return_status"]
        return answer | {"iterations": stats["iter_count"]}

    def shifted(self, last: dict) -> dict:
        """Variables and multipliers one interval later; the last interval stays, from the last point on."""
        later, end = last | {name: last[name].copy() for name in ("x", "lam_x", "lam_g")}, self.count * self.stride
        for name in ("x", "lam_x"):
            later[name][: end - self.stride] = last[name][self.stride : end]
            later[name][end - self.stride : end - self.stride + 2 * self.n] = last[name][end : end + 2 * self.n]
        first = 0
        for rows in self.blocks:
            following = first + self.count * rows
            later["lam_g"][first : following - rows] = last["lam_g"][first + rows : following]
            first = following
        return later


# --- estimation over a moving horizon -------------------------------------------------------------------
class Pendulum:
    """Angle and damping of a pendulum, from the last 201 noisy samples of its angle."""

    name = "pendulum, 200 samples"
    count, step, noise, damping = 200, 0.02, 0.01, 0.25
    mass, length, inertia = 1.0, 0.5, 1 / 12

    def __init__(self, solves: int):
        self.solves = solves
        self.bar = bar = mbd.Body("bar", self.mass, self.inertia, pose=(0.3, -0.4, -0.9))
        self.b = b = mbd.Parameter("b", 0.1, lower=0, upper=2)
        self.angle = mbd.Input("measured angle")
        pin = mbd.Revolute("pin", mbd.ground.at(0, 0), bar.at(-self.length, 0))
        self.model = mbd.Mechanism(
            [bar],
            [pin],
            forces=[mbd.Gravity(), mbd.Torque("damper", bar, -b * bar.omega)],
            inputs=[self.angle],
            parameters=[b],
        )
        times = self.step * np.arange(self.count + solves + 1)
        truth = mbd.simulate(self.model, times, initial=[bar.phi == -0.2, bar.omega == 0], parameters={b: self.damping})
        self.measured = truth[bar.phi] + self.noise * np.random.default_rng(0).standard_normal(times.size)

    def by_package(self) -> Iterator[Solve]:
        """Solve horizon after horizon."""
        bar, b, count = self.bar, self.b, self.count
        times, error = self.step * np.arange(count + 1), (bar.phi - self.angle) ** 2
        problem = mbd.OptimalControlProblem(
            self.model,
            float(times[-1]),
            waypoints=[mbd.Waypoint(t, cost=error) for t in times[1:-1]],
            terminal_cost=error + mbd.at_start(error),
            free_parameters=[b],
        )
        start = [bar.phi == self.measured[0], bar.omega == 0]
        guess: Any = mbd.simulate(self.model, times, initial=start)
        for k in range(self.solves):
            measured = {self.angle: self.measured[k : k + count + 1]}
            began = time.process_time()
            solution = mbd.optimize(problem, intervals=count, guess=guess, inputs=measured)
            guess = solution.shifted(self.step)
            yield Solve(time.process_time() - began, solution.statistics.iterations, solution.parameters[b])

    def by_hand(self) -> Iterator[Solve]:
        """Solve horizon after horizon."""
        program = ByHand(self.count, self.step, 1, 0, 1)
        data = ca.SX.sym("y", self.count + 1)
        about_pin = self.inertia + self.mass * self.length**2

        def residual(q: ca.SX, v: ca.SX, a: ca.SX, _u: ca.SX, p: ca.SX) -> ca.SX:
            return about_pin * a + p * v + self.mass * GRAVITY * self.length * ca.cos(q)

        cost = sum((program.point(k)[0] - data[k]) ** 2 for k in range(self.count + 1))
        program.solver(residual, cost, data)
        x, later = np.zeros(program.x.numel()), None
        x[: -1 : program.stride], x[-1] = self.measured[: self.count + 1], 0.1
        free = np.full(x.size, np.inf)
        lower, upper = np.r_[-free[1:], 0.0], np.r_[free[1:], 2.0]
        for k in range(self.solves):
            began = time.process_time()
            last = program.solve(x, lower, upper, self.measured[k : k + self.count + 1], later)
            later = program.shifted(last)
            x = later["x"]
            yield Solve(time.process_time() - began, last["iterations"], float(last["x"][-1]))


# --- model-predictive control ---------------------------------------------------------------------------
class Crane:
    """Force on the trolley of a crane by plans over 1.5 s, of which the first 0.05 s are carried out."""

    name = "crane, 30 intervals"
    count, step = 30, 0.05
    trolley, load, rope, force, swing = 2.0, 1.0, 1.0, 15.0, 0.25

    def __init__(self, solves: int):
        self.solves = solves
        self.u = u = mbd.Input("F", lower=-self.force, upper=self.force)
        self.car = car = mbd.Body("car", mass=self.trolley, inertia=1)
        self.bob = bob = mbd.Body("load", mass=self.load, inertia=0, pose=(0, -1, -np.pi / 2))
        rail = mbd.Translational("rail", mbd.ground.at(0, 0), car.at(0, 0))
        hang = mbd.Revolute("hang", car.at(0, 0), bob.at(-self.rope, 0))
        push = mbd.Force("F", car.at(0, 0), (u, 0))
        self.model = mbd.Mechanism([car, bob], [rail, hang], forces=[mbd.Gravity(), push], inputs=[u])
        # the plant is pushed by some wind that the plans do not know
        self.wind = 0.3 * np.random.default_rng(1).standard_normal(solves)

    def accelerations(self, q: Any, v: Any, force: Any, push: float = 0.0) -> np.ndarray:
        """Of the plant: trolley and swing."""
        m, s, c = self.load, np.sin(q[1]), np.cos(q[1])
        matrix = np.array([[self.trolley + m, m * self.rope * c], [c, self.rope]])
        return np.linalg.solve(matrix, [force + m * self.rope * s * v[1] ** 2, -GRAVITY * s + push])

    def after(self, state: np.ndarray, force: float, k: int) -> np.ndarray:
        """State of the plant a sample later, by ten steps of Runge and Kutta."""

        def rate(y: np.ndarray) -> np.ndarray:
            return np.r_[y[2:], self.accelerations(y[:2], y[2:], force, self.wind[k])]

        h = self.step / 10
        for _ in range(10):
            k1 = rate(state)
            k2 = rate(state + h / 2 * k1)
            k3 = rate(state + h / 2 * k2)
            state = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(state + h * k3))
        return state

    def by_package(self) -> Iterator[Solve]:
        """Plan, and carry out."""
        car, bob, u, turn = self.car, self.bob, self.u, self.bob.phi + np.pi / 2
        problem = mbd.OptimalControlProblem(
            self.model,
            self.step * self.count,
            initial=[car.x == 0, car.vx == 0, bob.phi == -np.pi / 2, bob.omega == 0],
            path=[mbd.bounded(-self.swing, turn, self.swing)],
            running_cost=10 * (car.x - 1) ** 2 + car.vx**2 + 5 * turn**2 + 0.01 * u**2,
        )
        state, guess = np.zeros(4), None
        for k in range(self.solves):
            x, angle, vx, rate = state
            start = [car.x == x, car.vx == vx, bob.phi == angle - np.pi / 2, bob.omega == rate]
            begin = mbd.assemble(self.model, start)
            began = time.process_time()
            plan = mbd.optimize(problem, initial=begin, guess=guess, intervals=self.count, control="constant")
            force, guess = float(plan.inputs[u](0.0)), plan.shifted(self.step)
            yield Solve(time.process_time() - began, plan.statistics.iterations, force)
            state = self.after(state, force, k)

    def by_hand(self) -> Iterator[Solve]:
        """Plan, and carry out."""
        program = ByHand(self.count, self.step, 2, 1, 0)

        def residual(q: ca.SX, v: ca.SX, a: ca.SX, u: ca.SX, _p: ca.SX) -> ca.SX:
            m, s, c = self.load, ca.sin(q[1]), ca.cos(q[1])
            along = (self.trolley + m) * a[0] + m * self.rope * (a[1] * c - v[1] ** 2 * s) - u
            return ca.vertcat(along, c * a[0] + self.rope * a[1] + GRAVITY * s)

        cost = ca.SX(0)
        for k in range(self.count):
            u = program.inner(k)[1]
            for weight, tau in zip(program.weights.tolist(), program.stages.tolist(), strict=True):
                q, v = program.at(k, tau)
                stage = 10 * (q[0] - 1) ** 2 + v[0] ** 2 + 5 * q[1] ** 2 + 0.01 * u**2
                cost += weight * self.step * stage

        def limit(q: ca.SX, _v: ca.SX) -> ca.SX:
            return ca.vertcat(q[1] - self.swing, -self.swing - q[1])

        program.solver(residual, cost, ca.SX(0, 1), limit)
        x, later = np.zeros(program.x.numel()), None
        free = np.full(x.size, np.inf)
        for k in range(program.count):
            free[(k + 1) * program.stride - 1] = self.force
        state = np.zeros(4)
        for k in range(self.solves):
            began = time.process_time()
            lower, upper = -free, free.copy()
            lower[:4] = upper[:4] = state
            last = program.solve(x, lower, upper, np.zeros(0), later)
            later, force = program.shifted(last), float(last["x"][program.stride - 1])
            x = later["x"]
            yield Solve(time.process_time() - began, last["iterations"], force)
            state = self.after(state, force, k)


PROBLEMS = {"pendulum": Pendulum, "crane": Crane}


def compare(name: str, solves: int) -> dict[str, Any]:
    """Solve in turn, package and hand; medians, and the largest difference of what was found."""
    problem = PROBLEMS[name](solves)
    pairs = list(zip(problem.by_package(), problem.by_hand(), strict=True))
    first, later = pairs[0], pairs[BUILDING:]
    package, hand = (median(pair[side].seconds for pair in later) for side in (0, 1))
    return {
        "problem": problem.name,
        "solves": len(later),
        "first": first[0].seconds,
        "package": package,
        "hand": hand,
        "ratio": package / hand,
        "iterations": [median(pair[side].iterations for pair in later) for side in (0, 1)],
        "difference": max(abs(a.value - b.value) for a, b in later),
    }


def table(rows: list[dict[str, Any]]) -> str:
    """The comparison as Markdown."""
    lines = [
        "| | by hand, ms | mbdcasadi, ms | ratio | iterations by hand, mbdcasadi | largest difference |",
        "|---|---:|---:|---:|---:|---:|",
    ]
    for row in rows:
        hand, package = (1e3 * row[key] for key in ("hand", "package"))
        by_package, by_hand = row["iterations"]
        lines.append(
            f"| {row['problem']} | {hand:.1f} | {package:.1f} | {row['ratio']:.2f} | {by_hand:g}, {by_package:g} "
            f"| {row['difference']:.1e} |"
        )
    return "\n".join(lines)


def main() -> None:
    """Read the arguments, compare, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("problems", nargs="*", metavar="problem", help=f"of {', '.join(PROBLEMS)}; default all")
    parser.add_argument("--solves", type=int, default=40)
    parser.add_argument("--readme", action="store_true", help="put the table into README.md")
    arguments = parser.parse_args()
    rows = [compare(name, arguments.solves) for name in arguments.problems or PROBLEMS]
    text = f"{describe()}; seconds of the processor, medians of {arguments.solves - BUILDING} solves\n\n{table(rows)}"
    print(text)
    RESULTS.joinpath("repeated_solves.json").write_text(json.dumps({"machine": machine(), "rows": rows}, indent=1))
    if arguments.readme:
        into_readme("repeated solves", text)


if __name__ == "__main__":
    main()
