"""A motion as named columns: what tables, files and plots are made of."""

from __future__ import annotations

from collections.abc import ItemsView, Mapping
from typing import Any

import casadi as ca
import numpy as np

from ..errors import MechanismError
from ..model.bodies import Body
from ..model.mechanism import Mechanism
from .motion import Motion

_LEVELS = ("x", "y", "phi", "vx", "vy", "omega", "ax", "ay", "alpha")


def reaction_body(element: Any) -> Body | None:
    """Body on which the reaction of a joint is reported.

    The second marker's body, or the body that moves if that is the ground.
    """
    candidates = [marker.body for marker in reversed(element.markers)] + list(reversed(element.bodies))
    return next((body for body in candidates if not body.is_ground), None)


def reaction_of(joint: Any) -> Any:
    """Reaction of a joint on :func:`reaction_body`."""
    return joint.reaction_on(reaction_body(joint))


def joints_of(mechanism: Mechanism) -> list[Any]:
    """Constraints other than drivers that have reactions on bodies."""
    return [c for c in mechanism.constraints if c not in mechanism.drivers and hasattr(c, "reaction_on")]


def effort_unit(driver: Any) -> str:
    """N m for a driver that moves angles only, else N."""
    places = ca.vertcat(*[body.position for body in driver.bodies if not body.is_ground])
    return "N" if ca.depends_on(driver.rows, places) else "N m"


def has_multipliers(motion: Motion) -> bool:
    """Return True if reactions and efforts were computed with the motion."""
    return bool(motion.lam.size) and not bool(np.all(np.isnan(motion.lam)))


def default_expressions(mechanism: Mechanism, *, loads: bool) -> dict[str, ca.SX]:
    """Coordinates and rates by body, reactions by joint and efforts by driver if `loads`, inputs and states."""
    named: dict[str, ca.SX] = {}

    def add(name: str, value: Any) -> None:
        if name in named or name == "t":
            raise MechanismError(f"two columns would be called '{name}'; give the expressions other names")
        named[name] = ca.SX(value)

    for body in mechanism.bodies:
        for level in _LEVELS:
            add(f"{body.name}.{level}", getattr(body, level))
    for coordinate in mechanism.coordinates:
        add(coordinate.label, coordinate)
        add(f"{coordinate.label}.velocity", coordinate.velocity)
        add(f"{coordinate.label}.acceleration", coordinate.acceleration)
    if loads:
        for joint in joints_of(mechanism):
            reaction = reaction_of(joint)
            add(f"{joint.name}.fx", reaction.force[0])
            add(f"{joint.name}.fy", reaction.force[1])
            add(f"{joint.name}.torque", reaction.torque)
        for driver in mechanism.drivers:
            for name, effort in zip(driver.row_names, ca.vertsplit(-driver.multipliers), strict=True):
                add(f"{name}.effort", effort)
    for symbol in (*mechanism.inputs, *mechanism.states):
        add(symbol.label, symbol)
    return named


def _items(expressions: Any) -> ItemsView[Any, Any]:
    if not isinstance(expressions, Mapping):
        raise MechanismError(f"expressions are given as {{name: expression}}, got {expressions!r}")
    return expressions.items()


def read_expressions(expressions: Any) -> dict[str, ca.SX]:
    """Check a mapping {name: expression}."""
    read: dict[str, ca.SX] = {}
    for name, expression in _items(expressions):
        if not isinstance(name, str):
            raise MechanismError(f"the name of an expression must be a text, got {name!r}")
        try:
            read[name] = ca.SX(expression)
        except (NotImplementedError, TypeError):
            raise MechanismError(f"'{name}' must be an expression, got {expression!r}") from None
    return read


def read_lines(expressions: Any) -> dict[str, tuple[list[str], ca.SX]]:
    """Check the expressions of a plot, {label: expression} or {label: {name: scalar}}: names of lines and a column."""
    lines: dict[str, tuple[list[str], ca.SX]] = {}
    for label, drawn in _items(expressions):
        if not isinstance(drawn, Mapping):
            (expression,) = read_expressions({label: drawn}).values()
            names = [name.lstrip(".") for name in component_names("", expression.shape)]
            lines[label] = names, ca.vec(expression.T)
            continue
        named = read_expressions(drawn)
        if not named or any(e.numel() != 1 for e in named.values()):
            raise MechanismError(
                f"'{label}' must be an expression, or {{name: scalar}} for lines with names, got {drawn!r}"
            )
        read_expressions({label: 0})
        lines[label] = list(named), ca.vertcat(*named.values())
    return lines


def component_names(name: str, shape: tuple[int, int]) -> list[str]:
    """Names of the entries of an expression, row by row."""
    rows, columns = shape
    if rows * columns == 1:
        return [name]
    if min(rows, columns) != 1:
        return [f"{name}[{i},{j}]" for i in range(rows) for j in range(columns)]
    count = rows * columns
    return [f"{name}.{axis}" for axis in "xy"] if count == 2 else [f"{name}[{k}]" for k in range(count)]


def columns(motion: Motion, expressions: Any = None) -> dict[str, np.ndarray]:
    """Values over time by name, each (n_t,); without expressions the columns of ``Trajectory.to_csv``.

    A vector of two gives ``name.x`` and ``name.y``, others ``name[0]`` and so on.
    """
    named = (
        default_expressions(motion.mechanism, loads=has_multipliers(motion))
        if expressions is None
        else read_expressions(expressions)
    )
    names = [part for name, expression in named.items() for part in component_names(name, expression.shape)]
    repeated = sorted({name for name in names if names.count(name) > 1}) if len(set(names)) < len(names) else []
    if repeated:
        raise MechanismError(f"two columns would be called '{repeated[0]}'; give the expressions other names")
    if not names:
        return {}
    stacked = ca.veccat(*[expression.T for expression in named.values()])  # CasADi stacks by column, names run by row
    values = motion[stacked].reshape(len(motion), len(names))
    table = dict(zip(names, values.T, strict=True))
    if expressions is None and len(motion.phases) > 1:
        table.setdefault("phase", phase_numbers(motion))
    return table


def phase_numbers(motion: Motion) -> np.ndarray:
    """Return the number of the phase of a motion by time (n_t,), from 0."""
    return np.repeat(np.arange(len(motion.phases)), [len(phase) for phase in motion.phases])
