"""Poses at the ends of all phases, assembled together.

Each pose meets the constraints of the mechanisms on both sides, the conditions there, and the
boundary conditions between them; leg by leg a gait would not close.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ...equations.numeric import NumericEquations
from ...model.conditions import Condition
from ...numerics.newton import solve
from ...results.phases import places_in
from ...results.state import State
from ..phase import Phase, on_positions
from ..placeholders import Placeholder, placeholders_in, with_values
from ..problem import OptimalControlProblem

#: Steps in which the conditions are moved to zero.
STEPS = 20
#: Iterations of Newton's method at each of them.
ITERATIONS = 40


@dataclass(frozen=True)
class KeyPoses:
    """Poses at the start and at the end of each phase, in the coordinates of its mechanism."""

    starts: list[np.ndarray]
    ends: list[np.ndarray]
    #: values of the free parameters
    parameters: np.ndarray
    #: whether all conditions on positions are met
    found: bool


class _Search:
    """Conditions on all key poses as one system.

    The unknowns are the first pose, the differences of the following ones from those before, and the free
    parameters: steps of least norm keep poses near to each other.
    """

    def __init__(
        self,
        problem: OptimalControlProblem,
        numerics: Sequence[NumericEquations],
        start: np.ndarray,
        times: Sequence[tuple[float, float]],
    ):
        self._problem, self._numerics, self._times = problem, numerics, times
        self._free = problem.free_parameters
        self.free = ca.SX.sym("f", len(self._free))
        phases = problem.phases
        #: phase in whose coordinates each pose is: the one that it ends
        self._owners = {0: 0}
        self._poses = [ca.SX.sym("q", start.size)]
        self.places: list[tuple[int, int]] = []
        unknowns, weights, limits = [self._poses[0]], [numerics[0].weights], [numerics[0].typical_step]
        for k, phase in enumerate(phases):
            begin = len(self._poses) - 1
            if phase.is_instant:
                self.places.append((begin, begin))
                continue
            moved = ca.SX.sym("d", phase.equations.q.numel())
            self._poses.append(self._at(k, begin) + moved)
            self._owners[begin + 1] = k
            unknowns.append(moved)
            weights.append(numerics[k].weights)
            limits.append(numerics[k].typical_step)
            self.places.append((begin, begin + 1))
        self.x = ca.vertcat(*unknowns, self.free)
        sizes = np.array([abs(p.value) or 1.0 for p in self._free])
        heavy = float(max(np.max(w * s**2) for w, s in zip(weights, limits, strict=True)))
        self.weights = np.concatenate([*weights, 1e-2 * heavy / sizes**2])
        self.limit = np.concatenate([*limits, sizes])
        self.x0 = np.concatenate([start, np.zeros(sum(u.numel() for u in unknowns[1:])), [p.value for p in self._free]])
        self.rows = self._rows()
        self.functions = ca.Function(
            "key_poses", [self.x], [ca.densify(self.rows), ca.densify(ca.jacobian(self.rows, self.x))]
        )

    def _at(self, phase: int, pose: int) -> ca.SX:
        """A pose in the coordinates of a phase."""
        theirs = self._problem.phases[self._owners[pose]].equations.q
        return self._poses[pose][places_in(theirs, self._problem.phases[phase].equations.q)]

    def _parameters(self, phase: int) -> ca.SX:
        p = ca.SX(ca.DM(self._numerics[phase].p))
        for k, symbol in enumerate(self._problem.phases[phase].mechanism.parameters):
            for j, free in enumerate(self._free):
                if symbol is free:
                    p[k] = self.free[j]
        return p

    def value(self, expression: ca.SX, phase: int, at_end: bool) -> ca.SX:
        """An expression in positions at an end of a phase."""
        eom = self._problem.phases[phase].equations
        extra = self._problem.extra_parameters(self._problem.phases[phase])
        values = [self.free[next(j for j, p in enumerate(self._free) if p is x)] for x in extra]
        arguments = [eom.t, eom.q, eom.p, ca.vertcat(ca.SX(0, 1), *extra)]
        pose = self._at(phase, self.places[phase][at_end])
        function = ca.Function("at", arguments, [expression])
        return function(self._times[phase][at_end], pose, self._parameters(phase), ca.vertcat(ca.SX(0, 1), *values))

    def _rows(self) -> ca.SX:
        rows = [ca.SX(0, 1)]
        for k, phase in enumerate(self._problem.phases):
            eom = phase.equations
            closing = ca.vertcat(eom.Phi, phase.law.momentary) if k else eom.Phi
            rows.append(self.value(closing, k, False))
            if not phase.is_instant:
                rows.append(self.value(eom.Phi, k, True))
            rows += self._conditions(phase, k)
        rows += self._relations()
        return ca.vertcat(*rows)

    def _conditions(self, phase: Phase, k: int) -> list[ca.SX]:
        rows = []
        for at_end, end in ((False, phase.initial), (True, phase.final)):
            if isinstance(end, State):
                rows.append(self.value(phase.equations.q - ca.DM(end.q), k, at_end))
                continue
            conditions = [*end, *phase.path] if at_end or k else [*end]
            rows += [self.value(c.expression, k, at_end) for c in conditions if _is_on_positions(c)]
        return rows

    def _relations(self) -> list[ca.SX]:
        """Boundary conditions between positions."""
        rows, phases = [], self._problem.phases
        for condition in self._problem.boundary:
            marks = placeholders_in(condition.expression)
            if not condition.equality or any(p.kind == "integral" or not on_positions(p.expression) for p in marks):
                continue
            rest = with_values(condition.expression, lambda _: 0.0)
            if not on_positions(rest, allow_none=True):
                continue

            def value(mark: Placeholder) -> ca.SX:
                phase = self._problem.phase_of(mark)
                number = next(k for k, own in enumerate(phases) if own is phase)
                return self.value(mark.expression, number, mark.kind == "at_end")

            named = with_values(condition.expression, value)
            rows.append(self._rest_at_end(named))
        return rows

    def _rest_at_end(self, expression: ca.SX) -> ca.SX:
        """An expression whose symbols outside of placeholders are taken at the end of the motion."""
        last = len(self._problem.phases) - 1
        eom = self._problem.phases[last].equations
        pose = self._at(last, self.places[last][1])
        symbols = [eom.t, eom.q, eom.p]
        values = [ca.SX(self._times[last][1]), pose, self._parameters(last)]
        return ca.substitute([expression], symbols, values)[0]


def _is_on_positions(condition: Condition) -> bool:
    return condition.equality and on_positions(condition.expression)


def key_poses(
    problem: OptimalControlProblem,
    numerics: Sequence[NumericEquations],
    start: np.ndarray,
    times: Sequence[tuple[float, float]],
) -> KeyPoses:
    """Return poses at the ends of all phases that meet all conditions on positions, by continuation.

    All begin at an estimate of the first pose; `times` are start and end of each phase, s.
    """
    search = _Search(problem, numerics, start, times)
    low = np.array([p.lower for p in search._free])
    high = np.array([p.upper for p in search._free])
    x = search.x0
    first = search.functions(x)[0].full().ravel()
    found = True
    for k in range(1, STEPS + 1):
        offset = (1 - k / STEPS) * first

        def rows(x: np.ndarray, offset: np.ndarray = offset) -> tuple[np.ndarray, np.ndarray]:
            residual, jacobian = search.functions(x)
            return residual.full().ravel() - offset, jacobian.full()

        outcome = solve(rows, x, search.weights, iterations=ITERATIONS, step_limit=search.limit)
        found = outcome.converged
        if not np.all(np.isfinite(outcome.x)):
            found = False
            break
        x = outcome.x
    parameters = np.clip(x[x.size - low.size :], low, high)
    poses = ca.Function(
        "poses",
        [search.x],
        [search._at(k, pose) for k, pair in enumerate(search.places) for pose in pair],
    )(x)
    flat = [np.array(pose.full().ravel()) for pose in (poses if isinstance(poses, tuple | list) else (poses,))]
    return KeyPoses(flat[::2], flat[1::2], parameters, found)
