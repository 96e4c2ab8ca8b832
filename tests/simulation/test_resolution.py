"""Steps that jump over smoothed friction or over a contact are reported, and contacts are not jumped over."""

import re
import warnings
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from seeds import seeds

import mbdcasadi as mbd
import mbdcasadi.simulation.policies
from mbdcasadi.integrators.native import runner

G = 9.81


def belt(law, speed=2.0):
    """A block held by a spring on a running belt."""
    band = mbd.Body("belt", mass=1, inertia=1)
    block = mbd.Body("block", mass=1, inertia=0.1)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), band.at(0, 0))
    seat = mbd.Translational("seat", band.at(0, 0), block.at(0, 0))
    rub = mbd.JointFriction("rub", seat, law)
    spring = mbd.TSDA("spring", mbd.ground.at(-5, 0), block.at(0, 0), stiffness=100, free_length=5)
    drive = mbd.Driver("run", rail.displacement, speed * mbd.t)
    return block, mbd.Mechanism([band, block], [rail, seat], drivers=[drive], forces=[mbd.Gravity(), rub, spring])


def run(law, **settings):
    """Path of the block, and the warnings."""
    block, mechanism = belt(law)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        motion = mbd.simulate(mechanism, np.linspace(0, 3, 31), initial=[block.x == 0, block.vx == 3], **settings)
    texts = [str(w.message) for w in caught if issubclass(w.category, mbd.MechanismWarning)]
    assert all(text in motion.statistics.notes for text in texts)
    return motion[block.x], texts


@pytest.fixture(scope="module")
def exact():
    """Path of the block by dry friction."""
    return run(mbd.DryFriction(0.3))[0]


@pytest.mark.slow
@pytest.mark.parametrize(
    "method, settings",
    [
        ("idas", {"reltol": 1e-2}),
        ("idas", {"options": {"abstol": 1e-3}}),
        ("rosenbrock", {"reltol": 1e-3}),
        ("rosenbrock", {"options": {"abstol": 1e-3}}),
    ],
)
def test_steps_over_the_change_of_sign_are_told(exact, method, settings):
    """With careless tolerances the motion is wrong and reported; with the chosen ones it is right, and quiet."""
    right, quiet = run(mbd.Coulomb(0.3, 1e-4), method=method)
    wrong, texts = run(mbd.Coulomb(0.3, 1e-4), method=method, **settings)
    assert np.abs(right - exact).max() < 5e-5 and not quiet
    assert np.abs(wrong - exact).max() > 2e-4
    assert len(texts) == 1 and "friction 'rub'" in texts[0]
    assert "at t = " in texts[0] and "reltol" in texts[0] and "DryFriction" in texts[0]


def test_bristles_have_their_tolerance():
    """The absolute tolerance follows the deflection; bristles that are too stiff are refused."""
    block, mechanism = belt(mbd.LuGre(0.3, 0.3, 1e-2, 1e6))
    motion = mbd.simulate(mechanism, np.linspace(0, 1, 11), initial=[block.x == 0, block.vx == 3])
    assert any(note.startswith("abstol = 3.0e-10") for note in motion.statistics.notes)
    block, mechanism = belt(mbd.LuGre(0.3, 0.3, 1e-2, 1e10))
    with pytest.raises(mbd.SimulationError, match=r"'rub': the largest deflection of the bristles, 3e-11 m"):
        mbd.simulate(mechanism, [0, 1], initial=[block.vx == 3])


@pytest.mark.slow
@pytest.mark.parametrize("method", ["idas", "erk", "rosenbrock"])
@pytest.mark.parametrize("duration", [3.0, 50.0])
def test_a_short_contact_is_not_jumped_over(method, duration):
    """Two discs that meet for a millisecond in a long free flight exchange their velocities."""
    a = mbd.Body("a", mass=1, inertia=0.01, pose=(-1, 0, 0), velocity=(1, 0, 0))
    b = mbd.Body("b", mass=1, inertia=0.01)
    hit = mbd.Contact("hit", mbd.Circle(a.at(0, 0), 0.02), mbd.Circle(b.at(0, 0), 0.02), mbd.HuntCrossley(1e8))
    motion = mbd.simulate(mbd.Mechanism([a, b], forces=[hit]), np.linspace(0, duration, 11), method=method)
    assert motion[a.vx][-1] == pytest.approx(0, abs=1e-4)
    assert motion[b.vx][-1] == pytest.approx(1, abs=1e-4)
    # the contact lasts 2.94 (5 m/4 k)^0.4 v^-0.2 (Hertz, with the reduced mass), in which both go on by half of the way
    free = duration - 0.96
    assert motion[b.x][-1] == pytest.approx(free, abs=2e-3)


