"""Names of a model harm no picture, and are shown as they are."""

import itertools
import json
import re

import numpy as np
import pictured
import pytest

import mbdcasadi as mbd
from mbdcasadi.visual.drawing.scene import ARROW, placed
from mbdcasadi.visual.plots.plot import overview

NAMES = ["a$\\frac{x$", "cost $5 to $10", "_hidden", "<!--<script>", "a & b < c", "{brace}", "%s", "ä → 漢"]


def named(name):
    """A pendulum of which everything has the name."""
    torque, gain = mbd.Input(f"u {name}"), mbd.Parameter(f"p {name}", 1.0)
    arm = mbd.Body(name, mass=1, inertia=1 / 12, pose=(0.5, 0, 0))
    second = mbd.Body(f"{name} 2", mass=1, inertia=1 / 12, pose=(1.5, 0, 0))
    joints = [
        mbd.Revolute(f"h {name}", mbd.ground.at(0, 0), arm.at(-0.5, 0)),
        mbd.Revolute(f"k {name}", arm.at(0.5, 0), second.at(-0.5, 0)),
    ]
    forces = [mbd.Gravity(), mbd.Torque(f"m {name}", arm, gain * torque)]
    return arm, mbd.Mechanism([arm, second], joints, forces=forces, inputs=[torque], parameters=[gain], name=name)


def texts(figure):
    """All texts of a figure."""
    from matplotlib.text import Text

    return [text.get_text() for text in figure.findobj(Text)]


def moved(name):
    """A name, the body that has it, and a motion with an event."""
    arm, mechanism = named(name)
    return name, arm, mbd.simulate(mechanism, np.linspace(0, 0.3, 7), events=[mbd.Event(f"e {name}", arm.phi + 0.1)])


@pytest.fixture(scope="module", params=NAMES)
def model(request):
    """The motion of a model of each name."""
    return moved(request.param)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:Glyph .* missing from font")
def test_in_figures(model):
    """Names of bodies, joints, inputs, events, parameters and of the mechanism, in drawings, plots and legends."""
    name, arm, motion = model
    assert motion.events
    for figure, shown in (
        (mbd.draw(motion, names=True).figure, [name, f"h {name}"]),
        (overview(motion), [name, f"{name} 2", f"h {name}", f"e {name}"]),
        (mbd.plot(motion, {name: {name: arm.x, "other": arm.y}}), [name, f"e {name}"]),
        (mbd.plot_phase({name: motion, "other": motion}, {name: arm.x, f"{name} y": arm.y}), [name, f"{name} y"]),
        (mbd.plot_energy(motion), []),
    ):
        figure.draw_without_rendering()
        assert set(shown) <= set(texts(figure)), shown


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES[:1])
def test_in_films(tmp_path, name):
    """As the title, and as the label of a plot."""
    name, arm, motion = moved(name)
    mbd.animate(motion, tmp_path / "motion.gif", plots={name: {name: arm.x, "y": arm.y}}, fps=2, names=True, title=name)
    assert (tmp_path / "motion.gif").stat().st_size > 1000


@pytest.mark.slow
def test_in_the_page(model):
    """In the data as they are; nothing in the page's text begins or ends a script."""
    name, arm, motion = model
    text = mbd.animate(motion, plots={name: arm.x}, names=True).html
    assert text.count("<script>") == text.count("</script>") == 1 and "<!--" not in text
    data = json.loads(re.search(r"const DATA = (.*);\n", text).group(1))
    assert name in [item["name"] for item in data["items"]] and data["plots"][0]["label"] == name
    assert [name] in [label["t"] for label in data["labels"]]


@pytest.mark.slow
def test_of_a_solution():
    """Labels of inputs, limits and the title."""
    name = NAMES[0]
    _, mechanism = named(name)
    (torque,) = mechanism.inputs
    problem = mbd.OptimalControlProblem(
        mechanism, 0.2, initial=mbd.assemble(mechanism), path=[mbd.bounded(-1, torque, 1)], running_cost=torque**2
    )
    figure = mbd.plot_solution(mbd.optimize(problem, intervals=4))
    figure.draw_without_rendering()
    assert f"u {name}" in texts(figure)


def test_formulas_in_labels_of_ones_own():
    """A label may hold a formula; one that cannot be read is shown as it is."""
    _, arm, motion = moved("arm")
    figure = mbd.plot(motion, {r"$\dot\varphi$, rad/s": arm.omega, r"$\frac{$, m": arm.x})
    figure.draw_without_rendering()
    formula, broken = (axes.yaxis.label for axes in figure.axes)
    assert formula.get_parse_math() and not broken.get_parse_math()


