"""Change from a phase to the next one in the program: positions go on, velocities jump by impulses."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ...equations.numeric import NumericEquations
from ...model.conditions import Condition, stacked
from ...model.symbols import Parameter
from ...numerics.lazy import cached_property
from ...numerics.rank import dependent_rows, unit_rows
from ...results.phases import places_in
from ..transcription.points import CollocationPoint
from .blocks import Block, Edge
from .phase_program import PhaseProgram
from .rows import Rows, condition_rows, stack
from .setup import PhaseSetup
from .sparse_program import MappedBlock


@dataclass(frozen=True)
class ChangeSetup:
    """Independent rows of a change from one phase to the next."""

    before: PhaseSetup
    after: PhaseSetup
    #: independent rows of the impact: of the mechanism afterwards, then of joints of the instant alone
    kept: tuple[int, ...]
    #: position rows, in the same order, that neither the mechanism before nor conditions at its end imply
    guards: tuple[int, ...]

    @classmethod
    def at(
        cls, before: PhaseSetup, after: PhaseSetup, pose: np.ndarray, t: float, free: Sequence[Parameter]
    ) -> ChangeSetup:
        """Find the independent rows at a pose of the mechanism before."""
        here = places_in(before.phase.equations.q, after.phase.equations.q)
        kept = _kept(after, pose[here], t)
        return cls(before, after, kept, _guards(before, after, pose, here, t, free))

    @property
    def key(self) -> Hashable:
        """Key of a program of the change."""
        return self.kept, self.guards


def _kept(after: PhaseSetup, q: np.ndarray, t: float) -> tuple[int, ...]:
    """Independent rows of the impact: those of the transcription, and of the instant alone."""
    law, numeric, scheme = after.phase.law, after.numeric, after.scheme
    own = [*scheme.eom.explicit, *(scheme.eom.rows[k] for k in scheme.rows)]
    more = list(range(numeric.eom.lam.numel(), law.jacobian.size1()))
    if not more:
        return tuple(sorted(own))
    jacobian = ca.Function("J", [numeric.eom.t, numeric.eom.q, numeric.eom.p], [ca.densify(law.jacobian)])
    rows = unit_rows(jacobian(t, q, numeric.p).full() * numeric.column_scale)[[*own, *more]]
    dependent = set(dependent_rows(rows))
    return tuple(sorted(k for i, k in enumerate([*own, *more]) if i not in dependent))


def _guards(
    before: PhaseSetup, after: PhaseSetup, pose: np.ndarray, here: list[int], t: float, free: Sequence[Parameter]
) -> tuple[int, ...]:
    """Position rows of the mechanism afterwards that are new."""
    law, numeric, old = after.phase.law, after.numeric, before.numeric
    rows = ca.vertcat(numeric.eom.Phi, law.momentary)
    if not rows.numel():
        return ()
    own = [p for p in free if any(p is x for x in after.phase.mechanism.parameters)]
    unknowns = ca.vertcat(numeric.eom.q, *own)
    slopes = ca.Function("G", [numeric.eom.t, numeric.eom.q, numeric.eom.p], [ca.densify(ca.jacobian(rows, unknowns))])
    n, m = pose.size, old.eom.position_rows.size
    new = np.zeros((rows.numel(), n + len(own)))
    found = slopes(t, pose[here], numeric.p).full()
    new[:, here], new[:, n:] = found[:, : len(here)], found[:, len(here) :]
    known = np.zeros((m, n + len(own)))
    known[:, :n] = old.velocity(t, pose)[0][old.eom.position_rows]
    final = [c for c in before.ends.final if c.equality and c.kinds <= {"position", "time"}]
    if final:
        slope = ca.Function(
            "F", [old.eom.t, old.eom.q, old.eom.p], [ca.densify(ca.jacobian(stacked(final), old.eom.q))]
        )
        known = np.vstack([known, np.hstack([slope(t, pose, old.p).full(), np.zeros((len(final), len(own)))])])
    sizes = np.r_[old.column_scale, np.ones(len(own))]
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
        self.index = first + np.arange(len(setup.kept))
        eom = after.phase.equations
        self.here = places_in(before.phase.equations.q, eom.q)

    @cached_property
    def scale(self) -> np.ndarray:
        """Typical sizes of the impulses (k,)."""
        scales, sizes = self.after.scales, np.r_[self.after.scales.lam, np.zeros(self.law.momentary.numel())]
        sizes[scales.lam.size :] = float(np.max(scales.load)) if scales.load.size else 1.0
        return sizes[list(self.setup.kept)] * scales.time

    @property
    def _momentum_scale(self) -> np.ndarray:
        """Sizes of the momenta of each body (n,)."""
        mass, scales = self.setup.after.numeric.mass, self.after.scales
        own = mass * scales.v
        return np.where(own > 0, own, scales.load * scales.time)

    def blocks(self, free_index: np.ndarray, p: ca.SX) -> list[Block]:
        """The rows, and conditions at the start of the phase."""
        begin = self.before.edge(True)
        end = self.after.edge(False, begin.unknowns.free)
        impulses = ca.SX.sym("i", len(self.setup.kept))
        full = ca.SX.zeros(self.law.impulses.numel())
        if self.setup.kept:
            full[list(self.setup.kept)] = ca.DM(self.scale) * impulses
        groups = self._rows(begin, end, full)
        variables = ca.vertcat(begin.unknowns.variables, end.unknowns.variables, impulses, begin.unknowns.free)
        data = ca.vertcat(begin.unknowns.data, end.unknowns.data)
        index = np.r_[begin.index.ravel(), end.index.ravel(), self.index, free_index][:, None]
        piece = MappedBlock(variables, data, p, stack(groups), ca.SX(0), index)
        return [Block(piece, [g for g in groups if g.labels], ((begin.interval, end.interval),))]

    def _rows(self, begin: Edge, end: Edge, impulses: ca.SX) -> list[Rows]:
        eom, scheme, scales = self.after.phase.equations, self.after.scheme, self.after.scales
        old = self.before.scheme.expanded(begin.at, begin.unknowns.interval.p)
        p = end.unknowns.interval.p
        new = scheme.expanded(end.at, p)
        name = f"change into phase '{self.after.phase.name}'"
        q, v = old.q[self.here], old.v[self.here]
        coordinates = scheme.eom.independent
        going_on = Rows(
            end.at.q - q[coordinates],
            tuple(f"{name}: continuity of {eom.coordinate_names[k]}" for k in coordinates),
            0.0,
            scales.q[coordinates],
            tuple("rad" if eom.angles[k] else "m" for k in coordinates),
        )
        law = ca.Function(
            "law",
            [eom.t, eom.q, eom.v, self.law.v_before, self.law.impulses, eom.p],
            [self.law.momentum, self.law.velocity, ca.vertcat(eom.Phi, self.law.momentary)],
        )
        momentum, velocity, _ = law(old.t, new.q, new.v, v, impulses, p)
        guards = law(old.t, q, new.v, v, impulses, p)[2]
        return [
            going_on,
            self._guard_rows(guards, name),
            Rows(
                momentum,
                tuple(f"{name}: momentum of {x}" for x in eom.coordinate_names),
                0.0,
                self._momentum_scale,
                tuple("N m s" if angle else "N s" for angle in eom.angles),
            ),
            self._velocity_rows(velocity, name),
            *self._prescribed_rows(end, p),
            self._state_rows(old.z, new.z, name),
            *self._time_rows(old.t, new.t, name),
            *self._initial_rows(new, end, impulses),
        ]

    def _guard_rows(self, values: ca.SX, name: str) -> Rows:
        eom, chosen = self.after.phase.equations, list(self.setup.guards)
        names = [*(eom.row_names[k] for k in eom.position_rows), *self.law.row_names[eom.lam.numel() :]]
        sizes = np.r_[self.after.scales.rows[eom.position_rows], np.full(self.law.momentary.numel(), self._length)]
        angular = np.r_[eom.angular_rows[eom.position_rows], np.zeros(self.law.momentary.numel(), bool)]
        return Rows(
            values[chosen] if chosen else ca.SX(0, 1),
            tuple(f"{name}: {names[k]} closes" for k in chosen),
            0.0,
            sizes[chosen],
            tuple("rad" if angular[k] else "m" for k in chosen),
        )

    @property
    def _length(self) -> float:
        scales = self.after.scales
        return float(np.max(np.where(scales.angles, 0.0, scales.q))) or 1.0

    def _velocity_rows(self, values: ca.SX, name: str) -> Rows:
        """``J v⁺ = b``; rows by which the coordinates are chosen hold identically."""
        solved = set(self.after.scheme.eom.explicit)
        chosen = [k for k in self.setup.kept if k not in solved]
        eom, time = self.after.phase.equations, self.after.scales.time
        sizes = np.r_[self.after.scales.rows, np.full(self.law.momentary.numel(), self._length)] / time
        angular = np.r_[eom.angular_rows, np.zeros(self.law.momentary.numel(), bool)]
        return Rows(
            values[chosen] if chosen else ca.SX(0, 1),
            tuple(f"{name}: velocity equation of {self.law.row_names[k]}" for k in chosen),
            0.0,
            sizes[chosen],
            tuple("rad/s" if angular[k] else "m/s" for k in chosen),
        )

    def _prescribed_rows(self, end: Edge, p: ca.SX) -> list[Rows]:
        """Path conditions of the new phase that prescribe its motion hold from its start on."""
        constraints = self.after.scheme.constraints
        if not constraints.path_constraints:
            return []
        at, scales = end.at, self.after.reduced_scales
        joints = len(constraints.rows)
        positions = constraints.position_rows(at.q, at.t, p, 0.0, scales)
        prescribed = constraints.position_count - constraints.joint_position_count
        velocities = constraints.velocity_rows(at.q, at.v, at.t, p, 0.0, scales)
        return [positions.after(constraints.position_count - prescribed), velocities.after(joints)]

    def _state_rows(self, old: ca.SX, new: ca.SX, name: str) -> Rows:
        """First-order states go on; new ones begin at their own values."""
        theirs = self.before.phase.mechanism.states
        rows, states = [], self.after.phase.mechanism.states
        for k, symbol in enumerate(states):
            place = next((i for i, other in enumerate(theirs) if other is symbol), None)
            rows.append(new[k] - (symbol.value if place is None else old[place]))
        labels = tuple(f"{name}: continuity of {symbol.label}" for symbol in states)
        sizes = self.after.scales.z
        return Rows(ca.vertcat(ca.SX(0, 1), *rows), labels, 0.0, sizes, ("in the state's unit",) * len(states))

    def _time_rows(self, old: ca.SX, new: ca.SX, name: str) -> list[Rows]:
        if not self.after.time_count:
            return []
        return [Rows(new - old, (f"{name}: time",), 0.0, np.array([self.after.scales.time]), ("s",))]

    def _initial_rows(self, new: CollocationPoint, end: Edge, impulses: ca.SX) -> list[Rows]:
        conditions: list[Condition] = list(self.after.initial or [])
        if not conditions:
            return []
        program = self.after
        function = ca.Function("initial", [*program.arguments, self.law.impulses], [stacked(conditions)])
        unknowns = end.unknowns
        values = ca.vertsplit(function(*new.values, unknowns.interval.p, unknowns.extra, impulses))
        typical = float(np.max(self.scale, initial=0.0)) or 1.0
        plain = [c for c in conditions if not c.depends_on("impulse")]
        sizes = dict.fromkeys(conditions, typical) | program.sizes_of(plain)
        rows = dict(zip(conditions, values, strict=True))
        return condition_rows(rows, sizes, 0.0, f"initial of phase '{program.phase.name}': ")

    def impulses(self, x: np.ndarray) -> dict[Any, np.ndarray]:
        """Impulses by joint, from the variables of the whole program in physical units."""
        return self.by_joint(x[self.index])

    def by_joint(self, kept: np.ndarray) -> dict[Any, np.ndarray]:
        """Impulses by joint, from those of the independent rows."""
        full = np.zeros(self.law.impulses.numel())
        full[list(self.setup.kept)] = kept
        return self.law.by_joint(full)

    # --- the guess --------------------------------------------------------------------------
    def fill(self, x: np.ndarray, time: float) -> None:
        """Put the impulses, and a state of no duration, that belong to the end of the phase before."""
        before, after, numeric = self.before, self.after, self.setup.after.numeric
        point = x[before.point_index(before.count)]
        parts = before.scheme.split_point(point)
        p = self.setup.before.numeric.p
        q, v = before.scheme.eom.states(np.array([time]), parts["q"][None, :], parts["v"][None, :], p)
        found = self.law.solve(numeric.mass, time, q[0][self.here], v[0][self.here], numeric.p)
        x[self.index] = found.impulses[list(self.setup.kept)]
        if after.phase.is_instant:
            chosen = after.scheme.eom.independent
            state = np.r_[q[0][self.here][chosen], found.v[chosen], self._states(parts["z"])]
            x[after.point_index(0)[: state.size]] = state
            x[after.time_index] = time

    def _states(self, values: np.ndarray) -> list[float]:
        theirs = self.before.phase.mechanism.states
        places = [next((i for i, y in enumerate(theirs) if y is s), None) for s in self.after.phase.mechanism.states]
        states = self.after.phase.mechanism.states
        return [s.value if i is None else float(values[i]) for s, i in zip(states, places, strict=True)]


def numeric_at(numeric: NumericEquations, values: dict[Parameter, float]) -> NumericEquations:
    """Return the equations with other values of some parameters."""
    p = numeric.p.copy()
    for k, symbol in enumerate(numeric.eom.mechanism.parameters):
        p[k] = values.get(symbol, p[k])
    return NumericEquations(numeric.eom, p)
