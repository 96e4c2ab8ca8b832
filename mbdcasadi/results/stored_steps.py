"""Steps of a motion as entries of a file: polynomials by which it is read again between its outputs."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..equations import Equations, equations
from ..equations.numeric import NumericEquations
from ..equations.recovery import Recovery
from ..errors import warn
from ..model.forces.friction.modes import switching, without_exact_friction
from .archives import Archive
from .interpolation import cubic, hermite, linear
from .motion import Motion
from .state import Arrays, six
from .steps import Direct, Interpolation

#: Points of a step, of Chebyshev and Lobatto: polynomials of degree five through them are near to the best ones.
POINTS = (1 - np.cos(np.pi * np.arange(6) / 5)) / 2
#: Weights of the barycentric formula at them.
WEIGHTS = np.array([0.5, -1.0, 1.0, -1.0, 1.0, -0.5])
#: Distance from a point, in the length of a step, within which the value there is taken.
AT_POINT = 1e-14
#: Names of the entries.
NAMES = ("q", "v", "a", "z", "lam", "inputs")


def steps_of(motion: Motion, prefix: str = "") -> dict[str, Any]:
    """Return the entries of the steps of a motion in one mechanism; none of one that is not known between its times."""
    if not motion.interpolates or len(motion) < 2:
        return {}
    knots = motion.knots
    wide = np.flatnonzero(np.diff(knots) > 4 * np.spacing(np.abs(knots[1:])))
    times = knots[wide, None] + np.diff(knots)[wide, None] * POINTS
    times[:, -1] = knots[wide + 1]
    there = motion.at(times.ravel())
    content = {f"{prefix}step {name}": getattr(there, name).reshape(*times.shape, -1) for name in NAMES}
    return content | {f"{prefix}step times": times[:, [0, -1]]}


def read_steps(
    archive: Archive, prefix: str, eom: Equations, t: np.ndarray, arrays: Arrays, p: np.ndarray
) -> Interpolation | None:
    """Return the motion between times by the steps of a file."""
    if t.size < 2:
        return None
    if f"{prefix}step times" not in archive:
        return _without_steps(archive, eom, t, arrays, p)
    ends = archive.numbers(f"{prefix}step times", None, 2)
    values = six(
        archive.numbers(f"{prefix}step {name}", len(ends), POINTS.size, size, unknown=True)
        for name, size in zip(NAMES, eom.sizes, strict=True)
    )
    # rows of friction that sticks hold at times
    recovery = Recovery(NumericEquations(equations(without_exact_friction(eom.mechanism)), p), redundant=True)

    def at(times: np.ndarray) -> Arrays:
        k = np.clip(np.searchsorted(ends[:, 1], times, side="left"), 0, len(ends) - 1)
        s = np.clip((times - ends[k, 0]) / (ends[k, 1] - ends[k, 0]), 0, 1)
        off = s[:, None] - POINTS
        exact = np.abs(off) < AT_POINT
        weights = np.where(exact.any(axis=1, keepdims=True), exact, WEIGHTS / np.where(exact, 1.0, off))
        weights /= weights.sum(axis=1, keepdims=True)
        q, v, *others = (np.einsum("kj,kjn->kn", weights, x[k]) for x in values)
        q = recovery.positions(times, q, others[1])
        return six([q, recovery.velocities(times, q, v, others[1]), *others])

    return Direct(_with_outputs(at, t, arrays), np.unique(ends))


def _with_outputs(at: Any, t: np.ndarray, arrays: Arrays) -> Any:
    """A function of times that gives the outputs as they are."""

    def outputs_or_between(times: np.ndarray) -> Arrays:
        stored = np.clip(np.searchsorted(t, times), 0, t.size - 1)
        off = t[stored] != times
        results = [x[stored] for x in arrays]
        if off.any():
            for result, between in zip(results, at(times[off]), strict=True):
                result[off] = between
        return six(results)

    return outputs_or_between


def _without_steps(
    archive: Archive, eom: Equations, t: np.ndarray, arrays: Arrays, p: np.ndarray
) -> Interpolation | None:
    """The motion of a file by an earlier version, which kept no steps: polynomials through the outputs."""
    if switching(eom.mechanism):
        return None  # the constraints of exact friction change along the motion
    numeric = NumericEquations(eom, p)
    q, v, a, z, _, u = arrays
    recovery = Recovery(numeric, redundant=numeric.rank(float(t[0]), q[0]).rank < eom.lam.numel())

    def at(times: np.ndarray) -> Arrays:
        warn(
            f"{archive.path}: the file holds the outputs alone, as of a motion from arrays or of an earlier version; "
            "polynomials through them may be far from the motion: simulate it again, or save it with this version"
        )
        rates = eom.function(eom.z_rate)(t[None], *(x.T for x in arrays), p).full().T if z.shape[1] else z
        pose, velocity = hermite(t, q, v, a, times)
        return recovery.complete(times, pose, velocity, cubic(t, z, rates, times)[0], linear(t, u, times))

    return Direct(_with_outputs(at, t, arrays), t)
