"""What a controller computes along its plan, as functions of the coordinates of a tree of joints."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from ..errors import ExpressionError, ModelError
from ..linear.curvature import curvature
from ..linear.tree_model import TreeModel
from ..model.conditions import Condition, stacked
from ..model.forces.friction.modes import switching
from ..model.texts import text_of
from ..optimal_control.problem import OptimalControlProblem
from ..optimal_control.statement.end_cost import end_cost, end_values, integrated_cost
from ..results.state import State


class ControlFunctions(TreeModel):
    """States, equations, cost and limits of a problem, for C.

    Attributes
    ----------
    mechanism : Mechanism
        That of the problem, without inputs that stand for parts of the cost.
    functions : tuple of casadi.Function
        ``pose (t, q, v, z, p) -> rows of the pose, of the velocities, slopes``, as :meth:`TreeModel.pose` has them;
        ``point (t, q, v, z, u, p) -> (a, rate of z, running cost), slopes by (q, v, z, u), curvature of the cost``;
        ``rows (t, q, v, z, u, p) -> limits, slopes by (q, v, z, u)``;
        ``end (t, q, v, z, p) -> terminal cost, its slopes, its curvature, limits at the end, slopes by (q, v, z),
        prices of the amounts by which soft limits of the end are passed, slopes of the limits by these``.
        Coordinates and velocities are those of the tree.
    has_input : tuple of bool
        Whether an input decides on a limit.
    at_ends : tuple of int
        Limits on which inputs and states decide, which hold at both ends of an interval.
    equalities : tuple of bool
        Whether a row of the end is an equality.
    amounts : tuple of Parameter
        By what soft limits of the end are passed, and other positive parts there.
    """

    def __init__(self, problem: OptimalControlProblem, chosen: Any):
        _refuse(problem)
        self.problem, phase = problem, problem.phases[0]
        self.amounts = tuple(problem.free_parameters)
        self.mechanism = problem.given["mechanism"]
        super().__init__(phase.mechanism, phase.equations, chosen, "Controller")
        eom = self.eom
        limits = [c for c in phase.path if not c.equality]
        limits += [
            Condition(side, False, f"limit of {u.label}")
            for u in (*phase.mechanism.inputs, *phase.mechanism.states)
            for side, limit in ((u - u.upper, u.upper), (u.lower - u, u.lower))
            if np.isfinite(limit)
        ]
        rows = self.along(stacked(limits))
        self.has_input = tuple(bool(ca.depends_on(row, eom.u)) for row in ca.vertsplit(rows))
        moving = ca.vertcat(eom.t, self.q, self.v, eom.z)
        self.at_ends = tuple(
            k for k, row in enumerate(ca.vertsplit(rows)) if self.has_input[k] and ca.depends_on(row, moving)
        )
        end, self.equalities = self._end(limits, phase)
        self.is_timed = bool(ca.depends_on(ca.vertcat(eom.Phi, eom.nu, eom.Q, eom.z_rate, rows, end), eom.t))
        self.functions = (self.pose(), self._point(phase), self._rows(rows), self._at_end(end))

    # --- functions ------------------------------------------------------------------------------------------
    def _point(self, phase: Any) -> ca.Function:
        eom = self.eom
        cost = self.along(phase.running_cost + integrated_cost(self.problem, eom, "Controller"))
        results = ca.vertcat(self.rates, cost)
        y = ca.vertcat(self.q, self.v, eom.z, eom.u)
        return self.function("controller_point", self.at, [results, ca.jacobian(results, y), curvature(cost, y)])

    def _rows(self, rows: ca.SX) -> ca.Function:
        y = ca.vertcat(self.q, self.v, self.eom.z, self.eom.u)
        return self.function("controller_rows", self.at, [rows, ca.jacobian(rows, y)])

    def _end(self, limits: Sequence[Condition], phase: Any) -> tuple[ca.SX, tuple[bool, ...]]:
        """Rows of the end: path limits on its state, and the conditions there."""
        eom = self.eom
        final = phase.final
        if isinstance(final, State):
            own = self.eom.function(self.state)(*_of_phase(final, eom)).full().ravel()
            given = [
                Condition(x - v, True, n) for x, v, n in zip(ca.vertsplit(self.state), own, self.names, strict=True)
            ]
        else:
            given = list(final)
        rows, equalities = [], []
        given += [Condition(end_values(c.expression, "Controller"), c.equality, c.label) for c in self.problem.boundary]
        for condition in [*limits, *given]:
            row = self.along(condition.expression)
            if ca.depends_on(row, eom.u):
                if condition in given:
                    raise ModelError(
                        f"Controller: the condition {condition.label} at the end depends on an input, which ends "
                        "there; state it in path="
                    )
                continue
            rows.append(row)
            equalities.append(condition.equality)
        return ca.vertcat(ca.SX(0, 1), *rows), tuple(equalities)

    def _at_end(self, rows: ca.SX) -> ca.Function:
        eom = self.eom
        s = ca.vertcat(self.q, self.v, eom.z)
        cost, amounts = self.along(end_cost(self.problem)), ca.vertcat(ca.SX(0, 1), *self.amounts)
        if ca.depends_on(cost, eom.u):
            raise ExpressionError(f"Controller: terminal_cost depends on an input at the end: {text_of(cost)}")
        prices, by_amount = (ca.densify(ca.jacobian(x, amounts)) for x in (cost, rows))
        if ca.depends_on(ca.vertcat(ca.vec(prices), ca.vec(by_amount)), ca.vertcat(s, amounts)):
            raise ExpressionError(f"Controller: positive parts in terminal_cost need constant factors: {text_of(cost)}")
        cost, rows = (ca.substitute(x, amounts, 0 * amounts) for x in (cost, rows))
        results = [cost, ca.densify(ca.jacobian(cost, s)), curvature(cost, s), rows, ca.jacobian(rows, s)]
        results += [prices, by_amount]
        return self.function("controller_end", [eom.t, self.q, self.v, eom.z, eom.p], results)


def _of_phase(state: State, eom: Any) -> tuple[Any, ...]:
    """Arguments of a state, with zeros for inputs that the mechanism of the phase has besides."""
    t, q, v, a, z, lam, u, p = state.arguments
    return t, q, v, a, z, lam, np.r_[u, np.zeros(eom.u.numel() - u.size)], p


def _refuse(problem: Any) -> None:
    """Refuse problems that a controller does not solve, with what to write instead."""
    if not isinstance(problem, OptimalControlProblem):
        raise ModelError(f"Controller: takes an OptimalControlProblem, got {problem!r}")
    if problem.is_phased:
        raise ModelError("Controller: takes a problem of one mechanism, without phases=; give each phase a controller")
    for element in switching(problem.given["mechanism"]):
        raise ModelError(
            f"Controller: {element.description} switches between sticking and sliding, or contact and flight; take a "
            "smooth law, as Coulomb, Stribeck or a Contact"
        )
    phase = problem.phases[0]
    if phase.span[0] != phase.span[1]:
        raise ModelError(
            f"Controller: the duration must be fixed, got between {phase.span[0]:g} and {phase.span[1]:g} s"
        )
    if phase.waypoints:
        raise ModelError(
            "Controller: waypoints have no place in a horizon that moves; put their cost into running_cost"
        )
    named = [p.label for p in problem.whole["free_parameters"]] + [c.label for c in problem.whole["boundary"]]
    if named:
        raise ModelError(
            f"Controller: boundary conditions and free parameters are not taken, got {named[0]}; state limits in "
            "path=, and the end in terminal_cost or final="
        )
    equalities = [c.label for c in phase.path if c.equality]
    if equalities:
        raise ModelError(f"Controller: path= takes limits, got the equality {equalities[0]}; use soft(…) or a cost")
    if problem.has_input_rates(()):
        raise ModelError("Controller: inputs are constant over an interval and have no rate; make the input a state")
