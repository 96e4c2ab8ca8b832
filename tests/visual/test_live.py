"""A page that solves a mechanism: the same motion as ``simulate``, sliders, the pointer, and what it refuses.

Needs the extra ``browser`` and a Chromium, as ``test_browser``; the refusals do not.
"""

import re

import casadi as ca
import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.printing.javascript import to_javascript
from mbdcasadi.visual.drawing.style import LIGHT

WINDOW = {"width": 1280, "height": 800}
library = mbd.library


@pytest.fixture
def opened(open_offline, tmp_path):
    """Opens the page of a mechanism with the network off."""

    def open_page(mechanism, **options):
        path = tmp_path / f"page{len(list(tmp_path.iterdir()))}.html"
        mbd.animate(mechanism, path, live=True, **options)
        assert path.stat().st_size <= 1_000_000
        tab = open_offline(path, WINDOW)
        tab.wait_for_function("window.mechanism && window.mechanism.live")
        return tab

    return open_page


def solved(tab, seconds=2.0):
    """State of the page after some seconds of solution."""
    tab.evaluate("seconds => mechanism.run(seconds)", seconds)
    state = tab.evaluate("mechanism.state()")
    return {name: np.array(value) for name, value in state.items()}


def agree(found, state, tolerance=1e-6):
    """Compare a state of a page with one of the package, relative to the largest value of its kind."""
    for name in ("q", "v", "z", "a", "lam"):
        expected = getattr(state, name)
        # what follows from the second derivatives multiplies errors of the motion
        share = tolerance if name in "qvz" else 10 * tolerance
        allowed = share * max(1.0, np.max(np.abs(expected), initial=0.0))
        np.testing.assert_allclose(found[name], expected, rtol=0, atol=allowed, err_msg=name)


# --- the motion is that of simulate ---------------------------------------------------------------
def four_bar():
    model = library.four_bar()
    return model.mechanism, [model.crank.omega == 5]


def slider_crank():
    model = library.slider_crank()
    return model.mechanism, [model.crank.omega == 10]


def five_bar():
    return library.five_bar().mechanism, []


def planetary_gear():
    model = library.planetary_gear(planets=3)
    return model.mechanism, [model.mechanism.bodies[0].omega == 4]


def cam_follower():
    model = library.cam_follower(lambda angle: 0.005 * (1 - mbd.cos(angle)), stiffness=500, preload=20)
    return model.mechanism, [model.cam.omega == 8]


def double_pendulum():
    model = library.pendulum_chain(2)
    first, second = model.mechanism.bodies
    return model.mechanism, [first.omega == 3, second.omega == -2]


def long_chain():
    model = library.pendulum_chain(10)
    return model.mechanism, [model.mechanism.bodies[-1].omega == 4]


def quick_return():
    model = library.quick_return()
    return model.mechanism, [model.crank.omega == 5]


def scotch_yoke():
    return library.scotch_yoke().mechanism, []


def jansen():
    model = library.jansen()
    return model.mechanism, [model.mechanism.bodies[0].omega == 2]


def parallelogram():
    """Three parallel cranks: two rows more than are needed."""
    bar = mbd.Body("bar", 2.0, 0.2, pose=(0.5, 0.3, 0))
    cranks = [mbd.Body(f"crank {k}", 0.3, 0.004, pose=(0.5 * k, 0.15, np.pi / 2)) for k in range(3)]
    joints = []
    for k, crank in enumerate(cranks):
        joints.append(mbd.Revolute(f"foot {k}", mbd.ground.at(0.5 * k, 0), crank.at(-0.15, 0)))
        joints.append(mbd.Revolute(f"head {k}", crank.at(0.15, 0), bar.at(0.5 * k - 0.5, 0)))
    return mbd.Mechanism([bar, *cranks], joints=joints, forces=[mbd.Gravity()]), [cranks[0].omega == 1]


def point_mass():
    """A mass without inertia on a rod."""
    bob = mbd.Body("bob", 1.5, 0.0, pose=(0.8, 0, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), bob.at(-0.8, 0))
    return mbd.Mechanism([bob], joints=[pin], forces=[mbd.Gravity()]), [bob.phi == 0.3]


def driven():
    model = library.slider_crank()
    return model.driven(crank=0.3 + 3 * mbd.t), []


def servo():
    command, place, speed = mbd.Input("command", 0.4), mbd.StateVariable("place", 0.2), mbd.StateVariable("speed")
    trolley = mbd.Body("trolley", mass=5.0, inertia=1.0)
    bob = mbd.Body("bob", mass=2.0, inertia=0.1, pose=(0, -1, 0))
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), trolley.at(0, 0))
    pivot = mbd.Revolute("pivot", trolley.at(0, 0), bob.at(0, 1))
    states = {place: speed, speed: command - 2 * speed}
    drive = mbd.Driver("drive", trolley.x, place)
    start = [trolley.x == 0.3, trolley.vx == 0, bob.phi == 0.1, bob.omega == 0]
    return mbd.Mechanism([trolley, bob], [rail, pivot], [drive], [mbd.Gravity()], [command], states=states), start


def skate():
    """A velocity-level constraint, and a force that begins at a time."""
    blade = mbd.Body("blade", 1.0, 0.2, velocity=(1.0, 0, 0))
    side = -mbd.sin(blade.phi) * blade.vx + mbd.cos(blade.phi) * blade.vy
    push = mbd.Torque("push", blade, mbd.if_else(mbd.t > 1 / 3, 0.5, 0.0))
    return mbd.Mechanism([blade], joints=[mbd.NonholonomicConstraint("edge", side)], forces=[push]), [blade.vx == 1]


