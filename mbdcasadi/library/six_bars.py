"""Watt's and Stephenson's six-bars, whose points are unknowns for a synthesis."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..model.forces.field import GRAVITY
from ..model.quantities import one_of, whole
from .free_linkages import free_linkage
from .model import Model

#: Points of the bodies of each kind. Watt's two bodies of three pins are joined with each other, Stephenson's are not.
WATT = {
    1: {"ground": "AD", "crank": "AB", "coupler": "BCE", "rocker": "DCG", "link": "EF", "output": "GF"},
    2: {"ground": "ADG", "crank": "AB", "coupler": "BC", "rocker": "DCE", "link": "EF", "output": "GF"},
}
STEPHENSON = {
    1: {"ground": "AD", "crank": "ABE", "coupler": "BC", "rocker": "DCG", "link": "EF", "output": "GF"},
    2: {"ground": "AD", "crank": "AB", "coupler": "BEF", "rocker": "DCG", "link": "EC", "output": "FG"},
    3: {"ground": "ADG", "crank": "AB", "coupler": "BCE", "rocker": "DC", "link": "EF", "output": "GF"},
}
#: Drawn places of the points, m, by name and kind, with cranks that turn fully.
FOUR_BAR = {"A": (0.0, 0.0), "D": (1.1, 0.0), "B": (0.1, 0.35), "C": (1.2, 0.95), "P": (0.9, 1.7)}
DRAWN = {
    ("watt", 1): FOUR_BAR | {"E": (0.6, 1.2), "F": (1.5, 2.0), "G": (1.9, 0.9)},
    ("watt", 2): FOUR_BAR | {"E": (1.6, 0.8), "F": (2.3, 1.3), "G": (2.4, 0.2)},
    ("stephenson", 1): FOUR_BAR | {"E": (-0.2, 0.4), "F": (0.9, 1.9), "G": (1.7, 0.9)},
    ("stephenson", 2): FOUR_BAR
    | {"B": (0.1, 0.25), "C": (1.3, 0.7), "E": (0.7, 1.2), "F": (0.0, 0.8), "G": (1.4, 0.9)},
    ("stephenson", 3): FOUR_BAR | {"E": (0.6, 1.1), "F": (1.4, 1.6), "G": (1.9, 0.4)},
}


def watt(
    kind: int = 2,
    points: Mapping[str, tuple[float, float]] | None = None,
    point_on: str = "link",
    masses: Any = 1.0,
    gravity: Any = GRAVITY,
) -> Model:
    """Return Watt's six-bar with its points as unknowns for :func:`synthesize`, with a torque on the crank.

    Two of its bodies have three pins and are joined with each other. The drawn pose is that of the first position.

    Parameters
    ----------
    kind : int, default 2
        1 if the ground has two pins, `A` and `D`: a four-bar whose coupler `BCE` and rocker `DCG` carry the two further
        bars `EF` and `GF`. 2 if it has three, `A`, `D` and `G`: two four-bars in a row, whose rocker `DCE` is common.
    points : mapping of str to (float, float), optional
        Drawn places of points in place of those given here, m.
    point_on : str, default "link"
        The body that carries the point `P`.
    masses : float or five of them, default 1
        Of a metre of bar of ``crank, coupler, rocker, link, output``, kg/m, as of :func:`library.free_linkage`.
    gravity : (float, float) or None
        m/s².

    Returns
    -------
    Model
        Bodies ``crank, coupler, rocker, link, output``; pins ``A … G``; marker ``point``; input ``tau``; ``unknowns``,
        a dictionary of the parameters ``Ax … Py`` by their names; coordinates, the angles of the bodies on the ground.

    Examples
    --------
    >>> watt(points={"G": (2.2, 0.1)}).unknowns["Gx"].value
    2.2
    """
    return _six_bar("watt", WATT, kind, points, point_on, masses, gravity)


def stephenson(
    kind: int = 3,
    points: Mapping[str, tuple[float, float]] | None = None,
    point_on: str = "link",
    masses: Any = 1.0,
    gravity: Any = GRAVITY,
) -> Model:
    """Return Stephenson's six-bar with its points as unknowns for :func:`synthesize`, with a torque on the crank.

    Two of its bodies have three pins and are not joined with each other. The drawn pose is that of the first position.

    Parameters
    ----------
    kind : int, default 3
        1 if the ground joins the two bodies of three pins, crank `ABE` and rocker `DCG`; 2 if it is one of the two bars
        in a row between them, coupler `BEF` and rocker `DCG`, which `EC` and `FG` join; 3 if it has three pins, `A`,
        `D` and `G`: a four-bar whose coupler `BCE` moves the bars `EF` and `GF`.
    points : mapping of str to (float, float), optional
        Drawn places of points in place of those given here, m.
    point_on : str, default "link"
        The body that carries the point `P`.
    masses : float or five of them, default 1
        Of a metre of bar of ``crank, coupler, rocker, link, output``, kg/m, as of :func:`library.free_linkage`.
    gravity : (float, float) or None
        m/s².

    Returns
    -------
    Model
        Bodies ``crank, coupler, rocker, link, output``; pins ``A … G``; marker ``point``; input ``tau``; ``unknowns``,
        a dictionary of the parameters ``Ax … Py`` by their names; coordinates, the angles of the bodies on the ground.

    Examples
    --------
    >>> sorted(stephenson().coordinates)
    ['crank', 'output', 'rocker']
    """
    return _six_bar("stephenson", STEPHENSON, kind, points, point_on, masses, gravity)


def _six_bar(
    what: str,
    kinds: Mapping[int, Mapping[str, str]],
    kind: int,
    points: Mapping[str, tuple[float, float]] | None,
    point_on: str,
    masses: Any,
    gravity: Any,
) -> Model:
    """A six-bar of a kind, with the point on a body."""
    kind = whole(kind, what, "kind", 1, len(kinds))
    bodies = dict(kinds[kind])
    one_of(point_on, [body for body in bodies if body != "ground"], what, "point_on")
    bodies[point_on] += "P"
    places = DRAWN[what, kind] | dict(points or {})
    model = free_linkage(places, bodies, masses, gravity, f"{what.capitalize()}'s six-bar")
    parts = {name: getattr(model, name) for name in (*(b for b in bodies if b != "ground"), *"ABCDEFG", "tau")}
    return Model(model.mechanism, model.coordinates, **parts, point=model.P, unknowns=model.unknowns)
