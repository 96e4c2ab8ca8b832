"""Conditions on several poses at once: the unknowns are the poses and the free parameters, which they share."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import casadi as ca
import numpy as np

from ...equations.numeric import NumericEquations
from ...model.placeholders import Placeholder, placeholders_in, with_values
from ...model.symbols import Parameter
from ...numerics.newton import Equations
from ..statement.phase import Phase, on_positions
from ..statement.statement import ProblemStatement

#: Weight of a change of a parameter by its own size, relative to that of a typical step of the heaviest body.
PARAMETER_WEIGHT = 1e-2
#: Phase, time, s, and pose in the coordinates of the phase.
Place = tuple[Phase, float | ca.SX, ca.SX]


class PoseSystem:
    """Poses of the phases of a problem, and its free parameters, as unknowns of one system.

    `numerics` are the equations of the phases, at the parameters that are given.
    """

    def __init__(self, problem: ProblemStatement, numerics: Mapping[Phase, NumericEquations]):
        self._problem, self._numerics = problem, numerics
        self.parameters: tuple[Parameter, ...] = problem.free_parameters
        self.free = ca.SX.sym("f", len(self.parameters))
        #: values of the free parameters to begin with, and their typical sizes
        self.values = np.array([problem.phases[0].mechanism.value_of(p, p.value) for p in self.parameters])
        self.sizes = np.array([p.typical_size or 1.0 for p in self.parameters])

    def weights(self, numerics: Sequence[NumericEquations]) -> np.ndarray:
        """Weights of the unknowns in a step: poses by these equations, then the free parameters."""
        heavy = max(float(np.max(n.weights * n.typical_step**2)) for n in numerics)
        return np.concatenate([*(n.weights for n in numerics), PARAMETER_WEIGHT * heavy / self.sizes**2])

    def value(self, expression: ca.SX, place: Place) -> ca.SX:
        """An expression in positions at a place, with the unknowns substituted for poses and free parameters."""
        phase, time, pose = place
        eom = phase.equations
        p, extra = phase.with_free(ca.DM(self._numerics[phase].p), self.parameters, self.free)
        extra_symbols = ca.vertcat(ca.SX(0, 1), *self._problem.extra_parameters(phase))
        symbols = [eom.t, eom.q, eom.z, eom.p, extra_symbols]
        values = [time, pose, ca.SX(ca.DM(eom.estimate[2])), p, extra]
        return ca.substitute([expression], symbols, values)[0]

    def relations(self, place_of_end: Callable[[Phase, bool], Place]) -> list[ca.SX]:
        """Boundary conditions between positions; `place_of_end` is that of the start or the end of a phase."""
        rows, problem = [], self._problem

        def value(mark: Placeholder) -> ca.SX:
            return self.value(mark.expression, place_of_end(problem.phases_of(mark)[0], mark.kind == "at_end"))

        for condition in problem.boundary:
            marks = placeholders_in(condition.expression)
            rest = with_values(condition.expression, lambda _: 0.0)
            between = all(m.kind != "integral" and on_positions(m.expression) for m in marks)
            if condition.equality and marks and between and on_positions(rest, allow_none=True):
                # symbols outside of placeholders are taken at the end of the motion
                end = place_of_end(problem.phases[-1], True)
                rows.append(self.value(with_values(condition.expression, value), end))
        return rows

    def within_limits(self, values: np.ndarray) -> np.ndarray:
        """Values of the free parameters, moved into their limits."""
        low, high = (np.array([getattr(p, side) for p in self.parameters]) for side in ("lower", "upper"))
        return np.clip(values, low, high)


def newton_rows(rows: ca.SX, unknowns: ca.SX) -> Equations:
    """Return the function of residuals and their Jacobian as Newton's method takes it."""
    function = ca.Function("rows", [unknowns], [ca.densify(rows), ca.densify(ca.jacobian(rows, unknowns))])

    def equations(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        residual, jacobian = function(x)
        return residual.full().ravel(), jacobian.full()

    return equations
