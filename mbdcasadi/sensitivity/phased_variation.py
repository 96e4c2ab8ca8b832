"""Variations of a motion through several mechanisms: carried along each phase, and across the changes between.

A change takes place where ``g(t, x, p) = 0``. With variations ``dx`` just before at a fixed time, rates ``f⁻`` before
and ``f⁺`` after, and a jump ``x⁺ = h(t, x, p)``,

    dtau = -dg / g_rate,   dx⁻ = dx + f⁻ dtau,   dx⁺ = dh,   and at a fixed time just after  dx⁺ - f⁺ dtau:

the saltation matrix. The jump is that of :class:`ImpactLaw`.

References
----------
Aizerman and Gantmacher, "Determination of stability by linear approximation of a periodic solution of a system of
differential equations with discontinuous right-hand sides", Q. J. Mech. Appl. Math. 11 (1958) 385; Leine and Nijmeijer,
*Dynamics and Bifurcations of Non-Smooth Mechanical Systems*, Springer 2004, chapter 7.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..arguments.values import pairs_of
from ..assembly.setup import Setup
from ..equations import equations
from ..equations.impact_law import ImpactLaw
from ..errors import ModelError, SimulationError
from ..integrators import Integrator
from ..model.events import Event
from ..model.mechanism import Mechanism
from ..model.symbols import Parameter, StateVariable
from ..numerics.console import call
from ..numerics.least_squares import largest, least_norm
from ..numerics.rank import analyse_rank
from ..results.phases import places_in, present
from ..results.state import EventOccurrence, State
from ..results.trajectory import Trajectory
from .compiled_run import still
from .differentiable_motion import DifferentiableMotion

#: Rate of an event, relative to the rates of its state, below which the motion grazes and has no derivative.
GRAZING = 1e-8
#: Share of a variation by which the rows of a joint that closes may open for other values.
CLOSING_TOLERANCE = 1e-5
#: Length of the stretch in which a motion that ends just after a change is evaluated, as a share of the whole.
MOMENT = 1e-6


@dataclass(frozen=True)
class EventVariation:
    """An event, and how it and the state there vary.

    Attributes
    ----------
    name : str
        Name of the event.
    t : float
        Time, s.
    time : numpy.ndarray
        Variation of the time (k,).
    before, after : tuple of numpy.ndarray
        Values of the outputs just before and just after (n_y,), and their variations along with the instant
        (n_y, k); `after` is None if the motion ends there.
    """

    name: str
    t: float
    time: np.ndarray
    before: tuple[np.ndarray, np.ndarray]
    after: tuple[np.ndarray, np.ndarray] | None


@dataclass(frozen=True)
class PhasedVariation:
    """Outputs over time and at events, with their variations.

    Attributes
    ----------
    t : numpy.ndarray
        Times (n_t,), s; the instant of a change twice.
    y, slope : numpy.ndarray
        Outputs (n_t, n_y), and variations at fixed times (n_t, n_y, k).
    events : tuple of EventVariation
        Changes, and the event that ends the motion.
    end : numpy.ndarray
        Variation of the last state ``(q, v, z)``, along with the instant if an event ends the motion (n_x, k).
    """

    t: np.ndarray
    y: np.ndarray
    slope: np.ndarray
    events: tuple[EventVariation, ...]
    end: np.ndarray


@dataclass(frozen=True)
class Directions:
    """Variations of the start, of parameters and of inputs, in k directions.

    Attributes
    ----------
    start : numpy.ndarray
        Of ``(q, v, z)`` (n_x, k).
    parameters : dict of Parameter to numpy.ndarray
        Rows (k,) of the parameters that vary.
    inputs : dict of Input to numpy.ndarray
        Rows (k,) of inputs that are numbers.
    """

    start: np.ndarray
    parameters: dict[Any, np.ndarray]
    inputs: dict[Any, np.ndarray]

    @property
    def count(self) -> int:
        """Number of directions."""
        return int(self.start.shape[1])


class _PhaseFlow:
    """The motion in one mechanism between two changes, and what it says at single instants."""

    def __init__(
        self,
        part: Trajectory,
        grid: np.ndarray,
        integrator: Integrator,
        inputs: Any,
        outputs: Sequence[ca.SX],
        whole: Mechanism,
        directions: Directions,
        values: np.ndarray,
    ):
        self.part, self.mechanism, self.eom = part, part.mechanism, part.equations
        p = list(zip(self.mechanism.parameters, part.parameters.tolist(), strict=True))
        own = [(u, x) for u, x in pairs_of(inputs, "inputs=") if any(u is one for one in self.mechanism.inputs)]
        first = part.initial
        start = State(
            self.mechanism, first.t, first.q, first.v, first.a, first.z, first.lam, first.inputs, part.parameters
        )
        setup = Setup(self.mechanism, "sensitivities", times=grid, initial=start, inputs=own, parameters=p)
        if setup.signals.is_sampled:
            raise ModelError(
                "sensitivities: through changes of the mechanism inputs= takes numbers and expressions, no samples"
            )
        self.p, self.levels = setup.p, np.asarray(setup.signals.level_values, float)
        self._varied = directions
        varied = [k for k, x in enumerate(self.mechanism.parameters) if x in directions.parameters]
        self.motion = DifferentiableMotion(setup, integrator, varied=varied)
        self.x0 = np.r_[first.q, first.v, first.z]
        shown = self._with_absent_parameters([present(e, whole, self.mechanism) for e in outputs], whole, values)
        self.known = [self.eom.contains(e) for e in shown]
        self._shown = [e for e, known in zip(shown, self.known, strict=True) if known]
        #: rows of the outputs that this mechanism has
        self.rows = np.array(
            [known for e, known in zip(outputs, self.known, strict=True) for _ in range(e.numel())], bool
        )
        positions = [(u, place) for k, place in setup.signals.level_places.items() for u in [self.mechanism.inputs[k]]]
        self.dlevels = np.zeros((self.levels.size, directions.count))
        for u, place in positions:
            self.dlevels[place] = directions.inputs.get(u, 0.0)

    def _with_absent_parameters(
        self, expressions: Sequence[ca.SX], whole: Mechanism, values: np.ndarray
    ) -> list[ca.SX]:
        """Expressions with the values of parameters that only other mechanisms have."""
        own = self.mechanism.parameters
        absent = [k for k, x in enumerate(whole.parameters) if not any(x is other for other in own)]
        symbols = ca.vertcat(ca.SX(0, 1), *[whole.parameters[k] for k in absent])
        varied = [whole.parameters[k] for k in absent if whole.parameters[k] in self._varied.parameters]
        by_varied = ca.jacobian(ca.vertcat(ca.SX(0, 1), *map(ca.vec, expressions)), ca.vertcat(ca.SX(0, 1), *varied))
        if by_varied.nnz():
            name = next(x.label for x in varied if ca.depends_on(ca.vertcat(*map(ca.vec, expressions)), x))
            raise ModelError(
                f"sensitivities: an output contains parameter '{name}', by which it is differentiated, and which not "
                "all mechanisms of the motion have; list it in parameters= of each"
            )
        return (
            [ca.substitute(e, symbols, ca.SX(ca.DM(values[absent]))) for e in expressions] if absent else [*expressions]
        )

    def dp(self, given: dict[Any, np.ndarray]) -> np.ndarray:
        """Variations of the parameters of the mechanism (n_p, k)."""
        rows = np.zeros((self.p.size, self._varied.count))
        for k, symbol in enumerate(self.mechanism.parameters):
            rows[k] = given.get(symbol, 0.0)
        return rows

    def over(self, dx0: np.ndarray, dp: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Outputs (n_t, n_y) with variations (n_t, n_y, k), and the last state with its own."""
        motion, k = self.motion, dx0.shape[1]
        channel = motion.channel()
        course = motion.course(self.x0, self.p, self.levels, channel)
        run = motion.motion(course)
        known = [self.x0, self.p, self.levels, channel, *course.arguments]
        found = call(run, *known)
        states = found[0].full()
        if not motion.reached(states):
            raise SimulationError("sensitivities: the integrator stopped within a phase", time=float(self.part.t[0]))
        moved = call(run.forward(k), *known, *found, dx0, dp, self.dlevels, *still([channel, *course.arguments], k))
        outputs = motion.outputs(self._shown)
        given = [found[0], self.p, self.levels, channel]
        y = outputs(*given)
        dy = call(outputs.forward(k), *given, y, moved[0], dp, self.dlevels, *still([channel], k))
        n_t, n_y = states.shape[1], int(np.sum(self.rows))
        values, slopes = np.full((n_t, self.rows.size), np.nan), np.full((n_t, self.rows.size, k), np.nan)
        values[:, self.rows] = y.full().T
        slopes[:, self.rows] = dy.full().reshape(n_y, k, n_t).transpose(2, 0, 1)
        return values, slopes, found[1].full().ravel(), moved[1].full()

    # --- at one instant ------------------------------------------------------------------------
    def at(
        self, expression: ca.SX, time: float, x: np.ndarray, dt: np.ndarray, dx: np.ndarray, dp: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """An expression at a state, and its variations (n, k)."""
        function, channel = self.motion.at_one_output(ca.vec(expression)), self._no_samples
        known = [time, x, self.p, self.levels, channel]
        value = function(*known)
        seeds = [dt[None, :], dx, dp, self.dlevels, *still([channel], dt.size)]
        return value.full().ravel(), call(function.forward(dt.size), *known, value, *seeds).full()

    def outputs_at(
        self, time: float, x: np.ndarray, dt: np.ndarray, dx: np.ndarray, dp: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """All outputs at a state (n_y,), and their variations (n_y, k)."""
        values, slopes = np.full(self.rows.size, np.nan), np.full((self.rows.size, dt.size), np.nan)
        if self._shown:
            stacked = ca.vertcat(*[ca.vec(e) for e in self._shown])
            values[self.rows], slopes[self.rows] = self.at(stacked, time, x, dt, dx, dp)
        return values, slopes

    def rates(self, time: float, x: np.ndarray) -> np.ndarray:
        """Rates of ``(q, v, z)``."""
        eom = self.eom
        function = self.motion.at_one_output(ca.vertcat(eom.v, eom.a, eom.z_rate))
        return np.asarray(function(time, x, self.p, self.levels, self._no_samples).full().ravel())

    def rate_of(self, expression: ca.SX, time: float, x: np.ndarray) -> float:
        """Rate of an expression along the motion."""
        function = self.motion.at_one_output(expression)
        known = [time, x, self.p, self.levels, self._no_samples]
        seeds = [1.0, self.rates(time, x), 0 * self.p, 0 * self.levels, self._no_samples]
        return float(call(function.forward(1), *known, function(*known), *seeds))

    @property
    def _no_samples(self) -> np.ndarray:
        return np.zeros((self.motion.channel_size[0], 1))


def phased_variation(
    motion: Trajectory,
    events: Sequence[Event],
    times: np.ndarray,
    outputs: Sequence[ca.SX],
    directions: Directions,
    integrator: Integrator,
    inputs: Any = None,
) -> PhasedVariation:
    """Carry variations along a motion that was simulated.

    Parameters
    ----------
    motion : Trajectory
        The motion, which knows the order and the instants of its changes.
    events : sequence of Event
        The events of the run.
    times : numpy.ndarray
        Output times, s.
    outputs : sequence of casadi.SX
        Expressions in any of the mechanisms.
    directions : Directions
        Variations of the start, parameters and inputs.
    integrator : Integrator
        Method and tolerances.
    inputs : mapping, optional
        Inputs of the run: numbers and expressions.

    Raises
    ------
    ModelError
        For events that reset velocities, and several that take place together: their order decides the variation.
    SimulationError
        Where the motion grazes the zero of an event, or a joint would not close for other values.
    """
    whole, parts = motion.mechanism, motion.phases
    changes = _changes(motion, events)
    ends = _ending(motion, events)
    dx, parameters = directions.start, dict(directions.parameters)
    pieces: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
    found: list[EventVariation] = []
    values_by_phase = motion.parameters_by_phase
    flow = _flow(parts[0], times, motion, integrator, inputs, outputs, whole, directions, values_by_phase[0])
    for number, part in enumerate(parts):
        dp = flow.dp(parameters)
        values, slopes, x_end, dx = flow.over(dx, dp)
        pieces.append((_grid(part, times), values, slopes))
        event = changes[number] if number < len(changes) else ends
        if event is None:
            continue
        time = float(part.t[-1])
        dt, total = _at_event(flow, event, time, x_end, dx, dp)
        before = flow.outputs_at(time, x_end, dt, total, dp)
        if number == len(changes):
            found.append(EventVariation(event.name, time, dt, before, None))
            dx = total
            continue
        following = _flow(
            parts[number + 1],
            times,
            motion,
            integrator,
            inputs,
            outputs,
            whole,
            directions,
            values_by_phase[number + 1],
        )
        jumped, parameters = _across(flow, following, event, time, x_end, dt, total, dp, parameters)
        after = following.outputs_at(time, following.x0, dt, jumped, following.dp(parameters))
        found.append(EventVariation(event.name, time, dt, before, after))
        if len(parts[number + 1]) < 2:  # the motion ends just after the change
            dx = jumped
            break
        dx = jumped - np.outer(following.rates(time, following.x0), dt)
        flow = following
    t, y, slope = (np.concatenate([piece[k] for piece in pieces]) for k in range(3))
    return PhasedVariation(t, y, slope, tuple(found), dx)


def _flow(part: Trajectory, times: np.ndarray, motion: Trajectory, *others: Any) -> _PhaseFlow:
    grid = _grid(part, times)
    if grid.size < 2:
        span = float(motion.t[-1] - motion.t[0]) or 1.0
        grid = np.array([grid[0], grid[0] + MOMENT * span])
    return _PhaseFlow(part, grid, *others)


def _grid(part: Trajectory, times: np.ndarray) -> np.ndarray:
    """Output times within a phase, with its ends."""
    first, last = float(part.t[0]), float(part.t[-1])
    apart = 1e-9 * max(last - first, float(np.spacing(abs(last))))
    inside = times[(times > first + apart) & (times < last - apart)]
    return np.unique(np.r_[first, inside, last])


def _changes(motion: Trajectory, events: Sequence[Event]) -> list[Event]:
    """The event of each change of a motion."""
    known = {event.name: event for event in events}
    chosen = []
    for event in motion.events:
        if event.after is not None and known[event.name].becomes is None:
            raise ModelError(
                f"sensitivities: event '{event.name}' resets velocities; derivatives are carried through changes of "
                "the mechanism alone (becomes=, with restitution= for a bounce)"
            )
    for before in motion.phases[:-1]:
        here = [e for e in motion.events if e.after is not None and e.t == before.t[-1]]
        if len(here) != 1:
            names = ", ".join(f"'{e.name}'" for e in here)
            raise ModelError(
                f"sensitivities: the events {names} take place together at t = {before.t[-1]:.6g} s; which one is "
                "first for other values decides the motion, and there is no derivative"
            )
        if len(before) < 2:
            raise ModelError(f"sensitivities: event '{here[0].name}' takes place at once where its phase begins")
        chosen.append(known[here[0].name])
    return chosen


def _ending(motion: Trajectory, events: Sequence[Event]) -> Event | None:
    """The event that ends a motion without a change; None if there is none."""
    known = {event.name: event for event in events}
    last: list[EventOccurrence] = [e for e in motion.events if e.t == motion.t[-1]]
    return next((known[e.name] for e in last if known[e.name].terminal and known[e.name].becomes is None), None)


def _at_event(
    flow: _PhaseFlow, event: Event, time: float, x: np.ndarray, dx: np.ndarray, dp: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Variations of the instant of an event (k,), and of the state there (n_x, k)."""
    rate, rates = flow.rate_of(event.expression, time, x), flow.rates(time, x)
    if not np.isfinite(rate) or abs(rate) <= GRAZING * (1 + largest(rates)):
        raise SimulationError(
            f"sensitivities: the motion touches the zero of event '{event.name}' at t = {time:.6g} s with the rate "
            f"{rate:.3g}: the instant has no derivative",
            time=time,
        )
    _, change = flow.at(event.expression, time, x, np.zeros(dx.shape[1]), dx, dp)
    dt = -change.ravel() / rate
    return dt, dx + np.outer(rates, dt)


def _across(
    flow: _PhaseFlow,
    following: _PhaseFlow,
    event: Event,
    time: float,
    x: np.ndarray,
    dt: np.ndarray,
    dx: np.ndarray,
    dp: np.ndarray,
    parameters: dict[Any, np.ndarray],
) -> tuple[np.ndarray, dict[Any, np.ndarray]]:
    """Variations of the state just after a change, and of the parameters from there on."""
    parameters, states = dict(parameters), {}
    for symbol, value in event.new_values:
        row = flow.at(value, time, x, dt, dx, dp)[1].ravel()
        if isinstance(symbol, Parameter):
            parameters[symbol] = row
        elif isinstance(symbol, StateVariable):
            states[symbol] = row
    new_dp = following.dp(parameters)
    dq, dv = _carried(flow, following, event, time, dt, dx, new_dp)
    dv = _jumped(flow, following, event, time, x, dt, dq, dv, new_dp)
    old, n = list(flow.mechanism.states), flow.eom.q.numel()
    dz = np.zeros((len(following.mechanism.states), dt.size))
    for k, symbol in enumerate(following.mechanism.states):
        place = next((i for i, other in enumerate(old) if other is symbol), None)
        dz[k] = states.get(symbol, 0.0 if place is None else dx[2 * n + place])
    return np.vstack([dq, dv, dz]), parameters


def _shared(flow: _PhaseFlow, following: _PhaseFlow) -> tuple[list[int], list[int]]:
    """Coordinates of the next mechanism that the one before has, and their places there."""
    theirs = {s.element_hash() for s in ca.vertsplit(flow.eom.q)}
    here = [k for k, s in enumerate(ca.vertsplit(following.eom.q)) if s.element_hash() in theirs]
    return here, places_in(flow.eom.q, following.eom.q[here])


def _carried(
    flow: _PhaseFlow,
    following: _PhaseFlow,
    event: Event,
    time: float,
    dt: np.ndarray,
    dx: np.ndarray,
    dp: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Variations of the coordinates just after a change, and of the velocities just before it, of what goes on."""
    eom, law = following.eom, ImpactLaw(following.eom, event.restitution)
    here, places = _shared(flow, following)
    n_old, n = flow.eom.q.numel(), eom.q.numel()
    dq, dv = np.zeros((n, dt.size)), np.zeros((n, dt.size))
    dq[here], dv[here] = dx[places], dx[[n_old + k for k in places]]
    rows = ca.vertcat(eom.Phi, law.momentary)
    if not rows.numel():
        return dq, dv
    slopes = ca.Function(
        "rows", [eom.t, eom.q, eom.p], [ca.densify(ca.jacobian(rows, x)) for x in (eom.q, eom.t, eom.p)]
    )
    by_q, by_t, by_p = (x.full() for x in slopes(time, following.x0[:n], following.p))
    new = [k for k in range(n) if k not in set(here)]
    open_ = by_q @ dq + by_t @ dt[None, :] + by_p @ dp
    if new:
        dq[new] = least_norm(by_q[:, new], -open_)
        open_ = open_ + by_q[:, new] @ dq[new]
    size = 1 + largest(dq) + largest(dt)
    if largest(open_) > CLOSING_TOLERANCE * size:
        names = [*(eom.row_names[k] for k in eom.position_rows), *law.row_names[eom.lam.numel() :]]
        worst = names[int(np.argmax(np.max(np.abs(open_), axis=1)))]
        raise SimulationError(
            f"sensitivities: for other values event '{event.name}' at t = {time:.6g} s would not find the position of "
            f"'{worst}' closed; let a parameter in it take the value of that instant (reset=)",
            time=time,
        )
    return dq, dv


def _jumped(
    flow: _PhaseFlow,
    following: _PhaseFlow,
    event: Event,
    time: float,
    x: np.ndarray,
    dt: np.ndarray,
    dq: np.ndarray,
    dv: np.ndarray,
    dp: np.ndarray,
) -> np.ndarray:
    """Variations of the velocities just after a change: the law of impact, differentiated as an implicit function."""
    eom, law = following.eom, ImpactLaw(following.eom, event.restitution)
    here, places = _shared(flow, following)
    n_old, n = flow.eom.q.numel(), eom.q.numel()
    v_before = np.zeros(n)
    v_before[here] = x[[n_old + k for k in places]]
    q = following.x0[:n]
    jump = law.solve(following.motion.numeric.mass, time, q, v_before, following.p)
    kept = [k for k in range(law.impulses.numel()) if k not in set(jump.dependent)]
    rows = ca.vertcat(law.momentum, law.velocity[kept])
    unknowns = ca.vertcat(eom.v, law.impulses[kept])
    known = [eom.t, eom.q, law.v_before, eom.p]
    arguments = [*known, eom.v, law.impulses]
    slopes = ca.Function("impact", arguments, [ca.densify(ca.jacobian(rows, s)) for s in (unknowns, *known)])
    by_unknowns, by_t, by_q, by_v, by_p = (
        m.full() for m in slopes(time, q, v_before, following.p, jump.v, jump.impulses)
    )
    right = -(by_t @ dt[None, :] + by_q @ dq + by_v @ dv + by_p @ dp)
    return np.asarray(least_norm(by_unknowns, right)[:n])


def start_directions(mechanism: Mechanism, state: State) -> np.ndarray:
    """Return the directions in which a start may vary on the constraints, as columns for ``(q, v, z)``."""
    eom = equations(mechanism)
    rows = ca.vertcat(eom.Phi, eom.Phi_q @ eom.v - eom.nu)
    n, k = eom.q.numel(), eom.z.numel()
    if not rows.numel():
        return np.eye(2 * n + k)
    jacobian = ca.jacobian(rows, ca.vertcat(eom.q, eom.v))
    function = ca.Function("rows", [eom.t, eom.q, eom.v, eom.p], [ca.densify(jacobian)])
    slope = function(state.t, state.q, state.v, state.parameters).full()
    tangent = analyse_rank(slope).null_columns
    return np.block([[tangent, np.zeros((2 * n, k))], [np.zeros((k, tangent.shape[1])), np.eye(k)]])
