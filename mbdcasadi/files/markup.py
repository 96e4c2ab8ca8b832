"""XML files, with the line of every element for messages."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

import numpy as np

from ..errors import FileError
from ..numerics.reading import content_of


@dataclass(eq=False)
class XmlElement:
    """One element of a file: its kind, the line of its beginning, and the elements inside it."""

    file: str
    tag: str
    line: int
    attributes: dict[str, str]
    children: list[XmlElement] = field(default_factory=list)
    text: str = ""

    @property
    def description(self) -> str:
        """Kind, name and place, for messages."""
        name = self.attributes.get("name", "")
        return f"{self.file}, line {self.line}: {self.tag}{f' {name!r}' if name else ''}"

    def refuse(self, reason: str) -> FileError:
        """Return the error that names this element and its line."""
        return FileError(f"{self.description} {reason}")

    def all(self, *tags: str) -> Iterator[XmlElement]:
        """Iterate over the children of some kinds; of all kinds if none is given."""
        return (child for child in self.children if not tags or child.tag in tags)

    def one(self, tag: str) -> XmlElement | None:
        """Return the child of a kind, or None; several are refused."""
        children = list(self.all(tag))
        if len(children) > 1:
            raise children[1].refuse("is the second one; at most one is allowed")
        return children[0] if children else None

    def get(self, name: str, default: str | None = None) -> str:
        """Return an attribute as text; one that is missing without a default is refused."""
        value = self.attributes.get(name, default)
        if value is None:
            raise self.refuse(f"has no attribute '{name}'")
        return value

    def word(self, name: str, *known: str) -> str:
        """Return an attribute that is one of some words, the first by default; another one is refused."""
        value = self.get(name, known[0])
        if value not in known:
            raise self.refuse(f"has {name} = '{value}', which must be {' or '.join(known)}")
        return value

    def numbers(self, name: str, default: str | None = None, sizes: tuple[int, ...] = ()) -> np.ndarray:
        """Return an attribute that is a list of finite numbers, as many as one of `sizes`; else it is refused."""
        text = self.get(name, default)
        try:
            values = np.array([float(part) for part in text.split()])
        except ValueError:
            values = np.full(1, np.nan)
        if not np.all(np.isfinite(values)) or (sizes and values.size not in sizes):
            many = f"{' or '.join(map(str, sizes))} " if sizes else ""
            raise self.refuse(f"has {name} = '{text}', which are not {many}finite numbers")
        return values

    def number(self, name: str, default: str | None = None, *, least: float = -np.inf) -> float:
        """Return an attribute that is one number, at least of a size."""
        value = float(self.numbers(name, default, (1,))[0])
        if value < least:
            raise self.refuse(f"has {name} = {value:g}, which must be at least {least:g}")
        return value

    def has(self, name: str) -> bool:
        """Return True if an attribute is there."""
        return name in self.attributes

    def with_defaults(self, defaults: Mapping[str, str]) -> XmlElement:
        """Return the element with defaults for attributes that it does not have."""
        return XmlElement(self.file, self.tag, self.line, {**defaults, **self.attributes}, self.children, self.text)


#: Attributes, and elements inside, by element, and by its place (its parent and it) if it has another meaning there.
Table = Mapping[str, tuple[frozenset[str], frozenset[str]]]


#: A comment.
_COMMENT = re.compile(rb"<!--.*?-->", re.DOTALL)


def read_xml(path: str | Path, root: str | None) -> XmlElement:
    """Read a file with a given outermost element, or any; raise a :class:`FileError` for another one."""
    content, path = content_of(path), Path(path)
    # people leave lines before the declaration, and hyphens in comments; lines keep their numbers
    content = _COMMENT.sub(lambda comment: b"\n" * comment.group().count(b"\n"), content)
    text = content.lstrip()
    above = content[: len(content) - len(text)].count(b"\n")
    parser = expat.ParserCreate()
    outermost = XmlElement(path.name, "", 0, {})
    stack = [outermost]

    def begin(tag: str, attributes: dict[str, str]) -> None:
        element = XmlElement(path.name, tag, above + parser.CurrentLineNumber, attributes)
        stack[-1].children.append(element)
        stack.append(element)

    def said(text: str) -> None:
        stack[-1].text += text

    def declared(*_: object) -> None:
        raise FileError(f"{path.name}, line {above + parser.CurrentLineNumber}: declarations of entities are not read")

    parser.StartElementHandler = begin
    parser.EndElementHandler = lambda _: stack.pop()
    parser.CharacterDataHandler = said
    parser.buffer_text = True
    parser.EntityDeclHandler = declared
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        reason = re.sub(r":? line \d+, column \d+", "", str(error))
        raise FileError(f"{path}: not valid XML in line {above + error.lineno}: {reason}") from None
    root_element = outermost.children[0]
    if root is not None and root_element.tag != root:
        raise FileError(f"{path}: the outermost element must be {root}, got {root_element.tag}")
    return root_element


def table_of(known: Mapping[str, tuple[str, str]]) -> Table:
    """Return the attributes and the elements inside of elements, which are given as words."""
    return {place: (frozenset(names.split()), frozenset(inside.split())) for place, (names, inside) in known.items()}


def unread(root: XmlElement, table: Table) -> list[str]:
    """Return what of a file is not in a table, each kind once: elements and attributes, a typo among them.

    Elements that are known but not in the table themselves, such as what is only seen, are not looked into.
    """
    first: dict[str, str] = {}
    times: Counter[str] = Counter()
    for element, name, is_attribute in _strange(root, table):
        kind = f"{'attribute ' if is_attribute else ''}{name} of {element.tag}"
        owner = element.get("name", element.get("reference", ""))
        first.setdefault(kind, f"{kind}{f' {owner!r}' if owner else ''} (line {element.line})")
        times[kind] += 1
    return [words + (f" and {times[kind] - 1} more" if times[kind] > 1 else "") for kind, words in first.items()]


def _strange(root: XmlElement, table: Table) -> Iterator[tuple[XmlElement, str, bool]]:
    """Attributes and elements that are not in the table, with the element that has them."""
    waiting = [(root.tag, root)]
    while waiting:
        place, element = waiting.pop()
        names, inside = table[place]
        for name in element.attributes:
            if name not in names and not name.startswith("xmlns"):
                yield element, name, True
        for child in element.children:
            if child.tag not in inside:
                shown = child.get("name", "")
                yield element, child.tag + (f" {shown!r}" if shown else ""), False
        for child in reversed(element.children):
            deeper = f"{place} {child.tag}" if f"{place} {child.tag}" in table else child.tag
            if child.tag in inside and deeper in table:
                waiting.append((deeper, child))
