"""Homogeneous planar shapes: mass properties of bodies, and outlines to draw them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ...errors import ModelError
from .outline_files import loops_of_dxf, loops_of_svg

#: Area (of rods: length, and so mass), centroid, and second moment about the centroid.
Moments = tuple[float, np.ndarray, float]

#: An area below this fraction of the areas it is computed from is rounding error.
_ROUNDING = 1e-12


def _number(value: float, what: str, name: str, sign: str = "") -> float:
    try:
        result = float(value)
    except (TypeError, ValueError, RuntimeError, OverflowError):
        result = np.nan
    # float() reads text, and turns a casadi symbol into nan without complaint
    if isinstance(value, str) or (np.isnan(result) and not isinstance(value, int | float | np.generic)):
        raise ModelError(f"{what}: {name} must be a plain number, got {value!r}")
    inside = {"": True, "positive and ": result > 0, "non-negative and ": result >= 0}[sign]
    if not (np.isfinite(result) and inside):
        raise ModelError(f"{what}: {name} must be {sign}finite, got {result}")
    return result


def _pair(value: tuple[float, float], what: str, name: str) -> tuple[float, float]:
    try:
        x, y = value
    except (TypeError, ValueError):
        raise ModelError(f"{what}: {name} must be two numbers (x, y), got {value!r}") from None
    return _number(x, what, f"x of {name}"), _number(y, what, f"y of {name}")


def rotation_matrix(angle: float) -> np.ndarray:
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def _edges(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Next corner of each corner, and their cross product: twice the area of a triangle at the origin."""
    following = np.roll(points, -1, axis=0)
    return following, points[:, 0] * following[:, 1] - following[:, 0] * points[:, 1]


@dataclass(frozen=True, eq=False)
class Contour:
    """Closed outline of a part or a hole: `points` (k, 2), m, without repeating the first one.

    Parts run counter-clockwise and holes clockwise (non-zero winding rule); a rod has its two ends.
    """

    points: np.ndarray
    hole: bool = False


class Shape:
    """An immutable homogeneous planar shape.

    ``a + b`` joins parts that do not overlap, and ``a - b`` cuts out ``b``, which must lie inside ``a``.
    """

    #: True if it is made of rods, whose density is by length instead of area.
    is_line: bool = False

    def _moments(self) -> Moments:
        raise NotImplementedError

    def _corners(self) -> np.ndarray:
        """Corners (k, 2) counter-clockwise, m."""
        raise NotImplementedError

    def _moved(self, shift: np.ndarray, angle: float) -> Shape:
        raise NotImplementedError

    @property
    def area(self) -> float:
        """Area ``A``, m²; zero for rods."""
        return 0.0 if self.is_line else self._moments()[0]

    @property
    def centroid(self) -> np.ndarray:
        """Centroid ``c`` (2,) in the shape's frame, m."""
        return self._moments()[1]

    @property
    def second_moment(self) -> float:
        """Polar second moment of area about the centroid, ``∫ |r - c|² dA``, m⁴ (of length, m³, for rods)."""
        return self._moments()[2]

    def mass_properties(self, density: float | None = None, mass: float | None = None) -> Moments:
        """Return the mass, the centre of mass and the moment of inertia about it.

        ``m = density * A`` and ``J' = m * second_moment / A``, with the length in place of ``A`` for rods.

        Parameters
        ----------
        density : float, optional
            Mass by area, kg/m² (by length for rods, kg/m).
        mass : float, optional
            Mass, kg; exactly one of `density` and `mass` is given, else a ModelError is raised.

        Returns
        -------
        (float, numpy.ndarray, float)
            Mass ``m``, kg; centre of mass (2,) in the shape's frame, m; moment of inertia ``J'``, kg m².
        """
        what = type(self).__name__
        measure, centroid, second_moment = self._moments()
        if density is not None and mass is None:
            total = _number(density, what, "density", "non-negative and ") * measure
        elif mass is not None and density is None:
            total = _number(mass, what, "mass", "non-negative and ")
        else:
            raise ModelError(f"{what}: give one of density and mass, got density={density!r}, mass={mass!r}")
        return total, centroid, total * second_moment / measure

    def outlines(self) -> list[Contour]:
        """Return the outlines of the parts and then those of the holes, for drawing."""
        parts, holes = _parts_and_holes(self)
        outlines = [Contour(part._corners()) for part in parts]
        return outlines + [Contour(hole._corners()[::-1], hole=True) for hole in holes]

    def moved(self, x: float, y: float, angle: float = 0.0) -> Shape:
        """Return the shape turned by `angle` (rad) about the origin and then shifted by `x`, `y` (m).

        A point ``p`` of it goes to ``(x, y) + A(angle) p``.
        """
        what = type(self).__name__
        return self._moved(np.array(_pair((x, y), what, "shift")), _number(angle, what, "angle"))

    def __add__(self, other: Shape) -> Composite:
        (parts, holes), (other_parts, other_holes) = _parts_and_holes(self), _parts_and_holes(other)
        return Composite(parts + other_parts, holes + other_holes)

    def __sub__(self, other: Shape) -> Composite:
        (parts, holes), (other_parts, other_holes) = _parts_and_holes(self), _parts_and_holes(other)
        # if the shape that is cut out has a hole itself, material is left there
        return Composite(parts + other_holes, holes + other_parts)


