"""What depends on time explicitly is met by every method, whatever came before: rest, equilibrium, uniform motion."""

import casadi as ca
import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline

import mbdcasadi as mbd

METHODS = ["idas", "erk", "rosenbrock", "dop853"]


def sled(force=None, driver=None, **more):
    """A body of 1 kg on a horizontal rail, from rest at the origin."""
    body = mbd.Body("sled", mass=1.0, inertia=0.1)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), body.at(0, 0))
    forces = [] if force is None else [mbd.Force("push", body.at(0, 0), (force, 0))]
    drivers = [] if driver is None else [mbd.Driver("shove", rail.displacement, driver)]
    return body, mbd.Mechanism(bodies=[body], joints=[rail], forces=forces, drivers=drivers, **more)


#: Force over time, and its impulse.
PULSES = {
    "smooth step": (10 * (mbd.step(mbd.t, 5, 0, 5.05, 1) - mbd.step(mbd.t, 5.15, 0, 5.2, 1)), 1.5),
    "comparison": (mbd.if_else((mbd.t - 5) * (5.02 - mbd.t) > 0, 30.0, 0.0), 0.6),
    "spline": (mbd.spline(mbd.t, [0, 5, 5.01, 5.02, 10], [0, 0, 50, 0, 0], kind="linear"), 0.5),
    "Gauss": (20 * mbd.exp(-(((mbd.t - 5) / 0.01) ** 2)), 0.2 * np.sqrt(np.pi)),
    "narrow Gauss": (2e4 * mbd.exp(-(((mbd.t - 3.21) / 1e-5) ** 2)), 0.2 * np.sqrt(np.pi)),
    "Lorentz": (20 / (1 + ((mbd.t - 5) / 0.002) ** 2), 20 * 0.002 * (np.arctan(2500) + np.arctan(2500))),
    "two tanh": (5 * (mbd.tanh((mbd.t - 4) / 1e-3) - mbd.tanh((mbd.t - 4.1) / 1e-3)), 1.0),
    "parabola that is zero at both its stops": (30 * mbd.fmax(0, 1 - ((mbd.t - 5) / 0.01) ** 2), 0.4),
    "power of a parabola": (30 * mbd.positive_power(1 - ((mbd.t - 5) / 0.01) ** 2, 2), 0.3 * 16 / 15),
    "two parabolas of other signs": (
        30 * mbd.positive_power(0.01**2 - (mbd.t - 5) ** 2, 1) * (mbd.t - 4.995) / 1e-6,
        30 * 0.01**3 * 4 / 3 * 0.005 / 1e-6,
    ),
    "and": (mbd.if_else(mbd.logic_and(mbd.t > 5, mbd.t < 5.02), 30.0, 0.0), 0.6),
    "or, not": (mbd.if_else(mbd.logic_not(mbd.logic_or(mbd.t <= 5, mbd.t >= 5.02)), 30.0, 0.0), 0.6),
    "sawtooth": (mbd.floor(mbd.t / 4) * mbd.fmod(mbd.t, 4), 8.0 + 2 * 2.0),
    "nested": (mbd.if_else(mbd.fabs(mbd.t - 7) < 0.005, 100.0, 0.0), 1.0),
}


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", PULSES)
@pytest.mark.parametrize("count", [11, 1001])
def test_a_pulse_after_rest(name, count, method):
    """The impulse of a short force is the momentum at the end, however few outputs there are."""
    force, impulse = PULSES[name]
    body, mechanism = sled(force)
    motion = mbd.simulate(mechanism, np.linspace(0, 10, count), method=method)
    assert motion.final[body.vx] == pytest.approx(impulse, rel=1e-5)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("count", [3, 51, 101, 102])
