"""The C files of a unit."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..integrators.dop853.native import engine_source
from ..integrators.dop853.stretch import ACCURACY
from ..numerics.c_code import SIGNATURE
from .functions import Model
from .variables import Variables

#: Files that are the same for every mechanism.
FOLDER = Path(__file__).parent / "c"
#: Optimisation of each file that is compiled: a higher level gains nothing for the equations.
OPTIMISATION = {"equations.c": "-O1", "fmi2.c": "-O3", "fmi3.c": "-O3"}


def source_files(
    model: Model,
    variables: Variables,
    levels: np.ndarray,
    identifier: str,
    version: int,
    kinds: frozenset[str],
    *,
    reltol: float,
    abstol: float,
    largest_abstol: float,
) -> dict[str, str]:
    """Return the C files by name; those of :data:`OPTIMISATION` are compiled, and include the others."""
    equations = "#include <math.h>\n\n" + "\n".join(
        _prefixed(tape.as_c, tape.function.name(), identifier) for tape in model.tapes
    )
    engine = engine_source()
    # two units in one program must not share the symbols of their libraries
    prefixes = "".join(
        f"#define {name} {identifier}_{name}\n" for name in sorted(set(re.findall(r"\bmbd_\w+(?=\()", engine)))
    )
    interface = f"fmi{version}.c"
    files = {
        "engine.c": f"{prefixes}\n{engine}",
        **{name: (FOLDER / name).read_text(encoding="utf-8") for name in ("instance.c", "interface.c", interface)},
        "equations.c": equations,
    }
    header = _header(model, variables, levels, identifier, kinds, reltol, abstol, largest_abstol)
    digest = hashlib.sha256("\0".join([*files.values(), header]).encode()).hexdigest()
    # 48 bits are exact in a double
    identity = f"#define MODEL_IDENTITY {int(digest[:12], 16)}.0\n"
    return {"model.h": header + identity, **files}


def _prefixed(text: str, name: str, identifier: str) -> str:
    return re.sub(rf"\b{name}(?=\(|_\d+\()", f"{identifier}_{name}", text)


def _header(
    model: Model,
    variables: Variables,
    levels: np.ndarray,
    identifier: str,
    kinds: frozenset[str],
    reltol: float,
    abstol: float,
    largest_abstol: float,
) -> str:
    eom, numeric, start = model.eom, model.numeric, model.start
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
        "N_CHECKS": len(model.checks),
        "N_VALIDITY": len(model.validity),
        "N_FORCES": len(model.forces),
        "HAS_NEWTON": int(model.has_newton),
        "HAS_CO_SIMULATION": int("co-simulation" in kinds),
        "HAS_MODEL_EXCHANGE": int("model-exchange" in kinds),
        "POSE_IS_NEAREST": int(model.pose_is_nearest),
        "VELOCITY_IS_NEAREST": int(model.velocity_is_nearest),
    }
    numbers = {
        "START_AT": start.t,
        "DEFAULT_RELTOL": reltol,
        "DEFAULT_ABSTOL": abstol,
        "LARGEST_ABSTOL": largest_abstol,
        "ACCURACY": ACCURACY,
        "DRIFT_RATE": model.drift_rate,
    }
    work = {tape.function.name(): tape.work_in_c for tape in model.tapes}
    largest = max(work.values()) + 2 * (eom.q.numel() + eom.lam.numel())
    arrays = {
        "START_X": np.r_[start.q, start.v, start.z],
        "START_P": numeric.p,
        "START_U": levels,
        "ESTIMATE": model.estimate,
        "PROJECTION_WEIGHTS": numeric.projection_weights,
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
    parts = [
        "/* What belongs to this mechanism alone: sizes, start values, names and the functions of its equations. */\n"
    ]
    parts += [f"#define {name} {value}" for name, value in sizes.items()]
    parts += [f"#define {name} {_number(value)}" for name, value in numbers.items()]
    parts += [f"#define WORK_{name} {size}" for name, size in work.items()]
    parts += [f"#define WORK_LARGEST {largest}", ""]
    parts += [f"#define {name} {identifier}_{name}" for name in work]
    parts += [f"int {name}({SIGNATURE});" for name in work]
    parts += ["", *(_array("double", name, [_number(x) for x in values]) for name, values in arrays.items())]
    parts += [_array("int", name, [str(x) for x in values]) for name, values in integers.items()]
    parts += [_array("char* const", name, [_string(x) for x in values]) for name, values in texts.items()]
    return "\n".join(parts) + "\n"


def _array(kind: str, name: str, values: Sequence[str]) -> str:
    """A constant table; C knows none without entries."""
    inside = ", ".join(values) or "0"
    return f"static const {kind} {name}[] = {{{inside}}};"


def _number(value: float) -> str:
    return "INFINITY" if np.isposinf(value) else "(-INFINITY)" if np.isneginf(value) else repr(float(value))


def _string(text: str) -> str:
    """A string in C, of ASCII characters alone."""
    found = "".join(
        chr(byte) if 32 <= byte < 127 and chr(byte) not in '"\\?' else f"\\{byte:03o}" for byte in text.encode()
    )
    return f'"{found}"'
