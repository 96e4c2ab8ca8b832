"""Stiffness of curved surfaces in contact."""

from __future__ import annotations

import math
from typing import Any

from ....errors import ModelError
from ...symbols import number


def hertz_stiffness(
    radius_a: Any, radius_b: Any, modulus_a: Any, modulus_b: Any, poisson_a: Any = 0.3, poisson_b: Any = 0.3
) -> float:
    """Stiffness k of ``F = k δ^1.5`` between two spheres: ``k = 4/3 E* √R*``.

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
