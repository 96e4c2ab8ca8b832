"""BDF: backward differentiation formulas in C, for bodies that nothing joins.

===========  =======================================================
``method``   the strategy object
``steps.c``  steps, Newton's iterations, interpolation
``native``   the steps called piece by piece, like CasADi's integrators
===========  =======================================================

The equations, their code and the calls of the engine are those of ``dop853``.
"""

from .method import BDF

__all__ = ["BDF"]
