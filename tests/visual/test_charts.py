"""Phase plots, energies, paths of equilibria, modes: what is in the figures."""

import numpy as np
import pytest

import mbdcasadi as mbd


@pytest.fixture(scope="module")
def pendulum():
    """A pendulum that falls, and its motion."""
    arm = mbd.Body("arm", mass=1, inertia=1 / 12, pose=(0.5, 0, 0))
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), arm.at(-0.5, 0))
    model = mbd.Mechanism(bodies=[arm], joints=[hinge], forces=[mbd.Gravity()])
    return arm, mbd.simulate(model, np.linspace(0, 1, 21))


def test_phase_plot(pendulum):
    """The points lie on the curve of constant energy; several motions are named."""
    arm, motion = pendulum
    axes = mbd.plot_phase(motion, {"phi, rad": arm.phi, "omega, rad/s": arm.omega}).axes[0]
    phi, omega = axes.lines[0].get_data()
    assert len(phi) > 100
    np.testing.assert_allclose(omega**2, -3 * 9.81 * np.sin(phi), atol=1e-4)
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("phi, rad", "omega, rad/s")
    two = mbd.plot_phase({"a": motion, "b": motion}, {"x": arm.phi, "y": arm.omega}).axes[0]
    assert [text.get_text() for text in two.get_legend().get_texts()] == ["a", "b"]


def test_energy_plot(pendulum):
    """Energies, what is lost, and violations on a logarithmic axis."""
    _, motion = pendulum
    energies, change, drift = mbd.plot_energy(motion).axes
    energy = motion.at(energies.lines[0].get_xdata()).energy
    np.testing.assert_allclose(energies.lines[0].get_ydata(), energy.kinetic)
    np.testing.assert_allclose(change.lines[0].get_ydata(), energy.total - energy.total[0])
    assert drift.get_yscale() == "log"
    assert max(np.max(line.get_ydata()) for line in drift.lines) == pytest.approx(
        max(motion.drift.position, motion.drift.velocity)
    )
    free = mbd.Body("free", 1, 1)
    assert len(mbd.plot_energy(mbd.simulate(mbd.Mechanism([free]), duration=1.0)).axes) == 2


def test_path_of_equilibria():
    """An inverted pendulum on a spring: stable in full, unstable dashed, the bifurcation at k = P L."""
    load = mbd.Parameter("load", 0.0)
    arm = mbd.Body("arm", mass=1, inertia=1 / 3, pose=(0, 0.5, np.pi / 2))
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), arm.at(-0.5, 0))
    spring = mbd.RSDA("spring", mbd.ground.at(0, 0), arm.at(-0.5, 0), stiffness=10, free_angle=np.pi / 2)
    press = mbd.Force("press", arm.at(0.5, 0), (0, -load))
    model = mbd.Mechanism([arm], [hinge], forces=[spring, press], parameters=[load])
    path = mbd.equilibrium_path(model, load, 0, 20)
    axes = mbd.plot_path(path, {"angle, rad": arm.phi}).axes[0]
    full, dashed = axes.lines[0], axes.lines[1]
    assert full.get_linestyle() == "-" and dashed.get_linestyle() == "--"
    assert full.get_xdata().min() == 0 and full.get_xdata().max() == pytest.approx(10, abs=1)
    assert axes.texts[0].get_text() == "bifurcation at 10" and axes.get_xlabel() == "load"


@pytest.mark.slow
def test_modes_are_headed_by_their_frequency():
    """A double pendulum: two modes, the pictures with the mechanism in three poses."""
    model = mbd.library.pendulum_chain(2)
    linear = mbd.linearize(model.mechanism, mbd.equilibrium(model.mechanism), wrt=[])
    figure = mbd.plot_modes(linear)
    titles = [axes.get_title() for axes in figure.axes]
    assert titles == [f"{mode.frequency:.4g} Hz" for mode in linear.modes()]
    assert len(mbd.plot_modes(linear.modes()[1:]).axes) == 1 and len(mbd.plot_modes(linear, count=1).axes) == 1


def test_wrong_input_is_named(pendulum):
    """What was given instead."""
    arm, motion = pendulum
    still = mbd.Mechanism([arm], [mbd.Weld("weld", mbd.ground.at(0, 0), arm.at(0, 0))])
    for call, arguments, error in (
        (mbd.plot_phase, (motion, {"x": arm.x}), "two scalars"),
        (mbd.plot_phase, (motion, {"x": arm.x, "r": arm.position}), "two scalars"),
        (mbd.plot_phase, (motion.initial, {"x": arm.x, "y": arm.y}), "takes a motion"),
        (mbd.plot_energy, (motion.initial,), "takes a motion"),
        (mbd.plot_path, (motion, {"x": arm.x}), "the result of equilibrium_path"),
        (mbd.plot_path, (motion, {}), "nothing to draw"),
        (mbd.plot_modes, ([],), "the result of linearize"),
        (mbd.plot_modes, (3,), "the result of linearize"),
        (mbd.plot_modes, ([motion],), "the result of linearize"),
        (mbd.plot_modes, (mbd.linearize(still, mbd.assemble(still)),), "has no modes, since joints"),
        (mbd.plot_solution, (motion,), "the result of optimize"),
    ):
        with pytest.raises(mbd.MechanismError, match=error):
            call(*arguments)
