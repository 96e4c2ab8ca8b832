"""Linear models: matrices with names, eigenvalues, modes, transfer functions."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import MechanismError
from ..results.state import State
from .directions import Directions

if TYPE_CHECKING:
    from .vibration_modes import Mode


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
    ):
        self.A, self.B, self.C, self.D = A, B, C, D
        self.state_names, self.input_names, self.output_names = state_names, input_names, output_names
        self.state, self.rate, self.directions = state, rate, directions
        #: how many of the states are positions
        self.speeds = speeds

    @property
    def eigenvalues(self) -> np.ndarray:
        """Eigenvalues of A, slowest first, rad/s."""
        values = np.linalg.eigvals(self.A)
        return values[np.lexsort((values.imag, np.round(np.abs(values), 12)))]

    @property
    def is_steady(self) -> bool:
        """True if the state rests or moves steadily: velocities and first-order states do not change."""
        rates = self.rate[self.speeds :]
        scale = 1 + np.max(np.abs(self.A[self.speeds :]), initial=0.0)
        return bool(np.all(np.abs(rates) <= 1e-6 * scale))

    def modes(self) -> tuple[Mode, ...]:
        """Modes, slowest first: one for each pair of complex eigenvalues, each real one, each rigid-body motion.

        Returns
        -------
        tuple of Mode
            ``.frequency`` (Hz, undamped), ``.damping_ratio``, ``.eigenvalue``, ``.shape`` (n, complex, over q).

        Warns
        -----
        MechanismWarning
            If the state is neither at rest nor in steady motion: modes then say little.
        """
        from .vibration_modes import modes_of

        return modes_of(self)

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
            raise MechanismError("transfer_function: s is a pole of the model; evaluate beside it") from None
        response = self.C @ inner + self.D
        return response[0] if np.ndim(s) == 0 else response

    def frequency_response(self, frequencies: Any) -> np.ndarray:
        """``G(2 π i f)`` at frequencies in Hz: (n_f, n_y, n_u), complex."""
        return self.transfer_function(2j * np.pi * _points(frequencies, "frequency_response: frequencies").real)

    def to_control(self) -> Any:
        """Return a ``control.StateSpace`` with the names of states, inputs and outputs."""
        control = _imported("control", "to_control", "control")
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
        return _imported("scipy.signal", "to_scipy", "scipy").StateSpace(self.A, self.B, self.C, self.D)

    def __repr__(self) -> str:
        text = f"LinearModel: states {', '.join(self.state_names) or 'none'}"
        text += f"; inputs {', '.join(self.input_names)}" if self.input_names else ""
        text += f"; outputs {', '.join(self.output_names)}" if self.output_names else ""
        return text + f"\n  eigenvalues {np.array2string(self.eigenvalues, precision=5, separator=', ')}"


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


def _imported(module: str, method: str, package: str) -> Any:
    import importlib

    try:
        return importlib.import_module(module)
    except ImportError:
        raise MechanismError(f"{method} needs {package}; install it by pip install {package}") from None
