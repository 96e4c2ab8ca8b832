"""Validity conditions of elements along a motion: reported with time and size, left out if not known."""

import warnings

import casadi as ca
import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.model.element import Element
from mbdcasadi.model.symbols import values_of
from mbdcasadi.model.validity import ValidityCondition


class Fence(Element):
    """A user's own element that only watches a body."""

    kind = "fence"

    def __init__(self, name, body):
        super().__init__(name)
        self.validity_conditions = (ValidityCondition(1.0 - body.x, f"{self.description}: the body has passed it"),)


def runner(speed=1.0):
    """A body that flies along x, and a fence at 1 m."""
    body = mbd.Body("body", mass=1, inertia=1, velocity=(speed, 0, 0))
    return body, mbd.Mechanism([body], forces=[Fence("fence", body)])


def test_told_with_time_and_worst_value():
    """As a warning and as a note of the statistics."""
    _, mechanism = runner()
    with pytest.warns(
        mbd.MechanismWarning, match=r"fence 'fence': the body has passed it \(first at t = 1\.1 s"
    ) as said:
        run = mbd.simulate(mechanism, np.linspace(0, 2, 21))
    assert "at worst -1)" in str(said[0].message)
    assert said[0].filename == __file__
    assert any("has passed it" in note for note in run.statistics.notes)


def test_nothing_is_told_where_it_holds():
    """Up to the limit itself."""
    _, mechanism = runner()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run = mbd.simulate(mechanism, np.linspace(0, 1, 11))
    assert run.statistics.notes == []


def test_kinematics_leaves_out_what_depends_on_forces():
    """A wheel pulled off its track: kinematics cannot know, inverse dynamics does."""
    disc = mbd.Body("disc", mass=1, inertia=1, pose=(0, 0.5, 0))
    roll = mbd.Rolling("contact", disc.at(0, 0), mbd.ground.at(0, 0), 0.5)
    crane = mbd.Force("crane", disc.at(0, 0), (0, 5.0))
    mechanism = mbd.Mechanism([disc], [roll], [mbd.Driver("d", disc.x, mbd.t)], forces=[crane])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        mbd.kinematics(mechanism, [0, 1])
    with pytest.warns(mbd.MechanismWarning, match=r"normal force is negative.*first at t = 0 s, at worst -5\)"):
        mbd.inverse_dynamics(mechanism, [0, 1])


def test_value_behind_an_expression_of_parameters():
    """Parameters count with their own values; anything else is refused."""
    k = mbd.Parameter("k", 3.0)
    np.testing.assert_allclose(values_of(ca.vertcat(k**2, 1)), [[9], [1]])
    assert values_of(2.5) == 2.5
    with pytest.raises(mbd.ExpressionError, match="a number is needed here, and time 't' has none"):
        values_of(k * mbd.t)


# --- gears ---------------------------------------------------------------------------------------
def planet(reach=0.06, **carrier):
    """A planet on a driven arm about a fixed sun; whether the gear knows the arm is what is asked."""
    arm = mbd.Body("arm", mass=1, inertia=0.02)
    wheel = mbd.Body("planet", mass=0.5, inertia=2e-4, pose=(reach, 0, 0))
    hub = mbd.Revolute("hub", mbd.ground.at(0, 0), arm.at(0, 0))
    pin = mbd.Revolute("pin", arm.at(reach, 0), wheel.at(0, 0))
    known = {"carrier": arm} if carrier.get("known") else {}
    mesh = mbd.Gear("mesh", mbd.ground.at(0, 0), wheel.at(0, 0), 0.04, 0.02, **known)
    return arm, mbd.Mechanism([arm, wheel], [hub, pin, mesh])


def test_check_tells_that_the_carrier_was_forgotten():
    """The arm may turn; with it as carrier, or held by a joint, nothing is said."""
    arm, mechanism = planet()
    (remark,) = mbd.check(mechanism).remarks
    assert "'mesh': the line of centres turns relative to carrier 'ground'; name the body" in remark
    assert remark in str(mbd.check(mechanism))
    assert mbd.check(planet(known=True)[1]).remarks == ()
    held = mechanism.replace(joints=[*mechanism.joints, mbd.AbsoluteAngle("held", arm.at(0, 0), 0.0)])
    assert mbd.check(held).remarks == ()


