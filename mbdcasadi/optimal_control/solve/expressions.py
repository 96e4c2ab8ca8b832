"""Expressions of a problem that a solver with derivatives cannot follow: kinks, and values that are not finite."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator

import casadi as ca
import numpy as np

from ...equations.switching.continuity import Surroundings, continuous_switches
from ...equations.switching.held import JumpingPart, jumping_parts, part_of
from ...equations.switching.switches import Switch, hold
from ...model.placeholders import placeholders_in
from ...model.texts import text_of
from ...numerics.graph import operands, operations
from ...numerics.operations import BENDING, JUMPING, border_of
from ...numerics.tolerances import NEGLIGIBLE
from ..motion.phase_solution import PhaseSolution
from ..problem import OptimalControlProblem
from ..solution import Solution
from ..statement.phase import Phase

#: Longest text of an expression in a message.
_LONGEST = 60
#: Points of an interval at which it is looked on which side of a jump it is.
_TAUS = np.linspace(0, 1, 5)
#: Share of the largest value of what passes a border below which it is at that.
AT_BORDER = 1e-8


def kinks_in(expression: ca.SX, decided: Collection[int] = ()) -> list[str]:
    """Return in words where the slope of an expression jumps: at operations such as ``fabs``, and at comparisons.

    The square of a positive part is smooth, and is not named; nor is what follows from symbols alone that are `decided`
    before, given by their hashes, as times and parameters that are not free.
    """
    whole = ca.vertcat(expression, *[p.expression for p in placeholders_in(expression)])
    if not any(operations(whole, (*BENDING, *JUMPING))):
        return []
    symbols = ca.vertcat(ca.SX(0, 1), *ca.symvar(whole))
    nodes = list(operations(whole, (*BENDING, ca.OP_ATAN2)))
    angles = [node.element_hash() for op, node in nodes if op == ca.OP_ATAN2]  # they jump at ±π alone
    held, switches = hold([whole, ca.jacobian(whole, symbols)], free=angles)
    smooth = _continuous(held, switches, symbols)
    free = ca.vertcat(ca.SX(0, 1), *[x for x in ca.symvar(whole) if x.element_hash() not in decided])
    sharp = [s for s in switches if s.node not in smooth and free.numel() and ca.depends_on(s.natural, free)]
    return _named(sharp, [node for op, node in nodes if op in BENDING], symbols)


def _named(sharp: list[Switch], bends: list[ca.SX], symbols: ca.SX) -> list[str]:
    """Switches over which a slope jumps, in words, each by the operation of `bends` whose border is the same."""
    borders = [border_of(node.op(), operands(node)) for node in bends]
    place = np.random.default_rng(0).uniform(0.5, 1.5, symbols.numel())
    passed = ca.Function("passed", [symbols], [ca.vertcat(*[switch.natural for switch in sharp], *borders)])
    values = np.abs(passed(place).full().ravel())
    found = []
    for switch, border in zip(sharp, values, strict=False):
        own = [node for node, other in zip(bends, values[len(sharp) :], strict=True) if np.isclose(border, other)]
        found.append(f"{_text(own[0])} bends" if own else f"{_text(switch.natural)} passes {_border(switch)}")
    return list(dict.fromkeys(found))


def kinks_in_costs(problem: OptimalControlProblem) -> str:
    """Return in words the kinks in the costs of a problem, found once for it; empty if there are none."""
    costs = [("running_cost", phase.running_cost) for phase in problem.phases]
    costs += [("the cost of a waypoint", w.cost) for phase in problem.phases for w in phase.waypoints]
    costs.append(("terminal_cost", problem.terminal_cost))
    return problem.shared.get_or_create("kinks of costs", lambda: _kinks(costs, problem))


def kinks_in_path(problem: OptimalControlProblem, *, stated: bool = False) -> str:
    """Return in words the kinks in the path conditions of a problem, found once for it; empty if there are none.

    Of those that were `stated` alone, laws of friction and contact, as of a load |N|, are none.
    """
    path = [c for phase in problem.phases for c in phase.path if not (stated and c.across is not None)]
    conditions = [(f"path: {c.label}", c.expression) for c in path]
    return problem.shared.get_or_create(("kinks of the path", stated), lambda: _kinks(conditions, problem))


def jump_on_the_way(solution: Solution) -> str:
    """Return in words what jumps with the states, or at a time that is free, on the way; empty if nothing does.

    A jump in time alone is at a time that does not change with the motion.
    """
    for part in solution.phases:
        for jumping, switch in _jumps_that_move(part, solution.problem) if part.mesh.count else ():
            k, tau = np.repeat(np.arange(part.mesh.count), _TAUS.size), np.tile(_TAUS, part.mesh.count)
            (values,) = part.by_polynomials([switch.natural], k, tau)
            passed = _passed(values.ravel(), switch)
            if not passed.size:
                continue
            one, other = part.by_polynomials(_on_both_sides(jumping, switch), k[passed], tau[passed])
            jumps = np.any(np.abs(one - other) > NEGLIGIBLE * (np.abs(one) + np.abs(other)), axis=0)
            if np.any(jumps):
                first = passed[np.argmax(jumps)]
                time, place = part.time_at(int(k[first]), float(tau[first])), _text(switch.natural)
                what = jumping.description
                return f"{what} jumps at t = {time:.6g} s or so, where {place} passes {_border(switch)}"
    return ""


def _jumps_that_move(part: PhaseSolution, problem: OptimalControlProblem) -> list[tuple[JumpingPart, Switch]]:
    """Forces, rates, costs and limits of a phase that jump, and switches over which they do, but for fixed times."""
    phase, numeric = part.phase, part.numeric
    eom = phase.equations
    stated = [("running_cost", phase.running_cost)]
    stated += [(x.label, x.expression) for x in part.program.integrals]
    stated += [(f"path: {c.label}", c.expression) for c in phase.path]
    parts = [*jumping_parts(numeric)]
    for name, expression in stated:
        parts += part_of(numeric, "integrand", 0, (expression,), name)
    moving = ca.vertcat(eom.q, eom.v, eom.a, eom.z, eom.lam, eom.u, phase.input_rates, *problem.free_parameters)
    found = [(jumping, hold(jumping.expressions, free=jumping.continuous)[1]) for jumping in parts]
    return [(jumping, s) for jumping, of in found for s in of if ca.depends_on(s.natural, moving)]


def _passed(values: np.ndarray, switch: Switch) -> np.ndarray:
    """Places of values after which a switch passes its border, and does not only come to it (k,)."""
    away = np.abs(values - np.round(values)) if switch.whole else np.abs(values)
    beside = np.flatnonzero(away > AT_BORDER * np.max(np.abs(values)))
    sides = np.floor(values[beside]) if switch.whole else np.sign(values[beside])
    passed: np.ndarray = beside[np.flatnonzero(np.diff(sides))]
    return passed


def _on_both_sides(jumping: JumpingPart, switch: Switch) -> list[ca.SX]:
    """What jumps with a switch on one side and on the other: the same where another switch leaves it out."""
    held, (own,) = hold(jumping.expressions, free=jumping.nodes - {switch.node})
    below = ca.floor(own.natural) if switch.whole else ca.SX(0)
    return [ca.substitute(ca.veccat(*held), own.side, side) for side in (below, below + 1)]


def _continuous(held: list[ca.SX], switches: list[Switch], symbols: ca.SX) -> set[int]:
    """Nodes of the switches over which expressions are continuous, at values of symbols around zero."""
    count = symbols.numel()
    around = Surroundings(symbols, np.zeros(count), np.ones(count), ca.SX(0, 1), np.zeros(0))
    return continuous_switches(held, switches, around)


def _border(switch: Switch) -> str:
    return "a whole number" if switch.whole else "zero"


def _kinks(expressions: Iterable[tuple[str, ca.SX]], problem: OptimalControlProblem) -> str:
    decided = {x.element_hash() for phase in problem.phases for x in ca.vertsplit(phase.equations.p)}
    decided -= {x.element_hash() for x in problem.free_parameters}
    if not problem.has_free_times:
        decided |= {phase.equations.t.element_hash() for phase in problem.phases}
    found = [(name, kinks_in(expression, decided)) for name, expression in expressions]
    named = [f"{name} has a kink where {places[0]}" for name, places in found if places]
    if not named:
        return ""
    return (
        f"{', '.join(named)}, and the solver needs derivatives: mbd.absolute(x) and mbd.positive_part(x) stand for "
        "fabs(x) and fmax(x, 0) in costs; elsewhere an input s that occurs in no force states the same without "
        "a kink, s >= x and s >= -x in path= for fabs(x), s >= x and s >= 0 for fmax(x, 0), with s in the cost"
    )


def not_finite(solution: Solution) -> tuple[str, float] | None:
    """Return in words the first expression of an iterate that is not finite, or whose slopes are not, and its time."""
    problem = solution.problem
    for phase, part in zip(problem.phases, solution.phases, strict=True):
        for name, expression in _expressions([phase]):
            bad = _first(part, expression)
            if bad is not None:
                what, time = bad
                return f"{name}: {what} is not finite at t = {time:.6g} s", time
    if not np.isfinite(solution.cost):
        return f"terminal_cost: {_text(problem.terminal_cost)} is not finite", solution.duration
    return None


def _expressions(phases: tuple[Phase, ...] | list[Phase]) -> Iterator[tuple[str, ca.SX]]:
    """Running costs and path conditions with their names."""
    for phase in phases:
        yield "running_cost", phase.running_cost
        yield from ((f"path: {c.label}", c.expression) for c in phase.path)


def _first(part: PhaseSolution, expression: ca.SX) -> tuple[str, float] | None:
    """The first time at which an expression, or one of its slopes, is not finite at the stages."""
    program, stages, count = part.program, part.program.scheme.stages, part.mesh.count
    intervals, taus = np.repeat(np.arange(count), stages.size), np.tile(stages, count)
    slopes = ca.sum2(ca.jacobian(expression, ca.vertcat(*program.arguments)))
    values = part.by_polynomials([expression, slopes], intervals, taus)
    for value, what in zip(values, (_text(expression), f"the slope of {_text(expression)}"), strict=True):
        wrong = np.flatnonzero(~np.isfinite(np.broadcast_to(value, (1, taus.size))))
        if wrong.size:
            i = intervals[wrong[0]]
            return what, float(part.mesh_times[i] + taus[wrong[0]] * (part.mesh_times[i + 1] - part.mesh_times[i]))
    return None


def _text(expression: ca.SX) -> str:
    text = str(text_of(expression))
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"
