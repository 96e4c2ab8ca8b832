"""DOP853 over pieces of an output grid."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...numerics.least_squares import largest
from ...numerics.tolerances import PROJECTIONS
from ..compiled import InitialValueProblem
from ..native.pieces import NativeIntegrator
from .runner import ExplicitRunner

#: Correction of a start by projection, relative to 1 + |x|, after which rounding is left: its square.
NEAR = 1e-8


class ExplicitIntegrator(NativeIntegrator):
    """An integrator of an explicit system by DOP853; a start may be off the constraints."""

    runner = ExplicitRunner

    def _attempt(self, problem: InitialValueProblem, steps: int) -> tuple[np.ndarray, np.ndarray] | str:
        system = self._runner.system
        if system.multipliers:
            n, p = 2 * system.coordinates, problem.p[: system.constants[0]]
            x = problem.x
            for _ in range(PROJECTIONS):
                q, v, _ = system.projection(
                    problem.start, *np.split(x[:n], 2), x[n : n + system.states], p, self._weights
                )
                before, x = x, np.r_[q.full().ravel(), v.full().ravel(), x[n:]]
                if largest(x - before) <= NEAR * (1 + largest(x)):
                    break
            problem = replace(problem, x=x)
        return super()._attempt(problem, steps)
