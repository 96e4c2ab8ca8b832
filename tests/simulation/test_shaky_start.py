"""A plate on three bars that meet in a point cannot move, and cannot be held."""

from __future__ import annotations

import numpy as np
import pytest

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
    """It integrated the rounding of the pose for up to a minute."""
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
