"""Inputs whose courses are given: measured signals, known loads, references; and solves that follow each other."""

import numpy as np
import pytest
from motions import rest_to_rest, sprung_block
from scipy.interpolate import CubicSpline

import mbdcasadi as mbd
from mbdcasadi.arguments.piecewise_polynomial import PiecewisePolynomial
from mbdcasadi.optimal_control.program import setup


@pytest.fixture
def pendulum():
    """A damped pendulum with a torque, and a signal that acts on nothing."""
    bar = mbd.Body("bar", 1.0, 1 / 12, pose=(0.3, -0.4, -0.9))
    b, tau, y = mbd.Parameter("b", 0.1, lower=0, upper=2), mbd.Input("tau", lower=-1, upper=1), mbd.Input("y")
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), bar.at(-0.5, 0))
    loads = [mbd.Gravity(), mbd.Torque("damper", bar, -b * bar.omega), mbd.Torque("motor", bar, tau)]
    return mbd.Mechanism([bar], [pin], forces=loads, parameters=[b], inputs=[tau, y]), bar, b, tau, y


def horizon(pendulum, count, step):
    """Estimation of start and damping from samples of the angle."""
    mechanism, bar, b, _, y = pendulum
    times, error = step * np.arange(count + 1), (bar.phi - y) ** 2
    waypoints = [mbd.Waypoint(t, cost=error) for t in times[1:-1]]
    return mbd.OptimalControlProblem(
        mechanism, times[-1], waypoints=waypoints, terminal_cost=error + mbd.at_start(error), free_parameters=[b]
    )


@pytest.mark.slow
@pytest.mark.parametrize("control", ["polynomial", "linear", "constant"])
@pytest.mark.parametrize("transcription", ["gauss-legendre", "hermite-simpson"])
def test_a_moving_horizon_without_noise_finds_start_and_parameter(pendulum, control, transcription):
    """Against the simulation from which the samples are; the torque is known, beyond the limits that it carries."""
    mechanism, bar, b, tau, y = pendulum
    count, step = 40, 0.05
    times = step * np.arange(count + 4)
    torque = 2 * np.sin(3 * times)
    truth = mbd.simulate(
        mechanism, times, initial=[bar.phi == -0.2, bar.omega == 0.3], parameters={b: 0.25}, inputs={tau: torque},
        reltol=1e-12, abstol=1e-12,
    )  # fmt: skip
    problem, angles = horizon(pendulum, count, step), truth[bar.phi]
    guess = mbd.simulate(mechanism, times[: count + 1], initial=[bar.phi == -0.1, bar.omega == 0])
    programs = None
    for k in range(4):
        known = {y: angles[k : k + count + 1], tau: torque[k : k + count + 1]}
        found = mbd.optimize(
            problem, intervals=count, guess=guess, inputs=known, control=control, transcription=transcription
        )
        tolerance = 1e-6 if transcription == "gauss-legendre" else 1e-4
        assert found.parameters[b] == pytest.approx(0.25, abs=tolerance)
        assert found.trajectory.initial[bar.phi] == pytest.approx(truth[bar.phi][k], abs=tolerance)
        assert found.trajectory.initial[bar.omega] == pytest.approx(truth[bar.omega][k], abs=tolerance)
        assert found.trajectory.at(times[: count + 1])[y] == pytest.approx(known[y], abs=1e-12)
        assert not [limit for limit in found.active_limits if "tau" in limit.label]
        programs = programs or dict(problem.compiled.programs)
        assert problem.compiled.programs == programs
        guess = found.shifted(step)
    assert found.verify().final_error < 1e-4


