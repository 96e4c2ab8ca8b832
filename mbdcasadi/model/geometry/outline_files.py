"""Closed outlines of drawings in SVG and DXF files."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import FileError

#: Largest distance of a chord from a curve, relative to the size of the drawing, unless another one is given.
TOLERANCE = 1e-4
#: Metres in a pixel of CSS.
PIXEL = 0.0254 / 96
#: Distance below which two ends are joined, relative to the size of the drawing.
JOINED = 1e-6
#: Halvings of a curve, at most.
_MOST_HALVINGS = 12

Loop = np.ndarray


def loops_of_svg(path: str | Path, scale: float | None, tolerance: float | None) -> list[tuple[Loop, int]]:
    """Return the closed outlines of an SVG file (k, 2), m, and the number of others around each."""
    library = _library("svgelements", path)
    try:
        document = library.SVG.parse(str(path), reify=True)
    except OSError as error:
        raise _unreadable(path, error) from None
    except Exception as error:  # whatever the library meets in a broken file
        raise FileError(f"{path}: this is not an SVG drawing: {error}") from None
    paths = [library.Path(e) for e in document.elements() if isinstance(e, library.Shape)]
    subpaths = [part for each in paths for part in each.as_subpaths() if len(part) > 1]
    ends = np.array([[point.x, point.y] for part in subpaths for s in part for point in (s.start, s.end) if point])
    size = float(np.max(np.ptp(ends, axis=0), initial=0.0)) if ends.size else 0.0
    factor = PIXEL if scale is None else _positive(scale, path, "scale")
    allowed = TOLERANCE * size if tolerance is None else _positive(tolerance, path, "tolerance") / factor
    loops = []
    for part in subpaths:
        points = _joined([_sampled(segment, allowed) for segment in part if segment.start is not None])
        if len(points) > 1 and np.linalg.norm(points[0] - points[-1]) <= JOINED * size:
            loops.append(points[:-1] * [factor, -factor])  # the y axis of drawings points down
    return _by_depth(loops, path)


def loops_of_dxf(
    path: str | Path, scale: float | None, tolerance: float | None, layer: str | None
) -> list[tuple[Loop, int]]:
    """Return the closed outlines of a DXF file (k, 2), m, and the number of others around each."""
    library = _library("ezdxf", path)
    try:
        document = library.readfile(str(path))
    except Exception as error:
        if isinstance(error, OSError) and error.strerror:
            raise _unreadable(path, error) from None
        raise FileError(f"{path}: this is not a DXF drawing: {error}") from None
    factor = _unit(document, path) if scale is None else _positive(scale, path, "scale")
    lines = list(_lines(e for e in document.modelspace() if layer is None or e.dxf.layer == layer))
    ends = np.vstack([np.zeros((0, 2)), *(_ends(line) for line in lines)])
    size = float(np.max(np.ptp(ends, axis=0), initial=0.0)) if ends.size else 0.0
    allowed = TOLERANCE * size if tolerance is None else _positive(tolerance, path, "tolerance") / factor
    pieces = [_ends(line) if line.dxftype() == "LINE" else _flat(line, allowed) for line in lines]
    return _by_depth([loop * factor for loop in _chained(pieces, JOINED * size)], path)


def _lines(entities: Iterable[Any]) -> Iterator[Any]:
    """Lines and curves of entities, polylines and blocks taken apart; texts, dimensions and the like are left out."""
    for entity in entities:
        if entity.dxftype() in ("LWPOLYLINE", "POLYLINE", "INSERT"):
            yield from _lines(entity.virtual_entities())
        elif entity.dxftype() in ("LINE", "ARC", "CIRCLE", "ELLIPSE", "SPLINE"):
            yield entity


def _ends(line: Any) -> np.ndarray:
    """Points that give the size of a line or curve (k, 2)."""
    if line.dxftype() == "LINE":
        return np.array([[p.x, p.y] for p in (line.dxf.start, line.dxf.end)])
    return _flat(line, np.inf)


def _flat(curve: Any, allowed: float) -> np.ndarray:
    """Points on a curve (k, 2)."""
    if np.isinf(allowed):
        radius = getattr(curve.dxf, "radius", None)
        allowed = 1.0 if radius is None else radius / 2
    return np.array([[p.x, p.y] for p in curve.flattening(allowed)])


def _library(name: str, path: Any) -> Any:
    if not Path(path).is_file():
        raise FileError(f"{path}: the file cannot be read: there is no such file")
    try:
        return import_module(name)
    except ImportError:
        raise FileError(f'{path}: reading it needs {name}: pip install "mbdcasadi[outlines]"') from None


def _unreadable(path: Any, error: OSError) -> FileError:
    return FileError(f"{path}: the file cannot be read: {error.strerror or error}")


def _positive(value: Any, path: Any, name: str) -> float:
    try:
        found = float(value)
    except (TypeError, ValueError):
        found = np.nan
    if not (np.isfinite(found) and found > 0):
        raise FileError(f"{path}: {name} must be positive, got {value!r}")
    return found


def _unit(document: Any, path: Any) -> float:
    """Metres in a unit of a DXF drawing."""
    units = import_module("ezdxf.units")
    if document.units == 0:
        raise FileError(f"{path}: the drawing names no unit; give the metres in one of it as scale=")
    return float(units.conversion_factor(document.units, units.M))


def _sampled(segment: Any, allowed: float) -> np.ndarray:
    """Points on a segment of a path, closer where it bends (k, 2)."""
    if type(segment).__name__ in ("Line", "Close", "Move"):
        return np.array([[p.x, p.y] for p in (segment.start, segment.end)])
    return _refined(lambda parameters: np.asarray(segment.npoint(parameters), float), allowed)


def _refined(at: Callable[[np.ndarray], np.ndarray], allowed: float) -> np.ndarray:
    """Points on a curve whose chords are nowhere farther from it than allowed."""
    count = 4
    for _ in range(_MOST_HALVINGS):
        points = at(np.linspace(0, 1, 2 * count + 1))
        chords, middles = points[::2], points[1::2]
        if np.max(np.linalg.norm(middles - (chords[:-1] + chords[1:]) / 2, axis=1)) <= allowed:
            return points
        count *= 2
    return points


def _joined(parts: Iterable[np.ndarray]) -> np.ndarray:
    """Points of segments that follow each other, each once."""
    points = np.vstack([np.zeros((0, 2)), *parts])
    if not len(points):
        return points
    apart = np.r_[True, np.any(np.diff(points, axis=0) != 0, axis=1)]
    found: np.ndarray = points[apart]
    return found


def _chained(pieces: Sequence[np.ndarray], joined: float) -> list[Loop]:
    """Loops from pieces that meet at their ends; open ones are left out."""
    loops, left = [], list(pieces)
    while left:
        chain = left.pop(0)
        while np.linalg.norm(chain[0] - chain[-1]) > joined:
            for k, piece in enumerate(left):
                if np.linalg.norm(piece[0] - chain[-1]) <= joined:
                    break
                if np.linalg.norm(piece[-1] - chain[-1]) <= joined:
                    left[k] = piece = piece[::-1]
                    break
            else:
                break
            chain = np.vstack([chain, left.pop(k)[1:]])
        if len(chain) > 3 and np.linalg.norm(chain[0] - chain[-1]) <= joined:
            loops.append(chain[:-1])
    return loops


def _by_depth(loops: Sequence[Loop], path: Any) -> list[tuple[Loop, int]]:
    """Outlines with the number of others that they are inside of, in ascending order; at least one."""
    loops = sorted([loop for loop in loops if len(loop) > 2 and _area(loop) > 0], key=_area, reverse=True)
    if not loops:
        raise FileError(f"{path}: the drawing holds no closed outline")
    depths = [sum(_inside(loop[0], other) for other in loops[:k]) for k, loop in enumerate(loops)]
    return sorted(zip(loops, depths, strict=True), key=lambda item: item[1])


def _area(loop: Loop) -> float:
    x, y = (loop - loop[0]).T
    return abs(float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))) / 2


def _inside(point: np.ndarray, loop: Loop) -> bool:
    """True if a point lies inside a loop, by the edges that a ray crosses."""
    x, y = point
    (xa, ya), (xb, yb) = loop.T, np.roll(loop, -1, axis=0).T
    crosses = (ya > y) != (yb > y)
    with np.errstate(divide="ignore", invalid="ignore"):
        at = xa + (y - ya) / (yb - ya) * (xb - xa)
    return bool(np.sum(crosses & (at > x)) % 2)
