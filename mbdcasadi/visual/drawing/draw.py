"""Drawings of a mechanism: bodies and joints in the symbols of textbooks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal

import casadi as ca
import numpy as np

from ...errors import MechanismError
from ...model.bodies import Body, Marker
from ...model.mechanism import Mechanism
from ...model.quantities import whole, yes_or_no
from ...results.state import State
from ...results.trajectory import Trajectory
from ...simulation.assemble import assemble
from ..axes import two_spines
from .canvas import LOWEST, STEP, Canvas
from .compose import Options, compose
from .labels import LINE, with_placed_names
from .sample import Sample
from .scene import TRACE, Scene, box_of, diagonal_of
from .style import LIGHT

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Width of a figure, inches, and the bounds of its height to its width.
WIDTH, FLAT, TALL = 7.2, 0.34, 1.1
#: Least width of a picture to its height.
NARROW = 0.4
#: Times at which traces are taken, or a few more.
TIMES = 300
#: Height of a line of the scale of forces, in parts of the picture's diagonal.
ROW = 0.045
#: Room of a number beside the axes, points, across and upwards.
TICKS = (42.0, 22.0)
_AXES: tuple[Literal["x", "y"], ...] = ("x", "y")
#: Opacity of poses behind the first: of those between, and of the last.
BETWEEN, LAST = 0.2, 0.55


def draw(
    source: Any,
    axes: Axes | None = None,
    *,
    forces: bool = False,
    names: bool = False,
    frames: bool = False,
    centroids: bool | Sequence[Body] = False,
    trace: Any = (),
    poses: int | None = None,
) -> Axes:
    """Draw a mechanism: bodies from their shapes or their markers, joints and forces as symbols.

    Parameters
    ----------
    source : State, Trajectory, Solution, Equilibrium, Mechanism or library model
        Subject of the drawing. A mechanism is assembled first; of a motion the first pose is
        drawn, and others behind it if `poses` are asked for.
    axes : matplotlib.axes.Axes, optional
        Axes to draw into, which the drawing fills; by default those of a new figure.
    forces : bool, default False
        True if reactions (green), all applied forces (red) and weights (grey) are
        drawn, to scale; forces of :class:`Force` elements always are.
    names, frames : bool, default False
        True if bodies and joints are named, and the axes of bodies drawn.
    centroids : bool or sequence of Body, default False
        True if the centres of mass of all bodies are drawn, or the bodies of which they are.
    trace : sequence of Marker, Body or expression (2,)
        Points whose path is drawn, of a motion.
    poses : int, optional
        Number of poses of a motion to draw, at equal distances in time: the first
        in full strength, the last weaker, those between faint. By default 1.

    Returns
    -------
    matplotlib.axes.Axes
        ``axes.figure.savefig(path)`` writes it.

    Raises
    ------
    MechanismError
        If something cannot be drawn, and for a trace or several poses of a single state.

    Examples
    --------
    >>> import mbdcasadi as mbd
    >>> axes = mbd.draw(mbd.library.four_bar(), names=True)
    """
    from matplotlib.figure import Figure

    pictured = subject(source)
    if not isinstance(pictured, Trajectory) and poses is not None:
        raise MechanismError("draw: poses= is for motions; this is one state")
    flags = {"forces": forces, "names": names, "frames": frames}
    options = trace_options(trace, **{name: yes_or_no(value, "draw", name) for name, value in flags.items()})
    options = replace(options, centroids=centroids_of(centroids, "draw"))
    if options.trace and not isinstance(pictured, Trajectory):
        raise MechanismError("draw: a trace is the path of a point over a motion; this is one state")
    count = 1 if poses is None else whole(poses, "draw", "poses", 1)
    if axes is not None and not hasattr(axes, "set_xlim"):
        raise MechanismError(f"draw: axes= takes axes of Matplotlib, got {axes!r}")
    if axes is None:
        axes = Figure(layout="constrained").subplots()
        fresh = True
    else:
        fresh = False
    sample, shown = _sample(pictured, count, bool(options.trace))
    if options.forces:
        sample.need_reactions("draw")
    _draw(sample, options, axes, shown, fresh)
    return axes


def _sample(source: State | Trajectory, count: int, traced: bool) -> tuple[Sample, np.ndarray]:
    """Sample of a source, and numbers of the times whose poses are drawn, at equal distances."""
    if isinstance(source, State) or not len(source) or not (traced or count > 1):
        return Sample(source), np.array([0])
    if not source.interpolates:
        wanted = np.linspace(source.t[0], source.t[-1], count)
        return Sample(source), np.unique([int(np.argmin(np.abs(source.t - time))) for time in wanted])
    between = -(-TIMES // max(count - 1, 1))
    times = np.linspace(source.t[0], source.t[-1], max(count - 1, 1) * between + 1)
    stored = source.t[[int(np.argmin(np.abs(source.t - time))) for time in times]]  # what is known is not sought again
    times = np.where(np.abs(stored - times) < np.diff(times).min() / 2, stored, times)
    return Sample(source, times), between * np.arange(count)


def _draw(sample: Sample, options: Options, axes: Axes, shown: np.ndarray, fresh: bool) -> None:
    scene, scale = compose(sample, options)
    poses = scene.poses(sample)
    ghost = replace(scene.without("loads"), labels=[])
    for k in shown[:0:-1]:
        Canvas(axes, ghost, strength=LAST if k == shown[-1] else BETWEEN, still=False).show(poses[k], sample.t[k])
    paths = draw_traces(axes, sample, options)
    box = room(scene, poses[shown], paths)
    frame_axes(axes, with_scale_room(box, scale), fresh)
    points, seen = (np.inf, corners(axes)) if fresh and not scene.labels else _settle(axes, fresh)
    if scale:  # names stay below it
        seen[1, 1] = draw_scale(axes, scale, box, seen[1] - [scene.unit, 0], LINE / points) - 0.8 * LINE / points
    Canvas(axes, with_placed_names(scene, poses[:1], seen, points)).show(poses[0], sample.t[0])


def _settle(axes: Axes, fresh: bool) -> tuple[float, np.ndarray]:
    """Fill the place that axes of the caller have; return the points of the paper to a metre, and the corners shown."""
    figure = axes.figure.canvas.figure
    layout = figure.get_layout_engine()
    first = box = corners(axes)
    for _ in range(1 if fresh else 2):  # a wider drawing leaves another room beside it
        if layout is not None:
            layout.execute(figure)
        place = axes.get_position(original=True).transformed(axes.figure.transSubfigure)
        size = 72 / figure.dpi * np.array([place.width, place.height])
        points = float(np.min(size / (first[1] - first[0])))
        if not fresh:
            box = first + (size / points - (first[1] - first[0])) / 2 * np.array([[-1], [1]])
            _show_box(axes, box)
    _set_ticks(axes, box, points)
    return points, box


# --- contents -------------------------------------------------------------------------
def subject(source: Any) -> State | Trajectory:
    """State or trajectory of anything that can be drawn; a mechanism is assembled."""
    for name in ("trajectory", "state", "mechanism"):
        if isinstance(source, State | Trajectory | Mechanism):
            break
        source = getattr(source, name, source)
    if isinstance(source, Mechanism):
        return assemble(source)
    if isinstance(source, State | Trajectory):
        return source
    raise MechanismError(f"draw: takes a state, a motion, a solution or a mechanism, got {source!r}")


def motion_of(source: Any, what: str) -> Trajectory:
    """Motion of a trajectory or a solution, with times in it."""
    motion = subject(source)
    if not isinstance(motion, Trajectory) or not len(motion):
        raise MechanismError(f"{what}: takes a motion, as simulate and kinematics return it, got {source!r}")
    return motion


def centroids_of(value: Any, what: str) -> bool | tuple[Body, ...]:
    """True or False, or bodies whose centres of mass are drawn."""
    if not isinstance(value, Sequence) or isinstance(value, str):
        return yes_or_no(value, what, "centroids")
    strange = [body for body in value if not isinstance(body, Body)]
    if strange:
        raise MechanismError(f"{what}: centroids= takes True, False or a list of bodies, got {strange[0]!r} in it")
    return tuple(value)


def trace_options(trace: Any, **more: bool) -> Options:
    """Options with the points (2,) of markers, bodies and expressions."""
    listed = [trace] if isinstance(trace, Marker | Body | ca.SX) else trace
    if not isinstance(listed, Sequence):
        raise MechanismError(f"trace= takes a list of markers, got {trace!r}")
    places: list[Marker | ca.SX] = []
    for point in listed:
        place = point.position if isinstance(point, Body) else point
        if not isinstance(place, Marker) and (not isinstance(place, ca.SX) or place.numel() != 2):
            raise MechanismError(f"trace= takes markers, bodies or expressions of two components, got {point!r}")
        places.append(place if isinstance(place, Marker) else ca.vec(place))
    return Options(trace=tuple(places), **more)


# --- axes ------------------------------------------------------------------------------------
def draw_traces(axes: Axes, sample: Sample, options: Options) -> np.ndarray:
    """Draw paths of points, and return all places on them (k, 2)."""
    paths = sample[options.paths].reshape(len(sample.t), -1, 2)
    for path in paths.transpose(1, 2, 0):
        axes.plot(*path, color=LIGHT["trace"], linewidth=1.3, zorder=LOWEST + STEP * TRACE, solid_capstyle="round")
    return paths.reshape(-1, 2)


def room(scene: Scene, poses: np.ndarray, paths: np.ndarray) -> np.ndarray:
    """Corners about marks and paths, with a margin; very long arrows of forces may reach out of it."""
    box = box_of(scene.without("loads").marks, poses)
    if len(paths):
        box = np.array([np.minimum(box[0], paths.min(axis=0)), np.maximum(box[1], paths.max(axis=0))])
    diagonal = diagonal_of(box)
    loads = [m for m in scene.marks if m.group]
    if loads:
        low, high = box_of(loads, poses)
        reach = 0.25 * diagonal
        box = np.array([np.minimum(box[0], np.maximum(low, box[0] - reach)),
                        np.maximum(box[1], np.minimum(high, box[1] + reach))])  # fmt: skip
    margin = 1.2 * scene.unit + 0.03 * diagonal
    return box + margin * np.array([[-1], [1]])


def frame_axes(axes: Axes, box: np.ndarray, fresh: bool) -> None:
    """Equal scales, units, and a new figure with the proportions of the drawing."""
    width, height = box[1] - box[0]
    if fresh and width < NARROW * height:
        box = box + (NARROW * height - width) / 2 * np.array([[-1, 0], [1, 0]])
        width = NARROW * height
    if fresh:
        ratio = min(max(height / width, FLAT), TALL)
        axes.figure.set_size_inches(WIDTH if ratio < 0.8 else WIDTH * 0.8 / ratio + 0.6, min(WIDTH * ratio, 6.4) + 0.6)  # type: ignore[union-attr]
    _show_box(axes, box)
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlabel("x, m")
    axes.set_ylabel("y, m")
    two_spines(axes)
    _set_ticks(axes, box)


def _set_ticks(axes: Axes, box: np.ndarray, points: float = np.inf) -> None:
    """Number the axes: the longer one up to seven times, and no more often than there is room for at a scale."""
    lengths = box[1] - box[0]
    for axis, length, tick in zip(_AXES, lengths, TICKS, strict=True):
        usual = max(2, round(7 * length / lengths.max()))
        axes.locator_params(axis=axis, nbins=int(np.clip(points * length / tick, 1, usual)))


def corners(axes: Axes) -> np.ndarray:
    """Return the corners ``[[x, y], [x, y]]`` of what axes show."""
    return np.array([axes.get_xlim(), axes.get_ylim()]).T


def _show_box(axes: Axes, box: np.ndarray) -> None:
    axes.set_xlim(box[0, 0], box[1, 0])
    axes.set_ylim(box[0, 1], box[1, 1])


def with_scale_room(box: np.ndarray, scale: dict[str, float]) -> np.ndarray:
    """Return the corners with room for the scale of forces above them."""
    return np.array([box[0], box[1] + [0, len(scale) * ROW * diagonal_of(box)]])


def draw_scale(axes: Axes, scale: dict[str, float], box: np.ndarray, corner: np.ndarray, least: float = 0.0) -> float:
    """Draw an arrow of a round force, and the radius of a round couple.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        Axes to draw into.
    scale : dict of str to float
        Newtons of an arrow, and newton metres of a curved one, of the size 1 m.
    box : numpy.ndarray
        Corners of the drawing without the scale, m.
    corner : numpy.ndarray
        Upper right end (2,) of the room that is left for it, m.
    least : float, default 0
        Least height of a line, m.

    Returns
    -------
    float
        Height of the lowest line, m.
    """
    from matplotlib.ticker import EngFormatter

    diagonal = diagonal_of(box)
    row = max(ROW * diagonal, least)
    right, lowest = float(corner[0]), float(corner[1]) - len(scale) * row
    place = lowest
    for kind, share in (("N", 0.13), ("N m", 0.05)):
        if kind in scale:
            value = nice(share * diagonal * scale[kind])
            length = value / scale[kind]
            ends = dict(arrowstyle="-|>" if kind == "N" else "|-|, widthA=0.25, widthB=0.25", color=LIGHT["ink"],
                        shrinkA=0, shrinkB=0, linewidth=1.2, mutation_scale=10)  # fmt: skip
            axes.annotate("", (right, place), (right - length, place), arrowprops=ends)
            text = EngFormatter(kind)(value) if value >= 1e3 else f"{value:g} {kind}"
            text += " (radius)" if kind == "N m" else ""
            axes.annotate(text, (right - length, place), (-5, 0), textcoords="offset points", ha="right", va="center",
                          fontsize="small", color=LIGHT["ink"])  # fmt: skip
            place += row
    return lowest


def nice(value: float) -> float:
    """A number of the kind 1, 2 or 5 times a power of ten, not above the value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(f for f in (1, 2, 5) if f * power <= value * (1 + 1e-12)))
