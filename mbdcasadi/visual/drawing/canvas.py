"""A scene in Matplotlib: one artist for each mark, moved from pose to pose."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from .scene import GROUND, PIN, Mark, Scene, placed
from .style import BODIES_LIGHT, LIGHT, STYLES, colours_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

#: Matplotlib's codes of a path.
MOVE, LINE, CLOSE = 1, 2, 79
#: Order of the lowest layer among artists, and the steps between layers.
LOWEST, STEP = 2.0, 0.5


#: Size of names, points: legible in a drawing that is as wide as a column.
NAME = 9.5
#: Opacity of joints that are open, and of bodies that have left.
ABSENT = 0.2


class Canvas:
    """Artists of a scene in axes.

    Parameters
    ----------
    axes : matplotlib.axes.Axes
        Axes to draw into.
    scene : Scene
        The scene.
    strength : float, default 1
        Opacity; below 1 for poses behind another one.
    still : bool, default True
        True if marks of the ground are drawn.
    """

    def __init__(self, axes: Axes, scene: Scene, strength: float = 1.0, still: bool = True):
        from matplotlib.patches import PathPatch
        from matplotlib.path import Path

        self.scene, self._strength = scene, strength
        self._marks = [m for m in scene.marks if still or not (m.layer == GROUND or m.frame == 0)]
        self._patches, self._codes, self._texts, self._leaders = [], [], [], []
        for order, mark in enumerate(self._marks):
            fill, stroke = colours_of(STYLES[mark.style], mark.body, LIGHT, BODIES_LIGHT)
            style = STYLES[mark.style]
            codes = _codes(mark)
            patch = PathPatch(
                Path(np.zeros((len(codes), 2)), codes),
                facecolor=fill if mark.closed and fill else "none",
                edgecolor=stroke or "none",
                linewidth=style.width,
                linestyle=(0, tuple(d / max(style.width, 0.5) for d in style.dash)) if style.dash else "-",
                zorder=LOWEST + STEP * mark.layer + 1e-4 * order,
                capstyle="round",
                joinstyle="round",
                clip_on=True,
            )
            axes.add_patch(patch)
            self._patches.append(patch)
            self._codes.append(codes)
        for label in scene.labels:
            self._texts.append(_text(axes, label))
            self._leaders.append(_leader(axes, label))

    @property
    def artists(self) -> list[Any]:
        """All artists, to be drawn apart from what stays."""
        return [*self._patches, *self._texts, *filter(None, self._leaders)]

    def show(self, pose: np.ndarray, time: float = -np.inf) -> None:
        """Move everything to a pose (frames, 4) at a time, s."""
        from matplotlib.path import Path

        strengths = [self._strength * (1 if item.is_there(time) else ABSENT) for item in self.scene.items]
        for mark, patch, codes in zip(self._marks, self._patches, self._codes, strict=True):
            patch.set_path(Path(vertices(mark, pose[mark.frame]), codes))
            strength = self._strength if mark.item is None else strengths[mark.item]
            patch.set_alpha(strength if strength < 1 else None)
        for label, text, leader in zip(self.scene.labels, self._texts, self._leaders, strict=True):
            (place,) = placed(np.array([label.point]), pose[label.frame])
            text.xy = tuple(place)
            if leader is not None:
                leader.xy = tuple(place)


def _codes(mark: Mark) -> np.ndarray:
    codes: list[int] = []
    for points in mark.loops:
        codes += [MOVE, *[LINE] * (len(points) - 1)]
        if mark.closed:
            codes.append(CLOSE)
    return np.array(codes, np.uint8)


def vertices(mark: Mark, pose: np.ndarray) -> np.ndarray:
    """Vertices of a mark's path in the global frame (k, 2), with one more for each loop that closes."""
    parts = []
    for points in mark.loops:
        outline = placed(points, pose)
        parts += [outline, outline[:1]] if mark.closed else [outline]
    return np.vstack(parts)


def _text(axes: Axes, label: Any) -> Any:
    from matplotlib.patheffects import withStroke

    return axes.annotate(
        label.text, (0, 0), xytext=label.shift, textcoords="offset points", ha="center", va="center",
        fontsize=NAME, fontstyle="italic" if label.body else "normal",
        color=LIGHT["ink" if label.body else "ground"],
        path_effects=[withStroke(linewidth=2.5, foreground=LIGHT["paper"])],
        zorder=LOWEST + 9 * STEP, annotation_clip=True, parse_math=False,
    )  # fmt: skip


def _leader(axes: Axes, label: Any) -> Any:
    """A thin line from a point of a part to its name; None if the name is next to the part."""
    if label.leader is None:
        return None
    return axes.annotate(
        "", (0, 0), xytext=label.leader, textcoords="offset points", annotation_clip=True,
        arrowprops=dict(arrowstyle="-", color=LIGHT["muted"], linewidth=0.7, shrinkA=0, shrinkB=0),
        zorder=LOWEST + STEP * PIN - 1e-3,  # it ends at the edge of a pin
    )  # fmt: skip
