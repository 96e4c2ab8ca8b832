"""Rows of one interval of a mesh with their labels, and the sizes of everything."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np


@dataclass(frozen=True)
class Rows:
    """A group of equations or limits on one interval.

    Attributes
    ----------
    expression : casadi.SX
        (k,); zero, or not above zero for limits.
    labels : tuple of str
        What each row says, in words.
    share : float
        Where in the interval it holds, 0 to 1.
    scale : numpy.ndarray
        Size of each row by which it is divided (k,).
    equality : bool
        Whether the rows are zero, or stay below it.
    """

    expression: ca.SX
    labels: tuple[str, ...]
    share: float
    scale: np.ndarray
    equality: bool = True


@dataclass(frozen=True)
class Scales:
    """Typical sizes of a mechanism and its motion, from the model.

    Attributes
    ----------
    time : float
        s.
    q, v, a : numpy.ndarray
        Of coordinates and their rates (n,).
    load : numpy.ndarray
        Of the equations of motion, N and N m (n,).
    lam : numpy.ndarray
        Of the multipliers (m,).
    rows : numpy.ndarray
        Of the constraint rows, m or rad (m,).
    z, u : numpy.ndarray
        Of first-order states and inputs.
    """

    time: float
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    load: np.ndarray
    lam: np.ndarray
    rows: np.ndarray
    z: np.ndarray
    u: np.ndarray
