"""Independent coordinates: which of them describe a motion on the constraints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..equations.numeric import NumericEquations
from ..errors import ExpressionError, ModelError
from ..model.quantities import entries
from ..model.symbols import as_expression, role_of, symbols_of
from ..model.texts import text_of
from ..numerics.rank import analyse_rank
from ..results.state import State

#: Angles are taken before displacements that say about as much: small motions about a rotation are steady in them.
PREFER_ANGLES = 4.0


@dataclass(frozen=True)
class Independent:
    """Independent coordinates and rates.

    Attributes
    ----------
    positions, rates : casadi.SX
        ``w`` and ``y``; without velocity-level rows ``y`` is the rate of ``w``.
    position_rate, acceleration : casadi.SX
        Rates of ``w`` and of ``y``.
    names : tuple of str
        Of ``w``, then of ``y``.
    """

    positions: ca.SX
    rates: ca.SX
    position_rate: ca.SX
    acceleration: ca.SX
    names: tuple[str, ...]


def independent(
    numeric: NumericEquations, state: State, chosen: Any, *, analysis: str = "linearize", argument: str = "coordinates="
) -> Independent:
    """Coordinates as the user chose them, or those of the bodies that describe the motion best."""
    eom = numeric.eom
    rows = [int(k) for k in eom.position_rows]
    jacobian = numeric.jacobian(state.t, state.q)
    if chosen is not None:
        expressions = [as_expression(c, argument) for c in entries(chosen, argument)]
        _check_chosen(expressions, analysis)
        w = ca.vertcat(ca.SX(0, 1), *expressions)
        wanted = eom.q.numel() - analyse_rank(numeric.scale.scaled(jacobian)).rank
        if w.numel() != wanted:
            raise ModelError(
                f"{analysis}: {argument} holds {w.numel()} expressions, and the mechanism has {wanted} "
                "degrees of freedom"
            )
        names = [text_of(e) for e in expressions]
        return _complete(eom, w, _rate(eom, w), [*names, *(f"d/dt {name}" for name in names)])
    scaled = numeric.scale.scaled(jacobian)
    at_position = _pivots(scaled[rows], numeric)
    at_velocity = _pivots(scaled, numeric) if len(rows) < len(jacobian) else at_position
    names = [eom.coordinate_names[k] for k in at_position]
    names += [ca.vertsplit(eom.v)[k].name() for k in at_velocity]
    return _complete(eom, eom.q[at_position], eom.v[at_velocity], names)


def _rate(eom: Any, expression: ca.SX) -> ca.SX:
    return ca.jtimes(expression, eom.q, eom.v) + ca.jacobian(expression, eom.t)


def _complete(eom: Any, w: ca.SX, y: ca.SX, names: Sequence[str]) -> Independent:
    acceleration = _rate(eom, y) + ca.jtimes(y, eom.v, eom.a)
    return Independent(ca.densify(w), ca.densify(y), ca.densify(_rate(eom, w)), ca.densify(acceleration), tuple(names))


def _pivots(jacobian: np.ndarray, numeric: NumericEquations) -> list[int]:
    """Coordinates that fix all others, by pivoting on the null space of the constraints."""
    null = analyse_rank(jacobian).null_columns.copy()
    weight = np.where(numeric.eom.angles, PREFER_ANGLES, 1.0)
    chosen: list[int] = []
    for _ in range(null.shape[1]):
        size = np.linalg.norm(null, axis=1) * weight
        size[chosen] = 0.0
        pivot = int(np.argmax(size > (1 - 1e-9) * np.max(size)))
        row = null[pivot] / np.linalg.norm(null[pivot])
        null = null - np.outer(null @ row, row)
        chosen.append(pivot)
    return sorted(chosen)


def _check_chosen(expressions: Sequence[ca.SX], analysis: str) -> None:
    for expression in expressions:
        for symbol in symbols_of(expression):
            role = role_of(symbol)
            if role is None or role.kind not in ("position", "parameter", "time"):
                raise ExpressionError(
                    f"{analysis}: the coordinate {text_of(expression)} must be an expression in positions; "
                    f"it holds {symbol.name()}"
                )
