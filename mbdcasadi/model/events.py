"""Events: instants at which an expression passes through zero."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from ..errors import ModelError
from .element import ConstraintElement, refuse_kinds
from .immutable import HoldsSymbols, Immutable
from .mechanism import Mechanism
from .quantities import entries, is_relation, quantity, whole, yes_or_no
from .symbols import Parameter, Scalar, StateVariable, check_name, number, place_of, role_of, symbols_of


class Event(Immutable, HoldsSymbols):
    """The instant at which an expression passes through zero during a simulation.

    Parameters
    ----------
    name : str
        Its name.
    expression : casadi.SX
        Scalar in anything the model has; the event is its zero.
    direction : {-1, 0, 1}, default 0
        1: only from negative to positive; -1: only from positive to negative; 0: both.
    terminal : bool, default False
        If True, the simulation ends there.
    reset : mapping or list of pairs, optional
        Velocity, expression linear in velocities, or state variable to its value just
        after the event, an expression in the state just before it:
        ``{ball.vy: -0.8 * ball.vy}``, or ``[(tip.vy, -0.8 * tip.vy)]`` if the key is
        not a symbol. The value is reached exactly, by an impulse P along the key;
        the joints respond with impulses Λ,
        ``M (v⁺ - v⁻) + Phi_q^T Λ + G^T P = 0``, ``Phi_q v⁺ = nu``, ``G v⁺ = g``,
        and nothing else of the motion changes.
        At a change of the mechanism: a parameter of the new mechanism to its value from there on
        (where a foot has landed), or a state variable, as an expression in the state just before.
    becomes : Mechanism, optional
        Mechanism in which the motion continues: made of the same bodies or of some of them. Positions are continuous,
        velocities jump by impulses of its joints, ``M (v⁺ - v⁻) + Phi_q^T Λ = 0``, ``Phi_q v⁺ = nu``: a plastic impact
        if a joint closes, no jump if one opens. A terminal event ends the run just after the change.
    during : Mechanism or sequence of Mechanism, optional
        Mechanisms in which the event is looked for; by default all that have its symbols, but the one it leads to.
    restitution : mapping of joint to float, optional
        Joints that act only at the instant of the change, with Newton's coefficients of restitution e:
        ``Phi_q v⁺ - nu = -e (Phi_q v⁻ - nu)``.

    Raises
    ------
    ModelError
        For an expression that is a number, and a reset of a position, an input or an acceleration.

    Notes
    -----
    At the start an event with a reset and a direction that is at its zero and moves through it takes place at once. One
    without a direction is taken to have been passed, with a warning: whether the motion comes to its zero or has just
    left it cannot be seen there. Events without a reset that are at their zero at the start are taken to have been
    passed, so that a run can continue from the state at which one has ended it. Those of reactions and accelerations
    with a direction, and a reset or a change of the mechanism, take place once they go beyond zero.

    A reset does not keep at rest what it has stopped: a ball whose bounces die out ends in an
    error. For rest on a surface use a :class:`Contact`.

    References
    ----------
    Haug 1989, section 6.6; Pfeiffer and Glocker, *Multibody Dynamics with Unilateral
    Contacts*, 1996, chapter 6 (impacts with constraints).
    """

    def __init__(
        self,
        name: str,
        expression: Scalar,
        direction: int = 0,
        terminal: bool = False,
        reset: Any = None,
        becomes: Mechanism | None = None,
        during: Any = None,
        restitution: Any = None,
    ):
        self.name = check_name(name, "Event")
        what = f"event '{name}'"
        self.expression = _read_expression(expression, what)
        self.direction = whole(direction, what, "direction", -1, 1)
        self.terminal = yes_or_no(terminal, what, "terminal")
        if becomes is not None and not isinstance(becomes, Mechanism):
            raise ModelError(f"{what}: becomes= takes a Mechanism, got {becomes!r}")
        self.becomes = becomes
        self.during: tuple[Mechanism, ...] | None = _read_during(during, what)
        self.restitution: dict[Any, float] = read_restitution(restitution, what)
        #: values that parameters and state variables take at a change of the mechanism
        self.new_values: tuple[tuple[Any, ca.SX], ...] = ()
        self.reset: tuple[tuple[ca.SX, ca.SX], ...] = ()
        if self.becomes is None:
            self.reset = _read_reset(reset, what)
            if self.restitution:
                raise ModelError(f"{what}: restitution= belongs to a change of the mechanism; give becomes= too")
        else:
            self.new_values = _read_new_values(reset, self.becomes, what)
        if self.reset and self.terminal:
            raise ModelError(
                f"{what}: a terminal event ends the run, and its reset would have no effect; leave one out"
            )

    def __repr__(self) -> str:
        return f"Event({self.name!r})"

    def is_watched_in(self, mechanism: Mechanism) -> bool:
        """Return True if the event is looked for in a mechanism."""
        if self.during is not None:
            if mechanism not in self.during:
                return False
        elif mechanism is self.becomes:
            return False
        known = mechanism.symbol_hashes | mechanism.acceleration_hashes
        used = [self.expression, *(ca.SX(part) for pair in self.reset for part in pair)]
        return all(symbol.element_hash() in known for part in used for symbol in symbols_of(part))


def _read_expression(expression: Any, what: str) -> ca.SX:
    value = quantity(expression, what, "expression")
    if not isinstance(value, ca.SX):
        raise ModelError(f"{what}: the expression is the number {value}, which never passes through zero")
    if is_relation(value):
        raise ModelError(
            f"{what}: {value} is a relation, 0 or 1, which never passes through zero; give the difference of both "
            "sides, and direction= for the sense"
        )
    return value


def _read_during(during: Any, what: str) -> tuple[Mechanism, ...] | None:
    if during is None:
        return None
    mechanisms = (during,) if isinstance(during, Mechanism) else entries(during, f"{what}: during=")
    for mechanism in mechanisms:
        if not isinstance(mechanism, Mechanism):
            raise ModelError(f"{what}: during= takes a Mechanism or a list of them, got {mechanism!r}")
    if not mechanisms:
        raise ModelError(f"{what}: during= is empty; the event would never be looked for")
    return mechanisms


def read_restitution(restitution: Any, what: str) -> dict[Any, float]:
    """Return joints with coefficients of restitution, which are from 0 to 1."""
    if restitution is None:
        return {}
    if not isinstance(restitution, Mapping):
        raise ModelError(f"{what}: restitution= takes {{joint: coefficient}}, got {restitution!r}")
    coefficients = {}
    for joint, value in restitution.items():
        if not isinstance(joint, ConstraintElement):
            raise ModelError(f"{what}: restitution= takes {{joint: coefficient}}, got the key {joint!r}")
        coefficients[joint] = number(value, what, f"restitution of {joint.description}")
        if not 0 <= coefficients[joint] <= 1:
            raise ModelError(f"{what}: restitution of {joint.description} must be from 0 to 1, got {value!r}")
    return coefficients


def _read_new_values(reset: Any, becomes: Mechanism, what: str) -> tuple[tuple[Any, ca.SX], ...]:
    """Return parameters and state variables of the new mechanism, and their values as expressions in the old one."""
    resets = []
    for key, value in _pairs(reset, what):
        if not isinstance(key, Parameter | StateVariable):
            raise ModelError(
                f"{what}: reset of {key!r} at a change of the mechanism; parameters and state variables take new "
                "values there, velocities follow from the impulses of the joints (restitution= makes them bounce)"
            )
        if place_of(key, (*becomes.parameters, *becomes.states)) is None:
            raise ModelError(f"{what}: reset of '{key.label}', which the mechanism of becomes= does not have")
        resets.append((key, ca.SX(quantity(value, what, "reset value"))))
    return tuple(resets)


def _read_reset(reset: Any, what: str) -> tuple[tuple[ca.SX, ca.SX], ...]:
    """Return the targets of a reset and their values afterwards."""
    targets = []
    for key, value in _pairs(reset, what):
        target = ca.SX(quantity(key, what, "reset key"))
        _check_target(target, what)
        targets.append((key if isinstance(key, StateVariable) else target, ca.SX(quantity(value, what, "reset value"))))
    return tuple(targets)


def _pairs(reset: Any, what: str) -> list[tuple[Any, Any]]:
    if reset is None:
        return []
    try:
        pairs = list(reset.items()) if isinstance(reset, Mapping) else [(key, value) for key, value in reset]
    except (TypeError, ValueError):
        raise ModelError(f"{what}: reset takes {{velocity: value}} or a list of pairs, got {reset!r}") from None
    if not pairs:
        raise ModelError(f"{what}: reset is empty; leave it out if nothing jumps")
    return pairs


def _check_target(target: ca.SX, what: str) -> None:
    """Raise an error if a target is neither a state variable nor an expression linear in velocities."""
    role = role_of(target) if target.is_symbolic() else None
    if role is not None and role.kind == "state":
        return
    speeds = [s for s in symbols_of(target) if (r := role_of(s)) is not None and r.kind == "velocity"]
    if not speeds:
        raise ModelError(
            f"{what}: reset of {target}: velocities, expressions linear in them and state variables can jump; "
            "positions cannot, and parameters only at a change of the mechanism (becomes=)"
        )
    refuse_kinds(
        target, ("acceleration", "multiplier", "input", "state"), f"{what}: reset of {target}", "use velocities"
    )
    if ca.depends_on(ca.jacobian(target, ca.vertcat(*speeds)), ca.vertcat(*speeds)):
        raise ModelError(f"{what}: reset of {target}, which is not linear in the velocities; reset the velocity itself")
