"""Field forces, bushings, stops, cylinders, motors, controllers, laws from data: virtual work against power."""

import numpy as np
import pytest
from differences import power_of, value_of

import mbdcasadi as mbd

G = 9.81


@pytest.fixture(params=range(3))
def rng(request):
    """Random states."""
    return np.random.default_rng(request.param)


def forces_at(mechanism, q, v, **more):
    """Q of a mechanism at a state (n,)."""
    return value_of(mechanism, mbd.equations(mechanism).Q, q, v, **more).ravel()


# --- fields -----------------------------------------------------------------------------------
PLATE = mbd.Rectangle(0.6, 0.2) - mbd.Disc(0.05, center=(0.2, 0.0))


def test_uniform_field_is_gravity(rng):
    """Whatever the shape: m g at the centre of mass, no moment."""
    body = mbd.Body.from_shape("plate", PLATE, mass=3.0)
    field = mbd.FieldForce("field", body, lambda point: (1.0, -G))
    q, v = rng.normal(size=3), rng.normal(size=3)
    np.testing.assert_allclose(forces_at(mbd.Mechanism([body], forces=[field]), q, v), [3, -3 * G, 0], atol=1e-12)


def test_centrifugal_field(rng):
    """Ω² r: m Ω² r_G, and no moment about the centre of mass."""
    body = mbd.Body.from_shape("plate", PLATE, mass=3.0)
    field = mbd.FieldForce("field", body, lambda point: 4.0 * point.position)
    q, v = rng.normal(size=3), rng.normal(size=3)
    Q = forces_at(mbd.Mechanism([body], forces=[field]), q, v)
    np.testing.assert_allclose(Q, [*(3 * 4 * q[:2]), 0], atol=1e-12)


def test_field_that_grows_with_the_height():
    """f = (0, -k y) on a rod at the angle φ: the couple is -k m L² sin φ cos φ / 12, the stiffness of its tilt."""
    rod = mbd.Body.from_shape("rod", mbd.Rod(2.0), mass=1.5)
    field = mbd.FieldForce("field", rod, lambda point: (0, -7.0 * point.y), order=2)
    mechanism = mbd.Mechanism([rod], forces=[field])
    phi, y = 0.6, 0.4
    Q = forces_at(mechanism, np.array([0.1, y, phi]), np.zeros(3))
    moment = -7.0 * 1.5 * 4 / 12 * np.sin(phi) * np.cos(phi)
    np.testing.assert_allclose(Q, [0, -7 * 1.5 * y, moment], atol=1e-13)
    assert value_of(mechanism, field.torque, np.array([0.1, y, phi]), np.zeros(3)) == pytest.approx(moment)


def test_inverse_square_field_on_a_rod_along_the_ray():
    """μ m / (r² - L²/4), more than at the centre alone: the integral in closed form."""
    rod = mbd.Body.from_shape("rod", mbd.Rod(1.0), mass=2.0)
    field = mbd.FieldForce("field", rod, lambda p: -5.0 * p.position / mbd.norm(p) ** 3, order=10)
    Q = forces_at(mbd.Mechanism([rod], forces=[field]), np.array([1.5, 0, 0]), np.zeros(3))
    np.testing.assert_allclose(Q, [-5 * 2 / (1.5**2 - 0.25), 0, 0], rtol=1e-9, atol=1e-12)


def test_drag_spread_over_a_plate(rng):
    """f = -c v of each point: power -c (m v² + J ω²), exactly."""
    body = mbd.Body.from_shape("plate", PLATE, mass=3.0)
    field = mbd.FieldForce("drag", body, lambda point: -0.8 * point.velocity, order=2)
    q, v = rng.normal(size=3), rng.normal(size=3)
    wanted = -0.8 * (3 * (v[0] ** 2 + v[1] ** 2) + body.inertia * v[2] ** 2)
    assert power_of(mbd.Mechanism([body], forces=[field]), q, v) == pytest.approx(wanted)


