"""Compiled functions on arrays of NumPy, without conversions."""

from __future__ import annotations

import threading
from typing import Any

import casadi as ca
import numpy as np


class Evaluator:
    """A compiled function of expressions, called with arrays and numbers: some microseconds a call.

    A call of a ``casadi.Function`` converts every argument and result, which
    costs more than the evaluation of a mechanism of some bodies. Here they
    pass through buffers, of which each thread has its own.

    Parameters
    ----------
    function : casadi.Function
        Of ``SX`` expressions. Sparse results are filled up with zeros.

    Attributes
    ----------
    function : casadi.Function
        The same, for many points at once.
    """

    def __init__(self, function: ca.Function):
        self.function = function
        self._patterns = [_places(function.sparsity_out(k)) for k in range(function.n_out())]
        self._threads = threading.local()

    def __call__(self, *arguments: Any) -> list[np.ndarray]:
        """Results, each (rows, columns); arguments as vectors or numbers."""
        thread = self._threads
        if not hasattr(thread, "evaluate"):
            self._make_buffers()
        for place, value in zip(thread.arguments, arguments, strict=True):
            place[:] = value
        thread.evaluate()
        results = []
        for flat, (shape, places) in zip(thread.results, self._patterns, strict=True):
            result = np.zeros(shape, order="F")
            result.ravel("F")[places] = flat
            results.append(result)
        return results

    def _make_buffers(self) -> None:
        """Buffers of this thread; they live as long as it does."""
        thread, function = self._threads, self.function
        thread.buffer, thread.evaluate = function.buffer()
        thread.arguments = [np.zeros(function.nnz_in(k)) for k in range(function.n_in())]
        thread.results = [np.zeros(function.nnz_out(k)) for k in range(function.n_out())]
        for k, place in enumerate(thread.arguments):
            thread.buffer.set_arg(k, memoryview(place))
        for k, place in enumerate(thread.results):
            thread.buffer.set_res(k, memoryview(place))


def _places(pattern: ca.Sparsity) -> tuple[tuple[int, int], np.ndarray | slice]:
    """Shape of a result, and places of its entries in it, column after column."""
    if pattern.is_dense():
        return pattern.shape, slice(None)
    rows, columns = (np.array(part, int) for part in pattern.get_triplet())
    return pattern.shape, rows + pattern.size1() * columns
