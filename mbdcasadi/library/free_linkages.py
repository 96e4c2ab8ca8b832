"""Linkages whose points are unknowns, in the pose of the first position of a synthesis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from ..model.bodies import Body, ground
from ..model.joints.lower_pairs import Revolute
from ..model.symbols import Parameter
from .model import Model, cranked


class FreePoints:
    """Points of a linkage as parameters, where they are in the drawn pose, and bodies that carry them.

    Parameters
    ----------
    points : mapping of str to numpy.ndarray
        Drawn places (2,), m.
    """

    def __init__(self, points: Mapping[str, np.ndarray]):
        self.unknowns = {
            name + axis: Parameter(name + axis, float(value))
            for name, point in points.items()
            for axis, value in zip("xy", point, strict=True)
        }
        self._drawn = points

    def place(self, name: str) -> ca.SX:
        """The point (2,), in global axes."""
        return ca.vertcat(self.unknowns[name + "x"], self.unknowns[name + "y"])

    def bar(self, name: str, start: str, end: str, mass: float) -> FreeBar:
        """Uniform bar between two points, of a mass per length, kg/m."""
        length = ca.norm_2(self.place(end) - self.place(start))
        middle = (self._drawn[start] + self._drawn[end]) / 2
        body = Body(name, mass=mass * length, inertia=mass * length**3 / 12, pose=(*middle, 0.0))
        return FreeBar(self, body, (self.place(start) + self.place(end)) / 2)


class FreeBar:
    """A body with the axes of the ground in the drawn pose."""

    def __init__(self, points: FreePoints, body: Body, middle: ca.SX):
        self._points, self.body, self._middle = points, body, middle

    def at(self, name: str) -> Any:
        """Marker at a point."""
        return self.body.at(*ca.vertsplit(self._points.place(name) - self._middle))


def free_four_bar(points: Mapping[str, np.ndarray], masses: Sequence[float], gravity: Any) -> Model:
    """Four-bar of the pins A, B, C, D and the coupler point P; see :func:`four_bar`."""
    free = FreePoints(points)
    crank, coupler, rocker = (
        free.bar(name, ends[0], ends[1], mass)
        for name, ends, mass in zip(("crank", "coupler", "rocker"), ("AB", "BC", "DC"), masses, strict=True)
    )
    pins = {
        "A": Revolute("A", ground.at(*ca.vertsplit(free.place("A"))), crank.at("A")),
        "B": Revolute("B", crank.at("B"), coupler.at("B")),
        "C": Revolute("C", coupler.at("C"), rocker.at("C")),
        "D": Revolute("D", ground.at(*ca.vertsplit(free.place("D"))), rocker.at("D")),
    }
    coordinates = {"crank": crank.body.phi, "rocker": rocker.body.phi}
    bodies = {"crank": crank.body, "coupler": coupler.body, "rocker": rocker.body}
    parts = {**bodies, **pins, "point": coupler.at("P")}
    unknowns = free.unknowns
    return cranked(
        "four-bar", coordinates, gravity, parts, parameters=list(unknowns.values()),
        unknowns=unknowns, cognates=lambda values: _cognates(unknowns, values),
    )  # fmt: skip


def _cognates(unknowns: Mapping[str, Parameter], values: Mapping[Parameter, float]) -> list[dict[Parameter, float]]:
    """The two other four-bars whose coupler point describes the same curve (Roberts), by points in the first position.

    With the points as complex numbers, P at zero, the coupler is the triangle B, C, P, and the third pivot makes a
    similar one with A and D: ``E = A + k (D - A)`` with ``k = B / (B - C)``.

    References
    ----------
    Roberts, "On three-bar motion in plane space", Proceedings of the London Mathematical Society 7 (1875) 14.
    """
    given = {name: values.get(p, p.value) for name, p in unknowns.items()}
    a, d, b, c, p = (complex(given[name + "x"], given[name + "y"]) for name in "ADBCP")
    a, d, b, c = (point - p for point in (a, d, b, c))
    if b == c:
        return []
    k = b / (b - c)
    third = a + k * (d - a)
    found = []
    for linkage in ((a, third, a - b, (k - 1) * (b - a)), (d, third, d - c, k * (d - c))):
        places = {name: point + p for name, point in zip("ADBC", linkage, strict=True)} | {"P": p}
        found.append(
            {unknowns[n + axis]: part for n, z in places.items() for axis, part in (("x", z.real), ("y", z.imag))}
        )
    return found
