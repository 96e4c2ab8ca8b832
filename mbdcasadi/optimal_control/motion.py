"""The motion of a solution: the polynomials of the transcription, brought onto the constraints."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from ..arguments.piecewise_polynomial import PiecewisePolynomial
from ..equations.numeric import NumericEquations
from ..equations.recovery import Recovery
from ..results.trajectory import Statistics, Trajectory
from .problem import OptimalControlProblem
from .transcription.base import Transcription


class OptimalMotion(Trajectory):
    """A trajectory that follows the polynomials of a transcription between the mesh points.

    It evaluates what a trajectory does, and rates of inputs (``tau.rate``) and
    the problem's own parameters besides.

    Parameters
    ----------
    problem : OptimalControlProblem
        Whose motion it is.
    polynomials : Polynomials
        The motion between the mesh points.
    own : numpy.ndarray
        Values of the problem's own parameters.
    t, arrays, p, more
        As of :class:`Trajectory`.
    """

    def __init__(
        self,
        problem: OptimalControlProblem,
        polynomials: Polynomials,
        own: np.ndarray,
        t: np.ndarray,
        arrays: tuple[np.ndarray, ...],
        p: np.ndarray,
        **more: Any,
    ):
        q, v, a, z, lam, u = arrays
        super().__init__(problem.mechanism, t, q, v, a, z, lam, u, p, **more)
        self._problem, self._polynomials, self._own = problem, polynomials, own

    def _compiled(self, expression: ca.SX) -> tuple[ca.Function, tuple[np.ndarray, ...]]:
        own = ca.vertcat(ca.SX(0, 1), *self._problem.own_parameters)
        if own.numel():
            expression = ca.substitute(expression, own, ca.DM(self._own))
        rates = self._problem.u_rate
        if not rates.numel() or not ca.depends_on(ca.vec(expression), rates):
            return super()._compiled(expression)
        eom = self.equations
        eom.function(ca.substitute(expression, rates, ca.SX.zeros(rates.numel())))  # says what is unknown
        given = super()._compiled(ca.SX(0))[1]
        function = ca.Function("expression", [*eom.symbols, rates], [ca.densify(expression)])
        return function, (*given, self._polynomials.input_rates(self.t))

    def _between(self, wanted: np.ndarray) -> tuple[np.ndarray, ...]:
        return self._polynomials.states(wanted)

    def _at(self, t: np.ndarray, *arrays: np.ndarray) -> OptimalMotion:
        return OptimalMotion(
            self._problem, self._polynomials, self._own, t, arrays, self.parameters, refine=self._refine
        )


class Polynomials:
    """The polynomials of a transcription on a mesh, with numbers.

    Parameters
    ----------
    scheme : Transcription
        The transcription.
    mesh : numpy.ndarray
        Mesh points (N + 1,), s.
    nodes, blocks : numpy.ndarray
        Unknowns of the mesh points (N + 1, …) and the intervals (N, …), in physical units.
    numeric : NumericEquations
        Equations at the parameters of the solution.
    """

    def __init__(
        self,
        scheme: Transcription,
        mesh: np.ndarray,
        nodes: np.ndarray,
        blocks: np.ndarray,
        numeric: NumericEquations,
    ):
        self.scheme, self.mesh, self.nodes, self.blocks, self.numeric = scheme, mesh, nodes, blocks, numeric

    def at(self, intervals: np.ndarray, shares: np.ndarray) -> list[np.ndarray]:
        """``t, q, v, a, z, lam, u, u̇`` at shares of intervals, each (k, size)."""
        lengths = np.diff(self.mesh)
        found = self.scheme.motion(
            self.nodes[intervals].T,
            self.blocks[intervals].T,
            self.nodes[intervals + 1].T,
            self.mesh[intervals][None, :],
            lengths[intervals][None, :],
            shares[None, :],
            self.numeric.p,
        )
        return [part.full().T for part in found]

    @cached_property
    def at_nodes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """``q, v, z`` at the mesh points, each (N + 1, size)."""
        own = self.scheme.node(self.nodes.T)
        q, v = self.scheme.eom.states(self.mesh, own["q"].T, own["v"].T, self.numeric.p)
        return q, v, own["z"].T

    def _located(self, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        slack = 1e-12 * max(1.0, abs(self.mesh[-1]))
        k = np.clip(np.searchsorted(self.mesh, times + slack, side="right") - 1, 0, self.mesh.size - 2)
        return k, np.clip((times - self.mesh[k]) / (self.mesh[k + 1] - self.mesh[k]), 0, 1)

    def states(self, times: np.ndarray) -> tuple[np.ndarray, ...]:
        """Coordinates, velocities, first-order states and inputs at times."""
        _, q, v, _, z, _, u, _ = self.at(*self._located(times))
        return q, v, z, u

    def input_rates(self, times: np.ndarray) -> np.ndarray:
        """Rates of the inputs at times (k, n_u)."""
        return self.at(*self._located(times))[7]

    @property
    def inputs(self) -> dict[Any, PiecewisePolynomial]:
        """The inputs as ``simulate(inputs=…)`` takes them."""
        basis = self.scheme.inputs
        symbols = self.scheme.eom.mechanism.inputs
        if not symbols:
            return {}
        part, count = self.scheme.block_slice("u"), self.blocks.shape[0]
        values = self.blocks[:, part].reshape(count, len(basis.inner), len(symbols))
        if basis.joined:
            ends = self.nodes[:, self.scheme.node_size - len(symbols) : self.scheme.node_size]
            values = np.concatenate([ends[:-1, None], values, ends[1:, None]], axis=1)
        by_share = np.einsum("kj,ikn->ijn", basis.coefficients, values)
        lengths = np.diff(self.mesh)[:, None] ** np.arange(basis.shares.size)
        return {u: PiecewisePolynomial(self.mesh, by_share[:, :, k] / lengths) for k, u in enumerate(symbols)}

    def trajectory(
        self, problem: OptimalControlProblem, own: np.ndarray, statistics: Statistics, *, redundant: bool
    ) -> OptimalMotion:
        """The motion at mesh points and stages, on the constraints to rounding."""
        scheme, count = self.scheme, self.blocks.shape[0]
        shares = np.r_[0.0, scheme.stages[(scheme.stages > 0) & (scheme.stages < 1)]]
        intervals = np.repeat(np.arange(count), shares.size)
        t, q, v, _, z, _, u, _ = self.at(np.r_[intervals, count - 1], np.r_[np.tile(shares, count), 1.0])
        t = t.ravel()
        t[:: shares.size] = self.mesh
        q[-1], v[-1], z[-1] = (values[-1] for values in self.at_nodes)
        refine = self._refine(redundant=redundant)
        q, v, a, lam, u = refine(t, q, v, z, u)
        arrays = (q, v, a, z, lam, u)
        return OptimalMotion(problem, self, own, t, arrays, self.numeric.p, statistics=statistics, refine=refine)

    def _refine(self, *, redundant: bool) -> Callable[..., tuple[np.ndarray, ...]]:
        return Recovery(self.numeric, redundant=redundant).refine()
