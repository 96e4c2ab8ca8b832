"""The layers of the package and their picture.

``python docs/layers.py`` draws ``docs/figures/layers.svg``; the tests hold the list against the imports.
"""

from __future__ import annotations

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch

TARGET = Path(__file__).resolve().parent / "figures" / "layers.svg"

#: Rooms by layer, the topmost first: a room imports from layers below its own, never from its own or above.
LAYERS: tuple[dict[str, str], ...] = (
    {"__main__": "command line"},
    {"__init__": "public names"},
    {"synthesis": "linkages through positions"},
    {"visual": "drawings, plots, films, the page"},
    {"control": "controllers in C"},
    {"sweeping": "many runs", "identification": "parameters from data", "optimal_control": "direct collocation"},
    {
        "inverse_dynamics": "loads of a motion",
        "statics": "equilibria, paths",
        "linear": "linear models, modes",
        "sensitivity": "derivatives of motions",
        "fmu": "functional mock-up units",
        "writing": "model files of others",
    },
    {"simulation": "runs, events, impacts, stick and slip"},
    {"kinematics": "driven motion, check"},
    {"assembly": "consistent starts; Setup reads all arguments"},
    {"arguments": "inputs, parameters, times"},
    {"results": "states, trajectories, export"},
    {"equations": "M, Q, Φ and their functions", "integrators": "one method a file"},
    {"files": "model files", "library": "ready mechanisms"},
    {"model": "bodies, joints, forces, geometry, mechanism"},
    {"printing": "expressions as text"},
    {"numerics": "Newton, homotopy, rank"},
    {"errors": "errors and warnings"},
)


def draw() -> Figure:
    """Draw the layers as shelves, the user on top."""
    height, gap, width = 1.0, 0.28, 14.0
    figure = Figure(figsize=(7.6, 0.47 * len(LAYERS)))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set_xlim(-0.2, width + 0.2)
    axes.set_ylim(-0.2, len(LAYERS) * (height + gap))
    axes.axis("off")
    for level, rooms in enumerate(reversed(LAYERS)):
        y, each = level * (height + gap), width / len(rooms)
        for k, (room, text) in enumerate(rooms.items()):
            box = FancyBboxPatch(
                (k * each + 0.06, y), each - 0.12, height, boxstyle="round,pad=0,rounding_size=0.15",
                facecolor="#dfe7ef", edgecolor="#46627f", linewidth=0.9,
            )  # fmt: skip
            axes.add_patch(box)
            axes.text(k * each + each / 2, y + 0.63 * height, room, ha="center", va="center", size=8, weight="bold")
            axes.text(k * each + each / 2, y + 0.25 * height, text, ha="center", va="center", size=6.2)
    return figure


if __name__ == "__main__":
    with matplotlib.rc_context({"svg.fonttype": "none", "svg.hashsalt": "layers", "font.family": "sans-serif"}):
        draw().savefig(TARGET, metadata={"Date": None})
