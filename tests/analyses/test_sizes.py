"""A mechanism in other sizes, from micrometres to a giant, is the same mechanism in other units."""

import itertools
from dataclasses import dataclass

import numpy as np
import pytest
from linkages import welded_beams

import mbdcasadi as mbd


@dataclass(frozen=True)
class Units:
    """Length, mass and time that count as one, in m, kg and s."""

    length: float = 1.0
    mass: float = 1.0
    time: float = 1.0

    @property
    def speed(self):
        return self.length / self.time

    @property
    def force(self):
        return self.mass * self.length / self.time**2

    @property
    def inertia(self):
        return self.mass * self.length**2

    def gravity(self):
        return mbd.Gravity((0.0, -9.81 * self.length / self.time**2))


ONE, MICRO, GIANT = Units(), Units(1e-6, 1e-12, 1e-3), Units(1e3, 1e9, 60.0)


def bouncing_ball(units):
    ball = mbd.Body("ball", mass=0.6 * units.mass, inertia=2.4e-3 * units.inertia, pose=(0, 1.1 * units.length, 0))
    law = mbd.HuntCrossley(2e5 * units.force / units.length**1.5, damping=0.3 / units.speed)
    outlines = mbd.Circle(ball.at(0, 0), 0.1 * units.length), mbd.HalfPlane(mbd.ground.at(0, 0))
    floor = mbd.Contact("floor", *outlines, law, mbd.Coulomb(0.4, 1e-2 * units.speed))
    return mbd.Mechanism([ball], forces=[units.gravity(), floor]), ball


def bouncing(units, **settings):
    """Heights and turning speeds of a ball that bounces and begins to roll, in these units."""
    drop, ball = bouncing_ball(units)
    times = np.linspace(0, 1, 41) * units.time
    motion = mbd.simulate(drop, times, initial=[ball.vx == units.speed], **settings)
    return np.column_stack([motion[ball.y] / units.length, motion[ball.omega] * units.time])


@pytest.mark.parametrize("units", [MICRO, GIANT, Units(1e-4, 1e-8, 1e-2)])
@pytest.mark.parametrize("method", ["idas", "rosenbrock"])
def test_bouncing(units, method):
    """A ball of a tenth of a micrometre turns by radians and falls by a micrometre: both are resolved."""
    exact = bouncing(ONE, reltol=1e-12, abstol=1e-14)
    assert np.max(np.abs(bouncing(units, method=method) - exact)) < 2e-5


def four_bar(units, stiffness, friction=()):
    m, i, size = units.mass, units.inertia, units.length
    crank = mbd.Body("crank", mass=m, inertia=0.02 * i, pose=(0, 0.25 * size, np.pi / 2))
    coupler = mbd.Body("coupler", mass=1.5 * m, inertia=0.1 * i, pose=(0.5 * size, 0.7 * size, 0.3))
    rocker = mbd.Body("rocker", mass=1.2 * m, inertia=0.08 * i, pose=(size, 0.4 * size, 1.4))
    joints = [
        mbd.Revolute("A", mbd.ground.at(0, 0), crank.at(-0.25 * size, 0)),
        mbd.Revolute("B", crank.at(0.25 * size, 0), coupler.at(-0.6 * size, 0)),
        mbd.Revolute("C", coupler.at(0.6 * size, 0), rocker.at(0.5 * size, 0)),
        mbd.Revolute("D", mbd.ground.at(1.1 * size, 0), rocker.at(-0.5 * size, 0)),
    ]
    ends = crank.at(0.25 * size, 0), mbd.ground.at(1.1 * size, 0)
    rate = stiffness * units.force / units.length
    spring = mbd.TSDA("spring", *ends, stiffness=rate, damping=0.0, free_length=0.8 * size)
    rubbing = [mbd.JointFriction(f"rub {j.name}", j, law, radius=0.05 * size) for law in friction for j in joints]
    return mbd.Mechanism([crank, coupler, rocker], joints, forces=[units.gravity(), spring, *rubbing]), coupler


