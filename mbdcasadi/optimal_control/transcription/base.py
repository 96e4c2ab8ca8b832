"""What a transcription says of one interval of the mesh; everything else is the same for all of them.

A transcription names the unknowns of an interval, the equations between them,
and the polynomials by which the motion runs between the mesh points. The
program, the scaling, the guess, the refinement, the labels and the results
know no scheme by name.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from ..constraints import MotionConstraints
from ..nlp.rows import Rows
from ..nlp.scaling import Scales
from .controls import InputBasis
from .points import Interval, Point


class Transcription(ABC):
    """Base class of transcriptions.

    A subclass sets :attr:`name`, :attr:`order`, :attr:`stages`, :attr:`quadrature`
    and :attr:`block_parts`, and writes :meth:`input_points`, :meth:`point` and
    :meth:`equations`; ``optimize(problem, transcription=Subclass)`` uses it.

    Parameters
    ----------
    constraints : MotionConstraints
        Rows that hold all along.
    weights : numpy.ndarray
        Metric W in which states are moved onto the constraints, by independent coordinate (n,).
    inputs : InputBasis
        How the inputs vary.
    degree : int
        ``degree=`` of ``optimize``, for schemes that have a choice of stages.

    Attributes
    ----------
    eom : ReducedEquations
        Equations in the independent coordinates. Unknowns and rows of a scheme are in these.
    stages : numpy.ndarray
        Shares of the interval at which the equations of motion hold.
    quadrature : numpy.ndarray
        Weights of the stages in an integral over the interval.
    order : int
        Order of the states at the mesh points.
    block_parts : dict of str to (int, numpy.ndarray)
        Unknowns of the interval by name: rows, and the shares at which they
        live, one column each; ``nan`` for what lives nowhere.
    """

    name: ClassVar[str]
    stages: np.ndarray
    quadrature: np.ndarray
    order: int
    block_parts: dict[str, tuple[int, np.ndarray]]

    def __init__(self, constraints: MotionConstraints, weights: np.ndarray, inputs: InputBasis, degree: int):
        eom = self.eom = constraints.eom
        self.constraints = constraints
        self.weights = weights
        self.inputs = inputs
        self.node_parts = {
            "q": eom.q.numel(),
            "v": eom.q.numel(),
            "z": eom.z.numel(),
            "u": eom.u.numel() if inputs.joined else 0,
        }
        acceleration = constraints.jacobian @ eom.a - constraints.gamma
        self._motion = ca.Function("motion", [*eom.symbols], [eom.motion, acceleration, eom.z_rate])

    @property
    def rows(self) -> list[int]:
        """Rows of ``eom`` that are independent; others are implied by them."""
        return self.constraints.rows

    # --- unknowns -------------------------------------------------------------------------
    @cached_property
    def node_size(self) -> int:
        """Unknowns of a mesh point."""
        return sum(self.node_parts.values())

    @cached_property
    def block_size(self) -> int:
        """Unknowns of an interval alone."""
        return sum(size * shares.size for size, shares in self.block_parts.values())

    def node(self, values: Any) -> dict[str, Any]:
        """Unknowns of a mesh point by name."""
        found, first = {}, 0
        for name, size in self.node_parts.items():
            found[name] = values[first : first + size]
            first += size
        return found

    def block(self, values: Any) -> dict[str, Any]:
        """Unknowns of an interval by name, one column for each share at which they live."""
        found, first = {}, 0
        for name, (size, shares) in self.block_parts.items():
            count = size * shares.size
            found[name] = ca.reshape(values[first : first + count], size, shares.size)
            first += count
        return found

    def block_slice(self, name: str) -> slice:
        """Where a part of the block sits in it."""
        first = 0
        for key, (size, shares) in self.block_parts.items():
            if key == name:
                return slice(first, first + size * shares.size)
            first += size * shares.size
        raise KeyError(name)

    def sizes(self, scales: Scales) -> tuple[np.ndarray, np.ndarray]:
        """Typical sizes of the unknowns of a mesh point and of an interval."""
        mu_1, mu_2 = self.constraints.corrections(scales, self.weights)
        known = {
            "a": scales.a,
            "lam": scales.lam[self.rows],
            "rate": scales.z / scales.time,
            "u": scales.u,
            "mu_1": mu_1,
            "mu_2": mu_2,
        }
        node = [scales.q, scales.v, scales.z, scales.u if self.inputs.joined else np.zeros(0)]
        block = [np.tile(known[name], shares.size) for name, (_, shares) in self.block_parts.items()]
        return np.concatenate(node), np.concatenate([np.zeros(0), *block])

    # --- the motion between the mesh points ---------------------------------------------------
    @staticmethod
    @abstractmethod
    def input_points(degree: int) -> tuple[tuple[float, ...], bool]:
        """Where the values of polynomial inputs are given: shares inside the interval, and whether at both ends too."""

    @abstractmethod
    def point(self, interval: Interval, share: Any) -> Point:
        """State at a share of the interval by the polynomials of the scheme."""

    @abstractmethod
    def equations(self, interval: Interval, scales: Scales) -> list[Rows]:
        """Equations of motion in the interval, and the step to the next mesh point."""

    def _unknown_interval(self) -> tuple[Interval, list[ca.SX]]:
        """An interval of symbols, and these in order, with the share and the parameters last."""
        sizes = {"w": self.node_size, "b": self.block_size, "x": self.node_size, "t": 1, "h": 1, "s": 1}
        node, block, next_node, start, length, share = (ca.SX.sym(name, size) for name, size in sizes.items())
        interval = Interval(node, block, next_node, start, length, self.eom.p)
        return interval, [node, block, next_node, start, length, share, self.eom.p]

    @cached_property
    def _compiled_point(self) -> ca.Function:
        interval, symbols = self._unknown_interval()
        return ca.Function("point", symbols, [ca.densify(x) for x in self.point(interval, symbols[5]).arguments])

    @cached_property
    def motion(self) -> ca.Function:
        """``(node, block, next node, start, length, share, p) -> (t, q, v, a, z, lam, u, u̇)``, of all coordinates."""
        interval, symbols = self._unknown_interval()
        at = self.expanded(self.at(interval, symbols[5]), self.eom.p)
        return ca.Function("motion", symbols, [ca.densify(x) for x in at.arguments])

    def at(self, interval: Interval, share: Any) -> Point:
        """:meth:`point`, by a function that is compiled once; numbers as shares are asked for once, too."""
        known = interval.points.get(share) if isinstance(share, float) else None
        if known is not None:
            return known
        i = interval
        found = Point(*self._compiled_point(i.node, i.block, i.next_node, i.start, i.length, share, i.p))
        if isinstance(share, float):
            interval.points[share] = found
        return found

    def points(self, interval: Interval) -> list[Point]:
        """States at the stages."""
        return [self.at(interval, float(share)) for share in self.stages]

    def start(self, interval: Interval) -> Point:
        """State at the beginning."""
        return self.at(interval, 0.0)

    def end(self, interval: Interval) -> Point:
        """State at the next mesh point; accelerations, multipliers and inputs as the interval ends."""
        inner, node = self.at(interval, 1.0), self.node(interval.next_node)
        return Point(inner.t, node["q"], node["v"], inner.a, node["z"], inner.lam, inner.u, inner.u_rate)

    def _inputs(self, interval: Interval, share: Any) -> tuple[ca.SX, ca.SX]:
        """Inputs and their rates at a share of the interval."""
        values = self.block(interval.block)["u"]
        if self.inputs.joined:
            ends = [self.node(node)["u"] for node in (interval.node, interval.next_node)]
            values = ca.horzcat(ends[0], values, ends[1])
        weights, slopes = (ca.SX(w(share)) for w in (self.inputs.weights, self.inputs.rate_weights))
        return values @ weights, values @ slopes / interval.length

    def own(self, name: str, values: np.ndarray) -> np.ndarray:
        """Of the values of a motion by name, each (k, size), the columns that are unknowns here."""
        if name in ("q", "v", "a"):
            return values[:, self.eom.independent]
        return values[:, [self.eom.rows[k] for k in self.rows]] if name == "lam" else values

    def expanded(self, at: Point, p: ca.SX) -> Point:
        """The same point with all coordinates of the mechanism and the multipliers of all rows."""
        if not self.eom.explicit:
            return at
        q, v, a, lam = self.eom.expansion(*at.arguments[:-1], p)
        return Point(at.t, q, v, a, at.z, lam, at.u, at.u_rate)

    def full_multipliers(self, lam: ca.SX) -> ca.SX:
        """Multipliers of all rows of ``eom``; those of implied rows are zero."""
        full = ca.SX(self.eom.lam.numel(), 1)
        if self.rows:
            full[self.rows] = lam
        return full

    # --- equations in common --------------------------------------------------------------------
    def motion_rows(self, at: Point, p: ca.SX, share: float, scales: Scales) -> list[Rows]:
        """``M a + Phi_q^T lam - Q = 0`` and ``Phi_q a - gamma = 0`` at a point."""
        motion, acceleration, _ = self._motion(at.t, at.q, at.v, at.a, at.z, at.lam, at.u, p)
        eom = self.eom
        return [
            Rows(
                motion,
                tuple(f"equation of motion of {name}" for name in eom.coordinate_names),
                share,
                scales.load * scales.steps**2,
                tuple("N m" if angle else "N" for angle in scales.angles),
            ),
            self.constraints.acceleration_rows(acceleration, share, scales),
        ]

    def constraint_rows(self, q: ca.SX, v: ca.SX, t: ca.SX, p: ca.SX, share: float, scales: Scales) -> list[Rows]:
        """``Phi = 0`` and ``Phi_q v - nu = 0`` at a mesh point."""
        constraints = self.constraints
        return [
            constraints.position_rows(q, t, p, share, scales),
            constraints.velocity_rows(q, v, t, p, share, scales),
        ]

    def start_rows(self, interval: Interval, scales: Scales) -> list[Rows]:
        """Equations that hold at the start of the motion alone, besides the constraints there."""
        return []

    def _continuity(self, residual: ca.SX, kind: str, scale: np.ndarray, scales: Scales) -> Rows:
        """Rows that carry the coordinates or their rates over to the next mesh point."""
        what, per = ("continuity of", "") if kind == "q" else ("continuity of the velocity of", "/s")
        return Rows(
            residual,
            tuple(f"{what} {name}" for name in self.eom.coordinate_names),
            1.0,
            scale,
            tuple(("rad" if angle else "m") + per for angle in scales.angles),
        )

    def _state_rows(self, residual: ca.SX, what: str, share: float, scale: np.ndarray) -> Rows:
        """Rows of first-order states."""
        names = tuple(f"{what} {z.label}" for z in self.eom.mechanism.states)
        return Rows(residual, names, share, scale, tuple("in the state's unit" for _ in names))
