"""A motion as one HTML file with everything in it: the templates filled with data."""

from __future__ import annotations

import html
import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import asdict, replace
from importlib.resources import files
from string import Template
from typing import Any

import casadi as ca
import numpy as np

from ..drawing.draw import room
from ..drawing.scene import ARROW, SLOT, Item, Label, Mark, diagonal_of
from ..drawing.style import BODIES_DARK, BODIES_LIGHT, DARK, LIGHT, SERIES_DARK, SERIES_LIGHT, STYLES
from ..film import Film
from .columns import Column, Columns

#: Points of marks, each kept once, with their numbers: a size, and loops as multiples of it.
Shapes = dict[str, tuple[int, list[Any]]]
#: Size of the multiples, in parts of a shape.
FINE = 1e-5
#: Pixels of the page to a point.
PIXELS = 4 / 3
#: A comment at the end of a line of a script, two spaces after it.
_COMMENT = re.compile(r"  +// .*$")
_SCRIPTS = (
    "numbers.js", "frames.js", "data.js", "stage.js", "plots.js", "svg.js", "panel.js", "saving.js", "player.js",
)  # fmt: skip


def page(film: Film, forces: bool) -> str:
    """Return the page of a film.

    Parameters
    ----------
    film : Film
        Motion that it shows.
    forces : bool
        True if forces are shown from the start.
    """
    store = Columns(film.motion, diagonal_of(film.box))
    data = page_data(film, store, forces) | {"count": len(film.t), "t1": float(film.t[-1])}
    return filled(data, film.title, "player.html", _SCRIPTS)


