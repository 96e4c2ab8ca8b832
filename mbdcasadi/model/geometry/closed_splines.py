"""Periodic splines of degree five, for outlines of cams.

The rows of a follower hold the tangent or the normal of the outline, and
``gamma`` their second derivatives: with cubic splines these would jump at
every point. Here four derivatives are continuous.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from .splines import piecewise


def closed_spline(x: ca.SX, xs: np.ndarray, ys: np.ndarray) -> ca.SX:
    """Curve through points that closes, as an expression; four continuous derivatives, at the seam too.

    Parameters
    ----------
    x : casadi.SX
        Scalar; the curve repeats with the period ``xs[-1] - xs[0]``.
    xs, ys : numpy.ndarray
        (n,), `xs` increasing, the last of `ys` the same as the first; at least five points.
    """
    pieces = _coefficients(np.diff(xs), ys)
    return piecewise(x, xs, xs, np.column_stack([pieces, pieces[:, :1]]), "periodic")


def _coefficients(h: np.ndarray, ys: np.ndarray) -> np.ndarray:
    """Coefficients (6, n) of the pieces over widths h (n,), the first and last point being one.

    Slopes and second derivatives at the points are such that the third and
    fourth derivatives are continuous.
    """
    n = len(h)
    here, after = np.eye(n), np.roll(np.eye(n), 1, axis=1)
    y0, y1 = ys[:-1], ys[1:]
    column = h[:, None]
    # c3, c4, c5 of each piece: constant parts, and matrices over the slopes and the second derivatives
    rise = y1 - y0
    constant = 10 * rise / h**3, -15 * rise / h**4, 6 * rise / h**5
    slope = (
        -(4 * after + 6 * here) / column**2,
        (7 * after + 8 * here) / column**3,
        -(3 * after + 3 * here) / column**4,
    )
    bend = (
        (after - 3 * here) / (2 * column),
        (3 * here - 2 * after) / (2 * column**2),
        (after - here) / (2 * column**3),
    )

    def at_end(parts: tuple, length: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        third = 6 * parts[0] + 24 * parts[1] * length + 60 * parts[2] * length**2
        return third, 24 * parts[1] + 120 * parts[2] * length

    blocks, right = [], []
    for k, factor in ((0, 6), (1, 24)):
        jumps = [at_end(parts, column)[k] - factor * np.roll(parts[k], -1, axis=0) for parts in (slope, bend)]
        # scaled by the widths, so that both unknowns and both kinds of rows are of one size
        scale = h ** (3 + k)
        blocks.append(np.hstack([jumps[0] / h, jumps[1] / h**2]) * scale[:, None])
        right.append((factor * np.roll(constant[k], -1) - at_end(constant, h)[k]) * scale)
    solution = np.linalg.solve(np.vstack(blocks), np.concatenate(right))
    d, s = solution[:n] / h, solution[n:] / h**2
    highest = [constant[k] + slope[k] @ d + bend[k] @ s for k in range(3)]
    return np.vstack([y0, d, s / 2, *highest])
