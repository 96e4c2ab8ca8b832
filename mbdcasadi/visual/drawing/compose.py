"""The scene of a mechanism: bodies, symbols, loads, names and traces, over the times of a sample."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ...errors import MechanismError
from ...model.bodies import Body, Marker, ground
from ...model.drivers import Actuator
from ...model.joints.gears import Gear
from ...model.joints.lower_pairs import Distance, Translational
from ...model.mechanism import Mechanism
from ..symbols import glyph, glyph_of
from . import lines, scene
from .labels import wrapped
from .loads import Load, draw_loads, draw_velocities
from .outlines import places_on, points_on, shape_loops
from .pen import Frame, Pen
from .sample import Sample
from .scene import Label, Scene

#: The unit of symbols: a part of the picture's diagonal, at most a part of the shortest link, and at least a part.
UNIT, OF_LINK, LEAST = 0.019, 0.19, 0.007


@dataclass(frozen=True)
class Options:
    """Options of a drawing beside bodies and symbols.

    Attributes
    ----------
    forces, names, frames : bool
        Reactions and all forces, names of bodies and joints, axes of bodies.
    centroids : bool or tuple of Body
        Centres of mass of all bodies, or of some.
    trace : tuple of Marker or casadi.SX
        Points whose path is drawn.
    tooltips : bool
        True if items carry numbers.
    velocities : bool
        True if velocities of the centres of mass are drawn, as a group that can be left out.
    """

    forces: bool = False
    names: bool = False
    frames: bool = False
    centroids: bool | tuple[Body, ...] = False
    trace: tuple[Marker | ca.SX, ...] = ()
    tooltips: bool = False
    velocities: bool = False

    @property
    def paths(self) -> ca.SX:
        """Positions of the traced points, one after the other (2k,)."""
        places = [place.position if isinstance(place, Marker) else place for place in self.trace]
        return ca.vertcat(ca.SX(0, 1), *places)


def compose(sample: Sample, options: Options) -> tuple[Scene, dict[str, float]]:
    """Describe a mechanism as a scene.

    Parameters
    ----------
    sample : Sample
        The times; places that parts take over all of them shape guides, racks and the size of symbols.
    options : Options
        Mechanism that is drawn.

    Returns
    -------
    Scene, dict of str to float
        The scene, and the scale of forces (N per m) and couples (N m per m) if there are arrows.
    """
    mechanism, with_centroids = sample.mechanism, _with_centroids(sample.mechanism, options)
    unit, hanging = _measures(sample)
    traced = [place for place in options.trace if isinstance(place, Marker)]
    pen = Pen(sample, Scene(unit), hanging, traced)

    def draw(thing: Any) -> None:
        pen.item = pen.item_of(thing, lambda: glyph_of(thing, pen).tooltip() if options.tooltips else {})
        glyph(thing, pen)

    # sliders last: rails fit to what other symbols draw of the body
    joints = sorted(mechanism.joints, key=lambda joint: isinstance(joint, Translational))
    for element in (*mechanism.drivers, *joints, *mechanism.forces):
        draw(element)
    for body in mechanism.bodies:
        draw(body)
        if body in with_centroids:
            _centroid(pen, body)
        if options.frames:
            _axes(pen, body)
        for marker in (marker for marker in traced if marker.body is body):
            pen.dot(pen.on(marker))
    pen.item = None
    if options.frames:
        _axes(pen, ground)
    pen.finish()
    scale = draw_loads(pen, _loads(pen, options))
    if options.velocities:
        scale |= draw_velocities(pen)
    pen.scene.traces += [pen.point(place).number for place in options.trace]
    if options.names:
        _names(pen)
    # a body covers those before it in the list, whatever its marks were drawn for
    pen.scene.marks.sort(key=_depth)
    return pen.scene, scale


def _with_centroids(mechanism: Mechanism, options: Options) -> Sequence[Body]:
    """Bodies whose centres of mass are drawn."""
    asked = options.centroids or () if options.centroids is not True else mechanism.bodies
    strange = [body.name for body in asked if body not in mechanism.bodies]
    if strange:
        raise MechanismError(f"centroids= names body '{strange[0]}', which is not in the mechanism")
    return asked


def _loads(pen: Pen, options: Options) -> list[tuple[Any, Load]]:
    """Loads of elements that are drawn."""
    mechanism = pen.sample.mechanism
    elements = [*mechanism.joints, *mechanism.drivers, *mechanism.forces]
    return [(e, load) for e in elements for load in glyph_of(e, pen).loads() if options.forces or load.always]


def _depth(mark: scene.Mark) -> tuple[int, int]:
    return mark.layer, mark.body if mark.layer == scene.BODY and mark.body is not None else -1


def _measures(sample: Sample) -> tuple[float, bool]:
    """Unit of symbols, m, and True if the mechanism hangs from its supports."""
    mechanism = sample.mechanism
    elements = [*mechanism.joints, *mechanism.forces]
    markers = [m for e in elements for m in getattr(e, "markers", ())]
    centres = sample[ca.vertcat(*[b.position for b in mechanism.bodies])].reshape(-1, 2)
    places = sample[ca.vertcat(ca.SX(0, 1), *[m.position for m in markers])].reshape(-1, 2)
    reach = [_reach(body) for body in mechanism.bodies] + [_radius(e, sample) for e in elements]
    every = np.vstack([centres, places])
    diagonal = float(np.hypot(*np.ptp(every, axis=0))) + 1.4 * max(reach)
    if not np.isfinite(diagonal):
        raise MechanismError("the poses to be drawn are not finite")
    diagonal = diagonal or 1.0
    probe = Pen(sample, Scene(LEAST * diagonal))
    apart = [
        np.hypot(*(p - q))
        for body in mechanism.bodies
        for points in [points_on(body, mechanism.joints, probe)]
        for k, p in enumerate(points)
        for q in points[:k]
    ]
    unit = max(min([UNIT * diagonal, *(OF_LINK * d for d in apart)]), LEAST * diagonal)
    fixed = [m for e in mechanism.joints if ground in e.bodies for m in getattr(e, "markers", ())]
    if not fixed:
        return unit, False
    supports = sample[ca.vertcat(*[m.position for m in fixed])].reshape(-1, 2)
    return unit, bool(centres[:, 1].mean() < supports[:, 1].mean() - 0.08 * diagonal)


def _reach(body: Body) -> float:
    if body.shape is None:
        return 0.0
    return float(np.max(np.hypot(*np.vstack(shape_loops(body, 0.0)).T)))


def _radius(element: Any, sample: Sample) -> float:
    """Largest radius of an element: of gears, wheels, discs, cams."""
    radii = [getattr(element, name, 0.0) for name in ("radius", "radius_a", "radius_b")]
    radii += [getattr(getattr(element, side, None), "radius", 0.0) for side in "ab"]
    radii += [getattr(getattr(element, "outline", None), "size", 0.0) / 2]
    return max(abs(sample.number(radius)) for radius in radii if radius is not None)


# --- on request ---------------------------------------------------------------------------
def _centroid(pen: Pen, body: Body) -> None:
    """The sign of a centre of mass: a disc with two quarters filled."""
    r, frame = 0.6 * pen.unit, pen.of_body(body)
    frame.area("centroid", lines.circle((0, 0), r, 32), layer=scene.PIN)
    for start in (0, np.pi):
        frame.area("centroid quarters", np.vstack([[[0, 0]], lines.arc(r, start, np.pi / 2, 12)]), layer=scene.PIN)


def _axes(pen: Pen, body: Body) -> None:
    """The frame of a body as two arrows."""
    u, frame = pen.unit, pen.of_body(body)
    for style, turn in (("x axis", 0.0), ("y axis", np.pi / 2)):
        shaft, head = lines.arrow(3.6 * u, 1.0 * u)
        frame.draw(style, lines.turned(shaft, turn), lines.turned(head[[1, 0, 2]], turn), layer=scene.ARROW)


def _names(pen: Pen) -> None:
    """Names of bodies at their material, of joints at their markers, and of actuators at their middles."""
    u, mechanism = pen.unit, pen.sample.mechanism
    for body in mechanism.bodies:
        points = points_on(body, mechanism.joints, pen)
        middle = points.mean(axis=0) if len(points) > 1 and body.shape is None else np.zeros(2)
        number = pen.of_body(body).number
        own = [mark for mark in pen.scene.marks if mark.frame == number and mark.style == "body"]
        first, *others = places_on([loop for mark in own for loop in mark.loops], middle)
        name = Label(number, first, wrapped([body.name]), items=(pen.item_of(body),), others=tuple(others))
        pen.scene.labels.append(name)
    named: dict[tuple, tuple[Frame, list[Any]]] = {}
    for element in (*mechanism.joints, *mechanism.drivers):
        markers = getattr(element, "markers", ())
        if isinstance(element, Gear):
            frame = pen.at(_mesh_point(element, pen))
        elif isinstance(element, Distance | Actuator):
            frame = pen.at((element.a.position + element.b.position) / 2)
        elif markers:
            # a slider is named at its block, not at the start of its guide
            frame = pen.on(next((m for m in reversed(markers) if not m.body.is_ground), markers[0]))
        else:
            continue
        (place,) = scene.placed(frame.shift[None], pen.first(pen.scene.frames[frame.number].pose))
        named.setdefault(tuple(np.round(place / u, 2)), (frame, []))[1].append(element)
    for frame, elements in named.values():
        # the symbol of a pair of gears are the gears, and its name belongs to the point at which they mesh
        items = tuple(pen.item_of(element) for element in elements if not isinstance(element, Gear))
        names = wrapped([element.name for element in elements])
        pen.scene.labels.append(Label(frame.number, (frame.shift[0], frame.shift[1]), names, False, items))


def _mesh_point(joint: Gear, pen: Pen) -> ca.SX:
    """Point (2,) at which two gears mesh, m: on the line of their centres, at the pitch radius of the first."""
    apart = joint.b.position - joint.a.position
    outside = joint.internal and pen.number(joint.radius_a) < pen.number(joint.radius_b)
    side = -1 if outside else 1  # a gear inside a ring touches it on the side away from the ring's centre
    return joint.a.position + side * joint.radius_a * apart / ca.norm_2(apart)
