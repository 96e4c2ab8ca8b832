"""Poses in which a linkage could fold are passed along the smooth branch, by every method and in every form."""

import numpy as np
import pytest
from test_simulate import n_four_bar

import mbdcasadi as mbd

METHODS = ["idas", "erk", "rosenbrock", "dop853"]


def row(count, speed, end, outputs, **settings):
    """A row of parallelograms (IFToMM's N-four-bar) and its motion from the upright pose."""
    f = n_four_bar(count)
    start = [f.first.phi == np.pi / 2, f.first.omega == speed]
    return f, mbd.simulate(f.mechanism, np.linspace(0, end, outputs), initial=start, **settings)


def check_parallel(f, motion, tolerance=2e-5):
    """All cranks turn alike, and the energy is kept."""
    for crank in f.cranks:
        np.testing.assert_allclose(motion[crank.phi], motion[f.first.phi], atol=1e-8)
        np.testing.assert_allclose(motion[crank.omega], motion[f.first.omega], atol=1e-6)
    energy = motion.energy.total
    assert np.max(np.abs(energy - energy[0])) < tolerance * np.max(motion.energy.kinetic)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("speed", [1.0, -1.0])
@pytest.mark.parametrize("count", [1, 5])
def test_flat_rows(count, speed, method):
    """Five loops are integrated in the KKT form by IDAS, one in the explicit form."""
    f, motion = row(count, speed, 3, 61, method=method)
    check_parallel(f, motion)
    assert any("singular pose" in note for note in motion.statistics.notes)


@pytest.mark.slow
@pytest.mark.parametrize("tolerance", [1e-6, 1e-8, 1e-10])
@pytest.mark.parametrize("outputs", [2, 7, 201])
def test_tolerances_and_outputs(tolerance, outputs):
    """Coarse and tight, with outputs in the pose itself or none near to it."""
    f, motion = row(3, 1.0, 2.5, outputs, reltol=tolerance, abstol=tolerance)
    check_parallel(f, motion, max(2e-5, 1e3 * tolerance))


@pytest.mark.slow
@pytest.mark.parametrize("method", [method for method in METHODS if method != "dop853"])  # it refuses redundant rows
@pytest.mark.parametrize("cranks", [3, 4])
def test_redundant_cranks(cranks, method):
    """A coupler on more cranks than it needs: flat, and redundant everywhere else."""
    places = np.linspace(0, 2, cranks)
    bars = [mbd.Body(f"bar {k}", mass=1, inertia=1 / 12, pose=(x, 0.5, np.pi / 2)) for k, x in enumerate(places)]
    coupler = mbd.Body("coupler", mass=2, inertia=0.5, pose=(1, 1, 0))
    joints = []
    for k, (bar, x) in enumerate(zip(bars, places, strict=True)):
        joints.append(mbd.Revolute(f"foot {k}", mbd.ground.at(x, 0), bar.at(-0.5, 0)))
        joints.append(mbd.Revolute(f"head {k}", bar.at(0.5, 0), coupler.at(x - 1, 0)))
    mechanism = mbd.Mechanism(bodies=[*bars, coupler], joints=joints, forces=[mbd.Gravity()])
    start = [bars[0].phi == np.pi / 2, bars[0].omega == -1]
    motion = mbd.simulate(mechanism, np.linspace(0, 3, 61), initial=start, method=method)
    # one coordinate: (cranks/3 + 2) phi'' = -(cranks/2 + 2) g cos(phi)
    weight, inertia = (cranks / 2 + 2) * 9.81, cranks / 3 + 2
    rate, angle = motion[bars[0].omega], motion[bars[0].phi]
    energy = 0.5 * inertia * rate**2 + weight * np.sin(angle)
    np.testing.assert_allclose(energy, energy[0], rtol=1e-5)
    np.testing.assert_allclose(motion[coupler.phi], 0, atol=1e-9)
    np.testing.assert_allclose(motion[bars[-1].phi], angle, atol=1e-9)


def test_reactions_near_the_pose():
    """Reactions stay those of the limit: they do not blow up at outputs near to the pose."""
    f, motion = row(1, -1.0, 3, 3001)
    force = motion[f.mechanism.joints[0].reaction_on(f.first).force]
    steps = np.abs(np.diff(force, axis=0)).max(axis=1)
    assert np.max(np.abs(force)) < 200
    assert np.max(steps) < 1.0


