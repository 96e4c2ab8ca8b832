"""The solution of ``r(x) = 0`` nearest to a target, also where inequalities hold."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from .least_squares import EPSILON, Equations, largest, polish, solve

#: Newton steps, and products with the Hessian in each.
STEPS, PRODUCTS = 100, 50
#: Change of the largest entry by which curvature is measured, and the step that counts as none (relative).
PROBE, SETTLED = 3e-5, 1e-9
#: Eigenvalue of ``J J^T`` below which rows depend on each other (relative).
DEPENDENT = 1e-12
#: Square of the smallest relative residual that conjugate gradients are asked for; below is rounding.
LEAST = 1e-14
#: An inequality counts as met below this.
MET = 1e-10


class _Tangent:
    """Projection onto the null space of a Jacobian, by the eigenvectors of the normal equations.

    Combinations of rows that vanish are left out: dividing by a small shift
    instead would turn their rounding into motion. Applied twice, since once
    leaves a share of what rows of little weight hold.
    """

    def __init__(self, jacobian: np.ndarray):
        self.jacobian = jacobian
        values, vectors = np.linalg.eigh(jacobian @ jacobian.T)
        held = values > DEPENDENT * np.max(values, initial=np.finfo(float).tiny)
        self._inverse = (vectors[:, held] / values[held]) @ vectors[:, held].T

    def split(self, vector: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Tangent part ``v + J^T lam`` of a vector, and the multipliers that make it tangent."""
        multipliers = np.zeros(len(self.jacobian))
        rest = vector
        for _ in range(2):
            multipliers -= self._inverse @ (self.jacobian @ rest)
            rest = vector + self.jacobian.T @ multipliers
        return rest, multipliers


def nearest(equations: Equations, feasible: np.ndarray, target: np.ndarray, weights: np.ndarray) -> np.ndarray:
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
        Where x would be without equations.
    weights : numpy.ndarray
        Positive metric W (n,).

    References
    ----------
    Nocedal and Wright, *Numerical Optimization*, 2006, section 7.1 (Newton–CG) and 18.1 (reduced Newton steps).
    """
    root = np.sqrt(weights)
    x = polish(equations, np.array(feasible, float), weights)
    if largest(x - target) <= EPSILON * (1 + largest(x)):
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
        if largest(step) <= SETTLED * size:
            return x
    return x


def _newton_step(
    equations: Equations,
    x: np.ndarray,
    root: np.ndarray,
    tangent: _Tangent,
    gradient: np.ndarray,
    multipliers: np.ndarray,
) -> np.ndarray:
    """Solve ``P H P s = -P g`` by conjugate gradients, in coordinates in which the metric is one.

    Where the curvature is not positive, the descent so far is as good as any.
    """

    def product(direction: np.ndarray) -> np.ndarray:
        way = direction / root
        way *= PROBE / max(largest(way), np.finfo(float).tiny)
        change = (equations(x + way)[1] - equations(x - way)[1]).T @ multipliers
        length = np.linalg.norm(direction) / max(float(np.linalg.norm(root * way)), np.finfo(float).tiny)
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
        if square <= max(min(1e-4, start), LEAST) * start:
            break
        direction = residual + square / before * direction
    return step


def _slide(
    equations: Equations, x: np.ndarray, step: np.ndarray, target: np.ndarray, weights: np.ndarray
) -> np.ndarray | None:
    """Go as much of a step as brings the solution nearer to the target; None where nothing does."""

    def distance(point: np.ndarray) -> float:
        return float((point - target) @ (weights * (point - target)))

    # Near the minimum the distance is flat: there a step must not be refused for rounding. What is left of the
    # residual changes the distance to first order, so that points are compared when they are polished.
    bound = distance(x) * (1 + 10 * EPSILON)
    flat = largest(step) <= 1e-5 * (1 + largest(x))
    share = 1.0
    while share > 1e-3:
        trial = solve(equations, x + share * step, weights, iterations=12)
        if trial.converged:
            point = polish(equations, trial.x, weights)
            if distance(point) < distance(x) or (flat and distance(point) <= bound):
                return point
        share /= 2
    return None


def nearest_within(
    meet: Callable[[Sequence[int]], np.ndarray],
    values: Callable[[np.ndarray], np.ndarray],
    pushes: Callable[[np.ndarray, Sequence[int]], np.ndarray],
    active: Sequence[int] = (),
) -> np.ndarray | None:
    """Nearest point under inequalities, by an active set.

    One that is broken is held as an equality; one that would let go towards
    the target, as its multiplier says, is released.

    Parameters
    ----------
    meet : callable
        ``active -> x``: the nearest point on which these inequalities hold as equalities.
    values : callable
        ``x -> (k,)``: values of all inequalities, which are met where they are not positive.
    pushes : callable
        ``(x, active) -> multipliers`` of those that are held; negative where one pulls instead of pushing.
    active : sequence of int, optional
        Those that are held at first.

    Returns
    -------
    numpy.ndarray or None
        None where the set comes round in a circle.

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
        if held and np.min(push) < -1e-9 * (1 + largest(push)):
            del held[int(np.argmin(push))]
            continue
        broken = values(x)
        broken[held] = 0.0
        worst = int(np.argmax(broken))
        if broken[worst] <= MET:
            return x
        held.append(worst)
    return None


def multipliers_at(jacobian: np.ndarray, away: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Multipliers of least norm with ``W away + J^T lam = 0``, as nearly as can be; `away` leads from the target."""
    root = np.sqrt(weights)
    return np.linalg.lstsq((jacobian / root).T, -root * away, rcond=1e-10)[0]
