"""Caches of what is derived from an object and compiled for it."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterator, Mapping
from typing import Any, TypeVar

import casadi as ca

from ..errors import warnings_given
from ..numerics.symbolic import LOCK

T = TypeVar("T")

#: Number of bounded values that are kept, the most recent ones.
RECENT = 256


class Cache(Mapping[Hashable, Any]):
    """Values by key, each made once, whatever the number of threads that request it.

    A key lives as long as its value, and so do the objects in it: use the objects themselves (or an
    :class:`ExpressionKey`) as keys, never their ``id()``.

    A copy and an unpickled cache are empty, since the values can be made again. Of the values requested with
    ``bounded=True`` the most recent ones are kept.

    Parameters
    ----------
    recent : int
        Number of these, or the sum of their sizes, at most.
    size : callable, optional
        Size of a value.
    """

    def __init__(self, recent: int = RECENT, size: Callable[[Any], int] | None = None):
        self._most, self._size = recent, size
        self._kept: dict[Hashable, Any] = {}
        self._recent: OrderedDict[Hashable, Any] = OrderedDict()
        # one lock for all keys and all caches: values are made of expressions, and of values of other caches
        self._lock = LOCK

    def get_or_create_quietly(self, key: Hashable, make: Callable[[], T], *, bounded: bool = False) -> T:
        """Return the same, but keep no value with which a warning was given: it is given again with the value."""
        with self._lock:
            before = warnings_given()
            if key in self:
                return self.get_or_create(key, make, bounded=bounded)
            value = make()
            return value if warnings_given() != before else self.get_or_create(key, lambda: value, bounded=bounded)

    def get_or_create(self, key: Hashable, make: Callable[[], T], *, bounded: bool = False) -> T:
        """Return the value of a key; if there is none yet, make it and keep it.

        If `bounded`, the value may be forgotten when others have been requested since; for keys of which there may be
        any number.
        """
        # without the lock, since permanent entries are requested often and never removed
        if key in self._kept:
            return self._kept[key]
        with self._lock:
            if key in self._kept:
                return self._kept[key]
            if key in self._recent:
                self._recent.move_to_end(key)
                return self._recent[key]
            value = make()
            if not bounded:
                self._kept[key] = value
                return value
            self._recent[key] = value
            while len(self._recent) > 1 and self._amount > self._most:
                self._recent.popitem(last=False)
            return value

    @property
    def _amount(self) -> int:
        """Number of bounded values, or the sum of their sizes."""
        return len(self._recent) if self._size is None else sum(map(self._size, self._recent.values()))

    def __getitem__(self, key: Hashable) -> Any:
        with self._lock:
            return self._kept[key] if key in self._kept else self._recent[key]

    def __iter__(self) -> Iterator[Hashable]:
        with self._lock:
            return iter([*self._kept, *self._recent])

    def __len__(self) -> int:
        return len(self._kept) + len(self._recent)

    def __reduce__(self) -> tuple[type[Cache], tuple[Any, ...]]:
        return type(self), (self._most, self._size)

    def __repr__(self) -> str:
        return f"Cache({len(self)} values)"


class ExpressionKey:
    """Key of an expression: equal for expressions of the same pattern and the same nodes, which it keeps alive."""

    def __init__(self, expression: ca.SX):
        self._expression = expression
        # the hash of a node is unique as long as the node lives
        self._nodes = tuple(entry.element_hash() for entry in ca.vertsplit(ca.vec(expression.nz[:])))

    def __hash__(self) -> int:
        return hash((self._expression.shape, self._nodes))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, ExpressionKey):
            return NotImplemented
        return self._nodes == other._nodes and self._expression.sparsity() == other._expression.sparsity()