@pytest.mark.slow
def test_an_event_in_the_pose():
    """An event that takes place at the flat pose itself is found there."""
    f = n_four_bar(2)
    flat = mbd.Event("flat", mbd.sin(f.first.phi), direction=0)
    start = [f.first.phi == np.pi / 2, f.first.omega == -1]
    motion = mbd.simulate(f.mechanism, np.linspace(0, 3, 31), initial=start, events=[flat])
    assert len(motion.events) >= 3
    for event in motion.events:
        assert abs(np.sin(event.state[f.first.phi])) < 1e-9


@pytest.mark.slow
@pytest.mark.parametrize("method", ["idas", "dop853"])
def test_many_loops(method):
    """Near the pose the smallest singular value of a long row is far below that of one loop."""
    f, motion = row(20, -1.0, 1.0, 21, method=method)
    check_parallel(f, motion)


@pytest.mark.slow
def test_a_neutral_linkage():
    """Longest and shortest link as long as the other two together: flat once a turn, with unequal links."""
    # 2 + 5 = 3 + 4: crank 2, coupler 5, rocker 4, base 3 (the crank turns past the pose in which all lie on a line)
    crank = mbd.Body("crank", mass=1, inertia=1 / 3, pose=(0, 1.0, np.pi / 2))
    coupler = mbd.Body("coupler", mass=1, inertia=25 / 12, pose=(2, 3.0, 0.4))
    rocker = mbd.Body("rocker", mass=1, inertia=16 / 12, pose=(3.5, 2.0, 1.3))
    joints = [
        mbd.Revolute("O", mbd.ground.at(0, 0), crank.at(-1, 0)),
        mbd.Revolute("A", crank.at(1, 0), coupler.at(-2.5, 0)),
        mbd.Revolute("B", coupler.at(2.5, 0), rocker.at(2, 0)),
        mbd.Revolute("C", mbd.ground.at(3, 0), rocker.at(-2, 0)),
    ]
    mechanism = mbd.Mechanism(bodies=[crank, coupler, rocker], joints=joints)
    motion = mbd.simulate(mechanism, np.linspace(0, 8, 1601), initial=[crank.phi == np.pi / 2, crank.omega == 4])
    energy = motion.energy.kinetic
    assert np.max(np.abs(energy - energy[0])) < 1e-5 * energy[0]
    for body in (crank, coupler, rocker):  # no velocity jumps from one output to the next
        assert np.max(np.abs(np.diff(motion[body.omega]))) < 0.5
    assert np.ptp(motion[crank.phi]) > 2 * np.pi


def parallelogram(loops=1, forces=(), inputs=(), angle=1.0, gravity=False):
    """A row of parallelograms, 1 m by 1 m, of bars of 1 kg, at an angle of the cranks; and its reduced inertia."""
    u = np.array([np.cos(angle), np.sin(angle)])
    bars = [
        mbd.Body(f"crank {k}", mass=1, inertia=1 / 12, pose=(k + u[0] / 2, u[1] / 2, angle)) for k in range(loops + 1)
    ]
    links = [mbd.Body(f"link {k}", mass=1, inertia=1 / 12, pose=(k + 0.5 + u[0], u[1], 0)) for k in range(loops)]
    joints = [mbd.Revolute(f"foot {k}", mbd.ground.at(k, 0), bar.at(-0.5, 0)) for k, bar in enumerate(bars)]
    for k, link in enumerate(links):
        joints.append(mbd.Revolute(f"left {k}", bars[k].at(0.5, 0), link.at(-0.5, 0)))
        joints.append(mbd.Revolute(f"right {k}", link.at(0.5, 0), bars[k + 1].at(0.5, 0)))
    given = [mbd.Gravity()] if gravity else []
    mechanism = mbd.Mechanism([*bars, *links], joints, forces=[*given, *[f(bars) for f in forces]], inputs=inputs)
    return bars, mechanism, (loops + 1) / 3 + loops


@pytest.mark.slow
@pytest.mark.parametrize("loops", [1, 2])
@pytest.mark.parametrize("low", [-0.1, -0.03, -0.01, -1e-3])
def test_a_motion_that_turns_back_behind_the_pose(low, loops):
    """A spring swings the cranks through the flat pose and back again: a cosine."""
    spring = lambda bars: mbd.RSDA(  # noqa: E731
        "spring", mbd.ground.at(0, 0), bars[0].at(-0.5, 0), stiffness=50, free_angle=(1 + low) / 2
    )
    bars, mechanism, inertia = parallelogram(loops, [spring])
    motion = mbd.simulate(mechanism, np.linspace(0, 1.2, 101), initial=[bars[0].phi == 1, bars[0].omega == 0])
    wanted = (1 + low) / 2 + (1 - low) / 2 * np.cos(np.sqrt(50 / inertia) * motion.t)
    for bar in bars:
        np.testing.assert_allclose(motion[bar.phi], wanted, atol=5e-6)
    assert motion.t.size == 101


