"""A motion as one HTML file with everything in it: the templates filled with data."""

from __future__ import annotations

import base64
import html
import json
import zlib
from dataclasses import asdict
from importlib.resources import files
from string import Template
from typing import Any

import casadi as ca
import numpy as np

from ...errors import MechanismError
from ..drawing.draw import nice
from ..drawing.scene import SLOT, Mark
from ..drawing.style import BODIES_DARK, BODIES_LIGHT, DARK, LIGHT, SERIES_DARK, SERIES_LIGHT, STYLES
from ..film import Film

#: Points of marks, each kept once, with their numbers.
Shapes = dict[str, tuple[int, list[list[float]]]]
#: Pixels of the page to a point.
PIXELS = 4 / 3
_SCRIPTS = ("data.js", "stage.js", "plots.js", "player.js")


class Columns:
    """Columns over time, quantised to 16 bits between their least and largest value; equal ones are kept once."""

    def __init__(self) -> None:
        self.columns: list[dict[str, float]] = []
        self._words: list[np.ndarray] = []
        self._known: dict[bytes, int] = {}

    def add(self, values: np.ndarray, what: str, finest: float = np.inf) -> int:
        """Add a column (n,) and return its number; with 32 bits where the steps would be larger than `finest`."""
        values = np.ascontiguousarray(values, float)
        if not np.all(np.isfinite(values)):
            raise MechanismError(f"animate: {what} is not finite over the whole motion")
        key = values.tobytes()
        if key not in self._known:
            self._known[key] = len(self.columns)
            self.columns.append(self._packed(values, finest))
        return self._known[key]

    def _packed(self, values: np.ndarray, finest: float) -> dict[str, float]:
        low, reach = float(values.min()), float(np.ptp(values))
        if reach <= 1e-12 * max(1.0, abs(low)):
            return {"c": round(float(values[0]), 12)}
        shares = (values - low) / reach
        if reach / 65535 <= finest:
            return {"o": low, "s": reach / 65535, "at": self._store(np.round(65535 * shares))}
        whole = np.round(shares * (2.0**32 - 1)).astype(np.uint64)
        at, rest = self._store(whole >> np.uint64(16)), self._store(whole & np.uint64(65535))
        return {"o": low, "s": reach / (2.0**32 - 1), "at": at, "low": rest}

    def _store(self, words: np.ndarray) -> int:
        self._words.append(words.astype("<u2"))
        return sum(len(w) for w in self._words[:-1])

    @property
    def words(self) -> str:
        """All of them: differences from word to word, their low bytes and then their high ones, deflated, in base64."""
        steps = [np.diff(words, prepend=np.uint16(0)).astype("<u2") for words in self._words]
        pairs = np.frombuffer(b"".join(s.tobytes() for s in steps), np.uint8).reshape(-1, 2)
        return base64.b64encode(zlib.compress(pairs.T.tobytes(), 9)).decode()


def page(film: Film, forces: bool) -> str:
    """Return the page of a film.

    Parameters
    ----------
    film : Film
        What it shows.
    forces : bool
        Whether forces are shown from the start.
    """
    folder = files(__package__) / "template"
    text = {name: (folder / name).read_text(encoding="utf-8") for name in ("page.html", "page.css", *_SCRIPTS)}
    data = json.dumps(_data(film, forces), separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return Template(text["page.html"]).substitute(
        title=html.escape(film.title or "motion"),
        style=text["page.css"],
        script="\n".join(text[name] for name in _SCRIPTS),
        # neither "</script>" nor "<!--<script>" in a name may change where the script ends
        data=data.replace("<", "\\u003c"),
    )


def _data(film: Film, forces: bool) -> dict[str, Any]:
    store, sample, scene = Columns(), film.sample, film.scene
    t = film.t
    frames = [
        [store.add(film.poses[:, k, j], "the pose of a part", 2e-4 if j == 2 else np.inf) for j in range(4)]
        for k in range(len(scene.frames))
    ]
    # all at once: expressions share their parts
    values = iter(sample[ca.vertcat(ca.SX(0, 1), *[e for item in scene.items for e in item.tooltip.values()])].T)
    items = [
        {"name": item.name, "kind": item.kind,
         "readings": [{"label": label, "column": store.add(next(values), f"{label} of '{item.name}'")}
                      for label in item.tooltip]}
        for item in scene.items
    ]  # fmt: skip
    traces = [[store.add(film.ways[:, k, j], "a trace") for j in range(2)] for k in range(film.ways.shape[1])]
    plots = [
        {"label": label, "lines": [{"name": n, "column": store.add(v, f"'{label}'")} for n, v in lines.items()]}
        for label, lines in film.curves.items()
    ]  # fmt: skip
    shapes: Shapes = {}
    return {
        "t0": float(t[0]), "t1": float(t[-1]), "count": len(t), "speed": film.speed, "forces": forces,
        "digits": film.digits,
        "box": [_short(x) for x in film.box.ravel()], "scale": _scale(film), "traceLayer": SLOT,
        "frames": frames, "marks": [_mark(mark, shapes) for mark in scene.marks],
        "shapes": [points for _, points in shapes.values()],
        "labels": [{"f": x.frame, "x": _short(x.point[0]), "y": _short(x.point[1]), "t": x.text.split("\n"),
                    "b": x.body, "d": [round(d * PIXELS, 1) for d in x.shift]}
                   for x in scene.labels],
        "items": items, "traces": traces, "plots": plots,
        "styles": {name: asdict(style) for name, style in STYLES.items()},
        "light": LIGHT, "dark": DARK, "bodiesLight": BODIES_LIGHT, "bodiesDark": BODIES_DARK,
        "seriesLight": SERIES_LIGHT, "seriesDark": SERIES_DARK,
        "columns": store.columns, "words": store.words,
    }  # fmt: skip


def _short(value: float) -> float:
    """A length with digits enough for a picture."""
    return float(f"{value:.6g}")


def _mark(mark: Mark, shapes: Shapes) -> dict[str, Any]:
    """A mark, and its points among the shapes: links of a chain and their pins are all alike."""
    points = [[_short(x) for x in loop.ravel()] for loop in mark.loops]
    number, _ = shapes.setdefault(repr(points), (len(shapes), points))
    return {
        "f": mark.frame, "s": mark.style, "b": mark.body, "i": mark.item, "l": mark.layer, "c": int(mark.closed),
        "g": mark.group, "k": mark.loops[0].shape[1], "p": number,
    }  # fmt: skip


def _scale(film: Film) -> str:
    """What the size of arrows means, in words."""
    diagonal, told = float(np.hypot(*(film.box[1] - film.box[0]))), []
    for unit, share, what in (("N", 0.15, "arrow"), ("N m", 0.06, "radius")):
        if unit in film.scale:
            value = nice(share * diagonal * film.scale[unit])
            told.append(f"{value:g} {unit}: {what} of {value / film.scale[unit]:.3g} m")
    return "; ".join(told)
