"""The file of a sweep: a header and blocks that are only ever appended, so that what was run survives anything."""

from __future__ import annotations

import hashlib
import io
from pathlib import Path

import numpy as np

from ..errors import FileError
from ..numerics.writing import appended_file, whole_file, writable

_FORMAT = "mbdcasadi sweep 2"


class SweepFile:
    """Blocks of finished cases in a file.

    Parameters
    ----------
    path : str or Path
        The file; a new one is started, one of the same sweep is continued.
    fingerprint : str
        Of everything that decides on the results.

    Raises
    ------
    FileError
        For a file that is not a sweep file, belongs to another sweep, or cannot be written.
    """

    def __init__(self, path: str | Path, fingerprint: str):
        self.path = Path(path)
        self._fingerprint = fingerprint
        writable(self.path)
        if not self.path.exists():
            with whole_file(self.path) as part:
                part.write_bytes(_serialised(np.array([_FORMAT, fingerprint])))

    def read(self) -> list[tuple[np.ndarray, np.ndarray, list[str]]]:
        """Blocks ``(indices, values, messages)``; one that was cut off while it was written is taken away."""
        blocks: list[tuple[np.ndarray, np.ndarray, list[str]]] = []
        with open(self.path, "r+b") as file:
            try:
                header = np.load(file, allow_pickle=False)
            except (ValueError, EOFError, OSError):
                header = np.zeros(0)
            if header.shape != (2,) or str(header[0]) != _FORMAT:
                raise FileError(f"{self.path}: the file is not a sweep file; name another one, or remove it")
            if str(header[1]) != self._fingerprint:
                raise FileError(
                    f"{self.path}: the file belongs to another sweep: the model, the cases, times, outputs, inputs or "
                    "tolerances differ; name another file, or remove it"
                )
            whole = file.tell()
            while True:
                try:
                    indices, values, messages = (np.load(file, allow_pickle=False) for _ in range(3))
                except (ValueError, EOFError, OSError):
                    break
                blocks.append((indices, values, messages.tolist()))
                whole = file.tell()
            file.truncate(whole)
        return blocks

    def append(self, indices: np.ndarray, values: np.ndarray, messages: list[str]) -> None:
        """Add finished cases."""
        left = memoryview(_serialised(indices, values, np.array(messages, dtype=str)))
        with appended_file(self.path) as file:
            while left:
                left = left[file.write(left) :]


def _serialised(*arrays: np.ndarray) -> bytes:
    """Arrays as NumPy writes them; into a file it would not notice that the end of a small one found no room."""
    content = io.BytesIO()
    for array in arrays:
        np.save(content, array, allow_pickle=False)
    return content.getvalue()


def fingerprint(*parts: str | bytes | np.ndarray) -> str:
    """Digest of texts and arrays."""
    digest = hashlib.sha256()
    for part in parts:
        content = (
            part.encode() if isinstance(part, str) else part if isinstance(part, bytes) else np.asarray(part).tobytes()
        )
        digest.update(len(content).to_bytes(8, "little") + content)
    return digest.hexdigest()
