"""The motion from a start over an output grid as one function, and expressions along it.

Accelerations and multipliers at outputs come from the equations of motion
there, after a step back onto the constraints; so derivatives of reactions are
exact, forward and adjoint, which those through the algebraic outputs of IDAS are not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from ..arguments.inputs import Signals
from ..equations.numeric import NumericEquations
from ..equations.recovery import Recovery
from ..errors import ModelError, SimulationError
from ..integrators.integration import MAX_STEPS, Integrator
from ..numerics.console import call
from ..numerics.least_squares import largest
from ..simulation.chunks import CHUNKS, WATCH_POINTS
from ..simulation.formulations import METHODS, choose
from ..simulation.resolution import has_gaps
from ..simulation.stepping import DECAY, beside
from ..simulation.tolerances import absolute_tolerance

#: Drift of the positions that is left, in tolerances: it is gone at the outputs, and what it does to the motion is
#: then of the size of the integrator's own error.
ACCEPTED = 10.0


class Flow:
    """A simulation as functions of ``(x0, p, shifts, channel)``, with constant shifts added to the inputs.

    Parameters
    ----------
    numeric : NumericEquations
        Equations at parameters that are typical.
    signals : Signals
        Inputs.
    grid : numpy.ndarray
        Output times (n_t,), s.
    method : {"idas", "erk", "rosenbrock"}
        Integrator.
    redundant : bool
        Whether rows are dependent.
    reltol, abstol : float
        Tolerances.
    integrands : casadi.SX, optional
        Expressions whose integrals over time are states of their own.
    unknowns : numpy.ndarray, optional
        Accelerations and multipliers at the start (n + m,), from which IDAS looks for consistent ones.
    """

    def __init__(
        self,
        numeric: NumericEquations,
        signals: Signals,
        grid: np.ndarray,
        *,
        method: str = "idas",
        redundant: bool = False,
        reltol: float = 1e-8,
        abstol: float = 1e-8,
        integrands: ca.SX | None = None,
        unknowns: np.ndarray | None = None,
    ):
        if method not in METHODS:
            raise SimulationError(f"method must be one of {', '.join(METHODS)}, got {method!r}")
        if signals.controller or signals.pieces:
            raise ModelError(
                "inputs= takes numbers, samples and expressions here; a SampledController or the polynomials of an "
                "optimal solution cannot be differentiated or compiled: give samples of them"
            )
        self.numeric, self.grid, self.redundant, self._abstol = numeric, grid, redundant, abstol
        self.shifts = ca.SX.sym("shift", numeric.eom.u.numel())
        self.signals = replace(signals, expressions=signals.expressions + self.shifts)
        self.form = choose(numeric, method, redundant=redundant)
        self.integrals = 0 if integrands is None else integrands.numel()
        dae = self.form.dae(numeric, self.signals, integrands)
        self._dae = replace(dae, p=ca.vertcat(dae.p, self.shifts))
        # gradients by parameters are quadratures of the adjoint: outside the error test they were off by a quarter
        # where the adjoint itself is so simple that IDAS takes steps as long as the motion
        options: dict[str, Any] = {"quad_err_con": True} if method == "idas" else {}
        if method == "idas" and has_gaps(numeric.eom.mechanism):  # free flight has steps that jump over short contacts
            options["max_step_size"] = float(grid[-1] - grid[0]) / WATCH_POINTS
        self._integrator = Integrator(self._dae, method, reltol, absolute_tolerance(numeric, abstol), options=options)
        self._recovery = Recovery(numeric, redundant=redundant)
        # from zero the search of IDAS for forces that depend on reactions, |λ|, may fail
        self._unknowns = beside(unknowns) if unknowns is not None and self._dae.z.numel() else None
        #: pieces of the whole motion, at whose ends the state is brought back onto the constraints
        self.pieces = 1
        if method == "idas" and self.integrals and self.signals.is_sampled:
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
        if not self.signals.is_sampled:
            return np.zeros(self.channel_size)
        return self.signals.channel_values(self.grid, np.zeros(0))

    def _stretch(self, first: int, last: int) -> np.ndarray:
        """Times of the grid from one to another, both included."""
        return self.grid[first:] if last == -1 else self.grid[first : last + 1]

    def motion(self, first: int = 0, last: int = -1) -> ca.Function:
        """``(x0, p, shifts, channel) -> X`` over the grid, or from one of its times to another.

        The states stand by column (n_x, n_t): ``(q, v, z)``, integrals, and a
        clock. Stretches of equal steps share a compiled integrator.
        """
        grid = self._stretch(first, last)
        eom = self.numeric.eom
        size = self._dae.x.numel() - self.integrals
        rows = self.channel_size[0]
        x0, p = ca.MX.sym("x0", size), ca.MX.sym("p", eom.p.numel())
        shifts = ca.MX.sym("shifts", self.shifts.numel())
        channel = ca.MX.sym("channel", rows, grid.size - 1 if rows else 0)
        columns = [ca.vertcat(x0, ca.MX.zeros(self.integrals + 1))]
        for piece in self._pieces_of(grid.size - 1):
            now = columns[-1][:, -1]
            begin = now if len(columns) == 1 else self._projected(float(grid[piece[0]]), now, p)
            columns.append(
                self._over(grid[piece[0] : piece[-1] + 2], begin, p, shifts, channel[:, piece] if rows else None)
            )
        states = ca.horzcat(*columns)
        return ca.Function("motion", [x0, p, shifts, channel], [states], ["x0", "p", "shifts", "channel"], ["X"])

    def _pieces_of(self, intervals: int) -> list[list[int]]:
        """Intervals of a stretch in pieces, at whose ends the state is brought back onto the constraints."""
        count = max(1, min(intervals, round(self.pieces * intervals / (self.grid.size - 1))))
        return [part.tolist() for part in np.array_split(np.arange(intervals), count)]

    def _over(self, grid: np.ndarray, begin: ca.MX, p: ca.MX, shifts: ca.MX, channel: ca.MX | None) -> ca.MX:
        """States at the later times of a grid."""
        duration = float(self.grid[-1] - self.grid[0])
        arguments: dict[str, Any] = {
            "x0": begin,
            # the start of the run, the parameters, and the rate at which drift decays in the regularised form
            "p": ca.vertcat(float(grid[0]), p, DECAY * CHUNKS / duration, shifts),
        }
        if self._unknowns is not None:
            arguments["z0"] = self._unknowns
        if channel is not None:
            arguments["u"] = channel
        return self._integrator.function(grid[1:] - grid[0], MAX_STEPS)(**arguments)["xf"]

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
        p, shifts = self.numeric.p, np.zeros(self.shifts.numel())
        try:
            states = call(self.motion(), x0, p, shifts, self.channel()).full()
        except RuntimeError:
            return  # the run itself will say what is wrong
        if not self.reached(states) or not self.numeric.eom.Phi.numel():
            return
        n = self.numeric.eom.q.numel()
        drift = max(
            largest(self.numeric.position(float(t), q)[0]) for t, q in zip(self.grid, states[:n].T, strict=True)
        )
        needed = np.clip(np.ceil(np.sqrt(drift / (ACCEPTED * self._abstol))), 1, min(CHUNKS, self.grid.size - 1))
        self.pieces = max(self.pieces, int(needed))

    def reached(self, states: np.ndarray, first: int = 0) -> bool:
        """Whether an integration got to its end: its clock tells, and that all is finite."""
        offsets = self.grid[first:][: states.shape[1]] - self.grid[first]
        on_time = np.abs(states[-1] - offsets) <= 1e-6 * offsets[-1]
        return bool(np.all(np.isfinite(states))) and bool(np.all(on_time))

    # --- outputs -------------------------------------------------------------------------
    def outputs(self, expressions: Sequence[ca.SX], first: int = 0, last: int = -1) -> ca.Function:
        """``(X, p, shifts, channel) -> Y``: expressions, stacked, at every output of a stretch (n_y, n_t)."""
        eom = self.numeric.eom
        at_one = self._at_one_output(ca.vertcat(ca.SX(0, 1), *[ca.vec(e) for e in expressions]))
        grid = self._stretch(first, last)
        n_t, rows = grid.size, self.channel_size[0]
        states = ca.MX.sym("X", self._dae.x.numel() + 1, n_t)
        p, shifts = ca.MX.sym("p", eom.p.numel()), ca.MX.sym("shifts", self.shifts.numel())
        channel = ca.MX.sym("channel", rows, n_t - 1 if rows else 0)
        # the interval that ends at an output holds its inputs too; the first output takes the first interval
        before = [max(k - 1, 0) for k in range(n_t)]
        by_output = channel[:, before] if rows else ca.MX(0, n_t)
        values = at_one.map(n_t)(
            ca.DM(grid).T, states[:-1, :], ca.repmat(p, 1, n_t), ca.repmat(shifts, 1, n_t), by_output
        )
        names = ["X", "p", "shifts", "channel"]
        return ca.Function("outputs", [states, p, shifts, channel], [values], names, ["Y"])

    def _at_one_output(self, expression: ca.SX) -> ca.Function:
        """``(t, x, p, shifts, channel) -> values`` at one output."""
        eom, kind = self.numeric.eom, ca.MX if self.numeric.eom.Q_depends_on_lam else ca.SX
        given = [
            kind.sym(name, size)
            for name, size in (
                ("t", 1),
                ("x", self._dae.x.numel()),
                ("p", eom.p.numel()),
                ("shifts", self.shifts.numel()),
                ("channel", self.channel_size[0]),
            )
        ]
        t, x, p, shifts, channel = given
        n, k = eom.q.numel(), eom.z.numel()
        x = self._projected(t, x, p)
        q, v, z = x[:n], x[n : 2 * n], x[2 * n : 2 * n + k]
        inputs = ca.Function(
            "u", [eom.t, eom.q, eom.v, eom.z, eom.p, self.shifts, self.signals.channel], [self.signals.expressions]
        )
        u = inputs(t, q, v, z, p, shifts, channel)
        a, lam = self.numeric.forward_dynamics(redundant=self.redundant)(t, q, v, z, u, p)
        values = eom.function(expression)(t, q, v, a, z, lam, u, p)
        return ca.Function("output", given, [values])
