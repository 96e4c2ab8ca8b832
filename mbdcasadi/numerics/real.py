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
        For anything but real numbers.
    """
    array = np.asarray(values)
    if array.dtype.kind == "c":
        raise TypeError("complex numbers")
    return np.asarray(array, float)


def distinct(values: np.ndarray) -> np.ndarray:
    """Return the different ones of some numbers, in order.

    The same as ``numpy.unique``, whose first call imports further modules.
    """
    ordered = np.sort(values)
    return ordered[np.append(True, ordered[1:] != ordered[:-1])] if ordered.size else ordered


def stretches(mask: np.ndarray) -> list[slice]:
    """Return the stretches in which a mask (k,) is true."""
    edges = np.flatnonzero(np.diff(np.r_[False, mask, False].astype(int)))
    return [slice(begin, end) for begin, end in edges.reshape(-1, 2).tolist()]
