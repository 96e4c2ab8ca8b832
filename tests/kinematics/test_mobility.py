"""Degrees of freedom, redundant rows and singular poses, whatever the units, the masses and the rounding."""

import warnings

import numpy as np
import pytest
from seeds import seeds

import mbdcasadi as mbd

SIZES = [1e-6, 1e-3, 1.0, 1e3, 1e6]
LENGTHS = np.array([1.0, 1.2, 1.4])


def plate_on_bars(angles, size=1.0, skew=0.0, lengths=LENGTHS, at=(0.0, 0.0), mass=(1.0, 0.1), torque=0.0):
    """A plate on bars that point at its centre; with a skew they pass it on one side."""
    at = size * np.asarray(at)
    plate = mbd.Body("plate", mass=mass[0], inertia=mass[1] * size**2, pose=(*at, 0))
    bars = []
    for k, (angle, length) in enumerate(zip(angles, lengths, strict=True)):
        tip = 0.3 * size * np.array([np.cos(angle), np.sin(angle)])
        foot = length * size * np.array([np.cos(angle + skew), np.sin(angle + skew)])
        reach = float(np.hypot(*(foot - tip)))
        bars.append(mbd.Distance(f"bar {k}", plate.at(*tip), mbd.ground.at(*(foot + at)), reach))
    forces = [mbd.Gravity(), mbd.Torque("twist", plate, torque)]
    return mbd.Mechanism(bodies=[plate], joints=bars, forces=forces), plate, bars


def parallelogram(angle, cranks=3, size=1.0, masses=None):
    """Cranks of half a length side by side, joined by a rod; flat at the angles 0 and π."""
    masses = np.ones(cranks + 1) if masses is None else masses
    reach = np.array([np.cos(angle), np.sin(angle)]) * 0.5 * size
    feet = size * np.arange(cranks)
    middle = size * (cranks - 1) / 2
    bodies = [
        mbd.Body(f"crank {k}", mass=m, inertia=m * size**2 / 50, pose=(x + reach[0] / 2, reach[1] / 2, angle))
        for k, (x, m) in enumerate(zip(feet, masses[1:], strict=True))
    ]
    rod = mbd.Body("rod", mass=masses[0], inertia=masses[0] * size**2, pose=(reach[0] + middle, reach[1], 0))
    joints = []
    for k, (x, crank) in enumerate(zip(feet, bodies, strict=True)):
        joints.append(mbd.Revolute(f"foot {k}", mbd.ground.at(x, 0), crank.at(-size / 4, 0)))
        joints.append(mbd.Revolute(f"pin {k}", crank.at(size / 4, 0), rod.at(x - middle, 0)))
    return mbd.Mechanism(bodies=[*bodies, rod], joints=joints)


def slider_crank(angle, size, masses):
    r, l = 0.15 * size, 0.45 * size  # noqa: E741
    lean = np.arcsin(-r * np.sin(angle) / l)
    tip = r * np.array([np.cos(angle), np.sin(angle)])
    end = tip[0] + l * np.cos(lean)
    shapes = [(tip / 2, angle), ((tip + np.array([end, 0])) / 2, lean), ((end, 0), 0)]
    crank, rod, slider = (
        mbd.Body(name, mass=m, inertia=m * size**2 / 100, pose=(*place, turn))
        for name, m, (place, turn) in zip(("crank", "rod", "slider"), masses, shapes, strict=True)
    )
    joints = [
        mbd.Revolute("main", mbd.ground.at(0, 0), crank.at(-r / 2, 0)),
        mbd.Revolute("pin", crank.at(r / 2, 0), rod.at(-l / 2, 0)),
        mbd.Revolute("wrist", rod.at(l / 2, 0), slider.at(0, 0)),
        mbd.Translational("guide", mbd.ground.at(0, 0), slider.at(0, 0)),
    ]
    return mbd.Mechanism(bodies=[crank, rod, slider], joints=joints)


def numbers(report):
    return report.degrees_of_freedom, report.redundant_rows, report.singular


def random_masses(generator, count):
    return 10.0 ** generator.uniform(-9, 6, count)


