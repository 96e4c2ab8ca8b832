"""What is derived and compiled for an object, made when it is first asked for and kept."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar

T = TypeVar("T")


class Cache(dict[Any, Any]):
    """Values by key, each made once."""

    def get_or_create(self, key: Any, make: Callable[[], T]) -> T:
        """The value of a key; where there is none yet, what `make` returns."""
        if key not in self:
            self[key] = make()
        return self[key]
