"""CasADi's integrator plugins: their options, and what they say when they fail."""

from __future__ import annotations

import shutil
from typing import Any

from ..errors import SimulationError

#: IDAS is given this much tighter tolerances than asked for: its error accumulates faster than that of one-step
#: methods (measured: the energy of a four-bar over 100 s then stays within 2e-5 at 1e-8).
TIGHTER = 30.0


def plugin_options(method: str, reltol: float, abstol: float, algebraic: bool) -> dict[str, Any]:
    """Options that were measured best, by plugin."""
    if method != "idas":
        return {"reltol": reltol, "abstol": abstol, "show_eval_warnings": False, "error_on_fail": False}
    idas: dict[str, Any] = {
        "reltol": _tightened(reltol),
        "abstol": _tightened(abstol),
        "linear_solver": "csparse",
        "disable_internal_warnings": True,
        "show_eval_warnings": False,
        "print_time": False,
    }
    # multipliers left out of the error test at a tighter tolerance: faster at equal error
    return idas | {"suppress_algebraic": True} if algebraic else idas


def _tightened(tolerance: float) -> float:
    """Local tolerance of the multistep method, whose global error is well above it."""
    return max(tolerance / TIGHTER, min(tolerance, 1e-12))


def compiler_options(jit: bool) -> dict[str, Any]:
    """Options that have the functions compiled by the C compiler of the machine."""
    if not jit:
        return {}
    name = next((c for c in ("gcc", "clang", "cc") if shutil.which(c)), None)
    if name is None:
        raise SimulationError(
            "jit=True needs a C compiler, and none of gcc, clang, cc is on the path; install one or leave jit out"
        )
    flags = {"compiler": name, "flags": ["-O2"], "verbose": False}
    return {"jit": True, "compiler": "shell", "jit_options": flags}


def last_line(error: Exception) -> str:
    """Last line of what an error says."""
    lines = [line for line in str(error).splitlines() if line.strip()]
    return lines[-1] if lines else "no reason given"


def flag_of(error: Exception) -> str:
    """The plugin's own word for a failure."""
    text = str(error)
    for word in text.replace('"', " ").split():
        if word.startswith("IDA_"):
            return word
    return last_line(error)
