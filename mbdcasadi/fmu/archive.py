"""The binary of this machine, and the archive."""

from __future__ import annotations

import platform
import sys
import zipfile
from collections.abc import Mapping
from pathlib import Path

from ..integrators.native import build
from ..numerics.writing import whole_file
from .description import Unit
from .sources import OPTIMISATION

#: Time of every file in an archive: the same model gives the same archive.
TIME = (1980, 1, 1, 0, 0, 0)


def binary_of(unit: Unit, files: Mapping[str, str]) -> dict[str, bytes] | None:
    """Return the binary of this machine by its name in the archive; None without a compiler.

    Raises
    ------
    CompilationError
        If the compiler fails.
    """
    using = build.compiler()
    folder = _folder(unit.version)
    if using is None or folder is None:
        return None
    name, ending = folder
    options = [(source, OPTIMISATION[source]) for source in unit.compiled]
    return {f"binaries/{name}/{unit.identifier}{ending}": build.compiled(files, options, using)}


def _folder(version: int) -> tuple[str, str] | None:
    """Folder of the binaries of this machine, and their ending; None on a machine that FMI does not name."""
    machine = platform.machine().lower()
    is_64 = sys.maxsize > 2**32
    arm, intel = machine in ("aarch64", "arm64"), machine in ("x86_64", "amd64", "x86", "i386", "i686")
    system = {"linux": "linux", "darwin": "darwin", "win32": "windows"}.get(sys.platform)
    if system is None or not (arm or intel):
        return None
    ending = {"linux": ".so", "darwin": ".dylib", "windows": ".dll"}[system]
    if version == 3:
        return f"{'aarch64' if arm else 'x86_64' if is_64 else 'x86'}-{system}", ending
    if arm and system != "darwin":
        return None
    short = {"linux": "linux", "darwin": "darwin", "windows": "win"}[system]
    return f"{short}{'64' if is_64 else '32'}", ending


def write_archive(path: Path, files: Mapping[str, bytes]) -> None:
    """Write an archive whole or not at all, the same for the same files."""
    with whole_file(path) as part, zipfile.ZipFile(part, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in sorted(files, key=lambda name: (name != "modelDescription.xml", name)):
            entry = zipfile.ZipInfo(name, TIME)
            entry.compress_type = zipfile.ZIP_DEFLATED
            entry.create_system = 3
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, files[name])
