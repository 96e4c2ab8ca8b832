"""What a linkage says of itself, against closed forms of four-bars."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.layout_engine import ConstrainedLayoutEngine

import mbdcasadi as mbd


@pytest.fixture(scope="module")
def five_points():
    """Four-bars of fixed pivots whose coupler point passes five points of a curve."""
    model = mbd.library.four_bar(0.5, 1.0, 0.9, 1.1, free=True, point=(0.1, 0.3))
    curve = mbd.kinematics(model.driven(crank=2 * np.pi * mbd.t), [0, 0.1, 0.2, 0.3, 0.4])[model.point.position]
    u = model.unknowns
    held = [u["Ax"] == 0, u["Ay"] == 0, u["Dx"] == 1.1, u["Dy"] == 0]
    found = mbd.synthesize(
        model.mechanism, list(u.values()), [[model.point.position == p] for p in curve], held, seconds=4
    )
    return model, found


def lengths(model, linkage):
    """Lengths of crank, coupler, rocker and base, and the joints B and C."""
    b, c = (np.array([linkage[model.unknowns[name + axis]] for axis in "xy"]) for name in "BC")
    return np.hypot(*b), np.hypot(*(c - b)), np.hypot(*(c - [1.1, 0])), 1.1, b, c


@pytest.mark.slow
def test_cranks_turn_by_grashofs_rule(five_points):
    """A body pinned to the ground turns if the shortest bar and the longest one are shorter than the others."""
    model, found = five_points
    assert len(found) >= 10
    for linkage in found:
        sides = lengths(model, linkage)[:4]
        grashof = 2 * (min(sides) + max(sides)) < sum(sides)
        if abs(2 * (min(sides) + max(sides)) - sum(sides)) > 1e-2:
            turns = bool(grashof and min(sides) != sides[1])
            assert linkage.crank_turns is turns and (linkage.driver is not None) is turns
    assert {x.crank_turns for x in found} >= {True, False}


@pytest.mark.slow
def test_branches_by_the_side_of_the_coupler(five_points):
    """Of a linkage with a crank, C lies on one side of the diagonal BD on each branch; the others have one branch."""
    model, found = five_points
    names = mbd.equations(model.mechanism).coordinate_names
    checked = 0
    for linkage in found:
        a, b, c, d, *joints = lengths(model, linkage)
        angles = linkage.poses[:, [names.index("crank.phi"), names.index("rocker.phi")]]
        turned = np.exp(1j * angles)
        first, second = (complex(*x) for x in joints)
        points_b, points_c = turned[:, 0] * first, 1.1 + turned[:, 1] * (second - 1.1)
        sides = np.sign(((points_c - points_b) * np.conj(1.1 - points_b)).imag)
        shortest = min(a, b, c, d)
        if linkage.crank_turns and shortest == a:
            assert linkage.one_branch is bool(np.all(sides == sides[0]))
            checked += 1
            steps = np.diff(np.unwrap(angles[:, 0]))
            whole = [(steps % (2 * np.pi)).sum(), (-steps % (2 * np.pi)).sum()]
            assert linkage.in_order is bool(linkage.one_branch and min(whole) < 2 * np.pi)
        elif linkage.crank_turns is False and 2 * (shortest + max(a, b, c, d)) > a + b + c + d:
            assert linkage.one_branch is True
    assert checked


@pytest.mark.slow
def test_the_motion_is_that_of_the_driven_mechanism(five_points):
    """One turn passes the points in their order; torque and loads are those of inverse dynamics; masses follow bars."""
    model, found = five_points
    linkage = found.where(in_order=True, crank_turns=True, one_branch=True)[0]
    motion = linkage.motion(speed=3.0, outputs=4001)
    assert motion.t[-1] == pytest.approx(2 * np.pi / 3)
    path = motion[model.point.position]
    wanted = np.array([linkage.poses[k, :2] for k in range(5)])
    assert wanted.shape == (5, 2)
    targets = mbd.kinematics(model.driven(crank=2 * np.pi * mbd.t), [0, 0.1, 0.2, 0.3, 0.4])[model.point.position]
    passed = [int(np.argmin(np.hypot(*(path - p).T))) for p in targets]
    assert passed == sorted(passed) and max(np.min(np.hypot(*(path - p).T)) for p in targets) < 2e-3
    driven = linkage.mechanism.replace(drivers=[linkage.driver])
    again = mbd.inverse_dynamics(driven, motion.t, parameters={driven.parameters[-1]: 3.0})
    assert np.allclose(again[linkage.driver.effort], motion[linkage.driver.effort], rtol=1e-9, atol=1e-12)
    a = lengths(model, linkage)[0]
    assert linkage[model.crank.mass] == pytest.approx(a) and motion[model.crank.mass][0] == pytest.approx(a)


@pytest.mark.slow
def test_the_transmission_angle_is_least_where_the_crank_lies_along_the_base(five_points):
    model, found = five_points
    checked = 0
    for linkage in found.where(crank_turns=True):
        a, b, c, d, *_ = lengths(model, linkage)
        if linkage.driver.expression.name() != "crank.phi" or min(a, b, c, d) != a:
            continue
        angles = [np.arccos((b**2 + c**2 - (d + s * a) ** 2) / (2 * b * c)) for s in (1, -1)]
        least = min(min(x, np.pi - x) for x in angles)
        assert linkage.transmission_angle == pytest.approx(least, abs=1e-9)
        checked += 1
    assert checked


@pytest.mark.slow
def test_lists_are_chosen_sorted_shown_and_drawn(five_points, monkeypatch):
    """Pictures are laid out once, not once for each of them."""
    model, found = five_points
    assert len(found.where(lambda x: x.found > 1)) <= len(found)
    ranked = found.sorted(lambda x: x[model.unknowns["Bx"]])
    assert [x[model.unknowns["Bx"]] for x in ranked] == sorted(x[model.unknowns["Bx"]] for x in found)
    assert type(found[:3]) is mbd.Linkages and len(found[:3]) == 3
    assert "through 5 positions, each found" in repr(found) and "<td" in found._repr_html_()
    layouts, execute = [], ConstrainedLayoutEngine.execute
    monkeypatch.setattr(ConstrainedLayoutEngine, "execute", lambda *given: (layouts.append(1), execute(*given)))
    figure = found[:3].draw(columns=2)
    assert len(figure.axes) == 4 and len(layouts) == 1 and type(figure.get_layout_engine()) is ConstrainedLayoutEngine
    turning = found.where(crank_turns=True)[0]
    assert turning.draw(trace=[model.point]).lines is not None
    transmission = [x.transmission_angle for x in found.sorted(lambda x: x.transmission_angle)]
    known = [x for x in transmission if x is not None]
    assert transmission == sorted(known) + [None] * (len(found) - len(known)) and len(known) < len(found)
    for match, wrong in (
        ("a check must be one of .*, got 'grashof'", lambda: found.where(grashof=True)),
        ("crank_turns must be True or False", lambda: found.where(crank_turns=1)),
        ("condition must be a function of linkage", lambda: found.where(True)),
        ("key must be a function of linkage", lambda: found.sorted("residual")),
        ("columns must be a whole number of at least 1", lambda: found.draw(columns=0)),
    ):
        with pytest.raises(mbd.ModelError, match=match):
            wrong()
    with pytest.raises(TypeError):
        found[0].parameters[model.unknowns["Bx"]] = 9.0
    with pytest.raises(mbd.ExpressionError, match="values of parameters"):
        found[0][model.crank.phi]
    rocking = found.where(crank_turns=False)[0]
    assert rocking.driver is None and rocking.transmission_angle is None
    with pytest.raises(mbd.ModelError, match="no body that is pinned to the ground turns fully"):
        rocking.motion()
