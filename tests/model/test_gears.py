"""Gears, belts, couplers and rolling: rows against closed formulas and differences, ratios, forces, phase."""

import warnings

import numpy as np
import pytest
from differences import check_balance, check_rows, value_of

import mbdcasadi as mbd

RS, RP = 0.04, 0.02
RR = RS + 2 * RP
G = 9.81


def pair_of_gears(internal, phase=(0.4, 1.1), carrier_angle=0.7, ring_first=False):
    """Two gears on an arm that turns about the origin; poses that mesh exactly."""
    ra, rb = (RR, RP) if ring_first else (RP, RR) if internal else (RS, RP)
    distance = abs(ra - rb) if internal else ra + rb
    arm = mbd.Body("arm", mass=1, inertia=0.1, pose=(0, 0, carrier_angle))
    place = distance * np.array([np.cos(carrier_angle), np.sin(carrier_angle)])
    a = mbd.Body("a", mass=1, inertia=0.1, pose=(0, 0, phase[0]))
    b = mbd.Body("b", mass=1, inertia=0.1, pose=(*place, phase[1]))
    gear = mbd.Gear("mesh", a.at(0, 0), b.at(0, 0), ra, rb, internal=internal, carrier=arm)
    return gear, [arm, a, b], (ra, rb, distance)


@pytest.mark.parametrize("internal,ring_first", [(False, False), (True, False), (True, True)])
class TestGear:
    def consistent(self, internal, ring_first, rng):
        """A state on the constraints: arm and gear a move freely, b follows by Willis."""
        gear, bodies, (ra, rb, distance) = pair_of_gears(internal, ring_first=ring_first)
        turn, spin = rng.normal(size=2) * 5
        w_arm, w_a = rng.normal(size=2)
        sign = -1 if internal else 1
        # (omega_b - omega_arm) / (omega_a - omega_arm) = -/+ R_a / R_b
        follow = -sign * ra / rb
        arm, a = 0.7 + turn, 0.4 + spin
        b = 1.1 + turn + follow * (spin - turn)
        e, f = np.array([np.cos(arm), np.sin(arm)]), np.array([-np.sin(arm), np.cos(arm)])
        q = np.r_[0, 0, arm, 0, 0, a, distance * e, b]
        v = np.r_[0, 0, w_arm, 0, 0, w_a, distance * w_arm * f, w_arm + follow * (w_a - w_arm)]
        return gear, mbd.Mechanism(bodies=bodies, joints=[gear]), q, v, (ra, rb, distance, e, f)

    def test_willis(self, internal, ring_first, rng):
        """Phi and Phi_q v vanish on the motion that Willis' formula gives, many turns on."""
        _gear, mechanism, q, v, _ = self.consistent(internal, ring_first, rng)
        eom = mbd.equations(mechanism)
        assert value_of(mechanism, eom.Phi, q, v) == pytest.approx(0, abs=1e-13)
        assert value_of(mechanism, eom.Phi_q @ eom.v, q, v) == pytest.approx(0, abs=1e-13)
        check_rows(mechanism, q, v)

    def test_row_of_the_book(self, internal, ring_first, rng):
        """Haug's n(theta)·d has, on the constraint, the same Jacobian and gamma."""
        _gear, mechanism, q, v, (ra, rb, _, e, f) = self.consistent(internal, ring_first, rng)
        eom = mbd.equations(mechanism)
        sign = -1 if internal else 1
        total = ra + sign * rb
        # u from a to b, or from the ring to the gear; n = R^T u
        side = np.sign(total)
        d, dd = q[6:8] - q[3:5], v[6:8] - v[3:5]
        u, n = side * e, -side * f
        wd = (ra * v[5] + sign * rb * v[8]) / total
        # Phi = n·d with th linear in the angles: d/dphi_a = (d·u) R_a / total
        row = np.r_[0, 0, 0, -n, d @ u * ra / total, n, d @ u * sign * rb / total]
        gamma = -2 * wd * u @ dd + wd**2 * d @ n
        ours = value_of(mechanism, eom.Phi_q, q, v).ravel()
        np.testing.assert_allclose(ours, row * np.sign(row[5]), atol=1e-12)
        np.testing.assert_allclose(value_of(mechanism, eom.gamma, q, v), gamma * np.sign(row[5]), atol=1e-12)

    def test_tooth_force_acts_at_the_pitch_point(self, internal, ring_first, rng):
        """On both gears; nothing on the carrier."""
        gear, mechanism, q, v, (ra, rb, _, e, f) = self.consistent(internal, ring_first, rng)
        lam = np.array([3.7])
        point = q[3:5] + (e if not internal or ra > rb else -e) * ra
        for body, marker, sign in zip(mechanism.bodies[1:], (gear.a, gear.b), (1, -1), strict=True):
            force = value_of(mechanism, gear.reaction_on(body).force, q, v, lam=lam).ravel()
            torque = float(value_of(mechanism, gear.reaction_on(body).torque, q, v, lam=lam)[0, 0])
            centre = value_of(mechanism, marker.position, q, v).ravel()
            arm = point - centre
            assert abs(force @ f) == pytest.approx(3.7)
            assert force @ e == pytest.approx(0, abs=1e-12)
            assert torque == pytest.approx(arm[0] * force[1] - arm[1] * force[0])
            if sign == 1:
                assert float(value_of(mechanism, gear.tooth_force, q, v, lam=lam)[0, 0]) * ra == pytest.approx(torque)
        on_arm = gear.reaction_on(mechanism.bodies[0])
        np.testing.assert_allclose(value_of(mechanism, on_arm.torque, q, v, lam=lam), 0, atol=1e-12)
        check_balance(gear, mechanism, q, v, rng)


