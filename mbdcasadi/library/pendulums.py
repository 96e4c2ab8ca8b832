"""Chains of pendulums."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..model.bodies import ground
from ..model.forces.applied import Torque
from ..model.forces.field import GRAVITY
from ..model.joints.lower_pairs import Revolute
from ..model.mechanism import Mechanism
from ..model.quantities import whole
from ..model.symbols import Input
from .model import Model, at_angle, bar, ends, lengths, masses_of, one_for_each, weight


def pendulum_chain(
    links: int = 2, length: float = 1.0, masses: Any = 1.0, angles: Any = 0.0, gravity: Any = GRAVITY
) -> Model:
    """Return uniform rods one below the other, with a torque in every joint.

    Parameters
    ----------
    links : int, default 2
        Number of links.
    length : float, default 1
        Of each rod, m.
    masses : float or one for each, default 1
        kg.
    angles : float or one for each, default 0
        Angles of the estimated pose against the downward direction, rad.
    gravity : (float, float) or None
        m/s².

    Returns
    -------
    Model
        Lists ``rods``, ``pins`` and ``torques`` (inputs); marker ``tip``; coordinates
        ``angle_1, angle_2, …``: of the first rod against the ground's x axis, then of each against the one before.
    """
    what = "pendulum_chain"
    count = whole(links, what, "links", 1)
    (long,) = lengths(what, length=length)
    m = masses_of(masses, count, what)
    corners = [np.zeros(2)]
    for angle in one_for_each(angles, count, what, "angles", "angle"):
        corners.append(corners[-1] + at_angle(long, angle - np.pi / 2))
    rods = [bar(f"rod {k + 1}", corners[k], corners[k + 1], m[k]) for k in range(count)]
    above = [ground.at(0, 0), *[ends(rod)[1] for rod in rods]]
    pins = [Revolute(f"pin {k + 1}", above[k], ends(rod)[0]) for k, rod in enumerate(rods)]
    torques = [Input(f"tau {k + 1}", unit="N m") for k in range(count)]
    motors = [
        Torque(f"motor {k + 1}", rod, torques[k], opposite=ground if k == 0 else rods[k - 1])
        for k, rod in enumerate(rods)
    ]
    mechanism = Mechanism(rods, pins, forces=[*weight(gravity), *motors], inputs=torques, name="pendulum chain")
    coordinates = {f"angle_{k + 1}": pin.angle for k, pin in enumerate(pins)}
    return Model(mechanism, coordinates, rods=rods, pins=pins, torques=torques, tip=ends(rods[-1])[1])
