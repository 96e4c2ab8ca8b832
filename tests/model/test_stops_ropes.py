"""Ropes against closed forms: bounce, slack over the top, winches; they never push and are not stepped over."""

import warnings

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import mbdcasadi as mbd

G = 9.81
TIGHT = {"reltol": 1e-10, "abstol": 1e-10}


def weight_on_a_rope(length=1.0, stiffness=200.0, damping=0.0, mass=2.0, y=0.0, **more):
    """A point mass below its anchor at the origin."""
    weight = mbd.Body("weight", mass=mass, inertia=0.01, pose=(0, y, 0))
    rope = mbd.Rope("rope", mbd.ground.at(0, 0), weight.at(0, 0), length, stiffness, damping)
    return weight, rope, mbd.Mechanism([weight], forces=[mbd.Gravity(), rope], **more)


# --- one mass, up and down ------------------------------------------------------------------------------------
def bounce(times, m, k, length):
    """Height of a mass that falls from the anchor; closed form over one bounce."""
    w, v = np.sqrt(k / m), np.sqrt(2 * G * length)
    fall = v / G
    taut = 2 / w * (np.pi - np.arctan(v * w / G))
    y = -G * times**2 / 2
    s = times - fall
    stretched = -length - G / w**2 * (1 - np.cos(w * s)) - v / w * np.sin(w * s)
    s = times - fall - taut
    up = -length + v * s - G * s**2 / 2
    return np.where(times < fall, y, np.where(times < fall + taut, stretched, up)), fall, taut


@pytest.mark.parametrize("method", ["idas", "erk", "rosenbrock"])
def test_vertical_bounce(method):
    """Free fall, half an oscillation and a bit on the taut rope, free flight back to the anchor."""
    m, k, length = 2.0, 200.0, 1.0
    weight, rope, model = weight_on_a_rope(length, k, mass=m)
    _, fall, taut = bounce(np.zeros(1), m, k, length)
    times = np.linspace(0, 2 * fall + taut, 201)
    motion = mbd.simulate(model, times, method=method, **TIGHT)
    height, *_ = bounce(times, m, k, length)
    np.testing.assert_allclose(motion[weight.y], height, atol=2e-6)
    tension = motion[rope.tension]
    np.testing.assert_allclose(tension, k * np.maximum(-height - length, 0), atol=1e-3)
    # m g h = k e²/2 with the whole height h = length + e
    longest = m * G / k * (1 + np.sqrt(1 + 2 * k * length / (m * G)))
    assert tension.max() == pytest.approx(k * longest, rel=2e-3) and tension.max() <= k * longest * (1 + 1e-6)
    assert tension.min() == 0
    np.testing.assert_allclose(motion.energy.total, motion.energy.total[0], atol=1e-6)
    assert motion[rope.gap] == pytest.approx(-motion[rope.elongation])


@pytest.mark.filterwarnings("error::mbdcasadi.MechanismWarning")  # it jumps when it gets taut, which is no failure
def test_damped_rope_in_three_pieces():
    """Fall, stretched until k e + c ė passes zero, and flight: pieces by SciPy; no force while it would push."""
    m, k, c, length = 2.0, 300.0, 8.0, 0.8
    weight, rope, model = weight_on_a_rope(length, k, c, mass=m)
    fall = np.sqrt(2 * length / G)

    def loose(_, e):
        return k * e[0] + c * e[1]

    loose.terminal, loose.direction = True, -1
    stretched = solve_ivp(
        lambda _, e: [e[1], G - (k * e[0] + c * e[1]) / m], (0, 5), [0, G * fall], events=loose, rtol=1e-11, atol=1e-12
    )
    end = fall + stretched.t[-1]
    e, rate = stretched.y[:, -1]
    assert e > 0.01  # it is still stretched there
    times = np.r_[0, 0.5 * fall, end, end + 0.1, end + 0.2]
    motion = mbd.simulate(model, times, **TIGHT)
    s = np.array([0, 0.1, 0.2])
    np.testing.assert_allclose(motion[weight.y][2:], -length - e - rate * s - G * s**2 / 2, atol=1e-5)
    np.testing.assert_allclose(motion[weight.vy][2:], -rate - G * s, atol=1e-5)
    assert motion[rope.tension][-1] == 0 and motion[rope.elongation][3] < e


def test_it_hangs_where_it_balances_the_weight():
    weight, rope, model = weight_on_a_rope(y=-1.02)
    rest = mbd.equilibrium(model, [weight.x == 0, weight.phi == 0])
    assert rest[rope.elongation] == pytest.approx(2.0 * G / 200.0, rel=1e-8)
    assert rest[rope.tension] == pytest.approx(2.0 * G, rel=1e-8)


