"""Weight."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca

from ..bodies import Body
from ..element import Element
from ..quantities import vector2


class Gravity(Element):
    """Weight of every body: ``δW = m g · δr``; potential ``-m g · r``.

    Parameters
    ----------
    acceleration : (float, float), default (0, -9.81)
        Free-fall acceleration g, global axes, m/s²; may hold parameters.
    name : str, default "gravity"
        Its name.

    References
    ----------
    Haug 1989, section 6.1.
    """

    kind = "force"
    external = True

    def __init__(self, acceleration: Any = (0.0, -9.81), name: str = "gravity"):
        super().__init__(name)
        self.acceleration = vector2(acceleration, self.description, "acceleration")

    def acting_on(self, bodies: Sequence[Body]) -> Element:
        return _Weight(self, tuple(bodies))


class _Weight(Element):
    """Gravity with the bodies of a mechanism known."""

    kind = "force"
    external = True

    def __init__(self, gravity: Gravity, bodies: tuple[Body, ...]):
        super().__init__(gravity.name)
        loaded = [body for body in bodies if isinstance(body.mass, ca.SX) or body.mass != 0]
        self.virtual_work = tuple((body.position, body.mass * gravity.acceleration) for body in loaded)
        self.potential = -sum((ca.dot(force, r) for r, force in self.virtual_work), ca.SX(0))
        self.__dict__["bodies"] = bodies
