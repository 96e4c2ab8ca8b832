"""Numbers without a pattern, always the same."""

from __future__ import annotations

import math

import numpy as np

#: The number that fractions approximate worst.
GOLDEN_RATIO = (1 + math.sqrt(5)) / 2


def scattered(*shape: int) -> np.ndarray:
    """Return numbers from -1 to 1, evenly distributed and without a pattern.

    They are the fractions of ``k² x`` with x irrational, as Weyl has it. Importing ``numpy.random`` takes longer than
    assembling a four-bar.

    Parameters
    ----------
    *shape : int
        Shape of the array.

    References
    ----------
    Weyl, "Über die Gleichverteilung von Zahlen mod. Eins", Mathematische Annalen 77 (1916) 313.
    """
    k = np.arange(1.0, math.prod(shape) + 1)
    return 2 * (k**2 * GOLDEN_RATIO % 1).reshape(shape) - 1
