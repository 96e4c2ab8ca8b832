"""Clutches between two shafts, exact: they hold them together, or let them turn apart."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from ...errors import ModelError
from ...numerics.lazy import cached_property
from ..bodies import Body, as_body
from ..element import ConstraintElement, Element
from ..quantities import known_value
from ..rates import time_derivative
from ..switching import Switching
from ..symbols import Scalar, check_name


class ShaftClutch(Switching, ConstraintElement):
    """Base class of clutches: ``dphi_b/dt = dphi_a/dt`` (1 row, rad/s) while it holds.

    Attributes
    ----------
    a, b : Body
        The shafts.
    sliding_speed : casadi.SX
        Speed of b relative to a, rad/s.
    torque : casadi.SX
        Couple on b, N m; the opposite acts on a.
    """

    kind = "clutch"
    switches_modes = True
    units = ("rad/s", "N m")
    instead = "take a Torque that depends on the speeds of the shafts"

    def __init__(self, name: str, a: Body, b: Body):
        self.name = check_name(name, type(self).__name__)
        self.a, self.b = (as_body(body, self.description, which) for body, which in ((a, "a"), (b, "b")))
        if self.a is self.b:
            raise ModelError(f"{self.description} connects body '{self.a.name}' with itself; it must touch two bodies")
        self.turned = self.b.phi - self.a.phi
        self.sliding_speed = time_derivative(self.turned)
        markers = self.a.at(0, 0), self.b.at(0, 0)
        super().__init__(name, ca.SX(0, 1), (), markers, velocity_rows=self.sliding_speed)

    @cached_property
    def torque(self) -> ca.SX:
        """Couple on b, N m."""
        return -self.multipliers

    def couple(self, mode: str) -> Any:
        """Couple on b, N m, in a mode in which it does not hold."""
        raise NotImplementedError

    def in_mode(self, mode: str) -> Element:
        """Return the clutch in one mode: a row while it holds, else a couple."""
        if mode == "sticks":
            return ConstraintElement(self.name, self.rows, (), self.markers, velocity_rows=self.velocity_rows)
        return _Slipping(self, ca.SX(self.couple(mode)))


class _Slipping(ConstraintElement):
    """A clutch that does not hold, with the couple that it transmits."""

    kind = "clutch"

    def __init__(self, clutch: ShaftClutch, couple: ca.SX):
        super().__init__(clutch.name, ca.SX(0, 1), (), clutch.markers)
        self.force, self.limits = couple, clutch.limits
        if not couple.is_zero():
            self.virtual_work = ((clutch.turned, couple),)


class OneWayClutch(ShaftClutch):
    """Free wheel, backstop, ratchet with fine teeth: b may turn faster than a, never slower: ``ω_b >= ω_a``.

    It holds as long as a drives b, ``T >= 0``, and lets b overrun else; there is no torque then. For shafts that turn
    clockwise exchange the two. On the ground it is a backstop.

    Parameters
    ----------
    name : str
        Its name.
    a, b : Body
        The shaft that drives, and the one that is driven.

    Attributes
    ----------
    sliding_speed : casadi.SX
        Speed at which b overruns a, rad/s.
    torque : casadi.SX
        Couple on b, N m, never negative.

    Raises
    ------
    ModelError
        For what is no body, and twice the same body.

    Notes
    -----
    ``simulate`` finds the instants, exactly and of any number at once; the events ``"… engages"`` and ``"… overruns"``
    are in ``motion.events``. An impact that would turn b slower than a is an error.

    Examples
    --------
    The hub of a bicycle::

        free = mbd.OneWayClutch("free wheel", sprocket, hub)
    """

    kind = "one-way clutch"

    @property
    def limits_of_pull(self) -> tuple[Any, Any]:
        """None if b is pulled ahead, and any if it is held back."""
        return 0.0, np.inf

    @property
    def event_names(self) -> tuple[str, str]:
        """Names of the events at which it begins to hold, and to let go."""
        return f"{self.name} engages", f"{self.name} overruns"

    def couple(self, mode: str) -> Any:
        """None."""
        return 0.0


class Clutch(ShaftClutch):
    """Friction clutch or brake between two shafts: it holds up to its capacity M, and slips with it.

    ``|T| <= M`` while the shafts turn together, ``T = -M sign(ω_b - ω_a)`` if not.

    Parameters
    ----------
    name : str
        Its name.
    a, b : Body
        The shafts; the ground makes it a brake.
    capacity : float or expression
        M, N m, at least 0; in time, parameters, inputs and states, so that it is opened and closed.
    static_capacity : float or expression, optional
        Couple up to which it holds, N m; by default the capacity.

    Attributes
    ----------
    sliding_speed : casadi.SX
        Speed of b relative to a, rad/s.
    torque : casadi.SX
        Couple on b, N m; the opposite acts on a.

    Raises
    ------
    ModelError
        For what is no body, twice the same body, a negative capacity, a static one below it.

    Examples
    --------
    A clutch that is closed within a second::

        clutch = mbd.Clutch("clutch", engine, gearbox, 120 * mbd.step(mbd.t, 0, 0, 1, 1))
    """

    def __init__(self, name: str, a: Body, b: Body, capacity: Scalar, static_capacity: Scalar | None = None):
        super().__init__(name, a, b)
        self.capacity = self.read(capacity, "capacity", at_least=0.0)
        static = capacity if static_capacity is None else static_capacity
        self.static_capacity = self.read(static, "static_capacity", at_least=0.0)
        below = known_value(ca.SX(self.static_capacity) - self.capacity)
        if below is not None and below < 0:
            raise ModelError(
                f"{self.description}: static_capacity {self.static_capacity} is below the capacity {self.capacity}"
            )
        self.read(ca.SX(self.static_capacity) - self.capacity, "static_capacity - capacity", at_least=0.0)

    @property
    def falls(self) -> bool:
        """True if it may slip with less than it holds."""
        return known_value(ca.SX(self.static_capacity) - self.capacity) != 0

    @property
    def sticking_limit(self) -> ca.SX:
        """Largest couple while it holds, N m."""
        return ca.SX(self.static_capacity)

    def couple(self, mode: str) -> Any:
        """Couple on b, N m: against its sliding, or what keeps it at its limit."""
        if mode == "free":
            return 0.0
        size = self.static_capacity if mode.startswith("pulled") else self.capacity
        return size if mode.endswith("back") else -ca.SX(size)
