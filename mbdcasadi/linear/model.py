"""Linear models: matrices with names, eigenvalues, modes, transfer functions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import matrix_balance

from ..equations.numeric import NumericEquations
from ..equations.recovery import Recovery
from ..errors import MechanismError, warn
from ..model.quantities import whole
from ..model.symbols import number
from ..numerics.lazy import cached_property, optional_package
from ..results.state import Arrays, State
from ..results.steps import Direct
from ..results.trajectory import Trajectory
from .directions import Directions

#: Eigenvalues below this share of the largest one belong to rigid-body motions if A has a null space.
RIGID = 1e-6
#: Time over which A is looked at, in units of the inverse of the fastest rate, and its relative change that counts.
STEP, VARYING = 1e-5, 1e-3


class LinearModel:
    """``ẋ = A x + B u``, ``y = C x + D u`` for small changes about a state.

    Attributes
    ----------
    A, B, C, D : numpy.ndarray
        (k, k), (k, n_u), (n_y, k), (n_y, n_u).
    state_names, input_names, output_names : tuple of str
        Names of rows and columns.
    state : State
        State about which the model is linear.
    rate : numpy.ndarray
        ``ẋ`` at that state (k,).
    directions : Directions
        Derivatives of all coordinates, velocities, accelerations and multipliers by x.
    """

    def __init__(
        self,
        A: np.ndarray,
        B: np.ndarray,
        C: np.ndarray,
        D: np.ndarray,
        *,
        state_names: tuple[str, ...],
        input_names: tuple[str, ...],
        output_names: tuple[str, ...],
        state: State,
        rate: np.ndarray,
        directions: Directions,
        speeds: int,
        later: Callable[[float], np.ndarray] | None = None,
    ):
        self.A, self.B, self.C, self.D = A, B, C, D
        self.state_names, self.input_names, self.output_names = state_names, input_names, output_names
        self.state, self.rate, self.directions = state, rate, directions
        #: number of states that are positions
        self.speeds = speeds
        self._later = later

    @property
    def eigenvalues(self) -> np.ndarray:
        """Eigenvalues of A, slowest first, rad/s."""
        values = np.linalg.eigvals(self.A)
        return values[np.lexsort((values.imag, np.round(np.abs(values), 12)))]

    @cached_property
    def is_steady(self) -> bool:
        """True if the state rests or moves steadily: velocities and first-order states do not change, and A neither."""
        changing = slice(self.speeds, None)
        rates = (self.rate / self._sizes)[changing]
        slopes = (self.A * self._sizes / self._sizes[:, None])[changing]
        scale = 1 + np.max(np.abs(slopes), initial=0.0)
        return bool(np.all(np.abs(rates) <= 1e-6 * scale)) and not self._changes_in_time()

    @property
    def _sizes(self) -> np.ndarray:
        """Typical size of each state (k,): that of the coordinate that it moves most; one for a first-order state."""
        coordinates = self.directions.numeric.scale.coordinates[:, None]
        motions = len(self.A) - len(self.state.z)
        moved = np.where(
            np.arange(motions) < self.speeds, self.directions.q[:, :motions], self.directions.v[:, :motions]
        )
        largest = np.max(np.abs(moved) / coordinates, axis=0, initial=0.0)
        return np.r_[1 / np.where(largest > 0, largest, 1.0), np.ones(len(self.state.z))]

    def _changes_in_time(self) -> bool:
        """True if A changes along the motion by a part that counts while its fastest mode takes its course."""
        if self._later is None or not self.A.size:
            return False
        turning = np.abs(self.state.v[self.state.equations.angles])
        fastest = max(np.max(np.abs(self.eigenvalues)), np.max(turning, initial=0.0))
        step = STEP / fastest if fastest > 0 else STEP
        size = np.max(np.abs(self.A), axis=1, keepdims=True)
        return bool(np.any(np.abs(self._later(step) - self.A) > VARYING * STEP * size))

    def modes(self) -> tuple[Mode, ...]:
        """Modes, slowest first: one for each pair of complex eigenvalues, each real one, each rigid-body motion.

        Returns
        -------
        tuple of Mode
            ``.frequency`` (Hz, undamped), ``.damping_ratio``, ``.eigenvalue``, ``.shape`` (n, complex, over q).

        Warns
        -----
        MechanismWarning
            If the state is neither at rest nor in steady motion, or A changes in time: modes then say little.
        """
        if not self.is_steady:
            warn(
                "modes: the state is neither an equilibrium nor in steady motion as its coordinates "
                f"({', '.join(self.state_names[: self.speeds])}) show it, or the forces depend on time; its "
                "eigenvalues do not describe its further motion. For a steady rotation give linearize coordinates= "
                "that stay constant and turn with it, such as a relative angle or the displacement in a guide"
            )
        if not self.A.size:
            return ()
        values, vectors = np.linalg.eig(self.A)
        rigid, left_out = _rigid_motions(self.A, values)
        modes = [_mode(self, 0j, vector) for vector in rigid.T]
        for k in np.argsort(np.abs(values), kind="stable"):
            if k not in left_out and values[k].imag >= 0:
                modes.append(_mode(self, complex(values[k]), vectors[:, k]))
        return tuple(modes)

    # --- transfer functions ---------------------------------------------------------------
    def transfer_function(self, s: Any) -> np.ndarray:
        """``G(s) = C (s I - A)⁻¹ B + D``.

        Parameters
        ----------
        s : complex or sequence of complex
            rad/s; ``2j * np.pi * frequencies`` gives the frequency response.

        Returns
        -------
        numpy.ndarray
            (n_y, n_u), or (n_s, n_y, n_u) for a sequence.

        Raises
        ------
        MechanismError
            At a pole.
        """
        points = _points(s, "transfer_function: s")
        matrices = points[:, None, None] * np.eye(len(self.A)) - self.A
        try:
            inner = np.linalg.solve(matrices, np.broadcast_to(self.B, (points.size, *self.B.shape)))
        except np.linalg.LinAlgError:
            raise MechanismError("transfer_function: s is a pole of the model; evaluate next to it") from None
        response = self.C @ inner + self.D
        return response[0] if np.ndim(s) == 0 else response

    def frequency_response(self, frequencies: Any) -> np.ndarray:
        """``G(2 π i f)`` at frequencies in Hz: (n_f, n_y, n_u), complex."""
        return self.transfer_function(2j * np.pi * _points(frequencies, "frequency_response: frequencies").real)

    def to_control(self) -> Any:
        """Return a ``control.StateSpace`` with the names of states, inputs and outputs."""
        control = optional_package("control", "to_control", "analysis")
        return control.ss(
            self.A,
            self.B,
            self.C,
            self.D,
            states=_plain(self.state_names),
            inputs=_plain(self.input_names),
            outputs=_plain(self.output_names),
        )

    def to_scipy(self) -> Any:
        """Return a ``scipy.signal.StateSpace``."""
        from scipy.signal import StateSpace

        return StateSpace(self.A, self.B, self.C, self.D)

    def __repr__(self) -> str:
        text = f"LinearModel: states {', '.join(self.state_names) or 'none'}"
        text += f"; inputs {', '.join(self.input_names)}" if self.input_names else ""
        text += f"; outputs {', '.join(self.output_names)}" if self.output_names else ""
        return text + f"\n  eigenvalues {np.array2string(self.eigenvalues, precision=5, separator=', ')}"


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
        Shape over the states of the model.
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
        def at(times: np.ndarray) -> Arrays:
            since = times - self.model.state.t
            return self._states(since, phase[0] + since * (phase[-1] - phase[0]) / (t[-1] or 1.0), amplitude, damped)

        point = self.model.state
        time = point.t + t
        return Trajectory(point.mechanism, time, *at(time), point.parameters, interpolation=Direct(at, time))

    def _states(self, t: np.ndarray, phase: np.ndarray, amplitude: float, damped: bool) -> Arrays:
        """``q, v, a, z, lam, u`` at times since the start, by row."""
        point, d = self.model.state, self.model.directions
        size = number(amplitude, "mode", "amplitude") * (np.exp(self.eigenvalue.real * t) if damped else 1.0)
        turn = size * np.exp(1j * phase)
        k = len(self.model.A)

        def part(base: np.ndarray, change: np.ndarray) -> np.ndarray:
            return base + np.real(np.outer(turn, change[:, :k] @ self.vector))

        recovery = Recovery(NumericEquations(point.equations, point.parameters), redundant=True)
        fixed = np.full(t.size, point.t)
        a, z, lam = part(point.a, d.a), part(point.z, d.z), part(point.lam, d.lam)
        q = recovery.positions(fixed, part(point.q, d.q), z)
        v = recovery.velocities(fixed, q, part(point.v, d.v), z)
        return q, v, a, z, lam, part(point.inputs, d.u)

    def __repr__(self) -> str:
        damped = f"damping ratio {self.damping_ratio:.4g}"
        return f"Mode: {self.frequency:.6g} Hz, {damped}, eigenvalue {self.eigenvalue:.6g} rad/s"


def _rigid_motions(a: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, set[int]]:
    """Null space of A, and the eigenvalues that belong to it.

    A rigid-body motion is a double eigenvalue zero with one vector, which rounding splits into two of the size of its
    square root. It is a single one if something slows the motion: no state moves towards that vector then.
    """
    # entries that are nothing but rounding would make sizes of them
    a = np.where(np.abs(a) > np.finfo(float).eps ** 2 * np.max(np.abs(a), initial=0.0), a, 0.0)
    balanced, (sizes, _) = matrix_balance(a, permute=False, separate=True)
    # rates of stiff and of soft parts differ in size
    largest = np.max(np.abs(balanced), axis=1)
    weights = 1 / np.where(largest > 0, largest, 1.0)
    left, singular, right = np.linalg.svd(weights[:, None] * balanced)
    count = int(np.sum(singular <= 1e-11 * singular[0])) if singular[0] > 0 else len(a)
    vectors = right[len(a) - count :].T
    single = np.linalg.matrix_rank(left[:, len(a) - count :].T @ _unit(weights[:, None] * vectors), tol=1e-12)
    near = RIGID * max(float(np.max(np.abs(values))), np.finfo(float).tiny)
    small = [int(k) for k in np.argsort(np.abs(values)) if abs(values[k]) <= near]
    return _unit(sizes[:, None] * vectors), set(small[: 2 * count - single])


def _unit(vectors: np.ndarray) -> np.ndarray:
    """Columns of length one."""
    return vectors / np.linalg.norm(vectors, axis=0)


def _mode(model: LinearModel, value: complex, vector: np.ndarray) -> Mode:
    k = len(model.A)
    shape = (model.directions.q[:, :k] @ vector).astype(complex)
    largest = shape[np.argmax(np.abs(shape))] if shape.size else 1.0
    if abs(largest) <= 1e-12 * np.max(np.abs(vector)):  # a first-order state alone
        largest = vector[np.argmax(np.abs(vector))]
    size = abs(value)
    ratio = -value.real / size if size > 0 else 0.0
    return Mode(value, size / (2 * np.pi), ratio, shape / largest, vector / largest, model)


def _points(values: Any, what: str) -> np.ndarray:
    """Finite complex numbers (k,)."""
    try:
        points = np.atleast_1d(np.asarray(values, complex))
    except (TypeError, ValueError):
        points = np.array([np.nan])
    if points.ndim > 1 or not np.all(np.isfinite(points)):
        raise MechanismError(f"{what} must be a finite number or a sequence of them, got {values!r}")
    return points


def _plain(names: tuple[str, ...]) -> list[str]:
    """Names as python-control takes them: a dot separates a system from its signal there."""
    return [name.replace(".", "_") for name in names]