def motor():
    """A first-order state: the current of a motor."""
    arm = mbd.Body("arm", 1.0, 0.1, pose=(0.3, 0, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), arm.at(-0.3, 0))
    current = mbd.StateVariable("current")
    drive = mbd.Torque("drive", arm, 0.8 * current)
    rate = {current: (12.0 - 2 * current - 0.8 * arm.omega) / 0.01}
    return mbd.Mechanism([arm], joints=[pin], forces=[mbd.Gravity(), drive], states=rate), []


def rubbing():
    """Friction in a guide that depends on its reaction."""
    model = library.slider_crank()
    rub = mbd.JointFriction("rub", model.mechanism.joint("guide"), mbd.Coulomb(0.2, 1e-3))
    return model.mechanism.replace(forces=[*model.mechanism.forces, rub]), [model.crank.omega == 10]


def between_stops():
    """A block that goes to and fro between two elastic stops, and a shaft whose key has play."""
    block = mbd.Body("block", mass=1.0, inertia=0.1)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    law = mbd.HuntCrossley(1e4, damping=0.5)
    stops = [mbd.EndStop("right", 0.3 - block.x, law), mbd.EndStop("left", 0.3 + block.x, law)]
    shaft = mbd.Body("shaft", mass=1.0, inertia=0.1, pose=(0, 1, 0))
    bearing = mbd.Revolute("bearing", mbd.ground.at(0, 1), shaft.at(0, 0))
    key = mbd.Coupler("key", mbd.ground.at(0, 1), shaft.at(0, 0), 1.0)
    forces = [*stops, mbd.Backlash("play", key, 0.4, mbd.HuntCrossley(50, damping=0.5))]
    return mbd.Mechanism([block, shaft], joints=[guide, bearing], forces=forces), [block.vx == 1, shaft.omega == 2]


def roped():
    """A cable turns a wheel, on whose hub an elastic rope winds up, and which an elastic belt holds back."""
    wheel = mbd.Body("wheel", 1.0, 0.01)
    axle = mbd.Revolute("axle", mbd.ground.at(0, 0), wheel.at(0, 0))
    loads = [
        mbd.Body(name, m, 1.0, pose=(x, -1, 0)) for name, m, x in (("a", 1.5, -0.1), ("b", 1, 0.1), ("c", 1, 0.05))
    ]
    up = np.pi / 2
    guides = [
        mbd.Translational(f"{b.name} up", mbd.ground.at(b.pose_estimate[0], 0, up), b.at(0, 0, up)) for b in loads
    ]
    a, b, c = (load.at(0, 0) for load in loads)
    cable = mbd.Cable("cable", a, b, over=[mbd.Pulley(wheel.at(0, 0), 0.1, "clockwise", grips=True)])
    rope = mbd.Rope("rope", mbd.Drum(wheel.at(0, 0), 0.05, "clockwise"), c, 1.0, 1e3, 5.0)
    belt = mbd.ElasticBelt("belt", mbd.ground.at(0.5, 0), wheel.at(0, 0), 0.05, 0.08, 200.0, 10.0, 2.0)
    return mbd.Mechanism([wheel, *loads], joints=[axle, *guides, cable], forces=[mbd.Gravity(), rope, belt]), []


def valley():
    """A wheel that rolls in a valley on a cart that sand falls into, and one with a tyre on a wavy road."""
    sand = mbd.StateVariable("sand")
    cart = mbd.Body("cart", mass=3.0 + sand, inertia=1.0)
    wheel = mbd.Body("wheel", mass=2.0, inertia=0.01, pose=(-0.4, 0.35, 0))
    axle = mbd.Body("axle", mass=10.0, inertia=0.5, pose=(2.0, 0.25, 0))
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0))
    road = mbd.Curve(lambda s: (s, s**2), -1, 1)
    rolls = mbd.RollingOnCurve("road", wheel.at(0, 0), cart.at(0, 0), road, 0.1)
    tyre = mbd.HuntCrossley(2e3, exponent=1)
    waves = mbd.Wheel("tyre", axle.at(0, 0), mbd.ground.at(0, 0), lambda x: 0.02 * mbd.sin(x), 0.3, tyre)
    hopper = mbd.MassFlow("hopper", cart.at(0, 0), 0.5, (-cart.vx, 0), frame="global")
    forces = [mbd.Gravity(), waves, hopper]
    return mbd.Mechanism([cart, wheel, axle], joints=[rail, rolls], forces=forces, states={sand: 0.5}), [axle.vx == 1]


