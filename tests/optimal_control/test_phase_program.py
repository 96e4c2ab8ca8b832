"""Optimal control over several phases, against closed forms and independent references."""

import numpy as np
import pytest

import mbdcasadi as mbd

G = 9.81


def gripper(m=0.6, limit=4.0, at=2.0, beyond=0.3, L=1.0):
    """An arm that grips a resting load and brings it to rest: phases, and what the tests ask about."""
    place = L * np.array([np.cos(at), np.sin(at)])
    arm = mbd.Body("arm", mass=1.5, inertia=0.2, pose=(L / 2, 0, 0))
    load = mbd.Body("load", mass=m, inertia=0.05, pose=(*place, at))
    tau = mbd.Input("tau", lower=-limit, upper=limit)
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), arm.at(-L / 2, 0))
    table = mbd.Weld("table", mbd.ground.at(*place, angle=at), load.at(0, 0))
    grip = mbd.Weld("grip", arm.at(L / 2, 0), load.at(0, 0))
    motor = mbd.Torque("motor", arm, tau)
    reaching = mbd.Mechanism(bodies=[arm, load], joints=[hinge, table], forces=[motor], inputs=[tau])
    carrying = reaching.replace(joints=[hinge, grip])
    start = [hinge.angle == 0, arm.omega == 0]
    end = [hinge.angle == at + beyond, arm.omega == 0]
    J1 = 0.2 + 1.5 * (L / 2) ** 2
    J2 = J1 + m * L**2 + 0.05
    return arm, load, tau, hinge, grip, reaching, carrying, start, end, J1, J2


def soft(**more):
    """The gripper that matches the speed before it grips: least time in closed form."""
    arm, _load, _tau, _hinge, _grip, reaching, carrying, start, end, J1, J2 = gripper(**more)
    reach = mbd.Phase("reach", reaching, (0.05, 4), initial=start, final=[arm.omega == 0])
    carry = mbd.Phase("carry", carrying, (0.05, 4), final=end)
    problem = mbd.OptimalControlProblem(phases=[reach, carry], terminal_cost=mbd.t)
    return problem, 2 * np.sqrt(2.0 * J1 / 4.0) + 2 * np.sqrt(0.3 * J2 / 4.0)


@pytest.fixture(scope="module")
def gripped():
    problem, least = soft()
    return mbd.optimize(problem, intervals=20), least


def test_gripping_at_rest(gripped):
    solution, least = gripped
    assert solution.cost == pytest.approx(least, abs=1e-6)
    assert sum(solution.durations) == pytest.approx(solution.duration, abs=1e-12)
    assert solution.statistics.iterations <= 60


def test_a_solution_is_a_motion_with_a_change(gripped):
    solution, _ = gripped
    motion, first = solution.trajectory, solution.durations[0]
    reach, carry = solution.phases
    assert [part.mechanism for part in motion.phases] == [reach.phase.mechanism, carry.phase.mechanism]
    (event,) = motion.events
    assert event.t == pytest.approx(first, abs=1e-12) and event.name == "carry"
    grip = carry.phase.mechanism.joint("grip")
    force = motion[grip.reaction_on(grip.a.body).force]
    assert np.all(force[: len(reach.trajectory)] == 0)
    np.testing.assert_allclose(event.after[grip.impulse_on(grip.b.body).force], 0, atol=1e-6)
    assert motion.drift.position < 1e-10
    assert solution.mesh[0] == 0 and solution.mesh[-1] == pytest.approx(solution.duration)
    (tau,) = reach.phase.mechanism.inputs
    polynomial = solution.inputs[tau]
    np.testing.assert_allclose(polynomial(np.array([0.1, first + 0.1])), motion.at([0.1, first + 0.1])[tau], atol=1e-6)


