"""Errors and warnings of the package.

Every error derives from :class:`MechanismError`, which is a ``ValueError``.
The message names the element, the quantity, the value and the remedy.
"""

from __future__ import annotations

import contextlib
import functools
import sys
import threading
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

#: What a value that is not finite may come of, for messages.
NOT_FINITE = (
    "a spline outside its data (or a table), a rope that has turned by more than 135° from its estimated pose "
    "(relative to carrier= of its drum), a division by zero, or a root of a negative number"
)


class _Stop(BaseException):
    """End of a run, with its time and what had been computed."""

    def __init__(self, message: str, *, time: float | None = None, partial: Any = None):
        super().__init__(message)
        self.time = time
        self.partial = partial

    def __reduce__(self) -> tuple:
        # what had been computed holds symbols, which do not travel to another process; the message does
        return type(self), self.args, self.__dict__ | {"partial": None}


class MechanismError(_Stop, ValueError):
    """Base class of all errors that concern a mechanism or an analysis of it.

    Attributes
    ----------
    time : float or None
        Time at which a run stopped, s.
    partial : Trajectory, Solution or None
        Result that was computed before the run stopped.
    """


class ModelError(MechanismError):
    """The model is wrong: a number, a name, a symbol, or a missing part."""


class AbsentError(ModelError, AttributeError):
    """A quantity that an element of this kind does not have, as the force of what acts by a couple."""


class ConditionError(MechanismError):
    """A condition is not a relation, or contradicts another one or the constraints."""


class AssemblyError(MechanismError):
    """No pose satisfies all constraints and conditions.

    Attributes
    ----------
    residuals : dict of str to float
        Largest residual of each element, in the unit of its row (m or rad).
    """

    def __init__(self, message: str, *, residuals: dict[str, float] | None = None, **more: Any):
        super().__init__(message, **more)
        self.residuals = residuals or {}


class OptimizationError(MechanismError):
    """An optimum was not found.

    Attributes
    ----------
    largest_violations : list of Violation
        Equations that are not met, each with ``.label``, ``.violation``, ``.time``; the largest first.
    partial : Solution or None
        The last iterate; it is not a solution. None if a place is out of reach, and nothing was solved.
    reached : Solution or None
        The last solution of a continuation, or of a refinement of the mesh, that did not reach its end.
    conflict : tuple of Violation
        Demands that cannot be met together. First limits, with the amounts by which they would have to be wider for all
        conditions to be met; then other demands, by how much they are violated where all violations together are least.
        Empty if the problem does not seem infeasible.
    findings : str
        The message without what the solver said.
    """

    reached: Any = None
    conflict: tuple[Any, ...] = ()
    findings: str = ""

    def __init__(
        self, message: str, *, partial: Any, largest_violations: Sequence[Any] = (), time: float | None = None
    ):
        super().__init__(message, time=time, partial=partial)
        self.largest_violations = list(largest_violations)


class UnmetConditionsError(AssemblyError, ConditionError):
    """No pose satisfies the conditions, though the parts fit together."""


class SingularityError(MechanismError):
    """The constraint Jacobian lost rank: a lock-up, a bifurcation, or missing mass."""


class SimulationError(MechanismError):
    """The integrator could not continue."""


class EquilibriumError(MechanismError):
    """No equilibrium was found, or none that meets the conditions."""


class ExpressionError(MechanismError):
    """An expression contains a symbol that the mechanism does not have, or one that is not allowed."""


class FileError(MechanismError):
    """A file cannot be read or written; the message names it."""


class Interrupted(_Stop, KeyboardInterrupt):
    """The user stopped a run (Ctrl-C); the result computed so far is in ``partial``."""


class MechanismWarning(UserWarning):
    """A remark on a result that is valid."""


#: Beginnings of the names of files between a remark and the line that called: decorators may come
#: before an analysis, and a lazy attribute around it.
_OWN = (str(Path(__file__).parent), contextlib.__file__, functools.__file__)
_OF_THREAD = threading.local()


def warnings_given() -> int:
    """Return the number of warnings of this package that this thread has given, those that were ignored included."""
    return getattr(_OF_THREAD, "warnings", 0)


def warn(message: str, category: type[Warning] = MechanismWarning) -> None:
    """Warn at the line that called this package, however deep inside it the remark is made."""
    _OF_THREAD.warnings = warnings_given() + 1
    level, frame = 1, sys._getframe()
    while frame.f_back is not None and frame.f_code.co_filename.startswith(_OWN):
        level, frame = level + 1, frame.f_back
    warnings.warn(message, category, stacklevel=level)
