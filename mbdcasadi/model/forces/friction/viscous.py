"""Friction of a fluid film."""

from __future__ import annotations

from typing import Any

import casadi as ca

from ...quantities import Limit, quantity
from .base import FrictionLaw, Resistance


class Viscous(FrictionLaw):
    """``F = -c v``, whatever the load is; in a contact while the surfaces touch.

    Parameters
    ----------
    coefficient : float or expression
        c, N s/m, at least 0; in a pin, of the surfaces, so that the torque is ``-c r² ω``.
    """

    def __init__(self, coefficient: Any):
        limits: list[Limit] = []
        self.coefficient = quantity(coefficient, "Viscous", "coefficient", at_least=0.0, limits=limits)
        self.limits = tuple(limits)

    def resistance(self, name: str, speed: ca.SX, load: ca.SX) -> Resistance:
        """Force against the motion."""
        return Resistance(-self.coefficient * speed)

    def __repr__(self) -> str:
        return f"Viscous({self.coefficient})"
