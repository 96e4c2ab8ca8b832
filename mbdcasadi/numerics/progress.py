"""Progress bars: the one place that knows tqdm."""

from __future__ import annotations

from typing import Any

_SECONDS = "{desc}: {percentage:3.0f}%|{bar}| {n:.3g} of {total:.3g} s [{elapsed}<{remaining}]"


def progress_bar(
    total: float | None, description: str, unit: str, *, show: bool, done: float = 0, **settings: Any
) -> Any:
    """Return a bar with ``update(amount)``, as a context manager; one that does nothing unless it is shown.

    Parameters
    ----------
    total : float or None
        Total amount of work, if it is known.
    description, unit : str
        Text before the bar, and unit of its numbers.
    show : bool
        True if it is shown.
    done : float
        Amount of work that was done before.
    """
    if not show:
        return _NoBar()
    from tqdm.auto import tqdm

    return tqdm(total=total, initial=done, desc=description, unit=unit, **settings)


def simulated_time_bar(total: float, *, show: bool) -> Any:
    """Bar over simulated seconds."""
    # a little more than the whole, since the parts are rounded when they are added up
    return progress_bar(total * (1 + 1e-9), "simulate", "s", show=show, bar_format=_SECONDS)


class _NoBar:
    def __enter__(self) -> _NoBar:
        return self

    def __exit__(self, *_: Any) -> None:
        return None

    def update(self, _amount: float) -> None:
        """Nothing to show."""
