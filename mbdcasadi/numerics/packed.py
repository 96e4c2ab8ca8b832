"""Compiled functions that travel between processes."""

from __future__ import annotations

import threading
from collections import OrderedDict
from uuid import uuid4

import casadi as ca

#: Functions that are kept unpacked in a process.
KEPT = 64

_unpacked: OrderedDict[tuple[str, int], ca.Function] = OrderedDict()
_lock = threading.Lock()


class Packed:
    """A function that unpacks once in each process and thread: an integrator keeps a memory of its own."""

    def __init__(self, function: ca.Function):
        self._key, self._text = uuid4().hex, function.serialize()

    def unpacked(self) -> ca.Function:
        """Return the function, of this thread alone."""
        key = self._key, threading.get_ident()
        with _lock:
            function = _unpacked.get(key)
            if function is None:
                function = _unpacked[key] = ca.Function.deserialize(self._text)
            _unpacked.move_to_end(key)
            while len(_unpacked) > KEPT:
                _unpacked.popitem(last=False)
        return function
