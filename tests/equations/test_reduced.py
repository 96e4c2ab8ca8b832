"""Equations with the explicit constraints solved, beside those in all coordinates."""

import importlib

import casadi as ca
import numpy as np
import pytest
from random_mechanisms import random_mechanism
from seeds import seeds

import mbdcasadi as mbd
from mbdcasadi.equations.explicit import explicit_rows
from mbdcasadi.equations.reduced import reduced_equations

explicit = importlib.import_module("mbdcasadi.equations.explicit")


def cart_with_pendulum():
    """A cart on a slope with a pendulum, a force on the one and a torque on the other."""
    cart, bob = mbd.Body("cart", mass=2.0, inertia=0.3), mbd.Body("bob", mass=0.5, inertia=0.02)
    force, torque = mbd.Input("force"), mbd.Input("torque")
    return mbd.Mechanism(
        bodies=[cart, bob],
        joints=[
            mbd.Translational("rail", mbd.ground.at(0.1, 0.2, angle=0.3), cart.at(0.05, 0.02)),
            mbd.Revolute("pin", cart.at(0.1, 0.3), bob.at(-0.4, 0.1)),
        ],
        forces=[
            mbd.Gravity(),
            mbd.Force("push", cart.at(0, 0), (force, 0)),
            mbd.Torque("turn", bob, torque - 0.1 * bob.omega),
        ],
        inputs=[force, torque],
    )


def cart_with_two_links():
    """A second link: its place would depend on two angles."""
    mechanism = cart_with_pendulum()
    tip = mbd.Body("tip", mass=0.2, inertia=0.01)
    pin = mbd.Revolute("second", mechanism.body("bob").at(0.4, 0), tip.at(-0.2, 0))
    return mechanism.replace(bodies=[*mechanism.bodies, tip], joints=[*mechanism.joints, pin])


def slider_crank():
    """A loop: of its rows those of the slide and of the first pin are explicit, but only the first are linear."""
    crank, rod, piston = (mbd.Body(name, mass=1.0, inertia=0.1) for name in ("crank", "rod", "piston"))
    return mbd.Mechanism(
        bodies=[crank, rod, piston],
        joints=[
            mbd.Revolute("bearing", mbd.ground.at(0, 0), crank.at(0, 0)),
            mbd.Revolute("crank pin", crank.at(0.1, 0), rod.at(-0.2, 0)),
            mbd.Revolute("piston pin", rod.at(0.2, 0), piston.at(0, 0)),
            mbd.Translational("slide", mbd.ground.at(0, 0), piston.at(0, 0)),
        ],
        forces=[mbd.Gravity()],
    )


def test_a_cart_with_a_pendulum_has_two_coordinates():
    """No constraints are left, whatever the slope."""
    reduced = reduced_equations(mbd.equations(cart_with_pendulum()))
    assert reduced.coordinate_names in {("cart.x", "bob.phi"), ("cart.y", "bob.phi")}
    assert reduced.row_names == () and len(reduced.explicit) == 4


def test_longer_chains_keep_their_pins_and_loops_those_that_close_them():
    """Of a chain the linear rows are solved, of a loop those of a tree: two angles and a row are left."""
    chain = reduced_equations(mbd.equations(cart_with_two_links()))
    assert [chain.whole.row_names[k] for k in chain.explicit] == ["rail.angle", "rail.normal"]
    loop = reduced_equations(mbd.equations(slider_crank()))
    assert loop.coordinate_names == ("crank.phi", "rod.phi")
    assert loop.row_names == ("crank pin.y",)


def five_links(motors):
    """A chain of uniform bars, and torques on the first ones."""
    bars = [mbd.Body(f"bar {k}", mass=1.0, inertia=0.1) for k in range(5)]
    torques = [mbd.Input(f"torque {k}") for k in range(motors)]
    joints = [mbd.Revolute("foot", mbd.ground.at(0, 0), bars[0].at(-0.5, 0))]
    joints += [mbd.Revolute(f"pin {k}", bars[k - 1].at(0.5, 0), bars[k].at(-0.5, 0)) for k in range(1, 5)]
    forces = [mbd.Gravity(), *(mbd.Torque(f"motor {k}", bars[k], torque) for k, torque in enumerate(torques))]
    return mbd.equations(mbd.Mechanism(bars, joints, forces=forces, inputs=torques))


