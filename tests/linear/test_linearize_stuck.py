"""Linear models with dry friction that sticks or slides, and with rigid contacts that are closed."""

import numpy as np
import pytest

import mbdcasadi as mbd

G = 9.81


def masses_on_a_rail():
    """A slide of 2 kg that rubs, and a mass of 1 kg on it by a spring of 100 N/m."""
    slide, mass = mbd.Body("slide", mass=2, inertia=0.1), mbd.Body("mass", mass=1, inertia=0.1, pose=(0.5, 0, 0))
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), slide.at(0, 0))
    other = mbd.Translational("other", mbd.ground.at(0, 0), mass.at(0, 0))
    spring = mbd.TSDA("spring", slide.at(0, 0), mass.at(0, 0), stiffness=100, free_length=0.5)
    rub = mbd.JointFriction("rub", rail, mbd.DryFriction(0.3))
    return mbd.Mechanism([slide, mass], [rail, other], forces=[mbd.Gravity(), spring, rub]), slide, mass, rub


def test_a_mass_on_a_stuck_slide_has_the_mode_of_its_spring():
    mechanism, _, mass, rub = masses_on_a_rail()
    model = mbd.linearize(mechanism, mbd.equilibrium(mechanism), outputs=[rub.force, mass.x])
    (mode,) = model.modes()
    assert mode.frequency == pytest.approx(10 / (2 * np.pi), rel=1e-12) and mode.damping_ratio == pytest.approx(0)
    assert model.C == pytest.approx(np.array([[-100, 0], [1, 0]]))
    assert mode.at(0.0, 0.01)[mass.x] == pytest.approx(0.51)


def test_a_slide_that_slides_keeps_its_sense():
    """Both masses on one spring: ``ω² = k (1/m + 1/M)``; the friction does not change with small motions."""
    mechanism, slide, _, rub = masses_on_a_rail()
    state = mbd.assemble(mechanism, [slide.vx == 1])
    model = mbd.linearize(mechanism, state, outputs=[rub.force])
    assert np.max(np.abs(model.eigenvalues.imag)) == pytest.approx(np.sqrt(150), rel=1e-9)
    assert pytest.approx(0, abs=1e-9) == model.C and state[rub.force] == pytest.approx(-0.6 * G)


def test_a_stuck_pendulum_has_no_mode():
    arm = mbd.Body("arm", mass=1, inertia=1 / 12, pose=(0.5, 0, 0))
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), arm.at(-0.5, 0))
    pin = mbd.JointFriction("pin", hinge, mbd.DryFriction(1.2), radius=0.6)
    pendulum = mbd.Mechanism([arm], [hinge], forces=[mbd.Gravity(), pin])
    rest = mbd.equilibrium(pendulum)
    assert mbd.linearize(pendulum, rest).modes() == () and rest[pin.torque] == pytest.approx(G / 2)


def test_a_ball_that_rolls_in_a_bowl():
    """``ω² = 2/3 g / (R - r)`` of a disc; with a smooth bowl it slides, ``ω² = g / (R - r)``, and may turn."""
    ball = mbd.Body("ball", mass=1, inertia=0.02, pose=(0, -0.8, 0))
    outlines = mbd.Circle(ball.at(0, 0), 0.2), mbd.HollowCircle(mbd.ground.at(0, 0), 1)
    for friction, factor, count in ((mbd.DryFriction(0.5), 2 / 3, 1), (None, 1, 2)):
        bowl = mbd.RigidContact("bowl", *outlines, friction=friction)
        mechanism = mbd.Mechanism([ball], forces=[mbd.Gravity(), bowl])
        modes = mbd.linearize(mechanism, mbd.equilibrium(mechanism)).modes()
        assert len(modes) == count
        assert modes[-1].frequency == pytest.approx(np.sqrt(factor * G / 0.8) / (2 * np.pi), rel=1e-9)


def test_a_force_on_a_box_that_sticks_changes_its_reactions_alone():
    push, box = mbd.Input("push"), mbd.Body("box", mass=3, inertia=0.1, pose=(0, 0.2, 0))
    corners = [(-0.3, -0.2), (0.3, -0.2), (0.3, 0.2), (-0.3, 0.2)]
    outlines = mbd.PolygonEdges(box.at(0, 0), corners), mbd.HalfPlane(mbd.ground.at(0, 0))
    floor = mbd.RigidContact("floor", *outlines, friction=mbd.DryFriction(0.5))
    force = mbd.Force("force", box.at(0, 0.1), (push, 0))
    mechanism = mbd.Mechanism([box], forces=[mbd.Gravity(), floor, force], inputs=[push])
    outputs = [floor.friction_force, floor.normal_forces[:2], box.ax]
    model = mbd.linearize(mechanism, mbd.equilibrium(mechanism), wrt=[push], outputs=outputs)
    assert model.D.ravel() == pytest.approx([-1, -0.5, 0.5, 0], abs=1e-12) and not model.A.size
