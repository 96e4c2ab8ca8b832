"""The methods that are compared, mbdcasadi's own and those of other packages, all on the models of ``models.py``.

A :class:`Problem` holds a model, its consistent start and the reference
motion. A method runs it at one setting (a tolerance or a step size) and
returns a :class:`Run`: the time that integration took, the time to set it up,
and the largest position error. What a package can prepare once (compiled
functions, Jacobians with their sparsity) counts as set-up for every package.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from typing import Any

import casadi as ca
import exudyn_parts
import numpy as np
from models import Model

import mbdcasadi as mbd

#: Tolerances of the reference motion; its own error is estimated with ten times as much.
REFERENCE_TOLERANCE = 1e-12
#: Clock of the timings; ``time.process_time`` on a busy machine.
_clock = time.perf_counter
#: Above this number of unknowns a sparse linear solver is used where there is a choice.
DENSE_UNKNOWNS = 100


def clock() -> float:
    """Seconds by the clock that is chosen."""
    return _clock()


def take_processor_time() -> None:
    """Count the processor time of this process, which depends less on other work on the machine."""
    global _clock
    _clock = time.process_time


@dataclass(frozen=True)
class Run:
    """One run of a method: seconds of integration, seconds of set-up, largest position error (m)."""

    seconds: float
    set_up: float
    error: float


class Method:
    """A way to simulate a model.

    Attributes
    ----------
    name : str
        As printed.
    settings : sequence of float
        Tolerances, or steps between outputs, from loose to tight.
    """

    name: str = ""
    settings: Sequence[float] = ()

    def suits(self, problem: Problem) -> bool:
        """True if the model is worth the try."""
        return True

    def run(self, problem: Problem, setting: float) -> Run:
        """Simulate the model once."""
        raise NotImplementedError


# --- the problem and its reference ---------------------------------------------------------------
class Buffered:
    """A compiled function of CasADi on arrays of its own: a call costs about a microsecond."""

    def __init__(self, function: ca.Function):
        self._buffer, self._call = function.buffer()
        self._function = function
        self.arguments = [np.zeros(function.nnz_in(k)) for k in range(function.n_in())]
        self.results = [np.zeros(function.nnz_out(k)) for k in range(function.n_out())]
        for k, argument in enumerate(self.arguments):
            self._buffer.set_arg(k, memoryview(argument))
        for k, result in enumerate(self.results):
            self._buffer.set_res(k, memoryview(result))

    def __call__(self, *values: Any) -> list[np.ndarray]:
        for argument, value in zip(self.arguments, values, strict=True):
            argument[:] = value
        self._call()
        return self.results


class Problem:
    """A model with its mechanism, its start and its reference motion.

    Parameters
    ----------
    model : Model
        The model.
    """

    def __init__(self, model: Model):
        self.model = model
        self.mechanism = model.mechanism()
        self.eom = mbd.equations(self.mechanism)
        self.state = mbd.assemble(self.mechanism, model.start(self.mechanism))
        self.start = np.r_[self.state.q, self.state.v]
        # positions of the centres of mass among [x, y, phi] by body
        self.compared = np.flatnonzero(np.arange(self.state.q.size) % 3 != 2)

    @cached_property
    def ode(self) -> ca.Function:
        """``(t, x) -> x'`` for ``x = (q, v)`` from the same compiled forward dynamics."""
        n = self.state.q.size
        t, x = ca.SX.sym("t"), ca.SX.sym("x", 2 * n)
        a, _ = self.eom.forward_dynamics(t, x[:n], x[n:], np.zeros(0), np.zeros(0), np.zeros(0))
        return ca.Function("ode", [t, x], [ca.vertcat(x[n:], a)])

    @cached_property
    def ode_jacobian(self) -> ca.Function:
        """Jacobian of :attr:`ode` by x, dense."""
        t, x = ca.SX.sym("t"), ca.SX.sym("x", self.start.size)
        return ca.Function("ode_jacobian", [t, x], [ca.densify(ca.jacobian(self.ode(t, x), x))])

    @cached_property
    def dae(self) -> tuple[ca.Function, ca.Function]:
        """``(t, y, y') -> residual`` and ``(t, y, y', c) -> dr/dy + c dr/dy'`` (sparse) for ``y = (q, v, a, lam)``."""
        eom = self.eom
        y = ca.vertcat(eom.q, eom.v, eom.a, eom.lam)
        rate, c = ca.SX.sym("rate", y.numel()), ca.SX.sym("c")
        n = eom.q.numel()
        residual = ca.densify(
            ca.vertcat(
                rate[:n] - eom.v,
                rate[n : 2 * n] - eom.a,
                eom.mass_diagonal * eom.a + eom.Phi_q.T @ eom.lam - eom.Q,
                eom.Phi_q @ eom.a - eom.gamma,
            )
        )
        jacobian = ca.jacobian(residual, y) + c * ca.jacobian(residual, rate)
        return (
            ca.Function("residual", [eom.t, y, rate], [residual]),
            ca.Function("jacobian", [eom.t, y, rate, c], [jacobian]),
        )

    @cached_property
    def dae_slopes(self) -> ca.Function:
        """``(t, y, y') -> dr/dy, dr/dy'``, sparse, of the residual of :attr:`dae`."""
        residual, _ = self.dae
        t, y, rate = (ca.SX.sym(name, residual.numel_in(k)) for k, name in enumerate(("t", "y", "rate")))
        value = residual(t, y, rate)
        return ca.Function("slopes", [t, y, rate], [ca.jacobian(value, y), ca.jacobian(value, rate)])

    @cached_property
    def reference(self) -> np.ndarray:
        """Positions (n_t, 2 n_bodies), exact ones if the model has them, else by DOP853 at a tight tolerance."""
        exact = self.model.exact
        return self._reference(REFERENCE_TOLERANCE) if exact is None else exact(self.model.times)

    @cached_property
    def reference_error(self) -> float:
        """Estimate of the error of the reference: its change at ten times the tolerance, m; 0 of an exact one."""
        if self.model.exact is not None:
            return 0.0
        return float(np.max(np.abs(self._reference(10 * REFERENCE_TOLERANCE) - self.reference)))

    def _reference(self, tolerance: float) -> np.ndarray:
        return self.positions(ScipyMethod("DOP853").solve(self, tolerance)[0])

    def positions(self, x: np.ndarray) -> np.ndarray:
        """Positions of the centres of mass of states by row."""
        return x[:, self.compared]

    def error(self, positions: np.ndarray) -> float:
        """Largest position error, m."""
        if positions.shape != self.reference.shape:
            return float("inf")
        return float(np.max(np.abs(positions - self.reference)))


