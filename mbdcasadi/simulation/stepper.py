"""The state of one set of equations, and what advances it: the base class of steppers."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np

from ..arguments.inputs import Signals
from ..equations.numeric import NumericEquations
from ..integrators import Integrator
from ..integrators.compiled import IntegrationFailure
from ..model.events import Event
from ..numerics.console import Interruption
from ..numerics.lazy import cached_property
from ..numerics.lending import Lending
from .changes.events import EventWatch
from .formulations import choose_formulation
from .outputs import Outputs
from .path import Path, StatesAt
from .schedule import PIECES, Piece

#: Tolerances of what is integrated to rounding.
PRECISE = (1e-12, 1e-13)


@dataclass(frozen=True, eq=False)
class SteppedSystem:
    """One set of equations in a run, with the method that advances it.

    Attributes
    ----------
    numeric : NumericEquations
        Equations at the parameters of the run.
    signals : Signals
        Inputs.
    levels : numpy.ndarray
        Values of the inputs that are numbers; whoever calls a controller changes them in place.
    integrator : Integrator
        Method and tolerances.
    span : float
        Duration of the run, s.
    redundant : bool
        True if rows are dependent.
    max_step : float or None
        Longest step, s.
    """

    numeric: NumericEquations
    signals: Signals
    levels: np.ndarray
    integrator: Integrator
    span: float
    redundant: bool
    max_step: float | None = None


class Looks(NamedTuple):
    """What a method may look at inside its steps.

    Attributes
    ----------
    watch : EventWatch
        Events.
    decides : callable
        True if the run ends, or goes on otherwise, at an event.
    may_fold : bool
        True if there are singular poses.
    """

    watch: EventWatch
    decides: Callable[[Event], bool]
    may_fold: bool


class Counts(NamedTuple):
    """Starts of a method, its steps in the last piece, and in all pieces."""

    starts: int
    steps: int
    all_steps: int


class Stepper(ABC):
    """Advances the state of one set of equations.

    Attributes
    ----------
    formulation : Formulation
        Form of the equations.
    looks_inside : bool
        True if it finds by itself what happens inside its steps; else a run goes from output to output, and looks
        between them.
    pieces : int
        Pieces into which a run is divided for it.
    """

    looks_inside: ClassVar[bool] = False
    pieces: ClassVar[int] = PIECES

    def __init__(self, system: SteppedSystem, looks: Looks | None):
        self.numeric, self.signals, self.levels = system.numeric, system.signals, system.levels
        self.integrator, self.max_step = system.integrator, system.max_step
        self.formulation = choose_formulation(self.numeric, self.integrator, redundant=system.redundant)

    @cached_property
    def outputs(self) -> Outputs:
        """Outputs in its form of the equations."""
        if self.formulation.tolerates_redundancy:
            return self.tolerant_outputs
        return Outputs(self.numeric, self.signals, self.levels, redundant=False)

    @cached_property
    def tolerant_outputs(self) -> Outputs:
        """Outputs also in singular poses: multipliers are those of least norm."""
        return Outputs(self.numeric, self.signals, self.levels, redundant=True)

    # --- how it ran ---------------------------------------------------------------------------
    @property
    @abstractmethod
    def notes(self) -> list[str]:
        """Sentences on how it ran."""

    @property
    @abstractmethod
    def counts(self) -> Counts:
        """Numbers of its starts and steps."""

    @abstractmethod
    def release(self) -> None:
        """Give back what is kept for later runs of the mechanism, at the end of a run."""

    def note_turning(self, x: np.ndarray) -> None:
        """Take note of states that were reached (k, n_x), whose largest angular velocity matters to some methods."""
        return None

    # --- integrating --------------------------------------------------------------------------
    @abstractmethod
    def advance(
        self,
        piece: Piece,
        x: np.ndarray,
        interruption: Interruption,
        comes_near: Callable[[Path], bool] | None = None,
        stopped: IntegrationFailure | None = None,
    ) -> Path:
        """Integrate over a piece from a consistent state, or up to where something must be decided.

        Parameters
        ----------
        comes_near : callable, optional
            ``path -> bool``: True if a path comes near to a singular pose, at which the integration may end.
        stopped : IntegrationFailure, optional
            Where it ended so before; from there it goes on by other means.

        Raises
        ------
        IntegrationFailure
            With the outputs that were reached.
        KeyboardInterrupt
            On Ctrl-C in compiled code.
        """

    @abstractmethod
    def states_from(self, start: float, x: np.ndarray, *, precise: bool = False) -> StatesAt:
        """Return the function from later times (k,) to projected states (k, n_x), by short integrations.

        Parameters
        ----------
        precise : bool
            True to integrate to rounding.
        """

    @abstractmethod
    def unprojected(self, start: float, x: np.ndarray, times: np.ndarray) -> np.ndarray:
        """States at times after a consistent state as the integrator finds them (k, n_x).

        Raises
        ------
        IntegrationFailure
            If it does not get there.
        """


def lending_of(numeric: NumericEquations) -> Lending:
    """Integrators and runs in C that are kept for a mechanism."""
    return numeric.eom.mechanism.cache.get_or_create("integrators", Lending)
