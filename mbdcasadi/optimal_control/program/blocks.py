"""Parts of the program: the unknowns of an interval, rows of one kind, an end of a phase."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ..transcription.points import CollocationPoint, Interval
from ..transcription.rows import Rows, stack
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


def block_of_edges(
    edges: Sequence[Edge],
    groups: list[Rows],
    p: ca.SX,
    free_index: np.ndarray,
    cost: ca.SX | None = None,
    others: tuple[ca.SX, np.ndarray] | None = None,
) -> Block:
    """Return the block of rows that see ends of phases, and perhaps other variables; they stand at the last end."""
    symbols, places = (ca.SX(0, 1), np.zeros(0, int)) if others is None else others
    variables = ca.vertcat(*[edge.unknowns.variables for edge in edges], symbols, edges[0].unknowns.free)
    index = np.concatenate([*[edge.index.ravel() for edge in edges], places, free_index])[:, None]
    data = ca.vertcat(*[edge.unknowns.data for edge in edges])
    piece = MappedBlock(variables, data, p, stack(groups), ca.SX(0) if cost is None else cost, index)
    return Block(piece, [g for g in groups if g.owners], (tuple(edge.interval for edge in edges),))
