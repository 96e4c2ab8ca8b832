"""Shapes from drawings against areas and moments that are known."""

import builtins
import sys

import numpy as np
import pytest

import mbdcasadi as mbd

svgelements = pytest.importorskip("svgelements")
ezdxf = pytest.importorskip("ezdxf")

PLATE = """<svg xmlns="http://www.w3.org/2000/svg" width="200mm" height="100mm" viewBox="0 0 200 100">
  <g transform="translate(10 10)">
    <rect x="0" y="0" width="120" height="60"/>
    <circle cx="30" cy="30" r="10"/>
    <path d="M 70 20 h 30 v 20 h -30 z"/>
    <circle cx="85" cy="30" r="5"/>
  </g>
  <path d="M 0 0 L 5 5"/>
</svg>"""


def close_to(shape, area, centroid, second_moment, rel):
    assert shape.area == pytest.approx(area, rel=rel)
    assert shape.centroid == pytest.approx(centroid, rel=rel)
    assert shape.second_moment == pytest.approx(second_moment, rel=rel)


def plate():
    """The same plate of shapes, in metres, with y up."""
    rectangle = mbd.Rectangle(0.12, 0.06, center=(0.07, -0.04))
    window = mbd.Rectangle(0.03, 0.02, center=(0.095, -0.04)) - mbd.Disc(0.005, center=(0.095, -0.04))
    return rectangle - mbd.Disc(0.01, center=(0.04, -0.04)) - window


def test_an_svg_drawing_with_holes_and_an_island(tmp_path):
    """Sizes on paper, transformations, holes, parts inside holes; open lines do not count."""
    path = tmp_path / "plate.svg"
    path.write_text(PLATE)
    known = plate()
    values = known.area, known.centroid, known.second_moment
    close_to(mbd.Polygon.from_svg(path), *values, 2e-4)
    close_to(mbd.Polygon.from_svg(path, tolerance=1e-7), *values, 5e-6)
    pixel = 0.0254 / 96
    twice = mbd.Polygon.from_svg(path, scale=2 * pixel, tolerance=1e-7)
    close_to(twice, 4 * values[0], 2 * values[1], 16 * values[2], 5e-6)
    body = mbd.Body.from_shape("plate", mbd.Polygon.from_svg(path), mass=2.0)
    assert body.inertia == pytest.approx(known.mass_properties(mass=2.0)[2], rel=2e-4)


def svg(path, content, size='width="100mm" height="100mm" viewBox="0 0 100 100"'):
    path.write_text(f'<svg xmlns="http://www.w3.org/2000/svg" {size}>{content}</svg>')
    return path


@pytest.mark.parametrize(
    ("content", "size", "area", "centroid"),
    [
        # lengths on paper
        ('<rect width="50" height="20"/>', 'width="400Q" height="10cm" viewBox="0 0 100 100"', 1e-3, (0.025, -0.01)),
        ('<rect x="1mm" width="5cm" height="20mm"/>', 'width="100mm" height="100mm"', 1e-3, (0.026, -0.01)),
        ('<rect width="72pt" height="6pc"/>', 'width="4in" height="4in"', 0.0254**2, (0.0127, -0.0127)),
        (
            '<rect width="50" height="20"/>',
            'width="200mm" height="100mm" viewBox="-50 -50 100 100"',
            1e-3,
            (0.125, -0.06),
        ),
        # transformations of what is no path
        ('<g transform="rotate(30 25 10)"><rect width="50" height="20"/></g>', None, 1e-3, (0.025, -0.01)),
        ('<rect width="10" height="10" transform="matrix(2 .3 .5 1.5 3 4)"/>', None, 2.85e-4, (0.0155, -0.013)),
        ('<circle r="10" transform="matrix(2 .3 .5 1.5 50 40)"/>', None, np.pi * 2.85e-4, (0.05, -0.04)),
        ('<ellipse rx="30" ry="10" transform="translate(50 50) rotate(20)"/>', None, np.pi * 3e-4, (0.05, -0.05)),
        # a hole in the same path, and one that touches
        ('<path d="m 0 0 h 50 v 20 h -50 z m 20 5 h 10 v 10 h -10 z"/>', None, 9e-4, (0.025, -0.01)),
        ('<rect width="50" height="20"/><rect width="50" height="10"/>', None, 5e-4, (0.025, -0.015)),
        # side by side
        ('<rect width="50" height="10"/><rect y="10" width="50" height="10"/>', None, 1e-3, (0.025, -0.01)),
        # what is not drawn
        ('<rect width="50" height="20"/><mask><path d="M 0 0 h 90 v 90 z"/></mask>', None, 1e-3, (0.025, -0.01)),
        ('<symbol><path d="M 0 0 h 90 v 90 z"/></symbol><rect width="50" height="20"/>', None, 1e-3, (0.025, -0.01)),
        ('<marker><path d="M 0 0 h 90 v 90 z"/></marker><rect width="50" height="20"/>', None, 1e-3, (0.025, -0.01)),
        # what is filled is closed by that; lines beside it are not
        ('<path d="M 0 0 h 10 v 20 h -10 z M 20 0 h 40 v 20 h -40"/>', None, 1e-3, (0.033, -0.01)),
        ('<polyline points="0,0 50,0 50,20 0,20"/>', None, 1e-3, (0.025, -0.01)),
        (
            '<rect width="50" height="20"/><path fill="none" stroke="red" d="M 60 0 h 10 v 9"/><path d="M -9 5 h 90"/>',
            None,
            1e-3,
            (0.025, -0.01),
        ),
        ('<defs><rect id="a" width="50" height="20"/></defs><use href="#a" x="5"/>', None, 1e-3, (0.03, -0.01)),
    ],
)
def test_units_and_transformations_of_svg(content, size, area, centroid, tmp_path):
    """Areas and centroids by hand: exact for straight outlines, to the tolerance for curves."""
    path = svg(tmp_path / "a.svg", content, *([size] if size else []))
    shape = mbd.Polygon.from_svg(path, tolerance=1e-8)
    assert shape.area == pytest.approx(area, rel=1e-6 if "r=" in content or "rx" in content else 1e-11)
    assert shape.centroid == pytest.approx(centroid, abs=1e-12)


