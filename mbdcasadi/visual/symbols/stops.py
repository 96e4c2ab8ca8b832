"""Stops: a pad at the closed gap."""

from __future__ import annotations

from itertools import pairwise

import casadi as ca
import numpy as np

from ...model.bodies import Body, ground
from ...model.forces.stops import EndStop
from ...numerics.tolerances import NEGLIGIBLE
from ..drawing import lines, scene
from ..drawing.pen import Frame, Pen
from .base import glyph
from .motions import pivot_of

#: Places of a pad between two bodies beside the line of their motion, in units, until there is no spring.
BESIDE = (0.0, 3.4, -3.4, 5.0, -5.0, 7.0, -7.0)


@glyph.register
def end_stop(element: EndStop, pen: Pen) -> None:
    """A pad on the ground, in front of a body that slides or beside one that turns, or on the second of two that slide.

    A gap is any expression; one that is not of one direction has no place.
    """
    bodies = [body for body in element.bodies if body is not ground]
    if len(bodies) == 2:
        _meeting(pen, bodies[0], bodies[1], element)
    if len(bodies) != 1:
        return
    (body,) = bodies
    slopes = pen.over(ca.jacobian(element.gap, ca.vertcat(body.x, body.y, body.phi)))
    if np.max(np.ptp(slopes, axis=0)) > NEGLIGIBLE:
        return
    sliding, turning = float(np.hypot(*slopes[0, :2])), abs(float(slopes[0, 2]))
    if abs(sliding - 1) < NEGLIGIBLE and np.ptp(pen.over(body.phi)) < 1e-6:
        pen.later(lambda box: _ahead(pen, body, element, -slopes[0, :2]))
    elif sliding < NEGLIGIBLE and abs(turning - 1) < NEGLIGIBLE:
        pen.later(lambda box: _beside(pen, body, element, -float(np.sign(slopes[0, 2]))))


def _meeting(pen: Pen, a: Body, b: Body, element: EndStop) -> None:
    """A pad between two bodies that slide towards each other along a line."""
    slopes = pen.over(ca.jacobian(element.gap, ca.vertcat(a.x, a.y, b.x, b.y, a.phi, b.phi)))
    still = np.max(np.ptp(np.hstack([slopes, pen.over(a.phi, b.phi)]), axis=0)) < 1e-6
    ahead, back, turning = -slopes[0, :2], slopes[0, 2:4], slopes[0, 4:]
    if still and abs(np.hypot(*ahead) - 1) < NEGLIGIBLE and np.max(np.abs([*(ahead - back), *turning])) < NEGLIGIBLE:
        pen.later(lambda box: _on_second(pen, a, b, element, float(np.arctan2(ahead[1], ahead[0]))))


def _on_second(pen: Pen, a: Body, b: Body, element: EndStop, angle: float) -> None:
    """A pad that hangs on a stem from the second body, and the edge of the first that it meets; beside springs."""
    u, pose = pen.unit, pen.scene.poses(pen.sample)[0]
    first, second = (
        lines.turned(scene.placed(np.vstack(pen.loops.get(x, [np.zeros((1, 2))])), pose[pen.of_body(x).number]), -angle)
        for x in (a, b)
    )
    front, face = float(first[:, 0].max()), float(second[:, 0].min())
    marks = [mark for mark in pen.scene.marks if mark.layer == scene.SPRING]
    drawn = [lines.turned(scene.placed(loop, pose[mark.frame]), -angle) for mark in marks for loop in mark.loops]
    fine = [start + np.linspace(0, 1, 20)[:, None] * (end - start) for line in drawn for start, end in pairwise(line)]
    points = np.vstack([np.zeros((0, 2)), *fine])
    between = points[(points[:, 0] > front) & (points[:, 0] < face), 1]
    middle = float(np.mean([first[:, 1].min(), first[:, 1].max()]))
    places = [middle + k * u for k in BESIDE]
    across = next((place for place in places if not np.any(np.abs(between - place) < 1.3 * u)), middle)

    def on(body: Body, along: float) -> Frame:
        x, y, phi = pen.first(body.x, body.y, body.phi)
        (place,) = lines.turned(lines.turned(np.array([[along, across]]), angle) - [x, y], -phi)
        return Frame(pen, pen.of_body(body).number, place, angle - phi, body)

    reach = pen.number(element.gap)
    pad, edge = on(b, front + reach), on(a, front)
    pad.area("rubber", lines.rectangle((0.0, -0.9 * u), (0.7 * u, 0.9 * u)), layer=scene.SLOT)
    stem = max(face - front - reach, 0.7 * u)
    sides = [float(np.clip(across, part[:, 1].min(), part[:, 1].max()) - across) for part in (first, second)]
    pad.draw("body line", [[0.7 * u, 0], [stem, 0], [stem, sides[1]]], layer=scene.GUIDE)
    edge.draw("body line", [[0, -0.9 * u], [0, 0.9 * u]], [[0, 0], [0, sides[0]]], layer=scene.GUIDE)


def _ahead(pen: Pen, body: Body, element: EndStop, ahead: np.ndarray) -> None:
    """A pad across the path of the body, at its front when the gap is closed."""
    x, y, phi, gap = pen.first(body.x, body.y, body.phi, element.gap)
    loops = pen.loops.get(body, [np.zeros((1, 2))])
    front = float(np.max(lines.turned(np.vstack(loops), phi) @ ahead))
    _pad(pen, np.array([x, y]) + (front + gap) * ahead, float(np.arctan2(ahead[1], ahead[0])))


def _beside(pen: Pen, body: Body, element: EndStop, sense: float) -> None:
    """A pad beside the line from the pivot to the centre of mass at the closed gap."""
    x, y, gap = pen.first(body.x, body.y, element.gap)
    pivot = pen.first(pivot_of(pen, body, element.bodies).position)
    arm = np.array([x, y]) - pivot
    if np.hypot(*arm) < 3 * pen.unit:
        return
    (at,) = lines.turned(arm[None], sense * gap)
    across = sense * np.array([-at[1], at[0]]) / np.hypot(*at)
    loops = pen.loops.get(body, [np.zeros((1, 2))])
    edge = float(np.max(lines.turned(np.vstack(loops), pen.number(body.phi) + sense * gap) @ across))
    _pad(pen, pivot + at + edge * across, float(np.arctan2(across[1], across[0])))


def _pad(pen: Pen, face: np.ndarray, angle: float) -> None:
    """A pad whose face is met along the x axis of its frame, and the wall behind it."""
    u, frame = pen.unit, Frame(pen, 0, face, angle)
    frame.area("rubber", lines.rectangle((0.0, -0.9 * u), (0.7 * u, 0.9 * u)), layer=scene.GUIDE)
    pen.hatched(frame, (0.7 * u, 1.7 * u), (0.7 * u, -1.7 * u))
