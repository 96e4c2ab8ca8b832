"""Pins, sliders, welds and massless links."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from ...model.bodies import Marker
from ...model.joints.lower_pairs import Distance, PointOnLine, Revolute, Translational, Weld
from ..drawing import lines, scene
from ..drawing.outlines import local_outlines, points_on, sections
from ..drawing.pen import Frame, Pen
from .base import glyph
from .springs import cylinder

#: Half length and half height of a slider block without a shape, in units.
BLOCK = 2.0, 1.2
#: A body that is so many times as long as wide is a rod in a bearing, not a block on a rail.
ROD = 3.0


@glyph.register
def revolute(joint: Revolute, pen: Pen) -> None:
    """A circle, on a stand if it is on the ground."""
    for marker, other in (joint.markers, joint.markers[::-1]):
        if marker.body.is_ground:
            pen.stand(pen.on(marker), other.body)
    pen.pin(pen.on(joint.b if joint.a.body.is_ground else joint.a))


@glyph.register
def weld(joint: Weld, pen: Pen) -> None:
    """A wall if it is on the ground, else a small square."""
    u = pen.unit
    for fixed, moving in ((joint.a, joint.b), (joint.b, joint.a)):
        if fixed.body.is_ground:
            x, y = way = pen.first(moving.body.position - fixed.position)
            away = 0.0 if pen.vanishes(way) else np.arctan2(y, x)
            frame = pen.on(fixed)
            wall = Frame(pen, frame.number, frame.shift, away)
            pen.hatched(wall, (0, 2.2 * u), (0, -2.2 * u))
            return
    pen.on(joint.a).area("dot", lines.rectangle((-0.45 * u, -0.45 * u), (0.45 * u, 0.45 * u)), layer=scene.PIN)


@glyph.register
def distance(joint: Distance, pen: Pen) -> None:
    """A thin link between two small pins; a cylinder if its length follows the time or a parameter."""
    frame = pen.between(joint.a.position, joint.b.position)
    if isinstance(joint.distance, ca.SX) and not joint.distance.is_constant():
        cylinder(pen, frame, joint.distance, 0.75, "motion")
    else:
        frame.draw("link", lines.along([0, 1], 0), layer=scene.SLOT)
    for marker in joint.markers:
        if marker.body.is_ground:
            pen.stand(pen.on(marker))
        pen.pin(pen.on(marker), 0.4)


# --- sliders ------------------------------------------------------------------------------
@glyph.register
def translational(joint: Translational, pen: Pen) -> None:
    """A block on a rail; a rod in a bearing if the body is long; a fixed bearing on a moving rod."""
    low, high = pen.span(joint.displacement)
    if joint.b.body.is_ground:
        _fixed_bearing(joint, pen, low, high)
        return
    block_on_rail(pen, joint.b, pen.on(joint.a), low, high)


def block_on_rail(pen: Pen, marker: Marker, rail: Frame, low: float, high: float) -> None:
    """A block at a marker on a rail along the x axis of a frame, on which the marker goes from `low` to `high`."""
    u, body = pen.unit, marker.body
    frame = pen.on(marker)
    loops = local_outlines(body, marker, pen) if body.shape is not None else _drawn(pen, frame)
    if not loops or all(len(loop) == 2 for loop in loops):
        block = lines.rectangle((-BLOCK[0] * u, -BLOCK[1] * u), (BLOCK[0] * u, BLOCK[1] * u))
        frame.area("body", block)
        pen.replaces(body, BLOCK[1] * u)
        loops = [block]
    back, front, bottom, top = sections(loops)
    if (rod := _rod_through(loops)) is not None:
        _two_sleeves(rail, pen, rod, (low, high))
    elif body.shape is not None and front - back > ROD * (top - bottom):
        _sleeve(rail, pen, (max(high + back, low + back), low + front), bottom, top)
    else:
        margin = 1.2 * u if high - low > u else 0.45 * (front - back) + u
        _rail(rail, pen, (low + back - margin, high + front + margin), bottom, top)


def rubbing_edge(pen: Pen, joint: Translational) -> float:
    """Height of the edge of a block on its rail, in the axes of its marker, m."""
    marker = joint.a if joint.b.body.is_ground else joint.b
    if marker.body.shape is None:
        return -BLOCK[1] * pen.unit
    return sections(local_outlines(marker.body, marker, pen))[2]


def _drawn(pen: Pen, frame: Frame) -> list[np.ndarray]:
    """Outline that other symbols have drawn of a body longer than wide (a rack), in the axes of a marker on it."""
    loops = [lines.turned(loop - frame.shift, -frame.angle) for loop in pen.loops.get(frame.body, ())]  # type: ignore[arg-type]
    long, wide = np.ptp(np.vstack(loops), axis=0) if loops else (0.0, 0.0)
    return loops if long > wide else []


def _rail(frame: Frame, pen: Pen, reach: tuple[float, float], bottom: float, top: float) -> None:
    """Surface under a block that slides; on both sides if it slides up and down."""
    direction = float(pen.scene.poses(pen.sample)[0, frame.number, 2]) + frame.angle
    low, high = reach
    upright = abs(np.sin(direction)) > 0.8
    if upright or np.cos(direction) > 0:
        pen.wall(frame, (low, bottom), (high, bottom))
    if upright or np.cos(direction) <= 0:
        pen.wall(frame, (high, top), (low, top))
    if frame.body is not None:
        u = pen.unit
        bar = lines.rectangle((min(low, -0.6 * u), bottom - 0.6 * u), (max(high, 0.6 * u), bottom))
        # the rail lies beside the marker, and is held by a post there
        post = lines.rectangle((-0.6 * u, bottom - 0.6 * u), (0.6 * u, max(0.6 * u, bottom)))
        frame.area("body", bar, post)


def _rod_through(loops: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray] | None:
    """Boxes ``[[x, y], [x, y]]`` of a rod along x and of the part between its ends, if loops have that shape."""
    boxes = [np.array([loop.min(axis=0), loop.max(axis=0)]) for loop in loops if len(loop) > 2]
    for rod in boxes:
        others = [box for box in boxes if box is not rod]
        long, wide = rod[1] - rod[0]
        if not others or long < ROD * wide or not rod[0, 1] < 0 < rod[1, 1]:
            continue
        carried = np.array([np.min(others, axis=0)[0], np.max(others, axis=0)[1]])
        if rod[0, 0] < carried[0, 0] and carried[1, 0] < rod[1, 0]:
            return rod, carried
    return None


def _two_sleeves(frame: Frame, pen: Pen, rod: tuple[np.ndarray, np.ndarray], span: tuple[float, float]) -> None:
    """Bearings about both ends of a rod that carries something in the middle."""
    (low, high), (whole, carried) = span, rod
    bottom, top = whole[:, 1]
    _sleeve(frame, pen, (high + whole[0, 0], low + carried[0, 0]), bottom, top)
    _sleeve(frame, pen, (high + carried[1, 0], low + whole[1, 0]), bottom, top)


def _sleeve(frame: Frame, pen: Pen, common: tuple[float, float], bottom: float, top: float) -> None:
    """Bearing about the part of a rod that passes it at all times."""
    u = pen.unit
    low, high = common
    middle, half = (low + high) / 2, max(1.2 * u, min(2.2 * u, 0.35 * (high - low)))
    gap = 0.15 * u
    for side in (1, -1):
        edge = top + gap if side > 0 else bottom - gap
        ends = (middle + side * half, edge), (middle - side * half, edge)
        pen.wall(frame, *ends)


def _fixed_bearing(joint: Translational, pen: Pen, low: float, high: float) -> None:
    """A rod that slides through a bearing on the ground."""
    u = pen.unit
    rod = pen.on(joint.a)
    rod.area("body", lines.plate(np.array([[min(low, 0) - 2 * u, 0], [max(high, 0) + 2 * u, 0]]), 0.5 * u))
    bearing = pen.on(joint.b)
    for side in (1, -1):
        pen.hatched(bearing, (side * 2 * u, side * 0.65 * u), (-side * 2 * u, side * 0.65 * u))


@glyph.register
def point_on_line(joint: PointOnLine, pen: Pen) -> None:
    """A slot along the line, with a die block on a pin in it."""
    u, height, body = pen.unit, pen.number(joint.offset), joint.a.body
    low, high = pen.span(joint.displacement)
    frame = pen.on(joint.a)
    # of one pose the slot is drawn as if the block went back and forth, in a shape from end to end
    moves = high - low > 1e-3 * u
    margin = 2.0 * u if moves else 6.0 * u
    ends = np.array([[low - margin, height], [high + margin, height]])
    if body.shape is None and not body.is_ground:
        frame.area("body", lines.plate(np.vstack([ends, [[0, height]]]), 1.25 * u))
    elif not body.is_ground:
        back, front, _, _ = sections(local_outlines(body, joint.a, pen))
        back, front = _between_pins(pen, joint, (back + u, front - u), (low, high))
        reach = (max(ends[0, 0], back), min(ends[1, 0], front)) if moves else (back, front)
        ends[:, 0] = min(low, reach[0]), max(high, reach[1])
    frame.area("slot", lines.plate(ends, 0.75 * u), layer=scene.SLOT)
    die = pen.at(joint.b.position, joint.a.angle, joint.b.body)
    die.area("block", lines.rectangle((-1.1 * u, -0.75 * u), (1.1 * u, 0.75 * u)), layer=scene.SLOT)
    pen.pin(pen.on(joint.b), 0.4)


def _between_pins(
    pen: Pen, joint: PointOnLine, ends: tuple[float, float], span: tuple[float, float]
) -> tuple[float, float]:
    """Ends of a slot that leave room about the pins of its body on both sides of the block."""
    u, frame = pen.unit, pen.on(joint.a)
    pins = [other for other in pen.sample.mechanism.joints if isinstance(other, Revolute)]
    places = points_on(joint.a.body, pins, pen)
    back, front = ends
    for x, y in lines.turned(places - frame.shift, -frame.angle):
        if abs(y - pen.number(joint.offset)) < 1.5 * u:
            back = max(back, x + 1.9 * u) if x < span[0] else back
            front = min(front, x - 1.9 * u) if x > span[1] else front
    return back, front
