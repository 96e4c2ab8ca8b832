"""Optimal control with exact dry friction: closed forms, and simulations with the search for stick and slip."""

import itertools
from types import SimpleNamespace

import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.optimal_control.friction.search import with_switches
from mbdcasadi.optimal_control.friction.switched_solution import Switch, time_error
from mbdcasadi.optimal_control.motion.limit_excess import largest_share
from mbdcasadi.optimal_control.search.search import Search
from mbdcasadi.optimal_control.solve.problem_solver import ProblemSolver

G = 9.81


def pushed(name="part", mu=0.3, mass=1.0, tilt=0.0, limit=50.0, load=None):
    """A block on a rail with dry friction, pushed at an angle to the rail."""
    force = mbd.Input(f"force on {name}", lower=-limit, upper=limit)
    block = mbd.Body(name, mass=mass, inertia=1)
    rail = mbd.Translational(f"rail of {name}", mbd.ground.at(0, 0), block.at(0, 0))
    law = mbd.DryFriction(mu)
    friction = (
        mbd.JointFriction(f"rub of {name}", rail, law)
        if load is None
        else mbd.LoadIndependentFriction(f"rub of {name}", rail, law, load)
    )
    push = mbd.Force(f"push of {name}", block.at(0, 0), (np.cos(tilt) * force, np.sin(tilt) * force))
    return force, block, rail, [push, friction]


def moved(force, block, rail, forces, way=0.5, duration=2.0, cost=None, **more):
    """The problem of a block that is moved from rest to rest."""
    parameters = more.pop("parameters", ())
    model = mbd.Mechanism([block], [rail], forces=[mbd.Gravity(), *forces], inputs=[force], parameters=parameters)
    ends = {"initial": [block.x == 0, block.vx == 0], "final": [block.x == way, block.vx == 0]}
    running = force**2 if cost is None else cost
    return mbd.OptimalControlProblem(model, duration, running_cost=running, **(ends | more))


def least_effort(friction, way, duration, mass=1.0):
    """Least ∫F² dt and the time for which the block slides: F falls evenly, and is 2 f less than at the start at last.

    ``m a = F - f``, so that the cost is ``∫(m a)² + f² τ``, the former ``12 m² d² / τ³``; τ ends where both balance.
    """
    slides = min(np.sqrt(6 * mass * way / friction), duration)
    return friction**2 * slides + 12 * mass**2 * way**2 / slides**3, slides


