"""Linear models and modes against closed forms and differences of the equations themselves."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from linkages import G, four_bar, pendulum, welded_beams

import mbdcasadi as mbd


def hanging_rods(count, length=0.7, mass=1.2):
    """Chain of uniform rods that hang down."""
    rods = [
        mbd.Body(f"rod {k}", mass=mass, inertia=mass * length**2 / 12, pose=(0, -(k + 0.5) * length, -np.pi / 2))
        for k in range(count)
    ]
    ends = [mbd.ground.at(0, 0), *(rod.at(length / 2, 0) for rod in rods)]
    joints = [mbd.Revolute(f"pin {k}", ends[k], rod.at(-length / 2, 0)) for k, rod in enumerate(rods)]
    return rods, mbd.Mechanism(bodies=rods, joints=joints, forces=[mbd.Gravity()])


def hanging_masses(count, length=0.5, mass=0.8):
    """Point masses on massless rods."""
    rods = [mbd.Body(f"bob {k}", mass=mass, inertia=0.0, pose=(0, -(k + 1) * length, -np.pi / 2)) for k in range(count)]
    ends = [mbd.ground.at(0, 0), *(rod.at(0, 0) for rod in rods)]
    joints = [mbd.Revolute(f"pin {k}", ends[k], rod.at(-length, 0)) for k, rod in enumerate(rods)]
    return rods, mbd.Mechanism(bodies=rods, joints=joints, forces=[mbd.Gravity()])


def rates(model):
    return np.array([2 * np.pi * mode.frequency for mode in model.modes()])


# --- frequencies in closed form -----------------------------------------------------------
def test_two_rods():
    _, chain = hanging_rods(2)
    model = mbd.linearize(chain, mbd.equilibrium(chain))
    expected = np.sqrt(3 * (1 + np.array([-1, 1]) * 2 / np.sqrt(7)) * G / 0.7)
    assert rates(model) == pytest.approx(expected, rel=1e-11)


def test_three_rods_against_lagrange():
    _, chain = hanging_rods(3)
    # absolute angles: M_ij and K_i of equal uniform rods (Lagrange), in units of m l² and m g l
    inertia = np.array([[7 / 3, 3 / 2, 1 / 2], [3 / 2, 4 / 3, 1 / 2], [1 / 2, 1 / 2, 1 / 3]])
    squares = np.linalg.eigvals(np.linalg.solve(inertia, np.diag([5 / 2, 3 / 2, 1 / 2]))) * G / 0.7
    model = mbd.linearize(chain, mbd.equilibrium(chain))
    assert rates(model) == pytest.approx(np.sqrt(np.sort(squares)), rel=1e-11)


@pytest.mark.parametrize("count", [2, 3])
def test_masses_on_a_string_have_the_zeros_of_laguerre(count):
    """Small swings of n equal masses on a string: omega² l / g are the zeros of the Laguerre polynomial L_n."""
    _, chain = hanging_masses(count)
    zeros = np.polynomial.laguerre.lagroots([0] * count + [1])
    model = mbd.linearize(chain, mbd.equilibrium(chain))
    assert rates(model) == pytest.approx(np.sqrt(np.sort(zeros) * G / 0.5), rel=1e-10)


def test_acrobot_about_its_upright_pose():
    """Matrices of Spong's acrobot with damped joints, m, l, lc, J and b as in Drake's examples."""
    m1, m2, l1, lc1, lc2, j1, j2, b1, b2 = 1.0, 1.0, 1.0, 0.5, 1.0, 0.083, 0.33, 0.1, 0.1
    tau = mbd.Input("tau")
    upper = mbd.Body("upper", mass=m1, inertia=j1, pose=(0, lc1, np.pi / 2))
    lower = mbd.Body("lower", mass=m2, inertia=j2, pose=(0, l1 + lc2, np.pi / 2))
    shoulder = mbd.Revolute("shoulder", mbd.ground.at(0, 0), upper.at(-lc1, 0))
    elbow = mbd.Revolute("elbow", upper.at(l1 - lc1, 0), lower.at(-lc2, 0))
    forces = [
        mbd.Gravity(),
        mbd.RSDA("shoulder damper", mbd.ground.at(0, 0), upper.at(-lc1, 0), damping=b1),
        mbd.RSDA("elbow damper", upper.at(l1 - lc1, 0), lower.at(-lc2, 0), damping=b2),
        mbd.Torque("motor", lower, tau, opposite=upper),
    ]
    robot = mbd.Mechanism(bodies=[upper, lower], joints=[shoulder, elbow], forces=forces, inputs=[tau])
    up = mbd.equilibrium(robot, prefer="nearest")
    model = mbd.linearize(
        robot, up, wrt=[tau], outputs={"elbow": elbow.angle}, coordinates=[shoulder.angle, elbow.angle]
    )
    far = j2 + m2 * lc2**2
    inertia = np.array([[j1 + m1 * lc1**2 + far + m2 * l1**2 + 2 * m2 * l1 * lc2, far + m2 * l1 * lc2], [0, far]])
    inertia[1, 0] = inertia[0, 1]
    weight = -G * np.array([[m1 * lc1 + m2 * (l1 + lc2), m2 * lc2], [m2 * lc2, m2 * lc2]])
    lower_rows = np.hstack([-np.linalg.solve(inertia, weight), -np.linalg.solve(inertia, np.diag([b1, b2]))])
    assert model.A == pytest.approx(np.vstack([np.eye(4)[2:], lower_rows]), abs=1e-10)
    assert model.B[:, 0] == pytest.approx(np.r_[0, 0, np.linalg.solve(inertia, [0, 1])], abs=1e-11)
    assert model.C == pytest.approx(np.array([[0, 1, 0, 0]]), abs=1e-12)
    assert model.output_names == ("elbow",) and model.input_names == ("tau",)


def test_damped_lever_has_the_roots_of_its_polynomial():
    p = pendulum(
        angle=-np.pi / 2, forces=lambda rod: [mbd.RSDA("hinge", mbd.ground.at(0, 0), rod.at(-0.5, 0), damping=0.4)]
    )
    mode = mbd.linearize(p.mechanism, mbd.equilibrium(p.mechanism)).modes()[0]
    natural = np.sqrt(1.5 * G)
    assert mode.frequency == pytest.approx(natural / (2 * np.pi), rel=1e-12)
    assert mode.damping_ratio == pytest.approx(0.4 * 3 / (2 * natural), rel=1e-11)


def test_blade_on_a_turning_disc_is_stiffened_by_its_reaction():
    """Lagging of a blade pinned at radius R of a disc at speed W: omega² = W² m R h / J (no gravity)."""
    speed, radius, length, mass = 12.0, 0.4, 0.9, 2.0
    disc = mbd.Body("disc", mass=5.0, inertia=1.0, velocity=(0, 0, speed))
    blade = mbd.Body(
        "blade",
        mass=mass,
        inertia=mass * length**2 / 12,
        pose=(radius + length / 2, 0, 0),
        velocity=(0, speed * (radius + length / 2), speed),
    )
    axle = mbd.Revolute("axle", mbd.ground.at(0, 0), disc.at(0, 0))
    pin = mbd.Revolute("pin", disc.at(radius, 0), blade.at(-length / 2, 0))
    drive = mbd.Driver("drive", axle.angle, speed * mbd.t)
    rotor = mbd.Mechanism(bodies=[disc, blade], joints=[axle, pin], drivers=[drive])
    model = mbd.linearize(rotor, mbd.assemble(rotor, [pin.angle == 0, blade.omega == speed]))
    assert model.is_steady
    expected = speed * np.sqrt(mass * radius * length / 2 / (mass * length**2 / 3))
    assert rates(model) == pytest.approx([expected], rel=1e-10)


def test_bead_in_a_slot_of_a_turntable_is_steady_in_the_coordinate_that_turns_with_it():
    """omega² = k/m - W². At the centre the global x and its rate do not change either, but A in them does."""
    speed, stiffness, mass = 3.0, 25.0, 1.0
    table = mbd.Body("table", mass=1.0, inertia=1.0)
    bead = mbd.Body("bead", mass=mass, inertia=0.0)
    axle = mbd.Revolute("axle", mbd.ground.at(0, 0), table.at(0, 0))
    slot = mbd.Translational("slot", table.at(0, 0), bead.at(0, 0))
    spring = mbd.TSDA("spring", table.at(-1, 0), bead.at(0, 0), stiffness=stiffness, free_length=1.0)
    drive = mbd.Driver("drive", axle.angle, speed * mbd.t)
    turning = mbd.Mechanism([table, bead], joints=[axle, slot], drivers=[drive], forces=[spring])
    state = mbd.assemble(turning, [slot.displacement == 0, slot.speed == 0])
    with pytest.warns(mbd.MechanismWarning, match="coordinates= that stay constant and turn with it"):
        mbd.linearize(turning, state).modes()
    model = mbd.linearize(turning, state, coordinates=[slot.displacement])
    assert model.is_steady
    assert rates(model) == pytest.approx([np.sqrt(stiffness / mass - speed**2)], rel=1e-10)


def test_a_stiffness_that_changes_in_time_has_no_modes():
    """A mass at rest on a spring whose stiffness swings: Mathieu's equation, for which stability is asked."""
    mass = mbd.Body("mass", mass=1.0, inertia=1.0)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), mass.at(0, 0))
    pull = mbd.Force("spring", mass.at(0, 0), (-(4 + mbd.sin(4 * mbd.t)) * mass.x, 0))
    model = mbd.linearize(swing := mbd.Mechanism([mass], joints=[rail], forces=[pull]), mbd.assemble(swing))
    with pytest.warns(mbd.MechanismWarning, match="the forces depend on time"):
        model.modes()


