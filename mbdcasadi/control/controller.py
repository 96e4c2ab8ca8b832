"""A controller that plans again at every sample: model-predictive control, compiled."""

from __future__ import annotations

import time as clock
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from ..arguments.inputs import SampledController
from ..arguments.values import pairs_of, position_in
from ..errors import ModelError
from ..model.quantities import is_list, whole
from ..model.symbols import number, positive
from ..numerics.reading import path_of
from ..numerics.real import real_array
from ..numerics.writing import cannot_be_written
from ..optimal_control.problem import OptimalControlProblem
from ..results.state import State
from .code import STATUSES, Horizon, source_files
from .engine import Engine
from .estimator import Estimator
from .fed import FedController
from .functions import ControlFunctions
from .unit import ControllerUnit, controller_unit, unit_files

#: Steps whose times are kept.
KEPT_TIMES = 10_000


@dataclass(frozen=True)
class ControlStep:
    """What a step of a controller returned.

    Attributes
    ----------
    inputs : numpy.ndarray
        Inputs (n_u,), held until the next sample; finite whatever the status is.
    status : int
        0 if they are those of a new plan.
    iterations : int
        Iterations that this took.
    """

    inputs: np.ndarray
    status: int
    iterations: int

    @property
    def reason(self) -> str:
        """Meaning of the status."""
        return [*STATUSES.values()][self.status]


@dataclass(frozen=True)
class ControlPlan:
    """The plan of a controller at its last step.

    Attributes
    ----------
    t : numpy.ndarray
        Times (n + 1,), s.
    states : numpy.ndarray
        States (n + 1, n_x), named by :attr:`Controller.state_names`.
    inputs : numpy.ndarray
        Inputs of the intervals (n, n_u).
    cost : float
        Cost of the plan about which the last step was computed.
    """

    t: np.ndarray
    states: np.ndarray
    inputs: np.ndarray
    cost: float


@dataclass(frozen=True)
class ControlTiming:
    """Times of the steps of a controller, by clock.

    Attributes
    ----------
    feedback, prepare : numpy.ndarray
        Time from a state to its inputs, and that of what is computed then before the next sample, s, by step.
    """

    feedback: np.ndarray
    prepare: np.ndarray

    def __repr__(self) -> str:
        if not self.feedback.size:
            return "no steps yet"
        whole = 1e3 * (self.feedback + self.prepare)
        median, late = np.percentile(whole, [50, 99])
        return (
            f"{whole.size} steps of {median:.3f} ms (median), {late:.3f} ms (99 %); from the state to the inputs "
            f"{1e3 * np.median(self.feedback):.3f} ms"
        )


