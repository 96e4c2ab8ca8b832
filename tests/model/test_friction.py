"""Friction laws and friction in joints, against closed forms and integrations in one coordinate."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import mbdcasadi as mbd

G = 9.81
LAWS = {
    "Coulomb": mbd.Coulomb(0.3, 1e-3),
    "Stribeck": mbd.Stribeck(0.3, 0.5, 0.05, 1e-3),
    "Viscous": mbd.Viscous(4.0),
    "sum": mbd.Coulomb(0.2, 1e-3) + mbd.Viscous(2.0),
    "LuGre": mbd.LuGre(0.3, 0.4, 0.01, 1e4, damping=10.0),
}


def sledge(law, slope=0.0, mass=3.0, force=0.0, **more):
    """A block on an inclined guide."""
    block = mbd.Body("block", mass=mass, inertia=0.02, pose=(0, 0, -slope))
    guide = mbd.Translational("guide", mbd.ground.at(0, 0, angle=-slope), block.at(0, 0))
    rub = mbd.JointFriction("rub", guide, law, **more)
    push = mbd.Force("push", block.at(0, 0), (force, 0), frame="body")
    return block, guide, rub, mbd.Mechanism(bodies=[block], joints=[guide], forces=[mbd.Gravity(), rub, push])


# --- the laws ------------------------------------------------------------------------------
def values(law, speeds, load=10.0):
    """Force over speed."""
    v = ca.SX.sym("v")
    return (
        ca.Function("F", [v], [law.resistance("x", v, ca.SX(load)).force])(np.asarray(speeds)[None, :]).full().ravel()
    )


def test_laws_over_speed():
    """Sliding values, the static peak, oddness, and sums."""
    v = np.array([-2.0, -0.05, 0.02, 0.3])
    np.testing.assert_allclose(values(LAWS["Coulomb"], v), -3 * np.sign(v))
    wanted = -10 * (0.3 + 0.2 * np.exp(-((v / 0.05) ** 2))) * np.sign(v)
    np.testing.assert_allclose(values(LAWS["Stribeck"], v), wanted)
    np.testing.assert_allclose(values(LAWS["Viscous"], v), -4 * v)
    np.testing.assert_allclose(values(LAWS["sum"], v), -2 * np.sign(v) - 2 * v)
    assert LAWS["sum"].velocity_tolerance == 1e-3


@pytest.mark.parametrize("name", LAWS)
def test_derivatives_are_finite_at_rest(name):
    """First and second derivatives by speed and load, at zero of both."""
    v, load = ca.SX.sym("v"), ca.SX.sym("N")
    found = LAWS[name].resistance("x", v, load)
    state = list(found.rates)
    hessian = ca.hessian(found.force, ca.vertcat(v, load))
    function = ca.Function("d", [v, load, *state], [hessian[0], hessian[1]])
    for result in function(0, 0, *[0] * len(state)):
        assert np.all(np.isfinite(result.full()))


# --- on a guide -------------------------------------------------------------------------------
def test_slides_and_stops():
    """Way and time until rest on an incline; then it creeps at the speed that the law says."""
    slope, mu, speed, tolerance = np.radians(20), 0.5, 2.0, 1e-5
    block, guide, rub, mechanism = sledge(mbd.Coulomb(mu, tolerance), slope)
    motion = mbd.simulate(mechanism, np.linspace(0, 3, 301), initial=[guide.displacement == 0, guide.speed == speed])
    deceleration = G * (mu * np.cos(slope) - np.sin(slope))
    time = speed / deceleration
    assert motion.at([time])[guide.displacement][0] == pytest.approx(speed**2 / 2 / deceleration, rel=1e-5)
    creep = tolerance * np.arctanh(np.tan(slope) / mu)
    assert motion[guide.speed][-1] == pytest.approx(creep, rel=1e-3)
    assert motion[rub.force][-1] == pytest.approx(-3 * G * np.sin(slope), rel=1e-4)
    assert motion[rub.load][-1] == pytest.approx(3 * G * np.cos(slope), rel=1e-9)
    np.testing.assert_allclose(motion[rub.power], motion[rub.force] * motion[guide.speed])
    assert motion[block.alpha][-1] == pytest.approx(0, abs=1e-9)
    assert any("abstol" in note for note in motion.statistics.notes) is False


@pytest.mark.slow
def test_bristles_hold_without_creep():
    """LuGre on the incline: rest for good, displaced by the bristles that carry the weight."""
    slope, stiffness = np.radians(15), 1e5
    law = mbd.LuGre(0.4, 0.5, 0.01, stiffness, damping=300.0)
    _, guide, rub, mechanism = sledge(law, slope)
    motion = mbd.simulate(mechanism, np.linspace(0, 4, 81), initial=[guide.displacement == 0, guide.speed == 0])
    held = np.tan(slope) / stiffness
    late = motion.t > 2
    assert np.abs(motion[guide.speed][late]).max() < 1e-9
    # the elastic way, and what slides on before the bristles are bent
    assert held < motion[guide.displacement][-1] < 3 * held
    assert motion[rub.force][-1] == pytest.approx(-3 * G * np.sin(slope), rel=1e-6)


def test_bristles_slide_at_the_sliding_coefficient():
    """LuGre at speed is Coulomb friction."""
    law = mbd.LuGre(0.3, 0.5, 0.01, 1e5, damping=100.0)
    _, guide, rub, mechanism = sledge(law, 0.0)
    motion = mbd.simulate(mechanism, np.linspace(0, 0.5, 26), initial=[guide.displacement == 0, guide.speed == 3])
    assert motion[guide.speed][-1] == pytest.approx(3 - 0.3 * G * 0.5, abs=1e-4)
    assert motion[rub.force][-1] == pytest.approx(-0.3 * 3 * G, rel=1e-6)


@pytest.mark.parametrize("mu, push", [(0.1, 10.0), (0.1, -10.0), (0.25, -10.0)])
def test_a_drawer_is_loaded_at_its_ends(mu, push):
    """The couple of the inertia loads the guide: ``m a = F - κ m |a|``, ``κ = 2 μ e/L``, while it slides forth."""
    lever, length, mass = 0.3, 0.2, 2.0
    block = mbd.Body("drawer", mass=mass, inertia=0.1, pose=(0, -lever, 0))
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, lever))
    rub = mbd.JointFriction("rub", guide, mbd.Coulomb(mu, 1e-4), length=length)
    mechanism = mbd.Mechanism(
        bodies=[block], joints=[guide], forces=[mbd.Force("push", block.at(0, lever), (push, 0)), rub]
    )
    motion = mbd.simulate(mechanism, np.linspace(0, 0.01, 3), initial=[guide.displacement == 0, guide.speed == 1.0])
    kappa = 2 * mu * lever / length
    wanted = push / mass / (1 + kappa * np.sign(push))
    np.testing.assert_allclose(motion[block.ax], wanted, rtol=1e-9)
    np.testing.assert_allclose(motion[rub.load], 2 * mass * abs(wanted) * lever / length, rtol=1e-9)


@pytest.mark.parametrize("push", [10.0, -10.0])
def test_jamming_is_told(push):
    """With κ above one there are two motions of the drawer or none: neither is integrated."""
    block = mbd.Body("drawer", mass=2.0, inertia=0.1, pose=(0, -0.3, 0))
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0.3))
    rub = mbd.JointFriction("rub", guide, mbd.Coulomb(0.4, 1e-3), length=0.2)
    mechanism = mbd.Mechanism(
        bodies=[block], joints=[guide], forces=[mbd.Force("push", block.at(0, 0.3), (push, 0)), rub]
    )
    with pytest.raises(mbd.MechanismError, match="jams"):
        mbd.simulate(mechanism, np.linspace(0, 1, 11), initial=[guide.displacement == 0, guide.speed == 1.0])


def test_preload_and_a_load_of_its_own():
    """Both add what they say: deceleration ``μ (g + P/m)``, and ``μ N/m`` whatever the weight is."""
    start = [3.0]
    _, guide, _, mechanism = sledge(mbd.Coulomb(0.2, 1e-4), preload=12.0)
    motion = mbd.simulate(mechanism, np.linspace(0, 0.5, 6), initial=[guide.displacement == 0, guide.speed == start[0]])
    assert motion[guide.speed][-1] == pytest.approx(3 - 0.2 * (G + 12 / 3) * 0.5, abs=1e-6)
    block = mbd.Body("block", mass=3.0, inertia=0.02)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    seal = mbd.LoadIndependentFriction("seal", guide, mbd.Coulomb(0.2, 1e-4), load=40.0)
    mechanism = mbd.Mechanism(bodies=[block], joints=[guide], forces=[mbd.Gravity(), seal])
    motion = mbd.simulate(mechanism, np.linspace(0, 0.5, 6), initial=[guide.displacement == 0, guide.speed == 3.0])
    assert motion[guide.speed][-1] == pytest.approx(3 - 0.2 * 40 / 3 * 0.5, abs=1e-6)
    assert motion[seal.force][2] == pytest.approx(-8.0)


# --- in a pin -----------------------------------------------------------------------------------
def test_journal_runs_down():
    """A rotor in its bearing: ``J ω' = -μ r m g`` (and drag), to rest at the time of the closed form."""
    mass, inertia, radius, mu, rate = 8.0, 0.05, 0.015, 0.12, 60.0
    rotor = mbd.Body("rotor", mass=mass, inertia=inertia)
    bearing = mbd.Revolute("bearing", mbd.ground.at(0, 0), rotor.at(0, 0))
    rub = mbd.JointFriction("rub", bearing, mbd.Coulomb(mu, 1e-5), radius=radius)
    mechanism = mbd.Mechanism(bodies=[rotor], joints=[bearing], forces=[mbd.Gravity(), rub])
    stop = inertia * rate / (mu * radius * mass * G)
    motion = mbd.simulate(mechanism, np.linspace(0, 1.2 * stop, 121), initial=[rotor.phi == 0, rotor.omega == rate])
    sliding = motion.t < stop
    np.testing.assert_allclose(motion[rotor.omega][sliding], rate * (1 - motion.t[sliding] / stop), atol=2e-3)
    np.testing.assert_allclose(motion[rub.torque][motion.t < 0.9 * stop], -mu * radius * mass * G, rtol=1e-9)
    assert motion[rotor.phi][-1] == pytest.approx(rate * stop / 2, rel=1e-5)
    assert np.abs(motion[rotor.omega][motion.t > 1.01 * stop]).max() < 1e-8


