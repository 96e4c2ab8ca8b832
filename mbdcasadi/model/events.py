"""Events: instants at which an expression passes through zero."""

from __future__ import annotations

from typing import Any

import casadi as ca

from ..errors import ModelError
from .immutable import Immutable
from .quantities import quantity, yes_or_no
from .symbols import check_name


class Event(Immutable):
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
        Whether the simulation ends there.
    """

    def __init__(self, name: str, expression: Any, direction: int = 0, terminal: bool = False):
        self.name = check_name(name, "Event")
        what = f"event '{name}'"
        self.expression = quantity(expression, what, "expression")
        if not isinstance(self.expression, ca.SX):
            raise ModelError(f"{what}: the expression is the number {self.expression}, which never passes through zero")
        if direction not in (-1, 0, 1):
            raise ModelError(f"{what}: direction must be -1, 0 or 1, got {direction!r}")
        self.direction = int(direction)
        self.terminal = yes_or_no(terminal, what, "terminal")

    def __repr__(self) -> str:
        return f"Event({self.name!r})"
