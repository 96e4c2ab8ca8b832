"""Efforts that make a given motion: ``[Phi_q^T, -B] [lam; u] = Q_0 - M a``, rank-checked."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from ..equations.numeric import NumericEquations
from ..errors import MechanismError, SingularityError
from ..numerics.tolerances import RANK
from ..results.trajectory import Trajectory

#: Equations of motion that no effort can balance are told from this share of the loads on.
BALANCE_TOLERANCE = 1e-6


class EffortProblem:
    """Multipliers and inputs for a motion of a mechanism.

    Parameters
    ----------
    numeric : NumericEquations
        Equations at given parameters.
    unknown : sequence of int
        Inputs to find, by position.
    """

    def __init__(self, numeric: NumericEquations, unknown: Sequence[int]):
        self.numeric = numeric
        self.unknown = [int(k) for k in unknown]
        self.redundant = False
        eom = numeric.eom
        self._labels = [eom.mechanism.inputs[k].label for k in self.unknown]
        sought = eom.u[self.unknown] if self.unknown else ca.SX(0, 1)
        slope = ca.jacobian(eom.Q, sought)
        for what, symbols in (("the efforts sought", sought), ("the multipliers", eom.lam)):
            if symbols.numel() and ca.depends_on(slope if what.startswith("the e") else eom.Q, symbols):
                raise MechanismError(
                    f"inverse_dynamics: the forces depend on {what} in a way that is not linear; "
                    "drive the mechanism instead, and read driver.effort"
                )
        rest = ca.substitute(eom.Q, sought, ca.SX.zeros(sought.numel()))
        arguments = [eom.t, eom.q, eom.v, eom.a, eom.z, eom.u, eom.p]
        terms = [eom.Phi_q, slope, rest - eom.mass_diagonal * eom.a]
        self._terms = ca.Function("terms", arguments, [ca.densify(term) for term in terms])

    def solve(self, frame: Trajectory) -> tuple[np.ndarray, np.ndarray]:
        """Multipliers (k, m) and all inputs (k, n_u) along a motion."""
        count = frame.t.size
        n, m, w = self.numeric.eom.q.numel(), self.numeric.eom.lam.numel(), len(self.unknown)
        arguments = (frame.t[None, :], frame.q.T, frame.v.T, frame.a.T, frame.z.T, frame.inputs.T, self.numeric.p)
        jacobian, slope, load = (x.full() for x in self._terms(*arguments))
        matrix = np.zeros((count, n, m + w))
        matrix[:, :, :m] = _blocks(jacobian, count, m, n).transpose(0, 2, 1)
        matrix[:, :, m:] = -_blocks(slope, count, n, w)
        right = np.broadcast_to(load.T, (count, n))
        self._check_rank(frame.t, matrix, m, w)
        unknowns = _least_norm(matrix, right)
        self._check_balance(frame.t, matrix, right, unknowns)
        u = frame.inputs.copy()
        u[:, self.unknown] = unknowns[:, m:]
        return unknowns[:, :m], u

    def _check_rank(self, times: np.ndarray, matrix: np.ndarray, m: int, w: int) -> None:
        n = matrix.shape[1]
        rank_rows = _rank(matrix[:, :, :m]) if m else np.zeros(times.size, int)
        freedom = n - int(np.median(rank_rows))
        self.redundant = bool(np.median(rank_rows) < m)
        sought = ", ".join(repr(label) for label in self._labels) or "none"
        if w < freedom:
            raise MechanismError(
                f"the motion is over-determined by {freedom - w}: the mechanism has {freedom} degrees of freedom and "
                f"{w} effort{'s' if w != 1 else ''} ({sought}) to move them; name more inputs in efforts="
            )
        if w > freedom:
            raise MechanismError(
                f"the efforts are under-determined by {w - freedom}: {w} efforts ({sought}) for {freedom} degree"
                f"{'s' if freedom != 1 else ''} of freedom; fix some of them by inputs="
            )
        short = rank_rows + w - _rank(matrix)
        if np.any(short > 0):
            k = int(np.argmax(short > 0))
            raise SingularityError(
                f"the efforts {sought} cannot make the motion at t = {times[k]:.6g} s: in that pose they work against "
                "the joints alone (a dead point for them); let them act at another place",
                time=float(times[k]),
            )

    def _check_balance(self, times: np.ndarray, matrix: np.ndarray, right: np.ndarray, unknowns: np.ndarray) -> None:
        left_over = np.abs(np.einsum("kij,kj->ki", matrix, unknowns) - right)
        size = 1e-12 + np.max(np.abs(right), axis=1, initial=0.0) + np.max(np.abs(unknowns), axis=1, initial=0.0)
        worst = np.max(left_over, axis=1) / size
        k = int(np.argmax(worst))
        if worst[k] > BALANCE_TOLERANCE:
            name = self.numeric.eom.coordinate_names[int(np.argmax(left_over[k]))]
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
    """Least-squares solutions of least norm of a batch of systems."""
    size = np.linalg.norm(matrices, axis=1, keepdims=True)
    size = np.where(size > 0, size, 1.0)
    if matrices.shape[1] == matrices.shape[2]:
        values = np.linalg.svd(matrices / size, compute_uv=False)
        if np.all(values[:, -1] > RANK * values[:, 0]):
            return np.linalg.solve(matrices, right[:, :, None])[:, :, 0]
    return np.einsum("kij,kj->ki", np.linalg.pinv(matrices, rcond=1e-11), right)
