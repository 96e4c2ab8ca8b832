"""Quantities of an element that analyses watch along a motion: its validity, and its fast changes."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca


@dataclass(frozen=True, eq=False)
class ValidityCondition:
    """A quantity that must not become negative along a motion, and the message if it does.

    Analyses evaluate it at their outputs and warn; nothing is changed.

    Parameters
    ----------
    expression : casadi.SX
        Scalar; negative if the element is not valid.
    message : str
        Message if it is negative, with the element and the remedy.
    fixed : casadi.SX or None
        Angles and lengths that the joints of the mechanism should hold; ``check`` reports if they let one change.
    shown : casadi.SX or None
        Reported in place of the expression, in the unit that follows.
    unit : str
        Its unit.
    between_outputs : bool
        If True, ``simulate`` watches it between the outputs too, so that nothing short is missed. It must then depend
        on time, positions, velocities, states and parameters only.
    """

    expression: ca.SX
    message: str
    fixed: ca.SX | None = None
    shown: ca.SX | None = None
    unit: str = ""
    between_outputs: bool = False

    @property
    def reported(self) -> ca.SX:
        """Quantity whose size is reported."""
        return self.expression if self.shown is None else self.shown


@dataclass(frozen=True, eq=False)
class Smoothing:
    """A quantity whose course an integrator must follow in several steps.

    Parameters
    ----------
    expression : casadi.SX
        Scalar in coordinates, velocities, first-order states, parameters and time.
    span : float
        Difference between its largest and its least value.
    subject : str
        Description of the quantity, which messages put behind that of the element.
    remedy : str
        Remedy other than tighter tolerances.
    scale : casadi.SX or None
        A load of which the span is a multiple; None if the span is absolute.
    """

    expression: ca.SX
    span: float
    subject: str
    remedy: str
    scale: ca.SX | None = None
