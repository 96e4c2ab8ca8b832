"""One-sided forces: stops on any coordinate, and ropes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca

from ...errors import ModelError
from ...numerics.lazy import cached_property
from ..bodies import Marker, ground, markers_on_two
from ..element import BEYOND_COORDINATES, Element, owners, refuse_kinds
from ..expressions import distance
from ..quantities import function_of, no_relation, quantity
from ..rates import time_derivative
from ..symbols import Scalar
from ..validity import Smoothing
from .laws import SpringDamper, continuous_force, pushing_force, stored_energy


class _OneSided(Element):
    """Base class of forces that act if a gap is closed, and open it."""

    #: name of the force, for messages
    _effort = "force"
    gap: ca.SX
    law: Any

    @property
    def watched_gaps(self) -> ca.SX:  # type: ignore[override]
        return self.gap

    @cached_property
    def rate(self) -> ca.SX:
        """Rate of the gap, m/s or rad/s."""
        return time_derivative(self.gap)

    @cached_property
    def force(self) -> ca.SX:
        """Force that opens the gap, N or N m."""
        return pushing_force(self.law, self.gap, self.rate, self.description)

    @cached_property
    def smoothings(self) -> tuple[Smoothing, ...]:  # type: ignore[override]
        """Quantities that change within a short time: the force."""
        course = continuous_force(self.law, self.gap, self.force, self.description)
        return (Smoothing(course, 1.0, f"{self.description}: its {self._effort}", "or soften the law", course),)

    @cached_property
    def potential(self) -> ca.SX:
        """Elastic energy, J; zero for a law that has no ``potential(penetration)``."""
        return stored_energy(self.law, -self.gap)


class EndStop(_OneSided):
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
        self.limits = tuple(getattr(law, "limits", ()))
        # the gap of one body is a distance to the ground
        bodies = owners(self.gap)
        self.__dict__["bodies"] = bodies if len(bodies) > 1 else (*bodies, ground)
        self.virtual_work = ((self.gap, self.force),)


class Rope(_OneSided):
    """Elastic rope, cable or chain between two points: it pulls while it is stretched, and never pushes.

    With the elongation ``e = d - L``, d the distance of the points:
    ``T = max(k e + c ė, 0)`` if ``e > 0``, else 0; ``δW = -T δe``. The rope has no mass.

    Parameters
    ----------
    name : str
        Its name.
    a, b : Marker
        Points on two bodies.
    length : float or expression in coordinates, time and parameters
        Length L without force, m. The tension acts on the coordinates of an expression by ``T ∂L/∂q``: on the angle of
        a drum by a couple alone, so that the load of its bearing lacks the tension.
    stiffness : float or expression
        k, N/m; of a wire of modulus E and cross-section A, ``E A / L``.
    damping : float or expression, default 0
        c, N s/m.

    Attributes
    ----------
    distance, elongation, rate : casadi.SX
        Distance d of the points and elongation e, m; the rate of :attr:`gap`, m/s.
    gap : casadi.SX
        Slack ``-e``, m; negative while the rope is stretched.
    tension : casadi.SX
        T, N.

    Raises
    ------
    ModelError
        For a length or stiffness that is not positive, or a negative damping.

    See Also
    --------
    Distance : a massless rod of constant length, which pushes as well as pulls.

    Notes
    -----
    ``simulate`` does not step over a rope that is taut for a short time, and warns if its steps did not resolve the
    tension. With damping, the tension jumps to ``c ė`` when the rope becomes taut.

    Examples
    --------
    A bungee jump::

        cord = mbd.Rope("cord", bridge.at(0, 0), jumper.at(0, 1), length=20, stiffness=120, damping=15)
        motion[cord.tension].max()
    """

    kind = "rope"
    _effort = "tension"

    def __init__(self, name: str, a: Marker, b: Marker, length: Scalar, stiffness: Scalar, damping: Scalar = 0.0):
        super().__init__(name)
        self.markers = self.a, self.b = markers_on_two(a, b, self.description)
        self.length = self.read(length, "length", above=0.0)
        refuse_kinds(self.length, BEYOND_COORDINATES, self.description, "a length depends on coordinates and time only")
        self.stiffness = self.read(stiffness, "stiffness", above=0.0)
        self.damping = self.read(damping, "damping", at_least=0.0)
        self.law = SpringDamper(self.stiffness, self.damping)
        self.distance = distance(self.a, self.b)
        self.elongation = self.distance - self.length
        self.gap = -self.elongation
        self.virtual_work = ((self.gap, self.tension),)
        self.__dict__["bodies"] = tuple(dict.fromkeys((self.a.body, self.b.body, *owners(self.length))))

    @property
    def tension(self) -> ca.SX:
        """Force with which the rope pulls its ends together, N; never negative."""
        return self.force
