"""Inverse dynamics: reactions and efforts of a motion that is prescribed."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

from ..arguments.least_efforts import LeastEfforts
from ..arguments.values import pairs_of, position_in
from ..assembly.pose import PoseProblem
from ..assembly.setup import Setup
from ..equations import Equations
from ..equations.driven import driven_equations
from ..equations.numeric import NumericEquations
from ..errors import MechanismError, SingularityError, warn
from ..kinematics.kinematics import check_driven, driven_motion, kinematic_trajectory
from ..kinematics.mobility import mobility
from ..model.drivers import Driver
from ..model.geometry.splines import expression_of, knots_of, through_samples
from ..model.mechanism import Mechanism
from ..model.quantities import entries, refuse_twice, yes_or_no
from ..model.symbols import Input, Numbers, place_of, positive
from ..model.symbols import t as time
from ..numerics.console import call_each, keyboard_interrupts
from ..numerics.tolerances import MET
from ..results.state import Arrays
from ..results.steps import Direct
from ..results.trajectory import Statistics, Trajectory
from ..results.validity import report_exceeded_limits, report_validity
from ..simulation.simulate import simulate
from .efforts import EffortProblem
from .nearest_motion import NearestMotion

#: Change of an effort by every second sample, relative to its root mean square, from which noise decides it: masses and
#: lengths of what is measured are known no better than to a tenth.
NOISE = 0.1


def inverse_dynamics(
    mechanism: Mechanism,
    times: Numbers | None = None,
    *,
    duration: float | None = None,
    motion: Any = None,
    efforts: Sequence[Any] = (),
    weights: Mapping[Input, float] | None = None,
    inputs: Any = None,
    parameters: Mapping[Any, Any] | None = None,
    tolerance: float = MET,
    progress: bool = False,
) -> Trajectory:
    """Find the reactions in the joints and the efforts that a motion takes.

    Without ``motion=`` the drivers of the mechanism prescribe it, and
    ``Phi_q^T lam = Q - M a`` gives all multipliers: ``joint.reaction_on(body)``,
    ``driver.effort``. With ``motion=`` and ``efforts=`` the inputs named are
    found that make a motion from elsewhere; they may act at another place than
    the one that is prescribed.

    Parameters
    ----------
    mechanism : Mechanism
        The model.
    times : sequence of float, optional
        Times, s; with a trajectory as motion its own times if none are given.
    duration : float, optional
        Instead of `times`: 201 outputs from 0 to the duration, s.
    motion : Trajectory, or mapping of expression to function of time, optional
        The motion: a trajectory of the same bodies, or what is prescribed:
        expressions in ``mbd.t``, callables of it, splines of SciPy, or samples
        at `times`, which a curve of degree five interpolates. A list of pairs
        ``[(expression, value)]`` does the same. More quantities than degrees of
        freedom, as measured markers, are met in the least-squares sense: the sum of
        ``(expression - value)**2`` is least at each time, in m and rad, and a
        note in ``.statistics`` has what is missed; ``{w * e: w * value}`` gives one the weight ``w**2``.
        Noise is amplified by accelerations: smooth samples by :func:`smoothing_spline`. They and splines of SciPy are
        looked at for that; expressions are taken as they are.
    efforts : sequence of Input
        Inputs to find, on which the forces depend linearly. If they are more
        than the degrees of freedom (two motors on one shaft, cables, muscles),
        at each time the sum of ``weight * effort**2`` is least, with all of
        them within their limits. As many as the degrees of freedom are found whatever
        their limits; a warning names those beyond.
    weights : mapping of Input to float, optional
        Positive weights of efforts in that sum; 1 for those that are not named.
    inputs : mapping, optional
        Values of the other inputs: numbers, samples, expressions.
    parameters : mapping, optional
        Parameter to number.
    tolerance : float
        By how much a motion from elsewhere may violate the constraints,
        relative to the size of the quantities.
    progress : bool, default False
        Show a progress bar.

    Returns
    -------
    Trajectory
        With multipliers; if constraints are redundant, those of least norm,
        which a note in ``.statistics`` says.

    Raises
    ------
    MechanismError
        For a motion that breaks the constraints: the worst one and the time;
        for efforts that are too few: by how many; for more efforts than
        freedoms that do not make the motion within their limits: which, and the time.
    SingularityError
        At a pose in which the efforts cannot make the motion.

    Warns
    -----
    MechanismWarning
        For efforts that are as many as the degrees of freedom and beyond their limits; for efforts that noise in
        samples decides: by every second sample they would be others, by more than a tenth of their root mean square.

    References
    ----------
    Haug 1989, section 6.3 (inverse dynamics of kinematically driven systems).
    """
    yes_or_no(progress, "inverse_dynamics", "progress")
    tolerance = positive(tolerance, "inverse_dynamics", "tolerance")
    efforts = entries(efforts, "efforts=")
    refuse_twice(efforts, "efforts=")
    with keyboard_interrupts("inverse_dynamics"):
        began = clock.perf_counter()
        if isinstance(motion, Trajectory) and times is None and duration is None:
            times = motion.t
        arguments = {"times": times, "duration": duration, "inputs": inputs, "parameters": parameters}
        setup = Setup(mechanism, "inverse_dynamics", fewest_times=1, **arguments)
        if motion is None:
            if efforts or weights:
                name = "efforts" if efforts else "weights"
                raise MechanismError(f"inverse_dynamics: {name}= goes with motion=; drivers find their own efforts")
            result = _of_drivers(setup, inputs, progress)
        else:
            unknown = [position_in(mechanism.inputs, effort, "efforts=") for effort in efforts]
            overridden = {key for key, _ in pairs_of(inputs, "inputs=")} & set(efforts)
            if overridden:
                names = ", ".join(repr(e.label) for e in overridden)
                raise MechanismError(f"inverse_dynamics: {names} is in inputs= and in efforts=; leave one out")
            remedy = "raise the limits, name more inputs in efforts=, or move more slowly"
            least = LeastEfforts(efforts, weights, "inverse_dynamics", "efforts=", "make the motion", remedy)
            result = _of_motion(setup, *_course(setup, motion, progress), unknown, least, tolerance)
            if _holds_samples(motion, setup.grid):
                every_second = partial(_course, setup, motion, False, every=2)
                _report_noise(result, lambda: _of_motion(setup, *every_second(), unknown, least, tolerance), unknown)
        result.statistics.method, result.statistics.formulation = "inverse dynamics", "Phi_q^T lam = Q - M a"
        result.statistics.seconds = clock.perf_counter() - began
        if efforts:
            report_exceeded_limits(result, "inverse_dynamics of as many efforts as degrees of freedom")
        report_validity(result)
        return result


# --- a mechanism with drivers --------------------------------------------------------------
def _of_drivers(setup: Setup, inputs: Any, progress: bool) -> Trajectory:
    numeric, eom = setup.numeric, setup.eom
    states = _first_order_states(setup, inputs)
    if eom.follows_states:  # and these may follow inputs, which kinematics does not know
        check_driven(numeric, setup.time, setup.start.q, "inverse_dynamics")
        frame = _at_start(setup) if states is None else states
    else:
        course = driven_motion(numeric, setup.grid, progress=progress, what="inverse_dynamics")
        frame = kinematic_trajectory(numeric, course)
        frame.z = eom.estimate[2][None].repeat(len(frame), axis=0) if states is None else states.z
    u = _inputs(setup, frame)
    lam = _multipliers(numeric, frame, u)
    _finite(eom.row_names, frame.t, lam)
    redundant = eom.lam.numel() > eom.q.numel()
    notes = [_LEAST_NORM] if redundant else []

    def at(t: np.ndarray) -> Arrays:
        part = frame.at(t)
        part.z = frame.z[:1].repeat(t.size, axis=0) if states is None else states.at(t).z
        there = _inputs(setup, part)
        return part.q, part.v, part.a, part.z, _multipliers(numeric, part, there), there

    return _result(frame, u, lam, notes, at, numeric.p)


def _multipliers(numeric: NumericEquations, frame: Trajectory, u: np.ndarray) -> np.ndarray:
    """Multipliers along a driven motion (k, m), of redundant rows those of least norm."""
    pose = frame.t[None, :], frame.q.T
    norm = call_each(numeric.norm_of_multipliers, *pose, numeric.p)[0]
    function, motion = driven_equations(numeric.eom).multipliers, (frame.v.T, frame.a.T, frame.z.T)
    found: np.ndarray = call_each(function, *pose, *motion, u.T, numeric.p, norm)[0].T
    return found


def _at_start(setup: Setup) -> Trajectory:
    """The start as a motion of one time."""
    start = setup.start
    q, v, a, z, lam, u = (x[None] for x in (start.q, start.v, start.a, start.z, start.lam, start.inputs))
    return Trajectory(setup.mechanism, setup.grid, q, v, a, z, lam, u, setup.p)


def _first_order_states(setup: Setup, inputs: Any) -> Trajectory | None:
    """The motion with its first-order states: their rates are integrated, the drivers holding it; None if none move."""
    mechanism, grid = setup.mechanism, setup.grid
    if not mechanism.states or grid.size < 2:
        return None
    values = dict(zip(mechanism.parameters, setup.p, strict=True))
    return simulate(mechanism, grid, inputs=inputs, parameters=values, reltol=1e-10, abstol=1e-10)


_LEAST_NORM = (
    "the constraints are redundant: reactions are those of least norm, and those that check lists are not unique"
)


def _inputs(setup: Setup, frame: Trajectory) -> np.ndarray:
    """Values of the inputs along a motion (k, n_u)."""
    return setup.signals.values(frame.t, frame.q, frame.v, frame.z, setup.p, setup.eom)


def _finite(names: Sequence[str], times: np.ndarray, values: np.ndarray) -> None:
    bad = ~np.isfinite(values)
    if np.any(bad):
        k, row = (int(i) for i in np.argwhere(bad)[0])
        raise SingularityError(
            f"the reaction of row {names[row]} is not finite at t = {times[k]:.6g} s: the pose is singular there, "
            "or a force is not finite",
            time=float(times[k]),
        )


def _result(
    frame: Trajectory,
    u: np.ndarray,
    lam: np.ndarray,
    notes: list[str],
    at: Callable[[np.ndarray], Arrays],
    p: np.ndarray,
    course: Trajectory | None = None,
) -> Trajectory:
    return Trajectory(
        frame.mechanism, frame.t, frame.q, frame.v, frame.a, frame.z, lam, u, p,
        statistics=Statistics(notes=notes), interpolation=Direct(at, frame if course is None else course),
    )  # fmt: skip


# --- a motion from elsewhere ---------------------------------------------------------------
def _course(setup: Setup, motion: Any, progress: bool, every: int = 1) -> tuple[Trajectory, list[str]]:
    """The prescribed motion as a trajectory of the mechanism's bodies, and notes; by some of its samples."""
    mechanism, grid = setup.mechanism, setup.grid
    if isinstance(motion, Trajectory):
        same = grid.shape == motion.t.shape and np.allclose(grid, motion.t, rtol=0, atol=1e-12)
        return motion if same else motion.at(grid), []
    prescribed = pairs_of(motion, "motion=")
    drivers = [_as_driver(k, expression, value, grid, every) for k, (expression, value) in enumerate(prescribed)]
    if not drivers:
        raise MechanismError("inverse_dynamics: motion= prescribes nothing")
    short = setup.eom.q.numel() - setup.eom.lam.numel() - len(drivers)
    if short > 0:
        raise MechanismError(
            f"the motion is under-determined by {short}: motion= prescribes {len(drivers)} quantities; "
            "prescribe as many as the mechanism has degrees of freedom"
        )
    if short < 0 and len(drivers) > _freedom(setup):
        nearest = NearestMotion(setup.numeric, drivers)
        course = nearest.over(grid)
        return course, [nearest.note(course)]
    numeric = setup.numeric_of(mechanism.replace(drivers=[*mechanism.drivers, *drivers]))
    driven = driven_motion(numeric, grid, progress=progress, what="inverse_dynamics")
    return kinematic_trajectory(numeric, driven), []