def _parts_and_holes(shape: Shape) -> tuple[tuple[Shape, ...], tuple[Shape, ...]]:
    if not isinstance(shape, Shape):
        raise ModelError(f"Composite: parts and holes must be shapes, got {shape!r}")
    return (shape.parts, shape.holes) if isinstance(shape, Composite) else ((shape,), ())


class _Centered(Shape):
    """A shape with some lengths, a centre and perhaps an angle as its fields."""

    center: tuple[float, float]

    def __post_init__(self) -> None:
        what = type(self).__name__
        for name, value in list(vars(self).items()):
            sign = "" if name == "angle" else "positive and "
            checked = _pair(value, what, name) if name == "center" else _number(value, what, name, sign)
            object.__setattr__(self, name, checked)

    def _moved(self, shift: np.ndarray, angle: float) -> Shape:
        turned = {"angle": self.angle + angle} if hasattr(self, "angle") else {}
        return replace(self, center=shift + rotation_matrix(angle) @ self.center, **turned)  # type: ignore[type-var]


@dataclass(frozen=True)
class Rectangle(_Centered):
    """Rectangle, ``J' = m (width² + height²)/12``.

    Parameters
    ----------
    width, height : float
        Lengths of the sides, m.
    center : (float, float), default (0, 0)
        Its middle, m.
    angle : float, default 0
        Angle of the side `width`, rad.
    """

    width: float
    height: float
    center: tuple[float, float] = (0.0, 0.0)
    angle: float = 0.0

    def _moments(self) -> Moments:
        area = self.width * self.height
        return area, np.array(self.center), area * (self.width**2 + self.height**2) / 12

    def _corners(self) -> np.ndarray:
        corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * [self.width / 2, self.height / 2]
        return self.center + corners @ rotation_matrix(self.angle).T


@dataclass(frozen=True)
class Disc(_Centered):
    """Disc, ``J' = m radius²/2``.

    Parameters
    ----------
    radius : float
        m.
    center : (float, float), default (0, 0)
        Its middle, m.
    """

    radius: float
    center: tuple[float, float] = (0.0, 0.0)

    def _moments(self) -> Moments:
        area = np.pi * self.radius**2
        return area, np.array(self.center), area * self.radius**2 / 2

    def _corners(self) -> np.ndarray:
        # 96 corners stay within 0.06 % of the radius: a circle to the eye
        angles = 2 * np.pi * np.arange(96) / 96
        return self.center + self.radius * np.column_stack([np.cos(angles), np.sin(angles)])


