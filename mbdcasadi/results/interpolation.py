"""Interpolation between the times of a trajectory."""

from __future__ import annotations

import numpy as np


def _bracket(t: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Index of the interval of each of some times, its width and the fraction passed, as columns."""
    k = np.clip(np.searchsorted(t, times, side="right") - 1, 0, max(t.size - 2, 0))
    if t.size == 1:
        return k, np.ones((times.size, 1)), np.zeros((times.size, 1))
    h = (t[k + 1] - t[k])[:, None]
    return k, h, (times - t[k])[:, None] / h


def hermite(t: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray, times: np.ndarray):
    """Quintic Hermite interpolation of positions, and its derivative."""
    k, h, s = _bracket(t, times)
    if t.size == 1:
        return q[k], v[k]
    return quintic_step(s, h, q[k], v[k], a[k], q[k + 1], v[k + 1], a[k + 1])


def quintic_step(
    s: np.ndarray,
    h: np.ndarray,
    q0: np.ndarray,
    v0: np.ndarray,
    a0: np.ndarray,
    q1: np.ndarray,
    v1: np.ndarray,
    a1: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Quintic Hermite polynomials at shares s (k, 1) of steps of lengths h (k, 1), and their derivative."""
    v0, v1, a0, a1, rise = h * v0, h * v1, h**2 * a0, h**2 * a1, q1 - q0
    c3 = 10 * rise - 6 * v0 - 4 * v1 - 1.5 * a0 + 0.5 * a1
    c4 = -15 * rise + 8 * v0 + 7 * v1 + 1.5 * a0 - a1
    c5 = 6 * rise - 3 * v0 - 3 * v1 - 0.5 * a0 + 0.5 * a1
    position = q0 + s * (v0 + s * (a0 / 2 + s * (c3 + s * (c4 + s * c5))))
    return position, (v0 + s * (a0 + s * (3 * c3 + s * (4 * c4 + s * 5 * c5)))) / h


def cubic_step(
    s: np.ndarray, h: np.ndarray, z0: np.ndarray, r0: np.ndarray, z1: np.ndarray, r1: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Cubic Hermite polynomials at shares s (k, 1) of steps of lengths h (k, 1), and their derivative."""
    r0, r1, rise = h * r0, h * r1, z1 - z0
    second, third = 3 * rise - 2 * r0 - r1, r0 + r1 - 2 * rise
    return z0 + s * (r0 + s * (second + s * third)), (r0 + s * (2 * second + 3 * s * third)) / h


def cubic(t: np.ndarray, values: np.ndarray, rates: np.ndarray, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cubic Hermite interpolation of values with their rates, by row, and its derivative."""
    k, h, s = _bracket(t, times)
    if t.size == 1 or values.shape[1] == 0:
        return values[k], rates[k]
    return cubic_step(s, h, values[k], rates[k], values[k + 1], rates[k + 1])


def linear(t: np.ndarray, values: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Linear interpolation of values by row."""
    k, _, s = _bracket(t, times)
    if t.size == 1 or values.shape[1] == 0:
        return values[k]
    return values[k] + s * (values[k + 1] - values[k])
