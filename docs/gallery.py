"""Sphinx extension: a page for every script of ``examples/``, from its docstring, its picture and its text.

The pictures are in ``docs/gallery``; ``python docs/gallery.py [NAME ...]``
makes them anew by running the scripts.
"""

from __future__ import annotations

import ast
import os
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
EXAMPLES, PICTURES, TARGET = HERE.parent / "examples", HERE / "gallery", HERE / "examples"

#: Width of a picture, pixels, and its colours.
WIDTH, COLOURS = 1100, 96

#: From the first pendulum to designs; every script is in one of the groups.
GROUPS = {
    "First steps": ("first_mechanism", "slider_crank", "four_bar_output"),
    "Machine elements": ("walking_leg", "planetary_train", "cam", "dc_motor"),
    "Statics, vibration, tolerances": ("buckling", "modes", "tolerances", "identify_friction"),
    "Optimal control": ("cart_pole", "four_bar_torque", "least_time", "five_bar_robot", "parking"),
    "Design and control": ("periodic_linkage", "slider_crank_balance", "cart_pole_control"),
}


def question(name: str) -> tuple[str, str]:
    """First sentence and the rest of the docstring of an example."""
    text = ast.get_docstring(ast.parse((EXAMPLES / f"{name}.py").read_text(encoding="utf-8"))) or ""
    first, _, rest = text.partition("\n\n")
    return " ".join(first.split()), rest


def write_pages(app: object = None) -> None:
    """Write the index and a page for each example, where they are not as they should be."""
    TARGET.mkdir(exist_ok=True)
    index = ["# Examples", "", "Every script asks a question, draws a picture, and runs in under a minute.", ""]
    for group, names in GROUPS.items():
        index += [f"## {group}", "", "::::{container} gallery"]
        for name in names:
            first, rest = question(name)
            title = name.replace("_", " ").capitalize()
            picture = f"../gallery/{name}.png"
            index += [
                ":::{container} tile",
                f"[![{title}]({picture})]({name}.md)",
                f"[{title}]({name}.md). {first}",
                ":::",
            ]
            page = [f"# {title}", "", first, "", rest, "", f"![{title}]({picture})", ""]
            page += [f"```{{literalinclude}} ../../examples/{name}.py", ":language: python", ":name: script", "```", ""]
            write(TARGET / f"{name}.md", "\n".join(page))
        index += ["::::", ""]
    listed = [name for names in GROUPS.values() for name in names]
    index += ["```{toctree}", ":hidden:", "", *listed, "```", ""]
    write(TARGET / "index.md", "\n".join(index))


def write(path: Path, text: str) -> None:
    """Write a file unless it has this text already, so that nothing is built twice."""
    if not path.exists() or path.read_text(encoding="utf-8") != text:
        path.write_text(text, encoding="utf-8")


def keep(picture: Path, target: Path) -> None:
    """Keep a picture, no wider than the page and in few colours: drawings need no more."""
    from PIL import Image

    image = Image.open(picture).convert("RGB")
    if image.width > WIDTH:
        image = image.resize((WIDTH, round(image.height * WIDTH / image.width)), Image.Resampling.LANCZOS)
    image.quantize(COLOURS, dither=Image.Dither.NONE).save(target, optimize=True)


def make_pictures(names: list[str]) -> None:
    """Run examples, and keep the picture that each draws."""
    PICTURES.mkdir(exist_ok=True)
    for name in names:
        with tempfile.TemporaryDirectory() as folder:
            environment = os.environ | {"PYTHONPATH": str(HERE.parent), "MPLBACKEND": "Agg"}
            script = [sys.executable, str(EXAMPLES / f"{name}.py"), f"{name}.png"]
            subprocess.run(script, cwd=folder, check=True, env=environment, stdout=subprocess.DEVNULL)
            (picture,) = Path(folder).glob("*.png")
            keep(picture, PICTURES / f"{name}.png")
        print(name)


def setup(app: object) -> dict[str, bool]:
    """Write the pages before anything is read."""
    app.connect("builder-inited", write_pages)  # type: ignore[attr-defined]
    return {"parallel_read_safe": True}


if __name__ == "__main__":
    make_pictures(sys.argv[1:] or [name for names in GROUPS.values() for name in names])
