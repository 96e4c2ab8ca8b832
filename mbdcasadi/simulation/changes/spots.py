"""Places of a small problem of contact and friction, and a solution of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Spot:
    """One place of the problem.

    Attributes
    ----------
    normal, tangent : int or None
        Its rows.
    options : sequence of str
        ``"open"``, ``"closed"``, ``"sticks"``, ``"forth"``, ``"back"``, ``"free"``: what it may be; ``"pulled forth"``
        and ``"pulled back"`` at its limit at rest, if it is above that in motion.
    sliding, static : float
        Coefficients of friction.
    target : float
        Rate of the normal row of what is closed, which is the least one of what is open.
    rests : bool
        True if it does not slide until then: its rate along the tangent has the sense in which it slides.
    clear : bool
        True if it sticks only below its limit by more than rounding.
    """

    normal: int | None
    tangent: int | None
    options: Sequence[str]
    sliding: float = 0.0
    static: float = 0.0
    target: float = 0.0
    rests: bool = True
    clear: bool = False


@dataclass(frozen=True, eq=False)
class Solution:
    """A choice that meets all laws.

    Attributes
    ----------
    statuses : tuple of str
        By spot; ``"idle"`` of one that is open and does not part; ``"shares"`` of one that sticks by the row of another
        spot; ``"pulled forth"`` and ``"pulled back"`` of one at its limit that does not begin to slide.
    forces, rates : numpy.ndarray
        By row (r,).
    shares : tuple of (int, int, float)
        A spot that sticks, one that shares its friction, and how fast the latter slides beside the former.
    """

    statuses: tuple[str, ...]
    forces: np.ndarray
    rates: np.ndarray
    shares: tuple[tuple[int, int, float], ...]

    @property
    def sticking(self) -> int:
        """Number of spots that rest by friction."""
        return sum(status in ("sticks", "shares") or is_pulled(status) for status in self.statuses)


@dataclass(frozen=True, eq=False)
class Loads:
    """Loads of spots without a normal row, by the forces.

    Attributes
    ----------
    at : callable
        ``forces -> (values (s,), slopes (s, r))``.
    depend : numpy.ndarray of bool
        Loads that depend on the force of a row (s, r).
    """

    at: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
    depend: np.ndarray

    def of(self, spots: Sequence[int], rows: Sequence[int]) -> Loads:
        """Return those of some spots, of which the loads depend on some rows alone."""
        whole = np.zeros(self.depend.shape[1])

        def at(forces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            whole[rows] = forces
            values, slopes = self.at(whole)
            return values[spots], slopes[np.ix_(spots, rows)]

        return Loads(at, self.depend[np.ix_(spots, rows)])


def is_pulled(status: str) -> bool:
    """Return True for what is at its limit at rest."""
    return status.startswith("pulled")
