"""A page in which the browser solves a mechanism that the reader moves with sliders and the pointer."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from ..errors import MechanismError, MechanismWarning
from ..model.bodies import Body
from ..model.symbols import positive
from ..numerics.writing import whole_file, writable
from ..results.columns import read_lines
from ..results.state import State
from ..results.trajectory import Trajectory
from ..simulation.simulate import simulate
from .animation import Animation
from .drawing.compose import Options, compose
from .drawing.draw import room
from .drawing.labels import with_placed_names
from .drawing.sample import Sample
from .film import PAPER, Film
from .page.columns import Column, Columns
from .page.live_model import LiveModel
from .page.page import filled, page_data

#: Seconds of motion by which the picture and its arrows are sized, and poses that are looked at.
PREVIEW, POSES = 3.0, 61
#: Most bytes of a page.
LARGEST_PAGE = 1_000_000
#: Digits with which a live number is shown.
DECIMALS = 12
_STYLES = ("page.css", "live/page.css")
_SCRIPTS = (
    "frames.js", "live/linear.js", "live/equations.js", "live/assembly.js", "live/integrators.js", "live/engine.js",
    "stage.js", "plots.js", "svg.js", "panel.js", "live/player.js",
)  # fmt: skip


class LiveAnimation(Animation):
    """A mechanism that moves in a page, which solves its equations; shows itself in a notebook.

    Attributes
    ----------
    film : Film
        The picture at the start.
    forces : bool
        True if forces are shown from the start.
    html : str
        The page, with everything that it needs in it.
    """

    def __init__(self, model: LiveModel, film: Film, forces: bool):
        super().__init__(film, forces)
        self._model = model

    @property
    def html(self) -> str:
        """The page, with everything that it needs in it."""
        if self._html is None:
            self._html = self._page()
        return self._html

    def _page(self) -> str:
        film, store = self.film, LiveColumns()
        data = page_data(film, store, self.forces)
        functions = self._model.functions(store.expressions)
        numbers = {name: i for i, name in enumerate(b.name for b in self._model.mechanism.bodies)}
        data["live"] = self._model.data() | {
            "bodyOfItem": [_body_of(item, film, numbers) for item in film.scene.items],
        }
        text = filled(data, film.title, "live/player.html", _SCRIPTS, _STYLES, self._model.code(functions))
        size = len(text.encode())
        if size > LARGEST_PAGE:
            raise MechanismError(
                f"animate: the page would have {size / 1e6:.1f} MB, more than 1 MB; the largest part of it is "
                f"{self._model.largest_element()}: take fewer data or simpler expressions, or animate a motion of "
                "simulate"
            )
        return text

    def save(self, path: str | Path) -> None:
        """Write the page.

        Raises
        ------
        MechanismError
            For a file that does not end in ``.html``.
        """
        refuse_other_than_html(path)
        with whole_file(path) as temporary:
            Path(temporary).write_text(self.html, encoding="utf-8")

    def _repr_html_(self) -> str:
        """The page within a frame, for notebooks."""
        text = self.html.replace("&", "&amp;").replace('"', "&quot;")
        height = 560 + 150 * len(self.film.plots) + 20 * len(self._model.sliders)
        return (
            f'<iframe srcdoc="{text}" style="width:100%;height:{height}px;border:0" '
            'sandbox="allow-scripts allow-downloads" title="mechanism"></iframe>'
        )

    def __repr__(self) -> str:
        sliders = ", ".join(f"'{slider.name}'" for slider in self._model.sliders)
        return f"LiveAnimation of {self.film.title or 'a mechanism'}, with sliders {sliders or 'for nothing'}"


def live_animation(
    mechanism: Any,
    options: Options,
    *,
    initial: Any,
    parameters: Any,
    inputs: Any,
    plots: Mapping[str, Any] | None,
    speed: float | None,
    forces: bool,
    title: str | None,
    path: str | Path | None,
) -> LiveAnimation:
    """Make the page of a mechanism; see :func:`animate` for the arguments."""
    if path is not None:
        refuse_other_than_html(path)
        writable(path)
    model = LiveModel(mechanism, initial, parameters, inputs)
    rate = 1.0 if speed is None else positive(speed, "animate", "speed")
    drawn = replace(options, names=True, velocities=True)  # to be switched on
    taken = replace(_stage(model, drawn, plots or {}, rate, title), names=options.names)
    animation = LiveAnimation(model, taken, forces)
    if path is not None:
        animation.save(path)
    return animation


def refuse_other_than_html(path: str | Path) -> None:
    """Raise for a path that is no page."""
    if Path(path).suffix.lower() not in (".html", ".htm"):
        raise MechanismError(f"animate: live=True writes a page, which ends in .html, got '{path}'")


class LiveColumns(Columns):
    """Columns that a page evaluates itself, numbered in order."""

    def __init__(self) -> None:
        self._columns: list[Column] = []

    def _add(self, group: Any, column: Column) -> Column:
        column.index, column.decimals = len(self._columns), DECIMALS
        self._columns.append(column)
        return column

    @property
    def expressions(self) -> ca.SX:
        """Expressions of all columns (k,)."""
        return ca.vertcat(ca.SX(0, 1), *[column.expression for column in self._columns])

    def packed(self) -> dict[str, Any]:
        """Return nothing: the page has no values but those that it finds."""
        return {}


class LiveSample(Sample):
    """A stretch of motion by which a picture is sized, of a mechanism whose parameters and inputs will change.

    Parameters
    ----------
    source : State or Trajectory
        The motion; a state if it does not move.
    model : LiveModel
        Symbols with sliders.
    times : numpy.ndarray, optional
        Times of the motion.
    """

    def __init__(self, source: State | Trajectory, model: LiveModel, times: np.ndarray | None = None):
        super().__init__(source, times)
        self._model = model

    def varies(self, expression: Any) -> bool:
        """Return True if a slider changes an expression."""
        varying = self._model.varying
        return bool(varying.numel()) and bool(ca.depends_on(ca.SX(expression), varying))

    def sizes(self, expression: Any) -> np.ndarray:
        """Values of loads over the motion, and at the start with inputs at their limits."""
        start, eom = self._start, self._start.equations
        rows = [self[expression]]
        function = eom.function(ca.vec(ca.SX(expression)))
        for slider in self._model.sliders:
            if slider.is_input:
                u = start.inputs.copy()
                u[slider.index] = max(slider.low, slider.high, key=abs)
                state = start.t, start.q, start.v, start.a, start.z, start.lam, u, start.parameters
                rows.append(function(*state).full().reshape(1, -1))
        return np.vstack(rows)


def _stage(model: LiveModel, options: Options, plots: Mapping[str, Any], speed: float, title: str | None) -> Film:
    """Scene, picture and plots, sized by the first seconds of the motion."""
    motion = _preview(model)
    source: State | Trajectory = model.start if motion is None else motion
    times = None if motion is None else np.linspace(motion.t[0], motion.t[-1], POSES)
    sample = LiveSample(source, model, times)
    scene, scale = compose(sample, options)
    poses = scene.poses(sample)
    traced = sample[options.paths].reshape(-1, 2)
    box = room(scene, poses, traced)
    scene = with_placed_names(scene, poses, box, PAPER / float(box[1, 0] - box[0, 0]))
    name = model.mechanism.name if title is None else str(title)
    quantities = read_lines(plots)
    for _, column in quantities.values():
        model.eom.function(column)  # raises for symbols that the mechanism does not have
    # a film of nothing: the page finds its own frames
    return Film(
        source, sample, scene, poses, scale, box, options.paths, quantities, sample.t, [], speed, 60.0, name, False  # type: ignore[arg-type]
    )  # fmt: skip


def _preview(model: LiveModel) -> Trajectory | None:
    """The first seconds of the motion, as far as there are any."""
    times = model.start.t + np.linspace(0.0, PREVIEW, POSES)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", MechanismWarning)  # they belong to the page
            motion = simulate(model.mechanism, times, initial=model.start)
    except MechanismError as error:
        motion = error.partial
    return motion if motion is not None and len(motion) > 1 else None


def _body_of(item: Any, film: Film, numbers: Mapping[str, int]) -> int | None:
    """Number of the body that is pulled at by an item: itself, or the last body of an element."""
    if item.kind == "body":
        return numbers[item.name]
    mechanism = film.sample.mechanism
    elements = [*mechanism.joints, *mechanism.drivers, *mechanism.forces]
    element = next((one for one in elements if one.name == item.name), None)
    bodies: list[Body] = [] if element is None else [body for body in element.bodies if not body.is_ground]
    return numbers[bodies[-1].name] if bodies else None
