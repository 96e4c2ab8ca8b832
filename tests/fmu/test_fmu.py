"""Functional mock-up units against ``simulate`` of the same mechanism."""

import ctypes
import tempfile
import zipfile
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from disk import full_disk
from scipy.integrate import solve_ivp

import mbdcasadi as mbd
from mbdcasadi.__main__ import main

fmpy = pytest.importorskip("fmpy")

from fmpy.fmi1 import FMICallException  # noqa: E402
from fmpy.simulation import instantiate_fmu  # noqa: E402
from fmpy.validation import validate_fmu  # noqa: E402
from units import Unit, simulated  # noqa: E402

TIMES = np.linspace(0, 10, 1001)
TIGHT = dict(method="dop853", reltol=1e-9, abstol=1e-9)


class FourBar:
    """A crank-rocker with a torque as input, and damping and a length as parameters."""

    def __init__(self):
        a, b, c, d = 0.10, 0.28, 0.24, 0.30
        self.torque = mbd.Input("torque", 0.1, lower=-1, upper=1)
        self.damping = mbd.Parameter("damping", 0.02, lower=0.0)
        self.ground = mbd.Parameter("ground", d)
        crank = mbd.Body("crank", mass=0.3, inertia=0.3 * a**2 / 12, pose=(0.04, 0.02, 0.5))
        coupler = mbd.Body("coupler", mass=0.8, inertia=0.8 * b**2 / 12, pose=(0.19, 0.14, 0.7))
        rocker = mbd.Body("rocker", mass=0.7, inertia=0.7 * c**2 / 12, pose=(0.30, 0.12, 1.6))
        self.o2 = mbd.Revolute("O2", mbd.ground.at(0, 0), crank.at(-a / 2, 0))
        pin = mbd.Revolute("B", coupler.at(b / 2, 0), rocker.at(c / 2, 0))
        self.mechanism = mbd.Mechanism(
            bodies=[crank, coupler, rocker],
            joints=[
                self.o2,
                mbd.Revolute("A", crank.at(a / 2, 0), coupler.at(-b / 2, 0)),
                pin,
                mbd.Revolute("O4", mbd.ground.at(self.ground, 0), rocker.at(-c / 2, 0)),
            ],
            forces=[
                mbd.Gravity(),
                mbd.RSDA("bearing", mbd.ground.at(0, 0), crank.at(-a / 2, 0), damping=self.damping),
                mbd.Torque("motor", crank, self.torque),
            ],
            inputs=[self.torque],
            parameters=[self.damping, self.ground],
            name="four-bar",
        )
        self.initial = [self.o2.angle == 0.5, crank.omega == 12]
        self.outputs = {
            "angle": self.o2.angle,
            "speed": crank.omega,
            "pin force": mbd.norm(pin.reaction_on(rocker).force),
            "energy": 0.35 * mbd.dot(rocker.velocity, rocker.velocity),
        }


@pytest.fixture(scope="module")
def linkage():
    return FourBar()


@pytest.fixture(scope="module")
def paths(linkage, tmp_path_factory):
    """Units of the four-bar for both kinds, by version."""
    folder = tmp_path_factory.mktemp("units")
    return {
        version: mbd.export_fmu(
            linkage.mechanism,
            folder / f"four bar {version}.fmu",
            outputs=linkage.outputs,
            initial=linkage.initial,
            kind=("co-simulation", "model-exchange"),
            version=version,
            units={"pin force": "N", "torque": "N.m"},
            stop=2.0,
        )
        for version in (2, 3)
    }


@pytest.fixture
def unit(paths, tmp_path):
    """Start an instance of the four-bar."""

    def make(version=2, kind="CoSimulation"):
        return Unit(paths[version], tmp_path, kind)

    return make


def columns(motion, outputs):
    return np.column_stack([motion[expression] for expression in outputs.values()])


def off(found, known):
    """Largest difference of each column, relative to its size where that is above one."""
    return np.max(np.abs(found - known), axis=0) / np.maximum(1, np.max(np.abs(known), axis=0))


# --- the same motion as simulate -------------------------------------------------------------------
@pytest.mark.slow
@pytest.mark.parametrize("version", [2, 3])
@pytest.mark.parametrize("kind", ["CoSimulation", "ModelExchange"])
def test_four_bar_moves_as_in_simulate(paths, linkage, version, kind):
    """Angles, reactions and energies over 10 s, in both kinds and versions."""
    assert validate_fmu(str(paths[version])) == []
    motion = mbd.simulate(
        linkage.mechanism, TIMES, initial=linkage.initial, parameters={linkage.damping: 0.03}, **TIGHT
    )
    found = simulated(paths[version], TIMES, linkage.outputs, kind, damping=0.03)
    assert np.all(off(found, columns(motion, linkage.outputs)) < 1e-6)


def slider_crank():
    machine = mbd.library.slider_crank().mechanism
    crank, slider = machine.bodies[0], machine.bodies[2]
    main = machine.joints[0]
    damper = mbd.RSDA("bearing", mbd.ground.at(0, 0), crank.at(0, 0), damping=0.05)
    machine = machine.replace(forces=[*machine.forces, damper])
    force = machine.joints[1].reaction_on(crank).force
    return machine, [main.angle == 0.4, crank.omega == 20.0], {"x": slider.x, "force": mbd.norm(force), "a": slider.ax}


def cart_pole():
    push = mbd.Input("push", 0.3)
    cart = mbd.Body("cart", mass=1.0, inertia=0.1)
    pole = mbd.Body("pole", mass=0.2, inertia=0.006, pose=(0, -0.3, 0))
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0))
    pin = mbd.Revolute("pin", cart.at(0, 0), pole.at(0, 0.3))
    force = mbd.Force("push", cart.at(0, 0), mbd.vertcat(push - 0.5 * cart.vx, 0))
    machine = mbd.Mechanism(
        bodies=[cart, pole], joints=[rail, pin], forces=[mbd.Gravity(), force], inputs=[push], name="cart-pole"
    )
    initial = [pin.angle == 1.5, cart.x == 0, cart.vx == 0, pole.omega == 0.1]
    return machine, initial, {"x": cart.x, "angle": pin.angle, "load": rail.reaction_on(cart).force[1]}


def bouncing_ball():
    ball = mbd.Body("ball", mass=0.2, inertia=1e-4, pose=(0, 0.5, 0), velocity=(0.3, 0, 0))
    law = mbd.HuntCrossley(stiffness=1e4, damping=1.0)
    floor = mbd.Contact("floor", mbd.HalfPlane(mbd.ground.at(0, 0)), mbd.Circle(ball.at(0, 0), 0.05), law=law)
    return mbd.Mechanism(bodies=[ball], forces=[mbd.Gravity(), floor], name="ball"), (), {"y": ball.y, "x": ball.x}