def test_files(gripped, tmp_path):
    solution, _ = gripped
    solution.save(tmp_path / "grip.npz")
    again = mbd.read_solution(tmp_path / "grip.npz", solution.problem)
    assert again.cost == solution.cost and again.durations == solution.durations
    (one,) = (part for part in [solution.phases[0].phase])
    alone = mbd.OptimalControlProblem(
        one.mechanism, 1.0, initial=one.initial, running_cost=one.mechanism.inputs[0] ** 2
    )
    with pytest.raises(mbd.FileError):
        mbd.read_solution(tmp_path / "grip.npz", alone)


def test_a_solution_is_a_guess(gripped):
    solution, least = gripped
    again = mbd.optimize(solution.problem, intervals=20, guess=solution)
    assert again.cost == pytest.approx(solution.cost, abs=1e-9)
    assert again.statistics.iterations <= solution.statistics.iterations
    from_motion = mbd.optimize(solution.problem, intervals=20, guess=solution.trajectory)
    assert from_motion.cost == pytest.approx(least, abs=1e-6)


def test_least_time_with_an_impact():
    """The speed at the grip is as fast as can be braked afterwards; momentum about the hinge is kept."""
    arm, load, _tau, _hinge, grip, reaching, carrying, start, end, J1, J2 = gripper()
    reach = mbd.Phase("reach", reaching, (0.05, 3), initial=start)
    carry = mbd.Phase("carry", carrying, (0.05, 3), final=end)
    quick = mbd.optimize(mbd.OptimalControlProblem(phases=[reach, carry], terminal_cost=mbd.t), intervals=20)
    assert quick.cost == pytest.approx(1.23186849948, abs=3e-4)
    before, after = quick.phases[0].final, quick.phases[1].initial
    assert J1 * before[arm.omega] == pytest.approx(J2 * after[arm.omega], abs=1e-9)
    event = quick.trajectory.events[0]
    change = 0.6 * after[load.velocity]
    np.testing.assert_allclose(event.after[grip.impulse_on(load).force], change, atol=1e-8)


def test_limits_of_the_same_input_in_two_phases():
    """Each phase has its own costates; together they give T / (2 M), since T goes with 1 / sqrt(M)."""
    _arm, _load, tau, _hinge, _grip, reaching, carrying, start, end, *_ = gripper()
    reach = mbd.Phase("reach", reaching, (0.05, 3), initial=start)
    carry = mbd.Phase("carry", carrying, (0.05, 3), final=end)
    problem = mbd.OptimalControlProblem(phases=[reach, carry], terminal_cost=mbd.t)
    solution = mbd.optimize(problem, intervals=8, guess=mbd.optimize(problem, intervals=6))
    total = 0.0
    for part, phase in zip(solution.phases, ("reach", "carry"), strict=True):
        for side in ("tau <= 4", "tau >= -4"):
            total += np.sum(solution.costates[f"{side} in phase '{phase}'"] * np.diff(part.mesh_times))
    assert total == pytest.approx(solution.duration / 8, rel=1e-2)
    active = {limit.label: limit.spans for limit in solution.active_limits}
    ((begin, finish),) = active["tau >= -4 in phase 'carry'"]
    assert [begin, finish] == pytest.approx([solution.durations[0], solution.duration])
    assert "tau <= 4 in phase 'carry'" not in active and tau.upper == 4


@pytest.mark.slow
def test_costs_and_relations_of_phases():
    """Integrals over one phase and over all, durations and values between phases, against the running costs."""
    arm, _load, tau, _hinge, _grip, reaching, carrying, start, end, J1, J2 = gripper(limit=40.0)
    rest = [arm.omega == 0]
    plain = [
        mbd.Phase("reach", reaching, 0.8, initial=start, final=rest, running_cost=tau**2),
        mbd.Phase("carry", carrying, 0.5, final=end, running_cost=3 * tau**2),
    ]
    known = mbd.optimize(mbd.OptimalControlProblem(phases=plain), intervals=8)
    # rest to rest: cost 12 J² angle² / T³ each
    by_hand = 12 * J1**2 * 2.0**2 / 0.8**3 + 3 * 12 * J2**2 * 0.3**2 / 0.5**3
    assert known.cost == pytest.approx(by_hand, rel=1e-7)
    reach = mbd.Phase("reach", reaching, (0.2, 2), initial=start, final=rest)
    carry = mbd.Phase("carry", carrying, (0.2, 2), final=end)
    problem = mbd.OptimalControlProblem(
        phases=[reach, carry],
        terminal_cost=mbd.integral(tau**2) + 2 * carry.integral(tau**2),
        boundary=[reach.duration == 0.8, carry.duration == 0.5, carry.at_start(arm.omega) == reach.at_end(arm.omega)],
    )
    problem = problem.replace(boundary=problem.boundary[:2])
    assert mbd.optimize(problem, intervals=8).cost == pytest.approx(by_hand, rel=1e-6)


