"""Validity conditions of the elements of a mechanism, evaluated at the outputs of a motion."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from ..equations.numeric import NumericEquations
from ..errors import warn
from ..model.mechanism import Mechanism
from ..model.validity import ValidityCondition
from ..numerics.tolerances import MET
from .columns import has_multipliers
from .ranges import Ranges
from .state import State
from .trajectory import Trajectory

#: Findings that are warned of one by one; more are one warning.
MOST_WARNINGS = 3


def validity_conditions(mechanism: Mechanism) -> tuple[ValidityCondition, ...]:
    """Conditions of all elements of a mechanism."""
    return mechanism.cache.get_or_create(
        "validity conditions",
        lambda: tuple(c for element in mechanism.elements for c in getattr(element, "validity_conditions", ())),
    )


def report_exceeded_limits(motion: Trajectory | State, analysis: str) -> None:
    """Warn of inputs of a motion or state that are beyond their limits, which an analysis does not hold."""
    for u, values in zip(motion.mechanism.inputs, np.atleast_2d(motion.inputs).T, strict=True):
        slack = 1e-6 * (1 + np.max(np.abs(values), initial=0.0))
        if np.any(values < u.lower - slack) or np.any(values > u.upper + slack):
            warn(
                f"input '{u.label}' goes from {values.min():.6g} to {values.max():.6g}, beyond its limits "
                f"{u.lower:.6g} … {u.upper:.6g}; {analysis} does not hold limits"
            )


def broken_at_pose(numeric: NumericEquations, t: float, q: np.ndarray) -> tuple[str, ...]:
    """Messages of the conditions that are broken at a pose, of those that depend on nothing else."""
    eom = numeric.eom
    others = ca.vertcat(eom.v, eom.a, eom.z, eom.lam, eom.u)
    messages = []
    for condition in validity_conditions(eom.mechanism):
        if ca.depends_on(condition.expression, others):
            continue
        value, shown = _at_pose(numeric, ca.vertcat(condition.expression, condition.reported), t, q).ravel()
        if value < -MET * (1 + abs(value)):
            unit = f" ({shown:.6g} {condition.unit} at t = {t:.6g} s)" if condition.unit else ""
            messages.append(condition.message + unit)
    return tuple(messages)


def changing_quantities(numeric: NumericEquations, t: float, q: np.ndarray, free: np.ndarray) -> tuple[str, ...]:
    """Messages of the conditions whose fixed quantities change along free motions (n, k)."""
    eom = numeric.eom
    messages = []
    for condition in validity_conditions(eom.mechanism):
        if condition.fixed is not None and free.size:
            rates = _at_pose(numeric, ca.jacobian(condition.fixed, eom.q), t, q) @ free
            if np.max(np.abs(rates)) > MET * np.max(np.abs(free[2::3]), initial=1.0):
                messages.append(condition.message)
    return tuple(messages)


def _at_pose(numeric: NumericEquations, expression: ca.SX, t: float, q: np.ndarray) -> np.ndarray:
    eom = numeric.eom
    return ca.Function("pose", [eom.t, eom.q, eom.p], [ca.densify(expression)])(t, q, numeric.p).full()


def report_validity(motion: Trajectory, others: Sequence[str] = ()) -> None:
    """Warn of conditions that are broken at an output, and of other findings, and note them in the statistics.

    Conditions on quantities that the analysis does not know (a contact force in kinematics) are left out.
    """
    motion.statistics.notes += others
    remarks = [*others, *_broken_at_outputs(motion), *_out_of_range(motion)]
    if len(remarks) > MOST_WARNINGS:
        # many warnings are read by nobody
        more = len(remarks) - MOST_WARNINGS
        remarks = [f"{'; '.join(remarks[:MOST_WARNINGS])}; and {more} more of this kind: see motion.statistics.notes"]
    for text in remarks:
        warn(text)


def report_validity_at(state: State, mechanism: Mechanism, analysis: str) -> None:
    """Warn of conditions that are broken at a state with its multipliers."""
    for condition in validity_conditions(mechanism):
        value = float(state[condition.expression])
        if value < -MET * (1 + abs(value)):
            unit = f" ({float(state[condition.reported]):.6g} {condition.unit})" if condition.unit else ""
            warn(f"{analysis}: {condition.message}{unit}")


def _out_of_range(motion: Trajectory) -> list[str]:
    """A message on the first varying quantity that is out of its range, which becomes a note."""
    ranges = Ranges(motion.equations, motion.parameters, motion.mechanism)
    if not has_multipliers(motion):
        ranges.limits = [x for x in ranges.limits if not ca.depends_on(x.expression, motion.equations.lam)]
    block = motion.t, motion.q, motion.v, motion.a, motion.z, motion.lam, motion.inputs
    broken = ranges.first_broken(block) if motion.t.size else None
    remarks = [] if broken is None else [f"{broken[1]} at t = {motion.t[broken[0]]:.6g} s"]
    motion.statistics.notes += remarks
    return remarks


def _broken_at_outputs(motion: Trajectory) -> list[str]:
    """Messages of the conditions that are broken at an output, which become notes."""
    conditions = validity_conditions(motion.mechanism)
    if conditions and not has_multipliers(motion):
        conditions = tuple(c for c in conditions if not ca.depends_on(c.expression, motion.equations.lam))
    if not conditions or not motion.t.size:
        return []
    remarks = []
    values = motion[ca.vertcat(*[c.expression for c in conditions])].reshape(motion.t.size, -1)
    shown = motion[ca.vertcat(*[c.reported for c in conditions])].reshape(motion.t.size, -1)
    for condition, course, size in zip(conditions, values.T, shown.T, strict=True):
        bad = course < -MET * (1 + np.max(np.abs(course), initial=0.0))
        if np.any(bad) and not any(note.startswith(condition.message) for note in motion.statistics.notes):
            first, worst = float(motion.t[np.argmax(bad)]), float(size[np.argmin(np.where(bad, course, np.inf))])
            unit = f" {condition.unit}" if condition.unit else ""
            remarks.append(f"{condition.message} (first at t = {first:.6g} s, at worst {worst:.6g}{unit})")
    motion.statistics.notes += remarks
    return remarks
