"""The law of an impact, against closed forms."""

import casadi as ca
import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.equations.impact_law import ImpactLaw, jump
from mbdcasadi.equations.numeric import NumericEquations


def solved(law, v):
    """The jump from velocities v at the estimated pose, with no parameters."""
    return law.solve(NumericEquations(law.eom, np.zeros(0)), 0.0, np.zeros(3), v, np.zeros(0))


def rod_on_pin(n=1):
    rod = mbd.Body("rod", mass=2.0, inertia=0.3, pose=(0, 0, 0), velocity=(1.0, -2.0, 0.5))
    pins = [mbd.Revolute(f"pin {k}", mbd.ground.at(-0.7, 0), rod.at(-0.7, 0)) for k in range(n)]
    return rod, pins, mbd.Mechanism(bodies=[rod], joints=pins)


def test_a_rod_that_gets_pinned_keeps_its_angular_momentum_about_the_pin():
    rod, (pin,), mechanism = rod_on_pin()
    v = np.array([1.0, -2.0, 0.5])
    found = solved(ImpactLaw(mbd.equations(mechanism)), v)
    # m 0.7 vy + J omega = (J + m 0.7²) omega⁺
    omega = (2.0 * 0.7 * v[1] + 0.3 * v[2]) / (0.3 + 2.0 * 0.7**2)
    np.testing.assert_allclose(found.v, [0, 0.7 * omega, omega], atol=1e-14)
    # the impulses balance the change of momentum: on the rod -Phi_r^T Λ
    force = ca.Function("f", [mbd.equations(mechanism).q, pin.impulses], [pin.impulse_on(rod).force])
    np.testing.assert_allclose(
        force(np.zeros(3), found.impulses).full().ravel(), 2.0 * (found.v[:2] - v[:2]), atol=1e-13
    )
    assert not found.dependent


def test_dependent_rows_bear_nothing_and_change_nothing():
    _, _, once = rod_on_pin()
    _, _, twice = rod_on_pin(2)
    v = np.array([1.0, -2.0, 0.5])
    one, two = (solved(ImpactLaw(mbd.equations(m)), v) for m in (once, twice))
    np.testing.assert_allclose(one.v, two.v, atol=1e-14)
    assert two.dependent == (2, 3)
    np.testing.assert_allclose(two.impulses, [*one.impulses, 0, 0], atol=1e-13)


def test_rows_that_contradict_each_other_are_left_over():
    disc = mbd.Mechanism(bodies=[mbd.Body("disc", mass=1.0, inertia=1.0)])
    numeric = NumericEquations(mbd.equations(disc), np.zeros(0))
    jacobian, right = np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]), np.array([0.0, 1.0])
    found = jump(numeric, jacobian, right, np.zeros(3))
    np.testing.assert_allclose(found.left_over, [0, -1], atol=1e-14)
    np.testing.assert_allclose(np.abs(found.contradiction), [0.5, 0.5], atol=1e-14)


def test_restitution():
    """A disc that rolls off and hits a wall with e = 0.6: Newton's law in the row, nothing across."""
    disc = mbd.Body("disc", mass=3.0, inertia=0.2)
    wall = mbd.AbsoluteX("wall", disc.at(0, 0), 0.0)
    free = mbd.Mechanism(bodies=[disc])
    law = ImpactLaw(mbd.equations(free), {wall: 0.6})
    found = solved(law, np.array([-2.0, 1.0, 4.0]))
    np.testing.assert_allclose(found.v, [1.2, 1.0, 4.0], atol=1e-14)
    assert set(law.by_joint(found.impulses)) == {wall}


def test_symbols_and_numbers_agree():
    """The rows that optimal control imposes vanish at what the numbers give, for a moving target."""
    rod, (_pin,), mechanism = rod_on_pin()
    moving = mechanism.replace(
        joints=[mbd.Constraint("guide", rod.x + 0.3 * mbd.t)], drivers=[mbd.Driver("turn", rod.phi, mbd.t)]
    )
    eom = mbd.equations(moving)
    law = ImpactLaw(eom)
    v = np.array([1.0, -2.0, 0.5])
    found = solved(law, v)
    rows = ca.Function("rows", [eom.t, eom.q, eom.v, law.v_before, law.impulses], [law.momentum, law.velocity])
    for residual in rows(0.0, np.zeros(3), found.v, v, found.impulses):
        np.testing.assert_allclose(residual.full(), 0, atol=1e-13)
    np.testing.assert_allclose(found.v, [-0.3, -2.0, 1.0], atol=1e-14)


def test_refuses_restitution_of_joints_that_stay_and_of_foreign_bodies():
    _rod, (pin,), mechanism = rod_on_pin()
    with pytest.raises(mbd.ModelError, match=r"'pin 0'.*only at the instant of the impact"):
        ImpactLaw(mbd.equations(mechanism), {pin: 0.5})
    other = mbd.Body("other", mass=1, inertia=1)
    with pytest.raises(mbd.ModelError, match="'other', which is not there"):
        ImpactLaw(mbd.equations(mechanism), {mbd.AbsoluteX("wall", other.at(0, 0), 0.0): 0.5})


def test_refuses_restitution_of_drivers_that_stay_and_of_strange_parameters():
    """A racket that strikes a ball: its height is a driver, with an amplitude that all phases must know."""
    amplitude = mbd.Parameter("amplitude", 0.1)
    ball = mbd.Body("ball", mass=0.3, inertia=0.01)
    racket = mbd.Driver("racket", ball.y, amplitude * mbd.sin(10 * mbd.t))
    flying = mbd.Mechanism(bodies=[ball], parameters=[amplitude])
    with pytest.raises(mbd.ModelError, match=r"driver 'racket' is a driver of the mechanism itself.*at the instant"):
        mbd.impact(flying.replace(drivers=[racket]), mbd.assemble(flying), restitution={racket: 0.5})
    with pytest.raises(mbd.ExpressionError, match=r"driver 'racket' uses parameter 'amplitude'.*list .* parameters="):
        mbd.impact(flying.replace(parameters=[]), mbd.assemble(flying), restitution={racket: 0.5})
    after = mbd.impact(flying, mbd.assemble(flying, [ball.vy == -3]), restitution={racket: 0.5})
    assert after[ball.vy] == pytest.approx(1.0 - 0.5 * (-3.0 - 1.0))  # relative to the racket, at 1 m/s


@pytest.mark.parametrize("length, mass, time", [(1e-6, 1e-12, 1e-4), (1e-3, 1e-3, 1.0), (1e6, 1e9, 1e3)])
def test_an_impact_does_not_depend_on_the_units(length, mass, time):
    """A rod that lands on its tip keeps its angular momentum about it, in a machine of any size."""
    rod = mbd.Body(
        "rod", mass, 0.1 * mass * length**2, pose=(0, 0.3 * length, 0), velocity=(0.5 * length / time, 0, 1 / time)
    )
    flying = mbd.Mechanism(bodies=[rod])
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), rod.at(0, -0.3 * length))
    after = mbd.impact(flying.replace(joints=[pin]), mbd.assemble(flying))
    # J omega - m h vx = (J + m h²) omega⁺
    omega = (0.1 - 0.3 * 0.5) / (0.1 + 0.09)
    assert after[rod.omega] * time == pytest.approx(omega, rel=1e-12)
    impulse = after[pin.impulse_on(rod).force] / (mass * length / time)
    assert impulse == pytest.approx([-0.3 * omega - 0.5, 0.0], abs=1e-12)