def test_waypoints_and_time_run_on():
    """A waypoint of the second phase counts from its start; time runs on."""
    arm, _load, tau, hinge, _grip, reaching, carrying, start, end, J1, _J2 = gripper(limit=40.0)
    via = mbd.Waypoint(0.2, [hinge.angle == 2.2])
    problem = mbd.OptimalControlProblem(
        phases=[
            mbd.Phase("reach", reaching, (0.5, 0.9), initial=start, final=[arm.omega == 0], running_cost=tau**2),
            mbd.Phase("carry", carrying, 0.5, final=end, waypoints=[via], running_cost=tau**2),
        ],
        terminal_cost=mbd.t,
    )
    solution = mbd.optimize(problem, intervals=10)
    first = solution.durations[0]
    assert solution.durations[1] == pytest.approx(0.5, abs=1e-9)
    assert solution.trajectory.at(first + 0.2)[hinge.angle][0] == pytest.approx(2.2, abs=1e-8)
    assert solution.waypoint_times[0] == pytest.approx(first + 0.2, abs=1e-9)
    energy = 12 * J1**2 * 4.0 / first**3
    assert first == pytest.approx(min(0.9, (3 * 12 * J1**2 * 4.0) ** 0.25), abs=1e-6) and energy > 0


def test_several_starts():
    """The usual guess, detours in every phase and the natural motion; all find the bounce, and each is reported."""
    ball = mbd.Body("ball", mass=0.4, inertia=4e-4, pose=(0, 1.0, 0))
    floor = mbd.AbsoluteY("floor", ball.at(0, 0), 0.0)
    free = mbd.Mechanism(bodies=[ball], forces=[mbd.Gravity()])
    start = [ball.x == 0, ball.y == 1, ball.phi == 0, ball.omega == 0]
    problem = mbd.OptimalControlProblem(
        phases=[
            mbd.Phase("thrown", free, (0.1, 1.5), initial=start),
            mbd.Phase("bounced", free, (0.1, 1.5), restitution={floor: 0.7}, final=[ball.x == 3, ball.y == 0]),
        ],
        terminal_cost=mbd.at_start(mbd.dot(ball.velocity, ball.velocity)),
    )
    solution = mbd.optimize(problem, intervals=4, starts=3)
    names = [start.description for start in solution.statistics.starts]
    assert names[0] == "kinematic" and len(names) == 3
    assert names[1].startswith("kinematic with detours of ") and names[1].count("half wave") == 2
    assert names[2] == "natural"
    assert solution.cost == pytest.approx(7.073680986, abs=1e-7)
    assert solution.cost == min(start.cost for start in solution.statistics.starts if np.isfinite(start.cost))


def test_a_bounce():
    h, X, e = 1.0, 3.0, 0.7
    ball = mbd.Body("ball", mass=0.4, inertia=4e-4, pose=(0, h, 0))
    floor = mbd.AbsoluteY("floor", ball.at(0, 0), 0.0)
    free = mbd.Mechanism(bodies=[ball], forces=[mbd.Gravity()])
    start = [ball.x == 0, ball.y == h, ball.phi == 0, ball.omega == 0]
    thrown = mbd.Phase("thrown", free, (0.1, 1.5), initial=start)
    bounced = mbd.Phase("bounced", free, (0.1, 1.5), restitution={floor: e}, final=[ball.x == X, ball.y == 0])
    cost = mbd.at_start(mbd.dot(ball.velocity, ball.velocity))
    lob = mbd.optimize(mbd.OptimalControlProblem(phases=[thrown, bounced], terminal_cost=cost), intervals=4)
    assert lob.cost == pytest.approx(7.073680986320, abs=1e-8)
    before, after = lob.phases[0].final, lob.phases[1].initial
    assert after[ball.vy] == pytest.approx(-e * before[ball.vy], abs=1e-10)
    assert after[ball.vx] == pytest.approx(before[ball.vx], abs=1e-12)
    check = lob.verify()
    assert check.final_error < 1e-8 and check.time_error < 1e-8 and check.impulse_error < 1e-8


