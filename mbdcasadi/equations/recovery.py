"""Many states at once: projection onto the constraints, accelerations and multipliers.

One compiled step is mapped over all times; the Newton iteration runs over the
whole batch until the worst point has converged.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from ..numerics.evaluation import Evaluator
from ..numerics.lazy import cached_property
from ..numerics.least_squares import largest
from .derivation import Equations
from .numeric import NumericEquations
from .saddle import shifted

#: Residual of a constraint, relative to 1 + |q|, that is rounding.
ROUNDING = 1e-14
#: Steps of a projection of positions, at most.
PROJECTIONS = 10
#: ``(t, q, v, z, p, u given) -> u``: the inputs at states, each by column.
InputRule = Callable[[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray], np.ndarray]


class Recovery:
    """Consistent positions, velocities, accelerations and multipliers for batches of states.

    Parameters
    ----------
    redundant : bool
        True if rows are dependent: solves are then regularised, multipliers of least norm.
    """

    def __init__(self, numeric: NumericEquations, *, redundant: bool):
        self.numeric = numeric
        self.redundant = redundant
        #: largest ``|Phi|`` that was left by the last projection
        self.left_over = 0.0

    @cached_property
    def position_step(self) -> ca.Function:
        """``(t, q, p, weights) -> (q, |Phi|)``: one step towards ``Phi = 0``, and the residual after it."""
        return self._kept("position step", lambda: _position_step(self.numeric.eom))

    @cached_property
    def velocity_step(self) -> ca.Function:
        """``(t, q, v, p, weights) -> v`` with ``Phi_q v = nu``."""
        return self._kept("velocity step", lambda: _velocity_step(self.numeric.eom))

    @cached_property
    def _position_rows(self) -> Evaluator:
        return self._kept("position step by row", lambda: Evaluator(self.position_step))

    @cached_property
    def _velocity_rows(self) -> Evaluator:
        return self._kept("velocity step by row", lambda: Evaluator(self.velocity_step))

    def _kept(self, key: str, make: Callable[[], Any]) -> Any:
        return self.numeric.eom.shared.get_or_create(key, make)

    def positions(self, t: np.ndarray, q: np.ndarray) -> np.ndarray:
        """Bring coordinates (k, n) onto ``Phi = 0``."""
        if not self.numeric.eom.Phi.numel() or not t.size:
            return q
        p, weights = self.numeric.p, self.numeric.projection_weights
        self.left_over = 0.0
        before = np.inf
        for _ in range(PROJECTIONS):
            moved, size = self._position_rows.rows(t[:, None], q, p, weights)
            worst = largest(size)
            if not np.isfinite(worst) or worst >= before / 2:
                self.left_over = self.left_over or worst
                break
            self.left_over = worst
            q, before = moved, worst
            if worst <= ROUNDING * (1 + largest(q)):
                break
        return q

    def velocities(self, t: np.ndarray, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Bring velocities (k, n) onto ``Phi_q v = nu``."""
        if not self.numeric.eom.lam.numel() or not t.size:
            return v
        weights = self.numeric.projection_weights
        return self._velocity_rows.rows(t[:, None], q, v, self.numeric.p, weights)[0]

    def accelerations(
        self, t: np.ndarray, q: np.ndarray, v: np.ndarray, z: np.ndarray, u: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Accelerations (k, n) and multipliers (k, m)."""
        return self.numeric.accelerations_of_rows(t[:, None], q, v, z, u, redundant=self.redundant)

    def refine(self, rule: InputRule | None = None) -> Callable[..., tuple[np.ndarray, ...]]:
        """Return the function by which a trajectory interpolates; see ``Trajectory.at``."""

        def back_onto_constraints(
            t: np.ndarray, q: np.ndarray, v: np.ndarray, z: np.ndarray, u: np.ndarray
        ) -> tuple[np.ndarray, ...]:
            q = self.positions(t, q)
            v = self.velocities(t, q, v)
            if rule is not None:
                u = rule(t, q, v, z, u)
            a, lam = self.accelerations(t, q, v, z, u)
            return q, v, a, lam, u

        return back_onto_constraints


def _position_step(eom: Equations) -> ca.Function:
    weights, towards = _towards(eom, eom.position_rows.tolist())
    moved = ca.densify(eom.q - towards(eom.Phi))
    left = ca.Function("left", [eom.t, eom.q, eom.p], ca.cse([ca.norm_inf(ca.densify(eom.Phi))]))
    return ca.Function("position_step", [eom.t, eom.q, eom.p, weights], [moved, left(eom.t, moved, eom.p)])


def _velocity_step(eom: Equations) -> ca.Function:
    weights, towards = _towards(eom, list(range(eom.lam.numel())))
    v = eom.v
    for _ in range(2):  # the second step removes the rounding of the first
        v = v - towards(eom.Phi_q @ v - eom.nu)
    return ca.Function("velocity_step", [eom.t, eom.q, eom.v, eom.p, weights], [ca.densify(v)])


def _towards(eom: Equations, rows: list[int]) -> tuple[ca.SX, Callable[[ca.SX], ca.SX]]:
    """Weights w, and the step ``W⁻¹ J^T (J W⁻¹ J^T + epsilon D)⁻¹ r`` of some rows by residual, orthogonal in w.

    The shift keeps the step short if the pose is nearly singular: there
    a residual of rounding size would else throw the state onto another
    branch. Repeated steps converge nevertheless. Positions and velocities share the factors, unless there are
    velocity-level rows.
    """

    def make() -> tuple[ca.SX, Callable[[ca.SX], ca.SX]]:
        weights, jacobian = ca.SX.sym("w", eom.q.numel()), eom.Phi_q[rows, :]
        over = ca.diag(1 / weights) @ jacobian.T
        over, schur = ca.cse([over, jacobian @ over])  # what follows repeats little, and takes long to look through
        factors = shifted(schur, eom.angular_rows[rows])
        return weights, lambda residual: over @ ca.ldl_solve(ca.densify(residual), *factors)

    return eom.mechanism.cache.get_or_create(("step towards rows", *rows), make, bounded=True)
