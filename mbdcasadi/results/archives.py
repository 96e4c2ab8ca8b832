"""Arrays by name in one NumPy file, without pickle."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import FileError
from ..numerics.writing import whole_file


def write_arrays(path: str | Path, content: dict[str, Any]) -> None:
    """Write arrays, numbers and texts by name; the entry ``format`` says what they are."""
    with whole_file(path) as temporary, open(temporary, "wb") as file:
        np.savez(file, allow_pickle=False, **content)


def read_arrays(path: str | Path, form: str, what: str, writer: str) -> dict[str, np.ndarray]:
    """Read what :func:`write_arrays` wrote.

    Parameters
    ----------
    path : str or Path
        The file.
    form : str
        Its entry ``format``.
    what, writer : str
        What it should be, and who writes such files, for the message.

    Raises
    ------
    FileError
        For a file that is not there, is no such file, or one of another format.
    """
    try:
        with np.load(path, allow_pickle=False) as file:
            content = {name: file[name] for name in file.files}
    except OSError as error:
        raise FileError(f"{path}: the file cannot be read: {error.strerror or error}") from None
    except (ValueError, EOFError, zipfile.BadZipFile, AttributeError, TypeError):
        raise FileError(f"{path}: the file is no {what}; {writer} writes one") from None
    if str(content.get("format")) != form:
        raise FileError(f"{path}: the file is no {what} of this version of the package; {writer} writes one")
    return content
