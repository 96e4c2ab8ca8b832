"""Bodies: the outline of their shape, else a plate through the places where their elements sit."""

from __future__ import annotations

from itertools import pairwise
from types import SimpleNamespace
from typing import ClassVar

import numpy as np

from ...model.bodies import Body, Marker
from ...model.drivers import Actuator
from ...model.forces.springs import TSDA, Bushing
from ...model.joints.lower_pairs import Distance, Revolute, Weld
from ...model.ropes.cable import Cable
from ...model.ropes.rope import Rope
from ..drawing import lines, scene
from ..drawing.outlines import (
    HALF_WIDTH,
    apart,
    is_inside,
    markers_on,
    nearest_on,
    outlines_of,
    points_on,
    shape_loops,
)  # fmt: skip
from .base import Glyph

#: Elements that hold a body at a point of it.
HELD = (Revolute, Weld, Distance, TSDA, Rope, Cable, Bushing, Actuator)


class BodyGlyph(Glyph, of=Body):
    """Outline of a body in its colour, and its position and velocity."""

    readings: ClassVar = {
        "x, m": "x", "y, m": "y", "phi, rad": "phi", "vx, m/s": "vx", "vy, m/s": "vy", "omega, rad/s": "omega",
    }  # fmt: skip

    def draw(self) -> None:
        """Draw the outline of a body.

        From its shape, if it has one. Else a bar or a plate through the places
        where joints and forces sit; with a single one, a bar to the centre of mass
        with a disc on it. Nothing, if the symbol of an element draws the body.
        Points of which the path is traced belong to it.
        """
        body, pen = self.element, self.pen
        mechanism, u, frame = pen.sample.mechanism, pen.unit, pen.of_body(body)
        traced = SimpleNamespace(markers=pen.traced)
        if body.shape is not None:
            if not pen.covers(body):
                frame.area("body", *self._shape(points_on(body, [*mechanism.joints, traced], pen)))
                self._arms()
            return
        elements = [*mechanism.joints, *mechanism.forces, traced]
        markers = markers_on(body, elements)
        if any(pen.sample.varies(marker.local) for marker in markers) and not pen.replaced.get(body):
            self._bars(list(apart(markers, pen)))
            return
        points = points_on(body, elements, pen)
        drawn = pen.replaced.get(body, 0.0)
        if len(points) == 1 and not pen.vanishes(points[0]) and not drawn:
            frame.area("body", lines.plate(np.vstack([points, [[0, 0]]]), 0.5 * HALF_WIDTH * u))
            frame.area("body", lines.circle((0, 0), 1.5 * u))
        elif len(points) > 1 and np.max(np.hypot(*points.T)) > drawn:
            frame.area("body", lines.plate(points, HALF_WIDTH * u))
        elif not drawn:
            frame.area("body", lines.circle((0, 0), 1.5 * u))

    def _arms(self) -> None:
        """Arms from the outline to pins, springs and actuators that sit beside it."""
        body, pen, mechanism = self.element, self.pen, self.pen.sample.mechanism
        elements = [e for e in (*mechanism.joints, *mechanism.drivers, *mechanism.forces) if isinstance(e, HELD)]
        loops = [np.vstack([loop, loop[:1]]) for loop in pen.loops.get(body, ())]
        for place in points_on(body, elements, pen):
            nearest = min((nearest_on(loop, place) for loop in loops), key=lambda q: float(np.hypot(*(q - place))))
            if not is_inside(loops, place) and np.hypot(*(nearest - place)) > pen.unit:
                pen.of_body(body).draw("body line", [place, nearest], layer=scene.GUIDE)

    def _bars(self, places: list[Marker]) -> None:
        """Bars between places that move in the body, one after the other."""
        body, pen = self.element, self.pen
        closed = [*places, places[0]] if len(places) > 2 else places
        pairs = [(a.position, b.position) for a, b in pairwise(closed)] or [(places[0].position, body.position)]
        for start, end in pairs:
            pen.between(start, end, body).area("body", lines.bar(HALF_WIDTH * pen.unit))

    def _shape(self, points: np.ndarray) -> list[np.ndarray]:
        """Outline of the shape; of a single rod a plate, if elements sit beside it."""
        body, u = self.element, self.pen.unit
        outlines = outlines_of(body)
        if not body.shape.is_line or len(outlines) > 1 or not len(points):
            return shape_loops(body, u)
        ends = outlines[0]
        length = np.hypot(*(ends[1] - ends[0]))
        direction = (ends[1] - ends[0]) / length
        off = np.abs((points - ends[0]) @ np.array([-direction[1], direction[0]])) > 1e-6 * length
        return [lines.plate(np.vstack([ends, points[off]]), HALF_WIDTH * u)]

    def loads(self) -> list:
        """Return none: the elements exert them."""
        return []
