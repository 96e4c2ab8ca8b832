"""Structures and statuses that Python and the C of the engines share: declared here, and written from here for both."""

from __future__ import annotations

import ctypes
from ctypes import c_double, c_int, c_longlong, c_void_p
from typing import Any, get_type_hints

from ...numerics.c_code import SIGNATURE
from .stretch import Progress, Status, Stretch

#: Members of a structure: their type in C, their names, and a remark; any pointer is an address.
Members = tuple[Any, str, str]
_TYPES: dict[str, Any] = {"double": c_double, "integer": c_longlong, "int": c_int}
#: Types in C by those of Python.
_IN_C = {float: "double", int: "integer", bool: "integer"}


class Shared:
    """A structure in C, and its class of ``ctypes``, which takes no other names.

    Parameters
    ----------
    name, meaning : str
        Its name in C, and a remark.
    *members : Members
        In order; the type is one of C, or another structure.

    Attributes
    ----------
    names : tuple of str
        Of all members.
    """

    def __init__(self, name: str, meaning: str, *members: Members):
        self.name, self.meaning = name, meaning
        self._members = [(kind, one, remark) for kind, names, remark in members for one in names.split()]
        self.names = tuple([one for _, one, _ in self._members])
        fields = [(one, _type_of(kind)) for kind, one, _ in self._members]
        self._class = type(name, (ctypes.Structure,), {"_fields_": fields, "__slots__": ()})

    def __call__(self, **values: Any) -> Any:
        """Return one with some values; the others are zero."""
        return self._class(**values)

    @property
    def size(self) -> int:
        """Bytes of it as Python lays it out."""
        return ctypes.sizeof(self._class)

    @property
    def size_function(self) -> str:
        """Name of the function in C that returns the bytes of it as the compiler lays it out."""
        return f"mbd_size_of_{self.name}"

    @property
    def in_c(self) -> str:
        """Declaration in C, and the function that returns its size."""
        lines = [
            f"  {kind.name if isinstance(kind, Shared) else kind} {one};{f' /* {remark} */' if remark else ''}\n"
            for kind, one, remark in self._members
        ]
        size = f"integer {self.size_function}(void) {{ return (integer)sizeof({self.name}); }}\n"
        return f"/* {self.meaning} */\ntypedef struct {{\n{''.join(lines)}}} {self.name};\n\n{size}"


def _type_of(kind: str | Shared) -> Any:
    return kind._class if isinstance(kind, Shared) else _TYPES.get(kind, c_void_p)


def numbers_of(kind: type) -> dict[str, str]:
    """Return the attributes of a class that are numbers, with their types in C."""
    return {name: _IN_C[of] for name, of in get_type_hints(kind).items() if of in _IN_C}


def _numbers(kind: type) -> list[Members]:
    return [(in_c, name, "") for name, in_c in numbers_of(kind).items()]


FUNCTION = Shared(
    "function_t",
    "A function as compiled code, or as a tape of `count` instructions where `code` is null.",
    ("code_t", "code", ""),
    ("const int*", "tape", ""),
    ("const double*", "constants", ""),
    ("integer", "count work", ""),
)
SYSTEM = Shared(
    "system_t",
    "The equations; read only.",
    ("integer", "coordinates states multipliers inputs integrals switches events event_needs_dynamics", ""),
    (FUNCTION, "input", "(t, q, v, z, p, levels, channel) -> u"),
    (FUNCTION, "dynamics", "(t, q, v, z, u, p) -> (a, rate of z, lam, regularity)"),
    (FUNCTION, "quadrature", "(t, q, v, a, z, lam, u, p) -> rates of the integrals"),
    (FUNCTION, "projection", "(t, q, v, z, p, weights) -> (q, v, largest |Phi| that is left)"),
    (FUNCTION, "switching", "(t, q, v, z, p) -> quantities at whose zeros the equations switch"),
    (FUNCTION, "event", "(t, q, v, a, z, lam, u, p) -> values"),
    (
        FUNCTION,
        "slopes",
        "(t, q, v, z, u, p, levels, channel) -> slopes of (a, rate of z) by (q, v, z), by columns; of implicit methods",
    ),
)
STRETCH = Shared(
    "stretch_t",
    "One stretch of a run: what is given, what is handed on to the next one, and what is returned.",
    ("const double*", "x", "(q, v, z) at the start, on the constraints"),
    ("integer", "count", "of the times"),
    ("const double*", "times", "increasing, later than the start"),
    ("const int*", "stops", "over which of them no step may go; the last one always counts"),
    ("const double*", "channels", "what holds by interval: (count, channel) by row"),
    ("integer", "channel", ""),
    ("const double*", "p levels weights", ""),
    *_numbers(Stretch),
    ("double", "accuracy", "|Phi| relative to 1 + |q| that is rounding"),
    ("const volatile int*", "halt", ""),
    ("integer", "samples", "points inside every step at which events are looked at"),
    ("const double*", "offset band side", "by event"),
    ("const int*", "direction decides", "by event"),
    ("integer", "capacity", "rows of the states that are returned"),
    *_numbers(Progress),
    ("double*", "out_times out_x out_integrals", ""),
    ("integer*", "out_index", "place among the times, or -1"),
    ("integer", "recorded reached steps rejected evaluations", ""),
    ("double", "time least_regularity", ""),
    ("int", "status", ""),
)
CASES = Shared(
    "cases_t",
    "Cases with as many outputs each. Arrays are by case; those of times are shared if their stride is zero.",
    ("integer", "parameters levels outputs", ""),
    ("integer", "rows", "outputs in time, the start among them"),
    ("integer", "output_needs_dynamics", ""),
    (FUNCTION, "output", "(t, q, v, a, z, lam, u, p) -> outputs"),
    ("const double*", "starts p levels_of", ""),
    ("integer", "stride", "0, or the number of times of a case"),
    ("const double*", "times max_step", ""),
    ("const double*", "channels", "what holds by interval"),
    ("const int*", "stops requested", ""),
    ("double*", "values", "(case, rows, outputs)"),
    ("int*", "status", ""),
    ("double*", "reached", "times up to which they came"),
    ("double*", "work", "for the output function"),
)
STRUCTURES = (FUNCTION, SYSTEM, STRETCH, CASES)


def in_c() -> str:
    """Return the declarations in C."""
    statuses = ", ".join(f"{status.name} = {status.value}" for status in Status)
    head = f"typedef long long integer;\ntypedef int (*code_t)({SIGNATURE});\nenum status {{ {statuses} }};\n"
    return "\n".join([head, *(structure.in_c for structure in STRUCTURES)])
