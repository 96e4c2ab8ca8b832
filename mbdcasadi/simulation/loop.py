"""One run of a simulation: chunk after chunk, and what happens when it stops."""

from __future__ import annotations

import time as clock
from enum import Enum
from typing import Any

import numpy as np

from ..equations.numeric import NumericEquations
from ..errors import Interrupted, SimulationError
from ..integrators.integration import IntegrationFailure
from ..numerics.console import interruptible
from ..numerics.progress import seconds_bar
from ..results.state import State
from ..results.trajectory import EventOccurrence, Trajectory
from .chunks import Chunk, chunks_of, merged
from .events import Crossing, EventWatch
from .failure_diagnosis import cause_of_failure
from .impacts import Impacts, resets
from .input_sampling import InputFeed
from .resolution import Resolution
from .stepping import Stepper
from .trajectory_builder import Record
from .uniqueness import Uniqueness

#: Violation of a constraint (m or rad) that projection cannot remove, from which the mechanism counts as apart.
APART = 1e-8
#: A multistep method starts with some hundred small steps of low order: chunks that take fewer steps than this are
#: joined (measured: twenty chunks of 140 steps take three times as long as one).
STEPS_PER_CHUNK = 1000
#: How far a body may turn in a chunk of the regularised form, rad.
TURN_PER_CHUNK = 3.0

#: Share of a chunk after whose start alone a start at a touch makes sense.
NEW_START = 1e-6

LEAST_NORM = "the constraints are redundant: multipliers and reactions are those of least norm"
NEAR_SINGULAR = (
    "the motion comes near a singular pose, where another branch begins: from there on the regularised form is "
    "integrated; over many such poses compare the energy, or a run with method='erk'"
)


class Outcome(Enum):
    """What became of a chunk."""

    DONE = "done"
    WAITING = "it ends near a singular pose and is run again together with the next one"
    SHORTEN = "it comes near a singular pose and is run again in chunks of the usual length"
    ENDED = "a terminal event ended the run"
    TOUCH = "outlines passed through each other between two steps; it is run again, with a start where they meet"
    RESET = "an event reset the velocities, and the rest of the chunk is to be run from there"


