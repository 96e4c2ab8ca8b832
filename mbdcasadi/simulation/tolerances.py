"""Tolerances of an integrator that smoothed friction asks for."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from ..equations.numeric import NumericEquations
from ..errors import SimulationError

#: Quantity over which friction is spread, by attribute, in words.
NARROW = {
    "velocity_tolerance": "the velocity tolerance {:.3g} m/s",
    "deflection_tolerance": "the largest deflection of the bristles, {:.3g} m,",
}
#: Largest absolute tolerance, as a share of the velocity over which friction is smoothed, or
#: of the way over which bristles bend: with tolerances near to
#: that velocity every integrator steps over the change of sign and gives wrong motions silently.
FRICTION_SHARE = 1e-3
#: Smallest absolute tolerance that an integrator can keep to.
SMALLEST_FOR_FRICTION = 1e-13


def narrowest_friction(numeric: NumericEquations) -> tuple[float, Any, str] | None:
    """The narrowest width over which friction is smoothed, its element, and words for it; None without any."""
    widths: list[tuple[float, Any, str]] = []
    eom = numeric.eom
    for element in eom.mechanism.elements:
        for name, words in NARROW.items():
            width = getattr(element, name, None)
            if width is None:
                continue
            width = ca.SX(width)
            if not width.is_constant():
                if ca.depends_on(width, ca.vertcat(*eom.symbols[:-1])):
                    continue
                width = ca.Function("width", [eom.p], [width])(numeric.p)
            value = float(width)
            widths.append((value, element, words.format(value)))
    return min(widths, key=lambda entry: entry[0], default=None)


def absolute_tolerance(numeric: NumericEquations, asked: float) -> float:
    """The absolute tolerance of a run: what was asked for, or less where friction needs it.

    Raises
    ------
    SimulationError
        For a velocity tolerance that no integrator resolves.
    """
    narrowest_law = narrowest_friction(numeric)
    if narrowest_law is None:
        return asked
    narrowest, element, words = narrowest_law
    if not np.isfinite(narrowest) or narrowest * FRICTION_SHARE < SMALLEST_FOR_FRICTION:
        raise SimulationError(
            f"{element.description}: {words} is too narrow for an integrator, which keeps to "
            f"{SMALLEST_FOR_FRICTION:.0e} at best; take at least {SMALLEST_FOR_FRICTION / FRICTION_SHARE:.0e}, or "
            "DryFriction, which needs none"
        )
    return min(asked, FRICTION_SHARE * narrowest)