@pytest.fixture(params=range(2))
def rng(request):
    """Random states."""
    return np.random.default_rng(request.param)


def test_fixed_gears_turn_by_their_radii_over_many_turns():
    """No branch cut: 300 turns of the smaller gear, and the pose estimates set the phase."""
    a = mbd.Body("a", mass=1, inertia=1, pose=(0, 0, 0.3))
    b = mbd.Body("b", mass=1, inertia=1, pose=(0, RS + RP, -2.0))
    joints = [
        mbd.Revolute("A", mbd.ground.at(0, 0), a.at(0, 0)),
        mbd.Revolute("B", mbd.ground.at(0, RS + RP), b.at(0, 0)),
        mbd.Gear("mesh", a.at(0, 0), b.at(0, 0), RS, RP),
    ]
    drive = mbd.Driver("drive", a.phi, 0.3 + 20 * mbd.t)
    run = mbd.kinematics(mbd.Mechanism([a, b], joints, [drive]), np.linspace(0, 50, 501))
    np.testing.assert_allclose(run[b.phi], -2.0 - 2 * 20 * run.t, rtol=1e-12)
    assert run[b.phi][-1] < -300 * 2 * np.pi


@pytest.mark.slow
def test_planetary_train_by_willis():
    """Ring held: the arm turns R_s / (R_s + R_r) as fast; torques by power; planet pin by Newton."""
    train = mbd.library.planetary_gear(sun=RS, planet=RP)
    load = 2.0
    torque = mbd.Torque("load", train.arm, -load)
    mechanism = train.driven(sun=10 * mbd.t, ring=0.0)
    mechanism = mechanism.replace(forces=[*mechanism.forces, torque])
    run = mbd.inverse_dynamics(mechanism, np.linspace(0, 20, 101))
    ratio = RS / (RS + RR)
    np.testing.assert_allclose(run[train.arm.omega], 10 * ratio, rtol=1e-12)
    planet = train.planet_bodies[0]
    np.testing.assert_allclose(run[planet.omega], 10 * ratio - RS / RP * 10 * (1 - ratio), rtol=1e-12)
    sun, ring = (mechanism.joint(f"{name} drive").effort for name in ("sun", "ring"))
    np.testing.assert_allclose(run[sun], load * ratio, rtol=1e-12)
    np.testing.assert_allclose(run[ring], load * RR / (RS + RR), rtol=1e-12)
    # both meshes push the planet with the same force, its pin gets both and the centripetal force
    tooth = load * ratio / RS
    np.testing.assert_allclose(np.abs(run[train.sun_meshes[0].tooth_force]), tooth, rtol=1e-12)
    np.testing.assert_allclose(np.abs(run[train.ring_meshes[0].tooth_force]), tooth, rtol=1e-12)
    pin = mechanism.joint("planet pin").reaction_on(planet).force
    tangential, radial = 2 * tooth, planet.mass * (RS + RP) * (10 * ratio) ** 2
    np.testing.assert_allclose(run[mbd.norm(pin)], np.hypot(tangential, radial), rtol=1e-10)


