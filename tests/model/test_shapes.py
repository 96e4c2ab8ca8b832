"""Mass properties and outlines of planar shapes, against closed forms and independent sums."""

import ast
import copy
import pickle
from dataclasses import FrozenInstanceError
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from mbdcasadi.errors import ModelError
from mbdcasadi.model.geometry import shapes
from mbdcasadi.model.geometry.shapes import Composite, Contour, Disc, Polygon, Rectangle, Rod, Shape

L_SHAPE = [(0, 0), (3, 0), (3, 1), (1, 1), (1, 4), (0, 4)]
NOTCH = Polygon([(1.2, 1.2), (1.6, 1.2), (1.4, 1.4)])
EXAMPLES = [
    Rectangle(2.0, 1.0, center=(0.3, -0.4), angle=0.7),
    Disc(0.5, center=(1.0, 2.0)),
    Polygon(L_SHAPE),
    Rod(1.5, center=(0.2, 0.1), angle=-1.1),
    Rod(1.0) + Rod(2.0, center=(0.0, 1.0), angle=0.3),
    Rectangle(4.0, 3.0) + Disc(0.5, center=(3.0, 0.0)) - Disc(1.0) - NOTCH,
]
by_example = pytest.mark.parametrize("shape", EXAMPLES, ids=lambda shape: type(shape).__name__)


def same(shape: Shape, other: Shape, tolerance: float = 1e-12) -> bool:
    """Whether two shapes have the same mass properties at a density of 3."""
    return all(
        np.allclose(one, two, rtol=tolerance, atol=tolerance)
        for one, two in zip(shape.mass_properties(3.0), other.mass_properties(3.0), strict=True)
    )


def fan_sums(points: np.ndarray) -> tuple[float, np.ndarray, float]:
    """Area, centroid and second moment of a polygon, from triangles with signs and their own closed forms.

    A triangle with sides a, b, c has the second moment A (a² + b² + c²)/36 about its centroid.
    """
    triangles = [np.array([points[0], points[i], points[i + 1]]) for i in range(1, len(points) - 1)]
    areas = np.array([np.linalg.det(np.column_stack([t, np.ones(3)])) / 2 for t in triangles])
    centroids = np.array([t.mean(axis=0) for t in triangles])
    own = np.array([np.sum((t - np.roll(t, 1, axis=0)) ** 2) / 36 for t in triangles])
    centroid = areas @ centroids / areas.sum()
    moment = areas @ (own + np.sum((centroids - centroid) ** 2, axis=1))
    return abs(areas.sum()), centroid, abs(moment)


def star_polygon(seed: int) -> np.ndarray:
    """Random polygon without crossing edges, not convex, in either orientation, away from the origin."""
    random = np.random.default_rng(seed)
    angles = np.sort(random.uniform(0, 2 * np.pi, random.integers(7, 30)))
    radii = random.uniform(0.2, 2.0, angles.size)
    points = random.uniform(-5, 5, 2) + radii[:, None] * np.column_stack([np.cos(angles), np.sin(angles)])
    return points[:: random.choice([-1, 1])]


# ---------------------------------------------------------------- closed forms


def test_rectangle():
    mass, centroid, inertia = Rectangle(2.0, 0.5, center=(1.0, -1.0), angle=0.4).mass_properties(density=3.0)
    assert mass == pytest.approx(3.0)
    assert centroid == pytest.approx([1.0, -1.0])
    assert inertia == pytest.approx(3.0 * (2.0**2 + 0.5**2) / 12)


def test_disc():
    mass, centroid, inertia = Disc(0.5, center=(1.0, 2.0)).mass_properties(density=2.0)
    assert mass == pytest.approx(2.0 * np.pi * 0.25)
    assert centroid == pytest.approx([1.0, 2.0])
    assert inertia == pytest.approx(mass * 0.5**2 / 2)


def test_rod_has_mass_by_length():
    rod = Rod(2.0, center=(1.0, 0.0), angle=0.3)
    mass, centroid, inertia = rod.mass_properties(density=1.5)
    assert (rod.area, rod.length, rod.is_line) == (0.0, 2.0, True)
    assert mass == pytest.approx(3.0)
    assert centroid == pytest.approx([1.0, 0.0])
    assert inertia == pytest.approx(3.0 * 2.0**2 / 12)
    assert rod.second_moment == pytest.approx(2.0**3 / 12)


