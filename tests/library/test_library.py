"""The ready mechanisms: degrees of freedom, closed forms of their motion, energy, refusals."""

import numpy as np
import pytest

import mbdcasadi as mbd

LIBRARY = mbd.library
PROGRAM = mbd.MotionProgram(mbd.rise(2.0, 0.01), mbd.dwell(1.0), mbd.fall(2 * np.pi - 3.0))

#: How each is made, its degrees of freedom, and courses that drive it.
MODELS = {
    "four-bar": (LIBRARY.four_bar, 1, {"crank": 0.5 + 3 * mbd.t}),
    "crossed four-bar": (lambda: LIBRARY.four_bar(open=False), 1, {"crank": 0.5 + 3 * mbd.t}),
    "five-bar": (LIBRARY.five_bar, 2, {"left": 2.0 + 0.3 * mbd.t, "right": 1.1 - 0.2 * mbd.t}),
    "slider-crank": (LIBRARY.slider_crank, 1, {"crank": 5 * mbd.t}),
    "offset slider-crank": (lambda: LIBRARY.slider_crank(offset=0.02), 1, {"crank": 5 * mbd.t}),
    "quick-return": (LIBRARY.quick_return, 1, {"crank": 5 * mbd.t}),
    "Scotch yoke": (LIBRARY.scotch_yoke, 1, {"crank": 1 + 8 * mbd.t}),
    "Jansen": (LIBRARY.jansen, 1, {"crank": 6 * mbd.t}),
    "planetary": (LIBRARY.planetary_gear, 2, {"sun": 10 * mbd.t, "ring": 0 * mbd.t}),
    "flat follower": (lambda: LIBRARY.cam_follower(PROGRAM), 1, {"cam": 5 * mbd.t}),
    "roller follower": (lambda: LIBRARY.cam_follower(PROGRAM, 0.04, 0.01, 0.005), 1, {"cam": 5 * mbd.t}),
    "roller with spring": (
        lambda: LIBRARY.cam_follower(PROGRAM, 0.04, 0.01, stiffness=3000, preload=80),
        1,
        {"cam": 5 * mbd.t},
    ),
    "cam by its outline": (
        lambda: LIBRARY.cam_follower(outline=mbd.CamOutline(lambda x: 0.04 - 0.004 * mbd.sin(x + 1))),
        1,
        {"cam": 5 * mbd.t},
    ),
    "roller on an outline": (
        lambda: LIBRARY.cam_follower(
            outline=mbd.CamOutline(lambda x: 0.04 - 0.004 * mbd.sin(x + 1)), roller_radius=0.01, offset=0.004
        ),
        1,
        {"cam": 5 * mbd.t},
    ),
    "pendulum chain": (lambda: LIBRARY.pendulum_chain(3, angles=0.4), 3, {f"angle_{k}": mbd.t for k in (1, 2, 3)}),
}


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*contact force is negative")
@pytest.mark.parametrize("name", MODELS)
def test_each_is_consistent_driven_and_free(name):
    """Degrees of freedom, estimates that already close, drivers on natural coordinates, energy in free motion."""
    make, free, courses = MODELS[name]
    model = make()
    report = mbd.check(model.mechanism)
    assert report.degrees_of_freedom == free and report.redundant_rows == 0 and report.ok
    state = mbd.assemble(model.mechanism)
    assert np.max(np.abs(state.q - mbd.equations(model.mechanism).estimate[0])) < 1e-7
    run = mbd.inverse_dynamics(model.driven(**courses), np.linspace(0, 0.4, 21))
    assert run.drift.position < 1e-14
    power = sum(run[d.effort * mbd.time_derivative(d.expression)] for d in run.mechanism.drivers)
    kinetic = run[mbd.time_derivative(mbd.equations(run.mechanism).kinetic)]
    stored = run[mbd.time_derivative(mbd.equations(run.mechanism).potential)]
    np.testing.assert_allclose(power, kinetic + stored, atol=1e-9 * (1 + np.max(np.abs(power))))
    motion = mbd.simulate(model.mechanism, duration=0.3)
    assert np.ptp(motion.energy.total) < 1e-6
    if free == 1:  # the input takes the place of the driver
        found = mbd.inverse_dynamics(model.mechanism, motion=run, efforts=[model.tau])
        np.testing.assert_allclose(found[model.tau], run[run.mechanism.drivers[0].effort], atol=1e-9, rtol=1e-9)


