"""The linear system of constrained dynamics, solved as expressions.

    [ M     Phi_q^T ] [ a   ]   [ Q     ]
    [ Phi_q    0    ] [ lam ] = [ gamma ]

With a regular diagonal ``M`` the multipliers follow from
``S lam = Phi_q M⁻¹ Q - gamma``, ``S = Phi_q M⁻¹ Phi_q^T``, by a sparse symbolic
LDL factorisation. If bodies are light or have no mass, ``M`` is replaced by
``M + Phi_q^T A Phi_q`` and ``Q`` by ``Q + Phi_q^T A gamma``, with effective
masses A of the rows (see :mod:`.augmentation`): the solution stays the same,
since ``Phi_q a = gamma``, and the matrix is regular exactly if the joints hold
all coordinates without mass. Redundant rows make ``S`` singular; ``S + epsilon D`` with a
diagonal D of its size, and refinement by conjugate residuals, gives the multipliers of least norm. Effective
masses depend on the directions of the axes, and a D of their size with them: with an
augmentation the multipliers are brought to the least norm by ``S`` with masses that are
more nearly alike, and a D in which moments count by the levers of the forces.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from ..errors import SingularityError
from .derivation import Equations

#: Regularisation of S, relative to the mean of its diagonal. Chains of parallelograms that pass their flat, singular
#: pose keep their branch from 1e-10 to 1e-6 with the damping of :func:`stabilised_solution`, and without it do not;
#: IDAS errs least at 1e-7, with which the peak of the accelerations is wide enough for it.
REGULARISATION = 1e-7
#: Refinement steps of the regularised solve inside an integrator: on two dozen chains of parallelograms through some
#: twenty singular poses each, the largest error fell from 3e-3 rad with one to 1e-4 rad with three, all of them plain.
REFINEMENTS = 3
#: Newton's method for forces that depend on multipliers.
NEWTON = {"linear_solver": "csparse", "error_on_fail": False, "max_iter": 60, "line_search": False, "abstolStep": 0.0}
#: Steps after that: they solve for what is light beside the largest loads.
POLISHING = 3
#: Residual of a solution, relative to its size.
SOLUTION_TOLERANCE = 1e-9
#: Share of the terms of one unit, by the longest lever, below which those of the other may be rounding.
ROUNDED = 1e-3
#: Eigenvalues of S, relative to its diagonal, below which rows count as dependent: in reports, and inside an
#: integrator, whose poses drift from the constraints, and are singular at times. The smallest one of a cantilever
#: falls with the fourth power of the number of its links: 4e-8 with sixty, 1e-9 with 150.
WEAKEST, WEAKEST_ON_THE_WAY = 1e-11, 1e-9
#: Rows for each of which large mechanisms take a step more, as they have more of the smallest eigenvalues.
ROWS_A_STEP = 100
#: Size of loads and accelerations, N and m/s² or N m and rad/s², at which nothing acts.
NOTHING = 1e-150
#: Refinement steps of multipliers that are reported: of these the least-norm solution is wanted to rounding.
REPORT_REFINEMENTS = 4
#: Share of the squared length by the masses that counts as a squared lever where levers vanish, and the largest ratio
#: of moments in the norm by levers to those by masses, with which the regularised solution converges.
NO_LEVER, MOST_BY_LEVERS = 1e-9, 1e3
#: Share of the largest multiplier below which what one has above the least norm is rounding.
LEAST_MORE = 1e-13


def saddle_point_solution(
    eom: Equations, force: ca.SX, gamma: ca.SX | None = None, **options: Any
) -> tuple[ca.SX, ca.SX]:
    """Return ``(a, lam)`` as expressions.

    Parameters
    ----------
    force : casadi.SX
        Generalised forces in place of Q (n,).
    gamma : casadi.SX, optional
        Right side in place of that of the equations (m,).
    **options
        See :func:`saddle_point_solver`.
    """
    return saddle_point_solver(eom, **options)(force, eom.gamma if gamma is None else gamma)


def saddle_point_solver(
    eom: Equations,
    *,
    force_slope: ca.SX | None = None,
    augmentation: np.ndarray | None = None,
    redundant: bool = False,
    refinements: int = REPORT_REFINEMENTS,
    metric: np.ndarray | None = None,
    weakest: float = WEAKEST,
) -> Callable[[ca.SX, ca.SX], tuple[ca.SX, ca.SX]]:
    """Return the function ``(force, gamma) -> (a, lam)`` of right sides, also of several side by side.

    Parameters
    ----------
    force_slope : casadi.SX, optional
        Derivative of the force by the multipliers (n, m), which is then subtracted from ``Phi_q^T``: a step of
        Newton's method for forces that depend on reactions.
    augmentation : numpy.ndarray, optional
        Effective masses of the rows (m,), if some bodies are light or have no mass.
    redundant : bool
        True if rows are dependent; the multipliers are then those of least norm.
    refinements : int
        Refinement steps if they are.
    metric : numpy.ndarray, optional
        Masses that are more nearly alike, of the coordinates (n,), for the least norm; given with an augmentation.
    weakest : float
        See :func:`solve_redundant`.
    """
    jacobian = eom.Phi_q
    weighted = None if augmentation is None else jacobian.T @ ca.diag(ca.DM(augmentation))
    if weighted is not None:
        factors = ca.ldl(ca.diag(eom.mass_diagonal) + weighted @ jacobian)

        def over_mass(right: ca.SX) -> ca.SX:
            return ca.ldl_solve(ca.densify(right), *factors)
    else:
        inverse = 1 / eom.mass_diagonal

        def over_mass(right: ca.SX) -> ca.SX:
            return ca.diag(inverse) @ right

    if jacobian.size1() == 0:
        return lambda force, gamma: (over_mass(force), ca.SX(0, force.size2()))
    columns = jacobian.T if force_slope is None else jacobian.T - force_slope
    schur = jacobian @ over_mass(columns)
    sizes = None if augmentation is None else 1 / augmentation
    factors_of_rows = ca.ldl(schur) if force_slope is None and not redundant else None

    def multipliers(right: ca.SX) -> ca.SX:
        if force_slope is not None:
            return ca.solve(schur, right)
        if factors_of_rows is None:
            # the eigenvalues of A^½ S A^½ lie between 0 and 1
            return solve_redundant(schur, right, eom.angular_rows, refinements, sizes, weakest)
        return ca.ldl_solve(right, *factors_of_rows)

    def solution(force: ca.SX, gamma: ca.SX) -> tuple[ca.SX, ca.SX]:
        force = force if weighted is None else force + weighted @ gamma
        lam = multipliers(jacobian @ over_mass(force) - gamma)
        a = over_mass(force - columns @ lam)
        if redundant and metric is not None:
            alike = jacobian @ ca.diag(ca.DM(1 / metric)) @ jacobian.T
            sizes_of_rows = sizes_by_levers(eom, metric)
            more = lam - solve_redundant(alike, alike @ lam, eom.angular_rows, refinements, sizes_of_rows)
            # of rows that are independent it is rounding, which small multipliers are spared; zeros have derivatives
            rounding = LEAST_MORE * ca.repmat(ca.mmax(ca.fabs(lam)), *lam.shape)
            is_known = ca.logic_or(more == 0, ca.fabs(more) > rounding)
            lam = lam - ca.if_else(is_known, more, 0)
        return a, lam

    return solution


def norm_of_multipliers(eom: Equations, metric: np.ndarray | None) -> ca.SX:
    """Diagonal D in which multipliers of redundant rows have the least norm (m,): by masses, or :func:`by levers
    <sizes_by_levers>` if there is a metric, as beside light bodies."""
    if metric is not None:
        return sizes_by_levers(eom, metric)
    return row_sizes(ca.sum2(eom.Phi_q**2 @ ca.diag(1 / eom.mass_diagonal)), eom.angular_rows)


def sizes_by_levers(eom: Equations, metric: np.ndarray) -> ca.SX:
    """Diagonal D in which multipliers beside light bodies have the least norm (m,).

    Of rows in m it is their mean by the metric, of rows in rad that over the mean square of the levers in the others:
    the same in any units, axes and order, whichever masses are zero.

    Parameters
    ----------
    metric : numpy.ndarray
        Masses that are more nearly alike, of the coordinates (n,).
    """
    angular, angles = eom.angular_rows, eom.angles
    sizes = row_sizes(ca.sum2(eom.Phi_q**2 @ ca.diag(ca.DM(1 / metric))), angular)
    if np.all(angular) or not np.any(angular):
        return sizes
    in_metres, in_radians = np.flatnonzero(~angular).tolist(), np.flatnonzero(angular).tolist()
    straight = (np.arange(angles.size) < 3 * len(eom.mechanism.bodies)) & ~angles
    squares = ca.sum1(eom.Phi_q[in_metres, :] ** 2)
    moved, turned = (ca.sum2(squares[np.flatnonzero(part).tolist()]) for part in (straight, angles))
    least = NO_LEVER * float(np.max(metric[angles]) / np.max(metric[straight]))
    by_levers, by_masses = sizes[in_metres[0]] * moved / (turned + least * moved), sizes[in_radians[0]]
    sizes[in_radians] = ca.fmin(ca.fmax(by_levers, by_masses / MOST_BY_LEVERS), by_masses * MOST_BY_LEVERS)
    return sizes


def shifted(
    matrix: ca.SX, angular: np.ndarray, sizes: ca.SX | np.ndarray | None = None
) -> tuple[ca.SX, ca.SX, list[int]]:
    """LDL factors of ``S + epsilon D``, with D as :func:`row_sizes` gives it."""
    return ca.ldl(matrix + ca.diag(REGULARISATION * row_sizes(ca.diag(matrix), angular, sizes)))


def row_sizes(diagonal: ca.SX, angular: np.ndarray, sizes: ca.SX | np.ndarray | None = None) -> ca.SX:
    """Diagonal D in which multipliers of redundant rows have the least norm (m,).

    It holds the sizes of the diagonal of S if they are known, else its means, in m and in rad apart.
    """
    if sizes is not None:
        return sizes if isinstance(sizes, ca.SX) else ca.SX(ca.DM(sizes))
    found = ca.SX(diagonal.numel(), 1)
    for unit in (angular, ~angular):
        rows = np.flatnonzero(unit).tolist()
        if rows:
            found[rows] = ca.sum1(diagonal[rows]) / len(rows)
    return found


class ImpliedRows:
    """Multipliers of equations of which some rows imply the others.

    Parameters
    ----------
    rows : list of int
        Independent rows that imply all others.
    weights : numpy.ndarray
        Sizes of the columns: a metric of the coordinates (n,).
    """

    def __init__(self, eom: Equations, rows: list[int], weights: np.ndarray):
        self._eom, self._rows, self._weights = eom, rows, weights
        self._implied = [k for k in range(eom.lam.numel()) if k not in set(rows)]
        over = ca.diag(ca.DM(1 / weights)) @ eom.Phi_q.T
        right = eom.Phi_q[rows, :] @ over[:, self._implied]
        #: loads of the independent rows that equal those of each implied row, by column
        self._shares = ca.ldl_solve(ca.densify(right), *ca.ldl(eom.Phi_q[rows, :] @ over[:, rows]))

    def independent(self) -> ca.Function:
        """Compile ``(t, q, lam, p) -> lam``: multipliers with the same loads that are zero for implied rows."""
        lam = ca.SX(self._eom.lam.numel(), 1)
        lam[self._rows] = self._eom.lam[self._rows] + self._shares @ self._eom.lam[self._implied]
        return self._function("independent", lam)

    def least_norm(self, *, light: bool) -> ca.Function:
        """Compile ``(t, q, lam, p) -> lam``: multipliers with the same loads, of least norm.

        They are those of :func:`saddle_point_solution`, without its regularisation, so that they may be differentiated
        twice. `light` if some bodies are light or have no mass.
        """
        eom, count = self._eom, len(self._implied)
        internal = ca.SX(eom.lam.numel(), count)  # multipliers without loads, by column
        internal[self._rows, :], internal[self._implied, :] = -self._shares, ca.SX.eye(count)
        sizes = norm_of_multipliers(eom, self._weights if light else None)
        weighted = internal.T @ ca.diag(sizes)
        return self._function("least_norm", eom.lam - internal @ ca.solve(weighted @ internal, weighted @ eom.lam))

    def _function(self, name: str, lam: ca.SX) -> ca.Function:
        eom = self._eom
        return ca.Function(name, [eom.t, eom.q, eom.lam, eom.p], ca.cse([ca.densify(lam)]))


def solve_redundant(
    matrix: ca.SX,
    right: ca.SX,
    angular: np.ndarray,
    refinements: int,
    sizes: ca.SX | np.ndarray | None = None,
    weakest: float = WEAKEST,
) -> ca.SX:
    """Solve a symmetric positive semi-definite system by LDL, regularised, and refinement by conjugate residuals.

    A step of plain refinement leaves ``epsilon / (mu + epsilon)`` of what belongs to an eigenvalue mu, and the smallest
    of long chains are below epsilon. Conjugate residuals, with the factors as preconditioner, find each of these in
    about one step more. Unlike conjugate gradients they do not pursue what dependent rows contradict each other by, as
    drift, and they end where nothing else is left. The last step is a plain one: it brings what is small to its own
    accuracy. Where the right side is zero, or dependent rows alone are left, all steps are plain, and so linear in the
    right side: derivatives are those of plain refinement.

    Parameters
    ----------
    weakest : float
        Eigenvalue, relative to the diagonal, below which rows count as dependent: what is left there is theirs.

    References
    ----------
    Saad, "Iterative methods for sparse linear systems", 2nd ed., 2003, section 6.8.
    """
    norm = row_sizes(ca.diag(matrix), angular, sizes)
    factors = shifted(matrix, angular, norm)
    solution, rest, left = ca.SX.zeros(*right.shape), ca.densify(right), ca.ldl_solve(ca.densify(right), *factors)
    direction = along = last = strong = where = None
    for _ in range(refinements - 1 + matrix.size1() // ROWS_A_STEP):
        moved = matrix @ left
        size = ca.sum1(left * moved)
        is_strong = size > weakest * (norm.T @ left**2)
        if strong is None:
            strong, direction, along = is_strong, left, moved
        else:
            rest = rest - ca.if_else(where, 0, moved)
            strong = ca.logic_and(strong, is_strong)
            share = _for_each_column(_quotient(size, last, strong), left)
            direction, along = left + share * direction, moved + share * along
        # from where it is not, all further steps are plain, by what is left over: rounding is not added again
        where = _for_each_column(strong, left)
        answer = ca.ldl_solve(ca.if_else(where, along, rest), *factors)
        length = _for_each_column(_quotient(size, ca.sum1(along * answer), strong), left)
        solution, rest = solution + ca.if_else(where, length * direction, answer), rest - length * along
        left, last = ca.if_else(where, left - length * answer, answer), size
    return solution + ca.ldl_solve(right - matrix @ solution, *factors)


def _quotient(one: ca.SX, other: ca.SX, defined: ca.SX) -> ca.SX:
    """Quotient where it is defined, else zero, with derivatives that are finite there."""
    return ca.if_else(defined, one, 0) / ca.if_else(defined, other, 1)


def _for_each_column(values: ca.SX, columns: ca.SX) -> ca.SX:
    """One value for each column, in all of its rows."""
    return ca.repmat(values, columns.size1(), 1)


def stabilised_solution(
    eom: Equations, force: ca.SX, rate: ca.SX, *, augmentation: np.ndarray | None
) -> tuple[ca.SX, ca.SX]:
    """Return ``(a, lam)`` under generalised forces, regularised, with drift that decays at a rate.

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
    gamma = eom.gamma - 2 * rate * (eom.Phi_q @ eom.v - eom.nu) - rate**2 * drift
    options: dict[str, Any] = {"refinements": REFINEMENTS, "weakest": WEAKEST_ON_THE_WAY}
    return saddle_point_solution(eom, force, gamma, augmentation=augmentation, redundant=True, **options)


