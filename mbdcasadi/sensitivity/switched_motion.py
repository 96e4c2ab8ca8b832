"""A motion that was simulated, in phases with smooth equations: by mechanism, and by mode of friction and contacts."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from ..errors import ModelError
from ..model.events import Event
from ..model.forces.friction.modes import switching
from ..model.mechanism import Mechanism
from ..results.phases import present
from ..results.state import EventOccurrence
from ..results.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class SmoothPhase:
    """A part of a motion in which nothing switches.

    Attributes
    ----------
    motion : Trajectory
        The part, in the mechanism of its mode.
    owner : Trajectory
        The motion in one mechanism to which it belongs.
    parameters : numpy.ndarray
        Values of the parameters of all mechanisms.
    modes, mode : SwitchingModes and a mode of it, or None
        The mode.
    at_break : bool
        True if it ends where inputs or equations change in time.
    """

    motion: Trajectory
    owner: Trajectory
    parameters: np.ndarray
    modes: Any = None
    mode: Any = None
    at_break: bool = False

    @property
    def lasts(self) -> bool:
        """True if it lasts longer than an instant."""
        return len(self.motion) > 1 and bool(self.motion.t[-1] > self.motion.t[0])

    @property
    def events(self) -> tuple[Event, ...]:
        """Events at which its mode ends."""
        return () if self.modes is None else tuple(self.modes.events(self.mode))

    def shown(self, expression: ca.SX, whole: Mechanism) -> ca.SX:
        """An expression in the symbols of the whole as one in those of the mode."""
        expression = present(expression, whole, self.owner.mechanism)
        if self.modes is None:
            return expression
        return ca.substitute(expression, self.owner.equations.lam, self.modes.reactions(self.mode))


@dataclass(frozen=True, eq=False)
class Boundary:
    """What takes place between two phases.

    Attributes
    ----------
    events : tuple of Event
        The events there: one that changes the mechanism, or those of a mode.
    occurrences : tuple of EventOccurrence
        The same, as they took place.
    """

    events: tuple[Event, ...]
    occurrences: tuple[EventOccurrence, ...]


def smooth_phases(motion: Trajectory) -> list[SmoothPhase]:
    """Return the phases of a motion, in the order of time.

    Raises
    ------
    ModelError
        If friction or contacts switch in a motion that does not know its modes, as one that was read from a file.
    """
    found = []
    for part, p in zip(motion.phases, motion.parameters_by_phase, strict=True):
        if not switching(part.mechanism):
            found.append(SmoothPhase(part, part, p))
            continue
        pieces = [] if part.interpolation is None else part.interpolation.by_mode()
        if not pieces:
            raise ModelError(
                "sensitivities: the motion does not know where its friction and contacts switch, as one from a file or "
                "of no duration; simulate it"
            )
        at = [event.t for event in motion.events if event.after is not None]
        joined: list[SmoothPhase] = []
        for piece in pieces:
            at_break = is_among(float(piece.motion.t[-1]), piece.breaks.tolist())
            phase = SmoothPhase(piece.motion, part, p, piece.modes, piece.mode, at_break)
            last = joined[-1] if joined else None
            if last is None or last.mode != phase.mode or is_among(float(piece.motion.t[0]), at):
                joined.append(phase)
            else:  # inputs change there, or prescribed velocities jump, which a phase takes in
                joined[-1] = replace(phase, motion=_joined(last.motion, piece.motion))
        found += joined
    return found


def is_among(time: float, times: list[float]) -> bool:
    """True if a time is one of some times, but for rounding."""
    return any(abs(time - other) <= 4 * float(np.spacing(abs(time))) for other in times)


def _joined(first: Trajectory, then: Trajectory) -> Trajectory:
    """A motion from the start of one part to the end of the next."""
    both = zip(first.arguments[:-1], then.arguments[:-1], strict=True)
    t, q, v, a, z, lam, u = (np.concatenate([start[:1], end[-1:]]) for start, end in both)
    return Trajectory(first.mechanism, t.ravel(), q, v, a, z, lam, u, first.parameters)