def test_preload_of_a_follower():
    """The contact carries weight and preload at the start, k times the lift more later (at a crawl)."""
    model = LIBRARY.cam_follower(PROGRAM, stiffness=3000, preload=80, masses=(1.0, 0.5))
    run = mbd.inverse_dynamics(model.driven(cam=1e-3 * mbd.t), np.linspace(0, 6000, 121))
    lift = run[model.follower.y] - run[model.follower.y][0]
    np.testing.assert_allclose(run[model.contact.normal_force], 0.5 * 9.81 + 80 + 3000 * lift, atol=1e-6)
    constant = LIBRARY.cam_follower(PROGRAM, preload=80, masses=(1.0, 0.5))
    state = mbd.assemble(constant.mechanism)
    assert state[constant.spring.force] == pytest.approx(-80)


def test_scotch_yoke_in_closed_form():
    """x = r cos θ and its rates; the slot carries the inertia force; torque m r² ω² sin θ cos θ."""
    yoke = LIBRARY.scotch_yoke(0.12, masses=(1.0, 2.5), gravity=None)
    run = mbd.inverse_dynamics(yoke.driven(crank=1 + 8 * mbd.t), np.linspace(0, 2, 101))
    theta = 1 + 8 * run.t
    np.testing.assert_allclose(run[yoke.yoke.x], 0.12 * np.cos(theta), atol=1e-14)
    np.testing.assert_allclose(run[yoke.yoke.vx], -0.96 * np.sin(theta), atol=1e-13)
    np.testing.assert_allclose(run[yoke.yoke.ax], -7.68 * np.cos(theta), atol=1e-12)
    np.testing.assert_allclose(run[yoke.slot.reaction_on(yoke.yoke).force][:, 0], -19.2 * np.cos(theta), atol=1e-11)
    effort = run[run.mechanism.drivers[0].effort]
    np.testing.assert_allclose(effort, 2.5 * 0.12**2 * 64 * np.sin(theta) * np.cos(theta), atol=1e-10)


def test_quick_return_in_closed_form():
    """ψ = atan2(r sin θ + d, r cos θ) with rate and acceleration; the strokes take (π ± 2 asin r/d) / ω."""
    model = LIBRARY.quick_return(0.1, 0.25)
    run = mbd.kinematics(model.driven(crank=0.3 + 5 * mbd.t), np.linspace(0, 1.2, 121))
    z = 0.1 * np.exp(1j * (0.3 + 5 * run.t)) + 0.25j
    dz, ddz = 5j * (z - 0.25j), -25 * (z - 0.25j)
    np.testing.assert_allclose(run[model.arm.phi], np.angle(z), atol=1e-13)
    np.testing.assert_allclose(run[model.coordinates["block"]], np.abs(z), atol=1e-13)
    rate = np.imag(dz / z)
    np.testing.assert_allclose(run[model.arm.omega], rate, atol=1e-12)
    np.testing.assert_allclose(run[model.arm.alpha], np.imag(ddz / z - (dz / z) ** 2), atol=1e-10)
    ends = [mbd.assemble(model.mechanism, [model.main.angle == x]) for x in (np.arcsin(-0.4), np.pi - np.arcsin(-0.4))]
    reach = [state[model.arm.phi] for state in ends]
    np.testing.assert_allclose(reach, [np.arccos(0.4), np.pi - np.arccos(0.4)], atol=1e-9)


def test_slider_crank_and_four_bar_in_closed_form():
    """Slider by the root, rocker by Freudenstein's equation."""
    engine = LIBRARY.slider_crank(0.05, 0.15, offset=0.02)
    run = mbd.kinematics(engine.driven(crank=0.3 + 5 * mbd.t), np.linspace(0, 1.2, 61))
    theta = 0.3 + 5 * run.t
    x = 0.05 * np.cos(theta) + np.sqrt(0.15**2 - (0.02 - 0.05 * np.sin(theta)) ** 2)
    np.testing.assert_allclose(run[engine.slider.x], x, atol=1e-14)
    linkage = LIBRARY.four_bar(0.2, 0.5, 0.4, 0.55)
    run = mbd.kinematics(linkage.driven(crank=0.5 + 3 * mbd.t), np.linspace(0, 2, 61))
    a, b, c, d = 0.2, 0.5, 0.4, 0.55
    k = d / a, d / c, (a**2 - b**2 + c**2 + d**2) / (2 * a * c)
    theta, psi = run[linkage.crank.phi], run[linkage.rocker.phi]
    np.testing.assert_allclose(k[0] * np.cos(psi) - k[1] * np.cos(theta) + k[2], np.cos(theta - psi), atol=1e-12)


