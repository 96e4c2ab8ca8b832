"""Places out of reach: poses at the waypoints and at the end, assembled before anything is solved.

What the linkage cannot reach, no motion reaches: conditions on positions that no pose meets are reported at once, and
not after a search for a motion. Each place is looked at alone, with free parameters and free times among the unknowns,
so that whatever is feasible passes; what is found out of reach by little, or not from several starts, is left to the
solver. Poses that can be assembled, but to which no continuous motion leads, are the matter of :mod:`connected`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import casadi as ca
import numpy as np

from ...assembly.pose import PoseProblem
from ...equations.numeric import FARTHEST
from ...equations.tree import tree_coordinates
from ...errors import MechanismError, OptimizationError
from ...model.conditions import Condition, stacked
from ...numerics.console import without_warnings
from ...numerics.evaluation import Evaluator
from ...numerics.lazy import cached_property
from ...numerics.least_squares import largest
from ...numerics.nearest import nearest_finder
from ...numerics.newton import solve
from ...results.phases import places_in
from ...results.state import State
from ..motion.guess import Guess
from ..poses.consistency import at_end_alone
from ..poses.pose_system import Place, PoseSystem
from ..program.problem_setup import ProblemSetup
from ..program.setup import PhaseSetup
from ..solve.failure import Violation, not_connected, out_of_reach
from ..statement.phase import Phase, on_positions, with_parameters
from ..statement.state_conditions import state_conditions
from .connected import Loop, loops_of_one_freedom

#: Random poses from which the nearest one to a place is looked for.
STARTS = 24
#: Number of starts that must lead to the same least miss, and the share of it up to which misses are the same.
AGREEING, SAME_MISS = 5, 0.01
#: Miss, in typical sizes, from which a place counts as out of reach.
OUT_OF_REACH = 1e-3
#: Weight of a gap of the linkage beside a miss, and of the distance from the start.
CLOSED, NEARNESS = 1e6, 1e-8
#: Share of the largest load from which a joint counts as one that holds the linkage back, and of the largest miss from
#: which a condition is reported.
HOLDING, SHOWN = 0.05, 1e-3
#: Relative distance from a limit of a free parameter at which this is at it.
AT_LIMIT = 1e-5
#: Longest step between poses that surely lie on one branch, rad or sizes of the mechanism.
SURE_STEP = 0.35


@dataclass(frozen=True)
class Stated:
    """What holds at a place: phases in whose mechanisms the pose is one, with their conditions on positions."""

    name: str
    #: index of the phase that ends or is under way there, and of the place among its start, waypoints and end
    number: int
    place: int
    #: earliest, typical and latest time, s
    times: tuple[float, float, float]
    conditions: list[tuple[Phase, Condition]]
    #: the state that holds there, whose coordinates are among the conditions
    state: State | None = None
    #: phases that begin there, whose mechanisms the pose must fit as well
    following: tuple[Phase, ...] = ()


def check_reach(setup: ProblemSetup, candidates: Sequence[Guess]) -> None:
    """Raise an :class:`OptimizationError` if no pose that is tried meets the conditions of a waypoint or of an end.

    `candidates` are the guesses from which the problem is solved; a place that one of them meets is not looked at.
    """
    if any(s.numeric.eom.is_large for s in setup.setups):
        return
    loops = _Loops(setup)
    if setup.of_start.get_or_create("path through all places", partial(_leads_through_all, setup, loops)):
        return
    for stated in places(setup):
        k = stated.number
        path = setup.path if k == 0 else setup.setups[k].path
        if _is_met(setup, loops, stated):
            continue
        parts, reach = [guess.phases[k] for guess in candidates], _Reach(setup, stated)
        poses = [part.sample(part.segment_times[[stated.place]])["q"][0] for part in parts]
        if stated.state is not None:
            poses = [stated.state.q]
        error = reach.refusal([*poses, path.pose_at(stated.times[1])]) or loops.refusal(reach, stated)
        if error is not None:
            raise error


def _leads_through_all(setup: ProblemSetup, loops: _Loops) -> bool:
    """Return True if the path of the only phase surely meets the conditions of all places."""
    return len(setup.setups) == 1 and all(_is_met(setup, loops, stated) for stated in places(setup))


def _is_met(setup: ProblemSetup, loops: _Loops, stated: Stated) -> bool:
    """Return True if the path of the only phase surely meets the conditions of a place."""
    if len(setup.setups) > 1 or not setup.path.complete:
        return False
    return _limits_hold(setup.setups[0], stated) and not loops.are_in_doubt(stated)


def _limits_hold(setup: PhaseSetup, stated: Stated) -> bool:
    """Return True if the pose on the path meets all limits of positions at a place; False if that is not known."""
    time = stated.times[1]
    return _hold_at(setup, [c for _, c in stated.conditions], np.array([time]), setup.path.pose_at(time)[None, :])


def _hold_at(setup: PhaseSetup, conditions: Sequence[Condition], times: np.ndarray, poses: np.ndarray) -> bool:
    """Return True if poses (k, n) at times (k,) meet limits of positions; False if that is not known."""
    limits = [c for c in conditions if not c.equality and on_positions(c.expression)]
    rows, eom = stacked(limits), setup.phase.equations
    if not limits or not eom.contains(rows):
        return not limits
    zero, m = np.zeros(eom.q.numel()), np.zeros(eom.lam.numel())
    more = zero, zero, setup.start.z, m, eom.input_values, setup.numeric.p
    return bool(np.all(eom.function(rows)(times[None, :], poses.T, *more).full() <= 0.0))


class _Loops:
    """Closed loops of one degree of freedom in the first phase, if the start decides their pose."""

    def __init__(self, setup: ProblemSetup):
        first = setup.setups[0]
        self._setup, self._path = setup, setup.path
        self._are_decided = first.ends.initial is None and first.phase.equations.has_loops

    def are_in_doubt(self, stated: Stated) -> bool:
        """True if poses that lead to a place may jump to another branch or break a limit, or miss a state there."""
        if not self._are_decided or stated.number:
            return False
        path, setup = self._path, self._setup.setups[0]
        before = path.times <= stated.times[1]
        steps = np.linalg.norm(np.diff(path.poses[before], axis=0) / setup.numeric.scale.coordinates, axis=1)
        jumps = bool(np.max(steps, initial=0.0) > SURE_STEP) or stated.state is not None
        return jumps or not _hold_at(setup, setup.phase.path, path.times[before], path.poses[before])

    @cached_property
    def _loops(self) -> list[tuple[Loop, list[int]]]:
        setup = self._setup
        unknown = ca.vertcat(ca.SX(0, 1), *setup.problem.free_parameters)
        return list(loops_of_one_freedom(setup.setups[0].numeric, setup.start.q, unknown))

    def refusal(self, reach: _Reach, stated: Stated) -> OptimizationError | None:
        """The error if no continuous motion leads from the start to a place; None if one may."""
        if not self._are_decided or stated.number or not reach.rows:
            return None
        path = [c for c in self._setup.problem.phases[0].path if not c.equality and on_positions(c.expression)]
        for loop, coordinates in self._loops:
            conditions = [(k, e, reach.rows[k][1].equality) for k, e in self._of(coordinates, reach.expressions)]
            limits = [(path[k], e) for k, e in self._of(coordinates, reach.in_pose(path))]
            pose = None if reach.assembled is None else reach.assembled[coordinates]
            separated = loop.separated(conditions, limits, pose)
            if separated is not None:
                return not_connected(stated.name, separated, reach.violations(separated.misses))
        return None

    def _of(self, coordinates: list[int], expressions: Sequence[ca.SX]) -> list[tuple[int, ca.SX]]:
        """Expressions that depend on the pose of a loop alone, by their places."""
        eom, tree = (of := self._setup.setups[0].numeric.eom), tree_coordinates(of)
        inside = [ca.substitute(expression, eom.q, tree.q) for expression in expressions]
        symbols, known = eom.q[coordinates], {s.element_hash() for s in ca.vertsplit(eom.q[coordinates])}
        within = [{s.element_hash() for s in ca.symvar(e)} <= known and ca.depends_on(e, symbols) for e in inside]
        return [(k, e) for k, (e, holds) in enumerate(zip(inside, within, strict=True)) if holds]


def places(setup: ProblemSetup) -> Iterator[Stated]:
    """Waypoints and ends of the phases, with their conditions."""
    phases, earliest, latest = setup.problem.phases, 0.0, 0.0

    def stated(phase: Phase, conditions: State | Sequence[Condition], prefix: str) -> list[tuple[Phase, Condition]]:
        suffix = f" in phase '{phase.name}'" if len(phases) > 1 else ""
        if isinstance(conditions, State):
            conditions = state_conditions(phase.equations, conditions)
        # what only defines the magnitude of a part of the cost can always be met
        met = [c for c in conditions if not c.definition]
        return [(phase, replace(c, label=f"{prefix}{c.label}{suffix}")) for c in met]

    for k, phase in enumerate(phases):
        if phase.is_instant:
            continue
        times, path = setup.setups[k].path.segment_times.tolist(), stated(phase, phase.path, "")
        for j, (waypoint, t) in enumerate(zip(phase.waypoints, times[1:-1], strict=True), start=1):
            span = earliest + waypoint.time[0], t, latest + waypoint.time[1]
            yield Stated(f"waypoint {j}", k, j, span, [*stated(phase, waypoint.conditions, f"waypoint {j}: "), *path])
        earliest, latest = earliest + phase.span[0], latest + phase.span[1]
        rows, following = [*stated(phase, phase.final, "final: "), *path], _following(phases, k)
        for other in following:
            names = [f"change into phase '{other.name}': {name} closes" for name in other.law.position_names]
            closing = zip(ca.vertsplit(other.law.positions), names, strict=True)
            rows += [(other, Condition(row, True, name)) for row, name in closing]
            rows += [*stated(other, other.initial, "initial: "), *stated(other, other.path, "")]
            rows += stated(other, other.final, "final: ") if other.is_instant else []
        if k + len(following) == len(phases) - 1 and (not following or following[-1].is_instant):
            at_end = [c for c in at_end_alone(setup.problem) if not c.definition]
            rows += [(phases[-1], replace(c, label=f"boundary: {c.label}")) for c in at_end]
        name = "the end" if len(phases) == 1 else f"the end of phase '{phase.name}'"
        state = phase.final if isinstance(phase.final, State) else None
        yield Stated(name, k, len(times) - 1, (earliest, times[-1], latest), rows, state, following)


def _following(phases: Sequence[Phase], k: int) -> tuple[Phase, ...]:
    """Phases that begin where a phase ends: the next one and, if it has no duration, those after it."""
    following: list[Phase] = []
    for phase in phases[k + 1 :]:
        following.append(phase)
        if not phase.is_instant:
            break
    return tuple(following)


class _Reach(PoseSystem):
    """Conditions on the pose at one place; the unknowns are the pose, the free parameters, and the time."""

    def __init__(self, setup: ProblemSetup, stated: Stated):
        numerics = {part.phase: part.numeric for part in setup.setups}
        super().__init__(setup.problem, numerics)
        phase = setup.problem.phases[stated.number]
        self.values = setup.free_values
        self._stated, self._numeric, self._z = stated, numerics[phase], setup.start.z
        #: a pose that meets the conditions, if one was found
        self.assembled: np.ndarray | None = None
        self._first = setup.setups[stated.number].start.q
        eom = self._numeric.eom
        q, t = ca.SX.sym("q", eom.q.numel()), ca.SX.sym("t")
        self._unknowns = ca.vertcat(q, self.free, t)
        places: dict[Phase, Place] = {phase: (phase, t, q)}
        for other in stated.following:
            places[other] = other, t, q[places_in(eom.q, other.equations.q)]
        self.rows = [(of, c) for of, c in stated.conditions if on_positions(c.expression)]
        #: names of the elements whose position rows close the linkage
        self._elements = [eom.row_elements[k].name for k in eom.position_rows]
        values = ca.vertcat(
            self.value(eom.Phi, places[phase]), *[self.value(c.expression, places[of]) for of, c in self.rows]
        )
        slopes = ca.jacobian(values, self._unknowns)
        self._function = Evaluator(ca.Function("rows", [self._unknowns], [ca.densify(values), ca.densify(slopes)]))
        self._expressions, self._pose, self._place = values, q, places[phase]
        self._equality = np.r_[np.ones(len(self._elements), bool), [c.equality for _, c in self.rows]].astype(bool)

    @property
    def expressions(self) -> list[ca.SX]:
        """Conditions in the coordinates of the mechanism."""
        rows = ca.vertsplit(self._expressions)[len(self._elements) :]
        return [ca.substitute(row, self._pose, self._numeric.eom.q) for row in rows]

    def in_pose(self, conditions: Sequence[Condition]) -> list[ca.SX]:
        """Other conditions of the phase, in the same coordinates."""
        return [
            ca.substitute(self.value(c.expression, self._place), self._pose, self._numeric.eom.q) for c in conditions
        ]

    @property
    def _closure(self) -> slice:
        return slice(0, len(self._elements))

    @property
    def _free(self) -> slice:
        """Places of what is free besides the pose: parameters and the time."""
        return slice(self._numeric.eom.q.numel(), self._unknowns.numel())

    @property
    def _ranges(self) -> list[tuple[float, float]]:
        """Limits of what is free besides the pose."""
        low, _, high = self._stated.times
        return [*((p.lower, p.upper) for p in self.parameters), (low, high)]

    @property
    def _sizes(self) -> np.ndarray:
        """Typical sizes of the unknowns."""
        low, _, high = self._stated.times
        return np.r_[self._numeric.scale.coordinates, self.sizes, (high - low) or 1.0]

    def refusal(self, poses: Sequence[np.ndarray]) -> OptimizationError | None:
        """The error if no pose meets the conditions, from some poses and from random ones; None if one may.

        A pose that does is kept in :attr:`assembled`.
        """
        if not self.rows:
            return None
        given = [self._start(q) for q in poses]
        sizes = self._row_sizes(given)
        self.assembled = next((x[: self._free.start] for x in given if self._is_met(x, sizes)), None)
        if self.assembled is None:
            self.assembled = self._by_assembly(poses[-1])
        if self.assembled is not None:
            return None
        random = np.random.default_rng(0)
        starts = [*given, *[self._random_start(poses, random) for _ in range(STARTS)]]
        sizes = self._row_sizes(starts)
        nearest, found = self._finder(sizes), list[np.ndarray]()
        for k, start in enumerate(starts):
            # conditions at first, as far as they can be met: an angle that is many turns away, for instance
            moved = self._turned(self._by_newton(start, sizes), sizes)
            if not self._is_met(moved, sizes):
                found.append(nearest(moved if k % 2 else start))
                moved = found[-1]
            if self._is_met(moved, sizes):
                self.assembled = moved[: self._free.start]
                return None
        misses = np.array([self._price(x, sizes) for x in found])
        least = float(np.min(misses))
        if not least < np.inf or np.sum(misses <= (1 + SAME_MISS) * least) < AGREEING:
            return None
        return self._error(found[int(np.argmin(misses))], sizes, len(found))

    # --- poses to begin with --------------------------------------------------------------------
    def _start(self, q: np.ndarray) -> np.ndarray:
        low, typical, high = self._stated.times
        return np.r_[q, self.values, np.clip(typical, low, high)]

    def _random_start(self, poses: Sequence[np.ndarray], random: np.random.Generator) -> np.ndarray:
        """A random pose, in which the linkage is closed if it can be, with random values of what is free."""
        numeric, near = self._numeric, poses[int(random.integers(len(poses)))]
        reach = np.where(numeric.eom.angles, np.pi, FARTHEST * numeric.scale.coordinates)
        q = near + reach * random.uniform(-1, 1, near.size)
        t = float(random.uniform(self._stated.times[0], self._stated.times[2]))
        closed = solve(partial(numeric.position, t), q, numeric.weights, step_limit=numeric.step_limit).x
        values = self.within_limits(self.values + 0.5 * self.sizes * random.uniform(-1, 1, self.values.size))
        return np.r_[closed if largest(closed) < np.inf else q, values, t]

    def _by_assembly(self, q: np.ndarray) -> np.ndarray | None:
        """The pose that is assembled from another one, at the values that what is free has to begin with."""
        if self._stated.following:
            return None
        extra = self._problem.extra_parameters(self._problem.phases[self._stated.number])
        known = dict(zip(self.parameters, self.values.tolist(), strict=True))
        conditions = with_parameters([c for _, c in self.rows], extra, known)
        try:
            with without_warnings():
                return PoseProblem(self._numeric, conditions, self._stated.times[1], self._z).solve(q)
        except MechanismError:
            return None

    def _by_newton(self, x: np.ndarray, sizes: np.ndarray) -> np.ndarray:
        """Point at which equalities are met, or missed by least in the sum of squares, from another one."""
        chosen = np.flatnonzero(self._equality)

        def rows(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            values, slopes = self._function(x)
            return (values.ravel() / sizes)[chosen], (slopes / sizes[:, None])[chosen]

        moved = solve(rows, x, self._sizes**-2, step_limit=self._sizes).x
        return moved if largest(moved) < np.inf else x

    def _turned(self, x: np.ndarray, sizes: np.ndarray) -> np.ndarray:
        """The point with bodies turned by whole turns as long as less is missed: limits may be met so alone."""
        price = self._price(x, sizes)
        for k in np.flatnonzero(self._numeric.eom.angles).tolist():
            for turn in (2 * np.pi, -2 * np.pi):
                while (less := self._price(turned := x + turn * np.eye(x.size)[k], sizes)) < (1 - SAME_MISS) * price:
                    x, price = turned, less
        return x

    # --- the nearest pose -----------------------------------------------------------------------
    def _row_sizes(self, points: Sequence[np.ndarray]) -> np.ndarray:
        """Typical changes of the rows (k,): the largest ones at some points."""
        changes = [np.abs(self._function(x)[1]) @ self._sizes for x in points]
        size = np.max(np.where(np.isfinite(changes), changes, 0.0), axis=0)
        return np.where(size > 0, size, 1.0)

    def _misses(self, x: np.ndarray, sizes: np.ndarray) -> np.ndarray:
        """Amounts by which rows are missed, in their typical sizes (k,)."""
        values = self._function(x)[0].ravel() / sizes
        return np.where(self._equality, np.abs(values), np.maximum(values, 0.0))

    def _is_met(self, x: np.ndarray, sizes: np.ndarray) -> bool:
        """True if what is missed at a point is so little that the solver may meet it, or is not known."""
        beyond = max((max(low - v, v - high) for v, (low, high) in zip(x[self._free], self._ranges, strict=True)))
        return beyond <= OUT_OF_REACH and not largest(self._misses(x, sizes)) > OUT_OF_REACH

    def _price(self, x: np.ndarray, sizes: np.ndarray) -> float:
        """Square root of the sum of the squares of what is missed, with that of gaps of the linkage."""
        misses = self._misses(x, sizes)
        misses[self._closure] *= np.sqrt(CLOSED)
        return float(np.linalg.norm(misses))

    def _finder(self, sizes: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
        """Function from a point to the one near to it at which least is missed, within the limits of what is free."""
        missed = ca.SX.sym("missed", sizes.size)
        rows = self._expressions / ca.DM(sizes) - missed
        equal, unequal = (
            ca.vertcat(ca.SX(0, 1), *[rows[k] for k in np.flatnonzero(which).tolist()])
            for which in (self._equality, ~self._equality)
        )
        bounds = [
            sign * (symbol - bound)
            for symbol, pair in zip(ca.vertsplit(self._unknowns[self._free]), self._ranges, strict=True)
            for sign, bound in zip((-1, 1), pair, strict=True)
            if np.isfinite(bound)
        ]
        prices = np.ones(sizes.size)
        prices[self._closure] = CLOSED
        find = nearest_finder(
            ca.vertcat(self._unknowns, missed), [equal], [unequal, *bounds], np.r_[NEARNESS / self._sizes**2, prices]
        )
        return lambda x: find(np.r_[x, np.zeros(sizes.size)])[: x.size]

    # --- what is reported -----------------------------------------------------------------------
    def _error(self, x: np.ndarray, sizes: np.ndarray, starts: int) -> OptimizationError:
        misses, t = self._misses(x, sizes), float(x[-1])
        count = len(self._elements)
        shown = [k for k in np.argsort(-misses).tolist() if k >= count and misses[k] > SHOWN * np.max(misses[count:])]
        missed = [self._violation(self.rows[k - count][1], misses[k], sizes[k], t) for k in shown]
        where = self._stated.name
        return out_of_reach(where, missed, self._held_by(x, sizes), starts)

    def violations(self, misses: Mapping[int, float]) -> list[Violation]:
        """Conditions that are missed by amounts, by their places, the largest first."""
        sizes = self._row_sizes([self._start(self._first)])[len(self._elements) :]
        shown = sorted(misses, key=lambda k: -misses[k] / sizes[k])
        time = self._stated.times[1]
        return [self._violation(self.rows[k][1], misses[k] / sizes[k], sizes[k], time) for k in shown]

    def _violation(self, condition: Condition, miss: float, size: float, time: float) -> Violation:
        return Violation(condition.label, float(miss * size), condition.unit, time, None, 1.0, float(miss))

    def _held_by(self, x: np.ndarray, sizes: np.ndarray) -> list[str]:
        """Joints that carry a load if what is missed pulls like springs, and limits of what is free that do."""
        values, slopes = self._function(x)
        slopes = slopes * self._sizes / sizes[:, None]
        pulls = np.where(self._equality, values.ravel() / sizes, self._misses(x, sizes))
        count, n = len(self._elements), self._numeric.eom.q.numel()
        pull = pulls[count:] @ slopes[count:]
        loads = np.linalg.lstsq(slopes[:count, :n].T, -pull[:n], rcond=None)[0]
        rest = pull + loads @ slopes[:count]
        largest_load = np.max(np.abs(loads), initial=0.0)
        names = [f"'{self._elements[k]}'" for k in np.flatnonzero(np.abs(loads) > HOLDING * largest_load).tolist()]
        for p, value, push in zip(self.parameters, x[n:-1].tolist(), rest[n:-1].tolist(), strict=True):
            for bound, sign, relation in ((p.lower, 1, ">="), (p.upper, -1, "<=")):
                near = abs(value - bound) <= AT_LIMIT * max(1.0, abs(bound))
                if near and sign * push > HOLDING * largest(pulls):
                    names.append(f"{p.label} {relation} {bound:g}")
        return list(dict.fromkeys(names))