class Run:
    """A simulation that is being run.

    Parameters
    ----------
    numeric : NumericEquations
        Equations at the parameters of the run.
    feed : InputFeed
        Inputs.
    watch : EventWatch
        Events.
    method : {"idas", "erk", "rosenbrock"}
        Integrator.
    settings : dict
        ``reltol``, ``abstol``, ``jit``, ``options`` of the integrator.
    progress : bool
        Show a progress bar.
    """

    def __init__(
        self,
        numeric: NumericEquations,
        feed: InputFeed,
        watch: EventWatch,
        method: str,
        settings: dict[str, Any],
        *,
        progress: bool = False,
    ):
        self.numeric, self.feed, self.watch = numeric, feed, watch
        self.method = method
        self._settings, self._progress = settings, progress
        self._rest: list[Chunk] = []
        self._uniqueness = Uniqueness(numeric)
        self.resolution = Resolution(numeric)

    # --- the loop ------------------------------------------------------------------------
    def over(self, grid: np.ndarray, start: State, *, redundant: bool, after_reset: bool = False) -> Trajectory:
        """Run over an output grid from a consistent start."""
        began = clock.perf_counter()
        step = self._step = Stepper(
            self.numeric, self.feed, self.method, self._settings, self.resolution, start, redundant=redundant
        )
        self.feed.ask(start)
        self._impacts = Impacts(self.numeric, self.watch, float(grid[-1] - grid[0]))
        if after_reset:
            self.watch.reset_at(start)
        record = self._record = Record(
            self.numeric.eom.mechanism, self.numeric.p, step.outputs.recovery.refine(self.feed.rule)
        )
        record.statistics.method, record.statistics.formulation = self.method, step.formulation.name
        if redundant:
            record.statistics.notes.append(LEAST_NORM)
        first = step.outputs.block(np.array([start.t]), step.x[None, :], self.feed.at_start(start.t))
        self._keep(first)
        with interruptible() as self._interruption:
            try:
                self._chunks(chunks_of(grid, **self._cuts))
            except KeyboardInterrupt:
                raise self._interrupted() from None
            finally:
                record.statistics.seconds = clock.perf_counter() - began
                record.statistics.restarts = step.starts
        return record.trajectory()

    @property
    def _cuts(self) -> dict[str, Any]:
        """What decides on the chunks besides the output grid."""
        signals = self.feed.signals
        return {"period": self.feed.period, "breaks": signals.breaks}

    def _chunks(self, chunks: list[Chunk]) -> None:
        waiting: Chunk | None = None
        left = list(chunks)
        self._usual_length = chunks[0].length
        with seconds_bar(sum(chunk.length for chunk in chunks), self._progress) as bar:
            while left:
                chunk = left.pop(0)
                goes_on = chunk is chunks[0] or any(chunk is rest for rest in self._rest)
                if self.feed.signals.controller and not goes_on:
                    self.feed.ask(self._step.outputs.state(chunk.start, self._step.x, self.feed.at_start(chunk.start)))
                joined = chunk if waiting is None else waiting.joined(chunk)
                outcome = self._one_chunk(joined, may_wait=bool(left) and not self.feed.signals.controller)
                if outcome is Outcome.SHORTEN:
                    left, waiting = self._shortened([joined, *left]), None
                    bar.update(chunk.length - joined.length)
                    continue
                if outcome in (Outcome.TOUCH, Outcome.RESET):
                    left, waiting = [*self._rest, *left], None
                    bar.update(chunk.length - sum(rest.length for rest in self._rest))
                    continue
                bar.update(chunk.length)
                if outcome is Outcome.ENDED:
                    return
                waiting = joined if outcome is Outcome.WAITING else None
                if chunk is chunks[0]:
                    left = self._lengthened(left)

    def _shortened(self, chunks: list[Chunk]) -> list[Chunk]:
        """Chunks in which no body turns far, so that little drift meets a singular pose."""
        pieces = [piece for chunk in chunks for piece in chunk.pieces]
        counts = [int(np.ceil(piece.length * self._step.fastest / TURN_PER_CHUNK)) for piece in pieces]
        return [short for piece, n in zip(pieces, counts, strict=True) for short in piece.divided(max(n, 1))]

    def _lengthened(self, chunks: list[Chunk]) -> list[Chunk]:
        """Fewer, longer chunks where a multistep method would spend most of its steps on starting."""
        steps = self._step.steps
        if self.method != "idas" or self.feed.signals.controller or resets(self.watch.events):
            return chunks
        if not 0 < steps < STEPS_PER_CHUNK:
            return chunks
        return merged(chunks, max(1, len(chunks) * steps // STEPS_PER_CHUNK))

    def _one_chunk(self, chunk: Chunk, *, may_wait: bool) -> Outcome:
        """Advance by a chunk."""
        channel, failure = self.feed.channel(chunk), None
        try:
            x = self._step.advance(chunk, channel, self._usual_length, self._interruption)
        except IntegrationFailure as stopped:
            x, failure = stopped.x, stopped
        times, wanted = chunk.times[: len(x)], chunk.wanted[: len(x)]
        x = self._step.outputs.projected(times, x)
        if self._step.outputs.recovery.left_over > APART:
            x, failure = self._together(times, x)
            times, wanted = times[: len(x)], wanted[: len(x)]
        self._step.note_turning(x)
        if failure is None and self._passes_through(chunk):
            return Outcome.TOUCH
        if failure is None and self._step.came_near_singular():
            self._record.statistics.formulation += ", then regularised"
            self._record.statistics.notes.append(NEAR_SINGULAR)
            return Outcome.SHORTEN
        if failure is None and may_wait and self._step.ends_near_singular():
            return Outcome.WAITING
        stop = None
        if self.watch.events and len(x):
            times, wanted, x, stop = self._note_events(chunk, times, wanted, x, channel)
        if failure is None:
            self.resolution.note(self._step.path.until(float(times[-1]) if len(times) else chunk.start))
        if np.any(wanted):
            columns = None if channel is None else channel[:, : len(times)][:, wanted]
            self._keep(self._step.outputs.block(times[wanted], x[wanted], columns))
        if stop is not None:
            return self._reset(chunk, stop, len(times)) if stop.event.reset else Outcome.ENDED
        if failure is not None:
            raise self._failed(chunk, failure, times, x)
        self._step.go_on_from(float(times[-1]), x[-1], None if channel is None else channel[:, -1:])
        return Outcome.DONE

    def _passes_through(self, chunk: Chunk) -> bool:
        """Cut a chunk where outlines meet that no step found closed: an integrator starts with small steps."""
        time = self.resolution.first_pass(self._step.path)
        if time is None or time - chunk.start < NEW_START * chunk.length:
            return False
        self._rest = list(chunk.cut(time))
        return True

    def _keep(self, block: tuple[np.ndarray, ...]) -> None:
        """Record outputs, up to the one at which friction leaves the reactions open."""
        t, q, v, _, z, lam, u = block
        lost = self._uniqueness.first_lost(t, q, v, z, lam, u)
        if lost is None:
            self._record.add(*block)
            return
        self._record.add(*(part[:lost] for part in block))
        raise SimulationError(
            f"{self._uniqueness.sentence(float(t[lost]))}; what was computed is in .partial",
            time=float(t[lost]),
            partial=self._record.trajectory(),
        )

    def _together(self, times: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, IntegrationFailure | None]:
        """Outputs up to the first one that cannot be brought onto the constraints, and the failure there."""
        eom = self.numeric.eom
        for k, time in enumerate(times):
            phi = np.abs(self.numeric.position(float(time), x[k, : eom.q.numel()])[0])
            if np.max(phi) > APART:
                rows = [eom.row_names[eom.position_rows[r]] for r in np.argsort(-phi) if phi[r] > APART]
                said = f"the constraints {', '.join(rows[:6])} cannot be met together any more"
                last = x[k - 1] if k else self._step.x
                return x[:k], IntegrationFailure(said, x[:k], x[:k, :0], float(times[k - 1]) if k else None, last)
        return x, None

    # --- events ---------------------------------------------------------------------------------
    def _note_events(
        self, chunk: Chunk, times: np.ndarray, wanted: np.ndarray, x: np.ndarray, channel: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, Crossing | None]:
        """Record the events of a chunk; one that ends the run or resets velocities cuts its outputs off."""
        knots, states = np.r_[chunk.start, times], np.vstack([self._step.x, x])
        crossings = self.watch.crossings(self._step.outputs, knots, states, channel, self._step.way_from)
        for found in crossings:
            k = found.interval
            if found.event.reset:
                k += int(times[k] - found.time <= self.watch.instant)  # an output at the event itself comes before it
                return times[:k], wanted[:k], x[:k], found
            state = self._step.outputs.state(found.time, found.x, found.channel)
            self._record.events.append(EventOccurrence(found.event.name, found.time, state))
            if found.event.terminal and found is crossings[-1]:
                return np.r_[times[:k], found.time], np.r_[wanted[:k], True], np.vstack([x[:k], found.x]), found
        return times, wanted, x, None

    def _reset(self, chunk: Chunk, found: Crossing, count: int) -> Outcome:
        """Record an event that resets velocities, and what it brings about at the same instant; go on from there."""
        time, column = found.time, found.channel
        try:
            impacts = self._impacts.after(found.event, self._step.outputs.state(time, found.x, column))
        except SimulationError as error:
            raise SimulationError(str(error), time=time, partial=self._record.trajectory()) from None
        for event, state, v, z in impacts:
            self._step.x = np.r_[state.q, v, z]
            after = self._step.outputs.state(time, self._step.x, column)
            self._record.events.append(EventOccurrence(event.name, time, state, after))
        self._step.go_on_from(time, self._step.x, column)
        self.watch.reset_at(after)
        rest = chunk.rest(time, count)
        self._rest = [] if rest is None else [rest]
        return Outcome.RESET

    # --- the end of a run that does not get to its end ----------------------------------------------
    def _interrupted(self) -> Interrupted:
        reached = self._record.last_time
        return Interrupted(
            f"stopped by the user at t = {reached:.6g} s; what was computed is in .partial",
            time=reached,
            partial=self._record.trajectory(),
        )

    def _failed(self, chunk: Chunk, failure: IntegrationFailure, times: np.ndarray, x: np.ndarray) -> SimulationError:
        reached, last = (float(times[-1]), x[-1]) if len(times) else (chunk.start, self._step.x)
        if failure.last is not None and failure.last_x is not None:
            reached, last = failure.last, failure.last_x
        ahead = 1e-3 * (chunk.times[-1] - chunk.start)
        cause = cause_of_failure(self.numeric, reached, *self._step.outputs.split(last[None, :]), failure.flag, ahead)
        return SimulationError(
            f"the simulation stopped at t = {reached:.6g} s: {cause}; what was computed is in .partial",
            time=reached,
            partial=self._record.trajectory(),
        )