@pytest.mark.filterwarnings("ignore::mbdcasadi.MechanismWarning")
def test_what_passes_through_is_told(monkeypatch):
    """If a new start does not help, it is reported, with a step that meets the contact."""
    monkeypatch.setattr(mbdcasadi.simulation.policies, "NEW_START", 2.0)

    def discs(**settings):
        a = mbd.Body("a", mass=1, inertia=0.01, pose=(-1, 0, 0), velocity=(1, 0, 0))
        b = mbd.Body("b", mass=1, inertia=0.01)
        hit = mbd.Contact("hit", mbd.Circle(a.at(0, 0), 0.02), mbd.Circle(b.at(0, 0), 0.02), mbd.HuntCrossley(1e8))
        return mbd.simulate(mbd.Mechanism([a, b], forces=[hit]), np.linspace(0, 50, 11), **settings)[a.vx][-1]

    with pytest.warns(mbd.MechanismWarning, match=r"'hit': the surfaces pass.*0\.04 m deep.*at t = 0\.9") as caught:
        assert discs() == 1.0
    step = float(re.search(r"mbd\.IDAS\(max_step=([0-9.e-]+)\)", " ".join(str(w.message) for w in caught))[1])
    assert discs(method=mbd.IDAS(max_step=step)) == pytest.approx(0, abs=1e-4)


def test_sensitivities_and_sweeps_meet_short_contacts():
    """The velocity after an elastic blow by the masses: ``v = 2 m_a/(m_a + m_b)``, and its derivative."""
    mass = mbd.Parameter("m", 1.0)
    a = mbd.Body("a", mass=mass, inertia=0.01, pose=(-1, 0, 0), velocity=(1, 0, 0))
    b = mbd.Body("b", mass=1, inertia=0.01)
    hit = mbd.Contact("hit", mbd.Circle(a.at(0, 0), 0.02), mbd.Circle(b.at(0, 0), 0.02), mbd.HuntCrossley(1e7))
    mechanism = mbd.Mechanism([a, b], forces=[hit], parameters=[mass])
    times = np.linspace(0, 3, 7)
    swept = mbd.sweep(mechanism, times, cases={mass: [0.5, 1.0, 3.0]}, outputs={"v": b.vx})
    np.testing.assert_allclose(np.asarray(swept["v"])[:, -1], [2 / 3, 1.0, 1.5], atol=1e-5)
    slope = mbd.sensitivities(mechanism, times, outputs=[b.vx], wrt=[mass])[b.vx, mass][-1]
    assert slope == pytest.approx(0.5, abs=1e-4)


def test_what_carries_nothing_is_quiet():
    """Discs that touch at rest without a load, and a block that slides along a floor at zero gap: no warning."""
    a = mbd.Body("a", mass=1, inertia=0.01, pose=(0.1, 0.3, 0))
    b = mbd.Body("b", mass=1, inertia=0.01, pose=(0.3, 0.3, 0))
    c = mbd.Body("c", mass=1, inertia=0.01, pose=(0, 0.1, 0), velocity=(1, 0, 0))
    block = mbd.PolygonEdges(c.at(0, 0), [(-0.1, -0.1), (0.1, -0.1), (0.1, 0.1), (-0.1, 0.1)])
    discs = [mbd.Circle(body.at(0, 0), 0.1) for body in (a, b)]
    contacts = [
        mbd.Contact("discs", *discs, mbd.HuntCrossley(1e8)),
        mbd.Contact("floor", block, mbd.HalfPlane(mbd.ground.at(0, 0)), mbd.HuntCrossley(1e6), mbd.Coulomb(0.3, 1e-3)),
    ]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        motion = mbd.simulate(mbd.Mechanism([a, b, c], forces=contacts), np.linspace(0, 5, 51))
    assert motion[c.x][-1] == pytest.approx(5, abs=1e-6)
    assert np.ptp(motion[a.x]) < 1e-9
    assert motion.statistics.restarts < 5


