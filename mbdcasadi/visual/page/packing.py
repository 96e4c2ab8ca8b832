"""Values at knots, packed for a page: whole numbers, of which the differences from an extrapolation are kept."""

from __future__ import annotations

import base64
import zlib
from typing import Any

import numpy as np

from ..course import POINTS, QUANTUM

#: Largest sum of the weights of an extrapolation; above it fewer points are used.
LARGEST_WEIGHTS = 64.0
#: Whole numbers above this one, of mechanisms far from the origin, are counted from the first one.
LARGEST_WHOLE = 2.0**24


class Packer:
    """Columns of values at knots, in the form that ``data.js`` reads.

    Parameters
    ----------
    t : numpy.ndarray
        Times of all samples (n,), s.
    resolution : float
        Distance of knots across which nothing is extrapolated.

    Attributes
    ----------
    groups : list of dict
        Of each group the number of its knots.
    columns : list of dict
        Of each column its group, the size of its whole numbers, and the one that they count from unless that is zero;
        or its constant value.
    """

    def __init__(self, t: np.ndarray, resolution: float):
        self.groups: list[dict[str, int]] = []
        self.columns: list[dict[str, Any]] = []
        self._t, self._resolution = t, resolution
        self._knots: list[np.ndarray] = []
        self._residuals: list[np.ndarray] = []
        self._known: dict[bytes, int] = {}

    def add(self, knots: np.ndarray, values: np.ndarray, tolerance: np.ndarray) -> list[int]:
        """Add a group, and return the numbers of its columns.

        Parameters
        ----------
        knots : numpy.ndarray
            Numbers of its samples.
        values : numpy.ndarray
            (n, k) at all samples.
        tolerance : numpy.ndarray
            (k,): values are kept as multiples of a part of it, see :data:`course.QUANTUM`.
        """
        if not tolerance.size:
            return []
        quantum = QUANTUM * tolerance
        whole = np.floor(values[knots] / quantum + 0.5)
        bases = np.where(np.abs(whole).max(axis=0) > LARGEST_WHOLE, whole[0], 0.0)
        whole -= bases
        first = len(self.columns)
        self.columns += [
            {"g": len(self.groups), "q": float(q)} | ({"o": float(base)} if base else {})
            for q, base in zip(quantum, bases, strict=True)
        ]
        self.groups.append({"n": int(knots.size), "k": int(tolerance.size)})
        self._knots.append(knots)
        self._residuals.append(residuals(self._t[knots], whole, self._resolution).T.ravel())
        return list(range(first, len(self.columns)))

    def constant(self, value: float) -> int:
        """Add a column that does not change, and return its number; equal ones are kept once."""
        value += 0.0  # no negative zero
        key = np.float64(value).tobytes()
        if key not in self._known:
            self._known[key] = len(self.columns)
            self.columns.append({"c": float(f"{value:.12g}")})
        return self._known[key]

    def packed(self) -> dict[str, Any]:
        """Return times, knots by group, columns, and all numbers as deflated bytes in base64."""
        used = np.unique(np.concatenate([[0, self._t.size - 1], *self._knots]).astype(int))
        masks = [np.packbits(np.isin(used, knots), bitorder="little") for knots in self._knots]
        signed = np.concatenate([np.zeros(0), *self._residuals])
        # signs to the lowest bit, then low bytes before high ones, which are mostly zero
        words = np.where(signed >= 0, 2 * signed, -2 * signed - 1).astype("<u4")
        planes = np.frombuffer(words.tobytes(), np.uint8).reshape(-1, 4).T
        return {
            "times": used.size, "resolution": self._resolution, "groups": self.groups, "columns": self.columns,
            "clock": _deflated(self._t[used].astype("<f8").tobytes()),
            "masks": _deflated(b"".join(mask.tobytes() for mask in masks)),
            "words": _deflated(planes.tobytes()),
        }  # fmt: skip


def _deflated(content: bytes) -> str:
    return base64.b64encode(zlib.compress(content, 9)).decode()


def residuals(t: np.ndarray, whole: np.ndarray, resolution: float) -> np.ndarray:
    """Return whole numbers less the rounded extrapolation from the knots before each.

    The page adds them up again. It does the same operations in the same order,
    so that the sums are the same to the last bit.

    Parameters
    ----------
    t : numpy.ndarray
        Times of the knots (n,), s.
    whole : numpy.ndarray
        Whole numbers (n, k).
    resolution : float
        Distance of knots across which nothing is extrapolated.
    """
    n = t.size
    first = np.r_[0, np.flatnonzero(np.diff(t) <= resolution) + 1]
    since = np.arange(n) - first[np.searchsorted(first, np.arange(n), side="right") - 1]
    extrapolated = np.zeros_like(whole)
    # the number before a jump is as good a guess as any
    extrapolated[1:] = whole[:-1]
    open_ = np.ones(n, bool)
    for points in range(POINTS, 1, -1):
        rows = np.flatnonzero(open_ & (since >= points))
        weights = _weights(t, rows, points)
        size = np.zeros(rows.size)
        for weight in weights:
            size = size + np.abs(weight)
        rows, weights = rows[size <= LARGEST_WEIGHTS], [weight[size <= LARGEST_WEIGHTS] for weight in weights]
        value = np.zeros((rows.size, whole.shape[1]))
        for j, weight in enumerate(weights):
            value = value + weight[:, None] * whole[rows - points + j]
        extrapolated[rows] = np.floor(value + 0.5)
        open_[rows] = False
    return whole - extrapolated


def _weights(t: np.ndarray, rows: np.ndarray, points: int) -> list[np.ndarray]:
    """Lagrange weights at each knot of the knots before it."""
    places = [t[rows - points + j] - t[rows] for j in range(points)]
    weights = []
    for j in range(points):
        weight = np.ones(rows.size)
        for k in range(points):
            if k != j:
                weight = weight * (places[k] / (places[k] - places[j]))
        weights.append(weight)
    return weights