def test_a_state_takes_up_a_triangle(count, method):
    """Its rate is symmetric about the corner: the error test of a multistep method may see none of a step past it."""
    body, _ = sled()
    charge = mbd.StateVariable("charge")
    rate = mbd.fmax(0, 1 - mbd.fabs(mbd.t - 3.11) / 0.00513) / 0.00513
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), body.at(0, 0))
    mechanism = mbd.Mechanism(bodies=[body], joints=[rail], states={charge: rate})
    times = np.linspace(0, 6.27, count)
    motion = mbd.simulate(mechanism, times, initial=[body.x == 0, body.vx == 0.1], method=method)
    assert motion.final[charge] == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_a_pulse_in_a_long_run(method):
    """A tenth of a second in a thousand."""
    body, mechanism = sled(mbd.if_else(mbd.fabs(mbd.t - 700) < 0.05, 10.0, 0.0))
    assert mbd.simulate(mechanism, [0, 1000], method=method).final[body.vx] == pytest.approx(1.0, rel=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_a_pulse_after_uniform_motion(method):
    """A body that flies on is pushed on its way."""
    body, mechanism = sled(PULSES["comparison"][0])
    motion = mbd.simulate(mechanism, np.linspace(0, 10, 11), initial=[body.vx == 2.0], method=method)
    assert motion.final[body.vx] == pytest.approx(2.6, rel=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_jumps_cost_no_accuracy(method):
    """Bang, rest, bang: piecewise parabolas to rounding of the tolerance."""
    course = mbd.if_else(mbd.t < 1, 3.0, mbd.if_else(mbd.t < 2.5, 0.0, -3.0))
    body, mechanism = sled(course)
    times = np.linspace(0, 4, 9)
    motion = mbd.simulate(mechanism, times, method=method)
    speed = np.where(times < 1, 3 * times, np.where(times < 2.5, 3.0, 3 - 3 * (times - 2.5)))
    np.testing.assert_allclose(motion[body.vx], speed, atol=1e-7)


def test_a_feedback_in_time():
    """An input given as an expression switches too."""
    u = mbd.Input("u")
    body, mechanism = sled(u, inputs=[u])
    motion = mbd.simulate(mechanism, [0, 10], inputs={u: mbd.if_else(mbd.fabs(mbd.t - 5) < 0.01, 50.0, 0.0)})
    assert motion.final[body.vx] == pytest.approx(1.0, rel=1e-6)


def test_a_parameter_moves_a_switch():
    """The time of a switch may be a parameter: each run stops at its own."""
    at = mbd.Parameter("at", 3.0)
    body, mechanism = sled(mbd.if_else(mbd.fabs(mbd.t - at) < 0.01, 50.0, 0.0), parameters=[at])
    for value in (3.0, 7.7):
        motion = mbd.simulate(mechanism, np.linspace(0, 10, 21), parameters={at: value})
        assert motion.final[body.vx] == pytest.approx(1.0, rel=1e-6)
        assert np.all(np.abs(motion[body.vx][motion.t < value - 0.02]) < 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_a_driver_after_rest(method):
    """A base that is moved by 0.1 m in 0.1 s shakes a mass on a spring, as SciPy has it."""
    base = mbd.Body("base", mass=1, inertia=0.1)
    mass = mbd.Body("mass", mass=1, inertia=0.1, pose=(1, 0, 0))
    rails = [mbd.Translational(f"rail {b.name}", mbd.ground.at(0, 0), b.at(0, 0)) for b in (base, mass)]
    spring = mbd.TSDA("spring", base.at(0, 0), mass.at(0, 0), stiffness=100, free_length=1, damping=0.2)
    shove = mbd.Driver("shove", base.x, mbd.step(mbd.t, 5, 0, 5.1, 0.1))
    mechanism = mbd.Mechanism(bodies=[base, mass], joints=rails, forces=[spring], drivers=[shove])
    times = np.linspace(0, 10, 101)
    motion = mbd.simulate(mechanism, times, initial=[mass.x == 1, mass.vx == 0], method=method)

    def rate(t, y):
        s = np.clip((t - 5) / 0.1, 0, 1)
        place, speed = 0.1 * s**3 * (10 + s * (6 * s - 15)), 30 * s**2 * (1 - s) ** 2
        return [y[1], -100 * (y[0] - place - 1) - 0.2 * (y[1] - speed)]

    exact = solve_ivp(rate, (0, 10), [1.0, 0.0], t_eval=times, rtol=1e-10, atol=1e-12, max_step=0.01).y[0]
    np.testing.assert_allclose(motion[mass.x], exact, atol=2e-6)


@pytest.mark.parametrize("method", METHODS)
def test_a_driver_that_jumps_is_refused(method):
    """The driver and the time are named, and what came before is kept."""
    _, mechanism = sled(driver=mbd.if_else(mbd.t < 0.55, 0.0, 1.0))
    with pytest.raises(mbd.SimulationError, match=r"position of driver 'shove' jumps by 1 m at t = 0\.55 s") as caught:
        mbd.simulate(mechanism, np.linspace(0, 1, 11), method=method)
    assert caught.value.time == pytest.approx(0.55)
    assert caught.value.partial.t[-1] == pytest.approx(0.5)


def test_a_corner_of_a_driver_takes_an_impulse():
    """A driver that starts at once with 2 m/s: the velocity jumps with it, and a note says so."""
    body, mechanism = sled(driver=mbd.if_else(mbd.t < 0.5, 0.0, 2 * (mbd.t - 0.5)))
    motion = mbd.simulate(mechanism, np.linspace(0, 1, 11))
    np.testing.assert_allclose(motion[body.x], np.maximum(2 * (motion.t - 0.5), 0), atol=1e-9)
    assert any("velocity of driver 'shove' jumps" in note for note in motion.statistics.notes)


def test_a_corner_sets_what_hangs_on_it_in_motion():
    """A pendulum whose pivot starts at once: the bob keeps its velocity along the free direction, by the impulse."""
    cart = mbd.Body("cart", mass=1.0, inertia=1.0)
    rod = mbd.Body("rod", mass=1.0, inertia=1 / 12, pose=(0, -0.5, -np.pi / 2))
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0))
    pin = mbd.Revolute("pin", cart.at(0, 0), rod.at(-0.5, 0))
    start = mbd.Driver("start", rail.displacement, mbd.if_else(mbd.t < 0.5, 0.0, 3 * (mbd.t - 0.5)))
    mechanism = mbd.Mechanism(bodies=[cart, rod], joints=[rail, pin], drivers=[start])
    motion = mbd.simulate(mechanism, np.linspace(0, 1, 1001), initial=[rod.phi == -np.pi / 2, rod.omega == 0])
    # about the pin: I omega + m l^2/4 omega = -m (l/2) dv, with the bob below the pin
    after = motion[rod.omega][np.searchsorted(motion.t, 0.5) + 2]
    assert after == pytest.approx(-0.5 * 3 / (1 / 12 + 0.25), rel=1e-3)


def test_what_does_not_depend_on_time_has_no_stops():
    """No limit of the step, no stop: nothing is paid where there is nothing."""
    arm = mbd.Body("arm", mass=1, inertia=1 / 12, pose=(0.5, 0, 0))
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), arm.at(-0.5, 0))
    pendulum = mbd.Mechanism(bodies=[arm], joints=[hinge], forces=[mbd.Gravity()])
    few = mbd.simulate(pendulum, [0, 1], reltol=1e-3, abstol=1e-3)
    assert few.statistics.restarts <= 3


