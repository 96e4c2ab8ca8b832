"""Bars that count simulated seconds, and output times."""

from __future__ import annotations

from typing import Any

from ..simulation.chunks import Chunk

_FORMAT = "{desc}: {percentage:3.0f}%|{bar}| {n:.3g} of {total:.3g} s [{elapsed}<{remaining}]"


class _NoBar:
    def __enter__(self) -> _NoBar:
        return self

    def __exit__(self, *_: Any) -> None:
        return None

    def update(self, _amount: float) -> None:
        """Nothing to show."""


def progress_bar(chunks: list[Chunk], show: bool) -> Any:
    """Progress bar over the chunks of a run; nothing where none is wanted."""
    if not show:
        return _NoBar()
    from tqdm.auto import tqdm

    # a little more than the whole, since the parts are rounded when they are added up
    total = sum(chunk.length for chunk in chunks) * (1 + 1e-9)
    return tqdm(total=total, unit="s", desc="simulate", bar_format=_FORMAT)


def time_bar(total: int, show: bool) -> Any:
    """Progress bar over output times, or nothing to see."""
    if not show:
        return _NoBar()
    from tqdm.auto import tqdm

    return tqdm(total=total, unit=" times", desc="kinematics")
