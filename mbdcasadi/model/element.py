"""What every model element offers; the equations collect it and never ask what an element is.

A class of the user's own with these attributes is a full citizen.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from types import MappingProxyType
from typing import Any, ClassVar

import casadi as ca

from ..errors import ExpressionError, ModelError
from .bodies import Body, Marker, ground
from .immutable import HoldsSymbols, Immutable
from .quantities import Limit
from .smoothing import Smoothing
from .symbols import check_name, register, role_of, symbols_of
from .validity import Monitor


class Element(Immutable, HoldsSymbols):
    """Base class of joints, drivers and forces: nothing offered, everything may be overridden.

    Attributes
    ----------
    name : str
        Its name, one of a kind in a mechanism.
    markers : tuple of Marker
        Where it sits.
    rows : casadi.SX
        ``Phi`` (k,): position constraints in coordinates and time.
    velocity_rows : casadi.SX
        Constraints (k,) linear in the velocities, that no position constraint implies.
    row_labels : tuple of str
        What each row holds ("x", "angle"), position rows first.
    multipliers : casadi.SX
        ``lam``, one for each row, position rows first.
    coordinates : tuple of Coordinate
        Extra coordinates without inertia.
    virtual_work : tuple of (displacement, force) pairs
        ``δW = force · δdisplacement``; both expressions of the same size.
    rates : dict of StateVariable to casadi.SX
        Rates of first-order states that the element owns.
    potential : casadi.SX
        Potential energy, J, of forces that have one.
    limits : tuple of Limit
        What its quantities must keep to at any value of the parameters.
    monitors : tuple of Monitor
        What must hold along a motion for the element to mean what it says (a cam that only presses).
    smoothings : tuple of Smoothing
        What changes within a short time, so that a simulation tells where its steps jump over it; with a scalar
        ``gap`` besides, a simulation does not pass through where it is closed for a short time.
    """

    kind: ClassVar[str] = "element"

    markers: tuple[Marker, ...] = ()
    rows: ca.SX = ca.SX(0, 1)
    velocity_rows: ca.SX = ca.SX(0, 1)
    row_labels: tuple[str, ...] = ()
    multipliers: ca.SX = ca.SX(0, 1)
    coordinates: tuple = ()
    virtual_work: tuple[tuple[ca.SX, ca.SX], ...] = ()
    rates: Mapping[Any, ca.SX] = MappingProxyType({})
    potential: ca.SX = ca.SX(0)
    limits: tuple[Limit, ...] = ()
    monitors: tuple[Monitor, ...] = ()

    def __init__(self, name: str):
        self.name = check_name(name, type(self).__name__)

    @property
    def description(self) -> str:
        """The element in words, as messages name it."""
        return f"{self.kind} '{self.name}'"

    @property
    def smoothings(self) -> tuple[Smoothing, ...]:
        """What changes within a short time."""
        return ()

    @cached_property
    def bodies(self) -> tuple[Body, ...]:
        """Bodies it acts on, the ground included where it takes part."""
        return tuple(dict.fromkeys(marker.body for marker in self.markers))

    def expressions(self) -> list[ca.SX]:
        """Every expression that enters the equations, to look for stray symbols."""
        pairs = [ca.SX(part) for pair in self.virtual_work for part in pair]
        return [self.rows, self.velocity_rows, *pairs, ca.SX(self.potential), *self.rates.values()]

    def acting_on(self, bodies: Sequence[Body]) -> Element:
        """The element with the bodies of the mechanism known to it (gravity acts on all of them)."""
        return self

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.name!r})"


def owners(expression: Any) -> tuple[Body, ...]:
    """Bodies whose coordinates or velocities occur in an expression."""
    roles = [role_of(symbol) for symbol in symbols_of(expression)]
    return tuple(dict.fromkeys(role.owner for role in roles if role is not None and isinstance(role.owner, Body)))


def holds_coordinates(expression: Any) -> bool:
    """Whether a coordinate of a body, or one without inertia, occurs in an expression."""
    roles = (role_of(symbol) for symbol in symbols_of(expression))
    return any(role is not None and role.kind == "position" for role in roles)


#: What an expression in coordinates, parameters and time does not hold.
BEYOND_COORDINATES = ("velocity", "acceleration", "multiplier", "input", "state")


def refuse_kinds(expression: Any, kinds: Sequence[str], what: str, remedy: str) -> None:
    """Raise where an expression depends on symbols of the kinds that are not allowed."""
    for symbol in symbols_of(expression):
        role = role_of(symbol)
        if role is not None and role.kind in kinds:
            raise ExpressionError(f"{what} depends on the {role.kind} '{role.label}'; {remedy}")


class ConstraintElement(Element):
    """Base class of elements with constraint rows: multipliers, and reactions read off them.

    Parameters
    ----------
    name : str
        Its name.
    rows : casadi.SX
        ``Phi`` (k,).
    row_labels : tuple of str
        One for each row; () for a single row that needs no label of its own.
    markers : tuple of Marker
        Where it sits.
    velocity_rows : casadi.SX, optional
        Rows at velocity level.

    Attributes
    ----------
    leans_on_ground : bool
        Whether the ground takes part in a constraint between two moving bodies.
        It does where the row changes when both turn as one, as that of a
        constraint along a global axis does: then what it exerts on them does
        not balance, and something that does not turn must hold the rest.
    """

    leans_on_ground: bool = False

    def __init__(
        self,
        name: str,
        rows: ca.SX,
        row_labels: tuple[str, ...] = (),
        markers: tuple[Marker, ...] = (),
        velocity_rows: ca.SX | None = None,
    ):
        super().__init__(name)
        self.rows = ca.vec(rows)
        others = ("velocity", "acceleration", "input", "state")
        refuse_kinds(
            self.rows, others, self.description, "position constraints hold coordinates, parameters and time only"
        )
        if velocity_rows is not None:
            self.velocity_rows = ca.vec(velocity_rows)
        self.row_labels = row_labels
        self.markers = markers
        count = self.rows.numel() + self.velocity_rows.numel()
        self.multipliers = ca.SX.sym(f"{name}.lam", count)
        self._roles = tuple(
            register(self.multipliers[k], "multiplier", f"{name}.lam" + (f"[{k}]" if count > 1 else ""), self)
            for k in range(count)
        )

    @property
    def row_names(self) -> tuple[str, ...]:
        """Name of each row: the element and what the row holds."""
        labels = self.row_labels or tuple(str(k) for k in range(self.multipliers.numel()))
        return (self.name,) if len(labels) == 1 and not self.row_labels else tuple(f"{self.name}.{x}" for x in labels)

    @cached_property
    def bodies(self) -> tuple[Body, ...]:
        found = dict.fromkeys(marker.body for marker in self.markers)
        found.update(dict.fromkeys(owners(ca.vertcat(self.rows, self.velocity_rows))))
        if len(found) == 1 or not self.markers or self.leans_on_ground:
            found[ground] = None
        return tuple(found)

    def marker_on(self, body: Body) -> Marker:
        """Marker on a body; its centre of mass (the origin, on the ground) where the element has none there."""
        own = next((marker for marker in self.markers if marker.body is body), None)
        return own if own is not None else Marker(body, ca.SX(2, 1), ca.SX(0))

    def reaction_on(self, body: Body) -> Reaction:
        """Return what the element exerts on a body.

        Parameters
        ----------
        body : Body
            A body that it connects, or ``ground``.

        Returns
        -------
        Reaction
            ``.force``, ``.torque``, ``.force_in_joint`` as expressions.
        """
        if body not in self.bodies:
            names = ", ".join(f"'{b.name}'" for b in self.bodies)
            name = body.name if isinstance(body, Body) else repr(body)
            raise ModelError(f"{self.description} does not act on '{name}'; it acts on {names}")
        return Reaction(self, body)


class Reaction:
    """Force and couple that a constraint exerts on a body, as expressions in the multipliers.

    ``F = -Phi_r^T lam`` and, about the joint marker P on that body,
    ``T = -(Phi_phi^T - s'^T B^T Phi_r^T) lam``. On the ground the reaction is
    what balances those on the moving bodies, since a joint has no mass.

    Attributes
    ----------
    force : casadi.SX
        (2,), global axes, N.
    torque : casadi.SX
        Scalar, about the joint marker on the body, N m.
    force_in_joint : casadi.SX
        (2,), in the axes of the body's own marker, N: ``C^T A^T F``.

    References
    ----------
    Haug 1989, section 6.6 (constraint reaction forces).
    """

    def __init__(self, element: ConstraintElement, body: Body):
        self.element = element
        self.body = body
        self.marker = element.marker_on(body)

    def _on_moving(self, body: Body) -> ca.SX:
        """Generalised reaction ``-Phi_q^T lam`` on ``[x, y, phi]`` of a body."""
        element = self.element
        count = element.rows.numel()
        load = ca.jtimes(element.rows, body.q, element.multipliers[:count], True) if count else ca.SX(3, 1)
        if element.velocity_rows.numel():
            load += ca.jtimes(element.velocity_rows, body.v, element.multipliers[count:], True)
        return -load

    @cached_property
    def _wrench(self) -> tuple[ca.SX, ca.SX]:
        """Force, and couple about the global origin (ground) or the centre of mass."""
        if not self.body.is_ground:
            load = self._on_moving(self.body)
            return load[:2], load[2]
        force, couple = ca.SX(2, 1), ca.SX(0)
        for body in self.element.bodies:
            if not body.is_ground:
                load = self._on_moving(body)
                force -= load[:2]
                couple -= load[2] + cross(body.position, load[:2])
        return force, couple

    @property
    def force(self) -> ca.SX:
        """Force on the body (2,), global axes, N."""
        return self._wrench[0]

    @cached_property
    def torque(self) -> ca.SX:
        """Couple on the body about its joint marker, N m."""
        force, couple = self._wrench
        return couple - cross(self.marker.position - self.body.position, force)

    @cached_property
    def force_in_joint(self) -> ca.SX:
        """Force on the body (2,) in the axes of its own joint marker, N."""
        return self.marker.axes.T @ self.force

    def __repr__(self) -> str:
        return f"Reaction of {self.element.description} on '{self.body.name}'"


def cross(a: ca.SX, b: ca.SX) -> ca.SX:
    """Third component of the cross product of two plane vectors."""
    return a[0] * b[1] - a[1] * b[0]


def at_poses(expression: Any, bodies: Sequence[Body]) -> ca.SX:
    """Expression with the estimated poses put in; parameters and time remain."""
    moving = [body for body in bodies if not body.is_ground]
    if not moving:
        return ca.SX(expression)
    symbols = ca.vertcat(*[body.q for body in moving])
    values = ca.vertcat(*[ca.DM(body.pose_estimate) for body in moving])
    return ca.substitute(ca.SX(expression), symbols, values)
