"""Functions of positions evaluated for many starts at once, compiled if a C compiler is there."""

from __future__ import annotations

import ctypes

import casadi as ca
import numpy as np

from ..integrators.native import build
from ..numerics.c_code import simplified, tape_of
from ..numerics.evaluation import Evaluator

_LOOP = """
void points({parameters}, double* result, long long count) {{
  double w[{work}];
  for (long long k = 0; k < count; ++k) {{
    const double* arg[] = {{{arguments}}};
    double* res[] = {{result + k * {size}}};
    {name}(arg, res, 0, w, 0);
  }}
}}
"""


class PointFunction:
    """A function with one column as result, at many points.

    Parameters
    ----------
    function : casadi.Function
        ``SX`` function of columns, with one dense column as result.
    """

    def __init__(self, function: ca.Function):
        self._function = function
        self._result = function.numel_out(0)
        using = build.compiler()
        self._library = None if using is None else _compiled(simplified(function), using)
        self._evaluator = None if self._library is not None else Evaluator(function)

    def __reduce__(self) -> tuple[type, tuple[ca.Function]]:
        return type(self), (self._function,)

    def __call__(self, *arguments: np.ndarray) -> np.ndarray:
        """Results (k, rows) of arguments (k, entries) each."""
        given = [np.ascontiguousarray(x, float) for x in arguments]
        if self._evaluator is not None:
            return self._evaluator.rows(*given)[0]
        assert self._library is not None
        found = np.empty((len(given[0]), self._result))
        self._library.points(
            *(ctypes.c_void_p(x.ctypes.data) for x in given),
            ctypes.c_void_p(found.ctypes.data),
            ctypes.c_longlong(len(found)),
        )
        return found


def _compiled(function: ca.Function, using: build.Compiler) -> ctypes.CDLL:
    """Library with a loop over points around the function."""
    tape = tape_of(function)
    sizes = [function.numel_in(k) for k in range(function.n_in())]
    loop = _LOOP.format(
        parameters=", ".join(f"const double* x{k}" for k in range(len(sizes))),
        arguments=", ".join(f"x{k} + k * {size}" for k, size in enumerate(sizes)),
        work=tape.work_in_c + 1,
        size=function.numel_out(0),
        name=tape.name,
    )
    source = f"#include <math.h>\n{tape.as_c}\n{loop}"
    key = "points-" + build.key_of(source, using.identity, *build.FLAGS)
    return build.find(key) or build.build(key, source, "-O2", using)