MECHANISMS = [
    four_bar, slider_crank, five_bar, planetary_gear, cam_follower, double_pendulum, long_chain, quick_return,
    scotch_yoke, jansen, parallelogram, point_mass, driven, skate, motor, rubbing, between_stops, roped,
    valley, servo,
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("example", MECHANISMS, ids=lambda example: example.__name__)
def test_a_page_moves_as_simulate_says(opened, example):
    """Over two seconds, with accelerations and multipliers, and on the constraints all the time."""
    mechanism, start = example()
    found = solved(tab := opened(mechanism, initial=start))
    # chaotic motions multiply the errors of a method of low order
    options = {"method": "erk"} if example in (five_bar, double_pendulum, long_chain) else {}
    motion = mbd.simulate(mechanism, [0, 1, 2], initial=start, reltol=1e-11, abstol=1e-11, **options)
    agree(found, motion.final)
    assert tab.evaluate("mechanism.violation()") <= 1e-9
    assert tab.evaluate("mechanism.time") == 2.0
    assert np.max(np.abs(motion.final.q - motion.initial.q)) > 1e-2  # it did move


@pytest.mark.filterwarnings("ignore::mbdcasadi.MechanismWarning")
def test_what_is_stiff_is_integrated_implicitly(opened):
    """A damper whose time constant is a ten-thousandth of the motion."""
    block = mbd.Body("block", mass=0.01, inertia=0.1)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    law = mbd.TSDA("strut", mbd.ground.at(-1, 0), block.at(0, 0), stiffness=200, free_length=0.5, damping=200)
    mechanism = mbd.Mechanism([block], joints=[guide], forces=[law])
    tab = opened(mechanism, initial=[block.x == 0.4])
    agree(solved(tab), mbd.simulate(mechanism, [0, 2], initial=[block.x == 0.4], reltol=1e-10, abstol=1e-10).final)
    effort = tab.evaluate("mechanism.effort")
    assert effort["stiff"] and effort["steps"] < 3000


def test_a_bouncing_ball_touches_as_simulate_says(opened):
    """Contacts that last for a hundredth of a second: the page must not jump over them."""
    ball = mbd.Body("ball", 1, 1e-3, pose=(0, 0.5, 0))
    law = mbd.HuntCrossley(1e5, damping=0.2)
    floor = mbd.Contact("floor", mbd.Circle(ball.at(0, 0), 0.05), mbd.HalfPlane(mbd.ground.at(0, 0)), law)
    mechanism = mbd.Mechanism([ball], forces=[mbd.Gravity(), floor])
    found = solved(opened(mechanism))
    motion = mbd.simulate(mechanism, [0, 2], reltol=1e-12, abstol=1e-12)
    np.testing.assert_allclose(found["q"], motion.final.q, atol=5e-6)


# --- sliders --------------------------------------------------------------------------------------
def adjustable():
    """A four-bar with a length, a damping and a torque that change."""
    length = mbd.Parameter("rocker length", 0.24, lower=0.10, upper=0.60)
    damping = mbd.Parameter("damping", 0.02, lower=0.0, upper=0.2)
    torque = mbd.Input("torque", 0.0, lower=-2.0, upper=2.0)
    crank = mbd.Body("crank", mass=0.3, inertia=3e-4, pose=(0.04, 0.02, 0.5))
    coupler = mbd.Body("coupler", mass=0.8, inertia=5e-3, pose=(0.19, 0.14, 0.7))
    rocker = mbd.Body("rocker", mass=0.7, inertia=4e-3, pose=(0.30, 0.12, 1.6))
    joints = [
        mbd.Revolute("O2", mbd.ground.at(0, 0), crank.at(-0.05, 0)),
        mbd.Revolute("A", crank.at(0.05, 0), coupler.at(-0.14, 0)),
        mbd.Revolute("B", coupler.at(0.14, 0), rocker.at(length / 2, 0)),
        mbd.Revolute("O4", mbd.ground.at(0.3, 0), rocker.at(-length / 2, 0)),
    ]
    damper = mbd.RSDA("bearing", mbd.ground.at(0, 0), crank.at(-0.05, 0), damping=damping)
    forces = [mbd.Gravity(), damper, mbd.Torque("motor", crank, torque)]
    mechanism = mbd.Mechanism(
        [crank, coupler, rocker], joints=joints, forces=forces, inputs=[torque], parameters=[length, damping]
    )
    return mechanism, [joints[0].angle == 0.5, crank.omega == 6], (length, damping, torque)


def test_sliders_change_what_is_solved(opened):
    """Values before the start assemble it anew; later ones change what is going on, on the constraints."""
    mechanism, start, (length, damping, torque) = adjustable()
    tab = opened(mechanism, initial=start)
    assert tab.locator("#values input[type=range]").count() == 3
    tab.evaluate("mechanism.set('damping', 0.1); mechanism.set('torque', 0.5)")
    assert tab.evaluate("mechanism.set('rocker length', 0.21)") == 0.21
    values = {"parameters": {length: 0.21, damping: 0.1}, "inputs": {torque: 0.5}}
    exact = {"reltol": 1e-11, "abstol": 1e-11}
    agree(solved(tab, 1.0), mbd.simulate(mechanism, [0, 1], initial=start, **values, **exact).final)
    # while it moves: the nearest pose and velocity, and on from there
    tab.evaluate("mechanism.set('rocker length', 0.23)")
    changed = tab.evaluate("mechanism.state()")
    assert tab.evaluate("mechanism.violation()") <= 1e-9 and changed["t"] == 1.0
    values["parameters"][length] = 0.23
    state = mbd.assemble(mechanism, **values)
    q, v = np.array(changed["q"]), np.array(changed["v"])
    conditions = [mechanism.joint("O2").angle == q[2], mechanism.bodies[0].omega == v[2]]
    state = mbd.assemble(mechanism, conditions, **values)
    np.testing.assert_allclose(state.q, q, atol=1e-8)
    np.testing.assert_allclose(state.v, v, atol=1e-7)
    # back at the start, the values stay
    tab.evaluate("mechanism.reset()")
    assert tab.evaluate("mechanism.values()") == {"rocker length": 0.23, "damping": 0.1, "torque": 0.5}
    agree(solved(tab, 1.0), mbd.simulate(mechanism, [0, 1], initial=start, **values, **exact).final)


@pytest.mark.slow
def test_a_length_that_cannot_be_reached_is_shown_and_not_jumped_over(opened):
    """The rocker becomes longer until the linkage is stretched; there it stays, assembled."""
    mechanism, start, (length, _, _) = adjustable()
    tab = opened(mechanism, initial=start)
    slider = tab.locator("#values input[aria-label='rocker length']")
    slider.evaluate("field => { field.value = 0.6; field.dispatchEvent(new Event('input')); }")
    reached = tab.evaluate("mechanism.values()")["rocker length"]
    # the crank is held at its angle: coupler and rocker can span the distance of A and O4 in a line at most
    longest = 0.28 + np.hypot(0.3 - 0.1 * np.cos(0.5), 0.1 * np.sin(0.5))
    assert longest - 1e-3 < reached <= longest and tab.evaluate("mechanism.violation()") <= 1e-9
    assert "cannot be reached" in tab.locator("#notice").text_content() and tab.locator("#notice").is_visible()
    with pytest.raises(mbd.MechanismError):
        mbd.assemble(mechanism, start[:1], parameters={length: longest + 1e-3})
    assert float(slider.input_value()) == pytest.approx(reached)
    # the drawing follows the length: bars are as long as the pins are apart
    places = {name: np.array(tab.evaluate(f"mechanism.place('{name}')")) for name in ("O2", "O4", "B")}
    scale = np.hypot(*(places["O4"] - places["O2"])) / 0.3
    assert np.hypot(*(places["B"] - places["O4"])) / scale == pytest.approx(reached, rel=1e-3)


def test_a_mass_may_go_to_zero(opened):
    """The rod of a pendulum without mass: its joints must carry it."""
    mass = mbd.Parameter("rod", 1.0, lower=0.0, upper=2.0)
    rod = mbd.Body("rod", mass, mass / 12, pose=(0.5, 0, 0))
    bob = mbd.Body("bob", 1.0, 0.01, pose=(1, 0, 0))
    joints = [mbd.Revolute("pin", mbd.ground.at(0, 0), rod.at(-0.5, 0)), mbd.Weld("end", rod.at(0.5, 0), bob.at(0, 0))]
    mechanism = mbd.Mechanism([rod, bob], joints=joints, forces=[mbd.Gravity()], parameters=[mass])
    tab = opened(mechanism)
    for value in (0.0, 2.0):
        tab.evaluate(f"mechanism.reset(); mechanism.set('rod', {value})")
        tab.evaluate("mechanism.reset()")
        motion = mbd.simulate(mechanism, [0, 1], parameters={mass: value}, reltol=1e-11, abstol=1e-11)
        agree(solved(tab, 1.0), motion.final)


def test_a_start_that_is_a_state(opened):
    """As simulate takes it: pose and velocity of any time."""
    model = library.four_bar()
    state = mbd.simulate(model.mechanism, duration=0.4, initial=[model.crank.omega == 5]).final
    tab = opened(model.mechanism, initial=state)
    assert tab.evaluate("mechanism.time") == pytest.approx(0.4)
    agree(solved(tab, 1.0), mbd.simulate(model.mechanism, [0.4, 1.4], initial=state, reltol=1e-11, abstol=1e-11).final)


# --- the pointer ----------------------------------------------------------------------------------
def pulled(tab, name, by):
    """Pull at the middle of an item with the mouse."""
    corner = tab.locator("#stage").bounding_box()
    x, y = tab.evaluate(f"mechanism.place('{name}')")
    tab.mouse.move(corner["x"] + x, corner["y"] + y)
    tab.mouse.down()
    tab.mouse.move(corner["x"] + x + by[0], corner["y"] + y + by[1], steps=8)
    return np.array([x + by[0], y + by[1]])


def test_a_paused_linkage_follows_the_pointer(opened):
    """The middle of the crank comes as near to the pointer as its circle allows; time stands."""
    mechanism, start, _ = adjustable()
    tab = opened(mechanism, initial=start)
    before = tab.evaluate("mechanism.state()")
    target = pulled(tab, "crank", (-45, -45))
    tab.mouse.up()
    after = tab.evaluate("mechanism.state()")
    assert abs(after["q"][2] - before["q"][2]) > 0.3 and after["t"] == 0.0
    assert tab.evaluate("mechanism.violation()") <= 1e-9 and np.max(np.abs(after["v"])) < 1e-12
    # from the pin, pointer and crank lie in one direction
    pin = np.array(tab.evaluate("mechanism.place('O2')"))
    ways = [point - pin for point in (target, np.array(tab.evaluate("mechanism.place('crank')")))]
    angles = [np.arctan2(-y, x) for x, y in ways]
    assert angles[0] == pytest.approx(angles[1], abs=0.02)
    # it goes on from rest in that pose
    motion = mbd.simulate(
        mechanism, [0, 1], initial=mbd.assemble(mechanism, [mechanism.joint("O2").angle == after["q"][2]]),
        reltol=1e-11, abstol=1e-11,
    )  # fmt: skip
    agree(solved(tab, 1.0), motion.final)
    tab.evaluate("mechanism.reset()")
    np.testing.assert_allclose(tab.evaluate("mechanism.state().q"), before["q"], atol=1e-12)


RESTS = "(() => { const { q, v, a } = mechanism.state(); return q[0] > 1e-3 && Math.hypot(v[0], a[0]) < 1e-3; })()"


def test_a_running_mechanism_is_pulled_by_a_spring(opened):
    """A block on a guide comes to rest below the pointer, and no force is left when it is let go."""
    block = mbd.Body("block", mass=1.0, inertia=0.1)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    tab = opened(mbd.Mechanism([block], joints=[guide], forces=[mbd.Gravity()]))
    tab.evaluate("mechanism.play()")
    target = pulled(tab, "guide", (60, -30))
    tab.wait_for_function(RESTS, timeout=30_000)
    assert tab.evaluate("mechanism.place('guide')")[0] == pytest.approx(target[0], abs=1.5)
    tab.mouse.up()
    tab.evaluate("mechanism.pause()")
    assert tab.evaluate("mechanism.state().a") == pytest.approx([0, 0, 0], abs=1e-9)


def test_what_drivers_hold_is_dragged_along_its_time(opened):
    """The crank of a driven slider-crank by an angle: the time is that at which the driver is there."""
    mechanism, _ = driven()
    tab = opened(mechanism)
    pulled(tab, "crank", (-30, -60))
    tab.mouse.up()
    state = tab.evaluate("mechanism.state()")
    assert state["t"] > 0.1 and state["q"][2] == pytest.approx(0.3 + 3 * state["t"], abs=1e-9)
    assert tab.evaluate("mechanism.violation()") <= 1e-9


def test_what_joints_hold_stays(opened):
    """The page says so."""
    bar = mbd.Body("bar", 1.0, 0.1, pose=(0.5, 0, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), bar.at(-0.5, 0))
    stay = mbd.Distance("stay", mbd.ground.at(0.5, 1), bar.at(0, 0), 1)
    tab = opened(mbd.Mechanism([bar], joints=[pin, stay]))
    before = tab.evaluate("mechanism.state().q")
    pulled(tab, "bar", (0, -40))
    assert tab.evaluate("mechanism.state().q") == before
    assert "joints hold" in tab.locator("#notice").text_content()


# --- controls -------------------------------------------------------------------------------------
def test_it_plays_steps_and_plots(opened):
    """By button and keys; what is plotted is read from the solution."""
    mechanism, start, _ = adjustable()
    crank = mechanism.bodies[0]
    load = mbd.norm(mechanism.joint("B").reaction_on(mechanism.bodies[2]).force)
    tab = opened(mechanism, initial=start, plots={"crank, rad/s": crank.omega, "B, N": load}, trace=[crank.at(0.05, 0)])
    tab.click("#play")
    tab.wait_for_function("mechanism.time > 0.3")
    tab.click("#play")
    stopped = tab.evaluate("mechanism.time")
    tab.click("#step")
    assert tab.evaluate("mechanism.time") == pytest.approx(stopped + 1 / 30)
    state = mbd.simulate(
        mechanism, [0, tab.evaluate("mechanism.time")], initial=start, reltol=1e-10, abstol=1e-10
    ).final
    plotted = tab.evaluate(
        "[...Object.values(mechanism.plot('crank, rad/s')), ...Object.values(mechanism.plot('B, N'))]"
    )
    assert [line["value"] for line in plotted] == pytest.approx([state[crank.omega], state[load]], rel=1e-6)
    points = np.array(plotted[1]["points"])
    assert len(points) > 20 and points[-1, 0] <= stopped + 1 / 30
    motion = mbd.simulate(mechanism, [0, *points[5:20, 0]], initial=start, reltol=1e-10, abstol=1e-10)
    np.testing.assert_allclose(points[5:20, 1], motion[load][1:], rtol=1e-5)
    tab.locator("#stage").focus()
    tab.keyboard.press("r")
    assert tab.locator("#slider").input_value() == "0"
    assert tab.evaluate("mechanism.time") == 0 and len(tab.evaluate("mechanism.plot('B, N')")[""]["points"]) == 1


def test_a_drag_draws_the_path_that_is_followed(opened):
    """The pin of the crank on its circle, in pause too: no chord; the dot of the plot lies on its axes."""
    mechanism, start, _ = adjustable()
    crank = mechanism.bodies[0]
    tab = opened(mechanism, initial=start, trace=[crank.at(0.05, 0)], plots={"crank, rad": crank.phi})
    pulled(tab, "crank", (-90, -20))
    tab.mouse.up()
    (drawn,) = tab.evaluate("mechanism.traced()")
    points = np.array(drawn["points"])
    np.testing.assert_allclose(np.hypot(*points.T), 0.1, atol=1e-9)
    assert np.max(np.hypot(*np.diff(points, axis=0).T)) < 0.1 * 0.07 and np.ptp(points[:, 0]) > 0.03
    low, high = tab.evaluate("mechanism.range('crank, rad')")
    assert low < tab.evaluate("mechanism.state().q")[2] < high
    # the whole circle is there at once, as it has one freedom
    whole = np.array(drawn["whole"])
    np.testing.assert_allclose([whole.min(axis=0), whole.max(axis=0)], [[-0.1, -0.1], [0.1, 0.1]], atol=2e-4)


def test_a_slider_begins_a_new_stroke_and_the_past_is_shown_again(opened):
    """Back over what was run, the numbers are those of then; from there another future begins."""
    mechanism, start, _ = adjustable()
    tab = opened(mechanism, initial=start, plots={"crank, rad": mechanism.bodies[0].phi})
    tab.evaluate("mechanism.run(0.5)")
    tab.evaluate("mechanism.set('torque', 1.0)")
    tab.evaluate("mechanism.run(0.5)")
    tab.evaluate("mechanism.seek(0.25)")
    time = tab.evaluate("mechanism.time")
    assert time == pytest.approx(0.25, abs=0.01) and tab.evaluate("mechanism.values().torque") == 0.0
    agree({"t": time, **{k: np.array(v) for k, v in tab.evaluate("mechanism.state()").items()}},
          mbd.simulate(mechanism, [0, time], initial=start, reltol=1e-11, abstol=1e-11).final)  # fmt: skip
    tab.locator("#slider").fill("1")
    assert tab.evaluate("mechanism.time") == 1.0 and tab.evaluate("mechanism.values().torque") == 1.0
    tab.evaluate("mechanism.seek(0.25); mechanism.run(0.1)")
    points = np.array(tab.evaluate("mechanism.plot('crank, rad')")[""]["points"])
    assert points[-1, 0] == pytest.approx(time + 0.1) and np.all(np.diff(points[:, 0]) >= 0)


def test_a_plot_over_another_quantity(opened):
    """The rocker over the crank, in degrees."""
    mechanism, start, _ = adjustable()
    crank, _, rocker = mechanism.bodies
    tab = opened(mechanism, initial=start, plots={"rocker, rad": rocker.phi})
    tab.evaluate("mechanism.run(0.4)")
    tab.select_option(".plot select", label="crank: phi")
    points = np.array(tab.evaluate("mechanism.plot('rocker, rad')")[""]["points"])
    motion = mbd.simulate(mechanism, [0, 0.1, 0.2, 0.4], initial=start)
    for angle, other in zip(motion[crank.phi], motion[rocker.phi], strict=True):
        assert np.min(np.hypot(*(points - [angle, other]).T)) < 0.05
    tab.click("#degrees")
    tab.evaluate("mechanism.seek(0)")
    assert tab.evaluate("mechanism.shown('crank')")["phi, rad"] == f"{np.degrees(0.5):.1f} °"


def test_an_address_shows_what_is_set(opened, browser):
    """A link leads to the same values, pose, switches and plots."""
    mechanism, start, _ = adjustable()
    tab = opened(mechanism, initial=start, plots={"crank, rad": mechanism.bodies[0].phi})
    tab.evaluate("mechanism.set('torque', 0.7); mechanism.run(0.3)")
    tab.click("#millimetres")
    tab.wait_for_function("location.hash.includes('state=')")
    other = browser.new_page(viewport=WINDOW)
    other.goto(tab.url)
    other.wait_for_function("window.mechanism")
    assert other.evaluate("mechanism.values()") == tab.evaluate("mechanism.values()")
    np.testing.assert_allclose(other.evaluate("mechanism.state().q"), tab.evaluate("mechanism.state().q"), atol=1e-12)
    assert other.locator("#millimetres").get_attribute("aria-pressed") == "true"
    assert other.evaluate("mechanism.time") == pytest.approx(0.3)
    other.close()


def test_keys_drag_a_body(opened):
    """B takes the first body, the arrows move it, escape lets it go."""
    mechanism, start, _ = adjustable()
    tab = opened(mechanism, initial=start)
    tab.locator("#stage").focus()
    tab.keyboard.press("b")
    for _ in range(5):
        tab.keyboard.press("ArrowDown")
    tab.keyboard.press("Escape")
    assert tab.evaluate("mechanism.state().q")[2] < 0.3 and tab.evaluate("mechanism.time") == 0.0
    assert tab.evaluate("mechanism.violation()") <= 1e-9


def test_the_view_follows_what_leaves_it(opened):
    """A ball that flies off stays in the picture, until the reader moves the view."""
    ball = mbd.Body("ball", 1.0, 0.01, velocity=(30.0, 0, 0), shape=mbd.Rectangle(0.1, 0.1))
    tab = opened(mbd.Mechanism([ball], forces=[]), initial=[ball.vx == 30])
    tab.evaluate("mechanism.run(20)")
    x, y = tab.evaluate("mechanism.place('ball')")
    box = tab.locator("#stage").bounding_box()
    assert 0 < x < box["width"] and 0 < y < box["height"]


@pytest.mark.parametrize("slope", [0.0, -0.3])
def test_the_ground_goes_as_far_as_the_picture(opened, slope):
    """Under a ball that has gone far: the line of the ground crosses the whole picture, in pieces that join."""
    along = np.array([np.cos(slope), np.sin(slope)])
    ball = mbd.Body("ball", 1.0, 0.01, pose=(-0.1 * np.sin(slope), 0.1 * np.cos(slope), 0), velocity=(*(30 * along), 0))
    ground = mbd.HalfPlane(mbd.ground.at(0, 0, angle=slope))
    touch = mbd.Contact("touch", mbd.Circle(ball.at(0, 0), 0.1), ground, mbd.HuntCrossley(1e4))
    tab = opened(mbd.Mechanism([ball], forces=[touch]), initial=[ball.vx == 30 * along[0], ball.vy == 30 * along[1]])
    tab.evaluate("mechanism.run(20)")
    line = rf'd="([^"]*)" fill="none" stroke="{LIGHT["ground"]}" stroke-width="1.9'
    (path,) = re.findall(line, tab.evaluate("mechanism.svg()"))
    ends = np.array(re.findall(r"(-?[\d.]+) (-?[\d.]+)", path), float).reshape(-1, 2, 2)
    np.testing.assert_allclose(ends[1:, 0], ends[:-1, 1], atol=0.02)
    assert ends[0, 0, 0] <= 0 and ends[-1, 1, 0] >= tab.locator("#stage").bounding_box()["width"]


def test_a_large_load_is_written_with_its_prefix(opened):
    """50 kN, also in the field of its slider; an arrow of it is not longer than a part of the picture."""
    load = mbd.Input("load, N", -5e4, lower=-1e5, upper=1e5)
    beam = mbd.Body("beam", 200.0, 40.0, pose=(0.8, 0, 0))
    bush = mbd.Weld("bush", mbd.ground.at(0, 0), beam.at(-0.8, 0))
    push = mbd.Force("push", beam.at(0.8, 0), (0, load))
    tab = opened(mbd.Mechanism([beam], [bush], forces=[push], inputs=[load]))
    assert tab.locator("#values span").text_content() == "load, kN"
    assert tab.locator("#values input[type=number]").input_value() == "-50"
    assert tab.evaluate("mechanism.shown('bush')")["force on beam, y, N"] == "50.0 kN"


def test_a_small_ball_under_its_contact_is_pointed_at(opened):
    """The smallest part at the pointer is read; a further click reads what lies under it."""
    ball = mbd.Body("ball", 1, 1e-3, pose=(0, 2.5, 0))
    law = mbd.HuntCrossley(1e5, damping=0.2)
    floor = mbd.Contact("floor", mbd.Circle(ball.at(0, 0), 0.02), mbd.HalfPlane(mbd.ground.at(0, 0)), law)
    tab = opened(mbd.Mechanism([ball], forces=[mbd.Gravity(), floor]), initial=[ball.vx == 2])
    tab.evaluate("mechanism.run(0.712)")  # on the floor
    corner, (x, y) = tab.locator("#stage").bounding_box(), tab.evaluate("mechanism.place('ball')")
    for name in ("ball", "floor"):
        tab.mouse.click(corner["x"] + x, corner["y"] + y)
        assert tab.locator("#reading b").text_content() == name


@pytest.mark.slow
def test_names_velocities_and_forces_are_switched(opened):
    """Each changes the picture, and back; the scale is that of what is shown."""
    mechanism, start, _ = adjustable()
    tab = opened(mechanism, initial=start)
    plain = tab.evaluate("mechanism.svg()")
    for switch, shown in (("names", "coupler"), ("velocities", "#1f5fa8"), ("forces", "#1f6f4a")):
        tab.click(f"#{switch}")
        assert shown in tab.evaluate("mechanism.svg()") and shown not in plain, switch
        assert ('text-anchor="end"' in tab.evaluate("mechanism.svg()")) == (switch != "names")
        tab.click(f"#{switch}")
        assert tab.evaluate("mechanism.svg()") == plain
    tab = opened(mechanism, initial=start, names=True, forces=True)
    assert "coupler" in tab.evaluate("mechanism.svg()") and re.search(r">[\d.]+ N<", tab.evaluate("mechanism.svg()"))


@pytest.mark.slow
def test_a_kept_number_is_plotted_over_what_was_run(opened):
    """By a click, in a page without plots, too; the table of the page has it beside what was plotted before."""
    mechanism, start, _ = adjustable()
    crank = mechanism.bodies[0]
    for plots in ({}, {"crank, rad/s": crank.omega}):
        tab = opened(mechanism, initial=start, plots=plots)
        tab.evaluate("mechanism.run(0.3)")
        tab.locator("#stage").click(position=dict(zip("xy", tab.evaluate("mechanism.place('crank')"), strict=True)))
        tab.locator("#reading tr", has_text="omega").click()
        tab.evaluate("mechanism.run(0.2)")
        points = tab.evaluate("mechanism.plot('crank: omega, rad/s')")[""]["points"]
        known = [(t, value) for t, value in points if np.isfinite(value)]
        assert known[0][0] == 0 and known[-1][0] == pytest.approx(0.5, abs=0.01)
        motion = mbd.simulate(mechanism, [t for t, _ in known], initial=start, reltol=1e-9, abstol=1e-9)
        np.testing.assert_allclose([value for _, value in known], motion[crank.omega], atol=1e-5)
        head, *rows = tab.evaluate("mechanism.csv()").splitlines()
        assert '"crank: omega, rad/s"' in head and {row.count(",") for row in rows} == {head.count('","')}
        tab.locator("#reading tr", has_text="omega").click()
        assert tab.locator("#plots canvas").count() == len(plots)


@pytest.mark.slow
def test_a_long_label_is_shortened_before_its_component(opened):
    """What tells the forces of a pin apart stays, with the unit."""
    mechanism, start = four_bar()
    plots = {"pin between the crank and the coupler, x, rad": mechanism.bodies[0].phi}
    tab = opened(mechanism, initial=start, plots=plots)
    tab.evaluate("""() => {
      const pen = CanvasRenderingContext2D.prototype, write = pen.fillText;
      window.texts = [];
      pen.fillText = function (text, ...at) { texts.push(text); write.call(this, text, ...at); };
    }""")
    tab.set_viewport_size({"width": 390, "height": 844})
    tab.wait_for_function("texts.some(text => /^pin .*\u2026, x, rad$/.test(text))")


def test_a_linkage_that_comes_apart_stops_and_says_so(opened):
    """A driver pulls a link beyond its reach."""
    link = mbd.Body("link", 1, 0.1, pose=(0.5, 0, 0))
    joints = [mbd.Revolute("pin", mbd.ground.at(0, 0), link.at(-0.5, 0))]
    pull = mbd.Driver("pull", link.at(0.5, 0).x, 0.5 + 0.5 * mbd.t)
    tab = opened(mbd.Mechanism([link], joints=joints, drivers=[pull]), initial=[link.phi == np.pi / 3])
    tab.evaluate("mechanism.play()")
    tab.wait_for_function("!mechanism.playing", timeout=20_000)
    assert tab.evaluate("mechanism.time") == pytest.approx(1.0, abs=1e-3)
    assert "stopped at t = " in tab.locator("#notice").text_content()
    assert tab.evaluate("mechanism.violation()") <= 1e-9


def test_a_phone_shows_all_of_it(opened):
    """Nothing sticks out to the side."""
    mechanism, start, _ = adjustable()
    tab = opened(mechanism, initial=start)
    tab.set_viewport_size({"width": 390, "height": 844})
    tab.wait_for_timeout(50)
    assert tab.evaluate("document.documentElement.scrollWidth") <= 390
    for control in ("#play", "#step", "#reset", "#speed", "#theme"):
        box = tab.locator(control).bounding_box()
        assert box["x"] >= 0 and box["x"] + box["width"] <= 390 and box["height"] >= 28


def test_javascript_evaluates_as_casadi_does(browser):
    """Every operation, at random arguments."""
    x = ca.SX.sym("x", 3)
    a, b, c = ca.vertsplit(x)
    expressions = [
        a + b, a - b, a * b, a / b, -a, ca.sqrt(ca.fabs(a)), a**2, 2 * a, 1 / a, ca.exp(a), ca.log(ca.fabs(b)),
        ca.fabs(a) ** b, a**3, ca.sin(a), ca.cos(a), ca.tan(a), ca.asin(a / 9), ca.acos(a / 9), ca.atan(a),
        ca.sinh(a), ca.cosh(a), ca.tanh(a), ca.asinh(a), ca.acosh(1 + a**2), ca.atanh(a / 9), ca.atan2(a, b),
        ca.floor(a), ca.ceil(a), ca.sign(a), ca.sign(a - a), ca.fmod(a, b), ca.copysign(a, b), ca.fmin(a, b),
        ca.fmax(a, b), ca.hypot(a, b), ca.log1p(ca.fabs(a)), ca.expm1(a), a < b, a <= b, ca.eq(a, b), ca.ne(a, b),
        ca.logic_and(a < b, b < c), ca.logic_or(a < b, b < c), ca.logic_not(a < b), ca.if_else(a < b, c, -c),
        a * -2.5 + 1e-20 - 1e20 * c,
    ]  # fmt: skip
    function = ca.Function("f", [x], [ca.vertcat(*expressions)], ["x"], ["y"])
    code = to_javascript(function, "f")
    values = np.random.default_rng(2).uniform(-3, 3, (20, 3))
    tab = browser.new_page()
    found = tab.evaluate(
        f"(all) => {{ {code}; return all.map(x => {{ const y = new Float64Array({len(expressions)}); f(x, y); "
        "return Array.from(y); }); }",
        values.tolist(),
    )
    tab.close()
    expected = [function(row).full().ravel() for row in values]
    np.testing.assert_allclose(np.array(found, float), expected, rtol=1e-13, atol=1e-15)


# --- what cannot go along is refused when the file is written -------------------------------------
def block_on_guide():
    block = mbd.Body("block", mass=1.0, inertia=0.1)
    return block, mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))


