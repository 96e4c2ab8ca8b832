"""Lists of linkages in files."""

from __future__ import annotations

import numpy as np
import pytest

import mbdcasadi as mbd


def list_of_one():
    """One four-bar whose coupler point passes three places with the crank at given angles."""
    model = mbd.library.four_bar(0.3, 1.0, 0.8, 1.0, point=(0.0, 0.3), masses=2.0, free=True)
    u, timed = model.unknowns, [(0.45, 0.75, 0.0), (0.25, 0.80, 0.7), (0.05, 0.70, 1.4)]
    places = [[model.point.x == x, model.point.y == y, model.crank.phi == angle] for x, y, angle in timed]
    held = [u["Ax"] == 0, u["Ay"] == 0, u["Dx"] == 1, u["Dy"] == 0]
    return model, mbd.synthesize(model.mechanism, list(u.values()), places, held, seconds=20)


@pytest.mark.slow
def test_a_list_is_read_as_it_was_written(tmp_path):
    model, found = list_of_one()
    found.save(tmp_path / "linkages.npz")
    again = mbd.read_linkages(tmp_path / "linkages.npz", model.mechanism)
    assert repr(again) == repr(found) and again[0].parameters == found[0].parameters
    assert np.array_equal(again[0].poses, found[0].poses) and again[0].misses == found[0].misses
    assert again[0].transmission_angle == found[0].transmission_angle
    with pytest.raises(mbd.FileError, match="no parameter 'Ax'"):
        mbd.read_linkages(tmp_path / "linkages.npz", mbd.library.four_bar().mechanism)
    crossed = model.mechanism.replace(
        joints=[*model.mechanism.joints[:3], mbd.Revolute("E", mbd.ground.at(3, 0), model.D.b)]
    )
    with pytest.raises(mbd.FileError, match="do not meet"):
        mbd.read_linkages(tmp_path / "linkages.npz", crossed)
    found.where(lambda x: False).save(tmp_path / "none.npz")
    assert len(mbd.read_linkages(tmp_path / "none.npz", model.mechanism)) == 0


@pytest.mark.slow
def test_a_linkage_is_a_guess_for_an_optimum():
    """With dimensions free and a path within one centimetre the motor needs less than half of the torque."""
    model, found = list_of_one()
    u, timed = model.unknowns, [(0.25, 0.80, 0.7), (0.05, 0.70, 1.4)]
    motion = found[0].motion()
    torque = np.max(np.abs(motion[found[0].driver.effort]))
    waypoints = [
        mbd.Waypoint(angle / (2 * np.pi), [(model.point.x - x) ** 2 + (model.point.y - y) ** 2 <= 0.01**2])
        for x, y, angle in timed
    ]
    free = [u[name] for name in ("Bx", "By", "Cx", "Cy", "Px", "Py")]
    near = [mbd.bounded(found[0][x] - 0.2, x, found[0][x] + 0.2) for x in free]
    problem = mbd.OptimalControlProblem(
        found[0].mechanism, duration=1.0, initial=[model.crank.phi == 0, model.crank.omega == 2 * np.pi],
        path=[model.crank.omega == 2 * np.pi], waypoints=waypoints, boundary=near, running_cost=model.tau**2,
        free_parameters=free,
    )  # fmt: skip
    solution = mbd.optimize(problem, guess=motion)
    assert np.max(np.abs(solution.trajectory[model.tau])) < 0.5 * torque
