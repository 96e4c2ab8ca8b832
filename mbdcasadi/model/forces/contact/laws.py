"""Laws of the normal force between two surfaces: force over penetration and its rate."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca

from ....errors import ModelError
from ...expressions import if_else, positive_power
from ...immutable import Immutable
from ...quantities import Limit, quantity

#: ``χ v`` over the restitution.
DAMPING: dict[str, Callable[[Any], Any]] = {
    "flores": lambda e: 8 / 5 * (1 - e) / e,
    "hunt-crossley": lambda e: 3 / 2 * (1 - e),
    "lankarani-nikravesh": lambda e: 3 / 4 * (1 - e**2),
}


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

    @classmethod
    def from_restitution(
        cls, stiffness: Any, restitution: Any, impact_speed: Any, exponent: Any = 1.5, model: str = "flores"
    ) -> HuntCrossley:
        """The law whose damping gives a restitution at a speed of impact.

        With ``χ = c(e)/v``: Hunt and Crossley ``c = 3/2 (1 - e)`` and Lankarani and
        Nikravesh ``c = 3/4 (1 - e²)``, both for e near one; Flores et al.
        ``c = 8/5 (1 - e)/e``, near to the restitution asked for at all e.

        Parameters
        ----------
        stiffness : float or expression
            k, N/m^n.
        restitution : float or expression
            e, from 0 to 1; above 0 for "flores".
        impact_speed : float or expression
            v, m/s: the speed at which the surfaces meet. At other speeds the restitution is another.
        exponent : float, default 1.5
            n.
        model : {"flores", "hunt-crossley", "lankarani-nikravesh"}
            Which relation.

        References
        ----------
        Lankarani, Nikravesh, J. Mechanical Design 112 (1990) 369; Flores, Machado,
        Silva, Martins, Multibody System Dynamics 25 (2011) 357.
        """
        what = "HuntCrossley.from_restitution"
        if model not in DAMPING:
            raise ModelError(f"{what}: model must be one of {', '.join(DAMPING)}, got {model!r}")
        limits: list[Limit] = []
        e = quantity(restitution, what, "restitution", at_least=0.0, limits=limits)
        quantity(1 - ca.SX(e), what, "1 - restitution", at_least=0.0, limits=limits)
        if model == "flores":
            quantity(e, what, "restitution", above=0.0, limits=limits)
        v = quantity(impact_speed, what, "impact_speed", above=0.0, limits=limits)
        return cls(stiffness, exponent, DAMPING[model](e) / v)

    def __call__(self, penetration: ca.SX, rate: ca.SX) -> ca.SX:
        """Normal force, N, at a penetration (m) and its rate (m/s)."""
        factor = 1 + self.damping * rate
        return self.stiffness * positive_power(penetration, self.exponent) * if_else(factor > 0, factor, 0)

    def potential(self, penetration: ca.SX) -> ca.SX:
        """Elastic energy, J."""
        return self.stiffness * positive_power(penetration, self.exponent + 1) / (self.exponent + 1)

    def __repr__(self) -> str:
        return f"HuntCrossley({self.stiffness}, exponent={self.exponent}, damping={self.damping})"
