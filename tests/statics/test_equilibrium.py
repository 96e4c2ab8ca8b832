"""Equilibria against closed forms: branches, stability, unknown loads, paths, buckling and snap-through."""

import warnings

import numpy as np
import pytest
from linkages import G, four_bar, pendulum
from scipy.optimize import brentq, fsolve

import mbdcasadi as mbd


def column(load):
    """Two upright links of 0.5 m on rotational springs of 20 N m/rad, with a load on the top."""
    lower = mbd.Body("lower", mass=0.1, inertia=0.002, pose=(0, 0.25, np.pi / 2))
    upper = mbd.Body("upper", mass=0.1, inertia=0.002, pose=(0, 0.75, np.pi / 2))
    base, elbow = (mbd.ground.at(0, 0), lower.at(-0.25, 0)), (lower.at(0.25, 0), upper.at(-0.25, 0))
    joints = [mbd.Revolute("base", *base), mbd.Revolute("elbow", *elbow)]
    springs = [
        mbd.RSDA("base spring", *base, stiffness=20, free_angle=np.pi / 2),
        mbd.RSDA("elbow spring", *elbow, stiffness=20),
    ]
    return lower, upper, joints, [*springs, load(upper)]


def truss(push, rise=0.3, stiffness=1000.0):
    """Shallow truss of von Mises: two springs over a span of 2 m, pushed down at the apex."""
    apex = mbd.Body("apex", mass=1.0, inertia=1.0, pose=(0, rise, 0))
    guides = [mbd.AbsoluteX("x", apex.at(0, 0)), mbd.AbsoluteAngle("upright", apex.at(0, 0))]
    bars = [
        mbd.TSDA(f"bar {x}", mbd.ground.at(x, 0), apex.at(0, 0), stiffness=stiffness, free_length=np.hypot(1, rise))
        for x in (-1, 1)
    ]
    forces = [*bars, mbd.Force("push", apex.at(0, 0), (0, -push))]
    return apex, mbd.Mechanism(bodies=[apex], joints=guides, forces=forces, parameters=[push])


# --- one equilibrium -------------------------------------------------------------------
def test_rod_on_a_spring_has_the_length_of_the_closed_form():
    rod = mbd.Body("rod", mass=4.0, inertia=4 / 12, pose=(0.5 * np.cos(1.2), 0.5 * np.sin(1.2), 1.2))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), rod.at(-0.5, 0))
    spring = mbd.TSDA("spring", mbd.ground.at(0, 1.5), rod.at(0.5, 0), stiffness=150, free_length=0.6)
    rest = mbd.equilibrium(mbd.Mechanism(bodies=[rod], joints=[pin], forces=[mbd.Gravity(), spring]))
    # moments about the pin: k (1 - l0 / l) 1.5 = m g / 2
    assert rest[spring.length] == pytest.approx(0.6 / (1 - 4 * G / (2 * 150 * 1.5)), abs=1e-12)
    assert rest.stable
    assert np.all(rest.v == 0) and np.all(rest.a == 0)
    pull = 150 * (rest[spring.length] - 0.6)
    along = np.array([-rest[rod.at(0.5, 0).x], 1.5 - rest[rod.at(0.5, 0).y]]) / rest[spring.length]
    assert rest[pin.reaction_on(rod).force] == pytest.approx([-pull * along[0], 4 * G - pull * along[1]], abs=1e-9)


def test_stable_branch_is_preferred_and_the_other_one_can_be_had():
    p = pendulum(angle=np.pi / 2)
    down = mbd.equilibrium(p.mechanism)
    assert down.stable and down[mbd.sin(p.rod.phi)] == pytest.approx(-1, abs=1e-12)
    up = mbd.equilibrium(p.mechanism, prefer="nearest")
    assert not up.stable and up[p.rod.phi] == pytest.approx(np.pi / 2, abs=1e-12)
    # per displacement of the centre and arc at the lever of 0.5 m, taken together: -m g h / 2 h²
    assert up.stiffness.least == pytest.approx(-G * 0.5 / (2 * 0.5**2), rel=1e-12)


def test_conditions_choose_where_to_start_from():
    p = pendulum(forces=lambda rod: [mbd.Torque("two wells", rod, 20 * mbd.sin(2 * rod.phi))])
    right = mbd.equilibrium(p.mechanism, [p.rod.phi == 0.9])
    left = mbd.equilibrium(p.mechanism, [p.rod.phi == -2.0])
    for rest in (right, left):
        phi = rest[p.rod.phi]
        assert 20 * np.sin(2 * phi) - 0.5 * G * np.cos(phi) == pytest.approx(0, abs=1e-9)
        assert rest.stable
    assert right[p.rod.phi] > 0 > left[p.rod.phi]
    again = mbd.equilibrium(p.mechanism, right)
    assert again[p.rod.phi] == pytest.approx(right[p.rod.phi], abs=1e-13)


def test_a_limit_that_the_equilibrium_breaks_is_told():
    p = pendulum(angle=0.3)
    with pytest.raises(mbd.EquilibriumError, match=r"breaks the condition.*rod\.phi"):
        mbd.equilibrium(p.mechanism, [p.rod.phi >= 0])


