"""All linkages through positions, against equations that are solved by hand."""

from __future__ import annotations

import itertools
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import numpy as np
import pytest
from scipy.optimize import fsolve

import mbdcasadi as mbd

DRAWN = {"crank": 0.5, "coupler": 1.0, "rocker": 0.9, "base": 1.1, "point": (0.1, 0.3)}


def pivots(model, base=1.1):
    """Conditions that hold the pins on the ground."""
    u = model.unknowns
    return [u["Ax"] == 0, u["Ay"] == 0, u["Dx"] == base, u["Dy"] == 0]


def joints(model):
    """Unknown places of the four pins."""
    return [model.unknowns[name + axis] for name in "ADBC" for axis in "xy"]


def function_generator(inputs, outputs, **options):
    """Four-bars whose crank and rocker turn by given angles."""
    model = mbd.library.four_bar(**DRAWN, free=True)
    positions = [[model.crank.phi == i, model.rocker.phi == o] for i, o in zip(inputs, outputs, strict=True)]
    options = {"conditions": pivots(model), "seconds": 30} | options
    return model, mbd.synthesize(model.mechanism, joints(model), positions, **options)


# --- functions -----------------------------------------------------------------------------------
def three_angles(**options):
    """The one linkage through three pairs of angles that begin at given ones, and its lengths by Freudenstein."""
    inputs, outputs, begin = np.radians([0, 20, 50]), np.radians([0, 25, 45]), np.radians([70, 110])
    matrix = np.column_stack([np.cos(begin[1] + outputs), -np.cos(begin[0] + inputs), np.ones(3)])
    k = np.linalg.solve(matrix, np.cos(begin[0] + inputs - begin[1] - outputs))
    model = mbd.library.four_bar(**DRAWN, free=True)
    u = model.unknowns
    held = [mbd.atan2(u["By"], u["Bx"]) == begin[0], mbd.atan2(u["Cy"], u["Cx"] - 1.1) == begin[1]]
    positions = [[model.crank.phi == i, model.rocker.phi == o] for i, o in zip(inputs, outputs, strict=True)]
    held = [*pivots(model), *held]
    found = mbd.synthesize(model.mechanism, joints(model), positions, held, seconds=30, **options)
    return u, found, 1.1 / k[0], 1.1 / k[1]


def test_three_pairs_of_angles_are_freudensteins():
    u, found, crank, rocker = three_angles()
    assert len(found) == 1 and found.search.free == 0 and found[0].found >= 20
    assert np.hypot(found[0][u["Bx"]], found[0][u["By"]]) == pytest.approx(crank, abs=1e-12)
    assert np.hypot(found[0][u["Cx"]] - 1.1, found[0][u["Cy"]]) == pytest.approx(rocker, abs=1e-12)
    assert found[0].residual < 1e-13


@pytest.mark.slow
@pytest.mark.parametrize("pool", [ThreadPoolExecutor, ProcessPoolExecutor])
def test_searches_in_an_executor(pool):
    with pool(2) as executor:
        u, found, crank, _ = three_angles(executor=executor)
    assert len(found) == 1 and np.hypot(found[0][u["Bx"]], found[0][u["By"]]) == pytest.approx(crank, abs=1e-12)


def test_three_displacements_of_a_slider_are_a_linear_problem():
    """``2 r x cos a + 2 r e sin a + (l² - r² - e²) = x²`` is linear in r, r e and the rest."""
    angles, long = np.radians([20, 80, 150]), 1.2
    ways = 0.35 * np.cos(angles) + np.sqrt(long**2 - (0.15 - 0.35 * np.sin(angles)) ** 2)
    matrix = np.column_stack([2 * ways * np.cos(angles), 2 * np.sin(angles), np.ones(3)])
    r, r_e, rest = np.linalg.solve(matrix, ways**2)
    model = mbd.library.slider_crank(0.4, 1.3, 0.1, free=True)
    u, slider = model.unknowns, model.coordinates["slider"]
    held = [u["Ax"] == 0, u["Ay"] == 0, u["slider_angle"] == 0, mbd.atan2(u["By"], u["Bx"]) == angles[0]]
    held += [u["Cx"] == ways[0]]
    positions = [[model.crank.phi == a - angles[0], slider == x - ways[0]] for a, x in zip(angles, ways, strict=True)]
    found = mbd.synthesize(model.mechanism, list(u.values()), positions, held, seconds=10)
    places = {name: found[0][value] for name, value in u.items()}
    assert len(found) == 1 and np.hypot(places["Bx"], places["By"]) == pytest.approx(r, abs=1e-12)
    assert places["Cy"] == pytest.approx(r_e / r, abs=1e-12)
    rod = np.hypot(places["Cx"] - places["Bx"], places["Cy"] - places["By"])
    assert rod == pytest.approx(np.sqrt(rest + r**2 + (r_e / r) ** 2), abs=1e-12)
    assert found[0].one_branch and found[0].crank_turns and found[0].transmission_angle is None


