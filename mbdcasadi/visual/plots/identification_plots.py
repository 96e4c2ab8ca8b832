"""Pictures of an identification: data, model and residuals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import MechanismError
from ...identification.fit import spread_of
from ..axes import readable
from ..drawing.style import SERIES_LIGHT

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ...identification.fit import Fit


def plot_residuals(fit: Fit, labels: Sequence[str] | None = None) -> Figure:
    """Plot samples with the model through them, and the residuals beneath, for every measured quantity.

    A good model leaves residuals without a pattern, most of them within the
    band of two standard deviations that is drawn.

    Parameters
    ----------
    fit : Fit
        Result of :func:`identify`.
    labels : sequence of str, optional
        Of every measured quantity in the order of the data, with units ("tip x, m"); the
        expressions themselves by default.

    Returns
    -------
    matplotlib.figure.Figure
        Two rows of axes for each measured quantity, one column for each experiment.
    """
    from matplotlib.figure import Figure

    experiments = getattr(fit, "experiments", None)
    if experiments is None:
        raise MechanismError(f"plot_residuals: takes the result of identify, got {fit!r}")
    count = {len(e.labels) for e in experiments}
    if labels is not None and (isinstance(labels, str) or count != {len(labels)}):
        raise MechanismError(
            f"plot_residuals: labels= needs a text for each of {max(count)} quantities, got {labels!r}"
        )
    rows = max(len(e.labels) for e in experiments)
    figure = Figure(figsize=(5.0 * len(experiments), 3.2 * rows), layout="constrained")
    grid = figure.subplots(2 * rows, len(experiments), squeeze=False, sharex="col", height_ratios=[2, 1] * rows)
    for column, (e, model, residual) in enumerate(zip(experiments, fit.model, fit.residuals, strict=True)):
        for k, label in enumerate(e.labels if labels is None else labels):
            _one(grid[2 * k : 2 * k + 2, column], e.times, e.samples[k], model[k], residual[k], label)
        for axes in grid[2 * len(e.labels) :, column]:
            axes.set_visible(False)
        grid[2 * len(e.labels) - 1, column].set_xlabel("t, s")
        if e.name:
            readable(grid[0, column].set_title(e.name), name=True)
    figure.align_ylabels()
    return figure


def _one(pair: Any, t: np.ndarray, samples: np.ndarray, model: np.ndarray, residual: np.ndarray, label: str) -> None:
    above, below = pair
    above.plot(t, samples, ".", color=SERIES_LIGHT[5], markersize=4, label="data")
    above.plot(t, model, color=SERIES_LIGHT[0], linewidth=1.4, label="model")
    readable(above.set_ylabel(label))
    above.legend(frameon=False, fontsize="small")
    spread = float(np.nan_to_num(spread_of(residual)))
    below.axhspan(-2 * spread, 2 * spread, color=SERIES_LIGHT[0], alpha=0.12, linewidth=0)
    below.axhline(0.0, color=SERIES_LIGHT[5], linewidth=0.6)
    below.plot(t, residual, ".", color=SERIES_LIGHT[1], markersize=4)
    below.set_ylabel("residual")
    for axes in pair:
        axes.spines[["top", "right"]].set_visible(False)
