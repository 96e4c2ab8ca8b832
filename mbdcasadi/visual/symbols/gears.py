"""Gears, racks, wheels and belts."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from ...model.bodies import Marker
from ...model.forces.backlash import Backlash
from ...model.joints.clutches import ShaftClutch
from ...model.joints.gears import Belt, Coupler, Gear, RackAndPinion, Rolling
from ...model.ropes.belt import ElasticBelt
from ..drawing import lines, scene
from ..drawing.pen import Pen
from .base import glyph, tie

#: Length of a tooth and its gap along the pitch circle, in units, and the fewest teeth of a gear.
PITCH, FEWEST = 1.5, 10


@dataclass(frozen=True)
class Wheel:
    """One gear of a pair: its place, its pitch radius, and the sense of its teeth."""

    marker: Marker
    radius: float
    inward: bool

    def key(self, pen: Pen) -> tuple:
        """Key of a gear that is drawn once: a planet is one gear in two pairs."""
        place = pen.first(self.marker.local) / pen.unit
        return (self.marker.body, *np.round(place, 6), round(self.radius / pen.unit, 6), self.inward)


@glyph.register
def gear(joint: Gear, pen: Pen) -> None:
    """Two gears with teeth that mesh, and their pitch circles."""
    first, second = _wheels(pen, joint)
    if second.key(pen) in pen.teeth and first.key(pen) not in pen.teeth:
        first, second = second, first
    if first.key(pen) not in pen.teeth:
        _toothed(pen, first, _count(pen, first), 0.0)
    if second.key(pen) not in pen.teeth:
        _toothed(pen, second, *_meshing(pen, first, second, joint.internal))


def _count(pen: Pen, wheel: Wheel) -> int:
    """Number of teeth of the first gear of a train: near the usual pitch, and a whole number for all of them.

    A gear that meshes with three others or more (a sun with its planets) has a
    multiple of their number, so that planets at equal angles mesh with sun and ring.
    """
    mechanism = pen.sample.mechanism
    loose = [force.transmission for force in mechanism.forces if isinstance(force, Backlash)]
    gears = [joint for joint in (*mechanism.joints, *loose) if isinstance(joint, Gear)]
    wheels = [w.key(pen) for joint in gears for w in _wheels(pen, joint)]
    radii = np.array([key[-2] for key in dict.fromkeys(wheels)])
    meshes = np.array([max(1, n) if (n := wheels.count(key)) > 2 else 1 for key in dict.fromkeys(wheels)])
    small = float(radii.min())
    usual = max(FEWEST, round(2 * np.pi * small / PITCH))
    counts = np.arange(max(FEWEST, int(0.7 * usual)), int(1.6 * usual) + 2)
    exact = counts[:, None] * radii / small
    whole = np.round(exact)
    misfit = np.abs(exact - whole).max(axis=1) + 0.5 * (whole % meshes != 0).any(axis=1)
    best = counts[np.argmin(misfit + 1e-3 * np.abs(counts - usual))]
    return round(best * wheel.radius / pen.unit / small)


def _wheels(pen: Pen, joint: Gear) -> tuple[Wheel, Wheel]:
    """Both gears of a pair."""
    ra, rb = pen.number(joint.radius_a), pen.number(joint.radius_b)
    return Wheel(joint.a, ra, joint.internal and ra > rb), Wheel(joint.b, rb, joint.internal and rb > ra)


def _meshing(pen: Pen, known: Wheel, new: Wheel, internal: bool) -> tuple[int, float]:
    """Number and phase of the teeth of a gear that fit into those of one that is drawn."""
    count, phase = pen.teeth[known.key(pen)]
    partner = max(FEWEST, round(count * new.radius / known.radius))
    centres = new.marker.position - known.marker.position
    angle, other, x, y = pen.first(known.marker.angle, new.marker.angle, centres)
    contact = np.arctan2(y, x) + (np.pi if internal and new.radius > known.radius else 0.0)
    # by which part of a pitch the point of contact lies beyond a tooth (a gap, of a ring)
    beyond = (contact - angle - phase) * count / (2 * np.pi)
    pitch = 2 * np.pi / partner
    if internal:
        return partner, contact - beyond * pitch - other
    return partner, contact + np.pi + (beyond + 0.5) * pitch - other


def _toothed(pen: Pen, wheel: Wheel, count: int, phase: float) -> None:
    """Draw a gear, and remember its teeth."""
    pen.teeth[wheel.key(pen)] = count, phase
    frame, radius, module = pen.on(wheel.marker), wheel.radius, 2 * wheel.radius / count
    outline = lines.teeth(radius, count, phase, wheel.inward)
    if wheel.inward:
        rim = lines.circle((0, 0), radius + 3.2 * module + 0.6 * pen.unit, 120)
        frame.area(frame.solid, rim, outline[::-1])
        pen.replaces(wheel.marker.body, radius + 4 * module)
    else:
        frame.area(frame.solid, outline, *_holes(pen, radius - 1.1 * module))
        pen.replaces(wheel.marker.body, radius + module)
    frame.area("pitch", lines.circle((0, 0), radius, 96))


def _holes(pen: Pen, inside: float) -> list[np.ndarray]:
    """Holes that show how a disc turns, if there is room for them."""
    if inside < 4.5 * pen.unit:
        return []
    size = min(0.2 * inside, 2.5 * pen.unit)
    return [
        lines.circle(0.6 * inside * np.array([np.cos(x), np.sin(x)]), size, 32)[::-1] for x in np.arange(4) * np.pi / 2
    ]


@glyph.register
def rack_and_pinion(joint: RackAndPinion, pen: Pen) -> None:
    """A rack under a gear."""
    u, radius = pen.unit, pen.number(joint.radius)
    wheel = Wheel(joint.b, radius, False)
    if wheel.key(pen) not in pen.teeth:
        _toothed(pen, wheel, max(FEWEST, round(2 * np.pi * radius / (PITCH * u))), 0.0)
    count, phase = pen.teeth[wheel.key(pen)]
    place = ca.dot(joint.a.x_axis, joint.b.position - joint.a.position)
    along, turn = pen.first(place, joint.b.angle - joint.a.angle)
    beyond = (-np.pi / 2 - turn - phase) % (2 * np.pi / count)
    low, high = pen.span(place)
    margin, pitch = max(0.8 * radius, 4 * u), 2 * np.pi * radius / count
    top = lines.rack_teeth(low - margin, high + margin, pitch, along - radius * beyond)
    base = -1.1 * pitch / np.pi - 1.3 * u
    frame = pen.on(joint.a)
    frame.area(frame.solid, np.vstack([top, [top[-1, 0], base], [top[0, 0], base]]))
    pen.replaces(joint.a.body, float(np.max(np.abs(top))))


@glyph.register
def rolling(joint: Rolling, pen: Pen) -> None:
    """A wheel with spokes on a track."""
    u, radius = pen.unit, pen.number(joint.radius)
    disc(pen, joint.b, radius)
    low, high = pen.span(joint.displacement)
    margin = 0.6 * radius + 2 * u
    pen.wall(pen.on(joint.a), (low - margin, 0), (high + margin, 0))


def disc(pen: Pen, marker: Marker, radius: float) -> None:
    """A round body about a marker, with spokes that show how it turns."""
    frame = pen.on(marker)
    frame.area("body", lines.circle((0, 0), radius, 96))
    if radius > 2.5 * pen.unit and marker.body not in pen.replaced:
        rim = 0.86 * radius
        frame.area("mark on body", lines.circle((0, 0), rim, 72))
        spokes = [rim * np.array([[np.cos(x), np.sin(x)], [-np.cos(x), -np.sin(x)]]) for x in np.arange(3) * np.pi / 3]
        frame.draw("mark on body", *spokes, layer=scene.BODY)
    pen.replaces(marker.body, radius)


@glyph.register
def belt(joint: Belt | ElasticBelt, pen: Pen) -> None:
    """Two pulleys and the belt about them."""
    ra, rb = pen.number(joint.radius_a), pen.number(joint.radius_b)
    for marker, radius in ((joint.a, ra), (joint.b, rb)):
        disc(pen, marker, radius)
    centres = joint.b.position - joint.a.position
    length = float(np.hypot(*pen.first(centres)))
    frame = pen.along(joint.a.position, centres)
    if not joint.crossed:
        around = lines.convex_hull(np.vstack([lines.circle((0, 0), ra, 120), lines.circle((length, 0), rb, 120)]))
        frame.area("belt", around, layer=scene.SLOT)
        return
    lean = np.arcsin(min((ra + rb) / length, 1.0))
    for side in (1, -1):
        touch = np.array([np.sin(lean), side * np.cos(lean)])
        frame.draw("belt", [ra * touch, np.array([length, 0]) - rb * touch], layer=scene.SLOT)
    half = np.pi / 2 + lean
    frame.draw("belt", lines.arc(ra, half - 2 * lean, 2 * np.pi - 2 * half + 4 * lean, 60), layer=scene.SLOT)
    other = lines.arc(rb, np.pi + half - 2 * lean, 2 * np.pi - 2 * half + 4 * lean, 60) + np.array([length, 0])
    frame.draw("belt", other, layer=scene.SLOT)


@glyph.register
def coupler(joint: Coupler, pen: Pen) -> None:
    """A dashed line between the shafts."""
    tie(pen, joint.a.position, joint.b.position)


@glyph.register
def backlash(element: Backlash, pen: Pen) -> None:
    """The gears or shafts whose teeth have play."""
    glyph(element.transmission, pen)


@glyph.register
def clutch(joint: ShaftClutch, pen: Pen) -> None:
    """Two linings round a shaft, and a dashed line between shafts that are apart."""
    first, second = joint.markers
    tie(pen, first.position, second.position)
    frame, u = pen.on(second if first.body.is_ground else first), pen.unit
    for turn in (0.0, np.pi):
        inner, outer = (lines.arc(r * u, turn + np.pi / 6, turn + 5 * np.pi / 6) for r in (2.2, 3.2))
        frame.area("rubber", np.vstack([outer, inner[::-1]]), layer=scene.PIN)
