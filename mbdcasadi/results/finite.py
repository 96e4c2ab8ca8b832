"""Values that are NaN though everything they depend on is finite."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from ..equations import Equations
from ..errors import ExpressionError
from ..model.symbols import symbols_of
from ..model.texts import text_of


def refuse_nan(eom: Equations, expression: ca.SX, values: np.ndarray, arguments: Sequence[np.ndarray]) -> None:
    """Raise an error if an expression is NaN at a state although all that it depends on is finite.

    Unknown quantities may be NaN: the multipliers of a kinematic analysis. The values have the time first; the
    arguments ``t, q, v, a, z, lam, u, p`` are (n_t, k), or (1, k) if constant.
    """
    missing = np.isnan(values)
    if not missing.any():
        return
    at = np.flatnonzero(missing.reshape(len(values), -1).any(axis=1))
    used = {symbol.element_hash() for symbol in symbols_of(expression)}
    for group, values_of in zip(eom.symbols, arguments, strict=True):
        columns = [k for k, symbol in enumerate(ca.vertsplit(group)) if symbol.element_hash() in used]
        known = np.isfinite(values_of[:, columns]).all(axis=1)
        at = at[np.broadcast_to(known, (len(values),))[at]]
    if at.size:
        t = float(arguments[0][at[0], 0])
        text = text_of(expression) if expression.numel() == 1 else f"an expression of shape {expression.shape}"
        text = text if len(text) <= 100 else text[:97] + "..."
        raise ExpressionError(
            f"{text} is not finite at t = {t:.6g} s, though all that it depends on is finite: a spline "
            'or a table with outside="error" is evaluated beyond its data, or a function (sqrt, log, quotient) has no '
            "value",
            time=t,
        )
