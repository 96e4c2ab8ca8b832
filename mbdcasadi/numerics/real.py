"""Arrays of real numbers."""

from __future__ import annotations

from typing import Any

import numpy as np


def real_array(values: Any) -> np.ndarray:
    """Return values as an array of floats.

    NumPy drops the imaginary part of complex arrays.

    Raises
    ------
    TypeError, ValueError
        For what are not numbers, and for complex ones.
    """
    found = np.asarray(values)
    if found.dtype.kind == "c":
        raise TypeError("complex numbers")
    return np.asarray(found, float)
