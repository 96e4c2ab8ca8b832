"""Colours and strokes of drawings, by their meaning; the same in Matplotlib and in the page."""

from __future__ import annotations

from dataclasses import dataclass

#: Fill and edge of bodies, in turn: distinct also to those who see red and green alike.
BODIES_LIGHT = (
    ("#a9c6e8", "#1f4e85"), ("#f0c9a0", "#99591a"), ("#b5dcc3", "#256a4a"), ("#ecbcc2", "#99303f"),
    ("#d3c4e8", "#5d3f8c"), ("#cfd5da", "#4a545c"), ("#b3dde6", "#1c6b7e"), ("#ead9a4", "#7d6412"),
)  # fmt: skip
BODIES_DARK = (
    ("#2f5682", "#9cc3f0"), ("#7d5426", "#f2c48f"), ("#2c6348", "#9bdcb6"), ("#7f3541", "#f3b1ba"),
    ("#57427d", "#cdb8ee"), ("#4c565e", "#ccd4da"), ("#23616f", "#9fdbe8"), ("#6d5a1c", "#ead68e"),
)  # fmt: skip

#: Lines of plots, distinct also in print.
SERIES_LIGHT = ("#1f5fa8", "#d1495b", "#2e8b6f", "#e0a030", "#7a5195", "#5b6770", "#3aa6c4", "#a0522d")
SERIES_DARK = ("#7db4f0", "#ff8fa0", "#6fd3a8", "#f0c060", "#c5a1e0", "#b4bfc8", "#7fd4ea", "#dfa07a")


def series_colour(k: int) -> str:
    """Return the colour of a line of a plot, by its number."""
    return SERIES_LIGHT[k % len(SERIES_LIGHT)]


LIGHT = {
    "ink": "#20272e", "paper": "#ffffff", "muted": "#77828c", "ground": "#5b6770", "soil": "#e4e8eb",
    "spring": "#3d4852", "rubber": "#8d7b6c", "force": "#c22f43", "reaction": "#1f6f4a", "weight": "#77828c",
    "motion": "#c46f0a", "trace": "#7a5195", "velocity": "#1f5fa8",
}  # fmt: skip
DARK = {
    "ink": "#e6ebef", "paper": "#14191e", "muted": "#8d99a3", "ground": "#a5b0b9", "soil": "#2b333a",
    "spring": "#c9d2d9", "rubber": "#a8917d", "force": "#ff7b8b", "reaction": "#5fd19a", "weight": "#8d99a3",
    "motion": "#f5ab4e", "trace": "#c5a1e0", "velocity": "#7db4f0",
}  # fmt: skip


@dataclass(frozen=True)
class Style:
    """Fill and stroke of a mark.

    Attributes
    ----------
    fill, stroke : str or None
        Key of a colour; ``"body"`` stands for the fill and the edge of the body that the mark belongs to.
    width : float
        Of the stroke, points.
    dash : tuple of float
        Lengths of dash and gap, points; () for a line without gaps.
    """

    fill: str | None = None
    stroke: str | None = None
    width: float = 1.2
    dash: tuple[float, ...] = ()


STYLES = {
    "body": Style("body", "body", 1.2),
    "body line": Style(None, "body", 2.2),
    "mark on body": Style(None, "body", 0.8),
    "pitch": Style(None, "body", 0.7, (7.0, 2.5, 1.5, 2.5)),
    "pin": Style("paper", "ink", 1.3),
    "dot": Style("ink", "ink", 0.6),
    "line": Style(None, "ink", 1.4),
    "link": Style(None, "ink", 2.0),
    "ground": Style("soil", "ground", 1.2),
    "ground line": Style(None, "ground", 1.6),
    "hatch": Style(None, "ground", 0.8),
    "slot": Style("paper", "ink", 0.9),
    "block": Style("paper", "ink", 1.1),
    "spring": Style(None, "spring", 1.3),
    "damper": Style(None, "spring", 1.3),
    "barrel": Style("soil", "spring", 1.2),
    "rubber": Style("rubber", "ink", 0.9),
    "tie": Style(None, "muted", 1.0, (4.0, 3.0)),
    "belt": Style(None, "ink", 1.8),
    "drive": Style(None, "motion", 1.0),
    "motion": Style(None, "motion", 1.8),
    "motion head": Style("motion", "motion", 0.8),
    "force": Style(None, "force", 1.9),
    "force head": Style("force", "force", 0.6),
    "reaction": Style(None, "reaction", 1.9),
    "reaction head": Style("reaction", "reaction", 0.6),
    "weight": Style(None, "weight", 1.6),
    "weight head": Style("weight", "weight", 0.6),
    "velocity": Style(None, "velocity", 1.7),
    "velocity head": Style("velocity", "velocity", 0.6),
    "centroid": Style("paper", "ink", 0.9),
    "centroid quarters": Style("ink", None, 0.0),
    "x axis": Style(None, "ink", 1.3),
    "y axis": Style(None, "muted", 1.3),
}


def colours_of(style: Style, body: int | None, theme: dict[str, str], bodies: tuple) -> tuple[str | None, str | None]:
    """Fill and stroke of a style as colours, for the body of that number."""
    fill, edge = bodies[(body or 0) % len(bodies)]
    if body is None:
        fill, edge = theme["soil"], theme["ground"]
    inside = fill if style.fill == "body" else theme.get(style.fill or "")
    return inside, edge if style.stroke == "body" else theme.get(style.stroke or "")
