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
    # the library knows the millimetre to six digits
    close_to(mbd.Polygon.from_svg(path, tolerance=1e-7), *values, 5e-6)
    pixel = 0.0254 / 96
    twice = mbd.Polygon.from_svg(path, scale=2 * pixel, tolerance=1e-7)
    close_to(twice, 4 * values[0], 2 * values[1], 16 * values[2], 5e-6)
    body = mbd.Body.from_shape("plate", mbd.Polygon.from_svg(path), mass=2.0)
    assert body.inertia == pytest.approx(known.mass_properties(mass=2.0)[2], rel=2e-4)


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


def test_bad_drawings(tmp_path, monkeypatch):
    """One sentence each: missing, broken, without an outline, without the library."""
    for read, name in ((mbd.Polygon.from_svg, "a.svg"), (mbd.Polygon.from_dxf, "a.dxf")):
        path = tmp_path / name
        with pytest.raises(mbd.FileError, match=r"a\.\w+: the file cannot be read"):
            read(path)
        path.write_text("nothing of the kind")
        with pytest.raises(mbd.FileError, match=r"this is not an? \w+ drawing"):
            read(path)
    path = tmp_path / "open.svg"
    path.write_text('<svg xmlns="http://www.w3.org/2000/svg"><path d="M 0 0 L 10 0 L 10 10"/></svg>')
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
