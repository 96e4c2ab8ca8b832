"""The swing-up of a cart-pole in several packages, each in a process of its own.

Nothing but the standard library and NumPy is imported until a method runs, so
that each package may live in an environment of its own:
``optimal_control.py`` starts ``python swing_up.py`` under the interpreter that
has the package, writes one request a line and reads one answer a line (JSON).

A request is ``{"method": name, "size": n}``, with ``n`` the intervals of the
mesh; the answer holds the fields of :class:`Solve`, or ``{"failure": text}``.
With ``"imports": true`` it also reports how long the imports took, s; that
means something in a process that was asked for nothing yet. A request
``{"versions": [package, ...]}`` is answered with their versions.

References
----------
Kelly, An Introduction to Trajectory Optimization, SIAM Review 59 (2017), section 6 and appendix E.
"""

from __future__ import annotations

import contextlib
import importlib
import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from typing import Any

from machine import one_thread, versions

one_thread()

import numpy as np  # noqa: E402

# masses (kg), length of the pole (m), gravity (m/s²), force limit (N), track (m), distance (m), time (s)
CART, BOB, LENGTH, GRAVITY, FORCE, TRACK, DISTANCE, DURATION = 1.0, 0.3, 0.5, 9.81, 20.0, 2.0, 1.0, 2.0
#: Start and end of the state (x, theta from hanging, their rates).
START, END = (0.0, 0.0, 0.0, 0.0), (DISTANCE, np.pi, 0.0, 0.0)
#: IPOPT's tolerance and limit of iterations, for all.
TOLERANCE, ITERATIONS = 1e-8, 3000


@dataclass(frozen=True)
class Solve:
    """One solution from scratch.

    Attributes
    ----------
    build : float
        From the statement of the problem to the call of IPOPT, and from its return to the solution, s.
    solve : float
        Inside IPOPT, with the evaluations of the functions, s.
    processor : float
        Processor time of the whole, with that of child processes (compilers), s.
    iterations : int
        Iterations of IPOPT.
    variables : int
        Unknowns of the nonlinear program.
    cost : float
        Integral of the squared force as the package says it, N²s.
    miss : float
        Largest difference to the final state (m, rad, and these per s) when the force that the package gives is
        applied to the cart-pole by an integrator.
    """

    build: float
    solve: float
    processor: float
    iterations: int
    variables: int
    cost: float
    miss: float


def rates(state: Any, force: Any, sin: Callable, cos: Callable) -> tuple[Any, Any, Any, Any]:
    """Rates of (x, theta, x', theta'); theta is counted from hanging. The functions are those of the package."""
    _, theta, speed, omega = state
    s, c = sin(theta), cos(theta)
    common = CART + BOB * s * s
    acceleration = (LENGTH * BOB * s * omega**2 + force + BOB * GRAVITY * c * s) / common
    angular = -(LENGTH * BOB * c * s * omega**2 + force * c + (CART + BOB) * GRAVITY * s) / (LENGTH * common)
    return speed, omega, acceleration, angular


def replay(pieces: list[tuple[float, float, Callable[[float], float]]]) -> float:
    """Miss of the final state when the force is applied, integrated piece by piece (start, end, force).

    The classical Runge-Kutta method of order four with steps of at most 1 ms: its own error is below 1e-8.
    """
    y = np.array(START)

    def rate(force: float, y: np.ndarray) -> np.ndarray:
        return np.array(rates(y, force, np.sin, np.cos))

    for begin, end, force in pieces:
        steps = max(1, int(np.ceil((end - begin) / 1e-3)))
        h = (end - begin) / steps
        for k in range(steps):
            t = begin + k * h
            now, middle, then = force(t), force(t + h / 2), force(t + h)
            k1 = rate(now, y)
            k2 = rate(middle, y + h / 2 * k1)
            k3 = rate(middle, y + h / 2 * k2)
            k4 = rate(then, y + h * k3)
            y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return float(np.max(np.abs(y - np.array(END))))


