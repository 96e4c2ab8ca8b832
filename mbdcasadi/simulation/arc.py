"""One mode of a run: what advances it over a piece, and what is looked for on the way."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..integrators.compiled import IntegrationFailure
from ..model.events import Event
from ..numerics.console import Interruption
from ..results.ranges import Ranges
from ..results.state import State
from .changes.event_search import Crossing, EventSearch
from .changes.events import EventWatch
from .checks.failure_diagnosis import singular_stop
from .checks.resolution import Resolution
from .checks.uniqueness import Uniqueness
from .checks.unseen_loads import UnseenLoads
from .outputs import Outputs
from .path import Path, StatesFrom
from .policies import AcrossFolds, MeetLoads, UpToTouches, Way
from .schedule import Piece
from .singular.passage import Passage, SingularPassage, Trail
from .singular.regularity import Regularity
from .stepper import Looks, SteppedSystem
from .stepping.held_switches import AT_EVENT, NEAR, HeldMotion, HeldSwitches, natural_values, switches_of
from .stepping.kinds import kind_of_stepper
from .stepping.piece_projection import PieceProjection

#: Smallest pivot, relative to that at the entry of a passage, below which a pose is singular and not only near to one.
REALLY_SINGULAR = 0.02
#: Time beyond the place of a failure up to which an event is looked for, as a share of that between two outputs.
BEYOND = 1e-3
#: Time before an event at which switches are on their sides, and from the jump of a prescribed velocity that explains a
#: failure, as a share of the run.
SHORTLY = 1e-5
#: Instants within which what lies at the border of a switch lies there: the zero of an event, the start of a motion.
AT_BORDER = 16


def ends_run(event: Event) -> bool:
    """Return True for an event at which a run in one mechanism ends."""
    return event.terminal or event.becomes is not None


def resets_or_ends(event: Event) -> bool:
    """Return True for an event that decides how a run goes on."""
    return bool(event.reset) or ends_run(event)


@dataclass(frozen=True)
class Outcome:
    """What took place over a piece of a run.

    Attributes
    ----------
    piece : Piece
        The part of it that was gone over.
    path : Path
        States on the constraints.
    crossings, deciding : list of Crossing
        Events up to the first that decides how the run goes on, and those that do so at its instant.
    failure : IntegrationFailure or None
        Why it ended before its end.
    ends_at_jump : bool
        True if it ended just beyond a jump of forces that stopped the integrator.
    """

    piece: Piece
    path: Path
    crossings: list[Crossing]
    deciding: list[Crossing]
    failure: IntegrationFailure | None = None
    ends_at_jump: bool = False


class Arc:
    """One mode of a run.

    Parameters
    ----------
    state : State
        State at which the mode is entered for the first time.
    system : SteppedSystem
        Its equations, and the method that advances them.
    watch : EventWatch
        Looks for the events of the run and for those of the mode itself, `own_events`.
    ranges : Ranges
        Looks for quantities of the model out of their ranges.

    Attributes
    ----------
    stepper : Stepper
        Advances it.
    passage, resolution, unseen_loads, uniqueness, ranges
        Look for singular poses, what the steps did not follow or passed over, reactions that are not unique, and
        quantities out of their ranges.
    policies : tuple of Policy
        Look at the way over a piece, one after the other, before its outputs are kept.
    trail : Trail
        States since the motion last began smoothly.
    """

    def __init__(
        self,
        mode: Any,
        state: State,
        system: SteppedSystem,
        watch: EventWatch,
        own_events: Sequence[Event],
        ranges: Ranges,
    ):
        self.mode, self.numeric, self.watch, self._own_events = mode, system.numeric, watch, own_events
        self._system = system
        self.uniqueness, self.ranges = Uniqueness(self.numeric, redundant=system.redundant), ranges
        regularity = Regularity(self.numeric, state.t, state.q)
        looks = Looks(watch, self.decides, regularity.is_needed)
        self.stepper = kind_of_stepper(system.integrator)(system, looks)
        self.resolution, self.unseen_loads = Resolution(self.stepper), UnseenLoads(self.stepper)
        self.policies = (AcrossFolds(self.passage_from), UpToTouches(self.resolution), MeetLoads(self.unseen_loads))
        self.passage = SingularPassage(regularity, self.stepper.outputs)
        self._projection = PieceProjection(self.stepper, only_requested=not self.watch.events)
        self.trail = Trail()

    def is_own(self, event: Event) -> bool:
        """Return True for an event of the mode itself."""
        return event in self._own_events

    def decides(self, event: Event) -> bool:
        """Return True if the run ends, or changes its mode or velocities, at an event."""
        return resets_or_ends(event) or self.is_own(event)

    def integrated(
        self,
        piece: Piece,
        x: np.ndarray,
        interruption: Interruption,
        comes_near: Callable[[Path], bool] | None = None,
        stopped: IntegrationFailure | None = None,
    ) -> Way:
        """Return the way of the integrator over a piece, or up to where it fails or has something to be decided.

        Parameters
        ----------
        comes_near : callable, optional
            ``path -> bool``: True for a path to a singular pose, at which the integrator may end.
        stopped : IntegrationFailure, optional
            Where it ended so before, if the motion does not pass that pose.
        """
        try:
            path = self.stepper.advance(piece, x, interruption, comes_near, stopped)
        except IntegrationFailure as stopped:
            times = piece.times[: len(stopped.x)]
            nothing = np.zeros((times.size, self.resolution.terms.size))
            return Way(piece, Path(np.r_[piece.start, times], np.vstack([x, stopped.x]), nothing), stopped)
        return Way(piece.refined(path.times[1:]), path)

    def outputs(self, passage: Passage | None) -> Outputs:
        """Return what makes outputs of states, on the way across a singular pose if there is one."""
        return self.stepper.outputs if passage is None else self.stepper.tolerant_outputs

    def on_constraints(
        self, piece: Piece, path: Path, passage: Passage | None
    ) -> tuple[Path, IntegrationFailure | None]:
        """Return a path on the constraints, up to the first state that cannot be brought there, and the failure."""
        if path.of_steps:
            self.stepper.note_turning(path.x[1:])
            return path, None
        x, apart = self._projection.states(piece, path, self.outputs(passage), across=passage is not None)
        self.stepper.note_turning(x)
        return replace(path, times=path.times[: len(x) + 1], x=np.vstack([path.x[:1], x])), apart

    def crossings(self, path: Path, states_from: StatesFrom) -> list[Crossing]:
        """Events on a path, up to the instant of the first that decides, with the motion from a state on it."""
        if not self.watch.events or path.times.size < 2:
            return []
        search = EventSearch(self.watch, self.stepper.outputs, path.times, path.x, states_from)
        return search.crossings(self.decides)

    def outcome(self, piece: Piece, path: Path, failure: IntegrationFailure | None, passage: Passage | None) -> Outcome:
        """Return what took place over a piece.

        Raises
        ------
        IntegrationFailure
            Between two outputs that another run of steps has reached.
        """
        path, apart = self.on_constraints(piece, path, passage)
        failure = apart or failure
        crossings = self.crossings(path, self.stepper.states_from if passage is None else lambda *_: passage.states)
        deciding, count, to_jump = self._deciding(crossings), path.times.size - 1, None
        if failure is not None and passage is None and not deciding and count < piece.times.size:
            to_jump = self.up_to_jump(path, float(piece.times[count]), failure)
        if to_jump is not None:
            path, crossings, failure = to_jump[0], [*crossings, *to_jump[1]], None
            deciding = self._deciding(crossings)
            piece = piece if deciding else piece.until(float(path.times[-1]))
        return Outcome(piece, path, crossings, deciding, failure, ends_at_jump=to_jump is not None)

    def _deciding(self, crossings: Sequence[Crossing]) -> list[Crossing]:
        return [crossing for crossing in crossings if self.decides(crossing.event)]

    def up_to_jump(self, path: Path, end: float, failure: IntegrationFailure) -> tuple[Path, list[Crossing]] | None:
        """Return the way to where forces jump that stop the integrator, and the events on it.

        Parameters
        ----------
        path : Path
            States on the constraints up to the last output before the failure.
        end : float
            Time of the next output, s.
        failure : IntegrationFailure
            Where the integrator got stuck.

        Returns
        -------
        path : Path
            To the state just beyond the jump; if an event decides there how the run goes on, with the next output if
            that is near.
        crossings : list of Crossing
            Events up to the instant of the first that decides.
        None
            If no force jumps there, if the motion began there and so does not get away from it, or if the method steps
            across jumps by itself: what stops it are forces that turn the motion back on either side.
        """
        if failure.last is None or failure.last_x is None:
            return None
        start, x = float(path.times[-1]), path.x[-1]
        before = self.trail.with_path(path, start).before(start - (end - start) / 2)
        # not far beyond: there another force may stop the integrator
        reach = min(end, failure.last + BEYOND * (end - start))
        held = HeldSwitches(self._system, self.stepper.outputs, start, before, (failure.last, failure.last_x))
        if not held.switches:
            return None
        motion = HeldMotion(held, start, x)
        try:
            border = motion.beyond_border(reach, self.watch.instant)
            # an event that is at the border itself may be located behind it
            until = reach if border is None else min(reach, border + AT_BORDER * self.watch.instant)
            further = self._held_way(motion, start, x, until, path)
            crossings = self.crossings(further, lambda *_: motion.states_at)
            if any(self.decides(crossing.event) for crossing in crossings):
                return (Path.joined([path, further]) if until == end else path), crossings
            if border is None or self.stepper.looks_inside:
                return None
            if border - self.trail.start <= AT_BORDER * self.watch.instant:
                return None
            return Path.joined([path, self._held_way(motion, start, x, border, path)]), crossings
        except IntegrationFailure:
            return None
        finally:
            motion.release()

    @staticmethod
    def _held_way(motion: HeldMotion, start: float, x: np.ndarray, end: float, path: Path) -> Path:
        """The path of a held motion from a state to a time, without integrals."""
        times, states = np.array([start, end]), np.vstack([x, motion.states_at(np.array([end]))])
        return Path(times, states, np.zeros((1, path.integrals.shape[1])))

    def outputs_before(self, path: Path, crossing: Crossing) -> Outputs:
        """Return what makes the outputs at an event: switches at their borders there are on their sides before it.

        Parameters
        ----------
        path : Path
            States on the constraints around it.
        crossing : Crossing
            The event.
        """
        outputs, time = self.stepper.outputs, crossing.time
        whole = switches_of(self._system.numeric, self._system.signals).whole
        if not whole.size:
            return outputs
        earlier = time - SHORTLY * self._system.span
        start, x = self.trail.with_path(path, time - self.watch.instant).before(earlier)
        far, near = (natural_values(self._system, outputs, start, *at) for at in ((start, x), (time, crossing.x)))
        if not np.any(np.abs(np.where(whole, near - np.round(near), near)) <= NEAR * np.abs(far)):
            return outputs
        before = start, x
        if start < earlier:
            with contextlib.suppress(IntegrationFailure):
                before = earlier, self.stepper.states_from(start, x)(np.array([earlier]))[0]
        held = HeldSwitches(self._system, outputs, start, before, (time, crossing.x), near=AT_EVENT)
        return held.outputs if held.switches else outputs

    def passage_from(self, path: Path, smooth_until: Callable[[float], float]) -> Passage | None:
        """Return the motion across a singular pose, if a path comes near to one and is not regular enough there.

        Parameters
        ----------
        smooth_until : callable
            ``time -> time`` up to which nothing changes after it.

        Raises
        ------
        SimulationError
            If the pose is singular and the motion cannot be continued.
        """
        if path.is_regular:
            self.passage.note_regular(path)
            return None
        entry = self.passage.entry(path)
        if entry is None:
            return None
        trail = self.trail.with_path(path, entry)

        def states_at(times: np.ndarray) -> np.ndarray:
            time, x = trail.before(float(times[0]))
            x = self.stepper.outputs.projected(np.array([time]), x[None, :])[0]
            return self.stepper.states_from(time, x, precise=True)(times)

        try:
            passage = self.passage.across(entry, trail.start, states_at, smooth_until(entry))
        except IntegrationFailure:
            passage = None
        if passage is None and self.passage.smallest(path) < REALLY_SINGULAR:
            raise singular_stop(self.numeric, entry, *trail.before(entry))
        return passage
