"""Iterations that solves of a search may take, by what they are for.

Most programs take far fewer; one that takes more is often solved sooner from elsewhere.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Budgets:
    """Largest numbers of iterations of single solves.

    Attributes
    ----------
    first : int
        The problem itself from a first guess.
    further : int
        From another guess, once a solution is known.
    order : int
        In the phases of an order of stick, slip and touch that was read off.
    variant : int
        Without limits.
    closing : int
        The problem itself from a motion of a variant.
    violation : int
        Least violation of all demands.
    price : int
        Violations at a price beside the cost.
    finer : int
        On a finer mesh from the solution on a coarser one.
    fine : int
        On a fine mesh from the solution on a coarse one.
    """

    first: int = 300
    further: int = 150
    order: int = 200
    variant: int = 200
    closing: int = 150
    violation: int = 300
    price: int = 100
    finer: int = 600
    fine: int = 30


BUDGETS = Budgets()