@dataclass(frozen=True)
class Rod(_Centered):
    """Slender straight rod, ``J' = m length²/12``, whose density is in kg/m.

    Parameters
    ----------
    length : float
        m.
    center : (float, float), default (0, 0)
        Its middle, m.
    angle : float, default 0
        rad.
    """

    length: float
    center: tuple[float, float] = (0.0, 0.0)
    angle: float = 0.0

    is_line = True

    def _moments(self) -> Moments:
        return self.length, np.array(self.center), self.length**3 / 12

    def _corners(self) -> np.ndarray:
        half = self.length / 2 * np.array([np.cos(self.angle), np.sin(self.angle)])
        return np.array([self.center - half, self.center + half])


@dataclass(frozen=True)
class Polygon(Shape):
    """Polygon of three or more corners.

    Parameters
    ----------
    points : sequence of (float, float)
        Corners in order, in either orientation, m; the edges must not cross.

    Notes
    -----
    With ``d = x y₊ - x₊ y`` for each corner ``p = (x, y)`` and the next one ``p₊``: ``A = Σ d/2``,
    ``c = Σ d (p + p₊)/(6 A)`` and, for points taken from ``c``, ``∫ r² dA = Σ d (p·p + p·p₊ + p₊·p₊)/12``.
    """

    points: tuple[tuple[float, float], ...]

    def __post_init__(self) -> None:
        points = tuple(self.points) if np.iterable(self.points) else ()
        if len(points) < 3:
            raise ModelError(f"Polygon: points must be at least 3 pairs (x, y), got {self.points!r}")
        checked = tuple(_pair(point, "Polygon", f"points[{index}]") for index, point in enumerate(points))
        object.__setattr__(self, "points", checked)
        following, d = _edges(np.array(checked) - checked[0])
        if abs(d.sum()) <= _ROUNDING * np.max(following**2):
            area = f"{abs(d.sum()) / 2:.3g} m² (points on a line, or crossing edges)"
            raise ModelError(f"Polygon: area must be positive, got {area}")

    @classmethod
    def from_svg(cls, path: str | Path, *, scale: float | None = None, tolerance: float | None = None) -> Shape:
        """Return the shape of the closed outlines of an SVG drawing, by svgelements.

        Outlines inside others are holes, and outlines inside holes are parts again. What is filled counts, also if its
        line is left open, and so does a closed line; open lines, hidden shapes and parts that are not drawn in place
        (``defs``, masks) do not. The y axis points up, as it is seen.

        Parameters
        ----------
        path : str or Path
            The file.
        scale : float, optional
            Metres in a pixel; by default the size that the drawing has on paper (0.0254/96).
        tolerance : float, optional
            Largest distance of the polygon from curves, m; by default 1e-4 of the size of the drawing.

        Returns
        -------
        Shape
            A polygon, or a sum and difference of polygons.

        Raises
        ------
        FileError
            For a file that cannot be read or holds no closed outline, outlines that cross or overlap in part, or that
            a clip or mask may cut, a drawing or symbol inside the drawing, and without svgelements.
        """
        return _shape_of(loops_of_svg(path, scale, tolerance))

    @classmethod
    def from_dxf(
        cls,
        path: str | Path,
        *,
        scale: float | None = None,
        tolerance: float | None = None,
        layer: str | None = None,
    ) -> Shape:
        """Return the shape of the closed outlines of a DXF drawing, by ezdxf.

        Lines and arcs that meet at their ends are one outline; see :meth:`from_svg`. Blocks and arrays of them count
        as often as they are drawn. Layers that are off or frozen, also inside blocks, ``Defpoints`` and invisible lines
        do not count, if no layer is given.

        Parameters
        ----------
        path : str or Path
            The file.
        scale : float, optional
            Metres in a unit of the drawing; by default those of the unit that the drawing names.
        tolerance : float, optional
            Largest distance of the polygon from curves, m; by default 1e-4 of the size of the drawing.
        layer : str, optional
            Layer of the outlines, or of the blocks that hold them; all layers by default.

        Raises
        ------
        FileError
            For a file that cannot be read, names no unit or holds no closed outline, lines of which more than
            two meet, outlines that cross or overlap in part, and without ezdxf.
        """
        return _shape_of(loops_of_dxf(path, scale, tolerance, layer))

    def _corners(self) -> np.ndarray:
        points = np.array(self.points)
        return points if _edges(points - points[0])[1].sum() > 0 else points[::-1]

    def _moments(self) -> Moments:
        corners, origin = self._corners(), np.array(self.points[0])
        # the sums cancel badly far from the origin, so they start from a corner and then from the centroid
        for _ in range(2):
            points = corners - origin
            following, d = _edges(points)
            origin = origin + d @ (points + following) / (3 * d.sum())
        second_moment = d @ np.sum(points**2 + points * following + following**2, axis=1) / 12
        return float(d.sum() / 2), origin, float(second_moment)

    def _moved(self, shift: np.ndarray, angle: float) -> Polygon:
        return Polygon(tuple(shift + np.array(self.points) @ rotation_matrix(angle).T))


