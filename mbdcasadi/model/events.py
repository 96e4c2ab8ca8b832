"""Events: instants at which an expression passes through zero."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from ..errors import ModelError
from .element import refuse_kinds
from .immutable import HoldsSymbols, Immutable
from .quantities import is_relation, quantity, yes_or_no
from .symbols import StateVariable, check_name, role_of, symbols_of


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

    Raises
    ------
    ModelError
        For an expression that is a number, and a reset of a position, an input or an acceleration.

    Notes
    -----
    A reset does not keep at rest what it has stopped: a ball whose bounces die out ends in an
    error. For rest on a surface use a :class:`Contact`.

    References
    ----------
    Haug 1989, section 6.6; Pfeiffer and Glocker, *Multibody Dynamics with Unilateral
    Contacts*, 1996, chapter 6 (impacts with constraints).
    """

    def __init__(self, name: str, expression: Any, direction: int = 0, terminal: bool = False, reset: Any = None):
        self.name = check_name(name, "Event")
        what = f"event '{name}'"
        self.expression = quantity(expression, what, "expression")
        if not isinstance(self.expression, ca.SX):
            raise ModelError(f"{what}: the expression is the number {self.expression}, which never passes through zero")
        if is_relation(self.expression):
            raise ModelError(
                f"{what}: {self.expression} is a relation, 0 or 1, which never passes through zero; give the "
                "difference of both sides, and direction= for the sense"
            )
        if direction not in (-1, 0, 1):
            raise ModelError(f"{what}: direction must be -1, 0 or 1, got {direction!r}")
        self.direction = int(direction)
        self.terminal = yes_or_no(terminal, what, "terminal")
        self.reset: tuple[tuple[ca.SX, ca.SX], ...] = _read_reset(reset, what)
        if self.reset and self.terminal:
            raise ModelError(
                f"{what}: a terminal event ends the run, and its reset would have no effect; leave one out"
            )

    def __repr__(self) -> str:
        return f"Event({self.name!r})"


def _read_reset(reset: Any, what: str) -> tuple[tuple[ca.SX, ca.SX], ...]:
    """Return the targets of a reset and their values afterwards."""
    if reset is None:
        return ()
    try:
        pairs = list(reset.items()) if isinstance(reset, Mapping) else [(key, value) for key, value in reset]
    except (TypeError, ValueError):
        raise ModelError(f"{what}: reset takes {{velocity: value}} or a list of pairs, got {reset!r}") from None
    if not pairs:
        raise ModelError(f"{what}: reset is empty; leave it out if nothing jumps")
    targets = []
    for key, value in pairs:
        target = ca.SX(quantity(key, what, "reset key"))
        _check_target(target, what)
        targets.append((key if isinstance(key, StateVariable) else target, ca.SX(quantity(value, what, "reset value"))))
    return tuple(targets)


def _check_target(target: ca.SX, what: str) -> None:
    """Raise an error if a target is neither a state variable nor an expression linear in velocities."""
    role = role_of(target) if target.is_symbolic() else None
    if role is not None and role.kind == "state":
        return
    speeds = [s for s in symbols_of(target) if (r := role_of(s)) is not None and r.kind == "velocity"]
    if not speeds:
        raise ModelError(
            f"{what}: reset of {target}: velocities, expressions linear in them and state variables can jump; "
            "positions cannot"
        )
    refuse_kinds(
        target, ("acceleration", "multiplier", "input", "state"), f"{what}: reset of {target}", "use velocities"
    )
    if ca.depends_on(ca.jacobian(target, ca.vertcat(*speeds)), ca.vertcat(*speeds)):
        raise ModelError(f"{what}: reset of {target}, which is not linear in the velocities; reset the velocity itself")
