"""Places that a linkage reaches with other values of its free parameters than those of the estimate."""

import numpy as np
import pytest

import mbdcasadi as mbd


def pendulum(lower=0.1, upper=3.0):
    """A bob at a free length of 1 m to begin with, below a pin; the mechanism, bob, length and torque."""
    length, tau = mbd.Parameter("l", 1.0, lower=lower, upper=upper), mbd.Input("tau")
    bob = mbd.Body("bob", mass=1.0, inertia=0.1, pose=(0, -1, 0))
    mechanism = mbd.Mechanism(
        bodies=[bob],
        joints=[mbd.Revolute("pin", mbd.ground.at(0, 0), bob.at(0, length))],
        forces=[mbd.Gravity(), mbd.Torque("motor", bob, tau)],
        inputs=[tau],
        parameters=[length],
    )
    return mechanism, bob, length, tau


def swing(initial, final, waypoints=(), **limits):
    """A swing from rest to rest of least torque, the length being free."""
    mechanism, bob, length, tau = pendulum(**limits)
    problem = mbd.OptimalControlProblem(
        mechanism,
        duration=0.8,
        initial=[bob.omega == 0, *initial(bob)],
        final=[bob.omega == 0, *final(bob)],
        waypoints=[mbd.Waypoint(0.4, conditions(bob)) for conditions in waypoints],
        running_cost=tau**2,
        free_parameters=[length],
    )
    return problem, bob, length


def left(bob):
    return [bob.phi == -0.5]


def apart(bob):
    return [bob.x == 1.2, bob.y == -0.9]


@pytest.mark.slow
@pytest.mark.parametrize(
    "initial",
    [apart, lambda bob: [*apart(bob), bob.phi == np.arctan2(1.2, 0.9)]],
    ids=["two coordinates", "and the angle"],
)
def test_a_start_decides_the_length(initial):
    """A bob 1.2 m beside and 0.9 m below its pin hangs on 1.5 m, whatever its length was to begin with."""
    problem, bob, length = swing(initial, left)
    solution = mbd.optimize(problem, intervals=10)
    assert solution.parameters[length] == pytest.approx(1.5, abs=1e-9)
    first = solution.trajectory.initial
    assert (first[bob.x], first[bob.y]) == pytest.approx((1.2, -0.9), abs=1e-9)
    assert solution.verify().final_error < 1e-5


@pytest.mark.slow
def test_a_start_bounds_the_length_from_below():
    """A bob that begins 1.2 m beside its pin: the length is optimised, and the same motion backwards costs as much."""
    there, _, length = swing(lambda bob: [bob.x == 1.2], left)
    back, _, other = swing(lambda bob: [bob.phi == 0.5], lambda bob: [bob.x == -1.2])
    solutions = mbd.optimize(there, intervals=20), mbd.optimize(back, intervals=20)
    assert solutions[0].parameters[length] == pytest.approx(solutions[1].parameters[other], rel=1e-6)
    assert solutions[0].cost == pytest.approx(solutions[1].cost, rel=1e-6)


def test_a_waypoint_decides_the_length():
    """1.7 m below the pin."""
    problem, _, length = swing(lambda bob: [bob.phi == 0.5], left, [lambda bob: [bob.x == 0, bob.y == -1.7]])
    assert mbd.optimize(problem, intervals=10).parameters[length] == pytest.approx(1.7, abs=1e-9)


def test_a_length_beyond_its_limit_does_not_help():
    """The start is refused as before, by what stays open."""
    problem, _, _ = swing(apart, left, upper=1.3)
    with pytest.raises(mbd.ConditionError, match=r"bob\.x == 1\.2"):
        mbd.optimize(problem, intervals=10)


def test_contradictions_stay_refused():
    """No length makes a bob hang at two places."""
    with pytest.raises(mbd.ConditionError, match="contradict each other"):
        swing(lambda bob: [*apart(bob), bob.phi == 0.1], left)


def test_a_parameter_of_the_problem_alone():
    """A start at a place s out of reach to begin with: the torque is least if the bob begins where it ends."""
    mechanism, bob, length, tau = pendulum()
    place = mbd.Parameter("s", 2.0, lower=-3.0, upper=3.0)
    problem = mbd.OptimalControlProblem(
        mechanism,
        duration=0.8,
        initial=[bob.x == place, bob.y == -1.2, bob.omega == 0],
        final=[bob.x == 0, bob.omega == 0],
        running_cost=tau**2,
        free_parameters=[length, place],
    )
    solution = mbd.optimize(problem, intervals=10)
    assert solution.cost == pytest.approx(0.0, abs=1e-9)
    assert solution.parameters[place] == pytest.approx(0.0, abs=1e-4)
    assert solution.parameters[length] == pytest.approx(1.2, abs=1e-6)


