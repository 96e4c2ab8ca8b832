"""Waypoints and ends out of reach are reported before anything is solved; what can be reached is never refused."""

import numpy as np
import pytest
from motions import LENGTHS, crank_rocker, half_turn

import mbdcasadi as mbd
from mbdcasadi import library
from mbdcasadi.optimal_control.program.setup import Settings
from mbdcasadi.optimal_control.search.reach import check_reach
from mbdcasadi.optimal_control.search.search import usual_guesses
from mbdcasadi.optimal_control.search.starts import Starts
from mbdcasadi.optimal_control.solve.problem_solver import ProblemSolver


def arm(count=2, length=0.5, parameters=()):
    """A chain of driven links in the horizontal plane, stretched along x; its links, hinges, last point and torques."""
    links, hinges, motors, last = [], [], [], mbd.ground.at(0, 0)
    torques = [mbd.Input(f"tau {k}") for k in range(count)]
    for k, torque in enumerate(torques):
        link = mbd.Body(f"link {k}", mass=1.0, inertia=0.03, pose=((k + 0.5) * 0.5, 0, 0))
        hinges.append(mbd.Revolute(f"hinge {k}", last, link.at(-length / 2, 0)))
        motors.append(mbd.Torque(f"motor {k}", link, torque, *links[-1:]))
        links.append(link)
        last = link.at(length / 2, 0)
    mechanism = mbd.Mechanism(links, hinges, forces=motors, inputs=torques, parameters=list(parameters))
    return mechanism, links, last, torques


def reaching(x, y, *, path=(), waypoint=None, free=(), length=0.5, count=2):
    """The arm from rest to rest at a place of its last point."""
    mechanism, links, tip, torques = arm(count, length, free)
    rest = [link.omega == 0 for link in links]
    start = [link.phi == angle for link, angle in zip(links, (0.3, 0.8, 1.0), strict=False)]
    waypoints = [] if waypoint is None else [mbd.Waypoint(0.5, [tip.x == waypoint[0], tip.y == waypoint[1]])]
    return mbd.OptimalControlProblem(
        mechanism,
        duration=1.0,
        initial=[*start, *rest],
        final=[tip.x == x, tip.y == y, *rest],
        path=path(links, tip) if callable(path) else path,
        waypoints=waypoints,
        running_cost=sum(torque**2 for torque in torques),
        free_parameters=free,
    )


def refused(problem, **settings):
    """The error of a problem that is refused before anything is solved."""
    with pytest.raises(mbd.OptimizationError, match="out of reach") as caught:
        mbd.optimize(problem, **settings)
    error = caught.value
    assert error.partial is None and "nothing was solved" in str(error)
    assert error.conflict == tuple(error.largest_violations) and "infeasible" in str(error)
    return error


def test_an_end_out_of_reach():
    """A target 1.3 m away and an arm of 1 m, which stretches towards it: the rest of 0.3 m is missed."""
    error = refused(reaching(1.2, 0.5))
    missed = {violation.label.split(" + ")[0]: violation for violation in error.conflict}
    assert missed["final: link 1.x"].violation == pytest.approx(1.2 * 0.3 / 1.3, rel=1e-3)
    assert missed["final: link 1.y"].violation == pytest.approx(0.5 * 0.3 / 1.3, rel=1e-3)
    assert all(v.unit == "m" and v.time == 1.0 for v in error.conflict) and error.time == 1.0
    assert "the end is out of reach" in str(error) and "held back by 'hinge 0', 'hinge 1'" in str(error)
    assert "by 0.277 m at t = 1 s" in str(error)


def test_a_waypoint_out_of_reach():
    error = refused(reaching(0.6, 0.3, waypoint=(0.0, -1.1)))
    assert "waypoint 1 is out of reach" in str(error) and error.time == 0.5
    (violation,) = error.conflict
    assert violation.violation == pytest.approx(0.1, rel=1e-4) and "link 1.y" in violation.label


