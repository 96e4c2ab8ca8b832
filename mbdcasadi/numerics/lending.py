"""Compiled functions and solvers that are kept from one run to the next, each lent to one run at a time."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Any, TypeVar

Made = TypeVar("Made")

#: Keys of which something is kept, the most recent ones.
KEPT = 8
#: Objects of one key that are kept, if nothing else is asked for: as many as threads that usually run at once.
ALIKE = 4


class Lending:
    """Objects by key that only one borrower may use at a time.

    Parameters
    ----------
    alike : float
        Objects of one key that are kept at most; infinite to keep as many as were lent at once.

    Examples
    --------
    >>> lending = Lending()
    >>> first = lending.borrow("key", list)
    >>> lending.borrow("key", list) is first
    False
    >>> lending.give_back("key", first)
    >>> lending.borrow("key", list) is first
    True
    """

    def __init__(self, alike: float = ALIKE) -> None:
        self._alike = alike
        self._free: OrderedDict[Hashable, list[Any]] = OrderedDict()
        self._lock = threading.Lock()

    @property
    def idle(self) -> int:
        """Number of objects that are kept and not lent."""
        with self._lock:
            return sum(map(len, self._free.values()))

    def borrow(self, key: Hashable, make: Callable[[], Made]) -> Made:
        """Return an object of a key that is not lent; if there is none, make one."""
        with self._lock:
            free = self._free.get(key)
            if free:
                self._free.move_to_end(key)
                kept: Made = free.pop()
                return kept
        return make()

    def give_back(self, key: Hashable, borrowed: Any) -> None:
        """Keep an object for the next borrower."""
        with self._lock:
            free = self._free.setdefault(key, [])
            self._free.move_to_end(key)
            if len(free) < self._alike:
                free.append(borrowed)
            while len(self._free) > KEPT:
                self._free.popitem(last=False)

    def __reduce__(self) -> tuple[type[Lending], tuple[float]]:
        return type(self), (self._alike,)