def rimless():
    n, r, mass, J0, slope = 8, 1.0, 2.0, 0.1, 0.08
    half = np.pi / n
    wheel = mbd.Body("wheel", mass=mass, inertia=J0, pose=(-r * np.sin(half), r * np.cos(half), 0.0))
    ends = [wheel.at(r * np.sin(half), -r * np.cos(half)), wheel.at(r * np.sin(3 * half), -r * np.cos(3 * half))]
    pins = [mbd.Revolute(f"spoke {k}", mbd.ground.at(2 * r * np.sin(half) * k, 0), ends[k]) for k in range(2)]
    gravity = mbd.Gravity((G * np.sin(slope), -G * np.cos(slope)))
    on = [mbd.Mechanism(bodies=[wheel], joints=[pin], forces=[gravity]) for pin in pins]
    return (
        wheel,
        pins,
        mbd.OptimalControlProblem(
            phases=[mbd.Phase("roll", on[0], (0.3, 3), initial=[wheel.phi == 0]), mbd.Phase("spoke lands", on[1], 0)],
            boundary=[mbd.at_end(wheel.omega) == mbd.at_start(wheel.omega)],
        ),
    )


@pytest.mark.slow
def test_a_rimless_wheel_and_its_replay():
    wheel, _pins, problem = rimless()
    solution = mbd.optimize(problem, intervals=20)
    assert -solution.phases[0].initial[wheel.omega] == pytest.approx(1.1125347121964, abs=1e-9)
    assert solution.duration == pytest.approx(0.9600174925931, abs=1e-9)
    assert solution.statistics.iterations <= 15
    check = solution.verify()
    assert check.time_error < 1e-8 and check.final_error < 1e-8 and check.impulse_error < 1e-7
    assert check.event_times[0] == pytest.approx(0.9600174925931, abs=1e-8)
    assert "changes off by" in repr(check)
    refined = mbd.optimize(problem, intervals=4, tolerance=1e-8)
    assert refined.mesh_error < 1e-8 and refined.duration == pytest.approx(0.9600174925931, abs=1e-8)


@pytest.mark.slow
def test_an_impulse_may_be_limited():
    """The momentum of the load after the grip is bounded: the optimum goes to that bound."""
    arm, load, _tau, _hinge, grip, reaching, carrying, start, end, _J1, _J2 = gripper()
    limit = 0.4
    size = mbd.norm(grip.impulse_on(load).force)
    reach = mbd.Phase("reach", reaching, (0.05, 3), initial=start)
    carry = mbd.Phase("carry", carrying, (0.05, 3), initial=[size <= limit], final=end)
    solution = mbd.optimize(mbd.OptimalControlProblem(phases=[reach, carry], terminal_cost=mbd.t), intervals=20)
    event = solution.trajectory.events[0]
    assert event.after[size] == pytest.approx(limit, abs=1e-6)
    assert 0.6 * 1.0 * event.after[arm.omega] == pytest.approx(limit, abs=1e-6)


