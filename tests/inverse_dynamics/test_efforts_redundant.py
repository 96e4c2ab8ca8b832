"""Inverse dynamics with more efforts than degrees of freedom: the least ones within their limits."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from linkages import four_bar
from scipy.optimize import minimize

import mbdcasadi as mbd

G = 9.81
TIMES = np.linspace(0, 1, 5)


def two_motors(gravity=G, **limits):
    """An arm held by two motors on its hinge, the second through a gear with ratio two; the torque it needs."""
    t1, t2 = mbd.Input("t1", **limits), mbd.Input("t2", lower=-10, upper=10)
    arm = mbd.Body("arm", mass=1.0, inertia=1 / 12, pose=(0.5, 0, 0))
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), arm.at(-0.5, 0))
    forces = [mbd.Gravity((0, -gravity)), mbd.Torque("m1", arm, t1), mbd.Torque("m2", arm, 2 * t2)]
    return mbd.Mechanism([arm], [hinge], forces=forces, inputs=[t1, t2]), {hinge.angle: 0.0}, (t1, t2), 0.5 * gravity


def test_least_sum_of_squares_and_weights():
    """``u = W^-1 b (b^T W^-1 b)^-1 need`` with ``b = (1, 2)``."""
    model, motion, (t1, t2), need = two_motors()
    held = mbd.inverse_dynamics(model, TIMES, motion=motion, efforts=[t1, t2])
    np.testing.assert_allclose(held.inputs, np.tile([need / 5, 2 * need / 5], (5, 1)), atol=1e-12)
    np.testing.assert_allclose(held.at(0.3).inputs, [[need / 5, 2 * need / 5]], atol=1e-12)
    dear = mbd.inverse_dynamics(model, TIMES, motion=motion, efforts=[t2, t1], weights={t2: 8})
    np.testing.assert_allclose(dear.inputs[0], [need / 1.5, need / 4 / 1.5], atol=1e-12)


def test_within_limits():
    """What one motor cannot give the other takes over, also if limits exclude zero and if both are at them."""
    model, motion, efforts, need = two_motors(3 * G, lower=-1, upper=1)
    held = mbd.inverse_dynamics(model, TIMES, motion=motion, efforts=efforts)
    np.testing.assert_allclose(held.inputs[0], [1.0, (need - 1) / 2], atol=1e-10)
    model, motion, efforts, need = two_motors(G, value=4.0, lower=4.0, upper=np.inf)
    held = mbd.inverse_dynamics(model, TIMES, motion=motion, efforts=efforts)
    np.testing.assert_allclose(held.inputs[0], [4.0, (need - 4) / 2], atol=1e-10)
    model, motion, efforts, need = two_motors(2 * 21.0, lower=-1, upper=1)  # 1 + 2 · 10
    held = mbd.inverse_dynamics(model, TIMES, motion=motion, efforts=efforts)
    np.testing.assert_allclose(held.inputs[0], [1.0, 10.0], atol=1e-8)


def test_refuses_what_limits_do_not_allow():
    """The time and the input."""
    model, _, efforts, _ = two_motors(0.0, lower=-1, upper=1)
    angle = model.joints[0].angle
    with pytest.raises(mbd.MechanismError, match=r"t = 0\.75 s.*'t1' is 6\.3, with upper = 1,") as caught:
        mbd.inverse_dynamics(model, TIMES, motion={angle: 14 * mbd.t**4}, efforts=efforts)
    assert caught.value.time == pytest.approx(0.75)
    with pytest.raises(mbd.MechanismError, match="weights= goes with motion="):
        mbd.inverse_dynamics(model, TIMES, weights={efforts[0]: 2})
    with pytest.raises(mbd.ModelError, match="weights= holds 't2', which is not in efforts=; it has 't1'"):
        mbd.inverse_dynamics(model, TIMES, motion={angle: 0}, efforts=efforts[:1], weights={efforts[1]: 2})
    with pytest.raises(mbd.ModelError, match="weights"):
        mbd.inverse_dynamics(model, TIMES, motion={angle: 0}, efforts=efforts, weights={efforts[1]: 0})


def test_cables_pull():
    """Four cables move a plate with three freedoms: tensions of at least 5 N, as a general solver finds."""
    plate = mbd.Body("plate", mass=2.0, inertia=0.05)
    posts, eyes = [(-2, -1), (2, -1), (2, 1.5), (-2, 1.5)], [(-0.2, 0.1), (0.2, 0.1), (0.2, -0.1), (-0.2, -0.1)]
    tensions = [mbd.Input(f"T{k}", value=5, lower=5) for k in range(4)]
    cables = []
    for k, (post, eye) in enumerate(zip(posts, eyes, strict=True)):
        along = mbd.ground.at(*post).position - plate.at(*eye).position
        cables.append(mbd.Force(f"cable {k}", plate.at(*eye), tensions[k] * along / mbd.norm(along)))
    model = mbd.Mechanism([plate], forces=[mbd.Gravity(), *cables], inputs=tensions)
    motion = {plate.x: 0.3 * mbd.sin(3 * mbd.t), plate.y: 0.2 * mbd.t, plate.phi: 0.1 * mbd.t}
    run = mbd.inverse_dynamics(model, TIMES, motion=motion, efforts=tensions)
    assert run.inputs.min() == pytest.approx(5, abs=1e-9)
    for k in range(TIMES.size):
        state = run.state(k)
        needed = state[mbd.equations(model).M] @ state.a + [0, 2 * G, 0]
        angle, arms = state.q[2], []
        for post, eye in zip(posts, eyes, strict=True):
            c, s = np.cos(angle), np.sin(angle)
            arm = np.array([c * eye[0] - s * eye[1], s * eye[0] + c * eye[1]])
            pull = np.array(post) - state.q[:2] - arm
            pull = pull / np.linalg.norm(pull)
            arms.append([*pull, arm[0] * pull[1] - arm[1] * pull[0]])
        acting = np.array(arms).T
        np.testing.assert_allclose(acting @ run.inputs[k], needed, atol=1e-9)
        met = {"type": "eq", "fun": lambda x, A=acting, b=needed: A @ x - b, "jac": lambda x, A=acting: A}
        least = minimize(
            lambda x: x @ x, np.full(4, 50.0), jac=lambda x: 2 * x, bounds=[(5, None)] * 4, constraints=met
        )
        np.testing.assert_allclose(run.inputs[k], least.x, atol=1e-4)


def test_a_point_mass():
    """Three cables hold a mass without inertia, whose angle nothing moves: the third is as slack as it may be."""
    bob = mbd.Body("bob", mass=2.0, inertia=0.0)
    tensions = [mbd.Input(f"T{k}", value=5, lower=5) for k in range(3)]
    ways = np.array([[-0.8, 0.6], [0.8, 0.6], [0.0, -1.0]])
    pulls = [mbd.Force(f"cable {k}", bob.at(0, 0), tensions[k] * ca.DM(way)) for k, way in enumerate(ways)]
    model = mbd.Mechanism([bob], forces=[mbd.Gravity(), *pulls], inputs=tensions)
    held = mbd.inverse_dynamics(model, [0, 1], motion={bob.x: 0, bob.y: 0, bob.phi: 0}, efforts=tensions)
    pull = (2 * G + 5) / 1.2
    np.testing.assert_allclose(held.inputs[0], [pull, pull, 5], atol=1e-9)


def test_closed_loop():
    """Motors on crank and rocker of a four-bar share by the velocity ratio; the equations of motion hold."""
    one, two = mbd.Input("one"), mbd.Input("two")
    f = four_bar(
        0.5,
        forces=lambda f: [mbd.Gravity(), mbd.Torque("motor", f.crank, one), mbd.Torque("brake", f.rocker, two)],
        inputs=[one, two],
    )
    motion = {f.A.angle: 0.5 + 0.4 * mbd.sin(3 * mbd.t)}
    both = mbd.inverse_dynamics(f.mechanism, TIMES, motion=motion, efforts=[one, two])
    alone = mbd.inverse_dynamics(f.mechanism, TIMES, motion=motion, efforts=[one])[one]
    ratio = both[f.rocker.omega / f.crank.omega]
    np.testing.assert_allclose(both[one], alone / (1 + ratio**2), rtol=1e-9)
    np.testing.assert_allclose(both[two], ratio * alone / (1 + ratio**2), rtol=1e-9)
    eom = mbd.equations(f.mechanism)
    balance = both[eom.M @ eom.a + eom.Phi_q.T @ eom.lam - eom.Q]
    np.testing.assert_allclose(balance, 0, atol=1e-9)


def test_refuses_friction_by_reactions():
    """A block pushed by two forces along a guide with friction: the least efforts are not those of a linear problem."""
    one, two = mbd.Input("one"), mbd.Input("two")
    block = mbd.Body("block", mass=2.0, inertia=0.1)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    pushes = [mbd.Force("one", block.at(0, 0), (one, 0)), mbd.Force("two", block.at(0, 0), (two, two))]
    rubs = mbd.JointFriction("rubs", guide, mbd.Coulomb(0.3, 1e-3))
    model = mbd.Mechanism([block], [guide], forces=[mbd.Gravity(), rubs, *pushes], inputs=[one, two])
    with pytest.raises(mbd.MechanismError, match="'one', 'two' are more than .*friction.*inputs="):
        mbd.inverse_dynamics(model, TIMES, motion={guide.displacement: mbd.t}, efforts=[one, two])


def test_as_many_efforts_as_freedoms_are_beyond_their_limits_with_a_warning():
    """A cable that would have to push is not passed over in silence."""
    pull = mbd.Input("pull", lower=0, upper=10)
    block = mbd.Body("block", 2.0, 1.0)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), block.at(0, 0))
    model = mbd.Mechanism([block], [rail], forces=[mbd.Force("cable", block.at(0, 0), (pull, 0))], inputs=[pull])
    course = {block.x: -3 * mbd.t**2}
    with pytest.warns(
        mbd.MechanismWarning, match="'pull' goes from -12 to -12, beyond its limits 0 … 10; inverse_dynamics"
    ):
        found = mbd.inverse_dynamics(model, [0, 1], motion=course, efforts=[pull])
    np.testing.assert_allclose(found[pull], -12)
    with pytest.raises(mbd.ModelError, match="efforts= contains 'pull' twice"):
        mbd.inverse_dynamics(model, [0, 1], motion=course, efforts=[pull, pull])
    with pytest.raises(mbd.ModelError, match="efforts= holds 'pull', which.*has 'pull' .another symbol of"):
        mbd.inverse_dynamics(model, [0, 1], motion=course, efforts=[mbd.Input("pull")])
    with pytest.raises(mbd.ModelError, match="efforts= holds 'cable', which is not in the mechanism; it has 'pull'"):
        mbd.inverse_dynamics(model, [0, 1], motion=course, efforts=["cable"])
