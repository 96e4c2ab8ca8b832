"""Drawings: symbols sit where the state says, every element has one, and bad input is named."""

import itertools
import subprocess
import sys

import casadi as ca
import matplotlib
import numpy as np
import pictured
import pytest
from machines import MACHINES

import mbdcasadi as mbd
from mbdcasadi.visual.drawing import lines
from mbdcasadi.visual.drawing.compose import Options, compose
from mbdcasadi.visual.drawing.draw import nice, subject
from mbdcasadi.visual.drawing.loads import Load
from mbdcasadi.visual.drawing.sample import Sample
from mbdcasadi.visual.drawing.scene import BODY, PIN, placed

MODELS = {
    "four_bar": mbd.library.four_bar,
    "five_bar": mbd.library.five_bar,
    "slider_crank": mbd.library.slider_crank,
    "quick_return": mbd.library.quick_return,
    "scotch_yoke": mbd.library.scotch_yoke,
    "jansen": mbd.library.jansen,
    "planetary_gear": lambda: mbd.library.planetary_gear(planets=3),
    "pendulum_chain": lambda: mbd.library.pendulum_chain(4),
}


def scene_of(source, **options):
    """Scene of a source, with its poses (n_t, frames, 4)."""
    sample = Sample(subject(source))
    scene, scale = compose(sample, Options(**options))
    return scene, scene.poses(sample), scale


def of_item(scene, name):
    """Marks that belong to a body or an element."""
    return [m for m in scene.marks if m.item is not None and scene.items[m.item].name == name]


def where(mark, poses, k=0):
    """Points of the first loop of a mark in the global frame."""
    return placed(mark.loops[0], poses[k, mark.frame])


# --- symbols against the state --------------------------------------------------------------
def test_pins_are_drawn_where_the_markers_are():
    """The centre of the circle of each pin, over a motion."""
    model = mbd.library.four_bar()
    motion = mbd.kinematics(model.driven(crank=2 * mbd.t), np.linspace(0, 3, 31))
    scene, poses, _ = scene_of(motion)
    for name in "ABCD":
        (circle,) = (m for m in of_item(scene, name) if m.layer == PIN)
        expected = motion[model.mechanism.joint(name).a.position]
        for k in (0, 17, 30):
            np.testing.assert_allclose(where(circle, poses, k).mean(axis=0), expected[k], atol=1e-12)


def test_bodies_cover_their_markers_and_turn_with_them():
    """The outline of a link without a shape reaches from pin to pin."""
    crank = mbd.Body("crank", 1, 1, pose=(0.5, 0, 0))
    rod = mbd.Body("rod", 1, 1, pose=(1, 1, np.pi / 2))
    joints = [
        mbd.Revolute("A", mbd.ground.at(0, 0), crank.at(-0.5, 0)),
        mbd.Revolute("B", crank.at(0.5, 0), rod.at(-1, 0)),
    ]
    joints.append(mbd.Translational("C", mbd.ground.at(0, 2), rod.at(1, 0, -np.pi / 2)))
    state = mbd.assemble(mbd.Mechanism([crank, rod], joints))
    scene, poses, _ = scene_of(state)
    (outline,) = (m for m in of_item(scene, "crank") if m.layer == BODY)
    low, high = where(outline, poses).min(axis=0), where(outline, poses).max(axis=0)
    np.testing.assert_allclose((low + high) / 2, state[crank.position], atol=1e-9)
    assert high[0] - low[0] == pytest.approx(1 + high[1] - low[1])  # round ends about both pins
    plate = next(m for m in of_item(scene, "rod") if m.layer == BODY)
    assert np.ptp(where(plate, poses)[:, 1]) > 2 > np.ptp(where(plate, poses)[:, 0])


def test_shapes_are_drawn_in_their_own_frame():
    """A polygon whose centroid is not its origin, with a hole."""
    shape = mbd.Polygon([(0, 0), (3, 0), (3, 1), (0, 1)]) - mbd.Disc(0.2, center=(2, 0.5))
    plate = mbd.Body.from_shape("plate", shape, density=1.0, pose=(10, 0, np.pi / 2))
    scene, poses, _ = scene_of(mbd.Mechanism([plate], [mbd.Revolute("A", mbd.ground.at(10, 0), plate.at(0, 0))]))
    (mark,) = (m for m in of_item(scene, "plate") if m.layer == BODY)
    corners = placed(mark.loops[0], poses[0, mark.frame])
    np.testing.assert_allclose(sorted(map(tuple, corners.round(9))), [(9, 0), (9, 3), (10, 0), (10, 3)], atol=1e-8)
    hole = placed(mark.loops[1], poses[0, mark.frame])
    np.testing.assert_allclose(hole.mean(axis=0), [9.5, 2], atol=1e-9)


def test_springs_reach_from_end_to_end():
    """Over a motion in which the length changes."""
    model = MACHINES["DataLaw"]()
    spring = model.mechanism.force("spring")
    motion = mbd.simulate(model.mechanism, np.linspace(0, 0.3, 7), initial=[model.s == 0.03])
    scene, poses, _ = scene_of(motion)
    zigzag = next(m for m in of_item(scene, "spring") if m.style == "spring")
    for k in (0, 3, 6):
        points = where(zigzag, poses, k)
        np.testing.assert_allclose(points[0], motion[spring.a.position][k], atol=1e-12)
        np.testing.assert_allclose(points[-1], motion[spring.b.position][k], atol=1e-12)


