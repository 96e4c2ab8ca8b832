"""Drivers that follow states, by closed forms."""

import numpy as np
import pytest

import mbdcasadi as mbd

G, LENGTH, TROLLEY, BOB = 9.81, 1.0, 5.0, 2.0


class Crane:
    """A trolley whose acceleration is the input, and a bob that hangs from it."""

    def __init__(self):
        self.command = mbd.Input("command", lower=-2, upper=2)
        self.position, self.velocity = mbd.StateVariable("position"), mbd.StateVariable("velocity")
        self.gain = mbd.Parameter("gain", 1.0)
        self.trolley = mbd.Body("trolley", mass=TROLLEY, inertia=1.0)
        self.bob = mbd.Body("bob", mass=BOB, inertia=0.0, pose=(0, -LENGTH, 0))
        rail = mbd.Translational("rail", mbd.ground.at(0, 0), self.trolley.at(0, 0))
        pivot = mbd.Revolute("pivot", self.trolley.at(0, 0), self.bob.at(0, LENGTH))
        self.servo = mbd.Driver("servo", self.trolley.x, self.position)
        self.mechanism = mbd.Mechanism(
            [self.trolley, self.bob],
            [rail, pivot],
            [self.servo],
            [mbd.Gravity()],
            [self.command],
            [self.gain],
            {self.position: self.velocity, self.velocity: self.gain * self.command},
        )
        self.rest = [self.bob.phi == 0, self.bob.omega == 0]


@pytest.fixture(scope="module")
def crane():
    return Crane()


@pytest.fixture(scope="module")
def crank():
    return SliderCrank()


class SliderCrank:
    """A slider-crank whose crank follows a critically damped filter of a step of a reference."""

    RATE = 8.0

    def __init__(self):
        w = self.RATE
        self.angle, self.speed = mbd.StateVariable("angle", 0.3), mbd.StateVariable("speed")
        self.reference = mbd.Input("reference", 1.3)
        self.crank = mbd.Body("crank", mass=1.0, inertia=0.02, pose=(0.1 * np.cos(0.3), 0.1 * np.sin(0.3), 0.3))
        rod = mbd.Body("rod", mass=2.0, inertia=0.05, pose=(0.45, 0.02, -0.1))
        self.slider = mbd.Body("slider", mass=1.5, inertia=0.01, pose=(0.78, 0, 0))
        main = mbd.Revolute("main", mbd.ground.at(0, 0), self.crank.at(-0.1, 0))
        pin, wrist = (
            mbd.Revolute("pin", self.crank.at(0.1, 0), rod.at(-0.3, 0)),
            mbd.Revolute("wrist", rod.at(0.3, 0), self.slider.at(0, 0)),
        )
        guide = mbd.Translational("guide", mbd.ground.at(0, 0), self.slider.at(0, 0))
        self.servo = mbd.Driver("servo", main.angle, self.angle)
        rates = {self.angle: self.speed, self.speed: w**2 * (self.reference - self.angle) - 2 * w * self.speed}
        self.mechanism = mbd.Mechanism(
            [self.crank, rod, self.slider],
            [main, pin, wrist, guide],
            [self.servo],
            [mbd.Gravity()],
            [self.reference],
            [],
            rates,
        )

    def closed_form(self, t):
        """Angle, speed and acceleration of the crank after the step."""
        w = self.RATE
        fade = np.exp(-w * t)
        return 1.3 - (1 + w * t) * fade, w**2 * t * fade, w**2 * (1 - w * t) * fade


