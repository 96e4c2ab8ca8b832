"""Linear feedback along an optimum: gains that vary in time, by the Riccati equation of the linearised motion."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from ...arguments.piecewise_polynomial import PolynomialFeedback
from ...arguments.values import pairs_of, position_in
from ...errors import ModelError, SingularityError
from ...linear.curvature import curvature
from ...linear.tree_model import TreeModel
from ...model.quantities import no_relation
from ...model.symbols import as_expression, number, place_of
from ...numerics.collocation import gauss, lagrange_coefficients
from ...numerics.real import real_array
from ..statement.end_cost import end_cost, integrated_cost
from .phase_solution import PhaseSolution

#: Gauss points in each piece, between which gains are polynomials.
POINTS = 7
#: Growth or turn of the fastest mode of the Riccati equation or of the closed loop in a piece, rad: gains err by parts
#: in 100 000 at most, in a layer at the end under heavy weights, and by parts in a million elsewhere.
TURN = 1.0


class LinearFeedback:
    """Inputs ``u = u*(t) - K(t) (x - x*(t))`` along an optimum; made by :meth:`Solution.feedback`.

    Attributes
    ----------
    inputs : dict of Input to PolynomialFeedback
        For ``simulate(inputs=feedback)``, which also takes the feedback itself.
    state_names, input_names : tuple of str
        Of the states x, positions that describe the motion, their rates and first-order states, and of the inputs u.
    """

    def __init__(self, inputs: dict[Any, Any], names: tuple[str, ...]):
        self.inputs, self.state_names = inputs, names
        self._fed_back = [course for course in inputs.values() if isinstance(course, PolynomialFeedback)]
        self.input_names = tuple(u.label for u, course in inputs.items() if isinstance(course, PolynomialFeedback))

    def gains(self, times: Any) -> np.ndarray:
        """Return K at times (n_t, n_u, n_x); at one time (n_u, n_x)."""
        try:
            at = np.atleast_1d(real_array(times))
        except (TypeError, ValueError):
            at = np.full(1, np.nan)
        if at.ndim > 1 or not np.isfinite(at).all():
            raise ModelError(f"LinearFeedback.gains: takes a time or a list of times in s, got {times!r}")
        gains = np.stack([-course(at)[:, 1:] for course in self._fed_back], axis=1)
        return gains[0] if np.ndim(times) == 0 else gains

    def __repr__(self) -> str:
        return f"LinearFeedback({', '.join(self.input_names)} by {', '.join(self.state_names)})"


def weighted_squares(weights: Any, argument: str) -> ca.SX:
    """Return the sum of squares of expressions with their weights."""
    total = ca.SX(0)
    for expression, weight in pairs_of(weights, argument):
        value = no_relation(as_expression(expression, argument), "Solution.feedback", argument.rstrip("="))
        size = number(weight, "Solution.feedback", argument.rstrip("="))
        if value.numel() != 1 or size < 0:
            raise ModelError(f"{argument} takes scalars with weights that are not negative, got {{{value}: {size:g}}}")
        total += size * value**2
    return total


class FeedbackLaw:
    """Motion of a phase, linear about the optimum in independent states, and the cost to second order.

    Parameters
    ----------
    part : PhaseSolution
        The optimum.
    model : TreeModel
        States and equations.
    running, end : casadi.SX
        Costs, of which the curvature counts.
    inputs : sequence of Input
        Those that may be fed back; the ones that were found are.

    Attributes
    ----------
    symbols : tuple of Input
        Those that are fed back.
    """

    def __init__(self, part: PhaseSolution, model: TreeModel, running: ca.SX, end: ca.SX, inputs: Sequence[Any]):
        self.part, self.model, eom = part, model, model.eom
        found = list(part.polynomials.free_inputs)
        self.symbols = tuple(u for u in inputs if place_of(u, found) is not None)
        places = self._places = [position_in(eom.mechanism.inputs, u, "inputs") for u in self.symbols]
        self._pose = model.pose()
        s, u = ca.vertcat(model.q, model.v, eom.z), eom.u[places]
        state = model.along(model.state)
        rate = ca.jtimes(state, s, ca.vertcat(model.v, model.rates)) + ca.jacobian(state, eom.t)
        moving = ca.vertcat(s, u)
        bend = curvature(model.along(running), moving)
        results = [state, ca.densify(ca.jacobian(rate, moving)), bend]
        self._along = model.function("feedback", model.at, results)
        ends = [eom.t, model.q, model.v, eom.z, eom.p]
        # squares of what is not of the mechanism, or not of the end, have no curvature and would go without a word
        for name, known, cost in (("weights", model.at, running), ("final", ends, end)):
            model.function(name, known, [model.along(cost)])
        self._end = model.function("end", ends, [curvature(model.along(end), s)])

    def _at(self, k: np.ndarray, tau: np.ndarray) -> tuple[np.ndarray, ...]:
        """States, inputs, slopes of rates by both, and curvature of the cost at points of intervals."""
        t, q, v, _, z, _, u, _ = self.part.polynomials.at(k, tau)
        tree, p = self.model.tree.independent, self.part.numeric.p
        q, v = q[:, tree], v[:, tree]
        slopes = self._slopes(t, q, v, z, p)
        state, rate, bend = _by_row(self._along, t, q, v, z, u, p)
        moving = np.zeros((k.size, bend.shape[1], slopes.shape[2] + len(self._places)))
        moving[:, : slopes.shape[1], : slopes.shape[2]] = slopes
        moving[:, slopes.shape[1] :, slopes.shape[2] :] = np.eye(len(self._places))
        return state[:, :, 0], u[:, self._places], rate @ moving, moving.transpose(0, 2, 1) @ bend @ moving

    def _slopes(self, t: np.ndarray, q: np.ndarray, v: np.ndarray, z: np.ndarray, p: np.ndarray) -> np.ndarray:
        found = [self.model.slopes(*parts) for parts in zip(*_by_row(self._pose, t, q, v, z, p)[2:], strict=True)]
        lost = [float(time) for time, slopes in zip(t.ravel(), found, strict=True) if slopes is None]
        if lost:
            raise SingularityError(
                f"Solution.feedback: the states {', '.join(self.model.names)} do not describe the motion at t = "
                f"{lost[0]:.6g} s; choose others by state="
            )
        return np.array(found)

    def gains(self) -> tuple[np.ndarray, np.ndarray]:
        """Breaks (N + 1,), and values of ``(u* + K x*, -K)`` at Gauss points between them (N, POINTS, n_u, 1 + n_x)."""
        times, points = self.part.mesh_times, gauss(POINTS).points
        cost_to_go, breaks, laws = self._at_end(), [times[-1]], list[np.ndarray]()
        for k in range(times.size - 2, -1, -1):
            last, length = 1.0, times[k + 1] - times[k]
            while last > 0:
                pieces = max(1, math.ceil(last * length * self._fastest(k, last, cost_to_go) / TURN))
                first = last - last / pieces if pieces > 1 else 0.0
                law, cost_to_go = self._piece(k, first + points * (last - first), length * (last - first), cost_to_go)
                laws.append(law)
                breaks.append(times[k] + first * length)
                last = first
        return np.array(breaks[::-1]), np.array(laws[::-1])

    def _fastest(self, k: int, tau: float, cost_to_go: np.ndarray) -> float:
        """Size of the largest eigenvalue of the Riccati equation and the closed loop, 1/s."""
        slopes, bend = self._at(np.array([k]), np.array([tau]))[2:]
        (hamiltonian,), (gains,) = self._hamiltonian(slopes, bend)
        n = len(cost_to_go)
        closed = slopes[0, :, :n] - slopes[0, :, n:] @ gains @ np.vstack([np.eye(n), cost_to_go])
        return float(max(np.max(np.abs(np.linalg.eigvals(m)), initial=0.0) for m in (hamiltonian, closed)))

    def _piece(self, k: int, taus: np.ndarray, length: float, cost_to_go: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Law at the Gauss points of a piece, and the cost to go at its start, from that at its end."""
        x, u, slopes, bend = self._at(np.full(taus.size, k), taus)
        n = x.shape[1]
        hamiltonian, gains = self._hamiltonian(slopes, bend)
        values, start = _linear_back(hamiltonian, np.vstack([np.eye(n), cost_to_go]), length)
        *costs, first = (np.linalg.solve(z[:n].T, z[n:].T).T for z in (*values, start))
        feedback = gains @ np.array([np.vstack([np.eye(n), cost]) for cost in costs])
        if not (np.isfinite(feedback).all() and np.isfinite(first).all()):
            raise ModelError(
                "Solution.feedback: the cost has no least value for small changes of the motion; give weights="
            )
        forward = u + (feedback @ x[:, :, None])[:, :, 0]
        return np.concatenate([forward[:, :, None], -feedback], axis=2), (first + first.T) / 2

    def _at_end(self) -> np.ndarray:
        """Curvature of the cost of the last state, in the states."""
        t, q, v, _, z, *_ = self.part.polynomials.at(np.array([self.part.mesh_times.size - 2]), np.ones(1))
        tree, p = self.model.tree.independent, self.part.numeric.p
        q, v = q[:, tree], v[:, tree]
        slopes = self._slopes(t, q, v, z, p)[0]
        (bend,) = _by_row(self._end, t, q, v, z, p)
        return slopes.T @ bend[0] @ slopes

    def _hamiltonian(self, slopes: np.ndarray, bend: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rates of changes of states and costates by these, and gains by both: u = -gains (x, costates)."""
        n = slopes.shape[1]
        a, b = slopes[:, :, :n], slopes[:, :, n:]
        q, mixed, r = bend[:, :n, :n], bend[:, n:, :n], bend[:, n:, n:]
        least = np.linalg.eigvalsh(r)[:, 0] / np.maximum(np.max(np.abs(r), axis=(1, 2)), np.finfo(float).tiny)
        if not np.min(least) > np.finfo(float).eps:
            weak = int(np.argmin(np.abs(np.diagonal(r[int(np.argmin(least))]))))
            raise ModelError(
                f"Solution.feedback: the cost does not grow with the square of the input '{self.symbols[weak].label}'; "
                "give weights= with one for each input"
            )
        gains = np.linalg.solve(r, np.concatenate([mixed, b.transpose(0, 2, 1)], axis=2))
        top = np.concatenate([a, np.zeros_like(a)], axis=2) - b @ gains
        across = mixed.transpose(0, 2, 1)
        low = np.concatenate([-q, -a.transpose(0, 2, 1)], axis=2) + across @ gains
        return np.concatenate([top, low], axis=1), gains


def _by_row(function: ca.Function, *arguments: np.ndarray) -> list[np.ndarray]:
    """Results of a function at rows of its arguments, each (k, rows, columns)."""
    stacked = [m.full() for m in function.call([ca.DM(np.atleast_2d(x).T if x.ndim > 1 else x) for x in arguments])]
    count = len(arguments[0])
    shapes = [function.size_out(i) for i in range(function.n_out())]
    return [
        m.reshape(rows, count, columns).transpose(1, 0, 2) if m.shape[1] == count * columns else np.array([m] * count)
        for m, (rows, columns) in zip(stacked, shapes, strict=True)
    ]


def _linear_back(rates: np.ndarray, end: np.ndarray, length: float) -> tuple[np.ndarray, np.ndarray]:
    """Values at Gauss points of a piece (POINTS, 2 n, n) and at its start, of ``dz/dt = H z`` with its end."""
    rule, size = gauss(len(rates)), len(end)
    ahead = length * (rule.basis(rule.points)[1].T - rule.weights)  # of the integral from the end
    system = np.eye(len(rates) * size) - np.einsum("ij,jkl->ikjl", ahead, rates).reshape(len(rates) * size, -1)
    values = np.linalg.solve(system, np.tile(end, (len(rates), 1))).reshape(len(rates), size, -1)
    return values, end - length * np.einsum("j,jkl,jlm->km", rule.weights, rates, values)


def linear_feedback(
    solution: Any, part: PhaseSolution, weights: Any, final: Any, state: Sequence[Any] | None
) -> LinearFeedback:
    """Return the feedback along a phase; see :meth:`Solution.feedback`."""
    phase, problem, analysis = part.phase, solution.problem, "Solution.feedback"
    model = TreeModel(phase.mechanism, phase.equations, state, analysis, part.trajectory.initial)
    if weights is None:
        running = phase.running_cost + integrated_cost(problem, model.eom, analysis)
    else:
        running = weighted_squares(weights, "weights=")
    if final is None and weights is None:
        end = end_cost(problem)
    else:
        end = weighted_squares(final, "final=")
    found = ca.vertcat(ca.SX(0, 1), *solution.parameters), ca.DM([*solution.parameters.values()])
    running, end = (ca.substitute(cost, *found) for cost in (running, end))
    given = problem.given["mechanism"].inputs
    law = FeedbackLaw(part, model, running, end, given)
    breaks, values = law.gains()
    rows = lagrange_coefficients(gauss(POINTS).points)
    by_power = np.einsum("jp,kjum->kump", rows, values) / np.diff(breaks)[:, None, None, None] ** np.arange(POINTS)
    # after the end, the law of the end holds
    held = np.zeros((1, *by_power.shape[1:]))
    held[0, ..., 0] = by_power[-1] @ (breaks[-1] - breaks[-2]) ** np.arange(POINTS)
    by_power, breaks = np.concatenate([by_power, held]), np.append(breaks, breaks[-1] + part.duration)
    factors, inputs = ca.vertcat(1, model.state), dict(solution.inputs)
    for place, symbol in enumerate(law.symbols):
        inputs[symbol] = PolynomialFeedback(breaks, by_power[:, place].reshape(len(by_power), -1), factors)
    return LinearFeedback({u: inputs[u] for u in given}, model.names)
