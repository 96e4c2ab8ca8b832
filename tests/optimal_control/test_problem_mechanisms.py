"""Mechanisms out of the ordinary: no mass, redundant rows, first-order states, friction from reactions."""

import warnings

import numpy as np
import pytest
from motions import guided_block, pendulum

import mbdcasadi as mbd
from mbdcasadi.optimal_control.program.problem_setup import ProblemSetup
from mbdcasadi.optimal_control.program.setup import Settings

SCHEMES = ["gauss-legendre", "hermite-simpson"]


# --- redundant constraints ---------------------------------------------------------------------------
def parallelogram(cranks, turn=0.0):
    """A beam on parallel cranks of 1 m, and the same with two; the whole world may be turned."""
    tau = mbd.Input("tau")
    feet = np.linspace(0, 2, cranks)
    along, up = np.array([np.cos(turn), np.sin(turn)]), np.array([-np.sin(turn), np.cos(turn)])
    arms = [
        mbd.Body(f"crank {k}", mass=1.0, inertia=1 / 12, pose=(*(x * along + 0.5 * up), turn + np.pi / 2))
        for k, x in enumerate(feet)
    ]
    beam = mbd.Body("beam", mass=2.0, inertia=1.0, pose=(*(along + up), turn))
    joints = [mbd.Revolute(f"foot {k}", mbd.ground.at(*(x * along)), arms[k].at(-0.5, 0)) for k, x in enumerate(feet)]
    joints += [mbd.Revolute(f"head {k}", arms[k].at(0.5, 0), beam.at(x - 1, 0)) for k, x in enumerate(feet)]
    mechanism = mbd.Mechanism(
        bodies=[*arms, beam],
        joints=joints,
        forces=[mbd.Gravity(tuple(-9.81 * up)), mbd.Torque("motor", arms[0], tau)],
        inputs=[tau],
    )
    return mechanism, arms, beam, tau


def swing(mechanism, crank, tau, running_cost=None, path=(), turn=0.0, **settings):
    """From 0.6 rad off the vertical on one side to the other, rest to rest."""
    upright = turn + np.pi / 2
    problem = mbd.OptimalControlProblem(
        mechanism,
        duration=1.2,
        initial=[crank.phi == upright - 0.6, crank.omega == 0],
        final=[crank.phi == upright + 0.6, crank.omega == 0],
        running_cost=tau**2 if running_cost is None else running_cost,
        path=path,
    )
    return mbd.optimize(problem, **({"intervals": 20} | settings))


def inverted(inertia, weight, **settings):
    """The same swing of one body with an inertia and a weight times its lever."""
    tau = mbd.Input("tau")
    rotor = mbd.Body("rotor", mass=1.0, inertia=inertia, pose=(0, 0, np.pi / 2))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), rotor.at(0, 0))
    load = mbd.Torque("load", rotor, -9.81 * weight * mbd.cos(rotor.phi))
    motor = mbd.Torque("motor", rotor, tau)
    mechanism = mbd.Mechanism(bodies=[rotor], joints=[pin], forces=[load, motor], inputs=[tau])
    return swing(mechanism, rotor, tau, **settings)


@pytest.mark.slow
@pytest.mark.parametrize("transcription", SCHEMES)
@pytest.mark.parametrize("cranks", [2, 3, 4])
def test_parallel_cranks(cranks, transcription):
    """Cranks and beam turn and translate alike: one rotor of inertia c/3 + 2 and weight c/2 + 2."""
    mechanism, arms, beam, tau = parallelogram(cranks)
    solution = swing(mechanism, arms[0], tau, transcription=transcription)
    reference = inverted(cranks / 3 + 2, cranks / 2 + 2, transcription=transcription)
    tolerance = 1e-6 if transcription == "gauss-legendre" else 1e-3
    assert solution.cost == pytest.approx(reference.cost, rel=tolerance)
    assert solution.redundant == (cranks > 2)
    assert solution.statistics.iterations <= 12
    replay = solution.verify()
    assert replay.final_error < (1e-6 if transcription == "gauss-legendre" else 1e-2) and replay.drift < 1e-10
    assert solution.trajectory.drift.position < 1e-10
    times = np.linspace(0, 1.2, 25)
    assert np.allclose(solution.trajectory.at(times)[beam.phi], 0, atol=1e-10)


