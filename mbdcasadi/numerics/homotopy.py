"""Homotopy: a solution carried along while something is changed in steps that are divided if they are too long."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

P = TypeVar("P")


class StepControl:
    """Length of the next step: halved after a step that failed, doubled after one that went well.

    Parameters
    ----------
    step : float
        Length of the first step.
    smallest : float
        Length below which it is given up.
    largest : float
        Longest step.
    """

    def __init__(self, step: float, smallest: float, largest: float = float("inf")):
        self.step, self.smallest, self.largest = step, smallest, largest

    def accept(self, *, easily: bool = True) -> None:
        """A step succeeded; the next one is longer if it did so easily."""
        if easily:
            self.step = min(2 * self.step, self.largest)

    def limit(self, largest: float) -> None:
        """Set the longest step."""
        self.largest = largest
        self.step = min(self.step, largest)

    def refuse(self) -> bool:
        """A step failed; return False if the next one would be shorter than the smallest."""
        self.step /= 2
        return self.step >= self.smallest


@dataclass(frozen=True)
class Step(Generic[P]):
    """A point that was reached.

    Attributes
    ----------
    point : object
        The solution there.
    easily : bool
        True if the next step may be longer.
    """

    point: P
    easily: bool = True


@dataclass(frozen=True)
class HomotopyEnd(Generic[P]):
    """End of a homotopy.

    Attributes
    ----------
    point : object
        The last good point.
    at : float
        Value of the parameter there.
    failed : float or None
        Value next to it at which there was no solution; None if the end was reached.
    """

    point: P
    at: float
    failed: float | None = None

    @property
    def complete(self) -> bool:
        """True if the end was reached."""
        return self.failed is None


def follow(
    point: P,
    advance: Callable[[P, float, float], Step[P] | None],
    *,
    start: float = 0.0,
    end: float = 1.0,
    step: float = 1.0,
    smallest: float = 1e-5,
) -> HomotopyEnd[P]:
    """Carry a solution from one value of a parameter to another.

    Parameters
    ----------
    point : object
        Solution at the start.
    advance : callable
        ``(point, at, to) -> Step``: predicts and corrects the solution at `to` from that at `at`; None if there is
        none that continues it.
    start, end : float
        First and last value of the parameter, ``start < end``.
    step : float
        First step.
    smallest : float
        Step below which it is given up.
    """
    at, control = start, StepControl(step, smallest)
    while at < end:
        to = min(at + control.step, end)
        reached = advance(point, at, to)
        if reached is not None:
            point, at = reached.point, to
            control.accept(easily=reached.easily)
        elif not control.refuse():
            return HomotopyEnd(point, at, to)
    return HomotopyEnd(point, at)
