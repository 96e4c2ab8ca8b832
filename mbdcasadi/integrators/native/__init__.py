"""Runs in C around the equations of a mechanism: what the methods of this package share.

===========  =====================================================================================
``stretch``  what is asked of a method, and what it found
``run.c``    the run of any method: evaluation of the equations, projection, records
``cases.c``  many runs
``run``      the engine of a method, from this C and its own, called from Python
``pieces``   runs over pieces of an output grid, in the place of an integrator of CasADi
``runner``   the choice of what runs: compiled or interpreted equations
``code``     equations interpreted, and compiled once that pays
``build``    shared libraries, and the folder in which they are kept
===========  =====================================================================================
"""
