"""Progress bars: one place that knows tqdm, which is imported when a bar is shown."""

from __future__ import annotations

import sys
from typing import Any

_SECONDS = "{desc}: {percentage:3.0f}%|{bar}| {n:.3g} of {total:.3g} s [{elapsed}<{remaining}]"
_ITERATIONS = "{desc}: {n} iterations{postfix}"


class _NoBar:
    """A bar that shows nothing."""

    def __enter__(self) -> _NoBar:
        return self

    def __exit__(self, *_: Any) -> None:
        return None

    def update(self, _amount: float = 1) -> None:
        """Nothing to show."""

    def close(self) -> None:
        """Nothing to close."""


def seconds_bar(total: float, show: bool, *, what: str = "simulate") -> Any:
    """Progress bar over simulated time, s."""
    # a little more than the whole, since the parts are rounded when they are added up
    return _bar(show, total=total * (1 + 1e-9), unit="s", desc=what, bar_format=_SECONDS)


def count_bar(total: int, show: bool, *, what: str, unit: str, done: int = 0) -> Any:
    """Progress bar over a number of things, some of which may be done already."""
    return _bar(show, total=total, initial=done, unit=unit, desc=what)


def iteration_bar(show: bool, *, what: str) -> Any:
    """Counter of iterations whose number is not known; it writes to what is standard error when it is made."""
    return _bar(show, desc=what, unit=" iterations", bar_format=_ITERATIONS, file=sys.stderr)


def _bar(show: bool, **options: Any) -> Any:
    if not show:
        return _NoBar()
    from tqdm.auto import tqdm

    return tqdm(**options)
