"""Parts of the program: the unknowns of an interval, rows of one kind, an end of a phase."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from ..transcription.points import CollocationPoint, Interval
from .rows import Rows
from .sparse_program import MappedBlock


@dataclass(frozen=True)
class Unknowns:
    """Scaled variables and data of one interval, and what they stand for."""

    #: without the free parameters
    variables: ca.SX
    free: ca.SX
    data: ca.SX
    #: in physical units
    interval: Interval
    #: up to the mesh points before and after
    integrals: ca.SX
    next_integrals: ca.SX
    #: free parameters that the mechanism does not have
    extra: ca.SX


@dataclass(frozen=True)
class Block:
    """Rows of one kind, and their part of the program."""

    piece: MappedBlock
    #: rows of one copy
    groups: list[Rows]
    #: for each copy the intervals that it sees, as (phase, interval); its rows stand on the last one
    copies: tuple[tuple[tuple[int, int], ...], ...]
    #: whether every interval has a copy
    repeated: bool = False


@dataclass(frozen=True)
class Edge:
    """Start or end of a phase in the program."""

    #: of the interval beside it
    unknowns: Unknowns
    at: CollocationPoint
    #: places of the variables (k, 1)
    index: np.ndarray
    #: phase and interval
    interval: tuple[int, int]
