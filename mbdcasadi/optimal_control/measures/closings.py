"""Warnings about motions of several phases that meet all demands: joints that pass, and joints that pull."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from ...errors import warn
from ..motion.phase_solution import PhaseSolution
from ..program.change import Change
from ..solution import Solution

#: Times of a phase at which it is looked whether something passes.
POINTS = 400
#: Share of the range of a row, or of a reaction, that counts as zero.
NOTHING = 1e-3


def warn_of_closings(solution: Solution) -> None:
    """Warn of joints that pass through their place before they close, and of footholds that pull.

    A position row of a joint that closes at the end of a phase may have passed through zero in the same direction
    before; a joint to the ground that closes and opens may have to pull, seen from the side from which it closed.
    """
    if len(solution.phases) < 2:
        return
    sides: dict[Any, dict[int, float]] = {}
    for change, before in zip(solution.program.changes, solution.phases, strict=False):
        if not before.phase.is_instant:
            _warn_of_passing(solution, change, before)
            sides |= _sides(solution, change)
    for joint, by_row in sides.items():
        if _is_foothold(solution, joint):
            _warn_of_pulling(solution, joint, by_row)


# --- what passes ------------------------------------------------------------------------------
def _guards_of(solution: Solution, change: Change) -> tuple[list[str], np.ndarray, np.ndarray]:
    """Names of the rows that close at a change, times of the phase before, and values over them (n_t, k)."""
    before = solution.phases[change.before.number]
    times = np.linspace(before.mesh_times[0], before.mesh_times[-1], POINTS)
    rows = change.guards_at(solution.phases[change.after.number].numeric.p)
    values = before.trajectory.at(times)[rows]
    return change.guard_names, times, values.reshape(times.size, -1)


def _warn_of_passing(solution: Solution, change: Change, before: PhaseSolution) -> None:
    if not change.setup.guards:
        return
    names, times, values = _guards_of(solution, change)
    for name, row in zip(names, values.T, strict=True):
        beyond = _beyond(row)
        if beyond is None:
            continue
        first, last = times[beyond[0]], times[beyond[-1]]
        amount = float(np.max(np.abs(row[beyond])))
        warn(
            f"phase '{before.phase.name}': '{name}' closes at its end, but was beyond zero before, by up to "
            f"{amount:.3g} from t = {first:.4g} to {last:.4g} s: a foot would have passed through the ground; state a "
            "limit in path=, unless nothing is in the way there"
        )


def _beyond(row: np.ndarray) -> np.ndarray | None:
    """Places at which a row that ends with zero was on the side to which it goes there; None if it never was."""
    size = float(np.max(np.abs(row)))
    inside = np.flatnonzero(np.abs(row) > NOTHING * size)
    if not size or not inside.size:
        return None
    side = np.sign(row[inside[-1]])  # from which it comes in the end
    wrong = inside[np.sign(row[inside]) == -side]
    if abs(row[0]) > NOTHING * size and np.sign(row[0]) == -side:
        # it begins on the other side, as a foot behind the next foothold does, and has to come across once
        wrong = wrong[wrong > inside[np.sign(row[inside]) == side][0]]
    return wrong if wrong.size else None


# --- what pulls -------------------------------------------------------------------------------
def _sides(solution: Solution, change: Change) -> dict[Any, dict[int, float]]:
    """Signs of the impulses of joints to the ground that close at a change, by joint and its row."""
    signs: dict[Any, dict[int, float]] = {}
    if not change.setup.guards:
        return signs
    impulses = change.impulses(solution.variables)
    names, _, values = _guards_of(solution, change)
    for name, row in zip(names, values.T, strict=True):
        size = float(np.max(np.abs(row)))
        inside = np.flatnonzero(np.abs(row) > NOTHING * size)
        for joint in impulses:
            row_names = list(getattr(joint, "row_names", ()))
            if name not in row_names or not any(body.is_ground for body in joint.bodies) or not inside.size:
                continue
            k = row_names.index(name)
            if np.all(np.sign(row[inside]) == np.sign(row[inside[-1]])) and impulses[joint][k]:
                signs.setdefault(joint, {})[k] = float(np.sign(impulses[joint][k]))
    return signs


def _is_foothold(solution: Solution, joint: Any) -> bool:
    """True if a joint closes in some phases and is open in others that follow, or before whose end it comes again."""
    there = [joint in part.phase.mechanism.joints for part in solution.phases]
    opens = any(one and not other for one, other in pairwise(there))
    return opens and any(other and not one for one, other in pairwise(there))


def _warn_of_pulling(solution: Solution, joint: Any, by_row: dict[int, float]) -> None:
    for part in solution.phases:
        if part.phase.is_instant or joint not in part.phase.mechanism.joints:
            continue
        values = part.trajectory[joint.multipliers].reshape(len(part.trajectory), -1)
        size = float(np.max(np.abs(values), initial=0.0))
        for k, sign in by_row.items():
            pull = -sign * values[:, k]
            worst = int(np.argmax(pull))
            if pull[worst] > NOTHING * size:
                warn(
                    f"phase '{part.phase.name}': {joint.description}, which closes from one side, has to pull at "
                    f"'{joint.row_names[k]}', by {pull[worst]:.3g} at t = {part.trajectory.t[worst]:.4g} s; if it is a "
                    "contact, state the sign of its reaction in path="
                )
