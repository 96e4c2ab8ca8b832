"""Rosenbrock: linearly implicit, for stiff motion at tight tolerance."""

from __future__ import annotations

from typing import ClassVar

from .base import Integrator


class Rosenbrock(Integrator):
    """Rosenbrock–Wanner method of order 5(4), L-stable: for stiff motion at tight tolerance.

    A one-step method: it starts without the small steps of a multistep method,
    which pays where a motion is cut into many pieces. Parameters are those of
    :class:`Integrator`.

    References
    ----------
    Hairer and Wanner, *Solving Ordinary Differential Equations II*, 1996, section IV.7.
    """

    name: ClassVar[str] = "rosenbrock"
    plugin: ClassVar[str] = "rosenbrock"
    stops_by_input: ClassVar[bool] = False