def polynomial(times: np.ndarray, values: np.ndarray) -> Callable[[float], float]:
    """Lagrange polynomial through points, in barycentric form."""
    weights = np.array([1 / np.prod(t - np.delete(times, k)) for k, t in enumerate(times)])

    def value(t: float) -> float:
        gap = t - times
        if np.any(np.abs(gap) < 1e-14):
            return float(values[np.argmin(np.abs(gap))])
        terms = weights / gap
        return float(terms @ values / terms.sum())

    return value


class Stopwatch:
    """Wall and processor time since it was made, and the part spent in IPOPT."""

    def __init__(self) -> None:
        self.solving = 0.0
        self._wall, self._cpu = time.perf_counter(), self._processor()

    @staticmethod
    def _processor() -> float:
        children = os.times()  # in steps of a hundredth of a second
        return time.process_time() + children.children_user + children.children_system

    def around(self, function: Callable) -> Callable:
        """Return the function with its time counted as that of IPOPT."""

        def timed(*arguments: Any, **named: Any) -> Any:
            began = time.perf_counter()
            try:
                return function(*arguments, **named)
            finally:
                self.solving += time.perf_counter() - began

        return timed

    def stop(self) -> tuple[float, float, float]:
        """Seconds of building, of solving, of the processor."""
        wall = time.perf_counter() - self._wall
        return wall - self.solving, self.solving, self._processor() - self._cpu


class Watched:
    """A solver whose calls count as time in IPOPT, by the watch of :func:`ipopt_watched`."""

    watch: Stopwatch | None = None

    def __init__(self, solver: Any):
        self._solver = solver

    def __call__(self, *arguments: Any, **named: Any) -> Any:
        solve = self._solver if Watched.watch is None else Watched.watch.around(self._solver)
        return solve(*arguments, **named)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._solver, name)


@contextlib.contextmanager
def ipopt_watched(watch: Stopwatch) -> Iterator[None]:
    """Count calls of the solvers that ``casadi.nlpsol`` makes meanwhile, or made in such a context, as in IPOPT."""
    import casadi as ca

    original, Watched.watch = ca.nlpsol, watch
    ca.nlpsol = lambda *arguments, **named: Watched(original(*arguments, **named))
    try:
        yield
    finally:
        ca.nlpsol, Watched.watch = original, None
    if not watch.solving:
        raise RuntimeError("no solver of casadi.nlpsol was called: the time in IPOPT cannot be measured")


# --- mbdcasadi -----------------------------------------------------------------------------------
def with_mbdcasadi(intervals: int, **options: Any) -> Solve:
    """Bodies and joints in absolute coordinates, default guess; everything from ``Body`` to ``Solution``."""
    import mbdcasadi as mbd

    watch = Stopwatch()
    with ipopt_watched(watch):
        force = mbd.Input("force", lower=-FORCE, upper=FORCE)
        cart = mbd.Body("cart", mass=CART, inertia=0.0)
        bob = mbd.Body("bob", mass=BOB, inertia=0.0, pose=(0, -LENGTH, -np.pi / 2))
        system = mbd.Mechanism(
            bodies=[cart, bob],
            joints=[
                mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0)),
                mbd.Revolute("pole", cart.at(0, 0), bob.at(-LENGTH, 0)),
            ],
            forces=[mbd.Gravity((0, -GRAVITY)), mbd.Force("push", cart.at(0, 0), (force, 0))],
            inputs=[force],
        )
        problem = mbd.OptimalControlProblem(
            system,
            duration=DURATION,
            initial=[cart.x == 0, cart.vx == 0, bob.phi == -np.pi / 2, bob.omega == 0],
            final=[cart.x == DISTANCE, cart.vx == 0, bob.phi == np.pi / 2, bob.omega == 0],
            path=[mbd.bounded(-TRACK, cart.x, TRACK)],
            running_cost=force**2,
        )
        solution = mbd.optimize(problem, intervals=intervals, **options)
        spent = watch.stop()
    mesh = np.asarray(solution.mesh)
    share = 0.5 - 0.5 * np.cos(np.pi * (np.arange(5) + 0.5) / 5)  # inside the intervals: the force may jump between
    inside = mesh[:-1, None] + np.diff(mesh)[:, None] * share
    forces = np.asarray(solution.trajectory.at(inside.ravel())[force]).reshape(inside.shape)
    pieces = [
        (begin, end, polynomial(times, values))
        for begin, end, times, values in zip(mesh[:-1], mesh[1:], inside, forces, strict=True)
    ]
    found = solution.statistics
    return Solve(*spent, found.iterations, found.variables, float(solution.cost), replay(pieces))


