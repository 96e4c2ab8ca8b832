"""A user's program with every public class; ``mypy --strict`` finds nothing in it, and what is marked ``# E`` below."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import casadi as ca
import numpy as np

import mbdcasadi as mbd

k = mbd.Parameter("k", 20.0, lower=1.0)
tau = mbd.Input("tau", lower=-60, upper=60, unit="N m")
shapes: list[mbd.Shape] = [mbd.Disc(0.1), mbd.Rectangle(0.2, 0.1), mbd.Rod(0.4), mbd.Polygon(((0, 0), (1, 0), (0, 1)))]
program = mbd.MotionProgram(mbd.rise(np.pi, 0.01, "3-4-5"), mbd.fall(np.pi, "cycloidal"))
egg = mbd.CamOutline(lambda x: 0.05 + 0.006 * mbd.cos(x))
rail = mbd.Curve(lambda s: (s, s**2), -2, 2)


def body(name: str, x: float = 1.0) -> mbd.Body:
    """A body beside the ground."""
    return mbd.Body(name, mass=np.float64(1.0), inertia=0.1 * k, pose=(x, 0.2, 0), shape=shapes[0])


def joints(a: mbd.Marker, b: mbd.Marker) -> list[mbd.ConstraintElement]:
    """One of each; a list of joints of one kind and one of all kinds are both taken by a mechanism."""
    pairs: list[mbd.Joint] = [
        mbd.Revolute("pin", a, b), mbd.Translational("guide", a, b), mbd.Weld("weld", a, b), mbd.Distance("d", a, b, 1),
        mbd.PointOnLine("slot", a, b), mbd.Gear("mesh", a, b, 0.1, 0.2), mbd.Belt("belt", a, b, 0.1, 0.2),
        mbd.Coupler("coupler", a, b, 2.0), mbd.RackAndPinion("rack", a, b, 0.1), mbd.Rolling("wheel", a, b, 0.1),
        mbd.RelativeX("dx", a, b, 0.5), mbd.RelativeY("dy", a, b, 0.5), mbd.RelativeAngle("turn", a, b, mbd.t),
        mbd.PointOnCurve("rail", a, b, rail), mbd.CamCam("cams", a, b, egg, egg), mbd.CamFlatFollower("f", a, b, egg),
        mbd.CamPointFollower("roller", a, b, egg, 0.01), mbd.RollingOnCurve("road", a, b, rail, 0.1, slips=True),
    ]  # fmt: skip
    wheel = mbd.Pulley(mbd.ground.at(3, 3), 0.1, "clockwise", grips=True)
    rows: list[mbd.ConstraintElement] = [
        mbd.AbsoluteX("x", b, 1.0), mbd.AbsoluteY("y", b, 0), mbd.AbsoluteAngle("level", b),
        mbd.OneWayClutch("free wheel", a.body, b.body), mbd.Clutch("clutch", a.body, b.body, 3.0 * k),
        mbd.Cable("cable", mbd.Drum(a, 0.1, "clockwise"), b, [wheel], length=9.0),
        mbd.AbsoluteDistance("tether", b, (0, 0), k), mbd.Constraint("own", b.x - 1), mbd.KnifeEdge("blade", b),
        mbd.NonholonomicConstraint("skate", b.body.vx - 2 * b.body.vy), mbd.Driver("drive", b.body.phi, 2 * mbd.t),
        mbd.Actuator("jack", a, b, 0.5 + 0.1 * mbd.t), mbd.Driver("servo", b.body.x, mbd.StateVariable("place")),
        mbd.Driver("data", b.body.y, mbd.smoothing_spline([0, 1, 2, 3, 4, 5], [0, 1, 0, 1, 0, 1], cutoff=0.1)),
    ]  # fmt: skip
    return [*pairs, *rows]


def forces(a: mbd.Marker, b: mbd.Marker, pin: mbd.Joint) -> list[mbd.Element]:
    """One of each."""
    hunt, dry = mbd.HuntCrossley(1e5, damping=0.1), mbd.DryFriction(0.2)
    laws: list[mbd.FrictionLaw] = [
        mbd.Viscous(2.0), mbd.Coulomb(0.2, 1e-3), mbd.Stribeck(0.2, 0.3, 0.1, 1e-3), mbd.LuGre(0.2, 0.3, 0.1, 1e4), dry
    ]  # fmt: skip
    outlines = [
        mbd.Circle(b, 0.1), mbd.Point(b), mbd.Segment(b, 0.2), mbd.PolygonEdges(b, [(0, 0), (0.1, 0), (0, 0.1)])
    ]  # fmt: skip
    return [
        mbd.Gravity(), mbd.Force("push", b, (tau, 0)), mbd.Torque("motor", b.body, tau),
        mbd.MassFlow("jet", b, -k, (0, -9)),
        mbd.GeneralizedForce("load", [(b.x, 3.0), (b.body.phi, tau)]), mbd.TSDA("spring", a, b, stiffness=k),
        mbd.RSDA("torsion", a, b, 5.0), mbd.Bushing("rubber", a, b, (1e4, 2e4)), mbd.Rope("rope", a, b, 1.0, 1e4),
        mbd.EndStop("stop", b.y, hunt), mbd.Cylinder("cylinder", a, b, 0.05), mbd.PIController("pi", b.x, 1.0, 0.5),
        mbd.HydraulicCylinder("oil", a, b, 0.05, 0.02, 0.5, 1e-4, mbd.orifice_flow(1e-6, tau, k)),
        mbd.GasSpring("gas", a, b, 1e-3, 0.3, 2e5),
        mbd.DCMotor("servo", b.body, tau, 0.1, 1.0), mbd.FirstOrderLag("lag", tau, 0.1), mbd.EnergyMeter("work", tau),
        mbd.FieldForce("wind", b.body, lambda place: (place.y, 0)), mbd.JointFriction("rub", pin, laws[0], radius=0.01),
        mbd.LoadIndependentFriction("seal", pin, laws[1], load=10.0, radius=0.01),
        *(mbd.Contact(f"c{n}", o, mbd.HalfPlane(a), hunt, laws[2]) for n, o in enumerate(outlines)),
        mbd.RigidContact("hard", outlines[0], mbd.HalfPlane(a), friction=dry, restitution=0.5),
        mbd.Contact("drum", outlines[0], mbd.HollowCircle(a, 1.0), hunt),
        mbd.ElasticBelt("chain", a, b, 0.1, 0.005 * k, 1e6, pretension=50.0, slack=1e-3 * k),
        mbd.Backlash("teeth", mbd.Gear("mesh", a, b, 0.2, 0.1), k, hunt),
        mbd.Wheel("tyre", b, a, lambda x: 0.1 * x, 0.3, hunt, laws[1]),
        mbd.TSDA("data", a, b, law=mbd.DataLaw([-0.1, 0, 0.1], [-50, 0, 50], free=0.3)),
    ]  # fmt: skip


class Magnet(mbd.Element):
    """A force of the user's own, with a condition of validity and a smoothed quantity."""

    def __init__(self, name: str, a: mbd.Marker, b: mbd.Marker):
        super().__init__(name)
        self.length = mbd.distance(a, b)
        self.virtual_work = ((self.length, -0.02 / self.length**3),)
        self.validity_conditions = (mbd.ValidityCondition(self.length - 0.01, "too close"),)
        self.smoothed = mbd.Smoothing(self.length, 1e-3, "the magnet", "shorter steps")