def test_field_on_bodies_that_are_not_spread_evenly():
    """No shape; centre of mass elsewhere; another inertia; not a function; a strange order."""
    even = mbd.Body("even", 1.0, 1.0 / 12, shape=mbd.Rod(1.0))
    mbd.FieldForce("f", even, lambda p: (0, 0))
    with pytest.raises(mbd.ModelError, match="'f'.*body 'bare' has no shape"):
        mbd.FieldForce("f", mbd.Body("bare", 1, 1), lambda p: (0, 0))
    with pytest.raises(mbd.ModelError, match="body 'b' is 0.5 m from the centroid"):
        mbd.FieldForce("f", mbd.Body("b", 1, 1 / 12, shape=mbd.Rod(1.0, center=(0.5, 0))), lambda p: (0, 0))
    with pytest.raises(mbd.ModelError, match="inertia of body 'b' is 0.1 .* 0.0833333"):
        mbd.FieldForce("f", mbd.Body("b", 1, 0.1, shape=mbd.Rod(1.0)), lambda p: (0, 0))
    with pytest.raises(mbd.ModelError, match="field must be a function"):
        mbd.FieldForce("f", even, (0, -G))
    with pytest.raises(mbd.ModelError, match="order must be a whole number"):
        mbd.FieldForce("f", even, lambda p: (0, 0), order=0)
    with pytest.raises(mbd.ModelError, match="field must have two components"):
        mbd.FieldForce("f", even, lambda p: 3.0)


# --- bushing ---------------------------------------------------------------------------------------
def test_bushing_against_its_energy_and_dissipation(rng):
    """Q·v = -dV/dt - dissipation; force and moment on both bodies balance; axes of a."""
    a, b = mbd.Body("a", 1, 1), mbd.Body("b", 1, 1)
    rubber = mbd.Bushing("rubber", a.at(0.1, 0.2, angle=0.5), b.at(-0.1, 0), (300, 50), (4, 7), 20, 0.3)
    mechanism = mbd.Mechanism([a, b], forces=[rubber])
    eom = mbd.equations(mechanism)
    q, v = rng.normal(size=6), rng.normal(size=6)
    delta_rate = value_of(mechanism, mbd.time_derivative(rubber.displacement), q, v).ravel()
    lost = 4 * delta_rate[0] ** 2 + 7 * delta_rate[1] ** 2 + 0.3 * (v[5] - v[2]) ** 2
    stored = float(value_of(mechanism, mbd.time_derivative(eom.potential), q, v)[0, 0])
    assert power_of(mechanism, q, v) == pytest.approx(-stored - lost)
    Q = forces_at(mechanism, q, v)
    np.testing.assert_allclose(Q[:2] + Q[3:5], 0, atol=1e-12)
    moment = Q[2] + Q[5] + q[0] * Q[1] - q[1] * Q[0] + q[3] * Q[4] - q[4] * Q[3]
    assert moment == pytest.approx(0, abs=1e-11)
    force = value_of(mechanism, rubber.a.axes @ rubber.force, q, v).ravel()
    np.testing.assert_allclose(Q[3:5], force, atol=1e-12)


def test_stiff_bushing_approaches_a_revolute_joint():
    """A pendulum on rubber of 1e7 N/m swings as one on a pin, to the static deflection."""

    def swing(hold):
        rod = mbd.Body("rod", mass=1, inertia=1 / 12, pose=(0.5, 0, 0))
        joints, forces = hold(rod)
        mechanism = mbd.Mechanism([rod], joints, forces=[mbd.Gravity(), *forces])
        return mbd.simulate(mechanism, duration=1.0)[rod.phi]

    pinned = swing(lambda rod: ([mbd.Revolute("pin", mbd.ground.at(0, 0), rod.at(-0.5, 0))], []))
    rubber = swing(lambda r: ([], [mbd.Bushing("b", mbd.ground.at(0, 0), r.at(-0.5, 0), 1e7, 1e3)]))
    np.testing.assert_allclose(rubber, pinned, atol=1e-5)


def test_bushings_that_make_no_sense():
    """Negative stiffness, three axes, one body."""
    body = mbd.Body("b", 1, 1)
    with pytest.raises(mbd.ModelError, match="bushing 'r': stiffness y must be at least 0, got -1"):
        mbd.Bushing("r", mbd.ground.at(0, 0), body.at(0, 0), (1, -1))
    with pytest.raises(mbd.ModelError, match="one value, or one for each axis"):
        mbd.Bushing("r", mbd.ground.at(0, 0), body.at(0, 0), (1, 1, 1))
    with pytest.raises(mbd.ModelError, match="connects body 'b' with itself"):
        mbd.Bushing("r", body.at(0, 0), body.at(1, 0), 1)


