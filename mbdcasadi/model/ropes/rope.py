"""Elastic ropes over pulleys: they pull while they are stretched, and never push."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca

from ...errors import ModelError
from ...numerics.lazy import cached_property
from ..bodies import Marker
from ..element import BEYOND_COORDINATES, owners, refuse_kinds
from ..forces.laws import SpringDamper
from ..forces.stops import OneSided
from ..symbols import Scalar
from .path import RopePath
from .pulleys import Drum, Pulley


class Rope(OneSided):
    """Elastic rope, cable or chain over any number of pulleys: it pulls while it is stretched, and never pushes.

    With the elongation ``e = l - L``, l the length of its strands, of its wraps and of what has wound up:
    ``T = max(k e + c ė, 0)`` if ``e > 0``, else 0; ``δW = -T δe``. Each strand pulls the bodies at its ends, so that
    bearings carry it. The rope has no mass.

    Parameters
    ----------
    name : str
        Its name.
    a, b : Marker or Drum
        Its ends; on a drum it winds up.
    length : float or expression in coordinates, time and parameters
        Length L without force, m, of strands and wraps together; what is wound up on drums and pulleys that grip at the
        estimated poses is not part of it. On the coordinates of an expression the tension acts by ``T ∂L/∂q``.
    stiffness : float or expression
        k, N/m; of a wire of modulus E and cross-section A, ``E A / L``.
    damping : float or expression, default 0
        c, N s/m.
    over : sequence of Pulley, optional
        What it runs over, on the way from `a` to `b`. Pulleys that grip divide it into sections with a tension each:
        length, compliance and damping are shared as lengths at the estimated poses are.

    Attributes
    ----------
    path : RopePath
        Its strands, wraps and sections.
    distance, elongation, rate : casadi.SX
        Length l and elongation e of each section, m; the rate of :attr:`gap`, m/s.
    gap : casadi.SX
        Slack ``-e``, m; negative while the rope is stretched.
    tension : casadi.SX
        T of each section, N.
    tensions : casadi.SX
        T of each strand, N.

    Raises
    ------
    ModelError
        For a length or stiffness that is not positive, a negative damping, ends inside pulleys, a pulley that rubs.

    See Also
    --------
    Cable : does not stretch, and may rub on pulleys.
    Distance : a massless rod of constant length, which pushes as well as pulls.

    Notes
    -----
    A strand may turn by up to 135° from its direction at the estimated poses, relative to ``carrier=`` of the drum or
    pulley on which it winds up; bodies turn by any angle.

    ``simulate`` does not step over a rope that is taut for a short time, and warns if its steps did not resolve the
    tension. With damping, the tension jumps to ``c ė`` when the rope becomes taut.

    Examples
    --------
    A bungee jump::

        cord = mbd.Rope("cord", bridge.at(0, 0), jumper.at(0, 1), length=20, stiffness=120, damping=15)
        motion[cord.tension].max()

    A hoist, whose rope winds up on a drum::

        reel = mbd.Drum(drum.at(0, 0), 0.2, turn="clockwise")
        wire = mbd.Rope("wire", reel, load.at(0, 0), length=4.99, stiffness=1e6, damping=1e3)
    """

    kind = "rope"
    _effort = "tension"

    def __init__(
        self,
        name: str,
        a: Marker | Drum,
        b: Marker | Drum,
        length: Scalar,
        stiffness: Scalar,
        damping: Scalar = 0.0,
        over: Sequence[Pulley] = (),
    ):
        super().__init__(name)
        self.path = path = RopePath(self.description, a, b, over)
        if any(pulley.friction is not None for _, pulley in path.pulleys):
            raise ModelError(
                f"{self.description}: an elastic rope does not rub on a pulley; take a Cable, or no friction="
            )
        self.a, *_, self.b = self.markers = path.markers
        self.length = self.read(length, "length", above=0.0)
        refuse_kinds(self.length, BEYOND_COORDINATES, self.description, "a length depends on coordinates and time only")
        self.stiffness = self.read(stiffness, "stiffness", above=0.0)
        self.damping = self.read(damping, "damping", at_least=0.0)
        self.limits = (*self.limits, *path.limits)
        self.distance = ca.vertcat(*path.sections)
        shares = path.shares()
        self.elongation = self.distance - ca.vertcat(*[self.length * share for share in shares])
        self.laws = tuple(SpringDamper(self.stiffness / share, self.damping / share) for share in shares)
        self.gap = -self.elongation
        self.virtual_work = ((self.gap, self.tension),)
        self.validity_conditions = path.validity_conditions()
        self.__dict__["bodies"] = tuple(dict.fromkeys((*path.bodies, *owners(self.length))))

    @cached_property
    def force(self) -> ca.SX:
        """Tension of each section, N."""
        return super().force * self.path.known

    @property
    def tension(self) -> ca.SX:
        """Force with which each section pulls its ends together, N; never negative."""
        return self.force

    @property
    def tensions(self) -> ca.SX:
        """Tension of each strand, N."""
        return ca.vertcat(*[self.tension[k] for k in self.path.section_of])
