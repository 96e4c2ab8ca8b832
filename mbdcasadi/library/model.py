"""Base class and tools of the ready mechanisms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from ..errors import ModelError
from ..model.bodies import Body
from ..model.drivers import Driver
from ..model.element import ConstraintElement, Element
from ..model.forces.applied import Torque
from ..model.forces.field import Gravity
from ..model.geometry.shapes import Rod
from ..model.immutable import HoldsSymbols, Immutable
from ..model.mechanism import Mechanism
from ..model.symbols import Input, number, positive


class Model(Immutable, HoldsSymbols):
    """A mechanism with names for its parts.

    Attributes
    ----------
    mechanism : Mechanism
        Mechanism for the analyses; without drivers, its inputs at zero.
    coordinates : dict of str to casadi.SX
        Natural coordinates, as many as there are degrees of freedom or more.

    Bodies, joints, inputs and points are attributes by their names.
    """

    mechanism: Mechanism
    coordinates: dict[str, ca.SX]

    def __init__(self, mechanism: Mechanism, coordinates: Mapping[str, Any], **parts: Any):
        self.mechanism = mechanism
        self.coordinates = dict(coordinates)
        self._names = tuple(parts)
        for name, part in parts.items():
            setattr(self, name, part)

    def __getattr__(self, name: str) -> Any:
        # reached only if there is no such part
        known = ", ".join(self.__dict__.get("_names", ()))
        raise AttributeError(f"this model has no part '{name}'; it has mechanism, coordinates, {known}")

    def driven(self, **courses: Any) -> Mechanism:
        """Return the mechanism with drivers on natural coordinates.

        Parameters
        ----------
        **courses : float or expression in time
            By the name of a coordinate: ``driven(crank=20 * mbd.t)``.
        """
        unknown = set(courses) - set(self.coordinates)
        if unknown:
            raise ModelError(
                f"driven: there is no coordinate {', '.join(sorted(unknown))}; there are {', '.join(self.coordinates)}"
            )
        drivers = [Driver(f"{name} drive", self.coordinates[name], value) for name, value in courses.items()]
        return self.mechanism.replace(drivers=[*self.mechanism.drivers, *drivers])

    def __repr__(self) -> str:
        return (
            f"Model of {self.mechanism!r}\n  coordinates {', '.join(self.coordinates)}; parts {', '.join(self._names)}"
        )


def cranked(
    name: str,
    coordinates: Mapping[str, Any],
    gravity: Any,
    parts: Mapping[str, Any],
    joints: Sequence[Any] = (),
    parameters: Sequence[Any] = (),
    motors: Mapping[str, Body] | None = None,
    **more: Any,
) -> Model:
    """Return the mechanism of the bodies, joints and forces among its parts, with torques as inputs.

    The torques `motors` act on the bodies given, ``tau`` on the first body without; `joints` and `parameters` are there
    besides, without names of their own; `more` are further attributes of the model.
    """
    elements = [part for part in parts.values() if isinstance(part, Element)]
    rows = [*(part for part in elements if isinstance(part, ConstraintElement)), *joints]
    bodies = [part for part in parts.values() if isinstance(part, Body)]
    forces = [part for part in elements if not isinstance(part, ConstraintElement)]
    motors = motors or {"tau": bodies[0]}
    inputs = {key: Input(key.replace("_", " "), unit="N m") for key in motors}
    labels = ["motor"] if len(motors) == 1 else [f"{body.name} motor" for body in motors.values()]
    torques = [Torque(label, motors[key], inputs[key]) for label, key in zip(labels, motors, strict=True)]
    mechanism = Mechanism(
        bodies, rows, forces=[*weight(gravity), *torques, *forces], inputs=list(inputs.values()), parameters=parameters,
        name=name,
    )  # fmt: skip
    return Model(mechanism, coordinates, **parts, **inputs, **more)


def weight(gravity: Any) -> list[Gravity]:
    """Gravity as a list of forces, empty for None."""
    return [] if gravity is None else [Gravity(gravity)]


def lengths(what: str, **values: Any) -> list[float]:
    """Positive lengths as floats."""
    return [positive(value, what, name) for name, value in values.items()]


def pair_of_numbers(value: Any, what: str, name: str) -> tuple[float, float]:
    """Two finite numbers."""
    if not isinstance(value, Sequence | np.ndarray) or isinstance(value, str) or len(value) != 2:
        raise ModelError(f"{what}: {name} must be two numbers, got {value!r}")
    first, second = (number(entry, what, name) for entry in value)
    return first, second


def at_angle(length: float, angle: float) -> np.ndarray:
    """Vector of a length at an angle."""
    return length * np.array([np.cos(angle), np.sin(angle)])


def meeting_point(first: Any, radius: float, second: Any, other: float, left: bool, what: str) -> np.ndarray:
    """Return the point where two bars from two points meet, left or right of the line between the points."""
    first, second = np.asarray(first, float), np.asarray(second, float)
    apart = float(np.hypot(*(second - first)))
    if not abs(radius - other) < apart < radius + other:
        raise ModelError(
            f"{what}: bars of {radius:g} m and {other:g} m do not meet between points {apart:.4g} m apart; "
            "change a length or the angle of the crank"
        )
    along = (second - first) / apart
    share = (radius**2 - other**2 + apart**2) / (2 * apart)
    across = np.sqrt(radius**2 - share**2) * (1 if left else -1)
    return first + share * along + across * np.array([-along[1], along[0]])


def bar(name: str, start: Any, end: Any, mass: float) -> Body:
    """Uniform slender bar between two points; its x axis runs from the first to the second."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    length = float(np.hypot(*(end - start)))
    pose = (*((start + end) / 2), float(np.arctan2(*(end - start)[::-1])))
    return Body(name, mass=mass, inertia=mass * length**2 / 12, pose=pose, shape=Rod(length))


def ends(body: Body) -> tuple[Any, Any]:
    """Markers at both ends of a bar."""
    half = body.shape.length / 2  # type: ignore[union-attr]
    return body.at(-half, 0), body.at(half, 0)


def one_for_each(values: Any, count: int, what: str, name: str, single: str) -> list[float]:
    """One number for each of some parts; a single number serves all."""
    several = not isinstance(values, str) and (isinstance(values, Sequence) or getattr(values, "ndim", 0) > 0)
    listed = list(values) if several else [values] * count
    if len(listed) != count:
        raise ModelError(f"{what}: {name} takes one number or {count}, got {len(listed)}")
    return [number(value, what, single) for value in listed]


def masses_of(masses: Any, count: int, what: str) -> list[float]:
    """One mass for each of some bodies, none of them negative."""
    found = one_for_each(masses, count, what, "masses", "mass")
    if min(found, default=0.0) < 0:
        raise ModelError(f"{what}: masses must not be negative, got {masses!r}")
    return found
