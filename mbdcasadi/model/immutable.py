"""Objects that do not change after construction, and objects that contain symbols of a model."""

from __future__ import annotations

import copy
import inspect
from typing import Any, NoReturn

from ..errors import ModelError


class HoldsSymbols:
    """Base class of what contains symbols of a model: it is copied, but not pickled.

    CasADi can pickle expressions, but what comes back has other symbols: none of
    the model's own, nor the time, nor the ground would be found in it.
    """

    def __reduce_ex__(self, protocol: Any) -> NoReturn:
        raise ModelError(
            f"{type(self).__name__} objects cannot be pickled: their symbols belong to this process. Build the "
            "mechanism in each process by calling the same function there; results travel as arrays, or by files: "
            "save, and read_trajectory or read_solution; sweep runs cases in several processes"
        )

    def __copy__(self) -> Any:
        clone = object.__new__(type(self))
        clone.__dict__.update(self.__dict__)
        return clone

    def __deepcopy__(self, memo: dict) -> Any:
        clone = memo[id(self)] = object.__new__(type(self))
        clone.__dict__.update(copy.deepcopy(self.__dict__, memo))
        return clone


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

    Values that are derived on demand use ``cached_property``, which
    does not store through ``__setattr__``.
    """

    def __setattr__(self, name: str, value: Any) -> None:
        if self.__dict__.get("_sealed", False):
            raise AttributeError(
                f"{self!r} does not change after construction; make a new one instead of setting {name}"
            )
        object.__setattr__(self, name, value)

    def __copy__(self) -> Immutable:
        return self

    def __deepcopy__(self, memo: dict) -> Immutable:
        return self