@pytest.mark.slow
def test_unbalanced_rotor_feels_its_own_swing():
    """The load is the resultant with the inertia in it: against SciPy in one coordinate."""
    mass, inertia, radius, mu, e = 2.0, 0.03, 0.03, 0.2, 0.04
    rotor = mbd.Body("rotor", mass=mass, inertia=inertia, pose=(e, 0, 0))
    bearing = mbd.Revolute("bearing", mbd.ground.at(0, 0), rotor.at(-e, 0))
    rub = mbd.JointFriction("rub", bearing, mbd.Coulomb(mu, 1e-3) + mbd.Viscous(3.0), radius=radius)
    mechanism = mbd.Mechanism(bodies=[rotor], joints=[bearing], forces=[mbd.Gravity(), rub])
    times = np.linspace(0, 2, 101)
    motion = mbd.simulate(mechanism, times, initial=[rotor.phi == 0, rotor.omega == 40])

    def rate(_, state):
        angle, omega = state
        torque = 0.0
        for _ in range(60):
            alpha = (-mass * G * e * np.cos(angle) + torque) / (inertia + mass * e**2)
            ax = e * (-alpha * np.sin(angle) - omega**2 * np.cos(angle))
            ay = e * (alpha * np.cos(angle) - omega**2 * np.sin(angle)) + G
            load = mass * np.hypot(ax, ay)
            torque = -radius * (mu * load * np.tanh(radius * omega / 1e-3) + 3.0 * radius * omega)
        return [omega, alpha]

    wanted = solve_ivp(rate, (0, 2), [0, 40], method="LSODA", t_eval=times, rtol=1e-10, atol=1e-11).y
    np.testing.assert_allclose(motion[rotor.phi], wanted[0], atol=1e-5)
    np.testing.assert_allclose(motion[rotor.omega], wanted[1], atol=1e-4)