def test_a_rest_that_an_element_does_not_allow_is_told():
    """A mass of 3 kg stands on a cable, which would have to push with its weight."""
    mass = mbd.Body("mass", mass=3.0, inertia=1.0, pose=(0, 1, 0))
    cable = mbd.Cable("cable", mbd.ground.at(0, 0), mass.at(0, 0))
    guide = mbd.Translational("guide", mbd.ground.at(0, 0, np.pi / 2), mass.at(0, 0, np.pi / 2))
    mechanism = mbd.Mechanism([mass], [cable, guide], forces=[mbd.Gravity((0, -9.81))])
    with pytest.warns(mbd.MechanismWarning, match=r"equilibrium: cable 'cable': a strand would .*-29\.43 N"):
        mbd.equilibrium(mechanism)


def test_inputs_beyond_their_limits_are_told():
    """What holds the pose is found, and said to be more than the motor has; so are values that are given."""
    tau = mbd.Input("tau", lower=-2, upper=2)
    p = pendulum(forces=lambda rod: [mbd.Torque("motor", rod, tau)], inputs=[tau])
    with pytest.warns(mbd.MechanismWarning, match="input 'tau' .* beyond its limits -2 … 2; equilibrium does not hold"):
        assert mbd.equilibrium(p.mechanism, [p.rod.phi == 0], unknowns=[tau])[tau] == pytest.approx(0.5 * G)
    with pytest.warns(mbd.MechanismWarning, match="input 'tau' goes from 2.5"):
        mbd.equilibrium(p.mechanism, inputs={tau: 2.5})


def test_torque_that_holds_a_pose():
    tau = mbd.Input("tau")
    p = pendulum(forces=lambda rod: [mbd.Torque("motor", rod, tau)], inputs=[tau])
    rest = mbd.equilibrium(p.mechanism, [p.rod.phi == 0.3], unknowns=[tau])
    assert rest[tau] == pytest.approx(0.5 * G * np.cos(0.3), abs=1e-11)
    assert rest[p.rod.phi] == pytest.approx(0.3, abs=1e-13)
    assert not rest.stable


def test_mass_at_which_a_reaction_is_as_wanted():
    mass = mbd.Parameter("mass", 1.0, lower=0.1)
    block = mbd.Body("block", mass=mass, inertia=1.0)
    guide = mbd.Weld("support", mbd.ground.at(0, 0), block.at(0, 0))
    stand = mbd.Mechanism(bodies=[block], joints=[guide], forces=[mbd.Gravity()], parameters=[mass])
    weight = guide.reaction_on(block).force[1]
    rest = mbd.equilibrium(stand, [weight == 100], unknowns=[mass])
    assert rest[mass] == pytest.approx(100 / G, rel=1e-12)
    with pytest.raises(mbd.ConditionError, match="1 unknowns .* need as many equalities"):
        mbd.equilibrium(stand, unknowns=[mass])


def test_four_bar_rests_where_its_potential_is_least():
    def spring(f):
        return mbd.TSDA("spring", f.crank.at(0.1, 0), mbd.ground.at(0.55, 0.4), stiffness=300, free_length=0.35)

    f = four_bar(1.0, forces=lambda f: [mbd.Gravity(), spring(f)])
    rest = mbd.equilibrium(f.mechanism)
    assert rest.stable
    potential = mbd.equations(f.mechanism).potential
    here = rest[potential]
    for turn in (-0.02, -1e-3, 1e-3, 0.02):
        there = mbd.assemble(f.mechanism, [f.crank.phi == rest[f.crank.phi] + turn])
        assert there[potential] > here
    # the slope of the potential along the motion vanishes
    ends = [mbd.assemble(f.mechanism, [f.crank.phi == rest[f.crank.phi] + h])[potential] for h in (-1e-4, 1e-4)]
    assert (ends[1] - ends[0]) / 2e-4 == pytest.approx(0, abs=1e-6)


def test_redundant_rows_carry_the_forces_of_least_norm():
    beam = mbd.Body("beam", mass=3.0, inertia=1.0)
    posts = [mbd.Revolute(f"post {x}", mbd.ground.at(x, 0), beam.at(x, 0)) for x in (-1, 0, 1)]
    rest = mbd.equilibrium(mbd.Mechanism(bodies=[beam], joints=posts, forces=[mbd.Gravity()]))
    assert [rest[post.reaction_on(beam).force][1] for post in posts] == pytest.approx([G, G, G], abs=1e-10)


def test_first_order_states_follow_the_pose():
    level = mbd.StateVariable("level", 0.3)
    p = pendulum(
        forces=lambda rod: [mbd.Torque("valve", rod, level)],
        states={level: 2 * (3.0 - level)},
    )
    rest = mbd.equilibrium(p.mechanism)
    assert rest[level] == pytest.approx(3.0, abs=1e-12)
    assert 0.5 * G * np.cos(rest[p.rod.phi]) == pytest.approx(3.0, abs=1e-10)


