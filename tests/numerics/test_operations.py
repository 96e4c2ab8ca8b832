"""The table of operations: its columns agree with the operations of CasADi."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from mbdcasadi.errors import MechanismError
from mbdcasadi.numerics.operations import OPERATIONS, border_of, operation_name

POINTS = [(0.3, 0.7), (-0.45, 0.2), (2.5, -1.5), (-1.7, -0.6), (3.2, 0.9)]
BROKEN = [op for op, known in OPERATIONS.items() if known.border and (known.held or known.rounded)]


@pytest.mark.parametrize("kind", BROKEN, ids=operation_name)
def test_values_on_either_side_of_the_border(kind):
    """What is held on the side of a point, or rounded with a width of zero, has the value of the operation there."""
    known = OPERATIONS[kind]
    for x, y in POINTS:
        value = float(ca.SX.binary(kind, x, y))  # of operations on one number the second is not read
        w = float(border_of(kind, [ca.SX(x), ca.SX(y)]))
        if known.held:
            side = np.floor(w) if known.whole else float(w > 0)
            assert float(known.held(ca.SX(x), ca.SX(y), ca.SX(side))) == pytest.approx(value, abs=1e-14)
        if known.rounded:
            assert float(known.rounded(ca.SX(x), ca.SX(y), ca.SX(w), ca.SX(abs(w)))) == pytest.approx(value, abs=1e-14)


def test_a_smooth_operation_has_no_border():
    with pytest.raises(MechanismError, match="'sin' is smooth"):
        border_of(ca.OP_SIN, [ca.SX(1)])
