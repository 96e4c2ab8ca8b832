"""Identification: parameters that explain measured motions best."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..arguments.values import pairs_of, position_in
from ..errors import MechanismWarning, ModelError
from ..model.lists import listed, refuse_twice
from ..model.mechanism import Mechanism
from ..model.symbols import Parameter
from ..sensitivity.compiled_run import MotionSetup
from .data import Experiment, IdentificationError, read_experiments
from .fit import Fit
from .gauss_newton import Outcome, gauss_newton
from .shooting import Shooting

#: Samples in a segment, and segments, where the user does not say.
SAMPLES, MOST_SEGMENTS = 8, 10
#: Rounds in which the noise of each measured quantity is estimated, and the change of it that ends them.
ROUNDS, SAME_NOISE = 6, 0.01
#: Noise that is rounding, relative to the range of the samples.
ROUNDING = 1e-9


def identify(
    mechanism: Mechanism,
    times: Any = None,
    data: Any = None,
    unknowns: Any = (),
    initial: Any = (),
    *,
    inputs: Any = None,
    parameters: Any = None,
    weights: Any = None,
    experiments: Any = None,
    segments: int | None = None,
    iterations: int = 50,
    method: str = "auto",
    reltol: float = 1e-9,
    abstol: float = 1e-9,
) -> Fit:
    """Identify parameters from measured motions by least squares.

    Multiple shooting with Gauss–Newton steps and exact Jacobians. Limits of
    the parameters hold. Whatever is unknown is a Parameter: also a start, in
    ``initial=[rod.phi == first]``, or an input, in ``inputs={tau: gain * mbd.t}``.

    Parameters
    ----------
    mechanism : Mechanism
        The model.
    times : sequence of float
        Times of the samples, the first one the start; at any distances, s.
    data : mapping or list of pairs
        Expression to samples (n_t,), or of a vector (expression, samples (n_t, k)) as a pair; NaN where one is missing.
        Positions, rates, accelerations, reactions: anything that can be measured.
    unknowns : sequence of Parameter
        Searched for from their values, or from those of ``parameters=``.
    initial, inputs, parameters
        As for :func:`simulate`.
    weights : mapping, optional
        Expression to weight, the inverse of the standard deviation of its
        noise up to a common factor. Without, the noise of each quantity is
        estimated from its residuals, so that units do not matter.
    experiments : sequence of Experiment, optional
        Several motions, instead of times, data, initial, inputs, parameters and weights.
    segments : int, optional
        Segments of each motion; 1 is single shooting. About eight samples each where not given, at most ten.
    iterations : int, default 50
        Largest number of Gauss–Newton steps.
    method : {"auto", "idas", "erk", "rosenbrock"}
        Integrator.
    reltol, abstol : float, default 1e-9
        Its tolerances.

    Returns
    -------
    Fit
        ``fit[k]``, ``fit.standard_error[k]``, ``.covariance``, ``.identifiability``, ``.trajectory``.

    Raises
    ------
    IdentificationError
        Where the steps do not settle; ``.partial`` is the last fit.

    Warns
    -----
    MechanismWarning
        For unknowns that cannot be told apart from the data.

    References
    ----------
    Bock, "Recent advances in parameter identification techniques for ODE", 1983.

    Examples
    --------
    >>> import numpy as np, mbdcasadi as mbd
    >>> g = mbd.Parameter("g", 5.0)
    >>> stone = mbd.Body("stone", mass=1, inertia=1)
    >>> fall = mbd.Mechanism(bodies=[stone], forces=[mbd.Gravity((0, -g))], parameters=[g])
    >>> times = np.array([0, 0.5, 1.0, 2.0])
    >>> fit = mbd.identify(fall, times, data={stone.y: -9.81 * times**2 / 2}, unknowns=[g])
    >>> round(fit[g], 6)
    9.81
    """
    wanted = listed(unknowns, Parameter, "unknowns=")
    if not wanted:
        raise ModelError("identify: unknowns= is empty; name the parameters to identify")
    places = [position_in(mechanism.parameters, u, "unknowns=") for u in wanted]
    given = {"initial": initial, "inputs": inputs, "parameters": parameters, "weights": weights}
    motions = read_experiments(times, data, experiments, **given)
    settings: dict[str, Any] = {"method": method, "reltol": reltol, "abstol": abstol}
    shootings = [
        Shooting(
            MotionSetup(
                mechanism,
                "identify",
                e.times,
                initial=e.initial,
                inputs=e.inputs,
                parameters=e.parameters,
                **settings,
            ),
            e,
            places,
            _segments(segments, e),
        )
        for e in motions
    ]
    if isinstance(iterations, bool) or not isinstance(iterations, int) or iterations < 0:
        raise ModelError(f"identify: iterations must be an integer that is not negative, got {iterations!r}")
    theta = shootings[0].setup.numeric.p[places]
    _refuse_few(motions, wanted)
    refuse_twice(wanted, "unknowns=")
    limits = np.array([u.lower for u in wanted]), np.array([u.upper for u in wanted])
    for shooting in shootings:
        shooting.prepare(theta)
    outcome = _search(shootings, theta, limits, motions, iterations)
    own = [pairs_of(e.parameters, "parameters=") for e in motions]
    fit = Fit(
        mechanism,
        motions,
        wanted,
        outcome.theta,
        outcome.jacobian,
        outcome.residual,
        outcome.outputs,
        outcome.iterations,
        own,
    )
    if not outcome.converged:
        raise IdentificationError(
            f"identify: after {outcome.iterations} steps the values still change ({fit!r}); "
            "start nearer, take more segments=, or leave out what the data do not show; .partial holds the last fit",
            partial=fit,
        )
    if any("cannot be told apart" in r or "no trace" in r for r in fit.identifiability):
        warnings.warn("identify: " + "; ".join(fit.identifiability), MechanismWarning, stacklevel=2)
    return fit


def _segments(wanted: int | None, experiment: Experiment) -> int:
    most = experiment.times.size - 1
    if wanted is None:
        return max(1, min(MOST_SEGMENTS, most // SAMPLES))
    if not isinstance(wanted, int) or not 1 <= wanted <= most:
        raise ModelError(f"identify: segments must be an integer from 1 to {most}, got {wanted!r}")
    return wanted


def _refuse_few(motions: Sequence[Experiment], unknowns: Sequence[Parameter]) -> None:
    count = sum(int(np.sum(e.measured)) for e in motions)
    if count < len(unknowns):
        raise ModelError(f"identify: {count} samples cannot determine {len(unknowns)} unknowns")


def _search(
    shootings: Sequence[Shooting],
    theta: np.ndarray,
    limits: tuple[np.ndarray, np.ndarray],
    motions: Sequence[Experiment],
    iterations: int,
) -> Outcome:
    """Gauss–Newton with the weights given, or with those that the residuals ask for."""
    noise = _first_noise(motions)
    taken = 0
    for _ in range(ROUNDS):
        weights = [e.weights if e.weighted else e.weights / s[:, None] for e, s in zip(motions, noise, strict=True)]
        outcome = gauss_newton(shootings, theta, limits, weights, iterations)
        taken += outcome.iterations
        outcome.iterations = taken
        again = _noise(motions, outcome)
        change = max(float(np.max(np.abs(np.log(a / b)))) for a, b in zip(again, noise, strict=True))
        if not outcome.converged or _one_quantity(motions) or change < SAME_NOISE:
            return outcome
        noise, theta = again, outcome.theta
    return outcome


def _one_quantity(motions: Sequence[Experiment]) -> bool:
    """Whether a common factor of all weights is all that the noise could change."""
    return all(e.weighted for e in motions) or (len(motions) == 1 and motions[0].samples.shape[0] == 1)


def _first_noise(motions: Sequence[Experiment]) -> list[np.ndarray]:
    """One per cent of the range of each row of samples."""
    return [np.maximum(0.01 * _range(e), 1e-300) for e in motions]


def _range(experiment: Experiment) -> np.ndarray:
    spread = np.array(
        [
            np.ptp(row[there]) if there.any() else 0.0
            for row, there in zip(experiment.samples, experiment.measured, strict=True)
        ]
    )
    size = np.array(
        [
            np.max(np.abs(row[there]), initial=0.0)
            for row, there in zip(experiment.samples, experiment.measured, strict=True)
        ]
    )
    found = np.where(spread > 0, spread, size)
    return np.where(found > 0, found, 1.0)


def _noise(motions: Sequence[Experiment], outcome: Outcome) -> list[np.ndarray]:
    """Standard deviation of the residuals of each row, not below rounding."""
    found = []
    for e, y in zip(motions, outcome.outputs, strict=True):
        away = np.where(e.measured, y - e.samples, 0.0)
        count = np.maximum(np.sum(e.measured, axis=1), 1)
        found.append(np.maximum(np.sqrt(np.sum(away**2, axis=1) / count), ROUNDING * _range(e)))
    return found
