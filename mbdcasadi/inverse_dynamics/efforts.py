"""Efforts that make a given motion: ``M a + Phi_q^T lam - Q(lam, u) = 0``, rank-checked.

Linear unless friction depends on reactions; then it is solved by Newton's method at all times together.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from ..arguments.least_efforts import LeastEfforts
from ..equations.numeric import NumericEquations
from ..errors import MechanismError, SingularityError
from ..numerics.tolerances import DEPENDENT, MET, RANK
from ..results.trajectory import Trajectory

#: Steps of Newton's method, halvings of a step, and the relative step that is rounding.
NEWTON_STEPS, HALVINGS, NO_STEP = 60, 12, 1e-13


class EffortProblem:
    """Multipliers and inputs for a motion of a mechanism.

    Parameters
    ----------
    unknown : sequence of int
        Inputs to find, by position.
    least : LeastEfforts
        The same inputs, of which the least are found if they are more than the degrees of freedom.
    """

    def __init__(self, numeric: NumericEquations, unknown: Sequence[int], least: LeastEfforts):
        self.numeric, self._least = numeric, least
        self.unknown = [int(k) for k in unknown]
        self.redundant = False
        eom = numeric.eom
        self._labels = [eom.mechanism.inputs[k].label for k in self.unknown]
        efforts = eom.u[self.unknown] if self.unknown else ca.SX(0, 1)
        if efforts.numel() and ca.depends_on(ca.jacobian(eom.Q, efforts), efforts):
            raise MechanismError(
                "inverse_dynamics: the forces depend on the unknown efforts in a way that is not linear; drive the "
                "mechanism instead, and read driver.effort"
            )
        unknowns = ca.vertcat(eom.lam, efforts)
        residual = eom.mass_diagonal * eom.a + eom.Phi_q.T @ eom.lam - eom.Q
        # nothing acts on the angle of a point mass, whatever its motion
        self._moved = [k for k in range(residual.numel()) if not residual[k].is_zero()]
        residual = residual[self._moved]
        slope = ca.jacobian(residual, unknowns)
        self._linear = not ca.depends_on(slope, unknowns)
        arguments = [eom.t, eom.q, eom.v, eom.a, eom.z, eom.lam, eom.u, eom.p]
        self._terms = ca.Function("terms", arguments, [ca.densify(residual), ca.densify(slope)])

    def solve(self, frame: Trajectory) -> tuple[np.ndarray, np.ndarray]:
        """Multipliers (k, m) and all inputs (k, n_u) along a motion."""
        m, w = self.numeric.eom.lam.numel(), len(self.unknown)
        unknowns = np.zeros((frame.t.size, m + w))
        residual, matrix = self._at(frame, unknowns)
        if self._linear:
            right = -residual
            spare = self._check_rank(frame.t, matrix, m, w)
            unknowns = self._least_efforts(frame.t, matrix, right) if spare else _least_norm(matrix, right)
        else:
            unknowns = self._by_newton(frame, unknowns)
            residual, matrix = self._at(frame, unknowns)
            right = np.einsum("kij,kj->ki", matrix, unknowns) - residual
            if self._check_rank(frame.t, matrix, m, w):
                names = ", ".join(map(repr, self._labels))
                raise MechanismError(
                    f"inverse_dynamics: {names} are more than the degrees of freedom, and friction depends on the "
                    "reactions, so that the problem is not linear; fix some of them by inputs="
                )
        self._check_balance(frame.t, matrix, right, unknowns)
        lam = unknowns[:, :m]
        if self.redundant and self._linear:
            lam = self.numeric.of_least_norm(frame.t, frame.q, lam)
        return lam, self._inputs(frame, unknowns)

    def _inputs(self, frame: Trajectory, unknowns: np.ndarray) -> np.ndarray:
        u = frame.inputs.copy()
        u[:, self.unknown] = unknowns[:, self.numeric.eom.lam.numel() :]
        return u

    def _at(self, frame: Trajectory, unknowns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Residuals (k, n) and their slopes (k, n, m + w)."""
        n, m, count = len(self._moved), self.numeric.eom.lam.numel(), frame.t.size
        motion = (frame.t[None, :], frame.q.T, frame.v.T, frame.a.T, frame.z.T)
        u = self._inputs(frame, unknowns)
        residual, slope = (x.full() for x in self._terms(*motion, unknowns[:, :m].T, u.T, self.numeric.p))
        return np.broadcast_to(residual.T, (count, n)), _blocks(slope, count, n, unknowns.shape[1])

    def _by_newton(self, frame: Trajectory, unknowns: np.ndarray) -> np.ndarray:
        """Solutions by Newton's method at all times at once, the step of each shortened until its residual falls."""
        residual, matrix = self._at(frame, unknowns)
        for _ in range(NEWTON_STEPS):
            step = -_least_norm(matrix, residual)
            before, share = np.linalg.norm(residual, axis=1), np.ones(frame.t.size)
            for _ in range(HALVINGS):
                moved, _ = self._at(frame, unknowns + share[:, None] * step)
                worse = ~(np.linalg.norm(moved, axis=1) < before) & (before > 0)
                if not np.any(worse):
                    break
                share = np.where(worse, share / 2, share)
            share = np.where(worse, 0.0, share)  # rounding: nothing is better there
            unknowns = unknowns + share[:, None] * step
            residual, matrix = self._at(frame, unknowns)
            if np.all(share[:, None] * np.abs(step) <= NO_STEP * (1 + np.abs(unknowns))):
                break
        return unknowns

    def _least_efforts(self, times: np.ndarray, matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
        """Multipliers and efforts (k, m + w), the efforts of least weighted sum of squares within their limits."""
        m = self.numeric.eom.lam.numel()
        efforts = np.array(
            [self._least.beside(a[:, :m], a[:, m:], b, float(t)) for t, a, b in zip(times, matrix, right, strict=True)]
        )
        rest = right - np.einsum("kij,kj->ki", matrix[:, :, m:], efforts)
        return np.c_[_least_norm(matrix[:, :, :m], rest), efforts]

    def _check_rank(self, times: np.ndarray, matrix: np.ndarray, m: int, w: int) -> int:
        """Number of efforts beyond the degrees of freedom; errors for too few, and in poses in which they fail."""
        n = matrix.shape[1]
        rank_rows = _rank(matrix[:, :, :m]) if m else np.zeros(times.size, int)
        freedom = n - int(np.median(rank_rows))
        self.redundant = bool(np.median(rank_rows) < m)
        names = ", ".join(repr(label) for label in self._labels) or "none"
        if w < freedom:
            raise MechanismError(
                f"the motion is over-determined by {freedom - w}: the mechanism has {freedom} degrees of freedom and "
                f"{w} effort{'s' if w != 1 else ''} ({names}) to move them; name more inputs in efforts="
            )
        short = np.minimum(rank_rows + w, n) - _rank(matrix)
        if np.any(short > 0):
            k = int(np.argmax(short > 0))
            raise SingularityError(
                f"the efforts {names} cannot make the motion at t = {times[k]:.6g} s: in that pose they work against "
                "the joints alone (a dead point for them); apply them at another place",
                time=float(times[k]),
            )
        return w - freedom

    def _check_balance(self, times: np.ndarray, matrix: np.ndarray, right: np.ndarray, unknowns: np.ndarray) -> None:
        left_over = np.abs(np.einsum("kij,kj->ki", matrix, unknowns) - right)
        size = 1e-12 + np.max(np.abs(right), axis=1, initial=0.0) + np.max(np.abs(unknowns), axis=1, initial=0.0)
        worst = np.max(left_over, axis=1) / size
        k = int(np.argmax(worst))
        if worst[k] > MET:
            name = self.numeric.eom.coordinate_names[self._moved[int(np.argmax(left_over[k]))]]
            raise MechanismError(
                f"the efforts cannot make the motion at t = {times[k]:.6g} s: the equation of motion of {name} is left "
                f"with {np.max(left_over[k]):.3g} (N or N m)",
                time=float(times[k]),
            )


def _blocks(stacked: np.ndarray, count: int, rows: int, columns: int) -> np.ndarray:
    """Matrices side by side (rows, count * columns) as (count, rows, columns)."""
    if stacked.shape[1] == columns:  # does not vary: CasADi evaluated it once
        stacked = np.tile(stacked, (1, count))
    return stacked.reshape(rows, count, columns).transpose(1, 0, 2)


def _rank(matrices: np.ndarray) -> np.ndarray:
    """Rank of each matrix of a batch, columns scaled to size one."""
    size = np.linalg.norm(matrices, axis=1, keepdims=True)
    values = np.linalg.svd(matrices / np.where(size > 0, size, 1.0), compute_uv=False)
    return np.sum(values > RANK * np.max(values, axis=1, keepdims=True), axis=1)


def _least_norm(matrices: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Least-squares solutions of least norm of a batch of systems, which :func:`least_norm` takes one by one."""
    size = np.linalg.norm(matrices, axis=1, keepdims=True)
    size = np.where(size > 0, size, 1.0)
    if matrices.shape[1] == matrices.shape[2]:
        values = np.linalg.svd(matrices / size, compute_uv=False)
        if np.all(values[:, -1] > RANK * values[:, 0]):
            return np.linalg.solve(matrices, right[:, :, None])[:, :, 0]
    return np.einsum("kij,kj->ki", np.linalg.pinv(matrices, rcond=DEPENDENT), right)
