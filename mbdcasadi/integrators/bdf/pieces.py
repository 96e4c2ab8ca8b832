"""Differentiation formulas in C over pieces of an output grid, in the place of an integrator of CasADi."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import ClassVar

import numpy as np

from ...errors import SimulationError
from ...model.cache import Cache
from ..base import Integrator, tightened
from ..compiled import CompiledIntegrator, InitialValueProblem
from ..native.runner import Run, Runner
from ..native.stretch import ExplicitSystem, Progress, Status, Stretch

#: Tolerances are divided by this: the error accumulates, as that of IDAS does; and the tightest one.
TIGHTER, TIGHTEST = 100.0, 1e-13
#: Flags of IDAS for the same causes.
FLAGS = {Status.TOO_SMALL: "IDA_ERR_FAIL", Status.NOT_FINITE: "IDA_REP_RES_ERR", Status.PAUSED: "IDA_TOO_MUCH_WORK"}


class ImplicitRunner(Runner):
    """Runs one system by differentiation formulas, in C alone."""

    method: ClassVar[str] = "bdf"

    @staticmethod
    @cache
    def _steps() -> str:
        return (Path(__file__).parent / "steps.c").read_text(encoding="utf-8")

    def _without_c(self, reason: str) -> Run:
        raise SimulationError(f'method="bdf" runs in C alone, and {reason}; use method="idas"')


class NativeIntegrator(CompiledIntegrator):
    """An integrator of one system in C.

    Parameters
    ----------
    system : ExplicitSystem
        The equations, with their slopes.
    integrator : Integrator
        Method and tolerances.
    cache : Cache
        Of the mechanism.

    Raises
    ------
    SimulationError
        Without a C compiler.
    """

    def __init__(self, system: ExplicitSystem, integrator: Integrator, cache: Cache):
        self.integrator = integrator
        self._runner = ImplicitRunner(system, None, cache, compiles=integrator.jit)
        self.restart_counting()

    @property
    def said(self) -> str:
        """Code that runs, in words."""
        return self._runner.said

    def _attempt(self, problem: InitialValueProblem, steps: int) -> tuple[np.ndarray, np.ndarray] | str:
        start, x, times = problem.start, problem.x, problem.times
        self.starts += 1
        self.steps = since_output = 0
        progress, rows, integrals = Progress(), np.zeros((0, x.size)), np.zeros((0, self._runner.system.integrals))
        integral = np.zeros(integrals.shape[1])
        while len(rows) < times.size:
            stretch = self._stretch(problem, start, x, slice(len(rows), None))
            reached = self._runner.advance(stretch, progress)
            wanted = reached.index >= 0
            self.steps += reached.steps
            self.all_steps += reached.steps
            since_output = reached.steps if np.any(wanted) else since_output + reached.steps
            if reached.status.is_failure or (reached.status == Status.PAUSED and since_output > steps):
                return FLAGS[reached.status]
            rows = np.vstack([rows, reached.x[wanted]])
            integrals = np.vstack([integrals, integral + reached.integrals[wanted]])
            start, x, integral = float(reached.times[-1]), reached.x[-1], integral + reached.integrals[-1]
        self.integrals = integrals
        return rows, np.zeros((times.size, 0))

    def _stretch(self, problem: InitialValueProblem, start: float, x: np.ndarray, part: slice) -> Stretch:
        """The problem from a state over some of its intervals."""
        system = self._runner.system
        parameters, levels = system.constants
        channels = np.zeros((problem.times.size, 0)) if problem.u is None else problem.u.T
        return Stretch(
            start,
            x,
            problem.times[part],
            problem.stops[part],
            channels[part],
            problem.p[:parameters],
            problem.p[parameters : parameters + levels],
            np.ones(system.coordinates),
            tightened(self.integrator.reltol, TIGHTER, TIGHTEST),
            tightened(self.integrator.abstol, TIGHTER, TIGHTEST),
            self.integrator.longest_step(problem.max_step),
            most_steps=self._runner.slice,
        )
