"""Tolerances of an integrator that the size of a mechanism and smoothed friction ask for."""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from ..equations import Equations
from ..equations.numeric import NumericEquations
from ..errors import SimulationError
from ..integrators.base import ABSTOL

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
    smoothed = numeric.eom.mechanism.cache.get_or_create("widths of friction", lambda: _widths(numeric.eom))
    if smoothed is None:
        return None
    widths = smoothed.function(numeric.p).full().ravel()
    k = int(np.argmin(widths))
    element, words = smoothed.owners[k]
    return float(widths[k]), element, words.format(widths[k])


class _Widths(NamedTuple):
    """Widths over which friction is smoothed as a function of the parameters, and the element and words for each."""

    function: ca.Function
    owners: list[tuple[Any, str]]


def _widths(eom: Equations) -> _Widths | None:
    """Widths over which the friction of a mechanism is smoothed, as far as they do not change along a motion."""
    offered = [
        (ca.SX(getattr(law, name)), element, words)
        for element in eom.mechanism.elements
        for law in getattr(element, "resolved_laws", ())
        for name, words in NARROW.items()
        if getattr(law, name) is not None
    ]
    varying = ca.vertcat(*eom.symbols[:-1])
    known = [entry for entry in offered if not ca.depends_on(entry[0], varying)]
    if not known:
        return None
    function = ca.Function("widths", [eom.p], [ca.densify(ca.vertcat(*[width for width, _, _ in known]))])
    return _Widths(function, [(element, words) for _, element, words in known])


def default_abstol(numeric: NumericEquations) -> float:
    """The absolute tolerance of a run for which none is given: less than usual for a mechanism of less than 1 cm."""
    return ABSTOL * numeric.scale.fineness


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
    smallest = SMALLEST_FOR_FRICTION * numeric.scale.fineness
    if not np.isfinite(narrowest) or narrowest * FRICTION_SHARE < smallest:
        raise SimulationError(
            f"{element.description}: {words} is too narrow for an integrator, which keeps to "
            f"{smallest:.0e} at best; take at least {smallest / FRICTION_SHARE:.0e}, or "
            "DryFriction, which needs none"
        )
    return min(asked, FRICTION_SHARE * narrowest)