@pytest.mark.parametrize("method", ["idas", "dop853"])
def test_a_bob_swings_as_its_trolley_is_accelerated(crane, method):
    """In the frame of the trolley it is a pendulum under tilted gravity: it swings to twice the tilt, by energy."""
    run = mbd.simulate(
        crane.mechanism,
        np.linspace(0, 1, 201),
        initial=crane.rest,
        inputs={crane.command: 0.5},
        method=method,
        reltol=1e-9,
        abstol=1e-11,
    )
    np.testing.assert_allclose(run[crane.trolley.x], run.t**2 / 4, atol=1e-12)
    np.testing.assert_allclose(run[crane.trolley.ax], 0.5, atol=1e-12)
    angle, rate = run[crane.bob.phi], run[crane.bob.omega]
    np.testing.assert_allclose(rate**2 / 2, -0.5 * np.sin(angle) - G * (1 - np.cos(angle)), atol=1e-8)
    # the trolley, and the pull of the rod on it
    pull = G * np.cos(angle) - 0.5 * np.sin(angle) + LENGTH * rate**2
    np.testing.assert_allclose(run[crane.servo.effort], 0.5 * TROLLEY + BOB * pull * -np.sin(angle), atol=1e-6)
    power = run[crane.servo.effort * crane.trolley.vx]
    work = np.sum((power[1:] + power[:-1]) / 2 * np.diff(run.t))
    assert work == pytest.approx(run.energy.total[-1] - run.energy.total[0], abs=1e-4)


def test_states_follow_the_pose_or_the_pose_the_states(crane):
    own = mbd.assemble(crane.mechanism, [*crane.rest, crane.position == 0.4, crane.velocity == 0.2])
    assert own[crane.trolley.x] == pytest.approx(0.4, abs=1e-12)
    assert own[crane.trolley.vx] == pytest.approx(0.2, abs=1e-12)
    led = mbd.assemble(crane.mechanism, [*crane.rest, crane.bob.x == 1.5, crane.trolley.vx == -0.3])
    assert led[crane.position] == pytest.approx(1.5, abs=1e-9)
    assert led[crane.velocity] == pytest.approx(-0.3, abs=1e-9)
    half = mbd.assemble(crane.mechanism, [*crane.rest, crane.trolley.vx == 0.7])
    assert half[crane.position] == 0
    assert half[crane.velocity] == pytest.approx(0.7, abs=1e-9)
    with pytest.raises(mbd.MechanismError, match="driver 'servo' follows agree with the start"):
        mbd.assemble(crane.mechanism, [*crane.rest, crane.trolley.x == 1, crane.position == 0.4])


def test_of_two_servos_the_one_follows_the_pose_and_the_other_leads_it():
    """A plate on two slides: conditions decide where it is along x, its states where along y."""
    x, u, y, w = [mbd.StateVariable(*pair) for pair in (("x", 0.1), ("u", 0.0), ("y", 0.7), ("w", 0.2))]
    carriage, plate = mbd.Body("carriage", 1.0, 1.0), mbd.Body("plate", 1.0, 1.0)
    along = mbd.Translational("along", mbd.ground.at(0, 0), carriage.at(0, 0))
    across = mbd.Translational("across", carriage.at(0, 0, np.pi / 2), plate.at(0, 0, np.pi / 2))
    drivers = [mbd.Driver("first", carriage.x, x + y), mbd.Driver("second", plate.y, y)]
    model = mbd.Mechanism([carriage, plate], [along, across], drivers, states={x: u, u: 0, y: w, w: 0})
    start = mbd.assemble(model, [plate.x == 2.0])
    np.testing.assert_allclose([start[s] for s in (plate.x, plate.y, x, y)], [2.0, 0.7, 1.3, 0.7], atol=1e-9)
    np.testing.assert_allclose([start[s] for s in (plate.vx, plate.vy)], [0.2, 0.2], atol=1e-9)