def test_redundant_impact_rows_are_picked():
    """A foot on a rail that gets pinned: its row across is held by the rail already."""
    foot = mbd.Body("foot", mass=1.0, inertia=0.1, pose=(0, 0.5, 0))
    f = mbd.Input("f")
    rail = mbd.Translational("rail", mbd.ground.at(0, 0, np.pi / 2), foot.at(0, 0, np.pi / 2))
    stands = mbd.Revolute("stands", mbd.ground.at(0, 0), foot.at(0, 0))
    push = mbd.Force("push", foot.at(0, 0), (0, f))
    air = mbd.Mechanism(bodies=[foot], joints=[rail], forces=[mbd.Gravity(), push], inputs=[f])
    ground = air.replace(joints=[rail, stands])
    fall = mbd.Phase("fall", air, 0.6, initial=[foot.y == 0.5, foot.vy == 0], running_cost=f**2)
    landed = mbd.Phase("landed", ground, 0)
    solution = mbd.optimize(mbd.OptimalControlProblem(phases=[fall, landed]), intervals=6)
    # least effort with a free end speed: a = c (T - t), c T³ / 3 = height - g T² / 2
    c = 3 * (-0.5 + G * 0.6**2 / 2) / 0.6**3
    assert solution.cost == pytest.approx(c**2 * 0.6**3 / 3, rel=1e-8)
    assert solution.phases[1].initial[foot.vy] == pytest.approx(0, abs=1e-10)
    event = solution.trajectory.events[0]
    assert event.after[stands.impulse_on(foot).force][1] == pytest.approx(-event.state[foot.vy], abs=1e-9)


def test_phases_say_what_is_wrong():
    arm, load, tau, _hinge, grip, reaching, carrying, start, end, _J1, _J2 = gripper()
    reach = mbd.Phase("reach", reaching, (0.05, 3), initial=start)
    carry = mbd.Phase("carry", carrying, (0.05, 3), final=end)
    problem = mbd.OptimalControlProblem

    def refused(match, kind=mbd.ModelError, **arguments):
        with pytest.raises(kind, match=match):
            problem(**arguments)

    refused("give a mechanism and a duration, or phases=")
    refused("phases= is empty", phases=[])
    refused("takes Phase objects", phases=[reaching])
    refused("belong to the phases", phases=[reach, carry], mechanism=reaching)
    refused("belong to the phases", phases=[reach, carry], path=[tau <= 1])
    refused("running_cost= belongs to the phases", phases=[reach, carry], running_cost=tau**2)
    refused("a name twice: reach, reach", phases=[reach, reach])
    shrinking = mbd.Phase("carry", carrying, (0, 3), final=end)
    refused("'carry': the duration may shrink to 0", phases=[reach, shrinking])
    instant = mbd.Phase("now", reaching, 0)
    refused("'now' is the first one", phases=[instant, carry])
    alone = mbd.Phase("alone", mbd.Mechanism(bodies=[load]), (0.1, 1))
    refused("'reach': 'arm' is not in the phase 'alone'", phases=[alone, reach])
    other = mbd.Phase("other", carrying, (0.05, 3))
    refused(
        "of a phase that does not belong to the problem",
        mbd.ExpressionError,
        phases=[reach, carry],
        boundary=[other.at_end(arm.omega) == 0],
    )
    refused(
        "which the mechanism of phase 'reach' does not have",
        mbd.ExpressionError,
        phases=[mbd.Phase("reach", reaching, 1, path=[grip.reaction_on(load).force[0] <= 1]), carry],
    )
    impulsive = mbd.Phase("reach", reaching, 1, initial=[grip.impulse_on(load).force[0] <= 1])
    refused("impulse", mbd.ExpressionError, phases=[impulsive, carry])
    with pytest.raises(mbd.ModelError, match="has no duration"):
        mbd.Phase("now", reaching, 0, path=[tau <= 1])
    landed = mbd.Phase("landed", carrying, 0, initial=[tau == 1])
    refused("not known at an instant", mbd.ExpressionError, phases=[reach, landed])
    good = problem(phases=[reach, carry], terminal_cost=mbd.t)
    with pytest.raises(mbd.ModelError, match="unknown argument"):
        good.replace(duration=2)
    with pytest.raises(mbd.ModelError, match="not those of the phases"):
        mbd.optimize(good, guess=mbd.simulate(reaching, duration=0.1))