def forward_dynamics(
    eom: Equations,
    *,
    augmentation: np.ndarray | None = None,
    redundant: bool = False,
    refinements: int = REPORT_REFINEMENTS,
    metric: np.ndarray | None = None,
) -> ca.Function:
    """Compile ``(t, q, v, z, u, p) -> (a, lam)``.

    If a force depends on the multipliers (friction) the system is not
    linear, and Newton's method solves it; multipliers that are not unique raise a SingularityError.
    """
    arguments = [eom.t, eom.q, eom.v, eom.z, eom.u, eom.p]
    names = ["t", "q", "v", "z", "u", "p"]
    if not eom.Q_depends_on_lam:
        options: dict[str, Any] = {"redundant": redundant, "refinements": refinements, "metric": metric}
        a, lam = saddle_point_solution(eom, eom.Q, augmentation=augmentation, **options)
        return ca.Function("forward_dynamics", arguments, [a, lam], names, ["a", "lam"])
    unknowns = ca.vertcat(eom.a, eom.lam)
    residual = ca.vertcat(eom.mass_diagonal * eom.a + eom.Phi_q.T @ eom.lam - eom.Q, eom.Phi_q @ eom.a - eom.gamma)
    if ca.sprank(ca.jacobian_sparsity(residual, unknowns)) < unknowns.numel():
        raise SingularityError(eom.why_not_unique)
    sizes_of = ca.Function("sizes", [unknowns, *arguments], [term_sizes(eom)])
    sizes = ca.SX.sym("sizes", residual.numel())
    function = ca.Function("r", [unknowns, *arguments, sizes], [residual / sizes])
    root = ca.rootfinder("newton", "newton", function, NEWTON)
    symbols = [ca.MX.sym(name, *arg.shape) for name, arg in zip(names, arguments, strict=True)]
    without_friction = ca.substitute(eom.Q, unknowns, ca.SX.zeros(unknowns.numel()))
    bare = ca.vertcat(*saddle_point_solution(eom, without_friction, augmentation=augmentation))
    bare_sizes = sizes_of(ca.Function("bare", arguments, [ca.densify(bare)])(*symbols), *symbols)
    solution = root(ca.MX.zeros(unknowns.numel()), *symbols, bare_sizes)
    polish = ca.rootfinder("polish", "newton", function, NEWTON | {"abstol": 0.0, "max_iter": POLISHING})
    solution = polish(solution, *symbols, bare_sizes)
    n = eom.q.numel()
    # the iteration may stop above its own tolerance by rounding; anything else than a solution becomes NaN
    left_over = ca.mmax(ca.fabs(function(solution, *symbols, sizes_of(solution, *symbols))))
    solution = ca.if_else(left_over <= SOLUTION_TOLERANCE, solution, ca.MX.nan(unknowns.numel()))
    return ca.Function("forward_dynamics", symbols, [solution[:n], solution[n:]], names, ["a", "lam"])


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
