"""Fields of the objects in a model file, checked when they are read."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import Any

import casadi as ca

from ..errors import FileError, warn
from .arithmetic import parse_arithmetic

#: Fields that any object may have: its kind, and remarks that no analysis needs.
COMMON = ("name", "id", "type", "vis", "comment")
_REQUIRED: Any = object()


class Fields:
    """The fields of one object of a file, which messages call `what`: ``"constraint 'driver'"``."""

    def __init__(self, data: Any, file: str, what: str):
        self.file = file
        self.description = what
        if not isinstance(data, dict):
            raise self.refuse(f"must be an object {{…}}, got {_shown(data)}")
        self.data = data
        self._read = set(COMMON)
        repeated = [name for name in getattr(data, "repeated", ()) if name != "vis"]
        if repeated:
            raise self.refuse(f"the field {_quoted(repeated)} is given more than once")

    def refuse(self, reason: str) -> FileError:
        """Error that names the file and the object."""
        return FileError(f"{self.file}: {self.description}: {reason}" if self.description else f"{self.file}: {reason}")

    def get(self, name: str, default: Any = _REQUIRED) -> Any:
        """Value of a field as the file has it."""
        self._read.add(name)
        if name in self.data:
            return self.data[name]
        if default is _REQUIRED:
            raise self.refuse(f"the field '{name}' is missing; it has {_quoted(self.data) or 'none'}")
        return default

    def has(self, name: str) -> bool:
        """Return True if the field is present."""
        return name in self.data

    def text(self, name: str, default: Any = _REQUIRED) -> str:
        """Text that is not empty."""
        value = self.get(name, default)
        if not isinstance(value, str) or not value.strip():
            raise self.refuse(f"{name} must be a text, got {_shown(value)}")
        return value.strip()

    def number(self, name: str, *, at_least: float = -math.inf, above: float = -math.inf) -> float:
        """Finite number within limits."""
        value = self.get(name)
        if not _is_number(value):
            raise self.refuse(f"{name} must be a finite number, got {_shown(value)}")
        if value < at_least:
            raise self.refuse(f"{name} must be at least {at_least:g}, got {value}")
        if value <= above:
            raise self.refuse(f"{name} must be above {above:g}, got {value}")
        return float(value)

    def whole(self, name: str) -> int:
        """Whole number."""
        value = self.get(name)
        if not _is_number(value) or value != int(value):
            raise self.refuse(f"{name} must be a whole number, got {_shown(value)}")
        return int(value)

    def numbers(self, name: str, count: int, default: Any = _REQUIRED) -> tuple[float, ...]:
        """List of `count` finite numbers."""
        value = self.get(name, default)
        if not isinstance(value, list | tuple) or len(value) != count or not all(_is_number(v) for v in value):
            raise self.refuse(f"{name} must be {count} finite numbers [{', '.join('…' * count)}], got {_shown(value)}")
        return tuple(float(v) for v in value)

    def direction(self, name: str) -> float:
        """Angle of a vector that is not zero, rad."""
        x, y = self.numbers(name, 2)
        if x == 0 and y == 0:
            raise self.refuse(f"{name} is [0, 0], which has no direction")
        return math.atan2(y, x)

    def function(self, name: str = "fun", default: Any = _REQUIRED) -> ca.SX:
        """Arithmetic in t, or a number."""
        value = self.get(name, default)
        if _is_number(value):
            return ca.SX(float(value))
        if not isinstance(value, str):
            raise self.refuse(f"{name} must be a text with arithmetic in t, got {_shown(value)}")
        return parse_arithmetic(value, f"{self.file}: {self.description}: {name}")

    def no_function(self) -> None:
        """Check that ``fun`` is absent, NONE or zero, for elements that take none."""
        value = self.get("fun", "NONE")
        if isinstance(value, str) and value.strip().upper() in ("NONE", ""):
            return
        function = self.function()
        if not (function.is_constant() and float(function) == 0):
            raise self.refuse(f'fun = {_shown(value)}, but a {self.data.get("type")} takes no function; write "NONE"')

    def done(self) -> None:
        """Warn of fields that are not used."""
        unused = [name for name in self.data if name not in self._read]
        if unused:
            warn(f"{self.file}: {self.description}: {_quoted(unused)} is not used")


def objects(data: dict[str, Any], name: str, file: str) -> list[Any]:
    """The list of a file's bodies, constraints or forces; an object without fields is ignored."""
    value = data.get(name, [])
    if isinstance(value, dict):
        value = [value]
    if not isinstance(value, list):
        raise FileError(f"{file}: {name} must be a list of objects [{{…}}, …], got {_shown(value)}")
    return [entry for entry in value if entry != {}]


def _is_number(value: Any) -> bool:
    if not isinstance(value, int | float) or isinstance(value, bool):
        return False
    try:
        return math.isfinite(float(value))
    except OverflowError:
        return False


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 80 else text[:80] + "…"


def _quoted(names: Collection[str]) -> str:
    return ", ".join(f"'{name}'" for name in names)
