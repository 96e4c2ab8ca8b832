"""The path of a rope over pulleys: tangents, wraps and what winds up."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from ...errors import ModelError
from ..bodies import Marker, as_marker, rotation
from ..element import at_poses, cross
from ..expressions import norm
from ..quantities import entries
from ..symbols import values_of
from ..validity import ValidityCondition
from .pulleys import Drum, Pulley

#: Cosine of the angle, 135°, by which a strand may turn from its direction at the estimated poses: at half a turn the
#: angle between directions jumps, and no step of an integrator passes the 90° around it unseen.
_FARTHEST = -np.sqrt(0.5)


@dataclass(frozen=True, eq=False)
class Strand:
    """Straight piece of a rope: its ends and its unit direction (2,), and its length, m."""

    start: ca.SX
    end: ca.SX
    direction: ca.SX
    length: ca.SX


class RopePath:
    """The way of a rope from one end to the other, over pulleys.

    A strand is the common tangent of two circles. With ``d`` from centre to centre and ``e = σ_j r_j - σ_i r_i``
    (``σ = 1`` counter-clockwise), its length is ``l = √(d² - e²)`` and its direction ``u = (l d - e R d)/d²``. A wrap
    is the angle between the directions of two strands, times the radius.

    Parameters
    ----------
    what : str
        Kind and name of the rope, for messages.
    a, b : Marker or Drum
        Its ends.
    over : sequence of Pulley
        What it runs over, in order.

    Attributes
    ----------
    nodes : tuple
        Ends and pulleys, in order.
    markers : tuple of Marker
        Their centres.
    strands : tuple of Strand
        Straight pieces.
    wraps : dict of int to casadi.SX
        Angle, rad, by which the rope turns round the pulley of each node.
    sections : tuple of casadi.SX
        Lengths, m, of the pieces between ends and pulleys that grip; what is wound up on these since the estimated
        poses belongs to them.
    section_of : tuple of int
        Section of each strand.
    known : casadi.SX
        1, or NaN where a strand, or a wrap, has turned so far from the estimated poses that turns are not counted.
    """

    def __init__(self, what: str, a: Any, b: Any, over: Any = ()):
        self._what = what
        ends = [end if isinstance(end, Drum) else as_marker(end, what, name) for end, name in ((a, "a"), (b, "b"))]
        for pulley in (pulleys := entries(over, f"{what}: over=")):
            if not isinstance(pulley, Pulley):
                raise ModelError(f"{what}: over= takes Pulley objects, got {pulley!r}")
        self.nodes: tuple[Any, ...] = (ends[0], *pulleys, ends[1])
        self.markers = tuple(node if isinstance(node, Marker) else node.marker for node in self.nodes)
        if len({id(marker.body) for marker in self.markers}) < 2:
            name = self.markers[0].body.name
            raise ModelError(f"{what} connects body '{name}' with itself; it must touch two bodies")
        self.limits = tuple(limit for node in self.nodes for limit in getattr(node, "limits", ()))
        self.strands = tuple(self._strand(k) for k in range(len(self.nodes) - 1))
        self.known = ca.SX(1)
        self.wraps = {k: self._wrap(k) for k in range(1, len(self.nodes) - 1)}
        self.sections, self.section_of = self._in_sections()

    # --- geometry --------------------------------------------------------------------------------
    def _circle(self, k: int) -> tuple[ca.SX, ca.SX]:
        """Centre (2,) of a node, and its radius with the sign of its sense."""
        node = self.nodes[k]
        if isinstance(node, Marker):
            return node.position, ca.SX(0)
        return node.marker.position, node.sense * ca.SX(node.radius)

    def _strand(self, k: int) -> Strand:
        (first, r), (second, s) = self._circle(k), self._circle(k + 1)
        d, e = second - first, s - r
        if isinstance(self.nodes[k], Marker) and isinstance(self.nodes[k + 1], Marker):
            length = norm(d)  # which may vanish
            return Strand(first, second, d / (length + (length == 0)), length)
        left = values_of(at_poses(ca.dot(d, d) - e**2))
        if not left > 0:
            raise ModelError(
                f"{self._what}: strand {k} from {self._called(k)} to {self._called(k + 1)} has no tangent at the "
                "estimated poses: an end lies inside a pulley, or two pulleys overlap; give the bodies other poses"
            )
        length = ca.sqrt(ca.dot(d, d) - e**2)
        turned = ca.vertcat(-d[1], d[0])
        u = (length * d - e * turned) / ca.dot(d, d)
        normal = ca.vertcat(-u[1], u[0])
        return Strand(first - r * normal, second - s * normal, u, length)

    def _called(self, k: int) -> str:
        node, body = self.nodes[k], self.markers[k].body.name
        return f"a point of '{body}'" if isinstance(node, Marker) else f"the {type(node).__name__.lower()} on '{body}'"

    def _wrap(self, k: int) -> ca.SX:
        """Angle by which the rope turns round a pulley."""
        pulley, before, after = self.nodes[k], self.strands[k - 1].direction, self.strands[k].direction
        sense = pulley.sense
        angle = ca.atan2(sense * cross(before, after), ca.dot(before, after))
        estimate = float(values_of(at_poses(angle))[0, 0])
        estimate += 2 * np.pi if estimate <= -np.pi / 2 else 0.0
        beyond = self._turned(before, rotation(-sense * estimate) @ after)
        return estimate + 2 * np.pi * pulley.turns + sense * beyond

    def _turned(self, before: Any, after: ca.SX) -> ca.SX:
        """Angle from one unit vector to another, which are the same at the estimated poses."""
        self.known *= ca.if_else(ca.dot(before, after) > _FARTHEST, 1, np.nan)
        return ca.atan2(cross(before, after), ca.dot(before, after))

    def wound(self, k: int, strand: int) -> ca.SX:
        """Length, m, of the part of a strand that a node has wound up since the estimated poses."""
        node = self.nodes[k]
        if isinstance(node, Marker):
            return ca.SX(0)
        u, carried = self.strands[strand].direction, node.carrier.phi
        carried -= at_poses(carried)
        began = rotation(carried) @ ca.DM(values_of(at_poses(u)))
        relative = self.markers[k].angle - carried - self._turned(began, u)
        return (1 if strand < k else -1) * node.sense * ca.SX(node.radius) * (relative - at_poses(relative))

    def held(self, k: int) -> bool:
        """True for a node at which a section ends."""
        node = self.nodes[k]
        return not isinstance(node, Pulley) or node.grips

    def piece(self, first: int, last: int) -> ca.SX:
        """Length, m, of the rope from what is on one node to what is on another, over those between them."""
        strands = self.strands[first:last]
        length = self.wound(first, first) + self.wound(last, last - 1)
        length += sum((strand.length for strand in strands), ca.SX(0))
        return length + sum((ca.SX(self.nodes[k].radius) * self.wraps[k] for k in range(first + 1, last)), ca.SX(0))

    def _in_sections(self) -> tuple[tuple[ca.SX, ...], tuple[int, ...]]:
        borders = [k for k in range(len(self.nodes)) if self.held(k)]
        pairs = list(pairwise(borders))
        section_of = tuple(i for i, (first, last) in enumerate(pairs) for _ in range(first, last))
        return tuple(self.piece(first, last) for first, last in pairs), section_of

    # --- what ropes need of it ---------------------------------------------------------------------
    @property
    def pulleys(self) -> tuple[tuple[int, Pulley], ...]:
        """Pulleys with their nodes."""
        return tuple((k, node) for k, node in enumerate(self.nodes) if isinstance(node, Pulley))

    @property
    def gripped(self) -> ca.SX:
        """Length, m, of what lies on pulleys that grip at the estimated poses, which belongs to no section."""
        wraps = [node.radius * at_poses(self.wraps[k]) for k, node in self.pulleys if node.grips]
        return sum(wraps, ca.SX(0))

    def shares(self) -> list[Any]:
        """Part of the whole length in each section at the estimated poses."""
        lengths = [at_poses(section) for section in self.sections]
        return [1] if len(lengths) == 1 else [length / sum(lengths, ca.SX(0)) for length in lengths]

    def validity_conditions(self) -> tuple[ValidityCondition, ...]:
        """It touches every pulley."""
        return tuple(
            ValidityCondition(
                wrap,
                f"{self._what}: it leaves {self._called(k)}, on which it presses no more, or turns round it by whole "
                "turns that turns= of the pulley gives",
            )
            for k, wrap in self.wraps.items()
        )

    @property
    def bodies(self) -> tuple[Any, ...]:
        """Bodies that it touches."""
        return tuple(dict.fromkeys(marker.body for marker in self.markers))
