"""Every element of the catalogue in a small machine with one coordinate s and one input u that works along it."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

import mbdcasadi as mbd

PROGRAM = mbd.MotionProgram(mbd.rise(np.pi, 0.01, "3-4-5"), mbd.fall(np.pi, "cycloidal"))
EGG = mbd.CamOutline(lambda x: 0.05 + 0.006 * mbd.cos(x + 0.5))


def machine(bodies, joints, s, by, forces=(), **more):
    """A machine that is moved by `by` along s; its input works along s."""
    u = mbd.Input("u")
    push = mbd.GeneralizedForce("push", [(s, u)])
    mechanism = mbd.Mechanism(bodies, joints, forces=[mbd.Gravity(), *forces, push], inputs=[u], **more)
    return SimpleNamespace(mechanism=mechanism, u=u, s=s, by=by)


def rotor(inertia=0.05, **more):
    """A heavy shaft at the origin."""
    shaft = mbd.Body("shaft", mass=2.0, inertia=inertia, **more)
    return shaft, mbd.Revolute("bearing", mbd.ground.at(0, 0), shaft.at(0, 0))


def slide(y=0.0):
    """A block on a level guide."""
    block = mbd.Body("block", mass=2.0, inertia=0.1, pose=(0, y, 0))
    return block, mbd.Translational("guide", mbd.ground.at(0, y), block.at(0, 0))


def second_shaft(joint_of, place=(0.3, 0.0)):
    """Two shafts and what couples them."""
    shaft, bearing = rotor()
    other = mbd.Body("other", mass=1.0, inertia=0.02, pose=(*place, 0.4))
    second = mbd.Revolute("second bearing", mbd.ground.at(*place), other.at(0, 0))
    joint = joint_of(shaft.at(0, 0), other.at(0, 0))
    return machine([shaft, other], [bearing, second, joint], bearing.angle, 2.0)


def planet():
    """Sun fixed, arm moved."""
    arm = mbd.Body("arm", mass=1.0, inertia=0.05)
    hub = mbd.Revolute("hub", mbd.ground.at(0, 0), arm.at(0, 0))
    wheel = mbd.Body("planet", mass=0.5, inertia=1e-3, pose=(0.06, 0, 0))
    joints = [
        hub,
        mbd.Revolute("pin", arm.at(0.06, 0), wheel.at(0, 0)),
        mbd.Gear("mesh", mbd.ground.at(0, 0), wheel.at(0, 0), 0.04, 0.02, carrier=arm),
    ]
    return machine([arm, wheel], joints, hub.angle, 2.0)


def on_shaft(force_of):
    """A shaft with a force from the ground."""
    shaft, bearing = rotor()
    return machine([shaft], [bearing], bearing.angle, 0.2, [force_of(shaft.at(0, 0))])


def keyed():
    """A shaft with an elastic key that has play."""
    law = mbd.HuntCrossley(20)
    return on_shaft(lambda a: mbd.Backlash("key", mbd.Coupler("key", GROUND.at(0, 0), a, 1.0), 0.1, law))


def rack():
    """Rack and pinion."""
    block, guide = slide()
    wheel = mbd.Body("pinion", mass=1, inertia=0.01, pose=(0, 0.06, 0))
    hub = mbd.Revolute("hub", mbd.ground.at(0, 0.06), wheel.at(0, 0))
    mesh = mbd.RackAndPinion("mesh", block.at(0, 0), wheel.at(0, 0), 0.06)
    return machine([block, wheel], [guide, hub, mesh], guide.displacement, 0.3)


def rolling():
    """An eccentric wheel."""
    wheel = mbd.Body("wheel", mass=2.0, inertia=0.02, pose=(0.02, 0.2, 0))
    roll = mbd.Rolling("track", wheel.at(-0.02, 0), mbd.ground.at(0, 0), 0.2)
    return machine([wheel], [roll], roll.displacement, 0.5)


def cam(**kind):
    """A cam with a flywheel."""
    model = mbd.library.cam_follower(masses=(40.0, 0.5), stiffness=2000, preload=100, **kind)
    joints, forces = model.mechanism.joints, [model.spring]
    return machine(model.mechanism.bodies, joints, model.shaft.angle, 2.0, forces)


def cam_on_cam():
    """A cam that lifts a rounded rocker."""
    shaft, bearing = rotor()
    rocker = mbd.Body("rocker", mass=0.5, inertia=0.005, pose=(0.005, 0.09, 0))
    pivot = mbd.Revolute("pivot", mbd.ground.at(0.2, 0.09), rocker.at(0.195, 0))
    contact = mbd.CamCam("contact", shaft.at(0, 0), rocker.at(0, 0), EGG, mbd.CamOutline(0.04))
    return machine([shaft, rocker], [bearing, pivot, contact], bearing.angle, 2.0)


def slot():
    """A bead on a curved rail."""
    bead = mbd.Body("bead", mass=1.0, inertia=0.01, pose=(-0.5, 0.25, 0))
    rail = mbd.PointOnCurve("rail", mbd.ground.at(0, 0), bead.at(0, 0), mbd.Curve(lambda s: (s, s**2), -2, 2))
    return machine([bead], [rail, mbd.AbsoluteAngle("upright", bead.at(0, 0))], bead.x, 1.0)


def valley():
    """A wheel in a valley; its axle is moved."""
    wheel = mbd.Body("wheel", mass=1.0, inertia=0.005, pose=(-0.5 + 0.1 / 2**0.5, 0.25 + 0.1 / 2**0.5, 0))
    road = mbd.Curve(lambda s: (s, s**2), -2, 2)
    return machine([wheel], [mbd.RollingOnCurve("road", wheel.at(0, 0), GROUND.at(0, 0), road, 0.1)], wheel.x, 0.8)


def on_slide(force_of):
    """A block on a guide with a force from the ground."""
    block, guide = slide()
    return machine([block], [guide], guide.displacement, 0.05, [force_of(block, guide)])


def wagon():
    """An open wagon under a hopper that stands still."""
    sand = mbd.StateVariable("sand")
    wagon = mbd.Body("wagon", mass=2.0 + sand, inertia=0.1)
    guide = mbd.Translational("guide", GROUND.at(0, 0), wagon.at(0, 0))
    hopper = mbd.MassFlow("hopper", wagon.at(0, 0.1), 0.5, (-wagon.vx, -1.0), frame="global")
    return machine([wagon], [guide], guide.displacement, 0.5, [hopper], states={sand: 0.5})


def field():
    """A rod in a field that grows with the height."""
    rod = mbd.Body.from_shape("rod", mbd.Rod(1.0), mass=2.0)
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), rod.at(-0.5, 0))
    lift = mbd.FieldForce("field", rod, lambda point: (0, 3 * point.y**2 - point.vy))
    return machine([rod], [pin], pin.angle, 1.0, [lift])


def motor():
    """A motor with a speed-torque line against a rotational spring."""
    shaft, bearing = rotor()
    drive = mbd.DCMotor("motor", shaft, 6.0, 0.4, 1.5)
    spring = mbd.RSDA("spring", mbd.ground.at(0, 0), shaft.at(0, 0), stiffness=1.0)
    return machine([shaft], [bearing], bearing.angle, 1.0, [drive, spring])


def skate():
    """A sledge whose blade and rail leave it one way to go."""
    body = mbd.Body("sledge", mass=1.3, inertia=0.1)
    blade = mbd.KnifeEdge("blade", body.at(-0.2, 0))
    return machine([body], [blade, mbd.AbsoluteY("rail", body.at(0, 0), 0.0)], body.x, 0.5)


def coupled_speeds():
    """A variator: the ratio of block and shaft grows with the place of the block."""
    shaft, bearing = rotor()
    block, guide = slide(y=0.5)
    drive = mbd.NonholonomicConstraint("variator", block.vx - (0.1 + 0.2 * block.x**2) * shaft.omega)
    return machine([shaft, block], [bearing, guide, drive], guide.displacement, 0.2)


def jib():
    """A trolley on a jib that an actuator lifts."""
    arm = mbd.Body("jib", mass=20.0, inertia=4.0, pose=(1.0, 0, 0))
    trolley = mbd.Body("trolley", mass=5.0, inertia=0.1, pose=(0.5, 0, 0))
    foot, guide = (
        mbd.Revolute("foot", mbd.ground.at(0, 0), arm.at(-1, 0)),
        mbd.Translational("guide", arm.at(-1, 0), trolley.at(0, 0)),
    )
    lift = mbd.Actuator("lift", mbd.ground.at(0.6, -0.8), arm.at(0, 0), 0.9 + 0.1 * mbd.t)
    return machine([arm, trolley], [foot, guide], guide.displacement, 0.8, drivers=[lift])


def hoist():
    """A winch whose cable runs over a wheel that it turns and a block that is free, to a load on a guide."""
    shaft, bearing = rotor()
    load = mbd.Body("load", mass=3.0, inertia=0.1, pose=(0.95, -0.6, 0))
    wheel = mbd.Body("wheel", mass=1.0, inertia=0.01, pose=(0.6, 0.4, 0))
    joints = [
        bearing,
        mbd.Revolute("axle", mbd.ground.at(0.6, 0.4), wheel.at(0, 0)),
        mbd.Translational("guide", mbd.ground.at(0.95, 0, np.pi / 2), load.at(0, 0, np.pi / 2)),
        mbd.Cable(
            "cable",
            mbd.Drum(shaft.at(0, 0), 0.1, "counter-clockwise"),
            mbd.ground.at(1.2, 0.5),
            over=[
                mbd.Pulley(wheel.at(0, 0), 0.08, "clockwise", grips=True),
                mbd.Pulley(load.at(0, 0), 0.06, "counter-clockwise"),
            ],
        ),
    ]
    return machine([shaft, load, wheel], joints, bearing.angle, 1.5)


GROUND = mbd.ground
POST = mbd.Pulley(GROUND.at(1.0, 0.05), 0.05, "counter-clockwise")
MACHINES = {
    "Gear": lambda: second_shaft(lambda a, b: mbd.Gear("mesh", a, b, 0.2, 0.1)),
    "internal Gear": lambda: second_shaft(lambda a, b: mbd.Gear("mesh", a, b, 0.4, 0.1, internal=True)),
    "Gear on a carrier": planet,
    "Belt": lambda: second_shaft(lambda a, b: mbd.Belt("belt", a, b, 0.1, 0.15)),
    "ElasticBelt": lambda: on_shaft(
        lambda a: mbd.ElasticBelt("belt", GROUND.at(0.5, 0), a, 0.1, 0.15, 500.0, pretension=50.0, damping=5.0)
    ),
    "Coupler": lambda: second_shaft(lambda a, b: mbd.Coupler("gearbox", a, b, -3.0)),
    "Backlash": keyed,
    "RackAndPinion": rack,
    "Rolling": rolling,
    "CamFlatFollower": lambda: cam(program=PROGRAM),
    "CamPointFollower": lambda: cam(program=PROGRAM, roller_radius=0.01),
    "CamPointFollower on points": lambda: cam(
        outline=mbd.CamOutline.through([(0.05 * np.cos(x), 0.04 * np.sin(x)) for x in np.arange(0, 6.2, 0.4)]),
        roller_radius=0.01,
    ),
    "CamCam": cam_on_cam,
    "PointOnCurve": slot,
    "RollingOnCurve": valley,
    "Bushing": lambda: on_slide(lambda b, g: mbd.Bushing("rubber", GROUND.at(0, 0), b.at(0, 0), (500, 100), 10)),
    "EndStop": lambda: on_slide(lambda b, g: mbd.EndStop("stop", 0.02 - g.displacement, mbd.HuntCrossley(1e4))),
    "Rope": lambda: on_slide(lambda b, g: mbd.Rope("rope", GROUND.at(-0.3, 0), b.at(0, 0), 0.32, 2e3)),
    "Rope over a pulley": lambda: on_slide(
        lambda b, g: mbd.Rope("rope", GROUND.at(1.1, -0.5), b.at(0, 0), 1.3, 100, 5, over=[POST])
    ),
    "Cable": hoist,
    "Cylinder": lambda: on_slide(lambda b, g: mbd.Cylinder("ram", GROUND.at(-1, 0), b.at(0, 0), 0.05, 0.02, 1e4)),
    "GasSpring": lambda: on_slide(lambda b, g: mbd.GasSpring("gas", GROUND.at(-0.3, 0), b.at(0, 0), 1e-3, 0.3, 2e5)),
    "Contact": lambda: on_slide(
        lambda b, g: mbd.Contact(
            "pad",
            mbd.Circle(b.at(0, 0), 0.1),
            mbd.HalfPlane(GROUND.at(0, -0.099)),
            mbd.HuntCrossley(1e6),
            mbd.Stribeck(0.2, 0.3, 0.5, 0.05),
        )
    ),
    "DataLaw": lambda: on_slide(
        lambda b, g: mbd.TSDA(
            "spring", GROUND.at(-0.3, 0), b.at(0, 0), law=mbd.DataLaw([-0.1, 0, 0.05, 0.1], [-50, 0, 20, 60], free=0.3)
        )
    ),
    "MassFlow": wagon,
    "Wheel": lambda: on_slide(
        lambda b, g: mbd.Wheel(
            "tyre",
            b.at(0, 0),
            GROUND.at(0, -0.1),
            lambda x: 0.002 * mbd.sin(20 * x),
            0.105,
            mbd.HuntCrossley(1e4, exponent=1),
            mbd.Viscous(3.0),
        )
    ),
    "FieldForce": field,
    "DCMotor": motor,
    "Actuator": jib,
    "KnifeEdge": skate,
    "NonholonomicConstraint": coupled_speeds,
}