def freudenstein_of_five(inputs, outputs):
    """Places of B and C by the determinants of Freudenstein's equations, zeros of which a grid of angles leads to."""

    def rows(begin):
        i, o = begin[0] + inputs, begin[1] + outputs
        return np.column_stack([np.cos(o), -np.cos(i), np.ones(5), np.cos(i - o)])

    def determinants(begin):
        matrix = rows(begin)
        return [np.linalg.det(matrix[[0, 1, 2, k]]) for k in (3, 4)]

    found = []
    for guess in itertools.product(np.linspace(-np.pi, np.pi, 33)[:-1], np.linspace(-np.pi, np.pi, 33)[:-1]):
        begin, _, flag, _ = fsolve(determinants, guess, xtol=1e-13, full_output=True)
        matrix = rows(begin)
        k, _, rank, _ = np.linalg.lstsq(matrix[:, :3], matrix[:, 3], rcond=1e-9)
        if (
            flag != 1
            or rank < 3
            or np.max(np.abs(matrix[:, :3] @ k - matrix[:, 3])) > 1e-10
            or np.min(np.abs(k[:2])) < 1e-6
        ):
            continue
        a, c = 1.1 / k[0], 1.1 / k[1]
        place = [a * np.cos(begin[0]), a * np.sin(begin[0]), 1.1 + c * np.cos(begin[1]), c * np.sin(begin[1])]
        if np.max(np.abs(place)) < 30 and not any(np.allclose(place, other, atol=1e-6) for other in found):
            found.append(place)
    return np.array(found)


@pytest.mark.slow
@pytest.mark.parametrize("outputs", [[0, 14, 26, 35, 41], [0, 10, 25, 50, 80], [0, -10, -25, -35, -40]])
def test_five_pairs_of_angles_are_the_zeros_of_two_determinants(outputs):
    """All real solutions, and no others."""
    inputs, outputs = np.radians([0, 15, 32, 51, 70]), np.radians(outputs)
    reference = freudenstein_of_five(inputs, outputs)
    model, found = function_generator(inputs, outputs)
    places = np.array([[x[model.unknowns[n]] for n in ("Bx", "By", "Cx", "Cy")] for x in found])
    places = places[np.max(np.abs(places), axis=1) < 30]
    assert len(reference)
    for one in reference:
        assert np.min(np.max(np.abs(places - one), axis=1)) < 1e-8
    for one in places:
        assert np.min(np.max(np.abs(reference - one), axis=1)) < 1e-6


# --- bodies through poses ----------------------------------------------------------------------
POSES = [(0.6, 0.9, 0.0), (0.9, 1.1, -0.2), (1.3, 1.15, -0.35), (1.6, 1.0, -0.55), (1.8, 0.7, -0.8)]


def guided(count, **options):
    """Four-bars whose coupler takes poses."""
    model = mbd.library.four_bar(**DRAWN, free=True)
    u = model.unknowns
    frame = model.point
    positions = [[frame.x == x, frame.y == y, model.coupler.phi == angle] for x, y, angle in POSES[:count]]
    return model, mbd.synthesize(model.mechanism, list(u.values()), positions, **({"seconds": 30} | options))