def rocker_range():
    """Least and largest angle of the rocker on the upper branch, where crank and coupler are in line."""
    a, b, c, d = LENGTHS
    return [np.pi - np.arccos((c**2 + d**2 - (b + side * a) ** 2) / (2 * c * d)) for side in (1, -1)]


@pytest.mark.parametrize("goal", [0.2, np.pi])
def test_an_angle_between_the_branches(goal):
    """The rocker reaches a range of angles, and on the other branch its mirror image: not what is between these."""
    f = crank_rocker()
    low, high = rocker_range()
    error = refused(half_turn(f, final=[f.rocker.phi == goal, f.rocker.omega == 0]), intervals=10)
    (violation,) = error.conflict
    assert violation.label == f"final: rocker.phi == {goal:.6g}" and violation.unit == "rad"
    missed = max(low - goal, goal - high)
    assert violation.violation == pytest.approx(missed, rel=1e-4)
    for joint in ("O2", "A", "B", "O4"):
        assert f"'{joint}'" in str(error)


def not_reached(problem, reason):
    """The error of a problem with a place to which no continuous motion leads, before anything is solved."""
    with pytest.raises(mbd.OptimizationError, match=reason) as caught:
        mbd.optimize(problem)
    error = caught.value
    assert error.partial is None and "nothing was solved" in str(error) and "infeasible" in str(error)
    assert error.conflict == tuple(error.largest_violations)
    return error


def is_refused(problem):
    """Whether a problem is refused before it is solved."""
    solver = ProblemSolver(problem, Settings.read("gauss-legendre", 3, "polynomial", None, False))
    try:
        check_reach(solver, usual_guesses(solver))
    except mbd.OptimizationError:
        return True
    return False


def four_bar_to(final, *, initial=1.0, **more):
    """A crank-rocker from rest at an angle of the crank to conditions at the end."""
    f = more.pop("model", None) or library.four_bar()
    make = final(f) if callable(final) else final
    more = {name: value(f) if callable(value) else value for name, value in more.items()}
    return mbd.OptimalControlProblem(
        f.mechanism, duration=1.0, initial=[f.crank.phi == initial, f.crank.omega == 0], final=make,
        running_cost=f.tau**2, **more,
    )  # fmt: skip


def test_a_turn_that_the_rocker_cannot_make():
    """A rocker swings: its angle three turns further on is not reached, though the pose is the same."""
    f = crank_rocker()
    _, high = rocker_range()
    error = not_reached(half_turn(f, final=[f.rocker.phi == 2.0 + 6 * np.pi, f.rocker.omega == 0]), "a turn that")
    (violation,) = error.conflict
    assert violation.violation == pytest.approx(2.0 + 6 * np.pi - high, abs=0.01)


def test_the_other_assembly_of_a_slider_crank():
    """The rod points to one side: from there the slider goes from 0.2 to 0.4 m, and on the other branch to -0.3 m."""
    m = library.slider_crank(crank=0.1, rod=0.3)

    def to(x):
        start = [m.crank.phi == 0.5, m.crank.omega == 0]
        return mbd.OptimalControlProblem(m.mechanism, 1.0, start, [m.slider.x == x], running_cost=m.tau**2)

    error = not_reached(to(-0.3), "the end is on another branch of the linkage.*another assembly configuration")
    (violation,) = error.conflict
    assert violation.violation == pytest.approx(0.5, abs=2e-3) and violation.unit == "m"
    assert not is_refused(to(0.2)) and not is_refused(to(0.4)) and is_refused(to(0.19))


def mirrored_state(crank):
    """The state of the other assembly of the four-bar, at rest."""
    f, other = library.four_bar(), library.four_bar(open=False)
    here = mbd.assemble(f.mechanism, [f.crank.phi == crank])
    there = mbd.assemble(other.mechanism, [other.crank.phi == crank])
    rest = np.zeros(there.v.size)
    state = mbd.State(f.mechanism, 1.0, there.q, rest, rest, here.z, 0 * here.lam, here.inputs, here.parameters)
    return f, here, state


