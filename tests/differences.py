"""Rows and forces of a mechanism against finite differences, from Phi and the virtual work alone."""

from __future__ import annotations

import numpy as np

import mbdcasadi as mbd


def _evaluator(mechanism, t, z=None, u=None, lam=None):
    eom = mbd.equations(mechanism)
    z = np.zeros(eom.z.numel()) if z is None else z
    u = eom.input_values if u is None else u
    lam = np.zeros(eom.lam.numel()) if lam is None else lam

    def value(expression, q, v, time=t):
        arguments = time, q, v, np.zeros(eom.q.numel()), z, lam, u, eom.parameter_values
        return eom.function(expression)(*arguments).full()

    return eom, value


def check_rows(mechanism, q, v, t=0.3, step=1e-6, tolerance=1e-7):
    """Phi_q, nu and gamma of all rows at a state (on the constraints or not) against central differences.

    Velocity-level rows are differenced from the element's own expression.
    """
    eom, value = _evaluator(mechanism, t)
    n = q.size
    jacobian, nu, gamma = (value(x, q, v) for x in (eom.Phi_q, eom.nu, eom.gamma))
    position = eom.position_rows
    scale = 1 + np.max(np.abs(jacobian))
    for k in range(n):
        h = np.zeros(n)
        h[k] = step
        slope = (value(eom.Phi, q + h, v) - value(eom.Phi, q - h, v)) / (2 * step)
        np.testing.assert_allclose(jacobian[position, k], slope.ravel(), rtol=0, atol=tolerance * scale)
    rate = (value(eom.Phi, q, v, t + step) - value(eom.Phi, q, v, t - step)) / (2 * step)
    np.testing.assert_allclose(nu[position], -rate, rtol=0, atol=tolerance * scale)
    level = eom.Phi_q @ eom.v - eom.nu  # all rows at velocity level
    ahead, behind = (value(level, q + s * v, v, t + s) for s in (step, -step))
    size = 1 + np.max(np.abs(gamma)) + np.max(np.abs(ahead))
    np.testing.assert_allclose(gamma, -(ahead - behind) / (2 * step), rtol=0, atol=10 * tolerance * size)


def power_of(mechanism, q, v, t=0.3, z=None, u=None):
    """``Q · v`` at a state, W."""
    eom, value = _evaluator(mechanism, t, z, u)
    return float(value(eom.Q, q, v).ravel() @ v)


def value_of(mechanism, expression, q, v, t=0.3, z=None, u=None, lam=None):
    """Any expression at a state that need not be consistent."""
    return _evaluator(mechanism, t, z, u, lam)[1](expression, q, v)


def check_balance(element, mechanism, q, v, rng, tolerance=1e-11):
    """Forces and moments of an element on all its bodies cancel, the carrier's and the ground's included."""
    eom = mbd.equations(mechanism)
    lam = rng.normal(size=eom.lam.numel())
    force, moment, size = np.zeros(2), 0.0, 1.0
    for body in element.bodies:
        reaction = element.reaction_on(body)
        marker = element.marker_on(body)
        f = value_of(mechanism, reaction.force, q, v, lam=lam).ravel()
        r = value_of(mechanism, marker.position, q, v, lam=lam).ravel()
        couple = float(value_of(mechanism, reaction.torque, q, v, lam=lam)[0, 0])
        force += f
        moment += couple + r[0] * f[1] - r[1] * f[0]
        size = max(size, np.max(np.abs(f)), abs(couple))
    np.testing.assert_allclose(force, 0, atol=tolerance * size)
    assert abs(moment) <= tolerance * size