# --- energy ---------------------------------------------------------------------------------------
@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_energy_never_grows(seed):
    """A double pendulum and a slider with random pins, masses and laws: the energy falls at every output."""
    random = np.random.default_rng(seed)
    law = [LAWS["Coulomb"], LAWS["Stribeck"], LAWS["sum"]][seed % 3]
    length = random.uniform(0.3, 0.8, 2)
    mass = random.uniform(0.3, 3, 2)
    first = mbd.Body("first", mass=mass[0], inertia=mass[0] * length[0] ** 2 / 12, pose=(length[0] / 2, 0, 0))
    second = mbd.Body(
        "second", mass=mass[1], inertia=mass[1] * length[1] ** 2 / 12, pose=(length[0] + length[1] / 2, 0, 0)
    )
    pins = [
        mbd.Revolute("upper", mbd.ground.at(0, 0), first.at(-length[0] / 2, 0)),
        mbd.Revolute("lower", first.at(length[0] / 2, 0), second.at(-length[1] / 2, 0)),
    ]
    rubs = [mbd.JointFriction(f"rub {p.name}", p, law, radius=random.uniform(0.005, 0.03)) for p in pins]
    mechanism = mbd.Mechanism(bodies=[first, second], joints=pins, forces=[mbd.Gravity(), *rubs])
    start = [first.phi == random.uniform(-1, 1), second.phi == random.uniform(-1, 1)]
    start += [first.omega == random.uniform(-5, 5), second.omega == random.uniform(-5, 5)]
    motion = mbd.simulate(mechanism, np.linspace(0, 2, 201), initial=start)
    energy = motion.energy.total
    size = np.ptp(energy) + motion.energy.kinetic.max()
    assert np.diff(energy).max() <= 2e-7 * size
    assert energy[-1] < energy[0] - 1e-3 * size
    for rub in rubs:
        assert motion[rub.power].max() <= 1e-12


