"""Rest with dry friction that sticks and rigid contacts that are closed: by hand."""

import numpy as np
import pytest

import mbdcasadi as mbd

G = 9.81
LOAD = mbd.Parameter("load", 0.0)


def incline(angle: float = np.radians(20), mu: float = 0.5):
    """A block of 2 kg on an incline, with a force up along it."""
    block = mbd.Body("block", mass=2, inertia=0.1)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0, angle=angle), block.at(0, 0))
    rub = mbd.JointFriction("rub", rail, mbd.DryFriction(mu))
    push = mbd.Force("push", block.at(0, 0), (np.cos(angle) * LOAD, np.sin(angle) * LOAD))
    return mbd.Mechanism([block], [rail], forces=[mbd.Gravity(), rub, push], parameters=[LOAD]), rub


def ladder(at_wall: mbd.DryFriction | None = None):
    """A ladder of 2 m at 60°, with a load that weighs down 1.6 m up."""
    angle = np.radians(60)
    body = mbd.Body("ladder", mass=5, inertia=5 / 3, pose=(np.cos(angle), np.sin(angle), -angle))
    top, foot = mbd.Point(body.at(-1, 0)), mbd.Point(body.at(1, 0))
    wall = mbd.RigidContact("wall", top, mbd.HalfPlane(mbd.ground.at(0, 0, angle=-np.pi / 2)), friction=at_wall)
    floor = mbd.RigidContact("floor", foot, mbd.HalfPlane(mbd.ground.at(0, 0)), friction=mbd.DryFriction(0.4))
    man = mbd.Force("man", body.at(-0.6, 0), (0, -LOAD))
    return mbd.Mechanism([body], forces=[mbd.Gravity(), wall, floor, man], parameters=[LOAD]), wall, floor


def box(height: float, mu: float):
    """A box of 3 kg, 0.6 m wide and 0.4 m high, on two corners, and a force along the floor at a height."""
    body = mbd.Body("box", mass=3, inertia=0.1, pose=(0, 0.2, 0))
    corners = [(-0.3, -0.2), (0.3, -0.2), (0.3, 0.2), (-0.3, 0.2)]
    outlines = mbd.PolygonEdges(body.at(0, 0), corners), mbd.HalfPlane(mbd.ground.at(0, 0))
    floor = mbd.RigidContact("floor", *outlines, friction=mbd.DryFriction(mu))
    push = mbd.Force("push", body.at(0, height - 0.2), (LOAD, 0))
    return mbd.Mechanism([body], forces=[mbd.Gravity(), floor, push], parameters=[LOAD]), floor


def test_a_block_rests_on_an_incline_between_two_loads():
    mechanism, rub = incline()
    rest = mbd.equilibrium(mechanism)
    assert rest[rub.force] == pytest.approx(2 * G * np.sin(np.radians(20)), abs=1e-12) and rest.stable
    found, sin, cos = mbd.holding_range(mechanism, LOAD), np.sin(np.radians(20)), np.cos(np.radians(20))
    assert found.least == pytest.approx(2 * G * (sin - 0.5 * cos), abs=1e-10)
    assert found.greatest == pytest.approx(2 * G * (sin + 0.5 * cos), abs=1e-10)
    assert found.gives_at_greatest == ("friction 'rub' slides",) and "rub" in repr(found)
    assert found.at_least[rub.force] == pytest.approx(0.5 * 2 * G * cos)


def test_a_block_that_slides_is_named_with_both_forces():
    mechanism, _ = incline(angle=np.radians(30), mu=0.5)
    needed, available = 2 * G * 0.5, 0.5 * 2 * G * np.cos(np.radians(30))
    with pytest.raises(
        mbd.EquilibriumError, match=rf"'rub' .*{needed:.6g} N and holds {available:.6g} N, so it slides"
    ):
        mbd.equilibrium(mechanism)
    assert mbd.equilibrium(mechanism, parameters={LOAD: 2.0}).stable


