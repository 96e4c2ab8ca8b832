"""A controller as a functional mock-up unit, by the interface of those of mechanisms."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from ..errors import ModelError
from ..fmu.description import Unit
from ..fmu.sources import FOLDER as INTERFACE
from ..fmu.variables import Variable, Variables
from ..model.symbols import Input, Parameter
from .code import FOLDER, Horizon
from .functions import ControlFunctions


@dataclass(frozen=True, eq=False)
class ControllerUnit(Unit):
    """A unit whose inputs are measured states, and whose outputs are the inputs of the machine and a status.

    Of its model, only the time of the start and the dependencies of outputs are known.
    """

    model: Any

    @property
    def compiled(self) -> list[str]:
        """C file that is compiled, which includes the others."""
        return [f"fmi{self.version}.c"]


def controller_unit(
    model: ControlFunctions, horizon: Horizon, p: np.ndarray, units: Mapping[str, str], name: str, version: int
) -> ControllerUnit:
    """Return the unit of a controller; `p` are values of the parameters to begin with.

    Raises
    ------
    ModelError
        For a name that is used twice, and units of unknown variables.
    """
    start = model.eom.function(model.state)(*model.start.arguments).full().ravel()
    shown: list[tuple[str, str, float | None, str]] = [("time", "independent", None, "s")]
    shown += [
        (x, "input", value, unit) for x, value, unit in zip(model.names, start.tolist(), model.units, strict=True)
    ]
    symbols: list[tuple[str, tuple[Parameter | Input, ...]]] = [("parameter", model.mechanism.parameters)]
    symbols.append(("output", model.mechanism.inputs))
    for causality, group in symbols:
        for k, symbol in enumerate(group):
            value = float(p[k]) if causality == "parameter" else None
            shown.append((symbol.label, causality, value, getattr(symbol, "unit", None) or ""))
    shown.append(("status", "output", None, ""))
    names = [name for name, *_ in shown]
    for known in names:
        if names.count(known) > 1:
            raise ModelError(f"export_fmu: the name '{known}' is used twice among states, parameters and inputs")
    for known in units:
        if known not in names:
            raise ModelError(f"export_fmu: units= names '{known}', which is no variable of the controller: {names}")
    variables = [
        Variable(k, name, causality, value, units.get(name, unit))
        for k, (name, causality, value, unit) in enumerate(shown)
    ]
    time, measured, parameters, outputs = (
        tuple(x for x in variables if x.causality == causality)
        for causality in ("independent", "input", "parameter", "output")
    )
    count = len(measured)
    places = list(range(count)), list(range(len(parameters)))
    every = Variables(time, measured, parameters, outputs, (), (), (), *places)
    pattern = np.zeros((0, count), bool), np.ones((len(outputs), count), bool)
    described = SimpleNamespace(start=SimpleNamespace(t=0.0), dependencies=pattern)
    kinds = frozenset({"co-simulation"})
    return ControllerUnit(described, every, name, version, kinds, 1e-8, 1e-8, None, horizon.sample, False)


def unit_files(unit: ControllerUnit, files: Mapping[str, str]) -> dict[str, str]:
    """Return the C files of a unit, of those of an export."""
    code = files["controller.c"].replace('#include "controller.h"', files["controller.h"])
    shared = ("host.c", "interface.c", unit.compiled[0])
    sources = {
        "engine.c": f"#include <stdlib.h>\n#include <string.h>\n\n{code}",
        "instance.c": (FOLDER / "instance.c").read_text(encoding="utf-8"),
        "contacts.c": "/* A controller has no contacts. */\n",
        "cosimulation.c": "/* The steps of a controller are in instance.c. */\n",
        **{name: (INTERFACE / name).read_text(encoding="utf-8") for name in shared},
    }
    digest = hashlib.sha256("\0".join(sources.values()).encode()).hexdigest()
    header = "#define HAS_CO_SIMULATION 1\n#define HAS_MODEL_EXCHANGE 0\n"
    return {"model.h": f"{header}#define MODEL_IDENTITY {int(digest[:12], 16)}.0\n", **sources}
