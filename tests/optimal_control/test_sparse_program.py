"""The gathered derivatives of a sparse program equal those of the whole expression."""

import casadi as ca
import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.optimal_control.program.sparse_program import MappedBlock, SparseProgram


def small_program(copies=6, *, with_states=False):
    """A chain of rows that share variables, a global variable, data, and rows at both ends.

    With states, the rows see two of the variables through two expressions in all of them.
    """
    w, d, p = ca.SX.sym("w", 3), ca.SX.sym("d", 1), ca.SX.sym("p", 1)
    chain = np.array([np.arange(copies), np.arange(1, copies + 1), np.full(copies, copies + 1)])
    y, states = (ca.SX.sym("y", 2), ca.vertcat(w[0] * w[2] + d, w[1] + w[0] * w[1])) if with_states else (w[:2], None)
    inner = MappedBlock(
        w,
        d,
        p,
        ca.vertcat(y[1] - w[0] - w[2] * ca.sin(y[0]) * d, y[0] * y[1] * w[2]),
        (y[0] - 1) ** 2 * w[2] * p * ca.exp(y[1]),
        chain,
        *((y, states) if with_states else ()),
    )
    e = ca.SX.sym("e", 3)
    ends = MappedBlock(
        e,
        ca.SX(0, 1),
        p,
        ca.vertcat(e[0] - 0.3, e[1] * e[2] - 1),
        e[1] ** 2 * e[2],
        np.array([[0], [copies], [copies + 1]]),
    )
    return SparseProgram(copies + 2, [inner, ends], p), copies


def free_program():
    """A pendulum of free length that swings up in a free time, with a work that is integrated and a power limit."""
    length, u = mbd.Parameter("length", 1.0, 0.5, 2.0), mbd.Input("u", lower=-6, upper=6)
    rod = mbd.Body("rod", mass=1.0, inertia=0.1, pose=(0, -1, -np.pi / 2))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), rod.at(-length, 0))
    mechanism = mbd.Mechanism(
        [rod], [pin], forces=[mbd.Gravity(), mbd.Torque("motor", rod, u)], inputs=[u], parameters=[length]
    )
    problem = mbd.OptimalControlProblem(
        mechanism,
        duration=(1.0, 5.0),
        initial=[rod.phi == -np.pi / 2, rod.omega == 0],
        final=[rod.phi == np.pi / 2, rod.omega == 0],
        path=[u * rod.omega <= 9],
        free_parameters=[length],
        running_cost=1 + u**2 * rod.omega**2,
        terminal_cost=mbd.integral(u**2 * length) ** 2,
    )
    return mbd.optimize(problem, intervals=6).program.nlp


@pytest.mark.parametrize("with_states", [False, True])
def test_derivatives_equal_those_of_the_whole(with_states):
    """Gradient, Jacobian and Hessian of the Lagrangian against CasADi's own on the whole program."""
    program, copies = small_program(with_states=with_states)
    rng = np.random.default_rng(3)
    compare(program, rng.uniform(-1, 1, program.size), np.r_[2.0, rng.uniform(0.5, 2, copies)])


@pytest.mark.filterwarnings("ignore::mbdcasadi.MechanismWarning")
def test_derivatives_of_a_problem_with_free_times_and_lengths():
    """States at the stages are products of variables there."""
    program = free_program()
    rng = np.random.default_rng(4)
    compare(program, rng.uniform(0.5, 1, program.size), rng.uniform(0.1, 0.2, program.data_size))


def compare(program, x, p):
    """Assert that all derivatives of a program equal those of its cost and rows."""
    lam = np.random.default_rng(5).standard_normal(program.row_count)
    symbol = ca.MX.sym("x", program.size)
    cost, rows = program.evaluate(symbol, p)
    whole = ca.Function(
        "whole",
        [symbol],
        [
            ca.gradient(cost, symbol),
            ca.jacobian(rows, symbol),
            ca.triu(ca.hessian(1.7 * cost + ca.dot(lam, rows), symbol)[0]),
        ],
    )(x)
    given = program.derivatives
    gathered = [given["grad_f"](x, p)[1], given["jac_g"](x, p)[1], given["hess_lag"](x, p, 1.7, lam)]
    for mine, theirs in zip(gathered, whole, strict=True):
        assert np.allclose(mine.full(), theirs.full(), rtol=1e-11, atol=1e-11 * np.max(np.abs(theirs.full())))