@pytest.mark.slow
def test_planetary_train_with_free_ring_conserves_energy_and_the_relation():
    """Two degrees of freedom, simulated."""
    train = mbd.library.planetary_gear(sun=RS, planet=RP, planets=3)
    initial = [train.sun.omega == 30, train.ring.omega == -4, train.sun.phi == 0, train.arm.phi == 0]
    with_loads = {train.tau_sun: 0.01}
    run = mbd.simulate(train.mechanism, duration=2.0, initial=initial, inputs=with_loads)
    willis = train.sun.omega * RS + train.ring.omega * RR - train.arm.omega * (RS + RR)
    assert np.max(np.abs(run[willis])) < 1e-12
    work = 0.01 * (run[train.sun.phi] - run[train.sun.phi][0])
    np.testing.assert_allclose(run.energy.kinetic - run.energy.kinetic[0], work, atol=1e-6)
    shares = np.array([run[mesh.tooth_force] for mesh in train.sun_meshes])
    np.testing.assert_allclose(shares, shares[:1] * np.ones((3, 1)), atol=1e-7)


def test_wrong_carrier_is_told():
    """A planet whose carrier was not named: the line of centres turns."""
    arm = mbd.Body("arm", mass=1, inertia=1)
    planet = mbd.Body("planet", mass=1, inertia=1, pose=(RS + RP, 0, 0))
    joints = [
        mbd.Revolute("hub", mbd.ground.at(0, 0), arm.at(0, 0)),
        mbd.Revolute("pin", arm.at(RS + RP, 0), planet.at(0, 0)),
        mbd.Gear("mesh", mbd.ground.at(0, 0), planet.at(0, 0), RS, RP),
    ]
    mechanism = mbd.Mechanism([arm, planet], joints, [mbd.Driver("drive", arm.phi, mbd.t)])
    with pytest.warns(mbd.MechanismWarning, match="turns relative to carrier 'ground'.*name the body"):
        mbd.kinematics(mechanism, np.linspace(0, 2, 21))


def test_wrong_centre_distance_is_told():
    """Centres 70 mm apart with radii that make 60."""
    a, b = (mbd.Body(n, mass=1, inertia=1, pose=(x, 0, 0)) for n, x in (("a", 0), ("b", 0.07)))
    pins = [mbd.Revolute(f"pin {x.name}", mbd.ground.at(*x.pose_estimate[:2]), x.at(0, 0)) for x in (a, b)]
    mechanism = mbd.Mechanism([a, b], [*pins, mbd.Gear("mesh", a.at(0, 0), b.at(0, 0), RS, RP)])
    with pytest.warns(mbd.MechanismWarning, match="'mesh': the centres are not at the distance"):
        mbd.simulate(mechanism, duration=0.1)


@pytest.mark.parametrize(
    "change,said",
    [
        (dict(radius_a=-0.1), "radius_a must be above 0, got -0.1"),
        (dict(radius_b=0), "radius_b must be above 0, got 0"),
        (dict(radius_a=0.02, radius_b=0.02, internal=True), "two different radii"),
        (dict(carrier="arm"), "carrier must be a body"),
        (dict(carrier="a"), "carrier 'a' is one of the two bodies that turn"),
        (dict(b="ground"), "centres coincide at the estimated poses"),
    ],
)
def test_gears_that_make_no_sense(change, said):
    """Each message names the joint and the quantity."""
    a, b = mbd.Body("a", mass=1, inertia=1), mbd.Body("b", mass=1, inertia=1, pose=(0.06, 0, 0))
    given = dict(a=a.at(0, 0), b=b.at(0, 0), radius_a=RS, radius_b=RP) | change
    if given.get("carrier") == "a":
        given["carrier"] = a
    if given["b"] == "ground":
        given["b"] = mbd.ground.at(0, 0)
    with pytest.raises(mbd.ModelError, match=f"'mesh'.*{said}"):
        mbd.Gear("mesh", **given)