def test_free_masses_have_a_rigid_body_mode():
    blocks = [mbd.Body(f"block {k}", mass=3.0, inertia=1.0, pose=(k, 0, 0)) for k in range(2)]
    guides = [mbd.Translational(f"guide {k}", mbd.ground.at(0, 0), b.at(0, 0)) for k, b in enumerate(blocks)]
    spring = mbd.TSDA("spring", blocks[0].at(0, 0), blocks[1].at(0, 0), stiffness=600, free_length=1)
    train = mbd.Mechanism(bodies=blocks, joints=guides, forces=[spring])
    modes = mbd.linearize(train, mbd.assemble(train)).modes()
    assert [mode.frequency for mode in modes] == pytest.approx([0, np.sqrt(2 * 600 / 3) / (2 * np.pi)], rel=1e-12)
    assert modes[0].shape[[0, 3]] == pytest.approx([1, 1], abs=1e-12)
    assert modes[1].shape[0] == pytest.approx(-modes[1].shape[3], abs=1e-12)


def test_motor_with_a_current_is_a_first_order_state():
    r, inductance, k, inertia = 0.5, 0.02, 0.3, 0.01
    voltage = mbd.Input("voltage")
    current = mbd.StateVariable("current")
    rotor = mbd.Body("rotor", mass=1.0, inertia=inertia)
    axle = mbd.Revolute("axle", mbd.ground.at(0, 0), rotor.at(0, 0))
    motor = mbd.Mechanism(
        bodies=[rotor],
        joints=[axle],
        forces=[mbd.Torque("motor", rotor, k * current)],
        inputs=[voltage],
        states={current: (voltage - r * current - k * rotor.omega) / inductance},
    )
    model = mbd.linearize(motor, mbd.assemble(motor), wrt=[voltage], outputs=[rotor.omega, current])
    assert model.state_names == ("rotor.phi", "rotor.omega", "current")
    s = 3.0 + 4.0j
    over = inductance * inertia * s**2 + r * inertia * s + k**2
    assert model.transfer_function(s)[:, 0] == pytest.approx([k / over, inertia * s / over], rel=1e-12)
    response = model.frequency_response([1.0, 5.0])
    assert response.shape == (2, 2, 1)
    assert response[1] == pytest.approx(model.transfer_function(2j * np.pi * 5.0), rel=1e-13)


