"""Laws that hold for every mechanism, tried on random ones: action and reaction, power, inverse and forward."""

from __future__ import annotations

import warnings

import casadi as ca
import numpy as np
import pytest
from random_mechanisms import random_case, random_mechanism
from scipy.integrate import simpson
from seeds import seeds

import mbdcasadi as mbd
from mbdcasadi.equations.numeric import NumericEquations

#: Random mechanisms whose constraints in time lock them within 0.2 s.
LOCKING = {15, 86}


@pytest.fixture(scope="module", params=seeds(200, quick=8))
def seed(request):
    """A random mechanism; its tests follow one another and share what is derived and compiled."""
    return request.param


# --- power, by the definitions of the textbook --------------------------------------------------------------
def power_of(force):
    """Power of an applied force by what it is: force times velocity, couple times rate, with no virtual work."""
    if isinstance(force, mbd.Force):
        power = ca.dot(force.force, force.at.velocity)
        if force.opposite is not None and not force.opposite.is_ground:
            arm = force.at.position - force.opposite.position
            swept = ca.vertcat(-arm[1], arm[0]) * force.opposite.omega
            power -= ca.dot(force.force, force.opposite.velocity + swept)
        return power
    if isinstance(force, mbd.Torque):
        return force.torque * (force.body.omega - force.opposite.omega)
    if isinstance(force, mbd.TSDA):
        apart = force.b.position - force.a.position
        direction = apart / ca.norm_2(apart)
        return -force.force * ca.dot(direction, force.b.velocity - force.a.velocity)
    if isinstance(force, mbd.RSDA):
        return -force.torque * (force.b.angular_velocity - force.a.angular_velocity)
    assert isinstance(force, mbd.GeneralizedForce)
    return sum(ca.dot(f, mbd.time_derivative(e)) for e, f in force.virtual_work)


def power_of_constraint(element):
    """Power of a constraint: that of a driver is effort times rate; others work where they move in time."""
    if isinstance(element, mbd.Driver):
        return element.effort * mbd.time_derivative(element.expression)
    return ca.dot(element.multipliers, ca.jacobian(element.rows, mbd.t))


def energy_rate(mechanism):
    """Rate of kinetic energy and weight, and the power of everything else that acts."""
    eom = mbd.equations(mechanism)
    weight = sum((b.mass * 9.81 * b.vy for b in mechanism.bodies), ca.SX(0))
    gravity = any(isinstance(f, mbd.Gravity) for f in mechanism.forces)
    rate = ca.dot(eom.v, eom.M @ eom.a) + (weight if gravity else 0)
    powers = [power_of(f) for f in mechanism.forces if not isinstance(f, mbd.Gravity)]
    powers += [power_of_constraint(c) for c in mechanism.constraints]
    return rate, ca.vertcat(ca.SX(1, 1), *powers)