def dyads_of_burmester():
    """Pivots A and joints B in the first pose, so that B keeps its distance from A: by Newton's method from a grid."""
    (x0, y0, t0), *others = POSES

    def distances(z):
        a, b = z[:2], z[2:] - [x0, y0]
        moved = []
        for x, y, t in others:
            c, s = np.cos(t - t0), np.sin(t - t0)
            moved.append(np.array([x + c * b[0] - s * b[1], y + s * b[0] + c * b[1]]))
        return [np.sum((m - a) ** 2) - np.sum((z[2:] - a) ** 2) for m in moved]

    random, found = np.random.default_rng(0), []
    for _ in range(600):
        z, _, flag, _ = fsolve(
            distances, random.normal(size=4) * 10 ** random.uniform(-1, 1.3), xtol=1e-13, full_output=True
        )
        if flag == 1 and np.max(np.abs(distances(z))) < 1e-9 and not any(np.allclose(z, w, rtol=1e-5) for w in found):
            found.append(z)
    return np.array(found)


@pytest.mark.slow
def test_five_poses_are_pairs_of_burmesters_dyads():
    dyads = dyads_of_burmester()
    assert len(dyads) in (2, 4)
    model, found = guided(5)
    assert len(found) == len(dyads) * (len(dyads) - 1) // 2
    for linkage in found:
        for pivot, joint in ("AB", "DC"):
            z = [linkage[model.unknowns[name + axis]] for name in (pivot, joint) for axis in "xy"]
            assert np.min(np.max(np.abs(dyads - z), axis=1) / np.max(np.abs(z))) < 1e-8
        assert linkage.residual < 1e-12 * max(1, np.max(np.abs(linkage.poses)))


@pytest.mark.slow
@pytest.mark.parametrize("count, free", [(3, 4), (4, 2)])
def test_fewer_poses_leave_a_sample(count, free):
    """Of 8 places of pins, each pose after the first one binds two; the coupler takes them all the same."""
    model, found = guided(count, seconds=2)
    assert found.search.free == free and found.missing is None and f"{free} dimensions stay free" in repr(found)
    assert len(found) > 20 and max(x.residual for x in found) < 1e-9
    place = model.coupler.phi
    for linkage in found[:3]:
        eom = mbd.equations(model.mechanism)
        angles = linkage.poses[:, eom.coordinate_names.index("coupler.phi")]
        assert np.allclose(np.exp(1j * angles), np.exp(1j * np.array([p[2] for p in POSES[:count]]))), place


@pytest.mark.slow
def test_limits_hold():
    """Inequalities, also those that parameters carry, bind what is free."""
    model = mbd.library.four_bar(**DRAWN, free=True)
    u = model.unknowns
    positions = [[model.point.x == x, model.point.y == y, model.coupler.phi == t] for x, y, t in POSES[:3]]
    limits = [u["Ay"] <= 0, mbd.bounded(0.5, u["Dx"] - u["Ax"], 1.5), u["Dy"] == u["Ay"]]
    found = mbd.synthesize(model.mechanism, list(u.values()), positions, limits, seconds=12)
    assert len(found) > 2
    for x in found:
        assert x[u["Ay"]] <= 1e-8 and 0.5 - 1e-8 <= x[u["Dx"]] - x[u["Ax"]] <= 1.5 + 1e-8
        assert x[u["Dy"]] == pytest.approx(x[u["Ay"]], abs=1e-12)


# --- paths ---------------------------------------------------------------------------------------
NINE = [
    (0.25, 0),
    (0.52, 0.10),
    (0.80, 0.70),
    (1.20, 1.00),
    (1.40, 1.30),
    (1.10, 1.48),
    (0.70, 1.40),
    (0.20, 1.00),
    (0.02, 0.40),
]