def lugre_dissipation(speed, pull, mu, static, stribeck, damping):
    """Power that LuGre takes for each newton of load, at a speed and ``u = σ0 z``, from its definition."""
    near = np.exp(-((speed / stribeck) ** 2))
    g = mu + (static - mu) * near
    rate = speed - np.abs(speed) * pull / g  # of the deflection
    return speed * (pull + damping * near * rate) - pull * rate


@pytest.mark.parametrize("share, passive", [(0.99, True), (1.2, False)])
def test_where_bristles_are_passive(share, passive):
    """``σ1 v_s <= 4 √(2e) μ`` takes energy at every speed and deflection; above it some give it (μ_s = μ)."""
    mu, stribeck = 0.3, 0.02
    damping = share * 4 * np.sqrt(2 * np.e) * mu / stribeck
    speed, pull = np.meshgrid(np.linspace(-0.1, 0.1, 801), np.linspace(-3 * mu, 3 * mu, 801))
    least = lugre_dissipation(speed, pull, mu, mu, stribeck, damping).min()
    assert (least >= -1e-15) == passive
    # with a larger static friction there is more room, and the condition is enough
    if passive:
        assert lugre_dissipation(speed, pull, mu, 0.5, stribeck, damping).min() >= -1e-15


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_energy_never_grows_with_bristles(seed):
    """A double pendulum with brakes of constant load: energy and that of the bent bristles fall together."""
    random = np.random.default_rng(seed)
    mu, static, stribeck = 0.3, 0.45, random.uniform(0.005, 0.02)
    stiffness, load, radius = random.uniform(1e3, 1e5), random.uniform(5, 40), 0.03
    damping = random.uniform(0, 1) * 4 * np.sqrt(2 * np.e) * mu / stribeck
    law = mbd.LuGre(mu, static, stribeck, stiffness, damping=damping)
    first = mbd.Body("first", mass=1.0, inertia=0.02, pose=(0.25, 0, 0))
    second = mbd.Body("second", mass=0.7, inertia=0.01, pose=(0.7, 0, 0))
    pins = [
        mbd.Revolute("upper", mbd.ground.at(0, 0), first.at(-0.25, 0)),
        mbd.Revolute("lower", first.at(0.25, 0), second.at(-0.2, 0)),
    ]
    brakes = [mbd.LoadIndependentFriction(f"brake {p.name}", p, law, load, radius=radius) for p in pins]
    mechanism = mbd.Mechanism(bodies=[first, second], joints=pins, forces=[mbd.Gravity(), *brakes])
    start = [first.phi == random.uniform(-1, 1), second.phi == random.uniform(-1, 1)]
    start += [first.omega == random.uniform(-5, 5), second.omega == random.uniform(-5, 5)]
    motion = mbd.simulate(mechanism, np.linspace(0, 2, 401), initial=start)
    bent = sum(load * stiffness * motion[z] ** 2 / 2 for z in mechanism.states)
    energy = motion.energy.total + bent
    size = np.ptp(motion.energy.total) + motion.energy.kinetic.max()
    assert np.diff(energy).max() <= 2e-7 * size
    assert energy[-1] < energy[0] - 1e-3 * size


