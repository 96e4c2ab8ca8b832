"""Kinematics: positions, velocities and accelerations of a driven mechanism."""

from __future__ import annotations

import time as clock
from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from ..assembly.pose import PoseProblem
from ..assembly.setup import Setup
from ..equations.numeric import NumericEquations
from ..equations.switching.explicit_time import explicit_time, first_jump
from ..errors import Interrupted, MechanismError, ModelError, warn
from ..model.mechanism import Mechanism
from ..model.quantities import yes_or_no
from ..model.symbols import Numbers
from ..numerics.console import keyboard_interrupts
from ..numerics.lazy import cached_property
from ..results.state import Arrays
from ..results.steps import Continuation, Places, Refined, Spans, States, Stretch
from ..results.trajectory import Statistics, Trajectory
from ..results.validity import report_validity
from .driven_motion import DrivenMotion
from .mobility import mobility
from .path_following import Continuation as PathFollower
from .velocity_level import VelocityLevelMotion

#: Error of the polynomials by which poses between outputs are estimated, relative, and in m, rad and their rates.
ESTIMATE = 1e-6
NO_MULTIPLIERS = "kinematics knows no forces: reactions, efforts and multipliers come from inverse_dynamics"


def kinematics(
    mechanism: Mechanism,
    times: Numbers | None = None,
    *,
    duration: float | None = None,
    parameters: Mapping[Any, Any] | None = None,
    progress: bool = False,
) -> Trajectory:
    """Solve position, velocity and acceleration of a mechanism whose motion is prescribed.

    ``Phi(q, t) = 0``, ``Phi_q v = nu``, ``Phi_q a = gamma`` at each time, by
    Newton's method from a prediction of the time before. If the step is too
    long for that, it is divided; a lock-up is located by bisection. With
    non-holonomic constraints, and with drivers that follow states, the pose
    follows from no time alone: then ``Phi_q v = nu`` and the states are
    integrated from the assembled pose and the states' own values at the first time; inputs keep their own values.

    Parameters
    ----------
    mechanism : Mechanism
        With as many independent constraints and drivers as coordinates.
    times : sequence of float
        Increasing, s.
    duration : float, optional
        Instead of `times`: 201 outputs from 0 to the duration, s.
    parameters : mapping, optional
        Parameter to number.
    progress : bool, default False
        Show a progress bar.

    Returns
    -------
    Trajectory
        Without multipliers; first-order states that no driver follows are NaN: they follow from forces (inverse
        dynamics has them).

    Raises
    ------
    SingularityError
        At a lock-up or a bifurcation: the rows that take part, ``.time`` and ``.partial``.
    MechanismError
        If degrees of freedom are left without a driver, or the position that one prescribes jumps in time
        (its name, ``.time`` and ``.partial``).

    Warns
    -----
    MechanismWarning
        If a prescribed velocity jumps, at the corner of a curve: the accelerations there are infinite.

    References
    ----------
    Haug 1989, sections 3.6 and 4.5–4.7.
    """
    yes_or_no(progress, "kinematics", "progress")
    with keyboard_interrupts("kinematics"):
        setup = Setup(mechanism, "kinematics", times=times, duration=duration, fewest_times=1, parameters=parameters)
        motion = driven_motion(setup.numeric, setup.grid, progress=progress, what="kinematics")
        trajectory = kinematic_trajectory(setup.numeric, motion)
        report_validity(trajectory)
        return trajectory


def driven_motion(numeric: NumericEquations, grid: np.ndarray, *, progress: bool, what: str) -> DrivenMotion:
    """Positions, velocities and accelerations over a grid, or the error of a lock-up."""
    began = clock.perf_counter()
    eom = numeric.eom
    jumps = explicit_time(eom).jumps(numeric.p, float(grid[0]), float(grid[-1]))
    jump = first_jump(jumps)
    z = eom.estimate[2]
    q = PoseProblem(numeric, [], float(grid[0]), z).solve(eom.estimate[0])
    check_driven(numeric, float(grid[0]), q, what)
    reached = grid if jump is None else grid[: max(np.searchsorted(grid, jump.time), 1)]
    try:
        motion = _follower(numeric, [corner.time for corner in jumps]).run(reached, q, z, progress=progress)
    except (MechanismError, Interrupted) as error:
        if error.partial is not None:
            error.partial = kinematic_trajectory(numeric, error.partial)
        raise
    motion.seconds = clock.perf_counter() - began
    if jump is not None:
        raise ModelError(
            f"{what}: {jump}; {jump.remedy}; what was computed is in .partial",
            time=jump.time,
            partial=kinematic_trajectory(numeric, motion),
        )
    for corner in jumps:
        warn(f"{what}: {corner}; {corner.remedy}")
    return motion


