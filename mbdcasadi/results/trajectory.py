"""A motion: states over a grid of times."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from ..equations.public import Equations, equations
from ..errors import MechanismError
from ..model.forces.friction.modes import switches
from ..model.immutable import HoldsSymbols
from ..model.mechanism import Mechanism
from ..model.symbols import Expression, as_expression
from ..numerics.lazy import cached_property
from ..numerics.real import real_array
from .export import to_csv, to_pandas, to_xarray
from .extrema import Extremum, extremum
from .finite import refuse_nan
from .motion import Drift, Energy, Statistics
from .notebook import html_table
from .saving import save
from .state import Arguments, EventOccurrence, State, six
from .steps import Interpolation
from .summary import summary_lines

#: Parts into which the time between two knots is divided for lines and extrema; knots from which on it is not.
PARTS, MANY = 4, 20_000


class Trajectory(HoldsSymbols):
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
        Statistics of the run.
    interpolation : Interpolation, optional
        The motion between the times; see :meth:`at`.
    missing_multipliers : str, optional
        Reason if there are no multipliers.
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
        interpolation: Interpolation | None = None,
        missing_multipliers: str = "",
    ):
        self.mechanism = mechanism
        self.t = np.asarray(t, float)
        count = self.t.size
        self.q, self.v, self.a, self.z, self.lam, self.inputs = [
            np.asarray(x, float).reshape(count, size)
            for x, size in zip((q, v, a, z, lam, u), self.equations.sizes, strict=True)
        ]
        self.parameters = np.asarray(p, float).ravel()
        self.events = tuple(events)
        self.statistics = statistics or Statistics()
        self.interpolation = interpolation
        self.missing_multipliers = missing_multipliers

    # --- evaluation ------------------------------------------------------------------
    @property
    def equations(self) -> Equations:
        """Equations of motion of the mechanism."""
        return equations(self.mechanism)

    def __len__(self) -> int:
        return self.t.size

    #: not a sequence: NumPy would ask for motion[0], motion[1], … as expressions
    __iter__ = None

    def __getitem__(self, expression: Expression) -> np.ndarray:
        """Values of an expression over time: (n_t,), (n_t, k), or (n_t, i, j) for a matrix.

        Raises
        ------
        ExpressionError
            For a symbol that the mechanism does not have, and if the expression has no value.
        """
        expression = as_expression(expression, "motion[…]")
        function, arguments = self._compiled(expression)
        if self.missing_multipliers and ca.depends_on(ca.vec(expression), self.equations.lam):
            raise MechanismError(self.missing_multipliers)
        rows, columns = expression.shape
        count = self.t.size
        if count == 0:
            values = np.zeros((0, rows, columns))
        else:
            stacked = function(*[x.T for x in arguments]).full()
            if stacked.shape[1] == columns:  # nothing in it varies: CasADi evaluated it once
                stacked = np.tile(stacked, (1, count))
            values = stacked.reshape(rows, count, columns).transpose(1, 0, 2)
            refuse_nan(self.equations, expression, values, arguments[: len(self.equations.symbols)])
        if rows * columns == 1:
            return values.reshape(count)
        return values.reshape(count, rows * columns) if 1 in (rows, columns) else values

    @property
    def arguments(self) -> Arguments:
        """``(t, q, v, a, z, lam, u, p)`` for compiled expressions, by time (n_t, k); the parameters are (1, k)."""
        return self.t[:, None], self.q, self.v, self.a, self.z, self.lam, self.inputs, self.parameters[None, :]

    def _compiled(self, expression: ca.SX) -> tuple[ca.Function, tuple[np.ndarray, ...]]:
        """Function of an expression, and its arguments by time."""
        return self.equations.function(expression), self.arguments

    def place(self, index: int) -> int:
        """Return an index of the times that is not negative, or raise an error if there is no such time."""
        k = int(index)
        if not -self.t.size <= k < self.t.size:
            raise MechanismError(f"the trajectory has {self.t.size} times, and none of index {k}")
        return k % self.t.size

    def state(self, index: int) -> State:
        """State at one of the times, by index."""
        k = self.place(index)
        obstacle = MechanismError(self.missing_multipliers) if self.missing_multipliers else None
        return State(self.mechanism, self.t[k], *six(x[k] for x in self.arguments[1:-1]), self.parameters, obstacle)

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

        It is as accurate as one with outputs there. A motion of :func:`simulate` follows polynomials of degree five
        through positions, velocities and accelerations if these meet the equations of motion between the outputs;
        else it is integrated again there, which is kept. Positions and velocities are brought back onto the
        constraints; accelerations and multipliers come from the equations of motion. At the instant of a jump it is
        the motion just before.

        Parameters
        ----------
        times : float or sequence of float
            Times, s.

        Raises
        ------
        MechanismError
            For times outside the trajectory.
        """
        wanted = self._within(times)
        return self._at(wanted, *self._between().at(wanted))

    def maximum(self, expression: Expression) -> Extremum:
        """Return the largest value of a scalar over the motion, with ``.value``, ``.t`` and ``.state``.

        It is that of the motion, wherever it lies between the outputs; at jumps the values just before and just after
        count.

        Parameters
        ----------
        expression : expression
            A scalar: a coordinate, the size of a reaction, a power, …

        Raises
        ------
        MechanismError
            For other than a scalar, and for a trajectory that cannot be interpolated.

        Examples
        --------
        >>> motion.maximum(mbd.norm(pin.reaction_on(rod).force)).value  # doctest: +SKIP
        71.63
        """
        return extremum(self, expression, 1, "maximum")

    def minimum(self, expression: Expression) -> Extremum:
        """Return the smallest value of a scalar over the motion; see :meth:`maximum`."""
        return extremum(self, expression, -1, "minimum")

    @property
    def knots(self) -> np.ndarray:
        """Times between which polynomials of degree five follow the motion, s; both sides of each jump.

        They are found by going through the whole motion; see :meth:`at`.

        Raises
        ------
        MechanismError
            For a trajectory that was made from arrays alone.
        """
        if self.t.size < 2:
            return self.t
        return self._between().knots(float(self.t[0]), float(self.t[-1]))

    @property
    def fine(self) -> Trajectory:
        """The motion at its knots and at times between them, such that lines through them are smooth to the eye.

        One that was made from arrays alone is known at its outputs only: itself.
        """
        # a trajectory that kept itself would stay in memory until the garbage collector comes
        return self._fine if self.t.size > 1 and self.interpolates else self

    @cached_property
    def _fine(self) -> Trajectory:
        knots = self.knots
        parts = PARTS if knots.size <= MANY else 1
        between = knots[:-1, None] + np.arange(parts) / parts * np.diff(knots)[:, None]
        return self.at(np.unique(np.append(between, knots[-1])))

    def _between(self) -> Interpolation:
        if self.interpolation is None:
            raise MechanismError("this trajectory was made from arrays and cannot be interpolated between its times")
        return self.interpolation

    def _within(self, times: Any) -> np.ndarray:
        """Return times as an array; raise an error if one is not within the span."""
        try:
            wanted = np.atleast_1d(real_array(times))
        except (TypeError, ValueError):
            raise MechanismError(f"at() takes times as numbers, got {times!r}") from None
        if not self.t.size or not wanted.size:
            raise MechanismError(
                "a trajectory of no times cannot be interpolated" if wanted.size else "at() needs at least one time"
            )
        slack = 1e-12 * max(1.0, abs(self.t[-1]))
        outside = (wanted < self.t[0] - slack) | (wanted > self.t[-1] + slack) | ~np.isfinite(wanted)
        if np.any(outside):
            raise MechanismError(
                f"the trajectory covers t = {self.t[0]:.6g} … {self.t[-1]:.6g} s, not t = {wanted[outside][0]:.6g} s"
            )
        return np.clip(wanted, self.t[0], self.t[-1])

    @property
    def phases(self) -> tuple[Trajectory, ...]:
        """The motion in each mechanism, one after the other: this one alone, unless the mechanism changes."""
        return (self,)

    @property
    def parameters_by_phase(self) -> list[np.ndarray]:
        """Values of the parameters of all mechanisms, by phase."""
        return [self.parameters]

    @property
    def interpolates(self) -> bool:
        """True if :meth:`at` can interpolate; False if the trajectory was made from arrays alone."""
        return self.interpolation is not None

    def _at(self, t: np.ndarray, *arrays: np.ndarray) -> Trajectory:
        """Trajectory at other times, from ``q, v, a, z, lam, u``."""
        more: dict[str, Any] = {"interpolation": self.interpolation, "missing_multipliers": self.missing_multipliers}
        return Trajectory(self.mechanism, t, *six(arrays), self.parameters, **more)

    # --- quantities of the whole motion ---------------------------------------------------
    @property
    def energy(self) -> Energy:
        """Kinetic and potential energy over time, J."""
        eom = self.equations
        return Energy(self[eom.kinetic], self[eom.potential])

    @property
    def drift(self) -> Drift:
        """Largest violation of the constraints at position and velocity level."""
        if not self.t.size:
            return Drift(0.0, 0.0)
        return Drift(*(float(np.max(sizes)) for sizes in self.violations))

    @property
    def violations(self) -> tuple[np.ndarray, np.ndarray]:
        """Largest ``|Phi|`` and largest ``|Phi_q v - nu|`` over time, each (n_t,).

        Rows that hold in some modes only (stick and slip) do not count at velocity level; of a motion through several
        mechanisms the rows of each one count as long as it holds.
        """
        eom = self.equations
        always = [k for k, element in enumerate(eom.row_elements) if not switches(element)]
        rows = self[eom.Phi], self[(eom.Phi_q @ eom.v - eom.nu)[always]]
        position, velocity = (np.max(np.abs(x.reshape(len(self), -1)), axis=1, initial=0.0) for x in rows)
        return position, velocity

    to_pandas, to_xarray, to_csv, save = to_pandas, to_xarray, to_csv, save

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

    def _repr_html_(self) -> str:
        """Outputs, energy, drift, efforts and largest reactions as a table, for notebooks."""
        if not self.t.size:
            return html_table(repr(self), [])
        lines = summary_lines(self)
        return html_table(f"Trajectory of {self.mechanism.name or 'a mechanism'}", lines[1:])
