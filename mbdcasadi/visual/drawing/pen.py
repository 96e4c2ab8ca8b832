"""Pen that draws symbols: it knows the scene, its scale, and the values of expressions."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np

from ...model.bodies import Body, Marker
from ...model.geometry.shapes import Disc
from . import lines, scene
from .sample import Sample
from .scene import Mark, MovingFrame, Scene

#: Mean height of a body above its pin, in parts of the distance, from which on it hides a support on its side.
HIDES = 0.8
#: Shortest way that counts, in units of symbols: the size of a mechanism may be anything.
NOTHING = 1e-7


class Frame:
    """Frame that marks are put into: a frame of the scene, and a fixed place in it.

    Parameters
    ----------
    pen : Pen
        Whose scene it is.
    number : int
        Number of the frame in the scene.
    shift : numpy.ndarray
        Place in it (2,), m.
    angle : float
        Angle in it, rad.
    body : Body or None
        Body whose colour marks have.
    """

    def __init__(self, pen: Pen, number: int, shift: Any = (0.0, 0.0), angle: float = 0.0, body: Body | None = None):
        self.pen, self.number, self.shift, self.angle, self.body = pen, number, np.asarray(shift, float), angle, body

    @property
    def solid(self) -> str:
        """Style of areas of the body that the frame belongs to, or of the ground."""
        return "ground" if self.body is None else "body"

    def local(self, points: Any) -> np.ndarray:
        """Points as they lie in the frame of the scene."""
        points = np.atleast_2d(np.asarray(points, float))
        if points.shape[1] == 4:
            return points + np.array([self.shift[0], 0.0, self.shift[1], 0.0])
        return self.shift + lines.turned(points, self.angle)

    def draw(self, style: str, *loops: Any, closed: bool = False, layer: int = scene.SPRING, group: str = "",
             step: Any = None) -> None:  # fmt: skip
        """Put lines, or areas if they close, into the frame; with a step (2,), m, a piece of a line without an end."""
        body = None if self.body is None else self.pen.number_of(self.body)
        placed = tuple(self.local(points) for points in loops if len(points))
        if placed:
            if style == "body" and self.body is not None:
                self.pen.loops.setdefault(self.body, []).extend(placed)
            along = None if step is None else tuple(lines.turned(np.asarray(step, float), self.angle).tolist())
            mark = Mark(self.number, placed, closed, style, layer, body, self.pen.item, group, along)
            self.pen.scene.marks.append(mark)

    def area(self, style: str, *loops: Any, layer: int = scene.BODY, group: str = "") -> None:
        """Put closed areas into the frame; a loop that runs clockwise is a hole."""
        self.draw(style, *loops, closed=True, layer=layer, group=group)


class Pen:
    """Draws the symbols of elements into a scene.

    Parameters
    ----------
    sample : Sample
        The times that are drawn.
    target : Scene
        Scene that marks are added to.

    Attributes
    ----------
    unit : float
        The length that symbols are made of, m: a pin has the radius 0.55.
    item : int or None
        Number of the item that marks are part of.
    replaced : dict of Body to float
        Bodies of which a symbol draws the outline (a gear, a cam), and its largest radius, m.
    teeth : dict
        Gears that are drawn: (body, place, radius, inside) to (count, phase).
    loops : dict of Body to list of numpy.ndarray
        Areas (k, 2) of bodies that symbols have drawn, in the bodies' frames, m.
    stands, arrows : set
        Places with a support or a curved arrow.
    hanging : bool
        True if the mechanism hangs from its supports.
    traced : tuple of Marker
        Points of bodies whose path is drawn.
    """

    def __init__(self, sample: Sample, target: Scene, hanging: bool = False, traced: Sequence[Marker] = ()):
        self.sample, self.scene, self.unit, self.hanging = sample, target, target.unit, hanging
        self.traced = tuple(traced)
        self.item: int | None = None
        self.replaced: dict[Body, float] = {}
        self.teeth: dict[Any, tuple[int, float]] = {}
        self.loops: dict[Body, list[np.ndarray]] = {}
        self.stands: set[tuple] = set()
        self.arrows: set[tuple] = set()
        self._numbers = {body: k for k, body in enumerate(sample.mechanism.bodies)}
        self._frames: dict[Any, int] = {}
        self._items: dict[Any, int] = {}
        self._later: list[tuple[int | None, Callable[[np.ndarray], None]]] = []

    def item_of(self, thing: Any, tooltip: Callable[[], dict[str, ca.SX]] = dict) -> int:
        """Number of the item of a body or an element, made when it is first asked for."""
        if thing not in self._items:
            self._items[thing] = len(self.scene.items)
            kind = "body" if isinstance(thing, Body) else type(thing).__name__
            self.scene.items.append(scene.Item(thing.name, kind, tooltip(), self.sample.appearances(thing)))
        return self._items[thing]

    # --- numbers -----------------------------------------------------------------------------
    def number_of(self, body: Body) -> int | None:
        """Number of a body in the mechanism; None for the ground."""
        return self._numbers.get(body)

    def number(self, expression: Any) -> float:
        """Value of a scalar at the first time."""
        return self.sample.number(expression)

    def over(self, *expressions: Any) -> np.ndarray:
        """Values (n_t, k) of scalars over all times."""
        return self.sample[ca.vertcat(*[ca.SX(e) for e in expressions])]

    def first(self, *expressions: Any) -> np.ndarray:
        """Values (k,) of scalars at the first time."""
        return self.sample.first(ca.vertcat(*[ca.SX(e) for e in expressions]))

    def span(self, expression: Any) -> tuple[float, float]:
        """Least and largest value of a scalar over all times."""
        values = self.over(expression)
        return float(values.min()), float(values.max())

    def at_one_place(self, first: Marker, second: Marker) -> bool:
        """Return True if two markers sit at the same point of the same body."""
        if first.body is not second.body:
            return False
        return self.vanishes(self.first(first.local - second.local))

    def vanishes(self, way: np.ndarray) -> bool:
        """Return True if a way (2,), m, is nothing beside the symbols of the picture."""
        return bool(np.hypot(*way) <= NOTHING * self.unit)

    # --- frames ------------------------------------------------------------------------------
    def ground(self) -> Frame:
        """The global frame."""
        return Frame(self, 0)

    def of_body(self, body: Body) -> Frame:
        """Centroidal frame of a body."""
        if body.is_ground:
            return self.ground()
        if body not in self._frames:
            self._frames[body] = self.scene.add(MovingFrame(body.position, body.phi))
        return Frame(self, self._frames[body], body=body)

    def on(self, marker: Marker) -> Frame:
        """Frame of a marker, fixed in its body."""
        base = self.of_body(marker.body)
        if not (ca.vertcat(marker.local, marker.local_angle).is_constant() or self._is_fixed(marker)):
            return self._added(MovingFrame(marker.position, marker.angle), base.body)
        x, y, angle = self.first(marker.local, marker.local_angle)
        return Frame(self, base.number, (x, y), angle, base.body)

    def _is_fixed(self, marker: Marker) -> bool:
        if self.sample.varies(ca.vertcat(marker.local, marker.local_angle)):
            return False
        values = self.over(marker.local, marker.local_angle)
        return bool(np.ptp(values, axis=0).max() <= 1e-12)

    def at(self, position: Any, angle: Any = 0.0, body: Body | None = None) -> Frame:
        """Frame at a point and an angle that are expressions."""
        return self._added(MovingFrame(ca.SX(position), ca.SX(angle)), body)

    def along(self, position: Any, direction: Any) -> Frame:
        """Frame at a point whose x axis goes along a vector."""
        return self._added(MovingFrame(ca.SX(position), vector=ca.vec(ca.SX(direction))))

    def between(self, start: Any, end: Any, body: Body | None = None) -> Frame:
        """Frame whose x axis runs from one point to another, as long as their distance."""
        frame = self.vector(start, ca.SX(end) - ca.SX(start), 1.0)
        frame.body = body
        return frame

    def point(self, place: Any) -> Frame:
        """Frame at a marker or a point, with the axes of the ground."""
        position, anchor = self._origin(place)
        return self._added(MovingFrame(position, anchor=anchor))

    def vector(self, place: Any, vector: Any, scale: float, unit: str = "") -> Frame:
        """Frame at a marker or a point along a vector, as long as the vector times a scale."""
        position, anchor = self._origin(place)
        return self._added(MovingFrame(position, vector=ca.vec(ca.SX(vector)), scale=scale, anchor=anchor, unit=unit))

    def scaled(self, place: Any, value: Any, scale: float, unit: str = "") -> Frame:
        """Frame at a marker or a point, as long as a scalar times a scale, and mirrored if that is negative."""
        position, anchor = self._origin(place)
        return self._added(MovingFrame(position, length=scale * ca.SX(value), anchor=anchor, unit=unit))

    def _added(self, moving: MovingFrame, body: Body | None = None) -> Frame:
        return Frame(self, self.scene.add(moving), body=body)

    def _origin(self, place: Any) -> tuple[ca.SX, tuple[int, float, float] | None]:
        if not isinstance(place, Marker):
            return ca.SX(place), None
        frame = self.on(place)
        return place.position, (frame.number, float(frame.shift[0]), float(frame.shift[1]))

    # --- drawn at the end -----------------------------------------------------------------------
    def later(self, draw: Callable[[np.ndarray], None]) -> None:
        """Defer a mark until the extent of all others is known: ``draw(box)`` with ``[[x, y], [x, y]]``, m."""
        self._later.append((self.item, draw))

    def finish(self) -> None:
        """Draw the deferred marks."""
        if not self._later:
            return
        box = self.box()
        for item, draw in self._later:
            self.item = item
            draw(box)
        self._later = []

    def box(self) -> np.ndarray:
        """Corners of all that is drawn so far, over all times."""
        return scene.box_of(self.scene.marks, self.scene.poses(self.sample))

    # --- common pieces -------------------------------------------------------------------------
    def pin(self, frame: Frame, radius: float = 0.55) -> None:
        """The circle of a pin."""
        frame.area("pin", lines.circle((0, 0), radius * self.unit), layer=scene.PIN)

    def dot(self, frame: Frame, radius: float = 0.25) -> None:
        """A filled point."""
        frame.area("dot", lines.circle((0, 0), radius * self.unit, 24), layer=scene.PIN)

    def hatched(self, frame: Frame, start: Any, end: Any, layer: int = scene.GROUND, step: Any = None) -> None:
        """A line of the ground, hatched to the right of the line from start to end."""
        u = self.unit
        frame.draw("hatch", *lines.hatching(np.array([start, end]), 0.62 * u, 0.75 * u), layer=layer, step=step)
        frame.draw("ground line", [start, end], layer=layer, step=step)

    def wall(self, frame: Frame, start: Any, end: Any, endless: bool = False) -> None:
        """A surface to the left of the line from start to end: hatched on the ground, a line on a body."""
        step = np.subtract(end, start) if endless else None
        if frame.body is None:
            self.hatched(frame, start, end, step=step)
        else:
            frame.draw("body line", [start, end], layer=scene.GUIDE, step=step)

    def is_new(self, place: np.ndarray, taken: set[tuple]) -> bool:
        """Return True if nothing of a kind, there at the same times, is drawn at a place (2,) yet, and take it."""
        appearances = None if self.item is None else self.scene.items[self.item].appearances
        key = (*np.round(place / self.unit, 3), appearances)
        new = key not in taken
        taken.add(key)
        return new

    def stand(self, frame: Frame, body: Body | None = None) -> None:
        """Support of a pin on the ground: a triangle on hatching, or under it if the mechanism, or the body, hangs."""
        place = frame.shift if frame.number == 0 else self.first(self.scene.frames[frame.number].position)
        if not self.is_new(place, self.stands):
            return
        u, sign = self.unit, self._side(place, body)
        upright = Frame(self, frame.number, frame.shift, 0.0)
        feet = np.array([[-1.15, -1.9], [1.15, -1.9]]) * u * sign
        corners = np.array([[0.32, 0.5], [-0.32, 0.5]]) * u * sign
        upright.area("ground", lines.convex_hull(np.vstack([feet, corners])), layer=scene.SUPPORT)
        ends = np.array([[-1.7, -1.9], [1.7, -1.9]]) * u * sign
        self.hatched(upright, ends[0], ends[1], layer=scene.SUPPORT)

    def _side(self, place: np.ndarray, body: Body | None) -> float:
        """Return 1 for a support below a pin and -1 above it: on the side where the body is not, on average."""
        usual = -1.0 if self.hanging else 1.0
        if body is None or body.is_ground:
            return usual
        away = self.over(body.x, body.y) - place
        lengths = np.hypot(*away.T)
        if lengths.min() < self.unit:
            return usual
        height = float(np.mean(away[:, 1] / lengths))
        return float(np.sign(height)) if abs(height) > HIDES else usual

    def replaces(self, body: Body, radius: float) -> None:
        """Declare that a symbol draws the outline of a body, up to a radius."""
        if not body.is_ground:
            self.replaced[body] = max(self.replaced.get(body, 0.0), radius)

    def covers(self, body: Body) -> bool:
        """Return True if a symbol draws the shape of a body."""
        disc = isinstance(body.shape, Disc) and body.shape.radius <= 1.001 * self.replaced.get(body, 0.0)
        return body in self.replaced and (body.shape is None or disc)

    def curve(self, point: Callable[[Any], Any], places: np.ndarray) -> np.ndarray:
        """Points (k, 2) of a curve that may hold parameters of the mechanism."""
        place = ca.SX.sym("place")
        symbols = ca.vertcat(ca.SX(0, 1), *self.sample.mechanism.parameters)
        function = ca.Function("curve", [place, symbols], [ca.densify(point(place))])
        return np.array([function(float(x), self.sample.parameters).full().ravel() for x in places])