def moved_block(known=None, load=0.0, **settings):
    """Least effort of a block from rest to rest in 1 s under a load that is an input, or an expression."""
    block = mbd.Body("block", mass=1.0, inertia=1.0)
    u, w = mbd.Input("u"), mbd.Input("w")
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), block.at(0, 0))
    force = mbd.Force("push", block.at(0, 0), (u + (load if known is None else w), 0))
    inputs = [u] if known is None else [w, u]
    mechanism = mbd.Mechanism([block], [rail], forces=[force], inputs=inputs)
    rest = [block.vx == 0]
    problem = mbd.OptimalControlProblem(
        mechanism, 1.0, [block.x == 0, *rest], [block.x == 1, *rest], running_cost=u**2, path=[u <= 8]
    )
    return problem, mbd.optimize(problem, intervals=10, inputs=None if known is None else {w: known}, **settings), w, u


TIMES = np.linspace(0, 1, 11)
FORMS = {
    "array": 2 * TIMES - 1,
    "pair": (np.linspace(0, 1.5, 4), 2 * np.linspace(0, 1.5, 4) - 1),
    "expression": 2 * mbd.t - 1,
    "curve": CubicSpline(TIMES, 2 * TIMES - 1),
    "polynomial": PiecewisePolynomial([0.0, 1.0], [[-1.0, 2.0]]),
}


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("control", ["polynomial", "linear"])
def test_a_known_load_is_that_of_the_model(form, control):
    """In every form, against the same load as an expression of the model."""
    _, expected, _, u = moved_block(load=2 * mbd.t - 1, control=control)
    problem, found, w, own = moved_block(FORMS[form], control=control)
    assert found.cost == pytest.approx(expected.cost, rel=1e-9)
    assert found.trajectory[own] == pytest.approx(expected.trajectory[u], abs=1e-6)
    assert found.trajectory[w] == pytest.approx(2 * found.trajectory.t - 1, abs=1e-12)
    assert list(found.inputs) == list(problem.mechanism.inputs)
    assert found.verify().final_error < 1e-8


@pytest.mark.slow
def test_a_mesh_is_refined_beside_a_known_load():
    """To a tolerance of the states and of the inputs, as with the load in the model; exact on samples beside it."""
    expected, found = (
        moved_block(known, mbd.sin(25 * mbd.t), tolerance=1e-6)[1] for known in (None, mbd.sin(25 * mbd.t))
    )
    assert found.cost == pytest.approx(expected.cost, rel=1e-6)
    times = np.linspace(0, 1, 301)
    assert found.trajectory.at(times)[found.settings.known.phases[0][0].expression] == pytest.approx(
        np.sin(25 * times), abs=4e-6
    )
    problem, sampled, w, _ = moved_block(np.abs(TIMES - 0.5), tolerance=1e-6)
    assert sampled.mesh.size == 11 and sampled.trajectory.maximum(w).value == pytest.approx(0.5)
    with pytest.warns(mbd.MechanismWarning, match="inputs that were given.*that end at the samples"):
        mbd.optimize(problem, intervals=7, inputs={w: np.resize([0.0, 1.0], 90)}, tolerance=1e-6)


def test_a_known_load_that_jumps_at_mesh_points():
    """Held from sample to sample; the effort of least cost is linear in time, and makes up for it."""
    steps = np.where(np.arange(10) % 2, 3.0, -3.0)
    _, found, w, u = moved_block(PiecewisePolynomial(TIMES, steps[:, None]))
    middle = (TIMES[1:] + TIMES[:-1]) / 2
    impulse, way = np.sum(0.1 * steps), np.sum(0.1 * steps * (1 - middle))
    first, slope = np.linalg.solve([[1, 1 / 2], [1 / 2, 1 / 6]], [-impulse, 1 - way])
    assert found.trajectory.at(middle)[w] == pytest.approx(steps, abs=1e-12)
    assert found.trajectory.at(middle)[u] == pytest.approx(first + slope * middle, abs=1e-6)
    assert found.verify().final_error < 1e-8


