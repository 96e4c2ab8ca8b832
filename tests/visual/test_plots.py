"""Plots: what is in the figures, and that nothing else in Matplotlib is touched."""

import subprocess
import sys

import matplotlib
import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.results.trajectory import EventOccurrence, Trajectory
from mbdcasadi.visual.plots.plot import overview, plot

TIMES = np.linspace(0, 1, 21)


@pytest.fixture(scope="module")
def arm():
    """A rod."""
    return mbd.Body("arm", mass=1, inertia=1 / 12, pose=(0.5, 0, 0))


@pytest.fixture(scope="module")
def motion(arm):
    """A pendulum that falls."""
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), arm.at(-0.5, 0))
    model = mbd.Mechanism(bodies=[arm], joints=[hinge], forces=[mbd.Gravity()], name="pendulum")
    return mbd.simulate(model, TIMES)


def test_each_expression_has_axes_of_its_own(motion, arm):
    """Labels, values, a legend for vectors only, one time axis in seconds."""
    figure = plot(motion, {"angle, rad": arm.phi, "tip, m": arm.at(0.5, 0).position, "q": arm.q})
    first, second, third = figure.axes
    assert [axes.get_ylabel() for axes in figure.axes] == ["angle, rad", "tip, m", "q"]
    t, phi = first.lines[0].get_data()
    assert set(TIMES) <= set(t) and phi == pytest.approx(motion.at(t)[arm.phi])
    assert first.get_legend() is None
    assert [text.get_text() for text in second.get_legend().get_texts()] == ["x", "y"]
    assert [text.get_text() for text in third.get_legend().get_texts()] == ["[0]", "[1]", "[2]"]
    assert third.get_xlabel() == "t, s" and first.get_xlabel() == ""
    assert first.get_shared_x_axes().joined(first, third)


@pytest.mark.slow
def test_figures_are_written(motion, arm, tmp_path):
    """As any Matplotlib figure."""
    plot(motion, {"angle": arm.phi}).savefig(tmp_path / "plot.png")
    overview(motion).savefig(tmp_path / "overview.svg")
    assert (tmp_path / "plot.png").read_bytes()[:4] == b"\x89PNG"
    assert "<svg" in (tmp_path / "overview.svg").read_text()


def test_overview_shows_bodies_reactions_and_energy(motion):
    """Panels that have something to show, and no others."""
    labels = [axes.get_ylabel() for axes in overview(motion).axes]
    assert labels == ["x, m", "y, m", "phi, rad", "reaction, N", "energy, J", "y, m"]


def test_overview_shows_the_mechanism_beside_the_curves(motion, arm):
    """With the name of its body, at equal scales, left of everything else."""
    figure = overview(motion)
    figure.draw_without_rendering()
    *curves, drawing = figure.axes
    assert arm.name in [text.get_text() for text in drawing.texts] and drawing.get_aspect() == 1
    assert drawing.get_window_extent().x1 < min(axes.get_window_extent().x0 for axes in curves)


def test_overview_of_a_driven_mechanism(motion, arm):
    """A single driver is named with its unit, several share their axes by unit."""
    model = motion.mechanism
    run = mbd.inverse_dynamics(model.replace(drivers=[mbd.Driver("drive", arm.phi, mbd.t)]), TIMES)
    assert "drive, N m" in [axes.get_ylabel() for axes in overview(run).axes]
    free = model.replace(joints=[], drivers=[mbd.Driver(axis, getattr(arm, axis), mbd.t) for axis in ("x", "y", "phi")])
    labels = [axes.get_ylabel() for axes in overview(mbd.inverse_dynamics(free, TIMES)).axes]
    assert "driver effort, N" in labels and "phi, N m" in labels
    kinematic = mbd.kinematics(free, TIMES)
    assert [axes.get_ylabel() for axes in overview(kinematic).axes][3:-1] == ["energy, J"]


def test_a_quantity_that_rests_does_not_show_its_rounding(motion, arm):
    """The axis spans more than the last digits."""
    low, high = plot(motion, {"length": mbd.norm(arm.position)}).axes[0].get_ylim()
    assert high - low > 0.01


def test_events_are_marked(motion, arm):
    """A line at the time, and the name."""
    event = EventOccurrence("lowest", 0.5, motion.state(10))
    marked = Trajectory(
        motion.mechanism, motion.t, motion.q, motion.v, motion.a, motion.z, motion.lam, motion.inputs,
        motion.parameters, events=[event],
    )  # fmt: skip
    axes = plot(marked, {"angle": arm.phi}).axes[0]
    assert [text.get_text() for text in axes.texts] == ["lowest"] and len(axes.lines) == 2


def test_one_time_is_a_point(motion, arm):
    """A line through one point cannot be seen."""
    axes = plot(motion.at([0.5]), {"angle": arm.phi}).axes[0]
    assert axes.lines[0].get_marker() == "o"


