"""Friction of bristles that bend: it sticks, with a small elastic displacement."""

from __future__ import annotations

from typing import Any

import casadi as ca

from ...quantities import Limit, quantity
from ...symbols import StateVariable
from .base import FrictionLaw, Resistance
from .stribeck import check_static


class LuGre(FrictionLaw):
    """``F = -N (σ0 z + σ1 ż)``, ``ż = v - σ0 |v| z / g(v)``, ``g = μ + (μ_s - μ) exp(-(v/v_s)²)``.

    The bristles' deflection z is a first-order state of each place where the law acts.
    At rest F holds any push up to μ_s N, without creep.

    Parameters
    ----------
    coefficient, static_coefficient : float or expression
        μ and μ_s, ``0 < μ <= μ_s``.
    stribeck_velocity : float or expression
        v_s, m/s.
    stiffness : float or expression
        σ0, 1/m: of the bristles for each newton of load; μ_s/σ0 is the largest deflection.
    damping : float or expression, default 0
        σ1, s/m, for each newton of load. It acts as ``σ1(v) = σ1 exp(-(v/v_s)²)``, which keeps
        the bristles from driving the motion at speed.

    Notes
    -----
    With the bristles' energy ``N σ0 z²/2`` the law takes
    ``N |v| (u² - σ1(v) v u + σ1(v) |v| g)/g``, ``u = σ0 z``, from the motion: never less than
    nothing, at whatever deflection, where ``σ1(v) |v| <= 4 g(v)``, so surely with
    ``σ1 v_s <= 4 √(2e) μ ≈ 9.3 μ``. With more damping than that it may put energy into the motion,
    and also where the load changes while the bristles are bent, as at a contact that bounces: a
    growing load stiffens them without work. With a constant σ1, as it was first proposed, it would
    ask for viscous friction of at least ``N σ1 (μ_s - μ)/μ`` besides (Barabanov and Ortega).

    References
    ----------
    Canudas de Wit, Olsson, Åström, Lischinsky, "A new model for control of systems with
    friction", IEEE Trans. Automatic Control 40 (1995) 419; Olsson, "Control systems with
    friction", thesis, Lund 1996 (damping that falls with the speed); Barabanov, Ortega, "Necessary
    and sufficient conditions for passivity of the LuGre friction model", IEEE Trans. Automatic
    Control 45 (2000) 830.
    """

    remedy = "or take softer bristles"

    def __init__(
        self, coefficient: Any, static_coefficient: Any, stribeck_velocity: Any, stiffness: Any, damping: Any = 0.0
    ):
        limits: list[Limit] = []
        what = "LuGre"
        self.coefficient = quantity(coefficient, what, "coefficient", above=0.0, limits=limits)
        self.static_coefficient = quantity(static_coefficient, what, "static_coefficient", above=0.0, limits=limits)
        self.stribeck_velocity = quantity(stribeck_velocity, what, "stribeck_velocity", above=0.0, limits=limits)
        self.stiffness = quantity(stiffness, what, "stiffness", above=0.0, limits=limits)
        self.damping = quantity(damping, what, "damping", at_least=0.0, limits=limits)
        check_static(self.coefficient, self.static_coefficient, what, limits)
        self.deflection_tolerance = self.static_coefficient / self.stiffness
        self.limits = tuple(limits)

    def resistance(self, name: str, speed: ca.SX, load: ca.SX) -> Resistance:
        """Force against the motion, with a deflection of its own."""
        deflection = StateVariable(f"{name}.deflection")
        near = ca.exp(-((speed / self.stribeck_velocity) ** 2))
        g = self.coefficient + (self.static_coefficient - self.coefficient) * near
        rate = speed - self.stiffness * ca.fabs(speed) * deflection / g
        force = -load * (self.stiffness * deflection + self.damping * near * rate)
        return Resistance(force, {deflection: rate}, (self.stiffness / self.static_coefficient * deflection,))

    def __repr__(self) -> str:
        return (
            f"LuGre({self.coefficient}, {self.static_coefficient}, {self.stribeck_velocity}, {self.stiffness}, "
            f"damping={self.damping})"
        )