# --- yapss -----------------------------------------------------------------------------------------
def with_yapss(segments: int, points: int = 10, spectral_method: str = "lgl") -> Solve:
    """Pseudospectral on segments of ``points`` collocation points; derivatives by CasADi, to second order."""
    from yapss import Problem
    from yapss._private import solver as inside  # its only place where IPOPT is called
    from yapss.math import cos, sin

    watch = Stopwatch()
    ocp = Problem(name="swing-up", nx=[4], nu=[1], nq=[1])

    def objective(arg: Any) -> None:
        arg.objective = arg.phase[0].integral[0]

    def continuous(arg: Any) -> None:
        (force,) = arg.phase[0].control
        arg.phase[0].dynamics[:] = rates(arg.phase[0].state, force, sin, cos)
        arg.phase[0].integrand[:] = (force**2,)

    ocp.functions.objective, ocp.functions.continuous = objective, continuous
    bounds = ocp.bounds.phase[0]
    bounds.initial_time.lower = bounds.initial_time.upper = 0.0
    bounds.final_time.lower = bounds.final_time.upper = DURATION
    bounds.initial_state.lower[:] = bounds.initial_state.upper[:] = START
    bounds.final_state.lower[:] = bounds.final_state.upper[:] = END
    bounds.state.lower[0], bounds.state.upper[0] = -TRACK, TRACK
    bounds.control.lower[:], bounds.control.upper[:] = -FORCE, FORCE
    guess = ocp.guess.phase[0]
    guess.time = [0.0, DURATION]
    guess.state = [list(pair) for pair in zip(START, END, strict=True)]
    guess.control = [[0.0, 0.0]]
    ocp.mesh.phase[0].collocation_points = segments * (points,)
    ocp.mesh.phase[0].fraction = segments * (1.0 / segments,)
    ocp.spectral_method = spectral_method
    ocp.derivatives.method, ocp.derivatives.order = "auto", "second"
    options = ocp.ipopt_options
    options.print_level, options.sb, options.tol, options.max_iter = 0, "yes", TOLERANCE, ITERATIONS
    count = [-1]  # IPOPT calls back before the first iteration, too
    stay, call = Problem._intermediate_cb, inside._solve_ipopt_problem

    def counted(*arguments: Any) -> bool:
        count[0] += 1
        return stay(*arguments)

    Problem._intermediate_cb, inside._solve_ipopt_problem = counted, watch.around(call)
    try:
        solution = ocp.solve()
    finally:
        Problem._intermediate_cb, inside._solve_ipopt_problem = stay, call
    spent = watch.stop()
    if solution.nlp_info.ipopt_status != 0:
        raise RuntimeError(solution.nlp_info.ipopt_status_message)
    phase = solution.phase[0]
    pieces = []
    for k in range(segments):
        begin, end = DURATION * k / segments, DURATION * (k + 1) / segments
        own = slice(k * (points - 1), k * (points - 1) + points)
        if spectral_method != "lgl":
            own = slice(k * points, (k + 1) * points)
        pieces.append((begin, end, polynomial(phase.time_c[own], phase.control[0][own])))
    return Solve(*spent, count[0], int(solution.nlp_info.x.size), float(solution.objective), replay(pieces))


