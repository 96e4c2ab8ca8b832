"""Simulation: the motion under given forces, by IDAS or another integrator."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from ..assembly.consistent_start import consistent_start
from ..assembly.setup import Setup
from ..equations.numeric import NumericEquations
from ..errors import SimulationError
from ..integrators import Integrator, as_integrator
from ..model.events import Event
from ..model.forces.contact.rigid import RigidContact
from ..model.forces.friction.modes import switching
from ..model.mechanism import Mechanism
from ..model.quantities import yes_or_no
from ..model.symbols import Numbers
from ..numerics.console import keyboard_interrupts
from ..results.state import Conditions, State
from ..results.trajectory import Trajectory
from ..results.validity import report_exceeded_limits, report_validity
from .changes.contact_modes import modes_of
from .changes.events import read_events
from .changes.modes import Modes, SingleMode
from .checks.accuracy import (
    grown_error,
    notes_on_range,
    ranges_of,
    small_motions,
    tolerance_for,
    unresolved_range,
)
from .contact.compiled_elements import has_many_contacts
from .loop import Run, failed_plans
from .phases import PhasedRun
from .stepping.whole_stepper import runs_in_c
from .tolerances import absolute_tolerance, default_abstol

#: Explicit steps that stability may ask for in one output chunk before the motion counts as stiff.
EXPLICIT_STEPS = 2000
#: Steps of an explicit method per time constant of the fastest motion, by stability.
STABILITY = 3.0


def simulate(
    mechanism: Mechanism,
    times: Numbers | None = None,
    *,
    duration: float | None = None,
    initial: Conditions = (),
    inputs: Any = None,
    parameters: Mapping[Any, Any] | None = None,
    events: Sequence[Event] = (),
    method: str | Integrator | type[Integrator] = "idas",
    reltol: float | None = None,
    abstol: float | None = None,
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
        Conditions at the start (see :func:`assemble`), or a state, whose parameters and inputs
        hold in the run unless `parameters` and `inputs` give others.
    inputs : mapping or SampledController, optional
        Input to number, samples on the output grid (linear between), spline of SciPy in
        time, or expression in time and states; or a controller.
    parameters : mapping, optional
        Parameter to number.
    events : sequence of Event, optional
        Looked for during the run.
    method : {"idas", "dop853", "bdf", "erk", "rosenbrock", "auto"}, Integrator or a class of these
        IDAS (BDF of variable order) for anything; :class:`DOP853` for smooth
        motion that is not stiff, several times faster; :class:`BDF` for many contacts of
        bodies that no joint holds, several times faster; Rosenbrock of order
        5 for stiff motion at tight tolerance; "erk" is CasADi's explicit
        Runge–Kutta 5(4), for redundant constraints too. "auto" takes BDF for many
        such contacts, and DOP853 if the motion at the start is not stiff, no rows are redundant and no
        force depends on reactions; both need a C compiler. Else it takes "erk" or, if the motion is stiff, "idas".
    reltol, abstol : float, default 1e-8
        Tolerances of the integrator; `abstol` is a millionth of the size of a mechanism that is smaller than 1 cm. A
        motion that stays within so small a range that the default `abstol` does not
        resolve it is run again with one that does. If friction has a velocity tolerance (or bristles), the
        absolute one is a thousandth of it (of their largest deflection) at most.
    jit : bool, default False
        Compile the functions with the C compiler of the machine.
    progress : bool, default False
        Show a progress bar.
    options : dict, optional
        Passed on to the integrator.

    Returns
    -------
    Trajectory
        At the output times; up to the event, if a terminal one took place.

    Raises
    ------
    SimulationError
        If the integrator stops: the time, the cause, and ``.partial``.
    Interrupted
        On Ctrl-C, with ``.partial``.

    Warns
    -----
    MechanismWarning
        If the steps jump over the smoothing of a friction law or over a contact, so that the motion may be wrong;
        if inputs pass their limits, or an element leaves its range of validity.

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
    trajectories: list[Trajectory] = []
    arguments: dict[str, Any] = dict(
        times=times, duration=duration, initial=initial, inputs=inputs, parameters=parameters
    )
    chosen: dict[str, Any] = dict(reltol=reltol, abstol=abstol, jit=jit, options=options)
    yes_or_no(progress, "simulate", "progress")
    with keyboard_interrupts("simulate", lambda: trajectories[-1] if trajectories else None) as interruption:
        read = read_events(events)
        if any(event.becomes is not None for event in read):
            return _through_phases(mechanism, read, method, chosen, arguments, progress=progress)
        setup = Setup(mechanism, "simulate", **arguments, takes_controller=True)
        modes = _modes(setup, read)
        asked = chosen_integrator(method, modes, **chosen, analysis="simulate", in_c=_expressions(read))
        integrator = suited_to_friction(asked, modes.numeric(modes.free))
        run = Run(setup, modes, read, integrator, progress=progress, interruption=interruption)
        trajectories.append(run.run())
        if integrator.abstol < asked.abstol:
            trajectories[-1].statistics.notes.append(f"abstol = {integrator.abstol:.1e}, as the friction asks for")
        if integrator.name == "idas" and has_many_contacts(modes.numeric(modes.free)):
            trajectories[-1].statistics.notes.append(
                'method="bdf" is faster for many contacts of bodies that no joint holds'
            )
        may_repeat = abstol is None and asked is not method and setup.signals.controller is None
        trajectories.append(_annotated(*_resolved(run, trajectories[-1], may_repeat=may_repeat, progress=progress)))
    return trajectories[-1]


def _annotated(run: Run, motion: Trajectory, ranges: np.ndarray) -> Trajectory:
    """Add notes on accuracy to a motion, and warn of limits that it exceeds."""
    motion.statistics.notes += notes_on_range(motion, ranges, run.integrator.abstol)
    motion.statistics.notes += grown_error(motion)
    report_exceeded_limits(motion, "simulate")
    report_validity(motion, run.unresolved() + failed_plans(run.setup.signals.controller, motion.statistics))
    return motion


def _through_phases(
    mechanism: Mechanism, events: tuple[Event, ...], method: Any, chosen: Any, arguments: Any, *, progress: bool
) -> Trajectory:
    """Simulate through mechanisms that change at events."""

    def integrator_of(modes: Modes) -> Integrator:
        asked = chosen_integrator(method, modes, **chosen, analysis="simulate", in_c=_expressions(events))
        return suited_to_friction(asked, modes.numeric(modes.free))

    run = PhasedRun(mechanism, events, _modes, integrator_of, arguments, progress=progress)
    motion = run.run()
    notes, controller = motion.statistics.notes, run.runs[0].setup.signals.controller
    found = run.unresolved() + failed_plans(controller, motion.statistics)
    for part in motion.phases:
        notes += [note for note in small_motions(part, ranges_of(part.q), run.integrator.abstol) if note not in notes]
    for part in motion.phases:
        report_exceeded_limits(part, "simulate")
        report_validity(part, found if part is motion.phases[0] else ())
        notes += [note for note in part.statistics.notes if note not in notes]
    return motion


def _resolved(run: Run, motion: Trajectory, *, may_repeat: bool, progress: bool) -> tuple[Run, Trajectory, np.ndarray]:
    """A run whose absolute tolerance resolves the ranges of its motion, and these, or a note that it does not."""
    abstol, ranges = run.integrator.abstol, ranges_of(motion.q)
    finer = tolerance_for(ranges, abstol)
    if finer is None:
        return run, motion, ranges
    if may_repeat:
        again = Run(
            run.setup,
            _modes(run.setup, run.events),
            run.events,
            run.integrator.replace(abstol=finer),
            progress=progress,
        )
        try:
            repeated = again.run()
        except SimulationError:  # the forces are too rough for it
            pass
        else:
            repeated.statistics.notes.append(f"abstol = {finer:.1e}, as the motion stays within a small range")
            return again, repeated, ranges_of(repeated.q)
    motion.statistics.notes.append(unresolved_range(motion.q, abstol))
    return run, motion, ranges


def _modes(setup: Setup, events: Sequence[Event]) -> Modes:
    """Sets of equations between which the run switches."""
    if not switching(setup.mechanism):
        return SingleMode(setup)
    modes = modes_of(setup)
    modes.refuse_names(events)
    return modes


def _expressions(events: Sequence[Event]) -> list[ca.SX]:
    return [event.expression for event in events]


def chosen_integrator(
    method: Any,
    modes: Modes,
    *,
    analysis: str,
    options: Any = None,
    in_c: Sequence[ca.SX] | None = None,
    **settings: Any,
) -> Integrator:
    """The integrator that ``method=`` asks for, with its settings; "auto" decides by the motion at the start.

    Parameters
    ----------
    in_c : sequence of casadi.SX, optional
        Given if the analysis takes methods that run in C of their own, of which "auto" may then choose one: what they
        evaluate beside the equations, as events and outputs.
    """
    if options is not None and not isinstance(options, dict):
        raise SimulationError(f"{analysis}: options= takes a dict for the integrator, got {options!r}")
    if isinstance(method, str) and method == "auto":
        setup, numeric = modes.setup, modes.numeric(modes.free)
        frictions = switching(setup.mechanism)
        start = consistent_start(numeric, setup.initial, setup.time, setup.signals) if frictions else setup.start
        redundant = numeric.has_redundant_rows(start.t, start.q)
        by_reactions = numeric.eom.Q_depends_on_lam or any(map(_rubs_by_reactions, frictions))
        stiff = by_reactions or _is_stiff(numeric, start, setup.grid, redundant)
        if in_c is None or options or redundant:
            method = "idas" if stiff else "erk"
        elif has_many_contacts(numeric):
            method = "bdf"
        else:
            method = "idas" if stiff else "dop853" if runs_in_c(numeric, setup.signals, in_c) else "erk"
    if settings.get("abstol") is None and not isinstance(method, Integrator):
        settings["abstol"] = default_abstol(modes.numeric(modes.free))
    return as_integrator(method, **settings, options=options, besides=("auto",))


def _rubs_by_reactions(friction: Any) -> bool:
    """True if the load of exact friction depends on reactions."""
    if isinstance(friction, RigidContact):
        return friction.friction is not None
    lam = ca.vertcat(*[part.multipliers for part in (friction, getattr(friction, "joint", friction))])
    return any(ca.depends_on(ca.SX(limit), lam) for one in friction.frictions for limit in one.limits_of_pull)


def _is_stiff(numeric: NumericEquations, start: State, grid: np.ndarray, redundant: bool) -> bool:
    """True if an explicit integrator would be held back by stability.

    Estimates the spectral radius of the linearised equations of motion at the
    start by power iteration on directional derivatives.
    """
    key = ("stiffness", numeric.light_key, redundant)
    product = numeric.eom.mechanism.cache.get_or_create(key, lambda: _product(numeric, redundant))
    vector = np.random.default_rng(0).standard_normal(product.numel_in(6))
    growth = []
    for _ in range(40):
        vector /= np.linalg.norm(vector)
        vector = product(start.t, start.q, start.v, start.z, start.inputs, numeric.p, vector).full().ravel()
        size = float(np.linalg.norm(vector))
        if size == 0 or not np.isfinite(size):
            return False
        growth.append(np.log(size))
    radius = float(np.exp(np.mean(growth[-20:])))
    return radius * (grid[-1] - grid[0]) / 20 / STABILITY > EXPLICIT_STEPS


def _product(numeric: NumericEquations, redundant: bool) -> ca.Function:
    """``(t, q, v, z, u, p, d) -> A d`` with the Jacobian A of ``(v, a)`` by ``(q, v)``."""
    eom = numeric.eom
    arguments = [eom.t, eom.q, eom.v, eom.z, eom.u, eom.p]
    a, _ = numeric.forward_dynamics(redundant=redundant)(*arguments)
    rate, x = ca.vertcat(eom.v, a), ca.vertcat(eom.q, eom.v)
    direction = ca.SX.sym("d", x.numel())
    return ca.Function("product", [*arguments, direction], [ca.densify(ca.jtimes(rate, x, direction))])


def suited_to_friction(integrator: Integrator, numeric: NumericEquations) -> Integrator:
    """The integrator with an absolute tolerance that resolves smoothed friction."""
    abstol = absolute_tolerance(numeric, integrator.abstol)
    return integrator if abstol == integrator.abstol else integrator.replace(abstol=abstol)