@pytest.mark.parametrize("seed", seeds(40))
def test_concurrent_bars_are_shaky_and_askew_they_hold(seed):
    generator = np.random.default_rng(seed)
    angles = np.sort(generator.uniform(0, 2 * np.pi, 3))
    while np.min(np.abs(np.sin(angles - np.roll(angles, 1)))) < 0.2:
        angles = np.sort(generator.uniform(0, 2 * np.pi, 3))
    size = float(generator.choice(SIZES))
    given = {"size": size, "lengths": generator.uniform(0.8, 2, 3), "at": generator.uniform(-3, 3, 2)}
    given["mass"] = random_masses(generator, 2)
    report = mbd.check(plate_on_bars(angles, **given)[0])
    assert numbers(report) == (0, 0, "shaky")
    assert set(report.singular_rows) == {"bar 0", "bar 1", "bar 2"}
    assert numbers(mbd.check(plate_on_bars(angles, skew=0.1, **given)[0])) == (0, 0, "")


def test_a_shaky_plate_on_a_carriage_that_moves():
    carriage = mbd.Body("carriage", mass=1, inertia=1)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), carriage.at(0, 0))
    _, plate, bars = plate_on_bars((0.2, 2.3, 4.4))
    on_it = [mbd.Distance(bar.name, bar.a, carriage.at(*(float(x) for x in (bar.b.x, bar.b.y))), 1.0) for bar in bars]
    on_it = [
        mbd.Distance(bar.name, bar.a, bar.b, float(length) - 0.3) for bar, length in zip(on_it, LENGTHS, strict=True)
    ]
    report = mbd.check(mbd.Mechanism(bodies=[carriage, plate], joints=[rail, *on_it]))
    assert numbers(report) == (1, 0, "shaky")


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("angle, singular", [(0.0, "bifurcation"), (np.pi, "bifurcation"), (0.7, ""), (2.0, "")])
@pytest.mark.parametrize("cranks", [2, 3, 4])
def test_parallelograms(size, angle, singular, cranks):
    masses = random_masses(np.random.default_rng(cranks), cranks + 1)
    report = mbd.check(parallelogram(angle, cranks, size, masses))
    assert numbers(report) == (1, cranks - 2, singular)
    assert len(report.redundant) == cranks - 2


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("seed", range(4))
def test_slider_cranks(size, seed):
    generator = np.random.default_rng(seed)
    angle = generator.uniform(0.2, 2.9)
    assert numbers(mbd.check(slider_crank(angle, size, random_masses(generator, 3)))) == (1, 0, "")


@pytest.mark.parametrize("offset", [0.0, 6e-18, -1e-16])
@pytest.mark.parametrize("at", [(0, 0), (3, -40)])
def test_wheel_pinned_twice_at_its_centre(offset, at):
    wheel = mbd.Body("wheel", mass=1, inertia=0.1, pose=(*at, 0.3))
    pins = [mbd.Revolute(name, mbd.ground.at(*at), wheel.at(x, 0)) for name, x in (("a", 0.0), ("b", offset))]
    report = mbd.check(mbd.Mechanism(bodies=[wheel], joints=pins))
    assert numbers(report) == (1, 2, "")
    assert report.redundant == ("b.x", "b.y")


def test_characteristic_length_follows_the_size_and_not_the_pose():
    from mbdcasadi.equations.numeric import NumericEquations

    found = []
    for size in SIZES:
        for angle in (0.0, 0.7):
            eom = mbd.equations(slider_crank(angle, size, np.ones(3)))
            found.append(NumericEquations(eom, np.zeros(0)).scale.length / size)
    assert np.ptp(found) < 0.3 * np.min(found) and 0.1 < np.min(found) < 1


