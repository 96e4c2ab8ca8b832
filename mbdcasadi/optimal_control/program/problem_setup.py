"""A problem with its parameters and its start: first state, poses on the way, setups of phases, and programs."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from copy import copy
from functools import partial
from typing import Any

import numpy as np

from ...arguments.inputs import Signals
from ...arguments.values import mapping_of, pairs_with, position_in
from ...assembly.consistent_start import carried_by
from ...assembly.setup import Setup
from ...equations.numeric import NumericEquations
from ...errors import ConditionError, ModelError, warnings_given
from ...model.cache import Cache
from ...model.conditions import Condition
from ...model.symbols import Parameter
from ...numerics.lazy import cached_property
from ...numerics.least_squares import largest
from ...results.state import State
from ..poses.consistency import check_end, naming_phase, refuse_beyond_limits
from ..poses.free_poses import PosedPlace, free_poses, places_of
from ..poses.key_poses import KeyPoses, key_poses
from ..poses.kinematic_guess import KinematicPath, kinematic_path
from ..poses.start import check_start, first_state
from ..problem import OptimalControlProblem
from ..statement.phase import Phase, on_states, read_state_or_conditions
from ..transcription.mesh import Mesh
from .change import ChangeSetup, numeric_at
from .collocation_program import CollocationProgram, Held
from .setup import PhaseSetup, Settings

#: Distance of the first key pose from the start, as a share of the coordinates, from which it is another one.
START_MOVED = 1e-9


class ProblemSetup:
    """A problem with its parameters and its start, ready to be transcribed on meshes.

    `initial` may replace the problem's own start. `near` is the setup of the only phase in a solution of the problem:
    what does not follow from other values of parameters is taken from there.

    Attributes
    ----------
    initial : State or tuple of Condition
        Conditions at the start.
    start : State
        First state, as far as the initial conditions decide it.
    free_values : numpy.ndarray
        Values of the free parameters to begin with.
    setups : list of PhaseSetup
        What the programs of each phase have in common.
    changes : list of ChangeSetup
        What the programs of each change between them have in common.
    of_start : Cache
        What follows from the problem, its own start and the parameters that are given, without symbols.
    """

    def __init__(
        self,
        problem: OptimalControlProblem,
        settings: Settings,
        parameters: Any = None,
        initial: Any = None,
        near: PhaseSetup | None = None,
    ):
        self.problem, self.settings = problem, settings
        first, values = problem.phases[0], self._read_parameters(parameters)
        self.initial = first.initial if initial is None else self._other_start(initial)
        read = []
        for phase in problem.phases:
            own = pairs_with(phase.mechanism.parameters, values.items())
            own = list((carried_by(self.initial, phase.mechanism)["parameters"] | dict(own)).items())
            start = self.initial if phase is first else ()
            read.append(Setup(phase.mechanism, "optimize", t=0.0, initial=start, parameters=own))
        numerics = [setup.numeric for setup in read]
        self.free_values = np.array([first.mechanism.value_of(p, p.value) for p in problem.free_parameters])
        self._is_own_start = initial is None
        self.of_start = self._values_of_start(read[0].p)
        self.setups: list[PhaseSetup] = []
        self.changes: list[ChangeSetup] = []
        if isinstance(self.initial, State):
            with naming_phase(problem, first):
                check_start(problem, first, numerics[0], self.initial)
        shared = isinstance(self.initial, State) and len(problem.phases) == 1  # states share their setups
        key = settings.key, "state" if shared else self.initial, *(numeric.p.tobytes() for numeric in numerics)
        if near is not None and (near.settings_key != settings.key or not self._is_decided_by_states):
            near = None
        kept = problem.compiled.setups
        cache = kept if (shared or self._is_own_start) and (near is None or key in kept) else Cache()
        ready = cache.get_or_create_quietly(key, partial(self._make, numerics, read[0], near), bounded=True)
        self.start, self.free_values, self.setups, self.changes = ready
        if isinstance(self.initial, State):
            self.start = self.initial

    def _read_parameters(self, parameters: Any) -> Mapping[Any, Any]:
        """Values of parameters of the phases; raises for a free one and for strangers."""
        values, problem = mapping_of(parameters, "parameters="), self.problem
        for free in problem.free_parameters:
            if free in values:
                raise ModelError(f"optimize: parameter '{free.label}' is both given and free")
        parameters_of_phases = list(dict.fromkeys(p for phase in problem.phases for p in phase.mechanism.parameters))
        for given in values:
            position_in(parameters_of_phases, given, "parameters=")
        return values

    def _make(self, numerics: list[NumericEquations], first: Setup, near: PhaseSetup | None) -> tuple[Any, ...]:
        """Find the first state, values of free parameters, and setups of phases and changes."""
        signals = first.signals
        with naming_phase(self.problem, self.problem.phases[0]):
            free = near is not None and self.initial == ()
            self.start = copy(near.start) if near and free else self._first_state(numerics, signals)
        for phase, numeric in zip(self.problem.phases, numerics, strict=True):
            if isinstance(phase.final, State):
                with naming_phase(self.problem, phase):
                    refuse_beyond_limits(self.problem, phase, numeric, "final", phase.final)
        if near:
            self.setups = [near.at(self.problem, numerics[0], self.start, self.initial)]
        else:
            self._set_up(numerics, signals)
        return self.start, self.free_values, self.setups, self.changes

    @property
    def _is_decided_by_states(self) -> bool:
        """True if the start is a state, or stated by conditions on states alone."""
        return isinstance(self.initial, State) or len(on_states(self.initial)) == len(self.initial)

    def _other_start(self, initial: Any) -> State | tuple[Condition, ...]:
        """A start in place of the problem's own, checked as that is."""
        phase = self.problem.phases[0]
        conditions = read_state_or_conditions(initial, phase.mechanism)
        if not isinstance(conditions, State):
            self.problem.check_symbols(phase, "initial", conditions)
            with naming_phase(self.problem, phase):
                check_end(self.problem, phase, "initial", conditions)
        return conditions

    def _values_of_start(self, p: np.ndarray) -> Cache:
        """What follows from the problem and the parameters that are given, without symbols."""
        problem = self.problem
        if not self._is_own_start or len(problem.phases) > 1 or problem.free_parameters:
            return Cache()
        return problem.shared.get_or_create(("start", p.tobytes()), Cache, bounded=True)

    def _first_state(self, numerics: list[NumericEquations], signals: Signals) -> State:
        """First state; what is known of it is kept, unless a warning belongs to it."""
        known = self.of_start.get("first state")
        if known is not None:
            return State(self.problem.mechanism, known[0], *[part.copy() for part in known[1:]])
        before = warnings_given()
        state = self._found_first_state(numerics, signals)
        if state is not self.initial and state.obstacle is None and warnings_given() == before:
            arguments = state.t, *[part.copy() for part in state.arguments[1:]]
            self.of_start.get_or_create("first state", lambda: arguments)
        return state

    def _found_first_state(self, numerics: list[NumericEquations], signals: Signals) -> State:
        """First state; with other values of free parameters, which the equations then have, if it needs them."""
        problem, phase = self.problem, self.problem.phases[0]
        try:
            return first_state(problem, phase, numerics[0], self.initial, signals)
        except ConditionError:
            if isinstance(self.initial, State):
                raise
            poses = free_poses(problem, phase, numerics[0], [PosedPlace(0.0, self.initial)])
            if poses is None:
                raise
        self._take(poses.values, numerics)
        return first_state(problem, phase, numerics[0], self.initial, signals, poses)

    @property
    def _free(self) -> dict[Parameter, float]:
        """Values of the free parameters."""
        return dict(zip(self.problem.free_parameters, self.free_values.tolist(), strict=True))

    def _take(self, values: Mapping[Parameter, float], numerics: list[NumericEquations]) -> None:
        """Take values of the free parameters over into the equations."""
        self.free_values = np.array([values[p] for p in self.problem.free_parameters])
        numerics[:] = [numeric_at(numeric, values) for numeric in numerics]

    # --- phases -----------------------------------------------------------------------------
    def _set_up(self, numerics: list[NumericEquations], signals: Signals) -> None:
        """Make the setups of phases and changes; phases that meet do so at key poses, assembled together."""
        problem, phases = self.problem, self.problem.phases
        durations = [0.0 if phase.is_instant else phase.span.typical for phase in phases]
        usual, ends = float(np.median([d for d in durations if d > 0])), np.cumsum(durations)
        spans = list(zip((ends - durations).tolist(), ends.tolist(), strict=True))
        poses = self._key_poses(numerics, spans) if len(phases) > 1 else None
        only = self._free_path(numerics, signals) if poses is None and problem.free_parameters else None
        for k, (phase, numeric) in enumerate(zip(phases, numerics, strict=True)):
            start, initial, path = self.start, self.initial, only
            if poses is not None:
                if k:
                    start, initial = _at_rest(phase, poses.starts[k], spans[k][0], numeric.p), phase.initial
                path = self._path_to(poses.ends[k], phase, numeric, start, spans[k])
            time = usual if phase.is_instant else None
            cache = self.of_start if len(phases) == 1 else Cache()
            self.setups.append(PhaseSetup(problem, phase, self.settings, numeric, start, initial, path, time, cache))
        if poses is not None:
            pairs = zip(itertools.pairwise(self.setups), poses.ends, ends.tolist(), strict=False)
            self.changes += [ChangeSetup.at(*pair, pose, t, problem.free_parameters) for pair, pose, t in pairs]

    def _key_poses(self, numerics: list[NumericEquations], spans: Sequence[tuple[float, float]]) -> KeyPoses:
        """Poses at the ends of all phases, whose free parameters are taken over; the start may move to the first."""
        poses = key_poses(self.problem, numerics, self.start.q, spans)
        self._take(poses.values, numerics)
        s, moved = self.start, largest(poses.starts[0] - self.start.q) > START_MOVED * (1 + largest(self.start.q))
        if moved and not isinstance(self.initial, State):
            self.start = State(s.mechanism, s.t, poses.starts[0], s.v, s.a, s.z, s.lam, s.inputs, numerics[0].p)
        return poses

    def _path_to(
        self, end: np.ndarray, phase: Phase, numeric: NumericEquations, start: State, span: tuple[float, float]
    ) -> KinematicPath:
        """Poses of a phase from its start to its last key pose."""
        if phase.is_instant:
            return KinematicPath(np.array(span), np.array(span[:1]), end[None, :])
        times = span[0] + phase.segment_times(span[1] - span[0])
        return kinematic_path(self.problem, phase, numeric, start, times, poses={times.size - 1: end})

    def _free_path(self, numerics: list[NumericEquations], signals: Signals) -> KinematicPath:
        """Poses of the only phase; with other values of free parameters if a place is not reached without."""
        problem, phase = self.problem, self.problem.phases[0]
        times = phase.segment_times(phase.span.typical)

        def path(**how: Any) -> KinematicPath:
            return kinematic_path(problem, phase, numerics[0], self.start, times, values=self._free, **how)

        first = path()
        if first.complete:
            return first
        past = path(through=False)
        near = np.array([past.pose_at(t) for t in times.tolist()])
        poses = free_poses(problem, phase, numerics[0], places_of(phase, self.initial, times), near)
        if poses is None:
            return first
        self._take(poses.values, numerics)
        if not isinstance(self.initial, State):
            self.start = first_state(problem, phase, numerics[0], self.initial, signals, poses)
        steered = path(poses=dict(enumerate(poses.poses)))
        return steered if steered.complete else path()

    @cached_property
    def path(self) -> KinematicPath:
        """Poses of the first phase from this start on."""
        setup = self.setups[0]
        if self.start is setup.start:
            return setup.path
        return kinematic_path(self.problem, setup.phase, setup.numeric, self.start, setup.path.segment_times)

    # --- programs ---------------------------------------------------------------------------
    def transcribe(self, meshes: Sequence[Mesh], held: Held = ()) -> CollocationProgram:
        """Return the program for meshes and points at which limits are held besides, made once and kept."""
        parts = (*(setup.key for setup in self.setups), *(change.key for change in self.changes))
        key = tuple(mesh.structure for mesh in meshes), self.settings.key, parts, held
        shared = None
        if self._is_own_start and self.settings.are_known and self.problem.contents is not None:
            rows = [(tuple(setup.scheme.eom.independent), tuple(setup.scheme.rows)) for setup in self.setups]
            values = *(setup.numeric.p.tobytes() for setup in self.setups), self.free_values.tobytes()
            changes = [change.key for change in self.changes]
            shared = self.problem.contents, *values, *rows, *changes, *key[:2], held
        make = partial(CollocationProgram, self.problem, self.setups, meshes, self.changes, held, shared)
        return self.problem.compiled.programs.get_or_create(key, make, bounded=True)


def _at_rest(phase: Phase, q: np.ndarray, t: float, p: np.ndarray) -> State:
    """A state at rest, for guesses."""
    eom = phase.equations
    sizes = (eom.v.numel(), eom.a.numel())
    v, a = (np.zeros(size) for size in sizes)
    return State(phase.mechanism, t, q, v, a, eom.estimate[2], np.zeros(eom.lam.numel()), eom.input_values, p)
