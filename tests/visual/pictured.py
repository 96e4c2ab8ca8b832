"""Machines with many names, as drawings are tested with: an excavator, a six-bar, a wiper, a suspension."""

import numpy as np

import mbdcasadi as mbd


def links(places, **named):
    """Links without shape through points by letter; each has the markers of its letters."""
    bodies, at = {}, {}
    for name, letters in named.items():
        points = np.array([places[letter] for letter in letters])
        title = name.replace("_", " ")
        bodies[title] = mbd.Body(title, 1.0, 0.01, pose=(*points.mean(axis=0), 0))
        at |= {(title, k): bodies[title].at(*p) for k, p in zip(letters, points - points.mean(axis=0), strict=True)}
    return list(bodies.values()), at


def six_bar():
    """Watt's chain with a driven crank."""
    places = dict(zip("ABCDEFG", [(0, 0), (0.1, 0.25), (0.55, 0.35), (0.6, 0), (0.35, 0.55), (0.85, 0.6), (0.95, 0.1)],
                      strict=True))  # fmt: skip
    bodies, at = links(places, crank="AB", coupler="BCE", rocker="DC", upper_link="EF", output_rocker="GF")
    joints = [mbd.Revolute(name, mbd.ground.at(*places[k]), at[body, k]) for name, body, k in
              (("O2", "crank", "A"), ("O4", "rocker", "D"), ("O6", "output rocker", "G"))]  # fmt: skip
    joints += [mbd.Revolute(name, at[one, k], at[two, k]) for name, one, two, k in
               (("A", "crank", "coupler", "B"), ("B", "coupler", "rocker", "C"),
                ("C", "coupler", "upper link", "E"), ("D", "upper link", "output rocker", "F"))]  # fmt: skip
    speed = mbd.Driver("speed", joints[0].angle, mbd.t)
    return mbd.Mechanism(bodies, joints, drivers=[speed])


def wiper():
    """Two wipers behind one motor."""
    places = dict(zip("ABCDEF", [(0, 0), (0.03, 0.05), (0.32, 0.14), (0.3, 0), (0.62, 0.14), (0.6, 0)], strict=True))
    bodies, at = links(places, crank="AB", push_rod="BC", left_wiper="DC", connecting_rod="CE", right_wiper="FE")
    joints = [mbd.Revolute(name, mbd.ground.at(*places[k]), at[body, k]) for name, body, k in
              (("motor shaft", "crank", "A"), ("left pivot", "left wiper", "D"),
               ("right pivot", "right wiper", "F"))]  # fmt: skip
    joints += [mbd.Revolute(name, at[one, k], at[two, k]) for name, one, two, k in
               (("crank pin", "crank", "push rod", "B"), ("left lever", "push rod", "left wiper", "C"),
                ("connecting pin", "left wiper", "connecting rod", "C"),
                ("right lever", "connecting rod", "right wiper", "E"))]  # fmt: skip
    return mbd.Mechanism(bodies, joints, forces=[mbd.Torque("motor", bodies[0], 2.0)])


def excavator():
    """Boom, stick and bucket, moved by three cylinders."""
    beam = [(0, -0.25), (2.6, 1.1), (5.2, 0.55), (5.2, 0.85), (2.6, 1.6), (0, 0.25)]
    lever = [(-0.7, 0.1), (0, -0.2), (2.6, -0.12), (2.6, 0.12), (0, 0.25), (-0.7, 0.35)]
    scoop = [(0, 0.15), (0.9, 0.2), (1.3, -0.3), (1.0, -1.0), (0.8, -0.5), (0.1, -0.3), (-0.45, 0)]
    outlines = {
        "boom": (beam, (2.1, 1.4, 0.3)),
        "stick": (lever, (5.0, 1.6, -1.0)),
        "bucket": (scoop, (5.9, -0.5, -1.4)),
    }
    boom, stick, bucket = (
        mbd.Body.from_shape(name, mbd.Polygon(outline), mass=700, pose=pose)
        for name, (outline, pose) in outlines.items()
    )
    joints = [
        mbd.Revolute("boom foot", mbd.ground.at(0, 0), boom.at(0, 0)),
        mbd.Revolute("stick pin", boom.at(5.1, 0.7), stick.at(0, 0)),
        mbd.Revolute("bucket pin", stick.at(2.5, 0), bucket.at(0, 0)),
    ]
    drivers = [
        mbd.Actuator("boom cylinder", mbd.ground.at(0.7, -0.3), boom.at(2.4, 1.15), 2.6 + 0.05 * mbd.t),
        mbd.Actuator("stick cylinder", boom.at(2.6, 1.5), stick.at(-0.6, 0.25), 2.75 - 0.05 * mbd.t),
        mbd.Actuator("bucket cylinder", stick.at(0.1, 0.45), bucket.at(-0.35, 0.05), 2.3 + 0.05 * mbd.t),
    ]
    return mbd.Mechanism([boom, stick, bucket], joints, drivers, [mbd.Force("load", bucket.at(0.7, -0.2), (0, -12e3))])


def suspension():
    """A quarter of a car: body and wheel on guides, strut, tyre, and a stop between body and wheel."""
    wheel = mbd.Body("wheel", mass=40, inertia=1, pose=(0, 0.3, 0))
    body = mbd.Body.from_shape("body", mbd.Rectangle(0.8, 0.2), mass=300, pose=(0, 0.9, 0))
    rails = [mbd.Translational(f"rail of the {b.name}", mbd.ground.at(0, 0, np.pi / 2), b.at(0, 0, np.pi / 2))
             for b in (wheel, body)]  # fmt: skip
    forces = [
        mbd.Gravity(),
        mbd.TSDA("strut", wheel.at(0, 0), body.at(0, 0), stiffness=2e4, damping=1500, free_length=0.7),
        mbd.TSDA("tyre", mbd.ground.at(0, 0), wheel.at(0, 0), stiffness=2e5, free_length=0.31),
        mbd.EndStop("bump stop", body.y - wheel.y - 0.35, mbd.HuntCrossley(1e6, exponent=1)),
    ]
    return mbd.Mechanism([wheel, body], rails, forces=forces)


MACHINES = {"excavator": excavator, "six-bar": six_bar, "wiper": wiper, "suspension": suspension}