# --- over the top ---------------------------------------------------------------------------------------------
def test_a_pendulum_on_a_rope_goes_slack_on_its_way_to_the_top():
    """It leaves the circle at T = 0, at sin α = (v² - 2 g L)/(3 g L) above the level of the pivot; then a parabola."""
    length, k, m = 1.0, 1e6, 1.0
    speed = np.sqrt(3.5 * G * length)
    e = m * (G + speed**2 / length) / k  # as stretched as it will be, so that nothing vibrates
    weight, rope, model = weight_on_a_rope(length, k, mass=m, y=-length - e)
    start = [weight.x == 0, weight.y == -length - e, weight.vx == speed, weight.vy == 0, weight.omega == 0]
    motion = mbd.simulate(model, np.linspace(0, 0.9, 901), initial=start, **TIGHT)
    taut = motion[rope.tension] > 0
    first = int(np.argmin(taut))
    alpha = np.arcsin((speed**2 - 2 * G * length) / (3 * G * length))
    found = np.arctan2(motion[weight.y][first], motion[weight.x][first])
    assert found == pytest.approx(alpha, abs=5e-3)
    x, y, vx, vy = motion[mbd.vertcat(weight.x, weight.y, weight.vx, weight.vy)][first]
    free = slice(first, first + 100)
    s = motion.t[free] - motion.t[first]
    np.testing.assert_allclose(motion[weight.x][free], x + vx * s, atol=1e-6)
    np.testing.assert_allclose(motion[weight.y][free], y + vy * s - G * s**2 / 2, atol=1e-6)
    assert not taut[free].any()
    assert motion[rope.gap][first + 50] > 0
    # the same on a massless rod: it is pushed where the rope is slack
    rod = mbd.Distance("rod", mbd.ground.at(0, 0), weight.at(0, 0), length)
    stiff = mbd.Mechanism([weight], [rod], forces=[mbd.Gravity()])
    pushed = mbd.simulate(stiff, np.linspace(0, 0.9, 91), initial=[weight.x == 0, weight.y == -length,
                                                                   weight.vx == speed])  # fmt: skip
    swing = np.arctan2(pushed[weight.y], pushed[weight.x])
    wanted = m * (speed**2 / length - 2 * G - 3 * G * np.sin(swing))
    np.testing.assert_allclose(pushed[rod.tension], wanted, atol=1e-5)
    assert pushed[rod.tension].min() < -1


# --- winches ----------------------------------------------------------------------------------------------------
def test_a_winch_lifts_with_its_drum():
    """L = L0 - R phi: Atwood's machine with a drum, from the elongation that keeps the tension constant."""
    radius, inertia, stiffness = 0.2, 0.5, 2e4
    acceleration = 3.0 * G / (3.0 + inertia / radius**2)
    tension = 3.0 * (G - acceleration)
    drum = mbd.Body("drum", mass=10, inertia=inertia)
    weight = mbd.Body("weight", mass=3.0, inertia=0.1, pose=(0, -2 - tension / stiffness, 0))
    hub = mbd.Revolute("hub", mbd.ground.at(0, 0), drum.at(0, 0))
    rope = mbd.Rope("rope", mbd.ground.at(0, 0), weight.at(0, 0), 2 - radius * hub.angle, stiffness)
    model = mbd.Mechanism([drum, weight], [hub], forces=[mbd.Gravity(), rope])
    times = np.linspace(0, 1, 101)
    motion = mbd.simulate(model, times, **TIGHT)
    np.testing.assert_allclose(motion[rope.tension], tension, rtol=1e-6)
    np.testing.assert_allclose(motion[weight.y], motion[weight.y][0] - acceleration * times**2 / 2, atol=1e-8)
    np.testing.assert_allclose(motion[radius * drum.phi], -acceleration * times**2 / 2, atol=1e-8)
    assert set(rope.bodies) == {mbd.ground, weight, drum}


def test_a_rope_that_gets_shorter_in_time():
    """Hauled at constant speed from rest: the tension oscillates about the weight by v √(k m), and stays positive."""
    pull, m, k = 0.4, 2.0, 800.0
    weight = mbd.Body("weight", mass=m, inertia=0.01, pose=(0, -1, 0))
    rope = mbd.Rope("rope", mbd.ground.at(0, 0), weight.at(0, 0), 1 - m * G / k - pull * mbd.t, k)
    model = mbd.Mechanism([weight], forces=[mbd.Gravity(), rope])
    times = np.linspace(0, 1, 2001)
    motion = mbd.simulate(model, times, initial=[weight.y == -1, weight.vy == 0], **TIGHT)
    w = np.sqrt(k / m)
    np.testing.assert_allclose(motion[rope.tension], m * G + k * pull / w * np.sin(w * times), atol=1e-5)


