"""The force of a mechanism on its foundation, against the motion of its masses: Σ m (g - a)."""

import numpy as np
import pytest

import mbdcasadi as mbd

G = 9.81
R, L = 0.04, 0.14  # crank and rod of the engine, m
SHARE = 0.3  # of the rod's length from the crank pin to its centre of mass
BANK = np.pi / 4  # of each cylinder from the vertical


def expected(motion, mechanism, point=(0.0, 0.0), gravity=(0.0, -G)):
    """Force and moment by Newton's and Euler's law of all bodies."""
    force, moment = np.zeros((motion.t.size, 2)), np.zeros(motion.t.size)
    for body in mechanism.bodies:
        share = body.mass * (np.asarray(gravity) - motion[body.acceleration])
        arm = motion[body.position] - point
        force += share
        moment += arm[:, 0] * share[:, 1] - arm[:, 1] * share[:, 0] - body.inertia * motion[body.alpha]
    return force, moment


# --- a V-twin with gas forces ----------------------------------------------------------------------------------
def v_twin(gas):
    """Two cylinders on one crank pin; `gas(position along the bore)` is the force on a piston towards the crank."""
    crank = mbd.Body("crank", mass=3.0, inertia=0.02)
    bodies, forces = [crank], [mbd.Gravity()]
    joints = [mbd.Revolute("main", mbd.ground.at(0, 0), crank.at(0, 0))]
    for name, lean in (("left", BANK), ("right", -BANK)):
        along = np.array([-np.sin(lean), np.cos(lean)])
        top = R * np.array([1.0, 0.0])  # the crank pin at phi = 0
        reach = top @ along + np.sqrt(L**2 - (top - top @ along * along) @ (top - top @ along * along))
        pin = reach * along
        turn = np.arctan2(*(pin - top)[::-1])
        rod = mbd.Body(f"{name} rod", mass=0.4, inertia=1.2e-3, pose=(*((1 - SHARE) * top + SHARE * pin), turn))
        piston = mbd.Body(f"{name} piston", mass=0.5, inertia=1e-3, pose=(*pin, lean + np.pi / 2))
        joints += [
            mbd.Revolute(f"{name} big end", crank.at(R, 0), rod.at(-SHARE * L, 0)),
            mbd.Revolute(f"{name} wrist", rod.at((1 - SHARE) * L, 0), piston.at(0, 0)),
            bore := mbd.Translational(f"{name} bore", mbd.ground.at(0, 0, lean + np.pi / 2), piston.at(0, 0)),
        ]
        push = -gas(bore.displacement)
        forces.append(mbd.Force(f"{name} gas", piston.at(0, 0), (push * along[0], push * along[1])))
        bodies += [rod, piston]
    speed = 150.0
    return mbd.Mechanism(
        bodies, joints, drivers=[mbd.Driver("speed", joints[0].angle, speed * mbd.t)], forces=forces
    ), speed


def along_the_bore(theta, omega):
    """Position of a piston on its bore and its acceleration, at the crank's angle from the bore; closed form."""
    s, c = np.sin(theta), np.cos(theta)
    w = np.sqrt(L**2 - (R * s) ** 2)
    # w' = -R² s c / w ; w'' = -R² ((c² - s²)/w + R² s² c² / w³)
    return R * c + w, omega**2 * (-R * c - R**2 * ((c**2 - s**2) / w + R**2 * s**2 * c**2 / w**3))


def test_v_twin_with_gas_forces_in_closed_form():
    """The gas forces push on piston and cylinder head: outside one feels the masses alone."""
    model, omega = v_twin(lambda x: 4000 * mbd.exp(-(((x - R - L) / 0.01) ** 2)))
    times = np.linspace(0, 2 * np.pi / omega, 73)
    run = mbd.inverse_dynamics(model, times)
    shaking = mbd.shaking_force(model)

    wanted = np.tile([0.0, -G * (3.0 + 2 * (0.4 + 0.5))], (times.size, 1))
    for lean in (BANK, -BANK):
        along = np.array([-np.sin(lean), np.cos(lean)])
        theta = omega * times - (lean + np.pi / 2)
        piston = along_the_bore(theta, omega)[1][:, None] * along
        pin = -(omega**2) * R * np.c_[np.cos(omega * times), np.sin(omega * times)]
        wanted -= 0.5 * piston + 0.4 * ((1 - SHARE) * pin + SHARE * piston)
    np.testing.assert_allclose(run[shaking.force], wanted, atol=1e-6 * np.abs(wanted).max())

    force, moment = expected(run, model)
    np.testing.assert_allclose(run[shaking.force], force, atol=1e-8 * np.abs(force).max())
    np.testing.assert_allclose(run[shaking.moment], moment, atol=1e-8 * np.abs(moment).max())


def test_gas_forces_load_the_bearings_and_not_the_foundation():
    """With and without gas: the main bearing differs by kilonewtons, the shaking force by nothing."""
    times = np.linspace(0, 0.04, 41)
    results = []
    for pressure in (0.0, 4000.0):
        model, _ = v_twin(lambda x, p=pressure: p * mbd.exp(-(((x - R - L) / 0.01) ** 2)))
        run = mbd.inverse_dynamics(model, times)
        results.append((run[mbd.shaking_force(model).force], run[model.joint("main").reaction_on(mbd.ground).force]))
    (without, bearing_without), (with_gas, bearing) = results
    np.testing.assert_allclose(with_gas, without, atol=1e-7 * np.abs(without).max())
    assert np.abs(bearing - bearing_without).max() > 2000


