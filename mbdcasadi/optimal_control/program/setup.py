"""Everything that the solves of a phase on all meshes have in common: ends, sizes, transcription."""

from __future__ import annotations

import inspect
from collections.abc import Hashable, Sequence
from copy import copy
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ...equations.numeric import NumericEquations
from ...equations.reduced import ReducedEquations, is_chain_in_angles, reduced_equations
from ...errors import ModelError
from ...model.cache import Cache
from ...model.conditions import Condition
from ...model.contents import contents_of
from ...model.placeholders import with_values
from ...model.quantities import whole, yes_or_no
from ...numerics.lazy import cached_property
from ...numerics.rank import analyse_rank, dependent_rows, unit_rows
from ...numerics.tolerances import NEARLY_SINGULAR, RANK
from ...results.state import State
from ..poses.kinematic_guess import KinematicPath, kinematic_path
from ..poses.least_squares_loads import LeastSquaresLoads
from ..problem import OptimalControlProblem
from ..statement.known_inputs import NO_INPUTS, KnownInputs
from ..statement.phase import Phase
from ..transcription import TRANSCRIPTIONS, Transcription
from ..transcription.constraints import MotionConstraints
from ..transcription.controls import CONTROLS, input_basis
from ..transcription.scaling import Scales, Sizes, scales_of, sizes_of_phase
from .end_conditions import EndConditions

#: Poses on the way at which rows that stay independent are looked for, share of a row that others leave from which it
#: is far from implied there, and by which factor other rows have to be better to be taken in place of the first ones.
PASSED, FAR_FROM_DEPENDENT, BETTER = 9, 0.03, 10.0


@dataclass(frozen=True)
class Settings:
    """Choices of a user for a solve."""

    #: not yet bound to a mechanism
    transcription: Transcription
    #: course of the inputs in an interval
    control: str
    options: dict[str, Any]
    progress: bool
    #: the transcription as it was given
    chosen: Any
    #: whether open chains are left with their angles alone
    angles: bool = False
    #: inputs whose courses are given
    known: KnownInputs = NO_INPUTS

    @property
    def key(self) -> Hashable:
        """Key of the programs that are made by them."""
        return self.chosen, self.transcription.degree, self.control, self.angles, self.known.key

    @property
    def are_known(self) -> bool:
        """False with a transcription of the user's own, of which programs are not shared: it may read globals."""
        return contents_of(self.chosen) is not None

    @classmethod
    def read(cls, transcription: Any, degree: Any, control: Any, options: Any, progress: Any) -> Settings:
        """Check what ``optimize`` is given."""
        scheme = _scheme(transcription, degree)
        if control not in CONTROLS:
            raise ModelError(f"optimize: control must be one of {', '.join(CONTROLS)}, got {control!r}")
        shown = yes_or_no(progress, "optimize", "progress")
        chosen = {} if options is None else options
        if not isinstance(chosen, dict) or not all(isinstance(name, str) for name in chosen):
            raise ModelError(f"optimize: options takes a dict such as {{'ipopt.max_iter': 500}}, got {options!r}")
        return cls(scheme, control, dict(chosen), shown, transcription)


def _scheme(transcription: Any, degree: Any) -> Transcription:
    """The scheme that is given by its name, its class or itself."""
    stages = whole(degree, "optimize", "degree", 1, 5)
    if isinstance(transcription, Transcription):
        return transcription
    scheme = TRANSCRIPTIONS.get(transcription) if isinstance(transcription, str) else transcription
    if not (isinstance(scheme, type) and issubclass(scheme, Transcription)) or inspect.isabstract(scheme):
        raise ModelError(
            f"optimize: transcription must be one of {', '.join(TRANSCRIPTIONS)} or a subclass of Transcription, "
            f"or an object of one, got {transcription!r}"
        )
    try:
        return scheme(stages)
    except TypeError as error:
        raise ModelError(
            f"optimize: transcription {scheme.__name__} does not take the degree ({error}); give an object of it"
        ) from None


