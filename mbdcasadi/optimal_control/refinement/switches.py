"""Switches: times from which on other limits hold a motion back, enclosed by mesh points that move.

An interval in which an input jumps from one limit to the other has a polynomial with the right mean; its motion is
that of no input with a jump, and takes a little longer. If both ends of it may move, it shrinks to almost nothing.

At limits of positions inputs mostly have a kink, whose place hardly counts for the cost: points that move there are led
astray. Intervals in which the inputs are off are split instead, see :mod:`input_error`.
"""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np

from ..nlp.limits import activity
from ..phase import BEYOND_STATES
from ..phase_solution import PhaseSolution
from ..solved_motion import SolvedMotion
from .measure import Measure

#: Scaled slack below which a limit counts as active, whatever its multiplier: on long arcs both may be small.
SLACK = 3e-4


class Switch(NamedTuple):
    """A stretch of a mesh in which limits begin or cease to be active."""

    #: mesh points that enclose it
    points: tuple[int, ...]
    intervals: tuple[int, ...]
    #: time at which it begins, s
    time: float


class UnresolvedSwitches(Measure):
    """Switches that the mesh does not resolve: points beside them move, and at last their intervals are split.

    The cost is wrong by about the square of the length of an interval in which an input jumps, as a share of the
    duration: above the tolerance it is not resolved. Inputs that are constant on intervals, those of a digital
    controller, jump when it lets them.
    """

    def __init__(self, solution: SolvedMotion, tolerance: float):
        constant = solution.settings.control == "constant"
        self._shares = {} if constant else activity(solution, SLACK, inside=True)
        self.switches: list[list[Switch]] = [[] for _ in solution.phases]
        super().__init__(solution, tolerance)

    def of(self, part: PhaseSolution) -> np.ndarray:
        """Infinite in intervals of a switch, zero in others (N,)."""
        number, lengths, errors = part.program.number, np.diff(part.mesh_times), np.zeros(part.mesh.count)
        limits = part.program.limits_at_points
        positions = {limit.label for limit in limits if not limit.depends_on("velocity", "state", *BEYOND_STATES)}
        shares = [x for (phase, label), x in self._shares.items() if phase == number and label not in positions]
        longest = part.duration * np.sqrt(self.tolerance)
        for switch in _switches(part, np.array(shares).reshape(len(shares), part.mesh.count)):
            if np.sum(lengths[list(switch.intervals)]) > longest:
                self.switches[number].append(switch)
                errors[list(switch.intervals)] = np.inf
        return errors

    def order(self, part: PhaseSolution) -> int:
        """One: the time of a switch."""
        return 1

    def sentences(self) -> list[str]:
        """Times at which limits change."""
        return [f"the switching time t = {switch.time:.6g} s of active limits" for of in self.switches for switch in of]

    @property
    def moving(self) -> list[set[int]]:
        """Mesh points that enclose the switches, by phase."""
        return [{k for switch in of for k in switch.points} for of in self.switches]


def _switches(part: PhaseSolution, shares: np.ndarray) -> list[Switch]:
    """Switches of a phase from the shares of the points of each interval at which limits are active (limits, N)."""
    mesh, times = part.mesh, part.mesh_times
    mixed = np.any((shares > 0) & (shares < 1), axis=0)
    switches = []
    for (is_mixed, _), group in itertools.groupby(range(mesh.count), key=lambda k: (mixed[k], mesh.piece[k])):
        run = list(group)
        if is_mixed:
            switches.append(Switch((run[0], run[-1] + 1), tuple(run), float(times[run[0]])))
    for k in range(1, mesh.count):
        plain = not (mixed[k - 1] or mixed[k] or k in mesh.knots)
        if plain and not np.array_equal(shares[:, k - 1], shares[:, k]):
            switches.append(Switch((k,), (k - 1, k), float(times[k])))
    return switches