def test_feedback_through_a_state_enters_the_stiffness():
    level = mbd.StateVariable("level")
    rod = mbd.Body("rod", mass=1.0, inertia=1 / 12, pose=(0, 0.5, np.pi / 2))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), rod.at(-0.5, 0))
    forces = [mbd.Gravity(), mbd.Torque("valve", rod, level)]
    held = mbd.Mechanism(bodies=[rod], joints=[pin], forces=forces, states={level: -30 * (rod.phi - np.pi / 2) - level})
    rest = mbd.equilibrium(held)
    assert rest.stiffness.holds
    assert rest.stiffness.least == pytest.approx((30 - 0.5 * G) / (2 * 0.5**2), rel=1e-12)
    # but the state lags behind, and without a damper the motion grows: (s²/3 - G/2)(s + 1) + 30 = 0
    wanted = np.roots(np.polyadd(np.polymul([1 / 3, 0, -0.5 * G], [1, 1]), [30]))
    assert rest.small_motions.growth == pytest.approx(np.max(wanted.real), rel=1e-9)
    assert not rest.stable
    damper = mbd.Torque("damper", rod, -15 * rod.omega)
    assert mbd.equilibrium(held.replace(forces=[*forces, damper])).stable


@pytest.mark.slow
def test_what_falls_has_no_equilibrium():
    stone = mbd.Body("stone", mass=2.0, inertia=1.0)
    with pytest.raises(mbd.EquilibriumError, match=r"stone\.y \(-19\.62\).*no force holds it back"):
        mbd.equilibrium(mbd.Mechanism(bodies=[stone], forces=[mbd.Gravity()]))


def test_a_driver_that_moves_is_told():
    p = pendulum()
    turned = p.mechanism.replace(drivers=[mbd.Driver("turn", p.pin.angle, 2 * mbd.t)])
    with pytest.raises(mbd.EquilibriumError, match="driver 'turn' moves at 2 per second"):
        mbd.equilibrium(turned)


def test_a_wheel_that_may_turn_is_not_stable():
    wheel = mbd.Body("wheel", mass=1.0, inertia=1.0)
    axle = mbd.Revolute("axle", mbd.ground.at(0, 0), wheel.at(0, 0))
    rest = mbd.equilibrium(mbd.Mechanism(bodies=[wheel], joints=[axle], forces=[mbd.Gravity()]))
    assert not rest.stable
    assert rest.stiffness.values == pytest.approx([0.0], abs=1e-12)


def test_stiff_springs_and_soft_ones_together():
    blocks = [mbd.Body(f"block {k}", mass=1.0, inertia=1.0, pose=(k + 1.0, 0, 0)) for k in range(2)]
    guides = [mbd.Translational(f"guide {k}", mbd.ground.at(0, 0), b.at(0, 0)) for k, b in enumerate(blocks)]
    springs = [
        mbd.TSDA("stiff", mbd.ground.at(0, 0), blocks[0].at(0, 0), stiffness=1e8, free_length=1.1),
        mbd.TSDA("soft", blocks[0].at(0, 0), blocks[1].at(0, 0), stiffness=0.1, free_length=0.5),
        mbd.Force("pull", blocks[1].at(0, 0), (0.02, 0)),
    ]
    rest = mbd.equilibrium(mbd.Mechanism(bodies=blocks, joints=guides, forces=springs))
    assert rest[blocks[0].x] == pytest.approx(1.1 + 0.02 / 1e8, abs=1e-15)
    assert rest[blocks[1].x - blocks[0].x] == pytest.approx(0.5 + 0.02 / 0.1, abs=1e-9)


# --- follower load ----------------------------------------------------------------------
@pytest.mark.parametrize(("load", "stable"), [(2.0, True), (2.15, False)])
def test_column_of_ziegler_flutters_under_a_load_that_follows(load, stable):
    """P L / k = 7/2 - √2 = 2.086 for masses 2 m and m (Ziegler 1952); no static criterion finds it."""
    lower = mbd.Body("lower", mass=2.0, inertia=0.0, pose=(0, 1.0, np.pi / 2))
    upper = mbd.Body("upper", mass=1.0, inertia=0.0, pose=(0, 2.0, np.pi / 2))
    joints = [
        mbd.Revolute("base", mbd.ground.at(0, 0), lower.at(-1, 0)),
        mbd.Revolute("elbow", lower.at(0, 0), upper.at(-1, 0)),
    ]
    forces = [
        mbd.RSDA("base spring", mbd.ground.at(0, 0), lower.at(-1, 0), stiffness=1.0, free_angle=np.pi / 2),
        mbd.RSDA("elbow spring", lower.at(0, 0), upper.at(-1, 0), stiffness=1.0),
        mbd.Force("follower", upper.at(0, 0), (-load, 0), frame="body"),
    ]
    rest = mbd.equilibrium(mbd.Mechanism(bodies=[lower, upper], joints=joints, forces=forces), prefer="nearest")
    assert rest.stable is stable
    growth = np.max(mbd.linearize(rest.mechanism, rest).eigenvalues.real)
    assert bool(growth > 1e-3) is (not stable)


