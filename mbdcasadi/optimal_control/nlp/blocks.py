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
    """Scaled variables and data of one interval, and what they stand for.

    Attributes
    ----------
    variables, free, data : casadi.SX
        Scaled variables without the free parameters, those, and the data.
    interval : Interval
        In physical units.
    integrals, next_integrals : casadi.SX
        Integrals up to the mesh points before and after.
    extra : casadi.SX
        Free parameters that the mechanism does not have.
    """

    variables: ca.SX
    free: ca.SX
    data: ca.SX
    interval: Interval
    integrals: ca.SX
    next_integrals: ca.SX
    extra: ca.SX


@dataclass(frozen=True)
class Block:
    """Rows of one kind, and their part of the program.

    Attributes
    ----------
    piece : MappedBlock
        Expressions and places of the variables.
    groups : list of Rows
        Rows of one copy.
    copies : tuple
        For each copy the intervals that it sees, as (phase, interval); its rows stand on the last one.
    repeated : bool
        True if every interval has a copy.
    """

    piece: MappedBlock
    groups: list[Rows]
    copies: tuple[tuple[tuple[int, int], ...], ...]
    repeated: bool = False


@dataclass(frozen=True)
class Edge:
    """Start or end of a phase in the program.

    Attributes
    ----------
    unknowns : Unknowns
        Variables of the interval beside it.
    at : CollocationPoint
        State there.
    index : numpy.ndarray
        Places of the variables (k, 1).
    interval : tuple of int
        Phase and interval.
    """

    unknowns: Unknowns
    at: CollocationPoint
    index: np.ndarray
    interval: tuple[int, int]
