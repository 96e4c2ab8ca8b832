"""The solution of ``r(x) = 0`` nearest to a target, also under inequalities."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np

from .console import quiet
from .least_squares import largest, least_norm, row_scale
from .newton import Equations, backtrack, refine_root, solve
from .rank import inverse_of_independent, unit_rows
from .tolerances import EPSILON, NEGLIGIBLE

#: Newton steps, and products with the Hessian in each.
STEPS, PRODUCTS = 100, 50
#: Distance from the target, relative to ``1 + |x|``, that is rounding of the sizes by which unknowns are divided.
SAME = 8 * EPSILON
#: Change of the largest entry by which curvature is measured, and the step that counts as none (relative).
PROBE, NO_STEP = 3e-5, 1e-9
#: Eigenvalue of ``J J^T`` below which rows depend on each other (relative).
DEPENDENT_EIGENVALUE = 1e-12
#: Square of the smallest relative residual that conjugate gradients are asked for; below is rounding.
SMALLEST_RESIDUAL = 1e-14
#: Share of a step down to which one is looked for that leads nearer.
SHORTEST_SLIDE = 1e-3
#: An inequality counts as met below this, in its own unit.
INEQUALITY_TOLERANCE = 1e-10
#: Singular values of ``W^-1/2 J^T`` below this share are left out when multipliers are found.
MULTIPLIERS = 1e-10


class _Tangent:
    """Projection onto the null space of a Jacobian, by the normal equations; by their eigenvectors if need be.

    Rows are of unit length, so that those in metres count beside those in radians in any size. Combinations of rows
    that vanish are left out: dividing by a small shift instead would turn their rounding into motion. Applied twice,
    since once leaves a share of what rows of little weight hold.
    """

    def __init__(self, jacobian: np.ndarray):
        self._scale = row_scale(jacobian, np.ones(jacobian.shape[1]))
        self.jacobian = jacobian * self._scale[:, None]
        square = self.jacobian @ self.jacobian.T
        inverse = inverse_of_independent(square)
        if inverse is None:
            values, vectors = np.linalg.eigh(square)
            held = values > DEPENDENT_EIGENVALUE * np.max(values, initial=np.finfo(float).tiny)
            inverse = (vectors[:, held] / values[held]) @ vectors[:, held].T
        self._inverse = inverse

    def split(self, vector: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Tangent part ``v + J^T lam`` of a vector, and the multipliers that make it tangent."""
        multipliers = np.zeros(len(self.jacobian))
        rest = vector
        for _ in range(2):
            multipliers -= self._inverse @ (self.jacobian @ rest)
            rest = vector + self.jacobian.T @ multipliers
        return rest, multipliers * self._scale