def test_a_longer_chain_is_left_with_its_angles_if_every_joint_is_driven():
    """Their accelerations are those of ``M a + Phi_q^T lam = Q`` with ``Phi_q a = gamma`` in all coordinates."""
    eom = five_links(5)
    reduced = reduced_equations(eom, angles=True)
    assert reduced.is_chain and len(reduced.independent) == 5
    w, rate, u = np.random.default_rng(0).uniform(-1, 1, (3, 5))
    system = ca.Function("system", [*reduced.symbols], [ca.jacobian(reduced.motion, reduced.a), reduced.motion])
    masses, load = (x.full() for x in system(0, w, rate, np.zeros(5), [], [], u, []))
    a = np.linalg.solve(masses, -load).ravel()
    q, v, accelerations, _ = (x.full().ravel() for x in reduced.expansion(0, w, rate, a, [], [], u, []))
    whole = ca.Function("whole", [*eom.symbols], [eom.Phi_q, eom.mass_diagonal, eom.Q, eom.gamma])
    arguments = (0, q, v, np.zeros(15), [], np.zeros(10), u, [])
    jacobian, diagonal, forces, gamma = (x.full() for x in whole(*arguments))
    saddle = np.block([[np.diag(diagonal.ravel()), jacobian.T], [jacobian, np.zeros((10, 10))]])
    expected = np.linalg.solve(saddle, np.vstack([forces, gamma]))[:15].ravel()
    np.testing.assert_allclose(accelerations, expected, rtol=1e-9, atol=1e-9)


def test_a_longer_chain_with_a_free_joint_keeps_its_pins():
    assert len(reduced_equations(five_links(4), angles=True).rows) == 10


def test_linear_rows_alone_on_demand():
    reduced = reduced_equations(mbd.equations(cart_with_pendulum()), curved=False)
    assert [reduced.whole.row_names[k] for k in reduced.explicit] == ["rail.angle", "rail.normal"]


def test_friction_that_depends_on_reactions_keeps_all():
    block = mbd.Body("block", mass=1.0, inertia=0.01)
    table = mbd.Translational("table", mbd.ground.at(0, 0), block.at(0, 0))
    rub = mbd.JointFriction("rub", table, mbd.Coulomb(0.3, 1e-3))
    reduced = reduced_equations(mbd.equations(mbd.Mechanism([block], [table], forces=[mbd.Gravity(), rub])))
    assert reduced.explicit == [] and len(reduced.rows) == 2


def test_a_time_law_is_explicit():
    """A driver gives its coordinate; its effort is the multiplier of the row that was solved."""
    wheel, other = mbd.Body("wheel", mass=1.0, inertia=0.5), mbd.Body("other", mass=1.0, inertia=1.0)
    axle = mbd.Revolute("axle", mbd.ground.at(0, 0), wheel.at(0, 0))
    second = mbd.Revolute("second", mbd.ground.at(1, 0), other.at(0, 0))
    motor = mbd.Driver("motor", axle.angle, 0.7 * mbd.t**3)
    mechanism = mbd.Mechanism([wheel, other], [axle, second], drivers=[motor])
    reduced = reduced_equations(mbd.equations(mechanism))
    assert reduced.coordinate_names == ("other.phi",)
    empty, zero = np.zeros(0), np.zeros(1)
    found = reduced.expansion(2.0, zero, zero, zero, empty, empty, empty, empty)
    q, v, a, lam = (x.full().ravel() for x in found)
    np.testing.assert_allclose([q[2], v[2], a[2]], [0.7 * 8, 2.1 * 4, 4.2 * 2], rtol=1e-14)
    row = mbd.equations(mechanism).row_names.index("motor")
    assert abs(lam[row]) == pytest.approx(0.5 * a[2], rel=1e-13)


def test_of_a_mechanism_that_is_driven_completely_all_is_left():
    """Its equations have the parameters alone to be solved for: a spring that takes the load off the driver."""
    wheel = mbd.Body("wheel", mass=1.0, inertia=0.5)
    k = mbd.Parameter("k", 1.0, lower=0.0, upper=40)
    axle = mbd.Revolute("axle", mbd.ground.at(0, 0), wheel.at(0, 0))
    motor = mbd.Driver("motor", axle.angle, mbd.sin(3 * mbd.t))
    spring = mbd.Torque("spring", wheel, -k * wheel.phi)
    mechanism = mbd.Mechanism([wheel], [axle], drivers=[motor], forces=[spring], parameters=[k])
    assert reduced_equations(mbd.equations(mechanism)).explicit == []
    problem = mbd.OptimalControlProblem(mechanism, 2.0, running_cost=motor.effort**2, free_parameters=[k])
    for transcription in ("gauss-legendre", "hermite-simpson"):
        solution = mbd.optimize(problem, intervals=20, transcription=transcription)
        assert solution.parameters[k] == pytest.approx(0.5 * 3**2, rel=1e-3)


