"""Pieces of motion in one mode each, as one motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...equations import equations
from ...results.trajectory import EventOccurrence, Statistics, Trajectory
from .friction_modes import Modes, ModesOfFriction


@dataclass
class Piece:
    """Motion in one mode; `shown_end` where its end is an output in any case."""

    modes: Modes
    motion: Trajectory
    shown_end: bool = False


def joined(
    modes: ModesOfFriction, pieces: Sequence[Piece], events: list[EventOccurrence], grid: np.ndarray | None
) -> Trajectory:
    """All pieces as one motion of the mechanism, at the times that were asked for, or at all."""
    pieces = list(pieces)
    blocks: list[tuple[np.ndarray, ...]] = []
    for k, piece in enumerate(pieces):
        m = piece.motion
        keep = np.ones(m.t.size, bool) if grid is None else _near(m.t, grid)
        keep[0] &= k == 0
        keep[-1] |= piece.shown_end
        lam = modes.multipliers(piece.modes, m)
        blocks.append(tuple(x[keep] for x in (m.t, m.q, m.v, m.a, m.z, lam, m.inputs)))
    t, q, v, a, z, lam, u = (np.concatenate(part) for part in zip(*blocks, strict=True))
    first = pieces[0].motion.statistics
    statistics = Statistics(
        first.method,
        "stick and slip: " + first.formulation,
        sum(piece.motion.statistics.seconds for piece in pieces),
        sum(piece.motion.statistics.restarts for piece in pieces),
        list(dict.fromkeys(note for piece in pieces for note in piece.motion.statistics.notes)),
    )
    return Trajectory(
        modes.mechanism,
        t,
        q,
        v,
        a,
        z,
        lam,
        u,
        pieces[0].motion.parameters,
        events=events,
        statistics=statistics,
        refine=lambda t, q, v, z, u: _refined(modes, pieces, t, q, v, u),
    )


def _refined(
    modes: ModesOfFriction, pieces: Sequence[Piece], t: np.ndarray, q: np.ndarray, v: np.ndarray, u: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Interpolated states on the constraints of the piece that each belongs to."""
    starts = np.array([piece.motion.t[0] for piece in pieces])
    which = np.clip(np.searchsorted(starts, t, side="right") - 1, 0, len(starts) - 1)
    lam = np.zeros((t.size, equations(modes.mechanism).lam.numel()))
    q, v, a, u = q.copy(), v.copy(), np.zeros_like(q), u.copy()
    for k in np.unique(which):
        piece, mask = pieces[k], which == k
        part = piece.motion.at(np.clip(t[mask], piece.motion.t[0], piece.motion.t[-1]))
        q[mask], v[mask], a[mask], u[mask] = part.q, part.v, part.a, part.inputs
        lam[mask] = modes.multipliers(piece.modes, part)
    return q, v, a, lam, u


def _near(times: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Which of some times are those of a grid."""
    tiny = 1e-12 * (grid[-1] - grid[0]) if grid.size > 1 else 0.0
    after = np.clip(np.searchsorted(grid, times), 0, grid.size - 1)
    return np.minimum(np.abs(grid[after] - times), np.abs(grid[np.maximum(after - 1, 0)] - times)) <= tiny
