"""Coefficients of the method as C code, from SciPy.

The functions leave out what is zero: ``combine_3`` is ``out = y + h sum(a_3j k_j)``.

References
----------
Hairer, Nørsett and Wanner, *Solving Ordinary Differential Equations I*, 2nd ed., Springer 1993, section II.5.
"""

from __future__ import annotations

import sys
from functools import cache
from importlib import import_module
from importlib.util import find_spec, module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

import numpy as np

#: Stages of a step; the derivative at its end is that of the next step's start.
STAGES = 12
#: Order of the error estimate plus one.
EXPONENT = 8


@cache
def coefficients() -> Any:
    """The module of SciPy with the coefficients; loaded without its package, which takes long to import."""
    name = "scipy.integrate._ivp.dop853_coefficients"
    scipy = find_spec("scipy")
    folder = (scipy.submodule_search_locations or [""])[0] if scipy is not None else ""
    spec = spec_from_file_location(name, Path(folder, *name.split(".")[1:]).with_suffix(".py"))
    if name in sys.modules or spec is None or spec.loader is None or not Path(str(spec.origin)).exists():
        return import_module(name)
    module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@cache
def coefficients_in_c() -> str:
    """Exponent, nodes and linear combinations as C functions."""
    c = coefficients()
    nodes = ", ".join(repr(float(x)) for x in c.C)
    parts = [f"#define EXPONENT {float(EXPONENT)}\nstatic const double NODES[] = {{{nodes}}};\n"]
    for stage in (*range(1, STAGES), *range(STAGES + 1, len(c.C))):
        parts.append(_combination(str(stage), c.A[stage], "y[i] + h * ({})", "double h, const double* y, "))
    parts.append(_combination("step", c.B, "y[i] + h * ({})", "double h, const double* y, "))
    for row in range(4):
        parts.append(_combination(f"dense_{row + 3}", c.D[row], "h * ({})", "double h, "))
    parts.append(_combination("fifth", c.E5, "{}", "", stride="n_y"))
    parts.append(_combination("third", c.E3, "{}", "", stride="n_y"))
    return "\n".join(parts)


def _combination(name: str, row: np.ndarray, formula: str, more: str, stride: str = "n") -> str:
    terms = [f"{float(a)!r} * k[{j} * {stride} + i]" for j, a in enumerate(row) if a]
    body = formula.format(" + ".join(terms))
    signature = f"integer n, {'integer n_y, ' if stride != 'n' else ''}{more}const double* k, double* restrict out"
    return (
        f"CLONES static void combine_{name}({signature}) {{\n  for (integer i = 0; i < n; ++i) out[i] = {body};\n}}\n"
    )
