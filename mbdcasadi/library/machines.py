"""Planetary gear and cam with follower."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..errors import ModelError
from ..model.bodies import Body, ground
from ..model.forces.applied import Torque
from ..model.forces.field import GRAVITY
from ..model.forces.springs import TSDA
from ..model.geometry.cam_outlines import CamOutline
from ..model.geometry.curves import least
from ..model.geometry.shapes import Disc, Rectangle, Rod, Shape
from ..model.joints.cams import CamFlatFollower, CamPointFollower
from ..model.joints.gears import Gear
from ..model.joints.lower_pairs import Revolute, Translational
from ..model.mechanism import Mechanism
from ..model.quantities import whole
from ..model.symbols import Input, number
from .model import Model, at_angle, cranked, lengths, masses_of, weight


def planetary_gear(
    sun: float = 0.04, planet: float = 0.02, planets: int = 1, masses: Any = (1.0, 0.3, 2.0, 1.0), gravity: Any = None
) -> Model:
    """Return a planetary gear about the origin, with torques on sun, ring and arm.

    Two degrees of freedom, ``omega_sun R_sun + omega_ring R_ring = omega_arm (R_sun + R_ring)``
    (Willis). Hold one by a driver or a joint, drive another.

    Parameters
    ----------
    sun, planet : float
        Pitch radii, m; the ring's is ``sun + 2 planet``.
    planets : int, default 1
        Number of them; with more than one the rows of the others are redundant, and tooth forces
        those of least norm, shared evenly.
    masses : float or four of them
        Of sun, each planet, ring and arm, kg: discs, a hoop and a rod.
    gravity : (float, float), optional
        m/s²; none by default, as for an upright shaft.

    Returns
    -------
    Model
        Bodies ``sun, ring, arm`` and the list ``planet_bodies``; lists ``sun_meshes, ring_meshes``;
        inputs ``tau_sun, tau_ring, tau_arm``; coordinates ``sun, ring, arm`` (angles).
    """
    what = "planetary_gear"
    rs, rp = lengths(what, sun=sun, planet=planet)
    planets = whole(planets, what, "planets", 1)
    rr, reach = rs + 2 * rp, rs + rp
    m = masses_of(masses, 4, what)
    central = {
        "sun": Body("sun", m[0], m[0] * rs**2 / 2, shape=Disc(rs)),
        "ring": Body("ring", m[2], m[2] * rr**2),
        "arm": Body("arm", m[3], m[3] * (2 * reach) ** 2 / 12, shape=_spider(reach, planets)),
    }
    joints: list[Any] = [Revolute(f"{name} bearing", ground.at(0, 0), b.at(0, 0)) for name, b in central.items()]
    arm = central["arm"]
    bodies, sun_meshes, ring_meshes = [], [], []
    for k in range(planets):
        place = at_angle(reach, 2 * np.pi * k / planets)
        tag = f" {k + 1}" if planets > 1 else ""
        body = Body(f"planet{tag}", m[1], m[1] * rp**2 / 2, pose=(*place, 0.0), shape=Disc(rp))
        hub = body.at(0, 0)
        bodies.append(body)
        joints.append(Revolute(f"planet pin{tag}", arm.at(*place), hub))
        sun_meshes.append(Gear(f"sun mesh{tag}", central["sun"].at(0, 0), hub, rs, rp, carrier=arm))
        ring_meshes.append(Gear(f"ring mesh{tag}", hub, central["ring"].at(0, 0), rp, rr, internal=True, carrier=arm))
    inputs = {name: Input(f"tau {name}", unit="N m") for name in central}
    torques = [Torque(f"{name} torque", central[name], inputs[name]) for name in central]
    mechanism = Mechanism(
        bodies=[*central.values(), *bodies],
        joints=[*joints, *sun_meshes, *ring_meshes],
        forces=[*weight(gravity), *torques],
        inputs=list(inputs.values()),
        name="planetary gear",
    )
    coordinates = {joint.b.body.name: joint.angle for joint in joints[:3]}
    symbols = {f"tau_{name}": symbol for name, symbol in inputs.items()}
    return Model(
        mechanism, coordinates, **central, **symbols, planet_bodies=bodies, sun_meshes=sun_meshes,
        ring_meshes=ring_meshes,
    )  # fmt: skip


def _spider(reach: float, count: int) -> Shape:
    """Arms to all planets, for pictures; to both sides if there is one planet."""
    if count == 1:
        return Rod(2 * reach)
    angles = 2 * np.pi * np.arange(count) / count
    first, *others = (Rod(reach, center=tuple(at_angle(reach / 2, x)), angle=float(x)) for x in angles)
    return sum(others, first)


def cam_follower(
    program: Any = None,
    base_radius: float = 0.04,
    roller_radius: float | None = None,
    offset: float = 0.0,
    outline: CamOutline | None = None,
    masses: Any = (1.0, 0.5),
    stiffness: float = 0.0,
    preload: float = 0.0,
    gravity: Any = GRAVITY,
) -> Model:
    """Return a cam on a shaft at the origin and a follower above it, with a torque on the cam.

    Parameters
    ----------
    program : MotionProgram or callable, optional
        Lift (m) over the cam's angle, from which the profile is made.
    base_radius : float, default 0.04
        Smallest radius of the cam, m.
    roller_radius : float, optional
        Radius of the roller, m, zero for a knife edge; by default a flat face.
    offset : float, default 0
        Of the guide of a roller, to the left of the shaft, m.
    outline : CamOutline, optional
        Outline about the shaft, in place of `program`.
    masses : float or two of them
        Of the cam (a disc of the base radius) and the follower, kg.
    stiffness, preload : float, default 0
        Spring on the follower, N/m, and its force in the estimated pose, N.
    gravity : (float, float) or None
        m/s².

    Returns
    -------
    Model
        Bodies ``cam, follower``; joints ``shaft, guide, contact``; ``spring`` (None without
        one); input ``tau``; coordinates ``cam`` (angle) and ``lift`` (height of the follower, m).
    """
    what = "cam_follower"
    (base,) = lengths(what, base_radius=base_radius)
    if (program is None) == (outline is None):
        raise ModelError(f"{what}: give either a program or an outline")
    roller = None if roller_radius is None else number(roller_radius, what, "roller_radius")
    aside = number(offset, what, "offset")
    if roller is None and aside != 0:
        raise ModelError(f"{what}: the offset {aside:g} m belongs to a roller, not to a flat face; give roller_radius=")
    outline = _profile(program, base, roller, aside) if outline is None else outline
    m = masses_of(masses, 2, what)
    # an offset to the left of the direction of the lift is on the side of -x
    x = 0.0 if roller is None else -aside
    height = _height(outline, roller, x)
    cam = Body("cam", m[0], m[0] * base**2 / 2, shape=Disc(base))
    # for pictures: a stem, on which the spring sits
    stem = Rectangle(0.35 * base, 1.6 * base, center=(0.0, 0.8 * base))
    follower = Body("follower", m[1], m[1] * base**2, pose=(x, height, 0.0), shape=stem)
    shaft = Revolute("shaft", ground.at(0, 0), cam.at(0, 0))
    guide = Translational("guide", ground.at(x, 0, angle=np.pi / 2), follower.at(0, 0, angle=np.pi / 2))
    touching = cam.at(0, 0), follower.at(0, 0), outline
    flat = roller is None
    contact: Any = CamFlatFollower("contact", *touching) if flat else CamPointFollower("contact", *touching, roller)
    spring = None if stiffness == 0 and preload == 0 else _spring(follower, x, height, base, stiffness, preload)
    coordinates = {"cam": shaft.angle, "lift": guide.displacement}
    parts = {"cam": cam, "follower": follower, "shaft": shaft, "guide": guide, "contact": contact}
    parts |= {"spring": spring, "outline": outline}
    return cranked("cam and follower", coordinates, gravity, parts)


def _profile(program: Any, base: float, roller: float | None, aside: float) -> CamOutline:
    """Outline that moves a flat face, or a roller, by a program."""
    if roller is None:
        return CamOutline.for_flat_follower(program, base)
    return CamOutline.for_roller_follower(program, base, roller, aside)


def _height(outline: CamOutline, roller: float | None, x: float) -> float:
    """Height of the follower above the shaft before the cam has turned."""

    def at(places: Any) -> tuple[np.ndarray, np.ndarray]:
        points, normals = outline.points_and_normals(np.atleast_1d(places))
        return points + (roller or 0.0) * normals, normals

    if roller is None:
        place = least(lambda places: -at(places)[0][1], outline)
    else:
        # on the upper side, straight above or below the roller's centre
        place = least(lambda p: np.abs(at(p)[0][0] - x) + np.where(at(p)[1][1] > 0, 0.0, 10 * outline.size), outline)
    return float(at(place)[0][1, 0])


def _spring(follower: Body, x: float, height: float, base: float, stiffness: Any, preload: Any) -> TSDA:
    """Spring from the follower's stem to a place above it, compressed by the preload in the estimated pose."""
    length = 1.8 * base
    k, force = number(stiffness, "cam_follower", "stiffness"), number(preload, "cam_follower", "preload")
    at, top = follower.at(0, 1.6 * base), ground.at(x, height + 1.6 * base + length)
    if k == 0:
        return TSDA("spring", at, top, actuator=-force)
    return TSDA("spring", at, top, stiffness=k, free_length=length + force / k)