# --- nothing is stepped over, nothing is said in vain ------------------------------------------------------------
@pytest.mark.slow
@pytest.mark.parametrize("method", ["idas", "erk", "rosenbrock"])
@pytest.mark.parametrize("duration", [2.0, 40.0])
def test_a_short_pull_is_met(method, duration):
    """A mass in free flight comes to the end of a stiff rope for a millisecond: its speed is reversed, quietly."""
    puck = mbd.Body("puck", mass=1.0, inertia=0.01, pose=(0.1, 0, 0), velocity=(1.0, 0, 0))
    rope = mbd.Rope("leash", mbd.ground.at(0, 0), puck.at(0, 0), 1.0, 1e7)
    model = mbd.Mechanism([puck], forces=[rope])
    with warnings.catch_warnings():
        warnings.simplefilter("error", mbd.MechanismWarning)
        motion = mbd.simulate(model, [0, 1.5, duration], method=method)
    pull = np.pi * np.sqrt(1.0 / 1e7)
    assert motion[puck.vx][1] == pytest.approx(-1.0, abs=1e-4)
    assert motion[puck.x][1] == pytest.approx(1.0 - (1.5 - 0.9 - pull), abs=1e-4)


def test_a_rope_between_two_bodies_keeps_momentum():
    """Two masses that fly apart come back: the sum of momenta is kept, and the pull acts at the markers."""
    a = mbd.Body("a", mass=1.0, inertia=0.1, pose=(-0.2, 0, 0), velocity=(-1, 0.2, 1))
    b = mbd.Body("b", mass=3.0, inertia=0.3, pose=(0.2, 0, 0), velocity=(1, 0, 0))
    rope = mbd.Rope("leash", a.at(0, 0.1), b.at(0.1, 0), 1.0, 500.0, 5.0)
    model = mbd.Mechanism([a, b], forces=[rope])
    motion = mbd.simulate(model, np.linspace(0, 2, 41), **TIGHT)
    momentum = motion[a.mass * a.velocity + b.mass * b.velocity]
    np.testing.assert_allclose(momentum, np.tile(momentum[:1], (41, 1)), atol=1e-8)
    spin = a.mass * (a.x * a.vy - a.y * a.vx) + b.mass * (b.x * b.vy - b.y * b.vx)
    spin = motion[spin + a.inertia * a.omega + b.inertia * b.omega]
    np.testing.assert_allclose(spin, spin[0], atol=1e-8)
    assert motion.energy.total[-1] < motion.energy.total[0] - 0.1


# --- bad input ----------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    "more, words",
    [
        ({"length": 0}, "rope 'r': length must be above 0"),
        ({"length": -1}, "rope 'r': length must be above 0"),
        ({"stiffness": 0}, "rope 'r': stiffness must be above 0"),
        ({"stiffness": np.nan}, "rope 'r': stiffness must be finite"),
        ({"damping": -1}, "rope 'r': damping must be at least 0"),
        ({"damping": "much"}, "rope 'r': damping must be a number"),
    ],
)
def test_refuses(more, words):
    body = mbd.Body("b", 1, 1)
    with pytest.raises(mbd.ModelError, match=words):
        mbd.Rope("r", mbd.ground.at(0, 0), body.at(0, 0), **({"length": 1, "stiffness": 10} | more))


def test_refuses_what_no_length_is_made_of():
    body = mbd.Body("b", 1, 1)
    with pytest.raises(mbd.ExpressionError, match="rope 'r' depends on the velocity 'b.vx'"):
        mbd.Rope("r", mbd.ground.at(0, 0), body.at(0, 0), 1 + body.vx, 10)
    with pytest.raises(mbd.ModelError, match="itself"):
        mbd.Rope("r", body.at(0, 0), body.at(1, 0), 1, 10)
    with pytest.raises(mbd.ModelError, match="must be a marker"):
        mbd.Rope("r", mbd.ground, body.at(0, 0), 1, 10)


def test_a_parameter_keeps_to_its_limits_in_each_analysis():
    k = mbd.Parameter("k", 100.0)
    _, _, model = weight_on_a_rope(stiffness=k, parameters=[k])
    with pytest.raises(mbd.ModelError, match="rope 'rope': stiffness must be above 0, got -1.0 with parameter 'k'"):
        mbd.simulate(model, [0, 1], parameters={k: -1.0})
