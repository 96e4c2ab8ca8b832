"""Meshes that suit the motion, the proof by simulation, and what else a solution does with its inputs."""

import warnings

import numpy as np
import pytest
from motions import crank_rocker, guided_block, half_turn, pendulum, rest_to_rest, sprung_block
from scipy.linalg import expm
from scipy.optimize import minimize

import mbdcasadi as mbd
from mbdcasadi.optimal_control.measures.measure import pieces_of
from mbdcasadi.optimal_control.search import refine
from mbdcasadi.optimal_control.transcription.mesh import Mesh


@pytest.fixture(scope="module")
def sharp():
    """A block carried over through a narrow bump of force: a mesh for it is uneven."""
    u = mbd.Input("u")
    block, mechanism = guided_block(
        1.0, u, extra=lambda b: [mbd.GeneralizedForce("bump", [(b.x, -20 * mbd.exp(-(((b.x - 0.3) / 0.03) ** 2)))])]
    )
    return mbd.OptimalControlProblem(
        mechanism,
        duration=1.0,
        initial=[block.x == 0, block.vx == 0],
        final=[block.x == 1, block.vx == 0],
        running_cost=u**2,
    )


@pytest.mark.slow
@pytest.mark.parametrize("transcription", ["gauss-legendre", "hermite-simpson"])
def test_the_tolerance_is_met_with_an_uneven_mesh(sharp, transcription):
    """Short intervals in the bump, long ones elsewhere, the local error below the tolerance everywhere."""
    solution = mbd.optimize(sharp, intervals=10, tolerance=1e-6, transcription=transcription)
    assert solution.mesh_error <= 1e-6
    lengths = np.diff(solution.mesh)
    assert np.max(lengths) > 4 * np.min(lengths)
    middle = solution.trajectory.at(solution.mesh[:-1] + lengths / 2)[sharp.mechanism.bodies[0].x]
    assert 0.2 < middle[np.argmin(lengths)] < 0.4
    assert solution.verify().final_error < 1e-3


def test_the_table_of_passes(sharp):
    """Intervals, errors, costs and iterations by pass; the last is the solution."""
    solution = mbd.optimize(sharp, intervals=8, tolerance=1e-6)
    passes = solution.statistics.passes
    assert len(passes) >= 2 and passes[0].intervals == 8
    assert passes[-1].intervals == solution.meshes[0].count == solution.mesh.size - 1
    assert passes[-1].error == solution.mesh_error <= 1e-6 < passes[0].error
    assert passes[-1].cost == solution.cost
    assert all(p.iterations > 0 and p.seconds > 0 for p in passes)
    assert passes[-1].iterations < 30


def test_a_mesh_that_is_fine_enough_is_left_alone():
    """One pass, the same mesh."""
    problem, *_ = rest_to_rest(3.0, 2.0)
    solution = mbd.optimize(problem, intervals=5, tolerance=1e-6)
    assert len(solution.statistics.passes) == 1 and solution.mesh.size == 6


def test_waypoints_stay_mesh_points(sharp):
    """At fixed and at free times, through every pass."""
    block = sharp.mechanism.bodies[0]
    via = sharp.replace(waypoints=[mbd.Waypoint(0.37, [block.x == 0.28]), mbd.Waypoint((0.5, 0.9), [block.x == 0.8])])
    solution = mbd.optimize(via, intervals=12, tolerance=1e-6)
    assert len(solution.statistics.passes) >= 2
    for time in solution.waypoint_times:
        assert np.min(np.abs(solution.mesh - time)) < 1e-12
    assert solution.waypoint_times[0] == 0.37
    at = solution.trajectory.at(solution.waypoint_times)[block.x]
    assert at == pytest.approx([0.28, 0.8], abs=1e-8)


