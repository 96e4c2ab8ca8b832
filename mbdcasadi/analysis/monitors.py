"""What must hold along a motion for its elements to mean what they say; told where it does not."""

from __future__ import annotations

import warnings

import casadi as ca
import numpy as np

from ..errors import MechanismWarning
from ..results.trajectory import Trajectory

#: Share of a quantity's size below zero that still counts as zero: an event is located to about that.
ROUNDING = 1e-6


def tell_monitors(motion: Trajectory) -> None:
    """Warn where a monitored quantity of an element is negative at an output, and note it in the statistics.

    Quantities that the analysis does not know (a contact force in kinematics) are left out.
    """
    lam = motion.equations.lam
    known = bool(motion.lam.size) and not bool(np.all(np.isnan(motion.lam)))
    monitors = [m for element in motion.mechanism.elements for m in getattr(element, "monitors", ())]
    monitors = [m for m in monitors if known or not ca.depends_on(m.expression, lam)]
    if not monitors or not motion.t.size:
        return
    values = motion[ca.vertcat(*[m.expression for m in monitors])].reshape(motion.t.size, -1)
    for monitor, course in zip(monitors, values.T, strict=True):
        bad = course < -ROUNDING * (1 + np.max(np.abs(course), initial=0.0))
        if np.any(bad):
            first, worst = float(motion.t[np.argmax(bad)]), float(np.min(course[bad]))
            text = f"{monitor.sentence} (first at t = {first:.6g} s, at worst {worst:.6g})"
            motion.statistics.notes.append(text)
            warnings.warn(text, MechanismWarning, stacklevel=3)