def four_bar_through(point):
    """A crank-rocker with a free coupler point and ground link, whose point begins at a place."""
    bars = {"crank": (0.10, (0.05, 0.0, 0.0)), "coupler": (0.28, (0.2, 0.1, 0.5)), "rocker": (0.24, (0.3, 0.1, 1.6))}
    crank, coupler, rocker = (
        mbd.Body(name, mass=3 * length, inertia=length**3 / 4, pose=pose) for name, (length, pose) in bars.items()
    )
    ground, along = (
        mbd.Parameter("ground", 0.3, lower=0.2, upper=0.4),
        mbd.Parameter("along", 0.0, lower=-0.3, upper=0.3),
    )
    tau = mbd.Input("tau")
    o2 = mbd.Revolute("O2", mbd.ground.at(0, 0), crank.at(-0.05, 0))
    joints = [
        o2,
        mbd.Revolute("A", crank.at(0.05, 0), coupler.at(-0.14, 0)),
        mbd.Revolute("B", coupler.at(0.14, 0), rocker.at(0.12, 0)),
        mbd.Revolute("O4", mbd.ground.at(ground, 0), rocker.at(-0.12, 0)),
    ]
    mechanism = mbd.Mechanism(
        [crank, coupler, rocker],
        joints,
        forces=[mbd.Gravity(), mbd.Torque("motor", crank, tau)],
        inputs=[tau],
        parameters=[ground, along],
    )
    tracer = coupler.at(along, 0.1)
    problem = mbd.OptimalControlProblem(
        mechanism,
        duration=0.6,
        initial=[o2.angle == 0.5, crank.omega == 0, tracer.x == point[0], tracer.y == point[1]],
        final=[o2.angle == 0.5 + np.pi, crank.omega == 0],
        running_cost=tau**2,
        free_parameters=[ground, along],
    )
    return problem, tracer, ground


def test_a_closed_loop_begins_at_a_point():
    """The ground link and the place of the coupler point are such that the point begins there."""
    problem, tracer, ground = four_bar_through((0.12, 0.21))
    solution = mbd.optimize(problem, intervals=15)
    assert solution.trajectory.initial[tracer.position] == pytest.approx((0.12, 0.21), abs=1e-9)
    assert abs(solution.parameters[ground] - ground.value) > 1e-3
    assert solution.verify().final_error < 1e-3


#: Points on the path of a four-bar with cranks of 90, 300, 260 and 280 mm, at angles of its crank 60° apart and so on.
CURVE = ((0.0963, 0.2645), (0.0156, 0.2897), (-0.0655, 0.2189), (-0.0870, 0.1382), (0.0014, 0.1615))


@pytest.mark.slow
def test_a_path_through_five_points():
    """Six free dimensions and five free times: the coupler point passes five points in one turn of the crank."""
    names = {"a": (0.1, 0.06, 0.14), "b": (0.28, 0.2, 0.45), "c": (0.24, 0.15, 0.45), "d": (0.3, 0.15, 0.45)}
    a, b, c, d = (mbd.Parameter(name, *values) for name, values in names.items())
    along, across = mbd.Parameter("along", 0.0, -0.3, 0.3), mbd.Parameter("across", 0.1, -0.3, 0.3)
    free, tau = [a, b, c, d, along, across], mbd.Input("tau")
    crank = mbd.Body("crank", mass=0.3, inertia=3e-4, pose=(0.05, 0.0, 0.0))
    coupler = mbd.Body("coupler", mass=0.8, inertia=5e-3, pose=(0.2, 0.12, 0.7))
    rocker = mbd.Body("rocker", mass=0.7, inertia=4e-3, pose=(0.3, 0.12, 1.6))
    o2 = mbd.Revolute("O2", mbd.ground.at(0, 0), crank.at(-a / 2, 0))
    joints = [
        o2,
        mbd.Revolute("A", crank.at(a / 2, 0), coupler.at(-b / 2, 0)),
        mbd.Revolute("B", coupler.at(b / 2, 0), rocker.at(c / 2, 0)),
        mbd.Revolute("O4", mbd.ground.at(d, 0), rocker.at(-c / 2, 0)),
    ]
    motor = mbd.Torque("motor", crank, tau)
    linkage = mbd.Mechanism([crank, coupler, rocker], joints, forces=[motor], inputs=[tau], parameters=free)
    tracer, times = coupler.at(along, across), np.linspace(0, 1, 7)[1:-1]
    problem = mbd.OptimalControlProblem(
        linkage,
        duration=1.0,
        initial=[o2.angle == 0, crank.omega == 2 * np.pi],
        final=[o2.angle == 2 * np.pi, crank.omega == 2 * np.pi],
        waypoints=[
            mbd.Waypoint((t - 0.1, t + 0.1), [tracer.x == x, tracer.y == y])
            for t, (x, y) in zip(times.tolist(), CURVE, strict=True)
        ],
        running_cost=tau**2,
        free_parameters=free,
    )
    solution = mbd.optimize(problem, intervals=30)
    found = solution.trajectory.at(solution.waypoint_times)[tracer.position]
    assert found == pytest.approx(np.array(CURVE), abs=1e-7)
    assert np.all(np.diff(solution.waypoint_times) > 0)
    assert np.all(np.diff(solution.trajectory[crank.phi]) > 0)
    assert solution.verify().final_error < 1e-3