def test_words_for_rest():
    """A body on a pin at its centre may turn; weights of any size hang down, also if their squares are no numbers."""
    wheel = mbd.Body("wheel", mass=1.0, inertia=0.1)
    axle = mbd.Revolute("axle", mbd.ground.at(0, 0), wheel.at(0, 0))
    assert "neutral at rest" in repr(mbd.equilibrium(mbd.Mechanism([wheel], joints=[axle], forces=[mbd.Gravity()])))
    for mass in (1e-300, 1.0, 1e200):
        rest = mbd.equilibrium(pendulum(mass=mass).mechanism)
        assert rest.q[:2] == pytest.approx([0, -0.5], abs=1e-9)
        assert "  stable at rest" in repr(rest)


# --- paths ------------------------------------------------------------------------------
@pytest.mark.slow
def test_buckling_loads_of_the_column():
    load = mbd.Parameter("load", 0.0)
    lower, upper, joints, forces = column(lambda top: mbd.Force("load", top.at(0.25, 0), (0, -load)))
    stand = mbd.Mechanism(bodies=[lower, upper], joints=joints, forces=forces, parameters=[load])
    path = mbd.equilibrium_path(stand, load, 0, 120)
    expected = 20 / 0.5 * (3 + np.array([-1, 1]) * np.sqrt(5)) / 2
    assert [c.value for c in path.critical] == pytest.approx(expected, rel=1e-9)
    assert [c.kind for c in path.critical] == ["bifurcation", "bifurcation"]
    assert np.array_equal(path.stable, path.values < expected[0])
    assert path[upper.y] == pytest.approx(0.75, abs=1e-12)
    # first shape: [1, golden ratio] in the angles of the links
    turn = path.critical[0].direction[[2, 5]]
    assert turn[1] / turn[0] == pytest.approx((1 + np.sqrt(5)) / 2, rel=1e-6)


@pytest.mark.slow
def test_an_imperfect_column_bends_instead():
    load = mbd.Input("load")
    lower, upper, joints, forces = column(lambda top: mbd.Force("load", top.at(0.25, 0), (0.1, -load)))
    stand = mbd.Mechanism(bodies=[lower, upper], joints=joints, forces=forces, inputs=[load])
    path = mbd.equilibrium_path(stand, load, 0, 30, steps=30)
    assert path.critical == () and np.all(path.stable)
    assert abs(path[upper.phi][-1] - np.pi / 2) > 0.5
    last = mbd.equilibrium(stand, path.states[-1], inputs={load: 30})
    assert last[upper.phi] == pytest.approx(path[upper.phi][-1], abs=1e-10)


@pytest.mark.slow
def test_truss_snaps_through_at_its_limit_points():
    push = mbd.Parameter("push", 0.0)
    apex, model = truss(push)
    path = mbd.equilibrium_path(model, push, 0, 30)
    free = np.hypot(1, 0.3)
    at = np.sqrt(free ** (2 / 3) - 1)  # where the load 2 k y (l0 / l - 1) is largest
    limit = 2 * 1000 * at * (free / np.hypot(1, at) - 1)
    assert [c.value for c in path.critical] == pytest.approx([limit, -limit], rel=1e-9)
    assert {c.kind for c in path.critical} == {"limit"}
    assert path.values[-1] == pytest.approx(30, abs=1e-9)
    y = path[apex.y]
    assert path.values == pytest.approx(2 * 1000 * y * (free / np.hypot(1, y) - 1), abs=1e-8)
    assert y[0] == pytest.approx(0.3) and y[-1] < -0.3
    assert np.array_equal(path.stable, np.abs(y) > at)


@pytest.mark.parametrize(
    ("change", "text"),
    [({"end": 0.0}, "nothing to follow"), ({"steps": 0}, "steps must be a whole number of at least 1")],
)
def test_bad_paths(change, text):
    push = mbd.Parameter("push", 0.0)
    _, model = truss(push)
    with pytest.raises(mbd.ModelError, match=text):
        mbd.equilibrium_path(model, push, **({"start": 0.0, "end": 1.0} | change))


def test_bad_arguments():
    p = pendulum()
    k = mbd.Parameter("k", 1.0)
    with pytest.raises(mbd.ModelError, match="prefer"):
        mbd.equilibrium(p.mechanism, prefer="lowest")
    with pytest.raises(mbd.ModelError, match="'k', which is not in the mechanism"):
        mbd.equilibrium(p.mechanism, unknowns=[k])
    with pytest.raises(mbd.ModelError, match="takes inputs and parameters"):
        mbd.equilibrium(p.mechanism, unknowns=[p.rod.phi])


# --- forces without potential, soft beside stiff, awkward starts -------------------------------
def loaded_links(follows):
    """Ziegler's column: masses 2 and 1 kg on links of 1 m, springs of 10 N m/rad; the load turns by a share."""
    push = mbd.Parameter("push", 0.0)
    lower = mbd.Body("lower", mass=2.0, inertia=0.0, pose=(0, 1, np.pi / 2))
    upper = mbd.Body("upper", mass=1.0, inertia=0.0, pose=(0, 2, np.pi / 2))
    base, elbow = (mbd.ground.at(0, 0, np.pi / 2), lower.at(-1, 0)), (lower.at(0, 0), upper.at(-1, 0))
    joints = [mbd.Revolute("base", *base), mbd.Revolute("elbow", *elbow)]
    turn = follows * (upper.phi - np.pi / 2)
    load = mbd.Force("load", upper.at(0, 0), (push * mbd.sin(turn), -push * mbd.cos(turn)))
    springs = [mbd.RSDA("low", *base, stiffness=10), mbd.RSDA("high", *elbow, stiffness=10)]
    return push, mbd.Mechanism(bodies=[lower, upper], joints=joints, forces=[*springs, load], parameters=[push])