def test_a_mechanism_too_fast_for_its_preview():
    """A rod of two nanometres swings 10 000 times a second: its motion for the size of the picture is not computed."""
    rod = mbd.Body("rod", mass=1e-25, inertia=1e-45, pose=(1e-9, 0, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), rod.at(-1e-9, 0))
    page = mbd.animate(mbd.Mechanism([rod], [pin], forces=[mbd.Gravity()]), live=True)
    assert re.search(r'"digits": ?2\b', page.html)


def test_exact_friction_is_refused_by_name(tmp_path):
    """Stick and slip needs events."""
    block, guide = block_on_guide()
    rub = mbd.JointFriction("rub", guide, mbd.DryFriction(0.3))
    with pytest.raises(mbd.MechanismError, match=r"'rub'.*Coulomb"):
        mbd.animate(mbd.Mechanism([block], joints=[guide], forces=[rub]), tmp_path / "dry.html", live=True)
    assert not (tmp_path / "dry.html").exists()


def test_an_operation_that_javascript_lacks_is_refused_by_element(tmp_path):
    """The error function, in a spring."""
    block, guide = block_on_guide()
    force = mbd.Force("bump", block.at(0, 0), (ca.erf(block.x), 0))
    with pytest.raises(mbd.ExpressionError, match=r"'bump'.*'erf'"):
        mbd.animate(mbd.Mechanism([block], joints=[guide], forces=[force]), tmp_path / "erf.html", live=True)


