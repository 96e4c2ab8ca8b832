"""Simulation of bodies whose masses and inertias differ by many orders of magnitude."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import mbdcasadi as mbd

METHODS = ["idas", "erk", "rosenbrock"]
TIMES = np.linspace(0, 5, 101)


def pendulum(inertia, mass=50.0, length=3.0):
    bob = mbd.Body("bob", mass=mass, inertia=inertia, pose=(0, -length, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), bob.at(0, length))
    return bob, pin, mbd.Mechanism(bodies=[bob], joints=[pin], forces=[mbd.Gravity()])


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("inertia", [1.0, 1e-5, 1e-9, 1e-15, 0.0])
def test_point_mass_on_a_pin(method, inertia):
    """By the equation of the pendulum; the pin carries weight and centrifugal force."""
    bob, pin, model = pendulum(inertia)
    motion = mbd.simulate(model, TIMES, initial=[bob.phi == 0.5, bob.omega == 0], method=method)
    length = 3 + inertia / 150
    angle, rate = solve_ivp(
        lambda _, y: [y[1], -9.81 / length * np.sin(y[0])], (0, 5), [0.5, 0], t_eval=TIMES, rtol=1e-11, atol=1e-12
    ).y
    np.testing.assert_allclose(motion[bob.phi], angle, atol=1e-6)
    assert np.ptp(motion.energy.total) < 1e-3
    turn = -9.81 / length * np.sin(angle)
    along = 50 * (9.81 * np.cos(angle) + 3 * rate**2)
    across = 50 * (9.81 * np.sin(angle) + 3 * turn)
    np.testing.assert_allclose(np.hypot(*motion[pin.reaction_on(bob).force].T), np.hypot(along, across), rtol=1e-5)


def chain(masses, slenderness):
    """Links of random lengths and angles."""
    generator = np.random.default_rng(7)
    bodies, joints, before, end, at = [], [], mbd.ground, np.zeros(2), 0.0
    for k, (mass, share) in enumerate(zip(masses, slenderness, strict=True)):
        length, angle = generator.uniform(0.5, 1.5), generator.uniform(-np.pi, np.pi)
        along = length * np.array([np.cos(angle), np.sin(angle)])
        inertia = mass * share * length**2
        bodies.append(mbd.Body(f"link {k}", mass=mass, inertia=inertia, pose=(*(end + along / 2), angle)))
        joints.append(mbd.Revolute(f"pin {k}", before.at(at, 0), bodies[-1].at(-length / 2, 0)))
        before, end, at = bodies[-1], end + along, length / 2
    return mbd.Mechanism(bodies=bodies, joints=joints, forces=[mbd.Gravity()])


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_chains_over_fifteen_orders_of_mass(seed):
    """Three integrators, which take the equations in different forms, find the same motion, and keep the energy."""
    generator = np.random.default_rng(seed)
    masses = 10 ** generator.uniform(-9, 6, 4)
    share = 10 ** generator.uniform(-2, -1, 4)
    share[2] = 0.0 if seed % 2 else share[2]  # without inertia: the form with multipliers as unknowns
    found = []
    for method in METHODS:
        times = np.linspace(0, 0.5, 26)
        found.append(mbd.simulate(chain(masses, share), times, method=method, reltol=1e-9, abstol=1e-9))
        assert np.ptp(found[-1].energy.total) < 1e-6 * found[-1].energy.kinetic.max()
        assert found[-1].drift.position < 1e-13
    for motion in found[1:]:
        np.testing.assert_allclose(motion.q, found[0].q, atol=2e-5)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_redundant_rows_and_masses_over_fifteen_orders(method):
    """A parallelogram with three cranks: a pendulum with the mass of all, each at its place."""
    masses, length, angle = np.array([3e-9, 2e5, 1e-3, 4e-6]), 0.5, 0.7
    reach = length * np.array([np.cos(angle), np.sin(angle)])
    cranks = [
        mbd.Body(f"crank {k}", mass=m, inertia=m / 50, pose=(k + reach[0] / 2, reach[1] / 2, angle))
        for k, m in enumerate(masses[1:])
    ]
    rod = mbd.Body("rod", mass=masses[0], inertia=masses[0], pose=(reach[0] + 1, reach[1], 0))
    feet = [mbd.Revolute(f"foot {k}", mbd.ground.at(k, 0), c.at(-length / 2, 0)) for k, c in enumerate(cranks)]
    pins = [mbd.Revolute(f"pin {k}", c.at(length / 2, 0), rod.at(k - 1, 0)) for k, c in enumerate(cranks)]
    model = mbd.Mechanism(bodies=[*cranks, rod], joints=[*feet, *pins], forces=[mbd.Gravity()])
    times = np.linspace(0, 0.5, 26)
    motion = mbd.simulate(model, times, method=method)
    assert motion.statistics.formulation == "regularised"
    moment = masses[0] * length + masses[1:].sum() * length / 2
    inertia = masses[0] * length**2 + np.sum(masses[1:] * (length**2 / 4 + 1 / 50))
    reference = solve_ivp(
        lambda _, y: [y[1], -9.81 * moment / inertia * np.cos(y[0])],
        (0, 0.5), [angle, 0], t_eval=times, rtol=1e-11, atol=1e-12,
    ).y[0]  # fmt: skip
    for crank in cranks:
        np.testing.assert_allclose(motion[crank.phi], reference, atol=2e-6)


@pytest.mark.slow
@pytest.mark.parametrize("factor", [1e-9, 1e9])
def test_motion_without_forces_of_its_own_does_not_depend_on_the_unit_of_mass(factor):
    masses, share = np.array([1.0, 1e-6, 30.0]), np.array([0.05, 0.0, 0.08])
    times = np.linspace(0, 0.5, 26)
    one, other = (mbd.simulate(chain(f * masses, share), times) for f in (1.0, factor))
    np.testing.assert_allclose(one.q, other.q, atol=1e-5)


def test_a_crane_with_a_point_mass_is_planned_and_verified():
    trolley = mbd.Body("trolley", mass=20.0, inertia=1)
    load = mbd.Body("load", mass=50.0, inertia=1e-9, pose=(0, -3, 0))
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), trolley.at(0, 0))
    rope = mbd.Revolute("rope", trolley.at(0, 0), load.at(0, 3))
    f = mbd.Input("f", lower=-200, upper=200)
    forces = [mbd.Gravity(), mbd.Force("push", trolley.at(0, 0), (f, 0))]
    model = mbd.Mechanism(bodies=[trolley, load], joints=[rail, rope], forces=forces, inputs=[f])
    rest = [[trolley.x == x, rope.angle == 0, trolley.vx == 0, load.omega == 0] for x in (0, 4)]
    problem = mbd.OptimalControlProblem(
        model, duration=(1, 20), initial=rest[0], final=rest[1], terminal_cost=mbd.t, running_cost=1e-6 * f**2
    )
    assert mbd.optimize(problem, intervals=30).verify().final_error < 1e-4


def test_links_without_mass_that_are_stretched_by_a_falling_mass():
    """A point mass on two massless links falls freely until they are stretched, where a jerk would be needed."""
    upper = mbd.Body("upper", mass=0, inertia=0, pose=(0.5, 0, 0.1))
    lower = mbd.Body("lower", mass=1, inertia=0, pose=(1.5, 0, -0.2))
    pins = [
        mbd.Revolute("A", mbd.ground.at(0, 0), upper.at(-0.5, 0)),
        mbd.Revolute("B", upper.at(0.5, 0), lower.at(-0.5, 0)),
    ]
    swing = mbd.Mechanism([upper, lower], joints=pins, forces=[mbd.Gravity()])
    rest = [upper.phi == 0.1, lower.phi == -0.2, upper.omega == 0, lower.omega == 0]
    x, y = np.cos(0.1) + 0.5 * np.cos(0.2), np.sin(0.1) - 0.5 * np.sin(0.2)
    stretched = np.sqrt(2 * (y + np.sqrt(1.5**2 - x**2)) / 9.81)
    with pytest.raises(mbd.SimulationError, match="upper.phi, lower.phi move with hardly any mass") as stopped:
        mbd.simulate(swing, np.linspace(0, 1, 101), initial=rest)
    assert stopped.value.time == pytest.approx(stretched, rel=1e-3)
    fall = stopped.value.partial
    np.testing.assert_allclose(fall[lower.y], y - 9.81 / 2 * fall.t**2, atol=1e-7)


@pytest.mark.parametrize("what", ["reaction", "acceleration", "position"])
def test_events_of_a_rod_without_inertia(what):
    """Events are looked at on the motion, and do not change it: as the run without any."""
    crank, rod = mbd.Body("crank", 0.5, 1e-3, pose=(0.05, 0, 0)), mbd.Body("rod", 0.2, 0.0, pose=(0.25, 0, 0))
    slider = mbd.Body("slider", 1.0, 1e-3, pose=(0.4, 0, 0))
    joints = [
        mbd.Revolute("main", mbd.ground.at(0, 0), crank.at(-0.05, 0)),
        mbd.Revolute("pin", crank.at(0.05, 0), rod.at(-0.15, 0)),
        mbd.Revolute("wrist", rod.at(0.15, 0), slider.at(0, 0)),
        mbd.Translational("guide", mbd.ground.at(0, 0), slider.at(0, 0)),
    ]
    spring = mbd.RSDA("spring", mbd.ground.at(0, 0), crank.at(0, 0), stiffness=500)
    mechanism = mbd.Mechanism([crank, rod, slider], joints=joints, forces=[mbd.Gravity(), spring])
    asked = {"start": [crank.phi == 1.2, crank.omega == 0], "times": np.linspace(0, 0.1, 101)}
    watched = {"reaction": joints[2].reaction_on(slider).force[0], "acceleration": slider.ax, "position": slider.x}
    event = mbd.Event("e", watched[what] - (0.35 if what == "position" else 0))
    plain, found = (
        mbd.simulate(mechanism, asked["times"], initial=asked["start"], reltol=1e-10, events=events)
        for events in ((), (event,))
    )
    assert found.final[crank.phi] == pytest.approx(plain.final[crank.phi], abs=1e-7)
    values = plain[event.expression]
    assert len(found.events) == np.count_nonzero(values[1:] * values[:-1] < 0) > 2
