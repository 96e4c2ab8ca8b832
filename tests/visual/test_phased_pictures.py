"""Pictures of motions through several mechanisms: over changes, of motions from files, and of what was missed."""

import numpy as np
import pytest
from linkages import block_and_rider

import mbdcasadi as mbd


@pytest.fixture(scope="module")
def found():
    """A block that rubs on its guide and is then let go, with exact friction: its file keeps arrays alone."""
    block, both, alone, jump = block_and_rider()
    motion = mbd.simulate(both, np.linspace(0, 1.5, 31), initial=[block.vx == 2.0], events=[jump])
    return block, both, alone, motion


@pytest.mark.slow
def test_films_and_drawings_of_a_motion_from_a_file(found, tmp_path):
    block, both, alone, motion = found
    motion.save(tmp_path / "run.npz")
    again = mbd.read_trajectory(tmp_path / "run.npz", [both, alone])
    assert not again.interpolates and again.phases[1].events
    with pytest.raises(mbd.MechanismError, match="made from arrays"):
        again.at([0.1])
    assert mbd.draw(again, poses=3).patches
    mbd.animate(again, tmp_path / "run.html", plots={"v": block.vx}, trace=[block.at(0, 0)])
    assert (tmp_path / "run.html").stat().st_size > 10_000
    figure = mbd.plot(again, {"v": block.vx})
    assert any("jump" in text.get_text() for axes in figure.axes for text in axes.texts)


def test_the_energy_of_a_motion_in_phases_is_shown_with_the_violation_of_what_holds(found):
    """A joint that is not there any more is no violation: the rows of each mechanism count as long as it holds."""
    *_, motion = found
    figure = mbd.plot_energy(motion)
    shown = [line.get_ydata() for line in figure.axes[-1].lines if np.size(line.get_ydata()) > 2]
    assert shown and all(np.nanmax(values) < 1e-6 for values in shown)
    assert motion.drift.position < 1e-9
