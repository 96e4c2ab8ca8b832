"""Places out of reach: poses at the waypoints and at the end, assembled before anything is solved.

What the linkage cannot reach, no motion reaches: conditions on positions that no pose meets, or to whose pose no
continuous motion leads, are reported at once, and not after a search for a motion, see :func:`mbdcasadi.reachable`.
Each place is looked at alone, with free parameters and free times among the unknowns, so that whatever is feasible
passes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import casadi as ca
import numpy as np

from ...assembly.followed_states import without_servos
from ...kinematics.branches import Branches
from ...kinematics.reach import Free, Reach
from ...kinematics.reachable import Obstacle, obstacle_to
from ...model.conditions import Condition, stacked
from ...model.mechanism import Mechanism
from ...numerics.lazy import cached_property
from ...results.phases import places_in
from ...results.state import State
from ..motion.guess import Guess
from ..poses.consistency import at_end_alone
from ..poses.pose_system import Place, PoseSystem
from ..program.problem_setup import ProblemSetup
from ..program.setup import PhaseSetup
from ..solve.failure import not_reached
from ..statement.phase import Phase, on_positions
from ..statement.state_conditions import state_conditions

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
        parts = [guess.phases[k] for guess in candidates]
        poses = [part.sample(part.segment_times[[stated.place]])["q"][0] for part in parts]
        if stated.state is not None:
            poses = [stated.state.q]
        obstacle = _obstacle(setup, loops, stated, [*poses, path.pose_at(stated.times[1])])
        if obstacle is not None:
            raise not_reached(stated.name, obstacle)


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
    """Closed loops of one degree of freedom of the first phase, if the start decides their pose."""

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

    def branches(self, stated: Stated) -> Branches | None:
        """The loops, if the start decides them, and all joints and bodies stay up to a place; else None."""
        first, *others = self._setup.problem.phases[: stated.number + 1]
        stays = all(_holds_all(other.mechanism, first.mechanism) for other in others)
        return self._branches if self._are_decided and stays else None

    @cached_property
    def _branches(self) -> Branches:
        setup = self._setup
        unknown = ca.vertcat(ca.SX(0, 1), *setup.problem.free_parameters)
        return Branches(without_servos(setup.setups[0].numeric), setup.start.q, unknown)


def _holds_all(mechanism: Mechanism, first: Mechanism) -> bool:
    """Return True if a mechanism has the bodies of the first one, and all of its joints and drivers."""
    held = {*mechanism.joints, *mechanism.drivers}
    return mechanism.bodies == first.bodies and held.issuperset({*first.joints, *first.drivers})


def _obstacle(setup: ProblemSetup, loops: _Loops, stated: Stated, poses: Sequence[np.ndarray]) -> Obstacle | None:
    """What keeps the mechanism of a place from there; None if nothing was found."""
    own, phase = setup.setups[stated.number], setup.problem.phases[stated.number]
    eom, system = phase.equations, PoseSystem(setup.problem, {part.phase: part.numeric for part in setup.setups})
    places: dict[Phase, Place] = {phase: (phase, eom.t, eom.q)}
    for other in stated.following:
        places[other] = other, eom.t, eom.q[places_in(eom.q, other.equations.q)]

    def rows(conditions: Sequence[tuple[Phase, Condition]]) -> list[Condition]:
        chosen = [(of, c) for of, c in conditions if on_positions(c.expression)]
        return [replace(c, expression=system.value(c.expression, places[of])) for of, c in chosen]

    low, typical, high = stated.times
    symbols, values = ca.vertsplit(system.free) if system.parameters else [], setup.free_values.tolist()
    free = [
        Free(symbol, p.label, value, p.lower, p.upper, size)
        for symbol, p, value, size in zip(symbols, system.parameters, values, system.sizes.tolist(), strict=True)
    ]
    free.append(Free(eom.t, "t", typical, low, high, (high - low) or 1.0))
    numeric = without_servos(own.numeric)
    reach = Reach(numeric, system.value(eom.closing, places[phase]), rows(stated.conditions), free, setup.start.z)
    if not reach.rows:
        return None
    limits = [(phase, c) for c in phase.path if not c.equality and not stated.number]
    return obstacle_to(reach, poses, loops.branches(stated), lambda: rows(limits), own.start.q)


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
