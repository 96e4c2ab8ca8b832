"""Placement of names: beside what they name, off lines and off each other.

Libraries that place labels move them about in one picture, and know points and boxes
but not lines. Here a name keeps its side over all poses of a motion, and the cost
of a place counts the lines that it covers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from textwrap import wrap

import numpy as np

from .scene import BODY, Label, Mark, Scene, placed

#: Height of a line of text and mean width of a letter, points; side of a cell in which lines are looked for.
LINE, LETTER, CELL = 13.0, 5.6, 1.5
#: Directions from a point, the usual ones first, and distances, points, of a name from its point.
WAYS = np.array([[1, -1], [1, 1], [-1, 1], [-1, -1], [1, 0], [-1, 0], [0, 1], [0, -1],
                 [1, 0.5], [1, -0.5], [-1, 0.5], [-1, -0.5], [0.5, 1], [-0.5, 1], [0.5, -1], [-0.5, -1]])  # fmt: skip
DISTANCES = (6.0, 9.0, 13.0, 18.0, 25.0, 34.0, 46.0, 60.0, 78.0, 100.0, 125.0)
#: Distance of a name from its point, points, from which on a line leads from one to the other.
LED = 17.0
#: Penalties: a line across a name, the share of it that lies on other names, that it touches one, the share that is cut
#: off, a point of distance, a leader that runs through a name, and the name of a body on another one.
ON_LINES, ON_NAMES, TOUCHES, CUT_OFF, FAR, LED_ACROSS, ON_OTHER = 1.0, 20.0, 3.0, 30.0, 0.022, 2.0, 1.5
#: Places whose leaders are looked at, and where along a leader.
SHORTLIST, ALONG = 40, np.linspace(0.0, 1.0, 24)[1:, None]
#: Poses of a motion that are looked at, or two for so many names; letters to a line of several names.
POSES, MANY, LETTERS = 7, 60, 22


def with_placed_names(scene: Scene, poses: np.ndarray, box: np.ndarray, scale: float) -> Scene:
    """Return the scene with its names placed.

    Parameters
    ----------
    scene : Scene
        Drawing to which they belong.
    poses : numpy.ndarray
        (n_t, frames, 4); a name keeps its side of the point over all of them.
    box : numpy.ndarray
        Corners ``[[x, y], [x, y]]`` of the picture, m.
    scale : float
        Points of the paper to a metre.
    """
    if not scene.labels:
        return scene
    count = POSES if len(scene.labels) < MANY else 2
    some = poses[np.unique(np.linspace(0, len(poses) - 1, count).round().astype(int))]
    marks = [mark for mark in scene.marks if mark.group != "velocities"]
    tables = [_ink(marks, pose, box, scale) for pose in some]
    taken = _Taken(len(some))
    placed_labels: dict[int, Label] = {}
    # joints first: there is less room about them than along a body
    for k in sorted(range(len(scene.labels)), key=lambda k: scene.labels[k].body):
        label = scene.labels[k]
        lines = label.text.split("\n")
        size = np.array([LETTER * max(map(len, lines)) + 3.0, LINE * len(lines)])
        points = (np.vstack([placed(np.array([label.point]), pose[label.frame]) for pose in some]) - box[0]) * scale
        shifts, far = _candidates(size, label.body)
        # the name of a body would be taken for that of its neighbour
        cost = (2 if label.body else 1) * FAR * far + sum(
            _price(point + shifts, size, table) + taken.price(j, point + shifts, size)
            for j, (point, table) in enumerate(zip(points, tables, strict=True))
        ) / len(some)
        if label.body:
            cost = cost + ON_OTHER * _on_others(points[0] + shifts, label, marks, some[0], box, scale)
        cheap = np.argsort(cost, kind="stable")[:SHORTLIST]
        crossed = np.array([taken.crossings(points[0], shifts[i], size) for i in cheap])
        best = shifts[cheap[np.argmin(cost[cheap] + LED_ACROSS * crossed)]]
        leader = _leader(best, size)
        taken.add(points, best, size, leader)
        placed_labels[k] = replace(
            label,
            shift=(float(best[0]), float(best[1])),
            leader=None if leader is None else (float(leader[0]), float(leader[1])),
        )
    return replace(scene, labels=[placed_labels[k] for k in range(len(scene.labels))])


class _Taken:
    """Names that have their places, over some poses, and the lines that lead to them in the first."""

    def __init__(self, poses: int):
        self._middles, self._sizes = np.zeros((poses, 0, 2)), np.zeros((0, 2))
        self._tracks = np.zeros((0, len(ALONG), 2))

    def add(self, points: np.ndarray, shift: np.ndarray, size: np.ndarray, leader: np.ndarray | None) -> None:
        """Take a place (2,) from points (poses, 2)."""
        self._middles = np.concatenate([self._middles, (points + shift)[:, None]], axis=1)
        self._sizes = np.vstack([self._sizes, size])
        if leader is not None:
            self._tracks = np.concatenate([self._tracks, (points[0] + ALONG * leader)[None]])

    def price(self, pose: int, middles: np.ndarray, size: np.ndarray) -> np.ndarray:
        """Cost of places (k, 2) of the middle of a name by the part of it that lies on other names."""
        common = (size + self._sizes) / 2 - np.abs(middles[:, None] - self._middles[pose])
        share = np.prod(np.clip(common, 0, np.minimum(size, self._sizes)), axis=2).sum(axis=1) / float(np.prod(size))
        return ON_NAMES * share + TOUCHES * (share > 0)

    def crossings(self, point: np.ndarray, shift: np.ndarray, size: np.ndarray) -> int:
        """Number of names that the leader of a place runs through, and of leaders that run through the place."""
        count = np.sum(np.any(np.all(np.abs(self._tracks - point - shift) < size / 2, axis=2), axis=1))
        end = _leader(shift, size)
        if end is not None:
            apart = np.abs((point + ALONG * end)[:, None] - self._middles[0])
            count = count + np.sum(np.any(np.all(apart < self._sizes / 2, axis=2), axis=0))
        return int(count)


def _leader(shift: np.ndarray, size: np.ndarray) -> np.ndarray | None:
    """End (2,) of the line that leads from a point to its name, points from it; None if the name is next to it."""
    gap = np.maximum(np.abs(shift) - size / 2, 0.0)
    if np.hypot(*gap) < LED:
        return None
    return np.clip(np.zeros(2), shift - size / 2, shift + size / 2)


def wrapped(names: Sequence[str]) -> str:
    """Names after each other, on several lines if they, or one of them, are long."""
    lines: list[str] = []
    for name in names:
        if lines and len(lines[-1]) + len(name) + 2 <= LETTERS:
            lines[-1] += f", {name}"
            continue
        if lines:
            lines[-1] += ","
        lines += wrap(name, LETTERS, break_long_words=False) if len(name) > LETTERS else [name]
    return "\n".join(lines)


def _candidates(size: np.ndarray, body: bool) -> tuple[np.ndarray, np.ndarray]:
    """Places of a name's middle from its point (k, 2), points, and how far off they count."""
    shifts = [WAYS * (size / 2 + (0.75 if d < DISTANCES[-1] else 1.0) * d) for d in DISTANCES]
    far = np.concatenate([d + 0.5 * np.arange(len(WAYS)) for d in DISTANCES])
    if body:
        return np.vstack([np.zeros((1, 2)), *shifts]), np.concatenate([[0.0], far])
    return np.vstack(shifts), far