def test_what_rests_in_simulate_rests_and_what_slides_does_not():
    """Just below and above the least and the greatest load."""
    mechanism, _ = incline()
    found = mbd.holding_range(mechanism, LOAD)
    for value, inwards in ((found.least, 1e-6), (found.greatest, -1e-6)):
        assert mbd.assemble(mechanism, parameters={LOAD: value + inwards}).a == pytest.approx(0, abs=1e-12)
        assert np.max(np.abs(mbd.assemble(mechanism, parameters={LOAD: value - inwards}).a)) > 1e-7


def test_a_ladder_leans_on_a_smooth_wall():
    mechanism, wall, floor = ladder()
    rest = mbd.equilibrium(mechanism)
    assert rest[wall.normal_force] == pytest.approx(5 * G / 2 / np.tan(np.radians(60)), rel=1e-12)
    assert rest[floor.normal_force] == pytest.approx(5 * G, rel=1e-12)
    state = mbd.simulate(mechanism, [0, 0.1], initial=rest).final
    assert state[wall.normal_force] == pytest.approx(rest[wall.normal_force], rel=1e-9)
    # a load that brings a reaction, which nothing but the reaction feels
    loaded = mbd.equilibrium(mechanism, [wall.normal_force == 20], unknowns=[LOAD])
    assert loaded[LOAD] == pytest.approx((20 * np.tan(np.radians(60)) - 5 * G / 2) / 0.8, rel=1e-10)
    # N_wall L sin = (W L/2 + P s) cos with N_wall = mu (W + P)
    steep, weight = 0.4 * 2 * np.tan(np.radians(60)), 5 * G
    found = mbd.holding_range(mechanism, LOAD)
    assert found.greatest == pytest.approx(weight * (steep - 1) / (1.6 - steep), rel=1e-10)
    assert found.gives_at_greatest == ("contact 'floor' slides",)
    assert found.least == pytest.approx(-weight / 1.6, rel=1e-10) and found.gives_at_least == ("contact 'wall' opens",)


def test_a_ladder_that_rubs_on_both_ends_holds_with_reactions_that_are_not_unique():
    """At the end of the range both friction forces are at their limits; there the reactions are unique."""
    mechanism, wall, floor = ladder(mbd.DryFriction(0.3))
    rest = mbd.equilibrium(mechanism)
    assert abs(rest[floor.friction_force]) <= 0.4 * rest[floor.normal_force]
    assert rest[wall.normal_force] == pytest.approx(-rest[floor.friction_force], rel=1e-12)
    found, tan, weight = mbd.holding_range(mechanism, LOAD), np.tan(np.radians(60)), 5 * G
    # N = 0.4 M, M + 0.3 N = W + P, moments about the foot: 2 N sin + 2 · 0.3 N cos = (W + 1.6 P) cos
    share = 0.4 / 1.12 * 2 * (tan + 0.3)
    assert found.greatest == pytest.approx(weight * (share - 1) / (1.6 - share), rel=1e-10)
    assert found.gives_at_greatest == ("contact 'wall' slides", "contact 'floor' slides")
    assert mbd.equilibrium(mechanism, parameters={LOAD: found.greatest - 1e-6}).stable
    with pytest.raises(mbd.EquilibriumError, match="slides"):
        mbd.equilibrium(mechanism, parameters={LOAD: found.greatest + 1e-3})


@pytest.mark.parametrize(
    ("height", "mu", "greatest", "gives"),
    [(0.2, 0.5, 0.5 * 3 * G, "slides"), (0.4, 2.0, 3 * G * 0.3 / 0.4, "place 0, opens")],
)
def test_a_box_on_two_corners_slides_or_tips(height, mu, greatest, gives):
    mechanism, floor = box(height, mu)
    found = mbd.holding_range(mechanism, LOAD)
    assert (found.least, found.greatest) == pytest.approx((-greatest, greatest), rel=1e-10)
    assert gives in found.gives_at_greatest[0]
    rest = mbd.equilibrium(mechanism, parameters={LOAD: 5.0})
    assert rest[floor.friction_force] == pytest.approx(-5) and rest[floor.normal_force] == pytest.approx(3 * G)