@pytest.mark.slow
def test_a_failure_names_the_phase():
    _arm, _load, _tau, _hinge, _grip, reaching, carrying, start, end, _J1, _J2 = gripper(limit=0.1)
    reach = mbd.Phase("reach", reaching, (0.05, 0.3), initial=start)
    carry = mbd.Phase("carry", carrying, (0.05, 0.3), final=end)
    with pytest.raises(mbd.OptimizationError, match="phase '(reach|carry)'") as caught:
        mbd.optimize(mbd.OptimalControlProblem(phases=[reach, carry], terminal_cost=mbd.t), intervals=8)
    assert caught.value.largest_violations


def test_an_integral_over_the_motion_passes_over_instants():
    """A block of 1 kg that slides at 1 m/s and then is stopped within 1 s by least force costs 1 N²s."""
    block, brake = mbd.Body("block", mass=1.0, inertia=1.0), mbd.Input("brake")
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), block.at(0, 0))
    free = mbd.Mechanism(bodies=[block], joints=[rail])
    braked = free.replace(forces=[mbd.Force("brake", block.at(0, 0), (brake, 0))], inputs=[brake])
    problem = mbd.OptimalControlProblem(
        phases=[
            mbd.Phase("slide", free, 1.0, initial=[block.x == 0, block.vx == 1]),
            mbd.Phase("touch", braked, 0.0),
            mbd.Phase("stop", braked, 1.0, final=[block.vx == 0]),
        ],
        terminal_cost=mbd.integral(brake**2),
    )
    solution = mbd.optimize(problem, intervals=4)
    assert solution.cost == pytest.approx(1.0, rel=1e-6)
    assert solution.trajectory.final[block.x] == pytest.approx(1.5, abs=1e-6)


@pytest.mark.parametrize("restitution", [0.7, 1.0])
def test_a_bounce_is_as_high_as_by_hand(restitution):
    """A block falls 1 m, pushed down by 3 N, bounces, and rises, pushed up.

    Its poses in the rise of the guess differ by rounding alone, which is no size of the motion.
    """
    block = mbd.Body("block", mass=1.0, inertia=1.0, pose=(0, 1, 0))
    guide = mbd.Translational("guide", mbd.ground.at(0, 0, angle=np.pi / 2), block.at(0, 0, angle=np.pi / 2))
    push = mbd.Input("push", lower=-3, upper=3)
    forces = [mbd.Gravity(), mbd.Force("force", block.at(0, 0), (0, push))]
    falling = mbd.Mechanism([block], [guide], forces=forces, inputs=[push])
    floor = mbd.PointOnLine("floor", block.at(0, 0), mbd.ground.at(0, 0))
    down = mbd.Phase("down", falling, (0.1, 3), initial=[block.y == 1, block.vy == 0])
    up = mbd.Phase("up", falling.replace(), (0.05, 3), final=[block.vy == 0], restitution={floor: restitution})
    solution = mbd.optimize(mbd.OptimalControlProblem(phases=[down, up], terminal_cost=-block.y))
    assert solution.cost == pytest.approx(-(restitution**2) * (9.81 + 3) / (9.81 - 3), rel=1e-7)
    assert solution.durations[0] == pytest.approx(np.sqrt(2 / (9.81 + 3)), rel=1e-6)
    assert not solution.statistics.stages


def test_parameters_of_one_phase():
    """A spring of one phase alone throws a body up: k x² / (2 m g) - x above its release."""
    k = mbd.Parameter("k", 50.0, lower=1, upper=500)
    body = mbd.Body("body", mass=1, inertia=1, pose=(0, -0.1, 0))
    rail = mbd.Translational("rail", mbd.ground.at(0, 0, angle=np.pi / 2), body.at(0, 0, angle=np.pi / 2))
    off = mbd.Mechanism([body], joints=[rail], forces=[mbd.Gravity((0, -G))])
    spring = mbd.Force("spring", body.at(0, 0), (0, -k * body.y))
    on = off.replace(forces=[*off.forces, spring], parameters=[k])
    push = mbd.Phase("push", on, (0.05, 1), initial=[body.y == -0.3, body.vy == 0], final=[body.y == 0])
    phases = [push, mbd.Phase("flight", off, (0.05, 3), final=[body.vy == 0])]
    problem = mbd.OptimalControlProblem(phases=phases, terminal_cost=-body.y)
    found = mbd.optimize(problem, intervals=6, parameters={k: 100.0})
    assert -found.cost == pytest.approx(100 * 0.3**2 / (2 * G) - 0.3, rel=1e-6)
    with pytest.raises(mbd.ModelError, match="'c', which is not in the mechanism; it has 'k'"):
        mbd.optimize(problem, intervals=6, parameters={mbd.Parameter("c", 1.0): 2.0})


