"""The equations of a run as an explicit system with invariants, for the compiled method."""

from __future__ import annotations

import casadi as ca
import numpy as np

from ..arguments.inputs import Signals
from ..equations.derivation import Equations
from ..equations.numeric import NumericEquations
from ..equations.saddle import shifted
from ..integrators.dop853.stretch import ExplicitSystem
from .singular_passage import has_loops


def dynamics_of(numeric: NumericEquations, *, redundant: bool = False) -> ca.Function:
    """``(t, q, v, z, u, p) -> (a, rate of z, lam, regularity)``; made once for a mechanism.

    The regularity is the smallest pivot of ``Phi_q M⁻¹ Phi_q^T``, relative to its
    diagonal (with light bodies, that of ``Phi_q Phi_q^T``); 1 if no pose is singular.

    Parameters
    ----------
    numeric : NumericEquations
        Equations at given parameters.
    redundant : bool
        True if rows depend on each other; the multipliers are then those of least norm, by the regularised solve.
    """
    eom = numeric.eom
    key = ("explicit dynamics", numeric.light_key, redundant)
    return eom.mechanism.cache.get_or_create(key, lambda: _dynamics(numeric, redundant))


def _dynamics(numeric: NumericEquations, redundant: bool) -> ca.Function:
    eom = numeric.eom
    known = [eom.t, eom.q, eom.v, eom.z, eom.u, eom.p]
    a, lam = numeric.forward_dynamics(redundant=redundant)(*known)
    rates = ca.substitute(eom.z_rate, ca.vertcat(eom.a, eom.lam), ca.vertcat(a, lam)) if eom.z.numel() else eom.z_rate
    return ca.Function("dynamics", known, [a, ca.densify(rates), lam, _regularity(numeric)])


def _regularity(numeric: NumericEquations) -> ca.SX:
    eom = numeric.eom
    if not eom.lam.numel() or not has_loops(eom):
        return ca.SX(1)
    inverse = 1 / eom.mass_diagonal if numeric.augmentation is None else ca.SX(ca.DM(numeric.column_scale**2))
    schur = eom.Phi_q @ (ca.diag(inverse) @ eom.Phi_q.T)  # as in the forward dynamics: evaluated once
    pivots, _, order = ca.ldl(schur)
    return ca.mmin(ca.densify(pivots) / ca.densify(ca.diag(schur))[list(order)])


def projection_of(eom: Equations) -> ca.Function:
    """``(t, q, v, p, weights) -> (q, v, |Phi|)``: one step onto the constraints; made once for a mechanism.

    One factorisation serves positions and velocities: the residual of the velocities is that
    of the new pose, and repeated.
    """
    return eom.mechanism.cache.get_or_create("explicit projection", lambda: _projection(eom))


def _projection(eom: Equations) -> ca.Function:
    weights = ca.SX.sym("weights", eom.q.numel())
    rows = [int(k) for k in eom.position_rows]
    inverse = ca.diag(1 / weights)
    over = inverse @ eom.Phi_q.T
    schur = eom.Phi_q @ over
    loops = has_loops(eom)

    def factorised(matrix: ca.SX, angular: np.ndarray) -> tuple:
        """LDL factors; near a singular pose the step is kept short."""
        return shifted(matrix, angular) if loops else ca.ldl(matrix)

    q, v, left = eom.q, eom.v, ca.SX(0)
    if rows:
        whole = len(rows) == eom.lam.numel()
        factors = factorised(schur, eom.angular_rows)
        own = factors if whole else factorised(schur[rows, rows], eom.angular_rows[eom.position_rows])
        q = q - over[:, rows] @ ca.ldl_solve(ca.densify(eom.Phi), *own)
    elif eom.lam.numel():
        factors = factorised(schur, eom.angular_rows)
    if eom.lam.numel():
        there = ca.Function("there", [eom.t, eom.q, eom.p], [eom.Phi, eom.Phi_q, eom.nu])
        phi, jacobian, nu = there(eom.t, q, eom.p)
        for _ in range(2):  # the second removes the rounding of the first
            v = v - inverse @ (jacobian.T @ ca.ldl_solve(ca.densify(jacobian @ v - nu), *factors))
        left = ca.norm_inf(ca.densify(phi)) if rows else left
    results = [ca.densify(q), ca.densify(v), left]
    return ca.Function("projection", [eom.t, eom.q, eom.v, eom.p, weights], results)


def input_of(eom: Equations, signals: Signals) -> ca.Function:
    """``(t, q, v, z, p, levels, channel) -> u``; made once for each structure of the inputs."""

    def make() -> tuple[ca.Function, ca.SX]:
        arguments = [eom.t, eom.q, eom.v, eom.z, eom.p, signals.levels, signals.channel]
        # the expression is kept beside its function: a hash is unique only while the node lives
        return ca.Function("input", arguments, [ca.densify(signals.parametrised)]), signals.parametrised

    return eom.mechanism.cache.get_or_create(("explicit input", signals.structure), make)[0]


def explicit_system(numeric: NumericEquations, signals: Signals, integrands: ca.SX | None = None) -> ExplicitSystem:
    """Return the system of a run.

    Parameters
    ----------
    numeric : NumericEquations
        Equations at the parameters of the run.
    signals : Signals
        Inputs.
    integrands : casadi.SX, optional
        Integrands along the motion; the same in every run of a mechanism that has some.
    """
    eom = numeric.eom
    content = ca.SX(0, 1) if integrands is None else ca.densify(integrands)
    quadrature = eom.mechanism.cache.get_or_create(
        ("explicit quadrature", integrands is None), lambda: ca.Function("quadrature", list(eom.symbols), [content])
    )
    return ExplicitSystem(input_of(eom, signals), dynamics_of(numeric), quadrature, projection_of(eom))
