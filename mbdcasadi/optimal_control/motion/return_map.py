"""Stability of a periodic motion: how a disturbance of one period has grown at the start of the next."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ...equations import equations
from ...equations.switching.explicit_time import explicit_time
from ...errors import ModelError, warn
from ...model.mechanism import Mechanism
from ...model.symbols import t as time
from ...numerics.rank import analyse_rank
from ..program.phase_program import PhaseProgram
from ..transcription.rows import BOUNDARY
from .solved_motion import SolvedMotion

#: Share of the largest slope by which the next start may miss the boundary conditions.
CLOSURE_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Stability:
    """A periodic motion to first order, from the start of one period to that of the next.

    Attributes
    ----------
    matrix : numpy.ndarray
        Monodromy matrix (d, d) of the return map, in some coordinates of the disturbances at the start that
        constraints and initial conditions allow.
    multipliers : numpy.ndarray
        Floquet multipliers (d,), its eigenvalues, the largest first.
    """

    matrix: np.ndarray
    multipliers: np.ndarray

    @property
    def is_stable(self) -> bool:
        """True if disturbances die out: all multipliers are inside the unit circle."""
        return bool(np.all(np.abs(self.multipliers) < 1))

    def __repr__(self) -> str:
        kind = "stable" if self.is_stable else "not stable"
        values = ", ".join(f"{x.real:.6g}" if abs(x.imag) < 1e-12 else f"{x:.6g}" for x in self.multipliers)
        return f"Stability: {kind}, Floquet multipliers {values}"


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
            [part.numeric.p for part in solution.phases], solution.meshes, [p.segment_times for p in solution.phases]
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
            n_u = phase.scheme.eom.u.numel()
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


def warn_of_a_clock(mechanisms: Iterable[Mechanism], rows: Iterable[ca.SX], ending: str) -> None:
    """Warn if mechanisms, or rows of joints that act at an instant, depend on time, and the period does not.

    Parameters
    ----------
    mechanisms : iterable of Mechanism
        Those of the phases.
    rows : iterable of casadi.SX
        What is to contain no time besides.
    ending : str
        Why the period may vary, in words.
    """
    timed = any(explicit_time(equations(mechanism)).depends for mechanism in mechanisms)
    if timed or any(ca.depends_on(row, time) for row in rows):
        warn(
            f"stability: the motion depends on time, and {ending}: time is taken to begin anew with each period; if it "
            "goes on, as the clock of a table that shakes, let the motion last a given period of it"
        )


def next_start(left: np.ndarray, right: np.ndarray, remedy: str) -> Stability:
    """Return the return map for ``left x_next = right x``, in coordinates of the start."""
    matrix, _, rank, _ = np.linalg.lstsq(left, right, rcond=1e-9)
    missed = np.max(np.abs(left @ matrix - right), initial=0.0)
    if rank < left.shape[1]:
        raise ModelError(
            f"stability: the boundary conditions decide {rank} of {left.shape[1]} quantities of the next start; "
            f"relate each of the others to the end, or {remedy}"
        )
    if missed > CLOSURE_TOLERANCE * max(1.0, float(np.max(np.abs(right), initial=0.0))):
        raise ModelError(
            "stability: a disturbed motion does not meet the boundary conditions any more: they hold more than "
            "the next start (for instance a length or a duration, which inputs would have to keep)"
        )
    multipliers = np.linalg.eigvals(matrix)
    return Stability(matrix, multipliers[np.argsort(-np.abs(multipliers))])