def test_other_courses_compile_nothing_anew():
    """The program is the same, and the solution that of a solve from nothing."""
    problem, first, w, _ = moved_block(np.zeros(11))
    built = dict(problem.compiled.programs)
    for course in (TIMES, 1.0, mbd.sin(5 * mbd.t)):
        again = mbd.optimize(problem, intervals=10, inputs={w: course}, guess=first)
        assert again.program is first.program and problem.compiled.programs == built
        assert again.cost == pytest.approx(moved_block(course)[1].cost, rel=1e-7)
    free = mbd.optimize(problem, intervals=10)
    assert free.cost < 1e-6 and free.program is not first.program  # the load does it all


def test_a_solution_with_known_inputs_is_saved(tmp_path):
    problem, found, w, _ = moved_block(2 * TIMES - 1)
    found.save(tmp_path / "s.npz")
    back = mbd.read_solution(tmp_path / "s.npz", problem)
    assert back.cost == found.cost and back.inputs[w](TIMES) == pytest.approx(found.inputs[w](TIMES), abs=1e-14)
    assert back.trajectory[w] == pytest.approx(found.trajectory[w], abs=1e-14)


def test_a_known_input_goes_through_phases():
    """Over the whole motion, against the same load as an expression."""
    block, u, w = mbd.Body("block", mass=1.0, inertia=1.0), mbd.Input("u"), mbd.Input("w")
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), block.at(0, 0))

    def solved(load, inputs, known):
        mechanism = mbd.Mechanism(
            [block], [rail], forces=[mbd.Force("push", block.at(0, 0), (u + load, 0))], inputs=inputs
        )
        phases = [
            mbd.Phase("there", mechanism, 0.5, [block.x == 0, block.vx == 0], [block.x == 1], running_cost=u**2),
            mbd.Phase("on", mechanism, 0.5, final=[block.x == 1.5, block.vx == 0], running_cost=u**2),
        ]
        return mbd.optimize(mbd.OptimalControlProblem(phases=phases), intervals=6, inputs=known)

    expected, found = solved(3 * mbd.t, [u], None), solved(w, [u, w], {w: [0.0, 3.0]})
    assert found.cost == pytest.approx(expected.cost, rel=1e-9)
    assert found.inputs[w](np.array([0.2, 0.8])) == pytest.approx([0.6, 2.4])


def test_an_input_with_limits_is_known_after_it_was_free():
    """In the same problem: sizes of its limits are those of the free one."""
    problem, u, block = rest_to_rest(lower=-20, upper=20)
    free = mbd.optimize(problem, intervals=10)
    known = problem.replace(final=[])
    mbd.optimize(known, intervals=10)
    found = mbd.optimize(known, intervals=10, inputs={u: free.inputs[u]})
    assert found.cost == pytest.approx(12, rel=1e-8) and found.trajectory.final[block.x] == pytest.approx(1, abs=1e-9)
    with pytest.raises(mbd.OptimizationError, match="final: block.x == 1"):
        mbd.optimize(problem, intervals=10, inputs={u: 0.0})


def test_wrong_courses():
    """Named with the input and the remedy."""
    problem, _, w, _u = moved_block(0.0)
    wrong = {
        "2 rows|shape": {w: np.zeros((2, 2))},
        "end at 0.5 s, and the motion at 1 s": {w: ([0.0, 0.5], [1.0, 2.0])},
        "input 'w' has the value nan": {w: [0.0, np.nan]},
        "which is not in the mechanism": {mbd.Input("v"): 1.0},
        "input 'w' contains": {w: problem.mechanism.bodies[0].x},
        "takes a number": {w: "fast"},
    }
    for message, inputs in wrong.items():
        with pytest.raises(mbd.MechanismError, match=message):
            mbd.optimize(problem, intervals=10, inputs=inputs)
    free = problem.replace(duration=(0.5, 2.0))
    with pytest.raises(mbd.ModelError, match=r"input 'w' is given as a course over time, but .* fix the times"):
        mbd.optimize(free, intervals=10, inputs={w: np.zeros(3)})
    assert mbd.optimize(free, intervals=10, inputs={w: 0.5}).trajectory[w] == pytest.approx(0.5)


