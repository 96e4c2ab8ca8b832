"""Functions of positions, evaluated for many starts at once, compiled if a C compiler is there."""

from __future__ import annotations

import ctypes

import casadi as ca
import numpy as np

from ..integrators.native import build
from ..numerics.c_code import simplified, tape_of
from ..numerics.evaluation import Evaluator

_LOOP = """
void points({parameters}, const long long* by, double* sums, double* rest, long long starts, long long positions) {{
  double w[{work}], all[{size}];
  for (long long s = 0; s < starts; ++s)
    for (long long k = 0; k < positions; ++k) {{
      const double* arg[] = {{{arguments}}};
      double* res[] = {{all}};
      {name}(arg, res, 0, w, 0);
      for (int i = 0; i < {summed}; ++i) sums[s * {summed} + i] += all[i];
      for (int i = {summed}; i < {size}; ++i) *rest++ = all[i];
    }}
}}
"""


class PointFunction:
    """A function with one column as result, at some positions of many starts.

    Parameters
    ----------
    function : casadi.Function
        ``SX`` function of columns, with one dense column as result.
    summed : int, default 0
        Number of results, the first ones, that are summed over the positions of a start.
    """

    def __init__(self, function: ca.Function, summed: int = 0):
        self._function, self._summed = function, summed
        using = build.compiler()
        self._library = None if using is None else _compiled(simplified(function), summed, using)
        self._evaluator = None if self._library is not None else Evaluator(function)

    def __reduce__(self) -> tuple[type, tuple[ca.Function, int]]:
        return type(self), (self._function, self._summed)

    def __call__(self, *arguments: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Sums (starts, summed) and other results (starts, positions, rest), of arguments that are broadcast to
        (starts, positions, entries)."""
        starts, positions = np.broadcast_shapes(*(x.shape[:2] for x in arguments))
        given = [np.broadcast_to(np.ascontiguousarray(x, float), (starts, positions, x.shape[2])) for x in arguments]
        size, summed = self._function.numel_out(0), self._summed
        if self._evaluator is not None:
            flat = [np.ascontiguousarray(x).reshape(starts * positions, -1) for x in given]
            found = self._evaluator.rows(*flat)[0].reshape(starts, positions, size)
            return found[..., :summed].sum(axis=1), found[..., summed:]
        assert self._library is not None
        sums, rest = np.zeros((starts, summed)), np.empty((starts, positions, size - summed))
        by = np.array([stride // sums.itemsize for x in given for stride in x.strides[:2]], np.int64)
        self._library.points(
            *(ctypes.c_void_p(x.ctypes.data) for x in (*given, by, sums, rest)),
            *map(ctypes.c_longlong, (starts, positions)),
        )
        return sums, rest


def _compiled(function: ca.Function, summed: int, using: build.Compiler) -> ctypes.CDLL:
    """Library with a loop over points around the function."""
    tape = tape_of(function)
    given = range(function.n_in())
    loop = _LOOP.format(
        parameters=", ".join(f"const double* x{k}" for k in given),
        arguments=", ".join(f"x{k} + s * by[{2 * k}] + k * by[{2 * k + 1}]" for k in given),
        work=tape.work_in_c + 1,
        size=function.numel_out(0),
        summed=summed,
        name=tape.name,
    )
    source = f"#include <math.h>\n{tape.as_c}\n{loop}"
    key = "points-" + build.key_of(source, using.identity, *build.FLAGS)
    return build.find(key) or build.build(key, source, "-O2", using)
