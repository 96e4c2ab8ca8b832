"""One run of a simulation: chunks, projection, events, and what happens when it stops."""

from __future__ import annotations

import time as clock
from typing import Any

import casadi as ca
import numpy as np

from ..equations.numeric import NumericEquations
from ..equations.recovery import Recovery
from ..errors import Interrupted, SimulationError
from ..numerics.console import interruptible
from ..numerics.integration import FEW_STEPS, MAX_STEPS, IntegrationFailure, Integrator
from ..numerics.least_squares import largest
from ..results.state import State
from ..results.trajectory import EventOccurrence, Trajectory
from .causes import cause_of_failure
from .event_location import EventWatch
from .formulations import Formulation, choose
from .inputs import Signals
from .record import Record
from .schedule import Chunk, chunks_of
from .stiffness import is_stiff

#: Fall of the smallest pivot of ``Phi_q M⁻¹ Phi_q^T``, relative to the largest one seen, at which the regularised
#: form takes over for the rest of a run: the mechanism passes near a singular pose.
NEARLY_SINGULAR = 0.02
#: Decay of drift in the regularised form: so many times in a chunk, and for each radian that a body turns.
DECAY, DECAY_PER_RADIAN = 20.0, 5.0


class Run:
    """A simulation that is being run.

    Parameters
    ----------
    numeric : NumericEquations
        Equations at the parameters of the run.
    signals : Signals
        Inputs.
    watch : EventWatch
        Events.
    method, reltol, abstol, jit, progress, options
        As for :func:`simulate`.
    """

    def __init__(
        self,
        numeric: NumericEquations,
        signals: Signals,
        watch: EventWatch,
        method: str,
        reltol: float,
        abstol: float,
        *,
        jit: bool = False,
        progress: bool = False,
        options: dict[str, Any] | None = None,
    ):
        self.numeric, self.signals, self.watch = numeric, signals, watch
        self.method = method
        self._settings = (reltol, abstol)
        self._jit, self._progress, self._options = jit, progress, options or {}
        self._integrators: dict[Formulation, Integrator] = {}
        self._recoveries: dict[bool, Recovery] = {}
        eom = numeric.eom
        self._inputs = ca.Function(
            "inputs", [eom.t, eom.q, eom.v, eom.z, eom.p, signals.channel], [ca.densify(signals.expressions)]
        )
        self._held = numeric.eom.input_values.copy()
        self._regular = 0.0

    # --- the loop ------------------------------------------------------------------------
    def over(self, grid: np.ndarray, start: State) -> Trajectory:
        """Run over an output grid from a consistent start."""
        began = clock.perf_counter()
        eom = self.numeric.eom
        redundant = self.numeric.rank(start.t, start.q).rank < eom.lam.numel()
        _ = start[eom.a]  # raises where there are no accelerations: mass is missing, or the pose is singular
        if self.method == "auto":
            self.method = "idas" if eom.Q_depends_on_lam or is_stiff(self.numeric, start, grid, redundant) else "erk"
        self.formulation = choose(self.numeric, self.method, redundant=redundant)
        rule = None if self.signals.is_sampled else self._rule
        record = Record(eom.mechanism, self.numeric.p, self._recovery(redundant).refine(rule))
        self._statistics = record.statistics
        record.statistics.method = self.method
        record.statistics.formulation = self.formulation.name
        if redundant:
            record.statistics.notes.append(
                "the constraints are redundant: multipliers and reactions are those of least norm"
            )
        self._grid = grid
        self._hold(start)
        self._x = np.r_[start.q, start.v, start.z]
        self._z = np.r_[start.a, start.lam]
        self._add(record, np.array([start.t]), self._x[None, :], self._held_channel(start.t))
        with interruptible() as interruption:
            self._interruption = interruption
            try:
                self._chunks(record, chunks_of(grid, period=self._period, fine=bool(self.watch.events)))
            except KeyboardInterrupt:
                raise self._interrupted(record) from None
            except SimulationError:
                if interruption.requested:
                    raise self._interrupted(record) from None
                raise
            finally:
                record.statistics.seconds = clock.perf_counter() - began
                record.statistics.restarts = sum(i.starts for i in self._integrators.values())
        return record.trajectory()

    @property
    def _period(self) -> float | None:
        return self.signals.controller.period if self.signals.controller else None

    def _interrupted(self, record: Record) -> Interrupted:
        reached = record.last_time
        return Interrupted(
            f"stopped by the user at t = {reached:.6g} s; what was computed is in .partial",
            time=reached,
            partial=record.trajectory(),
        )

    def _chunks(self, record: Record, chunks: list[Chunk]) -> None:
        for chunk in _with_progress(chunks, self._progress):
            if self.signals.controller:
                self._ask_controller(record, chunk.start)
            if self._one_chunk(record, chunk):
                return

    def _one_chunk(self, record: Record, chunk: Chunk) -> bool:
        """Advance by a chunk; True where a terminal event ended the run."""
        channel = self._channel(chunk)
        try:
            x = self._advance(chunk, channel)
            failure = None
        except IntegrationFailure as stopped:
            x, failure = stopped.x, stopped
        times, wanted = chunk.times[: len(x)], chunk.wanted[: len(x)]
        x = self._projected(times, x)
        if failure is None and self._turns_singular():
            return self._one_chunk(record, chunk)
        ended = False
        if self.watch.events and len(x):
            times, wanted, x, ended = self._look_for_events(record, chunk, times, wanted, x, channel)
        if np.any(wanted):
            columns = None if channel is None else channel[:, : len(times)][:, wanted]
            self._add(record, times[wanted], x[wanted], columns)
        if failure is not None and not ended:
            raise self._failed(record, chunk, failure, times, x)
        if not ended:
            self._feed_back(float(times[-1]), x[-1], None if channel is None else channel[:, -1:])
        return ended

    # --- integrating -------------------------------------------------------------------------
    def _integrator(self, form: Formulation) -> Integrator:
        if form not in self._integrators:
            dae = form.dae(self.numeric, self.signals)
            self._integrators[form] = Integrator(
                dae, self.method, *self._settings, jit=self._jit, options=self._options
            )
        return self._integrators[form]

    def _advance(self, chunk: Chunk, channel: np.ndarray | None) -> np.ndarray:
        """States at the outputs of a chunk.

        Where the usual form fails the regularised one is tried, which passes
        singular poses; then the usual one with all the steps it may take.
        """
        usual, flag = self.formulation, ""
        attempts = [(usual, FEW_STEPS), (usual, MAX_STEPS)]
        if usual.name != "regularised" and not self.numeric.eom.Q_depends_on_lam:
            attempts.insert(1, (Formulation("regularised"), FEW_STEPS))
        for k, (form, steps) in enumerate(attempts):
            if k > 0 and form == usual and flag != "IDA_TOO_MUCH_WORK":
                break
            integrator = self._integrator(form)
            try:
                p = self._parameters(chunk)
                return integrator.advance(*self._begin(form, chunk), chunk.times, p, channel, steps)[0]
            except IntegrationFailure as failure:
                if self._interruption.requested:  # inside an integrator Ctrl-C comes back as a failure like others
                    raise KeyboardInterrupt from None
                flag = failure.flag if form == usual else flag
        x, z, start = self._begin(usual, chunk)
        raise self._integrator(usual).rescue(flag, x, z, start, chunk.times, self._parameters(chunk), channel)

    def _begin(self, form: Formulation, chunk: Chunk) -> tuple[np.ndarray, np.ndarray, float]:
        return self._x, self._z if form.algebraic else np.zeros(0), chunk.start

    def _parameters(self, chunk: Chunk) -> np.ndarray:
        """Parameters of the integrator: those of the model, and the rate at which drift decays."""
        n = self.numeric.eom.q.numel()
        turning = self._x[n + 2 : n + 3 * len(self.numeric.eom.mechanism.bodies) : 3]
        rate = max(DECAY / (chunk.times[-1] - chunk.start), DECAY_PER_RADIAN * largest(turning))
        return np.r_[self.numeric.p, rate]

    def _turns_singular(self) -> bool:
        """Change to the regularised form where the poses of a chunk come near to a singular one."""
        regularity = self._recovery(self.formulation.redundant).regularity
        self._regular = max(self._regular, float(np.max(regularity, initial=0.0)))
        near = float(np.min(regularity, initial=np.inf)) < NEARLY_SINGULAR * self._regular
        if not near or self.formulation.name == "regularised" or self.numeric.eom.Q_depends_on_lam:
            return False
        self.formulation = Formulation("regularised")
        self._statistics.notes.append("the motion comes near a singular pose: the regularised form is used from there on")
        return True

    def _recovery(self, redundant: bool) -> Recovery:
        if redundant not in self._recoveries:
            self._recoveries[redundant] = Recovery(self.numeric, redundant=redundant)
        return self._recoveries[redundant]

    def _split(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        n = self.numeric.eom.q.numel()
        return x[:, :n], x[:, n : 2 * n], x[:, 2 * n :]

    def _projected(self, times: np.ndarray, x: np.ndarray) -> np.ndarray:
        q, v, z = self._split(x)
        recovery = self._recovery(self.formulation.redundant)
        q = recovery.positions(times, q)
        return np.hstack([q, recovery.velocities(times, q, v), z])

    def _rule(self, t: np.ndarray, q: np.ndarray, v: np.ndarray, z: np.ndarray, _u: np.ndarray) -> np.ndarray:
        return self._input_values(t, np.hstack([q, v, z]), None)

    def _input_values(self, times: np.ndarray, x: np.ndarray, channel: np.ndarray | None) -> np.ndarray:
        q, v, z = self._split(x)
        given = np.zeros(0) if channel is None else channel
        values = self._inputs(times[None, :], q.T, v.T, z.T, self.numeric.p, given).full().T
        return np.broadcast_to(values, (times.size, values.shape[1]))

    def _add(self, record: Record, times: np.ndarray, x: np.ndarray, channel: np.ndarray | None) -> None:
        q, v, z = self._split(x)
        u = self._input_values(times, x, channel)
        a, lam = self._recovery(self.formulation.redundant).accelerations(times, q, v, z, u)
        record.add(times, q, v, a, z, lam, u)

    def _feed_back(self, time: float, x: np.ndarray, channel: np.ndarray | None) -> None:
        """Start the next chunk from the projected end of this one, in the form that suits the pose there."""
        self._x = x
        q, v, z = self._split(x[None, :])
        if self.formulation.algebraic:
            u = self._input_values(np.array([time]), x[None, :], channel)
            a, lam = self._recovery(self.formulation.redundant).accelerations(np.array([time]), q, v, z, u)
            self._z = np.r_[a[0], lam[0]]

    # --- inputs by interval --------------------------------------------------------------------
    def _channel(self, chunk: Chunk) -> np.ndarray | None:
        """Values of the sampled inputs by interval of a chunk (channel, k)."""
        if not self.signals.is_sampled:
            return None
        begins = np.r_[chunk.start, chunk.times[:-1]]
        if self.signals.controller:
            held = np.tile(self._held[:, None], (1, begins.size))
            return np.vstack([held, begins])
        table = self.signals.channel_values(self._grid, self._held)
        interval = np.clip(
            np.searchsorted(self._grid, begins + 1e-12 * self._grid[-1], side="right") - 1, 0, table.shape[1] - 1
        )
        return table[:, interval]

    def _held_channel(self, time: float) -> np.ndarray | None:
        return None if not self.signals.is_sampled else self._channel(Chunk(time, np.array([time]), np.array([True])))

    def _hold(self, start: State) -> None:
        if self.signals.controller:
            self._held = self._answer(start)

    def _ask_controller(self, record: Record, time: float) -> None:
        q, v, z = (part[0] for part in self._split(self._x[None, :]))
        eom = self.numeric.eom
        u = self._held
        a, lam = self._recovery(self.formulation.redundant).accelerations(
            np.array([time]), q[None, :], v[None, :], z[None, :], u[None, :]
        )
        self._held = self._answer(State(eom.mechanism, time, q, v, a[0], z, lam[0], u, self.numeric.p))

    def _answer(self, state: State) -> np.ndarray:
        """What the controller returns, checked."""
        from .mappings import pairs_of, position_in

        inputs = self.numeric.eom.mechanism.inputs
        values = self.numeric.eom.input_values.copy()
        assert self.signals.controller is not None
        answer = self.signals.controller.function(state.t, state)
        for key, value in pairs_of(answer, "the controller's answer"):
            k = position_in(inputs, key, "the controller's answer")
            values[k] = float(value)
            if not np.isfinite(values[k]):
                raise SimulationError(
                    f"the controller gives {values[k]} for input '{inputs[k].label}' at t = {state.t:.6g} s"
                )
        return values

    @property
    def _event_parameters(self) -> np.ndarray:
        return np.r_[self.numeric.p, 0.0]

    # --- events ---------------------------------------------------------------------------------
    def _watched(self, times: np.ndarray, x: np.ndarray, channel: np.ndarray | None) -> np.ndarray:
        q, v, z = self._split(x)
        u = self._input_values(times, x, channel)
        a, lam = self._recovery(self.formulation.redundant).accelerations(times, q, v, z, u)
        return self.watch.values([times[:, None], q, v, a, z, lam, u, self.numeric.p])

    def _look_for_events(
        self,
        record: Record,
        chunk: Chunk,
        times: np.ndarray,
        wanted: np.ndarray,
        x: np.ndarray,
        channel: np.ndarray | None,
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, bool]:
        """Locate events among the outputs of a chunk; a terminal one cuts them off."""
        knots, states = np.r_[chunk.start, times], np.vstack([self._x, x])
        columns = None if channel is None else np.hstack([channel[:, :1], channel[:, : len(times)]])
        values = self._watched(knots, states, columns)
        for k in range(len(times)):
            found = []
            column = None if channel is None else channel[:, k : k + 1]
            for index in self.watch.crossings(values[k], values[k + 1]):
                at = self._located(index, knots[k], knots[k + 1], states[k], values[k : k + 2, index], column)
                found.append((at, index))
            for at, index in sorted(found):
                event = self.watch.events[index]
                state = self._state_at(knots[k], at, states[k], column)
                record.events.append(EventOccurrence(event.name, at, self._as_state(at, state, column)))
                if event.terminal:
                    cut_times, cut_x = np.r_[times[:k], at], np.vstack([x[:k], state])
                    return cut_times, np.r_[wanted[:k], True], cut_x, True
        return times, wanted, x, False

    def _located(self, index: int, low: float, high: float, x: np.ndarray, ends: np.ndarray, channel: Any) -> float:
        def value_at(time: float) -> np.ndarray:
            return self._watched(np.array([time]), self._state_at(low, time, x, channel)[None, :], channel)[0]

        return self.watch.locate(index, low, high, float(ends[0]), float(ends[1]), value_at)

    def _state_at(self, low: float, time: float, x: np.ndarray, channel: np.ndarray | None) -> np.ndarray:
        """Projected state at a time after an output, by a short integration from there."""
        if time <= low:
            return x
        z = np.zeros(0)
        if self.formulation.algebraic:
            q, v, first = self._split(x[None, :])
            u = self._input_values(np.array([low]), x[None, :], channel)
            a, lam = self._recovery(self.formulation.redundant).accelerations(np.array([low]), q, v, first, u)
            z = np.r_[a[0], lam[0]]
        reached = self._integrator(self.formulation).advance_once(x, z, low, time, self._event_parameters, channel)
        return self._projected(np.array([time]), reached[None, :])[0]

    def _as_state(self, time: float, x: np.ndarray, channel: np.ndarray | None) -> State:
        at = np.array([time])
        q, v, z = self._split(x[None, :])
        u = self._input_values(at, x[None, :], channel)
        a, lam = self._recovery(self.formulation.redundant).accelerations(at, q, v, z, u)
        return State(self.numeric.eom.mechanism, time, q[0], v[0], a[0], z[0], lam[0], u[0], self.numeric.p)

    # --- failure -----------------------------------------------------------------------------------
    def _failed(
        self, record: Record, chunk: Chunk, failure: IntegrationFailure, times: np.ndarray, x: np.ndarray
    ) -> SimulationError:
        reached, last = (float(times[-1]), x[-1]) if len(times) else (chunk.start, self._x)
        cause = cause_of_failure(self.numeric, reached, *self._split(last[None, :]), failure.flag)
        return SimulationError(
            f"the simulation stopped after t = {reached:.6g} s: {cause}; what was computed is in .partial",
            time=reached,
            partial=record.trajectory(),
        )


def _with_progress(chunks: list[Chunk], show: bool) -> Any:
    """Chunks, with a bar that counts simulated seconds."""
    if not show:
        yield from chunks
        return
    from tqdm.auto import tqdm

    total = chunks[-1].times[-1] - chunks[0].start
    with tqdm(total=round(float(total), 6), unit="s", desc="simulate", bar_format=_BAR) as bar:
        for chunk in chunks:
            yield chunk
            bar.update(round(float(chunk.times[-1] - chunk.start), 6))


_BAR = "{desc}: {percentage:3.0f}%|{bar}| {n:.3g} of {total:.3g} s [{elapsed}<{remaining}]"