def test_a_cradle_of_elastic_balls():
    """Five pendulums in a row by Hertz's contact: nearly all goes through to the last one, the energy is kept."""
    length, radius, count = 1.0, 0.05, 5
    balls = [mbd.Body(f"ball {k}", mass=0.2, inertia=1e-4, pose=(2 * k * radius, -length, 0)) for k in range(count)]
    strings = [
        mbd.Revolute(f"string {k}", mbd.ground.at(2 * k * radius, 0), ball.at(0, length))
        for k, ball in enumerate(balls)
    ]
    law, outlines = mbd.HuntCrossley(1e9), [mbd.Circle(ball.at(0, 0), radius) for ball in balls]
    hits = [mbd.Contact(f"hit {k}", outlines[k], outlines[k + 1], law) for k in range(count - 1)]
    mechanism = mbd.Mechanism(balls, strings, forces=[mbd.Gravity(), *hits])
    start = [balls[0].phi == -0.3, *[ball.phi == 0 for ball in balls[1:]], *[ball.omega == 0 for ball in balls]]
    motion = mbd.simulate(mechanism, np.linspace(0, 1.3, 131), initial=start)
    speed = np.sqrt(2 * G * length * (1 - np.cos(0.3)))

    def chain(_, state):
        """The balls on a line, from the first touch on."""
        force = 1e9 * np.maximum(-np.diff(state[:count]), 0) ** 1.5
        return np.r_[state[count:], -np.diff(np.r_[0, force, 0]) / 0.2]

    after = solve_ivp(chain, (0, 5e-3), np.r_[np.zeros(count), speed, np.zeros(count - 1)], rtol=1e-10, atol=1e-13)
    share = after.y[-1, -1] / speed
    assert 0.98 < share < 0.995
    # the strings turn the balls a little as they swing, with 1e-4/(0.2 length²) of the inertia
    highest = np.arccos(1 - (share * speed) ** 2 / (2 * G * length))
    assert motion[balls[-1].phi].max() == pytest.approx(highest, rel=2e-3)
    np.testing.assert_allclose(motion.energy.total, motion.energy.total[0], atol=1e-6)