def test_radius_that_is_a_parameter():
    """It enters C0 too, so that the phase stays; limits are checked for each value."""
    radius = mbd.Parameter("R", RS)
    a, b = mbd.Body("a", mass=1, inertia=1, pose=(0, 0, 1.0)), mbd.Body("b", mass=1, inertia=1, pose=(RS + RP, 0, 2.0))
    joints = [
        mbd.Revolute("A", mbd.ground.at(0, 0), a.at(0, 0)),
        mbd.Revolute("B", mbd.ground.at(radius + RP, 0), b.at(0, 0)),
        mbd.Gear("mesh", a.at(0, 0), b.at(0, 0), radius, RP),
    ]
    mechanism = mbd.Mechanism([a, b], joints, [mbd.Driver("d", a.phi, 1 + mbd.t)], parameters=[radius])
    run = mbd.kinematics(mechanism, [0, 1.0], parameters={radius: 0.06})
    np.testing.assert_allclose(run[b.phi], [2, 2 - 3], atol=1e-12)
    with pytest.raises(mbd.ModelError, match="radius_a must be above 0, got -0.1 with parameter 'R'"):
        mbd.kinematics(mechanism, [0, 1.0], parameters={radius: -0.1})


# --- belts and couplers --------------------------------------------------------------------
def bench(joint_of):
    """Two shafts on a frame that turns."""
    frame = mbd.Body("frame", mass=1, inertia=1, pose=(0, 0, 0.2))
    a, b = mbd.Body("a", mass=1, inertia=0.5, pose=(0, 0, 1)), mbd.Body("b", mass=1, inertia=2, pose=(1, 0, -1))
    joint = joint_of(a.at(0, 0), b.at(0, 0), frame)
    return joint, mbd.Mechanism([frame, a, b], [joint])


SHAFTS = {
    "belt": (lambda a, b, f: mbd.Belt("j", a, b, 0.1, 0.3, carrier=f), 1 / 3),
    "crossed belt": (lambda a, b, f: mbd.Belt("j", a, b, 0.1, 0.3, crossed=True, carrier=f), -1 / 3),
    "coupler": (lambda a, b, f: mbd.Coupler("j", a, b, -2.5, carrier=f), -2.5),
}


@pytest.mark.parametrize("name", SHAFTS)
def test_belts_and_couplers(name, rng):
    """Linear in the angles against the carrier, gamma = 0, the phase from the poses; reactions balance."""
    make, ratio = SHAFTS[name]
    joint, mechanism = bench(make)
    eom = mbd.equations(mechanism)
    turn, spin = rng.normal(size=2) * 20
    q = np.r_[0, 0, 0.2 + turn, 0, 0, 1 + spin, 1, 0, -1 + turn + ratio * (spin - turn)]
    v = rng.normal(size=9)
    assert value_of(mechanism, eom.Phi, q, v) == pytest.approx(0, abs=1e-12)
    row = value_of(mechanism, eom.Phi_q, q, v).ravel()
    np.testing.assert_allclose(row / row[8], [0, 0, ratio - 1, 0, 0, -ratio, 0, 0, 1], atol=1e-14)
    assert value_of(mechanism, eom.gamma, q, v) == 0
    check_rows(mechanism, q, v)
    check_balance(joint, mechanism, q, v, rng)


def test_belt_drive_accelerates_as_the_reduced_inertia_says():
    """Torque T on a: alpha = T / (J_a + n² J_b), n = R_a / R_b; the strands differ by the torque on b over R_b."""
    a, b = mbd.Body("a", mass=1, inertia=0.5), mbd.Body("b", mass=1, inertia=2, pose=(1, 0, 0))
    belt = mbd.Belt("belt", a.at(0, 0), b.at(0, 0), 0.1, 0.3)
    pins = [mbd.Revolute("A", mbd.ground.at(0, 0), a.at(0, 0)), mbd.Revolute("B", mbd.ground.at(1, 0), b.at(0, 0))]
    state = mbd.assemble(mbd.Mechanism([a, b], [*pins, belt], forces=[mbd.Torque("T", a, 3.0)]))
    alpha = 3.0 / (0.5 + 2 / 9)
    assert state[a.alpha] == pytest.approx(alpha)
    assert state[b.alpha] == pytest.approx(alpha / 3)
    assert state[belt.tension_difference] == pytest.approx(-2 * alpha / 3 / 0.3)
    assert state[belt.reaction_on(b).torque] == pytest.approx(2 * alpha / 3)


