"""The choice of what advances a run."""

from __future__ import annotations

from ...integrators import Integrator
from ..stepper import Stepper
from .compiled_stepper import CompiledStepper
from .whole_stepper import WholeStepper


def kind_of_stepper(integrator: Integrator) -> type[Stepper]:
    """Return the class of what advances a run by a method."""
    return CompiledStepper if integrator.whole_run is None else WholeStepper