def test_a_mass_on_a_spring_hangs_on_a_slide_that_sticks():
    """The mass finds its place, the slide stays where it was drawn; the spring drags it off at mu N."""
    slide, mass = mbd.Body("slide", mass=2, inertia=0.1, pose=(0.1, 0, 0)), mbd.Body("mass", mass=1, inertia=0.1)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), slide.at(0, 0))
    other = mbd.Translational("other", mbd.ground.at(0, 0), mass.at(0, 0))
    spring = mbd.TSDA("spring", slide.at(0, 0), mass.at(0, 0), stiffness=100, free_length=0.5)
    rub = mbd.JointFriction("rub", rail, mbd.DryFriction(0.3))
    push = mbd.Force("push", mass.at(0, 0), (LOAD, 0))
    forces = [mbd.Gravity(), spring, rub, push]
    mechanism = mbd.Mechanism([slide, mass], [rail, other], forces=forces, parameters=[LOAD])
    at = [mass.x == 0.8]
    rest = mbd.equilibrium(mechanism, at, parameters={LOAD: 2.0})
    assert (rest[slide.x], rest[mass.x]) == pytest.approx((0.1, 0.62), abs=1e-12)
    assert rest[rub.force] == pytest.approx(-2) and rest.stiffness.least == pytest.approx(100)
    found = mbd.holding_range(mechanism, LOAD, at)
    assert (found.least, found.greatest) == pytest.approx((-0.6 * G, 0.6 * G), rel=1e-9)
    assert found.at_greatest[mass.x] == pytest.approx(0.6 + 0.006 * G, abs=1e-9)


def test_a_bob_that_is_pulled_aside_swings_out_before_its_slide_moves():
    """The slide holds ``μ (M + m) g`` while the bob hangs ``atan(P / m g)`` aside."""
    slide, bob = mbd.Body("slide", mass=2, inertia=0.1), mbd.Body("bob", mass=0.5, inertia=0.01, pose=(0, -1, 0))
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), slide.at(0, 0))
    pin = mbd.Revolute("pin", slide.at(0, 0), bob.at(0, 1))
    rub = mbd.JointFriction("rub", rail, mbd.DryFriction(0.4))
    pull = mbd.Force("pull", bob.at(0, 0), (LOAD, 0))
    mechanism = mbd.Mechanism([slide, bob], [rail, pin], forces=[mbd.Gravity(), rub, pull], parameters=[LOAD])
    found = mbd.holding_range(mechanism, LOAD)
    assert (found.least, found.greatest) == pytest.approx((-G, G), rel=1e-9)
    assert found.at_greatest[pin.angle] == pytest.approx(np.arctan(2), rel=1e-9)
    assert found.at_greatest[slide.x] == pytest.approx(0, abs=1e-12)


def test_a_lever_that_turns_far_stays_stuck_where_it_was():
    """A pin sticks, and what hangs on it swings down by a right angle."""
    arm = mbd.Body("arm", mass=1, inertia=0.1, pose=(0.5, 0, 0))
    bob = mbd.Body("bob", mass=1, inertia=0.1, pose=(1.4, 0, 0))
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), arm.at(-0.5, 0))
    elbow = mbd.Revolute("elbow", arm.at(0.5, 0), bob.at(-0.4, 0))
    rub = mbd.JointFriction("rub", hinge, mbd.DryFriction(1.5), radius=0.6)
    mechanism = mbd.Mechanism([arm, bob], [hinge, elbow], forces=[mbd.Gravity(), rub])
    rest = mbd.equilibrium(mechanism)
    assert rest[hinge.angle] == pytest.approx(0, abs=1e-12)
    assert rest[bob.phi] == pytest.approx(-np.pi / 2) and rest[rub.torque] == pytest.approx(1.5 * G)


