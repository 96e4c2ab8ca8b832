"""Second-order Gauss–Legendre collocation with projection at the mesh points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ..equations import Equations
from ..numerics.collocation import Gauss, gauss
from .interval import Rows, Scales


@dataclass(frozen=True)
class Point:
    """Everything that an expression may hold, at one point of an interval."""

    t: ca.SX
    q: ca.SX
    v: ca.SX
    a: ca.SX
    z: ca.SX
    lam: ca.SX
    u: ca.SX


class GaussCollocation:
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
    eom : Equations
        The equations of motion.
    rows : sequence of int
        Independent constraint rows; others are implied by them.
    weights : numpy.ndarray
        Metric W of the projection (n,).
    degree : int
        Stages of an interval.

    References
    ----------
    Bordalba, Schoels, Ros, Porta, Diehl, "Direct collocation methods for
    trajectory optimization in constrained robotic systems", IEEE Transactions
    on Robotics, 2023.
    """

    name = "gauss-legendre"

    def __init__(self, eom: Equations, rows: Sequence[int], weights: np.ndarray, degree: int):
        self.eom = eom
        self.rows = [int(k) for k in rows]
        self.weights = weights
        self.coefficients: Gauss = gauss(degree)
        self.degree = degree
        position = {int(k): i for i, k in enumerate(eom.position_rows)}
        self._position_rows = [position[k] for k in self.rows if k in position]
        self._jacobian_rows = [k for k in self.rows if k in position]
        n, m = eom.q.numel(), len(self.rows)
        self.sizes = {
            "a": n * degree,
            "lam": m * degree,
            "u": eom.u.numel() * degree,
            "rate": eom.z.numel() * degree,
            "mu_1": len(self._position_rows),
            "mu_2": m,
        }
        self.node_size = 2 * n + eom.z.numel()
        self.block_size = sum(self.sizes.values())
        self._motion = ca.Function(
            "motion",
            [*eom.symbols],
            [
                eom.mass_diagonal * eom.a + eom.Phi_q.T @ eom.lam - eom.Q,
                (eom.Phi_q @ eom.a - eom.gamma)[self.rows],
                eom.z_rate,
            ],
        )
        self._constraints = ca.Function(
            "constraints",
            [eom.t, eom.q, eom.p],
            [
                eom.Phi[self._position_rows],
                eom.Phi_q[self._jacobian_rows, :],
                eom.Phi_q[self.rows, :],
                eom.nu[self.rows],
            ],
        )

    # --- unknowns -------------------------------------------------------------------------
    def parts(self, block):
        """Unknowns of an interval by name, one column a stage where there are stages; also for numbers (N, size)."""
        found, first = {}, 0
        for name, size in self.sizes.items():
            piece = block[first : first + size]
            first += size
            columns = self.degree if name in ("a", "lam", "u", "rate") else 1
            found[name] = ca.reshape(piece, size // columns, columns) if size else ca.SX(0, columns)
        return found

    def scales(self, scales: Scales) -> tuple[np.ndarray, np.ndarray]:
        """Sizes of the unknowns of a node and of a block."""
        d = self.degree
        lam = scales.lam[self.rows]
        correction = scales.q.max() * self.weights.mean()
        block = [np.tile(scales.a, d), np.tile(lam, d), np.tile(scales.u, d), np.tile(scales.z / scales.time, d)]
        block += [
            np.full(self.sizes["mu_1"], correction),
            np.full(self.sizes["mu_2"], correction / scales.time),
        ]
        return np.concatenate([scales.q, scales.v, scales.z]), np.concatenate(block)

    def split(self, node: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Coordinates, velocities, first-order states of a node."""
        n = self.eom.q.numel()
        return node[:n], node[n : 2 * n], node[2 * n :]

    def full_multipliers(self, lam: ca.SX) -> ca.SX:
        """Multipliers of all rows; those of implied rows are zero."""
        full = ca.SX(self.eom.lam.numel(), 1)
        if self.rows:
            full[self.rows] = lam
        return full

    def point(self, node: ca.SX, block: ca.SX, start: ca.SX, length: ca.SX, share: float) -> Point:
        """State at a share of the interval by the polynomials of the scheme."""
        parts = self.parts(block)
        value, once, twice = self.coefficients.basis(np.array([share]))
        q, v, z = self.split(node)
        at = {name: ca.SX(parts[name] @ ca.DM(value.T)) for name in ("a", "lam", "u")}
        return Point(
            start + share * length,
            q + share * length * v + length**2 * (parts["a"] @ ca.DM(twice.T)),
            v + length * (parts["a"] @ ca.DM(once.T)),
            at["a"],
            z + length * (parts["rate"] @ ca.DM(once.T)),
            self.full_multipliers(at["lam"]),
            at["u"],
        )

    # --- equations -----------------------------------------------------------------------
    def stages(self, node: ca.SX, block: ca.SX, start: ca.SX, length: ca.SX) -> list[Point]:
        """States at the stages."""
        return [self.point(node, block, start, length, float(c)) for c in self.coefficients.points]

    def equations(
        self, node: ca.SX, block: ca.SX, next_node: ca.SX, start: ca.SX, length: ca.SX, p: ca.SX, scales: Scales
    ) -> list[Rows]:
        """Equations of motion at the stages, and the step to the next mesh point."""
        eom = self.eom
        parts = self.parts(block)
        names = tuple(f"equation of motion of {name}" for name in eom.coordinate_names)
        row_names = tuple(eom.row_names[k] for k in self.rows)
        groups = []
        for j, (share, at) in enumerate(
            zip(self.coefficients.points, self.stages(node, block, start, length), strict=True)
        ):
            motion, acceleration, rate = self._motion(at.t, at.q, at.v, at.a, at.z, at.lam, at.u, p)
            groups += [
                Rows(motion, names, float(share), scales.load),
                Rows(
                    acceleration,
                    tuple(f"acceleration equation of {r}" for r in row_names),
                    float(share),
                    scales.rows[self.rows] / scales.time**2,
                ),
                Rows(
                    parts["rate"][:, j] - rate,
                    tuple(f"rate of {z.label}" for z in eom.mechanism.states),
                    float(share),
                    scales.z / scales.time,
                ),
            ]
        return groups + self._step(node, block, next_node, start, length, p, scales)

    def _step(
        self, node: ca.SX, block: ca.SX, next_node: ca.SX, start: ca.SX, length: ca.SX, p: ca.SX, scales: Scales
    ) -> list[Rows]:
        eom = self.eom
        parts = self.parts(block)
        end = self.point(node, block, start, length, 1.0)
        q, v, z = self.split(next_node)
        phi, position_jacobian, jacobian, nu = self._constraints(start + length, q, p)
        over = ca.diag(ca.DM(1 / self.weights))
        position_names = tuple(eom.row_names[k] for k in self._jacobian_rows)
        row_names = tuple(eom.row_names[k] for k in self.rows)
        return [
            Rows(
                q - end.q - over @ (position_jacobian.T @ parts["mu_1"]),
                tuple(f"continuity of {name}" for name in eom.coordinate_names),
                1.0,
                scales.q,
            ),
            Rows(
                v - end.v - over @ (jacobian.T @ parts["mu_2"]),
                tuple(f"continuity of the velocity of {name}" for name in eom.coordinate_names),
                1.0,
                scales.v,
            ),
            Rows(z - end.z, tuple(f"continuity of {s.label}" for s in eom.mechanism.states), 1.0, scales.z),
            Rows(phi, tuple(f"constraint {r}" for r in position_names), 1.0, scales.rows[self._jacobian_rows]),
            Rows(
                jacobian @ v - nu,
                tuple(f"velocity equation of {r}" for r in row_names),
                1.0,
                scales.rows[self.rows] / scales.time,
            ),
        ]

    def consistent(self, node: ca.SX, t: ca.SX, p: ca.SX, scales: Scales) -> list[Rows]:
        """Constraints at position and velocity level at a node that conditions leave free."""
        eom = self.eom
        q, v, _ = self.split(node)
        phi, _, jacobian, nu = self._constraints(t, q, p)
        return [
            Rows(
                phi,
                tuple(f"constraint {eom.row_names[k]}" for k in self._jacobian_rows),
                0.0,
                scales.rows[self._jacobian_rows],
            ),
            Rows(
                jacobian @ v - nu,
                tuple(f"velocity equation of {eom.row_names[k]}" for k in self.rows),
                0.0,
                scales.rows[self.rows] / scales.time,
            ),
        ]

    def cost(self, integrand: ca.Function, points: Sequence[Point], length: ca.SX, p: ca.SX) -> ca.SX:
        """Integral of an expression over the interval by Gauss quadrature."""
        total = ca.SX(0)
        for weight, at in zip(self.coefficients.weights, points, strict=True):
            total += float(weight) * integrand(at.t, at.q, at.v, at.a, at.z, at.lam, at.u, p)
        return length * total
