"""Functions of an angle that repeat every turn: radii of outlines and lifts of followers, checked where they enter."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from ...errors import ExpressionError, ModelError
from ..quantities import function_of, quantity
from ..symbols import describe, varying_in
from .curves import values_over
from .motion_programs import MotionProgram
from .splines import closed_spline

TURN = 2 * np.pi


def polar_law(radius: Any, angles: Any) -> Callable[[ca.SX], Any]:
    if callable(radius):
        if angles is not None:
            raise ModelError("CamOutline: angles= goes with values of the radius, not with a function")
        return every_turn(radius, "radius")
    if isinstance(radius, ca.SX) or np.ndim(radius) == 0:
        value = quantity(radius, "CamOutline", "radius", above=0.0)
        return lambda _angle: value
    try:
        radii = np.array(radius, dtype=float)
        places = np.linspace(0, TURN, len(radii), endpoint=False) if angles is None else np.array(angles, float)
    except (TypeError, ValueError, RuntimeError):
        raise ModelError(f"CamOutline: radius and angles must be numbers, got {radius!r}") from None
    if places.shape != radii.shape:
        raise ModelError(f"CamOutline: {radii.size} radii do not go with {places.size} angles")
    if places.size and places[-1] - places[0] >= TURN * (1 - 1e-9):
        raise ModelError("CamOutline: the angles go round once or more; leave out the point that repeats the first")
    xs, ys = np.r_[places, places[:1] + TURN], np.r_[radii, radii[:1]]
    _check_data(xs, ys)
    return lambda angle: closed_spline(angle, xs, ys)


def _check_data(xs: np.ndarray, ys: np.ndarray) -> None:
    """Raise where values over angles make no closed curve."""
    if len(xs) < 6:
        raise ModelError(f"CamOutline: takes at least 5 values of the radius, got {len(xs) - 1}")
    if not np.all(np.isfinite(np.r_[xs, ys])):
        raise ModelError("CamOutline: radii and angles must be finite")
    if np.any(np.diff(xs) <= 0):
        k = int(np.argmax(np.diff(xs) <= 0))
        raise ModelError(f"CamOutline: the angles must increase, got {xs[k]:.6g} and {xs[k + 1]:.6g}")


def lift_law(program: Any) -> Callable[[ca.SX], ca.SX]:
    """Lift over the cam's angle, repeated every turn."""
    if isinstance(program, MotionProgram):
        if abs(program.duration - TURN) > 1e-9:
            raise ModelError(
                f"CamOutline: the program of a cam goes over one turn, 2π = {TURN:.9g} rad, and this one over "
                f"{program.duration:.9g}"
            )
        return program
    if not callable(program):
        raise ModelError(f"CamOutline: program must be a MotionProgram or a function of the angle, got {program!r}")
    return every_turn(program, "program")


def every_turn(law: Callable[[ca.SX], Any], name: str) -> Callable[[ca.SX], ca.SX]:
    """A function of an angle from 0 to 2π, repeated every turn; as it is, where it repeats itself."""
    symbol = ca.SX.sym("angle")
    value = ca.SX(quantity(function_of(law, "CamOutline", name, "the angle")(symbol), "CamOutline", name))
    if varying := varying_in(value, besides=symbol):
        raise ExpressionError(f"CamOutline: {name} may hold parameters only, not {describe(varying[0])}")
    places = np.linspace(0, TURN, 37)
    here, later = (values_over(value, symbol, places + turn) for turn in (0.0, 3 * TURN))
    if np.allclose(here, later, rtol=1e-11, atol=0):
        return lambda angle: ca.substitute(value, symbol, angle)
    ends = values_over(ca.vertcat(value, ca.jacobian(value, symbol)), symbol, np.array([0.0, TURN]))
    if not np.allclose(ends[:, 0], ends[:, 1], rtol=0, atol=1e-6 * np.max(np.abs(here))):
        raise ModelError(
            f"CamOutline: the {name} does not close: it is {ends[0, 0]:.6g} m with the slope {ends[1, 0]:.4g} m/rad "
            f"at 0 and {ends[0, 1]:.6g} m with {ends[1, 1]:.4g} m/rad at 2π"
        )
    return lambda angle: ca.substitute(value, symbol, angle - TURN * ca.floor(angle / TURN))
