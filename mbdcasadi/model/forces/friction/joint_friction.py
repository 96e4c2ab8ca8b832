"""Friction in joints."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from ....errors import AbsentError, ModelError
from ....numerics.lazy import cached_property
from ...element import Element
from ...expressions import norm
from ...joints.base import Joint, sliding_speed
from ...joints.lower_pairs import Revolute, Translational
from ...switching import Switching
from ...symbols import Scalar, register
from ...validity import Smoothing
from ..active_rows import ActiveRows
from .laws import FrictionLaw, Resistance, as_law


class FrictionInJoint(Switching, Element):
    """Base class of friction in a joint that turns or slides; a subclass defines the load.

    The friction acts on the second body of the joint, and its opposite on the first. The law is a function of the
    sliding speed of the surfaces, m/s, and their load, N; `radius`, m, is that of the pin of a revolute joint,
    `length`, m, that of the guide of a translational one.
    """

    kind = "friction"

    def __init__(self, name: str, joint: Any, law: FrictionLaw, radius: Any = None, length: Any = None):
        super().__init__(name)
        if not isinstance(joint, Revolute) and getattr(joint, "sliding", None) is None:
            raise ModelError(
                f"{self.description}: takes a PointOnLine, a PointOnCurve, a RollingOnCurve that slips, a Revolute or "
                f"a Translational joint, got {joint!r}"
            )
        if getattr(joint, "slips", True) is False:
            raise ModelError(f"{self.description}: {joint.description} rolls without slip; give it slips=True")
        self.joint, self.law = joint, as_law(law, self.description)
        self.markers = (joint.a, joint.b)
        self.limits, self.resolved_laws = (*self.limits, *law.limits), (law,)
        self._check_sizes(radius, length)
        self.radius = None if radius is None else self.read(radius, "radius", above=0.0)
        self.length = None if length is None else self.read(length, "length", above=0.0)
        self.switches_modes = law.exact
        if law.exact:
            self._switch()
            return
        self.rates: Mapping[Any, ca.SX] = self.resistance.rates
        self.virtual_work = self.work_of(self.resistance.force)

    def _switch(self) -> None:
        """Define the row that is active while it sticks; its multiplier is the friction in every mode."""
        self.velocity_rows = self.sliding_speed
        self.multipliers = ca.SX.sym(f"{self.name}.lam")
        self._role = register(self.multipliers, "multiplier", f"{self.name}.multipliers", self)

    @property
    def row_names(self) -> tuple[str, ...]:
        """Name of the row that is active while it sticks."""
        return (self.name,) if self.law.exact else ()

    def work_of(self, force: ca.SX) -> tuple[tuple[ca.SX, ca.SX], ...]:
        """Return the virtual work of a force between the surfaces."""
        return tuple((coordinate, ratio * force) for coordinate, ratio in self._sliding)

    @property
    def _sliding(self) -> tuple[tuple[ca.SX, Any], ...]:
        """Pairs of a coordinate along which the surfaces slide and metres of sliding for its unit."""
        pairs: Any = ((self.joint.angle, self.radius),) if isinstance(self.joint, Revolute) else self.joint.sliding
        return tuple(pairs)

    def in_mode(self, mode: str) -> Element:
        """Return the element in one mode: a row if it sticks, a force if it slides or is at its limit."""
        if mode == "sticks":
            return ActiveRows(self, rows=ca.SX(0, 1), velocity_rows=self.sliding_speed, chosen=[0])
        if mode == "free":
            return SlidingFriction(self, ca.SX(0))
        law: Any = self.law
        coefficient = law.static_coefficient if mode.startswith("pulled") else law.coefficient
        return SlidingFriction(self, (1 if mode.endswith("back") else -1) * coefficient * self.load)

    def _check_sizes(self, radius: Any, length: Any) -> None:
        if isinstance(self.joint, Revolute):
            if radius is None:
                raise ModelError(
                    f"{self.description}: friction in {self.joint.description} needs the radius "
                    "of the pin, radius=, in m"
                )
        elif radius is not None:
            raise ModelError(
                f"{self.description}: radius= belongs to a revolute joint, and {self.joint.description} slides"
            )
        if length is not None and not isinstance(self.joint, Translational):
            moves = "turns" if isinstance(self.joint, Revolute) else "has no guide"
            raise ModelError(
                f"{self.description}: length= belongs to a translational joint, and {self.joint.description} {moves}"
            )

    @property
    def load(self) -> ca.SX:
        """Load of the surfaces, N, not negative."""
        raise NotImplementedError

    @property
    def sticking_limit(self) -> ca.SX:
        """Largest friction at rest, N."""
        law: Any = self.law
        return ca.SX(law.static_coefficient * self.load)

    @property
    def falls(self) -> bool:
        """True if friction in motion may be below that at rest."""
        return self.law.falls

    @cached_property
    def sliding_speed(self) -> ca.SX:
        """Speed of the second body's surface relative to the first one's, m/s."""
        return sliding_speed(self._sliding)

    @cached_property
    def resistance(self) -> Resistance:
        """Friction by the law."""
        if self.law.exact:
            return Resistance(-self.multipliers)
        return self.law.resistance(self.name, self.sliding_speed, self.load)

    @cached_property
    def smoothings(self) -> tuple[Smoothing, ...]:  # type: ignore[override]
        """Quantities that change within a short time: the smoothed sign of the friction."""
        subject = "its change of direction"
        remedy = f"{self.law.remedy}, or use DryFriction, which needs no smoothing"
        return tuple(Smoothing(s, 2.0, subject, remedy) for s in self.resistance.smoothed)

    @property
    def friction_force(self) -> ca.SX:
        """Force between the surfaces, on the second body along :attr:`sliding_speed`, N."""
        return self.resistance.force

    @property
    def force(self) -> ca.SX:
        """Force on the second body along the line or the curve on the first one, N; of a joint that slides."""
        if isinstance(self.joint, Revolute):
            raise AbsentError(
                f"{self.description} acts by a couple: use .torque (or .friction_force at the surface of the pin)"
            )
        return self.resistance.force

    @property
    def torque(self) -> ca.SX:
        """Couple on the second body, N m; of a revolute joint."""
        if not isinstance(self.joint, Revolute):
            raise AbsentError(f"{self.description} acts by a force along the guide: use .force")
        return self.radius * self.resistance.force

    @property
    def power(self) -> ca.SX:
        """Power of the friction, W; negative if it dissipates energy."""
        return self.resistance.force * self.sliding_speed


class SlidingFriction(Element):
    """Exact friction whose force is given: it slides, ``F = -σ μ N`` in the direction σ, or is at its limit at rest."""

    kind = "friction"

    def __init__(self, friction: FrictionInJoint, force: ca.SX):
        super().__init__(friction.name)
        self.markers, self.limits = friction.markers, friction.limits
        self.force = force
        self.virtual_work = friction.work_of(self.force)


class JointFriction(FrictionInJoint):
    """Friction that depends on the joint's own reaction.

    The load of a pin is the resultant of its reaction. A guide of length L that carries a
    normal force F and a couple T at the second body's marker, in the middle of the
    block, is loaded at its two ends: ``|F/2 + T/L| + |F/2 - T/L|``; without `length` the
    block is long, and the couple adds no load. A point on a line or a curve, or a
    wheel that slips on one, is loaded by its normal force.

    Parameters
    ----------
    name : str
        Its name.
    joint : Revolute, Translational, PointOnLine, PointOnCurve or RollingOnCurve
        The joint.
    law : FrictionLaw
        ``Coulomb, Stribeck, LuGre, Viscous``, a sum of them, or ``DryFriction``.
    radius : float or expression
        Radius of the pin, m; for a revolute joint.
    length : float or expression, optional
        Length of the guide, m; for a translational joint.
    preload : float or expression, default 0
        Load in addition to the reaction (of a fit, a spring), N.

    Attributes
    ----------
    force, torque : casadi.SX
        Friction on the second body: along the guide, N, or about the pin, N m.
    load : casadi.SX
        Load of the surfaces, N.

    Raises
    ------
    ModelError
        For a joint of another kind, a missing radius, numbers out of their limits.

    Notes
    -----
    Reactions and friction then depend on each other. If friction is large, more than one set of
    reactions, or none, satisfies the equations (jamming): ``simulate`` stops there with an error.

    References
    ----------
    Haug, Wu, Yang, "Dynamics of mechanical systems with Coulomb friction, stiction,
    impact and constraint addition-deletion", Mechanism and Machine Theory 21 (1986) 401.

    Examples
    --------
    >>> import mbdcasadi as mbd
    >>> rod = mbd.Body("rod", mass=1.5, inertia=0.08, pose=(0.4, 0, 0))
    >>> hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), rod.at(-0.4, 0))
    >>> bush = mbd.JointFriction("bush", hinge, mbd.Coulomb(0.3, velocity_tolerance=1e-4), radius=0.02)
    """

    def __init__(
        self,
        name: str,
        joint: Joint,
        law: FrictionLaw,
        radius: Scalar | None = None,
        length: Scalar | None = None,
        preload: Scalar = 0.0,
    ):
        Element.__init__(self, name)  # the load depends on what is read first
        self.preload = self.read(preload, "preload", at_least=0.0)
        super().__init__(name, joint, law, radius, length)

    @cached_property
    def load(self) -> ca.SX:
        """Load of the surfaces, N."""
        if not isinstance(self.joint, Revolute | Translational):
            return self.preload + ca.fabs(self.joint.normal_force)
        reaction = self.joint.reaction_on(self.joint.b.body)
        if isinstance(self.joint, Revolute):
            return self.preload + norm(reaction.force)
        across = reaction.force_in_joint[1]
        if self.length is None:
            return self.preload + ca.fabs(across)
        lever = reaction.torque / self.length
        return self.preload + ca.fabs(across / 2 + lever) + ca.fabs(across / 2 - lever)


class LoadIndependentFriction(FrictionInJoint):
    """Friction in a joint under a given load, independent of its reaction: a seal, a spring-loaded brake.

    Parameters
    ----------
    name : str
        Its name.
    joint : Revolute, Translational, PointOnLine, PointOnCurve or RollingOnCurve
        The joint.
    law : FrictionLaw
        Law of friction.
    load : float or expression
        Load, N, at least 0.
    radius : float or expression
        Radius of the pin, m; for a revolute joint.
    """

    def __init__(self, name: str, joint: Joint, law: FrictionLaw, load: Scalar, radius: Scalar | None = None):
        Element.__init__(self, name)
        self._load = self.read(load, "load", at_least=0.0)
        super().__init__(name, joint, law, radius)

    @property
    def load(self) -> ca.SX:
        """Load of the surfaces, N."""
        return ca.SX(self._load)