def test_splitting():
    """An interval above the tolerance is split by the order, within its segment."""
    mesh = Mesh((np.linspace(0, 1, 5), np.linspace(0, 1, 3)))
    # 2^7 times the tolerance wants (2 * 128)^(1/7) = 2.2, so 3 pieces at order 6
    found = mesh.refined(pieces_of(np.array([128e-6, 1e-12, 1e-12, 0.9e-6, 1e-12, 5e-5]), 1e-6, 7))
    assert np.allclose(found.segments[0], [0, 1 / 12, 2 / 12, 1 / 4, 1 / 2, 3 / 4, 1])
    assert np.allclose(found.segments[1], [0, 1 / 2, 3 / 4, 1])


def test_the_local_error_is_that_of_an_integration(sharp):
    """mesh_error against a re-integration of every interval by IDAS."""
    solution = mbd.optimize(sharp, intervals=16)
    block, worst = sharp.mechanism.bodies[0], 0.0
    for k in range(16):
        run = mbd.simulate(
            sharp.mechanism,
            solution.mesh[k : k + 2],
            initial=solution.state(k),
            inputs=solution.inputs,
            reltol=1e-11,
            abstol=1e-11,
        )
        after = solution.state(k + 1)
        worst = max(worst, abs(run.final[block.x] - after[block.x]), abs(run.final[block.vx] - after[block.vx]))
    assert solution.mesh_error == pytest.approx(worst, rel=1e-3)


@pytest.mark.slow
def test_defects_by_interval():
    """verify() distinguishes displacements and angles, interval by interval."""
    f = crank_rocker()
    solution = mbd.optimize(half_turn(f), intervals=12, degree=2)
    replay = solution.verify()
    assert replay.defects.shape == (12, 2)
    assert np.all(replay.defects[:, 1] >= replay.defects[:, 0]), "links are shorter than a metre"
    assert replay.final_error <= replay.largest_deviation
    assert f"{replay.final_error:.2e}" in repr(replay) and "idas" in repr(replay).lower()
    finer = mbd.optimize(half_turn(f), intervals=48, degree=2).verify()
    assert np.max(finer.defects) < np.max(replay.defects) / 100


def held_up(duration):
    """An inverted pendulum that passes from one side to the other."""
    bob, tau, mechanism = pendulum(length=0.2)
    return mbd.OptimalControlProblem(
        mechanism,
        duration=duration,
        initial=[bob.phi == np.pi - 0.3, bob.omega == 0],
        final=[bob.phi == np.pi + 0.3, bob.omega == 0],
        running_cost=tau**2,
    )


def test_an_unstable_motion_may_be_right_and_not_replay():
    """An inverted pendulum held up for a while: small defects, a large final error."""
    solution = mbd.optimize(held_up(4.0), intervals=60)
    replay = solution.verify()
    assert np.max(replay.defects) < 1e-6
    assert replay.final_error > 100 * np.max(replay.defects)


def test_a_miss_to_which_the_simulation_adds_is_the_least_one():
    """An inverted pendulum held up for so long that errors of the integration alone lead it away."""
    with pytest.warns(mbd.MechanismWarning, match=r"misses the motion by about (\S+) in .* or more, since") as caught:
        solution = mbd.optimize(held_up(2.9), intervals=80)
    said = float(str(caught[0].message).split("about ")[1].split()[0])
    assert solution.verify().final_error > said / 2


def test_simulating_with_other_parameters_and_starts():
    """How robust the open loop is: against the closed form of a block with another spring."""
    problem, u, k, block = sprung_block(4.0, 1.0)
    solution = mbd.optimize(problem, intervals=12)
    assert solution.simulate().final[block.x] == pytest.approx(1.0, abs=1e-6)
    # with u = A cos 2t + B sin 2t resonant at k = 4; shifted starts ride along freely
    shifted = solution.simulate(initial=[block.x == 0.1, block.vx == 0])
    assert shifted.final[block.x] == pytest.approx(1.0 + 0.1 * np.cos(2.0), abs=1e-6)
    soft = solution.simulate(parameters={k: 0.0})
    times = np.linspace(0, 1, 2001)
    force = solution.trajectory.at(times)[u]
    assert soft.final[block.vx] == pytest.approx(np.trapezoid(force, times), abs=1e-5)
    assert solution.simulate(method="erk").final[block.x] == pytest.approx(1.0, abs=1e-6)


