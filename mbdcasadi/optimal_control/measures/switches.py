"""Switches: times from which on other limits hold a motion back, at mesh points that move.

An interval in which an input jumps from one limit to the other has a polynomial with the right mean; its motion is
that of no input with a jump, and takes a little longer. A mesh point takes its place, from which on another arc begins:
a stretch with the same limits. Inputs that are continuous cannot jump there; the ends of
the interval move instead, until it has shrunk to almost nothing. A peak at the start or the end, which lasts for a part
of the first or last interval, first gets a mesh point that does not move, at the place by its mean: a point that moves
would be led astray by the intervals beside it.

Others may have a kink, whose place hardly counts for the cost: points that move there are led astray. It is found by
the courses of the inputs, see :mod:`kinks`; so are those at limits of positions, which are looked at by their inputs
alone, see :mod:`input_error`.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from ...numerics.real import stretches
from ..motion.limits import activity
from ..motion.phase_solution import PhaseSolution
from ..motion.solved_motion import SolvedMotion
from ..statement.phase import BEYOND_STATES
from ..transcription.mesh import Mesh
from ..transcription.rows import RowName
from .measure import Measure
from .stretch_weight import StretchWeights

#: Scaled slack below which a limit counts as active, whatever its multiplier: on long arcs both may be small.
SLACK = 3e-4
#: Share of the points of an interval from which on a limit that inputs do not carry alone holds the motion back there:
#: a course that is led along it by as many points as it has unknowns may be free at others. In an interval beside such
#: ones the smaller share does.
ALONG, BESIDE = 0.5, 0.25
#: Share of an interval of the mesh before below which a mesh point is too near to a switch.
TOO_NEAR = 0.3
#: Share of the range of an input from which on it jumps within an interval; else it has a kink there.
JUMP = 0.02
#: Largest number of intervals beside a short peak that are led astray by it.
ASTRAY = 4
#: Shares of an interval between which a switch in it is sought.
INSIDE = (0.05, 0.95)


class Arc(NamedTuple):
    """Intervals that follow each other under the same limits."""

    first: int
    #: behind the last one
    end: int
    #: for each limit, whether it is active; None if limits begin or cease to be active in these intervals
    active: tuple[bool, ...] | None


class Switch(NamedTuple):
    """A stretch of a mesh in which limits begin or cease to be active."""

    #: mesh points that enclose it
    points: tuple[int, ...]
    intervals: tuple[int, ...]
    #: time at which it begins, s
    time: float


class UnresolvedSwitches(Measure):
    """Switches that the mesh does not resolve: points beside them move, and at last their intervals are split.

    The cost is wrong by about the square of the length of an interval in which an input jumps, as a share of the
    duration, or by more if states change by much there, see :mod:`stretch_weight`: above the tolerance it is not
    resolved. Inputs that are constant on intervals, those of a digital controller, jump when it lets them.
    """

    def __init__(self, solution: SolvedMotion, tolerance: float):
        self._shares, self._weights = shares_of(solution), StretchWeights(solution)
        self.switches: list[list[Switch]] = [[] for _ in solution.phases]
        self._arcs: list[list[Arc]] = [[] for _ in solution.phases]
        super().__init__(solution, tolerance)

    def of(self, part: PhaseSolution) -> np.ndarray:
        """Infinite in intervals of a switch, zero in others (N,)."""
        number, errors = part.program.number, np.zeros(part.mesh.count)
        arcs = self._arcs[number] = arcs_of(part, self._shares)
        for switch in kinks_and_jumps(part, arcs)[1]:
            if self._weights.of(part, switch.intervals) > self._shortest:
                self.switches[number].append(switch)
                errors[list(switch.intervals)] = np.inf
        return errors

    def order(self, part: PhaseSolution) -> int:
        """One: the time of a switch."""
        return 1

    def sentences(self) -> list[str]:
        """Times at which limits change."""
        return [f"the switching time t = {switch.time:.6g} s of active limits" for of in self.switches for switch in of]

    @property
    def moves(self) -> bool:
        """True if there are switches."""
        return any(self.switches)

    @property
    def needs_limits(self) -> bool:
        """True if limits of positions are active, which a motion passes on its way to the next point."""
        return any(np.any(_held_positions(part, self._shares)) for part in self.solution.phases if part.mesh.count)

    @property
    def loss(self) -> float:
        """Squares of the weights of the switches."""
        parts = zip(self.solution.phases, self.switches, strict=True)
        return sum(self._weights.of(part, switch.intervals) ** 2 for part, of in parts for switch in of)

    @property
    def _shortest(self) -> float:
        """Weight of a stretch from which on it must not contain a switch."""
        return float(np.sqrt(self.tolerance))

    def placed(self, part: PhaseSolution, mesh: Mesh) -> Mesh:
        """The mesh of a phase with a point that moves at each switch."""
        if not self.switches[part.program.number]:
            return mesh
        if part.program.scheme.inputs.joined:
            return part.mesh.with_moving(k for switch in self.switches[part.program.number] for k in switch.points)
        number = part.program.number
        held = _held_positions(part, self._shares)
        knots, fixed = _knots(part, self._arcs[number], self._weights, self._shortest, held)
        if not np.any(held) and not fixed and not len(np.setdiff1d(knots, part.mesh_times)):  # kinks alone
            return part.mesh.with_moving(k for switch in self.switches[number] for k in switch.points)
        moving, points = (np.interp(times, part.mesh_times, part.mesh.positions) for times in (knots, fixed))
        return part.mesh.through_points(points, TOO_NEAR, moving)


def shares_of(solution: SolvedMotion) -> dict[tuple[int, RowName], np.ndarray]:
    """Shares of the points of each interval at which limits are active; none for inputs that are constant on them."""
    return {} if solution.settings.control == "constant" else activity(solution, SLACK, inside=True)


def arcs_of(part: PhaseSolution, shares: Mapping[tuple[int, RowName], np.ndarray]) -> list[Arc]:
    """Arcs of a phase in order, none across a waypoint, from the shares of :func:`shares_of`."""
    number, count = part.program.number, part.mesh.count
    limits = {limit.label: limit for limit in part.program.limits_at_points}
    along, mixed = np.zeros((0, count), bool), np.zeros(count, bool)
    for (phase, name), share in shares.items():
        limit = limits.get(name.owner)
        if phase != number or (limit is not None and not limit.depends_on("velocity", "state", *BEYOND_STATES)):
            continue
        along = np.vstack([along, _along(share)])
        if limit is None:
            mixed |= (share > 0) & (share < 1)
    segment = np.searchsorted(part.mesh.waypoints, np.arange(count), side="right")
    keys = [(segment[k], None if mixed[k] else tuple(along[:, k].tolist())) for k in range(count)]
    arcs = []
    for (_, active), group in itertools.groupby(range(count), key=lambda k: keys[k]):
        run = list(group)
        arcs.append(Arc(run[0], run[-1] + 1, active))
    return arcs


def _held_positions(part: PhaseSolution, shares: Mapping[tuple[int, RowName], np.ndarray]) -> np.ndarray:
    """Intervals in which limits of positions are active (N,)."""
    positions = {
        x.label for x in part.program.limits_at_points if not x.depends_on("velocity", "state", *BEYOND_STATES)
    }
    held = np.zeros(part.mesh.count, bool)
    for (phase, name), share in shares.items():
        if phase == part.program.number and name.owner in positions:
            held |= share > 0
    return held


def jumps_of(part: PhaseSolution, arcs: list[Arc]) -> list[int]:
    """Mesh points that are as good as ones that move: between unlike arcs, one alone beside a point that moves."""
    mesh = part.mesh
    between = _edges(arcs)
    inside = [k for k in between if k not in mesh.knots]
    moves = [bool({*mesh.knots[[p, p + 1]].tolist()} & set(mesh.free)) for p in range(mesh.knots.size - 1)]
    pieces = [int(mesh.piece[k]) for k in inside]
    return [k for k, piece in zip(inside, pieces, strict=True) if moves[piece] and pieces.count(piece) == 1]


def _edges(arcs: list[Arc]) -> list[int]:
    """Mesh points between unlike arcs."""
    return [b.first for a, b in itertools.pairwise(arcs) if None not in (a.active, b.active)]


def known_switches(part: PhaseSolution, arcs: list[Arc]) -> list[int]:
    """Mesh points at switches that are found: between unlike arcs, and they move or are as good as ones that do."""
    return sorted({*_edges(arcs)} & {*part.mesh.knots.tolist(), *jumps_of(part, arcs)})


def _along(share: np.ndarray) -> np.ndarray:
    """Intervals along which a limit holds the motion back, from the shares of points at which it is active (N,)."""
    along = share >= ALONG
    for run in stretches(share >= BESIDE):
        along[run] = np.any(along[run])
    return along


def kinks_and_jumps(part: PhaseSolution, arcs: list[Arc]) -> tuple[list[Switch], list[Switch]]:
    """Return switches at which inputs do not jump, though they may, and others."""
    kinks, jumps = list[Switch](), list[Switch]()
    for switch in _switches(part, arcs):
        (kinks if _is_kink(part, switch.points[0], switch.points[-1]) else jumps).append(switch)
    return kinks, jumps


def _switches(part: PhaseSolution, arcs: list[Arc]) -> list[Switch]:
    """Switches of a phase: arcs in which limits change, and mesh points between unlike arcs that do not move."""
    times, known = part.mesh_times, {*part.mesh.knots.tolist(), *jumps_of(part, arcs)}
    switches = [
        Switch((arc.first, arc.end), tuple(range(arc.first, arc.end)), float(times[arc.first]))
        for arc in arcs
        if arc.active is None
    ]
    for before, after in itertools.pairwise(arcs):
        k = after.first
        if None not in (before.active, after.active) and k not in known:
            switches.append(Switch((k,), (k - 1, k), float(times[k])))
    return switches


def _knots(
    part: PhaseSolution, arcs: list[Arc], weights: StretchWeights, shortest: float, held: np.ndarray
) -> tuple[list[float], list[float]]:
    """Times of the switches between arcs, s, at mesh points that move, and at others that do not yet.

    Arcs whose weight is no more than the `shortest` one do not count.
    """
    knots, fixed = list[float](), list[float]()

    def weight(first: int, last: int) -> float:
        return weights.of(part, range(first, last))

    lasting = [arc for arc in arcs if arc.active is not None and weight(arc.first, arc.end) > shortest]
    for begin, end in itertools.pairwise([0, *part.mesh.waypoints.tolist(), part.mesh.count]):
        here = [arc for arc in lasting if begin <= arc.first < end]
        edge = [Arc(begin, begin, None), *here, Arc(end, end, None)]
        for before, after in itertools.pairwise(edge):
            first, last = before.end, after.first
            is_short, place = weight(first, last) <= shortest, None
            if (before.active is None) != (after.active is None) and not np.any(held[max(first - 1, 0) : last + 1]):
                reach = after.end - last if before.active is None else before.first - first
                place = _place_at_end(part, first, last, reach)
            if place is None:
                knots += _between(part, before, after, is_short, held)
            elif not is_short:
                (knots if place in part.mesh_times[[first, last]] else fixed).append(place)
    return knots, fixed


def _between(part: PhaseSolution, before: Arc, after: Arc, is_short: bool, held: np.ndarray) -> list[float]:
    """Times of the switches between two arcs with perhaps others between them, s.

    `before` and `after` are without limits at the ends of a segment. Where limits of positions are `held`, both ends of
    an interval move.
    """
    times, first, last = part.mesh_times, before.end, after.first
    ends = [k for k, arc in ((first, before), (last, after)) if arc.active is not None]
    if (before.active == after.active and is_short) or (len(ends) == 2 and _is_kink(part, first, last)):
        return []
    if first == last:
        return [float(times[first])] if len(ends) == 2 else []
    is_one = len(ends) == 2 and before.active != after.active and (is_short or last == first + 1)
    place = _place_around(part, first, last) if is_one else None
    if place is None or np.any(held[max(first - 1, 0) : last + 1]):
        return [float(times[k]) for k in ends]
    # a mesh point that moved to an end of the interval did not suffice
    known = [float(times[k]) for k in ends if k in part.mesh.free]
    return sorted([*known, float(times[first] + times[last]) / 2]) if known else [place]


def _is_kink(part: PhaseSolution, first: int, last: int) -> bool:
    """True if inputs that may jump between two mesh points, or at one, do not."""
    if first == last:
        first, last = first - 1, last + 1
    if part.program.scheme.inputs.joined or first < 1 or last >= part.mesh.count or last - first > 2:
        return False
    return _place_around(part, first, last) is None


def _place_around(part: PhaseSolution, first: int, last: int) -> float | None:
    """Place by :func:`_place`, or by the intervals further away: a jump leads those beside it astray."""
    place = _place(part, first, last)
    return _place(part, max(first - 1, 1), min(last + 1, part.mesh.count - 1)) if place is None else place


def _place_at_end(part: PhaseSolution, first: int, last: int, reach: int) -> float | None:
    """Time at which inputs jump between an end of a segment and the arc beside it, s; None if none does.

    The stretch from mesh point `first` to `last` is at an end of a segment. The arc beside it is `reach` intervals
    long, and lies before it if that is negative. The place is that with the right mean of the input that jumps most,
    from its value at the end of the segment and one on the arc further away; that of the arc if it is near.
    """
    times, lengths = part.mesh_times, np.diff(part.mesh_times)
    if first == last:
        return None
    is_start, share, largest = reach > 0, np.nan, JUMP
    low, high = (first, last + min(reach // 2, ASTRAY)) if is_start else (first - min(-reach // 2, ASTRAY), last)
    if not (high < part.mesh.count if is_start else low > 0):
        return None
    for symbol, course in part.polynomials.free_inputs.items():
        c, powers = course.coefficients, np.arange(course.terms)
        if is_start:
            outer, inner = float(c[first, 0]), float(c[high, 0])
        else:
            outer, inner = (float(c[k - 1] @ lengths[k - 1] ** powers) for k in (last, low))
        excess = sum(
            float(c[k] @ (lengths[k] ** (powers + 1) / (powers + 1))) - inner * lengths[k] for k in range(low, high)
        )
        span = min(symbol.upper - symbol.lower, 2 * float(np.max(np.abs(c[:, 0]))))
        if abs(inner - outer) / span > largest:
            largest, share = abs(inner - outer) / span, excess / (outer - inner) / (times[last] - times[first])
    if not np.isfinite(share):
        return None
    if share >= INSIDE[1]:
        return float(times[last] if is_start else times[first])
    past = float(max(share, INSIDE[0]) * (times[last] - times[first]))
    return float(times[first]) + past if is_start else float(times[last]) - past


def _place(part: PhaseSolution, first: int, last: int) -> float | None:
    """Time between two mesh points at which inputs jump, by the mean of the one that jumps most, s; None if none does.

    It has a kink and does not jump if its courses before and after meet in between.
    """
    times, lengths = part.mesh_times, np.diff(part.mesh_times)
    share, largest, between = np.nan, JUMP, float(times[last] - times[first])
    for symbol, course in part.polynomials.free_inputs.items():
        c, powers = course.coefficients, np.arange(course.terms)
        earlier, later = float(c[first - 1] @ lengths[first - 1] ** powers), float(c[last, 0])
        slope = float(c[first - 1, 1:] @ (powers[1:] * lengths[first - 1] ** powers[:-1]))
        gaps = np.array([later - float(c[last, 1:2].sum()) * between - earlier, later - earlier - slope * between])
        mean = sum(float(c[k] @ (lengths[k] ** (powers + 1) / (powers + 1))) for k in range(first, last)) / between
        span = min(symbol.upper - symbol.lower, 2 * float(np.max(np.abs(c[:, 0]))))
        size = float(np.min(np.abs(gaps))) / span if np.prod(gaps) > 0 else 0.0
        if size > largest:
            largest, share = size, (later - mean) / (later - earlier)
    place = times[first] + np.clip(share, *INSIDE) * between
    return float(place) if np.isfinite(place) else None
