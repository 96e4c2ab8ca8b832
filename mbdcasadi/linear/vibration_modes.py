"""Modes of a linear model: frequency, damping, and a shape that can be drawn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..equations.numeric import NumericEquations
from ..equations.recovery import Recovery
from ..errors import warn
from ..model.quantities import whole
from ..model.symbols import number
from ..results.state import State
from ..results.trajectory import Trajectory
from .model import LinearModel

#: Eigenvalues below this share of the largest one belong to rigid-body motions if A has a null space.
RIGID = 1e-6


@dataclass(frozen=True, eq=False)
class Mode:
    """A mode of small motion.

    Attributes
    ----------
    eigenvalue : complex
        rad/s; of a pair the one with the positive imaginary part.
    frequency : float
        Undamped, ``|eigenvalue| / 2π``, Hz.
    damping_ratio : float
        ``-Re / |eigenvalue|``; above 0 it decays, 1 and -1 for real eigenvalues, 0 for a rigid-body motion.
    shape : numpy.ndarray
        Over q (n,), complex; the largest entry is 1.
    vector : numpy.ndarray
        The same over the states of the model.
    model : LinearModel
        Model to which it belongs.
    """

    eigenvalue: complex
    frequency: float
    damping_ratio: float
    shape: np.ndarray
    vector: np.ndarray
    model: LinearModel

    def at(self, phase: float = 0.0, amplitude: float = 0.1) -> State:
        """State at a phase (rad) of the undamped motion; see :meth:`motion`."""
        return self._trajectory(np.zeros(1), np.array([number(phase, "mode", "phase")]), amplitude).initial

    def motion(
        self, amplitude: float = 0.1, periods: float = 1.0, frames: int = 61, damped: bool = False
    ) -> Trajectory:
        """Return the motion in this mode as a trajectory, which draws, animates and evaluates like any other.

        Parameters
        ----------
        amplitude : float, default 0.1
            Size of the largest entry of the shape (m or rad).
        periods : float, default 1
            Duration; of a real eigenvalue a period is ``2π / |eigenvalue|``.
        frames : int, default 61
            Number of times.
        damped : bool, default False
            True if the motion decays (or grows) as it does.

        Returns
        -------
        Trajectory
            Poses are brought back onto the constraints; accelerations and multipliers are those of the linear model.
        """
        count = whole(frames, "mode", "frames", 2)
        turning = abs(self.eigenvalue.imag) or abs(self.eigenvalue) or 2 * np.pi
        phase = np.linspace(0, 2 * np.pi * number(periods, "mode", "periods"), count)
        return self._trajectory(phase / turning, phase, amplitude, damped)

    def _trajectory(self, t: np.ndarray, phase: np.ndarray, amplitude: float, damped: bool = False) -> Trajectory:
        point, d = self.model.state, self.model.directions
        size = number(amplitude, "mode", "amplitude") * (np.exp(self.eigenvalue.real * t) if damped else 1.0)
        turn = size * np.exp(1j * phase)
        k = len(self.model.A)

        def part(base: np.ndarray, change: np.ndarray) -> np.ndarray:
            return base + np.real(np.outer(turn, change[:, :k] @ self.vector))

        time = point.t + t
        recovery = Recovery(NumericEquations(point.equations, point.parameters), redundant=True)
        fixed = np.full(t.size, point.t)
        q = recovery.positions(fixed, part(point.q, d.q))
        v = recovery.velocities(fixed, q, part(point.v, d.v))
        a, z, lam = part(point.a, d.a), part(point.z, d.z), part(point.lam, d.lam)
        u = part(point.inputs, d.u)
        return Trajectory(point.mechanism, time, q, v, a, z, lam, u, point.parameters)

    def __repr__(self) -> str:
        damped = f"damping ratio {self.damping_ratio:.4g}"
        return f"Mode: {self.frequency:.6g} Hz, {damped}, eigenvalue {self.eigenvalue:.6g} rad/s"


def modes_of(model: LinearModel) -> tuple[Mode, ...]:
    """Modes of a model, slowest first."""
    if not model.is_steady:
        warn(
            "modes: the state is neither an equilibrium nor in steady motion as its coordinates "
            f"({', '.join(model.state_names[: model.speeds])}) show it; its eigenvalues do not describe its further "
            "motion. For a steady rotation give linearize coordinates= that stay constant, such as a relative angle"
        )
    if not model.A.size:
        return ()
    values, vectors = np.linalg.eig(model.A)
    rigid, left_out = _rigid_motions(model.A, values)
    modes = [_mode(model, 0j, vector) for vector in rigid.T]
    for k in np.argsort(np.abs(values), kind="stable"):
        if k not in left_out and values[k].imag >= 0:
            modes.append(_mode(model, complex(values[k]), vectors[:, k]))
    return tuple(modes)


def _rigid_motions(a: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, set[int]]:
    """Null space of A, and the eigenvalues that belong to it.

    A rigid-body motion is a double eigenvalue zero with one vector, which
    rounding splits into two of the size of its square root.
    """
    # columns of displacements and rates differ in size by the frequencies
    scale = max(float(np.max(np.abs(values))), np.finfo(float).tiny)
    size = np.maximum(np.max(np.abs(a), axis=1, keepdims=True), np.finfo(float).tiny)
    _, singular, right = np.linalg.svd(a / size)
    count = int(np.sum(singular <= 1e-11 * singular[0])) if singular[0] > 0 else len(a)
    small = [int(k) for k in np.argsort(np.abs(values)) if abs(values[k]) <= RIGID * scale]
    return right[len(a) - count :].T, set(small[: 2 * count]) if count else set()


def _mode(model: LinearModel, value: complex, vector: np.ndarray) -> Mode:
    k = len(model.A)
    shape = (model.directions.q[:, :k] @ vector).astype(complex)
    largest = shape[np.argmax(np.abs(shape))] if shape.size else 1.0
    if abs(largest) <= 1e-12 * np.max(np.abs(vector)):  # a first-order state alone
        largest = vector[np.argmax(np.abs(vector))]
    size = abs(value)
    ratio = -value.real / size if size > 0 else 0.0
    return Mode(value, size / (2 * np.pi), ratio, shape / largest, vector / largest, model)