# --- mbdcasadi -----------------------------------------------------------------------------------
class Ledger:
    """Work of CasADi's integrators: seconds of making (with jit: of compiling) and of running them, steps taken."""

    def __init__(self) -> None:
        self.making = self.running = 0.0
        self.steps = 0


class _Watched:
    """An integrator that writes its calls into a ledger."""

    def __init__(self, function: ca.Function, ledger: Ledger):
        self._function, self._ledger = function, ledger

    def buffer(self) -> Any:
        """Buffers of a call, and what evaluates it."""
        buffer, evaluate = self._function.buffer()

        def watched() -> None:
            began = clock()
            try:
                evaluate()
            finally:
                self._ledger.running += clock() - began
                statistics = buffer.stats()
                self._ledger.steps += statistics.get("nsteps", statistics.get("n_steps", 0))

        return buffer, watched

    def __getattr__(self, name: str) -> Any:
        return getattr(self._function, name)


@contextmanager
def integrators_watched() -> Iterator[Ledger]:
    """Keep a ledger of the integrators that are made meanwhile."""
    ledger = Ledger()
    original = ca.integrator

    def watched(*arguments: Any, **options: Any) -> Any:
        began = clock()
        made = original(*arguments, **options)
        ledger.making += clock() - began
        return _Watched(made, ledger)

    ca.integrator = watched
    try:
        yield ledger
    finally:
        ca.integrator = original


class MbdMethod(Method):
    """``mbdcasadi.simulate``; everything the call does counts, but for making the integrators, which is set-up."""

    def __init__(self, name: str, settings: Sequence[float], **options: Any):
        self.name = name
        self.settings = settings
        self._options = options

    def run(self, problem: Problem, setting: float) -> Run:
        times = problem.model.times
        began = clock()
        with integrators_watched() as ledger:
            motion = mbd.simulate(
                problem.mechanism,
                times,
                initial=problem.state,
                reltol=setting,
                abstol=setting,
                **self._options,
            )
        whole = clock() - began
        return Run(whole - ledger.making, ledger.making, problem.error(problem.positions(motion.q)))


