"""Controllers as functional mock-up units: FMPy computes the inputs that Python computes."""

from __future__ import annotations

import numpy as np
import pytest

import mbdcasadi as mbd

fmpy = pytest.importorskip("fmpy")
from fmpy.validation import validate_fmu  # noqa: E402


def cart_controller():
    """A cart that goes to a goal."""
    force, goal = mbd.Input("force", lower=-3, upper=3, unit="N"), mbd.Parameter("goal", 0.2)
    cart = mbd.Body("cart", mass=1.0, inertia=1.0)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0))
    push = mbd.Force("push", cart.at(0, 0), (force, 0))
    model = mbd.Mechanism([cart], [rail], forces=[push], inputs=[force], parameters=[goal])
    cost = 20 * (cart.x - goal) ** 2 + cart.vx**2 + 0.01 * force**2
    return mbd.Controller(mbd.OptimalControlProblem(model, duration=1.0, running_cost=cost), sample=0.05, intervals=20)


@pytest.mark.slow
@pytest.mark.parametrize("version", [2, 3])
def test_unit_computes_the_same_bits(tmp_path, version):
    """Along given measurements the outputs of the unit are those of steps in Python, and the status too."""
    controller = cart_controller()
    path = mbd.export_fmu(controller, tmp_path / "cart.fmu", version=version, binary=True)
    assert not validate_fmu(str(path))
    description = fmpy.read_model_description(str(path))
    units = {v.name: (v.unit, v.causality) for v in description.modelVariables}
    assert units["cart.x"] == ("m", "input") and units["force"] == ("N", "output")
    times = 0.05 * np.arange(21)
    rows = [(t, np.cos(3 * t), -np.sin(t)) for t in times]
    signals = np.array(rows, dtype=[("time", float), ("cart.x", float), ("cart.vx", float)])
    found = fmpy.simulate_fmu(
        str(path), stop_time=1.0, step_size=0.05, output_interval=0.05, input=signals, start_values={"goal": 0.1},
        output=["force", "status"],
    )  # fmt: skip
    moved = controller.with_parameters({controller.mechanism.parameters[0]: 0.1})
    steps = [moved.step(row[1:], time=row[0]).inputs[0] for row in rows]
    # the input of a sample is there at the end of the communication step that begins with it; the first at the start
    assert np.array_equal(found["force"], [steps[0], *steps[:20]])
    assert np.all(found["status"] == 0)


def test_what_a_unit_of_a_controller_takes(tmp_path):
    """Arguments that belong to mechanisms are refused."""
    controller = cart_controller()
    for more, words in (({"stop": 2.0}, "stop= has no meaning"), ({"kind": "model-exchange"}, "kind='model-exchange'")):
        with pytest.raises(mbd.ModelError, match=words):
            mbd.export_fmu(controller, tmp_path / "cart.fmu", **more)
    with pytest.raises(mbd.ModelError, match="which is no variable of the controller"):
        mbd.export_fmu(controller, tmp_path / "cart.fmu", units={"lift": "N"})