@pytest.mark.slow
def test_nine_points_are_closed_under_cognates():
    """Problem 3 of Wampler, Morgan and Sommese has 64 real triples of cognates."""
    model = mbd.library.four_bar(**DRAWN, free=True)
    found = mbd.synthesize(
        model.mechanism, list(model.unknowns.values()), [[model.point.position == p] for p in NINE],
        seconds=6, symmetries=[model.cognates],
    )  # fmt: skip
    assert 30 <= len(found) <= 192 and len(found) % 3 == 0 and all(x.residual < 1e-9 for x in found)
    points = np.array([[x[p] for p in joints(model)] for x in found])
    both = np.concatenate([points, points[:, [2, 3, 0, 1, 6, 7, 4, 5]]])
    for linkage in found[:10]:
        for image in model.cognates(linkage.parameters):
            place = [image[p] for p in joints(model)]
            assert np.min(np.max(np.abs(both - place), axis=1)) < 1e-6 * (1 + np.max(np.abs(place)))
    apart = np.max(np.abs(points[:, None] - both[None]), axis=2) + 10 * np.eye(len(points), 2 * len(points))
    assert np.min(apart) > 1e-5, "exchanged chains count once"


@pytest.mark.slow
def test_the_generator_of_a_curve_is_found_again():
    known = mbd.library.four_bar(0.35, 1.2, 1.0, 1.1, point=(0.2, -0.3), gravity=None)
    curve = mbd.kinematics(known.driven(crank=0.5 + 2 * np.pi * mbd.t), np.linspace(0, 1, 41)[:-1])[
        known.point.position
    ]
    model = mbd.library.four_bar(**DRAWN, free=True)
    positions = [[model.point.position == p] for p in curve]
    found = mbd.synthesize(model.mechanism, list(model.unknowns.values()), positions, exact=False, seconds=90)
    assert found[0].residual < 1e-9 and found[0].residual <= found[-1].residual and found.search.free == 0
    assert found.search.seconds < 80, "it ends with a linkage that meets all"


@pytest.mark.slow
def test_the_nearest_linkage_is_the_least_sum_of_squares():
    """One free length: the sum of squares has its least value where its slope vanishes; the linkage closes."""
    model = mbd.library.four_bar(**DRAWN, free=True)
    u = model.unknowns
    positions = [[model.crank.phi == i, model.rocker.phi == o] for i, o in ((0, 0), (0.4, 0.2), (0.8, 0.5), (1.2, 0.9))]
    held = [*pivots(model), u["Cx"] == 1.2, u["Cy"] == 0.8, u["Bx"] == 0.4]
    found = mbd.synthesize(model.mechanism, joints(model), positions, held, exact=False, seconds=3)
    best = found[0]

    def squares(y):
        """Least sum of squares with a height of B, poses by closing the linkage."""
        b, c, d = np.array([0.4, y]), np.array([1.2, 0.8]), np.array([1.1, 0.0])
        total = 0.0
        for i, o in ((0.4, 0.2), (0.8, 0.5), (1.2, 0.9)):
            turns = i + np.linspace(-0.5, 0.5, 20001)
            x = np.column_stack(
                [np.cos(turns) * b[0] - np.sin(turns) * b[1], np.sin(turns) * b[0] + np.cos(turns) * b[1]]
            )
            far, near = np.hypot(*(x - d).T), np.hypot(*(c - d))
            share = (near**2 - np.hypot(*(c - b)) ** 2 + far**2) / (2 * near * far)
            ok = np.abs(share) <= 1
            angle = np.arctan2(*(x - d).T[::-1])
            own = np.arctan2(*(c - d)[::-1])
            turned = [angle + side * np.arccos(np.clip(share, -1, 1)) - own for side in (1, -1)]
            missed = [(turns - i) ** 2 + ((x + np.pi) % (2 * np.pi) - np.pi - o) ** 2 for x in turned]
            total += np.min(np.where(ok, missed, np.inf))
        return total

    y = best[u["By"]]
    assert best.residual > 1e-3 and squares(y) < min(squares(y - 0.01), squares(y + 0.01))
    assert best[u["Cx"]] == pytest.approx(1.2, abs=1e-9)


# --- what is refused -------------------------------------------------------------------------------
def refused(match, *, unknowns=None, positions=None, conditions=(), mechanism=None, **options):
    model = mbd.library.four_bar(**DRAWN, free=True)
    unknowns = list(model.unknowns.values()) if unknowns is None else unknowns(model)
    positions = [[model.point.position == p] for p in NINE[:5]] if positions is None else positions(model)
    conditions = conditions(model) if callable(conditions) else conditions
    with pytest.raises(mbd.MechanismError, match=match):
        mbd.synthesize(
            mechanism(model) if mechanism else model.mechanism,
            unknowns,
            positions,
            conditions,
            **({"seconds": 2} | options),
        )


