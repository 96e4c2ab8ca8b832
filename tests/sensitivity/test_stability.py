"""Stability of simulated motions: Floquet multipliers by saltation matrices, against closed forms."""

import numpy as np
import pytest
from scipy.optimize import brentq

import mbdcasadi as mbd

G = 9.81


def wheel():
    """A rimless wheel over one step, from just after an impact, and what of its speed an impact leaves."""
    half, slope, m, J0 = np.pi / 8, 0.08, 2.0, 0.1
    body = mbd.Body("wheel", mass=m, inertia=J0, pose=(-np.sin(half), np.cos(half), 0.0))
    feet = [body.at(np.sin(half * (2 * k + 1)), -np.cos(half * (2 * k + 1))) for k in range(2)]
    pins = [mbd.Revolute(f"spoke {k}", mbd.ground.at(2 * np.sin(half) * k, 0), feet[k]) for k in range(2)]
    gravity = mbd.Gravity((G * np.sin(slope), -G * np.cos(slope)))
    on = [mbd.Mechanism(bodies=[body], joints=[pin], forces=[gravity]) for pin in pins]
    lands = mbd.Event("lands", feet[1].y, direction=-1, during=on[0], becomes=on[1], terminal=True)
    share = (J0 + m * np.cos(2 * half)) / (J0 + m)
    gain = 4 * m * G * np.sin(half) * np.sin(slope) / (J0 + m)
    speed = np.sqrt(share**2 * gain / (1 - share**2))
    motion = mbd.simulate(
        on[0],
        np.linspace(0, 3, 61),
        initial=[body.phi == 0, body.omega == -speed],
        events=[lands],
        reltol=1e-11,
        abstol=1e-11,
    )
    turn = 2 * half
    same = [
        mbd.at_end(body.omega) == mbd.at_start(body.omega),
        mbd.at_end(body.phi) + turn == mbd.at_start(body.phi),
    ]
    return body, on, lands, share, motion, same


def test_a_rimless_wheel():
    """The speed of a disturbed wheel comes back by the square of the share; where it begins the step is forgotten."""
    *_, lands, share, motion, same = wheel()
    found = mbd.stability(motion, same, events=[lands])
    np.testing.assert_allclose(found.multipliers, [share**2, 0], atol=1e-8)
    assert found.is_stable


def test_a_swing_of_a_fixed_time():
    """A damped oscillator over one period of its frequency: the multipliers are exp(-zeta omega T)."""
    body = mbd.Body("body", mass=2.0, inertia=0.1)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), body.at(0, 0))
    k, c = 50.0, 3.0
    forces = [mbd.Force("spring", body.at(0, 0), (-k * body.x - c * body.vx, 0))]
    model = mbd.Mechanism(bodies=[body], joints=[rail], forces=forces)
    motion = mbd.simulate(model, np.linspace(0, 1.7, 18), initial=[body.x == 0, body.vx == 0])
    same = [mbd.at_end(x) == mbd.at_start(x) for x in (body.x, body.vx)]
    found = mbd.stability(motion, same)
    a = np.array([[0, 1], [-k / 2, -c / 2]])
    expected = np.exp(np.linalg.eigvals(a) * 1.7)
    np.testing.assert_allclose(np.sort_complex(found.multipliers), np.sort_complex(expected), atol=1e-9)