def test_a_state_of_the_other_assembly():
    f, here, state = mirrored_state(2.0)
    error = not_reached(four_bar_to(state, model=f), "on another branch")
    assert "final: rocker.phi" in str(error)
    same = mbd.State(
        f.mechanism, 1.0, here.q, 0 * here.v, 0 * here.a, here.z, 0 * here.lam, here.inputs, here.parameters
    )
    assert not is_refused(four_bar_to(same, model=f))


def test_a_waypoint_on_the_other_branch():
    rocker = float(mirrored_state(2.0)[2].q[8])
    point = lambda f: [mbd.Waypoint(0.5, [f.rocker.phi == rocker])]  # noqa: E731
    error = not_reached(four_bar_to(lambda f: [f.crank.phi == 3], waypoints=point), "waypoint 1 is on another branch")
    assert error.time == 0.5


def test_a_branch_is_that_of_all_phases_that_keep_the_joints():
    """A load that the rocker takes along changes nothing; once a joint has opened the other assembly may be reached."""
    rocker = float(mirrored_state(2.0)[2].q[8])
    f = library.four_bar()
    start = [f.crank.phi == 1.0, f.crank.omega == 0]

    def problem(later):
        go = mbd.Phase("go", f.mechanism, 1.0, initial=start, final=[f.crank.phi == 2], running_cost=f.tau**2)
        on = mbd.Phase("on", later, 1.0, final=[f.rocker.phi == rocker], running_cost=f.tau**2)
        return mbd.OptimalControlProblem(phases=[go, on])

    spring = mbd.RSDA("spring", mbd.ground.at(0, 0), f.crank.at(0, 0), stiffness=1.0)
    loaded = f.mechanism.replace(forces=[*f.mechanism.forces, spring])
    not_reached(problem(loaded), "the end of phase 'on' is on another branch")
    opened = f.mechanism.replace(joints=[joint for joint in f.mechanism.joints if joint is not f.C])
    assert not is_refused(problem(opened))


def test_a_way_that_a_limit_blocks():
    """The crank passes the pose in which the rocker is farthest: with less for the rocker it turns back before."""
    f = library.four_bar()
    farthest = float(np.max(mbd.kinematics(f.driven(crank=mbd.t), np.linspace(1, 7, 400))[f.rocker.phi]))

    def limited(most, goal):
        return four_bar_to(lambda f: [f.crank.phi == goal], path=lambda f: [f.rocker.phi <= most])

    error = not_reached(limited(farthest - 0.3, 6.2), "cannot be reached within the path limits")
    assert f"breaks rocker.phi <= {farthest - 0.3:.6g}" in str(error)
    assert not is_refused(limited(farthest + 1e-3, 6.2)) and not is_refused(limited(farthest - 0.3, -0.08))


def test_the_branches_of_a_parallelogram_meet():
    """Stretched out it may go on as an antiparallelogram: nothing is out of reach for a continuous motion."""
    f, other = (library.four_bar(0.2, 0.5, 0.2, 0.5, open=is_open) for is_open in (True, False))
    crossed = mbd.assemble(other.mechanism, [other.crank.phi == 1.0])
    assert abs(float(crossed[other.rocker.phi]) - 1.0) > 0.5
    rocker = float(crossed[other.rocker.phi])
    assert not is_refused(four_bar_to([f.crank.phi == 1.0, f.rocker.phi == rocker], initial=0.5, model=f))


