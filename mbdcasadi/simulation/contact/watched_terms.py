"""Quantities of the elements that are watched along a run, as functions that elements of one kind share."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import Any

import casadi as ca
import numpy as np

from ...equations import Equations
from ...equations.batches import Batch, Values, batches_of
from ...model.mechanism import Mechanism
from ...model.validity import Smoothing
from ...numerics.lazy import cached_property

#: Parts of the expressions of an element.
DISPLACEMENTS, FORCES, COURSES, SCALES, GAP, MARGINS, REPORTED, APART = range(8)
#: Depth, m, below which touching outlines count as apart: rounding and the tolerances of positions. A long step over a
#: contact whose last stage touches it by rounding has not found it closed.
SHALLOW = 1e-9


def has_gap(element: Any) -> bool:
    """True if an element is a contact, a stop or a rope."""
    return getattr(element, "watched_gaps", None) is not None and bool(element.smoothings)


def least_gap(element: Any) -> ca.SX:
    """Return the gap of an element that has one or several, m."""
    return ca.mmin(ca.vec(ca.SX(element.watched_gaps)))


def has_gaps(mechanism: Mechanism) -> bool:
    """True if a mechanism has contacts or stops, which an integrator may jump over."""
    return any(has_gap(element) for element in mechanism.elements)


class WatchedTerms:
    """Smoothed quantities, gaps and validity conditions of a mechanism; made once for it.

    Attributes
    ----------
    elements, smoothings, smoothed, owners, validity : list
        Elements that are watched, smoothed quantities and the element of each (elements that are alike share those of
        the first), elements with gaps, and conditions between outputs too.
    normal : list of int
        Place among the smoothings of the normal force of each owner.
    gap_of : list of int or None
        Place among the owners of the element of each smoothing.
    spans, is_load : numpy.ndarray
        Span of each smoothing, and if it is that of a load.
    values : Values
        Places of the symbols in the column that the functions take.
    batches : list of Batch
        Elements of one kind.
    rate_functions : list of casadi.Function
        Rates of each batch.
    size : int
        Number of the rates that an integrator is to integrate along.
    """

    def __init__(self, eom: Equations):
        self.eom, self.values = eom, Values(eom)
        self._unknown = ca.vertcat(eom.a, eom.lam, eom.u)
        self._first_alike: dict[Hashable, Any] = {}
        everything = [(e, self._smoothings_of(self._alike(e)), _conditions(e)) for e in eom.mechanism.elements]
        self._offered = {
            e: (smoothings, conditions) for e, smoothings, conditions in everything if smoothings or conditions
        }
        self.elements = list(self._offered)
        of_smoothings = [(e, s) for e, (smoothings, _) in self._offered.items() for s in smoothings]
        self.smoothings: list[Smoothing] = [s for _, s in of_smoothings]
        self.smoothed = [e for e, _ in of_smoothings]
        self.owners = [e for e in self.elements if self._has_gap(self._alike(e))]
        place = {e: k for k, e in reversed(list(enumerate(self.smoothed)))}
        self.normal = [place[e] for e in self.owners]
        self.validity = [c for _, conditions in self._offered.values() for c in conditions]
        self.size = 2 * len(self.smoothings) + len(self.owners) + len(self.validity)
        self.batches = batches_of(eom, self.values, self.elements, self._parts)
        self.rate_functions = [self._rates_of(batch) for batch in self.batches]
        self._compiled: tuple[ca.Function, ca.Function] | None = None
        owner_places = {e: j for j, e in enumerate(self.owners)}
        self.gap_of = [owner_places.get(e) for e in self.smoothed]
        self.spans = np.array([s.span for s in self.smoothings])
        self.is_load = np.array([s.scale is not None for s in self.smoothings], dtype=bool)

    def use_compiled(self, gaps: ca.Function, courses: ca.Function) -> None:
        """Take functions of a column of values: gaps, rates and bounds, and smoothed quantities and their scales."""
        self._compiled = gaps, courses

    # --- the expressions of an element ------------------------------------------------------
    def _alike(self, element: Any) -> Any:
        """The first element with the same expressions, in the coordinates of its bodies."""
        likeness = getattr(element, "likeness_of_expressions", None)
        return element if likeness is None else self._first_alike.setdefault(likeness, element)

    def _smoothings_of(self, element: Any) -> list[Smoothing]:
        offered = getattr(element, "smoothings", ())
        return [s for s in offered if not ca.depends_on(s.expression, self._unknown)]

    def _has_gap(self, element: Any) -> bool:
        return has_gap(element) and not ca.depends_on(least_gap(element), self._unknown)

    def _parts(self, element: Any) -> list[ca.SX]:
        """Expressions of an element, in the order of their numbers."""
        smoothings, conditions = self._offered[element]
        has_gap = self._has_gap(element)
        columns: Sequence[Sequence[Any]] = (
            [ca.vec(ca.SX(d)) for d, _ in element.virtual_work],
            [ca.vec(ca.SX(f)) for _, f in element.virtual_work],
            [s.expression for s in smoothings],
            [1 if s.scale is None else s.scale for s in smoothings],
            [least_gap(element)] if has_gap else [],
            [c.expression for c in conditions],
            [c.reported for c in conditions],
            [] if not has_gap or element.watched_clearance is None else [element.watched_clearance],
        )
        return [ca.vertcat(ca.SX(0, 1), *column) for column in columns]

    # --- rates that are integrated along ------------------------------------------------------
    def _rates_of(self, batch: Batch) -> ca.Function:
        """Rates of a batch: slopes of smoothed quantities and their scales, closed gaps, and excesses over limits."""
        parts = batch.parts
        # while a condition is broken, the integral of its speed is twice the excess
        excess = ca.if_else(parts[MARGINS] < 0, ca.fabs(batch.rate(parts[REPORTED])), 0)
        closed = parts[GAP]
        if closed.numel():  # what is closed without a load, as outlines that part fast, leaves no trace in the motion
            closed = ca.if_else(ca.logic_and(closed < -SHALLOW, parts[COURSES][0] != 0), 1.0, 0.0)
        rates = ca.vertcat(batch.rate(parts[COURSES]), ca.fabs(batch.rate(parts[SCALES])), closed, excess)
        return batch.function("rates", rates)

    @cached_property
    def rate_places(self) -> list[np.ndarray]:
        """Places of the rates of each batch among all of them (n, rows)."""
        smoothings, owners = len(self.smoothings), len(self.owners)
        return [
            np.hstack([s, smoothings + s, 2 * smoothings + g, 2 * smoothings + owners + c])
            for s, g, c in zip(*(self.numbered(part) for part in (COURSES, GAP, MARGINS)), strict=True)
        ]

    def numbered(self, part: int) -> list[np.ndarray]:
        """Numbers of the entries of a part among those of all elements, by batch (n, rows)."""
        counts = np.zeros(len(self.elements), int)
        for batch in self.batches:
            counts[batch.numbers] = batch.parts[part].numel()
        starts = np.cumsum(counts) - counts
        return [starts[b.numbers][:, None] + np.arange(b.parts[part].numel()) for b in self.batches]

    @cached_property
    def rates(self) -> ca.SX:
        """All rates as expressions (size,)."""
        return self._expressions(self.rate_functions, self.rate_places, self.size, self.eom.z_rate)

    def _expressions(self, functions: list[ca.Function], places: list[np.ndarray], size: int, z_rate: ca.SX) -> ca.SX:
        """Results of functions of the batches as expressions (size,), at their places (n, rows)."""
        column = self.values.column(*self.eom.symbols, z_rate=z_rate)
        entries = [ca.SX(0)] * size
        for batch, function, own_places in zip(self.batches, functions, places, strict=True):
            for result, own in zip(batch.expanded(function, column), own_places, strict=True):
                for place, entry in zip(own, ca.vertsplit(result), strict=True):
                    entries[int(place)] = entry
        return ca.vertcat(ca.SX(0, 1), *entries)

    # --- values at outputs ----------------------------------------------------------------------
    def table(self, times: np.ndarray, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Values at some states (size, k)."""
        n = self.eom.q.numel()
        q, v, z = x[:, :n], x[:, n : 2 * n], x[:, 2 * n :]
        rates = None
        if self._state_rates is not None:
            rates = self._state_rates(times[None, :], q.T, v.T, z.T, p).full().T
        return self.values.table(times, q, v, z, p, rates)

    @cached_property
    def _state_rates(self) -> ca.Function | None:
        """Rates of the first-order states; None if there are none, or if they depend on more than states."""
        eom = self.eom
        if not eom.z.numel() or ca.depends_on(eom.z_rate, self._unknown):
            return None
        return ca.Function("state_rates", [eom.t, eom.q, eom.v, eom.z, eom.p], [ca.densify(eom.z_rate)])

    def _collected(self, functions: list[ca.Function], part: int, copies: int, table: np.ndarray) -> np.ndarray:
        """Results of functions of the batches at the columns of a table (k, copies x entries of a part)."""
        places = self.numbered(part)
        total = sum(own.size for own in places)
        collected = np.zeros((table.shape[1], copies * total))
        for batch, function, own in zip(self.batches, functions, places, strict=True):
            if own.size:
                into = np.hstack([own + copy * total for copy in range(copies)])
                collected[:, into] = batch.evaluated(function, table).transpose(2, 0, 1)
        return collected

    @cached_property
    def course_functions(self) -> list[ca.Function]:
        """Smoothed quantities of each batch, and their scales."""
        return [b.function("courses", ca.vertcat(b.parts[COURSES], b.parts[SCALES])) for b in self.batches]

    @cached_property
    def _limits(self) -> list[ca.Function]:
        return [b.function("limits", b.parts[REPORTED] + b.parts[MARGINS]) for b in self.batches]

    def courses(self, table: np.ndarray, gaps: np.ndarray) -> np.ndarray:
        """Smoothed quantities and their scales at the columns of a table (k, 2 x smoothings).

        Parameters
        ----------
        gaps : numpy.ndarray
            Gaps there (k, owners); elements with a test for being apart have no forces while these are open.
        """
        if self._compiled is not None:
            return np.array(self._compiled[1](table).full().T)
        courses = np.zeros((table.shape[1], 2 * len(self.smoothings)))
        batches = zip(self.batches, self.course_functions, self.numbered(COURSES), self.numbered(GAP), strict=True)
        for batch, function, numbers, owners in batches:
            into = np.hstack([numbers, numbers + len(self.smoothings)])
            if not numbers.size:
                continue
            if not batch.parts[APART].numel():
                courses[:, into] = batch.evaluated(function, table).transpose(2, 0, 1)
                continue
            moments, elements = np.nonzero(gaps[:, owners[:, 0]] < 0)
            if moments.size:
                values = batch.evaluated(function, table[:, moments], elements)[0]
                courses[moments[:, None], into[elements]] = values.T
        return courses

    def at_limit(self, table: np.ndarray) -> np.ndarray:
        """Values that the conditions limit, at the columns of a table (k, conditions)."""
        return self._collected(self._limits, MARGINS, 1, table)

    # --- gaps -------------------------------------------------------------------------------------
    @cached_property
    def bounded_gaps(self) -> list[ca.Function]:
        """Gaps of each batch, their rates and bounds of these."""
        return [
            b.function("gaps", ca.vertcat(b.parts[GAP], b.rate(b.parts[GAP]), self._bound(b))) for b in self.batches
        ]

    @property
    def gap_places(self) -> list[np.ndarray]:
        """Places of the gaps, rates and bounds of each batch among those of all owners (n, 3)."""
        count = len(self.owners)
        return [np.hstack([own, own + count, own + 2 * count]) for own in self.numbered(GAP)]

    @property
    def gap_expressions(self) -> ca.SX:
        """Gaps, their rates and bounds of these as expressions (3 owners,)."""
        # rates of states that depend on accelerations are left out, as at outputs
        rates = ca.SX.zeros(self.eom.z.numel()) if self._state_rates is None else self.eom.z_rate
        return self._expressions(self.bounded_gaps, self.gap_places, 3 * len(self.owners), rates)

    def _bound(self, batch: Batch) -> ca.SX:
        """Bounds of the rates of gaps whatever direction the velocities have: the normals may turn between outputs.

        So may lever arms: of an angle slope and curvature count, which together are the arm in any pose.
        """
        gap = batch.parts[GAP]
        if not gap.numel():
            return gap
        slopes = ca.jacobian(gap, batch.symbols)
        bound = sum((ca.fabs(slopes[:, k]) for k in batch.of_groups("t")), ca.SX.zeros(gap.numel()))
        together: dict[tuple[int, bool], list[int]] = {}
        bodies = self.values.bodies(batch.places[0].tolist())
        for k in batch.of_groups("q"):
            first, which = bodies[k]
            is_angle = which not in (0, 1)
            together.setdefault((k if is_angle else first, is_angle), []).append(k)
        for (_, is_angle), indices in together.items():
            squares = ca.sum2(slopes[:, indices] ** 2)
            if is_angle:
                squares += ca.jacobian(slopes[:, indices], batch.symbols[indices]) ** 2
            bound += ca.sqrt(squares) * ca.sqrt(ca.sumsqr(batch.rates[indices]))
        return bound

    def gaps(self, table: np.ndarray, owners: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Gaps, their rates and bounds of these at the columns of a table, each (k, owners).

        Parameters
        ----------
        owners : numpy.ndarray of int, optional
            One for each column, then each (k,).
        """
        if owners is None:
            if self._compiled is not None:
                stacked = np.array(self._compiled[0](table).full().T)
            else:
                stacked = self._collected(self.bounded_gaps, GAP, 3, table)
            gaps, rates, bounds = np.split(stacked, 3, axis=1)
            return gaps, rates, bounds
        single = np.zeros((3, owners.size))
        for number, (batch, function) in enumerate(zip(self.batches, self.bounded_gaps, strict=True)):
            columns = np.flatnonzero(self._owner_places[0][owners] == number)
            if columns.size:
                elements = self._owner_places[1][owners[columns]]
                single[:, columns] = batch.evaluated(function, table[:, columns], elements)[0]
        return single[0], single[1], single[2]

    @cached_property
    def _owner_places(self) -> tuple[np.ndarray, np.ndarray]:
        """Batch of each owner, and its number in that (owners,)."""
        which, row = np.zeros(len(self.owners), int), np.zeros(len(self.owners), int)
        for number, own in enumerate(self.numbered(GAP)):
            if own.size:
                which[own[:, 0]], row[own[:, 0]] = number, np.arange(len(own))
        return which, row

    @cached_property
    def _gradients(self) -> list[ca.Function]:
        return [b.function("gradient", ca.jacobian(b.parts[GAP], b.symbols).T) for b in self.batches]

    def gradient(self, owner: int, table: np.ndarray) -> np.ndarray:
        """Gradients of a gap by the coordinates at the columns of a table (k, n)."""
        number, row = (int(places[owner]) for places in self._owner_places)
        batch = self.batches[number]
        values = batch.evaluated(self._gradients[number], table, np.full(table.shape[1], row))[0]
        gradient = np.zeros((table.shape[1], self.eom.q.numel()))
        groups = batch.of_groups("q")
        gradient[:, self.values.coordinate(batch.places[row][groups])] = values[groups].T
        return gradient


def watched_terms(eom: Equations) -> WatchedTerms:
    """Return the watched terms of a mechanism; made once for it."""
    return eom.mechanism.cache.get_or_create("watched terms", lambda: WatchedTerms(eom))


def _conditions(element: Any) -> list[Any]:
    """Validity conditions of an element that hold between outputs too."""
    return [c for c in getattr(element, "validity_conditions", ()) if c.between_outputs]