def test_a_state_brings_its_parameters_to_all_phases():
    """Gravity that a start carries acts in the phases that follow, too: a height of v² / (2 g)."""
    g = mbd.Parameter("g", 9.0)
    body = mbd.Body("body", mass=1, inertia=1)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0, angle=np.pi / 2), body.at(0, 0, angle=np.pi / 2))
    one = mbd.Mechanism([body], joints=[rail], forces=[mbd.Gravity((0, -g))], parameters=[g])
    other = mbd.Mechanism([body], joints=[rail], forces=[mbd.Gravity((0, -g))], parameters=[g])
    start = mbd.assemble(one, [body.y == 0, body.vy == 2], parameters={g: 3.0})
    phases = [mbd.Phase("first", one, 0.1, initial=start), mbd.Phase("second", other, (0.01, 3), final=[body.vy == 0])]
    found = mbd.optimize(mbd.OptimalControlProblem(phases=phases, terminal_cost=-body.y), intervals=4)
    assert -found.cost == pytest.approx(2**2 / (2 * 3.0), rel=1e-8)


def from_bar_to_bar():
    """Two links with a motor in the elbow that swing on a bar, and go on on the next one, which the hand takes."""
    a = mbd.Body("a", 1, 1 / 48, pose=(-0.15, -0.2, np.arctan2(-0.4, -0.3)))
    b = mbd.Body("b", 1, 1 / 48, pose=(-0.15, -0.6, np.arctan2(-0.4, 0.3)))
    u = mbd.Input("u", lower=-20, upper=20)
    hold, elbow = (
        mbd.Revolute(n, x, y)
        for n, x, y in (("hold", mbd.ground.at(0, 0), a.at(-0.25, 0)), ("elbow", a.at(0.25, 0), b.at(-0.25, 0)))
    )
    grasp = mbd.Revolute("grasp", mbd.ground.at(0.6, 0), b.at(0.25, 0))
    first = mbd.Mechanism(
        [a, b], joints=[hold, elbow], forces=[mbd.Gravity(), mbd.Torque("motor", b, u, opposite=a)], inputs=[u]
    )
    start = [a.phi == -np.pi / 2 - 0.5, b.phi == -np.pi / 2, a.omega == 0, b.omega == 0]
    swing = mbd.Phase("swing", first, (0.3, 2), initial=start, running_cost=u**2)
    end, impulse = [a.at(-0.25, 0).x == 0.8, a.omega == 0], mbd.norm(grasp.impulse_on(b).force)
    catch = mbd.Phase(
        "catch", first.replace(joints=[elbow, grasp]), (0.3, 2), initial=[impulse <= 3], final=end, running_cost=u**2
    )
    return mbd.OptimalControlProblem(phases=[swing, catch]), grasp


def test_states_at_the_points_of_the_mesh():
    """Through all phases; at a change the state just before it, as everywhere in the motion."""
    problem, _ = from_bar_to_bar()
    solution = mbd.optimize(problem, intervals=[6, 4])
    states = [solution.state(k) for k in range(11)]
    np.testing.assert_allclose([state.t for state in states], solution.mesh)
    swing, catch = problem.phases
    assert [s.mechanism for s in states] == [swing.mechanism] * 7 + [catch.mechanism] * 4
    np.testing.assert_allclose(states[6].v, solution.trajectory.at(solution.mesh[[6]]).v[0], atol=1e-9)
    assert solution.state(-11).t == 0
    with pytest.raises(mbd.MechanismError, match="11 mesh points, and none of index 11"):
        solution.state(11)


