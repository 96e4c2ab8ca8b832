"""The strategies of a search, in their order."""

from __future__ import annotations

from typing import Any

from ...errors import ModelError
from .all_coordinates import AllCoordinates
from .closing_limits import ClosingLimits
from .first_guesses import FirstGuesses
from .least_violation import LeastViolation
from .natural_motions import NaturalMotions
from .other_durations import OtherDurations
from .random_starts import LastStarts, RandomStarts
from .saddle import PastSaddle
from .strategy import Strategy
from .time_points import TimePoints

#: Those by default: first motions to begin with, then what follows a failure, then what improves a solution.
STRATEGIES: tuple[Strategy, ...] = (
    FirstGuesses(),
    NaturalMotions(),
    RandomStarts(),
    AllCoordinates(),
    OtherDurations(),
    TimePoints(),
    ClosingLimits(),
    LeastViolation(),
    LastStarts(),
    PastSaddle(),
)


def read_strategies(search: Any) -> tuple[Strategy, ...]:
    """Return the strategies that a user gave."""
    try:
        given = tuple(search)
    except TypeError:
        raise ModelError(f"optimize: search= takes a sequence of strategies, got {search!r}") from None
    for wrong in (one for one in given if not isinstance(one, Strategy)):
        remedy = f"{wrong.__name__}()" if isinstance(wrong, type) and issubclass(wrong, Strategy) else "a Strategy"
        raise ModelError(f"optimize: search= takes strategies, got {wrong!r}; give {remedy}")
    for nameless in (one for one in given if not isinstance(getattr(one, "name", None), str)):
        raise ModelError(f'optimize: search=: {nameless!r} has no name; set name = "…" in its class')
    if not given:
        raise ModelError("optimize: search= is empty; nothing would be tried")
    return given