def test_effort_of_a_driven_slide():
    """What drives a rough block: its inertia and friction under its weight and a preload."""
    block, guide, _, mechanism = sledge(mbd.Coulomb(0.2, 1e-4), preload=5.0)
    driver = mbd.Driver("drive", guide.displacement, mbd.t + mbd.t**2)
    run = mbd.inverse_dynamics(mechanism.replace(drivers=[driver]), np.linspace(0, 1, 11))
    np.testing.assert_allclose(run[driver.effort], 3 * 2 + 0.2 * (3 * G + 5), rtol=1e-9)
    assert run[block.vx][-1] == pytest.approx(3.0)


# --- a pin in a slot -----------------------------------------------------------------------
def in_slot(kind, law, turned=0.0):
    """A pin in a straight slot on an incline, held by the line or by a curve."""
    pin = mbd.Body("pin", mass=1.5, inertia=0.01)
    frame = mbd.ground.at(0, 0, angle=-np.radians(30))
    if kind == "line":
        slot = mbd.PointOnLine("slot", frame, pin.at(0, 0, angle=turned))
    else:
        slot = mbd.PointOnCurve("slot", frame, pin.at(0, 0), mbd.Curve(lambda s: (2 * s, 0 * s), -9, 9))
    rub = mbd.JointFriction("rub", slot, law)
    return pin, slot, rub, mbd.Mechanism([pin], joints=[slot], forces=[mbd.Gravity(), rub])