class Sticky(mbd.FrictionLaw):
    """A law of the user's own."""

    def resistance(self, what: str, speed: ca.SX, load: ca.SX) -> mbd.Resistance:
        return mbd.Resistance(load * speed)


def pendulum() -> tuple[mbd.Mechanism, mbd.Body, mbd.Revolute]:
    """A rod on a pin."""
    rod = body("rod")
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), rod.at(-1, 0))
    magnet = Magnet("magnet", mbd.ground.at(0, -3), rod.at(1, 0))
    z = mbd.StateVariable("z", 0.0)
    mechanism = mbd.Mechanism(
        [rod], [pin], forces=[mbd.Gravity(), mbd.Torque("motor", rod, tau), magnet], inputs=[tau], parameters=[k],
        states={z: rod.omega - z},
    )  # fmt: skip
    return mechanism, rod, pin


class Euler(mbd.SteppingMethod):
    """Explicit Euler, a step to each stop."""

    name = "euler"

    def steps(self, system: mbd.RunEquations, t: float, y: np.ndarray, end: float) -> Iterator[mbd.IntegratorStep]:
        yield mbd.IntegratorStep(t, end, y, y + (end - t) * system.rates(t, y))


def analyses() -> None:
    """Each analysis, and what its result holds."""
    mechanism, rod, pin = pendulum()
    equations: mbd.Equations = mbd.equations(mechanism)
    report: mbd.Report = mbd.check(mechanism)
    assert equations.M.shape == (3, 3) and report.degrees_of_freedom == 1
    start: mbd.State = mbd.assemble(mechanism, [rod.phi == -1.0, rod.omega == 0])
    reaction: mbd.Reaction = pin.reaction_on(rod)
    stop = mbd.Event("bottom", rod.x, terminal=True)
    plan = mbd.OptimalControlProblem(mechanism, duration=0.2, running_cost=rod.phi**2 + tau**2)
    controller = mbd.Controller(plan, sample=0.1, intervals=2)
    step: mbd.ControlStep = controller.step([0.1, 0.0, 0.0])
    course: mbd.ControlPlan = controller.plan
    timing: mbd.ControlTiming = controller.timing
    assert step.status == 0 and course.t.size == 3 and timing.feedback.size == 1
    estimator = mbd.Estimator(mechanism, [rod.phi], [0.01], {tau: 0.1}, sample=0.1, horizon=5, unknown=[k])
    estimator.reset(start, np.eye(len(estimator.state_names)))
    seen: mbd.State = estimator.update([0.1], {tau: 0.0})
    assert seen.t > 0.0 and estimator.covariance.shape == (4, 4)
    fed: mbd.FedController = controller.fed_by(estimator, np.eye(4), seed=1)
    assert fed.estimates == ()
    law: mbd.LinearFeedback = mbd.optimize(plan, initial=start).feedback({tau: 1.0})
    assert law.gains(0.1).shape == (1, len(law.state_names))
    hold = mbd.SampledController(lambda time, state: {tau: 0.1 * time}, period=0.1)
    methods: list[mbd.Integrator] = [mbd.IDAS(), mbd.DOP853(), mbd.BDF(), mbd.RungeKutta(), mbd.Rosenbrock()]
    methods.append(Euler())
    motion: mbd.Trajectory = mbd.simulate(
        mechanism, np.linspace(0, 0.2, 5), initial=start, inputs=hold, parameters={k: 30.0}, events=[stop],
        method=methods[0],
    )  # fmt: skip
    load = motion[mbd.norm(reaction.force)]
    print(f"{load.max():.1f} N, {motion[[rod.x, rod.y]].shape}, {float(start[rod.phi]):.2f} rad, {len(motion.t)} times")

    free = mbd.library.four_bar(free=True)
    places = [[free.crank.phi == 0.3 * x, free.rocker.phi == 0.2 * x] for x in range(3)]
    linkages: mbd.Linkages = mbd.synthesize(free.mechanism, list(free.unknowns.values()), places, seconds=0.5)
    six: mbd.library.Model = mbd.library.stephenson(3, {"P": (0.8, 1.5)}, masses=2.0)
    assert six.unknowns["Py"].value == 1.5 and mbd.library.watt(1).mechanism.bodies
    linkage: mbd.Linkage = linkages[0]
    assert linkage.residual < 1e-9 and linkages.where(crank_turns=True).sorted(lambda x: x.residual) is not None
    below: mbd.Reachability = mbd.reachable(mechanism, [rod.y <= -0.2], path=[rod.x <= 1])
    assert below.is_reachable
    rest: mbd.Equilibrium = mbd.equilibrium(mechanism, [rod.y <= 0])
    path: mbd.EquilibriumPath = mbd.equilibrium_path(mechanism, tau, 0, 1, [rod.y <= 0])
    rub = mbd.LoadIndependentFriction("rub", pin, mbd.DryFriction(9.0), load=60.0, radius=0.5)
    loads: mbd.HoldingRange = mbd.holding_range(mechanism.replace(forces=[*mechanism.forces, rub]), tau)
    linear: mbd.LinearModel = mbd.linearize(mechanism, rest)
    slopes: mbd.Sensitivities = mbd.sensitivities(mechanism, [0, 0.1], {"y": rod.y}, [k], start)
    cases = {k: np.array([20.0, 40.0])}
    swept: mbd.Sweep = mbd.sweep(mechanism, [0, 0.1], cases, {"y": rod.y}, initial=start, progress=False)
    cost: mbd.CostFunction = mbd.cost_function(mechanism, [0, 0.1], [k], running_cost=rod.y**2, initial=start)
    fall = mbd.simulate(mechanism, np.linspace(0, 1, 11), initial=start, parameters={k: 30.0})
    data = mbd.Experiment(fall.t, {rod.y: fall[rod.y]}, initial=start)
    fit: mbd.Fit = mbd.identify(mechanism, unknowns=[k], experiments=[data])
    ground: mbd.ShakingForce = mbd.shaking_force(mechanism)
    print(path[rod.phi], loads.least, linear.A, slopes["y"], swept["y"], cost([20.0]), fit[k], motion[ground.force])


