"""Laws of the normal force between two surfaces: force over penetration and its rate."""

from __future__ import annotations

from typing import Any

import casadi as ca

from ..expressions import if_else, positive_power
from ..immutable import Immutable
from ..quantities import Limit, quantity


class HuntCrossley(Immutable):
    """``F = k δ^n (1 + χ δ̇)``, never negative: an elastic contact that loses energy with the speed.

    Parameters
    ----------
    stiffness : float or expression
        k, N/m^n.
    exponent : float, default 1.5
        n, at least 1; 1.5 for spheres (Hertz), 1 for a linear stop.
    damping : float or expression, default 0
        χ, s/m.

    References
    ----------
    Hunt, Crossley, "Coefficient of restitution interpreted as damping in
    vibroimpact", J. Applied Mechanics 42 (1975) 440, doi:10.1115/1.3423596.
    """

    def __init__(self, stiffness: Any, exponent: Any = 1.5, damping: Any = 0.0):
        what = "HuntCrossley"
        limits: list[Limit] = []
        self.stiffness = quantity(stiffness, what, "stiffness", above=0.0, limits=limits)
        self.exponent = quantity(exponent, what, "exponent", at_least=1.0, limits=limits)
        self.damping = quantity(damping, what, "damping", at_least=0.0, limits=limits)
        self.limits = tuple(limits)

    def __call__(self, penetration: ca.SX, rate: ca.SX) -> ca.SX:
        """Normal force, N, at a penetration (m) and its rate (m/s)."""
        factor = 1 + self.damping * rate
        return self.stiffness * positive_power(penetration, self.exponent) * if_else(factor > 0, factor, 0)

    def potential(self, penetration: ca.SX) -> ca.SX:
        """Elastic energy, J."""
        return self.stiffness * positive_power(penetration, self.exponent + 1) / (self.exponent + 1)

    def __repr__(self) -> str:
        return f"HuntCrossley({self.stiffness}, exponent={self.exponent}, damping={self.damping})"