def test_teeth_mesh():
    """No tooth of one gear lies in a tooth of the other, at any time of the motion; numbers of teeth go with radii."""
    from matplotlib.path import Path

    for name in ("Gear", "internal Gear", "Gear on a carrier"):
        model = MACHINES[name]()
        drive = mbd.Driver("drive", model.s, model.by * mbd.t)
        motion = mbd.kinematics(model.mechanism.replace(drivers=[drive]), np.linspace(0, 1, 9))
        scene, poses, _ = scene_of(motion)
        wheels = [m for m in of_item(scene, "mesh") if m.closed and m.style in ("body", "ground")]
        assert len(wheels) == 2
        inner, outer = sorted(wheels, key=lambda m: np.ptp(m.loops[0][:, 0]))
        # of a ring the teeth are the hole
        partner = outer.loops[1] if name == "internal Gear" else outer.loops[0]
        gear = inner.loops[0]
        ratio = (len(partner) // 4) / (len(gear) // 4)
        radii = model.mechanism.joint("mesh")
        assert ratio == pytest.approx(
            max(radii.radius_a, radii.radius_b) / min(radii.radius_a, radii.radius_b), rel=0.03
        )
        for k in range(9):
            region = Path(placed(partner, poses[k, outer.frame]))
            inside = region.contains_points(placed(gear, poses[k, inner.frame]))
            assert np.all(inside) if name == "internal Gear" else not np.any(inside), (name, k)


@pytest.mark.slow
@pytest.mark.parametrize("radii", [(0.04, 0.02), (0.03, 0.03), (0.05, 0.015)])
def test_planets_mesh_with_sun_and_ring(radii):
    """All three, over a turn of the arm, with the ring at rest and with the sun at rest."""
    from matplotlib.path import Path

    model = mbd.library.planetary_gear(*radii, planets=3)
    for hold in ("ring", "sun"):
        motion = mbd.kinematics(model.driven(arm=2 * np.pi * mbd.t, **{hold: 0}), np.linspace(0, 1, 9))
        scene, poses, _ = scene_of(motion)
        gears = {m.body: m for m in scene.marks if m.style == "body" and m.closed and len(m.loops[0]) >= 40}
        bodies = [body.name for body in model.mechanism.bodies]
        sun, ring = gears[bodies.index("sun")], gears[bodies.index("ring")]
        for k, number in itertools.product(range(9), (1, 2, 3)):
            planet = gears[bodies.index(f"planet {number}")]
            teeth = where(planet, poses, k)
            assert not Path(where(sun, poses, k)).contains_points(teeth).any()
            assert Path(placed(ring.loops[1], poses[k, ring.frame])).contains_points(teeth).all()


def test_rack_meshes_with_its_pinion():
    """No tooth in another while the rack moves."""
    from matplotlib.path import Path

    model = MACHINES["RackAndPinion"]()
    drive = mbd.Driver("drive", model.s, 0.3 * mbd.t)
    motion = mbd.kinematics(model.mechanism.replace(drivers=[drive]), np.linspace(0, 1, 12))
    scene, poses, _ = scene_of(motion)
    pinion, rack = (m for m in of_item(scene, "mesh") if m.style == "body")
    for k in range(12):
        region = Path(where(rack, poses, k))
        assert not np.any(region.contains_points(where(pinion, poses, k)))


def test_a_cam_touches_its_roller():
    """The outline passes at the roller's radius from its centre, and not nearer."""
    model = mbd.library.cam_follower(outline=mbd.CamOutline(lambda x: 0.05 + 0.01 * mbd.cos(x)), roller_radius=0.01)
    motion = mbd.kinematics(model.driven(cam=2 * mbd.t), np.linspace(0, 3, 13))
    scene, poses, _ = scene_of(motion)
    outline = next(m for m in of_item(scene, "contact") if m.style == "body")
    for k in range(13):
        apart = np.hypot(*(where(outline, poses, k) - motion[model.follower.at(0, 0).position][k]).T)
        assert apart.min() == pytest.approx(0.01, abs=2e-4)


def test_arrows_are_to_scale_and_along_the_force():
    """Applied force and reaction: length times scale is the force."""
    block = mbd.Body("block", 2.0, 0.1)
    hold = mbd.Weld("hold", mbd.ground.at(0, 0), block.at(0, 0))
    push = mbd.Force("push", block.at(0.5, 0), (30, 40))
    state = mbd.assemble(mbd.Mechanism([block], [hold], forces=[push, mbd.Gravity()]))
    scene, poses, scale = scene_of(state, forces=True)
    for name, expected, start in (("push", [30, 40], [0.5, 0]), ("hold", [-30, -40 + 2 * 9.81], [0, 0])):
        head = next(m for m in of_item(scene, name) if m.style in ("force head", "reaction head"))
        tip = where(head, poses)[0]
        np.testing.assert_allclose(scale["N"] * (tip - start), expected, rtol=1e-9)
    couples = [m for m in of_item(scene, "hold") if m.style == "reaction head"]
    assert len(couples) == 2  # the couple -20 N m turns clockwise
    assert poses[0, couples[1].frame, 3] * scale["N m"] == pytest.approx(-0.5 * 40)


@pytest.mark.parametrize("rate", [2.0, -2.0])
def test_arrows_of_drivers_point_the_way_they_go(rate):
    """Curved about the bearing of the crank; straight along the guide of a slider."""
    model = mbd.library.slider_crank()
    crank = mbd.kinematics(model.driven(crank=0.3 + rate * mbd.t), [0, 0.1])
    scene, poses, _ = scene_of(crank)
    (shaft,) = (m for m in of_item(scene, "crank drive") if m.style == "motion")
    x, y = where(shaft, poses).T
    turned = np.unwrap(np.arctan2(y, x))
    assert np.sign(turned[-1] - turned[0]) == np.sign(rate)
    slider = mbd.kinematics(model.driven(slider=0.15 + 0.1 * rate * mbd.t), [0, 0.1])
    scene, poses, _ = scene_of(slider)
    (shaft,) = (m for m in of_item(scene, "slider drive") if m.style == "motion")
    start, end = where(shaft, poses)
    assert np.sign(end[0] - start[0]) == np.sign(rate) and end[1] == pytest.approx(start[1])


@pytest.mark.parametrize("size", [1000.0, 1e-9])
def test_the_size_of_symbols_does_not_depend_on_the_unit_of_length(size):
    """A mechanism a thousand times as large, or of nanometres, gives the same picture."""
    small, large = (mbd.library.four_bar(*(s * x for x in (0.2, 0.5, 0.4, 0.55))) for s in (1.0, size))
    first, second = (scene_of(m)[0] for m in (small, large))
    assert second.unit == pytest.approx(size * first.unit)
    assert [m.style for m in first.marks] == [m.style for m in second.marks]
    for one, other in zip(first.marks, second.marks, strict=True):
        for loop, scaled in zip(one.loops, other.loops, strict=True):
            assert len(loop) == len(scaled)
            assert scaled / size == pytest.approx(loop, abs=1e-3 * first.unit)


# --- every element -----------------------------------------------------------------------------
@pytest.mark.slow
@pytest.mark.parametrize("name", MACHINES)
def test_every_element_is_drawn(name):
    """One pose and a motion, with everything on."""
    model = MACHINES[name]()
    start = mbd.assemble(model.mechanism)
    mbd.draw(start, forces=True, names=True, frames=True, centroids=True).figure.draw_without_rendering()
    motion = mbd.simulate(model.mechanism, np.linspace(0, 0.05, 5), initial=start)
    axes = mbd.draw(motion, poses=2, trace=[model.mechanism.bodies[0]])
    axes.figure.draw_without_rendering()
    assert axes.get_xlabel() == "x, m" and axes.get_aspect() == 1.0


@pytest.mark.slow
@pytest.mark.parametrize("name", MODELS)
def test_the_library_is_drawn_whole(name):
    """Nothing lies outside the axes."""
    model = MODELS[name]()
    axes = mbd.draw(model)
    scene, poses, _ = scene_of(model)
    for mark in scene.marks:
        points = where(mark, poses)
        assert axes.get_xlim()[0] <= points[:, 0].min() and points[:, 0].max() <= axes.get_xlim()[1]
        assert axes.get_ylim()[0] <= points[:, 1].min() and points[:, 1].max() <= axes.get_ylim()[1]


def test_every_class_of_element_has_a_symbol_of_its_own():
    """Or is known to have no place: a new class is not forgotten."""
    from mbdcasadi.model.element import ConstraintElement, Element

    # given by expressions alone, or between markers that a dashed line ties together
    tied = {"Constraint", "NonholonomicConstraint", "RelativeX", "RelativeY", "RelativeAngle",
            "PIController", "FirstOrderLag", "EnergyMeter"}  # fmt: skip
    default = mbd.glyph.dispatch(object)
    bases = (mbd.Element, mbd.ConstraintElement, mbd.Joint)
    public = [c for c in vars(mbd).values() if isinstance(c, type) and issubclass(c, Element) and c not in bases]
    assert len(public) > 40 and any(issubclass(c, ConstraintElement) for c in public)
    assert {c.__name__ for c in public if mbd.glyph.dispatch(c) is default} == tied


def test_elements_of_ones_own():
    """By a method ``glyph``, by a function that is registered, and without either."""

    class Slot(mbd.PointOnLine):
        pass

    class Plain(mbd.Constraint):
        pass

    class Own(mbd.Constraint):
        def glyph(self, pen):
            pen.pin(pen.ground(), 2.0)

    @mbd.glyph.register
    def _(element: Slot, pen):
        pen.dot(pen.on(element.b))

    block = mbd.Body("block", 1, 1)
    for joint, style in (
        (Slot("x", mbd.ground.at(0, 0), block.at(0, 0)), "dot"),
        (Own("x", block.x), "pin"),
        (Plain("x", block.x), None),
    ):
        scene, _, _ = scene_of(mbd.Mechanism([block], [joint]))
        assert [m.style for m in of_item(scene, "x")] == ([style] if style else [])


def test_a_glyph_of_ones_own_brings_loads_and_a_tooltip():
    """All three are registered in one class; a function for the symbol alone keeps the others of the base class."""

    class Magnet(mbd.TSDA):
        pass

    class Coil(Magnet):
        pass

    class MagnetGlyph(mbd.Glyph, of=Magnet):
        def draw(self):
            self.pen.pin(self.pen.on(self.element.b))

        def loads(self):
            return [Load(self.element.b, ca.SX([3, 4]), "force")]

        def tooltip(self):
            return {"gap, m": self.element.length}

    @mbd.glyph.register
    def _(element: Coil, pen):
        pen.dot(pen.on(element.b))

    block = mbd.Body("block", 1, 1, pose=(1, 0, 0))
    for kind, style in ((Magnet, "pin"), (Coil, "dot")):
        pull = kind("x", mbd.ground.at(0, 0), block.at(0, 0), stiffness=1.0)
        scene, poses, scale = scene_of(mbd.Mechanism([block], forces=[pull]), forces=True, tooltips=True)
        symbol, *arrow = of_item(scene, "x")
        assert symbol.style == style and [m.style for m in arrow] == ["force", "force head"]
        np.testing.assert_allclose(scale["N"] * (where(arrow[1], poses)[0] - [1, 0]), [3, 4], rtol=1e-9)
        (item,) = (i for i in scene.items if i.name == "x")
        assert item.kind == kind.__name__ and set(item.tooltip) == {"gap, m"}


# --- what is drawn, and what is not ------------------------------------------------------------
@pytest.mark.slow
def test_sources():
    """States, motions, solutions' motions, mechanisms and library models; axes of one's own."""
    model = mbd.library.slider_crank()
    state = mbd.assemble(model.mechanism)
    motion = mbd.kinematics(model.driven(crank=mbd.t), [0.0, 0.5])
    for source in (model, model.mechanism, state, motion):
        assert len(mbd.draw(source).patches) > 10
    from matplotlib.figure import Figure

    axes = Figure().subplots()
    assert mbd.draw(state, axes) is axes


def test_wrong_input_is_named():
    """Each with what it was."""
    model = mbd.library.slider_crank()
    motion = mbd.kinematics(model.driven(crank=mbd.t), [0.0, 0.5])
    for error, source, options in (
        ("takes a state", "crank", {}),
        ("takes a state", None, {}),
        ("poses= is for motions", model, {"poses": 3}),
        ("whole number", motion, {"poses": 0}),
        ("whole number", motion, {"poses": 2.5}),
        ("True or False", motion, {"forces": 1}),
        ("path of a point", model, {"trace": [model.pin.a]}),
        ("two components", motion, {"trace": [model.crank.phi]}),
        ("two components", motion, {"trace": ["pin"]}),
        ("list of markers", motion, {"trace": 3}),
        ("reactions are not known; take the motion from simulate", motion, {"forces": True}),
    ):
        with pytest.raises(mbd.MechanismError, match=error):
            mbd.draw(source, **options)
    with pytest.raises(mbd.MechanismError, match="stranger"):
        mbd.draw(motion, trace=[mbd.Body("stranger", 1, 1)])


@pytest.mark.slow
def test_global_settings_are_left_alone():
    """Neither rcParams nor the figures of pyplot."""
    before = dict(matplotlib.rcParams)
    mbd.draw(mbd.library.four_bar(), forces=True)
    assert dict(matplotlib.rcParams) == before
    code = "import sys, mbdcasadi as m; m.draw(m.library.four_bar()); sys.exit('matplotlib.pyplot' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


# --- lines -----------------------------------------------------------------------------------------
def test_plates_keep_their_distance():
    """Every corner lies at the radius from the hull of the points, here a segment."""
    corners = lines.plate(np.array([[0, 0], [2, 0]]), 0.5)
    beyond = np.maximum(np.abs(corners[:, 0] - 1) - 1, 0)
    np.testing.assert_allclose(np.hypot(beyond, corners[:, 1]), 0.5, atol=1e-12)


def test_hatching_lies_on_the_right():
    """Of the way from start to end; no strokes where there is no way."""
    strokes = lines.hatching([[0, 0], [1, 0]], 0.1, 0.05)
    assert len(strokes) == 10 and all(s[1, 1] == pytest.approx(-0.05) and s[0, 1] == 0 for s in strokes)
    assert lines.hatching([[1, 1], [1, 1]], 0.1, 0.05) == []


def test_nice_numbers():
    """1, 2 or 5 times a power of ten."""
    assert [nice(x) for x in (1.0, 1.99, 2.0, 4.9, 5.0, 99, 0.037)] == pytest.approx([1, 1, 2, 2, 5, 50, 0.02])


# --- joints and forces that stand in no machine of the list above ------------------------------
def simple_elements():
    """Each between two bodies, or on one, far enough apart to be seen."""
    p = mbd.Body("p", 1.0, 0.1, pose=(0, 0, 0))
    q = mbd.Body("q", 1.0, 0.1, pose=(1.0, 0.3, 0.4))
    ground, law = mbd.ground, mbd.HuntCrossley(1e4)
    a, b, fixed = p.at(0.2, 0), q.at(-0.1, 0), ground.at(0.5, 0.5)
    found = [
        mbd.Revolute("x", p.at(1, 0), q.at(0, -0.3)),
        mbd.Translational("x", a, q.at(0, 0, -0.4)),
        mbd.Translational("x", a, ground.at(0.6, 0)),
        mbd.Weld("x", p.at(1, 0.3), b),
        mbd.Weld("x", ground.at(0, 0), p.at(0, 0)),
        mbd.Distance("x", a, b, 0.7),
        mbd.Distance("x", fixed, b, 0.5),
        mbd.PointOnLine("x", a, b),
        mbd.PointOnLine("x", ground.at(0, 0.3, 0.1), b, 0.05),
        mbd.AbsoluteX("x", b, 0.9),
        mbd.AbsoluteY("x", b, 0.3),
        mbd.AbsoluteAngle("x", b, 0.4),
        mbd.AbsoluteDistance("x", b, (0.5, 1.0), 0.8),
        mbd.RelativeX("x", a, b, 0.7),
        mbd.RelativeY("x", a, b, 0.3),
        mbd.RelativeAngle("x", a, b, 0.4),
        mbd.Constraint("x", q.x - p.y - 1),
        mbd.Belt("x", a, b, 0.1, 0.2, crossed=True),
        mbd.Rolling("x", q.at(0, 0), p.at(0, 0), 0.3),
        mbd.RackAndPinion("x", ground.at(0, 0), q.at(0, 0), 0.3),
    ]
    forces = [
        mbd.Torque("x", q, -2.0, opposite=p),
        mbd.Force("x", a, (1, 2), opposite=q),
        mbd.RSDA("x", a, b, stiffness=1),
        mbd.TSDA("x", a, b, actuator=3),
        mbd.TSDA("x", a, fixed, stiffness=3, damping=1),
        mbd.TSDA("x", a, fixed, damping=1),
        mbd.Rope("x", a, fixed, length=0.3, stiffness=100),
        mbd.HydraulicCylinder("x", a, b, 0.05, 0.02, 0.8, 1e-3, 0.0),
        mbd.Contact("x", mbd.Segment(a, 0.3, 0.05), mbd.Point(b), law),
        mbd.Contact("x", mbd.PolygonEdges(b, [(0, 0), (0.2, 0), (0, 0.2)]), mbd.HalfPlane(p.at(0, 0)), law),
        mbd.RigidContact("x", mbd.Circle(b, 0.1), mbd.HalfPlane(p.at(0, -2))),
        mbd.Contact("x", mbd.Circle(b, 0.1), mbd.HollowCircle(p.at(0.2, 0), 0.5), law),
        mbd.Contact("x", mbd.Circle(b, 0.1), mbd.HollowCircle(ground.at(0.2, 0), 0.5), law),
        mbd.ElasticBelt("x", a, b, 0.1, 0.2, 1e3),
        mbd.Backlash("x", mbd.Gear("x", a, b, 0.3, 0.2), 0.01, law),
    ]
    return [p, q], [(e, True) for e in found] + [(e, False) for e in forces]


BODIES, SIMPLE = simple_elements()


@pytest.mark.slow
@pytest.mark.parametrize("number", range(len(SIMPLE)), ids=lambda k: f"{type(SIMPLE[k][0]).__name__}-{k}")
def test_simple_elements_are_drawn(number):
    """A symbol near the element's bodies, of a reasonable size; the whole figure is drawn."""
    element, is_joint = SIMPLE[number]
    both = [element] if is_joint else []
    model = mbd.Mechanism(BODIES, both, forces=[] if is_joint else [element])
    state = mbd.assemble(model)
    scene, poses, _ = scene_of(state)
    points = np.vstack([where(m, poses) for m in of_item(scene, "x")])
    assert np.all(np.isfinite(points)) and np.all(np.abs(points - [0.5, 0.3]) < 3)
    mbd.draw(state, forces=True, names=True).figure.draw_without_rendering()


def test_springs_between_the_same_points_lie_side_by_side():
    """As far apart as they are wide, and no longer than the way between the points."""
    block = mbd.Body("block", 1, 1, pose=(1, 0, 0))
    ends = mbd.ground.at(0, 0), block.at(0, 0)
    forces = [mbd.TSDA("s", *ends, stiffness=1), mbd.TSDA("d", *ends, damping=1)]
    scene, poses, _ = scene_of(mbd.Mechanism([block], forces=forces))
    heights = [
        np.mean([where(m, poses)[:, 1].mean() for m in of_item(scene, n) if m.style in ("spring", "damper")])
        for n in "sd"
    ]
    assert abs(heights[0] - heights[1]) > 0.7 * scene.unit


def test_two_coordinates_held_are_a_pin_on_a_stand():
    """As models of the course write their pins; with the angle, a block on a rail."""
    body = mbd.Body("body", 1, 1, pose=(0.5, 0, 0))
    corner = body.at(-0.5, 0)
    pinned = mbd.Mechanism([body], [mbd.AbsoluteX("x", corner), mbd.AbsoluteY("y", corner)])
    scene, _, _ = scene_of(pinned)
    styles = [m.style for m in of_item(scene, "x") + of_item(scene, "y")]
    assert styles.count("ground") == 1 and styles.count("pin") == 2  # the stand once; no rollers
    slides = mbd.Mechanism([body], [mbd.AbsoluteY("y", corner), mbd.AbsoluteAngle("a", corner)])
    scene, _, _ = scene_of(slides)
    assert "hatch" in [m.style for m in of_item(scene, "y")] and of_item(scene, "a") == []


# --- names, stops, noise ------------------------------------------------------------------
def rectangles(axes):
    """Boxes of the names as they are drawn, pixels."""
    axes.figure.canvas.draw()
    return {text.get_text(): text.get_window_extent() for text in axes.texts}


@pytest.mark.slow
@pytest.mark.parametrize("model", [mbd.library.four_bar, mbd.library.jansen, mbd.library.planetary_gear])
def test_names_lie_within_the_axes_and_not_on_each_other(model):
    axes = mbd.draw(model(), names=True)
    found = rectangles(axes)
    frame = axes.get_window_extent()
    assert len(found) > 5
    for name, box in found.items():
        assert frame.x0 - 1 <= box.x0 and box.x1 <= frame.x1 + 1, name
        assert frame.y0 - 1 <= box.y0 and box.y1 <= frame.y1 + 1, name
    common = [
        (one, other)
        for one, a in found.items()
        for other, b in found.items()
        if one < other and min(a.x1, b.x1) - max(a.x0, b.x0) > 2 and min(a.y1, b.y1) - max(a.y0, b.y0) > 4
    ]
    assert not common


def test_a_name_stands_beside_a_thin_bar():
    """Not across its edges: no corner of the bar is within the name."""
    bar = mbd.Body.from_shape("bar", mbd.Rectangle(1.0, 0.04), mass=1.0, pose=(0, 0, 1.2))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), bar.at(-0.4, 0))
    axes = mbd.draw(mbd.Mechanism([bar], [pin]), names=True)
    box = rectangles(axes)["bar"]
    (at,) = (text.xy for text in axes.texts if text.get_text() == "bar")
    pixels = np.array([axes.transData.transform(np.add(at, s * np.array([np.cos(1.2), np.sin(1.2)]))) for s in
                       np.linspace(-0.5, 0.5, 200)])  # fmt: skip
    inside = (pixels[:, 0] > box.x0) & (pixels[:, 0] < box.x1) & (pixels[:, 1] > box.y0) & (pixels[:, 1] < box.y1)
    assert not inside.any()