# --- against differences -------------------------------------------------------------------
def test_four_bar_on_the_move_against_differences():
    """All of A, B, C, D at a state in motion, with a length, a spring and a torque in B."""
    tau = mbd.Input("tau", value=0.7)
    stiffness, offset = mbd.Parameter("stiffness", 40.0), mbd.Parameter("offset", 0.03)

    def forces(f):
        # an eccentric anchor: the parameter moves a point of the linkage
        return [
            mbd.Gravity(),
            mbd.Torque("motor", f.crank, tau),
            mbd.TSDA(
                "spring",
                f.coupler.at(offset, 0.1),
                mbd.ground.at(0.3, 0.6),
                stiffness=stiffness,
                free_length=0.1,
                damping=2,
            ),
        ]

    f = four_bar(1.1, forces=forces, inputs=[tau], parameters=[stiffness, offset])
    w, rate, reaction = f.crank.phi, f.crank.omega, f.C.reaction_on(f.rocker).force
    base = np.array([1.1, 2.5, 0.7, 40.0, 0.03])

    def at(x):
        given = {"inputs": {tau: x[2]}, "parameters": {stiffness: x[3], offset: x[4]}}
        state = mbd.assemble(f.mechanism, [w == x[0], rate == x[1]], **given)
        return state, np.r_[state[rate], state[f.crank.alpha], state[reaction], state[f.rocker.omega]]

    model = mbd.linearize(
        f.mechanism,
        at(base)[0],
        wrt=[tau, stiffness, offset],
        outputs={"C": reaction, "rocker": f.rocker.omega},
        coordinates=[w],
    )
    assert model.output_names == ("C.x", "C.y", "rocker")
    found = np.block([[model.A, model.B], [model.C, model.D]])
    for k, step in enumerate((1e-5, 1e-5, 1e-3, 1e-2, 1e-5)):
        shift = np.eye(5)[k] * step
        difference = (at(base + shift)[1] - at(base - shift)[1]) / (2 * step)
        assert found[:, k] == pytest.approx(difference, rel=2e-7, abs=2e-6), k
    with pytest.warns(mbd.MechanismWarning, match="neither an equilibrium nor in steady motion"):
        model.modes()