def test_a_ball_rolls_to_the_lowest_place_of_a_bowl():
    ball = mbd.Body("ball", mass=1, inertia=0.02, pose=(0.3, -0.74, 0))
    bowl = mbd.RigidContact(
        "bowl", mbd.Circle(ball.at(0, 0), 0.2), mbd.HollowCircle(mbd.ground.at(0, 0), 1), friction=mbd.DryFriction(0.5)
    )
    rest = mbd.equilibrium(mbd.Mechanism([ball], forces=[mbd.Gravity(), bowl]), [bowl.gap == 0, ball.x == 0.3])
    assert (rest[ball.x], rest[ball.y]) == pytest.approx((0, -0.8), abs=1e-9) and rest.stable
    assert rest[bowl.normal_force] == pytest.approx(G)


def test_a_wedge_that_jams_holds_any_load():
    """Below the angle of friction no weight slides down."""
    mechanism, _ = incline(mu=0.5)
    weight = mbd.Parameter("weight", 0.0)
    block = mechanism.bodies[0]
    more = mbd.Force("more", block.at(0, 0), (0, -weight))
    loaded = mechanism.replace(forces=[*mechanism.forces, more], parameters=[LOAD, weight])
    found = mbd.holding_range(loaded, weight)
    assert found.greatest == np.inf and found.at_greatest is None and found.gives_at_greatest == ()
    assert found.least == pytest.approx(-2 * G)


def test_a_block_that_is_lifted_holds_up_to_its_weight():
    """No force is left where it lifts off; pressed down it holds whatever the load."""
    block, lift = mbd.Body("block", mass=2, inertia=0.02, pose=(0, 0.05, 0)), mbd.Input("lift")
    outline = mbd.PolygonEdges(block.at(0, 0), [(-0.1, -0.05), (0.1, -0.05), (0.1, 0.05), (-0.1, 0.05)])
    floor = mbd.RigidContact("floor", outline, mbd.HalfPlane(mbd.ground.at(0, 0)), friction=mbd.DryFriction(0.3))
    up = mbd.Force("up", block.at(0, 0), (0, lift))
    found = mbd.holding_range(mbd.Mechanism([block], forces=[mbd.Gravity(), floor, up], inputs=[lift]), lift)
    assert found.least == -np.inf and found.greatest == pytest.approx(2 * 9.81, rel=1e-9)
    assert all("opens" in one for one in found.gives_at_greatest)


def test_an_input_holds_within_its_limits():
    """A block of 2 kg with μ = 0.5 holds 9.81 N on level ground, and the input gives less on one side."""
    mechanism, _ = incline(angle=0.0)
    push = mbd.Input("push", lower=-3, upper=30)
    (body,), by = mechanism.bodies, [f for f in mechanism.forces if f.name != "push"]
    pushed = mechanism.replace(forces=[*by, mbd.Force("push", body.at(0, 0), (push, 0))], inputs=[push], parameters=[])
    found = mbd.holding_range(pushed, push)
    assert (found.least, found.greatest) == (pytest.approx(-3), pytest.approx(0.5 * 2 * G))
    assert found.gives_at_least == ("input 'push' is at its limit",) and found.gives_at_greatest == (
        "friction 'rub' slides",
    )


def test_a_contact_would_have_to_pull():
    ball = mbd.Body("ball", mass=1, inertia=0.1, pose=(0, -0.1, 0))
    ceiling = mbd.HalfPlane(mbd.ground.at(0, 0, angle=np.pi))
    mechanism = mbd.Mechanism(
        [ball], forces=[mbd.Gravity(), mbd.RigidContact("top", mbd.Circle(ball.at(0, 0), 0.1), ceiling)]
    )
    with pytest.raises(mbd.EquilibriumError, match=r"'top' would have to pull with 9\.81 N, so it opens"):
        mbd.equilibrium(mechanism)


