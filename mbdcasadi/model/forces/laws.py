"""Laws of forces that the user gives as functions: how elements ask them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca

from ..expressions import fabs, fmax, fmin, if_else
from ..quantities import quantity


def pushing_force(law: Callable[[Any, Any], Any], gap: ca.SX, rate: ca.SX, what: str) -> ca.SX:
    """Force ``law(-gap, -rate)`` where a gap is closed, and zero where it is open."""
    closed = gap < 0
    # the law sees a harmless penetration where nothing touches: its derivatives stay finite there
    depth, speed = if_else(closed, -gap, 0), if_else(closed, -rate, 0)
    return if_else(closed, ca.SX(quantity(law(depth, speed), what, "law")), 0)


def continuous_force(law: Callable[[Any, Any], Any], gap: ca.SX, force: ca.SX, what: str) -> ca.SX:
    """Part of a pushing force without its jumps: no larger than the force of the law at the same depth at rest.

    A law with damping jumps when the gap closes or opens; the steps of a run need not follow that, but what is left.
    """
    most = fabs(pushing_force(law, gap, ca.SX(0), what))
    return fmax(fmin(force, most), -most)


def stored_energy(law: Callable[..., Any], deflection: ca.SX) -> ca.SX:
    """Energy that a law has stored, J, by its ``potential(deflection)``; zero for one that has none."""
    energy = getattr(law, "potential", None)
    return ca.SX(0) if energy is None else ca.SX(energy(deflection))
