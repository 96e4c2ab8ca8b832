"""Problems that a controller does not solve are refused by name."""

from __future__ import annotations

import pytest

import mbdcasadi as mbd


def cart_on_rail():
    """A cart that a force pushes, and its problem's arguments."""
    force = mbd.Input("force", lower=-1, upper=1)
    cart = mbd.Body("cart", mass=1.0, inertia=1.0)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0))
    model = mbd.Mechanism([cart], [rail], forces=[mbd.Force("push", cart.at(0, 0), (force, 0))], inputs=[force])
    return model, cart, force


def problem_of(**changes):
    """A problem of the cart."""
    model, cart, force = cart_on_rail()
    changed = {name: value(cart, force) if callable(value) else value for name, value in changes.items()}
    return mbd.OptimalControlProblem(model, **({"duration": 1.0, "running_cost": cart.x**2 + force**2} | changed))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"duration": (0.5, 1.0)}, "duration must be fixed, got between 0.5 and 1 s"),
        ({"waypoints": lambda cart, force: [mbd.Waypoint(0.5, [cart.x == 1])]}, "waypoints have no place"),
        ({"boundary": lambda cart, force: [mbd.at_end(cart.x) == mbd.at_start(cart.x) + 1]}, "boundary conditions"),
        ({"path": lambda cart, force: [force + cart.x == 0]}, "takes limits, got the equality"),
        ({"terminal_cost": lambda cart, force: mbd.positive_part(mbd.at_end(cart.x)) ** 2}, "need constant factors"),
        ({"final": lambda cart, force: [mbd.soft(force == 0, weight=1)]}, "input|not known"),
        ({"running_cost": lambda cart, force: force.rate**2}, "have no rate"),
        ({"terminal_cost": lambda cart, force: mbd.at_start(cart.x) ** 2}, "the start is measured"),
        ({"terminal_cost": lambda cart, force: mbd.integral(force**2) ** 2}, "a term with a constant factor"),
        ({"terminal_cost": lambda cart, force: force**2}, "depends on an input at the end"),
        ({"final": lambda cart, force: [force == 0]}, "depends on an input, which ends there"),
    ],
)
def test_what_a_horizon_does_not_take(changes, words):
    """Each message says what is not taken."""
    with pytest.raises(mbd.MechanismError, match=words):
        mbd.Controller(problem_of(**changes), sample=0.1, intervals=10)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"sample": 0}, "sample must be positive"),
        ({"sample": 2.0}, "longer than the horizon of 1 s"),
        ({"intervals": 0}, "intervals must be a whole number above zero, got 0"),
        ({"steps": 0}, "steps must be a whole number above zero, got 0"),
        ({"iterations": 1.5}, "iterations must be a whole number above zero, got 1.5"),
    ],
)
def test_numbers_that_make_no_sense(arguments, words):
    """Times and counts are checked first."""
    with pytest.raises(mbd.ModelError, match=words):
        mbd.Controller(problem_of(), **({"sample": 0.1, "intervals": 10} | arguments))


def test_phases_and_other_objects():
    """A controller plans one phase of one mechanism."""
    model, _, force = cart_on_rail()
    phases = [mbd.Phase(name, model, 1.0, running_cost=force**2) for name in ("one", "two")]
    with pytest.raises(mbd.ModelError, match="without phases="):
        mbd.Controller(mbd.OptimalControlProblem(phases=phases), sample=0.1, intervals=10)
    with pytest.raises(mbd.ModelError, match="takes an OptimalControlProblem"):
        mbd.Controller(model, sample=0.1, intervals=10)


def test_dry_friction_is_refused():
    """What sticks exactly has no linearisation; the message names the laws that have one."""
    model, cart, force = cart_on_rail()
    rubbing = model.replace(forces=[*model.forces, mbd.JointFriction("rub", model.joints[0], mbd.DryFriction(0.1))])
    problem = mbd.OptimalControlProblem(rubbing, duration=1.0, running_cost=cart.x**2 + force**2)
    with pytest.raises(mbd.ModelError, match="'rub' switches between .* as Coulomb, Stribeck"):
        mbd.Controller(problem, sample=0.1, intervals=10)


def test_friction_by_reactions_is_refused():
    """Loads that depend on reactions have no code; the message names the friction that does."""
    model, cart, force = cart_on_rail()
    rubbing = model.replace(
        forces=[*model.forces, mbd.JointFriction("rub", model.joints[0], mbd.Coulomb(0.1, velocity_tolerance=1e-3))]
    )
    problem = mbd.OptimalControlProblem(rubbing, duration=1.0, running_cost=cart.x**2 + force**2)
    with pytest.raises(mbd.ModelError, match="LoadIndependentFriction"):
        mbd.Controller(problem, sample=0.1, intervals=10)


def test_measured_positions_are_as_many_as_move():
    """``state=`` takes one position for each degree of freedom, and positions alone."""
    model, cart, force = cart_on_rail()
    problem = mbd.OptimalControlProblem(model, duration=1.0, running_cost=cart.x**2 + force**2)
    with pytest.raises(mbd.ModelError, match="Controller: state= holds 2 expressions, and the mechanism has 1"):
        mbd.Controller(problem, sample=0.1, intervals=10, state=[cart.x, cart.y])
    with pytest.raises(mbd.ExpressionError, match="must be an expression in positions"):
        mbd.Controller(problem, sample=0.1, intervals=10, state=[cart.vx])


@pytest.mark.parametrize(
    "choose", [lambda cart, goal: cart.x * goal, lambda cart, goal: cart.y, lambda cart, goal: 1.0]
)
def test_measured_positions_describe_the_motion(choose):
    """A position that does not move, as one times zero, is refused and does not become a status of each step."""
    model, cart, force = cart_on_rail()
    goal = mbd.Parameter("goal", 0.0)
    problem = mbd.OptimalControlProblem(model.replace(parameters=[goal]), duration=1.0, running_cost=force**2)
    with pytest.raises(mbd.SingularityError, match="Controller: the states .* do not describe the motion at t = 0 s"):
        mbd.Controller(problem, sample=0.1, intervals=10, state=[choose(cart, goal)])
