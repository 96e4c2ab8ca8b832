"""Time and cost of model-predictive control beside other packages, with explicit equations.

A cart with a pole that stands up: each controller is asked every 0.05 s for the force of the next sample, from 20
starts, and the same explicit equations, integrated by small steps of Runge and Kutta, answer. The others are told
these equations; mbdcasadi derives its own of two bodies and two joints.

    python benchmarks/controllers.py

Packages that are not installed are left out: ``pip install do-mpc tinympc opengen`` (opengen compiles Rust, and fetches
crates). TinyMPC is linear: it is given the equations about the pose that stands up, and takes the cost to go without
end for its last state.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from machine import describe, one_thread, versions

one_thread()

import casadi as ca  # noqa: E402
import numpy as np  # noqa: E402
from scipy.linalg import expm  # noqa: E402

import mbdcasadi as mbd  # noqa: E402

SAMPLE, INTERVALS, STEPS, FORCE = 0.05, 20, 60, 10.0
CART, BOB, LENGTH, GRAVITY = 1.0, 0.3, 0.5, 9.81
#: What our states have more than (x, lean, v, omega): angles count from the rail.
UPRIGHT = np.array([0, np.pi / 2, 0, 0])
#: Weights of (x, lean, v, omega) and of the force; the last state counts five times.
WEIGHTS, EFFORT, LAST = np.array([5.0, 10.0, 1.0, 1.0]), 0.01, 5.0


def rates(x: Any, u: Any, module: Any = ca) -> list[Any]:
    """Rates of the state (place, lean, speed, rate of the lean), positive to the left, by the force."""
    _, lean, v, omega = (x[k] for k in range(4))
    s, c = module.sin(lean), module.cos(lean)
    push = (u - BOB * LENGTH * omega**2 * s + BOB * GRAVITY * s * c) / (CART + BOB * s**2)
    return [v, omega, push, (GRAVITY * s + push * c) / LENGTH]


def step_of(count: int = 2) -> ca.Function:
    """A sample by Runge and Kutta: ``(x, u) -> (x, cost)``."""
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u")
    whole = ca.vertcat(x, 0)

    def rate(y: ca.SX) -> ca.SX:
        return ca.vertcat(*rates(y, u), cost_of(y, u))

    h = SAMPLE / count
    for _ in range(count):
        k1 = rate(whole)
        k2 = rate(whole + h / 2 * k1)
        k3 = rate(whole + h / 2 * k2)
        whole += h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(whole + h * k3))
    return ca.Function("step", [x, u], [whole[:4], whole[4]])


def cost_of(x: Any, u: Any) -> Any:
    """Running cost."""
    return sum(WEIGHTS[k] * x[k] ** 2 for k in range(4)) + EFFORT * u**2


class Peer(ABC):
    """A controller of the cart.

    Attributes
    ----------
    name, package : str
        As printed, and as it is imported.
    """

    name: str
    package: str

    def __init__(self) -> None:
        began = time.perf_counter()
        self.prepare()
        self.set_up = time.perf_counter() - began

    @abstractmethod
    def prepare(self) -> None:
        """Compile what is compiled once."""

    @abstractmethod
    def begin(self, x: np.ndarray) -> None:
        """Forget the last motion."""

    @abstractmethod
    def force(self, x: np.ndarray) -> float:
        """Force in a state."""


class OurController(Peer):
    """One Newton step of the program a sample, compiled C."""

    name, package = "mbdcasadi", "mbdcasadi"
    iterations = 1

    def prepare(self) -> None:
        force = mbd.Input("force", lower=-FORCE, upper=FORCE)
        cart = mbd.Body("cart", mass=CART, inertia=0.0)
        bob = mbd.Body("bob", mass=BOB, inertia=0.0, pose=(0, LENGTH, np.pi / 2))
        rail = mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0))
        pole = mbd.Revolute("pole", cart.at(0, 0), bob.at(-LENGTH, 0))
        loads = [mbd.Gravity(), mbd.Force("drive", cart.at(0, 0), (force, 0))]
        model = mbd.Mechanism([cart, bob], [rail, pole], forces=loads, inputs=[force])
        x = [cart.x, bob.phi - np.pi / 2, cart.vx, bob.omega]
        plan = mbd.OptimalControlProblem(
            model,
            duration=SAMPLE * INTERVALS,
            running_cost=cost_of(x, force),
            terminal_cost=LAST * mbd.at_end(cost_of(x, 0)),
        )
        self._controller = mbd.Controller(plan, sample=SAMPLE, intervals=INTERVALS, iterations=self.iterations)

    def begin(self, x: np.ndarray) -> None:
        self._controller.reset()

    def force(self, x: np.ndarray) -> float:
        return float(self._controller.step(x + UPRIGHT).inputs[0])


class OurConverged(OurController):
    """The same until the plan has converged."""

    name, iterations = "mbdcasadi, iterations=20", 20


class DoMPC(Peer):
    """Collocation on finite elements, by IPOPT."""

    name, package = "do-mpc", "do_mpc"

    def prepare(self) -> None:
        import do_mpc

        model = do_mpc.model.Model("continuous", "SX")
        x = [model.set_variable("_x", name) for name in ("x", "lean", "v", "omega")]
        u = model.set_variable("_u", "force")
        for name, rate in zip(("x", "lean", "v", "omega"), rates(x, u), strict=True):
            model.set_rhs(name, rate)
        model.setup()
        mpc = self._mpc = do_mpc.controller.MPC(model)
        mpc.settings.n_horizon, mpc.settings.t_step = INTERVALS, SAMPLE
        mpc.settings.store_full_solution = False
        mpc.settings.supress_ipopt_output()
        mpc.set_rterm(force=0.0)
        mpc.set_objective(mterm=LAST * cost_of(x, 0), lterm=SAMPLE * cost_of(x, u))
        mpc.bounds["lower", "_u", "force"], mpc.bounds["upper", "_u", "force"] = -FORCE, FORCE
        mpc.setup()

    def begin(self, x: np.ndarray) -> None:
        self._mpc.reset_history()
        self._mpc.x0 = x
        self._mpc.u0 = np.zeros(1)
        self._mpc.set_initial_guess()

    def force(self, x: np.ndarray) -> float:
        return float(self._mpc.make_step(x.reshape(4, 1))[0, 0])


class TinyMPC(Peer):
    """ADMM for linear equations, compiled."""

    name, package = "TinyMPC (linear)", "tinympc"

    def prepare(self) -> None:
        import tinympc

        x, u = ca.SX.sym("x", 4), ca.SX.sym("u")
        slopes = ca.Function("slopes", [x, u], [ca.jacobian(ca.vertcat(*rates(x, u)), ca.vertcat(x, u))])
        whole = np.zeros((5, 5))
        whole[:4] = slopes(0, 0).full()
        both = expm(SAMPLE * whole)[:4]
        a, b = np.ascontiguousarray(both[:, :4]), np.ascontiguousarray(both[:, 4:])
        q, r = np.diag(2 * SAMPLE * WEIGHTS), np.array([[2 * SAMPLE * EFFORT]])
        self._solver = tinympc.TinyMPC()
        self._solver.setup(a, b, q, r, INTERVALS + 1, rho=r.item(), max_iter=1000, abs_pri_tol=1e-4, abs_dua_tol=1e-4)
        self._solver.set_bound_constraints(
            np.full((4, INTERVALS + 1), -1e17), np.full((4, INTERVALS + 1), 1e17),
            np.full((1, INTERVALS), -FORCE), np.full((1, INTERVALS), FORCE),
        )  # fmt: skip

    def begin(self, x: np.ndarray) -> None:
        self._solver.set_x0(np.zeros(4))

    def force(self, x: np.ndarray) -> float:
        self._solver.set_x0(x)
        return float(np.clip(np.ravel(self._solver.solve()["controls"])[0], -FORCE, FORCE))


class OpEn(Peer):
    """Single shooting by PANOC, generated as Rust."""

    name, package = "OpEn", "opengen"

    def prepare(self) -> None:
        import opengen as og

        start, u = ca.SX.sym("start", 4), ca.SX.sym("u", INTERVALS)
        step, x, total = step_of(1), start, ca.SX(0)
        for k in range(INTERVALS):
            x, cost = step(x, u[k])
            total += cost
        total += LAST * cost_of(x, 0)
        bounds = og.constraints.Rectangle([-FORCE] * INTERVALS, [FORCE] * INTERVALS)
        problem = og.builder.Problem(u, start, total).with_constraints(bounds)
        self._folder = tempfile.TemporaryDirectory()
        build = og.config.BuildConfiguration().with_build_directory(self._folder.name).with_build_mode("release")
        build = build.with_build_python_bindings()
        meta = og.config.OptimizerMeta().with_optimizer_name("cart_pole")
        settings = og.config.SolverConfiguration().with_tolerance(1e-5)
        og.builder.OpEnOptimizerBuilder(problem, meta, build, settings).build()
        sys.path.insert(0, str(Path(self._folder.name) / "cart_pole"))
        import cart_pole

        self._solver = cart_pole.solver()
        self._last = np.zeros(INTERVALS)

    def begin(self, x: np.ndarray) -> None:
        self._last = np.zeros(INTERVALS)

    def force(self, x: np.ndarray) -> float:
        found = np.array(self._solver.run(p=x.tolist(), initial_guess=self._last.tolist()).solution)
        self._last = np.append(found[1:], found[-1])
        return float(found[0])


def measure(peer: Peer, starts: np.ndarray, plant: ca.Function) -> tuple[np.ndarray, np.ndarray, int]:
    """Times of all steps, s, costs of the motions, and how many have come to rest at the end."""
    times, costs, resting = [], [], 0
    for start in starts:
        x, total = start.copy(), 0.0
        peer.begin(x)
        for _ in range(STEPS):
            began = time.process_time()  # which other work on the machine does not change
            u = peer.force(x)
            times.append(time.process_time() - began)
            after, cost = plant(x, u)
            x, total = after.full().ravel(), total + float(cost)
        costs.append(total)
        resting += bool(np.all(np.abs(x) < 0.05))
    return np.array(times), np.array(costs), resting


@contextmanager
def quiet() -> Iterator[None]:
    """Let nothing be printed, also by compiled code and other programs."""
    sys.stdout.flush()
    kept = [os.dup(stream) for stream in (1, 2)]
    with Path(os.devnull).open("w") as nowhere:
        for stream in (1, 2):
            os.dup2(nowhere.fileno(), stream)
        try:
            yield
        finally:
            sys.stdout.flush()
            for stream, own in zip((1, 2), kept, strict=True):
                os.dup2(own, stream)
                os.close(own)


def main(peers: tuple[Callable[[], Peer], ...] = (OurController, OurConverged, DoMPC, TinyMPC, OpEn)) -> None:
    """Print the table."""
    print(describe(), versions("do-mpc", "tinympc", "opengen"))
    random = np.random.default_rng(1)
    starts = random.uniform(-1, 1, (20, 4)) * [0.2, 0.25, 0.2, 0.5]
    plant = step_of(50)
    print(f"{'':26s} {'median':>9s} {'99 %':>9s} {'mean cost':>10s} {'at rest':>8s} {'set-up':>8s}")
    for make in peers:
        if find_spec(make.package) is None:  # type: ignore[attr-defined]
            print(f"{make.name:26s} is not installed")  # type: ignore[attr-defined]
            continue
        try:
            with quiet():
                peer = make()
                times, costs, resting = measure(peer, starts, plant)
        except Exception as error:  # another package: what it says is the result
            print(f"{make.name:26s} cannot be set up: {type(error).__name__} {str(error)[:80]}")  # type: ignore[attr-defined]
            continue
        median, late = np.percentile(1e3 * times, [50, 99])
        print(
            f"{peer.name:26s} {median:6.3f} ms {late:6.3f} ms {np.mean(costs):10.4f} {resting:4d}/{len(starts)} "
            f"{peer.set_up:6.1f} s"
        )


if __name__ == "__main__":
    main()
