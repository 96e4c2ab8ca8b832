"""Forces and constraints that are linear in the coordinates of a tree, their rates and inputs: found by values."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..model.rates import time_derivative
from ..model.symbols import role_of, symbols_of
from ..numerics.graph import operations
from ..numerics.operations import BENDING, JUMPING
from ..numerics.tolerances import ACCURACY, NEGLIGIBLE
from .joint_tree import JointTree


@dataclass(frozen=True, eq=False)
class LinearLaw:
    """``f = f_0 - k e - c ė + Σ g_i u_i`` along a coordinate ``e``.

    Attributes
    ----------
    constant, stiffness, damping : float
        f_0, k, c.
    gains : numpy.ndarray
        g, in the order of the inputs of the mechanism.
    """

    constant: float
    stiffness: float
    damping: float
    gains: np.ndarray

    @property
    def is_passive(self) -> bool:
        """True if it takes no input."""
        return not np.any(self.gains)


class Samples:
    """Values of expressions in random states of a tree, within 1 rad and 1 m of its pose.

    Parameters
    ----------
    tree : JointTree
        It.
    """

    def __init__(self, tree: JointTree):
        mechanism = tree.mechanism
        random = np.random.default_rng(0)
        many, inputs = tree.q.numel(), len(mechanism.inputs)
        #: more than there are unknowns in any law
        self.count = 2 * (many + inputs + 3)
        self.moved, self._v = random.uniform(-1, 1, (2, self.count, many))
        self._u = random.uniform(-1, 1, (self.count, inputs))
        self._q = self.moved + np.array([joint.reference for joint in tree.joints])
        rates = ca.SX.sym("v", many)
        move = ca.Function("move", [tree.q, rates], [tree.positions, ca.jtimes(tree.positions, tree.q, rates)])
        parameters = np.repeat(np.reshape(tree.state.parameters, (-1, 1)), self.count, axis=1)
        self._values = [*move(self._q.T, self._v.T), self._u.T, parameters]
        bodies = mechanism.bodies
        self._symbols = [
            ca.vertcat(*[body.q for body in bodies]), ca.vertcat(*[body.v for body in bodies]),
            ca.vertcat(ca.SX(0, 1), *mechanism.inputs), ca.vertcat(ca.SX(0, 1), *mechanism.parameters),
        ]  # fmt: skip

    def of(self, *expressions: Any) -> np.ndarray | None:
        """Values of expressions in all states (k, samples); None if they hold time, states or reactions."""
        column = ca.vertcat(*map(ca.SX, expressions))
        kinds = [None if role is None else role.kind for role in map(role_of, symbols_of(column))]
        if not set(kinds) <= {"position", "velocity", "input", "parameter"}:
            return None
        return np.asarray(ca.Function("values", self._symbols, [column])(*self._values).full())

    def factors(self, expression: ca.SX) -> np.ndarray | None:
        """Factors (n,) of the coordinates in an expression that is linear in them; None if it is not."""
        values = self.of(expression)
        fitted = None if values is None else _fitted(np.column_stack([np.ones(self.count), self.moved]), values[0])
        return None if fitted is None else fitted[1:]

    def law(self, force: ca.SX, along: ca.SX | np.ndarray) -> LinearLaw | None:
        """Return the law of a force along an expression, or the sum of coordinates with factors (n,); None without."""
        if any(operations(force, BENDING | JUMPING)):
            return None
        values = self.of(force)
        if isinstance(along, np.ndarray):
            course: np.ndarray | None = np.array([self._q @ along, self._v @ along])
        else:
            course = self.of(along, time_derivative(along))
        if values is None or course is None:
            return None
        fitted = _fitted(np.column_stack([np.ones(self.count), -course[0], -course[1], self._u]), values[0])
        return None if fitted is None else LinearLaw(float(fitted[0]), float(fitted[1]), float(fitted[2]), fitted[3:])


def _fitted(basis: np.ndarray, values: np.ndarray) -> np.ndarray | None:
    """Least-squares factors of a basis that gives values up to rounding, those that count for nothing zero; or None."""
    factors: np.ndarray = np.linalg.lstsq(basis, values, rcond=None)[0]
    size = float(np.max(np.abs(values)))
    if np.max(np.abs(basis @ factors - values)) > NEGLIGIBLE * size:
        return None
    shares = np.abs(factors) * np.max(np.abs(basis), axis=0)
    rounded = np.array([float(f"{factor:.12g}") for factor in factors])
    factors = np.where(np.abs(rounded - factors) < ACCURACY * np.abs(factors), rounded, factors)
    return np.where(shares > NEGLIGIBLE * size, factors, 0.0)
