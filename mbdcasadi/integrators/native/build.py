"""Shared libraries from C source: built by the compiler of the system, and kept in a folder of the user.

A library is kept under a key of everything that decides on it, and a digest of
its content, which is verified before it is opened: a file that was cut off or
changed is built again. It is written under another name and then renamed, so that
nobody sees half of it, and of two processes that build the same, either wins.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import platform
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from ...errors import MechanismError

#: Compilers that are looked for on the path if ``$CC`` names none.
COMPILERS = ("gcc", "clang", "cc")
#: The rounding must be that of the interpreter: no contraction to fused operations.
FLAGS = ("-fPIC", "-shared", "-ffp-contract=off", "-fno-math-errno")
#: Functions call those of their own library, whatever the program has under the same name: the C library of Linux has
#: a function ``step``.
OWN_NAMES = ("-Wl,-Bsymbolic",) if sys.platform.startswith("linux") else ()
#: Days after which a library that was not used is removed.
KEPT_DAYS = 90
#: Longest time that a compiler may take, s.
PATIENCE = 600.0
_SUFFIX = ".dll" if sys.platform == "win32" else ".so"


class CompilationError(MechanismError):
    """The compiler failed; carries its last line."""


@dataclass(frozen=True, eq=False)
class Compiler:
    """A C compiler; one object for each that is found.

    Attributes
    ----------
    command : tuple of str
        Its name.
    identity : str
        Key that changes if it is replaced by another one.
    """

    command: tuple[str, ...]
    identity: str

    @property
    def name(self) -> str:
        """Name of the command."""
        return Path(self.command[0]).name


def compiler() -> Compiler | None:
    """Return the compiler that ``$CC`` names, else the first of :data:`COMPILERS` on the path; None without one."""
    return _compiler(os.environ.get("CC", ""), os.environ.get("PATH", ""))


def no_compiler() -> str:
    """Return the reason for which :func:`compiler` finds none."""
    named = os.environ.get("CC", "").strip()
    return f"$CC names {named!r}, which is not on the path" if named else "no C compiler is on the path"


@cache
def _compiler(stated: str, path: str) -> Compiler | None:
    try:
        named = tuple(shlex.split(stated))
    except ValueError:  # a quote that is not closed
        named = (stated,)
    candidates = [named] if named else [(name,) for name in COMPILERS]
    for command in candidates:
        place = shutil.which(command[0], path=path or None)
        if place is not None:
            about = os.stat(place)
            identity = f"{' '.join(command)} {os.path.realpath(place)} {about.st_size} {about.st_mtime_ns}"
            return Compiler((place, *command[1:]), f"{identity} {platform.machine()} {sys.platform}")
    return None


def cache_folder() -> Path:
    """Folder in which libraries are kept: ``$MBDCASADI_CACHE``, else one of the platform's own."""
    return _cache_folder(*map(os.environ.get, ("MBDCASADI_CACHE", "LOCALAPPDATA", "XDG_CACHE_HOME", "HOME")))


@cache
def _cache_folder(given: str | None, local: str | None, cache_home: str | None, home: str | None) -> Path:
    if given:
        return Path(given).expanduser()
    if sys.platform == "win32":
        base = local or str(Path.home() / "AppData" / "Local")
    elif sys.platform == "darwin":
        base = str(Path.home() / "Library" / "Caches")
    else:
        base = cache_home or str(Path.home() / ".cache")
    return Path(base) / "mbdcasadi"


