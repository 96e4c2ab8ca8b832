"""Search for an equilibrium: downhill to a stable one, by Newton's method to any, or with the least inputs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..arguments.least_efforts import LeastEfforts
from ..numerics.least_squares import largest, least_norm
from ..numerics.newton import backtrack
from ..numerics.newton import newton as newtons_method
from ..numerics.tolerances import ACCURACY, CONVERGED
from .statics import Statics, Stiffness

#: Largest turn of a body in a step (rad), and its largest displacement (in levers of the mechanism).
LARGEST_STEP = 0.2
#: Largest turn of a body in a step of Newton's method, rad: more leads to equilibria that are far away.
NEWTON_TURN = 0.5
#: Smallest share of a step downhill.
SHORTEST_DESCENT = 1e-6
#: Steps downhill.
STEPS = 400
#: A step this small (in levers) ends the descent: Newton's method takes over.
END_OF_DESCENT = 1e-6
#: Displacement out of an unstable equilibrium, in levers, and number of attempts.
UNSTABLE_PERTURBATION, PERTURBATIONS = 1e-2, 4


def downhill(statics: Statics, x: np.ndarray) -> np.ndarray:
    """Follow the unbalanced forces until they vanish, or the steps are used up.

    Newton steps on the reduced stiffness with the signs of its eigenvalues
    taken away lead downhill also if the stiffness is negative, so that
    unstable equilibria are passed. A step is halved until the forces have done
    work along it, which keeps it from overshooting; no potential is needed.
    """
    x = statics.follow(x)
    here = statics.stiffness(x)
    for _ in range(STEPS):
        step = _step(here, statics.lever)
        size = largest(step)
        if size <= END_OF_DESCENT * statics.lever:
            return x
        step *= min(1.0, LARGEST_STEP * statics.lever / size)

        def with_work_done(
            share: float, x: np.ndarray = x, here: Stiffness = here, step: np.ndarray = step
        ) -> tuple[np.ndarray, Stiffness] | None:
            moved = statics.displaced(x, here.basis @ (share * step))
            if moved is None:
                return None
            there = statics.stiffness(moved)
            path = (moved - x)[: statics.n] / statics.numeric.column_scale**2
            work = here.force @ (here.basis.T @ path) + there.force @ (there.basis.T @ path)
            return (moved, there) if work > 0 else None

        better = backtrack(with_work_done, SHORTEST_DESCENT)
        if better is None:
            return x
        x, here = better
    return x


def _step(stiffness: Stiffness, lever: float) -> np.ndarray:
    values, vectors = np.linalg.eigh((stiffness.matrix + stiffness.matrix.T) / 2)
    floor = max(1e-9 * stiffness.scale, 1e-6 * largest(stiffness.force), np.finfo(float).tiny)
    along = vectors.T @ stiffness.force
    # without a force nothing is gained in a direction, however soft it is
    along[np.abs(along) <= ACCURACY * lever * stiffness.scale] = 0.0
    return vectors @ (along / np.maximum(np.abs(values), floor))


def newton(statics: Statics, x: np.ndarray) -> np.ndarray | None:
    """Equilibrium to rounding by Newton's method on all rows; None if it does not converge."""
    equations, weights = statics.scaled(x)
    limit = np.full(x.size, np.inf)
    limit[np.flatnonzero(statics.eom.angles)] = NEWTON_TURN
    rest = newtons_method(equations, x, weights, step_limit=limit)
    return rest if rest is None or statics.is_loaded(rest) else statics.without_reactions(rest)


def newton_nearby(statics: Statics, x: np.ndarray) -> np.ndarray | None:
    """Equilibrium by Newton's method; from poses near the start if the stiffness vanishes at the start itself."""
    rest = newton(statics, x)
    directions = statics.stiffness(x).directions if rest is None else np.zeros((0, 0))
    for direction in directions.T[:2].real:
        for side in (1, -1, 5, -5):
            moved = statics.displaced(x, side * UNSTABLE_PERTURBATION * statics.lever * direction)
            rest = None if moved is None else newton(statics, moved)
            if rest is not None:
                return rest
    return rest


def with_least_efforts(
    statics: Statics, x: np.ndarray, least: LeastEfforts, efforts: Sequence[int]
) -> np.ndarray | None:
    """Equilibrium in a pose that conditions determine with the least inputs; None if the steps do not converge.

    Newton's method on all rows; inputs are those of least squares that meet the rows to first order, within their
    limits, and all other unknowns follow.

    Parameters
    ----------
    efforts : sequence of int
        Places of the inputs among the unknowns.
    """
    equations, weights = statics.scaled(x)
    rest = np.delete(np.arange(x.size), efforts)
    for _ in range(STEPS):
        values, slope = equations(x)
        acting, others, step = slope[:, efforts], slope[:, rest], np.zeros(x.size)
        step[efforts] = least.beside(others, acting, acting @ x[efforts] - values, statics.t) - x[efforts]
        step[rest] = least_norm(others, -values - acting @ step[efforts], weights[rest])
        x = x + step
        size = 1 + largest(np.sqrt(weights) * x)
        if largest(np.sqrt(weights) * step) <= CONVERGED * size:
            return x if largest(equations(x)[0]) <= CONVERGED * size else None
    return None


def to_stable(statics: Statics, x: np.ndarray) -> np.ndarray | None:
    """Stable equilibrium downhill of a pose; an unstable one if there is none; None if none was found."""
    first: np.ndarray | None = None
    for attempt in range(PERTURBATIONS):
        settled = downhill(statics, x)
        rest = newton(statics, settled)
        if rest is None or statics.distance(settled, rest) > LARGEST_STEP:
            return rest if first is None else first
        stiffness = statics.stiffness(rest)
        if stiffness.negative == 0:
            return rest
        first = rest if first is None else first
        direction = stiffness.directions[:, 0].real
        step = direction * UNSTABLE_PERTURBATION * statics.lever * (1 if attempt % 2 == 0 else -1)
        moved = statics.displaced(rest, step)
        if moved is None:
            return first
        x = moved
    return first
