"""Hermite–Simpson collocation of constrained motion."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from ..constraints import MotionConstraints
from ..nlp.rows import Rows
from ..nlp.scaling import Scales
from .base import Transcription
from .controls import InputBasis
from .points import Interval, Point


class HermiteSimpson(Transcription):
    """Constrained Hermite–Simpson collocation.

    Coordinates and velocities are cubics through their values and rates at
    both ends of the interval. The equations of motion hold at the ends with
    their constraints,

        M a + Phi_q^T lam = Q,    Phi_q a = gamma,    Phi_q v = nu,    Phi = 0,

    and in the middle with a slack ``mu_1`` on the velocities, without which the
    constraints at the ends would be too many:

        q̇_c = v_c + W⁻¹ Phi_q^T mu_1,    M v̇_c + Phi_q^T lam_c = Q.

    Order 4 at the mesh points.

    References
    ----------
    Posa, Kuindersma, Tedrake, "Optimization and stabilization of trajectories
    for constrained dynamical systems", ICRA 2016.
    """

    name = "hermite-simpson"
    order = 4
    stages = np.array([0.0, 0.5, 1.0])
    quadrature = np.array([1.0, 4.0, 1.0]) / 6

    def __init__(self, constraints: MotionConstraints, weights: np.ndarray, inputs: InputBasis, degree: int):
        super().__init__(constraints, weights, inputs, degree)
        eom = self.eom
        self.block_parts = {
            "a": (eom.q.numel(), self.stages[[0, 2]]),
            "lam": (len(self.rows), self.stages),
            "u": (eom.u.numel(), np.array(inputs.inner)),
            "mu_1": (constraints.position_count, np.array([np.nan])),
        }

    @staticmethod
    def input_points(degree: int) -> tuple[tuple[float, ...], bool]:
        """Where the values of polynomial inputs are given: at the ends and in the middle."""
        return (0.5,), True

    def point(self, interval: Interval, share: Any) -> Point:
        """State at a share of the interval: cubics of Hermite, multipliers through the three stages."""
        parts, h = self.block(interval.block), interval.length
        first, last = self.node(interval.node), self.node(interval.next_node)
        a = ca.horzsplit(parts["a"])
        f = self._rates(interval)
        lam = parts["lam"] @ ca.SX(_through_three(share))
        u, u_rate = self._inputs(interval, share)
        return Point(
            interval.start + share * h,
            _cubic(first["q"], last["q"], h * first["v"], h * last["v"], share),
            _cubic(first["v"], last["v"], h * a[0], h * a[1], share),
            _cubic_slope(first["v"], last["v"], h * a[0], h * a[1], share) / h,
            _cubic(first["z"], last["z"], h * f[0], h * f[1], share),
            self.full_multipliers(lam),
            u,
            u_rate,
        )

    def _rates(self, interval: Interval) -> tuple[ca.SX, ca.SX]:
        """Rates of the first-order states at both ends."""
        if not self.eom.z.numel():
            return ca.SX(0, 1), ca.SX(0, 1)
        parts = self.block(interval.block)
        found = []
        for share, values, column in ((0.0, interval.node, 0), (1.0, interval.next_node, 2)):
            node = self.node(values)
            u, _ = self._inputs(interval, share)
            lam = self.full_multipliers(parts["lam"][:, column])
            t, a = interval.start + share * interval.length, parts["a"][:, column // 2]
            found.append(self._motion(t, node["q"], node["v"], a, node["z"], lam, u, interval.p)[2])
        return found[0], found[1]

    def equations(self, interval: Interval, scales: Scales) -> list[Rows]:
        """Equations of motion at both ends and in the middle, constraints at the next mesh point."""
        h, p = interval.length, interval.p
        first, last = self.node(interval.node), self.node(interval.next_node)
        begin, middle, end = self.points(interval)
        slack = self.block(interval.block)["mu_1"]
        _, position_jacobian, _, _ = self.constraints.function(middle.t, middle.q, p)
        over = ca.diag(ca.DM(1 / self.weights))
        slope = _cubic_slope(first["q"], last["q"], h * first["v"], h * last["v"], 0.5)
        f = self._rates(interval)
        slope_z = _cubic_slope(first["z"], last["z"], h * f[0], h * f[1], 0.5)
        rate = self._motion(middle.t, middle.q, middle.v, middle.a, middle.z, middle.lam, middle.u, p)[2]
        return [
            *self._joints_only(self.motion_rows(begin, p, 0.0, scales)),
            self.motion_rows(middle, p, 0.5, scales)[0],
            *self.motion_rows(end, p, 1.0, scales),
            self._continuity(slope - h * (middle.v + over @ (position_jacobian.T @ slack)), "q", scales.q, scales),
            self._state_rows(slope_z - h * rate, "continuity of", 0.5, scales.z),
            *self.constraint_rows(last["q"], last["v"], end.t, p, 1.0, scales),
        ]

    def _joints_only(self, rows: list[Rows]) -> list[Rows]:
        """Rows without the accelerations of path conditions: the interval before has them at the same point."""
        motion, acceleration = rows
        count = len(self.rows)
        return [motion, acceleration.first(count)]

    def start_rows(self, interval: Interval, scales: Scales) -> list[Rows]:
        """Accelerations of path conditions at the start of the motion."""
        rows = self.motion_rows(self.start(interval), interval.p, 0.0, scales)[1]
        return [rows.after(len(self.rows))] if self.constraints.held else []


def _cubic(x0: ca.SX, x1: ca.SX, d0: ca.SX, d1: ca.SX, s: Any) -> ca.SX:
    """Cubic through values and slopes (by the share) at both ends."""
    rise = x1 - x0
    return x0 + s * (d0 + s * (3 * rise - 2 * d0 - d1 + s * (d0 + d1 - 2 * rise)))


def _cubic_slope(x0: ca.SX, x1: ca.SX, d0: ca.SX, d1: ca.SX, s: Any) -> ca.SX:
    """Derivative of that cubic by the share."""
    rise = x1 - x0
    return d0 + s * (2 * (3 * rise - 2 * d0 - d1) + 3 * s * (d0 + d1 - 2 * rise))


def _through_three(s: Any) -> Any:
    """Weights of values at both ends and in the middle in the parabola through them."""
    weights = [(1 - s) * (1 - 2 * s), 4 * s * (1 - s), s * (2 * s - 1)]
    return ca.vertcat(*weights)