def test_wrong_expressions_are_named(motion):
    """Nothing to draw, or nothing that can be drawn."""
    with pytest.raises(mbd.MechanismError, match="nothing to draw"):
        plot(motion, {})
    with pytest.raises(mbd.MechanismError, match="name: expression"):
        plot(motion, [1])
    with pytest.raises(mbd.MechanismError, match="stranger"):
        plot(motion, {"x": mbd.Body("stranger", 1, 1).x})


def test_global_settings_are_left_alone(motion, arm):
    """Neither rcParams nor the figures of pyplot."""
    before = dict(matplotlib.rcParams)
    plot(motion, {"angle": arm.phi})
    overview(motion)
    assert dict(matplotlib.rcParams) == before


def test_importing_the_package_imports_no_matplotlib():
    """It takes longer than the rest, and batch jobs do not need it."""
    code = "import sys, mbdcasadi; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_lines_have_names_of_their_own():
    """Scalars by name in one pair of axes, beside a vector; what is no scalar is named."""
    model = mbd.library.four_bar()
    motion = mbd.simulate(model.mechanism, np.linspace(0, 0.5, 21))
    angles = {"crank": model.crank.phi, "rocker": model.rocker.phi}
    figure = mbd.plot(motion, {"angle, rad": angles, "coupler, m": model.coupler.position})
    above, below = figure.axes
    assert [text.get_text() for text in above.get_legend().get_texts()] == ["crank", "rocker"]
    assert [text.get_text() for text in below.get_legend().get_texts()] == ["x", "y"]
    t, phi = above.lines[1].get_data()
    np.testing.assert_allclose(phi, motion.at(t)[model.rocker.phi])
    (lines,) = mbd.animate(motion, plots={"angle, rad": angles}).film.curves.values()
    assert list(lines) == ["crank", "rocker"]
    for wrong in ({"coupler": model.coupler.position}, {}):
        with pytest.raises(mbd.MechanismError, match="'angle' must be an expression, or .* lines with names"):
            mbd.plot(motion, {"angle": wrong})
    with pytest.raises(mbd.MechanismError, match="plot: takes a motion"):
        mbd.plot(model.mechanism, angles)


def test_inputs_have_their_units():
    """An input's unit stands on the axes of the overview and of a solution; without one the label stands alone."""
    model = mbd.library.pendulum_chain(1)
    (tau,), (rod,) = model.torques, model.rods
    assert tau.quantity == "tau 1, N m" and mbd.Input("u").quantity == "u"
    motion = mbd.simulate(model.mechanism, np.linspace(0, 0.1, 5))
    assert "tau 1, N m" in [axes.get_ylabel() for axes in overview(motion).axes]
    two = mbd.library.pendulum_chain(2)
    assert "input, N m" in [a.get_ylabel() for a in overview(mbd.simulate(two.mechanism, np.linspace(0, 0.1, 5))).axes]
    start = [rod.phi == -1.5, rod.omega == 0]
    problem = mbd.OptimalControlProblem(model.mechanism, 0.3, initial=start, running_cost=tau**2)
    figure = mbd.plot_solution(mbd.optimize(problem, intervals=4))
    assert figure.axes[0].get_ylabel() == "tau 1, N m"
    with pytest.raises(mbd.ModelError, match="input 'u': unit"):
        mbd.Input("u", unit=3)


def test_a_solution_shows_the_inputs_of_all_its_phases():
    """Also one that the first phase does not have."""
    block, push = mbd.Body("block", 1, 1), mbd.Input("push", lower=-9, upper=9, unit="N")
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    free = mbd.Mechanism([block], joints=[guide])
    pushed = free.replace(forces=[mbd.Force("push", block.at(0, 0), (push, 0))], inputs=[push])
    slide = mbd.Phase("slide", free, 0.5, initial=[block.x == 0, block.vx == 1])
    brake = mbd.Phase("brake", pushed, 0.5, final=[block.vx == 0], running_cost=push**2)
    figure = mbd.plot_solution(mbd.optimize(mbd.OptimalControlProblem(phases=[slide, brake]), intervals=4))
    assert figure.axes[0].get_ylabel() == "push, N"


def test_long_labels_do_not_overprint():
    """They go on more lines, and stay within their axes."""
    model = mbd.library.four_bar()
    motion = mbd.simulate(model.mechanism, np.linspace(0, 0.1, 5))
    long = "horizontal position of the centre of the coupler of the linkage, m"  # the unit would have a line of its own
    figure = mbd.plot(
        motion,
        {
            long: model.coupler.x,
            "angle, rad": model.crank.phi,
            r"$\dot\varphi$ of the long bar of the crank, $1/s$": model.crank.omega,
        },
    )
    figure.draw_without_rendering()
    labels = [axes.yaxis.label for axes in figure.axes]
    assert labels[0].get_text().endswith("linkage, m")
    assert labels[0].get_text().replace("\n", " ") == long and labels[1].get_text() == "angle, rad"
    assert "\n" not in labels[2].get_text()
    for axes, label in zip(figure.axes[:2], labels, strict=False):
        assert label.get_window_extent().height <= 1.15 * axes.get_window_extent().height