# --- rockit ------------------------------------------------------------------------------------------
def with_rockit(intervals: int, method: str = "shooting", order: int = 0) -> Solve:
    """Multiple shooting by Runge-Kutta, or direct collocation; force constant (order 0) or linear on the intervals."""
    import casadi as ca
    import rockit

    watch = Stopwatch()
    ocp = rockit.Ocp(t0=0, T=DURATION)
    states = [ocp.state() for _ in range(4)]
    force = ocp.control(order=order)
    for state, rate in zip(states, rates(states, force, ca.sin, ca.cos), strict=True):
        ocp.set_der(state, rate)
    ocp.add_objective(ocp.integral(force**2))
    ocp.subject_to(-FORCE <= (force <= FORCE), include_last=order > 0)
    ocp.subject_to(-TRACK <= (states[0] <= TRACK))
    for state, begin, end in zip(states, START, END, strict=True):
        ocp.subject_to(ocp.at_t0(state) == begin)
        ocp.subject_to(ocp.at_tf(state) == end)
        if end != begin:  # zero is its own guess, and each guess that is stated takes it time
            ocp.set_initial(state, begin + (end - begin) * ocp.t / DURATION)
    ipopt = {"print_level": 0, "sb": "yes", "tol": TOLERANCE, "max_iter": ITERATIONS}
    ocp.solver("ipopt", {"expand": True, "print_time": False, "record_time": True, "ipopt": ipopt})
    if method == "shooting":
        ocp.method(rockit.MultipleShooting(N=intervals, M=1, intg="rk"))
    else:
        ocp.method(rockit.DirectCollocation(N=intervals, M=1, degree=4, scheme="radau"))
    solution = ocp.solve()
    stats = solution.stats
    watch.solving = stats["t_wall_total"]
    spent = watch.stop()
    times, forces = (np.asarray(a).ravel() for a in solution.sample(force, grid="control"))
    pieces = []
    for k in range(intervals):
        points, values = (times[k : k + 2], forces[k : k + 2]) if order else (times[k : k + 1], forces[k : k + 1])
        pieces.append((times[k], times[k + 1], polynomial(points, values)))
    return Solve(
        *spent, int(stats["iter_count"]), int(ocp._method.opti.nx), float(solution.value(ocp.objective)), replay(pieces)
    )


# --- opty --------------------------------------------------------------------------------------------
def with_opty(intervals: int, integration_method: str = "midpoint", backend: str = "cython") -> Solve:
    """SymPy equations of motion, compiled or in NumPy; midpoint or backward Euler; IPOPT without second derivatives."""
    import sympy as sm
    import sympy.physics.mechanics as me
    from opty import Problem, create_objective_function

    watch = Stopwatch()
    nodes, h = intervals + 1, DURATION / intervals
    t = me.dynamicsymbols._t
    x, theta, speed, omega, force = me.dynamicsymbols("x, theta, v, omega, F")
    states = (x, theta, speed, omega)
    # implicit, as its documentation advises: no inverse of the mass matrix
    motion = sm.Matrix(
        [
            x.diff(t) - speed,
            theta.diff(t) - omega,
            (CART + BOB) * speed.diff(t)
            + BOB * LENGTH * (omega.diff(t) * sm.cos(theta) - omega**2 * sm.sin(theta))
            - force,
            LENGTH * omega.diff(t) + speed.diff(t) * sm.cos(theta) + GRAVITY * sm.sin(theta),
        ]
    )
    objective, gradient = create_objective_function(
        sm.Integral(force**2, t), states, (force,), (), nodes, h, integration_method=integration_method, time_symbol=t
    )
    ends = [s.func(0.0) - a for s, a in zip(states, START, strict=True)]
    ends += [s.func(DURATION) - b for s, b in zip(states, END, strict=True)]
    problem = Problem(
        objective,
        gradient,
        motion,
        states,
        nodes,
        h,
        instance_constraints=ends,
        bounds={force: (-FORCE, FORCE), x: (-TRACK, TRACK)},
        integration_method=integration_method,
        time_symbol=t,
        backend=backend,
    )
    options = {"print_level": 0, "sb": "yes", "tol": TOLERANCE, "max_iter": ITERATIONS, "linear_solver": "mumps"}
    for name, value in options.items():
        problem.add_option(name, value)
    share = np.linspace(0, 1, nodes)
    guess = np.concatenate([a + (b - a) * share for a, b in zip(START, END, strict=True)] + [np.zeros(nodes)])
    found, information = watch.around(problem.solve)(guess)
    spent = watch.stop()
    if information["status"] != 0:
        raise RuntimeError(str(information["status_msg"]))
    forces, times = found[4 * nodes : 5 * nodes], DURATION * share
    pieces = []
    for k in range(intervals):
        value = forces[k + 1] if integration_method == "backward euler" else (forces[k] + forces[k + 1]) / 2
        pieces.append((times[k], times[k + 1], polynomial(times[k : k + 1], np.array([value]))))
    return Solve(*spent, len(problem.obj_value) - 1, found.size, float(information["obj_val"]), replay(pieces))