def motor_drive():
    arm = mbd.Body("arm", mass=0.3, inertia=0.001, pose=(0.1, 0, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), arm.at(-0.1, 0))
    voltage, current = mbd.Input("voltage", 6.0), mbd.StateVariable("current", 0.0)
    torque = mbd.Torque("motor", arm, 0.05 * current - 0.002 * arm.omega)
    machine = mbd.Mechanism(
        bodies=[arm],
        joints=[pin],
        forces=[mbd.Gravity(), torque],
        states={current: (voltage - 2.0 * current - 0.05 * arm.omega) / 0.05},
        inputs=[voltage],
        name="motor drive",
    )
    return machine, [pin.angle == 0, arm.omega == 0], {"angle": pin.angle, "power": voltage * current}


def crane_with_a_servo():
    command, place, speed = mbd.Input("command", 0.1), mbd.StateVariable("place"), mbd.StateVariable("speed")
    trolley = mbd.Body("trolley", mass=5.0, inertia=1.0)
    bob = mbd.Body("bob", mass=2.0, inertia=0.1, pose=(0, -1, 0))
    joints = [
        mbd.Translational("rail", mbd.ground.at(0, 0), trolley.at(0, 0)),
        mbd.Revolute("pivot", trolley.at(0, 0), bob.at(0, 1)),
    ]
    servo = mbd.Driver("servo", trolley.x, place)
    states = {place: speed, speed: command - 0.2 * speed}
    machine = mbd.Mechanism([trolley, bob], joints, [servo], [mbd.Gravity()], [command], states=states)
    initial = [trolley.x == 0.3, trolley.vx == 0.1, bob.phi == 0, bob.omega == 0]
    return machine, initial, {"x": trolley.x, "angle": bob.phi, "effort": servo.effort}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("machine", "version", "tolerance"),
    [
        (slider_crank, 2, 1e-11),
        (cart_pole, 3, 1e-11),
        (bouncing_ball, 3, 1e-11),
        (motor_drive, 2, 1e-11),
        (crane_with_a_servo, 3, 1e-11),
    ],
)
def test_machines_move_as_in_simulate(machine, version, tolerance, tmp_path):
    """In both kinds, at equal and at tight tolerances."""
    mechanism, initial, outputs = machine()
    path = mbd.export_fmu(
        mechanism, tmp_path / "unit.fmu", initial=initial, outputs=outputs, kind="both", version=version
    )
    assert validate_fmu(str(path)) == []
    motion = mbd.simulate(mechanism, TIMES, initial=initial, **TIGHT | dict(reltol=tolerance, abstol=tolerance))
    for kind in ("CoSimulation", "ModelExchange"):
        found = simulated(path, TIMES, outputs, kind, tolerance)
        assert np.all(off(found, columns(motion, outputs)) < 1e-6), kind


def rubbing_ball():
    machine, _, outputs = bouncing_ball()
    (ball,), (gravity, floor) = machine.bodies, machine.forces
    shapes = mbd.HalfPlane(mbd.ground.at(0, 0)), mbd.Circle(ball.at(0, 0), 0.05)
    rubbing = mbd.Contact("floor", *shapes, law=floor.law, friction=mbd.Coulomb(0.3, 0.05))
    return machine.replace(forces=[gravity, rubbing]), (), outputs | {"spin": ball.omega}


def block_between_forces():
    block = mbd.Body("block", mass=1, inertia=1)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), block.at(0, 0))
    force = mbd.Force("push", block.at(0, 0), mbd.vertcat(mbd.if_else(block.x > 0.3, -20.0, 5.0), 0))
    machine = mbd.Mechanism(bodies=[block], joints=[rail], forces=[force])
    return machine, [block.x == 0, block.vx == 0], {"x": block.x, "v": block.vx}


@pytest.mark.slow
@pytest.mark.parametrize("machine", [rubbing_ball, block_between_forces])
def test_steps_end_where_the_state_switches(machine, tmp_path):
    """Contacts and comparisons at 1e-8: the motion is that of dop853, and the same after going back to any time."""
    mechanism, initial, outputs = machine()
    path = mbd.export_fmu(mechanism, tmp_path / "unit.fmu", initial=initial, outputs=outputs, kind="both", version=2)
    times = np.linspace(0, 3, 301)
    exact = mbd.simulate(mechanism, times, initial=initial, method="dop853", reltol=1e-12, abstol=1e-12)
    unit = Unit(path, tmp_path).start(tolerance=1e-8)
    rows = [unit.get(*outputs)]
    for begin, end in pairwise(times):
        unit.time, saved = begin, unit.fmu.getFMUState()
        unit.step((end - begin) / 3)
        unit.fmu.setFMUState(saved)
        unit.fmu.freeFMUState(saved)
        unit.time = begin
        unit.step(end - begin)
        rows.append(unit.get(*outputs))
    assert np.all(off(np.array(rows), columns(exact, outputs)) < 2e-6)
    assert np.array_equal(Unit(path, tmp_path).start(tolerance=1e-8).run(times, *outputs), rows)
    # the importer's solver stops at the same switches
    found = simulated(path, times, outputs, "ModelExchange", 1e-10)
    assert np.all(off(found, columns(exact, outputs)) < 1e-5)


@pytest.mark.slow
def test_instances_in_threads(paths, linkage, tmp_path):
    """Several instances of one library that run at once each give what they give alone."""
    description, folder = fmpy.read_model_description(str(paths[2])), str(tmp_path / "unit")
    fmpy.extract(str(paths[2]), folder)

    def run(damping):
        unit = instantiate_fmu(folder, description, "CoSimulation")
        more = dict(model_description=description, fmu_instance=unit, fmi_type="CoSimulation", start_values=damping)
        found = fmpy.simulate_fmu(folder, stop_time=0.5, output_interval=0.01, output=list(linkage.outputs), **more)
        return np.array(found.tolist())

    values = [{"damping": value} for value in (0.01, 0.02, 0.05, 0.1)]
    alone = [run(value) for value in values]
    with ThreadPoolExecutor(len(values)) as pool:
        assert all(map(np.array_equal, pool.map(run, values), alone))
    assert np.max(np.abs(alone[0] - alone[1])) > 0.1