@pytest.mark.slow
def test_a_solution_as_input_of_a_simulation():
    """An input may be given by a solution: the same as its own replay."""
    f = crank_rocker()
    solution = mbd.optimize(half_turn(f), intervals=30)
    motion = mbd.simulate(f.mechanism, solution.mesh, initial=solution.state(0), inputs={f.tau: solution})
    assert np.allclose(motion.q, solution.simulate().q, atol=1e-9)


@pytest.mark.slow
def test_a_trajectory_evaluates_and_interpolates():
    """Positions between mesh points obey the equations of motion; reactions, energies, efforts are expressions."""
    f = crank_rocker()
    solution = mbd.optimize(half_turn(f), intervals=40)
    times = np.linspace(0, 0.6, 501)
    motion = solution.trajectory.at(times)
    eom = solution.problem.equations
    assert np.max(np.abs(motion[eom.Phi])) < 1e-11 and np.max(np.abs(motion[eom.Phi_q @ eom.v - eom.nu])) < 1e-10
    work = np.concatenate(
        [[0], np.cumsum(np.diff(times) * (lambda p: (p[1:] + p[:-1]) / 2)(motion[f.tau * f.crank.omega]))]
    )
    energy = motion.energy.total
    assert np.allclose(energy - energy[0], work, atol=1e-4)
    assert solution.trajectory.t.size == 40 * 4 + 1
    assert set(solution.mesh) <= set(solution.trajectory.t)


def test_a_mesh_too_coarse_is_told():
    """The cart-pole on ten intervals does not replay, and the warning says so; on thirty it does, without one."""
    u = mbd.Input("u", lower=-20, upper=20)
    cart = mbd.Body("cart", mass=1.0, inertia=0.0)
    bob = mbd.Body("bob", mass=0.3, inertia=0.0, pose=(0, -0.5, -np.pi / 2))
    joints = [
        mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0)),
        mbd.Revolute("pole", cart.at(0, 0), bob.at(-0.5, 0)),
    ]
    forces = [mbd.Gravity(), mbd.Force("push", cart.at(0, 0), (u, 0))]
    rest = [cart.vx == 0, bob.omega == 0]
    problem = mbd.OptimalControlProblem(
        mbd.Mechanism(bodies=[cart, bob], joints=joints, forces=forces, inputs=[u]),
        duration=2.0,
        initial=[cart.x == 0, bob.phi == -np.pi / 2, *rest],
        final=[cart.x == 1, bob.phi == np.pi / 2, *rest],
        running_cost=u**2,
    )
    with pytest.warns(mbd.MechanismWarning, match=r"mesh of 10 intervals is too coarse.*ends elsewhere.*intervals="):
        coarse = mbd.optimize(problem, intervals=10)
    assert coarse.verify().final_error > 0.1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fine = mbd.optimize(problem, intervals=30)
        # as the guess for another problem it brings its mesh, which is refined; for the same one nothing is checked
        limited = mbd.optimize(problem.replace(path=[mbd.bounded(-1.5, cart.x, 1.5)]), guess=coarse)
        same = mbd.optimize(problem, guess=coarse)
    assert fine.verify().final_error < 1e-3
    assert limited.mesh.size - 1 > 10 and limited.verify().final_error < 0.02
    assert limited.cost == pytest.approx(fine.cost, rel=1e-3)
    assert same.mesh.size - 1 == 10 and same.statistics.iterations <= 2