@pytest.mark.slow
def test_jansen_leg_over_ten_turns():
    """Eleven bars, driven by a motor for more than ten turns: |Phi| ≤ 1e-12 at every output; a flat step."""
    leg = LIBRARY.jansen()
    assert len(leg.mechanism.bodies) == 11
    motor = {leg.tau: 5 * (2 * np.pi - leg.m.omega)}
    initial = [leg.m.phi == 0, leg.m.omega == 2 * np.pi]
    run = mbd.simulate(leg.mechanism, np.linspace(0, 10.5, 2101), initial=initial, inputs=motor)
    assert run[leg.main.angle][-1] > 10 * 2 * np.pi
    assert run.drift.position <= 1e-12 and run.drift.velocity <= 1e-11
    work = mbd.simulate(leg.mechanism, duration=1.0, initial=initial)  # without the motor
    assert np.ptp(work.energy.total) < 1e-5
    driven = mbd.kinematics(leg.driven(crank=2 * np.pi * mbd.t), np.linspace(0, 1, 361))
    foot = driven[leg.foot.position]
    # the foot stays within 2 % of the stride's length over most of its step on the ground
    stride = np.ptp(foot[:, 0])
    low = foot[foot[:, 1] < foot[:, 1].min() + 0.02 * stride]
    assert np.ptp(low[:, 0]) > 0.6 * stride
    np.testing.assert_allclose(foot[0], foot[-1], atol=1e-12)


def test_names_of_parts():
    """A part that is not there is reported with those that are; a wrong coordinate too."""
    model = LIBRARY.four_bar()
    assert "coordinates crank, rocker" in repr(model)
    with pytest.raises(AttributeError, match="no part 'slider'; it has mechanism, coordinates, crank"):
        _ = model.slider
    with pytest.raises(mbd.ModelError, match="no coordinate coupler; there are crank, rocker"):
        model.driven(coupler=mbd.t)


@pytest.mark.parametrize(
    "make,said",
    [
        (lambda: LIBRARY.four_bar(crank=-1), "four_bar: crank must be positive"),
        (lambda: LIBRARY.four_bar(base=2.0), "four_bar: bars of 0.5 m and 0.4 m do not meet between points"),
        (lambda: LIBRARY.four_bar(masses=(1, 2)), "four_bar: masses takes one number or 3, got 2"),
        (lambda: LIBRARY.slider_crank(offset=1.0), "slider_crank: the rod of 0.15 m does not reach .* 1 m high"),
        (lambda: LIBRARY.four_bar(open="x"), "four_bar: open must be True or False, got 'x'"),
        (lambda: LIBRARY.four_bar(point=3), "four_bar: point must be two numbers, got 3"),
        (lambda: LIBRARY.four_bar(crank=mbd.Parameter("r", 0.2)), r"crank must be a number, got Parameter\('r'\)"),
        (lambda: LIBRARY.five_bar(angles=3), "five_bar: angles must be two numbers, got 3"),
        (lambda: LIBRARY.five_bar(angles=(1,)), "five_bar: angles must be two numbers"),
        (lambda: LIBRARY.planetary_gear(planets="x"), "planetary_gear: planets must be a whole number of at least 1"),
        (lambda: LIBRARY.pendulum_chain(np.nan), "pendulum_chain: links must be a whole number"),
        (lambda: LIBRARY.cam_follower(PROGRAM, offset=0.01), "cam_follower: the offset 0.01 m belongs to a roller"),
        (lambda: LIBRARY.quick_return(crank=0.3), "quick_return: the distance 0.25 m must be longer"),
        (lambda: LIBRARY.planetary_gear(planets=0), "planetary_gear: planets must be a whole number"),
        (lambda: LIBRARY.pendulum_chain(0), "pendulum_chain: links must be a whole number"),
        (lambda: LIBRARY.pendulum_chain(2, angles=[1, 2, 3]), "pendulum_chain: angles takes one number or 2"),
        (lambda: LIBRARY.cam_follower(), "cam_follower: give either a program or an outline"),
        (lambda: LIBRARY.cam_follower(PROGRAM, base_radius=0.0), "cam_follower: base_radius must be positive"),
        (lambda: LIBRARY.jansen(scale=0), "jansen: scale must be positive"),
    ],
)
def test_mechanisms_that_cannot_be_made(make, said):
    """Named with the quantity and its value."""
    with pytest.raises(mbd.ModelError, match=said):
        make()