def test_what_hangs_on_a_loop_does_not_open_it():
    """A pendulum on the coupler adds a degree of freedom, and leads to no other branch."""
    f, rocker = library.four_bar(), float(mirrored_state(2.0)[2].q[8])
    bob = mbd.Body("bob", mass=0.2, inertia=1e-3, pose=(0.3, 0, 0))
    hung = f.mechanism.replace(
        bodies=[*f.mechanism.bodies, bob],
        joints=[*f.mechanism.joints, mbd.Revolute("P", f.coupler.at(0, 0), bob.at(0, 0.2))],
    )
    start = [f.crank.phi == 1, f.crank.omega == 0, bob.phi == 0, bob.omega == 0]

    def to(rocker):
        end = [f.rocker.phi == rocker, bob.omega == 0]
        return mbd.OptimalControlProblem(hung, 1.0, start, end, running_cost=f.tau**2)

    not_reached(to(rocker), "another branch")
    assert not is_refused(to(2.0))


def test_free_lengths_lead_to_other_branches():
    """A linkage whose rocker may become longer than its coupler less the rest is no crank-rocker any more."""
    length, rocker = mbd.Parameter("l", 0.4, lower=0.3, upper=0.6), float(mirrored_state(2.0)[2].q[8])
    f = library.four_bar()
    bar = f.rocker
    joints = [
        *f.mechanism.joints[:2],
        mbd.Revolute("C", f.coupler.at(0.25, 0), bar.at(length - 0.2, 0)),
        mbd.Revolute("D", mbd.ground.at(0.55, 0), bar.at(-0.2, 0)),
    ]
    free = f.mechanism.replace(joints=joints, parameters=[length])
    problem = mbd.OptimalControlProblem(
        free, 1.0, [f.crank.phi == 1, f.crank.omega == 0], [f.rocker.phi == rocker], running_cost=f.tau**2,
        free_parameters=[length],
    )  # fmt: skip
    assert not is_refused(problem)


@pytest.mark.slow
def test_gears_that_come_back_only_nearly():
    """A five-bar whose cranks are geared by 1001 to 999 teeth: after thirty turns one is ahead by 0.38 rad."""
    left, right = (mbd.Body(name, mass=1, inertia=0.01, pose=(x, 0, np.pi / 2)) for name, x in (("l", 0), ("r", 0.3)))
    a, b = (mbd.Body(n, mass=1, inertia=0.01, pose=(x, 0.2, phi)) for n, x, phi in (("a", 0.07, 1.1), ("b", 0.23, 2)))
    tau = mbd.Input("tau")
    joints = [
        mbd.Revolute("L", mbd.ground.at(0, 0), left.at(0, 0)),
        mbd.Revolute("R", mbd.ground.at(0.3, 0), right.at(0, 0)),
        mbd.Revolute("A", left.at(0.05, 0), a.at(-0.15, 0)),
        mbd.Revolute("B", right.at(0.06, 0), b.at(-0.15, 0)),
        mbd.Revolute("C", a.at(0.15, 0), b.at(0.15, 0)),
        mbd.Gear("mesh", left.at(0, 0), right.at(0, 0), 0.15015, 0.14985),
    ]
    mechanism = mbd.Mechanism([left, right, a, b], joints, forces=[mbd.Torque("motor", left, tau)], inputs=[tau])
    start, turns = [left.phi == np.pi / 2, left.omega == 0], 2 * np.pi * 30.3
    driver = mbd.Driver("turn", left.phi, np.pi / 2 + turns * mbd.t)
    motion = mbd.kinematics(mechanism.replace(drivers=[driver]), np.linspace(0, 1, 1201))
    end = [b.phi == float(motion[b.phi][-1]) for b in (left, a)]
    assert not is_refused(mbd.OptimalControlProblem(mechanism, 1.0, start, end, running_cost=tau**2))


def random_linkage(kind, random):
    """A four-bar, a slider-crank or a five-bar of random lengths, and conditions of a start at rest."""
    while True:
        lengths = random.uniform(0.1, 0.5, 5)
        try:
            if kind == "four-bar":
                m = library.four_bar(*lengths[:4], open=bool(random.integers(2)))
            elif kind == "slider-crank":
                m = library.slider_crank(*lengths[:2], offset=lengths[2] - 0.3)
            else:
                m = library.five_bar(*lengths[:3])
            break
        except mbd.ModelError:
            continue
    cranks = [m.left, m.right] if kind == "five-bar" else [m.crank]
    return m, [c for b in cranks for c in (b.phi == float(b.pose_estimate[2]), b.omega == 0)]


