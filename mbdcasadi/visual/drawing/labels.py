"""Placement of names: at what they name, off lines, arrows and each other, with a line to it if they are not beside it.

Libraries that place labels move them about in one picture, and know points and boxes
but not lines. Here a name keeps its side over all poses of a motion, and the cost
of a place counts the lines that it covers, the way to its part, and what else is as near.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from textwrap import wrap

import numpy as np

from ...numerics.lazy import cached_property
from .scene import ARROW, BODY, Label, Mark, Scene, placed

#: Height of a line of text, width of most letters, of narrow and of wide ones, and room about a name, points.
LINE, LETTER, NARROW, WIDE, ROOM = 13.0, 5.8, 3.4, 8.9, 2.0
#: Letters that are narrow and wide.
NARROW_ONES, WIDE_ONES = frozenset("iIjlrtf .,:;!'|()[]-"), frozenset("mwMWOQ@%")
#: Side of a cell in which lines are looked for, and of one in which distances of parts are kept, points.
CELL, COARSE = 1.5, 3.0
#: Directions from a point, the usual ones first, and distances, points, of a name from its point.
WAYS = np.array([[1, -1], [1, 1], [-1, 1], [-1, -1], [1, 0], [-1, 0], [0, 1], [0, -1],
                 [1, 0.5], [1, -0.5], [-1, 0.5], [-1, -0.5], [0.5, 1], [-0.5, 1], [0.5, -1], [-0.5, -1]])  # fmt: skip
DISTANCES = (6.0, 9.0, 13.0, 18.0, 25.0, 34.0, 46.0, 60.0, 78.0, 100.0, 125.0)
#: Gap between a name and its part, points, from which on a line leads from one to the other.
LED = 6.0
#: Penalties: a line across a name, an arrow across it, the share of it that lies on other names, that it touches one,
#: the share that is cut off, a point of the gap to its part, of the way to its middle, that another part is nearer, the
#: share of it on another body, a point of its part that is hidden, a leader, and one that runs through a name, another
#: leader, or a point along lines.
ON_LINES, ON_ARROWS, ON_NAMES, TOUCHES, CUT_OFF = 1.5, 4.0, 20.0, 6.0, 30.0
FAR, OFF_MIDDLE, AMBIGUOUS, ON_OTHER, HIDDEN = 0.03, 0.004, 0.8, 1.2, 1.0
LEADER, LED_ACROSS, LED_ALONG = 0.5, 2.0, 0.4
#: Places of a name that are compared, and those whose leaders are looked at; where along a leader; rounds in which
#: names are placed anew beside all others.
MOST, SHORTLIST, ALONG, ROUNDS = 300, 30, np.linspace(0.0, 1.0, 16)[1:, None], 3
#: Poses of a motion that are looked at, or two for so many names; letters to a line of several names.
POSES, MANY, LETTERS = 7, 60, 22
#: Corners, sides and middle of a name, in parts of its size.
_GRID = np.array([[x, y] for x in (-0.5, -0.25, 0.0, 0.25, 0.5) for y in (-0.5, 0.0, 0.5)])


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
    paper = _Paper([mark for mark in scene.marks if mark.group != "velocities"], some, box, scale)
    gaps = _Gaps(paper, scene.labels)
    wanted = [_places(label, k, paper, gaps) for k, label in enumerate(scene.labels)]
    chosen: dict[int, int] = {}
    # joints first: there is less room about them than along a body
    order = sorted(range(len(wanted)), key=lambda k: scene.labels[k].body)
    for _ in range(ROUNDS):
        before = dict(chosen)
        for k in order:
            chosen.pop(k, None)
            chosen[k] = _cheapest(wanted[k], [(wanted[j], i) for j, i in chosen.items()])
        if chosen == before:
            break
    return replace(scene, labels=[wanted[k].label(scene.labels[k], chosen[k]) for k in range(len(wanted))])


@dataclass(eq=False)
class _Places:
    """Places of a name.

    Attributes
    ----------
    size : numpy.ndarray
        Of the name (2,), points.
    ends : numpy.ndarray
        Points of the part (k, 2), in its frame, m.
    shifts : numpy.ndarray
        Middles of the name from these points (k, 2), points of the paper.
    middles : numpy.ndarray
        Middles of the name on the paper (poses, k, 2).
    cost : numpy.ndarray
        Cost of each place without the other names (k,).
    led : numpy.ndarray
        True if a line leads to the name (k,).
    """

    size: np.ndarray
    ends: np.ndarray
    shifts: np.ndarray
    middles: np.ndarray
    cost: np.ndarray
    led: np.ndarray

    def best(self, count: int) -> _Places:
        """Return the places that cost least."""
        best = np.argsort(self.cost, kind="stable")[:count]
        middles = self.middles[:, best]
        return _Places(self.size, self.ends[best], self.shifts[best], middles, self.cost[best], self.led[best])

    @cached_property
    def leaders(self) -> np.ndarray:
        """Ends (k, 2) of lines that lead from the points to the name, points from them."""
        return np.clip(0.0, self.shifts - self.size / 2, self.shifts + self.size / 2)

    @cached_property
    def tracks(self) -> np.ndarray:
        """Points (k, n, 2) along these lines in the first pose, on the paper."""
        return (self.middles[0] - self.shifts)[:, None] + ALONG * self.leaders[:, None]

    @cached_property
    def boxes(self) -> np.ndarray:
        """Corners (2, k, 2) of what the name and its line take up in all poses, on the paper."""
        points = self.middles - self.shifts
        low, high = np.minimum(self.middles - self.size / 2, points), np.maximum(self.middles + self.size / 2, points)
        return np.stack([low.min(axis=0), high.max(axis=0)])

    def within_reach(self, others: Sequence[tuple[_Places, int]]) -> list[tuple[_Places, int]]:
        """Other names in their places, without those that are beyond all places of this one."""
        boxes = np.array([other.boxes[:, i] for other, i in others]).reshape(-1, 2, 2)
        low, high = self.boxes[0].min(axis=0), self.boxes[1].max(axis=0)
        meet = np.all((boxes[:, 0] <= high) & (boxes[:, 1] >= low), axis=1)
        return [other for other, there in zip(others, meet.tolist(), strict=True) if there]

    def label(self, label: Label, i: int) -> Label:
        """Return the label in a place."""
        point, shift, leader = ((float(x), float(y)) for x, y in (self.ends[i], self.shifts[i], self.leaders[i]))
        return replace(label, point=point, shift=shift, leader=leader if self.led[i] else None)


def _cheapest(places: _Places, others: Sequence[tuple[_Places, int]]) -> int:
    """Number of the place that costs least beside other names in their places."""
    others = places.within_reach(others)
    if not others:
        return int(np.argmin(places.cost))
    middles = np.stack([other.middles[:, i] for other, i in others], axis=1)
    sizes = np.array([other.size for other, _ in others])
    tracks = np.array([other.tracks[i] for other, i in others if other.led[i]]).reshape(-1, len(ALONG), 2)
    common = (places.size + sizes) / 2 - np.abs(places.middles[:, :, None] - middles[:, None])
    shares = np.prod(np.clip(common, 0, np.minimum(places.size, sizes)), axis=3) / float(np.prod(places.size))
    cost = places.cost + np.mean(np.sum(ON_NAMES * shares + TOUCHES * (shares > 0), axis=2), axis=0)
    cheap = np.argsort(cost, kind="stable")[:SHORTLIST]
    own = places.tracks[cheap]
    through = np.any(np.all(np.abs(own[:, :, None] - middles[0]) < sizes / 2, axis=3), axis=1)
    crossings = (np.sum(through, axis=1) + np.sum(_cross(own[:, None], tracks), axis=1)) * places.led[cheap]
    inside = np.all(np.abs(tracks - places.middles[0][cheap, None, None]) < places.size / 2, axis=3)
    crossings += np.sum(np.any(inside, axis=2), axis=1)
    return int(cheap[np.argmin(cost[cheap] + LED_ACROSS * crossings)])


def _cross(one: np.ndarray, two: np.ndarray) -> np.ndarray:
    """True for straight lines that cross, given by points (…, n, 2) along them."""

    def side(line: np.ndarray, point: np.ndarray) -> np.ndarray:
        along, away = line[..., -1, :] - line[..., 0, :], point - line[..., 0, :]
        return along[..., 0] * away[..., 1] - along[..., 1] * away[..., 0]

    apart = [side(a, b[..., 0, :]) * side(a, b[..., -1, :]) < 0 for a, b in ((one, two), (two, one))]
    return apart[0] & apart[1]


def _places(label: Label, number: int, paper: _Paper, gaps: _Gaps) -> _Places:
    """Places of a name about the points of its part, and what they cost."""
    lines = label.text.split("\n")
    size = np.array([max(map(width, lines)), LINE * len(lines)]) + 2 * ROOM * np.array([1, 0.5])
    around = np.vstack([WAYS * (size / 2 + (0.75 if d < DISTANCES[-1] else 1.0) * d) for d in DISTANCES])
    usual = np.tile(0.5 * np.arange(len(WAYS)), len(DISTANCES))
    if label.body:
        around, usual = np.vstack([np.zeros((1, 2)), around]), np.concatenate([[0.0], usual])
    points = np.array([label.point, *label.others])
    starts = np.array([paper.at(points, pose[label.frame]) for pose in paper.poses])
    ends, shifts = np.repeat(points, len(around), axis=0), np.tile(around, (len(points), 1))
    middles = np.repeat(starts, len(around), axis=1) + shifts
    own, others = gaps.of(number, middles, size)
    on_own, on_others = gaps.areas(label, middles, size)
    own[on_own] = 0.0
    gap = own.max(axis=0)
    off = np.repeat(np.hypot(*(starts[0] - starts[0, 0]).T), len(around))
    cost = FAR * (gap + np.tile(usual, len(points))) + OFF_MIDDLE * off + LEADER * (gap > LED)
    cost += AMBIGUOUS * np.mean((others < own) & ~on_own, axis=0) + ON_OTHER * on_others.mean(axis=0)
    if label.body:  # a point of it that another body hides is none to lead to
        cost += HIDDEN * np.repeat(np.mean(gaps.seen(starts) != label.frame, axis=0), len(around))
    places = _Places(size, ends, shifts, middles, cost + paper.price(middles, size), gap > LED).best(MOST)
    places.cost += (
        LED_ALONG * places.led * np.sum(paper.on_lines(places.tracks) & gaps.beside(number, places.tracks), 1)
    )
    return places


class _Paper:
    """Marks of a picture on paper, over some poses, points.

    Parameters
    ----------
    marks : sequence of Mark
        What is drawn.
    poses : numpy.ndarray
        (poses, frames, 4).
    box : numpy.ndarray
        Corners ``[[x, y], [x, y]]`` of the picture, m.
    scale : float
        Points of the paper to a metre.
    """

    def __init__(self, marks: Sequence[Mark], poses: np.ndarray, box: np.ndarray, scale: float):
        self.marks, self.poses, self._box, self._scale = marks, poses, box, scale
        self._size = (box[1] - box[0]) * scale
        self._tables = []
        for arrows in (False, True):
            some = [mark for mark in marks if arrows == (mark.layer == ARROW)]
            self._tables.append([self._sums(self.ink(some, pose, CELL)) for pose in poses])

    def at(self, points: np.ndarray, pose: np.ndarray) -> np.ndarray:
        """Points (k, 2) of a frame on the paper."""
        return (placed(points, pose) - self._box[0]) * self._scale

    def shape(self, cell: float) -> tuple[int, int]:
        """Numbers of cells of a size across and upwards."""
        across, upwards = np.ceil(self._size / cell).astype(int) + 1
        return int(across), int(upwards)

    def ink(self, marks: Sequence[Mark], pose: np.ndarray, cell: float) -> np.ndarray:
        """Cells that lines pass."""
        inked = np.zeros(self.shape(cell), bool)
        for mark in marks:
            for loop in mark.loops:
                line = self.at(loop, pose[mark.frame])
                cells = _dense((np.vstack([line, line[:1]]) if mark.closed else line) / cell)
                within = np.all((cells >= 0) & (cells < inked.shape), axis=1)
                inked[tuple(cells[within].T)] = True
        return inked

    def _sums(self, inked: np.ndarray) -> np.ndarray:
        """Sums over rows and columns of cells: of a rectangle they follow from its corners."""
        return np.pad(inked.astype(np.int64).cumsum(axis=0).cumsum(axis=1), ((1, 0), (1, 0)))

    def price(self, middles: np.ndarray, size: np.ndarray) -> np.ndarray:
        """Cost of places (poses, k, 2) by the lines and arrows that they cover, and what of the name is cut off."""
        cost = np.zeros(middles.shape[1])
        for weight, tables in zip((ON_LINES, ON_ARROWS), self._tables, strict=True):
            for table, middle in zip(tables, middles, strict=True):
                most = np.array(table.shape) - 1
                ends = [np.clip(middle + side * size / 2, 0, most * CELL) for side in (-1, 1)]
                low, high = (np.round(end / CELL).astype(int) for end in ends)
                lines = table[high[:, 0], high[:, 1]] - table[low[:, 0], high[:, 1]]
                lines = lines - table[high[:, 0], low[:, 1]] + table[low[:, 0], low[:, 1]]
                # a row of teeth is no worse than some lines
                cost += weight * np.minimum(lines * CELL / LINE, 5.0) / len(middles)
                if weight == ON_LINES:
                    cost += CUT_OFF * (1 - np.prod((ends[1] - ends[0]) / size, axis=1)) / len(middles)
        return cost

    def on_lines(self, points: np.ndarray) -> np.ndarray:
        """True for points (…, 2) in cells that lines pass in the first pose."""
        table = self._tables[0][0]
        x, y = np.moveaxis(np.clip((points / CELL).astype(int), 0, np.array(table.shape) - 2), -1, 0)
        return table[x + 1, y + 1] - table[x, y + 1] - table[x + 1, y] + table[x, y] > 0


class _Gaps:
    """Distances from what labels name, and areas of bodies, over some poses.

    Parameters
    ----------
    paper : _Paper
        The picture.
    labels : sequence of Label
        What is named.
    """

    def __init__(self, paper: _Paper, labels: Sequence[Label]):
        from scipy.ndimage import distance_transform_edt

        self._paper = paper
        shape = paper.shape(COARSE)
        #: frame of the body that is seen in each cell; the marks of a scene are in the order in which they cover others
        self._seen = np.zeros((len(paper.poses), *shape), np.int32)
        for mark in paper.marks:
            for j in range(len(paper.poses) if mark.layer == BODY and mark.closed and mark.frame else 0):
                self._fill(mark, j)
        found = []
        for label in labels:
            own = [mark for mark in paper.marks if mark.item in label.items or _is_body(mark, label)]
            for pose, seen in zip(paper.poses, self._seen, strict=True):
                inked = paper.ink(own, pose, COARSE)
                if label.body:
                    inked &= (seen == label.frame) | (seen == 0)
                place = (paper.at(np.array([label.point]), pose[label.frame]) / COARSE).astype(int)
                inked[tuple(np.clip(place, 0, np.array(shape) - 1).T)] = True
                found.append(COARSE * distance_transform_edt(~inked))
        self._own = np.array(found, np.float32).reshape(len(labels), len(paper.poses), *shape)
        alone = np.full((1, *self._own.shape[1:]), np.inf, np.float32)
        self._first, self._second = np.partition(np.concatenate([self._own, alone]), 1, axis=0)[:2]

    def _fill(self, mark: Mark, j: int) -> None:
        """Note the frame of a mark in the cells on its area, but in its holes."""
        from matplotlib.path import Path

        loops = [self._paper.at(loop, self._paper.poses[j][mark.frame]) / COARSE for loop in mark.loops]
        low, high = (f(np.vstack(loops), axis=0) for f in (np.min, np.max))
        first, last = np.clip(np.floor([low, high + 1]).astype(int), 0, self._seen.shape[1:])
        cells = np.stack(np.meshgrid(*map(np.arange, first, last), indexing="ij"), axis=-1)
        within = [Path(loop).contains_points(cells.reshape(-1, 2) + 0.5) for loop in loops]
        part = self._seen[j, first[0] : last[0], first[1] : last[1]]
        part[np.logical_xor.reduce(within).reshape(cells.shape[:2])] = mark.frame

    def _cells(self, points: np.ndarray) -> tuple[np.ndarray, ...]:
        """Indices of the cells of points (poses, …, 2), or (…, 2) for the first pose."""
        x, y = np.moveaxis(np.clip((points / COARSE).astype(int), 0, np.array(self._seen.shape[1:]) - 1), -1, 0)
        return x, y

    def of(self, number: int, middles: np.ndarray, size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Gaps (poses, k) between a name and its part, and between it and the nearest other part, points."""
        x, y = self._cells(middles[:, :, None] + _GRID * size)
        j = np.arange(len(middles))[:, None, None]
        own = self._own[number][j, x, y]
        first = self._first[j, x, y]
        others = np.where(own > first, first, self._second[j, x, y])
        return own.min(axis=2), others.min(axis=2)

    def areas(self, label: Label, middles: np.ndarray, size: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """True for places (poses, k) that lie on what is seen of the body that is named, and shares on other bodies."""
        seen = self.seen(middles[:, :, None] + _GRID * size)
        own = label.body & (seen == label.frame)
        return own.all(axis=2), ((seen > 0) & ~own).mean(axis=2)

    def seen(self, points: np.ndarray) -> np.ndarray:
        """Frames of the bodies that are seen at points (poses, …, 2); 0 beside them."""
        x, y = self._cells(points)
        return self._seen[np.arange(len(points)).reshape(-1, *[1] * (points.ndim - 2)), x, y]

    def beside(self, number: int, points: np.ndarray) -> np.ndarray:
        """True for points (…, 2) that do not lie on a part in the first pose."""
        return self._own[number][0][self._cells(points)] > COARSE


def _is_body(mark: Mark, label: Label) -> bool:
    """True if a mark is the outline of the body that is named, whatever drew it."""
    return label.body and mark.frame == label.frame and mark.style == "body"


def width(text: str) -> float:
    """Width of a line of text, points, nearly."""
    return sum(NARROW if c in NARROW_ONES else WIDE if c in WIDE_ONES else LETTER for c in text)


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


def _dense(points: np.ndarray) -> np.ndarray:
    """Cells (k, 2) along a line through points."""
    lengths = np.hypot(*np.diff(points, axis=0).T)
    passed = np.concatenate([[0.0], np.cumsum(lengths)])
    at = np.linspace(0, passed[-1], int(min(passed[-1], 1e5)) + 2)
    return np.column_stack([np.interp(at, passed, column) for column in points.T]).astype(int)
