"""Pictures of motions through several mechanisms: over changes, of motions from files, and of what was missed."""

import numpy as np
import pytest
from linkages import block_and_rider

import mbdcasadi as mbd
from mbdcasadi.visual.drawing.canvas import ABSENT, Canvas
from mbdcasadi.visual.drawing.sample import Sample


@pytest.fixture(scope="module")
def found():
    """A block that rubs on its guide and is then let go, with exact friction."""
    block, both, alone, jump = block_and_rider()
    motion = mbd.simulate(both, np.linspace(0, 1.5, 31), initial=[block.vx == 2.0], events=[jump])
    return block, both, alone, motion


@pytest.mark.slow
def test_films_and_drawings_of_a_motion_from_a_file(found, tmp_path):
    block, both, alone, motion = found
    motion.save(tmp_path / "run.npz")
    again = mbd.read_trajectory(tmp_path / "run.npz", [both, alone])
    assert again.interpolates and again.phases[1].events
    assert again.at([0.11])[block.x] == pytest.approx(motion.at([0.11])[block.x], abs=1e-9)
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


def test_what_opens_or_leaves_is_faint_from_then_on(found):
    """Guide and block stay; the seat and the rider are drawn in full until the jump."""
    motion = found[-1]
    scene = mbd.animate(motion).film.scene
    there = {item.name: [item.is_there(t) for t in (0.0, 0.29, 0.31, 1.5)] for item in scene.items}
    assert all(there["block"]) and all(there["guide"]) and all(there["rub"])
    assert there["seat"] == there["rider"] == [True, True, False, False]
    figure = mbd.draw(motion).figure
    canvas, number = Canvas(figure.axes[0], scene), [item.name for item in scene.items].index("seat")
    seat = [patch for mark, patch in zip(scene.marks, canvas.artists, strict=False) if mark.item == number]
    poses = scene.poses(Sample(motion, np.array([0.2, 0.4])))
    canvas.show(poses[0], 0.2)
    assert seat and {patch.get_alpha() for patch in seat} == {None}
    canvas.show(poses[1], 0.4)
    assert {patch.get_alpha() for patch in seat} == {ABSENT}


def test_what_never_closes_is_never_there(found):
    block, _, alone, _ = found
    closed = mbd.Weld("closed", mbd.ground.at(0, 0), block.at(0, 0))
    half = mbd.Event("half", mbd.t - 0.5, during=alone, becomes=alone.replace(name="again"))
    never = mbd.Event("never", mbd.t - 9, during=alone, becomes=alone.replace(joints=[closed]))
    motion = mbd.simulate(alone, [0, 1], initial=[block.vx == 1.0], events=[half, never])
    assert motion.appearances(closed) == () and motion.appearances(block) is None


def test_a_page_draws_what_is_open_faintly(found, open_offline, tmp_path):
    mbd.animate(found[-1], tmp_path / "page.html")
    opened = open_offline(tmp_path / "page.html", {"width": 900, "height": 600})
    opened.wait_for_function("window.mechanism")

    def faint(time):
        with opened.expect_download() as download:
            opened.evaluate(f"mechanism.seek({time})")
            opened.evaluate("document.getElementById('svg').click()")
        return download.value.path().read_text(encoding="utf-8").count('opacity="0.2"')

    assert faint(0.2) == 0 and faint(0.4) > 3