def simulated_to(m, start, random):
    """A problem from a start to where a motion under random torques leads, within the ranges that it has."""
    mechanism, duration = m.mechanism, random.uniform(0.5, 2)
    waves = {
        u: sum(
            2 * float(a) * mbd.sin((k + 1) * np.pi * mbd.t / duration + float(b))
            for k, (a, b) in enumerate(random.normal(size=(3, 2)))
        )
        for u in mechanism.inputs
    }
    motion = mbd.simulate(mechanism, np.linspace(0, duration, 201), initial=start, inputs=waves)
    ranges = {b: motion[b.phi] for b in mechanism.bodies if np.ptp(motion[b.phi]) > 1e-6}
    path = [mbd.bounded(np.min(x) - 1e-4, b.phi, np.max(x) + 1e-4) for b, x in ranges.items()]
    body, angle = list(ranges.items())[random.integers(len(ranges))]
    way = [mbd.Waypoint(duration / 2, [body.phi == float(angle[100])])]
    cost = sum(u**2 for u in mechanism.inputs)
    final = motion.final if random.integers(2) else [body.phi == float(angle[-1])]
    return mbd.OptimalControlProblem(mechanism, duration, start, final, path=path, waypoints=way, running_cost=cost)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["four-bar", "slider-crank", "five-bar"])
@pytest.mark.parametrize("seed", range(5))
def test_what_a_motion_reaches_is_not_refused(kind, seed):
    random = np.random.default_rng([seed, 17])
    assert not is_refused(simulated_to(*random_linkage(kind, random), random))


def test_joints_that_hold_nothing_back_are_not_named():
    """A second loop that is far from its limits does not keep the rocker from going on."""
    f = crank_rocker()
    swing = mbd.Body("swing", mass=0.1, inertia=1e-3, pose=(0.3, -0.2, 0))
    loose = mbd.Revolute("loose", mbd.ground.at(0.3, -0.1), swing.at(0, 0.1))
    wider = f.mechanism.replace(bodies=[*f.mechanism.bodies, swing], joints=[*f.mechanism.joints, loose])
    error = refused(half_turn(f, mechanism=wider, final=[f.rocker.phi == np.pi]))
    assert "'O4'" in str(error) and "loose" not in str(error)


def test_limits_of_joints_take_part():
    """A target that an arm reaches with its elbow bent by 2 rad, and which lets it bend by 1 rad alone."""
    goal = np.sqrt(0.5 + 0.5 * np.cos(2.0))  # links of 0.5 m

    def limited(most):
        return reaching(goal, 0.0, path=lambda links, _: [mbd.bounded(-most, links[1].phi - links[0].phi, most)])

    assert mbd.optimize(limited(2.05), intervals=10).cost > 0
    error = refused(limited(1.0))
    labels = [violation.label for violation in error.conflict]
    assert any("link 1.phi - link 0.phi" in label for label in labels) and any("final" in label for label in labels)


def test_the_other_elbow_is_found():
    """The assembly bends the elbow to the side that a limit forbids, which contradicts nothing: there is another."""
    problem = reaching(0.3, 0.5, path=lambda links, _: [links[1].phi - links[0].phi <= 0.6])
    solution = mbd.optimize(problem, intervals=20)
    links = problem.mechanism.bodies
    assert solution.trajectory.final[links[1].phi - links[0].phi] < 0


