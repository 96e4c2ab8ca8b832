"""Compiled libraries in the user's folder: whole, found again, and never trusted blindly."""

import ctypes
import os
import shutil
import stat
import subprocess
import sys
import time

import numpy as np
import pytest
from linkages import pendulum

import mbdcasadi as mbd
from mbdcasadi.integrators.native import build

pytestmark = pytest.mark.skipif(build.compiler() is None, reason="no C compiler")

SOURCE = "int answer(void) { return 42; }\n"


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """A cache of the test alone."""
    monkeypatch.setenv("MBDCASADI_CACHE", str(tmp_path / "kept"))
    return tmp_path / "kept"


def built(source=SOURCE):
    key = build.key_of(source)
    return key, build.build(key, source, "-O1", build.compiler())


def test_what_is_built_is_found_again(folder):
    key, library = built()
    assert library.answer() == 42
    assert build.find(key).answer() == 42
    assert [place.suffix for place in folder.iterdir()] == [build._SUFFIX]
    assert build.find(build.key_of("another")) is None


@pytest.mark.parametrize("damage", [lambda c: c[: len(c) // 2], lambda c: b"", lambda c: c[:-9] + b"not these"])
def test_a_damaged_library_is_not_opened(folder, damage):
    """Half a file, an empty one and a changed one are removed, and built anew."""
    key, _ = built()
    (place,) = folder.iterdir()
    content = place.read_bytes()
    place.unlink()  # the opened one stays as it is
    place.write_bytes(damage(content))
    assert build.find(key) is None
    assert not place.exists()
    assert built()[1].answer() == 42


@pytest.mark.slow
def test_a_folder_that_is_deleted_in_between(folder):
    """What is open goes on; for a mechanism that comes later the equations are compiled anew."""
    times, method = np.linspace(0, 0.5, 6), mbd.DOP853(jit=True)
    first, second = pendulum(angle=0.0).mechanism, pendulum(angle=0.0).mechanism
    expected = mbd.simulate(first, times, method=method)
    assert "compiled by" in expected.statistics.notes[0]
    shutil.rmtree(folder)
    again = mbd.simulate(first, times, method=method)
    assert again.statistics.notes == expected.statistics.notes
    assert not folder.exists()
    anew = mbd.simulate(second, times, method=method)
    assert "compiled by" in anew.statistics.notes[0]
    assert any(folder.iterdir())
    for motion in (again, anew):
        np.testing.assert_array_equal(motion.q, expected.q)


def test_a_folder_that_cannot_be_written(tmp_path, monkeypatch):
    """A file stands where the folder should be: what is built serves this process."""
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("MBDCASADI_CACHE", str(tmp_path / "file" / "kept"))
    key, library = built("int answer(void) { return 43; }\n")
    assert library.answer() == 43
    assert build.find(key).answer() == 43


@pytest.mark.skipif(os.geteuid() == 0 if hasattr(os, "geteuid") else True, reason="root writes everywhere")
def test_a_read_only_folder(folder):
    folder.mkdir(parents=True)
    folder.chmod(stat.S_IRUSR | stat.S_IXUSR)
    try:
        assert built("int answer(void) { return 44; }\n")[1].answer() == 44
    finally:
        folder.chmod(stat.S_IRWXU)


def test_unused_libraries_are_removed(folder):
    key, _ = built()
    (place,) = folder.iterdir()
    long_ago = time.time() - 86400 * (build.KEPT_DAYS + 1)
    os.utime(place, (long_ago, long_ago))
    other, _ = built("int answer(void) { return 45; }\n")
    assert build.find(key) is None
    assert build.find(other) is not None


def test_a_compiler_that_fails_is_quoted():
    with pytest.raises(build.CompilationError, match="failed: .*error"):
        built("this is no C\n")


def test_the_key_depends_on_every_part():
    assert build.key_of("ab", "c") != build.key_of("a", "bc")
    assert isinstance(build.find(build.key_of("nothing")), ctypes.CDLL | None)


@pytest.mark.parametrize("given, expected", [("", ("gcc", "clang", "cc")), ("no-such-compiler", None)])
def test_the_compiler_of_the_environment(monkeypatch, given, expected):
    monkeypatch.setenv("CC", given)
    found = build.compiler()
    assert found is None if expected is None else found.name in expected


@pytest.mark.slow
def test_two_processes_at_once(folder):
    """Both run the same mechanism in an empty cache, and both get the same motion."""
    script = (
        "import numpy as np, mbdcasadi as mbd\n"
        "arm = mbd.Body('arm', mass=1, inertia=1 / 12, pose=(0.5, 0, 0))\n"
        "hinge = mbd.Revolute('hinge', mbd.ground.at(0, 0), arm.at(-0.5, 0))\n"
        "pendulum = mbd.Mechanism(bodies=[arm], joints=[hinge], forces=[mbd.Gravity()])\n"
        "motion = mbd.simulate(pendulum, duration=1.0, method=mbd.DOP853(jit=True))\n"
        "assert 'compiled by' in motion.statistics.notes[0] or 'kept' in motion.statistics.notes[0]\n"
        "print(repr(float(motion.final[arm.phi])))\n"
    )
    command = [sys.executable, "-c", script]
    runs = [subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) for _ in range(2)]
    results = [run.communicate(timeout=300) for run in runs]
    assert [run.returncode for run in runs] == [0, 0], results
    assert results[0][0] == results[1][0]
    assert not [place for place in folder.iterdir() if place.name.startswith(".")]


def test_functions_call_those_of_their_own_library():
    """The C library of Linux has functions of the names ``step`` and ``advance``."""
    _, library = built(
        "int step(int x) { return x + 1; }\nint advance(int x) { return step(x) + 1; }\n"
        "int both(int x) { return advance(x) + step(x); }\n"
    )
    assert library.both(1) == 5
