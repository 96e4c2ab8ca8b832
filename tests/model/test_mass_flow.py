"""Mass that leaves and enters: rockets, wagons under a hopper, chains that are picked up, sprinklers; closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import cumulative_simpson

import mbdcasadi as mbd

G = 9.81
TIGHT = {"reltol": 1e-10, "abstol": 1e-10}


def rocket(rate=-2.0, states=None, mass=40.0, **more):
    """A rocket with 60 kg of fuel that leaves with 2500 m/s, along its own axis."""
    fuel = mbd.StateVariable("fuel", 60.0)
    body = mbd.Body("rocket", mass=mass + fuel, inertia=10.0, **more)
    jet = mbd.MassFlow("jet", body.at(0, -1), rate=rate, velocity=(0, -2500.0))
    model = mbd.Mechanism([body], forces=[mbd.Gravity(), jet], states={fuel: -2.0} if states is None else states(fuel))
    return model, body, jet, fuel


@pytest.mark.parametrize("method", ["idas", "erk", "dop853", "bdf", "rosenbrock"])
def test_tsiolkovsky(method):
    """``v = w ln(m_0 / m) - g t`` by every method, upright; ``M`` is that of the moment."""
    model, body, _, fuel = rocket()
    run = mbd.simulate(model, np.linspace(0, 30, 7), method=method, **TIGHT)
    mass = 100 - 2 * run.t
    np.testing.assert_allclose(run[body.vy], 2500 * np.log(100 / mass) - G * run.t, atol=1e-5)
    np.testing.assert_allclose(run[mbd.equations(model).M][-1], np.diag([40, 40, 10]), atol=1e-7)
    np.testing.assert_allclose(run.energy.kinetic, 0.5 * mass * run[body.vy] ** 2, rtol=1e-9)
    np.testing.assert_allclose(run[fuel], 60 - 2 * run.t, atol=1e-9)


def test_its_jet_turns_with_it():
    """A leaning rocket is pushed along its axis."""
    model, body, jet, _ = rocket(pose=(0, 0, 0.3))
    state = mbd.assemble(model)
    np.testing.assert_allclose(state[jet.force], 5000 * np.array([-np.sin(0.3), np.cos(0.3)]))
    np.testing.assert_allclose(state[body.acceleration], [-50 * np.sin(0.3), 50 * np.cos(0.3) - G])


def wagon(pull, **more):
    """A wagon of 2 kg that is pulled and takes 0.5 kg/s from a hopper that stands still."""
    sand = mbd.StateVariable("sand")
    body = mbd.Body("wagon", mass=2.0 + sand, inertia=0.1)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), body.at(0, 0))
    hopper = mbd.MassFlow("hopper", body.at(0, 0.1), 0.5, (-body.vx, -3.0), frame="global")
    forces = [mbd.Gravity(), hopper, mbd.Force("pull", body.at(0, 0), (pull, 0))]
    return mbd.Mechanism([body], [guide], forces=forces, states={sand: 0.5}, **more), body, guide


def test_wagon_under_a_hopper():
    """``(m_0 + mdot t) v = F t``; the rails carry the weight and the momentum of what falls in, at 3 m/s."""
    model, body, guide = wagon(4.0)
    run = mbd.simulate(model, np.linspace(0, 5, 11), **TIGHT)
    mass = 2 + 0.5 * run.t
    np.testing.assert_allclose(run[body.vx], 4 * run.t / mass, atol=1e-8)
    np.testing.assert_allclose(run[guide.reaction_on(body).force][:, 1], mass * G + 1.5, rtol=1e-9)


def test_conveyor():
    """A belt that keeps its speed takes the force ``mdot v``, and twice the power that its load gains."""
    model, body, guide = wagon(0.0)
    drive = mbd.Driver("drive", guide.displacement, 2 * mbd.t)
    run = mbd.inverse_dynamics(model.replace(drivers=[drive]), np.linspace(0, 3, 4))
    np.testing.assert_allclose(run[drive.effort], 0.5 * 2, atol=1e-9)
    gained = 0.5 * 0.5 * 2**2
    np.testing.assert_allclose(run[drive.effort * body.vx], 2 * gained, atol=1e-9)


def test_a_chain_that_is_picked_up():
    """By a force F ``(y v)² = F/rho (y² - y_0²) - 2/3 g (y³ - y_0³)``; at constant speed ``F = rho (g y + v²)``."""
    density, force, start = 1.5, 40.0, 0.2
    length = mbd.StateVariable("length", start)
    end = mbd.Body("end", mass=density * length, inertia=0.1, pose=(0, start, 0))
    up = np.pi / 2
    guide = mbd.Translational("guide", mbd.ground.at(0, 0, up), end.at(0, 0, up))
    links = mbd.MassFlow("links", end.at(0, 0), density * end.vy, (0, -end.vy), frame="global")
    forces = [mbd.Gravity(), links]
    chain = mbd.Mechanism([end], [guide], forces=forces, states={length: end.vy})
    pulled = chain.replace(forces=[*forces, mbd.Force("pull", end.at(0, 0), (0, force))])
    run = mbd.simulate(pulled, np.linspace(0, 0.4, 9), **TIGHT)
    y = run[end.y]
    square = force / density * (y**2 - start**2) - 2 / 3 * G * (y**3 - start**3)
    assert y[-1] > 1.0
    np.testing.assert_allclose((y * run[end.vy]) ** 2, square, atol=1e-6)
    drive = mbd.Driver("drive", end.y, start + 2 * mbd.t)
    lifted = mbd.inverse_dynamics(chain.replace(drivers=[drive]), np.linspace(0, 1, 5))
    np.testing.assert_allclose(lifted[drive.effort], density * (G * lifted[end.y] + 2**2), rtol=1e-7)


def test_a_sprinkler():
    """Water enters at the nozzle from rest and leaves with w: the couple is ``r q (w - r omega)``; its mass stays."""
    arm = mbd.Body("arm", mass=2.0, inertia=0.3)
    axle = mbd.Revolute("axle", mbd.ground.at(0, 0), arm.at(0, 0))
    nozzle = arm.at(0.5, 0)
    flows = [
        mbd.MassFlow("in", nozzle, 0.4, -nozzle.velocity, frame="global"),
        mbd.MassFlow("out", nozzle, -0.4, (0, -6.0)),
    ]
    run = mbd.simulate(mbd.Mechanism([arm], [axle], forces=flows), np.linspace(0, 5, 6), **TIGHT)
    slow = 0.3 / (0.4 * 0.5**2)
    np.testing.assert_allclose(run[arm.omega], 6 / 0.5 * (1 - np.exp(-run.t / slow)), atol=1e-7)


def test_statics_and_linear_models_take_the_mass_of_the_state():
    """A filled bucket on a spring: ``k s = m g`` and ``omega² = k / m``, with the mass that is there."""
    water = mbd.StateVariable("water", 3.0)
    bucket = mbd.Body("bucket", mass=1.0 + water, inertia=0.1, pose=(0, -1, 0))
    up = np.pi / 2
    guide = mbd.Translational("guide", mbd.ground.at(0, 0, up), bucket.at(0, 0, up))
    spring = mbd.TSDA("spring", mbd.ground.at(0, 0), bucket.at(0, 0), stiffness=400, free_length=1.0)
    flow = mbd.MassFlow("flow", bucket.at(0, 0), -0.5 * water, (0, 0))
    model = mbd.Mechanism([bucket], [guide], forces=[mbd.Gravity(), spring, flow], states={water: -0.5 * water})
    rest = mbd.equilibrium(model)  # empty
    assert rest[bucket.y] == pytest.approx(-1 - G / 400, abs=1e-9)
    np.testing.assert_allclose(np.max(np.abs(rest.small_motions.eigenvalues.imag)), 20, rtol=1e-6)


@pytest.mark.slow
def test_least_time_to_a_speed():
    """With the burn as the input: all of it all the time, until ``m_0 exp(-v / w)`` is left."""
    burn = mbd.Input("burn", lower=0, upper=2)
    fuel = mbd.StateVariable("fuel", 60.0)
    body = mbd.Body("rocket", mass=40.0 + fuel, inertia=10.0)
    jet = mbd.MassFlow("jet", body.at(0, 0), -burn, (0, -2500.0))
    hold = [mbd.AbsoluteAngle("upright", body.at(0, 0)), mbd.AbsoluteX("line", body.at(0, 0))]
    model = mbd.Mechanism([body], hold, forces=[jet], inputs=[burn], states={fuel: -burn})
    start = [body.y == 0, body.vy == 0, fuel == 60]
    problem = mbd.OptimalControlProblem(
        model, duration=(1, 60), initial=start, final=[body.vy == 1000], terminal_cost=mbd.t
    )
    least = mbd.optimize(problem)
    assert least.cost == pytest.approx(50 * (1 - np.exp(-1000 / 2500)), rel=1e-6)
    assert least.verify().final_error < 1e-4


def test_impacts_and_friction_take_the_mass_of_the_moment():
    """A wagon that hits another after 4 s, with 4 kg: momentum stays; one that slides stops where ``mu g`` stops it."""
    sand = mbd.StateVariable("sand")
    first = mbd.Body("first", mass=2.0 + sand, inertia=0.1)
    other = mbd.Body("other", mass=3.0, inertia=0.1, pose=(5.0, 0, 0))
    guides = [mbd.Translational(f"guide {b.name}", mbd.ground.at(0, 0), b.at(0, 0)) for b in (first, other)]
    flow = mbd.MassFlow("flow", first.at(0, 0), 0.5, (0, 0))
    apart = mbd.Mechanism([first, other], guides, forces=[flow], states={sand: 0.5})
    before = mbd.simulate(apart, [0, 4], initial=[first.vx == 1, first.x == 0]).final
    latch = mbd.RelativeX("latch", first.at(1, 0), other.at(0, 0), 0.0)
    after = mbd.impact(apart.replace(joints=[*guides, latch]), before)
    assert after[other.vx] == pytest.approx(4 / 7, abs=1e-9) and after[sand] == pytest.approx(2)
    law = mbd.RigidContact("buffers", mbd.Circle(first.at(0, 0), 0.5), mbd.Circle(other.at(0, 0), 0.5), restitution=1.0)
    run = mbd.simulate(apart.replace(forces=[flow, law]), [0, 5], initial=[first.vx == 1, first.x == 0])
    assert run[other.vx][-1] == pytest.approx(2 * 4 / 7, abs=1e-7)
    rubs = mbd.JointFriction("rubs", guides[0], mbd.DryFriction(0.1))
    model = apart.replace(forces=[mbd.Gravity(), flow, rubs])
    run = mbd.simulate(model, [0, 2, 4], initial=[first.vx == 1, other.vx == 0])
    assert run[first.x][-1] == pytest.approx(1 / (2 * 0.1 * G), abs=1e-8)


def test_jet_damping_and_coriolis_of_a_flow_inside():
    """``omega`` falls as ``m^(l²/k² - 1)``; momentum of the rocket, of the flow inside and of what has left stays."""
    fuel, length, gyration, rate = mbd.StateVariable("fuel", 60.0), 1.0, 0.5, 2.0
    mass = 40.0 + fuel
    body = mbd.Body("rocket", mass=mass, inertia=gyration**2 * mass)
    jet = mbd.MassFlow("jet", body.at(0, -length), rate=-rate, velocity=(0, -25.0))
    damping = mbd.Torque("jet damping", body, (-rate * length**2 + rate * gyration**2) * body.omega)
    coriolis = mbd.Force("coriolis", body.at(0, 0), (-2 * rate * length * body.omega, 0), frame="body")
    model = mbd.Mechanism([body], forces=[jet, damping, coriolis], states={fuel: -rate})
    times = np.linspace(0, 25, 1001)
    run = mbd.simulate(model, times, initial=[body.omega == 0.3], **TIGHT)
    share = run[mass] / 100
    np.testing.assert_allclose(run[body.omega], 0.3 * share**3, atol=1e-9)
    along = body.axes @ mbd.vertcat(0, -1)
    nozzle = body.at(0, -length).velocity
    left = cumulative_simpson(rate * run[nozzle + 25.0 * along], x=times, axis=0, initial=0)
    momentum = run[mass * body.velocity + rate * length * along] + left
    np.testing.assert_allclose(momentum, np.tile(momentum[0], (times.size, 1)), atol=1e-5)


def test_mass_that_runs_out_is_named():
    """A rocket of fuel alone stops where nothing is left, whose acceleration grows without bound."""
    fuel = mbd.StateVariable("fuel", 6.0)
    rocket = mbd.Body("rocket", mass=fuel, inertia=1.0)
    jet = mbd.MassFlow("jet", rocket.at(0, 0), rate=-2.0, velocity=(0, -100.0))
    model = mbd.Mechanism([rocket], forces=[jet], states={fuel: -2.0})
    for method in ("idas", "dop853"):
        with pytest.raises(mbd.SimulationError, match="at t = (3|2.999.*) s: body 'rocket': mass must be"):
            mbd.simulate(model, np.linspace(0, 5, 11), method=method)


def test_refuses():
    """Rates that disagree, a flow at the ground, masses of anything else, impacts, an empty tank."""
    with pytest.raises(mbd.ModelError, match="'rocket': its mass changes by -3 kg/s, and its flows bring -2 kg/s"):
        rocket(states=lambda fuel: {fuel: -3.0})
    tank = mbd.Body("tank", mass=40.0, inertia=1.0)
    with pytest.raises(mbd.ModelError, match="'tank': its mass changes by 0 kg/s, and its flows bring -2 kg/s"):
        mbd.Mechanism([tank], forces=[mbd.MassFlow("leak", tank.at(0, 0), -2.0, (0, 0))])
    with pytest.raises(mbd.ModelError, match="'flow': the ground has no mass"):
        mbd.MassFlow("flow", mbd.ground.at(0, 0), 1.0, (0, 0))
    body = mbd.Body("b", mass=1.0 + mbd.t, inertia=1.0)
    with pytest.raises(mbd.ExpressionError, match="'b': mass may contain parameters and states only"):
        mbd.Mechanism([body])
    late, _, _, fuel = rocket()
    with pytest.raises(mbd.SimulationError, match="'rocket': mass must be at least 0, got -10.0"):
        mbd.simulate(late, [0, 1], initial=[fuel == -50])
