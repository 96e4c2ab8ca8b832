"""Dry friction, smoothed at rest."""

from __future__ import annotations

from typing import Any

import casadi as ca

from ...quantities import Limit, quantity
from .base import FrictionLaw, Resistance


class Coulomb(FrictionLaw):
    """``F = -μ N tanh(v/v_t)``.

    Parameters
    ----------
    coefficient : float or expression
        μ, at least 0.
    velocity_tolerance : float or expression
        v_t, m/s: the speed over which the jump at rest is spread. Under a steady push
        below μ N the surfaces creep, at ``v_t artanh(F/(μ N))``.

    References
    ----------
    Andersson, Söderberg, Björklund, "Friction models for sliding dry, boundary and
    mixed lubricated contacts", Tribology International 40 (2007) 580.

    Examples
    --------
    >>> import mbdcasadi as mbd
    >>> mbd.Coulomb(0.3, velocity_tolerance=1e-4)
    Coulomb(0.3, velocity_tolerance=0.0001)
    """

    def __init__(self, coefficient: Any, velocity_tolerance: Any):
        limits: list[Limit] = []
        self.coefficient = quantity(coefficient, "Coulomb", "coefficient", at_least=0.0, limits=limits)
        self.velocity_tolerance = quantity(
            velocity_tolerance, "Coulomb", "velocity_tolerance", above=0.0, limits=limits
        )
        self.limits = tuple(limits)

    def resistance(self, name: str, speed: ca.SX, load: ca.SX) -> Resistance:
        """Force against the motion."""
        sign = ca.tanh(speed / self.velocity_tolerance)
        return Resistance(-self.coefficient * load * sign, smoothed=(sign,))

    def __repr__(self) -> str:
        return f"Coulomb({self.coefficient}, velocity_tolerance={self.velocity_tolerance})"
