"""Tolerances that more than one module means, each with a sentence; all are relative, without a unit.

A module that measures something of its own keeps its constant beside its code.
"""

from __future__ import annotations

import numpy as np

#: Rounding of one operation.
EPSILON = float(np.finfo(float).eps)
#: A residual counts as zero below this share of the terms of which it is a difference.
ACCURACY = 1e-13
#: A residual at which an iteration ends counts as zero below this share.
CONVERGED = 1e3 * ACCURACY
#: Singular values of scaled constraints below this share of the largest one are zero.
RANK = 1e-9
#: Singular value below which a pose may be a singular one. Beside such poses Newton's method, whose residual grows
#: with the square of the distance, finds a pose to the root of its accuracy only.
NEARLY_SINGULAR = 1e-6
#: Singular values below this share are left out of a least-norm solution of rows that may depend on each other.
DEPENDENT = 1e-11
#: Value of an expression, relative to the coordinates, and its rate, relative to the velocities, that count as zero.
ZERO_VALUE, AT_REST = 1e-12, 1e-9
#: A number counts as zero, and two as equal, below this share of what they are compared with: what remains of a
#: difference by the rounding of a whole computation.
NEGLIGIBLE = 1e-9
#: A condition counts as met, and two results as the same, up to this share of the sizes in them: errors of integrators,
#: of solvers and of events that were located are below it.
MET = 1e-6
#: Residual of a constraint, relative to 1 + |q|, that is rounding, and steps of Newton's method that bring it there, at
#: most.
ON_CONSTRAINTS, PROJECTIONS = 1e-14, 10
#: Tolerance of an integration that is exact beside others, and the error that it makes; 1e-12 takes it to rounding.
INTEGRATION = 1e-11
#: Smallest share of a step that a line search tries.
SMALLEST_SHARE = 1e-4
