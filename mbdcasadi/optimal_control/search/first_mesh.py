"""Meshes to begin with: how many intervals each phase has."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...errors import ModelError
from ..program.setup import PhaseSetup
from ..statement.phase import Phase
from ..transcription.mesh import Mesh

#: Intervals of a phase for which no number is given.
INTERVALS = 40


def is_automatic(intervals: Any) -> bool:
    """Return True if the number of intervals is left to the package."""
    return isinstance(intervals, str) and intervals == "auto"


def first_meshes(setups: Sequence[PhaseSetup], intervals: Any) -> list[Mesh]:
    """Return meshes of equal intervals: one number for all phases that last, one for each, or by phase or name.

    A :class:`ModelError` is raised for what is no number of intervals, for too few, and for phases that have none.
    """
    lasting = [setup.phase for setup in setups if not setup.phase.is_instant]
    counts = dict(zip(lasting, _counts(lasting, intervals), strict=True))
    return [
        Mesh.equal(counts[setup.phase], setup.path.segment_times) if setup.phase in counts else Mesh.instant()
        for setup in setups
    ]


def _counts(phases: Sequence[Phase], intervals: Any) -> list[int]:
    """Number of intervals of each phase that lasts."""
    if is_automatic(intervals):
        return [max(INTERVALS, phase.fewest_intervals) for phase in phases]
    names = ", ".join(repr(phase.name) for phase in phases)
    if isinstance(intervals, Mapping):
        given = {key.name if isinstance(key, Phase) else key: count for key, count in intervals.items()}
        if set(given) != {phase.name for phase in phases}:
            raise ModelError(f"optimize: intervals= takes a number for each of the phases {names}, got {intervals!r}")
        each = [given[phase.name] for phase in phases]
    elif isinstance(intervals, Sequence | np.ndarray) and not isinstance(intervals, str):
        each = list(intervals)
        if len(each) != len(phases):
            raise ModelError(f"optimize: intervals= has {len(each)} numbers for the phases that last, {names}")
    else:
        each = [intervals] * len(phases)
    return [_count(phase, count, several=len(phases) > 1) for phase, count in zip(phases, each, strict=True)]


def _count(phase: Phase, count: Any, *, several: bool) -> int:
    if isinstance(count, bool) or not isinstance(count, int | np.integer) or count < phase.fewest_intervals:
        waypoints = len(phase.waypoints)
        between = f" with {waypoints} waypoints" if waypoints else ""
        of = f" in phase '{phase.name}'" if several else ""
        least = f"{phase.fewest_intervals}{between}{of}"
        raise ModelError(f"optimize: intervals must be a whole number of at least {least}, got {count!r}")
    return int(count)
