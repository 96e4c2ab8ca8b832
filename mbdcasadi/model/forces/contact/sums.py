"""What a contact is as a whole: sums over the places at which two outlines may touch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca

from ....numerics.lazy import cached_property


class SumsOverPlaces:
    """Distance and forces of a contact as a whole, of a class that defines those of each place.

    Attributes
    ----------
    places : sequence
        Places, each with a `touch`.
    """

    places: Sequence[Any]

    @property
    def normal_forces(self) -> ca.SX:
        """Normal forces at each place (k,), N."""
        raise NotImplementedError

    @property
    def friction_forces(self) -> ca.SX:
        """Friction on a along the tangent at each place (k,), N."""
        raise NotImplementedError

    @property
    def sliding_speeds(self) -> ca.SX:
        """Speeds of a's surface relative to b's along the tangent at each place (k,), m/s."""
        raise NotImplementedError

    @cached_property
    def gaps(self) -> ca.SX:
        """Distances at each place (k,), m."""
        return ca.vertcat(*[place.touch.gap for place in self.places])

    @property
    def gap(self) -> ca.SX:
        """Least distance of the surfaces, m."""
        return ca.mmin(self.gaps)

    @property
    def normal(self) -> ca.SX:
        """Unit vector (2,) from b to a, at the first place."""
        return self.places[0].touch.normal

    @property
    def normal_force(self) -> ca.SX:
        """Force that pushes the bodies apart, N."""
        return ca.sum1(self.normal_forces)

    @property
    def friction_force(self) -> ca.SX:
        """Friction on a along the tangent, N."""
        return ca.sum1(self.friction_forces)

    @property
    def power(self) -> ca.SX:
        """Power of the friction, W."""
        return ca.dot(self.friction_forces, self.sliding_speeds)
