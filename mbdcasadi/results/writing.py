"""Files that are written whole or not at all."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from ..errors import FileError


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """Give a path to write to, which takes the place of `path` when the block ends without an error.

    The new file stands beside the old one until then, so that a failure
    leaves what was there before, and nothing else.

    Parameters
    ----------
    path : str or Path
        The file to write.

    Yields
    ------
    Path
        Where to write meanwhile.
    """
    if not isinstance(path, str | os.PathLike):
        raise FileError(f"the path of a file is a text or a pathlib.Path, got {path!r}")
    final = Path(path).resolve()
    if not final.parent.is_dir():
        raise FileError(f"{path}: the folder {final.parent} does not exist")
    if final.exists() and not final.is_file():  # a pipe or a device cannot be replaced
        yield final
        return
    beside = final.with_name(f".{final.name}.{os.getpid()}.part")
    try:
        yield beside
        os.replace(beside, final)
    finally:
        beside.unlink(missing_ok=True)
