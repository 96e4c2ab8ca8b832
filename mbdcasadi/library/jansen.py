"""Jansen's walking linkage."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..model.bodies import ground
from ..model.forces.field import GRAVITY
from ..model.joints.lower_pairs import Revolute
from ..model.symbols import number
from .model import Model, at_angle, bar, cranked, ends, lengths, meeting_point

#: Jansen's lengths of the bars, in units of which the crank has 15; ``a`` and ``l`` place the fixed pivot.
LENGTHS = {
    "a": 38.0, "b": 41.5, "c": 39.3, "d": 40.1, "e": 55.8, "f": 39.4, "g": 36.7, "h": 65.7, "i": 49.0, "j": 50.0,
    "k": 61.9, "l": 7.8, "m": 15.0,
}  # fmt: skip
#: Ends of the eleven bars: points by name.
BARS = {
    "m": ("crank axis", "crank tip"),
    "j": ("crank tip", "top"),
    "b": ("pivot", "top"),
    "e": ("top", "left"),
    "d": ("pivot", "left"),
    "k": ("crank tip", "knee"),
    "c": ("pivot", "knee"),
    "f": ("left", "ankle"),
    "g": ("knee", "ankle"),
    "h": ("ankle", "foot"),
    "i": ("knee", "foot"),
}


def _points(x: dict[str, float], angle: float) -> dict[str, np.ndarray]:
    """Points of the leg at a crank angle."""
    what = "jansen"
    p = {"crank axis": np.zeros(2), "pivot": np.array([-x["a"], -x["l"]]), "crank tip": at_angle(x["m"], angle)}
    p["top"] = meeting_point(p["crank tip"], x["j"], p["pivot"], x["b"], False, what)
    p["left"] = meeting_point(p["top"], x["e"], p["pivot"], x["d"], False, what)
    p["knee"] = meeting_point(p["crank tip"], x["k"], p["pivot"], x["c"], True, what)
    p["ankle"] = meeting_point(p["left"], x["f"], p["knee"], x["g"], False, what)
    p["foot"] = meeting_point(p["ankle"], x["h"], p["knee"], x["i"], False, what)
    return p


def jansen(scale: float = 0.01, density: float = 1.0, angle: float = 0.0, gravity: Any = GRAVITY) -> Model:
    """Return one leg of Theo Jansen's walking linkage: eleven pinned bars, driven by a crank.

    Parameters
    ----------
    scale : float, default 0.01
        Metres for one unit of Jansen's numbers (crank 15, pivot 38 to the side and 7.8 below).
    density : float, default 1
        Mass of the bars by length, kg/m.
    angle : float, default 0
        Crank angle of the estimated pose, rad.
    gravity : (float, float) or None
        m/s².

    Returns
    -------
    Model
        Bodies ``b … k`` and ``m``, the crank, by Jansen's letters; ``main``, the crank's bearing;
        input ``tau``; marker ``foot``; coordinate ``crank``.

    References
    ----------
    Jansen, *The Great Pretender*, 2007.
    """
    size, heft = lengths("jansen", scale=scale, density=density)
    x = {name: size * value for name, value in LENGTHS.items()}
    points = _points(x, number(angle, "jansen", "angle"))
    bars = {name: bar(name, points[p], points[q], heft * x[name]) for name, (p, q) in BARS.items()}
    meeting: dict[str, list[Any]] = {}
    for name, places in BARS.items():
        for place, marker in zip(places, ends(bars[name]), strict=True):
            meeting.setdefault(place, []).append((name, marker))
    joints = []
    for place, markers in meeting.items():
        fixed = place in ("crank axis", "pivot")
        first = ground.at(*points[place]) if fixed else markers[0][1]
        for name, marker in markers if fixed else markers[1:]:
            joints.append(Revolute(f"{place} {name}", first, marker))
    main = joints[0]
    parts = {**bars, "main": main, "foot": ends(bars["h"])[1]}
    return cranked("Jansen linkage", {"crank": main.angle}, gravity, parts, joints[1:])
