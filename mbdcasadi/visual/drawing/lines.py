"""Curves that symbols are made of, as arrays of points (k, 2), and (k, 4) for those that stretch.

A point of a curve that stretches is ``(x0, x1, y0, y1)`` and lies, in a frame of
length L, at ``(x0 + x1 L, y0 + y1 |L|)``: a spring between two points, an arrow
as long as a force is large, a couple whose sense is the sign of L.
"""

from __future__ import annotations

from typing import Any

import numpy as np

Points = np.ndarray
#: Anything that NumPy reads as points.
Like = Any


def circle(centre: tuple[float, float] | Points, radius: float, count: int = 48) -> Points:
    """Closed circle, counter-clockwise."""
    return np.asarray(centre, float) + radius * _directions(np.linspace(0, 2 * np.pi, count, endpoint=False))


def _directions(angles: Points) -> Points:
    return np.column_stack([np.cos(angles), np.sin(angles)])


def turned(points: Points, angle: float) -> Points:
    """Points turned about the origin."""
    c, s = np.cos(angle), np.sin(angle)
    return np.asarray(points, float) @ np.array([[c, s], [-s, c]])


def bar(half: float, count: int = 16) -> Points:
    """Outline of a bar with round ends from 0 to the length of its frame, which stretches (k, 4)."""
    right = half * _directions(np.linspace(-np.pi / 2, np.pi / 2, count))
    left = half * _directions(np.linspace(np.pi / 2, 3 * np.pi / 2, count))
    ends = [
        np.column_stack([p[:, 0], np.full(count, k), p[:, 1], np.zeros(count)]) for k, p in ((1.0, right), (0.0, left))
    ]
    return np.vstack(ends)


def rectangle(low: tuple[float, float], high: tuple[float, float]) -> Points:
    """Closed rectangle between two corners, counter-clockwise."""
    (x0, y0), (x1, y1) = low, high
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])


def convex_hull(points: Points) -> Points:
    """Corners of the convex hull, counter-clockwise (Andrew's monotone chain)."""
    ordered = sorted(map(tuple, np.unique(np.asarray(points, float), axis=0)))
    if len(ordered) < 3:
        return np.array(ordered)

    def half(sequence: list) -> list:
        chain: list = []
        for p in sequence:
            while len(chain) > 1 and _left_of(chain[-2], chain[-1], p) <= 0:
                chain.pop()
            chain.append(p)
        return chain[:-1]

    return np.array(half(ordered) + half(ordered[::-1]))


def _left_of(p: tuple, q: tuple, r: tuple) -> float:
    return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])


def plate(points: Points, radius: float) -> Points:
    """Link through points: their convex hull with round corners of a radius."""
    return convex_hull(np.vstack([circle(p, radius, 40) for p in np.atleast_2d(points)]))


def hatching(points: Points, spacing: float, depth: float) -> list[Points]:
    """Oblique strokes to the right of the line through points (k, 2)."""
    points = np.asarray(points, float)
    sides = np.diff(points, axis=0)
    lengths = np.hypot(*sides.T)
    length = float(lengths.sum())
    if length <= 0:
        return []
    count = max(2, round(length / spacing))
    places = (np.arange(count) + 0.75) / count * length
    ends = np.r_[0.0, np.cumsum(lengths)]
    pieces = np.clip(np.searchsorted(ends, places) - 1, 0, len(sides) - 1)
    strokes = []
    for k, place in zip(pieces, places, strict=True):
        along = sides[k] / lengths[k]
        foot = points[k] + (place - ends[k]) * along
        strokes.append(np.array([foot, foot - depth * along + depth * np.array([along[1], -along[0]])]))
    return strokes


def spiral(inner: float, outer: float, turns: float) -> Points:
    """Spiral spring about the origin, from inside to outside."""
    share = np.linspace(0, 1, round(40 * turns))
    return (inner + (outer - inner) * share)[:, None] * _directions(2 * np.pi * turns * share)


