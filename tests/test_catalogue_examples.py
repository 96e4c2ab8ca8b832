"""The examples of the catalogue: each runs from its file alone without a warning, draws, and finds what it says."""

import runpy
import warnings
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest

EXAMPLES = Path(__file__).resolve().parents[1] / "examples"


@pytest.fixture
def found(request, tmp_path, monkeypatch, capsys):
    """Names of the example after which a test is called, run in an empty folder with warnings as errors."""
    name = request.function.__name__.removeprefix("test_")
    script = EXAMPLES / f"{name}.py"
    assert len(script.read_text(encoding="utf-8").splitlines()) < 100
    monkeypatch.chdir(tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)
        names = runpy.run_path(str(script))
    plt.close("all")
    assert (tmp_path / f"{name}.png").stat().st_size > 20_000
    assert capsys.readouterr().out.count("\n") >= 3
    return names


def test_planetary_train(found):
    """The ratio is Willis'; torques balance the load; the relation holds while the ring slips back."""
    assert found["ratio"] == pytest.approx(0.04 / 0.12, rel=1e-12)
    run, drive, brake = found["run"], found["drive"], found["brake"]
    np.testing.assert_allclose(run[drive.effort] + run[brake.effort], found["LOAD"], rtol=1e-10)
    motion, train = found["motion"], found["train"]
    assert np.max(np.abs(motion[found["willis"]])) < 1e-12
    assert motion[train.ring.omega][-1] < -10


def test_cam(found):
    """The contact force at the limit is zero somewhere and nowhere negative; just above it the follower lifts off."""
    contact, limit = found["contact"], found["limit"]
    touching = found["turned_at"](limit)[contact.normal_force]
    assert np.min(touching) == pytest.approx(0, abs=0.02)
    flight = found["flight"]
    assert [event.name for event in flight.events] == ["lift-off at contact"]
    assert flight.final[contact.normal_force] == pytest.approx(0, abs=1e-3)


def test_dc_motor(found):
    """The energy budget closes to what the coil holds; the optimum takes less heat and replays."""
    run, motor = found["run"], found["motor"]
    coil = 0.5 * found["WINDING"]["inductance"] * run[motor.current][-1] ** 2
    assert found["taken"] - found["lost"] - found["lifted"] == pytest.approx(coil, rel=0.02)
    assert found["solution"].cost < 0.6 * found["until"]
    assert found["solution"].verify().final_error < 1e-3


def test_parking(found):
    """It arrives at the side, and the blade never slipped."""
    solution, sledge = found["solution"], found["sledge"]
    final = solution.trajectory.final
    assert final[sledge.y] == pytest.approx(0.4, abs=1e-7)
    assert solution.verify().final_error < 1e-5
    assert np.max(np.abs(found["run"][found["across"]])) < 1e-12