@pytest.mark.slow
@pytest.mark.parametrize("follows", [1.0, 0.8, 0.5, 0.4, 0.2, 0.0])
def test_loads_that_follow_buckle_and_flutter(follows):
    """Against the roots of det K and of the discriminant of det(K - omega^2 M); Ziegler 1952 for follows = 1."""
    f, real = follows, lambda roots: sorted(r.real for r in roots if abs(r.imag) < 1e-9 and r.real < 40)
    wanted = [("bifurcation", v) for v in real(np.roots([1 - f, -30 * (1 - f), 100]))]
    wanted += [("flutter", v) for v in real(np.roots([(2 - f) ** 2 - 2 * (1 - f), 60 * (1 - f) - 70 * (2 - f), 1025]))]
    push, model = loaded_links(follows)
    found = [(c.kind, c.value) for c in mbd.equilibrium_path(model, push, 0, 40).critical]
    wanted = sorted(wanted) if f else [w for w in wanted if w[0] == "bifurcation"]  # of a dead load nothing flutters
    assert [kind for kind, _ in sorted(found)] == [kind for kind, _ in wanted]
    assert np.allclose([v for _, v in sorted(found)], [v for _, v in wanted], rtol=1e-7)
    if f == 1:
        assert found[0][1] == pytest.approx((3.5 - np.sqrt(2)) * 10, rel=1e-9)


@pytest.mark.slow
def test_what_flutters_is_not_stable_before_or_at_the_critical_value():
    push, model = loaded_links(1.0)
    path = mbd.equilibrium_path(model, push, 0, 40)
    assert np.array_equal(path.stable, path.values < (3.5 - np.sqrt(2)) * 10)
    assert not path.critical[0].state.stable and np.max(np.abs(path.critical[0].direction)) == 1


@pytest.mark.parametrize("stiff", [1e6, 1e9])
@pytest.mark.parametrize("prefer", ["stable", "nearest"])
def test_a_soft_spring_beside_a_stiff_one(stiff, prefer):
    blocks = [mbd.Body(f"block {k}", mass=1, inertia=0.1, pose=(k + 1, 0, 0)) for k in range(2)]
    slides = [mbd.Translational(f"slide {k}", mbd.ground.at(0, 0), b.at(0, 0)) for k, b in enumerate(blocks)]
    soft = mbd.TSDA("soft", mbd.ground.at(0, 0), blocks[0].at(0, 0), stiffness=1, free_length=1.5)
    hard = mbd.TSDA("hard", blocks[0].at(0, 0), blocks[1].at(0, 0), stiffness=stiff, free_length=1.1)
    rest = mbd.equilibrium(mbd.Mechanism(bodies=blocks, joints=slides, forces=[soft, hard]), prefer=prefer)
    assert rest[blocks[0].x] == pytest.approx(1.5, abs=1e-6) and rest.stable


def test_newtons_method_starts_where_the_stiffness_vanishes():
    tau = mbd.Input("tau")
    p = pendulum(0.0, forces=lambda rod: [mbd.Torque("motor", rod, tau)], inputs=[tau])
    rest = mbd.equilibrium(p.mechanism, prefer="nearest")
    assert abs(rest[p.rod.phi]) == pytest.approx(np.pi / 2)
    rest = mbd.equilibrium(p.mechanism, [tau == 1.5], unknowns=[tau])
    assert np.cos(rest[p.rod.phi]) == pytest.approx(1.5 / (G / 2))
    with pytest.raises(mbd.ModelError, match="unknowns= contains 'tau' twice"):
        mbd.equilibrium(p.mechanism, [tau == 1.5, p.rod.phi == 0], unknowns=[tau, tau])


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e3])
@pytest.mark.parametrize("per_square", [1e-6, 1e6])
def test_mechanisms_of_any_size_are_weighed_alike(size, per_square):
    rod = mbd.Body("rod", mass=1, inertia=size**2 / 12, pose=(size / 2, 0, 0))
    ends = mbd.ground.at(0, 0), rod.at(-size / 2, 0)
    spring = mbd.RSDA("spring", *ends, stiffness=per_square * size**2)
    model = mbd.Mechanism(bodies=[rod], joints=[mbd.Revolute("hinge", *ends)], forces=[spring])
    rest = mbd.equilibrium(model, [rod.phi == 0.5])
    assert rest.stable and abs(rest[rod.phi]) < 1e-9


