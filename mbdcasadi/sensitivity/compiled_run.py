"""A start, a motion and its outputs as one differentiable function of a vector of numbers."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from ..assembly.setup import Setup
from ..errors import SimulationError
from ..integrators.compiled import last_line
from ..model.mechanism import Mechanism
from ..numerics.console import call
from ..results.state import State
from ..simulation.modes import SingleMode
from ..simulation.simulate import chosen_integrator, suited_to_friction
from ..simulation.time_dependence import time_dependence
from .design_variables import DesignVariables
from .differentiable_motion import DifferentiableMotion
from .differentiable_start import DifferentiableStart, found


class MotionSetup(Setup):
    """The arguments of an analysis that differentiates or repeats a motion.

    Parameters
    ----------
    mechanism : Mechanism
        The model.
    analysis : str
        Name of the analysis, for messages.
    times : sequence of float
        Output times, s.
    initial, inputs, parameters
        As for :func:`simulate`.
    method, reltol, abstol
        The integrator; ``"auto"`` takes Runge–Kutta if the motion at the start is not stiff.

    Attributes
    ----------
    integrator : Integrator
        Method and tolerances.
    differentiable_start : DifferentiableStart
        The start as a function.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        analysis: str,
        times: Any,
        *,
        initial: Any = (),
        inputs: Any = None,
        parameters: Any = None,
        method: Any = "idas",
        reltol: float | None = None,
        abstol: float | None = None,
    ):
        super().__init__(mechanism, analysis, times=times, initial=initial, inputs=inputs, parameters=parameters)
        self.differentiable_start = DifferentiableStart(self.numeric, initial, float(self.grid[0]), self.signals)
        _ = self.start[self.eom.a]  # raises where there are no accelerations
        integrator = chosen_integrator(method, SingleMode(self), reltol=reltol, abstol=abstol, analysis=analysis)
        self.integrator = suited_to_friction(integrator, self.numeric)

    @cached_property
    def start(self) -> State:
        return self.differentiable_start.state

    def motion(self, integrands: ca.SX | None = None) -> DifferentiableMotion:
        """Return the motion over the grid, in as many pieces as it takes to stay on the constraints."""
        start, timed = self.start, time_dependence(self)
        obstacle = timed.obstacle()
        if obstacle is not None:
            raise obstacle
        motion = DifferentiableMotion(
            self.numeric,
            self.signals,
            self.grid,
            self.integrator,
            redundant=self.has_redundant_rows,
            integrands=integrands,
            unknowns=np.r_[start.a, start.lam],
            stops=timed.stops,
            jumps=timed.jumps,
            max_step=timed.max_step,
        )
        motion.cut_where_it_drifts(np.r_[start.q, start.v, start.z])
        return motion


class CompiledRun:
    """Outputs as a function of a design vector, with derivatives forward and adjoint.

    Parameters
    ----------
    setup : MotionSetup
        What is run.
    wrt : sequence
        See :class:`DesignVariables`.
    expressions : sequence of casadi.SX
        Outputs.
    integrands : casadi.SX, optional
        Expressions whose integrals over the run are outputs too: the last rows at the last time.
    """

    def __init__(self, setup: MotionSetup, wrt: Any, expressions: Sequence[ca.SX], integrands: ca.SX | None = None):
        start = setup.differentiable_start
        self.setup = setup
        self.motion = setup.motion(integrands=integrands)
        self.design = DesignVariables(wrt, start, self.motion, setup.initial)
        self.guess = start.guess
        d, guess = ca.MX.sym("d", self.design.size), ca.MX.sym("guess", self.guess.size)
        p, right, z, levels, channel = self.design.arguments(d)
        x0, solution, residual = start.function(p, right, z, guess)
        states = self.motion.motion()(x0, p, levels, channel)
        outputs = self.motion.outputs(expressions)(states, p, levels, channel)
        self.rows = outputs.shape[0]
        totals = states[-1 - self.motion.integrals : -1, -1]
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
        self.setup.mechanism.check_values(self.design.parameters(d))
        y, states, residual, solution = self._call(self.function, d, self.guess)
        if not found(float(residual)):
            raise SimulationError(
                f"no start that meets the constraints and initial= was found at {self._where(d)}: "
                "the linkage does not reach there, or the values are too far from the last ones"
            )
        if not self.motion.reached(states.full()):
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
        remedy = 'take method="erk", or larger tolerances' if self.setup.integrator.is_multistep else None
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
