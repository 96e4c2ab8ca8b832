"""Files that are written whole or not at all."""

from __future__ import annotations

import os
import shutil
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO

from ..errors import FileError
from .reading import path_of


def writable(path: str | Path) -> Path:
    """Return the real path of a file to be written, links resolved.

    Parameters
    ----------
    path : str or Path
        The file, which need not exist.

    Raises
    ------
    FileError
        If the path is not a path or names a folder, and if its folder does not exist or nothing may be written there.
    """
    target = path_of(path)
    try:
        target = target.resolve()
        reason = _obstacle(target)
    except OSError as error:
        raise cannot_be_written(path, error) from None
    if reason:
        raise FileError(f"{path}: the file cannot be written: {reason}")
    return target


def _obstacle(target: Path) -> str:
    """Cause for which nothing can be written to a file; empty if there is none."""
    if not target.parent.is_dir():
        return f"the folder {target.parent} does not exist"
    if target.is_dir():
        return "this is a folder; name a file in it"
    if target.exists() and not os.access(target, os.W_OK):
        return "permission denied"
    if not target.exists() and not os.access(target.parent, os.W_OK | os.X_OK):
        return f"permission denied in the folder {target.parent}"
    return ""


@contextmanager
def whole_file(path: str | Path) -> Iterator[Path]:
    """Give a path to write to; the file there replaces `path` when the block ends without an error.

    Until then the new file is beside the old one, so that a failure
    leaves the old file and nothing else. It is on the disk before it
    replaces the old one. A device or a pipe is written directly.

    Parameters
    ----------
    path : str or Path
        The file to write.

    Yields
    ------
    Path
        File to write meanwhile.

    Raises
    ------
    FileError
        If the file cannot be written; it names the file and the reason.
    """
    target = writable(path)
    special = target.exists() and not target.is_file()
    part = target if special else target.with_name(f".{target.name[:40]}.{os.getpid()}.{threading.get_ident()}.part")
    try:
        yield part
        if not special:
            with open(part, "rb+") as file:
                os.fsync(file.fileno())
            if target.exists():
                shutil.copymode(target, part)
            os.replace(part, target)
    except OSError as error:
        raise cannot_be_written(path, error) from error
    except FileError as error:
        # a writer that writes whole files itself names the part
        if str(part) not in str(error):
            raise
        raise FileError(str(error).replace(str(part), str(path))) from error
    finally:
        if not special:
            part.unlink(missing_ok=True)


@contextmanager
def appended_file(path: str | Path) -> Iterator[IO[bytes]]:
    """Open a file to append a block, which is there whole when the block of code ends, or not at all.

    Parameters
    ----------
    path : str or Path
        A file that exists.

    Yields
    ------
    file
        Binary file, positioned at its end.

    Raises
    ------
    FileError
        If the block cannot be written; the file is then as long as before.
    """
    try:
        with open(path, "r+b", buffering=0) as file:
            size = file.seek(0, os.SEEK_END)
            try:
                yield file
                os.fsync(file.fileno())
            except BaseException:
                file.truncate(size)
                raise
    except OSError as error:
        raise cannot_be_written(path, error) from error


def cannot_be_written(path: str | Path, error: OSError) -> FileError:
    """Return the error that names a file and the reason of the operating system."""
    return FileError(f"{path}: the file cannot be written: {error.strerror or error}")