# --- stops -------------------------------------------------------------------------------------------
def block_and_stop(law, speed=2.0):
    """A block that slides towards a stop 0.1 m away."""
    block = mbd.Body("block", mass=2.0, inertia=1, velocity=(speed, 0, 0))
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    stop = mbd.EndStop("buffer", 0.1 - guide.displacement, law)
    return block, stop, mbd.Mechanism([block], [guide], forces=[stop])


def test_linear_stop_gives_the_block_back():
    """Penetration v √(m/k), half a period long, and the speed reversed; before it nothing."""
    block, stop, mechanism = block_and_stop(mbd.HuntCrossley(8e4, exponent=1))
    touch, half = 0.05, np.pi * np.sqrt(2.0 / 8e4)
    times = np.r_[0, touch, np.linspace(touch, touch + half, 41)[1:], 0.2]
    run = mbd.simulate(mechanism, times, reltol=1e-10, abstol=1e-10)
    assert np.max(run[block.x]) - 0.1 == pytest.approx(2.0 * np.sqrt(2.0 / 8e4), rel=1e-4)
    assert run[block.vx][-1] == pytest.approx(-2.0, rel=1e-6)
    assert run[stop.force][[0, -1]] == pytest.approx(0)
    np.testing.assert_allclose(run.energy.total, 4.0, rtol=1e-6)


def test_stop_never_pulls_and_loses_energy_with_damping():
    """Hunt–Crossley with damping: e < 1, force never below zero."""
    block, stop, mechanism = block_and_stop(mbd.HuntCrossley(1e6, damping=0.3))
    run = mbd.simulate(mechanism, np.linspace(0, 0.2, 2001))
    assert np.min(run[stop.force]) >= 0
    assert 0.3 < -run[block.vx][-1] / 2.0 < 0.95


def test_stop_on_an_angle_and_between_two_bodies(rng):
    """δW = F δgap: power F gap rate where it is closed, zero where it is open."""
    a, b = mbd.Body("a", 1, 1), mbd.Body("b", 1, 1)
    pin = mbd.Revolute("pin", a.at(0, 0), b.at(0, 0))
    stop = mbd.EndStop("stop", 0.4 - pin.angle, mbd.HuntCrossley(100, damping=0.1))
    mechanism = mbd.Mechanism([a, b], [pin], forces=[stop])
    v = rng.normal(size=6)
    for angle in (0.3, 0.9):
        q = np.r_[0, 0, 0.1, 0, 0, 0.1 + angle]
        depth, rate = angle - 0.4, v[5] - v[2]
        force = 100 * max(depth, 0) ** 1.5 * max(1 + 0.1 * rate, 0)
        np.testing.assert_allclose(forces_at(mechanism, q, v), [0, 0, force, 0, 0, -force], atol=1e-12)


def test_stops_that_make_no_sense():
    """A gap without coordinates or with velocities, a law that is none."""
    body = mbd.Body("b", 1, 1)
    law = mbd.HuntCrossley(1e5)
    with pytest.raises(mbd.ModelError, match="stop 's': the gap .* depends on no coordinate"):
        mbd.EndStop("s", mbd.t, law)
    with pytest.raises(mbd.ExpressionError, match="stop 's' depends on the velocity"):
        mbd.EndStop("s", body.vx, law)
    with pytest.raises(mbd.ModelError, match="stop 's': law must be a function"):
        mbd.EndStop("s", body.x, 1e5)
    with pytest.raises(mbd.ModelError, match="HuntCrossley: stiffness must be above 0"):
        mbd.HuntCrossley(0)


# --- cylinders ---------------------------------------------------------------------------------------------
def test_cylinder_pushes_with_its_pressures(rng):
    """Thrust p A - p_r (A - A_r) along the line of the eyes; power thrust × rate - loss."""
    a, b = mbd.Body("a", 1, 1), mbd.Body("b", 1, 1)
    p = mbd.Input("p")
    ram = mbd.Cylinder("ram", a.at(0.1, 0), b.at(0, 0.2), 0.05, 0.02, pressure=p, rod_pressure=2e5, damping=30)
    mechanism = mbd.Mechanism([a, b], forces=[ram], inputs=[p])
    q, v, u = rng.normal(size=6), rng.normal(size=6), np.array([6e5])
    thrust = 6e5 * np.pi / 4 * 0.05**2 - 2e5 * np.pi / 4 * (0.05**2 - 0.02**2)
    rate = float(value_of(mechanism, ram.rate, q, v)[0, 0])
    assert value_of(mechanism, ram.thrust, q, v, u=u) == pytest.approx(thrust)
    assert power_of(mechanism, q, v, u=u) == pytest.approx(thrust * rate - 30 * rate**2)