@pytest.mark.parametrize("turn", [1.5, 1.65])
def test_parallel_cranks_in_a_turned_world(turn):
    """Rows in x of parallel cranks depend on each other as these pass the axis: no pose in which they could fold."""
    mechanism, arms, _, tau = parallelogram(3, turn)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        solution = swing(mechanism, arms[0], tau, turn=turn)
    assert solution.cost == pytest.approx(inverted(3.0, 3.5).cost, rel=1e-6) and solution.statistics.iterations <= 12
    simulated = solution.simulate()
    assert simulated[arms[0].phi][-1] == pytest.approx(turn + np.pi / 2 + 0.6, abs=1e-5)
    assert not any("singular" in note for note in simulated.statistics.notes)


def test_implied_rows_are_found_beside_a_flat_pose():
    """Halfway the cranks lie flat, and in a pose that is off by rounding there all rows are independent."""
    mechanism, arms, _, _ = parallelogram(3)
    start = [arms[0].phi == 0.5, arms[0].omega == 0]
    problem = mbd.OptimalControlProblem(mechanism, 0.8, initial=start, final=[arms[0].phi == -0.5])
    settings = Settings.read("gauss-legendre", 3, "polynomial", None, False)
    (setup,) = ProblemSetup(problem, settings).setups
    assert np.allclose(setup.path.poses[len(setup.path.poses) // 2][2:9:3], 0, atol=1e-5)
    assert setup.scheme.redundant and len(setup.scheme.rows) == setup.scheme.eom.lam.numel() - 1


@pytest.mark.parametrize("transcription", SCHEMES)
def test_a_door_with_two_hinges(transcription):
    """Two pins on one axis in the plane: the rows of the second are implied by the first."""
    tau = mbd.Input("tau")
    door = mbd.Body("door", mass=20.0, inertia=20 * 0.9**2 / 12, pose=(0.45, 0, 0))
    hinges = [mbd.Revolute(f"hinge {k}", mbd.ground.at(0, 0), door.at(-0.45, 0)) for k in (1, 2)]
    motor = mbd.Torque("motor", door, tau)
    mechanism = mbd.Mechanism(bodies=[door], joints=hinges, forces=[motor], inputs=[tau])
    problem = mbd.OptimalControlProblem(
        mechanism,
        duration=2.0,
        initial=[door.phi == 0, door.omega == 0],
        final=[door.phi == 1.5, door.omega == 0],
        running_cost=tau**2,
    )
    solution = mbd.optimize(problem, intervals=10, transcription=transcription)
    inertia = 20 * 0.9**2 / 3
    rel = 1e-6 if transcription == "gauss-legendre" else 2e-3
    assert solution.cost == pytest.approx(12 * inertia**2 * 1.5**2 / 8, rel=rel)
    total = sum(solution.trajectory[h.reaction_on(door).force[0]] for h in hinges)
    assert np.allclose(total, solution.trajectory[20 * door.ax], atol=1e-6 * np.max(np.abs(total)))


@pytest.mark.parametrize("transcription", SCHEMES)
def test_parallel_guides(transcription):
    """A block on two parallel guides: 12 m² d² / T³ as on one."""
    u = mbd.Input("u")
    block, mechanism = guided_block(2.0, u)
    second = mbd.Translational("second guide", mbd.ground.at(0, 1), block.at(0, 1))
    mechanism = mechanism.replace(joints=[*mechanism.joints, second])
    problem = mbd.OptimalControlProblem(
        mechanism,
        duration=2.0,
        initial=[block.x == 0, block.vx == 0],
        final=[block.x == 3, block.vx == 0],
        running_cost=u**2,
    )
    solution = mbd.optimize(problem, intervals=10, transcription=transcription)
    assert solution.cost == pytest.approx(4 * 13.5, rel=1e-9) and solution.redundant


@pytest.mark.parametrize("transcription", SCHEMES)
def test_each_guide_bears_half_of_the_weight(transcription):
    """Reactions of redundant joints are those of least norm in costs and limits, too, as in a simulation."""
    u = mbd.Input("u")
    block, mechanism = guided_block(2.0, u)
    first = mechanism.joints[0]
    second = mbd.Translational("second guide", mbd.ground.at(0, 1), block.at(0, 1))
    load = first.reaction_on(block).force[1]
    problem = mbd.OptimalControlProblem(
        mechanism.replace(joints=[first, second], forces=[*mechanism.forces, mbd.Gravity()]),
        duration=2.0,
        initial=[block.x == 0, block.vx == 0],
        final=[block.x == 3, block.vx == 0],
        running_cost=u**2 + load**2,
        path=[load <= 9.82],
    )
    solution = mbd.optimize(problem, intervals=10, transcription=transcription)
    assert solution.cost == pytest.approx(4 * 13.5 + 2.0 * 9.81**2, rel=1e-9)
    simulated = solution.simulate()
    assert np.allclose(simulated[load], 9.81, rtol=1e-9)
    again = mbd.optimize(problem, intervals=10, transcription=transcription, guess=simulated)
    assert again.cost == pytest.approx(solution.cost) and again.statistics.iterations <= 12


def test_a_simulation_with_redundant_rows_is_a_guess():
    """Its multipliers, of least norm, load the bodies as those of the independent rows do."""
    mechanism, arms, _, tau = parallelogram(3)
    load = mechanism.joints[1].reaction_on(arms[1]).force[0]
    solution = swing(mechanism, arms[0], tau, running_cost=tau**2 + load**2, path=[load <= 100])
    again = swing(mechanism, arms[0], tau, running_cost=tau**2 + load**2, path=[load <= 100], guess=solution.simulate())
    assert again.cost == pytest.approx(solution.cost) and again.statistics.iterations <= 6


@pytest.mark.slow
@pytest.mark.parametrize("mass", [1.0, 0.0])
def test_a_peak_of_a_reaction_that_is_not_unique(mass):
    """Three cranks of which the middle one, which may have no mass, is to bear as little as possible."""
    mechanism, arms, _, tau = parallelogram(3)
    joints = mechanism.joints
    peak = mbd.Parameter("peak", 10.0, lower=0)
    middle = mbd.Body("middle", mass=mass, inertia=mass / 12, pose=(1, 0.5, np.pi / 2))
    foot = mbd.Revolute("middle foot", mbd.ground.at(1, 0), middle.at(-0.5, 0))
    head = mbd.Revolute("middle head", middle.at(0.5, 0), mechanism.bodies[-1].at(0, 0))
    bodies = [arms[0], middle, *mechanism.bodies[2:]]
    mechanism = mechanism.replace(bodies=bodies, joints=[joints[0], foot, joints[2], joints[3], head, joints[5]])
    load = foot.reaction_on(middle).force
    problem = mbd.OptimalControlProblem(
        mechanism,
        duration=1.2,
        initial=[arms[0].phi == np.pi / 2 - 0.6, arms[0].omega == 0],
        final=[arms[0].phi == np.pi / 2 + 0.6, arms[0].omega == 0],
        path=[mbd.norm(load) <= peak],
        running_cost=1e-3 * tau**2,
        terminal_cost=peak,
        free_parameters=[peak],
    )
    solution = mbd.optimize(problem, intervals=20)
    simulated = np.hypot(*solution.simulate()[load].T)
    assert np.max(simulated) == pytest.approx(solution.parameters[peak], rel=2e-3)
    plain = mbd.optimize(problem.replace(path=[], terminal_cost=0, free_parameters=[]), intervals=20)
    assert solution.parameters[peak] < 0.99 * np.max(np.hypot(*plain.trajectory[load].T))


# --- massless bodies -------------------------------------------------------------------------------
@pytest.mark.parametrize("transcription", SCHEMES)
def test_a_massless_rod_between_bodies(transcription):
    """A cart drawn through a rod without mass or inertia needs the force of the cart alone."""
    u = mbd.Input("u")
    handle = mbd.Body("handle", mass=0.0, inertia=0.0, pose=(1, 0, 0))
    rod = mbd.Body("rod", mass=0.0, inertia=0.0, pose=(0.5, 0, 0))
    cart = mbd.Body("cart", mass=2.0, inertia=0.0)
    joints = [
        mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0)),
        mbd.Revolute("cart pin", cart.at(0, 0), rod.at(-0.5, 0)),
        mbd.Revolute("handle pin", rod.at(0.5, 0), handle.at(0, 0)),
        mbd.Translational("handle rail", mbd.ground.at(0, 0.3), handle.at(0, 0)),
    ]
    handle_force = mbd.Force("pull", handle.at(0, 0), (u, 0))
    mechanism = mbd.Mechanism(bodies=[handle, rod, cart], joints=joints, forces=[handle_force], inputs=[u])
    problem = mbd.OptimalControlProblem(
        mechanism,
        duration=2.0,
        initial=[cart.x == 0, cart.vx == 0],
        final=[cart.x == 3, cart.vx == 0],
        running_cost=u**2,
    )
    solution = mbd.optimize(problem, intervals=10, transcription=transcription)
    assert solution.cost == pytest.approx(4 * 13.5, rel=1e-8)
    assert solution.verify().final_error < 1e-7