def test_arguments_are_checked():
    refused("unknowns= needs a parameter", unknowns=lambda m: [])
    refused("'q' in unknowns= is not among", unknowns=lambda m: [mbd.Parameter("q", 1.0)])
    refused("positions= takes a list of relations", positions=lambda m: [m.point.x == 1])
    refused("position 2: .* is a limit", positions=lambda m: [[m.point.x == 1], [m.point.x <= 2]])
    refused("position 1: .* contains input 'tau'", positions=lambda m: [[m.point.x == m.tau]])
    refused("conditions=: .* it takes parameters", conditions=lambda m: [m.crank.phi == 0])
    refused("contains none of unknowns=", unknowns=joints, conditions=lambda m: [m.unknowns["Px"] == 1])
    refused("the driver 'crank drive'; positions take its place", mechanism=lambda m: m.driven(crank=mbd.t))
    refused("position 2: condition 1 is 2, which is not a relation", positions=lambda m: [[m.point.x == 1], [2]])
    refused("conditions=: condition 1 is 3", conditions=[3])
    refused("position 2 has no relation", positions=lambda m: [[m.point.x == 1], []])
    refused("position 1: .* contains time 't'", positions=lambda m: [[m.point.x == mbd.t]])
    refused("seconds must be positive", seconds=0)
    refused("executor= takes", executor=3)
    refused("symmetries= takes functions", symmetries=1)
    refused("symmetries= must be a function of values, got 1", symmetries=[1])
    refused("symmetries= must be a function of values: too many", symmetries=[lambda: []])
    refused("fails with ZeroDivisionError: .*; for Ax = ", symmetries=[lambda values: 1 / 0])
    refused("exact", exact="no")
    refused("list of dictionaries, got None", symmetries=[lambda values: None])
    refused("returned 'Bx', which is not in unknowns=", symmetries=[lambda values: [{"Bx": 1.0}]])
    closed = ThreadPoolExecutor(1)
    closed.shutdown()
    refused("executor= takes no more work: cannot schedule", executor=closed)


def test_positions_may_come_from_a_generator():
    model = mbd.library.four_bar(**DRAWN, free=True)
    places = ([model.point.position == p] for p in NINE[:2])
    found = mbd.synthesize(model.mechanism, list(model.unknowns.values()), places, seconds=1)
    assert found.search.positions == 2


def test_more_equations_than_unknowns_are_counted():
    pairs = [(0.1 * k, 0.05 * k) for k in range(6)]
    refused(
        "9 conditions on 8 unknowns, 1 too many",
        positions=lambda m: [[m.crank.phi == i, m.rocker.phi == o] for i, o in pairs],
        unknowns=joints,
        conditions=pivots,
    )


def test_conditions_that_contradict_each_other_are_named():
    refused(
        "contradict each other.*: Bx == [12] missed by 0.5, Bx == [12] missed by 0.5",
        conditions=lambda m: [m.unknowns["Bx"] == 1, m.unknowns["Bx"] == 2],
    )


def test_positions_out_of_reach_are_named():
    """The drawn pose is that of the first position; a short arm does not reach far."""
    refused("position 1: .* is missed by .* in the drawn pose", unknowns=joints)
    model = mbd.library.four_bar(**DRAWN, free=True)
    u = model.unknowns
    far = [[model.point.x == 0.7], [model.point.x == 9.0]]
    short = [*pivots(model), u["Bx"] ** 2 + u["By"] ** 2 <= 1, (u["Px"] - u["Bx"]) ** 2 + (u["Py"] - u["By"]) ** 2 <= 1]
    with pytest.raises(mbd.ModelError, match=r"position 2 is out of reach, whatever the others: .*missed by"):
        mbd.synthesize(model.mechanism, list(u.values()), far, short, seconds=2)
