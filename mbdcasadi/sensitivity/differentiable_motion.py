"""The motion from a start over an output grid as one function, and expressions along it.

Accelerations and multipliers at outputs come from the equations of motion
there, after a step back onto the constraints; so derivatives of reactions are
exact, forward and adjoint, which those through the algebraic outputs of IDAS are not.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from ..arguments.inputs import Signals
from ..equations.numeric import NumericEquations
from ..equations.recovery import Recovery
from ..errors import ModelError
from ..integrators import Integrator
from ..integrators.compiled import MAX_STEPS, CompiledIntegrator
from ..numerics.console import call
from ..numerics.least_squares import largest
from ..simulation.formulations import choose_formulation
from ..simulation.gap_closings import has_gaps
from ..simulation.schedule import PIECES, WATCH_POINTS, Piece, Schedule
from ..simulation.stepping import DECAY, perturbed

#: Drift of the positions that is left, in tolerances: it is gone at the outputs, and what it does to the motion is
#: then of the size of the integrator's own error.
ACCEPTED = 10.0


class DifferentiableMotion:
    """A simulation as functions of ``(x0, p, levels, channel)``.

    Parameters
    ----------
    numeric : NumericEquations
        Equations at parameters that are typical.
    signals : Signals
        Inputs; their levels are arguments.
    grid : numpy.ndarray
        Output times (n_t,), s.
    integrator : Integrator
        Method and tolerances.
    redundant : bool
        Whether rows are dependent.
    integrands : casadi.SX, optional
        Expressions whose integrals over time are states of their own.
    unknowns : numpy.ndarray, optional
        Accelerations and multipliers at the start (n + m,), from which IDAS looks for consistent ones.
    stops, jumps : numpy.ndarray, optional
        Times over which no step may go, and at which the equations jump.
    max_step : float, optional
        Longest step, s.
    """

    def __init__(
        self,
        numeric: NumericEquations,
        signals: Signals,
        grid: np.ndarray,
        integrator: Integrator,
        *,
        redundant: bool = False,
        integrands: ca.SX | None = None,
        unknowns: np.ndarray | None = None,
        stops: np.ndarray | None = None,
        jumps: np.ndarray | None = None,
        max_step: float | None = None,
    ):
        if signals.controller or signals.polynomials:
            raise ModelError(
                "inputs= takes numbers, samples and expressions here; a SampledController or the polynomials of an "
                "optimal solution cannot be differentiated or compiled: give samples of them"
            )
        self.numeric, self.grid, self.redundant, self.signals = numeric, grid, redundant, signals
        self._stops, self._jumps, self._max_step = stops, jumps, max_step
        self._abstol = integrator.abstol
        self.form = choose_formulation(numeric, integrator, redundant=redundant)
        self.integrals = 0 if integrands is None else integrands.numel()
        self._dae = self.form.dae(numeric, signals, integrands)
        if integrator.is_multistep:
            # gradients by parameters are quadratures of the adjoint: outside the error test they were off by a quarter
            # where the adjoint itself is so simple that IDAS takes steps as long as the motion
            integrator = integrator.replace(options={"quad_err_con": True} | dict(integrator.options))
            if has_gaps(numeric.eom.mechanism):  # free flight has steps that jump over short contacts
                limits = [x for x in (max_step, float(grid[-1] - grid[0]) / WATCH_POINTS) if x is not None]
                self._max_step = min(limits)
        self._compiled = CompiledIntegrator(self._dae, integrator)
        self._recovery = Recovery(numeric, redundant=redundant)
        # from zero the search of IDAS for forces that depend on reactions, |λ|, may fail
        self._unknowns = perturbed(unknowns) if unknowns is not None and self._dae.z.numel() else None
        #: pieces of the whole motion, at whose ends the state is brought back onto the constraints
        self.pieces = 1
        if integrator.is_multistep and self.integrals and self.signals.is_sampled:
            # CasADi does not restart IDAS where samples change, and repeats stretches of the motion with the samples
            # of another interval for the adjoint: gradients were off by up to a third, and where the repetition took
            # more steps than the motion it ended the process. Each interval is an integration of its own.
            self.pieces = grid.size - 1

    @property
    def channel_size(self) -> tuple[int, int]:
        """Rows and columns of the channel of sampled inputs."""
        rows = self.signals.channel.numel()
        return rows, self.grid.size - 1 if rows else 0

    def channel(self) -> np.ndarray:
        """Values of the channel as the inputs were given."""
        found = self.signals.channel_from(self.grid[:-1])
        return np.zeros(self.channel_size) if found is None else found

    def _stretch(self, first: int, last: int) -> np.ndarray:
        """Times of the grid from one to another, both included."""
        return self.grid[first:] if last == -1 else self.grid[first : last + 1]

    def motion(self, first: int = 0, last: int = -1) -> ca.Function:
        """Return ``(x0, p, levels, channel) -> X`` over the grid, or from one of its times to another.

        The states stand by column (n_x, n_t): ``(q, v, z)``, integrals, and a
        clock. Pieces of equal steps share a compiled integrator.
        """
        grid = self._stretch(first, last)
        schedule = Schedule(grid, stops=self._stops, jumps=self._jumps)
        size, rows = self._dae.x.numel() - self.integrals, self.channel_size[0]
        x0, p = ca.MX.sym("x0", size), ca.MX.sym("p", self.numeric.eom.p.numel())
        levels = ca.MX.sym("levels", self.signals.levels.numel())
        channel = ca.MX.sym("channel", rows, grid.size - 1 if rows else 0)
        columns = [ca.vertcat(x0, ca.MX.zeros(self.integrals + 1))]
        now, begin = columns[0], float(grid[0])
        for start, piece in self._cut(schedule, grid):
            if start > 0:
                now = self._projected(begin, now, p)
            interval = np.clip(np.searchsorted(grid, piece.begins, side="right") - 1, 0, grid.size - 2)
            inputs = channel[:, interval.tolist()] if rows else None
            states = self._over(piece, now, p, levels, inputs)
            columns.append(states[:, np.flatnonzero(piece.wanted).tolist()])
            now, begin = states[:, -1], float(piece.times[-1])
        states = ca.horzcat(*columns)
        return ca.Function("motion", [x0, p, levels, channel], [states], ["x0", "p", "levels", "channel"], ["X"])

    def _cut(self, schedule: Schedule, grid: np.ndarray) -> list[tuple[int, Piece]]:
        """Pieces of a stretch: up to jumps of the equations, and ends at which the state is brought back."""
        intervals = grid.size - 1
        count = max(1, min(intervals, round(self.pieces * intervals / (self.grid.size - 1))))
        ends = grid[[part[-1] + 1 for part in np.array_split(np.arange(intervals), count)]]
        lasts = {schedule.index_after(float(end) + schedule.tolerance) - 1 for end in ends}
        pieces, first, start = [], 0, float(grid[0])
        while first < schedule.size:
            last = min([schedule.next_break(first), *[k for k in lasts if k >= first]])
            pieces.append((first, schedule.piece(start, first, last)))
            first, start = last + 1, float(schedule.times[last])
        return pieces

    def _over(self, piece: Piece, begin: ca.MX, p: ca.MX, levels: ca.MX, channel: ca.MX | None) -> ca.MX:
        """States at the times of a piece (n_x, k), with the clock of the whole stretch."""
        start, times = piece.inside
        length, count = float(times[-1] - start), times.size
        fractions = np.r_[(times[:-1] - start) / length, 1.0]
        given = self._compiled.inputs(None if channel is None else np.zeros(channel.shape), piece.stops, count)
        function = self._compiled.function(
            fractions,
            groups=given["groups"],
            steps=MAX_STEPS,
            least_steps=self._compiled.least_steps(length, self._max_step),
        )
        passed = begin[-1]
        # the rate at which drift decays in the regularised form comes last
        rate = DECAY * PIECES / float(self.grid[-1] - self.grid[0])
        arguments: dict[str, Any] = {
            "x0": ca.vertcat(begin[:-1], 0),
            "p": ca.vertcat(start, length, p, levels, rate),
        }
        if self._unknowns is not None:
            arguments["z0"] = self._unknowns
        if given["u"] is not None:
            stop = ca.MX(ca.DM(given["u"][0 if channel is None else channel.shape[0] :, :]))
            arguments["u"] = stop if channel is None else ca.vertcat(channel, stop)
        states = function(**arguments)["xf"]
        return ca.vertcat(states[:-1, :], passed + length * states[-1, :])

    def _projected(self, time: Any, x: Any, p: Any) -> Any:
        """A state, with whatever stands below it, brought onto the constraints."""
        eom, n = self.numeric.eom, self.numeric.eom.q.numel()
        q, v, weights = x[:n], x[n : 2 * n], ca.DM(self.numeric.projection_weights)
        if eom.Phi.numel():
            q = self._recovery.position_step(time, q, p, weights)[0]
        if eom.lam.numel():
            v = self._recovery.velocity_step(time, q, v, p, weights)
        return ca.vertcat(q, v, x[2 * n :])

    def cut_where_it_drifts(self, x0: np.ndarray) -> None:
        """Cut the motion into as many pieces as keep its drift near the tolerance, by one run from `x0`.

        Drift grows with the square of the time since the state was last on the
        constraints; each cut starts the integrator again, which costs.
        """
        try:
            states = call(self.motion(), x0, self.numeric.p, self.signals.level_values, self.channel()).full()
        except RuntimeError:
            return  # the run itself will say what is wrong
        if not self.reached(states) or not self.numeric.eom.Phi.numel():
            return
        n = self.numeric.eom.q.numel()
        drift = max(
            largest(self.numeric.position(float(t), q)[0]) for t, q in zip(self.grid, states[:n].T, strict=True)
        )
        needed = np.clip(np.ceil(np.sqrt(drift / (ACCEPTED * self._abstol))), 1, min(PIECES, self.grid.size - 1))
        self.pieces = max(self.pieces, int(needed))

    def reached(self, states: np.ndarray, first: int = 0) -> bool:
        """Whether an integration got to its end: its clock tells, and that all is finite."""
        offsets = self.grid[first:][: states.shape[1]] - self.grid[first]
        on_time = np.abs(states[-1] - offsets) <= 1e-6 * offsets[-1]
        return bool(np.all(np.isfinite(states))) and bool(np.all(on_time))

    # --- outputs -------------------------------------------------------------------------
    def outputs(self, expressions: Sequence[ca.SX], first: int = 0, last: int = -1) -> ca.Function:
        """Return ``(X, p, levels, channel) -> Y``: expressions, stacked, at every output of a stretch (n_y, n_t)."""
        eom = self.numeric.eom
        at_one = self._at_one_output(ca.vertcat(ca.SX(0, 1), *[ca.vec(e) for e in expressions]))
        grid = self._stretch(first, last)
        n_t, rows = grid.size, self.channel_size[0]
        states = ca.MX.sym("X", self._dae.x.numel() + 1, n_t)
        p, levels = ca.MX.sym("p", eom.p.numel()), ca.MX.sym("levels", self.signals.levels.numel())
        channel = ca.MX.sym("channel", rows, n_t - 1 if rows else 0)
        # the interval that ends at an output holds its inputs too; the first output takes the first interval
        before = [max(k - 1, 0) for k in range(n_t)]
        by_output = channel[:, before] if rows else ca.MX(0, n_t)
        values = at_one.map(n_t)(
            ca.DM(grid).T, states[:-1, :], ca.repmat(p, 1, n_t), ca.repmat(levels, 1, n_t), by_output
        )
        names = ["X", "p", "levels", "channel"]
        return ca.Function("outputs", [states, p, levels, channel], [values], names, ["Y"])

    def _at_one_output(self, expression: ca.SX) -> ca.Function:
        """``(t, x, p, levels, channel) -> values`` at one output."""
        eom, kind = self.numeric.eom, ca.MX if self.numeric.eom.Q_depends_on_lam else ca.SX
        given = [
            kind.sym(name, size)
            for name, size in (
                ("t", 1),
                ("x", self._dae.x.numel()),
                ("p", eom.p.numel()),
                ("levels", self.signals.levels.numel()),
                ("channel", self.channel_size[0]),
            )
        ]
        t, x, p, levels, channel = given
        n, k = eom.q.numel(), eom.z.numel()
        x = self._projected(t, x, p)
        q, v, z = x[:n], x[n : 2 * n], x[2 * n : 2 * n + k]
        signals = self.signals
        known = [eom.t, eom.q, eom.v, eom.z, eom.p, signals.levels, signals.channel]
        inputs = ca.Function("u", known, [signals.parametrised])
        u = inputs(t, q, v, z, p, levels, channel)
        a, lam = self.numeric.forward_dynamics(redundant=self.redundant)(t, q, v, z, u, p)
        values = eom.function(expression)(t, q, v, a, z, lam, u, p)
        return ca.Function("output", given, [values])
