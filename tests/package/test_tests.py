"""Tests mirror the package: ``tests/<room>/test_<file>.py``, with a topic after the name of a file that has several."""

from pathlib import Path

import pytest

TESTS = Path(__file__).resolve().parents[1]
PACKAGE = TESTS.parent / "mbdcasadi"

#: Folders that belong to no room of the package, and what stands in them.
OTHERS = {
    "analyses": "laws that hold in every analysis",
    "benchmarks": "mechanisms with published or independent values",
    "documentation": "pages, examples, notebooks",
    "package": "the package as a whole: its layers, imports, types, command line and tests",
}
FILES = sorted(path.relative_to(TESTS) for path in TESTS.rglob("test_*.py"))


def names_of(room: Path) -> set[str]:
    """Names of a room, of its folders and of its files."""
    return {room.name, *(path.stem for path in room.rglob("*") if path.is_dir() or path.suffix in (".py", ".c", ".js"))}


@pytest.mark.parametrize("file", FILES, ids=str)
def test_a_test_is_named_after_a_file_of_the_package(file):
    """``test_problem_waypoints.py`` tests ``problem.py``, as far as waypoints go."""
    folder = file.parent.as_posix()
    if folder not in OTHERS:
        assert (PACKAGE / folder).is_dir(), f"{file}: mbdcasadi has no folder {folder!r}"
        words = file.stem.split("_")[1:]
        stems = {"_".join(words[:n]) for n in range(1, len(words) + 1)}
        assert stems & names_of(PACKAGE / folder), f"{file}: mbdcasadi/{folder} has no such file"


def test_names_are_told_apart():
    """pytest imports the files by their names alone."""
    assert len({file.name for file in FILES}) == len(FILES)
    assert all((TESTS / folder).is_dir() for folder in OTHERS)
