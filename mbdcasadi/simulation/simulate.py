"""Simulation: the motion under given forces, by IDAS or another integrator."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np

from ..arguments.inputs import read_signals
from ..arguments.values import pairs_of, parameter_vector, time_grid
from ..assembly.initial_state import carried_by, start_state
from ..equations import equations
from ..equations.numeric import NumericEquations
from ..errors import MechanismWarning, SimulationError
from ..model.events import Event
from ..model.mechanism import Mechanism
from ..model.symbols import number
from ..results.trajectory import Trajectory
from ..results.validity import report_validity
from .events import EventWatch
from .formulations import METHODS
from .input_sampling import InputFeed
from .loop import Run
from .stick_slip.friction_modes import switching
from .stick_slip.hybrid_run import StickSlip
from .stiffness import is_stiff
from .tolerances import absolute_tolerance

#: Outputs where only a duration is given.
OUTPUTS = 201


def simulate(
    mechanism: Mechanism,
    times: Any = None,
    *,
    duration: float | None = None,
    initial: Any = (),
    inputs: Any = None,
    parameters: Any = None,
    events: Sequence[Event] = (),
    method: str = "idas",
    reltol: float = 1e-8,
    abstol: float = 1e-8,
    jit: bool = False,
    progress: bool = False,
    options: dict[str, Any] | None = None,
) -> Trajectory:
    """Integrate the equations of motion.

    The index-1 equations are integrated in chunks; every output is projected
    onto the constraints at position and velocity level, and accelerations and
    multipliers at outputs come from the equations of motion there.

    Parameters
    ----------
    mechanism : Mechanism
        The model.
    times : sequence of float
        Output times, the first one the start, s.
    duration : float, optional
        Instead of `times`: 201 outputs from 0 to the duration, s.
    initial : sequence of relations, or State
        Conditions at the start (see :func:`assemble`), or a state.
    inputs : mapping or SampledController, optional
        Input to number, samples on the output grid (linear between), or
        expression in time and states; or a controller.
    parameters : mapping, optional
        Parameter to number.
    events : sequence of Event, optional
        Looked for during the run.
    method : {"idas", "erk", "rosenbrock", "auto"}
        IDAS (BDF of variable order) for anything; explicit Runge–Kutta 5(4)
        for smooth motion that is not stiff, several times faster; Rosenbrock
        of order 5 for stiff motion at tight tolerance; "auto" takes
        Runge–Kutta where the motion at the start is not stiff.
    reltol, abstol : float, default 1e-8
        Tolerances of the integrator. Where friction has a velocity tolerance (or bristles), the
        absolute one is a thousandth of it (of their largest deflection) at the most.
    jit : bool, default False
        Compile the functions with the C compiler of the machine.
    progress : bool, default False
        Show a progress bar.
    options : dict, optional
        Passed on to the integrator.

    Returns
    -------
    Trajectory
        At the output times; up to the event, where a terminal one took place.

    Raises
    ------
    SimulationError
        Where the integrator stops: the time, the cause, and ``.partial``.
    Interrupted
        On Ctrl-C, with ``.partial``.

    Warns
    -----
    MechanismWarning
        Where the steps jump over the smoothing of a friction law or over a contact, so that the motion may be wrong;
        where inputs pass their limits, and where an element leaves what it is made for.

    Examples
    --------
    >>> import mbdcasadi as mbd
    >>> arm = mbd.Body("arm", mass=1, inertia=1 / 12, pose=(0.5, 0, 0))
    >>> hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), arm.at(-0.5, 0))
    >>> pendulum = mbd.Mechanism(bodies=[arm], joints=[hinge], forces=[mbd.Gravity()])
    >>> motion = mbd.simulate(pendulum, duration=1.0)
    >>> bool(abs(motion.energy.total[-1]) < 1e-6)
    True
    """
    grid = _grid(times, duration)
    if switching(mechanism):
        settings = {"method": method, "reltol": reltol, "abstol": abstol, "jit": jit, "options": options}
        motion, unresolved = StickSlip(mechanism, inputs, parameters, events, settings, smooth_motion, grid).over(
            initial
        )
    else:
        motion, unresolved = smooth_motion(
            mechanism, grid, initial, inputs, parameters, events, method, reltol, abstol, jit, options, progress
        )
    for sentence in unresolved:
        motion.statistics.notes.append(sentence)
        warnings.warn(sentence, MechanismWarning, stacklevel=2)
    _tell_exceeded_limits(mechanism, motion)
    report_validity(motion)
    return motion


def smooth_motion(
    mechanism: Mechanism,
    grid: np.ndarray,
    initial: Any,
    inputs: Any,
    parameters: Any,
    events: Sequence[Event],
    method: str,
    reltol: float,
    abstol: float,
    jit: bool,
    options: dict[str, Any] | None,
    progress: bool = False,
    after_reset: bool = False,
) -> tuple[Trajectory, list[str]]:
    """Motion of a mechanism whose friction does not switch, and what was not resolved; see :func:`simulate`.

    With `after_reset` the start is the state just after an event, which does not take place again there.
    """
    eom = equations(mechanism)
    tolerances = [_positive(value, name) for value, name in ((reltol, "reltol"), (abstol, "abstol"))]
    if method not in METHODS:
        raise SimulationError(f"method must be one of {', '.join(METHODS)}, got {method!r}")
    if options is not None and not isinstance(options, dict):
        raise SimulationError(f"simulate: options= takes a dict for the integrator, got {options!r}")
    own = carried_by(initial, mechanism)
    numeric = NumericEquations(
        eom, parameter_vector(eom, own["parameters"] | dict(pairs_of(parameters, "parameters=")))
    )
    given = (
        own["inputs"] | dict(pairs_of(inputs, "inputs="))
        if own["inputs"] and isinstance(inputs, dict | None)
        else inputs
    )
    signals = read_signals(eom, given, grid)
    watch = EventWatch(eom, events)
    start = start_state(numeric, initial, float(grid[0]), signals)
    redundant = numeric.has_redundant_rows(start.t, start.q)
    _ = start[eom.a]  # raises where there are no accelerations: mass is missing, or the pose is singular
    if method == "auto":
        method = "idas" if eom.Q_depends_on_lam or is_stiff(numeric, start, grid, redundant) else "erk"
    absolute = absolute_tolerance(numeric, tolerances[1])
    settings = {"reltol": tolerances[0], "abstol": absolute, "jit": jit, "options": options}
    run = Run(numeric, InputFeed(numeric, signals, grid), watch, method, settings, progress=progress)
    motion = run.over(grid, start, redundant=redundant, after_reset=after_reset)
    if absolute < tolerances[1]:
        motion.statistics.notes.append(f"abstol = {absolute:.1e}, as the friction asks for")
    used = {"reltol": tolerances[0], "abstol": absolute} | (options or {})
    return motion, run.resolution.sentences(used["reltol"], used["abstol"])


def _grid(times: Any, duration: float | None) -> np.ndarray:
    if (times is None) == (duration is None):
        raise SimulationError("give either times or duration=")
    if duration is None:
        return time_grid(times)
    length = _positive(duration, "duration")
    return np.linspace(0.0, length, OUTPUTS)


def _positive(value: Any, name: str) -> float:
    result = number(value, "simulate", name)
    if result <= 0:
        raise SimulationError(f"simulate: {name} must be positive, got {result}")
    return result


def _tell_exceeded_limits(mechanism: Mechanism, motion: Trajectory) -> None:
    for k, u in enumerate(mechanism.inputs):
        values = motion.inputs[:, k]
        slack = 1e-6 * (1 + np.max(np.abs(values), initial=0.0))
        if np.any(values < u.lower - slack) or np.any(values > u.upper + slack):
            warnings.warn(
                f"input '{u.label}' goes from {values.min():.6g} to {values.max():.6g}, beyond its limits "
                f"{u.lower:.6g} … {u.upper:.6g}; simulate does not hold limits",
                MechanismWarning,
                stacklevel=3,
            )