@pytest.mark.filterwarnings("ignore:assembly")  # the curve of a cognate is on any of its branches
def test_a_free_four_bar_is_the_four_bar_with_its_cognates():
    """The same curve by the drawn linkage and by Roberts' cognates, whose couplers turn with other cranks."""
    given = dict(crank=0.3, coupler=1.0, rocker=0.8, base=1.1, angle=0.7, point=(0.1, 0.3), gravity=None)
    free, plain = mbd.library.four_bar(**given, free=True), mbd.library.four_bar(**given)
    times = np.linspace(0, 1, 41)
    curve = mbd.kinematics(plain.driven(crank=0.7 + 2 * np.pi * mbd.t), times)[plain.point.position]
    assert np.allclose(mbd.kinematics(free.driven(crank=2 * np.pi * mbd.t), times)[free.point.position], curve)
    own = {p: p.value for p in free.unknowns.values()}
    for image in free.cognates(own):
        other = free.mechanism.replace(values=image)
        for place in curve[:4]:
            state = mbd.assemble(other, [free.point.x == place[0], free.point.y == place[1]])
            assert state[free.point.position] == pytest.approx(place, abs=1e-8)
        back = free.cognates(image)
        assert any(np.isclose(one[free.unknowns["Bx"]], own[free.unknowns["Cx"]]) or
                   np.isclose(one[free.unknowns["Bx"]], own[free.unknowns["Bx"]]) for one in back)  # fmt: skip


def test_a_free_slider_crank_is_the_slider_crank():
    """The same displacements over the angle of the crank, on a guide of any angle; masses."""
    given = dict(crank=0.4, rod=1.3, offset=0.1, angle=0.3)
    free, plain = mbd.library.slider_crank(**given, free=True), mbd.library.slider_crank(**given)
    times = np.linspace(0, 1, 21)
    way, reference = (
        mbd.kinematics(model.driven(crank=start + 2 * np.pi * mbd.t), times)[model.coordinates["slider"]]
        for model, start in ((free, 0.0), (plain, 0.3))
    )
    assert np.allclose(way - way[0], reference - reference[0]) and np.ptp(way) > 0.7
    turned = free.mechanism.replace(values={free.unknowns["slider_angle"]: 0.2})
    motion = mbd.kinematics(turned.replace(drivers=[mbd.Driver("turn", free.crank.phi, mbd.t)]), [0, 0.5, 1.0])
    moved = np.diff(np.column_stack([motion[free.slider.x], motion[free.slider.y]]), axis=0)
    assert np.allclose(np.arctan(moved[:, 1] / moved[:, 0]), 0.2) and np.allclose(motion[free.slider.phi], 0)
    assert motion[free.slider.mass][0] == 2.0 and motion[free.crank.mass][0] == pytest.approx(0.4 * 0.12)
    for match, options in (
        ("has 'x', which is not among", {"x": 0}),
        ("angle of the guide of b must", {"b": "no"}),
        ("guides= takes a dictionary, got", ["b"]),
    ):
        with pytest.raises(mbd.ModelError, match=match):
            mbd.library.free_linkage({"A": (0, 0), "B": (1, 0)}, {"ground": "A", "b": "AB"}, guides=options)
    with pytest.raises(mbd.ModelError, match="masses must not be negative"):
        mbd.library.slider_crank(masses=(1, -1, 1), free=True)


