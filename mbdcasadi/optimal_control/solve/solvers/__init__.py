"""Solvers of the nonlinear program, one a file; :data:`SOLVERS` lists them."""

from ....errors import ModelError
from ...program.setup import Settings
from .base import Elsewhere, NLPSolver
from .fatrop import Fatrop
from .ipopt import Ipopt

#: Solvers by the name that ``solver=`` takes.
SOLVERS: dict[str, type[NLPSolver]] = {solver.name: solver for solver in (Ipopt, Fatrop)}


def make_solver(settings: Settings, elsewhere: Elsewhere | None = None) -> NLPSolver:
    """Return the solver of programs that a user chose, which runs on an executor if one is given."""
    if settings.solver not in list(SOLVERS):
        raise ModelError(f"optimize: solver must be one of {', '.join(SOLVERS)}, got {settings.solver!r}")
    return SOLVERS[settings.solver](settings.options, settings.progress, elsewhere)