@pytest.mark.parametrize(
    ("circle", "is_seen"),
    [
        ('display="none"', False),
        ('visibility="hidden"', False),
        ('style="visibility:collapse"', False),
        ('opacity="0"', False),
        ('class="unseen"', False),
        ('fill="none"', False),
        ('fill="none" stroke="red" stroke-opacity="0"', False),
        ('fill="none" stroke="red"', True),
        ('fill-opacity="0" stroke="red"', True),
        ('visibility="visible"', True),
    ],
)
def test_shapes_of_svg_that_are_not_seen(circle, is_seen, tmp_path):
    """A hole counts if it is drawn: by attribute, style or class, and in a group that is hidden if it shows itself."""
    style = "<style>.unseen{visibility:hidden}</style>"
    hole = f'<circle cx="25" cy="10" r="5" {circle}/>'
    group = f'<g visibility="hidden">{hole}</g>' if 'visibility="visible"' in circle else hole
    content = f'{style}<rect width="50" height="20"/>{group}'
    area = mbd.Polygon.from_svg(svg(tmp_path / "a.svg", content), tolerance=1e-7).area
    assert area == pytest.approx(1e-3 - is_seen * np.pi * 25e-6, rel=1e-5)


@pytest.mark.parametrize(
    ("clip", "place", "words"),
    [
        ('<clipPath id="c"><rect width="50" height="20"/></clipPath>', 'clip-path="url(#c)"', None),
        ('<clipPath id="c"><circle r="60"/></clipPath>', 'style="clip-path:url(#c)"', None),
        (
            '<clipPath id="c"><rect width="49" height="20"/></clipPath>',
            'clip-path="url(#c)"',
            r"'g1' is cut by url\(#c\)",
        ),
        ('<clipPath id="c"><rect width="90" height="90" x="60"/></clipPath>', 'clip-path="url(#c)"', "is cut by url"),
        (
            '<clipPath id="c" clipPathUnits="objectBoundingBox"><rect width="90" height="90"/></clipPath>',
            'clip-path="url(#c)"',
            "is cut by url",
        ),
        ('<mask id="c"><rect width="90" height="90"/></mask>', 'mask="url(#c)"', "'g1' is cut by a mask"),
    ],
)
def test_clips_of_svg(clip, place, words, tmp_path):
    """Outlines inside a clip, in the place of what it clips, are drawn whole; others are refused."""
    content = (
        f'<defs>{clip}</defs><g id="g1" transform="translate(9 9) scale(2)" {place}><rect width="50" height="20"/></g>'
    )
    path = svg(tmp_path / "a.svg", content)
    if words is None:
        assert mbd.Polygon.from_svg(path).area == pytest.approx(4e-3)
    else:
        with pytest.raises(mbd.FileError, match=f"{words}.*; cut the outlines in the drawing, or release them"):
            mbd.Polygon.from_svg(path)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ('<path d="M 0 0 L 50 50 L 50 0 L 0 50 z"/>', r"outlines cross at \(0.025, -0.025\) m; join or part them"),
        ('<path d="M 0 0 L 50 0 L 50 40 L 50 0 z"/>', "holds no closed outline"),
        ("<g>" * 3000 + '<rect width="9" height="9"/>' + "</g>" * 3000, "nested too deeply; dissolve them"),
        ('<rect width="30" height="20"/><rect x="20" y="5" width="30" height="20"/>', r"outlines cross at \(0.0"),
        ('<path d="M 0 0 L 40 30 L 40 0 L 0 20 z"/>', "outlines cross at"),
        ('<rect width="30" height="20"/><rect x="20" width="30" height="20"/>', "another outline overlaps"),
        ('<rect width="20" height="20"/><path d="M 0 0 L 20 20 L 30 0 z"/>', "another outline overlaps"),
        ('<rect width="20" height="20"/><rect width="20" height="20"/>', "another outline overlaps"),
        ('<svg x="10"><rect width="20" height="20"/></svg>', "svg in svg"),
        ('<symbol id="a"><rect width="20" height="20"/></symbol><use href="#a"/>', "the symbol '#a' is not read"),
    ],
)
def test_drawings_without_a_known_area(content, words, tmp_path):
    """Outlines that cross or lie on each other, and drawings in the drawing, are refused and not counted twice."""
    with pytest.raises(mbd.FileError, match=words):
        mbd.Polygon.from_svg(svg(tmp_path / "a.svg", content))


