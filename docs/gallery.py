"""Sphinx extension: a page for every script of ``examples/``, from its docstring, its picture and its text.

The pictures are in ``docs/gallery``; ``python docs/gallery.py [NAME ...]``
makes them anew by running the scripts.
"""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
EXAMPLES, PICTURES, TARGET = HERE.parent / "examples", HERE / "gallery", HERE / "examples"
#: Pages for the browser; what is in it is copied into the site.
PAGES = PICTURES / "pages"

#: Width of a picture, pixels, and its colours.
WIDTH, COLOURS = 1100, 96

#: From the first pendulum to designs; every script is in one of the groups.
GROUPS = {
    "First steps": ("first_mechanism", "slider_crank", "four_bar_output"),
    "Machine elements": ("walking_leg", "planetary_train", "cam", "dc_motor"),
    "Statics, vibration, tolerances": ("buckling", "modes", "tolerances", "identify_friction"),
    "Optimal control": ("cart_pole", "four_bar_torque", "least_time", "five_bar_robot", "parking", "shuffleboard"),
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
    index = [
        "# Examples",
        "",
        "Every script asks a question, draws a picture, and runs in under a minute (`examples/`).",
        "",
    ]
    for group, names in GROUPS.items():
        index += [f"## {group}", "", "::::{container} gallery"]
        for name in names:
            first, rest = question(name)
            title = name.replace("_", " ").capitalize().replace("Dc ", "DC ")
            picture = f"../gallery/{name}.png"
            index += [
                ":::{container} tile",
                f"[![{title}](../gallery/{name}_mechanism.png)]({name}.md)",
                f"[{title}]({name}.md). {first}",
                ":::",
            ]
            drawing = f'![The mechanism](../gallery/{name}_mechanism.png){{width="60%"}}'
            page = [f"# {title}", "", first, "", rest, "", drawing, "", f"![What the script draws]({picture})", ""]
            if (PAGES / "gallery" / f"{name}.html").exists():
                page += ["```{raw} html", FRAME.format(name=name, title=title), "```", ""]
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


#: Shows the page that an example writes.
FRAME = """<iframe src="../gallery/{name}.html" title="{title} in motion" loading="lazy"
style="width: 100%; height: 36rem; border: 1px solid var(--color-background-border); border-radius: 6px"></iframe>"""

#: Runs an example as its author would, and then draws the mechanism that it is about.
RUN = """
import runpy, sys
import mbdcasadi as mbd
script, target = sys.argv[1:]
sys.argv = [script, "picture.png"]
names = runpy.run_path(script, run_name="__main__").values()
models = [x for x in names if isinstance(x, mbd.Mechanism | mbd.library.Model)]
mbd.draw(models[0], names=True).figure.savefig(target, dpi=110)
"""


def make_pictures(names: list[str]) -> None:
    """Run examples; keep the picture that each draws, its page for the browser, and its mechanism."""
    (PAGES / "gallery").mkdir(parents=True, exist_ok=True)
    for name in names:
        with tempfile.TemporaryDirectory() as folder:
            environment = os.environ | {"PYTHONPATH": str(HERE.parent), "MPLBACKEND": "Agg"}
            drawing = Path(folder) / "drawn" / "mechanism.png"
            drawing.parent.mkdir()
            command = [sys.executable, "-c", RUN, str(EXAMPLES / f"{name}.py"), str(drawing)]
            subprocess.run(command, cwd=folder, check=True, env=environment, stdout=subprocess.DEVNULL)
            (picture,) = Path(folder).glob("*.png")
            keep(picture, PICTURES / f"{name}.png")
            keep(drawing, PICTURES / f"{name}_mechanism.png")
            for page in Path(folder).glob("*.html"):
                shutil.copy(page, PAGES / "gallery" / f"{name}.html")
        print(name)


def setup(app: object) -> dict[str, bool]:
    """Write the pages before anything is read."""
    app.connect("builder-inited", write_pages)  # type: ignore[attr-defined]
    return {"parallel_read_safe": True}


if __name__ == "__main__":
    make_pictures(sys.argv[1:] or [name for names in GROUPS.values() for name in names])
