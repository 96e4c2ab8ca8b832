"""The regularised form: for dependent rows, and past singular poses."""

from __future__ import annotations

from typing import ClassVar

import casadi as ca

from ...equations.dynamics import solved_linearly, stabilised
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
        return redundant and numeric.eom.Q_is_linear_in_lam

    def under_forces(self, numeric: NumericEquations, force: ca.SX, rate: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        eom = numeric.eom
        return *solved_linearly(eom, numeric.saddle(ON_THE_WAY), force, stabilised(eom, rate)), ca.SX(0, 1)
