"""Contacts: the outlines that may touch."""

from __future__ import annotations

from functools import singledispatch
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from ...model.forces.contact.contact import Contact
from ...model.forces.contact.outlines import Circle, HalfPlane, HollowCircle, Point, PolygonEdges, Segment
from ...model.forces.contact.rigid import RigidContact
from ..drawing import lines, scene
from ..drawing.loads import Load
from ..drawing.pen import Pen
from .base import Glyph
from .gears import disc


class ContactGlyph(Glyph, of=Contact):
    """Both outlines."""

    readings: ClassVar = {"gap, m": "gap", "normal force, N": "normal_force", "friction, N": "friction_force"}

    def draw(self) -> None:
        """Draw the outlines."""
        for outline in (self.element.a, self.element.b):
            edge(outline, self.pen)

    def loads(self) -> list[Load]:
        """Return the force of each contact point."""
        return [Load(point, force, "force") for point, force in self.element.forces]


class RigidContactGlyph(ContactGlyph, of=RigidContact):
    """Both outlines; the forces are multipliers, which a pose alone does not have."""

    def loads(self) -> list[Load]:
        """Return the force of each contact point, if it is known."""
        return super().loads() if self.pen.sample.has_multipliers else []

    def tooltip(self) -> dict[str, ca.SX]:
        """Return the gap, and the forces if they are known."""
        shown = super().tooltip()
        return shown if self.pen.sample.has_multipliers else {"gap, m": shown["gap, m"]}


@singledispatch
def edge(outline: Any, pen: Pen) -> None:
    """Draw an outline that others touch; a dot if its kind is not known."""
    pen.dot(pen.on(outline.marker))


@edge.register
def _point(outline: Point, pen: Pen) -> None:
    pen.dot(pen.on(outline.marker), 0.35)


@edge.register
def _circle(outline: Circle, pen: Pen) -> None:
    disc(pen, outline.marker, pen.number(outline.radius))


@edge.register
def _hollow_circle(outline: HollowCircle, pen: Pen) -> None:
    frame, radius, u = pen.on(outline.marker), pen.number(outline.radius), pen.unit
    inside = lines.circle((0, 0), radius, 96)
    if frame.body is None:
        frame.draw("ground line", inside, closed=True, layer=scene.GROUND)
        frame.draw("hatch", *lines.hatching(inside, 0.62 * u, 0.75 * u), layer=scene.GROUND)
    else:
        frame.area(frame.solid, lines.circle((0, 0), radius + u, 96), inside[::-1])
        pen.replaces(outline.marker.body, radius + u)


@edge.register
def _segment(outline: Segment, pen: Pen) -> None:
    half = pen.number(outline.length) / 2
    radius = max(pen.number(outline.radius), 0.12 * pen.unit)
    pen.on(outline.marker).area("body", lines.plate(np.array([[-half, 0], [half, 0]]), radius))
    pen.replaces(outline.marker.body, half)


@edge.register
def _polygon(outline: PolygonEdges, pen: Pen) -> None:
    frame = pen.on(outline.marker)
    frame.area(frame.solid, outline.points)
    pen.replaces(outline.marker.body, float(np.max(np.hypot(*outline.points.T))))


@edge.register
def _half_plane(outline: HalfPlane, pen: Pen) -> None:
    def draw(box: np.ndarray) -> None:
        frame = pen.on(outline.marker)
        x, y, angle = pen.first(outline.marker.position, outline.marker.angle)
        corners = np.array([(cx, cy) for cx in box[:, 0] for cy in box[:, 1]]) - [x, y]
        places = lines.turned(corners, -angle)[:, 0]
        margin = 2 * pen.unit
        pen.wall(frame, (places.min() - margin, 0), (places.max() + margin, 0), endless=True)

    pen.later(draw)