def test_a_motor_without_voltage_rests_where_it_is():
    current = mbd.StateVariable("current", 0.1)
    rotor = mbd.Body("rotor", mass=1, inertia=0.02)
    model = mbd.Mechanism(
        bodies=[rotor],
        joints=[mbd.Revolute("hinge", mbd.ground.at(0, 0), rotor.at(0, 0))],
        forces=[mbd.Torque("motor", rotor, 0.3 * current - 0.01 * rotor.omega)],
        states={current: (-1.5 * current - 0.3 * rotor.omega) / 0.02},
    )
    rest = mbd.equilibrium(model)
    assert rest[current] == pytest.approx(0, abs=1e-12) and not rest.stable


# --- damping ------------------------------------------------------------------------------------
def ziegler(load, damping, stiffness=20.0, length=1.0, mass=1.0, inputs=()):
    """Ziegler's column: masses 2 m and m at the ends of two rods, springs and dampers in both joints."""
    lower = mbd.Body("lower", mass=2 * mass, inertia=0.0, pose=(0, length, np.pi / 2))
    upper = mbd.Body("upper", mass=mass, inertia=0.0, pose=(0, 2 * length, np.pi / 2))
    base = mbd.ground.at(0, 0), lower.at(-length, 0)
    elbow = lower.at(0, 0), upper.at(-length, 0)
    forces = [
        mbd.RSDA("base spring", *base, stiffness=stiffness, damping=damping, free_angle=np.pi / 2),
        mbd.RSDA("elbow spring", *elbow, stiffness=stiffness, damping=damping),
        mbd.Force("follower", upper.at(0, 0), (-load, 0), frame="body"),
    ]
    joints = [mbd.Revolute("base", *base), mbd.Revolute("elbow", *elbow)]
    return lower, upper, mbd.Mechanism(bodies=[lower, upper], joints=joints, forces=forces, parameters=inputs)


@pytest.mark.slow
@pytest.mark.parametrize("damping", [0.0, 0.001, 0.2, 2.0])
def test_damping_lowers_the_flutter_load(damping):
    """Ziegler 1952: P = 41/28 k/l + c²/(2 m l³) with however little damping, and (7/2 - √2) k/l without any."""
    load = mbd.Parameter("load", 0.0)
    _, _, column = ziegler(load, damping, inputs=[load])
    path = mbd.equilibrium_path(column, load, 0, 50, steps=25)
    flutter = [c for c in path.critical if c.kind == "flutter"]
    wanted = 20 * 41 / 28 + damping**2 / 2 if damping else 20 * (3.5 - np.sqrt(2))
    assert flutter[0].value == pytest.approx(wanted, rel=1e-6)
    assert np.array_equal(path.stable, path.values < wanted)


@pytest.mark.parametrize(("load", "grows"), [(28.0, False), (34.0, True)])
def test_equilibrium_says_what_linearize_and_the_motion_say(load, grows):
    lower, upper, column = ziegler(load, 0.2)
    rest = mbd.equilibrium(column, prefer="nearest")
    assert rest.stable is not grows
    assert ("small motions grow" in repr(rest)) is grows
    wanted = np.sort_complex(mbd.linearize(column, rest).eigenvalues)
    np.testing.assert_allclose(np.sort_complex(rest.small_motions.eigenvalues), wanted, rtol=1e-9)
    begin = [lower.phi == np.pi / 2 + 1e-3, upper.phi == np.pi / 2, lower.omega == 0, upper.omega == 0]
    motion = mbd.simulate(column, np.linspace(0, 60, 601), initial=begin)
    away = np.abs(motion[lower.phi] - np.pi / 2)
    assert bool(away[400:].max() > away[200:400].max()) is grows


def test_negative_damping_is_not_stable():
    """A block on a belt with falling friction: the spring holds it, and yet it starts to swing."""
    for damping in (0.1, -0.1):
        block = mbd.Body("block", mass=1, inertia=1)
        rail = mbd.Translational("rail", mbd.ground.at(0, 0), block.at(0, 0))
        spring = mbd.TSDA("spring", mbd.ground.at(-1, 0), block.at(0, 0), stiffness=4.0, free_length=1.0)
        belt = mbd.Force("belt", block.at(0, 0), (-damping * block.vx, 0))
        rest = mbd.equilibrium(mbd.Mechanism(bodies=[block], joints=[rail], forces=[spring, belt]))
        assert rest.stable is (damping > 0)
        assert rest.small_motions.flutter is (damping < 0)
        np.testing.assert_allclose(np.abs(rest.small_motions.eigenvalues), 2.0, rtol=1e-12)


