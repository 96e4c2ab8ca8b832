"""Gauss–Newton over all experiments: condensed steps within limits, shortened until they lower the cost."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ..errors import MechanismError
from ..numerics.console import quiet
from ..numerics.least_squares import largest
from ..numerics.newton import backtrack
from .loss import Loss
from .shooting import Linearised, Shooting

#: Relative step, and gap between segments (m, rad, m/s), that count as none.
SETTLED, CLOSED = 1e-8, 1e-7
#: Step that is no step any more where rounding keeps the cost from falling.
STALLED = 1e-5
#: Damping of a step, relative to the squares of the columns: what cannot be distinguished then stays where it is.
DAMPING = 1e-12


@dataclass
class GaussNewtonOutcome:
    """End of the Gauss–Newton iteration.

    Attributes
    ----------
    theta : numpy.ndarray
        Values of the unknowns.
    jacobian : numpy.ndarray
        Of the weighted residuals (N, n_theta).
    residual : numpy.ndarray
        Weighted residuals (N,).
    outputs : list of numpy.ndarray
        Model at the samples, by experiment.
    iterations : int
        Steps that were taken.
    converged : bool
        True if steps and gaps vanished.
    """

    theta: np.ndarray
    jacobian: np.ndarray
    residual: np.ndarray
    outputs: list[np.ndarray]
    iterations: int
    converged: bool


def gauss_newton(
    shootings: Sequence[Shooting],
    theta: np.ndarray,
    limits: tuple[np.ndarray, np.ndarray],
    weights: Sequence[np.ndarray],
    iterations: int,
    loss: Loss,
    report: Callable[[GaussNewtonOutcome], None],
) -> GaussNewtonOutcome:
    """Minimise the loss of the weighted residuals with all gaps closed.

    Parameters
    ----------
    shootings : sequence of Shooting
        The experiments, their segments started.
    theta : numpy.ndarray
        Start.
    limits : (numpy.ndarray, numpy.ndarray)
        Lower and upper limits.
    weights : sequence of numpy.ndarray
        By experiment (n_y, n_t).
    iterations : int
        Largest number of steps.
    loss : Loss
        Of the weighted residuals.
    report : callable
        Called with the outcome so far before each step.
    """
    penalty, typical = 1.0, np.abs(theta)
    for count in range(iterations + 1):
        linearised = [s.linearise(theta) for s in shootings]
        residual, jacobian, closing, gaps = _stacked(shootings, linearised, weights)
        of_residual, of_slope = loss.factors(residual)
        scaled, slopes, closed = of_residual * residual, of_slope[:, None] * jacobian, of_slope * closing
        step = _step(slopes, scaled + closed, limits[0] - theta, limits[1] - theta)
        size = largest(step / np.maximum(np.maximum(np.abs(theta), typical), 1e-12))
        outcome = GaussNewtonOutcome(theta, jacobian, residual, [f.outputs for f in linearised], count, False)
        report(outcome)
        if size <= SETTLED and largest(gaps) <= CLOSED:
            outcome.converged = True
            return outcome
        if count == iterations:
            return outcome
        slope = float(scaled @ (closed + slopes @ step))
        square = float(gaps @ gaps)
        if square > 0:
            penalty = max(penalty, 2 * slope / square)
        before = loss.cost(residual) + penalty * square
        share = _shorten(shootings, linearised, weights, theta, step, before, penalty, loss)
        if share is None:
            outcome.converged = size <= STALLED and largest(gaps) <= 1e2 * CLOSED
            return outcome
        for shooting, f in zip(shootings, linearised, strict=True):
            shooting.nodes = shooting.nodes + share * (f.node_slope @ step + f.node_closing)
        theta = np.clip(theta + share * step, *limits)
    raise AssertionError("the loop returns")


def _stacked(
    shootings: Sequence[Shooting], linearised: Sequence[Linearised], weights: Sequence[np.ndarray]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Weighted residuals, Jacobian, change by closing gaps, and gaps of all experiments."""
    residual, jacobian, closing = [], [], []
    for s, f, w in zip(shootings, linearised, weights, strict=True):
        there = s.experiment.measured
        residual.append((w * (f.outputs - np.where(there, s.experiment.samples, 0.0)))[there])
        jacobian.append((w[:, :, None] * f.slope)[there])
        closing.append((w * f.closing)[there])
    gaps = np.concatenate([f.gaps.ravel() for f in linearised])
    return np.concatenate(residual), np.vstack(jacobian), np.concatenate(closing), gaps


def _step(jacobian: np.ndarray, residual: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Least-squares step within limits, by a quadratic programme in scaled unknowns."""
    size = np.linalg.norm(jacobian, axis=0)
    size = np.where(size > 0, size, 1.0)
    scaled = jacobian / size
    hessian = scaled.T @ scaled + DAMPING * np.eye(size.size)
    step = -np.linalg.solve(hessian, scaled.T @ residual)
    if np.any(step < lower * size) or np.any(step > upper * size):
        options = {"print_iter": False, "print_header": False, "print_info": False, "error_on_fail": False}
        with quiet():
            solver = ca.conic("step", "qrqp", {"h": ca.Sparsity.dense(*hessian.shape)}, options)
            found = solver(h=hessian, g=scaled.T @ residual, lbx=lower * size, ubx=upper * size)["x"].full().ravel()
        step = np.clip(found, lower * size, upper * size)
    return step / size


def _shorten(
    shootings: Sequence[Shooting],
    linearised: Sequence[Linearised],
    weights: Sequence[np.ndarray],
    theta: np.ndarray,
    step: np.ndarray,
    before: float,
    penalty: float,
    loss: Loss,
) -> float | None:
    """Fraction of a step that lowers cost and gaps; None if none does."""

    def lower(share: float) -> float | None:
        try:
            cost = 0.0
            for s, f, w in zip(shootings, linearised, weights, strict=True):
                nodes = s.nodes + share * (f.node_slope @ step + f.node_closing)
                outputs, gaps, _ = s.evaluate(theta + share * step, nodes)
                there = s.experiment.measured
                away = (w * (outputs - np.where(there, s.experiment.samples, 0.0)))[there]
                cost += loss.cost(away) + penalty * float(np.sum(gaps**2))
            return share if cost < before else None
        except MechanismError:  # no start, or no end, with these values: they are too far
            return None

    return backtrack(lower)