def test_annulus():
    mass, centroid, inertia = (Disc(0.5, (1, 1)) - Disc(0.3, (1, 1))).mass_properties(mass=4.0)
    assert mass == 4.0
    assert centroid == pytest.approx([1.0, 1.0])
    assert inertia == pytest.approx(4.0 * (0.5**2 + 0.3**2) / 2)


def test_trapezium():
    shape = Polygon([(0, -0.1), (0.6, -0.05), (0.6, 0.05), (0, 0.1)])
    a, b, length = 0.2, 0.1, 0.6
    along_x = length**3 * (a**2 + 4 * a * b + b**2) / (36 * (a + b))
    across = length * (a + b) * (a**2 + b**2) / 48
    assert shape.area == pytest.approx(length * (a + b) / 2)
    assert shape.centroid == pytest.approx([length / 3 * (a + 2 * b) / (a + b), 0.0])
    assert shape.second_moment == pytest.approx(along_x + across)


def test_equilateral_triangle():
    corners = [(np.cos(angle), np.sin(angle)) for angle in 2 * np.pi / 3 * np.arange(3)]
    side = np.sqrt(3)
    _, _, inertia = Polygon(corners).mass_properties(mass=1.0)
    assert inertia == pytest.approx(side**2 / 12)


def test_mass_and_density_agree():
    shape = Polygon(L_SHAPE)
    by_density, by_mass = shape.mass_properties(density=2.0), shape.mass_properties(mass=2.0 * shape.area)
    assert by_density[::2] == pytest.approx(by_mass[::2])


def test_massless_shape_has_no_inertia():
    assert Rod(1.0).mass_properties(mass=0)[::2] == (0.0, 0.0)


@by_example
def test_attributes_agree_with_mass_properties(shape):
    mass, centroid, inertia = shape.mass_properties(mass=5.0)
    assert mass == 5.0
    assert centroid.shape == (2,)
    assert np.array_equal(centroid, shape.centroid)
    unit_mass, _, unit_inertia = shape.mass_properties(density=1.0)
    assert unit_inertia == pytest.approx(shape.second_moment)
    assert inertia / mass == pytest.approx(unit_inertia / unit_mass)
    assert shape.area == (0.0 if shape.is_line else pytest.approx(unit_mass))
    assert type(shape.area) is type(shape.second_moment) is type(mass) is type(inertia) is float


# ---------------------------------------------------------------- polygons


def test_rectangle_equals_its_polygon():
    rectangle = Rectangle(2.0, 0.7, center=(0.4, 0.9), angle=1.2)
    assert same(Polygon(rectangle.outlines()[0].points), rectangle)


def test_orientation_does_not_matter():
    assert same(Polygon(L_SHAPE), Polygon(L_SHAPE[::-1]))


def test_first_corner_may_be_repeated_at_the_end():
    assert same(Polygon(L_SHAPE), Polygon([*L_SHAPE, L_SHAPE[0]]))


def test_fine_polygon_converges_to_disc_quadratically():
    def error(corners):
        angles = 2 * np.pi * np.arange(corners) / corners
        polygon = Polygon(np.column_stack([np.cos(angles), np.sin(angles)]))
        return abs(polygon.second_moment - Disc(1.0).second_moment)

    assert error(1000) < 1e-4
    assert error(500) / error(1000) == pytest.approx(4.0, rel=1e-3)


@pytest.mark.parametrize("seed", range(20))
def test_random_polygon_against_triangles(seed):
    points = star_polygon(seed)
    area, centroid, moment = fan_sums(points)
    shape = Polygon(points)
    assert shape.area == pytest.approx(area, rel=1e-12)
    assert shape.centroid == pytest.approx(centroid, rel=1e-12)
    assert shape.second_moment == pytest.approx(moment, rel=1e-12)


def test_polygon_far_from_the_origin_loses_no_digits():
    points = star_polygon(1)
    shift = 2.0**20  # a power of two, with points rounded to match, keeps the shifted corners exact
    points = np.round(points * 2**20) / 2**20
    near, far = Polygon(points), Polygon(points + shift)
    assert far.area == pytest.approx(near.area, rel=1e-13)
    assert far.second_moment == pytest.approx(near.second_moment, rel=1e-13)
    assert far.centroid - shift == pytest.approx(near.centroid, abs=1e-9)