def test_a_coarse_mesh_of_linear_forces_is_told():
    """Two wheels and a torsion spring: at the ends of intervals of Gauss stages the first-order error vanishes."""
    one, two = (mbd.Body(name, mass=1.0, inertia=0.01) for name in ("one", "two"))
    torque = mbd.Input("torque")
    spring = mbd.Torque("spring", two, 20 * (one.phi - two.phi), opposite=one)
    mechanism = mbd.Mechanism(
        bodies=[one, two],
        joints=[mbd.Revolute(f"axle {b.name}", mbd.ground.at(0, 0), b.at(0, 0)) for b in (one, two)],
        forces=[mbd.Torque("motor", one, torque), spring],
        inputs=[torque],
    )
    rest = [one.omega == 0, two.omega == 0]
    problem = mbd.OptimalControlProblem(
        mechanism, 1.0, [one.phi == 0, two.phi == 0, *rest], [one.phi == 3, two.phi == 3, *rest], running_cost=torque**2
    )
    with pytest.warns(mbd.MechanismWarning, match="mesh of 5 intervals is too coarse"):
        assert np.max(mbd.optimize(problem, intervals=5).phases[0].end_errors) > 0.1


def test_a_coarse_mesh_of_a_fast_state_is_told():
    """A force that follows its input within a thirtieth of a second, on four intervals."""
    block = mbd.Body("block", mass=1.0, inertia=0.1)
    u, force = mbd.Input("u"), mbd.StateVariable("force")
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), block.at(0, 0))
    push = mbd.Force("push", block.at(0, 0), (force, 0))
    mechanism = mbd.Mechanism(
        bodies=[block], joints=[rail], forces=[push], inputs=[u], states={force: 200 * (u - force)}
    )
    problem = mbd.OptimalControlProblem(
        mechanism, 1.0, [block.x == 0, block.vx == 0, force == 0], [block.x == 1, block.vx == 0], running_cost=u**2
    )
    with pytest.warns(mbd.MechanismWarning, match="mesh of 4 intervals is too coarse"):
        mbd.optimize(problem, intervals=4)


def metered_motor(terminal):
    """A motor turns a wheel by 20 rad in two seconds; a meter counts the energy from the source."""
    wheel = mbd.Body("wheel", mass=0.5, inertia=0.01)
    axle = mbd.Revolute("axle", mbd.ground.at(0, 0), wheel.at(0, 0))
    volts = mbd.Input("V", lower=-24, upper=24)
    motor = mbd.DCMotor("motor", wheel, volts, constant=0.5, resistance=1.0, inductance=0.01)
    meter = mbd.EnergyMeter("meter", volts * motor.current)
    mechanism = mbd.Mechanism(bodies=[wheel], joints=[axle], forces=[motor, meter], inputs=[volts])
    return meter, mbd.OptimalControlProblem(
        mechanism,
        2.0,
        initial=[wheel.phi == 0, wheel.omega == 0, motor.current == 0, meter.energy == 0],
        final=[wheel.phi == 20, wheel.omega == 0],
        terminal_cost=meter.energy if terminal else 0,
        running_cost=0 if terminal else motor.current**2,
    )


def test_errors_of_first_order_states_count():
    """A lag of four milliseconds on ten intervals of a tenth of a second: the warning, the mesh error, the proof."""
    cart, force = mbd.Body("cart", mass=1.0, inertia=0.1), mbd.Input("F", lower=-5, upper=5)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0))
    lag = mbd.FirstOrderLag("lag", 8 * cart.x - 3 * cart.x**2 + force, time_constant=0.004)
    push = mbd.Force("push", cart.at(0, 0), (force, 0))
    problem = mbd.OptimalControlProblem(
        mbd.Mechanism(bodies=[cart], joints=[rail], forces=[push, lag], inputs=[force]),
        1.0,
        initial=[cart.x == 0, cart.vx == 0, lag.output == 0],
        final=[cart.x == 0.5, cart.vx == 0],
        terminal_cost=lag.output**2,
    )
    with pytest.warns(mbd.MechanismWarning, match=r"too coarse for the state 'lag\.output'.*of its range in all"):
        solution = mbd.optimize(problem, intervals=10)
    proof = solution.verify()
    span = np.ptp(solution.trajectory[lag.output][:: solution.points_per_interval])
    missed = abs(proof.trajectory.final[lag.output] - solution.trajectory.final[lag.output]) / span
    assert missed > 0.01 and proof.final_error >= 0.99 * missed
    assert solution.mesh_error > 0.01
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # without a number of intervals they are split for the state, too
        assert mbd.optimize(problem).mesh.size - 1 > 40