def test_names_are_placed_at_the_scale_of_the_picture():
    """After the layout of the figure, no name of a hanging chain lies on its bars."""
    axes = mbd.draw(mbd.library.pendulum_chain(3), names=True)
    axes.figure.draw_without_rendering()
    half = max(patch.get_path().get_extents().x1 for patch in axes.patches[:3])
    names = [text.get_window_extent().transformed(axes.transData.inverted()) for text in axes.texts]
    assert len(names) == 6 and all(name.x0 > half or name.x1 < -half for name in names)


def test_names_in_a_part_of_a_figure():
    """Axes of a subfigure are as good as those of a figure."""
    from matplotlib.figure import Figure

    part = Figure(layout="constrained").subfigures(1, 2)[1]
    axes = mbd.draw(mbd.library.pendulum_chain(1), part.subplots(), names=True)
    assert {"rod 1", "pin 1"} <= {text.get_text() for text in axes.texts}


def drawn_names(model):
    """Axes, scene and first pose of a drawing with names, and their texts and leaders in the order of the labels."""
    from mbdcasadi.visual.drawing.compose import Options, compose
    from mbdcasadi.visual.drawing.draw import subject
    from mbdcasadi.visual.drawing.sample import Sample

    axes = mbd.draw(model, names=True)
    axes.figure.canvas.draw()
    sample = Sample(subject(model))
    scene, _ = compose(sample, Options(names=True))
    shown = {" ".join(text.get_text().split()): text for text in axes.texts if text.get_text()}
    texts = [shown[" ".join(label.text.split())] for label in scene.labels]
    return axes, scene, scene.poses(sample)[0], texts


def apart(box, points):
    """Least distance of points (k, 2) from a box, pixels."""
    return np.min(np.hypot(*np.maximum(np.maximum(box.min - points, points - box.max), 0).T))


@pytest.mark.slow
@pytest.mark.parametrize("name", pictured.MACHINES)
def test_names_stand_at_their_parts_and_cover_nothing(name):
    """No name lies on another one or on an arrow; each is beside its part, or a line leads from one to the other."""
    from matplotlib.path import Path

    axes, scene, pose, texts = drawn_names(pictured.MACHINES[name]())
    boxes = [text.get_window_extent() for text in texts]
    points = axes.figure.dpi / 72

    def pixels(mark):
        loops = [placed(loop, pose[mark.frame]) for loop in mark.loops]
        closed = [np.vstack([loop, loop[:1]]) if mark.closed else loop for loop in loops]
        fine = [np.vstack([np.linspace(a, b, 60) for a, b in itertools.pairwise(loop)]) for loop in closed]
        return [axes.transData.transform(loop) for loop in fine]

    for one, two in itertools.combinations(boxes, 2):
        assert not one.overlaps(two), name
    for arrow in (mark for mark in scene.marks if mark.layer == ARROW):
        assert all(apart(box, np.vstack(pixels(arrow))) > 0 for box in boxes), name
    leaders = [text for text in axes.texts if getattr(text, "arrow_patch", None) is not None]
    for label, text, box in zip(scene.labels, texts, boxes, strict=True):
        own = [
            mark
            for mark in scene.marks
            if mark.item in label.items or (label.body and mark.frame == label.frame and mark.style == "body")
        ]
        near = apart(box, np.vstack([loop for mark in own for loop in pixels(mark)]))
        inside = any(Path(loop).contains_point((box.min + box.max) / 2) for m in own if m.closed for loop in pixels(m))
        if near < 12 * points or inside:
            continue
        (leader,) = (one for one in leaders if np.allclose(one.xy, text.xy))
        end = axes.transData.transform(leader.xy)
        on = any(Path(loop).contains_point(end) for m in own if m.closed for loop in pixels(m))
        assert on or min(np.min(np.hypot(*(loop - end).T)) for m in own for loop in pixels(m)) < 12 * points, label.text
        assert apart(box, (end + points * np.array(leader.xyann))[None]) < 6 * points, label.text


@pytest.mark.parametrize("name", pictured.MACHINES)
def test_names_of_bodies_are_led_to_on_the_bodies(name):
    """Also if the centre of mass lies beside the material, as that of a bent boom."""
    from matplotlib.path import Path

    _, scene, _, _ = drawn_names(pictured.MACHINES[name]())
    for label in scene.labels:
        loops = [loop for m in scene.marks if m.frame == label.frame and m.style == "body" for loop in m.loops]
        for point in [label.point, *label.others] if label.body else []:
            assert any(Path(loop).contains_point(point, radius=1e-9) for loop in loops), label.text
