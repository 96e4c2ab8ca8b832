"""C code of the equations, compiled and run."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess

import casadi as ca
import numpy as np
import pytest
from linkages import four_bar, pendulum

import mbdcasadi as mbd

needs_gcc = pytest.mark.skipif(shutil.which("gcc") is None, reason="no C compiler")

MAIN = """
#include <stdio.h>
#include "linkage.h"
int main(void) {
  double t = 0, q[9], v[9], u[1], p[1], a[9], lam[8], rate[18];
  for (int k = 0; k < 9; ++k) if (scanf("%lf", q + k) != 1) return 1;
  for (int k = 0; k < 9; ++k) if (scanf("%lf", v + k) != 1) return 1;
  if (scanf("%lf %lf", u, p) != 2) return 1;
  casadi_int sz_arg, sz_res, sz_iw, sz_w;
  linkage_forward_dynamics_work(&sz_arg, &sz_res, &sz_iw, &sz_w);
  const double *arg[16]; double *res[8]; casadi_int iw[1000]; double w[5000];
  if (sz_arg > 16 || sz_res > 8 || sz_iw > 1000 || sz_w > 5000) return 2;
  arg[0] = &t; arg[1] = q; arg[2] = v; arg[3] = 0; arg[4] = u; arg[5] = p;
  res[0] = a; res[1] = lam;
  if (linkage_forward_dynamics(arg, res, iw, w, 0)) return 3;
  for (int k = 0; k < 9; ++k) printf("%.17g ", a[k]);
  for (int k = 0; k < 8; ++k) printf("%.17g ", lam[k]);
  linkage_right_side_work(&sz_arg, &sz_res, &sz_iw, &sz_w);
  if (sz_iw > 1000 || sz_w > 5000) return 2;
  arg[0] = &t; arg[1] = q; arg[2] = v; arg[3] = 0; arg[4] = u; arg[5] = p;
  res[0] = rate;
  if (linkage_right_side(arg, res, iw, w, 0)) return 3;
  for (int k = 0; k < 18; ++k) printf("%.17g ", rate[k]);
  return 0;
}
"""


@pytest.mark.slow
@needs_gcc
def test_a_program_in_c_finds_the_same_accelerations(tmp_path):
    tau, mass = mbd.Input("tau"), mbd.Parameter("mass", 1.5)
    f = four_bar(
        0.9,
        masses=(1.0, 2.0, mass),
        forces=lambda f: [mbd.Gravity(), mbd.Torque("motor", f.crank, tau)],
        inputs=[tau],
        parameters=[mass],
    )
    eom = mbd.equations(f.mechanism)
    source, header = eom.generate_c(tmp_path / "linkage.c")
    assert source.exists() and header.exists()
    (tmp_path / "main.c").write_text(MAIN)
    command = ["gcc", "-O1", "-Wall", "-o", "run", "main.c", "linkage.c", "-lm"]
    subprocess.run(command, cwd=tmp_path, check=True, capture_output=True)
    state = mbd.assemble(
        f.mechanism, [f.crank.phi == 1.1, f.crank.omega == 5], inputs={tau: 0.7}, parameters={mass: 1.8}
    )
    given = " ".join(f"{x:.17g}" for x in (*state.q, *state.v, 0.7, 1.8))
    done = subprocess.run([str(tmp_path / "run")], input=given, capture_output=True, text=True, check=True)
    found = np.array(done.stdout.split(), float)
    assert found[:9] == pytest.approx(state.a, abs=1e-9)
    assert found[9:17] == pytest.approx(state.lam, abs=1e-9)
    assert found[17:] == pytest.approx(np.r_[state.v, state.a], abs=1e-9)


def load(folder, source, name):
    """A function of a compiled file."""
    library = folder / f"{source.stem}.so"
    if not library.exists():
        subprocess.run(["gcc", "-O1", "-shared", "-fPIC", "-o", str(library), str(source), "-lm"], check=True)
    return ca.external(f"{source.stem}_{name}", str(library))


@needs_gcc
def test_matrices_residual_and_jacobians(tmp_path):
    current = mbd.StateVariable("current", 0.4)
    p = pendulum(
        angle=0.3,
        forces=lambda rod: [mbd.Torque("motor", rod, 2 * current)],
        states={current: -3 * current},
    )
    eom = mbd.equations(p.mechanism)
    source, _ = eom.generate_c(tmp_path / "rod.c")
    state = mbd.assemble(p.mechanism, [p.rod.phi == 0.3, p.rod.omega == 2])
    assert load(tmp_path, source, "mass_matrix")(state.parameters).full() == pytest.approx(state[eom.M])
    _, jacobian, _ = load(tmp_path, source, "constraints")(0, state.q, state.parameters)
    assert jacobian.full() == pytest.approx(state[eom.Phi_q])
    residual = load(tmp_path, source, "residual")
    assert residual(*state.arguments).full().ravel() == pytest.approx(np.zeros(3 + 2 + 2 + 2), abs=1e-12)
    jacobians = load(tmp_path, source, "jacobians")(*state.arguments)
    for k, slope in enumerate(jacobians, start=1):
        arguments = list(state.arguments)
        for j in range(np.size(arguments[k])):
            ends = []
            for step in (-1e-6, 1e-6):
                moved = np.array(arguments[k], float)
                moved[j] += step
                ends.append(residual(*arguments[:k], moved, *arguments[k + 1 :]).full().ravel())
            assert slope.full()[:, j] == pytest.approx((ends[1] - ends[0]) / 2e-6, abs=1e-7)
    assert float(load(tmp_path, source, "state_rates")(*state.arguments)) == pytest.approx(-1.2)


@pytest.mark.slow
@needs_gcc
def test_redundant_rows_give_the_multipliers_of_least_norm(tmp_path):
    f = four_bar(0.9, forces=[mbd.Gravity()])
    again = mbd.Revolute("again", f.crank.at(0.1, 0), f.coupler.at(-0.25, 0))
    doubled = f.mechanism.replace(joints=[*f.mechanism.joints, again])
    source, _ = mbd.equations(doubled).generate_c(tmp_path / "doubled.c")
    state = mbd.assemble(doubled)
    a, lam = load(tmp_path, source, "forward_dynamics")(0, state.q, state.v, [], [], [])
    eom = mbd.equations(doubled)
    jacobian = eom.jacobian(0, state.q, [])[0].full()
    load_less_inertia = ca.Function("f", [eom.q, eom.v], [eom.Q - eom.mass_diagonal * a])(state.q, state.v).full()
    least = np.linalg.lstsq(jacobian.T, load_less_inertia.ravel(), rcond=1e-10)[0]
    assert a.full().ravel() == pytest.approx(state.a, abs=1e-8)
    # rounding errors in S are amplified by 1 / REGULARISATION = 1e7 along the dependent rows: about 1e-7 for 30 N
    assert lam.full().ravel() == pytest.approx(least, abs=2e-6)


@needs_gcc
def test_forces_that_depend_on_reactions(tmp_path):
    """Friction of a block that slides on a plane under its own weight: a Newton solver in C."""
    block = mbd.Body("block", mass=2.0, inertia=1.0, velocity=(1.0, 0, 0))
    plane = mbd.Translational("plane", mbd.ground.at(0, 0), block.at(0, 0))
    push = mbd.norm(plane.reaction_on(block).force)
    friction = mbd.Force("friction", block.at(0, 0), (-0.3 * push * mbd.tanh(block.vx / 1e-3), 0))
    model = mbd.Mechanism(bodies=[block], joints=[plane], forces=[mbd.Gravity(), friction])
    source, _ = mbd.equations(model).generate_c(tmp_path / "block.c")
    a, _ = load(tmp_path, source, "forward_dynamics")(0, np.zeros(3), [1.0, 0, 0], [], [], [])
    assert a.full().ravel() == pytest.approx([-0.3 * 9.81, 0, 0], abs=1e-9)


@needs_gcc
def test_friction_of_a_driven_grain(tmp_path):
    """A steady drive has no acceleration to be found: its friction is μ m g at 1e-14 N too."""
    mass = 1e-15
    grain = mbd.Body("grain", mass=mass, inertia=1e-28, velocity=(1e-6, 0, 0))
    plane = mbd.Translational("plane", mbd.ground.at(0, 0), grain.at(0, 0))
    drive = mbd.Driver("drive", plane.displacement, 1e-6 * mbd.t)
    rub = mbd.JointFriction("rub", plane, mbd.Coulomb(0.3, velocity_tolerance=1e-10))
    model = mbd.Mechanism([grain], joints=[plane], drivers=[drive], forces=[mbd.Gravity(), rub])
    source, _ = mbd.equations(model).generate_c(tmp_path / "grain.c")
    _, lam = load(tmp_path, source, "forward_dynamics")(0, np.zeros(3), [1e-6, 0, 0], [], [], [])
    assert lam.full().ravel() / (mass * 9.81) == pytest.approx([-1, 0, -0.3], abs=1e-12)


@needs_gcc
def test_other_programs_find_arguments_by_the_convention_of_casadi(tmp_path):
    """Names, sizes and patterns, in C and in C++, as declared in the header."""
    source, header = mbd.equations(pendulum().mechanism).generate_c(tmp_path / "rod.c")
    function = load(tmp_path, source, "forward_dynamics")
    assert function.name_in() == ["t", "q", "v", "z", "u", "p"] and function.name_out() == ["a", "lam"]
    assert [function.size_in(k) for k in range(6)] == [(1, 1), (3, 1), (3, 1), (0, 1), (0, 1), (0, 1)]
    assert function.sparsity_out(1).is_dense()
    library = ctypes.CDLL(str(tmp_path / "rod.so"))
    declared = set(re.findall(r"\b(rod_\w+)\(", header.read_text()))
    assert len(declared) == 7 * 14
    assert all(hasattr(library, name) for name in declared)
    lengths = [ctypes.c_longlong() for _ in range(4)]
    library.rod_right_side_work(*map(ctypes.byref, lengths))
    macros = [
        re.search(rf"rod_right_side_SZ_{name} (\d+)", header.read_text())[1] for name in ("ARG", "RES", "IW", "W")
    ]
    assert [length.value for length in lengths] == [int(macro) for macro in macros]
    (tmp_path / "both.cpp").write_text('#include "rod.h"\n#include "rod.c"\n')
    command = ["gcc", "-x", "c++", "-fsyntax-only", "-Wall", "-Wextra", "-Wno-unused-parameter", "both.cpp"]
    if shutil.which("g++"):
        subprocess.run(command, cwd=tmp_path, check=True)


@pytest.mark.parametrize("name", ["engine.h", "2nd.c", "my engine.c", "engine"])
def test_names_that_c_does_not_take(tmp_path, name):
    with pytest.raises(mbd.ModelError, match="named as a C identifier"):
        mbd.equations(pendulum().mechanism).generate_c(tmp_path / name)


def test_a_folder_that_is_not_there(tmp_path):
    with pytest.raises(mbd.ModelError, match="there is no folder"):
        mbd.equations(pendulum().mechanism).generate_c(tmp_path / "nowhere" / "rod.c")


def test_a_path_that_is_none():
    with pytest.raises(mbd.ModelError, match="takes the path of a file"):
        mbd.equations(pendulum().mechanism).generate_c(3)
