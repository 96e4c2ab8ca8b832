"""Linkages whose points are unknowns, in the pose of the first position of a synthesis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from ..errors import ModelError
from ..model.bodies import Body, Marker, ground
from ..model.forces.field import GRAVITY
from ..model.joints.lower_pairs import Revolute, Translational
from ..model.symbols import Parameter, number, values_of
from .model import Model, cranked, masses_of, pair_of_numbers


def free_linkage(
    points: Mapping[str, Any],
    bodies: Mapping[str, Sequence[str]],
    masses: Any = 1.0,
    gravity: Any = GRAVITY,
    name: str = "linkage",
    guides: Mapping[str, float] | None = None,
    motors: Mapping[str, str] | None = None,
) -> Model:
    """Return a linkage of pins and sliders whose points are unknowns for :func:`synthesize`, driven by torques.

    The drawn pose is that of the first position: bodies have the axes of the ground there, and joints meet whatever
    the points are. Two bodies that have a point in common are pinned there; of more, each to the first of them.

    Parameters
    ----------
    points : mapping of str to (float, float)
        Names and drawn places of the points, m; no name is that of a body.
    bodies : mapping of str to sequence of str
        Points of each body and of the ``"ground"``; a text is a sequence of names of one letter. A point of one body
        alone is carried by it.
    masses : float or one for each moving body, default 1
        Of a metre of bar, kg/m. A body with two pins is a bar, one with more the closed chain of bars between them; a
        slider with one pin has its mass there, kg.
    gravity : (float, float) or None
        m/s².
    name : str, default "linkage"
        Name of the mechanism.
    guides : mapping of str to float, optional
        Sliders, which are bodies, with the drawn angles of their guides on the ground, through their first pins, rad;
        these angles are unknowns too.
    motors : mapping of str to str, optional
        Names of inputs, which are torques, with the bodies on which they act; ``tau`` on the first body by default.

    Returns
    -------
    Model
        Bodies by their names, pins by those of their points, markers by those of the points that one body has, and
        guides by those of their sliders, ``slider_guide``; ``unknowns``, a dictionary of the parameters ``Ax, Ay, …``
        and ``slider_angle``; inputs by the names of `motors`; coordinates are the angles of the bodies that are pinned
        to the ground, and the displacements of sliders.

    Raises
    ------
    ModelError
        For points that are not given or belong to no body, bodies that are not there, and a linkage that is not pinned
        to the ground.

    Examples
    --------
    >>> places = {"A": (0, 0), "D": (1, 0), "B": (0.1, 0.3), "C": (0.9, 0.7), "P": (0.5, 0.9)}
    >>> free_linkage(places, {"ground": "AD", "crank": "AB", "coupler": "BCP", "rocker": "DC"}).unknowns["Bx"].value
    0.1
    """
    what = "free_linkage"
    given = {"points": points, "bodies": bodies, "guides=": guides or {}, "motors=": motors or {}}
    for where, mapping in given.items():
        if not isinstance(mapping, Mapping):
            raise ModelError(f"{what}: {where} takes a dictionary, got {mapping!r}")
    drawn = {key: np.array(pair_of_numbers(place, what, f"point {key}")) for key, place in points.items()}
    of_point = _owners(drawn, bodies, what)
    moving = [body for body in bodies if body != "ground"]
    angles = dict[str, Parameter]()
    for body, angle in (guides or {}).items():
        _among(body, moving, what, "guides=")
        angles[body] = Parameter(f"{body}_angle", number(angle, what, f"angle of the guide of {body}"))
    unknowns = {
        key + axis: Parameter(key + axis, float(value))
        for key, place in drawn.items()
        for axis, value in zip("xy", place, strict=True)
    } | {f"{body}_angle": angle for body, angle in angles.items()}
    place = {key: ca.vertcat(unknowns[key + "x"], unknowns[key + "y"]) for key in drawn}
    made: dict[str, tuple[Body, ca.SX]] = {"ground": (ground, ca.SX.zeros(2))}
    for body, mass in zip(moving, masses_of(masses, len(moving), what), strict=True):
        pinned = _pinned(bodies[body], of_point)
        made[body] = _body(body, [place[key] for key in pinned], mass, slides=body in angles)
    pins, carried = _joined(made, place, of_point)
    guided = {
        body: _guide(body, *made[body], place[_pinned(bodies[body], of_point)[0]], angle)
        for body, angle in angles.items()
    }
    turning = {body: made[body][0].phi for owners in of_point.values() if "ground" in owners for body in owners}
    turning.pop("ground", None)
    turning |= {body: guide.displacement for body, guide in guided.items()}
    if not turning:
        raise ModelError(f"{what}: no body is pinned to the ground; give it points, as in {{'ground': 'AD', …}}")
    sliding = {f"{body}_guide": guide for body, guide in guided.items()}
    parts = {**{body: made[body][0] for body in moving}, **pins, **sliding, **carried}
    for body in (motors or {}).values():
        _among(body, moving, what, "motors=")
    driven = {key: made[body][0] for key, body in (motors or {}).items()}
    return cranked(name, turning, gravity, parts, parameters=list(unknowns.values()), motors=driven, unknowns=unknowns)


def _owners(points: Mapping[str, np.ndarray], bodies: Mapping[str, Sequence[str]], what: str) -> dict[str, list[str]]:
    """Bodies that have each point."""
    owners: dict[str, list[str]] = {key: [] for key in points}
    for body, names in bodies.items():
        if not isinstance(names, Sequence):
            raise ModelError(f"{what}: {body} takes a sequence of names of points, got {names!r}")
        for key in names:
            if list(names).count(key) > 1:
                raise ModelError(f"{what}: {body} has the point {key!r} twice")
            if key not in points:
                raise ModelError(f"{what}: {body} has the point {key!r}, which is not among points")
            owners[key].append(body)
    for key, of in owners.items():
        if not of or key in bodies:
            raise ModelError(f"{what}: point {key!r} {'has the name of a body' if of else 'belongs to no body'}")
    return owners


def _among(body: str, moving: Sequence[str], what: str, where: str) -> None:
    if body not in moving:
        raise ModelError(f"{what}: {where} has {body!r}, which is not among the moving bodies")


def _joined(
    made: Mapping[str, tuple[Body, ca.SX]], place: Mapping[str, ca.SX], of_point: Mapping[str, Sequence[str]]
) -> tuple[dict[str, Revolute], dict[str, Marker]]:
    """Pins at the points that several bodies have, and markers at those of one alone."""

    def at(body: str, key: str) -> Marker:
        return made[body][0].at(*ca.vertsplit(place[key] - made[body][1]))

    pins, carried = dict[str, Revolute](), dict[str, Marker]()
    for key, (first, *others) in of_point.items():
        if not others:
            carried[key] = at(first, key)
        for k, other in enumerate(others):
            label = key if not k else f"{key}{k + 1}"
            pins[label] = Revolute(label, at(first, key), at(other, key))
    return pins, carried


def _guide(name: str, body: Body, center: ca.SX, pin: ca.SX, angle: Parameter) -> Translational:
    """Guide of a slider on the ground through one of its pins."""
    (x, y), (along, across) = ca.vertsplit(pin), ca.vertsplit(pin - center)
    return Translational(f"{name}_guide", ground.at(x, y, angle), body.at(along, across, angle))


def _pinned(points: Sequence[str], of_point: Mapping[str, Sequence[str]]) -> list[str]:
    """Points of a body that others have too; all of them if there are none."""
    return [key for key in points if len(of_point[key]) > 1] or list(points)


def _body(name: str, pins: Sequence[ca.SX], mass: float, *, slides: bool = False) -> tuple[Body, ca.SX]:
    """A body of uniform bars between its pins, and its centre of mass in the drawn pose."""
    edges = [*pairwise(pins), *([(pins[-1], pins[0])] if len(pins) > 2 else [])]
    if not edges:
        return Body(name, mass=mass if slides else 0.0, inertia=0.0, pose=(*values_of(pins[0]).ravel(), 0.0)), pins[0]
    lengths, middles = [ca.norm_2(b - a) for a, b in edges], [(a + b) / 2 for a, b in edges]
    total = sum(lengths[1:], lengths[0])
    center = sum((x * m for x, m in zip(lengths[1:], middles[1:], strict=True)), lengths[0] * middles[0]) / total
    inertia = ca.SX(0)
    for length, middle in zip(lengths, middles, strict=True):
        inertia += length**3 / 12 + length * ca.sumsqr(middle - center)
    if len(edges) == 1:  # as they are, without a division by the length
        center, inertia = middles[0], lengths[0] ** 3 / 12
    return Body(name, mass=mass * total, inertia=mass * inertia, pose=(*values_of(center).ravel(), 0.0)), center


def _renamed(model: Model, own: Sequence[str], others: Mapping[str, Any]) -> Model:
    """A model with some parts under their own names, and others."""
    return Model(model.mechanism, model.coordinates, **{name: getattr(model, name) for name in own}, **others)


def free_slider_crank(points: Mapping[str, np.ndarray], masses: Sequence[float], gravity: Any) -> Model:
    """Slider-crank of the pins A, B, C on a guide through C; see :func:`slider_crank`."""
    bodies = {"ground": "A", "crank": "AB", "rod": "BC", "slider": "C"}
    model = free_linkage(points, bodies, masses, gravity, "slider-crank", guides={"slider": 0.0})
    joints = {"main": model.A, "pin": model.B, "wrist": model.C, "guide": model.slider_guide}
    return _renamed(model, ("crank", "rod", "slider", "tau", "unknowns"), joints)


def free_five_bar(points: Mapping[str, np.ndarray], masses: Sequence[float], gravity: Any) -> Model:
    """Five-bar of the pins A, B, C, D and the tip P; see :func:`five_bar`."""
    bodies = {"ground": "AD", "left": "AB", "left_link": "BP", "right": "DC", "right_link": "CP"}
    motors = {"tau_left": "left", "tau_right": "right"}
    model = free_linkage(points, bodies, masses, gravity, "five-bar", motors=motors)
    own = ("left", "left_link", "right", "right_link", *"ABCD", *motors, "unknowns")
    return _renamed(model, own, {"tip_pin": model.P, "tip": model.P.a})


def free_four_bar(points: Mapping[str, np.ndarray], masses: Sequence[float], gravity: Any) -> Model:
    """Four-bar of the pins A, B, C, D and the coupler point P, with the map of its cognates; see :func:`four_bar`."""
    bodies = {"ground": "AD", "crank": "AB", "coupler": "BCP", "rocker": "DC"}
    model = free_linkage(points, bodies, masses, gravity, "four-bar")
    unknowns = model.unknowns
    others = {"point": model.P, "cognates": lambda values: _cognates(unknowns, values)}
    return _renamed(model, ("crank", "coupler", "rocker", *"ABCD", "tau", "unknowns"), others)


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
