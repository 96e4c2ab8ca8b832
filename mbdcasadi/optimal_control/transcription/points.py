"""Unknowns of one interval of the mesh as expressions, and the state at a point of it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import casadi as ca

#: Place of the multipliers among the values of a point.
MULTIPLIERS = 5


@dataclass(frozen=True)
class CollocationPoint:
    """State at one point of an interval: whatever an expression of the model may contain.

    Of the independent coordinates and the remaining rows, or of all of them, see :meth:`Transcription.expanded`.

    Attributes
    ----------
    t : casadi.SX
        Time, s.
    q, v, a : casadi.SX
        Coordinates, their rates and accelerations (n,).
    z : casadi.SX
        First-order states.
    lam : casadi.SX
        Multipliers (m,).
    u, u_rate : casadi.SX
        Inputs and their rates (n_u,).
    """

    t: ca.SX
    q: ca.SX
    v: ca.SX
    a: ca.SX
    z: ca.SX
    lam: ca.SX
    u: ca.SX
    u_rate: ca.SX

    @property
    def values(self) -> tuple[ca.SX, ...]:
        """All of them, in the order above."""
        return self.t, self.q, self.v, self.a, self.z, self.lam, self.u, self.u_rate


@dataclass(frozen=True)
class Interval:
    """Unknowns of one interval of the mesh as expressions, in physical units.

    Attributes
    ----------
    first, last : casadi.SX
        Variables of the mesh points at its ends, see :meth:`Transcription.split_point`.
    inner : casadi.SX
        Variables of the interval alone, see :meth:`Transcription.split_interval`, then values of known inputs.
    start, length : casadi.SX
        Time at which it begins, and its length, s.
    p : casadi.SX
        Parameters of the mechanism.
    """

    first: ca.SX
    inner: ca.SX
    last: ca.SX
    start: ca.SX
    length: ca.SX
    p: ca.SX
    #: points that were asked for, by tau
    points: dict[float, CollocationPoint] = field(default_factory=dict, compare=False, repr=False)
    #: symbols that stand for values at these points, with their expressions; None if the values are expressions
    symbols: list[tuple[ca.SX, ca.SX]] | None = field(default=None, compare=False, repr=False)

    def with_symbols(self) -> Interval:
        """Return the same interval, at whose points symbols stand for the values."""
        return replace(self, points={}, symbols=[])

    def keep(self, tau: float, point: CollocationPoint) -> CollocationPoint:
        """Keep a point, and return it; with symbols in place of its values if they are wanted."""
        if self.symbols is not None:
            point = CollocationPoint(*map(self._symbol, point.values))
        self.points[tau] = point
        return point

    def _symbol(self, value: ca.SX) -> ca.SX:
        """The symbol that stands for a value; numbers and symbols stand for themselves."""
        if self.symbols is None or value.is_constant() or value.is_valid_input():
            return value
        symbol = ca.SX.sym("y", value.numel())
        self.symbols.append((symbol, value))
        return symbol

    def states(self) -> tuple[ca.SX, ca.SX]:
        """Return the symbols that stand for values, and these values in the unknowns alone."""
        if not self.symbols:
            return ca.SX(0, 1), ca.SX(0, 1)
        symbols, values = map(list, zip(*self.symbols, strict=True))
        if ca.depends_on(ca.vertcat(*values), ca.vertcat(*symbols)):
            # an interval of a scheme's own may begin at a point of another one
            values = ca.substitute_inplace(symbols, values, [], False)[0]
        return ca.vertcat(*symbols), ca.vertcat(*values)
