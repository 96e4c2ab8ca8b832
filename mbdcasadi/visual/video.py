"""Films of a motion: GIF by Pillow, MP4 by ffmpeg; the frames are drawn by Matplotlib."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import MechanismError
from .axes import readable
from .drawing.canvas import LOWEST, STEP, Canvas
from .drawing.draw import FLAT, TALL, corners, draw_scale, frame_axes, room, with_scale_room
from .drawing.scene import TRACE
from .drawing.style import LIGHT
from .film import Film
from .plots.plot import lines_over

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Width of a film, inches, and its dots per inch.
WIDTH, DPI = 6.0, 100
#: Shortest time that viewers of GIFs keep to, s.
SHORTEST_FRAME = 0.02
#: Colours of a GIF.
COLOURS_OF_GIF = 64


class Stage:
    """A figure of the scene and its plots, which is moved from frame to frame.

    Parameters
    ----------
    film : Film
        Motion that it shows.
    forces : bool
        True if all forces are shown.
    """

    def __init__(self, film: Film, forces: bool):
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure

        self.film = film
        scene = film.scene.without("velocities")
        scene = replace(scene if forces else scene.without("loads"), labels=scene.labels if film.options.names else [])
        box = film.box if forces else room(scene, film.poses, film.paths.reshape(-1, 2))
        ratio = float(np.clip((box[1, 1] - box[0, 1]) / (box[1, 0] - box[0, 0]), FLAT, TALL))
        curves = len(film.curves)
        # films have even numbers of pixels
        size = WIDTH, round((WIDTH * ratio + 0.9 + 1.25 * curves) * DPI / 2) * 2 / DPI
        self.figure: Figure = Figure(figsize=size, dpi=DPI, layout="constrained", facecolor=LIGHT["paper"])
        self.canvas: Any = FigureCanvasAgg(self.figure)
        axes = self.figure.subplots(1 + curves, 1, height_ratios=[WIDTH * ratio + 0.5] + [1.25] * curves, squeeze=False)
        scene_axes, *others = axes[:, 0]
        self._picture = Canvas(scene_axes, scene)
        if scale := {unit: size for unit, size in film.scale.items() if forces or unit in scene.arrow_units}:
            frame_axes(scene_axes, with_scale_room(box, scale), fresh=False)
            draw_scale(scene_axes, scale, box, corners(scene_axes)[1] - [scene.unit, 0])
        else:
            frame_axes(scene_axes, box, fresh=False)
        self._trace(scene_axes)
        if film.title:
            readable(scene_axes.set_title(film.title, fontsize="medium"), name=True)
        self._cursors = [self._plot(a, *curve) for a, curve in zip(others, film.curves.items(), strict=True)]
        if others:
            others[-1].set_xlabel("t, s")
        self._moving = [*self._picture.artists, *self._traces, self._clock, *self._cursors]
        for artist in self._moving:
            artist.set_animated(True)
        self._moving.sort(key=lambda artist: artist.get_zorder())
        self.canvas.draw()
        # the places of axes stay as they are, or they would tremble from frame to frame
        self.figure.set_layout_engine("none")
        self._behind = self.canvas.copy_from_bbox(self.figure.bbox)

    def _trace(self, axes: Axes) -> None:
        """Make room for the paths of points, and for the time."""
        film = self.film
        self._traces = [
            axes.plot([], [], color=LIGHT["trace"], linewidth=1.3, zorder=LOWEST + STEP * TRACE)[0]
            for _ in film.scene.traces
        ]
        self._heads = film.sample[film.options.paths].reshape(len(film.t), -1, 2)
        self._clock = axes.text(
            0.01, 1.0, "", transform=axes.transAxes, fontsize="small", color=LIGHT["muted"], va="bottom"
        )

    def _plot(self, axes: Axes, label: str, lines: dict[str, np.ndarray]) -> Any:
        lines_over(axes, self.film.fine, lines, label, width=1.4)
        return axes.axvline(self.film.t[0], color=LIGHT["motion"], linewidth=1.2)

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width, pixels."""
        width, height = self.canvas.get_width_height()
        return height, width

    def image(self, k: int) -> np.ndarray:
        """Frame k as an array (height, width, 3) of bytes."""
        film = self.film
        self._picture.show(film.poses[k], film.t[k])
        passed = np.searchsorted(film.fine, film.t[k])
        for number, line in enumerate(self._traces):
            line.set_data(*np.vstack([film.paths[:passed, number], self._heads[k, number]]).T)
        self._clock.set_text(f"t = {film.t[k]:.{film.digits}f} s")
        for cursor in self._cursors:
            cursor.set_xdata([film.t[k], film.t[k]])
        self.canvas.restore_region(self._behind)
        for artist in self._moving:
            self.figure.draw_artist(artist)
        return np.array(self.canvas.buffer_rgba())[:, :, :3]


