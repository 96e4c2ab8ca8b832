"""Compiled solves for a motion that constraints determine: positions, velocities, accelerations, multipliers.

As many independent rows as coordinates. The Jacobian is square, or has
redundant rows; then the normal equations take its place.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from ..numerics.lazy import cached_property
from .derivation import Equations
from .scale import scale_of

#: Newton steps at each time; the predictor is good to third order.
NEWTON_STEPS = 3
_SOLVER = "csparse"


class DrivenEquations:
    """Functions of a driven mechanism.

    Attributes
    ----------
    step : casadi.Function
        ``(q, v, a, t before, t, p) -> (q, v, a, t, correction, remainder, contradiction)``:
        predict, correct by Newton's method, then velocity and acceleration.
        `correction` is how far the pose was moved from the prediction,
        `remainder` the last Newton step, `contradiction` by how much redundant rows contradict each other.
        Not if there are velocity-level rows, or if drivers follow states: the pose then follows from no time alone.
    rates : casadi.Function
        ``(t, q, z, u, p) -> (v, a, contradiction)``: velocity and acceleration in a pose.
    multipliers : casadi.Function
        ``(t, q, v, a, z, u, p, D) -> lam`` from ``Phi_q^T lam = Q - M a``, of
        least norm ``lam^T D lam`` if rows are redundant.
    """

    def __init__(self, eom: Equations):
        self.square = eom.lam.numel() == eom.q.numel()
        self._eom = eom
        p = eom.parameter_values
        scale = scale_of(eom, p, eom.masses(p))
        # by powers of two, which rounding does not touch
        self._columns, self._rows = (ca.DM(2.0 ** np.round(np.log2(x))) for x in (scale.columns, 1 / scale.usual_rows))
        self.rates = self._velocity_and_acceleration()
        self.multipliers = self._multipliers()

    @cached_property
    def step(self) -> ca.Function:
        """One step of the motion; see the class."""
        return self._step()

    def _least_squares(self, jacobian: ca.MX, right: ca.MX) -> ca.MX:
        """Solve ``J x = right`` for a square J, or one with redundant rows."""
        if self.square:
            return ca.solve(jacobian, right, _SOLVER)
        # the normal equations square the ratio of metres to radians
        scaled = ca.diag(self._rows) @ jacobian @ ca.diag(self._columns)
        return self._columns * ca.solve(scaled.T @ scaled, scaled.T @ (self._rows * right), _SOLVER)

    def _velocity_and_acceleration(self) -> ca.Function:
        eom = self._eom
        velocity = ca.Function("velocity", [eom.t, eom.q, eom.z, eom.p], [eom.Phi_q, ca.densify(eom.nu)])
        acceleration = ca.Function("gamma", [eom.t, eom.q, eom.v, eom.z, eom.u, eom.p], [ca.densify(eom.gamma)])
        sizes = {name: getattr(eom, name).numel() for name in ("t", "q", "z", "u", "p")}
        now, q, z, u, p = (ca.MX.sym(name, size) for name, size in sizes.items())
        jacobian, nu = velocity(now, q, z, p)
        v = self._least_squares(jacobian, nu)
        a = self._least_squares(jacobian, acceleration(now, q, v, z, u, p))
        contradiction = ca.norm_inf(jacobian @ v - nu) / (1 + ca.norm_inf(v))
        return ca.Function("rates", [now, q, z, u, p], [v, a, contradiction])

    def _step(self) -> ca.Function:
        eom = self._eom
        n, k = eom.q.numel(), eom.p.numel()
        position = ca.Function("position", [eom.t, eom.q, eom.p], [eom.Phi, eom.Phi_q])
        before, rate, second = ca.MX.sym("q", n), ca.MX.sym("v", n), ca.MX.sym("a", n)
        earlier, now, p = ca.MX.sym("t0"), ca.MX.sym("t"), ca.MX.sym("p", k)
        h = now - earlier
        predicted = before + h * rate + h**2 / 2 * second
        q, change = predicted, ca.MX.zeros(n)
        for _ in range(NEWTON_STEPS):
            phi, jacobian = position(now, q, p)
            change = self._least_squares(jacobian, phi)
            q = q - change
        phi, _ = position(now, q, p)
        v, a, torn = self.rates(now, q, ca.MX.zeros(eom.z.numel()), ca.MX.zeros(eom.u.numel()), p)
        moved = ca.norm_inf(q - predicted)
        contradiction = ca.fmax(ca.norm_inf(phi), torn)
        return ca.Function(
            "kinematic_step",
            [before, rate, second, earlier, now, p],
            [q, v, a, now, moved, ca.norm_inf(change), contradiction],
            ["q0", "v0", "a0", "t0", "t", "p"],
            ["q", "v", "a", "t_now", "correction", "remainder", "contradiction"],
        )

    def _multipliers(self) -> ca.Function:
        eom = self._eom
        shapes = (eom.t, eom.q, eom.v, eom.a, eom.z, eom.u, eom.p)
        symbols = [
            ca.MX.sym(name, *s.shape) for name, s in zip(("t", "q", "v", "a", "z", "u", "p"), shapes, strict=True)
        ]
        load = eom.Q - eom.mass_diagonal * eom.a
        terms = ca.Function("terms", [*shapes, eom.lam], [eom.Phi_q, ca.densify(load), ca.jacobian(load, eom.lam)])
        lam, norm = ca.MX.zeros(eom.lam.numel()), ca.MX.sym("D", eom.lam.numel())
        # forces that depend on the multipliers take a few Newton steps; without them the first one is exact
        for _ in range(8 if eom.Q_depends_on_lam else 1):
            jacobian, right, slope = terms(*symbols, lam)
            residual = right - jacobian.T @ lam
            if self.square:
                lam = lam + ca.solve(jacobian.T - slope, residual, _SOLVER)
            else:
                scaled = jacobian @ ca.diag(self._columns)
                over = ca.diag(1 / norm) @ scaled
                lam = lam + over @ ca.solve(scaled.T @ over, self._columns * residual, _SOLVER)
        return ca.Function("multipliers", [*symbols, norm], [lam])


def driven_equations(eom: Equations) -> DrivenEquations:
    """Compiled solves of a driven mechanism, made once and kept."""
    return eom.mechanism.cache.get_or_create("driven", lambda: DrivenEquations(eom))
