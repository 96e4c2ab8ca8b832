"""Accelerations and multipliers: the saddle system of the masses and the constraints."""

from __future__ import annotations

import casadi as ca
import numpy as np

from ..errors import SingularityError
from ..numerics.tolerances import NEGLIGIBLE
from .derivation import Equations
from .least_norm import of_least_norm
from .saddle import REPORTED, Refinement, Saddle

#: Newton's method for forces that depend on multipliers.
NEWTON = {"linear_solver": "csparse", "error_on_fail": False, "max_iter": 60, "line_search": False, "abstolStep": 0.0}
#: Steps after that: they solve for what is light beside the largest loads.
POLISHING = 3
#: Share of the terms of one unit, by the longest lever, below which those of the other may be rounding.
ROUNDED = 1e-3
#: Size of loads and accelerations, N and m/s² or N m and rad/s², at which nothing acts.
NOTHING = 1e-150


def dynamics_saddle(
    eom: Equations,
    augmentation: np.ndarray | None,
    refinement: Refinement | None = None,
    *,
    under_reactions: bool = False,
) -> Saddle:
    """Return the system of accelerations and multipliers, factorised once for a mechanism.

    Parameters
    ----------
    augmentation : numpy.ndarray, optional
        Effective masses of the rows (m,), if some bodies are light or have no mass.
    refinement : Refinement, optional
        How dependent rows are solved; the multipliers are then those of least norm.
    under_reactions : bool
        True to take forces that depend on multipliers in to first order.
    """

    def make() -> Saddle:
        slope = ca.jacobian(eom.Q, eom.lam) if under_reactions else None
        rows = eom.Phi_q, eom.angular_rows
        return Saddle(eom.mass_diagonal, *rows, refinement, augmentation=augmentation, slope=slope)

    key = "dynamics saddle", None if augmentation is None else augmentation.tobytes(), refinement, under_reactions
    return eom.mechanism.cache.get_or_create(key, make, bounded=True)


def stabilised(eom: Equations, rate: ca.SX) -> ca.SX:
    """Right side of the acceleration equation (m,) with drift that decays at a rate.

    ``Phi_q a = gamma - 2 Ω (Phi_q v - nu) - Ω² Phi``. In a singular pose any
    drift of the velocities is divided by a singular value that passes through
    zero, and throws the motion onto another branch; damped, it is gone before.

    References
    ----------
    Baumgarte 1972; Bayo and Avello, "Singularity-free augmented Lagrangian
    algorithms for constrained multibody dynamics", Nonlinear Dynamics 5, 1994.
    """
    drift = ca.SX(eom.lam.numel(), 1)
    drift[eom.position_rows.tolist()] = eom.Phi
    return eom.gamma - 2 * rate * (eom.Phi_q @ eom.v - eom.nu) - rate**2 * drift


