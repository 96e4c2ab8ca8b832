"""Ropes and cables: their strands, and the pulleys and drums that they run over."""

from __future__ import annotations

import casadi as ca

from ...model.bodies import Marker
from ...model.geometry.shapes import Disc
from ...model.ropes.belt import ElasticBelt
from ...model.ropes.cable import Cable
from ...model.ropes.pulleys import Drum
from ...model.ropes.rope import Rope
from ..drawing import lines, scene
from ..drawing.loads import Load
from .base import Glyph
from .gears import belt
from .springs import anchors


class RopeGlyph(Glyph, of=(Rope, Cable)):
    """Straight strands, and round pulleys and drums."""

    def draw(self) -> None:
        """Draw strands, pulleys and ends."""
        pen, path = self.pen, self.element.path
        first, last = path.nodes[0], path.nodes[-1]
        ends = [node if isinstance(node, Marker) else None for node in (first, last)]
        if all(ends) and len(path.nodes) == 2:
            anchors(pen, first, last)
        else:
            for end in filter(None, ends):
                pen.dot(pen.on(end), 0.3)
        for node in path.nodes:
            if not isinstance(node, Marker):
                self._wheel(node.marker, pen.number(node.radius), isinstance(node, Drum) or node.grips)
        for strand in path.strands:
            pen.between(strand.start, strand.end).draw("link", lines.along([0, 1], 0))

    def _wheel(self, marker: Marker, radius: float, turns: bool) -> None:
        """A pulley or a drum, with a spoke if the rope turns it."""
        pen = self.pen
        frame = pen.on(marker)
        if not isinstance(marker.body.shape, Disc):
            frame.area(frame.solid, lines.circle((0, 0), radius, 96), layer=scene.BODY)
            pen.replaces(marker.body, radius)
        frame.draw("link", lines.circle((0, 0), radius, 96), layer=scene.SPRING)
        if turns and not marker.body.is_ground:
            frame.draw("mark on body", [[0, 0], [0.8 * radius, 0]], layer=scene.BODY)

    def loads(self) -> list[Load]:
        """Return the pull of each strand on what is not the ground."""
        loads = []
        path = self.element.path
        for k, (strand, tension) in enumerate(zip(path.strands, ca.vertsplit(self.element.tensions), strict=True)):
            ends = ((k, strand.start, 1), (k + 1, strand.end, -1))
            loads += [
                Load(place, sign * tension * strand.direction, "force")
                for node, place, sign in ends
                if not path.markers[node].body.is_ground
            ]
        return loads if self._known else []

    def tooltip(self) -> dict[str, ca.SX]:
        """Return the tension of each strand, and the slack of an elastic rope."""
        tensions = ca.vertsplit(self.element.tensions) if self._known else []
        names = ["tension, N"] if len(tensions) == 1 else [f"tension {k + 1}, N" for k in range(len(tensions))]
        slack = (
            {"slack, m": self.element.gap} if isinstance(self.element, Rope) and self.element.gap.is_scalar() else {}
        )
        return slack | dict(zip(names, tensions, strict=True))

    @property
    def _known(self) -> bool:
        """True if the tensions are known: those of a cable are multipliers."""
        return isinstance(self.element, Rope) or self.pen.sample.has_multipliers


class ElasticBeltGlyph(Glyph, of=ElasticBelt):
    """Two pulleys and the belt about them."""

    def draw(self) -> None:
        """Draw it as a belt that does not stretch."""
        belt(self.element, self.pen)

    def loads(self) -> list[Load]:
        """Return the pull of each strand on what is not the ground."""
        element, loads = self.element, []
        a, b = element.a.body, element.b.body
        strands = zip(element.strands, ca.vertsplit(element.tensions), ((a, b), (b, a)), strict=True)
        for strand, tension, (first, last) in strands:
            ends = ((first, strand.start, tension), (last, strand.end, -tension))
            loads += [Load(at, pull * strand.direction, "force") for body, at, pull in ends if not body.is_ground]
        return loads

    def tooltip(self) -> dict[str, ca.SX]:
        """Return the tension of each strand."""
        first, second = ca.vertsplit(self.element.tensions)
        return {"tension from a to b, N": first, "tension from b to a, N": second}