@pytest.mark.slow
def test_open_chains_keep_their_angles_alone_in_phases_too():
    """With the impulses of all joints at the change; in all coordinates the motion is an optimum as well."""
    problem, grasp = from_bar_to_bar()
    solution = mbd.optimize(problem, intervals=30)
    assert [part.program.scheme.eom.is_chain for part in solution.phases] == [True, True]
    assert np.max(solution.verify().defects) < 1e-3 and solution.verify().time_error < 1e-4
    whole = mbd.optimize(problem, intervals=30, guess=solution.trajectory)
    assert [part.program.scheme.eom.is_chain for part in whole.phases] == [False, False]
    assert whole.statistics.variables > 2 * solution.statistics.variables
    assert whole.cost == pytest.approx(solution.cost, rel=3e-3)
    impulses = [one.trajectory.events[0].after.impulses[grasp] for one in (solution, whole)]
    np.testing.assert_allclose(impulses[0], impulses[1], rtol=0.02)


def test_only_the_phases_that_are_chains():
    """A chain whose end a latch takes is a loop afterwards, in all coordinates."""
    problem, grasp = from_bar_to_bar()
    swing, _ = problem.phases
    held = swing.mechanism.replace(joints=[*swing.mechanism.joints, grasp])
    solution = mbd.optimize(problem.replace(phases=[swing, mbd.Phase("held", held, 0)]), intervals=20)
    assert [part.program.scheme.eom.is_chain for part in solution.phases] == [True, False]
    assert solution.state(-1).t == solution.duration and solution.state(20).mechanism is swing.mechanism


def taken_along(load=0.5, restitution=0.0, own=True):
    """A cart takes a block along by a plastic impact, or bounces off; a damper of both phases, or one of each."""
    u, c = mbd.Input("u", lower=-9, upper=9), mbd.Parameter("c", 0.3)
    cart, block = mbd.Body("cart", 1, 1), mbd.Body("block", load, 1, pose=(1, 0, 0))
    rails = [mbd.Translational(f"rail of {x.name}", mbd.ground.at(0, 0), x.at(0, 0)) for x in (cart, block)]
    meet = mbd.Weld("meet", cart.at(1, 0), block.at(0, 0))
    other = c if own else mbd.Parameter("c", 0.3)

    def damped(joints, parameter):
        forces = [mbd.Force("push", cart.at(0, 0), (u - parameter * cart.vx, 0))]
        return mbd.Mechanism([cart, block], joints=joints, forces=forces, inputs=[u], parameters=[parameter])

    go = mbd.Phase("go", damped(rails, c), (0.2, 3), [cart.x == -0.5, cart.vx == 0, block.vx == 0], running_cost=u**2)
    more = {"restitution": {meet: restitution}} if restitution else {}
    joints = rails if restitution else [rails[0], meet]
    on = mbd.Phase("on", damped(joints, other), (0.2, 3), final=[block.x == 2], running_cost=u**2, **more)
    return mbd.OptimalControlProblem(phases=[go, on], terminal_cost=mbd.t)


@pytest.mark.slow
def test_phases_that_are_stated_again_share_what_was_compiled():
    """What differs is told apart: masses, joints and coefficients of the change alone, parameters that are two."""
    first, again = (mbd.optimize(taken_along(), intervals=6) for _ in range(2))
    assert first.program.nlp is again.program.nlp and first.cost == pytest.approx(again.cost, rel=1e-12)
    assert again.trajectory.mechanism is not first.trajectory.mechanism
    kinds = [{}, {"load": 0.6}, {"own": False}, {"restitution": 0.2}, {"restitution": 0.4}]
    contents = [taken_along(**kind).contents for kind in kinds]
    assert None not in contents and len(set(contents)) == len(kinds)
    lighter, heavier = (mbd.optimize(taken_along(load=load), intervals=6).cost for load in (0.2, 0.9))
    assert lighter < first.cost < heavier