def test_kinematics_and_inverse_dynamics_of_a_filter_that_steps(crank):
    t = np.linspace(0, 1, 21)
    angle, speed, acceleration = crank.closed_form(t)
    motion = mbd.kinematics(crank.mechanism, t)
    np.testing.assert_allclose(motion[crank.crank.phi], angle, atol=1e-9)
    np.testing.assert_allclose(motion[crank.angle], angle, atol=1e-9)
    np.testing.assert_allclose(motion[crank.crank.omega], speed, atol=1e-8)
    np.testing.assert_allclose(motion[crank.crank.alpha], acceleration, atol=1e-7)
    assert motion.at([0.123])[crank.crank.phi][0] == pytest.approx(crank.closed_form(0.123)[0], abs=1e-6)
    x = 0.2 * np.cos(angle) + np.sqrt(0.6**2 - (0.2 * np.sin(angle)) ** 2)
    np.testing.assert_allclose(motion[crank.slider.x], x, atol=1e-9)
    # the same effort as that of a driver which is given the closed form
    w = crank.RATE
    course = 1.3 - (1 + w * mbd.t) * mbd.exp(-w * mbd.t)
    timed = mbd.Driver("timed", crank.crank.phi, course)
    by_time = crank.mechanism.replace(drivers=[timed], inputs=[], states={})
    inverse = mbd.inverse_dynamics(crank.mechanism, t)
    wanted = mbd.inverse_dynamics(by_time, t)[timed.effort]
    np.testing.assert_allclose(inverse[crank.servo.effort], wanted, atol=1e-6)
    assert mbd.inverse_dynamics(crank.mechanism, [0.0], inputs={crank.reference: 2.3})[crank.crank.alpha][
        0
    ] == pytest.approx(2 * w**2)


def test_rest_and_small_motions(crane, crank):
    """A filter rests at its reference; the eigenvalues are those of the filter and of the pendulum."""
    rest = mbd.equilibrium(crank.mechanism, inputs={crank.reference: 0.9})
    assert rest[crank.crank.phi] == pytest.approx(0.9, abs=1e-9)
    linear = mbd.linearize(crank.mechanism, rest, [crank.reference])
    np.testing.assert_allclose(linear.A, [[0, 1], [-(crank.RATE**2), -2 * crank.RATE]], atol=1e-8)
    np.testing.assert_allclose(linear.B, [[0], [crank.RATE**2]], atol=1e-8)
    hanging = mbd.assemble(crane.mechanism, [*crane.rest, crane.trolley.x == 0.3])
    linear = mbd.linearize(crane.mechanism, hanging, [crane.command], [crane.servo.effort])
    frequencies = np.sort(np.abs(np.linalg.eigvals(linear.A)))
    np.testing.assert_allclose(frequencies, [0, 0, *[np.sqrt(G / LENGTH)] * 2], atol=1e-6)
    np.testing.assert_allclose(linear.D, [[TROLLEY]], atol=1e-9)


@pytest.mark.parametrize("method", ["idas", "dop853"])
def test_derivatives_by_the_rate_of_a_state(crane, method):
    """The trolley is at g t²/4 with the gain g; the angle by differences of two runs."""
    t, start = np.linspace(0, 1, 5), [*crane.rest, crane.position == 0, crane.velocity == 0]
    run, tight = {"initial": start, "inputs": {crane.command: 0.5}}, {"method": method, "reltol": 1e-9, "abstol": 1e-10}
    found = mbd.sensitivities(crane.mechanism, t, [crane.trolley.x, crane.bob.phi], [crane.gain], **run, **tight)
    np.testing.assert_allclose(found[crane.trolley.x, crane.gain], t**2 / 4, atol=1e-7)
    low, high = (
        mbd.simulate(crane.mechanism, t, parameters={crane.gain: g}, reltol=1e-10, abstol=1e-12, **run)
        for g in (0.999, 1.001)
    )
    slope = (high[crane.bob.phi] - low[crane.bob.phi]) / 0.002
    np.testing.assert_allclose(found[crane.bob.phi, crane.gain], slope, atol=1e-6)
    led = [*crane.rest, crane.trolley.x == 0, crane.trolley.vx == 0]
    again = mbd.sensitivities(crane.mechanism, t, [crane.bob.phi], [crane.gain], **run | {"initial": led}, **tight)
    np.testing.assert_allclose(again[crane.bob.phi, crane.gain], slope, atol=1e-6)
    with pytest.raises(mbd.ModelError, match="conditions decide in part how driver 'servo' starts"):
        mbd.sensitivities(crane.mechanism, t, [crane.trolley.x], [crane.gain], [*crane.rest, crane.trolley.vx == 0])


