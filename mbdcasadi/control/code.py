"""A controller as C99: one file, its header, and a program that calls it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..model.units import unit_of
from ..numerics.c_code import SIGNATURE, literal, tape_of
from ..numerics.c_interface import constant_table
from .functions import ControlFunctions

#: Files that are the same for every controller.
FOLDER = Path(__file__).parent / "c"
#: What a step returns, by its name in C, with its meaning.
STATUSES = {
    "SOLVED": "the input is that of a plan that meets the equations and limits to first order",
    "NOT_FINITE": "time, state or parameters are no finite numbers; the input is that of the last plan",
    "NO_VALUE": "no plan begins here: loops do not close, or something has no value; the input is the last plan's",
    "NOT_MET": "no plan from this state meets the limits; the input is that of one that passes them by little",
    "NOT_CONVERGED": "the iterations ended before they converged; the input is that of the plan so far",
}


@dataclass(frozen=True)
class Horizon:
    """Times of a controller, and its iterations.

    Attributes
    ----------
    sample, interval : float
        Time between two steps, and length of an interval of the plan, s.
    intervals, iterations, steps : int
        Number of intervals, most iterations in a step, and Runge-Kutta steps over an interval.
    """

    sample: float
    interval: float
    intervals: int
    iterations: int
    steps: int


def source_files(model: ControlFunctions, horizon: Horizon) -> dict[str, str]:
    """Return ``controller.c``, ``controller.h`` and ``main.c`` by name."""
    return {
        "controller.c": _source(model),
        "controller.h": _header(model, horizon),
        "main.c": (FOLDER / "main.c").read_text(encoding="utf-8"),
    }


def _source(model: ControlFunctions) -> str:
    names = [function.name() for function in model.functions]
    code = "\n".join(tape_of(function).as_c for function in model.functions)
    # arguments that nothing uses would be warnings
    mine = "const double** arg, double** res, double* w"
    code = code.replace(SIGNATURE, mine)
    unused = "  (void)arg; (void)res; (void)w;\n"
    code = re.sub(rf"((?:static void|int) \w+\({re.escape(mine)}\)) {{\n", rf"\1 {{\n{unused}", code)
    code = re.sub(rf"^int ({'|'.join(names)})\(", r"static int \1(", code, flags=re.MULTILINE)
    start = model.start
    tree = model.tree.independent
    state = model.eom.function(model.state)(*start.arguments).full().ravel()
    inputs = np.clip(
        [u.value for u in model.eom.mechanism.inputs],
        [u.lower for u in model.eom.mechanism.inputs],
        [u.upper for u in model.eom.mechanism.inputs],
    )
    tables = [
        _numbers("controller_start_pose", start.q[tree]),
        _numbers("controller_start_state", state),
        _numbers("controller_start_inputs", inputs),
        _numbers("controller_start_parameters", model.eom.parameter_values),
        constant_table("int", "controller_row_has_input", map(int, model.has_input)),
        constant_table("int", "controller_rows_at_ends", model.at_ends),
        constant_table("int", "controller_end_kinds", [2 if x else 1 for x in model.equalities]),
    ]
    pieces = ['#include "controller.h"\n\n#include <math.h>\n', code, "\n".join(tables) + "\n"]
    pieces += [(FOLDER / name).read_text(encoding="utf-8") for name in ("program.c", "controller.c")]
    return "\n".join(pieces)


def _numbers(name: str, values: np.ndarray) -> str:
    return constant_table("double", name, [literal(float(x)) for x in values])


def _header(model: ControlFunctions, horizon: Horizon) -> str:
    eom, mechanism = model.eom, model.mechanism
    work = max(tape_of(function).work_in_c for function in model.functions)
    n_w, n_b = model.independent.positions.numel(), model.independent.rates.numel()
    sizes = {
        "STATES": len(model.names),
        "INPUTS": len(mechanism.inputs),
        "PARAMETERS": eom.p.numel(),
        "UNKNOWN_INPUTS": eom.u.numel(),
        "COORDINATES": model.q.numel(),
        "POSITIONS": n_w,
        "RATES": n_b,
        "FIRST_ORDER": eom.z.numel(),
        "ROWS": len(model.has_input),
        "ROWS_AT_ENDS": len(model.at_ends),
        "END_ROWS": len(model.equalities),
        "END_INPUTS": len(model.amounts),
        "MOST_ROWS": max(len(model.has_input) + len(model.at_ends), len(model.equalities)),
        "INTERVALS": horizon.intervals,
        "STEPS": horizon.steps,
        "ITERATIONS": horizon.iterations,
        "WORK": work,
        "IS_TIMED": int(model.is_timed),
    }
    text = (FOLDER / "controller.h").read_text(encoding="utf-8")
    lists = {
        "states": [_entry(k, name, unit) for k, (name, unit) in enumerate(zip(model.names, model.units, strict=True))],
        "inputs": [_entry(k, u.label, unit_of(u)) for k, u in enumerate(mechanism.inputs)],
        "parameters": [_entry(k, p.label, unit_of(p)) for k, p in enumerate(mechanism.parameters)],
        "statuses": [
            f"#define CONTROLLER_{name} {k} /* {meaning} */" for k, (name, meaning) in enumerate(STATUSES.items())
        ],
        "sizes": [f"#define CONTROLLER_{name} {size}" for name, size in sizes.items()],
        "times": [
            f"#define CONTROLLER_SAMPLE {literal(horizon.sample)} /* s */",
            f"#define CONTROLLER_INTERVAL {literal(horizon.interval)} /* s */",
        ],
    }
    for name, lines in lists.items():
        text = text.replace(f"@{name}@", "\n".join(lines))
    return text


def _entry(place: int, label: str, unit: str) -> str:
    label = label.replace("*/", "* /").replace("\n", " ")
    return f"     {place:3d}  {label}{f', {unit}' if unit else ''}"
