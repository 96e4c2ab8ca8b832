"""A fingerprint of a mechanism: values of its equations, which distinguish it from others with the same names.

A digest of expressions would differ between equal mechanisms that were built
in another order, or by another version of the package; values do not.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from ..equations import Equations
from ..numerics.tolerances import MET

#: Size of the steps from the states of the motion to states beside them, in q (m, rad) and v (m/s, rad/s).
STEP = 1e-2, 1.0


def fingerprint(eom: Equations, states: Sequence[np.ndarray]) -> np.ndarray:
    """Evaluate masses, forces and constraints at some states.

    Of ``t, q, v, a, z, lam, u, p`` by time (n_t, k), the parameters (1, k), the first, a middle and the last state are
    taken, and states beside them, at which springs are not relaxed and dampers not at rest: (k, size).
    """
    t, q, v, *others, p = (np.asarray(x, float) for x in states)
    if not len(t):
        return np.zeros((0, 0))
    some = np.unique([0, len(t) // 2, len(t) - 1])
    # irrational multiples: no two coordinates move alike
    beside = np.modf(np.sqrt(2) * np.arange(1, q.shape[1] + 1))[0] - 0.5
    expression = ca.densify(ca.vertcat(*[column for _, _, column in _quantities(eom)]))
    function = ca.Function("fingerprint", list(eom.symbols), [expression])
    rows = [
        function(t[k], q[k] + side * STEP[0] * beside, v[k] + side * STEP[1] * beside, *(x[k] for x in others), p[0])
        for side in (0, 1)
        for k in some
    ]
    return np.hstack([row.full() for row in rows]).T


def difference(eom: Equations, there: np.ndarray, here: np.ndarray) -> str:
    """Return the first difference of two fingerprints in words, "" if there is none."""
    if there.shape != here.shape:
        return "the number of forces, rows or states"
    start = 0
    for quantity, names, column in _quantities(eom):
        a, b = (values[:, start : start + column.numel()] for values in (there, here))
        start += column.numel()
        size = np.max(np.abs(np.nan_to_num([a, b], posinf=0.0, neginf=0.0)), initial=0.0)
        with np.errstate(invalid="ignore"):
            differs = ~(np.abs(a - b) <= MET * size) & ~((a == b) | (np.isnan(a) & np.isnan(b)))
        if differs.any():
            row, k = np.argwhere(differs)[0]
            return f"{quantity} '{names[k]}' ({a[row, k]:.6g} there, {b[row, k]:.6g} here)"
    return ""


def _quantities(eom: Equations) -> list[tuple[str, Sequence[str], ca.SX]]:
    """Quantities in the equations: a description, the names of the entries, and a column of expressions."""
    states = [state.label for state in eom.mechanism.states]
    return [
        ("the mass or inertia at", eom.coordinate_names, eom.mass_diagonal),
        ("the constraint", eom.position_names, eom.Phi),
        ("the rate of the constraint", eom.row_names, eom.Phi_q @ eom.v - eom.nu),
        ("the acceleration of the constraint", eom.row_names, eom.gamma),
        ("the force at", eom.coordinate_names, eom.Q),
        ("the rate of", states, eom.z_rate),
        ("the potential energy of", [eom.mechanism.name or "the mechanism"], ca.SX(eom.potential)),
    ]
