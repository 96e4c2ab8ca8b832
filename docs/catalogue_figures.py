"""The pictures of the catalogue: for each element a mechanism that shows it, drawn by the package.

``python docs/catalogue_figures.py [NAME ...]`` draws them into ``docs/figures/catalogue``.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import mbdcasadi as mbd

TARGET = Path(__file__).resolve().parent / "figures" / "catalogue"
SIZE, DPI = (3.6, 2.4), 110

Scene = Callable[[], mbd.Mechanism | mbd.Trajectory]
SCENES: dict[str, Scene] = {}


def scene(function: Scene) -> Scene:
    """Take a function as what is drawn in the picture of its name."""
    SCENES[function.__name__] = function
    return function


def bar(name: str, length: float, pose: tuple[float, float, float], width: float = 0.08) -> mbd.Body:
    """A bar with a shape."""
    return mbd.Body.from_shape(name, mbd.Rectangle(length, width), mass=1.0, pose=pose)


def box(name: str, pose: tuple[float, float, float], width: float = 0.3, height: float = 0.2) -> mbd.Body:
    """A block."""
    return mbd.Body.from_shape(name, mbd.Rectangle(width, height), mass=1.0, pose=pose)


def disc(name: str, radius: float, pose: tuple[float, float, float]) -> mbd.Body:
    """A disc."""
    return mbd.Body.from_shape(name, mbd.Disc(radius), mass=1.0, pose=pose)


@scene
def revolute() -> mbd.Mechanism:
    a, b = bar("a", 1.0, (0.45, 0.2, 0.4)), bar("b", 1.0, (1.3, 0.2, -0.5))
    foot = mbd.Revolute("pin of a", mbd.ground.at(0, 0), a.at(-0.5, 0))
    return mbd.Mechanism(bodies=[a, b], joints=[foot, mbd.Revolute("pin", a.at(0.5, 0), b.at(-0.5, 0))])


@scene
def translational() -> mbd.Mechanism:
    block = box("b", (0.6, 0.2, 0.3))
    return mbd.Mechanism(bodies=[block], joints=[mbd.Translational("guide", mbd.ground.at(0, 0, 0.3), block.at(0, 0))])


@scene
def weld() -> mbd.Mechanism:
    a, b = bar("a", 0.8, (0.4, 0, 0)), bar("b", 0.6, (0.8, 0.3, np.pi / 2))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), a.at(-0.4, 0))
    return mbd.Mechanism(bodies=[a, b], joints=[pin, mbd.Weld("weld", a.at(0.4, 0), b.at(-0.3, 0, -np.pi / 2))])


@scene
def distance() -> mbd.Mechanism:
    a, b = bar("a", 0.7, (0.2, 0.3, 1.0)), bar("b", 0.7, (1.4, 0.3, 1.9))
    pins = [mbd.Revolute(f"pin {body.name}", mbd.ground.at(x, 0), body.at(-0.35, 0)) for body, x in ((a, 0), (b, 1.5))]
    link = mbd.Distance("rod", a.at(0.35, 0), b.at(0.35, 0), 0.9)
    return mbd.Mechanism(bodies=[a, b], joints=[*pins, link])


@scene
def point_on_line() -> mbd.Mechanism:
    a, b = bar("a", 1.4, (0.6, 0.25, 0.4), 0.1), bar("b", 0.5, (0.8, 0.05, 1.2))
    pins = [
        mbd.Revolute("pin a", mbd.ground.at(0, 0), a.at(-0.6, 0)),
        mbd.Revolute("pin b", mbd.ground.at(0.75, -0.15), b.at(-0.25, 0)),
    ]
    return mbd.Mechanism(bodies=[a, b], joints=[*pins, mbd.PointOnLine("slot", a.at(0, 0), b.at(0.25, 0))])


@scene
def absolute() -> mbd.Mechanism:
    a = bar("a", 1.2, (0.5, 0.4, 0.3))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0.22), a.at(-0.55, 0))
    return mbd.Mechanism(bodies=[a], joints=[pin, mbd.AbsoluteY("height", a.at(0.55, 0), 0.55)])


@scene
def knife_edge() -> mbd.Mechanism:
    sledge = box("sledge", (0, 0, 0.3), 0.7, 0.3)
    return mbd.Mechanism(bodies=[sledge], joints=[mbd.KnifeEdge("blade", sledge.at(-0.2, 0))])


@scene
def gear() -> mbd.Mechanism:
    a, b = disc("a", 0.3, (0, 0, 0)), disc("b", 0.18, (0.48, 0, 0))
    pins = [mbd.Revolute(f"pin {x.name}", mbd.ground.at(c, 0), x.at(0, 0)) for x, c in ((a, 0.0), (b, 0.48))]
    return mbd.Mechanism(bodies=[a, b], joints=[*pins, mbd.Gear("mesh", a.at(0, 0), b.at(0, 0), 0.3, 0.18)])


@scene
def backlash() -> mbd.Mechanism:
    a, b = disc("a", 0.3, (0, 0, 0)), disc("b", 0.18, (0.48, 0, 0.12))
    pins = [mbd.Revolute(f"pin {x.name}", mbd.ground.at(c, 0), x.at(0, 0)) for x, c in ((a, 0.0), (b, 0.48))]
    mesh = mbd.Gear("mesh", a.at(0, 0), b.at(0, 0), 0.3, 0.18)
    teeth = mbd.Backlash("teeth", mesh, 0.04, mbd.HuntCrossley(1e6, exponent=1))
    return mbd.Mechanism(bodies=[a, b], joints=pins, forces=[teeth])


@scene
def clearance() -> mbd.Mechanism:
    rod = bar("rod", 0.5, (0.358, -0.076, -0.1), 0.12)
    pin, bore = mbd.Circle(rod.at(-0.36, 0), 0.12), mbd.HollowCircle(mbd.ground.at(0, 0), 0.16)
    return mbd.Mechanism([rod], forces=[mbd.Contact("bearing", pin, bore, mbd.HuntCrossley(1e6))])


@scene
def elastic_belt() -> mbd.Mechanism:
    arm, wheel = bar("arm", 0.8, (0.4, -0.06, -0.15)), disc("wheel", 0.2, (0.79, -0.12, 0.4))
    joints = [
        mbd.Revolute("pivot", mbd.ground.at(0, 0), arm.at(-0.4, 0)),
        mbd.Revolute("axle", arm.at(0.4, 0), wheel.at(0, 0)),
    ]
    sprocket = disc("sprocket", 0.08, (0.12, 0.1, 0))
    joints.append(mbd.Revolute("shaft", mbd.ground.at(0.12, 0.1), sprocket.at(0, 0)))
    chain = mbd.ElasticBelt("chain", sprocket.at(0, 0), wheel.at(0, 0), 0.08, 0.2, 1e5, carrier=arm)
    return mbd.Mechanism([arm, wheel, sprocket], joints, forces=[chain])


@scene
def rack() -> mbd.Mechanism:
    pinion, bar_ = disc("pinion", 0.25, (0, 0.25, 0)), mbd.Body("rack", 1.0, 0.1, pose=(0.1, 0, 0))
    joints = [
        mbd.Revolute("pin", mbd.ground.at(0, 0.25), pinion.at(0, 0)),
        mbd.Translational("guide", mbd.ground.at(-0.3, 0), bar_.at(0, 0)),
        mbd.RackAndPinion("teeth", bar_.at(0, 0), pinion.at(0, 0), 0.25),
    ]
    return mbd.Mechanism(bodies=[pinion, bar_], joints=joints)


@scene
def belt() -> mbd.Mechanism:
    a, b = disc("a", 0.3, (0, 0, 0)), disc("b", 0.15, (0.9, 0, 0))
    pins = [mbd.Revolute(f"pin {x.name}", mbd.ground.at(c, 0), x.at(0, 0)) for x, c in ((a, 0.0), (b, 0.9))]
    return mbd.Mechanism(bodies=[a, b], joints=[*pins, mbd.Belt("belt", a.at(0, 0), b.at(0, 0), 0.3, 0.15)])


@scene
def free_wheel() -> mbd.Mechanism:
    hub, sprocket = disc("hub", 0.3, (0, 0, 0)), disc("sprocket", 0.15, (0, 0, 0))
    pins = [mbd.Revolute(f"pin {x.name}", mbd.ground.at(0, 0), x.at(0, 0)) for x in (hub, sprocket)]
    return mbd.Mechanism(bodies=[hub, sprocket], joints=[*pins, mbd.OneWayClutch("free wheel", sprocket, hub)])


@scene
def rolling() -> mbd.Mechanism:
    wheel = disc("wheel", 0.3, (0, 0.3, 0.5))
    return mbd.Mechanism(bodies=[wheel], joints=[mbd.Rolling("road", wheel.at(0, 0), mbd.ground.at(0, 0), 0.3)])


def egg() -> mbd.CamOutline:
    """An outline with a nose."""
    return mbd.CamOutline(lambda angle: 0.03 + 0.012 * ((1 + mbd.cos(angle)) / 2) ** 3)


@scene
def cam_flat() -> mbd.Mechanism:
    cam, lifter = mbd.Body("cam", 1.0, 1e-3, pose=(0, 0, 0.9)), mbd.Body("tappet", 1.0, 1e-3, pose=(0, 0.036, 0))
    joints = [
        mbd.Revolute("shaft", mbd.ground.at(0, 0), cam.at(0, 0)),
        mbd.Translational("guide", mbd.ground.at(0, 0.07, np.pi / 2), lifter.at(0, 0.03, np.pi / 2)),
        mbd.CamFlatFollower("contact", cam.at(0, 0), lifter.at(0, 0), egg()),
    ]
    return mbd.Mechanism(bodies=[cam, lifter], joints=joints)


@scene
def cam_roller() -> mbd.Mechanism:
    cam, lifter = mbd.Body("cam", 1.0, 1e-3, pose=(0, 0, 0.9)), mbd.Body("lifter", 1.0, 1e-3, pose=(0, 0.044, 0))
    joints = [
        mbd.Revolute("shaft", mbd.ground.at(0, 0), cam.at(0, 0)),
        mbd.Translational("guide", mbd.ground.at(0, 0.08, np.pi / 2), lifter.at(0, 0.03, np.pi / 2)),
        mbd.CamPointFollower("contact", cam.at(0, 0), lifter.at(0, 0), egg(), roller_radius=0.01),
    ]
    return mbd.Mechanism(bodies=[cam, lifter], joints=joints)


@scene
def cam_cam() -> mbd.Mechanism:
    a, b = mbd.Body("a", 1.0, 1e-3, pose=(0, 0, 0.4)), mbd.Body("b", 1.0, 1e-3, pose=(0.066, 0, 2.5))
    joints = [
        mbd.Revolute("shaft a", mbd.ground.at(0, 0), a.at(0, 0)),
        mbd.Revolute("shaft b", mbd.ground.at(0.066, 0), b.at(0, 0)),
        mbd.CamCam("contact", a.at(0, 0), b.at(0, 0), egg(), egg()),
    ]
    return mbd.Mechanism(bodies=[a, b], joints=joints)


@scene
def point_on_curve() -> mbd.Trajectory:
    b = bar("b", 0.5, (-0.15, 0.2, 0.6), 0.06)
    curve = mbd.Curve(lambda s: (s, 0.8 * s**2), -0.4, 0.4)
    joints = [
        mbd.PointOnCurve("slot", mbd.ground.at(0, 0), b.at(-0.2, 0), curve),
        mbd.AbsoluteAngle("level", b.at(0, 0), 0.6),
    ]
    slides = mbd.Mechanism(bodies=[b], joints=joints)
    return mbd.simulate(slides, duration=0.9, initial=[b.at(-0.2, 0).x == -0.35, b.vx == 0.75])


@scene
def rolling_on_curve() -> mbd.Trajectory:
    wheel = mbd.Body("wheel", 1.0, 5e-3, pose=(-0.38, 0.28, 0.3))
    road = mbd.Curve(lambda s: (s, 0.8 * s**2), -0.6, 0.6)
    rolls = mbd.Mechanism([wheel], [mbd.RollingOnCurve("road", wheel.at(0, 0), mbd.ground.at(0, 0), road, 0.1)])
    return mbd.simulate(rolls, duration=1.0, initial=[wheel.x == -0.35, wheel.vx == 0.7])


@scene
def driver() -> mbd.Mechanism:
    crank = bar("crank", 1.0, (0.4, 0.25, 0.6))
    main = mbd.Revolute("main", mbd.ground.at(0, 0), crank.at(-0.45, 0))
    return mbd.Mechanism(bodies=[crank], joints=[main], drivers=[mbd.Driver("speed", main.angle, 0.6 + 20 * mbd.t)])


@scene
def actuator() -> mbd.Trajectory:
    boom = bar("boom", 1.2, (0.55, 0.2, 0.3))
    pin = mbd.Revolute("foot", mbd.ground.at(0, 0), boom.at(-0.55, 0))
    jack = mbd.Actuator("jack", mbd.ground.at(0.35, -0.5), boom.at(0.1, 0), 0.65 + 0.3 * mbd.step(mbd.t, 0, 0, 1, 1))
    lifts = mbd.Mechanism(bodies=[boom], joints=[pin], drivers=[jack])
    return mbd.kinematics(lifts, np.linspace(0, 1, 21))


@scene
def force() -> mbd.Mechanism:
    a = bar("a", 1.2, (0.5, 0.15, 0.3))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), a.at(-0.55, 0))
    forces = [mbd.Force("push", a.at(0.55, 0), (3, 6)), mbd.Torque("motor", a, 2.0)]
    return mbd.Mechanism(bodies=[a], joints=[pin], forces=forces)


@scene
def mass_flow() -> mbd.Mechanism:
    fuel = mbd.StateVariable("fuel", 60.0)
    rocket = mbd.Body("rocket", 40.0 + fuel, 10.0, pose=(0, 0.5, -0.3), shape=mbd.Rectangle(0.14, 0.7))
    jet = mbd.MassFlow("jet", rocket.at(0, -0.35), rate=-2.0, velocity=(0, -2500.0))
    return mbd.Mechanism([rocket], forces=[jet], states={fuel: -2.0})


@scene
def wheel() -> mbd.Trajectory:
    axle = mbd.Body("axle", 20.0, 0.5, pose=(0, 0.318, 0.3))
    tyre = mbd.HuntCrossley(2e4, exponent=1, damping=0.2)
    road = mbd.Wheel("tyre", axle.at(0, 0), mbd.ground.at(0, 0), lambda x: 0.04 * mbd.cos(6 * x), 0.3, tyre)
    drives = [mbd.Driver("speed", axle.x, 1.2 * mbd.t), mbd.Driver("turn", axle.phi, 0.3 - 4 * mbd.t)]
    return mbd.simulate(mbd.Mechanism([axle], drivers=drives, forces=[mbd.Gravity(), road]), duration=0.8)


@scene
def tsda() -> mbd.Mechanism:
    block = box("b", (0.9, 0, 0))
    spring = mbd.TSDA("spring", mbd.ground.at(0, 0), block.at(-0.15, 0), stiffness=100, free_length=0.7, damping=3)
    return mbd.Mechanism(
        bodies=[block], joints=[mbd.Translational("guide", mbd.ground.at(0.9, 0), block.at(0, 0))], forces=[spring]
    )


@scene
def rsda() -> mbd.Mechanism:
    arm = bar("b", 1.0, (0.4, 0.2, 0.5))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), arm.at(-0.45, 0))
    spring = mbd.RSDA("spring", mbd.ground.at(0, 0), arm.at(-0.45, 0), stiffness=10)
    return mbd.Mechanism(bodies=[arm], joints=[pin], forces=[spring])


@scene
def bushing() -> mbd.Mechanism:
    a, b = bar("a", 0.8, (0.4, 0, 0)), bar("b", 0.8, (1.23, 0.02, 0.1))
    pin = mbd.Weld("foot", mbd.ground.at(0, 0), a.at(-0.4, 0))
    rubber = mbd.Bushing("rubber", a.at(0.4, 0), b.at(-0.4, 0), stiffness=1e4, damping=10, angular_stiffness=20)
    return mbd.Mechanism(bodies=[a, b], joints=[pin], forces=[rubber])


@scene
def end_stop() -> mbd.Mechanism:
    block = box("b", (0.5, 0, 0))
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    stop = mbd.EndStop("stop", 0.7 - guide.displacement, mbd.HuntCrossley(1e5, exponent=1))
    return mbd.Mechanism(bodies=[block], joints=[guide], forces=[stop])


@scene
def rope() -> mbd.Mechanism:
    block = box("b", (0.5, -0.5, 0.4))
    return mbd.Mechanism(bodies=[block], forces=[mbd.Rope("rope", mbd.ground.at(0, 0), block.at(-0.1, 0.05), 0.6, 1e4)])


@scene
def tackle() -> mbd.Mechanism:
    load, hand = box("load", (0, -0.9, 0), 0.2, 0.14), box("hand", (0.4, -0.5, 0), 0.14, 0.2)
    wheel = mbd.Body("wheel", 1.0, 0.01, pose=(0.25, 0, 0))
    up = np.pi / 2
    over = [
        mbd.Pulley(load.at(0, 0.15), 0.1, "counter-clockwise"),
        mbd.Pulley(wheel.at(0, 0), 0.15, "clockwise", grips=True),
    ]
    joints = [
        mbd.Revolute("axle", mbd.ground.at(0.25, 0), wheel.at(0, 0)),
        mbd.Translational("guide", mbd.ground.at(0, 0, up), load.at(0, 0, up)),
        mbd.Translational("guide of hand", mbd.ground.at(0.4, 0, up), hand.at(0, 0, up)),
        mbd.Cable("cable", mbd.ground.at(-0.1, 0), hand.at(0, 0.1), over),
    ]
    return mbd.Mechanism(bodies=[load, hand, wheel], joints=joints)


@scene
def cylinder() -> mbd.Mechanism:
    arm = bar("boom", 1.2, (0.5, 0.3, 0.5))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), arm.at(-0.6, 0))
    jack = mbd.Cylinder("jack", mbd.ground.at(0.7, -0.3), arm.at(0.3, 0), bore=0.05, rod=0.03, pressure=1e6)
    return mbd.Mechanism(bodies=[arm], joints=[pin], forces=[jack])


@scene
def joint_friction() -> mbd.Mechanism:
    rod = bar("rod", 1.0, (0.2, -0.4, -1.0))
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), rod.at(-0.45, 0))
    bush = mbd.JointFriction("bush", hinge, mbd.Coulomb(0.3, 1e-4), radius=0.02)
    return mbd.Mechanism(bodies=[rod], joints=[hinge], forces=[mbd.Gravity(), bush])


@scene
def contact() -> mbd.Mechanism:
    ball = disc("ball", 0.2, (0, 0.3, 0.3))
    floor = mbd.Contact(
        "floor", mbd.Circle(ball.at(0, 0), 0.2), mbd.HalfPlane(mbd.ground.at(0, 0)), mbd.HuntCrossley(1e5)
    )
    return mbd.Mechanism(bodies=[ball], forces=[floor])


@scene
def ratchet() -> mbd.Mechanism:
    around = np.arange(12) * np.pi / 6
    tips = np.column_stack([np.cos(around), np.sin(around)])
    wheel = mbd.Body("wheel", 1.0, 0.1, pose=(0, 0, 0.12))
    teeth = mbd.PolygonEdges(wheel.at(0, 0), np.column_stack([0.25 * tips, 0.3 * tips]).reshape(-1, 2))
    pawl = mbd.Body("pawl", 0.1, 1e-3, pose=(0.370, 0.099, 2.833))
    pins = [
        mbd.Revolute("axle", mbd.ground.at(0, 0), wheel.at(0, 0)),
        mbd.Revolute("pivot", mbd.ground.at(0.522, 0.051), pawl.at(-0.1595, 0)),
    ]
    tip = mbd.Segment(pawl.at(0, 0), 0.319, radius=0.01)
    return mbd.Mechanism([wheel, pawl], pins, forces=[mbd.Contact("tooth", tip, teeth, mbd.HuntCrossley(1e5))])


def friction_laws() -> Figure:
    """Force over sliding speed, under unit load; the bristles of LuGre in steady sliding."""
    figure = Figure(figsize=(6.4, 2.8), layout="constrained")
    axes = figure.subplots()
    speed = np.linspace(-0.05, 0.05, 801)
    peak = 0.3 + 0.1 * np.exp(-((speed / 0.01) ** 2))
    axes.plot(speed, -0.3 * np.sign(speed), color="#5b6770", linestyle="--", label="exact")
    axes.plot(speed, -0.3 * np.tanh(speed / 1e-3), color="#1f5fa8", label="Coulomb")
    axes.plot(speed, -peak * np.tanh(speed / 1e-3), color="#d1495b", label="Stribeck; LuGre in steady sliding")
    axes.plot(speed, -4 * speed, color="#2e8b6f", label="Viscous")
    axes.set_xlabel("sliding speed, m/s")
    axes.set_ylabel("force / load")
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False, fontsize="small")
    return figure


def draw(name: str) -> Figure:
    """Draw the picture of a name."""
    if name == "friction_laws":
        return friction_laws()
    figure = Figure(figsize=SIZE, layout="constrained")
    axes = figure.subplots()
    axes.set_axis_off()  # before names are placed, since the drawing has the room of the axes
    mbd.draw(SCENES[name](), axes, names=True)
    if name == "end_stop":
        axes.annotate("", (0.85, 0), (0.65, 0), arrowprops={"arrowstyle": "<->", "color": "#444b52"})
        axes.text(0.75, 0.02, "gap", ha="center", size="small")
    return figure


def save(name: str, folder: Path) -> None:
    """Write the picture of a name."""
    draw(name).savefig(folder / f"{name}.png", dpi=DPI, bbox_inches="tight", pad_inches=0.05)


if __name__ == "__main__":
    TARGET.mkdir(parents=True, exist_ok=True)
    for name in sys.argv[1:] or [*SCENES, "friction_laws"]:
        save(name, TARGET)