@pytest.mark.parametrize("kind", ["line", "curve"])
@pytest.mark.parametrize("law", [mbd.DryFriction(0.2), mbd.Coulomb(0.2, 1e-6)])
def test_a_pin_slides_in_a_slot(kind, law):
    """a = g (sin - mu cos); the load is the normal force, and what is lost is the work of the friction."""
    pin, slot, rub, model = in_slot(kind, law, turned=0.7)
    run = mbd.simulate(model, np.linspace(0, 1, 101), initial=[pin.vx == 0, pin.omega == 0])
    a = G * (np.sin(np.radians(30)) - 0.2 * np.cos(np.radians(30)))
    np.testing.assert_allclose(np.hypot(run[pin.x], run[pin.y]), a * run.t**2 / 2, atol=2e-5)
    np.testing.assert_allclose(np.abs(run[slot.normal_force]), 1.5 * G * np.cos(np.radians(30)), rtol=1e-6)
    np.testing.assert_allclose(run[rub.force][1:], -0.2 * 1.5 * G * np.cos(np.radians(30)), rtol=1e-4)
    lost = np.trapezoid(run[rub.power], run.t)
    assert lost == pytest.approx(run.energy.total[-1] - run.energy.total[0], rel=1e-3)


@pytest.mark.parametrize("kind", ["line", "curve"])
def test_a_pin_sticks_in_a_slot_up_to_its_limit(kind):
    """On an incline below the angle of friction it stays; it breaks away under the force that this asks for."""
    pin, _, _, model = in_slot(kind, mbd.DryFriction(0.5, static_coefficient=0.7))
    model = model.replace(forces=[*model.forces, mbd.Force("pull", pin.at(0, 0), (mbd.t, 0))])
    run = mbd.simulate(model, np.linspace(0, 5, 51), initial=[pin.vx == 0, pin.omega == 0])
    (event,) = run.events
    angle, weight = np.radians(30), 1.5 * G
    # it draws down the slot, and off it
    pull = weight * (0.7 * np.cos(angle) - np.sin(angle)) / (np.cos(angle) + 0.7 * np.sin(angle))
    assert event.name == "rub breaks away" and event.t == pytest.approx(pull, abs=1e-7)
    assert np.ptp(run[pin.x][run.t < event.t]) < 1e-9 and run[pin.vx][-1] > 0


@pytest.mark.parametrize("speed", [1.5, -1.5])
def test_a_bead_on_a_round_wire_slows_down_by_its_own_pull(speed):
    """Without gravity its speed falls by exp(-mu phi), whichever way it goes."""
    bead = mbd.Body("bead", mass=0.3, inertia=1e-4, pose=(0.5, 0, 0))
    ring = mbd.Curve(lambda s: (0.5 * mbd.cos(s), 0.5 * mbd.sin(s)), 0, 2 * np.pi, closed=True)
    wire = mbd.PointOnCurve("wire", mbd.ground.at(0, 0), bead.at(0, 0), ring)
    rub = mbd.JointFriction("rub", wire, mbd.DryFriction(0.25))
    model = mbd.Mechanism([bead], joints=[wire], forces=[rub])
    run = mbd.simulate(model, np.linspace(0, 2, 41), initial=[bead.vy == speed, bead.omega == 0])
    now = 1.5 / (1 + 0.25 * 1.5 / 0.5 * run.t)
    np.testing.assert_allclose(np.hypot(run[bead.vx], run[bead.vy]), now, rtol=1e-6)
    turned = np.log(1 + 0.25 * 1.5 / 0.5 * run.t) / 0.25
    np.testing.assert_allclose(np.sign(speed) * run[wire.parameter], turned, atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["line", "curve"])
