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
from ...model.symbols import Parameter
from ...numerics.newton import solve
from ...results.phases import places_in
from ...results.state import State
from ..problem import OptimalControlProblem
from ..statement.phase import Phase, on_positions
from .pose_system import Place, PoseSystem, newton_rows

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
    values: dict[Parameter, float]


class _KeyPoseSystem(PoseSystem):
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
        super().__init__(problem, dict(zip(problem.phases, numerics, strict=True)))
        self._times = times
        #: phase in whose coordinates each pose is: the one that it ends
        self._owners = [0]
        self._poses = [ca.SX.sym("q", start.size)]
        self.places: list[tuple[int, int]] = []
        unknowns, moving = [self._poses[0]], [numerics[0]]
        for k, phase in enumerate(problem.phases):
            begin = len(self._poses) - 1
            if phase.is_instant:
                self.places.append((begin, begin))
                continue
            moved = ca.SX.sym("d", phase.equations.q.numel())
            self._poses.append(self.pose(k, begin) + moved)
            self._owners.append(k)
            unknowns.append(moved)
            moving.append(numerics[k])
            self.places.append((begin, begin + 1))
        self.x = ca.vertcat(*unknowns, self.free)
        self.step_weights = self.weights(moving)
        self.limit = np.concatenate([*(n.typical_step for n in moving), self.sizes])
        self.x0 = np.concatenate([start, np.zeros(sum(u.numel() for u in unknowns[1:])), self.values])
        self.rows = ca.vertcat(ca.SX(0, 1), *self._rows(), *self.relations(self._end))

    def pose(self, phase: int, pose: int) -> ca.SX:
        """A pose in the coordinates of a phase."""
        theirs = self._problem.phases[self._owners[pose]].equations.q
        return self._poses[pose][places_in(theirs, self._problem.phases[phase].equations.q)]

    def _end(self, phase: Phase, at_end: bool) -> Place:
        k = self._problem.phases.index(phase)
        return phase, self._times[k][at_end], self.pose(k, self.places[k][at_end])

    def _rows(self) -> list[ca.SX]:
        rows = []
        for k, phase in enumerate(self._problem.phases):
            eom, begin, end = phase.equations, self._end(phase, False), self._end(phase, True)
            rows.append(self.value(ca.vertcat(eom.closing, phase.law.momentary) if k else eom.closing, begin))
            if not phase.is_instant:
                rows.append(self.value(eom.closing, end))
            rows += self._conditions(phase, k)
        return rows

    def _conditions(self, phase: Phase, k: int) -> list[ca.SX]:
        rows = []
        for at_end, end in ((False, phase.initial), (True, phase.final)):
            place = self._end(phase, at_end)
            if isinstance(end, State):
                rows.append(self.value(phase.equations.q - ca.DM(end.q), place))
                continue
            conditions = [*end, *phase.path] if at_end or k else end
            rows += [self.value(c.expression, place) for c in conditions if c.equality and on_positions(c.expression)]
        return rows


def key_poses(
    problem: OptimalControlProblem,
    numerics: Sequence[NumericEquations],
    start: np.ndarray,
    times: Sequence[tuple[float, float]],
) -> KeyPoses:
    """Return poses at the ends of all phases that meet all conditions on positions, by continuation.

    All begin at an estimate of the first pose; `times` are start and end of each phase, s.
    """
    system = _KeyPoseSystem(problem, numerics, start, times)
    equations, x = newton_rows(system.rows, system.x), system.x0
    first = equations(x)[0]
    for k in range(1, STEPS + 1):
        offset = (1 - k / STEPS) * first

        def rows(x: np.ndarray, offset: np.ndarray = offset) -> tuple[np.ndarray, np.ndarray]:
            residual, jacobian = equations(x)
            return residual - offset, jacobian

        outcome = solve(rows, x, system.step_weights, iterations=ITERATIONS, step_limit=system.limit)
        if not np.all(np.isfinite(outcome.x)):
            break
        x = outcome.x
    poses = [system.pose(k, pose) for k, pair in enumerate(system.places) for pose in pair]
    flat = [pose.full().ravel() for pose in ca.Function("poses", [system.x], poses).call([x])]
    values = system.within_limits(x[x.size - system.values.size :]).tolist()
    return KeyPoses(flat[::2], flat[1::2], dict(zip(system.parameters, values, strict=True)))
