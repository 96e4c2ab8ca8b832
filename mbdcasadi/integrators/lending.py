"""Compiled integrators that are kept from one run to the next, each lent to one run at a time."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Any

#: Keys of which something is kept, the most recent ones.
KEPT = 8
#: Integrators of one key that are kept: as many as threads that usually run at once.
ALIKE = 4


class Lending:
    """Objects by key that only one borrower may use at a time.

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

    def __init__(self) -> None:
        self._free: OrderedDict[Hashable, list[Any]] = OrderedDict()
        self._lock = threading.Lock()

    def borrow(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """Return an object of a key that is not lent; if there is none, make one."""
        with self._lock:
            free = self._free.get(key)
            if free:
                self._free.move_to_end(key)
                return free.pop()
        return make()

    def give_back(self, key: Hashable, borrowed: Any) -> None:
        """Keep an object for the next borrower."""
        with self._lock:
            free = self._free.setdefault(key, [])
            self._free.move_to_end(key)
            if len(free) < ALIKE:
                free.append(borrowed)
            while len(self._free) > KEPT:
                self._free.popitem(last=False)

    def __reduce__(self) -> tuple[type[Lending], tuple[()]]:
        return type(self), ()