def _freedom(setup: Setup) -> int:
    """Degrees of freedom that the mechanism's own constraints and drivers leave."""
    numeric, t = setup.numeric, setup.time
    q, _, z = numeric.eom.estimate
    return q.size - mobility(numeric, t, PoseProblem(numeric, [], t, z).solve(q)).rank


def _as_driver(index: int, expression: Any, value: Any, grid: np.ndarray, every: int = 1) -> Driver:
    if not isinstance(expression, ca.SX):
        raise MechanismError(f"inverse_dynamics: motion= takes {{expression: course}}, got the key {expression!r}")
    name = f"motion {index + 1} ({expression})"
    knots = _knots_of_samples(value, grid)
    if knots is not None and (every > 1 or not callable(value)):
        samples = value(knots) if callable(value) else value
        if len(samples) != knots.size:
            raise MechanismError(f"{name}: one sample for each of the {grid.size} times is needed, got {len(samples)}")
        kept = np.unique(np.r_[0 : knots.size : every, knots.size - 1])
        return Driver(name, expression, through_samples(time, knots[kept], [samples[k] for k in kept]))
    course = expression_of(time, value)
    return Driver(name, expression, course(time) if callable(course) and not isinstance(course, ca.SX) else course)


def _knots_of_samples(value: Any, grid: np.ndarray) -> np.ndarray | None:
    """Times of samples, or of the knots of a curve with more of them than every second output; None without."""
    if isinstance(value, Sequence | np.ndarray) and np.ndim(value):
        return grid
    knots = knots_of(value)
    return None if knots is None or 2 * knots.size <= grid.size else knots


