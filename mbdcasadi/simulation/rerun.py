"""Parts of a run that are integrated again, when somebody asks for its motion between the outputs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from ..assembly.setup import Setup
from ..integrators import Integrator
from ..model.events import Event
from ..model.mechanism import Mechanism
from ..numerics.console import Interruption, interruptible
from ..numerics.lazy import cached_property
from ..results.state import Arrays, State
from ..results.steps import Continuation, Interpolation, Places, Refined, Spans, States, Stretch
from ..results.trajectory import Trajectory
from .changes.modes import Block, Modes
from .outputs import Outputs
from .trajectory_builder import Span


class Repeatable(Protocol):
    """What of a run is needed to integrate it again; see :class:`Run`."""

    setup: Setup
    modes: Modes
    integrator: Integrator
    redundant: bool

    @property
    def breaks(self) -> np.ndarray: ...

    def parted(self) -> Repeatable: ...

    def again(self, modes: Modes, start: Stretch, interruption: Interruption) -> Block: ...

    def release(self) -> None: ...


class _HeldMode(Modes):
    """One mode of others, which is not left."""

    def __init__(self, modes: Modes, mode: Any):
        super().__init__(modes.setup)
        self._modes, self.mode, self.mechanism = modes, mode, modes.variant(mode)

    @property
    def free(self) -> Any:
        return self.mode

    def variant(self, mode: Any) -> Mechanism:
        return self._modes.variant(mode)

    def numeric(self, mode: Any) -> Any:
        return self._modes.numeric(mode)

    def decided(self, state: State, events: Sequence[Event] = (), before: Any = None) -> tuple[Any, State]:
        return self.mode, state


class ModePart(NamedTuple):
    """A part of a motion in one mode: its state at the start and at the end, in the mechanism of that mode.

    The breaks are times at which inputs or equations change, s.
    """

    modes: Modes
    mode: Any
    motion: Trajectory
    breaks: np.ndarray


class RunAgain(Continuation):
    """A run that goes on from any of its states, without its events: these have been found.

    Parameters
    ----------
    run : Run
        The run.
    spans : sequence of Span
        Its parts between which it jumps, or changes its equations.
    t : numpy.ndarray
        Times of its outputs, s.
    arrays : tuple of numpy.ndarray
        ``q, v, a, z, lam, u`` there.
    """

    def __init__(self, run: Repeatable, spans: Sequence[Span], t: np.ndarray, arrays: Arrays):
        self._run, self._spans, self._t, self._arrays = run.parted(), spans, t, arrays
        self.reltol, self.abstol = run.integrator.tolerances
        self._whole, self._modes = run.modes, dict[Any, _HeldMode]()
        self._outputs: dict[Any, Outputs] = {}

    @cached_property
    def size(self) -> np.ndarray:  # type: ignore[override]
        return self._whole.numeric(self._whole.free).scale.coordinates

    @cached_property
    def breaks(self) -> np.ndarray:  # type: ignore[override]
        return self._run.breaks

    @cached_property
    def _levels(self) -> np.ndarray:
        return np.array([span.levels for span in self._spans]).reshape(len(self._spans), -1)

    def spans(self) -> Spans:
        n = self._arrays[0].shape[1]
        rows = np.hstack([self._arrays[0], self._arrays[1], self._arrays[3]])
        numbers, times, states = [], [], []
        reached = self._t[0]
        for k, span in enumerate(self._spans):
            last = self._spans[k + 1].first if k + 1 < len(self._spans) else self._t.size
            t, x = self._t[span.first : last], rows[span.first : last]
            if not t.size or t[0] > span.start:
                t, x = np.r_[span.start, t], np.vstack([span.x, x])
            if span.end is not None and span.last is not None and t[-1] < span.end:
                t, x = np.r_[t, span.end], np.vstack([x, span.last])
            t = np.maximum(t, reached)  # an output at an event comes before it, by rounding beyond it
            reached = t[-1]
            numbers.append(np.full(t.size, k))
            times.append(t)
            states.append(x)
        whole = np.vstack(states)
        return Spans(np.concatenate(numbers), np.concatenate(times), States(*np.split(whole, [n, 2 * n], axis=1)))

    def by_mode(self) -> list[ModePart]:
        spans, parts = self.spans(), list[ModePart]()
        for k, span in enumerate(self._spans):
            rows = np.flatnonzero(spans.number == k)[[0, -1]]
            since = np.full(2, spans.t[rows[0]])
            places = Places(np.full(2, k), spans.t[rows], since)
            t, q, v, a, z, lam, u = self._block(span.mode, places, spans.states.at(rows))
            mechanism, p = self._whole.variant(span.mode), self._outputs_in(span.mode).numeric.p
            parts.append(ModePart(self._whole, span.mode, Trajectory(mechanism, t, q, v, a, z, lam, u, p), self.breaks))
        return parts

    # --- equations -------------------------------------------------------------------------------
    def _outputs_in(self, mode: Any) -> Outputs:
        if mode not in self._outputs:
            run = self._run
            self._outputs[mode] = Outputs(
                self._whole.numeric(mode), run.setup.signals, self._whole.levels, redundant=run.redundant
            )
        return self._outputs[mode]

    def _block(self, mode: Any, places: Places, states: States) -> Block:
        """``t, q, v, a, z, lam, u`` in a mode at states."""
        outputs, signals = self._outputs_in(mode), self._run.setup.signals
        (q, v, z), (span, t, since), numeric = states, places, outputs.numeric
        channel, levels = signals.channel_from(since), self._levels[span]
        u = signals.values(t, q, v, z, numeric.p, numeric.eom, levels=levels, channel=channel)
        a, lam = outputs.recovery.accelerations(t, q, v, z, u)
        return t, q, v, a, z, lam, u

    def _by_mode(self, places: Places) -> list[tuple[Any, np.ndarray]]:
        """Modes with the rows in them."""
        rows: dict[Any, list[int]] = {}
        if not places.span.size:
            return []
        for k in np.unique(places.span).tolist():
            rows.setdefault(self._spans[k].mode, []).append(k)
        return [(mode, np.flatnonzero(np.isin(places.span, numbers))) for mode, numbers in rows.items()]

    def rates(self, places: Places, states: States) -> tuple[np.ndarray, np.ndarray]:
        a, rates = np.zeros_like(states.v), np.zeros_like(states.z)
        for mode, rows in self._by_mode(places):
            t, q, v, here, z, lam, u = self._block(mode, Places(*(x[rows] for x in places)), states.at(rows))
            a[rows] = here
            eom = self._outputs_in(mode).numeric.eom
            if eom.z_rate.numel():
                p = self._outputs_in(mode).numeric.p[:, None]
                rates[rows] = eom.function(eom.z_rate)(t[None], q.T, v.T, here.T, z.T, lam.T, u.T, p).full().T
        return a, rates

    def on_constraints(self, places: Places, states: States) -> States:
        q, v = np.zeros_like(states.q), np.zeros_like(states.v)
        for mode, rows in self._by_mode(places):
            recovery, t, z = self._outputs_in(mode).recovery, places.t[rows], states.z[rows]
            q[rows] = recovery.positions(t, states.q[rows], z)
            v[rows] = recovery.velocities(t, q[rows], states.v[rows], z)
        return States(q, v, states.z)

    def complete(self, places: Places, states: States) -> Arrays:
        found: list[tuple[np.ndarray, ...]] = []
        states = self.on_constraints(places, states)
        for mode, rows in self._by_mode(places):
            some = Places(*(x[rows] for x in places))
            block = self._whole.whole_block(mode, self._block(mode, some, states.at(rows)))
            found.append((rows, *block[1:]))
        rows, *columns = (np.concatenate(parts) for parts in zip(*found, strict=True))
        order = np.argsort(rows)
        q, v, a, z, lam, u = (column[order] for column in columns)
        return q, v, a, z, lam, u

    # --- integrating -------------------------------------------------------------------------------
    def again(self, stretches: Sequence[Stretch]) -> list[States]:
        run, results = self._run, []
        with interruptible() as interruption:
            try:
                for stretch in stretches:
                    results.append(self._states(run, stretch, interruption))
            finally:
                run.release()
        return results

    def _states(self, run: Repeatable, stretch: Stretch, interruption: Interruption) -> States:
        span = self._spans[stretch.span]
        if span.mode not in self._modes:
            self._modes[span.mode] = _HeldMode(self._whole, span.mode)
        modes = self._modes[span.mode]
        modes.levels[:] = span.levels
        t, q, v, _, z, _, _ = run.again(modes, stretch, interruption)
        rows = np.searchsorted(t, stretch.times[stretch.times <= t[-1]])
        return States(q[rows], v[rows], z[rows])


def interpolation_of(run: Repeatable, spans: Sequence[Span], t: np.ndarray, arrays: Arrays) -> Interpolation:
    """Return the motion between the outputs of a run."""
    return Refined(RunAgain(run, spans, t, arrays), t, arrays)