# --- SciPy ---------------------------------------------------------------------------------------
class ScipyMethod(Method):
    """``scipy.integrate.solve_ivp`` on the compiled forward dynamics; no projection onto the constraints.

    In poses in which a mechanism could fold these have no solution, and its steps become tiny.
    """

    def __init__(self, method: str, settings: Sequence[float] = (), largest: int = 10**9):
        self.name = f"SciPy {method}"
        self.settings = settings
        self._method = method
        self._largest = largest

    def suits(self, problem: Problem) -> bool:
        return problem.start.size <= self._largest and not problem.model.folds

    def solve(self, problem: Problem, tolerance: float) -> tuple[np.ndarray, float, float]:
        """States by row, seconds of integration, seconds of set-up."""
        from scipy.integrate import solve_ivp

        began = clock()
        rate = Buffered(problem.ode)
        options: dict[str, Any] = {}
        if self._method in ("Radau", "BDF"):
            jacobian = Buffered(problem.ode_jacobian)
            size = problem.start.size
            options["jac"] = lambda t, x: jacobian(t, x)[0].reshape(size, size).T.copy()
        made = clock()
        found = solve_ivp(
            lambda t, x: rate(t, x)[0].copy(),
            (0.0, problem.model.duration),
            problem.start,
            method=self._method,
            t_eval=problem.model.times,
            rtol=tolerance,
            atol=tolerance,
            **options,
        )
        return found.y.T, clock() - made, made - began

    def run(self, problem: Problem, setting: float) -> Run:
        x, seconds, set_up = self.solve(problem, setting)
        return Run(seconds, set_up, problem.error(problem.positions(x)))


# --- solve_dae -----------------------------------------------------------------------------------
class SolveDaeMethod(Method):
    """Radau or BDF of solve_dae, which are SciPy's for implicit systems, on the residual with its exact Jacobians."""

    def __init__(self, method: str, settings: Sequence[float], largest: int = 10**9):
        self.name = f"solve_dae {method}"
        self.settings = settings
        self._method, self._largest = method, largest

    def suits(self, problem: Problem) -> bool:
        return problem.start.size <= self._largest

    def run(self, problem: Problem, setting: float) -> Run:
        from solve_dae.integrate import solve_dae

        began = clock()
        residual, slopes = Buffered(problem.dae[0]), problem.dae_slopes
        state, n = problem.state, problem.state.q.size
        y0 = np.r_[state.q, state.v, state.a, state.lam]
        rates = np.r_[state.v, state.a, np.zeros(y0.size - 2 * n)]
        made = clock()
        # accelerations and multipliers out of the error test, as with scikit-sundae
        found = solve_dae(
            lambda t, y, yp: residual(t, y, yp)[0].copy(),
            (0.0, problem.model.duration),
            y0,
            rates,
            method=self._method,
            t_eval=problem.model.times,
            rtol=setting,
            atol=np.r_[np.full(2 * n, setting), np.full(y0.size - 2 * n, 1e8)],
            jac=lambda t, y, yp: tuple(part.sparse() for part in slopes(t, y, yp)),
        )
        return Run(clock() - made, made - began, problem.error(problem.positions(found.y.T[:, : 2 * n])))


# --- scikit-sundae -------------------------------------------------------------------------------
class SundaeMethod(Method):
    """IDA of scikit-sundae on the same residual in ``(q, v, a, lam)``, with the exact sparse Jacobian.

    The accelerations and multipliers are kept out of its error test by a large
    absolute tolerance, as ``suppress_algebraic`` does in CasADi.
    """

    name = "scikit-sundae IDA"

    def __init__(self, settings: Sequence[float], largest: int = 10**9):
        self.settings = settings
        self._largest = largest

    def suits(self, problem: Problem) -> bool:
        return problem.start.size <= self._largest and not problem.model.folds

    def run(self, problem: Problem, setting: float) -> Run:
        from sksundae.ida import IDA

        began = clock()
        residual, jacobian = problem.dae
        state, n = problem.state, problem.state.q.size
        y0 = np.r_[state.q, state.v, state.a, state.lam]
        rates = np.r_[state.v, state.a, np.zeros(y0.size - 2 * n)]
        evaluate, slopes = Buffered(residual), Buffered(jacobian)
        pattern = jacobian.sparsity_out(0)
        rows, columns = (np.array(k) for k in pattern.get_triplet())
        sparse = y0.size > DENSE_UNKNOWNS

        def fill(t: float, y: np.ndarray, yp: np.ndarray, out: np.ndarray) -> None:
            out[:] = evaluate(t, y, yp)[0]

        def fill_jacobian(t: float, y: np.ndarray, yp: np.ndarray, _: np.ndarray, c: float, out: np.ndarray) -> None:
            if sparse:
                out[:] = slopes(t, y, yp, c)[0]
            else:
                out[rows, columns] = slopes(t, y, yp, c)[0]

        options: dict[str, Any] = {"linsolver": "dense"}
        if sparse:
            options = {"linsolver": "sparse", "sparsity": ca.DM(pattern, 1).sparse()}
        algebraic = np.arange(2 * n, y0.size)
        with warnings.catch_warnings():  # it says that the exact Jacobian is taken, not one by differences
            warnings.simplefilter("ignore")
            solver = IDA(
                fill,
                jacfn=fill_jacobian,
                algebraic_idx=algebraic.tolist(),
                rtol=setting,
                atol=np.r_[np.full(2 * n, setting), np.full(algebraic.size, 1e8)],
                max_num_steps=1_000_000,
                **options,
            )
        made = clock()
        found = solver.solve(problem.model.times, y0, rates)
        seconds = clock() - made
        return Run(seconds, made - began, problem.error(problem.positions(found.y[:, : 2 * n])))


