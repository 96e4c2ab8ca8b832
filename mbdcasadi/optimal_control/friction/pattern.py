"""What is open, sticks and slides when, read off a motion with friction and contact as forces within their limits."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from ...model.forces.friction.modes import Senses
from ...model.sites import Site
from ..motion.phase_solution import PhaseSolution
from ..solution import Solution
from ..statement.sites import Relaxation, gap_of

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
    """Modes by site and interval: one is open, or slides, if that misses its law by a smaller share than the other."""
    result, whole = list[list[str]](), relaxation.replaced
    for site in relaxation.sites:
        senses = np.full(part.mesh.count, "closed" if site.law is None else "sticks", object)
        if site.law is not None:
            speed = _sampled(part, site.sliding_speed)
            typical = part.program.sizes.of_changes([site.sliding_speed])[0]
            fastest = max(float(np.max(np.abs(speed))), CREEP * float(typical))
            sign = np.sign(speed.mean(axis=1))
            missing: Any = CREEP
            if forces:
                limit, acting = (_sampled(part, e) for e in (whole.limit(site), whole.friction[site]))
                peers = [whole.limit(other) for other in relaxation.sites if other.element is site.element]
                largest = max(*(float(np.max(_sampled(part, peer))) for peer in peers), np.finfo(float).tiny)
                missing = np.max(limit + sign[:, None] * acting, axis=1) / (2 * largest)
            slides = np.max(np.abs(speed), axis=1) / fastest > missing
            senses[slides] = np.where(sign > 0, "forth", "back")[slides]
        if site.place is not None:
            senses[_is_open(part, site, relaxation, forces)] = "open"
        result.append(senses.tolist())
    return result


def _is_open(part: PhaseSolution, site: Site, relaxation: Relaxation, forces: bool) -> np.ndarray:
    """Intervals in which a place is open: its gap is a larger share of the largest one than its force of the mean.

    Of several places of a contact, the mean of that which bears most counts. Of one that never closes, what is left of
    the force is no mean to compare with: a typical force stands below.
    """
    gap = np.max(np.abs(_sampled(part, gap_of(site))), axis=1)
    largest = max(float(np.max(gap)), CREEP * float(part.program.sizes.of_changes([gap_of(site)])[0]))
    pressed: Any = CREEP
    if forces:
        lengths, normal = np.diff(part.mesh_times), relaxation.replaced.normal
        courses = {s: _sampled(part, f).mean(axis=1) for s, f in normal.items() if s.element is site.element}
        means = [float(force @ lengths) / float(np.sum(lengths)) for force in courses.values()]
        typical = float(part.program.sizes.of_changes([normal[site]])[0])
        pressed = np.maximum(courses[site] / max(*means, CREEP * typical), CREEP)
    is_open: np.ndarray = gap / largest > pressed
    return is_open


def _sampled(part: PhaseSolution, expression: ca.SX) -> np.ndarray:
    """Values of an expression at points of the intervals (N, k)."""
    count = part.mesh.count
    k, tau = np.repeat(np.arange(count), POINTS.size), np.tile(POINTS, count)
    (values,) = part.by_polynomials([ca.SX(expression)], k, tau)
    return values.reshape(count, POINTS.size)


def with_rests(pieces: Sequence[Piece], solution: Solution, relaxation: Relaxation) -> list[Piece]:
    """Return the pieces with a rest at each end of one at which what slides is at rest, or a contact is touched.

    A rest takes a quarter of its piece.
    """
    motion, sites = solution.trajectory, relaxation.sites
    slides = {k: site.sliding_speed for k, site in enumerate(sites) if site.law is not None}
    gaps = {k: gap_of(site) for k, site in enumerate(sites) if site.place is not None}
    result: list[Piece] = []
    for k, piece in enumerate(pieces):
        ends = motion.at(np.array([piece.begin, piece.end]))
        slow, near = (
            {n: np.abs(ends[e]) <= CREEP * float(np.max(np.abs(motion[e]))) for n, e in of.items()}
            for of in (slides, gaps)
        )
        before, after = (pieces[n] if 0 <= n < len(pieces) else None for n in (k - 1, k + 1))
        rests = [
            tuple(
                _at_rest(
                    mode,
                    None if beside is None else beside.senses[n],
                    still=bool(slow[n][end]) if n in slow else False,
                    touches=mode == "open" and bool(near[n][end]),
                    sticky=sites[n].law is not None,
                )
                for n, mode in enumerate(piece.senses)
            )
            for end, beside in enumerate((before, after))
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


def _at_rest(mode: str, beside: str | None, *, still: bool, touches: bool, sticky: bool) -> str:
    """Mode at rest, at an end of a piece beside another one, of what slides and is still or turns, or just touches."""
    if touches:
        return "sticks" if sticky and still else mode if sticky else "closed"
    turns = {mode, beside} == {"forth", "back"}
    return "sticks" if mode in ("forth", "back") and (still or turns) else mode


def without_flights(pieces: Sequence[Piece], relaxation: Relaxation) -> list[Piece]:
    """Return the pieces with each contact closed from its first force to its last.

    What is open between has the mode before it.
    """
    columns = []
    for site, modes in zip(relaxation.sites, zip(*[piece.senses for piece in pieces], strict=True), strict=True):
        column = list(modes)
        closed = [k for k, mode in enumerate(column) if mode != "open"] if site.place is not None else []
        for k in range(closed[0] + 1, closed[-1]) if closed else ():
            column[k] = column[k - 1] if column[k] == "open" else column[k]
        columns.append(column)
    return joined([replace(piece, senses=tuple(modes)) for piece, *modes in zip(pieces, *columns, strict=True)], 0.0)


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