@pytest.mark.slow
def test_a_mesh_is_refined_for_a_state():
    """Until the meter is right, too."""
    for terminal in (False, True):  # the second cost is the meter itself, linear in the voltage
        meter, problem = metered_motor(terminal)
        solution = mbd.optimize(problem, intervals=10, degree=5, tolerance=1e-5)  # voltages are steep at the ends
        assert solution.mesh.size < 401
        energy = solution.verify().trajectory.final[meter.energy]
        assert energy == pytest.approx(solution.trajectory.final[meter.energy], rel=1e-3)


def test_a_tolerance_that_is_not_reached(monkeypatch):
    """An error of optimal control, with the solution on the last mesh."""
    monkeypatch.setattr("mbdcasadi.optimal_control.search.refine.PASSES", 1)
    _, problem = metered_motor(terminal=False)
    with pytest.raises(mbd.OptimizationError, match=r"above the tolerance 1e-09: 1 passes are made") as error:
        mbd.optimize(problem, intervals=10, tolerance=1e-9)
    assert error.value.partial.cost > 0 and error.value.partial.mesh.size > 11


def test_a_length_that_the_first_state_does_not_suit_is_named():
    """A pendulum of other length starts from conditions, not from the state of the solution."""
    u, length = mbd.Input("u"), mbd.Parameter("length", 0.4)
    bob = mbd.Body("bob", mass=1.0, inertia=0.1, pose=(0.4, 0, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), bob.at(-length, 0))
    mechanism = mbd.Mechanism([bob], [pin], forces=[mbd.Torque("motor", bob, u)], inputs=[u], parameters=[length])
    start = [bob.phi == 0, bob.omega == 0]
    solution = mbd.optimize(mbd.OptimalControlProblem(mechanism, 1.0, start, [bob.phi == 1], running_cost=u**2))
    with pytest.raises(mbd.ConditionError, match=r"does not meet pin\.x, by -?0\.1; give initial= as conditions"):
        solution.simulate(parameters={length: 0.5})
    assert solution.simulate(parameters={length: 0.5}, initial=start).final[bob.phi] > 0


def test_all_intervals_are_halved_if_the_error_moves_on(monkeypatch):
    """The first interval stays coarse though it was split: a fast motion that goes to where the mesh is coarse."""
    problem, *_ = rest_to_rest()
    first = lambda _measure, part: np.where(np.arange(part.mesh.count) == 0, 0.15, 0.0)  # noqa: E731
    monkeypatch.setattr(refine.Coarseness, "of", first)
    solution = mbd.optimize(problem)
    assert solution.mesh.size - 1 == (40 + 1) * 2**3
    assert solution.cost == pytest.approx(12, rel=1e-8)


def test_a_solution_that_goes_astray_on_a_finer_mesh_is_left_for_one_with_halved_intervals(monkeypatch):
    """The first interval is split, the motion is lost with that, and found again with twice as many intervals."""
    problem, *_ = rest_to_rest()
    errors = {40: 0.15, 80: 0.0}
    monkeypatch.setattr(
        refine.Coarseness,
        "of",
        lambda _, part: np.r_[errors.get(part.mesh.count, 9.0), np.zeros(part.mesh.count - 1)],
    )
    solution = mbd.optimize(problem)
    assert solution.mesh.size - 1 == 80
    assert solution.cost == pytest.approx(12, rel=1e-8)
    del errors[80]
    with pytest.warns(mbd.MechanismWarning, match="mesh of 40 intervals is too coarse"):
        assert mbd.optimize(problem).mesh.size - 1 == 40