def test_least_effort_against_dry_friction_in_a_slot(kind):
    """From rest to rest over 1 m in 1 s: u = m (6 - 12 t) + mu m g."""
    pin = mbd.Body("pin", mass=1.5, inertia=0.01)
    push = mbd.Input("push", lower=-20, upper=20)
    slot = mbd.PointOnLine("slot", mbd.ground.at(0, 0), pin.at(0, 0))
    if kind == "curve":
        slot = mbd.PointOnCurve("slot", mbd.ground.at(0, 0), pin.at(0, 0), mbd.Curve(lambda s: (s, 0 * s), -3, 3))
    level = mbd.AbsoluteAngle("level", pin.at(0, 0))
    rub = mbd.JointFriction("rub", slot, mbd.DryFriction(0.2))
    forces = [mbd.Gravity(), rub, mbd.Force("push", pin.at(0, 0), (push, 0))]
    model = mbd.Mechanism([pin], joints=[slot, level], forces=forces, inputs=[push])
    ends = {"initial": [pin.x == 0, pin.vx == 0], "final": [pin.x == 1.0, pin.vx == 0]}
    best = mbd.optimize(mbd.OptimalControlProblem(model, duration=1.0, running_cost=push**2, **ends))
    assert best.cost == pytest.approx(1.5**2 * 12 + (0.2 * 1.5 * G) ** 2, rel=1e-6)
    assert best.verify().final_error < 1e-6


# --- refusals ----------------------------------------------------------------------------------------
def test_refuses():
    """What is missing, out of its limits, or of the wrong kind; each by name."""
    block = mbd.Body("block", mass=1, inertia=1)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), block.at(0, 0))
    law = LAWS["Coulomb"]
    with pytest.raises(mbd.ModelError, match="'rub'.*radius"):
        mbd.JointFriction("rub", pin, law)
    with pytest.raises(mbd.ModelError, match="'rub'.*slides"):
        mbd.JointFriction("rub", guide, law, radius=0.1)
    with pytest.raises(mbd.ModelError, match="'rub'.*turns"):
        mbd.JointFriction("rub", pin, law, radius=0.1, length=1)
    with pytest.raises(mbd.ModelError, match="'rub'.*law"):
        mbd.JointFriction("rub", guide, 0.3)
    with pytest.raises(mbd.ModelError, match="Revolute or a Translational"):
        mbd.JointFriction("rub", mbd.Weld("weld", mbd.ground.at(0, 0), block.at(0, 0)), law)
    with pytest.raises(mbd.ModelError, match=r"'rub'.*preload.*-3"):
        mbd.JointFriction("rub", guide, law, preload=-3)
    with pytest.raises(mbd.ModelError, match=r"coefficient.*-0.1"):
        mbd.Coulomb(-0.1, 1e-3)
    with pytest.raises(mbd.ModelError, match=r"velocity_tolerance.*above 0"):
        mbd.Coulomb(0.1, 0)
    with pytest.raises(mbd.ModelError, match="static_coefficient"):
        mbd.Stribeck(0.5, 0.3, 0.1, 1e-3)
    with pytest.raises(mbd.ModelError, match="static peak"):
        mbd.Stribeck(0.3, 0.5, 0.1, 0.05)
    with pytest.raises(mbd.ModelError, match=r"\.torque"):
        _ = mbd.JointFriction("rub", pin, law, radius=0.1).force
    with pytest.raises(mbd.ModelError, match=r"\.force"):
        _ = mbd.JointFriction("rub", guide, law).torque


def test_tolerance_follows_the_velocity_tolerance():
    """A narrow law gets the absolute tolerance that it needs, and says so; one too narrow is refused."""
    _, guide, _, mechanism = sledge(mbd.Coulomb(0.3, 1e-7))
    start = [guide.displacement == 0, guide.speed == 1.0]
    motion = mbd.simulate(mechanism, np.linspace(0, 0.6, 7), initial=start)
    assert motion[guide.displacement][-1] == pytest.approx(1 / (2 * 0.3 * G), rel=1e-6)
    assert any("abstol = 1.0e-10" in note for note in motion.statistics.notes)
    _, guide, _, mechanism = sledge(mbd.Coulomb(0.3, 1e-11))
    start = [guide.displacement == 0, guide.speed == 1.0]
    with pytest.raises(mbd.SimulationError, match=r"'rub'.*velocity tolerance 1e-11"):
        mbd.simulate(mechanism, np.linspace(0, 0.6, 7), initial=start)


