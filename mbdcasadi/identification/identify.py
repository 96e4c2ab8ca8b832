"""Identification: parameters that explain measured motions best."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..arguments.values import position_in
from ..equations import equations
from ..errors import Interrupted, ModelError, SimulationError, warn
from ..integrators import Integrator
from ..model.events import Event
from ..model.mechanism import Mechanism
from ..model.quantities import listed, refuse_twice, whole
from ..model.symbols import Numbers, Parameter
from ..numerics.console import keyboard_interrupts
from ..results.state import Conditions
from ..simulation.changes.events import refuse_events
from .data import Experiment, IdentificationError, read_experiments
from .fit import Fit
from .gauss_newton import GaussNewton
from .loss import Loss
from .shooting import FitSetup, Shooting

#: Tolerance of the integrator unless another one is given.
TOLERANCE = 1e-9
#: Samples in a segment, and segments, unless the user says otherwise.
SAMPLES, MOST_SEGMENTS = 8, 10
#: Departure of a motion from the data over a segment, in ranges of the data, from which segments are halved: farther
#: away linearised motions say little of the unknowns.
FAR = 0.5


def identify(
    mechanism: Mechanism,
    times: Numbers | None = None,
    data: Any = None,
    unknowns: Any = (),
    initial: Conditions = (),
    *,
    inputs: Any = None,
    parameters: Mapping[Any, Any] | None = None,
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
        Segments of each motion; 1 is single shooting. About eight samples each if left out, at most ten; more if the
        motion with the first values leaves the data by half their range within a segment.
    iterations : int, default 50
        Largest number of Gauss–Newton steps.
    loss : {"linear", "huber", "soft_l1"}
        Loss, as in ``scipy.optimize.least_squares``: by their squares, or those beyond `f_scale`
        by their size, so that outliers hardly change the fit.
    f_scale : float, default 1.345
        Residual from which a sample counts as an outlier, in standard deviations of the noise (found from the inner
        half of the residuals). With the default a fit to normal noise without outliers is 95 % as efficient as
        that of the squares by "huber".
    method : {"auto", "dop853", "idas", "erk", "rosenbrock"} or Integrator
        Integrator. "auto" takes IDAS if the motion at the start is stiff, else DOP853 if there is a C compiler, no rows
        are redundant and the motion passes no pose in which the linkage could fold, else Runge–Kutta.
    reltol, abstol : float, default 1e-9
        Its tolerances.

    Returns
    -------
    Fit
        ``fit[k]``, ``fit.standard_error[k]``, ``.covariance``, ``.identifiability``, ``.trajectory``.

    Raises
    ------
    IdentificationError
        If the steps do not converge, or the motion cannot be followed with the values tried; ``.partial`` is the last
        fit, None before the first one.
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
    equations(mechanism)  # raises for what is not a mechanism
    places = [position_in(mechanism.parameters, u, "unknowns=") for u in wanted]
    of_one = {"initial": initial, "inputs": inputs, "parameters": parameters, "weights": weights}
    motions = read_experiments(times, data, experiments, **of_one)
    counts = Loss(loss, f_scale)
    most_steps = whole(iterations, "identify", "iterations", 0)
    _refuse_few(motions, wanted)
    refuse_twice(wanted, "unknowns=")
    chosen = {"method": method} | _tolerances(method, reltol, abstol)
    search: GaussNewton | None = None
    try:
        with keyboard_interrupts("identify"):
            shootings = _shootings(mechanism, motions, places, segments, chosen)
            theta = shootings[0].setup.p[places]
            limits = np.array([u.lower for u in wanted]), np.array([u.upper for u in wanted])
            search = GaussNewton(shootings, limits, counts, most_steps)
            try:
                outcome = search.run(theta)
            except SimulationError as error:
                last = search.so_far
                raise IdentificationError(
                    f"identify: the motion cannot be followed from the values tried: {error}; start nearer, or take "
                    "more segments=; .partial holds the last fit",
                    partial=None if last is None else Fit(mechanism, motions, wanted, last, counts),
                ) from error
    except KeyboardInterrupt:
        if search is None or search.so_far is None:
            raise Interrupted("identify: stopped by the user before the first fit") from None
        fit = Fit(mechanism, motions, wanted, search.so_far, counts)
        raise Interrupted(
            f"identify: stopped by the user after {fit.iterations} steps; .partial holds the best fit so far",
            partial=fit,
        ) from None
    fit = Fit(mechanism, motions, wanted, outcome, counts)
    if not outcome.converged:
        raise IdentificationError(
            f"identify: after {outcome.iterations} steps the values still change ({fit!r}); "
            "start nearer, take more segments=, or leave out what the data do not show; .partial holds the last fit",
            partial=fit,
        )
    if np.any(np.isinf(np.diag(fit.covariance))):
        warn("identify: " + "; ".join(fit.identifiability))
    return fit


def _tolerances(method: str | Integrator, reltol: float | None, abstol: float | None) -> dict[str, Any]:
    """Tolerances, tighter than those of a simulation unless they are given."""
    if isinstance(method, Integrator):
        return {"reltol": reltol, "abstol": abstol}
    reltol = TOLERANCE if reltol is None else reltol
    return {"reltol": reltol, "abstol": TOLERANCE if abstol is None else abstol, "keeps_abstol": abstol is not None}


def _shootings(
    mechanism: Mechanism, motions: Sequence[Experiment], places: list[int], segments: int | None, chosen: dict[str, Any]
) -> list[Shooting]:
    """The experiments in segments that start on the data."""
    shootings = []
    for e in motions:
        arguments = {"initial": e.initial, "inputs": e.inputs, "parameters": e.parameters, **chosen}
        setup = FitSetup(mechanism, "identify", e.times, **arguments)
        most = e.times.size - 1
        usual = max(1, min(MOST_SEGMENTS, most // SAMPLES))
        count = usual if segments is None else whole(segments, "identify", "segments", 1, most)
        shooting = Shooting(setup, e, places, count)
        departure = shooting.prepare(setup.p[places])
        while segments is None and departure > FAR and count < most:
            count = min(2 * count, most)
            shooting = Shooting(setup, e, places, count)
            departure = shooting.prepare(setup.p[places])
        shootings.append(shooting)
    return shootings


def _refuse_few(motions: Sequence[Experiment], unknowns: Sequence[Parameter]) -> None:
    count = sum(int(np.sum(e.measured)) for e in motions)
    if count < len(unknowns):
        raise ModelError(f"identify: {count} samples cannot determine {len(unknowns)} unknowns")