@pytest.mark.slow
def test_redundant_rows_and_reactions(tmp_path):
    """A parallelogram with three cranks: the motion, and reactions of least norm."""
    cranks = [mbd.Body(f"crank {k}", mass=1, inertia=0.1, pose=(k, 0.5, np.pi / 2)) for k in range(3)]
    bar = mbd.Body("bar", mass=2, inertia=1, pose=(1, 1, 0))
    joints = [mbd.Revolute(f"foot {k}", mbd.ground.at(k, 0), c.at(-0.5, 0)) for k, c in enumerate(cranks)]
    joints += [mbd.Revolute(f"head {k}", c.at(0.5, 0), bar.at(k - 1, 0)) for k, c in enumerate(cranks)]
    swing = mbd.RSDA("spring", mbd.ground.at(0, 0), cranks[0].at(-0.5, 0), stiffness=60, free_angle=1.6, damping=0.5)
    machine = mbd.Mechanism(bodies=[*cranks, bar], joints=joints, forces=[mbd.Gravity(), swing])
    outputs = {"angle": joints[0].angle, "force": joints[4].reaction_on(bar).force[1]}
    initial = [joints[0].angle == 1.8, cranks[0].omega == 0]
    path = mbd.export_fmu(machine, tmp_path / "unit.fmu", initial=initial, outputs=outputs)
    times = np.linspace(0, 2, 101)
    motion = mbd.simulate(machine, times, initial=initial, method="erk", reltol=1e-10, abstol=1e-10)
    assert np.all(off(simulated(path, times, outputs), columns(motion, outputs)) < 1e-6)


@pytest.mark.slow
def test_friction_that_depends_on_reactions(tmp_path):
    """Coulomb friction in a pin by its own load, by Newton's method in C; its derivatives are those of the rates."""
    arm = mbd.Body("arm", mass=1, inertia=0.1, pose=(0.5, 0, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), arm.at(-0.5, 0))
    friction = mbd.JointFriction("friction", pin, mbd.Coulomb(0.2, 0.05), radius=0.05)
    machine = mbd.Mechanism(bodies=[arm], joints=[pin], forces=[mbd.Gravity(), friction], name="pin")
    outputs = {"angle": pin.angle, "torque": friction.torque}
    initial = [pin.angle == 0, arm.omega == 0]
    path = mbd.export_fmu(machine, tmp_path / "unit.fmu", initial=initial, outputs=outputs, version=2, kind="both")
    times = np.linspace(0, 3, 151)
    motion = mbd.simulate(machine, times, initial=initial, reltol=1e-10, abstol=1e-10)
    assert np.all(off(simulated(path, times, outputs, tolerance=1e-10), columns(motion, outputs)) < 1e-6)
    check_tangent(Unit(path, tmp_path, "ModelExchange").start())


@pytest.mark.slow
def test_friction_by_reactions_beside_a_body_without_mass(tmp_path):
    """A slider-crank with a massless rod: the reactions, and the friction by them, from effective masses."""
    crank = mbd.Body("crank", mass=0.3, inertia=0.001, pose=(0.05, 0, 0))
    rod = mbd.Body("rod", mass=0, inertia=0, pose=(0.25, 0, 0))
    slider = mbd.Body("slider", mass=0.5, inertia=0.01, pose=(0.4, 0, 0))
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), slider.at(0, 0))
    joints = [
        mbd.Revolute("O", mbd.ground.at(0, 0), crank.at(-0.05, 0)),
        mbd.Revolute("A", crank.at(0.05, 0), rod.at(-0.15, 0)),
        mbd.Revolute("B", rod.at(0.15, 0), slider.at(0, 0)),
        rail,
    ]
    friction = mbd.JointFriction("friction", rail, mbd.Coulomb(0.1, 0.05))
    machine = mbd.Mechanism(bodies=[crank, rod, slider], joints=joints, forces=[mbd.Gravity(), friction])
    outputs = {"x": slider.x, "load": rail.reaction_on(slider).force[1]}
    initial = [crank.phi == 0.3, crank.omega == 20]
    path = mbd.export_fmu(machine, tmp_path / "unit.fmu", initial=initial, outputs=outputs)
    times = np.linspace(0, 1, 51)
    motion = mbd.simulate(machine, times, initial=initial, reltol=1e-10, abstol=1e-10)
    assert np.all(off(simulated(path, times, outputs, tolerance=1e-10), columns(motion, outputs)) < 1e-6)


@pytest.mark.slow
def test_switches_in_time(tmp_path):
    """A force that is on for a moment between two communication points is neither lost nor smeared."""
    block = mbd.Body("block", mass=2, inertia=1)
    on = mbd.Parameter("on", 0.503)
    pulse = mbd.if_else(mbd.t < on, 0, mbd.if_else(mbd.t < on + 0.002, 100, 0))
    force = mbd.Force("pulse", block.at(0, 0), mbd.vertcat(pulse, 0))
    machine = mbd.Mechanism(bodies=[block], forces=[force], parameters=[on])
    path = mbd.export_fmu(machine, tmp_path / "unit.fmu", outputs={"v": block.vx, "x": block.x}, version=2, kind="both")
    times = np.linspace(0, 4, 5)
    known = np.column_stack([[0, 0.1, 0.1, 0.1, 0.1], 0.1 * np.maximum(times - 0.504, 0)])
    assert np.max(np.abs(simulated(path, times, ["v", "x"]) - known)) < 1e-9
    moved = simulated(path, times, ["v", "x"], on=1.503)
    assert np.max(np.abs(moved[2:] - known[1:-1])) < 1e-9
    assert np.max(np.abs(simulated(path, times, ["v", "x"], "ModelExchange") - known)) < 1e-6


# --- parameters, restarts, rollback ------------------------------------------------------------------
@pytest.mark.slow
def test_start_is_assembled_anew(unit, linkage):
    """A length that is changed before the start gives the start of ``assemble`` with that length."""
    for version in (2, 3):
        for value in (0.3, 0.32, 0.27):
            found = unit(version).start(ground=value).get("angle", "speed", "pin force", "energy", "rocker.phi")
            state = mbd.assemble(linkage.mechanism, linkage.initial, parameters={linkage.ground: value})
            known = [float(state[e]) for e in linkage.outputs.values()] + [
                float(state[linkage.mechanism.bodies[2].phi])
            ]
            assert np.max(np.abs(found - known)) < 1e-7
    impossible = unit()
    with pytest.raises(FMICallException):
        impossible.start(ground=2.0)
    assert "cannot be assembled at t = 0 s" in impossible.said[-1]


