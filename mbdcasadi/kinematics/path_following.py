"""A driven motion followed in time, step by step, on one branch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..equations.driven import driven_equations
from ..equations.numeric import NumericEquations
from ..equations.switching.time_breaks import resolution
from ..errors import NOT_FINITE, AssemblyError, warn
from ..numerics.console import interruptible, quiet
from ..numerics.homotopy import Step, follow
from ..numerics.least_squares import largest, project_velocity
from ..numerics.newton import solve
from ..numerics.progress import progress_bar
from .driven_motion import DrivenMotion, MotionFollower

#: Points that are solved by one call of the compiled recursion.
BATCH = 500
#: Largest share of a step's own motion by which the prediction may be off, the least motion that counts, and rounding.
PREDICTION_TOLERANCE, SMALL_MOTION, NO_MOTION = 0.5, 1e-3, 1e-12
#: Last Newton step that counts as converged, relative to the size of the coordinates.
NEWTON_TOLERANCE = 1e-10
#: Size of a Jacobian and number of points up to which the sign of its determinant is watched.
LARGEST_DETERMINANT, WATCHED_POINTS = 60, 2000
#: Residual of redundant rows (m or rad, and per unit of speed) from which they contradict each other; of a mechanism of
#: more than a metre that times its length.
CONTRADICTION_TOLERANCE = 1e-8
#: Steps are divided down to this share of the span.
SMALLEST_STEP = 1e-12
#: Share of the duration before and after a corner in which no step has to succeed.
NEAR_CORNER = 1e-6


class Continuation(MotionFollower):
    """Follows the pose of a driven mechanism by Newton's method; see the base class.

    Parameters
    ----------
    corners : sequence of float
        Times at which prescribed velocities jump: no step predicts what comes after one by what was before it.
    """

    def __init__(self, numeric: NumericEquations, corners: Sequence[float] = ()):
        super().__init__(numeric)
        self._corners = np.unique(np.asarray(corners, float))
        self.driven = driven_equations(numeric.eom)
        #: states and inputs, on which no row depends here
        self._others = numeric.eom.estimate[2], numeric.eom.input_values
        self._contradiction = CONTRADICTION_TOLERANCE * max(1.0, numeric.scale.length)

    # --- the motion -------------------------------------------------------------------
    def run(self, grid: np.ndarray, q: np.ndarray, z: np.ndarray, *, progress: bool = False) -> DrivenMotion:
        """Follow the motion over a grid from the pose at its first time; no state takes part."""
        zero = np.zeros_like(q)
        singular = self.numeric.rank(float(grid[0]), q).rank < q.size
        first = None if singular else self._batch(grid[0], grid[:1], q, zero, zero)
        if first is None or not len(first[0]):
            nothing = DrivenMotion.none(self.numeric)
            contradiction = None if singular else self._contradicting(q, float(grid[0]), float(grid[0]), nothing)
            raise contradiction or self._singular(float(grid[0]), q, nothing)
        blocks = [first]
        done = 1
        with (
            interruptible() as interruption,
            progress_bar(grid.size - 1, "kinematics", " times", show=progress) as bar,
        ):
            try:
                while done < grid.size:
                    block = self._batch(grid[done - 1], grid[done : done + BATCH], *(x[-1] for x in blocks[-1]))
                    if not len(block[0]):
                        block = self._carefully(grid, done, blocks)
                    blocks.append(block)
                    done += len(block[0])
                    bar.update(len(block[0]))
            except (KeyboardInterrupt, Exception) as error:
                # inside CasADi's conversions Ctrl-C comes back as nothing, on which the next line fails
                if interruption.requested or isinstance(error, KeyboardInterrupt):
                    raise self._interrupted(self._motion(grid, blocks)) from None
                raise
        motion = self._motion(grid, blocks)
        self._watch_branch(motion)
        return motion

    def correct(self, t: np.ndarray, q: np.ndarray, z: np.ndarray) -> DrivenMotion:
        """Solve at scattered times from good estimates (k, n); no state takes part."""
        zero = np.zeros_like(q.T)
        results = self.driven.step(q.T, zero, zero, t[None, :], t[None, :], self.numeric.p)
        q, v, a = (x.full().T for x in results[:3])
        return DrivenMotion(t, q, v, a, self._without_states(t.size))

    def _batch(
        self, before: float, times: np.ndarray, *state: np.ndarray, careful: bool = False
    ) -> tuple[np.ndarray, ...]:
        """Motion at as many of the times as the compiled recursion solves on the branch.

        Parameters
        ----------
        *state : numpy.ndarray
            Pose, velocity and acceleration at the time before.
        careful : bool
            True if the prediction may not be off by more than rounding where little moves.
        """
        q, v, _ = state
        function = self._recursion(times.size)
        p = np.tile(self.numeric.p[:, None], (1, times.size))
        try:
            with quiet():
                results = function(*state, before, times[None, :], p)
        except RuntimeError:  # a singular matrix on the way: step by step then
            return tuple(np.zeros((0, q.size)) for _ in state)
        qs, vs, accelerations = (x.full().T for x in results[:3])
        correction, remainder, contradiction = (x.full().ravel() for x in results[4:])
        motion = np.max(np.abs(np.diff(np.vstack([q, qs]), axis=0)), axis=1)
        slack = NO_MOTION * (1 + largest(q)) if careful else SMALL_MOTION * (1 + motion)
        good = correction <= PREDICTION_TOLERANCE * motion + slack
        good &= remainder <= NEWTON_TOLERANCE * (1 + largest(q))
        good &= self._rates_fit(np.r_[before, times], np.vstack([q, qs]), np.vstack([v, vs]))
        good &= contradiction <= self._contradiction
        good &= np.isfinite(correction) & np.all(np.isfinite(accelerations), axis=1)
        count = int(np.argmin(good)) if not np.all(good) else times.size
        return qs[:count], vs[:count], accelerations[:count]

    def _recursion(self, count: int) -> Any:
        names = ["q0", "v0", "a0", "t0"], ["q", "v", "a", "t_now"]
        return self.numeric.eom.mechanism.cache.get_or_create(
            ("kinematic recursion", count), lambda: self.driven.step.mapaccum("kinematics", count, *names), bounded=True
        )

    def _watch_branch(self, motion: DrivenMotion) -> None:
        """Warn if the determinant of the Jacobian changes its sign: a singular pose was passed, or a branch left."""
        eom = self.numeric.eom
        if not self.driven.square or eom.q.numel() > LARGEST_DETERMINANT:
            return
        every = slice(None, None, max(1, motion.t.size // WATCHED_POINTS))
        jacobian = eom.slopes(motion.t[every][None, :], motion.q[every].T, self.numeric.p).full()
        n = eom.q.numel()
        stacked = jacobian.reshape(n, -1, n).transpose(1, 0, 2)
        signs = np.linalg.slogdet(stacked)[0]
        flips = np.flatnonzero(signs[1:] * signs[:-1] < 0)
        if flips.size:
            k = int(flips[0])
            times = motion.t[every]
            warn(
                f"the motion passes a singular pose between t = {times[k]:.6g} and {times[k + 1]:.6g} s (the "
                "determinant of Phi_q changes its sign there); the branch was continued smoothly, another one meets it"
            )

    # --- one difficult step -----------------------------------------------------------------
    def _carefully(self, grid: np.ndarray, done: int, blocks: list[tuple]) -> tuple:
        """Reach the next time in divided steps, or raise if the mechanism locks."""
        state = tuple(x[-1] for x in blocks[-1])
        now, goal = float(grid[done - 1]), float(grid[done])
        smallest = SMALLEST_STEP * max(float(grid[-1] - grid[0]), abs(goal))
        instant = resolution(float(grid[0]), float(grid[-1]))

        def moved(state: tuple, at: float, to: float) -> Step[tuple] | None:
            block = self._batch(at, np.array([to]), *state, careful=True)
            return Step(tuple(x[0] for x in block)) if len(block[0]) else None

        corners = self._corners[(self._corners > now - instant) & (self._corners < goal - 2 * instant)]
        near = NEAR_CORNER * float(grid[-1] - grid[0])
        for end in (*corners.tolist(), goal):
            passed = instant
            if end > now:
                path = follow(state, moved, start=now, end=end, step=(end - now) / 2, smallest=smallest)
                if path.failed is not None and (end == goal or end - path.at > near):
                    motion, reached = self._motion(grid, blocks), path.point[0]
                    raise (
                        self._not_finite(reached, path.at, path.failed, motion)
                        or self._contradicting(reached, path.at, goal, motion)
                        or self._singular(path.at, reached, motion)
                    )
                if path.failed is not None:  # rates next to a corner are lost in rounding, as those of acos(cos(t)) are
                    passed = near
                state, now = path.point, end
            if end < goal:
                now = min(end + passed, goal)
                after = self.correct(np.array([now]), state[0][None, :], self._without_states(1))
                state = after.q[0], after.v[0], after.a[0]
        q, v, a = state
        return q[None, :], v[None, :], a[None, :]

    @staticmethod
    def _rates_fit(t: np.ndarray, q: np.ndarray, v: np.ndarray) -> np.ndarray:
        """True if velocities agree with the motion by the trapezoidal rule; in a singular pose they are anything."""
        h = np.diff(t)[:, None]
        rise, mean = np.diff(q, axis=0), h * (v[1:] + v[:-1]) / 2
        size = np.max(np.abs(rise), axis=1) + np.max(np.abs(h * v[:-1]), axis=1)
        return np.max(np.abs(rise - mean), axis=1) <= PREDICTION_TOLERANCE * size + SMALL_MOTION * (
            1 + np.max(np.abs(q[:-1]), axis=1)
        )

    # --- messages ---------------------------------------------------------------------------
    def _motion(self, grid: np.ndarray, blocks: list[tuple]) -> DrivenMotion:
        q, v, a = (np.concatenate(parts) for parts in zip(*blocks, strict=True))
        return DrivenMotion(grid[: len(q)], q, v, a, self._without_states(len(q)))

    def _not_finite(self, q: np.ndarray, now: float, ahead: float, motion: DrivenMotion) -> AssemblyError | None:
        """The error for rows that have no value from now on, if that is what stops the motion."""
        rows = self.numeric.rows_not_finite(ahead, q, np.zeros_like(q), *self._others)
        if not rows:
            return None
        return AssemblyError(
            f"the motion cannot be continued beyond t = {now:.9g} s: {', '.join(rows)} has no finite value from there "
            f"on: {NOT_FINITE}; what was computed is in .partial",
            time=now,
            partial=motion,
        )

    def _contradicting(self, q: np.ndarray, now: float, goal: float, motion: DrivenMotion) -> AssemblyError | None:
        """The error for rows that contradict each other from now on, if that is what stops the motion."""
        if self.driven.square:
            return None
        eom = self.numeric.eom
        z = self._others[0]
        closest = solve(lambda pose: self.numeric.position(goal, pose, z), q, self.numeric.weights)
        jacobian, nu = self.numeric.velocity(now, q, z)
        v = project_velocity(jacobian, nu, np.zeros(q.size))
        at_velocity = np.zeros(eom.lam.numel()) if closest.converged is False else jacobian @ v - nu
        residual = closest.residual if not closest.converged else at_velocity[eom.position_rows]
        rows = [eom.position_names[k] for k in np.argsort(-np.abs(residual)) if abs(residual[k]) > self._contradiction]
        if not rows:
            return None
        return AssemblyError(
            f"the motion cannot be continued beyond t = {now:.9g} s: the redundant rows {', '.join(rows[:6])} "
            "contradict each other from there on; what was computed is in .partial",
            residuals={name: float(value) for name, value in zip(rows, sorted(np.abs(residual))[::-1], strict=False)},
            time=now,
            partial=motion,
        )