# --- equilibrium -------------------------------------------------------------------------------
def balance(plate, bars, state, torque):
    """Force and moment (about the centre, over a length) left over on the plate."""
    forces = np.array([state[bar.reaction_on(plate).force] for bar in bars]).reshape(-1, 2)
    arms = np.array([state[bar.a.position] - state[plate.position] for bar in bars]).reshape(-1, 2)
    moment = np.sum(arms[:, 0] * forces[:, 1] - arms[:, 1] * forces[:, 0]) + torque
    return float(np.max(np.abs([*(forces.sum(axis=0) + np.array([0, -9.81])), moment])))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_no_reactions_for_a_load_that_a_shaky_pose_cannot_hold(seed):
    angles = np.array([0.2, 2.3, 4.4]) + np.random.default_rng(seed).uniform(-0.4, 0.4, 3)
    with pytest.raises(mbd.EquilibriumError, match=r"singular.*shaky.*bar"):
        mbd.equilibrium(plate_on_bars(angles, torque=0.01)[0])
    model, plate, bars = plate_on_bars(angles)
    with pytest.warns(mbd.MechanismWarning, match=r"singular.*bar"):
        state = mbd.equilibrium(model)
    assert balance(plate, bars, state, 0.0) < 1e-9
    model, plate, bars = plate_on_bars(angles, torque=1.0, skew=0.1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        state = mbd.equilibrium(model)
    assert balance(plate, bars, state, 1.0) < 1e-9


def held_at_dead_centre(torque, angle):
    """A slider-crank whose slider is held where the crank is at an angle."""
    r, l = 0.1, 0.3  # noqa: E741
    x = r * np.cos(angle) + np.sqrt(l**2 - (r * np.sin(angle)) ** 2)
    lean = -np.arcsin(r * np.sin(angle) / l)
    crank = mbd.Body("crank", mass=1, inertia=1, pose=(0.05 * np.cos(angle), 0.05 * np.sin(angle), angle))
    rod = mbd.Body("rod", mass=1, inertia=1, pose=(x - 0.15 * np.cos(lean), -0.15 * np.sin(lean), lean))
    slider = mbd.Body("slider", mass=1, inertia=1, pose=(x, 0, 0))
    joints = [
        mbd.Revolute("main", mbd.ground.at(0, 0), crank.at(-0.05, 0)),
        mbd.Revolute("pin", crank.at(0.05, 0), rod.at(-0.15, 0)),
        mbd.Revolute("wrist", rod.at(0.15, 0), slider.at(0, 0)),
        mbd.Translational("guide", mbd.ground.at(0, 0), slider.at(0, 0)),
    ]
    hold = mbd.Driver("hold", slider.x, float(x))
    forces = [mbd.Torque("torque", crank, torque)]
    return mbd.Mechanism(bodies=[crank, rod, slider], joints=joints, drivers=[hold], forces=forces), hold


def test_a_small_torque_at_a_dead_centre_is_refused():
    for start in (0.0, 1e-7):
        with pytest.raises(mbd.EquilibriumError, match=r"singular.*rows.*hold"):
            mbd.equilibrium(held_at_dead_centre(0.01, start)[0])


def test_reactions_near_a_dead_centre_come_with_a_warning_and_are_right():
    for angle, reported in ((2e-5, True), (1e-2, False)):
        model, hold = held_at_dead_centre(0.01, angle)
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            state = mbd.equilibrium(model)
        assert [w.category for w in caught] == [mbd.MechanismWarning] * reported
        # virtual work: torque by the rate of the slider, dx/dangle = -r sin (1 + r cos / l ...)
        lever = 0.1 * np.sin(angle) * (1 + 0.1 * np.cos(angle) / np.sqrt(0.09 - 0.01 * np.sin(angle) ** 2))
        assert abs(state[hold.effort]) == pytest.approx(0.01 / lever, rel=1e-5)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("cranks", [2, 3])
def test_driven_parallelograms_of_any_size(size, cranks):
    """With the masses of rods at their middles: efforts by virtual work, redundant rows or not."""
    model = parallelogram(0.7, cranks, size)
    first = model.bodies[0]
    drive = mbd.Driver("drive", first.phi, 0.7 + 2 * mbd.t)
    model = model.replace(drivers=[drive], forces=[mbd.Gravity()])
    times = np.linspace(0, 1.2, 13)
    motion = mbd.inverse_dynamics(model, times)
    for crank in model.bodies[:-1]:
        np.testing.assert_allclose(motion[crank.phi], 0.7 + 2 * times, atol=1e-12)
        np.testing.assert_allclose(motion[crank.omega], 2.0, atol=1e-9)
    weights = (cranks / 2 + 1) * 9.81 * 0.5 * size
    np.testing.assert_allclose(motion[drive.effort], weights * np.cos(motion[first.phi]), atol=1e-4 * weights)