def _ink(marks: Sequence[Mark], pose: np.ndarray, box: np.ndarray, scale: float) -> np.ndarray:
    """Sums over rows and columns of cells that lines pass: of a rectangle they follow from its corners."""
    shape = np.ceil((box[1] - box[0]) * scale / CELL).astype(int) + 1
    inked = np.zeros(shape, np.int64)
    for mark in marks:
        for loop in mark.loops:
            line = placed(loop, pose[mark.frame])
            points = (np.vstack([line, line[:1]]) if mark.closed else line) - box[0]
            cells = _dense(points * scale / CELL)
            inside = np.all((cells >= 0) & (cells < shape), axis=1)
            inked[tuple(cells[inside].T)] = 1
    return np.pad(inked.cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))


def _on_others(
    places: np.ndarray, label: Label, marks: Sequence[Mark], pose: np.ndarray, box: np.ndarray, scale: float
) -> np.ndarray:
    """Places (k, 2) of the middle of a body's name that lie on another body."""
    from matplotlib.path import Path

    inside = np.zeros(len(places), bool)
    for mark in marks:
        if mark.layer == BODY and mark.closed and mark.frame not in (0, label.frame):
            outline = (placed(mark.loops[0], pose[mark.frame]) - box[0]) * scale
            inside |= Path(outline).contains_points(places)
    return inside


def _dense(points: np.ndarray) -> np.ndarray:
    """Cells (k, 2) along a line through points."""
    lengths = np.hypot(*np.diff(points, axis=0).T)
    passed = np.concatenate([[0.0], np.cumsum(lengths)])
    at = np.linspace(0, passed[-1], int(min(passed[-1], 1e5)) + 2)
    return np.column_stack([np.interp(at, passed, column) for column in points.T]).astype(int)


def _price(middles: np.ndarray, size: np.ndarray, table: np.ndarray) -> np.ndarray:
    """Cost of places (k, 2) of a name by the lines that it covers, and what of it is cut off."""
    most = np.array(table.shape) - 1
    ends = [np.clip(middles + side * size / 2, 0, most * CELL) for side in (-1, 1)]
    low, high = (np.round(end / CELL).astype(int) for end in ends)
    lines = table[high[:, 0], high[:, 1]] - table[low[:, 0], high[:, 1]]
    lines = lines - table[high[:, 0], low[:, 1]] + table[low[:, 0], low[:, 1]]
    # a row of teeth is no worse than some lines
    cost = ON_LINES * np.minimum(lines * CELL / LINE, 5.0)
    return cost + CUT_OFF * (1 - np.prod((ends[1] - ends[0]) / size, axis=1))
