"""Explicit dependence of the equations of a mechanism on time: instants of switching, and constraints that jump."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ...model.cache import ExpressionKey
from ...numerics.lazy import cached_property
from ...numerics.scattered import scattered
from ...numerics.tolerances import MET
from ..derivation import Equations
from .time_breaks import AWAY_FROM_CORNERS, TimeBreaks, TimeFunctions, merge_breaks, resolution

#: Derivatives by which what depends on time enters the accelerations and rates; if these jump, an integrator restarts.
_ENTERS = {"position": 2, "velocity": 1, "force": 0, "rate": 0}
#: Highest derivative at whose jump an integrator restarts. A state that is the integral of a function of time alone has
#: corrections by its slope only: past a symmetric corner the error test of a multistep method may see none.
_RESTARTS = _ENTERS | {"rate": 1}
#: Points between two instants at which it is looked at what passes between them, as shares.
_BETWEEN = np.array([0.23, 0.5, 0.77])
#: Difference of two estimates of the size of a jump, relative to it, that is rounding.
ROUNDED_SIZE = 1e-3
#: Change of the estimated pose before rows are evaluated in it: in a special pose a jump may vanish.
_GENERIC = 1e-3


@dataclass(frozen=True)
class ConstraintJump:
    """A constraint row whose prescribed position or velocity jumps in time.

    Attributes
    ----------
    element : str
        The driver or joint, with its kind: ``driver 'hoist'``.
    row : str
        Name of the row.
    time : float
        s.
    level : {"position", "velocity"}
        No motion follows a position that jumps; a velocity that jumps takes an impulse.
    size : float
        By how much, in `unit`.
    unit : str
        m, rad, m/s or rad/s.
    """

    element: str
    row: str
    time: float
    level: str
    size: float
    unit: str

    def __str__(self) -> str:
        size = f"{abs(self.size):.6g} {self.unit}"
        return f"the prescribed {self.level} of {self.element} jumps by {size} at t = {self.time:.12g} s"

    @property
    def remedy(self) -> str:
        """Advice, in words."""
        if self.level == "position":
            return "no motion follows a jump; prescribe a transition over some time, as mbd.step does"
        return "that takes an impulse; round the corner off, as mbd.step and cubic splines do"


def explicit_time(eom: Equations, inputs: ca.SX | None = None, integrands: ca.SX | None = None) -> ExplicitTime:
    """:class:`ExplicitTime` of the equations; kept for a mechanism and for what contains the time."""
    cache = eom.mechanism.cache
    expressions = [e for e in (inputs, integrands) if e is not None]
    if not any(e.numel() and ca.depends_on(e, eom.t) for e in expressions):
        return cache.get_or_create("explicit time", lambda: ExplicitTime(eom))
    key = ("explicit time", inputs is None, *map(ExpressionKey, expressions))
    return cache.get_or_create(key, lambda: ExplicitTime(eom, inputs, integrands), bounded=True)


class ExplicitTime:
    """Dependence of the equations of motion on time itself.

    Parameters
    ----------
    inputs : casadi.SX, optional
        The inputs as expressions (n_u,), of which those in time are substituted.
    integrands : casadi.SX, optional
        Expressions that are integrated along the motion.

    Attributes
    ----------
    depends : bool
        True if a constraint, a force, the rate of a first-order state or an integrand depends on time.
    """

    def __init__(self, eom: Equations, inputs: ca.SX | None = None, integrands: ca.SX | None = None):
        self._eom = eom
        self._integrands = [] if integrands is None else ca.vertsplit(ca.vec(integrands))
        self._inputs = eom.u if inputs is None else inputs
        self._timed_inputs = [k for k in range(eom.u.numel()) if ca.depends_on(self._inputs[k], eom.t)]
        self._groups: dict[str, TimeFunctions] = {}
        everything = ca.vertcat(eom.Phi, eom.velocity_rows, eom.Q, eom.z_rate, *self._integrands)
        if self._timed_inputs or ca.depends_on(everything, eom.t):
            self._collect()
        self.depends = bool(self._groups)

    def _collect(self) -> None:
        """Group what depends on time by how it enters the accelerations."""
        eom = self._eom
        constraints = [e for e in eom.mechanism.constraints if self._is_timed(ca.vertcat(e.rows, e.velocity_rows))]
        positions = [row for e in constraints for row in ca.vertsplit(e.rows)]
        velocities = [row for e in constraints for row in ca.vertsplit(e.velocity_rows)]
        velocities += [rate for _, rate in self._followed_rates]
        forces = [ca.vec(ca.SX(x)) for e in eom.mechanism.elements for pair in e.virtual_work for x in pair]
        rates = [*map(ca.SX, eom.mechanism.state_rates.values()), *self._integrands]
        forces, rates = ([self._substituted(x) for x in part if self._is_timed(x)] for part in (forces, rates))
        groups = {"position": positions, "velocity": velocities, "force": forces, "rate": rates}
        self._groups = {kind: self._functions(ca.vertcat(*rows)) for kind, rows in groups.items() if rows}

    @cached_property
    def _followed_rates(self) -> list[tuple[int, ca.SX]]:
        """Rows that follow states, and the velocities that they prescribe, of those that depend on time."""
        rates = [(row, self._eom.nu[row]) for row in self._eom.following_rows]
        return [(row, rate) for row, rate in rates if self._is_timed(rate)]

    def _is_timed(self, expression: ca.SX) -> bool:
        symbols = {symbol.element_hash() for symbol in ca.symvar(expression)}
        timed = (self._eom.t, *(self._eom.u[k] for k in self._timed_inputs))
        return any(symbol.element_hash() in symbols for symbol in timed)

    def _substituted(self, expression: ca.SX) -> ca.SX:
        if not self._timed_inputs:
            return expression
        return ca.substitute(expression, self._eom.u[self._timed_inputs], self._inputs[self._timed_inputs])

    @cached_property
    def _typical(self) -> tuple[ca.SX, np.ndarray]:
        """All symbols but time and parameters, with values near to the estimates."""
        eom = self._eom
        symbols = eom.q, eom.v, eom.z, eom.a, eom.lam, eom.u
        values = [*eom.estimate, np.ones(eom.a.numel()), np.ones(eom.lam.numel()), eom.input_values]
        near = np.concatenate(values)
        return ca.vertcat(*symbols), near + _GENERIC * scattered(near.size)

    def _functions(self, expression: ca.SX) -> TimeFunctions:
        return TimeFunctions(expression, self._eom.t, self._eom.p, self._typical)

    @property
    def parameters(self) -> frozenset[int]:
        """Positions of the parameters that occur in what depends on time."""
        return frozenset(int(k) for group in self._groups.values() for k in group.used)

    @property
    def switches(self) -> ca.SX:
        """Functions of time and parameters at whose zeros something switches (k,)."""
        return ca.vertcat(ca.SX(0, 1), *[group.switches for group in self._groups.values()])

    def breaks(self, p: np.ndarray, start: float, end: float) -> tuple[TimeBreaks, np.ndarray]:
        """Return the instants at which anything switches in time, and at which accelerations jump.

        Parameters
        ----------
        start, end : float
            The interval, s; its ends do not count.

        Returns
        -------
        TimeBreaks
            All instants; ``.order`` counts derivatives of what switches itself.
        numpy.ndarray of bool
            At which of them accelerations jump, so that an integrator must start again (k,); at the others
            it may continue, but must not step over them.
        """
        breaks = {kind: group.breaks(p, start, end) for kind, group in self._groups.items()}
        whole = merge_breaks(list(breaks.values()))
        restart = np.zeros(whole.times.size, bool)
        for kind, part in breaks.items():
            jumps = part.times[part.order <= _RESTARTS[kind]]
            # the same instants: the merging took the first of those that are one
            restart[np.searchsorted(whole.times, jumps + whole.width, side="right") - 1] = True
        return whole, restart

    def hidden_between(self, p: np.ndarray, times: np.ndarray) -> np.ndarray:
        """Return instants inside those intervals at whose ends a load does not show that passes between them.

        An integrator that stops at both ends of a pulse alone, where it is zero, would step over it.

        Parameters
        ----------
        times : numpy.ndarray
            Ends of the intervals, in pairs (k, 2), s.
        """
        if not times.size:
            return np.zeros(0)
        low, gap = times[:, :1], np.diff(times, axis=1)
        shares = np.r_[1e-9, _BETWEEN, 1 - 1e-9]
        hidden = np.zeros(len(times), bool)
        for kind, group in self._groups.items():
            with np.errstate(invalid="ignore", over="ignore"):
                values = group.values(p, (low + gap * shares).ravel())[_ENTERS[kind]].reshape(
                    -1, len(times), shares.size
                )
                first, last = values[:, :, :1], values[:, :, -1:]
                off = np.max(np.abs(values - first - (last - first) * shares), axis=2)
                size = np.max(np.where(np.isfinite(values), np.abs(values), 0.0), axis=(1, 2), keepdims=True)
                hidden |= np.any(off > np.abs(last - first)[:, :, 0] + MET * size[:, :, 0], axis=0)
        return (low + gap * _BETWEEN)[hidden].ravel()

    # --- constraints that jump -----------------------------------------------------------------
    @cached_property
    def _rows(self) -> list[tuple[str, int, TimeFunctions]]:
        """Constraint rows that switch in time, each with its level and place."""
        eom = self._eom
        places = {"position": eom.position_rows, "velocity": np.setdiff1d(range(eom.lam.numel()), eom.position_rows)}
        rows = []
        for level, expression in (("position", eom.Phi), ("velocity", eom.velocity_rows)):
            for place, row in zip(places[level], ca.vertsplit(expression), strict=True):
                if level in self._groups and self._is_timed(row):
                    rows.append((level, int(place), self._functions(row)))
        rows += [("velocity", row, self._functions(rate)) for row, rate in self._followed_rates]
        return [entry for entry in rows if entry[2].switch]

    @property
    def has_switching_rows(self) -> bool:
        """True if a constraint row switches in time, so that what it prescribes may jump."""
        return bool(self._rows)

    def jumps(self, p: np.ndarray, start: float, end: float) -> list[ConstraintJump]:
        """Return the constraint rows whose position or velocity jumps between two times, both included, in order.

        At the ends of the interval the value there itself is one of the two sides.
        """
        jumps: list[ConstraintJump] = []
        margin = 4 * resolution(start, end)
        levels = ("position", "velocity")
        groups = [
            self._groups[level].breaks(p, start - margin, end + margin) for level in levels if level in self._groups
        ]
        if not any(np.any(group.order < 2) for group in groups) or not end > start:
            return []
        for level, place, functions in self._rows:
            jumps += self._row_jumps(level, place, functions, p, (start, end))
        return sorted(jumps, key=lambda jump: jump.time)

    def _row_jumps(
        self, level: str, place: int, row: TimeFunctions, p: np.ndarray, interval: tuple[float, float]
    ) -> list[ConstraintJump]:
        eom = self._eom
        start, end = interval
        margin = 4 * resolution(start, end)
        times = row.breaks(p, start - margin, end + margin).times
        if not times.size:
            return []
        left, right, rounding = row.sides(p, start - margin, times, end + margin)
        for side, edge, at in ((left, start, times <= start + margin), (right, end, times >= end - margin)):
            if np.any(at):
                side[:, :, at] = row.values(p, np.array([edge]))
        smoother = row.sides(p, start - margin, times, end + margin, AWAY_FROM_CORNERS)[:2]
        element = eom.row_elements[place].description
        unit = "rad" if eom.angular_rows[place] else "m"
        jumps = []
        for k, time in enumerate(times):
            for order, rate in enumerate(("position", "velocity") if level == "position" else ("velocity",)):
                before, after = float(left[order, 0, k]), float(right[order, 0, k])
                # NaN beyond the data of a spline is reported as such, by the run that comes there
                if np.isfinite(before) and np.isfinite(after) and abs(after - before) > rounding[order, 0, k]:
                    units = unit if rate == "position" else f"{unit}/s"
                    name = eom.row_names[place]
                    size, refined = after - before, float(smoother[1][order, 0, k] - smoother[0][order, 0, k])
                    size = refined if abs(refined - size) < ROUNDED_SIZE * abs(size) else size
                    jumps.append(ConstraintJump(element, name, float(time), rate, size, units))
                    break
        return jumps


def first_jump(jumps: Sequence[ConstraintJump]) -> ConstraintJump | None:
    """Return the first jump of a position, or None."""
    return next((jump for jump in jumps if jump.level == "position"), None)
