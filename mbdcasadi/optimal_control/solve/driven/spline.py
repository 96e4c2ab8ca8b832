"""Motions from a state to another one whose accelerations are polynomials in the intervals of a mesh."""

from __future__ import annotations

import numpy as np
from numpy.polynomial import Polynomial

from ....numerics.collocation import gauss
from ....numerics.lazy import cached_property


class MotionSpline:
    """The motions of second-order collocation on a mesh, without conditions between the intervals.

    A motion is given by ``q_0, v_0, b_0, q_1, v_1, b_1, … q_N, v_N`` in a row: states at the mesh points, and what it
    has within each interval besides. Its unknowns are those without the first and the last state, so that an interval
    meets its neighbours alone: sums of squares over intervals have banded matrices.

    Parameters
    ----------
    times : numpy.ndarray
        Mesh points (N + 1,), s.
    degree : int
        Number of the accelerations that decide the polynomial of an interval, at least 2.
    ends : tuple of numpy.ndarray
        First and last state, coordinates and velocities, each (2 n,).
    """

    def __init__(self, times: np.ndarray, degree: int, ends: tuple[np.ndarray, np.ndarray]):
        self.times, self.degree, self.ends = times, degree, ends
        self.count, self.n = times.size - 1, ends[0].size // 2
        #: numbers of an interval that are its own or its start's, and of all that decide its motion
        self.stride, self.width = degree * self.n, (degree + 2) * self.n
        #: number of unknowns
        self.size = self.count * self.stride - 2 * self.n

    # --- a motion ---------------------------------------------------------------------------
    def through(self, states: np.ndarray, inner: np.ndarray | None = None) -> np.ndarray:
        """Unknowns of the motion through states (N + 1, 2 n), of which the ends are known, and inner numbers."""
        rows = np.zeros((self.count, self.stride))
        rows[:, : 2 * self.n] = states[:-1]
        if inner is not None:
            rows[:, 2 * self.n :] = inner
        unknowns: np.ndarray = rows.ravel()[2 * self.n :]
        return unknowns

    def by_interval(self, x: np.ndarray, ends: tuple[np.ndarray, np.ndarray] | None = None) -> np.ndarray:
        """What decides the motion in each interval (N, (degree + 2) n)."""
        first, last = self.ends if ends is None else ends
        whole = np.concatenate([first, x, last])
        return np.lib.stride_tricks.sliding_window_view(whole, self.width)[:: self.stride]

    def changes(self, step: np.ndarray) -> np.ndarray:
        """Changes of what decides the motion in each interval, by a change of the unknowns."""
        zero = np.zeros(2 * self.n)
        return self.by_interval(step, (zero, zero))

    def points(self, shares: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Times of the same shares of every interval, and shape functions there; each by point (N k, …)."""
        lengths = np.diff(self.times)
        times = (self.times[:-1, None] + np.outer(lengths, shares)).ravel()
        return times, _shapes(np.tile(shares, self.count), np.repeat(lengths, shares.size), self.degree)

    def places(self, x: np.ndarray, shapes: np.ndarray) -> np.ndarray:
        """Coordinates, velocities and accelerations (N k, 3, n) at points of every interval, by shape functions."""
        each = shapes.reshape(self.count, -1, *shapes.shape[1:])
        parts = self.by_interval(x).reshape(self.count, self.degree + 2, self.n)
        return np.einsum("ikdf,ifn->ikdn", each, parts).reshape(-1, 3, self.n)

    def at(self, x: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Coordinates, velocities and accelerations at times (k, 3, n)."""
        interval = np.clip(np.searchsorted(self.times, times, side="right") - 1, 0, self.count - 1)
        lengths = np.diff(self.times)[interval]
        shapes = _shapes((times - self.times[interval]) / lengths, lengths, self.degree)
        parts = self.by_interval(x).reshape(self.count, self.degree + 2, self.n)[interval]
        return np.einsum("kdf,kfn->kdn", shapes, parts)

    def with_accelerations(self, states: np.ndarray, accelerations: np.ndarray) -> np.ndarray:
        """Unknowns of the motion through states, with accelerations at the stages as near as these let them.

        Accelerations are those at the points of Gauss of each interval (N, degree, n).
        """
        plain = self.through(states)
        if self.degree == 2:
            return plain
        _, shapes = self.points(gauss(self.degree).points)
        missing = accelerations - self.places(plain, shapes)[:, 2].reshape(accelerations.shape)
        bubbles = shapes[:, 2, 2:-2].reshape(self.count, self.degree, -1)
        return self.through(states, (np.linalg.pinv(bubbles) @ missing).reshape(self.count, -1))

    def like(self, other: MotionSpline, x: np.ndarray) -> np.ndarray:
        """Unknowns of the motion of another mesh: the same states at the mesh points, nearly its accelerations."""
        times, _ = self.points(gauss(self.degree).points)
        accelerations = other.at(x, times)[:, 2].reshape(self.count, self.degree, self.n)
        return self.with_accelerations(other.at(x, self.times)[:, :2].reshape(-1, 2 * self.n), accelerations)

    # --- sums over intervals ----------------------------------------------------------------
    def gathered(self, parts: np.ndarray) -> np.ndarray:
        """Derivative of a sum by the unknowns, from those of its parts in each interval (N, (degree + 2) n)."""
        whole = self._gathered_whole(parts)
        return whole[2 * self.n :][: self.size]

    def gathered_at_ends(self, parts: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives of a sum by the first and the last state, each (2 n,)."""
        whole = self._gathered_whole(parts)
        return whole[: 2 * self.n], whole[2 * self.n + self.size :][: 2 * self.n]

    def _gathered_whole(self, parts: np.ndarray) -> np.ndarray:
        whole = np.zeros((self.count + 1, self.stride))
        whole[:-1] = parts[:, : self.stride]
        whole[1:, : 2 * self.n] += parts[:, self.stride :]
        return whole.ravel()

    def band(self, parts: np.ndarray) -> np.ndarray:
        """Symmetric matrix of a sum by the unknowns as a lower band, from those of its parts in each interval."""
        rows, columns = self._below
        lower = np.where(rows < self.width, parts[:, np.minimum(rows, self.width - 1), columns], 0.0)
        whole = np.zeros((self.width, self.count + 1, self.stride))
        by_row = lower.transpose(1, 0, 2)
        whole[:, :-1] = by_row[:, :, : self.stride]
        whole[:, 1:, : 2 * self.n] += by_row[:, :, self.stride :]
        return whole.reshape(self.width, -1)[:, 2 * self.n :][:, : self.size]

    @cached_property
    def _below(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows and columns of the entries of a matrix, by their distance below its diagonal."""
        below, columns = np.indices((self.width, self.width))
        return below + columns, columns


def _shapes(shares: np.ndarray, lengths: np.ndarray, degree: int) -> np.ndarray:
    """Shape functions with their first and second derivatives by time, at shares of intervals (k, 3, degree + 2).

    Those of the cubic polynomials of Hermite at both ends, and between them such that are zero there with their slopes.
    """
    inner = [Polynomial([0, 0, 1, -2, 1]) * Polynomial([-1, 2]) ** k for k in range(degree - 2)]
    start = [Polynomial(c) for c in ([1, 0, -3, 2], [0, 1, -2, 1])]
    end = [Polynomial(c) for c in ([0, 0, 3, -2], [0, 0, -1, 1])]
    functions = [*start, *inner, *end]
    values = np.array([[f.deriv(k)(shares) if k else f(shares) for f in functions] for k in range(3)])
    powers = np.zeros((3, degree + 2)) - np.arange(3)[:, None]
    powers[:, [1, -1]] += 1
    scaled: np.ndarray = values.transpose(2, 0, 1) * lengths[:, None, None] ** powers
    return scaled
