"""Interface of model elements, from which the equations are collected.

The equations do not distinguish kinds of elements: a user-defined class with these attributes is on a par with
those of the package.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, ClassVar, TypeVar

import casadi as ca

from ..errors import ExpressionError, ModelError
from ..numerics.lazy import cached_property
from .bodies import Body, Marker, ground
from .immutable import HoldsSymbols, Immutable
from .quantities import HasQuantities
from .symbols import as_sx, check_name, register, role_of, symbols_of
from .validity import Smoothing, ValidityCondition


class Element(Immutable, HoldsSymbols, HasQuantities):
    """Base class of joints, drivers and forces. Every attribute has a neutral default and may be overridden.

    Parameters
    ----------
    name : str
        Its name, unique in the mechanism.

    Attributes
    ----------
    name : str
        Its name.
    markers : tuple of Marker
        Points of the bodies to which it is attached.
    rows : casadi.SX
        ``Phi`` (k,): position constraints in coordinates and time.
    velocity_rows : casadi.SX
        Constraints (k,) linear in the velocities, that no position constraint implies.
    row_labels : tuple of str
        Meaning of each row ("x", "angle"), position rows first.
    multipliers : casadi.SX
        ``lam``, one for each row, position rows first.
    coordinates : tuple of Coordinate
        Extra coordinates without inertia.
    virtual_work : tuple of (displacement, force) pairs
        ``δW = force · δdisplacement``; both expressions of the same size.
    rates : dict of StateVariable to casadi.SX
        Rates of first-order states that the element owns.
    mass_rates : tuple of (Body, casadi.SX) pairs
        Mass that it brings to bodies, kg/s; their masses must change by the sum.
    potential : casadi.SX
        Potential energy, J, of forces that have one.
    external : bool
        True if its forces come from outside (weight, a field), so that nothing in the model takes the reaction. For
        any other element the ground takes the part of its forces that does not balance.
    limits : tuple of Limit
        Ranges of its quantities, checked at every value of the parameters.
    validity_conditions : tuple of ValidityCondition
        Conditions under which the element is a valid model (a cam that only presses); analyses warn if one is broken.
    smoothings : tuple of Smoothing
        Quantities that change within a short time; a simulation warns if its steps jump over the change.
    watched_gaps : casadi.SX, optional
        Gaps (k,), m, of an element with smoothings: a simulation does not step over a short closure of the least one.
    watched_clearance : casadi.SX, optional
        Of an element with gaps: scalar that costs little and is positive only if all are open. All its forces are zero
        then, and are not evaluated.
    resolved_laws : tuple of FrictionLaw
        Friction laws by which it acts: the tolerances of a simulation resolve the widths over which they are smoothed.
    likeness_of_expressions : hashable, optional
        Elements for which it is equal have the same expressions in the coordinates of their own :attr:`bodies`, so that
        a result for one of them holds for all. None if it is not known.
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
    mass_rates: tuple[tuple[Body, ca.SX], ...] = ()
    potential: ca.SX = ca.SX(0)
    external: bool = False
    validity_conditions: tuple[ValidityCondition, ...] = ()
    smoothings: tuple[Smoothing, ...] = ()
    watched_gaps: ca.SX | None = None
    watched_clearance: ca.SX | None = None
    resolved_laws: tuple[Any, ...] = ()
    likeness_of_expressions: Hashable = None

    def __init__(self, name: str):
        self.name = check_name(name, type(self).__name__)

    @property
    def description(self) -> str:
        """Kind and name of the element, as messages give it."""
        return f"{self.kind} '{self.name}'"

    @cached_property
    def bodies(self) -> tuple[Body, ...]:
        """Bodies on which it acts, including the ground if that takes part."""
        return tuple(dict.fromkeys(marker.body for marker in self.markers))

    def expressions(self) -> list[ca.SX]:
        """Expressions that enter the equations, for the check of their symbols."""
        pairs = [as_sx(part) for pair in self.virtual_work for part in pair]
        return [
            self.rows,
            self.velocity_rows,
            *pairs,
            as_sx(self.potential),
            *self.rates.values(),
            *(rate for _, rate in self.mass_rates),
        ]

    def acting_on(self, bodies: Sequence[Body]) -> Element:
        """Return the element of a mechanism with these bodies (gravity acts on all of them)."""
        return self

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.name!r})"


def owners(expression: Any) -> tuple[Body, ...]:
    """Return the bodies whose coordinates or velocities occur in an expression."""
    roles = [role_of(symbol) for symbol in symbols_of(expression)]
    return tuple(dict.fromkeys(role.owner for role in roles if role is not None and isinstance(role.owner, Body)))