def _shape_of(loops: list[tuple[np.ndarray, int]]) -> Shape:
    """Return the shape of outlines: those inside an odd number of others are holes."""
    (first, _), *others = loops
    shape: Shape = Polygon(tuple(map(tuple, first.tolist())))
    for loop, depth in others:
        part = Polygon(tuple(map(tuple, loop.tolist())))
        shape = shape - part if depth % 2 else shape + part
    return shape


@dataclass(frozen=True)
class Composite(Shape):
    """Parts that do not overlap, and holes inside them; made by ``+`` and ``-`` of shapes.

    With holes counted negative (and lengths in place of areas for rods): ``A = Σ A_i``,
    ``c = Σ A_i c_i/A`` and, by the parallel axis theorem, ``∫ |r - c|² dA = Σ (J_i + A_i |c_i - c|²)``.
    """

    parts: tuple[Shape, ...]
    holes: tuple[Shape, ...] = ()

    def __post_init__(self) -> None:
        if len({shape.is_line for shape in self.parts + self.holes}) > 1:
            cause = "a rod has mass by length and a shape with an area has mass by area; no density fits both"
            raise ModelError(f"Composite: {cause}, make two bodies and weld them together; got {self!r}")
        object.__setattr__(self, "is_line", self.parts[0].is_line)
        if self.is_line and self.holes:
            raise ModelError(f"Composite: nothing can be cut out of a rod, got {self!r}")
        whole, cut = (sum(shape.area for shape in shapes) for shapes in (self.parts, self.holes))
        # a hole far outside the parts has an area that fits, but makes the second moment negative
        if not self.is_line and (whole - cut <= _ROUNDING * whole or self.second_moment <= 0):
            areas = f"{cut:g} m² cut out of {whole:g} m²"
            raise ModelError(f"Composite: holes must lie inside the parts and leave an area, got {areas}")

    def _moments(self) -> Moments:
        each = [shape._moments() for shape in self.parts + self.holes]
        measures, centroids, second_moments = (np.array(column) for column in zip(*each, strict=True))
        signs = np.repeat([1.0, -1.0], [len(self.parts), len(self.holes)])
        measures, arms = signs * measures, centroids - centroids[0]
        offset = measures @ arms / measures.sum()
        second_moment = signs @ second_moments + measures @ np.sum((arms - offset) ** 2, axis=1)
        return float(measures.sum()), centroids[0] + offset, float(second_moment)

    def _moved(self, shift: np.ndarray, angle: float) -> Composite:
        parts, holes = (tuple(s._moved(shift, angle) for s in shapes) for shapes in (self.parts, self.holes))
        return Composite(parts, holes)

    def __repr__(self) -> str:
        return " + ".join(map(repr, self.parts)) + "".join(f" - {hole!r}" for hole in self.holes)
