"""Batches of cases, with the functions compiled for them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import casadi as ca
import numpy as np

from ..arguments.values import RunValues
from ..errors import MechanismError, warn
from ..model.quantities import whole
from ..results.ranges import Ranges
from ..sensitivity.compiled_run import MotionSetup
from ..sensitivity.load_limit import LoadLimit
from ..sensitivity.reference_run import simulated
from ..simulation.singular.regularity import Regularity, parts_between
from ..simulation.time_dependence import timed_equations
from .cases import farthest
from .plan import Plan
from .starts import StartPath, assembled_start, out_of_limits
from .whole_runs import WholeParcel, refuse_unsuited, times_of
from .worker import Parcel

#: Batches into which the cases are cut, and the largest of them, if the user does not say.
BATCHES, LARGEST_BATCH = 64, 250
#: Cases, as far from each other as they are spread, by which the absolute tolerance and the distance between the poses
#: that are looked at are chosen, and on whose motions short loads are looked for.
RANGES, PROBED = 8, 200


class Jobs:
    """Batches of cases with the functions compiled for them.

    Attributes
    ----------
    in_threads : bool
        True if batches that run in this process share its processors.

    Parameters
    ----------
    setup : MotionSetup
        The mechanism at the first of the cases that can be assembled.
    named : list of (str, casadi.SX)
        Outputs.
    """

    in_threads = False

    def __init__(self, setup: MotionSetup, plan: Plan, named: list[tuple[Any, ca.SX]]):
        self._plan, self.setup = plan, setup
        self._shared: Any = None
        self._channel = setup.signals.channel_over(setup.grid)
        self._path = StartPath(setup)
        self._ranges = Ranges(setup.eom, setup.p, setup.mechanism)
        outputs = [*(e for _, e in named), *(limit.expression for limit in self._ranges.limits)]
        self._column = ca.vertcat(ca.SX(0, 1), *[ca.vec(e) for e in outputs])
        self._prepare(outputs)
        self._kept = sum(e.numel() for _, e in named)
        #: numbers that are kept of a case
        self.width = setup.grid.size * self._kept

    def _prepare(self, outputs: list[ca.SX]) -> None:
        """Make the objects that the cases share."""
        varied = [k for k in range(self.setup.p.size) if np.ptp(self._plan.p[:, k]) > 0]
        self._motion, spread = self.setup.motion(varied, in_state=False), self._spread()
        poses = _poses(lambda *case: self._motion.states_from(*case)[0], spread)
        if self.setup.resolve_all(poses):
            self._motion = self.setup.motion(varied, in_state=False)
        self._look_for_loads(self._motion.load_limit, spread)
        self._outputs = self._motion.outputs(outputs)
        start = self.setup.start
        self._regularity = Regularity(self.setup.numeric, start.t, start.q)
        self._between = max([parts_between(some, self.setup.eom) for some in poses], default=1)
        self._parcels: dict[tuple[Any, ...], Parcel] = {}

    def _look_for_loads(self, limit: LoadLimit, spread: list[tuple[np.ndarray, RunValues]]) -> None:
        """Limit the steps by loads on the motions of cases; report if these are not all."""
        for x0, values in spread:
            limit.look(x0, values, self.setup.grid)
        if limit.is_needed and self._plan.count > PROBED:
            warn(
                f"sweep: contacts and loads that come and go were looked for in {PROBED} of {self._plan.count} cases, "
                "as far from each other as can be; the steps may pass over one that is shorter in another case: sweep "
                f"{PROBED} cases at a time"
            )

    def _spread(self) -> list[tuple[np.ndarray, RunValues]]:
        """Starts of the cases whose values are farthest from each other, and these values."""
        plan = self._plan
        chosen = farthest(np.hstack([plan.p, plan.levels]), PROBED)
        starts, reached = self._path.starts(plan.p[chosen])
        usable = reached & np.all(np.isfinite(starts), axis=1)
        return [(x0, self._values(k)) for x0, k in zip(starts[usable], chosen[usable], strict=True)]

    def simulated(self, cases: np.ndarray) -> tuple[np.ndarray, list[str]]:
        """Outputs of cases as :func:`simulate` finds them (k, n), NaN for one without, and why it has none.

        It continues a motion smoothly across poses in which the mechanism could fold, where compiled runs may leave
        for another branch.
        """
        values, reasons = np.full((cases.size, self.setup.grid.size * self._column.numel()), np.nan), [""] * cases.size
        starts, reached = self._path.starts(self._plan.p[cases])
        for row, k in enumerate(cases.tolist()):
            try:
                x0 = starts[row] if reached[row] else assembled_start(self.setup, self._plan.p[k], k)
                motion, _ = simulated(self.setup.at_values(self.setup.grid, self._values(k)), self.setup.integrator, x0)
                values[row] = motion[self._column].ravel()
            except MechanismError as error:
                reasons[row] = str(error)
        return self.judged(values, reasons)

    def judged(self, values: np.ndarray, reasons: list[str]) -> tuple[np.ndarray, list[str]]:
        """Outputs of cases that are kept (k, n), NaN where a varying quantity leaves its range, and the reasons."""
        grid, reasons = self.setup.grid, list(reasons)
        courses = values.reshape(len(values), grid.size, -1)
        kept = courses[:, :, : self._kept].reshape(len(values), -1)
        for row in (row for row, reason in enumerate(reasons) if not reason and self._ranges.limits):
            broken = self._ranges.first_among(courses[row, :, self._kept :].T)
            if broken is not None:
                reasons[row], kept[row] = f"{broken[1]} at t = {grid[broken[0]]:.6g} s", np.nan
        return kept, reasons

    def _values(self, k: int) -> RunValues:
        """Values of parameters and inputs of a case."""
        return RunValues(self._plan.p[k], self._plan.levels[k], self._channel)

    def courses(self, cases: np.ndarray) -> tuple[dict[int, Any], dict[int, str]]:
        """Cuts of the motions of cases, and the reasons why some have none."""
        courses: dict[int, Any] = {}
        failures = out_of_limits(self.setup, self._plan.p, cases)
        for k in (int(k) for k in cases if int(k) not in failures):
            try:
                courses[k] = self._course(k)
            except MechanismError as error:
                failures[k] = str(error)
        return courses, failures

    def _course(self, k: int) -> Any:
        """The cuts of the motion of a case; one object for all if they do not depend on it."""
        if self._shared is not None:
            return self._shared
        course = self._motion.course(None, self._values(k))
        self._shared = None if self._motion.course_varies else course
        return course

    def parcel(self, course: Any) -> Parcel | WholeParcel:
        """The compiled batch for a course and others of its pattern."""
        if course.pattern not in self._parcels:
            setup, motion = self.setup, self._motion
            x0, cuts = ca.MX.sym("x0", setup.differentiable_start.function.size1_out(0)), course.symbols
            values = motion.symbols(1)._replace(channel=self._channel)
            states, _ = motion.motion(course)(x0, *values, *cuts)
            n = setup.eom.q.numel()
            fall = self._regularity.fall(setup.grid, states[:n, :], states[n : 2 * n, :], values.p, self._between)
            results = [self._outputs(states, *values), states[-1, -1], fall]
            run = ca.Function("run", [x0, *values[:2], *cuts], results)
            span, may_fold = float(setup.grid[-1] - setup.grid[0]), self._regularity.is_needed
            self._parcels[course.pattern] = Parcel(run, self._path, span, may_fold=may_fold)
        return self._parcels[course.pattern]

    def batches(self, courses: dict[int, Any], size: int | None) -> Iterator[tuple[Any, ...]]:
        """Batches of cases with the same pattern: indices, and arguments of :func:`run_batch`."""
        groups: dict[tuple[Any, ...], list[int]] = {}
        for k, course in courses.items():
            groups.setdefault(course.pattern, []).append(k)
        length = batch_size(size, len(courses))
        for members in groups.values():
            for first in range(0, len(members), length):
                yield self.batch(np.array(members[first : first + length]), courses)

    def batch(self, cases: np.ndarray, courses: dict[int, Any], starts: np.ndarray | None = None) -> tuple[Any, ...]:
        """One batch."""
        plan, chosen = self._plan, [courses[int(k)] for k in cases]
        if all(course is chosen[0] for course in chosen):
            arguments = tuple(np.broadcast_to(part, (len(chosen), *part.shape)) for part in chosen[0].arguments)
        else:
            arguments = tuple(np.stack(parts) for parts in zip(*[c.arguments for c in chosen], strict=True))
        return cases, self.parcel(chosen[0]), plan.p[cases], plan.levels[cases], arguments, starts

    def assembled(self, cases: np.ndarray) -> tuple[np.ndarray, np.ndarray, list[str]]:
        """Starts of cases to which no way leads from the first: which have one, these, and messages of others."""
        starts, messages = [], []
        for k in cases:
            try:
                starts.append(assembled_start(self.setup, self._plan.p[k], int(k)))
                messages.append("")
            except MechanismError as error:
                messages.append(str(error))
        good = np.array([not message for message in messages], bool)
        return good, np.array(starts), messages


class WholeJobs(Jobs):
    """Batches of cases that run in C, in threads if they run here."""

    in_threads = True

    def _prepare(self, outputs: list[ca.SX]) -> None:
        setup = self.setup
        refuse_unsuited(setup)
        spread = self._spread()
        trial = WholeParcel(setup, self._path, [setup.eom.q], len(spread))

        def poses_from(x0: np.ndarray, values: RunValues) -> np.ndarray:
            course = tuple(part[None, ...] for part in times_of(setup, values.p).arguments)
            q = trial.results(x0[None, :], values.p[None, :], values.levels[None, :], course).values[0]
            return q.reshape(setup.grid.size, -1)

        setup.resolve_all(_poses(poses_from, spread))
        limit = LoadLimit(setup, setup.integrator)
        self._look_for_loads(limit, spread)
        self._load_step = limit.max_step
        self._shared = None if timed_equations(setup).depends else times_of(setup, setup.p, self._load_step)
        self._whole = WholeParcel(setup, self._path, outputs, self._plan.count)

    def _course(self, k: int) -> Any:
        return self._shared or times_of(self.setup, self._plan.p[k], self._load_step)

    def parcel(self, course: Any) -> WholeParcel:
        return self._whole


def _poses(
    poses_from: Callable[[np.ndarray, RunValues], np.ndarray], spread: list[tuple[np.ndarray, RunValues]]
) -> list[np.ndarray]:
    """Coordinates at the outputs of some of the cases that are spread farthest, each (n_t, n)."""
    poses = []
    for x0, values in spread[:RANGES]:
        try:
            poses.append(poses_from(x0, values))
        except MechanismError:  # the case itself says why
            continue
    return poses


def jobs_of(plan: Plan, named: list[tuple[Any, ca.SX]]) -> Jobs:
    """Batches by the method of a sweep."""
    setup = plan.first_assembled()
    kind = Jobs if setup.integrator.whole_run is None else WholeJobs
    return kind(setup, plan, named)


def batch_size(size: int | None, count: int) -> int:
    """Return the number of cases in a batch: the user's, or one that divides the cases into some batches."""
    if size is None:
        return max(1, min(LARGEST_BATCH, -(-count // BATCHES)))
    return whole(size, "sweep", "batch", 1)
