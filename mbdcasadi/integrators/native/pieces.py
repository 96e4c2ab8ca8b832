"""Integration in C over pieces of an output grid, in the place of an integrator of CasADi."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from ...model.cache import Cache
from ..base import Integrator
from ..compiled import CompiledIntegrator, InitialValueProblem
from .runner import Runner
from .stretch import ExplicitSystem, Progress, Status, Stretch

#: Flags of IDAS for the same causes.
FLAGS = {
    Status.TOO_SMALL: "IDA_ERR_FAIL",
    Status.NOT_FINITE: "IDA_REP_RES_ERR",
    Status.PAUSED: "IDA_TOO_MUCH_WORK",
    Status.APART: "IDA_CONSTR_FAIL",
}


class NativeIntegrator(CompiledIntegrator):
    """An integrator of one system in C; base class of those of the methods.

    Parameters
    ----------
    system : ExplicitSystem
        The equations.
    integrator : Integrator
        Method and tolerances.
    cache : Cache
        Of the mechanism.
    weights : numpy.ndarray, optional
        Metric of the projection; ones if left out.

    Attributes
    ----------
    runner : type
        What runs the method.
    """

    runner: ClassVar[type[Runner]]

    def __init__(self, system: ExplicitSystem, integrator: Integrator, cache: Cache, weights: np.ndarray | None = None):
        self.integrator = integrator
        self._weights = np.ones(system.coordinates) if weights is None else weights
        self._runner = self.runner(system, None, cache, compiles=integrator.jit)
        self.restart_counting()

    @property
    def note(self) -> str:
        """Code that runs, in words."""
        return self._runner.note

    @property
    def tolerances(self) -> tuple[float, float]:
        """Relative and absolute tolerance of the local error."""
        return self.integrator.tolerances

    def _attempt(self, problem: InitialValueProblem, steps: int) -> tuple[np.ndarray, np.ndarray] | str:
        start, x, times = problem.start, problem.x, problem.times
        self.starts += 1
        self.steps = since_output = 0
        progress, rows, integrals = Progress(), np.zeros((0, x.size)), np.zeros((0, self._runner.system.integrals))
        integral = np.zeros(integrals.shape[1])
        while len(rows) < times.size:
            stretch = self._stretch(problem, start, x, slice(len(rows), None))
            reached = self._runner.advance(stretch, progress)
            requested = reached.index >= 0
            self.steps += reached.steps
            self.all_steps += reached.steps
            since_output = reached.steps if np.any(requested) else since_output + reached.steps
            if reached.status.is_failure or (reached.status == Status.PAUSED and since_output > steps):
                return FLAGS[reached.status]
            rows = np.vstack([rows, reached.x[requested]])
            integrals = np.vstack([integrals, integral + reached.integrals[requested]])
            start, x, integral = float(reached.times[-1]), reached.x[-1], integral + reached.integrals[-1]
        self.integrals = integrals
        return rows, np.zeros((times.size, 0))

    def _stretch(self, problem: InitialValueProblem, start: float, x: np.ndarray, part: slice) -> Stretch:
        """The problem from a state over some of its intervals."""
        system = self._runner.system
        parameters, levels = system.constants
        return Stretch(
            start,
            x,
            problem.times[part],
            problem.stops[part],
            problem.channel.T[part],
            problem.p[:parameters],
            problem.p[parameters : parameters + levels],
            self._weights,
            *self.tolerances,
            self.integrator.longest_step(problem.max_step),
            most_steps=self._runner.slice,
        )
