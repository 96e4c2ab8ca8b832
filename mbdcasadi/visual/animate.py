"""``animate``: a motion as a page, a GIF or a film; a mechanism as a page that solves it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..errors import MechanismError
from ..model.bodies import Body
from ..model.mechanism import Mechanism
from ..model.quantities import yes_or_no
from ..numerics.writing import writable
from .animation import Animation, check_ending
from .drawing.draw import centroids_of, trace_options
from .film import film
from .live import LiveAnimation, stage
from .page.live_model import LiveModel


def animate(
    motion: Any,
    path: str | Path | None = None,
    *,
    trace: Any = (),
    plots: Mapping[str, Any] | None = None,
    fps: float = 30,
    speed: float | None = None,
    forces: bool = False,
    names: bool = False,
    centroids: bool | Sequence[Body] = False,
    title: str | None = None,
    live: bool = False,
    initial: Any = (),
    parameters: Any = None,
    inputs: Any = None,
) -> Animation:
    """Show a motion as a page to play with, as a GIF, or as a film; or a mechanism as a page that solves it.

    Parameters
    ----------
    motion : Trajectory or Solution; Mechanism
        The motion; with `live` the mechanism.
    path : str or Path, optional
        Path of the file. ``.html`` is one file that opens without a network, with
        play and pause, speed, a slider, forces on and off, the numbers of the
        part under the pointer, and keys; ``.gif`` and ``.mp4`` are films. Without a path the
        page shows itself in a notebook.
    trace : sequence of Marker, Body or expression (2,), optional
        Points whose path is drawn.
    plots : dict of str to expression, optional
        Plots that move along, by their labels, as in :func:`plot`.
    fps : float, default 30
        Frames to a second; a GIF shows 50 at most. The page shows the motion at any time.
    speed : float, optional
        Seconds of the motion to one on the screen; by default 1, and less or
        more for motions that are very short or long.
    forces : bool, default False
        True if reactions (green), applied forces (red) and weights (grey) are drawn
        to scale. The page holds them in any case, to be switched on.
    names : bool, default False
        True if bodies and joints are named.
    centroids : bool or sequence of Body, default False
        True if the centres of mass of all bodies are drawn, or the bodies of which they are.
    title : str, optional
        By default the name of the mechanism.
    live : bool, default False
        Write a page in which the browser solves the equations of motion of the mechanism: with sliders, and bodies
        that follow the pointer, along their freedom while it is paused and by a spring while it runs. The path ends
        in ``.html``; a page has at most 1 MB.
    initial : sequence of relations, or State
        Of a live page, the start, as in :func:`assemble`; its conditions are equalities.
    parameters, inputs : sequence of Parameter, of Input, optional
        Of a live page, what sliders change, between the limits that they carry; by default all of the mechanism.

    Returns
    -------
    Animation
        ``.save(path)`` writes it again, in another form as well if it shows a motion; ``.widget()`` of a live page is
        a widget of a notebook whose values go both ways (extra ``notebook``).

    Raises
    ------
    MechanismError
        For a state instead of a motion, unknown endings, and films without ffmpeg; of a live page for what a browser
        cannot follow: exact stick and slip (``DryFriction``), conditions at the start that are inequalities, friction
        on redundant joints, and data that make it too large.

    Examples
    --------
    >>> animate(motion, "motion.html", trace=[tip], plots={"angle, rad": arm.phi})  # doctest: +SKIP
    """
    alive = yes_or_no(live, "animate", "live")
    if path is not None:
        # a path that cannot be written is reported before the work
        check_ending(path, alive)
        writable(path)
    named, centres = yes_or_no(names, "animate", "names"), centroids_of(centroids, "animate")
    shown = yes_or_no(forces, "animate", "forces")
    options = replace(trace_options(trace, forces=True, tooltips=True, names=named), centroids=centres)
    if alive:
        model = LiveModel(motion, initial, parameters, inputs)
        animation: Animation = LiveAnimation(model, stage(model, options, plots, speed, title), shown)
    else:
        _refuse_live_arguments(motion, initial=initial, parameters=parameters, inputs=inputs)
        taken = film(motion, options, plots, fps, speed, title)
        if shown:
            taken.sample.need_reactions("animate")
        animation = Animation(taken, shown)
    if path is not None:
        animation.save(path)
    return animation


def _refuse_live_arguments(motion: Any, **arguments: Any) -> None:
    """Raise for arguments that belong to a live page alone, and for a mechanism without motion."""
    if isinstance(motion, Mechanism):
        raise MechanismError("animate: takes a motion, as simulate returns it; a mechanism needs live=True")
    for name, value in arguments.items():
        if value is not None and value != ():
            raise MechanismError(f"animate: {name}= belongs to live=True; a motion has its own")