def started(mechanism):
    """A consistent state near the estimate, with the velocities of the bodies' estimates."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mbd.MechanismWarning)
        return mbd.assemble(mechanism)


# --- at one state ------------------------------------------------------------------------------------------
def test_action_is_reaction(seed):
    """What each constraint exerts on its bodies, the ground included, sums to nothing: forces and moments."""
    state = started(random_mechanism(seed))
    scale = 1 + np.abs(state.lam).max()
    for element in state.mechanism.constraints:
        force, moment = np.zeros(2), 0.0
        for body in element.bodies:
            reaction = element.reaction_on(body)
            push, at = state[reaction.force], state[reaction.marker.position]
            force = force + push
            moment += state[reaction.torque] + at[0] * push[1] - at[1] * push[0]
        np.testing.assert_allclose(force, 0, atol=1e-10 * scale)
        np.testing.assert_allclose(moment, 0, atol=1e-10 * scale)


def test_momentum(seed):
    """Mass times acceleration of all bodies is the sum of weight and what the ground exerts."""
    mechanism = random_mechanism(seed)
    state = started(mechanism)
    shaking = mbd.shaking_force(mechanism)
    weight = -9.81 if any(isinstance(f, mbd.Gravity) for f in mechanism.forces) else 0.0
    total = sum(b.mass * (state[b.a[:2]] - [0, weight]) for b in mechanism.bodies)
    scale = 1 + np.abs(state.lam).max() + np.abs(state.a).max()
    np.testing.assert_allclose(-state[shaking.force], total, atol=1e-9 * scale)


def test_power_balance(seed):
    """The rate of the energy is the power of forces, drivers and constraints that move, each by its definition."""
    mechanism = random_mechanism(seed, driven=seed % 2 == 1)
    state = started(mechanism)
    rate, powers = energy_rate(mechanism)
    single = np.atleast_1d(state[powers])
    scale = 1 + np.abs(single).max() + np.abs(state.lam).max() + np.abs(state[rate])
    assert state[rate] == pytest.approx(single.sum(), abs=1e-9 * scale)


def test_states_meet_the_equations(seed):
    """Phi, Phi_q v - nu, Phi_q a - gamma and the equations of motion vanish to rounding."""
    state = started(random_mechanism(seed))
    eom = state.equations
    size = 1 + np.abs(state.v).max()
    assert np.abs(np.atleast_1d(state[eom.Phi])).max(initial=0) < 1e-12
    assert np.abs(np.atleast_1d(state[eom.Phi_q @ eom.v - eom.nu])).max(initial=0) < 1e-11 * size
    left_over = np.atleast_1d(state[eom.Phi_q @ eom.a - eom.gamma])
    assert np.abs(left_over).max(initial=0) < 1e-9 * (1 + np.abs(state.a).max())
    motion = np.atleast_1d(state[eom.M @ eom.a + eom.Phi_q.T @ eom.lam - eom.Q])
    assert np.abs(motion).max() < 1e-9 * (1 + np.abs(state.lam).max(initial=0))


# --- inverse and forward --------------------------------------------------------------------------------------
def released(mechanism):
    """The mechanism with its drivers replaced by forces of the same kind, and the inputs that stand for them."""
    inputs = [mbd.Input(f"effort of {d.name}") for d in mechanism.drivers]
    forces = [
        mbd.GeneralizedForce(f"force of {d.name}", [(d.expression, u)])
        for d, u in zip(mechanism.drivers, inputs, strict=True)
    ]
    free = mechanism.replace(drivers=[], forces=[*mechanism.forces, *forces], inputs=[*mechanism.inputs, *inputs])
    return free, inputs


def test_forward_of_inverse_is_identity(seed):
    """With the efforts of the drivers as forces, the free mechanism has the same accelerations and reactions."""
    mechanism = random_mechanism(seed, driven=True)
    run = mbd.inverse_dynamics(mechanism, np.linspace(0, 0.02, 3))
    free, inputs = released(mechanism)
    eom = mbd.equations(free)
    numeric = NumericEquations(eom, eom.parameter_values)
    efforts = np.column_stack([run[d.effort] for d in mechanism.drivers]) if inputs else np.zeros((3, 0))
    for k, t in enumerate(run.t):
        u = np.r_[run.inputs[k], efforts[k]]
        redundant = numeric.has_redundant_rows(t, run.q[k])
        a, lam = numeric.accelerations(t, run.q[k], run.v[k], run.z[k], u, redundant=redundant)
        np.testing.assert_allclose(a, run.a[k], atol=1e-10 * (1 + np.abs(run.a[k]).max() + np.abs(run.lam[k]).max()))
        if not redundant:
            joints = run.lam[k][: lam.size]
            np.testing.assert_allclose(lam, joints, atol=1e-9 * (1 + np.abs(run.lam[k]).max()))


def test_inverse_of_a_motion_is_the_effort(seed):
    """The efforts found in the motion alone are those of the drivers."""
    mechanism = random_mechanism(seed, driven=True)
    run = mbd.inverse_dynamics(mechanism, np.linspace(0, 0.02, 3))
    free, inputs = released(mechanism)
    found = mbd.inverse_dynamics(free, motion=run, efforts=inputs)
    scale = 1 + np.abs(run.lam).max()
    for driver, u in zip(mechanism.drivers, inputs, strict=True):
        np.testing.assert_allclose(found[u], run[driver.effort], atol=1e-9 * scale)


# --- over time ----------------------------------------------------------------------------------------------------
def test_simulation_keeps_constraints_and_energy(seed):
    """0.2 s: on the constraints to rounding; the energy changes by the work of what acts.

    Constraints that move in time may lock the mechanism: then the run must stop, and its part be as good.
    """
    case = random_case(seed)
    mechanism = case.mechanism
    try:
        motion = mbd.simulate(mechanism, np.linspace(0, 0.2, 401), initial=started(mechanism))
    except mbd.SimulationError as error:
        motion = error.partial
        assert seed in LOCKING, str(error)
        motion = motion if len(motion) < 3 else motion.at(motion.t[: max(3, len(motion) - len(motion) // 10)])
    eom = motion.equations
    size, speed = 1 + np.abs(motion.q).max(), 1 + np.abs(motion.v).max()
    rank = motion.q.shape[1] - case.degrees_of_freedom
    weakest = np.linalg.svd(motion[eom.Phi_q].reshape(len(motion), -1, motion.q.shape[1]), compute_uv=False)[
        :, rank - 1
    ].min()
    assert motion.drift.position <= 1e-12 * size
    assert motion.drift.velocity <= 1e-12 * speed * size / min(weakest, 1.0) ** 2
    rate, powers = energy_rate(mechanism)
    weight = sum((b.mass * 9.81 * b.y for b in mechanism.bodies), ca.SX(0))
    gravity = any(isinstance(f, mbd.Gravity) for f in mechanism.forces)
    energy = motion[eom.kinetic + (weight if gravity else 0)]
    power = motion[ca.sum1(powers)]
    work = simpson(power, x=motion.t)
    uncertain = abs(work - simpson(power[::2], x=motion.t[::2])) if len(motion) % 2 else np.inf
    turnover = simpson(np.abs(motion[powers]).reshape(len(motion), -1).sum(axis=1), x=motion.t)
    tolerance = 1e-6 * (1 + motion.energy.kinetic.max() + turnover) + uncertain
    if weakest < 0.01:  # thrown about near a singular pose: outputs are too far apart for the work
        return
    assert energy[-1] - energy[0] == pytest.approx(work, abs=tolerance)
    assert np.abs(motion[rate] - power).max() < 1e-9 * (1 + np.abs(power).max() + np.abs(motion.lam).max(initial=0))


def test_conservative_mechanisms_keep_their_energy(seed):
    """Without dampers, actuators and courses in time nothing is gained or lost."""
    full = random_mechanism(seed)
    springs = [
        mbd.TSDA(f.name, f.a, f.b, stiffness=f.stiffness, free_length=f.free_length)
        if isinstance(f, mbd.TSDA)
        else mbd.RSDA(f.name, f.a, f.b, stiffness=f.stiffness, free_angle=f.free_angle)
        for f in full.forces
        if isinstance(f, mbd.TSDA | mbd.RSDA)
    ]
    joints = [j for j in full.joints if not ca.depends_on(j.rows, mbd.t)]
    mechanism = full.replace(joints=joints, forces=[mbd.Gravity(), *springs])
    motion = mbd.simulate(mechanism, np.linspace(0, 0.2, 21), initial=started(mechanism), reltol=1e-9, abstol=1e-9)
    energy = motion.energy.total
    assert np.abs(energy - energy[0]).max() <= 1e-6 * (
        1 + motion.energy.kinetic.max() + np.ptp(motion.energy.potential)
    )
