"""First guesses of a motion: through poses, from trajectories, from other solutions."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ...assembly.followed_states import led_states
from ...errors import ModelError
from ...results.interpolation import hermite, linear
from ...results.state import State
from ...results.trajectory import Trajectory
from ..poses.kinematic_guess import KinematicPath
from ..poses.least_squares_loads import LeastSquaresLoads
from ..program.collocation_program import CollocationProgram
from ..program.phase_program import PhaseProgram
from ..statement.phase import Phase
from ..transcription.controls import InputBasis
from ..transcription.mesh import Mesh
from ..transcription.motion import Polynomials

#: Values by name (``q, v, z, a, lam, u, rate``), each (k, size), at given times.
Sampler = Callable[[np.ndarray], dict[str, np.ndarray]]


@dataclass(frozen=True)
class Iterate:
    """Variables and multipliers of a program, scaled, on one mesh."""

    program: CollocationProgram
    meshes: Sequence[Mesh]
    x: np.ndarray
    lam_x: np.ndarray
    lam_g: np.ndarray

    def belongs_to(self, program: CollocationProgram, meshes: Sequence[Mesh]) -> bool:
        """Return True if it is an iterate of a program on a mesh."""
        return self.program is program and all(map(Mesh.is_same, self.meshes, meshes))


@dataclass(frozen=True)
class PhaseGuess:
    """A motion to start from, of one phase."""

    #: times (k,) to values by name
    sample: Sampler
    #: of start, waypoints and end, s
    segment_times: np.ndarray

    def fill(self, x: np.ndarray, program: PhaseProgram, mesh: Mesh) -> None:
        """Put the variables of the phase, in physical units, into those of the whole program."""
        scheme, times = program.scheme, mesh.times(self.segment_times)
        inner = {
            name: scheme.inputs.taus if name == "u" else taus
            for name, (size, taus) in scheme.interval_variables.items()
            if size and taus.size and np.all(np.isfinite(taus))
        }
        points = {taus.tobytes(): times[:-1, None] + np.diff(times)[:, None] * taus for taus in inner.values()}
        sampled = self.sample(np.concatenate([times, *(wanted.ravel() for wanted in points.values())]))
        ends = np.cumsum([times.size, *(wanted.size for wanted in points.values())])
        within = {key: slice(*pair) for key, pair in zip(points, itertools.pairwise(ends), strict=True)}

        names = [name for name, size in scheme.point_variables.items() if size]
        values = np.hstack([scheme.unknown_columns(name, sampled[name][: times.size]) for name in names])
        x[program.point_index(np.arange(times.size)[:, None])[:, : values.shape[1]]] = values
        intervals = np.arange(times.size - 1)[:, None]
        for name, taus in inner.items():
            if name not in sampled:  # a variable of the scheme alone begins with zero
                continue
            part = within[taus.tobytes()]
            values = sampled[name][part]
            if name == "u":
                values = _input_unknowns(scheme.inputs, values)
            elif name == "lam" and scheme.redundant:
                place = points[taus.tobytes()].reshape(-1, 1), sampled["q"][part]
                values = scheme.constraints.independent.rows(*place, values, program.setup.numeric.p)[0]
            columns = scheme.unknown_columns(name, values).reshape(intervals.size, -1)
            x[program.inner_index(intervals)[:, scheme.interval_slice(name)]] = columns
        x[program.time_index] = times[mesh.knots][: program.time_count]


def _input_unknowns(basis: InputBasis, values: np.ndarray) -> np.ndarray:
    """Unknowns of the inputs that belong to the intervals alone (N k, n_u), from values at points of the intervals."""
    unknowns = basis.unknowns(values.reshape(-1, basis.taus.size, values.shape[1]))
    inner = unknowns[:, 1:-1] if basis.joined else unknowns
    return inner.reshape(-1, values.shape[1])


@dataclass(frozen=True)
class Guess:
    """A motion to start from."""

    phases: tuple[PhaseGuess, ...]
    parameters: np.ndarray
    #: origin, in words
    description: str
    #: variables and multipliers of a solution of the same program
    iterate: Iterate | None = None

    @property
    def segment_times(self) -> list[np.ndarray]:
        """Times of start, waypoints and end by phase, s."""
        return [phase.segment_times for phase in self.phases]

    def variables(self, program: CollocationProgram, meshes: Sequence[Mesh]) -> np.ndarray:
        """Variables of a program, scaled."""
        x = np.zeros(program.size)
        for guess, phase, mesh in zip(self.phases, program.phases, meshes, strict=True):
            if not phase.phase.is_instant:
                guess.fill(x, phase, mesh)
        for change, guess in zip(program.changes, self.phases, strict=False):
            change.fill(x, float(guess.segment_times[-1]))
        x[program.parameter_index] = self.parameters
        return x / program.scale


def guess_at_rest(loads: LeastSquaresLoads, start: State, path: KinematicPath) -> PhaseGuess:
    """Poses without velocities, accelerations, loads and inputs."""
    sample_moving = kinematic_guess(loads, start, path).sample

    def sample(wanted: np.ndarray) -> dict[str, np.ndarray]:
        values = sample_moving(wanted)
        return {name: x if name in ("q", "z") else 0 * x for name, x in values.items()}

    return PhaseGuess(sample, path.segment_times)


def kinematic_guess(
    loads: LeastSquaresLoads, start: State, path: KinematicPath, given: Sampler | None = None
) -> PhaseGuess:
    """A motion through poses, with the velocities and accelerations, loads and inputs that belong to it.

    Inputs, first-order states and their rates may be `given`: ``u``, with NaN for inputs that are not, ``z`` and
    ``rate``.
    """
    times, poses = path.times, path.poses
    velocities = np.gradient(poses, times, axis=0)
    accelerations = np.gradient(velocities, times, axis=0)

    def sample(wanted: np.ndarray) -> dict[str, np.ndarray]:
        q, v = hermite(times, poses, velocities, accelerations, wanted)
        z = led_states(loads.numeric, wanted, q, v, np.tile(start.z, (wanted.size, 1)))
        known = {"z": z, "rate": 0 * z} | ({} if given is None else given(wanted))
        a = linear(times, accelerations, wanted)
        q, v, a = loads.states(wanted, q, v, a, known["z"])
        lam, u = loads.loads(wanted, q, v, a, known["z"], known.get("u"))
        return {"q": q, "v": v, "a": a} | known | {"lam": lam, "u": u}

    return PhaseGuess(sample, path.segment_times)


def _stretched(begin: float, end: float, segment_times: np.ndarray) -> tuple[float, Callable[[np.ndarray], np.ndarray]]:
    """Factor by which a motion from a time to another is to take longer, and its times by those of the longer one."""
    stretch = (segment_times[-1] - segment_times[0]) / (end - begin)
    return stretch, lambda wanted: np.clip(begin + (wanted - segment_times[0]) / stretch, begin, end)


def guess_from_motion(motion: Trajectory, segment_times: np.ndarray) -> PhaseGuess:
    """A motion of the same mechanism, stretched to the times of a problem."""
    stretch, moved = _stretched(motion.t[0], motion.t[-1], segment_times)

    def sample(wanted: np.ndarray) -> dict[str, np.ndarray]:
        at = motion.at(moved(wanted))
        rates = at[at.equations.z_rate].reshape(at.z.shape) if at.z.shape[1] else at.z
        return {
            "q": at.q, "v": at.v / stretch, "a": at.a / stretch**2, "z": at.z,
            "rate": rates / stretch, "lam": np.nan_to_num(at.lam), "u": np.nan_to_num(at.inputs),
        }  # fmt: skip

    return PhaseGuess(sample, segment_times)


def guess_from_polynomials(motion: Polynomials, segment_times: np.ndarray) -> PhaseGuess:
    """The polynomials of a solution of the same mechanism, stretched to the times of a problem."""
    stretch, moved = _stretched(motion.times[0], motion.times[-1], segment_times)

    def sample(wanted: np.ndarray) -> dict[str, np.ndarray]:
        t, q, v, a, z, lam, u, _ = motion.at_times(moved(wanted))
        rates = motion.state_rates(t, q, v, a, z, lam, u)
        return {
            "q": q, "v": v / stretch, "a": a / stretch**2, "z": z, "rate": rates / stretch, "lam": lam, "u": u
        }  # fmt: skip

    return PhaseGuess(sample, segment_times)


def guess_from_other(
    phase: Phase, loads: LeastSquaresLoads, motion: Trajectory, segment_times: np.ndarray
) -> PhaseGuess:
    """A motion of the same bodies in another mechanism, such as one with drivers in place of inputs, or one built anew.

    Coordinates are the same symbols, or have the same names. Multipliers and inputs are those that come nearest to the
    equations of motion: for an inverse dynamics the effort of the driver. A motion that lacks a coordinate is refused.
    """
    columns = _columns(phase, motion)
    stretch, moved = _stretched(motion.t[0], motion.t[-1], segment_times)

    def sample(wanted: np.ndarray) -> dict[str, np.ndarray]:
        at = motion.at(moved(wanted))
        q, v, a = at.q[:, columns], at.v[:, columns] / stretch, at.a[:, columns] / stretch**2
        z = led_states(loads.numeric, wanted, q, v, np.tile(phase.equations.estimate[2], (wanted.size, 1)))
        lam, u = loads.loads(wanted, q, v, a, z)
        return {"q": q, "v": v, "a": a, "z": z, "rate": 0 * z, "lam": lam, "u": u}

    return PhaseGuess(sample, segment_times)


def _columns(phase: Phase, motion: Trajectory) -> list[int]:
    """Columns of the coordinates of a phase in those of a motion."""
    ours, theirs = (ca.vertsplit(eom.q) for eom in (phase.equations, motion.equations))
    place: dict[Any, int] = {s.name(): k for k, s in enumerate(theirs)}
    place |= {s.element_hash(): k for k, s in enumerate(theirs)}
    missing = [s.name() for s in ours if s.element_hash() not in place and s.name() not in place]
    if missing:
        own, of = (", ".join(f"'{b.name}'" for b in x.mechanism.bodies) for x in (motion, phase))
        raise ModelError(
            f"optimize: the motion given as guess has no coordinate {missing[0]}: it is of the bodies {own}, the phase "
            f"'{phase.name}' has {of}; bodies are matched by their names"
        )
    return [place.get(s.element_hash(), place.get(s.name(), -1)) for s in ours]
