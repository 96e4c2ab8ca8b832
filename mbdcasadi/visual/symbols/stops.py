"""Stops: a pad at the closed gap."""

from __future__ import annotations

import casadi as ca
import numpy as np

from ...model.bodies import Body, ground
from ...model.forces.stops import EndStop
from ..drawing import lines, scene
from ..drawing.pen import Frame, Pen
from .base import glyph
from .motions import pivot_of

#: A gap counts as one along a line, or of an angle, if its derivatives are 1 and 0 up to this.
EXACT = 1e-9


@glyph.register
def end_stop(element: EndStop, pen: Pen) -> None:
    """A pad on the ground, in front of a body that slides or beside one that turns.

    A gap is any expression; one between two bodies, or not of one direction, has no place.
    """
    bodies = [body for body in element.bodies if body is not ground]
    if len(bodies) != 1:
        return
    (body,) = bodies
    slopes = pen.over(ca.jacobian(element.gap, ca.vertcat(body.x, body.y, body.phi)))
    if np.max(np.ptp(slopes, axis=0)) > EXACT:
        return
    sliding, turning = float(np.hypot(*slopes[0, :2])), abs(float(slopes[0, 2]))
    if abs(sliding - 1) < EXACT and np.ptp(pen.over(body.phi)) < 1e-6:
        pen.later(lambda box: _ahead(pen, body, element, -slopes[0, :2]))
    elif sliding < EXACT and abs(turning - 1) < EXACT:
        pen.later(lambda box: _beside(pen, body, element, -float(np.sign(slopes[0, 2]))))


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