def test_a_link_that_changes_its_length_moves_the_dependent_coordinates():
    reach = mbd.Parameter("reach", 0.5)
    rod = mbd.Body("rod", mass=1.0, inertia=0.1, pose=(0, -0.5, -np.pi / 2))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), rod.at(-reach, 0))
    swing = mbd.Mechanism(bodies=[rod], joints=[pin], forces=[mbd.Gravity()], parameters=[reach])
    model = mbd.linearize(swing, mbd.equilibrium(swing), wrt=[reach], outputs=[rod.y, pin.reaction_on(rod).force])
    assert model.D[:, 0] == pytest.approx([-1, 0, 0], abs=1e-12)


def test_feedback_closes_the_loop():
    tau = mbd.Input("tau")
    p = pendulum(angle=-np.pi / 2, forces=lambda rod: [mbd.Torque("motor", rod, tau)], inputs=[tau])
    rest = mbd.equilibrium(p.mechanism)
    open_loop = mbd.linearize(p.mechanism, rest, wrt=[tau])
    gains = np.array([2.0, 0.3])
    law = -gains[0] * (p.rod.phi + np.pi / 2) - gains[1] * p.rod.omega
    closed = mbd.linearize(p.mechanism, rest, inputs={tau: law})
    assert closed.A == pytest.approx(open_loop.A - np.outer(open_loop.B, gains), abs=1e-12)
    with pytest.raises(mbd.ModelError, match="'tau' is given by feedback"):
        mbd.linearize(p.mechanism, rest, inputs={tau: law}, wrt=[tau])


def test_redundant_rows_do_not_matter():
    f = four_bar(0.9, forces=[mbd.Gravity()])
    doubled = f.mechanism.replace(
        joints=[*f.mechanism.joints, mbd.Revolute("again", f.crank.at(0.1, 0), f.coupler.at(-0.25, 0))]
    )
    one, two = (mbd.linearize(m, mbd.equilibrium(m)) for m in (f.mechanism, doubled))
    assert two.A == pytest.approx(one.A, abs=1e-9)


