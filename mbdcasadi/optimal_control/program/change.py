"""Change from a phase to the next one in the program: positions go on, velocities jump by impulses."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from ...equations.numeric import NumericEquations
from ...model.conditions import Condition, stacked
from ...model.symbols import Parameter, StateVariable, place_of
from ...numerics.lazy import cached_property
from ...numerics.rank import dependent_rows, unit_rows
from ...results.phases import places_in
from ..transcription.points import CollocationPoint
from ..transcription.rows import Place, RowKind, Rows, condition_rows
from .blocks import Block, Edge, block_of_edges
from .phase_program import PhaseProgram
from .setup import PhaseSetup


@dataclass(frozen=True)
class ChangeSetup:
    """Independent rows of a change from one phase to the next."""

    before: PhaseSetup
    after: PhaseSetup
    #: independent rows of the impact: of the mechanism afterwards, then of joints of the instant alone
    independent: tuple[int, ...]
    #: position rows, in the same order, that neither the mechanism before nor conditions at its end imply
    guards: tuple[int, ...]

    @classmethod
    def at(
        cls, before: PhaseSetup, after: PhaseSetup, pose: np.ndarray, t: float, free: Sequence[Parameter]
    ) -> ChangeSetup:
        """Find the independent rows at a pose of the mechanism before."""
        here = places_in(before.phase.equations.q, after.phase.equations.q)
        independent = _independent(after, pose[here], t)
        return cls(before, after, independent, _guards(before, after, pose, here, t, free))

    @property
    def key(self) -> Hashable:
        """Key of a program of the change."""
        return self.independent, self.guards


def _independent(after: PhaseSetup, q: np.ndarray, t: float) -> tuple[int, ...]:
    """Independent rows of the impact: those of the transcription, and of the instant alone."""
    law, numeric, scheme = after.phase.law, after.numeric, after.scheme
    constraint_rows = [*scheme.eom.explicit, *(scheme.eom.rows[k] for k in scheme.rows)]
    more = list(range(numeric.eom.lam.numel(), law.jacobian.size1()))
    if not more:
        return tuple(sorted(constraint_rows))
    jacobian = ca.Function("J", [numeric.eom.t, numeric.eom.q, numeric.eom.p], [ca.densify(law.jacobian)])
    rows = unit_rows(jacobian(t, q, numeric.p).full() * numeric.column_scale)[[*constraint_rows, *more]]
    dependent = set(dependent_rows(rows))
    return tuple(sorted(k for i, k in enumerate([*constraint_rows, *more]) if i not in dependent))


def _guards(
    before: PhaseSetup, after: PhaseSetup, pose: np.ndarray, here: list[int], t: float, free: Sequence[Parameter]
) -> tuple[int, ...]:
    """Position rows of the mechanism afterwards that are new."""
    law, numeric, old = after.phase.law, after.numeric, before.numeric
    rows = law.positions
    if not rows.numel():
        return ()
    parameters = [p for p in free if place_of(p, after.phase.mechanism.parameters) is not None]
    unknowns = ca.vertcat(numeric.eom.q, *parameters)
    slopes = ca.Function("G", [numeric.eom.t, numeric.eom.q, numeric.eom.p], [ca.densify(ca.jacobian(rows, unknowns))])
    n, m = pose.size, old.eom.position_rows.size
    new = np.zeros((rows.numel(), n + len(parameters)))
    gradients = slopes(t, pose[here], numeric.p).full()
    new[:, here], new[:, n:] = gradients[:, : len(here)], gradients[:, len(here) :]
    known = np.zeros((m, n + len(parameters)))
    known[:, :n] = old.jacobian(t, pose)[old.eom.position_rows]
    final = [c for c in before.ends.final if c.equality and c.kinds <= {"position", "time"}]
    if final:
        slope = ca.Function(
            "F", [old.eom.t, old.eom.q, old.eom.p], [ca.densify(ca.jacobian(stacked(final), old.eom.q))]
        )
        known = np.vstack([known, np.hstack([slope(t, pose, old.p).full(), np.zeros((len(final), len(parameters)))])])
    sizes = np.r_[old.column_scale, np.ones(len(parameters))]
    dependent = set(dependent_rows(unit_rows(np.vstack([known, new]) * sizes)))
    return tuple(k for k in range(rows.numel()) if k + len(known) not in dependent)


class Change:
    """Rows and impulses between two phases; `first` variables of the program come before the impulses.

    ``M (v⁺ - v⁻) + J^T Λ = 0`` and ``J v⁺ = b`` by :class:`ImpactLaw`; positions, first-order states and the time go
    on, and position rows that are new hold.
    """

    def __init__(self, setup: ChangeSetup, before: PhaseProgram, after: PhaseProgram, first: int):
        self.setup, self.before, self.after = setup, before, after
        self.law = after.phase.law
        self.index = first + np.arange(len(setup.independent))
        eom = after.phase.equations
        self.here = places_in(before.phase.equations.q, eom.q)

    @cached_property
    def scale(self) -> np.ndarray:
        """Typical sizes of the impulses (k,)."""
        scales, sizes = self.after.scales, np.r_[self.after.scales.lam, np.zeros(self.law.momentary.numel())]
        sizes[scales.lam.size :] = float(np.max(scales.load)) if scales.load.size else 1.0
        return sizes[list(self.setup.independent)] * scales.time

    @property
    def _momentum_scale(self) -> np.ndarray:
        """Sizes of the momenta of each body (n,)."""
        mass, scales = self.setup.after.numeric.mass, self.after.scales
        momentum = mass * scales.v
        return np.where(momentum > 0, momentum, scales.load * scales.time)

    def blocks(self, free_index: np.ndarray, p: ca.SX) -> list[Block]:
        """The rows, and conditions at the start of the phase."""
        begin = self.before.edge(True)
        end = self.after.edge(False, begin.unknowns.free)
        impulses = ca.SX.sym("i", len(self.setup.independent))
        full = ca.SX.zeros(self.law.impulses.numel())
        if self.setup.independent:
            full[list(self.setup.independent)] = ca.DM(self.scale) * impulses
        groups = self._rows(begin, end, full)
        return [block_of_edges([begin, end], groups, p, free_index, others=(impulses, self.index))]

    def _rows(self, begin: Edge, end: Edge, impulses: ca.SX) -> list[Rows]:
        eom, scheme, scales = self.after.phase.equations, self.after.scheme, self.after.scales
        old = self.before.scheme.expanded(begin.at, begin.unknowns.interval.p, loads=False)
        p = end.unknowns.interval.p
        new = scheme.expanded(end.at, p)
        place = Place(f"change into phase '{self.after.phase.name}'", True)
        q, v = old.q[self.here], old.v[self.here]
        coordinates = scheme.eom.independent
        going_on = Rows(
            end.at.q - q[coordinates],
            tuple(eom.coordinate_names[k] for k in coordinates),
            0.0,
            scales.q[coordinates],
            tuple("rad" if eom.angles[k] else "m" for k in coordinates),
            RowKind.CONTINUITY,
        )
        law = ca.Function(
            "law",
            [eom.t, eom.q, eom.v, eom.z, self.law.v_before, self.law.impulses, eom.p],
            [self.law.momentum, self.law.velocity, self.law.positions],
        )
        momentum, velocity, _ = law(old.t, new.q, new.v, new.z, v, impulses, p)
        guards = law(old.t, q, new.v, new.z, v, impulses, p)[2]
        units = tuple("N m s" if angle else "N s" for angle in eom.angles)
        impulse = Rows(momentum, eom.coordinate_names, 0.0, self._momentum_scale, units, RowKind.MOMENTUM)
        of_joints = [going_on, self._guard_rows(guards), impulse, self._velocity_rows(velocity)]
        of_states = [self._state_rows(old.z, new.z), *self._time_rows(old.t, new.t)]
        return [
            *(replace(rows, place=place) for rows in of_joints),
            *self._prescribed_rows(end, p),
            *(replace(rows, place=place) for rows in of_states),
            *self._initial_rows(new, end, impulses),
        ]

    def guards_at(self, p: np.ndarray) -> ca.SX:
        """Position rows that are new, at parameters of the mechanism afterwards."""
        eom = self.setup.after.numeric.eom
        rows = self.law.positions[list(self.setup.guards)]
        return ca.substitute(rows, eom.p, ca.SX(ca.DM(p)))

    @property
    def guard_names(self) -> list[str]:
        """Names of the position rows that are new."""
        return [self.law.position_names[k] for k in self.setup.guards]

    def _guard_rows(self, values: ca.SX) -> Rows:
        rows, names = self.after.phase.equations.position_rows, self.law.position_names
        return self._chosen(values, RowKind.CLOSING, names, list(self.setup.guards), list(rows))

    def _velocity_rows(self, values: ca.SX) -> Rows:
        """``J v⁺ = b``; rows by which the coordinates are chosen hold identically."""
        solved = set(self.after.scheme.eom.explicit)
        chosen = [k for k in self.setup.independent if k not in solved]
        rows = list(range(self.after.phase.equations.lam.numel()))
        return self._chosen(values, RowKind.VELOCITY, self.law.row_names, chosen, rows)

    def _chosen(self, values: ca.SX, kind: RowKind, names: Sequence[str], chosen: list[int], own: list[int]) -> Rows:
        """Some of the rows `own` of the mechanism afterwards and of joints of the instant alone."""
        eom, scales, momentary = self.after.phase.equations, self.after.scales, self.law.momentary.numel()
        length = float(np.max(np.where(scales.angles, 0.0, scales.q))) or 1.0
        span, per = (scales.time, "/s") if kind is RowKind.VELOCITY else (1.0, "")
        sizes = np.r_[scales.rows[own], np.full(momentary, length)] / span
        angular = np.r_[eom.angular_rows[own], np.zeros(momentary, bool)]
        units = tuple(("rad" if angular[k] else "m") + per for k in chosen)
        rows, owners = values[chosen] if chosen else ca.SX(0, 1), tuple(names[k] for k in chosen)
        return Rows(rows, owners, 0.0, sizes[chosen], units, kind)

    def _prescribed_rows(self, end: Edge, p: ca.SX) -> list[Rows]:
        """Path conditions of the new phase that prescribe its motion hold from its start on."""
        constraints = self.after.scheme.constraints
        if not constraints.path_constraints:
            return []
        at, scales = end.at, self.after.reduced_scales
        _, positions = constraints.position_rows(at.q, at.z, at.t, p, 0.0, scales)
        velocities = constraints.velocity_rows(at.q, at.v, at.z, at.t, p, 0.0, scales)
        return [positions, velocities.part(slice(len(constraints.rows), None))]

    def _state_rows(self, old: ca.SX, new: ca.SX) -> Rows:
        """First-order states go on; new ones begin at their own values."""
        states = self.after.phase.mechanism.states
        rows = [new[k] - (s.value if i is None else old[i]) for k, (s, i) in enumerate(self._state_places)]
        owners, units = tuple(symbol.label for symbol in states), ("in the state's unit",) * len(states)
        return Rows(ca.vertcat(ca.SX(0, 1), *rows), owners, 0.0, self.after.scales.z, units, RowKind.CONTINUITY)

    def _time_rows(self, old: ca.SX, new: ca.SX) -> list[Rows]:
        if not self.after.time_count:
            return []
        return [Rows(new - old, ("time",), 0.0, np.array([self.after.scales.time]), ("s",))]

    def _initial_rows(self, new: CollocationPoint, end: Edge, impulses: ca.SX) -> list[Rows]:
        conditions: list[Condition] = list(self.after.initial or [])
        if not conditions:
            return []
        program = self.after
        function = ca.Function("initial", [*program.arguments, self.law.impulses], [stacked(conditions)])
        unknowns = end.unknowns
        values = ca.vertsplit(function(*new.values, unknowns.interval.p, unknowns.extra, impulses))
        typical = float(np.max(self.scale, initial=0.0)) or 1.0
        sizes = {c: typical if c.depends_on("impulse") else program.condition_sizes[c] for c in conditions}
        rows = dict(zip(conditions, values, strict=True))
        return condition_rows(rows, sizes, 0.0, Place(f"initial of phase '{program.phase.name}'", True))

    def impulses(self, x: np.ndarray) -> dict[Any, np.ndarray]:
        """Impulses by joint, from the variables of the whole program in physical units."""
        return self.by_joint(x[self.index])

    def by_joint(self, kept: np.ndarray) -> dict[Any, np.ndarray]:
        """Impulses by joint, from those of the independent rows."""
        full = np.zeros(self.law.impulses.numel())
        full[list(self.setup.independent)] = kept
        return self.law.by_joint(full)

    # --- the guess --------------------------------------------------------------------------
    def fill(self, x: np.ndarray, time: float) -> None:
        """Put the impulses, and a state of no duration, that belong to the end of the phase before."""
        before, after, numeric = self.before, self.after, self.setup.after.numeric
        point = x[before.point_index(before.count)]
        parts = before.scheme.split_point(point)
        p = self.setup.before.numeric.p
        q, v = before.scheme.eom.states(
            np.array([time]), parts["q"][None, :], parts["v"][None, :], parts["z"][None, :], p
        )
        z = np.array([s.value if i is None else float(parts["z"][i]) for s, i in self._state_places])
        collision = self.law.solve(numeric, time, q[0][self.here], v[0][self.here], z)
        x[self.index] = collision.impulses[list(self.setup.independent)]
        if after.phase.is_instant:
            chosen = after.scheme.eom.independent
            state = np.r_[q[0][self.here][chosen], collision.v[chosen], z]
            x[after.point_index(0)[: state.size]] = state
            x[after.time_index] = time

    @property
    def _state_places(self) -> list[tuple[StateVariable, int | None]]:
        """First-order states, and their places among those of the phase before; None for new ones."""
        states, theirs = (part.phase.mechanism.states for part in (self.after, self.before))
        return [(symbol, place_of(symbol, theirs)) for symbol in states]


def numeric_at(numeric: NumericEquations, values: Mapping[Parameter, float]) -> NumericEquations:
    """Return the equations with other values of some parameters."""
    p = numeric.p.copy()
    for k, symbol in enumerate(numeric.eom.mechanism.parameters):
        p[k] = values.get(symbol, p[k])
    return NumericEquations(numeric.eom, p)