@pytest.mark.slow
def test_a_motion_that_passes_a_pose_in_which_the_linkage_branches():
    """A pantograph whose parallelogram goes flat: its interval cannot be integrated, which is said with its time."""
    origin, elbow, middle, corner, end = np.array([(0, 0), (0.4, 0.6), (0.2, 0.3), (0.6, 0.3), (0.4, 0.0)], float)

    def bar(name, first, last):
        length = float(np.linalg.norm(last - first))
        angle = float(np.arctan2(*(last - first)[::-1]))
        pose = (*((first + last) / 2).tolist(), angle)
        return mbd.Body(name, mass=1.0, inertia=length**2 / 12, pose=pose), length / 2

    (long, a), (fore, b) = bar("long", origin, elbow), bar("fore", elbow, np.array([0.8, 0.0]))
    (first, c), (second, d) = bar("first", middle, end), bar("second", corner, end)
    joints = [
        mbd.Revolute("ground", mbd.ground.at(0, 0), long.at(-a, 0)),
        mbd.Revolute("elbow", long.at(a, 0), fore.at(-b, 0)),
        mbd.Revolute("middle", first.at(-c, 0), long.at(0, 0)),
        mbd.Revolute("corner", fore.at(0, 0), second.at(-d, 0)),
        mbd.Revolute("end", first.at(c, 0), second.at(d, 0)),
    ]
    u, w = mbd.Input("u"), mbd.Input("w")
    motors = [mbd.Torque("lift", long, u), mbd.Torque("open", first, w, long)]
    pantograph = mbd.Mechanism([second, first, fore, long], joints, forces=[mbd.Gravity(), *motors], inputs=[u, w])
    tip = fore.at(b, 0)
    problem = mbd.OptimalControlProblem(
        pantograph,
        duration=0.8,
        initial=[tip.x == 0.8, tip.y == 0, tip.vx == 0, tip.vy == 0],
        final=[tip.x == 0.9, tip.y == 0.2, tip.vx == 0, tip.vy == 0],
        running_cost=u**2 + w**2,
    )
    solution = mbd.optimize(problem, intervals=12)
    angle = solution.trajectory[fore.phi - long.phi]
    assert np.min(np.abs(np.sin(angle))) < 0.05 and solution.mesh_error == np.inf
    with pytest.raises(
        mbd.OptimizationError, match="cannot be checked: from t = .* stops .* locks or branches"
    ) as caught:
        mbd.optimize(problem, intervals=12, tolerance=1e-5)
    assert isinstance(caught.value.partial, mbd.Solution) and 0 < caught.value.time < 0.8


@pytest.mark.slow
@pytest.mark.parametrize("tolerance", [1e-4, 1e-5])
def test_a_narrow_kink_is_refined_until_it_is_short_enough(tolerance):
    """A block is pushed 10 m and back against friction that is smoothed over a thousandth of its speed.

    The error at the change of its direction stays as it is until an interval there is as short as the smoothing.
    """
    push = mbd.Input("push", lower=-400, upper=400)
    block = mbd.Body("block", mass=1, inertia=1)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    friction = mbd.JointFriction("friction", guide, mbd.Coulomb(0.6, 0.1))
    forces = [mbd.Gravity(), friction, mbd.Force("push", block.at(0, 0), (push, 0))]
    rests = [block.x == 0, block.vx == 0]
    there = mbd.Waypoint((0.05, 4), [block.x == 10, block.vx == 0])
    problem = mbd.OptimalControlProblem(
        mbd.Mechanism([block], [guide], forces=forces, inputs=[push]),
        duration=(0.1, 8), terminal_cost=mbd.t, initial=rests, final=rests, waypoints=[there],
    )  # fmt: skip
    solution = mbd.optimize(problem, tolerance=tolerance)
    assert solution.mesh_error <= tolerance
    gains, brakes = 400 - 0.6 * 9.81, 400 + 0.6 * 9.81
    assert solution.duration == pytest.approx(2 * np.sqrt(2 * 10 * (1 / gains + 1 / brakes)), rel=2e-6)


