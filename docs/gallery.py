"""Sphinx extension: a page for every script of ``examples/``, from its docstring, its picture and its text.

The pictures are in ``docs/gallery``; ``python docs/gallery.py [NAME ...]``
regenerates them by running the scripts. Pages for the browser are made when the
site is built, where the package or the script has changed since.
"""

from __future__ import annotations

import ast
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

HERE = Path(__file__).resolve().parent
EXAMPLES, PICTURES, TARGET = HERE.parent / "examples", HERE / "gallery", HERE / "examples"
#: Pages for the browser; what is in it is copied into the site.
BROWSER = HERE / "_pages"
#: Runs the code of a page of the documentation in the current folder.
RUN_PAGE = "import sys, pathlib, documentation_blocks as d; d.run_page(pathlib.Path(sys.argv[1]))"

#: Pages of the documentation that show pages for the browser, which their code writes.
SHOWING = ("pictures.md", "play.md")

#: Width of a picture, pixels, and colours of the film on the front page.
WIDTH, COLOURS = 1100, 96

#: From the first pendulum to designs; every script is in one of the groups.
GROUPS = {
    "First steps": ("first_mechanism", "slider_crank", "four_bar_output"),
    "Linkages from positions": ("straight_line", "wiper"),
    "Machine elements": (
        "walking_leg",
        "planetary_train",
        "cam",
        "excavator",
        "elevator",
        "hoist",
        "garage_door",
        "motorcycle",
        "robot_walker",
        "dc_motor",
    ),
    "Statics, vibration, tolerances": ("buckling", "modes", "tolerances"),
    "Measured motions": ("identify_friction", "measured_kick"),
    "Optimal control": ("cart_pole", "four_bar_torque", "least_time", "crane_servo", "five_bar_robot", "parking"),
    "Friction and contact in an order that is found": ("stick_slip", "shuffleboard", "hopper", "sorting_plate"),
    "Design and control": ("periodic_linkage", "slider_crank_balance", "cart_pole_control"),
    "Motions in phases": (
        "rimless_wheel",
        "compass_walker",
        "five_link_biped",
        "trebuchet",
        "throwing_arm",
        "gripper",
        "geneva_drive",
    ),
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
            tile = f"{name}.gif" if (PICTURES / f"{name}.gif").exists() else f"{name}_mechanism.png"
            index += [
                ":::{container} tile",
                f"[![{title}](../gallery/{tile})]({name}.md)",
                f"[{title}]({name}.md). {first}",
                ":::",
            ]
            drawing = f'![The mechanism](../gallery/{name}_mechanism.png){{width="60%"}}'
            page = [f"# {title}", "", first, "", rest, "", drawing, "", f"![What the script draws]({picture})", ""]
            if name in animated():
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
    """Keep a picture in all its colours, no wider than the page: in few, two curves may become one."""
    from PIL import Image

    image = Image.open(picture).convert("RGB")
    if image.width > WIDTH:
        image = image.resize((WIDTH, round(image.height * WIDTH / image.width)), Image.Resampling.LANCZOS)
    image.save(target, optimize=True)


#: Shows the page that an example writes.
FRAME = """<iframe src="../gallery/{name}.html" title="{title} in motion" loading="lazy"
style="width: 100%; height: 36rem; border: 1px solid var(--color-background-border); border-radius: 6px"></iframe>"""

#: Runs an example as its author would, draws the mechanism that it is about, and films the motion that it finds.
RUN = """
import runpy, sys
from pathlib import Path
import mbdcasadi as mbd
from gallery_tiles import save_tile
script, target, tile = sys.argv[1:]
names = list(runpy.run_path(script, run_name="__main__").values())
save_tile(names, Path(tile))
models = [x for x in names if isinstance(x, mbd.Mechanism | mbd.library.Model)]
mbd.draw(models[0], names=True).figure.savefig(target, dpi=110)
"""


def run(folder: str, *arguments: str) -> None:
    """Run Python in a folder, on the package and the tools of this checkout."""
    paths = os.pathsep.join(str(HERE.parent / part) for part in ("", "tests", "docs"))
    environment = os.environ | {"PYTHONPATH": paths, "MPLBACKEND": "Agg"}
    subprocess.run([sys.executable, *arguments], cwd=folder, check=True, env=environment, stdout=subprocess.DEVNULL)


def animated() -> list[str]:
    """Examples that write a page for the browser."""
    return [path.stem for path in sorted(EXAMPLES.glob("*.py")) if '.html"' in path.read_text(encoding="utf-8")]


def make_browser_page(script: Path, targets: Sequence[Path], *arguments: str) -> None:
    """Make the pages that a script writes, unless there are some younger than the script and the package."""
    sources = [
        script,
        *(path for path in (HERE.parent / "mbdcasadi").rglob("*") if path.suffix in (".py", ".js", ".css", ".html")),
    ]
    newest = max(path.stat().st_mtime for path in sources)
    if all(target.exists() and target.stat().st_mtime > newest for target in targets):
        return
    with tempfile.TemporaryDirectory() as folder:
        run(folder, *arguments, str(copied(script, folder) if script.suffix == ".py" else script))
        pages = list(Path(folder).rglob("*.html"))
        for target in targets:
            page = pages[0] if len(pages) == 1 else next(page for page in pages if page.name == target.name)
            shutil.copy(page, target)


def copied(script: Path, folder: str) -> Path:
    """Copy a script into a folder, with the models and the folder that examples write to, and return the copy."""
    (Path(folder) / "output").mkdir()
    shutil.copytree(EXAMPLES / "models", Path(folder) / "models")
    return Path(shutil.copy(script, folder))


def make_browser_pages(app: object, config: object) -> None:
    """Make the pages for the browser: those of the examples, and those that pages of the documentation show."""
    (BROWSER / "gallery").mkdir(parents=True, exist_ok=True)
    jobs = [partial(make_browser_page, EXAMPLES / f"{n}.py", [BROWSER / "gallery" / f"{n}.html"]) for n in animated()]
    for page in SHOWING:
        shown = re.findall(r'src="([\w-]+\.html)"', (HERE / page).read_text(encoding="utf-8"))
        jobs.append(partial(make_browser_page, HERE / page, [BROWSER / name for name in shown], "-c", RUN_PAGE))
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for job in [pool.submit(job) for job in jobs]:
            job.result()


def make_pictures(names: list[str]) -> None:
    """Run examples; keep the picture that each draws, and its mechanism."""
    for name in names:
        with tempfile.TemporaryDirectory() as folder:
            drawing = Path(folder) / "mechanism.png"
            tile = PICTURES / f"{name}.gif"
            run(folder, "-c", RUN, str(copied(EXAMPLES / f"{name}.py", folder)), str(drawing), str(tile))
            (picture,) = (Path(folder) / "output").glob("*.png")
            keep(picture, PICTURES / f"{name}.png")
            keep(drawing, PICTURES / f"{name}_mechanism.png")
        print(name)


#: Part of the film of the walking leg that the front page shows, pixels: the drawing without its axes.
CROP = (90, 92, 585, 612)


def make_film() -> None:
    """Make the picture that moves on the front page, from the film of the walking leg."""
    with tempfile.TemporaryDirectory() as folder:
        run(folder, str(copied(EXAMPLES / "walking_leg.py", folder)))
        crop_film(Path(folder) / "output" / "walking_leg.gif", HERE / "walking_leg.gif")


def crop_film(film: Path, target: Path) -> None:
    """Keep a part of every frame of a film."""
    from PIL import Image, ImageSequence

    with Image.open(film) as whole:
        times = [frame.info.get("duration", 100) for frame in ImageSequence.Iterator(whole)]
        frames = [frame.convert("RGB").crop(CROP) for frame in ImageSequence.Iterator(whole)]
    for frame in frames:
        frame.info.clear()  # what is transparent in one frame has another number in the next
    palette = frames[0].quantize(COLOURS, dither=Image.Dither.NONE)
    frames = [frame.quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    frames[0].save(target, save_all=True, append_images=frames[1:], duration=times, loop=0, optimize=True)


def setup(app: object) -> dict[str, bool]:
    """Write the pages before anything is read, and those for the browser before they are looked for."""
    app.connect("config-inited", make_browser_pages)  # type: ignore[attr-defined]
    app.connect("builder-inited", write_pages)  # type: ignore[attr-defined]
    return {"parallel_read_safe": True}


if __name__ == "__main__":
    if sys.argv[1:] != ["film"]:
        make_pictures(sys.argv[1:] or [name for names in GROUPS.values() for name in names])
    if sys.argv[1:] in ([], ["film"]):
        make_film()