@pytest.mark.slow
def test_start_nearest_to_the_estimates(tmp_path):
    """Without conditions the start is that of ``assemble`` for other lengths too."""
    length = mbd.Parameter("length", 1.0)
    first = mbd.Body("first", mass=1, inertia=0.1, pose=(0.4, 0.1, 0.3), velocity=(0, 1, 1))
    second = mbd.Body("second", mass=2, inertia=0.2, pose=(1.3, 0.5, 0.6))
    joints = [
        mbd.Revolute("hinge", mbd.ground.at(0, 0), first.at(-0.5, 0)),
        mbd.Revolute("elbow", first.at(length - 0.5, 0), second.at(-0.5, 0)),
    ]
    machine = mbd.Mechanism(bodies=[first, second], joints=joints, parameters=[length])
    outputs = {"a": first.phi, "b": second.phi, "w": second.omega}
    path = mbd.export_fmu(machine, tmp_path / "unit.fmu", outputs=outputs)
    state = mbd.assemble(machine, parameters={length: 1.4})
    found = Unit(path, tmp_path).start(length=1.4).get(*outputs)
    assert np.max(np.abs(found - [float(state[e]) for e in outputs.values()])) < 1e-7


@pytest.mark.slow
def test_parameters_in_conditions(tmp_path):
    """Start values that an importer chooses: of an angle, a speed and a first-order state; limits that hold stay so."""
    first = mbd.Parameter("first", 0.3)
    arm = mbd.Body("arm", mass=1, inertia=0.1, pose=(0.5, 0.1, 0.2))
    other = mbd.Body("other", mass=1, inertia=0.1, pose=(1.5, 0.1, 0.2))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), arm.at(-0.5, 0))
    elbow = mbd.Revolute("elbow", arm.at(0.5, 0), other.at(-0.5, 0))
    charge = mbd.StateVariable("charge", 1.0)
    machine = mbd.Mechanism(
        bodies=[arm, other], joints=[pin, elbow], forces=[mbd.Gravity()], states={charge: -charge}, parameters=[first]
    )
    initial = [pin.angle == first, arm.omega == 2 * first, charge == first**2, other.phi >= 0.1, other.omega == 0]
    outputs = {"angle": pin.angle, "speed": arm.omega, "charge now": charge, "other": other.phi}
    path = mbd.export_fmu(machine, tmp_path / "unit.fmu", initial=initial, outputs=outputs, version=2)
    units = {v.name: v.unit for v in fmpy.read_model_description(str(path)).modelVariables}
    assert units["der(arm.phi)"] == "rad/s" and units["charge"] is units["der(charge)"] is None
    for value in (0.3, -0.7, 1.2):
        found = Unit(path, tmp_path).start(first=value).get(*outputs)
        assert found == pytest.approx([value, 2 * value, value**2, 0.1], abs=1e-9)


@pytest.mark.slow
def test_a_state_as_start(tmp_path):
    """A state that is given is the start; with another length, what is nearest to it."""
    length = mbd.Parameter("length", 1.0)
    arm = mbd.Body("arm", mass=1, inertia=0.1, pose=(0.5, 0, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), arm.at(-length / 2, 0))
    machine = mbd.Mechanism(bodies=[arm], joints=[pin], forces=[mbd.Gravity()], parameters=[length])
    state = mbd.simulate(machine, duration=0.7).final
    outputs = {"x": arm.x, "angle": arm.phi, "speed": arm.omega}
    path = mbd.export_fmu(machine, tmp_path / "unit.fmu", initial=state, outputs=outputs)
    assert Unit(path, tmp_path).start().get(*outputs) == pytest.approx([float(state[e]) for e in outputs.values()])
    _, angle, speed = Unit(path, tmp_path).start(length=1.2).get(*outputs)
    assert angle == pytest.approx(float(state[arm.phi]), abs=1e-3)
    assert speed == pytest.approx(float(state[arm.omega]), rel=0.2)


@pytest.mark.slow
def test_late_start_of_a_driven_mechanism(tmp_path):
    """Without any freedom, from a time at which the crank has turned ten times: motion and effort."""
    machine = mbd.library.slider_crank().mechanism
    crank = machine.joints[0]
    machine = machine.replace(drivers=[mbd.Driver("speed", crank.angle, 0.4 + 20 * mbd.t)])
    outputs = {"x": machine.bodies[2].x, "effort": machine.drivers[0].effort}
    path = mbd.export_fmu(machine, tmp_path / "unit.fmu", outputs=outputs)
    times = np.linspace(3.3, 4.3, 51)
    run = Unit(path, tmp_path).start(time=3.3)
    motion = mbd.inverse_dynamics(machine, times)
    assert np.max(np.abs(run.run(times, *outputs) - columns(motion, outputs))) < 1e-8


@pytest.mark.slow
def test_a_hard_contact_between_few_communication_points(tmp_path):
    """Steps of 0.3 s, contacts of a tenth of a millisecond: none is missed, and no energy is lost."""
    ball = mbd.Body("ball", mass=0.2, inertia=1e-4, pose=(0, 0.5, 0))
    law = mbd.HuntCrossley(stiffness=1e7)
    floor = mbd.Contact("floor", mbd.HalfPlane(mbd.ground.at(0, 0)), mbd.Circle(ball.at(0, 0), 0.05), law=law)
    machine = mbd.Mechanism(bodies=[ball], forces=[mbd.Gravity(), floor])
    height = 9.81 * ball.y + 0.5 * mbd.dot(ball.velocity, ball.velocity)
    outputs = {"y": ball.y, "energy": height}
    path = mbd.export_fmu(machine, tmp_path / "unit.fmu", outputs=outputs)
    times = np.linspace(0, 3, 11)
    found = simulated(path, times, outputs, tolerance=1e-10)
    motion = mbd.simulate(machine, times, method="dop853", reltol=1e-10, abstol=1e-10)
    assert np.max(np.abs(found - columns(motion, outputs))) < 1e-5
    assert np.ptp(found[:, 1]) < 1e-5 and np.min(found[:, 0]) > 0.045


