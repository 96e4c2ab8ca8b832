"""JSON text of model files, read with tolerance for what editors and people leave behind.

Strict JSON is tried first. Then comments and superfluous commas are taken out,
then the drawing part ``"vis"``, which no analysis needs. Text is taken out by
writing spaces over it, so that a message still gives the place in the file. A reader
of JSON5 knows comments and commas, but accepts no broken drawing part, and does
not report fields that occur twice.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from ..errors import FileError
from ..numerics.reading import content_of

_STRING = r'"(?:\\.|[^"\\\n])*"'
_STRING_OR_COMMENT = re.compile(rf"{_STRING}|//[^\n]*|/\*.*?\*/", re.DOTALL)
_STRING_OR_COMMA = re.compile(rf"{_STRING}|,(?=\s*[}}\]])")
# a text whose closing quote is missing ends with its line
_TEXT_OR_BRACKET = re.compile(r'"(?:\\.|[^"\\\n])*"?|[\[\]{}]')
_DRAWING = re.compile(r'"vis"\s*:\s*')
#: Beginning of a dataset or command file of MSC Adams, whose endings are the same.
_ADAMS = re.compile(r"\s*(!|ADAMS/|UNITS/|OUTPUT/|SIMULATE/)", re.IGNORECASE)
#: Characters between two members.
_BETWEEN = " \t\r\n,"
_SCALAR = re.compile(rf"{_STRING}|[^,}}\]\s]*")


class JsonObject(dict):
    """A JSON object that remembers which of its fields occur more than once."""

    def __init__(self, pairs: list[tuple[str, Any]]):
        super().__init__(pairs)
        names = [name for name, _ in pairs]
        self.repeated = sorted({name for name in names if names.count(name) > 1})


def read_json(path: str | Path) -> JsonObject:
    """Read a file that holds one JSON object; ``"vis"`` is missing if it could not be read.

    A :class:`FileError` with line and column is raised for a file that does not exist or holds something else.
    """
    text = _decoded(content_of(path))
    failure: json.JSONDecodeError | None = None
    for repair in (str, _without_comments_and_commas, _without_drawing, _without_comments_and_commas):
        text = repair(text)
        try:
            content = json.loads(text, object_pairs_hook=JsonObject, strict=False)
        except json.JSONDecodeError as error:
            failure = error
        except (RecursionError, ValueError) as error:
            raise FileError(f"{path}: the file cannot be read as JSON: {error}") from None
        else:
            if not isinstance(content, JsonObject):
                raise FileError(f"{path}: the file must hold a JSON object {{…}}, got {_kind(content)}")
            return content
    assert failure is not None
    if _ADAMS.match(text):
        raise FileError(f"{path}: this is a file of MSC Adams, which is not read; the JSON files of ME451 models are")
    reason = failure.msg[0].lower() + failure.msg[1:]
    raise FileError(f"{path}: not valid JSON in line {failure.lineno}, column {failure.colno}: {reason}")


def _decoded(data: bytes) -> str:
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        return data.decode("utf-16", errors="replace")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return data.decode("latin-1")


def _kind(value: Any) -> str:
    return "a list" if isinstance(value, list) else repr(value)


def _blank(text: str) -> str:
    return re.sub(r"[^\n]", " ", text)


def _without_comments_and_commas(text: str) -> str:
    def kept(match: re.Match[str]) -> str:
        return match.group() if match.group().startswith('"') else _blank(match.group())

    return _STRING_OR_COMMA.sub(kept, _STRING_OR_COMMENT.sub(kept, text))


def _without_drawing(text: str) -> str:
    """Take out each member ``"vis": …`` with the commas around it, well-formed or not."""
    position = 0
    while match := _DRAWING.search(text, position):
        head = text[: match.start()].rstrip(_BETWEEN)
        tail = text[_end_of_value(text, match.end()) :].lstrip(_BETWEEN)
        gap = _blank(text[len(head) : len(text) - len(tail)])
        # one comma stays if there are members on both sides, even if the file had none there
        joint = " " if head.endswith("{") or tail.startswith("}") else ","
        text = head + joint + gap[gap.startswith(" ") :] + tail
        position = len(head)
    return text


def _end_of_value(text: str, start: int) -> int:
    """Return the end of the value that begins at `start`, by its brackets.

    A bracket that is missing inside is closed by the next outer one, and one
    too many is passed over; only the outermost has to be right.
    """
    if text[start : start + 1] not in ("{", "["):
        return _SCALAR.match(text, start).end()  # type: ignore[union-attr]
    opening = {"}": "{", "]": "["}
    stack: list[str] = []
    for match in _TEXT_OR_BRACKET.finditer(text, start):
        bracket = match.group()
        if bracket in opening.values():
            stack.append(bracket)
        elif opening.get(bracket) in stack:
            while stack.pop() != opening[bracket]:
                continue
        if not stack:
            return match.end()
    return len(text)
