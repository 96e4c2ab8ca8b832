"""Starts in singular poses: plates on bars that meet in a point, and flat rows of parallelograms."""

from __future__ import annotations

import numpy as np
import pytest
from test_singular_passage import parallelogram

import mbdcasadi as mbd


def plate(forces, *, meet=True):
    """A plate on three bars, the lines of which meet in (0.2, 0.1), or miss it."""
    centre, angles = np.array([0.2, 0.1]), [0.3, 2.0, 4.4]
    body = mbd.Body("plate", mass=1, inertia=0.1, pose=(0.3, 0.1, 0))
    bars = []
    for k, angle in enumerate(angles):
        along = np.array([np.cos(angle), np.sin(angle)])
        near, far = centre + 0.3 * along, centre + (1.2 + 0.1 * k) * along
        far = far if meet or k else far + np.array([0.0, 0.2])
        bars.append(
            mbd.Distance(f"bar {k}", mbd.ground.at(*far), body.at(*(near - [0.3, 0.1])), np.hypot(*(far - near)))
        )
    return mbd.Mechanism([body], bars, forces=forces(body))


def test_loads_that_no_reactions_hold_are_refused():
    """No integrator follows the rounding of the pose."""
    model = plate(lambda body: [mbd.Gravity()])
    assert mbd.check(model).singular == "shaky"
    with pytest.raises(mbd.SingularityError, match="pose is shaky") as caught:
        mbd.simulate(model, duration=0.1)
    assert all(f"bar {k}" in str(caught.value) for k in range(3))


def test_without_loads_along_its_motion_it_rests():
    """No load, and one through the point in which the bars meet."""
    for forces in (lambda body: [], lambda body: [mbd.Force("pull", body.at(-0.1, 0), (1.0, 2.0))]):
        motion = mbd.simulate(plate(forces), np.linspace(0, 0.1, 3))
        assert np.max(np.ptp(motion.q, axis=0)) < 1e-6


def test_bars_that_do_not_meet_hold_the_plate():
    motion = mbd.simulate(plate(lambda body: [mbd.Gravity()], meet=False), np.linspace(0, 0.1, 3))
    assert np.max(np.ptp(motion.q, axis=0)) < 1e-9


@pytest.mark.parametrize("loops", [1, 2, 3])
def test_flat_rows_are_bifurcations(loops):
    """Several loops fold one by one: excursions along some of these motions leave others flat."""
    _, model, _ = parallelogram(loops, angle=0.0)
    report = mbd.check(model)
    assert (report.degrees_of_freedom, report.redundant_rows, report.singular) == (1, 0, "bifurcation")


@pytest.mark.parametrize("method", ["idas", "erk", "rosenbrock"])
def test_a_flat_row_at_rest_is_refused_under_its_weight(method):
    """It may fall as a row, or with one crank left where it is; a run would end beside all of these motions."""
    bars, model, _ = parallelogram(2, angle=0.0, gravity=True)
    with pytest.raises(mbd.SingularityError, match="bifurcation: several motions go from it.*left 0.x"):
        mbd.simulate(model, np.linspace(0, 1, 21), initial=[bars[0].phi == 0, bars[0].omega == 0], method=method)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["idas", "erk", "rosenbrock"])
def test_a_flat_row_starts_with_velocities_along_one_of_its_motions(method):
    """``I phi'' = -W cos(phi)``, by its energy; other velocities meet no motion."""
    loops, rate = 2, -2.0
    bars, model, inertia = parallelogram(loops, angle=0.0, gravity=True)
    times, flat = np.linspace(0, 0.4, 21), [bars[0].phi == 0]
    motion = mbd.simulate(model, times, initial=[*flat, *(bar.omega == rate for bar in bars)], method=method)
    weight = 9.81 * ((loops + 1) / 2 + loops)
    energy = inertia * motion[bars[0].omega] ** 2 / 2 + weight * np.sin(motion[bars[0].phi])
    np.testing.assert_allclose(energy, inertia * rate**2 / 2, rtol=1e-6)
    for bar in bars:
        np.testing.assert_allclose(motion[bar.phi], motion[bars[0].phi], atol=1e-9)
    with pytest.raises(mbd.SingularityError, match="velocities must be along one of them"):
        mbd.simulate(model, times, initial=[*flat, bars[0].omega == rate], method=method)


def test_dop853_says_that_a_start_is_singular_and_not_that_rows_are_redundant():
    bars, model, _ = parallelogram(1, angle=0.0)
    with pytest.raises(mbd.SingularityError, match=r'"dop853" cannot start at t = 0 s: the pose is singular, a bifurc'):
        mbd.simulate(model, duration=0.1, initial=[bar.omega == 3.0 for bar in bars], method="dop853")
