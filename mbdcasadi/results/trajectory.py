"""A motion: states over a grid of times."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from ..equations import Equations, equations
from ..errors import MechanismError
from ..model.mechanism import Mechanism
from .state import State

if TYPE_CHECKING:
    import pandas
    import xarray


@dataclass(frozen=True)
class Energy:
    """Energy over time, each (n,), J.

    Attributes
    ----------
    kinetic : numpy.ndarray
        ``½ v^T M v``.
    potential : numpy.ndarray
        Of gravity and linear springs; forces with laws of their own have none.
    """

    kinetic: np.ndarray
    potential: np.ndarray

    @property
    def total(self) -> np.ndarray:
        """Kinetic and potential energy, J."""
        return self.kinetic + self.potential


@dataclass(frozen=True)
class Drift:
    """How far a motion leaves its constraints.

    Attributes
    ----------
    position : float
        Largest ``|Phi|`` (m or rad).
    velocity : float
        Largest ``|Phi_q v - nu|`` (m/s or rad/s).
    """

    position: float
    velocity: float


@dataclass(frozen=True)
class EventOccurrence:
    """An event that took place.

    Attributes
    ----------
    name : str
        Name of the event.
    t : float
        Time, s.
    state : State
        State at that time.
    """

    name: str
    t: float
    state: State


@dataclass
class Statistics:
    """How a trajectory was computed.

    Attributes
    ----------
    method : str
        Integrator or solver.
    formulation : str
        Form of the equations it was given.
    seconds : float
        Wall-clock time of the run, s.
    restarts : int
        How often the integrator was started.
    notes : list of str
        What the user should know of the result.
    """

    method: str = ""
    formulation: str = ""
    seconds: float = 0.0
    restarts: int = 0
    notes: list[str] = field(default_factory=list)


class Trajectory:
    """States of a mechanism at times; ``motion[expression]`` evaluates anything.

    Parameters
    ----------
    mechanism : Mechanism
        The model.
    t : numpy.ndarray
        Times (n_t,), s.
    q, v, a, z, lam, u : numpy.ndarray
        By time: (n_t, n) coordinates and rates, (n_t, k) first-order states,
        (n_t, m) multipliers, (n_t, n_u) inputs.
    p : numpy.ndarray
        Parameter values.
    events : sequence of EventOccurrence, optional
        Events that took place.
    statistics : Statistics, optional
        How it was computed.
    refine : callable, optional
        ``refine(t, q, v, z, u) -> (q, v, a, lam, u)`` brings interpolated values
        back onto the constraints; see :meth:`at`.
    missing_multipliers : str, optional
        Why there are no multipliers, where there are none.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        t: np.ndarray,
        q: np.ndarray,
        v: np.ndarray,
        a: np.ndarray,
        z: np.ndarray,
        lam: np.ndarray,
        u: np.ndarray,
        p: np.ndarray,
        *,
        events: Sequence[EventOccurrence] = (),
        statistics: Statistics | None = None,
        refine: Callable[..., tuple[np.ndarray, ...]] | None = None,
        missing_multipliers: str = "",
    ):
        self.mechanism = mechanism
        self.t = np.asarray(t, float)
        self.q, self.v, self.a, self.z, self.lam, self.inputs = (
            np.asarray(x, float).reshape(self.t.size, -1) for x in (q, v, a, z, lam, u)
        )
        self.parameters = np.asarray(p, float).ravel()
        self.events = tuple(events)
        self.statistics = statistics or Statistics()
        self._refine = refine
        self._missing_multipliers = missing_multipliers

    # --- evaluation ------------------------------------------------------------------
    @property
    def equations(self) -> Equations:
        """Equations of motion of the mechanism."""
        return equations(self.mechanism)

    def __len__(self) -> int:
        return self.t.size

    def __getitem__(self, expression: Any) -> np.ndarray:
        """Values of an expression over time: (n_t,), (n_t, k), or (n_t, i, j) for a matrix."""
        expression = ca.SX(expression)
        function = self.equations.function(expression)
        if self._missing_multipliers and ca.depends_on(ca.vec(expression), self.equations.lam):
            raise MechanismError(self._missing_multipliers)
        rows, columns = expression.shape
        count = self.t.size
        if count == 0:
            return np.zeros((0, rows, columns)).reshape((0,) if rows * columns == 1 else (0, rows * columns))
        stacked = function(
            self.t[None, :], self.q.T, self.v.T, self.a.T, self.z.T, self.lam.T, self.inputs.T, self.parameters
        ).full()
        if stacked.shape[1] == columns:  # nothing in it varies: CasADi evaluated it once
            stacked = np.tile(stacked, (1, count))
        values = stacked.reshape(rows, count, columns).transpose(1, 0, 2)
        if rows * columns == 1:
            return values.reshape(count)
        return values.reshape(count, -1) if 1 in (rows, columns) else values

    def state(self, index: int) -> State:
        """State at one of the times, by index."""
        k = int(index)
        return State(
            self.mechanism,
            float(self.t[k]),
            self.q[k],
            self.v[k],
            self.a[k],
            self.z[k],
            self.lam[k],
            self.inputs[k],
            self.parameters,
            obstacle=MechanismError(self._missing_multipliers) if self._missing_multipliers else None,
        )

    @property
    def initial(self) -> State:
        """First state."""
        return self.state(0)

    @property
    def final(self) -> State:
        """Last state."""
        return self.state(-1)

    def at(self, times: Any) -> Trajectory:
        """Return the trajectory at other times within its span.

        Coordinates follow quintic Hermite polynomials through positions,
        velocities and accelerations and are brought back onto the constraints;
        accelerations and multipliers come from the equations of motion there.

        Parameters
        ----------
        times : float or sequence of float
            Times, s.

        Raises
        ------
        MechanismError
            For times outside the trajectory.
        """
        wanted = np.atleast_1d(np.asarray(times, float))
        slack = 1e-12 * max(1.0, abs(self.t[-1]))
        outside = (wanted < self.t[0] - slack) | (wanted > self.t[-1] + slack) | ~np.isfinite(wanted)
        if np.any(outside):
            raise MechanismError(
                f"the trajectory covers t = {self.t[0]:.6g} … {self.t[-1]:.6g} s, not t = {wanted[outside][0]:.6g} s"
            )
        if self._refine is None:
            raise MechanismError(
                "this trajectory was read from arrays and knows no way to interpolate between its times"
            )
        wanted = np.clip(wanted, self.t[0], self.t[-1])
        q, v = _hermite(self.t, self.q, self.v, self.a, wanted)
        z = _linear(self.t, self.z, wanted)
        u = _linear(self.t, self.inputs, wanted)
        q, v, a, lam, u = self._refine(wanted, q, v, z, u)
        return Trajectory(
            self.mechanism,
            wanted,
            q,
            v,
            a,
            z,
            lam,
            u,
            self.parameters,
            refine=self._refine,
            missing_multipliers=self._missing_multipliers,
        )

    # --- quantities of the whole motion ---------------------------------------------------
    @property
    def energy(self) -> Energy:
        """Kinetic and potential energy over time, J."""
        eom = self.equations
        return Energy(self[eom.kinetic], self[eom.potential])

    @property
    def drift(self) -> Drift:
        """Largest violation of the constraints at position and velocity level."""
        eom = self.equations
        if not eom.lam.numel() or not self.t.size:
            return Drift(0.0, 0.0)
        position = self[eom.Phi] if eom.Phi.numel() else np.zeros(1)
        velocity = self[eom.Phi_q @ eom.v - eom.nu]
        return Drift(float(np.max(np.abs(position))), float(np.max(np.abs(velocity))))

    # --- where people work ------------------------------------------------------------------
    def to_pandas(self, expressions: dict[str, Any] | None = None) -> pandas.DataFrame:
        """Return a DataFrame over time; without expressions the columns of :meth:`to_csv`."""
        from .export import to_pandas

        return to_pandas(self, expressions)

    def to_xarray(self, expressions: dict[str, Any] | None = None) -> xarray.Dataset:
        """Return a Dataset over time; without expressions coordinates, rates and multipliers."""
        from .export import to_xarray

        return to_xarray(self, expressions)

    def to_csv(self, path: str | Path, expressions: dict[str, Any] | None = None) -> None:
        """Write a table: ``t``, coordinates by body, reactions on body b by joint, efforts by driver."""
        from .export import to_csv

        to_csv(self, path, expressions)

    def save(self, path: str | Path) -> None:
        """Write all arrays to a ``.npz`` file; ``read_trajectory(path, mechanism)`` reads it."""
        from .export import save

        save(self, path)

    def __repr__(self) -> str:
        if not self.t.size:
            return "Trajectory: no times"
        drift = self.drift
        text = (
            f"Trajectory of {self.mechanism.name or 'a mechanism'}: {self.t.size} times, "
            f"t = {self.t[0]:.6g} … {self.t[-1]:.6g} s, drift {drift.position:.1e} (position), "
            f"{drift.velocity:.1e} (velocity)"
        )
        s = self.statistics
        if s.method:
            text += f"\n  {s.method}" + (f", {s.formulation}" if s.formulation else "") + f", {s.seconds:.3g} s"
        text += "".join(f"\n  event '{e.name}' at t = {e.t:.6g} s" for e in self.events)
        return text + "".join(f"\n  note: {note}" for note in s.notes)