def _holds_samples(motion: Any, grid: np.ndarray) -> bool:
    if isinstance(motion, Trajectory):
        return False
    return any(_knots_of_samples(value, grid) is not None for _, value in pairs_of(motion, "motion="))


def _report_noise(result: Trajectory, by_every_second: Callable[[], Trajectory], unknown: Sequence[int]) -> None:
    """Warn of efforts that would be others if every second sample were left out, as noise or gaps make them."""
    notes = result.statistics.notes
    try:
        coarser = by_every_second()
    except MechanismError as error:
        notes.append(f"whether noise decides the efforts is not known: by every second sample, {error}")
        return
    efforts = result.inputs[:, unknown]
    size, change = (np.sqrt(np.mean(x**2, axis=0)) for x in (efforts, coarser.inputs[:, unknown] - efforts))
    doubtful = (change > NOISE * size) & (change > MET * np.max(size, initial=0.0))
    if np.any(doubtful):
        worst = int(np.argmax(doubtful * change / np.maximum(size, np.finfo(float).tiny)))
        warn(
            "inverse_dynamics: noise in the samples of motion=, or their distance, decides the efforts: by every other "
            f"sample '{result.mechanism.inputs[unknown[worst]].label}' would change by {change[worst]:.3g} (root mean "
            f"square; its own is {size[worst]:.3g}); smooth the samples, as in "
            "motion={expression: mbd.smoothing_spline(times, samples, cutoff=…)}, or take more of them"
        )


