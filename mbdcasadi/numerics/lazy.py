"""Attributes and optional packages that are made or imported when they are first used."""

from __future__ import annotations

import functools
import sys
from importlib import import_module
from typing import TYPE_CHECKING, Any

from ..errors import MechanismError

if TYPE_CHECKING or sys.version_info >= (3, 12):
    from functools import cached_property
else:

    class cached_property(functools.cached_property):
        """``functools.cached_property`` as it is from Python 3.12 on.

        Before, it holds a lock that all instances of a class share. A thread that waits for the lock of expressions
        inside it, and one that holds that lock and waits for this one, would wait for each other forever.
        """

        def __get__(self, instance: Any, owner: Any = None) -> Any:
            if instance is None:
                return self
            known = instance.__dict__
            if self.attrname not in known:
                known[self.attrname] = self.func(instance)
            return known[self.attrname]


__all__ = ["cached_property", "optional_package"]


def optional_package(name: str, method: str, extra: str) -> Any:
    """Return a package that a method needs and that is installed with an extra of this one.

    Raises
    ------
    MechanismError
        If it is not installed; it says how to install it.
    """
    try:
        return import_module(name)
    except ImportError:
        raise MechanismError(f'{method} needs {name}; install it by pip install "mbdcasadi[{extra}]"') from None