@pytest.mark.slow
def test_contacts_far_shorter_than_a_step(tmp_path):
    """A ball that glances off a peg without loss keeps its speed, and turns as elastic reflection says."""
    stiffness, offset = mbd.Parameter("stiffness", 1e9), mbd.Parameter("offset", 0.03)
    ball = mbd.Body("ball", mass=0.2, inertia=1e-4, pose=(-2, 0, 0))
    peg = mbd.Circle(mbd.ground.at(0, -offset), 0.02)
    law = mbd.HuntCrossley(stiffness=stiffness)
    contact = mbd.Contact("peg", peg, mbd.Circle(ball.at(0, 0), 0.02), law=law)
    machine = mbd.Mechanism(bodies=[ball], forces=[contact], parameters=[stiffness, offset])
    initial = [ball.x == -2, ball.y == 0, ball.phi == 0, ball.vx == 40, ball.vy == 0, ball.omega == 0]
    outputs = {"vx": ball.vx, "vy": ball.vy}
    path = mbd.export_fmu(machine, tmp_path / "unit.fmu", outputs=outputs, initial=initial)
    random = np.random.default_rng(3)
    for tolerance in 10 ** -random.uniform(6, 10, 25):
        missed = random.uniform(-0.038, 0.038)
        found = simulated(path, np.linspace(0, 0.1, 3), outputs, tolerance=tolerance, stiffness=1e13, offset=missed)[-1]
        turned = 2 * np.arccos(missed / 0.04)
        # the law is not rigid: the outlines penetrate by 0.1 mm, a four-hundredth of the distance of the centres
        assert found / 40 == pytest.approx([np.cos(turned), np.sin(turned)], abs=1e-2)


@pytest.mark.slow
def test_rotor_whose_peg_touches_a_stop_once_a_turn(tmp_path):
    """A step of the solver spans a turn or more, at both ends of which the peg is farthest from the stop."""
    rotor = mbd.Body("rotor", mass=1.0, inertia=0.01)
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), rotor.at(0, 0))
    law = mbd.HuntCrossley(1e4, exponent=1, damping=2.0)
    stop = mbd.Contact("stop", mbd.Point(rotor.at(0.1, 0)), mbd.HalfPlane(mbd.ground.at(0, -0.099)), law)
    machine = mbd.Mechanism([rotor], joints=[pin], forces=[stop])
    start, times = [pin.angle == np.pi / 2, rotor.omega == 100], np.linspace(0, 0.6, 4)
    path = mbd.export_fmu(machine, tmp_path / "unit.fmu", outputs={"omega": rotor.omega}, initial=start)
    found = simulated(path, times, ["omega"])[:, 0]

    def rate(t, y):
        depth, speed = -0.099 - 0.1 * np.sin(y[0]), -0.1 * np.cos(y[0]) * y[1]
        force = max(1e4 * depth * (1 + 2.0 * speed), 0.0) if depth > 0 else 0.0
        return [y[1], 0.1 * np.cos(y[0]) * force / 0.01]

    exact = solve_ivp(rate, (0, 0.6), [np.pi / 2, 100], t_eval=times, rtol=1e-9, atol=1e-10, max_step=2e-4).y[1]
    assert exact[-1] < 99.9
    assert found == pytest.approx(exact, abs=1e-4)
    motion = mbd.simulate(machine, times, initial=start, method="dop853")
    assert motion[rotor.omega] == pytest.approx(exact, abs=1e-4)


def test_tunable_parameters(unit, linkage):
    """A parameter that is changed during the run counts from then on."""
    times = np.linspace(0, 1, 51)
    run = unit()
    run.start(tolerance=1e-10)
    first = run.run(times[:26], *linkage.outputs)
    run.set(damping=0.1)
    second = run.run(times[25:], *linkage.outputs)
    given = dict(method="dop853", reltol=1e-10, abstol=1e-10)
    half = mbd.simulate(linkage.mechanism, times[:26], initial=linkage.initial, **given)
    rest = mbd.simulate(linkage.mechanism, times[25:], initial=half.final, parameters={linkage.damping: 0.1}, **given)
    assert np.all(off(first, columns(half, linkage.outputs)) < 1e-8)
    assert np.all(off(second[1:], columns(rest, linkage.outputs)[1:]) < 1e-8)


def test_geometry_that_is_tuned_closes_again(unit):
    """A length that is changed during the run: the loop is closed with it, in both kinds."""
    run = unit()
    run.start()
    run.step(0.1)
    run.set(ground=0.31)
    x, y, phi = run.get("rocker.x", "rocker.y", "rocker.phi")
    assert np.hypot(x - 0.12 * np.cos(phi) - 0.31, y - 0.12 * np.sin(phi)) < 1e-10
    run.step(0.1)
    exchange = unit(2, "ModelExchange")
    exchange.start()
    exchange.set(ground=0.31)
    changed = exchange.fmu.newDiscreteStates()
    assert changed[3], "values of continuous states changed"


@pytest.mark.parametrize("version", [2, 3])
def test_reset_and_rollback(unit, linkage, version):
    """A run that is restarted, and one that goes back to a saved state, are the same to the last bit."""
    run, names, times = unit(version), list(linkage.outputs), np.linspace(0, 0.3, 31)
    run.start()
    first = run.run(times, *names)
    run.fmu.reset()
    run.start()
    assert np.array_equal(run.run(times[:16], *names), first[:16])
    fmu = run.fmu
    get, put, free = (
        (fmu.getFMUstate, fmu.setFMUstate, fmu.freeFMUstate)
        if version == 2
        else (fmu.getFMUState, fmu.setFMUState, fmu.freeFMUState)
    )
    state = get()
    assert np.array_equal(run.run(times[15:], *names), first[15:])
    run.set(torque=-0.5)
    run.step(0.01)
    put(state)
    assert np.array_equal(run.run(times[15:], *names), first[15:])
    # to another instance, as bytes
    put(state)
    serial = (fmu.serializeFMUstate if version == 2 else fmu.serializeFMUState)(state)
    other = unit(version)
    other.start()
    theirs = (other.fmu.deSerializeFMUstate if version == 2 else other.fmu.deserializeFMUState)(serial)
    (other.fmu.setFMUstate if version == 2 else other.fmu.setFMUState)(theirs)
    assert np.array_equal(other.run(times[15:], *names), first[15:])
    free(state)
    with pytest.raises(FMICallException):
        (other.fmu.deSerializeFMUstate if version == 2 else other.fmu.deserializeFMUState)(b"\0" * len(serial))
    assert "belongs to another model" in other.said[-1]


def test_inputs_as_straight_lines(unit, linkage):
    """Slopes of inputs are followed within a communication step."""
    times = np.linspace(0, 1, 11)
    samples = 0.3 * np.sin(3 * times)
    run = unit()
    run.start(tolerance=1e-10)
    run.set(torque=samples[0])
    reference, rows = run.references["torque"], [run.get(*linkage.outputs)]
    for k in range(10):
        run.set(torque=samples[k])
        slope = (samples[k + 1] - samples[k]) / 0.1
        run.fmu.setRealInputDerivatives([reference], [1], [slope])
        run.time = times[k]
        run.step(times[k + 1] - times[k])
        rows.append(run.get("angle", "speed", "pin force", "energy"))
    motion = mbd.simulate(
        linkage.mechanism, times, initial=linkage.initial, inputs={linkage.torque: samples}, method="dop853",
        reltol=1e-10, abstol=1e-10,
    )  # fmt: skip
    assert np.all(off(np.array(rows)[1:], columns(motion, linkage.outputs)[1:]) < 1e-7)