@cache
def _own_folder() -> Path:
    """Folder of this process alone, if the cache cannot be written; removed at its end."""
    import atexit

    folder = Path(tempfile.mkdtemp(prefix="mbdcasadi-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


def _folders() -> list[Path]:
    """Folders in which a library may be kept."""
    return [cache_folder(), *([_own_folder()] if _own_folder.cache_info().currsize else [])]


def key_of(*parts: str | bytes) -> str:
    """Digest of everything that decides on a library."""
    digest = hashlib.sha256()
    for part in parts:
        content = part.encode() if isinstance(part, str) else part
        digest.update(len(content).to_bytes(8, "little") + content)
    return digest.hexdigest()[:32]


def find(key: str) -> ctypes.CDLL | None:
    """Open the library of a key, if it is kept and whole."""
    for folder in _folders():
        try:
            places = sorted(folder.glob(f"{key}-*{_SUFFIX}"))
        except OSError:
            continue
        for place in places:
            library = _opened(place)
            if library is not None:
                return library
    return None


def _opened(place: Path) -> ctypes.CDLL | None:
    """Open a library whose content is that of its name; remove one that is not."""
    try:
        content = place.read_bytes()
        if _digest(content) != place.stem.rsplit("-", 1)[1]:
            raise OSError("the content is another one")
        library = ctypes.CDLL(str(place.resolve()))
    except OSError:
        _remove(place)
        return None
    try:
        os.utime(place)
    except OSError:
        pass
    return library


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:16]


def _remove(place: Path) -> None:
    try:
        place.unlink()
    except OSError:
        pass


def build(key: str, source: str, optimisation: str, using: Compiler) -> ctypes.CDLL:
    """Compile C source to the library of a key, keep it and open it.

    Raises
    ------
    CompilationError
        If the compiler fails, or what it makes cannot be opened.
    """
    content = compiled({"equations.c": source}, [("equations.c", optimisation)], using)
    name = f"{key}-{_digest(content)}{_SUFFIX}"
    for folder in (cache_folder, _own_folder):
        place = _kept(folder, name, content)
        library = None if place is None else _opened(place)
        if library is not None:
            return library
    raise CompilationError(f"a library that {using.name} made cannot be opened")


def compiled(files: Mapping[str, str], sources: Sequence[tuple[str, str]], using: Compiler) -> bytes:
    """Compile C files to a shared library.

    Parameters
    ----------
    files : mapping of str to str
        Content of each file by name; those that are not compiled are included by others.
    sources : sequence of (str, str)
        Names of the files that are compiled, each with its optimisation.
    using : Compiler
        The compiler.

    Returns
    -------
    bytes
        The library; it holds no path of this machine.

    Raises
    ------
    CompilationError
        If the compiler fails, or its files cannot be written.
    """
    try:
        with tempfile.TemporaryDirectory(prefix="mbdcasadi-") as scratch:
            for name, text in files.items():
                (Path(scratch) / name).write_text(text, encoding="utf-8")
            made = f"made{_SUFFIX}"
            for command in _commands(sources, made):
                _run(using, command, scratch)
            if not (Path(scratch) / made).exists():
                raise CompilationError(f"the compiler {using.name} failed: it wrote no library")
            return (Path(scratch) / made).read_bytes()
    except OSError as error:
        raise CompilationError(
            f"the files for the compiler {using.name} cannot be written: {error.strerror or error}"
        ) from None


def _commands(sources: Sequence[tuple[str, str]], made: str) -> list[list[str]]:
    """Options of the compiler, call by call, that make a library of sources with their optimisations."""
    if len(sources) == 1:
        name, optimisation = sources[0]
        return [[optimisation, *FLAGS, *OWN_NAMES, "-o", made, name, "-lm"]]
    of_objects = [*(flag for flag in FLAGS if flag != "-shared"), "-fvisibility=hidden"]
    commands = [["-c", optimisation, *of_objects, "-o", f"{name}.o", name] for name, optimisation in sources]
    return [*commands, [*FLAGS, *OWN_NAMES, "-o", made, *(f"{name}.o" for name, _ in sources), "-lm"]]


def _run(using: Compiler, options: Sequence[str], folder: str) -> None:
    try:
        done = subprocess.run(
            [*using.command, *options],
            cwd=folder,
            capture_output=True,
            text=True,
            timeout=PATIENCE,
            stdin=subprocess.DEVNULL,
        )
    except (OSError, subprocess.SubprocessError) as error:
        raise CompilationError(f"the compiler {using.name} did not run: {error}") from None
    if done.returncode:
        raise CompilationError(f"the compiler {using.name} failed: {_reason(done.stderr or done.stdout)}")


def _reason(output: str) -> str:
    """First error in the output of a compiler, else its first line."""
    lines = output.strip().splitlines()
    return next((line for line in lines if "error" in line), lines[0] if lines else "it gives no reason")


def _kept(folder_of: Callable[[], Path], name: str, content: bytes) -> Path | None:
    """Write a file whole or not at all; None if the folder cannot be written."""
    try:
        folder = folder_of()
        place = folder / name
        folder.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(prefix=".", suffix=_SUFFIX, dir=folder)
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(content)
            os.replace(temporary, place)
        except OSError:
            _remove(Path(temporary))
            if not place.exists():
                raise
        _remove_unused(folder)
    except OSError:
        return None
    return place


def _remove_unused(folder: Path) -> None:
    """Remove libraries that nobody has used for long."""
    oldest = time.time() - 86400 * KEPT_DAYS
    for place in folder.glob(f"*{_SUFFIX}"):
        try:
            if place.stat().st_mtime < oldest:
                place.unlink()
        except OSError:
            continue
