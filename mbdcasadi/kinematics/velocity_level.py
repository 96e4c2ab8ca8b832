"""A driven motion that is found by integration: with blades, wheels and skates, and with drivers that follow states.

The drivers and the position constraints leave poses open that the
velocity-level rows, or the rates of first-order states, reach only along a
path. ``q̇ = v`` with ``Phi_q v = nu`` is integrated with the states; every output
is brought onto the position constraints.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from ..equations.driven import driven_equations
from ..equations.numeric import NumericEquations
from ..equations.recovery import Recovery
from ..errors import SingularityError
from ..integrators import IDAS
from ..integrators.compiled import Clock, CompiledIntegrator, Dae, InitialValueProblem, IntegrationFailure
from ..numerics.console import interruptible
from ..numerics.progress import progress_bar
from ..numerics.tolerances import INTEGRATION
from .driven_motion import DrivenMotion, MotionFollower

#: Outputs after which the integration restarts from the projected pose.
CHUNK = 100


class VelocityLevelMotion(MotionFollower):
    """Follows the pose of a mechanism whose velocity is determined and whose pose is not; see the base class."""

    def __init__(self, numeric: NumericEquations):
        super().__init__(numeric)
        self._rates = driven_equations(numeric.eom).rates
        self._recovery = Recovery(numeric, redundant=True)
        self._followed = numeric.eom.followed_states

    def run(self, grid: np.ndarray, q: np.ndarray, z: np.ndarray, *, progress: bool = False) -> DrivenMotion:
        """Follow the motion over a grid from the pose and the states at its first time."""
        integrator = CompiledIntegrator(self._system(), IDAS(INTEGRATION, INTEGRATION))
        start = self._without_states(1)
        start[:, self._followed] = z[self._followed]
        found, done = np.hstack([q[None, :], start]), 1
        with interruptible() as stop, progress_bar(grid.size - 1, "kinematics", " times", show=progress) as bar:
            try:
                while done < grid.size:
                    times, last = grid[done : done + CHUNK], self._split(found[-1:])
                    v = self._speeds(grid[done - 1 : done], *last)[0][0]
                    x = np.r_[last[0][0], last[1][0, self._followed]]
                    problem = InitialValueProblem(x, v, float(grid[done - 1]), times, self.numeric.p)
                    motion = self.correct(times, *self._states(integrator.advance(problem, stop)[0]))
                    found = np.vstack([found, np.hstack([motion.q, motion.z])])
                    done = len(found)
                    bar.update(times.size)
            except (KeyboardInterrupt, Exception) as error:
                # inside CasADi's conversions Ctrl-C comes back as nothing, on which the next line fails
                if stop.requested or isinstance(error, KeyboardInterrupt):
                    raise self._interrupted(self.correct(grid[: len(found)], *self._split(found))) from None
                if isinstance(error, IntegrationFailure):
                    raise self._stopped(error, grid, found) from None
                raise
        return self.correct(grid, *self._split(found))

    def _split(self, found: np.ndarray) -> list[np.ndarray]:
        """Poses, and all states, by row."""
        return np.split(found, [self.numeric.eom.q.numel()], axis=1)

    def _states(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Poses, and all states, by row, from the states of the integration."""
        q, followed = self._split(x)
        z = self._without_states(len(x))
        z[:, self._followed] = followed
        return q, z

    def _stopped(self, failure: IntegrationFailure, grid: np.ndarray, found: np.ndarray) -> SingularityError:
        """The error of an integration that stopped, with the motion so far."""
        every = np.vstack([found, np.hstack(self._states(failure.x))])
        motion = self.correct(grid[: len(every)], *self._split(every))
        if failure.last is None or failure.last_x is None:
            return self._singular(float(motion.t[-1]), motion.q[-1], motion, motion.z[-1])
        q, z = self._states(failure.last_x[None, :])
        return self._singular(failure.last, q[0], motion, z[0])

    def correct(self, t: np.ndarray, q: np.ndarray, z: np.ndarray) -> DrivenMotion:
        """Bring good estimates of the pose (k, n) onto the position constraints, and solve for their rates."""
        q = self._recovery.positions(t, q, z)
        v, a = self._speeds(t, q, z)
        return DrivenMotion(t, q, v, a, z)

    def _speeds(self, t: np.ndarray, q: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        u = self.numeric.eom.input_values
        try:
            v, a = (
                x.full().T for x in self._rates(t[None, :], q.T, z.T, np.tile(u[:, None], t.size), self.numeric.p)[:2]
            )
        except RuntimeError:  # a singular matrix
            v = a = np.full_like(q, np.nan)
        if not np.all(np.isfinite(a)):
            k = int(np.argmin(np.all(np.isfinite(a), axis=1)))
            raise self._singular(float(t[k]), q[k], DrivenMotion.none(self.numeric), z[k])
        return v, a

    def _system(self) -> Dae:
        """``q̇ = v``, ``Phi_q v = nu``, and the rates of the states that drivers follow."""
        eom = self.numeric.eom
        clock = Clock()
        rows = eom.Phi_q @ eom.v - eom.nu
        if eom.lam.numel() > eom.q.numel():
            rows = eom.Phi_q.T @ rows
        inputs = ca.SX(ca.DM(self.numeric.eom.input_values))
        followed = eom.z[self._followed]
        known = [eom.t, eom.q, eom.v, followed, eom.u, eom.p]
        system = ca.Function("system", known, [ca.densify(eom.z_rate[self._followed]), ca.densify(rows)])
        rates, residual = system(clock.t, eom.q, eom.v, followed, inputs, eom.p)
        x = ca.vertcat(eom.q, followed)
        return Dae(clock, x, eom.v, eom.p, ca.SX(0, 1), ca.vertcat(eom.v, rates), residual)