def test_small_motions_of_random_systems_are_those_of_the_linear_model():
    """Springs, dampers, feedback through a lagging state, loads that follow: four rods in a chain."""
    for seed in range(6):
        generator = np.random.default_rng(seed)
        rods = [
            mbd.Body(f"rod {k}", mass=m, inertia=m / 12, pose=(k + 0.5, 0, 0))
            for k, m in enumerate(generator.uniform(0.5, 2, 4))
        ]
        ends = [mbd.ground.at(0, 0), *[rod.at(0.5, 0) for rod in rods[:-1]]]
        joints = [mbd.Revolute(f"pin {k}", a, b.at(-0.5, 0)) for k, (a, b) in enumerate(zip(ends, rods, strict=True))]
        springs = [
            mbd.RSDA(f"spring {k}", j.a, j.b, stiffness=generator.uniform(20, 60), damping=generator.uniform(0, 2))
            for k, j in enumerate(joints)
        ]
        lag = mbd.StateVariable("lag")
        forces = [
            *springs,
            mbd.Gravity((0, -0.5)),
            mbd.Force("follower", rods[-1].at(0.5, 0), (-generator.uniform(0, 5), 0), frame="body"),
            mbd.Torque("valve", rods[0], lag),
        ]
        states = {lag: -generator.uniform(1, 5) * lag - 3 * rods[0].phi + 0.4 * rods[1].omega}
        model = mbd.Mechanism(bodies=rods, joints=joints, forces=forces, states=states)
        rest = mbd.equilibrium(model, prefer="nearest")
        wanted = np.sort_complex(mbd.linearize(model, rest).eigenvalues)
        np.testing.assert_allclose(np.sort_complex(rest.small_motions.eigenvalues), wanted, rtol=1e-7)


def test_a_model_without_any_mass_is_judged_by_its_springs():
    for stiffness in (3.0, -3.0):
        rod = mbd.Body("rod", mass=0.0, inertia=0.0, pose=(0.5, 0, 0))
        hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), rod.at(-0.5, 0))
        spring = mbd.Torque("spring", rod, -stiffness * rod.phi)
        rest = mbd.equilibrium(mbd.Mechanism(bodies=[rod], joints=[hinge], forces=[spring]), prefer="nearest")
        assert rest.stable is (stiffness > 0)


@pytest.mark.slow
def test_smoothed_friction_on_an_incline_is_named():
    """It creeps: there is no state at rest, and no body falls."""
    block = mbd.Body("block", mass=1, inertia=0.1)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0, -0.3), block.at(0, 0, 0))
    rub = mbd.JointFriction("rub", guide, mbd.Coulomb(0.5, 1e-3))
    model = mbd.Mechanism([block], [guide], forces=[mbd.Gravity(), rub])
    with pytest.raises(mbd.EquilibriumError, match=r"smoothed friction \(friction 'rub'\) gives way.*DryFriction"):
        mbd.equilibrium(model)


def series(initial=0.0):
    """A mass on a guide that hangs on a spring and, beside it, a spring in series with a dashpot that is shut."""
    mass = mbd.Body("mass", 10.0, 1.0)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0, angle=np.pi / 2), mass.at(0, 0, angle=np.pi / 2))
    force = mbd.StateVariable("series", initial)
    strut = mbd.GeneralizedForce("strut", [(mass.y, -force - 200 * mass.vy - 100 * mass.y)])
    states = {force: 1e3 * mass.vy}
    return mass, force, mbd.Mechanism([mass], joints=[guide], forces=[mbd.Gravity(), strut], states=states)


def test_a_spring_in_series_remembers_where_it_was():
    mass, force, model = series(initial=20.0)
    rest = mbd.equilibrium(model, [mass.y == 0.01])
    assert rest[mass.y] == pytest.approx((1e3 * 0.01 - 20 - 98.1) / 1100, abs=1e-12)
    assert rest[force] == pytest.approx(20 + 1e3 * (rest[mass.y] - 0.01), abs=1e-9)
    assert rest.stable and rest.stiffness.least == pytest.approx(1100, rel=1e-12)
    wanted = np.sort_complex(mbd.linearize(model, rest).eigenvalues)
    np.testing.assert_allclose(np.sort_complex(rest.small_motions.eigenvalues), wanted, atol=1e-9)


def test_a_path_keeps_the_memory_of_its_start():
    load = mbd.Parameter("load", 0.0)
    mass, _, model = series()
    push = mbd.Force("push", mass.at(0, 0), (0, -load))
    path = mbd.equilibrium_path(model.replace(forces=[*model.forces, push], parameters=[load]), load, 0, 50, steps=5)
    np.testing.assert_allclose(path[mass.y], -(98.1 + path.values) / 1100, rtol=1e-10)


def test_a_boom_on_trapped_oil_does_not_sink():
    area, volume, modulus = 2e-3, 2e-3, 1.5e9
    boom, pressure = mbd.Body("boom", 200, 100, pose=(1.5, 0, 0)), mbd.StateVariable("pressure")
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), boom.at(-1.5, 0))
    cylinder = mbd.TSDA("cylinder", mbd.ground.at(0.3, -1), boom.at(-0.5, 0), actuator=-area * pressure)
    first = np.hypot(0.7, 1.0)
    states = {pressure: -modulus * area * cylinder.rate / (volume + area * (cylinder.length - first))}
    rest = mbd.equilibrium(mbd.Mechanism([boom], joints=[pin], forces=[mbd.Gravity(), cylinder], states=states))

    def moment(angle):
        head = np.array([np.cos(angle), np.sin(angle)])
        along = head - [0.3, -1]
        length = np.hypot(*along)
        force = -modulus * np.log1p(area * (length - first) / volume) * area * along / length
        return head[0] * force[1] - head[1] * force[0] - 200 * 9.81 * 1.5 * head[0]

    assert rest[boom.phi] == pytest.approx(brentq(moment, -0.1, 0.1, xtol=1e-15), abs=1e-12) and rest.stable


