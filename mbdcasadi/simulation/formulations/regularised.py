"""The regularised form: for dependent rows, and past singular poses."""

from __future__ import annotations

from typing import ClassVar

import casadi as ca

from ...equations.dynamics import stabilised
from ...equations.numeric import NumericEquations
from ...equations.saddle import ON_THE_WAY
from ...integrators import Integrator
from .base import Formulation


class Regularised(Formulation):
    """``lam`` eliminated with ``S + epsilon I`` and refinement, and drift that decays: an ODE."""

    name: ClassVar[str] = "regularised"
    tolerates_redundancy: ClassVar[bool] = True

    @classmethod
    def suits(cls, numeric: NumericEquations, integrator: Integrator, *, redundant: bool) -> bool:
        return redundant and not numeric.eom.Q_depends_on_lam

    def under_forces(self, numeric: NumericEquations, force: ca.SX, rate: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        a, lam = numeric.saddle(ON_THE_WAY).solve(force, stabilised(numeric.eom, rate))
        return a, lam, ca.SX(0, 1)