def _follower(numeric: NumericEquations, corners: Sequence[float] = ()) -> PathFollower | VelocityLevelMotion:
    """Follower of the pose: Newton's method, or an integration if velocities or states lead it."""
    eom = numeric.eom
    if eom.position_rows.size < eom.lam.numel() or eom.follows_states:
        unknown = ca.vertcat(eom.a, eom.lam)
        for k in eom.followed_states:
            if ca.depends_on(eom.z_rate[k], unknown):
                raise ModelError(
                    f"kinematics knows no forces, on which the rate of state '{eom.mechanism.states[k].label}' "
                    "depends, and a driver follows that state; use simulate"
                )
        return VelocityLevelMotion(numeric)
    return PathFollower(numeric, corners)


def kinematic_trajectory(numeric: NumericEquations, motion: DrivenMotion) -> Trajectory:
    """Trajectory without multipliers."""
    eom = numeric.eom
    count = motion.t.size
    z = motion.z
    u = np.tile(eom.input_values, (count, 1))
    lam = np.full((count, eom.lam.numel()), np.nan)
    return Trajectory(
        eom.mechanism,
        motion.t,
        motion.q,
        motion.v,
        motion.a,
        z,
        lam,
        u,
        numeric.p,
        statistics=Statistics(method="Newton's method", formulation="kinematics", seconds=motion.seconds),
        interpolation=Refined(DrivenAgain(numeric, motion), motion.t, (motion.q, motion.v, motion.a, z, lam, u)),
        missing_multipliers=NO_MULTIPLIERS,
    )


class DrivenAgain(Continuation):
    """A driven motion between its outputs: polynomials estimate the pose, which is solved from there.

    Parameters
    ----------
    numeric : NumericEquations
        The equations.
    motion : DrivenMotion
        The motion at the outputs.
    """

    reltol = abstol = ESTIMATE

    def __init__(self, numeric: NumericEquations, motion: DrivenMotion):
        self._numeric, self._motion = numeric, motion
        self.size = numeric.scale.coordinates

    @cached_property
    def breaks(self) -> np.ndarray:  # type: ignore[override]
        t = self._motion.t
        jumps = explicit_time(self._numeric.eom).jumps(self._numeric.p, float(t[0]), float(t[-1]))
        return np.unique([corner.time for corner in jumps])

    @cached_property
    def _follower(self) -> PathFollower | VelocityLevelMotion:
        return _follower(self._numeric, self.breaks.tolist())

    def spans(self) -> Spans:
        motion = self._motion
        return Spans(np.zeros(motion.t.size, int), motion.t, self._states(motion))

    def _states(self, motion: DrivenMotion) -> States:
        return States(motion.q, motion.v, motion.z[:, self._numeric.eom.followed_states])

    def _corrected(self, places: Places, states: States) -> DrivenMotion:
        eom = self._numeric.eom
        z = np.full((places.t.size, eom.z.numel()), np.nan)
        z[:, eom.followed_states] = states.z
        return self._follower.correct(places.t, states.q, z)

    def rates(self, places: Places, states: States) -> tuple[np.ndarray, np.ndarray]:
        motion, eom = self._corrected(places, states), self._numeric.eom
        rates = eom.function(eom.z_rate[eom.followed_states])
        lam, u = (np.tile(x[:, None], places.t.size) for x in (np.zeros(eom.lam.numel()), eom.input_values))
        state = motion.q.T, motion.v.T, motion.a.T, motion.z.T, lam, u
        followed = rates(places.t[None], *state, self._numeric.p).full().T
        return motion.a, followed.reshape(places.t.size, len(eom.followed_states))  # also of none

    def on_constraints(self, places: Places, states: States) -> States:
        return self._states(self._corrected(places, states))

    def complete(self, places: Places, states: States) -> Arrays:
        motion, eom = self._corrected(places, states), self._numeric.eom
        lam = np.full((places.t.size, eom.lam.numel()), np.nan)
        return motion.q, motion.v, motion.a, motion.z, lam, np.tile(eom.input_values, (places.t.size, 1))

    def again(self, stretches: Sequence[Stretch]) -> list[States]:
        results = []
        for one in stretches:
            z = self._numeric.eom.estimate[2].copy()
            z[self._numeric.eom.followed_states] = one.state.z.ravel()
            motion = self._follower.run(np.r_[one.start, one.times], one.state.q.ravel(), z)
            results.append(self._states(motion).at(slice(1, None)))
        return results


def check_driven(numeric: NumericEquations, t: float, q: np.ndarray, what: str) -> None:
    """Raise if drivers leave degrees of freedom in a pose."""
    n = numeric.eom.q.numel()
    if numeric.rank(t, q).rank == n:
        return
    free = n - mobility(numeric, t, q).rank
    if free > 0:
        raise MechanismError(
            f"{what} needs a mechanism that is driven in every degree of freedom, and this one has {free} "
            f"degree{'s' if free > 1 else ''} of freedom left at t = {t:.6g} s: add a Driver for each, or use simulate",
            time=t,
        )
