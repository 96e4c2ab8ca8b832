"""One run of a simulation: piece after piece, the events between them, and what happens when it stops."""

from __future__ import annotations

import contextlib
import copy
import math
import time as clock
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from functools import partial
from typing import Any, NoReturn

import casadi as ca
import numpy as np

from ..arguments.inputs import SampledController
from ..assembly.consistent_start import consistent_start
from ..assembly.setup import Setup
from ..equations.impact_law import jump
from ..errors import Interrupted, MechanismError, SimulationError, warn
from ..integrators import Integrator
from ..integrators.compiled import IntegrationFailure
from ..model.events import Event
from ..model.forces.friction.modes import switching
from ..numerics.console import Interruption, interruptible
from ..numerics.progress import simulated_time_bar
from ..numerics.real import distinct
from ..results.ranges import Ranges
from ..results.state import State
from ..results.steps import Stretch
from ..results.trajectory import EventOccurrence, Statistics, Trajectory
from ..results.validity import validity_conditions
from .arc import SHORTLY, Arc, Outcome, ends_run, resets_or_ends
from .changes.event_search import Crossing
from .changes.events import EventWatch
from .changes.impacts import instant_of
from .changes.modes import Block, Modes
from .changes.transitions import Transitions
from .checks.failure_diagnosis import cause_of_failure, singular_event
from .checks.unseen_loads import UnseenLoads, meets_loads
from .outputs import Outputs
from .path import Path
from .policies import Way
from .rerun import interpolation_of
from .schedule import PIECES, WATCH_POINTS, Piece, Schedule
from .singular.passage import Passage, notes_on_passages
from .singular.start import refuse_singular_start
from .stepper import SteppedSystem
from .stepping.kinds import kind_of_stepper
from .stepping.whole_stepper import refuse_redundant_rows
from .time_dependence import time_dependence
from .trajectory_builder import TrajectoryBuilder

LEAST_NORM = "the constraints are redundant: multipliers and reactions are those of least norm"


