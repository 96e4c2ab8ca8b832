"""The motion that is nearest to more quantities than a mechanism has degrees of freedom, as markers on its limbs.

At each time ``sum (e(q) - y(t))²`` is least among the poses that meet ``Phi(q, t) = 0``. Since the gradient vanishes,
the pose is a function of time, whose derivatives are the velocities and accelerations: they meet the constraints, too.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from ..assembly.pose import PoseProblem
from ..equations.numeric import NumericEquations
from ..errors import NOT_FINITE, MechanismError, SingularityError
from ..model.drivers import Driver
from ..numerics.console import call_each, quiet
from ..numerics.lazy import cached_property
from ..numerics.least_squares import least_norm
from ..numerics.newton import refine_root, solve
from ..numerics.rank import analyse_rank, unit_rows
from ..results.state import Arrays
from ..results.steps import Direct
from ..results.trajectory import Trajectory


class NearestMotion:
    """The motion nearest to courses that need not agree.

    Parameters
    ----------
    numeric : NumericEquations
        The mechanism, without what is prescribed.
    prescribed : sequence of Driver
        What the motion is near to: expressions and their courses.
    """

    def __init__(self, numeric: NumericEquations, prescribed: Sequence[Driver]):
        eom = self._eom = numeric.eom
        self._numeric, self._prescribed = numeric, prescribed
        rates = [name for k, name in enumerate(eom.row_names) if k not in eom.position_rows]
        if rates:
            raise MechanismError(
                f"inverse_dynamics: motion= prescribes more quantities than the mechanism has degrees of freedom, and "
                f"its motion is not one of positions alone, since {rates[0]} constrains velocities; prescribe "
                "as many as there are degrees of freedom"
            )
        self._expression = ca.vertcat(*[driver.expression for driver in prescribed])
        self._course = ca.vertcat(*[driver.value for driver in prescribed])
        # unknowns by their sizes, and the gradient by that of a squared length
        length, usual = numeric.scale.length, numeric.scale.usual_rows[eom.position_rows]
        self._sizes = np.r_[numeric.scale.coordinates, length / usual]
        # courses are looked up at all times at once, and enter as numbers
        y, rate, second = (ca.SX.sym(name, len(prescribed)) for name in ("y", "dy", "ddy"))
        lam = ca.SX.sym("lam", eom.Phi.numel())
        x = ca.vertcat(eom.q, lam)
        cost = 0.5 * ca.sumsqr(self._expression - y) + ca.dot(lam, eom.Phi)
        gradient = ca.densify(ca.gradient(cost, x) * self._sizes / length**2)
        slope, v = ca.jacobian(gradient, x), ca.SX.sym("v", x.numel())
        moving = ca.vertcat(x, y, eom.t)
        first = ca.jtimes(gradient, moving, ca.vertcat(v, rate, 1))
        curved = ca.jtimes(first, ca.vertcat(moving, rate), ca.vertcat(v, rate, 1, second))
        known = [x, y, eom.t, eom.z, eom.p]
        self._gradient = ca.Function("gradient", known, [gradient, ca.densify(slope @ ca.diag(ca.DM(self._sizes)))])
        self._first = ca.Function("first", [*known, v, rate], [ca.densify(first)])
        self._second = ca.Function("second", [*known, v, rate, second], [ca.densify(curved)])

    def over(self, grid: np.ndarray) -> Trajectory:
        """The motion over a grid of times."""
        eom, y = self._eom, self._courses(grid)[0]
        for now, finite in zip(grid, np.isfinite(y), strict=True):
            if not np.all(finite):
                lost = ", ".join(driver.name for driver, good in zip(self._prescribed, finite, strict=True) if not good)
                raise MechanismError(
                    f"inverse_dynamics: {lost} has no finite value at t = {now:.6g} s: {NOT_FINITE}", time=float(now)
                )
        x = self._nearest_at(float(grid[0]), y[0])
        poses = np.array([x := self._next(float(t), now, x) for t, now in zip(grid, y, strict=True)])

        def at(t: np.ndarray) -> Arrays:
            near = np.clip(np.searchsorted(grid, t), 0, grid.size - 1)
            known = zip(t, self._courses(t)[0], near, strict=True)
            return self._motion(t, np.array([self._next(float(now), y, poses[k]) for now, y, k in known]))

        motion = self._motion(grid, poses)
        return Trajectory(eom.mechanism, grid, *motion, self._numeric.p, interpolation=Direct(at, grid))

    def note(self, motion: Trajectory) -> str:
        """How far the motion is from what is prescribed: root mean squares."""
        missing = motion[self._expression].reshape(motion.t.size, -1) - self._courses(motion.t)[0]
        sizes = np.sqrt(np.mean(missing**2, axis=0))
        return (
            "the motion is the nearest one, of least squares; what is prescribed it misses by root mean squares of "
            f"{', '.join(f'{size:.3g}' for size in sizes)} (m or rad)"
        )

    def _courses(self, times: np.ndarray) -> tuple[np.ndarray, ...]:
        """What is prescribed and its two derivatives in time, each (k, n_y)."""
        return tuple(part.T for part in call_each(self._derivatives, times[None, :], self._numeric.p))

    @cached_property
    def _derivatives(self) -> ca.Function:
        t, course = self._eom.t, [self._course]
        for _ in range(2):
            course.append(ca.jacobian(course[-1], t))
        return ca.Function("courses", [t, self._eom.p], [ca.densify(part) for part in course])

    def _motion(self, times: np.ndarray, x: np.ndarray) -> Arrays:
        """Positions, velocities and accelerations of poses (k, n + m); states, multipliers and inputs are not known."""
        eom, n = self._eom, self._eom.q.numel()
        v, a = np.empty(x.shape), np.empty(x.shape)
        for k, (t, pose, y, *rates) in enumerate(zip(times, x, *self._courses(times), strict=True)):
            known = (pose, y, float(t), eom.estimate[2], self._numeric.p)
            slope = self._gradient(*known)[1].full()
            v[k] = -self._sizes * least_norm(slope, self._first(*known, np.zeros(x.shape[1]), rates[0]).full().ravel())
            a[k] = -self._sizes * least_norm(slope, self._second(*known, v[k], *rates).full().ravel())
        z, lam = (np.full((times.size, group.numel()), np.nan) for group in (eom.z, eom.lam))
        return x[:, :n], v[:, :n], a[:, :n], z, lam, np.tile(eom.input_values, (times.size, 1))

    def _next(self, t: float, y: np.ndarray, x: np.ndarray) -> np.ndarray:
        """The pose and the multipliers at a time, from those at a time nearby."""
        known = y, t, self._eom.estimate[2], self._numeric.p

        def gradient(scaled: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            values, slope = self._gradient(scaled * self._sizes, *known)
            return values.full().ravel(), slope.full()

        alike = np.ones(x.size)
        outcome = solve(gradient, x / self._sizes, alike)
        if not outcome.converged:
            raise SingularityError(
                f"inverse_dynamics: the motion nearest to what motion= prescribes cannot be continued beyond "
                f"t = {t:.6g} s: no pose near the one before is nearest there, or the pose is singular; "
                "leave out samples that are far off, or prescribe more quantities",
                time=t,
            )
        return refine_root(gradient, outcome.x, alike) * self._sizes

    def _nearest_at(self, t: float, y: np.ndarray) -> np.ndarray:
        """The nearest pose at the first time and its multipliers, from the pose that the estimates give."""
        numeric, eom = self._numeric, self._eom
        known = t, eom.estimate[2], numeric.p
        closed = PoseProblem(numeric, [], t, eom.estimate[2]).solve(eom.estimate[0])
        rows = ca.substitute(ca.densify(eom.Phi), ca.vertcat(eom.t, eom.z, eom.p), ca.vertcat(*known))
        problem = {"x": eom.q, "f": 0.5 * ca.sumsqr(self._at(known) - y), "g": rows}
        options = {"print_time": False, "error_on_fail": False, "ipopt": {"print_level": 0, "sb": "yes"}}
        with quiet():
            found = ca.nlpsol("nearest", "ipopt", problem, options)(x0=closed, lbg=0, ubg=0)
        q = found["x"].full().ravel()
        near = ca.Function("near", [eom.q], [ca.jacobian(self._at(known), eom.q)])(q).full()
        rows = np.vstack([numeric.scaled_jacobian(t, q), unit_rows(near * numeric.column_scale)])
        free = q.size - analyse_rank(rows).rank
        if free:
            raise MechanismError(
                f"the motion is under-determined by {free}: motion= prescribes {len(self._prescribed)} quantities, and "
                "they leave a part of the mechanism free; prescribe what moves it"
            )
        return np.r_[q, found["lam_g"].full().ravel()]

    def _at(self, known: tuple[float, np.ndarray, np.ndarray]) -> ca.SX:
        """Prescribed quantities as expressions in the pose alone."""
        eom = self._eom
        return ca.substitute(self._expression, ca.vertcat(eom.t, eom.z, eom.p), ca.vertcat(*known))
