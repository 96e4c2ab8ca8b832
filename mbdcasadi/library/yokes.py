"""Mechanisms with a slot: quick-return and Scotch yoke."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..errors import ModelError
from ..model.bodies import Body, ground
from ..model.forces.field import GRAVITY
from ..model.geometry.shapes import Rectangle
from ..model.joints.lower_pairs import PointOnLine, Revolute, Translational
from ..model.symbols import number
from .model import Model, at_angle, bar, cranked, ends, lengths, masses_of


def quick_return(
    crank: float = 0.1,
    distance: float = 0.25,
    arm: float = 0.5,
    angle: float = 0.3,
    masses: Any = 1.0,
    gravity: Any = GRAVITY,
) -> Model:
    """Return a crank that rocks a slotted arm, slowly forth and quickly back, with a torque on the crank.

    Parameters
    ----------
    crank, arm : float
        Lengths, m.
    distance : float
        Of the arm's pivot below the crank's bearing at the origin, m; longer than the crank.
    angle : float, default 0.3
        Crank angle of the estimated pose, rad.
    masses : float or two of them, default 1
        Of crank and arm, kg; the die block has none.
    gravity : (float, float) or None
        m/s².

    Returns
    -------
    Model
        Bodies ``crank, arm``; joints ``main, pivot, slot``; input ``tau``; coordinates
        ``crank``, ``arm`` (angles) and ``block`` (position of the die block along the arm).
    """
    what = "quick_return"
    r, below, long = lengths(what, crank=crank, distance=distance, arm=arm)
    if r >= below or long < below + r:
        raise ModelError(
            f"{what}: the distance {below:g} m must be longer than the crank, {r:g} m, and the arm, {long:g} m, must "
            f"reach {below + r:g} m"
        )
    tip = at_angle(r, number(angle, what, "angle"))
    pivot = np.array([0.0, -below])
    along = (tip - pivot) / np.hypot(*(tip - pivot))
    m = masses_of(masses, 2, what)
    first, second = bar("crank", (0, 0), tip, m[0]), bar("arm", pivot, pivot + long * along, m[1])
    main = Revolute("main bearing", ground.at(0, 0), ends(first)[0])
    hinge = Revolute("arm pivot", ground.at(*pivot), ends(second)[0])
    slot = PointOnLine("slot", ends(second)[0], ends(first)[1])
    coordinates = {"crank": main.angle, "arm": hinge.angle, "block": slot.displacement}
    parts = {"crank": first, "arm": second, "main": main, "pivot": hinge, "slot": slot}
    return cranked("quick-return", coordinates, gravity, parts)


def scotch_yoke(crank: float = 0.12, angle: float = 1.0, masses: Any = (1.0, 2.5), gravity: Any = GRAVITY) -> Model:
    """Return a Scotch yoke, a crank pin in the upright slot of a slide, with a torque on the crank.

    ``x = r cos(theta)``.

    Parameters
    ----------
    crank : float
        Radius r of the pin, m.
    angle : float, default 1
        Crank angle of the estimated pose, rad.
    masses : float or two of them
        Of crank and yoke, kg.
    gravity : (float, float) or None
        m/s².

    Returns
    -------
    Model
        Bodies ``crank, yoke``; joints ``main, guide, slot``; input ``tau``; coordinates
        ``crank`` (angle) and ``yoke`` (displacement).
    """
    what = "scotch_yoke"
    (r,) = lengths(what, crank=crank)
    tip = at_angle(r, number(angle, what, "angle"))
    m = masses_of(masses, 2, what)
    first = bar("crank", (0, 0), tip, m[0])
    size = 0.2 * r, 2.4 * r
    # the rod that slides in guides on both sides is there to be seen; mass and inertia are those of the slotted bar
    shape = Rectangle(5.6 * r, 0.12 * r) + Rectangle(0.36 * r, 2.4 * r)
    yoke = Body("yoke", m[1], m[1] * (size[0] ** 2 + size[1] ** 2) / 12, pose=(tip[0], 0, 0), shape=shape)
    main = Revolute("main bearing", ground.at(0, 0), ends(first)[0])
    guide = Translational("guide", ground.at(0, 0), yoke.at(0, 0))
    slot = PointOnLine("slot", yoke.at(0, 0, angle=np.pi / 2), ends(first)[1])
    coordinates = {"crank": main.angle, "yoke": guide.displacement}
    parts = {"crank": first, "yoke": yoke, "main": main, "guide": guide, "slot": slot}
    return cranked("Scotch yoke", coordinates, gravity, parts)
