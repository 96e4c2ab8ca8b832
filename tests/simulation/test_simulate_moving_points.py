"""Markers that move over their bodies: supports that shake, loads that travel, and forces where two bodies touch."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import mbdcasadi as mbd

LENGTH, SHAKE, RATE = 0.3, 0.05, 6.0


def pendulum(support, *further, **parts):
    """A bob on a massless rod that hangs from a support."""
    bob = mbd.Body("bob", mass=1, inertia=0, pose=(0, -LENGTH, -np.pi / 2))
    torque = mbd.Input("torque", lower=-2, upper=2)
    pin = mbd.Revolute("pin", support, bob.at(-LENGTH, 0))
    model = mbd.Mechanism(
        [bob, *further],
        [pin, *parts.pop("joints", [])],
        forces=[mbd.Gravity(), mbd.Torque("motor", bob, torque)],
        inputs=[torque],
        **parts,
    )
    return model, bob, torque, [bob.phi == -np.pi / 2, bob.omega == 0]


@pytest.mark.parametrize("method", ["idas", "dop853"])
def test_support_that_shakes(method):
    """A pendulum on a point of the ground that moves with time: its equation of motion by hand."""
    model, bob, _, start = pendulum(mbd.ground.at(SHAKE * mbd.sin(RATE * mbd.t), 0))
    motion = mbd.simulate(model, np.linspace(0, 2, 41), initial=start, method=method)

    def rates(t, y):
        push = SHAKE * RATE**2 * np.sin(RATE * t)
        return [y[1], (push * np.cos(y[0]) - 9.81 * np.sin(y[0])) / LENGTH]

    exact = solve_ivp(rates, (0, 2), [0, 0], rtol=1e-11, atol=1e-12, t_eval=motion.t).y[0]
    np.testing.assert_allclose(motion[bob.phi] + np.pi / 2, exact, atol=1e-7)


def test_base_of_a_spring_that_shakes():
    """The damper feels the speed of its base."""
    block = mbd.Body("block", mass=1, inertia=1, pose=(0, 0.5, 0))
    guide = mbd.Translational("guide", mbd.ground.at(0, 0, np.pi / 2), block.at(0, 0, np.pi / 2))
    base = mbd.ground.at(0, 0.1 * mbd.sin(5 * mbd.t))
    spring = mbd.TSDA("spring", base, block.at(0, 0), stiffness=100, free_length=0.5, damping=3)
    motion = mbd.simulate(mbd.Mechanism([block], [guide], forces=[spring]), np.linspace(0, 2, 41))

    def rates(t, y):
        return [y[1], 100 * (0.1 * np.sin(5 * t) + 0.5 - y[0]) + 3 * (0.5 * np.cos(5 * t) - y[1])]

    exact = solve_ivp(rates, (0, 2), [0.5, 0], rtol=1e-11, atol=1e-12, t_eval=motion.t).y[0]
    np.testing.assert_allclose(motion[block.y], exact, atol=1e-7)


@pytest.mark.slow
def test_optimal_motion_on_a_support_that_shakes():
    """The same optimum as on a massless carriage that a driver moves."""
    course, costs = SHAKE * mbd.sin(RATE * mbd.t), []
    carriage = mbd.Body("carriage", mass=0, inertia=0)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), carriage.at(0, 0))
    driven = {"joints": [rail], "drivers": [mbd.Driver("shake", carriage.x, course)]}
    for support, further, parts in ((mbd.ground.at(course, 0), [], {}), (carriage.at(0, 0), [carriage], driven)):
        model, bob, torque, start = pendulum(support, *further, **parts)
        problem = mbd.OptimalControlProblem(
            model,
            duration=1.5,
            running_cost=torque**2,
            initial=start,
            final=[bob.phi == np.pi / 2, bob.omega == 0],
        )
        costs.append(mbd.optimize(problem, intervals=20).cost)
    assert costs[0] == pytest.approx(costs[1], rel=1e-6)


def test_force_where_two_bodies_touch():
    """Traction between a plank and a block on it: the place moves over the plank, and action is reaction."""
    plank = mbd.Body("plank", mass=2, inertia=1)
    block = mbd.Body("block", mass=1, inertia=1, pose=(0.3, 0.1, 0))
    rails = [
        mbd.Translational(f"rail of {b.name}", mbd.ground.at(0, y), b.at(0, 0)) for b, y in ((plank, 0), (block, 0.1))
    ]
    traction = mbd.Force("traction", plank.at(block.x - plank.x, 0), (3, 0), opposite=block)
    state = mbd.assemble(mbd.Mechanism([plank, block], rails, forces=[traction]))
    assert (state[plank.ax], state[block.ax]) == pytest.approx((1.5, -3))


def test_load_that_travels_over_a_beam():
    """A weight that runs along a hinged beam at a given speed does work by the beam's turning alone."""
    beam = mbd.Body("beam", mass=3, inertia=0.25, pose=(0.5, 0, 0))
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), beam.at(-0.5, 0))
    load = mbd.Force("load", beam.at(0.4 * mbd.t - 0.5, 0), (0, -7))
    motion = mbd.simulate(mbd.Mechanism([beam], [hinge], forces=[load]), np.linspace(0, 1, 21))

    def rates(t, y):
        return [y[1], -7 * 0.4 * t * np.cos(y[0])]  # the inertia about the hinge is 1

    exact = solve_ivp(rates, (0, 1), [0, 0], rtol=1e-11, atol=1e-12, t_eval=motion.t).y[0]
    np.testing.assert_allclose(motion[beam.phi], exact, atol=1e-7)


