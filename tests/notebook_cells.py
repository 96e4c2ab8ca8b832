"""Runs the cells of the notebooks, and compares what they print with the outputs that are stored in them.

``python tests/notebook_cells.py [NOTEBOOK ...]`` runs notebooks from their first cell to the last and stores the
outputs: what is printed, and the value of the last line as text, HTML or a picture. It needs no Jupyter.
"""

from __future__ import annotations

import ast
import base64
import contextlib
import io
import json
import sys
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

ROOT = Path(__file__).resolve().parents[1]
NOTEBOOKS = sorted((ROOT / "examples" / "notebooks").glob("*.ipynb"))


def run_cell(source: str, names: dict[str, Any], file: str) -> tuple[str, Any]:
    """Run a cell; return what it prints, and the value of its last line if that is an expression."""
    tree = ast.parse(source, file)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    stream = io.StringIO()
    with contextlib.redirect_stdout(stream):
        exec(compile(tree, file, "exec"), names)
        value = None if last is None else eval(compile(ast.Expression(last.value), file, "eval"), names)
    return stream.getvalue(), value


def run_notebook(path: Path) -> list[tuple[dict[str, Any], str, Any]]:
    """Run the code cells of a notebook in order; return each with what it prints, and its value."""
    names: dict[str, Any] = {"__name__": "__main__"}
    cells = [cell for cell in json.loads(path.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == "code"]
    return [
        (cell, *run_cell("".join(cell["source"]), names, f"{path.name}, cell {k}")) for k, cell in enumerate(cells, 1)
    ]


def printed(cell: dict[str, Any]) -> str:
    """Return the stored text that a cell printed."""
    return "".join("".join(output["text"]) for output in cell["outputs"] if output["output_type"] == "stream")


def outputs_of(text: str, value: Any, count: int) -> list[dict[str, Any]]:
    """Return outputs in the form of a notebook."""
    outputs: list[dict[str, Any]] = []
    if text:
        outputs.append({"output_type": "stream", "name": "stdout", "text": text.splitlines(keepends=True)})
    if value is None:
        return outputs
    data: dict[str, Any] = {"text/plain": [repr(value)]}
    if isinstance(value, Figure):
        picture = io.BytesIO()
        value.savefig(picture, format="png", dpi=70)
        data["image/png"] = base64.b64encode(picture.getvalue()).decode()
    elif hasattr(value, "_repr_html_") and len(value._repr_html_()) < 50_000:
        data["text/html"] = [value._repr_html_()]
    outputs.append({"output_type": "execute_result", "execution_count": count, "metadata": {}, "data": data})
    return outputs


def store(path: Path) -> None:
    """Run a notebook and write its outputs into it."""
    content = json.loads(path.read_text(encoding="utf-8"))
    cells = [cell for cell in content["cells"] if cell["cell_type"] == "code"]
    for count, (cell, (_, text, value)) in enumerate(zip(cells, run_notebook(path), strict=True), 1):
        cell["execution_count"], cell["outputs"] = count, outputs_of(text, value, count)
    path.write_text(json.dumps(content, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    for notebook in map(Path, sys.argv[1:]) if sys.argv[1:] else NOTEBOOKS:
        store(notebook)