def motor_at_rest(body, pivot, turn, duration, limit, constant, resistance, inductance, forces=()):
    """A motor turns a body from rest to rest with the least electrical work, with limited voltage."""
    volts = mbd.Input("V", lower=-limit, upper=limit)
    motor = mbd.DCMotor(
        "motor", body, volts, constant=constant, resistance=resistance, inductance=inductance
    )  # fmt: skip
    begin = float(body.pose_estimate[2])
    return mbd.OptimalControlProblem(
        mbd.Mechanism([body], [pivot], forces=[*forces, motor], inputs=[volts]),
        duration=duration,
        initial=[body.phi == begin, body.omega == 0, motor.current == 0],
        final=[body.phi == begin + turn, body.omega == 0],
        running_cost=volts * motor.current,
    )


def work_by_hand(inertia, turn, duration, limit, constant, resistance, inductance):
    """The voltage is at one limit, then such that the current falls linearly, then at the other limit."""
    rates = np.zeros((4, 4))
    rates[0, 1], rates[1, 2] = 1.0, constant / inertia
    rates[2, 1:] = -constant / inductance, -resistance / inductance, 1 / inductance
    nodes, weights = np.polynomial.legendre.leggauss(12)

    def at_limit(state, time, squares=False):
        """Angle, speed and current after a time at the limit, or the integral of the squared current."""
        if squares:
            return (
                time
                / 2
                * sum(w * at_limit(state, time / 2 * (1 + n))[2] ** 2 for n, w in zip(nodes, weights, strict=True))
            )
        return (expm(rates * time) @ [*state, limit])[:3]

    def course(z):
        first, slope, last = z
        start = at_limit(np.zeros(3), first)
        rest, gain = duration - first - last, constant / inertia
        current = start[2] + slope * rest
        speed = start[1] + gain * (start[2] + current) / 2 * rest
        angle = start[0] + start[1] * rest + gain * (2 * start[2] + current) / 6 * rest**2
        squares = (start[2] ** 2 + start[2] * current + current**2) / 3 * rest
        return squares, np.array([angle, speed, current])

    def missed(z):
        return at_limit(course(z)[1], z[2])[:2] - [turn, 0]

    def work(z):
        squares, state = course(z)
        squares += at_limit(np.zeros(3), z[0], squares=True) + at_limit(state, z[2], squares=True)
        return resistance * squares + inductance * at_limit(state, z[2])[2] ** 2 / 2

    usual = 6 * inertia * turn / constant / duration**2
    short = inductance * usual / limit
    found = minimize(
        work, [short, -2 * usual / duration, short / 2], method="SLSQP", options={"ftol": 1e-15, "maxiter": 500},
        bounds=[(0, duration / 3), (-99, 99), (0, duration / 3)], constraints={"type": "eq", "fun": missed},
    )  # fmt: skip
    assert found.success
    return found.fun


@pytest.mark.filterwarnings("error:the local errors meet the tolerance")
def test_an_error_that_moves_on_to_the_next_interval_is_met():
    """Errors of equal intervals just below the tolerance: each pass leads the next one just above it."""
    inertia, turn, duration, limit = 0.07234690311686372, 1.643194514067462, 0.975494512068317, 34.088259647844
    electric = {"constant": 1.278980533603269, "resistance": 1.3610168944821417, "inductance": 0.009259626690589787}
    wheel = mbd.Body("wheel", mass=1.0, inertia=inertia)
    shaft = mbd.Revolute("shaft", mbd.ground.at(0, 0), wheel.at(0, 0))
    problem = motor_at_rest(wheel, shaft, turn, duration, limit, **electric)
    solution = mbd.optimize(problem, tolerance=1e-5)
    assert solution.mesh_error < 1e-5
    # the voltage is at its limits for less than the root of the tolerance, 0.16 ms at the start
    assert solution.cost == pytest.approx(work_by_hand(inertia, turn, duration, limit, **electric), rel=1e-5)


