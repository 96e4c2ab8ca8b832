"""Model files, one kind a file; :data:`MODEL_READERS` lists them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ..model.mechanism import Mechanism
from .adm import read_adm
from .mjcf import read_mjcf
from .sdf import read_sdf
from .urdf import read_urdf

#: Readers of mechanisms by the ending of their files; the command line takes every one of them.
MODEL_READERS: dict[str, Callable[[Path], Mechanism]] = {
    ".adm": read_adm,
    ".mjcf": read_mjcf,
    ".sdf": read_sdf,
    ".urdf": read_urdf,
    ".world": read_sdf,
    ".xml": read_mjcf,
}


def read_model(path: Path) -> Mechanism:
    """Read a mechanism in the format of the suffix of its file; an unknown suffix is read as ``.adm``."""
    return MODEL_READERS.get(path.suffix.lower(), read_adm)(path)