def test_couplers_and_belts_that_make_no_sense():
    """Zero ratio, radii that are not positive, a carrier that is no body."""
    a, b = (mbd.Body(n, mass=1, inertia=1).at(0, 0) for n in "ab")
    with pytest.raises(mbd.ModelError, match="'c'.*ratio is zero"):
        mbd.Coupler("c", a, b, 0)
    with pytest.raises(mbd.ModelError, match="'b'.*radius_b must be above 0"):
        mbd.Belt("b", a, b, 0.1, -0.1)
    for make in (lambda: mbd.Coupler("c", a, b, 1, carrier=1), lambda: mbd.Belt("c", a, b, 1, 1, carrier=None)):
        with pytest.raises(mbd.ModelError, match="carrier must be a body"):
            make()


@pytest.mark.parametrize(
    "couple,factor",
    [
        # the couple on b is 1, that on a follows from the ratio: -n, R_a/R_b, -R_a/R_b
        (lambda a, b, carrier: mbd.Coupler("c", a, b, -2.5, **carrier), 2.5),
        (lambda a, b, carrier: mbd.Belt("c", a, b, 0.1, 0.04, **carrier), -2.5),
        (lambda a, b, carrier: mbd.Belt("c", a, b, 0.1, 0.04, crossed=True, **carrier), 2.5),
    ],
    ids=["coupler", "belt", "crossed"],
)
@pytest.mark.parametrize("moving", [False, True])
def test_the_carrier_takes_the_rest_of_the_couples(couple, factor, moving):
    """Newton and Euler on both shafts under load; the carrier, ground or not, gets what is left over."""
    a, b = mbd.Body("a", mass=1, inertia=0.2), mbd.Body("b", mass=1, inertia=0.3, pose=(0.5, 0, 0))
    frame = mbd.Body("frame", mass=3, inertia=0.4) if moving else mbd.ground
    joint = couple(a.at(0, 0), b.at(0, 0), {"carrier": frame} if moving else {})
    bearings = [
        mbd.Revolute("A", frame.at(0, 0), a.at(0, 0)),
        mbd.Revolute("B", frame.at(0.5, 0), b.at(0, 0)),
    ]
    loads = [mbd.Torque("drive", a, 1.3), mbd.Torque("brake", b, 0.7)]
    bodies = [a, b, *([frame] if moving else [])]
    state = mbd.assemble(mbd.Mechanism(bodies, [*bearings, joint], forces=loads))
    on_a, on_b = 0.2 * state[a.alpha] - 1.3, 0.3 * state[b.alpha] - 0.7
    assert abs(on_b) > 0.1 and on_a == pytest.approx(factor * on_b)
    assert state[joint.reaction_on(a).torque] == pytest.approx(on_a)
    assert state[joint.reaction_on(b).torque] == pytest.approx(on_b)
    assert state[joint.reaction_on(frame).torque] == pytest.approx(-on_a - on_b)
    np.testing.assert_allclose(state[joint.reaction_on(frame).force], 0, atol=1e-12)


A, B = (mbd.Body(n, mass=1, inertia=1, pose=(k, 0, 0)) for k, n in enumerate("AB"))
GROW, STRAY = 0.1 + 0.01 * mbd.t, mbd.Input("u")


@pytest.mark.parametrize(
    "make,said",
    [
        (lambda a, b: mbd.Coupler("c", a, b, mbd.t), "joint 'c': ratio depends on time 't'"),
        (lambda a, b: mbd.Gear("c", a, b, GROW, 0.1), "joint 'c': radius_a depends on time 't'"),
        (lambda a, b: mbd.Gear("c", a, b, 0.1, 0.3 + A.x), "joint 'c': radius_b depends on position 'A.x'"),
        (lambda a, b: mbd.Belt("c", a, b, 0.1, STRAY), "joint 'c': radius_b depends on input 'u'"),
        (lambda a, b: mbd.RackAndPinion("c", a, b, GROW), "joint 'c': radius depends on time 't'"),
        (lambda a, b: mbd.Rolling("c", a, b, GROW), "joint 'c': radius depends on time 't'"),
        (
            lambda a, b: mbd.CamPointFollower("c", a, b, mbd.CamOutline(0.2), GROW),
            "joint 'c': roller_radius depends on time 't'",
        ),
    ],
)
def test_radii_and_ratios_do_not_vary(make, said):
    """A ratio of rates is one of angles only where it is constant."""
    with pytest.raises(mbd.ExpressionError, match=said + "; it is a number or an expression in parameters only"):
        make(A.at(0, 0), B.at(0, 0))