@pytest.mark.filterwarnings("ignore:the local errors meet the tolerance")
def test_a_peak_of_a_voltage_does_not_hide_that_the_rest_gets_better():
    """Beside a peak at the start, of which a coarse mesh shows little, all intervals are off at first."""
    mass, length = 1.1261965136213057, 0.32539423931100525
    electric = {"constant": 1.0114255099487346, "resistance": 1.8471239898640395, "inductance": 0.08297811268883491}
    rod = mbd.Body("rod", mass=mass, inertia=mass * length**2 / 12, pose=(0, -length / 2, -np.pi / 2))
    pivot = mbd.Revolute("pivot", mbd.ground.at(0, 0), rod.at(-length / 2, 0))
    problem = motor_at_rest(
        rod, pivot, 0.8363399872931947, 1.7464050246658243, 12.721798609183606, **electric, forces=[mbd.Gravity()]
    )
    # Gauss collocation of order 6 in the angle, by hand, on 1600 and 3200 intervals: 0.68780551 and 0.68780565
    assert mbd.optimize(problem, tolerance=1e-5).cost == pytest.approx(0.6878057, rel=1e-6)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:the motion is unstable")
def test_a_tolerance_begins_at_a_solution_that_is_a_motion():
    """A flywheel of free inertia and a pump turn once in a cycle of least effort; the crank nearly stops on its way.

    On 40 intervals half of the cost is enough, for what is no motion and leads to none on finer meshes. By hand,
    with Simpson's rule and the least inertia: 0.704620 on 1600 intervals and 0.704666 on 3200.
    """
    radius, load, speed = 0.168, 23.4, 5.2
    torque, inertia = mbd.Input("torque"), mbd.Parameter("inertia", 0.05, 0.002, 0.5)
    wheel = mbd.Body("wheel", mass=0.5, inertia=inertia)
    yoke = mbd.Body("yoke", mass=2.43, inertia=0.1, pose=(radius, 0, 0))
    joints = [
        mbd.Revolute("shaft", mbd.ground.at(0, 0), wheel.at(0, 0)),
        mbd.Translational("guide", mbd.ground.at(0, 0), yoke.at(0, 0)),
        mbd.PointOnLine("slot", yoke.at(0, 0, angle=np.pi / 2), wheel.at(radius, 0)),
    ]
    pump = -load / 2 * (1 + mbd.tanh(yoke.vx / (0.1 * radius * speed)))
    forces = [mbd.Torque("motor", wheel, torque), mbd.GeneralizedForce("pump", [(yoke.x, pump)])]
    problem = mbd.OptimalControlProblem(
        mbd.Mechanism([wheel, yoke], joints, forces=forces, inputs=[torque], parameters=[inertia]),
        duration=2 * np.pi / speed,
        initial=[wheel.phi == 0],
        final=[wheel.phi == 2 * np.pi],
        boundary=[mbd.at_end(wheel.omega) == mbd.at_start(wheel.omega)],
        running_cost=torque**2,
        terminal_cost=1.02 * inertia,
        free_parameters=[inertia],
    )
    solution = mbd.optimize(problem, tolerance=1e-4)
    assert solution.mesh_error < 1e-4 and np.max(solution.verify().defects) < 1e-4
    assert solution.cost == pytest.approx(0.70467, rel=1e-4)


def test_the_last_pass_counts(sharp, monkeypatch):
    """As many passes as are needed are enough, without a warning."""
    first = mbd.optimize(sharp, intervals=16, tolerance=1e-6)
    assert len(first.statistics.passes) > 1
    monkeypatch.setattr("mbdcasadi.optimal_control.search.refine.PASSES", len(first.statistics.passes) - 1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert mbd.optimize(sharp, intervals=16, tolerance=1e-6).cost == pytest.approx(first.cost, rel=1e-12)


def test_of_meshes_that_pass_a_limit_by_far_the_finest_is_kept():
    """A speed has to be low for a moment, between two mesh points: with the least effort it costs much more."""
    problem, _, block = rest_to_rest()
    slow = problem.replace(path=[block.vx <= 0.3 + 1e7 * (mbd.t - 0.5129) ** 2])
    solution = mbd.optimize(slow)
    assert solution.cost > 34.9 and solution.trajectory.at(0.5129)[block.vx] <= 0.3 * 1.02
