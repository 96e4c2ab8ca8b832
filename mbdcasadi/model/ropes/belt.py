"""Elastic belts and chains whose strands load the bearings."""

from __future__ import annotations

import casadi as ca

from ...numerics.lazy import cached_property
from ..bodies import Body, Marker, ground, markers_on_two
from ..element import at_poses
from ..forces.laws import SpringDamper
from ..forces.stops import OneSided
from ..joints.base import as_carrier
from ..quantities import yes_or_no
from ..symbols import Scalar
from ..validity import ValidityCondition
from .path import RopePath, Strand
from .pulleys import Drum


class ElasticBelt(OneSided):
    """Elastic belt or chain over two pulleys, whose two strands load the bearings; it does not slip.

    Each strand is the common tangent of the pulleys, of length l, and is stretched by ``e = T0/k - d + l - l0 + s``
    with the arc s that both pulleys have wound up since the estimated poses: ``T = max(k e + c ė, 0)`` if ``e > 0``,
    else 0; ``δW = -T δe``. It has no mass.

    Parameters
    ----------
    name : str
        Its name.
    a, b : Marker
        Centres of the pulleys on their bodies; these may move against each other: a tensioner, a swing arm.
    radius_a, radius_b : float or expression in parameters
        Radii, m.
    stiffness : float or expression
        k of a strand, N/m; of modulus E and cross-section A, ``E A / l``.
    pretension : float or expression in parameters, default 0
        T0, N, of both strands at the estimated poses.
    damping : float or expression, default 0
        c, N s/m.
    crossed : bool, default False
        True if the belt crosses, so that the pulleys turn in opposite directions.
    carrier : Body, default ground
        Body relative to which a strand may turn by up to 135° from the estimated poses: the arm between the pulleys.
    friction : float or expression, optional
        Coefficient μ, above 0: analyses warn if the belt would slip, ``T_high > T_low exp(μ θ)`` with the smaller angle
        of wrap θ. Of a chain or toothed belt leave it out.
    slack : float or expression in parameters, default 0
        d, m, by which each strand is longer than the way at the estimated poses: of a chain, half of its play.

    Attributes
    ----------
    strands : tuple of Strand
        That from a to b, and that from b to a, on a way counter-clockwise round a.
    tensions : casadi.SX
        Their tensions (2,), N.
    tension_difference : casadi.SX
        First less second tension, N; positive turns a counter-clockwise, as that of a :class:`Belt`.
    gap, rate : casadi.SX
        Slack ``-e`` of each strand (2,), m, and its rate.

    Raises
    ------
    ModelError
        For radii or a stiffness that are not positive, a negative pretension, damping or slack, pulleys that overlap.

    See Also
    --------
    Belt : does not stretch, and transmits couples only.
    Rope : over more pulleys, from drum to drum.

    References
    ----------
    Shigley, Mischke, *Mechanical Engineering Design*, chapter on flexible elements (belts).

    Examples
    --------
    The chain of a motorcycle, from the sprocket on the frame to the wheel on the swing arm::

        chain = mbd.ElasticBelt("chain", frame.at(0.1, 0), wheel.at(0, 0), 0.035, 0.1, 1e6, damping=500, carrier=arm)
    """

    kind = "belt"
    _effort = "tension"

    def __init__(
        self,
        name: str,
        a: Marker,
        b: Marker,
        radius_a: Scalar,
        radius_b: Scalar,
        stiffness: Scalar,
        pretension: Scalar = 0.0,
        damping: Scalar = 0.0,
        crossed: bool = False,
        carrier: Body = ground,
        friction: Scalar | None = None,
        slack: Scalar = 0.0,
    ):
        super().__init__(name)
        what = self.description
        self.markers = self.a, self.b = markers_on_two(a, b, what)
        self.radius_a = self.read(radius_a, "radius_a", above=0.0, fixed=True)
        self.radius_b = self.read(radius_b, "radius_b", above=0.0, fixed=True)
        self.stiffness = self.read(stiffness, "stiffness", above=0.0)
        self.pretension = self.read(pretension, "pretension", at_least=0.0, fixed=True)
        self.damping = self.read(damping, "damping", at_least=0.0)
        self.slack = self.read(slack, "slack", at_least=0.0, fixed=True)
        self.crossed = yes_or_no(crossed, what, "crossed")
        self.carrier = as_carrier(carrier, a, b, what)
        first = Drum(a, radius_a, "counter-clockwise", carrier)
        second = Drum(b, radius_b, "clockwise" if self.crossed else "counter-clockwise", carrier)
        self._paths = RopePath(what, first, second), RopePath(what, second, first)
        lengths = ca.vertcat(*[path.sections[0] for path in self._paths])
        self.gap = at_poses(lengths) - lengths + self.slack - ca.SX(self.pretension) / self.stiffness
        self.laws = (SpringDamper(self.stiffness, self.damping),) * 2
        self.virtual_work = ((self.gap, self.tensions),)
        self.__dict__["bodies"] = (self.a.body, self.b.body)
        self.friction = None
        if friction is not None:
            self.friction = self.read(friction, "friction", above=0.0)
            slips = f"{what}: it would slip: the tension of one strand is above that of the other times exp(μ θ)"
            margin = ca.exp(self.friction * self.least_wrap) * ca.mmin(self.tensions) - ca.mmax(self.tensions)
            self.validity_conditions = (ValidityCondition(margin, slips, shown=-margin, unit="N too much"),)

    @property
    def strands(self) -> tuple[Strand, Strand]:
        """Straight pieces: from a to b, and from b to a."""
        first, second = self._paths
        return first.strands[0], second.strands[0]

    @cached_property
    def least_wrap(self) -> ca.SX:
        """Smaller one of the angles, rad, by which the belt is in touch with the pulleys."""
        apart = ca.norm_2(self.b.position - self.a.position)
        if self.crossed:
            return ca.pi + 2 * ca.asin((ca.SX(self.radius_a) + self.radius_b) / apart)
        return ca.pi - 2 * ca.asin(ca.fabs(ca.SX(self.radius_a) - self.radius_b) / apart)

    @cached_property
    def force(self) -> ca.SX:
        """Tension of each strand (2,), N."""
        first, second = self._paths
        return super().force * first.known * second.known

    @property
    def tensions(self) -> ca.SX:
        """Tension of each strand (2,), N; never negative."""
        return self.force

    @cached_property
    def tension_difference(self) -> ca.SX:
        """First less second tension, N."""
        return self.force[0] - self.force[1]