def arc(radius: float, start: float, sweep: float, count: int = 40) -> Points:
    """Piece of a circle about the origin."""
    return radius * _directions(start + sweep * np.linspace(0, 1, count))


def arc_arrow(radius: float, head: float, start: float = -0.7, sweep: float = 4.2) -> tuple[Points, Points]:
    """Curved arrow about the origin, counter-clockwise: its line, and its head as a triangle."""
    tip = start + sweep
    back = tip - head / radius
    triangle = np.array([arc(radius, tip, 0, 1)[0], *(arc(radius + s * 0.45 * head, back, 0, 1)[0] for s in (1, -1))])
    return arc(radius, start, sweep - 0.8 * head / radius), triangle


def arrow(length: float, head: float) -> tuple[Points, Points]:
    """Straight arrow along x: its line, and its head as a triangle."""
    shaft = np.array([[0, 0], [length - 0.8 * head, 0]])
    return shaft, np.array([[length, 0], [length - head, 0.4 * head], [length - head, -0.4 * head]])


# --- what stretches ----------------------------------------------------------------------
def stretched(points: Like) -> Points:
    """Points (k, 2) that scale as a whole with the length of the frame; a negative length mirrors them."""
    points = np.asarray(points, float)
    zero = np.zeros(len(points))
    return np.column_stack([zero, points[:, 0], zero, points[:, 1]])


def along(shares: Like, heights: Like, shift: float = 0.0) -> Points:
    """Points at shares of the length, at heights that do not scale."""
    shares, heights = np.broadcast_arrays(np.asarray(shares, float), np.asarray(heights, float))
    return np.column_stack([np.full(shares.size, shift), shares, heights, np.zeros(shares.size)])


def zigzag(height: float, turns: int = 6, lead: float = 0.16, shift: float = 0.0) -> Points:
    """Spring over the whole length, with straight ends."""
    inner = lead + (1 - 2 * lead) * (np.arange(2 * turns) + 0.5) / (2 * turns)
    heights = shift + height * np.where(np.arange(2 * turns) % 2, -1.0, 1.0)
    return along(np.r_[0, lead, inner, 1 - lead, 1], np.r_[shift, shift, heights, shift, shift])


# --- teeth -----------------------------------------------------------------------------
def teeth(radius: float, count: int, phase: float = 0.0, inward: bool = False) -> Points:
    """Closed outline of a gear with straight flanks, a tooth in the direction of the phase.

    Parameters
    ----------
    radius : float
        Of the pitch circle, m.
    count : int
        Number of teeth.
    phase : float
        Angle of the middle of a tooth (of a gap, if they point inward), rad.
    inward : bool
        True if it is the inside of a ring.
    """
    module, pitch = 2 * radius / count, 2 * np.pi / count
    # half widths at root and tip, in parts of the pitch; gaps of a ring are wider, since teeth stand askew in them
    shares, heights = np.array([-0.32, -0.1, 0.1, 0.32]), np.array([-1.1, 0.9, 0.9, -1.1])
    if inward:
        shares, heights = np.array([-0.4, -0.18, 0.18, 0.4]), np.array([-0.9, 1.1, 1.1, -0.9])
    angles = (phase + pitch * (np.arange(count)[:, None] + shares)).ravel()
    radii = radius + module * np.tile(heights, count)
    return radii[:, None] * _directions(angles)


def rack_teeth(low: float, high: float, pitch: float, phase: float = 0.0) -> Points:
    """Teeth of a rack above the x axis as its pitch line, from left to right; a gap at the phase."""
    module = pitch / np.pi
    first, last = int(np.floor((low - phase) / pitch)), int(np.ceil((high - phase) / pitch))
    middles = phase + pitch * (np.arange(first, last) + 0.5)
    shares, heights = np.array([-0.36, -0.13, 0.13, 0.36]), module * np.array([-1.1, 0.9, 0.9, -1.1])
    return np.column_stack([(middles[:, None] + pitch * shares).ravel(), np.tile(heights, middles.size)])