def filled(
    data: dict[str, Any],
    title: str,
    controls: str,
    scripts: Sequence[str],
    styles: Sequence[str] = ("page.css",),
    model: str = "",
) -> str:
    """Return the template with data, controls and scripts in it.

    Parameters
    ----------
    data : dict
        Data that the scripts read.
    title : str
        Title of the page.
    controls : str
        Name of the file with the controls of its time, and what is said of keys and pointer.
    scripts : sequence of str
        Names of the scripts, in order.
    styles : sequence of str
        Names of the style sheets.
    model : str
        A script that goes before them.
    """
    folder = files(__package__) / "template"

    def text(name: str) -> str:
        lines = folder.joinpath(*name.split("/")).read_text(encoding="utf-8").splitlines()
        # comments and indentation stay in the package
        return "\n".join(_COMMENT.sub("", line.strip()) for line in lines if not line.lstrip().startswith("//"))

    buttons, keys = text(controls).split("<!-- keys -->")
    written = json.dumps(data, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return Template(text("page.html")).substitute(
        title=html.escape(title or "motion"),
        style="\n".join(map(text, styles)),
        controls=buttons,
        keys=keys,
        model=model,
        script="\n".join(map(text, scripts)),
        # neither "</script>" nor "<!--<script>" in a name may change where the script ends
        data=written.replace("<", "\\u003c"),
    )


def page_data(film: Film, store: Columns, forces: bool) -> dict[str, Any]:
    """Data for the scripts of a page: the drawing, the items with tooltips, and the plots.

    Parameters
    ----------
    film : Film
        Motion that is shown.
    store : Columns
        Takes the expressions, and gives them their numbers.
    forces : bool
        True if forces are shown from the start.
    """
    scene, t = film.scene, film.t
    frames = _frames(film, store)
    tooltips = [
        {
            label: store.number(("item", k), e, label, f"{label} of '{item.name}'", optional=True)
            for label, e in item.tooltip.items()
        }
        for k, item in enumerate(scene.items)
    ]
    plots = {
        label: {name: store.number(("plot", label), e, f"plot, {label}", f"'{label}'")
                for name, e in zip(names, ca.vertsplit(column), strict=True)}
        for label, (names, column) in film.plots.items()
    }  # fmt: skip
    packed = store.packed()
    shapes: Shapes = {}
    return {
        "t0": float(t[0]), "title": film.title, "speed": film.speed, "forces": forces, "names": film.options.names,
        "digits": film.digits,
        "box": [_short(x) for x in _stage(film).ravel()], "scale": film.scale, "traceLayer": SLOT,
        "frames": [frame | {"c": [column.index for column in frame["c"]]} for frame in frames],
        "marks": [_mark(mark, shapes) for mark in scene.marks],
        "shapes": [points for _, points in shapes.values()],
        "labels": [_label(label) for label in scene.labels],
        "items": [_item(item, tooltip) for item, tooltip in zip(scene.items, tooltips, strict=True)],
        "bodies": [next(k for k, item in enumerate(scene.items) if (item.name, item.kind) == (body.name, "body"))
                   for body in film.sample.mechanism.bodies],
        "traces": scene.traces,
        "plots": [{"label": label, "lines": _readings(lines, "name")} for label, lines in plots.items()],
        "styles": {name: asdict(STYLES[name]) for name in sorted({mark.style for mark in scene.marks})},
        "light": LIGHT, "dark": DARK, "bodiesLight": BODIES_LIGHT, "bodiesDark": BODIES_DARK,
        "seriesLight": SERIES_LIGHT, "seriesDark": SERIES_DARK,
        **packed,
    }  # fmt: skip


def _label(label: Label) -> dict[str, Any]:
    """A name in the drawing, with its shift and its leader in pixels."""
    x, y = map(_short, label.point)
    data = {"f": label.frame, "x": x, "y": y, "t": label.text.split("\n"), "b": label.body, "d": _pixels(label.shift)}
    return data | ({"e": _pixels(label.leader)} if label.leader else {})


def _pixels(lengths: Iterable[float]) -> list[float]:
    return [round(length * PIXELS, 1) for length in lengths]


def _item(item: Item, tooltip: dict[str, Column]) -> dict[str, Any]:
    """A thing that is drawn, with the numbers of its tooltip."""
    data = {"name": item.name, "kind": item.kind, "readings": _readings(tooltip, "label")}
    return data | ({} if item.appearances is None else {"w": item.appearances})


def _stage(film: Film) -> np.ndarray:
    """Corners about the parts and paths of a film: the page breaks arrows off that are long."""
    parts = replace(film.scene, marks=[mark for mark in film.scene.marks if mark.layer != ARROW])
    paths = film.lines[0] if film.lines else film.sample[film.options.paths]
    return room(parts, film.poses, paths.reshape(-1, 2))


def _readings(columns: dict[str, Column], key: str) -> list[dict[str, Any]]:
    """Label, column and decimals of numbers that are known."""
    return [{key: label, "column": c.index, "d": c.decimals} for label, c in columns.items() if c.index >= 0]


def _frames(film: Film, store: Columns) -> list[dict[str, Any]]:
    """Columns of each frame, in the group of the item that its marks belong to, and how they make a pose."""
    items: dict[int, Any] = {}
    for mark in film.scene.marks:
        items.setdefault(mark.frame, mark.item)
    frames = []
    for number, frame in enumerate(film.scene.frames):
        group = "item", items.get(number)
        described: dict[str, Any] = {"c": []} | ({"u": frame.unit} if frame.unit else {})
        if frame.anchor is None:
            described["c"] += [store.drawn(group, x, "the pose of a part") for x in ca.vertsplit(frame.position)]
        else:
            described["a"] = frame.anchor
        if frame.vector is None:
            described["c"] += [store.drawn(group, x, "the pose of a part") for x in (frame.angle, frame.length)]
        else:
            described["v"] = frame.scale
            # what gives a direction alone has no size in the picture
            described["c"] += [
                store.drawn(group, x, "an arrow", 1 / frame.scale)
                if frame.scale
                else store.number(group, x, "direction", "an arrow")
                for x in ca.vertsplit(frame.vector)
            ]
        frames.append(described)
    return frames


def _short(value: float) -> float:
    """A length with digits enough for a picture."""
    return float(f"{value:.6g}")


def _mark(mark: Mark, shapes: Shapes) -> dict[str, Any]:
    """A mark, and its points among the shapes: links of a chain and their pins are all alike."""
    points: list[Any]
    if mark.loops[0].shape[1] == 2:
        size = _short(FINE * max(float(np.abs(loop).max()) for loop in mark.loops)) or 1.0
        points = [size, *(np.round(loop.ravel() / size).astype(int).tolist() for loop in mark.loops)]
    else:  # lengths beside parts of a length
        points = [1, *([float(f"{x:.5g}") for x in loop.ravel()] for loop in mark.loops)]
    number, _ = shapes.setdefault(repr(points), (len(shapes), points))
    described = {
        "f": mark.frame, "s": mark.style, "b": mark.body, "i": mark.item, "l": mark.layer, "c": int(mark.closed),
        "g": mark.group, "k": mark.loops[0].shape[1], "p": number, "e": mark.step,
    }  # fmt: skip
    return {key: value for key, value in described.items() if value or key not in ("c", "g", "e")}
