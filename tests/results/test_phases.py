"""Trajectories through several mechanisms: tables, pictures, what they refuse."""

import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.results.phases import union_of


def released():
    """A ball in a hand that is drawn along evenly and opens: the ball goes on, the hand is left out."""
    hand = mbd.Body("hand", mass=1.0, inertia=0.1, velocity=(2.0, 0, 0))
    ball = mbd.Body("ball", mass=0.2, inertia=0.01, velocity=(2.0, 0, 0))
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), hand.at(0, 0))
    grip = mbd.Weld("grip", hand.at(0, 0), ball.at(0, 0))
    k = mbd.Parameter("k", 0.0)
    held = mbd.Mechanism(bodies=[hand, ball], joints=[rail, grip], forces=[mbd.Gravity()])
    drag = mbd.Force("drag", ball.at(0, 0), (-k * ball.vx, 0))
    free = mbd.Mechanism(bodies=[ball], forces=[mbd.Gravity(), drag], parameters=[k])
    opens = mbd.Event("opens", hand.x - 1.0, direction=1, becomes=free, reset={k: hand.vx / 10})
    motion = mbd.simulate(held, np.linspace(0, 1, 21), initial=[hand.vx == 2.0], events=[opens])
    return hand, ball, grip, k, held, free, motion


@pytest.fixture(scope="module")
def found():
    return released()


def test_the_union_holds_the_parts_of_all(found):
    hand, ball, grip, k, held, _free, motion = found
    whole = motion.mechanism
    assert whole.bodies == (hand, ball) and whole.parameters == (k,) and grip in whole.joints
    assert [f.name for f in whole.forces] == ["gravity", "drag"]  # one gravity stands for both
    assert union_of([held, held]) is held


def test_parameters_change_on_the_way(found):
    hand, ball, _, k, *_, motion = found
    after = len(motion.phases[0])
    assert np.all(motion[k][:after] == 0) and np.all(motion[k][after:] == 0.2)
    t = motion.t[after:] - 0.5
    np.testing.assert_allclose(motion[ball.vx][after:], 2 * np.exp(-t), atol=1e-8)
    assert motion.events[0].after[k] == 0.2 and motion.events[0].state[hand.vx] == pytest.approx(2)
    assert np.isnan(motion.events[0].after[hand.x])


def test_tables(found, tmp_path):
    _hand, ball, _grip, *_, motion = found
    table = motion.to_pandas()
    assert len(table) == len(motion) and table["grip.fx"].iloc[-1] == 0.0
    assert np.isnan(table["hand.x"].iloc[-1]) and np.isfinite(table["ball.x"]).all()
    motion.to_csv(tmp_path / "run.csv", {"x": ball.x})
    assert np.allclose(np.loadtxt(tmp_path / "run.csv", delimiter=",", skiprows=1)[:, 1], motion[ball.x])
    assert motion.to_xarray({"x": ball.x})["x"].shape == motion.t.shape
    assert table["phase"].to_list() == [0] * len(motion.phases[0]) + [1] * len(motion.phases[1])
    np.testing.assert_array_equal(motion.to_xarray({"x": ball.x})["phase"], table["phase"])
    assert motion.to_xarray({"phase": ball.x})["phase"].dtype == float  # a quantity of the user goes before
    motion.phases[1].save(tmp_path / "flight.npz")
    again = mbd.read_trajectory(tmp_path / "flight.npz", motion.phases[1].mechanism)
    np.testing.assert_array_equal(again.t, motion.phases[1].t)


def test_a_symbol_of_no_phase_is_refused(found):
    *_, motion = found
    other = mbd.Body("other", mass=1, inertia=1)
    with pytest.raises(mbd.ExpressionError, match="other"):
        motion[other.x]
    with pytest.raises(mbd.ExpressionError, match="other"):
        motion.events[0].after[other.x]
    with pytest.raises(mbd.MechanismError, match="none of index"):
        motion.state(len(motion))


@pytest.mark.slow
def test_pictures_keep_bodies_where_they_were_last_seen(found, tmp_path):
    hand, ball, *_, motion = found
    shown = motion.with_absent_bodies()
    assert np.all(np.isfinite(shown.q)) and shown[hand.x][-1] == pytest.approx(1.0, abs=1e-9)
    assert mbd.draw(motion) is not None and mbd.draw(motion.final) is not None
    mbd.animate(motion, tmp_path / "run.html")
    assert (tmp_path / "run.html").stat().st_size > 10_000
    figure = mbd.plot(motion, {"x": ball.x})
    assert figure.axes
