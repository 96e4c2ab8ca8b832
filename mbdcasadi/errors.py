"""Errors and warnings of the package.

Every error derives from :class:`MechanismError`, which is a ``ValueError``.
The message names the element, the quantity and the value, and says what to do.
"""

from __future__ import annotations

from typing import Any


class MechanismError(ValueError):
    """Base class of all errors that concern a mechanism or an analysis of it.

    Attributes
    ----------
    time : float or None
        Time at which a run stopped, s.
    partial : Trajectory, Solution or None
        What had been computed before the run stopped.
    """

    def __init__(self, message: str, *, time: float | None = None, partial: Any = None):
        super().__init__(message)
        self.time = time
        self.partial = partial

    def __reduce__(self) -> tuple:
        # what had been computed holds symbols, which do not travel to another process; the message does
        return type(self), self.args, self.__dict__ | {"partial": None}


class ModelError(MechanismError):
    """The model is wrong: a number, a name, a symbol or a part that is missing."""


class ConditionError(MechanismError):
    """A condition is no relation, contradicts another one, or contradicts the constraints."""


class AssemblyError(MechanismError):
    """No pose meets all constraints and conditions.

    Attributes
    ----------
    residuals : dict of str to float
        Largest row that is left over, by element, in the unit of that row (m or rad).
    """

    def __init__(self, message: str, *, residuals: dict[str, float] | None = None, **more: Any):
        super().__init__(message, **more)
        self.residuals = residuals or {}


class SingularityError(MechanismError):
    """The constraint Jacobian lost rank: a lock-up, a bifurcation, or mass that is missing."""


class SimulationError(MechanismError):
    """The integrator could not go on."""


class ExpressionError(MechanismError):
    """An expression holds a symbol that the mechanism does not have, or one that is not allowed."""


class FileError(MechanismError):
    """A file cannot be read or written; the message names it."""


class Interrupted(KeyboardInterrupt):
    """The user stopped a run (Ctrl-C); what had been computed is in ``partial``."""

    def __init__(self, message: str, *, time: float | None = None, partial: Any = None):
        super().__init__(message)
        self.time = time
        self.partial = partial

    def __reduce__(self) -> tuple:
        return type(self), self.args, self.__dict__ | {"partial": None}


class MechanismWarning(UserWarning):
    """Something the user should know, though the result stands."""