# ---------------------------------------------------------------- sums and differences


def test_sum_of_rectangles_equals_polygon():
    parts = Rectangle(1, 4, center=(0.5, 2)) + Rectangle(2, 1, center=(2, 0.5))
    assert same(parts, Polygon(L_SHAPE))


def test_difference_of_rectangles_equals_polygon():
    assert same(Rectangle(3, 4, center=(1.5, 2)) - Rectangle(2, 3, center=(2, 2.5)), Polygon(L_SHAPE))


def test_parallel_axis_theorem():
    pair = Disc(0.2, center=(-3, 1)) + Disc(0.2, center=(5, 1))
    mass, centroid, inertia = pair.mass_properties(mass=2.0)
    assert centroid == pytest.approx([1.0, 1.0])
    assert inertia == pytest.approx(mass * (0.2**2 / 2 + 4.0**2))


def test_what_is_added_and_cut_out_leaves_the_same():
    plate, hole = Rectangle(4, 3), Disc(0.5, center=(1, 0.3))
    assert same(plate - hole + hole, plate)
    assert same((plate + Disc(1, center=(9, 9))) - Disc(1, center=(9, 9)), plate)


def test_cutting_out_a_ring_leaves_its_inside():
    ring = Disc(1.0, center=(0.5, 0)) - Disc(0.4, center=(0.5, 0))
    left = Rectangle(4, 3) - ring
    assert same(left, Rectangle(4, 3) - Disc(1.0, center=(0.5, 0)) + Disc(0.4, center=(0.5, 0)))
    assert left.area == pytest.approx(12 - ring.area)


def test_nesting_and_order_do_not_matter():
    a, b, c, d = (Disc(radius, center=(3.0 * radius**2, radius)) for radius in (1.0, 2.0, 3.0, 4.0))
    assert same((a + b) + (c + d), d + (c + (b + a)))
    assert same((a + b) - (Disc(0.1) + Disc(0.2, (0, 1))), b - Disc(0.2, (0, 1)) + (a - Disc(0.1)))


def test_angle_of_two_rods():
    angle = Rod(2.0, center=(1, 0)) + Rod(2.0, center=(0, 1), angle=np.pi / 2)
    mass, centroid, inertia = angle.mass_properties(density=1.5)
    assert angle.is_line
    assert angle.area == 0.0
    assert mass == pytest.approx(6.0)
    assert centroid == pytest.approx([0.5, 0.5])
    assert inertia == pytest.approx(2 * 3.0 * (2.0**2 / 12 + 0.5))


def test_many_holes():
    plate = Rectangle(50, 50)
    for i in range(10):
        for j in range(10):
            plate = plate - Disc(0.5, center=(4 * i - 18, 4 * j - 18))
    assert plate.area == pytest.approx(2500 - 100 * np.pi / 4)
    assert plate.centroid == pytest.approx([0, 0], abs=1e-12)
    assert len(plate.outlines()) == 101


# ---------------------------------------------------------------- moved


@by_example
def test_moved_shape_keeps_size_and_takes_its_centroid_along(shape):
    moved = shape.moved(2.0, -3.0, angle=0.8)
    turn = np.array([[np.cos(0.8), -np.sin(0.8)], [np.sin(0.8), np.cos(0.8)]])
    assert type(moved) is type(shape)
    assert moved.area == pytest.approx(shape.area)
    assert moved.second_moment == pytest.approx(shape.second_moment)
    assert moved.centroid == pytest.approx(turn @ shape.centroid + [2.0, -3.0])


@pytest.mark.parametrize("shape", [EXAMPLES[0], EXAMPLES[2], EXAMPLES[3], EXAMPLES[4], Rectangle(4, 3) - NOTCH])
def test_corners_move_with_the_shape(shape):
    turn = np.array([[np.cos(0.8), -np.sin(0.8)], [np.sin(0.8), np.cos(0.8)]])
    moved = shape.moved(2.0, -3.0, angle=0.8)
    for before, after in zip(shape.outlines(), moved.outlines(), strict=True):
        assert after.points == pytest.approx(before.points @ turn.T + [2.0, -3.0])
        assert after.hole == before.hole