# --- shapes ----------------------------------------------------------------------------------
def test_shape_moves_along_the_constraints_and_animates():
    rods, chain = hanging_rods(3)
    model = mbd.linearize(chain, mbd.equilibrium(chain))
    eom = mbd.equations(chain)
    for mode in model.modes():
        assert mode.shape.shape == (9,) and np.max(np.abs(mode.shape)) == pytest.approx(1)
        assert model.state[eom.Phi_q] @ mode.shape == pytest.approx(0, abs=1e-11)
        motion = mode.motion(amplitude=0.2, periods=2, frames=41)
        assert motion.drift.position < 1e-12 and motion.drift.velocity < 1e-11
        assert motion.t[-1] == pytest.approx(2 / mode.frequency)
        assert motion[rods[2].phi][0] == pytest.approx(motion[rods[2].phi][-1], abs=1e-9)
    # a small motion in a mode is a motion of the mechanism: simulate it
    mode = model.modes()[0]
    small = mode.motion(amplitude=1e-5, frames=21)
    real = mbd.simulate(chain, small.t, initial=small.initial, reltol=1e-12, abstol=1e-14)
    assert real.q == pytest.approx(small.q, abs=1e-9)
    assert mode.at(np.pi, 1e-4)[rods[0].phi] == pytest.approx(-np.pi / 2 - 1e-4 * mode.shape[2].real, abs=1e-9)


@pytest.mark.slow
def test_hand_over():
    signal = pytest.importorskip("scipy.signal")
    p = pendulum(angle=-np.pi / 2)
    tau = mbd.Input("tau")
    driven = p.mechanism.replace(forces=[mbd.Gravity(), mbd.Torque("motor", p.rod, tau)], inputs=[tau])
    model = mbd.linearize(driven, mbd.equilibrium(driven), wrt=[tau], outputs={"angle": p.rod.phi})
    system = model.to_scipy()
    assert isinstance(system, signal.StateSpace)
    numerator, denominator = signal.ss2tf(system.A, system.B, system.C, system.D)
    assert denominator == pytest.approx([1, 0, 1.5 * G]) and numerator[0] == pytest.approx([0, 0, 3], abs=1e-9)
    control = pytest.importorskip("control")
    system = model.to_control()
    assert isinstance(system, control.StateSpace)
    assert system.input_labels == ["tau"] and system.output_labels == ["angle"]
    assert system.state_labels == ["rod_phi", "rod_omega"]


# --- what is refused -------------------------------------------------------------------------
def test_bad_arguments():
    f = four_bar(0.9)
    state = mbd.assemble(f.mechanism)
    with pytest.raises(mbd.ModelError, match="takes a State.* a periodic motion is linearised by stability"):
        mbd.linearize(f.mechanism, [f.crank.phi == 0])
    with pytest.raises(mbd.ModelError, match="holds 2 expressions, and the mechanism has 1 degrees of freedom"):
        mbd.linearize(f.mechanism, state, coordinates=[f.crank.phi, f.rocker.phi])
    with pytest.raises(mbd.ExpressionError, match="must be an expression in positions"):
        mbd.linearize(f.mechanism, state, coordinates=[f.crank.omega])
    with pytest.raises(mbd.MechanismError, match="do not fix every position"):
        mbd.linearize(f.mechanism, state, coordinates=[f.D.angle - f.rocker.phi])
    with pytest.raises(mbd.ModelError, match="'k', which is not in the mechanism"):
        mbd.linearize(f.mechanism, state, wrt=[mbd.Parameter("k", 1.0)])


def test_symbols_named_twice_or_foreign_are_refused():
    tau = mbd.Input("tau")
    p = pendulum(-1.5, forces=lambda rod: [mbd.Torque("motor", rod, tau)], inputs=[tau])
    rest = mbd.equilibrium(p.mechanism)
    with pytest.raises(mbd.ModelError, match="wrt= contains 'tau' twice"):
        mbd.linearize(p.mechanism, rest, wrt=[tau, tau])
    with pytest.raises(mbd.ExpressionError, match="'other', which the mechanism does not have"):
        mbd.linearize(p.mechanism, rest, outputs=[mbd.Input("other")])
    model = mbd.linearize(p.mechanism, rest, wrt=[tau], outputs=[p.rod.phi])
    for bad in ("a", np.nan, [[1.0]], None):
        with pytest.raises(mbd.MechanismError, match="s must be a finite number"):
            model.transfer_function(bad)
        with pytest.raises(mbd.MechanismError, match="frequencies must be a finite number"):
            model.frequency_response(bad)


