"""Result of an identification: values, standard errors, unknowns that cannot be distinguished."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..arguments.values import mapping_of
from ..errors import ModelError
from ..model.mechanism import Mechanism
from ..numerics.lazy import cached_property
from ..results.notebook import html_table
from ..results.trajectory import Trajectory
from ..simulation.simulate import simulate
from .data import Experiment
from .gauss_newton import GaussNewtonOutcome
from .loss import LINEAR, Loss
from .shooting import UNSEEN

#: Correlation from which two unknowns can hardly be distinguished.
HARDLY = 0.99
#: Share of an unknown in a combination that is named.
NAMED = 0.1


class ByUnknown(dict):
    """Numbers by unknown; the key is the symbol itself."""

    def __missing__(self, key: Any) -> float:
        names = ", ".join(k.label for k in self)
        raise ModelError(f"'{getattr(key, 'label', key)}' was not among the unknowns: {names}")


def spread_of(residual: np.ndarray, loss: Loss = LINEAR) -> float:
    """Standard deviation of the known residuals; NaN without any."""
    there = residual[np.isfinite(residual)]
    return loss.spread(there) if there.size else float("nan")


class Fit:
    """Identified parameters; ``fit[k]`` is a value.

    Attributes
    ----------
    unknowns : tuple of Parameter
        Symbols that were identified.
    values : numpy.ndarray
        Their values (n,).
    covariance : numpy.ndarray
        (n, n): ``variance (J^T J)⁻¹``, J weighted by the noise; infinite for what leaves no trace in the data, zero
        for what is at a limit. With a robust loss the variance is that of the estimate (Huber 1981, section 7.6).
    standard_error : dict
        Unknown to the root of the diagonal of the covariance.
    correlation : numpy.ndarray
        (n, n).
    noise : tuple of dict
        By experiment, label of the output to the standard deviation of its residuals, of outliers apart with a robust
        loss.
    identifiability : tuple of str
        Symbols that the data do not distinguish, or hardly, in words; empty if there are none.
    residuals : tuple of numpy.ndarray
        By experiment, model less data (n_y, n_t); NaN where a sample is missing.
    loss : {"linear", "huber", "soft_l1"}
        Loss of the residuals.
    cost : float
        Sum of the losses of the weighted residuals, of their squares for "linear".
    iterations : int
        Gauss–Newton steps.
    experiments : tuple of Experiment
        The data.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        experiments: Sequence[Experiment],
        unknowns: Sequence[Any],
        outcome: GaussNewtonOutcome,
        loss: Loss,
    ):
        self.mechanism, self.experiments, self.unknowns = mechanism, tuple(experiments), tuple(unknowns)
        self.values, self.iterations, self.loss = np.array(outcome.theta), outcome.iterations, loss.name
        self.cost = loss.cost(outcome.residual)
        self.model = tuple(outcome.outputs)
        self.residuals = tuple(
            np.where(e.measured, y - e.samples, np.nan) for e, y in zip(experiments, self.model, strict=True)
        )
        self.noise = tuple(
            {label: spread_of(row, loss) for label, row in zip(e.labels, r, strict=True)}
            for e, r in zip(experiments, self.residuals, strict=True)
        )
        self._judge(outcome.jacobian, outcome.residual, loss)

    def _judge(self, jacobian: np.ndarray, weighted: np.ndarray, loss: Loss) -> None:
        """Covariance, correlation, and what cannot be distinguished."""
        free = [
            k
            for k, (u, x) in enumerate(zip(self.unknowns, self.values, strict=True))
            if min(x - u.lower, u.upper - x) > 1e-9 * (1 + abs(x))
        ]
        n = len(self.unknowns)
        remarks = [
            f"'{u.label}' is at its limit {self.values[k]:.6g}: the data ask for a value beyond it"
            for k, u in enumerate(self.unknowns)
            if k not in free
        ]
        self.covariance = np.zeros((n, n))
        variance = loss.variance(weighted, len(free))
        # unknowns change in shares of their size
        scale = np.array([abs(x) if x != 0 else 1.0 for x in self.values])[free]
        _, singular, right = np.linalg.svd(jacobian[:, free] * scale, full_matrices=False)
        seen = singular > UNSEEN * max(float(np.max(singular, initial=0.0)), np.finfo(float).tiny)
        inverse = (right[seen].T / singular[seen] ** 2) @ right[seen] * variance
        self.covariance[np.ix_(free, free)] = inverse * np.outer(scale, scale)
        for vector in right[~seen]:
            remarks.append(self._unseen(vector, free))
            for k in np.flatnonzero(np.abs(vector) > NAMED):
                self.covariance[free[k], :] = self.covariance[:, free[k]] = np.nan
                self.covariance[free[k], free[k]] = np.inf
        errors = np.sqrt(np.diag(self.covariance))
        self.standard_error = ByUnknown(zip(self.unknowns, errors.tolist(), strict=True))
        with np.errstate(invalid="ignore", divide="ignore"):
            self.correlation = self.covariance / np.outer(errors, errors)
        np.fill_diagonal(self.correlation, 1.0)
        self.identifiability = tuple(remarks + self._hardly(errors))

    def _unseen(self, vector: np.ndarray, free: list[int]) -> str:
        named = [k for k in np.argsort(-np.abs(vector)) if abs(vector[k]) > NAMED]
        labels = [self.unknowns[free[k]].label for k in named]
        if len(named) == 1:
            return f"'{labels[0]}' leaves no trace in the data: no sample changes with it"
        share = vector[named] / vector[named[0]]
        moves = ", ".join(f"'{label}' by {s:+.3g} %" for label, s in zip(labels, share, strict=True))
        names = " and ".join(f"'{label}'" for label in labels)
        return f"{names} cannot be distinguished: change {moves}, and no sample changes"

    def _hardly(self, errors: np.ndarray) -> list[str]:
        pairs = []
        for i in range(len(errors)):
            for j in range(i):
                if (
                    np.isfinite(self.correlation[i, j])
                    and abs(self.correlation[i, j]) > HARDLY
                    and errors[i] * errors[j] > 0
                ):
                    pair = f"'{self.unknowns[j].label}' and '{self.unknowns[i].label}'"
                    correlation = f"their correlation is {self.correlation[i, j]:.4f}"
                    pairs.append(f"{pair} can hardly be distinguished: {correlation}")
            if np.isfinite(errors[i]) and errors[i] > abs(self.values[i]):
                pairs.append(f"'{self.unknowns[i].label}' is hardly determined: its standard error exceeds its value")
        return pairs

    # --- use ------------------------------------------------------------------------
    def __getitem__(self, unknown: Any) -> float:
        """Value of an unknown."""
        return ByUnknown(self.parameters)[unknown]

    @property
    def parameters(self) -> dict[Any, float]:
        """Unknown to value, as ``parameters=`` takes it."""
        return dict(zip(self.unknowns, self.values.tolist(), strict=True))

    @cached_property
    def trajectories(self) -> tuple[Trajectory, ...]:
        """The motion of each experiment with the values found, by :func:`simulate`."""
        return tuple(
            simulate(
                self.mechanism,
                e.times,
                initial=e.initial,
                inputs=e.inputs,
                parameters=mapping_of(e.parameters, "parameters=") | self.parameters,
            )
            for e in self.experiments
        )

    @property
    def trajectory(self) -> Trajectory:
        """The motion of the first experiment."""
        return self.trajectories[0]

    def __repr__(self) -> str:
        width = max(len(u.label) for u in self.unknowns)
        lines = [f"Fit after {self.iterations} steps, {sum(int(np.sum(e.measured)) for e in self.experiments)} samples"]
        for u, value in zip(self.unknowns, self.values, strict=True):
            lines.append(f"  {u.label:<{width}} = {value:.6g} ± {self.standard_error[u]:.2g}")
        return "\n".join(lines + [f"  note: {remark}" for remark in self.identifiability])

    def _repr_html_(self) -> str:
        """Values with their standard errors as a table, for notebooks."""
        rows = [
            (u.label, f"{value:.6g}", f"{self.standard_error[u]:.2g}")
            for u, value in zip(self.unknowns, self.values, strict=True)
        ]
        return html_table(repr(self).splitlines()[0], rows, ["", "value", "standard error"], self.identifiability)