@pytest.mark.parametrize("method", ["idas", "dop853"])
def test_contact_on_a_table_that_shakes(method):
    """The surface of a table moves with its marker on the ground, as it does on a body that is driven."""
    course = 0.02 * mbd.sin(14 * mbd.t), 0.01 * mbd.sin(13 * mbd.t), 0.1 * mbd.sin(5 * mbd.t)
    table = mbd.Body("table", mass=1, inertia=1)
    coordinates = table.x, table.y, table.phi
    drivers = [mbd.Driver(f"drive {k}", coordinates[k], course[k]) for k in range(3)]
    ends = []
    for surface, bodies, driven in ((mbd.ground.at(*course), [], []), (table.at(0, 0), [table], drivers)):
        ball = mbd.Body("ball", mass=0.2, inertia=1e-4, pose=(0, 0.05, 0))
        law, friction = mbd.HuntCrossley(1e4, exponent=1, damping=1), mbd.Coulomb(0.3, 1e-2)
        contact = mbd.Contact("contact", mbd.Circle(ball.at(0, 0), 0.05), mbd.HalfPlane(surface), law, friction)
        model = mbd.Mechanism([ball, *bodies], drivers=driven, forces=[mbd.Gravity(), contact])
        rest = [ball.vx == 0, ball.vy == 0, ball.omega == 0]
        ends.append(mbd.simulate(model, duration=0.5, initial=rest, method=method).final[ball.q])
    assert abs(ends[0][2]) > 0.1
    np.testing.assert_allclose(ends[0], ends[1], atol=1e-6)


def test_wheel_on_a_table_that_shakes():
    """A disc that rolls on it takes a third of the table's acceleration; its phase is that of t = 0."""
    radius, course = 0.1, 0.05 * mbd.sin(6 * mbd.t)
    wheel = mbd.Body("wheel", mass=1, inertia=0.5 * radius**2, pose=(0, radius, 0))
    rolling = mbd.Rolling("rolling", wheel.at(0, 0), mbd.ground.at(course, 0), radius)
    motion = mbd.simulate(mbd.Mechanism([wheel], [rolling]), np.linspace(0, 1, 11), initial=[wheel.omega == 0])
    shake = 0.05 * np.sin(6 * motion.t)
    np.testing.assert_allclose(motion[wheel.x], shake / 3 + 0.2 * motion.t, atol=1e-7)
    np.testing.assert_allclose(motion[wheel.phi], (shake - motion[wheel.x]) / radius, atol=1e-9)


def test_curve_that_shakes():
    """A bead on a line along x that moves up and down, and with another body: the row follows both."""
    lift = mbd.Body("lift", mass=1, inertia=1)
    bead = mbd.Body("bead", mass=1, inertia=1, pose=(0.2, 0.1, 0))
    line = mbd.Curve(lambda s: (s, 0), -1, 1)
    drivers = [mbd.Driver("drive", lift.y, 0.2 * mbd.t)]
    course = lift.y + 0.1 * mbd.cos(3 * mbd.t)
    guides = [mbd.AbsoluteX("guide", lift.at(0, 0), 0)]
    guides += [mbd.AbsoluteAngle(f"angle of {b.name}", b.at(0, 0), 0) for b in (lift, bead)]
    on_line = mbd.PointOnCurve("on line", mbd.ground.at(0, course), bead.at(0, 0), line)
    model = mbd.Mechanism([lift, bead], [on_line, *guides], drivers=drivers)
    motion = mbd.simulate(model, np.linspace(0, 1, 11), initial=[bead.x == 0.2, bead.vx == 0.3])
    exact = np.stack([0.2 + 0.3 * motion.t, 0.2 * motion.t + 0.1 * np.cos(3 * motion.t)], axis=-1)
    np.testing.assert_allclose(motion[bead.position], exact, atol=1e-9)


def test_outline_that_another_body_moves():
    """That body would not feel the contact."""
    crank, ball = mbd.Body("crank", mass=1, inertia=1), mbd.Body("ball", mass=1, inertia=1)
    table = mbd.HalfPlane(mbd.ground.at(0, 0.1 * mbd.sin(crank.phi)))
    with pytest.raises(mbd.ExpressionError, match=r"contact 'c': the place of HalfPlane .* position 'crank.phi'"):
        mbd.Contact("c", mbd.Circle(ball.at(0, 0), 0.05), table, mbd.HuntCrossley(1e4))
