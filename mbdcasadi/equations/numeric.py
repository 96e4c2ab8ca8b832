"""Numbers from the equations: constraint functions and the solve for (a, lam) at given parameters."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, TypeVar

import casadi as ca
import numpy as np

from ..errors import NOT_FINITE, MechanismError, ModelError, SingularityError
from ..model.forces.friction.modes import switches
from ..numerics.console import call_each
from ..numerics.evaluation import Evaluator
from ..numerics.lazy import cached_property
from ..numerics.least_squares import largest
from ..numerics.lookup import with_tables
from ..numerics.rank import (
    INDEPENDENT,
    RankAnalysis,
    analyse_rank,
    rows_taking_part,
    sparse_rank,
    surely_independent,
    surely_independent_sparse,
)
from ..numerics.tolerances import EPSILON, RANK
from .augmentation import effective_masses
from .derivation import Equations
from .dynamics import dynamics_saddle, forward_dynamics
from .least_norm import norm_of_multipliers
from .saddle import Refinement, Saddle
from .scale import Scale, scale_of

T = TypeVar("T")

#: Share of the largest mass (and inertia) that each has at least in the metrics for assembly and projection. Beyond
#: it the equations lose what a light body adds to them.
SMALLEST_WEIGHT, SMALLEST_PROJECTION_WEIGHT = 1e-10, 1e-2
#: Largest step of Newton's method from afar, in characteristic lengths.
FARTHEST = 3.0
#: Left over of ``Phi_q a = gamma``, relative to its terms, from which no acceleration meets the constraints.
ACCELERATION_TOLERANCE = 1e-5
#: Share of the accelerations that reactions alone would give below which their sum is rounding, over that tolerance.
BALANCED = 1e-6
#: Square of the share of a free motion in coordinates with mass below which it moves none.
WITHOUT_MASS = 1e-12


class NumericEquations:
    """The equations of motion at given parameter values.

    Raises
    ------
    ModelError
        If a mass, a length or another limited quantity is out of its limits at these values.
    """

    def __init__(self, eom: Equations, p: np.ndarray):
        for element in eom.mechanism.elements:
            if switches(element):
                raise ModelError(f"{element.description} {element.exactness}")
        self.eom = eom
        self.p = np.asarray(p, float)
        eom.mechanism.check_values(self.p)
        self.mass = eom.masses(self.p)
        # of the pose that was looked at last: analyses begin with several questions about one pose
        self._last: dict[str, tuple[tuple[Any, ...], Any]] = {}

    @cached_property
    def weights(self) -> np.ndarray:
        """Metric in which poses and velocities are nearest: the masses; if there are none at all, by the sizes (n,).

        What has no mass beside parts that have some counts for next to nothing, so that it does not hold these back.
        """
        sizes = self.scale.coordinates
        alike = self.mass * sizes**2
        if not np.any(alike > 0):
            return 1 / sizes**2
        return np.maximum(alike, SMALLEST_WEIGHT * np.max(alike)) / sizes**2

    @property
    def weights_expression(self) -> ca.SX:
        """:attr:`weights` as an expression in the parameters (n,), for masses that may go to zero with them."""
        if not np.any(self.mass > 0):
            return ca.SX(ca.DM(self.weights))
        sizes = ca.DM(self.scale.coordinates)
        alike = self.eom.own_masses * sizes**2
        return ca.fmax(alike, SMALLEST_WEIGHT * ca.mmax(alike)) / sizes**2

    @cached_property
    def projection_weights(self) -> np.ndarray:
        """Metric in which a motion is kept on its constraints (n,): the masses, more nearly alike.

        What has no mass counts as much as other parts: in singular poses a light part would take all of a correction.
        """
        sizes = self.scale.coordinates
        alike = self.mass * sizes**2
        there = alike[alike > 0]
        typical = float(np.exp(np.mean(np.log(there)))) if there.size else 1.0
        return self._raised(np.where(alike > 0, alike, typical)) / sizes**2

    @property
    def multiplier_weights(self) -> np.ndarray | None:
        """Projection weights to powers of four (n,), for multipliers of least norm beside light bodies; None without
        these."""
        if self.augmentation is None:
            return None
        weights = self.projection_weights
        return 4.0 ** np.round(np.log2(weights / np.max(weights)) / 2)

    def _raised(self, alike: np.ndarray) -> np.ndarray:
        """Masses of which none is below a share of the largest of its body, and no body below one of the largest."""
        least = SMALLEST_PROJECTION_WEIGHT
        bodies = np.split(alike.copy(), range(3, 3 * len(self.eom.mechanism.bodies) + 1, 3))
        most = float(np.max(alike))
        for body in bodies:
            heaviest = float(np.max(body, initial=0.0))
            body *= max(1.0, least * most / heaviest) if heaviest > 0 else 1.0
            np.maximum(body, least * max(heaviest, least * most), out=body)
        return np.concatenate(bodies)

    @cached_property
    def mass_of_impulses(self) -> np.ndarray:
        """Masses of derivatives through impacts (n,); raises an error if they change with states."""
        changes = ca.which_depends(self.eom.mass_diagonal, self.eom.z, 1, True) if self.eom.z.numel() else []
        if any(changes):
            name = self.eom.mechanism.bodies[changes.index(True) // 3].name
            raise MechanismError(
                f"body '{name}': its mass or inertia changes with a state, and derivatives of a motion through impacts "
                "take those that do not; use Contact with a stiffness, or a constant mass"
            )
        return self.mass

    @cached_property
    def massless(self) -> bool:
        """True if a coordinate has no inertia."""
        return bool(np.any(self.mass == 0))

    @cached_property
    def augmentation(self) -> np.ndarray | None:
        """Effective masses of the rows (m,), if bodies are light or have no mass; else None."""
        make = partial(effective_masses, self.eom, self.p, self.mass, self.scale)
        key = ("effective masses", self.p.tobytes())
        return self.eom.shared.get_or_create(key, make, bounded=True)

    @property
    def light_key(self) -> bytes | None:
        """Key of functions compiled with these effective masses."""
        return _bytes_of(self.augmentation)

    @cached_property
    def _position(self) -> Evaluator:
        eom = self.eom
        return self._evaluator("position", lambda: ([eom.t, eom.q, eom.z, eom.p], [eom.Phi, eom.position_jacobian]))

    @cached_property
    def _jacobian(self) -> Evaluator:
        eom = self.eom
        return eom.shared.get_or_create("slopes", lambda: Evaluator(eom.slopes))

    @cached_property
    def velocity_function(self) -> ca.Function:
        """``(t, q, z, p) -> (Phi_q, nu)``."""
        return self._velocity.function

    @cached_property
    def _velocity(self) -> Evaluator:
        eom = self.eom
        return self._evaluator("velocity", lambda: ([eom.t, eom.q, eom.z, eom.p], [eom.Phi_q, ca.densify(eom.nu)]))

    @cached_property
    def _acceleration(self) -> Evaluator:
        eom = self.eom
        known = [eom.t, eom.q, eom.v, eom.z, eom.u, eom.p]
        return self._evaluator("acceleration", lambda: (known, [eom.Phi_q, eom.gamma]))

    def _evaluator(self, key: str, terms: Callable[[], tuple[list[ca.SX], list[ca.SX]]]) -> Evaluator:
        """A function of one time from its arguments and results, made once for a mechanism."""
        return self.eom.shared.get_or_create(key, lambda: Evaluator(ca.Function(key, *terms())))

    def position(self, t: float, q: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """``Phi`` and its Jacobian, position rows only."""
        phi, jacobian = self._position(t, q, z, self.p)
        return phi.ravel(), jacobian

    def jacobian(self, t: float, q: np.ndarray) -> np.ndarray:
        """``Phi_q``, all rows, which no state enters."""
        return self._jacobian(t, q, self.p)[0]

    def velocity(self, t: float, q: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """``Phi_q`` and ``nu``, all rows."""
        jacobian, nu = self._velocity(t, q, z, self.p)
        return jacobian, nu.ravel()

    def acceleration(
        self, t: float, q: np.ndarray, v: np.ndarray, z: np.ndarray, u: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """``Phi_q`` and ``gamma``, all rows."""
        jacobian, gamma = self._acceleration(t, q, v, z, u, self.p)
        return jacobian, gamma.ravel()

    def largest_miss(self, t: float, q: np.ndarray, v: np.ndarray, z: np.ndarray) -> tuple[str, float]:
        """Name of the row that is met worst at a state, at the level of positions or velocities, and by how much."""
        eom = self.eom
        jacobian, nu = self.velocity(t, q, z)
        residual = np.r_[self.position(t, q, z)[0], jacobian @ v - nu]
        names = [*eom.position_names, *(f"the rate of {name}" for name in eom.row_names)]
        worst = int(np.argmax(np.abs(residual))) if residual.size else 0
        return (names[worst], float(residual[worst])) if residual.size else ("", 0.0)

    # --- scale and rank ----------------------------------------------------------------
    @cached_property
    def scale(self) -> Scale:
        """Characteristic sizes of the mechanism."""
        return scale_of(self.eom, self.p, self.mass)

    @property
    def column_scale(self) -> np.ndarray:
        """Change of each coordinate that moves a point by about one metre (n,)."""
        return self.scale.columns

    @property
    def largest_mass(self) -> float:
        """Largest mass of a coordinate in these units, kg; one if there is none."""
        return float(np.max(self.mass * self.column_scale**2, initial=0.0)) or 1.0

    @property
    def typical_step(self) -> np.ndarray:
        """Half a radian for angles; for displacements its arc at the characteristic length (n,)."""
        return 0.5 * self.scale.coordinates

    @property
    def step_limit(self) -> np.ndarray:
        """Largest change of each coordinate in a step of Newton's method from afar (n,)."""
        return np.where(self.eom.angles, 1.0, FARTHEST * self.scale.coordinates)

    def rank(self, t: float, q: np.ndarray) -> RankAnalysis:
        """Rank of ``Phi_q`` with its columns and rows scaled to size one."""
        return self.of_state("rank", (t, q), lambda: analyse_rank(self.scaled_jacobian(t, q), self._rank_tolerance(q)))

    def of_state(self, question: str, parts: tuple[Any, ...], answer: Callable[[], T]) -> T:
        """Return the answer to a question about a state, which is kept until another state is asked about.

        Parameters
        ----------
        parts : tuple of array_like
            The time and what else of the state the answer depends on.
        """
        state = tuple([part.tobytes() if isinstance(part, np.ndarray) else part for part in parts])
        last = self._last.get(question)
        if last is None or last[0] != state:
            last = self._last[question] = state, answer()
        answered: T = last[1]
        return answered

    def is_regular(self, t: float, q: np.ndarray) -> bool:
        """Return True if the rows are independent by far at a pose; False if the pose is singular or may be."""
        if self.eom.is_large:
            return self.of_state("regular", (t, q), lambda: surely_independent_sparse(self._sparse_jacobian(t, q)))
        return self.of_state("regular", (t, q), lambda: surely_independent(self.scaled_jacobian(t, q)))

    def scaled_jacobian(self, t: float, q: np.ndarray) -> np.ndarray:
        """``Phi_q`` with columns that compare and rows of length one (m, n)."""
        return self.scale.scaled(self.jacobian(t, q))

    def row_size(self, t: float, q: np.ndarray) -> np.ndarray:
        """Length of each row of ``Phi_q`` with scaled columns (m,)."""
        return self.scale.row_size(self.jacobian(t, q))

    def _rank_tolerance(self, q: np.ndarray) -> float:
        """Singular value that is none: levers are differences of places, whose rounding grows with their distance."""
        far = largest(q[: 3 * len(self.eom.mechanism.bodies)].reshape(-1, 3)[:, :2])
        return max(RANK, 100 * EPSILON * far / self.scale.length)

    def has_redundant_rows(self, t: float, q: np.ndarray) -> bool:
        """Return True if rows depend on each other at a pose; by sparse factorisation if the mechanism is large."""

        def answer() -> bool:
            tolerance = self._rank_tolerance(q)
            if tolerance < INDEPENDENT and self.is_regular(t, q):
                return False
            rank = sparse_rank(self._sparse_jacobian(t, q), tolerance) if self.eom.is_large else self.rank(t, q).rank
            return rank < self.eom.lam.numel()

        return self.of_state("redundant", (t, q), answer)

    def _sparse_jacobian(self, t: float, q: np.ndarray) -> ca.DM:
        """:meth:`scaled_jacobian` with its zeros left out."""
        jacobian = self.eom.slopes(t, q, self.p) @ ca.diag(ca.DM(self.column_scale))
        size = np.sqrt(ca.sum2(jacobian**2).full().ravel())
        return ca.diag(ca.DM(1 / self.scale.known_size(size))) @ jacobian

    # --- accelerations and multipliers ---------------------------------------------------
    def saddle(self, refinement: Refinement | None = None, *, under_reactions: bool = False) -> Saddle:
        """:func:`System <.dynamics_saddle>` of accelerations and multipliers for these masses."""
        return dynamics_saddle(self.eom, self.augmentation, refinement, under_reactions=under_reactions)

    def forward_dynamics(self, *, redundant: bool) -> ca.Function:
        """``(t, q, v, z, u, p) -> (a, lam)`` for these masses."""
        weights = self.multiplier_weights if redundant else None

        def make() -> ca.Function:
            return forward_dynamics(self.eom, self.augmentation, redundant=redundant, weights=weights)

        return self.eom.shared.get_or_create(("forward dynamics", self.light_key, redundant, _bytes_of(weights)), make)

    @property
    def norm_of_multipliers(self) -> ca.Function:
        """``(t, q, p) -> D``: diagonal of the norm of which those of redundant rows are the least (m,)."""
        eom, weights = self.eom, self.multiplier_weights

        def make() -> ca.Function:
            return ca.Function("norm", [eom.t, eom.q, eom.p], [ca.densify(norm_of_multipliers(eom, weights))])

        return eom.shared.get_or_create(("norm of multipliers", _bytes_of(weights)), make)

    def of_least_norm(self, t: np.ndarray, q: np.ndarray, lam: np.ndarray, p: np.ndarray | None = None) -> np.ndarray:
        """Multipliers with the same loads (k, m) of least norm, as those of :attr:`forward_dynamics` are.

        Parameters
        ----------
        t, q, lam : numpy.ndarray
            Times (k,), coordinates (k, n) and multipliers (k, m) by row.
        p : numpy.ndarray, optional
            Parameter values other than these.
        """
        known, (count, m) = ca.DM(self.p if p is None else p), lam.shape
        jacobians = self.eom.slopes(t[None, :], q.T, known).full().reshape(m, count, -1).transpose(1, 2, 0)
        root = 1 / np.sqrt(self.norm_of_multipliers(t[None, :], q.T, known).full().T)
        scaled = self.column_scale[:, None] * jacobians * root[:, None, :]
        return root * np.einsum("kmn,knl,kl->km", np.linalg.pinv(scaled, rcond=RANK), scaled, lam / root)

    def motion_without_mass(self, t: float, q: np.ndarray, share: float = WITHOUT_MASS) -> list[str]:
        """Coordinates in which something moves that neither has mass nor is held by joints.

        Parameters
        ----------
        share : float
            Part of the square of a motion in coordinates with mass up to which it counts as one without mass.
        """
        if not self.massless:
            return []
        # the amount of mass does not matter: a motion that moves no coordinate with mass is one without mass
        free = self.rank(t, q).null_columns
        values, vectors = np.linalg.eigh(free.T @ ((self.mass > 0)[:, None] * free))
        empty = free @ vectors[:, values <= share]
        moved = np.linalg.norm(empty, axis=1) > 1e-8
        return [self.eom.coordinate_names[k] for k in np.flatnonzero(moved & (self.mass == 0))]

    def not_finite(
        self, t: float, q: np.ndarray, v: np.ndarray, z: np.ndarray, u: np.ndarray, *, slopes: bool = False
    ) -> list[str]:
        """Elements whose force, and states whose rate, has no finite value, or no finite slope, at a state."""
        n, m = self.eom.q.numel(), self.eom.lam.numel()
        mechanism, motion = self.eom.mechanism, ca.vertcat(self.eom.q, self.eom.v, self.eom.z)
        parts = [(e.description, [ca.vec(ca.SX(f)) for _, f in e.virtual_work]) for e in mechanism.elements]
        parts += [(f"the rate of state '{s.label}'", [ca.SX(mechanism.state_rates[s])]) for s in mechanism.states]
        names = []
        for name, values in parts:
            if values:
                what = ca.jacobian(ca.vertcat(*values), motion) if slopes else ca.vertcat(*values)
                found = self.eom.function(what)(t, q, v, np.zeros(n), z, np.zeros(m), u, self.p)
                names += [] if np.all(np.isfinite(found.full())) else [name]
        return names

    def rows_not_finite(self, t: float, q: np.ndarray, v: np.ndarray, z: np.ndarray, u: np.ndarray) -> list[str]:
        """Names of the rows that have no finite value, no finite slope or no finite ``nu`` and ``gamma`` at a state."""
        (jacobian, nu), (_, gamma) = self.velocity(t, q, z), self.acceleration(t, q, v, z, u)
        finite = np.isfinite(nu) & np.isfinite(gamma) & np.all(np.isfinite(jacobian), axis=1)
        finite[self.eom.position_rows] &= np.isfinite(self.position(t, q, z)[0])
        return [name for name, well in zip(self.eom.row_names, finite, strict=True) if not well]

    def refuse_missing_mass(self, t: float, q: np.ndarray) -> None:
        """Raise SingularityError for a body without mass in a motion that no joint holds at a pose."""
        missing = self.motion_without_mass(t, q)
        if missing:
            bodies = dict.fromkeys(f"'{name.rsplit('.', 1)[0]}'" for name in missing)
            turning = all(name.endswith(".phi") for name in missing)
            particles = " (a particle takes any inertia: nothing turns it)" if turning else ""
            raise SingularityError(
                f"body {', '.join(bodies)} has no mass or inertia in {', '.join(missing)}, and no joint holds that "
                f"motion: the mass matrix is singular; give it mass or inertia, or a joint{particles}",
                time=t,
            )

    def accelerations(
        self, t: float, q: np.ndarray, v: np.ndarray, z: np.ndarray, u: np.ndarray, *, redundant: bool
    ) -> tuple[np.ndarray, np.ndarray]:
        """Accelerations and multipliers at one state.

        Raises
        ------
        SingularityError
            If mass is missing, or no acceleration meets the constraints (lock-up).
        """
        a, lam = self.of_state(
            "accelerations", (t, q, v, z, u, redundant), lambda: self._accelerations(t, q, v, z, u, redundant=redundant)
        )
        return a.copy(), lam.copy()

    def _accelerations(
        self, t: float, q: np.ndarray, v: np.ndarray, z: np.ndarray, u: np.ndarray, *, redundant: bool
    ) -> tuple[np.ndarray, np.ndarray]:
        self.refuse_missing_mass(t, q)
        if redundant and self.eom.Q_depends_on_lam:
            self._refuse_open_loads(t, q)
        a, lam = self._solved(t, q, v, z, u, redundant=redundant)
        finite = bool(np.isfinite(a).all())
        if self.eom.Q_depends_on_lam and not finite:
            raise SingularityError(
                f"no accelerations and reactions meet the equations at t = {t:.6g} s, and forces depend on both: "
                "friction is so large that a joint jams, or a force is not finite there",
                time=t,
            )
        jacobian, gamma = self.acceleration(t, q, v, z, u)
        left_over = jacobian @ a - gamma if a.size else np.zeros(0)
        residual = left_over / self._acceleration_terms(jacobian, gamma, a, lam)
        broken = [] if finite else self.not_finite(t, q, v, z, u)
        if broken:
            raise SingularityError(
                f"the force of {', '.join(broken)} is not finite at t = {t:.6g} s: {NOT_FINITE} (a length or a "
                "volume that has become negative)",
                time=t,
            )
        if not finite or not np.isfinite(lam).all() or largest(residual) > ACCELERATION_TOLERANCE:
            names = self.eom.row_names
            worst = np.argsort(-np.abs(np.where(np.isfinite(residual), residual, np.inf)))[:3]
            raise SingularityError(
                f"no acceleration meets the constraints at t = {t:.6g} s: the pose is singular for the rows "
                f"{', '.join(names[k] for k in worst)} (if several motions go from it, the velocities must be along "
                "one of them), or a force is not finite there",
                time=t,
            )
        return a, lam

    def _refuse_open_loads(self, t: float, q: np.ndarray) -> None:
        """Raise if forces depend on multipliers that rows which depend on each other share as they like."""
        open_ = self.eom.lam[rows_taking_part(self.rank(t, q).null_rows)]
        if ca.depends_on(self.eom.Q, open_):
            raise SingularityError(self.eom.why_not_unique, time=t)

    def _acceleration_terms(
        self, jacobian: np.ndarray, gamma: np.ndarray, a: np.ndarray, lam: np.ndarray
    ) -> np.ndarray:
        """Size of the terms of ``Phi_q a - gamma`` (m,): the largest of all rows, 1 rad/s² and its lever at least.

        Accelerations are what is left of forces that balance each other, and have a share of what these would give.
        """
        balanced = BALANCED * (np.abs(jacobian).T @ np.abs(np.nan_to_num(lam))) / self.weights
        terms = np.abs(jacobian) @ (np.abs(a) + balanced) + np.abs(gamma) if a.size else np.zeros(gamma.size)
        size: np.ndarray = max(largest(terms * self._levers), self.scale.length) / self._levers
        return size

    @cached_property
    def _levers(self) -> np.ndarray:
        """Lever by which the terms of each row compare (m,): the characteristic length for angles, 1 for others."""
        return np.where(self.eom.angular_rows, self.scale.length, 1.0)

    def _solved(self, *state: Any, redundant: bool) -> tuple[np.ndarray, np.ndarray]:
        """Accelerations and multipliers of one state."""
        solver = self._dynamics_evaluator(redundant=redundant)
        if solver is not None:
            a, lam = solver(*state, self.p)
            return a.ravel(), lam.ravel()
        a, lam = self.accelerations_of_rows(*(np.atleast_2d(part) for part in state), redundant=redundant)
        return a[0], lam[0]

    def _dynamics_evaluator(self, *, redundant: bool) -> Evaluator | None:
        """The forward dynamics; None if these iterate."""

        function = self.forward_dynamics(redundant=redundant)
        if not function.is_a("SXFunction"):
            return None
        return self.eom.shared.get_or_create(("by row", function), lambda: Evaluator(with_tables(function)))

    def accelerations_of_rows(
        self, t: np.ndarray, q: np.ndarray, v: np.ndarray, z: np.ndarray, u: np.ndarray, *, redundant: bool
    ) -> tuple[np.ndarray, np.ndarray]:
        """Accelerations (k, n) and multipliers (k, m) at states by row, times (k, 1); NaN where it fails."""
        evaluator = self._dynamics_evaluator(redundant=redundant)
        if evaluator is None:  # Newton's method may meet a singular matrix
            a, lam = call_each(self.forward_dynamics(redundant=redundant), t.T, q.T, v.T, z.T, u.T, self.p)
            return a.T, lam.T
        a, lam = evaluator.rows(t, q, v, z, u, self.p)
        return a, lam


def _bytes_of(values: np.ndarray | None) -> bytes | None:
    """Bytes of an array, as part of a key."""
    return None if values is None else values.tobytes()
