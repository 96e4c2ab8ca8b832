"""The equations of a run with variations of its motion, as one explicit system.

A variation ``S`` of the state along changes of the start, of parameters and of inputs follows

    S' = f_x S + f_p dp + f_u du,

and is a state like others: that of coordinates stands behind the coordinates, that of velocities behind the velocities.
The accelerations solve a linear system, and their variations one with the same matrix, so that its factors serve all.
Projection brings variations onto the constraints too, ``Phi_q dq + Phi_p dp = 0``.

References
----------
Serban and Haug, "Kinematic and kinetic derivatives in multibody system analysis", Mech. Struct. Mach. 26 (1998) 145.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import casadi as ca
import numpy as np

from ..arguments.inputs import Signals
from ..equations.numeric import NumericEquations
from ..equations.recovery import projection_saddle
from ..equations.switching.held import HeldEquations
from ..integrators.compiled import InitialValueProblem
from ..integrators.native.stretch import ExplicitSystem
from ..model.cache import Cache, ExpressionKey
from ..simulation.stepping.explicit_system import explicit_system, projection_of, switching_of

#: Symbols of a system by name, or of its variations by column.
Symbols = dict[str, ca.SX]
_NONE = ca.SX(0, 1)


class VariedSystem:
    """An explicit system whose motion varies.

    Parameters
    ----------
    signals : Signals
        Inputs.
    integrands : casadi.SX
        Rates of integrals, which are states.

    Attributes
    ----------
    size : int
        Number of states ``(q, v, z)`` and integrals.
    parameters, levels, channel : int
        Numbers of parameters, levels of inputs, and values that change by interval.
    """

    def __init__(self, numeric: NumericEquations, signals: Signals, integrands: ca.SX):
        eom = numeric.eom
        self._numeric, self._signals = numeric, signals
        self._rates = ca.vertcat(eom.z_rate, integrands)
        self._of: Symbols = {
            "q": eom.q,
            "v": eom.v,
            "z": ca.vertcat(eom.z, ca.SX.sym("integrals", integrands.numel())),
            "u": eom.u,
            "p": eom.p,
            "levels": signals.levels,
            "channel": signals.channel,
        }
        self._n = eom.q.numel()
        self.size = 2 * self._n + self._of["z"].numel()
        self.parameters, self.levels, self.channel = eom.p.numel(), signals.levels.numel(), signals.channel.numel()
        self._places_in_parameters = [self.parameters, self.parameters + self.levels]
        self._key = "varied system", numeric.light_key, ExpressionKey(integrands)
        self._is_held = isinstance(eom, HeldEquations)
        self._is_simulated = not (self._is_held or integrands.numel())

    # --- values --------------------------------------------------------------------------------
    def varied(
        self, problem: InitialValueProblem, varied: Sequence[int], dx: np.ndarray, dp: np.ndarray, du: np.ndarray
    ) -> InitialValueProblem:
        """A problem with its variations.

        Parameters
        ----------
        varied : sequence of int
            Positions of the parameters that vary.
        dx, dp, du : numpy.ndarray
            Variations of the start (k, n_x), of parameters and levels (k, n), and of what changes by interval
            (k, n_u, n_t).
        """
        p, levels, others = np.split(problem.p, self._places_in_parameters)
        p, levels = np.r_[p, dp[:, varied].ravel()], np.r_[levels, dp[:, self.parameters :].ravel()]
        x = np.vstack([problem.x, dx]).ravel()[self._order(len(dx))]
        u = np.vstack([problem.channel, *du])
        return replace(problem, x=x, p=np.concatenate([p, levels, others]), u=u)

    def variations(self, x: np.ndarray, count: int) -> np.ndarray:
        """Variations (count, n_t, n_x) in states by row."""
        parts = np.empty(x.shape)
        parts[:, self._order(count)] = x
        return parts.reshape(len(x), 1 + count, self.size)[:, 1:].swapaxes(0, 1)

    def _order(self, count: int) -> np.ndarray:
        """Places of the components of a varied state in that of the motion and its variations, one after the other."""
        places = np.arange((1 + count) * self.size).reshape(1 + count, self.size)
        return np.concatenate([part.ravel() for part in np.split(places, [self._n, 2 * self._n], axis=1)])

    def rates(self, problem: InitialValueProblem, times: np.ndarray, x: np.ndarray) -> np.ndarray:
        """Rates (k, n_x) of states by row at the first times of a problem, or at its start."""
        system, (p, levels, _) = self.with_variations(0)[0], np.split(problem.p, self._places_in_parameters)
        q, v, z = np.split(x.T, [self._n, 2 * self._n])
        inputs = system.input(times[None, :], q, v, z, p, levels, problem.channel[:, : times.size])
        a, z_rate, *_ = system.dynamics(times[None, :], q, v, z, inputs, p)
        return np.vstack([v, a.full(), z_rate.full()]).T

    # --- the system -----------------------------------------------------------------------------
    def with_variations(self, count: int, varied: tuple[int, ...] = ()) -> tuple[ExplicitSystem, Cache]:
        """The system with some variations, and the cache of what is compiled for it; kept for a mechanism.

        Parameters
        ----------
        varied : tuple of int
            Positions of the parameters that vary.
        """
        eom, signals = self._numeric.eom, self._signals
        if not count and self._is_simulated:  # it may be compiled already
            return explicit_system(self._numeric, signals), eom.mechanism.cache
        return signals.kept(
            eom, (*self._key, count, varied), lambda: (self._system(count, varied), Cache()), bounded=True
        )

    def _system(self, count: int, varied: Sequence[int]) -> ExplicitSystem:
        eom, signals = self._numeric.eom, self._signals
        changes = {name: ca.SX.sym(name, s.numel(), count) for name, s in self._of.items()}
        changes["p"][np.setdiff1d(np.arange(self.parameters), varied).tolist(), :] = 0

        def state(name: str) -> ca.SX:
            return ca.vertcat(self._of[name], ca.vec(changes[name]))

        q, v, z, u, p = (*map(state, "qvzu"), ca.vertcat(eom.p, ca.vec(changes["p"][list(varied), :])))
        a, (own, _) = ca.SX.sym("a", q.numel()), projection_saddle(eom, eom.position_rows.tolist())
        weights = ca.vertcat(own, ca.SX.sym("weights of variations", q.numel() - self._n))
        # elements know nothing of switches that are held
        natural = switching_of(eom, signals, with_gaps=True)
        switching = _NONE if self._is_held else natural(eom.t, eom.q, eom.v, eom.z, eom.p)
        return ExplicitSystem(
            ca.Function("input", [eom.t, q, v, z, p, state("levels"), state("channel")], [self._inputs(changes)]),
            ca.Function("dynamics", [eom.t, q, v, z, u, p], self._accelerations(changes)),
            ca.Function("quadrature", [eom.t, q, v, a, z, eom.lam, u, p], [_NONE]),
            ca.Function("projection", [eom.t, q, v, z, p, weights], self._projected(own, changes)),
            ca.Function("switching", [eom.t, q, v, z, p], [switching]),
        )

    def _along(self, changes: Symbols, expression: ca.SX, *names: str) -> ca.SX:
        """Changes of an expression with some of its variables (rows, count)."""
        of, directions = (ca.vertcat(*[symbols[name] for name in names]) for symbols in (self._of, changes))
        return ca.densify(ca.jtimes(ca.densify(expression), of, directions))

    def _inputs(self, changes: Symbols) -> ca.SX:
        """Inputs, and their variations."""
        u = self._signals.parametrised
        return ca.densify(_stacked(u, self._along(changes, u, "q", "v", "z", "p", "levels", "channel")))

    def _accelerations(self, changes: Symbols) -> list[ca.SX]:
        """Accelerations and rates of states, with their variations; multipliers; a regularity that is not used."""
        eom, n, everything = self._numeric.eom, self._n, ("q", "v", "z", "u", "p")
        saddle = self._numeric.saddle()
        left = self._along(changes, eom.residual(), *everything)
        da, dlam = saddle.solve(-left[:n, :], -left[n:, :])
        rates = self._along(changes, self._rates, *everything)
        rates += ca.jtimes(self._rates, ca.vertcat(eom.a, eom.lam), ca.vertcat(da, dlam))
        a, lam = saddle.solve(eom.Q, eom.gamma)
        parts = [ca.densify(_stacked(*pair)) for pair in ((eom.a, da), (self._rates, rates))]
        return [*ca.substitute(parts, [eom.a, eom.lam], [a, lam]), lam, ca.SX(1)]

    def _projected(self, weights: ca.SX, changes: Symbols) -> list[ca.SX]:
        """Coordinates and velocities on the constraints, with their variations, and what is left."""
        eom = self._numeric.eom
        q, v, left = projection_of(eom)(eom.t, eom.q, eom.v, eom.z, eom.p, weights)
        parts = ca.substitute(list(self._on_constraints(changes)), [eom.q, eom.v], [q, v])
        return [*[ca.densify(_stacked(*pair)) for pair in zip((q, v), parts, strict=True)], left]

    def _on_constraints(self, changes: Symbols) -> tuple[ca.SX, ca.SX]:
        """Variations of coordinates and velocities on the constraints, at a state that is on them."""
        eom, (dq, dv) = self._numeric.eom, (changes["q"], changes["v"])
        if not eom.lam.numel():
            return dq, dv
        if eom.Phi.numel():
            of_positions = projection_saddle(eom, eom.position_rows.tolist())[1]
            dq = dq - of_positions.project(self._along(changes, eom.Phi, "q", "z", "p"))
        of_velocities = self._along(changes | {"q": dq}, eom.Phi_q @ eom.v - eom.nu, "q", "z", "p")
        of_rows = projection_saddle(eom, list(range(eom.lam.numel())))[1]
        return dq, dv - of_rows.project(of_velocities + eom.Phi_q @ dv)


def _stacked(values: ca.SX, variations: ca.SX) -> ca.SX:
    """Values, and below them their variations one after the other."""
    return ca.vertcat(values, ca.vec(variations))
