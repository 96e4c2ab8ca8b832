"""Laws of one-sided forces: force over penetration and its rate, and how elements evaluate them."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import casadi as ca

from ...errors import ModelError
from ..expressions import fabs, fmax, fmin, if_else, positive_power
from ..immutable import Immutable
from ..quantities import HasQuantities, one_of, quantity, value_of
from ..symbols import Scalar, number

#: ``χ v`` as a function of the restitution.
DAMPING: dict[str, Callable[[Any], Any]] = {
    "flores": lambda e: 8 / 5 * (1 - e) / e,
    "hunt-crossley": lambda e: 3 / 2 * (1 - e),
    "lankarani-nikravesh": lambda e: 3 / 4 * (1 - e**2),
}


class HuntCrossley(Immutable, HasQuantities):
    """``F = k δ^n (1 + χ δ̇)``, never negative: an elastic contact whose energy loss grows with the speed.

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

    def __init__(self, stiffness: Scalar, exponent: Scalar = 1.5, damping: Scalar = 0.0):
        self.stiffness = self.read(stiffness, "stiffness", above=0.0)
        self.exponent = self.read(exponent, "exponent", at_least=1.0)
        self.damping = self.read(damping, "damping", at_least=0.0)

    @classmethod
    def from_restitution(
        cls, stiffness: Any, restitution: Any, impact_speed: Any, exponent: Any = 1.5, model: str = "flores"
    ) -> HuntCrossley:
        """Return the law that has a given restitution at a given speed of impact.

        With ``χ = c(e)/v``: Hunt and Crossley ``c = 3/2 (1 - e)`` and Lankarani and
        Nikravesh ``c = 3/4 (1 - e²)``, both for e near one; Flores et al.
        ``c = 8/5 (1 - e)/e``, close to the requested restitution for all e.

        Parameters
        ----------
        stiffness : float or expression
            k, N/m^n.
        restitution : float or expression
            e, from 0 to 1; above 0 for "flores".
        impact_speed : float or expression
            v, m/s: the speed at which the surfaces meet. The restitution is different at other speeds.
        exponent : float, default 1.5
            n.
        model : {"flores", "hunt-crossley", "lankarani-nikravesh"}
            The relation.

        References
        ----------
        Lankarani, Nikravesh, J. Mechanical Design 112 (1990) 369; Flores, Machado,
        Silva, Martins, Multibody System Dynamics 25 (2011) 357.
        """
        what = "HuntCrossley.from_restitution"
        one_of(model, DAMPING, what, "model")
        e = quantity(restitution, what, "restitution", at_least=0.0)
        quantity(1 - ca.SX(e), what, "1 - restitution", at_least=0.0)
        if model == "flores":
            quantity(e, what, "restitution", above=0.0)
        v = quantity(impact_speed, what, "impact_speed", above=0.0)
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


class SpringDamper(Immutable):
    """``F = max(k δ + c δ̇, 0)``: a linear spring (k, N/m) and damper (c, N s/m) that act in one sense only."""

    def __init__(self, stiffness: Any, damping: Any):
        self.stiffness, self.damping = stiffness, damping

    def __call__(self, deflection: ca.SX, rate: ca.SX) -> ca.SX:
        """Force, N, at a deflection (m) and its rate (m/s)."""
        return fmax(self.stiffness * deflection + self.damping * rate, 0)

    def potential(self, deflection: ca.SX) -> ca.SX:
        """Elastic energy, J."""
        return 0.5 * self.stiffness * fmax(deflection, 0) ** 2

    def __repr__(self) -> str:
        return f"SpringDamper({self.stiffness}, {self.damping})"


