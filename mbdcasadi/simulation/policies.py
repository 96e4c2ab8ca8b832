"""Policies of a run: each looks at the way over a piece, and has it integrated again, before its outputs are kept."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

from ..integrators.compiled import IntegrationFailure
from .checks.resolution import Resolution
from .checks.unseen_loads import UnseenLoads
from .path import Path
from .schedule import Piece
from .singular.passage import Passage
from .stepping.compiled_stepper import NearSingularPose

#: Fraction of a piece within which a restart at a touch would lead no further.
NEW_START = 1e-6
#: Times that the path across one load is examined, at most.
LOOKS = 4


class Way(NamedTuple):
    """The way over a piece of a run, or over its first part.

    Attributes
    ----------
    piece : Piece
        What was gone over.
    path : Path
        States of the integrator.
    failure : IntegrationFailure or None
        Where the integrator got stuck.
    passage : Passage or None
        Motion across a singular pose that the path comes near to.
    """

    piece: Piece
    path: Path
    failure: IntegrationFailure | None = None
    passage: Passage | None = None

    @property
    def is_decided(self) -> bool:
        """True if no other policy is asked."""
        return self.failure is not None or self.passage is not None


class Advance(Protocol):
    """A run that stands at the start of a piece."""

    def integrated(self, piece: Piece, *, stopped: IntegrationFailure | None = None) -> Way:
        """Return the way over a piece; after a failure by other means from there on."""
        ...

    def stop_at(self, *times: Any) -> None:
        """Add times that no step may cross, wherever the pieces end."""
        ...

    def smooth_until(self, time: float) -> float:
        """Return the time up to which nothing changes after another."""
        ...


class Policy(ABC):
    """What is done about one thing that may happen on the way; see ``Arc.policies`` for their order."""

    @abstractmethod
    def followed(self, way: Way, run: Advance) -> Way:
        """Return the way that is kept: the one given, a part of it, or one that was integrated again.

        Raises
        ------
        SimulationError
            If the run cannot go on.
        """


class AcrossFolds(Policy):
    """Go across singular poses, in which the mechanism could fold.

    Parameters
    ----------
    passage_from : callable
        ``(path, smooth_until) -> Passage or None``.
    """

    def __init__(self, passage_from: Callable[[Path, Callable[[float], float]], Passage | None]):
        self._passage_from = passage_from

    def followed(self, way: Way, run: Advance) -> Way:
        passage = self._passage_from(way.path, run.smooth_until)
        if passage is None and isinstance(way.failure, NearSingularPose):
            way = run.integrated(way.piece, stopped=way.failure)
            passage = self._passage_from(way.path, run.smooth_until) if way.failure is None else None
        return way._replace(passage=passage)


class UpToTouches(Policy):
    """End a piece at the first contact that closes and that its steps did not follow.

    The steps on the way to its end differ, and may not follow a contact that others followed: they are looked at again.
    """

    def __init__(self, resolution: Resolution):
        self._resolution = resolution

    def followed(self, way: Way, run: Advance) -> Way:
        start, length = way.piece.start, way.piece.length
        touch = self._resolution.first_touch(way.path)
        while touch is not None and NEW_START * length <= touch[0] - start < way.piece.length:
            run.stop_at([touch[0]], touch[1])
            way = run.integrated(way.piece.until(touch[0]))
            touch = self._resolution.first_touch(way.path) if way.failure is None else None
        return way


class MeetLoads(Policy):
    """Go up to a load that the steps of the integrator passed over, or across it.

    A load changes the motion, and so the instants at which it ends: the path across it is looked at again.
    """

    def __init__(self, unseen: UnseenLoads):
        self._unseen = unseen

    def followed(self, way: Way, run: Advance) -> Way:
        for _ in range(LOOKS):
            load = self._unseen.first(way.path)
            if load is None:
                break
            piece, path = way.piece, way.path
            if load.interval:
                end = float(path.times[load.interval])
                run.stop_at([end], load.stops)
                piece = piece.until(end)
                if not path.of_steps:
                    return Way(piece, path.until(end))
                # outputs inside a step that met the load in some of its stages are not to be trusted
            else:
                run.stop_at(load.stops)
                piece = piece.until(float(load.stops[-1])).through(load.stops)
            way = run.integrated(piece)
            if way.failure is not None:
                break
        return way
