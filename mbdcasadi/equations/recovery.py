"""Many states at once: projection onto the constraints, accelerations and multipliers.

One compiled step is mapped over all times; the Newton iteration runs over the
whole batch until the worst point has converged.
"""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from ..numerics.evaluation import Evaluator
from ..numerics.least_squares import largest
from ..numerics.tolerances import ON_CONSTRAINTS, PROJECTIONS
from .derivation import Equations
from .numeric import NumericEquations
from .saddle import ONTO_ROWS, SHIFTED, Saddle

#: Relative residuals from and up to which refined steps are tried, which find what the shift of the others holds back,
#: and the share of them that each step may leave.
HELD_BACK, FAR_AWAY, LEFT_BY_STEP = 5e-14, 1e-3, 0.1
#: ``q, v, a, z, lam, u`` by row.
SixArrays = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]


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

    @property
    def position_step(self) -> ca.Function:
        """``(t, q, z, p, weights) -> (q, |Phi|)``: one step towards ``Phi = 0``, and the residual after it."""
        return self._step(_position_step).function

    @property
    def velocity_step(self) -> ca.Function:
        """``(t, q, v, z, p, weights) -> (v, |Phi_q v - nu|)``: towards ``Phi_q v = nu``, and the residual after it."""
        return self._step(_velocity_step).function

    def _step(self, make: Callable[..., ca.Function], *, refined: bool = False) -> Evaluator:
        eom = self.numeric.eom
        return eom.shared.get_or_create((make, refined), lambda: Evaluator(make(eom, refined=refined)))

    def positions(self, t: np.ndarray, q: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Bring coordinates (k, n) onto ``Phi = 0``."""
        if not self.numeric.eom.Phi.numel() or not t.size:
            return q
        p, weights = self.numeric.p, self.numeric.projection_weights
        self.left_over = 0.0
        before, left = np.inf, None
        for _ in range(PROJECTIONS):
            moved, size = self._step(_position_step).rows(t[:, None], q, z, p, weights)
            worst = largest(size)
            if not np.isfinite(worst) or worst >= before / 2:
                self.left_over = self.left_over or worst
                break
            self.left_over = worst
            q, before, left = moved, worst, size
            if worst <= ON_CONSTRAINTS * (1 + largest(q)):
                break
        if left is None:
            return q

        def step(here: np.ndarray, poses: np.ndarray) -> list[np.ndarray]:
            return self._step(_position_step, refined=True).rows(t[here, None], poses, z[here], p, weights)

        q, self.left_over = _refined(step, q, left)
        return q

    def velocities(self, t: np.ndarray, q: np.ndarray, v: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Bring velocities (k, n) onto ``Phi_q v = nu``."""
        if not self.numeric.eom.lam.numel() or not t.size:
            return v
        p, weights = self.numeric.p, self.numeric.projection_weights
        v, left = self._step(_velocity_step).rows(t[:, None], q, v, z, p, weights)

        def step(here: np.ndarray, velocities: np.ndarray) -> list[np.ndarray]:
            refined = self._step(_velocity_step, refined=True)
            moved, after, off = refined.rows(t[here, None], q[here], velocities, z[here], p, weights)
            # what a pose is off by, in a motion that rows hardly resist, counts in velocities by the square of that
            return [moved, np.where(off > HELD_BACK * (1 + largest(q)), np.inf, after)]

        return _refined(step, v, left)[0]

    def accelerations(
        self, t: np.ndarray, q: np.ndarray, v: np.ndarray, z: np.ndarray, u: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Accelerations (k, n) and multipliers (k, m)."""
        return self.numeric.accelerations_of_rows(t[:, None], q, v, z, u, redundant=self.redundant)

    def complete(self, t: np.ndarray, q: np.ndarray, v: np.ndarray, z: np.ndarray, u: np.ndarray) -> SixArrays:
        """Return ``q, v, a, z, lam, u`` on the constraints at states near to them, by row."""
        q = self.positions(t, q, z)
        return self.loaded(t, q, self.velocities(t, q, v, z), z, u)

    def loaded(self, t: np.ndarray, q: np.ndarray, v: np.ndarray, z: np.ndarray, u: np.ndarray) -> SixArrays:
        """Return ``q, v, a, z, lam, u`` at states that are on the constraints, by row."""
        a, lam = self.accelerations(t, q, v, z, u)
        return q, v, a, z, lam, u


def _refined(
    step: Callable[[np.ndarray, np.ndarray], list[np.ndarray]], states: np.ndarray, left: np.ndarray
) -> tuple[np.ndarray, float]:
    """Take refined steps from states by row as long as they leave little of a residual; and the largest that is left.

    A step that leaves more would lead to another branch, or rows contradict each other: the state stays as it is.

    Parameters
    ----------
    step : callable
        ``(places, states there) -> (states, residuals)``.
    left : numpy.ndarray
        Residuals of the states (k, 1).
    """
    states, left, size = states.copy(), left.ravel().copy(), 1 + largest(states)
    here = np.flatnonzero((left > HELD_BACK * size) & (left < FAR_AWAY * size))
    while here.size:
        moved, after = step(here, states[here])
        is_better = after.ravel() <= LEFT_BY_STEP * left[here]
        here = here[is_better]
        states[here], left[here] = moved[is_better], after.ravel()[is_better]
        here = here[left[here] > HELD_BACK * size]
    return states, largest(left)


def _position_step(eom: Equations, *, refined: bool) -> ca.Function:
    weights, saddle = projection_saddle(eom, eom.position_rows.tolist(), refined=refined)
    moved = ca.densify(eom.q - saddle.project(eom.Phi))
    left = ca.Function("left", [eom.t, eom.q, eom.z, eom.p], ca.cse([_largest(eom.Phi)]))
    known = [eom.t, eom.q, eom.z, eom.p, weights]
    return ca.Function("position_step", known, [moved, left(eom.t, moved, eom.z, eom.p)])


def _velocity_step(eom: Equations, *, refined: bool) -> ca.Function:
    """A refined step returns ``|Phi|``, too."""
    weights, saddle = projection_saddle(eom, list(range(eom.lam.numel())), refined=refined)
    v = eom.v
    for _ in range(1 if refined else 2):  # the second step removes the rounding of the first
        v = v - saddle.project(eom.Phi_q @ v - eom.nu)
    left = [_largest(part) for part in (eom.Phi_q @ v - eom.nu, *([eom.Phi] if refined else []))]
    return ca.Function("velocity_step", [eom.t, eom.q, eom.v, eom.z, eom.p, weights], [ca.densify(v), *left])


def _largest(residual: ca.SX) -> ca.SX:
    return ca.norm_inf(ca.densify(residual))


def projection_saddle(eom: Equations, rows: list[int], *, refined: bool = False) -> tuple[ca.SX, Saddle]:
    """Symbols of weights (n,), the same for all rows, and the system of some rows in them; made once for a mechanism.

    The shift keeps a step short if the pose is nearly singular: there
    a residual of rounding size would else throw the state onto another
    branch. Repeated steps converge nevertheless, but slowly in motions that the rows resist little, as the bending of
    long chains: refined steps find these. A tree needs no shift. Positions and velocities
    share the factors, unless there are velocity-level rows.
    """
    cache, refinement = eom.mechanism.cache, ONTO_ROWS if refined else SHIFTED if eom.has_loops else None
    weights = cache.get_or_create("projection weights", lambda: ca.SX.sym("w", eom.q.numel()))

    def make() -> Saddle:
        return Saddle(weights, eom.Phi_q[rows, :], eom.angular_rows[rows], refinement, is_shared=True)

    return weights, cache.get_or_create(("projection saddle", refined, *rows), make, bounded=True)
