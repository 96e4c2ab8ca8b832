"""Follower motions: rises, dwells and returns one after the other, for cams and drivers.

The laws are sines and polynomials, which SciPy's piecewise polynomials cannot represent.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from ...errors import ModelError
from ..immutable import Immutable
from ..quantities import one_of
from ..symbols import number, positive


def cycloidal(s: ca.SX) -> ca.SX:
    """``s - sin(2 π s) / 2π``: the acceleration is a sine, zero at both ends."""
    return s - ca.sin(2 * np.pi * s) / (2 * np.pi)


def harmonic(s: ca.SX) -> ca.SX:
    """``(1 - cos π s) / 2``: the acceleration jumps at a dwell."""
    return (1 - ca.cos(np.pi * s)) / 2


def polynomial_345(s: ca.SX) -> ca.SX:
    """``10 s³ - 15 s⁴ + 6 s⁵``: velocity and acceleration vanish at both ends."""
    return s**3 * (10 + s * (6 * s - 15))


#: Largest acceleration of the modified trapezoidal law, 8π/(2 + π) = 4.888 lifts by duration squared.
TRAPEZOIDAL_PEAK = 8 * np.pi / (2 + np.pi)


def modified_trapezoidal(s: ca.SX) -> ca.SX:
    """Constant acceleration, joined to zero and to the deceleration by quarters of a sine.

    It has the least peak of the acceleration among the laws here, 4.888.
    """
    peak, w = TRAPEZOIDAL_PEAK, 4 * np.pi
    late = s > 0.5
    x = ca.if_else(late, 1 - s, s)  # the second half mirrors the first
    # comparisons with s itself, so that an integrator can find the breakpoints in the expression
    at_ends, outer = ca.logic_or(s < 1 / 8, s > 7 / 8), ca.logic_or(s < 3 / 8, s > 5 / 8)

    begin = peak * (x / w - ca.sin(w * x) / w**2)
    s1, v1 = peak * (1 / (8 * w) - 1 / w**2), peak / w
    y = x - 1 / 8
    constant = s1 + v1 * y + peak * y**2 / 2
    s2, v2 = s1 + v1 / 4 + peak / 32, v1 + peak / 4
    y = x - 3 / 8
    end = s2 + v2 * y + peak * (1 - ca.cos(w * y)) / w**2
    half = ca.if_else(at_ends, begin, ca.if_else(outer, constant, end))
    return ca.if_else(late, 1 - half, half)


#: The laws by name: from 0 to 1 while s goes from 0 to 1.
LAWS: dict[str, Callable[[ca.SX], ca.SX]] = {
    "cycloidal": cycloidal,
    "modified trapezoidal": modified_trapezoidal,
    "3-4-5": polynomial_345,
    "harmonic": harmonic,
}


@dataclass(frozen=True)
class ProgramSegment:
    """A segment of a motion program, made by :func:`rise`, :func:`fall` or :func:`dwell`."""

    #: its length in the argument of the program: an angle of the cam (rad) or a time (s)
    duration: float
    #: position at its end, m or rad; None for a dwell
    level: float | None = None
    #: one of :data:`LAWS`
    law: str = "cycloidal"

    kind: ClassVar[str] = "segment"

    def __post_init__(self) -> None:
        positive(self.duration, self.kind, "duration")
        if self.level is not None:
            number(self.level, self.kind, "level")
        one_of(self.law, LAWS, self.kind, "law")


def rise(duration: float, level: float, law: str = "cycloidal") -> ProgramSegment:
    """Return a segment that moves to a level, up or down.

    Parameters
    ----------
    duration : float
        Its length in the argument of the program: an angle of the cam (rad) or a time (s).
    level : float
        Position at its end, m or rad.
    law : {"cycloidal", "modified trapezoidal", "3-4-5", "harmonic"}
        Law of motion.

    Returns
    -------
    ProgramSegment
    """
    return ProgramSegment(duration, level, law)


def fall(duration: float, law: str = "cycloidal", level: float = 0.0) -> ProgramSegment:
    """Return a segment that moves back to a level.

    Parameters
    ----------
    duration, law
        As for :func:`rise`.
    level : float, default 0
        Position at its end, m or rad.

    Returns
    -------
    ProgramSegment
    """
    return ProgramSegment(duration, level, law)


def dwell(duration: float) -> ProgramSegment:
    """Return a segment at rest, at the end position of the segment before.

    Parameters
    ----------
    duration : float
        As for :func:`rise`.
    """
    return ProgramSegment(duration)


class MotionProgram(Immutable):
    """Segments one after the other, repeated: dwell, rise, return.

    ``program(x)`` is the position at x as an expression: a lift over the angle
    of a cam, or the course of a driver over time.

    Parameters
    ----------
    *segments : ProgramSegment
        Made by :func:`rise`, :func:`dwell`, :func:`fall`.
    start : float, default 0
        Position at the beginning, m or rad.

    Attributes
    ----------
    duration : float
        Of one period.

    Raises
    ------
    ModelError
        For no segments, and a program that does not end at its start position.

    References
    ----------
    Norton, *Cam Design and Manufacturing Handbook*, 2009, chapters 2 and 3.

    Examples
    --------
    >>> program = MotionProgram(rise(1.0, 0.02), dwell(0.5), fall(1.5, "3-4-5"))
    >>> program.duration, float(program(1.2))
    (3.0, 0.02)
    """

    def __init__(self, *segments: ProgramSegment, start: float = 0.0):
        if not segments or not all(isinstance(segment, ProgramSegment) for segment in segments):
            raise ModelError(f"MotionProgram takes segments made by rise, dwell and fall, got {segments!r}")
        self.segments = segments
        self.start = number(start, "MotionProgram", "start")
        self.duration = float(sum(segment.duration for segment in segments))
        end = self._levels()[-1]
        if abs(end - self.start) > 1e-12 * max(1.0, abs(end)):
            raise ModelError(
                f"MotionProgram: it begins at {self.start:g} and ends at {end:g}; it is repeated and must end at its "
                "start position"
            )

    def _levels(self) -> list[float]:
        """Position before the first and after each segment."""
        levels = [self.start]
        for segment in self.segments:
            levels.append(levels[-1] if segment.level is None else float(segment.level))
        return levels

    def __call__(self, x: Any) -> Any:
        """Position at x: an expression for an expression, a float or array for numbers."""
        if isinstance(x, ca.SX):
            return self._expression(x)
        symbol = ca.SX.sym("x")
        try:
            numbers = np.asarray(x, dtype=float)
        except (TypeError, ValueError, RuntimeError):
            raise ModelError(f"MotionProgram: takes an expression or numbers, got {x!r}") from None
        values = ca.Function("program", [symbol], [self._expression(symbol)])(numbers.reshape(1, -1)).full()
        return float(values[0, 0]) if numbers.ndim == 0 else values.reshape(numbers.shape)

    def _expression(self, x: ca.SX) -> ca.SX:
        x = x - self.duration * ca.floor(x / self.duration)
        levels = self._levels()
        begin = self.duration
        course = None
        for segment, before, after in list(zip(self.segments, levels, levels[1:], strict=False))[::-1]:
            begin -= segment.duration
            share = (x - begin) / segment.duration
            piece = ca.SX(before) if after == before else before + (after - before) * LAWS[segment.law](share)
            end = begin + segment.duration
            course = piece if course is None else ca.if_else(x < end, piece, course)
        return course

    def __repr__(self) -> str:
        return f"MotionProgram({', '.join(map(repr, self.segments))}, start={self.start:g})"
