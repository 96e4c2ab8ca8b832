"""Growth of errors along unstable motions, against closed forms and simulations."""

import re
import warnings

import numpy as np
import pytest
from motions import crank_rocker, half_turn, pendulum

import mbdcasadi as mbd
from mbdcasadi.optimal_control.measures.local_error import REPLAY_ERROR, ReplayErrors, replay_error
from mbdcasadi.optimal_control.motion.phase_solution import PhaseSolution


def held(duration, inertia=0.0):
    """A pendulum that is held upright."""
    bob, tau, mechanism = pendulum(inertia=inertia)
    upright = [bob.phi == np.pi, bob.omega == 0]
    return mbd.OptimalControlProblem(mechanism, duration, upright, upright, running_cost=tau**2)


def test_an_upright_pendulum():
    """Errors follow x'' = (g/l) x: hyperbolic functions of the time."""
    part = mbd.optimize(held(1.0), intervals=20).phases[0]
    growth, rate = part.growth, np.sqrt(9.81)
    n = part.phase.equations.q.numel()
    angle = [growth.places.index(2), growth.places.index(n + 2)]
    whole = np.linalg.multi_dot(growth.transitions[::-1])[np.ix_(angle, angle)]
    expected = [[np.cosh(rate), np.sinh(rate) / rate], [rate * np.sinh(rate), np.cosh(rate)]]
    assert np.allclose(whole, expected, rtol=1e-5)


@pytest.mark.slow
def test_the_growth_in_a_linkage_whose_intervals_are_long():
    """Against simulations from both sides of the start; slopes halfway through each interval alone are off by 40 %."""
    f = crank_rocker()
    solution = mbd.optimize(half_turn(f), intervals=8)
    growth, step = solution.phases[0].growth, 1e-5
    one, other = (
        solution.simulate(initial=[f.crank.phi == 0.5 + shift, f.crank.omega == 0], reltol=1e-11, abstol=1e-11)
        for shift in (step, -step)
    )
    places = growth.places[:3]
    first, last = ((one.q[k] - other.q[k])[places] / (2 * step) for k in (0, -1))
    whole = np.linalg.multi_dot(growth.transitions[::-1])[:3, :3]
    assert np.allclose(whole @ first, last, rtol=0.13)


def test_intervals_that_cannot_be_integrated_again(monkeypatch):
    """Rounding alone grows beyond what is followed: the warning says so, and no finer mesh is asked for."""

    def ends_early(part):
        raise RuntimeError("the integrator did not get to the end")

    with pytest.warns(mbd.MechanismWarning, match="unstable"):
        solution = mbd.optimize(held(9.0), intervals=20)
    monkeypatch.setattr(PhaseSolution, "end_differences", property(ends_early))
    errors = ReplayErrors(solution)
    assert replay_error(solution.phases[0]) > REPLAY_ERROR and errors.largest == 0
    assert "only feedback" in errors.sentences()[0]


def test_where_accelerations_have_no_slope_the_growth_is_infinite(monkeypatch):
    """As in a pose in which a linkage branches; a simulation may then end anywhere."""
    solution = mbd.optimize(half_turn(crank_rocker()), intervals=10)
    part = solution.phases[0]
    factors = part.growth_to_end.copy()
    factors[3] = np.nan
    monkeypatch.setattr(part, "growth_to_end", factors)
    part.__dict__.pop("largest_growth", None)
    assert part.largest_growth == np.inf and replay_error(part) == np.inf
    assert np.all(ReplayErrors(solution).errors[0] == 0) and "only feedback" in ReplayErrors(solution).sentences()[0]


def cart(duration, start, end, links=1):
    """A cart with links; all angles from one value to another, from rest to rest."""
    force, body = mbd.Input("F"), mbd.Body("cart", mass=1, inertia=0.1)
    bodies, joints, last = [body], [mbd.Translational("rail", mbd.ground.at(0, 0), body.at(0, 0))], body.at(0, 0)
    for k in range(links):
        link = mbd.Body(f"link {k}", mass=0.3, inertia=0.3 * 0.5**2 / 12, pose=(0, 0, start))
        joints.append(mbd.Revolute(f"hinge {k}", last, link.at(-0.25, 0)))
        bodies.append(link)
        last = link.at(0.25, 0)
    drive = mbd.GeneralizedForce("drive", [(body.x, force)])
    mechanism = mbd.Mechanism(bodies, joints, forces=[mbd.Gravity(), drive], inputs=[force])
    angles = bodies[1:]
    first = [body.x == 0, body.vx == 0, *[c for b in angles for c in (b.phi == start, b.omega == 0)]]
    last_state = [body.x == 1, body.vx == 0, *[c for b in angles for c in (b.phi == end, b.omega == 0)]]
    return mbd.OptimalControlProblem(mechanism, duration, first, last_state, running_cost=force**2)


def chain(duration, start, motor):
    """Two links with one motor, from rest at an angle to upright."""
    torque, links, joints, last = mbd.Input("tau"), [], [], mbd.ground.at(0, 0)
    for k in range(2):
        link = mbd.Body(f"link {k}", mass=1, inertia=1 / 12, pose=(0, 0, start))
        joints.append(mbd.Revolute(f"hinge {k}", last, link.at(-0.5, 0)))
        links.append(link)
        last = link.at(0.5, 0)
    drive = mbd.Torque("motor", links[motor], torque, *links[:motor])
    mechanism = mbd.Mechanism(links, joints, forces=[mbd.Gravity(), drive], inputs=[torque])
    first, end = ([c for b in links for c in (b.phi == angle, b.omega == 0)] for angle in (start, np.pi / 2))
    return mbd.OptimalControlProblem(mechanism, duration, first, end, running_cost=torque**2)


@pytest.mark.slow
def test_the_miss_of_a_simulation_is_foreseen():
    """To first order the miss of a simulation is the sum of the local errors, each carried on."""
    solution = mbd.optimize(cart(4.0, -np.pi / 2, np.pi / 2), intervals=48, search=mbd.STRATEGIES[:1])
    assert replay_error(solution.phases[0]) == pytest.approx(solution.verify().largest_deviation, rel=0.3)


UPRIGHT = np.pi / 2
CASES = {
    "cart, up in 2 s": lambda: cart(2.0, -UPRIGHT, UPRIGHT),
    "cart, up in 4 s": lambda: cart(4.0, -UPRIGHT, UPRIGHT),
    "cart, moved upright": lambda: cart(2.0, UPRIGHT, UPRIGHT),
    "cart, moved upright for long": lambda: cart(5.0, UPRIGHT, UPRIGHT),
    "two links upright": lambda: cart(3.0, UPRIGHT, UPRIGHT, links=2),
    "acrobot from beside": lambda: chain(3.0, UPRIGHT + 0.3, 1),
    "pendubot from beside": lambda: chain(3.0, UPRIGHT + 0.3, 0),
    "acrobot": lambda: chain(4.0, -UPRIGHT, 1),
    "held": lambda: held(2.0),
    "held for long": lambda: held(12.0, inertia=0.1),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_none_that_does_not_replay_is_returned_without_a_warning(name):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        solution = mbd.optimize(CASES[name]())
    told = [
        match for w in caught if (match := re.search(r"errors grow by a factor of (\S+) on the way", str(w.message)))
    ]
    check = solution.verify()
    assert check.final_error <= 3 * REPLAY_ERROR or told
    if told:
        assert float(told[0][1]) == pytest.approx(check.growth, rel=0.06)
        assert check.final_error < REPLAY_ERROR or "unstable: errors grow" in repr(check)