def solved_linearly(eom: Equations, saddle: Saddle, force: ca.SX, gamma: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Return ``(a, lam)`` under forces that depend on multipliers linearly, or not at all.

    With ``Q = Q_0 + B lam``, of which few columns k are not empty, and the solutions ``(a_0, lam_0)`` under ``Q_0`` and
    ``(A, L)`` under B: ``(I - L_k) lam_k = lam_0k``. Rows may depend on each other if the multipliers k are unique.
    """
    slope = ca.jacobian(force, eom.lam)
    which = np.flatnonzero(np.diff(slope.sparsity().colind())).tolist()
    bare = ca.substitute(force, eom.lam, ca.SX.zeros(eom.lam.numel()))
    a, lam = saddle.solve(bare, gamma)
    if not which:
        return a, lam
    by_a, by_lam = saddle.solve(ca.densify(slope[:, which]), ca.SX.zeros(gamma.numel(), len(which)))
    load = ca.solve(ca.SX.eye(len(which)) - by_lam[which, :], lam[which])
    return a + by_a @ load, lam + by_lam @ load


def forward_dynamics(
    eom: Equations,
    augmentation: np.ndarray | None,
    *,
    redundant: bool,
    weights: np.ndarray | None,
) -> ca.Function:
    """Compile ``(t, q, v, z, u, p) -> (a, lam)``.

    If a force depends on the multipliers (friction) the system is not
    linear, and Newton's method solves it; multipliers that are not unique raise a SingularityError.

    Parameters
    ----------
    redundant : bool
        True if rows are dependent; the multipliers are then those of least norm, by `weights` (n,) beside light bodies.
    """
    arguments = [eom.t, eom.q, eom.v, eom.z, eom.u, eom.p]
    names = ["t", "q", "v", "z", "u", "p"]
    if not eom.Q_depends_on_lam or (redundant and eom.Q_is_linear_in_lam):
        saddle = dynamics_saddle(eom, augmentation, REPORTED if redundant else None)
        a, lam = solved_linearly(eom, saddle, eom.Q, eom.gamma)
        lam = lam if weights is None else of_least_norm(eom, lam, weights)
        return ca.Function("forward_dynamics", arguments, [a, lam], names, ["a", "lam"])
    unknowns = ca.vertcat(eom.a, eom.lam)
    residual = eom.residual()
    if ca.sprank(ca.jacobian_sparsity(residual, unknowns)) < unknowns.numel():
        raise SingularityError(eom.why_not_unique)
    sizes_of = ca.Function("sizes", [unknowns, *arguments], [term_sizes(eom)])
    sizes = ca.SX.sym("sizes", residual.numel())
    function = ca.Function("r", [unknowns, *arguments, sizes], [residual / sizes])
    root = ca.rootfinder("newton", "newton", function, NEWTON)
    symbols = [ca.MX.sym(name, *arg.shape) for name, arg in zip(names, arguments, strict=True)]
    without_friction = ca.substitute(eom.Q, unknowns, ca.SX.zeros(unknowns.numel()))
    bare = ca.vertcat(*dynamics_saddle(eom, augmentation).solve(without_friction, eom.gamma))
    bare_sizes = sizes_of(ca.Function("bare", arguments, [ca.densify(bare)])(*symbols), *symbols)
    found = root(ca.MX.zeros(unknowns.numel()), *symbols, bare_sizes)
    polish = ca.rootfinder("polish", "newton", function, NEWTON | {"abstol": 0.0, "max_iter": POLISHING})
    found = polish(found, *symbols, bare_sizes)
    n = eom.q.numel()
    # the iteration may stop above its own tolerance by rounding; anything else than a solution becomes NaN
    left_over = ca.mmax(ca.fabs(function(found, *symbols, sizes_of(found, *symbols))))
    found = ca.if_else(left_over <= NEGLIGIBLE, found, ca.MX.nan(unknowns.numel()))
    return ca.Function("forward_dynamics", symbols, [found[:n], found[n:]], names, ["a", "lam"])


def term_sizes(eom: Equations) -> ca.SX:
    """Sizes of the terms of ``M a + Phi_q^T lam = Q`` and ``Phi_q a = gamma``, the largest of each unit (n + m,)."""
    loads = ca.fabs(eom.Phi_q.T) @ ca.fabs(eom.lam) + ca.fabs(eom.Q)
    forces = ca.fabs(eom.mass_diagonal * eom.a) + loads
    # accelerations of a motion that is steady are the differences of what each load alone would bring
    free = ca.if_else(eom.mass_diagonal > 0, loads / eom.mass_diagonal, 0)
    rates = ca.fabs(eom.Phi_q) @ (ca.fabs(eom.a) + free) + ca.fabs(eom.gamma)
    turning, straight = np.flatnonzero(eom.angles).tolist(), np.flatnonzero(~eom.angular_rows).tolist()
    lever = _largest(ca.fabs(eom.Phi_q[straight, turning]))
    lever = ca.if_else(lever > NOTHING, lever, 1)
    sizes = []
    for terms, angular, length in ((forces, eom.angles, lever), (rates, eom.angular_rows, 1 / lever)):
        straight, turning = (_largest(terms[np.flatnonzero(part).tolist()]) for part in (~angular, angular))
        # terms of one unit may be the rounding of those of the other, as the couples on a block that only slides
        known = ca.fmax(straight, ROUNDED * turning / length), ca.fmax(turning, ROUNDED * length * straight)
        sizes += [ca.if_else(known[int(turns)] > NOTHING, known[int(turns)], 1) for turns in angular]
    return ca.vertcat(*sizes)


def _largest(terms: ca.SX) -> ca.SX:
    return ca.mmax(ca.densify(terms)) if terms.numel() else ca.SX(0)