class Controller(SampledController):
    """Model-predictive control: the optimum over the horizon is planned again at every sample, in C.

    The plan is one of multiple shooting, with inputs that are constant on the intervals. A step solves the program
    linearised about the last plan, with its limits (real-time iteration); ``iterations=`` repeats that. The
    linearisation is prepared before the state comes. Loops are closed inside: states are independent coordinates.

    Parameters
    ----------
    problem : OptimalControlProblem
        Of fixed duration, the horizon. The measured state takes the place of ``initial=``; limits of ``path=`` hold at
        the ends of the intervals; a limit that may be impossible should be a :func:`soft` one.
    sample : float
        Time between two steps, s.
    intervals : int
        Number of intervals of the horizon.
    iterations : int, default 1
        Most iterations in a step; it ends before if the plan has converged.
    state : sequence of expressions, optional
        What is measured, as many positions as there are degrees of freedom: ``[left.phi, right.phi]``; rates and
        first-order states follow. Otherwise coordinates of the bodies are chosen, angles before displacements.
    steps : int, optional
        Runge-Kutta steps over an interval. By default as many as the fastest mode of the assembled state needs; motions
        that become much faster need more: with twice as many, errors fall to a thirtieth.

    Attributes
    ----------
    state_names, input_names, parameter_names : tuple of str
        Of the numbers that :meth:`step` takes and returns, in order.
    period : float
        The same as `sample`, s.

    Raises
    ------
    ModelError, ExpressionError
        For problems that it does not solve: several phases, a free duration, waypoints, boundary conditions, free
        parameters, rates of inputs; for forces that depend on reactions and redundant constraints; without a C
        compiler.

    Examples
    --------
    >>> import mbdcasadi as mbd
    >>> force = mbd.Input("force", lower=-1, upper=1)
    >>> cart = mbd.Body("cart", mass=1, inertia=1)
    >>> rail = mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0))
    >>> push = mbd.Force("push", cart.at(0, 0), (force, 0))
    >>> model = mbd.Mechanism([cart], [rail], forces=[push], inputs=[force])
    >>> cost = cart.x**2 + cart.vx**2 + 0.1 * force**2
    >>> plan = mbd.OptimalControlProblem(model, duration=2, running_cost=cost)
    >>> controller = mbd.Controller(plan, sample=0.1, intervals=20)  # doctest: +SKIP
    >>> controller.inputs(mbd.assemble(model, [cart.x == 2]))[force]  # doctest: +SKIP
    -1.0
    """

    def __init__(
        self,
        problem: OptimalControlProblem,
        sample: float,
        intervals: int,
        iterations: int = 1,
        state: Sequence[Any] | None = None,
        steps: int | None = None,
    ):
        period = positive(sample, "Controller", "sample")
        counts = {"intervals": intervals, "iterations": iterations} | ({} if steps is None else {"steps": steps})
        for name, value in counts.items():
            if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < 1:
                raise ModelError(f"Controller: {name} must be a whole number above zero, got {value!r}")
        model = ControlFunctions(problem, state)
        length = problem.phases[0].span[1]
        if period > length:
            raise ModelError(f"Controller: the sample {period:g} s is longer than the horizon of {length:g} s")
        interval = length / intervals
        taken = model.steps_over(interval) if steps is None else int(steps)
        horizon = Horizon(period, interval, int(intervals), int(iterations), taken)
        self._files = source_files(model, horizon)
        self._times = deque[tuple[float, float]](maxlen=KEPT_TIMES)
        self._share(problem, model, horizon, Engine(self._files, model, horizon), model.eom.parameter_values)

    def _share(
        self, problem: OptimalControlProblem, model: ControlFunctions, horizon: Horizon, engine: Engine, p: np.ndarray
    ) -> None:
        """Set what controllers with other values of the parameters have in common, and the values."""
        super().__init__(self._answer, horizon.sample)
        self.problem, self._model, self.horizon, self._engine = problem, model, horizon, engine
        self.mechanism = model.mechanism
        self.state_names = model.names
        self.input_names = tuple(u.label for u in self.mechanism.inputs)
        self.parameter_names = tuple(x.label for x in self.mechanism.parameters)
        self._p = np.array(p, float)
        self._memory = engine.memory()
        self._last = dict[str, Any]()

    # --- steps -------------------------------------------------------------------------------------------------
    def inputs(self, state: State, parameters: Any = None) -> dict[Any, float]:
        """Return the inputs at a state, ``{input: value}``; one step.

        Parameters
        ----------
        state : State
            Of the mechanism, or of another one with the same bodies.
        parameters : mapping or list of pairs, optional
            Values of parameters, over those of the controller.
        """
        if not isinstance(state, State):
            raise ModelError(f"Controller.inputs: takes a State, got {state!r}; step takes the numbers")
        step = self.step(np.atleast_1d(state[self._model.state]), parameters, time=state.t)
        return dict(zip(self.mechanism.inputs, step.inputs.tolist(), strict=True))

    def step(self, state: Any, parameters: Any = None, *, time: float | None = None) -> ControlStep:
        """Compute the inputs of a sample.

        Parameters
        ----------
        state : sequence of float
            Measured values (n_x,), in the order of :attr:`state_names`; any that are not finite give a status.
        parameters : sequence of float, mapping or list of pairs, optional
            All values, in the order of :attr:`parameter_names`; or some, over those of the controller.
        time : float, optional
            Time, s; one sample after the last step if left out.
        """
        x, p, memory = self._vector(state, "states", self.state_names), self._values(parameters), self._memory
        now = float(memory.view.time)
        if time is not None:
            (now,) = self._vector(time, "time", ("in s",)).tolist()
        began = clock.perf_counter()
        status, inputs = memory.feedback(now, x, p, len(self.input_names))
        answered = clock.perf_counter()
        states, course = memory.plan
        self._last["plan"] = ControlPlan(
            now + self.horizon.interval * np.arange(self.horizon.intervals + 1),
            states, course[:, : len(self.input_names)], float(memory.view.cost),
        )  # fmt: skip
        step = self._last["step"] = ControlStep(inputs, status, int(memory.view.iterations))
        resumed = clock.perf_counter()
        memory.prepare()
        self._times.append((answered - began, clock.perf_counter() - resumed))
        return step

    def _vector(self, given: Any, what: str, names: tuple[str, ...]) -> np.ndarray:
        try:
            x = real_array(given).ravel()
        except (TypeError, ValueError):
            shown = ", ".join(names)
            raise ModelError(
                f"Controller.step: takes {len(names)} numbers, the {what} {shown}, got {given!r}"
            ) from None
        if x.size != len(names):
            raise ModelError(f"Controller.step: takes {len(names)} {what} {names}, got {x.size}")
        return x

    def _values(self, parameters: Any) -> np.ndarray:
        if parameters is None:
            return self._p
        numbers = is_list(parameters) or (isinstance(parameters, np.ndarray) and parameters.ndim == 1)
        if numbers and len(parameters) and not any(isinstance(x, ca.SX) or np.ndim(x) for x in parameters):
            return self._vector(parameters, "parameters", self.parameter_names)
        values = self._p.copy()
        for key, value in pairs_of(parameters, "parameters="):
            place = position_in(self.mechanism.parameters, key, "parameters=")
            values[place] = number(value, f"parameter '{key.label}'", "value")
        return values

    def _answer(self, time: float, state: State) -> dict[Any, float]:
        """Inputs in a run; a time that does not follow the last one begins a new motion."""
        due = self._last.get("due")
        if due is None or abs(time - due) > 1e-6 * self.period:
            self.reset()
        self._last["due"] = time + self.period
        return self.inputs(state)

    def reset(self) -> None:
        """Forget the plan, before a new motion."""
        self._memory.reset()
        self._last.clear()

    def with_parameters(self, parameters: Any) -> Controller:
        """Return the same compiled controller with other values of parameters, and a plan of its own."""
        other = object.__new__(Controller)
        other._files, other._times = self._files, self._times
        other._share(self.problem, self._model, self.horizon, self._engine, self._values(parameters))
        return other

    def fed_by(
        self, estimator: Estimator, covariance: Any, *, initial: State | None = None, seed: int | None = None
    ) -> FedController:
        """Return a controller for ``simulate(inputs=…)`` that is given estimates in place of the states of the run.

        Estimates of unknown parameters take the place of the values of the controller, if it has these parameters.

        Parameters
        ----------
        estimator : Estimator
            With the same sample. Each run resets it.
        covariance : array
            Of the state at the start, as in :meth:`Estimator.reset`.
        initial : State, optional
            Mean of the state at the start. By default the start of the run.
        seed : int, optional
            Measurements have normal noise with the deviations of the estimator, the same in each run with a seed;
            without one they are exact.

        Raises
        ------
        ModelError
            If the samples of the two differ, or a seed is no whole number.
        """
        return FedController(self, estimator, covariance, initial, seed)

    # --- results -----------------------------------------------------------------------------------------------
    @property
    def status(self) -> int | None:
        """Status of the last step; None before the first."""
        return self._last["step"].status if "step" in self._last else None

    def meaning(self, status: int) -> str:
        """Return what a status says."""
        return [*STATUSES.values()][whole(status, "Controller.meaning", "status", 0, len(STATUSES) - 1)]

    @property
    def plan(self) -> ControlPlan:
        """The plan of the last step."""
        if "plan" not in self._last:
            raise ModelError("Controller.plan: there is no plan before the first step")
        plan: ControlPlan = self._last["plan"]
        return plan

    @property
    def timing(self) -> ControlTiming:
        """Times of the last steps."""
        both = np.array(self._times).reshape(-1, 2)
        return ControlTiming(both[:, 0], both[:, 1])

    def export(self, folder: str | Path) -> tuple[Path, ...]:
        """Write the controller as C99: ``controller.c``, ``controller.h`` and ``main.c``, a program that calls it.

        It needs libm and nothing else, allocates nothing, and keeps all that it remembers in one struct. Compiled
        without contraction of operations (``-ffp-contract=off``) it computes the same bits as here.

        Parameters
        ----------
        folder : str or Path
            Folder, made if there is none; files of these names are replaced.

        Raises
        ------
        FileError
            If it cannot be made or written.
        """
        place, paths = path_of(folder), []
        try:
            place.mkdir(parents=True, exist_ok=True)
            for name, text in self._files.items():
                paths.append(place / name)
                paths[-1].write_text(text, encoding="utf-8")
        except OSError as error:
            raise cannot_be_written(folder, error) from None
        return tuple(paths)

    def unit(self, name: str, version: int, units: Mapping[str, str]) -> tuple[ControllerUnit, dict[str, str]]:
        """Return the functional mock-up unit that :func:`export_fmu` writes, and its C files by name."""
        unit = controller_unit(self._model, self.horizon, self._p, units, name, version)
        return unit, unit_files(unit, self._files)

    def __repr__(self) -> str:
        h = self.horizon
        iterations = f"{h.iterations} iteration{'s' if h.iterations > 1 else ''}"
        return (
            f"Controller({len(self.state_names)} states, {len(self.input_names)} inputs; every {h.sample:g} s, "
            f"{iterations} over {h.interval * h.intervals:g} s in {h.intervals} intervals; "
            f"{len(self._files['controller.c']) / 1024:.0f} kB of C)"
        )
