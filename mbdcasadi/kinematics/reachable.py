"""Whether a mechanism reaches a place: a pose that meets its conditions, and a continuous motion to there."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from ..assembly.consistent_start import complete_state
from ..assembly.followed_states import led_states, without_servos
from ..assembly.setup import Setup
from ..errors import ExpressionError, ModelError
from ..model.conditions import Condition, Relations, read_conditions
from ..model.mechanism import Mechanism
from ..model.quantities import listed, refuse_twice
from ..model.symbols import Parameter, describe, number, place_of, role_of
from ..numerics.console import keyboard_interrupts
from ..numerics.least_squares import project_velocity
from ..numerics.symbolic import symbolic
from ..results.state import Conditions, State
from .branches import Branches
from .reach import Free, MissedCondition, Reach

#: What keeps a mechanism from a place, and a remedy, by verdict.
_REASONS = {
    "out of reach": ("is out of reach", "change the target, dimensions or limits"),
    "branch": (
        "is on another branch of the linkage: its pose can be assembled, but is one of another assembly configuration, "
        "to which no continuous motion leads from the start",
        "assemble the start on that branch, by the poses of the bodies, or change the target",
    ),
    "turn": (
        "asks for a turn that the linkage cannot make: its pose is on the branch of the start, but no motion reaches "
        "it with as many turns",
        "change the angles of the target by whole turns",
    ),
    "blocked": (
        "cannot be reached within the path limits: every motion of the linkage from the start to there breaks {limits}",
        "widen these limits or change the target",
    ),
    "missed": ("is out of reach: no pose on the branch of the start meets its conditions", "change the target"),
}


@dataclass(frozen=True)
class Obstacle:
    """What keeps a mechanism from a place.

    Attributes
    ----------
    verdict : {"out of reach", "branch", "turn", "blocked", "missed"}
        No pose meets the conditions; it is that of another assembly configuration; it is reached, but not with as many
        turns; poses before it break a path limit; or none is known and none on the branch of the start meets them.
    missed : tuple of MissedCondition
        Conditions that are not met in the pose that comes nearest, the largest first.
    joints, limits : tuple of str
        Joints that keep the mechanism from going on, and limits of what is free; or path limits that block the way.
    """

    verdict: str
    missed: tuple[MissedCondition, ...]
    joints: tuple[str, ...] = ()
    limits: tuple[str, ...] = ()
    #: poses from which the nearest one was looked for
    starts: int = 0
    #: time of that pose, s
    time: float = 0.0

    def text(self, place: str, missed: Sequence[object]) -> str:
        """Return the reason in words, with the name of the place and the missed conditions in words."""
        reason, remedy = _REASONS[self.verdict]
        names, held = _listed([str(one) for one in missed]), [*(f"'{name}'" for name in self.joints), *self.limits]
        if self.verdict == "out of reach":
            nearest = f"in the pose that comes nearest, of those found from {self.starts} starts"
            names += f", held back by {_listed(held)}" if held else ""
        elif self.limits:
            reason = reason.format(limits=" or ".join(self.limits))
            nearest = "in the pose within them that comes nearest"
        else:
            nearest = "in the pose on the branch of the start that comes nearest"
        return f"{place} {reason}; {nearest}, violated are: {names}; {remedy}"


@dataclass(frozen=True)
class Reachability:
    """Whether a mechanism reaches a place; made by :func:`reachable`.

    Attributes
    ----------
    verdict : {"reached", "out of reach", "branch", "turn", "blocked", "missed", "undecided"}
        A pose was found, and nothing that separates it from the start; what is in the way, see the parts of `text`; or
        neither a pose nor a reason was found.
    state : State or None
        A pose that meets the conditions, as slow as the drivers let it be; also one to which no motion leads.
    parameters : dict of Parameter to float
        Values of the free parameters in it.
    missed : tuple of MissedCondition
        If the place is not reached, the conditions that are missed in the nearest pose that is, the largest first.
    joints, limits : tuple of str
        Joints that hold the mechanism back, and limits of free parameters that do; or path limits that block the way.
    text : str
        The verdict in words.
    """

    verdict: str
    state: State | None
    parameters: dict[Parameter, float]
    missed: tuple[MissedCondition, ...]
    joints: tuple[str, ...]
    limits: tuple[str, ...]
    text: str

    @property
    def is_reachable(self) -> bool | None:
        """True if the place is reached, False if not, None if that was not decided."""
        return None if self.verdict == "undecided" else self.verdict == "reached"

    def __repr__(self) -> str:
        return f"Reachability: {self.text}"


def obstacle_to(
    reach: Reach,
    poses: Sequence[np.ndarray],
    branches: Branches | None,
    limits: Callable[[], Sequence[Condition]],
    start: np.ndarray,
) -> Obstacle | None:
    """Return what keeps a mechanism from a place; None if nothing was found.

    Parameters
    ----------
    reach : Reach
        Conditions of the place.
    poses : sequence of numpy.ndarray
        Poses from which one that meets them is looked for, before random ones.
    branches : Branches or None
        Loops through the start, if it decides their poses.
    limits : callable
        Inequalities that hold on the way.
    start : numpy.ndarray
        Pose at the start.
    """
    nearest = reach.nearest(poses)
    if nearest is not None:
        return Obstacle("out of reach", nearest.missed, nearest.joints, nearest.limits, nearest.starts, nearest.time)
    if branches is None or not reach.rows:
        return None
    found = branches.separated(reach.rows, limits(), reach.pose)
    if found is None:
        return None
    blocking = tuple(dict.fromkeys(limit.label for limit in found.limits))
    return Obstacle(found.kind, reach.missed(found.misses, start), limits=blocking, time=reach.free[-1].value)


@symbolic
def reachable(
    mechanism: Mechanism,
    conditions: Relations,
    *,
    path: Relations = (),
    initial: Conditions = (),
    t: float | tuple[float, float] = 0.0,
    free_parameters: Sequence[Parameter] = (),
    parameters: Mapping[Any, Any] | None = None,
) -> Reachability:
    """Find out whether a mechanism reaches a place, and what keeps it from there.

    A pose is looked for that meets the conditions, from the start, from random poses and by least violation. Closed
    loops of one degree of freedom are followed through all their poses: a pose of another assembly configuration, or
    behind one that breaks a limit, is not reached. Loops of more degrees of freedom, and those that are singular on the
    way, count as free to go everywhere.

    Parameters
    ----------
    mechanism : Mechanism
        The model.
    conditions : sequence of relations
        On positions, equalities and limits.
    path : sequence of relations
        On positions; they hold at the place and all the way.
    initial : sequence of relations, or State
        The start; by default the assembled pose nearest to the estimates of the bodies.
    t : float or (float, float)
        Time of the place, s; two numbers: free between them. The start is at the first one.
    free_parameters : sequence of Parameter
        Free within their limits, of the mechanism or of the conditions alone.
    parameters : mapping, optional
        Values other than the parameters' own.

    Returns
    -------
    Reachability
        ``.is_reachable``, ``.state``, ``.missed``, ``.joints``, ``.limits``, ``.text``.

    Raises
    ------
    AssemblyError, ConditionError
        If the start cannot be assembled.
    ExpressionError, ModelError
        For conditions that are not on positions, or of another mechanism.

    Examples
    --------
    >>> import mbdcasadi as mbd
    >>> arm = mbd.Body("arm", mass=1, inertia=0.1, pose=(0.5, 0, 0))
    >>> hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), arm.at(-0.5, 0))
    >>> found = mbd.reachable(mbd.Mechanism(bodies=[arm], joints=[hinge]), [arm.at(0.5, 0).y == 1.2])
    >>> found.is_reachable, found.joints, round(found.missed[0].amount, 3)
    (False, ('hinge',), 0.2)
    """
    first, last = _times(t)
    free = listed(free_parameters, Parameter, "free_parameters=")
    refuse_twice(free, "free_parameters=")
    with keyboard_interrupts("reachable"):
        setup = Setup(mechanism, "reachable", t=first, initial=initial, parameters=parameters)
        start, numeric, eom = setup.start, setup.numeric, setup.eom
        own = [p for p in mechanism.parameters if place_of(p, free) is None]
        values = dict(zip(mechanism.parameters, setup.p.tolist(), strict=True))
        numbers = ca.vertcat(ca.SX(0, 1), *own), ca.DM([values[p] for p in own])

        def rows(given: Any) -> list[Condition]:
            known = [*ca.vertsplit(ca.vertcat(eom.t, eom.q, eom.p)), *free]
            read = [_on_positions(c, known) for c in read_conditions(given)]
            return [replace(c, expression=ca.substitute(c.expression, *numbers)) for c in read]

        on_way = rows(path)
        unknowns = [Free(p, p.label, values.get(p, p.value), p.lower, p.upper, p.typical_size or 1.0) for p in free]
        unknowns.append(Free(eom.t, "t", first, first, last, (last - first) or 1.0))
        free_to_go = without_servos(numeric)
        closing = ca.substitute(eom.closing, *numbers)
        reach = Reach(free_to_go, closing, [*rows(conditions), *on_way], unknowns, start.z)
        branches = Branches(free_to_go, start.q, ca.vertcat(ca.SX(0, 1), *free))
        limits = [c for c in on_way if not c.equality]
        obstacle = obstacle_to(reach, [start.q], branches, lambda: limits, start.q)
        return _answer(setup, reach, obstacle, free)


def _answer(setup: Setup, reach: Reach, obstacle: Obstacle | None, free: Sequence[Parameter]) -> Reachability:
    """The result, with the pose that was found as a state."""
    state, found = None, dict[Parameter, float]()
    if reach.found is not None:
        n = setup.eom.q.numel()
        q, (*values, t) = reach.found[:n], reach.found[n:].tolist()
        found = dict(zip(free, values, strict=True))
        own = {p: found.get(p, value) for p, value in zip(setup.mechanism.parameters, setup.p.tolist(), strict=True)}
        at = Setup(setup.mechanism, "reachable", t=t, parameters=own)
        z = led_states(at.numeric, np.array([t]), q[None, :], 0 * q[None, :], setup.start.z[None, :])[0]
        jacobian, nu = at.numeric.velocity(t, q, z)
        v = project_velocity(jacobian, nu, np.zeros(jacobian.shape[1]), at.numeric.weights)
        state = complete_state(at.numeric, at.signals, t, q, v, z)
    if obstacle is not None:
        text = obstacle.text("the place", obstacle.missed)
        return Reachability(obstacle.verdict, state, found, obstacle.missed, obstacle.joints, obstacle.limits, text)
    if state is None:
        text = "no pose was found that meets the conditions, and no reason why there should be none"
        return Reachability("undecided", None, found, (), (), (), text)
    return Reachability("reached", state, found, (), (), (), "the place is reached")


def _on_positions(condition: Condition, known: Sequence[ca.SX]) -> Condition:
    """A condition, if it contains positions, time and known parameters alone."""
    hashes = {symbol.element_hash() for symbol in known}
    for symbol in condition.symbols:
        if symbol.element_hash() not in hashes:
            role = role_of(symbol)
            beyond = role is not None and role.kind not in ("position", "parameter")
            reason = "; it takes conditions on positions" if beyond else ", which the mechanism does not have"
            raise ExpressionError(f"reachable: {condition.label} contains {describe(symbol)}{reason}")
    return condition


def _times(t: Any) -> tuple[float, float]:
    """First and last time, s."""
    try:
        first, last = t
    except TypeError:
        first = last = t
    except ValueError:
        raise ModelError(f"reachable: t is a number or a pair (lower, upper), got {t!r}") from None
    first, last = number(first, "reachable", "t"), number(last, "reachable", "t")
    if last < first:
        raise ModelError(f"reachable: the limits of t must be in order, got {t!r}")
    return first, last


def _listed(names: Sequence[str], most: int = 4) -> str:
    """Names in a row, of many the first ones."""
    return ", ".join(names[:most]) + ("" if len(names) <= most else f" and {len(names) - most} more")
