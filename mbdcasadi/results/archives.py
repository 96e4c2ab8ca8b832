"""Arrays by name in one NumPy file, without pickle; what is read is checked entry by entry."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from ..errors import FileError
from ..numerics.reading import path_of
from ..numerics.writing import whole_file


def write_arrays(path: str | Path, content: dict[str, Any]) -> None:
    """Write arrays, numbers and texts by name; the entry ``format`` says what they are."""
    with whole_file(path) as part, open(part, "wb") as file:
        np.savez(file, allow_pickle=False, **content)


class Archive(dict[str, np.ndarray]):
    """Entries of a file by name; one that is missing or damaged raises a :class:`FileError` with file and entry."""

    def __init__(self, path: str | Path, content: dict[str, np.ndarray]):
        super().__init__(content)
        self.path = path

    def __missing__(self, name: str) -> NoReturn:
        raise self.refuse(f"the entry '{name}' is missing")

    def refuse(self, reason: str) -> FileError:
        """Return the error that names the file."""
        return FileError(f"{self.path}: {reason}; the file is damaged, or was not written by this package")

    def numbers(self, name: str, *shape: int | None, unknown: bool = False) -> np.ndarray:
        """Return an array of finite numbers of a shape, with None for any length.

        With `unknown`, rows may be NaN throughout.
        """
        values = self[name]
        if values.dtype.kind not in "fiub":
            raise self.refuse(f"the entry '{name}' does not hold numbers")
        if len(values.shape) != len(shape) or any(n not in (None, k) for n, k in zip(shape, values.shape, strict=True)):
            expected = ", ".join("any" if n is None else str(n) for n in shape)
            raise self.refuse(f"the entry '{name}' has the shape {values.shape} instead of ({expected})")
        finite = np.isfinite(values)
        if unknown and values.ndim > 1:
            finite |= np.isnan(values).all(axis=-1, keepdims=True)
        if not finite.all():
            place = tuple(int(k) for k in np.argwhere(~finite)[0])
            raise self.refuse(f"the entry '{name}' is {values[place]} at {list(place)}")
        return values

    def rows(self, name: str) -> np.ndarray:
        """Return a table of numbers, which need not be finite."""
        values = self[name]
        if values.dtype.kind not in "fiub" or values.ndim != 2:
            raise self.refuse(f"the entry '{name}' is not a table of numbers")
        return values

    def names(self, name: str, count: int | None = None) -> list[str]:
        """Return a list of texts."""
        values = self[name]
        if (values.dtype.kind != "U" and values.size) or values.ndim != 1 or count not in (None, values.size):
            raise self.refuse(f"the entry '{name}' is not a list of {'' if count is None else f'{count} '}names")
        return values.astype(str).tolist()

    def json(self, name: str) -> Any:
        """Return what a text in JSON holds."""
        text = str(self[name])
        try:
            return json.loads(text)
        except ValueError:
            raise self.refuse(f"the entry '{name}' cannot be read") from None

    def json_list(self, name: str, count: int) -> list[Any]:
        """Return a list of a size that a text in JSON holds."""
        values = self.json(name)
        if not isinstance(values, list) or len(values) != count:
            raise self.refuse(f"the entry '{name}' is not a list of {count}")
        return values


def read_arrays(path: str | Path, form: str | tuple[str, ...], kind: str, writer: str) -> Archive:
    """Read what :func:`write_arrays` wrote, in one of the formats `form`.

    `kind` and `writer`, the expected kind of file and the function that writes such files, are for the messages. A
    :class:`FileError` is raised if the file is not there or cannot be read, and for one of another kind or format.
    """
    file_path = path_of(path)
    try:
        with np.load(file_path, allow_pickle=False) as file:
            archive = Archive(path, {name: file[name] for name in file.files})
    except OSError as error:
        raise FileError(f"{path}: the file cannot be read: {error.strerror or error}") from None
    except Exception:  # NumPy, zipfile and zlib raise errors of any kind for damaged files
        raise FileError(f"{path}: the file is not a {kind} file, or is damaged; {writer} writes one") from None
    if str(archive.get("format")) not in ((form,) if isinstance(form, str) else form):
        raise FileError(f"{path}: the file is not a {kind} file of this version of the package; {writer} writes one")
    return archive