def write_gif(film: Film, forces: bool, path: Path) -> None:
    """Write a GIF that repeats; frames that would pass faster than viewers can show them are left out."""
    from PIL import Image

    step = max(1, int(np.ceil(SHORTEST_FRAME * film.fps - 1e-9)))
    stage = Stage(film, forces)
    # one palette for all frames, so that Pillow writes of each only what has changed
    palette = Image.new("P", (1, 1))
    palette.putpalette(_common_colours(np.vstack([stage.image(k) for k in (0, len(film.t) // 2, len(film.t) - 1)])))
    images = (Image.fromarray(stage.image(k)) for k in range(0, len(film.t), step))
    first, *others = (image.quantize(palette=palette, dither=Image.Dither.NONE) for image in images)
    # the format counts in hundredths of a second
    duration = 10 * max(2, round(100 * step / film.fps))
    first.save(path, format="GIF", save_all=True, append_images=others, duration=duration, loop=0, optimize=True)


def _common_colours(image: np.ndarray) -> list[int]:
    """Return the most common colours of an image, so that areas keep their exact colours.

    They are eight apart, since Pillow looks for the nearest colour on a lattice of four.
    """
    values, counts = np.unique(image.reshape(-1, 3), axis=0, return_counts=True)
    apart: dict[tuple[int, ...], list[int]] = {}
    for colour in values[np.argsort(-counts, kind="stable")].tolist():
        apart.setdefault(tuple(part // 8 for part in colour), colour)
    return [part for colour in list(apart.values())[:COLOURS_OF_GIF] for part in colour]


def need_ffmpeg(path: Any) -> str:
    """Return the path of ffmpeg, or raise an error that says what to do."""
    program = shutil.which("ffmpeg")
    if program is None:
        raise MechanismError(
            f"animate: '{path}' needs the program ffmpeg, which is not on the path; install it, or write .gif or .html"
        )
    return program


def write_mp4(film: Film, forces: bool, path: Path) -> None:
    """Write a film in H.264, by ffmpeg.

    Images go to its standard input as they are: Matplotlib's ``FFMpegWriter``
    saves the whole figure for each of them, which takes seven times as long.
    """
    stage = Stage(film, forces)
    height, width = stage.shape
    command = [
        need_ffmpeg(path), "-loglevel", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}",
        "-r", f"{film.fps:g}", "-i", "-", "-pix_fmt", "yuv420p", "-movflags", "+faststart", "-f", "mp4", str(path),
    ]  # fmt: skip
    with subprocess.Popen(command, stdin=subprocess.PIPE, stderr=subprocess.PIPE) as ffmpeg:
        try:
            for k in range(len(film.t)):
                ffmpeg.stdin.write(stage.image(k).tobytes())  # type: ignore[union-attr]
        except BrokenPipeError:
            pass  # the reason is on its standard error
        except BaseException:
            ffmpeg.kill()
            raise
        _, message = ffmpeg.communicate()
    if ffmpeg.returncode:
        reason = " ".join(message.decode(errors="replace").split()) or f"status {ffmpeg.returncode}"
        raise OSError(f"ffmpeg: {reason}")
