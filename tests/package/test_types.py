"""What a type checker says about programs that use the package, and that these programs run."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import mbdcasadi as mbd

ROOT = Path(__file__).resolve().parents[2]
USER = Path(__file__).with_name("typed_user.py")
CODE = USER.read_text(encoding="utf-8")


@pytest.mark.slow
def test_strict_mypy_finds_mistakes_and_nothing_else(tmp_path):
    """The program of the README and one with every public class; the errors stand in the lines that say so."""
    pytest.importorskip("mypy", reason="mypy is not installed (pip install .[dev])")
    readme = tmp_path / "readme.py"
    blocks = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(encoding="utf-8"), re.DOTALL)
    readme.write_text("\n".join(blocks), encoding="utf-8")
    options = ("--strict", "--follow-imports=silent", "--config-file=", f"--cache-dir={tmp_path / 'cache'}")
    done = subprocess.run(
        [sys.executable, "-m", "mypy", *options, str(readme), str(USER)],
        capture_output=True, text=True, check=False, cwd=tmp_path, env=os.environ | {"MYPYPATH": str(ROOT)},
    )  # fmt: skip
    found = [line for line in done.stdout.splitlines() if ": error:" in line]
    wrong = [n for n, line in enumerate(CODE.splitlines(), start=1) if line.endswith("# E")]
    assert [int(re.search(r"typed_user\.py:(\d+):|$", line)[1] or 0) for line in found] == wrong, done.stdout


def test_the_program_names_every_public_class():
    classes = {name for name in mbd.__all__ if isinstance(getattr(mbd, name), type)}
    assert classes <= set(re.findall(r"mbd\.(\w+)", CODE))


@pytest.mark.slow
def test_the_program_runs():
    """What is typed is also right."""
    import typed_user as user

    place, bar = mbd.ground.at(0, 0), user.body("bar").at(0.3, 0.1)
    assert user.joints(place, bar) and user.forces(place, bar, mbd.Revolute("p", place, bar))
    user.analyses()
    assert user.optimal_control().cost > 0 and len(user.failures()) > 9


def test_the_version_is_that_of_the_citation():
    assert f"\nversion: {mbd.__version__}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
