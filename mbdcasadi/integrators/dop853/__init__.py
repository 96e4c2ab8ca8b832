"""DOP853, compiled: a whole run in C around the equations of a mechanism.

================  =====================================================
``method``        the strategy object
``steps.c``       steps, projection, dense output, events
``constants``     of the decisions between steps
``coefficients``  of the method, from SciPy
``pieces``        the method over pieces, from starts that may be off the constraints
``runner``        its engine
================  =====================================================

The run in C stands on the room ``native``.
"""

from .method import DOP853

__all__ = ["DOP853"]