class Run:
    """One run of a simulation; if an interruption is given, its analysis notices Ctrl-C."""

    def __init__(
        self,
        setup: Setup,
        modes: Modes,
        events: Sequence[Event],
        integrator: Integrator,
        *,
        progress: bool = False,
        interruption: Interruption | None = None,
        keeps_paths: bool = False,
    ):
        self.setup, self.modes, self.events, self.integrator = setup, modes, tuple(events), integrator
        #: True if the paths of all pieces are kept, on which the shortest load is looked for
        self.keeps_paths = keeps_paths
        self._kind = kind_of_stepper(integrator)
        self._pieces = self._kind.pieces
        self._progress, self._noticed = progress, interruption
        timed = time_dependence(setup)
        self._max_step, self._obstacle, self._corners = timed.max_step, timed.obstacle(), timed.velocity_jumps
        self._timed = timed
        grid = setup.grid
        self._span, self.instant = float(grid[-1] - grid[0]), instant_of(grid)
        controller = setup.signals.controller
        is_watched = not self._kind.looks_inside and self._is_watched()
        self._watch_points = WATCH_POINTS if is_watched else 0
        self._schedule = Schedule(
            grid,
            stops=np.concatenate([setup.signals.breaks, timed.stops]),
            jumps=timed.jumps,
            period=None if controller is None else controller.period,
            watch_points=self._watch_points,
        )
        self.redundant = False
        self.transitions = Transitions(modes, events, self.instant)
        self._arcs: dict[Any, Arc] = {}
        self._notes = timed.notes
        self._builder = TrajectoryBuilder(modes, setup.p)
        self._time, self._x, self._extra_stops = 0.0, np.zeros(0), np.zeros(0)
        self._passed: list[float] = []
        self._paths: list[Path] = []
        #: events of the instant at which the run ended that change the mechanism, and the state there
        self.changing: list[Event] = []
        self.reached: State | None = None
        #: True if an event ended the whole run
        self.stops = False

    def _is_watched(self) -> bool:
        """True if something must be looked for between outputs."""
        eom = self.modes.numeric(self.modes.free).eom
        mechanism = self.setup.mechanism
        conditions = any(c.between_outputs for c in validity_conditions(mechanism))
        smoothed = any(getattr(element, "smoothings", ()) for element in mechanism.elements)
        # drift is taken away at the ends of pieces, which outputs far apart would make as long as the run
        drifts = bool(eom.lam.numel()) and float(np.max(np.diff(self.setup.grid))) > self._span / PIECES * (1 + 1e-9)
        if self.keeps_paths or self.events or conditions or smoothed or switching(mechanism) or eom.has_loops:
            return True
        return drifts or meets_loads(eom, self.setup.signals)

    # --- the loop ------------------------------------------------------------------------
    def run(self, entry: State | None = None, passed: Sequence[Event] = ()) -> Trajectory:
        """Run over the output grid, up to its end or to an event that ends the run.

        Parameters
        ----------
        entry : State, optional
            State of the mechanism at which the run goes on, in place of the start.
        passed : sequence of Event
            Events that led there, or took place just before: they are at their zeros, and have taken place.

        Raises
        ------
        SimulationError
            If the run stops: the time, the cause, and ``.partial``.
        Interrupted
            On Ctrl-C, with ``.partial``.
        """
        began = clock.perf_counter()
        self._prepare()
        builder = self._builder
        span = self._schedule.end - self._schedule.start
        noticing = interruptible() if self._noticed is None else nullcontext(self._noticed)
        with noticing as self._interruption, simulated_time_bar(span, show=self._progress) as bar:
            try:
                self._begin() if entry is None else self._resume(entry, passed)
                if any(event.becomes is not None for event in self.events):
                    state = self._arc.stepper.outputs.state(self._time, self._x)
                    self.changing = self.transitions.to_another_mechanism(state, passed)
                    self.reached = self.transitions.whole(state)
                if not self.changing:
                    self._run_pieces(bar)
            except (KeyboardInterrupt, Exception) as error:
                # in CasADi's conversions Ctrl-C comes back as an error of another kind
                if self._interruption.requested or isinstance(error, KeyboardInterrupt):
                    raise self._interrupted() from None
                if isinstance(error, MechanismError) and error.partial is None and not builder.is_empty:
                    error.partial = self.trajectory()
                raise
            finally:
                builder.statistics.seconds = clock.perf_counter() - began
                notes = [
                    note for arc in self._arcs.values() for note in (*arc.stepper.notes, *self.modes.notes(arc.mode))
                ]
                builder.statistics.notes += [*dict.fromkeys(notes), *notes_on_passages(self._passed)]
                builder.statistics.restarts, builder.statistics.steps = self.starts, self.steps
                if not self._interruption.requested:  # what was stopped inside a step is not used again
                    for arc in self._arcs.values():
                        arc.stepper.release()
        return self.trajectory()

    def trajectory(self) -> Trajectory:
        """Return the motion so far."""
        return self._builder.trajectory(partial(interpolation_of, self))

    # --- parts of it that are integrated again ------------------------------------------------
    @property
    def breaks(self) -> np.ndarray:
        """Times at which inputs or equations change, without the jumps of prescribed values that end a span, s."""
        timed = self._timed
        return distinct(np.concatenate([self.setup.signals.breaks, timed.stops, timed.jumps]))

    def parted(self) -> Run:
        """Return a run that goes on from states of this one, without events and without its record."""
        other = copy.copy(self)
        other.events, other.keeps_paths, other._paths, other._arcs = (), False, [], {}
        other._builder = other._arc = None  # type: ignore[assignment]
        return other

    def again(self, modes: Modes, start: Stretch, interruption: Interruption) -> Block:
        """Return ``t, q, v, a, z, lam, u`` of the motion that goes on from a state in the one mode of `modes`.

        It begins with that state, and ends early where the motion cannot be followed.
        """
        self.modes, self._interruption = modes, interruption
        grid = np.r_[start.start, start.times]
        share = (grid[-1] - grid[0]) / self._span
        self._pieces = math.ceil(self._kind.pieces * share)
        self._schedule = Schedule(
            grid,
            stops=np.concatenate([self.setup.signals.breaks, self._timed.stops]),
            jumps=self._timed.jumps,
            watch_points=math.ceil(self._watch_points * share),
        )
        self._builder, self._extra_stops, self._index = TrajectoryBuilder(modes, self.setup.p), np.zeros(0), 0
        self.transitions = Transitions(modes, (), self.instant)
        self.transitions.mode = modes.free
        self._time, self._x = start.start, np.concatenate([x.ravel() for x in start.state])
        q, v, z = (x.ravel() for x in start.state)
        nothing = np.zeros(self.setup.eom.a.numel()), z, np.zeros(0), np.zeros(0)
        mechanism = modes.numeric(modes.free).eom.mechanism
        self._enter(State(mechanism, start.start, q, v, *nothing, self.setup.p))
        self._keep(np.array([self._time]), self._x[None, :], np.array([self._time]))
        with simulated_time_bar(self._span, show=False) as bar, contextlib.suppress(SimulationError):
            self._run_pieces(bar)
        return tuple(np.concatenate(parts) for parts in zip(*self._builder.blocks, strict=True))

    def release(self) -> None:
        """Give back what is kept for later runs of the mechanism."""
        for arc in self._arcs.values():
            arc.stepper.release()
        self._arcs = {}

    @property
    def passages(self) -> tuple[float, ...]:
        """Times at which the last run passed poses in which the mechanism could fold, s."""
        return tuple(self._passed)

    def _prepare(self) -> None:
        """Empty the record of a run."""
        self._builder = TrajectoryBuilder(self.modes, self.setup.p)
        self._builder.statistics.notes += self._notes
        self._passed, self._extra_stops = [], np.zeros(0)
        self.changing, self.reached, self.stops = [], None, False

    def _begin(self) -> None:
        """Find the consistent start, and the mode that holds there."""
        setup, modes, begin = self.setup, self.modes, float(self.setup.grid[0])
        free = modes.numeric(modes.free)
        state = consistent_start(free, setup.initial, begin, setup.signals)
        if state.obstacle is not None:  # there are no accelerations: mass is missing, or the pose is singular
            raise state.obstacle
        if not np.isfinite(state.a).all():
            _ = state[free.eom.a]  # raises, and names what has no value
        refuse_singular_start(free, state)
        self._set_out_from(state)
        self._time, self._index = begin, 0
        state, strikes = self.transitions.started(state)
        self._builder.events += strikes
        state = self._controlled(state)
        self._enter(state, first=True)
        impacts = self.transitions.impacts
        for remark in impacts.remarks_on_start(state):
            warn(remark)
        self._reset_at(state, impacts.passed_by_rounding(state))

    def _resume(self, entry: State, passed: Sequence[Event]) -> None:
        """Go on from a state at any time, at which the mechanism has changed by events."""
        modes = self.modes
        state = modes.at(modes.free, entry.t, entry.q, entry.v, entry.z)
        self._set_out_from(state)
        self._time, self._index = state.t, self._schedule.index_after(state.t + self.instant)
        state, strikes = self.transitions.started(state)
        self._builder.events += strikes
        if self._schedule.samples_at(self._index - 1) and self._schedule.times[self._index - 1] >= state.t:
            state = self._controlled(state)
        self._enter(state, passed, first=True)
        self._reset_at(state, [], passed)

    def _controlled(self, state: State) -> State:
        """Take a sample of the controller if there is one; return the state under its answer."""
        controller, builder = self.setup.signals.controller, self._builder
        state, occurrences = self.transitions.by_controller(state)
        if not builder.is_empty:  # the mode of the start is found with the first answer
            builder.events += occurrences
        if controller is not None and controller.status is not None:
            builder.statistics.control_times.append(float(state.t))
            builder.statistics.control_statuses.append(controller.status)
        return state

    def _set_out_from(self, state: State) -> None:
        """Look at the rows at the first state, in the mode in which nothing is held."""
        free = self.modes.numeric(self.modes.free)
        self.redundant = free.has_redundant_rows(state.t, state.q)
        if self.redundant:
            self.modes.refuse_redundant_rows(state)
            refuse_redundant_rows(self.integrator, free, state)
        self.transitions.begin()

    def only_start(self, entry: State) -> Trajectory:
        """Return the motion of no duration at a state at which the mechanism has changed and the run ends."""
        self._prepare()
        self._resume(entry, ())
        return self.trajectory()

    def _run_pieces(self, bar: Any) -> None:
        """Advance piece by piece up to the end, or to an event that ends the run."""
        schedule = self._schedule
        size = -(-schedule.size // self._pieces)
        first = True
        while self._index < schedule.size:
            self._refuse_to_pass_obstacle()
            last = min(self._index + size - 1, schedule.next_break(self._index), schedule.size - 1)
            before, passed, index = self._time, len(self._passed), self._index
            ended = self._advance(last)
            if len(self._passed) > passed:  # what was integrated beyond a passage is discarded
                size = max(1, self._index - index)
            bar.update(self._time - before)
            if ended:
                return
            if self.modes.settling:
                self._builder.events += self.transitions.to_rest(self._arc.stepper.outputs.state(self._time, self._x))
            if first and self._arc.stepper.counts.steps:
                first = False
                if self.integrator.is_multistep and not any(map(resets_or_ends, self._arc.watch.events)):
                    size = schedule.joined(size, self._index, self._arc.stepper.counts.steps)
            if schedule.samples_at(self._index - 1) and self._time == schedule.times[self._index - 1]:
                state = self._controlled(self._arc.stepper.outputs.state(self._time, self._x))
                self._enter(state)
                self._reset_at(state, [])
        self._refuse_to_pass_obstacle()

    def _refuse_to_pass_obstacle(self) -> None:
        """Raise at a time at which no motion goes on."""
        obstacle, reached = self._obstacle, self._time + self._schedule.tolerance
        if obstacle is not None and obstacle.time is not None and obstacle.time <= reached:
            raise obstacle

    # --- one piece ----------------------------------------------------------------------------------
    def _advance(self, last: int) -> bool:
        """Advance by the piece that ends at an index, or by less; return True if the run ended."""
        arc = self._arc
        # a method that comes back on its way meets those that are left in the next piece
        self._extra_stops = self._extra_stops[self._extra_stops > self._time]
        piece = self._up_to_rest(self._schedule.piece(self._time, self._index, last).through(self._extra_stops))
        way = self.integrated(piece, comes_near=arc.passage.comes_near)
        for policy in arc.policies:
            way = policy.followed(way, self)
            if way.is_decided:
                break
        if way.passage is not None:
            return self._advance_across(way.piece, way.path, way.passage)
        return self._finish(way.piece, way.path, way.failure)

    def _up_to_rest(self, piece: Piece) -> Piece:
        """The beginning of a piece up to where bounces that are not followed come to rest; all of it if none do."""
        rest = min(self.modes.settling.values(), default=np.inf)
        later = piece.times[piece.times >= rest - self.instant]
        if not later.size:
            return piece
        return piece.until(float(later[0]) if later[0] - rest <= self.instant else rest)

    def smooth_until(self, time: float) -> float:
        """Return the time up to which nothing changes after another, s."""
        return self._schedule.smooth_until(time)

    def stop_at(self, *times: Any) -> None:
        """Add times that no step may cross, wherever the pieces end."""
        self._extra_stops = np.unique(np.concatenate([self._extra_stops, *times]))

    def integrated(
        self,
        piece: Piece,
        comes_near: Callable[[Path], bool] | None = None,
        stopped: IntegrationFailure | None = None,
    ) -> Way:
        """Return the way of the integrator over a piece from the present state; see :meth:`Arc.integrated`."""
        return self._arc.integrated(piece, self._x, self._interruption, comes_near, stopped)

    def _finish(
        self, piece: Piece, path: Path, failure: IntegrationFailure | None = None, *, passage: Passage | None = None
    ) -> bool:
        """Keep the outputs of a piece up to the first event that decides how the run goes on.

        Parameters
        ----------
        passage : Passage, optional
            Continues the motion across a singular pose, instead of the integrator.
        """
        arc = self._arc
        try:
            found = arc.outcome(piece, path, failure, passage)
        except IntegrationFailure as stopped:
            raise self._failed(piece, stopped) from None
        times, deciding = found.path.times[1:], found.deciding
        if found.failure is None and passage is None and times.size:
            counted = path.until(deciding[0].time if deciding else float(times[-1]))
            arc.resolution.note(counted)
            if self.keeps_paths:
                self._paths.append(counted)
        self._refuse_out_of_range(found, passage)
        before = self._keep_outputs(found, passage)
        if deciding:
            if passage is not None and not all(c.event.terminal for c in deciding):
                raise singular_event(arc.numeric, deciding[0].event.name, deciding[0].time, deciding[0].x)
            return self._at_events(deciding, before)
        if found.failure is not None:
            raise self._failed(piece, found.failure, found.path)
        self._time, self._x = float(times[-1]), found.path.x[-1]
        self._index = self._schedule.index_after(self._time)
        if found.piece.ends_at_jump:
            self._pass_jump(found.piece.after)
        elif found.ends_at_jump:
            arc.trail.begin(self._time, self._x)
        else:
            arc.trail.add(times, found.path.x[1:])
        return False

    def _refuse_out_of_range(self, found: Outcome, passage: Passage | None) -> None:
        """Raise at the first state of a piece at which a quantity is out of its range, and keep the outputs before."""
        arc = self._arc
        if not arc.ranges.limits:
            return
        path = found.path.until(found.deciding[0].time) if found.deciding else found.path
        count, begins = path.times.size - 1, found.piece.begins
        block = arc.outputs(passage).block(path.times, path.x, np.r_[path.times[:1], begins[:count]])
        broken = arc.ranges.first_broken(block)
        if broken is not None:
            kept = found.piece.requested[:count] & (np.arange(1, count + 1) < broken[0])
            self._keep(path.times[1:][kept], path.x[1:][kept], begins[:count][kept], arc.outputs(passage))
            self._stop_out_of_range(float(path.times[broken[0]]), broken[1])

    def _stop_out_of_range(self, time: float, objection: str) -> NoReturn:
        kept = "" if self._builder.is_empty else "; what was computed is in .partial"
        raise SimulationError(f"{objection} at t = {time:.6g} s{kept}", time=time)

    def _keep_outputs(self, found: Outcome, passage: Passage | None) -> Outputs:
        """Keep outputs and events up to the first that decides; return what makes outputs just before that one."""
        arc, deciding = self._arc, found.deciding
        times, x, usual = found.path.times[1:], found.path.x[1:], arc.outputs(passage)
        at_events = [usual if passage else arc.outputs_before(found.path, c) for c in found.crossings]
        before, requested, count = usual, found.piece.requested[: times.size], times.size
        at_end = np.zeros(count, bool)
        if deciding:
            time, before = deciding[0].time, at_events[found.crossings.index(deciding[0])]
            # an output at the event itself is just before it
            count = int(np.searchsorted(times, time + self.instant, side="right"))
            x = np.where((times > time)[:, None], deciding[0].x, x)
            at_end = times >= time - self.instant
        for some, made_by in ((requested & ~at_end, usual), (requested & at_end, before)):
            kept = slice(count) if some[:count].all() else some[:count].nonzero()[0]
            self._keep(times[kept], x[kept], found.piece.begins[kept], made_by)
        for crossing, outputs in zip(found.crossings, at_events, strict=True):
            if not arc.decides(crossing.event):
                self._builder.events.append(self._occurrence(crossing, outputs))
        return before

    # --- singular poses -------------------------------------------------------------------------------
    def _advance_across(self, piece: Piece, path: Path, passage: Passage) -> bool:
        """Advance to the far side of a singular pose; return True if the run ended."""
        approach = self._schedule.stretch(piece.start, self._index, passage.start)
        if self._finish(approach, passage.approach(path, approach.times)):
            return True
        if self._time < passage.start:  # an event came before
            return False
        arc = self._arc
        across = self._schedule.stretch(self._time, self._index, passage.end)
        self._passed.append((passage.start + passage.end) / 2)
        nothing = np.zeros((across.times.size, path.integrals.shape[1]))
        states = np.vstack([self._x, passage.states(across.times[:-1]), passage.x])
        ended = self._finish(across, Path(np.r_[across.start, across.times], states, nothing), passage=passage)
        arc.passage.left_behind()
        if self._time == passage.end:
            self._arc.trail.begin(self._time, self._x)
        return ended

    def _pass_jump(self, after: float) -> None:
        """Go on from just after a jump of the equations: prescribed velocities may jump, by an impulse."""
        self._builder.leave(self._time, self._x)
        q, v, z = (part[0] for part in self._arc.stepper.outputs.split(self._x[None, :]))
        jacobian, nu = self._arc.numeric.velocity(after, q, z)
        if nu.size:
            self._x = np.r_[q, jump(self._arc.numeric, jacobian, nu, v, z).v, z]
        self._arc.trail.begin(self._time, self._x)
        self._builder.enter(self._time, self._x, self._arc.mode)

    def _keep(self, times: np.ndarray, x: np.ndarray, since: np.ndarray, outputs: Outputs | None = None) -> None:
        """Record outputs at states."""
        if times.size:
            self._record((outputs or self._arc.stepper.outputs).block(times, x, since))

    def _record(self, block: Block) -> None:
        """Record outputs, up to the one at which friction leaves the reactions open."""
        arc = self._arc
        t, q, v, _, z, lam, u = block
        lost = arc.uniqueness.first_lost(t, q, v, z, lam, u)
        unique = block if lost is None else tuple(part[:lost] for part in block)
        self._builder.add(arc.mode, unique)
        self.modes.check(arc.mode, unique)
        if lost is not None:
            raise SimulationError(
                f"{arc.uniqueness.sentence(float(t[lost]))}; what was computed is in .partial", time=float(t[lost])
            )

    # --- events and modes ---------------------------------------------------------------------------
    def _enter(self, state: State, located: Sequence[Event] = (), *, first: bool = False) -> None:
        """Go on from a state in the present mode, after events that took place there."""
        mode = self.transitions.mode
        if mode not in self._arcs:
            self._arcs[mode] = self._arc_in(mode, state)
        arc = self._arc = self._arcs[mode]
        if not first:
            self._builder.leave(self._time, self._x)
        self._x, self._time = np.concatenate([state.q, state.v, state.z]), state.t
        self._arc.trail.begin(self._time, self._x)
        arc.watch.start_at(state, located)
        self._builder.enter(state.t, self._x, mode)
        if first:
            statistics = self._builder.statistics
            statistics.method = self.integrator.name
            statistics.formulation = self.modes.prefix + arc.stepper.formulation.name
            if self.redundant:
                statistics.notes.append(LEAST_NORM)
            block = tuple([np.array(part)[None] for part in state.arguments[:-1]])
            if broken := arc.ranges.first_broken(block):
                self._stop_out_of_range(state.t, broken[1])
            self._record(block)

    def _arc_in(self, mode: Any, state: State) -> Arc:
        """The part of the run in a mode, which is entered at a state for the first time."""
        numeric, own = self.modes.numeric(mode), self.modes.events(mode)
        system = SteppedSystem(
            numeric, self.setup.signals, self.modes.levels, self.integrator, self._span, self.redundant, self._max_step
        )
        watch = EventWatch(numeric.eom, self.events, self.instant, self.transitions.states, own)
        return Arc(mode, state, system, watch, own, Ranges(numeric.eom, numeric.p, self.modes.mechanism))

    def _occurrence(self, crossing: Crossing, outputs: Outputs) -> EventOccurrence:
        state = self._state(outputs, crossing.time, crossing.x)
        return EventOccurrence(crossing.event.name, crossing.time, self.modes.whole(self._arc.mode, state))

    def _state(self, outputs: Outputs, time: float, x: np.ndarray) -> State:
        """A state of the mechanism of the present mode."""
        _, q, v, a, z, lam, u = (part[0] for part in outputs.block(np.array([time]), x[None, :]))
        numeric = self._arc.numeric
        return State(numeric.eom.mechanism, time, q, v, a, z, lam, u, numeric.p)

    def _at_events(self, crossings: Sequence[Crossing], before: Outputs) -> bool:
        """Go on from the events of one instant; return True if one of them ends the run.

        Parameters
        ----------
        before : Outputs
            What makes the outputs just before it.
        """
        arc, first = self._arc, crossings[0]
        self._index = self._schedule.index_after(first.time + self.instant)
        terminal = [c for c in crossings if ends_run(c.event) and not arc.is_own(c.event)]
        time = self._keep_end(terminal, before) if terminal else first.time
        state = self._state(before, time, first.x)
        self._time, self._x = time, first.x
        mode_events = [c.event for c in crossings if arc.is_own(c.event)]
        if mode_events:
            state, occurrences = self.transitions.out_of_mode(state, mode_events)
            self._builder.events += occurrences
        if terminal:
            self.changing = [c.event for c in terminal if c.event.becomes is not None]
            self.reached = self.transitions.whole(state)
            self.stops = any(c.event.terminal for c in terminal)
            return True
        self._enter(state, [c.event for c in crossings])
        self._reset_at(state, [c.event for c in crossings if c.event.reset])
        index = self._schedule.break_within(time, self.instant)
        if index is not None:  # of the same instant
            self._time, self._index = float(self._schedule.times[index]), index + 1
            just_after = self._schedule.after_jump(index)
            if just_after is not None:
                self._pass_jump(just_after)
        return False

    def _keep_end(self, terminal: Sequence[Crossing], before: Outputs) -> float:
        """Keep the events that end the run, and the output at their instant; return its time."""
        time, last = terminal[0].time, self._builder.last_time
        if abs(last - time) <= self.instant:
            time = max(time, last)  # at an output, by rounding before it
        for crossing in terminal:
            if crossing.event.becomes is None:
                self._builder.events.append(self._occurrence(crossing, before))
        if last < time:
            self._keep(np.array([time]), terminal[0].x[None, :], np.array([time]), before)
        return time

    def _reset_at(self, state: State, located: Sequence[Event], passed: Sequence[Event] = ()) -> None:
        """Go on from the resets at a state, if any take place."""
        if not any(event.reset for event in self.events):
            return
        state, occurrences = self.transitions.by_resets(state, located, passed)
        self._builder.events += occurrences
        if occurrences:
            self._enter(state, located)
        if occurrences or located or state.t == self.setup.grid[0]:
            self.transitions.impacts.refuse_pressed_through(state)

    # --- the end of a run that does not get to its end ----------------------------------------------
    def _interrupted(self) -> Interrupted:
        if self._builder.is_empty:
            return Interrupted("stopped by the user before the start was found", time=float(self.setup.grid[0]))
        reached = self._builder.last_time
        return Interrupted(
            f"stopped by the user at t = {reached:.6g} s; what was computed is in .partial",
            time=reached,
            partial=self.trajectory(),
        )

    def _failed(self, piece: Piece, failure: IntegrationFailure, path: Path | None = None) -> SimulationError:
        reached, last = (piece.start, self._x) if path is None else (float(path.times[-1]), path.x[-1])
        if failure.last is not None and failure.last_x is not None:
            reached, last = failure.last, failure.last_x
        ahead = 1e-3 * (piece.times[-1] - piece.start)
        near = SHORTLY * (self._schedule.end - self._schedule.start)
        corner = next((jump for jump in self._corners if abs(jump.time - reached) <= near), None)
        if corner is not None:
            cause = f"{corner}, and the expression has no accurate derivative close to it; {corner.remedy}"
        else:
            outputs, method = self._arc.stepper.tolerant_outputs, self.integrator.name
            cause = cause_of_failure(outputs, self._arc.ranges, reached, last, failure.flag, ahead, method)
        return SimulationError(
            f"the simulation stopped at t = {reached:.6g} s: {cause}; what was computed is in .partial",
            time=reached,
            partial=self.trajectory(),
        )

    @property
    def starts(self) -> int:
        """Number of starts of the integrator."""
        return sum([arc.stepper.counts.starts for arc in self._arcs.values()])

    @property
    def steps(self) -> int:
        """Steps of the integrator."""
        return sum([arc.stepper.counts.all_steps for arc in self._arcs.values()])

    def shortest_load(self, integrands: ca.SX | None = None) -> float:
        """Duration of the shortest load, contact or integrand on the paths that were kept, s; infinite if none."""
        if not self._paths:
            return np.inf
        path = Path.joined(self._paths)
        arc = self._arc
        looks = [arc.unseen_loads] if integrands is None else [arc.unseen_loads, UnseenLoads(arc.stepper, integrands)]
        return min([arc.resolution.shortest_contact(path), *(look.shortest(path) for look in looks)])

    def unresolved(self) -> list[str]:
        """Sentences on what the steps of the integrator did not resolve."""
        return list(dict.fromkeys(sentence for arc in self._arcs.values() for sentence in arc.resolution.sentences()))


def failed_plans(controller: SampledController | None, statistics: Statistics) -> list[str]:
    """A sentence on samples at which a controller had no plan as it was asked for, if there are any."""
    statuses, times = np.array(statistics.control_statuses, int), statistics.control_times
    failed = np.flatnonzero(statuses)
    if not failed.size or controller is None:
        return []
    first = int(failed[0])
    return [
        f"at {failed.size} of {statuses.size} samples the controller had no plan as asked for, first at t = "
        f"{times[first]:.6g} s: {controller.meaning(int(statuses[first]))}; see motion.statistics.control_statuses"
    ]