@pytest.mark.parametrize("transcription", SCHEMES)
def test_a_point_mass_on_a_massless_rod(transcription):
    """The pendulum of a bob without inertia equals that of a body whose inertia is m l² about the pin."""
    bob, tau, mechanism = pendulum()
    costs = []
    for body, input_, model in ((bob, tau, mechanism), _rotor(inertia=1.0, weight=1.0)):
        problem = mbd.OptimalControlProblem(
            model,
            duration=1.0,
            initial=[body.phi == 0, body.omega == 0],
            final=[body.phi == 2, body.omega == 0],
            running_cost=input_**2,
        )
        costs.append(mbd.optimize(problem, intervals=20, transcription=transcription).cost)
    assert costs[0] == pytest.approx(costs[1], rel=1e-6 if transcription == "gauss-legendre" else 1e-3)


def test_a_body_without_mass_that_nothing_holds():
    """A spring pulls a body without mass, as in a simulation: it has no acceleration."""
    u = mbd.Input("u")
    block, mechanism = guided_block(1.0, u)
    slip = mbd.Body("slip", mass=0.0, inertia=0.0, pose=(1, 0, 0))
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), slip.at(0, 0))
    spring = mbd.TSDA("spring", block.at(0, 0), slip.at(0, 0), stiffness=40, free_length=1)
    mechanism = mechanism.replace(
        bodies=[block, slip], joints=[*mechanism.joints, rail], forces=[*mechanism.forces, spring]
    )
    problem = mbd.OptimalControlProblem(
        mechanism, duration=1.0, initial=[block.x == 0, block.vx == 0], final=[block.x == 1], running_cost=u**2
    )
    with pytest.raises(mbd.SingularityError, match=r"'slip' has no mass or inertia in slip\.x, and no joint holds"):
        mbd.optimize(problem)