def nearest(
    equations: Equations,
    feasible: np.ndarray,
    target: np.ndarray,
    weights: np.ndarray,
    *,
    sizes: np.ndarray | None = None,
) -> np.ndarray:
    """Slide along the solutions of ``r(x) = 0`` to the one nearest to a target.

    Minimises ``½ (x - target)^T W (x - target)`` by Newton steps in the tangent
    space, each brought back onto ``r = 0`` and halved until the distance falls.
    The curvature of the constraints enters, by differences of the Jacobian:
    without it convergence is linear and ends where the distance is flat to
    rounding, some 1e-6 from the minimum.

    Parameters
    ----------
    equations : callable
        ``x -> (residual, jacobian)``.
    feasible : numpy.ndarray
        A solution, from which to start.
    target : numpy.ndarray
        Target (n,): x without any equations.
    weights : numpy.ndarray
        Positive metric W (n,).
    sizes : numpy.ndarray, optional
        Sizes that the unknowns typically have (n,), if they are not one.

    References
    ----------
    Nocedal and Wright, *Numerical Optimization*, 2006, section 7.1 (Newton–CG) and 18.1 (reduced Newton steps).
    """
    if sizes is not None:

        def in_sizes(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            residual, jacobian = equations(sizes * x)
            return residual, jacobian * sizes

        return sizes * nearest(in_sizes, feasible / sizes, target / sizes, weights * sizes**2)
    root = np.sqrt(weights)
    x = refine_root(equations, np.array(feasible, float), weights)
    if largest(x - target) <= SAME * (1 + largest(x)) or _is_alone(equations(x)[1]):
        return x
    for _ in range(STEPS):
        _, jacobian = equations(x)
        tangent = _Tangent(jacobian / root)
        gradient, multipliers = tangent.split(root * (x - target))
        size = 1 + largest(x)
        if largest(gradient / root) <= EPSILON * size:
            return x
        step = _newton_step(equations, x, root, tangent, gradient, multipliers) / root
        moved = _slide(equations, x, step, target, weights)
        if moved is None:
            step = -gradient / root
            moved = _slide(equations, x, step, target, weights)
        if moved is None:
            return x
        x = moved
        if largest(step) <= NO_STEP * size:
            return x
    return x


def _is_alone(jacobian: np.ndarray) -> bool:
    """Return True if the rows determine all unknowns by far: there is nothing to slide along."""
    rows, unknowns = jacobian.shape
    unit = unit_rows(jacobian)
    return rows >= unknowns and inverse_of_independent(unit.T @ unit) is not None


def _newton_step(
    equations: Equations,
    x: np.ndarray,
    root: np.ndarray,
    tangent: _Tangent,
    gradient: np.ndarray,
    multipliers: np.ndarray,
) -> np.ndarray:
    """Solve ``P H P s = -P g`` by conjugate gradients, in coordinates in which the metric is one.

    If the curvature is not positive, the descent so far is returned.
    """

    def product(direction: np.ndarray) -> np.ndarray:
        probe = direction / root
        probe *= PROBE / max(largest(probe), np.finfo(float).tiny)
        change = (equations(x + probe)[1] - equations(x - probe)[1]).T @ multipliers
        length = np.linalg.norm(direction) / max(float(np.linalg.norm(root * probe)), np.finfo(float).tiny)
        return tangent.split(direction + change / root * length / 2)[0]

    step = np.zeros_like(gradient)
    residual = -gradient
    direction = residual
    start = square = float(residual @ residual)
    for _ in range(min(gradient.size, PRODUCTS)):
        bent = product(direction)
        curvature = float(direction @ bent)
        if curvature <= 1e-8 * float(direction @ direction):
            return step if np.any(step) else -gradient
        share = square / curvature
        step = step + share * direction
        residual = tangent.split(residual - share * bent)[0]
        before, square = square, float(residual @ residual)
        if square <= max(min(1e-4, start), SMALLEST_RESIDUAL) * start:
            break
        direction = residual + square / before * direction
    return step


def _slide(
    equations: Equations, x: np.ndarray, step: np.ndarray, target: np.ndarray, weights: np.ndarray
) -> np.ndarray | None:
    """Go as much of a step as brings the solution nearer to the target; None if nothing does."""

    def distance(point: np.ndarray) -> float:
        return float((point - target) @ (weights * (point - target)))

    # Near the minimum the distance is flat: there a step must not be refused for rounding. What is left of the
    # residual changes the distance to first order, so that points are compared when they are refined.
    bound = distance(x) * (1 + 10 * EPSILON)
    flat = largest(step) <= 1e-5 * (1 + largest(x))

    def nearer(share: float) -> np.ndarray | None:
        trial = solve(equations, x + share * step, weights, iterations=12)
        if not trial.converged:
            return None
        point = refine_root(equations, trial.x, weights)
        return point if distance(point) < distance(x) or (flat and distance(point) <= bound) else None

    return backtrack(nearer, SHORTEST_SLIDE)


def project_with_inequalities(
    meet: Callable[[Sequence[int]], np.ndarray],
    values: Callable[[np.ndarray], np.ndarray],
    pushes: Callable[[np.ndarray, Sequence[int]], np.ndarray],
    active: Sequence[int] = (),
) -> np.ndarray | None:
    """Nearest point under inequalities, by an active set.

    A broken inequality is held as an equality; it is released if its multiplier
    says that it would open towards the target.

    Parameters
    ----------
    meet : callable
        ``active -> x``: the nearest point on which these inequalities hold as equalities.
    values : callable
        ``x -> (k,)``: values of all inequalities, which are met if they are not positive.
    pushes : callable
        ``(x, active) -> multipliers`` of those that are held; negative if one pulls instead of pushing.
    active : sequence of int, optional
        Inequalities that are held at first.

    Returns
    -------
    numpy.ndarray or None
        None if the active set repeats itself.

    References
    ----------
    Nocedal and Wright, *Numerical Optimization*, 2006, section 16.5.
    """
    held = list(active)
    seen: set[frozenset[int]] = set()
    while frozenset(held) not in seen:
        seen.add(frozenset(held))
        x = meet(held)
        push = pushes(x, held)
        if held and np.min(push) < -NEGLIGIBLE * (1 + largest(push)):
            del held[int(np.argmin(push))]
            continue
        broken = values(x)
        broken[held] = 0.0
        worst = int(np.argmax(broken))
        if broken[worst] <= INEQUALITY_TOLERANCE:
            return x
        held.append(worst)
    return None


def multipliers_at(jacobian: np.ndarray, away: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Multipliers of least norm with ``W away + J^T lam = 0``, as nearly as can be, without a unit.

    They are those of rows of unit length in the metric, by the distance from the target; `away` leads from it.
    """
    root = np.sqrt(weights)
    distance = float(np.linalg.norm(root * away))
    if distance == 0:
        return np.zeros(len(jacobian))
    rows = jacobian / root * row_scale(jacobian, weights)[:, None]
    return least_norm(rows.T, -root * away / distance, threshold=MULTIPLIERS)


def nearest_by_ipopt(
    unknowns: ca.SX, equalities: Sequence[ca.SX], inequalities: Sequence[ca.SX], target: np.ndarray, weights: np.ndarray
) -> np.ndarray:
    """Return the last iterate of IPOPT, from which simpler steps may find a solution that they did not find before.

    Arguments are those of :func:`nearest_finder`; `target` (n,) is the start, and the point to be near to.
    """
    return nearest_finder(unknowns, equalities, inequalities, weights)(target)


def nearest_finder(
    unknowns: ca.SX, equalities: Sequence[ca.SX], inequalities: Sequence[ca.SX], weights: np.ndarray
) -> Callable[[np.ndarray], np.ndarray]:
    """Return a function from a target, which is the start as well, to the last iterate of IPOPT.

    Parameters
    ----------
    unknowns : casadi.SX
        (n,).
    equalities, inequalities : sequence of casadi.SX
        In the unknowns alone, ``== 0`` and ``<= 0``.
    weights : numpy.ndarray
        Metric (n,).
    """
    target = ca.SX.sym("target", unknowns.numel())
    away = unknowns - target
    distance = 0.5 * ca.dot(ca.DM(weights) * away, away)
    equal, unequal = (ca.vertcat(ca.SX(0, 1), *rows) for rows in (equalities, inequalities))
    lower = np.r_[np.zeros(equal.numel()), np.full(unequal.numel(), -np.inf)]
    problem = {"x": unknowns, "p": target, "f": distance, "g": ca.densify(ca.vertcat(equal, unequal))}
    silent = {"print_time": False, "show_eval_warnings": False, "error_on_fail": False, "expand": True}
    options = {"print_level": 0, "sb": "yes", "max_iter": 300, "tol": 1e-10}
    with quiet():
        solver = ca.nlpsol("nearest", "ipopt", problem, silent | {"ipopt": options})

    def find(point: np.ndarray) -> np.ndarray:
        with quiet():
            x: np.ndarray = solver(x0=point, p=point, lbg=lower, ubg=0)["x"].full().ravel()
        return x

    return find
