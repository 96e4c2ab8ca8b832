"""The part of a transcription that depends on the scheme: one interval of the mesh.

A transcription names the unknowns of an interval, the equations between them,
and the polynomials that the motion follows between the mesh points. The
program, the scaling, the guess, the refinement, the labels and the results
know no scheme by name.
"""

from __future__ import annotations

import copy
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, ClassVar, TypeVar

import casadi as ca
import numpy as np

from ...equations import equations
from ...equations.reduced import ReducedEquations
from ...errors import ModelError
from ...numerics.collocation import gauss
from ...numerics.evaluation import Evaluator
from ...numerics.lazy import cached_property
from .constraints import MotionConstraints
from .controls import InputBasis
from .points import CollocationPoint, Interval
from .rows import RowKind, Rows
from .scaling import Scales

Scheme = TypeVar("Scheme", bound="Transcription")


class Transcription(ABC):
    """Base class of transcriptions.

    A subclass sets :attr:`name`, :attr:`order`, :attr:`stages` and :attr:`quadrature`, and writes
    :attr:`interval_variables`, :meth:`input_points`, :meth:`point` and :meth:`equations`;
    ``optimize(problem, transcription=Subclass)`` uses it. Points of an interval are given by the
    normalised time ``tau``, which runs from 0 to 1 in it.

    Parameters
    ----------
    degree : int, default 3
        ``degree=`` of ``optimize``, for schemes that have a choice of stages.

    Attributes
    ----------
    name : str
        Name in results.
    order : int
        Order of the states at the mesh points.
    stages : numpy.ndarray
        Points ``tau`` at which the equations of motion hold.
    quadrature : numpy.ndarray
        Weights of the stages in an integral over the interval.
    eom : ReducedEquations
        Equations in the independent coordinates. Unknowns and rows of a scheme are in these.
        Known, as the following, in the methods that a subclass writes, not in its constructor.
    constraints : MotionConstraints
        Rows that hold throughout.
    weights : numpy.ndarray
        Metric W in which states are moved onto the constraints, by independent coordinate (n,).
    inputs : InputBasis
        Course of the inputs in an interval.
    known : tuple of int
        Places of the inputs whose courses are given; the others are unknown.
    """

    name: ClassVar[str]
    degree: int = 3
    order: int
    stages: np.ndarray
    quadrature: np.ndarray
    eom: ReducedEquations
    constraints: MotionConstraints
    weights: np.ndarray
    inputs: InputBasis
    known: tuple[int, ...] = ()

    def __init__(self, degree: int = 3):
        self.degree = degree

    def bound_to(
        self: Scheme,
        constraints: MotionConstraints,
        weights: np.ndarray,
        inputs: InputBasis,
        known: tuple[int, ...] = (),
    ) -> Scheme:
        """Return the scheme for the equations of a mechanism."""
        origin: Scheme = vars(self).get("_origin", self)
        scheme = copy.copy(origin)
        scheme._origin = origin  # type: ignore[attr-defined]
        scheme.eom, scheme.constraints, scheme.weights, scheme.inputs = constraints.eom, constraints, weights, inputs
        scheme.known = known
        return scheme

    # --- what a scheme says ---------------------------------------------------------------
    @property
    @abstractmethod
    def interval_variables(self) -> dict[str, tuple[int, np.ndarray]]:
        """Unknowns of an interval by name: number of rows, and a ``tau`` for each column; ``nan`` for none.

        Names that are known: ``a`` (accelerations), ``lam`` (multipliers of :attr:`rows`), ``u`` (inputs),
        ``rate`` (rates of first-order states), ``mu_1`` and ``mu_2`` (multipliers that move positions and
        velocities onto the constraints). Others need a size, see :meth:`variable_sizes`.
        """

    @abstractmethod
    def input_points(self, *, lower_degree: bool) -> tuple[tuple[float, ...], bool]:
        """Points inside the interval at which polynomial inputs have values, and whether both ends have values too.

        Parameters
        ----------
        lower_degree : bool
            True if the degree is to be one less than the stages determine.
        """

    @abstractmethod
    def point(self, interval: Interval, tau: Any) -> CollocationPoint:
        """State at a point of the interval by the polynomials of the scheme."""

    @abstractmethod
    def equations(self, interval: Interval, scales: Scales) -> list[Rows]:
        """Equations of motion in the interval, and the step to the next mesh point."""

    def start_rows(self, interval: Interval, scales: Scales) -> list[Rows]:
        """Equations that hold at the start of the motion alone, besides the constraints there."""
        return []

    def variable_sizes(self, scales: Scales) -> dict[str, np.ndarray]:
        """Typical sizes of the unknowns by name."""
        mu_1, mu_2 = self.constraints.corrections(scales, self.weights)
        return {
            "q": scales.q,
            "v": scales.v,
            "z": scales.z,
            "u": scales.u[self.free_inputs],
            "a": scales.a,
            "lam": scales.lam[self.rows],
            "rate": scales.z / scales.time,
            "mu_1": mu_1,
            "mu_2": mu_2,
        }

    # --- unknowns -------------------------------------------------------------------------
    @property
    def rows(self) -> list[int]:
        """Rows of ``eom`` that are independent; others are implied by them."""
        return self.constraints.rows

    @property
    def redundant(self) -> bool:
        """True if rows of ``eom`` are implied by others: multipliers are not unique."""
        return len(self.rows) < self.eom.lam.numel()

    @property
    def point_variables(self) -> dict[str, int]:
        """Unknowns of a mesh point: number of rows by name."""
        eom = self.eom
        sizes = {"q": eom.q.numel(), "v": eom.q.numel(), "z": eom.z.numel()}
        return sizes | {"u": len(self.free_inputs) if self.inputs.joined else 0}

    @cached_property
    def _parts(self) -> tuple[dict[str, slice], dict[str, slice]]:
        """Positions of the unknowns of a mesh point, and of an interval."""
        parts = []
        for counts in (self.point_variables, {name: k * taus.size for name, (k, taus) in self._variables.items()}):
            ends = np.cumsum([0, *counts.values()]).tolist()
            parts.append({name: slice(*ends[k : k + 2]) for k, name in enumerate(counts)})
        return parts[0], parts[1]

    @cached_property
    def _variables(self) -> dict[str, tuple[int, np.ndarray]]:
        variables = self.interval_variables
        return {k: (len(self.free_inputs) if k == "u" else size, taus) for k, (size, taus) in variables.items()}

    @cached_property
    def free_inputs(self) -> list[int]:
        """Places of the inputs that are unknown."""
        return [k for k in range(self.eom.u.numel()) if k not in self.known]

    @cached_property
    def known_basis(self) -> InputBasis:
        """Known inputs in an interval: polynomials through values at points inside; they may jump at mesh points."""
        return InputBasis("polynomial", tuple(gauss(max(self.stages.size, 2)).points.tolist()), False)

    def known_columns(self, times: np.ndarray, values: Callable[[np.ndarray], np.ndarray]) -> np.ndarray:
        """Values of the known inputs in the intervals of a mesh, s, by a function of times (k,) to (k, n); (N, n k)."""
        at = times[:-1, None] + np.diff(times)[:, None] * self.known_basis.taus
        return values(at.ravel()).reshape(times.size - 1, -1) if self.known else np.zeros((times.size - 1, 0))

    @cached_property
    def point_size(self) -> int:
        """Number of unknowns of a mesh point."""
        return sum(self.point_variables.values())

    @cached_property
    def interval_size(self) -> int:
        """Number of unknowns of an interval alone."""
        return sum(k * taus.size for k, taus in self._variables.values())

    @property
    def known_size(self) -> int:
        """Number of values of known inputs that follow the unknowns of an interval."""
        return len(self.known) * self.known_basis.taus.size if self.known else 0

    def split_point(self, values: Any) -> dict[str, Any]:
        """Unknowns of a mesh point by name: ``q``, ``v``, ``z``, and ``u`` if the inputs are continuous."""
        return {name: values[part] for name, part in self._parts[0].items()}

    def split_interval(self, values: Any) -> dict[str, Any]:
        """Unknowns of an interval by name, one column for each ``tau``."""
        return {
            name: ca.reshape(values[self._parts[1][name]], k, taus.size) for name, (k, taus) in self._variables.items()
        }

    def interval_slice(self, name: str) -> slice:
        """Position of a variable among the unknowns of the interval."""
        return self._parts[1][name]

    def sizes(self, scales: Scales) -> tuple[np.ndarray, np.ndarray]:
        """Typical sizes of the unknowns of a mesh point and of an interval."""
        known = self.variable_sizes(scales)
        missing = [name for name in self._variables if name not in known]
        if missing:
            raise ModelError(
                f"transcription '{self.name}': nothing says how large the variable '{missing[0]}' is; "
                "add it to what variable_sizes returns"
            )
        point = [known[name][:k] for name, k in self.point_variables.items()]
        interval = [np.tile(known[name], taus.size) for name, (_, taus) in self._variables.items()]
        return np.concatenate(point), np.concatenate([np.zeros(0), *interval])

    def unknown_columns(self, name: str, values: np.ndarray) -> np.ndarray:
        """Of the values of a motion by name, each (k, size), the columns that are unknowns of the scheme."""
        if name in ("q", "v", "a"):
            return values[:, self.eom.independent]
        if name == "u":
            return values[:, self.free_inputs]
        return values[:, [self.eom.rows[k] for k in self.rows]] if name == "lam" else values

    # --- the motion between the mesh points -----------------------------------------------
    def _symbolic_interval(self) -> tuple[Interval, list[ca.SX]]:
        """An interval of symbols, and these in order, with tau and the parameters last."""
        inner = self.interval_size + self.known_size
        sizes = {"w": self.point_size, "b": inner, "x": self.point_size, "t": 1, "h": 1, "s": 1}
        first, inner, last, start, length, tau = (ca.SX.sym(name, size) for name, size in sizes.items())
        return Interval(first, inner, last, start, length, self.eom.p), [
            first, inner, last, start, length, tau, self.eom.p,
        ]  # fmt: skip

    def _compiled(self, name: str, terms: Callable[[], tuple[list[ca.SX], Sequence[ca.SX]]]) -> ca.Function:
        """A function by its name, made of its arguments and results if there is none yet."""
        return self.constraints.cache.get_or_create(name, lambda: ca.Function(name, *terms()))

    @cached_property
    def _compiled_point(self) -> ca.Function:
        def terms() -> tuple[list[ca.SX], list[ca.SX]]:
            interval, symbols = self._symbolic_interval()
            return symbols, [ca.densify(x) for x in self.point(interval, symbols[5]).values]

        return self._compiled("point", terms)

    @cached_property
    def motion(self) -> Evaluator:
        """``(first, inner, last, start, length, tau, p) -> (t, q, v, a, z, lam, u, u̇)``, of all coordinates."""

        def terms() -> tuple[list[ca.SX], list[ca.SX]]:
            interval, symbols = self._symbolic_interval()
            at = self.expanded(self.at(interval, symbols[5]), self.eom.p)
            return symbols, [ca.densify(x) for x in at.values]

        return self.constraints.cache.get_or_create("motion", lambda: Evaluator(ca.Function("motion", *terms())))

    def at(self, interval: Interval, tau: Any) -> CollocationPoint:
        """:meth:`point`, by a function that is compiled once; at numbers it is evaluated once, too."""
        known = interval.points.get(tau) if isinstance(tau, float) else None
        if known is not None:
            return known
        i = interval
        point = CollocationPoint(*self._compiled_point(i.first, i.inner, i.last, i.start, i.length, tau, i.p))
        return interval.keep(tau, point) if isinstance(tau, float) else point

    def points(self, interval: Interval) -> list[CollocationPoint]:
        """States at the stages."""
        return [self.at(interval, float(tau)) for tau in self.stages]

    @property
    def integrates_accelerations(self) -> bool:
        """True if states are exact integrals of the polynomials through the accelerations at the stages."""
        return False

    @property
    def dense_rule(self) -> tuple[np.ndarray, np.ndarray]:
        """Points and weights of an integral that sees more of the states than the stages do, if there are more."""
        return self.stages, self.quadrature

    def start(self, interval: Interval) -> CollocationPoint:
        """State at the beginning."""
        return self.at(interval, 0.0)

    def end(self, interval: Interval) -> CollocationPoint:
        """State at the next mesh point; accelerations, multipliers and inputs as the interval ends."""
        inner, last = self.at(interval, 1.0), self.split_point(interval.last)
        return CollocationPoint(inner.t, last["q"], last["v"], inner.a, last["z"], inner.lam, inner.u, inner.u_rate)

    def inputs_at(self, interval: Interval, tau: Any) -> tuple[ca.SX, ca.SX]:
        """Inputs and their rates at a point of the interval."""
        parts = [(self._input_unknowns(interval), self.inputs)]
        if self.known:
            parts.append((self._known_values(interval), self.known_basis))
        values = self._in_order([x @ ca.SX(basis.weights(tau)) for x, basis in parts])
        slopes = self._in_order([x @ ca.SX(basis.rate_weights(tau)) for x, basis in parts])
        return values, slopes / interval.length

    def input_control_points(self, interval: Interval) -> tuple[ca.SX, ca.SX]:
        """Bernstein coefficients (n_u, k) of the inputs and (n_u, k - 1) of their rates, which enclose them."""
        points = self._input_unknowns(interval) @ ca.DM(self.inputs.control_points.T)
        count = points.size2()
        if self.known:
            weights = np.column_stack([self.known_basis.weights(tau) for tau in np.linspace(0, 1, count)])
            points = self._in_order([points, self._known_values(interval) @ ca.DM(weights)])
        return points, (count - 1) * (points[:, 1:] - points[:, :-1]) / interval.length

    def _known_values(self, interval: Interval) -> ca.SX:
        """Values of the known inputs at their points of an interval (n, k)."""
        values = interval.inner[self.interval_size :]
        return ca.reshape(values, len(self.known), self.known_basis.taus.size)

    def _in_order(self, parts: list[ca.SX]) -> ca.SX:
        """Rows of the unknown inputs and of the known ones as those of the mechanism."""
        places = [*self.free_inputs, *self.known]
        return ca.vertcat(*parts)[np.argsort(places).tolist(), :] if self.known else parts[0]

    def _input_unknowns(self, interval: Interval) -> ca.SX:
        """Unknowns of the inputs in an interval, those of its ends included (n_u, k)."""
        inner = self.split_interval(interval.inner)["u"]
        if not self.inputs.joined:
            return inner
        ends = [self.split_point(end)["u"] for end in (interval.first, interval.last)]
        return ca.horzcat(ends[0], inner, ends[1])

    def expanded(self, at: CollocationPoint, p: ca.SX, *, loads: bool = True) -> CollocationPoint:
        """Return a point with all coordinates of the mechanism and the multipliers of all rows.

        If rows are redundant the multipliers are those of least norm, as in all analyses; `loads` = False spares this.
        """
        if self.eom.explicit:
            q, v, a, lam = self.eom.expansion(*at.values[:-1], p)
            at = CollocationPoint(at.t, q, v, a, at.z, lam, at.u, at.u_rate)
        if loads and self.redundant:
            at = replace(at, lam=self.constraints.least_norm(at.t, at.q, at.lam, p))
        return at

    def full_multipliers(self, lam: ca.SX) -> ca.SX:
        """Multipliers of all rows of ``eom`` from those of :attr:`rows`; those of implied rows are zero."""
        full = ca.SX(self.eom.lam.numel(), 1)
        if self.rows:
            full[self.rows] = lam
        return full

    # --- equations in common --------------------------------------------------------------
    @cached_property
    def _residuals(self) -> ca.Function:
        eom, constraints = self.eom, self.constraints
        return self._compiled("residuals", lambda: ([*eom.symbols], [eom.motion, constraints.acceleration_residual]))

    @cached_property
    def _state_rates(self) -> ca.Function:
        return self._compiled("rates", lambda: ([*self.eom.symbols], [self.eom.z_rate]))

    def state_rates(self, at: CollocationPoint, p: ca.SX) -> ca.SX:
        """Rates of the first-order states at a point."""
        return self._state_rates(*at.values[:-1], p)

    def motion_rows(self, at: CollocationPoint, p: ca.SX, tau: float, scales: Scales) -> list[Rows]:
        """``M a + Phi_q^T lam - Q = 0`` and ``Phi_q a - gamma = 0`` at a point."""
        motion, acceleration = self._residuals(*at.values[:-1], p)
        units = tuple("N m" if angle else "N" for angle in scales.angles)
        # in angles alone a solver is led astray by large residuals that count little: angles jump within an interval
        size = scales.load * (1 if self.eom.is_chain else scales.steps**2)
        return [
            Rows(motion, self.eom.coordinate_names, tau, size, units, RowKind.MOTION),
            self.constraints.acceleration_rows(acceleration, tau, scales),
        ]

    def constraint_rows(
        self, q: ca.SX, v: ca.SX, t: ca.SX, p: ca.SX, tau: float, scales: Scales, z: ca.SX | None = None
    ) -> list[Rows]:
        """``Phi = 0`` and ``Phi_q v - nu = 0`` at a mesh point; with states z, which drivers may follow."""
        constraints, z = self.constraints, self._states(z)
        positions = constraints.position_rows(q, z, t, p, tau, scales)
        return [*positions, constraints.velocity_rows(q, v, z, t, p, tau, scales)]

    def corrections(
        self, t: ca.SX, q: ca.SX, p: ca.SX, mu_1: ca.SX, mu_2: ca.SX | None = None, z: ca.SX | None = None
    ) -> tuple[ca.SX, ca.SX | None]:
        """``W⁻¹ Phi_q^T mu_1`` of the position rows and ``W⁻¹ Phi_q^T mu_2`` of all rows, at a pose and states z."""
        _, position_jacobian, jacobian, _ = self.constraints.function(t, q, self._states(z), p)
        inverse = ca.diag(ca.DM(1 / self.weights))
        return inverse @ (position_jacobian.T @ mu_1), None if mu_2 is None else inverse @ (jacobian.T @ mu_2)

    def _states(self, z: ca.SX | None) -> ca.SX:
        """First-order states at a point; of a transcription that gives none, if no driver follows one."""
        if z is None and equations(self.eom.mechanism).followed_states:
            raise ModelError(
                f"transcription '{self.name}': drivers follow states; give z= to constraint_rows and corrections"
            )
        return ca.SX(self.eom.z.numel(), 1) if z is None else z

    def continuity_rows(self, residual: ca.SX, scales: Scales, *, velocities: bool = False) -> Rows:
        """Rows that carry the coordinates, or their rates, over to the next mesh point."""
        kind, per = (RowKind.VELOCITY_CONTINUITY, "/s") if velocities else (RowKind.CONTINUITY, "")
        units = tuple(("rad" if angle else "m") + per for angle in scales.angles)
        size = scales.v * scales.steps if velocities else scales.q
        return Rows(residual, self.eom.coordinate_names, 1.0, size, units, kind)

    def state_continuity_rows(self, residual: ca.SX, tau: float, scales: Scales) -> Rows:
        """Rows that carry the first-order states over to the next mesh point."""
        return self._state_rows(RowKind.CONTINUITY, residual, tau, scales.z)

    def state_rate_rows(self, residual: ca.SX, tau: float, scales: Scales) -> Rows:
        """Rows that hold the rates of the first-order states at a point."""
        return self._state_rows(RowKind.STATE_RATE, residual, tau, scales.z * scales.steps / scales.time)

    def _state_rows(self, kind: RowKind, residual: ca.SX, tau: float, scale: np.ndarray) -> Rows:
        names = tuple(z.label for z in self.eom.mechanism.states)
        return Rows(residual, names, tau, scale, ("in the state's unit",) * len(names), kind)
