"""Dry friction without smoothing."""

from __future__ import annotations

from typing import Any

from ...quantities import Limit, quantity
from .base import FrictionLaw
from .stribeck import check_static


class DryFriction(FrictionLaw):
    """Exact stick and slip in a joint: ``|F| <= μ_s N`` at rest, ``F = -μ N sgn v`` in motion.

    In :func:`simulate` alone. The run switches between sticking, where the sliding speed
    is held at zero by a multiplier, and sliding, at instants that are located to
    rounding: they are in ``motion.events`` as "<name> stops" and "<name> breaks away".
    Nothing creeps, and no velocity tolerance is needed. Events that reset velocities act as
    without friction: it takes no part in an impulse.

    Parameters
    ----------
    coefficient : float or expression
        μ of sliding, at least 0.
    static_coefficient : float or expression, optional
        μ_s of rest, at least μ; μ where it is not given.

    References
    ----------
    Haug, Wu, Yang, "Dynamics of mechanical systems with Coulomb friction, stiction,
    impact and constraint addition-deletion", Mechanism and Machine Theory 21 (1986) 401.

    Examples
    --------
    >>> import mbdcasadi as mbd
    >>> mbd.DryFriction(0.3, static_coefficient=0.4)
    DryFriction(0.3, static_coefficient=0.4)
    """

    exact = True

    def __init__(self, coefficient: Any, static_coefficient: Any = None):
        limits: list[Limit] = []
        what = "DryFriction"
        self.coefficient = quantity(coefficient, what, "coefficient", at_least=0.0, limits=limits)
        static = coefficient if static_coefficient is None else static_coefficient
        self.static_coefficient = quantity(static, what, "static_coefficient", at_least=0.0, limits=limits)
        check_static(self.coefficient, self.static_coefficient, what, limits)
        self.limits = tuple(limits)

    def __repr__(self) -> str:
        return f"DryFriction({self.coefficient}, static_coefficient={self.static_coefficient})"
