"""Accuracy of a finished run: whether its tolerance resolved the motion, and how far errors may have grown."""

from __future__ import annotations

import casadi as ca
import numpy as np

from ...equations.derivation import Equations
from ...model.forces.contact.rigid import RigidContact
from ...model.forces.friction.modes import switching
from ...numerics.least_squares import largest
from ...numerics.tolerances import ACCURACY, NEGLIGIBLE
from ...results.trajectory import Trajectory

#: Range of a motion (m or rad), in absolute tolerances, below which the tolerance does not resolve it.
RESOLVED = 1e5
#: Range, relative to the size of the coordinates, that is rounding.
RANGE_TOLERANCE = 1e-11
#: Absolute tolerance for a motion of small range, relative to that; and the smallest.
ABSTOL_SHARE, SMALLEST_ABSTOL = 1e-8, 1e-15
#: Steps of a run from which its energy is looked at.
MANY_STEPS = 20_000
#: Estimate of the error of an angle from which it is reported, rad.
WORTH_REPORTING = 1e-2


def ranges_of(q: np.ndarray, share: float = RANGE_TOLERANCE) -> np.ndarray:
    """Range over which each coordinate moves (n,); 0 if that is less than a share of its size.

    Parameters
    ----------
    q : numpy.ndarray
        Coordinates by output (n_t, n).
    """
    if not len(q):
        return np.zeros(q.shape[1])
    columns = np.ascontiguousarray(q.T)  # along rows that lie together it is four times as fast
    most, least = columns.max(axis=1), columns.min(axis=1)
    all_ranges = most - least
    return np.where(all_ranges > share * (1 + np.maximum(most, -least)), all_ranges, 0.0)


def tolerance_for(ranges: np.ndarray, abstol: float) -> float | None:
    """Absolute tolerance that resolves a motion of small :func:`ranges_of`; None if the one it was made with does."""
    size = largest(ranges)
    return max(ABSTOL_SHARE * size, SMALLEST_ABSTOL) if 0 < size < RESOLVED * abstol else None


def unresolved_range(q: np.ndarray, abstol: float) -> str:
    """Sentence on a motion whose range the tolerance does not resolve."""
    return (
        f"the motion stays within {largest(ranges_of(q)):.2g} (m or rad), which abstol = {abstol:.1e} does not "
        "resolve; lower it"
    )


def range_near_rounding(q: np.ndarray) -> list[str]:
    """Sentence on a motion whose range is little more than the rounding of its coordinates."""
    if largest(ranges_of(q)) > 0:
        return []
    ranges = ranges_of(q, ACCURACY)
    if not largest(ranges):
        return []
    size = float(np.max(np.abs(q[:, ranges > 0])))
    return [
        f"the motion stays within {largest(ranges):.2g} (m or rad) at coordinates of up to {size:.3g}, near their "
        "rounding, and is not resolved; take an origin nearer to it"
    ]


def notes_on_range(motion: Trajectory, ranges: np.ndarray, abstol: float) -> list[str]:
    """Sentences on a motion, or on coordinates in it, that the tolerance or rounding does not resolve.

    Parameters
    ----------
    ranges : numpy.ndarray
        Its :func:`ranges_of` (n,).
    """
    return small_motions(motion, ranges, abstol) if largest(ranges) else range_near_rounding(motion.q)


def small_motions(motion: Trajectory, ranges: np.ndarray, abstol: float) -> list[str]:
    """Sentences on coordinates that move so little, beside others, that the tolerance does not resolve them.

    Parameters
    ----------
    ranges : numpy.ndarray
        Their :func:`ranges_of` (n,).
    """
    if largest(ranges) < RESOLVED * abstol:
        return []
    few = ((ranges > 10 * abstol) & (ranges < 1e-2 * RESOLVED * abstol)).nonzero()[0]
    if not few.size:
        return []
    names, smallest = motion.equations.coordinate_names, float(ranges[few].min())
    return [
        f"{', '.join(names[k] for k in few[:6])}{' and others' if few.size > 6 else ''} move by as little as "
        f"{smallest:.2g} (m or "
        f"rad), which abstol = {abstol:.1e} resolves to {100 * abstol / smallest:.1g} %; lower it if they matter"
    ]


def grown_error(motion: Trajectory) -> list[str]:
    """Sentence on the error that a long run of a conservative mechanism may have gathered, by its energy."""
    if motion.statistics.steps < MANY_STEPS or len(motion) < 2:
        return []
    eom = motion.equations
    if any(not isinstance(part, RigidContact) or part.friction is not None for part in switching(eom.mechanism)):
        return []  # exact friction may slide between two outputs, and takes energy unseen
    values = motion[eom.mechanism.cache.get_or_create("power balance", lambda: _power_balance(eom))]
    rest, kinetic, potential = np.abs(values[:, 0]), values[:, 1], values[:, 2]
    powers, rates = np.split(np.abs(values[:, 3:]), [eom.q.numel()], axis=1)
    if np.max(rest) > NEGLIGIBLE * np.max(np.sum(powers, axis=1)):
        return []  # forces without potential: the energy says nothing
    if np.any(rates > 0):
        return []  # drivers do work
    total = kinetic + potential - _gained_at_events(motion, eom)
    drift, size = float(np.max(np.abs(total - total[0]))), float(np.max(kinetic))
    turning = np.abs(motion.v[:, eom.angles])
    if not turning.size or size == 0:
        return []
    turned = float(np.max(np.mean(turning, axis=0))) * float(motion.t[-1] - motion.t[0])
    estimate = 0.5 * drift / size * turned
    if estimate < WORTH_REPORTING:
        return []
    return [
        f"the energy of this conservative motion drifted by {drift:.2g} J, {100 * drift / size:.2g} % of the largest "
        f"kinetic energy: over {turned:.3g} rad of turning, angles may be off by about {estimate:.2g} rad; tighten the "
        "tolerances (reltol, abstol) if that matters"
    ]


def _gained_at_events(motion: Trajectory, eom: Equations) -> np.ndarray:
    """Energy that impacts and resets have added up to each output (n_t,), J: negative if they take it."""
    changes = [event for event in motion.events if event.after is not None]
    energy, gained = eom.kinetic + eom.potential, np.zeros(len(changes) + 1)
    gained[1:] = np.cumsum([float(event.after[energy] - event.state[energy]) for event in changes if event.after])
    return np.asarray(gained[np.searchsorted([event.t for event in changes], motion.t, side="right")])


def _power_balance(eom: Equations) -> ca.SX:
    """Power that no potential explains, both energies, powers of the forces (n,), rates of the constraints (m,)."""
    rest = ca.dot(eom.Q, eom.v) + ca.jtimes(eom.potential, eom.q, eom.v)
    return ca.densify(ca.vertcat(rest, eom.kinetic, eom.potential, eom.Q * eom.v, eom.nu))