def test_one_step_ahead_is_forgotten_when_an_input_changes(unit, linkage):
    """Small communication steps with an input that changes in the middle agree with exact restarts."""
    times = np.linspace(0, 0.2, 201)
    run = unit()
    run.start(tolerance=1e-10)
    run.run(times[:101], "angle")
    run.set(torque=0.8)
    found = run.run(times[100:], *linkage.outputs)[-1]
    given = dict(method="dop853", reltol=1e-11, abstol=1e-11)
    half = mbd.simulate(linkage.mechanism, [0, 0.1], initial=linkage.initial, **given)
    rest = mbd.simulate(linkage.mechanism, [0.1, 0.2], initial=half.final, inputs={linkage.torque: 0.8}, **given)
    assert np.all(off(found[None], columns(rest, linkage.outputs)[-1:]) < 1e-8)


# --- derivatives, structure --------------------------------------------------------------------------
def check_tangent(unit):
    """Directional derivatives against central differences of the unit's own values, in FMI 2.0 model exchange."""
    fmu = unit.fmu
    of = {v.name: v for v in unit.description.modelVariables}
    states = [v.name for v in unit.description.modelVariables if f"der({v.name})" in of]
    unknown = [f"der({name})" for name in states] + [n for n, v in of.items() if v.causality == "output"]
    known = [*states, *(name for name, v in of.items() if v.causality == "input")]
    generator = np.random.default_rng(3)
    x = unit.get(*known)
    seed = generator.uniform(-1, 1, len(known)) * np.maximum(np.abs(x), 0.1)
    references = [[unit.references[name] for name in names] for names in (unknown, known)]
    exact = np.array(fmu.getDirectionalDerivative(*references, list(seed)))

    def at(values):
        fmu.setReal(references[1], list(values))
        return unit.get(*unknown)

    h = 1e-5
    differences = (8 * (at(x + h * seed) - at(x - h * seed)) - at(x + 2 * h * seed) + at(x - 2 * h * seed)) / (12 * h)
    at(x)
    assert np.max(np.abs(exact - differences) / (1 + np.abs(exact))) < 1e-6
    return dict(zip(unknown, exact, strict=True))


def test_directional_derivatives(unit, linkage):
    """Exact derivatives of rates and outputs, also by parameters, also in co-simulation of FMI 3.0."""
    exchange = unit(2, "ModelExchange")
    exchange.start()
    check_tangent(exchange)
    names = ["speed", "pin force"]
    run = unit(3)
    run.start()
    outputs = [run.references["pin force"]]
    exact = run.fmu.getDirectionalDerivative(outputs, [run.references["torque"], run.references["damping"]], [1.0, 0.5])
    pair = []
    for sign in (1, -1):
        run.set(torque=0.1 + sign * 1e-4, damping=0.02 + sign * 0.5e-4)
        pair.append(run.get(*names)[1])
    assert exact[0] == pytest.approx((pair[0] - pair[1]) / 2e-4, rel=1e-6)
    with pytest.raises(FMICallException):
        run.fmu.getDirectionalDerivative(outputs, [0], [1.0])
    assert "derivatives by time are not available" in run.said[-1]


def test_drift_is_held_in_model_exchange(unit):
    """A state off the constraints goes back to them at the given rate."""
    run = unit(2, "ModelExchange")
    run.start()
    run.fmu.enterContinuousTimeMode()
    n = len(run.description.derivatives)
    x = (ctypes.c_double * n)()
    run.fmu.getContinuousStates(x, n)
    rates = []
    for shift in (0.0, 1e-5):
        moved = (ctypes.c_double * n)(*x)
        moved[6] += shift  # the rocker, in x
        run.fmu.setContinuousStates(moved, n)
        found = (ctypes.c_double * n)()
        run.fmu.getDerivatives(found, n)
        rates.append(np.array(found))
    pulled = (rates[1] - rates[0])[:9] / 1e-5
    # closing rate of the gap in O4: x - 0.12 cos(phi) = 0.3
    phi = x[8]
    assert pulled[6] + 0.12 * np.sin(phi) * pulled[8] == pytest.approx(-10, rel=1e-3)


def test_description(paths, linkage):
    """Names, start values, limits, units and dependencies; the same whenever the model is the same."""
    for version, path in paths.items():
        description = fmpy.read_model_description(str(path))
        variables = {v.name: v for v in description.modelVariables}
        assert description.modelName == "four-bar" and description.defaultExperiment.stopTime == "2"
        assert variables["torque"].start == "0.1" and variables["torque"].min == "-1.0"
        assert variables["damping"].variability == "tunable" and variables["damping"].min == "0.0"
        assert variables["pin force"].unit == "N" and variables["crank.phi"].unit == "rad"
        assert variables["speed"].unit == "rad/s", "an output that is a state has its unit"
        assert variables["der(crank.phi)"].unit == "rad/s" and variables["der(crank.omega)"].unit == "rad/s2"
        needs = {u.variable.name: {d.name for d in u.dependencies} for u in description.outputs}
        assert needs["speed"] == {"crank.omega"}
        assert {"torque", "crank.phi", "rocker.omega"} <= needs["pin force"] and "torque" not in needs["energy"]
        rates = {u.variable.name: {d.name for d in u.dependencies} for u in description.derivatives}
        assert "torque" in rates["der(crank.omega)"] and "torque" not in rates["der(crank.phi)"]
        platform = description.coSimulation.modelIdentifier
        assert platform == description.modelExchange.modelIdentifier == "four_bar"
        with zipfile.ZipFile(path) as archive:
            names = archive.namelist()
            assert any(name.startswith("binaries/") for name in names)
            assert all(name.isascii() and " " not in name for name in names)
            assert ("sources/buildDescription.xml" in names) == (version == 3)


@pytest.mark.slow
def test_archives_are_reproducible(paths, linkage, tmp_path):
    """The same model gives the same bytes, without any path of the machine."""
    again = mbd.export_fmu(
        linkage.mechanism,
        tmp_path / "again.fmu",
        outputs=linkage.outputs,
        initial=linkage.initial,
        kind=("model-exchange", "co-simulation"),
        units={"torque": "N.m", "pin force": "N"},
        stop=2.0,
    )
    assert again.read_bytes() == paths[3].read_bytes()
    with zipfile.ZipFile(again) as archive:
        for name in archive.namelist():
            content = archive.read(name)
            for place in (
                str(tmp_path),
                str(paths[3].parent),
                str(Path.home()),
                "/tmp/",
                str(Path(mbd.__file__).parent),
            ):
                assert place.encode() not in content, name