def test_a_stop_stands_where_the_gap_is_closed():
    """Before a block, and beside an arm; a gap between two bodies has no place."""
    block = mbd.Body.from_shape("block", mbd.Rectangle(0.2, 0.1), mass=1.0, pose=(0.3, 0, 0))
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    law = mbd.HuntCrossley(1e4, exponent=1)
    stop = mbd.EndStop("stop", 0.8 - guide.displacement, law)
    scene = scene_of(mbd.Mechanism([block], [guide], forces=[stop]))[0]
    (pad,) = [m for m in of_item(scene, "stop") if m.style == "rubber"]
    assert pad.frame == 0 and pad.loops[0][:, 0].min() == pytest.approx(0.9)  # the front, 0.1 ahead of the middle
    arm = mbd.Body.from_shape("arm", mbd.Rectangle(1.0, 0.1), mass=1.0, pose=(0.5, 0, 0))
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), arm.at(-0.5, 0))
    stop = mbd.EndStop("stop", np.pi / 2 - hinge.angle, law)
    scene = scene_of(mbd.Mechanism([arm], [hinge], forces=[stop]))[0]
    (pad,) = [m for m in of_item(scene, "stop") if m.style == "rubber"]
    corners = pad.loops[0]
    assert corners[:, 0].max() == pytest.approx(-0.05) and corners[:, 1].mean() == pytest.approx(0.5)
    other = mbd.Body("other", 1.0, 1.0, pose=(2, 0, 0))
    between = mbd.EndStop("stop", other.x + 0.1 * other.y - arm.x - 1, law)  # not along a line
    assert not of_item(scene_of(mbd.Mechanism([arm, other], [hinge], forces=[between]))[0], "stop")


