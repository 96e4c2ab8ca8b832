"""A page in which the browser solves a mechanism that the reader moves with sliders and the pointer."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from ..errors import MechanismError, MechanismWarning
from ..model.bodies import Body
from ..model.symbols import positive
from ..numerics.lazy import cached_property
from ..results.columns import read_lines
from ..results.state import State
from ..results.trajectory import Trajectory
from ..simulation.simulate import simulate
from .animation import Animation
from .drawing.compose import Options, compose
from .drawing.draw import room
from .drawing.sample import Sample
from .film import Film, with_names
from .page.columns import Column, Columns
from .page.live_model import LiveModel
from .page.page import filled, page_data
from .page.widget import page_widget

#: Seconds of motion by which the picture and its arrows are sized, and poses that are looked at.
PREVIEW, POSES = 3.0, 61
#: Most bytes of a page.
LARGEST_PAGE = 1_000_000
#: Digits with which a live number is shown.
DECIMALS = 12
_STYLES = ("page.css", "live/page.css")
_SCRIPTS = (
    "numbers.js", "frames.js", "live/linear.js", "live/equations.js", "live/assembly.js", "live/integrators.js",
    "live/engine.js", "live/past.js", "live/freedom.js", "stage.js", "plots.js", "svg.js", "panel.js", "saving.js",
    "live/player.js",
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

    live = True
    _title = "mechanism"

    def __init__(self, model: LiveModel, film: Film, forces: bool):
        super().__init__(film, forces)
        self._model, self._height = model, 560 + 20 * len(model.sliders)

    @cached_property
    def html(self) -> str:
        """The page, with everything that it needs in it."""
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

    def widget(self) -> Any:
        """Return the page as a widget of a notebook, with which values are exchanged.

        It takes the extra ``notebook``; without it a notebook shows the page by itself.

        Returns
        -------
        anywidget.AnyWidget
            ``values``: of the sliders by name, to be read and set; ``playing``: True while it runs, to be read and set;
            ``time`` (s), ``q`` and ``v``: the present state. ``widget.observe(f, "values")`` calls ``f`` at changes.

        Raises
        ------
        MechanismError
            Without anywidget; later for a value of no slider, and for one beyond its limits.
        """
        return page_widget(self.html, self._model.sliders, self._height)

    def __repr__(self) -> str:
        sliders = ", ".join(f"'{slider.name}'" for slider in self._model.sliders)
        return f"LiveAnimation of {self.film.title or 'a mechanism'}, with sliders {sliders or 'for nothing'}"


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


def stage(
    model: LiveModel, options: Options, plots: Mapping[str, Any] | None, speed: float | None, title: str | None
) -> Film:
    """Scene, picture and plots, sized by the first seconds of the motion; see :func:`animate` for the arguments."""
    rate = 1.0 if speed is None else positive(speed, "animate", "speed")
    motion = _preview(model)
    source: State | Trajectory = model.start if motion is None else motion
    times = None if motion is None else np.linspace(motion.t[0], motion.t[-1], POSES)
    sample = LiveSample(source, model, times)
    scene, scale = compose(sample, replace(options, names=True, velocities=True))  # to be switched on
    poses = scene.poses(sample)
    traced = sample[options.paths].reshape(-1, 2)
    box = room(scene, poses, traced)
    scene = with_names(scene, poses, box)
    name = model.mechanism.name if title is None else str(title)
    quantities = read_lines({} if plots is None else plots)
    for _, column in quantities.values():
        model.eom.function(column)  # raises for symbols that the mechanism does not have
    # a film of nothing: the page finds its own frames
    return Film(
        source, sample, scene, poses, scale, box, options, quantities, sample.t, [], rate, 60.0, name,  # type: ignore[arg-type]
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
