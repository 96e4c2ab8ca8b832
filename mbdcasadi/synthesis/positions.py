"""The positions of a synthesis as residuals in poses and unknown parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ..assembly.setup import kept_numeric
from ..equations import equations
from ..equations.reduced import reduced_equations
from ..errors import ConditionError, ExpressionError, ModelError
from ..model.conditions import Condition, read_conditions
from ..model.mechanism import Mechanism
from ..model.symbols import Parameter, describe, place_of
from ..numerics.scattered import scattered
from ..numerics.symbolic import symbolic
from ..numerics.tolerances import RANK

#: Random dimensions at which it is seen whether the drawn pose closes the linkage whatever they are.
PROBES = 3
#: Weight of a gap of a joint beside what a relation misses, if these are met as nearly as can be: without it the
#: search follows linkages of endless bars that nearly close, with ten times it finds fewer that meet all.
CLOSING = 3.0


@dataclass(frozen=True, eq=False)
class Row:
    """A residual that belongs to a name, and its size by which it is measured (m, rad or the condition's own)."""

    name: str
    size: float


class Positions:
    """Closure of a linkage and relations at some positions.

    Each position k has a pose ``y_k``, in the coordinates that pins do not give, and residuals ``f_k(y_k, p)``: the
    rows that close the linkage and the relations. The first pose is the drawn one if it closes the linkage whatever
    the unknowns are, which are among its joints; its relations then are conditions on these.

    Parameters
    ----------
    mechanism : Mechanism
        The model, without drivers.
    unknowns : sequence of Parameter
        Unknown dimensions.
    positions : sequence of sequences of relations
        Relations that hold at each position.
    conditions : sequence of relations
        On the unknowns.
    exact : bool
        False if relations hold as nearly as can be.

    Attributes
    ----------
    p, y : casadi.SX
        Symbols of the unknowns (n,) and of a pose (k,).
    length : float
        Size of the drawn linkage or its distance from the positions, whichever is larger, m.
    fixed, limits : casadi.SX
        Residuals of equalities in the unknowns alone, and of limits, which are not positive.
    residuals : list of casadi.SX
        Residuals of each pose that is to be found, the rows that close the linkage first; divided by their sizes.
    fixed_rows, limit_rows : list of Row
        Names and sizes of these.
    rows : list of list of Row
        Of the residuals.
    twins : list of int
        Number of the first pose with the same relations as each one; -1 if that is the drawn one.
    spans : casadi.SX
        Distances of the joints of each body that depend on the unknowns.
    held : int
        Number of equalities that hold, however near the relations can be met: the first ones.
    """

    @symbolic
    def __init__(
        self,
        mechanism: Mechanism,
        unknowns: Sequence[Parameter],
        positions: Sequence[object],
        conditions: object,
        *,
        exact: bool,
    ):
        self.mechanism, self.unknowns = mechanism, tuple(unknowns)
        eom = self.eom = equations(mechanism)
        reduced = self.reduced = reduced_equations(eom)
        self.p, self.y = ca.vertcat(*unknowns), reduced.q
        self.drawn_values = np.array([mechanism.value_of(p, p.value) for p in unknowns])
        self.start = reduced.estimate
        #: True for coordinates that are angles
        self.turning = np.array([bool(eom.angles[k]) for k in reduced.independent])
        self.length = float(kept_numeric(eom, eom.parameter_values).scale.length)
        others = [x for x in mechanism.parameters if place_of(x, unknowns) is None]
        numbers = [mechanism.value_of(x, x.value) for x in others]
        self._known = ca.vertcat(ca.SX(0, 1), *others, eom.t), ca.DM([*numbers, 0.0])
        self.relations = [self._read(given, f"position {k}", poses=True) for k, given in enumerate(positions, start=1)]
        on_unknowns = self._read(conditions, "conditions=", poses=False)
        self.closing = self._with_known(reduced.Phi)
        self.q = self._with_known(reduced.of(eom.q)[0])
        turns = eom.angular_rows[reduced.position_rows] if reduced.rows else np.zeros(0, bool)
        self.length = max(self.length, self._reach())
        self.closing_rows = [
            Row(reduced.row_names[k], (1.0 if turn else self.length) / (1.0 if exact else CLOSING))
            for k, turn in zip(reduced.position_rows, turns, strict=True)
        ]
        self.drawn = self._closes_as_drawn()
        columns = [self._column(relations) for relations in self.relations]
        self.rows = [[*self.closing_rows, *self._relation_rows(k)] for k in range(len(columns))]
        at_drawn = self._at_drawn_pose(columns.pop(0)) if self.drawn else []
        if self.drawn:
            self.rows.pop(0)
        self.residuals = columns
        self.twins = self._twins()
        self.sizes = self._sizes_of_unknowns([*columns, ca.vertcat(ca.SX(0, 1), *[e for e, _ in at_drawn])])
        equal = [self._scaled_condition(c) for c in on_unknowns if c.equality]
        self.held = len(equal) + len(at_drawn) * exact
        limits = [self._scaled_condition(c) for c in on_unknowns if not c.equality]
        limits += [limit for k in range(len(self.unknowns)) for limit in self._bounds(k)]
        self.spans = self._spans()
        self.fixed, self.fixed_rows = _split([*at_drawn, *equal] if exact else [*equal, *at_drawn])
        self.limits, self.limit_rows = _split(limits)

    # --- reading ---------------------------------------------------------------------------------
    def _read(self, given: object, where: str, *, poses: bool) -> list[Condition]:
        """Relations that synthesis can use, or an error that says where they are."""
        try:
            conditions = read_conditions(given)
        except ConditionError as error:
            raise ConditionError(f"synthesize: {where}: {error}") from None
        return [self._checked(condition, where, poses=poses) for condition in conditions]

    def _checked(self, condition: Condition, where: str, *, poses: bool) -> Condition:
        """A condition that synthesis can use."""
        known = {x.element_hash() for x in ca.vertsplit(ca.vertcat(self.eom.q if poses else ca.SX(0, 1), self.eom.p))}
        for symbol in condition.symbols:
            if symbol.element_hash() not in known:
                allowed = "positions and parameters" if poses else "parameters"
                raise ExpressionError(
                    f"synthesize: {where}: {condition.label} contains {describe(symbol)}; it takes {allowed} of the "
                    "mechanism"
                )
        if poses and not condition.equality:
            raise ModelError(f"synthesize: {where}: {condition.label} is a limit; positions take equalities")
        if not poses and not any(place_of_hash(s, self.unknowns) for s in condition.symbols):
            raise ModelError(f"synthesize: {where}: {condition.label} contains none of unknowns=")
        return condition

    def _with_known(self, expression: ca.SX) -> ca.SX:
        return ca.substitute(expression, *self._known)

    # --- rows ------------------------------------------------------------------------------------
    def _relation_rows(self, position: int) -> list[Row]:
        """Names and sizes of the relations at a position."""
        return [
            Row(f"{c.label} at position {position + 1}", 1.0 if c.unit == "rad" else self.length)
            for c in self.relations[position]
        ]

    def _column(self, relations: Sequence[Condition]) -> ca.SX:
        """Residuals of a position, divided by their sizes."""
        of_relations = [self._with_known(self.reduced.of(c.expression)[0]) for c in relations]
        sizes = [row.size for row in self.closing_rows] + [1.0 if c.unit == "rad" else self.length for c in relations]
        return ca.vertcat(ca.SX(0, 1), self.closing, *of_relations) / ca.DM(sizes)

    def _reach(self) -> float:
        """Largest distance of the drawing from a position, m."""
        relations = [self.reduced.of(c.expression)[0] for each in self.relations for c in each if c.unit != "rad"]
        distances = self._with_known(ca.vertcat(ca.SX(0, 1), *relations))
        values = ca.Function("distances", [self.y, self.p], [ca.densify(distances)])(self.start, self.drawn_values)
        return float(np.max(np.nan_to_num(np.abs(values.full())), initial=0.0))

    def _closes_as_drawn(self) -> bool:
        """True if unknowns are places of joints in the drawn pose, which closes the linkage at random ones."""
        if not ca.depends_on(self.closing, self.p):
            return False
        function = ca.Function("closing", [self.y, self.p], [ca.densify(self.closing)])
        gaps = [function(self.start, values * self.length).full() for values in scattered(PROBES, len(self.unknowns))]
        return bool(np.max(np.abs(gaps), initial=0.0) < RANK * self.length)

    def _at_drawn_pose(self, column: ca.SX) -> list[tuple[ca.SX, Row]]:
        """Relations of the first position at the drawn pose, which are conditions on the unknowns."""
        rows = ca.vertsplit(ca.substitute(column, self.y, ca.DM(self.start)))[self.closing.numel() :]
        kept = []
        function = ca.Function("at_drawn", [self.p], [ca.densify(ca.vertcat(ca.SX(0, 1), *rows))])
        probes = [function(values * self.length).full().ravel() for values in scattered(PROBES, len(self.unknowns))]
        constant = np.ptp(probes, axis=0) < RANK  # whatever the unknowns are, although they may occur
        named_rows = zip(rows, self.relations[0], self._relation_rows(0), probes[0], constant, strict=True)
        for row, relation, named, value, is_constant in named_rows:
            if not is_constant:
                kept.append((row, named))
            elif abs(value) > RANK:
                raise ModelError(
                    f"synthesize: position 1: {relation.label} is missed by {value * named.size:.3g} in the drawn "
                    "pose, which is that of the first position; draw the mechanism there, or add the parameters of the "
                    "point to unknowns="
                )
        return kept

    def _twins(self) -> list[int]:
        """Number of the first pose that is asked for as each one is; -1 if that is the drawn one."""
        columns = [self._column(relations) for relations in self.relations]
        at = scattered(self.y.numel() + self.p.numel())
        values = [
            ca.Function("column", [self.y, self.p], [c])(at[: self.y.numel()], at[self.y.numel() :]) for c in columns
        ]
        same = [
            [a.shape == b.shape and np.allclose(a.full(), b.full(), rtol=RANK, atol=RANK) for b in values]
            for a in values
        ]
        return [row.index(True) - self.drawn for row in same][int(self.drawn) :]

    def _sizes_of_unknowns(self, columns: Sequence[ca.SX]) -> np.ndarray:
        """Change of each unknown that changes a residual by its size: the length of the drawing, or one radian."""
        column = ca.vertcat(ca.SX(0, 1), *columns)
        slopes = ca.Function("slopes", [self.y, self.p], [ca.densify(ca.jacobian(column, self.p))])
        poses = [self.start + np.pi * self.turning * turn for turn in scattered(PROBES, self.start.size)]
        found = np.array([np.abs(slopes(pose, self.drawn_values).full()) for pose in poses])
        largest = np.nanmax(found, axis=(0, 1), initial=0.0)
        return np.where(largest > RANK / self.length, 1 / np.where(largest > 0, largest, 1.0), self.length)

    def _scaled_condition(self, condition: Condition) -> tuple[ca.SX, Row]:
        """A condition on the unknowns, divided by its change at the drawing if these change by their sizes."""
        expression = self._with_known(condition.expression)
        slope = ca.Function("slope", [self.p], [ca.densify(ca.gradient(expression, self.p))])(self.drawn_values)
        size = float(np.max(np.nan_to_num(np.abs(slope.full().ravel()) * self.sizes), initial=0.0)) or 1.0
        return expression / size, Row(condition.label, size)

    def _spans(self) -> ca.SX:
        """Distances of the joints of each body, of those that depend on the unknowns."""
        by_body: dict[object, list[ca.SX]] = {}
        for joint in self.mechanism.joints:
            for marker in joint.markers:
                by_body.setdefault(marker.body, []).append(self._with_known(marker.local))
        spans = [ca.norm_2(a - b) for points in by_body.values() for k, a in enumerate(points) for b in points[k + 1 :]]
        return ca.vertcat(ca.SX(0, 1), *[span for span in spans if ca.depends_on(span, self.p)])

    def _bounds(self, k: int) -> list[tuple[ca.SX, Row]]:
        """Limits that an unknown carries."""
        x, size = self.unknowns[k], float(self.sizes[k])
        sides = ((x.lower, x.lower - self.p[k], ">="), (x.upper, self.p[k] - x.upper, "<="))
        return [(e / size, Row(f"{x.label} {sign} {v:g}", size)) for v, e, sign in sides if np.isfinite(v)]


def place_of_hash(symbol: ca.SX, symbols: Sequence[ca.SX]) -> bool:
    """True if a symbol is among others."""
    return any(symbol.element_hash() == other.element_hash() for other in symbols)


def _split(rows: Sequence[tuple[ca.SX, Row]]) -> tuple[ca.SX, list[Row]]:
    return ca.vertcat(ca.SX(0, 1), *[e for e, _ in rows]), [row for _, row in rows]