@pytest.mark.slow
def test_block_of_least_effort():
    """It pauses, at any time; the optimum is exact, and simulate finds the same switches."""
    parts = pushed()
    solution = mbd.optimize(moved(*parts))
    cost, slides = least_effort(0.3 * G, 0.5, 2.0)
    assert solution.cost == pytest.approx(cost, rel=1e-8)
    assert [(s.name, s.before, s.after) for s in solution.switches][:2] in (
        [("rub of part breaks away", "sticks", "forth"), ("rub of part stops", "forth", "sticks")],
        [("rub of part stops", "forth", "sticks")],
        [("rub of part breaks away", "sticks", "forth")],
    )
    marks = [0.0, *(s.t for s in solution.switches), 2.0]
    assert np.min(np.abs(np.diff(marks) - slides)) < 1e-6
    verified = solution.verify()
    assert verified.final_error < 1e-8 and verified.time_error < 1e-6
    # the friction of the model is known along the motion
    friction = parts[3][1]
    between = solution.trajectory.at(np.linspace(0, 2, 41))
    moving = np.abs(between[friction.sliding_speed]) > 1e-9
    np.testing.assert_allclose(between[friction.friction_force][moving], -0.3 * G, rtol=1e-9)
    assert np.max(np.abs(between[friction.friction_force])) <= 0.3 * G * (1 + 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(("way", "duration"), [(1.0, 2.0), (0.5, 0.8), (-0.5, 2.0)], ids=["long", "short", "back"])
def test_block_of_other_ways(way, duration):
    """A longer way, a time without a pause, and the other direction."""
    solution = mbd.optimize(moved(*pushed(), way=way, duration=duration))
    assert solution.cost == pytest.approx(least_effort(0.3 * G, abs(way), duration)[0], rel=1e-8)
    assert solution.verify().final_error < 1e-8


@pytest.mark.slow
@pytest.mark.parametrize("tilt", [-0.4, 0.4], ids=["pressed", "lifted"])
def test_load_that_the_push_changes(tilt):
    """A push at an angle presses or lifts: ``m a = F (cos α + μ sin α) - μ m g``."""
    share = np.cos(tilt) + 0.3 * np.sin(tilt)
    solution = mbd.optimize(moved(*pushed(tilt=tilt)))
    assert solution.cost == pytest.approx(least_effort(0.3 * G, 0.5, 2.0)[0] / share**2, rel=1e-8)
    assert solution.verify().final_error < 1e-8


@pytest.mark.slow
def test_cheapest_of_several_orders():
    """A spring pulls to the end of the way: a rest there costs less than one at the start, as the guess has it.

    From rest to rest in half a period, ``τ = π/ω``: by the spring and friction ``x = c (1 - cos ωt)``, ``c = d - f/k``;
    the force ``B sin ωt`` adds ``B τ/(2 ω) = d - 2 c``, so that the cost is ``B² τ/2 = 2 k (d - 2 c)² ω/π``.
    """
    force, block, rail, (_, rub) = pushed(mu=0.2)
    drawn = mbd.Force("push", block.at(0, 0), (force + 2 * (1 - block.x), 0))
    problem = moved(force, block, rail, [drawn, rub], way=1.0, duration=3.0)
    times = np.linspace(0, 3, 151)
    start = [block.x == 0, block.vx == 0]
    pushes = np.where(times < 0.8, -1.0, 1.0)
    motion = mbd.simulate(problem.given["mechanism"], times, initial=start, inputs={force: pushes})
    solution = mbd.optimize(problem, guess=motion)
    missing = 1 - 2 * (1 - 0.2 * G / 2)
    assert solution.cost == pytest.approx(4 * missing**2 * np.sqrt(2) / np.pi, rel=1e-7)
    assert [switch.name for switch in solution.switches] == ["rub of part stops"]
    assert solution.switches[0].t == pytest.approx(np.pi / np.sqrt(2), abs=1e-5)
    assert solution.verify().final_error < 1e-8
    orders = {start.description: start.cost for start in solution.statistics.starts}
    assert orders["rub of part sticks; rub of part slides forth"] > solution.cost * (1 + 5e-4)
    assert min(orders.values()) == pytest.approx(solution.cost, rel=1e-6)
    assert f"{len(orders)} starts led to" in repr(solution)


@pytest.mark.slow
def test_order_of_the_guess():
    """The modes of a simulated motion are an order of their own, whatever the relaxed motion does."""
    problem = moved(*pushed())
    (block,), force = problem.given["mechanism"].bodies, problem.given["mechanism"].inputs[0]
    times = np.linspace(0, 2, 101)
    pushes = np.where(times < 0.3, 0.0, np.where(times < 0.8, 6.0, 0.0))
    start = [block.x == 0, block.vx == 0]
    motion = mbd.simulate(problem.given["mechanism"], times, initial=start, inputs={force: pushes})
    solution = mbd.optimize(problem, starts=[motion, motion])
    assert solution.cost == pytest.approx(least_effort(0.3 * G, 0.5, 2.0)[0], rel=1e-8)
    assert [switch.name for switch in solution.switches] == ["rub of part breaks away", "rub of part stops"]


def test_switches_are_paired_by_name():
    """Two that change places are no small error of time; of those at one instant one may be found alone."""
    planned = [Switch(1.0, "a stops", "forth", "sticks"), Switch(1.1, "b stops", "forth", "sticks")]
    in_order, swapped = [("a stops", 1.01), ("b stops", 1.1)], [("b stops", 1.0), ("a stops", 1.1)]

    def off(found, near=1e-3, end=3.0, **more):
        return time_error(planned, [SimpleNamespace(name=name, t=t) for name, t in found], near, end, **more)

    assert off(in_order) == pytest.approx(0.01)
    assert off(swapped) == pytest.approx(0.1)
    assert off([("a stops", 1.0)]) == np.inf and off([("a stops", 1.0)], near=0.2) == 0.0
    assert off([]) == np.inf
    assert off([*in_order, ("a stops", 2.0)]) == np.inf
    assert off([*in_order, ("a stops", 2.0)], end=2.0) == pytest.approx(0.01)
    # the nearest ones belong together; what else switches on the same way decides nothing
    assert off([("a stops", 0.2), *in_order], is_same=True) == pytest.approx(0.01)


@pytest.mark.slow
def test_two_dry_joints():
    """Two blocks of their own: each slides for its time, in its direction."""
    (one, a, first, own), (other, b, second, others) = pushed("a"), pushed("b", mu=0.5, mass=2.0)
    model = mbd.Mechanism([a, b], [first, second], forces=[mbd.Gravity(), *own, *others], inputs=[one, other])
    start = [a.x == 0, a.vx == 0, b.x == 0, b.vx == 0]
    end = [a.x == 0.5, a.vx == 0, b.x == -0.3, b.vx == 0]
    problem = mbd.OptimalControlProblem(model, 2.0, initial=start, final=end, running_cost=one**2 + other**2)
    solution = mbd.optimize(problem)
    expected = least_effort(0.3 * G, 0.5, 2.0)[0] + least_effort(0.5 * 2 * G, 0.3, 2.0, mass=2.0)[0]
    assert solution.cost == pytest.approx(expected, rel=1e-8)
    assert solution.verify().final_error < 1e-8


@pytest.mark.slow
def test_pause_at_a_waypoint():
    """There and back through a rest: twice the cost of one way."""
    parts = pushed()
    block = parts[1]
    halt = mbd.Waypoint(2.0, [block.x == 0.5, block.vx == 0])
    solution = mbd.optimize(moved(*parts, way=0.0, duration=4.0, waypoints=[halt]))
    cost, slides = least_effort(0.3 * G, 0.5, 2.0)
    assert solution.cost == pytest.approx(2 * cost, rel=1e-8)
    times = [0.0, *(s.t for s in solution.switches), 4.0]
    lasting = [
        b - a
        for (a, b), piece in zip(itertools.pairwise(times), solution.pieces, strict=True)
        if piece.senses != ("sticks",)
    ]
    assert lasting == pytest.approx([slides, slides], abs=1e-6)
    verified = solution.verify()
    assert verified.final_error < 1e-8 and verified.time_error < 1e-6


@pytest.mark.slow
def test_states_at_start_waypoint_and_end():
    """States of the mechanism with its friction fix ends and waypoints; the block may stay where it has to be twice."""
    problem = moved(*pushed())
    model, (block,) = problem.mechanism, problem.mechanism.bodies
    start, end = (mbd.assemble(model, [block.x == x, block.vx == 0]) for x in (0, 0.5))
    cost = least_effort(0.3 * G, 0.5, 2.0)[0]
    assert mbd.optimize(problem.replace(initial=start, final=end)).cost == pytest.approx(cost, rel=1e-8)
    halts = [mbd.Waypoint(1.2, end), mbd.Waypoint(1.8, [block.x == 0.5])]
    paused = mbd.optimize(problem.replace(duration=3.0, waypoints=halts, final=[block.x == 1, block.vx == 0]))
    assert paused.cost == pytest.approx(2 * cost, rel=1e-8)
    assert paused.verify().final_error < 1e-8


@pytest.mark.slow
def test_coefficient_that_is_free():
    """A free coefficient goes to its lower limit, at which effort is least."""
    mu = mbd.Parameter("mu", 0.3, lower=0.1, upper=0.5)
    solution = mbd.optimize(moved(*pushed(mu=mu), parameters=[mu], free_parameters=[mu]))
    assert solution.parameters[mu] == pytest.approx(0.1, abs=1e-6)
    assert solution.cost == pytest.approx(least_effort(0.1 * G, 0.5, 2.0)[0], rel=1e-6)
    assert solution.verify().final_error < 1e-6


@pytest.mark.slow
def test_least_time():
    """The force jumps once, at a time that a mesh point finds; friction never switches."""
    parts = pushed(limit=6.0)
    solution = mbd.optimize(moved(*parts, duration=(0.1, 5), cost=0, terminal_cost=mbd.t))
    a, b = 6 - 0.3 * G, 6 + 0.3 * G
    assert solution.cost == pytest.approx(np.sqrt(2 * 0.5 / (1 / a + 1 / b)) * (1 / a + 1 / b), rel=1e-6)
    assert solution.switches == ()


@pytest.mark.slow
def test_least_positive_work():
    """No motion needs less work than friction takes."""
    parts = pushed()
    solution = mbd.optimize(moved(*parts, cost=mbd.positive_part(parts[0] * parts[1].vx)))
    assert solution.cost == pytest.approx(0.3 * G * 0.5, rel=1e-4)


@pytest.mark.slow
def test_pendulum_with_a_dry_pivot():
    """Friction by the pin's own load, which turns its sense on a swing: simulate follows."""
    torque = mbd.Input("torque", lower=-8, upper=8)
    rod = mbd.Body("rod", mass=1, inertia=0.03, pose=(0, -0.3, -np.pi / 2))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), rod.at(-0.3, 0))
    bush = mbd.JointFriction("bush", pin, mbd.DryFriction(0.3), radius=0.05)
    model = mbd.Mechanism([rod], [pin], forces=[mbd.Gravity(), mbd.Torque("motor", rod, torque), bush], inputs=[torque])
    problem = mbd.OptimalControlProblem(
        model, 2.0, initial=[rod.phi == -np.pi / 2, rod.omega == 0], final=[rod.phi == 0, rod.omega == 0],
        running_cost=torque**2,
    )  # fmt: skip
    solution = mbd.optimize(problem)
    verified = solution.verify()
    assert verified.final_error < 1e-6 and verified.time_error < 1e-6
    assert {"forth", "back"} <= {mode for s in solution.switches for mode in (s.before, s.after)}
    # with less friction it costs less, by a smoothed law that hardly differs from none
    free = model.replace(forces=[f for f in model.forces if f is not bush])
    assert mbd.optimize(problem.replace(mechanism=free)).cost < solution.cost


