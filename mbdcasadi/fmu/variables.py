"""Variables of a unit: names, units, start values and value references."""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..arguments.values import position_in
from ..equations import Equations
from ..errors import ModelError
from ..model.symbols import Input, Parameter
from .functions import Model

#: Exponents of the SI base units kg, m, s, A and rad in units that are known by name, and a factor.
UNITS: dict[str, dict[str, float]] = {
    "1": {},
    "s": {"s": 1},
    "m": {"m": 1},
    "mm": {"m": 1, "factor": 1e-3},
    "m/s": {"m": 1, "s": -1},
    "m/s2": {"m": 1, "s": -2},
    "rad": {"rad": 1},
    "rad/s": {"rad": 1, "s": -1},
    "rad/s2": {"rad": 1, "s": -2},
    "deg": {"rad": 1, "factor": float(np.pi / 180)},
    "kg": {"kg": 1},
    "kg.m2": {"kg": 1, "m": 2},
    "N": {"kg": 1, "m": 1, "s": -2},
    "kN": {"kg": 1, "m": 1, "s": -2, "factor": 1e3},
    "N.m": {"kg": 1, "m": 2, "s": -2},
    "N/m": {"kg": 1, "s": -2},
    "N.s/m": {"kg": 1, "s": -1},
    "N.m/rad": {"kg": 1, "m": 2, "s": -2, "rad": -1},
    "N.m.s/rad": {"kg": 1, "m": 2, "s": -1, "rad": -1},
    "J": {"kg": 1, "m": 2, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "A": {"A": 1},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "Ohm": {"kg": 1, "m": 2, "s": -3, "A": -2},
    "Hz": {"s": -1},
}


@dataclass(frozen=True)
class Variable:
    """One variable.

    Attributes
    ----------
    reference : int
        Value reference.
    name : str
        Name, used once.
    causality : str
        In the words of FMI.
    start : float or None
        Start value of a variable that can be set.
    unit : str
        Unit, or nothing if it is not known.
    lower, upper : float
        Limits.
    rate_of : int or None
        Value reference of the state of which it is the rate.
    nominal : float
        Typical size.
    """

    reference: int
    name: str
    causality: str
    start: float | None = None
    unit: str = ""
    lower: float = -np.inf
    upper: float = np.inf
    rate_of: int | None = None
    nominal: float = 1.0


@dataclass(frozen=True, eq=False)
class Variables:
    """All variables of a unit, in the order of their value references.

    Attributes
    ----------
    time, inputs, parameters, outputs, states, rates, indicators : tuple of Variable
        By kind.
    input_places, parameter_places : list of int
        Places of the inputs and parameters that are shown among those of the mechanism.
    """

    time: tuple[Variable, ...]
    inputs: tuple[Variable, ...]
    parameters: tuple[Variable, ...]
    outputs: tuple[Variable, ...]
    states: tuple[Variable, ...]
    rates: tuple[Variable, ...]
    indicators: tuple[Variable, ...]
    input_places: list[int]
    parameter_places: list[int]

    @property
    def all(self) -> tuple[Variable, ...]:
        """All of them."""
        return (
            *self.time, *self.inputs, *self.parameters, *self.outputs, *self.states, *self.rates, *self.indicators,
        )  # fmt: skip


class _Maker:
    """Makes variables, and numbers them in the order in which they are made."""

    def __init__(self, used_names: Sequence[str], units: Mapping[str, str]):
        self._used_names, self._units, self._references = used_names, units, itertools.count()

    def one(self, name: str, causality: str, **more: Any) -> Variable:
        """Make one variable."""
        return Variable(next(self._references), name, causality, **more)

    def shown(self, symbols: Sequence[Any], causality: str, values: np.ndarray, places: list[int]) -> tuple:
        """Make a variable of each input or parameter."""
        chosen = [(symbol, float(values[k])) for symbol, k in zip(symbols, places, strict=True)]
        units = self._units
        return tuple(
            self.one(x.label, causality, start=start, unit=units.get(x.label, ""), lower=x.lower, upper=x.upper)
            for x, start in chosen
        )

    def local(self, names: Sequence[str], **more: Sequence) -> tuple:
        """Make variables that are only to be looked at, under names that are free."""
        rows = zip(_free_names(names, self._used_names), *more.values(), strict=True)
        return tuple(self.one(name, "local", **dict(zip(more, row, strict=True))) for name, *row in rows)


def variables_of(
    model: Model, inputs: Sequence[Input], parameters: Sequence[Parameter], units: Mapping[str, str]
) -> Variables:
    """Return the variables of a unit.

    Parameters
    ----------
    inputs, parameters : sequence
        Inputs and parameters of the unit.
    units : mapping of str to str
        Units by name.

    Raises
    ------
    ModelError
        For a name that is invalid or used twice, and units of unknown variables.
    """
    eom, mechanism = model.eom, model.eom.mechanism
    used_names = [*(u.label for u in inputs), *(p.label for p in parameters), *model.outputs]
    _check_names(used_names)
    unknown = [name for name in units if name not in used_names]
    if unknown:
        raise ModelError(f"export_fmu: units= names {unknown[0]!r}, which is not an input, parameter or output")
    make = _Maker(used_names, units)
    input_places = [position_in(mechanism.inputs, u, "export_fmu: inputs=") for u in inputs]
    parameter_places = [position_in(mechanism.parameters, p, "export_fmu: parameters=") for p in parameters]
    velocities = ca.vertsplit(eom.v)
    of_states = [*eom.coordinate_names, *(v.name() for v in velocities), *(z.label for z in mechanism.states)]
    unit_of = _units_of_states(eom)
    known_units = dict(zip([*ca.vertsplit(eom.q), *velocities], unit_of, strict=False))
    sizes = model.numeric.scale.coordinates
    time = make.one("time (independent)" if "time" in used_names else "time", "independent", unit="s")
    shown_inputs = make.shown(inputs, "input", model.signals.level_values, input_places)
    shown_parameters = make.shown(parameters, "parameter", model.numeric.p, parameter_places)
    outputs = tuple(
        make.one(name, "output", unit=units.get(name, _unit_of(expression, known_units)))
        for name, expression in model.outputs.items()
    )
    states = make.local(of_states, unit=unit_of, nominal=[float(x) for x in (*sizes, *sizes, *[1.0] * eom.z.numel())])
    rates = make.local(
        [f"der({state.name})" for state in states],
        rate_of=[state.reference for state in states],
        unit=[f"{unit}2" if "/" in unit else f"{unit}/s" if unit else "" for unit in unit_of],
    )
    switches = [f"switch {k + 1}" for k in range(model.timed.numel() + model.compared.numel())]
    indicators = make.local([*switches, *(f"gap {k + 1}" for k in range(model.gaps.numel()))])
    return Variables(
        (time,), shown_inputs, shown_parameters, outputs, states, rates, indicators, input_places, parameter_places
    )


def _check_names(names: Sequence[str]) -> None:
    seen: set[str] = set()
    for name in names:
        if not name.strip() or re.search(r"[\x00-\x1f\x7f\ud800-\udfff]", name):
            raise ModelError(f"export_fmu: {name!r} is not a valid name of a variable; use one line of text")
        if name in seen:
            raise ModelError(
                f"export_fmu: the name '{name}' is used twice; inputs, parameters and outputs need different names"
            )
        seen.add(name)


def _free_names(names: Sequence[str], taken: Sequence[str]) -> list[str]:
    """Names of states, changed if the user took them."""
    used, free_names = set(taken), []
    for name in names:
        free, k = name, 1
        while free in used:
            free, k = f"{name} (state{'' if k == 1 else f' {k}'})", k + 1
        used.add(free)
        free_names.append(free)
    return free_names


def _units_of_states(eom: Equations) -> list[str]:
    extra = eom.q.numel() - 3 * len(eom.mechanism.bodies)
    positions = ["m", "m", "rad"] * len(eom.mechanism.bodies) + [""] * extra
    return [*positions, *(f"{unit}/s" if unit else "" for unit in positions), *[""] * eom.z.numel()]


def _unit_of(expression: ca.SX, known: Mapping[ca.SX, str]) -> str:
    return next((unit for symbol, unit in known.items() if ca.is_equal(expression, symbol)), "")