def optimal_control() -> mbd.Solution:
    """A swing over half a turn in one phase, or in two."""
    mechanism, rod, pin = pendulum()
    rest = [rod.phi == -np.pi / 2, rod.omega == 0]
    problem = mbd.OptimalControlProblem(
        mechanism, duration=(0.5, 2.0), initial=rest, final=[rod.phi == np.pi / 2, rod.omega == 0], running_cost=tau**2,
        path=[mbd.bounded(-9, rod.omega, 9), mbd.norm(pin.reaction_on(rod).force) <= 60],
        waypoints=[mbd.Waypoint((0.1, 1.0), [rod.phi == 0, mbd.soft(rod.omega <= 5, weight=0.1)])],
    )  # fmt: skip
    schemes: list[mbd.Transcription] = [mbd.GaussLegendre(2), mbd.HermiteSimpson()]
    swing = mbd.Phase("swing", mechanism, (0.2, 1.0), initial=rest, running_cost=tau**2)
    mbd.OptimalControlProblem(phases=[swing], boundary=[mbd.at_end(rod.phi) == 0], terminal_cost=mbd.integral(tau**2))
    solution: mbd.Solution = mbd.optimize(problem, intervals=10, transcription=schemes[0])
    cycle: type[mbd.Stability] = mbd.Stability
    point: type[mbd.CollocationPoint] = mbd.CollocationPoint
    print(cycle, point)
    return solution


