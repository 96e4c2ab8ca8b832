"""What an element asks to be watched along a motion."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca


@dataclass(frozen=True, eq=False)
class Monitor:
    """A quantity that must not become negative along a motion, and what it means where it does.

    Analyses look at it at their outputs and warn: nothing is changed.

    Attributes
    ----------
    expression : casadi.SX
        Scalar.
    sentence : str
        What is wrong where it is negative, with the element and the remedy.
    still : casadi.SX or None
        An angle that the joints of the mechanism should hold still; ``check`` tells where they let it turn.
    shown : casadi.SX or None
        What is told of its size in place of the expression, in the unit that follows.
    unit : str
        Its unit.
    """

    expression: ca.SX
    sentence: str
    still: ca.SX | None = None
    shown: ca.SX | None = None
    unit: str = ""
