"""Textbook linkages that several tests share, and their closed forms."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import SimpleNamespace

import numpy as np

import mbdcasadi as mbd

G = 9.81


# --- poses ---------------------------------------------------------------------------
def pose_on(start, end, local_start, near: float = 0.0) -> tuple[float, float, float]:
    """Pose of a body whose x axis runs from start to end, where `start` has the local coordinates given."""
    (x0, y0), (x1, y1) = start, end
    angle = np.arctan2(y1 - y0, x1 - x0)
    angle += 2 * np.pi * np.round((near - angle) / (2 * np.pi))
    c, s = np.cos(angle), np.sin(angle)
    return x0 - c * local_start[0] + s * local_start[1], y0 - s * local_start[0] - c * local_start[1], angle


def four_bar_points(theta, crank, coupler, rocker, base, left=True):
    """Joints A, B, C, D at a crank angle; C to the left (or right) of the line from B to D."""
    a, d = np.zeros(2), np.array([base, 0.0])
    b = crank * np.array([np.cos(theta), np.sin(theta)])
    reach = float(np.hypot(*(d - b)))
    e = (d - b) / reach
    along = (coupler**2 - rocker**2 + reach**2) / (2 * reach)
    across = np.sqrt(max(coupler**2 - along**2, 0.0)) * (1 if left else -1)
    return a, b, b + along * e + across * np.array([-e[1], e[0]]), d


# --- linkages ------------------------------------------------------------------------
def pendulum(angle: float = 0.0, length: float = 1.0, mass: float = 1.0, forces: Sequence = (), **more):
    """Uniform rod on a pin at the origin."""
    pose = (length / 2 * np.cos(angle), length / 2 * np.sin(angle), angle)
    rod = mbd.Body("rod", mass=mass, inertia=mass * length**2 / 12, pose=pose)
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), rod.at(-length / 2, 0))
    extra = forces(rod) if callable(forces) else forces
    mechanism = mbd.Mechanism(bodies=[rod], joints=[pin], forces=[mbd.Gravity(), *extra], **more)
    return SimpleNamespace(rod=rod, pin=pin, mechanism=mechanism)


def four_bar(
    theta: float,
    lengths: Sequence[float] = (0.2, 0.5, 0.4, 0.55),
    masses: Sequence[float] = (1.0, 2.0, 1.5),
    inertias: Sequence[float] = (0.01, 0.06, 0.03),
    centres: Sequence[Sequence[float]] | None = None,
    left: bool = True,
    forces: Callable | Sequence = (),
    drivers: Callable | None = None,
    **more,
):
    """Crank AB, coupler BC, rocker DC, base AD; x axes along each link from its first pin."""
    ab, bc, dc, _ = lengths
    centres = centres or [(ab / 2, 0.0), (bc / 2, 0.0), (dc / 2, 0.0)]
    a, b, c, d = four_bar_points(theta, *lengths, left)
    first = [(-x, -y) for x, y in centres]
    last = [(length - x, -y) for length, (x, y) in zip((ab, bc, dc), centres, strict=True)]
    f = SimpleNamespace()
    ends = zip(("crank", "coupler", "rocker"), masses, inertias, ((a, b), (b, c), (d, c)), first, strict=True)
    f.crank, f.coupler, f.rocker = (
        mbd.Body(name, mass=m, inertia=j, pose=pose_on(*pins, local, theta if name == "crank" else 0.0))
        for name, m, j, pins, local in ends
    )
    f.A = mbd.Revolute("A", mbd.ground.at(0, 0), f.crank.at(*first[0]))
    f.B = mbd.Revolute("B", f.crank.at(*last[0]), f.coupler.at(*first[1]))
    f.C = mbd.Revolute("C", f.coupler.at(*last[1]), f.rocker.at(*last[2]))
    f.D = mbd.Revolute("D", mbd.ground.at(*d), f.rocker.at(*first[2]))
    f.drivers = list(drivers(f)) if drivers else []
    f.mechanism = mbd.Mechanism(
        bodies=[f.crank, f.coupler, f.rocker],
        joints=[f.A, f.B, f.C, f.D],
        drivers=f.drivers,
        forces=forces(f) if callable(forces) else forces,
        **more,
    )
    return f


def slider_crank(
    theta: float,
    r: float = 0.15,
    l: float = 0.45,  # noqa: E741  (the textbook's name)
    crank: Sequence[float] = (1.5, 0.01, 0.05),
    rod: Sequence[float] = (1.0, 0.02, 0.2),
    slider: float = 2.0,
    forces: Callable | Sequence = (),
    drivers: Callable | None = None,
    **more,
):
    """Slider on the positive x axis; crank and rod as (mass, inertia, centre of mass from the first pin)."""
    b = r * np.array([np.cos(theta), np.sin(theta)])
    c = np.array([b[0] + np.sqrt(max(l**2 - b[1] ** 2, 0.0)), 0.0])
    f = SimpleNamespace()
    f.crank = mbd.Body("crank", mass=crank[0], inertia=crank[1], pose=pose_on((0, 0), b, (-crank[2], 0), theta))
    f.rod = mbd.Body("rod", mass=rod[0], inertia=rod[1], pose=pose_on(b, c, (-rod[2], 0)))
    f.slider = mbd.Body("slider", mass=slider, inertia=0.01, pose=(c[0], 0.0, 0.0))
    f.A = mbd.Revolute("A", mbd.ground.at(0, 0), f.crank.at(-crank[2], 0))
    f.B = mbd.Revolute("B", f.crank.at(r - crank[2], 0), f.rod.at(-rod[2], 0))
    f.C = mbd.Revolute("C", f.rod.at(l - rod[2], 0), f.slider.at(0, 0))
    f.guide = mbd.Translational("guide", mbd.ground.at(0, 0), f.slider.at(0, 0))
    f.drivers = list(drivers(f)) if drivers else []
    f.mechanism = mbd.Mechanism(
        bodies=[f.crank, f.rod, f.slider],
        joints=[f.A, f.B, f.C, f.guide],
        drivers=f.drivers,
        forces=forces(f) if callable(forces) else forces,
        **more,
    )
    return f


def block_and_rider():
    """A block that rubs on its guide, with and without a rider, and the event at 0.3 s in which that leaves."""
    block = mbd.Body("block", mass=1.0, inertia=0.1, velocity=(2.0, 0, 0))
    rider = mbd.Body("rider", mass=1.0, inertia=0.1, velocity=(2.0, 0, 0))
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    seat = mbd.Weld("seat", block.at(0, 0), rider.at(0, 0))
    rub = mbd.JointFriction("rub", guide, mbd.DryFriction(0.2))
    both = mbd.Mechanism(bodies=[block, rider], joints=[guide, seat], forces=[mbd.Gravity(), rub])
    alone = mbd.Mechanism(bodies=[block], joints=[guide], forces=[mbd.Gravity(), rub])
    jump = mbd.Event("jump", mbd.t - 0.3 + 0 * rider.x, direction=1, during=both, becomes=alone)
    return block, both, alone, jump


def n_four_bar(loops: int, speed: float = -1.0, mass: float = 1.0):
    """IFToMM A02: rods of 1 m and 1 kg, cranks upright; `speed` is the rate of the cranks."""
    upright = [
        mbd.Body(f"crank {i}", mass=1.0, inertia=1 / 12, pose=(i, 0.5, np.pi / 2), velocity=(-0.5 * speed, 0, speed))
        for i in range(loops + 1)
    ]
    level = [
        mbd.Body(f"rod {i}", mass=mass, inertia=mass / 12, pose=(i - 0.5, 1.0, 0.0), velocity=(-speed, 0, 0))
        for i in range(1, loops + 1)
    ]
    joints = [mbd.Revolute(f"foot {i}", mbd.ground.at(i, 0), c.at(-0.5, 0)) for i, c in enumerate(upright)]
    for i, rod in enumerate(level, 1):
        joints.append(mbd.Revolute(f"left head {i}", upright[i - 1].at(0.5, 0), rod.at(-0.5, 0)))
        joints.append(mbd.Revolute(f"right head {i}", rod.at(0.5, 0), upright[i].at(0.5, 0)))
    mechanism = mbd.Mechanism(bodies=upright + level, joints=joints, forces=[mbd.Gravity()])
    return SimpleNamespace(mechanism=mechanism, cranks=upright, rods=level, first=upright[0])


def slider_crank_motion(theta, rate, acceleration, r, l):  # noqa: E741
    """Slider position, speed and acceleration of an in-line slider-crank, by the closed form."""
    root = np.sqrt(l**2 - (r * np.sin(theta)) ** 2)
    x = r * np.cos(theta) + root
    slope = -r * np.sin(theta) - r**2 * np.sin(theta) * np.cos(theta) / root
    bend = -r * np.cos(theta) - r**2 * np.cos(2 * theta) / root - r**4 * (np.sin(theta) * np.cos(theta)) ** 2 / root**3
    return x, slope * rate, bend * rate**2 + slope * acceleration


def welded_beams(length: float, mass: float, inertia: float, light: float):
    """A beam and a plate, light if so, with too many welds, and a weight in a guide on the beam; given by their units.

    Returned are the beam and the weight, all bodies, and the joints, the four welds first.
    """
    beam = mbd.Body("beam", mass=mass, inertia=0.3 * inertia, pose=(0.5 * length, 0, 0))
    plate = mbd.Body("plate", mass=light * mass, inertia=0.1 * light * inertia, pose=(1.3 * length, 0.1 * length, 0))
    weight = mbd.Body("weight", mass=mass, inertia=0.1 * inertia, pose=(0.5 * length, -1.0 * length, 0))
    down = -np.pi / 2
    joints = [
        mbd.Weld("left", mbd.ground.at(0, 0), beam.at(-0.5 * length, 0)),
        mbd.Weld("middle", beam.at(0.5 * length, 0), plate.at(-0.3 * length, -0.1 * length)),
        mbd.Weld("above", beam.at(0.4 * length, 0.2 * length), plate.at(-0.4 * length, 0.1 * length)),
        mbd.Weld("right", mbd.ground.at(1.3 * length, 0.3 * length), plate.at(0, 0.2 * length)),
        mbd.Translational("guide", beam.at(0, 0, down), weight.at(0, 0, down)),
    ]
    return beam, weight, [beam, plate, weight], joints