def test_hydraulic_cylinder_oscillates_on_its_oil():
    """Both ports shut: the stiffness is β (A² + A_r²) / V0, and the block's period that of the oil spring."""
    bore, rod, volume, mass = 0.05, 0.02, 2e-4, 80.0
    block = mbd.Body("block", mass=mass, inertia=1, pose=(0.5, 0, 0), velocity=(0.01, 0, 0))
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    ram = mbd.HydraulicCylinder("ram", mbd.ground.at(0, 0), block.at(0, 0), bore, rod, 0.5, volume, flow=0.0)
    mechanism = mbd.Mechanism([block], [guide], forces=[ram])
    area, rod_area = np.pi / 4 * bore**2, np.pi / 4 * (bore**2 - rod**2)
    omega = np.sqrt(1.4e9 * (area**2 + rod_area**2) / volume / mass)
    run = mbd.simulate(mechanism, np.linspace(0, 4 * np.pi / omega, 101))
    np.testing.assert_allclose(run[block.vx], 0.01 * np.cos(omega * run.t), atol=2e-5)


def test_flow_moves_a_hydraulic_cylinder():
    """Oil at q on the piston's side and out on the rod's: the ram creeps at q / A once the pressure has settled."""
    area, rod_area = np.pi / 4 * 0.05**2, np.pi / 4 * (0.05**2 - 0.02**2)
    q = 1e-4
    block = mbd.Body("block", mass=20.0, inertia=1, pose=(0.5, 0, 0))
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    flow = mbd.step(mbd.t, 0.0, 0.0, 0.2, q)
    ram = mbd.HydraulicCylinder(
        "ram", mbd.ground.at(0, 0), block.at(0, 0), 0.05, 0.02, 0.5, 2e-4, flow, -flow * rod_area / area, damping=2e3
    )
    run = mbd.simulate(mbd.Mechanism([block], [guide], forces=[ram]), np.linspace(0, 1, 51))
    assert run[block.vx][-1] == pytest.approx(q / area, rel=1e-3)


def test_gas_spring_by_its_energy(rng):
    """Force = -dV/dl, isothermal and adiabatic; the tension at the charged length is that of the pressures."""
    for exponent in (1.0, 1.4):
        body = mbd.Body("b", 1, 1)
        spring = mbd.GasSpring("air", mbd.ground.at(0, 0), body.at(0.1, 0), 2e-3, 0.3, 8e5, 0.05, exponent)
        mechanism = mbd.Mechanism([body], forces=[spring])
        q, v = np.array([0.3, 0.2, 0.0]) + 0.05 * rng.normal(size=3), rng.normal(size=3)
        stored = float(value_of(mechanism, mbd.time_derivative(spring.potential), q, v)[0, 0])
        assert power_of(mechanism, q, v) == pytest.approx(-stored, rel=1e-10)
        charged = np.array([0.2, 0, 0.0])
        assert value_of(mechanism, spring.force, charged, v) == pytest.approx(-2e-3 * (8e5 - 101325))
        assert value_of(mechanism, spring.pressure, np.array([0.075, 0, 0.0]), v) == pytest.approx(8e5 * 2**exponent)


def test_cylinders_that_make_no_sense():
    """A rod as thick as the piston, a gas column of no length."""
    body = mbd.Body("b", 1, 1)
    with pytest.raises(mbd.ModelError, match="cylinder 'c': bore less rod must be above 0"):
        mbd.Cylinder("c", mbd.ground.at(0, 0), body.at(0, 0), 0.05, 0.05)
    with pytest.raises(mbd.ModelError, match="gas spring 'g': charged_length less dead_length must be above 0"):
        mbd.GasSpring("g", mbd.ground.at(0, 0), body.at(0, 0), 1e-3, 0.1, 1e5, dead_length=0.1)