def test_failures_tell_that_the_carrier_was_forgotten():
    """There the angle of the line of centres jumps by a turn: neither is a lock-up of the linkage."""
    arm, mechanism = planet()
    driven = mechanism.replace(drivers=[mbd.Driver("turn", arm.phi, mbd.t)])
    with pytest.raises(mbd.MechanismError, match="turns relative to carrier 'ground'; name the body"):
        mbd.kinematics(driven, np.linspace(0, 4, 81))
    with pytest.raises(mbd.SimulationError, match="turns relative to carrier 'ground'; name the body"):
        mbd.simulate(mechanism, duration=3, initial=[arm.omega == 3], method="idas")


def test_centres_of_gears_at_a_wrong_distance():
    """By how much, in metres: in check and along a motion."""
    arm, mechanism = planet(reach=0.05, known=True)
    (remark,) = mbd.check(mechanism).remarks
    assert "'mesh': the centres are not at the distance" in remark and "(-0.01 m at t = 0 s)" in remark
    with pytest.warns(mbd.MechanismWarning, match=r"first at t = 0 s, at worst -0\.01 m\)"):
        mbd.kinematics(mechanism.replace(drivers=[mbd.Driver("turn", arm.phi, mbd.t)]), [0, 1])


# --- what is not finite ------------------------------------------------------------------------------
def rail_and_block(x):
    """A block on a level guide."""
    block = mbd.Body("block", mass=1, inertia=1, pose=(x, 0, 0))
    return block, mbd.Translational("rail", mbd.ground.at(0, 0), block.at(0, 0))


def test_gas_spring_inside_its_dead_length_is_named():
    """At the start, before any step."""
    block, rail = rail_and_block(0.1)
    gas = mbd.GasSpring("gas", mbd.ground.at(0, 0), block.at(0, 0), 0.01, 0.4, 2e5, dead_length=0.2)
    with pytest.raises(mbd.SingularityError, match="force of gas spring 'gas' is not finite at t = 0 s"):
        mbd.simulate(mbd.Mechanism([block], [rail], forces=[gas]), duration=0.1)


@pytest.mark.slow
def test_empty_chamber_of_a_hydraulic_cylinder_is_named():
    """0.2 litres and what is drawn from them, 1 l/s, last for 0.2 s and the way of the piston."""
    block, rail = rail_and_block(0.5)
    ram = mbd.HydraulicCylinder("ram", mbd.ground.at(0, 0), block.at(0, 0), 0.05, 0.02, 0.5, 2e-4, -1e-3)
    with pytest.raises(mbd.SimulationError, match="cylinder 'ram': the chamber on the piston's side is empty"):
        mbd.simulate(mbd.Mechanism([block], [rail], forces=[ram]), duration=2.0)


def test_driver_beyond_the_data_of_its_spline_is_named():
    """It is no singular pose."""
    block, rail = rail_and_block(0.0)
    drive = mbd.Driver("drive", block.x, mbd.spline(mbd.t, [0, 1, 2, 3], [0, 1, 0, 1]))
    with pytest.raises(mbd.AssemblyError, match="beyond t = 3 s: drive has no finite value") as said:
        mbd.kinematics(mbd.Mechanism([block], [rail], [drive]), np.linspace(0, 4, 41))
    assert said.value.time == pytest.approx(3) and said.value.partial.t[-1] == pytest.approx(3)


def test_many_findings_are_one_warning():
    """Twelve planets without a carrier: one warning that names three, and twelve notes."""
    arms = [mbd.Body(f"arm {k}", mass=1, inertia=0.02) for k in range(12)]
    wheels = [mbd.Body(f"planet {k}", mass=0.5, inertia=2e-4, pose=(0.06, 0, 0)) for k in range(12)]
    joints = []
    for k, (arm, wheel) in enumerate(zip(arms, wheels, strict=True)):
        joints.append(mbd.Revolute(f"hub {k}", mbd.ground.at(0, 0), arm.at(0, 0)))
        joints.append(mbd.Revolute(f"pin {k}", arm.at(0.06, 0), wheel.at(0, 0)))
        joints.append(mbd.Gear(f"mesh {k}", mbd.ground.at(0, 0), wheel.at(0, 0), 0.04, 0.02))
    model = mbd.Mechanism([*arms, *wheels], joints)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        motion = mbd.simulate(model, np.linspace(0, 0.5, 6), initial=[arm.omega == 4 for arm in arms])
    own = [str(w.message) for w in caught if issubclass(w.category, mbd.MechanismWarning)]
    assert len(own) == 1 and "'mesh 0'" in own[0] and "and 9 more of this kind" in own[0]
    assert sum("line of centres" in note for note in motion.statistics.notes) == 12