def test_couples_of_rounding_noise_are_not_drawn():
    """Pins carry no couple: there is no scale for one."""
    model = mbd.library.four_bar()
    motion = mbd.simulate(model.mechanism, np.linspace(0, 1, 31), initial=[model.crank.omega == 8])
    assert "N m" not in mbd.animate(motion, forces=True).film.scale


# --- what a drawing says at a glance --------------------------------------------------------------
def size_of(mark, pose):
    """Largest extent of a mark, m."""
    return float(np.max(np.ptp(placed(mark.loops[0], pose[mark.frame]), axis=0)))


def test_torques_are_to_scale_and_nothing_at_zero():
    """Half the torque is half the arrow, a negative one turns the other way, and a ring stays at zero."""
    model = mbd.library.pendulum_chain(3)
    first, second, third = model.torques
    scene, poses, scale = scene_of(mbd.assemble(model.mechanism, inputs={first: 2.0, second: -1.0, third: 0.0}))
    arrows = [m for m in scene.marks if m.style == "motion"]
    sizes = sorted(size_of(m, poses[0]) for m in arrows)
    assert len(arrows) == 2 and sizes[1] == pytest.approx(2 * sizes[0])
    assert sizes[1] / 2 == pytest.approx(2.0 / scale["N m"], rel=0.02)
    assert sum(m.style == "drive" for m in scene.marks) == 3
    assert "N m" in {unit for unit in scene.arrow_units}
    turns = [np.sign(poses[0, m.frame, 3]) for m in arrows]
    assert sorted(turns) == [-1, 1]
    still, _, none = scene_of(mbd.assemble(model.mechanism))
    assert not none and not any(m.style == "motion" for m in still.marks)