# --- motors, controllers, meters ---------------------------------------------------------------------------
def wheel_on_axle(inertia=0.01):
    """A wheel on a fixed axle."""
    wheel = mbd.Body("wheel", mass=1, inertia=inertia)
    return wheel, mbd.Revolute("axle", mbd.ground.at(0, 0), wheel.at(0, 0))


def test_motor_with_a_speed_torque_line_runs_up():
    """ω = ω0 (1 - exp(-t / τ)), τ = J ω0 / T0."""
    wheel, axle = wheel_on_axle()
    motor = mbd.DCMotor.from_line("motor", wheel, stall_torque=2.0, no_load_speed=100.0)
    run = mbd.simulate(mbd.Mechanism([wheel], [axle], forces=[motor]), duration=2.0)
    np.testing.assert_allclose(run[wheel.omega], 100 * (1 - np.exp(-run.t / 0.5)), atol=2e-6)
    np.testing.assert_allclose(run[motor.torque], 2.0 * np.exp(-run.t / 0.5), atol=1e-7)


def test_motor_with_current_runs_up():
    """Two first-order equations: the closed form by the eigenvalues of [[-R/L, -nK/L], [nK/J, 0]]."""
    J, K, R, L, n, V = 0.02, 0.05, 0.4, 0.02, 3.0, 12.0
    wheel, axle = wheel_on_axle(J)
    motor = mbd.DCMotor("motor", wheel, V, K, R, inductance=L, ratio=n, current=1.5)
    run = mbd.simulate(mbd.Mechanism([wheel], [axle], forces=[motor]), duration=2.0, reltol=1e-10, abstol=1e-10)
    A, b = np.array([[-R / L, -n * K / L], [n * K / J, 0]]), np.array([V / L, 0])
    steady = -np.linalg.solve(A, b)
    values, vectors = np.linalg.eig(A)
    weights = np.linalg.solve(vectors, np.array([1.5, 0]) - steady)
    wanted = steady[:, None] + np.real(vectors @ (weights[:, None] * np.exp(values[:, None] * run.t)))
    np.testing.assert_allclose(run[motor.current], wanted[0], atol=1e-7)
    np.testing.assert_allclose(run[wheel.omega], wanted[1], atol=1e-7)
    assert steady[1] == pytest.approx(V / (n * K))


def test_energy_budget_of_a_motor_closes():
    """Supply = heat + kinetic energy + that of the coil, each a state or an expression."""
    wheel, axle = wheel_on_axle()
    motor = mbd.DCMotor("motor", wheel, 12 * mbd.cos(3 * mbd.t), 0.05, 0.4, inductance=0.02)
    taken, lost = mbd.EnergyMeter("taken", motor.electric_power), mbd.EnergyMeter("lost", motor.heat)
    mechanism = mbd.Mechanism([wheel], [axle], forces=[motor, taken, lost])
    run = mbd.simulate(mechanism, duration=3.0, reltol=1e-10, abstol=1e-10)
    stored = run.energy.kinetic + 0.5 * 0.02 * run[motor.current] ** 2
    np.testing.assert_allclose(run[taken.energy] - run[lost.energy], stored, atol=1e-6)


def test_motor_leans_on_its_housing():
    """The couple on the body that carries it is opposite; the speed counts between the two."""
    wheel, base = mbd.Body("wheel", 1, 1), mbd.Body("base", 1, 1)
    motor = mbd.DCMotor("motor", wheel, 10.0, 0.5, 2.0, opposite=base)
    mechanism = mbd.Mechanism([wheel, base], forces=[motor])
    v = np.array([0, 0, 3.0, 0, 0, -1.0])
    torque = 0.5 * (10 - 0.5 * 4) / 2
    np.testing.assert_allclose(forces_at(mechanism, np.zeros(6), v), [0, 0, torque, 0, 0, -torque], atol=1e-14)


def test_pi_controller_holds_the_speed_under_load():
    """No error is left: the integral carries the load; without the integral an error stays."""

    def settled(integral):
        wheel, axle = wheel_on_axle()
        speed = mbd.PIController("speed", 50 - wheel.omega, proportional=0.5, integral=integral)
        forces = [speed, mbd.Torque("motor", wheel, speed.output), mbd.Torque("load", wheel, -2.0)]
        run = mbd.simulate(mbd.Mechanism([wheel], [axle], forces=forces), duration=6.0)
        return run[wheel.omega][-1]

    assert settled(5.0) == pytest.approx(50, abs=1e-5)
    assert settled(0.0) == pytest.approx(50 - 2.0 / 0.5, abs=1e-5)


