"""Laws of springs and dampers from measured data."""

from __future__ import annotations

from typing import Any

import casadi as ca

from ..geometry.splines import spline, spline_integral
from ..immutable import Immutable
from ..quantities import quantity


class DataLaw(Immutable):
    """Force over displacement, and over its rate, through data points: a ``law=`` for a TSDA or RSDA.

    ``f = s(x - x_0) + c ẋ``, or with a second curve ``s(x - x_0) + d(ẋ)``.

    Parameters
    ----------
    displacements, forces : sequence of float
        Points of the spring: length less `free` (m) and tension (N), or angle (rad) and couple (N m).
    rates, damping_forces : sequence of float, optional
        Points of the damper: rate (m/s, rad/s) and force.
    damping : float or expression, default 0
        Linear damping besides, N s/m.
    free : float or expression, default 0
        x_0, the length (or angle) from which the displacements count.
    kind : {"monotone", "cubic", "linear"}, default "monotone"
        Of the curves; see :func:`spline`. Monotone ones do not overshoot the data.
    outside : {"linear", "error", "constant"}, default "linear"
        What holds beyond the data.

    Examples
    --------
    A progressive spring of free length 0.3 m::

        TSDA("spring", a, b, law=DataLaw([-0.05, 0, 0.05], [-400, 0, 150], free=0.3))
    """

    def __init__(
        self,
        displacements: Any,
        forces: Any,
        rates: Any = None,
        damping_forces: Any = None,
        damping: Any = 0.0,
        free: Any = 0.0,
        kind: str = "monotone",
        outside: str = "linear",
    ):
        what = "DataLaw"
        self._curve = displacements, forces, kind, outside
        self._damper = None if rates is None else (rates, damping_forces, kind, outside)
        self.damping = quantity(damping, what, "damping")
        self.free = quantity(free, what, "free")
        self(ca.SX.sym("x"), ca.SX.sym("rate"))  # raises for data that make no curve

    def __call__(self, length: ca.SX, rate: ca.SX) -> ca.SX:
        """Tension (N) or couple (N m)."""
        force = spline(length - self.free, *self._curve) + self.damping * rate
        return force if self._damper is None else force + spline(rate, *self._damper)

    def potential(self, length: ca.SX) -> ca.SX:
        """Energy of the spring, zero at the first point of the data, J."""
        return spline_integral(length - self.free, *self._curve)