def _of_motion(
    setup: Setup,
    course: Trajectory,
    notes: list[str],
    unknown: Sequence[int],
    least: LeastEfforts,
    tolerance: float,
) -> Trajectory:
    numeric, eom = setup.numeric, setup.eom
    if eom.mechanism.states and not _knows_states(eom, course):
        names = ", ".join(f"'{z.label}'" for z in eom.mechanism.states)
        raise MechanismError(
            f"inverse_dynamics: the first-order states {names} do not follow from motion=; prescribe the motion by "
            "drivers of the mechanism, with which they are integrated"
        )
    q, v, a = (course[x].reshape(course.t.size, -1) for x in (eom.q, eom.v, eom.a))
    z = course[eom.z].reshape(course.t.size, -1) if eom.z.numel() else np.zeros((course.t.size, 0))
    lam = np.full((course.t.size, eom.lam.numel()), np.nan)
    u = np.tile(eom.input_values, (course.t.size, 1))
    frame = Trajectory(eom.mechanism, course.t, q, v, a, z, lam, u, numeric.p)
    _check_motion(frame, tolerance)
    frame.inputs = _inputs(setup, frame)
    problem = EffortProblem(numeric, unknown, least)
    lam, u = problem.solve(frame)
    notes = [*notes, *([_LEAST_NORM] if problem.redundant else [])]

    def at(t: np.ndarray) -> Arrays:
        part = _of_motion(setup, course.at(t), [], unknown, least, tolerance)
        return part.q, part.v, part.a, part.z, part.lam, part.inputs

    return _result(frame, u, lam, notes, at, numeric.p, course)


def _knows_states(eom: Equations, course: Trajectory) -> bool:
    """True if a trajectory has the first-order states of the mechanism."""
    theirs = course.mechanism.states
    return (
        course.z.size > 0
        and bool(np.all(np.isfinite(course.z)))
        and all(place_of(z, theirs) is not None for z in eom.mechanism.states)
    )


def _check_motion(frame: Trajectory, tolerance: float) -> None:
    """Refuse a motion that breaks the constraints at any level."""
    eom = frame.equations
    names = eom.row_names
    levels = (
        ("position", eom.Phi, eom.position_names, frame.q, "m or rad"),
        ("velocity", eom.Phi_q @ eom.v - eom.nu, names, frame.v, "m/s or rad/s"),
        ("acceleration", eom.Phi_q @ eom.a - eom.gamma, names, frame.a, "m/s² or rad/s²"),
    )
    for level, rows, labels, values, unit in levels:
        if not rows.numel():
            continue
        broken = np.abs(frame[rows].reshape(frame.t.size, -1))
        size = 1 + float(np.max(np.abs(values), initial=0.0))
        k, row = (int(i) for i in np.unravel_index(np.argmax(broken), broken.shape))
        if not broken[k, row] <= tolerance * size:
            raise MechanismError(
                f"the motion breaks the constraint {labels[row]} at {level} level by {broken[k, row]:.3g} ({unit}) "
                f"at t = {frame.t[k]:.6g} s; prescribe independent quantities and let the rest follow, as in "
                "motion={joint.angle: law}",
                time=float(frame.t[k]),
            )
