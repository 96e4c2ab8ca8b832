"""Rows that hold all along a motion: those of the joints, and path conditions that prescribe the motion."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from ..equations.reduced import ReducedEquations
from ..model.conditions import Condition, stacked
from ..model.rates import time_derivative
from ..model.symbols import role_of
from .nlp.rows import OWN_UNIT, Rows
from .nlp.scaling import Scales
from .problem import OptimalControlProblem


def prescribes_motion(condition: Condition) -> bool:
    """Whether an equality is one in positions, or linear in velocities, and so can be differentiated.

    Imposed at stages alone such a condition would be a differential-algebraic
    equation of higher index, for which collocation at Gauss points is unstable:
    it is treated like a constraint whose multipliers are the inputs.
    """
    if not condition.equality or not condition.kinds <= {"time", "position", "velocity", "parameter"}:
        return False
    if not condition.depends_on("position", "velocity"):
        return False
    speeds = [s for s in condition.symbols if (role := role_of(s)) is not None and role.kind == "velocity"]
    slopes = ca.jacobian(condition.expression, ca.vertcat(ca.SX(0, 1), *speeds))
    return not speeds or not ca.depends_on(slopes, ca.vertcat(*speeds))


def held_conditions(problem: OptimalControlProblem) -> list[Condition]:
    """Path conditions that prescribe the motion; those with free parameters stay conditions at the stages."""
    free = {p.element_hash() for p in problem.free_parameters}
    symbols = {c: {s.element_hash() for s in c.symbols} for c in problem.path}
    return [c for c in problem.path if prescribes_motion(c) and not free & symbols[c]]


def with_rates(held: Sequence[Condition]) -> list[Condition]:
    """Conditions that prescribe the motion, and the rates of those in positions, as a state must meet them."""
    found = list(held)
    for c in held:
        if not c.depends_on("velocity"):
            found.append(Condition(time_derivative(c.expression), True, f"the rate of {c.label}"))
    return found


class MotionConstraints:
    """Constraints of a motion at the levels of position, velocity and acceleration.

    Parameters
    ----------
    eom : ReducedEquations
        Equations in the independent coordinates.
    p : numpy.ndarray
        Parameters, for the sizes of the rows.
    rows : sequence of int
        Independent rows of the joints, of those that `eom` has.
    held : sequence of Condition
        Path conditions that prescribe the motion, see :func:`prescribes_motion`;
        their parameters are those of the mechanism.

    Attributes
    ----------
    rows : list of int
        Rows of the joints.
    position_count, velocity_count : int
        Rows at the level of positions, and of velocities and accelerations.
    """

    def __init__(self, eom: ReducedEquations, p: np.ndarray, rows: Sequence[int], held: Sequence[Condition]):
        self.eom, self.rows = eom, [int(k) for k in rows]
        place = {int(k): i for i, k in enumerate(eom.position_rows)}
        positions = [c for c in held if not c.depends_on("velocity")]
        velocities = [c for c in held if c.depends_on("velocity")]
        self._joint_positions = [k for k in self.rows if k in place]
        self.held = [*positions, *velocities]
        prescribed, speeds = eom.of(stacked(positions), stacked(velocities))
        position_jacobian = ca.jacobian(prescribed, eom.q)
        speed_rows = ca.vertcat(ca.jtimes(prescribed, eom.q, eom.v) + ca.jacobian(prescribed, eom.t), speeds)
        jacobian = ca.vertcat(eom.Phi_q[self.rows, :], position_jacobian, ca.jacobian(speeds, eom.v))
        still = ca.substitute(speeds, eom.v, ca.SX.zeros(eom.v.numel()))
        nu = ca.vertcat(eom.nu[self.rows], -ca.jacobian(prescribed, eom.t), -still)
        bend = -(ca.jtimes(speed_rows, eom.q, eom.v) + ca.jacobian(speed_rows, eom.t))
        self.gamma = ca.vertcat(eom.gamma[self.rows], bend)
        self.jacobian = jacobian
        self.position_count = len(self._joint_positions) + len(positions)
        self.velocity_count = len(self.rows) + len(self.held)
        self.function = ca.Function(
            "constraints",
            [eom.t, eom.q, eom.p],
            [
                ca.vertcat(eom.Phi[[place[k] for k in self._joint_positions]], prescribed),
                ca.vertcat(eom.Phi_q[self._joint_positions, :], position_jacobian),
                jacobian,
                nu,
            ],
        )
        slopes = self.function(0.0, eom.estimate, p)
        self._position_slopes, self._slopes = np.abs(slopes[1].full()), np.abs(slopes[2].full())

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

    def _words(self, per: str) -> tuple[list[str], list[str]]:
        """Names and units of the rows."""
        names = [self.eom.row_names[k] for k in self.rows] + [f"path condition {c.label}" for c in self.held]
        units = [("rad" if self.eom.angular_rows[k] else "m") + per for k in self.rows]
        return names, units + [OWN_UNIT] * len(self.held)

    def position_rows(self, q: ca.SX, t: ca.SX, p: ca.SX, share: float, scales: Scales) -> Rows:
        """``Phi = 0``."""
        names, units = self._words("")
        at_position = [self.rows.index(k) for k in self._joint_positions]
        at_position += range(len(self.rows), len(self.rows) + self.position_count - len(at_position))
        return Rows(
            self.function(t, q, p)[0],
            tuple(names[k] if k >= len(self.rows) else f"constraint {names[k]}" for k in at_position),
            share,
            self._sizes(scales)[at_position],
            tuple(units[k] for k in at_position),
        )

    def velocity_rows(self, q: ca.SX, v: ca.SX, t: ca.SX, p: ca.SX, share: float, scales: Scales) -> Rows:
        """``Phi_q v - nu = 0``."""
        _, _, jacobian, nu = self.function(t, q, p)
        names, units = self._words("/s")
        labels = tuple(f"velocity equation of {name}" for name in names)
        size = self._sizes(scales) * scales.steps / scales.time
        return Rows(jacobian @ v - nu, labels, share, size, tuple(units))

    def acceleration_rows(self, residual: ca.SX, share: float, scales: Scales) -> Rows:
        """``Phi_q a - gamma = 0`` from its residual."""
        names, units = self._words("/s²")
        labels = tuple(f"acceleration equation of {name}" for name in names)
        return Rows(residual, labels, share, self._sizes(scales) * (scales.steps / scales.time) ** 2, tuple(units))