@pytest.mark.parametrize("longest", [0.6, 0.7])
def test_free_lengths_take_part(longest):
    """Two links of free length reach 1.3 m if each may be longer than 0.65 m; else the limit is named."""
    length = mbd.Parameter("l", 0.5, lower=0.3, upper=longest)
    problem = reaching(1.2, 0.5, free=[length], length=length)
    if longest > 0.65:
        assert mbd.optimize(problem, intervals=10).parameters[length] >= 0.65 - 1e-9
        return
    error = refused(problem)
    assert sum(v.violation**2 for v in error.conflict) == pytest.approx((1.3 - 2 * longest) ** 2, rel=1e-2)
    assert f"l <= {longest:g}" in str(error)


def carried(duration):
    """An arm of 1 m whose base a drive moves along x at 1 m/s; its tip shall be at x = 3, y = 0."""
    base = mbd.Body("base", mass=1.0, inertia=0.1)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), base.at(0, 0))
    tau = mbd.Input("tau")
    link = mbd.Body("link", mass=1.0, inertia=0.1, pose=(0.5, 0, 0))
    hinge = mbd.Revolute("hinge", base.at(0, 0), link.at(-0.5, 0))
    mechanism = mbd.Mechanism(
        [base, link], [rail, hinge], drivers=[mbd.Driver("drive", base.x, mbd.t)],
        forces=[mbd.Torque("motor", link, tau)], inputs=[tau],
    )  # fmt: skip
    tip = link.at(0.5, 0)
    return mbd.OptimalControlProblem(
        mechanism, duration, initial=[link.phi == 1, link.omega == 0], final=[tip.x == 3], running_cost=tau**2
    )


def test_free_times_take_part():
    """The base is within 1 m of the goal from t = 2 s on."""
    assert mbd.optimize(carried((0.5, 2.5)), intervals=10).duration >= 2 - 1e-9
    error = refused(carried((0.5, 1.5)))
    assert error.conflict[0].violation == pytest.approx(0.5, rel=1e-4) and error.time == pytest.approx(1.5, rel=1e-4)
    assert "'drive'" in str(error)


@pytest.mark.parametrize("distance", [0.9, 1.2])
def test_a_latch_out_of_reach(distance):
    """What the mechanism of the next phase closes belongs to the end of the phase before."""
    mechanism, links, tip, torques = arm()
    latch = mbd.Revolute("latch", mbd.ground.at(distance, 0.0), tip)
    latched = mechanism.replace(joints=[*mechanism.joints, latch])
    come = mbd.Phase(
        "come", mechanism, 1.0, initial=[links[0].phi == 0.3, links[1].phi == 1, *[b.omega == 0 for b in links]],
        running_cost=torques[0] ** 2 + torques[1] ** 2,
    )  # fmt: skip
    problem = mbd.OptimalControlProblem(phases=[come, mbd.Phase("latched", latched, 0)])
    if distance < 1:
        assert mbd.optimize(problem, intervals=10).cost > 0
        return
    error = refused(problem, intervals=10)
    assert "the end of phase 'come' is out of reach" in str(error)
    (violation,) = error.conflict
    assert violation.label == "change into phase 'latched': latch.x closes"
    assert violation.violation == pytest.approx(0.2, rel=1e-4) and violation.unit == "m"


def test_other_poses_at_the_end_are_starts():
    """An arm reaches a place with its elbow on either side, and by the law of cosines at one angle."""
    problem = reaching(0.3, 0.5)
    solver = ProblemSolver(problem, Settings.read("gauss-legendre", 3, "polynomial", None, False))
    usual = solver.setups[0].path.poses[-1]
    other = Starts(solver).to_other_ends(1)[0]
    sampled = other.phases[0].sample(np.array([0.0, 1.0]))["q"]
    bend = np.arccos((0.3**2 + 0.5**2 - 2 * 0.5**2) / (2 * 0.5**2))
    assert abs(usual[5] - usual[2]) == pytest.approx(bend, rel=1e-6)
    assert sampled[-1][5] - sampled[-1][2] == pytest.approx(-(usual[5] - usual[2]), rel=1e-6)
    assert sampled[0][[2, 5]] == pytest.approx((0.3, 0.8), abs=1e-9)
