"""Dry friction that falls off from rest to sliding, smoothed at rest."""

from __future__ import annotations

from typing import Any

import casadi as ca

from ....errors import ModelError
from ...quantities import Limit, known_value, quantity
from .base import FrictionLaw, Resistance

#: Largest share of the Stribeck velocity that the velocity tolerance may be: above it the static peak is cut off.
SHARE = 0.2


class Stribeck(FrictionLaw):
    """``F = -N (μ + (μ_s - μ) exp(-(v/v_s)²)) tanh(v/v_t)``.

    Parameters
    ----------
    coefficient, static_coefficient : float or expression
        μ of sliding and μ_s of rest, ``0 <= μ <= μ_s``.
    stribeck_velocity : float or expression
        v_s, m/s, over which friction falls from rest to sliding.
    velocity_tolerance : float or expression
        v_t, m/s, at most a fifth of v_s: with more, the peak at rest is not reached.

    References
    ----------
    Armstrong-Hélouvry, Dupont, Canudas de Wit, "A survey of models, analysis tools and
    compensation methods for the control of machines with friction", Automatica 30 (1994) 1083.
    """

    def __init__(self, coefficient: Any, static_coefficient: Any, stribeck_velocity: Any, velocity_tolerance: Any):
        limits: list[Limit] = []
        what = "Stribeck"
        self.coefficient = quantity(coefficient, what, "coefficient", at_least=0.0, limits=limits)
        self.static_coefficient = quantity(static_coefficient, what, "static_coefficient", at_least=0.0, limits=limits)
        self.stribeck_velocity = quantity(stribeck_velocity, what, "stribeck_velocity", above=0.0, limits=limits)
        self.velocity_tolerance = quantity(velocity_tolerance, what, "velocity_tolerance", above=0.0, limits=limits)
        check_static(self.coefficient, self.static_coefficient, what, limits)
        tolerance, velocity = known_value(self.velocity_tolerance), known_value(self.stribeck_velocity)
        if tolerance is not None and velocity is not None and tolerance > SHARE * velocity:
            raise ModelError(
                f"Stribeck: velocity_tolerance = {tolerance:g} m/s cuts off the static peak, which is "
                f"{velocity:g} m/s wide; take at most {SHARE * velocity:g}"
            )
        self.limits = tuple(limits)

    def resistance(self, name: str, speed: ca.SX, load: ca.SX) -> Resistance:
        """Force against the motion."""
        excess = (self.static_coefficient - self.coefficient) * ca.exp(-((speed / self.stribeck_velocity) ** 2))
        sign = ca.tanh(speed / self.velocity_tolerance)
        return Resistance(-load * (self.coefficient + excess) * sign, smoothed=(sign,))

    def __repr__(self) -> str:
        return (
            f"Stribeck({self.coefficient}, {self.static_coefficient}, {self.stribeck_velocity}, "
            f"velocity_tolerance={self.velocity_tolerance})"
        )


def check_static(sliding: Any, static: Any, what: str, limits: list[Limit]) -> None:
    """Refuse a static coefficient below the one of sliding."""
    quantity(ca.SX(static) - sliding, what, "static_coefficient - coefficient", at_least=0.0, limits=limits)