def right_or_refused(mechanism, bar, wanted, times, **settings):
    """The angular velocity at the end is right, or the run ends before the pose with an error and what there was."""
    try:
        motion = mbd.simulate(mechanism, times, initial=[bar.phi == 1, bar.omega == -2], **settings)
    except mbd.SimulationError as error:
        assert "singular pose" in str(error)
        assert error.partial.t[-1] < 0.51
        np.testing.assert_allclose(error.partial[bar.omega], -2, atol=1e-3)
    else:
        assert motion[bar.omega][-1] == pytest.approx(wanted, abs=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("width", [0.01, 0.05])
@pytest.mark.parametrize("begin", [0.46, 0.495, 0.51])
def test_a_pulse_while_flat_is_never_lost(begin, width, method):
    """A torque that acts in the flat pose, or next to it: ``I omega = I omega_0 + T width``."""
    pulse = mbd.if_else(mbd.t < begin, 0, mbd.if_else(mbd.t < begin + width, 10 / width, 0))
    bars, mechanism, inertia = parallelogram(1, [lambda bars: mbd.Torque("kick", bars[0], pulse)])
    right_or_refused(mechanism, bars[0], -2 + 10 / inertia, np.linspace(0, 1, 41), method=method)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_a_force_that_acts_about_the_pose_alone_is_never_lost(method):
    """A torque within 0.03 rad of the flat pose: ``I (omega² - omega_0²)/2 = T 0.06``, against the motion."""
    near = lambda bars: mbd.Torque("detent", bars[0], mbd.if_else(mbd.fabs(bars[0].phi) < 0.03, -20, 0))  # noqa: E731
    bars, mechanism, inertia = parallelogram(1, [near])
    right_or_refused(mechanism, bars[0], -np.sqrt(4 + 2 * 20 * 0.06 / inertia), np.linspace(0, 1, 41), method=method)


@pytest.mark.parametrize("period", [0.3, 0.07, 0.5])
def test_samples_of_a_controller_are_never_left_out(period):
    """All of them are asked for, or the run ends before the pose."""
    u = mbd.Input("u")
    bars, mechanism, _ = parallelogram(1, [lambda bars: mbd.Torque("drive", bars[0], u)], [u])
    asked = []

    def control(t, state):
        asked.append(t)
        return {u: 0.1}

    inputs = mbd.SampledController(control, period)
    try:
        motion = mbd.simulate(
            mechanism, np.linspace(0, 1, 41), initial=[bars[0].phi == 1, bars[0].omega == -2], inputs=inputs
        )
    except mbd.SimulationError as error:
        assert "singular pose" in str(error)
    else:
        assert motion.t.size == 41
        np.testing.assert_allclose(asked, np.arange(0, 1 - 1e-9, period), atol=1e-9)


def test_a_reset_in_the_pose_itself_is_refused():
    """Velocities after an impulse are not determined where two motions are possible."""
    bars, mechanism, _ = parallelogram(1)
    event = mbd.Event("flat", bars[0].phi, direction=-1, reset={bars[0].omega: -0.5 * bars[0].omega})
    with pytest.raises(mbd.SimulationError, match="event 'flat' takes place in a singular pose") as caught:
        mbd.simulate(mechanism, np.linspace(0, 1, 41), initial=[bars[0].phi == 1, bars[0].omega == -2], events=[event])
    assert caught.value.partial.t[-1] == pytest.approx(0.475, abs=0.03)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("outputs", [31, 201])
def test_no_output_is_left_out(method, outputs):
    """An equal slider-crank, whose entries to the pose lie in other pieces than the passages begin."""
    crank = mbd.Body("crank", mass=1, inertia=1 / 12, pose=(0.35, 0.35, np.pi / 4))
    rod = mbd.Body("rod", mass=1, inertia=1 / 12, pose=(1.06, 0.35, -np.pi / 4))
    slider = mbd.Body("slider", mass=1, inertia=0.1, pose=(1.41, 0, 0))
    joints = [
        mbd.Revolute("A", mbd.ground.at(0, 0), crank.at(-0.5, 0)),
        mbd.Revolute("B", crank.at(0.5, 0), rod.at(-0.5, 0)),
        mbd.Revolute("C", rod.at(0.5, 0), slider.at(0, 0)),
        mbd.Translational("guide", mbd.ground.at(0, 0), slider.at(0, 0)),
    ]
    mechanism = mbd.Mechanism([crank, rod, slider], joints, forces=[mbd.Gravity()])
    times = np.linspace(0, 4, outputs)
    for tolerance in (1e-6, 1e-8):
        motion = mbd.simulate(
            mechanism,
            times,
            initial=[crank.phi == 0.8, crank.omega == 7],
            method=method,
            reltol=tolerance,
            abstol=tolerance,
        )
        np.testing.assert_array_equal(motion.t, times)
        np.testing.assert_allclose(motion[slider.x], 2 * np.cos(motion[crank.phi]), atol=1e-8)


@pytest.mark.parametrize("method", ["idas", "dop853"])
def test_a_part_that_slides_far_is_no_singular_pose(method):
    """A slider on a driven carriage and on the coupler of a parallelogram: it leaves as fast as it was pushed."""
    carriage = mbd.Body("carriage", mass=2, inertia=1)
    slider = mbd.Body("slider", mass=1, inertia=1)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), carriage.at(0, 0))
    rail = mbd.Translational("rail", carriage.at(0, 0), slider.at(0, 0))
    drive = mbd.Driver("drive", carriage.x, mbd.sin(mbd.t))
    driven = mbd.Mechanism([carriage, slider], [guide, rail], drivers=[drive], forces=[mbd.Gravity()])
    motion = mbd.simulate(driven, np.linspace(0, 2, 11), initial=[slider.vx == 100], method=method)
    assert motion[slider.x][-1] == pytest.approx(200, abs=1e-6)
    assert not any("singular" in note for note in motion.statistics.notes)
    cranks = [mbd.Body(f"crank {k}", mass=1, inertia=0.1, pose=(k, 0.1, np.pi / 2)) for k in (0, 1)]
    coupler = mbd.Body("coupler", mass=1, inertia=0.1, pose=(0.5, 0.2, 0))
    part = mbd.Body("part", mass=1, inertia=0.1, pose=(0.5, 0.2, 0))
    pins = [mbd.Revolute(f"root {k}", mbd.ground.at(k, 0), cranks[k].at(-0.1, 0)) for k in (0, 1)]
    pins += [mbd.Revolute(f"tip {k}", cranks[k].at(0.1, 0), coupler.at(k - 0.5, 0)) for k in (0, 1)]
    slot = mbd.Translational("slot", coupler.at(0, 0), part.at(0, 0))
    lift = mbd.Mechanism([*cranks, coupler, part], [*pins, slot], forces=[mbd.Gravity()])
    motion = mbd.simulate(lift, [0, 1], initial=[slot.speed == 100, cranks[0].omega == 0], method=method)
    # in the guide the part is free along x
    assert motion[part.x][-1] == pytest.approx(100.5, abs=1e-6)


