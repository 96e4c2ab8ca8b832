"""Cams and their followers, points on curves, and wheels on tracks."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from ...model.bodies import Marker
from ...model.forces.wheel import Wheel
from ...model.geometry.curves import Curve
from ...model.joints.cams import CamCam, CamFlatFollower, CamPointFollower, PointOnCurve
from ...model.joints.rolling_on_curve import RollingOnCurve
from ..drawing import lines, scene
from ..drawing.pen import Frame, Pen
from .base import glyph
from .gears import disc

#: Points of an outline.
POINTS = 180
#: Curves up to this length, in units, are drawn from end to end; of longer ones the part about the path of the point.
SHORT = 80.0


def cam(pen: Pen, marker: Marker, outline: Any) -> None:
    """The outline of a cam, filled."""
    places = np.linspace(outline.lower, outline.upper, POINTS, endpoint=False)
    points = pen.curve(outline.point, places)
    frame = pen.on(marker)
    frame.area(frame.solid, points)
    pen.replaces(marker.body, float(np.max(np.hypot(*points.T))))


@glyph.register
def flat_follower(joint: CamFlatFollower, pen: Pen) -> None:
    """A cam under a face as wide as the contact travels."""
    cam(pen, joint.a, joint.outline)
    u = pen.unit
    low, high = pen.span(ca.dot(joint.b.x_axis, joint.contact_point - joint.b.position))
    reach = max(-low, high) + 2 * u
    above = float(pen.first(ca.dot(joint.b.y_axis, joint.b.position - joint.a.position))[0]) >= 0
    edge = 1.1 * u if above else -1.1 * u
    frame = pen.on(joint.b)
    frame.area("body", lines.rectangle((-reach, min(0, edge)), (reach, max(0, edge))))


@glyph.register
def point_follower(joint: CamPointFollower, pen: Pen) -> None:
    """A cam under a roller, or under a knife edge."""
    cam(pen, joint.a, joint.outline)
    u, radius = pen.unit, pen.number(joint.roller_radius)
    if radius > 0:
        frame = pen.at(joint.b.position)
        frame.area("block", lines.circle((0, 0), radius), layer=scene.SLOT)
        pen.pin(pen.on(joint.b), min(0.45, 0.5 * radius / u))
        return
    outward = joint.a.axes @ joint.outline.normal(joint.parameter)
    x, y = np.mean(pen.over(outward), axis=0)
    frame = pen.at(joint.b.position, np.arctan2(y, x))
    frame.area("dot", [[0, 0], [1.6 * u, 0.55 * u], [1.6 * u, -0.55 * u]], layer=scene.SLOT)


@glyph.register
def cam_on_cam(joint: CamCam, pen: Pen) -> None:
    """Both outlines."""
    cam(pen, joint.a, joint.outline)
    cam(pen, joint.b, joint.outline_b)


@glyph.register
def point_on_curve(joint: PointOnCurve, pen: Pen) -> None:
    """A slot along the path of the point, and the pin in it."""
    curve, u = joint.curve, pen.unit
    frame = pen.on(joint.a)
    middle, left, right = _slot(pen, curve, joint.parameter, 0.62 * u)
    if curve.closed:
        frame.area("slot", left, layer=scene.GUIDE)
        frame.area("slot", right, layer=scene.GUIDE)
    elif np.min(np.hypot(*np.diff(left, axis=0).T)) > 0 and np.ptp(middle) > 2 * u:
        frame.area("slot", np.vstack([left, right[::-1]]), layer=scene.GUIDE)
    pen.pin(pen.on(joint.b), 0.5)


@glyph.register
def rolling_on_curve(joint: RollingOnCurve, pen: Pen) -> None:
    """A wheel with spokes on a track, hatched on the ground, on the side of the curve away from the wheel."""
    disc(pen, joint.b, pen.number(joint.radius))
    middle, _, _ = _slot(pen, joint.curve, joint.parameter, 0.0)
    _track(pen, pen.on(joint.a), middle[:: -joint.side], joint.curve.closed)


@glyph.register
def wheel(element: Wheel, pen: Pen) -> None:
    """A wheel with spokes on the part of the road that it drives over."""
    base, hub = element.markers
    radius = pen.number(element.radius)
    disc(pen, hub, radius)
    low, high = pen.span(element.place[0])
    margin = 0.6 * radius + 2 * pen.unit
    places = np.linspace(low - margin, high + margin, POINTS)
    _track(pen, pen.on(base), pen.curve(lambda x: ca.vertcat(x, element.height(x)), places))


def _track(pen: Pen, frame: Frame, points: np.ndarray, closed: bool = False) -> None:
    """A line through points (k, 2) with the wheel to its left: hatched on the ground, a line on a body."""
    line, layer = ("ground line", scene.GROUND) if frame.body is None else ("body line", scene.GUIDE)
    frame.draw(line, points, closed=closed, layer=layer)
    if frame.body is None:
        frame.draw("hatch", *lines.hatching(points, 0.62 * pen.unit, 0.75 * pen.unit), layer=layer)


def _slot(pen: Pen, curve: Curve, parameter: Any, half: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Middle line and both edges of a slot: of a long open one, the part about the path of the point."""
    low, high = curve.lower, curve.upper
    whole = pen.curve(curve.point, np.linspace(low, high, POINTS))
    if not curve.closed and np.hypot(*np.ptp(whole, axis=0)) > SHORT * pen.unit:
        first, last = pen.span(parameter)
        margin = 0.25 * (last - first) + 0.08 * (high - low)
        low, high = max(low, min(first, high) - margin), min(high, max(last, low) + margin)
    places = np.linspace(low, high, POINTS, endpoint=not curve.closed)
    both = pen.curve(lambda x: ca.vertcat(curve.point(x), curve.normal(x)), places)
    return both[:, :2], both[:, :2] - half * both[:, 2:], both[:, :2] + half * both[:, 2:]
