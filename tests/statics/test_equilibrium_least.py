"""Equilibria with more inputs than a pose needs: the least ones within their limits."""

from __future__ import annotations

import numpy as np
import pytest

import mbdcasadi as mbd

G = 9.81


def two_motors(**limits):
    """An arm on its hinge with two motors, the second through a gear with ratio two; a spring; an electric lag."""
    t1, t2 = mbd.Input("t1", **limits), mbd.Input("t2")
    arm = mbd.Body("arm", mass=1.0, inertia=1 / 12, pose=(0.5, 0, 0))
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), arm.at(-0.5, 0))
    delayed = mbd.FirstOrderLag("delay", t2, 0.1)
    forces = [mbd.Gravity(), mbd.Torque("m1", arm, t1), mbd.Torque("m2", arm, 2 * delayed.output), delayed]
    return mbd.Mechanism([arm], [hinge], forces=forces, inputs=[t1, t2]), arm, (t1, t2)


def test_least_sum_of_squares_weights_and_states():
    """``u = W^-1 b (b^T W^-1 b)^-1 need`` with ``b = (1, 2)``; the second acts through a state."""
    model, arm, (t1, t2) = two_motors()
    need = 0.5 * G * np.cos(0.3)
    rest = mbd.equilibrium(model, [arm.phi == 0.3], unknowns=[t1, t2])
    assert [rest[arm.phi], rest[t1], rest[t2]] == pytest.approx([0.3, need / 5, 2 * need / 5], abs=1e-11)
    dear = mbd.equilibrium(model, [arm.phi == 0.3], unknowns=[t2, t1], weights={t2: 8})
    assert [dear[t1], dear[t2]] == pytest.approx([need / 1.5, need / 4 / 1.5], abs=1e-11)
    assert not rest.stable


def test_within_limits():
    model, arm, (t1, t2) = two_motors(lower=-0.5, upper=0.5)
    rest = mbd.equilibrium(model, [arm.phi == 0.3], unknowns=[t1, t2])
    assert [rest[t1], rest[t2]] == pytest.approx([0.5, (0.5 * G * np.cos(0.3) - 0.5) / 2], abs=1e-10)
    with pytest.raises(
        mbd.EquilibriumError, match="equilibrium: no efforts within their limits hold the pose at t = 0 s"
    ):
        weak = [mbd.Input(f"u{k}", lower=-1, upper=1) for k in range(2)]
        torques = [mbd.Torque(u.label, arm, u) for u in weak]
        mbd.equilibrium(model.replace(forces=[mbd.Gravity(), *torques], inputs=weak), [arm.phi == 0.3], unknowns=weak)


def test_cables_pull_as_in_inverse_dynamics():
    """Four cables hold a plate in a pose: as inverse dynamics of the pose says, and the loads balance."""
    plate = mbd.Body("plate", mass=2.0, inertia=0.05)
    posts, eyes = [(-2, -1), (2, -1), (2, 1.5), (-2, 1.5)], [(-0.2, 0.1), (0.2, 0.1), (0.2, -0.1), (-0.2, -0.1)]
    tensions = [mbd.Input(f"T{k}", value=5, lower=5) for k in range(4)]
    cables = []
    for k, (post, eye) in enumerate(zip(posts, eyes, strict=True)):
        along = mbd.ground.at(*post).position - plate.at(*eye).position
        cables.append(mbd.Force(f"cable {k}", plate.at(*eye), tensions[k] * along / mbd.norm(along)))
    model = mbd.Mechanism([plate], forces=[mbd.Gravity(), *cables], inputs=tensions)
    pose = {plate.x: 0.3, plate.y: 0.2, plate.phi: 0.1}
    rest = mbd.equilibrium(model, [key == value for key, value in pose.items()], unknowns=tensions)
    run = mbd.inverse_dynamics(model, [0.0], motion=pose, efforts=tensions)
    np.testing.assert_allclose(rest.inputs, run.inputs[0], rtol=1e-9)
    np.testing.assert_allclose(sum(rest[c.force] for c in cables), [0, 2 * G], atol=1e-9)
    with pytest.raises(
        mbd.ConditionError, match="'T0', 'T1', 'T2', 'T3' are more inputs .* they leave 1 degree of freedom;"
    ):
        mbd.equilibrium(model, [plate.x == 0.3, plate.y == 0.2], unknowns=tensions)


def test_a_linkage_with_a_condition_on_a_reaction():
    """Three motors of a two-bar arm, whose pose and tension in a strut are given: by hand."""
    pushes = [mbd.Input(f"push {k}") for k in range(3)]
    block = mbd.Body("block", mass=1.0, inertia=1.0)
    weld = mbd.Translational("rail", mbd.ground.at(0, 0), block.at(0, 0))
    forces = [mbd.Gravity(), *(mbd.Force(u.label, block.at(0, 0), (u, k * u)) for k, u in enumerate(pushes))]
    model = mbd.Mechanism([block], [weld], forces=forces, inputs=pushes)
    held = weld.reaction_on(block).force[1]
    rest = mbd.equilibrium(model, [block.x == 0.5, held == 4.0], unknowns=pushes)
    rows = np.array([[1, 1, 1], [0, 1, 2]])
    np.testing.assert_allclose(rest.inputs, np.linalg.pinv(rows) @ [0, G - 4], atol=1e-10)


def test_refusals():
    model, arm, (t1, t2) = two_motors()
    with pytest.raises(mbd.ConditionError, match="weights= goes with more inputs"):
        mbd.equilibrium(model, [arm.phi == 0.3], unknowns=[t1], weights={t1: 2})
    with pytest.raises(mbd.ModelError, match="weights= holds 't1', which is not in unknowns="):
        other = mbd.Input("t3")
        both = model.replace(forces=[*model.forces, mbd.Torque("m3", arm, other)], inputs=[t1, t2, other])
        mbd.equilibrium(both, [arm.phi == 0.3], unknowns=[t2, other], weights={t1: 2})
    rub = mbd.JointFriction("rub", model.joints[0], mbd.DryFriction(0.2), radius=0.02)
    with pytest.raises(mbd.EquilibriumError, match="'t1', 't2' are more inputs.*exact dry friction"):
        mbd.equilibrium(model.replace(forces=[*model.forces, rub]), [arm.phi == 0.3], unknowns=[t1, t2])
