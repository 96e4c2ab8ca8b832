"""Sphinx extension: links between the API reference and the pages that use it.

In the overview, names of the package become links to the reference. A page of the reference whose docstring
has no example of its own shows the shortest statement of the documentation, the examples or the tests that
uses the name; all of these are run by the tests.
"""

from __future__ import annotations

import ast
import inspect
import re
from functools import cache
from pathlib import Path

import mbdcasadi as mbd

HERE = Path(__file__).resolve().parent
#: Lines of the longest statement that is shown.
LONGEST = 8
#: Statements that are shown.
SHOWN = (ast.Assign, ast.Expr)
#: Pages whose code spans become links.
LINKED = ("overview",)
FENCE = re.compile(r"^```python[^\n]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def sources() -> list[list[tuple[str, str]]]:
    """Return (where it stands, code) of all Python code that may be shown, the preferred kind first."""
    pages = sorted(page for page in HERE.rglob("*.md") if not {"_build", "examples"} & set(page.parts))
    in_pages = [
        (f":doc:`/{page.relative_to(HERE).with_suffix('').as_posix()}`", code)
        for page in pages
        for code in FENCE.findall(page.read_text(encoding="utf-8"))
    ]
    scripts = [
        (f":doc:`/examples/{path.stem}`", path.read_text(encoding="utf-8"))
        for path in sorted((HERE.parent / "examples").glob("*.py"))
    ]
    tests = [
        (f"``{path.relative_to(HERE.parent).as_posix()}``", path.read_text(encoding="utf-8"))
        for path in sorted((HERE.parent / "tests").rglob("test_*.py"))
    ]
    return [in_pages, scripts, tests]


@cache
def uses() -> dict[str, tuple[str, str]]:
    """Return by public name the code that is shown, and where it stands."""
    found: dict[str, tuple[str, str]] = {}
    for kind in sources():
        shortest: dict[str, tuple[str, str]] = {}
        for place, code in kind:
            lines = code.splitlines()
            for statement in (node for node in ast.walk(ast.parse(code)) if isinstance(node, SHOWN)):
                text = inspect.cleandoc("\n".join(lines[statement.lineno - 1 : statement.end_lineno]))
                if text.count("\n") >= LONGEST:
                    continue
                for name in set(re.findall(r"\bmbd\.(\w+)(?=[(.])", text)):
                    if name not in shortest or len(text) < len(shortest[name][0]):
                        shortest[name] = (text, place)
        found = shortest | found
    return found


def add_example(app, what, name, thing, options, lines):
    """Append the statement that uses a public name to its docstring."""
    short = name.removeprefix("mbdcasadi.")
    has_example = any(line.strip() in (".. rubric:: Examples", "Examples") for line in lines)
    if "." in short or short not in uses() or has_example:
        return
    code, place = uses()[short]
    lines += ["", ".. rubric:: Examples", "", ".. code-block:: python", ""]
    lines += [f"   {line}" for line in code.splitlines()]
    lines += ["", f"From {place}.", ""]


def link_names(app, page, content):
    """Replace code spans that list public names by links to the reference."""
    if page not in LINKED:
        return
    names = {name for name in dir(mbd) if not name.startswith("_") and not inspect.ismodule(getattr(mbd, name))}

    def linked(span: re.Match) -> str:
        words = span[1].split(", ")
        if not set(words) <= names:
            return span[0]
        return ", ".join(f"{{py:obj}}`~mbdcasadi.{word}`" for word in words)

    content[0] = re.sub(r"(?<!`)`([A-Za-z_, ]+)`(?!`)", linked, content[0])


def setup(app):
    """Connect the handlers of Sphinx events."""
    app.connect("autodoc-process-docstring", add_example)
    app.connect("source-read", link_names)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