def test_curves_of_svg(tmp_path):
    """An ellipse by arcs, and a circle by Bezier curves, with as many corners as the tolerance asks for."""
    path = tmp_path / "a.svg"
    head = '<svg xmlns="http://www.w3.org/2000/svg" width="96" height="96">'
    path.write_text(f'{head}<path d="M 10 50 A 40 20 0 0 1 90 50 A 40 20 0 0 1 10 50 Z"/></svg>')
    ellipse = mbd.Polygon.from_svg(path, scale=0.001, tolerance=1e-7)
    assert ellipse.area == pytest.approx(np.pi * 0.04 * 0.02, rel=1e-5)
    assert ellipse.second_moment == pytest.approx(np.pi * 0.04 * 0.02 * (0.04**2 + 0.02**2) / 4, rel=1e-5)
    assert len(mbd.Polygon.from_svg(path, scale=0.001, tolerance=1e-4).points) < len(ellipse.points) / 5
    k = 40 * 0.5522847498
    quarter = f"M 90 50 C 90 {50 + k} {50 + k} 90 50 90 C {50 - k} 90 10 {50 + k} 10 50"
    path.write_text(
        f'{head}<path d="{quarter} C 10 {50 - k} {50 - k} 10 50 10 C {50 + k} 10 90 {50 - k} 90 50"/></svg>'
    )
    assert mbd.Polygon.from_svg(path, scale=0.001).area == pytest.approx(np.pi * 0.04**2, rel=1e-3)


def test_dxf_drawings(tmp_path):
    """Polylines with arcs, circles, splines, and outlines of single lines and arcs; units and layers."""
    drawing = ezdxf.new(units=ezdxf.units.MM)
    space = drawing.modelspace()
    space.add_line((0, 0), (100, 0))
    space.add_line((100, 50), (100, 0))
    space.add_arc((50, 50), 50, 0, 180)
    space.add_line((0, 50), (0, 0))
    space.add_circle((50, 50), 10)
    space.add_lwpolyline([(20, 10), (40, 10), (40, 20), (20, 20)], close=True, dxfattribs={"layer": "window"})
    space.add_lwpolyline([(60, 10, 0, 0, 1), (70, 10, 0, 0, 1)], close=True)  # a circle of two arcs
    space.add_text("plate")
    space.add_line((200, 0), (300, 5))
    path = tmp_path / "plate.dxf"
    drawing.saveas(path)
    whole = 0.1 * 0.05 + np.pi * 0.05**2 / 2 - np.pi * 0.01**2 - 0.02 * 0.01 - np.pi * 0.005**2
    assert mbd.Polygon.from_dxf(path, tolerance=1e-7).area == pytest.approx(whole, rel=1e-6)
    assert mbd.Polygon.from_dxf(path).area == pytest.approx(whole, rel=2e-3)
    window = mbd.Polygon.from_dxf(path, layer="window", scale=1.0)
    assert window.area == pytest.approx(200) and window.centroid == pytest.approx([30, 15])
    drawing.units = 0
    drawing.saveas(path)
    with pytest.raises(mbd.FileError, match="names no unit; give the metres in one of it as scale="):
        mbd.Polygon.from_dxf(path)