@pytest.mark.parametrize("with_speed", [True, False])
def test_derivatives_by_a_place_at_the_start(crane, with_speed):
    """States that follow the pose vary with it: the trolley starts at the gain."""
    x, v = crane.trolley.x, crane.trolley.vx
    start = [*crane.rest, x == crane.gain, *([v == 2 * crane.gain] if with_speed else [])]
    found = mbd.sensitivities(crane.mechanism, [0, 0.5], [x, v, crane.position], [crane.gain], start)
    by_speed = 1.0 if with_speed else 0.0
    np.testing.assert_allclose(found[x, crane.gain], [1, 1 + by_speed], atol=1e-8)
    np.testing.assert_allclose(found[crane.position, crane.gain], [1, 1 + by_speed], atol=1e-8)
    np.testing.assert_allclose(found[v, crane.gain], 2 * by_speed, atol=1e-8)


def test_a_reset_of_the_speed_strikes_and_one_of_the_place_is_refused(crane):
    """The trolley turns back at 0.1 m; the bob, which the rod does not push sideways, goes on."""
    bump = mbd.Event("bump", crane.trolley.x - 0.1, reset={crane.velocity: -crane.velocity})
    run = mbd.simulate(
        crane.mechanism,
        np.linspace(0, 1, 11),
        initial=[crane.bob.phi == 0, crane.bob.omega == 0],
        inputs={crane.command: 0.5},
        events=[bump],
    )
    struck = np.sqrt(0.4)
    speed = -np.sqrt(0.1) + 0.5 * (run.t - struck)
    later = run.t > struck
    np.testing.assert_allclose(run[crane.trolley.vx][later], speed[later], atol=1e-7)
    np.testing.assert_allclose(run[crane.trolley.vx], run[crane.velocity], atol=1e-9)
    before, after = run.events[0].state, run.events[0].after
    along = [np.cos(before[crane.bob.phi]), np.sin(before[crane.bob.phi])]  # across the rod
    across = [along @ (np.ravel(s[crane.bob.velocity])) for s in (before, after)]
    assert across[0] == pytest.approx(across[1], abs=1e-9)
    jump = mbd.Event("jump", crane.trolley.x - 0.1, reset={crane.position: 0.5})
    with pytest.raises(mbd.SimulationError, match="'servo' follows would move it by 0.4 at once"):
        mbd.simulate(crane.mechanism, [0, 1], initial=crane.rest, inputs={crane.command: 0.5}, events=[jump])


@pytest.mark.parametrize("method", ["idas", "dop853"])
def test_a_speed_that_jumps_strikes(crane, method):
    """A pivot that starts at 1 m/s leaves the bob at rest: it turns at -1/l, and then swings."""
    place = mbd.StateVariable("place")
    servo = mbd.Driver("servo", crane.trolley.x, place)
    model = crane.mechanism.replace(drivers=[servo], states={place: mbd.if_else(mbd.t < 0.5, 0.0, 1.0)})
    run = mbd.simulate(model, np.linspace(0, 0.6, 7), initial=crane.rest, method=method)
    assert run[crane.bob.omega][-1] == pytest.approx(-np.cos(0.1 * np.sqrt(G)), abs=1e-2)
    energy = run[crane.bob.omega] ** 2 / 2 + G * (1 - np.cos(run[crane.bob.phi]))
    assert energy[-1] == pytest.approx(0.5, abs=1e-6)
    assert "jumps by 1 m/s at t = 0.5 s" in " ".join(run.statistics.notes)