def hertz_stiffness(
    radius_a: Scalar,
    radius_b: Scalar,
    modulus_a: Scalar,
    modulus_b: Scalar,
    poisson_a: Scalar = 0.3,
    poisson_b: Scalar = 0.3,
) -> float:
    """Return the stiffness k of ``F = k δ^1.5`` between two spheres: ``k = 4/3 E* √R*``.

    ``1/E* = (1 - ν_a²)/E_a + (1 - ν_b²)/E_b``, ``1/R* = 1/R_a + 1/R_b``.

    Parameters
    ----------
    radius_a, radius_b : float
        Radii, m; ``math.inf`` for a flat surface, negative for a hollow one.
    modulus_a, modulus_b : float
        Young's moduli E, Pa; ``math.inf`` for a rigid body.
    poisson_a, poisson_b : float, default 0.3
        Poisson's ratios ν, from 0 to 0.5.

    Returns
    -------
    float
        N/m^1.5.

    Raises
    ------
    ModelError
        For numbers out of their limits, two flat surfaces or two rigid bodies.

    References
    ----------
    Johnson, *Contact Mechanics*, Cambridge 1985, section 4.2.

    Examples
    --------
    A steel ball of 20 mm on a steel plate:

    >>> import math
    >>> f"{hertz_stiffness(0.01, math.inf, 210e9, 210e9):.3e}"
    '1.538e+10'
    """
    what = "hertz_stiffness"
    radii = [number(r, what, n, infinite=True) for r, n in ((radius_a, "radius_a"), (radius_b, "radius_b"))]
    moduli = [number(e, what, n, infinite=True) for e, n in ((modulus_a, "modulus_a"), (modulus_b, "modulus_b"))]
    ratios = [number(x, what, n) for x, n in ((poisson_a, "poisson_a"), (poisson_b, "poisson_b"))]
    for value, name in zip(moduli, ("modulus_a", "modulus_b"), strict=True):
        if value <= 0:
            raise ModelError(f"{what}: {name} must be above 0, got {value}")
    for value, name in zip(ratios, ("poisson_a", "poisson_b"), strict=True):
        if not 0 <= value <= 0.5:
            raise ModelError(f"{what}: {name} must be from 0 to 0.5, got {value}")
    if any(r == 0 for r in radii):
        raise ModelError(f"{what}: a radius of 0 is a sharp tip, which has no Hertz stiffness")
    curvature = sum(1 / r for r in radii)
    if curvature <= 0:
        raise ModelError(f"{what}: the radii {radii[0]:g} and {radii[1]:g} m do not touch in a point")
    compliance = sum((1 - x**2) / e for x, e in zip(ratios, moduli, strict=True))
    if compliance == 0:
        raise ModelError(f"{what}: both bodies are rigid; give one of them a modulus")
    return 4 / 3 / compliance / math.sqrt(curvature)


def pushing_force(law: Callable[[Any, Any], Any], gap: ca.SX, rate: ca.SX, what: str) -> ca.SX:
    """Return the force ``law(-gap, -rate)`` if a gap is closed, and zero if it is open."""
    closed = gap < 0
    # the law gets a harmless penetration if the gap is open, so that its derivatives stay finite
    depth, speed = if_else(closed, -gap, 0), if_else(closed, -rate, 0)
    return if_else(closed, ca.SX(value_of(law, what, "law", depth, speed)), 0)


def continuous_force(law: Callable[[Any, Any], Any], gap: ca.SX, force: ca.SX, what: str) -> ca.SX:
    """Return the part of a pushing force that does not jump: at most the force at the same depth and zero rate.

    The force of a law with damping jumps when the gap closes or opens; the steps of a run need to follow the
    continuous part only.
    """
    most = fabs(pushing_force(law, gap, ca.SX(0), what))
    return fmax(fmin(force, most), -most)


def stored_energy(law: Callable[..., Any], deflection: ca.SX) -> ca.SX:
    """Return the energy stored by a law, J, from its ``potential(deflection)``; zero if it has none."""
    energy = getattr(law, "potential", None)
    return ca.SX(0) if energy is None else ca.SX(energy(deflection))
