"""Contacts, stops and dry friction of robots, which their files give without a law that has a length.

One rule gives all of them: under the weight ``W`` of all bodies a part of the size ``h`` yields by ``δ = YIELD h``.

- The stiffness of a contact or stop is ``W/δ``, and its damping ``2/√(g δ)``, critical for the weight.
- Dry friction changes its direction over the speeds up to ``YIELD √(g h)``.

The size of a solid is half of its least width in the plane, that of a joint the radius of gyration of what it carries.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ..model.bodies import Marker
from ..model.forces.contact.contact import Contact
from ..model.forces.contact.outlines import Circle, HalfPlane, Outline, PolygonEdges, Segment
from ..model.forces.friction.laws import Coulomb
from ..model.forces.laws import HuntCrossley
from .robots import Link, Robot, Solid

#: Share of its size by which a part yields under the weight of all bodies: small, and large enough for a few steps.
YIELD = 0.01
#: Angle by which the axes of a solid may differ from those of the plane, rad: files give angles to a few digits.
ALONG = 1e-3
#: Gravity of robots that have none in their plane, m/s².
_STANDARD_GRAVITY = 9.81


@dataclass(frozen=True)
class Yielding:
    """The laws of a robot of a total mass, kg, under a gravity in its plane, m/s² (zero: that of the earth)."""

    mass: float
    gravity: float

    @property
    def _pull(self) -> float:
        return self.gravity if self.gravity > 0 else _STANDARD_GRAVITY

    def law(self, size: float, radius: float = 1.0) -> HuntCrossley:
        """Law of a contact or stop of a size, m; of a stop on an angle with the radius at which it acts, m."""
        give = YIELD * size
        stiffness, damping = self.mass * self._pull / give, 2 / np.sqrt(self._pull * give)
        return HuntCrossley(stiffness * radius**2, exponent=1, damping=float(damping * radius))

    def friction(self, coefficient: float, size: float) -> Coulomb:
        """Dry friction of a part of a size, m."""
        return Coulomb(coefficient, velocity_tolerance=YIELD * float(np.sqrt(self._pull * size)))


@dataclass(frozen=True, eq=False)
class _Flat:
    """A solid in the plane."""

    solid: Solid
    #: from a radius (which a pair may reduce) to the outline
    outline: Callable[[float], Outline]
    #: half of its least width in the plane, m
    size: float
    #: half of its straight extent across the plane, and the radius with which it is rounded on there, m
    depth: float = np.inf
    rounding: float = 0.0
    is_floor: bool = False


class RobotContacts:
    """Contacts of the solids of a robot in its plane.

    Parameters
    ----------
    robot : Robot
        It; what cannot be represented is added to what it leaves out.
    axes : numpy.ndarray
        Horizontal and vertical axis of the plane, and its normal, by row (3, 3).
    moving : dict
        The link with which each link moves.
    at : callable
        Marker of a link at a point of the world (3,), turned by an angle, rad.
    laws : Yielding
        The laws.
    """

    def __init__(
        self,
        robot: Robot,
        axes: np.ndarray,
        moving: dict[Link, Link],
        at: Callable[[Link, np.ndarray, float], Marker],
        laws: Yielding,
    ):
        self.robot, self.axes, self.moving, self.at, self.laws = robot, axes, moving, at, laws

    def elements(self) -> list[Contact]:
        """Return the contacts that the motion can close."""
        flats: dict[Solid, _Flat | None] = {}
        contacts = []
        for a, b, friction in self._pairs():
            for solid in (a, b):
                if solid not in flats:
                    flats[solid] = self._flat(solid)
            first, second = flats[a], flats[b]
            if first is not None and second is not None:
                contacts += self._contact(first, second, friction)
        lost = [f"'{solid.name}' ({solid.kind})" for solid, flat in flats.items() if flat is None]
        if lost:
            self.robot.left_out.append(
                f"the contacts of {', '.join(lost)}, of which the outline in the plane of the motion is not known"
            )
        return contacts

    def _pairs(self) -> Iterator[tuple[Solid, Solid, float]]:
        """Solids that may touch, and the coefficient of their friction."""
        given = {frozenset((a, b)) for a, b, _ in self.robot.pairs}
        for a, b in combinations(self.robot.solids, 2):
            if frozenset((a, b)) not in given and self._may_touch(a, b):
                yield a, b, self.robot.friction(a, b)
        for a, b, friction in self.robot.pairs:
            if self.moving[a.link] is not self.moving[b.link]:
                yield a, b, self.robot.friction(a, b) if friction is None else friction

    def _may_touch(self, a: Solid, b: Solid) -> bool:
        first, second = self.moving[a.link], self.moving[b.link]
        if first is second or not a.meets(b) or frozenset((a.body, b.body)) in self.robot.apart:
            return False
        if self.robot.neighbours_touch or first.parent is None or second.parent is None:
            return True
        return self.moving[first.parent] is not second and self.moving[second.parent] is not first

    # --- outlines -------------------------------------------------------------------------------
    def _flat(self, solid: Solid) -> _Flat | None:
        """Outline of a solid in the plane; None if it is not one of those that are known."""
        rotation, at = solid.link.rotation @ solid.rotation, solid.place
        across = np.abs(rotation.T @ self.axes[2])
        size = solid.size

        def marker(axis: int) -> Marker:
            return self.at(solid.link, at, float(np.arctan2(*(self.axes[:2] @ rotation[:, axis])[::-1])))

        if solid.kind == "plane" and across[2] < ALONG:
            x, y = self.axes[:2] @ rotation[:, 2]
            return _Flat(solid, lambda _: HalfPlane(self.at(solid.link, at, float(np.arctan2(-x, y)))), np.inf,
                         is_floor=True)  # fmt: skip
        if solid.kind == "sphere":
            return _Flat(solid, lambda radius: Circle(marker(0), radius), size[0], 0.0, size[0])
        is_along, is_across = across < ALONG, across > np.cos(ALONG)
        if solid.kind in ("capsule", "cylinder") and is_across[2]:
            rounding = size[0] if solid.kind == "capsule" else 0.0
            return _Flat(solid, lambda radius: Circle(marker(0), radius or size[0]), size[0], size[1], rounding)
        if solid.kind == "capsule" and is_along[2]:
            return _Flat(solid, lambda radius: Segment(marker(2), 2 * size[1], radius), size[0], 0.0, size[0])
        if solid.kind == "cylinder" and is_along[2]:
            return self._block(solid, marker(2), size[1], size[0], size[0])
        if solid.kind == "box" and np.any(is_across):
            k = int(np.argmax(across))
            first, second = (k + 1) % 3, (k + 2) % 3
            return self._block(solid, marker(first), size[first], size[second], size[k])
        return None

    @staticmethod
    def _block(solid: Solid, marker: Marker, length: float, height: float, depth: float) -> _Flat:
        corners = [(-length, -height), (length, -height), (length, height), (-length, height)]
        return _Flat(solid, lambda _: PolygonEdges(marker, corners), min(length, height), depth)

    def _contact(self, a: _Flat, b: _Flat, friction: float) -> list[Contact]:
        """Return the contact of two outlines, if they are not beside each other across the plane."""
        if a.is_floor:
            a, b = b, a
        if a.is_floor:
            return []
        radii = [a.rounding, b.rounding]
        if not b.is_floor:
            beside = abs(float(self.axes[2] @ (a.solid.place - b.solid.place))) - a.depth - b.depth
            reach = sum(radii)
            if beside > 0 and beside >= reach:
                return []
            if beside > 0:  # round solids beside each other meet as smaller ones in one plane
                radii = [radius * float(np.sqrt(1 - (beside / reach) ** 2)) for radius in radii]
        size = min(a.size, b.size)
        law = self.laws.friction(friction, size) if friction > 0 else None
        name = f"{a.solid.name} on {b.solid.name}"
        return [Contact(name, a.outline(radii[0]), b.outline(radii[1]), self.laws.law(size), law)]
