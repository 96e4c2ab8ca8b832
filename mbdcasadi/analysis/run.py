"""One run of a simulation: chunk after chunk, and what happens when it stops."""

from __future__ import annotations

import time as clock
from enum import Enum
from typing import Any

import numpy as np

from ..equations.numeric import NumericEquations
from ..errors import Interrupted, SimulationError
from ..numerics.console import interruptible
from ..numerics.integration import FEW_STEPS, MAX_STEPS, IntegrationFailure, Integrator
from ..numerics.least_squares import largest
from ..results.state import State
from ..results.trajectory import EventOccurrence, Trajectory
from .causes import cause_of_failure
from .event_location import Crossing, EventWatch
from .feed import InputFeed
from .formulations import EXPLICIT_BODIES, Formulation, choose
from .impact import Impacts, resets
from .outputs import Outputs
from .progress import progress_bar
from .record import Record
from .schedule import Chunk, chunks_of, merged
from .uniqueness import Uniqueness

#: Fall of the smallest pivot of ``Phi_q M⁻¹ Phi_q^T``, relative to the largest one seen, at which the regularised
#: form takes over for the rest of a run: the mechanism passes near a singular pose. For many bodies, where the
#: change costs more, the pose must be nearer to it.
NEARLY_SINGULAR, NEARLY_SINGULAR_MANY = 0.02, 1e-4
#: Violation of a constraint (m or rad) that projection cannot remove, from which the mechanism counts as apart.
APART = 1e-8
#: A multistep method starts with some hundred small steps of low order: chunks that take fewer steps than this are
#: joined (measured: twenty chunks of 140 steps take three times as long as one).
STEPS_PER_CHUNK = 1000
#: The same, below which no chunk is to end: the projection there is uncertain, and a start from it is off.
NO_START = 0.02
#: How far a body may turn in a chunk of the regularised form, rad.
TURN_PER_CHUNK = 3.0
#: Decay of drift in the regularised form: so many times in a chunk, and for each radian that a body turns.
DECAY, DECAY_PER_RADIAN = 20.0, 5.0

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
        self._integrators: dict[Formulation, Integrator] = {}
        self._outputs = {flag: Outputs(numeric, feed, redundant=flag) for flag in (False, True)}
        self._regular = 0.0
        self._fastest = 0.0
        self._rest: list[Chunk] = []
        self._uniqueness = Uniqueness(numeric)

    @property
    def outputs(self) -> Outputs:
        """Outputs in the form of the equations that is used now."""
        return self._outputs[self.formulation.redundant]

    # --- the loop ------------------------------------------------------------------------
    def over(self, grid: np.ndarray, start: State, *, redundant: bool) -> Trajectory:
        """Run over an output grid from a consistent start."""
        began = clock.perf_counter()
        self.formulation = choose(self.numeric, self.method, redundant=redundant)
        self.feed.ask(start)
        self._x = np.r_[start.q, start.v, start.z]
        self._z = self._estimate(np.r_[start.a, start.lam])
        self._impacts = Impacts(self.numeric, self.watch, float(grid[-1] - grid[0]))
        record = self._record = Record(
            self.numeric.eom.mechanism, self.numeric.p, self.outputs.recovery.refine(self.feed.rule)
        )
        record.statistics.method, record.statistics.formulation = self.method, self.formulation.name
        if redundant:
            record.statistics.notes.append(LEAST_NORM)
        first = self.outputs.block(np.array([start.t]), self._x[None, :], self.feed.at_start(start.t))
        self._keep(first)
        with interruptible() as self._interruption:
            try:
                self._chunks(chunks_of(grid, **self._cuts))
            except KeyboardInterrupt:
                raise self._interrupted() from None
            finally:
                record.statistics.seconds = clock.perf_counter() - began
                record.statistics.restarts = sum(i.starts for i in self._integrators.values())
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
        with progress_bar(chunks, self._progress) as bar:
            while left:
                chunk = left.pop(0)
                goes_on = chunk is chunks[0] or any(chunk is rest for rest in self._rest)
                if self.feed.signals.controller and not goes_on:
                    self.feed.ask(self.outputs.state(chunk.start, self._x, self.feed.at_start(chunk.start)))
                joined = chunk if waiting is None else waiting.joined(chunk)
                outcome = self._one_chunk(joined, may_wait=bool(left) and not self.feed.signals.controller)
                if outcome is Outcome.SHORTEN:
                    left, waiting = self._shortened([joined, *left]), None
                    continue
                if outcome is Outcome.RESET:
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
        counts = [int(np.ceil(piece.length * self._fastest / TURN_PER_CHUNK)) for piece in pieces]
        return [short for piece, n in zip(pieces, counts, strict=True) for short in piece.divided(max(n, 1))]

    def _lengthened(self, chunks: list[Chunk]) -> list[Chunk]:
        """Fewer, longer chunks where a multistep method would spend most of its steps on starting."""
        steps = self._integrator(self.formulation).steps
        if self.method != "idas" or self.feed.signals.controller or resets(self.watch.events):
            return chunks
        if not 0 < steps < STEPS_PER_CHUNK:
            return chunks
        return merged(chunks, max(1, len(chunks) * steps // STEPS_PER_CHUNK))

    def _one_chunk(self, chunk: Chunk, *, may_wait: bool) -> Outcome:
        """Advance by a chunk."""
        channel, failure = self.feed.channel(chunk), None
        try:
            x = self._advance(chunk, channel)
        except IntegrationFailure as stopped:
            x, failure = stopped.x, stopped
        times, wanted = chunk.times[: len(x)], chunk.wanted[: len(x)]
        x = self.outputs.projected(times, x)
        if self.outputs.recovery.left_over > APART:
            x, failure = self._together(times, x)
            times, wanted = times[: len(x)], wanted[: len(x)]
        self._note_turning(x)
        if failure is None and self._comes_near_singular():
            return Outcome.SHORTEN
        if failure is None and may_wait and self._ends_near_singular():
            return Outcome.WAITING
        stop = None
        if self.watch.events and len(x):
            times, wanted, x, stop = self._note_events(chunk, times, wanted, x, channel)
        if np.any(wanted):
            columns = None if channel is None else channel[:, : len(times)][:, wanted]
            self._keep(self.outputs.block(times[wanted], x[wanted], columns))
        if stop is not None:
            return self._reset(chunk, stop, len(times)) if stop.event.reset else Outcome.ENDED
        if failure is not None:
            raise self._failed(chunk, failure, times, x)
        self._feed_back(float(times[-1]), x[-1], None if channel is None else channel[:, -1:])
        return Outcome.DONE

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
                last = x[k - 1] if k else self._x
                return x[:k], IntegrationFailure(said, x[:k], x[:k, :0], float(times[k - 1]) if k else None, last)
        return x, None

    def _feed_back(self, time: float, x: np.ndarray, channel: np.ndarray | None) -> None:
        """Start the next chunk from the projected end of this one."""
        self._x = x
        if self.formulation.algebraic:
            self._z = self._estimate(self.outputs.unknowns(time, x, channel))

    def _estimate(self, z: np.ndarray) -> np.ndarray:
        """Estimate of the algebraic unknowns from which the integrator finds consistent ones.

        Zero where the equations are linear in them: one Newton step of IDAS
        then finds them, while a residual of rounding size, which no step
        reduces, makes its line search fail (seen from 200 bodies on).
        """
        return z if self.numeric.eom.Q_depends_on_lam else np.zeros_like(z)

    # --- integrating -------------------------------------------------------------------------
    def _integrator(self, form: Formulation) -> Integrator:
        if form not in self._integrators:
            dae = form.dae(self.numeric, self.feed.signals)
            self._integrators[form] = Integrator(dae, self.method, **self._settings)
        return self._integrators[form]

    def _advance(self, chunk: Chunk, channel: np.ndarray | None) -> np.ndarray:
        """States at the outputs of a chunk.

        Where the usual form fails the regularised one is tried, which passes
        singular poses; then the usual one with all the steps it may take.
        """
        usual, flag, p = self.formulation, "", self._parameters(chunk)
        attempts = [(usual, FEW_STEPS), (usual, MAX_STEPS)]
        if usual.name != "regularised" and not self.numeric.eom.Q_depends_on_lam:
            attempts.insert(1, (Formulation("regularised"), FEW_STEPS))
        for k, (form, steps) in enumerate(attempts):
            if k > 0 and form == usual and flag != "IDA_TOO_MUCH_WORK":
                break
            z = self._z if form.algebraic else np.zeros(0)
            try:
                return self._integrator(form).advance(self._x, z, chunk.start, chunk.times, p, channel, steps)[0]
            except IntegrationFailure as failure:
                if self._interruption.requested:  # inside an integrator Ctrl-C comes back as a failure like others
                    raise KeyboardInterrupt from None
                flag = failure.flag if form == usual else flag
        z = self._z if usual.algebraic else np.zeros(0)
        stopped = self._integrator(usual).rescue(flag, self._x, z, chunk.start, chunk.times, p, channel)
        if self._interruption.requested:
            raise KeyboardInterrupt
        raise stopped

    def _parameters(self, chunk: Chunk) -> np.ndarray:
        """Parameters of the integrator: those of the model, and the rate at which drift decays."""
        rate = max(DECAY / min(self._usual_length, chunk.length), DECAY_PER_RADIAN * self._fastest)
        return np.r_[self.numeric.p, rate]

    def _note_turning(self, x: np.ndarray) -> None:
        """Keep the largest angular velocity that was seen."""
        n = self.numeric.eom.q.numel()
        turning = x[:, n + 2 : n + 3 * len(self.numeric.eom.mechanism.bodies) : 3]
        self._fastest = max(self._fastest, largest(turning))

    def _comes_near_singular(self) -> bool:
        """Change to the regularised form where the poses of a chunk come near to a singular one."""
        regularity = self.outputs.recovery.regularity
        self._regular = max(self._regular, float(np.max(regularity, initial=0.0)))
        many = len(self.numeric.eom.mechanism.bodies) > EXPLICIT_BODIES
        limit = (NEARLY_SINGULAR_MANY if many else NEARLY_SINGULAR) * self._regular
        near = float(np.min(regularity, initial=np.inf)) < limit
        if not near or self.formulation.name == "regularised" or self.numeric.eom.Q_depends_on_lam:
            return False
        self.formulation = Formulation("regularised")
        self._record.statistics.formulation += ", then regularised"
        self._record.statistics.notes.append(NEAR_SINGULAR)
        return True

    def _ends_near_singular(self) -> bool:
        """Whether a chunk ends so near to a singular pose that no integrator should be started there."""
        return float(self.outputs.recovery.regularity[-1]) < NO_START * self._regular

    # --- events ---------------------------------------------------------------------------------
    def _note_events(
        self, chunk: Chunk, times: np.ndarray, wanted: np.ndarray, x: np.ndarray, channel: np.ndarray | None
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, Crossing | None]:
        """Record the events of a chunk; one that ends the run or resets velocities cuts its outputs off."""
        knots, states = np.r_[chunk.start, times], np.vstack([self._x, x])
        for found in self.watch.crossings(self.outputs, knots, states, channel, self._reach):
            k = found.interval
            if found.event.reset:
                k += int(times[k] - found.time <= self.watch.instant)  # an output at the event itself comes before it
                return times[:k], wanted[:k], x[:k], found
            state = self.outputs.state(found.time, found.x, found.channel)
            self._record.events.append(EventOccurrence(found.event.name, found.time, state))
            if found.event.terminal:
                return np.r_[times[:k], found.time], np.r_[wanted[:k], True], np.vstack([x[:k], found.x]), found
        return times, wanted, x, None

    def _reset(self, chunk: Chunk, found: Crossing, count: int) -> Outcome:
        """Record an event that resets velocities, and what it brings about at the same instant; go on from there."""
        time, column = found.time, found.channel
        try:
            impacts = self._impacts.after(found.event, self.outputs.state(time, found.x, column))
        except SimulationError as error:
            raise SimulationError(str(error), time=time, partial=self._record.trajectory()) from None
        for event, state, v, z in impacts:
            self._x = np.r_[state.q, v, z]
            after = self.outputs.state(time, self._x, column)
            self._record.events.append(EventOccurrence(event.name, time, state, after))
        self._feed_back(time, self._x, column)
        self.watch.reset_at(after)
        rest = chunk.rest(time, count)
        self._rest = [] if rest is None else [rest]
        return Outcome.RESET

    def _reach(self, start: float, x: np.ndarray, time: float, channel: np.ndarray | None) -> np.ndarray:
        """Projected state at a time after an output, by a short integration from there."""
        if time <= start:
            return x
        z = self.outputs.unknowns(start, x, channel) if self.formulation.algebraic else np.zeros(0)
        p = np.r_[self.numeric.p, 0.0]
        reached = self._integrator(self.formulation).advance_once(x, z, start, time, p, channel)
        return self.outputs.projected(np.array([time]), reached[None, :])[0]

    # --- the end of a run that does not get to its end ----------------------------------------------
    def _interrupted(self) -> Interrupted:
        reached = self._record.last_time
        return Interrupted(
            f"stopped by the user at t = {reached:.6g} s; what was computed is in .partial",
            time=reached,
            partial=self._record.trajectory(),
        )

    def _failed(self, chunk: Chunk, failure: IntegrationFailure, times: np.ndarray, x: np.ndarray) -> SimulationError:
        reached, last = (float(times[-1]), x[-1]) if len(times) else (chunk.start, self._x)
        if failure.last is not None and failure.last_x is not None:
            reached, last = failure.last, failure.last_x
        ahead = 1e-3 * (chunk.times[-1] - chunk.start)
        cause = cause_of_failure(self.numeric, reached, *self.outputs.split(last[None, :]), failure.flag, ahead)
        return SimulationError(
            f"the simulation stopped at t = {reached:.6g} s: {cause}; what was computed is in .partial",
            time=reached,
            partial=self._record.trajectory(),
        )
