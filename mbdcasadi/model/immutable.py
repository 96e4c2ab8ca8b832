"""Objects that do not change after construction."""

from __future__ import annotations

import inspect
from typing import Any, ClassVar, NoReturn

from ..errors import ModelError


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


def refuse_pickle(thing: Any) -> NoReturn:
    """Raise the error of an object that contains symbols, which exist in one process only."""
    raise ModelError(
        f"{thing!r} cannot be pickled: its symbols belong to this process; build the model in each process by "
        "calling the same function there, and hand results over by files: motion.save(path)"
    )


class Immutable(metaclass=Sealed):
    """Base class of model elements: identity equality, no assignment after construction.

    Values that are derived on demand use ``functools.cached_property``, which
    does not store through ``__setattr__``.
    """

    #: True if it contains symbols, which cannot be pickled.
    _symbolic: ClassVar[bool] = False

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

    def __reduce_ex__(self, protocol: Any) -> Any:
        if self._symbolic:
            refuse_pickle(self)
        return super().__reduce_ex__(protocol)
