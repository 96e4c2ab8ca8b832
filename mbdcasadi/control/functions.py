"""What a controller computes along its plan, as functions of the coordinates of a tree of joints."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from ..assembly.setup import Setup
from ..equations.tree import tree_coordinates
from ..errors import ExpressionError, ModelError
from ..linear.coordinates import Independent, independent
from ..model.conditions import Condition, stacked
from ..model.placeholders import Placeholder, with_values
from ..model.symbols import Parameter, describe, symbols_of
from ..model.texts import text_of
from ..model.units import unit_of
from ..numerics.c_code import simplified
from ..optimal_control.problem import OptimalControlProblem
from ..results.state import State
from .curvature import curvature

#: Difference of two ways to the accelerations of the start, relative to 1 and their size, that is rounding.
SAME = 1e-6


class ControlFunctions:
    """States, equations, cost and limits of a problem, for C.

    Attributes
    ----------
    mechanism : Mechanism
        That of the problem, without inputs that stand for parts of the cost.
    start : State
        A consistent state at rest near the estimated poses.
    independent : Independent
        States of the controller: positions and rates; first-order states follow.
    state : casadi.SX
        All of them (n_x,), in the symbols of the mechanism.
    names : tuple of str
        Of the states.
    fastest : float
        Magnitude of the largest eigenvalue of the start, 1/s.
    functions : tuple of casadi.Function
        ``pose (t, q, v, p) -> rows of the pose, slopes by q, rows of the velocities, slopes by v, slopes by q``;
        ``point (t, q, v, z, u, p) -> (a, rate of z, running cost), slopes by (q, v, z, u), curvature of the cost``;
        ``rows (t, q, v, z, u, p) -> limits, slopes by (q, v, z, u)``;
        ``end (t, q, v, z, p) -> terminal cost, its slopes, its curvature, limits at the end, slopes by (q, v, z)``.
        Coordinates and velocities are those of the tree.
    has_input : tuple of bool
        Whether an input decides on a limit.
    at_ends : tuple of int
        Limits on which inputs and states decide, which hold at both ends of an interval.
    equalities : tuple of bool
        Whether a row of the end is an equality.
    """

    def __init__(self, problem: OptimalControlProblem, chosen: Any):
        _refuse(problem)
        self.problem, phase = problem, problem.phases[0]
        self.eom, self.mechanism = phase.equations, problem.given["mechanism"]
        setup = Setup(phase.mechanism, "Controller", t=0.0)
        self.start: State = setup.start
        self.independent: Independent = independent(
            setup.numeric, self.start, chosen, analysis="Controller", argument="state="
        )
        eom, self._numeric = self.eom, setup.numeric
        if eom.Q_depends_on_lam:
            raise ModelError(
                "Controller: a force depends on reactions, and no code is written for that; take "
                "LoadIndependentFriction in the mechanism of the controller"
            )
        self.state = ca.vertcat(self.independent.positions, self.independent.rates, eom.z)
        self.names = (*self.independent.names, *(z.label for z in phase.mechanism.states))
        #: their units; empty if not known
        self.units = tuple(map(unit_of, ca.vertsplit(self.state)))
        tree = self.tree = tree_coordinates(eom)
        self.q, self.v = eom.q[tree.independent], eom.v[tree.independent]
        self._loads = self._accelerations()
        self.at = [eom.t, self.q, self.v, eom.z, eom.u, eom.p]
        limits = [c for c in phase.path if not c.equality]
        limits += [
            Condition(side, False, f"limit of {u.label}")
            for u in phase.mechanism.inputs
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
        self.functions = (self._pose(), self._point(phase), self._rows(rows), self._at_end(end))
        self.fastest = self._fastest()

    # --- expressions of the tree -----------------------------------------------------------------------------
    def along(self, expression: ca.SX) -> ca.SX:
        """An expression in the symbols of the tree, accelerations and reactions by the equations of motion."""
        eom = self.eom
        known = ca.vertcat(eom.a, eom.lam)
        if ca.depends_on(expression, eom.lam):
            expression = ca.substitute(expression, known, ca.vertcat(*self._by_all_rows()))
        elif ca.depends_on(expression, eom.a):
            expression = ca.substitute(expression, eom.a, self._loads)
        full = ca.vertcat(eom.q, eom.v)
        return ca.densify(ca.substitute(expression, full, ca.vertcat(self.tree.q, self.tree.v)))

    def _by_all_rows(self) -> tuple[ca.SX, ca.SX]:
        eom, tree = self.eom, self.tree
        a, lam = self._numeric.forward_dynamics(redundant=False)(eom.t, tree.q, tree.v, eom.z, eom.u, eom.p)
        return a, lam

    def _accelerations(self) -> ca.SX:
        """Accelerations of all coordinates: by the inertia of the tree, or of all bodies if that is singular."""
        eom = self.eom
        symbols = [eom.t, eom.q, eom.v, eom.z, eom.u, eom.p]
        start = self.start
        values = (start.t, start.q, start.v, start.z, start.inputs, start.parameters)
        for make in (lambda: self.tree.accelerations(eom.t, eom.z, eom.u, eom.p), lambda: self._by_all_rows()[0]):
            loads = make()
            found = ca.Function("a", symbols, [loads])(*values).full().ravel()
            if np.all(np.abs(found - start.a) <= SAME * (1 + np.max(np.abs(start.a), initial=0))):
                return loads
        raise ModelError(
            "Controller: the accelerations of the assembled state have no value in the coordinates of the joints: its "
            "constraints are redundant (see check), or mass is missing"
        )

    def _fastest(self) -> float:
        """Magnitude of the largest eigenvalue of the equations of the tree at the start, 1/s."""
        places, start, n = self.tree.independent, self.start, self.q.numel()
        slopes = self.functions[1](start.t, start.q[places], start.v[places], start.z, start.inputs, start.parameters)[
            1
        ]
        count = 2 * n + start.z.size
        whole = np.vstack([np.eye(n, count, n), slopes.full()[: count - n, :count]])
        return float(np.max(np.abs(np.linalg.eigvals(whole)), initial=0.0)) if np.isfinite(whole).all() else 0.0

    # --- functions ------------------------------------------------------------------------------------------
    def _pose(self) -> ca.Function:
        eom, chosen = self.eom, self.independent
        left = self.tree.left
        position = {int(row): place for place, row in enumerate(eom.position_rows)}
        phi = eom.Phi[[position[k] for k in left if k in position]]
        speeds = ca.vertcat((eom.Phi_q[left, :] @ eom.v - eom.nu[left]), chosen.rates)
        rows, speeds = self.along(ca.vertcat(phi, chosen.positions)), self.along(speeds)
        if rows.numel() != self.q.numel() or speeds.numel() != self.q.numel():
            raise ModelError(
                "Controller: the constraints of the assembled pose are not independent; see check for the rows that "
                "are redundant"
            )
        slopes = [ca.jacobian(rows, self.q), ca.jacobian(speeds, self.v), ca.jacobian(speeds, self.q)]
        return self._function("controller_pose", [eom.t, self.q, self.v, eom.p], [rows, slopes[0], speeds, *slopes[1:]])

    def _point(self, phase: Any) -> ca.Function:
        eom = self.eom
        cost = self.along(phase.running_cost + self._integrated)
        rate = self.along(ca.vertcat(self._loads[self.tree.independent], eom.z_rate))
        results = ca.vertcat(rate, cost)
        y = ca.vertcat(self.q, self.v, eom.z, eom.u)
        return self._function("controller_point", self.at, [results, ca.jacobian(results, y), curvature(cost, y)])

    def _rows(self, rows: ca.SX) -> ca.Function:
        y = ca.vertcat(self.q, self.v, self.eom.z, self.eom.u)
        return self._function("controller_rows", self.at, [rows, ca.jacobian(rows, y)])

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
        cost = self.along(self._terminal)
        if ca.depends_on(cost, eom.u):
            raise ExpressionError(f"Controller: terminal_cost depends on an input at the end: {text_of(cost)}")
        results = [cost, ca.densify(ca.jacobian(cost, s)), curvature(cost, s), rows, ca.jacobian(rows, s)]
        return self._function("controller_end", [eom.t, self.q, self.v, eom.z, eom.p], results)

    @property
    def _terminal(self) -> ca.SX:
        return with_values(self.problem.terminal_cost, lambda x: x.expression if x.kind == "at_end" else 0)

    @property
    def _integrated(self) -> ca.SX:
        """What integrals in the terminal cost add to the running cost."""
        integrals: dict[int, tuple[ca.SX, ca.SX]] = {}

        def value(x: Placeholder) -> ca.SX:
            if x.kind == "at_start":
                raise ExpressionError(f"Controller: terminal_cost contains {x.label}; the start is measured")
            if x.kind == "at_end":
                return x.expression
            return integrals.setdefault(x.node.element_hash(), (ca.SX.sym("integral"), x.expression))[0]

        cost = with_values(self.problem.terminal_cost, value)
        moving = ca.vertcat(self.eom.q, self.eom.v, self.eom.z, *(symbol for symbol, _ in integrals.values()))
        added = ca.SX(0)
        for symbol, integrand in integrals.values():
            weight = ca.gradient(cost, symbol)
            if ca.depends_on(weight, moving):
                raise ExpressionError("Controller: an integral in terminal_cost must be a term with a constant factor")
            added += weight * integrand
        return added

    def _function(self, name: str, arguments: Sequence[ca.SX], results: Sequence[ca.SX]) -> ca.Function:
        known = {s.element_hash() for group in arguments for s in ca.vertsplit(group)}
        for result in results:
            for symbol in symbols_of(result):
                if symbol.element_hash() not in known:
                    raise ExpressionError(
                        f"Controller: the problem contains {describe(symbol)}, which a controller does not know"
                    )
        return simplified(ca.Function(name, list(arguments), list(results)))


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
    if problem.relaxed is not None:
        raise ModelError(
            "Controller: DryFriction switches between sticking and sliding; take Coulomb or Stribeck for it"
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
    if problem.boundary or problem.free_parameters:
        named: list[Any] = [*problem.free_parameters, *(c.label for c in problem.boundary)]
        shown = named[0].label if isinstance(named[0], Parameter) else named[0]
        raise ModelError(
            f"Controller: boundary conditions, free parameters, and soft limits or positive parts at the end are not "
            f"taken, got {shown}; state limits in path=, and the end in terminal_cost or final="
        )
    equalities = [c.label for c in phase.path if c.equality]
    if equalities:
        raise ModelError(f"Controller: path= takes limits, got the equality {equalities[0]}; use soft(…) or a cost")
    if problem.has_input_rates(()):
        raise ModelError("Controller: inputs are constant over an interval and have no rate; make the input a state")