@pytest.mark.slow
@pytest.mark.parametrize("units", [MICRO, GIANT, Units(1e-6, 1e-12, 1.0)])
def test_pins_with_dry_friction(units):
    """Turns of pins whose sense changes, at which they stick or do not: the motion is the same."""
    courses = []
    for own in (ONE, units):
        linkage, coupler = four_bar(own, 40.0, [mbd.DryFriction(0.2)])
        start = [linkage.bodies[0].phi == np.pi / 2, linkage.bodies[0].omega == 2 / own.time]
        motion = mbd.simulate(linkage, np.linspace(0, 1.5, 31) * own.time, initial=start)
        force = motion[linkage.joints[1].reaction_on(coupler).force] / own.force
        courses.append(np.column_stack([motion[coupler.phi], force / np.max(np.abs(force))]))
        names = [event.name for event in motion.events]
        assert len(names) == 12 and not any("breaks" in name for name in names)
    assert np.max(np.abs(courses[1] - courses[0])) < 1e-6


@pytest.mark.slow
@pytest.mark.parametrize("units", [MICRO, GIANT, Units(1e-6, 1e-12, 1.0)])
def test_a_block_that_sticks_and_slips(units):
    """A block under a force that comes and goes sticks a while at each turn."""
    slips = []
    for own in (ONE, units):
        block = mbd.Body("block", mass=own.mass, inertia=0.1 * own.inertia)
        guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
        rubbing = mbd.JointFriction("rub", guide, mbd.DryFriction(0.3, 0.4), length=0.2 * own.length)
        push = mbd.Force("push", block.at(0, 0), (6 * own.force * mbd.sin(3 * mbd.t / own.time), 0))
        sledge = mbd.Mechanism([block], [guide], forces=[own.gravity(), rubbing, push])
        motion = mbd.simulate(sledge, np.linspace(0, 5, 51) * own.time)
        slips.append([[event.t / own.time for event in motion.events], motion[block.x] / own.length])
    # it breaks away as 6 sin(3 t) = 0.4 * 9.81
    assert slips[1][0][0] == pytest.approx(np.arcsin(0.4 * 9.81 / 6) / 3, rel=1e-9)
    for mine, theirs in zip(*slips, strict=True):
        assert theirs == pytest.approx(mine, abs=1e-5)


@pytest.mark.parametrize("units", [MICRO, GIANT, Units(time=1e-6)])
def test_rest_of_a_linkage(units):
    """Poses and frequencies at rest; with microseconds the reactions are of 1e13 N, and what they leave is rounding."""
    found = []
    for own in (ONE, units):
        linkage, coupler = four_bar(own, 40.0)
        rest = mbd.equilibrium(linkage)
        rates = [mode.frequency * own.time for mode in mbd.linearize(linkage, rest).modes()]
        found.append([rest[coupler.x] / own.length, rest[coupler.phi], *rates])
    assert found[1] == pytest.approx(found[0], rel=1e-7)


@pytest.mark.parametrize("units", [ONE, MICRO, GIANT, Units(1e-6, 1e-12, 1.0), Units(time=1e6)])
def test_speeds_at_the_start(units):
    """The square of a speed has no slope at rest, and rest does not meet it, however small it is."""
    linkage, coupler = four_bar(units, 40.0)
    squared = coupler.vx**2 + coupler.vy**2
    for speed, kind in itertools.product([0.1 * units.speed, 1e4 * units.speed], ["square", "root"]):
        condition = squared == speed**2 if kind == "square" else mbd.sqrt(squared) == speed
        assert np.sqrt(mbd.assemble(linkage, [condition])[squared]) == pytest.approx(speed, rel=1e-9)


@pytest.mark.parametrize("turn", [1e-6, 1e-9])
def test_slow_starts(turn):
    """A linkage that turns by next to nothing turns as it does at any speed, by an equality and by a limit."""
    linkage, coupler = four_bar(ONE, 40.0)
    crank = linkage.bodies[0]
    ratio = mbd.assemble(linkage, [crank.omega == 1])[coupler.vx]
    for condition in (crank.omega == turn, crank.omega >= turn):
        start = mbd.assemble(linkage, [condition])
        assert start[crank.omega] == pytest.approx(turn, rel=1e-9)
        assert start[coupler.vx] == pytest.approx(ratio * turn, rel=1e-9)
    assert mbd.assemble(linkage, [crank.omega**2 == turn])[crank.omega] ** 2 == pytest.approx(turn, rel=1e-4)


@pytest.mark.parametrize("sense", [1, -1])
@pytest.mark.parametrize("units", [ONE, MICRO])
def test_sense_of_a_speed(units, sense):
    """The square of a speed is met in both senses, and a limit asks for one."""
    linkage, coupler = four_bar(units, 40.0)
    crank, squared, speed = linkage.bodies[0], coupler.vx**2 + coupler.vy**2, 3 * units.speed
    start = mbd.assemble(linkage, [squared == speed**2, sense * crank.omega >= 2 / units.time])
    assert start[squared] == pytest.approx(speed**2, rel=1e-9)
    assert sense * start[crank.omega] * units.time > 5
    with pytest.raises(mbd.ConditionError, match="omega"):
        mbd.assemble(linkage, [squared == speed**2, sense * crank.omega >= 7 / units.time])