@pytest.mark.slow
def test_data_that_are_too_large_are_refused_by_element(tmp_path):
    """A force from thousands of points."""
    block, guide = block_on_guide()
    xs = np.linspace(-1, 1, 2500)
    force = mbd.Force("road", block.at(0, 0), (mbd.spline(block.x, xs, np.sin(40 * xs), outside="constant"), 0))
    with pytest.raises(mbd.MechanismError, match=r"more than 1 MB.*'road'"):
        mbd.animate(mbd.Mechanism([block], joints=[guide], forces=[force]), tmp_path / "road.html", live=True)


def test_friction_on_redundant_joints_is_refused(tmp_path):
    """No single load of the joint is known."""
    mechanism, _ = parallelogram()
    rub = mbd.JointFriction("rub", mechanism.joint("foot 1"), mbd.Coulomb(0.2, 1e-3), radius=0.01)
    with pytest.raises(mbd.MechanismError, match="redundant"):
        mbd.animate(mechanism.replace(forces=[*mechanism.forces, rub]), tmp_path / "r.html", live=True)


def test_arguments_are_checked(tmp_path):
    """Starts, sliders, endings, and what belongs to a live page alone."""
    block, guide = block_on_guide()
    mass = mbd.Parameter("m", 1.0, lower=-1.0, upper=2.0)
    heavy = mbd.Body("heavy", mass=mass, inertia=0.1)
    mechanism = mbd.Mechanism([block], joints=[guide])
    motion = mbd.simulate(mechanism, duration=0.1, initial=[block.vx == 1])
    page = tmp_path / "x.html"
    for wrong, message in (
        (lambda: mbd.animate(mechanism, page), "live=True"),
        (lambda: mbd.animate(motion, page, live=True), "takes a mechanism"),
        (lambda: mbd.animate(motion, page, initial=[block.x == 1]), "initial="),
        (lambda: mbd.animate(mechanism, tmp_path / "x.gif", live=True), "html"),
        (lambda: mbd.animate(mechanism, page, live=True, initial=[block.x <= 1]), "equalities"),
        (lambda: mbd.animate(mechanism, page, live=True, parameters=[mass]), "does not have"),
        (lambda: mbd.animate(mechanism, page, live=True, parameters={mass: 1.0}), "list"),
        (lambda: mbd.animate(mechanism, page, live=True, speed=-1), "speed"),
        (lambda: mbd.animate(mbd.Mechanism([heavy], parameters=[mass]), page, live=True), "'m' goes from -1 to 2"),
    ):
        with pytest.raises(mbd.MechanismError, match=message):
            wrong()
    assert not page.exists()


def test_a_live_page_shows_an_actuator_with_its_stroke():
    """The cylinder, its length and its stroke, with a slider for the course."""
    arm = mbd.Body("arm", mass=12, inertia=0.9, pose=(0.8, 0, 0))
    out = mbd.Parameter("out", 0.1, lower=0.0, upper=0.3)
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), arm.at(-0.8, 0))
    jack = mbd.Actuator("jack", mbd.ground.at(0, -0.6), arm.at(0, 0), 0.9 + out * (1 - mbd.cos(mbd.t)))
    lift = mbd.Mechanism([arm], [pin], drivers=[jack], forces=[mbd.Gravity()], parameters=[out])
    page = mbd.animate(lift, live=True, plots={"push, N": -jack.force})
    styles = [mark.style for mark in page.film.scene.marks]
    (item,) = [item for item in page.film.scene.items if item.name == "jack"]
    assert styles.count("barrel") == 1 and "stroke, m" in item.tooltip and "stroke" in page.html
