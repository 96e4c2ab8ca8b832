"""Expressions of a problem that a solver with derivatives cannot follow: kinks, and values that are not finite."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from ...equations.switching.continuity import Surroundings, continuous_switches
from ...equations.switching.switches import hold
from ...numerics.graph import operations
from ...printing import to_text
from ..phase import Phase
from ..placeholders import placeholders_in

if TYPE_CHECKING:
    from ..phase_solution import PhaseSolution
    from ..solution import Solution

#: Operations whose slope jumps, or that jump themselves.
_KINKS = (ca.OP_FABS, ca.OP_FMAX, ca.OP_FMIN, ca.OP_SIGN, ca.OP_FLOOR, ca.OP_CEIL)
#: Longest text of an expression in a message.
_LONGEST = 60


def kinks_in(expression: ca.SX) -> list[str]:
    """Return in words where the slope of an expression jumps: at operations such as ``fabs``, and at comparisons."""
    whole = ca.vertcat(expression, *[p.expression for p in placeholders_in(expression)])
    symbols = ca.vertcat(ca.SX(0, 1), *ca.symvar(whole))
    bends = [f"{_text(node)} bends" for _, node in operations(whole, _KINKS)]
    if bends:
        return bends
    (held,), switches = hold([whole])
    count = symbols.numel()
    around = Surroundings(symbols, np.zeros(count), np.ones(count), ca.SX(0, 1), np.zeros(0))
    smooth = continuous_switches([held, ca.jacobian(held, symbols)], switches, around)
    return [f"{_text(switch.natural)} passes zero" for switch in switches if switch.node not in smooth]


def kinks_of(solution: Solution) -> str:
    """Return in words the kinks in the cost and in the path conditions of a problem; empty if there are none."""
    problem = solution.problem
    found = [(name, kinks_in(expression)) for name, expression in _expressions(problem.phases)]
    found.append(("terminal_cost", kinks_in(problem.terminal_cost)))
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
            found = _first(part, expression)
            if found is not None:
                what, time = found
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
    found = part.by_polynomials([expression, slopes], intervals, taus)
    for value, what in zip(found, (_text(expression), f"the slope of {_text(expression)}"), strict=True):
        wrong = np.flatnonzero(~np.isfinite(np.broadcast_to(value, (1, taus.size))))
        if wrong.size:
            i = intervals[wrong[0]]
            return what, float(part.mesh_times[i] + taus[wrong[0]] * (part.mesh_times[i + 1] - part.mesh_times[i]))
    return None


def _text(expression: ca.SX) -> str:
    text = str(to_text(expression))
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"
