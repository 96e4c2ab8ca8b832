"""What a model is made of, as a key: models of equal contents differ in the identity of their symbols alone.

A script that states the same model again builds new symbols and new expressions of them. What was computed from a
model of equal contents and holds no symbols, as numbers and compiled functions do, is found again by the key.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from enum import Enum
from functools import cache
from types import BuiltinFunctionType, CodeType, FunctionType, MappingProxyType, MethodType
from typing import Any

import casadi as ca
import numpy as np

from ..numerics.lazy import cached_property
from .cache import Cache
from .symbols import Role, t

#: Contents of which values are kept, the most recent ones.
RECENT = 8
#: Packages whose functions and classes read nothing but their arguments and attributes.
PACKAGES = frozenset({__name__.partition(".")[0], "types", "numpy", "casadi"})
#: Flag of classes that were made while Python runs, not compiled into it.
MADE_IN_PYTHON = 1 << 9
#: Types of what is its own contents.
PLAIN = frozenset({int, float, bool, str, bytes, complex, type(None), CodeType})

_VALUES = Cache(RECENT)


def values_of_contents(contents: Hashable | None) -> Cache:
    """Return the values that are kept for contents; if these are not known, None, a cache of its own."""
    return Cache() if contents is None else _VALUES.get_or_create(contents, Cache, bounded=True)


def contents_of(*parts: Any, symbols: Sequence[ca.SX] | None = None) -> Hashable | None:
    """Return a key that is equal for parts of equal contents; None if the contents of one are not known.

    Types, names, numbers and expressions count, and which symbols occur where. Attributes that are made on demand do
    not, since they follow from others. The contents of functions and of objects of classes outside the package are
    not known: they may read globals.

    Parameters
    ----------
    symbols : sequence of casadi.SX, optional
        Symbols that another key tells apart: expressions in any others have unknown contents. By default symbols are
        known by the places at which they occur.
    """
    reader = _Reader([t] if symbols is None else [])
    try:
        return tuple([reader.read(part) for part in parts]), reader.expressions(symbols)
    except (_UnknownError, RuntimeError, ValueError):  # CasADi cannot write down every function; a cell may be empty
        return None


class _UnknownError(Exception):
    """A part is of a kind whose contents are not known."""


class _Reader:
    """Reader of parts in their order, after expressions that are known; one that occurs again is a number."""

    def __init__(self, known: list[ca.SX]) -> None:
        self._expressions, self._known = known, len(known)
        self._numbers = {id(expression): k for k, expression in enumerate(known)}

    def expressions(self, symbols: Sequence[ca.SX] | None) -> str:
        """All expressions as one function of their symbols."""
        if len(self._expressions) == self._known:
            return ""
        arguments = ca.symvar(ca.veccat(*self._expressions)) if symbols is None else list(symbols)
        options = {"allow_free": symbols is not None}
        function = ca.Function("contents", arguments, self._expressions, options)
        if symbols is not None and function.has_free():
            raise _UnknownError
        return str(function.serialize())

    def read(self, part: Any) -> Hashable:
        """Contents of a part."""
        kind: Any = type(part)
        if kind in PLAIN:
            return kind, part or repr(part)  # zero has a sign
        if kind is tuple or kind is list:
            return kind, tuple([self.read(entry) for entry in part])
        number = self._numbers.get(id(part))  # what is read lives as long as the parts
        if number is not None:
            return number
        self._numbers[id(part)] = len(self._numbers)
        if isinstance(part, ca.SX):
            self._expressions.append(part)
            return None if kind is ca.SX else (kind, self._attributes(part))
        if kind is dict or kind is MappingProxyType:
            return kind, tuple([(self.read(key), self.read(value)) for key, value in part.items()])
        return self._of_other(part)

    def _of_other(self, part: Any) -> Hashable:
        kind: Any = type(part)
        if kind is Role or kind is Cache:  # they follow from the rest
            return kind
        if kind is set or kind is frozenset:
            entries = frozenset([(type(entry), entry) for entry in part])
            if all(of in PLAIN for of, _ in entries):
                return kind, entries
        if isinstance(part, np.ndarray | np.generic) and part.dtype != object:
            return kind, part.dtype.str, part.shape, part.tobytes()
        # what a function or a class of the user's own reads besides, such as globals, is not known
        if _is_own(part if isinstance(part, type | FunctionType) else kind):
            raise _UnknownError
        if isinstance(part, type | BuiltinFunctionType | FunctionType | MethodType):
            return self._of_code(part)
        if isinstance(part, ca.DM | ca.Sparsity | ca.Function):
            return kind, part.serialize()
        if isinstance(part, tuple) and kind.__dictoffset__:
            return kind, self.read(tuple(part)), self._attributes(part)
        if isinstance(part, Enum):
            return part
        if _is_plain(kind) and not hasattr(part, "this"):  # CasADi's own objects have such a pointer
            return kind, self._attributes(part)
        raise _UnknownError

    def _of_code(self, part: Any) -> Hashable:
        """A class, a function with the values that it keeps, or a method."""
        if isinstance(part, MethodType):
            return self.read(part.__func__), self.read(part.__self__)
        if isinstance(part, FunctionType):
            cells = [cell.cell_contents for cell in part.__closure__ or ()]
            return part.__module__, part.__code__, self.read((cells, part.__defaults__, part.__kwdefaults__))
        return type(part), part

    def _attributes(self, part: Any) -> Hashable:
        kind: Any = type(part)
        derived = _derived(kind)
        return tuple([(name, self.read(value)) for name, value in vars(part).items() if name not in derived])


def _is_own(part: Any) -> bool:
    """True for a function or a class that a user of the package wrote, also as a text without a module."""
    if part.__module__ == "builtins":
        return bool(getattr(part, "__flags__", MADE_IN_PYTHON) & MADE_IN_PYTHON)
    return (part.__module__ or "").partition(".")[0] not in PACKAGES


@cache
def _is_plain(kind: Any) -> bool:
    """True if objects of a class are what their attributes say, and have no further state of their own."""
    slots = any(vars(base).get("__slots__") for base in kind.__mro__)
    return kind.__new__ is object.__new__ and bool(kind.__dictoffset__) and not slots


@cache
def _derived(kind: Any) -> frozenset[str]:
    """Names of attributes that follow from others."""
    names = {"this", "_sealed"}
    for base in kind.__mro__:
        names |= {name for name, value in vars(base).items() if isinstance(value, cached_property)}
    return frozenset(names)