def test_waypoints_of_equal_costs_make_one_block():
    """A cost at many samples takes one function; two intervals for each stretch are for conditions."""
    problem, _, block = rest_to_rest()
    times, error = np.linspace(0, 1, 21)[1:-1], (block.x - 0.5) ** 2
    via = problem.replace(waypoints=[mbd.Waypoint(t, cost=(block.x - 0.5) ** 2) for t in times])
    found = mbd.optimize(via, intervals=20)
    assert len([b for b in found.program.blocks if not b.piece.cost.is_zero()]) == 2
    running = found.cost - np.sum(found.trajectory.at(times)[error])
    assert running == pytest.approx(12.0, rel=0.02) and running >= 12.0
    with pytest.raises(mbd.ModelError, match="intervals.*at least 20.*19 waypoint"):
        mbd.optimize(via, intervals=19)


def test_a_solve_near_a_solution_is_that_from_nothing(monkeypatch):
    """With other parameters and starts, and without a path; what follows finds a path and sizes of its own."""
    problem, _u, k, block = sprung_block(3.0, 2.0)
    near = mbd.optimize(problem, intervals=16)
    starts = [[block.x == 0.2, block.vx == -1], mbd.assemble(problem.mechanism, [block.x == 0.3]), [block.x == 0.1]]
    for start in starts:
        with monkeypatch.context() as patch:
            patch.setattr(setup, "kinematic_path", None)
            quick = mbd.optimize(problem, intervals=16, guess=near, initial=start, parameters={k: 5.0})
        cold = mbd.optimize(problem.replace(initial=start), intervals=16, parameters={k: 5.0})
        assert quick.cost == pytest.approx(cold.cost, rel=1e-7)
    for stiffness in (2.5, 4.0, 30.0):
        quick = mbd.optimize(problem, intervals=16, guess=near, parameters={k: stiffness})
        cold = mbd.optimize(problem.replace(), intervals=16, parameters={k: stiffness})
        assert quick.cost == pytest.approx(cold.cost, rel=1e-7)
        anew = mbd.optimize(problem, intervals=16, parameters={k: stiffness})
        assert anew.statistics.iterations == cold.statistics.iterations and anew.cost == pytest.approx(cold.cost, 1e-9)


@pytest.mark.slow
def test_plans_of_one_problem_are_those_of_problems_of_their_own():
    """Model-predictive control of a crane: the forces of a shared problem, and of one that is stated for each plan."""
    force = mbd.Input("F", lower=-15, upper=15)
    car, load = mbd.Body("car", 2.0, 1.0), mbd.Body("load", 1.0, 0.0, pose=(0, -1, -np.pi / 2))
    joints = [
        mbd.Translational("rail", mbd.ground.at(0, 0), car.at(0, 0)),
        mbd.Revolute("h", car.at(0, 0), load.at(-1, 0)),
    ]
    model = mbd.Mechanism(
        [car, load], joints, forces=[mbd.Gravity(), mbd.Force("F", car.at(0, 0), (force, 0))], inputs=[force]
    )
    swing = load.phi + np.pi / 2
    problem = mbd.OptimalControlProblem(
        model,
        1.5,
        [car.x == 0, car.vx == 0, swing == 0, load.omega == 0],
        path=[mbd.bounded(-0.25, swing, 0.25)],
        running_cost=10 * (car.x - 1) ** 2 + car.vx**2 + 5 * swing**2 + 0.01 * force**2,
    )
    settings, state, plan = dict(intervals=30, control="constant"), mbd.assemble(model, problem.initial), None
    for _ in range(6):
        guess = None if plan is None else plan.shifted(0.05)
        plan = mbd.optimize(problem, initial=state, guess=guess, **settings)
        alone = mbd.optimize(problem.replace(initial=state), **settings)
        assert plan.inputs[force](0.0) == pytest.approx(alone.inputs[force](0.0), abs=1e-3)
        assert plan.cost == pytest.approx(alone.cost, rel=1e-6)
        state = plan.trajectory.at([0.0, 0.05]).final
