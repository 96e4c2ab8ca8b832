"""Rooms that a simulation does not need are imported when something of them is asked for."""

import ast
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import mbdcasadi as mbd


def loaded_by(script):
    """Modules that a script leaves loaded in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-c", f"{script}\nimport sys\nprint(*sys.modules)"], capture_output=True, text=True, check=True
    )
    return set(done.stdout.split())


def test_import_alone_takes_what_a_simulation_needs():
    loaded = loaded_by("import mbdcasadi")
    assert "mbdcasadi.simulation.simulate" in loaded
    rooms = ("optimal_control", "visual", "sweeping", "identification", "statics", "library", "files", "linear")
    assert not {f"mbdcasadi.{room}" for room in rooms} & loaded
    assert not {"matplotlib", "scipy", "pandas"} & loaded


@pytest.mark.slow
@pytest.mark.parametrize("method", ["idas", "dop853"])
def test_a_first_run_imports_nothing_slow(method):
    """Sets and medians of NumPy import its masked arrays, a sixth of the first run of a four-bar."""
    loaded = loaded_by(
        "import mbdcasadi as mbd\n"
        "mbd.simulate(mbd.library.four_bar(1.0, 2.5, 2.2, 2.4).mechanism, duration=0.05, method='" + method + "')"
    )
    assert "mbdcasadi.simulation.simulate" in loaded
    assert not {"numpy.ma", "scipy.linalg", "matplotlib", "pandas"} & loaded


@pytest.mark.slow
def test_a_name_imports_its_room():
    loaded = loaded_by("from mbdcasadi import sweep\nimport mbdcasadi as mbd\nmbd.library.four_bar")
    assert {"mbdcasadi.sweeping.sweep", "mbdcasadi.library"} <= loaded
    assert "mbdcasadi.optimal_control.optimize" not in loaded


def test_every_name_of_the_table_is_there_and_known_to_type_checkers():
    tree = ast.parse(Path(mbd.__file__).read_text(encoding="utf-8"))
    block = next(node for node in tree.body if isinstance(node, ast.If))
    stated = {(node.module or "", alias.name) for node in block.body for alias in node.names}
    assert stated == {(module, name) for module, names in mbd._LATER.items() for name in names.split()}
    assert all(getattr(mbd, name) is not None for _, name in stated)
    assert {name for _, name in stated} <= set(dir(mbd))


def test_all_names_are_in_all():
    """Type checkers go by the list, so that each name stands in it in full."""
    public = {name for name, value in vars(mbd).items() if not name.startswith("_") and not inspect.ismodule(value)}
    assert set(mbd.__all__) == public | set(mbd._PLACES)
    assert len(set(mbd.__all__)) == len(mbd.__all__)


def test_an_unknown_name_is_refused():
    with pytest.raises(AttributeError, match="no attribute 'optimise_all'"):
        _ = mbd.optimise_all


@pytest.mark.slow
def test_import_of_all_names_and_help_have_those_that_are_imported_later():
    script = """
from mbdcasadi import *
assert callable(optimize) and callable(sweep) and callable(simulate) and t.is_symbolic()
assert "numerics" not in dir()
import pydoc, mbdcasadi
text = pydoc.render_doc(mbdcasadi, renderer=pydoc.plaintext)
assert "optimize(" in text and "class Body" in text"""
    assert "mbdcasadi.optimal_control.optimize" in loaded_by(script)
