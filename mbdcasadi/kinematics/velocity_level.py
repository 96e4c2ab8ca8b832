"""A driven motion that constraints determine at velocity level: with blades, wheels and skates.

The drivers and the position constraints leave poses open that the
velocity-level rows reach only along a path. ``q̇ = v`` with ``Phi_q v = nu`` is
integrated; every output is brought onto the position constraints.
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

    def run(self, grid: np.ndarray, q: np.ndarray, *, progress: bool = False) -> DrivenMotion:
        """Follow the motion over a grid from the pose at its first time."""
        integrator = CompiledIntegrator(self._system(), IDAS(INTEGRATION, INTEGRATION))
        poses, done = q[None, :], 1
        with interruptible() as stop, progress_bar(grid.size - 1, "kinematics", " times", show=progress) as bar:
            try:
                while done < grid.size:
                    times = grid[done : done + CHUNK]
                    v = self._speeds(grid[done - 1 : done], poses[-1:])[0][0]
                    start = float(grid[done - 1])
                    problem = InitialValueProblem(poses[-1], v, start, times, self.numeric.p)
                    states, _ = integrator.advance(problem, stop)
                    poses = np.vstack([poses, self._recovery.positions(times, states)])
                    done = len(poses)
                    bar.update(times.size)
            except (KeyboardInterrupt, Exception) as error:
                # inside CasADi's conversions Ctrl-C comes back as nothing, on which the next line fails
                if stop.requested or isinstance(error, KeyboardInterrupt):
                    raise self._interrupted(self.correct(grid[: len(poses)], poses)) from None
                if isinstance(error, IntegrationFailure):
                    raise self._stopped(error, grid, poses) from None
                raise
        return self.correct(grid, poses)

    def _stopped(self, failure: IntegrationFailure, grid: np.ndarray, poses: np.ndarray) -> SingularityError:
        """The error of an integration that stopped, with the motion so far."""
        motion = self.correct(grid[: len(poses) + len(failure.x)], np.vstack([poses, failure.x]))
        reached = float(motion.t[-1]) if failure.last is None else failure.last
        return self._singular(reached, motion.q[-1] if failure.last_x is None else failure.last_x, motion)

    def correct(self, t: np.ndarray, q: np.ndarray) -> DrivenMotion:
        """Bring good estimates of the pose (k, n) onto the position constraints, and solve for their rates."""
        q = self._recovery.positions(t, q)
        v, a = self._speeds(t, q)
        return DrivenMotion(t, q, v, a)

    def _speeds(self, t: np.ndarray, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        try:
            v, a = (x.full().T for x in self._rates(t[None, :], q.T, self.numeric.p)[:2])
        except RuntimeError:  # a singular matrix
            v = a = np.full_like(q, np.nan)
        if not np.all(np.isfinite(a)):
            k = int(np.argmin(np.all(np.isfinite(a), axis=1)))
            raise self._singular(float(t[k]), q[k], DrivenMotion.none(q.shape[1]))
        return v, a

    def _system(self) -> Dae:
        """``q̇ = v``, ``Phi_q v = nu``."""
        eom = self.numeric.eom
        clock = Clock()
        rows = eom.Phi_q @ eom.v - eom.nu
        if eom.lam.numel() > eom.q.numel():
            rows = eom.Phi_q.T @ rows
        residual = ca.Function("rows", [eom.t, eom.q, eom.v, eom.p], [rows])(clock.t, eom.q, eom.v, eom.p)
        return Dae(clock, eom.q, eom.v, eom.p, ca.SX(0, 1), eom.v, residual)