def test_the_least_time_of_a_crane_with_its_acceleration_as_the_input(crane):
    """As long as the least time of a pendulum that hangs still at both ends, between 2.4145 and 2.4195 s."""
    x, v = crane.trolley.x, crane.trolley.vx
    problem = mbd.OptimalControlProblem(
        crane.mechanism,
        duration=(1, 6),
        initial=[*crane.rest, x == 0, v == 0],
        final=[*crane.rest, x == 2, v == 0],
        terminal_cost=mbd.t,
    )
    assert 2.4145 < mbd.optimize(problem).cost < 2.4195


@pytest.mark.parametrize(("scheme", "error"), [("gauss-legendre", 2e-3), ("hermite-simpson", 0.06)])
def test_the_least_time_of_a_move_with_limited_jerk(scheme, error):
    """1 m from rest to rest with jerks up to 4 m/s³ takes (32/4)^(1/3) = 2 s; inputs of Hermite–Simpson do not jump."""
    jerk = mbd.Input("jerk", lower=-4, upper=4)
    place, speed, acceleration = (mbd.StateVariable(x) for x in ("place", "speed", "acceleration"))
    trolley = mbd.Body("trolley", mass=3.0, inertia=1.0)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), trolley.at(0, 0))
    servo = mbd.Driver("servo", trolley.x, place)
    model = mbd.Mechanism(
        [trolley], [rail], [servo], inputs=[jerk], states={place: speed, speed: acceleration, acceleration: jerk}
    )
    at_rest = [trolley.vx == 0, acceleration == 0]
    problem = mbd.OptimalControlProblem(
        model,
        duration=(0.5, 5),
        initial=[trolley.x == 0, *at_rest],
        final=[trolley.x == 1, *at_rest],
        terminal_cost=mbd.t,
    )
    solution = mbd.optimize(problem, intervals=8, transcription=scheme)
    assert solution.cost == pytest.approx(2.0, abs=error)
    motion = solution.trajectory
    np.testing.assert_allclose(motion[servo.effort], 3.0 * motion[acceleration], atol=1e-6)
    np.testing.assert_allclose(motion[trolley.x], motion[place], atol=1e-9)


def test_inputs_that_would_have_to_be_differentiated(crane):
    with pytest.raises(mbd.ExpressionError, match="driver 'servo' depends on the input 'command'.*put states before"):
        mbd.Driver("servo", crane.trolley.x, crane.command)
    with pytest.raises(mbd.ModelError, match="driver 'servo' follows the state 'position', whose rate contains input"):
        crane.mechanism.replace(states={crane.position: crane.command, crane.velocity: 0})
    with pytest.raises(mbd.ModelError, match="contains velocity 'bob.omega'; the first time derivative"):
        crane.mechanism.replace(states={crane.position: crane.bob.omega, crane.velocity: crane.command})
    with pytest.raises(mbd.ExpressionError, match="relative_to= is for courses in time"):
        mbd.Driver("servo", crane.trolley.x, crane.position, relative_to=mbd.assemble(crane.mechanism))


def test_an_actuator_of_a_state():
    """A jack of which the speed is the input lifts an arm: its length is that of the triangle."""
    length, rate, pace = mbd.StateVariable("length", 1.0), mbd.StateVariable("rate"), mbd.Input("pace", 0.1)
    arm = mbd.Body("arm", mass=12.0, inertia=0.9, pose=(0.8, 0, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), arm.at(-0.8, 0))
    jack = mbd.Actuator("jack", mbd.ground.at(0, -0.6), arm.at(0, 0), length)
    model = mbd.Mechanism([arm], [pin], [jack], [mbd.Gravity()], [pace], states={length: rate, rate: pace})
    run = mbd.simulate(model, np.linspace(0, 1, 5))
    np.testing.assert_allclose(run[jack.length], 1 + 0.05 * run.t**2, atol=1e-10)
    np.testing.assert_allclose(np.sin(run[pin.angle]), (run[length] ** 2 - 1) / 0.96, atol=1e-8)