def _rotor(inertia, weight, mass=1.0):
    """A body on its centre with a torque like that of a weight hung one metre below."""
    tau = mbd.Input("tau")
    rotor = mbd.Body("rotor", mass=mass, inertia=inertia)
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), rotor.at(0, 0))
    load = mbd.Torque("load", rotor, -9.81 * weight * mbd.sin(rotor.phi))
    motor = mbd.Torque("motor", rotor, tau)
    return rotor, tau, mbd.Mechanism(bodies=[rotor], joints=[pin], forces=[load, motor], inputs=[tau])


@pytest.mark.parametrize("transcription", SCHEMES)
@pytest.mark.parametrize("mass", [0.0, 1e-9, 1e-3])
def test_a_flywheel_whose_mass_does_not_count(mass, transcription):
    """Inertia alone sets the torque: 12 J² a² / T³, whatever the mass on the axis."""
    rotor, tau, model = _rotor(inertia=30.0, weight=0.0, mass=mass)
    problem = mbd.OptimalControlProblem(
        model,
        duration=1.0,
        initial=[rotor.phi == 0, rotor.omega == 0],
        final=[rotor.phi == 2, rotor.omega == 0],
        running_cost=tau**2,
    )
    solution = mbd.optimize(problem, intervals=6, transcription=transcription)
    assert solution.cost == pytest.approx(12 * 30**2 * 4, rel=1e-8)
    assert solution.statistics.iterations <= 12


