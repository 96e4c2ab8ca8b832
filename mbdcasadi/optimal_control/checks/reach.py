"""Places out of reach: poses at the waypoints and at the end, assembled before anything is solved.

What the linkage cannot reach, no motion reaches: conditions on positions that no pose meets are reported at once, and
not after a search for a motion. Each place is looked at alone, with free parameters and free times among the unknowns,
so that whatever is feasible passes; what is found out of reach by little, or not from several starts, is left to the
solver.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import casadi as ca
import numpy as np

from ...assembly.pose import PoseProblem
from ...equations.numeric import FARTHEST, LARGE
from ...errors import MechanismError
from ...model.conditions import Condition, stacked
from ...numerics.console import without_warnings
from ...numerics.evaluation import Evaluator
from ...numerics.least_squares import largest
from ...numerics.nearest import nearest_finder
from ...numerics.newton import solve
from ...results.phases import places_in
from ...results.state import State
from ..guess.guess import Guess
from ..guess.pose_system import Place, PoseSystem
from ..nlp.problem_setup import ProblemSetup
from ..nlp.setup import PhaseSetup
from ..phase import Phase, on_positions, with_parameters
from .consistency import at_end_alone
from .failure import OptimizationError, Violation, out_of_reach

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


@dataclass(frozen=True)
class _Stated:
    """What holds at a place: phases in whose mechanisms the pose is one, with their conditions on positions."""

    name: str
    #: index of the phase that ends or is under way there, and of the place among its start, waypoints and end
    number: int
    place: int
    #: earliest, typical and latest time, s
    times: tuple[float, float, float]
    conditions: list[tuple[Phase, Condition]]
    #: phases that begin there, whose mechanisms the pose must fit as well
    following: tuple[Phase, ...] = ()


def check_reach(setup: ProblemSetup, candidates: Sequence[Guess]) -> None:
    """Raise an :class:`OptimizationError` if no pose that is tried meets the conditions of a waypoint or of an end.

    `candidates` are the guesses from which the problem is solved; a place that one of them meets is not looked at.
    """
    if any(s.numeric.eom.q.numel() * s.numeric.eom.lam.numel() > LARGE for s in setup.setups):
        return
    for stated in _places(setup):
        k = stated.number
        path = setup.setups[k].path
        if path.complete and len(setup.setups) == 1 and _limits_hold(setup.setups[k], stated):
            continue
        parts = [guess.phases[k] for guess in candidates]
        poses = [part.sample(part.segment_times[[stated.place]])["q"][0] for part in parts]
        error = _Reach(setup, stated).refusal([*poses, path.pose_at(stated.times[1])])
        if error is not None:
            raise error


def _limits_hold(setup: PhaseSetup, stated: _Stated) -> bool:
    """Return True if the pose on the path meets all limits of positions at a place; False if that is not known."""
    limits = [c for _, c in stated.conditions if not c.equality and on_positions(c.expression)]
    rows, eom, time = stacked(limits), setup.phase.equations, stated.times[1]
    if not limits or not eom.contains(rows):
        return not limits
    q, zero, z = setup.path.pose_at(time), np.zeros(eom.q.numel()), setup.start.z
    values = eom.value(rows, (time, q, zero, zero, z, np.zeros(eom.lam.numel()), eom.input_values, setup.numeric.p))
    return bool(np.all(values <= 0.0))


def _places(setup: ProblemSetup) -> Iterator[_Stated]:
    """Waypoints and ends of the phases, with their conditions."""
    phases, earliest, latest = setup.problem.phases, 0.0, 0.0

    def stated(phase: Phase, conditions: State | Sequence[Condition], prefix: str) -> list[tuple[Phase, Condition]]:
        suffix = f" in phase '{phase.name}'" if len(phases) > 1 else ""
        rows = [] if isinstance(conditions, State) else conditions
        return [(phase, replace(c, label=f"{prefix}{c.label}{suffix}")) for c in rows]

    for k, phase in enumerate(phases):
        if phase.is_instant:
            continue
        times, path = setup.setups[k].path.segment_times.tolist(), stated(phase, phase.path, "")
        for j, (waypoint, t) in enumerate(zip(phase.waypoints, times[1:-1], strict=True), start=1):
            span = earliest + waypoint.time[0], t, latest + waypoint.time[1]
            yield _Stated(f"waypoint {j}", k, j, span, [*stated(phase, waypoint.conditions, f"waypoint {j}: "), *path])
        earliest, latest = earliest + phase.span[0], latest + phase.span[1]
        rows, following = [*stated(phase, phase.final, "final: "), *path], _following(phases, k)
        for other in following:
            names = [f"change into phase '{other.name}': {name} closes" for name in other.law.position_names]
            closing = zip(ca.vertsplit(other.law.positions), names, strict=True)
            rows += [(other, Condition(row, True, name)) for row, name in closing]
            rows += [*stated(other, other.initial, "initial: "), *stated(other, other.path, "")]
            rows += stated(other, other.final, "final: ") if other.is_instant else []
        if k + len(following) == len(phases) - 1 and (not following or following[-1].is_instant):
            rows += [(phases[-1], replace(c, label=f"boundary: {c.label}")) for c in at_end_alone(setup.problem)]
        name = "the end" if len(phases) == 1 else f"the end of phase '{phase.name}'"
        yield _Stated(name, k, len(times) - 1, (earliest, times[-1], latest), rows, following)


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

    def __init__(self, setup: ProblemSetup, stated: _Stated):
        numerics = {part.phase: part.numeric for part in setup.setups}
        super().__init__(setup.problem, numerics)
        phase = setup.problem.phases[stated.number]
        self.values = setup.free_values
        self._stated, self._numeric, self._z = stated, numerics[phase], setup.start.z
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
        self._expressions = values
        self._equality = np.r_[np.ones(len(self._elements), bool), [c.equality for _, c in self.rows]].astype(bool)

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
        """The error if no pose meets the conditions, from some poses and from random ones; None if one may."""
        if not self.rows:
            return None
        given = [self._start(q) for q in poses]
        sizes = self._row_sizes(given)
        if any(self._is_met(x, sizes) for x in given) or self._is_assembled(poses[-1]):
            return None
        random = np.random.default_rng(0)
        starts = [*given, *[self._random_start(poses, random) for _ in range(STARTS)]]
        sizes = self._row_sizes(starts)
        nearest, found = self._finder(sizes), list[np.ndarray]()
        for k, start in enumerate(starts):
            # conditions at first, as far as they can be met: an angle that is many turns away, for instance
            moved = self._by_newton(start, sizes)
            if self._is_met(moved, sizes):
                return None
            found.append(nearest(moved if k % 2 else start))
            if self._is_met(found[-1], sizes):
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

    def _is_assembled(self, q: np.ndarray) -> bool:
        """True if the assembly meets the conditions from a pose, at the values that what is free has to begin with."""
        if self._stated.following:
            return False
        extra = self._problem.extra_parameters(self._problem.phases[self._stated.number])
        known = dict(zip(self.parameters, self.values.tolist(), strict=True))
        conditions = with_parameters([c for _, c in self.rows], extra, known)
        try:
            with without_warnings():
                PoseProblem(self._numeric, conditions, self._stated.times[1], self._z).solve(q)
        except MechanismError:
            return False
        return True

    def _by_newton(self, x: np.ndarray, sizes: np.ndarray) -> np.ndarray:
        """Point at which equalities are met, or missed by least in the sum of squares, from another one."""
        chosen = np.flatnonzero(self._equality)

        def rows(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            values, slopes = self._function(x)
            return (values.ravel() / sizes)[chosen], (slopes / sizes[:, None])[chosen]

        moved = solve(rows, x, self._sizes**-2, step_limit=self._sizes).x
        return moved if largest(moved) < np.inf else x

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