@pytest.mark.slow
def test_two_dry_joints_of_one_motion():
    """Both stick in the pause of a slider-crank: one holds it, and the force of the other is within its limit."""
    torque = mbd.Input("torque", lower=-5, upper=5)
    crank = mbd.Body("crank", mass=0.5, inertia=1e-3, pose=(0.05, 0, 0))
    rod = mbd.Body("rod", mass=0.5, inertia=4e-3, pose=(0.25, 0, 0))
    slider = mbd.Body("slider", mass=1.0, inertia=1e-3, pose=(0.40, 0, 0))
    joints = [
        mbd.Revolute("main", mbd.ground.at(0, 0), crank.at(-0.05, 0)),
        mbd.Revolute("pin", crank.at(0.05, 0), rod.at(-0.15, 0)),
        mbd.Revolute("wrist", rod.at(0.15, 0), slider.at(0, 0)),
        mbd.Translational("guide", mbd.ground.at(0, 0), slider.at(0, 0)),
    ]
    dry = [
        mbd.JointFriction("guide friction", joints[3], mbd.DryFriction(0.2)),
        mbd.JointFriction("main friction", joints[0], mbd.DryFriction(0.1), radius=0.01),
    ]
    forces = [mbd.Gravity(), mbd.Torque("motor", crank, torque), *dry]
    engine = mbd.Mechanism([crank, rod, slider], joints, forces=forces, inputs=[torque])
    angle = joints[0].angle
    problem = mbd.OptimalControlProblem(
        engine, duration=1.0, running_cost=torque**2, initial=[angle == 0.6, crank.omega == 0],
        waypoints=[mbd.Waypoint(0.5, [angle == 1.5, crank.omega == 0])], final=[angle == 2.6, crank.omega == 0],
    )  # fmt: skip
    solution = mbd.optimize(problem)
    verified = solution.verify()
    assert verified.final_error < 1e-5 and verified.time_error < 1e-4
    stops = {s.name: s.t for s in solution.switches if s.after == "sticks"}
    assert stops["guide friction stops"] == stops["main friction stops"]


