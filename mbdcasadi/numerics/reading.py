"""Files that are read whole."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from ..errors import FileError


def path_of(path: Any) -> Path:
    """Return a path that was given for a file.

    Raises
    ------
    FileError
        For anything but a text or a path.
    """
    if not isinstance(path, str | os.PathLike) or "\0" in str(path):
        raise FileError(f"the path of a file is a text or a pathlib.Path, got {path!r}")
    return Path(path)


def content_of(path: str | Path) -> bytes:
    """Return the bytes of a file.

    Raises
    ------
    FileError
        If the file is not there or cannot be read; it names the file and the reason.
    """
    try:
        return path_of(path).read_bytes()
    except OSError as error:
        raise FileError(f"{path}: the file cannot be read: {error.strerror or error}") from None