def test_lag_answers_a_step():
    """y = 1 - exp(-t / T), and the command behind it may be an input."""
    wheel, axle = wheel_on_axle()
    command = mbd.Input("command")
    lag = mbd.FirstOrderLag("valve", command, 0.2)
    mechanism = mbd.Mechanism([wheel], [axle], forces=[lag, mbd.Torque("T", wheel, lag.output)], inputs=[command])
    run = mbd.simulate(mechanism, duration=1.0, inputs={command: 1.0})
    np.testing.assert_allclose(run[lag.output], 1 - np.exp(-run.t / 0.2), atol=1e-7)
    np.testing.assert_allclose(run[wheel.omega], (run.t - 0.2 * (1 - np.exp(-run.t / 0.2))) / 0.01, atol=1e-5)


def test_states_of_these_elements_in_inverse_dynamics():
    """A driven wheel: the current follows from the motion by its own equation."""
    wheel, axle = wheel_on_axle()
    motor = mbd.DCMotor("motor", wheel, 12.0, 0.05, 0.4, inductance=0.02)
    drive = mbd.Driver("drive", axle.angle, 30 * mbd.t)
    run = mbd.inverse_dynamics(mbd.Mechanism([wheel], [axle], [drive], forces=[motor]), np.linspace(0, 1, 51))
    steady = (12 - 0.05 * 30) / 0.4
    current = steady * (1 - np.exp(-run.t * 0.4 / 0.02))
    np.testing.assert_allclose(run[motor.current], current, atol=1e-6)
    np.testing.assert_allclose(run[drive.effort], -0.05 * current, atol=1e-7)


@pytest.mark.parametrize(
    "make,said",
    [
        (lambda w: mbd.DCMotor("m", w, 1, 0, 1), "motor 'm': constant must be above 0"),
        (lambda w: mbd.DCMotor("m", w, 1, 1, -1), "motor 'm': resistance must be above 0"),
        (lambda w: mbd.DCMotor("m", w, 1, 1, 1, inductance=-1), "motor 'm': inductance must be at least 0"),
        (lambda w: mbd.DCMotor("m", w, 1, 1, 1, ratio=0), "motor 'm': the ratio is zero"),
        (lambda w: mbd.DCMotor("m", w, 1, 1, 1, opposite=w), "motor 'm' acts on 'wheel', which takes the reaction too"),
        (lambda w: mbd.DCMotor("m", w, 1, 1, 1, current=2.0), "without inductance the current has no start"),
        (lambda w: mbd.DCMotor.from_line("m", w, 0, 1), "motor 'm': stall_torque must be above 0"),
        (lambda w: mbd.FirstOrderLag("l", 1.0, 0), "lag 'l': time_constant must be above 0"),
        (lambda w: mbd.PIController("c", w.alpha, 1, 1), "controller 'c' depends on the acceleration"),
        (lambda w: mbd.DCMotor("m", w, 1, 1, 1, ratio=mbd.t), "motor 'm': ratio depends on time 't'"),
        (lambda w: mbd.DCMotor("m", w, 1, 1, 1, inductance=w.x), r"motor 'm': inductance depends on position 'w"),
        (
            lambda w: mbd.Cylinder("c", mbd.ground.at(1, 0), w.at(0, 0), 0.1 + mbd.t),
            "cylinder 'c': bore depends on time 't'",
        ),
        (
            lambda w: mbd.TSDA("s", mbd.ground.at(1, 0), w.at(0, 0), law=lambda length: length),
            r"spring 's': law must be a function of length and rate: too many positional arguments in law\(length\)",
        ),
        (
            lambda w: mbd.RSDA("s", mbd.ground.at(1, 0), w.at(0, 0), law=lambda a, b, c: a),
            r"spring 's': law must be a function of angle and rate: missing a required argument: 'c'",
        ),
        (lambda w: mbd.EndStop("e", w.x, lambda d: d), "stop 'e': law must be a function of penetration and rate"),
        (
            lambda w: mbd.FieldForce("f", mbd.Body.from_shape("p", PLATE, mass=3.0), lambda: (0, 0)),
            "force 'f': field must be a function of a point: too many positional arguments",
        ),
        (
            lambda w: mbd.FieldForce("f", mbd.Body.from_shape("p", PLATE, mass=3.0), lambda p: (0, 0), order="x"),
            "force 'f': order must be a whole number from 1 to 20, got 'x'",
        ),
        (
            lambda w: mbd.FieldForce("f", mbd.Body.from_shape("p", PLATE, mass=3.0), lambda p: (0, 0), order=21),
            "from 1 to 20, got 21",
        ),
    ],
)
def test_machines_that_make_no_sense(make, said):
    """Named with the quantity and its value."""
    with pytest.raises(mbd.MechanismError, match=said):
        make(mbd.Body("wheel", 1, 1))