def test_speeds_that_contradict_each_other():
    """Two drivers of one crank at unlike speeds of micrometres per second are refused."""
    crank = mbd.Body("crank", mass=1e-9, inertia=1e-21, pose=(1e-6, 0, 0))
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), crank.at(-1e-6, 0))
    drivers = [mbd.Driver("turn", hinge.angle, mbd.t), mbd.Driver("lift", crank.y, 1.1e-6 * mbd.t)]
    with pytest.raises(mbd.MechanismError, match="lift"):
        mbd.simulate(mbd.Mechanism([crank], [hinge], drivers=drivers), duration=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("units", [Units(1e-6, 1e-12, 1.0), MICRO, GIANT])
def test_path_of_a_column(units):
    """A column that leans a little is pushed down by four times its buckling load, and bends on."""
    ends = []
    for own in (ONE, units):
        load, size = mbd.Parameter("load", own.force), own.length
        bar = mbd.Body("bar", mass=own.mass, inertia=0.1 * own.inertia, pose=(0.5 * size, 0, 0))
        foot = mbd.ground.at(0, 0), bar.at(-0.5 * size, 0)
        spring = mbd.RSDA("spring", *foot, stiffness=2 * own.force * size)
        push = mbd.Force("push", bar.at(0.5 * size, 0), (-load, 0.01 * own.force))
        column = mbd.Mechanism([bar], [mbd.Revolute("foot", *foot)], forces=[spring, push], parameters=[load])
        path = mbd.equilibrium_path(column, load, 0.1 * own.force, 4 * own.force)
        assert path.values[-1] == pytest.approx(4 * own.force)
        ends.append(path[bar.phi])
    # balance of moments about the foot: 2 phi = F sin(phi) + 0.01 cos(phi)
    phi = ends[0][-1]
    assert 2 * phi == pytest.approx(4 * np.sin(phi) + 0.01 * np.cos(phi), rel=1e-9)
    assert ends[1] == pytest.approx(ends[0], rel=1e-7)


@pytest.mark.parametrize("units", [Units(1, 1e-9, 1), Units(1, 1e9, 1), MICRO])
def test_starts_of_cams(units):
    """The contact's coordinates on the outlines have no mass: what they are estimated at displaces no body."""
    poses = []
    for own in (ONE, units):
        size = own.length
        cam = mbd.Body("cam", mass=own.mass, inertia=0.1 * own.inertia)
        tappet = mbd.Body("tappet", mass=0.3 * own.mass, inertia=0.01 * own.inertia, pose=(0, 0.45 * size, 0))
        angles = np.linspace(0, 2 * np.pi, 72, endpoint=False)
        outline = mbd.CamOutline((0.3 + 0.05 * np.cos(angles) + 0.02 * np.cos(2 * angles)) * size)
        joints = [
            mbd.Revolute("shaft", mbd.ground.at(0, 0), cam.at(0, 0)),
            mbd.Translational("guide", mbd.ground.at(0, 0, np.pi / 2), tappet.at(0, 0, np.pi / 2)),
            mbd.CamPointFollower("lift", cam.at(0, 0), tappet.at(0, -0.1 * size), outline, roller_radius=0.05 * size),
        ]
        state = mbd.assemble(mbd.Mechanism([cam, tappet], joints))
        poses.append([state[cam.phi], state[tappet.y] / size])
    assert poses[1] == pytest.approx(poses[0], rel=1e-7)


def beams_and_weight(units, light):
    """A beam and a plate with too many welds, with a weight that hangs from the beam by a spring in a guide."""
    length = units.length
    beam, weight, bodies, joints = welded_beams(length, units.mass, units.inertia, light)
    pull = mbd.Input("pull")
    ends, stiffness = (beam.at(0, 0), weight.at(0, 0)), 20 * units.force / length
    spring = mbd.TSDA("spring", *ends, stiffness=stiffness, free_length=0.5 * length, actuator=pull)
    return mbd.Mechanism(bodies, joints, forces=[units.gravity(), spring], inputs=[pull]), weight, pull


@pytest.mark.slow
@pytest.mark.parametrize("light", [0.0, 0.2])
def test_reactions_that_are_not_unique_are_the_same_in_all_analyses_and_units(light):
    """Forces and moments of least norm: at rest, as states are assembled, simulated, and for a given motion."""
    found = []
    for units in (ONE, MICRO, GIANT, Units(1.3)):
        mechanism, weight, pull = beams_and_weight(units, light)
        rest = mbd.equilibrium(mechanism)
        still = mbd.assemble(mechanism, [weight.y == rest[weight.y], weight.vy == 0])
        times = np.linspace(0, 0.2, 5) * units.time
        start = [weight.vy == 0.3 * units.speed, weight.y == -1.2 * units.length]
        run = mbd.simulate(mechanism, times=times, initial=start)
        given = mbd.inverse_dynamics(mechanism, times, motion=run, efforts=[pull])
        assert given[pull] / units.force == pytest.approx(0, abs=1e-5)
        size = np.max(np.abs(still.lam))
        assert rest.lam == pytest.approx(still.lam, abs=1e-6 * size)
        assert given.lam == pytest.approx(run.lam, abs=1e-5 * size)
        welds = mechanism.joints[:4]
        for result in (rest, given):
            for weld in welds:
                reaction = weld.reaction_on(weld.b.body)
                found.append(np.ravel(result[reaction.force]) / units.force)
                found.append(np.ravel(result[reaction.torque]) / (units.force * units.length))
    of_one = len(found) // 4
    for k, value in enumerate(found[of_one:]):
        assert value == pytest.approx(found[k % of_one], abs=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("light", [0.0, 1e-9])
def test_poses_are_met_beside_light_parts_in_any_units(light):
    """A row in metres has a slope, though in micrometres it is small beside those in radians of a massless plate."""
    for units in (ONE, Units(1e-4), MICRO, GIANT):
        mechanism, weight, _ = beams_and_weight(units, light)
        for place in (-0.95, -1.3):
            state = mbd.assemble(mechanism, [weight.y == place * units.length, weight.vy == 0.3 * units.speed])
            assert state[weight.y] == pytest.approx(place * units.length, rel=1e-9)
            assert state[weight.vy] == pytest.approx(0.3 * units.speed, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("light", [0.0, 0.2])
def test_reactions_that_are_not_unique_are_those_of_the_simulation_where_drivers_move_the_mechanism(light):
    """Inverse dynamics by drivers beside the simulation and a numpy solution of least norm, in any units."""
    found = []
    for units in (ONE, MICRO, GIANT, Units(1.3)):
        mechanism, weight, _ = beams_and_weight(units, light)
        course = -units.length * (1.1 + 0.1 * mbd.sin(4 * mbd.t / units.time))
        driven = mechanism.replace(drivers=[mbd.Driver("lift", weight.y, course)])
        times = np.linspace(0, 0.3, 4) * units.time
        inverse, run = mbd.inverse_dynamics(driven, times), mbd.simulate(driven, times)
        assert inverse.lam == pytest.approx(run.lam, abs=1e-6 * np.max(np.abs(run.lam)))
        between = inverse.at(times[:1] + 0.05 * units.time)
        again = mbd.inverse_dynamics(driven, between.t)
        assert between.lam == pytest.approx(again.lam, abs=1e-6 * np.max(np.abs(run.lam)))
        eom = mbd.equations(driven)
        jacobian, angular = eom.jacobian(0, inverse.q[0], [])[0].full(), eom.angular_rows
        metres = np.where(eom.angles, units.length, 1.0)
        if light:  # by masses
            squares = jacobian**2 @ (1 / np.asarray(eom.masses([]), float).ravel())
            sizes = np.sqrt(np.where(angular, np.mean(squares[angular]), np.mean(squares[~angular])))
        else:  # by levers
            squares = np.sum(jacobian[~angular] ** 2, axis=0)
            lever = np.sqrt(np.sum(squares[2::3]) / (np.sum(squares) - np.sum(squares[2::3])))
            sizes = np.where(angular, 1 / lever, 1.0)
        scaled = (jacobian.T / sizes) / metres[:, None]
        least = np.linalg.pinv(scaled) @ (scaled @ (sizes * inverse.lam[0])) / sizes
        assert inverse.lam[0] == pytest.approx(least, abs=1e-6 * np.max(np.abs(least)))
        found.append([np.ravel(inverse[j.reaction_on(j.b.body).force]) / units.force for j in driven.joints])
    for others in found[1:]:
        assert np.array(others) == pytest.approx(np.array(found[0]), abs=1e-4)
