"""What must hold along a motion for its elements to mean what they say; told where it does not."""

from __future__ import annotations

import warnings

import casadi as ca
import numpy as np

from ..equations.numeric import NumericEquations
from ..errors import MechanismWarning
from ..model.mechanism import Mechanism
from ..model.validity import Monitor
from .columns import has_multipliers
from .trajectory import Trajectory

#: Share of a quantity's size below zero that still counts as zero: an event is located to about that.
ROUNDING = 1e-6


def _monitors(mechanism: Mechanism) -> list[Monitor]:
    return [monitor for element in mechanism.elements for monitor in getattr(element, "monitors", ())]


def _shown(monitor: Monitor) -> ca.SX:
    return monitor.expression if monitor.shown is None else monitor.shown


def broken_at_pose(numeric: NumericEquations, t: float, q: np.ndarray) -> tuple[str, ...]:
    """What is wrong at a pose by the monitors that depend on nothing else."""
    eom = numeric.eom
    others = ca.vertcat(eom.v, eom.a, eom.z, eom.lam, eom.u)
    monitors = [m for m in _monitors(eom.mechanism) if not ca.depends_on(m.expression, others)]
    found = []
    for monitor in monitors:
        value, shown = _at_pose(numeric, ca.vertcat(monitor.expression, _shown(monitor)), t, q).ravel()
        if value < -ROUNDING * (1 + abs(value)):
            unit = f" ({shown:.6g} {monitor.unit} at t = {t:.6g} s)" if monitor.unit else ""
            found.append(monitor.sentence + unit)
    return tuple(found)


def not_still(numeric: NumericEquations, t: float, q: np.ndarray, free: np.ndarray) -> tuple[str, ...]:
    """What turns along free motions (n, k) though the joints should hold it still."""
    eom = numeric.eom
    found = []
    for monitor in _monitors(eom.mechanism):
        if monitor.still is not None and free.size:
            rates = _at_pose(numeric, ca.jacobian(monitor.still, eom.q), t, q) @ free
            if np.max(np.abs(rates)) > ROUNDING * np.max(np.abs(free[2::3]), initial=1.0):
                found.append(monitor.sentence)
    return tuple(found)


def _at_pose(numeric: NumericEquations, expression: ca.SX, t: float, q: np.ndarray) -> np.ndarray:
    eom = numeric.eom
    return ca.Function("pose", [eom.t, eom.q, eom.p], [ca.densify(expression)])(t, q, numeric.p).full()


def tell_monitors(motion: Trajectory) -> None:
    """Warn where a monitored quantity of an element is negative at an output, and note it in the statistics.

    Quantities that the analysis does not know (a contact force in kinematics) are left out.
    """
    known, lam = has_multipliers(motion), motion.equations.lam
    monitors = [m for m in _monitors(motion.mechanism) if known or not ca.depends_on(m.expression, lam)]
    if not monitors or not motion.t.size:
        return
    values = motion[ca.vertcat(*[m.expression for m in monitors])].reshape(motion.t.size, -1)
    shown = motion[ca.vertcat(*[_shown(m) for m in monitors])].reshape(motion.t.size, -1)
    for monitor, course, size in zip(monitors, values.T, shown.T, strict=True):
        bad = course < -ROUNDING * (1 + np.max(np.abs(course), initial=0.0))
        if np.any(bad):
            first, worst = float(motion.t[np.argmax(bad)]), float(size[np.argmin(np.where(bad, course, np.inf))])
            unit = f" {monitor.unit}" if monitor.unit else ""
            text = f"{monitor.sentence} (first at t = {first:.6g} s, at worst {worst:.6g}{unit})"
            motion.statistics.notes.append(text)
            warnings.warn(text, MechanismWarning, stacklevel=3)
