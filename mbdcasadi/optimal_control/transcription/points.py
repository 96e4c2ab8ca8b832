"""An interval of the mesh in symbols, and points on it."""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi as ca


@dataclass(frozen=True)
class Point:
    """Everything that an expression of the model may hold, at one point of an interval.

    Of the independent coordinates and the rows that are left, or of all, see ``Transcription.expanded``.
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
    def arguments(self) -> tuple[ca.SX, ...]:
        """All of them in order."""
        return self.t, self.q, self.v, self.a, self.z, self.lam, self.u, self.u_rate


@dataclass(frozen=True)
class Interval:
    """Unknowns of one interval as expressions, in physical units.

    Attributes
    ----------
    node, next_node : casadi.SX
        At the mesh points before and after.
    block : casadi.SX
        Those of the interval alone.
    start, length : casadi.SX
        Time at which it begins, and its length, s.
    p : casadi.SX
        Parameters of the mechanism.
    """

    node: ca.SX
    block: ca.SX
    next_node: ca.SX
    start: ca.SX
    length: ca.SX
    p: ca.SX
    #: points that were asked for, by share
    points: dict[float, Point] = field(default_factory=dict, compare=False, repr=False)
