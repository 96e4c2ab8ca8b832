"""Compiled functions on arrays of NumPy, without conversions."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

#: Number of points that one evaluation takes: a batch is made up of these.
BATCHES = (64, 16, 4, 1)
#: Instructions of a function up to which the last evaluation may take more points than are asked for: each of these
#: costs less than a call.
SHORT = 1000


class Evaluator:
    """A compiled function of expressions, called with arrays and numbers: some microseconds a call.

    A call of a ``casadi.Function`` converts every argument and result, about 0.1 µs a number, which
    costs more than the evaluation of a mechanism of some bodies. Here they
    pass through buffers, of which each thread has its own.

    Parameters
    ----------
    function : casadi.Function
        Of ``SX`` expressions. Sparse results are filled up with zeros.

    Attributes
    ----------
    function : casadi.Function
        Function that is evaluated at many points at once.
    """

    def __init__(self, function: ca.Function):
        self.function = function
        self._patterns = [_places(function.sparsity_out(k)) for k in range(function.n_out())]
        self._is_short = function.n_instructions() <= SHORT
        self._threads = threading.local()

    def __reduce__(self) -> tuple[type, tuple[ca.Function]]:
        return type(self), (self.function,)

    def __call__(self, *arguments: Any) -> list[np.ndarray]:
        """Results, each (rows, columns); arguments as vectors or numbers."""
        buffers = self._buffers(1)
        for place, value in zip(buffers.arguments, arguments, strict=True):
            place[0] = value
        buffers.evaluate()
        results = []
        for flat, (shape, places) in zip(buffers.results, self._patterns, strict=True):
            if isinstance(places, slice):
                results.append(flat[0].reshape(shape, order="F").copy(order="F"))
                continue
            result = np.zeros(shape, order="F")
            result.ravel("F")[places] = flat[0]
            results.append(result)
        return results

    def rows(self, *arguments: Any) -> list[np.ndarray]:
        """Results at many points by row, each (k, rows * columns), column after column.

        Parameters
        ----------
        *arguments : array_like
            Each (k, entries) by row, the first one so; others also (entries,), for the same at all points.
        """
        points = [np.atleast_2d(np.asarray(argument, float)) for argument in arguments]
        count = len(points[0])
        results = [np.zeros((count, shape[0] * shape[1])) for shape, _ in self._patterns]
        start = 0
        while start < count:
            buffers = self._buffers(self._batch(count - start))
            used = min(buffers.size, count - start)
            chosen = slice(start, start + used)
            for place, value in zip(buffers.arguments, points, strict=True):
                place[:used] = value[chosen] if len(value) == count else value
            buffers.evaluate()
            for result, values, (_, places) in zip(results, buffers.results, self._patterns, strict=True):
                result[chosen, places] = values[:used]
            start += used
        return results

    def _batch(self, rest: int) -> int:
        """Number of points of the next evaluation if so many are left: more than these if they cost less than calls."""
        within = next(size for size in BATCHES if size <= rest)
        above = min((size for size in BATCHES if size >= rest), default=within)
        return above if self._is_short and above < 2 * rest else within

    def _buffers(self, size: int) -> _Buffers:
        """Buffers of this thread for so many points; they live as long as it does."""
        try:
            kept: dict[int, _Buffers] = self._threads.kept
        except AttributeError:
            kept = self._threads.kept = {}
        if size not in kept:
            kept[size] = _Buffers(self.function, size)
        return kept[size]


class _Buffers:
    """A function of some points with places for its arguments and results, each (points, entries)."""

    def __init__(self, function: ca.Function, size: int):
        self.size = size
        mapped = function if size == 1 else function.map(size)
        evaluate: Callable[[], None]
        self._buffer, evaluate = mapped.buffer()
        self.evaluate = evaluate
        self.arguments = [np.zeros((size, function.nnz_in(k))) for k in range(function.n_in())]
        self.results = [np.zeros((size, function.nnz_out(k))) for k in range(function.n_out())]
        for k, place in enumerate(self.arguments):
            self._buffer.set_arg(k, place.reshape(-1).data)
        for k, place in enumerate(self.results):
            self._buffer.set_res(k, place.reshape(-1).data)


def by_buffers(
    function: ca.Function, arguments: Mapping[str, np.ndarray], results: Sequence[str]
) -> tuple[list[np.ndarray], dict[str, Any]]:
    """Evaluate any compiled function once, without conversions of its arguments and results.

    Parameters
    ----------
    function : casadi.Function
        With dense arguments and results.
    arguments : mapping of str to numpy.ndarray
        Arguments by name (rows, columns); those that are left out are zero.
    results : sequence of str
        Names of results.

    Returns
    -------
    results : list of numpy.ndarray
        Each by column (columns, rows).
    statistics : dict
        Statistics of the call.

    Raises
    ------
    RuntimeError
        If the evaluation fails.
    """
    buffer, evaluate = function.buffer()
    given = [np.ascontiguousarray(values.T, dtype=float) for values in arguments.values()]
    for name, values in zip(arguments, given, strict=True):
        buffer.set_arg(function.index_in(name), values.reshape(-1).data)
    found = [np.zeros((function.size2_out(name), function.size1_out(name))) for name in results]
    for name, values in zip(results, found, strict=True):
        if values.size:
            buffer.set_res(function.index_out(name), values.reshape(-1).data)
    evaluate()
    if buffer.ret():
        raise RuntimeError(f"{function.name()}: Evaluation failed")
    return found, buffer.stats()


def _places(pattern: ca.Sparsity) -> tuple[tuple[int, int], np.ndarray | slice]:
    """Shape of a result, and places of its entries in it, column after column."""
    if pattern.is_dense():
        return pattern.shape, slice(None)
    rows, columns = (np.array(part, int) for part in pattern.get_triplet())
    return pattern.shape, rows + pattern.size1() * columns
