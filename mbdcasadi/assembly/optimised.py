"""The nearest point under equations and inequalities by IPOPT: the way out where simpler steps do not settle."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from ..numerics.console import quiet


def nearest_by_ipopt(
    unknowns: ca.SX, equalities: Sequence[ca.SX], inequalities: Sequence[ca.SX], target: np.ndarray, weights: np.ndarray
) -> np.ndarray:
    """Return where IPOPT ends; the caller finds out whether that is a solution.

    Parameters
    ----------
    unknowns : casadi.SX
        (n,).
    equalities, inequalities : sequence of casadi.SX
        In the unknowns alone, ``== 0`` and ``<= 0``.
    target : numpy.ndarray
        Start, and the point to be near to.
    weights : numpy.ndarray
        Metric (n,).
    """
    away = unknowns - ca.DM(target)
    distance = 0.5 * ca.dot(ca.DM(weights) * away, away)
    equal, unequal = (ca.vertcat(ca.SX(0, 1), *rows) for rows in (equalities, inequalities))
    lower = np.r_[np.zeros(equal.numel()), np.full(unequal.numel(), -np.inf)]
    problem = {"x": unknowns, "f": distance, "g": ca.densify(ca.vertcat(equal, unequal))}
    silent = {"print_time": False, "show_eval_warnings": False, "error_on_fail": False, "expand": True}
    options = {"print_level": 0, "sb": "yes", "max_iter": 300, "tol": 1e-10}
    with quiet():
        solver = ca.nlpsol("nearest", "ipopt", problem, silent | {"ipopt": options})
        return solver(x0=target, lbg=lower, ubg=0)["x"].full().ravel()
