"""The stepper of a method that runs in code of its own over a whole piece, and looks inside its steps itself."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from ...arguments.inputs import Signals
from ...equations.numeric import NumericEquations
from ...errors import SimulationError, SingularityError
from ...integrators import Integrator
from ...integrators.compiled import MAX_STEPS, IntegrationFailure
from ...integrators.dop853.runner import ExplicitRunner
from ...integrators.native import build
from ...integrators.native.runner import Runner
from ...integrators.native.stretch import ExplicitSystem, Progress, Reached, Status, Stretch, Watched
from ...kinematics.singular import singular_pose
from ...numerics.console import Interruption
from ...numerics.lazy import cached_property
from ...results.state import State
from ..contact.watched_terms import watched_terms
from ..outputs import Outputs
from ..path import Path, StatesAt, states_from_start
from ..schedule import WATCH_POINTS, Piece
from ..singular.regularity import FALL
from ..stepper import PRECISE, Counts, Looks, SteppedSystem, Stepper, lending_of
from .explicit_system import explicit_system

#: Steps at the limit of stability from which a motion is too stiff, if more than an integrator may take are to come.
STIFF_STEPS = 1000
#: Steps that are still to come, as many as those since the last output lead to, from which a motion hardly proceeds.
NEVER_DONE = 1e8
#: Steps of the short way to an event or past a singular pose, at most.
WAY_STEPS = 20_000
#: Coefficient of a row in a combination of rows that vanishes, from which it takes part.
PART = 1e-3
#: In words, why the method stops.
FLAGS = {
    Status.PAUSED: f"the next {WAY_STEPS} steps lead no further",
    Status.TOO_SMALL: "the error test failed again and again at the smallest step",
    Status.NOT_FINITE: "the equations gave values that are not finite",
    Status.APART: "the constraints cannot be met together any more",
}


def refuse_redundant_rows(integrator: Integrator, numeric: NumericEquations, state: State) -> None:
    """Raise for a method that does not take rows that depend on each other at a state, with their names."""
    if integrator.whole_run is None:
        return
    pose = singular_pose(numeric, state.t, state.q, state.z)
    if pose is not None:
        raise SingularityError(
            f'method="{integrator.name}" cannot start at t = {state.t:.6g} s: the pose is singular, {pose.text}; '
            'use method="idas", or start from a pose nearby',
            time=state.t,
        )
    vanishing = np.abs(numeric.rank(state.t, state.q).null_rows)
    names = [numeric.eom.row_names[k] for k in np.flatnonzero(np.any(vanishing > PART, axis=0))]
    some = f"{', '.join(names[:6])}{' and others' if len(names) > 6 else ''}"
    raise SimulationError(
        f'method="{integrator.name}" needs constraints that do not depend on each other, and {some} do (see check); '
        'use method="idas", or remove the redundant rows'
    )


def runs_in_c(numeric: NumericEquations, signals: Signals, further: Sequence[ca.SX] = ()) -> bool:
    """Return True if DOP853 may run: there is a C compiler, and equations and further expressions are written as C.

    Parameters
    ----------
    further : sequence of casadi.SX
        Events or outputs.
    """
    eom = numeric.eom
    try:
        system = explicit_system(numeric, signals, watched_terms(eom))  # that of a simulation, which is made once
        runner = ExplicitRunner(system, None, eom.mechanism.cache)
        for expression in further:
            if eom.contains(expression):  # an event of another mechanism is not evaluated here
                runner.code_of(eom.function(expression))
    except SimulationError:
        return False
    return True


class WholeStepper(Stepper):
    """Advances by a method that runs in code of its own.

    Parameters
    ----------
    looks : Looks
        What is looked at inside the steps.
    """

    looks_inside: ClassVar[bool] = True
    pieces: ClassVar[int] = 1

    def __init__(self, system: SteppedSystem, looks: Looks):
        super().__init__(system, looks)
        watch, decides, may_fold = looks
        self._longest = self.integrator.longest_step(self.max_step)
        self._watch, self._may_fold, self._spacing = watch, may_fold, system.span / WATCH_POINTS
        terms = watched_terms(self.numeric.eom)
        self._rates, self._keeps_samples = terms.size, bool(terms.owners)
        self._key: tuple[Any, ...] | None = None
        self._runner = self._borrowed(explicit_system(self.numeric, self.signals, terms), watch.watched(decides))
        self._progress = Progress()
        self._end: tuple[float, np.ndarray] | None = None
        self._last_start: float | None = None
        self._since_output = 0
        self._starts = self._steps = self._all_steps = 0
        self._is_stiff = False

    @cached_property
    def outputs(self) -> Outputs:
        return WholeOutputs(self.numeric, self.signals, self.levels, self._runner)

    @property
    def counts(self) -> Counts:
        return Counts(self._starts, self._steps, self._all_steps)

    @property
    def notes(self) -> list[str]:
        stiff = [
            'stability and not accuracy limited most steps of dop853: the motion is stiff, and method="idas" may be '
            "faster"
        ]
        return [self._runner.note, *(stiff if self._is_stiff else [])]

    def _borrowed(self, system: ExplicitSystem, watched: Watched | None) -> Runner:
        """What runs a system: kept for the mechanism and lent to this run alone; a new one if there are events."""
        made_by, cache, compiles = self.integrator.whole_run, self.numeric.eom.mechanism.cache, self.integrator.jit
        assert made_by is not None
        make = partial(made_by, system, watched, cache, compiles=compiles)
        if watched is not None:
            return make()
        self._key = made_by, system, compiles, build.compiler()
        runner: Runner = lending_of(self.numeric).borrow(self._key, make)
        runner.take_compiled()
        return runner

    def release(self) -> None:
        if self._key is not None:
            lending_of(self.numeric).give_back(self._key, self._runner)
            self._key = None

    # --- integrating -------------------------------------------------------------------------
    def _stretch(
        self, start: float, x: np.ndarray, times: np.ndarray, stops: np.ndarray, begins: np.ndarray, **settings: Any
    ) -> Stretch:
        """The task from a state on, with the inputs of the intervals that begin at some times."""
        settings = {"reltol": self.integrator.reltol, "abstol": self.integrator.abstol} | settings
        channels, p, weights = self.signals.columns_from(begins), self.numeric.p, self.numeric.projection_weights
        return Stretch(start, x, times, stops, channels, p, self.levels, weights, max_step=self._longest, **settings)

    def _of_piece(self, piece: Piece, x: np.ndarray) -> Stretch:
        start, times = piece.inside
        offset, band, side = self._watch.levels(x)
        return self._stretch(
            start,
            x,
            times,
            piece.stops,
            piece.begins,
            most_steps=min(self._runner.slice, MAX_STEPS // 2),
            every_step=bool(offset.size or self._rates or self._may_fold),
            keep_samples=self._keeps_samples,
            spacing=self._spacing if offset.size or self._keeps_samples else np.inf,
            offset=offset,
            band=band,
            side=side,
            fall=FALL if self._may_fold else 0.0,
            stiff_after=0 if self._is_stiff else STIFF_STEPS,
        )

    def advance(
        self,
        piece: Piece,
        x: np.ndarray,
        interruption: Interruption,
        comes_near: Callable[[Path], bool] | None = None,
        stopped: IntegrationFailure | None = None,
    ) -> Path:
        goes_on = self._end is not None and self._end[0] == piece.start and np.array_equal(self._end[1], x)
        again = self._last_start == piece.start
        if not goes_on:
            self._progress = Progress(regularity=self._progress.regularity)
            self._since_output = 0
            self._starts += 1
        self._last_start = piece.start
        reached = self._runner.advance(self._of_piece(piece, x), self._progress)
        self._steps = reached.steps
        self._all_steps += reached.steps
        if interruption.requested:
            raise KeyboardInterrupt
        if reached.status == Status.STIFF:
            self._refuse_stiffness(piece, reached)
        if not reached.times.size:
            raise IntegrationFailure(FLAGS[reached.status], np.zeros((0, x.size)), np.zeros((0, 0)), piece.start, x)
        self._refuse_to_creep(piece, reached)
        times = reached.times
        if piece.starts_at_jump or piece.ends_at_jump:  # outputs that were some roundings off these
            times = np.where(reached.index >= 0, piece.times[reached.index], times)
        self._end = float(times[-1]), reached.x[-1].copy()
        if again:  # it was sent back to meet something with care
            self._progress.step = 0.0
        increments = np.diff(reached.integrals, axis=0, prepend=0.0) if self._rates else reached.integrals
        return Path(
            np.concatenate([[piece.start], times]),
            np.concatenate([x[None], reached.x]),
            increments,
            of_steps=True,
            is_regular=not self._may_fold or reached.least_regularity > FALL * self._progress.regularity,
        )

    def _refuse_stiffness(self, piece: Piece, reached: Reached) -> None:
        """Raise if stability asks for far too many steps over what is left; else take note."""
        time = float(reached.times[-1])
        coming = (float(piece.times[-1]) - time) / max(self._progress.step, 1e-300)
        if coming > MAX_STEPS:
            raise SimulationError(
                f'the motion is too stiff for method="{self.integrator.name}" at t = {time:.6g} s: stability asks for '
                f'steps of {self._progress.step:.2g} s, {coming:.2g} of them to the end; use method="idas" or '
                '"rosenbrock"; what was computed is in .partial',
                time=time,
            )
        self._is_stiff = True

    def _refuse_to_creep(self, piece: Piece, reached: Reached) -> None:
        """Raise if very many steps led no further, as where a force turns against the motion on either side."""
        self._since_output = reached.steps if np.any(reached.index >= 0) else self._since_output + reached.steps
        if reached.status not in (Status.PAUSED, Status.FULL) or self._since_output <= MAX_STEPS:
            return
        time, end = float(reached.times[-1]), float(piece.times[-1])
        if (end - time) * reached.steps > NEVER_DONE * (time - piece.start):
            n = reached.x.shape[1]
            raise IntegrationFailure("IDA_TOO_MUCH_WORK", np.zeros((0, n)), np.zeros((0, 0)), time, reached.x[-1])

    def unprojected(self, start: float, x: np.ndarray, times: np.ndarray) -> np.ndarray:
        return self.states_from(start, x)(times)  # every step ends on the constraints

    def states_from(self, start: float, x: np.ndarray, *, precise: bool = False) -> StatesAt:
        reltol, abstol = PRECISE if precise else self.integrator.tolerances
        offset, band, side = self._watch.levels(x)

        def integrated(times: np.ndarray) -> np.ndarray:
            state, now = x, start
            rows: list[np.ndarray] = []
            while len(rows) < times.size:
                left = times[len(rows) :]
                stretch = self._stretch(
                    now,
                    state,
                    left,
                    np.ones(left.size, bool),
                    np.full(left.size, start),
                    reltol=reltol,
                    abstol=abstol,
                    most_steps=WAY_STEPS,
                    offset=offset,
                    band=np.full(band.size, np.inf),  # no event counts on this way
                    side=np.ones(side.size),
                )
                reached = self._runner.advance(stretch, Progress())
                if not reached.times.size or reached.status.is_failure or reached.status == Status.PAUSED:
                    raise IntegrationFailure(
                        FLAGS.get(reached.status, ""), np.zeros((0, x.size)), np.zeros((0, 0)), now, state
                    )
                rows += list(reached.x[reached.index >= 0])
                now, state = float(reached.times[-1]), reached.x[-1]
            return np.array(rows)

        return states_from_start(start, x, integrated)


class WholeOutputs(Outputs):
    """Outputs whose accelerations, multipliers and inputs come from the method's own code."""

    def __init__(self, numeric: NumericEquations, signals: Signals, levels: np.ndarray, runner: Runner):
        super().__init__(numeric, signals, levels, redundant=False)
        self._runner = runner

    def block(self, times: np.ndarray, x: np.ndarray, since: np.ndarray | None = None) -> tuple[np.ndarray, ...]:
        q, v, z = self.split(x)
        columns = self.signals.columns_from(times if since is None else since)
        a, lam, u = self._runner.run.complete(times, x, columns, self.numeric.p, self._levels)
        return times, q, v, a, z, lam, u