@pytest.mark.parametrize("make", [cart_with_pendulum, cart_with_two_links, slider_crank])
@pytest.mark.parametrize("unlimited", [False, True])
def test_against_the_equations_in_all_coordinates(make, unlimited, monkeypatch):
    """At any independent state: constraints met, and accelerations and reactions those of the whole system."""
    if unlimited:
        solve_every_row(monkeypatch)
    mechanism = make()
    compare(mechanism, np.random.default_rng(0), least=2 if unlimited else 1)


@pytest.mark.parametrize("seed", seeds(40))
def test_random_mechanisms(seed, monkeypatch):
    """The same for joints of all kinds, with every explicit row solved."""
    solve_every_row(monkeypatch)
    compare(random_mechanism(seed), np.random.default_rng(seed), least=0)


def solve_every_row(monkeypatch):
    """Solve every explicit row, in however many angles."""
    monkeypatch.setattr(explicit, "CURVED", 9)
    monkeypatch.setattr(explicit, "ANGLES", 9)
    monkeypatch.setattr(explicit, "connected", lambda rows, coordinates: set())


def compare(mechanism, random, least):
    """Expand random independent states and check every equation of the whole system."""
    eom = mbd.equations(mechanism)
    reduced = reduced_equations(eom)
    assert len(reduced.explicit) >= least
    n, m = reduced.q.numel(), reduced.lam.numel()
    q0 = eom.estimate[0][reduced.independent]
    z, u, p = eom.estimate[2], random.uniform(-1, 1, eom.u.numel()), eom.parameter_values
    t, w, dw, ddw, lam = (
        0.3,
        q0 + random.uniform(-0.2, 0.2, n),
        *random.uniform(-1, 1, (2, n)),
        random.uniform(-1, 1, m),
    )
    own = (t, w, dw, ddw, z, lam, u, p)
    q, v, a, multipliers = (x.full().ravel() for x in reduced.expansion(*own))
    np.testing.assert_array_equal(q[reduced.independent], w)
    np.testing.assert_array_equal(v[reduced.independent], dw)
    np.testing.assert_allclose(a[reduced.independent], ddw, atol=1e-13)
    np.testing.assert_array_equal(multipliers[reduced.rows], lam)
    whole = (t, q, v, a, z, multipliers, u, p)
    place = {int(k): i for i, k in enumerate(eom.position_rows)}
    phi = eom.value(eom.Phi, whole).ravel()
    speed = eom.value(eom.Phi_q @ eom.v - eom.nu, whole).ravel()
    bend = eom.value(eom.Phi_q @ eom.a - eom.gamma, whole).ravel()
    for row in reduced.explicit:
        assert abs(phi[place[row]]) < 1e-12 and abs(speed[row]) < 1e-12
        assert abs(bend[row]) < 1e-11 * (1 + np.max(np.abs(a)))
    residual = eom.value(eom.mass_diagonal * eom.a + eom.Phi_q.T @ eom.lam - eom.Q, whole).ravel()
    gone = [k for k in range(eom.q.numel()) if k not in reduced.independent]
    size = 1 + np.max(np.abs(eom.value(eom.Q, whole)), initial=0) + np.max(np.abs(multipliers), initial=0)
    np.testing.assert_allclose(residual[gone], 0, atol=1e-11 * size)  # the multipliers of explicit rows take them up
    function = ca.Function("reduced", [*reduced.symbols], [reduced.motion, reduced.Phi_q, reduced.nu, reduced.gamma])
    motion, jacobian, nu, gamma = (x.full() for x in function(*own))
    slopes = ca.Function("slopes", [*reduced.symbols], [ca.jacobian(reduced.expansion(*reduced.symbols)[0], reduced.q)])
    np.testing.assert_allclose(motion.ravel(), slopes(*own).full().T @ residual, atol=1e-10 * size)
    np.testing.assert_allclose(jacobian @ dw - nu.ravel(), speed[reduced.rows], atol=1e-11)
    np.testing.assert_allclose(jacobian @ ddw - gamma.ravel(), bend[reduced.rows], atol=1e-10)


def test_rows_that_cancel_are_left():
    """Two welds in a ring: the second says what the first does, up to rounding, and is no pivot."""
    one, two = (mbd.Body(name, mass=1.0, inertia=0.1) for name in ("one", "two"))
    joints = [
        mbd.RelativeAngle("first", one.at(0, 0), two.at(0, 0), 0.1),
        mbd.RelativeAngle("second", two.at(0, 0), one.at(0, 0), -0.1),
    ]
    rows = explicit_rows(mbd.equations(mbd.Mechanism([one, two], joints)))
    assert len(rows) == 1