def test_a_memory_of_the_way_itself_is_told_by_its_state():
    mass, force, model = series()
    with pytest.warns(mbd.MechanismWarning, match="state variable series remembers the course"):
        mbd.equilibrium(model.replace(states={force: 10 * mbd.fabs(mass.vy)}), [mass.y == 0.1])
    odometer = mbd.StateVariable("odometer")  # on which nothing depends
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        mbd.equilibrium(model.replace(states={force: 1e3 * mass.vy, odometer: mass.vy**2}))


def test_a_leak_between_chambers_forgets_what_a_change_of_volume_was():
    mass = mbd.Body("mass", 10.0, 1.0)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0, angle=np.pi / 2), mass.at(0, 0, angle=np.pi / 2))
    below, above = mbd.StateVariable("below"), mbd.StateVariable("above")
    flow = 1e-3 * mass.vy - 1e-9 * (below - above)
    states = {below: 1e8 / (1e-3 - 1e-3 * mass.y) * flow, above: -1e8 / 1e-3 * flow}
    strut = mbd.GeneralizedForce("strut", [(mass.y, -1e-3 * (below - 0.5 * above) - 50 * mass.y)])
    with pytest.warns(mbd.MechanismWarning, match="state variables below, above remember"):
        mbd.equilibrium(mbd.Mechanism([mass], joints=[guide], forces=[mbd.Gravity(), strut], states=states))


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e4])
def test_a_linkage_without_any_load_rests_where_it_is(size):
    crank, coupler, rocker = (
        mbd.Body(f"body at {x}", 1.0, 0.1 * size**2, pose=(x * size, 0, 0)) for x in (0.15, 0.8, 1.15)
    )
    arm, bar = 0.15 * size, 0.5 * size
    ends = [
        (mbd.ground.at(0, 0), crank.at(-arm, 0)),
        (crank.at(arm, 0), coupler.at(-bar, 0)),
        (coupler.at(bar, 0), rocker.at(arm, 0)),
        (mbd.ground.at(size, 0), rocker.at(-arm, 0)),
    ]
    joints = [mbd.Revolute(f"pin {k}", *pair) for k, pair in enumerate(ends)]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", "equilibrium: the pose is singular", mbd.MechanismWarning)
        rest = mbd.equilibrium(mbd.Mechanism([crank, rocker, coupler], joints=joints))
    assert not np.any(rest.lam) and not rest.stable


@pytest.mark.slow
@pytest.mark.parametrize("links", [3, 12])
def test_points_of_a_smooth_path_do_not_grow_with_the_number_of_bodies(links):
    load, length = mbd.Parameter("load", 0.0), 1 / links
    rods = [mbd.Body(f"rod {k}", 0.0, 0.0, pose=((k + 0.5) * length, 0, 0)) for k in range(links)]
    ends = [mbd.ground.at(0, 0), *[rod.at(length / 2, 0) for rod in rods]]
    pins = [mbd.Revolute(f"pin {k}", ends[k], rod.at(-length / 2, 0)) for k, rod in enumerate(rods)]
    springs = [mbd.RSDA(f"spring {k}", pin.a, pin.b, stiffness=links * (1 if k else 2)) for k, pin in enumerate(pins)]
    push = mbd.Force("push", ends[-1], (0, -load))
    model = mbd.Mechanism(rods, joints=pins, forces=[*springs, push], parameters=[load])
    path = mbd.equilibrium_path(model, load, 0, 10, steps=20)

    def moments(angles):  # of the springs, and of the load over the rest of the chain
        bent, arms = np.diff(angles, prepend=0.0), length * np.cumsum(np.cos(angles)[::-1])[::-1]
        return links * np.r_[2.0, np.ones(links - 1)] * bent + 10 * arms

    tip = length * np.sum(np.sin(fsolve(moments, np.linspace(-0.5, -1, links), xtol=1e-13)))
    assert path[ends[-1].y][-1] == pytest.approx(tip, abs=1e-6) and 20 <= len(path) <= 40


def test_rates_that_hold_an_unknown_must_vanish():
    """A tank that empties at the rate of the input that is looked for is not at rest; one that a servo follows is."""
    level, push = mbd.StateVariable("level", 1.0), mbd.Input("push")
    block = mbd.Body("block", 1.0, 1.0)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), block.at(0, 0))
    force = mbd.Force("force", block.at(0, 0), (push - 9.81, 0))
    tank = mbd.Mechanism([block], [rail], forces=[force], inputs=[push], states={level: -push})
    with pytest.raises(mbd.EquilibriumError, match="no state at rest was found"):
        mbd.equilibrium(tank, [block.x == 0], unknowns=[push])
    place, speed = mbd.StateVariable("place", 0.3), mbd.StateVariable("speed")
    drive = mbd.Driver("servo", block.x, place)
    servo = mbd.Mechanism([block], [rail], [drive], inputs=[push], states={place: speed, speed: push})
    rest = mbd.equilibrium(servo, [block.x == 0.5], unknowns=[push])
    assert (rest[place], rest[speed], rest[push]) == pytest.approx((0.5, 0, 0), abs=1e-12)
