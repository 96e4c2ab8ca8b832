"""Which friction sticks and which slides when, read off a motion with friction as a force within its limits."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ...model.forces.friction.modes import Senses
from ..motion.phase_solution import PhaseSolution
from ..solution import Solution
from ..statement.dry_friction import Relaxation

#: Points of an interval at which speeds and forces are compared.
POINTS = np.linspace(0.0, 1.0, 5)
#: Speed, as a share of a typical one, below which a friction that never slides faster sticks all the time.
CREEP = 1e-3
#: Shortest phase of sticking or sliding, as a share of the duration: what is shorter is a passing rest.
SHORTEST = 1e-3


@dataclass(frozen=True)
class Piece:
    """Stretch of a motion in which no friction changes its mode: times, s, modes, and the waypoint at its end."""

    begin: float
    end: float
    senses: Senses
    #: index of the waypoint, or None
    waypoint: int | None = None

    @property
    def duration(self) -> float:
        """s."""
        return self.end - self.begin


def order_of(pieces: Sequence[Piece]) -> tuple[Any, ...]:
    """Return modes and waypoints in their order."""
    return tuple((piece.senses, piece.waypoint) for piece in pieces)


def pattern_of(solution: Solution, relaxation: Relaxation, *, forces: bool = True) -> list[Piece]:
    """Return the pieces of a motion, each with the modes of the frictions that its intervals come nearest to.

    Without `forces`, which a motion given as guess does not have, what moves slides.
    """
    (part,) = solution.phases
    senses = list(zip(*_senses(part, relaxation, forces), strict=True))
    waypoints = {int(point): k for k, point in enumerate(part.mesh.waypoints)}
    times, pieces = part.mesh_times, list[Piece]()
    for k, (begin, end) in enumerate(itertools.pairwise(times.tolist())):
        pieces.append(Piece(begin, end, senses[k], waypoints.get(k + 1)))
    return joined(pieces, SHORTEST * solution.duration)


def _senses(part: PhaseSolution, relaxation: Relaxation, forces: bool) -> list[list[str]]:
    """Modes by friction and interval: sliding if the speed is a larger share of its size than the missing force."""
    count, taus = part.mesh.count, POINTS
    k, tau = np.repeat(np.arange(count), taus.size), np.tile(taus, count)
    result = []
    for friction, force in relaxation.replaced.inputs.items():
        values = part.by_polynomials([friction.sliding_speed, friction.sticking_limit, force], k, tau)
        speed, limit, acting = (x.reshape(count, taus.size) for x in values)
        typical = part.program.sizes.of_changes([friction.sliding_speed])[0]
        fastest = max(float(np.max(np.abs(speed))), CREEP * float(typical))
        largest = max(float(np.max(limit)), np.finfo(float).tiny)
        sign = np.sign(speed.mean(axis=1))
        missing = np.max(limit + sign[:, None] * acting, axis=1) / (2 * largest)
        slides = np.max(np.abs(speed), axis=1) / fastest > (missing if forces else CREEP)
        result.append([("forth" if s > 0 else "back") if x else "sticks" for x, s in zip(slides, sign, strict=True)])
    return result


def with_rests(pieces: Sequence[Piece], solution: Solution, relaxation: Relaxation) -> list[Piece]:
    """Return the pieces with a rest at each end of one at which a friction that slides there is at rest.

    A rest takes a quarter of its piece.
    """
    motion = solution.trajectory
    frictions = tuple(relaxation.replaced.inputs)
    fastest = [CREEP * float(np.max(np.abs(motion[friction.sliding_speed]))) for friction in frictions]
    result: list[Piece] = []
    for k, piece in enumerate(pieces):
        ends = motion.at(np.array([piece.begin, piece.end]))
        speeds = np.column_stack([ends[friction.sliding_speed] for friction in frictions])
        before, after = (pieces[n] if 0 <= n < len(pieces) else None for n in (k - 1, k + 1))
        rests = [
            _stopped(piece.senses, still, None if beside is None else beside.senses)
            for still, beside in zip(np.abs(speeds) <= fastest, (before, after), strict=True)
        ]
        quarter = piece.duration / 4
        if rests[0] not in (piece.senses, None if before is None else before.senses):
            result.append(Piece(piece.begin, piece.begin + quarter, rests[0]))
            piece = replace(piece, begin=piece.begin + quarter)
        if rests[1] not in (piece.senses, None if after is None else after.senses):
            result.append(replace(piece, end=piece.end - quarter, waypoint=None))
            piece = replace(piece, begin=piece.end - quarter, senses=rests[1])
        result.append(piece)
    return joined(result, 0.0)


def _stopped(senses: Senses, still: np.ndarray, beside: Senses | None) -> Senses:
    """Modes in which what is still sticks, and what turns to those beside."""
    others = senses if beside is None else beside
    turning = [{one, other} == {"forth", "back"} for one, other in zip(senses, others, strict=True)]
    return tuple("sticks" if stops else sense for sense, stops in zip(senses, still | turning, strict=True))


def joined(pieces: Sequence[Piece], least: float, durations: Sequence[float] | None = None) -> list[Piece]:
    """Return pieces that last longer than the least duration, s, neighbours with the same modes as one.

    What is shorter becomes part of the piece before it, or of the one after it at the start and behind a waypoint.
    Durations, s, are those of the pieces, or others that count in their place.
    """
    kept: list[Piece] = []
    begin: float | None = None
    for piece, duration in zip(pieces, durations or [piece.duration for piece in pieces], strict=True):
        start = piece.begin if begin is None else begin
        begin = None
        before = kept[-1] if kept else None
        open_end = before is not None and before.waypoint is None
        if before is not None and open_end and (duration <= least or before.senses == piece.senses):
            kept[-1] = replace(before, end=piece.end, waypoint=piece.waypoint)
        elif duration <= least and piece.waypoint is None:
            begin = start
        else:
            kept.append(replace(piece, begin=start))
    if begin is not None and kept:
        kept[-1] = replace(kept[-1], end=pieces[-1].end)
    return kept