def holds_coordinates(expression: Any) -> bool:
    """Return True if a coordinate of a body, or one without inertia, occurs in an expression."""
    roles = (role_of(symbol) for symbol in symbols_of(expression))
    return any(role is not None and role.kind == "position" for role in roles)


#: Kinds of symbols that an expression in coordinates, parameters and time does not contain.
BEYOND_COORDINATES = ("velocity", "acceleration", "multiplier", "input", "state")


def refuse_kinds(expression: Any, kinds: Sequence[str], what: str, remedy: str) -> None:
    """Raise an error if an expression depends on symbols of kinds that are not allowed."""
    for symbol in symbols_of(expression):
        role = role_of(symbol)
        if role is not None and role.kind in kinds:
            raise ExpressionError(f"{what} depends on the {role.kind} '{role.label}'; {remedy}")


class ConstraintElement(Element):
    """Base class of elements with constraint rows, their multipliers and reactions.

    Parameters
    ----------
    name : str
        Its name.
    rows : casadi.SX
        ``Phi`` (k,).
    row_labels : tuple of str
        One for each row; () for a single row that needs no label of its own.
    markers : tuple of Marker
        Points of the bodies to which it is attached.
    velocity_rows : casadi.SX, optional
        Rows at velocity level.

    Attributes
    ----------
    leans_on_ground : bool
        True if the ground takes part in a constraint between two moving bodies.
        It does if the row changes when both bodies turn as one, as that of a
        constraint along a global axis does: its forces on them then leave a
        couple, which the ground takes.
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
        self.refuse_beyond_coordinates(self.rows)
        if velocity_rows is not None:
            self.velocity_rows = ca.vec(velocity_rows)
        self.row_labels = row_labels
        self.markers = markers
        count = self.rows.numel() + self.velocity_rows.numel()
        self.multipliers = ca.SX.sym(f"{name}.lam", count)
        self._roles = tuple(
            register(self.multipliers[k], "multiplier", f"{name}.multipliers" + (f"[{k}]" if count > 1 else ""), self)
            for k in range(count)
        )

    def refuse_beyond_coordinates(self, expression: Any) -> None:
        """Raise an error if an expression that enters the position rows contains what they may not."""
        refuse_kinds(
            expression,
            ("velocity", "acceleration", "input", "state"),
            self.description,
            "position constraints contain coordinates, parameters and time only",
        )

    @cached_property
    def impulses(self) -> ca.SX:
        """Impulses ``Λ`` of the rows at an impact (k,), the integrals of the multipliers over its instant."""
        return ca.vertcat(ca.SX(0, 1), *[symbol for symbol, _ in self._impulse_symbols])

    @cached_property
    def _impulse_symbols(self) -> list[tuple[ca.SX, Any]]:
        """Symbols of the impulses, with the roles that must live as long as they do."""
        count = self.multipliers.numel()
        labels = [f"{self.name}.impulses" + (f"[{k}]" if count > 1 else "") for k in range(count)]
        symbols = [ca.SX.sym(label) for label in labels]
        return [(s, register(s, "impulse", label, self)) for s, label in zip(symbols, labels, strict=True)]

    @property
    def row_names(self) -> tuple[str, ...]:
        """Name of each row: the name of the element and the label of the row."""
        labels = self.row_labels or tuple(str(k) for k in range(self.multipliers.numel()))
        return (self.name,) if len(labels) == 1 and not self.row_labels else tuple(f"{self.name}.{x}" for x in labels)

    @cached_property
    def bodies(self) -> tuple[Body, ...]:
        bodies = dict.fromkeys(marker.body for marker in self.markers)
        bodies.update(dict.fromkeys(owners(ca.vertcat(self.rows, self.velocity_rows))))
        if len(bodies) == 1 or not self.markers or self.leans_on_ground:
            bodies[ground] = None
        return tuple(bodies)

    def marker_on(self, body: Body) -> Marker:
        """Return the marker on a body; if there is none, one at its centre of mass (on the ground, at the origin)."""
        marker_there = next((marker for marker in self.markers if marker.body is body), None)
        return marker_there if marker_there is not None else Marker(body, ca.SX(2, 1), ca.SX(0))

    def reaction_on(self, body: Body) -> Reaction:
        """Return the reaction on a body.

        Parameters
        ----------
        body : Body
            A body that it connects, or ``ground``.

        Returns
        -------
        Reaction
            ``.force``, ``.torque``, ``.force_in_joint`` as expressions.
        """
        return self._load(Reaction, body)

    def impulse_on(self, body: Body) -> Impulse:
        """Return the impulse on a body at an impact or a change of the mechanism.

        Parameters
        ----------
        body : Body
            A body that it connects, or ``ground``.

        Returns
        -------
        Impulse
            ``.force`` (N s), ``.torque`` (N m s), ``.force_in_joint`` as expressions; they have values in
            ``event.after[…]`` and, in optimal control, in ``initial=`` of a phase.
        """
        return self._load(Impulse, body)

    @cached_property
    def _loads(self) -> dict[tuple[type[Reaction], Body], Reaction]:
        """Reactions and impulses that were asked for."""
        return {}

    def _load(self, kind: type[_Load], body: Body) -> _Load:
        """Return the reaction or the impulse on a body, made once: its expressions are named by their identity."""
        if not any(body is b for b in self.bodies):
            names = ", ".join(f"'{b.name}'" for b in self.bodies)
            name = body.name if isinstance(body, Body) else repr(body)
            raise ModelError(f"{self.description} does not act on '{name}'; it acts on {names}")
        load: Any = self._loads.get((kind, body))
        if load is None:
            load = self._loads[kind, body] = kind(self, body)
        return load

    @property
    def named_loads(self) -> list[tuple[str, ca.SX]]:
        """Names and expressions of the reactions and impulses that were asked for."""
        return [
            (f"{self.name}.{kind.asked_by}({body.name}).{name}", getattr(load, name))
            for (kind, body), load in self._loads.items()
            for name in ("force", "torque", "force_in_joint")
        ]


def constraint_load(element: Any, multipliers: ca.SX, q: ca.SX, v: ca.SX) -> ca.SX:
    """Return the generalised force ``-Phi_q^T lam`` of the rows of an element on coordinates q with rates v."""
    count, load = element.rows.numel(), ca.SX(q.numel(), 1)
    if count:
        load -= ca.jtimes(element.rows, q, multipliers[:count], True)
    if element.velocity_rows.numel():
        load -= ca.jtimes(element.velocity_rows, v, multipliers[count:], True)
    return load


def applied_load(element: Any, q: ca.SX) -> ca.SX:
    """Return the generalised force on coordinates q that an element applies by its own law."""
    load = ca.SX(q.numel(), 1)
    for displacement, force in element.virtual_work:
        load += ca.jtimes(ca.vec(as_sx(displacement)), q, ca.vec(as_sx(force)), True)
    return load


class Reaction:
    """Force and couple that a constraint exerts on a body, as expressions in the multipliers.

    With the friction of a constraint that rubs. Else ``F = -Phi_r^T lam`` and, about the joint marker P on that body,
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

    #: method of an element that returns one
    asked_by = "reaction_on"

    def __init__(self, element: ConstraintElement, body: Body):
        self.element = element
        self.body = body
        self.marker = element.marker_on(body)

    def _on_moving(self, body: Body) -> ca.SX:
        """Generalised reaction on ``[x, y, phi]`` of a body."""
        load = constraint_load(self.element, self.element.multipliers, body.q, body.v)
        return load + applied_load(self.element, body.q)

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
        return f"{type(self).__name__} of {self.element.description} on '{self.body.name}'"


