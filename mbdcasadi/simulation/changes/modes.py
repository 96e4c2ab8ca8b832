"""Modes of a run: the sets of equations between which it switches."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ...assembly.consistent_start import complete_state
from ...assembly.setup import Setup
from ...equations.numeric import NumericEquations
from ...model.events import Event
from ...model.mechanism import Mechanism
from ...results.state import State
from ...results.trajectory import Trajectory

#: ``t, q, v, a, z, lam, u`` of outputs, each by row.
Block = tuple[np.ndarray, ...]


@dataclass(frozen=True, eq=False)
class Strike:
    """Impacts at one instant.

    Attributes
    ----------
    state : State
        Just after them.
    impulses : mapping of element to numpy.ndarray
        As multipliers.
    names : tuple of str
        Events of what strikes.
    """

    state: State
    impulses: Mapping[Any, np.ndarray]
    names: tuple[str, ...]


class Modes(ABC):
    """The modes of a mechanism: in each of them its equations are smooth.

    Attributes
    ----------
    mechanism : Mechanism
        The whole.
    levels : numpy.ndarray
        Values of the inputs that are numbers; a controller changes them in place.
    settling : dict of str to float
        Events by which bounces that are too low to be followed come to rest, and their times, s.
    """

    #: what stands before the form of the equations in the statistics of a run
    prefix: ClassVar[str] = ""

    def __init__(self, setup: Setup):
        self.setup, self.mechanism = setup, setup.mechanism
        self.levels = setup.signals.level_values.copy()
        self.settling: dict[str, float] = {}
        self._numeric: dict[Hashable, NumericEquations] = {}

    # --- equations in one mode ---------------------------------------------------------------
    @property
    @abstractmethod
    def free(self) -> Hashable:
        """The mode in which nothing is held that may move: assembly and impulses act on it."""

    @abstractmethod
    def variant(self, mode: Any) -> Mechanism:
        """Return the mechanism in a mode."""

    def numeric(self, mode: Any) -> NumericEquations:
        """Return the equations in a mode, at the parameters of the run."""
        if mode not in self._numeric:
            self._numeric[mode] = self.setup.numeric_of(self.variant(mode))
        return self._numeric[mode]

    def at(self, mode: Any, time: float, q: np.ndarray, v: np.ndarray, z: np.ndarray) -> State:
        """Return the state at a pose and velocity in a mode, with the accelerations and multipliers there."""
        return complete_state(self.numeric(mode), self.setup.signals, time, q, v, z, levels=self.levels)

    # --- switching ------------------------------------------------------------------------------
    @abstractmethod
    def decided(self, state: State, events: Sequence[Event] = (), before: Any = None) -> tuple[Any, State]:
        """Return the mode that holds at a pose and velocity, and the state in it.

        Parameters
        ----------
        state : State
            In any mode.
        events : sequence of Event
            Events of the modes that took place just there.
        before : optional
            The mode until then.

        Raises
        ------
        SimulationError
            If there is no mode that holds.
        """

    def struck(self, state: State, events: Sequence[Event] = (), before: Any = None) -> Strike | None:
        """Return the impacts of what closes at a state; None without any."""
        return None

    def notes(self, mode: Any) -> list[str]:
        """Return what is to be said of the results in a mode."""
        return []

    def continues(self, before: Any, after: Any) -> bool:
        """Return True if two modes are one motion, of which the forces are told apart only."""
        return False

    def events(self, mode: Any) -> tuple[Event, ...]:
        """Return the events at which a mode ends."""
        return ()

    def came_about(self, name: str, after: Any) -> bool:
        """Return True if the mode that follows an event of one is such as its name says."""
        return True

    def switched(self, before: Any, after: Any) -> list[str]:
        """Return names of the events by which a mode follows another one at once, without a zero of theirs."""
        return []

    def refuse_redundant_rows(self, state: State) -> None:
        """Raise if constraint rows that depend on each other at a state leave something undetermined."""
        return None

    def check(self, mode: Any, block: Block) -> None:
        """Raise if outputs do not belong to their mode."""
        return None

    # --- results of the whole mechanism -----------------------------------------------------------
    def multipliers(self, mode: Any, motion: Trajectory | State) -> np.ndarray:
        """Return the multipliers of the whole mechanism (k, m), of a motion or state in a mode."""
        return np.atleast_2d(motion.lam)

    def whole_block(self, mode: Any, block: Block) -> Block:
        """Return outputs in a mode with the multipliers of the whole mechanism."""
        return block

    def whole(self, mode: Any, s: State, impulses: Any = None) -> State:
        """Return a state in a mode as one of the whole mechanism, perhaps with the impulses of an impact."""
        lam = self.multipliers(mode, s)[0]
        return State(self.mechanism, s.t, s.q, s.v, s.a, s.z, lam, s.inputs, s.parameters, s.obstacle, impulses)


class SingleMode(Modes):
    """A mechanism whose equations do not switch."""

    @property
    def free(self) -> Hashable:
        return ""

    def variant(self, mode: Any) -> Mechanism:
        return self.mechanism

    def numeric(self, mode: Any) -> NumericEquations:
        return self.setup.numeric

    def decided(self, state: State, events: Sequence[Event] = (), before: Any = None) -> tuple[Any, State]:
        return self.free, state

    def whole(self, mode: Any, s: State, impulses: Any = None) -> State:
        return s if impulses is None else super().whole(mode, s, impulses)
