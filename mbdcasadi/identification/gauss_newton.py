"""Gauss–Newton over all experiments: condensed steps within limits, shortened until they lower the cost."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ..errors import MechanismError
from ..numerics.console import quiet
from ..numerics.least_squares import largest
from ..numerics.newton import backtrack
from ..numerics.tolerances import NEGLIGIBLE
from .data import range_of
from .loss import LINEAR, Loss
from .shooting import Shooting

#: Relative step, and gap between segments (m, rad, m/s), that count as none.
SETTLED, CLOSED = 1e-8, 1e-7
#: Step that is no step any more where rounding keeps the cost from falling.
STALLED = 1e-5
#: Damping of a step, relative to the squares of the columns: what cannot be distinguished then stays where it is.
DAMPING = 1e-12
#: Rounds in which the noise of each measured quantity is estimated, and the change of it that ends them.
ROUNDS, SAME_NOISE = 6, 0.01


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
        Steps that were taken, in all rounds.
    converged : bool
        True if steps and gaps vanished.
    """

    theta: np.ndarray
    jacobian: np.ndarray
    residual: np.ndarray
    outputs: list[np.ndarray]
    iterations: int
    converged: bool = False


class GaussNewton:
    """Search for the unknowns that make the loss of the weighted residuals least, with all gaps closed.

    Parameters
    ----------
    shootings : sequence of Shooting
        The experiments, their segments started.
    limits : (numpy.ndarray, numpy.ndarray)
        Lower and upper limits.
    loss : Loss
        Of the weighted residuals.
    iterations : int
        Largest number of steps in a round.

    Attributes
    ----------
    so_far : GaussNewtonOutcome or None
        The last values that were evaluated.
    """

    def __init__(
        self, shootings: Sequence[Shooting], limits: tuple[np.ndarray, np.ndarray], loss: Loss, iterations: int
    ):
        self._shootings, self._limits, self._iterations = shootings, limits, iterations
        self._experiments = [s.experiment for s in shootings]
        self._final_loss, self._loss = loss, LINEAR
        self._weights: list[np.ndarray] = []
        self.so_far: GaussNewtonOutcome | None = None

    def run(self, theta: np.ndarray) -> GaussNewtonOutcome:
        """Search with the weights given, or with those that the residuals ask for.

        A robust loss knows outliers from the noise only near to the solution: the first round takes the squares.
        """
        noise, loss = [np.maximum(0.01 * range_of(e), 1e-300) for e in self._experiments], self._final_loss
        for _ in range(ROUNDS):
            robust = self._loss.is_robust
            self._weights = [
                e.weights if e.weighted and not robust else e.weights / s[:, None]
                for e, s in zip(self._experiments, noise, strict=True)
            ]
            outcome = self._minimise(theta)
            again = self._noise(outcome)
            change = max(float(np.max(np.abs(np.log(a / b)))) for a, b in zip(again, noise, strict=True))
            same = change < SAME_NOISE or (not loss.is_robust and self._weighs_one_quantity())
            if robust == loss.is_robust and (same or not outcome.converged):
                break
            noise, theta, self._loss = again, outcome.theta, loss
        return outcome

    def _minimise(self, theta: np.ndarray) -> GaussNewtonOutcome:
        """Minimise the loss of the residuals with the present weights."""
        taken = self.so_far.iterations if self.so_far else 0
        penalty, typical, (lower, upper) = 1.0, np.abs(theta), self._limits
        for count in range(self._iterations + 1):
            linearised = [s.linearise(theta) for s in self._shootings]
            residual = self._weighted([f.outputs for f in linearised])
            rows = list(zip(self._experiments, self._weights, linearised, strict=True))
            jacobian = np.vstack([(w[:, :, None] * f.slope)[e.measured] for e, w, f in rows])
            closing = np.concatenate([(w * f.closing)[e.measured] for e, w, f in rows])
            gaps = np.concatenate([f.gaps.ravel() for f in linearised])
            of_residual, of_slope = self._loss.factors(residual)
            scaled, slopes, closed = of_residual * residual, of_slope[:, None] * jacobian, of_slope * closing
            step = _step(slopes, scaled + closed, lower - theta, upper - theta)
            size = largest(step / np.maximum(np.maximum(np.abs(theta), typical), 1e-12))
            outcome = GaussNewtonOutcome(theta, jacobian, residual, [f.outputs for f in linearised], taken + count)
            self.so_far = outcome
            if size <= SETTLED and largest(gaps) <= CLOSED:
                outcome.converged = True
            if outcome.converged or count == self._iterations:
                break
            change, square = closed + slopes @ step, float(gaps @ gaps)
            if square > 0:  # closing the gaps may cost more than it did to leave them open
                penalty = max(penalty, 2 * float((2 * scaled + change) @ change) / square)
            moves = [f.node_slope @ step + f.node_closing for f in linearised]
            share = self._shorten(theta, step, moves, self._loss.cost(residual) + penalty * square, penalty)
            if share is None:
                outcome.converged = size <= STALLED and largest(gaps) <= 1e2 * CLOSED
                break
            for shooting, move in zip(self._shootings, moves, strict=True):
                shooting.nodes = shooting.nodes + share * move
            theta = np.clip(theta + share * step, lower, upper)
        return outcome

    def _weighted(self, outputs: Sequence[np.ndarray]) -> np.ndarray:
        """Weighted residuals of all experiments (N,)."""
        rows = zip(self._experiments, self._weights, outputs, strict=True)
        return np.concatenate([(w * (y - np.where(e.measured, e.samples, 0.0)))[e.measured] for e, w, y in rows])

    def _shorten(
        self, theta: np.ndarray, step: np.ndarray, moves: Sequence[np.ndarray], before: float, penalty: float
    ) -> float | None:
        """Fraction of a step that lowers cost and gaps; None if none does."""

        def lower(share: float) -> float | None:
            try:
                runs = [
                    s.evaluate(theta + share * step, s.nodes + share * move)
                    for s, move in zip(self._shootings, moves, strict=True)
                ]
            except MechanismError:  # no start, or no end, with these values: they are too far
                return None
            squares = sum(float(np.sum(gaps**2)) for _, gaps, _ in runs)
            cost = self._loss.cost(self._weighted([outputs for outputs, _, _ in runs])) + penalty * squares
            return share if cost < before else None

        return backtrack(lower)

    def _weighs_one_quantity(self) -> bool:
        """True if a common factor of all weights is all that the noise could change."""
        first, *others = self._experiments
        return all(e.weighted for e in self._experiments) or (not others and first.samples.shape[0] == 1)

    def _noise(self, outcome: GaussNewtonOutcome) -> list[np.ndarray]:
        """Deviation of the residuals of each row, not below rounding; with weights the one factor of all rows."""
        residuals = [(e, y - e.samples) for e, y in zip(self._experiments, outcome.outputs, strict=True)]
        spread, weighted = self._final_loss.spread, [(e.weights * r)[e.measured] for e, r in residuals if e.weighted]
        factor = spread(np.concatenate(weighted)) if weighted else 1.0
        noise = []
        for e, r in residuals:
            rows = [spread(row[there]) for row, there in zip(r, e.measured, strict=True)]
            least = NEGLIGIBLE * range_of(e)
            noise.append(np.full(len(rows), max(factor, 1e-300)) if e.weighted else np.maximum(rows, least))
        return noise


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
            solution = solver(h=hessian, g=scaled.T @ residual, lbx=lower * size, ubx=upper * size)["x"].full().ravel()
        step = np.clip(solution, lower * size, upper * size)
    return step / size