@pytest.mark.slow
def test_parameters_rates_and_other_starts():
    """Coefficients are parameters; the rate of an input has no jump at a switch; a start may be given later."""
    mu = mbd.Parameter("mu", 0.2)
    problem = moved(*pushed(mu=mu), parameters=[mu])
    assert mbd.optimize(problem, parameters={mu: 0.3}).cost == pytest.approx(
        least_effort(0.3 * G, 0.5, 2.0)[0], rel=1e-8
    )
    block = problem.mechanism.bodies[0]
    later = mbd.optimize(problem, parameters={mu: 0.3}, initial=[block.x == -0.5, block.vx == 0])
    assert later.cost == pytest.approx(least_effort(0.3 * G, 1.0, 2.0)[0], rel=1e-8)
    force, *rest = pushed()
    smooth = mbd.optimize(moved(force, *rest, cost=force**2 + 1e-2 * force.rate**2))
    course = smooth.inputs[force]
    for switch in smooth.switches:
        before, after = (float(course(switch.t + shift)) for shift in (-1e-9, 1e-9))
        assert before == pytest.approx(after, abs=1e-5)


@pytest.mark.slow
def test_simulation_that_switches_otherwise():
    """verify() tells it if the simulated motion, here with more friction, does not follow the plan."""
    problem = moved(*pushed())
    solution, model = mbd.optimize(problem), problem.mechanism
    assert solution.trajectory.mechanism is model
    gravity, push, rub = model.forces
    rough = mbd.JointFriction("rub of part", rub.joint, mbd.DryFriction(0.35))
    solution.mechanism = model.replace(forces=[gravity, push, rough])
    verified = solution.verify()
    assert verified.final_error > 1e-3
    assert np.isinf(verified.time_error) or verified.time_error > 1e-3
    assert "off by" in repr(verified)


