"""DOP853, compiled: a whole run in C around the equations of a mechanism.

======================  ====================================================================
``method``              the strategy object
``stretch``             what is asked of the method, and what it found
``engine.c``            steps, projection, dense output, events
``coefficients``        of the method, from SciPy
``native``              the engine called from Python
``stepwise``            the same without a compiler: a step is one CasADi function
``code``                equations interpreted, and compiled once that pays
``build``               shared libraries, and the folder in which they are kept
======================  ====================================================================
"""

from .method import DOP853

__all__ = ["DOP853"]