# --- first-order states ------------------------------------------------------------------------------
def electric_rotor(voltage, current, constant):
    """A rotor driven by a coil of 0.1 H without resistance."""
    rotor = mbd.Body("rotor", mass=1.0, inertia=0.5)
    return rotor, mbd.Mechanism(
        bodies=[rotor],
        joints=[mbd.Revolute("pin", mbd.ground.at(0, 0), rotor.at(0, 0))],
        forces=[mbd.Torque("motor", rotor, constant * current)],
        inputs=[voltage],
        states={current: voltage / 0.1},
    )


@pytest.mark.slow
@pytest.mark.parametrize("transcription", SCHEMES)
@pytest.mark.parametrize("control", ["polynomial", "linear"])
def test_a_motor_with_a_current(transcription, control):
    """Least integral of the current's rate squared: with u = L di/dt and torque K i it is the minimum jerk."""
    v, current = mbd.Input("v"), mbd.StateVariable("i", 0.0)
    rotor, mechanism = electric_rotor(v, current, 0.2)
    problem = mbd.OptimalControlProblem(
        mechanism,
        duration=2.0,
        initial=[rotor.phi == 0, rotor.omega == 0, current == 0],
        final=[rotor.phi == 1, rotor.omega == 0, current == 0],
        running_cost=v**2,
    )
    solution = mbd.optimize(problem, intervals=20, transcription=transcription, control=control)
    exact = (0.1 * 0.5 / 0.2) ** 2 * 720 / 2**5
    # the voltage is a parabola; in an interval it is linear where it drives a state
    rel = 1e-4 if control == "linear" or transcription == "hermite-simpson" else 1e-5
    assert solution.cost == pytest.approx(exact, rel=rel)
    s = np.linspace(0, 1, 21)
    motion = solution.trajectory.at(2 * s)
    assert np.allclose(motion[rotor.phi], 10 * s**3 - 15 * s**4 + 6 * s**5, atol=1e-3)
    assert np.allclose(motion[current], 0.5 / 0.2 * (60 * s - 180 * s**2 + 120 * s**3) / 4, atol=0.02)
    assert solution.verify().final_error < 1e-3


@pytest.mark.slow
@pytest.mark.parametrize("transcription", SCHEMES)
def test_limits_of_a_state_hold(transcription):
    """A current at its limit: least time of a rotor with |i| <= 2 and a fast voltage is bang-bang in the current."""
    v, current = mbd.Input("v", lower=-1000, upper=1000), mbd.StateVariable("i", 0.0, lower=-2.0, upper=2.0)
    rotor, mechanism = electric_rotor(v, current, 0.5)
    problem = mbd.OptimalControlProblem(
        mechanism,
        duration=(0.1, 10),
        initial=[rotor.phi == 0, rotor.omega == 0, current == 0],
        final=[rotor.phi == 2, rotor.omega == 0, current == 0],
        terminal_cost=mbd.t,
    )
    solution = mbd.optimize(problem, intervals=60, transcription=transcription)
    assert 2.0 < solution.duration < 2.0 * 1.03
    assert np.max(np.abs(solution.trajectory[current])) < 2 + 1e-6
    assert {"i <= 2", "i >= -2"} <= {a.label for a in solution.active_limits}


