"""Return map of a periodic solution, from the rows of its program."""

from __future__ import annotations

import casadi as ca
import numpy as np

from ...errors import ModelError
from ...numerics.rank import analyse_rank
from ...sensitivity.return_map import Stability, next_start, warn_of_a_clock
from ..program.phase_program import PhaseProgram
from ..transcription.rows import BOUNDARY
from .solved_motion import SolvedMotion


class ReturnMap:
    """The rows of a program, linearised at a solution.

    The dynamics, the impacts and the rows that close determine everything that follows from the start, the times of
    the changes among it; the boundary conditions lead from the end to the next start.
    """

    def __init__(self, solution: SolvedMotion):
        self.solution, self.program = solution, solution.program
        if not solution.problem.boundary:
            raise ModelError("stability: the problem has no boundary conditions, and so no next period")
        data = self.program.data(
            [part.numeric.p for part in solution.phases],
            solution.meshes,
            [part.segment_times for part in solution.phases],
            solution.settings.known,
        )
        x = solution.variables / self.program.scale
        self.jacobian: ca.DM = self.program.nlp.derivatives["jac_g"](x, data)[1]
        self._divide()

    def _divide(self) -> None:
        """Variables of the start, variables that follow from them, and the rows that relate them."""
        first = self.program.phases[0]
        size = first.scheme.eom.q.numel() * 2 + first.scheme.eom.z.numel()
        self.start = first.point_index(0)[:size]
        if first.initial is None:
            raise ModelError("stability: the initial conditions decide the whole start, and leave nothing to disturb")
        fixed = set(self._inputs()) | set(self.start.tolist())
        for phase in self.program.phases:
            fixed |= self._times(phase)
            if phase.count:
                fixed |= set(phase.point_index(0)[phase.scheme.point_size :].tolist())  # integrals begin at zero
        self.others = np.array([k for k in range(self.program.size) if k not in fixed], int)
        rows = self.program.rows
        equalities = [k for k, row in enumerate(rows) if row.equality]
        self.boundary = [k for k in equalities if rows[k].name.place == BOUNDARY]
        held = [k for k in equalities if rows[k].name.place != BOUNDARY]
        if any(rows[k].is_stated and rows[k].repeated for k in held):
            raise ModelError("stability: path conditions that are equalities would need inputs that follow them")
        pattern = ca.DM(self.jacobian.sparsity(), 1)[held, :][:, self.others.tolist()]
        counts = np.array(ca.sum2(pattern)).ravel()
        self.at_start = [k for k, count in zip(held, counts, strict=True) if count == 0]
        self.dynamics = [k for k, count in zip(held, counts, strict=True) if count > 0]

    def _times(self, phase: PhaseProgram) -> set[int]:
        """Places of the times that do not answer a disturbance: those that are given, and mesh points that moved."""
        fixed = set(phase.time_index.tolist()) - set(phase.stated_time_index.tolist())
        if phase.time_count and phase.begins[0] == phase.begins[1]:
            spans = zip(phase.stated_time_index.tolist(), phase.phase.time_spans, strict=False)
            fixed |= {place for place, (low, high) in spans if low == high}
        return fixed

    def _inputs(self) -> list[int]:
        """Places of the inputs, which do not answer a disturbance."""
        places = []
        for phase in self.program.phases:
            n_u = len(phase.scheme.free_inputs)
            joined = phase.scheme.point_size - n_u if phase.scheme.inputs.joined else phase.scheme.point_size
            for k in range(phase.count + 1):
                places += phase.point_index(k)[joined : phase.scheme.point_size].tolist()
            inner = phase.scheme.interval_slice("u")
            for i in range(phase.count):
                places += phase.inner_index(i)[inner].tolist()
        return places

    def stability(self) -> Stability:
        """Return the disturbances at the next start by those at this one; see :meth:`Solution.stability`."""
        begin = self.jacobian[:, self.start.tolist()].full()
        tangent = analyse_rank(begin[self.at_start]).null_columns if self.at_start else np.eye(self.start.size)
        following = self._following(-begin[self.dynamics] @ tangent)
        boundary = self.jacobian[self.boundary, :][:, self.others.tolist()].full()
        left, right = begin[self.boundary] @ tangent, -boundary @ following
        phases = self.solution.problem.phases
        if any(low < high for low, high in (phase.span for phase in phases)):
            rows = [joint.rows for phase in phases for joint in phase.restitution]
            warn_of_a_clock([phase.mechanism for phase in phases], rows, "durations are free")
        return next_start(left, right, "state it in initial=")

    def _following(self, right: np.ndarray) -> np.ndarray:
        """Changes of all that follows from the start, for right sides of the dynamics."""
        from scipy.sparse import csc_matrix
        from scipy.sparse.linalg import splu

        system = self.jacobian[self.dynamics, :][:, self.others.tolist()]
        if system.size1() != system.size2():
            more = "more" if system.size1() > system.size2() else "fewer"
            raise ModelError(
                f"stability: there are {more} conditions than what follows from the start ({system.size1()} for "
                f"{system.size2()}): durations must be free, each ended by one row that closes or one final condition, "
                "and only parameters free that a closing joint decides"
            )
        columns, rows = np.array(system.colind()), np.array(system.row())
        matrix = csc_matrix((np.array(system.nonzeros()), rows, columns), shape=system.shape)
        try:
            factors = splu(matrix)
        except RuntimeError:
            raise ModelError("stability: the start does not decide what follows (a closing joint grazes)") from None
        return np.asarray(factors.solve(right))