def test_lines_of_dxf(tmp_path):
    """Slots of loose lines and arcs, blocks that are turned, ellipses, exact splines; what is hidden does not count."""
    drawing = ezdxf.new(units=ezdxf.units.MM)
    space, path = drawing.modelspace(), tmp_path / "a.dxf"
    space.add_line((40, 10), (0, 10), dxfattribs={"layer": "slot"})
    space.add_arc((40, 5), 5, -90, 90, dxfattribs={"layer": "slot"})
    space.add_line((0, 0), (40, 0), dxfattribs={"layer": "slot"})
    space.add_arc((0, 5), 5, 90, 270, dxfattribs={"layer": "slot"})
    space.add_line((0, 0), (-5, -9), dxfattribs={"layer": "slot"})  # leads nowhere
    block = drawing.blocks.new("ring")
    block.add_circle((0, 0), 5)
    for x in (0, 30):
        space.add_blockref("ring", (x, 0), dxfattribs={"layer": "rings", "xscale": 2, "rotation": 30})
    space.add_ellipse((1, 2), (10, 5), 0.5, dxfattribs={"layer": "ellipse"})
    points = [(10, 0), (10, 10), (0, 10), (-10, 10), (-10, 0), (-10, -10), (0, -10), (10, -10), (10, 0)]
    half = np.sqrt(0.5)
    knots = [0, 0, 0, 1, 1, 2, 2, 3, 3, 4, 4, 4]
    space.add_rational_spline(points, [1, half, 1, half, 1, half, 1, half, 1], 2, knots, dxfattribs={"layer": "spline"})
    space.add_lwpolyline([(0, 0, -1), (0, 10, -1)], "xyb", close=True, dxfattribs={"layer": "negative"})
    drawing.saveas(path)
    for layer, area in (
        ("slot", 400 + np.pi * 25),
        ("rings", 2 * np.pi * 50),
        ("ellipse", np.pi * 125 / 2),
        ("spline", np.pi * 100),
        ("negative", np.pi * 25),
    ):
        assert mbd.Polygon.from_dxf(path, layer=layer, tolerance=1e-8).area == pytest.approx(area * 1e-6, rel=5e-6)
    with pytest.raises(mbd.FileError, match="nothing is on a layer 'slots'; there are ellipse, negative, rings"):
        mbd.Polygon.from_dxf(path, layer="slots")


def test_hidden_and_branching_lines_of_dxf(tmp_path):
    """Layers that are off, frozen or never printed; lines of which three meet enclose no known outline."""
    drawing, path = ezdxf.new(units=ezdxf.units.MM), tmp_path / "a.dxf"
    space = drawing.modelspace()
    space.add_lwpolyline([(0, 0), (50, 0), (50, 20), (0, 20)], close=True)
    drawing.layers.add("off").off()
    drawing.layers.add("frozen").freeze()
    for k, more in enumerate(({"layer": "off"}, {"layer": "frozen"}, {"layer": "Defpoints"}, {"invisible": 1})):
        space.add_circle((5 + 10 * k, 10), 3, dxfattribs=more)
    drawing.saveas(path)
    assert mbd.Polygon.from_dxf(path).area == pytest.approx(1e-3)
    for begin, end in (
        ((0, 0), (10, 0)),
        ((10, 0), (10, 10)),
        ((10, 10), (0, 0)),
        ((10, 0), (20, 0)),
        ((20, 0), (10, 10)),
    ):
        space.add_line(begin, end, dxfattribs={"layer": "web"})
    drawing.saveas(path)
    with pytest.raises(mbd.FileError, match=r"more than two lines meet at \(10, \d+\) in the drawing"):
        mbd.Polygon.from_dxf(path, layer="web")


