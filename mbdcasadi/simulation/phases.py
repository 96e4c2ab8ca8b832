"""A run through several mechanisms: one run in each, and the changes at events between them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np

from ..arguments.inputs import SampledController
from ..arguments.values import mapping_of, pairs_of, pairs_with, parameter_vector, position_in
from ..assembly.consistent_start import carried_by
from ..assembly.impact import pose_and_jump
from ..assembly.setup import Setup
from ..equations import equations
from ..equations.impact_law import ImpactLaw
from ..errors import MechanismError, ModelError, SimulationError
from ..integrators import Integrator
from ..model.events import Event
from ..model.mechanism import Mechanism
from ..model.symbols import StateVariable, place_of
from ..numerics.least_squares import largest
from ..numerics.tolerances import NEGLIGIBLE
from ..results.phases import PhasedTrajectory, in_whole, union_of
from ..results.state import EventOccurrence, State
from ..results.trajectory import Statistics, Trajectory
from .changes.events import Accumulation, EventWatch
from .changes.modes import Modes
from .changes.transitions import SWITCHES
from .loop import Run

#: Remedy for changes that take place ever faster.
HOLDING = "let it become a mechanism in which the joint holds, or model the contact by a force (Contact, EndStop)"


class _ControllerOfWhole(SampledController):
    """A controller of the whole run that answers for one of its mechanisms."""

    def __init__(self, function: Callable[[float, State], Any], whole: SampledController):
        super().__init__(function, whole.period)
        self._whole = whole

    @property
    def status(self) -> int | None:
        return self._whole.status

    def meaning(self, status: int) -> str:
        return self._whole.meaning(status)


class PhasedRun:
    """A simulation through mechanisms that follow each other at events.

    Parameters
    ----------
    mechanism : Mechanism
        Mechanism at the start.
    events : sequence of Event
        Events of the user; those with ``becomes`` change the mechanism.
    modes_of : callable
        ``modes_of(setup, events)`` gives the modes of a mechanism.
    integrator_of : callable
        ``integrator_of(modes)`` gives the integrator for it.
    values : mapping
        `times`, `duration`, `initial`, `inputs` and `parameters` as :func:`simulate` takes them.

    Attributes
    ----------
    runs : list of Run
        Runs in one mechanism each.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        events: Sequence[Event],
        modes_of: Callable[[Setup, Sequence[Event]], Modes],
        integrator_of: Callable[[Modes], Integrator],
        values: dict[str, Any],
        *,
        progress: bool = False,
    ):
        self.events, self._modes_of, self._integrator_of = tuple(events), modes_of, integrator_of
        self._progress = progress
        self.mechanisms = list(dict.fromkeys([mechanism, *(e.becomes for e in events if e.becomes is not None)]))
        self.whole = union_of(self.mechanisms)
        self._refuse_unwatched()
        self._inputs = values["inputs"]
        carried = carried_by(values["initial"], self.whole)["parameters"]
        given = carried | mapping_of(values["parameters"], "parameters=")
        self._p = parameter_vector(equations(self.whole), given)
        self._check_inputs()
        self._first = self._setup(mechanism, values)
        self.runs: list[Run] = []
        self._kept: dict[Any, Run] = {}
        self._accumulation = Accumulation(HOLDING)
        self._parts: list[Trajectory] = []
        self._values: list[np.ndarray] = []
        self._occurrences: list[EventOccurrence] = []
        self._notes: list[str] = []

    def _refuse_unwatched(self) -> None:
        for event in self.events:
            if not any(event.is_watched_in(mechanism) for mechanism in self.mechanisms):
                raise ModelError(
                    f"event '{event.name}' is looked for in none of the mechanisms of the run: none of them has all "
                    "its symbols, or during= leaves them out, or it is the one to which the event leads, which "
                    "during= has to name"
                )

    # --- what each mechanism is given ---------------------------------------------------------------
    def _check_inputs(self) -> None:
        if isinstance(self._inputs, SampledController) or hasattr(self._inputs, "inputs"):
            return
        for key, _ in pairs_of(self._inputs, "inputs="):
            position_in(self.whole.inputs, key, "inputs=")

    def _inputs_of(self, mechanism: Mechanism) -> Any:
        """Inputs that a mechanism has, of those that are given."""
        inputs = self._inputs
        if isinstance(inputs, SampledController):
            return _ControllerOfWhole(self._answer_of(inputs, mechanism), inputs)
        if hasattr(inputs, "inputs"):
            inputs = inputs.inputs
        return pairs_with(mechanism.inputs, pairs_of(inputs, "inputs="))

    def _answer_of(self, controller: SampledController, mechanism: Mechanism) -> Callable[[float, State], Any]:
        """A controller that sees the whole and answers for the inputs of a mechanism."""

        def function(time: float, state: State) -> Any:
            answer = controller.function(time, in_whole(state, self.whole, self._p))
            if answer is None:
                return None
            pairs = pairs_of(answer, "the controller's answer")
            for key, _ in pairs:
                position_in(self.whole.inputs, key, "the controller's answer")
            return pairs_with(mechanism.inputs, pairs)

        return function

    def _parameters_of(self, mechanism: Mechanism) -> list[tuple[Any, float]]:
        return pairs_with(mechanism.parameters, zip(self.whole.parameters, self._p.tolist(), strict=True))

    def _setup(self, mechanism: Mechanism, given: dict[str, Any]) -> Setup:
        """Setup of a mechanism at the present values of the parameters."""
        own = {"inputs": self._inputs_of(mechanism), "parameters": self._parameters_of(mechanism)}
        return Setup(mechanism, "simulate", **(given | own), takes_controller=True)

    def _run_in(self, mechanism: Mechanism) -> Run:
        """The run in a mechanism at the present values of the parameters, made once."""
        key = mechanism, tuple(value for _, value in self._parameters_of(mechanism))
        if key in self._kept:
            return self._kept[key]
        setup = self._first
        if mechanism is not setup.mechanism or self._kept:
            setup = self._setup(mechanism, {"times": self._first.grid})
        watched = [event for event in self.events if event.is_watched_in(mechanism)]
        modes = self._modes_of(setup, watched)
        run = Run(setup, modes, watched, self._integrator_of(modes), progress=self._progress)
        self._kept[key] = run
        self.runs.append(run)
        return run

    # --- the loop -----------------------------------------------------------------------------------
    def run(self) -> PhasedTrajectory:
        """Run through the mechanisms up to the end, or to an event that ends the run.

        Raises
        ------
        SimulationError
            If a run stops, or a change is not possible: ``.partial`` is the motion up to there.
        Interrupted
            On Ctrl-C, with ``.partial``.
        """
        try:
            run = self._run_in(self._first.mechanism)
            self._take(run.run())
            for _ in range(SWITCHES):
                if not run.changing:
                    return self._trajectory()
                run, ended = self._change(run)
                if ended:
                    return self._trajectory()
            raise SimulationError(
                f"the mechanism changed {SWITCHES} times; the motion chatters", time=self._parts[-1].t[-1]
            )
        except (MechanismError, KeyboardInterrupt) as error:
            partial = getattr(error, "partial", None)
            if isinstance(partial, Trajectory) and not isinstance(partial, PhasedTrajectory):
                self._take(partial)
            if self._parts and hasattr(error, "partial"):
                error.partial = self._trajectory()
            raise

    def _take(self, part: Trajectory) -> None:
        self._parts.append(part)
        self._values.append(self._p.copy())
        for event in part.events:
            after = None if event.after is None else in_whole(event.after, self.whole, self._p)
            state = in_whole(event.state, self.whole, self._p)
            self._occurrences.append(EventOccurrence(event.name, event.t, state, after))

    def _trajectory(self) -> PhasedTrajectory:
        parts = [part.statistics for part in self._parts]
        statistics = Statistics(
            parts[0].method,
            ", ".join(dict.fromkeys(s.formulation for s in parts if s.formulation)),
            sum(s.seconds for s in parts),
            sum(run.starts for run in self.runs),
            sum(run.steps for run in self.runs),
            list(dict.fromkeys(note for s in parts for note in s.notes)) + list(dict.fromkeys(self._notes)),
            [time for s in parts for time in s.control_times],
            [status for s in parts for status in s.control_statuses],
        )
        return PhasedTrajectory(self._parts, self.whole, self._values, events=self._occurrences, statistics=statistics)

    # --- changes ------------------------------------------------------------------------------------
    def _change(self, run: Run) -> tuple[Run, bool]:
        """Go on in the mechanism to which the events of an instant lead; True if the run ends there."""
        assert run.reached is not None
        before = in_whole(run.reached, self.whole, self._p)
        chain = self._chain(run.changing, run.reached, run.instant)
        self._accumulation.refuse(chain, before.t, run.instant)
        target = chain[-1].becomes
        assert target is not None
        self._set_parameters(chain, before)
        following = self._run_in(target)
        if following.setup.signals.controller is not None:
            self._carry_levels(run.modes, following.modes)
        entry, impulses = self._entry(chain, before, following)
        ended = run.stops or any(event.terminal for event in chain)
        just_before = {event.name for event in self._parts[-1].events if abs(event.t - before.t) <= run.instant}
        passed = [*chain, *(event for event in self.events if event.name in just_before)]
        part = following.only_start(entry) if ended else following.run(entry, passed)
        first = part.initial
        after = in_whole(State(target, *first.arguments, first.obstacle, impulses), self.whole, self._p)
        self._occurrences += [EventOccurrence(event.name, before.t, before, after) for event in chain]
        self._take(part)
        if not ended:
            self._refuse_pressed_through(following, after)
        return following, ended

    def _chain(self, located: Sequence[Event], state: State, instant: float) -> list[Event]:
        """Events of one instant in an order in which each one is looked for in the mechanism of the one before.

        All joints that close at an instant close in one impact. An event that waits for an expression by which the
        mechanism has just been reached waits for its next zero, as the second impact of a ball.
        """
        eom = state.equations
        known = [e for e in self.events if e.becomes is not None and eom.contains(e.expression)]
        driven = EventWatch(eom, known, instant).driven_through(state)
        others = [e for e in known if e in driven or e in located]
        chains = []
        for first in located:
            chain = [first]
            while True:
                here = chain[-1].becomes
                assert here is not None
                waiting = (e for e in others if e not in chain and e.is_watched_in(here))
                following = next((e for e in waiting if not _is_used(e, chain, located, state)), None)
                if following is None:
                    break
                chain.append(following)
            chains.append(chain)
        ends = list(dict.fromkeys(chain[-1].becomes for chain in chains))
        if len(ends) > 1:
            names = ", ".join(f"'{event.name}'" for event in located)
            raise SimulationError(
                f"the events {names} take place together at t = {state.t:.6g} s and lead to different mechanisms; let "
                "each of them lead on, from the mechanism of the other, to one with the joints of both (during=)",
                time=state.t,
            )
        return max(chains, key=len)

    def _refuse_pressed_through(self, run: Run, state: State) -> None:
        """Raise for an event that stands at its zero in the new mechanism, and that the forces press through."""
        watched = [event for event in run.events if event.becomes is not None and event.direction]
        for event in EventWatch(state.equations, watched, run.instant).pressed_through(state)[:1]:
            raise SimulationError(
                f"event '{event.name}' is at its zero and at rest at t = {state.t:.9g} s, just after a change of the "
                "mechanism, and the forces press it through; let it become a mechanism in which the joint holds",
                time=state.t,
            )

    def _set_parameters(self, chain: Sequence[Event], before: State) -> None:
        self._p = self._p.copy()  # states before the change keep the values that they had
        for event in chain:
            for symbol, value in event.new_values:
                if not isinstance(symbol, StateVariable):
                    self._p[position_in(self.whole.parameters, symbol, "reset=")] = float(before[value])

    @staticmethod
    def _carry_levels(before: Modes, after: Modes) -> None:
        """Go on with the inputs that a controller holds."""
        theirs = before.setup.mechanism.inputs
        for k, symbol in enumerate(after.setup.mechanism.inputs):
            place = place_of(symbol, theirs)
            if place is not None:
                after.levels[k] = before.levels[place]

    def _entry(self, chain: Sequence[Event], before: State, run: Run) -> tuple[State, dict[Any, np.ndarray]]:
        """The state just after a change, and the impulses by joint."""
        mechanism = run.setup.mechanism
        numeric = run.modes.numeric(run.modes.free)
        names = ", ".join(f"'{event.name}'" for event in chain)
        law = ImpactLaw(numeric.eom, {joint: e for event in chain for joint, e in event.restitution.items()})
        z = np.array([self._state_value(symbol, before, chain) for symbol in mechanism.states])
        q, jump = pose_and_jump(numeric, law, before, z, f"event {names} at t = {before.t:.6g} s")
        numeric.refuse_missing_mass(before.t, q)
        if jump.dependent and largest(jump.impulses) > NEGLIGIBLE:
            rows = ", ".join(law.row_names[k] for k in jump.dependent)
            self._notes.append(f"event {names}: rows of the impact are redundant; {rows} bear no impulse")
        eom = equations(mechanism)
        nothing = (np.zeros(eom.a.numel()), z, np.zeros(eom.lam.numel()), np.zeros(eom.u.numel()))
        state = State(mechanism, before.t, q, jump.v, *nothing, run.setup.p)
        return state, law.by_joint(jump.impulses)

    @staticmethod
    def _state_value(symbol: StateVariable, before: State, events: Sequence[Event]) -> float:
        new_values = [value for event in events for key, value in event.new_values if key is symbol]
        if new_values:
            return float(before[new_values[-1]])
        return float(before[symbol]) if before.equations.contains(symbol) else float(symbol.value)

    # --- what the analysis asks of a run ------------------------------------------------------------
    @property
    def integrator(self) -> Integrator:
        """Integrator of the first mechanism."""
        return self.runs[0].integrator

    def unresolved(self) -> list[str]:
        """Sentences on what the steps of the integrators did not resolve."""
        return list(dict.fromkeys(sentence for run in self.runs for sentence in run.unresolved()))


def _is_used(event: Event, chain: Sequence[Event], located: Sequence[Event], state: State) -> bool:
    """True if the zero of an event is that of others in a chain, as often as it was located, and may come again."""
    slope = _slope(event, state)

    def alike(other: Event) -> bool:
        return abs(float(slope @ _slope(other, state))) > 1 - NEGLIGIBLE

    before = sum(map(alike, chain))
    return before > 0 and before >= sum(map(alike, located))


def _slope(event: Event, state: State) -> np.ndarray:
    """Direction (n,) in which the expression of an event changes with the state; zero if it depends on time alone."""
    eom = state.equations

    def function() -> ca.Function:
        return eom.function(ca.gradient(event.expression, ca.vertcat(eom.q, eom.v, eom.z)))

    slopes = eom.mechanism.cache.get_or_create(("slope", event), function, bounded=True)
    slope = np.nan_to_num(slopes(*state.arguments).full().ravel())
    return slope / (float(np.linalg.norm(slope)) or 1.0)
