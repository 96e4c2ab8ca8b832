"""Floquet multipliers of gaits, against closed forms and an independent return map."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve
from test_phase_program import gripper, rimless

import mbdcasadi as mbd

SLOPE = 0.009


def test_a_rimless_wheel():
    """The speed after an impact goes with mu² of the one before: ω⁺² = mu² (ω² + g)."""
    _, _, problem = rimless()
    found = mbd.optimize(problem, intervals=20).stability()
    mu = (0.1 + 2 * np.cos(np.pi / 4)) / 2.1
    np.testing.assert_allclose(found.multipliers, [mu**2], atol=1e-8)
    assert found.is_stable and "stable, Floquet multipliers 0.5199" in repr(found)


def return_map(x):
    """A step of the simplest walker (Garcia et al. 1998), whose feet have no mass: next start, and its time."""

    def rate(_, y):
        theta, phi, w, v = y
        a = np.sin(theta - SLOPE)
        return [w, v, a, a + w**2 * np.sin(phi) - np.cos(theta - SLOPE) * np.sin(phi)]

    def strike(_, y):
        return y[1] - 2 * y[0]

    theta, w = x
    start = [theta, 2 * theta, w, (1 - np.cos(2 * theta)) * w]
    run = solve_ivp(rate, (0, 6), start, events=strike, rtol=1e-12, atol=1e-13, method="DOP853")
    t, y = next((t, y) for t, y in zip(run.t_events[0], run.y_events[0], strict=True) if t > 1 and y[0] < -0.05)
    return np.array([-y[0], np.cos(2 * y[0]) * y[2]]), t


def simplest_walker(x, beta):
    """The same with feet of mass beta: the gait."""
    angle, w = x

    def up(a):
        return np.array([-np.sin(a), np.cos(a)])

    hip = mbd.Body("hip", mass=1.0, inertia=0, pose=(*up(angle), 0))
    one = mbd.Body("leg 1", mass=beta, inertia=0, pose=(0, 0, angle))
    two = mbd.Body("leg 2", mass=beta, inertia=0, pose=(*(up(angle) - up(-angle)), -angle))
    upright = mbd.AbsoluteAngle("hip does not turn", hip.at(0, 0), 0.0)
    hips = [mbd.Revolute(f"hip of {b.name}", hip.at(0, 0), b.at(0, 1)) for b in (one, two)]
    step = mbd.Parameter("step", 0.4, lower=0.1, upper=1.0)
    foot_1 = mbd.Revolute("foot 1", mbd.ground.at(0, 0), one.at(0, 0))
    foot_2 = mbd.Revolute("foot 2", mbd.ground.at(step, 0), two.at(0, 0))
    downhill = mbd.Gravity((np.sin(SLOPE), -np.cos(SLOPE)))
    on_1 = mbd.Mechanism(bodies=[hip, one, two], joints=[upright, *hips, foot_1], forces=[downhill])
    on_2 = on_1.replace(joints=[upright, *hips, foot_2], parameters=[step])
    swing = mbd.Phase("swing", on_1, (3.4, 4.5), final=[two.vy <= 0])
    gait = mbd.OptimalControlProblem(
        phases=[swing, mbd.Phase("touch-down", on_2, 0)],
        boundary=[
            mbd.at_end(two.phi) == mbd.at_start(one.phi),
            mbd.at_end(two.omega) == mbd.at_start(one.omega),
            mbd.at_end(one.phi) == mbd.at_start(two.phi),
            mbd.at_end(one.omega) == mbd.at_start(two.omega),
        ],
        free_parameters=[step],
    )
    lands = mbd.Event(
        "lands",
        mbd.if_else(one.phi < -0.05, two.y, 1.0),
        direction=-1,
        becomes=on_2,
        reset={step: two.x},
        terminal=True,
    )
    start = [one.phi == angle, two.phi == -angle, one.omega == w, two.omega == w * np.cos(2 * angle)]
    rough = mbd.simulate(on_1, np.linspace(0, 6, 601), initial=start, events=[lands])
    return mbd.optimize(gait, intervals=40, guess=rough), one


@pytest.mark.slow
def test_the_simplest_walker():
    """As the mass of the feet goes to zero, by extrapolation: start, period and multipliers."""
    x = fsolve(lambda x: return_map(x)[0] - x, [0.2003109, -0.1998325], xtol=1e-13)
    h = 1e-5
    weights = {-2: 1, -1: -8, 1: 8, 2: -1}
    slopes = [sum(c * return_map(x + k * h * e)[0] for k, c in weights.items()) / (12 * h) for e in np.eye(2)]
    exact = np.linalg.eigvals(np.column_stack(slopes))
    exact = exact[np.argsort(-exact.imag)]
    found = []
    for beta in (1e-4, 1e-5):
        solution, one = simplest_walker(x, beta)
        multipliers = solution.stability().multipliers
        assert np.max(np.abs(multipliers[2:])) < 1e-6  # the speed of the swing leg after the impact is given
        pair = multipliers[:2][np.argsort(-multipliers[:2].imag)]
        found.append(np.r_[pair, solution.duration, solution.phases[0].initial[one.phi]])
    limit = found[1] + (found[1] - found[0]) / 9
    np.testing.assert_allclose(limit[:2], exact, atol=1e-6)
    np.testing.assert_allclose(limit[2:], [return_map(x)[1], x[0]], atol=1e-6)


@pytest.mark.slow
def test_what_is_no_return_map():
    arm, _load, _tau, _hinge, _grip, reaching, carrying, start, end, *_ = gripper(limit=40.0)
    phases = [
        mbd.Phase("reach", reaching, 0.8, initial=start, final=[arm.omega == 0]),
        mbd.Phase("carry", carrying, 0.5, final=end),
    ]
    solution = mbd.optimize(mbd.OptimalControlProblem(phases=phases), intervals=4)
    with pytest.raises(mbd.ModelError, match="no boundary conditions"):
        solution.stability()
    problem = mbd.OptimalControlProblem(phases=phases, boundary=[mbd.at_end(arm.omega) == mbd.at_start(arm.omega)])
    with pytest.raises(mbd.ModelError, match=r"decide the whole start|conditions than what follows"):
        mbd.optimize(problem, intervals=4).stability()


def test_switches_that_were_found_do_not_answer_a_disturbance():
    """A limited force shakes a damped oscillator to and fro: the multipliers are those of the oscillator."""
    u, period, stiffness, damping = mbd.Input("u", lower=-1, upper=1), 2.0, 4.0, 0.5
    block = mbd.Body("block", mass=1.0, inertia=0.1)
    mechanism = mbd.Mechanism(
        [block],
        [mbd.Translational("rail", mbd.ground.at(0, 0), block.at(0, 0))],
        forces=[mbd.Force("push", block.at(0, 0), (u - stiffness * block.x - damping * block.vx, 0))],
        inputs=[u],
    )
    same = [mbd.at_end(value) == mbd.at_start(value) for value in (block.x, block.vx)]
    problem = mbd.OptimalControlProblem(
        mechanism, period, boundary=same, running_cost=-block.x * mbd.cos(2 * np.pi * mbd.t / period)
    )
    solution = mbd.optimize(problem, intervals=15, tolerance=1e-6)
    assert solution.meshes[0].moving
    root = complex(-damping / 2, np.sqrt(stiffness - damping**2 / 4))
    found = sorted(solution.stability().multipliers, key=lambda z: z.imag)
    expected = sorted((np.exp(root * period), np.exp(root.conjugate() * period)), key=lambda z: z.imag)
    assert np.allclose(found, expected, atol=1e-6)


def test_derivatives_that_stop_are_reported():
    # the root has a value at the start, and no finite derivative
    sled = mbd.Body("sled", mass=1.0, inertia=1.0)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), sled.at(0, 0))
    push = mbd.Force("push", sled.at(0, 0), (1 + mbd.sqrt(sled.x), 0))
    mechanism = mbd.Mechanism(bodies=[sled], joints=[rail], forces=[push])
    start = [sled.x == 0, sled.vx == 0]
    motion = mbd.simulate(mechanism, np.linspace(0, 1, 11), initial=start, method="erk")
    again = [mbd.at_end(e) == mbd.at_start(e) for e in (sled.x, sled.vx)]
    with pytest.raises(mbd.SimulationError, match="derivatives of the motion from t = 0 s on stopped"):
        mbd.stability(motion, again)