def test_moving_there_and_back():
    shape = EXAMPLES[-1]
    assert same(shape.moved(1.0, 2.0).moved(0, 0, angle=0.5).moved(0, 0, angle=-0.5).moved(-1.0, -2.0), shape)


# ---------------------------------------------------------------- outlines


def test_outlines_of_primitive_shapes():
    (rectangle,) = Rectangle(2, 1, center=(1, 0.5)).outlines()
    (disc,) = Disc(2.0, center=(1, 1)).outlines()
    (rod,) = Rod(2.0, center=(1, 0)).outlines()
    (polygon,) = Polygon(L_SHAPE[::-1]).outlines()
    assert isinstance(rectangle, Contour)
    assert rectangle.points == pytest.approx(np.array([(0, 0), (2, 0), (2, 1), (0, 1)]))
    assert np.hypot(*(disc.points - [1, 1]).T) == pytest.approx(2.0)
    assert rod.points == pytest.approx(np.array([(0, 0), (2, 0)]))
    assert polygon.points == pytest.approx(np.array(L_SHAPE))
    assert not any(outline.hole for outline in (rectangle, disc, rod, polygon))


def test_parts_run_counter_clockwise_and_holes_clockwise():
    def signed_area(points):
        x, y = points.T
        return (x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2

    triangle, ring = Polygon([(0.2, 0.2), (0.3, 0.6), (0.6, 0.2)]), Disc(0.4, (2, 0.5)) - Disc(0.1, (2, 0.5))
    outlines = (Polygon(L_SHAPE[::-1]) + Rectangle(1, 1, (-2, 0)) - triangle - ring).outlines()
    assert [outline.hole for outline in outlines] == [False, False, False, True, True]
    assert [bool(signed_area(outline.points) > 0) for outline in outlines] == [True, True, True, False, False]


# ---------------------------------------------------------------- values, not objects


@by_example
def test_shape_is_an_immutable_value(shape):
    assert copy.deepcopy(shape) == shape == pickle.loads(pickle.dumps(shape))
    assert hash(copy.deepcopy(shape)) == hash(shape)
    with pytest.raises(FrozenInstanceError):
        shape.center = (1.0, 1.0)
    shape.centroid[:] = 99.0
    assert not np.any(shape.centroid == 99.0)


@by_example
def test_printed_shape_can_be_read_back(shape):
    names = {"Rectangle": Rectangle, "Disc": Disc, "Polygon": Polygon, "Rod": Rod}
    assert eval(repr(shape), names) == shape


def test_shape_prints_what_it_is():
    assert repr(Disc(0.5)) == "Disc(radius=0.5, center=(0.0, 0.0))"
    assert repr(Rod(2) + Rod(1) + Rod(3)) == f"{Rod(2)} + {Rod(1)} + {Rod(3)}"
    assert repr(Disc(3) - (Disc(2) - Disc(1))) == f"{Disc(3)} + {Disc(1)} - {Disc(2)}"


def test_numpy_numbers_are_kept_as_plain_numbers():
    shape = Rectangle(np.float64(2), np.int64(1), center=np.array([1.0, 2.0]), angle=np.float32(0.5))
    assert repr(shape) == "Rectangle(width=2.0, height=1.0, center=(1.0, 2.0), angle=0.5)"


def test_module_imports_neither_casadi_nor_matplotlib():
    tree = ast.walk(ast.parse(Path(shapes.__file__).read_text(encoding="utf-8")))
    imports = [node for node in tree if isinstance(node, ast.Import | ast.ImportFrom)]
    names = {alias.name for node in imports if isinstance(node, ast.Import) for alias in node.names}
    names |= {node.module for node in imports if isinstance(node, ast.ImportFrom)}
    assert names == {"__future__", "dataclasses", "pathlib", "numpy", "errors", "outline_files"}


# ---------------------------------------------------------------- bad input


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Rectangle(-1.0, 1.0), "Rectangle: width must be positive and finite, got -1.0"),
        (lambda: Rectangle(1, 0), "Rectangle: height must be positive and finite, got 0.0"),
        (lambda: Rectangle(1, 1, angle=np.inf), "Rectangle: angle must be finite, got inf"),
        (lambda: Rectangle(1, 1, center=(0, np.nan)), "Rectangle: y of center must be finite, got nan"),
        (lambda: Rectangle(1, 1, center=3), r"Rectangle: center must be two numbers \(x, y\), got 3"),
        (lambda: Disc(np.inf), "Disc: radius must be positive and finite, got inf"),
        (lambda: Disc("1"), "Disc: radius must be a plain number, got '1'"),
        (lambda: Disc(None), "Disc: radius must be a plain number, got None"),
        (lambda: Disc(ca.SX.sym("r")), r"Disc: radius must be a plain number, got SX\(r\)"),
        (lambda: Disc(1, center=(1, 2, 3)), r"Disc: center must be two numbers \(x, y\), got \(1, 2, 3\)"),
        (lambda: Rod(0.0), "Rod: length must be positive and finite, got 0.0"),
        (lambda: Rod(1.0, angle=np.nan), "Rod: angle must be finite, got nan"),
        (lambda: Polygon([(0, 0), (1, 0)]), r"Polygon: points must be at least 3 pairs \(x, y\), got \[\(0"),
        (lambda: Polygon(5), r"Polygon: points must be at least 3 pairs \(x, y\), got 5"),
        (lambda: Polygon([(0, 0), (1, 0), 7]), r"Polygon: points\[2\] must be two numbers \(x, y\), got 7"),
        (lambda: Polygon([(0, 0), (1, np.inf), (0, 1)]), r"Polygon: y of points\[1\] must be finite, got"),
        (lambda: Polygon([(0, 0), (0.1, 0.3), (0.7, 2.1)]), r"Polygon: area must be positive, got .*e-17 m²"),
        (lambda: Polygon([(0, 0), (1, 1), (1, 0), (0, 1)]), "Polygon: area must be positive, got 0 m²"),
        (lambda: Disc(1).moved(np.nan, 0), "Disc: x of shift must be finite, got nan"),
        (lambda: Disc(1).moved(0, 0, angle="a"), "Disc: angle must be a plain number, got 'a'"),
    ],
)
def test_bad_number_is_named(make, message):
    with pytest.raises(ModelError, match=message):
        make()


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({}, "Disc: give one of density and mass, got density=None, mass=None"),
        ({"density": 1.0, "mass": 2.0}, "Disc: give one of density and mass, got density=1.0, mass=2.0"),
        ({"density": -1}, "Disc: density must be non-negative and finite, got -1.0"),
        ({"mass": np.inf}, "Disc: mass must be non-negative and finite, got inf"),
        ({"mass": "heavy"}, "Disc: mass must be a plain number, got 'heavy'"),
    ],
)
def test_mass_properties_need_one_of_density_and_mass(given, message):
    with pytest.raises(ModelError, match=message):
        Disc(1.0).mass_properties(**given)


