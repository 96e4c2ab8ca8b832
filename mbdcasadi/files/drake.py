"""Springs, rods and pins between points, which Drake adds to URDF and SDF."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..model.joints.constraints import Constraint
from .markup import XmlElement
from .robots import Link, Loop, Robot, Strand, Tendon

#: Elements that connect points of two links.
CONNECTIONS = ("drake:linear_spring_damper", "drake:distance_constraint", "drake:ball_constraint")


def connect_points(robot: Robot, element: XmlElement, link: Callable[[str], Link]) -> None:
    """Add what an element puts between two points; links are found by their names.

    A ``linear_spring_damper``, and a ``distance_constraint`` with a stiffness that is finite, are springs; a rigid
    distance is held, and a ``ball_constraint`` closes a loop.
    """
    number = sum(part.source.tag == element.tag for part in (*robot.tendons, *robot.loops)) + 1
    kind = element.tag.removeprefix("drake:")
    name = f"{kind.replace('_', ' ')} {number}"
    (a, start), (b, end) = (_point(element, link, *keys) for keys in (("body_A", "p_AP"), ("body_B", "p_BQ")))
    if kind == "ball_constraint":
        robot.loops.append(Loop(element, name, a, b, start, end=end))
        robot.apart.add(frozenset((a.name, b.name)))
        return
    length = _number(element, "free_length" if kind == "linear_spring_damper" else "distance")
    stiffness, damping = _number(element, "stiffness"), _number(element, "damping")
    is_rigid = np.isinf(stiffness)
    tendon = Tendon(
        element, name, [], [Strand((a, start), (b, end))],
        0.0 if is_rigid else damping, 0.0 if is_rigid else stiffness, (length, length),
    )  # fmt: skip
    robot.tendons.append(tendon)
    if is_rigid:
        robot.constraints.append(((tendon.key,), lambda along: Constraint(name, along[0].value - length)))


def _value(element: XmlElement, name: str) -> str:
    """A value, which SDF gives as text and URDF as an attribute of an element inside."""
    key = f"{element.tag}_{name}"
    inner = element.one(key)
    if inner is None:
        return element.get(key).strip()
    return inner.get("name" if name.startswith("body") else "value", inner.text).strip()


def _number(element: XmlElement, name: str) -> float:
    text = _value(element, name)
    if text.lower() in ("inf", "+inf"):
        return float(np.inf)
    return element.with_defaults({name: text}).number(name, least=0.0)


def _point(element: XmlElement, link: Callable[[str], Link], body: str, place: str) -> tuple[Link, np.ndarray]:
    """A link, and a point of it in the world."""
    there = link(_value(element, body))
    point = element.with_defaults({place: _value(element, place)}).numbers(place, None, (3,))
    return there, there.position + there.rotation @ point
