"""The point nearest to an estimate that meets rows and conditions: base of the problems of pose and velocity."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from typing import Any, ClassVar

import numpy as np

from ..equations.numeric import NumericEquations
from ..errors import MechanismError
from ..model.conditions import Condition
from ..numerics.least_squares import largest
from ..numerics.nearest import multipliers_at, nearest, project_with_inequalities
from ..numerics.newton import Equations, Outcome, solve
from ..numerics.tolerances import MET

#: Violation of an inequality up to which it counts as met, in the same units.
INEQUALITY_TOLERANCE = 1e-7


class NearestProblem(ABC):
    """Rows of a mechanism at one time, and conditions.

    Parameters
    ----------
    t : float
        Time, s.
    """

    #: error of rows or conditions that cannot be met
    refusal: ClassVar[type[MechanismError]]

    def __init__(self, numeric: NumericEquations, conditions: Sequence[Condition], t: float):
        self.numeric, self.t = numeric, t
        self.equalities = [c for c in conditions if c.equality]
        self.inequalities = [c for c in conditions if not c.equality]
        #: sizes that the unknowns typically have (n,)
        self.sizes = np.ones(numeric.eom.q.numel())

    @abstractmethod
    def rows_with(self, conditions: Sequence[Condition]) -> Equations:
        """Return rows and conditions as one system."""

    @abstractmethod
    def _meet(self, conditions: list[Condition], start: np.ndarray, estimate: np.ndarray) -> np.ndarray:
        """Nearest point at which conditions hold as equalities; raises the refusal if there is none."""

    @abstractmethod
    def _relative(self, conditions: Sequence[Condition], x: np.ndarray) -> np.ndarray:
        """Values of conditions at a point (k,), by which they are compared."""

    @abstractmethod
    def _optimised(self, start: np.ndarray, estimate: np.ndarray) -> np.ndarray | None:
        """A point under all conditions by IPOPT, or None."""

    @abstractmethod
    def _limits_missed(self) -> MechanismError:
        """Error if no point under all conditions is found."""

    def _solve(self, rows: Equations, start: np.ndarray, **options: Any) -> Outcome:
        return solve(rows, start, self.numeric.weights, sizes=self.sizes, **options)

    def _nearest(self, rows: Equations, x: np.ndarray, estimate: np.ndarray) -> np.ndarray:
        return nearest(rows, x, estimate, self.numeric.weights, sizes=self.sizes)

    def _refined(
        self, x: np.ndarray, equalities: Sequence[Condition], inequalities: Sequence[Condition]
    ) -> np.ndarray | None:
        """The point on the rows near to one that IPOPT found; None if there is none, or an inequality is broken."""
        outcome = self._solve(self.rows_with(equalities), x, iterations=20)
        met = largest(np.maximum(self._relative(inequalities, outcome.x), 0)) <= INEQUALITY_TOLERANCE
        return outcome.x if outcome.converged and met else None

    def _within(self, start: np.ndarray, estimate: np.ndarray) -> np.ndarray:
        """Nearest point under the inequalities, from the nearest one without them."""
        obstacle: MechanismError | None = None
        try:
            point = self._active_set(start, estimate)
        except self.refusal as error:
            point, obstacle = None, error
        if point is not None:
            return point
        # on the way to the limits the linkage locks, or they alternate: look for a point within all of them at once
        start_within = self._optimised(start, estimate)
        if start_within is None:
            raise obstacle or self._limits_missed()
        near = np.flatnonzero(np.abs(self._relative(self.inequalities, start_within)) <= MET)
        try:
            point = self._active_set(start_within, estimate, near.tolist())
        except self.refusal:
            point = None
        return start_within if point is None else point

    def _active_set(self, start: np.ndarray, estimate: np.ndarray, active: Sequence[int] = ()) -> np.ndarray | None:
        limits, last = self.inequalities, start

        def held(active: Sequence[int]) -> list[Condition]:
            return [*self.equalities, *[limits[k] for k in active]]

        def meet(active: Sequence[int]) -> np.ndarray:
            nonlocal last
            last = self._meet(held(active), last, estimate)
            return last

        def pushes(x: np.ndarray, active: Sequence[int]) -> np.ndarray:
            jacobian = self.rows_with(held(active))(x)[1]
            return multipliers_at(jacobian, x - estimate, self.numeric.weights)[len(jacobian) - len(active) :]

        return project_with_inequalities(meet, lambda x: self._relative(limits, x), pushes, active)


def residuals_by_element(elements: Iterable[object], values: np.ndarray) -> dict[str, float]:
    """Return the largest absolute value of the rows of each element, by its name, the largest first."""
    sizes: dict[str, float] = {}
    for element, value in zip(elements, values, strict=True):
        name = element.name  # type: ignore[attr-defined]
        sizes[name] = max(sizes.get(name, 0.0), abs(float(value)))
    return dict(sorted(sizes.items(), key=lambda item: -item[1]))