# --- Exudyn --------------------------------------------------------------------------------------
class ExudynMethod(Method):
    """Exudyn on a model of its own (planar rigid bodies, revolute joints), an implicit method at index 2.

    Its step is fixed; the setting is the number of steps between two outputs.

    Parameters
    ----------
    radius : float, optional
        Spectral radius of the generalised-alpha method, for models that fold: there the trapezoidal rule stops.
    """

    def __init__(self, steps: Sequence[float], radius: float | None = None):
        self.name = "Exudyn, index-2 trapezoidal" if radius is None else f"Exudyn, generalised-alpha, radius {radius}"
        self.settings = steps
        self._radius = radius

    def suits(self, problem: Problem) -> bool:
        return problem.model.folds == (self._radius is not None)

    def run(self, problem: Problem, setting: float) -> Run:
        import exudyn as exu

        model = problem.model
        intervals = model.outputs
        steps = intervals * max(1, round(setting))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            began = clock()
            system, sensors = exudyn_parts.planar_system(model, problem.state)
            settings = exudyn_parts.settings(model.duration, steps, model.duration / intervals)
            settings.timeIntegration.newton.useModifiedNewton = True
            if 5 * len(model.bodies) > DENSE_UNKNOWNS:
                settings.linearSolverType = exu.LinearSolverType.EigenSparse
            kind = exu.DynamicSolverType.TrapezoidalIndex2
            if self._radius is not None:
                kind = exu.DynamicSolverType.GeneralizedAlpha
                settings.timeIntegration.generalizedAlpha.spectralRadius = self._radius
            made = clock()
            done = system.SolveDynamic(settings, solverType=kind, showHints=False)
            seconds = clock() - made
        if not done:
            return Run(seconds, made - began, float("inf"))
        stored = np.hstack([system.GetSensorStoredData(sensor)[:, 1:3] for sensor in sensors])
        return Run(seconds, made - began, problem.error(stored))


def all_methods(jit: bool = True) -> list[Method]:
    """Every method that is installed, mbdcasadi's default first."""
    tolerances = [10.0**-k for k in range(3, 12)]
    methods: list[Method] = [
        MbdMethod("mbdcasadi, default (idas)", tolerances),
        MbdMethod("mbdcasadi, erk", tolerances, method="erk"),
        MbdMethod("mbdcasadi, rosenbrock", tolerances, method="rosenbrock"),
        ScipyMethod("DOP853", tolerances),
        ScipyMethod("Radau", tolerances, largest=300),
    ]
    if find_spec("solve_dae") is not None:
        methods += [SolveDaeMethod(name, tolerances[:6], largest=100) for name in ("Radau", "BDF")]
    if find_spec("sksundae") is not None:
        methods.append(SundaeMethod([10.0**-k for k in range(4, 13)]))
    if find_spec("exudyn") is not None:
        methods.append(ExudynMethod([2.0**k for k in range(0, 11)]))
        methods.append(ExudynMethod([2.0**k for k in range(4, 10)], radius=0.9))
    if jit:
        methods.insert(1, MbdMethod("mbdcasadi, dop853, compiled", tolerances, method="dop853", jit=True))
        methods.insert(4, MbdMethod("mbdcasadi, erk, jit", tolerances, method="erk", jit=True))
    return methods