def test_forty_torques_do_not_bury_a_chain():
    """An arrow is no larger than a link."""
    bodies = [mbd.Body(f"b{k}", mass=1, inertia=0.1, pose=(k + 0.5, 0, 0)) for k in range(40)]
    before = [mbd.ground, *bodies]
    pins = [mbd.Revolute(f"j{k}", before[k].at(0.5 if k else 0, 0), b.at(-0.5, 0)) for k, b in enumerate(bodies)]
    torques = [mbd.Torque(f"t{k}", b, 1.0 + k / 40, opposite=before[k]) for k, b in enumerate(bodies)]
    scene, poses, _ = scene_of(mbd.Mechanism(bodies, pins, forces=torques))
    arrows = [m for m in scene.marks if m.style == "motion"]
    assert len(arrows) == 40 and max(size_of(m, poses[0]) for m in arrows) < 1.2


def test_many_loads_at_one_point_are_drawn_as_their_sum():
    """Up to three of a kind are drawn each for itself; elsewhere on the body nothing is added."""
    wheel = mbd.Body.from_shape("wheel", mbd.Disc(0.3), mass=2)
    hub = mbd.Revolute("hub", mbd.ground.at(0, 0), wheel.at(0, 0))
    other = mbd.Force("other", wheel.at(0, 0.3), (0, 5))
    for number, count in ((3, 3), (40, 1)):
        torques = [mbd.Torque(f"t{k}", wheel, 0.1 * (k - 15)) for k in range(number)]
        pulls = [mbd.Force(f"f{k}", wheel.at(0.3, 0), (1.0, k)) for k in range(number)]
        scene, poses, scale = scene_of(mbd.Mechanism([wheel], joints=[hub], forces=[*torques, *pulls, other]))
        turning, pushing = (
            [poses[0, m.frame] for m in scene.marks if m.style == style] for style in ("motion", "force")
        )
        assert len(turning) == count and len(pushing) == count + 1
        for couple in turning if count == 1 else ():
            assert couple[3] * scale["N m"] == pytest.approx(0.1 * (780 - 40 * 15))
            assert pushing[0][3] * scale["N"] == pytest.approx(np.hypot(40, 780))
        assert pushing[-1][3] * scale["N"] == pytest.approx(5)