# --- jumps of prescribed positions and velocities, in words and numbers ---------------------------
def driven(expression):
    body = mbd.Body("slide", mass=1.0, inertia=1.0)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), body.at(0, 0))
    return mbd.Mechanism(bodies=[body], joints=[guide], drivers=[mbd.Driver("D", body.x, expression)])


@pytest.mark.slow
@pytest.mark.parametrize("method", ["idas", "erk", "rosenbrock"])
def test_failure_at_a_corner_names_the_driver_and_its_velocity_jump(method):
    saw = driven(ca.acos(mbd.cos(mbd.t + 0.5)))
    with pytest.raises(mbd.SimulationError, match="velocity of driver 'D' jumps by 2 m/s at t = 2.64159265359 s"):
        mbd.simulate(saw, np.linspace(0, 10, 11), method=method)
    with pytest.warns(mbd.MechanismWarning, match="velocity of driver 'D' jumps by 2 m/s"):
        mbd.kinematics(saw, np.linspace(0, 10, 11))


@pytest.mark.parametrize("analysis", [mbd.simulate, mbd.kinematics])
def test_a_jump_that_is_small_beside_its_value_is_found(analysis):
    tiny = driven(1000 + mbd.if_else(mbd.t > 5, 1e-7, 0))
    with pytest.raises(mbd.MechanismError, match="position of driver 'D' jumps by 1e-07 m at t = 5 s"):
        analysis(tiny, np.linspace(0, 10, 11))


def test_rosenbrock_is_not_advised_to_itself():
    body = mbd.Body("slide", mass=1.0, inertia=1.0)
    pull = mbd.Force("pull", body.at(0, 0), (1 / (1 - body.x), 0))
    mechanism = mbd.Mechanism(bodies=[body], forces=[pull])
    with pytest.raises(mbd.SimulationError) as caught:
        mbd.simulate(mechanism, np.linspace(0, 10, 11), method="rosenbrock")
    assert "method='rosenbrock'" not in str(caught.value)
    assert "may help" in str(caught.value)


@pytest.mark.parametrize("method", ["idas", "dop853"])
def test_a_spline_of_scipy_as_input(method):
    """Its integral is the momentum, and its second integral the way."""
    push = mbd.Input("push")
    body, mechanism = sled(push, inputs=[push])
    course = CubicSpline([0, 0.3, 1.1, 2], [0, 2, -1, 3])
    motion = mbd.simulate(mechanism, np.linspace(0, 2, 21), inputs={push: course}, method=method)
    np.testing.assert_allclose(motion[push], course(motion.t), atol=1e-12)
    np.testing.assert_allclose(motion[body.vx], course.antiderivative()(motion.t), atol=1e-7)
    np.testing.assert_allclose(motion[body.x], course.antiderivative(2)(motion.t), atol=1e-7)


@pytest.mark.parametrize("method", ["idas", "dop853"])
def test_an_input_that_ends_before_the_run(method):
    """Where it has no value any more the error names the input."""
    push = mbd.Input("push")
    _, mechanism = sled(push, inputs=[push])
    with pytest.raises(mbd.SimulationError, match=r"stopped at t = 0\.5\d* s: input 'push' is not finite"):
        mbd.simulate(mechanism, [0, 1], inputs={push: CubicSpline([0, 0.2, 0.5], [0, 2, 3])}, method=method)
