"""A start, a motion and its outputs as one differentiable function of a vector of numbers."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from ..arguments.inputs import read_signals
from ..arguments.values import pairs_of, parameter_vector, time_grid
from ..assembly.initial_state import carried_by
from ..equations import equations
from ..equations.numeric import NumericEquations
from ..errors import SimulationError
from ..integrators.plugins import last_line
from ..model.mechanism import Mechanism
from ..model.symbols import number
from ..numerics.console import call
from ..results.state import State
from ..simulation.stiffness import is_stiff
from .design_variables import Design
from .differentiable_motion import Flow
from .differentiable_start import Start, found


class Problem:
    """A mechanism with a grid, a start, inputs and parameters, ready to be compiled.

    Parameters
    ----------
    mechanism : Mechanism
        The model.
    times : sequence of float
        Output times, s.
    initial, inputs, parameters
        As for ``simulate``.
    method, reltol, abstol
        Of the integrator; ``"auto"`` takes Runge–Kutta where the motion at the start is not stiff.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        times: Any,
        initial: Any = (),
        inputs: Any = None,
        parameters: Any = None,
        **settings: Any,
    ):
        self.mechanism, self.initial, self.settings = mechanism, initial, settings
        for name in ("reltol", "abstol"):
            if number(settings.get(name, 1e-8), "the integrator", name) < 0:
                raise SimulationError(f"{name} must not be negative, got {settings[name]!r}")
        self.eom = equations(mechanism)
        self.grid = time_grid(times)
        own = carried_by(initial, mechanism)
        p = parameter_vector(self.eom, own["parameters"] | dict(pairs_of(parameters, "parameters=")))
        self.numeric = NumericEquations(self.eom, p)
        given = own["inputs"] | dict(pairs_of(inputs, "inputs=")) if own["inputs"] else inputs
        self.signals = read_signals(self.eom, given, self.grid)
        self.start = Start(self.numeric, initial, float(self.grid[0]), self.signals)
        state = self.start.state
        _ = state[self.eom.a]  # raises where there are no accelerations
        self.redundant = self.numeric.has_redundant_rows(state.t, state.q)
        if settings.get("method") == "auto":
            slow = self.eom.Q_depends_on_lam or is_stiff(self.numeric, state, self.grid, self.redundant)
            self.settings = settings | {"method": "idas" if slow else "erk"}

    @property
    def state(self) -> State:
        """The start."""
        return self.start.state

    def flow(self, integrands: ca.SX | None = None) -> Flow:
        """The motion over the grid, in as many pieces as it takes to stay on the constraints."""
        given = self.settings | {"redundant": self.redundant, "integrands": integrands}
        given["unknowns"] = np.r_[self.state.a, self.state.lam]
        flow = Flow(self.numeric, self.signals, self.grid, **given)
        flow.cut_where_it_drifts(np.r_[self.state.q, self.state.v, self.state.z])
        return flow


class CompiledRun:
    """Outputs as a function of a design vector, with derivatives forward and adjoint.

    Parameters
    ----------
    problem : Problem
        What is run.
    wrt : sequence
        See :class:`Design`.
    expressions : sequence of casadi.SX
        Outputs.
    integrands : casadi.SX, optional
        Expressions whose integrals over the run are outputs too: the last rows at the last time.
    """

    def __init__(self, problem: Problem, wrt: Any, expressions: Sequence[ca.SX], integrands: ca.SX | None = None):
        self.problem = problem
        self.flow = problem.flow(integrands=integrands)
        self.design = Design(wrt, problem.start, self.flow, problem.initial)
        self.guess = problem.start.guess
        d, guess = ca.MX.sym("d", self.design.size), ca.MX.sym("guess", self.guess.size)
        p, right, z, shifts, channel = self.design.arguments(d)
        x0, solution, residual = problem.start.function(p, right, z, guess)
        states = self.flow.motion()(x0, p, shifts, channel)
        outputs = self.flow.outputs(expressions)(states, p, shifts, channel)
        self.rows = outputs.shape[0]
        totals = states[-1 - self.flow.integrals : -1, -1]
        self.function = ca.Function(
            "run",
            [d, guess],
            [ca.vertcat(ca.vec(outputs), totals), states, residual, solution],
            ["d", "guess"],
            ["y", "X", "r", "s"],
        )
        self._values = ca.Function("values", [d, guess], [ca.vertcat(ca.vec(outputs), totals)])
        self._derivatives: dict[tuple[str, int], ca.Function] = {}

    def values(self, d: np.ndarray) -> np.ndarray:
        """All outputs (n_y n_t + integrals,), time by time.

        Raises
        ------
        ModelError
            Where a parameter is out of what the model allows.
        SimulationError
            Where no start is found near the last one, or the integrator stops.
        """
        self.problem.mechanism.check_values(self.design.parameters(d))
        y, states, residual, solution = self._call(self.function, d, self.guess)
        if not found(float(residual)):
            raise SimulationError(
                f"no start that meets the constraints and initial= was found at {self._where(d)}: "
                "the linkage does not reach there, or the values are too far from the last ones"
            )
        if not self.flow.reached(states.full()):
            raise SimulationError(self._stopped(d, "the step size became too small, or a value was not finite"))
        self.guess = solution.full().ravel()
        return y.full().ravel()

    def forward(self, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Outputs and their derivatives (n, n_d), by forward sensitivities."""
        y = self.values(d)
        function = self._derivative("forward", self.design.size)
        slope = self._call(
            function, d, self.guess, y, np.eye(self.design.size), np.zeros((self.guess.size, self.design.size))
        )
        return y, slope.full()

    def adjoint(self, d: np.ndarray, weights: np.ndarray, y: np.ndarray) -> np.ndarray:
        """``weights^T dY/dd`` (n_d,), by one adjoint integration."""
        remedy = (
            'take method="erk", or larger tolerances' if self.problem.settings.get("method", "idas") == "idas" else None
        )
        return self._call(self._derivative("reverse", 1), d, self.guess, y, weights, remedy=remedy)[0].full().ravel()

    def _derivative(self, kind: str, count: int) -> ca.Function:
        if (kind, count) not in self._derivatives:
            self._derivatives[kind, count] = getattr(self._values, kind)(count)
        return self._derivatives[kind, count]

    def _call(self, function: ca.Function, *arguments: Any, remedy: str | None = None) -> Any:
        try:
            return call(function, *arguments)
        except RuntimeError as error:
            raise SimulationError(self._stopped(arguments[0], last_line(error), remedy)) from None

    def _stopped(self, d: np.ndarray, why: str, remedy: str | None = None) -> str:
        remedy = remedy or "simulate with these values says where and why"
        return f"the integrator stopped at {self._where(d)}: {why}; {remedy}"

    def _where(self, d: np.ndarray) -> str:
        parts = [
            f"{e.label} = {d[low]:.6g}" + (" …" if e.size > 1 else "")
            for e, low in zip(self.design.entries, self.design.places[:-1], strict=True)
        ]
        return ", ".join(parts)