def test_the_slot_of_a_scotch_yoke_is_as_long_as_its_stroke():
    """In the first pose already; the slide is held by two guides, one on each side."""
    model = mbd.library.scotch_yoke(crank=0.12)
    scene, poses, _ = scene_of(mbd.assemble(model.mechanism))
    (slot,) = (m for m in of_item(scene, "slot") if m.style == "slot")
    heights = where(slot, poses)[:, 1]
    assert heights.min() < -0.12 and heights.max() > 0.12
    rails = [where(m, poses) for m in of_item(scene, "guide") if m.style == "ground line"]
    x = model.yoke.pose_estimate[0]
    assert len(rails) == 4 and [bool(r[:, 0].max() < x) for r in rails].count(True) == 2


def test_friction_has_a_symbol():
    """A shoe at the pin and at the guide, with the friction in the tooltip."""
    arm, block = mbd.Body("arm", 1, 0.1, pose=(0.5, 0, 0)), mbd.Body("block", 1, 0.1, pose=(0, 1, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), arm.at(-0.5, 0))
    guide = mbd.Translational("guide", mbd.ground.at(0, 1), block.at(0, 0))
    law = mbd.Coulomb(0.2, 1e-3)
    rubs = [mbd.JointFriction("at pin", pin, law, radius=0.02), mbd.JointFriction("at guide", guide, law)]
    scene, poses, _ = scene_of(mbd.assemble(mbd.Mechanism([arm, block], [pin, guide], forces=rubs)), tooltips=True)
    (at_pin,), (at_guide,) = of_item(scene, "at pin"), of_item(scene, "at guide")
    assert np.hypot(*where(at_pin, poses).T).max() < 3 * scene.unit
    assert where(at_guide, poses)[:, 1].min() == pytest.approx(1 - 1.2 * scene.unit)
    labels = {item.name: list(item.tooltip) for item in scene.items}
    assert labels["at pin"] == ["friction, N m"] and labels["at guide"] == ["friction, N"]