def test_ratios_of_parameters_are_taken():
    """And follow the parameter's value."""
    n = mbd.Parameter("n", 2.0)
    hubs = [mbd.Revolute(f"hub {x.name}", mbd.ground.at(k, 0), x.at(0, 0)) for k, x in enumerate((A, B))]
    joints = [*hubs, mbd.Coupler("c", A.at(0, 0), B.at(0, 0), n + 1)]
    mechanism = mbd.Mechanism([A, B], joints, [mbd.Driver("d", A.phi, 0.3 * mbd.t)], parameters=[n])
    run = mbd.kinematics(mechanism, [0.0, 1.0], parameters={n: -3.0})
    assert run[B.phi][-1] == pytest.approx(-0.6, abs=1e-12)


@pytest.mark.parametrize(
    "make,said",
    [
        (lambda a, b: mbd.Gear("c", a, b, 0.4, 0.6, internal="no"), "'c': internal must be True or False, got 'no'"),
        (lambda a, b: mbd.Belt("c", a, b, 0.4, 0.6, crossed=1), "'c': crossed must be True or False, got 1"),
    ],
)
def test_a_choice_of_two_is_no_text(make, said):
    """A text that says no would count as yes."""
    with pytest.raises(mbd.ModelError, match=said):
        make(A.at(0, 0), B.at(0, 0))


# --- rolling -----------------------------------------------------------------------------------
def disc_on_incline(slope=0.4, radius=0.3, mass=5.0):
    """A homogeneous disc above an inclined track."""
    track = mbd.ground.at(0, 0, angle=-slope)
    pose = (radius * np.sin(slope), radius * np.cos(slope), 0.0)
    disc = mbd.Body("disc", mass=mass, inertia=mass * radius**2 / 2, pose=pose)
    roll = mbd.Rolling("contact", disc.at(0, 0), track, radius)
    return disc, roll, mbd.Mechanism([disc], [roll], forces=[mbd.Gravity()])


def test_disc_rolls_down_with_two_thirds_of_the_acceleration():
    """a = 2/3 g sin(slope), friction m g sin(slope) / 3, normal force m g cos(slope)."""
    slope, radius, mass = 0.4, 0.3, 5.0
    disc, roll, mechanism = disc_on_incline(slope, radius, mass)
    run = mbd.simulate(mechanism, duration=1.0)
    way = G * np.sin(slope) * run.t**2 / 3
    np.testing.assert_allclose(run[roll.displacement], way, atol=1e-7)
    np.testing.assert_allclose(run[disc.phi], -way / radius, atol=1e-6)
    np.testing.assert_allclose(run[roll.normal_force], mass * G * np.cos(slope), rtol=1e-10)
    np.testing.assert_allclose(run[roll.friction_force], -mass * G * np.sin(slope) / 3, rtol=1e-10)
    along = np.array([np.cos(slope), -np.sin(slope)])
    total = run[roll.reaction_on(disc).force]
    np.testing.assert_allclose(total @ along, -mass * G * np.sin(slope) / 3, rtol=1e-10)
    np.testing.assert_allclose(run[roll.reaction_on(disc).torque], -radius * mass * G * np.sin(slope) / 3, rtol=1e-9)


def test_rows_of_rolling(rng):
    """Against differences on a moving track, and forces that balance at the contact point."""
    cart, wheel = mbd.Body("cart", mass=1, inertia=1), mbd.Body("wheel", mass=1, inertia=1, pose=(0.2, 0.5, 0))
    roll = mbd.Rolling("r", wheel.at(0.02, 0.01), cart.at(0.1, 0.2, angle=0.3), 0.25)
    mechanism = mbd.Mechanism([cart, wheel], [roll])
    q, v = rng.normal(size=6), rng.normal(size=6)
    check_rows(mechanism, q, v)
    check_balance(roll, mechanism, q, v, rng)


