"""Hermite–Simpson collocation of constrained motion."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from ...numerics.collocation import gauss
from .base import Transcription
from .points import CollocationPoint, Interval
from .rows import Rows
from .scaling import Scales


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

    @property
    def interval_variables(self) -> dict[str, tuple[int, np.ndarray]]:
        """Accelerations at both ends, multipliers at the stages, and the slack."""
        eom = self.eom
        return {
            "a": (eom.q.numel(), self.stages[[0, 2]]),
            "lam": (len(self.rows), self.stages),
            "u": (eom.u.numel(), np.array(self.inputs.inner)),
            "mu_1": (self.constraints.position_count, np.array([np.nan])),
        }

    def input_points(self, *, lower_degree: bool) -> tuple[tuple[float, ...], bool]:
        """Both ends and the middle."""
        return () if lower_degree else (0.5,), True

    @property
    def dense_rule(self) -> tuple[np.ndarray, np.ndarray]:
        """Exact for the product of a cubic and a parabola: Simpson's rule is not, and inputs would make use of that."""
        rule = gauss(3)
        return rule.points, rule.weights

    def point(self, interval: Interval, tau: Any) -> CollocationPoint:
        """State at a point of the interval: Hermite cubics, multipliers through the three stages."""
        inner, h = self.split_interval(interval.inner), interval.length
        first, last = self.split_point(interval.first), self.split_point(interval.last)
        a = ca.horzsplit(inner["a"])
        f = self._rates(interval)
        lam = inner["lam"] @ ca.SX(_through_three(tau))
        return CollocationPoint(
            interval.start + tau * h,
            _cubic(first["q"], last["q"], h * first["v"], h * last["v"], tau),
            _cubic(first["v"], last["v"], h * a[0], h * a[1], tau),
            _cubic_slope(first["v"], last["v"], h * a[0], h * a[1], tau) / h,
            _cubic(first["z"], last["z"], h * f[0], h * f[1], tau),
            self.full_multipliers(lam),
            *self.inputs_at(interval, tau),
        )

    def _rates(self, interval: Interval) -> tuple[ca.SX, ca.SX]:
        """Rates of the first-order states at both ends."""
        if not self.eom.z.numel():
            return ca.SX(0, 1), ca.SX(0, 1)
        inner, rates = self.split_interval(interval.inner), []
        for tau, values, column in ((0.0, interval.first, 0), (1.0, interval.last, 2)):
            end, t = self.split_point(values), interval.start + tau * interval.length
            lam = self.full_multipliers(inner["lam"][:, column])
            inputs = self.inputs_at(interval, tau)
            at = CollocationPoint(t, end["q"], end["v"], inner["a"][:, column // 2], end["z"], lam, *inputs)
            rates.append(self.state_rates(at, interval.p))
        return rates[0], rates[1]

    def equations(self, interval: Interval, scales: Scales) -> list[Rows]:
        """Equations of motion at both ends and in the middle, constraints at the next mesh point."""
        h, p = interval.length, interval.p
        first, last = self.split_point(interval.first), self.split_point(interval.last)
        begin, middle, end = self.points(interval)
        slack = self.split_interval(interval.inner)["mu_1"]
        correction, _ = self.corrections(middle.t, middle.q, p, slack, z=middle.z)
        slope = _cubic_slope(first["q"], last["q"], h * first["v"], h * last["v"], 0.5)
        f = self._rates(interval)
        slope_z = _cubic_slope(first["z"], last["z"], h * f[0], h * f[1], 0.5)
        motion, acceleration = self.motion_rows(begin, p, 0.0, scales)
        return [
            motion,
            # the interval before has the accelerations of path conditions at the same point
            acceleration.part(slice(len(self.rows))),
            self.motion_rows(middle, p, 0.5, scales)[0],
            *self.motion_rows(end, p, 1.0, scales),
            self.continuity_rows(slope - h * (middle.v + correction), scales),
            self.state_continuity_rows(slope_z - h * self.state_rates(middle, p), 0.5, scales),
            *self.constraint_rows(last["q"], last["v"], end.t, p, 1.0, scales, last["z"]),
        ]

    def start_rows(self, interval: Interval, scales: Scales) -> list[Rows]:
        """Accelerations of path conditions at the start of the motion."""
        rows = self.motion_rows(self.start(interval), interval.p, 0.0, scales)[1]
        return [rows.part(slice(len(self.rows), None))] if self.constraints.path_constraints else []


def _cubic(x0: ca.SX, x1: ca.SX, d0: ca.SX, d1: ca.SX, s: Any) -> ca.SX:
    """Cubic through values and slopes (by tau) at both ends."""
    rise = x1 - x0
    return x0 + s * (d0 + s * (3 * rise - 2 * d0 - d1 + s * (d0 + d1 - 2 * rise)))


def _cubic_slope(x0: ca.SX, x1: ca.SX, d0: ca.SX, d1: ca.SX, s: Any) -> ca.SX:
    """Derivative of that cubic by tau."""
    rise = x1 - x0
    return d0 + s * (2 * (3 * rise - 2 * d0 - d1) + 3 * s * (d0 + d1 - 2 * rise))


def _through_three(s: Any) -> Any:
    """Weights of values at both ends and in the middle in the parabola through them."""
    weights = [(1 - s) * (1 - 2 * s), 4 * s * (1 - s), s * (2 * s - 1)]
    return ca.vertcat(*weights)
