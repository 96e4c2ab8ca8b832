"""Programs of a problem, kept for the next solve and shared among threads."""

from __future__ import annotations

from ...model.cache import Cache

#: Programs of a problem that are kept: those of the meshes of a refinement, and some more.
PROGRAMS = 24
#: Setups and ranks of conditions that are kept: one for each set of parameter values.
SETUPS = 4
#: Sets of options for which the solver of a program is kept as it travels to workers.
OPTION_SETS = 8


class CompiledProblem:
    """Programs of a problem and what they are made of, each made once and used by all solves.

    It belongs to the problem and is released with it; only the most recent entries are kept.
    Any number of threads may use it.
    """

    def __init__(self) -> None:
        #: programs by what decides them besides the problem
        self.programs = Cache(PROGRAMS)
        #: setups of phases whose start is a state, by settings and parameter values
        self.setups = Cache(SETUPS)
        #: ranks of conditions, by phase and parameter values
        self.ranks = Cache(SETUPS)
