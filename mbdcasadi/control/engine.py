"""The C of a controller in this process: its library, and the memory of one motion."""

from __future__ import annotations

import ctypes
from collections.abc import Mapping
from ctypes import POINTER, c_char, c_double, c_int, c_size_t
from typing import Any

import numpy as np

from ..errors import ModelError
from ..integrators.native import build
from .code import Horizon
from .functions import ControlFunctions

#: Optimisation of the library.
OPTIMISATION = "-O2"
#: What Python needs besides what leaves it.
_SIZE = "\n#include <stddef.h>\nsize_t controller_bytes(void) { return sizeof(controller); }\n"


class Engine:
    """A compiled controller: functions that work on a memory.

    Parameters
    ----------
    files : mapping of str to str
        Source and header.
    model : ControlFunctions
        Sizes.
    horizon : Horizon
        Number of intervals.
    """

    def __init__(self, files: Mapping[str, str], model: ControlFunctions, horizon: Horizon):
        using = build.compiler()
        if using is None:
            raise ModelError(f"Controller: it is compiled, and {build.no_compiler()}")
        source = files["controller.c"].replace('#include "controller.h"', files["controller.h"]) + _SIZE
        key = build.key_of(source, OPTIMISATION, using.identity)
        library = build.find(key) or build.build(key, source, OPTIMISATION, using)
        n, nx, nu = horizon.intervals, len(model.names), model.eom.u.numel()
        self.states, self.all_inputs = (n + 1, nx), (n, nu)
        numbers = {"p": model.eom.p.numel(), "x": (n + 1) * nx, "u": n * nu}
        counts = "status is_planned is_prepared samples iterations quadratic_steps"
        fields: list[Any] = [(name, c_int) for name in counts.split()]
        fields += [("time", c_double), ("cost", c_double)]
        fields += [(name, c_double * max(size, 1)) for name, size in numbers.items()]
        #: the first members of the struct, as far as Python looks at them
        self._view = type("Memory", (ctypes.Structure,), {"_fields_": fields})
        library.controller_bytes.restype = c_size_t
        self._bytes = int(library.controller_bytes())
        pointer = POINTER(c_double)
        self.reset, self.feedback, self.prepare = (
            library.controller_reset, library.controller_feedback, library.controller_prepare,
        )  # fmt: skip
        self.feedback.argtypes = [ctypes.c_void_p, c_double, pointer, pointer, pointer]
        self.reset.argtypes = self.prepare.argtypes = [ctypes.c_void_p]
        self.reset.restype = self.prepare.restype = None

    def memory(self) -> Memory:
        """Return a new memory."""
        return Memory(self, self._bytes, self._view)


class Memory:
    """What a controller remembers of a motion: its plan."""

    def __init__(self, engine: Engine, size: int, view: Any):
        self._engine, self._room = engine, (c_char * size)()
        self.view = view.from_buffer(self._room)
        self.reset()

    def reset(self) -> None:
        """Forget the plan."""
        self._engine.reset(self._room)

    def feedback(self, time: float, state: np.ndarray, parameters: np.ndarray, count: int) -> tuple[int, np.ndarray]:
        """Return the status and the inputs (count,) at a state."""
        inputs = np.zeros(max(count, 1))
        pointers = (x.ctypes.data_as(POINTER(c_double)) for x in (state, parameters, inputs))
        status = int(self._engine.feedback(self._room, time, *pointers))
        return status, inputs[:count]

    def prepare(self) -> None:
        """Shift the plan by a sample, and linearise about it."""
        self._engine.prepare(self._room)

    @property
    def plan(self) -> tuple[np.ndarray, np.ndarray]:
        """States (n + 1, n_x) and all inputs (n, n_u) of the plan."""
        states, inputs = self._engine.states, self._engine.all_inputs
        x = np.array(self.view.x[: states[0] * states[1]]).reshape(states)
        return x, np.array(self.view.u[: inputs[0] * inputs[1]]).reshape(inputs)
