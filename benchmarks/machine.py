"""Description of the machine of a benchmark, without anything that identifies its owner."""

from __future__ import annotations

import os
import platform
import sys
from contextlib import suppress
from datetime import date
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

#: Libraries of linear algebra that start threads: with one each, timings do not depend on what else runs.
_THREADS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")


def one_thread() -> None:
    """Keep libraries to one thread; call it before NumPy is imported."""
    for name in _THREADS:
        os.environ.setdefault(name, "1")


def machine() -> dict[str, Any]:
    """Date, processor family, number of cores, Python and the versions of the packages."""
    return {
        "date": date.today().isoformat(),
        "processor": _processor(),
        "cores": os.cpu_count(),
        "python": ".".join(map(str, sys.version_info[:3])),
        "versions": versions("casadi", "numpy", "scipy", "scikit-sundae", "exudyn"),
    }


def versions(*packages: str) -> dict[str, str]:
    """Versions of packages by name, of those that are installed."""
    found = {}
    for package in packages:
        with suppress(PackageNotFoundError):
            found[package] = version(package)
    return found


def _processor() -> str:
    """Name of the processor family, if the system reports it."""
    path = Path("/proc/cpuinfo")
    if path.exists():
        for line in path.read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    return platform.machine()


def describe() -> str:
    """The same in one line."""
    found = machine()
    versions = ", ".join(f"{name} {number}" for name, number in found["versions"].items())
    return f"{found['date']}; {found['cores']} cores, {found['processor']}; Python {found['python']}, {versions}"


def into_readme(section: str, text: str) -> None:
    """Put tables between the two marks of a section in README.md."""
    path = Path(__file__).parent / "README.md"
    before, _, rest = path.read_text().partition(f"<!-- {section} -->")
    _, end, after = rest.partition(f"<!-- end of {section} -->")
    if not end:
        raise ValueError(f"README.md has no section {section!r}")
    path.write_text(f"{before}<!-- {section} -->\n{text.strip()}\n{end}{after}")
