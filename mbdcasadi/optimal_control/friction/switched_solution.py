"""A solution with exact friction and contact: its switches, and its simulation with the search of ``simulate``."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...equations import equations
from ...errors import MechanismError, ModelError
from ...model.mechanism import Mechanism
from ...model.sites import WHAT, Site
from ...numerics.console import without_warnings
from ...numerics.lazy import cached_property
from ...numerics.symbolic import symbolic
from ...numerics.tolerances import MET
from ...results.phases import PhasedTrajectory, places_in
from ...results.state import Arrays, EventOccurrence
from ...results.steps import Direct
from ...results.trajectory import Statistics, Trajectory
from ...simulation.simulate import simulate
from ..motion.phase_solution import PhaseSolution
from ..motion.return_map import Stability
from ..motion.verification import Verification, defects_of
from ..problem import OptimalControlProblem
from ..solution import Solution
from ..statement.sites import Replaced
from .pattern import SHORTEST, Piece
from .phases import PhasedFriction


@dataclass(frozen=True)
class Switch:
    """A change of the mode of a friction, or of a place of contact, in a solution.

    Attributes
    ----------
    t : float
        Time, s.
    name : str
        "<name> touches", "opens", "stops" or "breaks away", as in a simulation; what turns stops, too.
    before, after : str
        Modes: ``"open"``, ``"closed"`` (without friction), ``"sticks"``, slides ``"forth"`` or ``"back"``.
    """

    t: float
    name: str
    before: str
    after: str

    def __repr__(self) -> str:
        return f"{self.name} at t = {self.t:.6g} s ({self.before} → {self.after})"


class SwitchedSolution(Solution):
    """A solution of a problem with exact friction and contact, in phases in which nothing switches.

    ``.problem`` is the one in phases; its first arguments are those of :class:`Solution`.

    Attributes
    ----------
    original : OptimalControlProblem
        The problem that was stated.
    pieces : sequence of Piece
        Modes in the phases.
    switches : tuple of Switch
        When something touches, opens, stops, breaks away or turns, in the order of time.
    """

    def __init__(
        self,
        solution: Solution,
        original: OptimalControlProblem,
        phased: PhasedFriction,
        sites: Sequence[Site],
    ):
        vars(self).update(vars(solution))
        self.original, self._sites = original, sites
        self._replaced = [one.replaced for one in phased.made]
        #: the mechanism with its friction and contacts
        self.mechanism: Mechanism = original.given["mechanism"]
        ends = [float(part.segment_times[-1]) for part in self.phases]
        begins = [0.0, *ends[:-1]]
        self.pieces: list[Piece] = [
            replace(p, begin=a, end=b) for p, a, b in zip(phased.pieces, begins, ends, strict=True)
        ]
        self.switches = _switches(sites, self.pieces)

    @cached_property
    @symbolic
    def trajectory(self) -> Trajectory:
        """The motion of the mechanism with all that switches; ``.at(times)`` between mesh points and stages."""
        parts = [self._whole(part, of) for part, of in zip(self.phases, self._replaced, strict=True)]
        at = {piece.end: part.final for piece, part in zip(self.pieces, parts, strict=True)}
        events = [EventOccurrence(switch.name, switch.t, at[switch.t]) for switch in self.switches]
        values = [part.parameters for part in parts]
        return PhasedTrajectory(parts, self.mechanism, values, events=events, statistics=self._statistics)

    @property
    def _statistics(self) -> Statistics:
        of = self.phases[0].trajectory.statistics
        return Statistics(of.method, of.formulation, self.statistics.seconds)

    def _whole(self, part: PhaseSolution, of: Replaced) -> Trajectory:
        """The motion of a phase with the multipliers and inputs of the whole mechanism."""
        eom, inner = equations(self.mechanism), part.phase.equations
        loads = of.of(eom.lam)
        inputs = places_in(inner.u, eom.u)

        def arrays(motion: Trajectory) -> Arrays:
            lam = motion[loads].reshape(len(motion), -1)
            return motion.q, motion.v, motion.a, motion.z, lam, motion.inputs[:, inputs]

        motion = part.trajectory
        values = dict(zip(inner.mechanism.parameters, part.numeric.p.tolist(), strict=True))
        p = np.array([values[symbol] for symbol in self.mechanism.parameters])
        between = Direct(lambda times: arrays(motion.at(times)), motion)
        return Trajectory(self.mechanism, motion.t, *arrays(motion), p, interpolation=between)

    @symbolic
    def verify(self, reltol: float = 1e-10, abstol: float = 1e-10) -> Verification:
        """Simulate the mechanism of the problem with the inputs of the solution: its switches are found anew.

        ``final_error`` tells whether the simulation ends where the solution does. If it switches otherwise, ``repr``
        says so, and ``time_error`` is infinite; ``event_times`` are those of its switches. If it is the same motion all
        the same, something is at the border of its law, as a contact that is closed and bears nothing, or friction at
        its limit: what switches there decides nothing, and does not count.
        """
        first, mechanism = self.trajectory.initial, self.mechanism
        motion: Trajectory | None = None
        stopped: MechanismError | None = None
        try:
            with without_warnings(".*beyond its limits"):
                motion = simulate(
                    mechanism,
                    self.mesh_times,
                    initial=first,
                    inputs={u: p for u, p in self.inputs.items() if any(u is own for own in mechanism.inputs)},
                    parameters=dict(zip(mechanism.parameters, first.parameters.tolist(), strict=True)),
                    reltol=reltol,
                    abstol=abstol,
                )
        except MechanismError as error:
            motion, stopped = error.partial if isinstance(error.partial, Trajectory) else None, error
        deviations = np.zeros((1, 1)) if motion is None else self._deviations(motion)
        names = {f"{site.name} {what}" for site in self._sites for what in WHAT}
        found = [] if motion is None else [event for event in motion.events if event.name in names]
        is_same = stopped is None and self._is_same(deviations)
        return SwitchVerification(
            motion,
            float(np.max(deviations[-1])) if stopped is None else np.inf,
            float(np.max(deviations)),
            0.0 if motion is None else motion.drift.position,
            np.vstack([defects_of(part) for part in self.phases]),
            np.array([event.t for event in found]),
            self._time_error(found, is_same=is_same),
            growth=max(part.largest_growth for part in self.phases),
            stopped=stopped,
            planned=self.switches,
            found=tuple(f"{e.name} at t = {e.t:.6g} s" for e in found),
            further=tuple(f"{e.name} at t = {e.t:.6g} s" for e in self._further(found) if is_same),
        )

    def _refuse_phases(self, name: str, remedy: str) -> None:
        raise ModelError(f"Solution.{name}: a motion with exact friction or contact has none; {remedy}")

    def stability(self) -> Stability:
        """Refuse: the disturbed motion sticks at other times."""
        self._refuse_phases("stability", "simulate it from disturbed starts")
        return super().stability()

    def save(self, path: str | Path) -> None:
        """Refuse: its phases belong to no problem that could be stated again."""
        self._refuse_phases("save", "save its trajectory")

    def _deviations(self, motion: Trajectory) -> np.ndarray:
        """Differences of a simulation at the mesh points that it reached, in coordinates and shares of states."""
        reached = self.mesh_times[self.mesh_times <= motion.t[-1]]
        one, other = motion.at(reached), self.trajectory.at(reached)
        ranges = np.max([part.state_ranges for part in self.phases], axis=0)
        return np.abs(np.hstack([one.q - other.q, (one.z - other.z) / ranges]))

    def _is_same(self, deviations: np.ndarray) -> bool:
        """True if a simulation, with its differences at the mesh points (k, n), is the same motion."""
        sizes = np.r_[self.phases[0].program.scales.q, np.ones(deviations.shape[1])][: deviations.shape[1]]
        return len(deviations) == self.mesh_times.size and bool(np.all(deviations <= MET * sizes))

    def _further(self, found: Sequence[EventOccurrence]) -> list[EventOccurrence]:
        """Switches that were not planned, but for those just at the end."""
        return [event for event in _paired(self.switches, found)[2] if event.t < (1 - SHORTEST) * self.duration]

    def _time_error(self, found: Sequence[EventOccurrence], *, is_same: bool) -> float:
        """Largest difference of the time of a switch; infinite if others take place, unless just at the end."""
        near = SHORTEST * self.duration
        return time_error(self.switches, found, near, self.duration - near, is_same=is_same)


@dataclass(frozen=True)
class SwitchVerification(Verification):
    """A verification with the switches of the solution and of the simulation, and those that decide nothing."""

    planned: tuple[Switch, ...] = ()
    found: tuple[str, ...] = ()
    further: tuple[str, ...] = ()

    def __repr__(self) -> str:
        text = super().__repr__()
        if np.isinf(self.time_error):
            planned = ", ".join(f"{s.name} at t = {s.t:.6g} s" for s in self.planned) or "nothing switches"
            text += f"; the simulation switches otherwise: {', '.join(self.found) or 'never'}; planned: {planned}"
        if self.further:
            text += (
                f"; the motion is that of the plan, also where the simulation has {', '.join(self.further)}: a contact "
                "that bears nothing there, or friction at its limit, may be in either mode"
            )
        return text


def _switches(sites: Sequence[Site], pieces: Sequence[Piece]) -> tuple[Switch, ...]:
    """Changes of modes between pieces."""
    switches = []
    for one, other in itertools.pairwise(pieces):
        for site, before, after in zip(sites, one.senses, other.senses, strict=True):
            if before != after:
                switches.append(Switch(one.end, f"{site.name} {_what(before, after)}", before, after))
    return tuple(switches)


def _what(before: str, after: str) -> str:
    if "open" in (before, after):
        return "touches" if before == "open" else "opens"
    return "breaks away" if before == "sticks" else "stops"


def time_error(
    planned: Sequence[Switch], found: Sequence[Any], near: float, end: float, *, is_same: bool = False
) -> float:
    """Return the largest difference of the times, s, of switches that were planned and found, paired by their names.

    It is infinite if one has no other. More may be found from the time `end` on, s; and of what switches at one
    instant, nearer than a time, s, as where one motion makes several frictions slide, one may be found alone. If the
    motion is the same, what switches on its way besides does not count.
    """
    pairs, left, further = _paired(planned, found)
    errors = [0.0, *(abs(switch.t - event.t) for switch, event in pairs)]
    missing = any(all(abs(one.t - switch.t) > near for switch, _ in pairs) for one in left)
    if not is_same and (missing or any(event.t < end for event in further)):
        return np.inf
    return max(errors)


def _paired(
    planned: Sequence[Switch], found: Sequence[Any]
) -> tuple[list[tuple[Switch, Any]], list[Switch], list[Any]]:
    """Switches that were planned and found under the same name, the nearest ones first; and those that are left."""
    left, further, pairs = list(planned), list(found), list[tuple[Switch, Any]]()
    near = [(s, e) for s in planned for e in found if s.name == e.name]
    for switch, event in sorted(near, key=lambda pair: abs(pair[0].t - pair[1].t)):
        if any(one is switch for one in left) and any(one is event for one in further):
            pairs.append((switch, event))
            left = [one for one in left if one is not switch]
            further = [one for one in further if one is not event]
    return pairs, left, further
