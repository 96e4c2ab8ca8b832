"""Closed outlines of drawings in SVG and DXF files."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np

from ...errors import FileError
from ...numerics.reading import content_of
from ...numerics.tolerances import MET
from .chains import Branching, closed_chains, strung
from .nesting import crossing_of, sides_of

#: Largest distance of a chord from a curve, relative to the size of the drawing, unless another one is given.
TOLERANCE = 1e-4
#: Metres in a pixel of CSS.
PIXEL = 0.0254 / 96
#: Halvings of a curve, at most.
_MOST_HALVINGS = 12

#: Lengths in metric units, and metres in these; a Q is a quarter of a millimetre.
_METRIC = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)(mm|cm|Q)\s*")
_METRES = {"mm": 1e-3, "cm": 1e-2, "Q": 2.5e-4}

Loop = np.ndarray
#: An entity of DXF, and the layers of the blocks around it and its own.
_Entity = tuple[Any, tuple[str, ...]]


def loops_of_svg(path: str | Path, scale: float | None, tolerance: float | None) -> list[tuple[Loop, int]]:
    """Return the closed outlines of an SVG file (k, 2), m, and the number of others around each."""
    library = _library("svgelements", path)
    drawing, document, shapes = _read_svg(path, library)
    parts = [(_transform(shape), list(part), shape, clips) for shape, clips in shapes for part in shape.as_subpaths()]
    parts = [part for part in parts if len(part[1]) > 1]
    ends = [move(np.array([[p.x, p.y] for s in part for p in (s.start, s.end) if p])) for move, part, *_ in parts]
    size = float(np.max(np.ptp(np.vstack(ends), axis=0))) if ends else 0.0
    factor = PIXEL if scale is None else _positive(scale, path, "scale")
    allowed = TOLERANCE * size if tolerance is None else _positive(tolerance, path, "tolerance") / factor
    loops = []
    for move, part, shape, clips in parts:
        points = _points_of(part, move, allowed)
        if len(points) < 2:
            continue
        is_closed = np.linalg.norm(points[0] - points[-1]) <= MET * size
        if is_closed or _paints(shape, "fill"):  # what is filled is closed by that
            points = points[:-1] if is_closed else points
            for clip in clips:
                _check_clip(points, clip, drawing, document, library, path)
            loops.append(points * [factor, -factor])  # the y axis of drawings points down
    return _by_depth(loops, path)


def _read_svg(path: str | Path, library: Any) -> tuple[Any, Any, list[tuple[Any, tuple[Any, ...]]]]:
    """Elements of an SVG file, the document of the library, and the shapes that are drawn; see :func:`_seen`."""
    content = content_of(path)
    try:
        drawing = ElementTree.fromstring(content)
        if _tag(drawing) != "svg":
            raise FileError(f"{path}: this is not an SVG drawing: its outermost element is {_tag(drawing)}, not svg")
        document = library.SVG.parse(BytesIO(_prepared(drawing, path)), reify=False)
        return drawing, document, list(_seen(document, library))
    except FileError:
        raise
    except RecursionError:
        raise FileError(f"{path}: the groups of the drawing are nested too deeply; dissolve them") from None
    except Exception as error:  # whatever the library meets in a broken file
        raise FileError(f"{path}: this is not an SVG drawing: {error}") from None


def _seen(document: Any, library: Any) -> Iterator[tuple[Any, tuple[Any, ...]]]:
    """Shapes that are drawn, as paths, each with the elements around it that are clipped or masked."""
    waiting: list[tuple[Any, tuple[Any, ...]]] = [(document, ())]
    while waiting:
        element, clips = waiting.pop()
        values = getattr(element, "values", None) or {}
        if any(values.get(name, "none") != "none" for name in ("clip-path", "mask")):
            clips = (*clips, element)
        if isinstance(element, library.Shape):
            is_hidden = values.get("visibility") in ("hidden", "collapse") or _is_zero(values.get("opacity"))
            if not is_hidden and (_paints(element, "fill") or _paints(element, "stroke")):
                yield library.Path(element), clips
        elif isinstance(element, list):
            waiting += [(inner, clips) for inner in reversed(element)]


def _paints(shape: Any, kind: str) -> bool:
    """True if a shape is filled, or has a line along its outline."""
    colour = str(shape.values.get(kind, "none")).strip()
    return colour not in ("none", "transparent") and not _is_zero(shape.values.get(f"{kind}-opacity"))


def _is_zero(text: Any) -> bool:
    return text is not None and re.fullmatch(r"\s*(0+\.?0*|\.0+)%?\s*", str(text)) is not None


def _check_clip(points: Loop, clipped: Any, drawing: Any, document: Any, library: Any, path: Any) -> None:
    """Raise an error for an outline that a clip may cut; one inside the clip is drawn as it is."""
    name = clipped.values.get("clip-path", "")
    clip = document.get_element_by_url(name) if "mask" not in clipped.values else None
    sources = [element for element in drawing.iter() if f"url(#{element.get('id')})" == name]
    is_plain = len(sources) == 1 and not {"transform", "clip-path", "clipPathUnits"} & set(sources[0].keys())
    if clip is not None and is_plain:
        here, there = (library.Matrix(each.values.get("transform", "")) for each in (clipped, clip))
        for shape in (library.Path(each) for each in clip if isinstance(each, library.Shape)):
            shape.transform = shape.transform * ~there * here
            for part in shape.as_subpaths():
                around = _points_of(list(part), _transform(shape), MET)
                touching = MET * float(np.max(np.ptp(around, axis=0)))
                if len(around) > 2 and not sides_of(points, around, touching)[1]:
                    return
    label = clipped.values.get("id") or type(clipped).__name__.lower()
    raise FileError(f"{path}: '{label}' is cut by {name or 'a mask'}; cut the outlines in the drawing, or release them")


def loops_of_dxf(
    path: str | Path, scale: float | None, tolerance: float | None, layer: str | None
) -> list[tuple[Loop, int]]:
    """Return the closed outlines of a DXF file (k, 2), m, and the number of others around each."""
    content_of(path)  # raises for a file that cannot be read
    library = _library("ezdxf", path)
    try:
        document = library.readfile(str(path))
    except Exception as error:
        raise FileError(f"{path}: this is not a DXF drawing: {error}") from None
    factor = _unit(document, path) if scale is None else _positive(scale, path, "scale")
    try:
        entities = list(_entities(document.modelspace()))
    except RecursionError:
        raise FileError(f"{path}: the blocks of the drawing are nested too deeply; dissolve them") from None
    except library.DXFError as error:  # a block that is not in the drawing
        raise FileError(f"{path}: the drawing cannot be read: {error}") from None
    groups = [group for entity in _selected(entities, document, layer, path) if (group := _lines(entity))]
    ends = np.vstack([np.zeros((0, 2)), *(_ends(line) for lines in groups for line in lines)])
    size = float(np.max(np.ptp(ends, axis=0), initial=0.0)) if ends.size else 0.0
    allowed = TOLERANCE * size if tolerance is None else _positive(tolerance, path, "tolerance") / factor
    pieces = [
        strung([_ends(line) if line.dxftype() == "LINE" else _flat(line, allowed) for line in lines])
        for lines in groups
    ]
    try:
        return _by_depth([loop * factor for loop in closed_chains(pieces, MET * size)], path)
    except Branching as branching:
        raise FileError(f"{path}: {branching} in the drawing; select the layer of the outlines by layer=") from None


def _entities(entities: Iterable[Any], around: tuple[str, ...] = ()) -> Iterator[_Entity]:
    """Entities that are not invisible, blocks and arrays of them taken apart, with the layers of the blocks and theirs.

    What lies on layer 0 of a block is on the layer of the block.
    """
    for entity in entities:
        if entity.dxf.get("invisible", 0):
            continue
        layers = (*around, around[-1] if around and entity.dxf.layer == "0" else entity.dxf.layer)
        if entity.dxftype() != "INSERT":
            yield entity, layers
            continue
        for block in entity.multi_insert() if entity.mcount > 1 else [entity]:
            yield from _entities(block.virtual_entities(), layers)


def _selected(entities: Sequence[_Entity], document: Any, layer: str | None, path: Any) -> list[Any]:
    """Entities on layers that are drawn, or on the given one, to which a block on it counts as a whole."""
    if layer is None:
        frozen = {each.dxf.name for each in document.layers if each.is_frozen()}
        unseen = {each.dxf.name for each in document.layers if each.is_off()} | frozen | {"Defpoints"}
        return [entity for entity, layers in entities if layers[-1] not in unseen and not frozen & set(layers)]
    known = sorted({name for _, layers in entities for name in layers})
    if layer not in known:
        raise FileError(f"{path}: nothing is on a layer {layer!r}; there are {', '.join(known)}")
    return [entity for entity, layers in entities if layer in layers]


def _lines(entity: Any) -> list[Any]:
    """Lines and curves of an entity, those of a polyline together; none of texts, and of what draws nothing."""
    if entity.dxftype() in ("LWPOLYLINE", "POLYLINE"):
        return [part for part in entity.virtual_entities() if part.dxftype() in ("LINE", "ARC")]
    if entity.dxftype() == "SPLINE":
        return [entity] if len(entity.control_points) or len(entity.fit_points) else []
    if entity.dxftype() in ("ARC", "CIRCLE"):
        return [entity] if entity.dxf.radius > 0 else []
    return [entity] if entity.dxftype() in ("LINE", "ELLIPSE") else []


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
    try:
        return import_module(name)
    except ImportError:
        raise FileError(f'{path}: reading it needs {name}: pip install "mbdcasadi[outlines]"') from None


def _prepared(drawing: ElementTree.Element, path: Any) -> bytes:
    """A drawing as svgelements understands it.

    Metric lengths, which it reads to six digits only, are replaced by pixels; masks, markers and symbols, which are
    not drawn in place, are removed.
    """
    hidden = {part for part in drawing.iter() if _tag(part) in ("mask", "marker", "symbol")}
    names = {part.get("id") for part in hidden}
    for element in list(drawing.iter()):
        referred = next((text for name, text in element.items() if name.rpartition("}")[2] == "href"), "")
        if _tag(element) == "use" and referred.removeprefix("#") in names:
            raise FileError(f"{path}: the symbol '{referred}' is not read; insert its content in its place")
        if element is not drawing and _tag(element) == "svg":
            raise FileError(f"{path}: a drawing inside the drawing (svg in svg) is not read; insert its content")
        for name, text in element.items():
            if length := _METRIC.fullmatch(text):
                element.set(name, repr(float(length[1]) * _METRES[length[2]] / PIXEL))
        for part in [part for part in element if part in hidden]:
            element.remove(part)
    return ElementTree.tostring(drawing)


def _tag(element: ElementTree.Element) -> str:
    """Name of an element without its namespace; empty for comments."""
    return element.tag.rpartition("}")[2] if isinstance(element.tag, str) else ""


def _positive(value: Any, path: Any, name: str) -> float:
    try:
        size = float(value)
    except (TypeError, ValueError):
        size = np.nan
    if not (np.isfinite(size) and size > 0):
        raise FileError(f"{path}: {name} must be positive, got {value!r}")
    return size


def _unit(document: Any, path: Any) -> float:
    """Metres in a unit of a DXF drawing."""
    units = import_module("ezdxf.units")
    if document.units == 0:
        raise FileError(f"{path}: the drawing names no unit; give the metres in one of it as scale=")
    return float(units.conversion_factor(document.units, units.M))


def _transform(path: Any) -> Callable[[np.ndarray], np.ndarray]:
    """The transformation of a path, for points (k, 2): that of svgelements is not right for arcs that are sheared."""
    m = path.transform
    return lambda points: points @ np.array([[m.a, m.b], [m.c, m.d]]) + [m.e, m.f]


def _sampled(segment: Any, move: Callable[[np.ndarray], np.ndarray], allowed: float) -> np.ndarray:
    """Points on a segment of a path, closer where it bends (k, 2)."""
    if type(segment).__name__ in ("Line", "Close"):
        return move(np.array([[p.x, p.y] for p in (segment.start, segment.end)]))
    return _refined(lambda parameters: move(np.asarray(segment.npoint(parameters), float)), allowed)


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


def _points_of(part: Sequence[Any], move: Callable[[np.ndarray], np.ndarray], allowed: float) -> np.ndarray:
    """Points on segments of a path that follow each other, each once (k, 2)."""
    sampled = [_sampled(segment, move, allowed) for segment in part if type(segment).__name__ != "Move"]
    points = np.vstack([np.zeros((0, 2)), *sampled])
    if not len(points):
        return points
    apart = np.r_[True, np.any(np.diff(points, axis=0) != 0, axis=1)]
    kept_points: np.ndarray = points[apart]
    return kept_points


def _by_depth(loops: Sequence[Loop], path: Any) -> list[tuple[Loop, int]]:
    """Outlines with the number of others that they are inside of, in ascending order; at least one."""
    loops = sorted([loop for loop in loops if len(loop) > 2 and not _is_line(loop)], key=_area, reverse=True)
    touching = MET * float(np.max(np.ptp(np.vstack(loops), axis=0))) if loops else 0.0
    crossing = crossing_of(loops, touching) if loops else None
    if crossing is not None:
        raise _overlap(path, "outlines cross at", crossing)
    loops = [loop for loop in loops if _area(loop) > touching**2]  # others run to and fro
    if not loops:
        raise FileError(f"{path}: the drawing holds no closed outline")
    depths = [sum(_lies_inside(loop, other, touching, path) for other in loops[:k]) for k, loop in enumerate(loops)]
    return sorted(zip(loops, depths, strict=True), key=lambda item: item[1])


def _is_line(loop: Loop) -> bool:
    """True if all points lie on a line."""
    away = loop - loop[0]
    farthest = away[np.argmax(np.sum(away**2, axis=1))]
    across = np.abs(away @ [-farthest[1], farthest[0]])
    return bool(np.max(across) <= MET * float(farthest @ farthest))


def _area(loop: Loop) -> float:
    x, y = (loop - loop[0]).T
    return abs(float(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))) / 2


def _lies_inside(loop: Loop, larger: Loop, touching: float, path: Any) -> bool:
    """True for an outline inside a larger one, False beside it."""
    inside, outside = sides_of(loop, larger, touching)
    if inside == outside:
        raise _overlap(path, "another outline overlaps that which begins at", loop[0])
    return inside


def _overlap(path: Any, words: str, place: np.ndarray) -> FileError:
    x, y = place
    return FileError(f"{path}: {words} ({x:.6g}, {y:.6g}) m; join or part them in the drawing, or remove one")