def test_wheel_that_would_leave_the_track_is_told():
    """An upward pull larger than the weight."""
    disc, _, mechanism = disc_on_incline(0.0)
    pull = mbd.Force("crane", disc.at(0, 0), (0, 60.0))
    with pytest.warns(mbd.MechanismWarning, match="'contact': the normal force is negative"):
        mbd.simulate(mechanism.replace(forces=[mbd.Gravity(), pull]), duration=0.1)


def test_radius_of_a_wheel_must_be_positive():
    """Named with its value."""
    disc = mbd.Body("disc", mass=1, inertia=1)
    with pytest.raises(mbd.ModelError, match="'r'.*radius must be above 0, got -1"):
        mbd.Rolling("r", disc.at(0, 0), mbd.ground.at(0, 0), -1)


def test_disc_rolls_in_a_bowl_on_a_massless_arm():
    """Internal gear on the ground: 3/4 m (R - r)² θ̇² = m g (R - r) (cos θ - cos θ0); spin by the ratio."""
    R, r, mass, start = 1.0, 0.25, 2.0, 1.2
    place = (R - r) * np.array([np.sin(start), -np.cos(start)])
    arm = mbd.Body("arm", mass=0, inertia=0, pose=(0, 0, start))
    disc = mbd.Body("disc", mass=mass, inertia=mass * r**2 / 2, pose=(*place, 0.3))
    joints = [
        mbd.Revolute("hub", mbd.ground.at(0, 0), arm.at(0, 0)),
        mbd.Revolute("pin", arm.at(0, -(R - r)), disc.at(0, 0)),
        mbd.Gear("bowl", mbd.ground.at(0, 0), disc.at(0, 0), R, r, internal=True, carrier=arm),
    ]
    mechanism = mbd.Mechanism([arm, disc], joints, forces=[mbd.Gravity()])
    run = mbd.simulate(mechanism, duration=3.0, reltol=1e-10, abstol=1e-10)
    theta = run[arm.phi]
    np.testing.assert_allclose(run[arm.omega] ** 2, 4 * G / (3 * (R - r)) * (np.cos(theta) - np.cos(start)), atol=1e-6)
    np.testing.assert_allclose(run[disc.phi] - 0.3, -(R - r) / r * (theta - start), atol=1e-9)
    # the friction that makes it roll: a third of the weight's tangential part
    np.testing.assert_allclose(np.abs(run[joints[2].tooth_force]), mass * G * np.abs(np.sin(theta)) / 3, atol=1e-6)


@pytest.mark.parametrize("arm_carries", [True, False])
def test_a_belt_of_pulleys_that_its_carrier_does_not_hold_is_reported(arm_carries):
    """A wheel at the end of an arm, driven from the arm's pivot or from beside it."""
    arm = mbd.Body("arm", 5, 0.2, pose=(0.3, 0, 0))
    wheel, sprocket = mbd.Body("wheel", 3, 0.05, pose=(0.6, 0, 0)), mbd.Body("sprocket", 0.5, 1e-3)
    joints = [
        mbd.Revolute("pivot", mbd.ground.at(0, 0), arm.at(-0.3, 0)),
        mbd.Revolute("hub", arm.at(0.3, 0), wheel.at(0, 0)),
        mbd.Revolute("axle", mbd.ground.at(0, 0 if arm_carries else 0.05), sprocket.at(0, 0)),
        mbd.Belt("chain", sprocket.at(0, 0), wheel.at(0, 0), 0.03, 0.09, carrier=arm if arm_carries else mbd.ground),
    ]
    model = mbd.Mechanism([arm, wheel, sprocket], joints=joints, forces=[mbd.Gravity()])
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", mbd.MechanismWarning)
        told = [*mbd.check(model).remarks, *mbd.simulate(model, duration=0.1).statistics.notes]
    told += [str(warning.message) for warning in caught]
    found = [text for text in told if "'chain': the centre of pulley 'wheel' moves" in text]
    assert len(found) == (0 if arm_carries else 3)
