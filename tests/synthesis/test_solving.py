"""Solutions at the ends of descents: nearest ones, families, and conditions that repeat each other."""

from __future__ import annotations

import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.synthesis.linkages import Linkages, Search
from mbdcasadi.synthesis.positions import Positions
from mbdcasadi.synthesis.residuals import Residuals
from mbdcasadi.synthesis.solving import Solving

DRAWN = {"crank": 0.5, "coupler": 1.0, "rocker": 0.9, "base": 1.1, "point": (0.1, 0.3)}


@pytest.fixture
def model():
    return mbd.library.four_bar(**DRAWN, free=True)


def unknowns(model):
    return list(model.unknowns.values())


def ellipse(model):
    turn = np.linspace(0, 2 * np.pi, 17)[:-1]
    return [[model.point.position == (0.3 + 0.35 * np.cos(a), 0.8 + 0.2 * np.sin(a))] for a in turn]


def poses_of_a_known_one(model):
    """Poses of the coupler of a known four-bar."""
    known = mbd.library.four_bar(**DRAWN)
    motion = mbd.kinematics(known.driven(crank=0.4 + 2 * np.pi * mbd.t), [0, 0.15, 0.3, 0.5, 0.7])
    places, angles = motion[known.point.position], motion[known.coupler.phi]
    return [
        [model.point.position == place, model.coupler.phi == angle - angles[0]]
        for place, angle in zip(places, angles, strict=True)
    ]


@pytest.mark.slow
def test_a_nearest_linkage_misses_no_more_than_its_estimate_with_closed_joints(model, monkeypatch):
    """Also if the optimiser goes astray."""
    held = [model.unknowns["Ax"] == 0, model.unknowns["Ay"] == 0]
    positions = Positions(model.mechanism, unknowns(model), ellipse(model), held, exact=False)
    residuals = Residuals(positions)
    solving = Solving(positions, residuals, exact=False)
    y, _ = residuals.settled_each(np.tile(positions.start, (1, 15, 1)), positions.drawn_values[None])
    first = solving.nearest(y[0], positions.drawn_values)

    def astray(*, x0, **_):
        return {"x": mbd.vertcat(*(50 * np.array(x0)))}

    astray.stats = dict.fromkeys(["return_status"], "").copy

    monkeypatch.setitem(solving.__dict__, "_least_squares", (astray, solving._least_squares[1]))
    kept = solving.nearest(y[0], positions.drawn_values)
    size = solving.row_sizes
    assert np.sum((first.rows / size) ** 2) <= np.sum((kept.rows / size) ** 2) < 10
    assert np.max(np.abs(kept.rows[solving._held])) < 1e-9


@pytest.mark.slow
def test_sums_that_have_not_settled_are_counted(model, monkeypatch):
    """The list says of how many linkages the iterations ended too early."""
    monkeypatch.setattr("mbdcasadi.synthesis.solving.ITERATIONS", 2)
    positions = Positions(model.mechanism, unknowns(model), ellipse(model), [], exact=False)
    residuals = Residuals(positions)
    solving = Solving(positions, residuals, exact=False)
    y, _ = residuals.settled_each(np.tile(positions.start, (1, residuals.count, 1)), positions.drawn_values[None])
    solving.nearest(y[0], positions.drawn_values)
    assert solving.unsettled == 1
    found = Linkages([], Search(exact=False, positions=16, free=0, starts=9, seconds=1.0, unsettled=3))
    assert "of 3 that were looked at the sum of squares had not settled (9 starts" in repr(found)


@pytest.mark.slow
def test_an_ellipse_is_met_to_millimetres(model):
    """Sixteen places on an ellipse of 0.7 m by 0.4 m with one pivot held."""
    held = [model.unknowns["Ax"] == 0, model.unknowns["Ay"] == 0]
    found = mbd.synthesize(model.mechanism, unknowns(model), ellipse(model), held, exact=False, seconds=8)
    assert found[0].residual < 5e-3 and max(abs(v) for v in found[0].parameters.values()) < 30


def test_parallelograms_are_a_family(model):
    """A body that moves without turning on a circle: all parallelograms with cranks as long as its radius carry it."""
    turns = [0, 0.5, 1.1, 1.9, 2.6]
    positions = [[model.point.position == (np.cos(a), np.sin(a)), model.coupler.phi == 0] for a in turns]
    found = mbd.synthesize(model.mechanism, unknowns(model), positions, seconds=1)
    assert found.search.free == 0 and found.missing is None and "a sample of families" in repr(found)
    for linkage in found:
        a, b, c, d = (complex(linkage[model.unknowns[n + "x"]], linkage[model.unknowns[n + "y"]]) for n in "ABCD")
        assert abs(b - a - 1) < 1e-6 and abs(c - d - 1) < 1e-6 and linkage.family == 4


@pytest.mark.slow
def test_a_position_that_is_given_twice_counts_once(model):
    """Also the first one, whose pose is the drawn one."""
    positions = poses_of_a_known_one(model)
    once, *twice = (
        mbd.synthesize(model.mechanism, unknowns(model), [*positions, *more], seconds=20)
        for more in ([], positions[:1], positions[1:2])
    )
    places = [np.sort([x[model.unknowns[n]] for x in found for n in ("Bx", "Cx")]) for found in (once, *twice)]
    assert len(once) in (1, 6) and np.allclose(places[0], places[1:], atol=1e-8)
    assert all(x.family == 0 and x.residual < 1e-9 for found in twice for x in found)


def test_conditions_that_repeat_each_other_count_once(model):
    u, positions = model.unknowns, poses_of_a_known_one(model)[:3]
    held = [u["Ax"] == 0, u["Ay"] == 0, u["Dx"] == 1, u["Dy"] == 0]

    def free(conditions):
        given = Positions(model.mechanism, unknowns(model), positions, conditions, exact=True)
        solving = Solving(given, Residuals(given), exact=True)
        return solving.free, solving.equations

    assert free(held) == free([*held, 2 * u["Dx"] == 2, u["Dx"] - u["Ax"] == 1])