class Impulse(Reaction):
    """Impulse and impulsive couple that a constraint exerts on a body at an impact.

    As the reaction, with the impulses ``Λ`` in place of the multipliers, ``M (v⁺ - v⁻) + Phi_q^T Λ = 0``: force, N s,
    and torque, N m s.
    """

    asked_by = "impulse_on"

    def _on_moving(self, body: Body) -> ca.SX:
        return constraint_load(self.element, self.element.impulses, body.q, body.v)


_Load = TypeVar("_Load", bound=Reaction)


def cross(a: ca.SX, b: ca.SX) -> ca.SX:
    """Return the third component of the cross product of two plane vectors."""
    return a[0] * b[1] - a[1] * b[0]


def work_at(body: Body, point: ca.SX, force: ca.SX) -> tuple[tuple[ca.SX, ca.SX], ...]:
    """Return the virtual work of a force on the point of a body that is at a place, which may move over the body."""
    if body.is_ground:
        return ()
    return (body.position, force), (body.phi, cross(point - body.position, force))


def at_poses(expression: Any) -> ca.SX:
    """Return an expression with the estimated poses and ``t = 0`` substituted; parameters remain."""
    expression = ca.SX(expression)
    known = [(s, role.estimate) for s in symbols_of(expression) if (role := role_of(s)) and role.estimate is not None]
    if not known:
        return expression
    symbols, values = zip(*known, strict=True)
    return ca.substitute(expression, ca.vertcat(*symbols), ca.vertcat(*[ca.DM(value) for value in values]))