def equal_slider_crank():
    """Crank and rod of the same length, the slider at the crank's pin: it may slide, or stay while both turn."""
    crank = mbd.Body("crank", 1, 0.1, pose=(0, 0.5, np.pi / 2))
    rod = mbd.Body("rod", 1, 0.1, pose=(0, 0.5, -np.pi / 2))
    slider = mbd.Body("slider", 1, 0.1, pose=(0, 0, 0))
    joints = [
        mbd.Revolute("main", mbd.ground.at(0, 0), crank.at(-0.5, 0)),
        mbd.Revolute("pin", crank.at(0.5, 0), rod.at(-0.5, 0)),
        mbd.Revolute("wrist", rod.at(0.5, 0), slider.at(0, 0)),
        mbd.Translational("guide", mbd.ground.at(0, 0), slider.at(0, 0)),
    ]
    return crank, rod, slider, mbd.Mechanism([crank, rod, slider], joints=joints, forces=[mbd.Gravity()])


def test_a_linear_model_in_a_bifurcation_is_reported_and_one_with_redundant_rows_is_not(recwarn):
    *_, mechanism = equal_slider_crank()
    with pytest.warns(mbd.MechanismWarning, match=r"linearize: at t = 0 s the pose is singular, a bifurcation"):
        mbd.linearize(mechanism, mbd.assemble(mechanism))
    rods, twice = hanging_rods(1)
    twice = twice.replace(joints=[*twice.joints, mbd.Revolute("again", mbd.ground.at(0, 0), rods[0].at(-0.35, 0))])
    recwarn.clear()
    mbd.linearize(twice, mbd.equilibrium(twice))
    assert not recwarn.list


@pytest.mark.parametrize("length, mass, time", [(1e-6, 1e-12, 1e-4), (1e-6, 1e-9, 1e-3), (100.0, 1e6, 10.0)])
def test_modes_do_not_depend_on_the_units(length, mass, time):
    """A double pendulum in units of any size: Phi_q has entries of one beside masses of 1e-12 and inertias of 1e-24."""
    force = mass * length / time**2

    def pendulum(unit_length, unit_mass, unit_time):
        arms = [
            mbd.Body(
                f"arm {k}", unit_mass, unit_mass * unit_length**2 / 12, pose=(0, -(k + 0.5) * unit_length, -np.pi / 2)
            )
            for k in range(2)
        ]
        half = unit_length / 2
        hinges = [
            mbd.Revolute("hinge", mbd.ground.at(0, 0), arms[0].at(-half, 0)),
            mbd.Revolute("elbow", arms[0].at(half, 0), arms[1].at(-half, 0)),
        ]
        weight = mbd.Gravity((0, -9.81 * unit_length / unit_time**2))
        return mbd.Mechanism(arms, joints=hinges, forces=[weight]), hinges[1].reaction_on(arms[1]).force

    small, load = pendulum(length, mass, time)
    model = mbd.linearize(small, mbd.equilibrium(small), outputs={"load": load})
    reference_pendulum, reference_load = pendulum(1.0, 1.0, 1.0)
    reference = mbd.linearize(reference_pendulum, mbd.equilibrium(reference_pendulum), outputs={"load": reference_load})
    # two thin rods: omega² = g/l (3 ∓ 6/√7), as in Den Hartog's text
    wanted = np.sqrt(9.81 * np.array([3 - 6 / np.sqrt(7), 3 + 6 / np.sqrt(7)])) / (2 * np.pi)
    assert [mode.frequency * time for mode in model.modes()] == pytest.approx(wanted, rel=1e-9)
    assert model.C[:, :2] / force == pytest.approx(reference.C[:, :2], rel=1e-9, abs=1e-9)


def test_a_small_slider_off_its_equilibrium_is_reported():
    """1 µm and 1 ng on a spring: an acceleration of 100 m/s² is no rest."""
    slider = mbd.Body("slider", mass=1e-12, inertia=1e-24)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), slider.at(0, 0))
    spring = mbd.TSDA("spring", mbd.ground.at(-1e-6, 0), slider.at(0, 0), stiffness=1e-4, free_length=1e-6)
    model = mbd.Mechanism([slider], joints=[rail], forces=[spring])
    assert mbd.linearize(model, mbd.assemble(model, [slider.x == 0])).is_steady
    off = mbd.linearize(model, mbd.assemble(model, [slider.x == 1e-6]))
    with pytest.warns(mbd.MechanismWarning, match="neither an equilibrium"):
        off.modes()