def test_blocks_of_dxf(tmp_path):
    """Arrays of blocks, nested and turned; what lies on a layer that is off inside a block is not drawn."""
    drawing, path = ezdxf.new(units=ezdxf.units.MM), tmp_path / "a.dxf"
    drawing.layers.add("off").off()
    drawing.layers.add("frozen").freeze()
    square = np.array([(0, 0), (10, 0), (10, 10), (0, 10)])
    block, outer, space = drawing.blocks.new("block"), drawing.blocks.new("outer"), drawing.modelspace()
    for k, layer in enumerate(("0", "off", "frozen", "on")):
        block.add_lwpolyline(square + np.array([20 * k, 0]), close=True, dxfattribs={"layer": layer})
    outer.add_blockref("block", (0, 0), dxfattribs={"column_count": 3, "column_spacing": 100})
    space.add_blockref("outer", (0, 0), dxfattribs={"row_count": 2, "row_spacing": 30, "rotation": 30})
    drawing.saveas(path)
    assert mbd.Polygon.from_dxf(path).area == pytest.approx(6 * 200e-6)
    assert mbd.Polygon.from_dxf(path, layer="on").area == pytest.approx(6 * 100e-6)
    # layer 0 of a block is the layer of the block; one that is frozen hides all of it
    space.add_blockref("block", (900, 0), dxfattribs={"layer": "off"})
    space.add_blockref("block", (900, 50), dxfattribs={"layer": "frozen"})
    drawing.saveas(path)
    assert mbd.Polygon.from_dxf(path).area == pytest.approx(13 * 100e-6)
    assert mbd.Polygon.from_dxf(path, layer="off").area == pytest.approx((6 + 4 + 1) * 100e-6)


def test_lines_of_dxf_that_draw_nothing(tmp_path):
    drawing, path = ezdxf.new(units=ezdxf.units.MM), tmp_path / "a.dxf"
    space = drawing.modelspace()
    space.add_lwpolyline([(0, 0), (10, 0), (10, 10), (0, 10)], close=True)
    space.add_spline()
    space.add_circle((30, 0), 0)
    drawing.saveas(path)
    assert mbd.Polygon.from_dxf(path).area == pytest.approx(100e-6)


@pytest.mark.parametrize(("name", "words"), [("missing", '"missing" does not exist'), ("block", "nested too deeply")])
def test_blocks_of_dxf_that_are_not_there_or_hold_themselves(name, words, tmp_path):
    drawing, path = ezdxf.new(units=ezdxf.units.MM), tmp_path / "a.dxf"
    drawing.blocks.new("block").add_blockref("block", (0, 0))
    drawing.modelspace().add_blockref(name, (0, 0))
    drawing.saveas(path)
    with pytest.raises(mbd.FileError, match=words):
        mbd.Polygon.from_dxf(path)


def test_bad_drawings(tmp_path, monkeypatch):
    """One sentence each: missing, broken, without an outline, without the library."""
    for read, name in ((mbd.Polygon.from_svg, "a.svg"), (mbd.Polygon.from_dxf, "a.dxf")):
        path = tmp_path / name
        with pytest.raises(mbd.FileError, match=r"a\.\w+: the file cannot be read"):
            read(path)
        path.write_text("nothing of the kind")
        with pytest.raises(mbd.FileError, match=r"this is not an? \w+ drawing"):
            read(path)
        for wrong in (3, None, b"a", "a\0b"):
            with pytest.raises(mbd.FileError, match=r"the path of a file is a text or a pathlib\.Path, got"):
                read(wrong)
        with pytest.raises(mbd.FileError, match="the file cannot be read: File name too long"):
            read("x" * 300)
    path = tmp_path / "page.svg"
    path.write_text("<html><body><svg/></body></html>")
    with pytest.raises(mbd.FileError, match="this is not an SVG drawing: its outermost element is html, not svg"):
        mbd.Polygon.from_svg(path)
    path = tmp_path / "open.svg"
    svg(path, '<path fill="none" stroke="red" d="M 0 0 L 10 0 L 10 10"/>')
    with pytest.raises(mbd.FileError, match="holds no closed outline"):
        mbd.Polygon.from_svg(path)
    for scale in (0, -1, "mm", np.nan):
        with pytest.raises(mbd.FileError, match="scale must be positive"):
            mbd.Polygon.from_svg(path, scale=scale)
    usual = builtins.__import__

    def without(name, *arguments, **more):
        if name == "svgelements":
            raise ImportError(name)
        return usual(name, *arguments, **more)

    monkeypatch.setitem(sys.modules, "svgelements", None)
    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(mbd.FileError, match=r'needs svgelements: pip install "mbdcasadi\[outlines\]"'):
        mbd.Polygon.from_svg(path)
