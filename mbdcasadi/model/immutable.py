"""Objects that do not change after they are made."""

from __future__ import annotations

import inspect
from typing import Any


class Sealed(type):
    """Metaclass that seals each object when its constructor has returned."""

    @property
    def __signature__(cls) -> inspect.Signature:
        """Arguments of the constructor, for help and editors."""
        whole = inspect.signature(cls.__init__)  # type: ignore[misc]
        return whole.replace(parameters=list(whole.parameters.values())[1:])

    def __call__(cls, *args: Any, **kwargs: Any) -> Any:
        instance = super().__call__(*args, **kwargs)
        object.__setattr__(instance, "_sealed", True)
        return instance


class Immutable(metaclass=Sealed):
    """Base class of model elements: identity equality, no assignment after construction.

    Values that are derived on demand use ``functools.cached_property``, which
    stores beside ``__setattr__`` and so stays possible.
    """

    def __setattr__(self, name: str, value: Any) -> None:
        if self.__dict__.get("_sealed", False):
            raise AttributeError(f"{self!r} does not change after it is made; make a new one instead of setting {name}")
        object.__setattr__(self, name, value)

    def __copy__(self) -> Immutable:
        return self

    def __deepcopy__(self, memo: dict) -> Immutable:
        return self