def _bracket(t: np.ndarray, wanted: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Index of the interval of each wanted time, its width and the share passed, as columns."""
    k = np.clip(np.searchsorted(t, wanted, side="right") - 1, 0, max(t.size - 2, 0))
    if t.size == 1:
        return k, np.ones((wanted.size, 1)), np.zeros((wanted.size, 1))
    h = (t[k + 1] - t[k])[:, None]
    return k, h, (wanted - t[k])[:, None] / h


def _hermite(t: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray, wanted: np.ndarray):
    """Quintic Hermite interpolation of positions, and its derivative."""
    k, h, s = _bracket(t, wanted)
    if t.size == 1:
        return q[k], v[k]
    q0, q1, v0, v1, a0, a1 = q[k], q[k + 1], h * v[k], h * v[k + 1], h**2 * a[k], h**2 * a[k + 1]
    rise = q1 - q0
    c3 = 10 * rise - 6 * v0 - 4 * v1 - 1.5 * a0 + 0.5 * a1
    c4 = -15 * rise + 8 * v0 + 7 * v1 + 1.5 * a0 - a1
    c5 = 6 * rise - 3 * v0 - 3 * v1 - 0.5 * a0 + 0.5 * a1
    position = q0 + s * (v0 + s * (a0 / 2 + s * (c3 + s * (c4 + s * c5))))
    velocity = (v0 + s * (a0 + s * (3 * c3 + s * (4 * c4 + s * 5 * c5)))) / h
    return position, velocity


def _linear(t: np.ndarray, values: np.ndarray, wanted: np.ndarray) -> np.ndarray:
    k, _, s = _bracket(t, wanted)
    if t.size == 1 or values.shape[1] == 0:
        return values[k]
    return values[k] + s * (values[k + 1] - values[k])
