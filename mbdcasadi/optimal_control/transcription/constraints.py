"""Rows that hold throughout a motion: those of the joints, and path conditions that prescribe the motion."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from ...equations.least_norm import ImpliedRows
from ...equations.numeric import NumericEquations
from ...equations.reduced import ReducedEquations
from ...model.cache import Cache
from ...model.conditions import Condition, stacked
from ...numerics.evaluation import Evaluator
from ...numerics.lazy import cached_property
from .rows import RowKind, Rows
from .scaling import Scales


class MotionConstraints:
    """Constraints of a motion at the levels of position, velocity and acceleration.

    `rows` are the independent ones of the joints, of those that the equations have; `path_constraints` are path
    conditions that prescribe the motion, in parameters of the mechanism, see
    :meth:`ProblemStatement.differentiated_path_constraints`. The equations at the parameters that are given, `numeric`,
    give the sizes of the rows. Compiled functions of these choices, and of a scheme that works with them, are in
    `cache`.
    """

    def __init__(
        self,
        eom: ReducedEquations,
        numeric: NumericEquations,
        rows: Sequence[int],
        path_constraints: Sequence[Condition],
        cache: Cache,
    ):
        self.eom, self.rows, self.cache, self._numeric = eom, [int(k) for k in rows], cache, numeric
        place = {int(k): i for i, k in enumerate(eom.position_rows)}
        positions = [c for c in path_constraints if not c.depends_on("velocity")]
        velocities = [c for c in path_constraints if c.depends_on("velocity")]
        self._joint_positions = [k for k in self.rows if k in place]
        self.path_constraints = [*positions, *velocities]
        self._conditions = positions, velocities
        #: numbers of rows at the level of positions, and of velocities and accelerations
        self.position_count = len(self._joint_positions) + len(positions)
        self.velocity_count = len(self.rows) + len(self.path_constraints)
        slopes = self.function(0.0, eom.estimate, eom.whole.estimate[2], numeric.p)
        self._position_slopes, self._slopes = np.abs(slopes[1].full()), np.abs(slopes[2].full())

    @cached_property
    def _terms(self) -> tuple[ca.SX, ...]:
        """``Phi``, its Jacobian, ``Phi_q``, ``nu`` and ``gamma``."""
        eom, place = self.eom, {int(k): i for i, k in enumerate(self.eom.position_rows)}
        prescribed, speeds = eom.of(*map(stacked, self._conditions))
        position_jacobian = ca.jacobian(prescribed, eom.q)
        speed_rows = ca.vertcat(ca.jtimes(prescribed, eom.q, eom.v) + ca.jacobian(prescribed, eom.t), speeds)
        jacobian = ca.vertcat(eom.Phi_q[self.rows, :], position_jacobian, ca.jacobian(speeds, eom.v))
        at_rest = ca.substitute(speeds, eom.v, ca.SX.zeros(eom.v.numel()))
        nu = ca.vertcat(eom.nu[self.rows], -ca.jacobian(prescribed, eom.t), -at_rest)
        bend = -(ca.jtimes(speed_rows, eom.q, eom.v) + ca.jacobian(speed_rows, eom.t))
        position_rows = ca.vertcat(eom.Phi[[place[k] for k in self._joint_positions]], prescribed)
        position_slopes = ca.vertcat(eom.Phi_q[self._joint_positions, :], position_jacobian)
        return position_rows, position_slopes, jacobian, nu, ca.vertcat(eom.gamma[self.rows], bend)

    @cached_property
    def function(self) -> ca.Function:
        """``(t, q, z, p) -> (Phi, its Jacobian, Phi_q, nu)``: position rows, then all rows."""
        eom = self.eom
        return self.cache.get_or_create(
            "constraints", lambda: ca.Function("constraints", [eom.t, eom.q, eom.z, eom.p], self._terms[:4])
        )

    @cached_property
    def _implied_rows(self) -> ImpliedRows:
        eom = self.eom
        rows = sorted([*eom.explicit, *(eom.rows[k] for k in self.rows)])
        weights = self._numeric.multiplier_weights
        return ImpliedRows(eom.whole, rows, self._numeric.projection_weights if weights is None else weights)

    @property
    def least_norm(self) -> ca.Function:
        """``(t, q, lam, p) -> lam``, of all coordinates: multipliers of least norm with the same loads."""
        light = self._numeric.augmentation is not None
        return self.cache.get_or_create("least norm", lambda: self._implied_rows.least_norm(light=light))

    @property
    def independent(self) -> Evaluator:
        """``(t, q, lam, p) -> lam``, of all coordinates: multipliers of independent rows with the same loads."""
        return self.cache.get_or_create("independent", lambda: Evaluator(self._implied_rows.independent()))

    @property
    def acceleration_residual(self) -> ca.SX:
        """``Phi_q a - gamma``."""
        _, _, jacobian, _, gamma = self._terms
        return jacobian @ self.eom.a - gamma

    @property
    def joint_position_count(self) -> int:
        """Number of position rows of the joints."""
        return len(self._joint_positions)

    def _sizes(self, scales: Scales) -> np.ndarray:
        """Sizes of the rows as they change over typical coordinates."""
        slopes = np.max(self._slopes[len(self.rows) :] * scales.q, axis=1, initial=0.0)
        return np.r_[scales.rows[self.rows], np.where(slopes > 0, slopes, 1.0)]

    def corrections(self, scales: Scales, weights: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Sizes of the multipliers that move positions, and velocities, by typical amounts in the metric W."""
        sizes = []
        for slopes in (self._position_slopes, self._slopes):
            needed = np.where(slopes > 0, scales.q * weights / np.where(slopes > 0, slopes, 1.0), np.inf)
            least = np.min(needed, axis=1, initial=np.inf)
            sizes.append(np.where(np.isfinite(least), least, 1.0))
        return sizes[0], sizes[1] / scales.time

    def _names_and_units(self, per: str) -> tuple[list[str], list[str]]:
        names = [self.eom.row_names[k] for k in self.rows]
        names += [f"path condition {c.label}" for c in self.path_constraints]
        units = [("rad" if self.eom.angular_rows[k] else "m") + per for k in self.rows]
        return names, units + [""] * len(self.path_constraints)

    def position_rows(self, q: ca.SX, z: ca.SX, t: ca.SX, p: ca.SX, tau: float, scales: Scales) -> list[Rows]:
        """``Phi = 0``: rows of the joints, and path conditions."""
        (names, units), sizes, values = self._names_and_units(""), self._sizes(scales), self.function(t, q, z, p)[0]
        joints, first = self.joint_position_count, len(self.rows)
        parts = (
            (RowKind.CONSTRAINT, values[:joints], [self.rows.index(k) for k in self._joint_positions]),
            (RowKind.EQUATION, values[joints:], [*range(first, first + self.position_count - joints)]),
        )
        return [
            Rows(part, tuple(names[k] for k in at), tau, sizes[at], tuple(units[k] for k in at), kind)
            for kind, part, at in parts
        ]

    def velocity_rows(self, q: ca.SX, v: ca.SX, z: ca.SX, t: ca.SX, p: ca.SX, tau: float, scales: Scales) -> Rows:
        """``Phi_q v - nu = 0``."""
        _, _, jacobian, nu = self.function(t, q, z, p)
        names, units = self._names_and_units("/s")
        size = self._sizes(scales) * scales.steps / scales.time
        return Rows(jacobian @ v - nu, tuple(names), tau, size, tuple(units), RowKind.VELOCITY)

    def acceleration_rows(self, residual: ca.SX, tau: float, scales: Scales) -> Rows:
        """``Phi_q a - gamma = 0`` from its residual."""
        names, units = self._names_and_units("/s²")
        size = self._sizes(scales) * (scales.steps / scales.time) ** 2
        return Rows(residual, tuple(names), tau, size, tuple(units), RowKind.ACCELERATION)
