"""Stops: one-sided forces on any coordinate."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import casadi as ca

from ...errors import ModelError
from ..bodies import ground
from ..element import BEYOND_COORDINATES, Element, owners, refuse_kinds
from ..quantities import function_of, quantity
from ..rates import time_derivative
from ..smoothing import Smoothing
from .laws import pushing_force, stored_energy


class EndStop(Element):
    """Stop that acts where a gap is closed: ``F = law(-gap, -gap rate)``, ``δW = F δgap``.

    Parameters
    ----------
    name : str
        Its name.
    gap : casadi.SX
        What is left until the stop, in coordinates, parameters and time: m, or rad for a
        stop on an angle; ``guide.displacement - 0.1``, ``1.2 - hinge.angle``.
    law : callable
        ``law(penetration, rate)`` returns the force (N, or N m on an angle), as
        :class:`HuntCrossley` does. Where the gap is open the force is zero in any case.

    Attributes
    ----------
    gap, rate, force : casadi.SX
        The gap, its rate, and the force that opens it.

    Examples
    --------
    A stop at 100 mm, linear with some damping::

        EndStop("buffer", 0.1 - guide.displacement, mbd.HuntCrossley(2e5, exponent=1, damping=0.5))
    """

    kind = "stop"

    def __init__(self, name: str, gap: Any, law: Callable[[ca.SX, ca.SX], Any]):
        super().__init__(name)
        self.gap = ca.SX(quantity(gap, self.description, "gap"))
        refuse_kinds(self.gap, BEYOND_COORDINATES, self.description, "a gap is one of coordinates")
        if not owners(self.gap):
            raise ModelError(f"{self.description}: the gap {gap} depends on no coordinate of a body")
        self.law = function_of(law, self.description, "law", "penetration", "rate")
        self.limits = tuple(getattr(law, "limits", ()))
        # what a stop leans on is the ground, where its gap does not say otherwise
        found = owners(self.gap)
        self.__dict__["bodies"] = found if len(found) > 1 else (*found, ground)
        self.virtual_work = ((self.gap, self.force),)

    @cached_property
    def rate(self) -> ca.SX:
        """Rate of the gap, m/s or rad/s."""
        return time_derivative(self.gap)

    @cached_property
    def force(self) -> ca.SX:
        """Force that opens the gap, N or N m."""
        return pushing_force(self.law, self.gap, self.rate, self.description)

    @cached_property
    def smoothings(self) -> tuple[Smoothing, ...]:
        """What a run must follow in several steps."""
        return (Smoothing(self.force, 1.0, f"{self.description}: its force", "or soften the law", self.force),)

    @cached_property
    def potential(self) -> ca.SX:
        """Elastic energy, J, where the law knows it."""
        return stored_energy(self.law, -self.gap)
