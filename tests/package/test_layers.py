"""The layers of the package: imports run one way, and the picture in the documentation shows today's rooms."""

from __future__ import annotations

import ast
import importlib
import importlib.util
import re
from collections.abc import Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "mbdcasadi"

_spec = importlib.util.spec_from_file_location("layers", ROOT / "docs" / "layers.py")
layers = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(layers)

#: Height of each room; higher ones may import lower ones.
HEIGHT = {room: -level for level, rooms in enumerate(layers.LAYERS) for room in rooms}

#: Rooms inside rooms: each may import those before it in its line, and the files beside them; not those of one string.
INNER = {
    "integrators": ("native", "dop853 bdf"),
    "model": ("geometry", "joints", "forces", "ropes"),
    "optimal_control": (
        "statement",
        "transcription",
        "poses",
        "program",
        "motion",
        "solve",
        "measures",
        "search",
        "friction",
    ),
    "equations": ("switching",),
    "simulation": ("contact", "checks", "formulations", "changes", "singular", "stepping"),
    "visual": ("drawing", "plots"),
}

#: Rooms whose modules import each other without circles.
WITHOUT_CIRCLES = tuple(sorted(set(HEIGHT) - {"__init__", "__main__", "errors"}))


@cache
def imports() -> tuple[tuple[Path, tuple[str, ...], int], ...]:
    """Every import of one module of the package by another."""
    return tuple(_imports())


def _imports() -> Iterator[tuple[Path, tuple[str, ...], int]]:
    """File, target from the root of the package, and line of each import, also inside functions."""
    for file in sorted(PACKAGE.rglob("*.py")):
        package = file.relative_to(PACKAGE).parts[:-1]
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and node.level:
                base = package[: len(package) - node.level + 1]
                named = tuple(node.module.split(".")) if node.module else ()
                for name in node.names:
                    yield file, (*base, *named, name.name), node.lineno
            elif isinstance(node, ast.ImportFrom | ast.Import):
                names = [node.module or ""] if isinstance(node, ast.ImportFrom) else [a.name for a in node.names]
                for name in names:
                    if name.split(".")[0] == "mbdcasadi":
                        yield file, tuple(name.split(".")[1:]) or ("__init__",), node.lineno


def room(parts: tuple[str, ...]) -> str:
    """First folder of a path, or the file itself; names of the package itself are those of ``__init__``."""
    return parts[0].removesuffix(".py") if parts and parts[0].removesuffix(".py") in HEIGHT else "__init__"


def test_every_room_has_its_layer():
    """Folders and files of the package are those of the list, and each stands in one layer."""
    there = {p.name.removesuffix(".py") for p in PACKAGE.iterdir() if p.suffix == ".py" or (p / "__init__.py").exists()}
    assert there == set(HEIGHT)
    assert sum(len(rooms) for rooms in layers.LAYERS) == len(HEIGHT)


@pytest.mark.slow
@pytest.mark.parametrize("name", HEIGHT)
def test_imports_run_downwards(name):
    """A room imports from lower layers only, also inside functions."""
    wrong = [
        f"{file.relative_to(ROOT)}:{line} imports {'.'.join(target)}"
        for file, target, line in imports()
        if room(file.relative_to(PACKAGE).parts) == name
        and room(target) != name
        and HEIGHT[room(target)] >= HEIGHT[name]
    ]
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("name", INNER)
def test_imports_inside_a_room(name):
    """Inner rooms that are listed import earlier ones of their line only."""
    level, wrong = {room: k for k, rooms in enumerate(INNER[name]) for room in rooms.split()}, []
    for file, target, line in imports():
        own = file.relative_to(PACKAGE).parts
        if own[0] != name or target[0] != name or len(own) < 3 or len(target) < 3:
            continue
        if own[1] != target[1] and {own[1], target[1]} <= level.keys() and level[target[1]] >= level[own[1]]:
            wrong.append(f"{file.relative_to(ROOT)}:{line} imports {'.'.join(target)}")
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("name", WITHOUT_CIRCLES)
def test_modules_of_a_room_form_no_circle(name):
    """Modules can be put in an order in which each imports earlier ones alone; imports for types count."""
    files = {file.relative_to(PACKAGE).with_suffix("").parts for file in PACKAGE.joinpath(name).rglob("*.py")}
    needed = {file: set() for file in files}
    for file, target, _ in imports():
        own = file.relative_to(PACKAGE).with_suffix("").parts
        for module in (target, target[:-1], (*target, "__init__"), (*target[:-1], "__init__")):
            if own in files and module in files and module != own:
                needed[own].add(module)
                break
    try:
        list(TopologicalSorter(needed).static_order())
    except CycleError as error:
        pytest.fail(" -> ".join("/".join(module) for module in error.args[1]))


def test_the_test_sees_imports():
    """Known imports are among those that it walks over: a relative one, one of a module, one in a function."""
    seen = {(str(file.relative_to(PACKAGE)), *target[:2]) for file, target, _ in imports()}
    assert ("simulation/simulate.py", "assembly", "setup") in seen
    assert ("visual/symbols/__init__.py", "visual", "symbols") in seen
    assert ("__main__.py", "__init__") in seen or ("__main__.py", "files", "acf") in seen


def test_the_picture_shows_the_layers():
    """``python docs/layers.py`` was run after the last change of the list."""
    text = layers.TARGET.read_text(encoding="utf-8")
    places = {name: text.find(f">{name}</text>") for name in HEIGHT}
    assert all(place > 0 for place in places.values()), places


# --- docs/architecture.md -----------------------------------------------------------------------
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("path", sorted(set(re.findall(r"`((?:mbdcasadi|docs|tests)/[\w/.]+)`", PAGE))))
def test_paths_of_the_page_exist(path):
    """Files and folders that the page names."""
    assert (ROOT / path).exists()


@pytest.mark.parametrize("path, name", re.findall(r"\| `(mbdcasadi/[\w/.]+)` \| `(\w+)` \|", PAGE))
def test_names_of_the_walks_are_defined(path, name):
    """Each step of the two walks is a class or a function of its file."""
    tree = ast.parse((ROOT / path).read_text(encoding="utf-8"))
    defined = {node.name for node in ast.walk(tree) if isinstance(node, ast.ClassDef | ast.FunctionDef)}
    assert name in defined


@pytest.mark.parametrize("names, path", re.findall(r"\| `([A-Z_]+)`[^|]*in `(mbdcasadi/[\w/.]+)` \|", PAGE))
def test_lists_of_the_page_are_defined(names, path):
    """Each list in which a new thing is entered stands in its file."""
    module = importlib.import_module(path.removesuffix(".py").removesuffix("/__init__").replace("/", "."))
    assert len(getattr(module, names))


def test_rooms_of_the_page_are_those_of_the_list():
    """Each once, from the bottom to the top."""
    rooms = re.findall(r"^\| `(\w+)` \| [^|]*\| `mbdcasadi/\w", PAGE, re.MULTILINE)
    assert sorted(rooms) == sorted(set(HEIGHT) - {"__init__", "__main__"})
    assert [HEIGHT[room] for room in rooms] == sorted(HEIGHT[room] for room in rooms)
