"""Four-bar, five-bar and slider-crank."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..errors import ModelError
from ..model.bodies import Body, ground
from ..model.forces.field import GRAVITY
from ..model.geometry.shapes import Rectangle
from ..model.joints.lower_pairs import Revolute, Translational
from ..model.quantities import yes_or_no
from ..model.symbols import number
from .free_linkages import free_five_bar, free_four_bar, free_slider_crank
from .model import (
    Model,
    at_angle,
    bar,
    cranked,
    ends,
    lengths,
    masses_of,
    meeting_point,
    pair_of_numbers,
)


def four_bar(
    crank: float = 0.2,
    coupler: float = 0.5,
    rocker: float = 0.4,
    base: float = 0.55,
    angle: float = 0.5,
    open: bool = True,
    point: tuple[float, float] = (0.0, 0.0),
    masses: Any = 1.0,
    gravity: Any = GRAVITY,
    free: bool = False,
) -> Model:
    """Return a four-bar linkage of uniform bars, with a torque on the crank.

    Parameters
    ----------
    crank, coupler, rocker, base : float
        Lengths of AB, BC, DC and AD, m; A at the origin, D at (base, 0).
    angle : float, default 0.5
        Crank angle of the estimated pose, rad.
    open : bool, default True
        True if C lies to the left of the line from B to D.
    point : (float, float), default (0, 0)
        Coupler point in the coupler's frame, from its middle, m.
    masses : float or three of them, default 1
        kg.
    gravity : (float, float) or None
        m/s².
    free : bool, default False
        True if the points A, D, B, C and the coupler point P are unknowns for :func:`synthesize`: the drawn pose is
        that of its first position, all angles are zero there, and `masses` are those of a metre of each bar, kg/m.

    Returns
    -------
    Model
        Bodies ``crank, coupler, rocker``; pins ``A, B, C, D``; input ``tau``; marker
        ``point``; coordinates ``crank`` and ``rocker``, the angles against the ground. A free one has ``unknowns``, a
        dictionary of the parameters ``Ax … Py`` by their names, and ``cognates``, the map for ``symmetries=``.
    """
    what = "four_bar"
    yes_or_no(free, what, "free")
    ab, bc, dc, ad = lengths(what, crank=crank, coupler=coupler, rocker=rocker, base=base)
    b, d = at_angle(ab, number(angle, what, "angle")), np.array([ad, 0.0])
    c = meeting_point(b, bc, d, dc, yes_or_no(open, what, "open"), what)
    m = masses_of(masses, 3, what)
    if free:
        middle, along = (b + c) / 2, (c - b) / bc
        s, n = pair_of_numbers(point, what, "point")
        p = middle + s * along + n * np.array([-along[1], along[0]])
        return free_four_bar({"A": np.zeros(2), "D": d, "B": b, "C": c, "P": p}, m, gravity)
    first, second, third = bar("crank", (0, 0), b, m[0]), bar("coupler", b, c, m[1]), bar("rocker", d, c, m[2])
    (a1, b1), (b2, c2), (d3, c3) = ends(first), ends(second), ends(third)
    pins = {
        "A": Revolute("A", ground.at(0, 0), a1),
        "B": Revolute("B", b1, b2),
        "C": Revolute("C", c2, c3),
        "D": Revolute("D", ground.at(ad, 0), d3),
    }
    coordinates = {"crank": pins["A"].angle, "rocker": pins["D"].angle}
    marker = second.at(*pair_of_numbers(point, what, "point"))
    parts = {"crank": first, "coupler": second, "rocker": third, **pins, "point": marker}
    return cranked("four-bar", coordinates, gravity, parts)


def five_bar(
    crank: float = 0.2,
    link: float = 0.3,
    base: float = 0.25,
    angles: tuple[float, float] = (2.0, 1.1),
    masses: Any = 1.0,
    gravity: Any = GRAVITY,
    *,
    free: bool = False,
) -> Model:
    """Return a symmetric five-bar, a parallel robot with two torques.

    Parameters
    ----------
    crank, link : float
        Lengths of both cranks and both links, m.
    base : float
        Distance of the motors, m; the left one at the origin.
    angles : (float, float)
        Angles of the cranks in the estimated pose, rad; the tip lies above.
    masses : float or four of them, default 1
        Of left crank, left link, right crank, right link, kg.
    gravity : (float, float) or None
        m/s².
    free : bool, default False
        True if the points A, B, C, D and the tip P are unknowns for :func:`synthesize`: the drawn pose is that of its
        first position, all angles are zero there, and `masses` are those of a metre of each bar, kg/m.

    Returns
    -------
    Model
        Bodies ``left, left_link, right, right_link``; pins ``A, B, tip_pin, C, D``; inputs
        ``tau_left, tau_right``; marker ``tip``; coordinates ``left`` and ``right``. A free one has
        ``unknowns``, a dictionary of the parameters ``Ax … Py`` by their names.
    """
    what = "five_bar"
    r, long, width = lengths(what, crank=crank, link=link, base=base)
    e = np.array([width, 0.0])
    left, right = pair_of_numbers(angles, what, "angles")
    b, d = at_angle(r, left), e + at_angle(r, right)
    c = meeting_point(b, long, d, long, True, what)
    m = masses_of(masses, 4, what)
    if yes_or_no(free, what, "free"):
        return free_five_bar({"A": np.zeros(2), "D": e, "B": b, "C": d, "P": c}, m, gravity)
    bodies = {
        "left": bar("left", (0, 0), b, m[0]),
        "left_link": bar("left link", b, c, m[1]),
        "right": bar("right", e, d, m[2]),
        "right_link": bar("right link", d, c, m[3]),
    }
    (a1, b1), (b2, c2), (e3, d3), (d4, c4) = map(ends, bodies.values())
    joints = {
        "A": Revolute("A", ground.at(0, 0), a1),
        "B": Revolute("B", b1, b2),
        "tip_pin": Revolute("tip pin", c2, c4),
        "C": Revolute("C", d3, d4),
        "D": Revolute("D", ground.at(width, 0), e3),
    }
    coordinates = {"left": joints["A"].angle, "right": joints["D"].angle}
    motors = {"tau_left": bodies["left"], "tau_right": bodies["right"]}
    return cranked("five-bar", coordinates, gravity, {**bodies, **joints}, motors=motors, tip=c2)


def slider_crank(
    crank: float = 0.05,
    rod: float = 0.15,
    offset: float = 0.0,
    angle: float = 0.3,
    masses: Any = (0.12, 0.5, 2.0),
    gravity: Any = GRAVITY,
    *,
    free: bool = False,
) -> Model:
    """Return a slider-crank on the x axis, with a torque on the crank.

    Parameters
    ----------
    crank, rod : float
        Lengths, m.
    offset : float, default 0
        Height of the guide above the crank's bearing, m.
    angle : float, default 0.3
        Crank angle of the estimated pose, rad.
    masses : float or three of them
        Of crank, rod and slider, kg.
    gravity : (float, float) or None
        m/s².
    free : bool, default False
        True if the places of the pins A, B, C and the angle of the guide are unknowns for :func:`synthesize`: the pose
        is that of its first position, all angles are zero there, and masses of crank and rod are of a metre, kg/m.

    Returns
    -------
    Model
        Bodies ``crank, rod, slider``; joints ``main, pin, wrist, guide``; input ``tau``;
        coordinates ``crank`` (angle) and ``slider`` (displacement). With free points also ``unknowns``, a dictionary of
        the parameters ``Ax … Cy`` and ``slider_angle``.
    """
    what = "slider_crank"
    r, long = lengths(what, crank=crank, rod=rod)
    height = number(offset, what, "offset")
    tip = at_angle(r, number(angle, what, "angle"))
    if abs(height - tip[1]) >= long:
        raise ModelError(
            f"{what}: the rod of {long:g} m does not reach from the crank pin, {tip[1]:.4g} m high, to the guide, "
            f"{height:g} m high; change a length, the offset or the angle of the crank"
        )
    end = np.array([tip[0] + np.sqrt(long**2 - (height - tip[1]) ** 2), height])
    m = masses_of(masses, 3, what)
    if yes_or_no(free, what, "free"):
        return free_slider_crank({"A": np.zeros(2), "B": tip, "C": end}, m, gravity)
    first, second = bar("crank", (0, 0), tip, m[0]), bar("rod", tip, end, m[1])
    block = Rectangle(r, 0.6 * r)
    slider = Body("slider", m[2], m[2] * (r**2 + (0.6 * r) ** 2) / 12, pose=(*end, 0.0), shape=block)
    main = Revolute("main bearing", ground.at(0, 0), ends(first)[0])
    pin = Revolute("crank pin", ends(first)[1], ends(second)[0])
    wrist = Revolute("wrist pin", ends(second)[1], slider.at(0, 0))
    guide = Translational("guide", ground.at(0, height), slider.at(0, 0))
    coordinates = {"crank": main.angle, "slider": guide.displacement}
    parts = {"crank": first, "rod": second, "slider": slider, "main": main, "pin": pin, "wrist": wrist, "guide": guide}
    return cranked("slider-crank", coordinates, gravity, parts)