@pytest.mark.parametrize(
    "make",
    [
        lambda: Disc(1) - Disc(2),
        lambda: Disc(1) - Disc(1),
        lambda: Rectangle(0.1, 0.3) - Rectangle(0.1, 0.1, (0, 0.1)) - Rectangle(0.1, 0.2, (0, -0.05)),
        lambda: Disc(1) - Disc(0.5, center=(9, 9)),
    ],
    ids=["larger", "equal", "equal but for rounding", "far outside"],
)
def test_hole_that_does_not_fit(make):
    with pytest.raises(ModelError, match=r"Composite: holes must lie inside the parts .* m² cut out of"):
        make()


@pytest.mark.parametrize("make", [lambda: Rectangle(1, 1) + Rod(1), lambda: Rod(1) + Disc(1), lambda: Disc(1) - Rod(1)])
def test_rods_and_areas_do_not_mix(make):
    with pytest.raises(ModelError, match=r"mass by length .* make two bodies and weld them together"):
        make()


def test_nothing_is_cut_out_of_a_rod():
    with pytest.raises(ModelError, match="nothing can be cut out of a rod"):
        Rod(2) - Rod(1)


@pytest.mark.parametrize("make", [lambda: Disc(1) + 3, lambda: Disc(1) - None])
def test_only_shapes_are_joined(make):
    with pytest.raises(ModelError, match=r"Composite: parts and holes must be shapes, got (3|None)"):
        make()


def test_composite_is_what_the_operators_make():
    assert Disc(2) - Disc(1) == Composite((Disc(2),), (Disc(1),))
