"""Derivatives of compiled functions, forward in some directions and adjoint."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from ..numerics.console import call


class Compiled:
    """A compiled function and its derivatives, which are kept.

    Parameters
    ----------
    outputs : int, optional
        Number of its outputs, from the first, that are differentiated; by default all.
    """

    def __init__(self, function: ca.Function, outputs: int | None = None):
        self.function = function
        arguments = function.mx_in()
        self._values = function if outputs is None else ca.Function("values", arguments, function(*arguments)[:outputs])
        self._derivatives: dict[tuple[str, int], ca.Function] = {}

    def __call__(self, *arguments: Any) -> Any:
        """Results of the function."""
        return call(self.function, *arguments)

    def changes(self, arguments: Sequence[Any], results: Sequence[Any], *seeds: np.ndarray) -> Any:
        """Return the changes of the results in some directions, side by side.

        Parameters
        ----------
        arguments, results : sequence
            Values of the function at which it is differentiated.
        *seeds : numpy.ndarray
            Directions of the first arguments, side by side; the others do not change.
        """
        f = self._values
        count = seeds[0].shape[1] // f.size2_in(0)
        still = [np.zeros((f.size1_in(k), count * f.size2_in(k))) for k in range(len(seeds), f.n_in())]
        return call(self._derivative("forward", count), *arguments, *results, *seeds, *still)

    def adjoint(self, arguments: Sequence[Any], result: Any, weights: np.ndarray) -> np.ndarray:
        """Return the derivatives of a weighted sum of the first result by the first argument."""
        gradients = call(self._derivative("reverse", 1), *arguments, result, weights)
        return np.asarray(gradients[0].full().ravel())

    def _derivative(self, kind: str, count: int) -> ca.Function:
        if (kind, count) not in self._derivatives:
            self._derivatives[kind, count] = getattr(self._values, kind)(count)
        return self._derivatives[kind, count]


def lengths_of(directions: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return how far forward sensitivities go along directions, for the size of which their results are divided (k,).

    The error test of an integrator compares a derivative with its absolute tolerance, below which a derivative by a
    stiffness of 1e6 N/m would be as a whole: the derivative by its relative change is what counts.

    Parameters
    ----------
    directions : numpy.ndarray
        By column (n, k).
    values : numpy.ndarray
        Values of what changes along them (n,).
    """
    lengths: np.ndarray = np.max(np.abs(directions * values[:, None]), axis=0, initial=1.0)
    return lengths
