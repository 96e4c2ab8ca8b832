"""Unilateral contact of two bodies."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from typing import Any

import casadi as ca

from ....errors import ModelError
from ....numerics.lazy import cached_property
from ...element import Element
from ...expressions import if_else
from ...quantities import function_of
from ...validity import Smoothing, ValidityCondition
from ..friction.laws import FrictionLaw, as_law
from ..laws import continuous_force, pushing_force, stored_energy
from .outlines import HalfPlane, Outline
from .place import Place, check_outlines
from .sums import SumsOverPlaces
from .touching import bounding_distance, touches


class Contact(SumsOverPlaces, Element):
    """Two outlines that push each other apart at their points of contact, with friction.

    ``F = law(δ, δ̇)`` along the normal, with the penetration ``δ = -gap``, and friction
    along the tangent as a function of the sliding speed, with the normal force as the load. Both
    act at the point of contact, with opposite forces on the two bodies.

    Parameters
    ----------
    name : str
        Its name.
    a, b : Circle, Point, Segment, HalfPlane, PolygonEdges or HollowCircle
        The outlines, on two bodies; the ground may be one.
    law : callable
        ``law(penetration, rate)`` returns the normal force, N: :class:`HuntCrossley`.
    friction : FrictionLaw, optional
        ``Coulomb, Stribeck, LuGre, Viscous`` or a sum of them.

    Attributes
    ----------
    gap : casadi.SX
        Distance of the surfaces, m, negative if they penetrate; the least one if
        the outlines may touch at several places.
    normal_force, friction_force : casadi.SX
        Sums over these places, N: the force that pushes the bodies apart, and the force on `a`
        along the tangent (the normal on `a`, turned clockwise by a right angle).
    normal : casadi.SX
        Unit vector (2,) from b to a, at the first place.
    gaps, normal_forces, friction_forces, sliding_speeds : casadi.SX
        Distance, forces and sliding speed at each place (k,): m, N, N, m/s.
    power : casadi.SX
        Power of the friction, W.

    Raises
    ------
    ModelError
        For outlines on one body, and pairs of outlines without a rule of contact.

    Notes
    -----
    Two polygons touch along the edges that face each other, with a place at each of their four
    ends: a block on an equal one stands on two corners. When these edges change, as when a
    corner slips off, the forces jump; so they do when the centre of a circle is deep inside.

    A law that is too soft for an impact lets the outlines pass through each other: analyses warn if they penetrate
    by more than half the depth at which their middles meet, or by their whole thickness into a half-plane or a hole.

    The stiffer the contact, the smaller the steps. ``simulate`` does not step over a contact that is
    closed for a short time, and warns if its steps did not resolve the forces. For exact stiction, and impacts
    without a stiffness, see :class:`RigidContact`.

    Examples
    --------
    >>> import mbdcasadi as mbd
    >>> ball = mbd.Body("ball", mass=0.6, inertia=2.4e-3, pose=(0, 1.1, 0))
    >>> law = mbd.HuntCrossley(2e5, damping=0.3)
    >>> floor = mbd.Contact("floor", mbd.Circle(ball.at(0, 0), 0.1), mbd.HalfPlane(mbd.ground.at(0, 0)), law)
    """

    kind = "contact"

    def __init__(
        self, name: str, a: Outline, b: Outline, law: Callable[[Any, Any], Any], friction: FrictionLaw | None = None
    ):
        super().__init__(name)
        check_outlines(a, b, self.description)
        if isinstance(law, FrictionLaw):
            raise ModelError(
                f"{self.description}: law must be a function of penetration and rate, got {law!r}; give it as friction="
            )
        self.a, self.b, self.law = a, b, function_of(law, self.description, "law", "penetration", "rate")
        self.markers = (a.marker, b.marker)
        self.friction = None if friction is None else as_law(friction, self.description)
        if self.friction is not None and self.friction.exact:
            raise ModelError(
                f"{self.description}: DryFriction switches a row, which a compliant contact does not have; "
                "use Coulomb, Stribeck or LuGre, or a RigidContact"
            )
        rubs = () if self.friction is None else self.friction.limits
        self.limits = (*a.limits, *b.limits, *getattr(law, "limits", ()), *rubs)
        self.resolved_laws = () if self.friction is None else (self.friction,)
        self.places = [
            CompliantPlace(Place(touch, a, b), law, self.friction, name if k == 0 else f"{name}.{k}", self.description)
            for k, touch in enumerate(touches(a, b, self.description))
        ]
        self.rates: Mapping[Any, ca.SX] = {s: r for place in self.places for s, r in place.rates.items()}
        self.virtual_work = tuple(pair for place in self.places for pair in place.virtual_work)

    @cached_property
    def normal_forces(self) -> ca.SX:
        """Normal forces at each place (k,), N."""
        return ca.vertcat(*[place.normal_force for place in self.places])

    @cached_property
    def friction_forces(self) -> ca.SX:
        """Friction on a along the tangent at each place (k,), N."""
        return ca.vertcat(*[place.friction_force for place in self.places])

    @cached_property
    def sliding_speeds(self) -> ca.SX:
        """Speeds of a's surface relative to b's along the tangent at each place (k,), m/s."""
        return ca.vertcat(*[place.sliding_speed for place in self.places])

    @cached_property
    def forces(self) -> tuple[tuple[ca.SX, ca.SX], ...]:
        """Point (2,), m, and force on a (2,), N, of each place; that on b is opposite."""
        return tuple((place.touch.point, place.force) for place in self.places)

    @cached_property
    def smoothings(self) -> tuple[Smoothing, ...]:  # type: ignore[override]
        """Quantities that change within a short time: the normal force, and that times the smoothed sign of friction.

        Sums over the places, since the contact moves from one to the other.
        """
        loads = [
            continuous_force(self.law, place.touch.gap, place.normal_force, self.description) for place in self.places
        ]
        load = sum(loads, ca.SX(0))
        smoothings = [Smoothing(load, 1.0, "its normal force", "or soften the law", load)]
        if self.friction is not None:
            turn = "its friction's change of direction"
            each = zip(loads, self.places, strict=True)
            for parts in zip(*[[share * e for e in place.smoothed] for share, place in each], strict=True):
                smoothings.append(Smoothing(sum(parts, ca.SX(0)), 2.0, turn, self.friction.remedy, load))
        return tuple(smoothings)

    @cached_property
    def validity_conditions(self) -> tuple[ValidityCondition, ...]:  # type: ignore[override]
        """A limit of the penetration, beyond which the outlines could leave each other on the far side."""
        within = [touch.gap + touch.reach for touch in (p.touch for p in self.places) if touch.reach is not None]
        if not within:
            return ()
        if any(isinstance(outline, HalfPlane) for outline in (self.a, self.b)):  # nothing leaves it on a far side
            how = "an outline is wholly inside the half-plane, deeper than a law for small penetrations allows"
        else:
            how = "the surfaces penetrate deeper than the thickness of the outlines allows"
        message = f"{self.description}: its law is too soft: {how}; take a stiffer law, or thicker outlines"
        condition = ValidityCondition(
            ca.mmin(ca.vertcat(*within)), message, shown=-self.gap, unit="m deep", between_outputs=True
        )
        return (condition,)

    @cached_property
    def likeness_of_expressions(self) -> Hashable:  # type: ignore[override]
        return (*(outline.likeness for outline in (self.a, self.b)), id(self.law), id(self.friction))

    @property
    def watched_gaps(self) -> ca.SX:  # type: ignore[override]
        return self.gaps

    @cached_property
    def watched_clearance(self) -> ca.SX | None:  # type: ignore[override]
        """Expression that is positive only if the outlines do not touch; None if there is no cheap one."""
        return bounding_distance(self.a, self.b)

    @cached_property
    def potential(self) -> ca.SX:
        """Elastic energy, J; zero for a law without ``potential(penetration)``."""
        return sum((stored_energy(self.law, -place.touch.gap) for place in self.places), ca.SX(0))


class CompliantPlace:
    """Forces at one place of contact."""

    def __init__(self, place: Place, law: Any, friction: FrictionLaw | None, name: str, what: str):
        self.touch = touch = place.touch
        self.normal_force = pushing_force(law, touch.gap, place.normal_speed, what)
        self.sliding_speed = place.sliding_speed
        self.friction_force, self.rates = ca.SX(0), {}
        self.smoothed: tuple[ca.SX, ...] = ()
        if friction is not None:
            resistance = friction.resistance(name, self.sliding_speed, self.normal_force)
            self.friction_force, self.rates = if_else(touch.gap < 0, resistance.force, 0), dict(resistance.rates)
            self.smoothed = resistance.smoothed
        self.force = place.force(self.normal_force, self.friction_force)
        self.virtual_work = place.work_of(self.force)
