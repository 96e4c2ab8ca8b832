"""Summary of a motion in a few lines of text."""

from __future__ import annotations

from collections.abc import Mapping

import casadi as ca
import numpy as np

from ..model.expressions import norm
from .columns import effort_unit, has_multipliers, joints_of, reaction_of
from .extrema import extremum
from .motion import Motion

_WIDTH = 20
#: Loads below this are rounding, N or N m.
_NOTHING = 1e-9


def summary_lines(motion: Motion, facts: Mapping[str, str] | None = None) -> list[tuple[str, str]]:
    """Return the lines of :func:`summary`, each with its name."""
    mechanism, run, drift, energy = motion.mechanism, motion.statistics, motion.drift, motion.energy.total
    lines = [("model", mechanism.name or "without a name"), ("", _parts(motion)), *(facts or {}).items()]
    lines.append(("outputs", f"{len(motion)}, t = {motion.t[0]:g} … {motion.t[-1]:g} s"))
    method = run.method + (f", {run.formulation}" if run.formulation else "")
    lines.append(("wall time", f"{run.seconds:.3g} s" + (f" ({method})" if method else "")))
    lines.append(("largest |Phi|", f"{drift.position:.1e} m or rad; of its rate {drift.velocity:.1e}"))
    lines.append(("energy", f"{energy[0]:.6g} J → {energy[-1]:.6g} J, change {energy[-1] - energy[0]:+.3g} J"))
    if has_multipliers(motion):
        lines += _table("driver effort", _efforts(motion)) + _table("largest reaction", _reactions(motion))
    lines += [("event", f"'{event.name}' at t = {event.t:.6g} s") for event in motion.events]
    lines += [("note", note) for note in run.notes]
    return lines


def summary(motion: Motion, facts: Mapping[str, str] | None = None) -> str:
    """Return a summary of a motion as a table, with facts behind the name of the model.

    Outputs, wall time, drift, energy, range of each driver's effort, largest reaction of each joint, notes.
    """
    return "\n".join(f"{name:{_WIDTH}}{text}".rstrip() for name, text in summary_lines(motion, facts))


def _parts(motion: Motion) -> str:
    mechanism = motion.mechanism
    counts = {
        "body bodies": mechanism.bodies,
        "joint joints": mechanism.joints,
        "driver drivers": mechanism.drivers,
        "force forces": mechanism.forces,
    }
    return ", ".join(f"{len(parts)} {words.split()[len(parts) != 1]}" for words, parts in counts.items() if parts)


def _table(title: str, entries: Mapping[str, str]) -> list[tuple[str, str]]:
    """Entries under one title, beside the first of them."""
    width = max(map(len, entries), default=0) + 2
    return [(title if k == 0 else "", f"{name:{width}}{text}") for k, (name, text) in enumerate(entries.items())]


def _efforts(motion: Motion) -> dict[str, str]:
    entries = {}
    for driver in motion.mechanism.drivers:
        unit = effort_unit(driver)
        for name, effort in zip(driver.row_names, ca.vertsplit(-driver.multipliers), strict=True):
            least, most = (_extreme(motion, effort, sign)[0] for sign in (-1, 1))
            entries[name] = f"{_rounded(least)} … {_rounded(most)} {unit}"
    return entries


def _reactions(motion: Motion) -> dict[str, str]:
    entries = {}
    for joint in joints_of(motion.mechanism):
        reaction = reaction_of(joint)
        loads = (("N", norm(reaction.force)), ("N m", norm(reaction.torque)))
        largest = [(unit, *_extreme(motion, size, 1)) for unit, size in loads]
        parts = [f"{_rounded(size)} {unit} at t = {t:.4g} s" for unit, size, t in largest if size > _NOTHING]
        entries[joint.name] = ", ".join(parts) or "none"
    return entries


def _extreme(motion: Motion, expression: ca.SX, sign: int) -> tuple[float, float]:
    """Largest value of a scalar, or for sign -1 the smallest, and its time; of a motion from arrays at its outputs."""
    if motion.interpolates:
        found = extremum(motion, expression, sign, "maximum")
        return found.value, found.t
    values = motion[expression]
    k = int(np.nanargmax(sign * values))
    return float(values[k]), float(motion.t[k])


def _rounded(value: float) -> str:
    return f"{0.0 if abs(value) < _NOTHING else value:.4g}"
