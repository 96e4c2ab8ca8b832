"""Lists that the user gives, checked where they enter."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import casadi as ca

from ..errors import ModelError


def entries(values: Any, argument: str) -> tuple:
    """Entries of a list as a tuple; a single part without brackets is refused, and what is no list."""
    # a casadi.SX has entries too, and so do texts and mappings; none of them is meant as a list of parts
    if isinstance(values, ca.SX | str | bytes | Mapping) or not isinstance(values, Iterable):
        raise ModelError(f"{argument} takes a list, got {values!r}; write {argument}[…]")
    return tuple(values)


def refuse_twice(symbols: Iterable[Any], what: str) -> None:
    """Refuse a symbol that stands in a list twice."""
    seen: list[Any] = []
    for symbol in symbols:
        if any(symbol is other for other in seen):
            raise ModelError(f"{what} holds '{symbol.label}' twice")
        seen.append(symbol)


def listed(values: Any, kind: type, what: str) -> tuple:
    """The symbols of a list as a tuple; anything of another kind is refused."""
    result = entries(values, what)
    for value in result:
        if not isinstance(value, kind):
            raise ModelError(f"{what} takes {kind.__name__} objects, got {value!r}")
    return result
