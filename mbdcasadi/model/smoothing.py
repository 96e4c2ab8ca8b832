"""What changes within a short time where a law is smoothed, so that a run can tell whether it was resolved."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca


@dataclass(frozen=True, eq=False)
class Smoothing:
    """A quantity whose course an integrator must follow in several steps.

    Attributes
    ----------
    expression : casadi.SX
        Scalar in coordinates, velocities, first-order states, parameters and time.
    span : float
        From its least to its largest value.
    subject : str
        What it is, with the element, in words.
    remedy : str
        What to do besides tightening the tolerances.
    scale : casadi.SX or None
        A load at the time, of which the span is a multiple; None where the span is all.
    """

    expression: ca.SX
    span: float
    subject: str
    remedy: str
    scale: ca.SX | None = None
