"""First guesses of a motion: through poses, from trajectories, from other solutions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from ...errors import ModelError
from ...results.interpolation import hermite, linear
from ...results.state import State
from ...results.trajectory import Trajectory
from ..problem import OptimalControlProblem
from ..refinement.mesh import Mesh
from .least_squares_loads import Balance

if TYPE_CHECKING:
    from ..nlp.motion_program import MotionProgram

#: Values by name (``q, v, z, a, lam, u, rate``), each (k, size), at times given.
Sampler = Callable[[np.ndarray], dict[str, np.ndarray]]


@dataclass(frozen=True)
class Iterate:
    """Variables and multipliers of a program, scaled, on one mesh."""

    program: MotionProgram
    mesh: Mesh
    x: np.ndarray
    lam_x: np.ndarray
    lam_g: np.ndarray

    def belongs_to(self, program: MotionProgram, mesh: Mesh) -> bool:
        """Whether it is an iterate of a program on a mesh."""
        return self.program is program and self.mesh.is_same(mesh)


@dataclass(frozen=True)
class Guess:
    """A motion to start from.

    Attributes
    ----------
    sample : callable
        Times (k,) to values by name.
    marks : numpy.ndarray
        Times of start, waypoints and end, s.
    parameters : numpy.ndarray
        Values of the free parameters.
    word : str
        Where it comes from.
    iterate : Iterate, optional
        Variables and multipliers of a solution of the same program.
    """

    sample: Sampler
    marks: np.ndarray
    parameters: np.ndarray
    word: str
    iterate: Iterate | None = None

    def variables(self, program: MotionProgram, mesh: Mesh) -> np.ndarray:
        """Variables of a program, scaled."""
        scheme, x = program.scheme, np.zeros(program.size)
        times = mesh.times(self.marks)
        nodes = self.sample(times)
        columns = [scheme.own(name, nodes[name]) for name, size in scheme.node_parts.items() if size]
        values = np.hstack(columns)
        for k in range(times.size):
            x[program.node_index(k)[: values.shape[1]]] = values[k]
        lengths = np.diff(times)
        sampled: dict[bytes, dict[str, np.ndarray]] = {}
        for name, (size, shares) in scheme.block_parts.items():
            if size and shares.size and np.all(np.isfinite(shares)):
                inner = (times[:-1, None] + lengths[:, None] * shares[None, :]).ravel()
                if shares.tobytes() not in sampled:
                    sampled[shares.tobytes()] = self.sample(inner)
                found = scheme.own(name, sampled[shares.tobytes()][name]).reshape(lengths.size, -1)
                part = scheme.block_slice(name)
                for i in range(lengths.size):
                    x[program.block_index(i)[part]] = found[i]
        x[program.mark_index] = self.marks[: program.mark_count]
        x[program.parameter_index] = self.parameters
        return x / program.scale


def kinematic_guess(
    problem: OptimalControlProblem,
    balance: Balance,
    start: State,
    marks: np.ndarray,
    times: np.ndarray,
    poses: np.ndarray,
) -> Guess:
    """A motion through poses, with the velocities and accelerations, loads and inputs that belong to it."""
    velocities = np.gradient(poses, times, axis=0)
    accelerations = np.gradient(velocities, times, axis=0)

    def sample(wanted: np.ndarray) -> dict[str, np.ndarray]:
        z = np.tile(start.z, (wanted.size, 1))
        q, v = hermite(times, poses, velocities, accelerations, wanted)
        a = linear(times, accelerations, wanted)
        q, v, a = balance.states(wanted, q, v, a, z)
        lam, u = balance.loads(wanted, q, v, a, z)
        return {"q": q, "v": v, "a": a, "z": z, "rate": 0 * z, "lam": lam, "u": u}

    return Guess(sample, marks, _own_values(problem), "kinematic")


def _own_values(problem: OptimalControlProblem) -> np.ndarray:
    """The free parameters' own values."""
    return np.array([p.value for p in problem.free_parameters])


def _stretched(motion: Trajectory, marks: np.ndarray) -> tuple[float, Callable[[np.ndarray], Trajectory]]:
    """By how much longer a motion is to take, and the motion at times of the longer one."""
    begin, end = motion.t[0], motion.t[-1]
    stretch = (marks[-1] - marks[0]) / (end - begin)
    return stretch, lambda wanted: motion.at(np.clip(begin + wanted / stretch, begin, end))


def guess_from_motion(problem: OptimalControlProblem, motion: Trajectory, marks: np.ndarray) -> Guess:
    """A motion stretched to the times of a problem."""
    stretch, motion_at = _stretched(motion, marks)

    def sample(wanted: np.ndarray) -> dict[str, np.ndarray]:
        at = motion_at(wanted)
        rates = at._state_rates if at.z.shape[1] else at.z
        return {
            "q": at.q, "v": at.v / stretch, "a": at.a / stretch**2, "z": at.z,
            "rate": rates / stretch, "lam": np.nan_to_num(at.lam), "u": np.nan_to_num(at.inputs),
        }  # fmt: skip

    return Guess(sample, marks, _own_values(problem), "trajectory")


def guess_from_other(problem: OptimalControlProblem, balance: Balance, motion: Trajectory, marks: np.ndarray) -> Guess:
    """A motion of the same bodies in another mechanism, such as one with drivers in place of inputs.

    Multipliers and inputs are those that come nearest to the equations of
    motion: for an inverse dynamics the effort of the driver.

    Raises
    ------
    ModelError
        Where the other mechanism lacks a coordinate.
    """
    eom, other = problem.equations, motion.equations
    place = {s.element_hash(): k for k, s in enumerate(ca.vertsplit(other.q))}
    missing = [s.name() for s in ca.vertsplit(eom.q) if s.element_hash() not in place]
    if missing:
        raise ModelError(f"optimize: the trajectory given as guess has no coordinate {missing[0]}")
    columns = [place[s.element_hash()] for s in ca.vertsplit(eom.q)]
    stretch, motion_at = _stretched(motion, marks)

    def sample(wanted: np.ndarray) -> dict[str, np.ndarray]:
        at = motion_at(wanted)
        q, v, a = at.q[:, columns], at.v[:, columns] / stretch, at.a[:, columns] / stretch**2
        z = np.tile(eom.estimate[2], (wanted.size, 1))
        lam, u = balance.loads(wanted, q, v, a, z)
        return {"q": q, "v": v, "a": a, "z": z, "rate": 0 * z, "lam": lam, "u": u}

    return Guess(sample, marks, _own_values(problem), "inverse dynamics")