def test_it_says_what_is_wrong():
    body, _on, lands, _share, motion, same = wheel()
    with pytest.raises(mbd.ModelError, match="boundary= is empty"):
        mbd.stability(motion)
    with pytest.raises(mbd.ModelError, match="takes a Trajectory"):
        mbd.stability(motion.initial, same)
    with pytest.raises(mbd.ModelError, match="decide 1 of 2 quantities of the next start; .* boundary="):
        mbd.stability(motion, same[:1], events=[lands])
    with pytest.raises(mbd.ModelError, match="takes equalities"):
        mbd.stability(motion, [mbd.at_end(body.omega) <= mbd.at_start(body.omega)], events=[lands])
    with pytest.raises(mbd.ModelError, match="in accelerations"):
        mbd.stability(motion, [mbd.at_end(body.alpha) == mbd.at_start(body.alpha)], events=[lands])
    with pytest.raises(mbd.ModelError, match="'lands' of the motion is not in events="):
        mbd.stability(motion, same)
    with pytest.warns(mbd.MechanismWarning, match="not periodic"):
        mbd.stability(motion, [mbd.at_end(body.phi) == mbd.at_start(body.phi), same[0]], events=[lands])


def test_a_ball_on_a_table_that_shakes():
    """Against differences of its own map from impact to impact; a period that an event ends has a clock of its own."""
    g, amplitude, period, e = 10.0, 0.03, 0.5, 0.8
    w = 2 * np.pi / period
    ball = mbd.Body("ball", mass=1.0, inertia=1.0, pose=(0, 0.1, 0))
    guides = [mbd.AbsoluteX("x", ball.at(0, 0), 0), mbd.AbsoluteAngle("angle", ball.at(0, 0), 0)]
    flying = mbd.Mechanism([ball], joints=guides, forces=[mbd.Gravity((0, -g))])
    table = mbd.Driver("table", ball.y, amplitude * mbd.sin(w * mbd.t))
    gap = ball.y - amplitude * mbd.sin(w * mbd.t)

    def next_impact(state):
        begin, speed = state
        height = amplitude * np.sin(w * begin)
        lasts = brentq(
            lambda x: height + speed * x - g * x**2 / 2 - amplitude * np.sin(w * (begin + x)), 0.3, 0.7, xtol=1e-14
        )
        plate = amplitude * w * np.cos(w * (begin + lasts))
        return np.array([begin + lasts, plate - e * (speed - g * lasts - plate)])

    # the table gives back what an impact takes
    begin = np.arccos(g * period / 2 * (1 - e) / (1 + e) / (amplitude * w)) / w
    impact = np.array([begin, g * period / 2])
    by_hand = np.linalg.eigvals(
        np.array([(next_impact(impact + h) - next_impact(impact - h)) / 2e-6 for h in 1e-6 * np.eye(2)]).T
    )

    same = [mbd.at_end(x) == mbd.at_start(x) for x in (ball.y, ball.vy)]
    highest = amplitude * np.sin(w * begin) + g * period**2 / 8
    half = begin + period / 2
    hit = mbd.Event("hit", gap, direction=-1, during=flying, becomes=flying, restitution={table: e})
    start = mbd.assemble(flying, [ball.y == highest, ball.vy == 0], t=half)
    motion = mbd.simulate(flying, np.linspace(half, half + period, 51), initial=start, events=[hit])
    found = mbd.stability(motion, same, events=[hit])
    np.testing.assert_allclose(np.sort_complex(found.multipliers), np.sort_complex(by_hand), atol=1e-6)

    ends = mbd.Event("ends", gap, direction=-1, during=flying, becomes=flying, restitution={table: e}, terminal=True)
    start = mbd.assemble(flying, [ball.y == amplitude * np.sin(w * begin), ball.vy == g * period / 2], t=begin)
    motion = mbd.simulate(flying, np.linspace(begin, begin + 1, 51), initial=start, events=[ends])
    with pytest.warns(mbd.MechanismWarning, match="depends on time, and event 'ends' ends the period"):
        mbd.stability(motion, same, events=[ends])

    problem = mbd.OptimalControlProblem(
        phases=[mbd.Phase("flies", flying, (0.3, 0.7)), mbd.Phase("hits", flying, 0, restitution={table: e})],
        boundary=same,
    )
    with pytest.warns(mbd.MechanismWarning, match="depends on time, and durations are free"):
        mbd.optimize(problem, guess=motion, intervals=10).stability()
