"""Contact without a stiffness."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca

from ....errors import ModelError
from ....numerics.lazy import cached_property
from ...element import ConstraintElement, Element
from ...quantities import known_value
from ...symbols import Scalar
from ..active_rows import ActiveRows
from ..friction.laws import FrictionLaw
from .outlines import Outline
from .place import Place, check_outlines
from .sums import SumsOverPlaces
from .touching import touches


class RigidContact(SumsOverPlaces, ConstraintElement):
    """Two outlines that do not penetrate: open, or closed and sticking or sliding; exact.

    ``0 <= gap, 0 <= N, gap N = 0`` at each place of contact, with dry friction ``|F| <= μ_s N`` at rest and
    ``F = -μ N sgn v`` in motion. At an impact the impulses obey the same laws, with Newton's restitution:
    ``0 <= Λ, 0 <= w⁺ + e w⁻, Λ (w⁺ + e w⁻) = 0`` with the speed w at which the surfaces part, and ``|Λ_F| <= μ Λ``,
    ``Λ_F = -μ Λ sgn v⁺``. The joints of the mechanism, and other contacts that are closed, answer in the same instant.

    Parameters
    ----------
    name : str
        Its name.
    a, b : Circle, Point, Segment, HalfPlane, PolygonEdges or HollowCircle
        The outlines, on two bodies; the ground may be one.
    friction : DryFriction, optional
        Friction along the tangent.
    restitution : float or expression, default 0
        Newton's coefficient e, from 0 to 1.

    Attributes
    ----------
    gap : casadi.SX
        Distance of the surfaces, m; the least one if the outlines may touch at several places.
    normal_force, friction_force : casadi.SX
        Sums over these places, N: the force that pushes the bodies apart, and the force on `a`
        along the tangent (the normal on `a`, turned clockwise by a right angle).
    impulse : casadi.SX
        Normal impulse, N s, of all places; it has a value in ``event.after[…]``.
    normal : casadi.SX
        Unit vector (2,) from b to a, at the first place.
    gaps, normal_forces, friction_forces, normal_speeds, sliding_speeds : casadi.SX
        The same, and the speeds at which the surfaces part and slide, for each place (k,): m, N, N, m/s, m/s.
    power : casadi.SX
        Power of the friction, W.

    Raises
    ------
    ModelError
        For outlines on one body, pairs of outlines without a rule of contact, other laws of friction, and a
        restitution that is not from 0 to 1.

    Notes
    -----
    ``motion.events`` has "<name> touches", "opens", "stops", "breaks away" and, of a corner on an edge, "slips off",
    with the number of the place if there are several: "floor.0 touches"; places are the corners of a polygon, and
    of two polygons those of `a`, then those of `b`. Bounces that follow each other ever faster end at rest, with
    a last "touches" at the limit of their series: those that are not higher than some nanometres, which integration
    does not resolve, are summed up under the accelerations of their flights, and what they take is in the impulse of
    the one before and in the normal force.

    Friction that would lead to more than one acceleration, or to none (Painlevé's rod), is reported; so is an impact
    whose restitution and friction would add energy (Kane's paradox). Forces of contact and
    friction that the motion leaves open, as of a ball in a groove, are those of least norm, and a note of the run says
    so.

    References
    ----------
    Pfeiffer and Glocker, *Multibody Dynamics with Unilateral Contacts*, 1996; Moreau, "Unilateral contact and dry
    friction in finite freedom dynamics", 1988.

    Examples
    --------
    >>> import mbdcasadi as mbd
    >>> ball = mbd.Body("ball", mass=0.6, inertia=2.4e-3, pose=(0, 1.1, 0))
    >>> outlines = mbd.Circle(ball.at(0, 0), 0.1), mbd.HalfPlane(mbd.ground.at(0, 0))
    >>> floor = mbd.RigidContact("floor", *outlines, restitution=0.5)
    >>> motion = mbd.simulate(mbd.Mechanism([ball], forces=[mbd.Gravity(), floor]), duration=0.6)
    >>> motion.events[0].name
    'floor touches'
    """

    kind = "contact"
    switches_modes = True
    #: what an analysis that cannot follow it says
    exactness = "opens and closes exactly, which this analysis cannot follow; take a Contact with a stiffness here"

    def __init__(
        self, name: str, a: Outline, b: Outline, friction: FrictionLaw | None = None, restitution: Scalar = 0.0
    ):
        Element.__init__(self, name)  # its description is in messages
        check_outlines(a, b, self.description)
        self.a, self.b = a, b
        self.places = tuple(Place(touch, a, b) for touch in touches(a, b, self.description, each_corner=True))
        speeds = [place.normal_speed for place in self.places] + [place.sliding_speed for place in self.places]
        count = len(self.places)
        labels = tuple(f"{k}.{what}" for what in ("normal", "friction") for k in range(count))
        super().__init__(name, ca.SX(0, 1), labels, (a.marker, b.marker), velocity_rows=ca.vertcat(*speeds))
        if friction is not None and not (isinstance(friction, FrictionLaw) and friction.exact):
            raise ModelError(
                f"{self.description}: friction must be DryFriction, which sticks and slides exactly as the contact "
                f"opens and closes, got {friction!r}; other laws are for a Contact with a stiffness"
            )
        self.friction = friction
        self.restitution = self.read(restitution, "restitution", at_least=0.0)
        known = known_value(self.restitution)
        if known is not None and known > 1:
            raise ModelError(f"{self.description}: restitution must be from 0 to 1, got {restitution!r}")
        rubs = () if self.friction is None else self.friction.limits
        self.limits = (*self.limits, *a.limits, *b.limits, *rubs)

    # --- modes --------------------------------------------------------------------------------------
    @property
    def free_mode(self) -> tuple[str, ...]:
        """Mode in which it does not act."""
        return ("open",) * len(self.places)

    def in_mode(self, statuses: Sequence[str]) -> ActiveRows:
        """Return the element in one mode: rows of what is closed or sticks, and the force of what slides.

        Parameters
        ----------
        statuses : sequence of str
            By place: ``"open"``, ``"idle"`` (at rest without a force), ``"closed"`` without friction, ``"sticks"``,
            ``"shares"`` (it sticks by the row of another place), ``"forth"``, ``"back"``, or ``"pulled forth"`` and
            ``"pulled back"`` at the limit at rest.
        """
        count, work = len(self.places), list[tuple[ca.SX, ca.SX]]()
        closed = [k for k in range(count) if statuses[k] not in ("open", "idle")]
        sticking = [k for k in closed if statuses[k] == "sticks"]
        for k in closed:
            if statuses[k].endswith(("forth", "back")):
                work += self.places[k].work_of(self.sliding_friction(k, statuses[k]) * self.places[k].tangent)
        return ActiveRows(
            self,
            rows=ca.vertcat(ca.SX(0, 1), *[self.places[k].held for k in closed]),
            velocity_rows=self.sliding_speeds[sticking],
            chosen=[*closed, *(count + k for k in sticking)],
            virtual_work=work,
        )

    def sliding_friction(self, place: int, sense: str) -> ca.SX:
        """Friction on a along the tangent of a place that slides in a sense, or is "pulled" so at rest, N."""
        law: Any = self.friction
        coefficient = law.static_coefficient if sense.startswith("pulled") else law.coefficient
        return (1 if sense.endswith("back") else -1) * coefficient * self.normal_forces[place]

    # --- expressions ------------------------------------------------------------------------------------
    @property
    def normal_speeds(self) -> ca.SX:
        """Speeds at which the surfaces part at each place (k,), m/s."""
        return self.velocity_rows[: len(self.places)]

    @property
    def sliding_speeds(self) -> ca.SX:
        """Speeds of a's surface relative to b's along the tangent at each place (k,), m/s."""
        return self.velocity_rows[len(self.places) :]

    @property
    def normal_forces(self) -> ca.SX:
        """Normal forces at each place (k,), N."""
        return -self.multipliers[: len(self.places)]

    @property
    def friction_forces(self) -> ca.SX:
        """Friction on a along the tangent at each place (k,), N."""
        return -self.multipliers[len(self.places) :]

    @cached_property
    def forces(self) -> tuple[tuple[ca.SX, ca.SX], ...]:
        """Point (2,), m, and force on a (2,), N, of each place; that on b is opposite."""
        loads = zip(ca.vertsplit(self.normal_forces), ca.vertsplit(self.friction_forces), strict=True)
        return tuple(
            (place.touch.point, place.force(normal, along))
            for place, (normal, along) in zip(self.places, loads, strict=True)
        )

    @property
    def impulse(self) -> ca.SX:
        """Normal impulse of an impact, N s."""
        return -ca.sum1(self.impulses[: len(self.places)])