def files(path: str) -> mbd.Trajectory:
    """A model of MuJoCo and a start of it."""
    robot = mbd.read_mjcf(path)
    home: mbd.Keyframe = mbd.read_keyframes(path, robot)["home"]
    return mbd.simulate(robot, duration=1.0, initial=home.initial, inputs=home.inputs)


def pictures(motion: mbd.Trajectory) -> mbd.Animation:
    """Each drawing."""
    mbd.draw(motion, poses=3)
    mbd.plot(motion, {"x": motion.mechanism.bodies[0].x})
    return mbd.animate(motion)


class Star(mbd.Glyph):
    """A symbol of the user's own."""


class Again(mbd.Strategy):
    """A strategy of one's own."""

    name = "again"

    def applies(self, trials: Any) -> bool:
        """Return True if there is a solution."""
        return bool(trials.solved)

    def proposals(self, trials: Any) -> Any:
        """Propose a solve from it."""
        yield mbd.Proposal(trials.guesses[0], "again", 50)


def robots() -> list[mbd.Mechanism]:
    return [
        mbd.read_mjcf("leg.xml", contacts=False),
        mbd.read_urdf("arm.urdf", gravity=(0, 0, -1.6), contacts=False),
        mbd.read_sdf("cart.sdf", gravity=[0, 0, -9.81], contacts=False),
    ]


def failures() -> list[type[mbd.MechanismError]]:
    """Errors and the warning are classes, with what had been computed."""
    print(mbd.Coordinate("s", 0.1), mbd.MechanismWarning("read this"))
    try:
        mbd.simulate(pendulum()[0], duration=-1.0)
    except mbd.SimulationError as error:
        print(error.time, error.partial)
    return [
        mbd.AssemblyError, mbd.ConditionError, mbd.EquilibriumError, mbd.ExpressionError, mbd.FileError,
        mbd.Interrupted, mbd.IdentificationError, mbd.ModelError, mbd.OptimizationError, mbd.SimulationError,
        mbd.SingularityError,
    ]  # fmt: skip


def mistakes() -> None:
    """What a type checker finds before the program runs."""
    mechanism, rod, _ = pendulum()
    mbd.Body("b", mass="heavy", inertia=1.0)  # E
    mbd.Body("b", 1.0, 1.0, pose="here")  # E
    mbd.Revolute("pin", mbd.ground.at(0, 0), rod)  # E
    mbd.TSDA("spring", mbd.ground.at(0, 0), rod.at(0, 0), stiffness=[1, 2])  # E
    mbd.Mechanism(rod)  # E
    mbd.Mechanism([rod], [mbd.ground.at(0, 0)])  # E
    mbd.Input("u", lower="none")  # E
    mbd.simulate(mechanism, "ten seconds")  # E
    mbd.simulate(mechanism, duration=1.0, initial={rod.phi: 0.3})  # E
    mbd.simulate(mechanism, duration=1.0)["x"]  # E
    mbd.optimise(mechanism)  # E
