"""Solvers of the nonlinear program, one a file; :data:`SOLVERS` lists them."""

from .base import NLPSolver
from .fatrop import Fatrop
from .ipopt import Ipopt

#: Solvers by the name that ``solver=`` takes.
SOLVERS: dict[str, type[NLPSolver]] = {solver.name: solver for solver in (Ipopt, Fatrop)}
