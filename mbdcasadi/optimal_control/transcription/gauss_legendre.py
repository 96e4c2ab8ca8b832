"""Second-order Gauss–Legendre collocation with projection at the mesh points."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from ...numerics.collocation import gauss
from .base import Transcription
from .points import CollocationPoint, Interval
from .rows import Rows
from .scaling import Scales


class GaussLegendre(Transcription):
    """Second-order Gauss–Legendre collocation with projection.

    Unknown at the stages are accelerations, multipliers, inputs and rates of
    first-order states; positions and velocities there are exact integrals of
    the polynomial of the accelerations. At each mesh point the end of the
    interval is moved onto the constraints,

        q = q_end + W⁻¹ Phi_q^T mu_1,    v = v_end + W⁻¹ Phi_q^T mu_2,
        Phi = 0,    Phi_q v = nu.

    The mass matrix is never inverted, so that bodies may have no mass.
    Order ``2 degree`` at the mesh points.

    Parameters
    ----------
    degree : int, default 3
        Number of stages of an interval.

    References
    ----------
    Bordalba, Schoels, Ros, Porta, Diehl, "Direct collocation methods for
    trajectory optimization in constrained robotic systems", IEEE Transactions
    on Robotics, 2023.
    """

    name = "gauss-legendre"

    def __init__(self, degree: int = 3):
        super().__init__(degree)
        self._gauss = gauss(degree)
        self.stages, self.quadrature = self._gauss.points, self._gauss.weights
        self.order = 2 * degree

    @property
    def interval_variables(self) -> dict[str, tuple[int, np.ndarray]]:
        """Values at the stages, and the multipliers of the projection."""
        eom, constraints, nowhere = self.eom, self.constraints, np.array([np.nan])
        return {
            "a": (eom.q.numel(), self.stages),
            "lam": (len(self.rows), self.stages),
            "u": (eom.u.numel(), np.array(self.inputs.inner)),
            "rate": (eom.z.numel(), self.stages),
            "mu_1": (constraints.position_count, nowhere),
            "mu_2": (constraints.velocity_count, nowhere),
        }

    def input_points(self, *, lower_degree: bool) -> tuple[tuple[float, ...], bool]:
        """The stages."""
        return tuple(gauss(max(self.degree - lower_degree, 1)).points.tolist()), False

    @property
    def integrates_accelerations(self) -> bool:
        return True

    @property
    def dense_rule(self) -> tuple[np.ndarray, np.ndarray]:
        """One point more: states that are right at all stages may be off in turn at the mesh points."""
        rule = gauss(self.degree + 1)
        return rule.points, rule.weights

    def point(self, interval: Interval, tau: Any) -> CollocationPoint:
        """State at a point of the interval: exact integrals of the polynomials through the stages."""
        inner, first, h = self.split_interval(interval.inner), self.split_point(interval.first), interval.length
        value, once, twice = (ca.SX(w) for w in self._gauss.basis(tau))
        return CollocationPoint(
            interval.start + tau * h,
            first["q"] + tau * h * first["v"] + h**2 * (inner["a"] @ twice),
            first["v"] + h * (inner["a"] @ once),
            inner["a"] @ value,
            first["z"] + h * (inner["rate"] @ once),
            self.full_multipliers(inner["lam"] @ value),
            *self.inputs_at(interval, tau),
        )

    def equations(self, interval: Interval, scales: Scales) -> list[Rows]:
        """Equations of motion at the stages, and the projected step to the next mesh point."""
        inner, p, groups = self.split_interval(interval.inner), interval.p, []
        for j, (tau, at) in enumerate(zip(self.stages.tolist(), self.points(interval), strict=True)):
            groups += self.motion_rows(at, p, tau, scales)
            groups.append(self.state_rate_rows(inner["rate"][:, j] - self.state_rates(at, p), tau, scales))
        end, last = self.at(interval, 1.0), self.split_point(interval.last)
        q, v, z = last["q"], last["v"], last["z"]
        dq, dv = self.corrections(end.t, q, p, inner["mu_1"], inner["mu_2"], z)
        return [
            *groups,
            self.continuity_rows(q - end.q - dq, scales),
            self.continuity_rows(v - end.v - dv, scales, velocities=True),
            self.state_continuity_rows(z - end.z, 1.0, scales),
            *self.constraint_rows(q, v, end.t, p, 1.0, scales, z),
        ]
