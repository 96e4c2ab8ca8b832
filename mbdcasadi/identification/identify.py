"""Identification: parameters that explain measured motions best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..arguments.values import pairs_of, position_in
from ..equations import equations
from ..errors import Interrupted, ModelError, warn
from ..integrators import Integrator
from ..model.events import Event
from ..model.mechanism import Mechanism
from ..model.quantities import listed, refuse_twice, whole
from ..model.symbols import Parameter
from ..numerics.console import keyboard_interrupts
from ..sensitivity.compiled_run import MotionSetup
from ..simulation.changes.events import refuse_events
from .data import Experiment, IdentificationError, read_experiments
from .fit import Fit
from .gauss_newton import GaussNewtonOutcome, gauss_newton
from .loss import LINEAR, Loss
from .shooting import Shooting

#: Tolerance of the integrator unless another one is given.
TOLERANCE = 1e-9
#: Samples in a segment, and segments, unless the user says otherwise.
SAMPLES, MOST_SEGMENTS = 8, 10
#: Rounds in which the noise of each measured quantity is estimated, and the change of it that ends them.
ROUNDS, SAME_NOISE = 6, 0.01
#: Noise that is rounding, relative to the range of the samples.
NOISE_TOLERANCE = 1e-9


def identify(
    mechanism: Mechanism,
    times: Any = None,
    data: Any = None,
    unknowns: Any = (),
    initial: Any = (),
    *,
    inputs: Any = None,
    parameters: Any = None,
    events: Sequence[Event] = (),
    weights: Any = None,
    experiments: Any = None,
    segments: int | None = None,
    iterations: int = 50,
    loss: str = "linear",
    f_scale: float = 1.345,
    method: str | Integrator = "auto",
    reltol: float | None = None,
    abstol: float | None = None,
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
    events : sequence of Event
        Not supported: refused with the analyses that take them.
    weights : mapping, optional
        Expression to weight, the inverse of the standard deviation of its
        noise up to a common factor. Without, the noise of each quantity is
        estimated from its residuals, so that units do not matter.
    experiments : sequence of Experiment, optional
        Several motions, instead of times, data, initial, inputs, parameters and weights.
    segments : int, optional
        Segments of each motion; 1 is single shooting. About eight samples each if left out, at most ten.
    iterations : int, default 50
        Largest number of Gauss–Newton steps.
    loss : {"linear", "huber", "soft_l1"}
        Loss, as in ``scipy.optimize.least_squares``: by their squares, or those beyond `f_scale`
        by their size, so that outliers hardly change the fit.
    f_scale : float, default 1.345
        Residual from which a sample counts as an outlier, in standard deviations of the noise (found from the inner
        half of the residuals). With the default a fit to normal noise without outliers is 95 % as efficient as
        that of the squares by "huber".
    method : {"auto", "idas", "erk", "rosenbrock"} or Integrator
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
        If the steps do not converge; ``.partial`` is the last fit.
    Interrupted
        On Ctrl-C; ``.partial`` is the best fit so far, None before the first one.

    Warns
    -----
    MechanismWarning
        For unknowns that the data do not distinguish.

    References
    ----------
    Bock, "Recent advances in parameter identification techniques for ODE", 1983; Huber, *Robust Statistics*, 1981.

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
    refuse_events(events, "identify")
    wanted = listed(unknowns, Parameter, "unknowns=")
    if not wanted:
        raise ModelError("identify: unknowns= is empty; name the parameters to identify")
    equations(mechanism)  # refuses what is none
    places = [position_in(mechanism.parameters, u, "unknowns=") for u in wanted]
    of_one = {"initial": initial, "inputs": inputs, "parameters": parameters, "weights": weights}
    motions = read_experiments(times, data, experiments, **of_one)
    counts = Loss(loss, f_scale)
    most_steps = whole(iterations, "identify", "iterations", 0)
    _refuse_few(motions, wanted)
    refuse_twice(wanted, "unknowns=")
    tolerances: dict[str, Any] = {"reltol": reltol, "abstol": abstol}
    keeps = abstol is not None or isinstance(method, Integrator)
    if not isinstance(method, Integrator):
        tolerances = {name: TOLERANCE if value is None else value for name, value in tolerances.items()}
    own = [pairs_of(e.parameters, "parameters=") for e in motions]

    def fit_of(outcome: GaussNewtonOutcome) -> Fit:
        results = outcome.theta, outcome.jacobian, outcome.residual, outcome.outputs, outcome.iterations
        return Fit(mechanism, motions, wanted, *results, own, counts)

    so_far: list[GaussNewtonOutcome] = []
    try:
        with keyboard_interrupts("identify"):
            shootings = []
            for e in motions:
                given = {"initial": e.initial, "inputs": e.inputs, "parameters": e.parameters, "method": method}
                setup = MotionSetup(mechanism, "identify", e.times, **given, keeps_abstol=keeps, **tolerances)
                shootings.append(Shooting(setup, e, places, _segments(segments, e)))
            theta = shootings[0].setup.p[places]
            limits = np.array([u.lower for u in wanted]), np.array([u.upper for u in wanted])
            for shooting in shootings:
                shooting.prepare(theta)
            outcome = _search(shootings, theta, limits, motions, most_steps, counts, so_far)
    except KeyboardInterrupt:
        raise _interrupted(fit_of(so_far[-1]) if so_far else None) from None
    fit = fit_of(outcome)
    if not outcome.converged:
        raise IdentificationError(
            f"identify: after {outcome.iterations} steps the values still change ({fit!r}); "
            "start nearer, take more segments=, or leave out what the data do not show; .partial holds the last fit",
            partial=fit,
        )
    if any("cannot be distinguished" in r or "no trace" in r for r in fit.identifiability):
        warn("identify: " + "; ".join(fit.identifiability))
    return fit


def _interrupted(fit: Fit | None) -> Interrupted:
    if fit is None:
        return Interrupted("identify: stopped by the user before the first fit")
    return Interrupted(
        f"identify: stopped by the user after {fit.iterations} steps; .partial holds the best fit so far", partial=fit
    )


def _segments(wanted: int | None, experiment: Experiment) -> int:
    most = experiment.times.size - 1
    if wanted is None:
        return max(1, min(MOST_SEGMENTS, most // SAMPLES))
    return whole(wanted, "identify", "segments", 1, most)


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
    loss: Loss,
    so_far: list[GaussNewtonOutcome],
) -> GaussNewtonOutcome:
    """Gauss–Newton with the weights given, or with those that the residuals ask for.

    A robust loss knows outliers from the noise only near to the solution: the
    first round takes the squares.
    """
    noise, taken = _first_noise(motions), 0
    present = LINEAR

    def report(outcome: GaussNewtonOutcome) -> None:
        so_far[:] = [replace(outcome, iterations=taken + outcome.iterations)]

    for _ in range(ROUNDS):
        by_noise = [not e.weighted or present.is_robust for e in motions]
        weights = [
            e.weights / s[:, None] if own else e.weights for e, s, own in zip(motions, noise, by_noise, strict=True)
        ]
        outcome = gauss_newton(shootings, theta, limits, weights, iterations, present, report)
        taken += outcome.iterations
        outcome.iterations = taken
        again = _noise(motions, outcome, loss)
        change = max(float(np.max(np.abs(np.log(a / b)))) for a, b in zip(again, noise, strict=True))
        final = present.is_robust == loss.is_robust
        same = change < SAME_NOISE or (not loss.is_robust and _one_quantity(motions))
        if final and (same or not outcome.converged):
            return outcome
        noise, theta, present = again, outcome.theta, loss
    return outcome


def _one_quantity(motions: Sequence[Experiment]) -> bool:
    """True if a common factor of all weights is all that the noise could change."""
    return all(e.weighted for e in motions) or (len(motions) == 1 and motions[0].samples.shape[0] == 1)


def _first_noise(motions: Sequence[Experiment]) -> list[np.ndarray]:
    """One per cent of the range of each row of samples."""
    return [np.maximum(0.01 * _range(e), 1e-300) for e in motions]


def _range(experiment: Experiment) -> np.ndarray:
    """Range of each row of samples; the size of one that does not vary, one for zeros."""
    rows = [row[there] for row, there in zip(experiment.samples, experiment.measured, strict=True)]
    return np.array([(np.ptp(row) if row.size else 0.0) or np.max(np.abs(row), initial=0.0) or 1.0 for row in rows])


def _noise(motions: Sequence[Experiment], outcome: GaussNewtonOutcome, loss: Loss) -> list[np.ndarray]:
    """Standard deviation of the residuals of each row, not below rounding; with weights the one factor of all rows."""
    noise = []
    residuals = [y - e.samples for e, y in zip(motions, outcome.outputs, strict=True)]
    weighted = [(e.weights * r)[e.measured] for e, r in zip(motions, residuals, strict=True) if e.weighted]
    factor = loss.spread(np.concatenate(weighted)) if weighted else 1.0
    for e, r in zip(motions, residuals, strict=True):
        rows = [loss.spread(row[there]) for row, there in zip(r, e.measured, strict=True)]
        least = NOISE_TOLERANCE * _range(e)
        noise.append(np.full(len(rows), max(factor, 1e-300)) if e.weighted else np.maximum(rows, least))
    return noise