def test_coefficient_as_a_parameter():
    """One model for several coefficients, checked against its limits at each."""
    mu = mbd.Parameter("mu", 0.3)
    block = mbd.Body("block", mass=1, inertia=1)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    rub = mbd.JointFriction("rub", guide, mbd.Coulomb(mu, 1e-4))
    mechanism = mbd.Mechanism(bodies=[block], joints=[guide], forces=[mbd.Gravity(), rub], parameters=[mu])
    start = [guide.displacement == 0, guide.speed == 2.0]
    for value in (0.1, 0.4):
        motion = mbd.simulate(mechanism, [0, 0.2], initial=start, parameters={mu: value})
        assert motion[guide.speed][-1] == pytest.approx(2 - value * G * 0.2, abs=1e-6)
    with pytest.raises(mbd.ModelError, match="coefficient"):
        mbd.simulate(mechanism, [0, 0.2], initial=start, parameters={mu: -0.1})


@pytest.mark.parametrize("length, mass, time", [(1e-5, 1e-9, 1e-3), (1e-6, 1e-12, 1e-4), (1e5, 1e12, 1.0)])
def test_friction_by_the_load_of_small_pins(length, mass, time):
    """The friction couple of the pin of a small pendulum: forces of nanonewtons balance as those of newtons do."""
    arm = mbd.Body("arm", mass=mass, inertia=0.1 * mass * length**2, pose=(0.5 * length, 0, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), arm.at(-0.5 * length, 0))
    law = mbd.Coulomb(0.3, velocity_tolerance=1e-4 * length / time)
    rub = mbd.JointFriction("rub", pin, law, radius=0.05 * length)
    weight = mbd.Gravity((0, -9.81 * length / time**2))
    mechanism = mbd.Mechanism([arm], joints=[pin], forces=[weight, rub])
    state = mbd.assemble(mechanism, [pin.angle == 0.4, arm.omega == 2 / time])
    alpha, load = state[arm.alpha] * time**2, state[mbd.norm(pin.reaction_on(arm).force)] * time**2 / (mass * length)
    # balance of the arm about the pin, and of its centre, in its own units
    assert 0.35 * alpha == pytest.approx(-0.5 * 9.81 * np.cos(0.4) - 0.3 * 0.05 * load, rel=1e-12)
    centre = 0.5 * np.array([-np.sin(0.4) * alpha - 4 * np.cos(0.4), np.cos(0.4) * alpha - 4 * np.sin(0.4)])
    assert load == pytest.approx(np.hypot(centre[0], centre[1] + 9.81), rel=1e-12)


def test_friction_of_a_light_part_beside_a_heavy_one():
    """A gram beside ten thousand tons: its friction is none the less that of its own load."""
    heavy = mbd.Body("heavy", mass=1e7, inertia=1e7)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), heavy.at(0, 0))
    part = mbd.Body("part", mass=1e-3, inertia=1e-7, pose=(0.01, 0, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), part.at(-0.01, 0))
    rub = mbd.JointFriction("rub", pin, mbd.Coulomb(0.5, velocity_tolerance=1e-6), radius=1e-3)
    both = mbd.Mechanism([heavy, part], [rail, pin], forces=[mbd.Gravity(), rub])
    found = mbd.assemble(both, [pin.angle == 0, part.omega == 100])[part.alpha]

    def balance(alpha):
        """Of the couples about the pin, whose load is that of the centre's acceleration and weight."""
        load = 1e-3 * np.hypot(-0.01 * 100**2, 0.01 * alpha + 9.81)
        return (1e-7 + 1e-3 * 0.01**2) * alpha + 1e-3 * 9.81 * 0.01 + 0.5 * 1e-3 * load

    assert found == pytest.approx(brentq(balance, -1e4, 0, xtol=1e-12), rel=1e-10)
