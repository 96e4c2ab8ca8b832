"""Interface of measures of a mesh: errors of one kind, interval by interval, and what they miss in words."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from ..motion.phase_solution import PhaseSolution
from ..motion.solved_motion import SolvedMotion
from ..transcription.mesh import Mesh

#: Largest number of pieces into which an interval is split.
PIECES = 6


class Measure(ABC):
    """Errors of one kind in the intervals of a solution, beside a tolerance.

    A subclass writes :meth:`of`, :meth:`order` and :meth:`sentences`; ``MEASURES`` of :mod:`refine` lists it.

    Attributes
    ----------
    errors : list of numpy.ndarray
        Errors of the intervals, by phase (N,).
    """

    #: factor by which the foreseen errors of the pieces are to stay below the tolerance
    margin: ClassVar[float] = 2.0
    #: True if the motion may not have the cost that was found: with errors of other kinds it has, but is not the best
    falsifies_cost: ClassVar[bool] = False

    def __init__(self, solution: SolvedMotion, tolerance: float):
        self.solution, self.tolerance = solution, tolerance
        self.errors = [self.of(part) if part.mesh.count else np.zeros(0) for part in solution.phases]

    @abstractmethod
    def of(self, part: PhaseSolution) -> np.ndarray:
        """Errors of the intervals of a phase that takes time (N,), nan if they are not known."""

    @abstractmethod
    def order(self, part: PhaseSolution) -> int:
        """Power of the length of an interval with which its error goes."""

    @abstractmethod
    def sentences(self) -> list[str]:
        """Errors that do not meet the tolerance, in words, with the one to be reported first."""

    def placed(self, part: PhaseSolution, mesh: Mesh) -> Mesh:
        """The mesh of a phase with points that resolve the errors by their places; the same mesh if there are none."""
        return mesh

    @property
    def moves(self) -> bool:
        """True if such points find their places themselves."""
        return False

    @property
    def needs_limits(self) -> bool:
        """True if these mesh points find their places only if limits hold at further points."""
        return False

    @property
    def step(self) -> float:
        """Longest step from a mesh point to one that is placed, s; it gets shorter if the places are right."""
        return 0.0

    @property
    def loss(self) -> float:
        """Share of the cost by which it may be wrong, so that solutions can be compared."""
        return 0.0

    @property
    def spread(self) -> float:
        """Errors times their stretches, which must fall from pass to pass if they are above zero."""
        return 0.0

    @property
    def over_stretches(self) -> float:
        """Errors above the tolerance times the lengths of their intervals, s."""
        pairs = zip(self.solution.phases, self.errors, strict=True)
        lengths = [(np.diff(part.mesh_times), errors) for part, errors in pairs if errors.size]
        return float(sum(np.sum(length * errors * (errors > self.tolerance)) for length, errors in lengths))

    @property
    def largest(self) -> float:
        """Largest error of an interval."""
        return float(np.max(np.concatenate(self.errors), initial=0.0))

    @property
    def worst(self) -> tuple[PhaseSolution, int]:
        """Phase and interval of the largest error."""
        parts = zip(self.solution.phases, self.errors, strict=True)
        part, errors = max(parts, key=lambda pair: float(np.max(pair[1], initial=0.0)))
        return part, int(np.argmax(errors))

    def pieces(self, part: PhaseSolution) -> np.ndarray:
        """Number of pieces into which each interval of a phase is split (N,)."""
        return pieces_of(self.errors[part.program.number], self.tolerance, self.order(part), self.margin)


def pieces_of(errors: np.ndarray, tolerance: float, order: int, margin: float = Measure.margin) -> np.ndarray:
    """Return the number of pieces for intervals whose errors go with a power of their lengths (N,)."""
    needed = np.ceil((margin * np.nan_to_num(errors, nan=np.inf, posinf=np.inf) / tolerance) ** (1 / order))
    pieces = np.clip(needed, 1, PIECES).astype(int)
    pieces[errors <= tolerance] = 1
    return pieces


def split(part: PhaseSolution, measures: Sequence[Measure]) -> Mesh:
    """Return the mesh of a phase with intervals split into as many pieces as measures need."""
    return part.mesh.refined(np.max([measure.pieces(part) for measure in measures], axis=0))