# --- friction from reactions ---------------------------------------------------------------------------
@pytest.mark.slow
@pytest.mark.parametrize("transcription", SCHEMES)
def test_friction_from_the_reaction_of_a_guide(transcription):
    """A force pressed obliquely on a guide: N = m g - u sin a, friction mu N with the law smooth in N and v."""
    u = mbd.Input("u")
    mu, slope, speed = 0.3, np.tan(0.4), 0.05
    block = mbd.Body("block", mass=1.0, inertia=0.01)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    normal = guide.reaction_on(block).force[1]
    friction = mbd.Force("friction", block.at(0, 0), (-mu * normal * mbd.tanh(block.vx / speed), 0))
    push = mbd.Force("push", block.at(0, 0), (u, -slope * u))
    mechanism = mbd.Mechanism(bodies=[block], joints=[guide], forces=[mbd.Gravity(), push, friction], inputs=[u])
    rest = dict(duration=1.5, initial=[block.x == 0, block.vx == 0], final=[block.x == 1, block.vx == 0])
    solution = mbd.optimize(
        mbd.OptimalControlProblem(mechanism, running_cost=u**2, **rest), intervals=40, transcription=transcription
    )
    # the same with the reaction substituted by hand
    by_hand = mbd.Force("friction", block.at(0, 0), (-mu * (9.81 + slope * u) * mbd.tanh(block.vx / speed), 0))
    explicit = mechanism.replace(forces=[mbd.Gravity(), push, by_hand])
    reference = mbd.optimize(
        mbd.OptimalControlProblem(explicit, running_cost=u**2, **rest), intervals=40, transcription=transcription
    )
    assert solution.cost == pytest.approx(reference.cost, rel=1e-6)
    motion = solution.trajectory
    assert np.allclose(motion[normal], 9.81 + slope * motion[u], atol=1e-7)
    assert solution.verify().final_error < 5e-3


def test_friction_in_a_pin():
    """A bearing whose friction torque goes with its load: inverse dynamics by hand along the optimum."""
    bob, tau, mechanism = pendulum(length=0.5, mass=2.0, inertia=0.05)
    pin = mechanism.joints[0]
    load = mbd.norm(pin.reaction_on(bob).force)
    drag = mbd.Torque("drag", bob, -0.02 * load * mbd.tanh(bob.omega / 0.1))
    problem = mbd.OptimalControlProblem(
        mechanism.replace(forces=[*mechanism.forces, drag]),
        duration=1.0,
        initial=[bob.phi == 0, bob.omega == 0],
        final=[bob.phi == 1.5, bob.omega == 0],
        running_cost=tau**2,
    )
    solution = mbd.optimize(problem, intervals=40)
    motion = solution.trajectory
    phi, omega, alpha = motion[bob.phi], motion[bob.omega], motion[bob.alpha]
    radial = 2 * (9.81 * np.cos(phi) + 0.5 * omega**2)
    across = 2 * (9.81 * np.sin(phi) + 0.5 * alpha)
    force = np.hypot(radial, across)
    assert np.allclose(motion[load], force, rtol=1e-6)
    torque = (0.05 + 2 * 0.25) * alpha + 2 * 9.81 * 0.5 * np.sin(phi) + 0.02 * force * np.tanh(omega / 0.1)
    assert np.allclose(motion[tau], torque, atol=1e-5 * np.max(np.abs(torque)))
    assert solution.verify().final_error < 1e-4