def test_a_slowed_rigid_motion_beside_a_stiff_spring():
    """A stage that drag slows, with a stiff part on it: the drift is one mode, its decay at -c/m another."""
    stage = mbd.Body("stage", mass=1, inertia=1)
    head = mbd.Body("head", mass=1e-3, inertia=1, pose=(1, 0, 0))
    guides = [mbd.Translational(f"guide of {b.name}", mbd.ground.at(0, 0), b.at(0, 0)) for b in (stage, head)]
    spring = mbd.TSDA("spring", stage.at(0, 0), head.at(0, 0), stiffness=1e6, free_length=1)
    drag = mbd.Force("drag", stage.at(0, 0), (-0.01 * stage.vx, 0))
    stages = mbd.Mechanism([stage, head], joints=guides, forces=[spring, drag])
    drift, decay, ringing = mbd.linearize(stages, mbd.assemble(stages)).modes()
    assert drift.eigenvalue == 0
    assert decay.eigenvalue == pytest.approx(-0.01 / 1.001, rel=1e-5)
    assert ringing.frequency == pytest.approx(np.sqrt(1e6 * (1 + 1e3)) / (2 * np.pi), rel=1e-9)


@pytest.mark.parametrize("light", [0.0, 0.3])
@pytest.mark.parametrize("size", [1.0, 1e3])
def test_reactions_that_are_not_unique_change_as_those_of_states_do(light, size):
    """A beam and a plate with too many welds, and a weight on a spring: by differences of assembled states."""
    push = mbd.Input("push", 1.0)
    beam, weight, bodies, joints = welded_beams(size, 1.0, size**2, light)
    spring = mbd.TSDA(
        "spring", beam.at(0, 0), weight.at(0, 0), stiffness=20, free_length=0.5 * size, damping=0.3, actuator=push
    )
    mechanism = mbd.Mechanism(bodies, joints, forces=[mbd.Gravity(), spring], inputs=[push])
    rest = mbd.equilibrium(mechanism)
    reactions = [joint.reaction_on(joint.b.body) for joint in joints[:4]]
    outputs = [part for r in reactions for part in (r.force[0], r.force[1], r.torque / size)]
    model = mbd.linearize(mechanism, rest, wrt=[push], outputs=outputs)

    def at(y, v, f):
        state = mbd.assemble(mechanism, [weight.y == y, weight.vy == v], inputs={push: f})
        return np.array([float(state[output]) for output in outputs])

    h, y = 1e-3 * size, float(rest[weight.y])
    by_place = (at(y + h, 0, 1) - at(y - h, 0, 1)) / (2 * h)
    by_speed, by_push = (at(y, 1, 1) - at(y, -1, 1)) / 2, (at(y, 0, 2) - at(y, 0, 0)) / 2
    assert model.C == pytest.approx(np.column_stack([by_place, by_speed]), abs=2e-5 * np.max(np.abs(by_place)))
    assert model.D.ravel() == pytest.approx(by_push, abs=1e-6)


def test_entries_of_rounding_do_not_disturb_the_modes():
    """A wheel on its tyre: slopes of 1e-40 of the road beside stiffnesses of 1e4."""
    wheel = mbd.Body("wheel", 20.0, 0.5, pose=(0, 0.3, 0))
    law, rubber = mbd.HuntCrossley(2e5, exponent=1), mbd.Coulomb(0.8, 1e-3)
    road = mbd.Wheel(
        "t", wheel.at(0, 0), mbd.ground.at(0, 0), lambda x: 0.03 * mbd.exp(-(((x - 2) / 0.2) ** 2)), 0.3, law, rubber
    )
    model = mbd.Mechanism([wheel], forces=[mbd.Gravity(), road])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        modes = mbd.linearize(model, mbd.equilibrium(model, [wheel.x == 0])).modes()
    assert min(abs(mode.frequency - np.sqrt(1e4) / 2 / np.pi) for mode in modes) < 1e-6
