"""Tolerances of an integrator that smoothed friction asks for."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from ..equations.numeric import NumericEquations
from ..errors import SimulationError

#: Largest absolute tolerance, as a share of the velocity over which friction is smoothed: with tolerances near to
#: that velocity every integrator steps over the change of sign and gives wrong motions without a word.
SHARE = 1e-3
#: Smallest absolute tolerance that an integrator can keep to.
SMALLEST = 1e-13


def absolute_tolerance(numeric: NumericEquations, asked: float) -> float:
    """The absolute tolerance of a run: what was asked for, or less where friction needs it.

    Raises
    ------
    SimulationError
        For a velocity tolerance that no integrator resolves.
    """
    found: list[tuple[float, Any]] = []
    eom = numeric.eom
    for element in eom.mechanism.elements:
        tolerance = getattr(element, "velocity_tolerance", None)
        if tolerance is None or ca.depends_on(ca.SX(tolerance), ca.vertcat(*eom.symbols[:-1])):
            continue
        value = float(ca.Function("tolerance", [eom.p], [ca.SX(tolerance)])(numeric.p))
        found.append((value, element))
    if not found:
        return asked
    narrowest, element = min(found, key=lambda pair: pair[0])
    if not np.isfinite(narrowest) or narrowest * SHARE < SMALLEST:
        raise SimulationError(
            f"{element.what}: the velocity tolerance {narrowest:.3g} m/s is too narrow for an integrator, which keeps "
            f"to {SMALLEST:.0e} at best; take at least {SMALLEST / SHARE:.0e}, or DryFriction, which needs none"
        )
    return min(asked, SHARE * narrowest)