@pytest.mark.slow
def test_sources_alone_are_enough(linkage, tmp_path):
    """FMPy compiles a unit of sources alone, and it runs."""
    from fmpy.build import build_platform_binary

    path = mbd.export_fmu(
        linkage.mechanism, tmp_path / "unit.fmu", outputs=linkage.outputs, initial=linkage.initial, binary=False
    )
    assert not any(name.startswith("binaries") for name in zipfile.ZipFile(path).namelist())
    folder = tmp_path / "unpacked"
    fmpy.extract(str(path), str(folder))
    build_platform_binary(folder)
    found = simulated(folder, np.linspace(0, 0.1, 11), linkage.outputs)
    motion = mbd.simulate(linkage.mechanism, np.linspace(0, 0.1, 11), initial=linkage.initial, **TIGHT)
    assert np.all(off(found, columns(motion, linkage.outputs)) < 1e-7)


@pytest.mark.slow
def test_command_line(tmp_path, capsys):
    """A model file becomes a unit with its motion and loads as outputs; what is wrong is one sentence."""
    models = Path(__file__).resolve().parents[2] / "examples" / "models"
    files = [str(models / "slider_crank.adm"), str(models / "slider_crank.acf")]
    path = tmp_path / "unit.fmu"
    assert main(["export-fmu", *files, str(path), "--version", "2"]) == 0
    assert validate_fmu(str(path)) == []
    analysis = mbd.read_acf(files[1])
    times = analysis.times[:41]
    motion = mbd.simulate(mbd.read_adm(files[0]), times, **TIGHT)
    body = motion.mechanism.body("slider")
    reaction = motion.mechanism.joint("crank pin").reaction_on(motion.mechanism.body("rod")).force[0]
    known = np.column_stack([motion[body.x], motion[body.ax], motion[reaction]])
    assert np.all(off(simulated(path, times, ["slider.x", "slider.ax", "crank pin.fx"]), known) < 1e-6)
    variables = {v.name: v.unit for v in fmpy.read_model_description(str(path)).modelVariables}
    assert variables["crank pin.fx"] == "N" and variables["slider.x"] == "m" and variables["slider.ax"] == "m/s2"
    capsys.readouterr()
    for arguments, words in (
        ([*files, str(tmp_path / "no" / "x.fmu")], "does not exist"),
        ([*files, files[0]], "this is the same file as the input"),
        ([*files, str(tmp_path / "x.fmu"), "--version", "1"], "got 1"),
        ([*files, str(tmp_path / "x.zip")], "ends in .fmu"),
    ):
        assert main(["export-fmu", *arguments]) == 2
        said = capsys.readouterr().err
        assert words in said and said.count("\n") == 1 and said.startswith("mbdcasadi: ")
    assert [p.name for p in tmp_path.iterdir()] == ["unit.fmu"]


# --- wrong calls of the importer -----------------------------------------------------------------------
@pytest.mark.slow
def test_wrong_calls_are_refused_in_words(unit):
    """A wrong call of an importer is an error with a message, and nothing breaks."""
    early = unit()
    with pytest.raises(FMICallException):
        early.step(0.1) if setattr(early, "time", 0.0) is None else None
    assert "between initialization and termination" in early.said[-1]
    run = unit()
    run.start()
    for call, words in (
        (lambda: run.set(angle=1.0), "angle is calculated and cannot be set"),
        (lambda: run.set(torque=np.nan), "the value of torque must be finite"),
        (lambda: run.fmu.getReal([999]), "no variable with the value reference 999"),
        (lambda: run.fmu.getInteger([1]), "of type Real"),
        (lambda: run.fmu.getRealOutputDerivatives([3], [1]), "derivatives of outputs in time"),
        (lambda: run.fmu.doStep(0.5, 0.1), "begin at t = 0.5 s, and the unit is at t = 0 s"),
    ):
        with pytest.raises(FMICallException):
            call()
        assert words in run.said[-1]
    run.step(0.01)
    exchange = unit(2, "ModelExchange")
    exchange.start()
    exchange.fmu.enterContinuousTimeMode()
    with pytest.raises(FMICallException):
        exchange.set(damping=0.5)
    assert "damping can be changed only at events" in exchange.said[-1]


@pytest.mark.slow
def test_what_leaves_its_range(tmp_path):
    """Data stop the step at the end of their range, with the name; limits of parameters and elements are reported."""
    mass = mbd.Parameter("mass", 1.0)
    cart = mbd.Body("cart", mass=mass, inertia=1)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0))
    curve = mbd.spline(cart.x, [-1, 0, 0.5, 1], [1, 1, 1.2, 1.1])
    machine = mbd.Mechanism(
        bodies=[cart],
        joints=[rail],
        forces=[mbd.Force("wind", cart.at(0, 0), mbd.vertcat(curve, 0))],
        parameters=[mass],
    )
    path = mbd.export_fmu(machine, tmp_path / "unit.fmu", outputs={"x": cart.x}, version=2)
    run = Unit(path, tmp_path).start()
    run.step(1.0)
    with pytest.raises(FMICallException) as caught:
        run.step(5.0)
    assert caught.value.status == 2, "discarded"
    assert "the force of force 'wind' is not finite" in run.said[-1] or "the solver stopped at" in run.said[-1]
    value = ctypes.c_double()
    run.fmu.fmi2GetRealStatus(run.fmu.component, 2, ctypes.byref(value))
    assert 1.2 < value.value < 1.5 and run.get("x") == pytest.approx(1.0, abs=1e-3)
    light = Unit(path, tmp_path)
    with pytest.raises(FMICallException):
        light.start(mass=-1.0)
    assert "body 'cart': mass must be" in light.said[-1]


# --- wrong calls of export_fmu --------------------------------------------------------------------------
def refused(words, *arguments, **more):
    with pytest.raises(mbd.MechanismError) as caught:
        mbd.export_fmu(*arguments, **more)
    assert words in str(caught.value), caught.value
    assert "\n" not in str(caught.value)


