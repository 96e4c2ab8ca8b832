"""Exported controllers: C99 without warnings and without the library, and the same bits as in Python."""

from __future__ import annotations

import shutil
import subprocess

import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.control.code import STATUSES

COMPILER = shutil.which("cc")


def controller_of_five_bar():
    """A five-bar that follows a target, and a state."""
    robot = mbd.library.five_bar()
    x, y = mbd.Parameter("x", 0.125), mbd.Parameter("y", 0.35)
    model = robot.mechanism.replace(parameters=[x, y])
    inputs, tip = model.inputs, robot.tip
    cost = 100 * ((tip.x - x) ** 2 + (tip.y - y) ** 2) + 1e-3 * (inputs[0] ** 2 + inputs[1] ** 2)
    problem = mbd.OptimalControlProblem(
        model, duration=0.2, running_cost=cost, path=[mbd.bounded(-3, inputs[0], 3), mbd.bounded(-3, inputs[1], 3)]
    )
    return mbd.Controller(problem, sample=0.02, intervals=10)


def run(command, folder):
    """Run a command that must succeed; its output."""
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
@pytest.mark.skipif(COMPILER is None, reason="no C compiler")
def test_exported_c_computes_the_same_bits(tmp_path):
    """The program of the export prints the inputs that Python returns for the same states."""
    controller = controller_of_five_bar()
    paths = controller.export(tmp_path / "new")
    assert [path.name for path in paths] == ["controller.c", "controller.h", "main.c"]
    folder = tmp_path / "new"
    strict = [COMPILER, "-std=c99", "-pedantic", "-Wall", "-Wextra", "-Werror", "-O1", "-ffp-contract=off"]
    run([*strict, "-c", "controller.c"], folder)
    run([*strict, "main.c", "controller.o", "-lm", "-o", "demo"], folder)
    undefined = set(run(["nm", "-u", "controller.o"], folder).split())
    assert not undefined & {"malloc", "calloc", "realloc", "free", "printf", "fopen"}
    assert (folder / "controller.c").stat().st_size < 2**18
    state = mbd.assemble(controller.mechanism)[controller._model.state]
    controller.reset()
    for k, line in enumerate(run(["./demo"], folder).splitlines()):
        head, values = line.split(":")
        step = controller.step(state, time=k * 0.02)
        assert head.endswith(f"status {step.status}")
        assert np.array_equal(np.array(values.split(), float), step.inputs)


@pytest.mark.slow
def test_header_names_every_number(tmp_path):
    """States with their units, inputs, parameters and statuses are listed in the header."""
    controller_of_five_bar().export(tmp_path)
    header = (tmp_path / "controller.h").read_text()
    for name in ("left.phi, rad", "right.omega, rad/s", "tau left", "  y\n", *STATUSES):
        assert name in header
    assert "@" not in header