@pytest.mark.parametrize("method", ["idas", "dop853"])
def test_a_slow_parameter_of_a_curve_is_no_singular_pose(method):
    """A bead starts near the cusp of a cycloid, where its parameter moves it little; the arc to the bottom swings."""
    radius, first = 0.5, 1e-3
    cycloid = mbd.Curve(lambda s: (radius * (s - mbd.sin(s)), -radius * (1 - mbd.cos(s))), 5e-4, 6.2)
    bead = mbd.Body("bead", mass=1, inertia=1)
    wire = mbd.PointOnCurve("wire", mbd.ground.at(0, 0), bead.at(0, 0), cycloid)
    model = mbd.Mechanism([bead], [wire], forces=[mbd.Gravity()])
    start = [bead.x == radius * (first - np.sin(first)), bead.y == -radius * (1 - np.cos(first)), bead.vx == 0]
    motion = mbd.simulate(model, np.linspace(0, 0.6, 31), initial=start, method=method)
    angle = 2 * np.arccos(np.cos(first / 2) * np.cos(np.sqrt(9.81 / (4 * radius)) * motion.t))
    np.testing.assert_allclose(motion[bead.x], radius * (angle - np.sin(angle)), atol=1e-7)
    assert not any("singular" in note for note in motion.statistics.notes)