def has_open_chains(problem: OptimalControlProblem) -> bool:
    """Return True if a mechanism is an open chain whose angles alone are a better choice than all coordinates."""
    mechanisms = [phase.equations for phase in problem.phases]
    return any(reduced_equations(eom).rows and is_chain_in_angles(eom) for eom in mechanisms)


class PhaseSetup:
    """Ends, sizes and transcription of a phase, with its equations at the parameters that are given.

    `start` is the first state as far as the initial conditions decide it, `path` the poses from the start to the end
    with the times of start, waypoints and end to begin with; `time` is the typical one, s, of a phase of no duration.
    Numbers and compiled functions that follow from all of these are in `cache`.
    """

    def __init__(
        self,
        problem: OptimalControlProblem,
        phase: Phase,
        settings: Settings,
        numeric: NumericEquations,
        start: State,
        initial: State | Sequence[Condition],
        path: KinematicPath | None = None,
        time: float | None = None,
        cache: Cache | None = None,
    ):
        numeric.refuse_missing_mass(start.t, start.q)
        self.phase, self.numeric, self.start = phase, numeric, start
        self.cache = Cache() if cache is None else cache
        self.path = self.cache.get_or_create_quietly("path", lambda: self._path(problem)) if path is None else path
        self.ends = EndConditions(problem, phase, numeric, start, initial, self.path, self.cache)
        self.extra_parameters = problem.extra_parameters(phase)
        eom = phase.equations
        #: symbols that an expression of the problem may contain
        self.arguments = [eom.t, eom.q, eom.v, eom.a, eom.z, eom.lam, eom.u, phase.input_rates, eom.p]
        self.arguments.append(ca.vertcat(ca.SX(0, 1), *self.extra_parameters))
        #: typical sizes of the mechanism and its motion, and of the parameters that the mechanism does not have
        self.scales, self._parameter_sizes = self.cache.get_or_create("scales", lambda: self._scales(problem, time))
        self.scheme = self._bound_scheme(problem, settings, initial)
        #: settings for which it was made
        self.settings_key = settings.key

    def at(
        self,
        problem: OptimalControlProblem,
        numeric: NumericEquations,
        start: State,
        initial: State | Sequence[Condition],
    ) -> PhaseSetup:
        """Return the same setup, with the path from its own start, for another one and other values of parameters."""
        other = copy(self)
        other.numeric, other.cache = numeric, Cache()
        other.ends = self.ends.at(problem, numeric, start, initial)
        for name in ("sizes", "loads"):
            other.__dict__.pop(name, None)
        return other

    def _path(self, problem: OptimalControlProblem) -> KinematicPath:
        phase = self.phase
        return kinematic_path(problem, phase, self.numeric, self.start, phase.segment_times(phase.span.typical))

    def _scales(self, problem: OptimalControlProblem, time: float | None) -> tuple[Scales, np.ndarray]:
        span = float(self.path.segment_times[-1] - self.path.segment_times[0])
        scales = scales_of(self.numeric, span if time is None else time, self.path.poses)
        sizes = sizes_of_phase(self.numeric, scales, self.arguments, self.extra_parameters, self._limits(problem))
        return sizes.scales, sizes.parameters

    @cached_property
    def sizes(self) -> Sizes:
        """Sizes of expressions."""
        return Sizes(self.numeric, self.scales, self.arguments, self.extra_parameters, self._parameter_sizes)

    def _limits(self, problem: OptimalControlProblem) -> list[ca.SX]:
        """Limits on the way, at waypoints, and between the ends if the phase has all that they contain."""
        on_way = [*self.phase.path, *(c for w in self.phase.waypoints for c in w.conditions)]
        limits = [c.expression for c in on_way if not c.equality]
        extra = ca.vertcat(ca.SX(0, 1), *self.extra_parameters)
        for condition in problem.boundary:
            values = with_values(condition.expression, lambda mark: mark.expression)
            if not condition.equality and self.phase.has(ca.substitute(values, extra, ca.SX.zeros(extra.numel()))):
                limits.append(values)
        return limits

    @property
    def key(self) -> Hashable:
        """Key of a program of the phase, besides the problem, the settings and the mesh."""
        return self.ends.key, tuple(self.scheme.eom.independent), tuple(self.scheme.rows)

    @cached_property
    def loads(self) -> LeastSquaresLoads:
        """Loads and inputs for guesses."""
        return LeastSquaresLoads(self.numeric, self.scheme.eom, self.scales)

    def _bound_scheme(
        self, problem: OptimalControlProblem, settings: Settings, initial: State | Sequence[Condition]
    ) -> Transcription:
        curved = not self.ends.are_singular
        angles = settings.angles and is_chain_in_angles(self.phase.equations)
        eom = reduced_equations(self.phase.equations, curved=curved, angles=angles)
        # an input that drives a first-order state could else move it unseen: by a polynomial that is zero at all stages
        drives = bool(eom.u.numel() and eom.z.numel()) and bool(ca.depends_on(eom.z_rate, eom.u))
        inner, joined = settings.transcription.input_points(lower_degree=drives)
        place = problem.phases.index(self.phase)
        known, inputs = settings.known.places(place), self.phase.mechanism.inputs
        limited = any(np.isfinite([u.lower, u.upper]).any() for k, u in enumerate(inputs) if k not in known)
        rates = problem.has_input_rates(initial)
        basis = input_basis(settings.control, inner, joined, rates=rates, limited=limited)
        rows, weights = self._independent_rows(eom), self.numeric.weights[eom.independent]
        sizes = self.numeric.weights.tobytes(), self.numeric.light_key
        key = "scheme", place, settings.key, curved, tuple(rows), basis, *sizes
        cache = problem.shared.get_or_create(key, Cache, bounded=True) if settings.are_known else Cache()
        path_constraints = problem.differentiated_path_constraints(self.phase)
        constraints = MotionConstraints(eom, self.numeric, rows, path_constraints, cache)
        return settings.transcription.bound_to(constraints, weights, basis, known)

    def _independent_rows(self, eom: ReducedEquations) -> list[int]:
        """Remaining rows without those that others imply; of the poses passed the one with the most counts.

        Poses that are nearly singular do not count if there are others: they may lie off the curve of poses by as much
        as makes implied rows independent. Of rows that imply each other, as the two of one pin, those are taken that
        stay independent on the way.
        """
        if not eom.rows:
            return []
        order, explicit, poses = [*eom.explicit, *eom.rows], len(eom.explicit), self.path.poses
        passed = 0, len(poses) // 2, len(poses) - 1
        places = {*passed, *np.linspace(0, len(poses) - 1, PASSED).astype(int).tolist()}
        jacobians = {k: self.numeric.jacobian(0.0, poses[k]) * self.numeric.column_scale for k in sorted(places)}
        units = {k: unit_rows(jacobian)[order] for k, jacobian in jacobians.items()}

        def at(place: int, tolerance: float) -> list[int]:
            dependent = set(dependent_rows(units[place], tolerance))
            return [k for k in range(len(eom.rows)) if k + explicit not in dependent]

        def least(rows: list[int]) -> float:
            """Smallest singular value on the way."""
            kept = [*range(explicit), *(k + explicit for k in rows)]
            return min(float(analyse_rank(unit[kept]).singular_values[-1]) for unit in units.values())

        found = [at(k, RANK) for k in passed]
        regular = [rows for k, rows in zip(passed, found, strict=True) if at(k, NEARLY_SINGULAR) == rows]
        first = max(regular or found, key=len)
        if len(first) == len(eom.rows):
            return first
        others = [rows for rows in (at(k, FAR_FROM_DEPENDENT) for k in units) if len(rows) == len(first)]
        best = max(others, key=least, default=first)
        return best if least(best) > BETTER * least(first) else first
