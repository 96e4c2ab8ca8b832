"""A sample of a motion in the states of an estimator, with its slopes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from scipy.integrate import RK45

from ..linear.tree_model import TreeModel, solved

#: Newton's steps to a pose, and the change below which the next one would be rounding (m or rad).
POSE_STEPS, POSE_CHANGE = 20, 1e-7


@dataclass(frozen=True)
class TreePoint:
    """Coordinates, velocities and first-order states of the tree (n_s,), and their slopes by the states (n_s, n_x)."""

    s: np.ndarray
    by_x: np.ndarray


class StageFunctions:
    """Motion over a sample and measurements, in states ``x = (positions, rates, first-order states, unknown)``.

    Parameters
    ----------
    model : TreeModel
        States and equations.
    measured : casadi.SX
        What is measured (n_y,).
    disturbed, unknown : sequence of int
        Places of the inputs that disturbances are added to, and of the parameters that are states.
    length : float
        Sample, s.
    steps : int
        Runge-Kutta steps over it.
    """

    def __init__(
        self,
        model: TreeModel,
        measured: ca.SX,
        disturbed: Sequence[int],
        unknown: Sequence[int],
        length: float,
        steps: int,
    ):
        self.model, self.disturbed, self.unknown = model, list(disturbed), list(unknown)
        eom = model.eom
        self._n, self._length = model.q.numel(), length
        x, t, q, v, p = model.state, eom.t, model.q, model.v, eom.p
        s = ca.vertcat(q, v, eom.z)
        rows, speeds, *_ = (pose := model.pose())(t, q, v, eom.z, p)
        theta, known = _picked(p, self.unknown), [t, q, v, eom.z, p]
        slopes = [ca.jacobian(rows, theta), ca.jacobian(speeds, theta)]
        self._pose, self._pose_by_unknown = pose, model.function("estimator_pose", known, slopes)
        state = model.along(x)
        self._state = model.function("estimator_state", known, [state, ca.jacobian(state, ca.vertcat(s, theta))])
        y, moving = model.along(measured), ca.vertcat(s, _picked(eom.u, self.disturbed), theta)
        self._output = model.function("estimator_output", model.at, [y, ca.jacobian(y, moving)])
        self._flow = self._motion(length, steps)

    def _motion(self, length: float, steps: int) -> ca.Function:
        """``(t, s, u, p, y) -> s at the end, slopes by y = (s, disturbances, unknown)``, of order 5."""
        model, eom, n = self.model, self.model.eom, self._n
        rate = model.function("estimator_rate", model.at, [ca.vertcat(model.v, model.rates)])
        t, u, p = (ca.MX.sym("known", size) for size in (1, eom.u.numel(), eom.p.numel()))
        count = 2 * n + eom.z.numel()
        y = ca.MX.sym("y", count + len(self.disturbed) + len(self.unknown))
        added, values = y[count : count + len(self.disturbed)], y[count + len(self.disturbed) :]
        whole = u + ca.DM.eye(u.numel())[:, self.disturbed] @ added
        inserted = p + ca.DM.eye(p.numel())[:, self.unknown] @ (values - _picked(p, self.unknown))
        h, s, now = length / steps, ca.MX.sym("s", count), ca.MX.sym("now")
        stages: list[ca.MX] = []
        for c, row in zip(RK45.C, RK45.A, strict=True):
            at = s + h * sum((a * k for a, k in zip(row, stages, strict=False)), ca.MX.zeros(count))
            stages.append(rate(now + c * h, at[:n], at[n : 2 * n], at[2 * n :], u, p))
        moved = s + h * sum(b * k for b, k in zip(RK45.B, stages, strict=True))
        step = ca.Function("step", [ca.vertcat(s, now, u, p)], [ca.vertcat(moved, now + h, u, p)])
        s = step.fold(steps)(ca.vertcat(y[:count], t, whole, inserted))[:count]
        return ca.Function("estimator_flow", [t, u, p, y], [s, ca.densify(ca.jacobian(s, y))])

    # --- points ------------------------------------------------------------------------------------------------
    def parameters(self, x: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Values of the parameters with the unknown ones of a state."""
        whole = p.copy()
        whole[self.unknown] = x[x.size - len(self.unknown) :]
        return whole

    def complete(self, t: float, x: np.ndarray, p: np.ndarray, near: np.ndarray) -> TreePoint | None:
        """Close the loops in a state, from coordinates of the tree that are near; None if they do not close."""
        n, positions, rates = self._n, self.model.independent.positions.numel(), self.model.independent.rates.numel()
        p, q, still, last = self.parameters(x, p), near[:n].copy(), np.zeros(n), np.inf
        z = x[positions + rates : x.size - len(self.unknown)]
        for _ in range(POSE_STEPS):
            rows, _, by_q, *_ = (m.full() for m in self._pose(t, q, still, z, p))
            miss = rows.ravel()
            miss[n - positions :] -= x[:positions]
            change = solved(by_q, -miss)
            if change is None:
                return None
            q, last = q + change, float(np.max(np.abs(change), initial=0.0))
            if last <= POSE_CHANGE:
                break
        if not last <= POSE_CHANGE:
            return None
        _, speeds, _, by_v, *_ = (m.full() for m in self._pose(t, q, still, z, p))
        speeds[n - rates :, 0] -= x[positions : positions + rates]
        v = solved(by_v, -speeds.ravel())
        if v is None:
            return None
        known = t, q, v, z, p
        slopes = self.model.slopes(*(m.full() for m in (*self._pose(*known)[2:], *self._pose_by_unknown(*known))))
        return None if slopes is None else TreePoint(np.concatenate([q, v, z]), slopes)

    def advance(
        self, t: float, x: np.ndarray, point: TreePoint, u: np.ndarray, d: np.ndarray, p: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """State a sample later, its slopes by the state and the disturbances, and coordinates of the tree there."""
        theta = x[x.size - len(self.unknown) :]
        end, slopes = (m.full() for m in self._flow(t, u, p, np.concatenate([point.s, d, theta])))
        count, m = point.s.size, d.size
        by_theta = np.eye(x.size)[x.size - theta.size :]
        s_by_x = slopes[:, :count] @ point.by_x + slopes[:, count + m :] @ by_theta
        s, n = end.ravel(), self._n
        values = self._state(t + self._length, s[:n], s[n : 2 * n], s[2 * n :], self.parameters(x, p))
        value, by_s = (r.full() for r in values)
        by_x = np.vstack([by_s[:, :count] @ s_by_x + by_s[:, count:] @ by_theta, by_theta])
        by_d = np.vstack([by_s[:, :count] @ slopes[:, count : count + m], np.zeros((theta.size, m))])
        return np.concatenate([value.ravel(), theta]), by_x, by_d, s

    def output(
        self, t: float, x: np.ndarray, point: TreePoint, u: np.ndarray, d: np.ndarray, p: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Measurements in a state under inputs, and their slopes by the state and the disturbances."""
        n, s, count, m = self._n, point.s, point.s.size, d.size
        whole = u.copy()
        whole[self.disturbed] += d
        values = self._output(t, s[:n], s[n : 2 * n], s[2 * n :], whole, self.parameters(x, p))
        y, slopes = (r.full() for r in values)
        by_theta = np.eye(x.size)[x.size - len(self.unknown) :]
        by_x = slopes[:, :count] @ point.by_x + slopes[:, count + m :] @ by_theta
        return y.ravel(), by_x, slopes[:, count : count + m]


def _picked(x: Any, places: Sequence[int]) -> Any:
    """Entries of a column, also none of it."""
    return ca.vertcat(type(x)(0, 1), *(x[k] for k in places))
