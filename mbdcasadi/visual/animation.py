"""Animations: a page to play with, a GIF, or a film."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ..errors import MechanismError
from ..numerics.lazy import cached_property
from ..numerics.writing import whole_file
from .film import Film
from .page.page import page
from .video import need_ffmpeg, write_gif, write_mp4

#: Endings of pages, and the writers of films by their endings.
_PAGES = (".html", ".htm")
_FILMS: dict[str, Callable[[Film, bool, Path], None]] = {".gif": write_gif, ".mp4": write_mp4}


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
        ending = check_ending(path, self.live)
        with whole_file(path) as temporary:
            self.write(temporary, ending)

    def write(self, file: Path, ending: str) -> None:
        """Write it to a file of any name in the format of an ending."""
        if ending in _PAGES:
            file.write_text(self.html, encoding="utf-8")
        else:
            _FILMS[ending](self.film, self.forces, file)

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


def check_ending(path: str | Path, live: bool = False) -> str:
    """Return the ending of a path if such a file can be written; of a live mechanism a page alone."""
    if not isinstance(path, str | Path):
        raise MechanismError(f"animate: path= must be the name of a file, got {path!r}")
    ending = Path(path).suffix.lower()
    if live and ending not in _PAGES:
        raise MechanismError(f"animate: live=True writes a page, which ends in .html, got '{path}'")
    if ending not in (*_PAGES, *_FILMS):
        raise MechanismError(f"animate: '{path}' must end in .html, .gif or .mp4")
    if ending == ".mp4":
        need_ffmpeg(path)
    return ending
