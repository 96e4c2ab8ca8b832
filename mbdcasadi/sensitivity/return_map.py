"""Return map of a periodic motion: how a disturbance of one period has grown at the start of the next."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ..equations import equations
from ..equations.switching.explicit_time import explicit_time
from ..errors import ModelError, warn
from ..model.mechanism import Mechanism
from ..model.symbols import t as time
from ..numerics.tolerances import MET


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


def warn_of_a_clock(mechanisms: Iterable[Mechanism], rows: Iterable[ca.SX], ending: str) -> None:
    """Warn if mechanisms, or rows of joints that act at an instant, depend on time, and the period does not.

    Parameters
    ----------
    mechanisms : iterable of Mechanism
        Mechanisms of the phases.
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
    residual = np.max(np.abs(left @ matrix - right), initial=0.0)
    if rank < left.shape[1]:
        raise ModelError(
            f"stability: the boundary conditions decide {rank} of {left.shape[1]} quantities of the next start; "
            f"relate each of the others to the end, or {remedy}"
        )
    if residual > MET * max(1.0, float(np.max(np.abs(right), initial=0.0))):
        raise ModelError(
            "stability: a disturbed motion does not meet the boundary conditions any more: they hold more than "
            "the next start (for instance a length or a duration, which inputs would have to keep)"
        )
    multipliers = np.linalg.eigvals(matrix)
    return Stability(matrix, multipliers[np.argsort(-np.abs(multipliers))])
