"""Multipliers and inputs of a motion from elsewhere: drivers and inputs are duals.

A motion that a driver enforces needs the driver's effort; the input that works
along the same displacement makes the same motion with the same value.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from ..equations import equations
from ..equations.numeric import NumericEquations
from ..errors import ModelError
from ..results.trajectory import Trajectory
from .guess import Guess
from .problem import OptimalControlProblem


def guess_by_inverse_dynamics(
    problem: OptimalControlProblem, numeric: NumericEquations, motion: Trajectory, marks: np.ndarray
) -> Guess:
    """A motion of the same bodies, with the inputs and multipliers that come nearest to the equations of motion.

    Parameters
    ----------
    problem : OptimalControlProblem
        Whose equations count.
    numeric : NumericEquations
        They, at parameters.
    motion : Trajectory
        Of a mechanism with the same bodies: driven, or with other inputs.
    marks : numpy.ndarray
        Times to which it is stretched, s.
    """
    eom, other = problem.equations, equations(motion.mechanism)
    same = {s.element_hash(): k for k, s in enumerate(ca.vertsplit(other.q))}
    missing = [s.name() for s in ca.vertsplit(eom.q) if s.element_hash() not in same]
    if missing:
        raise ModelError(f"optimize: the trajectory given as guess has no coordinate {missing[0]}")
    columns = [same[s.element_hash()] for s in ca.vertsplit(eom.q)]
    loads = ca.horzcat(eom.Phi_q.T, -ca.jacobian(eom.Q, eom.u))
    zero = ca.SX.zeros(eom.u.numel()), ca.SX.zeros(eom.lam.numel())
    missing_load = ca.substitute(eom.Q - eom.mass_diagonal * eom.a, ca.vertcat(eom.u, eom.lam), ca.vertcat(*zero))
    system = ca.Function("loads", [*eom.symbols], [ca.densify(loads), ca.densify(missing_load)])
    begin, span = motion.t[0], motion.t[-1] - motion.t[0]
    stretch = (marks[-1] - marks[0]) / span
    z0, no_lam = eom.estimate[2], np.zeros(eom.lam.numel())

    def sample(wanted: np.ndarray) -> dict[str, np.ndarray]:
        at = motion.at(np.clip(begin + wanted / stretch, begin, motion.t[-1]))
        q, v, a = at.q[:, columns], at.v[:, columns] / stretch, at.a[:, columns] / stretch**2
        z = np.tile(z0, (wanted.size, 1))
        found = np.zeros((wanted.size, eom.lam.numel() + eom.u.numel()))
        for k, t in enumerate(wanted):
            at_state = t, q[k], v[k], a[k], z[k], no_lam, eom.input_values, numeric.p
            matrix, load = (part.full() for part in system(*at_state))
            found[k] = np.linalg.lstsq(matrix, load.ravel(), rcond=1e-10)[0]
        lam, u = np.split(found, [eom.lam.numel()], axis=1)
        return {"q": q, "v": v, "a": a, "z": z, "rate": 0 * z, "lam": lam, "u": u}

    free = np.array([p.value for p in problem.free_parameters])
    return Guess(sample, marks, free, "inverse dynamics")
