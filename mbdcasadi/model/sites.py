"""Places at which bodies touch, stick and slide: those of rigid contacts, and exact frictions in joints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca

from .forces.contact.rigid import RigidContact

#: What takes place at a site.
WHAT = ("touches", "opens", "slips off", "stops", "breaks away")


@dataclass(frozen=True, eq=False)
class Site:
    """A place of a contact, or a friction in a joint.

    Attributes
    ----------
    element : RigidContact or FrictionInJoint
        What it belongs to.
    place : int or None
        Number of the place of the contact.
    """

    element: Any
    place: int | None = None

    @property
    def name(self) -> str:
        """Name in events."""
        several = self.place is not None and len(self.element.places) > 1
        return f"{self.element.name}.{self.place}" if several else str(self.element.name)

    @property
    def description(self) -> str:
        """Kind and name of the element, as messages give it."""
        return str(self.element.description)

    @property
    def law(self) -> Any:
        """Law of friction, or None."""
        return self.element.law if self.place is None else self.element.friction

    def row(self, kind: str) -> int:
        """Row of its normal force, or of its "friction", in the element."""
        place = self.place or 0
        return place + len(self.element.places) if kind == "friction" and self.place is not None else place

    @property
    def normal_force(self) -> ca.SX:
        """Normal force of the place, N."""
        return self.element.normal_forces[self.place]

    @property
    def load(self) -> ca.SX:
        """Load of the surfaces, N."""
        return ca.SX(self.element.load) if self.place is None else self.normal_force

    @property
    def sliding_speed(self) -> ca.SX:
        """Sliding speed, m/s."""
        return self.element.sliding_speed if self.place is None else self.element.sliding_speeds[self.place]

    @property
    def friction(self) -> ca.SX:
        """Friction along the sliding speed, N, as a multiplier."""
        return -self.element.multipliers if self.place is None else self.element.friction_forces[self.place]

    def sliding_friction(self, sense: str) -> ca.SX:
        """The same if it slides, N."""
        if self.place is None:
            return self.element.in_mode(sense).force
        return self.element.sliding_friction(self.place, sense)


def sites_of(element: Any) -> list[Site]:
    """Return the places of a rigid contact, or the one of an exact friction."""
    if isinstance(element, RigidContact):
        return [Site(element, place) for place in range(len(element.places))]
    return [Site(element)]
