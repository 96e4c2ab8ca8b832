"""Runs the code blocks of the documentation, and compares what they print with what the page shows.

The Python blocks of a page share their names and run in order. A ``text``
block directly after one shows what it prints (where none follows, that is left open); a warning appears as
``MechanismWarning: …`` and an error, which the block must then raise, as
``AssemblyError: …``. Numbers agree to the digits that the page shows, and
``...`` stands for anything. ``python tests/documentation_blocks.py PAGE ...``
writes what the blocks print and draw into the pages.
"""

from __future__ import annotations

import contextlib
import io
import re
import sys
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import mbdcasadi as mbd

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
FIGURES = DOCS / "figures"
PAGES = [ROOT / "README.md", *sorted(p for p in DOCS.rglob("*.md") if not {"_build", "examples"} & set(p.parts))]

_FENCE = re.compile(r"^```(\w+)[^\n]*\n(.*?)^```$", re.MULTILINE | re.DOTALL)
_ERROR = re.compile(r"^(\w+Error|Interrupted): ", re.MULTILINE)
_NUMBER = re.compile(r"[-+]?\d+(?:\.(\d*))?(?:e([-+]?\d+))?")
#: the same as one group
_CAPTURED = r"([-+]?\d+(?:\.\d*)?(?:e[-+]?\d+)?)"


#: Sides of the grid on which pictures are compared, and the differences up to which they are the same, since fonts and
#: rounding differ from machine to machine: of the grey (0 … 255) of a cell, of that on the mean, of the proportions.
GRID, CELL_DIFFERENCE, MEAN_DIFFERENCE, SIZE_DIFFERENCE = 32, 60.0, 4.0, 0.03


def stale(shown: Path, drawn: Path) -> str | None:
    """Say how a picture of the documentation differs from what its code draws; None if it does not."""
    from PIL import Image

    pictures = [Image.open(path).convert("L") for path in (shown, drawn)]
    (wide, high), (new_wide, new_high) = (picture.size for picture in pictures)
    if abs(wide / high / (new_wide / new_high) - 1) > SIZE_DIFFERENCE:
        return f"{shown.name} has {wide} x {high} pixels, and is drawn with {new_wide} x {new_high}"
    old, new = (np.asarray(picture.resize((GRID, GRID), Image.Resampling.BOX), dtype=float) for picture in pictures)
    apart = np.abs(old - new)
    if apart.max() > CELL_DIFFERENCE or apart.mean() > MEAN_DIFFERENCE:
        return f"{shown.name} is not what its code draws: grey {apart.max():.0f} off, {apart.mean():.1f} on average"
    return None


@dataclass(frozen=True)
class Block:
    """One Python block of a page, and what the page says that it prints."""

    page: Path
    line: int
    code: str
    shown: str | None
    #: where the shown text begins and ends in the page
    span: tuple[int, int]


def blocks_of(page: Path) -> list[Block]:
    """Python blocks of a page in order."""
    text = page.read_text(encoding="utf-8")
    fences = list(_FENCE.finditer(text))
    found = []
    for k, fence in enumerate(fences):
        if fence[1] != "python":
            continue
        after = fences[k + 1] if k + 1 < len(fences) else None
        shown, span = None, (fence.end(), fence.end())
        if after is not None and after[1] == "text" and not text[fence.end() : after.start()].strip():
            shown, span = after[2], (after.start(2), after.end(2))
        found.append(Block(page, text.count("\n", 0, fence.start()) + 2, fence[2], shown, span))
    return found


def printed_by(block: Block, names: dict[str, Any]) -> str:
    """Run a block, and return what it prints, warns and raises."""
    stream = io.StringIO()
    # lines are those of the page, for tracebacks
    code = compile("\n" * (block.line - 1) + block.code, str(block.page), "exec")
    with contextlib.redirect_stdout(stream), warnings.catch_warnings():
        warnings.simplefilter("always", mbd.MechanismWarning)
        warnings.showwarning = lambda message, kind, *_: print(f"{kind.__name__}: {message}", file=stream)
        try:
            exec(code, names)
        except (mbd.MechanismError, mbd.Interrupted) as error:
            if not _ERROR.search(block.shown or ""):
                raise
            print(f"{type(error).__name__}: {error}", file=stream)
    return stream.getvalue()


def agrees(shown: str, printed: str) -> bool:
    """Whether the texts agree: blanks apart, numbers to the digits shown, ``...`` for anything."""
    pattern = []
    for piece in re.split(r"(\.\.\.|\s+)", shown.strip()):
        blank = not piece.strip()
        pattern.append(".*?" if piece == "..." else r"\s+" if blank and piece else _word(piece))
    match = re.fullmatch("".join(pattern), printed.strip(), re.DOTALL)
    if match is None:
        return False
    numbers = [n for piece in re.split(r"\.\.\.", shown) for n in _NUMBER.finditer(piece)]
    return all(_close(n, text) for n, text in zip(numbers, match.groups(), strict=True))


def _word(piece: str) -> str:
    """Pattern of a word: its numbers are taken out, the rest is as it is."""
    parts, last = [], 0
    for number in _NUMBER.finditer(piece):
        parts += [re.escape(piece[last : number.start()]), _CAPTURED]
        last = number.end()
    return "".join([*parts, re.escape(piece[last:])])


def _close(number: re.Match, text: str) -> bool:
    """Whether a number is the shown one, up to two units of its last digit."""
    shown, found = float(number[0]), float(text)
    if number[1] is None and number[2] is None:
        return shown == found
    unit = 10.0 ** (int(number[2] or 0) - len(number[1] or ""))
    return abs(shown - found) <= 2.001 * unit


def run_page(page: Path) -> list[str]:
    """Run the blocks of a page in the current folder; return what differs from what it shows."""
    names: dict[str, Any] = {"__name__": "page"}
    differences = []
    for block in blocks_of(page):
        printed = printed_by(block, names)
        if block.shown is not None and not agrees(block.shown, printed):
            differences.append(f"{page.name}, line {block.line}: shown\n{block.shown}\nprinted\n{printed}")
    return differences


def rewrite(page: Path) -> None:
    """Put into the text blocks of a page what the Python blocks before them print."""
    names: dict[str, Any] = {"__name__": "page"}
    text, parts, last = page.read_text(encoding="utf-8"), [], 0
    for block in blocks_of(page):
        printed = printed_by(block, names)
        printed = "\n".join(line.rstrip() for line in printed.strip("\n").split("\n")) + "\n"
        if block.shown is None or agrees(block.shown, printed):
            continue
        parts += [text[last : block.span[0]], printed]
        last = block.span[1]
    page.write_text("".join([*parts, text[last:]]), encoding="utf-8")


if __name__ == "__main__":
    chosen = [Path(argument).resolve() for argument in sys.argv[1:]] or PAGES[1:]
    FIGURES.mkdir(exist_ok=True)
    for page in chosen:
        with contextlib.chdir(FIGURES):
            rewrite(page)
