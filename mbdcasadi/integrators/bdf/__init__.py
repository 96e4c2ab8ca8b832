"""BDF: backward differentiation formulas in C, for bodies that no joint holds.

===========  =======================================================
``method``   the strategy object
``steps.c``  steps, Newton's iterations, interpolation
``pieces``   the method over pieces
===========  =======================================================

The run in C stands on the room ``native``.
"""

from .method import BDF

__all__ = ["BDF"]