#: What can be asked for, by name: how to solve it on a mesh of n intervals.
METHODS: dict[str, Callable[[int], Solve]] = {
    "mbdcasadi, degree 3 (default)": with_mbdcasadi,
    "mbdcasadi, degree 2": lambda n: with_mbdcasadi(n, degree=2),
    "yapss, 10 points": with_yapss,
    "yapss, 5 points": lambda n: with_yapss(n, points=5),
    "yapss, Radau, 5 points": lambda n: with_yapss(n, points=5, spectral_method="lgr"),
    "rockit, shooting, constant force": with_rockit,
    "rockit, shooting, linear force": lambda n: with_rockit(n, order=1),
    "rockit, collocation, linear force": lambda n: with_rockit(n, method="collocation", order=1),
    "opty, midpoint": with_opty,
    "opty, midpoint, NumPy": lambda n: with_opty(n, backend="numpy"),
    "opty, backward Euler": lambda n: with_opty(n, integration_method="backward euler"),
}


#: What a user of a package imports, by the first word of the methods.
MODULES = {
    "mbdcasadi": ("mbdcasadi",),
    "yapss": ("yapss", "yapss.math"),
    "rockit": ("casadi", "rockit"),
    "opty": ("sympy", "sympy.physics.mechanics", "opty"),
}


# --- the process -------------------------------------------------------------------------------------
@contextlib.contextmanager
def silent() -> Iterator[None]:
    """Send what libraries print to nowhere: the answers go to the output."""
    sys.stdout.flush()
    kept, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    try:
        yield
    finally:
        sys.stdout.flush()
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)


def answer(request: dict[str, Any]) -> dict[str, Any]:
    """Carry out a request."""
    if "versions" in request:
        return versions(*request["versions"])
    method = request["method"]
    try:
        with silent():
            began = time.perf_counter()
            if request.get("imports"):
                for module in MODULES[method.split(",")[0]]:
                    importlib.import_module(module)
            imports = time.perf_counter() - began
            found = asdict(METHODS[method](request["size"]))
            return found | {"imports": imports} if request.get("imports") else found
    except Exception as error:  # whatever a package raises is its answer
        text = str(error).strip() or type(error).__name__
        return {"failure": f"{type(error).__name__}: {text.splitlines()[0]}"[:200]}


def main() -> None:
    """Answer requests until the input ends."""
    for line in sys.stdin:
        print(json.dumps(answer(json.loads(line))), flush=True)


if __name__ == "__main__":
    main()
