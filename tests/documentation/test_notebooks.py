"""The notebooks run from the first cell to the last, and print what is stored in them."""

import warnings

import pytest
from documentation_blocks import agrees
from matplotlib.figure import Figure
from notebook_cells import NOTEBOOKS, printed, run_notebook

import mbdcasadi as mbd


def test_there_are_four():
    assert len(NOTEBOOKS) == 4


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_and_prints_what_it_shows(path, tmp_path, monkeypatch):
    """Warnings of the package would be outputs that are not stored."""
    monkeypatch.chdir(tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("error", mbd.MechanismWarning)
        cells = run_notebook(path)
    for cell, text, value in cells:
        assert agrees(printed(cell), text), f"{path.name}: stored\n{printed(cell)}\nprinted\n{text}"
        kinds = [key for output in cell["outputs"] for key in output.get("data", {})]
        assert ("image/png" in kinds) == isinstance(value, Figure)
    assert any(isinstance(value, Figure) for *_, value in cells)
