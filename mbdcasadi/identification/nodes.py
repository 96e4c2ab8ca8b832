"""Starts of segments from data: the state nearest to a guess that shows what was measured."""

from __future__ import annotations

import casadi as ca
import numpy as np

from ..numerics.least_squares import least_norm
from ..numerics.newton import solve
from ..numerics.projection import project_velocity
from ..numerics.rank import analyse_rank
from ..sensitivity.compiled_run import MotionSetup
from .data import Experiment

#: Singular values below this share of the largest one are directions that the data do not show.
DISTINGUISHED = 1e-6


def nodes_from_data(setup: MotionSetup, experiment: Experiment, index: int, guess: np.ndarray) -> np.ndarray:
    """State ``(q, v, z)`` at a time of the experiment.

    What is measured of positions moves the pose, its differences in time the
    velocity, as little as need be; the constraints hold to rounding. First-order
    states, and whatever is not seen in the data, stay as guessed.
    """
    numeric, eom = setup.numeric, setup.eom
    n, time = eom.q.numel(), float(setup.grid[index])
    q, v, z = guess[:n], guess[n : 2 * n], guess[2 * n :]
    outputs = ca.vertcat(*[ca.vec(e) for e in experiment.outputs])
    others = ca.vertcat(eom.v, eom.a, eom.z, eom.lam, eom.u)
    usable = [k for k in np.flatnonzero(experiment.measured[:, index]) if not ca.depends_on(outputs[int(k)], others)]
    if not usable:
        return guess
    rows = ca.densify(outputs[[int(k) for k in usable]])
    function = ca.Function(
        "measured", [eom.q, eom.t, eom.p], [rows, ca.jacobian(rows, eom.q), ca.jacobian(rows, eom.t)]
    )
    target = experiment.samples[usable, index]

    def both(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        phi, jacobian = numeric.position(time, q)
        values, slope, _ = function(q, time, numeric.p)
        return np.r_[phi, values.full().ravel() - target], np.vstack([jacobian, slope.full()])

    led = solve(both, q, numeric.weights, iterations=20, step_limit=0.5)
    closed = solve(lambda q: numeric.position(time, q), led.x, numeric.weights, iterations=20)
    if not closed.converged:
        return guess
    q = closed.x
    jacobian, nu = numeric.velocity(time, q)
    _, slope, drift = function(q, time, numeric.p)
    rates = np.array([_rate(setup.grid, experiment.samples[k], index) for k in usable])
    seen = np.isfinite(rates)
    free = analyse_rank(jacobian).null_columns
    v = project_velocity(jacobian, nu, v)
    missing = (rates - drift.full().ravel() - slope.full() @ v)[seen]
    v = v + free @ least_norm(slope.full()[seen] @ free, missing, threshold=DISTINGUISHED)
    return np.concatenate([q, v, z])


def _rate(times: np.ndarray, samples: np.ndarray, index: int) -> float:
    """Slope of a line through the samples around a time; NaN where there are not two."""
    near = [k for k in range(max(index - 2, 0), min(index + 3, times.size)) if np.isfinite(samples[k])]
    if len(near) < 2:
        return np.nan
    return float(np.polyfit(times[near] - times[index], samples[near], 1)[0])