def test_wrong_arguments(linkage, tmp_path):
    """One sentence each, and no file."""
    m, path = linkage.mechanism, tmp_path / "x.fmu"
    stray = mbd.Body("stray", mass=1, inertia=1)
    for words, more in (
        ("'stranger', which is not in the mechanism", dict(inputs=[mbd.Input("stranger")])),
        ("'odd', which is not in the mechanism", dict(parameters=[mbd.Parameter("odd", 1.0)])),
        ("takes Input objects", dict(inputs=[linkage.damping])),
        ("takes a list", dict(inputs=linkage.torque)),
        ("contains 'torque' twice", dict(inputs=[linkage.torque, linkage.torque])),
        ("connect the controller to it outside", dict(inputs=[mbd.SampledController(lambda t, s: {}, 0.1)])),
        (
            "connect the controller to it outside",
            dict(inputs={linkage.torque: mbd.SampledController(lambda t, s: {}, 0.1)}),
        ),
        ("stray.x", dict(outputs={"x": stray.x})),
        ("must be a scalar", dict(outputs={"x": m.bodies[0].position})),
        ("is not an expression", dict(outputs={"x": "crank"})),
        ("takes {name: expression}", dict(outputs=[m.bodies[0].x])),
        ("the name 'torque' is used twice", dict(outputs={"torque": m.bodies[0].x})),
        ("is not a valid name of a variable", dict(outputs={"a\nb": m.bodies[0].x})),
        ("names 'weight', which is no", dict(units={"weight": "N"})),
        ("is not a valid name of a variable", dict(outputs={"a\ud800": m.bodies[0].x})),
        ("units= takes a dict", dict(units=["N"])),
        ("units= takes a dict", dict(units={"torque": 5})),
        ("FMI 2.0 and 3.0), got 4", dict(version=4)),
        ("FMI 2.0 and 3.0), got 2.0", dict(version=2.0)),
        ("binary= is True, False or None, got 'no'", dict(binary="no")),
        ("t must be", dict(t="0", stop=1.0)),
        ("or both, got 'realtime'", dict(kind="realtime")),
        ("reltol must be positive", dict(reltol=0.0)),
        ("step must be positive", dict(step=0.0)),
        ("later than the start at t = 0 s, got -1", dict(stop=-1.0)),
        ("not finite at t = 0 s", dict(outputs={"x": mbd.sqrt(m.bodies[0].x - 5)})),
        ("cannot assemble", dict(initial=[linkage.o2.angle == 0.5, m.bodies[2].phi == 0])),
    ):
        refused(words, m, path, **more)
    refused("takes a Mechanism", "engine", path)
    refused("nowhere does not exist", m, tmp_path / "nowhere" / "x.fmu")
    refused("ends in .fmu", m, tmp_path / "x.zip")
    refused("this is a folder", m, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_friction_by_reactions_that_are_not_unique_is_refused(tmp_path):
    """Two guides in line: how they share the load is open, and so is the friction."""
    block = mbd.Body("block", mass=1, inertia=1)
    rails = [mbd.Translational(f"rail {k}", mbd.ground.at(k, 0), block.at(k, 0)) for k in range(2)]
    friction = mbd.JointFriction("brake", rails[0], mbd.Coulomb(0.3, 0.01))
    machine = mbd.Mechanism(bodies=[block], joints=rails, forces=[mbd.Gravity(), friction])
    for refuse in (
        lambda: mbd.export_fmu(machine, tmp_path / "block.fmu"),
        lambda: mbd.equations(machine).generate_c(tmp_path / "block.c"),
        lambda: mbd.simulate(machine, [0, 1]),
    ):
        with pytest.raises(mbd.MechanismError, match=r"'brake' depends on reactions, and .* not unique"):
            refuse()
    assert list(tmp_path.iterdir()) == []


def test_exact_friction_is_refused_by_name(tmp_path):
    """Exact stick and slip has no form in a unit."""
    block = mbd.Body("block", mass=1, inertia=1)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), block.at(0, 0))
    friction = mbd.JointFriction("brake", rail, mbd.DryFriction(0.3))
    machine = mbd.Mechanism(bodies=[block], joints=[rail], forces=[mbd.Gravity(), friction])
    refused("'brake' switches exactly between sticking and sliding", machine, tmp_path / "x.fmu")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_nothing_is_half_written(linkage, tmp_path, monkeypatch):
    """A full disk leaves the file that was there before; a compiler that fails, or is missing, is reported."""
    m, path = linkage.mechanism, tmp_path / "x.fmu"
    path.write_bytes(b"old")
    with full_disk(2000):
        refused("the file cannot be written", m, path, binary=False)
    assert path.read_bytes() == b"old" and [p.name for p in tmp_path.iterdir()] == ["x.fmu"]
    monkeypatch.setenv("CC", "false")
    refused("the compiler false failed", m, path)
    assert path.read_bytes() == b"old"
    scratch = tmp_path / "scratch"
    scratch.mkdir()
    monkeypatch.setenv("CC", "cc")
    monkeypatch.setattr(tempfile, "tempdir", str(scratch))
    with full_disk(2000):
        refused("the files for the compiler cc cannot be written: File too large", m, path)
    assert path.read_bytes() == b"old" and list(scratch.iterdir()) == []
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "gone"))
    refused("the files for the compiler cc cannot be written: No such file", m, path)
    monkeypatch.undo()
    refused("the file cannot be written: File name too long", m, tmp_path / f"{'x' * 300}.fmu")
    long = mbd.export_fmu(m, tmp_path / f"{'ä' * 120}.fmu", binary=False)
    assert long.exists() and sorted(p.name for p in tmp_path.iterdir()) == sorted([long.name, "scratch", "x.fmu"])
    monkeypatch.setenv("CC", "'no such")
    refused('$CC names "\'no such", which is not on the path', m, path, binary=True)
    monkeypatch.setenv("CC", "no-such-compiler")
    refused("$CC names 'no-such-compiler', which is not on the path", m, path, binary=True)
    with pytest.warns(mbd.MechanismWarning, match="holds sources and no binary"):
        mbd.export_fmu(m, path)
    with zipfile.ZipFile(path) as archive:
        assert not any(name.startswith("binaries/") for name in archive.namelist())
        root = ElementTree.fromstring(archive.read("modelDescription.xml"))
        assert root.get("fmiVersion") == "3.0"


def test_units_watch_ranges_of_what_varies(tmp_path):
    """A coefficient that varies in time is among the messages of a unit."""
    block = mbd.Body("block", mass=1.0, inertia=1.0)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), block.at(0, 0))
    oil = mbd.JointFriction("oil", rail, mbd.Viscous(1 - mbd.t))
    model = mbd.Mechanism([block], [rail], forces=[oil])
    path = mbd.export_fmu(model, tmp_path / "unit.fmu", outputs={"x": block.x}, binary=False)
    with zipfile.ZipFile(path) as archive:
        code = b"".join(archive.read(name) for name in archive.namelist() if name.startswith("sources/"))
    assert b"Viscous: coefficient must be at least 0" in code