@pytest.mark.parametrize("outputs", [7, 61, 601])
def test_a_stiff_bar_is_not_fallen_through(outputs):
    """Steps of free flight end deep in a thin bar, whose force there points to the other side; the run starts again."""
    found = []
    for thin in (True, False):
        disc = mbd.Body("disc", mass=1, inertia=0.01, pose=(0, 0.3, 0))
        ground = mbd.ground.at(0, 0 if thin else 0.01)
        surface = mbd.Segment(ground, 2, radius=0.01) if thin else mbd.HalfPlane(ground)
        law = mbd.HuntCrossley(1e6, damping=2)
        contact = mbd.Contact("contact", mbd.Circle(disc.at(0, 0), 0.1), surface, law)
        mechanism = mbd.Mechanism(bodies=[disc], forces=[mbd.Gravity(), contact])
        with warnings.catch_warnings():
            warnings.simplefilter("error", mbd.MechanismWarning)
            motion = mbd.simulate(mechanism, np.linspace(0, 0.6, outputs))
        assert np.diff(motion.energy.total).max() < 1e-6
        found.append(motion[disc.y])
    np.testing.assert_allclose(found[0], found[1], atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(("radius", "stiffness", "speed", "height"), [(1e-3, 1e8, 5.0, 4.0), (5e-3, 3e7, 20.0, 12.0)])
@pytest.mark.parametrize("outputs", [2, 11, 101])
def test_undamped_blow_that_the_motion_follows_is_not_warned_of(radius, stiffness, speed, height, outputs):
    """A small ball on a linear spring of contact: it leaves as fast as it came, after half a period."""
    mass, peg = 0.01, 5e-3
    ball = mbd.Body("ball", mass=mass, inertia=0.4 * mass * radius**2, pose=(0, peg + radius + height, 0))
    outlines = mbd.Circle(ball.at(0, 0), radius), mbd.Circle(mbd.ground.at(0, 0), peg)
    blow = mbd.Contact("blow", *outlines, mbd.HuntCrossley(stiffness, 1.0, 0.0))
    mechanism = mbd.Mechanism(bodies=[ball], forces=[mbd.Gravity(), blow])
    g, omega = 9.81, np.sqrt(stiffness / mass)
    met = np.sqrt(speed**2 + 2 * g * height)
    closed = (np.pi - 2 * np.arctan2(-g / omega**2, met / omega)) / omega
    times = np.linspace(0, (met - speed) / g + closed + 0.1, outputs)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        motion = mbd.simulate(mechanism, times, initial=[ball.vy == -speed])
    assert motion[ball.vy][-1] == pytest.approx(met - 0.1 * g, rel=1e-6)


def ball_before_peg(random):
    """A ball at random that comes to a hard peg without damping, their contact, the speed, and the way to the peg."""
    mass, speed = 10 ** random.uniform(-3, 0), 10 ** random.uniform(0, 2.2)
    radius, peg = 10 ** random.uniform(-3, -1.5, 2)
    distance, exponent = 10 ** random.uniform(-1, 1.5), random.choice([1.0, 1.5])
    softest = (exponent + 1) / 2 * mass * speed**2 / (0.1 * min(radius, peg)) ** (exponent + 1)
    law = mbd.HuntCrossley(softest * 10 ** random.uniform(0, 4), exponent, 0.0)
    ball = mbd.Body("ball", mass=mass, inertia=0.4 * mass * radius**2, pose=(-radius - peg - distance, 0, 0))
    hit = mbd.Contact("hit", mbd.Circle(ball.at(0, 0), radius), mbd.Circle(mbd.ground.at(0, 0), peg), law)
    return ball, hit, speed, distance


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("steps", [None, 1], ids=["", "a call for each step"])
def test_hard_balls_bounce_off_a_peg_by_dop853(seed, steps, monkeypatch):
    """Undamped contacts return the ball as fast as it came, however long the steps of free flight are.

    Nor does it matter how often the code in C comes back on the way.
    """
    if steps is not None:
        monkeypatch.setattr(runner.Runner, "slice", steps)
    random = np.random.default_rng(seed)
    for _ in range(5):
        ball, hit, speed, distance = ball_before_peg(random)
        times = np.linspace(0, random.uniform(1.3, 3) * distance / speed, random.choice([2, 11, 101]))
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            motion = mbd.simulate(
                mbd.Mechanism([ball], forces=[hit]), times, initial=[ball.vx == speed], method="dop853"
            )
        assert motion[ball.vx][-1] == pytest.approx(-speed, rel=1e-4)


def test_a_ball_of_fifty_grams_does_not_pass_a_thin_peg_by_dop853():
    """At 100 m/s on a peg of 1 mm; the stages of the interpolation alone met it."""
    ball = mbd.Body("ball", mass=0.05, inertia=1e-5, pose=(-1, 0, 0))
    outlines = mbd.Circle(ball.at(0, 0), 0.02), mbd.Circle(mbd.ground.at(0, 0), 1e-3)
    hit = mbd.Contact("hit", *outlines, lambda depth, rate: 1e10 * depth)
    motion = mbd.simulate(
        mbd.Mechanism([ball], forces=[hit]), np.linspace(0, 0.02, 11), initial=[ball.vx == 100], method="dop853"
    )
    assert motion[ball.vx][-1] == pytest.approx(-100, rel=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["idas", "erk", "dop853"])
@pytest.mark.parametrize("seed", seeds(1000))
def test_random_blows_behind_random_loads_are_met(seed, method):
    """A ball comes back from a peg as fast as it came, through the range of a load that it passes twice."""
    random = np.random.default_rng(seed)
    ball, hit, speed, distance = ball_before_peg(random)
    width, gain = 10 ** random.uniform(-3, -1.3) * distance, random.uniform(0.05, 0.3)
    push = gain * ball.mass * speed**2 / (2 * width * np.sqrt(np.pi))
    bell = mbd.exp(-(((ball.x - ball.pose_estimate[0] - distance + 3 * width) / width) ** 2))
    load = mbd.Force("load", ball.at(0, 0), (push * bell, 0))
    times = np.linspace(0, random.uniform(2.2, 3) * distance / speed, random.choice([2, 11, 101, 1001]))
    motion = mbd.simulate(mbd.Mechanism([ball], forces=[hit, load]), times, initial=[ball.vx == speed], method=method)
    assert motion[ball.vx][-1] == pytest.approx(-speed, rel=1e-3)


def test_a_gap_that_interpolation_alone_closes_is_not_told():
    """A row of springs moves its last body away from a stop with ``t**5``; a cubic through two outputs dips into it."""
    bodies = [mbd.Body(f"body {k}", 1.0, 1.0) for k in range(3)]
    rails = [mbd.Translational(f"rail of {b.name}", mbd.ground.at(0, 0), b.at(0, 0)) for b in bodies]
    pairs = [(a.x - b.x, -5000 * (a.x - b.x)) for a, b in pairwise(bodies)]
    stop = mbd.EndStop("stop", bodies[2].x, mbd.HuntCrossley(1e5, exponent=1, damping=0.5))
    row = mbd.Mechanism(bodies, rails, forces=[mbd.GeneralizedForce("springs", pairs), stop])
    rest = [relation for b in bodies for relation in (b.x == 0, b.vx == (1.0 if b is bodies[0] else 0.0))]
    run = mbd.simulate(row, np.linspace(0, 2, 5), initial=rest)
    assert not run.statistics.notes
    assert run[bodies[2].x][-1] == pytest.approx(2 / 3, abs=5e-3)
