"""The explicit form: multipliers eliminated."""

from __future__ import annotations

from typing import ClassVar

import casadi as ca

from ...equations.numeric import NumericEquations
from ...equations.saddle import SaddlePoint
from .base import Arguments, Formulation


class Explicit(Formulation):
    """``a = M⁻¹ (Q - Phi_q^T lam)`` with ``lam`` eliminated by a sparse symbolic LDL factorisation: an ODE."""

    name: ClassVar[str] = "explicit"

    def accelerations(self, numeric: NumericEquations, arguments: Arguments) -> tuple[ca.SX, ca.SX, ca.SX]:
        a, lam = numeric.forward_dynamics(redundant=False)(*arguments[:-1])
        return a, lam, ca.SX(0, 1)

    def under_forces(self, numeric: NumericEquations, force: ca.SX, rate: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        eom = numeric.eom
        system = SaddlePoint(eom.mass_diagonal, eom.Phi_q, force, eom.gamma, eom.angular_rows)
        return *system.solution(augmentation=numeric.augmentation), ca.SX(0, 1)
