"""One-sided forces: stops on any coordinate."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca

from ...errors import ModelError
from ...numerics.lazy import cached_property
from ..bodies import ground
from ..element import BEYOND_COORDINATES, Element, owners, refuse_kinds
from ..quantities import function_of, no_relation, quantity
from ..rates import time_derivative
from ..symbols import Scalar
from ..validity import Smoothing
from .laws import continuous_force, pushing_force, stored_energy


class OneSided(Element):
    """Base class of forces that act if a gap (k,) is closed, and open it, each by a law."""

    #: name of the force, for messages
    _effort = "force"
    gap: ca.SX
    laws: tuple[Any, ...]

    @property
    def watched_gaps(self) -> ca.SX:  # type: ignore[override]
        return self.gap

    @cached_property
    def rate(self) -> ca.SX:
        """Rate of the gap, m/s or rad/s."""
        return time_derivative(self.gap)

    def _each(self) -> list[tuple[Any, ca.SX, ca.SX]]:
        """Law, gap and rate of each."""
        return list(zip(self.laws, ca.vertsplit(self.gap), ca.vertsplit(self.rate), strict=True))

    @cached_property
    def force(self) -> ca.SX:
        """Force that opens the gap, N or N m."""
        return ca.vertcat(*[pushing_force(law, gap, rate, self.description) for law, gap, rate in self._each()])

    @cached_property
    def smoothings(self) -> tuple[Smoothing, ...]:  # type: ignore[override]
        """Quantities that change within a short time: the sum of the forces, none of which pulls."""
        course = sum(
            (
                continuous_force(law, gap, force, self.description)
                for (law, gap, _), force in zip(self._each(), ca.vertsplit(self.force), strict=True)
            ),
            ca.SX(0),
        )
        return (Smoothing(course, 1.0, f"{self.description}: its {self._effort}", "or soften the law", course),)

    @cached_property
    def potential(self) -> ca.SX:
        """Elastic energy, J; zero for a law that has no ``potential(penetration)``."""
        return sum((stored_energy(law, -gap) for law, gap, _ in self._each()), ca.SX(0))


class EndStop(OneSided):
    """Stop that acts if a gap is closed: ``F = law(-gap, -gap rate)``, ``δW = F δgap``.

    Parameters
    ----------
    name : str
        Its name.
    gap : casadi.SX
        Distance from the stop, in coordinates, parameters and time: m, or rad for a
        stop on an angle; ``guide.displacement - 0.1``, ``1.2 - hinge.angle``.
    law : callable
        ``law(penetration, rate)`` returns the force (N, or N m on an angle), as
        :class:`HuntCrossley` does. While the gap is open the force is zero in any case.

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

    def __init__(self, name: str, gap: Scalar, law: Callable[[ca.SX, ca.SX], Any]):
        super().__init__(name)
        self.gap = ca.SX(no_relation(quantity(gap, self.description, "gap"), self.description, "gap"))
        refuse_kinds(self.gap, BEYOND_COORDINATES, self.description, "a gap depends on coordinates only")
        if not owners(self.gap):
            raise ModelError(f"{self.description}: the gap {gap} depends on no coordinate of a body")
        self.law = function_of(law, self.description, "law", "penetration", "rate")
        self.laws = (self.law,)
        self.limits = tuple(getattr(law, "limits", ()))
        # the gap of one body is a distance to the ground
        bodies = owners(self.gap)
        self.__dict__["bodies"] = bodies if len(bodies) > 1 else (*bodies, ground)
        self.virtual_work = ((self.gap, self.force),)
