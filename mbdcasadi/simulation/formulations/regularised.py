"""The regularised form: for dependent rows, and past singular poses."""

from __future__ import annotations

from typing import ClassVar

import casadi as ca

from ...equations.numeric import NumericEquations
from .base import Arguments, Formulation


class Regularised(Formulation):
    """``lam`` eliminated with ``S + epsilon I`` and refinement, and drift that decays: an ODE."""

    name: ClassVar[str] = "regularised"
    tolerates_redundancy: ClassVar[bool] = True

    def accelerations(self, numeric: NumericEquations, arguments: Arguments) -> tuple[ca.SX, ca.SX, ca.SX]:
        a, lam = numeric.stabilised_dynamics()(*arguments)
        return a, lam, ca.SX(0, 1)