@pytest.mark.parametrize(
    "make,owner",
    [
        (lambda w: (p := mbd.PIController("own", -w.omega, 1, 1), p.output), "controller"),
        (lambda w: (p := mbd.FirstOrderLag("own", 1.0, 0.1), p.output), "lag"),
        (lambda w: (p := mbd.EnergyMeter("own", w.omega), p.energy), "energy meter"),
        (lambda w: (p := mbd.DCMotor("own", w, 1, 1, 1, inductance=0.1), p.current), "motor"),
    ],
)
def test_an_element_whose_state_is_used_must_be_listed(make, owner):
    """The message names the element that was left out; with it the mechanism is made."""
    wheel = mbd.Body("wheel", 1, 1)
    element, value = make(wheel)
    torque = mbd.Torque("torque", wheel, value)
    with pytest.raises(mbd.ExpressionError, match=f"belongs to {owner} 'own'; list that in forces= too"):
        mbd.Mechanism([wheel], forces=[torque])
    assert len(mbd.Mechanism([wheel], forces=[torque, element]).states) == 1


# --- laws from data --------------------------------------------------------------------------------------
def test_spring_from_data_conserves_energy_and_meets_its_points():
    """A progressive spring; potential by the exact integral of the curve."""
    law = mbd.DataLaw([-0.05, -0.02, 0, 0.03, 0.05], [-400, -90, 0, 80, 150], free=0.3)
    block = mbd.Body("block", mass=1, inertia=1, pose=(0.34, 0, 0))
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    spring = mbd.TSDA("spring", mbd.ground.at(0, 0), block.at(0, 0), law=law)
    mechanism = mbd.Mechanism([block], [guide], forces=[spring])
    for x, force in ((0.25, -400), (0.28, -90), (0.3, 0), (0.33, 80), (0.35, 150)):
        assert value_of(mechanism, spring.force, np.array([x, 0, 0]), np.zeros(3)) == pytest.approx(force, abs=1e-9)
    run = mbd.simulate(mechanism, duration=2.0, reltol=1e-10, abstol=1e-10)
    assert np.ptp(run.energy.total) < 1e-7
    assert np.ptp(run.energy.kinetic) > 1


@pytest.mark.parametrize("kind", ["cubic", "monotone", "linear"])
@pytest.mark.parametrize("outside", ["linear", "constant", "error"])
def test_energy_of_a_data_law_is_the_integral_of_its_force(kind, outside):
    """-dV/dx by differences, inside and outside of the data."""
    law = mbd.DataLaw([-0.05, -0.02, 0, 0.03, 0.05], [-400, -90, 10, 80, 150], kind=kind, outside=outside)
    body = mbd.Body("b", 1, 1)
    mechanism = mbd.Mechanism([body], forces=[mbd.GeneralizedForce("f", [(body.x, -law(body.x, body.vx))])])
    places = [-0.03, -0.02, 0.011, 0.049] + ([] if outside == "error" else [-0.2, 0.08])
    h = 1e-6
    for x in places:
        ahead, behind = (
            float(value_of(mechanism, law.potential(body.x), [x + s, 0, 0], np.zeros(3))[0, 0]) for s in (h, -h)
        )
        assert power_of(mechanism, np.array([x, 0, 0]), np.array([1.0, 0, 0])) == pytest.approx(
            -(ahead - behind) / (2 * h), rel=1e-4, abs=1e-2
        )


