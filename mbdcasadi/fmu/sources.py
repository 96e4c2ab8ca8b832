"""The C files of a unit."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path

import numpy as np

from ..integrators.dop853.runner import steps_in_c
from ..integrators.native.run import engine_source
from ..numerics.c_code import SIGNATURE, literal
from ..numerics.c_interface import constant_table
from ..numerics.tolerances import ON_CONSTRAINTS
from ..simulation.contact import gap_closings, watched_terms
from ..simulation.tolerances import absolute_tolerance
from .description import Unit

#: Files that are the same for every mechanism.
FOLDER = Path(__file__).parent / "c"
COMMON = ("host.c", "instance.c", "contacts.c", "cosimulation.c", "interface.c")
#: Optimisation of each file that is compiled: a higher level gains nothing for the equations.
OPTIMISATION = {"equations.c": "-O1", "fmi2.c": "-O3", "fmi3.c": "-O3"}
HEADER = "/* What belongs to this mechanism alone: sizes, start values, names and the functions of its equations. */\n"


def source_files(unit: Unit) -> dict[str, str]:
    """Return the C files by name; those of :data:`OPTIMISATION` are compiled, and include the others."""
    model, identifier = unit.model, unit.identifier
    names = [function.name for function in model.code]
    equations = "#include <math.h>\n\n" + "\n".join(function.as_c for function in model.code)
    equations = re.sub(rf"\b({'|'.join(names)})(?=\(|_\d+\()", rf"{identifier}_\1", equations)
    engine = engine_source(steps_in_c())
    # two units in one program must not share the symbols of their libraries
    prefixes = "".join(
        f"#define {name} {identifier}_{name}\n" for name in sorted(set(re.findall(r"\bmbd_\w+(?=\()", engine)))
    )
    files = {
        "engine.c": f"{prefixes}\n{engine}",
        **{name: (FOLDER / name).read_text(encoding="utf-8") for name in (*COMMON, unit.compiled[1])},
        "equations.c": equations,
    }
    tables = _sizes(unit) + _numbers(unit) + _functions(unit)
    header = "\n".join([HEADER, *tables, *_tables(unit)]) + "\n"
    digest = hashlib.sha256("\0".join([*files.values(), header]).encode()).hexdigest()
    # 48 bits are exact in a double
    identity = f"#define MODEL_IDENTITY {int(digest[:12], 16)}.0\n"
    return {"model.h": header + identity, **files}


def _sizes(unit: Unit) -> list[str]:
    """Lines with the whole numbers."""
    model, variables = unit.model, unit.variables
    eom = model.eom
    sizes = {
        "N_COORDINATES": eom.q.numel(),
        "N_STATES": eom.z.numel(),
        "N_MULTIPLIERS": eom.lam.numel(),
        "N_INPUTS": eom.u.numel(),
        "N_PARAMETERS": eom.p.numel(),
        "N_OUTPUTS": len(variables.outputs),
        "N_SHOWN_INPUTS": len(variables.inputs),
        "N_SHOWN_PARAMETERS": len(variables.parameters),
        "N_INDICATORS": len(variables.indicators),
        "N_TIMED": model.timed.numel(),
        "N_SWITCHES": model.switching.numel_out(0),
        "N_GAPS": len(model.terms.owners),
        "N_CHECKS": len(model.checks),
        "N_BODIES": len(model.eom.mechanism.bodies),
        "N_VALIDITY": len(model.validity),
        "N_FORCES": len(model.forces),
        "HAS_CO_SIMULATION": int("co-simulation" in unit.kinds),
        "HAS_MODEL_EXCHANGE": int("model-exchange" in unit.kinds),
        "POSE_IS_NEAREST": int(model.pose_is_nearest),
        "VELOCITY_IS_NEAREST": int(model.velocity_is_nearest),
    }
    return [f"#define {name} {value}" for name, value in sizes.items()]


def _numbers(unit: Unit) -> list[str]:
    """Lines with other numbers."""
    numbers = {
        "START_AT": unit.model.start.t,
        "DEFAULT_RELTOL": unit.reltol,
        "DEFAULT_ABSTOL": unit.abstol,
        "LARGEST_ABSTOL": absolute_tolerance(unit.model.numeric, np.inf),  # which friction asks for
        "ACCURACY": ON_CONSTRAINTS,
        "DRIFT_RATE": unit.model.drift_rate,
        "SHALLOW": watched_terms.SHALLOW,
        "GAP_SAFETY": gap_closings.SAFETY,
        "COARSE_HALVINGS": gap_closings.COARSE,
        "TURN": gap_closings.TURN,
        "STOPS_IN_STOPPING": gap_closings.PARTS,
        "STOPPING_TIMES": gap_closings.TIMES,
    }
    return [f"#define {name} {literal(value)}" for name, value in numbers.items()]


def _functions(unit: Unit) -> list[str]:
    """Lines with the functions of the equations, and the work that they need."""
    model, identifier = unit.model, unit.identifier
    work = {function.name: function.work_in_c for function in model.code}
    largest = max(work.values()) + 2 * (model.eom.q.numel() + model.eom.lam.numel())
    return [
        *(f"#define WORK_{name} {size}" for name, size in work.items()),
        f"#define WORK_LARGEST {largest}",
        "",
        *(f"#define {name} {identifier}_{name}" for name in work),
        *(f"int {name}({SIGNATURE});" for name in work),
        "",
    ]


def _tables(unit: Unit) -> list[str]:
    """Lines with tables of numbers and texts."""
    model, variables = unit.model, unit.variables
    start = model.start
    arrays = {
        "START_X": np.r_[start.q, start.v, start.z],
        "START_P": model.numeric.p,
        "START_U": model.signals.level_values,
        "ESTIMATE": model.estimate,
        "PROJECTION_WEIGHTS": model.numeric.projection_weights,
        "NOMINALS": np.array([x.nominal for x in variables.states]),
    }
    integers = {
        "INPUT_PLACES": variables.input_places,
        "PARAMETER_PLACES": variables.parameter_places,
        "CHECK_IS_STRICT": [int(strict) for _, strict, _ in model.checks],
    }
    texts = {
        "NAMES": [x.name for x in variables.all],
        "CHECK_MESSAGES": [message for _, _, message in model.checks],
        "VALIDITY_MESSAGES": [condition.message for condition in model.validity],
        "FORCE_OWNERS": [owner for _, owner in model.forces],
    }
    return [
        *(constant_table("double", name, map(literal, values)) for name, values in arrays.items()),
        *(constant_table("int", name, values) for name, values in integers.items()),
        *(constant_table("char* const", name, map(_string, values)) for name, values in texts.items()),
    ]


def _string(text: str) -> str:
    """A string in C, of ASCII characters alone."""
    literal = "".join(
        chr(byte) if 32 <= byte < 127 and chr(byte) not in '"\\?' else f"\\{byte:03o}" for byte in text.encode()
    )
    return f'"{literal}"'