# --- every kind of force ---------------------------------------------------------------------------------------
def forces_of_every_kind():
    """Name to a function of two bodies and a pin between them that makes the forces."""
    t, law = mbd.t, mbd.HuntCrossley(1e4, exponent=1)
    origin = mbd.ground.at(0, 0)
    return {
        "force": lambda a, b, pin: [mbd.Force("f", b.at(0.2, 0.1), (3 * mbd.sin(5 * t), 2.0))],
        "force in the body": lambda a, b, pin: [mbd.Force("f", b.at(0.2, 0.1), (1.0, 2.0), frame="body")],
        "force on a body": lambda a, b, pin: [mbd.Force("f", b.at(0.2, 0.1), (1.0, 2.0), opposite=a)],
        "no body named": lambda a, b, pin: [mbd.Force("f", b.at(0.2, 0.1), (1.0, 2.0), opposite=None)],
        "torque": lambda a, b, pin: [mbd.Torque("n", b, 0.7)],
        "torque on a body": lambda a, b, pin: [mbd.Torque("n", b, 0.7, opposite=a)],
        "generalised": lambda a, b, pin: [mbd.GeneralizedForce("g", [(b.phi - 2 * a.phi, 0.4), (b.x, 1.5)])],
        "spring": lambda a, b, pin: [mbd.TSDA("s", mbd.ground.at(0, 1), b.at(0.1, 0), stiffness=30, damping=1)],
        "spring between": lambda a, b, pin: [mbd.TSDA("s", a.at(0, 0.2), b.at(0.1, 0.1), stiffness=30, damping=1)],
        "torsion": lambda a, b, pin: [mbd.RSDA("s", origin, b.at(0, 0), stiffness=3)],
        "bushing": lambda a, b, pin: [mbd.Bushing("s", origin, b.at(0, 0), stiffness=(3, 5), angular_stiffness=1)],
        "stop": lambda a, b, pin: [mbd.EndStop("s", 0.1 - b.phi, law)],
        "stop along a global axis": lambda a, b, pin: [mbd.EndStop("s", b.x - a.x - 1.0, law)],
        "motor": lambda a, b, pin: [mbd.DCMotor("m", b, 6.0, constant=0.05, resistance=1.0, inductance=0.1)],
        "gas spring": lambda a, b, pin: [mbd.GasSpring("s", mbd.ground.at(0, 1), b.at(0, 0), 1e-4, 1.0, 1e6)],
        "contact": lambda a, b, pin: [
            mbd.Contact("c", mbd.Circle(b.at(0.4, 0), 0.1), mbd.HalfPlane(mbd.ground.at(0, 0)), law)
        ],
        "joint friction": lambda a, b, pin: [mbd.JointFriction("c", pin, mbd.Coulomb(0.2, 1e-2), radius=0.02)],
    }


@pytest.mark.slow
@pytest.mark.parametrize("kind", forces_of_every_kind())
def test_masses_alone_whatever_the_force(kind):
    """Applied forces have their reaction within the mechanism or on the ground: Newton's law of all bodies."""
    a = mbd.Body("a", mass=1.0, inertia=0.1, pose=(0.4, 0, 0))
    b = mbd.Body("b", mass=2.0, inertia=0.2, pose=(1.2, 0.0, 0))
    pin = mbd.Revolute("pin", a.at(0.4, 0), b.at(-0.4, 0))
    joints = [mbd.Revolute("hinge", mbd.ground.at(0, 0), a.at(-0.4, 0)), pin]
    model = mbd.Mechanism([a, b], joints, forces=[mbd.Gravity(), *forces_of_every_kind()[kind](a, b, pin)])
    run = mbd.simulate(model, np.linspace(0, 0.3, 7), initial=[a.phi == 0.3, b.phi == 0.15, a.omega == 1])
    point = (0.2, -0.3)
    shaking = mbd.shaking_force(model, point)
    force, moment = expected(run, model, point)
    scale = np.abs(force).max()
    np.testing.assert_allclose(run[shaking.force], force, atol=1e-8 * scale)
    np.testing.assert_allclose(run[shaking.moment], moment, atol=1e-8 * scale)


def test_a_field_comes_from_outside():
    """As weight does: a field force is carried by the joints, and nothing takes its reaction."""
    rod = mbd.Body.from_shape("rod", mbd.Rod(0.8, (0.4, 0)), mass=2.0)
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), rod.at(0, 0))
    field = mbd.FieldForce("magnet", rod, lambda point: (3.0 - point.x, 1.0))
    model = mbd.Mechanism([rod], [hinge], forces=[field])
    run = mbd.simulate(model, np.linspace(0, 0.5, 6))
    wanted = run[field.force] - 2.0 * run[rod.acceleration]
    found = run[mbd.shaking_force(model).force]
    np.testing.assert_allclose(found, wanted, atol=1e-9)
    np.testing.assert_allclose(found, run[hinge.reaction_on(mbd.ground).force], atol=1e-9)


def test_a_force_on_the_ground_needs_another_body():
    with pytest.raises(mbd.ModelError, match=r"force 'f' acts on 'ground', which takes the reaction too"):
        mbd.Force("f", mbd.ground.at(0, 0), (1, 0))