def test_damper_from_data():
    """A second curve over the rate, and linear damping besides."""
    law = mbd.DataLaw([-1, 1], [0, 0], [-1, 0, 0.5, 1], [-50, 0, 30, 40], damping=2.0)
    body = mbd.Body("b", 1, 1)
    spring = mbd.RSDA("damper", mbd.ground.at(0, 0), body.at(0, 0), law=law)
    mechanism = mbd.Mechanism([body], forces=[spring])
    Q = forces_at(mechanism, np.zeros(3), np.array([0, 0, 0.5]))
    np.testing.assert_allclose(Q, [0, 0, -(30 + 1.0)], atol=1e-12)


def test_data_that_make_no_law():
    """Raised when the law is made."""
    with pytest.raises(mbd.ModelError, match="same length"):
        mbd.DataLaw([0, 1], [0, 1, 2])
    with pytest.raises(mbd.ModelError, match="both rates and damping_forces, and only one of them"):
        mbd.DataLaw([0, 1], [0, 1], rates=[0, 1])
    with pytest.raises(mbd.ModelError, match="both rates and damping_forces, and only one of them"):
        mbd.DataLaw([0, 1], [0, 1], damping_forces=[0, 1])


@pytest.mark.parametrize("damping", [100.0, 400.0, 700.0])
@pytest.mark.filterwarnings("error::mbdcasadi.MechanismWarning")
def test_a_stop_whose_force_jumps_at_the_touch_is_no_false_alarm(damping):
    """``k δ + c δ̇`` with c v at once: right by the damped oscillator, up to where its force vanishes, and quiet."""
    stiffness, m, speed = 8e4, 2.0, 2.0
    block, _, mechanism = block_and_stop(
        lambda depth, rate: mbd.fmax(stiffness * depth + damping * rate, 0), speed=speed
    )
    decay, square = damping / (2 * m), stiffness / m
    w = np.sqrt(complex(square - decay**2))

    def oscillator(s):
        depth = speed / w * np.sin(w * s) * np.exp(-decay * s)
        rate = speed * (np.cos(w * s) - decay / w * np.sin(w * s)) * np.exp(-decay * s)
        return depth.real, rate.real

    s = np.linspace(1e-6, 0.05, 200001)
    depth, rate = oscillator(s)
    loose = int(np.argmax(stiffness * depth + damping * rate < 0)) or len(s) - 1
    run = mbd.simulate(mechanism, [0, 0.05 + s[loose], 0.3])
    assert run[block.vx][-1] == pytest.approx(rate[loose], abs=2e-5)


def test_the_jump_at_the_touch_is_part_of_the_force():
    """Though what is watched for the steps is continuous."""
    body = mbd.Body("b", 1.0, 1.0, pose=(0.1, 0, 0), velocity=(2.0, 0, 0))
    stop = mbd.EndStop("s", 0.1 - body.x, lambda depth, rate: 1e4 * depth + 50 * rate)
    model = mbd.Mechanism([body], forces=[stop])
    state = mbd.assemble(model, [body.x == 0.1 + 1e-9, body.vx == 2.0])
    assert state[stop.force] == pytest.approx(100.0, rel=1e-4)
    (smoothing,) = stop.smoothings
    assert abs(state[smoothing.expression]) < 1e-4


@pytest.mark.parametrize(
    ("make", "element"),
    [
        (
            lambda w: mbd.TSDA("s", mbd.ground.at(0, 1), w.at(0, 0), law=lambda x, v: 1 if x > 0 else 0),
            "spring 's': law",
        ),
        (lambda w: mbd.RSDA("s", mbd.ground.at(0, 1), w.at(0, 0), law=lambda x, v: max(x, 0)), "spring 's': law"),
        (lambda w: mbd.EndStop("e", w.x, lambda d, v: 5 * min(d, 0.1)), "stop 'e': law"),
        (lambda w: mbd.CamOutline(lambda alpha: 0.1 if alpha < 1 else 0.2), "CamOutline: radius"),
        (lambda w: mbd.Curve(lambda s: (s, max(s, 0)), -1, 1), "Curve: point"),
        (
            lambda w: mbd.FieldForce(
                "f",
                mbd.Body.from_shape("bar", mbd.Rectangle(1, 0.1), mass=1),
                lambda point: (0, -9.81 if point.y > 0 else 0),
            ),
            "force 'f': field",
        ),
    ],
)
def test_laws_that_branch_in_python_are_refused(make, element):
    with pytest.raises(mbd.ModelError, match=rf"{element} compares expressions by if.*use mbd\.if_else"):
        make(mbd.Body("w", mass=1, inertia=1))
