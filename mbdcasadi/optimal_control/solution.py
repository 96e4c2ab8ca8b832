"""The optimum: its motion, its inputs, and the proof by simulation."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..analysis.pieces import PiecewisePolynomial
from ..analysis.simulate import simulate
from ..equations.numeric import NumericEquations
from ..equations.recovery import Recovery
from ..model.symbols import Parameter
from ..numerics.rank import dependent_rows
from ..results.state import State
from ..results.trajectory import Statistics, Trajectory
from .local_error import local_errors, scaled_errors
from .problem import OptimalControlProblem
from .program import MotionProgram


@dataclass(frozen=True)
class SolveStatistics:
    """How a solution was found.

    Attributes
    ----------
    iterations : int
        Of the solver.
    status : str
        Its own word.
    seconds : float
        Building and solving, s.
    variables, rows : int
        Size of the program.
    """

    iterations: int
    status: str
    seconds: float
    variables: int
    rows: int


@dataclass(frozen=True)
class Replay:
    """A simulation with the inputs of a solution.

    Attributes
    ----------
    trajectory : Trajectory
        The simulated motion.
    final_error : float
        Largest difference of a coordinate at the end, m or rad.
    largest_deviation : float
        Largest difference at any mesh point, m or rad.
    drift : float
        Largest ``|Phi|`` of the simulated motion.
    defects : numpy.ndarray
        By interval, started anew at each mesh point: largest difference in
        displacements (m) and in angles (rad), (N, 2). A motion that is unstable may have
        small defects and still not replay as a whole.
    """

    trajectory: Trajectory
    final_error: float
    largest_deviation: float
    drift: float
    defects: np.ndarray

    def __repr__(self) -> str:
        worst = np.max(self.defects, axis=0)
        return (
            f"Replay by {self.trajectory.statistics.method}: off by {self.final_error:.2e} at the end, "
            f"{self.largest_deviation:.2e} at most; defects of intervals up to {worst[0]:.1e} m, {worst[1]:.1e} rad"
        )


class Solution:
    """A motion found by optimal control.

    Parameters
    ----------
    program : MotionProgram
        The program that was solved.
    problem : OptimalControlProblem
        What it was made for.
    numeric : NumericEquations
        Equations at the parameters that were given.
    x : numpy.ndarray
        Its variables, scaled.
    mesh : numpy.ndarray
        Mesh points as shares of the duration.
    cost : float
        Value that was minimised.
    statistics : SolveStatistics
        How it was found.

    Attributes
    ----------
    mesh : numpy.ndarray
        Mesh points (N + 1,), s.
    duration : float
        s.
    parameters : dict of Parameter to float
        Values of the free parameters.
    """

    def __init__(
        self,
        program: MotionProgram,
        problem: OptimalControlProblem,
        numeric: NumericEquations,
        x: np.ndarray,
        mesh: np.ndarray,
        cost: float,
        statistics: SolveStatistics,
    ):
        self.program = program
        self.problem = problem
        self._given = numeric
        self.cost = cost
        self.statistics = statistics
        self._x = x * program.scale
        self.shares = mesh
        values = self._x[program.global_index]
        self.duration = float(values[0])
        self.parameters: dict[Parameter, float] = dict(
            zip(self.problem.free_parameters, values[1:].tolist(), strict=True)
        )
        self.mesh = self.duration * mesh

    # --- polynomials -----------------------------------------------------------------------
    @property
    def _p(self) -> np.ndarray:
        """Parameters of the mechanism with the free ones put in."""
        p = self._given.p.copy()
        for k, symbol in enumerate(self.problem.mechanism.parameters):
            for free, value in self.parameters.items():
                if symbol is free:
                    p[k] = value
        return p

    @cached_property
    def _nodes(self) -> np.ndarray:
        return np.array([self._x[self.program.node_index(k)] for k in range(self.shares.size)])

    def _stage_values(self, name: str) -> np.ndarray:
        """Values at the stages (N, degree, k)."""
        sizes, first = self.program.scheme.sizes, 0
        for key, size in sizes.items():
            if key == name:
                break
            first += size
        blocks = np.array([self._x[self.program.block_index(i)] for i in range(self.shares.size - 1)])
        return blocks[:, first : first + sizes[name]].reshape(self.shares.size - 1, self.program.scheme.degree, -1)

    @cached_property
    def inputs(self) -> dict[Any, PiecewisePolynomial]:
        """The inputs as piecewise polynomials, as ``simulate(inputs=…)`` takes them."""
        found = {}
        u, lengths = self._stage_values("u"), np.diff(self.mesh)
        points = self.program.scheme.coefficients.points
        powers = np.vander(points, increasing=True)
        for k, symbol in enumerate(self.problem.mechanism.inputs):
            coefficients = np.linalg.solve(powers, u[:, :, k].T).T
            found[symbol] = PiecewisePolynomial(self.mesh, coefficients / lengths[:, None] ** np.arange(points.size))
        return found

    @cached_property
    def trajectory(self) -> Trajectory:
        """The motion at mesh points and stages; ``.at(times)`` between them."""
        scheme, numeric = self.program.scheme, self._numeric
        n = numeric.eom.q.numel()
        shares = np.r_[0.0, scheme.coefficients.points]
        _, once, twice = scheme.coefficients.basis(shares)
        h = np.diff(self.mesh)[:, None, None]
        nodes = self._nodes[:-1]
        a, rate = self._stage_values("a"), self._stage_values("rate")
        q0, v0, z0 = nodes[:, None, :n], nodes[:, None, n : 2 * n], nodes[:, None, 2 * n : scheme.node_size]
        q = q0 + h * shares[None, :, None] * v0 + h**2 * np.einsum("sj,ijk->isk", twice, a)
        v = v0 + h * np.einsum("sj,ijk->isk", once, a)
        z = z0 + h * np.einsum("sj,ijk->isk", once, rate)
        t = (self.mesh[:-1, None] + h[:, :, 0] * shares[None, :]).ravel()
        last = self._nodes[-1:]
        t = np.r_[t, self.mesh[-1]]
        q, v, z = (
            np.vstack([inner.reshape(t.size - 1, -1), end])
            for inner, end in ((q, last[:, :n]), (v, last[:, n : 2 * n]), (z, last[:, 2 * n : scheme.node_size]))
        )
        u = np.column_stack([piece(t) for piece in self.inputs.values()]) if self.inputs else np.zeros((t.size, 0))
        recovery = Recovery(numeric, redundant=self._redundant)
        refine = recovery.refine(self._rule)
        q, v, acceleration, lam, u = refine(t, q, v, z, u)
        statistics = Statistics(scheme.name, f"degree {scheme.degree}, {h.size} intervals", self.statistics.seconds)
        return Trajectory(
            self.problem.mechanism, t, q, v, acceleration, z, lam, u, numeric.p, statistics=statistics, refine=refine
        )

    @cached_property
    def _numeric(self) -> NumericEquations:
        return NumericEquations(self.problem.equations, self._p)

    @property
    def _redundant(self) -> bool:
        return len(self.program.scheme.rows) < self.problem.equations.lam.numel()

    def _rule(self, t: np.ndarray, _q: Any, _v: Any, _z: Any, u: np.ndarray) -> np.ndarray:
        return np.column_stack([piece(t) for piece in self.inputs.values()]) if self.inputs else u

    # --- proof ---------------------------------------------------------------------------------
    def verify(self, reltol: float = 1e-10, abstol: float = 1e-10) -> Replay:
        """Simulate by IDAS from the first state with the solution's own input polynomials."""
        motion = self.trajectory
        replay = self.simulate(reltol=reltol, abstol=abstol)
        stride = self.program.scheme.degree + 1
        wanted = motion.q[::stride]
        difference = np.abs(replay.q - wanted)
        return Replay(
            replay,
            float(np.max(difference[-1])),
            float(np.max(difference)),
            replay.drift.position,
            local_errors(self),
        )

    def simulate(self, *, initial: Any = None, parameters: Any = None, **settings: Any) -> Trajectory:
        """Simulate the mechanism with the inputs that were found, from other starts or with other parameters."""
        own = dict(zip(self.problem.mechanism.parameters, self._p, strict=True))
        return simulate(
            self.problem.mechanism,
            self.mesh,
            initial=self.trajectory.initial if initial is None else initial,
            inputs=self.inputs,
            parameters=own | dict(parameters or {}),
            **settings,
        )

    @cached_property
    def mesh_error(self) -> float:
        """Largest local error of an interval, in q (m, rad) and v scaled by the duration."""
        return float(np.max(scaled_errors(self)))

    @cached_property
    def limit_excess(self) -> dict[Any, float]:
        """By how much each input goes beyond its limits between the points at which they are held."""
        found = {}
        times = np.linspace(0, self.duration, 20 * self.shares.size)
        for symbol, piece in self.inputs.items():
            values = piece(times)
            found[symbol] = float(max(np.max(values - symbol.upper), np.max(symbol.lower - values), 0.0))
        return found

    def state(self, index: int) -> State:
        """State at a mesh point."""
        return self.trajectory.state(index * (self.program.scheme.degree + 1))

    def __repr__(self) -> str:
        s = self.statistics
        return (
            f"Solution: cost {self.cost:.8g}, duration {self.duration:.6g} s, {self.shares.size - 1} intervals, "
            f"{s.iterations} iterations, {s.seconds:.3g} s ({s.status})"
        )


def independent_rows(numeric: Any, t: float, q: np.ndarray) -> list[int]:
    """Constraint rows without those that others imply."""
    jacobian = numeric.velocity(t, q)[0] * numeric.column_scale
    size = np.linalg.norm(jacobian, axis=1, keepdims=True)
    dependent = set(dependent_rows(jacobian / np.where(size > 1e-12, size, 1.0)))
    return [k for k in range(jacobian.shape[0]) if k not in dependent]
