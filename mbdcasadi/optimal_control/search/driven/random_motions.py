"""The best of many ways between two states: random motions, each followed to the least effort near it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ....numerics.banded_least_squares import LeastSquaresEnd
from ...solve.driven.motions import COARSE_TOLERANCE, STEPS, DrivenMotions
from ...solve.driven.spline import MotionSpline

#: Number of intervals on which random motions are compared, number of them, of those that are the best so far with
#: random waves, and of those that go on to twice as many intervals.
FIRST_INTERVALS, RANDOM_MOTIONS, CHANGED_MOTIONS, KEPT = 20, 30, 12, 6
#: Half waves of a random motion, their amplitudes in turn as shares of the sizes of the coordinates, the amplitude of
#: those that are added to one of the best so far, and number of these: of seven choices the one with the least efforts
#: of 14 arms, by a tenth.
WAVES, AMPLITUDES, CHANGE, BEST = 3, (0.7, 1.4, 2.8), 1.0, 4


@dataclass(frozen=True)
class BestMotion:
    """The motion of the least effort that was found."""

    spline: MotionSpline
    #: its unknowns
    x: np.ndarray
    #: number of motions that were tried
    tried: int


def best_motion(motions: DrivenMotions) -> BestMotion | None:
    """Return the motion of the least effort near random ones and the even one, on a coarse mesh.

    None if inputs do not follow from the motion, or no motion has an effort.
    """
    random = np.random.default_rng(0)
    first, last = motions.setup.path.segment_times[[0, -1]].tolist()
    spline, finer = (motions.spline(np.linspace(first, last, k * FIRST_INTERVALS + 1)) for k in (1, 2))
    effort, finer_effort = motions.effort_on(spline), motions.effort_on(finer)
    even = spline.through(_states(motions, spline.times, np.zeros((WAVES, motions.dynamics.n))))
    found: list[LeastSquaresEnd] = []

    def change(amplitude: float) -> np.ndarray:
        waves = amplitude * random.normal(size=(WAVES, motions.dynamics.n))
        return spline.through(_states(motions, spline.times, waves)) - even

    try:
        for number in range(RANDOM_MOTIONS + CHANGED_MOTIONS):
            parents = _best(found, BEST)
            if number < RANDOM_MOTIONS or not parents:
                x = even + (change(AMPLITUDES[number % len(AMPLITUDES)]) if number else 0.0)
            else:
                x = parents[number % len(parents)].x + change(CHANGE)
            found.append(effort.end(x, COARSE_TOLERANCE, STEPS[0]))
        kept = [finer.like(spline, end.x) for end in _best(found, KEPT)]
        ends = _best([finer_effort.end(x, COARSE_TOLERANCE, STEPS[0]) for x in kept], 1)
    except np.linalg.LinAlgError:
        return None
    return BestMotion(finer, ends[0].x, len(found)) if ends else None


def _states(motions: DrivenMotions, times: np.ndarray, waves: np.ndarray) -> np.ndarray:
    """States (k, 2 n) of the even motion between the ends with half waves besides."""
    n, (first, last), span = motions.dynamics.n, motions.ends, times[-1] - times[0]
    share, numbers = (times[:, None] - times[0]) / span, np.arange(1, len(waves) + 1)
    amplitudes = motions.scales.q * waves / numbers[:, None]
    turned = last[:n] - first[:n]
    q = first[:n] + share * turned + np.sin(np.pi * share * numbers) @ amplitudes
    v = (turned + (np.pi * numbers * np.cos(np.pi * share * numbers)) @ amplitudes) / span
    return np.hstack([q, v])


def _best(ends: Sequence[LeastSquaresEnd], count: int) -> list[LeastSquaresEnd]:
    """Those of the least effort, without those that have none, as where forces are not defined."""
    known = [end for end in ends if np.isfinite(end.value)]
    return sorted(known, key=lambda end: end.value)[:count]
