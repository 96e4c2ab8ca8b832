"""The motion over an output grid as one function, put together from pieces and cuts."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from ..arguments.values import RunValues
from ..equations.recovery import Recovery
from ..integrators.compiled import MAX_STEPS
from ..simulation.schedule import Piece, Schedule
from .cuts import Cut, Cuts
from .held_system import HeldMotion


def motion_function(held: HeldMotion, course: Cuts, grid: np.ndarray, values: RunValues, pieces: float) -> ca.Function:
    """Return ``(x0, p, levels, channel, cuts, sides, borders) -> (X, end)`` over a grid.

    Parameters
    ----------
    values : RunValues
        Symbols of the parameters and inputs.
    pieces : int
        Number of pieces at whose ends the state is brought back onto the constraints, besides the cuts; rounded.
    """
    x0 = ca.MX.sym("x0", held.system.state_size)
    cuts, sides, borders = course.symbols
    walk = _Walk(held, course, grid, values, pieces)
    walk.run(x0, cuts, sides, borders)
    names = ["x0", *RunValues._fields, "cuts", "sides", "borders"]
    results = [ca.horzcat(*walk.columns), walk.end()]
    return ca.Function("motion", [x0, *values, cuts, sides, borders], results, names, ["X", "end"])


class _Walk:
    """Traversal of the grid, piece by piece; its arguments are those of :func:`motion_function`.

    Attributes
    ----------
    columns : list of casadi.MX
        States at the outputs, with the integrals and the clock of the whole.
    """

    def __init__(self, held: HeldMotion, course: Cuts, grid: np.ndarray, values: RunValues, pieces: float):
        self._held, self._course, self._grid, self._count = held, course, grid, pieces
        self._p, self._levels, self._channel = values
        self._sampled = held.system.signals.is_sampled
        self._piece, self._begin, self._on_constraints = 0, float(grid[0]), True
        self.columns: list[ca.MX] = []

    def run(self, x0: ca.MX, times: ca.MX, sides: ca.MX, borders: ca.MX) -> None:
        """Go over the grid.

        Parameters
        ----------
        x0 : casadi.MX
            Start ``(q, v, z)``.
        times, borders : casadi.MX
            Times and borders of the cuts.
        sides : casadi.MX
            Sides of the switches by piece (switches, pieces).
        """
        self._sides, self._x = sides, ca.vertcat(x0, ca.MX.zeros(self._held.system.integrands.numel() + 1))
        self.columns.append(self._x)
        by_interval: dict[int, list[int]] = {}
        for k, cut in enumerate(self._course.cuts):
            by_interval.setdefault(cut.interval, []).append(k)
        interval, last = 0, self._grid.size - 1
        while interval < last:
            if interval in by_interval:
                self._cut_interval(interval, by_interval[interval], times, borders)
                interval += 1
                continue
            end = min([k for k in by_interval if k > interval], default=last)
            for piece in self._pieces(self._grid[interval : end + 1]):
                self._fixed(piece)
            interval = end

    def end(self) -> ca.MX:
        """The state on the constraints, after all cuts, without the clock."""
        return self._projected(float(self._grid[-1]))[:-1]

    def _pieces(self, grid: np.ndarray) -> list[Piece]:
        """Pieces of a stretch without cuts: up to jumps of the equations, and ends at which drift is taken away."""
        course, intervals = self._course, grid.size - 1
        schedule = Schedule(grid, stops=course.stops, jumps=course.jumps)
        count = max(1, min(intervals, round(self._count * intervals / (self._grid.size - 1))))
        ends = grid[[part[-1] + 1 for part in np.array_split(np.arange(intervals), count)]]
        ends = ends if self._held.backwards is None else np.r_[ends, course.stops]
        lasts = {schedule.index_after(float(end) + schedule.tolerance) - 1 for end in ends}
        pieces, first, start = [], 0, float(grid[0])
        while first < schedule.size:
            last = min([schedule.next_break(first), *[k for k in lasts if k >= first]])
            pieces.append(schedule.piece(start, first, last))
            first, start = last + 1, float(schedule.times[last])
        return pieces

    def _parameters(self, piece: int) -> ca.MX:
        return ca.vertcat(self._p, self._sides[:, piece])

    def _columns_of(self, intervals: int | list[int]) -> ca.MX | None:
        """Values of the channel in output intervals; None if nothing is sampled."""
        return self._channel[:, intervals] if self._sampled else None

    def _project(self) -> None:
        if not self._on_constraints:
            self._x, self._on_constraints = self._projected(self._begin), True

    def _projected(self, time: Any) -> ca.MX:
        return projected(self._held.system.recovery, time, self._x, self._parameters(self._piece))

    def _fixed(self, piece: Piece) -> None:
        """Go over a piece between times of the grid."""
        self._project()
        start, times = piece.inside
        length = float(times[-1] - start)
        fractions = np.r_[(times[:-1] - start) / length, 1.0]
        interval = np.clip(np.searchsorted(self._grid, piece.begins, side="right") - 1, 0, self._grid.size - 2)
        columns = self._columns_of(interval.tolist())
        states = self._integrated(start, length, columns, length, fractions, piece.stops)
        self.columns.append(states[:, np.flatnonzero(piece.requested).tolist()])
        self._x, self._begin, self._on_constraints = states[:, -1], float(piece.times[-1]), False

    def _moving(self, interval: int, end: Any) -> None:
        """Go over a piece of which one end, or both, are arguments."""
        self._project()
        longest = float(self._grid[interval + 1] - self._grid[interval])
        columns, at_end = self._columns_of(interval), np.ones(1)
        self._x = self._integrated(self._begin, end - self._begin, columns, longest, at_end, np.zeros(1, bool))
        self._begin, self._on_constraints = end, False

    def _cut_interval(self, interval: int, cuts: Sequence[int], times: ca.MX, borders: ca.MX) -> None:
        """Go over an output interval with cuts in it."""
        for k in cuts:
            cut = self._course.cuts[k]
            if not cut.joined:
                self._moving(interval, times[k])
            self._project()
            if cut.at_output and not cut.joined:
                self.columns.append(self._x)
            if cut.switches:
                columns = self._columns_of(interval)
                self._x = self._through(cut, times[k], borders[k], ca.MX(0, 1) if columns is None else columns)
            self._piece = k + 1
        if not self._course.cuts[cuts[-1]].at_output:
            self._moving(interval, float(self._grid[interval + 1]))
            self.columns.append(self._x)

    def _integrated(
        self, start: Any, length: Any, channel: ca.MX | None, longest: float, fractions: np.ndarray, stops: np.ndarray
    ) -> ca.MX:
        """States, with the clock of the whole, at fractions of a piece (n_x, k).

        Parameters
        ----------
        longest : float
            Length that the piece has at most, s.
        """
        held, x = self._held, self._x
        least_steps = held.compiled.least_steps(longest, self._course.max_step)
        # the rate at which drift decays in the regularised form comes last
        p = ca.vertcat(start, length, self._parameters(self._piece), self._levels, held.decay)
        arguments: dict[str, Any] = {"x0": ca.vertcat(x[:-1], 0), "p": p}
        if held.unknowns.size:
            arguments["z0"] = held.unknowns
        if held.backwards is not None:
            assert not np.any(stops[:-1])
            arguments |= {} if channel is None else {"u": channel}
            function = held.backwards.function(fractions, least_steps=least_steps)
        else:
            inputs = held.compiled.inputs(None if channel is None else np.zeros(channel.shape), stops, fractions.size)
            if inputs["u"] is not None:
                stop = ca.MX(ca.DM(inputs["u"][0 if channel is None else channel.shape[0] :, :]))
                arguments["u"] = stop if channel is None else ca.vertcat(channel, stop)
            function = held.compiled.function(
                fractions, groups=inputs["groups"], steps=MAX_STEPS, least_steps=least_steps
            )
        states = function(**arguments)["xf"]
        return ca.vertcat(states[:-1, :], x[-1] + length * states[-1, :])

    def _through(self, cut: Cut, time: ca.MX, border: ca.MX, channel: ca.MX) -> ca.MX:
        """The state beyond a cut, as a function of the state at its time and of the parameters before and after it."""
        system, y = self._held.system, self._x[:-1]
        p, after = self._parameters(self._piece), self._parameters(self._piece + 1)
        w, rates, before = system.switching(time, y, p, self._levels, channel)
        first = cut.switches[0]
        delta = (border - w[first]) / rates[first]
        y = y + before * delta
        if cut.impulse:
            n, mass = system.numeric.eom.q.numel(), system.numeric.mass_of_impulses
            weights = ca.DM(np.where(mass > 0, mass, system.numeric.weights))
            v, z = y[n : 2 * n], y[2 * n : 2 * n + system.numeric.eom.z.numel()]
            for _ in range(2):  # the second step removes the regularisation of the first
                v = system.recovery.velocity_step(time, y[:n], v, z, after, weights)[0]
            y = ca.vertcat(y[:n], v, y[2 * n :])
        return ca.vertcat(y - system.rates(time, y, after, self._levels, channel) * delta, self._x[-1])


def projected(recovery: Recovery, time: Any, x: Any, p: Any) -> Any:
    """Return a state, with the components that follow it, brought onto the constraints by one step."""
    eom, n = recovery.numeric.eom, recovery.numeric.eom.q.numel()
    q, v, z = x[:n], x[n : 2 * n], x[2 * n : 2 * n + eom.z.numel()]
    weights = ca.DM(recovery.numeric.projection_weights)
    if eom.Phi.numel():
        q = recovery.position_step(time, q, z, p, weights)[0]
    if eom.lam.numel():
        v = recovery.velocity_step(time, q, v, z, p, weights)[0]
    return ca.vertcat(q, v, x[2 * n :])
