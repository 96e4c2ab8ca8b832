"""The equations of statics, and the stiffness of a mechanism in its free directions.

    Q(t, q, 0, z, lam, u, p) - Phi_q^T lam = 0,    Phi(q, t) = 0,    z_rate = 0

With ``N`` a basis of the virtual displacements (``Phi_q N = 0``) the reduced
stiffness is ``K = -N^T (Q - Phi_q^T lam)_q N``: the stiffness of springs,
gravity and other applied forces, and the geometric one of the multipliers.
First-order states, and multipliers on which forces depend, follow the pose; states whose rates vanish at rest follow
it from a start (:class:`~mbdcasadi.statics.memory.Memory`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import casadi as ca
import numpy as np

from ..arguments.inputs import Signals
from ..equations.numeric import NumericEquations
from ..model.conditions import Condition
from ..model.symbols import Input, Parameter, place_of
from ..numerics.least_squares import largest, least_norm
from ..numerics.newton import solve
from ..numerics.rank import analyse_rank
from .memory import Memory
from .small_motions import SmallMotions

#: Eigenvalues of the reduced stiffness below this share of the typical stiffness count as zero.
NEUTRAL = 1e-11
#: Singular values below this share are left out of the balance of forces by multipliers and states.
BALANCED = 1e-12
#: A row of forces counts as no softer than this share of the stiffness that is typical of the mechanism.
SOFTEST = 1e-3
#: Sizes of loads, N, between which their squares are numbers.
SQUARED = 1e-150, 1e150
#: Imaginary parts above this share of the same belong to forces without potential, not to rounding.
CIRCULATORY = 1e-7


@dataclass(frozen=True)
class Stiffness:
    """Reduced stiffness at a pose.

    Attributes
    ----------
    values : numpy.ndarray
        Eigenvalues, least real part first (k,), N/m; a turn counts as the arc at the typical lever of the mechanism.
    directions : numpy.ndarray
        Displacement over q that belongs to each (n, k).
    matrix : numpy.ndarray
        The stiffness itself, in the basis of :attr:`basis` (k, k).
    basis : numpy.ndarray
        Virtual displacements (n, k).
    force : numpy.ndarray
        Unbalanced force along the basis (k,), N.
    scale : float
        Stiffness that is typical of the mechanism: what rounding is measured by.
    """

    values: np.ndarray
    directions: np.ndarray
    matrix: np.ndarray
    basis: np.ndarray
    force: np.ndarray
    scale: float

    @property
    def _real(self) -> np.ndarray:
        """Eigenvalues that are real, but for rounding."""
        return self.values[np.abs(self.values.imag) <= CIRCULATORY * np.abs(self.values)].real

    @property
    def holds(self) -> bool:
        """True if every free direction is held: no real eigenvalue is zero or below.

        If forces have no potential (a load that follows a rod) eigenvalues may be complex; small motions decide.
        """
        return not np.any(self._real <= NEUTRAL * self.scale)

    @property
    def pushes_away(self) -> bool:
        """True if a free direction is pushed away from the pose: a real eigenvalue is below zero."""
        return bool(np.any(self._real < -NEUTRAL * self.scale))

    @property
    def least(self) -> float:
        """Smallest real part; infinite if nothing can move."""
        return float(np.min(self.values.real, initial=np.inf)) + 0.0  # no -0

    @property
    def negative(self) -> int:
        """Number of directions in which the mechanism gives way."""
        return int(np.sum(self.values.real < -NEUTRAL * self.scale))

    @property
    def falling(self) -> int:
        """Number of directions in which the mechanism gives way without turning about: real eigenvalues below zero.

        Only these change their number at a singular stiffness; a complex pair, of forces
        without potential, may pass the imaginary axis and nothing happens.
        """
        return int(np.sum(self._real < -NEUTRAL * self.scale))

    @property
    def singularity(self) -> float:
        """Eigenvalue nearest to zero, with the sign of the determinant."""
        sign = np.linalg.slogdet(self.matrix)[0]
        return float(sign * np.min(np.abs(self.values), initial=np.inf))

    @property
    def is_real(self) -> bool:
        """True if all eigenvalues are real, as they are if forces have a potential."""
        return not np.iscomplexobj(self.values)


class Statics:
    """Equations of statics at one time; the unknowns are ``x = (q, z, lam, y)``.

    Parameters
    ----------
    signals : Signals
        Inputs; feedback is taken at zero velocity.
    t : float
        Time, s.
    start : (numpy.ndarray, numpy.ndarray)
        Pose and first-order states (n,), (k,) from which states that keep a memory follow the motion.
    unknowns : sequence of Input or Parameter, optional
        Inputs and parameters ``y`` that are looked for too.
    conditions : sequence of Condition, optional
        Equalities that hold besides.
    sizes : sequence of float, optional
        Typical sizes of the unknowns ``y``; otherwise their values, or their limits if these are zero, or what balances
        the loads.
    """

    def __init__(
        self,
        numeric: NumericEquations,
        signals: Signals,
        t: float,
        start: tuple[np.ndarray, np.ndarray],
        unknowns: Sequence[Input | Parameter] = (),
        conditions: Sequence[Condition] = (),
        sizes: Sequence[float] | None = None,
    ):
        self.numeric, self.t = numeric, t
        self._sizes = np.array([s.typical_size for s in unknowns] if sizes is None else sizes)
        eom = self.eom = numeric.eom
        self.n, self.k, self.m = eom.q.numel(), eom.z.numel(), eom.lam.numel()
        y = ca.vertcat(ca.SX(0, 1), *unknowns)
        self._free_p = _places(eom.mechanism.parameters, unknowns)
        self._known_p = [k for k in range(numeric.p.size) if k not in self._free_p]
        self._from_y = [_places(unknowns, [eom.mechanism.parameters[k]])[0] for k in self._free_p]
        u = ca.SX(signals.at_time(t))
        for k in _places(eom.mechanism.inputs, unknowns):
            u[k] = eom.mechanism.inputs[k]
        fed_back, u = u, ca.substitute(u, eom.v, ca.SX.zeros(self.n))
        rows = ca.vertcat(eom.Q - eom.Phi_q.T @ eom.lam, eom.Phi, eom.z_rate, *[c.expression for c in conditions])
        rest = ca.SX.zeros(self.n)
        self._moving, self._rest = ca.vertcat(eom.v, eom.a, eom.u), ca.vertcat(rest, rest, u)
        x = ca.vertcat(eom.q, eom.z, eom.lam, y)
        arguments = self._symbols = [x, eom.t, eom.p[self._known_p]]
        # friction by reactions, and conditions on these, choose among the multipliers
        self.reactions_are_free = not eom.Q_depends_on_lam and not any(c.depends_on("multiplier") for c in conditions)
        self._rows = self.function(rows)
        self._inputs = ca.Function("inputs", arguments, [ca.densify(u)])
        moving = ca.substitute(ca.vertcat(eom.Q, eom.z_rate), eom.u, fed_back)
        slope = ca.substitute(ca.jacobian(moving, eom.v), self._moving, self._rest)
        self._by_velocity = ca.Function("by_velocity", arguments, [ca.densify(slope)])
        first = self.n + eom.Phi.numel()
        #: rows of the rates of first-order states
        self.rates = slice(first, first + self.k)
        self.memory = Memory(numeric, signals, t, *start, unknowns)

    # --- the unknowns ----------------------------------------------------------------
    def join(self, q: np.ndarray, z: np.ndarray, lam: np.ndarray, y: np.ndarray | Sequence[float] = ()) -> np.ndarray:
        """The unknowns as one vector."""
        return np.concatenate([q, z, lam, np.asarray(y, float)])

    def split(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """``q, z, lam, y``."""
        parts = np.split(x, np.cumsum([self.n, self.k, self.m]))
        return parts[0], parts[1], parts[2], parts[3]

    def parameters(self, x: np.ndarray) -> np.ndarray:
        """All parameter values, those that are looked for included."""
        p = self.numeric.p.copy()
        p[self._free_p] = self.split(x)[3][self._from_y]
        return p

    def of_least_norm(self, x: np.ndarray) -> np.ndarray:
        """Multipliers with the same loads (m,), of least norm if rows depend on each other."""
        q, _, lam, _ = self.split(x)
        if not self.m or not self.numeric.has_redundant_rows(self.t, q):
            return lam
        of_least_norm: np.ndarray = self.numeric.of_least_norm(
            np.array([self.t]), q[None, :], lam[None, :], self.parameters(x)
        )[0]
        return of_least_norm

    def inputs(self, x: np.ndarray) -> np.ndarray:
        """Input values (n_u,)."""
        return self._inputs(x, self.t, self.numeric.p[self._known_p]).full().ravel()

    def function(self, column: ca.SX) -> Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]:
        """Return ``x -> (values, Jacobian)`` of a column of expressions at rest."""
        column = ca.substitute(ca.densify(column), self._moving, self._rest)
        compiled = ca.Function("statics", self._symbols, [column, ca.jacobian(column, self._symbols[0])])

        def at(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            values, jacobian = compiled(x, self.t, self.numeric.p[self._known_p])
            return values.full().ravel(), jacobian.full()

        return at

    # --- residual ------------------------------------------------------------------------
    def rows(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """All rows ``(forces, Phi, z_rate, conditions)`` and their Jacobian; with what states remember among z_rate."""
        values, jacobian = self._at_rest(x)
        if self.memory.directions.size:
            q, z, lam, _ = self.split(x)
            residual, by_pose, by_state = self.memory.residual(q, z, lam, self.parameters(x))
            values[self.rates] += residual
            jacobian[self.rates, : self.n] += by_pose
            jacobian[self.rates, self.n : self.n + self.k] += by_state
        return values, jacobian

    def _at_rest(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rows and Jacobian with the rates themselves."""
        return self._rows(x)

    def states_by_the_way(self, x: np.ndarray) -> list[str]:
        """Names of states that remember more than the pose, and on which the equilibrium depends.

        A servo rests where the states that it follows stand.
        """
        if not self.k:
            return []
        (q, z, lam, _), (_, rest), (_, whole) = self.split(x), self._at_rest(x), self.rows(x)
        states, free = slice(self.n, self.n + self.k), self._free(x)[1]
        rates = whole[self.rates]
        decide = np.hstack([rates[:, : self.n] @ free, rates[:, self.n : self.n + self.k + self.m]])
        # rates that vanish together whatever the pose, to first order
        left = np.any(np.abs(analyse_rank(decide.T).null_columns) > NEUTRAL, axis=1)
        if self.memory.directions.size:
            left |= self.memory.by_the_way(q, z, lam, self.parameters(x), free)
        felt = np.any(rest[:, states], axis=0)
        felt[self.eom.followed_states] = False
        return [s.label for s, own in zip(self.eom.mechanism.states, left & felt, strict=True) if own]

    def scaled(self, x: np.ndarray):
        """The rows as equations with slopes of size one, and the metric of the unknowns, both in levers.

        The rows keep the scale they have at `x`.
        """
        c = self.numeric.column_scale
        values, jacobian = self.rows(x)
        size = np.max(np.abs(jacobian[:, : self.n] * c), axis=1, initial=0.0)
        least = SOFTEST * self._typical(x, values, jacobian) or 1.0
        size[: self.n] = np.maximum(size[: self.n], least / c)
        size[self.n :] = np.maximum(size[self.n :], 1.0)
        # the largest would make columns so large beside soft springs that these were taken for none
        force = float(np.clip(np.min(size[: self.n] * c, initial=np.inf), *SQUARED))
        size *= self.lever

        def equations(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            values, slope = self.rows(x)
            return values / size, slope / size[:, None]

        weights = [
            1 / c**2,
            np.ones(self.k),
            np.full(self.m, 1 / force**2),
            (self.lever / self._size_of_unknowns(x, jacobian)) ** 2,
        ]
        return equations, np.concatenate(weights) / self.lever**2

    def _typical(self, x: np.ndarray, values: np.ndarray, jacobian: np.ndarray) -> float:
        """Stiffness that slopes are compared with, N/m: of the springs, or of forces over the lever.

        Forces are those that act, reactions, and those that states and unknowns of the size they have would bring.
        """
        c, n = self.numeric.column_scale, self.n
        if not self.is_loaded(x):
            return 0.0
        _, z, lam, _ = self.split(x)
        size = np.concatenate([np.maximum(1.0, np.abs(z)), np.abs(lam), self._size_of_unknowns(x, jacobian)])
        force = max(largest(c * values[:n]), largest(c[:, None] * jacobian[:n, n:] * size))
        return largest(c[:, None] * jacobian[:n, :n] * c) + force / self.lever

    def is_loaded(self, x: np.ndarray) -> bool:
        """True if a force acts, or would if the pose, a state or an unknown changed; else reactions are rounding."""
        load, slopes = self._at_rest(self.without_reactions(x))
        others = np.delete(slopes[: self.n], range(self.n + self.k, self.n + self.k + self.m), axis=1)
        return bool(np.any(load[: self.n]) or np.any(others))

    def without_reactions(self, x: np.ndarray) -> np.ndarray:
        """Unknowns with multipliers of zero."""
        q, z, lam, y = self.split(x)
        return self.join(q, z, np.zeros(lam.size), y)

    def _size_of_unknowns(self, x: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
        """Sizes of the unknowns ``y``: those that they have, or typically have, or that balance what reactions bear."""
        y, c, n = self.split(x)[3], self.numeric.column_scale, self.n
        size = np.maximum(self._sizes, np.abs(y))
        slopes = np.max(np.abs(c[:, None] * jacobian[:n, x.size - y.size :]), axis=0, initial=0.0)
        load = largest(c * self._at_rest(self.without_reactions(x))[0][:n])
        balancing = np.where(slopes > 0, load / np.where(slopes > 0, slopes, 1.0), 0.0)
        size = np.where(size > 0, size, balancing)
        return np.where(size > 0, size, 1.0)

    # --- moving ------------------------------------------------------------------------------
    @property
    def lever(self) -> float:
        """Typical distance on the mechanism: what a displacement is compared with, m."""
        return self.numeric.scale.length

    def distance(self, x: np.ndarray, y: np.ndarray) -> float:
        """Largest displacement or turn from one pose to another, in levers and radians."""
        return largest((y - x)[: self.n] / (self.lever * self.numeric.column_scale))

    def displaced(self, x: np.ndarray, step: np.ndarray) -> np.ndarray | None:
        """Pose displaced by `step` (n,) and brought back onto the constraints; None if the parts come apart."""
        numeric = self.numeric
        rows = partial(numeric.position, self.t, z=self.split(x)[1])
        sizes = numeric.scale.coordinates
        outcome = solve(rows, x[: self.n] + step, numeric.weights, sizes=sizes, iterations=20)
        if not outcome.converged:
            return None
        return self.follow(np.concatenate([outcome.x, x[self.n :]]))

    # --- free directions --------------------------------------------------------------------
    def follow(self, x: np.ndarray) -> np.ndarray:
        """Return the pose with the multipliers and first-order states that balance the loads as far as they can."""
        c, basis = self._free(x)
        x = x.copy()
        for _ in range(3):
            values, jacobian = self.rows(x)
            left = self._left(jacobian, basis, c)
            right = np.concatenate([values[: self.n] * c, values[self.rates]])
            step = -least_norm(left, right, threshold=BALANCED)
            x[self.n : self.n + self.k] += step[: self.k]
            x[self.n + self.k : self.n + self.k + self.m] += step[self.k : self.k + self.m]
            if largest(step[: self.k]) <= 1e-12 and not self.eom.Q_depends_on_lam:
                break
        return x

    def stiffness(self, x: np.ndarray) -> Stiffness:
        """Reduced stiffness and unbalanced force at a pose, with multipliers and states from :meth:`follow`."""
        c, basis = self._free(x)
        values, jacobian = self.rows(x)
        left = self._left(jacobian, basis, c)
        moved = np.vstack([c[:, None] * jacobian[: self.n, : self.n], jacobian[self.rates, : self.n]]) @ basis
        held = np.concatenate([c * values[: self.n], np.zeros(self.k)])
        answer = least_norm(left, np.column_stack([moved, held]), threshold=BALANCED)[self.k + self.m :]
        matrix, force = -answer[:, :-1], answer[:, -1]
        scale = self._typical(x, values, jacobian)
        if largest(matrix - matrix.T) <= CIRCULATORY * max(scale, np.finfo(float).tiny):
            values, vectors = np.linalg.eigh((matrix + matrix.T) / 2)
        else:
            values, vectors = np.linalg.eig(matrix)
            order = np.argsort(values.real)
            values, vectors = values[order], vectors[:, order]
        return Stiffness(values, basis @ vectors, matrix, basis, force, scale)

    def small_motions(self, x: np.ndarray) -> SmallMotions:
        """Small motions about an equilibrium, with damping, feedback and the rates of first-order states."""
        c, basis = self._free(x)
        n, k = self.n, self.k
        _, jacobian = self._at_rest(x)
        by_velocity = self._by_velocity(x, self.t, self.numeric.p[self._known_p]).full()
        masses = self.eom.masses(self.parameters(x), self.split(x)[1])
        inertia = np.vstack([-masses[:, None] * basis, np.zeros((k, basis.shape[1]))])
        # forces and rates by displacements, velocities, accelerations and states; multipliers follow
        moving = np.vstack([jacobian[:n], jacobian[self.rates]])
        sources = np.hstack([moving[:, :n] @ basis, by_velocity @ basis, inertia, moving[:, n : n + k]])
        lam = slice(n + k, n + k + self.m)
        left = np.hstack([c[:, None] * jacobian[:n, lam], basis / c[:, None]])
        answer = least_norm(left, c[:, None] * sources[:n], threshold=BALANCED)
        force = answer[self.m :]
        rate = sources[n:] - jacobian[self.rates, lam] @ answer[: self.m]
        return SmallMotions.of(force, rate, basis)

    def _free(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Scale of the coordinates, and virtual displacements that are orthonormal in it."""
        c = self.numeric.column_scale
        p = self.parameters(x)
        jacobian = self.numeric.eom.slopes(self.t, x[: self.n], p).full()
        null = analyse_rank(self.numeric.scale.scaled(jacobian)).null_columns
        return c, c[:, None] * null

    def _left(self, jacobian: np.ndarray, basis: np.ndarray, c: np.ndarray) -> np.ndarray:
        """Matrix that multiplies ``(dz, dlam, -f)``: states, multipliers, and the force left over along the basis."""
        n, k, m = self.n, self.k, self.m
        upper = np.hstack([c[:, None] * jacobian[:n, n : n + k + m], basis / c[:, None]])
        lower = np.hstack([jacobian[self.rates, n : n + k + m], np.zeros((k, basis.shape[1]))])
        return np.vstack([upper, lower])


def _places(symbols: Sequence[ca.SX], wanted: Sequence[ca.SX]) -> list[int]:
    """Places of the symbols that are among those wanted."""
    return [k for k, symbol in enumerate(symbols) if place_of(symbol, wanted) is not None]