def test_a_free_linkage_is_pinned_where_bodies_have_points_in_common():
    """Stephenson's six-bar: one degree of freedom, masses of bars, markers at points of one body; bad input."""
    places = {"A": (0, 0), "D": (1.1, 0), "B": (0.1, 0.35), "C": (1.2, 0.95), "E": (0.6, 1.1), "F": (1.4, 1.6)}
    places |= {"G": (1.9, 0.4), "P": (0.9, 1.7)}
    bodies = {"ground": "ADG", "crank": "AB", "coupler": "BCE", "rocker": "DC", "link": "EFP", "output": "GF"}
    model = mbd.library.free_linkage(places, bodies, masses=2.0)
    assert mbd.check(model.mechanism).degrees_of_freedom == 1 and len(model.mechanism.joints) == 7
    state = mbd.assemble(model.mechanism)
    assert state[model.P.position] == pytest.approx(places["P"]) and state[model.E.a.position] == pytest.approx(
        places["E"]
    )
    b, c, e = (np.array(places[name]) for name in "BCE")
    sides = [(b, c), (c, e), (e, b)]
    mass = sum(2.0 * np.hypot(*(y - x)) for x, y in sides)
    center = sum(np.hypot(*(y - x)) * (x + y) / 2 for x, y in sides) * 2.0 / mass
    assert state[model.coupler.mass] == pytest.approx(mass) and state[model.coupler.position] == pytest.approx(center)
    grid = np.linspace(0, 1, 2001)
    points = [x + s * (y - x) for x, y in sides for s in (grid[1:] + grid[:-1]) / 2]
    weights = [2.0 * np.hypot(*(y - x)) / 2000 for x, y in sides for _ in range(2000)]
    inertia = np.sum(weights * np.sum((np.array(points) - center) ** 2, axis=1))
    assert state[model.coupler.inertia] == pytest.approx(inertia, rel=1e-5)
    for wrong, match in (
        (bodies | {"output": "GX"}, "output has the point 'X', which is not among points"),
        ({"ground": "AD", "crank": "AB"}, "point 'C' belongs to no body"),
        ({name: given for name, given in bodies.items() if name != "ground"}, "no body is pinned to the ground"),
        (bodies | {"output": "GFG"}, "output has the point 'G' twice"),
        (bodies | {"output": 3}, "output takes a sequence of names of points, got 3"),
        (list(bodies), "bodies takes a dictionary, got"),
    ):
        with pytest.raises(mbd.ModelError, match=match):
            mbd.library.free_linkage(places, wrong)


@pytest.mark.parametrize(
    "make, kind, ternary",
    [
        (mbd.library.watt, 1, "BCE DCG"), (mbd.library.watt, 2, "ADG DCE"), (mbd.library.stephenson, 1, "ABE DCG"),
        (mbd.library.stephenson, 2, "BEF DCG"), (mbd.library.stephenson, 3, "ADG BCE"),
    ],
)  # fmt: skip
def test_six_bars_turn_by_their_cranks(make, kind, ternary):
    """Seven pins, one degree of freedom; Watt's bodies of three pins share one, Stephenson's none; masses by length."""
    model = make(kind, masses=2.0)
    joints = model.mechanism.joints
    assert len(joints) == 7 and mbd.check(model.mechanism).degrees_of_freedom == 1
    pins = {}
    for joint in joints:
        for marker in joint.markers:
            pins.setdefault(marker.body.name, set()).add(joint.name)
    assert sorted("".join(sorted(names)) for names in pins.values() if len(names) == 3) == sorted(
        "".join(sorted(names)) for names in ternary.split()
    )
    first, second = (set(names) for names in ternary.split())
    assert len(first & second) == (make is mbd.library.watt)
    path = mbd.kinematics(model.driven(crank=2 * np.pi * mbd.t), np.linspace(0, 1, 61))[model.point.position]
    assert np.allclose(path[0], path[-1], atol=1e-7) and np.max(np.ptp(path, axis=0)) > 0.2
    length = np.hypot(*(model.unknowns[name].value for name in ("Bx", "By")))
    assert mbd.assemble(model.mechanism)[model.crank.mass] >= 2.0 * length * (1 - 1e-9)
    assert len(model.unknowns) == 16 and model.point.body is model.link
    other = make(kind, {"P": (0.5, 0.6)}, point_on="coupler")
    assert other.point.body is other.coupler and other.unknowns["Py"].value == 0.6
    for match, wrong in (
        ("kind must be a whole number", {"kind": 4}),
        ("point_on must be one of", {"point_on": "bar"}),
    ):
        with pytest.raises(mbd.ModelError, match=match):
            make(**wrong)


def test_a_free_five_bar_is_the_five_bar():
    """The same tip over both angles; two torques, and masses of bars."""
    free, plain = mbd.library.five_bar(free=True, masses=3.0), mbd.library.five_bar()
    times = np.linspace(0, 0.4, 5)
    tips = [
        mbd.kinematics(model.driven(left=start[0] + mbd.t, right=start[1] - mbd.t), times)[model.tip.position]
        for model, start in ((free, (0.0, 0.0)), (plain, (2.0, 1.1)))
    ]
    assert np.allclose(*tips) and np.max(np.ptp(tips[0], axis=0)) > 0.05
    assert free.mechanism.inputs == (free.tau_left, free.tau_right) and len(free.unknowns) == 10
    assert mbd.assemble(free.mechanism)[free.left_link.mass] == pytest.approx(0.9)
    with pytest.raises(mbd.ModelError, match="motors= has 'x', which is not among the moving bodies"):
        mbd.library.free_linkage({"A": (0, 0), "B": (1, 0)}, {"ground": "A", "b": "AB"}, motors={"tau": "x"})