@pytest.mark.parametrize(("angle", "above"), [(-np.pi / 2, True), (np.pi / 2, False), (0.0, False)])
def test_a_support_stands_on_the_side_where_its_bar_is_not(angle, above):
    """And lies in front of what it holds."""
    place = 0.5 * np.array([np.cos(angle), np.sin(angle)])
    arm, other = mbd.Body("arm", 1, 0.1, pose=(*place, angle)), mbd.Body("other", 1, 0.1, pose=(0.5, 1.0, 0))
    joints = [
        mbd.Revolute("pin", mbd.ground.at(0, 0), arm.at(-0.5, 0)),
        mbd.Weld("w", mbd.ground.at(0.5, 1), other.at(0, 0)),
    ]
    scene, poses, _ = scene_of(mbd.assemble(mbd.Mechanism([arm, other], joints)))
    (line,) = (m for m in of_item(scene, "pin") if m.style == "ground line")
    assert (where(line, poses)[:, 1].mean() > 0) == above
    assert line.layer > BODY


def boxes_of(axes):
    """Boxes of the names in axes, pixels."""
    axes.figure.draw_without_rendering()
    return {t.get_text(): t.get_window_extent() for t in axes.texts if t.get_text().strip() and t.get_fontsize() > 9}


def test_names_of_a_planetary_gear_are_apart_and_led_to():
    """Each mesh is named where it is, with a line from there if the name is not beside it."""
    model = mbd.library.planetary_gear(planets=3)
    axes = mbd.draw(model.mechanism, names=True)
    boxes = boxes_of(axes)
    assert {f"{gear} mesh {k}" for gear in ("sun", "ring") for k in (1, 2, 3)} <= set(boxes)
    for (one, a), (two, b) in itertools.combinations(boxes.items(), 2):
        common = [min(a.x1, b.x1) - max(a.x0, b.x0), min(a.y1, b.y1) - max(a.y0, b.y0)]
        assert min(common) < 2, (one, two)
    leaders = [t for t in axes.texts if getattr(t, "arrow_patch", None) is not None]
    ends = np.array([t.xy for t in leaders])
    for k in range(3):
        angle = 2 * np.pi * k / 3
        mesh = 0.08 * np.array([np.cos(angle), np.sin(angle)])  # the ring's pitch radius
        box = boxes[f"ring mesh {k + 1}"]
        place = axes.transData.transform(mesh)
        apart = np.hypot(*np.maximum(np.maximum([box.x0, box.y0] - place, place - [box.x1, box.y1]), 0))
        led = np.min(np.hypot(*(ends - mesh).T)) < 1e-9
        assert led or apart < 30, box


def train():
    """Five gears in a row, with a motor."""
    radii = (0.04, 0.12, 0.05, 0.1, 0.03)
    places = np.cumsum([0, *(a + b for a, b in itertools.pairwise(radii))])
    gears = [
        mbd.Body.from_shape(f"gear {k}", mbd.Disc(r), mass=1, pose=(x, 0, 0))
        for k, (r, x) in enumerate(zip(radii, places, strict=True))
    ]
    shafts = [mbd.Revolute(f"shaft {k}", mbd.ground.at(places[k], 0), gear.at(0, 0)) for k, gear in enumerate(gears)]
    meshes = [mbd.Gear(f"mesh {k}", gears[k].at(0, 0), gears[k + 1].at(0, 0), radii[k], radii[k + 1]) for k in range(4)]
    motor = mbd.Torque("motor", gears[0], 2.0)
    return mbd.Mechanism(gears, joints=[*shafts, *meshes], forces=[mbd.Gravity(), motor])


def tower():
    """Bars on top of each other, with long names: high and narrow."""
    bars = [mbd.Body.from_shape(f"bar number {k}", mbd.Rod(1.0), mass=1, pose=(0, k, np.pi / 2)) for k in range(4)]
    before = [mbd.ground.at(0, -0.5), *(bar.at(0.5, 0) for bar in bars)]
    pins = [
        mbd.Revolute(f"pin at the foot of bar number {k}", before[k], bar.at(-0.5, 0)) for k, bar in enumerate(bars)
    ]
    return mbd.Mechanism(bars, joints=pins, forces=[mbd.Gravity(), mbd.Torque("motor", bars[0], 2.0)])