@pytest.mark.parametrize("fastest", [1.2, 1.3])
def test_limits_are_kept_between_the_points_at_which_they_are_held(fastest):
    """Up to its speed a mass speeds up and slows down in parabolas: ``∫F² dt = 8/3 v² / τ``, τ each of these times."""
    force, block, rail, (push, _) = pushed()
    model = mbd.Mechanism([block], [rail], forces=[push], inputs=[force])
    ends = {"initial": [block.x == 0, block.vx == 0], "final": [block.x == 1, block.vx == 0]}
    problem = mbd.OptimalControlProblem(model, 1.0, running_cost=force**2, path=[block.vx <= fastest], **ends)
    coarse = mbd.optimize(problem, intervals=7)
    solution = with_switches(ProblemSolver(problem, coarse.settings), coarse)
    assert largest_share(coarse) > 1e-4 and largest_share(solution) <= 1e-6
    assert solution.cost == pytest.approx(8 / 3 * fastest**2 / (1.5 * (1 - 1 / fastest)), rel=1e-7)


def test_first_motion_is_searched_for_in_all_ways(monkeypatch):
    """A solver that runs out of iterations is no end of the search, unless the user limits these."""
    seen = []

    def solve(self, *_, **__):
        seen.append(self.settings.options)
        raise mbd.OptimizationError("no motion", partial=None)

    monkeypatch.setattr(Search, "solve", solve)
    for options in ({}, {"ipopt.max_iter": 7}):
        with pytest.raises(mbd.OptimizationError, match="no motion"):
            mbd.optimize(moved(*pushed()), options=options)
    assert [options.get("ipopt.max_iter") for options in seen] == [None, 7]


def test_failure_does_not_blame_the_law():
    """The load |N| of a joint bends, which the user can state in no other way."""
    with pytest.raises(mbd.OptimizationError, match="iterations") as raised:
        mbd.optimize(moved(*pushed()), options={"ipopt.max_iter": 2})
    assert "kink" not in str(raised.value)


def test_what_is_refused():
    """Each message names the friction, or the argument, and says what to do."""
    force, block, rail, (push, rub) = pushed()
    static = mbd.JointFriction("rub", rail, mbd.DryFriction(0.3, static_coefficient=0.4))
    with pytest.raises(mbd.ModelError, match=r"'rub'.*one coefficient.*leave static_coefficient out"):
        moved(force, block, rail, [push, static])
    model = mbd.Mechanism([block], [rail], forces=[mbd.Gravity(), push, rub], inputs=[force])
    phases = [mbd.Phase("one", model, 1.0), mbd.Phase("two", model, 1.0)]
    with pytest.raises(mbd.ModelError, match=r"'rub of part'.*one mechanism"):
        mbd.OptimalControlProblem(phases=phases)
    problem = moved(force, block, rail, [push, rub])
    with pytest.raises(mbd.ModelError, match=r"inputs= is not available with DryFriction"):
        mbd.optimize(problem, inputs={force: 1.0})
    with pytest.raises(mbd.ModelError, match=r"intervals is the number of those of the whole motion"):
        mbd.optimize(problem, intervals=[10, 20])
    mu = mbd.Parameter("mu", 0.2)
    with pytest.raises(mbd.ModelError, match=r"continuation= is not available"):
        mbd.optimize(moved(*pushed(mu=mu), parameters=[mu]), continuation={mu: [0.1, 0.2]})
    with pytest.raises(mbd.ConditionError, match="contradict|already"):
        moved(force, block, rail, [push, rub], final=[block.x == 0.5, block.y == 1.0])