@pytest.mark.slow
def test_a_crank_that_rubs_in_every_joint_holds_as_long_as_in_simulate():
    """Limits that are norms of reactions, and reactions that are not unique: just inside it rests, outside it moves."""
    crank = mbd.Body("crank", mass=0.5, inertia=0.01, pose=(0.05, 0.05, np.pi / 4))
    rod = mbd.Body("rod", mass=0.8, inertia=0.02, pose=(0.2, 0.05, -0.3))
    slider = mbd.Body("slider", mass=1, inertia=0.01, pose=(0.35, 0, 0))
    pins = [
        mbd.Revolute("O", mbd.ground.at(0, 0), crank.at(-0.06, 0)),
        mbd.Revolute("A", crank.at(0.06, 0), rod.at(-0.15, 0)),
        mbd.Revolute("B", rod.at(0.15, 0), slider.at(0, 0)),
    ]
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), slider.at(0, 0))
    dry = mbd.DryFriction(0.2)
    rubs = [mbd.JointFriction(f"rub {pin.name}", pin, dry, radius=0.02) for pin in pins]
    rubs.append(mbd.JointFriction("rub", guide, dry, length=0.1))
    forces = [mbd.Gravity(), mbd.Force("gas", slider.at(0, 0), (-100, 0)), mbd.Torque("torque", crank, LOAD), *rubs]
    engine = mbd.Mechanism([crank, rod, slider], [*pins, guide], forces=forces, parameters=[LOAD])
    found = mbd.holding_range(engine, LOAD)
    assert len(found.gives_at_least) == 4
    for value, inwards in ((found.least, 1e-5), (found.greatest, -1e-5)):
        assert mbd.assemble(engine, parameters={LOAD: value + inwards}).a == pytest.approx(0, abs=1e-9)
        assert np.max(np.abs(mbd.assemble(engine, parameters={LOAD: value - inwards}).a)) > 1e-5


def test_a_brake_holds_up_to_its_capacity():
    drum = mbd.Body("drum", mass=1, inertia=0.5)
    axle = mbd.Revolute("axle", mbd.ground.at(0, 0), drum.at(0, 0))
    brake = mbd.Clutch("brake", mbd.ground, drum, 3.0)
    mechanism = mbd.Mechanism([drum], [axle, brake], forces=[mbd.Torque("t", drum, LOAD)], parameters=[LOAD])
    found = mbd.holding_range(mechanism, LOAD)
    assert (found.least, found.greatest) == pytest.approx((-3, 3))
    assert mbd.equilibrium(mechanism, parameters={LOAD: 2.0})[brake.torque] == pytest.approx(-2)


def test_redundant_joints_leave_the_load_of_a_friction_open():
    mechanism, _ = incline(angle=0.0)
    (block,) = mechanism.bodies
    twin = mbd.Translational("twin", mbd.ground.at(0, 1), block.at(0, 1))
    with pytest.raises(mbd.SingularityError, match="'rub' depends on reactions, and with redundant constraints"):
        mbd.holding_range(mechanism.replace(joints=[*mechanism.joints, twin]), LOAD)


def test_refuses():
    """Loads that move joints, mechanisms without friction, outlines in each other, what is no load."""
    mechanism, _ = incline()
    with pytest.raises(mbd.ModelError, match="takes an Input or a Parameter"):
        mbd.holding_range(mechanism, 3.0)
    body, length = mbd.Body("body", mass=1, inertia=1), mbd.Parameter("length", 1.0)
    rod = mbd.Distance("rod", mbd.ground.at(0, 0), body.at(0, 0), length)
    with pytest.raises(mbd.ModelError, match="joints move with 'length'"):
        mbd.holding_range(mbd.Mechanism([body], [rod], forces=[mbd.Gravity()], parameters=[length]), length)
    with pytest.raises(mbd.ModelError, match="nothing in the mechanism sticks"):
        mbd.holding_range(mbd.Mechanism([body], forces=[mbd.Gravity((0, -LOAD))], parameters=[LOAD]), LOAD)
    sunk, floor = box(0.2, 0.5)
    with pytest.raises(mbd.EquilibriumError, match="penetrate each other"):
        mbd.equilibrium(sunk, [floor.gap == -0.01])
