"""Second-order Gauss–Legendre collocation with projection at the mesh points."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from ...numerics.collocation import gauss
from ..constraints import MotionConstraints
from ..nlp.rows import Rows
from ..nlp.scaling import Scales
from .base import Transcription
from .controls import InputBasis
from .points import Interval, Point


class GaussLegendre(Transcription):
    """Second-order Gauss–Legendre collocation with projection.

    Unknown at the stages are accelerations, multipliers, inputs and rates of
    first-order states; positions and velocities there are exact integrals of
    the polynomial of the accelerations. At each mesh point the end of the
    interval is moved onto the constraints,

        q = q_end + W⁻¹ Phi_q^T mu_1,    v = v_end + W⁻¹ Phi_q^T mu_2,
        Phi = 0,    Phi_q v = nu.

    The mass matrix is never inverted, so bodies without mass are welcome.
    Order ``2 degree`` at the mesh points.

    Parameters
    ----------
    degree : int
        Stages of an interval.

    References
    ----------
    Bordalba, Schoels, Ros, Porta, Diehl, "Direct collocation methods for
    trajectory optimization in constrained robotic systems", IEEE Transactions
    on Robotics, 2023.
    """

    name = "gauss-legendre"

    def __init__(self, constraints: MotionConstraints, weights: np.ndarray, inputs: InputBasis, degree: int):
        super().__init__(constraints, weights, inputs, degree)
        eom = self.eom
        self.coefficients = gauss(degree)
        self.stages, self.quadrature = self.coefficients.points, self.coefficients.weights
        self.order = 2 * degree
        nowhere = np.array([np.nan])
        self.block_parts = {
            "a": (eom.q.numel(), self.stages),
            "lam": (len(self.rows), self.stages),
            "u": (eom.u.numel(), np.array(inputs.inner)),
            "rate": (eom.z.numel(), self.stages),
            "mu_1": (constraints.position_count, nowhere),
            "mu_2": (constraints.velocity_count, nowhere),
        }

    @staticmethod
    def input_points(degree: int) -> tuple[tuple[float, ...], bool]:
        """Where the values of polynomial inputs are given: at the stages."""
        return tuple(gauss(degree).points.tolist()), False

    def point(self, interval: Interval, share: Any) -> Point:
        """State at a share of the interval: exact integrals of the polynomials through the stages."""
        parts, node, h = self.block(interval.block), self.node(interval.node), interval.length
        value, once, twice = (ca.SX(w) for w in self.coefficients.basis(share))
        u, u_rate = self._inputs(interval, share)
        return Point(
            interval.start + share * h,
            node["q"] + share * h * node["v"] + h**2 * (parts["a"] @ twice),
            node["v"] + h * (parts["a"] @ once),
            parts["a"] @ value,
            node["z"] + h * (parts["rate"] @ once),
            self.full_multipliers(parts["lam"] @ value),
            u,
            u_rate,
        )

    def equations(self, interval: Interval, scales: Scales) -> list[Rows]:
        """Equations of motion at the stages, and the projected step to the next mesh point."""
        parts, groups = self.block(interval.block), []
        for j, (share, at) in enumerate(zip(self.stages, self.points(interval), strict=True)):
            rate = self._motion(at.t, at.q, at.v, at.a, at.z, at.lam, at.u, interval.p)[2]
            groups += self.motion_rows(at, interval.p, float(share), scales)
            groups.append(
                self._state_rows(
                    parts["rate"][:, j] - rate, "rate of", float(share), scales.z * scales.steps / scales.time
                )
            )
        end, after = self.at(interval, 1.0), self.node(interval.next_node)
        q, v = after["q"], after["v"]
        _, position_jacobian, jacobian, _ = self.constraints.function(end.t, q, interval.p)
        over = ca.diag(ca.DM(1 / self.weights))
        return [
            *groups,
            self._continuity(q - end.q - over @ (position_jacobian.T @ parts["mu_1"]), "q", scales.q, scales),
            self._continuity(v - end.v - over @ (jacobian.T @ parts["mu_2"]), "v", scales.v * scales.steps, scales),
            self._state_rows(after["z"] - end.z, "continuity of", 1.0, scales.z),
            *self.constraint_rows(q, v, end.t, interval.p, 1.0, scales),
        ]