@pytest.mark.parametrize("machine", [train, tower])
@pytest.mark.parametrize("forces", [False, True])
def test_a_drawing_fills_axes_as_wide_as_a_column(machine, forces):
    """Whatever its proportions: names are apart from each other, from the scale of forces and from other numbers."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(3.5, 2.6), layout="constrained")
    axes = mbd.draw(machine(), figure.subplots(), names=True, forces=forces)
    figure.draw_without_rendering()
    texts = [text for text in axes.texts if text.get_text()]
    assert any("(radius)" in text.get_text() for text in texts) and len(texts) > 8
    assert axes.get_window_extent().width > 0.75 * figure.bbox.width
    for one, two in itertools.combinations(texts, 2):
        a, b = one.get_window_extent(), two.get_window_extent()
        common = min(a.x1, b.x1) - max(a.x0, b.x0), min(a.y1, b.y1) - max(a.y0, b.y0)
        assert min(common) < 3, (one.get_text(), two.get_text())
    for axis in (axes.xaxis, axes.yaxis):
        boxes = [label.get_window_extent() for label in axis.get_ticklabels() if label.get_text()]
        for a, b in itertools.pairwise(boxes):
            assert a.x1 < b.x0 or a.y1 < b.y0 or b.y1 < a.y0
    assert all(len(line) <= 22 for text in texts for line in text.get_text().split("\n"))


def driven_lengths():
    """An arm on a pin, and its eye and foot; constraints of their distance as elements and as expressions."""
    arm = mbd.Body.from_shape("arm", mbd.Rectangle(1.2, 0.1), mass=1, pose=(0.5, 0.3, 0.5))
    a, b = mbd.ground.at(0.7, -0.3), arm.at(0.3, 0.02)
    course = 0.9 + 0.1 * mbd.sin(mbd.t)
    return arm, a, b, [
        mbd.Actuator("jack", a, b, course),
        mbd.Driver("jack", mbd.distance(a, b), course),
        mbd.Driver("jack", mbd.sqrt(mbd.sumsqr(b.position - a.position)), course),
        mbd.Distance("jack", a, b, course),
    ]  # fmt: skip


@pytest.mark.parametrize("which", range(4))
def test_a_driven_length_is_a_cylinder_between_its_eyes(which):
    """The barrel keeps its place at one eye, the rod ends on the other, and no arrow floats."""
    arm, a, b, elements = driven_lengths()
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), arm.at(-0.6, 0))
    driver, joints = elements[which], [pin]
    lists = {"drivers": [driver]} if isinstance(driver, mbd.Driver) else {"joints": [pin, driver]}
    motion = mbd.kinematics(mbd.Mechanism([arm], **({"joints": joints} | lists)), np.linspace(0, 3, 7))
    scene, poses, _ = scene_of(motion)
    marks = of_item(scene, "jack")
    assert [m.style for m in marks].count("barrel") == 1 and not any(m.style == "motion head" for m in marks)
    rod = next(m for m in marks if m.style == "motion")
    barrel = next(m for m in marks if m.style == "barrel")
    for k in (0, 3, 6):
        np.testing.assert_allclose(where(rod, poses, k)[-1], motion[b.position][k], atol=1e-9)
        assert np.hypot(*(where(barrel, poses, k)[[0, 3]].mean(axis=0) - motion[a.position][k])) < 0.02


def test_drivers_that_prescribe_no_length_are_arrows():
    """Coordinates, angles, squares of distances and sums have no two eyes."""
    from mbdcasadi.visual.symbols.springs import ends_of

    p, q = mbd.Body("p", 1, 1), mbd.Body("q", 1, 1, pose=(1, 1, 0.3))
    apart = mbd.distance(p, q)
    for expression in (q.x, q.phi, q.x - p.x, apart**2, apart + q.phi, mbd.norm(mbd.ground.at(0, 0).position - q.x)):
        assert ends_of(mbd.Driver("d", expression, mbd.t)) is None


def test_the_effort_of_a_driven_length_acts_at_its_eyes():
    """Along the line between them, not at the centre of mass."""
    arm, _, b, (jack, *_) = driven_lengths()
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), arm.at(-0.6, 0))
    model = mbd.Mechanism([arm], [pin], drivers=[jack], forces=[mbd.Gravity()])
    run = mbd.inverse_dynamics(model, [0.0, 0.1])
    scene, poses, _ = scene_of(run, forces=True)
    (arrow,) = [m for m in of_item(scene, "jack") if m.style == "force"]
    np.testing.assert_allclose(where(arrow, poses)[0], run[b.position][0], atol=1e-9)
    start, end = where(arrow, poses)
    assert (end - start) @ (run[b.position][0] - [0.7, -0.3]) > 0  # it pushes


def test_a_stop_between_two_bodies_hangs_on_one_and_meets_the_other():
    """The pad touches the edge when the gap is closed, moves with its body, and stands beside the springs."""
    model = pictured.suspension()
    body, wheel, stop = model.bodies[1], model.bodies[0], model.forces[-1]
    start = mbd.assemble(model)
    scene, poses, _ = scene_of(start)
    marks = of_item(scene, "bump stop")
    (pad,) = [m for m in marks if m.style == "rubber"]
    arms = [m for m in marks if m.style == "body line"]
    top, edge = where(pad, poses)[:, 1].max(), start[body.y] - 0.1
    assert edge - top == pytest.approx(start[stop.gap], abs=1e-9)
    carrier = scene.items[next(m.item for m in scene.marks if m.body == pad.body and m.layer == BODY)]
    assert pad.body == 0 and carrier.name in (wheel.name, "rail of the wheel") and len(arms) == 2
    springs = [where(m, poses) for name in ("strut", "tyre") for m in of_item(scene, name)]
    assert np.abs(np.vstack(springs)[:, 0]).max() < np.abs(where(pad, poses)[:, 0]).min()


def test_a_pin_beside_the_outline_of_its_body_is_held_by_an_arm():
    """From the outline to the pin; there is none to a pin on the material."""
    block = mbd.Body.from_shape("block", mbd.Rectangle(0.4, 0.4), mass=1, pose=(0, -1, 0))
    for height, count in ((1.0, 1), (0.1, 0)):
        hinge = mbd.Revolute("hinge", mbd.ground.at(0, height - 1), block.at(0, height))
        scene, poses, _ = scene_of(mbd.Mechanism([block], [hinge]))
        arms = [m for m in of_item(scene, "block") if m.style == "body line"]
        assert len(arms) == count
        for arm in arms:
            np.testing.assert_allclose(where(arm, poses), [[0, 0], [0, -0.8]], atol=1e-9)


def test_the_centre_of_mass_of_one_body():
    """Those asked for, and no others."""
    model = mbd.library.four_bar().mechanism
    crank = model.bodies[0]
    counts = []
    for asked in (True, [crank], False):
        axes = mbd.draw(model, centroids=asked)
        plain = mbd.draw(model)
        counts.append(len(axes.patches) - len(plain.patches))
    assert counts == [9, 3, 0]
    with pytest.raises(mbd.MechanismError, match="list of bodies, got 'crank' in it"):
        mbd.draw(model, centroids=["crank"])
    with pytest.raises(mbd.MechanismError, match="centroids= names body 'stranger', which is not in the mechanism"):
        mbd.draw(model, centroids=[mbd.Body("stranger", 1, 1)])
