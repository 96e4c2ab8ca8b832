"""Animations: GIF, MP4, a page to play with, and a page that solves the mechanism itself."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ..errors import MechanismError
from ..model.mechanism import Mechanism
from ..model.quantities import yes_or_no
from ..numerics.lazy import cached_property
from ..numerics.writing import whole_file, writable
from .drawing.draw import trace_options
from .film import Film, film
from .page.page import page


class Animation:
    """An animation of a motion, which a notebook shows.

    Attributes
    ----------
    film : Film
        Its frames.
    forces : bool
        True if forces are shown from the start.
    html : str
        The page, with everything that it needs in it.
    """

    live = False
    #: title and height of the frame in a notebook, the latter without plots, pixels
    _title, _height = "animation", 520

    def __init__(self, taken: Film, forces: bool):
        self.film, self.forces = taken, forces

    @cached_property
    def html(self) -> str:
        """The page, with everything that it needs in it."""
        return page(self.film, self.forces)

    def save(self, path: str | Path) -> None:
        """Write it as ``.html``, ``.gif`` or ``.mp4``, by the ending of the path.

        Raises
        ------
        MechanismError
            For another ending, and for ``.mp4`` without ffmpeg.
        """
        writer = writer_for(path, self.live)
        with whole_file(path) as temporary:
            writer(self, temporary)

    def _repr_html_(self) -> str:
        """The page within a frame, for notebooks."""
        text = self.html.replace("&", "&amp;").replace('"', "&quot;")
        height = self._height + 150 * len(self.film.plots)
        return (
            f'<iframe srcdoc="{text}" style="width:100%;height:{height}px;border:0" '
            f'sandbox="allow-scripts allow-downloads" title="{self._title}"></iframe>'
        )

    def __repr__(self) -> str:
        n, t = len(self.film.t), self.film.t
        return f"Animation of {self.film.title or 'a mechanism'}: {n} frames, t = {t[0]:.6g} … {t[-1]:.6g} s"


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
    centroids: bool = False,
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
    names, centroids : bool, default False
        True if bodies and joints are named, and centres of mass drawn.
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
        ``.save(path)`` writes it again, in another form as well if it shows a motion.

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
        writer_for(path, alive)
        writable(path)
    flags = {n: yes_or_no(v, "animate", n) for n, v in (("names", names), ("centroids", centroids))}
    shown = yes_or_no(forces, "animate", "forces")
    options = trace_options(trace, forces=True, tooltips=True, **flags)
    if alive:
        from .live import LiveAnimation, LiveModel, stage

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


def _write_page(animation: Animation, path: Path) -> None:
    path.write_text(animation.html, encoding="utf-8")


def _write_gif(animation: Animation, path: Path) -> None:
    from .video import write_gif

    write_gif(animation.film, animation.forces, path)


def _write_mp4(animation: Animation, path: Path) -> None:
    from .video import write_mp4

    write_mp4(animation.film, animation.forces, path)


_WRITERS: dict[str, Callable[[Animation, Path], None]] = {
    ".html": _write_page, ".htm": _write_page, ".gif": _write_gif, ".mp4": _write_mp4,
}  # fmt: skip


def writer_for(path: str | Path, live: bool = False) -> Callable[[Animation, Path], None]:
    """Return the function that writes a path, by its ending; of a live mechanism a page alone."""
    ending = Path(path).suffix.lower()
    if live and ending not in (".html", ".htm"):
        raise MechanismError(f"animate: live=True writes a page, which ends in .html, got '{path}'")
    if ending not in _WRITERS:
        raise MechanismError(f"animate: '{path}' must end in .html, .gif or .mp4")
    if ending == ".mp4":
        from .video import need_ffmpeg

        need_ffmpeg(path)
    return _WRITERS[ending]
